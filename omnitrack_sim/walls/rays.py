"""Ray casting on exact walls: parts of networks as records for the compiled functions."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from ctypes import CFUNCTYPE

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Part
from omnitrack_sim.pipes.native import INTEGER, NUMBER, NUMBERS, WORD, c_function, pointers
from omnitrack_sim.walls import tracing
from omnitrack_sim.walls.tracing import nearest, trace

Port = tuple[int, str]
"""A part's index in its map, and the name of a port of it."""
_TRACE = CFUNCTYPE(
    INTEGER, *(NUMBERS, NUMBERS, NUMBERS, WORD, NUMBERS, WORD, NUMBERS, NUMBER, NUMBERS, NUMBERS)
)
_NEAREST = CFUNCTYPE(INTEGER, NUMBERS, NUMBERS, NUMBERS, WORD, WORD, NUMBERS, NUMBERS)
"""C types of the compiled functions, in the order of their arguments."""
_WORK = 2 * tracing.NEAR * tracing.MOST_NEAR + tracing.PORTS_ROOM


class RayWalls:
    """Maps, each a number of placed parts, whose walls rays meet.

    A map may be the true network or what a robot takes for it; robots may share one.

    Args:
        maps: parts of each map.
        closed: (part index, port) that a plate closes, of each map.
        unknown: (part index, port), of each map, that nothing is known of what is beyond.
        dirty: whether the walls have a grain.

    Raises:
        GeometryError: a kind of fitting has a wall that does not compile.
    """

    def __init__(
        self,
        maps: Sequence[Sequence[Part]],
        closed: Sequence[Collection[Port]] | None = None,
        unknown: Sequence[Collection[Port]] | None = None,
        *,
        dirty: bool = True,
    ) -> None:
        self._dirty = dirty
        plates = [()] * len(maps) if closed is None else closed
        dark = [()] * len(maps) if unknown is None else unknown
        self._maps = [_records(*each) for each in zip(maps, plates, dark, strict=True)]
        self._join()

    def replace(
        self,
        number: int,
        parts: Sequence[Part],
        closed: Collection[Port] = (),
        unknown: Collection[Port] = (),
    ) -> None:
        """Put another map in the place of one; arguments as of the class."""
        self._maps[number] = _records(parts, closed, unknown)
        self._join()

    def _join(self) -> None:
        # One array for all maps; cameras name theirs by the span of its rows.
        self._parts = np.concatenate(self._maps)
        ends = np.cumsum([0, *(len(records) for records in self._maps)])
        self._work = _WORK + max(map(len, self._maps), default=0)
        self._spans = np.stack([ends[:-1], ends[1:]], axis=-1).astype(float)

    def trace(
        self,
        which: NDArray[np.intp],
        position: Array,
        rotation: Array,
        rays: Array,
        far: float,
        lamp: Array | None = None,
    ) -> Array:
        """Trace the rays of n cameras to the walls.

        Args:
            which: (n,) map of each camera.
            position: (n, 3) m, world frame.
            rotation: (n, 3, 3) camera frame in the world.
            rays: (k, 3) unit vectors, camera frame.
            far: m, beyond which nothing is seen.
            lamp: (3,) m, camera frame; None: what it shines on is not asked for.

        Returns:
            (n, k, HIT_SIZE), in the order of ``tracing``: range, m (infinite for nothing, NaN
            beyond a port that nothing is known of); unit normal into the bore (3), world frame;
            number of the part in its map, -1 for nothing; how squarely the lamp shines there,
            cosine, 0 in the dark; distance from the nearest joint or end, m; grain, -1 to 1, 0 of
            walls without one.
        """
        n, k = len(position), len(rays)
        poses = np.concatenate([position, rotation.reshape(n, 9)], axis=1)
        light = np.zeros(5) if lamp is None else np.array([*lamp, 1.0, self._dirty])
        hits = np.empty((n, k, tracing.HIT_SIZE))
        c_function(trace, _TRACE).ctypes(
            *pointers(self._parts, self._spans[which], poses),
            n,
            *pointers(np.ascontiguousarray(rays, float)),
            k,
            *pointers(light),
            far,
            # A buffer for each call, so that calls share no state.
            *pointers(np.zeros(self._work), hits),
        )
        return hits

    def nearest(self, which: NDArray[np.intp], points: Array) -> tuple[Array, Array, Array]:
        """Return the distances of points from the walls.

        Args:
            which: (n,) map of each row.
            points: (n, k, 3) m, world frame.

        Returns:
            Distances (n, k) m, positive in the bore; unit gradients (n, k, 3); and the parts (n, k)
            that the points lie in, -1 for none, where the distance means nothing.
        """
        n, k = points.shape[:2]
        rows = np.empty((n, k, 5))
        c_function(nearest, _NEAREST).ctypes(
            *pointers(self._parts, self._spans[which], np.ascontiguousarray(points)),
            n,
            k,
            *pointers(np.zeros(16), rows),
        )
        return rows[..., 0], rows[..., 1:4], rows[..., 4]


def _records(parts: Sequence[Part], closed: Collection[Port], unknown: Collection[Port]) -> Array:
    """Return the records (parts, PART_SIZE) of a map."""
    records = [
        part_record(part, *([port for i, port in ends if i == index] for ends in (closed, unknown)))
        for index, part in enumerate(parts)
    ]
    return np.array(records).reshape(-1, tracing.PART_SIZE)


def part_record(part: Part, closed: Collection[str] = (), unknown: Collection[str] = ()) -> Array:
    """Return the record (PART_SIZE,) of a placed part, for this process only.

    Args:
        part: of a map.
        closed: its ports that a plate closes.
        unknown: its ports behind which the map ends.
    """
    fitting, pose = part.fitting, part.pose
    record = np.zeros(tracing.PART_SIZE)
    low, high = fitting.bounds
    record[tracing.SURFACE] = fitting.wall_address("surface")
    record[tracing.SPAN] = fitting.wall_address("span")
    record[tracing.CLEAR] = fitting.wall_address("clear")
    record[tracing.CENTRE : tracing.CENTRE + 3] = pose.apply((low + high) / 2)
    # Points that are measured a little outside the wall still belong to it.
    record[tracing.REACH] = float(np.linalg.norm(high - low)) / 2 + fitting.largest_radius / 2
    record[tracing.POSITION : tracing.POSITION + 3] = pose.position
    record[tracing.ROTATION : tracing.ROTATION + 9] = pose.rotation.ravel()
    record[tracing.PORTS] = len(fitting.port_names)
    for i, name in enumerate(fitting.ports):
        port, place = part.port(name), tracing.PLANES + tracing.PORT_SIZE * i
        record[place : place + 3] = port.position
        record[place + 3 : place + 6] = port.rotation[:, 2]
        dark = tracing.UNSEEN if fitting.is_plain else tracing.UNKNOWN
        record[place + 6] = (
            tracing.PLATE if name in closed else dark if name in unknown else tracing.OPEN
        )
    record[tracing.SIZES : tracing.SIZES + len(fitting.sizes)] = fitting.sizes
    return record
