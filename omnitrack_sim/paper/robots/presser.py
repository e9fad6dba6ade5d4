"""Claims on the wheeled wall-presser with three arms: MRINSPECT IV and SmartCrawler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Measurement,
    Sample,
    claim,
    difference,
    passes,
    rate,
    rate_text,
    runs_of,
    speed_of,
)
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.presser import ARMS, Presser
from omnitrack_sim.robots.size import GRAVITY

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


@claim(
    source="statics of three sprung arms",
    paper="3 preload friction = weight",
    statement="at 5 % more friction than that it climbs, at 5 % less it slides down",
    how="friction of the walls over weight / (3 preload) from 0.9 to 1.1 in a riser",
)
def presser_climb_limit(_quick: bool) -> Measurement:
    """The weight that three springs hold."""
    robot = Presser()
    weight, grip = robot.mass * GRAVITY, 3 * robot.preload
    parts = (0.9, 0.95, 1.05, 1.1)
    runs = runs_of(ELBOW, (_up(**{"world.friction": part * weight / grip}) for part in parts))
    ways = [float(np.ptp(r.trajectory["distance"][[0, -1]])) for r in runs]
    climbed = [r.trajectory["distance"][-1] > 0.65 for r in runs]
    slid = [r.trajectory["distance"][-1] < 0.59 for r in runs]
    return Measurement(
        ", ".join(
            f"{part:.2f} {'up' if up else 'down'} {1e3 * way:.0f} mm"
            for part, up, way in zip(parts, climbed, ways, strict=True)
        ),
        climbed == [False, False, True, True] and slid[:2] == [True, True],
        uncertainty="one run of 2 s each",
    )


@claim(
    source="line of a direct-current motor",
    paper="v = r (w0 - m g r / 6 k)",
    statement="climbing speed within {percent:g} % of it",
    limits={"percent": 1},
    how="a riser of 160 mm",
)
def presser_motor_droop(_quick: bool, percent: float) -> Measurement:
    """The speed of climbing under its own weight."""
    robot = Presser()
    (run,) = runs_of(ELBOW, [_up()])
    speed = speed_of(run, 1.0)
    radius, gain = robot.wheel_radius, robot.motor_gain
    law = robot.speed - radius * robot.mass * GRAVITY * radius / (6 * gain)
    return Measurement(
        f"{1e3 * speed:.2f} against {1e3 * law:.2f} mm/s",
        abs(speed / law - 1) < percent / 100,
        uncertainty="fit over 1 s",
    )


@cache  # claims share runs
def _bends(quick: bool, controller: str) -> list[Result]:
    """Return runs through an elbow from several start rolls."""
    rolls = np.arange(0, 120, 60 if quick else 15)
    kind = {} if controller == "default" else {"control.kind": controller}
    return runs_of(ELBOW, ({"start.theta5_deg": float(roll), **kind} for roll in rolls))


def _rolls(quick: bool) -> str:
    return f"{len(_bends(quick, 'default'))} start rolls"


@claim(
    source=f"{T_RO}: speeds of the driving wheels are modulated by the fitting's geometry",
    paper="v_i = v (R - r cos theta_i) / R",
    statement="wheels that are asked for these speeds roll at them, to {percent:g} % of v",
    limits={"percent": 10},
    how="presser_elbow, control.kind own",
    sample=Sample.EVERY,
)
def presser_bend_speeds(quick: bool, percent: float) -> Measurement:
    """Compare wheel speeds in an elbow with those of the geometry."""
    asked, equal = (1e2 * _mean(_speed_error, _bends(quick, kind)) for kind in ("default", "own"))
    return Measurement(
        f"{asked:.1f} % root mean square; {equal:.0f} % with all asked alike",
        asked < percent,
        uncertainty=_rolls(quick),
    )


@claim(
    source=T_RO,
    paper="modulated speeds let it pass without wheels working against each other",
    statement="energy a metre of the bend at least {percent:g} % below that of equal speeds",
    limits={"percent": 10},
    how="presser_elbow, control.kind own",
    sample=Sample.AVERAGE,
)
def presser_bend_energy(quick: bool, percent: float) -> Measurement:
    """Compare the work of the motors in an elbow with that at equal speeds."""
    asked, equal = ([_energy_a_metre(r) for r in _bends(quick, k)] for k in ("default", "own"))
    saved = difference(100 * (1 - np.array(asked) / equal), np.full(len(asked), float(percent)))
    return Measurement(
        f"{np.mean(asked):.1f} against {np.mean(equal):.1f} J/m; {saved.first:.0f} % below, than "
        f"{percent:g} % {saved.gain()}",
        saved.over(),
        uncertainty=f"Student's t, {_rolls(quick)}",
    )


@claim(
    source=T_RO,
    paper="adapts to most existing configurations of pipelines: elbows",
    statement="passes an elbow of 1.5 D upwards from every start roll",
    how="presser_elbow",
    sample=Sample.EVERY,
)
def presser_elbows(quick: bool) -> Measurement:
    """Pass an elbow from every start roll."""
    return passes(_bends(quick, "default"))


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


@cache  # claims share runs
def _branches(quick: bool) -> tuple[int, int, str]:
    """Return how many turns into a branch pass, of how many, and both as text."""
    rng = np.random.default_rng(7)
    starts = []
    for _ in range(1 if quick else 48):
        axis = [float(x) for x in rng.normal(size=3)]
        roll = float(rng.uniform(0, 120))
        starts.append({"pipes": BRANCH, "start.axis": axis, "start.theta5_deg": roll})
    return rate(runs_of(ELBOW, ({**start, "run.time_limit": 40.0} for start in starts)))


BRANCHES = "straight, tee into the branch, straight; random directions of gravity and start rolls"


@claim(
    source=T_RO,
    paper="adapts to most existing configurations of pipelines: branches",
    statement="turns into the branch in over {percent:g} % of the trials",
    limits={"percent": 90},
    how=BRANCHES,
    expected=ClaimVerdict.FAILS,
    why="An arm that faces the opening or the far wall's end has nothing to press on, and "
    "the two others do not turn a rigid hull round a corner of radius D/2.",
    sample=Sample.AVERAGE,
)
def presser_branch(quick: bool, percent: float) -> Measurement:
    """Turn into a tee's branch, from random rolls and with random gravity."""
    passed, total, text = _branches(quick)
    return Measurement(f"{text} pass", 100 * passed > percent * total, uncertainty="Wilson, 95 %")


@claim(
    source="Omnidirectional Tractable Three Module Robot, Section VI",
    paper="three modules that do not roll fail in a T-junction with a chance of 80.45 %",
    statement="{percent:g} % lies in the 95 % interval of its rate of failure",
    limits={"percent": 80.45},
    how=BRANCHES,
    note="That it is so near is chance as far as known: the arms carry wheels, not tracks.",
    sample=Sample.AVERAGE,
)
def presser_branch_as_three_modules(quick: bool, percent: float) -> Measurement:
    """Compare the rate of failure with that of three modules that do not roll."""
    passed, total, _ = _branches(quick)
    low, high = wilson_interval(total - passed, total)
    return Measurement(
        f"{rate_text(total - passed, total)} fail",
        low <= percent / 100 <= high,
        uncertainty="Wilson, 95 %",
    )


CLAIMS: tuple[Claim, ...] = (
    presser_climb_limit,
    presser_motor_droop,
    presser_bend_speeds,
    presser_bend_energy,
    presser_elbows,
    presser_branch,
    presser_branch_as_three_modules,
)
"""In the order of the page."""
