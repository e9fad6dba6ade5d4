"""Figures of runs over time: the summary of one, two compared, one channel, a recording."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.base.text import clipped
from omnitrack_sim.record.channels import Channel, Display, Vector
from omnitrack_sim.record.display import MODULE_COLOURS, Colour
from omnitrack_sim.record.metrics import MAX_KNOWN_STD
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.comparison import Comparison, compare, value_text
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.show.legend import MAX_NAMED, Legend, merged
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.plots.network_figure import draw_pipes, extent, frame_view
from omnitrack_sim.show.plots.style import (
    COLUMN,
    CURVE_COLOURS,
    GREY,
    INK,
    PAGE,
    TICKS,
    chart,
    headline,
    new_figure,
    page,
)
from omnitrack_sim.show.projection import aligned, bore_faces
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.sources import Source, playback_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

LINES: tuple[dict[str, Any], ...] = ({"lw": 0.9}, {"lw": 1.9, "alpha": 0.5}, {"lw": 0.9})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""
_DASHES = ("-", (0, (4, 1.2)), (0, (1, 1)))
"""Lines of parts whose colours are neighbours in a ramp."""
COMMAND: dict[str, Any] = {"lw": 2.0, "color": "#a6acb6", "zorder": 1.8}
"""The command of one module, or of all alike: broad and pale below the measured value, so that both
are seen where they coincide."""
_COMMANDS: dict[str, Any] = {"lw": 0.7, "ls": (0, (3, 2))}  # of each module, in one panel with all
PHASE_SHADES = ("#ffffff", "#e3e6ec", "#f3ead9", "#dcebe4")
PHASE_SHADES += ("#eadfeb", "#e8e8d6", "#dde8f2", "#f2dfdc")
"""Background of the phases, in the order of the trajectory's phase names."""
BAND, BAND_COLOUR = 2.0, "#b9cbe4"
"""Half of the width of an estimate's band, in standard deviations, and its colour."""
ERRORS = {
    "distance": Display("Error of the distance", "mm", 1e3, span=4.0),
    "theta5": Display("Error of theta5", "deg", 180.0 / np.pi, span=2.0),
    "tilt": Display("Error of the tilt", "deg", 180.0 / np.pi, span=2.0),
}
"""Display of the errors of estimates, by the channel that is estimated."""
_ERRORS_SHOWN = 95.0
"""Part of the times, in percent, at which the band of an estimate is seen whole, of those at which
the robot claims to know its orientation: before, its band is as wide as a circle."""
LEFT, RIGHT = 0.42, 0.08
"""Margins of a page of panels, inches."""
_TITLE, _HEAD, _BELOW = 0.28, 0.48, 0.36
"""Inches: height of the title, of all above the panels but for the legends, and of the times below.
"""
_ABOVE = _HEAD + 2 * 0.15  # inches above the panels with two lines of legends
_BESIDE, _BETWEEN, _HEIGHT = 0.44, 0.27, 0.82  # inches between columns, between rows; of a panel
_MAX_LEGEND = 105
"""Characters of a legend that fit into one line of a page."""
_LEGEND, _LETTER, _LEGEND_GAP = 0.15, 0.053, 0.1
"""Inches: height of one line of a legend, width of a letter before it, and the gap behind that."""
MAX_NAME = 60
"""Characters of a name in a legend."""
_MIN_SPAN = 1e-4
"""Least span of an axis over its largest value: below it are rounding errors, and ticks that differ
in their sixth digit."""


def display_values(trajectory: Trajectory, channel: str) -> NDArray[np.float64]:
    """Values of a channel as they are displayed: (T,), or (T, n) with a line each."""
    display = trajectory.schema[channel].display
    values = np.asarray(trajectory[channel], float) * display.scale
    if display.summed:
        return values.sum(axis=-1)
    return values.reshape(len(values), -1) if values.ndim > 2 else values


def has_modules(channel: Channel) -> bool:
    """True where a panel has one line a module: there are as many as colours of modules."""
    if channel.names or isinstance(channel, Vector):
        return False
    return channel.display.summed or channel.shape == (len(MODULE_COLOURS),)


def draw_panel(axis: Axes, playback: RunPlayback, name: str, module: int | None = None) -> None:
    """Draw lines of a channel over time: one a module in its colour, or those of one ``module``.

    ``module`` is 1 to 3. The command is drawn where there is one. Phases are not; see ``shade``.
    """
    trajectory = playback.run.trajectory
    time, values = trajectory.time, display_values(trajectory, name)
    display = trajectory.schema[name].display
    command = display_values(trajectory, display.command) if display.command else None
    if module is not None:
        values = values[:, module - 1]
        command = None if command is None else command[:, module - 1]
        axis.plot(time, values, color=MODULE_COLOURS[module - 1], label=f"module {module}")
        if command is not None:
            axis.plot(time, command, label="command", **COMMAND)
    elif values.ndim == 1:
        axis.plot(time, values, color=INK)
    else:
        _draw_columns(axis, playback, values, trajectory.schema[name])
        if command is not None:
            _draw_commands(axis, time, command)
    limits = limits_of(display, values if command is None else np.stack([values, command]))
    if limits is not None:
        axis.set_ylim(*limits)


def _draw_columns(axis: Axes, playback: RunPlayback, values: NDArray, channel: Channel) -> None:
    """One line a column: a module, a component of a vector, or what the channel has names for."""
    time = playback.time
    if not has_modules(channel):
        styles = line_styles(playback.legends.values())
        for column, label, colour in playback.lines_of(channel):
            style = styles.get(colour, "-") if colour else "-"
            axis.plot(time, values[:, column], label=label, color=colour, ls=style)
        return
    for i, column in enumerate(values.T):
        look: dict[str, Any] = {"color": MODULE_COLOURS[i], "label": f"module {i + 1}"} | LINES[i]
        axis.plot(time, column, **look)


def _draw_commands(axis: Axes, time: NDArray, commands: NDArray) -> None:
    """The commands of all modules in one panel: one line where they are the same."""
    if (commands == commands[:, :1]).all():
        axis.plot(time, commands[:, 0], label="command", **COMMAND)
        return
    for i, column in enumerate(commands.T):
        dark = tuple(0.6 * part for part in MODULE_COLOURS[i])
        axis.plot(time, column, color=dark, label=f"command {i + 1}", **_COMMANDS)


def limits_of(display: Display, values: NDArray) -> tuple[float, float] | None:
    """Limits of an axis that shows values; None where no value is finite."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = float(known.min()), float(known.max())
    room = 0.06 * (high - low)
    low = low - room if display.low is None else min(display.low, low)
    high = high + room if display.high is None else max(display.high, high)
    span = max(display.span, _MIN_SPAN * max(abs(low), abs(high)))
    short = max(0.0, span - (high - low))
    if display.low is None:
        low, high = low - short / 2, high + short / 2
    else:
        high += short
    return (low, high) if high > low else None


def legend_columns(names: Sequence[str], width: int) -> int:
    """Most columns of a legend with these names, filled one after the other, that fit.

    ``width`` is in characters; one column where none fits.
    """
    lengths = np.array([len(name) + 5 for name in names])
    for columns in range(len(names), 1, -1):
        if sum(own.max() for own in np.array_split(lengths, columns)) <= width:
            return columns
    return 1


def draw_error(axis: Axes, trajectory: Trajectory, name: str) -> None:
    """Draw the error of a channel's estimate, above the band of its standard deviations.

    The band reaches ``BAND`` of them to either side.
    """
    display = ERRORS[name]
    error = trajectory[f"{name}_estimate"] - trajectory[name]
    if display.unit == "deg":
        error = wrap_angle(error)
    error = display.scale * error
    band = BAND * display.scale * trajectory[f"{name}_std"]
    axis.fill_between(trajectory.time, -band, band, color=BAND_COLOUR, lw=0, zorder=1.5)
    axis.axhline(0.0, color="white", lw=0.6, zorder=1.6)
    axis.plot(trajectory.time, error, color=INK)
    # Before the robot knows its orientation the band is a full circle wide: it would set the scale.
    sure = trajectory["theta5_std"] < MAX_KNOWN_STD
    shown = np.isfinite(error) & np.isfinite(band) & (sure if sure.any() else True)
    half = display.span / 2
    if shown.any():
        # The line is seen whole, however long it is far off.
        widest = float(np.percentile(band[shown], _ERRORS_SHOWN))
        half = max(half, 1.1 * max(widest, float(np.abs(error[shown]).max())))
    axis.set_ylim(-half, half)


def shade(axis: Axes, trajectory: Trajectory) -> None:
    """Shade the phases behind a panel, and let it end with the run."""
    from matplotlib.collections import PolyCollection

    time = trajectory.time
    if len(time) > 1:
        axis.set_xlim(time[0], time[-1])
    codes = {name: code for code, name in enumerate(trajectory.phases)}
    spans = [(shade_of(codes[name]), a, b) for name, a, b in trajectory.phase_spans()]
    spans = [span for span in spans if span[0] != PHASE_SHADES[0]]
    corners = [[(a, 0), (b, 0), (b, 1), (a, 1)] for _, a, b in spans]
    # One collection draws a thousand phases at once, where each axvspan is an artist of its own.
    phases = PolyCollection(
        corners,
        facecolors=[colour for colour, _, _ in spans],
        linewidths=0,
        zorder=0,
        transform=axis.get_xaxis_transform(),
    )
    axis.add_collection(phases, autolim=False)


def shade_of(code: int) -> str:
    """Background of a phase."""
    return PHASE_SHADES[code % len(PHASE_SHADES)]


class PanelGrid:
    """Figure as wide as a page with rows and columns of panels, each at a known place.

    To find a layout takes longer than to draw. ``above`` inches are left above them.
    """

    def __init__(self, rows: int, columns: int, above: float = _ABOVE) -> None:
        self.rows, self.columns = rows, columns
        self.height = above + rows * _HEIGHT + (rows - 1) * _BETWEEN + _BELOW  # inches
        self.figure = new_figure((PAGE, self.height))

    def add(self, row: int, column: int, label: str, last: bool = False) -> Axes:
        """Return an empty panel with its label level above its axis.

        That reads better than upright beside it. Those of the last row, and ``last`` ones, have the
        numbers of the times.
        """
        width = (PAGE - LEFT - RIGHT - (self.columns - 1) * _BESIDE) / self.columns
        left = LEFT + column * (width + _BESIDE)
        bottom = _BELOW + (self.rows - 1 - row) * (_HEIGHT + _BETWEEN)
        box = (left / PAGE, bottom / self.height, width / PAGE, _HEIGHT / self.height)
        axis = self.figure.add_axes(box)
        last = last or row == self.rows - 1
        axis.tick_params(**TICKS)
        axis.tick_params(axis="x", labelbottom=last)
        axis.locator_params(axis="x", nbins=5, steps=(1, 2, 5, 10))
        axis.locator_params(axis="y", nbins=4, steps=(1, 2, 5, 10))
        # A power of ten above the axis would stand in the label.
        axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}"))
        if last:
            axis.set_xlabel("time [s]")
            axis.xaxis.set_label_coords(0.5, -0.24)
        axis.set_ylabel(label, rotation=0, ha="left", va="bottom")
        axis.yaxis.set_label_coords(0.0, 1.04)
        return axis

    def legend(
        self,
        handles: list,
        down: float,
        head: str = "",
        left: float = LEFT,
        width: float = PAGE - LEFT,
    ) -> int:
        """Draw a legend, ``down`` inches below the top, with ``head`` before it; return its lines.

        It begins ``left`` inches from the left, and is at most ``width`` inches wide; ``head`` is
        above one that stands further to the right than the panels.
        """
        if not handles:
            return 0
        names = [handle.get_label() for handle in handles]
        above = bool(head) and left > LEFT
        beside = 0 if above else len(head)
        columns = legend_columns(names, _letters(width) - beside)
        left, top = left / PAGE, 1 - down / self.height
        if head:
            self.figure.text(left, top, head, size=7, color=INK, va="top")
            left += (_LETTER * beside + _LEGEND_GAP * (not above)) / PAGE
            top -= above * _LEGEND / self.height
        self.figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(left, top),
            ncols=columns,
        )
        return -(-len(names) // columns) + above


OF_ROBOT = ("distance", "tilt", "offset")
"""Channels of the robot, in the first row of a comparison."""
_RUNS: tuple[dict[str, Any], ...] = (
    {"color": "#86b7e8", "lw": 2.0},
    {"color": "#a33a0a", "lw": 0.8},
)
"""Run A broad and pale below run B, so that both are seen where they coincide."""


def plot_summary(
    source: Source,
    *,
    path: str | Path | None = None,
    format: str | None = None,
) -> Figure:
    """Plot the summary of a run or a recording: panels over time, as wide as a page (7.16 inches).

    Of a run the phases are shaded and named. Where a panel shows one module, its command is drawn
    broad and pale below the measured value. For a robot that estimates its own location a further
    row shows the errors of the estimates with their band of two standard deviations.

    Of a recording there are the way in elevation and plan, and over time way, speed and clearance
    of the body, forces on the walls, power and joints, with the fittings shaded.

    Args:
        source: the run, the folder of a saved one, or a recording of any model.
        path: file to write; none: the figure is returned and nothing is written.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format, or a recording without samples.
        OutputError: the file cannot be written, or the folder is no run.

    Example:
        >>> import omnitrack_sim as ot
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}))
        >>> len(ot.plot_summary(result).axes)
        15
    """
    playback = playback_of(source)

    def draw() -> Figure:
        return _summary(playback) if isinstance(playback, RunPlayback) else _recorded(playback)

    return page(draw, path, format)


def _summary(playback: RunPlayback) -> Figure:
    """Return the panels that the robot of a run chooses."""
    result = playback.run
    trajectory = result.trajectory
    errors = ERRORS if "distance_estimate" in trajectory.channels else {}
    summary = _filled(result.scenario.robot.display.summary, trajectory)
    legends = _summary_legends(playback, bool(errors))
    grid = PanelGrid(len(summary) + bool(errors), COLUMNS, _HEAD + _heights(legends))
    for row, panels in enumerate(summary):
        for column, (channel, module) in enumerate(panels):
            label = trajectory.schema[channel].display.label(module)
            axis = grid.add(row, column, label)
            shade(axis, trajectory)
            draw_panel(axis, playback, channel, module)
            if module is not None and (limits := _limits_of_all(trajectory, channel)) is not None:
                axis.set_ylim(*limits)
    for column, (channel, display) in enumerate(errors.items()):
        axis = grid.add(len(summary), column, display.label())
        shade(axis, trajectory)
        draw_error(axis, trajectory, channel)
    headline(grid.figure, result.scenario.name, _outcome(result), LEFT, result.success)
    for number, (head, handles) in enumerate(legends):
        grid.legend(handles, _TITLE + _heights(legends[:number]), head)
    return grid.figure


_Panels = Sequence[tuple[str, int | None]]


def _filled(summary: Sequence[_Panels], trajectory: Trajectory) -> list[_Panels]:
    """Return the panels that have data, in rows as given; in full rows where one has none."""
    with_data = [
        [(name, module) for name, module in row if trajectory[name].size] for row in summary
    ]
    if with_data == [list(row) for row in summary]:
        return list(summary)
    every = [panel for row in with_data for panel in row]
    return [every[i : i + COLUMNS] for i in range(0, len(every), COLUMNS)]


def _summary_legends(playback: RunPlayback, estimates: bool) -> list[tuple[str, list[Any]]]:
    """Legends of a summary with words before them: lines, and phases where there are several."""
    trajectory, legends = playback.run.trajectory, [("", _line_handles(playback, estimates))]
    legends += _legend_lines(playback.legends.values()).items()
    phases = _phase_handles(trajectory)
    legends += [("", phases)] if len(phases) > 1 else []
    return [(head, handles) for head, handles in legends if handles]


def _heights(legends: Sequence[tuple[str, list[Any]]]) -> float:
    """Height of legends below each other, inches."""
    return _LEGEND * sum(_rows(handles, head) for head, handles in legends)


def _rows(handles: Sequence[Any], head: str) -> int:
    """Lines of a legend with a word before it."""
    names = [handle.get_label() for handle in handles]
    return -(-len(names) // legend_columns(names, _letters(PAGE - LEFT) - len(head)))


def _letters(width: float) -> int:
    """Characters of a legend that fit into one line of ``width`` inches."""
    return round(_MAX_LEGEND * width / (PAGE - LEFT))


def _legend_lines(legends: Iterable[Legend]) -> dict[str, list[Any]]:
    """Legends of panels whose lines are of parts of the robot, by what these are."""
    from matplotlib.lines import Line2D

    legends = list(legends)
    styles = line_styles(legends)
    return {
        legend.heading: [
            Line2D([], [], color=colour, ls=styles.get(colour, "-"), label=clipped(short, MAX_NAME))
            for short, _, colour in legend.rows
        ]
        for legend in merged(legends)
    }


def line_styles(legends: Iterable[Legend]) -> dict[Colour, Any]:
    """Return dashes of lines by their colour, where these are too many to be told apart.

    Neighbours of a ramp of colours, of which each is named, get different ones.
    """
    styles: dict[Colour, Any] = {}
    for legend in legends:
        own = [colour for colour in legend.colours if colour is not None]
        if len(CURVE_COLOURS) < len(own) <= MAX_NAMED:
            styles |= {colour: _DASHES[i % len(_DASHES)] for i, colour in enumerate(own)}
    return styles


def _limits_of_all(trajectory: Trajectory, channel: str) -> tuple[float, float] | None:
    """Limits for the panels of single modules: one scale, so that they can be compared."""
    display = trajectory.schema[channel].display
    names = (channel, display.command) if display.command else (channel,)
    return limits_of(display, np.stack([display_values(trajectory, name) for name in names]))


def _outcome(result: Result) -> str:
    return f"{result.ending} after {result.duration_s:.2f} s"


def _line_handles(playback: RunPlayback, estimates: bool) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    columns = playback.columns
    lines: list[Any] = [
        Line2D([], [], color=colour, label=name, **LINES[i])
        for i, (name, colour) in enumerate(columns)
    ]
    if not columns:
        return []  # see _legend_lines
    lines.append(Line2D([], [], label="command", **COMMAND))
    if estimates:
        lines.append(Patch(fc=BAND_COLOUR, label=f"{BAND:.0f} sigma of the estimate"))
    return lines


def _phase_handles(trajectory: Trajectory) -> list[Patch]:
    from matplotlib.patches import Patch

    names = {code: trajectory.phases[code] for code in np.unique(trajectory["phase"].astype(int))}
    return [
        Patch(fc=shade_of(code), ec=GREY, lw=0.4, label=clipped(name.replace("_", " "), 24))
        for code, name in names.items()
    ]


def plot_compare(
    a: Result | str | os.PathLike[str],
    b: Result | str | os.PathLike[str],
    *,
    path: str | Path | None = None,
    labels: Sequence[str] | None = None,
    format: str | None = None,
) -> Figure:
    """Plot two runs over time, one upon the other, as wide as a page (7.16 inches).

    There are distance, tilt and offset, and of each module normal force, torque and slip ratio. A
    disc marks the end of a run at its goal, a cross that of a run that failed.

    Args:
        a: the first run, or the folder of a saved one.
        b: the second one.
        path: file to write; none: the figure is returned and nothing is written.
        labels: names of the two; none: by the differences of their scenarios.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format; there are not two labels.
        OutputError: the file cannot be written, or a folder is no run.

    Example:
        >>> import omnitrack_sim as ot
        >>> short = ot.load_scenario("straight", {"run.time_limit": 0.1})
        >>> dry, wet = ot.run_batch([short, ot.override(short, {"world.friction": 0.5})])
        >>> figure = ot.plot_compare(dry, wet, labels=("dry", "wet"))
        >>> len(figure.axes)
        12
    """
    comparison = compare(a, b)
    if labels is not None and (isinstance(labels, str) or len(labels) != 2):
        raise InputError(Fault("labels", f"are {labels!r}; give two, one for each run"))
    names = [str(label) for label in labels] if labels is not None else _labels(comparison)
    return page(lambda: _comparison(comparison, names), path, format)


def _labels(comparison: Comparison) -> list[str]:
    """Return names of two runs by what differs.

    They are the scenarios' names where these differ, else the kinds of whatever differs in its
    kind, else the first value that does.
    """
    names = [run.scenario.name for run in (comparison.a, comparison.b)]
    if names[0] != names[1] or not comparison.values:
        return names
    kinds = (v for v in comparison.values if v.name.endswith(".kind") and v.a and v.b)
    kind = next(kinds, None)
    if kind is not None:
        return [value_text(kind.a), value_text(kind.b)]
    first = comparison.values[0]
    unit = "" if first.unit in ("", "1") else f" {first.unit}"
    return [f"{first.name} = {value_text(value)}{unit}" for value in (first.a, first.b)]


def _comparison(comparison: Comparison, names: list[str]) -> Figure:
    runs = (comparison.a, comparison.b)
    # Robots of two kinds are compared by what all have.
    first, second = (run.scenario.robot for run in runs)
    compared, other = first.display.compared, second.display.compared
    rows = 1 + first.modules if compared and compared == other else 1
    grid = PanelGrid(rows=rows, columns=3)
    end = max(float(run.trajectory.time[-1]) for run in runs)
    for column, channels in enumerate(zip(OF_ROBOT, *(rows - 1) * [compared], strict=True)):
        for row, channel in enumerate(channels):
            display = comparison.a.trajectory.schema[channel].display
            axis = grid.add(row, column, display.label(row or None))
            values = [display_values(run.trajectory, channel) for run in runs]
            for run, look, drawn in zip(runs, _RUNS, values, strict=True):
                line = drawn[:, row - 1] if row else drawn
                last = [len(line) - 1]
                mark = "o" if run.success else "X"
                axis.plot(run.trajectory.time, line, marker=mark, markevery=last, ms=3.5, **look)
            if end > 0:
                axis.set_xlim(0.0, 1.02 * end)
            limits = limits_of(display, np.concatenate(values))
            if limits is not None:
                axis.set_ylim(*limits)
    scenarios = dict.fromkeys(run.scenario.name for run in runs)
    headline(grid.figure, " and ".join(scenarios), comparison.headline, LEFT)
    grid.legend(_run_handles(runs, names), 0.28)
    return grid.figure


def _run_handles(runs: tuple[Result, Result], names: list[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D(
            [],
            [],
            label=f"{side}: {clipped(name, 60)}; {_outcome(run)}",
            marker="o" if run.success else "X",
            ms=3.5,
            **look,
        )
        for side, name, run, look in zip("AB", names, runs, _RUNS, strict=True)
    ]


def plot_channel(
    result: Result | str | os.PathLike[str],
    *,
    channel: str,
    path: str | Path | None = None,
    module: int | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Plot a channel of a run over time, with the phases shaded.

    A figure of its own is as wide as a column (3.5 inches) and has a legend. The lines have labels,
    so that ``ax.legend()`` names them elsewhere.

    Args:
        result: the run, or the folder of a saved one.
        channel: any recorded one (docs/reference/channels.md), also of a sensor of your own.
        path: file to write; none: nothing is written.
        module: 1 to 3, to show this one alone, with its command where there is one; none: all.
        ax: where to draw; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: no such channel, module or format; ``path`` is given with ``ax``.
        OutputError: the file cannot be written, or the folder is no run.

    Example:
        >>> import omnitrack_sim as ot
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}))
        >>> ot.plot_channel(result, channel="normal_force", module=2).axes[0].get_ylabel()
        'Normal force, module 2 [N]'
    """
    playback = RunPlayback(as_result(result))
    run = playback.run
    schema = run.trajectory.schema
    if channel not in schema:
        raise InputError(Fault("channel", f"is {channel!r}", tuple(schema), str(channel)))
    modules = tuple(str(i + 1) for i in range(len(MODULE_COLOURS)))
    if module is not None and not has_modules(schema[channel]):
        raise InputError(Fault("module", f"{channel} has no modules"))
    if module is not None and str(module) not in modules:
        raise InputError(Fault("module", f"is {module!r}", modules))

    def draw(axis: Axes) -> None:
        shade(axis, run.trajectory)
        draw_panel(axis, playback, channel, module)
        axis.set_xlabel("time [s]")
        axis.set_ylabel(schema[channel].display.label(module))
        if ax is None:
            axis.tick_params(**TICKS)
            _legends(axis, run.trajectory)

    return chart(draw, (COLUMN, 2.3), path, ax, format)


def _legends(axis: Axes, trajectory: Trajectory) -> None:
    """Lines above the chart, phases below it."""
    lines = axis.get_legend_handles_labels()[0]
    figure: Any = axis.get_figure()
    for place, handles in (("upper", lines), ("lower", _phase_handles(trajectory))):
        if handles:
            loc = f"outside {place} left"
            names = [str(handle.get_label()) for handle in handles]
            ncols = min(4, legend_columns(names, _MAX_LEGEND // 2))
            figure.legend(handles=handles, loc=loc, ncols=ncols, borderaxespad=0.4)


COLUMNS = 3
"""Panels beside each other."""
_VIEWS_APART, _BELOW_VIEWS, _TALLEST_VIEW = 0.6, 0.6, 2.2
"""Inches between views of the way, and below them; their largest height."""
_LEGEND_WIDE = 2.5
"""Room beside the views, inches, from which on the legends stand there."""
_WAY = (0.82, 0.0, 0.42)


def _recorded(playback: Playback) -> Figure:
    """Return the way in elevation and plan, and below them a panel for each curve."""
    network, curves = playback.network, playback.curves
    faces = bore_faces(network)
    low, high = extent(faces)
    elevation, _, plan = aligned(high - low)
    wide, deep, tall = (high - low)[[*plan.columns, 2]]
    width = (PAGE - LEFT - RIGHT - _VIEWS_APART) / 2
    scale = min(width / wide, _TALLEST_VIEW / max(tall, deep))  # inches a metre
    legends = list(_legend_lines(playback.legends.values()).items())
    # Beside the views of a pipe that stands, above those of a long one.
    beside = LEFT + 2 * (scale * wide + _VIEWS_APART)
    width = PAGE - beside
    views = _TITLE + 0.1 + (0 if width > _LEGEND_WIDE else _heights(legends))
    above = views + scale * max(tall, deep) + _BELOW_VIEWS
    grid = PanelGrid(-(-len(curves) // COLUMNS), COLUMNS, above)
    down = _TITLE
    for head, handles in legends:
        place = {"left": beside, "width": width} if width > _LEGEND_WIDE else {}
        down += _LEGEND * grid.legend(handles, down, head, **place)
    top = 1 - (views + 0.08) / grid.height
    for number, view in enumerate((elevation, plan)):
        size = scale * np.array([wide, deep if number else tall])
        left = (LEFT + number * (size[0] + _VIEWS_APART)) / PAGE
        bottom = top - size[1] / grid.height
        box = (left, bottom, size[0] / PAGE, size[1] / grid.height)
        axis = grid.figure.add_axes(box)
        frame_view(axis, view, low, high)
        draw_pipes(axis, network, view, faces)
        flat = curves["position"].values[:, list(view.columns)]
        axis.plot(*flat.T, color=_WAY, lw=1.4, zorder=3)
        axis.plot(*flat[:1].T, "o", color=_WAY, mfc="white", ms=4, zorder=4)
    for number, (name, curve) in enumerate(curves.items()):
        last = number + COLUMNS >= len(curves)
        axis = grid.add(*divmod(number, COLUMNS), curve.display.label(), last)
        _draw_curve(axis, playback, name)
    heading = playback.heading
    text = f"{heading['outcome']} after {heading['duration']:.2f} s"
    headline(grid.figure, playback.name, text, LEFT)
    return grid.figure


def _draw_curve(axis: Axes, playback: Playback, name: str) -> None:
    """Draw one panel, with the parts as bands behind it."""
    curve = playback.curves[name]
    display, time = curve.display, playback.time
    for span in playback.passages:
        axis.axvspan(time[span.first], time[span.last], color=span.colour, lw=0, zorder=0)
    shown, lines = display.scale * curve.values, playback.lines(name)
    styles = line_styles(playback.legends.values())
    for column, label, colour in lines:
        style = styles.get(colour, "-") if colour else "-"
        axis.plot(time, shown[:, column], color=colour or INK, ls=style, label=label)
    if curve.names and display.each not in playback.legends:
        axis.legend(fontsize=5.5, ncols=3, loc="best", handlelength=1.0, columnspacing=0.8)
    if len(time) > 1:
        axis.set_xlim(time[0], time[-1])
    limits = limits_of(display, shown)
    if limits is not None:
        axis.set_ylim(*limits)
