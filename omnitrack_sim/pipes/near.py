"""Which of many balls touch each other, in a time that grows with their number and not its
square."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, length

LARGE = 4.0
"""Balls larger than this many times the median one are compared with all others: the cells that the
others are sorted into would be too large with them."""
BLOCK = 100_000
"""Pairs that are looked at together."""
HERE = (0, 0, 0)
_CELLS_BEHIND = [cell for cell in product((-1, 0, 1), repeat=3) if cell >= HERE]
"""A cell itself and half of its neighbours: every pair of cells is looked at once."""
_FEWEST = 1e-6
"""Least size of a cell as a part of the extent of all, so that the cells can be numbered."""


def touching(centres: Array, radii: Array) -> Iterator[NDArray[np.intp]]:
    """Pairs (k, 2) of balls that touch, the smaller number first; in blocks, so that many balls in
    one place need no memory for all of their pairs.

    Args:
        centres: (n, 3) m.
        radii: (n,) m.
    """
    small = radii <= LARGE * np.median(radii) if len(radii) else np.zeros(0, bool)
    for found in _candidates(centres, radii, small):
        found = np.sort(found, axis=1)
        apart = length(centres[found[:, 0]] - centres[found[:, 1]])
        yield found[apart < radii[found[:, 0]] + radii[found[:, 1]]]


def _candidates(
    centres: Array, radii: Array, small: NDArray[np.bool_]
) -> Iterator[NDArray[np.intp]]:
    """Pairs (k, 2) among which are all balls that touch, each pair once."""
    where = np.flatnonzero(small)
    for pairs in _neighbours(centres[where], 2 * float(radii[where].max(initial=0.0))):
        yield where[pairs]
    for i in np.flatnonzero(~small).tolist():
        # Two large ones meet once, when it is the turn of the first.
        others = np.flatnonzero(small | (np.arange(len(radii)) > i))
        yield np.stack([np.full(len(others), i), others], axis=-1)


def _neighbours(centres: Array, size: float) -> Iterator[NDArray[np.intp]]:
    """Pairs (k, 2) of points in one cell of a cubic grid, or in neighbouring ones; all pairs nearer
    than ``size`` m are among them."""
    if len(centres) < 2:
        return
    extent = np.ptp(centres, axis=0)
    size = max(size, float(extent.max()) * _FEWEST, 1e-9)
    cells = ((centres - centres.min(axis=0)) // size).astype(np.int64) + 1  # (n, 3), from 1
    steps = np.cumprod([1, *(cells.max(axis=0)[:2] + 2)])
    keys = cells @ steps
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    places = np.arange(len(keys))
    for cell in _CELLS_BEHIND:
        wanted = keys + np.array(cell) @ steps
        first, last = (np.searchsorted(keys, wanted, side) for side in ("left", "right"))
        for pairs in _pairs(places, np.maximum(first, places + 1) if cell == HERE else first, last):
            yield order[pairs]


def _pairs(
    of: NDArray[np.intp], first: NDArray[np.intp], last: NDArray[np.intp]
) -> Iterator[NDArray[np.intp]]:
    """Pairs (k, 2) of each of ``of`` (n,) with every number from ``first`` to before ``last`` (n,),
    in blocks of about ``BLOCK``."""
    count = np.maximum(last - first, 0)
    block = np.cumsum(count) // BLOCK
    for number in np.unique(block[count > 0]):
        part = block == number
        some = count[part]
        begins = np.repeat(first[part] - np.cumsum(some) + some, some)
        yield np.stack([np.repeat(of[part], some), begins + np.arange(some.sum())], axis=-1)
