"""The figure of a sweep: where trials pass, chosen by what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Display
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.show.plots.style import COLUMN, GREY, INK, PAGE, PAPER, TICKS, new_figure, styled
from omnitrack_sim.show.plots.success_figure import (
    FAILED_COLOUR,
    PASSED_COLOUR,
    success_colours,
    success_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

THETA5 = "start.theta5_deg"
MOST_ROWS = 4
"""Rows of a map over orientation."""
MOST_CELLS = 40
"""Up to how many different values of a number each has a cell of its own."""
BINS, QUANTILES, FEW = 8, 10, 5
"""Bins along each side of a map, and bins of a main effect.

A cell of a map with fewer than ``FEW`` trials shows their number.
"""
CHART = (COLUMN, 2.9)
"""Size of one chart, inches."""
_NO_OUTCOME = "#dfe2e6"
"""Colour of cells in which no trial has an outcome."""
MOST_ORIENTATIONS = 240
"""Up to how many different orientations each has a cell of its own; more are rounded to degrees."""


@dataclass(frozen=True, eq=False)
class Spread:
    """The values of one axis of a sweep over n trials.

    Attributes:
        name: of the axis.
        unit: of its numbers.
        values: (n,) numbers, or n words.
        order: the different words; empty for numbers.
    """

    name: str
    unit: str
    values: Array | Sequence[str]
    order: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name and unit."""
        return Display(self.name, self.unit).label()


def sweep_figure(axes: Sequence[Spread], passed: Array, case: TurnCase | None = None) -> Figure:
    """Success over what was varied.

    The kind of figure depends on the axes. If only ``start.theta5_deg`` was varied, or it and at
    most four words, the figure is a map of the orientations, with the singular range of ``case``
    behind it. Two numbers give a map. Everything else gives one panel for each axis with its main
    effect, the largest first.

    Args:
        axes: what was varied.
        passed: (n,) 1 passed, 0 failed, not a number where a trial has no outcome.
        case: robot and tee, if the trials turn in a tee.
    """
    numbers = [axis for axis in axes if not axis.order]
    words = [axis for axis in axes if axis.order]
    by_orientation = len(numbers) == 1 and numbers[0].name == THETA5
    if not np.isfinite(passed).any():
        return styled(lambda: _main_effects(axes, passed), PAPER)
    if by_orientation and (not words or (len(words) == 1 and len(words[0].order) <= MOST_ROWS)):
        return _orientations(numbers[0], words[0] if words else None, passed, case)
    if len(numbers) == 2 and not words:
        return styled(lambda: _one_map(numbers[0], numbers[1], passed), PAPER)
    return styled(lambda: _main_effects(axes, passed), PAPER)


def draw_chart(axis: Axes, over: Sequence[Spread], passed: Array) -> None:
    """Success in one chart: the rates over one axis of a sweep with their Wilson 95 % intervals, or
    a map over two that are numbers."""
    axis.tick_params(**TICKS)
    if len(over) == 2:
        _map(axis, over[0], over[1], passed)
    else:
        effect = _effect(over[0], passed)
        _panel(axis, effect, over[0], _lowest(effect))
        axis.set_ylabel("success rate [%]")


def _orientations(
    theta5: Spread, rows: Spread | None, passed: Array, case: TurnCase | None
) -> Figure:
    degrees = np.asarray(theta5.values, float)
    if len(np.unique(degrees)) > MOST_ORIENTATIONS:
        degrees = np.round(degrees)
    if rows is None:
        by_row = {"all trials": passed}
    else:
        word = np.array(rows.values)
        by_row = {name: np.where(word == name, passed, np.nan) for name in rows.order}
        by_row = {name: values for name, values in by_row.items() if np.isfinite(values).any()}
    if case is None:
        return success_figure(degrees, by_row, 0.0)
    real = float(np.degrees((2 * np.pi / case.modules - case.real_sector) / 2))
    return success_figure(
        degrees, by_row, float(np.degrees(case.sector)), real_margin_deg=real if real > 0 else None
    )


def _one_map(x: Spread, y: Spread, passed: Array) -> Figure:
    figure = new_figure(CHART, layout="constrained")
    draw_chart(figure.subplots(), (x, y), passed)
    return figure


def _map(axis: Axes, x: Spread, y: Spread, passed: Array) -> None:
    """Success rate over two numbers."""
    (column, x_edges), (row, y_edges) = _cells(x), _cells(y)
    shape = (len(y_edges) - 1, len(x_edges) - 1)
    known = np.isfinite(passed)
    cell = np.ravel_multi_index((row[known], column[known]), shape)
    total = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    good = np.bincount(cell, passed[known], minlength=shape[0] * shape[1]).reshape(shape)
    rate = np.ma.masked_invalid(np.where(total > 0, 100 * good / np.maximum(total, 1), np.nan))
    axis.set_facecolor(_NO_OUTCOME)
    look = {"cmap": success_colours(), "vmin": 0, "vmax": 100, "lw": 0, "rasterized": True}
    mesh = axis.pcolormesh(x_edges, y_edges, rate, **look)
    if total.max(initial=0) > 1:
        _few(axis, x_edges, y_edges, total)
    if set(rate.compressed().tolist()) <= {0.0, 100.0}:
        _two_colours(axis, bool((total == 0).any()))
    else:
        bar = axis.get_figure(root=True).colorbar(mesh, ax=axis, pad=0.02)  # type: ignore[union-attr]
        bar.set_label("success rate [%]")
        bar.ax.tick_params(**TICKS)
        bar.outline.set_visible(False)  # type: ignore[operator]
    axis.grid(False)
    axis.set_xlabel(x.label)
    axis.set_ylabel(y.label)


def _few(axis: Axes, x_edges: Array, y_edges: Array, total: NDArray) -> None:
    """Write their number into cells with few trials."""
    for i, j in zip(*np.nonzero(total < FEW), strict=True):
        place = float(x_edges[j : j + 2].mean()), float(y_edges[i : i + 2].mean())
        axis.text(*place, str(total[i, j]), ha="center", va="center", size=5.5, color=INK)


def _two_colours(axis: Axes, gaps: bool) -> None:
    """Name the colours of cells that have all passed or all failed; a scale would tell no more."""
    from matplotlib.patches import Patch

    shown = [(PASSED_COLOUR, "passed"), (FAILED_COLOUR, "failed")]
    shown += [(_NO_OUTCOME, "no outcome")] if gaps else []
    handles = [Patch(fc=colour, label=text) for colour, text in shown]
    axis.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=len(handles))


def _cells(spread: Spread) -> tuple[NDArray[np.intp], Array]:
    """Index of each trial's cell (n,), and the edges of the cells."""
    values = np.asarray(spread.values, float)
    centres, cell = np.unique(values, return_inverse=True)
    if len(centres) == 1:
        half = 0.5 * max(abs(centres[0]), 1.0)
        return cell, centres[0] + np.array([-half, half])
    if len(centres) <= MOST_CELLS:
        middle = (centres[1:] + centres[:-1]) / 2
        return cell, np.array([2 * centres[0] - middle[0], *middle, 2 * centres[-1] - middle[-1]])
    edges = np.linspace(centres[0], centres[-1], BINS + 1)
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, BINS - 1), edges


def _main_effects(axes: Sequence[Spread], passed: Array) -> Figure:
    """One panel for each axis, with the success rate over its values."""
    effects = sorted(
        ((_effect(axis, passed), axis) for axis in axes), key=lambda pair: -_spread_of(pair[0])
    )
    columns = min(len(effects), 3)
    rows = -(-len(effects) // columns)
    width = COLUMN if columns == 1 else PAGE
    figure = new_figure((width, 1.9 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    lowest = min(_lowest(effect) for effect, _ in effects)
    for panel, (effect, axis) in zip(panels.flat, effects, strict=False):
        panel.tick_params(**TICKS)
        _panel(panel, effect, axis, lowest)
    for panel in panels.flat[len(effects) :]:
        panel.set_visible(False)
    for panel in panels[:, 0]:
        panel.set_ylabel("success rate [%]")
    known = np.isfinite(passed)
    figure.suptitle(
        f"{int(passed[known].sum())} of {int(known.sum())} passed; bars: Wilson 95 % intervals",
        size=8,
        color=INK,
    )
    return figure


_Effect = list[tuple[float, int, int]]
NEARLY_ALL = 80.0
"""Lower end of the intervals, %, above which the scale of the rates does not begin at 0."""


def _effect(axis: Spread, passed: Array) -> _Effect:
    """(value, passed, counted) of each value or bin of an axis that has counted trials."""
    known = np.isfinite(passed)
    if axis.order:
        words = np.array(axis.values)
        groups = [(float(k), words == word) for k, word in enumerate(axis.order)]
    else:
        values = np.asarray(axis.values, float)
        different = np.unique(values)
        if len(different) <= QUANTILES:
            groups = [(float(value), values == value) for value in different]
        else:
            edges = np.quantile(values, np.linspace(0, 1, QUANTILES + 1))
            bin_of = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, QUANTILES - 1)
            groups = [(float(values[bin_of == k].mean()), bin_of == k) for k in np.unique(bin_of)]
    counted = [
        (place, int(passed[mask & known].sum()), int((mask & known).sum()))
        for place, mask in groups
    ]
    return [entry for entry in counted if entry[2]]


def _spread_of(effect: _Effect) -> float:
    """Difference between the largest and the smallest rate."""
    rates = [good / total for _, good, total in effect]
    return max(rates) - min(rates) if rates else 0.0


def _intervals(effect: _Effect) -> Array:
    """Wilson's interval of each rate (k, 2), %."""
    found = [wilson_interval(good, total) for _, good, total in effect]
    return 100 * np.array(found).reshape(-1, 2)


def _lowest(effect: _Effect) -> float:
    """Where the scale of the rates begins, %: at 0, or where nearly all pass little below the
    lowest interval, so that differences can be seen."""
    least = _intervals(effect).min() if effect else 0.0
    return 0.0 if least < NEARLY_ALL else 5 * float(np.floor(least / 5))


def _panel(panel: Axes, effect: _Effect, axis: Spread, lowest: float) -> None:
    """The rates over one axis, on a scale from ``lowest`` % to 100 %."""
    place = np.array([entry[0] for entry in effect])
    rate = np.array([100 * good / total for _, good, total in effect])
    ends = _intervals(effect)
    style: dict[str, Any] = {
        "color": PASSED_COLOUR,
        "ecolor": GREY,
        "elinewidth": 0.8,
        "capsize": 2.0,
        "marker": "o",
    }
    errors = np.maximum(0.0, [rate - ends[:, 0], ends[:, 1] - rate])
    panel.errorbar(place, rate, errors, ms=3, ls="none" if axis.order else "-", **style)
    if axis.order:
        panel.set_xticks(
            range(len(axis.order)), [word.replace(" ", "\n", 1) for word in axis.order]
        )
        panel.set_xlim(-0.5, len(axis.order) - 0.5)
    else:
        panel.locator_params(axis="x", nbins=6)
    room = 0.04 * (100 - lowest)
    panel.set_ylim(lowest - room, 100 + room)
    panel.set_xlabel(axis.label)
