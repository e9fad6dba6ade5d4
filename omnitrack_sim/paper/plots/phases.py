"""What the figures of one run share: names and lines of the modules, shades of the phases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES
from omnitrack_sim.show.plots.style import GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from omnitrack_sim.record.trajectory import Trajectory

PHASE_COLOURS = {
    "align": "#fbe9a6",
    "tee_turn": "#d3ebcb",
    "elbow": "#dbe6f3",
    "tee_straight": "#eadfeb",
}
"""Background of the phases; a phase that is not here stays white."""
PHASE_NAMES = {
    "align": "holonomic motion",
    "tee_turn": "turn",
    "elbow": "elbow",
    "tee_straight": "tee, straight on",
}
"""Names of the shaded phases in legends."""
LINES: tuple[dict[str, Any], ...] = ({"lw": 1.2}, {"lw": 2.8, "alpha": 0.5}, {"lw": 1.2})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""


def inner_module(trajectory: Trajectory) -> int | None:
    """Index of the module that points into the first tee turn as it begins; None without one."""
    start = next((a for name, a, _ in phase_spans(trajectory) if name == "tee_turn"), None)
    if start is None:
        return None
    return int(np.argmin(np.abs(wrap_angle(trajectory["theta5"][start] + np.array(MODULE_ANGLES)))))


def module_names(trajectory: Trajectory) -> list[str]:
    inner = inner_module(trajectory)
    names = [f"module {i + 1}" for i in range(MODULES)]
    return (
        names
        if inner is None
        else [f"{name}, {'inner' if i == inner else 'outer'}" for i, name in enumerate(names)]
    )


def phase_spans(trajectory: Trajectory) -> Iterator[tuple[str, int, int]]:
    """The phases in order: name, first sample, sample of the end."""
    codes = trajectory["phase"]
    for first, end in spans(codes):
        yield trajectory.phases[int(codes[first])], first, end


def shade(
    axis: Axes, trajectory: Trajectory, x: NDArray, phases: Sequence[str] = tuple(PHASE_COLOURS)
) -> None:
    """Shade the named phases over ``x`` (T,).

    A phase in which the robot stands still becomes a narrow strip, so that it is seen.
    """
    narrowest = 0.004 * float(np.ptp(x))
    for name, a, b in phase_spans(trajectory):
        if name in phases:
            low, high = float(x[a : b + 1].min()), float(x[a : b + 1].max())
            grow = max(0.0, narrowest - (high - low)) / 2
            axis.axvspan(
                low - grow,
                high + grow,
                color=PHASE_COLOURS[name],
                lw=0,
                zorder=0,
                label=PHASE_NAMES[name],
            )


def phase_patches(trajectory: Trajectory) -> list[Any]:
    from matplotlib.patches import Patch

    present = {name for name, _, _ in phase_spans(trajectory)}
    shown = [name for name in PHASE_COLOURS if name in present]
    return [
        Patch(fc=PHASE_COLOURS[name], ec=GREY, lw=0.4, label=PHASE_NAMES[name]) for name in shown
    ]
