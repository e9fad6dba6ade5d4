"""Claims about Modular Pipe Climber III, by the abstracts of arXiv 2112.02996 and 2108.08243."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np

from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Measurement,
    Sample,
    claim,
    largest,
    rate,
    runs_of,
    slip_of,
    study,
    varied,
)
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.climber import Climber
from omnitrack_sim.robots.omnitrack.kinematics import elbow_radii

ABSTRACT = "abstract of arXiv 2112.02996"
BEND = 0.24
"""Mean radius of the elbow, m: 1.5 bores."""
ELBOW = {"kind": "elbow", "mean_radius": BEND}
SLIP_LIMIT = 0.03
"""Slip of the tracks, as a part of their way, that counts as none."""
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
LENGTHS = 0.3, 0.35
"""Straights before and behind a fitting, m."""


def orientations(quick: bool) -> tuple[float, ...]:
    """Return angles of module 1 from the inside of the bend, degrees; others mirror these."""
    return (0.0, 40.0) if quick else (0.0, 20.0, 40.0, 60.0)


def _runs(
    fitting: dict[str, Any],
    changes: Iterable[dict[str, Any]],
    axis: tuple[float, float, float] = UP,
) -> list[Result]:
    """Runs through a fitting between two straights, at friction 0.8."""
    before, behind = ({"kind": "straight", "length": length} for length in LENGTHS)
    course = {"pipes": [before, fitting, behind], "start.axis": axis}
    return runs_of("robots/climber_elbow", ({**course, **change} for change in changes))


@cache  # claims share runs
def _elbow(quick: bool, drive: str, axis: tuple[float, float, float]) -> list[Result]:
    return _runs(
        ELBOW, ({**at(angle), "robot.drive": drive} for angle in orientations(quick)), axis
    )


def at(angle: float) -> dict[str, Any]:
    """Return the change of a scenario that puts module 1 at an angle, degrees."""
    return {"start.theta5_deg": angle}


def _slip(results: Sequence[Result]) -> tuple[float, str]:
    """Largest slip over the way of the three tracks, and a phrase of all of them."""
    parts = [slip_of(r) / (3 * r.metrics["distance_m"]) for r in results]  # type: ignore[operator]
    low, high = (100 * end for end in (min(parts), max(parts)))
    passed, total, _ = rate(results)
    return max(parts), f"{passed} of {total} pass, slip {low:.1f} to {high:.1f} %"


@claim(
    source=ABSTRACT,
    paper="eliminates slipping of the tracks at pipe turns, in any orientation of the robot",
    statement="climbing into an elbow of 1.5 bores it passes from every orientation, and the "
    f"tracks slip by less than {100 * SLIP_LIMIT:.0f} % of their way",
    how="climber; beside it robot.drive = three_motors; friction 0.8",
    sample=Sample.EVERY,
)
def no_slip_in_bends(quick: bool) -> Measurement:
    """No slip in a bend that is climbed into, against three equal tracks."""
    results = _elbow(quick, "differential", UP)
    worst, words = _slip(results)
    _, equal = _slip(_elbow(quick, "three_motors", UP))
    return Measurement(
        f"{words} of the way; three equal motors: {equal}",
        all(r.success for r in results) and worst < SLIP_LIMIT,
        uncertainty=f"{len(results)} orientations from 0 to 60 degrees",
    )


@claim(
    source="abstract of arXiv 2108.08243",
    paper="eliminating slip and drag in the robot tracks during motion",
    statement="as no_slip_in_bends, from a pipe in which it drives down",
    how="climber, start.axis down",
    expected=ClaimVerdict.FAILS,
    why="It leaves the bend with its weight on the lower wall. A module that then hardly "
    "touches takes no force, so that by equal forces its track races: a differential needs "
    "all three on the wall.",
    sample=Sample.EVERY,
)
def no_slip_driving_down(quick: bool) -> Measurement:
    """The same driven down into the bend."""
    results = _elbow(quick, "differential", DOWN)
    worst, words = _slip(results)
    return Measurement(
        f"driving down into the bend: {words}",
        all(r.success for r in results) and worst < SLIP_LIMIT,
        uncertainty=f"{len(results)} orientations from 0 to 60 degrees",
    )


@claim(
    source=ABSTRACT,
    paper="modulates the track speeds mechanically as it encounters the turns",
    statement="over the middle half of an elbow of 1.5 bores each track runs at (R - D/2 cos "
    "theta) / R of the mean speed, within {off:g}",
    limits={"off": 0.1},
    how="climber, belt_speed",
)
def bend_speeds(_quick: bool, off: float) -> Measurement:
    """Speeds of the tracks in the middle of the bend."""
    results = _elbow(True, "differential", UP)
    laws, speeds = [], []
    for result in results:
        trajectory, bend = result.trajectory, result.scenario.route.passages[1]
        part = (trajectory["distance"] - bend.s_enter) / (bend.s_leave - bend.s_enter)
        speed = trajectory["belt_speed"][(part > 0.25) & (part < 0.75)].mean(axis=0)
        theta5 = np.radians(result.scenario.start.theta5_deg)
        laws.append(elbow_radii(theta5, BEND, result.scenario.robot.nominal_bore / 2) / BEND)
        speeds.append(speed / speed.mean())
    error = float(np.abs(np.array(speeds) - laws).max())
    mean, law = (" ".join(f"{v:.2f}" for v in values[0]) for values in (speeds, laws))
    return Measurement(
        f"within {error:.3f}; theta5 = 0: {mean} by {law}",
        error < off,
        uncertainty="two runs, means over the middle half of the bend",
    )


@claim(
    source="title of arXiv 2112.02996",
    paper="Modular Pipe Climber",
    statement="climbs a vertical pipe within {percent:g} % of the speed that is asked of its motor",
    limits={"percent": 5},
    how="climber, straight, friction 0.8",
)
def climbs(_quick: bool, percent: float) -> Measurement:
    """The climb."""
    (result,) = _runs({"kind": "straight", "length": 0.3}, [{}])
    speed, asked = largest(result, "mean_speed_m_s"), result.scenario.control.cruise_speed
    return Measurement(
        f"{1e3 * speed:.1f} mm/s of {1e3 * asked:.0f}",
        result.success and abs(speed / asked - 1) < percent / 100,
    )


@study(
    source="nothing published",
    paper="what it does in a tee",
    statement="how many orientations pass a tee",
    how="climber, tee in a riser, friction 0.8",
    note="A module over the opening takes no force, so that by equal forces the others get "
    "none: its track races, and the robot stands, or falls into the opening.",
)
def tee(quick: bool) -> Measurement:
    """Claim: tees stop it."""
    angles = (0.0,) if quick else (-40.0, -20.0, 0.0, 20.0, 40.0, 60.0)
    parts = []
    for leave, words in (("run_end", "straight over"), ("branch", "into the branch")):
        fitting = {"kind": "tee", "enter": "run_start", "leave": leave}
        results = _runs(fitting, map(at, angles))
        passed, total, _ = rate(results)
        ends = sorted({r.outcome.value for r in results if not r.success})
        parts.append(f"{words} {passed} of {total}" + (f" ({', '.join(ends)})" if ends else ""))
    return Measurement(
        "; ".join(parts),
        uncertainty="one run an orientation",
    )


@study(
    source="nothing published",
    paper="sizes 0.7 and 1.4 times as large, in a climbed elbow",
    statement="what the elbow depends on: preload, stiffness, length of the tracks, clearance "
    "and mass, one at a time",
    how="climber, friction 0.8",
)
def assumed_sizes(quick: bool) -> Measurement:
    """The elbow with other sizes than those assumed."""
    names = ("preload", "spring_stiffness", "contact_length", "pitch_limit", "module_mass")
    cases = varied(Climber(), names[:1] if quick else names)
    results = _runs(ELBOW, ({**at(40.0), **case} for case in cases))
    _, words = _slip(results)
    return Measurement(
        f"{words} of the way",
        uncertainty="theta5 = 40 degrees, one run each",
    )


CLAIMS: tuple[Claim, ...] = (
    no_slip_in_bends,
    no_slip_driving_down,
    bend_speeds,
    climbs,
    tee,
    assumed_sizes,
)
"""In the order of the page."""
