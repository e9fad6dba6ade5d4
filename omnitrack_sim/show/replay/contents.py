"""Contents of the replay page over time: curves, phases, events, map and pictures."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from PIL import Image

from omnitrack_sim.pipes import Route
from omnitrack_sim.record.events import Note
from omnitrack_sim.record.timeline import passage_indices
from omnitrack_sim.record.trajectory import RECORDED, Trajectory, spans
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.results.result import Result
from omnitrack_sim.show.film.overlay import BESIDE, levels, palette
from omnitrack_sim.show.plots.mission_figure import SHADES
from omnitrack_sim.show.plots.panels import shade_of
from omnitrack_sim.show.projection import clearest, needs_map
from omnitrack_sim.show.replay.packing import Pack, rounded

FIRST = ("belt_speed", "slip_ratio", "traction", "normal_force", "tilt", "theta5")
"""Channels whose plots are shown before the reader chooses."""
PLOTTED = (
    *FIRST,
    "motor_torque",
    "slip_velocity",
    "roll",
    "slide",
    "pitch",
    "distance",
    "offset",
)
MOST_COLUMNS = 6
"""A channel of a user's own sensor with more numbers than this has no plot."""
_NOT_PLOTTED = ("gear", "contact_position", "contact_count")  # needed by the picture
PICTURE_PERIOD = 0.5
"""Time between two pictures of a page, s."""
MOST_PICTURES = 600
"""Pictures of a page; those of a long run are farther apart."""
TILE, TILES_ACROSS = 48, 25
"""Largest side of a picture's tile, pixels, and tiles beside each other."""


def _plotted(trajectory: Trajectory) -> list[str]:
    """Channels that have a plot: ``PLOTTED``, and those of a user's own sensors."""
    own = [
        name
        for name, channel in trajectory.schema.items()
        if name not in RECORDED and len(channel.columns) <= MOST_COLUMNS
    ]
    return [*PLOTTED, *own]


def panels_table(trajectory: Trajectory) -> list[dict[str, Any]]:
    """The plots of a run: how each channel is displayed."""
    return [
        {"channel": name, "first": name in FIRST, **asdict(trajectory.schema[name].display)}
        for name in _plotted(trajectory)
    ]


def curves_table(trajectory: Trajectory, pack: Pack) -> dict[str, Any]:
    """The channels that are shown, by name."""
    names = _plotted(trajectory)
    commands = [trajectory.schema[name].display.command for name in names]
    names += [*filter(None, commands), *_NOT_PLOTTED]
    return {name: pack.ranged(trajectory[name]) for name in names}


def phases_table(trajectory: Trajectory) -> list[dict[str, Any]]:
    """The phases in order, with times in s and the colours of the summary figure."""
    codes = {name: code for code, name in enumerate(trajectory.phases)}
    return [
        {
            "name": name.replace("_", " "),
            "start": start,
            "end": end,
            "colour": shade_of(codes[name]),
        }
        for name, start, end in trajectory.phase_spans()
    ]


def fittings_table(trajectory: Trajectory, routes: Sequence[Route]) -> list[dict[str, Any]]:
    """The fittings that the robot's centre was in, in order, with times in s."""
    leg, place = trajectory["leg"].astype(int), passage_indices(trajectory, routes)
    table = []
    for first, last in spans(leg, place, trajectory["gear"]):
        route = routes[int(leg[first])]
        passage = route.passages[int(place[first])]
        table.append(
            {
                "name": route.network.parts[passage.index].name,
                "manoeuvre": passage.words,
                "colour": SHADES.get(passage.words, SHADES["straight"]),
                "leg": int(leg[first]) + 1 if len(routes) > 1 else None,
                "tail": bool(trajectory["gear"][first] < 0),
                "start": float(trajectory.time[first]),
                "end": float(trajectory.time[last]),
            }
        )
    return table


def events_table(result: Result) -> dict[str, Any]:
    """Events in order of time, in words, and remarks about the set-up of a run."""
    events = sorted(result.events, key=lambda event: event.time)
    return {
        "events": [
            {"time": event.time, "text": event.text}
            for event in events
            if not isinstance(event, Note) and math.isfinite(event.time)
        ],
        "notes": [str(event) for event in result.events if isinstance(event, Note)],
    }


def arrow_scales(trajectory: Trajectory, scale: float) -> dict[str, float]:
    """Length of the arrows of forces, m/N: nearly the largest one is about half a bore long.

    Args:
        trajectory: the record.
        scale: of the robot.
    """
    found = {}
    for name in ("normal_force", "traction"):
        sizes = np.abs(trajectory[name])
        sizes = sizes[np.isfinite(sizes)]
        large = float(np.percentile(sizes, 98)) if len(sizes) else 0.0
        found[name] = _nice(0.08 * scale / large) if large > 0 else 1e-3
    return found


def _nice(value: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten up to ``value`` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9))


def map_table(result: Result) -> dict[str, Any] | None:
    """Pieces of the pipes' axes from the farthest to the nearest, goals and plates, in m to the
    right and up; None where the route is too short to need a map."""
    if not needs_map(result.routes()):
        return None
    view = clearest(result.pipes)
    return {
        "beside": BESIDE,
        "view": rounded(view.axes[:, :2].T, 7),
        "pieces": [
            [round(radius, 4), *rounded(ends, 4)]
            for radius, ends in view.segments(result.pipes.parts)
        ],
        "goals": rounded(view.flat(result.goal_points()), 4),
        "plates": [rounded(view.flat(rim), 4) for rim in result.plate_rims()],
    }


def pictures_table(pictures: Pictures | None, trajectory: Trajectory) -> dict[str, Any] | None:
    """Pictures of the camera at the leading end: a PNG of tiles row by row, and the time, s, of
    each; None where there are none."""
    chosen = [] if pictures is None else _leading(pictures, trajectory)
    if pictures is None or not chosen:
        return None
    side, rows = min(TILE, pictures.size), -(-len(chosen) // TILES_ACROSS)
    # Of a picture with more pixels, the tile has those nearest to the middles of its own.
    places = ((np.arange(side) + 0.5) * pictures.size / side).astype(np.intp)
    sheet = np.zeros((rows * side, min(TILES_ACROSS, len(chosen)) * side), np.uint8)
    for number, index in enumerate(chosen):
        top, left = side * (number // TILES_ACROSS), side * (number % TILES_ACROSS)
        tile = levels(pictures[index][np.ix_(places, places)], pictures.unit)
        sheet[top : top + side, left : left + side] = tile
    image, buffer = Image.fromarray(sheet, "P"), io.BytesIO()
    image.putpalette(palette(pictures.unit).tobytes())
    image.save(buffer, "PNG", optimize=True)
    return {
        "png": base64.b64encode(buffer.getvalue()).decode(),
        "side": side,
        "columns": TILES_ACROSS,
        "time": [round(float(pictures.time[index]), 6) for index in chosen],
    }


def _leading(pictures: Pictures, trajectory: Trajectory) -> list[int]:
    """Indices of the pictures ahead, the first one of each period."""
    rows = np.clip(np.searchsorted(trajectory.time, pictures.time), 0, len(trajectory.time) - 1)
    ahead = np.flatnonzero(pictures.end == trajectory["gear"][rows])
    period = max(PICTURE_PERIOD, float(np.ptp(pictures.time)) / (MOST_PICTURES - 1))
    slot = np.floor(pictures.time[ahead] / period + 1e-6)
    return ahead[np.diff(slot, prepend=-1.0) > 0].tolist()
