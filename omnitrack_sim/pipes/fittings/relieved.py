"""Pipes about one axis whose wall may have relief, or be a measured one.

Their axis is a line along z, or an arc that bends towards x.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.fittings.base import ADDRESS, Fitting, FittingTable
from omnitrack_sim.pipes.heights import Patch, numbers_of, total_height
from omnitrack_sim.pipes.heights import distance as from_heights
from omnitrack_sim.pipes.native import SIGNATURES, at, c_function, call_surface, scratch
from omnitrack_sim.pipes.obstacles import PLACED, Obstacle
from omnitrack_sim.pipes.obstacles import nearest as nearest_obstacle
from omnitrack_sim.pipes.profile import Profile, load_profile
from omnitrack_sim.pipes.relief import Entries, relief_tables
from omnitrack_sim.pipes.sections import Section
from omnitrack_sim.pipes.shapes import Kit, Pieces, Solid

MARKED, RELIEVED = 2, -1.0
"""Index in the sizes of what is below 0 for a wall with relief, and what it then is."""
CLEAR, OBSTACLES, PATCHES, OWN, SOLIDS = 4, 5, 6, 7, 12
"""Indices in the sizes of a wall with relief, after the address of its surface: radius of the
cylinder that is clear of relief, m; numbers of solids and of patches of height; numbers of the
fitting's own; where the solids begin, which the patches follow."""
DEGREES_PER_RING = 3.0
"""Of the mesh of a bend with heights, at most."""


@compiled
def from_relief_on(sizes, curvature, x, y, z, d, out):
    """Return the distance from a wall with relief, ``d`` m from the bore, whose gradient is out's.

    A bore with patches is that of these alone.
    """
    count, patches = int(sizes[OBSTACLES]), int(sizes[PATCHES])
    if patches > 0:
        numbers = at(sizes, SOLIDS + PLACED * count)
        d = from_heights(numbers, patches, sizes[0], curvature, x, y, z, scratch(), out)
    return nearest_obstacle(at(sizes, SOLIDS), count, curvature, x, y, z, d, out)


@compiled
def from_relief(sizes, x, y, z, out):
    """Call the surface by its address, so that what every wheel in a plain pipe calls is small."""
    return call_surface(int(sizes[ADDRESS]), sizes, x, y, z, out)


class ReliefTable(FittingTable):
    """Keys of a pipe whose wall may have relief."""

    relief: Annotated[Entries, Field(exclude_if=lambda relief: not relief)] = ()
    """How the wall differs from the bore, such as by beads of welds: a list of tables, by `kind`.
    It ends within the pipe: the ports stay as they are."""
    profile: Annotated[Profile | None, Field(exclude_if=lambda profile: profile is None)] = None
    """The measured wall: a CSV file of rays, length by angle by radius."""


class Relieved(Fitting):
    """A pipe whose wall may differ from its bore.

    Attributes:
        relief: how its wall differs: a list of tables by ``kind``, or plain data of them.
        profile: the measured wall, its table, or the file of a scan; None without one.
        relieved_surface: its ``surface``, where there is relief.
    """

    relief: Sequence[Any]
    profile: Any
    relieved_surface: ClassVar[Any]

    @property
    @abstractmethod
    def axis_length(self) -> float:
        """Length of its axis, m."""

    @property
    @abstractmethod
    def plain_sizes(self) -> tuple[float, ...]:
        """Sizes without relief: of the first two a wall with relief has its own."""

    @property
    def own_numbers(self) -> tuple[float, ...]:
        """Numbers from ``OWN`` on of a wall with relief."""
        return ()

    @property
    def curvature(self) -> float:
        """Curvature of its axis, 1/m."""
        return 0.0

    @cached_property
    def shape(self) -> Section | None:
        """Its section; None for a circle."""
        return None

    def _check_relief(self) -> None:
        """Read the tables of relief, and check them.

        Raises:
            GeometryError: they do not fit the pipe.
        """
        object.__setattr__(self, "relief", relief_tables(self.relief, self.kind))
        object.__setattr__(self, "profile", _profile_of(self.profile))
        if faults := [Fault(f"{self.kind}.{key}", problem) for key, problem in self._problems()]:
            raise GeometryError(faults)

    def _problems(self) -> Iterator[tuple[str, str]]:
        """Yield keys of relief, and what is wrong with them."""
        for i, one in enumerate(self.relief):
            yield from ((f"relief.{i}.{key}", problem) for key, problem in one.problems(self))
        if self.profile is not None:
            yield from (("profile", problem) for problem in self.profile.problems(self))

    def to_table(self) -> dict[str, Any]:
        """See ``Fitting``."""
        table = super().to_table()
        relief = [one.model_dump(exclude_none=True) for one in table.pop("relief")]
        profile = table.pop("profile")
        table |= {"relief": relief} if relief else {}
        return table | ({} if profile is None else {"profile": profile.model_dump()})

    # The wall

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """See ``Fitting``."""
        return self._obstacles

    @cached_property
    def _obstacles(self) -> tuple[Obstacle, ...]:
        solids = (one.obstacle(self) for one in self.relief)
        return tuple(solid for solid in solids if solid is not None)

    @property
    def squeeze(self) -> float:
        """Least length of its wall for a metre of its axis, at the inner side of a bend, m."""
        return 1.0 - self.radius * self.curvature

    @property
    def bumps(self) -> float:
        """See ``Fitting``."""
        widths = (patch.width for patch in self.patches if patch.bulges)
        return self.squeeze * min(widths, default=0.0)

    @property
    def waves(self) -> float:
        """See ``Fitting``."""
        return self.squeeze * min((patch.width for patch in self.patches), default=0.0)

    @cached_property
    def patches(self) -> tuple[Patch, ...]:
        """Heights of its wall over the bore."""
        measured = () if self.profile is None else (self.profile.patch(self),)
        patches = (one.patch(self) for one in self.relief)
        return (*measured, *(patch for patch in patches if patch is not None))

    @cached_property
    def widening(self) -> float:
        """Depth, m, of the deepest node of its wall's heights outside of the bore."""
        totals = [total_height(self.patches, patch.nodes) for patch in self.patches]
        return max([0.0, *(-float(total.min()) for total in totals)])

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``Fitting``: with relief as from ``CLEAR`` on."""
        return self._sizes_with_relief if self.relief or self.profile else self.plain_sizes

    @property
    def wall_sizes(self) -> tuple[float, ...]:
        """See ``Fitting``."""
        return self._sizes_of_patches if self.patches else self.plain_sizes

    @cached_property
    def _sizes_with_relief(self) -> tuple[float, ...]:
        return self._sizes(self.obstacles)

    @cached_property
    def _sizes_of_patches(self) -> tuple[float, ...]:
        return self._sizes(())

    def _sizes(self, obstacles: tuple[Obstacle, ...]) -> tuple[float, ...]:
        """Return the sizes of a wall with relief."""
        patches = numbers_of(self.patches, self.radius)
        # The third of the distance of two nodes that a height may rise between them is some um.
        high = -min([0.0, *(-total_height(self.patches, p.nodes).max() for p in self.patches)])
        clear = min([self.radius - 1.02 * high, *(solid.clear for solid in obstacles)])
        address = float(c_function(type(self).relieved_surface, SIGNATURES["surface"]).address)
        counts = len(obstacles), len(self.patches)
        placed = [number for solid in obstacles for number in solid.placed]
        own = (*self.own_numbers, *(0.0,) * (SOLIDS - OWN - len(self.own_numbers)))
        head = (*self.plain_sizes[:MARKED], RELIEVED, address, clear, *counts, *own)
        return (*head, *placed, *patches.tolist())

    def on_wall(self, places: Array, more: float = 0.0) -> Array:
        """Return points (..., 3) m, fitting frame, of the wall.

        Args:
            places: (..., 2), m along the axis, rad about it.
            more: m, farther out.
        """
        s, angle = places[..., 0], places[..., 1]
        r = self.radius - total_height(self.patches, places) + more
        x, y = r * np.cos(angle), r * np.sin(angle)
        if self.curvature == 0:
            return np.stack([x, y, s], axis=-1)
        mean, turn = 1 / self.curvature, s * self.curvature
        return np.stack([mean - (mean - x) * np.cos(turn), y, (mean - x) * np.sin(turn)], axis=-1)

    def axis_frame(self, s: float) -> Pose:
        """See ``Fitting``."""
        if self.curvature == 0:
            return super().axis_frame(s)
        turn = s * self.curvature
        c, b = math.cos(turn), math.sin(turn)
        rotation = np.array([[c, 0, b], [0, 1, 0], [-b, 0, c]])
        return Pose(rotation, np.array([1 - c, 0, b]) / self.curvature)

    # Primitives and meshes

    def add_relief(self, pieces: Pieces, tolerance: float) -> bool:
        """Add what stands on the wall; returns true where that is all of the wall as well."""
        for solid in self.obstacles:
            solid.add_pieces(pieces, self.axis_frame(solid.s), tolerance)
        if self.patches:
            self._add_facets(pieces, tolerance)
        return bool(self.patches)

    def relief_count(self, tolerance: float) -> tuple[int, bool]:
        """Return how many pieces ``add_relief`` adds, and what it returns."""
        count = sum(solid.piece_count(tolerance) for solid in self.obstacles)
        if self.patches:
            count += math.prod(self._facets(tolerance))
        return count, bool(self.patches)

    def _facets(self, tolerance: float) -> tuple[int, int]:
        """Return the numbers of facets along the pipe and round it."""
        bend = max(patch.bend(self.radius) for patch in self.patches)
        around = math.ceil(
            2 * math.pi * self.radius * math.sqrt((bend + 1 / self.radius) / tolerance / 16)
        )
        along = self.axis_length * (2 - self.squeeze)
        bend = (bend + self.curvature) / self.squeeze**2
        return math.ceil(along * math.sqrt(bend / tolerance / 16)), max(16, around)

    def _add_facets(self, pieces: Pieces, tolerance: float) -> None:
        """Add boxes tangent to the wall in the middle of the cells of a grid."""
        rows, columns = self._facets(tolerance)
        s = (np.arange(rows) + 0.5) * self.axis_length / rows
        angles = 2 * np.pi * np.arange(columns) / columns
        places = np.stack(np.meshgrid(s, angles, indexing="ij"), axis=-1).reshape(-1, 2)
        points = self.on_wall(places)
        normals = -self.signed_distance(points)[1]
        half = self.axis_length / rows / 2, math.pi * self.max_radius / columns
        for (place, angle), point, normal in zip(places, points, normals, strict=True):
            tangent = self.axis_frame(float(place)).rotation[:, 2]
            along = tangent - normal * float(normal @ tangent)
            stretch = 1 - self.max_radius * math.cos(angle) * self.curvature
            reach = half[0] * max(stretch, self.squeeze) / float(np.linalg.norm(along)), half[1]
            pieces.facet(point, normal, along, reach[1], reach[0])

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: without what stands in it."""
        bore: Any = super().bore(kit)
        for solid in self.obstacles:
            bore -= kit.moved(solid.solid(kit), solid.pose(self.axis_frame(solid.s)))
        return bore

    def lofted(self, kit: Kit, more: float, beyond: float = 0.0) -> Solid:
        """Return the solid of a wall of heights and ``more`` m around it.

        ``beyond``: m, by which it is longer than the pipe, at its end.
        """
        columns = max(kit.sections, *(round(2 * math.pi / patch.step) for patch in self.patches))
        nodes = [
            patch.begin + patch.spacing * np.arange(len(patch.coefficients))
            for patch in self.patches
        ]
        turn = math.degrees(self.axis_length * self.curvature)
        even = np.linspace(0.0, self.axis_length, max(2, math.ceil(turn / DEGREES_PER_RING) + 1))
        rows = np.concatenate([even, *nodes])
        rows = np.unique(rows[(rows >= 0) & (rows <= self.axis_length)].round(4))
        rows[-1] = self.axis_length
        angles = 2 * np.pi * np.arange(columns) / columns
        places: Array = np.stack(np.meshgrid(rows, angles, indexing="ij"), axis=-1).astype(float)
        rings = self.on_wall(places, more)
        rings[-1] += beyond * self.axis_frame(self.axis_length).rotation[:, 2]
        return kit.loft(rings, 0)


def _profile_of(given: Any) -> Profile | None:
    """Return a measured wall, or that of a file or a table."""
    if isinstance(given, str | Path):
        return load_profile(given)
    return Profile.model_validate(given) if isinstance(given, Mapping) else given
