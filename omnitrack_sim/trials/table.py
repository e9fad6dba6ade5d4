"""Tables of trials: one row a trial, with the columns of its plan, its outcome and its metrics."""

from __future__ import annotations

import io
import itertools
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pyarrow import csv

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import FORMULA, NUMBER, counted
from omnitrack_sim.trials.batches import ERROR, INVALID, Batch, Rows

XYZ = "xyz"
PARQUET: dict[str, Any] = {
    "compression": "zstd",
    "compression_level": 3,
    "version": "2.6",
    "data_page_version": "1.0",
    "row_group_size": 65536,
    "write_page_checksum": True,
}
"""Settings of the files. They are fixed, so that the same rows give the same bytes."""
_MAX_REASONS = 3
"""Largest number of reasons of invalid trials in a message."""


def column(name: str, kind: pa.DataType, unit: str | None = None) -> pa.Field:
    """Return a column of a table, with its unit in the metadata if it has one."""
    return pa.field(name, kind, metadata=None if unit is None else {"unit": unit})


TRIAL = column("trial", pa.int64(), "1")
BEFORE = (
    column("model", pa.string()),
    column("scenario_sha256", pa.string()),
    column("outcome", pa.string()),
    column("success", pa.bool_()),
    column("duration_s", pa.float64(), "s"),
    column("reason", pa.string()),
)
"""Columns of the results before the metrics."""
BEHIND = (
    column("attempts", pa.int64(), "1"),
    column("falls", pa.int64(), "1"),
    column("collider", pa.string()),
    column("events", pa.string()),
)
"""Columns of the results behind the metrics."""


def part_table(batch: Batch, results: Rows) -> pa.Table:
    """Return the rows of a batch, with its hash and provenance in the metadata."""
    metrics = [column(name, pa.float64(), unit or None) for name, unit in results.units.items()]
    # The hash makes sure that a part file is not of a batch with other values under the same name.
    metadata = {"part": batch.hash, "made_by": json.dumps(results.made_by, sort_keys=True)}
    rows = [{"model": batch.model, **row} for row in results.rows]
    return pa.Table.from_pylist(rows, pa.schema([*BEFORE, *metrics, *BEHIND], metadata))


def is_part(table: pa.Table) -> bool:
    """Return whether a table has the columns of ``part_table``, and no others."""
    metrics = table.column_names[len(BEFORE) : -len(BEHIND)]
    fields = [column(name, pa.float64()) for name in metrics]
    return table.schema.equals(pa.schema([*BEFORE, *fields, *BEHIND]))


def made_by(part: pa.Table) -> str:
    """Return provenance of the rows of a batch (versions, commit), as JSON.

    Raises:
        KeyError, ValueError: its file is damaged.
    """
    text = part.schema.metadata[b"made_by"].decode()
    return json.dumps(json.loads(text), sort_keys=True)


def trials_table(
    batches: Sequence[Batch],
    parts: Sequence[pa.Table],
    columns: Mapping[str, Sequence[Any]],
    units: Mapping[str, str | None],
    first: int = 0,
) -> pa.Table:
    """Return the rows of batches in the order of their trials.

    Args:
        batches: of one round.
        parts: the table of each.
        columns: of the plan, see ``Round``.
        units: of these.
        first: number of the round's first trial.
    """
    indices = np.array([trial.index for batch in batches for trial in batch.trials], int)
    order = np.argsort(indices)
    results = joined(parts).take(pa.array(order))
    table = pa.table([pa.array(indices[order] + first)], pa.schema([TRIAL]))
    for name, values in columns.items():
        for field, cells in _columns_of(name, values, units.get(name)):
            table = table.append_column(field, pa.array(cells, field.type).take(indices[order]))
    for field in results.schema:
        table = table.append_column(field, results[field.name])
    return table


def joined(tables: Iterable[pa.Table]) -> pa.Table:
    """Return the rows of tables in one piece; what some tables lack is null in their rows."""
    # Tables with different metadata do not join.
    plain = [table.replace_schema_metadata(None) for table in tables]
    plain = plain or [pa.schema([*BEFORE, *BEHIND]).empty_table()]
    whole = pa.concat_tables(plain, promote_options="default")
    behind = [field.name for field in BEHIND if field.name in whole.column_names]
    names = [name for name in whole.column_names if name not in behind]
    # In one piece, since the division into batches would show in the bytes of the file.
    return whole.select([*names, *behind]).combine_chunks()


def _columns_of(
    name: str, values: Sequence[Any], unit: str | None
) -> list[tuple[pa.Field, Sequence[Any]]]:
    """A plan's values as plain columns."""
    known = [value for value in values if value is not None]
    if known and all(_is_vector(value) for value in known):
        parts = [[None if value is None else float(value[i]) for value in values] for i in range(3)]
        fields = [column(f"{name}_{letter}", pa.float64(), unit) for letter in XYZ]
        return list(zip(fields, parts, strict=True))
    kinds = {type(value) for value in known}
    # The type is compared, not isinstance: a truth value is an int to Python.
    plain = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    if kinds == {int, float}:
        kinds = {float}
    if len(kinds) == 1 and (kind := plain.get(*kinds)):
        return [(column(name, kind, unit), values)]
    texts = [value if isinstance(value, str | None) else json.dumps(value) for value in values]
    return [(column(name, pa.string(), unit), texts)]


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
    names = [f"'{name}" if re.match(FORMULA, name) else name for name in table.column_names]
    columns = [_inert(column) for column in table.columns]
    buffer = io.BytesIO()
    csv.write_csv(pa.table(columns, names), buffer)
    return buffer.getvalue()


def _inert(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column whose texts no spreadsheet takes for formulas; see ``csv_text``."""
    if not pa.types.is_string(column.type):
        return column
    begins, is_number = (pc.match_substring_regex(column, rule) for rule in (FORMULA, NUMBER))
    quoted = pc.binary_join_element_wise("'", column, "")
    return pc.if_else(pc.and_not(begins, is_number), quoted, column)


def to_json(data: Any) -> bytes:
    """Return plain data as the bytes of a JSON file."""
    return (json.dumps(data, indent=2) + "\n").encode()


def unit_in(table: pa.Table, name: str) -> str | None:
    """Return the unit of a column of a table; None where there is no such column, or no unit."""
    about = table.schema.field(name).metadata if name in table.column_names else None
    return None if about is None else about.get(b"unit", b"").decode() or None


def numbers_of(table: pa.Table, name: str) -> Array:
    """Return the numbers in a column of a table; NaN where it has none."""
    return np.array([np.nan if v is None else v for v in table[name].to_pylist()], float)


def metric_columns(table: pa.Table, name: str) -> list[str]:
    """Return the column of a metric, or those of the modules that it has a value of each of."""
    if name in table.column_names:
        return [name]
    own = (f"{name}_{i}" for i in itertools.count(1))
    return list(itertools.takewhile(set(table.column_names).__contains__, own))


def passed_of(table: pa.Table) -> Array:
    """Return 1 for each trial that passed, 0 for one that failed, NaN without a robot's outcome."""
    ends = zip(table["outcome"].to_pylist(), table["success"].to_pylist(), strict=True)
    return np.array([np.nan if end in (INVALID, ERROR) else float(ok) for end, ok in ends])


def failures(table: pa.Table, count: int) -> list[int]:
    """Return numbers of trials whose robots failed: one of each outcome, then the next of each."""
    of: dict[str, list[int]] = {}
    rows = zip(table["trial"].to_pylist(), table["outcome"].to_pylist(), strict=True)
    for (trial, outcome), passed in zip(rows, passed_of(table), strict=True):
        if passed == 0:
            of.setdefault(outcome, []).append(trial)
    in_turn = itertools.zip_longest(*of.values())
    return [trial for each in in_turn for trial in each if trial is not None][:count]


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
        raise error([fault, *(Fault("", reason) for reason in reasons[:_MAX_REASONS])])
