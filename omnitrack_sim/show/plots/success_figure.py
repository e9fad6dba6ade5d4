"""Which start orientations pass a fitting, as rows and as rings.

In the rings the turning direction points right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.show.plots.style import INK, PAGE, PAPER, TICKS, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes


PASSED_COLOUR, FAILED_COLOUR, SINGULAR_COLOUR = "#2f6db3", "#e8882e", "#f6e3a3"
_DASHES: Any = (0, (4, 2))


def success_figure(
    theta5_deg: ArrayLike,
    passed: Mapping[str, ArrayLike],
    sector_deg: float,
    period_deg: float = 120,
    real_margin_deg: float | None = None,
) -> Figure:
    """Which start orientations pass a fitting, beside the singular range of the formula.

    Args:
        theta5_deg: (M,) deg, orientations; those outside half a period are wrapped. A cell that
            several runs share has the colour of their success rate.
        passed: for each row of the figure (M,) bool; or 1, 0, and NaN where the row has no run at
            that orientation.
        sector_deg: deg, singular sector on the pipe's circumference.
        period_deg: deg, after which orientations repeat.
        real_margin_deg: deg, half-width of the safe range in the real geometry.

    Returns:
        Two panels: on the left rows over theta5 [deg] with their success rates [%], on the right
            the same as rings, repeated around the circle.
    """
    theta5 = _wrapped(np.asarray(theta5_deg, float), period_deg)
    rows = {
        name: _cells(theta5, np.asarray(values, float), period_deg)
        for name, values in passed.items()
    }
    rates = [float(np.nanmean(np.asarray(values, float))) for values in passed.values()]
    margin = (period_deg - sector_deg) / 2

    def draw() -> Figure:
        figure = new_figure((PAGE, max(2.8, 1.6 + 0.36 * len(rows))), layout="constrained")
        line = figure.add_subplot(figure.add_gridspec(1, 2, width_ratios=(1.75, 1))[0])
        ring: Any = figure.add_subplot(1, 2, 2, projection="polar")
        ring.set_subplotspec(line.get_gridspec()[1])  # type: ignore[union-attr]
        _success_rows(line, rows, rates, period_deg)
        _success_rings(ring, list(rows.values()), margin, period_deg, real_margin_deg)
        _margins(line, margin, period_deg / 2, real_margin_deg)
        _success_legend(figure, rows, margin, period_deg / 2, real_margin_deg)
        return figure

    return styled(draw, PAPER)


def _wrapped(theta5: NDArray, period: float) -> NDArray:
    """Orientations (M,) within half a period of zero; both ends are kept as they are."""
    inside = np.abs(theta5) <= period / 2 + 1e-9
    return np.where(inside, theta5, wrap_angle(theta5, period))


def _cells(theta5: NDArray, passed: NDArray, period: float) -> tuple[NDArray, NDArray]:
    """Edges (K + 1,) deg and success rates (K,) of the different orientations.

    The outer edges may lie beyond half a period.
    """
    if theta5.shape != passed.shape or theta5.ndim != 1 or not len(theta5):
        raise ValueError(
            f"orientations {theta5.shape} and outcomes {passed.shape} are not two rows of one "
            "length"
        )
    known = np.isfinite(passed)
    theta5, passed = theta5[known], passed[known]
    centres, cell = np.unique(np.round(theta5, 6), return_inverse=True)
    rate = np.bincount(cell, passed) / np.bincount(cell)
    if len(centres) == 1:
        return centres[0] + np.array([-0.01, 0.01]) * period, rate
    gaps = np.diff(centres, append=centres[0] + period)  # the last gap closes the circle
    first = centres[0] - min(gaps[0], gaps[-1]) / 2
    last = centres[-1] + min(gaps[-2], gaps[-1]) / 2
    return np.array([first, *(centres[1:] + centres[:-1]) / 2, last]), rate


def success_colours() -> Any:
    """Colour map from failed to passed."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("success", [FAILED_COLOUR, PASSED_COLOUR])


def _mesh(axis: Axes, edges: NDArray, middle: float, rate: NDArray) -> None:
    axis.pcolormesh(
        edges,
        [middle - 0.32, middle + 0.32],
        rate[None],
        cmap=success_colours(),
        vmin=0,
        vmax=1,
        zorder=2,
    )


def _success_rows(
    axis: Axes, rows: Mapping[str, tuple[NDArray, NDArray]], rates: Sequence[float], period: float
) -> None:
    """One row of cells for each key, the first on top, with its success rate at the right."""
    for k, ((edges, rate), mean) in enumerate(zip(rows.values(), rates, strict=True)):
        for shift in (-period, 0.0, period):
            _mesh(axis, edges + shift, k, rate)
        axis.text(
            1.015,
            k,
            f"{100 * mean:.1f} %",
            transform=axis.get_yaxis_transform(),
            va="center",
            color=INK,
            weight="bold",
        )
    axis.text(
        1.015, -0.78, "passed", transform=axis.get_yaxis_transform(), va="center", color=INK, size=7
    )
    axis.set_yticks(range(len(rows)), list(rows))
    axis.set_ylim(len(rows) - 0.45, -0.95)
    axis.set_xlim(-period / 2, period / 2)
    axis.set_xticks(np.linspace(-period / 2, period / 2, 9))
    axis.tick_params(**TICKS)
    axis.tick_params(axis="y", length=0)
    axis.grid(False)
    axis.set_xlabel("theta5 at the start [deg]")


def _singular_bands(margin: float, half: float) -> list[tuple[float, float]]:
    """Ranges of theta5, deg, that the formula calls singular: ``margin`` to ``half``, both
    sides."""
    if margin >= half:
        return []
    return [(-half, -margin), (margin, half)] if margin > 0 else [(-half, half)]


def _margins(axis: Axes, margin: float, half: float, real_margin: float | None) -> None:
    """Draw the singular range behind the rows, and the borders of both geometries before them."""
    for low, high in _singular_bands(margin, half):
        axis.axvspan(
            low, high, color=SINGULAR_COLOUR, lw=0, zorder=0, label="singular by the formula"
        )
    if 0 < margin < half:
        for side in (-margin, margin):
            axis.axvline(side, color=INK, lw=0.9, zorder=3)
    if real_margin is not None:
        for side in (-real_margin, real_margin):
            axis.axvline(side, color=INK, lw=1.1, ls=_DASHES, zorder=3, label="real geometry")


def _success_rings(
    axis: PolarAxes,
    rows: Sequence[tuple[NDArray, NDArray]],
    margin: float,
    period: float,
    real_margin: float | None,
) -> None:
    """The rows as rings, the first outermost, repeated every ``period`` deg."""
    inside = 0.8 + 0.35 * len(rows)
    outside = inside + len(rows) + 0.2
    singular = min(period, period - 2 * margin)
    for turn in np.radians(period) * np.arange(round(360 / period)):
        if singular > 0:
            middle, width = turn + np.radians(period / 2), np.radians(singular)
            axis.bar(middle, outside - inside, width, inside, color=SINGULAR_COLOUR, lw=0, zorder=0)
        for k, (edges, rate) in enumerate(rows):
            _mesh(axis, turn + np.radians(edges), outside - 0.6 - k, rate)
        for side in () if real_margin is None else (-real_margin, real_margin):
            axis.plot(
                [turn + np.radians(side)] * 2, [inside, outside], color=INK, lw=1.1, ls=_DASHES
            )
    axis.set_ylim(0, outside)
    axis.set_yticks([])
    axis.grid(False)
    axis.set_xticks(np.radians(np.arange(0, 360, 30)))
    axis.tick_params(**TICKS)
    axis.set_xlabel("theta5 [deg], outer ring: top row")


def _success_legend(
    figure: Figure,
    rows: Mapping[str, tuple[NDArray, NDArray]],
    margin: float,
    half: float,
    real_margin: float | None,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(fc=PASSED_COLOUR, label="passed"),
        Patch(fc=FAILED_COLOUR, label="failed"),
    ]
    if any(((rate > 0) & (rate < 1)).any() for _, rate in rows.values()):
        handles.insert(1, Patch(fc=success_colours()(0.5), label="some passed"))
    if margin < half:
        beyond = f", beyond ±{margin:.2f}°" if margin > 0 else ""
        handles.append(
            Patch(fc=SINGULAR_COLOUR, ec=INK, lw=0.5, label=f"singular by the formula{beyond}")
        )
    if real_margin is not None:
        handles.append(
            Line2D(
                [], [], color=INK, lw=1.1, ls=_DASHES, label=f"real geometry, ±{real_margin:.2f}°"
            )
        )
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), borderaxespad=0.4)
