"""Stores of trials: the columns of their tables, and the folder that a sweep or study leaves.

A part file holds the rows of one batch, and is all that a run is resumed from. Several processes
may work in one folder.
"""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from omnitrack_sim.base.errors import Fault, InputError, OutputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import clipped, counted
from omnitrack_sim.base.writing import as_output_error, check_folder, is_workshop, write_file
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.results.comparison import differing
from omnitrack_sim.results.html import LONGEST
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.model import unit_of
from omnitrack_sim.show.plots.style import attempt
from omnitrack_sim.trials.axes import BASE
from omnitrack_sim.trials.batches import ERROR, INVALID, Batch, Row

XYZ = "xyz"
PARTS = "parts"
PARQUET: dict[str, Any] = {
    "compression": "zstd",
    "compression_level": 3,
    "version": "2.6",
    "data_page_version": "1.0",
    "row_group_size": 65536,
    "write_page_checksum": True,
}
"""Settings of the files. They are fixed, so that the same rows give the same bytes."""
_MOST_DIFFERENCES, _MOST_REASONS = 5, 3
"""Largest numbers of differences of two records, and reasons of invalid trials, in a message."""


class TrialColumns:
    """The columns of a table of trials: number, values that are varied, results.

    Attributes:
        schema: of the table, with the units in the metadata of the fields.

    Args:
        bases: base scenarios, whose own metrics have columns, too.
        values: of each axis, one for each trial; none: they have no columns.
        metadata: of the table of all trials.
    """

    def __init__(
        self,
        bases: Iterable[Scenario],
        values: Mapping[str, Sequence[Any]] | None = None,
        metadata: Mapping[str, str] | None = None,
    ):
        self._values: dict[str, Sequence[Any]] = {}
        fields = [column("trial", pa.int64(), "1")]
        kinds = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
        for name, items in (values or {}).items():
            for own, plain in _columns_of(name, items).items():
                self._values[own] = plain
                unit = None if name == BASE else unit_of(name)
                fields.append(column(own, kinds[type(plain[0])], unit))
        self.schema = pa.schema([*fields, *_result_columns(bases)], metadata=metadata)

    def table(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """Return the rows of a batch, with its hash and provenance in the metadata."""
        whole = []
        for row in rows:
            values = {name: values[row["trial"]] for name, values in self._values.items()}
            whole.append({"model": batch.model, **row, **values})
        # The hash makes sure that a part file is not of a batch with other values under the same
        # number.
        metadata = {"part": batch.hash, "made_by": json.dumps(made_by, sort_keys=True)}
        return pa.Table.from_pylist(whole, self.schema.with_metadata(metadata))

    def merged(self, tables: Sequence[pa.Table]) -> pa.Table:
        """Return the rows of batches in the order of the trials, in one piece."""
        plain = [table.replace_schema_metadata(self.schema.metadata) for table in tables]
        if not plain:
            return self.schema.empty_table()
        # In one piece, since the division into batches would show in the bytes of the file.
        return pa.concat_tables(plain).sort_by("trial").combine_chunks()


def _result_columns(bases: Iterable[Scenario]) -> list[pa.Field]:
    """Columns of the results of trials of these scenarios."""
    # A metric of several bases has one column.
    metrics = {metric.name: metric for base in bases for metric in base.all_metrics}
    return [
        column("model", pa.string()),
        column("scenario_sha256", pa.string()),
        column("outcome", pa.string()),
        column("success", pa.bool_()),
        column("duration_s", pa.float64(), "s"),
        column("reason", pa.string()),
        *(
            column(name, pa.float64(), metric.unit)
            for metric in metrics.values()
            if metric.in_tables
            for name in metric_columns(metric)
        ),
        column("attempts", pa.int64(), "1"),
        column("falls", pa.int64(), "1"),
        column("collider", pa.string()),
        column("events", pa.string()),
    ]


def metric_columns(metric: Metric) -> list[str]:
    """Return the names of the columns of a metric: one, or one for each module."""
    if not metric.per_module:
        return [metric.name]
    return [f"{metric.name}_{i}" for i in range(1, MODULES + 1)]


def column(name: str, kind: pa.DataType, unit: str | None = None) -> pa.Field:
    """Return a column of a table, with its unit in the metadata if it has one."""
    return pa.field(name, kind, metadata=None if unit is None else {"unit": unit})


def _columns_of(name: str, values: Sequence[Any]) -> dict[str, Sequence[Any]]:
    """Values of an axis as plain columns."""
    if all(_is_vector(value) for value in values):
        return {
            f"{name}_{letter}": [float(value[i]) for value in values]
            for i, letter in enumerate(XYZ)
        }
    kinds = {type(value) for value in values}
    # The type is compared, not isinstance: a truth value is an int to Python.
    if kinds <= {int, float} or kinds == {bool} or kinds == {str}:
        return {name: [float(value) for value in values] if kinds == {int, float} else values}
    return {name: [value if isinstance(value, str) else json.dumps(value) for value in values]}


def _is_vector(value: Any) -> bool:
    is_triple = isinstance(value, list) and len(value) == len(XYZ)
    return is_triple and all(type(item) in (int, float) for item in value)


def to_parquet(table: pa.Table) -> bytes:
    """Return a table as the bytes of a Parquet file."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, **PARQUET)
    return buffer.getvalue()


def to_csv(table: pa.Table) -> bytes:
    """Return a table as the bytes of a CSV file."""
    buffer = io.BytesIO()
    csv.write_csv(table, buffer)
    return buffer.getvalue()


def to_json(data: Any) -> bytes:
    """Return plain data as the bytes of a JSON file."""
    return (json.dumps(data, indent=2) + "\n").encode()


def numbers_of(table: pa.Table, name: str) -> Array:
    """Return the numbers in a column of a table; NaN where it has none."""
    return np.array([np.nan if v is None else v for v in table[name].to_pylist()], float)


def passed_of(table: pa.Table) -> Array:
    """Return 1 for each trial that passed, 0 for one that failed, NaN without an outcome of the
    robot."""
    ends = zip(table["outcome"].to_pylist(), table["success"].to_pylist(), strict=True)
    return np.array([np.nan if end in (INVALID, ERROR) else float(ok) for end, ok in ends])


def made_by(table: pa.Table) -> str:
    """Return provenance of the rows of a batch (versions, commit), as JSON.

    Raises:
        KeyError, ValueError: its file is damaged.
    """
    text = table.schema.metadata[b"made_by"].decode()
    return json.dumps(json.loads(text), sort_keys=True)


def refuse_all_invalid(table: pa.Table, where: str, which: str, error: type[InputError]) -> None:
    """Refuse trials none of which could run, and give the first reasons.

    Args:
        table: of the trials.
        where: place of the fault in the file.
        which: word before their number in the message, with its blank.
        error: exception class to raise.

    Raises:
        InputError: of class ``error``.
    """
    if set(table["outcome"].to_pylist()) == {INVALID}:
        reasons = list(dict.fromkeys(table["reason"].to_pylist()))
        fault = Fault(where, f"none of {which}{counted(table.num_rows, 'trial')} is valid")
        raise error([fault, *(Fault("", reason) for reason in reasons[:_MOST_REASONS])])


class Store:
    """Tables of batches, kept as long as the process lives; a ``Folder`` keeps them for good.

    Attributes:
        columns: of the tables.
    """

    def __init__(self, columns: TrialColumns):
        self.columns = columns
        self._tables: dict[str, pa.Table] = {}

    def read(self, batch: Batch) -> pa.Table | None:
        """Return the rows of a batch; None where it is not done."""
        # By hash and not by number: studies number the batches of every generation anew.
        return self._tables.get(batch.hash)

    def write(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """Keep the rows of a batch and return them as a table."""
        return self._tables.setdefault(batch.hash, self.columns.table(batch, rows, made_by))


class Folder(Store):
    """The folder of one sweep or study. Each of the two is a subclass, which sets what follows.

    Attributes:
        noun: "sweep" or "study"; the record of what was run is the file of that name in JSON.
        files: that it may hold beside the record; the figure is the last one.
        folders: that it holds.
        digits: of the numbers in the names of part files.
        free: keys of the resolved sweep or study that its trials do not depend on.
        packages: whose versions the record names as well.
        path: of the folder.

    Args:
        path: of the folder; it is made where it is missing.
        sha256: of everything that the trials depend on.
        data: the resolved sweep or study as plain data.
        columns: of the tables of batches.

    Raises:
        OutputError: it holds another sweep or study, or other files, or cannot be written.
    """

    noun: ClassVar[str]
    files: ClassVar[tuple[str, ...]]
    folders: ClassVar[tuple[str, ...]]
    digits: ClassVar[int]
    free: ClassVar[tuple[str, ...]]
    packages: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self, path: str | Path, sha256: str, data: Mapping[str, Any], columns: TrialColumns
    ):
        super().__init__(columns)
        self.path = Path(path)
        ours = {"sha256": sha256, self.noun: data}
        check_folder(self.path, files=(self.record(), *self.files))
        with as_output_error(self.path):
            there = self._record() if self.path.is_dir() else None
            if there is not None and there["sha256"] != sha256:
                raise OutputError(
                    f"{self.path}: holds a different {self.noun}: "
                    f"{_differences(there[self.noun], data, self.free)}; choose another folder "
                    "with --out, or remove this one to begin anew"
                )
            for name in self.folders:
                (self.path / name).mkdir(parents=True, exist_ok=True)
                check_folder(self.path / name)
            versions = {name: version(name) for name in self.packages}
            self._new_record = to_json(ours | environment() | versions)
            self._renamed = there is not None and there[self.noun] != data
            # The record of an earlier run stays until all is finished: names and groups may have
            # changed.
            if there is None:
                write_file(self.path / self.record(), self._new_record)

    @classmethod
    def record(cls) -> str:
        """Return the name of the file that describes the sweep or study."""
        return f"{cls.noun}.json"

    def _record(self) -> dict[str, Any] | None:
        """Contents of the record; None in a folder that holds nothing yet, or parts only."""
        file = self.path / self.record()
        if not file.is_file():
            names = [path.name for path in self.path.iterdir()]
            # A process may have been killed after it made the folders and before it wrote the
            # record.
            strange = [n for n in names if n not in self.folders and not is_workshop(n)]
            if strange:
                raise OutputError(
                    f"{self.path}: holds {strange[0]!r} but no {self.record()}, so it is no "
                    f"{self.noun}; choose another folder"
                )
            return None
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            return {"sha256": data["sha256"], self.noun: dict(data[self.noun])}
        except (ValueError, KeyError, TypeError, RecursionError, MemoryError) as error:
            raise OutputError(
                f"{file}: is no description of a {self.noun} ({error}); choose another folder"
            ) from error

    def read(self, batch: Batch) -> pa.Table | None:
        """Return the rows of a batch; None where its file is missing, damaged, or of others."""
        try:
            data = pa.BufferReader(self._part(batch).read_bytes())
            table = pq.read_table(data, page_checksum_verification=True)
            made_by(table)
        except Exception:  # decoders raise anything on damaged bytes; the batch is run again
            return None
        # A file of the right name may be of another form, or copied from another folder.
        whole = (table.schema.metadata or {}).get(b"part") == batch.hash.encode()
        schema = self.columns.schema.remove_metadata()
        whole = whole and table.schema.remove_metadata().equals(schema)
        numbers = [trial.index for trial in batch.trials]
        return table if whole and table["trial"].to_pylist() == numbers else None

    def write(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """Keep the rows of a batch and return them as a table."""
        table = self.columns.table(batch, rows, made_by)
        with self._keeping():
            write_file(self._part(batch), to_parquet(table))
        return table

    def put(self, name: str, data: bytes | None) -> None:
        """Write a file, whole or not at all, or remove it; nothing where it is as asked for."""
        with self._keeping():
            if data is None:
                (self.path / name).unlink(missing_ok=True)
            elif not self._holds(name, data):
                write_file(self.path / name, data)

    def finish(self, files: Mapping[str, bytes | None], draw: Callable[[], bytes] | None) -> None:
        """Write the files of the whole, in order, and then the figure.

        Nothing is written where all are there already. A figure that cannot be drawn is a warning,
        and the same call tries again.

        Args:
            files: contents by name; None: no such file may remain.
            draw: makes the figure; None: there is none.
        """
        figure = self.files[-1]
        as_asked = all(self._holds(name, data) for name, data in files.items())
        if as_asked and not self._renamed and (draw is None or (self.path / figure).is_file()):
            return
        # The figure goes first: as long as it is missing, the same command does all of this again.
        self.put(figure, None)
        for name, data in files.items():
            self.put(name, data)
        if self._renamed:
            self.put(self.record(), self._new_record)
        picture = None if draw is None else attempt(figure, draw)
        if picture is not None:
            self.put(figure, picture)

    def _holds(self, name: str, data: bytes | None) -> bool:
        file = self.path / name
        return file.read_bytes() == data if file.is_file() else data is None

    def _part(self, batch: Batch) -> Path:
        number = f"{batch.number:0{self.digits}d}"
        return self.path / PARTS / f"{number}-{batch.hash}.parquet"

    @contextlib.contextmanager
    def _keeping(self) -> Iterator[None]:
        """Add to an error of writing that the same command continues the work."""
        try:
            with as_output_error(self.path):
                yield
        except OutputError as error:
            raise OutputError(
                f"{error}; the finished batches are kept, and the same command goes on from there"
            ) from error


def _differences(there: Any, ours: Any, free: Sequence[str]) -> str:
    """Text of the differences of two tables of plain data, apart from their keys of ``free``."""
    first, second = ({k: v for k, v in table.items() if k not in free} for table in (there, ours))
    lines = [
        f"{path} is {_shown(before)} there and {_shown(now)} here"
        for path, before, now in differing(first, second)
    ]
    rest = len(lines) - _MOST_DIFFERENCES
    text = ", ".join(lines[:_MOST_DIFFERENCES]) or "it was made by another version of the program"
    return f"{text} and {rest} more" if rest > 0 else text


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("path") or value.get("name") or "a table")
    return "missing" if value is None else clipped(json.dumps(value), LONGEST)
