"""HTML and SVG of a run for notebooks: tables with every name escaped, and a small picture.

The picture is written by hand, so that showing a result does not wait for matplotlib to load.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.text import clipped, printable
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.record.trajectory import Trajectory, spans

LONGEST = 200
"""Characters of a name, value or event."""
_INK, _GREY, _SHADES = "#22262b", "#7a7f87", ("#ffffff", "#e3e7ed", "#f2ede3")
_LEFT, _WIDTH, _HEIGHT, _BETWEEN = 112, 380, 44, 12  # pixels
_MAX_POINTS = 380
"""Points of a line: one a pixel; of more samples the least and the largest of each pixel."""
_ROWS = ("distance", "tilt", "normal_force", "wall_force")
"""Channels; those that the robot has."""


def sketch(trajectory: Trajectory) -> str:
    """Distance, tilt and normal forces over time as an SVG element, phases behind them."""
    known = [name for name in _ROWS if name in trajectory.channels]
    height = len(known) * (_HEIGHT + _BETWEEN) + 20
    rows = [
        _row(trajectory, name, top=_BETWEEN // 2 + i * (_HEIGHT + _BETWEEN))
        for i, name in enumerate(known)
    ]
    end = float(trajectory.time[-1])
    axis = text(_LEFT, height - 8, "0 s") + text(_LEFT + _WIDTH, height - 8, f"{end:.2f} s", "end")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_LEFT + _WIDTH + 12}" height="{height}" '
        f'font-family="sans-serif" font-size="10">{"".join(rows)}{axis}</svg>'
    )


def _row(trajectory: Trajectory, channel: str, top: int) -> str:
    """One channel: phases behind it, its range at the left, and its lines."""
    display = trajectory.schema[channel].display
    values = display.scale * np.asarray(trajectory[channel], float).reshape(
        len(trajectory.time), -1
    )
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    time = trajectory.time - trajectory.time[0]
    x = _LEFT + _WIDTH * (time / max(float(time[-1]), 1e-9))
    # SVG counts y downward; a constant channel has no range to divide by.
    y = top + _HEIGHT * (1.0 - (values - low) / max(high - low, 1e-9))
    modules = ["#" + bytes(round(255 * part) for part in rgb).hex() for rgb in MODULE_COLOURS]
    colours = cycle(modules if values.shape[1] > 1 else (_INK,))
    lines = [line(x, column, colour) for column, colour in zip(y.T, colours, strict=False)]
    name = f"{channel.replace('_', ' ')}, {display.unit}"
    texts = [
        text(2, top + _HEIGHT / 2 + 3, name, "start"),
        text(_LEFT - 4, top + 8, f"{high:.3g}", "end"),
        text(_LEFT - 4, top + _HEIGHT, f"{low:.3g}", "end"),
    ]
    return "".join([_phases(trajectory, x, top), *texts, *lines])


def _phases(trajectory: Trajectory, x: NDArray, top: int) -> str:
    return "".join(
        f'<rect x="{x[first]:.1f}" y="{top}" width="{x[last] - x[first]:.1f}" height="{_HEIGHT}" '
        f'fill="{_SHADES[int(trajectory["phase"][first]) % len(_SHADES)]}"/>'
        for first, last in spans(trajectory["phase"])
    )


def line(x: NDArray, y: NDArray, colour: str) -> str:
    """Return a line through the finite ones of some points as an element of SVG."""
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(*_thinned(x, y), strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.2"/>'


def _thinned(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Finite points of a line; of many, the least and largest in each pixel."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) <= 2 * _MAX_POINTS:
        return x, y
    # Both extremes of each pixel keep every peak in sight, which leaving out samples would not.
    starts = np.flatnonzero(np.diff(np.floor(x), prepend=-1.0))
    ends = np.stack([np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)], axis=1)
    return np.repeat(x[starts], 2), ends.ravel()


def text(x: float, y: float, words: str, anchor: str = "start") -> str:
    """Return a text, which is escaped already, as an element of SVG."""
    return f'<text x="{x:g}" y="{y:g}" fill="{_GREY}" text-anchor="{anchor}">{words}</text>'


def table_html(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of texts."""
    body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{_cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f"<{tag} style='text-align:left'>{safe(text)}</{tag}>" for text in texts)


def safe(text: str) -> str:
    """Return a text cut to ``LONGEST`` characters, escaped for HTML."""
    return escape(clipped(printable(text), LONGEST))
