"""Points of the unit cube, and the distributions made of them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from omnitrack_sim.base.rotations import Array

Sampling = Literal["random", "latin_hypercube", "sobol"]
Draws = Literal["common", "independent"]
"""Whether all combinations of the crossed axes share their draws, or each has its own.

``common`` compares the combinations best, ``independent`` covers the random axes best.
"""


def unit_points(count: int, dimensions: int, sampling: Sampling, seed: int) -> Array:
    """Points (count, dimensions) of the open unit cube; the same arguments give the same points."""
    if dimensions == 0:
        return np.empty((count, 0))
    if sampling == "random":
        points = np.random.default_rng(seed).random((count, dimensions))
    else:
        from scipy.stats import qmc  # takes a second to load

        if sampling == "latin_hypercube":
            points = qmc.LatinHypercube(dimensions, rng=seed).random(count)
        else:
            exponent = max(0, (count - 1).bit_length())
            points = qmc.Sobol(dimensions, scramble=True, rng=seed).random_base2(exponent)[:count]
    least = 2.0**-53
    return np.clip(points, least, 1 - least)


def uniform(u: Array, low: float, high: float) -> Array:
    """Values (n,) between ``low`` and ``high``, made of ``u`` (n,) in the unit interval."""
    return np.clip(low + (high - low) * u, low, high)


def normal(u: Array, mean: float, std: float, low: float | None, high: float | None) -> Array:
    """Normal values (n,) made of uniform ``u`` (n,), truncated to ``low`` and ``high`` if given."""
    from scipy.special import ndtr, ndtri

    a = -np.inf if low is None else (low - mean) / std
    b = np.inf if high is None else (high - mean) / std
    # Numbers are finer near 0 than near 1, so an interval above the mean is mirrored.
    mirrored = a > 0
    if mirrored:
        a, b, u = -b, -a, 1 - u
    z = np.clip(ndtri(ndtr(a) + (ndtr(b) - ndtr(a)) * u), a, b)
    return mean + std * (-z if mirrored else z)


def direction(u: Array, v: Array, magnitude: float) -> Array:
    """Vectors (n, 3) of one length, uniform on the sphere.

    Each is made of a point of ``u`` (n,) and one of ``v`` (n,), both in the unit interval.
    """
    z, angle = 2 * u - 1, 2 * np.pi * v
    across = np.sqrt(1 - z**2)
    return magnitude * np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)
