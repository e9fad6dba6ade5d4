"""The table of a sweep: its columns with units, and rows as Arrow."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnitrack_sim.record.metrics import METRICS, Metric
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.tables import unit_of
from omnitrack_sim.trials.sweep.axes import BASE
from omnitrack_sim.trials.sweep.batch import Row
from omnitrack_sim.trials.sweep.spec import Sweep
from omnitrack_sim.trials.sweep.trials import Batch

if TYPE_CHECKING:
    import pyarrow as pa

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


class Layout:
    """The columns of a sweep's table, and the axis values in them.

    Attributes:
        schema: of the table, with the ``sha256`` of the sweep in its metadata and the units in
            those of the fields.
        total: number of rows.
    """

    def __init__(self, sweep: Sweep):
        import pyarrow as pa

        self.total = sweep.size
        self._values: dict[str, Sequence[Any]] = {}
        fields = [pa.field("trial", pa.int64(), metadata={"unit": "1"})]
        for name, values in sweep.trials().items():
            for column, items in _columns_of(name, values).items():
                self._values[column] = items
                fields.append(_field(column, _type(items), None if name == BASE else unit_of(name)))
        fields += result_fields(sweep.bases.values())
        self.schema = pa.schema(fields, metadata={"sweep_sha256": sweep.hash})

    def table(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """The rows of a batch, with its hash and what made it in the metadata."""
        import pyarrow as pa

        columns = []
        for field in self.schema:
            if field.name in self._values:
                values = [self._values[field.name][row["trial"]] for row in rows]
            else:
                values = [
                    batch.model if field.name == "model" else row.get(field.name) for row in rows
                ]
            columns.append(pa.array(values, field.type))
        metadata = {"part": batch.hash, "made_by": json.dumps(made_by, sort_keys=True)}
        return pa.Table.from_arrays(columns, schema=self.schema.with_metadata(metadata))

    def merged(self, tables: Sequence[pa.Table]) -> pa.Table:
        """The rows of all batches in the order of the trials, in one piece."""
        import pyarrow as pa

        plain = [table.replace_schema_metadata(self.schema.metadata) for table in tables]
        if not plain:
            return self.schema.empty_table()
        return pa.concat_tables(plain).sort_by("trial").combine_chunks()


def result_fields(bases: Iterable[Scenario]) -> list[pa.Field]:
    """The columns that tell how trials of these scenarios ended."""
    import pyarrow as pa

    own = {metric.name: metric for base in bases for metric in base.own_metrics}
    return [
        _field("model", pa.string()),
        _field("scenario_sha256", pa.string()),
        _field("outcome", pa.string()),
        _field("success", pa.bool_()),
        _field("duration_s", pa.float64(), "s"),
        _field("reason", pa.string()),
        *(
            _field(column, pa.float64(), metric.unit)
            for metric in (*METRICS, *own.values())
            if metric.in_tables
            for column in metric_columns(metric)
        ),
        _field("attempts", pa.int64(), "1"),
        _field("falls", pa.int64(), "1"),
        _field("collider", pa.string()),
        _field("events", pa.string()),
    ]


def metric_columns(metric: Metric) -> list[str]:
    """The columns of a metric: one, or one for each module."""
    if not metric.per_module:
        return [metric.name]
    return [f"{metric.name}_{i}" for i in range(1, MODULES + 1)]


def to_parquet(table: pa.Table) -> bytes:
    """A table as the bytes of a file."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(table, buffer, **PARQUET)
    return buffer.getvalue()


def from_parquet(data: bytes) -> pa.Table:
    """The table of a file's bytes.

    Raises:
        OSError, pyarrow.ArrowException: they are damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    return pq.read_table(pa.BufferReader(data), page_checksum_verification=True)


def made_by(table: pa.Table) -> str:
    """What made the rows of a batch, as JSON.

    Raises:
        KeyError, ValueError: its file is damaged.
    """
    text = table.schema.metadata[b"made_by"].decode()
    return json.dumps(json.loads(text), sort_keys=True)


def to_csv(table: pa.Table) -> bytes:
    """A table as the bytes of a CSV file."""
    from pyarrow import csv

    buffer = io.BytesIO()
    csv.write_csv(table, buffer)
    return buffer.getvalue()


def _columns_of(name: str, values: Sequence[Any]) -> dict[str, Sequence[Any]]:
    """The values of an axis as plain columns.

    Vectors become x, y and z; what is neither number, text nor truth value becomes JSON.
    """
    if _are_vectors(values):
        return {
            f"{name}_{letter}": [float(value[i]) for value in values]
            for i, letter in enumerate(XYZ)
        }
    kinds = {type(value) for value in values}
    if kinds <= {int, float} or kinds == {bool} or kinds == {str}:
        return {name: [float(value) for value in values] if kinds == {int, float} else values}
    return {name: [value if isinstance(value, str) else json.dumps(value) for value in values]}


def _are_vectors(values: Sequence[Any]) -> bool:
    def is_vector(value: Any) -> bool:
        return (
            isinstance(value, list)
            and len(value) == len(XYZ)
            and all(type(item) in (int, float) for item in value)
        )

    return all(is_vector(value) for value in values)


def _type(values: Sequence[Any]) -> pa.DataType:
    import pyarrow as pa

    return {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}[
        type(values[0])
    ]


def _field(name: str, kind: pa.DataType, unit: str | None = None) -> pa.Field:
    import pyarrow as pa

    return pa.field(name, kind, metadata=None if unit is None else {"unit": unit})
