"""Rows of forms that are tried, and what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.recognition.forms import Form
from omnitrack_sim.autonomy.recognition.poses import PLACES
from omnitrack_sim.autonomy.recognition.sighting import Motion
from omnitrack_sim.base.rotations import Array

SIZES = 2
"""Most sizes of a form."""
_COLUMNS = ("numbers", "sizes", "gains", "cost", "normal")


@dataclass(frozen=True)
class Views:
    """Pictures of one approach.

    Attributes:
        pictures: (v, pixels²) on the scale. motions: of the v cameras.
    """

    pictures: Array
    motions: list[Motion]


@dataclass(frozen=True)
class Level:
    """How closely is looked.

    Attributes:
        pixels: (k,) numbers of the pixels.
        stand: (s,) for pixels spread evenly over the picture the place in ``pixels`` of one that
            stands for each, as the exposure depends on the whole. own: (k,) place in ``stand`` of
            each of ``pixels``.
        rough: standard deviations at which a pixel that misses loses its weight.
        free: which of the six numbers of a camera are sought.
        weight: (k,) of each pixel.
        reach: m and rad, by which a camera with a lamp is moved along and turned about the pipe to
            see what that does to the edges in its picture.
    """

    pixels: NDArray[np.intp]
    stand: NDArray[np.intp]
    own: NDArray[np.intp]
    rough: float
    free: NDArray[np.bool_]
    weight: Array
    reach: tuple[float, float]


@dataclass(frozen=True)
class Tries:
    """Forms that are fitted, n rows.

    Attributes:
        forms: of each row. numbers: (n, 6), see ``poses``. sizes: (n, SIZES). gains: (n, v).
        cost: (n,) twice the negative logarithm of the likelihood, without what all share.
        normal: (n, p, p) matrix of the normal equations, of numbers, sizes, gains.
    """

    forms: tuple[Form, ...]
    numbers: Array
    sizes: Array
    gains: Array
    cost: Array
    normal: Array

    def take(self, rows: Sequence[int]) -> Tries:
        """Some of the rows."""
        rows = list(rows)
        return Tries(
            tuple(self.forms[i] for i in rows),
            *(getattr(self, name)[rows] for name in _COLUMNS),
        )


def tries(forms: Sequence[Form], numbers: Array, sizes: Array, views: int) -> Tries:
    """Rows to begin with."""
    n, p = len(forms), PLACES + SIZES + views
    cost, normal = np.full(n, np.inf), np.tile(np.eye(p), (n, 1, 1))
    return Tries(tuple(forms), numbers, sizes, np.ones((n, views)), cost, normal)


def joined(rows: Sequence[Tries]) -> Tries:
    """Rows of several in one."""
    columns = [np.concatenate([getattr(row, name) for row in rows]) for name in _COLUMNS]
    return Tries(tuple(form for row in rows for form in row.forms), *columns)


def merged(better: NDArray[np.bool_], first: Tries, second: Tries) -> Tries:
    """Rows of the first where it is better, of the second elsewhere."""
    values = {}
    for name in _COLUMNS:
        one, other = getattr(first, name), getattr(second, name)
        values[name] = np.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, other)
    return Tries(first.forms, **values)
