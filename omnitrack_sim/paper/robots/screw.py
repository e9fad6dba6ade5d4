"""Claims about screw drives: laws that follow from passive wheels, and what they pass."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.paper.claim import (
    Claim,
    ClaimMeasure,
    rate,
    runs_of,
    speed_of,
    study,
    varied,
    verdict_of,
)
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.robot import GRAVITY
from omnitrack_sim.robots.screw import ARMS, Screw
from omnitrack_sim.walls.around import add_pipes

KINEMATICS, STATICS = "kinematics of a screw", "balance of passive wheels"
WEIGHTLESS = {"world.gravity": (0.0, 0.0, 0.0)}
STRAIGHT = {"kind": "straight", "name": "pipe", "length": 1.0}
HALF = {"kind": "straight", "length": 0.4}
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


def speed_law(quick: bool) -> Claim:
    """The speed without load."""
    leads = (0.1, 0.175, 0.35)
    errors = [_unloaded(lead) - 1 for lead in leads]
    return Claim(
        id="speed_without_load",
        source=KINEMATICS,
        paper="v = omega R tan(lead)",
        statement="without weight, way over the rotor's angle within 0.1 % of it",
        measured=", ".join(
            f"{100 * error:+.2f} % at {lead:g} rad"
            for lead, error in zip(leads, errors, strict=True)
        ),
        uncertainty="one run each of a second; half of the tyres' sinkage, 0.04 %, adds to R",
        verdict=verdict_of(max(map(abs, errors)) < 1e-3),
        how="plain MuJoCo, walls of solimp 0.99",
    )


def own_weight(quick: bool) -> Claim:
    """The speed up, level and down, of which the motor gives way."""
    axes = {"up": (0, 0, 1), "level": (1, 0, 0), "down": (0, 0, -1)}
    runs = _runs([STRAIGHT], *({"start.axis": a, "run.time_limit": 4.0} for a in axes.values()))
    robot = Screw()
    laws = [robot.speed_at(robot.speed, a[2] * robot.mass * GRAVITY) for a in axes.values()]
    speeds = [_late(run)[0] for run in runs]
    return Claim(
        id="speed_under_weight",
        source="line of a direct-current motor",
        paper="v = R tan(lead) (omega0 - F R tan(lead) / k)",
        statement="up, level and down within 1 % of it, F the weight along the pipe",
        measured=", ".join(
            f"{name} {1e3 * v:.1f} by {1e3 * law:.1f} mm/s"
            for name, v, law in zip(axes, speeds, laws, strict=True)
        ),
        verdict=verdict_of(all(abs(v / w - 1) < 0.01 for v, w in zip(speeds, laws, strict=True))),
        how="screw in a straight",
    )


def torque_law(quick: bool) -> Claim:
    """The torque that a pull asks for."""
    pulls = (5.0, 15.0, 25.0)
    cases = ({**WEIGHTLESS, "pull.force": pull, "run.time_limit": 4.0} for pull in pulls)
    runs = _runs([STRAIGHT], *cases)
    robot = Screw()
    torques = [_late(run)[1] for run in runs]
    laws = [pull * robot.lever for pull in pulls]
    return Claim(
        id="torque_of_a_pull",
        source=STATICS,
        paper="T omega = F v, so T = F R tan(lead)",
        statement="mean torque of the motor against pulls of 5, 15 and 25 N within 2 % of it",
        measured=", ".join(
            f"{t:.3f} by {law:.3f} N m" for t, law in zip(torques, laws, strict=True)
        ),
        verdict=verdict_of(all(abs(t / w - 1) < 0.02 for t, w in zip(torques, laws, strict=True))),
        how="screw in a straight without weight, pull.force",
    )


def slip_limit(quick: bool) -> Claim:
    """The pull from which on the rotor slips."""
    frictions = (0.2, 0.4)
    cases = ({**WEIGHTLESS, "world.friction": mu, "pull.rate": 4.0} for mu in frictions)
    held = [float(run.metrics["pull_held_n"]) for run in _runs([STRAIGHT], *cases)]  # type: ignore
    laws = [Screw().slip_pull(mu) for mu in frictions]
    return Claim(
        id="slip_limit",
        source=STATICS,
        paper="F = 3 N mu cos(lead)",
        statement="a growing pull stops it within 5 % of that, at friction 0.2 and 0.4",
        measured=", ".join(f"{f:.1f} by {law:.1f} N" for f, law in zip(held, laws, strict=True)),
        uncertainty="4 N/s, read to 0.5 s of headway",
        verdict=verdict_of(all(abs(f / law - 1) < 0.05 for f, law in zip(held, laws, strict=True))),
        how="screw in a straight without weight, pull.rate",
    )


def stator_limit(quick: bool) -> Claim:
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
    return Claim(
        id="stator_limit",
        source=STATICS,
        paper="F = 3 P mu / tan(lead)",
        statement="with weak springs the stator turns by under 5 degrees at 0.8 of that pull, by "
        "over 45 at 1.2 of it",
        measured=", ".join(
            f"{turn:.0f} degrees at {part:g}" for part, turn in zip(parts, turns, strict=True)
        ),
        verdict=verdict_of(turns[0] < 5 and turns[1] > 45),
        how="screw, stator_preload 2 N, lead 0.35 rad, 2 s without weight",
    )


def _turn(result: Result) -> float:
    """Angle, rad, by which the stator has turned about the pipe."""
    angle = np.unwrap(2 * np.arctan2(*result.trajectory["quaternion"][:, [3, 0]].T))
    return float(np.abs(angle - angle[0]).max())


def elbows(quick: bool) -> Claim:
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
    return study(
        id="elbows",
        source="nothing published",
        paper="what it does in elbows",
        statement="how many elbows of 240 and 160 mm it passes, up, level and down",
        measured=f"{passed} of {total}, torque up to {torque:.2f} N m; "
        f"{robot.mass * GRAVITY * robot.lever:.2f} climb a straight",
        uncertainty="one run each",
        how="screw, friction 0.8",
    )


def tee(quick: bool) -> Claim:
    """Straight over a tee."""
    angles = (0.0,) if quick else (0.0, 40.0, 80.0)
    fitting = {"kind": "tee", "enter": "run_start", "leave": "run_end"}
    axes = ((0, 0, 1), (1, 0, 0))
    cases = [{"start.axis": a, "start.theta5_deg": angle} for a in axes for angle in angles]
    runs = _runs([HALF, fitting, HALF], *cases)
    passed, total, _ = rate(runs)
    return study(
        id="tee",
        source="nothing published",
        paper="what it does in a tee",
        statement="how many runs go straight over the branch, up and level",
        measured=f"{passed} of {total} ({', '.join(sorted({r.outcome.value for r in runs}))})",
        uncertainty="one run each",
        how="screw, friction 0.8",
        note="Wheels of the rotor run across the opening, drop over its rim and meet the far one "
        "nearly head on; the motor stalls.",
    )


def assumed(quick: bool) -> Claim:
    """An elbow with other sizes than those assumed."""
    names = ("lead", "rotor_preload", "stator_preload", "stiffness", "wheel_radius", "wheelbase")
    names += ("coupling", "torque_limit")
    cases = varied(Screw(), names[:1] if quick else names)
    runs = _runs([HALF, {"kind": "elbow", "mean_radius": 0.16}, HALF], *cases)
    passed, total, _ = rate(runs)
    torques = [float(run.trajectory["actuator_force"].max()) for run in runs]
    return study(
        id="assumed_sizes",
        source="nothing published",
        paper="sizes 0.7 and 1.4 times as large, in a climbed elbow",
        statement="what climbing into an elbow of 160 mm depends on: "
        f"{', '.join(names)}, one at a time",
        measured=f"{passed} of {total} pass, torque up to {min(torques):.2f} to "
        f"{max(torques):.2f} N m",
        uncertainty="one run each",
        how="screw, friction 0.8",
    )


MEASURES: tuple[ClaimMeasure, ...] = (
    speed_law,
    own_weight,
    torque_law,
    slip_limit,
    stator_limit,
    elbows,
    tee,
    assumed,
)
