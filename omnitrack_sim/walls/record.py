"""Records by which the compiled collider knows a wall: user data at the end of its geom's row.

A record holds plain numbers, the same in every process: the kind of the fitting as a number made
from its name, and the sizes that its compiled functions get. The addresses of these functions
stand in ``kinds``, a table of this process.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Fitting
from omnitrack_sim.pipes.fittings.base import ADDRESS, MAX_PORTS, MAX_SIZES
from omnitrack_sim.pipes.obstacles import Obstacle, corners_of

MARK = 402657.0
"""First number of every record of this layout. Six digits, as many as MJCF keeps of a number."""
KIND, SIZE, DEPTH, ORDER, PARTS, LONG, BUMPS, WAVES, BOX = 1, 2, 3, 4, 5, 6, 7, 8, 9
ENDS = BOX + 3
SIZES = ENDS + MAX_PORTS
RECORD_SIZE = SIZES + MAX_SIZES
"""Indices in the record of a wall, and its size: mark, number of the kind, radius of the bore, m,
depth to which the wall is solid towards other bores, m, number of the part and count of all parts,
whose walls follow each other, whether (over 0) the sizes are not here but in ``long_sizes``, width
of bumps into the bore, m, 0 without any, width of the waves of a smooth wall, m, 0 for others,
centre of the bounding box (3), whether contact ends at each port, the fitting's ``wall_sizes`` or
the two numbers of their key."""

DEPTH_IN_BORE = 2.0
"""Largest depth to which a wall is solid, in radii of its bore: 160 mm at 80 mm. The middle of a
body that is thrown at it at 12 m/s sinks in by some 50 mm."""


def kind_number(kind: str) -> int:
    """Return the number, of six digits, of a kind of fitting by its name in files."""
    return 100_000 + zlib.crc32(kind.encode()) % 900_000


KIND_SIZE = 4
"""Words of a kind."""


class Kinds:
    """Compiled functions of the kinds of fittings that this process knows, for compiled code.

    Attributes:
        table: (1 + KIND_SIZE MAX_KINDS,) words: how many there are, then number, addresses of
            ``surface`` and ``span``, and number of solids of each.
    """

    MAX_KINDS = 100

    def __init__(self) -> None:
        self.table = np.zeros(1 + KIND_SIZE * self.MAX_KINDS, np.int64)
        self.names: dict[int, str] = {}

    def add(self, kind: type[Fitting] | type[Obstacle]) -> int:
        """Enter a kind, or enter its functions anew; returns its number.

        Raises:
            GeometryError: its wall does not compile, its number is another kind's, or no room.
        """
        name, number = kind.file_kind(), kind_number(kind.file_kind())
        if self.names.setdefault(number, name) != name:
            problem = f"shares its number with {self.names[number]!r}: give the class another name"
            raise GeometryError(Fault(name, problem))
        if len(self.names) > self.MAX_KINDS:
            raise GeometryError(Fault(name, f"is one kind more than {self.MAX_KINDS}"))
        row = 1 + KIND_SIZE * list(self.names).index(number)
        addresses = kind.wall_address("surface"), kind.wall_address("span")
        self.table[row : row + KIND_SIZE] = number, *addresses, kind.wall.solids
        # Last, since another thread may be stepping a model.
        self.table[0] = len(self.names)
        return number


kinds = Kinds()


class LongSizes:
    """Sizes of walls that are longer than a record, by a key of their content, for compiled code.

    The key leaves out what is one process's alone, see ``ADDRESS``.

    They are kept for good, since no process knows which of its models still have them.

    Attributes:
        table: (3 ROOM,) words: key (2), and address of the numbers, which is 0 where the row is
            free. A key's row is the first free one from its own number on.
    """

    ROOM = 1 << 14

    def __init__(self) -> None:
        self.table = np.zeros(3 * self.ROOM, np.int64)
        self._kept: list[Array] = []

    def add(self, sizes: Sequence[float]) -> tuple[int, int]:
        """Keep sizes, and return their key: two numbers of six digits.

        Raises:
            GeometryError: no room.
        """
        numbers = np.array(sizes, float)
        digest = hashlib.sha256(np.delete(numbers, ADDRESS).tobytes()).digest()
        halves = int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")
        first, second = (100_000 + half % 900_000 for half in halves)
        for k in range(self.ROOM):
            row = 3 * ((first + k) % self.ROOM)
            if not self.table[row + 2]:
                self._kept.append(numbers)
                self.table[row : row + 2] = first, second
                self.table[row + 2] = numbers.ctypes.data  # last: other threads may be stepping
                return first, second
            if self.table[row] == first and self.table[row + 1] == second:
                return first, second
        raise GeometryError(Fault("relief", f"is of one pipe more than {self.ROOM} in a process"))

    def numbers(self, key: tuple[int, int]) -> Array | None:
        """Return the numbers of a key; None where it has not been added in this process."""
        rows = self.table.reshape(-1, 3)
        found = rows[(rows[:, :2] == key).all(axis=1), 2]
        return next((each for each in self._kept if each.ctypes.data in found), None)

    def address(self, key: tuple[int, int]) -> int:
        """Return the address of the numbers of a key that was added."""
        row = 3 * (key[0] % self.ROOM)
        while tuple(self.table[row : row + 2]) != key:
            row = (row + 3) % (3 * self.ROOM)
        return int(self.table[row + 2])


long_sizes = LongSizes()


def wall_record(
    fitting: Fitting, ends: tuple[bool, ...], depth: float, number: int = 0, count: int = 1
) -> Array:
    """Return the record (RECORD_SIZE,) of one fitting, whose kind this process knows from then on.

    Args:
        fitting: of any kind.
        ends: for each port, whether contact along a line stops being supported there (open end, or
            the wall bends or steps).
        depth: m, to which the wall is solid.
        number: of the part.
        count: of all parts.
    """
    record = np.zeros(RECORD_SIZE)
    record[0], record[KIND] = MARK, kinds.add(type(fitting))
    record[SIZE], record[DEPTH] = fitting.max_radius, depth
    record[ORDER], record[PARTS] = number, count
    record[BUMPS], record[WAVES] = fitting.bumps, fitting.waves
    record[BOX:ENDS] = bounding_box(fitting, depth)[0]
    record[ENDS : ENDS + len(ends)] = ends
    put_sizes(record, fitting.wall_sizes)
    return record


def put_sizes(record: Array, sizes: Sequence[float]) -> None:
    """Write sizes to a record, or the key of long ones."""
    if len(sizes) > MAX_SIZES:
        record[LONG], sizes = 1.0, long_sizes.add(sizes)
    record[SIZES : SIZES + len(sizes)] = sizes


def obstacle_record(obstacle: Obstacle, radius: float, limit: float) -> Array:
    """Return the record (RECORD_SIZE,) of what stands on a wall, in the middle of its box.

    Args:
        obstacle: the solid.
        radius: m, of the bore.
        limit: m, from the axis, beyond which a point is no longer one of this pipe's.
    """
    record, (low, high) = np.zeros(RECORD_SIZE), corners_of(obstacle)
    record[0], record[KIND], record[SIZE] = MARK, kinds.add(Obstacle), radius
    record[DEPTH], record[BUMPS] = DEPTH_IN_BORE * radius, obstacle.bumps
    record[BOX:ENDS] = (low + high) / 2
    put_sizes(record, obstacle.sizes(limit))
    return record


PLATE = 2.0
"""Number of the kind of a plate that closes a pipe, less than that of any fitting."""
WALL_BEFORE = SIZES
"""Index in its sizes: by how many geoms it comes after the wall of its part."""


def plate_record(radius: float, depth: float, wall_before: int) -> Array:
    """Return the record (RECORD_SIZE,) of a plate across a bore, solid to ``depth`` m."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[KIND], record[SIZE], record[DEPTH] = MARK, PLATE, radius, depth
    record[WALL_BEFORE] = wall_before
    return record


def has_record(row: Array) -> bool:
    """Return whether a geom's user data end with a record."""
    return len(row) >= RECORD_SIZE and float(row[len(row) - RECORD_SIZE]) == MARK


def bounding_box(fitting: Fitting, room: float) -> tuple[Array, Array]:
    """Centre (3,) and half sizes (3,) m of a box around the bore and ``room`` m, fitting frame."""
    low, high = fitting.bounds
    return (low + high) / 2, (high - low) / 2 + room
