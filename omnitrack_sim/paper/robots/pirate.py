"""Claims on PIRATE, the planar chain of the University of Twente."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Sample,
    all_pass,
    alone,
    rate,
    runs_of,
    speed_of,
    study,
    verdict_of,
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


def speed(quick: bool) -> Claim:
    """The speed without load."""
    straight = {"pipes": [_straight(1.5)], "start.axis": LEVEL, "run.time_limit": 3.0}
    (run,) = runs_of(ELBOW, [straight])
    speed = speed_of(run, 1.0)
    return Claim(
        id="pirate_speed",
        source=CABLE,
        paper="80 mm/s",
        statement="speed on the level within 1 %, of wheels that are asked for it",
        measured=f"{1e3 * speed:.2f} mm/s",
        uncertainty="fit over the run after 1 s",
        verdict=verdict_of(abs(speed / 0.08 - 1) < 0.01),
        how="a level straight of 100 mm",
    )


def clamp_forces(robot: Pirate, friction: float) -> Array:
    """Return the pull and the normal forces (7,) N of its wheels, tail to nose, when all of them
    are about to slip, without weight.

    Traction acts at the walls and bends the V's: it takes force from the clamp that a wheel runs
    ahead of and gives it to the other. Each line below is a sum of moments of what hangs on a
    joint, about that joint, which is the clamping torque at the apexes and nothing at the ends of
    the middle link; the last three are the balance of the whole robot.

    Args:
        robot: in its bore.
        friction: Coulomb coefficient.
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


def pull_law(quick: bool) -> Claim:
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
    return Claim(
        id="pirate_pull_law",
        source="statics of the clamped chain",
        paper="pull from clamping torque, friction and bore, with traction's moments",
        statement="force at the tail at which it stops within 15 % of it",
        measured=f"{100 * errors.min():+.0f} to {100 * errors.max():+.0f} %; 8 mu T / (L cos a), "
        f"without these moments, is {max(np.array(simple) / held):.1f} times too large",
        uncertainty=f"{len(cases)} cases, force grows by 8 N/s",
        verdict=verdict_of(bool((np.abs(errors) < 0.15).all())),
        sample=Sample.EVERY,
        how="bores of 51 and 80 mm, friction 0.4 and 0.8, without gravity",
    )


def _held(run: Result) -> float:
    return float(run.metrics["pull_held_n"])  # type: ignore[arg-type]


def pull(quick: bool) -> list[Claim]:
    """The published pull, and that it is less in a bend."""
    straight = {"pipes": [_straight(1.5)], "start.axis": LEVEL}
    (run,) = runs_of(ELBOW, [{**straight, "pull.force": 10.0, "pull.rate": 1.0}])
    (bend,) = runs_of(ELBOW, [{"start.axis": LEVEL, "pull.force": 13.0}])
    return [
        Claim(
            id="pirate_pull",
            source=CABLE,
            paper="pulls with 14 N",
            statement="pull on the level at friction 0.8 within 0.5 N, by the clamping torque",
            measured=f"{_held(run):.1f} N",
            uncertainty="force grows by 1 N/s",
            verdict=ClaimVerdict.CALIBRATED,
            expected=ClaimVerdict.CALIBRATED,
            how="a level straight of 100 mm",
        ),
        Claim(
            id="pirate_pull_in_bends",
            source=CABLE,
            paper="not always capable of 14 N, for instance in a bend",
            statement="13 N, which it pulls in a straight, stop it in an elbow of 1.5 D",
            measured=f"{bend.outcome.value} with 13 N",
            verdict=verdict_of(_held(run) > 13.0 and not bend.success),
            how="pirate_elbow, level",
        ),
    ]


def bores(quick: bool) -> Claim:
    """Bores, by an elbow of each."""
    sizes = (0.051,) if quick else (0.051, 0.08, 0.12)
    elbows = ({"kind": "elbow", "mean_radius": 1.5 * bore} for bore in sizes)
    changes = (_between(elbow, bore=bore) for elbow, bore in zip(elbows, sizes, strict=True))
    return all_pass(
        alone(ELBOW, changes),
        id="pirate_bores",
        source=CABLE,
        paper="networks of 51 to 120 mm",
        statement="climbs, and passes an elbow of 1.5 D, in bores of 51, 80 and 120 mm",
        how="pirate_elbow in each bore",
    )


def corners(quick: bool) -> Claim:
    """Sharp bends in its plane."""
    fittings = [{"kind": "elbow", "mean_radius": 0.06}, {"kind": "mitre"}]
    tried = fittings[1:] if quick else fittings
    return all_pass(
        alone(ELBOW, map(_between, tried)),
        id="pirate_corners",
        source="RAM, University of Twente: assignment on sharp pipe corners, page of the group",
        paper="goes through sharp corners",
        statement="passes, upwards, an elbow of 0.6 D and a mitre bend of 90 degrees in its plane",
        how="pirate_elbow with these",
    )


def branch(quick: bool) -> list[Claim]:
    """Turns into a branch."""
    rng = np.random.default_rng(7)
    tee = _between({"kind": "tee", "enter": "run_start", "leave": "branch"})
    rolls = rng.uniform(-180, 180, 1 if quick else 20)
    starts = [{**tee, "start.theta5_deg": float(roll)} for roll in rolls]
    runs = runs_of(ELBOW, starts)
    free = runs_of(
        ELBOW, ({**start, "start.axis": rng.normal(size=3).tolist()} for start in starts)
    )
    return [
        all_pass(
            runs,
            id="pirate_branch",
            source="RAM, University of Twente: MSc assignment of 2021, page of the group",
            paper="navigation through T-junctions",
            statement="turns from a riser into a level branch, whatever its roll before",
            how="straight, tee into the branch, straight; random rolls",
        ),
        study(
            id="pirate_branch_any_gravity",
            source="this simulation",
            paper="not stated: the same turn with any direction of gravity",
            statement="how often it turns",
            measured=rate(free)[2],
            uncertainty="Wilson, 95 %",
            note="Where gravity draws it down the run it falls past the branch: neither end is "
            "clamped while it bends.",
            how="the same with random directions of gravity",
        ),
    ]


MEASURES = (speed, pull_law, pull, bores, corners, branch)
"""Functions that measure the claims, in the order of the page."""
