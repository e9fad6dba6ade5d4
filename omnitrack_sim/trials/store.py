"""The table of a sweep: its columns with units, and rows as Arrow."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.writing import check_folder, is_workshop, told, write_file
from omnitrack_sim.record.metrics import METRICS, Metric
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.tables import unit_of
from omnitrack_sim.show.plots.style import attempt
from omnitrack_sim.trials.axes import BASE
from omnitrack_sim.trials.batches import Batch, Row
from omnitrack_sim.trials.sweep import FOR_THE_RECORD, Sweep

if TYPE_CHECKING:
    import pyarrow as pa
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


SWEEP_FILE, TABLE_FILE, CSV_FILE, SUMMARY_FILE, MAP_FILE = (
    "sweep.json",
    "trials.parquet",
    "trials.csv",
    "summary.json",
    "success_map.png",
)
PARTS = "parts"
_OURS = {SWEEP_FILE, TABLE_FILE, CSV_FILE, SUMMARY_FILE, MAP_FILE, PARTS}
_MOST_TOLD = 5
"""How many differences of two sweeps a message names."""


class Folder:
    """The folder of one sweep.

    Attributes:
        renamed: whether name, groups or labels of the sweep have changed since it was begun.

    Raises:
        OutputError: it holds another sweep or other files, or cannot be written.
    """

    def __init__(self, directory: str | Path, sweep: Sweep, layout: Layout):
        self.path, self.layout = Path(directory), layout
        check_folder(self.path)
        with told(self.path):
            self._open(sweep)

    def _open(self, sweep: Sweep) -> None:
        ours = {"sha256": sweep.hash, "sweep": sweep.model_dump(mode="json")}
        there = self._there() if self.path.is_dir() else None
        if there is not None and there["sha256"] != ours["sha256"]:
            raise OutputError(
                f"{self.path}: holds a different sweep: "
                f"{told_differences(there['sweep'], ours['sweep'], FOR_THE_RECORD)}; choose "
                "another folder with --out, or remove this one to begin anew"
            )
        (self.path / PARTS).mkdir(parents=True, exist_ok=True)
        check_folder(self.path / PARTS)
        self._description = (json.dumps(ours | environment(), indent=2) + "\n").encode()
        self.renamed = there is not None and there["sweep"] != ours["sweep"]
        if there is None:
            write_file(self.path / SWEEP_FILE, self._description)

    def _there(self) -> dict[str, Any] | None:
        """What ``sweep.json`` says; None in a folder that holds nothing yet, or part files only."""
        strange = [
            p.name for p in self.path.iterdir() if p.name not in _OURS and not is_workshop(p.name)
        ]
        file = self.path / SWEEP_FILE
        if not file.is_file():
            if strange:
                raise OutputError(
                    f"{self.path}: holds {strange[0]!r} but no {SWEEP_FILE}, so it is no sweep; "
                    "choose another folder"
                )
            return None
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            return {"sha256": data["sha256"], "sweep": data["sweep"]}
        except (ValueError, KeyError, TypeError, RecursionError, MemoryError) as error:
            raise OutputError(
                f"{file}: is no description of a sweep ({error}); choose another folder"
            ) from error

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where its file is missing or damaged."""
        return read_part(self._file(batch), batch, self.layout.schema)

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        with kept(self.path):
            write_file(self._file(batch), to_parquet(table))

    def finished(self) -> pa.Table | None:
        """The whole table, if the sweep is finished and all its files are there."""
        if not all((self.path / name).is_file() for name in (CSV_FILE, SUMMARY_FILE, MAP_FILE)):
            return None
        try:
            table = from_parquet((self.path / TABLE_FILE).read_bytes())
        except Exception:  # as in ``read``; the table is made again from the batches
            return None
        ours = (
            table.schema.equals(self.layout.schema, check_metadata=True)
            and table.num_rows == self.layout.total
        )
        return table if ours else None

    def summary(self) -> Any:
        """What ``summary.json`` says; None where it is missing or damaged."""
        try:
            return json.loads((self.path / SUMMARY_FILE).read_bytes())
        except (OSError, ValueError, RecursionError, MemoryError):
            return None

    def finish(
        self, table: pa.Table, summary: Mapping[str, Any], draw: Callable[[], bytes]
    ) -> None:
        """Write the files of a finished sweep, the table before the figure: one that cannot be
        drawn is told as a warning, and the same command tries again."""
        with kept(self.path):
            write_file(self.path / CSV_FILE, to_csv(table))
            write_file(self.path / SUMMARY_FILE, (json.dumps(summary, indent=2) + "\n").encode())
            if self.renamed:
                write_file(self.path / SWEEP_FILE, self._description)
            (self.path / MAP_FILE).unlink(missing_ok=True)
            write_file(self.path / TABLE_FILE, to_parquet(table))
            figure = attempt(MAP_FILE, draw)
            if figure is not None:
                write_file(self.path / MAP_FILE, figure)

    def _file(self, batch: Batch) -> Path:
        return self.path / PARTS / f"{batch.number:06d}-{batch.hash}.parquet"


class Memory:
    """The batches of a sweep that is not written to a folder."""

    def __init__(self) -> None:
        self._tables: dict[int, pa.Table] = {}

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where it is not done."""
        return self._tables.get(batch.number)

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        self._tables[batch.number] = table


def holds_sweep(directory: str | Path) -> bool:
    """Whether a sweep was begun in a folder."""
    return (Path(directory) / SWEEP_FILE).is_file()


def read_part(file: Path, batch: Batch, schema: pa.Schema) -> pa.Table | None:
    """The rows of a batch from its part file; None where this is missing, damaged, or of other
    trials.

    Args:
        file: of the batch.
        batch: whose rows they shall be.
        schema: of tables of batches; its own metadata do not count.
    """
    try:
        table = from_parquet(file.read_bytes())
        made_by(table)
    except Exception:  # decoders raise anything on damaged bytes; the batch is run again
        return None
    whole = (table.schema.metadata or {}).get(b"part") == batch.hash.encode()
    whole = whole and table.schema.remove_metadata().equals(schema.remove_metadata())
    numbers = [trial.index for trial in batch.trials]
    return table if whole and table["trial"].to_pylist() == numbers else None


@contextlib.contextmanager
def kept(path: Path) -> Iterator[None]:
    """Say what to do when something cannot be written into the folder of a sweep or study."""
    try:
        with told(path):
            yield
    except OutputError as error:
        raise OutputError(
            f"{error}; the finished batches are kept, and the same command goes on from there"
        ) from error


def told_differences(there: Any, ours: Any, free: Collection[str]) -> str:
    """Where two tables of plain data differ, as text; their own keys of ``free`` may differ."""
    first, second = ({k: v for k, v in table.items() if k not in free} for table in (there, ours))
    found = list(_differences(first, second, ""))
    more = f" and {len(found) - _MOST_TOLD} more" if len(found) > _MOST_TOLD else ""
    return (", ".join(found[:_MOST_TOLD]) or "it was made by another version of the program") + more


def _differences(there: Any, ours: Any, path: str) -> Iterator[str]:
    if isinstance(there, dict) and isinstance(ours, dict):
        for key in [*there, *(key for key in ours if key not in there)]:
            yield from _differences(
                there.get(key, _Nothing), ours.get(key, _Nothing), f"{path}.{key}".lstrip(".")
            )
    elif isinstance(there, list) and isinstance(ours, list):
        for i in range(max(len(there), len(ours))):
            pair = [items[i] if i < len(items) else _Nothing for items in (there, ours)]
            yield from _differences(pair[0], pair[1], f"{path}.{i}")
    elif there != ours:
        yield f"{path} is {_shown(there)} there and {_shown(ours)} here"


class _Nothing:
    """What stands where there is no such key."""


def _shown(value: Any) -> str:
    if value is _Nothing:
        return "missing"
    if isinstance(value, dict):
        return str(value.get("path") or value.get("name") or "a table")
    return json.dumps(value)
