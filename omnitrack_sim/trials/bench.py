"""Benchmarks: suites of courses, each with held-out trials, and the entries put through them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.channels import MODULE_COUNT
from omnitrack_sim.trials.store import numbers_of
from omnitrack_sim.trials.sweep import Sweep

SUITES: Mapping[str, str] = {
    "mobility": "omnitrack_sim.trials.mobility:SUITE",
    "control": "omnitrack_sim.trials.controllers:SUITE",
}
"""Suites that come with the package, ``module:Object`` by name; the first is the default."""
Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Entry:
    """A robot and its controller.

    Attributes:
        name: of its rows and of the folder of its trials.
        words: what it is.
        changes: of the scenarios of all courses, by dotted path, in this order.
    """

    name: str
    words: str
    changes: Mapping[str, Any] = field(default_factory=dict)

    def renamed(self, name: str, source: str) -> Entry:
        """Return the same entry under another name.

        Args:
            name: the new one.
            source: what the user wrote, for the fault.

        Raises:
            InputError: the name cannot be that of a folder.
        """
        if re.match(NAME_PATTERN, name.replace(".", "_")) and len(name) <= 100:
            return replace(self, name=name)
        problem = "has no name for a folder; write NAME= before it"
        raise InputError(Fault(f"entry {source}", problem))


@dataclass(frozen=True)
class Course:
    """One job.

    Attributes:
        name: of its rows.
        words: what the robot does.
        trials: of the whole benchmark.
        quick: number of trials with ``--quick``.
        sweep: makes the trials of an entry, from their number and the entry's changes; or says why
            the entry's robot does not fit the course.
        is_passed: whether a trial can pass it; else only its measures count.
    """

    name: str
    words: str
    trials: int
    quick: int
    sweep: Callable[[int, Changes], Sweep | str]
    is_passed: bool = True


@dataclass(frozen=True)
class BenchMeasure:
    """A figure of a run.

    Attributes:
        name: of its columns.
        unit: of its values.
        words: what it is, short.
        column: of the tables of sweeps, or the modules' columns, of which it is the mean; empty:
            as its name.
        over: column that it is divided by; empty for none.
        of_failures: it counts for all runs, else for those that passed.
    """

    name: str
    unit: str
    words: str
    column: str = ""
    over: str = ""
    of_failures: bool = False

    def of(self, table: pa.Table) -> Array:
        """Return the figure of each trial of a table; not a number where there is none."""
        own, there = self.column or self.name, table.column_names
        columns = [own] if own in there else [f"{own}_{i + 1}" for i in range(MODULE_COUNT)]
        # Robots differ in their metrics: what one of them does not have is no fault.
        if not {*columns, *filter(None, [self.over])} <= {*there}:
            return np.full(len(table), np.nan)
        mean = np.mean([numbers_of(table, name) for name in columns], axis=0)
        return mean / numbers_of(table, self.over) if self.over else mean

    @property
    def head(self) -> str:
        """Words and unit, for the head of a column."""
        return self.words if self.unit == "1" else f"{self.words}, {self.unit}"


@dataclass(frozen=True)
class Suite:
    """A family of courses, and of entries that may be put through them.

    Attributes:
        name: on the command line.
        title: above its page.
        version: of courses, seeds and scores: results of two versions are not compared.
        courses: by name.
        entries: makes the entries that come with the package, by name.
        entry_of: makes an entry from the two texts of the command line: a source, or "" for the
            standard one, and a controller, or "" for the source's own.
        measures: of the trials.
        scores: by the names of their columns, functions from the table of all trials of an entry on
            a course to a figure; not a number where there is none.
        default: name of the entry that all others are compared with; empty for none.
        of_controllers: one text alone names a controller, not a robot.
    """

    name: str
    title: str
    version: int
    courses: Mapping[str, Course]
    entries: Callable[[], Mapping[str, Entry]]
    entry_of: Callable[[str, str], Entry]
    measures: tuple[BenchMeasure, ...]
    scores: Mapping[str, Callable[[pa.Table], float]] = field(default_factory=dict)
    default: str = ""
    of_controllers: bool = False

    @property
    def heads(self) -> dict[str, str]:
        """Heads of the columns of measures and scores, by name."""
        words = {name: name.replace("_", " ") for name in self.scores}
        return {measure.name: measure.head for measure in self.measures} | words


def suite_of(name: str) -> Suite:
    """Return a suite by its name.

    Raises:
        InputError: there is no such suite.
    """
    if name not in SUITES:
        raise InputError(Fault("--suite", f"is {name!r}", tuple(SUITES), given=name))
    return named(SUITES[name], "--suite", {})


@dataclass(frozen=True)
class Bench:
    """A plan of trials: each entry is put through the sweep of each course.

    Attributes:
        suite: of the courses.
        courses: of the suite that are run.
        entries: of the benchmark.
        quick: only a few trials of each, to see that everything runs.
        trials: of each course, other ones than without it; none: as many as each course has.
        changes: of all scenarios by dotted path, after those of the entries.

    Raises:
        InputError: there is no course or no entry, two entries have one name, or the number of
            trials is given twice.

    Example:
        >>> bench = ot.Bench.of("control", ["elbow"], ["feedback", "equal"], quick=True)
        >>> {key: sweep.size for key, sweep in bench.sweeps().items()}
        {('elbow', 'feedback'): 8, ('elbow', 'equal'): 8}
    """

    suite: Suite
    courses: Sequence[Course]
    entries: Sequence[Entry]
    quick: bool = False
    trials: int | None = None
    changes: Changes = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        suite: str = next(iter(SUITES)),
        courses: Sequence[str] | None = None,
        entries: Sequence[str | tuple[str, str]] | None = None,
        **options: Any,
    ) -> Bench:
        """Return a benchmark by names.

        Args:
            suite: ``mobility`` for robots, ``control`` for controllers and policies.
            courses: names of courses; none: all of them.
            entries: names of shipped ones, robots, or pairs of a robot and its controller, of the
                suite ``control`` controllers and policies; none: the shipped ones.
            options: ``quick``, ``trials`` and ``changes``.

        Raises:
            InputError: there is no such suite, course or entry.
        """
        own = suite_of(suite)
        for name in courses or ():
            if name not in own.courses:
                raise InputError(Fault("--course", f"is {name!r}", tuple(own.courses), given=name))
        chosen = [course for name, course in own.courses.items() if not courses or name in courses]
        made = []
        for source in own.entries() if entries is None else entries:
            if isinstance(source, str):
                made.append(own.entry_of(*(("", source) if own.of_controllers else (source, ""))))
            else:
                made.append(own.entry_of(*source))
        return cls(own, chosen, made, **options)

    def __post_init__(self) -> None:
        names = [entry.name for entry in self.entries]
        for name in names:
            if names.count(name) > 1:
                problem = f"{name!r} is the name of two; write NAME= before one of them"
                raise InputError(Fault("entries", problem))
        if not self.courses or not self.entries:
            raise InputError(Fault("courses, entries", "one of each at least"))
        if self.quick and self.trials is not None:
            raise InputError(Fault("--trials", "is the number of trials; leave out --quick"))

    @property
    def extent(self) -> str:
        """Number of trials in words."""
        if self.quick:
            return "a few trials of each"
        return "all trials" if self.trials is None else f"{counted(self.trials, 'trial')} of each"

    def sweeps(self) -> dict[tuple[str, str], Sweep | str]:
        """Return the sweep of each course and entry, or why the entry's robot does not fit.

        Raises:
            InputError: an entry cannot drive a course.
        """
        sweeps: dict[tuple[str, str], Sweep | str] = {}
        for course in self.courses:
            for entry in self.entries:
                count = course.quick if self.quick else self.trials or course.trials
                changes = {**entry.changes, **self.changes}
                sweeps[course.name, entry.name] = course.sweep(count, changes)
        return sweeps
