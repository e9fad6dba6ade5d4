"""The shipped cameras: one that measures distances, and one that sees a lamp's light."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, cross
from omnitrack_sim.base.table import Unit
from omnitrack_sim.senses.draws import Keys, normal, uniform
from omnitrack_sim.senses.optics import OpticsTable, rays_of
from omnitrack_sim.walls.rays import GRAIN, JOINT, LIT, NORMALS, RANGE


class DepthTable(OpticsTable):
    """``[sensing.depth]``.

    Noise and dropouts are assumed, after data sheets of small time-of-flight cameras, which state
    an accuracy of 1 % of the distance (pmd flexx2: 1 %, 0.1 to 4 m).
    """

    noise: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.01
    """Standard deviation of a pixel, as a part of the distance."""
    noise_floor: Annotated[float, Field(ge=0, le=0.1), Unit("m")] = 0.001
    """Standard deviation besides that."""
    scale_error: Annotated[float, Field(ge=0, le=0.2), Unit("1")] = 0.003
    """Standard deviation of a robot's own error of all distances, as a part of them."""
    dropouts: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.02
    """Part of the pixels of a picture that give no distance."""
    grazing_deg: Annotated[float, Field(ge=0, le=89)] = 5.0
    """Least angle between ray and wall in the Jacobian of a distance, which would grow without
    bound."""
    resolution: Annotated[float, Field(gt=0, le=0.1), Unit("m")] = 0.001
    """Step of the distances."""


class DepthCamera:
    """Time-of-flight camera; see ``optics.Camera``. A pixel is the distance, m, along its ray."""

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
        returned = np.isfinite(reach) & (uniform(keys, "dropouts", number, pixels) > table.dropouts)
        # Any finite number where nothing came back: these pixels are masked in the end.
        reach = np.where(returned, reach, 1.0)
        scale = 1.0 + table.scale_error * normal(keys, "scale", 0, 1)
        spread = np.hypot(table.noise * reach, table.noise_floor)
        measured = scale * reach + spread * normal(keys, "depth", number, pixels)
        return np.where(returned, np.round(measured / table.resolution) * table.resolution, np.nan)

    def expected(self, hits: Array, rays: Array, metered: NDArray[np.intp] | None = None) -> Array:
        """See ``Camera``."""
        return np.where(np.isfinite(hits[..., RANGE]), hits[..., RANGE], np.nan)

    def spread(self, expected: Array) -> Array:
        """See ``Camera``."""
        share = np.hypot(self._table.noise, self._table.scale_error)
        return np.hypot(share * expected, self._table.noise_floor)

    def slopes(self, hits: Array, rays: Array, rotation: Array) -> Array:
        """See ``Camera``.

        Where the camera moves by d, a ray of direction u that meets a wall of normal n becomes
        longer by -(n d) / (n u).
        """
        directions = np.einsum("nij,kj->nki", rotation, rays)
        normals = hits[..., NORMALS]
        across = (normals * directions).sum(axis=-1)
        # Normals face the camera, so ``across`` is negative; near 0 the slope would have no bound.
        steep = np.minimum(across, -self._least_sine)
        moved = -normals / steep[..., None]  # (n, k, 3) world
        reach = np.where(np.isfinite(hits[..., RANGE]), hits[..., RANGE], 0.0)[..., None]
        in_camera = np.einsum("nki,nij->nkj", moved, rotation)
        turned = cross(reach * rays, in_camera)
        return np.concatenate([moved, turned], axis=-1)


EXPOSED = 0.9
"""Part of the pixels that the exposure keeps below full brightness."""
ABOUT = 0.05
"""To either side of that part, in the Jacobian, the pixels whose brightness is about the same."""
GRAZING = 0.03
"""Least sine of the angles of rays and light to a wall in the Jacobian, which would grow without
bound."""
BRIGHT = 0.8
"""Brightness that the exposure gives to that pixel."""


class HeadlightTable(OpticsTable):
    """``[sensing.headlight]``.

    All figures are assumed: a small camera of an endoscope, its picture binned.
    """

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
    """Camera with one lamp beside its lens, as in the paper's reference [22]; see ``Camera``.

    A pixel is brightness, 0 to 1. A wall is the brighter the nearer it is and the more it faces the
    lamp; what the lamp does not reach is black. So straight pipe is a bright ring about a dark
    middle, and a bend or a branch makes it lopsided.
    """

    def __init__(self, table: HeadlightTable) -> None:
        self.optics, self._table = table, table
        # The ray of the corner is the farthest from the axis: there vignetting is in full.
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
        coded = self._coded(self._received(light, rays), metered)
        noisy = coded + table.noise * normal(keys, "headlight", number, pixels)
        steps = 2**table.bits - 1
        return np.round(np.clip(noisy, 0.0, 1.0) * steps) / steps

    def expected(self, hits: Array, rays: Array, metered: NDArray[np.intp] | None = None) -> Array:
        """See ``Camera``."""
        coded = self._coded(self._received(self._light(hits, rays), rays), metered)
        return np.where(np.isnan(hits[..., RANGE]), np.nan, coded)

    def spread(self, expected: Array) -> Array:
        """See ``Camera``: dirt changes light by a part, and a pixel by that over gamma."""
        table = self._table
        dirt = table.dirt * 0.5 / table.gamma * expected
        return np.hypot(table.noise + 0.5 / 2**table.bits, dirt)

    def slopes(self, hits: Array, rays: Array, rotation: Array) -> Array:
        """See ``Camera``.

        Of light (v n) / |v|³, with v from the wall to the lamp and its normal n, the logarithm
        changes by (3 (v u) / v² - (u n) / (v n)) dr as the ray u becomes longer by dr, and by
        -w (n x v) / (v n) as the camera turns by w; a pixel by that, less the change of the
        exposure, over gamma.
        """
        table = self._table
        normals = np.einsum("nki,nij->nkj", hits[..., NORMALS], rotation)  # (n, k, 3) camera
        reach = np.where(np.isfinite(hits[..., RANGE]), hits[..., RANGE], 1.0)[..., None]
        to_lamp = self.lamp - reach * rays
        far = (to_lamp**2).sum(axis=-1)
        across = np.minimum((normals * rays).sum(axis=-1), -GRAZING)
        facing = np.maximum((normals * to_lamp).sum(axis=-1), GRAZING * np.sqrt(far))
        longer = 3 * (to_lamp * rays).sum(axis=-1) / far - across / facing  # of a metre of range
        moved = -normals / across[..., None]
        turned = cross(reach * rays, moved)
        moved_light = longer[..., None] * np.einsum("nkj,nij->nki", moved, rotation)
        turned_light = longer[..., None] * turned - cross(normals, to_lamp) / facing[..., None]
        light = np.concatenate([moved_light, turned_light], axis=-1)
        received = self._received(self._light(hits, rays), rays)
        # As the camera moves, other pixels come to be those that the exposure goes by.
        order, count = np.argsort(received, axis=1, kind="stable"), received.shape[1]
        first, last = (int((EXPOSED + side * ABOUT) * count) for side in (-1, 1))
        about = order[:, first:last]
        exposure = np.take_along_axis(light, about[..., None], axis=1).mean(axis=1)
        pixels = self._coded(received)
        shown = np.where(pixels < 1.0, pixels, 0.0) / table.gamma
        return shown[..., None] * (light - exposure[:, None])

    def _light(self, hits: Array, rays: Array) -> Array:
        """Return the light (n, k) that comes back to the lens.

        It is what falls on the wall, which scatters it alike to all sides (Lambert).
        """
        met = np.isfinite(hits[..., RANGE])
        reach = np.where(met, hits[..., RANGE], 1.0)
        # Squared distances from the lamp by the cosine rule: vectors would take most of the time.
        far = reach * (reach - 2 * (rays @ self.lamp)) + self.lamp @ self.lamp
        rings = 1 - self._table.ring * np.exp(-((hits[..., JOINT] / self._table.ring_width) ** 2))
        return np.where(met, hits[..., LIT] * rings / far, 0.0)

    def _received(self, light: Array, rays: Array) -> Array:
        """Light (n, k) behind the lens, which loses some towards the corners of the picture."""
        return light * (1 - self._table.vignetting * (1 - rays[:, 2]) / self._corner)

    def _coded(self, received: Array, metered: NDArray[np.intp] | None = None) -> Array:
        """Pixels (n, k) of light, exposed by the picture's own brightness."""
        table = self._table
        meter = received if metered is None else received[:, metered]
        level = exposure_level(meter)
        # BRIGHT is a pixel's value: to the power of gamma it is light.
        exposed = BRIGHT**table.gamma * received / np.maximum(level, 1e-12)
        return np.clip(exposed, 0.0, 1.0) ** (1 / table.gamma)


def exposure_level(light: Array) -> Array:
    """Return the quantile EXPOSED (n, 1) of light (n, k).

    It is that of ``np.quantile`` bit for bit, which spends most of its time on other cases.
    """
    place = EXPOSED * (light.shape[1] - 1)
    low, part = int(place), place - int(place)
    high = min(low + 1, light.shape[1] - 1)
    ordered = np.partition(light, (low, high), axis=1)
    before, after = ordered[:, low, None], ordered[:, high, None]
    # From the nearer of both, as rounding would else pass it.
    between = after - before
    return after - between * (1 - part) if part >= 0.5 else before + between * part
