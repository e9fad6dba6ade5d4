"""Pictures of the robots' cameras: buffered in a file, saved with the run, read one by one."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.writing import as_output_error
from omnitrack_sim.results.files import opened, reading, require
from omnitrack_sim.senses.optics import Camera

if TYPE_CHECKING:
    import pyarrow.parquet as pq

PICTURES_FILE = "pictures.parquet"
"""File in a run's folder, where ``record.pictures`` is true."""
MILLIMETRE = 1e-3
"""Step of the distances that are kept, m."""
_GROUP = 2**20
"""Bytes that are written, and read, at a time."""
_MIN_SIZE, _MAX_SIZE = 8, 512  # pixels, as ``OpticsTable.pixels`` has them


@dataclass(frozen=True)
class Coding:
    """Encoding of pixels: 8 bits of brightness, or 16 bits of distance in whole millimetres.

    A distance of 0 is a pixel without a measurement.

    Attributes:
        size: rows and columns.
        unit: "1" of brightness, 0 to 1; "m" of distances.
    """

    size: int
    unit: str

    @property
    def record(self) -> np.dtype[Any]:
        """One picture with its time, s, and the end that it is taken from, 1 nose and -1 tail."""
        pixel = "<u2" if self.unit == "m" else "u1"
        return np.dtype([("time", "<f8"), ("end", "i1"), ("pixels", pixel, (self.size**2,))])

    def coded(self, picture: Array) -> NDArray[np.uint8 | np.uint16]:
        """Encode pixels (..., k)."""
        known, kind = np.isfinite(picture), self.record["pixels"].base
        picture = np.where(known, picture, 0.0)
        if self.unit != "m":
            return np.round(255 * np.clip(picture, 0.0, 1.0)).astype(kind)
        # At least 1, since 0 stands for a pixel without a measurement.
        steps = np.clip(np.round(picture / MILLIMETRE), 1, 65535)
        return np.where(known, steps, 0).astype(kind)

    def pixels(self, coded: NDArray) -> Array:
        """Decode a picture (rows, columns) to ``unit``; NaN where there is no measurement."""
        square = coded.reshape(self.size, self.size).astype(float)
        if self.unit != "m":
            return square / 255
        return np.where(square > 0, square * MILLIMETRE, np.nan)


def coding_of(camera: Camera) -> Coding:
    """Return the encoding of a camera's pictures: brightness with a lamp, else distances."""
    return Coding(camera.optics.pixels, "m" if camera.lamp is None else "1")


class Pictures(Sequence[Array]):
    """Sequence of pictures of a robot's cameras, each read on demand.

    ``pictures[i]`` is a float array (rows, columns); x, towards module 1, is to the right, and NaN
    is a pixel without a measurement.

    Attributes:
        time: (P,) s. end: (P,) 1 from the nose, -1 from the tail.
        unit: of the pixels: "1" for brightness, 0 to 1; "m" for distances along their rays.
        size: rows and columns.
    """

    def __init__(
        self, coding: Coding, time: Array, end: NDArray[np.int8], records: NDArray | _SavedRecords
    ) -> None:
        self.time, self.end = time, end
        self._coding, self._records = coding, records

    @property
    def unit(self) -> str:
        """Unit of the values of a picture."""
        return self._coding.unit

    @property
    def size(self) -> int:
        """Number of values in a picture."""
        return self._coding.size

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"Pictures({len(self)} of {self.size} by {self.size} pixels, unit {self.unit})"

    @overload
    def __getitem__(self, index: int) -> Array: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Array]: ...

    def __getitem__(self, index: int | slice) -> Array | Sequence[Array]:
        """Return a picture, or a list of them.

        Raises:
            IndexError: there are fewer.
            OutputError: the file of the run is gone or damaged.
        """
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        place = range(len(self))[index]
        return self._coding.pixels(self._records[place : place + 1]["pixels"][0])

    def index_at(self, time: float, end: int) -> int | None:
        """Index of the last picture up to ``time`` s from an end (1 nose, -1 tail), if any."""
        known = np.flatnonzero((self.time <= time) & (self.end == end))
        return int(known[-1]) if len(known) else None

    def write(self, path: Path) -> None:
        """Write all pictures to a Parquet file, a part at a time."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = _schema(self._coding)
        options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
        with pq.ParquetWriter(path, schema, **options) as writer:
            for first, last in _groups(len(self), self._coding):
                part = self._records[first:last]
                octets = np.ascontiguousarray(part["pixels"])
                pixels = pa.FixedSizeBinaryArray.from_buffers(
                    schema.field("pixels").type, len(part), [None, pa.py_buffer(octets)]
                )
                columns = [pa.array(np.array(part[name])) for name in ("time", "end")]
                table = pa.Table.from_arrays([*columns, pixels], schema=schema)
                writer.write_table(table, row_group_size=len(part))


def read_pictures(folder: Path, end: float) -> Pictures:
    """Return the pictures in the folder of a run that ended at ``end`` s.

    So far only their times are read.

    Raises:
        OutputError: the file is missing or damaged.
    """
    with reading(folder / PICTURES_FILE) as path:
        with opened(path) as file:
            coding, rows = _coding_in(file), file.metadata.num_rows
            table = file.read(columns=["time", "end"], use_threads=False)
            groups = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        require(groups == [b - a for a, b in _groups(rows, coding)], "its parts are not whole")
        require(table.num_columns == 2 and not any(c.null_count for c in table.columns), "has gaps")
        time, ends = table["time"].to_numpy(), table["end"].to_numpy()
        require(len(time) > 0, "it has no pictures")
        require(np.isfinite(time).all() and (np.diff(time) > 0).all(), "its times do not increase")
        require(time[-1] <= end + 1e-6, "it has pictures from after the end of the run")
        require(np.isin(ends, (-1, 1)).all(), "it has ends that are neither 1 nor -1")
        return Pictures(coding, time, ends, _SavedRecords(path.absolute(), coding, rows))


class Album:
    """Recorder of the pictures of n robots, in a temporary file.

    The file vanishes with its last reader, at the latest with the process.

    Raises:
        OutputError: the system's temporary folder is full or closed to us.
    """

    def __init__(self, coding: Coding, n: int) -> None:
        self._coding, self._counts = coding, np.zeros(n, int)
        self._last = np.full(n, -np.inf)
        self._times: list[Array] = []
        self._ends: list[NDArray[np.int8]] = []
        self._place = tempfile.gettempdir()
        with as_output_error(self._place):
            # It has no name, so that nobody can leave it behind; readers have a hold of their own.
            self._file = tempfile.TemporaryFile()  # noqa: SIM115
        weakref.finalize(self, self._file.close)

    def add(
        self, time: Array, end: NDArray[np.int_], picture: Array, active: NDArray[np.bool_]
    ) -> None:
        """Record a picture (n, k) of each active robot at ``time`` (n,) s.

        It was taken from ``end`` (n,): 1 the nose, -1 the tail.
        """
        part = np.zeros(len(time), self._coding.record)
        part["time"], part["end"], part["pixels"] = time, end, self._coding.coded(picture)
        with as_output_error(self._place):
            # All robots share one interleaved file, so that a batch takes one descriptor.
            self._file.write(part.tobytes())
            self._file.flush()  # a full disk shows here
        # The clock of physics that has diverged begins anew.
        self._counts += active & (time > self._last)
        self._last = np.array(time)
        self._times.append(np.array(part["time"]))
        self._ends.append(np.array(part["end"]))

    def pictures(self) -> list[Pictures]:
        """Return the pictures of each robot, up to the end of its run."""
        shape = (len(self._times), len(self._counts))
        times, ends = np.reshape(self._times, shape), np.reshape(self._ends, shape)
        record = self._coding.record
        # An empty file cannot be mapped. A plain view of the map, unlike the map itself, travels to
        # another process as the pictures that it shows.
        file = np.memmap(self._file, record, "r", shape=shape) if self._times else []
        records = np.asarray(file, record).reshape(shape)
        return [
            Pictures(
                self._coding, times[:count, robot], ends[:count, robot], records[:count, robot]
            )
            for robot, count in enumerate(self._counts.tolist())
        ]


class _SavedRecords:
    """Records of the pictures in a run's folder. The part that was read last is kept."""

    def __init__(self, path: Path, coding: Coding, rows: int) -> None:
        self._path, self._coding = path, coding
        self._groups = list(_groups(rows, coding))
        self._at, self._part = -1, np.zeros(0, coding.record)

    def __getitem__(self, rows: slice) -> NDArray:
        """Return the records of these rows of one part.

        Raises:
            OutputError: the file is gone.
        """
        number = rows.start // _per_group(self._coding)
        begin, _ = self._groups[number]
        return self._group(number)[rows.start - begin : rows.stop - begin]

    def _group(self, number: int) -> NDArray:
        if number == self._at:
            return self._part
        first, last = self._groups[number]
        with reading(self._path) as path, opened(path) as file:
            # The folder may have been replaced since the times were read.
            require(_coding_in(file) == self._coding, "it is of another run by now")
            table = file.read_row_group(number, use_threads=False).combine_chunks()
            require(table.num_rows == last - first, "a part of it is not whole")
            part = np.zeros(last - first, self._coding.record)
            for name in ("time", "end"):
                part[name] = table[name].to_numpy()
            octets = b"".join(table["pixels"].to_pylist())
            pixels = np.frombuffer(octets, self._coding.record["pixels"].base)
            part["pixels"] = pixels.reshape(last - first, -1)
        self._at, self._part = number, part
        return part


def _per_group(coding: Coding) -> int:
    return max(1, _GROUP // coding.record.itemsize)


def _groups(rows: int, coding: Coding) -> Iterator[tuple[int, int]]:
    """First and last row of each part of a file of ``rows`` pictures."""
    each = _per_group(coding)
    return ((first, min(first + each, rows)) for first in range(0, rows, each))


def _schema(coding: Coding) -> Any:
    """Columns of the file; size and unit are in its metadata."""
    import pyarrow as pa

    octets = coding.record["pixels"].itemsize
    kept = "8 bits of brightness" if coding.unit == "1" else "16 bits, whole mm; 0 says nothing"
    about = {"unit": coding.unit, "meaning": f"pixels row by row, {kept}", "frame": "camera"}
    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "s", "meaning": "simulated time"}),
        pa.field("end", pa.int8(), metadata={"unit": "1", "meaning": "1 nose, -1 tail"}),
        pa.field("pixels", pa.binary(octets), metadata=about),
    ]
    return pa.schema(fields, metadata={"size": str(coding.size), "unit": coding.unit})


def _coding_in(file: pq.ParquetFile) -> Coding:
    """Return the encoding of the pictures in a file; a ``ValueError`` where it holds none."""
    actual, about = file.schema_arrow, file.schema_arrow.metadata or {}
    size, unit = int(about[b"size"]), about[b"unit"].decode()
    require(_MIN_SIZE <= size <= _MAX_SIZE and unit in ("1", "m"), "it has no such pictures")
    coding = Coding(size, unit)
    wanted = _schema(coding).remove_metadata()
    require(actual.remove_metadata().equals(wanted), "its columns are not those of pictures")
    return coding
