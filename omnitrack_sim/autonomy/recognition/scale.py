"""Pictures on a scale where every pixel has the same noise, whatever the camera."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.senses.optics import Camera

_PLACES = 4000


class Scale:
    """The scale of a camera: the sum of steps of one standard deviation, from 0 to a pixel's value.

    A difference of 1 is one standard deviation anywhere (a transform that stabilises variance).
    A pixel without an answer is taken for the farthest or brightest there is.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.top = max(camera.optics.far, 1.0)
        self._values = np.linspace(0.0, self.top, _PLACES)
        spread = camera.spread(self._values[None])[0]
        steps = (1 / spread[1:] + 1 / spread[:-1]) / 2 * np.diff(self._values)
        self._steps = np.concatenate([[0.0], np.cumsum(steps)])

    def of(self, picture: Array) -> Array:
        """A picture (...,) on the scale."""
        filled = np.where(np.isnan(picture), self.top, picture)
        return np.interp(filled, self._values, self._steps)

    def slope(self, expected: Array) -> Array:
        """Change on the scale with the pixel's value (...,); 0 without an answer."""
        spread = self._camera.spread(np.where(np.isnan(expected), self.top, expected))
        return np.where(np.isnan(expected), 0.0, 1 / spread)
