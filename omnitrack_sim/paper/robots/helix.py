"""Claims on the snake of Carnegie Mellon that rolls as a helix."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.paper.claim import (
    Claim,
    Sample,
    alone,
    rate,
    runs_of,
    speed_of,
    study,
    verdict_of,
)
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.helix import JOINTS

ENNER = "Enner, Rollinson and Choset, Motion Estimation of Snake Robots in Straight Pipes, abstract"
ELBOW = "robots/helix_elbow"
LEVEL, UP = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
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


def speed(quick: bool) -> list[Claim]:
    """Speed along the pipe from phase rate and geometry, and up against down."""
    gaits = [{}, {"robot.rate": 1.0}, {"robot.amplitude": 0.95}][: 1 if quick else 3]
    compared = "one gait" if quick else "all three gaits"
    runs = alone(ELBOW, (_straight(0.16, LEVEL, **gait) for gait in gaits))
    laws = [_estimated_speed(run) for run in runs]
    speeds = np.array([speed_of(run, SETTLED) for run in runs])
    errors, rough = speeds / laws - 1, speeds / [_smooth_speed(run) for run in runs] - 1
    climbs = alone(ELBOW, (_straight(0.16, way) for way in (UP, [0.0, 0.0, -1.0])))
    loaded = [speed_of(run, SETTLED) for run in climbs]
    return [
        Claim(
            id="helix_speed",
            source=ENNER,
            paper="its motion follows from joint angles alone",
            statement="speed on the level within 5 % of that at which modules roll that touch",
            measured=f"{1e3 * speeds[0]:.1f} by {1e3 * laws[0]:.1f} mm/s; {compared} "
            f"{100 * errors.min():+.0f} to {100 * errors.max():+.0f} %",
            uncertainty="w of 2 and 1 rad/s, A of 0.85 and 0.95 rad",
            verdict=verdict_of(bool((np.abs(errors) < 0.05).all())),
            sample=Sample.EVERY,
            how="a level straight of 160 mm",
        ),
        Claim(
            id="helix_smooth_speed",
            source="a smooth helix that rolls",
            paper="v = w (a + d) cos(lead), from phase rate and geometry",
            statement="speed on the level within 10 % of it",
            measured=f"{100 * rough.min():+.0f} to {100 * rough.max():+.0f} %",
            uncertainty=compared,
            verdict=verdict_of(bool((np.abs(rough) < 0.1).all())),
            sample=Sample.EVERY,
            how="a level straight of 160 mm",
        ),
        Claim(
            id="helix_climb",
            source=ENNER,
            paper="traverses the inside of pipes",
            statement="climbs, by more than 80 % of its speed downwards",
            measured=f"up {1e3 * loaded[0]:.1f}, down {1e3 * loaded[1]:.1f} mm/s",
            verdict=verdict_of(loaded[0] > 0.8 * loaded[1]),
            how="a riser of 160 mm",
        ),
    ]


def pipe_bore(quick: bool) -> Claim:
    """The pipe's diameter from joint angles."""
    bores = (0.155,) if quick else (0.155, 0.16, 0.165)
    runs = alone(ELBOW, (_straight(bore, UP) for bore in bores))
    estimates = [_estimated_bore(run) for run in runs]
    errors = np.array(estimates) / bores - 1
    return Claim(
        id="helix_bore",
        source=ENNER,
        paper="accurately estimates the diameter of the pipe from joint angles",
        statement="mean over 3 s within 1 % of the bore",
        measured=", ".join(
            f"{1e3 * estimate:.1f} for {1e3 * bore:.0f}"
            for estimate, bore in zip(estimates, bores, strict=True)
        )
        + " mm",
        uncertainty="one run each",
        verdict=verdict_of(bool((np.abs(errors) < 0.01).all())),
        sample=Sample.EVERY,
        how="risers of three bores, the gait of 160 mm",
    )


def fittings(quick: bool) -> Claim:
    """Claim: fittings that it passes."""
    rng = np.random.default_rng(7)
    starts = [
        {"start.theta5_deg": float(rng.uniform(0, 360)), "start.axis": rng.normal(size=3).tolist()}
        for _ in range(1 if quick else 8)
    ]
    names = ("elbow",) if quick else ("elbow", "tee")
    rates = [f"{name}s {rate(runs_of(f'robots/helix_{name}', starts))[2]}" for name in names]
    return study(
        id="helix_fittings",
        source="this simulation",
        paper="not stated: elbows and tees by the gait of straights",
        statement="how often it passes an elbow of 1.5 D, and a tee straight over",
        measured="; ".join(rates),
        uncertainty="Wilson, 95 %",
        how="helix_elbow and helix_tee, random rolls and directions of gravity",
    )


MEASURES = (speed, pipe_bore, fittings)
"""Functions that measure the claims, in the order of the page."""
