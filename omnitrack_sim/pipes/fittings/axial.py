"""What fittings round about one straight axis share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes.fittings.base import Arcs, AxisCurve, Fitting, X, Z, port_pose


@dataclass(frozen=True)
class Axial(Fitting):
    """A fitting whose only axis is a line of ``length`` m along +z from the origin."""

    length: float

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` at z = length; x along the fitting's x axis."""
        return {"start": port_pose(-Z, X, np.zeros(3)), "end": port_pose(Z, X, self.length * Z)}

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: the line."""
        sign = 1.0 if enter == "start" else -1.0
        return AxisCurve(self.ports[enter].position, sign * Z, X, ((self.length, 0.0),))

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        z = np.asarray(points, float)[..., 2]
        return np.minimum(z, self.length - z)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``."""
        r = self.largest_radius
        return np.array([-r, -r, 0.0]), np.array([r, r, self.length])

    @abstractmethod
    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``."""
