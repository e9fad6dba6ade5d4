"""Display of one kind of robot: the values that it hands to films, pages and figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from omnitrack_sim.base.rotations import Array
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


class Mount(NamedTuple):
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


@dataclass(frozen=True)
class RobotDisplay:
    """What films show of one kind of robot, beside the pipes.

    Attributes:
        chassis: name of the body that cameras keep with.
        looks: returns the MjSpec of what is seen, of pipes, parameters of the robot, closed ports
            (part index, port), and whether faces may be coarse.
        poses: returns the joint positions (T, nq) that are shown, of the compiled model, a
            trajectory and the robot's parameters.
        casts: returns whether a geom of this name throws a shadow.
        status: returns the panel's text, of a trajectory, a sample and the part's name.
        onboard: returns the camera ``onboard`` of a robot with these parameters.
        finite: channels that a sample which is shown has to have finite values of.
    """

    chassis: str
    looks: Callable[..., Any]
    poses: Callable[[Any, Trajectory, Any], Array]
    casts: Callable[[str], bool]
    status: Callable[[Trajectory, int, str], StatusText]
    onboard: Callable[[Any], Mount]
    finite: tuple[str, ...]
