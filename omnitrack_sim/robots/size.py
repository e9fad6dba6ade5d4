"""Sizes in proportion to the pipe that a robot is made for, and the law of similar robots."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.quantity import (
    QuantityModel,
    froude_exponent,
    parameter_rows,
    similar,
)

GRAVITY = 9.81
"""Weight of a mass, N/kg, where a figure of a robot asks for it."""
REFERENCE_BORE = 0.16
"""Bore of the paper's pipe, m, for which parameters of control and monitor with a unit are
stated."""


class Sized(QuantityModel):
    """Parameters of a robot that is made for pipes of one bore."""

    @property
    def nominal_bore(self) -> float:
        """Inner diameter of the pipe that the robot is made for, m; here its field ``bore``."""
        try:
            return vars(self)["bore"]
        except KeyError:
            raise NotImplementedError("nominal_bore") from None

    @property
    def nose_room(self) -> float:
        """Room, m, between the nose and the port of a goal where the robot arrives: D/32."""
        return self.nominal_bore / 32

    @property
    def standing_room(self) -> float:
        """Room, m, between the nose and a fitting that the robot stops before: D/8."""
        return self.nominal_bore / 8

    def own_length(self, length: ArrayLike) -> Array:
        """Return lengths that are given for the paper's pipe, m, in proportion to this robot."""
        # In this order a length such as 30 mm and its part of the bore give the same bits.
        return np.asarray(length, float) / REFERENCE_BORE * self.nominal_bore

    @property
    def length_scale(self) -> float:
        """Bore over the paper's, 1."""
        return self.nominal_bore / REFERENCE_BORE

    @property
    def time_scale(self) -> float:
        """Times over those in the paper's pipe, 1: the root of the lengths', at equal gravity."""
        return math.sqrt(self.length_scale)

    def similar_to(self, bore: float) -> dict[str, Any]:
        """Return what to change, by dotted name, for a similar robot made for another bore, m.

        At equal gravity masses and forces grow with the cube of lengths, times with their root.
        """
        factor = bore / self.nominal_bore
        return {
            row.name: similar(row.value, row.unit, factor)
            for row in parameter_rows(self)
            if isinstance(row.value, int | float) and froude_exponent(row.unit)
        }
