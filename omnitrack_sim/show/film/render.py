"""Films and single frames of recorded runs."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from omnitrack_sim.base.arguments import check_time, check_times
from omnitrack_sim.base.errors import Fault, InputError, RenderError
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.base.writing import check_file
from omnitrack_sim.record.display import StatusText
from omnitrack_sim.show.film.encoding import Image, film, film_format
from omnitrack_sim.show.film.overlay import (
    MARGIN,
    CameraPanel,
    MapPanel,
    Panel,
    StatusPanel,
)
from omnitrack_sim.show.film.shots import is_outside
from omnitrack_sim.show.film.stage import Stage
from omnitrack_sim.show.playback import STANDARD, Playback
from omnitrack_sim.show.run_playback import CAMERAS
from omnitrack_sim.show.sources import Source, cameras_of, playback_of

MAX_PIXELS = 7680
"""Longest side of a picture, pixels."""
MAX_FPS = 240
MAX_GIF_FPS = 50
"""Players show faster GIFs slower than they are."""
MAX_FILM = 5e11
"""Pixels of all frames of a film: six hours at 1280 x 720 and 25 frames a second, which take
most of a day to paint."""
MAX_PROCESSES = 64


def check_request(
    camera: str,
    width: int,
    height: int,
    fps: int = 1,
    format: str = "",
    processes: int = 1,
    cameras: tuple[str, ...] = CAMERAS,
) -> None:
    """Raise an ``InputError`` with every fault of a request, before any work."""
    faults = []
    if camera not in cameras:
        faults = [Fault("camera", f"there is no camera {camera!r}", cameras, given=str(camera))]
    sizes = {
        "width": (width, MAX_PIXELS),
        "height": (height, MAX_PIXELS),
        "fps": (fps, MAX_GIF_FPS if format == "gif" else MAX_FPS),
        "processes": (processes, MAX_PROCESSES),
    }
    faults += [
        Fault(name, f"is {value}; must be from 1 to {limit}")
        for name, (value, limit) in sizes.items()
        if not 1 <= value <= limit
    ]
    if faults:
        raise InputError(faults)


_AHEAD = 3
"""Pictures for each process that may be under way."""
_stages: list[Stage] = []  # of a worker: the one that it paints, once there is a picture to paint


def check_amount(frames: int, size: tuple[int, int]) -> None:
    """Raise an ``InputError`` if ``frames`` of this size have more than ``MAX_FILM`` pixels."""
    if frames * size[0] * size[1] > MAX_FILM:
        pixels, most = f"{size[0]} x {size[1]} pixels", int(MAX_FILM // (size[0] * size[1]))
        problem = f"are {frames} of {pixels}; at most {most} of this size"
        raise InputError(Fault("frames", problem))


def stage_of(
    playback: Playback,
    size: tuple[int, int],
    camera: str,
    *,
    inset: bool = True,
    fine: bool = True,
    overlay: bool = True,
) -> Stage:
    """Return the stage of a playback with its panels and the arrows of its forces.

    Args:
        playback: that is painted.
        size: width and height of the pictures, pixels.
        camera: one of the playback's.
        inset: pictures of a long route have a map.
        fine: paint with twice the width and height, and reduce.
        overlay: pictures have panels of status and, where recorded, of the robot's cameras.
    """
    panels: list[Panel] = []
    covered, album = 0.0, playback.album
    if overlay:
        panels.append(StatusPanel(_status_of(playback, camera), size))
        if album is not None:
            panels.append(CameraPanel(album, playback, size, panels[-1].top))
        covered = (panels[-1].top + MARGIN) / 720
    if inset and camera != "side" and playback.landmarks is not None:
        panels.append(MapPanel(playback, playback.landmarks, size))
    return Stage(playback, size, camera, panels=panels, covered=covered, fine=fine)


def _status_of(playback: Playback, camera: str) -> Callable[[int], StatusText]:
    """Return the status by sample; it says when a carried camera is outside the pipes."""
    if camera in STANDARD:
        return playback.status
    mount = playback.mounts[camera]
    words = "seen from outside" if is_outside(playback, mount) else "camera has left the pipes"

    def status(row: int) -> StatusText:
        own = playback.status(row)
        outside = is_outside(playback, mount, row)
        return own._replace(title=f"{words}, {own.title}") if outside else own

    return status


def painted(
    playback: Playback,
    times: Sequence[float],
    size: tuple[int, int],
    camera: str,
    options: Mapping[str, Any],
    processes: int = 1,
) -> Iterator[Image]:
    """Yield the pictures (height, width, 3) of a playback.

    Args:
        playback: that is painted.
        times: of the pictures, s.
        size: width and height, pixels.
        camera: one of the playback's.
        options: of ``stage_of``.
        processes: that paint side by side.

    Raises:
        InputError: they have more than ``MAX_FILM`` pixels.
        RenderError: no offscreen OpenGL, or a process died.
    """
    check_amount(len(times), size)
    if processes == 1 or len(times) < 2:
        with stage_of(playback, size, camera, **options) as stage:
            yield from map(stage.picture, times)
        return
    processes, waiting = min(processes, len(times)), deque[Future[Image]]()
    with TemporaryDirectory(prefix="omnitrack-film-") as folder, LocalPool(processes) as pool:
        order = Path(folder) / "order"
        order.write_bytes(pickle.dumps((playback, size, camera, dict(options))))
        try:
            for time in times:
                if len(waiting) == _AHEAD * processes:
                    yield waiting.popleft().result()
                waiting.append(pool.submit(_paint, order, time))
            while waiting:
                yield waiting.popleft().result()
        except BaseException as error:  # as well where no further picture is wanted
            pool.shutdown(wait=False, cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                problem = "a process that painted died; ask for fewer processes"
                raise RenderError(problem) from None
            raise


def _paint(order: Path, time: float) -> Image:
    """Paint one picture in a worker, which keeps its stage."""
    if not _stages:
        # Software OpenGL takes a thread for each processor, and so does each of these processes.
        os.environ.setdefault("LP_NUM_THREADS", "1")
        playback, size, camera, options = pickle.loads(order.read_bytes())
        _stages.append(stage_of(playback, size, camera, **options))
    return _stages[0].picture(time)


Progress = Callable[[float, str], None]


def render_video(
    source: Source,
    *,
    path: str | os.PathLike[str],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    fps: int = 25,
    progress: Progress | None = None,
    inset: bool = True,
    processes: int = 1,
) -> Path:
    """Film a run in real time.

    Args:
        source: a ``Result``, the folder of a saved one, or a ``Recording``.
        path: file to write: ``.mp4``, H.264 that plays while it loads; ``.webm``, VP9; or ``.gif``,
            which repeats. Nothing half-written stays.
        camera: ``side``, ``follow`` or ``onboard``; of a recording also one of its model by name.
        width: pixels; an odd number grows by one.
        height: pixels; an odd number grows by one.
        fps: frames a second, at most 50 of a GIF.
        progress: called with the fraction done (0 to 1) and a text.
        inset: draw a map of the pipes into the pictures of ``follow`` and ``onboard``, if the route
            has more than three fittings.
        processes: that paint. More than one takes less time where there are processors for them;
            the film is the same byte for byte. A script that asks for it has to begin with
            ``if __name__ == "__main__":``, as with all that starts Python processes.

    Raises:
        InputError: unknown camera or format, or a size, frame rate or length that is out of range.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
        OutputError: the film cannot be written.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}), no_load=False)
        >>> ot.render_video(result, path="film.gif", width=160, height=90, fps=10).name
        'film.gif'
    """
    cameras = cameras_of(source)
    check_request(camera, width, height, fps, film_format(Path(path)), processes, cameras)
    check_file(Path(path))
    playback = playback_of(source)
    size = width + width % 2, height + height % 2
    start, end = playback.time[[0, -1]].tolist()
    count = max(1, int(np.floor((end - start) * fps)) + 1)
    times = (start + np.arange(count) / fps).tolist()
    options = {"inset": inset, "fine": False}
    with film(Path(path), *size, fps) as append:
        frames = painted(playback, times, size, camera, options, processes)
        for index, frame in enumerate(frames):
            append(frame)
            if progress:
                progress((index + 1) / count, "rendering")
    return Path(path)


def render_frame(
    source: Source,
    *,
    time: float,
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    inset: bool = True,
    overlay: bool = True,
) -> Image:
    """One picture (height, width, 3) of a run or a recording at ``time`` s, uint8.

    A time before the start or after the end shows the first or the last sample. ``inset`` and
    ``overlay``: with a map, and with the panel of time, phase and speeds.

    Raises:
        InputError: unknown camera, a size that is out of range, or a time that is NaN.
        TypeError: ``time`` is no number.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}), no_load=False)
        >>> ot.render_frame(result, time=0.05, width=160, height=90).shape
        (90, 160, 3)
    """
    check_time("time", time)
    look: dict[str, Any] = {"camera": camera, "inset": inset, "overlay": overlay}
    return render_frames(source, times=[time], width=width, height=height, **look)[0]


def render_frames(
    source: Source,
    *,
    times: Sequence[float],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    inset: bool = True,
    overlay: bool = True,
) -> list[Image]:
    """Pictures of one run at ``times`` s, as of ``render_frame`` but faster than one by one."""
    check_times(times)
    check_request(camera, width, height, cameras=cameras_of(source))
    playback = playback_of(source)
    options = {"inset": inset, "overlay": overlay}
    return list(painted(playback, times, (width, height), camera, options))
