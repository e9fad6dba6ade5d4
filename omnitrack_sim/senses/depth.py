"""A time-of-flight camera: a distance for each pixel."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, cross
from omnitrack_sim.base.table import Unit
from omnitrack_sim.senses.draws import Keys, normal, uniform
from omnitrack_sim.senses.optics import NORMAL, RANGE, OpticsTable


class DepthTable(OpticsTable):
    """``[sensing.depth]``. Noise and dropouts are assumed, after data sheets of small
    time-of-flight cameras, which state an accuracy of 1 % of the distance (pmd flexx2: 1 %, 0.1 to
    4 m)."""

    noise: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.01
    """Standard deviation of a pixel, as a part of the distance."""
    noise_floor: Annotated[float, Field(ge=0, le=0.1), Unit("m")] = 0.001
    """Standard deviation besides that."""
    scale_error: Annotated[float, Field(ge=0, le=0.2), Unit("1")] = 0.003
    """Standard deviation of a robot's own error of all distances, as a part of them."""
    dropouts: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.02
    """Part of the pixels of a picture that give no distance."""
    grazing_deg: Annotated[float, Field(ge=0, le=89)] = 5.0
    """Least angle between ray and wall in how a distance is expected to change with the robot's
    pose, which would grow without bound; pictures show walls at any angle."""
    resolution: Annotated[float, Field(gt=0, le=0.1), Unit("m")] = 0.001
    """Step of the distances."""


class DepthCamera:
    """See ``optics.Camera``. A pixel is the distance, m, along its ray."""

    def __init__(self, table: DepthTable) -> None:
        self.optics, self.lamp = table, None
        self._table = table
        self._least_sine = np.sin(np.radians(table.grazing_deg))

    def picture(
        self,
        hits: Array,
        rays: Array,
        pixels: NDArray[np.intp],
        keys: Keys,
        number: int | NDArray[np.int_],
        metered: NDArray[np.intp] | None = None,
    ) -> Array:
        """See ``Camera``."""
        table = self._table
        reach = hits[..., RANGE]
        seen = np.isfinite(reach) & (uniform(keys, "dropouts", number, pixels) > table.dropouts)
        reach = np.where(seen, reach, 1.0)
        scale = 1.0 + table.scale_error * normal(keys, "scale", 0, 1)
        spread = np.hypot(table.noise * reach, table.noise_floor)
        measured = scale * reach + spread * normal(keys, "depth", number, pixels)
        return np.where(seen, np.round(measured / table.resolution) * table.resolution, np.nan)

    def expected(self, hits: Array, rays: Array) -> Array:
        """See ``Camera``."""
        return np.where(np.isfinite(hits[..., RANGE]), hits[..., RANGE], np.nan)

    def spread(self, expected: Array) -> Array:
        """See ``Camera``."""
        share = np.hypot(self._table.noise, self._table.scale_error)
        return np.hypot(share * expected, self._table.noise_floor)

    def slopes(self, hits: Array, rays: Array, rotation: Array) -> Array:
        """See ``Camera``: where the camera moves by d, a ray of direction u that meets a wall of
        normal n becomes longer by -(n d) / (n u)."""
        directions = np.einsum("nij,kj->nki", rotation, rays)
        normals = hits[..., NORMAL]
        across = (normals * directions).sum(axis=-1)
        steep = np.minimum(across, -self._least_sine)
        moved = -normals / steep[..., None]  # (n, k, 3) world
        reach = np.where(np.isfinite(hits[..., RANGE]), hits[..., RANGE], 0.0)[..., None]
        in_camera = np.einsum("nki,nij->nkj", moved, rotation)
        turned = cross(reach * rays, in_camera)
        return np.concatenate([moved, turned], axis=-1)
