"""Files of a map of reach: picture, page to hover over, tables and GeoJSON."""

from __future__ import annotations

import json
import math
import string
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import clipped, csv_text, finite, strict_json
from omnitrack_sim.base.writing import check_folder, write_files
from omnitrack_sim.results.html import safe
from omnitrack_sim.show.plots.style import GREY, INK, PAGE, chart, figure_bytes
from omnitrack_sim.towns.reach import NO_WAY, PipeReach, ReachMap
from omnitrack_sim.trials.table import to_json, to_parquet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = "viridis"
"""Colours of probabilities, distinct for any colour vision."""
REACHED = 0.01
"""Probability below which a part counts as not reached, and has the colour of what stops it."""
CAUSES = {
    "bore": ("a bore that the robot does not fit", "#e08b3e"),
    "unknown": ("what no trial has tried", "#b279a2"),
    "battery": ("the battery", "#c8322b"),
    "tether": ("the tether", "#8c5a44"),
    "step": ("a step or a bead that it hardly passes", "#4c78a8"),
    "gap": ("a gap that it hardly passes", "#72b7b2"),
    "ovality": ("ovality that it hardly passes", "#54a24b"),
    "deposit": ("a deposit or dent that it hardly passes", "#9d7660"),
    "fitting": ("another fitting that it hardly passes", "#6b7077"),
    "way": ("no way leads there", "#c9cdd2"),
}
"""Causes for which parts are not reached: words and colour."""
MAX_LETTERS = 24
"""Letters of an opening's name in a picture."""
MAX_NAMES = 6
"""Openings that a headline names; more are a number. Pictures name all."""
FILES = (
    *(f"reach.{ending}" for ending in ("csv", "parquet", "geojson", "html", "json")),
    "reach_parts.parquet",
)
PICTURES = tuple(f"reach.{ending}" for ending in ("png", "pdf", "svg"))
HEADS = (
    *("pipe", "kind", "length", "gets there", "and back", "time", "energy", "tether", "from"),
    "stopped by",
)


def plot_reach(
    reach: ReachMap,
    path: str | Path | None = None,
    *,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Plot a network coloured by the probability that the robot gets to each pipe.

    Args:
        reach: of ``map_reach``.
        path: file to write; none: the figure is returned and nothing is written.
        ax: where to draw; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: no such format; ``path`` is given with ``ax``.
        OutputError: the file cannot be written.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=4)
        >>> passport = plan.passport(ot.run_trials(plan).table)
        >>> reach = ot.map_reach(ot.load_network("tower"), passport, ["foot"])
        >>> figure = ot.plot_reach(reach)
    """
    check_is(ReachMap, "reach", reach)
    columns, names = _view(reach)
    lines = [(i, line[:, columns]) for i, line in _lines(reach)]
    points = np.concatenate([line for _, line in lines])
    wide, tall = np.ptp(points, axis=0)
    # As high as the pipes ask for beside the scale of colours, so that no margin is blank.
    high = (PAGE - _BESIDE) * (tall + 1e-9) / (wide + 1e-9) + _ABOVE
    legend = _unreached(reach)
    size = (PAGE, float(np.clip(high, 2.5, 8.0)) + _LEGEND * -(-len(legend) // _COLUMNS))
    unit, scale = ("km", 1e-3) if max(wide, tall) >= _LONG else ("m", 1.0)

    def draw(axes: Axes) -> None:
        _draw_pipes(axes, reach, [(i, scale * line) for i, line in lines])
        for name, place in zip(reach.openings, _openings(reach, lines), strict=True):
            _mark(axes, name, scale * place[:2])
        axes.set(xlabel=f"{names[0]} [{unit}]", ylabel=f"{names[1]} [{unit}]")
        axes.margins(0.03)
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(_headline(reach), loc="left")
        axes.tick_params(colors=GREY)
        if legend:
            _draw_legend(axes, legend)

    return chart(draw, size, path, ax, format)


_BESIDE, _ABOVE, _LEGEND, _COLUMNS = 1.55, 0.75, 0.18, 2
"""Inches beside a map, above and below it, and of a row of the legend, which has two columns."""
_LONG = 2000.0
"""Extent from which on a map is in kilometres, m."""


def _draw_pipes(axes: Axes, reach: ReachMap, lines: Sequence[tuple[int, Array]]) -> None:
    """Draw the pipes, those that are reached by their probability above the others."""
    from matplotlib.collections import LineCollection

    sides: dict[bool, list[tuple[int, Array]]] = {False: [], True: []}
    for i, line in lines:
        sides[reach.parts[i].probability >= REACHED].append((i, line))
    colours = [CAUSES[_group(reach.parts[i].stopped_by)][1] for i, _ in sides[False]]
    blocked = [line for _, line in sides[False]]
    axes.add_collection(LineCollection(blocked, linewidths=0.9, colors=colours, capstyle="round"))
    if not sides[True]:
        return
    drawn = LineCollection([line for _, line in sides[True]], linewidths=1.8, capstyle="round")
    drawn.set(array=np.array([reach.parts[i].probability for i, _ in sides[True]]))
    drawn.set(cmap=COLOURS, clim=(0, 1))
    axes.add_collection(drawn)
    figure = axes.get_figure(root=True)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.7, pad=0.01)  # type: ignore[union-attr]
    bar.set_label("probability of getting there")


def _mark(axes: Axes, name: str, place: Array) -> None:
    """Mark an opening and name it, on a white edge that sets the name off the pipes."""
    from matplotlib.patheffects import withStroke

    x, y = place.tolist()
    axes.plot(x, y, "v", color=INK, markersize=6, markeredgecolor="white", zorder=5)
    edge = [withStroke(linewidth=2, foreground="white")]
    beside = {"xytext": (5, 2), "textcoords": "offset points", "path_effects": edge}
    text = clipped(name, MAX_LETTERS)
    axes.annotate(text, (x, y), color=INK, fontsize=7, zorder=6, **beside)


def _draw_legend(axes: Axes, rows: Sequence[tuple[str, str, float]]) -> None:
    """Draw why pipes are not reached, below the map."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, lw=1.6, label=f"{words}, {length_text(length)}")
        for words, colour, length in rows
    ]
    axes.legend(
        handles=handles,
        title="not reached because of",
        loc="upper left",
        bbox_to_anchor=(0.0, -0.12),
        ncols=_COLUMNS,
        alignment="left",
    )


def _group(reason: str) -> str:
    """Return the key of ``CAUSES`` that a reason belongs to."""
    if reason in ("", NO_WAY):
        return "way"
    return next((key for key in CAUSES if reason.startswith(key)), "fitting")


def _unreached(reach: ReachMap) -> list[tuple[str, str, float]]:
    """Return words, colour and length, m, of each cause for which parts are not reached."""
    lengths: dict[str, float] = dict.fromkeys(CAUSES, 0.0)
    for part in reach.parts:
        if part.probability < REACHED:
            lengths[_group(part.stopped_by)] += part.length
    return [(*CAUSES[key], length) for key, length in lengths.items() if length > 0]


def save_reach(reach: ReachMap, folder: str | Path) -> list[Path]:
    """Write a map into a folder, and return the paths of its files.

    ``reach.csv``, ``.parquet``, ``.geojson`` and ``.html`` have a row a pipe,
    ``reach_parts.parquet`` one a part; beside them are ``reach.json``, and ``reach.png``, ``.pdf``
    and ``.svg``.

    Args:
        reach: of ``map_reach``.
        folder: made when missing; files of these names are replaced, all or none.

    Raises:
        OutputError: a file cannot be written; then none is.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=4)
        >>> passport = plan.passport(ot.run_trials(plan).table)
        >>> reach = ot.map_reach(ot.load_network("tower"), passport, ["foot"])
        >>> sorted(path.suffix for path in ot.save_reach(reach, "out"))[:4]
        ['.csv', '.geojson', '.html', '.json']
    """
    import pyarrow as pa

    check_is(ReachMap, "reach", reach)
    check_folder(folder, files=(*FILES, *PICTURES))
    rows, parts = ([finite(row._asdict()) for row in own] for own in (reach.pipes, reach.parts))
    table = [PipeReach._fields, *([row[name] for name in PipeReach._fields] for row in rows)]
    figure = plot_reach(reach)
    made = {
        "reach.csv": csv_text(table).encode(),
        "reach.parquet": to_parquet(pa.Table.from_pylist(rows)),
        "reach_parts.parquet": to_parquet(pa.Table.from_pylist(parts)),
        "reach.geojson": _geojson(reach, rows),
        "reach.html": _page(reach).encode(),
        "reach.json": to_json(summary_of(reach)),
        **{name: figure_bytes(figure, name.rpartition(".")[2]) for name in PICTURES},
    }
    return write_files({Path(folder) / name: data for name, data in made.items()})


def summary_of(reach: ReachMap) -> dict[str, Any]:
    """Return the contents of ``reach.json``."""
    openings = [
        {"opening": name, "adds_m": gain}
        for name, gain in zip(reach.openings, reach.gains, strict=True)
    ]
    returned = sum(part.length * part.back for part in reach.parts)
    stops: dict[str, float] = {}
    for part in reach.parts:
        why = _cause(part.stopped_by)
        stops[why] = stops.get(why, 0.0) + part.length * (1 - part.probability)
    return {
        "pipes": len(reach.pipes),
        "parts": len(reach.parts),
        "length_m": reach.length,
        "expected_m": reach.expected_length,
        "expected_there_and_back_m": returned,
        "openings": openings,
        "stops": sorted(stops.items(), key=lambda pair: -pair[1]),
        "bores": [row._asdict() for row in reach.bores],
        "assumed": dict(reach.assumed),
    }


def _cause(reason: str) -> str:
    """Return the kind of a reason: its text without place and figures."""
    for cause in ("battery", "tether", "bore"):
        if reason.startswith(cause):
            return cause
    return reason.partition(" (")[0].partition(" with ")[0] or "nothing"


@lru_cache(1)  # all files of a map are made of them
def _lines(reach: ReachMap) -> Sequence[tuple[int, Array]]:
    """Polylines (k, 3) m of all axes, with the number of the part."""
    parts = enumerate(reach.network.pipes.parts)
    return [(i, line) for i, part in parts for line in part.polylines()]


def _view(reach: ReachMap) -> tuple[list[int], str]:
    """Axes of the world to the right and up: from above, or the larger elevation."""
    size = np.ptp(np.concatenate([line for _, line in _lines(reach)]), axis=0)
    if size[2] <= max(size[0], size[1]):
        return [0, 1], "xy"
    return ([0, 2], "xz") if size[0] >= size[1] else ([1, 2], "yz")


def _openings(reach: ReachMap, lines: list[tuple[int, Array]]) -> Iterator[Array]:
    """Yield where the robot is put in, in the plane of the picture."""
    network = reach.network
    names = [fitting.name for fitting in network.fittings]
    columns, _ = _view(reach)
    for name in reach.openings:
        if name in names:
            own = [line for i, line in lines if i == names.index(name)]
            yield np.concatenate(own).mean(axis=0)
        else:
            index, port = network.end("opening", name)
            yield network.pipes.parts[index].port(port).position[columns]


def _headline(reach: ReachMap) -> str:
    names = ", ".join(reach.openings)
    if len(reach.openings) > MAX_NAMES:
        names = f"{len(reach.openings)} openings"
    whole, done = length_text(reach.length), length_text(reach.expected_length)
    return f"{done} of {whole} expected to be reached from {names}"


def length_text(length: float) -> str:
    """Return a length, m, to three digits with its unit, from a kilometre on in kilometres."""
    return f"{length / 1000:.3g} km" if length >= 999.5 else f"{length:.3g} m"


def _geojson(reach: ReachMap, rows: list[dict[str, Any]]) -> bytes:
    """Return the axes of each pipe as GeoJSON, in the network's own metres.

    GeoJSON asks for degrees, which a network has not, and GIS programs take metres as those of a
    local plane.
    """
    axes: list[list[Any]] = [[] for _ in rows]
    for i, line in _lines(reach):
        axes[reach.row_of[i]].append(np.round(line, 4).tolist())
    features = [
        {
            "type": "Feature",
            "properties": row,
            "geometry": {"type": "MultiLineString", "coordinates": lines},
        }
        for row, lines in zip(rows, axes, strict=True)
    ]
    collection = {"type": "FeatureCollection", "name": "reach", "features": features}
    return (strict_json(collection) + "\n").encode()


def _page(reach: ReachMap) -> str:
    """Return a page that shows the map, and what is said of the pipe where the pointer is."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    columns, _ = _view(reach)
    drawn, points = [], []
    flat = [(i, line[:, columns]) for i, line in _lines(reach)]
    for i, line in sorted(flat, key=lambda pair: reach.parts[pair[0]].probability):
        points.append(line * [1, -1])
        p, cause = reach.parts[i].probability, _group(reach.parts[i].stopped_by)
        colour = to_hex(colormaps[COLOURS](p)) if p >= REACHED else CAUSES[cause][1]
        place = " ".join(f"{a:.3f},{b:.3f}" for a, b in points[-1])
        width = 5 if p >= REACHED else 3
        drawn.append(
            f'<polyline data-i="{reach.row_of[i]}" points="{place}" stroke="{colour}" '
            f'stroke-width="{width}"/>'
        )
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.03 * float((high - low).max()) + 1e-3
    openings = zip(reach.openings, _openings(reach, flat), strict=True)
    box = [*(low - margin), *(high - low + 2 * margin)]
    ramp = ", ".join(to_hex(colormaps[COLOURS](k / 8)) for k in range(9))
    template = string.Template(Path(__file__).with_name("reach_map.html").read_text("utf-8"))
    return template.substitute(
        title="Reach",
        about=safe(_headline(reach)),
        box=" ".join(f"{value:.3f}" for value in box),
        lines="".join(drawn),
        ramp=f"linear-gradient(to right, {ramp})",
        rows=_script([_texts(row) for row in reach.pipes]),
        heads=_script(HEADS),
        openings=_script([[name, *(at[:2] * [1, -1]).round(3).tolist()] for name, at in openings]),
        causes=_script([[w, c, length_text(length)] for w, c, length in _unreached(reach)]),
    )


def _script(value: Any) -> str:
    """JSON that may stand in a script: names come from users."""
    return json.dumps(value).replace("<", "\\u003c")


def _texts(part: PipeReach) -> list[str]:
    """Return the texts of a part on the page, in the order of ``HEADS``."""
    name = [part.name, part.kind, f"{part.length:.2f} m"]
    if part.probability == 0 and not part.launch:
        return [*name, "no", "", "", "", "", "", part.stopped_by]
    tether = (
        "" if math.isnan(part.tether_n) else f"{part.tether_n:.1f} N, {part.tether_out_m:.1f} m"
    )
    return [
        *name,
        f"{part.probability:.3f} ({part.low:.3f} to {part.high:.3f})",
        f"{part.back:.3f}",
        f"{part.seconds:.0f} s, give or take {1.96 * part.seconds_std:.0f} s",
        f"{part.energy_wh:.3g} Wh",
        tether,
        part.launch,
        part.stopped_by,
    ]
