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
from omnitrack_sim.base.text import csv_text, finite, strict_json
from omnitrack_sim.base.writing import check_folder, write_files
from omnitrack_sim.results.html import safe
from omnitrack_sim.show.plots.style import GREY, INK, PAGE, chart, figure_bytes
from omnitrack_sim.towns.reach import PipeReach, ReachMap
from omnitrack_sim.trials.table import to_json, to_parquet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS, UNREACHED = "viridis", "#c9cdd2"
"""Colours of probabilities, distinct for any colour vision, and of parts out of reach."""
MAX_NAMES = 6
"""Openings that a picture names."""
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
    size = (PAGE, float(np.clip(PAGE * (tall + 1e-9) / (wide + 1e-9), 2.5, 8.0)))

    def draw(axes: Axes) -> None:
        from matplotlib.collections import LineCollection

        # What is reached lies above what is not.
        for reached in (False, True):
            own = [(i, line) for i, line in lines if (reach.parts[i].probability > 0) == reached]
            drawn = LineCollection([line for _, line in own], linewidths=1.6, capstyle="round")
            if reached:
                drawn.set(array=np.array([reach.parts[i].probability for i, _ in own]))
                drawn.set(cmap=COLOURS, clim=(0, 1))
                axes.get_figure(root=True).colorbar(  # type: ignore[union-attr]
                    drawn, ax=axes, label="probability of getting there", shrink=0.7
                )
            else:
                drawn.set(color=UNREACHED, linewidth=0.9)
            axes.add_collection(drawn)
        for k, place in enumerate(_openings(reach, lines)):
            axes.plot(*place, "v", color=INK, markersize=6)
            if len(reach.openings) <= MAX_NAMES:
                beside = {"xytext": (5, 2), "textcoords": "offset points"}
                x, y = place[:2].tolist()
                axes.annotate(reach.openings[k], (x, y), color=INK, fontsize=7, **beside)
        axes.set(aspect="equal", xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]")
        axes.margins(0.03)
        axes.autoscale_view()
        axes.set_title(_headline(reach), loc="left")
        axes.tick_params(colors=GREY)

    return chart(draw, size, path, ax, format)


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
    for i, line in sorted(_lines(reach), key=lambda pair: reach.parts[pair[0]].probability):
        x, y = line[:, columns].T
        points.append(np.stack([x, -y], axis=-1))
        p = reach.parts[i].probability
        colour = to_hex(colormaps[COLOURS](p)) if p > 0 else UNREACHED
        place = " ".join(f"{a:.3f},{b:.3f}" for a, b in points[-1])
        width = 5 if p > 0 else 3
        drawn.append(
            f'<polyline data-i="{reach.row_of[i]}" points="{place}" stroke="{colour}" '
            f'stroke-width="{width}"/>'
        )
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.06 * float((high - low).max()) + 1e-3
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
