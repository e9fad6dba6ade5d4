"""Benches: plans of trials that put each entry of a suite through each of its courses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import pyarrow as pa

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.paths import matches
from omnitrack_sim.base.text import counted
from omnitrack_sim.calibration.calibration import Calibration
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.show.plots.success import bench_figure, ladder_figure
from omnitrack_sim.trials.axes import CalibrationAxis
from omnitrack_sim.trials.batches import FORMAT, Batch, sha256_of
from omnitrack_sim.trials.bench_table import ALL, page, results_table, rows_of
from omnitrack_sim.trials.entries import Changes, Entry
from omnitrack_sim.trials.plan import Conclusion, Plan, Round, Rounds
from omnitrack_sim.trials.suite import Course, Suite, load_suite
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import BEFORE, BEHIND

PAGE = "results.md"


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
        batch: trials that run together; none: as each course has it.
        calibration: each trial draws the robot's own parameters from it; none: as they are.

    Raises:
        InputError: there is no course or no entry, two entries have one name, the number of
            trials is given twice, or the calibration has no parameter of a robot.

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
    batch: int | None = None
    calibration: Calibration | None = None

    @classmethod
    def of(
        cls,
        suite: str | Path = "mobility",
        courses: Sequence[str] | None = None,
        entries: Sequence[str | tuple[str, str]] | None = None,
        **options: Any,
    ) -> Bench:
        """Return a benchmark by names.

        Args:
            suite: its file, or a shipped one by name: ``mobility`` for robots, ``control`` for
                controllers and policies.
            courses: names of courses, or of ladders of them; none: all of them.
            entries: names of shipped ones, robots, or pairs of a robot and its controller, of the
                suite ``control`` controllers and policies; none: the shipped ones.
            options: ``quick``, ``trials``, ``changes``, ``batch`` and ``calibration``.

        Raises:
            InputError: there is no such suite, course or entry.
        """
        own = load_suite(suite)
        known = {name: {name, course.ladder} for name, course in own.courses.items()}
        choices = tuple(dict.fromkeys(c.ladder or name for name, c in own.courses.items()))
        for name in courses or ():
            if not any(name in names for names in known.values()):
                raise InputError(Fault("--course", f"is {name!r}", choices, given=name))
        chosen = [
            course
            for name, course in own.courses.items()
            if not courses or known[name] & {*courses}
        ]
        made = []
        for source in own.entries if entries is None else entries:
            if not isinstance(source, str):
                made.append(own.entry(*source))
            elif own.compares == "robots":
                made.append(own.entry(robot=source))
            else:
                made.append(own.entry(controller=source))
        return cls(own, chosen, made, **options)

    def __post_init__(self) -> None:
        names = [entry.name for entry in self.entries]
        for name in names:
            if names.count(name) > 1:
                problem = f"{name!r} is the name of two"
                if name in self.suite.entries:
                    problem += (
                        ", one of which comes with the package: leave that out by --alone, or"
                    )
                raise InputError(Fault("entries", f"{problem} write NAME= before one of them"))
        if not self.courses or not self.entries:
            raise InputError(Fault("courses, entries", "one of each at least"))
        if self.quick and self.trials is not None:
            raise InputError(Fault("--trials", "is the number of trials; leave out --quick"))
        if self._drawn is not None:
            self.sweeps()  # refuses a calibration of another robot before anything runs

    @cached_property
    def _drawn(self) -> CalibrationAxis | None:
        """Axis of the robot's own parameters; none without a calibration."""
        if self.calibration is None:
            return None
        return CalibrationAxis.of(self.calibration.part("robot."), "")

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
            **({} if self.batch is None else {"batch": self.batch}),
            **({} if self._drawn is None else {"drawn": self._drawn.model_dump(mode="json")}),
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
        figure = ladder_figure if any("ladder" in row for row in judged) else bench_figure
        return Conclusion(
            {"rows": rows},
            {"results": results_table(self.suite, rows)},
            {PAGE: page(self, rows).encode()},
            (lambda: figure_bytes(figure(judged))) if judged else None,
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
                sweep = course.sweep(count, changes)
                if self.batch is not None and isinstance(sweep, Sweep):
                    sweep = sweep.model_copy(update={"batch": self.batch})
                if self._drawn is not None and isinstance(sweep, Sweep):
                    sweep = _drawing(sweep, self._drawn, entry.name)
                sweeps[course.name, entry.name] = sweep
        return sweeps


def _drawing(sweep: Sweep, axis: CalibrationAxis, entry: str) -> Sweep:
    """Return a sweep whose trials draw the robots of an entry.

    What the sweep varies itself of the same parameters it varies no more.

    Raises:
        InputError: the robot has no such parameter.
    """
    for path in axis.paths:
        if not all(matches(data, path) for data in sweep.plain.values()):
            problem = f"is of another robot than {entry}, which has no {path}; see --alone"
            raise InputError(Fault("--calibration", problem))
    kept = [own for own in sweep.axes if not {*own.columns} & {*axis.paths}]
    changes: dict[str, Any] = {"axes": (*kept, axis)}
    if all(own.crossed for own in kept):  # else all trials would have the one robot drawn
        changes["draws"] = "independent"
    return sweep.model_copy(update=changes)


def _round_of(sweeps: Mapping[tuple[str, str], Sweep]) -> Round:
    """Trials of all courses and entries, with a column for every axis of any of them."""
    # As one list, so that workers stay busy from one course to the next.
    batches: list[Batch] = []
    columns: dict[str, list[Any]] = {"course": [], "entry": []}
    units: dict[str, str | None] = {}
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
        units = {**sweep.units, **{name: unit for name, unit in units.items() if unit}}
        size += sweep.size
    return Round(batches, columns, units=units)


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
