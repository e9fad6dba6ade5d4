"""Display of the omnidirectional tracked robot: its looks, tracks, modules and singularity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.display import (
    FORCES,
    MODULE_COLOURS,
    Bar,
    CarriedCamera,
    ForceArrow,
    Lines,
    Moment,
    StatusText,
    Track,
)
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.display import CAMERA_ANGLE_DEG, LOOKS_AHEAD, RobotDisplay
from omnitrack_sim.robots.omnitrack import MODULES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.robots.omnitrack.control.orientation import orientation_error, preferred_theta5
from omnitrack_sim.robots.omnitrack.looks import add_robot_looks, look_pitch
from omnitrack_sim.robots.omnitrack.singularity import safe_margin, sector_angle
from omnitrack_sim.walls.geoms import add_plates, new_spec

FULL_BAR = 0.2
"""Belt speed that fills half of a bar, m/s: twice the cruise speed of the paper."""
CAMERA_AHEAD, PAGE_CAMERA_AHEAD = 0.066, 0.086
"""Distance of the cameras on board from the robot's centre at scale 1, m. That of films is nearer
than the tip, which may touch a plate; pages draw the robot, so theirs stands before its eye."""
_MODULES = tuple(f"module_{i + 1}" for i in range(MODULES))


class TrackDisplay(RobotDisplay):
    """Display of the omnidirectional tracked robot."""

    robot: Omnitrack
    finite: ClassVar = (*RobotDisplay.finite, "belt_speed")
    summary: ClassVar = (
        (("distance", None), ("belt_speed", 1), ("normal_force", None)),
        (("tilt", None), ("belt_speed", 2), ("contact_count", None)),
        (("offset", None), ("belt_speed", 3), ("slip_velocity", None)),
        (("roll", None), ("motor_torque", None), ("slip_ratio", None)),
        (("pitch", None), ("traction", None), ("slide", None)),
    )
    compared: ClassVar = ("normal_force", "motor_torque", "slip_ratio")
    first_plots: ClassVar = (
        *("belt_speed", "slip_ratio", "traction", "normal_force", "tilt", "theta5"),
    )
    plots: ClassVar = (
        *first_plots,
        *("motor_torque", "slip_velocity", "roll", "slide", "pitch", "distance", "offset"),
    )
    unplotted: ClassVar = (
        *("wall_speed", "contact_count", "contact_position"),
        *("belt_speed_command", "roll_command"),
    )
    page_channels: ClassVar = ("gear", "contact_count")
    columns: ClassVar = tuple((f"module {i + 1}", c) for i, c in enumerate(MODULE_COLOURS))
    badges: ClassVar = _MODULES
    headline: ClassVar = (
        *("distance_m", "mean_speed_m_s", "tilt_max_deg", "slip_ratio_mean", "energy_j"),
    )
    tracks: ClassVar = {
        f"track_{track}_{i + 1}": Track(carrier, f"belt_{track}_{i + 1}", i, side)
        for side, track in enumerate(TRACKS)
        for i, carrier in enumerate(_MODULES)
    }
    track_speed: ClassVar = "belt_speed"

    def __init__(self, robot: Omnitrack) -> None:
        super().__init__(robot)
        self.track_pitch = look_pitch(robot)

    def spec(
        self, network: Assembly, plates: Sequence[Port] = (), coarse: bool = True
    ) -> mujoco.MjSpec:
        """See ``RobotDisplay``; the joints are those of ``track_plant.scene``."""
        spec = new_spec("omnitrack_looks")
        add_plates(spec, network, plates, looks=True)
        add_robot(spec, self.robot)
        add_robot_looks(spec, self.robot, coarse)
        return spec

    def casts_shadow(self, geom: str) -> bool:
        """Return whether a geom throws a shadow: springs do not."""
        # Light between the coils of a spring would be a row of dots.
        return not geom.startswith("look_spring")

    @property
    def camera(self) -> CarriedCamera:
        """Camera ahead; module 1 is upward."""
        place = (0.0, 0.0, self.robot.scale * CAMERA_AHEAD)
        return CarriedCamera("chassis", place, LOOKS_AHEAD, CAMERA_ANGLE_DEG)

    @property
    def page_camera(self) -> CarriedCamera:
        """Camera ahead, before the robot's eye."""
        return self.camera._replace(position=(0.0, 0.0, self.robot.scale * PAGE_CAMERA_AHEAD))

    def status(self, moment: Moment) -> StatusText:
        """Return phase, part, time, distance and tilt, with a bar for the speed of each belt."""
        bars = [
            Bar(
                str(module + 1),
                MODULE_COLOURS[module],
                max(-1.0, min(1.0, speed / FULL_BAR)),
                f"{1000 * speed:+z.0f}",
            )
            for module, speed in enumerate(moment.value("belt_speed").tolist())
        ]
        return super().status(moment)._replace(caption="belt speed, mm/s", bars=tuple(bars))

    def measurements(self, moment: Moment, routes: RouteMap, location: Location) -> Lines:
        """Return slip and forces of modules 1 to 3, theta5, and the motion singularity region."""
        region, text = region_of(routes, location, self.robot.reach), "no tee turn ahead"
        if region is not None:
            inside, border = region
            text = f"{'INSIDE' if inside else 'outside'}, border at {np.degrees(border):.1f} deg"
        return [
            ("module", _three("{:>6d}", (1, 2, 3))),
            ("slip ratio", _three("{:>z6.2f}", moment.value("slip_ratio"))),
            ("traction, N", _three("{:>z6.1f}", moment.value("traction"))),
            ("normal force, N", _three("{:>z6.1f}", moment.value("normal_force"))),
            ("theta5", f"{np.degrees(location.theta5[0]):z.1f} deg"),
            ("motion singularity", text),
        ]

    def arrows(self, trajectory: Trajectory, carriers: Sequence[Array]) -> list[ForceArrow]:
        """Return the arrows of the normal force and the traction of each module."""
        arrows = []
        for kind in FORCES:
            for number, poses in enumerate(carriers):
                point = trajectory["contact_position"][:, number]
                ahead = matrix_from_quaternion(poses[:, 3:])[:, :, 2]
                inward = poses[:, :3] - point
                inward = inward - (inward * ahead).sum(axis=-1, keepdims=True) * ahead
                length = np.linalg.norm(inward, axis=-1, keepdims=True)
                across = inward / np.where(length > 0, length, 1.0)
                along = across if kind == "normal_force" else ahead
                arrows.append(ForceArrow(kind, point, trajectory[kind][:, number, None] * along))
        return arrows


def region_of(routes: RouteMap, location: Location, reach: float) -> tuple[bool, float] | None:
    """Return whether theta5 is in the motion singularity region, and the angle to its border.

    Args:
        routes: that the robot drives on.
        location: on them, as of a batch of one.
        reach: maximum reach of the robot, m.

    Returns:
        True inside the region, and the angle to the nearest border, rad, of the tee turn ahead or
        at hand; None where there is none.
    """
    number = int(location.passage[0])
    passage = routes.passages[number]
    if passage is None or passage.manoeuvre != "tee_turn":
        return None
    # A right angle, whatever that of the branch: see Aligner.learn.
    margin = float(safe_margin(sector_angle(routes.corner_radius[number], reach, np.pi / 2)))
    error = float(orientation_error(location.theta5[0], preferred_theta5("tee_turn")))
    return abs(error) > margin, abs(abs(error) - margin)


def _three(form: str, values: Array | tuple[int, int, int]) -> str:
    """Return three values side by side."""
    return " ".join(form.format(value) for value in values)
