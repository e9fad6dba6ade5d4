"""Display of one kind of robot: the values that it hands to films, pages and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.channels import Display
from omnitrack_sim.record.trajectory import Trajectory

Colour = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1."""


class Bar(NamedTuple):
    """A signed value beside others of its kind.

    Attributes:
        label: word or number before it.
        colour: of label and bar.
        share: -1 to 1, of the half of the bar's width.
        text: the value for people.
    """

    label: str
    colour: Colour
    share: float
    text: str


class StatusText(NamedTuple):
    """Text of a film's status panel at one moment.

    Attributes:
        title: large, above all.
        lines: below it.
        caption: of the bars.
        bars: below the caption.
    """

    title: str
    lines: tuple[str, ...]
    caption: str = ""
    bars: tuple[Bar, ...] = ()


class Curve(NamedTuple):
    """Values over time with their appearance.

    Attributes:
        display: title, unit and limits.
        values: (T, n).
        names: of the columns; empty for a single one.
    """

    display: Display
    values: Array
    names: tuple[str, ...] = ()


class CarriedCamera(NamedTuple):
    """A camera that a body carries.

    Attributes:
        body: name or number of the body.
        position: m, in the body's frame, as all that follows.
        frame: rows of the matrix whose columns point right, up and back in its pictures.
        angle_deg: vertical field of view, degrees.
    """

    body: str | int
    position: tuple[float, float, float]
    frame: tuple[tuple[float, float, float], ...]
    angle_deg: float


class ForceArrow(NamedTuple):
    """An arrow of one force over time, world frame.

    Attributes:
        kind: which of ``FORCES`` it is.
        point: (T, 3) m, where it acts.
        force: (T, 3) N.
    """

    kind: str
    point: Array
    force: Array


class Track(NamedTuple):
    """A body that pages carry along with another one, as far along its joint as it has run.

    Attributes:
        carrier: name of the body that it lies on.
        joint: name of its slide joint.
        column: of ``PageDisplay.travel``, and of channels with a value a carrier.
        side: which of the tracks of its carrier.
    """

    carrier: str
    joint: str
    column: int
    side: int


FORCES = {
    "normal_force": ("normal force", "#1c2430", True),
    "traction": ("traction", "#d1006c", False),
}
"""Kinds of forces: words, colour, and whether the arrow ends where the force acts."""


@dataclass(frozen=True)
class PageDisplay:
    """Looks of one kind of robot on a replay page.

    Attributes:
        first: channels whose plots are shown before the reader chooses.
        plotted: all channels of the package that have plots.
        kept: further channels that the picture needs.
        columns: name and colour of each column of a channel with so many.
        badges: bodies that a number in the colour of its column stands on.
        tracks: by the names of the bodies.
        travel: returns the way (T, k) m that tracks have run, of a trajectory.
        pitch: returns the way after which a track looks the same, m, of the robot's parameters.
        arrows: returns the arrows of forces, of a trajectory and of positions, m, and quaternions
            (T, 7) of the ``badges``.
        state: channel, words before its value, scale, digits and words behind it, below the phase.
        headline: metrics in the head.
        onboard: returns the camera on board, as of ``RobotDisplay``.
    """

    first: tuple[str, ...]
    plotted: tuple[str, ...]
    kept: tuple[str, ...]
    columns: tuple[tuple[str, Colour], ...]
    badges: tuple[str, ...]
    tracks: Mapping[str, Track]
    travel: Callable[[Trajectory], Array]
    pitch: Callable[[Any], float]
    arrows: Callable[[Trajectory, Sequence[Array]], list[ForceArrow]]
    state: tuple[tuple[str, str, float, int, str], ...]
    headline: tuple[str, ...]
    onboard: Callable[[Any], CarriedCamera]


class LiveLooks(Protocol):
    """Looks of a robot that move on while a simulation runs.

    Attributes:
        travel: (k,) m, way that its tracks have run.
    """

    travel: Array

    def advance(self, value: Callable[[str], Array], period: float) -> None:
        """Go on by one control period, s; ``value`` returns a channel's value at its end."""

    def place(self, qpos: Array) -> None:
        """Put the joints in positions (nq,) where they are shown."""


Lines = list[tuple[str, str]]
"""Words and their values, a pair a line."""


@dataclass(frozen=True)
class RobotDisplay:
    """Looks of one kind of robot in films.

    Attributes:
        looks: returns the MjSpec of what is seen, of pipes, parameters of the robot, closed ports
            (part index, port), and whether faces may be coarse.
        poses: returns the joint positions (T, nq) that are shown, of the compiled model, a
            trajectory and the robot's parameters.
        casts: returns whether a geom of this name throws a shadow.
        status: returns the panel's text, of a trajectory, a sample and the part's name.
        onboard: returns the camera ``onboard`` of a robot with these parameters.
        finite: channels that a sample which is shown has to have finite values of.
        summary: channel of each panel of the summary figure, row by row, and the module where it
            shows only one.
        page: of the replay page.
        live: returns the looks of a robot in a window, of the model and the robot's parameters.
        figures: returns lines of figures for the window, of what returns a channel's value, of a
            route map, a location on it and the robot's parameters.
    """

    looks: Callable[..., Any]
    poses: Callable[[Any, Trajectory, Any], Array]
    casts: Callable[[str], bool]
    status: Callable[[Trajectory, int, str], StatusText]
    onboard: Callable[[Any], CarriedCamera]
    finite: tuple[str, ...]
    summary: tuple[tuple[tuple[str, int | None], ...], ...]
    page: PageDisplay
    live: Callable[[Any, Any], LiveLooks]
    figures: Callable[[Callable[[str], Array], RouteMap, Location, Any], Lines]
