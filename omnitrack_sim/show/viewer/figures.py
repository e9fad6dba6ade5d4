"""The figures that stand in the window, as pairs of a word and its value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Passage
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.robots.omnitrack.control.alignment import orientation_error, preferred_theta5
from omnitrack_sim.robots.omnitrack.singularity import safe_margin, sector_angle

Lines = list[tuple[str, str]]
"""Words and their values, a pair a line."""
LINE, LETTER, MARGIN = 23, 7, 20
"""Height of a line of a panel, width of a letter on average, and width of what stands between and
around its columns, pixels: of MuJoCo's font at the size that the windows take (mjFONTSCALE_100)."""
ROBOT = 0.2
"""Half the extent of the robot in the window, where the camera is at first, in heights of it."""


def covers_robot(lines: Lines, width: int, height: int) -> bool:
    """Whether a panel in an upper corner of a window of so many pixels lies over the robot, which
    is in the middle."""
    letters = sum(max(len(line[column]) for line in lines) for column in (0, 1))
    beside = LETTER * letters + MARGIN <= width / 2 - ROBOT * height
    above = LINE * len(lines) <= (0.5 - ROBOT) * height
    return not (beside or above)


@dataclass(frozen=True)
class Moment:
    """One robot at one moment.

    Attributes:
        slip_ratio, traction, normal_force: (3,) 1, N, N, as in the channels of these names.
        routes: of the run. location: of a batch of this one robot. reach: m, of the robot.
    """

    slip_ratio: Array
    traction: Array
    normal_force: Array
    routes: RouteMap
    location: Location
    reach: float


class Region(NamedTuple):
    """Where theta5 lies to the motion singularity region of the tee turn ahead or at hand.

    Attributes:
        inside: a module will lose the wall, as Section IV of the paper has it.
        border: rad, angle to the region's nearest border, by whichever way is shorter.
    """

    inside: bool
    border: float


def region_of(routes: RouteMap, location: Location, reach: float) -> Region | None:
    """The region of a robot's tee turn; None where none is ahead or at hand."""
    number = int(location.passage[0])
    passage = routes.passages[number]
    if passage is None or passage.manoeuvre != "tee_turn":
        return None
    # A right angle, whatever that of the branch: see Aligner.learn.
    margin = float(safe_margin(sector_angle(routes.corner_radius[number], reach, np.pi / 2)))
    error = float(orientation_error(location.theta5[0], preferred_theta5("tee_turn")))
    return Region(abs(error) > margin, abs(abs(error) - margin))


def place_lines(moment: Moment) -> Lines:
    """Where the robot is."""
    location, route = moment.location, moment.routes.routes[int(moment.location.route[0])]
    distance = float(location.distance[0])
    here: Passage = next((p for p in route.passages if distance < p.s_leave), route.passages[-1])
    name = route.network.parts[here.index].name
    return [
        ("in", name),
        ("travelled", f"{distance:.3f} of {route.centreline.length:.3f} m"),
        ("tilt", f"{np.degrees(location.tilt[0]):.1f} deg"),
    ]


def contact_lines(moment: Moment) -> Lines:
    """What the modules do at the wall, modules 1 to 3, and how the robot is turned."""
    return [
        ("module", _three("{:>6d}", (1, 2, 3))),
        ("slip ratio", _three("{:>z6.2f}", moment.slip_ratio)),
        ("traction, N", _three("{:>z6.1f}", moment.traction)),
        ("normal force, N", _three("{:>z6.1f}", moment.normal_force)),
        ("theta5", f"{np.degrees(moment.location.theta5[0]):z.1f} deg"),
        ("motion singularity", _told(region_of(moment.routes, moment.location, moment.reach))),
    ]


def _three(form: str, values: Array | tuple[int, int, int]) -> str:
    return " ".join(form.format(value) for value in values)


def _told(region: Region | None) -> str:
    if region is None:
        return "no tee turn ahead"
    where = "INSIDE, border" if region.inside else "outside, border"
    return f"{where} at {np.degrees(region.border):.1f} deg"
