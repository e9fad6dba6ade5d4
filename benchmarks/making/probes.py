"""Short runs by which a figure's record knows the physics that it was made by.

Each probe drives one robot for a few seconds through one thing that the package models: contacts on
exact walls and on primitives, motors and the differential, every manoeuvre of the controllers,
sensors, estimate and map. Two states that differ by 1e-9 at the start differ by less than 1e-5 at
the end of a probe, so other processors give the same figures within ``TOLERANCE``, and a change of
a law or of a constant does not. What only rare manoeuvres show (rolls tail first, a robot that has
fallen past a branch) they do not notice: whole missions depend too much on rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import matrix_from_quaternion

TOLERANCE = 1e-4
"""Relative; of what is smaller than its ``SMALL`` in absolute value, of that."""
SMALL = {
    "position": 0.1,
    "estimate": 0.1,
    "axes": 0.1,
    "roll": 0.1,
    "energy": 0.1,
    "slip": 0.01,
    "slip_velocity": 0.01,
    "traction": 1.0,
    "force": 1.0,
    "parts": 1.0,
}
"""Scales of the values: m, m, 1, rad, J, m, m/s, N, N, 1."""
NEAR = {"start.distance": 0.2, "control.align": False}
"""A robot close before its fitting, which does not roll first."""
WEAK = {"like": "pololu_1000_hpcb", "torque_limit": 0.4}
"""The motor that the paper names, with little torque."""
ONBOARD = {"sensing.kind": "onboard", "start.theta5_deg": 30.0, "start.distance": 0.2}


class Probe(NamedTuple):
    """One short run.

    Attributes:
        scenario: shipped scenario. changes: of it, as ``override`` takes them.
        seconds: simulated.
        about: what it stands for.
    """

    scenario: str
    changes: Mapping[str, Any]
    seconds: float
    about: str


PROBES = {
    "climb": Probe("vertical_climb", {"start.theta5_deg": 20.0}, 0.5, "a climb in a straight"),
    "elbow": Probe(
        "elbow_short",
        NEAR | {"start.theta5_deg": 25.0, "world.friction": 0.7},
        2.5,
        "a bend with feedback",
    ),
    "tee": Probe(
        "tee_turn",
        NEAR | {"start.theta5_deg": 8.0, "world.friction": 0.6, "world.gravity": [3.0, -5.0, 4.0]},
        2.5,
        "a turn into a branch on a slippery wall",
    ),
    "merge": Probe(
        "tee_merge",
        NEAR | {"start.theta5_deg": 15.0, "world.friction": 0.8},
        3.0,
        "a turn out of a branch",
    ),
    "align": Probe(
        "tee_turn",
        {"start.theta5_deg": 50.0, "start.distance": 0.2},
        2.5,
        "the roll before a tee",
    ),
    "retry": Probe(
        "tee_turn",
        NEAR | {"start.theta5_deg": 58.0},
        4.2,
        "a robot that hangs in a tee and backs off",
    ),
    "slide": Probe(
        "tee_turn",
        NEAR | {"start.theta5_deg": 7.0, "world.friction": 0.52, "world.gravity": [0.0, 0.0, 9.81]},
        4.0,
        "a turn that slips down the run and is begun again",
    ),
    "over": Probe(
        "tee_straight",
        NEAR | {"start.theta5_deg": 30.0},
        2.0,
        "straight over a tee",
    ),
    "wye": Probe("wye_turn", {"start.distance": 0.2}, 3.5, "a turn into a wye's branch"),
    "mission": Probe("missions/close_fittings", {}, 3.5, "fittings close together"),
    "step": Probe("step", {"start.distance": 0.3}, 2.0, "over a step up"),
    "relief": Probe(
        "old_pipe", {"start.distance": 0.5}, 3.0, "a pressed pipe with welds, silted up"
    ),
    "primitives": Probe(
        "tee_turn",
        NEAR | {"start.theta5_deg": 8.0, "physics.collider": "primitives"},
        1.5,
        "a turn on walls of primitives",
    ),
    "paper": Probe(
        "tee_turn",
        NEAR | {"start.theta5_deg": 8.0, "control.kind": "paper"},
        1.5,
        "the paper's open-loop speeds",
    ),
    "differential": Probe(
        "elbow",
        NEAR | {"start.theta5_deg": 8.0, "robot.drive": "differential"},
        1.5,
        "one motor and a differential",
    ),
    "published": Probe(
        "tee_turn",
        NEAR
        | {
            "start.theta5_deg": 8.0,
            "robot.motor": WEAK,
            "robot.preload": 30.0,
        },
        3.0,
        "a turn with the motor that the paper names and little torque, in which gears hold belts",
    ),
    "descent": Probe(
        "tee_turn",
        NEAR
        | {
            "start.theta5_deg": 8.0,
            "robot.motor": WEAK,
            "world.gravity": [0.0, 3.0, 9.0],
        },
        2.5,
        "such a turn down the run, which begins sooner",
    ),
    "astride": Probe(
        "tee_turn",
        NEAR
        | {
            "start.theta5_deg": 4.0,
            "control.align": True,
            "robot.motor": WEAK,
            "world.friction": 0.66,
            "world.gravity": [0.0, 3.0, 9.3],
        },
        7.0,
        "such a turn that fails, and whose robot rolls astride the branch to back off",
    ),
    "policy": Probe(
        "tee_turn",
        {"start.distance": 0.2, "control.kind": "policy", "control.parameters.policy": "tee_turn"},
        1.0,
        "a learned controller",
    ),
    "depth": Probe("tee_turn", ONBOARD, 1.5, "the estimate by a depth camera"),
    "headlight": Probe(
        "tee_turn",
        ONBOARD | {"sensing.camera": "headlight"},
        1.5,
        "the estimate by a headlight camera",
    ),
    "explore": Probe("missions/explore_onboard", {}, 1.5, "the first sightings of an explorer"),
}
Values = dict[str, list[float]]
"""Measured by a probe, by quantity."""


def driven(scenario: ot.Scenario, seconds: float) -> ot.Result:
    """Run a scenario under its controller, and end it after some seconds.

    A time limit would not do: that of a robot which explores grows with its map.
    """
    sim, end = ot.Simulation([scenario]), ot.Command(np.zeros((1, 3)), over=np.ones(1, bool))
    while sim.active.any():
        sim.step(end if sim.time[0] >= seconds else None)
    return sim.results()[0]


def measured(name: str, changes: Mapping[str, Any] | None = None) -> Values:
    """Run a probe, with changes of its scenario, and return what it measures."""
    probe = PROBES[name]
    scenario = ot.load_scenario(probe.scenario, {**probe.changes, **(changes or {})})
    result = driven(scenario, probe.seconds)
    record, metrics = result.trajectory, result.metrics
    values = {
        "position": record["position"][-1],
        "axes": matrix_from_quaternion(record["quaternion"][-1]),  # a quaternion's sign may flip
        "roll": record["roll"][-1],
        "energy": metrics["energy_j"],
        "slip": np.sum(metrics["slip_distance_m"]),
        "slip_velocity": record["slip_velocity"].mean(axis=0),
        "traction": record["traction"].mean(axis=0),
        "force": record["normal_force"].max(),
    }
    if "position_estimate" in record.channels:
        values["estimate"] = record["position_estimate"][-1]
    if result.map is not None:
        values["parts"] = len(result.map.fittings)
    return {key: np.round(np.ravel(value), 9).tolist() for key, value in values.items()}


def difference(one: Values, other: Values) -> float:
    """Return the largest relative difference of two measurements of a probe.

    It is 1 where the quantities themselves differ.
    """
    shapes = [{key: len(value) for key, value in values.items()} for values in (one, other)]
    if shapes[0] != shapes[1]:
        return 1.0
    largest = 0.0
    for key in one:
        a, b = np.array(one[key]), np.array(other[key])
        scale = np.maximum(np.maximum(np.abs(a), np.abs(b)), SMALL[key])
        largest = max(largest, float(np.max(np.abs(a - b) / scale)))
    return largest


def measured_all(names: Iterable[str]) -> dict[str, Values]:
    """Return the measurements of some probes, by name."""
    return {name: measured(name) for name in PROBES if name in set(names)}
