"""Display of this robot: its looks, its belts where they have run to, the text of films."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.channels import MODULE_COLOURS, TRACKS
from omnitrack_sim.record.display import (
    FORCES,
    Bar,
    CarriedCamera,
    ForceArrow,
    Lines,
    PageDisplay,
    RobotDisplay,
    StatusText,
    Track,
)
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.omnitrack import MODULES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.control.alignment import orientation_error, preferred_theta5
from omnitrack_sim.robots.omnitrack.looks import look_pitch
from omnitrack_sim.robots.omnitrack.singularity import safe_margin, sector_angle
from omnitrack_sim.robots.plain_display import LOOKS_AHEAD, lines
from omnitrack_sim.walls.geoms import add_plates, new_spec

FULL_BAR = 0.2
"""Belt speed that fills half of a bar, m/s."""


def looks(
    network: Assembly,
    robot: Omnitrack,
    plates: Sequence[Port] = (),
    coarse: bool = True,
) -> mujoco.MjSpec:
    """The robot, and the plates that close ports of a network, as they are seen: without walls.

    The joints are those of ``track_plant.scene``; ``coarse`` as in ``add_robot_looks``.
    """
    from omnitrack_sim.robots.omnitrack.looks import add_robot_looks

    spec = new_spec("omnitrack_looks")
    add_plates(spec, network, plates, looks=True)
    add_robot(spec, robot)
    add_robot_looks(spec, robot, coarse)
    return spec


def belt_travel(trajectory: Trajectory) -> Array:
    """Travel of each belt since the first sample (T, 3), m: the integral of its recorded speed."""
    # Trapezia: the speed is recorded at the ends of each step.
    speed, step = trajectory["belt_speed"], np.diff(trajectory.time)[:, None]
    run = np.cumsum(step * (speed[1:] + speed[:-1]) / 2, axis=0)
    return np.concatenate([np.zeros((1, speed.shape[1])), run])


def smooth_belts(model: mujoco.MjModel, trajectory: Trajectory, robot: Omnitrack) -> Array:
    """Joint positions (T, nq) with the belts where they have run to: see ``show_belts``."""
    qpos = np.array(trajectory.qpos, float)
    show_belts(model, qpos, belt_travel(trajectory), look_pitch(robot))
    return qpos


def show_belts(model: mujoco.MjModel, qpos: Array, travel: Array, pitch: float) -> None:
    """Put the belts in joint positions (..., nq) where ``travel`` (..., 3) m has brought them,
    within half a visible pitch, m.

    The physics moves its closely spaced lugs back after every pitch; seen 25 times a second they
    would seem to stand still or to run backward.
    """
    shown = (travel + pitch / 2) % pitch - pitch / 2
    for module in range(shown.shape[-1]):
        for track in TRACKS:
            qpos[..., model.joint(f"belt_{track}_{module + 1}").qposadr[0]] = shown[..., module]


def status_text(trajectory: Trajectory, row: int, part: str = "") -> StatusText:
    """Phase, part, time, distance, tilt and belt speeds of sample ``row``; ``part`` is the name of
    the part that the robot's centre is in."""
    text = lines(trajectory, row, part)
    bars = [
        Bar(
            str(module + 1),
            MODULE_COLOURS[module],
            max(-1.0, min(1.0, speed / FULL_BAR)),
            f"{1000 * speed:+z.0f}",
        )
        for module, speed in enumerate(trajectory["belt_speed"][row].tolist())
    ]
    return text._replace(caption="belt speed, mm/s", bars=tuple(bars))


def _casts(geom: str) -> bool:
    # Light between the coils of a spring would be a row of dots.
    return not geom.startswith("look_spring")


def _onboard(robot: Omnitrack) -> CarriedCamera:
    # Nearer to the robot's centre than its tip, which may touch a plate; module 1 is upward.
    place = (0.0, 0.0, robot.scale * 0.066)
    return CarriedCamera("chassis", place, LOOKS_AHEAD, 88.0)


class LiveBelts:
    """Belts of a robot in a window, where they have run to."""

    def __init__(self, model: mujoco.MjModel, robot: Omnitrack) -> None:
        self._model, self._pitch, self.travel = model, look_pitch(robot), np.zeros(MODULES)

    def advance(self, value: Callable[[str], Array], period: float) -> None:
        """See ``LiveLooks``."""
        self.travel += value("belt_speed") * period

    def place(self, qpos: Array) -> None:
        """See ``LiveLooks``."""
        show_belts(self._model, qpos, self.travel, self._pitch)


def region_of(routes: RouteMap, location: Location, reach: float) -> tuple[bool, float] | None:
    """Return whether theta5 lies inside the motion singularity region of the tee turn ahead or at
    hand, and the angle, rad, to the nearest border; None where there is none."""
    number = int(location.passage[0])
    passage = routes.passages[number]
    if passage is None or passage.manoeuvre != "tee_turn":
        return None
    # A right angle, whatever that of the branch: see Aligner.learn.
    margin = float(safe_margin(sector_angle(routes.corner_radius[number], reach, np.pi / 2)))
    error = float(orientation_error(location.theta5[0], preferred_theta5("tee_turn")))
    return abs(error) > margin, abs(abs(error) - margin)


def window_figures(
    value: Callable[[str], Array], routes: RouteMap, location: Location, robot: Omnitrack
) -> Lines:
    """Return what modules 1 to 3 do at the wall, and how the robot is turned."""
    region, text = region_of(routes, location, robot.reach), "no tee turn ahead"
    if region is not None:
        inside, border = region
        text = f"{'INSIDE' if inside else 'outside'}, border at {np.degrees(border):.1f} deg"
    return [
        ("module", _three("{:>6d}", (1, 2, 3))),
        ("slip ratio", _three("{:>z6.2f}", value("slip_ratio"))),
        ("traction, N", _three("{:>z6.1f}", value("traction"))),
        ("normal force, N", _three("{:>z6.1f}", value("normal_force"))),
        ("theta5", f"{np.degrees(location.theta5[0]):z.1f} deg"),
        ("motion singularity", text),
    ]


def _three(form: str, values: Array | tuple[int, int, int]) -> str:
    return " ".join(form.format(value) for value in values)


def _page_onboard(robot: Omnitrack) -> CarriedCamera:
    # Pages show the robot, so the camera stands before its eye.
    return _onboard(robot)._replace(position=(0.0, 0.0, robot.scale * 0.086))


def force_arrows(trajectory: Trajectory, modules: Sequence[Array]) -> list[ForceArrow]:
    """Arrows of the normal force and the traction of each module, of the modules' positions, m, and
    quaternions (T, 7)."""
    arrows = []
    for kind in FORCES:
        for number, poses in enumerate(modules):
            point = trajectory["contact_position"][:, number]
            ahead = matrix_from_quaternion(poses[:, 3:])[:, :, 2]
            inward = poses[:, :3] - point
            inward = inward - (inward * ahead).sum(axis=-1, keepdims=True) * ahead
            length = np.linalg.norm(inward, axis=-1, keepdims=True)
            across = inward / np.where(length > 0, length, 1.0)
            along = across if kind == "normal_force" else ahead
            arrows.append(ForceArrow(kind, point, trajectory[kind][:, number, None] * along))
    return arrows


_MODULES = tuple(f"module_{i + 1}" for i in range(MODULES))
_FIRST = ("belt_speed", "slip_ratio", "traction", "normal_force", "tilt", "theta5")
_PAGE = PageDisplay(
    first=_FIRST,
    plotted=(
        *_FIRST,
        "motor_torque",
        "slip_velocity",
        "roll",
        "slide",
        "pitch",
        "distance",
        "offset",
    ),
    kept=("gear", "contact_count"),
    columns=tuple((f"module {i + 1}", colour) for i, colour in enumerate(MODULE_COLOURS)),
    badges=_MODULES,
    tracks={
        f"track_{track}_{i + 1}": Track(_MODULES[i], f"belt_{track}_{i + 1}", i, side)
        for side, track in enumerate(TRACKS)
        for i in range(MODULES)
    },
    travel=belt_travel,
    pitch=look_pitch,
    arrows=force_arrows,
    state=(("distance", "", 1e3, 0, " mm"), ("tilt", "tilt ", 180 / math.pi, 1, "\u00b0")),
    headline=("distance_m", "mean_speed_m_s", "tilt_max_deg", "slip_ratio_mean", "energy_j"),
    onboard=_page_onboard,
)
DISPLAY = RobotDisplay(
    looks=looks,
    poses=smooth_belts,
    casts=_casts,
    status=status_text,
    onboard=_onboard,
    finite=("position", "distance", "tilt", "belt_speed"),
    summary=(
        (("distance", None), ("belt_speed", 1), ("normal_force", None)),
        (("tilt", None), ("belt_speed", 2), ("contact_count", None)),
        (("offset", None), ("belt_speed", 3), ("slip_velocity", None)),
        (("roll", None), ("motor_torque", None), ("slip_ratio", None)),
        (("pitch", None), ("traction", None), ("slide", None)),
    ),
    page=_PAGE,
    live=LiveBelts,
    figures=window_figures,
)
