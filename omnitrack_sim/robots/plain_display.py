"""Display of any robot: its geoms as they are, and the text of films."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.display import (
    CarriedCamera,
    Lines,
    PageDisplay,
    RobotDisplay,
    StatusText,
)
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.walls.geoms import add_plates, leave_no_log
from omnitrack_sim.walls.pipe_looks import ROBOT_GROUP

HIDDEN_FROM = 3
"""Group of geoms from which on they are not drawn, as in MuJoCo's own viewer."""
OUT_OF_SIGHT = 5
"""Group of what films do not show."""
LOOKS_AHEAD = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""Right, up and back of a camera that looks along z with x upward, as columns."""


def looks(
    network: Assembly, robot: Robot, plates: Sequence[Port] = (), coarse: bool = True
) -> mujoco.MjSpec:
    """Return a robot, and the plates that close ports of a network, as they are seen.

    Args:
        network: pipes, placed in the world.
        robot: parameters.
        plates: ports (part index, port) that are closed.
        coarse: faces may be coarse, which means nothing to geoms as they are.
    """
    leave_no_log()
    spec = robot.spec()
    for geom in spec.geoms:
        seen = geom.group < HIDDEN_FROM and geom.rgba[3] > 0
        geom.group = ROBOT_GROUP if seen else OUT_OF_SIGHT
    add_plates(spec, network, plates, looks=True)
    return spec


def poses(model: mujoco.MjModel, trajectory: Trajectory, robot: Robot) -> Array:
    """Return the joint positions (T, nq) of a trajectory."""
    return np.array(trajectory.qpos, float)


def lines(trajectory: Trajectory, row: int, part: str) -> StatusText:
    """Return phase, part, time, distance and tilt of sample ``row``; ``part`` is the name of the
    part that the robot's centre is in."""
    phase = trajectory.phases[int(trajectory["phase"][row])].replace("_", " ")
    gear = "tail first" if trajectory["gear"][row] < 0 else ""
    where = ", ".join(filter(None, (part and f"in {' '.join(part.split())}", gear)))
    state = f"{trajectory.time[row]:5.2f} s     {1000 * trajectory['distance'][row]:5.0f} mm"
    state += f"     tilt {np.degrees(trajectory['tilt'][row]):.0f}°"
    return StatusText(phase, (where, state))


def _onboard(robot: Robot) -> CarriedCamera:
    """A camera at the nose."""
    frame = robot.frame
    place = frame.apply([0.0, 0.0, robot.length / 2])
    x, y, z = (tuple(row) for row in (frame.rotation @ np.array(LOOKS_AHEAD)).tolist())
    return CarriedCamera(robot.chassis, tuple(place.tolist()), (x, y, z), 88.0)


class Still:
    """Looks of a robot in a window that has nothing but its joints to move."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self.travel = np.zeros(0)

    def advance(self, value: Callable[[str], Array], period: float) -> None:
        """See ``LiveLooks``."""

    def place(self, qpos: Array) -> None:
        """See ``LiveLooks``."""


def window_figures(
    value: Callable[[str], Array], routes: RouteMap, location: Location, robot: Robot
) -> Lines:
    """Return the force on the wall and the power of all actuators."""
    return [
        ("wall force, N", f"{value('wall_force').sum():.1f}"),
        ("power, W", f"{np.maximum(value('actuator_power'), 0.0).sum():.2f}"),
        ("tilt", f"{np.degrees(location.tilt[0]):.1f} deg"),
    ]


PAGE = PageDisplay(
    first=("wall_force", "contact_speed", "actuator_power", "tilt"),
    plotted=(
        *("wall_force", "contact_speed", "actuator_power", "tilt"),
        *("ctrl", "actuator_force", "actuator_velocity", "theta5", "distance", "offset"),
    ),
    kept=("gear",),
    columns=(),
    badges=(),
    tracks={},
    travel=lambda trajectory: np.zeros((len(trajectory.time), 0)),
    pitch=lambda robot: 1.0,
    arrows=lambda trajectory, carriers: [],
    state=(("distance", "", 1e3, 0, " mm"), ("tilt", "tilt ", 180 / math.pi, 1, "\u00b0")),
    headline=("distance_m", "mean_speed_m_s", "tilt_max_deg", "wall_force_max_n", "energy_j"),
    onboard=_onboard,
)
DISPLAY = RobotDisplay(
    looks=looks,
    poses=poses,
    casts=lambda geom: True,
    status=lines,
    onboard=_onboard,
    finite=("position", "distance", "tilt"),
    summary=(
        (("distance", None), ("ctrl", None), ("wall_force", None)),
        (("tilt", None), ("actuator_velocity", None), ("contact_speed", None)),
        (("offset", None), ("actuator_force", None), ("actuator_power", None)),
    ),
    page=PAGE,
    live=Still,
    figures=window_figures,
)
