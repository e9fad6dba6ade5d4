"""Films, single frames and strips of stills of recorded runs."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from string import ascii_lowercase
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray
from PIL import ImageDraw

from omnitrack_sim.base.arguments import check_time, check_times
from omnitrack_sim.base.errors import Fault, InputError, RenderError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.base.writing import check_file, format_of, whole_file
from omnitrack_sim.show.film.overlay import (
    MARGIN,
    CameraPanel,
    MapPanel,
    Panel,
    StatusPanel,
    font,
)
from omnitrack_sim.show.film.stage import Stage
from omnitrack_sim.show.playback import Playback
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


Image = NDArray[np.uint8]
Append = Callable[[Image], None]
FILM_FORMATS = ("mp4", "webm", "gif")
"""H.264 that plays while it loads, VP9, and animated GIF, which repeats."""
_THREADS = 4


def film_format(path: str | Path) -> str:
    """The format of a film, one of ``FILM_FORMATS``, by the ending of its path."""
    return format_of(path, None, "film", FILM_FORMATS)


@contextmanager
def film(path: str | Path, width: int, height: int, fps: int) -> Iterator[Append]:
    """Return a function that appends frames (height, width, 3) to a film.

    The film is written whole or not at all.

    Args:
        path: of the film; its ending is one of ``FILM_FORMATS``.
        width: pixels, even.
        height: pixels, even.
        fps: frames a second.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    import imageio.v3

    imopen: Any = imageio.v3.imopen  # its types know no names of plugins
    format = film_format(path)
    # Without bitexact a WebM would be given a number of its own each time.
    options = {"mp4": {"movflags": "faststart"}, "webm": {"fflags": "+bitexact"}}.get(format, {})
    with (
        whole_file(path) as part,
        imopen(
            part, "w", plugin="pyav", extension=f".{format}", container=format, options=options
        ) as file,
    ):
        if format == "gif":
            _begin_gif(file, width, height, fps)
        else:
            _begin_stream(file, format, fps)
        yield file.write_frame


# imageio has no parameter for the encoder's options. Its own take three times as long; a plain
# search takes a third less than that of the preset. x264 must not look ahead: its macroblock tree,
# which needs that, reads memory that nobody has written, and the file would have other bytes now
# and then. Without the tree CRF 25 is as sharp as 20 with it, in 8 % more bytes.
_X264 = "subme=1:me=dia:weightp=0:bframes=1:b-adapt=0:no-mbtree=1:rc-lookahead=0:scenecut=0"
_ENCODERS = {
    "mp4": ("libx264", {"crf": "25", "preset": "veryfast", "x264-params": _X264}),
    "webm": (
        "libvpx-vp9",
        {"crf": "32", "deadline": "realtime", "cpu-used": "6", "row-mt": "1"},
    ),
}


def _begin_stream(file: Any, format: str, fps: int) -> None:
    codec, options = _ENCODERS[format]
    file.init_video_stream(codec, fps=fps, pixel_format="yuv420p")
    stream = file._video_stream
    stream.options = options
    if format == "webm":
        stream.bit_rate = 0  # constant quality, which "crf" says
    # The bytes of a film follow from the number of threads, which would else be that of the
    # processors. Whole frames side by side: slices of one frame would be a larger file.
    stream.codec_context.thread_count = _THREADS
    stream.codec_context.thread_type = "FRAME"


def _begin_gif(file: Any, width: int, height: int, fps: int) -> None:
    """Each frame gets the 256 colours that suit it; frames are not kept in memory."""
    file.init_video_stream("gif", fps=fps, pixel_format="rgb24")
    stream = file._video_stream  # what the filters take in; without a size they cannot begin
    stream.width, stream.height = width, height
    nodes = {"both": ("split", ""), "colours": ("palettegen", "stats_mode=single")}
    nodes["coloured"] = ("paletteuse", "new=1")
    edges = [
        ("video_in", "both", 0, 0),
        ("both", "coloured", 0, 0),
        ("both", "colours", 1, 0),
        ("colours", "coloured", 0, 1),
        ("coloured", "video_out", 0, 0),
    ]
    file.set_video_filter(filter_graph=(nodes, edges))
    stream.pix_fmt = "pal8"  # what they give


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
        panels.append(StatusPanel(playback.status, size))
        if album is not None:
            panels.append(CameraPanel(album, playback, size, panels[-1].top))
        covered = (panels[-1].top + MARGIN) / 720
    if inset and camera != "side" and playback.landmarks is not None:
        panels.append(MapPanel(playback, playback.landmarks, size))
    return Stage(playback, size, camera, panels=panels, covered=covered, fine=fine)


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


STRIP_FORMATS = ("png", "jpg", "jpeg", "pdf")
FRAMES, MAX_FRAMES = 6, len(ascii_lowercase)
BEFORE = 0.3
"""Time before the first fitting, and after the last, at which the stills begin and end, s."""
TURN, STANDING = 4.0, 0.2
"""Way that counts as much as a turn of 1 rad, in bore radii, and weight of time beside way and
turns: a robot that turns in a tee goes less far, and is seen as often as one that drives."""
_PAPER, _INK, _SOFT = (255, 255, 255), (34, 38, 43), (106, 112, 121)
_DPI = 200.0  # of a PDF: six stills of 640 pixels are 25 cm wide, in two rows


def render_strip(
    source: Source,
    *,
    path: str | os.PathLike[str],
    count: int = FRAMES,
    times: Sequence[float] | None = None,
    camera: str = "side",
    width: int = 640,
    height: int = 480,
) -> Path:
    """Stills of a run side by side in one picture, each with its letter and time.

    Args:
        source: a ``Result``, the folder of a saved one, or a ``Recording``.
        path: file to write: ``.png``, ``.jpg`` or ``.pdf``; nothing half-written stays.
        count: how many stills, at most 26, if ``times`` are not given.
        times: of the stills, s; ``strip_times`` when not given.
        camera: ``side``, ``follow`` or ``onboard``; of a recording also one of its model by name.
        width: of each still, pixels.
        height: of each still, pixels.

    Raises:
        InputError: unknown camera or format, a size or number that is out of range, or a time
            outside of the run.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
        OutputError: the picture cannot be written.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}), no_load=False)
        >>> ot.render_strip(result, path="strip.png", count=2, width=160, height=120).name
        'strip.png'
    """
    check_request(camera, width, height, cameras=cameras_of(source))
    format = format_of(path, None, "picture", STRIP_FORMATS)
    if times is not None:
        check_times(times)
    number = count if times is None else len(times)
    if not 1 <= number <= MAX_FRAMES:
        place = "count" if times is None else "times"
        raise InputError(Fault(place, f"are {number} stills; must be from 1 to {MAX_FRAMES}"))
    check_file(Path(path))
    playback = playback_of(source)
    times = strip_times(playback, count) if times is None else _within(playback.time, times)
    look: dict[str, Any] = {"camera": camera, "inset": False, "overlay": False}
    stills = render_frames(playback, times=times, width=width, height=height, **look)
    kinds = {"jpg": "JPEG", "jpeg": "JPEG", "png": "PNG", "pdf": "PDF"}
    # Without date and name of the file, the same run gives the same bytes.
    options: dict[str, Any] = {"quality": 92} if format != "png" else {"optimize": True}
    if format == "pdf":
        options |= {"resolution": _DPI, "title": None, "creationDate": None, "modDate": None}
    with whole_file(Path(path)) as part, part.open("wb") as file:
        composed(stills, times).save(file, kinds[format], **options)
    return Path(path)


def strip_times(source: Source, count: int = FRAMES) -> list[float]:
    """Return times, s, with equal shares of the way and the turns of the robot between them.

    They go from just before the first fitting that bends, branches or narrows to just after the
    last; over the whole and evenly where there is none.
    """
    playback = playback_of(source)
    time = playback.time
    first, last = time[[0, -1]].tolist()
    bends = [passage for passage in playback.passages if not passage.part.fitting.is_plain]
    if bends:
        first = max(first, float(time[bends[0].first]) - BEFORE)
        last = min(last, float(time[bends[-1].last]) + BEFORE)
    if not bends or not last > first:
        return np.linspace(first, last, count).tolist()
    within = (time > first) & (time < last)
    when = np.concatenate([[first], time[within], [last]])
    shares = _shares(playback, when)
    times = np.interp(np.linspace(0.0, shares[-1], count), shares, when)
    return [first, *times[1:-1].tolist(), last][:count]


def _shares(playback: Playback, when: Array) -> Array:
    """Return way and turns of a robot up to ``when`` (k,) s, strictly increasing (k,)."""
    columns = np.concatenate([playback.position, playback.ahead], axis=1)
    poses = np.stack([np.interp(when, playback.time, column) for column in columns.T], axis=1)
    way, turn = (np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (poses[:, :3], poses[:, 3:]))
    steps = np.nan_to_num(way + TURN * playback.network.parts[0].fitting.radius * turn)
    # A robot that stands still is shown, too, but less often.
    steps = steps / (steps.sum() or 1.0) + STANDING * np.diff(when) / (when[-1] - when[0])
    return np.append(0.0, np.cumsum(steps))


def label(index: int) -> str:
    """The letter of a still: (a) for the first."""
    return f"({ascii_lowercase[index]})"


def composed(stills: Sequence[Image], times: Sequence[float]) -> PIL.Image.Image:
    """Return one picture of stills (height, width, 3), each over its letter and time in s.

    Rows have at most three, or four if they fill them.
    """
    height, width, _ = stills[0].shape
    columns = next((n for n in (3, 4) if len(stills) % n == 0), min(3, len(stills)))
    gap, line = max(2, round(0.02 * width)), round(0.085 * height)
    rows = -(-len(stills) // columns)
    size = (columns * (width + gap) + gap, rows * (height + line + gap) + gap)
    sheet = PIL.Image.new("RGB", size, _PAPER)
    draw, letters = ImageDraw.Draw(sheet), font(max(1, round(0.6 * line)))
    for index, (still, time) in enumerate(zip(stills, times, strict=True)):
        left = gap + index % columns * (width + gap)
        top = gap + index // columns * (height + line + gap)
        sheet.paste(PIL.Image.fromarray(still), (left, top))
        middle = left + width // 2, top + height + line // 2
        draw.text(middle, f"{label(index)}  ", font=letters, fill=_INK, anchor="rm")
        draw.text(middle, f"{time:.2f} s", font=letters, fill=_SOFT, anchor="lm")
    return sheet


def _within(span: Array, times: Sequence[float]) -> list[float]:
    """Return times, s, that lie within samples at ``span`` (T,) s."""
    first, last = span[[0, -1]].tolist()
    faults = [
        Fault(f"times[{i}]", f"is {time:g} s; the run goes from {first:g} to {last:g} s")
        for i, time in enumerate(times)
        if not first <= time <= last
    ]
    if faults:
        raise InputError(faults)
    return [float(time) for time in times]
