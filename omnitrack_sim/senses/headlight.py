"""A camera with one lamp beside its lens, as in the paper's reference [22]: brightness a pixel.

A wall is the brighter the nearer it is and the more it faces the lamp; what the lamp does not reach
is black. So straight pipe is a bright ring about a dark middle, and a bend or a branch makes it
lopsided.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Unit
from omnitrack_sim.senses.draws import Keys, normal
from omnitrack_sim.senses.optics import GRAIN, JOINT, LIT, RANGE, OpticsTable, rays_of

EXPOSED = 0.9
"""Part of the pixels that the exposure keeps below full brightness."""
BRIGHT = 0.8
"""Brightness that the exposure gives to that pixel."""


class HeadlightTable(OpticsTable):
    """``[sensing.headlight]``. All figures are assumed: a small camera of an endoscope, its picture
    binned."""

    lamp_aside: Annotated[float, Field(ge=0, le=0.06), Unit("m")] = 0.015
    """Distance of the lamp from the lens, towards module 1."""
    noise: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.01
    """Standard deviation of a pixel, as a part of full brightness."""
    vignetting: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.3
    """Light that is lost at the corner of the picture, as a part of it."""
    gamma: Annotated[float, Field(ge=1, le=4), Unit("1")] = 2.2
    """A pixel is the light to the power of 1 / gamma."""
    bits: Annotated[int, Field(ge=4, le=16), Unit("1")] = 8
    """Of a pixel."""
    dirt: Annotated[float, Field(ge=0, le=0.9), Unit("1")] = 0.15
    """Part by which patches of dirt darken or brighten the wall."""
    ring: Annotated[float, Field(ge=0, le=0.9), Unit("1")] = 0.4
    """Part by which the joints of pipes, welds or sockets, are darker than the wall."""
    ring_width: Annotated[float, Field(gt=0, le=0.1), Unit("m")] = 0.004
    """Half of the width of such a ring."""


class HeadlightCamera:
    """See ``optics.Camera``. A pixel is brightness, 0 to 1."""

    def __init__(self, table: HeadlightTable) -> None:
        self.optics, self._table = table, table
        self._corner = max(1 - float(np.min(rays_of(table)[:, 2])), 1e-9)
        self.lamp = np.array([table.lamp_aside, 0.0, 0.0])

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
        light = self._light(hits, rays) * (1 + table.dirt * hits[..., GRAIN])
        coded = self._coded(light, rays, metered)
        noisy = coded + table.noise * normal(keys, "headlight", number, pixels)
        steps = 2**table.bits - 1
        return np.round(np.clip(noisy, 0.0, 1.0) * steps) / steps

    def expected(self, hits: Array, rays: Array) -> Array:
        """See ``Camera``."""
        coded = self._coded(self._light(hits, rays), rays)
        return np.where(np.isnan(hits[..., RANGE]), np.nan, coded)

    def spread(self, expected: Array) -> Array:
        """See ``Camera``: dirt changes light by a part, and a pixel by that over gamma."""
        table = self._table
        dirt = table.dirt * 0.5 / table.gamma * expected
        return np.hypot(table.noise + 0.5 / 2**table.bits, dirt)

    def slopes(self, hits: Array, rays: Array, rotation: Array) -> None:
        """See ``Camera``: found from neighbouring poses."""

    def _light(self, hits: Array, rays: Array) -> Array:
        """Light (n, k) that comes back to the lens: what falls on the wall, which scatters it alike
        to all sides (Lambert)."""
        met = np.isfinite(hits[..., RANGE])
        reach = np.where(met, hits[..., RANGE], 1.0)
        to_lamp = self.lamp - reach[..., None] * rays
        rings = 1 - self._table.ring * np.exp(-((hits[..., JOINT] / self._table.ring_width) ** 2))
        return np.where(met, hits[..., LIT] * rings / (to_lamp**2).sum(axis=-1), 0.0)

    def _coded(self, light: Array, rays: Array, metered: NDArray[np.intp] | None = None) -> Array:
        """Pixels (n, k) of light, exposed by the picture's own brightness."""
        table = self._table
        seen = light * (1 - table.vignetting * (1 - rays[:, 2]) / self._corner)
        meter = seen if metered is None else seen[:, metered]
        level = np.quantile(meter, EXPOSED, axis=1, keepdims=True)
        exposed = BRIGHT**table.gamma * seen / np.maximum(level, 1e-12)
        return np.clip(exposed, 0.0, 1.0) ** (1 / table.gamma)
