"""What a replay tells of a run over time: curves, phases, fittings, events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnitrack_sim.pipes import Route
from omnitrack_sim.record.events import Note
from omnitrack_sim.record.timeline import passage_indices
from omnitrack_sim.record.trajectory import RECORDED, Trajectory, spans
from omnitrack_sim.results.result import Result
from omnitrack_sim.show.plots.panels import shade_of
from omnitrack_sim.show.plots.time_chart import SHADES
from omnitrack_sim.show.replay.packing import Pack

DEGREES = 180 / math.pi
MOST_COLUMNS = 6
"""A channel of a user's own sensor with more numbers than this has no plot."""


@dataclass(frozen=True)
class Panel:
    """A plot of one channel over time.

    Attributes:
        title, unit: as shown. factor: from the channel's unit to this one.
        channel: of the trajectory. asked: the channel of what was asked for, if there is one.
        first: shown before the reader chooses.
        low, high: bounds of the plot, in ``unit``; None where the curves say them.
        least: what the bounds are apart at least, so that noise does not look like movement.
        wraps: values from -180 to 180 that go on at the other end.
    """

    title: str
    unit: str
    channel: str
    factor: float = 1.0
    asked: str | None = None
    first: bool = False
    low: float | None = None
    high: float | None = None
    least: float | None = None
    wraps: bool = False


PANELS = (
    Panel("Belt speed", "mm/s", "belt_speed", 1e3, "belt_speed_command", first=True, least=20.0),
    Panel("Slip ratio", "1", "slip_ratio", first=True, low=-1.0, high=1.0),
    Panel("Traction", "N", "traction", first=True, least=2.0),
    Panel("Normal force", "N", "normal_force", first=True, low=0.0, least=2.0),
    Panel("Tilt against the centreline", "deg", "tilt", DEGREES, first=True, low=0.0, least=2.0),
    Panel("Orientation θ5", "deg", "theta5", DEGREES, first=True, wraps=True, least=10.0),
    Panel("Motor torque", "N m", "motor_torque"),
    Panel("Slip velocity", "mm/s", "slip_velocity", 1e3),
    Panel("Module roll", "deg", "roll", DEGREES, asked="roll_command", least=10.0),
    Panel("Arm slide, outward", "mm", "slide", 1e3),
    Panel("Arm pitch, nose outward", "deg", "pitch", DEGREES),
    Panel("Distance along the centreline", "m", "distance"),
    Panel("Distance from the centreline", "mm", "offset", 1e3, low=0.0),
)
SHOWN_ELSEWHERE = ("gear", "contact_position", "contact_count")
"""Channels that the picture needs beside those of the plots."""


def panels_of(trajectory: Trajectory) -> list[Panel]:
    """The plots of a run: ``PANELS``, and one for each channel of a user's own sensors."""
    own = [
        Panel(name.replace("_", " "), channel.unit, name)
        for name, channel in trajectory.schema.items()
        if name not in RECORDED and len(channel.columns) <= MOST_COLUMNS
    ]
    return [*PANELS, *own]


def curves_table(trajectory: Trajectory, pack: Pack) -> dict[str, Any]:
    """The channels that are shown, by name."""
    names = [panel.channel for panel in panels_of(trajectory)]
    names += [panel.asked for panel in PANELS if panel.asked is not None]
    return {name: pack.ranged(trajectory[name]) for name in (*names, *SHOWN_ELSEWHERE)}


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


def events_table(result: Result) -> list[dict[str, Any]]:
    """What happened, in order of time, in words."""
    events = sorted(result.events, key=lambda event: event.time)
    return [
        {"time": event.time, "text": event.text}
        for event in events
        if not isinstance(event, Note) and math.isfinite(event.time)
    ]


def notes(result: Result) -> list[str]:
    """Remarks about the set-up of a run."""
    return [str(event) for event in result.events if isinstance(event, Note)]


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
