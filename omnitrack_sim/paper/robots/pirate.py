"""Claims on PIRATE, the planar chain of the University of Twente."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Measurement,
    Sample,
    alone,
    claim,
    passes,
    rate,
    runs_of,
    speed_of,
    study,
)
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.pirate import CABLE, FRONT, REAR, SIDES, Pirate

ELBOW = "robots/pirate_elbow"
LEVEL, UP = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
WEIGHTLESS = {"world.gravity": [0.0, 0.0, 0.0]}
STRONG = {"robot.torque_limit": 1.0, "robot.motor_gain": 0.3, "robot.joint_torque": 3.0}
"""Motors that do not limit the pull; the joints' servos are soft, so that their torque stays."""


def _straight(length: float, bore: float = 0.1) -> dict[str, Any]:
    return {"kind": "straight", "length": length, "inner_diameter": bore}


def _between(*fitting: dict[str, Any], bore: float = 0.1) -> dict[str, Any]:
    """Changes for a course through a fitting between two straights."""
    middle = [{"inner_diameter": bore, **part} for part in fitting]
    return {"pipes": [_straight(0.6, bore), *middle, _straight(0.6, bore)], "robot.bore": bore}


@claim(
    source=CABLE,
    paper="80 mm/s",
    statement="speed on the level within {percent:g} %, of wheels that are asked for it",
    limits={"percent": 1},
    how="a level straight of 100 mm",
)
def pirate_speed(_quick: bool, percent: float) -> Measurement:
    """The speed without load."""
    straight = {"pipes": [_straight(1.5)], "start.axis": LEVEL, "run.time_limit": 3.0}
    (run,) = runs_of(ELBOW, [straight])
    speed = speed_of(run, 1.0)
    return Measurement(
        f"{1e3 * speed:.2f} mm/s",
        abs(speed / 0.08 - 1) < percent / 100,
        uncertainty="fit over the run after 1 s",
    )


def clamp_forces(robot: Pirate, friction: float) -> Array:
    """Return the pull and the normal forces when all wheels are about to slip, without weight.

    Traction acts at the walls and bends the V's: it takes force from the clamp that a wheel runs
    ahead of and gives it to the other. Each line below is a sum of moments of what hangs on a
    joint, about that joint, which is the clamping torque at the apexes and nothing at the ends of
    the middle link; the last three are the balance of the whole robot.

    Args:
        robot: in its bore.
        friction: Coulomb coefficient.

    Returns:
        (7,) N: the pull, and the normal forces of the wheels from tail to nose.
    """
    along = robot.link * math.cos(robot.slope)
    z = np.cumsum([0.0, along, along, robot.link, along, along])
    x = robot.reach * SIDES
    walls = (robot.reach + robot.wheel_radius) * SIDES

    def moments(about: int, of: range) -> Array:
        """About a node, of a unit pull at the tail and unit normal forces of nodes."""
        lever = -SIDES * (z - z[about]) - friction * (walls - x[about])
        hangs = np.isin(np.arange(6), of)
        pull = x[0] - x[about] if 0 in of else 0.0
        return np.array([pull, *np.where(hangs, lever, 0.0)])

    rows = [
        *(moments(FRONT + 1, range(5, 6)), moments(FRONT, range(4, 6))),
        *(moments(REAR - 1, range(1)), moments(REAR, range(2)), moments(REAR, range(6))),
        np.array([-1.0, *np.full(6, friction)]),
        np.array([0.0, *SIDES]),
    ]
    torque = robot.clamp_torque
    loads = np.array([torque, 0.0, -torque, 0.0, 0.0, 0.0, 0.0])
    return np.linalg.solve(np.array(rows), loads)


@claim(
    source="statics of the clamped chain",
    paper="pull from clamping torque, friction and bore, with traction's moments",
    statement="force at the tail at which it stops within {percent:g} % of it",
    limits={"percent": 15},
    how="bores of 51 and 80 mm, friction 0.4 and 0.8, without gravity",
    sample=Sample.EVERY,
)
def pirate_pull_law(quick: bool, percent: float) -> Measurement:
    """The pull at the tail against the clamping torque."""
    cases = [(bore, mu, t) for bore in (0.051, 0.08) for mu, t in ((0.4, 0.4), (0.8, 0.3))]
    cases = cases[1:2] if quick else cases
    changes = [
        {"pipes": [_straight(1.5, bore)], "robot.bore": bore, "world.friction": mu}
        | {"robot.clamp_torque": torque, "robot.joint_stiffness": 0.2, "start.axis": LEVEL}
        | {"pull.rate": 8.0, **WEIGHTLESS, **STRONG}
        for bore, mu, torque in cases
    ]
    held = [_held(run) for run in alone(ELBOW, changes)]
    laws = [clamp_forces(Pirate(bore=b, clamp_torque=t), mu)[0] for b, mu, t in cases]
    simple = [Pirate(bore=b, clamp_torque=t).pull(mu) for b, mu, t in cases]
    errors = np.array(held) / laws - 1
    return Measurement(
        f"{100 * errors.min():+.0f} to {100 * errors.max():+.0f} %; 8 mu T / (L cos a), "
        f"without these moments, is {max(np.array(simple) / held):.1f} times too large",
        bool((100 * np.abs(errors) < percent).all()),
        uncertainty=f"{len(cases)} cases, force grows by 8 N/s",
    )


def _held(run: Result) -> float:
    return float(run.metrics["pull_held_n"])  # type: ignore[arg-type]


@cache  # claims share the run
def _pulls(_quick: bool) -> float:
    """Return the pull in a level straight, N, of a force that grows by 1 N/s."""
    straight = {"pipes": [_straight(1.5)], "start.axis": LEVEL}
    (run,) = runs_of(ELBOW, [{**straight, "pull.force": 10.0, "pull.rate": 1.0}])
    return _held(run)


@claim(
    source=CABLE,
    paper="pulls with 14 N",
    statement="pull on the level at friction 0.8 within {off:g} N, by the clamping torque",
    limits={"off": 0.5},
    how="a level straight of 100 mm",
    expected=ClaimVerdict.CALIBRATED,
)
def pirate_pull(quick: bool, off: float) -> Measurement:
    """Compare the published pull, by which the clamping torque was chosen."""
    pull = _pulls(quick)
    return Measurement(
        f"{pull:.1f} N",
        abs(pull - 14.0) <= off,
        uncertainty="force grows by 1 N/s",
        calibrated=True,
    )


@claim(
    source=CABLE,
    paper="not always capable of 14 N, for instance in a bend",
    statement="{force:g} N, which it pulls in a straight, stop it in an elbow of 1.5 D",
    limits={"force": 13},
    how="pirate_elbow, level",
)
def pirate_pull_in_bends(quick: bool, force: float) -> Measurement:
    """Let it pull in an elbow what it pulls in a straight."""
    (bend,) = runs_of(ELBOW, [{"start.axis": LEVEL, "pull.force": float(force)}])
    return Measurement(
        f"{bend.outcome.value} with {force:g} N", _pulls(quick) > force and not bend.success
    )


@claim(
    source=CABLE,
    paper="networks of 51 to 120 mm",
    statement="climbs, and passes an elbow of 1.5 D, in bores of 51, 80 and 120 mm",
    how="pirate_elbow in each bore",
    sample=Sample.EVERY,
)
def pirate_bores(quick: bool) -> Measurement:
    """Bores, by an elbow of each."""
    sizes = (0.051,) if quick else (0.051, 0.08, 0.12)
    elbows = ({"kind": "elbow", "mean_radius": 1.5 * bore} for bore in sizes)
    changes = (_between(elbow, bore=bore) for elbow, bore in zip(elbows, sizes, strict=True))
    return passes(alone(ELBOW, changes))


@claim(
    source="RAM, University of Twente: assignment on sharp pipe corners, page of the group",
    paper="goes through sharp corners",
    statement="passes, upwards, an elbow of 0.6 D and a mitre bend of 90 degrees in its plane",
    how="pirate_elbow with these",
    sample=Sample.EVERY,
)
def pirate_corners(quick: bool) -> Measurement:
    """Sharp bends in its plane."""
    fittings = [{"kind": "elbow", "mean_radius": 0.06}, {"kind": "mitre"}]
    tried = fittings[1:] if quick else fittings
    return passes(alone(ELBOW, map(_between, tried)))


def _turns(quick: bool, any_gravity: bool) -> list[Result]:
    """Return turns into a branch from random rolls."""
    rng = np.random.default_rng(7)
    tee = _between({"kind": "tee", "enter": "run_start", "leave": "branch"})
    rolls = rng.uniform(-180, 180, 20)
    starts = [{**tee, "start.theta5_deg": float(roll)} for roll in rolls]
    if any_gravity:
        starts = [{**start, "start.axis": rng.normal(size=3).tolist()} for start in starts]
    return runs_of(ELBOW, starts[:1] if quick else starts)


@claim(
    source="RAM, University of Twente: MSc assignment of 2021, page of the group",
    paper="navigation through T-junctions",
    statement="turns from a riser into a level branch, whatever its roll before",
    how="straight, tee into the branch, straight; random rolls",
    sample=Sample.EVERY,
)
def pirate_branch(quick: bool) -> Measurement:
    """Turn from a riser into a level branch."""
    return passes(_turns(quick, any_gravity=False))


@study(
    source="this simulation",
    paper="not stated: the same turn with any direction of gravity",
    statement="how often it turns",
    how="the same with random directions of gravity",
    note="Where gravity draws it down the run it falls past the branch: neither end is "
    "clamped while it bends.",
)
def pirate_branch_any_gravity(quick: bool) -> Measurement:
    """Turn with any direction of gravity."""
    return Measurement(rate(_turns(quick, any_gravity=True))[2], uncertainty="Wilson, 95 %")


CLAIMS: tuple[Claim, ...] = (
    pirate_speed,
    pirate_pull_law,
    pirate_pull,
    pirate_pull_in_bends,
    pirate_bores,
    pirate_corners,
    pirate_branch,
    pirate_branch_any_gravity,
)
"""In the order of the page."""
