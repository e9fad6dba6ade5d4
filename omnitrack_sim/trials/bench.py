"""Benchmarks: suites of courses, each with held-out trials, and the entries put through them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.channels import MODULE_COUNT
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.show.plots.success import bench_figure
from omnitrack_sim.trials.batches import FORMAT, Batch, sha256_of
from omnitrack_sim.trials.bench_table import ALL, page, results_table, rows_of
from omnitrack_sim.trials.plan import Conclusion, Plan, Round, Rounds
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import BEFORE, BEHIND, numbers_of

SUITES: Mapping[str, str] = {
    "mobility": "omnitrack_sim.trials.mobility:SUITE",
    "control": "omnitrack_sim.trials.controllers:SUITE",
}
"""Suites that come with the package, ``module:Object`` by name; the first is the default."""
Changes = Mapping[str, Any]
PAGE = "results.md"


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
class Bench(Plan):
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

    noun: ClassVar[str] = "bench"
    names: ClassVar[tuple[str, ...]] = ("results",)
    files: ClassVar[tuple[str, ...]] = (PAGE,)
    figure: ClassVar[str] = "bench.png"
    free: ClassVar[tuple[str, ...]] = ("courses", "entries")
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
    def name(self) -> str:
        """Name of the suite."""
        return self.suite.name

    def data(self) -> dict[str, Any]:
        """Return the bench as plain data."""
        entries = {e.name: {"words": e.words, "changes": dict(e.changes)} for e in self.entries}
        return {
            **self._common,
            "courses": {course.name: course.words for course in self.courses},
            "entries": entries,
        }

    @property
    def _common(self) -> dict[str, Any]:
        """What all benches in one folder share, whatever their courses and entries."""
        return {
            "suite": self.suite.name,
            "version": self.suite.version,
            "quick": self.quick,
            "trials": self.trials,
            "changes": dict(self.changes),
        }

    @property
    def hash(self) -> str:
        """SHA-256 of what all benches in one folder share: all but courses and entries."""
        return sha256_of([FORMAT, self._common])

    def rounds(self) -> Rounds:
        """Ask for all trials at once, and compare the entries.

        Raises:
            InputError: an entry cannot drive a course.
        """
        planned = self.sweeps()
        sweeps = {key: sweep for key, sweep in planned.items() if isinstance(sweep, Sweep)}
        table = yield _round_of(sweeps)
        # Trials that are all invalid are no error here: the table says so.
        rows = rows_of(self.suite, {**planned, **_tables_of(sweeps, table)})
        passable = {course.name for course in self.courses if course.is_passed} | {ALL}
        judged = [row for row in rows if row["course"] in passable]
        return Conclusion(
            {"rows": rows},
            {"results": results_table(self.suite, rows)},
            {PAGE: page(self, rows).encode()},
            (lambda: figure_bytes(bench_figure(judged))) if judged else None,
        )

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


def _round_of(sweeps: Mapping[tuple[str, str], Sweep]) -> Round:
    """Trials of all courses and entries, with a column for every axis of any of them."""
    # As one list, so that workers stay busy from one course to the next.
    batches: list[Batch] = []
    columns: dict[str, list[Any]] = {"course": [], "entry": []}
    size = 0
    for (course, entry), sweep in sweeps.items():
        for batch in sweep.batches():
            trials = (replace(trial, index=size + trial.index) for trial in batch.trials)
            batches.append(replace(batch, trials=tuple(trials)))
        values = {"course": [course] * sweep.size, "entry": [entry] * sweep.size, **sweep.trials()}
        for name in {**columns, **values}:
            # Of an axis that this course does not vary, or none did before.
            before = columns.setdefault(name, [None] * size)
            before += values.get(name, [None] * sweep.size)
        size += sweep.size
    return Round(batches, columns)


def _tables_of(
    sweeps: Mapping[tuple[str, str], Sweep], table: pa.Table
) -> dict[tuple[str, str], pa.Table]:
    """The trials of each course and entry, without the columns that these have nothing in."""
    tables, first = {}, 0
    for key, sweep in sweeps.items():
        own = table.slice(first, sweep.size)
        results = {field.name for field in (*BEFORE, *BEHIND)}
        kept = [n for n in own.column_names if n in results or own[n].null_count < len(own)]
        tables[key] = own.select(kept)
        first += sweep.size
    return tables
