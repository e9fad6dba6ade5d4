"""Claims on the wheeled wall-presser with three arms: MRINSPECT IV and SmartCrawler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Sample,
    all_pass,
    rate,
    rate_text,
    runs_of,
    speed_of,
    verdict_of,
)
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.presser import ARMS, Presser
from omnitrack_sim.robots.robot import GRAVITY

T_RO = "Roh and Choi, IEEE T-RO 21(1), 2005"
ELBOW = "robots/presser_elbow"
BEND, INLET = 0.24, 0.5
"""Mean radius of the elbow and length of the straights, m."""
BRANCH = [
    {"kind": "straight", "length": INLET},
    {"kind": "tee", "enter": "run_start", "leave": "branch"},
    {"kind": "straight", "length": INLET},
]


def _up(**changes: Any) -> dict[str, Any]:
    """Changes for a short climb in a straight riser."""
    riser = [{"kind": "straight", "length": 1.2}]
    return {"pipes": riser, "start.distance": 0.6, "run.time_limit": 2.0, **changes}


def climb_limit(quick: bool) -> Claim:
    """The weight that three springs hold."""
    robot = Presser()
    weight, grip = robot.mass * GRAVITY, 3 * robot.preload
    parts = (0.9, 0.95, 1.05, 1.1)
    runs = runs_of(ELBOW, (_up(**{"world.friction": part * weight / grip}) for part in parts))
    ways = [float(np.ptp(r.trajectory["distance"][[0, -1]])) for r in runs]
    climbed = [r.trajectory["distance"][-1] > 0.65 for r in runs]
    slid = [r.trajectory["distance"][-1] < 0.59 for r in runs]
    return Claim(
        id="presser_climb_limit",
        source="statics of three sprung arms",
        paper="3 preload friction = weight",
        statement="at 5 % more friction than that it climbs, at 5 % less it slides down",
        measured=", ".join(
            f"{part:.2f} {'up' if up else 'down'} {1e3 * way:.0f} mm"
            for part, up, way in zip(parts, climbed, ways, strict=True)
        ),
        uncertainty="one run of 2 s each",
        verdict=verdict_of(climbed == [False, False, True, True] and slid[:2] == [True, True]),
        how="friction of the walls over weight / (3 preload) from 0.9 to 1.1 in a riser",
    )


def motor_droop(quick: bool) -> Claim:
    """The speed of climbing under its own weight."""
    robot = Presser()
    (run,) = runs_of(ELBOW, [_up()])
    speed = speed_of(run, 1.0)
    radius, gain = robot.wheel_radius, robot.motor_gain
    law = robot.speed - radius * robot.mass * GRAVITY * radius / (6 * gain)
    return Claim(
        id="presser_motor_droop",
        source="line of a direct-current motor",
        paper="v = r (w0 - m g r / 6 k)",
        statement="climbing speed within 1 % of it",
        measured=f"{1e3 * speed:.2f} against {1e3 * law:.2f} mm/s",
        uncertainty="fit over 1 s",
        verdict=verdict_of(abs(speed / law - 1) < 0.01),
        how="a riser of 160 mm",
    )


def bend(quick: bool) -> list[Claim]:
    """Wheel speeds in an elbow, as those of the geometry and with all wheels alike."""
    rolls = np.arange(0, 120, 60 if quick else 30)
    starts = [{"start.theta5_deg": float(roll)} for roll in rolls]
    controlled = runs_of(ELBOW, starts)
    equal = runs_of(ELBOW, ({**start, "control.kind": "own"} for start in starts))
    errors = [1e2 * _mean(_speed_error, runs) for runs in (controlled, equal)]
    energies = [_mean(_energy_a_metre, runs) for runs in (controlled, equal)]
    common: dict[str, Any] = {
        "uncertainty": f"{len(rolls)} start rolls",
        "sample": Sample.EVERY,
        "how": "presser_elbow, control.kind own",
    }
    return [
        Claim(
            id="presser_bend_speeds",
            source=f"{T_RO}: speeds of the driving wheels are modulated by the fitting's geometry",
            paper="v_i = v (R - r cos theta_i) / R",
            statement="wheels that are asked for these speeds roll at them, to 10 % of v",
            measured=f"{errors[0]:.1f} % root mean square; {errors[1]:.0f} % with all asked alike",
            verdict=verdict_of(errors[0] < 10.0),
            **common,
        ),
        Claim(
            id="presser_bend_energy",
            source=T_RO,
            paper="modulated speeds let it pass without wheels working against each other",
            statement="energy a metre of the bend at least 10 % below that of equal speeds",
            measured=f"{energies[0]:.1f} against {energies[1]:.1f} J/m",
            verdict=verdict_of(energies[0] < 0.9 * energies[1]),
            **common,
        ),
        all_pass(
            controlled,
            id="presser_elbows",
            source=T_RO,
            paper="adapts to most existing configurations of pipelines: elbows",
            statement="passes an elbow of 1.5 D upwards from every start roll",
            how="presser_elbow",
        ),
    ]


def _mean(value: Callable[[Result], float], runs: Sequence[Result]) -> float:
    return float(np.mean([value(run) for run in runs]))


def _in_bend(run: Result) -> NDArray[np.bool_]:
    """Samples (T,) in which both ends of the robot are in the elbow."""
    half, s = run.scenario.robot.wheelbase / 2, run.trajectory["distance"]
    return (s > INLET + half) & (s < INLET + np.pi / 2 * BEND - half)


def _speed_error(run: Result) -> float:
    """Root mean square of the wheels' speeds less those of the geometry, part of the robot's."""
    record, robot = run.trajectory, run.scenario.robot
    speed = np.gradient(record["distance"], record.time)
    sides = np.cos(record["theta5"][:, None] + ARMS)
    law = speed[:, None] * (1 - robot.bore / 2 / BEND * sides)
    error = record["actuator_velocity"] * robot.wheel_radius - np.tile(law, 2)
    inside = _in_bend(run)
    return float(np.sqrt(np.mean(error[inside] ** 2)) / speed[inside].mean())


def _energy_a_metre(run: Result) -> float:
    """Work of the motors in the elbow, J/m; what they brake is lost."""
    record, inside = run.trajectory, _in_bend(run)
    work = np.maximum(record["actuator_power"][inside], 0.0).sum() * np.diff(record.time)[0]
    return float(work / np.ptp(record["distance"][inside]))


def branch(quick: bool) -> list[Claim]:
    """The turn into a tee's branch, from random rolls and with random gravity."""
    rng = np.random.default_rng(7)
    starts = []
    for _ in range(1 if quick else 48):
        axis = [float(x) for x in rng.normal(size=3)]
        roll = float(rng.uniform(0, 120))
        starts.append({"pipes": BRANCH, "start.axis": axis, "start.theta5_deg": roll})
    runs = runs_of(ELBOW, ({**start, "run.time_limit": 40.0} for start in starts))
    passed, total, text = rate(runs)
    failed = total - passed
    low, high = wilson_interval(failed, total)
    how = "straight, tee into the branch, straight; random directions of gravity and start rolls"
    common: dict[str, Any] = {"uncertainty": "Wilson, 95 %", "how": how}
    return [
        Claim(
            id="presser_branch",
            measured=f"{text} pass",
            source=T_RO,
            paper="adapts to most existing configurations of pipelines: branches",
            statement="turns into the branch in over 90 % of the trials",
            verdict=verdict_of(passed > 0.9 * total),
            expected=ClaimVerdict.FAILS,
            why="An arm that faces the opening or the far wall's end has nothing to press on, and "
            "the two others do not turn a rigid hull round a corner of radius D/2.",
            sample=Sample.AVERAGE,
            **common,
        ),
        Claim(
            id="presser_branch_as_three_modules",
            measured=f"{rate_text(failed, total)} fail",
            source="Omnidirectional Tractable Three Module Robot, Section VI",
            paper="three modules that do not roll fail in a T-junction with a chance of 80.45 %",
            statement="80.45 % lies in the 95 % interval of its rate of failure",
            verdict=verdict_of(low <= 0.8045 <= high),
            note="That it is so near is chance as far as known: the arms carry wheels, not tracks.",
            sample=Sample.AVERAGE,
            **common,
        ),
    ]


MEASURES = (climb_limit, motor_droop, bend, branch)
"""Functions that measure the claims, in the order of the page."""
