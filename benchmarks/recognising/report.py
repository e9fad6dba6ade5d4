"""Tables of how often a recogniser is right."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shape import markdown

from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.record.statistics import rate_text
from recognising.approaches import CASES, TURNED


@dataclass(frozen=True)
class Found:
    """What came of an approach.

    Attributes:
        index, case, distance, fitting: of the approach. told: kind and port. right: of both.
        sure: probability told. turn_error: rad. distance_error: m. seconds: of processor time.
    """

    index: int
    case: str
    distance: float
    fitting: str
    told: str
    right: bool
    sure: float
    turn_error: float
    distance_error: float
    seconds: float


def rate(passed: Sequence[bool]) -> str:
    """How many of how many, and the interval of 95 %."""
    return rate_text(sum(passed), len(passed))


def summary(runs: dict[str, list[Found]]) -> str:
    """A row for each way to look."""
    heads = (
        "camera, pictures",
        "kind and port right",
        "said to be sure",
        "right of these",
        "direction within 5 degrees",
        "time of one",
    )
    rows = []
    for name, found in runs.items():
        sure = [f for f in found if f.sure >= RECOGNISER.confidence]
        turned = [f for f in found if f.case in TURNED and f.right]
        rows.append(
            (
                name,
                rate([f.right for f in found]),
                f"{100 * len(sure) / len(found):.0f} %",
                rate([f.right for f in sure]) if sure else "-",
                rate([f.turn_error < math.radians(5) for f in turned]) if turned else "-",
                f"{1000 * np.median([f.seconds for f in found]):.0f} ms",
            )
        )
    return markdown(heads, rows)


def by_case(found: Sequence[Found]) -> str:
    """What was told of each case, and how well distance and direction were."""
    heads = ("ahead", "right", "told instead", "distance, median, 95 %", "direction, median, 95 %")
    rows = []
    for case in CASES:
        these = [f for f in found if f.case == case]
        right = [f for f in these if f.right]
        wrong = Counter(f.told for f in these if not f.right)
        instead = ", ".join(f"{count} {told}" for told, count in wrong.most_common()) or "-"
        placed = _quantiles([1000 * abs(f.distance_error) for f in right], "mm")
        turned = _quantiles([math.degrees(f.turn_error) for f in right], "deg")
        rows.append(
            (
                case,
                rate([f.right for f in these]) if these else "-",
                instead,
                placed if case != "straight" else "-",
                turned if case in TURNED else "-",
            )
        )
    return markdown(heads, rows)


def by_distance(runs: dict[str, list[Found]]) -> str:
    """Error of the direction, deg, over the distance of the fitting."""
    edges = (0.08, 0.14, 0.2, 0.26, 0.35)
    spans = list(itertools.pairwise(edges))
    heads = ("direction, median, 95 %", *(f"{a:g} to {b:g} m" for a, b in spans))
    rows = []
    for name, found in runs.items():
        turned = [f for f in found if f.case in TURNED and f.right]
        rows.append(
            (
                name,
                *(
                    _quantiles(
                        [math.degrees(f.turn_error) for f in turned if a <= f.distance < b], "deg"
                    )
                    for a, b in spans
                ),
            )
        )
    return markdown(heads, rows)


def failures(found: Sequence[Found]) -> str:
    """What was wrong, one line each."""
    return "\n".join(
        f"  {f.index}: {f.case} at {f.distance:.3f} m, {f.fitting}: {f.told}, sure {f.sure:.2f}"
        for f in found
        if not f.right
    )


def _quantiles(errors: Sequence[float], unit: str) -> str:
    if not errors:
        return "-"
    return f"{np.median(errors):.1f}, {np.quantile(errors, 0.95):.1f} {unit}"
