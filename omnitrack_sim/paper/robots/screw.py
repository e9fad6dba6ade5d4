"""Claims about screw drives: laws that follow from passive wheels, and what they pass."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.paper.claim import (
    Claim,
    Measurement,
    claim,
    rate,
    runs_of,
    speed_of,
    study,
    varied,
)
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.screw import ARMS, Screw
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.walls.around import add_pipes

KINEMATICS, STATICS = "kinematics of a screw", "balance of passive wheels"
WEIGHTLESS = {"world.gravity": (0.0, 0.0, 0.0)}
STRAIGHT = {"kind": "straight", "name": "pipe", "length": 1.0}
HALF = {"kind": "straight", "length": 0.4}
ASSUMED = (
    *("lead", "rotor_preload", "stator_preload", "stiffness", "wheel_radius", "wheelbase"),
    *("coupling", "torque_limit"),
)
"""Parameters that nothing published says."""
HARD = (0.99, 0.999, 0.001, 0.5, 2.0)
"""MuJoCo's solimp of walls into which tyres sink by 0.07 mm instead of 0.5: half of that adds to
the radius at which they roll."""


def _runs(pipes: Sequence[Mapping[str, Any]], *cases: Mapping[str, Any]) -> list[Result]:
    """Runs through pipes at friction 0.8, with the changes of each case."""
    return runs_of("robots/screw_elbow", ({"pipes": list(pipes), **case} for case in cases))


def _late(result: Result) -> tuple[float, float]:
    """Speed, m/s, and torque, N m, over the last second."""
    time = result.trajectory.time
    begin = float(time[-1]) - 1.0
    torque = float(result.trajectory["actuator_force"][time > begin].mean())
    return speed_of(result, begin), torque


def _unloaded(lead: float) -> float:
    """Way over angle of the rotor, divided by R tan(lead), without weight on hard walls."""
    robot = Screw(lead=lead)
    spec = robot.spec()
    add_pipes(spec, Network(fittings=[STRAIGHT]), friction=0.8, solimp=HARD)
    model = spec.compile()
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[2], data.ctrl[:] = 0.2, robot.speed
    mujoco.mj_step(model, data, 500)
    turn, way = float(data.joint("drive").qpos[0]), float(data.qpos[2])
    mujoco.mj_step(model, data, 500)
    return (data.qpos[2] - way) / (float(data.joint("drive").qpos[0]) - turn) / robot.lever


@claim(
    source=KINEMATICS,
    paper="v = omega R tan(lead)",
    statement="without weight, way over the rotor's angle within {percent:g} % of it",
    limits={"percent": 0.1},
    how="plain MuJoCo, walls of solimp 0.99",
)
def speed_without_load(_quick: bool, percent: float) -> Measurement:
    """The speed without load."""
    leads = (0.1, 0.175, 0.35)
    errors = [_unloaded(lead) - 1 for lead in leads]
    return Measurement(
        ", ".join(
            f"{100 * error:+.2f} % at {lead:g} rad"
            for lead, error in zip(leads, errors, strict=True)
        ),
        100 * max(map(abs, errors)) < percent,
        uncertainty="one run each of a second; half of the tyres' sinkage, 0.04 %, adds to R",
    )


@claim(
    source="line of a direct-current motor",
    paper="v = R tan(lead) (omega0 - F R tan(lead) / k)",
    statement="up, level and down within {percent:g} % of it, F the weight along the pipe",
    limits={"percent": 1},
    how="screw in a straight",
)
def speed_under_weight(_quick: bool, percent: float) -> Measurement:
    """The speed up, level and down, of which the motor gives way."""
    axes = {"up": (0, 0, 1), "level": (1, 0, 0), "down": (0, 0, -1)}
    runs = _runs([STRAIGHT], *({"start.axis": a, "run.time_limit": 4.0} for a in axes.values()))
    robot = Screw()
    laws = [robot.speed_at(robot.speed, a[2] * robot.mass * GRAVITY) for a in axes.values()]
    speeds = [_late(run)[0] for run in runs]
    return Measurement(
        ", ".join(
            f"{name} {1e3 * v:.1f} by {1e3 * law:.1f} mm/s"
            for name, v, law in zip(axes, speeds, laws, strict=True)
        ),
        all(abs(v / w - 1) < percent / 100 for v, w in zip(speeds, laws, strict=True)),
    )


@claim(
    source=STATICS,
    paper="T omega = F v, so T = F R tan(lead)",
    statement="mean torque of the motor against pulls of 5, 15 and 25 N within {percent:g} % of it",
    limits={"percent": 2},
    how="screw in a straight without weight, pull.force",
)
def torque_of_a_pull(_quick: bool, percent: float) -> Measurement:
    """The torque that a pull asks for."""
    pulls = (5.0, 15.0, 25.0)
    cases = ({**WEIGHTLESS, "pull.force": pull, "run.time_limit": 4.0} for pull in pulls)
    runs = _runs([STRAIGHT], *cases)
    robot = Screw()
    torques = [_late(run)[1] for run in runs]
    laws = [pull * robot.lever for pull in pulls]
    return Measurement(
        ", ".join(f"{t:.3f} by {law:.3f} N m" for t, law in zip(torques, laws, strict=True)),
        all(abs(t / w - 1) < percent / 100 for t, w in zip(torques, laws, strict=True)),
    )


@claim(
    source=STATICS,
    paper="F = 3 N mu cos(lead)",
    statement="a growing pull stops it within {percent:g} % of that, at friction 0.2 and 0.4",
    limits={"percent": 5},
    how="screw in a straight without weight, pull.rate",
)
def slip_limit(_quick: bool, percent: float) -> Measurement:
    """The pull from which on the rotor slips."""
    frictions = (0.2, 0.4)
    cases = ({**WEIGHTLESS, "world.friction": mu, "pull.rate": 4.0} for mu in frictions)
    held = [float(run.metrics["pull_held_n"]) for run in _runs([STRAIGHT], *cases)]  # type: ignore
    laws = [Screw().slip_pull(mu) for mu in frictions]
    return Measurement(
        ", ".join(f"{f:.1f} by {law:.1f} N" for f, law in zip(held, laws, strict=True)),
        all(abs(f / law - 1) < percent / 100 for f, law in zip(held, laws, strict=True)),
        uncertainty="4 N/s, read to 0.5 s of headway",
    )


@claim(
    source=STATICS,
    paper="F = 3 P mu / tan(lead)",
    statement="with weak springs the stator turns by under {still:g} degrees at 0.8 of that pull, "
    "by over {turned:g} at 1.2 of it",
    limits={"still": 5, "turned": 45},
    how="screw, stator_preload 2 N, lead 0.35 rad, 2 s without weight",
)
def stator_limit(_quick: bool, still: float, turned: float) -> Measurement:
    """The pull from which on the stator turns instead of the rotor."""
    robot = Screw(stator_preload=2.0, lead=0.35)
    least = ARMS * robot.stator_preload * 0.8 / math.tan(robot.lead)
    parts = (0.8, 1.2)
    changes = {"robot.stator_preload": robot.stator_preload, "robot.lead": robot.lead}
    cases = (
        {**WEIGHTLESS, **changes, "pull.force": part * least, "run.time_limit": 2.0}
        for part in parts
    )
    turns = [np.degrees(_turn(run)) for run in _runs([STRAIGHT], *cases)]
    return Measurement(
        ", ".join(
            f"{turn:.0f} degrees at {part:g}" for part, turn in zip(parts, turns, strict=True)
        ),
        turns[0] < still and turns[1] > turned,
    )


def _turn(result: Result) -> float:
    """Angle, rad, by which the stator has turned about the pipe."""
    angle = np.unwrap(2 * np.arctan2(*result.trajectory["quaternion"][:, [3, 0]].T))
    return float(np.abs(angle - angle[0]).max())


@study(
    source="nothing published",
    paper="what it does in elbows",
    statement="how many elbows of 240 and 160 mm it passes, up, level and down",
    how="screw, friction 0.8",
)
def elbows(quick: bool) -> Measurement:
    """Elbows, up, level and down."""
    axes = [(0, 0, 1)] if quick else [(0, 0, 1), (1, 0, 0), (0, 0, -1)]
    cases = [
        {"start.axis": axis, "start.theta5_deg": angle}
        for axis in axes
        for angle in ((0.0,) if quick else (0.0, 40.0, 80.0))
    ]
    runs: list[Result] = []
    for radius in (0.24, 0.16):
        elbow = {"kind": "elbow", "mean_radius": radius}
        runs += _runs([HALF, elbow, HALF], *cases)
    robot, torque = Screw(), max(float(run.trajectory["actuator_force"].max()) for run in runs)
    passed, total, _ = rate(runs)
    return Measurement(
        f"{passed} of {total}, torque up to {torque:.2f} N m; "
        f"{robot.mass * GRAVITY * robot.lever:.2f} climb a straight",
        uncertainty="one run each",
    )


@study(
    source="nothing published",
    paper="what it does in a tee",
    statement="how many runs go straight over the branch, up and level",
    how="screw, friction 0.8",
    note="Wheels of the rotor run across the opening, drop over its rim and meet the far one "
    "nearly head on; the motor stalls.",
)
def tee(quick: bool) -> Measurement:
    """Straight over a tee."""
    angles = (0.0,) if quick else (0.0, 40.0, 80.0)
    fitting = {"kind": "tee", "enter": "run_start", "leave": "run_end"}
    axes = ((0, 0, 1), (1, 0, 0))
    cases = [{"start.axis": a, "start.theta5_deg": angle} for a in axes for angle in angles]
    runs = _runs([HALF, fitting, HALF], *cases)
    passed, total, _ = rate(runs)
    return Measurement(
        f"{passed} of {total} ({', '.join(sorted({r.outcome.value for r in runs}))})",
        uncertainty="one run each",
    )


@study(
    source="nothing published",
    paper="sizes 0.7 and 1.4 times as large, in a climbed elbow",
    statement="what climbing into an elbow of 160 mm depends on: "
    f"{', '.join(ASSUMED)}, one at a time",
    how="screw, friction 0.8",
)
def assumed_sizes(quick: bool) -> Measurement:
    """An elbow with other sizes than those assumed."""
    cases = varied(Screw(), ASSUMED[:1] if quick else ASSUMED)
    runs = _runs([HALF, {"kind": "elbow", "mean_radius": 0.16}, HALF], *cases)
    passed, total, _ = rate(runs)
    torques = [float(run.trajectory["actuator_force"].max()) for run in runs]
    return Measurement(
        f"{passed} of {total} pass, torque up to {min(torques):.2f} to {max(torques):.2f} N m",
        uncertainty="one run each",
    )


CLAIMS: tuple[Claim, ...] = (
    speed_without_load,
    speed_under_weight,
    torque_of_a_pull,
    slip_limit,
    stator_limit,
    elbows,
    tee,
    assumed_sizes,
)
"""In the order of the page."""
