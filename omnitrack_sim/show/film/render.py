"""Pictures and films of a recorded run, painted from the saved trajectory."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.arguments import check_time, check_times
from omnitrack_sim.base.writing import check_file
from omnitrack_sim.show.film.encoding import Image, film, film_format
from omnitrack_sim.show.film.limits import check_frames, check_request
from omnitrack_sim.show.film.workers import painted

if TYPE_CHECKING:
    from omnitrack_sim.results.result import Result

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
    processes: int = 1,
) -> Path:
    """Film a run in real time.

    Args:
        result: a ``Result``, or the folder of a saved one.
        path: file to write: ``.mp4``, H.264 that plays while it loads; ``.webm``, VP9; or ``.gif``,
            which repeats. Nothing half-written stays.
        camera: one of ``CAMERAS``.
        width, height: pixels; odd numbers grow by one.
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
    """
    from omnitrack_sim.results.result import as_result

    path = Path(path)
    check_request(camera, width, height, fps, film_format(path), processes)
    check_file(path)
    width, height = width + width % 2, height + height % 2
    result = as_result(result)
    start, end = result.trajectory.time[[0, -1]].tolist()
    count = max(1, int(np.floor((end - start) * fps)) + 1)
    check_frames(count, width, height)
    times = (start + np.arange(count) / fps).tolist()
    options = {"inset": inset, "fine": False}
    with film(path, width, height, fps) as append:
        frames = painted(result, times, (width, height), camera, options, processes)
        for index, frame in enumerate(frames):
            append(frame)
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
        InputError: unknown camera, a size that is out of range, or a time that is NaN.
        TypeError: ``time`` is no number.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
    """
    check_time("time", time)
    return render_frames(result, [time], camera, width, height, inset)[0]


def render_frames(
    result: Result | str | os.PathLike[str],
    times: Sequence[float],
    camera: str = "side",
    width: int = 1280,
    height: int = 720,
    inset: bool = True,
    overlay: bool = True,
) -> list[Image]:
    """Pictures of one run at ``times`` s, as of ``render_frame`` but faster than one by one.

    ``overlay``: with the panel of time, phase and speeds.
    """
    from omnitrack_sim.results.result import as_result

    check_times("times", times)
    check_request(camera, width, height)
    check_frames(len(times), width, height)
    options = {"inset": inset, "overlay": overlay}
    return list(painted(as_result(result), times, (width, height), camera, options))
