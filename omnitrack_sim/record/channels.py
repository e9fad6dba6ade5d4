"""Schema of measured quantities, and the channels that every robot has.

A channel is the single source of plant, observation, recorder, files and tables of the pages.
Further channels are those of the robot (``Robot.channels``) and of a user's own sensors, which
bring them along (docs/how-to/extending.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

Frame = Literal["", "world", "robot", "route"]
TailFirst = Literal["same", "swapped", "negated", "turned", "facing", "behind"]
Source = Literal["plant", "route", "command", "leg", "estimate"]

DEGREES = 180.0 / math.pi
"""Factor from rad to degrees, in which people read angles."""
_SHAPES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "same": ((),),
    "swapped": ((3,),),
    "negated": ((),),
    "turned": ((3,),),
    "facing": ((3, 3),),
    "behind": ((4,),),
}
"""Leading shape of a sample that each way of mirroring needs."""


@dataclass(frozen=True)
class Display:
    """Appearance of a channel in figures, the replay page, films and the window.

    Attributes:
        title: name for people.
        unit: unit shown.
        scale: factor from the channel's unit to the one shown.
        command: name of the channel with the commanded value; empty without one.
        low: value that an axis reaches down to at least, in ``unit``; None: as the values are.
        high: value that an axis reaches up to at least, in ``unit``; None: as the values are.
        span: least span of an axis, in ``unit``, so that noise does not look like movement.
        wraps: values from -180 to 180 that continue at the other end.
        each: what each of its numbers is of, where the channel has names for them.
        summed: of each module the sum of its numbers is shown.
    """

    title: str
    unit: str
    scale: float = 1.0
    command: str = ""
    low: float | None = None
    high: float | None = None
    span: float = 0.0
    wraps: bool = False
    each: str = ""
    summed: bool = False

    def label(self, module: int | None = None) -> str:
        """Title, with the number of one module from 1, and unit."""
        title = self.title if module is None else f"{self.title}, module {module}"
        return title if self.unit in ("", "1", "code") else f"{title} [{self.unit}]"


@dataclass(frozen=True)
class Channel:
    """One measured quantity.

    Attributes:
        name: of the array, in Python and in files.
        shape: of one sample of one robot. The first axis is of the robot's modules, its alike parts
            numbered from 1, where it has any.
        unit: SI; "1" for numbers without one, "code" for an index.
        meaning: one line for the docs and for the file's metadata.
        frame: that vectors are expressed in; empty where the quantity has none.
        source: "plant" is read by a sensor, "route" follows from the pose and the route, "command"
            is what the controller asked for, "leg" is where the robot is in its mission, "estimate"
            is what the robot takes itself to be.
        tail_first: how a robot that drives tail first sees the quantity, so that it may take itself
            for one that drives nose first. Its frame is then turned by 180 degrees about x:
            "swapped" exchanges modules 2 and 3 of three that stand around its axis, module 1 on x,
            "negated" changes the sign and, where there is a value a module, exchanges them too,
            "turned" changes the sign of a vector's y and z, "facing" those columns of a rotation
            matrix, "behind" multiplies a quaternion by the half turn, "same" leaves all as it is.
        recorded: it stands in the trajectory and its file.
        whole: values are whole numbers.
        names: of the bodies, actuators or such that each of its numbers is of; empty without any.
        shown: appearance; None: by its name and unit.

    Example:
        >>> slide = ot.Channel("slide_rate", (3,), "m/s", "speed of the arms along their shafts")
        >>> slide.columns
        ('slide_rate_1', 'slide_rate_2', 'slide_rate_3')
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    frame: Frame = ""
    source: Source = "plant"
    tail_first: TailFirst = "same"
    recorded: bool = True
    whole: bool = False
    names: tuple[str, ...] = ()
    shown: Display | None = None

    def __post_init__(self) -> None:
        if self.tail_first not in _SHAPES:
            choices = ", ".join(_SHAPES)
            raise ValueError(f"tail_first is {self.tail_first!r} (choose from: {choices})")
        # A shape that cannot be mirrored would fail only when a robot first drives tail first.
        wanted = _SHAPES[self.tail_first]
        if not any(self.shape[: len(shape)] == shape for shape in wanted):
            raise ValueError(f"{self.name}: tail_first {self.tail_first!r} needs shape {wanted}")

    @property
    def display(self) -> Display:
        """Appearance of the channel."""
        if self.shown is not None:
            return self.shown
        title = self.name.replace("_", " ").capitalize()
        if self.unit in ("rad", "rad/s"):
            return Display(title, self.unit.replace("rad", "deg"), DEGREES)
        return Display(title, self.unit)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table, in the order of the flattened sample.

        They end in the names of bodies, actuators and such, where there are any and all differ.
        """
        if self.shape == ():
            return (self.name,)
        if len(set(self.names)) == math.prod(self.shape):
            return tuple(f"{self.name}_{one}" for one in self.names)
        # The last axis varies fastest, as in a flattened sample.
        labels: list[str] = [""]
        for axis, size in enumerate(self.shape):
            inner = _labels(size, axis, self.shape)
            labels = [f"{label}_{item}" for label in labels for item in inner]
        return tuple(self.name + label for label in labels)


def _labels(size: int, axis: int, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Labels along one axis: letters along the last of several, where vectors are, else numbers."""
    # Only the last of several axes has letters: in a channel of shape (3,) the 3 are modules.
    if len(shape) > 1 and axis == len(shape) - 1 and size in (3, 4):
        return ("x", "y", "z") if size == 3 else tuple("wxyz")
    return tuple(str(i + 1) for i in range(size))


@dataclass(frozen=True)
class Vector(Channel):
    """A channel whose three or four numbers are the components of one vector or quaternion."""

    @property
    def columns(self) -> tuple[str, ...]:
        """One column a component: x, y, z, or w, x, y, z."""
        return tuple(f"{self.name}_{axis}" for axis in ("xyz" if self.shape == (3,) else "wxyz"))


@dataclass(frozen=True)
class Labelled(Channel):
    """A channel of a saved run with names of its columns that another class has given it."""

    labels: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """As they stand in the file."""
        return self.labels


def _on_route(name: str, unit: str, meaning: str, shown: Display) -> Channel:
    """A number that follows from the pose and the route."""
    return Channel(name, (), unit, meaning, "route", source="route", shown=shown)


_COMMON = (
    Channel("time", (), "s", "simulated time", recorded=False),
    Vector("position", (3,), "m", "robot centre", "world"),
    Vector(
        "quaternion",
        (4,),
        "1",
        "robot frame in the world, (w, x, y, z); z forward, x towards module 1",
        "world",
        tail_first="behind",
    ),
    Channel(
        "rotation",
        (3, 3),
        "1",
        "the same as a matrix, robot axes as columns",
        "world",
        tail_first="facing",
        recorded=False,
    ),
    Vector(
        "angular_velocity",
        (3,),
        "rad/s",
        "rotation rate of the chassis",
        "robot",
        tail_first="turned",
        recorded=False,
    ),
    Channel(
        "leg",
        (),
        "code",
        "index of the leg at hand, from 0: a way through the pipes, driven in one gear",
        source="leg",
        whole=True,
    ),
    Channel("gear", (), "1", "1: nose first; -1: tail first", source="leg"),
    _on_route(
        "distance",
        "m",
        "arc length of the robot's centre along the centreline of the leg's route",
        Display("Distance along the centreline", "m", span=0.02),
    ),
    _on_route(
        "offset",
        "m",
        "distance of the robot's centre from the centreline",
        Display("Offset from the centreline", "mm", 1e3, low=0.0, span=1.0),
    ),
    _on_route(
        "tilt",
        "rad",
        "angle between the robot axis and the centreline's tangent at the robot's centre",
        Display("Tilt against the centreline", "deg", DEGREES, low=0.0, span=1.0),
    ),
    _on_route(
        "theta5",
        "rad",
        "module 1 from the turning direction of the fitting being passed or next",
        Display("Orientation theta5", "deg", DEGREES, span=10.0, wraps=True),
    ),
    Channel(
        "phase",
        (),
        "code",
        "index into the trajectory's phase names",
        source="command",
        whole=True,
    ),
)
COMMON: dict[str, Channel] = {channel.name: channel for channel in _COMMON}
"""Channels of every robot, in the order of the file."""


def recorded(channels: Iterable[Channel]) -> dict[str, Channel]:
    """Channels of a trajectory, by name."""
    return {channel.name: channel for channel in channels if channel.recorded}
