"""Pictures and films of a recorded run. Everything is drawn from the saved trajectory, never while simulating."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.errors import Fault, InputError, OutputError, RenderError

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.sim.result import Result
    from omnitrack_sim.trajectory import Trajectory

CAMERAS = ("side", "follow", "onboard")
"""``side`` shows all pipes, ``follow`` keeps with the robot, ``onboard`` looks ahead from its nose."""
APT_LINE = "sudo apt-get install -y libegl1 libgl1-mesa-dri libopengl0"
"""What headless rendering needs on Debian and Ubuntu."""
Progress = Callable[[float, str], None]
Image = NDArray[np.uint8]


def render_video(
    result: Result | str | os.PathLike[str],
    path: str | os.PathLike[str],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    fps: int = 25,
    progress: Progress | None = None,
) -> Path:
    """Film a run in real time: H.264, yuv420p, playable while it loads. Odd sizes grow by one pixel.

    Args:
        result: a ``Result``, or the folder of a saved one.
        path: MP4 file to write; nothing half-written stays.
        camera: one of ``CAMERAS``.
        width: pixels.
        height: pixels.
        fps: frames a second.
        progress: called with the fraction done (0 to 1) and a text.

    Raises:
        InputError: unknown camera, or a size or frame rate that is not positive.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
        OutputError: the film could not be written.
    """
    _check(camera, width, height, fps)
    width, height = width + width % 2, height + height % 2
    result = _loaded(result)
    trajectory = result.trajectory
    count = max(1, int(np.floor((trajectory.time[-1] - trajectory.time[0]) * fps)) + 1)
    times = trajectory.time[0] + np.arange(count) / fps
    path = Path(path)
    partial = path.with_name(f".{path.stem}.partial.mp4")
    try:
        with _Stage(result, width, height) as stage, _writer(partial, fps) as append:
            for index, time in enumerate(times):
                append(stage.picture(float(time), camera))
                if progress:
                    progress((index + 1) / count, "rendering")
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error}") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def render_frame(
    result: Result | str | os.PathLike[str], time: float, camera: str = "side", width: int = 1280, height: int = 720
) -> Image:
    """One picture (height, width, 3) of a run at ``time`` s, uint8; times outside the run show its nearest end.

    Raises:
        InputError: unknown camera, or a size that is not positive.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
    """
    _check(camera, width, height)
    with _Stage(_loaded(result), width, height) as stage:
        return stage.picture(time, camera)


def render_frames(
    result: Result | str | os.PathLike[str],
    times: Sequence[float],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
) -> list[Image]:
    """Pictures of one run at ``times`` s, as ``render_frame`` makes one; faster than one after the other."""
    _check(camera, width, height)
    with _Stage(_loaded(result), width, height) as stage:
        return [stage.picture(time, camera) for time in times]


class _Stage:
    """A recorded run, ready to be drawn at any time from any camera."""

    def __init__(self, result: Result, width: int, height: int):
        from omnitrack_sim.overlay import Overlay

        self._context, self._mujoco = _open_context(width, height)
        from omnitrack_sim.mjcf.looks import look_pitch
        from omnitrack_sim.sim.setup import scene_of

        mj = self._mujoco
        spec = scene_of(result.scenario, looks=True)
        quality, buffer = spec.visual.quality, spec.visual.global_
        quality.shadowsize, quality.offsamples, quality.numslices, quality.numstacks = 2048, 4, 12, 8
        buffer.offwidth, buffer.offheight = width, height
        self.model = spec.compile()
        self.data = mj.MjData(self.model)
        self.trajectory = result.trajectory
        self._qpos = _smooth_belts(self.model, result.trajectory, look_pitch(result.scenario.robot))
        self._scene = mj.MjvScene(self.model, maxgeom=2000)
        self._gpu = mj.MjrContext(self.model, mj.mjtFontScale.mjFONTSCALE_100)
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._gpu)
        self._area = mj.MjrRect(0, 0, width, height)
        self._pixels = np.zeros((height, width, 3), np.uint8)
        self._overlay = Overlay(width, height)

    def __enter__(self) -> _Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self._gpu.free()
        self._context.free()

    def picture(self, time: float, camera: str) -> Image:
        """The frame (height, width, 3) at ``time`` s with what is known about it written in."""
        mj, model, data = self._mujoco, self.model, self.data
        row = int(np.argmin(np.abs(self.trajectory.time - time)))
        data.qpos[:] = self._qpos[row]
        mj.mj_kinematics(model, data)
        mj.mj_camlight(model, data)
        eye = mj.MjvCamera()
        eye.type = mj.mjtCamera.mjCAMERA_FIXED
        eye.fixedcamid = model.camera(camera).id
        mj.mjv_updateScene(
            model, data, _options(mj, camera), mj.MjvPerturb(), eye, int(mj.mjtCatBit.mjCAT_ALL), self._scene
        )
        mj.mjr_render(self._area, self._scene, self._gpu)
        mj.mjr_readPixels(self._pixels, None, self._area, self._gpu)
        return self._overlay.write(self._pixels[::-1], self.trajectory, row)


def _options(mj: Any, camera: str) -> mujoco.MjvOption:
    """Visual geoms only; the cut-off halves of the pipes close them again around the camera within."""
    options = mj.MjvOption()
    options.geomgroup[:] = [0, 1, 1, 0, camera == "onboard", 0]
    options.sitegroup[:] = 0
    options.flags[int(mj.mjtVisFlag.mjVIS_ACTUATOR)] = 0
    return options


def _smooth_belts(model: mujoco.MjModel, trajectory: Trajectory, pitch: float) -> NDArray[np.float64]:
    """Joint positions (T, nq) with each belt where it has really run to, within +- half a visible pitch.

    The physics moves its closely spaced lugs back after every pitch; seen 25 times a second they would seem to stand
    still or to run backward. The belt travel is the integral of the recorded belt speed.
    """
    qpos = np.array(trajectory.qpos, float)
    speed = trajectory["belt_speed"]
    step = np.diff(trajectory.time)[:, None]
    travel = np.concatenate([np.zeros((1, 3)), np.cumsum(step * (speed[1:] + speed[:-1]) / 2, axis=0)])
    shown = (travel + pitch / 2) % pitch - pitch / 2
    for module in range(3):
        for track in ("upper", "lower"):
            qpos[:, model.joint(f"belt_{track}_{module + 1}").qposadr[0]] = shown[:, module]
    return qpos


def _open_context(width: int, height: int) -> tuple[Any, Any]:
    """A current offscreen OpenGL context and the mujoco module: MUJOCO_GL if set, else EGL, else OSMesa."""
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
        except Exception as error:  # OpenGL loaders raise anything: ImportError, AttributeError, RuntimeError, GLError
            reasons.append(f"{backend}: {error}")
    raise RenderError(f"no offscreen OpenGL ({'; '.join(reasons)}). On Debian or Ubuntu: {APT_LINE}")


@contextlib.contextmanager
def _writer(path: Path, fps: int) -> Iterator[Callable[[Image], None]]:
    """Frames into an MP4 file, the index at the front."""
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream: Any = None

        def append(image: Image) -> None:
            nonlocal stream
            if stream is None:
                stream = container.add_stream("libx264", rate=fps, options={"crf": "20", "preset": "veryfast"})
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = "yuv420p"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))

        yield append
        if stream is not None:
            container.mux(stream.encode())


def _loaded(result: Result | str | os.PathLike[str]) -> Result:
    if isinstance(result, (str, os.PathLike)):
        from omnitrack_sim.sim.result import load_result

        return load_result(Path(result))
    return result


def _check(camera: str, width: int, height: int, fps: int = 1) -> None:
    faults = [] if camera in CAMERAS else [Fault("camera", f"there is no camera {camera!r}", CAMERAS)]
    sizes = {"width": width, "height": height, "fps": fps}
    faults += [Fault(name, f"must be positive, is {value}") for name, value in sizes.items() if value <= 0]
    if faults:
        raise InputError(faults)
