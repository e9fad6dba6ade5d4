"""Doubt of fitted parameters: noise of residuals, covariance, and what cannot be told apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array

MIN_CORRELATION = 0.05
"""Correlation of residuals at a distance in time, below which they count as independent."""
CHANCE = 3.0
"""Times the square of its uncertainty, from which on the square of a slope counts. That of pure
chance is a third of it on the average, and by luck as large."""
SLIPS = 1.0
"""Time, s, over which chance is averaged. A robot sticks and slips some times a second; over one
slip alone, slopes that are chance are now and then larger than their doubt, by luck."""
UNKNOWN = 0.05
"""Doubt of a direction of parameters, as a part of their values, from which on the logs do not tell
it: what a spring balance and a tilted pipe measure to."""
SHARE = 0.3
"""Share of a parameter in such a direction, from which on it is named."""


def independent_count(residual: Array) -> float:
    """Return the number of independent samples that residuals (m,) are worth, 1 to m.

    It is m over the sum of their correlations at all distances, up to the first that is small. A
    mean that is not zero is fully correlated: a residual that is all offset is worth one sample.
    """
    m, power = len(residual), float(residual @ residual)
    if power == 0:
        return float(m)
    size = 1 << (2 * m - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(residual, size)) ** 2
    # Unbiased, since a long correlation would otherwise seem to fade by the length of the series.
    correlation = np.fft.irfft(spectrum, size)[:m] / power * m / np.arange(m, 0, -1)
    correlation = correlation[: max(1, m // 2)]
    small = np.flatnonzero(correlation < MIN_CORRELATION)
    until = int(small[0]) if len(small) else len(correlation)
    total = 1 + 2 * float(correlation[1:until].sum())
    return float(np.clip(m / max(total, 1.0), 1.0, m))


def smoothed(squares: Array, time: Array) -> Array:
    """Return running means of squares (m,) at times (m,), s, over ``SLIPS``."""
    near = round(SLIPS / 2 / max(float(np.median(np.diff(time))), 1e-9))
    window = np.ones(2 * min(near, (len(squares) - 1) // 2) + 1)
    count = np.convolve(np.ones(len(squares)), window, mode="same")
    return np.convolve(squares, window, mode="same") / count


def foreseeable(slopes: Array, chances: Array) -> Array:
    """Return how much samples (m,) count, from 0 to 1: not where their slopes may be chance.

    Args:
        slopes: mean squares of the derivatives around each sample.
        chances: mean squares of what these are uncertain by.
    """
    share = 1 - CHANCE * chances / np.where(slopes > 0, slopes, 1.0)
    return np.where(slopes > 0, share, 1.0).clip(0.0)


def noise_of(residual: Array, variance: Array) -> float:
    """Return the root mean square of residuals (m,), those of a small ``variance`` (m,) counting.

    A square is known to a multiple of its variance, and counts by one over the square of that.
    """
    return float(np.sqrt(np.sum((residual / variance) ** 2) / np.sum(1 / variance**2)))


@dataclass(frozen=True)
class Indistinct:
    """A direction in which parameters may be changed together and the logs are met as well.

    Attributes:
        weights: share of each parameter that has one worth naming, by path; its sign says whether
            it grows or falls with the others.
        doubt: standard deviation along it, as a part of the values.
    """

    weights: Mapping[str, float]
    doubt: float

    @property
    def text(self) -> str:
        """The direction in words."""
        # Beyond its own size a doubt has no meaning as a part of it.
        part = f"{100 * self.doubt:.0f} %" if self.doubt < 1 else "its own size or more"
        if len(self.weights) == 1:
            (path,) = self.weights
            return f"the logs do not tell {path}: it is open by {part}"
        first, *others = self.weights
        ways = [
            f"{path} {'up' if self.weights[path] * self.weights[first] > 0 else 'down'}"
            for path in others
        ]
        return (
            f"the logs cannot tell {' and '.join(self.weights)} apart: {first} up with "
            f"{' and '.join(ways)} meets them as well; open by {part}"
        )


def information_of(slopes: Array, doubts: Array) -> Array:
    """Return what a column tells (p, p), without what its slopes owe to chance.

    Squares of slopes that are chance add up as those of others do: they would tell parameters apart
    that nothing tells apart.

    Args:
        slopes: (m, p) derivatives of the column over its noise.
        doubts: (m, p) what each is uncertain by.
    """
    strengths, directions = np.linalg.eigh(slopes.T @ slopes - np.diag(np.sum(doubts**2, axis=0)))
    return (directions * np.maximum(strengths, 0.0)) @ directions.T


def indistinct_of(paths: Sequence[str], information: Array) -> list[Indistinct]:
    """Return the directions that an information matrix (p, p) of the data leaves open.

    Args:
        paths: of the parameters.
        information: of relative changes, from the logs alone, without what was known before.
    """
    strengths, directions = np.linalg.eigh(information)
    found = []
    for strength, direction in zip(strengths, directions.T, strict=True):
        doubt = 1 / np.sqrt(max(float(strength), 1e-12))
        if doubt <= UNKNOWN:
            continue
        largest = direction[np.argmax(np.abs(direction))]
        shares = {
            path: float(share * np.sign(largest))
            for path, share in zip(paths, direction, strict=True)
            if abs(share) >= SHARE
        }
        ordered = dict(sorted(shares.items(), key=lambda item: -abs(item[1])))
        found.append(Indistinct(ordered, float(min(doubt, 1e3))))
    return found


def draw_within(points: Array, values: Array, covariance: Array, low: Array, high: Array) -> Array:
    """Return draws (n, p) of a normal distribution within bounds, made of points of the unit cube.

    One parameter after the other is drawn, given those before it, from its distribution truncated
    at its ends.

    Args:
        points: (n, p), each number between 0 and 1.
        values: (p,) means.
        covariance: (p, p).
        low: (p,) lower ends.
        high: (p,) upper ends.
    """
    from scipy.special import ndtr, ndtri

    root = _root(covariance)
    normal = np.zeros_like(points)
    drawn = np.empty_like(points)
    for j, u in enumerate(points.T):
        mean, std = values[j] + normal[:, :j] @ root[j, :j], root[j, j]
        if std <= 0:
            drawn[:, j] = np.clip(mean, low[j], high[j])
            continue
        a, b = (low[j] - mean) / std, (high[j] - mean) / std
        # Numbers are finer near 0 than near 1, so an interval above the mean is mirrored.
        sign = np.where(a > 0, -1.0, 1.0)
        first, last = ndtr(np.where(a > 0, -b, a)), ndtr(np.where(a > 0, -a, b))
        share = np.where(a > 0, 1 - u, u)
        normal[:, j] = np.clip(sign * ndtri(first + (last - first) * share), a, b)
        drawn[:, j] = np.clip(mean + std * normal[:, j], low[j], high[j])
    return drawn


def _root(covariance: Array) -> Array:
    """Lower triangular root of a covariance; parameters of no doubt have zeros."""
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0, scale, 1.0)
    correlation = covariance / np.outer(safe, safe)
    # Eigenvalues that rounding or digits of a file have made negative become zero.
    strengths, directions = np.linalg.eigh(correlation)
    half = directions * np.sqrt(np.maximum(strengths, 0))
    _, upper = np.linalg.qr(half.T)
    lower = upper.T * np.where(np.diag(upper) < 0, -1.0, 1.0)
    return scale[:, None] * lower
