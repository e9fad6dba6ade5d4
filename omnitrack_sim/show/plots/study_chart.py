"""The figure of a study: its front, or how one objective came down."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted
from omnitrack_sim.show.plots.style import ALARM, CURVE_COLOURS, GREY, INK, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FRONT, CHECKED = CURVE_COLOURS[:2]
_MAX_PANELS = 15
"""Pairs of objectives that have a panel; of more only the first ones."""
_LABELS_ACROSS = 3
"""Words of the legend that stand side by side below a panel."""
_BULK = (2, 98)
"""Percentiles of the values between which a panel shows everything, beside front and start."""


@dataclass(frozen=True, eq=False)
class ObjectiveAxis:
    """One objective.

    Attributes:
        name: of its column.
        unit: of its values.
        goal: "minimise" or "maximise".
        limit: the worst value allowed; None without one.
    """

    name: str
    unit: str
    goal: str
    limit: float | None = None

    @property
    def label(self) -> str:
        """Name in words, unit and which way is better."""
        unit = "" if self.unit == "1" else f" [{self.unit}]"
        ending = "_" + self.unit.lower().replace(" ", "").replace("/", "_")
        words = self.name.removesuffix(ending).replace("_", " ")
        return f"{words}{unit}, {'less' if self.goal == 'minimise' else 'more'} is better"


@dataclass(frozen=True, eq=False)
class TriedCandidates:
    """TriedCandidates of a study and their values.

    Attributes:
        values: (C, m) of the objectives, in the order of the candidates, the start first; infinite
            where there is none.
        feasible: (C,) whether all limits are kept.
        front: places of the candidates on the front.
        best: place of the best one.
        checked: (F, m) of the candidates that were checked, on trials of their own.
        places: (F,) of the candidates that were checked.
    """

    values: Array
    feasible: NDArray[np.bool_]
    front: Sequence[int]
    best: int
    checked: Array
    places: Sequence[int]

    @property
    def best_label(self) -> str:
        """Name of the best candidate: with a check it may be beaten in the search."""
        if not len(self.places):
            return "best"
        of = "in the search" if self.values.shape[1] == 1 else "on the front"
        return "best in the check" + ("" if self.best in self.front else f", not {of}")


@style()
def study_figure(scales: Sequence[ObjectiveAxis], tried: TriedCandidates) -> Figure:
    """Plot the candidates of a search over each pair of objectives with the front between them.

    With one objective it is plotted over the course of the search.
    """
    return _course(scales[0], tried) if len(scales) == 1 else _fronts(scales, tried)


def _course(scale: ObjectiveAxis, tried: TriedCandidates) -> Figure:
    figure = new_figure((6.4, 4.2), layout="constrained")
    panel = figure.subplots()
    values = tried.values[:, 0]
    number, kept = np.arange(float(len(values))), np.isfinite(values) & tried.feasible
    _draw_candidates(panel, number, values, tried.feasible)
    better = np.minimum if scale.goal == "minimise" else np.maximum
    worst = np.inf if scale.goal == "minimise" else -np.inf
    so_far = better.accumulate(np.where(kept, values, worst))
    so_far = np.where(np.isfinite(so_far), so_far, np.nan)
    panel.plot(number, so_far, drawstyle="steps-post", color=FRONT, label="best so far")
    if np.isfinite(values[0]):
        panel.axhline(values[0], color=INK, lw=0.8, ls="--", label="start")
    _draw_marks(panel, (number, number[list(tried.places)]), (values, tried.checked[:, 0]), tried)
    if scale.limit is not None:
        panel.axhline(scale.limit, color=ALARM, lw=0.8, ls=":")
    panel.set_ylim(*_bulk(tried, 0))
    _note_outside(panel, number, values)
    panel.set_xlabel("candidate")
    panel.set_ylabel(scale.label)
    _legend(figure, panel, 1)
    return figure


def _fronts(scales: Sequence[ObjectiveAxis], tried: TriedCandidates) -> Figure:
    wide = [i for i in range(len(scales)) if np.ptp(_ends(tried, i) or [0.0]) > 0]
    # An objective that nothing changed has no front with another one.
    shown = wide if len(wide) > 1 else list(range(len(scales)))
    pairs = list(itertools.combinations(shown, 2))[:_MAX_PANELS]
    columns = min(len(pairs), 3)
    rows = -(-len(pairs) // columns)
    size = (5.2 if len(pairs) == 1 else 3.8) * columns
    figure = new_figure((size + 0.4, 3.6 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    for panel, (i, k) in zip(panels.flat, pairs, strict=False):
        _draw_pair(panel, scales, tried, i, k)
    for panel in panels.flat[len(pairs) :]:
        panel.set_visible(False)
    _legend(figure, panels.flat[0], columns)
    left_out = [i for i in range(len(scales)) if i not in shown]
    if left_out:
        words = (_in_words(scales[i], tried.values[:, i], tried.best) for i in left_out)
        figure.suptitle("; ".join(words), fontsize=8, x=0.01, ha="left")
    return figure


def _in_words(scale: ObjectiveAxis, values: Array, best: int) -> str:
    """Say how many candidates share the best one's value of an objective."""
    count = np.count_nonzero(values == values[best])
    name = scale.label.partition(",")[0]
    return f"{name} is {values[best]:g} for {count} of {counted(len(values), 'candidate')}"


def _legend(figure: Figure, axis: Axes, columns: int) -> None:
    """The words of one panel below all, where they cover nothing."""
    handles, labels = axis.get_legend_handles_labels()
    across = min(len(labels), _LABELS_ACROSS * columns)
    figure.legend(handles, labels, loc="outside lower center", ncols=across, fontsize=8)


def _draw_pair(
    panel: Axes, scales: Sequence[ObjectiveAxis], tried: TriedCandidates, i: int, k: int
) -> None:
    """Draw the candidates over the objectives i, to the right, and k."""
    x, y = tried.values[:, i], tried.values[:, k]
    _draw_candidates(panel, x, y, tried.feasible)
    front = list(tried.front)
    order = np.lexsort((y[front], x[front]))
    style = "-o" if len(scales) == 2 else "o"
    panel.plot(x[front][order], y[front][order], style, ms=4, color=FRONT, label="front")
    if np.isfinite([x[0], y[0]]).all():
        panel.plot(x[0], y[0], "s", ms=6, color=INK, label="start")
    _draw_marks(panel, (x, tried.checked[:, i]), (y, tried.checked[:, k]), tried)
    for line, limit in ((panel.axvline, scales[i].limit), (panel.axhline, scales[k].limit)):
        if limit is not None:
            line(limit, color=ALARM, lw=0.8, ls=":")
    panel.set_xlim(*_bulk(tried, i))
    panel.set_ylim(*_bulk(tried, k))
    _note_outside(panel, x, y)
    panel.set_xlabel(scales[i].label)
    panel.set_ylabel(scales[k].label)


def _draw_candidates(axis: Axes, x: Array, y: Array, feasible: NDArray[np.bool_]) -> None:
    """Draw all candidates, those beyond a limit hollow."""
    look = {"ms": 2.5, "color": GREY, "alpha": 0.6}
    known = np.isfinite(x) & np.isfinite(y)
    kept, beyond = known & feasible, known & ~feasible
    axis.plot(x[kept], y[kept], "o", label="candidates", **look)
    if beyond.any():
        hollow = {"mfc": "none", "mew": 0.5, "label": "beyond a limit"}
        axis.plot(x[beyond], y[beyond], "o", **look, **hollow)


def _draw_marks(
    axis: Axes, x: tuple[Array, Array], y: tuple[Array, Array], tried: TriedCandidates
) -> None:
    """Draw the checked candidates at their values on other trials, and a ring around the best.

    Each is joined to its values in the search; the start (place 0) has its own colour. ``x`` and
    ``y`` hold the values (C,) of the candidates and (F,) of their checks.
    """
    places = np.asarray(tried.places, int)
    known = np.isfinite([x[1], y[1]]).all(axis=0)
    for own, label, colour in (
        (known & (places != 0), "checked on other trials", CHECKED),
        (known & (places == 0), "start, checked", INK),
    ):
        if own.any():
            ends = [np.stack([search[places[own]], check[own]]) for search, check in (x, y)]
            axis.plot(*ends, color=colour, lw=0.8)
            axis.plot(ends[0][1], ends[1][1], "D", ms=5, mfc="none", color=colour, label=label)
    best = x[0][tried.best], y[0][tried.best]
    if np.isfinite(best).all():
        axis.plot(*best, "o", ms=10, mfc="none", color=ALARM, label=tried.best_label)


def _note_outside(axis: Axes, x: Array, y: Array) -> None:
    """Say above a panel whose range is set how many of the candidates it does not show."""
    known = np.isfinite(x) & np.isfinite(y)
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    inside = (x >= left) & (x <= right) & (y >= low) & (y <= high)
    counts = {"outside": int((known & ~inside).sum()), "without a value": int((~known).sum())}
    parts = [f"{count} {where}" for where, count in counts.items() if count]
    if parts:
        text = f"not shown of {counted(len(x), 'candidate')}: {', '.join(parts)}"
        axis.set_title(text, loc="right", fontsize=8, color=INK)


def _bulk(tried: TriedCandidates, objective: int) -> tuple[float | None, float | None]:
    """Limits of an axis that shows the ends of an objective, with room beside them."""
    ends = _ends(tried, objective)
    if not ends:
        return None, None
    room = 0.05 * (max(ends) - min(ends)) or 0.05 * max(abs(ends[0]), 1.0)
    return min(ends) - room, max(ends) + room


def _ends(tried: TriedCandidates, objective: int) -> list[float]:
    """Return values of an objective between which its axis lies.

    The bulk of all, and start, best, front and checks are within them; single wild ones fall
    outside.
    """
    values = tried.values[:, objective]
    ends = [*values[[0, tried.best, *tried.front]], *tried.checked[:, objective]]
    known = values[np.isfinite(values)]
    ends += np.percentile(known, _BULK).tolist() if len(known) else []
    return [end for end in ends if np.isfinite(end)]
