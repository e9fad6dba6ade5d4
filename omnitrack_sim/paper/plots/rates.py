"""Success rates of several groups of runs as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.show.plots.style import ALARM, INK, styled
from omnitrack_sim.show.plots.success import PASSED_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_DASHES: Any = (0, (4, 2))


def rates_figure(
    groups: Sequence[tuple[str, int, int]],
    reference: float | None = None,
    label: str = "success rate",
) -> Figure:
    """Rates of several groups of runs with their 95 % intervals (``statistics.wilson_interval``).

    Args:
        groups: (name, passed, total) of each bar, from the top.
        reference: a rate from 0 to 1, drawn as a dashed line.
        label: what the rate is; the axis shows it in %.
    """
    from omnitrack_sim.show.plots.picture import Picture

    def draw() -> Figure:
        figure = Picture(figsize=(6.4, 1.2 + 0.42 * max(1, len(groups))), layout="constrained")
        axis = figure.subplots()
        _bars(axis, groups)
        if reference is not None:
            _reference(axis, 100 * reference)
        axis.set_xlabel(f"{label} [%], with 95 % interval")
        return figure

    return styled(draw)


def _bars(axis: Axes, groups: Sequence[tuple[str, int, int]]) -> None:
    """One bar for each group, with its interval as a whisker and its counts at the right."""
    for k, (_, passed, total) in enumerate(groups):
        rate = passed / total if total else 0.0
        low, high = wilson_interval(passed, total)
        axis.barh(k, 100 * rate, height=0.56, color=PASSED_COLOUR, alpha=0.55, lw=0)
        if total:
            axis.plot(
                [100 * low, 100 * high],
                [k, k],
                color=INK,
                lw=1.1,
                marker="|",
                ms=7,
                mew=1.1,
                clip_on=False,
            )
        text = f"{100 * rate:.1f} %  ({passed} of {total})" if total else "none tried"
        axis.text(1.03, k, text, transform=axis.get_yaxis_transform(), va="center", color=INK)
    axis.set_yticks(range(len(groups)), [name for name, _, _ in groups])
    axis.set_ylim(max(len(groups), 1) - 0.4, -0.6)
    axis.set_xlim(0, 100)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")


def _reference(axis: Axes, percent: float) -> None:
    axis.axvline(percent, color=ALARM, lw=1.1, ls=_DASHES, label="reference")
    text = f"reference {percent:.2f} %"
    axis.text(
        percent, 1.02, text, transform=axis.get_xaxis_transform(), ha="center", color=ALARM, size=8
    )
