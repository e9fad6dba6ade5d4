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
from omnitrack_sim.record.channels import MODULE_COLOURS
from omnitrack_sim.show.plots.style import ALARM, GREY, INK, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FRONT, CHECKED = MODULE_COLOURS[1], MODULE_COLOURS[0]
_MOST_PANELS = 15
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
class Tried:
    """What was tried.

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
        """What the best one is the best of: with a check it may be beaten in the search."""
        if not len(self.places):
            return "best"
        of = "in the search" if self.values.shape[1] == 1 else "on the front"
        return "best in the check" + ("" if self.best in self.front else f", not {of}")


def study_figure(scales: Sequence[ObjectiveAxis], tried: Tried) -> Figure:
    """The candidates over each pair of objectives with the front between them; with one objective
    over the course of the search."""
    if len(scales) == 1:
        return styled(lambda: _course(scales[0], tried))
    return styled(lambda: _fronts(scales, tried))


def _course(scale: ObjectiveAxis, tried: Tried) -> Figure:
    figure = new_figure((6.4, 4.2), layout="constrained")
    axis = figure.subplots()
    values = tried.values[:, 0]
    number = np.arange(float(len(values)))
    shown = np.isfinite(values) & tried.feasible
    _dots(axis, number[shown], values[shown], number[~shown], values[~shown])
    better = np.minimum if scale.goal == "minimise" else np.maximum
    worst = np.inf if scale.goal == "minimise" else -np.inf
    so_far = better.accumulate(np.where(shown, values, worst))
    axis.plot(
        number, np.where(np.isfinite(so_far), so_far, np.nan),
        drawstyle="steps-post", color=FRONT, label="best so far",
    )  # fmt: skip
    if np.isfinite(values[0]):
        axis.axhline(values[0], color=INK, lw=0.8, ls="--", label="start")
    places = np.asarray(tried.places, int)
    _checks(axis, places, (number, values), (number[places], tried.checked[:, 0]))
    if shown[tried.best]:
        _ring(axis, number[tried.best], values[tried.best], tried.best_label)
    _limits(axis, scale, None)
    told = [values[0], values[tried.best], *values[tried.front], *tried.checked[:, 0]]
    _bulk(axis.set_ylim, values, told)
    _note_outside(axis, number, values)
    axis.set_xlabel("candidate")
    axis.set_ylabel(scale.label)
    _legend(figure, axis, 1)
    return figure


def _fronts(scales: Sequence[ObjectiveAxis], tried: Tried) -> Figure:
    pairs = list(itertools.combinations(range(len(scales)), 2))[:_MOST_PANELS]
    columns = min(len(pairs), 3)
    rows = -(-len(pairs) // columns)
    size = (5.2 if len(pairs) == 1 else 3.8) * columns
    figure = new_figure((size + 0.4, 3.6 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    for panel, (i, k) in zip(panels.flat, pairs, strict=False):
        _pair(panel, scales[i], scales[k], tried, i, k)
    for panel in panels.flat[len(pairs) :]:
        panel.set_visible(False)
    _legend(figure, panels.flat[0], columns)
    return figure


def _legend(figure: Figure, axis: Axes, columns: int) -> None:
    """The words of one panel below all, where they cover nothing."""
    handles, labels = axis.get_legend_handles_labels()
    across = min(len(labels), _LABELS_ACROSS * columns)
    figure.legend(handles, labels, loc="outside lower center", ncols=across, fontsize=8)


def _pair(panel: Axes, x: ObjectiveAxis, y: ObjectiveAxis, tried: Tried, i: int, k: int) -> None:
    """The candidates over two of the objectives."""
    across, up = tried.values[:, i], tried.values[:, k]
    shown = np.isfinite(across) & np.isfinite(up)
    good, bad = shown & tried.feasible, shown & ~tried.feasible
    _dots(panel, across[good], up[good], across[bad], up[bad])
    front = list(tried.front)
    order = np.lexsort((up[front], across[front]))
    style = "-o" if tried.values.shape[1] == 2 else "o"
    panel.plot(across[front][order], up[front][order], style, ms=4, color=FRONT, label="front")
    again = (tried.checked[:, i], tried.checked[:, k])
    _checks(panel, np.asarray(tried.places, int), (across, up), again)
    if shown[0]:
        panel.plot(across[0], up[0], "s", ms=6, color=INK, label="start")
    if shown[tried.best]:
        _ring(panel, across[tried.best], up[tried.best], tried.best_label)
    for own, scale, place in ((panel.set_xlim, across, i), (panel.set_ylim, up, k)):
        told = [scale[0], scale[tried.best], *scale[front], *tried.checked[:, place]]
        _bulk(own, scale, told)
    _note_outside(panel, across, up)
    _limits(panel, y, x)
    panel.set_xlabel(x.label)
    panel.set_ylabel(y.label)


def _dots(axis: Axes, x: Array, y: Array, x_refused: Array, y_refused: Array) -> None:
    """All candidates, those beyond a limit hollow."""
    axis.plot(x, y, "o", ms=2.5, color=GREY, alpha=0.6, label="candidates")
    if len(x_refused):
        axis.plot(
            x_refused, y_refused, "o", ms=2.5, mfc="none", mew=0.5, color=GREY, alpha=0.6,
            label="beyond a limit",
        )  # fmt: skip


def _checks(
    axis: Axes, places: NDArray[np.intp], tried: tuple[Array, Array], again: tuple[Array, Array]
) -> None:
    """What the checked candidates have shown on other trials, each tied to what it had shown in
    the search; the start, place 0, in its own colour."""
    known = np.isfinite(again).all(axis=0)
    for own, label, colour in (
        (known & (places != 0), "checked on other trials", CHECKED),
        (known & (places == 0), "start, checked", INK),
    ):
        if not own.any():
            continue
        ends = [
            np.stack([before[places[own]], after[own]])
            for before, after in zip(tried, again, strict=True)
        ]
        axis.plot(*ends, color=colour, lw=0.8)
        axis.plot(ends[0][1], ends[1][1], "D", ms=5, mfc="none", color=colour, label=label)


def _ring(axis: Axes, x: float, y: float, label: str) -> None:
    """A ring about the best one."""
    axis.plot(x, y, "o", ms=10, mfc="none", color=ALARM, label=label)


def _note_outside(axis: Axes, x: Array, y: Array) -> None:
    """Say above a panel whose range is set how many of the candidates it does not show."""
    known = np.isfinite(x) & np.isfinite(y)
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    inside = (x >= left) & (x <= right) & (y >= low) & (y <= high)
    outside, without = int((known & ~inside).sum()), int((~known).sum())
    told = [
        f"{count} {where}"
        for count, where in ((outside, "outside"), (without, "without a value"))
        if count
    ]
    if told:
        text = f"not shown of {counted(len(x), 'candidate')}: {', '.join(told)}"
        axis.set_title(text, loc="right", fontsize=8, color=INK)


def _limits(axis: Axes, up: ObjectiveAxis, across: ObjectiveAxis | None) -> None:
    """Lines at the limits."""
    if up.limit is not None:
        axis.axhline(up.limit, color=ALARM, lw=0.8, ls=":")
    if across is not None and across.limit is not None:
        axis.axvline(across.limit, color=ALARM, lw=0.8, ls=":")


def _bulk(set_range, values: Array, told: Sequence[float]) -> None:
    """Show the bulk of the values and all that are ``told``; single wild ones fall outside."""
    known = values[np.isfinite(values)]
    ends = [value for value in told if np.isfinite(value)]
    ends += np.percentile(known, _BULK).tolist() if len(known) else []
    if ends:
        room = 0.05 * (max(ends) - min(ends)) or 0.05 * max(abs(ends[0]), 1.0)
        set_range(min(ends) - room, max(ends) + room)
