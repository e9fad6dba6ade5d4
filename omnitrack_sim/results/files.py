"""Files of a run's folder: writing and reading its tables."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.bounds import MAX_COLUMNS, MAX_SAMPLES, MAX_TABLE_BYTES, MAX_TEXT
from omnitrack_sim.base.errors import InputError, OutputError
from omnitrack_sim.base.naming import NotTrustedError
from omnitrack_sim.base.reading import in_folder, size_of
from omnitrack_sim.base.text import csv_text
from omnitrack_sim.base.writing import npz_of
from omnitrack_sim.record.channels import Channel, Display, Labelled, Vector, recorded
from omnitrack_sim.record.timeline import PassageRecord
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.recorded import is_recorded
from omnitrack_sim.robots.robot import Robot

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

RESULT_FILE, SCENARIO_FILE, TIMELINE_FILE, TRAJECTORY_FILE, REPLAY_FILE, MAP_FILE = (
    "result.json",
    "scenario.json",
    "timeline.csv",
    "trajectory.parquet",
    "replay.npz",
    "map.toml",
)
"""A run is read back from all but the timeline, which is derived. Only runs of robots that explore
have a map."""


def write_timeline(records: list[PassageRecord], path: Path) -> None:
    """Write one row a passage, with numbers that read back exactly; missing values are empty."""
    names = [field.name for field in dataclasses.fields(PassageRecord)]
    path.write_bytes(
        csv_text([names, *(dataclasses.astuple(record) for record in records)]).encode()
    )


def write_trajectory(trajectory: Trajectory, folder: Path, robot: Robot) -> None:
    """Write the channels and joint positions of a trajectory of a robot, a file each."""
    _write_parquet(trajectory, folder / TRAJECTORY_FILE, robot)
    arrays = {"time": trajectory.time, "qpos": trajectory.qpos}
    (folder / REPLAY_FILE).write_bytes(npz_of(arrays))


def read_trajectory(folder: Path, robot: Robot) -> Trajectory:
    """Read and check the trajectory in the folder of a run of a robot.

    Raises:
        OutputError: a file is missing or damaged, or the two do not belong together.
    """
    with reading(folder / TRAJECTORY_FILE) as path:
        # A recorded robot's are all described in the file.
        known = {} if is_recorded(robot) else recorded(robot.channels.values())
        time, channels, phases, schema = _read_parquet(path, known)
    with reading(folder / REPLAY_FILE) as path:
        # Shafts of a drive add joints, so the scenario decides how many positions a sample has.
        replayed, qpos = _read_npz(path, len(time), robot.joint_count)
        if not np.array_equal(replayed, time):
            raise _OtherRun("other times")
        return Trajectory(time, channels, phases, qpos, schema)


class _OtherRun(ValueError):
    """Error of two files that are each intact but not of the same run."""

    def __init__(self, difference: str) -> None:
        super().__init__(f"is not of the same run as {TRAJECTORY_FILE}: {difference}")


@contextmanager
def reading(path: Path) -> Iterator[Path]:
    """Turn any exception while a file is read into an ``OutputError`` that names the file.

    On damaged bytes decoders raise anything: EOFError, MemoryError, KeyError, errors of their own.
    """
    try:
        yield path
    except FileNotFoundError as error:
        folder = path.parent
        if folder.exists():
            problem = f"is no run: {path.name} is missing{in_folder(folder)}"
            raise OutputError(f"{folder}: {problem}") from error
        raise OutputError(f"{folder}: no such folder") from error
    except NotADirectoryError as error:
        file = path.parent
        hint = f"; {file.parent} is one" if (file.parent / RESULT_FILE).exists() else ""
        raise OutputError(f"{file}: is a file; a run is the folder of its files{hint}") from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _OtherRun as error:
        raise OutputError(f"{path}: {error}") from error
    except NotTrustedError as error:
        raise OutputError(f"{path}: {error}") from error
    except InputError as error:
        cause = "; ".join(str(error).splitlines())
        raise OutputError(f"{path}: is damaged, or names what is not here: {cause}") from error
    except Exception as error:
        cause = str(error) or type(error).__name__
        raise OutputError(f"{path}: is damaged, or no file of a run: {cause}") from error


def opened(path: Path, rows: int = MAX_SAMPLES) -> pq.ParquetFile:
    """Open a Parquet file of at most ``rows`` rows for reading without threads.

    Threads abort a process that ends while they start; ``pq.read_table`` starts one even with
    ``use_threads=False``.

    Raises:
        OSError, ValueError: it cannot be read, is no regular file, or has more rows or columns.
    """
    import pyarrow.parquet as pq

    size_of(path, MAX_TABLE_BYTES)
    options = {"pre_buffer": False, "page_checksum_verification": True}
    file = pq.ParquetFile(str(path), **options)
    about = file.metadata
    # Before anything is unpacked: a few bytes may hold millions of equal rows, or of values in one.
    require(about.num_rows <= rows, f"has {about.num_rows} rows; at most {rows}")
    require(about.num_columns <= MAX_COLUMNS, f"has {about.num_columns} columns")
    for group in map(about.row_group, range(about.num_row_groups)):
        values = (group.column(i).num_values for i in range(group.num_columns))
        require(all(count == group.num_rows for count in values), "has lists in its rows")
    texts = [field.name for field in file.schema_arrow if str(field.type) in _TEXTS]
    if not texts:
        return file
    file.close()
    return pq.ParquetFile(str(path), read_dictionary=texts, **options)


def read_table(path: Path, rows: int, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a Parquet file with texts, which together are of ``MAX_TEXT`` bytes at most.

    Args:
        path: of the file.
        rows: at most.
        columns: names of those that are read; None: all.

    Raises:
        OSError, ValueError: see ``opened``. pyarrow.ArrowException: it is damaged.
    """
    import pyarrow as pa

    with opened(path, rows) as file:
        table = file.read(columns, use_threads=False)
    for number, field in enumerate(table.schema):
        if isinstance(field.type, pa.DictionaryType):
            text = table[field.name]
            require(sum(map(_text_size, text.chunks)) <= MAX_TEXT, f"{field.name} is too long")
            plain = pa.field(field.name, field.type.value_type, metadata=field.metadata)
            table = table.set_column(number, plain, text.cast(plain.type))
    return table


def _text_size(chunk: Any) -> int:
    """Return the number of bytes of the texts of an array, each of which is kept once."""
    import pyarrow.compute as pc

    sizes = pc.binary_length(chunk.dictionary)
    return pc.sum(pc.take(sizes, chunk.indices)).as_py() or 0


_TEXTS = ("string", "large_string", "binary", "large_binary")
"""Types of columns whose values have any length."""


def require(holds: bool | np.bool_, fault: str) -> None:
    """Raise a ``ValueError``, which ``reading`` completes, unless a condition holds."""
    if not holds:
        raise ValueError(fault)


def _write_parquet(trajectory: Trajectory, path: Path, robot: Robot) -> None:
    """Write one row a sample; metadata hold units and meanings of columns, and phase names."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = _schema(trajectory, robot)
    # Buffers have no strides; the times of one robot of a batch are a column of all.
    time = np.ascontiguousarray(trajectory.time)
    arrays = [time, *(values for _, _, values in trajectory.columns())]
    # From their buffers: ``pa.array`` would import pandas, to see whether it is given a Series.
    columns = [
        pa.Array.from_buffers(field.type, len(values), [None, pa.py_buffer(values)])
        for field, values in zip(schema, arrays, strict=True)
    ]
    table = pa.Table.from_arrays(columns, schema=schema)
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)


def _schema(trajectory: Trajectory, robot: Robot) -> pa.Schema:
    """Columns of the table of a trajectory, with its phases and its own channels."""
    import pyarrow as pa

    # The scenario tells the robot, and that its channels; a user's own sensors and robots need not
    # be there when the file is read, so their channels are described in it.
    all_own = is_recorded(robot)
    known = {} if all_own else robot.channels
    own = [_described(one, all_own) for name, one in trajectory.schema.items() if name not in known]
    about = {"phases": json.dumps(trajectory.phases), "own_channels": json.dumps(own)}
    return pa.schema(_fields(trajectory.schema), metadata=about)


def _described(channel: Channel, looks: bool) -> dict[str, Any]:
    """Return a user's own channel as plain data, with its appearance if ``looks``."""
    fields = [field.name for field in dataclasses.fields(Channel) if looks or field.name != "shown"]
    data = {name: getattr(channel, name) for name in fields}
    if data.get("shown") is not None:
        data["shown"] = dataclasses.asdict(data["shown"])
    kind = Vector if isinstance(channel, Vector) else Channel
    if channel.columns != kind(channel.name, channel.shape, "", "").columns:
        data["labels"] = channel.columns
    return data | {"vector": kind is Vector}


def _fields(schema: Mapping[str, Channel]) -> list[pa.Field]:
    """The columns of the table."""
    import pyarrow as pa

    fields = [pa.field("time", pa.float64(), metadata={"unit": "s", "meaning": "simulated time"})]
    for channel in schema.values():
        about = {"unit": channel.unit, "meaning": channel.meaning, "frame": channel.frame}
        kind = pa.int32() if channel.whole else pa.float64()
        fields += [pa.field(column, kind, metadata=about) for column in channel.columns]
    return fields


_Table = tuple[NDArray[np.float64], dict[str, NDArray], tuple[str, ...], dict[str, Channel]]


def _read_parquet(path: Path, known: Mapping[str, Channel]) -> _Table:
    """Read time, channels, names of the phases, and their schema; ``known`` is of the robot."""
    import pyarrow as pa

    with opened(path) as file:
        table = file.read(use_threads=False)
    about = table.schema.metadata
    schema = {**known}
    for data in json.loads(about[b"own_channels"]):
        channel = _own_channel(data, table.num_columns)
        require(channel.name not in schema, f"there are two channels {channel.name!r}")
        schema[channel.name] = channel
    actual, wanted = table.schema.remove_metadata(), pa.schema(_fields(schema)).remove_metadata()
    require(actual.equals(wanted), "its columns are not those of its channels")
    require(all(column.null_count == 0 for column in table.columns), "it has gaps")
    time, channels = table["time"].to_numpy(), {}
    for name, channel in schema.items():
        columns = [table[column].to_numpy() for column in channel.columns]
        # A robot without actuators has channels without numbers.
        values = np.stack(columns, axis=-1) if columns else np.zeros((table.num_rows, 0))
        channels[name] = values.reshape(table.num_rows, *channel.shape)
    phases = tuple(json.loads(about[b"phases"]))
    require(all(isinstance(name, str) for name in phases), "a name of a phase is no text")
    "".join(phases).encode()  # raises if there are halves of characters
    _require_order(time, channels, len(phases))
    return time, channels, phases, schema


def _require_order(time: NDArray[np.float64], channels: Mapping[str, NDArray], phases: int) -> None:
    """Refuse times, phases and gears that no run can have."""
    require(len(time) > 0, "it has no samples")
    require(np.isfinite(time).all() and (np.diff(time) > 0).all(), "its times do not increase")
    phase, gear = channels["phase"], channels["gear"]
    require(phase.min() >= 0 and phase.max() < phases, "it has phases without a name")
    require(np.isin(gear, (-1.0, 1.0)).all(), "it has gears that are neither 1 nor -1")


def _own_channel(data: dict[str, Any], most: int) -> Channel:
    """A channel of a user's own sensor, of at most ``most`` numbers."""
    kind = Vector if data.pop("vector") else Channel
    shape = tuple(data.pop("shape"))
    require(all(type(size) is int and size >= 0 for size in shape), f"a channel has shape {shape}")
    # A made-up shape would otherwise ask for any amount of memory.
    require(math.prod(shape) <= most, f"a channel has shape {shape}")
    words = [data[key] for key in ("name", "unit", "meaning", "frame")]
    require(all(isinstance(word, str) for word in words), "a channel's words are no text")
    names = tuple(data.pop("names", ()))
    require(all(isinstance(name, str) for name in names), "a name of a channel's is no text")
    require(len(names) in (0, math.prod(shape)), f"a channel has {len(names)} names")
    looks = data.pop("shown", None)
    shown = None if looks is None else Display(**looks)
    if shown is not None:
        require(_is_display(shown), "the looks of a channel are none")
    if (labels := data.pop("labels", None)) is None:
        return kind(shape=shape, names=names, shown=shown, **data)
    require(len(labels) == math.prod(shape), f"a channel has {len(labels)} columns")
    return Labelled(shape=shape, names=names, shown=shown, labels=tuple(map(str, labels)), **data)


def _is_display(shown: Display) -> bool:
    """Return whether the appearance of a channel has words and finite numbers in their places."""
    words = (shown.title, shown.unit, shown.command, shown.each)
    numbers = [n for n in (shown.scale, shown.low, shown.high, shown.span) if n is not None]
    return all(isinstance(word, str) for word in words) and all(
        type(number) in (int, float) and math.isfinite(number) for number in numbers
    )


def _read_npz(
    path: Path, samples: int, positions: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time (T,) and joint positions (T, nq) of a file with T ``samples`` of nq ``positions``."""
    shapes = {"time": (samples,), "qpos": (samples, positions)}
    arrays = {}
    size_of(path, MAX_TABLE_BYTES)
    with zipfile.ZipFile(path) as archive:
        for name, shape in shapes.items():
            entry = archive.getinfo(f"{name}.npy")
            most = 8 * math.prod(shape) + 1024  # the header of an array is far shorter
            # Looked at before anything is unpacked: a few bytes of zip may hold gigabytes.
            if entry.file_size > most:
                raise _OtherRun("more samples or joints")
            array = np.load(io.BytesIO(archive.read(entry)), allow_pickle=False)
            require(array.dtype == float, f"{name} holds {array.dtype}")
            if array.ndim > 0 and len(array) != samples:
                raise _OtherRun(f"{len(array)} samples, not {samples}")
            require(array.shape == shape, f"{name} has shape {array.shape}, expected {shape}")
            arrays[name] = array
    return arrays["time"], arrays["qpos"]
