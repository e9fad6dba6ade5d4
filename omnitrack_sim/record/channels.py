"""Schema of measured quantities.

It is the single source of plant, observation, mirror, recorder, files and the table in
docs/reference/channels.md.

A new quantity of the shipped sensors is one entry here and one function in ``senses.sensor``. A
user's own sensor brings its ``Channel`` with it and needs no edit (docs/how-to/extending.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

TRACKS = ("upper", "lower")
"""Order of the two tracks of a module in channels of shape (3, 2)."""
MODULE_COUNT = 3
MODULE_COLOURS = ((0.95, 0.55, 0.05), (0.10, 0.45, 0.80), (0.05, 0.62, 0.42))
"""Red, green, blue of modules 1, 2, 3 on the robot and in every curve: told apart with any colour
vision (after Okabe and Ito)."""
Frame = Literal["", "world", "robot", "route"]
TailFirst = Literal["same", "swapped", "negated", "turned", "facing", "behind"]
Source = Literal["plant", "route", "command", "leg", "estimate"]


_SHAPES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "same": ((),),
    "swapped": ((MODULE_COUNT,),),
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

    def label(self, module: int | None = None) -> str:
        """Title, with the number of one module (1 to 3), and unit."""
        title = self.title if module is None else f"{self.title}, module {module}"
        return title if self.unit in ("", "1", "code") else f"{title} [{self.unit}]"


class SingularRange(NamedTuple):
    """Range of orientations in which a robot cannot turn.

    Attributes:
        sector_deg: its width by the theory, degrees.
        margin_deg: from the best orientation to the range with the real length of the contact,
            degrees; None where that leaves none.
    """

    sector_deg: float
    margin_deg: float | None


@dataclass(frozen=True)
class Channel:
    """One measured quantity.

    Attributes:
        name: of the array, in Python and in files.
        shape: of one sample of one robot; modules come first.
        unit: SI; "1" for numbers without one, "code" for an index.
        meaning: one line for the docs and for the file's metadata.
        frame: that vectors are expressed in; empty where the quantity has none.
        source: "plant" is read by a sensor, "route" follows from the pose and the route, "command"
            is what the controller asked for, "leg" is where the robot is in its mission, "estimate"
            is what the robot takes itself to be.
        tail_first: how a robot that drives tail first sees the quantity, so that it may take itself
            for one that drives nose first. Its frame is then turned by 180 degrees about x:
            "swapped" exchanges modules 2 and 3, "negated" changes the sign and, where there is a
            value a module, exchanges them too,
            "turned" changes the sign of a vector's y and z, "facing" those columns of a rotation
            matrix, "behind" multiplies a quaternion by the half turn, "same" leaves all as it is.
        recorded: it stands in the trajectory and its file.
        whole: values are whole numbers.
        names: of the bodies, actuators or such that each of its numbers is of; empty without any.

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
        """Appearance of the channel; of a user's own channel by its name and unit."""
        known = DISPLAYS.get(self.name)
        if known is not None:
            return known
        title = self.name.replace("_", " ").capitalize()
        if self.unit in ("rad", "rad/s"):
            return Display(title, self.unit.replace("rad", "deg"), _DEG)
        return Display(title, self.unit)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table, in the order of the flattened sample."""
        if self.shape == ():
            return (self.name,)
        # The last axis varies fastest, as in a flattened sample.
        labels: list[str] = [""]
        for axis, size in enumerate(self.shape):
            inner = _labels(size, axis, self.shape)
            labels = [f"{label}_{item}" for label in labels for item in inner]
        return tuple(self.name + label for label in labels)


def _labels(size: int, axis: int, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Labels along one axis: numbers from 1 for modules, letters for vectors, names for tracks."""
    # Only the last of several axes has names: in a channel of shape (3,) the 3 are modules.
    if len(shape) > 1 and axis == len(shape) - 1:
        named: Mapping[int, tuple[str, ...]] = {2: TRACKS, 3: ("x", "y", "z"), 4: tuple("wxyz")}
        return named.get(size, tuple(str(i + 1) for i in range(size)))
    return tuple(str(i + 1) for i in range(size))


@dataclass(frozen=True)
class Vector(Channel):
    """A channel whose three or four numbers are the components of one vector or quaternion."""

    @property
    def columns(self) -> tuple[str, ...]:
        """One column a component: x, y, z, or w, x, y, z."""
        return tuple(f"{self.name}_{axis}" for axis in ("xyz" if self.shape == (3,) else "wxyz"))


_FORWARD = "positive drives forward when the upper track is at the wall"


def _of_module(name: str, unit: str, meaning: str, tail_first: TailFirst, **more: Any) -> Channel:
    """A number of each module."""
    return Channel(name, (MODULE_COUNT,), unit, meaning, tail_first=tail_first, **more)


def _on_route(name: str, unit: str, meaning: str) -> Channel:
    """A number that follows from the pose and the route."""
    return Channel(name, (), unit, meaning, "route", source="route")


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
    ),
    _on_route("offset", "m", "distance of the robot's centre from the centreline"),
    _on_route(
        "tilt",
        "rad",
        "angle between the robot axis and the centreline's tangent at the robot's centre",
    ),
    _on_route(
        "theta5",
        "rad",
        "module 1 from the turning direction of the fitting being passed or next",
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
COMMON: Mapping[str, Channel] = {channel.name: channel for channel in _COMMON}
"""Channels of every robot, in the order of the file."""
_SHIPPED = (
    *_COMMON,
    _of_module(
        "belt_speed_command",
        "m/s",
        f"belt speed asked of each motor; {_FORWARD}",
        "negated",
        source="command",
    ),
    _of_module("belt_speed", "m/s", f"belt speed of each module; {_FORWARD}", "negated"),
    _of_module(
        "wall_speed",
        "m/s",
        "forward speed of each module that its belt asks for at the wall: belt_speed x belt sign",
        "negated",
    ),
    _of_module(
        "motor_torque",
        "N m",
        "torque that the motors give each belt's shaft through the gears of the drive; with a "
        "motor for each belt, that motor's; positive drives +belt_speed",
        "negated",
    ),
    _of_module(
        "traction",
        "N",
        "wall force on each module along its axis, forward positive; on a rim, whose normal leans "
        "along the axis, it may be more than friction times `normal_force`",
        "negated",
    ),
    _of_module(
        "normal_force",
        "N",
        "sum of the normal forces between wall and lugs, each module",
        "swapped",
    ),
    _of_module(
        "slip_velocity",
        "m/s",
        "belt surface relative to the wall at the contact; positive: the belt runs ahead",
        "negated",
    ),
    _of_module(
        "slip_ratio",
        "1",
        "slip_velocity over the larger of belt and module speed, -1 to 1; 0 at rest",
        "negated",
    ),
    Channel(
        "contact_count",
        (3, 2),
        "1",
        "contact points, per module and track (upper, lower); a lug may touch two wall pieces, and "
        "a sprocket's contact is both tracks'",
        tail_first="swapped",
        whole=True,
    ),
    Channel(
        "contact_position",
        (3, 3),
        "m",
        "force-weighted centre of each module's contacts; its last place when there is none",
        "world",
        tail_first="swapped",
    ),
    _of_module(
        "module_speed",
        "m/s",
        "speed of each module over the wall at its contact, along its axis",
        "negated",
        recorded=False,
    ),
    _of_module("slide", "m", "arm travel from the nominal pipe, outward positive", "swapped"),
    _of_module(
        "pitch",
        "rad",
        "arm pitch; positive: the module's nose points away from the robot axis",
        "negated",
    ),
    _of_module(
        "roll", "rad", "module roll phi about its own axis; 0: upper track at the wall", "negated"
    ),
    _of_module(
        "roll_command", "rad", "roll asked of each rotary motor", "negated", source="command"
    ),
)
CHANNELS: Mapping[str, Channel] = {channel.name: channel for channel in _SHIPPED}
"""Channels of a robot with three modules of two tracks each, in the order of the file."""

_MM, _DEG = 1e3, 180.0 / math.pi
DISPLAYS: Mapping[str, Display] = {
    "distance": Display("Distance along the centreline", "m", span=0.02),
    "tilt": Display("Tilt against the centreline", "deg", _DEG, low=0.0, span=1.0),
    "offset": Display("Offset from the centreline", "mm", _MM, low=0.0, span=1.0),
    "theta5": Display("Orientation theta5", "deg", _DEG, span=10.0, wraps=True),
    "belt_speed": Display("Belt speed", "mm/s", _MM, command="belt_speed_command", span=10.0),
    "belt_speed_command": Display("Commanded belt speed", "mm/s", _MM, span=10.0),
    "wall_speed": Display("Commanded speed at the wall", "mm/s", _MM, span=10.0),
    "motor_torque": Display("Motor torque", "N m"),
    "traction": Display("Traction", "N", span=2.0),
    "normal_force": Display("Normal force", "N", low=0.0, span=2.0),
    "slip_velocity": Display("Slip velocity", "mm/s", _MM),
    "slip_ratio": Display("Slip ratio", "1", low=-1.05, high=1.05),
    "contact_count": Display("Contact points", "1", low=-0.3),
    "ctrl": Display("Control inputs", "1", span=0.02, each="actuator"),
    "actuator_force": Display("Actuator force", "N, N m", span=0.02, each="actuator"),
    "actuator_velocity": Display("Actuator velocity", "m/s, rad/s", span=0.02, each="actuator"),
    "actuator_power": Display("Actuator power", "W", span=0.02, each="actuator"),
    "wall_force": Display("Force on the wall, by body", "N", low=0.0, span=2.0, each="body"),
    "contact_speed": Display("Slip speed at contacts", "mm/s", _MM, low=0.0, span=1.0, each="body"),
    "slide": Display("Arm slide, outward", "mm", _MM, span=1.0),
    "pitch": Display("Arm pitch, nose outward", "deg", _DEG, span=1.0),
    "roll": Display("Module roll", "deg", _DEG, command="roll_command", span=10.0),
    "roll_command": Display("Commanded module roll", "deg", _DEG, span=10.0),
}
"""The shipped channels that have a title, a unit or limits of their own, by name."""


def recorded(channels: Iterable[Channel]) -> dict[str, Channel]:
    """Channels of a trajectory, by name."""
    return {channel.name: channel for channel in channels if channel.recorded}
