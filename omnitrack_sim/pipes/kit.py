"""The solids that a fitting describes its mesh with. ``model.meshes`` makes them; pipes stay free
of any mesh library."""

from __future__ import annotations

from typing import Any, Protocol, Self

from omnitrack_sim.base.rotations import Array, Pose


class Solid(Protocol):
    """A closed body: ``a + b`` unites, ``a - b`` cuts away."""

    def __add__(self, other: Self, /) -> Self: ...

    def __sub__(self, other: Self, /) -> Self: ...


class Kit(Protocol):
    """Makes solids, in the fitting frame, m.

    Attributes:
        sections: corners of a pipe's cross-section.
        overcut: m, how far solids that are cut away should reach into what is already empty.
    """

    @property
    def sections(self) -> int: ...

    @property
    def overcut(self) -> float: ...

    def cylinder(
        self,
        length: float,
        radius: float,
        end_radius: float | None = None,
        *,
        centred: bool = False,
    ) -> Solid:
        """Along +z from the origin, or with its middle there; a cone where the radius at its end is
        another one."""
        ...

    def revolved(self, outline: Array) -> Solid:
        """The closed outline (n, 2), radius and z, m, revolved about the z axis."""
        ...

    def bend(self, mean_radius: float, angle: float, radius: float) -> Solid:
        """A disc of ``radius`` m at the origin across +z, swept by ``angle`` rad towards +x about
        the axis ``mean_radius`` m away; what would lie beyond that axis is left out."""
        ...

    def loft(self, rings: Array, hub: int | None) -> Solid:
        """Through the closed rings (m, k, 3), with fans over both ends about their corner ``hub``,
        which sees every other one; with None the last ring is joined to the first."""
        ...

    def moved(self, solid: Any, pose: Pose) -> Solid:
        """A solid given in the frame ``pose``."""
        ...
