"""Benchmarks of controllers: the entries that drive, and the tasks, each with held-out trials.

The seeds of the tasks are for nothing else: neither the controllers nor the shipped studies have
used them, and whoever trains a policy keeps away from them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import shipped_policies
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.text import counted
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.robots.control import controller_of
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.parameters import CONTROLLERS
from omnitrack_sim.robots.omnitrack.policy.file import load_policy
from omnitrack_sim.scenario import Scenario, load_scenario, validate
from omnitrack_sim.trials.axes import Axis, DirectionAxis, UniformAxis
from omnitrack_sim.trials.sweep import Sweep

DEFAULT = "feedback"
"""The entry that all others are compared with."""


@dataclass(frozen=True)
class Entry:
    """One way to drive.

    Attributes:
        name: of its rows and of the folder of its trials.
        words: what it is.
        changes: of the scenarios of all tasks, by dotted path, in this order.
    """

    name: str
    words: str
    changes: Mapping[str, Any] = field(default_factory=dict)


# The values before commit aa5bc0e and sway, where they are parameters.
_BEFORE = {
    "robot.motor.speed_bandwidth": 50.0,
    "robot.motor.speed_droop": 0.0,
    "control.parameters.tracking.turn_speed": 1.0,
    "control.parameters.damping.tee_turn": 5.0,
    "control.parameters.damping.tee_straight": 2.5,
    "control.parameters.sway.lean_deg": 0.0,
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
        {"control.kind": "omnitrack_sim.paper.open_loop:BendController"},
    ),
    Entry("differential", "one motor and a differential", {"robot.drive": "differential"}),
)


def shipped_entries() -> dict[str, Entry]:
    """Return the shipped entries and policies by name, the default one first."""
    entries = {entry.name: entry for entry in _SHIPPED}
    return entries | {name: _of_policy(name, name) for name in shipped_policies()}


def entry_of(source: str) -> Entry:
    """Return the entry for a source.

    A source is the name of a shipped entry, a kind of controller, ``module:Object``, or the path
    of a policy file; ``NAME=`` before it gives it another name.

    Raises:
        InputError: there is no such thing, or it cannot be used.
    """
    name, renamed, what = source.rpartition("=")
    shipped = shipped_entries()
    if what in shipped:
        entry = shipped[what]
    elif what.endswith(".npz"):
        entry = _of_policy(Path(what).stem, what)
    else:
        entry = _of_controller(what, tuple(shipped))
    return replace(entry, name=_fit(name, source)) if renamed else entry


def _of_policy(name: str, source: str) -> Entry:
    policy = load_policy(source)
    words = f"policy, {policy.acting.name}"
    # Workers may run in another folder.
    path = str(Path(source).resolve()) if Path(source).is_file() else source
    changes = {"control.kind": "policy", "control.parameters.policy": path}
    return Entry(_fit(name, source), words, changes)


def _of_controller(kind: str, shipped: Sequence[str]) -> Entry:
    if kind not in CONTROLLERS and ":" not in kind:
        choices = (*dict.fromkeys((*shipped, *CONTROLLERS)), "module:Object", "FILE.npz")
        raise InputError(Fault("--entry", f"is {kind!r}", choices, given=kind))
    # Refuse a class that cannot be imported before any trial of another entry is run.
    controller_of(kind, CONTROLLERS)
    return Entry(_fit(kind.replace(":", "."), kind), f"controller {kind}", {"control.kind": kind})


def _fit(name: str, source: str) -> str:
    """Check that a name can be that of a folder."""
    if re.match(NAME_PATTERN, name.replace(".", "_")) and len(name) <= 100:
        return name
    raise InputError(Fault(f"--entry {source}", "has no name for a folder; write NAME= before it"))


SEED = 71_000
"""Of the first task; the others count on from it."""
FIRST_NETWORK = 71_000_000
"""Seed of the first random network."""
DRY, SLIPPERY = (0.7, 1.0), (0.5, 0.7)
BATCH = 16
"""Trials that run together."""
Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Task:
    """One job.

    Attributes:
        name: of its rows.
        words: what the robot does.
        trials: of the whole benchmark.
        quick: number of trials with ``--quick``.
        sweep: makes the trials of an entry, from their number and the entry's changes.
    """

    name: str
    words: str
    trials: int
    quick: int
    sweep: Callable[[int, Changes], Sweep]


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
TASKS: Mapping[str, Task] = {
    **{
        name: Task(name, words, 200, 8, partial(_drawn, base, SEED + i, friction))
        for i, (name, words, base, friction) in enumerate(_DRAWN)
    },
    "network": Task("network", "to a far end of a random network", 100, 4, _networks),
}
"""All tasks by name."""


@dataclass(frozen=True)
class Bench:
    """A plan of trials: each entry is put through the sweep of each task.

    Attributes:
        tasks: of the benchmark.
        entries: of the benchmark.
        quick: only a few trials of each, to see that everything runs.
        trials: of each task, other ones than without it; none: as many as each task has.
        changes: of all scenarios by dotted path, after those of the entries.

    Raises:
        InputError: there is no task or no entry, two entries have one name, or the number of trials
            is given twice.

    Example:
        >>> bench = ot.Bench.of(tasks=["elbow"], entries=["feedback", "equal"], quick=True)
        >>> {key: sweep.size for key, sweep in bench.sweeps().items()}
        {('elbow', 'feedback'): 8, ('elbow', 'equal'): 8}
    """

    tasks: Sequence[Task]
    entries: Sequence[Entry]
    quick: bool = False
    trials: int | None = None
    changes: Changes = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        tasks: Sequence[str] | None = None,
        entries: Sequence[str] | None = None,
        **options: Any,
    ) -> Bench:
        """Return a benchmark by names.

        Args:
            tasks: names of tasks; none: all of them.
            entries: sources, see ``entry_of``; none: the shipped entries and policies.
            options: ``quick``, ``trials`` and ``changes``.

        Raises:
            InputError: there is no such task or entry.
        """
        for name in tasks or ():
            if name not in TASKS:
                raise InputError(Fault("--task", f"is {name!r}", tuple(TASKS), given=name))
        chosen = [task for name, task in TASKS.items() if not tasks or name in tasks]
        return cls(chosen, [entry_of(name) for name in entries or shipped_entries()], **options)

    def __post_init__(self) -> None:
        names = [entry.name for entry in self.entries]
        for name in names:
            if names.count(name) > 1:
                problem = f"{name!r} is the name of two; write NAME= before one of them"
                raise InputError(Fault("entries", problem))
        if not self.tasks or not self.entries:
            raise InputError(Fault("tasks, entries", "one of each at least"))
        if self.quick and self.trials is not None:
            raise InputError(Fault("--trials", "is the number of trials; leave out --quick"))

    @property
    def extent(self) -> str:
        """Number of trials in words."""
        if self.quick:
            return "a few trials of each"
        return "all trials" if self.trials is None else f"{counted(self.trials, 'trial')} of each"

    def sweeps(self) -> dict[tuple[str, str], Sweep]:
        """Return the sweep of each task and entry.

        Raises:
            InputError: an entry cannot drive a task.
        """
        sweeps = {}
        for task in self.tasks:
            for entry in self.entries:
                count = task.quick if self.quick else self.trials or task.trials
                sweeps[task.name, entry.name] = task.sweep(count, {**entry.changes, **self.changes})
        return sweeps
