"""Pictures and films of a recorded run, drawn from the saved trajectory."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.errors import Fault, InputError, RenderError
from omnitrack_sim.film.encoding import MOST_GIF_FPS, Image, film, film_format
from omnitrack_sim.film.poses import smooth_belts, sound
from omnitrack_sim.film.viewpoint import DISTANCE, in_the_way, view_directions
from omnitrack_sim.record.timeline import passage_indices
from omnitrack_sim.rotations import unit
from omnitrack_sim.writing import check_file

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.film.inset import Inset
    from omnitrack_sim.pipes import Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.sim.result import Result

CAMERAS = ("side", "follow", "onboard")
"""``side`` shows all pipes, ``follow`` stays with the robot, ``onboard`` looks ahead."""
FOLLOW_SUN = [0.26, 0.25, 0.23]
"""Red, green, blue of the sun for the camera ``follow``.

It is darker than for the other cameras, because it throws no shadows there.
"""
APT_LINE = "sudo apt-get install -y libegl1 libgl1-mesa-dri libopengl0"
"""What headless rendering needs on Debian and Ubuntu."""
MOST_PIXELS = 7680
"""Longest side of a picture."""
MOST_FPS = 240
Progress = Callable[[float, str], None]


def render_video(
    result: Result | str | os.PathLike[str],
    path: str | os.PathLike[str],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    fps: int = 25,
    progress: Progress | None = None,
    inset: bool = True,
) -> Path:
    """Film a run in real time.

    Args:
        result: a ``Result``, or the folder of a saved one.
        path: file to write: ``.mp4``, H.264 that plays while it loads, or ``.gif``, which repeats;
            nothing half-written stays.
        camera: one of ``CAMERAS``.
        width, height: pixels; odd numbers grow by one.
        fps: frames a second, at most 50 of a GIF.
        progress: called with the fraction done (0 to 1) and a text.
        inset: draw a map of the pipes into the pictures of ``follow`` and ``onboard``, if the route
            has more than three fittings.

    Raises:
        InputError: unknown camera or format, or a size or frame rate that is out of range.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
        OutputError: the film cannot be written.
    """
    from omnitrack_sim.sim.loading import as_result

    path = Path(path)
    most = MOST_GIF_FPS if film_format(path) == "gif" else MOST_FPS
    _check(camera, width, height, fps, most)
    check_file(path)
    width, height = width + width % 2, height + height % 2
    result = as_result(result)
    trajectory = result.trajectory
    count = max(1, int(np.floor((trajectory.time[-1] - trajectory.time[0]) * fps)) + 1)
    times = trajectory.time[0] + np.arange(count) / fps
    with (
        _Stage(result, width, height, camera, inset) as stage,
        film(path, width, height, fps) as append,
    ):
        for index, time in enumerate(times):
            append(stage.picture(float(time)))
            if progress:
                progress((index + 1) / count, "rendering")
    return path


def render_frame(
    result: Result | str | os.PathLike[str],
    time: float,
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    inset: bool = True,
) -> Image:
    """One picture (height, width, 3) of a run at ``time`` s, uint8.

    A time before the start or after the end shows the first or the last sample.

    Raises:
        InputError: unknown camera, or a size that is out of range.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
    """
    from omnitrack_sim.sim.loading import as_result

    _check(camera, width, height)
    with _Stage(as_result(result), width, height, camera, inset) as stage:
        return stage.picture(time)


def render_frames(
    result: Result | str | os.PathLike[str],
    times: Sequence[float],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    inset: bool = True,
) -> list[Image]:
    """Pictures of one run at ``times`` s, as of ``render_frame`` but faster than one by one."""
    from omnitrack_sim.sim.loading import as_result

    _check(camera, width, height)
    with _Stage(as_result(result), width, height, camera, inset) as stage:
        return [stage.picture(time) for time in times]


class _Stage:
    """A recorded run, ready to be drawn at any time from one camera."""

    def __init__(self, result: Result, width: int, height: int, camera: str, inset: bool):
        from omnitrack_sim.film.overlay import Overlay

        # The variable MUJOCO_GL is read when mujoco is first imported, so the context comes first.
        self._context, self._mujoco = _open_context(width, height)
        from omnitrack_sim.model.looks import look_pitch

        mj = self._mujoco
        self.camera, routes = camera, result.routes()
        self.model = _compiled(result, camera, width, height)
        self.data = mj.MjData(self.model)
        self.trajectory = sound(result.trajectory)
        self._qpos = smooth_belts(self.model, self.trajectory, look_pitch(result.scenario.robot))
        self._scene = mj.MjvScene(self.model, maxgeom=2000)
        self._gpu = mj.MjrContext(self.model, mj.mjtFontScale.mjFONTSCALE_100)
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._gpu)
        self._area = mj.MjrRect(0, 0, width, height)
        self._pixels = np.zeros((height, width, 3), np.uint8)
        self._overlay = Overlay(width, height)
        self._fittings = _fitting_names(self.trajectory, routes)
        self._inset = _inset(result, width, height) if inset and camera != "side" else None
        if camera == "follow":
            self._prepare_following(routes)

    def _prepare_following(self, routes: Sequence[Route]) -> None:
        """What ``_following`` needs to know of the run."""
        from omnitrack_sim.model.looks import follow_direction

        network = routes[0].network
        self._parts = network.parts
        liking = follow_direction(network)
        self._viewer = view_directions(self.trajectory, routes, liking)  # (T, 3)
        self._inside = [self.model.geom(f"look_inside_{part.name}").id for part in network.parts]
        # The nearer halves of the pipes are not drawn, but they would throw shadows.
        self._scene.flags[int(self._mujoco.mjtRndFlag.mjRND_SHADOW)] = 0

    def __enter__(self) -> _Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self._gpu.free()
        self._context.free()

    def picture(self, time: float) -> Image:
        """The frame (height, width, 3) at ``time`` s, with overlay and map."""
        mj, model, data = self._mujoco, self.model, self.data
        row = int(np.argmin(np.abs(self.trajectory.time - time)))
        data.qpos[:] = self._qpos[row]
        mj.mj_kinematics(model, data)
        mj.mj_camlight(model, data)
        eye = self._following(row) if self.camera == "follow" else mj.MjvCamera()
        if self.camera != "follow":
            eye.type = mj.mjtCamera.mjCAMERA_FIXED
            eye.fixedcamid = model.camera(self.camera).id
        options = _options(mj, self.camera)
        mj.mjv_updateScene(
            model, data, options, mj.MjvPerturb(), eye, int(mj.mjtCatBit.mjCAT_ALL), self._scene
        )
        mj.mjr_render(self._area, self._scene, self._gpu)
        mj.mjr_readPixels(self._pixels, None, self._area, self._gpu)
        frame = self._overlay.write(self._pixels[::-1], self.trajectory, row, self._fittings[row])
        return frame if self._inset is None else self._inset.write(frame, row)

    def _following(self, row: int) -> Any:
        """The camera that stays with the robot.

        Light comes over its shoulder, and pipes between it and the robot become nearly clear.
        """
        mj, model = self._mujoco, self.model
        centre, back = np.array(self.data.qpos[:3]), self._viewer[row]
        nose = self.data.body("chassis").xmat.reshape(3, 3)[:, 2]
        targets = centre + 0.05 * np.array([[0.0], [1.0], [-1.0]]) * nose
        clear = in_the_way(self._parts, centre + DISTANCE * back, targets)
        red, green, blue, _ = model.material("pipe").rgba
        for geom, share in zip(self._inside, clear, strict=True):
            model.geom_rgba[geom] = (red, green, blue, 1 - 0.88 * share)
        right = unit(np.cross([0.0, 0.0, 1.0], back))
        self.data.light_xdir[model.light("sun").id] = -unit(
            back + 0.55 * np.cross(back, right) - 0.40 * right
        )
        eye = mj.MjvCamera()
        eye.type = mj.mjtCamera.mjCAMERA_FREE
        eye.lookat[:] = centre
        eye.distance = DISTANCE
        eye.azimuth = np.degrees(np.arctan2(-back[1], -back[0]))
        eye.elevation = -np.degrees(np.arcsin(np.clip(back[2], -1, 1)))
        return eye


def _compiled(result: Result, camera: str, width: int, height: int) -> mujoco.MjModel:
    """The scene of a run with everything that is only looked at, for pictures of this size."""
    from omnitrack_sim.model.looks import FIELD_OF_VIEW, add_pipe_insides
    from omnitrack_sim.sim.builder import scene_of

    spec = scene_of(result.scenario, looks=True)
    if camera == "follow":
        add_pipe_insides(spec, result.routes()[0].network)
        spec.visual.global_.fovy = FIELD_OF_VIEW
        spec.light("sun").diffuse = FOLLOW_SUN
    quality, buffer = spec.visual.quality, spec.visual.global_
    quality.shadowsize, quality.offsamples = 2048, 4
    quality.numslices, quality.numstacks = 12, 8
    buffer.offwidth, buffer.offheight = width, height
    return spec.compile()


def _inset(result: Result, width: int, height: int) -> Inset | None:
    """The map for the corner of the pictures; None where the run is too short to need one."""
    from omnitrack_sim.film.inset import Inset, needs_map

    routes = result.routes()
    if not needs_map(routes):
        return None
    goals, plates = result.goal_points(), result.plate_rims()
    return Inset(sound(result.trajectory), routes, goals, plates, width, height)


def _fitting_names(trajectory: Trajectory, routes: Sequence[Route]) -> list[str]:
    """For each sample, the name of the part that the robot's centre is in."""
    names = [
        [route.network.parts[passage.index].name for passage in route.fittings] for route in routes
    ]
    legs = trajectory["leg"].astype(int).tolist()
    return [
        names[leg][place]
        for leg, place in zip(legs, passage_indices(trajectory, routes).tolist(), strict=True)
    ]


def _options(mj: Any, camera: str) -> mujoco.MjvOption:
    """Show visual geoms only.

    The fixed cameras look at pipes that are cut open towards one side. Seen from within, the
    cut-off halves close them again. The camera that follows sees the insides of whole pipes
    instead.
    """
    options = mj.MjvOption()
    options.geomgroup[:] = [0, camera != "follow", 1, 0, camera == "onboard", camera == "follow"]
    options.sitegroup[:] = 0
    options.flags[int(mj.mjtVisFlag.mjVIS_ACTUATOR)] = 0
    return options


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


def _check(camera: str, width: int, height: int, fps: int = 1, most: int = 1) -> None:
    faults = (
        [] if camera in CAMERAS else [Fault("camera", f"there is no camera {camera!r}", CAMERAS)]
    )
    sizes = {"width": (width, MOST_PIXELS), "height": (height, MOST_PIXELS), "fps": (fps, most)}
    faults += [
        Fault(name, f"is {value}; must be from 1 to {limit}")
        for name, (value, limit) in sizes.items()
        if not 1 <= value <= limit
    ]
    if faults:
        raise InputError(faults)
