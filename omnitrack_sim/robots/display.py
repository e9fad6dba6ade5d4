"""Display of a robot in films, pages, figures and windows; the defaults show any robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.display import (
    CarriedCamera,
    Colour,
    ForceArrow,
    Lines,
    Moment,
    StateValue,
    StatusText,
    Track,
    model_cameras,
)
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.scene import initial_state
from omnitrack_sim.walls.geoms import add_plates, leave_no_log
from omnitrack_sim.walls.pipe_looks import ROBOT_GROUP

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot

HIDDEN_FROM = 3
"""Group of geoms from which on they are not drawn, as in MuJoCo's own viewer."""
OUT_OF_SIGHT = 5
"""Group of what films do not show."""
MAX_BODIES = 6
"""Bodies whose forces the window tells."""
LOOKS_AHEAD = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""Right, up and back of a camera that looks along z with x upward, as columns."""
CAMERA_ANGLE_DEG = 88.0
"""Vertical field of view of cameras on board: the wall is seen from half a bore ahead on."""


class RobotDisplay:
    """Base class of displays: what one robot shows of itself in films, pages, figures and windows.

    The defaults draw the robot's geoms as they are and show what every robot measures. A robot with
    more to show returns its own subclass as ``Robot.display``.

    Attributes:
        robot: whose display it is.
        finite: channels that must be finite in a sample that is shown.
        summary: channel of each panel of the summary figure, row by row, and the module where it
            shows only one.
        compared: channels with a value for each module in the figure of two runs compared.
        plots: channels that have a plot on pages.
        first_plots: those of them that are shown before the reader chooses.
        unplotted: further channels of the robot, which have none.
        page_channels: further channels that pages need.
        columns: name and colour of each column of channels with so many columns.
        badges: bodies that a number in the colour of its column stands on; without ``columns``
            those that touch the wall have one.
        state: values below the phase on pages.
        headline: metrics in the head of pages.
        tracks: by the names of their bodies.
        track_speed: channel of the speeds of tracks, m/s; "" without tracks.
        track_pitch: way after which a track looks the same, m.

    Example:
        >>> scenario = ot.load_scenario("straight", {"robot": "snake"})
        >>> scenario.robot.display.headline[0]
        'distance_m'
    """

    finite: ClassVar[tuple[str, ...]] = ("position", "distance", "tilt")
    summary: ClassVar[tuple[tuple[tuple[str, int | None], ...], ...]] = (
        (("distance", None), ("ctrl", None), ("wall_force", None)),
        (("tilt", None), ("actuator_velocity", None), ("contact_speed", None)),
        (("offset", None), ("actuator_force", None), ("actuator_power", None)),
    )
    compared: ClassVar[tuple[str, ...]] = ()
    first_plots: ClassVar[tuple[str, ...]] = (
        *("wall_force", "contact_speed", "actuator_power", "tilt"),
    )
    plots: ClassVar[tuple[str, ...]] = (
        *first_plots,
        *("ctrl", "actuator_force", "actuator_velocity", "theta5", "distance", "offset"),
    )
    unplotted: ClassVar[tuple[str, ...]] = ()
    page_channels: ClassVar[tuple[str, ...]] = ("gear",)
    columns: ClassVar[tuple[tuple[str, Colour], ...]] = ()
    badges: ClassVar[tuple[str, ...]] = ()
    state: ClassVar[tuple[StateValue, ...]] = (
        ("distance", "", 1e3, 0, " mm"),
        ("tilt", "tilt ", 180 / math.pi, 1, "\u00b0"),
    )
    headline: ClassVar[tuple[str, ...]] = (
        *("distance_m", "mean_speed_m_s", "tilt_max_deg", "wall_force_max_n", "energy_j"),
    )
    tracks: ClassVar[Mapping[str, Track]] = {}
    track_speed: ClassVar[str] = ""
    track_pitch: float = 1.0

    def __init__(self, robot: Robot) -> None:
        self.robot: Any = robot

    # The robot as it is seen

    def spec(
        self, network: Assembly, plates: Sequence[Port] = (), coarse: bool = True
    ) -> mujoco.MjSpec:
        """Return the robot, and the plates that close ports of a network, without walls.

        Args:
            network: pipes, placed in the world.
            plates: ports (part index, port) that are closed.
            coarse: faces may be coarse, which means nothing to geoms as they are.
        """
        leave_no_log()
        spec = self.robot.spec()
        for geom in spec.geoms:
            seen = geom.group < HIDDEN_FROM and geom.rgba[3] > 0
            geom.group = ROBOT_GROUP if seen else OUT_OF_SIGHT
        add_plates(spec, network, plates, looks=True)
        return spec

    def casts_shadow(self, geom: str) -> bool:
        """Return whether a geom of this name throws a shadow."""
        return True

    @property
    def camera(self) -> CarriedCamera:
        """Camera ``onboard`` of films: the robot's first one in the bore, else one at the nose."""
        robot, start = self.robot, initial_state(self.robot)
        for camera in model_cameras(start.model).values():
            carrier = Pose(start.xmat[camera.body].reshape(3, 3), start.xpos[camera.body])
            place = robot.start_frame.inverse().apply(carrier.apply(camera.position))
            # Many models have one that follows them from a few metres away.
            if camera.body and np.hypot(*place[:2]) < robot.nominal_bore / 2:
                return camera._replace(body=start.model.body(camera.body).name)
        place = robot.frame.apply([0.0, 0.0, robot.length / 2])
        x, y, z = (tuple(row) for row in (robot.frame.rotation @ np.array(LOOKS_AHEAD)).tolist())
        return CarriedCamera(robot.chassis, tuple(place.tolist()), (x, y, z), CAMERA_ANGLE_DEG)

    @property
    def page_camera(self) -> CarriedCamera:
        """Camera ``onboard`` of pages, which draw what stands before it, too."""
        return self.camera

    # What is told of a moment

    def status(self, moment: Moment) -> StatusText:
        """Return phase, part, gear, time, distance and tilt."""
        gear = "tail first" if moment.value("gear") < 0 else ""
        part = f"in {' '.join(moment.part.split())}" if moment.part else ""
        distance, tilt = moment.value("distance"), moment.value("tilt")
        move = f"{moment.time:5.2f} s     {1000 * distance:5.0f} mm"
        move += f"     tilt {np.degrees(tilt):.0f}\u00b0"
        phase = moment.phase.replace("_", " ")
        return StatusText(phase, (", ".join(filter(None, (part, gear))), move))

    def measurements(self, moment: Moment, routes: RouteMap, location: Location) -> Lines:
        """Return what is measured at the moment, for the window.

        Here wall force, of all and of the bodies that press hardest, power and tilt.

        Args:
            moment: of the robot.
            routes: that it drives on.
            location: on them, as of a batch of one.
        """
        forces, channel = moment.value("wall_force"), self.robot.channels.get("wall_force")
        names = channel.names if channel else ()  # a recorded robot tells none
        hardest = np.argsort(-forces, kind="stable")[: min(MAX_BODIES, len(names))].tolist()
        bodies = [(f"  {names[i]}", f"{forces[i]:.1f}") for i in hardest if forces[i] > 0]
        return [
            ("wall force, N", f"{forces.sum():.1f}"),
            *bodies,
            ("power, W", f"{np.maximum(moment.value('actuator_power'), 0.0).sum():.2f}"),
            ("tilt", f"{np.degrees(location.tilt[0]):.1f} deg"),
        ]

    def arrows(self, trajectory: Trajectory, carriers: Sequence[Array]) -> list[ForceArrow] | None:
        """Return the arrows of forces on pages; None: those of ``wall_force``, also in films.

        Args:
            trajectory: the record.
            carriers: positions, m, and quaternions (T, 7) of the ``badges``.
        """
        return None

    # Tracks

    def travel(self, trajectory: Trajectory) -> Array:
        """Return the travel of each track since the first sample (T, k), m."""
        if not self.track_speed:
            return np.zeros((len(trajectory.time), 0))
        # Trapezia: the speed is recorded at the ends of each step.
        speed, step = trajectory[self.track_speed], np.diff(trajectory.time)[:, None]
        run = np.cumsum(step * (speed[1:] + speed[:-1]) / 2, axis=0)
        return np.concatenate([np.zeros((1, speed.shape[1])), run])

    def place_tracks(self, model: mujoco.MjModel, qpos: Array, travel: Array) -> None:
        """Put the tracks in joint positions (..., nq) where ``travel`` (..., k) m has brought them.

        They stay within half a pitch. The physics moves closely spaced lugs back after every pitch;
        seen 25 times a second they would seem to stand still or to run backward.
        """
        shown = (travel + self.track_pitch / 2) % self.track_pitch - self.track_pitch / 2
        for track in self.tracks.values():
            qpos[..., model.joint(track.joint).qposadr[0]] = shown[..., track.column]

    def poses(self, model: mujoco.MjModel, trajectory: Trajectory) -> Array:
        """Return the joint positions (T, nq) of a trajectory as they are shown."""
        qpos = np.array(trajectory.qpos, float)
        self.place_tracks(model, qpos, self.travel(trajectory))
        return qpos
