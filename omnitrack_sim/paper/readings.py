"""What claims read from results: success rates, slip, the largest value of a metric."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.result import Result


def rate(results: Sequence[Result]) -> tuple[int, int, str]:
    """Passed, total, and both as text with the Wilson 95 % interval."""
    passed, total = sum(r.success for r in results), len(results)
    low, high = wilson_interval(passed, total)
    return (
        passed,
        total,
        (
            f"{passed} of {total} ({100 * passed / total:.1f} %, 95 % interval {100 * low:.1f} to "
            f"{100 * high:.1f})"
        ),
    )


def slip_of(result: Result) -> float:
    """Slip distance, m, summed over the modules."""
    return float(np.sum(np.asarray(result.metrics["slip_distance_m"])))


def largest(result: Result, name: str) -> float:
    """A metric of a run, or the largest of its modules' values, in the metric's unit."""
    return float(np.max(result.metrics[name]))  # type: ignore[arg-type]
