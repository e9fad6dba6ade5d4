"""A recorded run: named arrays over time, each with unit, shape and meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TRACKS = ("upper", "lower")
"""Order of the two tracks of a module in channels of shape (3, 2)."""


@dataclass(frozen=True)
class Channel:
    """What one named array holds. ``shape`` is the shape of one sample."""

    shape: tuple[int, ...]
    unit: str
    meaning: str


CHANNELS: Mapping[str, Channel] = {
    "position": Channel((3,), "m", "robot centre, world frame"),
    "quaternion": Channel(
        (4,), "1", "robot frame in the world, (w, x, y, z); z forward, x towards module 1"
    ),
    "leg": Channel(
        (), "code", "index of the leg at hand: a way through the pipes, driven in one gear"
    ),
    "gear": Channel((), "1", "1: nose first; -1: tail first"),
    "distance": Channel(
        (), "m", "arc length of the robot's centre along the centreline of the leg's route"
    ),
    "offset": Channel((), "m", "distance of the robot's centre from the centreline"),
    "tilt": Channel(
        (), "rad", "angle between the robot axis and the centreline's tangent at the robot's centre"
    ),
    "theta5": Channel(
        (), "rad", "module 1 from the turning direction of the fitting being passed or next"
    ),
    "phase": Channel((), "code", "index into the trajectory's phase names"),
    "belt_speed_command": Channel(
        (3,),
        "m/s",
        (
            "belt speed asked of each motor; positive drives forward when the upper track is at "
            "the "
            "wall"
        ),
    ),
    "belt_speed": Channel(
        (3,),
        "m/s",
        "belt speed of each module; positive drives forward when the upper track is at the wall",
    ),
    "wall_speed": Channel(
        (3,),
        "m/s",
        "forward speed of each module that its belt asks for at the wall: belt_speed x belt sign",
    ),
    "motor_torque": Channel(
        (3,), "N m", "torque of each crawler motor at its output shaft, positive drives +belt_speed"
    ),
    "traction": Channel((3,), "N", "wall force on each module along its axis, forward positive"),
    "normal_force": Channel((3,), "N", "wall force on each module towards the robot axis"),
    "slip_velocity": Channel(
        (3,),
        "m/s",
        "belt surface relative to the wall at the contact; positive: the belt runs ahead",
    ),
    "slip_ratio": Channel(
        (3,), "1", "slip_velocity over the larger of belt and module speed, -1 to 1; 0 at rest"
    ),
    "contact_count": Channel(
        (3, 2),
        "1",
        "contact points, per module and track (upper, lower); a lug may touch two wall pieces",
    ),
    "contact_position": Channel(
        (3, 3),
        "m",
        (
            "force-weighted centre of each module's contacts, world frame; its last place when "
            "there "
            "is none"
        ),
    ),
    "slide": Channel((3,), "m", "arm travel from the nominal pipe, outward positive"),
    "pitch": Channel(
        (3,), "rad", "arm pitch; positive: the module's nose points away from the robot axis"
    ),
    "roll": Channel((3,), "rad", "module roll phi about its own axis; 0: upper track at the wall"),
    "roll_command": Channel((3,), "rad", "roll asked of each rotary motor"),
}
"""Every channel of a trajectory, in the order of the file."""


@dataclass(frozen=True)
class Trajectory:
    """One recorded run.

    Attributes:
        time: (T,) s, strictly increasing.
        channels: one array (T, *shape) for each name in ``CHANNELS``.
        phases: names that the codes of ``phase`` index.
        qpos: (T, nq), MuJoCo's joint positions, for the replay.
    """

    time: NDArray[np.float64]
    channels: Mapping[str, NDArray]
    phases: tuple[str, ...]
    qpos: NDArray[np.float64]

    def __post_init__(self) -> None:
        if set(self.channels) != set(CHANNELS):
            raise ValueError(
                f"channels differ from CHANNELS by {set(self.channels) ^ set(CHANNELS)}"
            )
        for name, values in self.channels.items():
            if values.shape != (len(self.time), *CHANNELS[name].shape):
                raise ValueError(
                    f"{name} has shape {values.shape}, expected "
                    f"{(len(self.time), *CHANNELS[name].shape)}"
                )

    def __getitem__(self, name: str) -> NDArray:
        return self.channels[name]

    def __len__(self) -> int:
        return len(self.time)

    def phase_spans(self) -> list[tuple[str, float, float]]:
        """The phases in order: (name, start, end) with times in s."""
        codes = self["phase"]
        return [
            (self.phases[int(codes[a])], float(self.time[a]), float(self.time[b]))
            for a, b in spans(codes)
        ]


def spans(*codes: NDArray) -> list[tuple[int, int]]:
    """First sample of each span in which all codes (T,) stay as they are, and the one after it, or
    the last of all."""
    changed = np.any([np.diff(code) != 0 for code in codes], axis=0)
    starts = np.append(0, np.flatnonzero(changed) + 1)
    ends = np.append(starts[1:], len(codes[0]) - 1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
