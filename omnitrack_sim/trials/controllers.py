"""Suite ``control``: controllers and policies of the package's own robot, through the same trials.

The seeds of the courses are for nothing else: neither the controllers nor the shipped studies have
used them, and whoever trains a policy keeps away from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import installed, shipped_files
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.robots.control import controller_of
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack
from omnitrack_sim.robots.omnitrack.policy.file import load_policy
from omnitrack_sim.scenario import Scenario, load_scenario, validate
from omnitrack_sim.trials.axes import Axis, DirectionAxis, UniformAxis
from omnitrack_sim.trials.bench import BenchMeasure, Changes, Course, Entry, Suite
from omnitrack_sim.trials.sweep import Sweep

DEFAULT = "feedback"
"""The entry that all others are compared with."""
# The values before commit aa5bc0e and sway, where they are parameters.
_BEFORE = {
    "robot.motor.speed_bandwidth": 50.0,
    "robot.motor.speed_droop": 0.0,
    "control.parameters.tracking.turn_speed": 1.0,
    "control.parameters.tracking.slip_lead": 0.0,
    "control.parameters.tracking.upward_lead": 0.0,
    "control.parameters.tracking.upward_gain": 40.0,
    "control.parameters.tracking.upward_rotation_limit": 15.0,
    "control.parameters.tracking.upward_speed": 0.0,
    "control.parameters.tracking.retry_speed": 0.0,
    "control.parameters.recovery.upright": 1e3,
    "control.parameters.damping.tee_turn": 5.0,
    "control.parameters.damping.tee_straight": 2.5,
    "control.parameters.sway.lean_deg": 0.0,
    "control.parameters.sway.begin_again": 1e6,
    "control.parameters.alignment.aside_tee_turn": [0.0, 0.0, 0.0],
}
_SHIPPED = (
    Entry(DEFAULT, "the default controller: feedback on the heading, gentle drive, sway"),
    Entry("earlier", "the same before gentle drive, sway and rolling aside", _BEFORE),
    Entry("equal", "all modules at cruise speed", {"control.kind": "equal"}),
    Entry(
        "as_written",
        "the paper's speeds, open loop: Eq. 20 in elbows, inner module backward in tees",
        {"control.kind": "paper"},
    ),
    Entry(
        "eq20",
        "Eq. 20 in every turn, open loop; a tee is taken for an elbow",
        {"control.kind": "eq20"},
    ),
    Entry("differential", "one motor and a differential", {"robot.drive": "differential"}),
)


def shipped_entries() -> dict[str, Entry]:
    """Return the shipped entries and policies by name, the default one first."""
    entries = {entry.name: entry for entry in _SHIPPED}
    return entries | {name: _of_policy(name, name) for name in shipped_files("policies")}


def entry_of(robot: str, source: str) -> Entry:
    """Return the entry for a controller.

    Args:
        robot: none: this suite is for the package's own robot.
        source: name of a shipped entry, a kind of controller, ``module:Object``, or the path of a
            policy file; ``NAME=`` before it gives it another name.

    Raises:
        InputError: there is no such thing, or it cannot be used.
    """
    if robot:
        raise InputError(Fault("--robot", "is for the suite mobility; give --controller alone"))
    name, is_renamed, what = source.rpartition("=")
    shipped = shipped_entries()
    if what in shipped:
        entry = shipped[what]
    elif what.endswith(".npz"):
        entry = _of_policy(Path(what).stem, what)
    else:
        entry = _of_controller(what, tuple(shipped))
    return entry.renamed(name if is_renamed else entry.name, source)


def _of_policy(name: str, source: str) -> Entry:
    policy = load_policy(source)
    words = f"policy, {policy.acting.name}"
    # Workers may run in another folder.
    path = str(Path(source).resolve()) if Path(source).is_file() else source
    return Entry(name, words, {"control.kind": "policy", "control.parameters.policy": path})


def _of_controller(kind: str, shipped: Sequence[str]) -> Entry:
    kinds = {**Omnitrack.controllers(), **installed("controllers")}
    if kind not in kinds and ":" not in kind:
        choices = (*dict.fromkeys((*shipped, *kinds)), "module:Object", "FILE.npz")
        raise InputError(Fault("--controller", f"is {kind!r}", choices, given=kind))
    # Refuse a class that cannot be imported before any trial of another entry is run.
    controller_of(kind, Omnitrack.controllers())
    return Entry(kind.replace(":", "."), f"controller {kind}", {"control.kind": kind})


SEED = 71_000
"""Seed of the first course; the others follow it."""
FIRST_NETWORK = 71_000_000
"""Seed of the first random network."""
DRY, SLIPPERY = (0.7, 1.0), (0.5, 0.7)
BATCH = 16
"""Trials that run together."""


def _axes(friction: tuple[float, float]) -> tuple[Axis, ...]:
    return (
        UniformAxis(path="start.theta5_deg", kind="uniform", low=-60, high=60),
        UniformAxis(path="world.friction", kind="uniform", low=friction[0], high=friction[1]),
        UniformAxis(path="robot.preload", kind="uniform", low=20, high=35),
        DirectionAxis(path="world.gravity", kind="direction"),
    )


def _drawn(
    base: str, seed: int, friction: tuple[float, float], trials: int, changes: Changes
) -> Sweep:
    """Random trials of a shipped scenario."""
    scenario = load_scenario(base, changes)
    return Sweep(
        name=base,
        seed=seed,
        samples=trials,
        sampling="latin_hypercube",
        batch=BATCH,
        axes=_axes(friction),
        bases={base: scenario},
        set=dict(changes),
    )


def _networks(trials: int, changes: Changes) -> Sweep:
    """One mission through a random network a trial, each a base of its own."""
    bases = {f"network_{i}": _mission(FIRST_NETWORK + i, changes) for i in range(trials)}
    return Sweep(name="network", batch=BATCH, bases=bases, set=dict(changes))


def _mission(seed: int, changes: Changes) -> Scenario:
    """Draw a mission between two ends of a random network with 6 to 12 fittings."""
    # A generator apart from that of the network, whose draws may become more in a later version.
    draw = np.random.default_rng([seed, 1])
    network = random_network(seed)
    start, goal = draw.choice(network.open_ends, 2, replace=False)
    # Normal components have no preferred direction; normalised they are uniform on the sphere.
    gravity = draw.normal(size=3)
    data = {
        "name": f"network_{seed}",
        "network": network.model_dump(mode="json"),
        "mission": {"start": str(start), "goals": [str(goal)]},
        "start": {"theta5_deg": float(draw.uniform(-180, 180))},
        "world": {
            "friction": float(draw.uniform(*DRY)),
            "gravity": (GRAVITY * gravity / np.linalg.norm(gravity)).tolist(),
        },
    }
    return validate(data, changes=changes)


_DRAWN = (
    ("turn", "up a run, out through the branch of a dry tee", "tee_turn", DRY),
    ("turn_slippery", "the same on slippery walls", "tee_turn", SLIPPERY),
    ("merge", "out of the branch, up the run", "tee_merge", DRY),
    ("over", "straight over a tee", "tee_straight", DRY),
    ("elbow", "through an elbow of mean radius 90 mm", "elbow_short", DRY),
)


SUITE = Suite(
    "control",
    "Controllers compared",
    version=1,
    courses={
        **{
            name: Course(name, words, 200, 8, partial(_drawn, base, SEED + i, friction))
            for i, (name, words, base, friction) in enumerate(_DRAWN)
        },
        "network": Course("network", "to a far end of a random network", 100, 4, _networks),
    },
    entries=shipped_entries,
    entry_of=entry_of,
    measures=(
        BenchMeasure("duration_s", "s", "time"),
        BenchMeasure("slip_ratio_mean", "1", "slip"),
        BenchMeasure("energy_j", "J", "energy"),
        BenchMeasure("torque_change_nm_s", "N m/s", "torque change"),
        BenchMeasure("tilt_max_deg", "deg", "largest tilt"),
    ),
    default=DEFAULT,
    of_controllers=True,
)
