"""Strips: stills of a run side by side, at times that share its way and its turns."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
import PIL.Image
from PIL import ImageDraw

from omnitrack_sim.base.arguments import check_times
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.writing import check_file, format_of, whole_file
from omnitrack_sim.pipes.fittings.base import Fitting
from omnitrack_sim.show.film.encoding import Image
from omnitrack_sim.show.film.overlay import font
from omnitrack_sim.show.film.render import check_request, render_frames
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.sources import Source, cameras_of, playback_of

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

    They go from just before the first fitting that bends, branches, narrows or has relief to just
    after the last; over the whole and evenly where there is none.
    """
    playback = playback_of(source)
    time = playback.time
    first, last = time[[0, -1]].tolist()
    bends = [passage for passage in playback.passages if _is_shown(passage.part.fitting)]
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


def _is_shown(fitting: Fitting) -> bool:
    """Return whether a fitting bends, branches, narrows or has relief."""
    return not fitting.is_plain or bool(fitting.obstacles or fitting.waves)


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
