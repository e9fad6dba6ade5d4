"""Which of many balls touch each other, in a time that grows with their number and not its
square."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.rotations import Array, length

LARGE = 4.0
"""Balls larger than this many times the median one are compared with all others: the cells that the
others are sorted into would be too large with them."""
_CELLS_BEHIND = [cell for cell in product((-1, 0, 1), repeat=3) if cell > (0, 0, 0)]
"""Half of the neighbours of a cell: every pair of cells is looked at once."""
_FEWEST = 1e-6
"""Least size of a cell as a part of the extent of all, so that the cells can be numbered."""


def touching(centres: Array, radii: Array) -> NDArray[np.intp]:
    """Pairs (k, 2) of balls that touch, the smaller number first, in order.

    Args:
        centres: (n, 3) m.
        radii: (n,) m.
    """
    small = radii <= LARGE * np.median(radii) if len(radii) else np.zeros(0, bool)
    where = np.flatnonzero(small)
    pairs = [where[_candidates(centres[where], 2 * float(radii[where].max(initial=0.0)))]]
    for i in np.flatnonzero(~small).tolist():
        # Two large ones meet once, when it is the turn of the first.
        others = np.flatnonzero(small | (np.arange(len(radii)) > i))
        pairs.append(np.stack([np.full(len(others), i), others], axis=-1))
    found = np.sort(np.concatenate(pairs), axis=1)
    apart = length(centres[found[:, 0]] - centres[found[:, 1]])
    found = found[apart < radii[found[:, 0]] + radii[found[:, 1]]]
    return found[np.lexsort((found[:, 1], found[:, 0]))]


def _candidates(centres: Array, size: float) -> NDArray[np.intp]:
    """Pairs (k, 2) of points in one cell of a cubic grid, or in neighbouring ones; all pairs nearer
    than ``size`` m are among them."""
    if len(centres) < 2:
        return np.zeros((0, 2), np.intp)
    extent = np.ptp(centres, axis=0)
    size = max(size, float(extent.max()) * _FEWEST, 1e-9)
    cells = ((centres - centres.min(axis=0)) // size).astype(np.int64) + 1  # (n, 3), from 1
    steps = np.cumprod([1, *(cells.max(axis=0)[:2] + 2)])
    keys = cells @ steps
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    places = np.arange(len(keys))
    pairs = [_pairs(places, places + 1, np.searchsorted(sorted_keys, sorted_keys, "right"))]
    for cell in _CELLS_BEHIND:
        wanted = sorted_keys + np.array(cell) @ steps
        first, last = (np.searchsorted(sorted_keys, wanted, side) for side in ("left", "right"))
        pairs.append(_pairs(places, first, last))
    return order[np.concatenate(pairs)]


def _pairs(
    of: NDArray[np.intp], first: NDArray[np.intp], last: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Pairs (k, 2) of each of ``of`` (n,) with every number from ``first`` to before ``last``
    (n,)."""
    count = np.maximum(last - first, 0)
    begins = np.repeat(first - np.cumsum(count) + count, count)
    return np.stack([np.repeat(of, count), begins + np.arange(count.sum())], axis=-1)
