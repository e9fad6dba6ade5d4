"""Values that describe how a robot is shown in films, pages, figures and windows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.record.channels import Display

Colour = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1."""
MODULE_COLOURS: tuple[Colour, ...] = ((0.95, 0.55, 0.05), (0.10, 0.45, 0.80), (0.05, 0.62, 0.42))
"""Colours of modules 1, 2, 3 on a robot and in every curve: told apart with any colour vision
(after Okabe and Ito)."""


class Bar(NamedTuple):
    """A signed value beside others of its kind.

    Attributes:
        label: word or number before it.
        colour: of label and bar.
        share: -1 to 1, of the half of the bar's width; 0 to 1 of all of it where there is no sign.
        text: the value for people.
        has_sign: the bar begins in the middle.
    """

    label: str
    colour: Colour
    share: float
    text: str
    has_sign: bool = True


class StatusText(NamedTuple):
    """Text of a status panel at one moment.

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


class Moment(NamedTuple):
    """One robot at one moment of a run, recorded or live.

    Attributes:
        time: s.
        phase: name of the controller's phase.
        part: name of the part that the robot's centre is in; "" where that is unknown.
        value: returns the value of a channel by its name.
    """

    time: float
    phase: str
    part: str
    value: Callable[[str], Array]


Lines = list[tuple[str, str]]
"""Words and their values, a pair a line."""


class Curve(NamedTuple):
    """Values over time with their appearance.

    Attributes:
        display: title, unit and limits.
        values: (T, n).
        names: of the columns; empty for a single one, and for one a module.
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


def model_cameras(model: Any) -> dict[str, CarriedCamera]:
    """Return the cameras of a MuJoCo model that have a name, each fixed to its body."""
    cameras = {}
    for i in range(model.ncam):
        x, y, z = matrix_from_quaternion(np.array(model.cam_quat[i])).tolist()
        cameras[model.camera(i).name] = CarriedCamera(
            body=int(model.cam_bodyid[i]),
            position=tuple(model.cam_pos[i].tolist()),
            frame=(tuple(x), tuple(y), tuple(z)),
            angle_deg=float(model.cam_fovy[i]),
        )
    return {name: camera for name, camera in cameras.items() if name}


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


FORCES = {
    "normal_force": ("normal force", "#1c2430", True),
    "traction": ("traction", "#d1006c", False),
}
"""Kinds of forces: words, colour, and whether the arrow ends where the force acts."""


class Track(NamedTuple):
    """A track that runs round its carrier, drawn as far along a slide joint as it has run.

    Attributes:
        carrier: name of the body that it lies on.
        joint: name of its slide joint.
        column: of the channel of its speed, and of channels with a value a carrier.
        side: which of the tracks of its carrier.
    """

    carrier: str
    joint: str
    column: int
    side: int


class SingularRange(NamedTuple):
    """Range of orientations in which a robot cannot turn.

    Attributes:
        sector_deg: its width by the theory, degrees.
        margin_deg: from the best orientation to the range with the real length of the contact,
            degrees; None where that leaves none.
    """

    sector_deg: float
    margin_deg: float | None


StateValue = tuple[str, str, float, int, str]
"""A value below the phase on a page: channel, words before it, scale, digits, words behind it."""
