"""Towns as EPANET has them (``.inp``), read by wntr: pipes as lines on a map, with heights."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.bounds import MAX_TOWN_LENGTH, too_long
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.rotations import Array, length
from omnitrack_sim.base.text import installing
from omnitrack_sim.pipes.importing.assumptions import ImportNote, ImportSettings, true_bore
from omnitrack_sim.pipes.importing.drawing import Drawing, DrawnPipe

FOOT = 0.3048
"""Length of a foot, m."""
FIT = 0.1
"""Difference of a drawn length from the file's, share, up to which they are the same."""
MIN_FIT = 0.8
"""Share of all length that has to fit, or the drawing is a schematic one."""
STEEP = 1.0
"""Slope of all pipes of a node, m/m, from which its height is taken for missing."""
MIN_PIPE = 0.01
"""Of a pipe, m."""
MIN_BORE, MAX_BORE, MAX_LENGTH, MAX_HEIGHT = 1e-3, 20.0, 200_000.0, 10_000.0
"""Sizes that pipes have, m, and heights of nodes: the longest water tunnel is of 137 km."""
MAX_MAP = 1e9
"""Largest coordinate of a map, in its units: millimetres of a country."""
STUB, MIN_RISE = 10.0, 2.0
"""Level pipe between a node and a rise beside it, and the least height of one: a lower one has no
room for its bends. Both in bores."""
PROFILES = {
    "even": "rise evenly between two nodes",
    "low": "are level from their lower end, and rise by 45 degrees beside the other",
    "high": "are level from their higher end, and fall by 45 degrees beside the other",
}


def read_epanet(path: Path, settings: ImportSettings) -> Drawing:
    """Read a town's drawing.

    Raises:
        NetworkError: wntr is missing or cannot read it; it has no coordinates, or they do not fit
            its lengths.
    """
    model = _model(path)
    flat = {name: np.array(node.coordinates, float) for name, node in model.nodes()}
    lines = {
        name: np.array([flat[pipe.start_node_name], *pipe.vertices, flat[pipe.end_node_name]])
        for name, pipe in model.pipes()
    }
    if not lines:
        raise NetworkError(Fault(path.name, "has no pipes"))
    _refuse_odd(path, model, flat)
    notes: list[ImportNote] = []
    scale = _scale(path, model, lines, settings, notes)
    drawn = scale * sum(
        float(length(np.diff(_flat(line), axis=0)).sum()) for line in lines.values()
    )
    if faults := too_long(drawn, f"{path.name}: pipes", MAX_TOWN_LENGTH):
        raise NetworkError(
            [replace(fault, problem=f"{fault.problem}; see scale") for fault in faults]
        )
    # Far from the origin positions would lose digits.
    middle = scale * np.mean(list(flat.values()), axis=0).round()
    notes.append(
        ImportNote("assumed", "the map", f"{middle[0]:.0f} m, {middle[1]:.0f} m is its origin here")
    )
    heights = _heights(model, {n: scale * line for n, line in lines.items()}, notes)
    nodes = {name: np.append(scale * place - middle, heights[name]) for name, place in flat.items()}
    basins = set(model.tank_name_list) | set(model.reservoir_name_list)
    drawing = Drawing(nodes, {}, open_ends=basins, notes=notes)
    for name, pipe in model.pipes():
        ends = pipe.start_node_name, pipe.end_node_name
        heights_there = nodes[ends[0]][2], nodes[ends[1]][2]
        bore = true_bore(float(pipe.diameter), settings.schedule)
        points = _in_space(scale * lines[name] - middle, heights_there, settings.profile, bore)
        if ends[0] == ends[1] or length(np.diff(points, axis=0)).sum() < MIN_PIPE:
            notes.append(ImportNote("left out", f"pipe {name}", "begins where it ends"))
            continue
        drawing.lengths[name] = float(pipe.length)
        drawing.legs[name] = DrawnPipe(name, name, ends, points, bore)
        if str(pipe.initial_status) == "Closed" or pipe.check_valve:
            drawing.close(name)
    for name, link in model.links():
        if link.link_type != "Pipe":
            problem = f"is a {link.link_type.lower()}, between closed ends"
            notes.append(ImportNote("left out", f"link {name}", problem))
            drawing.part(link.start_node_name, link.end_node_name)
    notes += _assumptions(settings)
    return drawing


def _refuse_odd(path: Path, model: Any, flat: Mapping[str, Array]) -> None:
    """Refuse sizes and places that no town has.

    Raises:
        NetworkError: with the first of them.
    """
    pipes, places = dict(model.pipes()), (-MAX_MAP, MAX_MAP)
    values = [
        *((f"pipe {n}", "diameter", p.diameter, MIN_BORE, MAX_BORE) for n, p in pipes.items()),
        *((f"pipe {n}", "length", p.length, MIN_PIPE, MAX_LENGTH) for n, p in pipes.items()),
        *(
            (f"pipe {name}", "vertex", place, *places)
            for name, pipe in pipes.items()
            for place in np.ravel(pipe.vertices)
        ),
        *((f"node {name}", "coordinate", x, *places) for name, at in flat.items() for x in at),
        *((f"node {n}", "height", _height(o), -MAX_HEIGHT, MAX_HEIGHT) for n, o in model.nodes()),
    ]
    faults = [
        Fault(f"{path.name}: {where}", f"has a {what} of {value:.6g}; from {low:g} to {high:g}")
        for where, what, value, low, high in values
        if not low <= value <= high
    ]
    if faults:
        raise NetworkError(faults)


def _height(node: Any) -> float:
    height = getattr(node, "elevation", None)
    return float(node.base_head if height is None else height)


def _assumptions(settings: ImportSettings) -> list[ImportNote]:
    """Return what EPANET does not know."""
    bores = f"those of schedule {settings.schedule}" if settings.schedule else "those of the file"
    values = {
        "bends": f"have mean radii of {settings.bend_radius:g} bores, or less without room; up to "
        f"{settings.deflection_deg:g} degrees a joint is deflected",
        "bores": f"are {bores}",
        "profiles": PROFILES[settings.profile],
    }
    return [ImportNote("assumed", where, problem) for where, problem in values.items()]


def _model(path: Path) -> Any:
    """Return wntr's model of a file."""
    try:
        wntr = importlib.import_module("wntr")
    except ImportError as error:
        problem = f"is a file of EPANET, which wntr reads: {installing('town')}"
        raise NetworkError(Fault(path.name, problem)) from error
    try:
        return wntr.network.WaterNetworkModel(str(path))
    except Exception as error:  # wntr raises errors of many kinds
        problem = f"wntr cannot read it: {type(error).__name__}: {error}"
        raise NetworkError(Fault(path.name, problem)) from error


def _scale(
    path: Path,
    model: Any,
    lines: dict[str, Array],
    settings: ImportSettings,
    notes: list[ImportNote],
) -> float:
    """Return the length of a unit of the coordinates, m, and note it."""
    pipes = dict(model.pipes())
    drawn = np.array([_drawn(line) for line in lines.values()])
    asked = np.array([float(pipes[name].length) for name in lines])
    if not (drawn > 0).any():
        raise NetworkError(Fault(path.name, "has no coordinates: its pipes have no places"))
    ratio = float(np.median(asked[drawn > 0] / drawn[drawn > 0]))
    for known in (1.0, FOOT):
        if abs(ratio / known - 1) < 0.01:
            ratio = known
    scale = settings.scale or ratio
    off = np.abs(scale * drawn / asked - 1)
    fit = float(asked[off <= FIT].sum() / asked.sum())
    if fit < MIN_FIT and not settings.scale:
        problem = (
            f"is a schematic drawing: coordinates and lengths fit for {100 * fit:.0f} % of the "
            "length; give a scale, and pipes are as long as drawn"
        )
        raise NetworkError(Fault(path.name, problem))
    notes.append(ImportNote("assumed", "the map", f"a unit of its coordinates is {scale:.6g} m"))
    return scale


def _drawn(line: Array) -> float:
    """Return the length of a line on the map, in its units."""
    return float(length(np.diff(_flat(line), axis=0)).sum())


def _flat(line: Array) -> Array:
    """Return points (k, 2) with a third coordinate of 0."""
    return np.column_stack([line, np.zeros(len(line))])


def _heights(model: Any, lines: dict[str, Array], notes: list[ImportNote]) -> dict[str, float]:
    """Return the height of each node, m.

    Of one whose pipes would all be steep, that of those around it.
    """
    heights = {}
    for name, node in model.nodes():
        heights[name] = _height(node)
    around: dict[str, list[tuple[str, float]]] = {name: [] for name in heights}
    for name, pipe in model.pipes():
        run = max(float(length(np.diff(_flat(lines[name]), axis=0)).sum()), MIN_PIPE)
        for one, other in (
            (pipe.start_node_name, pipe.end_node_name),
            (pipe.end_node_name, pipe.start_node_name),
        ):
            around[one].append((other, run))
    given = dict(heights)
    for name, beside in around.items():
        if beside and all(abs(given[o] - given[name]) > STEEP * run for o, run in beside):
            heights[name] = float(np.median([given[other] for other, _ in beside]))
            problem = (
                f"its pipes would be steep at {given[name]:.1f} m: lies at {heights[name]:.1f} m"
            )
            notes.append(ImportNote("mended", f"node {name}", problem))
    return heights


def _in_space(line: Array, heights: tuple[float, float], profile: str, bore: float) -> Array:
    """Return points (k, 3) m of a line on the map that rises from one height to another."""
    steps = length(np.diff(_flat(line), axis=0))
    s = np.append(0.0, np.cumsum(steps))
    whole, (first, last) = max(float(s[-1]), MIN_PIPE), heights
    rise, stub = abs(last - first), STUB * bore
    knots = np.array([[0.0, first], [whole, last]])
    if profile != "even" and rise > MIN_RISE * bore and whole > rise + 3 * stub:
        # The end beside which it rises: of a low one the higher, of a high one the lower.
        at_last = (last > first) == (profile == "low")
        begin = whole - stub - rise if at_last else stub
        knots = np.insert(knots, 1, [[begin, first], [begin + rise, last]], axis=0)
    places = np.union1d(s, knots[1:-1, 0])
    columns = [np.interp(places, s, column) for column in line.T]
    return np.column_stack([*columns, np.interp(places, *knots.T)])
