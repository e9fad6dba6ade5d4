"""A recorded run on a stage: its robot, pipes and light, ready to be seen at any time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.record.timeline import passage_indices
from omnitrack_sim.show.film.poses import smooth_belts, sound

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.base.rotations import Array
    from omnitrack_sim.pipes import Assembly, Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result
    from omnitrack_sim.show.film.cameras import Camera, View
    from omnitrack_sim.show.film.canvas import Image, Region
    from omnitrack_sim.show.film.inset import Inset
    from omnitrack_sim.show.film.painter import Painter

APT_LINE = "sudo apt-get install -y libegl1 libgl1-mesa-dri libopengl0"
"""What headless rendering needs on Debian and Ubuntu."""
_REACH = 1.1  # of the robot about its centre, over what it is at the start


class Stage:
    """A recorded run, to be painted at any time from one camera."""

    def __init__(
        self,
        result: Result,
        size: tuple[int, int],
        camera: str,
        *,
        inset: bool = True,
        fine: bool = True,
        overlay: bool = True,
    ):
        """
        Args:
            result: the run.
            size: width and height of the pictures, pixels.
            camera: one of ``CAMERAS``.
            inset: whether pictures of a long route have a map.
            fine: paint with twice the width and height, and reduce.
            overlay: whether pictures have a panel with time, phase and speeds, and one with what
                the robot's cameras see, where that was recorded.
        """
        # The variable MUJOCO_GL is read when mujoco is first imported, so the context comes first.
        self._context, self._mujoco = _open_context(*size)
        from omnitrack_sim.robots.omnitrack.looks import look_pitch
        from omnitrack_sim.show.film.overlay import Overlay
        from omnitrack_sim.show.film.seen import Seen

        self.trajectory, routes = sound(result.trajectory), result.routes()
        self.model = _compiled(result)
        self.data = self._mujoco.MjData(self.model)
        self._qpos = smooth_belts(self.model, self.trajectory, look_pitch(result.scenario.robot))
        self._pose(0)
        self._camera = self._made(camera, result, size, overlay)
        self._painter = self._prepared(result.pipes, size, fine)
        self._overlay = Overlay(*size) if overlay else None
        self._sight: Seen | None = None
        if overlay and result.album is not None:
            self._sight = Seen(result.album, *size)
        self._fittings = _fitting_names(self.trajectory, routes)
        self._inset = _inset(result, *size) if inset and camera != "side" else None
        self._still: Image | None = None

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.free()

    def row(self, time: float) -> int:
        """The sample nearest to ``time`` s, the earlier one of two."""
        times = self.trajectory.time
        after = int(np.clip(np.searchsorted(times, time), 1, max(1, len(times) - 1)))
        before = after - 1
        if after == len(times) or time - times[before] <= times[after] - time:
            return before
        return after

    def picture(self, time: float) -> Image:
        """The frame (height, width, 3) at ``time`` s, with panel and map."""
        row = self.row(time)
        frame = self._seen(row)
        if self._overlay is not None:
            self._overlay.write(frame, self.trajectory, row, self._fittings[row])
        if self._sight is not None:
            gear = int(self.trajectory["gear"][row])
            self._sight.write(frame, float(self.trajectory.time[row]), gear)
        if self._inset is not None:
            self._inset.write(frame, row)
        return frame

    def _seen(self, row: int) -> Image:
        """The pipes and the robot. Of a camera that stands still, only what the robot and its
        shadow can change is painted anew: the rest is the picture without it."""
        self._pose(row)
        view = self._camera.view(row, *self._chassis())
        if not self._camera.stands:
            return self._painted(view)
        if self._still is None:
            self._still = self._painted(view, robot=False)
        frame = self._still.copy()
        region = self._changed(view)
        if region is None:
            return self._painted(view)
        left, top, width, height = region
        if width > 0 and height > 0:
            part = self._painted(view, region=region)
            frame[top : top + height, left : left + width] = part
        return frame

    def _painted(self, view: View, region: Region | None = None, robot: bool = True) -> Image:
        clearness = [*view.clearness, *self._seams_of(view.clearness)]
        robot = robot and not self._camera.lamp
        return self._painter.paint(view.eye, self._poses(), view.sun, clearness, region, robot)

    def _seams_of(self, clearness: Sequence[float]) -> list[float]:
        """Of each seam: it is seen where both of its parts are seen in full."""
        return [float(min(clearness[i], clearness[j]) == 1) for i, j in self._joined]

    def _changed(self, view: View) -> Region | None:
        """The pixels that robot and shadow can change; None where that cannot be told."""
        from omnitrack_sim.show.film.canvas import Region
        from omnitrack_sim.show.film.painter import MARGIN

        painter, sun = self._painter, view.sun
        assert sun is not None
        centres = self.data.xpos + np.einsum(
            "nij,nj->ni", self.data.xmat.reshape(-1, 3, 3), self._spheres[0]
        )
        centres, radii = centres[self._bodies], self._spheres[1][self._bodies]
        height = (centres - sun.middle) @ sun.towards + radii + sun.reach
        thrown = centres - np.maximum(height, 0.0)[:, None] * sun.towards
        both = np.concatenate([centres, thrown]), np.concatenate([radii, radii])
        box = view.eye.box(*both, painter.width / painter.height)
        if box is None:
            return None
        size = np.array([painter.width, painter.height])
        low = np.clip(np.floor(box[:2] * size).astype(int) - MARGIN, 0, size)
        high = np.clip(np.ceil(box[2:] * size).astype(int) + MARGIN, 0, size)
        return Region(*low.tolist(), *(high - low).tolist())

    def _pose(self, row: int) -> None:
        self.data.qpos[:] = self._qpos[row]
        self._mujoco.mj_kinematics(self.model, self.data)

    def _poses(self) -> NDArray[np.float64]:
        """Rotation and place (bodies, 3, 4) of each body."""
        rotation = self.data.xmat.reshape(-1, 3, 3)
        return np.concatenate([rotation, self.data.xpos[:, :, None]], axis=2)

    def _chassis(self) -> tuple[Array, Array]:
        body = self.data.body("chassis")
        return np.array(body.xpos), np.array(body.xquat)

    def _made(self, camera: str, result: Result, size: tuple[int, int], panel: bool) -> Camera:
        """The camera of this name."""
        from omnitrack_sim.show.film.cameras import PANEL, Follow, Onboard, Side
        from omnitrack_sim.show.film.seen import ROOM
        from omnitrack_sim.show.film.surfaces import body_spheres, robot_surface

        self._robot, routes, aspect = robot_surface(self.model), result.routes(), size[0] / size[1]
        self._spheres = body_spheres(self._robot, self.model.nbody)
        self._bodies = np.flatnonzero(self._spheres[1] > 0)
        self._bodies = self._bodies[self._bodies > 0]  # plates belong to the world
        away = self.data.xpos[self._bodies] - self._chassis()[0]
        reach = np.linalg.norm(away, axis=1) + np.linalg.norm(
            self._spheres[0][self._bodies], axis=1
        )
        reach = _REACH * float((reach + self._spheres[1][self._bodies]).max())
        if camera == "side":
            high = PANEL if result.album is None else ROOM
            covered = high if panel else 0.0
            return Side(self.trajectory, result.pipes, aspect, reach, covered)
        if camera == "follow":
            return Follow(self.trajectory, routes, aspect, reach)
        return Onboard(result.pipes, aspect, result.scenario.robot.scale)

    def _prepared(self, network: Assembly, size: tuple[int, int], fine: bool) -> Painter:
        """The painter with robot, pipes and seams."""
        from omnitrack_sim.show.film.painter import Painter
        from omnitrack_sim.show.film.surfaces import cut_pipe, pipe_inside, robot_surface, seam

        cut = self._camera.cut
        pipes = [cut_pipe(p, cut) if cut.any() else pipe_inside(p) for p in network.parts]
        self._joined = []
        for (i, port), (j, other) in network.joints:
            a, b = network.parts[i], network.parts[j]
            radius = min(a.fitting.port_radius(port), b.fitting.port_radius(other))
            pipes.append(seam(a.port(port), radius, cut))
            self._joined.append((i, j))
        sun, lamp = self._camera.still_sun(), self._camera.lamp
        # Light between the coils of a spring would be a row of dots.
        casting = robot_surface(self.model, without="spring")
        robot = self._robot, casting
        return Painter(*robot, pipes, self.model.nbody, size, fine=fine, lamp=lamp, sun=sun)


def _compiled(result: Result) -> mujoco.MjModel:
    """The robot of a run and the plates in its pipes, as they are seen."""
    from omnitrack_sim.robots.omnitrack.scene import build_looks

    scenario = result.scenario
    return build_looks(result.pipes, scenario.robot, plates=scenario.plates).compile()


def _inset(result: Result, width: int, height: int) -> Inset | None:
    """The map for the corner of the pictures; None where the run is too short to need one."""
    from omnitrack_sim.autonomy.camera_sight import TRUSTED
    from omnitrack_sim.autonomy.sight import RANGE
    from omnitrack_sim.show.film.found import found_at
    from omnitrack_sim.show.film.inset import Inset, needs_map

    routes = result.routes()
    if not needs_map(routes):
        return None
    goals, plates = result.goal_points(), result.plate_rims()
    trajectory, found = sound(result.trajectory), None
    if result.map is not None and result.scenario.exploration is not None:
        robot, by_camera = result.scenario.robot, result.scenario.sensing.kind == "onboard"
        sight = (TRUSTED if by_camera else RANGE) * robot.nominal_bore
        found = found_at(trajectory, routes, robot.length / 2, sight)
    return Inset(trajectory, routes, goals, plates, width, height, found)


def _fitting_names(trajectory: Trajectory, routes: Sequence[Route]) -> list[str]:
    """For each sample, the name of the part that the robot's centre is in."""
    names = [
        [route.network.parts[passage.index].name for passage in route.passages] for route in routes
    ]
    legs = trajectory["leg"].astype(int).tolist()
    return [
        names[leg][place]
        for leg, place in zip(legs, passage_indices(trajectory, routes).tolist(), strict=True)
    ]


def _open_context(width: int, height: int) -> tuple[Any, Any]:
    """A current offscreen OpenGL context, and the mujoco module.

    The variable MUJOCO_GL decides if it is set; otherwise EGL is tried, then OSMesa.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if not wanted and not os.environ.get("DISPLAY"):
        os.environ["MUJOCO_GL"] = "egl"  # read when mujoco is first imported
    reasons = []
    for backend in [wanted] if wanted in ("egl", "osmesa", "glfw") else ["egl", "osmesa"]:
        try:
            import mujoco

            context = import_module(f"mujoco.{backend}").GLContext(width, height)
            context.make_current()
            return context, mujoco
        # OpenGL loaders raise anything: ImportError, AttributeError, RuntimeError, GLError
        except Exception as error:
            reasons.append(f"{backend}: {error}")
    raise RenderError(
        f"no offscreen OpenGL ({'; '.join(reasons)}). On Debian or Ubuntu: {APT_LINE}"
    )
