"""Suites: families of courses, of entries to be put through them, and what is compared.

A suite is a file of ``scenarios/suites``, or of a user. Version, courses and seeds belong together:
whoever changes a course or a seed gives the suite another version.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow as pa
from pydantic import Field, field_validator, model_validator

from omnitrack_sim.base.bounds import MAX_AXES, MAX_TRIALS
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import NAME_PATTERN, SUITE, beside, checked, read_file
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import NotNegative, Table
from omnitrack_sim.trials.entries import Changes, Entry, controller_entry, robot_entry
from omnitrack_sim.trials.mobility import BATCH, CourseFile, load_course, mission_sweep
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_file import resolve
from omnitrack_sim.trials.table import metric_columns, numbers_of, passed_of

Count = Annotated[int, Field(ge=1, le=MAX_TRIALS)]


class BenchMeasure(Table):
    """A figure of a run.

    Attributes:
        name: of its columns.
        unit: of its values.
        words: what it is, short.
        column: of the tables of trials, or the modules' columns, of which it is the mean; empty:
            as its name.
        over: column that it is divided by; empty for none.
        of_failures: it counts for all runs, else for those that passed.
    """

    name: Annotated[str, Field(min_length=1)]
    unit: str
    words: str
    column: str = ""
    over: str = ""
    of_failures: bool = False

    def of(self, table: pa.Table) -> Array:
        """Return the figure of each trial of a table; not a number where there is none."""
        columns = metric_columns(table, self.column or self.name)
        # Robots differ in their metrics: what one of them does not have is no fault.
        if not columns or (self.over and self.over not in table.column_names):
            return np.full(len(table), np.nan)
        mean = np.mean([numbers_of(table, name) for name in columns], axis=0)
        return mean / numbers_of(table, self.over) if self.over else mean

    @property
    def head(self) -> str:
        """Words and unit, for the head of a column."""
        return self.words if self.unit == "1" else f"{self.words}, {self.unit}"


def min_friction(table: Any) -> float:
    """Return the lowest friction from which on half of the trials or more passed at each.

    It is not a number where there is none.
    """
    passed = passed_of(table)
    if "world.friction" not in table.column_names:
        return math.nan
    friction, lowest = numbers_of(table, "world.friction"), math.nan
    # Trials in networks are not on the ladder: each has its friction in its own scenario.
    for rung in sorted({*friction[np.isfinite(friction)].tolist()}, reverse=True):
        own = passed[(friction == rung) & np.isfinite(passed)]
        if not len(own) or own.mean() < 0.5:
            break
        lowest = rung
    return lowest


SCORES: Mapping[str, Callable[[pa.Table], float]] = {"min_friction": min_friction}
"""Figures of all trials of an entry on a course, by the names of their columns."""


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
        ladder: name of the courses that differ from it by their size alone; empty for none.
        size: of what stands in the way on a course of a ladder, bores.
    """

    name: str
    words: str
    trials: int
    quick: int
    sweep: Callable[[int, Changes], Sweep | str]
    is_passed: bool = True
    ladder: str = ""
    size: float = math.nan


@dataclass(frozen=True)
class Suite:
    """A family of courses, and of entries that may be put through them.

    Attributes:
        name: of its file.
        title: above its page.
        version: of courses, seeds and scores: results of two versions are not compared.
        courses: by name.
        entries: by name.
        measures: of the trials.
        scores: names of ``SCORES``.
        default: name of the entry that all others are compared with; empty for none.
        compares: "robots", or "controllers" of the default robot.
    """

    name: str
    title: str
    version: int
    courses: Mapping[str, Course]
    entries: Mapping[str, Entry]
    measures: tuple[BenchMeasure, ...]
    scores: tuple[str, ...] = ()
    default: str = ""
    compares: Literal["robots", "controllers"] = "robots"

    @property
    def heads(self) -> dict[str, str]:
        """Heads of the columns of measures and scores, by name."""
        words = {name: name.replace("_", " ") for name in self.scores}
        return {measure.name: measure.head for measure in self.measures} | words

    def entry(self, robot: str = "", controller: str = "") -> Entry:
        """Return an entry by what a user writes.

        Args:
            robot: see ``robot_entry``; empty for the default robot.
            controller: its controller; empty for its own.

        Raises:
            InputError: there is no such thing, or it is not for this suite.
        """
        if self.compares == "robots":
            return robot_entry(robot, controller, self.entries)
        if robot:
            problem = f"is for suites of robots; {self.name} takes --controller alone"
            raise InputError(Fault("--robot", problem))
        return controller_entry(controller, self.entries)


class EntryTable(Table):
    """An entry as it is written: a name, words, and changes of all scenarios by dotted path."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    words: str
    changes: dict[str, Any] = Field(default_factory=dict)


class Missions(Table):
    """Missions through random networks, another one each trial.

    Attributes:
        friction: range of the walls'.
    """

    friction: tuple[NotNegative, NotNegative]

    @field_validator("friction")
    @classmethod
    def _rises(cls, friction: tuple[float, float]) -> tuple[float, float]:
        if friction[0] > friction[1]:
            raise ValueError("must have the lower one first")
        return friction


class CourseTable(Table):
    """A course as it is written: one of ``base``, ``course`` and ``missions`` says what is driven.

    Attributes:
        name: of its rows; left out: that of the course file.
        words: what the robot does; left out: those of the course file.
        trials: of the whole bench.
        quick: number of trials with ``--quick``.
        seed: of the draws, and of the first random network.
        base: a scenario, by name or by path relative to the suite; its random trials have `axes`.
        axes: as of a sweep.
        course: a course file in bores of the robot, by name or by path relative to the suite.
        missions: a table of missions through random networks.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)] | None = None
    words: str | None = None
    trials: Count
    quick: Count
    seed: Annotated[int, Field(ge=0, lt=2**62)]
    base: str | None = None
    axes: Annotated[tuple[dict[str, Any], ...], Field(max_length=MAX_AXES)] = ()
    course: str | None = None
    missions: Missions | None = None

    @model_validator(mode="after")
    def _says_what_is_driven(self) -> CourseTable:
        kinds = [self.base, self.course, self.missions]
        if sum(kind is not None for kind in kinds) != 1:
            raise ValueError("needs one of base, course and missions")
        if self.course is None and (self.name is None or self.words is None):
            raise ValueError("needs name and words")
        return self

    def made(self, folder: Path) -> list[Course]:
        """Return the course, or those of all its sizes; paths are relative to ``folder``."""
        counts = self.trials, self.quick
        if self.course is not None:
            file = load_course(beside(folder, self.course))
            own = {"name": self.name or file.name, "words": self.words or file.words}
            file = file.model_copy(update=own)
            if file.sizes:
                return [self._of(file.of_size(size), file.name, size) for size in file.sizes]
            return [self._of(file)]
        name, words = self.name or "", self.words or ""
        if self.missions is not None:
            sweep = partial(mission_sweep, name, self.seed, self.missions.friction)
        else:
            sweep = partial(self._drawn, folder)
        return [Course(name, words, *counts, sweep)]

    def _of(self, file: CourseFile, ladder: str = "", size: float = math.nan) -> Course:
        """The course of a file."""
        counts, sweep = (self.trials, self.quick), partial(file.sweep, self.seed)
        return Course(file.name, file.words, *counts, sweep, not file.pull_rate, ladder, size)

    def _drawn(self, folder: Path, trials: int, changes: Changes) -> Sweep:
        """Random trials of a scenario."""
        data = {
            "name": self.name,
            "base": self.base,
            "seed": self.seed,
            "samples": trials,
            "sampling": "latin_hypercube",
            "batch": BATCH,
            "axes": self.axes,
        }
        return resolve(data, folder, changes)


class SuiteFile(Table):
    """A suite as it is written. docs/studies/benchmark.md explains the keys.

    Attributes:
        like: suite whose entries and measures are this one's, too, before its own.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    title: str
    version: Annotated[int, Field(ge=1)] = 1
    compares: Literal["robots", "controllers"] = "robots"
    like: str | None = None
    default: str = ""
    measures: tuple[BenchMeasure, ...] = ()
    scores: tuple[Literal["min_friction"], ...] = ()
    entries: tuple[EntryTable, ...] = ()
    courses: Annotated[tuple[CourseTable, ...], Field(min_length=1)]


def load_suite(source: str | Path) -> Suite:
    """Read a suite file, or a shipped suite by name.

    Raises:
        InputError: no such file, bad TOML, or any fault in it.
    """
    path, data = read_file(source, SUITE, InputError)
    file = checked(SuiteFile, data, InputError)
    courses = [made for course in file.courses for made in course.made(path.parent)]
    if file.like is not None:
        _, data = read_file(beside(path.parent, file.like), SUITE, InputError)
        like = checked(SuiteFile, data, InputError)
        entries, measures = (*like.entries, *file.entries), (*like.measures, *file.measures)
        file = file.model_copy(update={"entries": entries, "measures": measures})
    entries = [Entry(entry.name, entry.words, entry.changes) for entry in file.entries]
    return Suite(
        file.name,
        file.title,
        file.version,
        _by_name("courses", courses),
        _by_name("entries", entries),
        file.measures,
        file.scores,
        file.default,
        file.compares,
    )


def _by_name(where: str, things: list[Any]) -> dict[str, Any]:
    names = [thing.name for thing in things]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(Fault(f"{where}.{i}.name", f"{name!r} is the name of an earlier one"))
    return dict(zip(names, things, strict=True))
