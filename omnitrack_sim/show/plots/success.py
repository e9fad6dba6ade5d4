"""Figures of success rates over start orientations, axes of a sweep, or entries."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.base.text import clipped
from omnitrack_sim.record.channels import Display
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.show.plots.style import (
    COLUMN,
    CURVE_COLOURS,
    GREY,
    INK,
    PAGE,
    PAPER,
    TICKS,
    new_figure,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

PASSED_COLOUR, FAILED_COLOUR, SINGULAR_COLOUR = "#2f6db3", "#e8882e", "#f6e3a3"
_GROUPS = (*CURVE_COLOURS[:3], INK)
"""Colours of groups that are compared, at most ``MAX_ROWS``."""
_TRIAL: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 2.2, "color": INK}
"""The mark of a trial in a map with one in each cell."""
_NO_OUTCOME = "#dfe2e6"
"""Colour of cells in which no trial has an outcome."""
PERIOD = 120.0
"""Angle after which orientations of the robot repeat, degrees."""
_REAL: dict[str, Any] = {"color": INK, "lw": 1.1, "ls": (0, (4, 2))}
"""Lines at the margin of the real geometry."""
THETA5 = "start.theta5_deg"
MAX_ORIENTATIONS = 240
"""Most distinct orientations that have a cell each; more are rounded to degrees."""
MAX_ROWS = 4
"""Rows of a map over orientation."""
MAX_CELLS = 40
"""Most distinct values of a number that have a cell each."""
MAX_TICKS, MIN_APART = 10, 0.08
"""Most values of which each has its tick, and how near two of them may be, as a part of the axis.
"""
MIN_BINNED, FULL_GRID = 320, 2.0
"""Trials from which on a map of random ones has bins, five in each in the mean; and points of a
grid for each trial, up to which the trials are those of a grid."""
BINS, QUANTILES, FEW = 8, 10, 5
"""Bins along each side of a map, and bins of a main effect.

A cell of a map with fewer than ``FEW`` trials shows their number.
"""
CHART = (COLUMN, 2.9)
"""Size of one chart, inches."""
NEARLY_ALL = 80.0
"""Lower end of the intervals, %, above which the scale of the rates does not begin at 0."""


@style(PAPER)
def success_figure(
    theta5_deg: ArrayLike,
    passed: Mapping[str, ArrayLike],
    sector_deg: float,
    real_margin_deg: float | None = None,
    title: str = "",
) -> Figure:
    """Plot which start orientations pass a fitting, beside the singular range of the formula.

    Args:
        theta5_deg: (M,) deg, orientations; those outside half a period are wrapped. A cell that
            several runs share has the colour of their success rate.
        passed: for each row of the figure (M,) bool; or 1, 0, and NaN where the row has no run at
            that orientation.
        sector_deg: deg, singular sector on the pipe's circumference.
        real_margin_deg: deg, half-width of the safe range in the real geometry.
        title: above the figure.

    Returns:
        Two panels: on the left rows over theta5 [deg] with their success rates [%], on the right
            the same as rings, repeated around the circle; the turning direction points right.
    """
    theta5 = np.asarray(theta5_deg, float)
    # Both ends of the period are kept as they are.
    inside = np.abs(theta5) <= PERIOD / 2 + 1e-9
    theta5 = np.where(inside, theta5, wrap_angle(theta5, PERIOD))
    outcomes = {name: np.asarray(values, float) for name, values in passed.items()}
    rows = {name: _orientation_cells(theta5, values) for name, values in outcomes.items()}
    rates = [float(np.nanmean(values)) for values in outcomes.values()]
    margin = (PERIOD - sector_deg) / 2

    figure = new_figure((PAGE, max(2.8, 1.6 + 0.36 * len(rows))), layout="constrained")
    line = figure.add_subplot(figure.add_gridspec(1, 2, width_ratios=(1.75, 1))[0])
    ring: Any = figure.add_subplot(1, 2, 2, projection="polar")
    ring.set_subplotspec(line.get_gridspec()[1])  # type: ignore[union-attr]
    _draw_rows(line, rows, rates)
    _draw_rings(ring, list(rows.values()), margin, real_margin_deg)
    _draw_margins(line, margin, real_margin_deg)
    _orientation_legend(figure, rows, margin, real_margin_deg)
    line.set_title(title, loc="left", size=8, color=INK)  # the legend is above the figure
    return figure


def _orientation_cells(theta5: Array, passed: Array) -> tuple[Array, Array]:
    """Return edges (K + 1,) deg and success rates (K,) of the different orientations.

    Edges may lie beyond half a period.
    """
    if theta5.shape != passed.shape or theta5.ndim != 1 or not len(theta5):
        raise ValueError(
            f"orientations {theta5.shape} and outcomes {passed.shape} are not two rows of one "
            "length"
        )
    known = np.isfinite(passed)
    centres, cell = np.unique(np.round(theta5[known], 6), return_inverse=True)
    rate = np.bincount(cell, passed[known]) / np.bincount(cell)
    if len(centres) == 1:
        return centres[0] + np.array([-0.01, 0.01]) * PERIOD, rate
    gaps = np.diff(centres, append=centres[0] + PERIOD)  # the last gap closes the circle
    first = centres[0] - min(gaps[0], gaps[-1]) / 2
    last = centres[-1] + min(gaps[-2], gaps[-1]) / 2
    return np.array([first, *(centres[1:] + centres[:-1]) / 2, last]), rate


def _success_colours() -> Any:
    """Colour map from failed to passed."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("success", [FAILED_COLOUR, PASSED_COLOUR])


def _draw_row(axis: Axes, edges: Array, middle: float, rate: Array) -> None:
    look = {"cmap": _success_colours(), "vmin": 0, "vmax": 1, "zorder": 2}
    axis.pcolormesh(edges, [middle - 0.32, middle + 0.32], rate[None], **look)


def _draw_rows(axis: Axes, rows: Mapping[str, tuple[Array, Array]], rates: Sequence[float]) -> None:
    """Draw a row of cells for each key, the first on top, with its success rate at the right."""
    beside: dict[str, Any] = {"transform": axis.get_yaxis_transform(), "va": "center", "color": INK}
    for k, ((edges, rate), mean) in enumerate(zip(rows.values(), rates, strict=True)):
        for shift in (-PERIOD, 0.0, PERIOD):
            _draw_row(axis, edges + shift, k, rate)
        axis.text(1.015, k, f"{100 * mean:.1f} %", weight="bold", **beside)
    axis.text(1.015, -0.78, "passed", size=7, **beside)
    axis.set_yticks(range(len(rows)), list(rows))
    axis.set_ylim(len(rows) - 0.45, -0.95)
    axis.set_xlim(-PERIOD / 2, PERIOD / 2)
    axis.set_xticks(np.linspace(-PERIOD / 2, PERIOD / 2, 9))
    axis.tick_params(**TICKS)
    axis.tick_params(axis="y", length=0)
    axis.grid(False)
    axis.set_xlabel("theta5 at the start [deg]")


def _draw_margins(axis: Axes, margin: float, real_margin: float | None) -> None:
    """Draw the singular range behind the rows, and the borders of both geometries before them."""
    half = PERIOD / 2
    bands = [(-half, -margin), (margin, half)] if margin > 0 else [(-half, half)]
    for low, high in bands if margin < half else ():
        text = "singular by the formula"
        axis.axvspan(low, high, color=SINGULAR_COLOUR, lw=0, zorder=0, label=text)
    for side in (-margin, margin) if 0 < margin < half else ():
        axis.axvline(side, color=INK, lw=0.9, zorder=3)
    for side in () if real_margin is None else (-real_margin, real_margin):
        axis.axvline(side, zorder=3, label="real geometry", **_REAL)


def _draw_rings(
    axis: PolarAxes,
    rows: Sequence[tuple[Array, Array]],
    margin: float,
    real_margin: float | None,
) -> None:
    """Draw the rows as rings, the first outermost, repeated every ``PERIOD``."""
    inside = 0.8 + 0.35 * len(rows)
    outside = inside + len(rows) + 0.2
    singular = min(PERIOD, PERIOD - 2 * margin)
    for turn in np.radians(np.arange(0, 360, PERIOD)):
        if singular > 0:
            middle, width = turn + np.radians(PERIOD / 2), np.radians(singular)
            axis.bar(middle, outside - inside, width, inside, color=SINGULAR_COLOUR, lw=0, zorder=0)
        for k, (edges, rate) in enumerate(rows):
            _draw_row(axis, turn + np.radians(edges), outside - 0.6 - k, rate)
        for side in () if real_margin is None else (-real_margin, real_margin):
            axis.plot([turn + np.radians(side)] * 2, [inside, outside], **_REAL)
    axis.set_ylim(0, outside)
    axis.set_yticks([])
    axis.grid(False)
    axis.set_xticks(np.radians(np.arange(0, 360, 30)))
    axis.tick_params(**TICKS)
    axis.set_xlabel("theta5 [deg], outer ring: top row")


def _orientation_legend(
    figure: Figure,
    rows: Mapping[str, tuple[Array, Array]],
    margin: float,
    real_margin: float | None,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Patch(fc=PASSED_COLOUR, label="passed")]
    if any(((rate > 0) & (rate < 1)).any() for _, rate in rows.values()):
        handles.append(Patch(fc=_success_colours()(0.5), label="some passed"))
    handles.append(Patch(fc=FAILED_COLOUR, label="failed"))
    if margin < PERIOD / 2:
        beyond = f", beyond ±{margin:.2f}°" if margin > 0 else ""
        text = f"singular by the formula{beyond}"
        handles.append(Patch(fc=SINGULAR_COLOUR, ec=INK, lw=0.5, label=text))
    if real_margin is not None:
        handles.append(Line2D([], [], label=f"real geometry, ±{real_margin:.2f}°", **_REAL))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), borderaxespad=0.4)


@dataclass(frozen=True, eq=False)
class Spread:
    """The values of one axis of a sweep over n trials.

    Attributes:
        name: of the axis.
        unit: of its numbers.
        values: (n,) numbers, or n words.
        order: the different words; empty for numbers.
        compared: its words are what is compared, on the same trials, such as controllers.
        words: for its name in figures; empty: the name.
    """

    name: str
    unit: str
    values: Array | Sequence[str]
    order: tuple[str, ...] = ()
    compared: bool = False
    words: str = ""

    @property
    def label(self) -> str:
        """Name in words, and unit."""
        return Display(self.words or self.name, self.unit).label()

    def split(self, passed: Array) -> dict[str, Array]:
        """Return the outcomes (n,) of the trials of each word that has any.

        Those of other trials are not numbers.
        """
        word = np.array(self.values)
        by_word = {name: np.where(word == name, passed, np.nan) for name in self.order}
        return {name: own for name, own in by_word.items() if np.isfinite(own).any()}


def groups_of(axes: Sequence[Spread]) -> Spread | None:
    """Return the axis whose words are drawn apart: the first of at most four that are compared."""
    few = (axis for axis in axes if axis.compared and 1 < len(axis.order) <= MAX_ROWS)
    return next(few, None)


def sweep_figure(
    axes: Sequence[Spread], passed: Array, singular: SingularRange | None = None, name: str = ""
) -> Figure:
    """Plot success over what was varied: ``passed`` (n,) 1, 0, or NaN where a trial has no outcome.

    The kind of figure depends on the axes. If only ``start.theta5_deg`` was varied, or it and at
    most four words, the figure is a map of the orientations, with the range ``singular``
    behind it. Two numbers give a map, for each group that is compared. Everything else gives one
    panel for each axis with its main effect, the largest first, with a curve for each group.
    """
    numbers = [axis for axis in axes if not axis.order]
    words = [axis for axis in axes if axis.order]
    groups, title = groups_of(axes), f"{name}: {_count(passed)}".removeprefix(": ")
    if np.isfinite(passed).any():
        if [axis.name for axis in numbers] == [THETA5] and (
            not words or (len(words) == 1 and len(words[0].order) <= MAX_ROWS)
        ):
            return _orientations(numbers[0], words[0] if words else None, passed, singular, title)
        if len(numbers) == 2 and words in ([], [groups]):
            return _maps(numbers, groups, passed, title)
    return _main_effects(axes, groups, passed, title)


def _count(passed: Array) -> str:
    known = np.isfinite(passed)
    return f"{int(passed[known].sum())} of {int(known.sum())} passed"


def draw_chart(
    axis: Axes, over: Sequence[Spread], passed: Array, groups: Spread | None = None
) -> None:
    """Draw success in one chart.

    It has the rates over one axis of a sweep with their Wilson 95 % intervals, a curve for each of
    ``groups``, or a map over two axes that are numbers.
    """
    axis.tick_params(**TICKS)
    if len(over) == 2:
        _draw_map(axis, over[0], over[1], passed)
        return
    effects = _grouped(over[0], groups, passed)
    _draw_effects(axis, effects, min(effect.lowest for effect in effects.values()))
    axis.set_ylabel("success rate [%]")
    if len(effects) > 1:
        axis.legend()


def _orientations(
    theta5: Spread, rows: Spread | None, passed: Array, singular: SingularRange | None, title: str
) -> Figure:
    degrees = np.asarray(theta5.values, float)
    if len(np.unique(degrees)) > MAX_ORIENTATIONS:
        degrees = np.round(degrees)
    by_row = {"all trials": passed} if rows is None else rows.split(passed)
    return success_figure(degrees, by_row, *(singular or SingularRange(0.0, None)), title)


@style(PAPER)
def _maps(over: Sequence[Spread], groups: Spread | None, passed: Array, title: str) -> Figure:
    """One map, or one for each group."""
    by_group = {"": passed} if groups is None else groups.split(passed)
    columns = 1 if groups is None else 2
    rows = math.ceil(len(by_group) / columns)
    size = (CHART[0] if columns == 1 else PAGE, rows * CHART[1])
    figure = new_figure(size, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, (word, own) in zip(panels, by_group.items(), strict=False):
        draw_chart(panel, over, own)
        if word:
            panel.set_title(f"{word}: {_count(own)}", loc="left")
    for panel in panels[len(by_group) :]:
        panel.set_axis_off()
    figure.suptitle(title, size=8, color=INK)
    return figure


def _draw_map(axis: Axes, x: Spread, y: Spread, passed: Array) -> None:
    """Draw the success rate over two numbers; of few trials that are no grid each by itself."""
    if len(passed) < MIN_BINNED and not _is_grid(x, y):
        _draw_scatter(axis, x, y, passed)
    else:
        _draw_cells(axis, x, y, passed)
    axis.set_xlabel(x.label)
    axis.set_ylabel(y.label)


def _is_grid(x: Spread, y: Spread) -> bool:
    """Return whether trials are at most points of a grid: most of its points were tried."""
    different = [len(np.unique(np.asarray(spread.values, float))) for spread in (x, y)]
    return math.prod(different) <= FULL_GRID * len(x.values)


def _draw_scatter(axis: Axes, x: Spread, y: Spread, passed: Array) -> None:
    """Draw each trial where it was, by its outcome."""
    places = np.stack([np.asarray(spread.values, float) for spread in (x, y)])
    looks = {
        "passed": (passed == 1, {"marker": "o", "color": PASSED_COLOUR, "ms": 3.6}),
        "failed": (passed == 0, {"marker": "X", "color": FAILED_COLOUR, "ms": 4.2}),
        "no outcome": (~np.isfinite(passed), {"marker": ".", "color": GREY, "ms": 3.0}),
    }
    for label, (these, look) in looks.items():
        if these.any():
            axis.plot(*places[:, these], ls="none", label=label, **look)
    place: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (1.0, -0.2)}
    axis.legend(**place, ncols=3)


def _draw_cells(axis: Axes, x: Spread, y: Spread, passed: Array) -> None:
    """Draw the success rate in the cells of a grid, or in bins."""
    (column, x_edges), (row, y_edges) = _cells(x), _cells(y)
    shape = (len(y_edges) - 1, len(x_edges) - 1)
    known = np.isfinite(passed)
    cell = np.ravel_multi_index((row[known], column[known]), shape)
    total = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)
    good = np.bincount(cell, passed[known], minlength=shape[0] * shape[1]).reshape(shape)
    rate = np.ma.masked_invalid(np.where(total > 0, 100 * good / np.maximum(total, 1), np.nan))
    axis.set_facecolor(_NO_OUTCOME)
    look = {"cmap": _success_colours(), "vmin": 0, "vmax": 100, "rasterized": True}
    # Edges tell that a cell is one value that was tried, and no range that was measured.
    look |= {"lw": 0.8 if max(shape) <= MAX_TICKS else 0.3, "edgecolor": "white"}
    mesh = axis.pcolormesh(x_edges, y_edges, rate, **look)
    values = [np.asarray(spread.values, float)[known] for spread in (x, y)]
    if total.max(initial=0) > 1:
        binned = any(len(np.unique(own)) > MAX_CELLS for own in values)
        for i, j in np.argwhere(total < FEW if binned or max(shape) > MAX_TICKS else total > 0):
            text, colour = str(total[i, j]), INK
            if not binned:
                text, colour = f"{int(good[i, j])}/{text}", "white"
            place = float(x_edges[j : j + 2].mean()), float(y_edges[i : i + 2].mean())
            axis.text(*place, text, ha="center", va="center", size=5.5, color=colour)
    else:
        axis.plot(*values, **_TRIAL)
    _tick_values(axis.xaxis, x, x_edges)
    _tick_values(axis.yaxis, y, y_edges)
    if set(rate.compressed().tolist()) <= {0.0, 100.0}:
        # Cells have all passed or all failed; a scale would tell no more.
        _name_colours(axis, bool((total == 0).any()), bool(total.max(initial=0) <= 1))
    else:
        bar = axis.get_figure(root=True).colorbar(mesh, ax=axis, pad=0.02)  # type: ignore[union-attr]
        bar.set_label("success rate [%]")
        bar.ax.tick_params(**TICKS)
        bar.outline.set_visible(False)  # type: ignore[operator]
    axis.grid(False)


def _tick_values(axis: Axis, spread: Spread, edges: Array) -> None:
    """Put the ticks of an axis where something was tried, if these are few and apart."""
    tried = np.unique(np.asarray(spread.values, float))
    nearest = np.diff(tried).min(initial=np.inf)
    if len(tried) <= MAX_TICKS and nearest >= MIN_APART * np.ptp(edges):
        axis.set_ticks(tried.tolist(), [f"{value:g}" for value in tried])


def _name_colours(axis: Axes, gaps: bool, trials: bool) -> None:
    """Name the colours of cells.

    Where there are ``gaps`` that of those is named, too, and the mark of ``trials``.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours = [(PASSED_COLOUR, "passed"), (FAILED_COLOUR, "failed")]
    colours += [(_NO_OUTCOME, "no outcome")] if gaps else []
    handles: list[Any] = [Patch(fc=colour, label=text) for colour, text in colours]
    handles += [Line2D([], [], label="a trial", **_TRIAL)] if trials else []
    axis.legend(handles=handles, loc="upper right", bbox_to_anchor=(1.0, -0.2), ncols=len(handles))


def _cells(spread: Spread) -> tuple[NDArray[np.intp], Array]:
    """Index of each trial's cell (n,), and the edges of the cells."""
    values = np.asarray(spread.values, float)
    centres, cell = np.unique(values, return_inverse=True)
    if len(centres) == 1:
        half = 0.5 * max(abs(centres[0]), 1.0)
        return cell, centres[0] + np.array([-half, half])
    if len(centres) <= MAX_CELLS:
        middle = (centres[1:] + centres[:-1]) / 2
        return cell, np.array([2 * centres[0] - middle[0], *middle, 2 * centres[-1] - middle[-1]])
    edges = np.linspace(centres[0], centres[-1], BINS + 1)
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, BINS - 1), edges


class _Effect:
    """Success over one axis of a sweep, of the k values or bins that have trials with an outcome.

    Attributes:
        axis: of the sweep.
        places: (k,) where they stand on the axis.
        rates: (k,) %.
        intervals: (k, 2) %, Wilson's of the rates.
    """

    def __init__(self, axis: Spread, passed: Array) -> None:
        places, group = self._groups(axis)
        known = np.isfinite(passed)
        good = np.bincount(group[known], passed[known], minlength=len(places))
        total = np.bincount(group[known], minlength=len(places))
        kept = total > 0
        counts = [(int(g), int(n)) for g, n in zip(good[kept], total[kept], strict=True)]
        self.axis, self.places = axis, places[kept]
        self.rates = np.array([100 * g / n for g, n in counts])
        self.intervals = 100 * np.array([wilson_interval(*count) for count in counts]).reshape(
            -1, 2
        )

    @staticmethod
    def _groups(axis: Spread) -> tuple[Array, NDArray[np.intp]]:
        """Places of the values or bins, and for each trial (n,) which of them it is in."""
        if axis.order:
            word = [axis.order.index(value) for value in axis.values]
            return np.arange(float(len(axis.order))), np.array(word, np.intp)
        values = np.asarray(axis.values, float)
        different, group = np.unique(values, return_inverse=True)
        if len(different) <= QUANTILES:
            return different, group
        edges = np.quantile(values, np.linspace(0, 1, QUANTILES + 1))
        group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, QUANTILES - 1)
        bins, group = np.unique(group, return_inverse=True)
        return np.array([values[group == k].mean() for k in range(len(bins))]), group

    @property
    def lowest(self) -> float:
        """Lower end of the scale of the rates, %.

        It is 0, or where nearly all pass little below the lowest interval, so that differences can
        be seen.
        """
        least = self.intervals.min() if len(self.intervals) else 0.0
        return 0.0 if least < NEARLY_ALL else 5 * float(np.floor(least / 5))


def _grouped(axis: Spread, groups: Spread | None, passed: Array) -> dict[str, _Effect]:
    """Return the effects of an axis, one for each group by its word.

    There is one of all trials for the groups themselves, and without groups.
    """
    split = {} if groups is None or groups is axis else groups.split(passed)
    return {word: _Effect(axis, own) for word, own in (split or {"": passed}).items()}


@style(PAPER)
def _main_effects(
    axes: Sequence[Spread], groups: Spread | None, passed: Array, title: str
) -> Figure:
    """Return a figure with the success rate of each group over each axis.

    That of the largest difference comes first.
    """
    rates = {axis.name: _Effect(axis, passed).rates for axis in axes}
    first = sorted(axes, key=lambda axis: -np.ptp(rates[axis.name]) if len(rates[axis.name]) else 0)
    effects = [_grouped(axis, groups, passed) for axis in first]
    columns = min(len(effects), 3)
    rows = -(-len(effects) // columns)
    width = COLUMN if columns == 1 else PAGE
    figure = new_figure((width, 1.9 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    lowest = min(effect.lowest for own in effects for effect in own.values())
    for panel, own in zip(panels.flat, effects, strict=False):
        panel.tick_params(**TICKS)
        _draw_effects(panel, own, lowest)
    for panel in panels.flat[len(effects) :]:
        panel.set_visible(False)
    for panel in panels[:, 0]:
        panel.set_ylabel("success rate [%]")
    figure.suptitle(f"{title}; bars: Wilson 95 % intervals", size=8, color=INK)
    curves = max(panels.flat, key=lambda panel: len(panel.get_legend_handles_labels()[0]))
    handles, words = curves.get_legend_handles_labels()
    if handles:
        figure.legend(handles, words, loc="outside lower center", ncols=len(words))
    return figure


def _draw_effects(panel: Axes, effects: Mapping[str, _Effect], lowest: float) -> None:
    """Draw the rates of groups over one axis, on a scale from ``lowest`` % to 100 %."""
    axis = next(iter(effects.values())).axis
    order = axis.order
    look: dict[str, Any] = {"marker": "o", "ms": 3, "elinewidth": 0.8, "capsize": 2.0}
    look["ls"] = "none" if order else "-"
    for number, (group, effect) in enumerate(effects.items()):
        low, high = effect.intervals.T
        errors = np.maximum(0.0, [effect.rates - low, high - effect.rates])
        own: dict[str, Any] = {"color": PASSED_COLOUR, "ecolor": GREY}
        if group:
            own = {"color": _GROUPS[number], "label": group}
        # Words stand apart by one; there the groups stand beside each other.
        aside = 0.12 * (number - (len(effects) - 1) / 2) if order else 0.0
        panel.errorbar(effect.places + aside, effect.rates, errors, **look, **own)
    if order:
        panel.set_xticks(range(len(order)), [word.replace(" ", "\n", 1) for word in order])
        panel.set_xlim(-0.5, len(order) - 0.5)
    else:
        panel.locator_params(axis="x", nbins=6)
    room = 0.04 * (100 - lowest)
    panel.set_ylim(lowest - room, 100 + room)
    panel.set_xlabel(axis.label)


_ACROSS = 3  # panels beside each other
_ROW, _HEAD = 0.17, 0.62  # inches: height of an entry, and of what a panel has beside them
_MARGIN = 3  # beside 0 and 100 %, so that a point there is whole
_MAX_NAME = 24


@style(PAPER)
def bench_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Plot how many trials of each course each entry of a benchmark passed.

    There is a panel for each course, with a row for each entry. ``rows`` are those of its table.
    """
    courses = list(dict.fromkeys(row["course"] for row in rows))
    entries = list(dict.fromkeys(row["entry"] for row in rows))
    figure, panels, across = _panels(len(courses), len(entries), sharex=True)
    for panel, course in zip(panels, courses, strict=True):
        _draw_course(panel, [row for row in rows if row["course"] == course], entries)
        panel.set_title(course.replace("_", " "), loc="left")
    for panel in panels[max(len(courses) - across, 0) :]:
        panel.set_xlabel("passed [%]")
        panel.tick_params(labelbottom=True)
    return figure


def _draw_course(panel: Axes, rows: Sequence[Mapping[str, Any]], entries: Sequence[str]) -> None:
    for row in rows:
        place = entries.index(row["entry"])
        colour = INK if place else CURVE_COLOURS[0]
        if row["success"] is None:
            panel.text(0, place, row["others"], color=GREY, size=6, va="center")
            continue
        ends = [100 * row[f"success_{end}"] for end in ("low", "high")]
        panel.plot(ends, (place, place), color=colour, linewidth=1.4, solid_capstyle="butt")
        rate = 100 * row["passed"] / row["trials"]
        panel.plot(rate, place, "o", color=colour, markersize=3.6, clip_on=False)
        if not place:  # the default, with which the others are compared
            panel.axvline(rate, color=colour, linewidth=0.6, linestyle=":")
    panel.set_xlim(-_MARGIN, 100 + _MARGIN)
    panel.set_ylim(len(entries) - 0.5, -0.5)
    panel.set_yticks(range(len(entries)), [clipped(name, _MAX_NAME) for name in entries])
    panel.tick_params(**TICKS)
    panel.grid(axis="y", visible=False)
    panel.spines["left"].set_color(GREY)


@style(PAPER)
def ladder_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Plot how many trials each entry of a benchmark passed at each size of each ladder.

    There is a panel for each ladder, with a row for each entry and a cell for each size: its colour
    is the rate, the number in it how many trials passed. ``rows`` are those of its table.
    """
    own = [row for row in rows if row.get("ladder")]
    ladders, entries = ([*dict.fromkeys(row[key] for row in own)] for key in ("ladder", "entry"))
    figure, panels, _ = _panels(len(ladders), len(entries))
    for panel, ladder in zip(panels, ladders, strict=True):
        _draw_ladder(panel, [row for row in own if row["ladder"] == ladder], entries)
        panel.set_title(f"{ladder.replace('_', ' ')}, size in bores", loc="left")
    return figure


def _panels(count: int, rows: int, sharex: bool = False) -> tuple[Figure, Sequence[Axes], int]:
    """Return a figure, its ``count`` panels of so many rows, and how many lie beside each other."""
    across, down = min(count, _ACROSS), math.ceil(count / _ACROSS)
    figure = new_figure((PAGE, down * (_HEAD + _ROW * rows)), layout="constrained")
    panels = figure.subplots(down, across, sharex=sharex, sharey=True, squeeze=False).ravel()
    for panel in panels[count:]:
        panel.set_axis_off()
    return figure, panels[:count].tolist(), across


def _draw_ladder(panel: Axes, rows: Sequence[Mapping[str, Any]], entries: Sequence[str]) -> None:
    sizes = list(dict.fromkeys(row["size"] for row in rows))
    cells = np.full((len(entries), len(sizes)), np.nan)
    for row in rows:
        place = entries.index(row["entry"]), sizes.index(row["size"])
        text, colour = "-", GREY
        if row["trials"]:
            cells[place] = 100 * row["passed"] / row["trials"]
            text, colour = str(row["passed"]), "white"
        panel.text(place[1], place[0], text, ha="center", va="center", size=5.5, color=colour)
    edges = np.arange(len(sizes) + 1) - 0.5, np.arange(len(entries) + 1) - 0.5
    look: dict[str, Any] = {"cmap": _success_colours(), "vmin": 0, "vmax": 100, "rasterized": True}
    panel.pcolormesh(*edges, np.ma.masked_invalid(cells), lw=0.8, edgecolor="white", **look)
    panel.set_facecolor(_NO_OUTCOME)
    panel.set_xticks(range(len(sizes)), [f"{size:g}" for size in sizes])
    panel.set_yticks(range(len(entries)), [clipped(name, _MAX_NAME) for name in entries])
    panel.set_ylim(len(entries) - 0.5, -0.5)
    panel.tick_params(**TICKS)
    panel.grid(visible=False)
