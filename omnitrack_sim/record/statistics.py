"""Statistics of counts."""

from __future__ import annotations

import math

Z95 = 1.959963984540054
"""Standard normal quantile of a two-sided 95 % interval."""


def wilson_interval(passed: int, total: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a rate, both ends 0 to 1; (0, 1) where nothing was tried."""
    if total == 0:
        return 0.0, 1.0
    rate, z2 = passed / total, Z95**2
    centre = (passed + z2 / 2) / (total + z2)
    half = Z95 * math.sqrt(total * rate * (1 - rate) + z2 / 4) / (total + z2)
    low = centre - half if passed > 0 else 0.0
    high = centre + half if passed < total else 1.0
    return low, high
