"""Columns of numbers in files that loggers write: CSV, Parquet, MCAP and bags of ROS 2."""

from __future__ import annotations

import csv
import importlib
import io
import json
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.bounds import MAX_SAMPLES
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import read_bytes, size_of
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import installing

MAX_LOG_BYTES = 500_000_000
"""Largest file of a log that is read: five columns at 1 kHz for a day of work."""
_NOTHING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Texts of cells in which nothing was read, in lower case."""


@dataclass(frozen=True)
class Columns:
    """Columns of a file.

    Attributes:
        values: (T,) each by their heads; NaN where nothing was read.
        line: from the index of a sample to its line, row or message in the file, from 1.
    """

    values: Mapping[str, Array]
    line: Callable[[int], int]


def read_columns(path: Path, wanted: Sequence[str] | None = None) -> Columns:
    """Read columns of numbers from a file, by the ending of its name.

    Args:
        path: a regular file.
        wanted: heads of the columns to be read; None: all that hold numbers.

    Raises:
        InputError: it cannot be read, a column is missing, or a cell is no number; with the line.
    """
    readers = {".csv": _from_csv, ".txt": _from_csv, ".tsv": _from_csv}
    readers |= {".parquet": _from_parquet, ".mcap": _from_mcap, ".db3": _from_ros}
    ending = path.suffix.lower()
    if ending not in readers:
        problem = f"ends in {ending!r}; a log is a file of these, or a table that names one"
        raise InputError(Fault(str(path), problem, (".csv", ".parquet", ".mcap", ".db3", ".toml")))
    try:
        return readers[ending](path, wanted)
    except OSError as error:
        raise InputError(Fault(str(path), f"cannot be read: {error.strerror}")) from error
    except ValueError as error:
        raise InputError(Fault(str(path), str(error))) from error


def _refuse_missing(path: Path, heads: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """Return the heads of the columns to be read.

    Raises:
        InputError: some of those that are wanted are not there.
    """
    missing = [name for name in dict.fromkeys(wanted or ()) if name not in heads]
    if missing:
        where = str(path)
        faults = [Fault(where, f"has no column {name!r}", tuple(heads), name) for name in missing]
        raise InputError(faults)
    return list(heads if wanted is None else dict.fromkeys(wanted))


def _from_csv(path: Path, wanted: Sequence[str] | None) -> Columns:
    try:
        text = read_bytes(path, MAX_LOG_BYTES, " of CSV").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is no text in UTF-8") from None
    lines = text.splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), None)
    if first is None:
        raise ValueError("is empty")
    delimiter = max(",;\t", key=lines[first].count)
    reader = csv.reader(io.StringIO("\n".join(lines[first:])), delimiter=delimiter)
    heads = [head.strip() for head in next(reader)]
    if len(set(heads)) < len(heads):
        twice = next(head for head in heads if heads.count(head) > 1)
        raise ValueError(f"has two columns of the name {twice!r}")
    chosen = _refuse_missing(path, heads, wanted)
    rows = [(first + reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    for number, row in rows:
        if len(row) != len(heads):
            problem = f"line {number} has {len(row)} cells; the first one has {len(heads)}"
            raise ValueError(problem)
    if len(rows) > MAX_SAMPLES:
        raise ValueError(f"has {len(rows)} rows; at most {MAX_SAMPLES}")
    comma = delimiter != ","
    values = {}
    for head in chosen:
        own = _numbers(rows, heads.index(head), head, comma, strict=wanted is not None)
        if own is not None:
            values[head] = own
    return Columns(values, lambda i: rows[i][0])


def _numbers(
    rows: Sequence[tuple[int, list[str]]], at: int, head: str, comma: bool, strict: bool
) -> Array | None:
    """Return the numbers of a column; None for one of words that nobody asked for."""
    cells = [row[at].strip() for _, row in rows]
    values, bad = np.full(len(cells), np.nan), []
    for i, cell in enumerate(cells):
        try:
            values[i] = float(cell.replace(",", ".") if comma else cell)
        except ValueError:
            if cell.lower() not in _NOTHING:
                bad.append(i)
    if bad and not strict and 2 * len(bad) > len(cells):
        return None
    if bad:
        number, cell = rows[bad[0]][0], cells[bad[0]]
        raise ValueError(f"line {number}: {cell!r} in the column {head!r} is no number")
    values[~np.isfinite(values)] = np.nan
    return values


def _from_parquet(path: Path, wanted: Sequence[str] | None) -> Columns:
    import pyarrow as pa
    import pyarrow.types as kinds

    from omnitrack_sim.results.files import opened

    try:
        file = opened(path)
        names = file.schema_arrow.names
        chosen = _refuse_missing(path, names, wanted)
        table = file.read(columns=chosen, use_threads=False)
    except InputError as error:
        raise InputError([fault.at(str(path)) for fault in error.faults]) from None
    except pa.ArrowException as error:
        raise ValueError(f"is damaged, or no Parquet file: {error}") from error
    values = {}
    for name in chosen:
        column = table[name]
        if kinds.is_integer(column.type) or kinds.is_floating(column.type):
            values[name] = column.to_numpy().astype(float)
        elif wanted is not None:
            raise ValueError(f"holds {column.type} in the column {name!r}, no numbers")
    return Columns(values, lambda i: i + 1)


MESSAGE_TIME = "time"
"""Column of the times of messages, s from the first one."""
_ENCODINGS = ("json", "protobuf", "cdr")
MAX_LIST = 32
"""Longest list in a message whose items become columns: longer ones are pictures and meshes."""

Message = tuple[int, str, Any]
"""Time, ns, topic and contents of a message."""


def _from_mcap(path: Path, wanted: Sequence[str] | None) -> Columns:
    """Read messages of JSON, protobuf and ROS 2 as columns ``/topic.field``."""
    try:
        from mcap.exceptions import McapError
    except ImportError as error:
        raise ImportError(f"a log of MCAP needs mcap: {installing('mcap')}") from error
    size_of(path, MAX_LOG_BYTES)
    skipped: set[str] = set()
    try:
        rows = _rows_of(_mcap_messages(path, skipped))
    except (McapError, struct.error, EOFError) as error:
        raise ValueError(f"is damaged, or no file of MCAP: {error}") from error
    if not rows:
        problem = f"has no messages of {', '.join(_ENCODINGS)}"
        raise ValueError(problem + (f"; it has {', '.join(sorted(skipped))}" if skipped else ""))
    return _columns_of(rows, path, wanted)


def _mcap_messages(path: Path, skipped: set[str]) -> Iterator[Message]:
    """Yield the messages of a file of MCAP; topics of other encodings are added to ``skipped``."""
    from mcap.reader import make_reader

    decoders: dict[int, Callable[[bytes], Any]] = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding not in _ENCODINGS:
                skipped.add(f"{channel.topic} ({channel.message_encoding})")
                continue
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(channel.message_encoding, schema)
            yield message.log_time, channel.topic, decoders[channel.id](message.data)


def _from_ros(path: Path, wanted: Sequence[str] | None) -> Columns:
    """Read the bag of ROS 2 that a file of SQLite is of, with its metadata.yaml beside it."""
    highlevel = _rosbags("highlevel")
    size_of(path, MAX_LOG_BYTES)
    typestore = _rosbags("typesys").get_typestore(_rosbags("typesys").Stores.LATEST)
    try:
        with highlevel.AnyReader([path.parent], default_typestore=typestore) as reader:
            rows = _rows_of(
                (time, one.topic, reader.deserialize(data, one.msgtype))
                for one, time, data in reader.messages()
            )
    except (highlevel.AnyReaderError, struct.error, LookupError) as error:
        raise ValueError(f"is damaged, or no bag of ROS 2: {error}") from error
    if not rows:
        raise ValueError("has no messages")
    return _columns_of(rows, path, wanted)


def _rosbags(module: str) -> Any:
    """Return a module of rosbags, which reads what ROS 2 writes."""
    try:
        return importlib.import_module(f"rosbags.{module}")
    except ImportError as error:
        raise ImportError(f"a log of ROS 2 needs rosbags: {installing('ros')}") from error


def _rows_of(messages: Iterable[Message]) -> dict[int, dict[str, float]]:
    """Return the numbers in messages by time, ns, and column.

    Raises:
        ValueError: there are too many.
    """
    rows: dict[int, dict[str, float]] = {}
    for time, topic, contents in messages:
        rows.setdefault(time, {}).update(_leaves(contents, topic))
        if len(rows) > MAX_SAMPLES:
            raise ValueError(f"has more than {MAX_SAMPLES} times of messages")
    return rows


def _columns_of(
    rows: Mapping[int, Mapping[str, float]], path: Path, wanted: Sequence[str] | None
) -> Columns:
    """Return the numbers of messages as columns over all their times."""
    times = sorted(rows)
    heads = [MESSAGE_TIME, *dict.fromkeys(name for time in times for name in rows[time])]
    chosen = _refuse_missing(path, heads, wanted)
    values = {
        name: np.array([rows[time].get(name, np.nan) for time in times], float)
        for name in chosen
        if name != MESSAGE_TIME
    }
    values[MESSAGE_TIME] = 1e-9 * (np.array(times, np.int64) - times[0])
    return Columns(values, lambda i: i + 1)


def _decoder(encoding: str, schema: Any) -> Callable[[bytes], Any]:
    """Return what turns a message's bytes into plain data."""
    if encoding == "json":
        return json.loads
    if encoding == "cdr":
        types = _rosbags("typesys")
        store = types.get_typestore(types.Stores.EMPTY)
        store.register(types.get_types_from_msg(schema.data.decode(), schema.name))
        return lambda data: store.deserialize_cdr(data, schema.name)
    from google.protobuf import descriptor_pb2, message_factory
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.json_format import MessageToDict

    pool = DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return lambda data: MessageToDict(
        kind.FromString(data),
        preserving_proto_field_name=True,
        always_print_fields_with_no_presence=True,  # zeros, which the encoding leaves out
    )


def _leaves(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Yield the numbers in plain data, or in the objects of a message of ROS, by their paths."""
    if is_dataclass(value):
        value = vars(value)
    elif isinstance(value, np.ndarray):
        value = value.tolist() if value.size <= MAX_LIST else ()
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{name}.{key}")
    elif isinstance(value, list) and len(value) <= MAX_LIST:
        for i, item in enumerate(value):
            yield from _leaves(item, f"{name}.{i}")
    elif isinstance(value, int | float):
        yield name, float(value)
