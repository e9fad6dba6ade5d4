"""Channels of the robot: what its belts, modules and arms add to those of every robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from omnitrack_sim.record.channels import COMMON, DEGREES, Channel, Display, TailFirst, recorded

MODULES = 3
TRACKS = ("upper", "lower")
"""Order of the two tracks of a module in channels of shape (3, 2)."""
FORWARD = "positive drives forward when the upper track is at the wall"


@dataclass(frozen=True)
class OfTracks(Channel):
    """A channel with a number for each track of each module."""

    @property
    def columns(self) -> tuple[str, ...]:
        """One column a track, as in ``contact_count_1_upper``."""
        return tuple(f"{self.name}_{i + 1}_{track}" for i in range(MODULES) for track in TRACKS)


def _of_modules(
    name: str,
    unit: str,
    meaning: str,
    tail_first: TailFirst,
    shown: Display | None = None,
    **more: Any,
) -> Channel:
    """Return a channel with a number for each module."""
    return Channel(name, (MODULES,), unit, meaning, tail_first=tail_first, shown=shown, **more)


_OWN = (
    _of_modules(
        "belt_speed_command",
        "m/s",
        f"belt speed asked of each motor; {FORWARD}",
        "negated",
        Display("Commanded belt speed", "mm/s", 1e3, span=10.0),
        source="command",
    ),
    _of_modules(
        "belt_speed",
        "m/s",
        f"belt speed of each module; {FORWARD}",
        "negated",
        Display("Belt speed", "mm/s", 1e3, command="belt_speed_command", span=10.0),
    ),
    _of_modules(
        "wall_speed",
        "m/s",
        "forward speed of each module that its belt asks for at the wall: belt_speed x belt sign",
        "negated",
        Display("Commanded speed at the wall", "mm/s", 1e3, span=10.0),
    ),
    _of_modules(
        "motor_torque",
        "N m",
        "torque that the motors give each belt's shaft through the gears of the drive; with a "
        "motor for each belt, that motor's; positive drives +belt_speed",
        "negated",
    ),
    _of_modules(
        "traction",
        "N",
        "wall force on each module along its axis, forward positive; on a rim, whose normal leans "
        "along the axis, it may be more than friction times `normal_force`",
        "negated",
        Display("Traction", "N", span=2.0),
    ),
    _of_modules(
        "normal_force",
        "N",
        "sum of the normal forces between wall and lugs, each module",
        "swapped",
        Display("Normal force", "N", low=0.0, span=2.0),
    ),
    _of_modules(
        "slip_velocity",
        "m/s",
        "belt surface relative to the wall at the contact; positive: the belt runs ahead",
        "negated",
        Display("Slip velocity", "mm/s", 1e3),
    ),
    _of_modules(
        "slip_ratio",
        "1",
        "slip_velocity over the larger of belt and module speed, -1 to 1; 0 at rest",
        "negated",
        Display("Slip ratio", "1", low=-1.05, high=1.05),
    ),
    OfTracks(
        "contact_count",
        (MODULES, len(TRACKS)),
        "1",
        "contact points, per module and track (upper, lower); a lug may touch two wall pieces, and "
        "a sprocket's contact is both tracks'",
        tail_first="swapped",
        whole=True,
        shown=Display("Contact points", "1", low=-0.3, summed=True),
    ),
    Channel(
        "contact_position",
        (MODULES, 3),
        "m",
        "force-weighted centre of each module's contacts; its last place when there is none",
        "world",
        tail_first="swapped",
    ),
    _of_modules(
        "module_speed",
        "m/s",
        "speed of each module over the wall at its contact, along its axis",
        "negated",
        recorded=False,
    ),
    _of_modules(
        "slide",
        "m",
        "arm travel from the nominal pipe, outward positive",
        "swapped",
        Display("Arm slide, outward", "mm", 1e3, span=1.0),
    ),
    _of_modules(
        "pitch",
        "rad",
        "arm pitch; positive: the module's nose points away from the robot axis",
        "negated",
        Display("Arm pitch, nose outward", "deg", DEGREES, span=1.0),
    ),
    _of_modules(
        "roll",
        "rad",
        "module roll phi about its own axis; 0: upper track at the wall",
        "negated",
        Display("Module roll", "deg", DEGREES, command="roll_command", span=10.0),
    ),
    _of_modules(
        "roll_command",
        "rad",
        "roll asked of each rotary motor",
        "negated",
        Display("Commanded module roll", "deg", DEGREES, span=10.0),
        source="command",
    ),
)
CHANNELS: Mapping[str, Channel] = COMMON | {channel.name: channel for channel in _OWN}
"""Channels of the robot, in the order of the file."""
RECORDED = recorded(CHANNELS.values())
"""Those of its trajectories."""
