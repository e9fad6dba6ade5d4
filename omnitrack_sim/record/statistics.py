"""Statistics of counts and means."""

from __future__ import annotations

import math
from collections.abc import Sequence

Z95 = 1.959963984540054
"""Standard normal quantile of a two-sided 95 % interval."""


def wilson_interval(passed: int, total: int, z: float = Z95) -> tuple[float, float]:
    """Wilson's interval of a rate, both ends 0 to 1; (0, 1) where nothing was tried.

    Args:
        passed: trials that passed.
        total: all trials.
        z: standard normal quantile of the interval's two sides, of 95 % by default.
    """
    if total == 0:
        return 0.0, 1.0
    # Unlike the normal approximation it stays within 0 to 1, and accurate near either end.
    rate, z2 = passed / total, z**2
    centre = (passed + z2 / 2) / (total + z2)
    half = z * math.sqrt(total * rate * (1 - rate) + z2 / 4) / (total + z2)
    # At the ends the formula gives 0 and 1 but for rounding.
    low = centre - half if passed > 0 else 0.0
    high = centre + half if passed < total else 1.0
    return low, high


def rate_text(passed: int, total: int) -> str:
    """Return a rate with Wilson's 95 % interval, as in "9 of 10 (59.6 to 98.2 %)"."""
    low, high = wilson_interval(passed, total)
    return f"{passed} of {total} ({100 * low:.1f} to {100 * high:.1f} %)"


def paired_rate_interval(gained: int, lost: int, total: int) -> tuple[float, float]:
    """95 % interval of a difference of two rates over the same trials, -1 to 1.

    Bonett and Price (2012), "Adjusted Wald confidence interval for a difference of binomial
    proportions based on paired data"; (-1, 1) where nothing was tried.

    Args:
        gained: trials that the first passed and the second did not.
        lost: the other way round.
        total: all trials.
    """
    if total == 0:
        return -1.0, 1.0
    # One more pair of each kind, two trials in all: the adjustment of the paper.
    more, fewer = (gained + 1) / (total + 2), (lost + 1) / (total + 2)
    difference = more - fewer
    half = Z95 * math.sqrt((more + fewer - difference**2) / (total + 2))
    return max(difference - half, -1.0), min(difference + half, 1.0)


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % interval of a mean by Student's t; not a number for fewer than two values."""
    # Loaded here, since scipy takes far longer to load than this module.
    from scipy.stats import t

    count = len(values)
    if count < 2:
        return math.nan, math.nan
    # Exact sums do not depend on the order in which trials have come in.
    mean = math.fsum(values) / count
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    half = float(t.ppf(0.975, count - 1)) * math.sqrt(variance / count)
    return mean - half, mean + half


def rate_difference_interval(passed: int, total: int, other: int, of: int) -> tuple[float, float]:
    """95 % interval of one rate less another, of trials that share nothing, -1 to 1.

    Newcombe (1998), "Interval estimation for the difference between independent proportions",
    method 10: both rates at the ends of their own Wilson intervals, their errors added in squares;
    (-1, 1) where nothing was tried. Rates over the same trials take ``paired_rate_interval``.

    Args:
        passed: trials of the first rate that passed.
        total: all of them.
        other: trials of the second rate that passed.
        of: all of them.
    """
    if total == 0 or of == 0:
        return -1.0, 1.0
    one, two = passed / total, other / of
    (low, high), (other_low, other_high) = (
        wilson_interval(passed, total),
        wilson_interval(other, of),
    )
    down, up = math.hypot(one - low, other_high - two), math.hypot(high - one, two - other_low)
    return one - two - down, one - two + up
