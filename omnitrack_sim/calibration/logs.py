"""Logs of runs: columns of measured quantities over time, read from files of any origin."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.bounds import MAX_COLUMNS, MAX_NUMBER
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import beside, checked, is_file, placed_in, refuse_missing, table_of
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.calibration.columns import Columns, read_columns
from omnitrack_sim.calibration.units import unit_of

TIME = "time"
"""Name of the column of times, unless a table says another one."""
_HEAD = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*")
_JUMP_STEPS = 20
"""Sampling steps from which on a pause between two samples may be a jump of the clock."""
_JUMP_PART = 0.25
"""Part of the way that a quantity would have gone in such a pause, up to which it has not gone it:
then the clock has jumped, and the robot's time has not."""
_TREND = 10.0
"""How many times a step's scatter that way must be, for a pause to be judged by it."""
_NEAR = 20
"""Samples before and after a pause that tell how fast a quantity changes."""

Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]


class TimeTable(Table):
    """Where a log's file has the times of its samples.

    Attributes:
        column: name of the column.
        unit: of its numbers.
        offset: s, added to them: the simulated run begins at time 0.
    """

    column: str = TIME
    unit: str = "s"
    offset: Number = 0.0


class ColumnTable(Table):
    """Where a log's file has one quantity: scale * (number in its unit) + offset.

    Attributes:
        column: name of the column.
        unit: of its numbers; left out: that of the channel.
        scale: factor to the channel's unit, which may lead from one quantity to another, such as
            from a current in A to a torque in N m.
        offset: added after that, in the channel's unit.
    """

    column: str
    unit: str | None = None
    scale: Number = 1.0
    offset: Number = 0.0


class LogTable(Table):
    """A table that tells what is in the file of a log; docs/how-to/calibrate.md has an example.

    Attributes:
        file: of the samples: CSV, Parquet or MCAP, by path relative to the table.
        scenario: of the run, by name or by path relative to the table; none: that of the call.
        set: how the run differed from the scenario, by dotted path.
        time: the column of times.
        columns: of the file, by the column of the trajectory that they measure; none: those that
            have the names of these.
    """

    file: str
    scenario: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    time: TimeTable = TimeTable()
    columns: Annotated[dict[str, ColumnTable], Field(max_length=MAX_COLUMNS)] | None = None


@dataclass(frozen=True, eq=False)
class Log:
    """What was measured in one run.

    Attributes:
        name: that messages and pages call it.
        time: (T,) s, strictly increasing; the simulated run begins at 0.
        values: (T,) each, by the column of the trajectory that was measured, in coherent SI units;
            NaN where nothing was read.
        units: from which values were brought to SI units, to be checked against the channel's.
        scenario: of the run; none: that of the call.
        changes: how the run differed from the scenario, by dotted path.

    Example:
        >>> log = ot.Log("run 1", [0.0, 0.1, 0.2], {"distance": [0.2, 0.21, 0.22]})
        >>> log.values["distance"].shape
        (3,)
    """

    name: str
    time: Array
    values: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    scenario: str | Path | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        time = np.asarray(self.time, float)
        values = {name: np.asarray(own, float) for name, own in self.values.items()}
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        if time.ndim != 1 or len(time) < 2 or not np.isfinite(time).all():
            raise InputError(Fault(f"{self.name}: time", "must be two finite times or more"))
        if (np.diff(time) <= 0).any():
            i = int(np.argmax(np.diff(time) <= 0)) + 1
            problem = f"goes from {time[i - 1]:.6g} to {time[i]:.6g} s at sample {i}"
            raise InputError(Fault(f"{self.name}: time", problem))
        for name, own in values.items():
            if own.shape != time.shape:
                problem = f"has {own.shape} numbers for {len(time)} times"
                raise InputError(Fault(f"{self.name}: {name}", problem))


def load_log(source: str | os.PathLike[str]) -> Log:
    """Read the log of a run.

    Args:
        source: a CSV, Parquet or MCAP file whose columns have the names of the trajectory's, each
            with a unit in brackets where it is not the SI one, such as ``distance [mm]``; or a
            table in TOML that says which is which (``LogTable``).

    Raises:
        InputError: lists every fault, of samples with their line.

    Example:
        >>> try:
        ...     ot.load_log("run7.csv")
        ... except ot.InputError as error:
        ...     print(error)
        run7.csv: cannot be read: there is no such file
    """
    path = Path(source)
    refuse_missing(path)
    if path.suffix.lower() not in (".toml", ".json"):
        return _made(path, LogTable(file=str(path)))
    with placed_in(path):
        table = checked(LogTable, table_of(path, "log's table", InputError), InputError)
    file = Path(beside(path.parent, table.file))
    if not is_file(file):
        raise InputError(Fault(f"{path}: file", f"is {table.file!r}; there is no such file"))
    log = _made(file, table)
    scenario = None if table.scenario is None else beside(path.parent, table.scenario)
    return replace(log, name=path.stem, scenario=scenario, changes=table.set)


def _made(file: Path, table: LogTable) -> Log:
    """Return the log of a file, as a table tells it."""
    wanted = None if table.columns is None else _wanted(table)
    columns = read_columns(file, wanted)
    named = {_plain(head): head for head in columns.values}
    head = table.time.column if table.time.column in columns.values else None
    head = head or named.get(table.time.column)
    if head is None:
        problem = f"has no column {table.time.column!r} of times"
        choices = tuple(columns.values)
        raise InputError(Fault(str(file), problem, choices, given=table.time.column))
    unit = table.time.unit if _unit_in(head) is None else str(_unit_in(head))
    factor = unit_of(unit, f"{file}: {head}").factor
    time = factor * columns.values[head] + table.time.offset
    kept = _increasing(time, columns, file)
    values, units = _measured(file, columns, table, head)
    values = {name: own[kept] for name, own in values.items()}
    time = time[kept]
    _refuse_jumps(time, values, lambda i: columns.line(int(kept[i])), file)
    return Log(file.stem, time, values, units)


def _wanted(table: LogTable) -> list[str]:
    """Names of the columns that a table asks for."""
    assert table.columns is not None
    return [table.time.column, *(column.column for column in table.columns.values())]


def _plain(head: str) -> str:
    """Name in the head of a column, without its unit."""
    match = _HEAD.fullmatch(head)
    return match[1] if match else head.strip()


def _unit_in(head: str) -> str | None:
    """Unit in the head of a column; None where there is none."""
    match = _HEAD.fullmatch(head)
    return match[2].strip() if match else None


def _measured(
    file: Path, columns: Columns, table: LogTable, time: str
) -> tuple[dict[str, Array], dict[str, str]]:
    """Return the quantities of a log by the columns of the trajectory, and their known units."""
    if table.columns is None:
        # An exported run's heads are written with a space before the module, as for a reader.
        heads = [head for head in columns.values if head != time]
        tables = {_plain(head).replace(" ", "_"): ColumnTable(column=head) for head in heads}
    else:
        tables = dict(table.columns)
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, own in tables.items():
        text = own.unit if own.unit is not None else _unit_in(own.column)
        numbers = columns.values[own.column]
        if text is not None:
            numbers = unit_of(text, f"{file}: {own.column}").factor * numbers
            if own.scale == 1:  # a scale may lead from one quantity to another
                units[name] = text
        values[name] = own.scale * numbers + own.offset
    return values, units


def _increasing(time: Array, columns: Columns, file: Path) -> NDArray[np.intp]:
    """Return the indices of the samples to keep: of equal times the first.

    Raises:
        InputError: a time is missing, or the clock goes back.
    """
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        problem = f"line {columns.line(int(missing[0]))} has no time"
        raise InputError(Fault(str(file), problem))
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        i = int(back[0])
        problem = (
            f"the clock goes back at line {columns.line(i + 1)}, from {time[i]:.6g} to "
            f"{time[i + 1]:.6g} s: cut the file there, or mend the times"
        )
        raise InputError(Fault(str(file), problem))
    return np.flatnonzero(np.diff(time, prepend=-np.inf) > 0)


def _refuse_jumps(
    time: Array, values: Mapping[str, Array], line: Callable[[int], int], file: Path
) -> None:
    """Raise an error where the clock jumped ahead: time went on, and what moved did not.

    A gap, in which the robot moved on without being recorded, is none.
    """
    steps = np.diff(time)
    for i in np.flatnonzero(steps > _JUMP_STEPS * np.median(steps)).tolist():
        for name, own in values.items():
            if _stood_still(time, own, i):
                problem = (
                    f"the clock jumps at line {line(i + 1)}, from {time[i]:.6g} to "
                    f"{time[i + 1]:.6g} s, and {name!r} goes on as if it had not: mend the times"
                )
                raise InputError(Fault(str(file), problem))


def _stood_still(time: Array, values: Array, i: int) -> bool:
    """Return whether a quantity that moves before and after a pause did not in it."""
    before, after = slice(max(0, i - _NEAR), i + 1), slice(i + 1, i + 2 + _NEAR)
    rates, scatter = [], 0.0
    for part in (before, after):
        known = np.isfinite(values[part])
        t, v = time[part][known], values[part][known]
        if len(t) < 4:
            return False
        rate, start = np.polyfit(t - t[0], v, 1)
        rates.append(rate)
        scatter = max(scatter, float(np.std(v - start - rate * (t - t[0]))))
    slowest = min(rates, key=abs)
    way = slowest * (time[i + 1] - time[i])
    if rates[0] * rates[1] <= 0 or abs(way) < _TREND * scatter:
        return False
    return abs(values[i + 1] - values[i]) < _JUMP_PART * abs(way)


def as_log(source: Log | str | os.PathLike[str]) -> Log:
    """Return a log itself, or read the one of a file.

    Raises:
        InputError: as of ``load_log``. TypeError: it is neither of these.
    """
    if isinstance(source, Log):
        return source
    if isinstance(source, str | os.PathLike):
        return load_log(source)
    problem = f"logs: is {source!r}, of type {type(source).__name__}; it must be a path or an "
    raise TypeError(problem + "ot.Log")


def as_logs(sources: Sequence[Log | str | os.PathLike[str]]) -> list[Log]:
    """Return logs, all of different names.

    Raises:
        InputError: the faults of all; there is none; TypeError: one is no log.
    """
    faults: list[Fault] = []
    logs: list[Log] = []
    if isinstance(sources, str | os.PathLike | Log):
        raise TypeError("logs: is one log, not a list; write [...] around it")
    for source in sources:
        try:
            logs.append(as_log(source))
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(faults)
    if not logs:
        raise InputError(Fault("logs", "is empty; give one log or more"))
    names: list[str] = []
    for i, log in enumerate(logs):
        name = log.name if log.name not in names else f"{log.name} ({i + 1})"
        names.append(name)
        logs[i] = replace(log, name=name)
    return logs
