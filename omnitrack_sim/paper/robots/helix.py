"""Claims on the snake of Carnegie Mellon that rolls as a helix."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.paper.claim import (
    Claim,
    Measurement,
    Sample,
    alone,
    claim,
    difference,
    rate,
    runs_of,
    speed_of,
    study,
)
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.helix import JOINTS

ENNER = "Enner, Rollinson and Choset, Motion Estimation of Snake Robots in Straight Pipes, abstract"
ELBOW = "robots/helix_elbow"
LEVEL, UP, DOWN = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
SETTLED = 2.0
"""After which the gait is looked at, s."""


def _straight(bore: float, axis: list[float], **changes: Any) -> dict[str, Any]:
    """Changes for a short run in a straight."""
    pipes = [{"kind": "straight", "length": 1.5, "inner_diameter": bore}]
    return {"pipes": pipes, "start.axis": axis, "run.time_limit": 5.0} | changes


def _angles(run: Result) -> Array:
    """Joint angles (T, 16) rad of a run, once the gait has settled."""
    columns = [run.joints[f"joint_{k}"].start for k in range(JOINTS)]
    return run.qpos[run.trajectory.time > SETTLED][:, columns]


def _estimated_speed(run: Result) -> float:
    """Speed, m/s, from joint angles alone."""
    angles, period = _angles(run), float(np.diff(run.trajectory.time)[0])
    ways = [run.scenario.robot.advance(*angles[i : i + 2]) for i in range(0, len(angles) - 1, 5)]
    return float(np.mean(ways)) / period


def _estimated_bore(run: Result) -> float:
    """Bore, m, from joint angles alone."""
    robot = run.scenario.robot
    return float(np.mean([robot.pipe_bore(robot.coil(a)) for a in _angles(run)[::10]]))


def _smooth_speed(run: Result) -> float:
    """Speed, m/s, of a smooth helix of the same shape."""
    robot = run.scenario.robot
    return float(np.mean([robot.rolling_speed(robot.coil(a)) for a in _angles(run)[::10]]))


@cache  # claims share runs
def _gaits(quick: bool) -> list[Result]:
    """Return runs on the level, by gait."""
    gaits = [{}, {"robot.rate": 1.0}, {"robot.amplitude": 0.95}][: 1 if quick else 3]
    return alone(ELBOW, (_straight(0.16, LEVEL, **gait) for gait in gaits))


def _speeds(runs: Sequence[Result]) -> Array:
    """Return the speeds of runs once the gait has settled, m/s."""
    return np.array([speed_of(run, SETTLED) for run in runs])


def _compared(quick: bool) -> str:
    return "one gait" if quick else "all three gaits"


@claim(
    source=ENNER,
    paper="its motion follows from joint angles alone",
    statement="speed on the level within {percent:g} % of that at which modules roll that touch",
    limits={"percent": 5},
    how="a level straight of 160 mm",
    sample=Sample.EVERY,
)
def helix_speed(quick: bool, percent: float) -> Measurement:
    """Compare the speed with that of joint angles, by the law of rolling modules."""
    runs = _gaits(quick)
    laws, speeds = [_estimated_speed(run) for run in runs], _speeds(runs)
    errors = 100 * (speeds / laws - 1)
    return Measurement(
        f"{1e3 * speeds[0]:.1f} by {1e3 * laws[0]:.1f} mm/s; {_compared(quick)} "
        f"{errors.min():+.0f} to {errors.max():+.0f} %",
        bool((np.abs(errors) < percent).all()),
        uncertainty="w of 2 and 1 rad/s, A of 0.85 and 0.95 rad",
    )


@claim(
    source="a smooth helix that rolls",
    paper="v = w (a + d) cos(lead), from phase rate and geometry",
    statement="speed on the level within {percent:g} % of it",
    limits={"percent": 10},
    how="a level straight of 160 mm",
    sample=Sample.EVERY,
)
def helix_smooth_speed(quick: bool, percent: float) -> Measurement:
    """Compare the speed with that of a smooth helix."""
    runs = _gaits(quick)
    errors = 100 * (_speeds(runs) / [_smooth_speed(run) for run in runs] - 1)
    return Measurement(
        f"{errors.min():+.0f} to {errors.max():+.0f} %",
        bool((np.abs(errors) < percent).all()),
        uncertainty=_compared(quick),
    )


@claim(
    source=ENNER,
    paper="traverses the inside of pipes",
    statement="climbs, by more than {percent:g} % of its speed downwards",
    limits={"percent": 80},
    how="a riser of 160 mm; rolls and frictions of 0.6 to 1 by lot",
)
def helix_climb(_quick: bool, percent: float) -> Measurement:
    """Compare the speed upwards with that downwards."""
    rng = np.random.default_rng(7)
    draws = [
        {
            "start.theta5_deg": float(rng.uniform(0, 360)),
            "world.friction": float(rng.uniform(0.6, 1.0)),
        }
        for _ in range(3)
    ]
    up, down = (
        1e3 * _speeds(runs_of(ELBOW, (_straight(0.16, way, **draw) for draw in draws)))
        for way in (UP, DOWN)
    )
    faster = difference(up, percent / 100 * down)
    return Measurement(
        f"up {up.mean():.1f}, down {down.mean():.1f} mm/s; than {percent:g} % of it "
        f"{faster.gain(1)}",
        faster.over(),
        uncertainty=f"Student's t, {len(draws)} draws",
    )


@claim(
    source=ENNER,
    paper="accurately estimates the diameter of the pipe from joint angles",
    statement="mean over 3 s within {percent:g} % of the bore",
    limits={"percent": 1},
    how="risers of three bores, the gait of 160 mm",
    sample=Sample.EVERY,
)
def helix_bore(quick: bool, percent: float) -> Measurement:
    """The pipe's diameter from joint angles."""
    bores = (0.155,) if quick else (0.155, 0.16, 0.165)
    runs = alone(ELBOW, (_straight(bore, UP) for bore in bores))
    estimates = [_estimated_bore(run) for run in runs]
    errors = np.array(estimates) / bores - 1
    return Measurement(
        ", ".join(
            f"{1e3 * estimate:.1f} for {1e3 * bore:.0f}"
            for estimate, bore in zip(estimates, bores, strict=True)
        )
        + " mm",
        bool((100 * np.abs(errors) < percent).all()),
        uncertainty="one run each",
    )


@study(
    source="this simulation",
    paper="not stated: elbows and tees by the gait of straights",
    statement="how often it passes an elbow of 1.5 D, and a tee straight over",
    how="helix_elbow and helix_tee, random rolls and directions of gravity",
)
def helix_fittings(quick: bool) -> Measurement:
    """Claim: fittings that it passes."""
    rng = np.random.default_rng(7)
    starts = [
        {"start.theta5_deg": float(rng.uniform(0, 360)), "start.axis": rng.normal(size=3).tolist()}
        for _ in range(1 if quick else 8)
    ]
    names = ("elbow",) if quick else ("elbow", "tee")
    rates = [f"{name}s {rate(runs_of(f'robots/helix_{name}', starts))[2]}" for name in names]
    return Measurement(
        "; ".join(rates),
        uncertainty="Wilson, 95 %",
    )


CLAIMS: tuple[Claim, ...] = (
    helix_speed,
    helix_smooth_speed,
    helix_climb,
    helix_bore,
    helix_fittings,
)
"""In the order of the page."""
