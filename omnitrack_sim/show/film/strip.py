"""A sequence of stills in one picture, labelled (a), (b), (c), as papers show manoeuvres."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw

from omnitrack_sim.base.arguments import check_times
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.writing import check_file, format_of, whole_file
from omnitrack_sim.show.film.encoding import Image
from omnitrack_sim.show.film.limits import check_request
from omnitrack_sim.show.film.overlay import font
from omnitrack_sim.show.film.render import render_frames

if TYPE_CHECKING:
    from omnitrack_sim.results.result import Result

FORMATS = ("png", "jpg", "jpeg", "pdf")
FRAMES, MOST_FRAMES = 6, len(ascii_lowercase)
BEFORE = 0.3
"""How long before the first fitting, and after the last, the stills begin and end, s."""
_PAPER, _INK, _SOFT = (255, 255, 255), (34, 38, 43), (106, 112, 121)
_DPI = 200.0  # of a PDF: six stills of 640 pixels are 25 cm wide, in two rows


def render_strip(
    result: Result | str | os.PathLike[str],
    path: str | os.PathLike[str],
    count: int = FRAMES,
    *,
    times: Sequence[float] | None = None,
    camera: str = "side",
    width: int = 640,
    height: int = 480,
) -> Path:
    """Stills of a run side by side in one picture, each with its letter and time.

    Args:
        result: a ``Result``, or the folder of a saved one.
        path: file to write: ``.png``, ``.jpg`` or ``.pdf``; nothing half-written stays.
        count: how many stills, at most 26, if ``times`` are not given.
        times: of the stills, s; ``strip_times`` when not given.
        camera: one of ``CAMERAS``.
        width, height: of each still, pixels.

    Raises:
        InputError: unknown camera or format, a size or number that is out of range, or a time
            outside of the run.
        RenderError: no offscreen OpenGL on this machine; the message says what to install.
        OutputError: the picture cannot be written.
    """
    from omnitrack_sim.results.result import as_result

    path = Path(path)
    format = format_of(path, None, "picture", FORMATS)
    check_request(camera, width, height)
    if times is not None:
        check_times("times", times)
    number = count if times is None else len(times)
    if not 1 <= number <= MOST_FRAMES:
        place = "count" if times is None else "times"
        raise InputError(Fault(place, f"are {number} stills; must be from 1 to {MOST_FRAMES}"))
    check_file(path)
    result = as_result(result)
    times = strip_times(result, count) if times is None else _checked(result, times)
    stills = render_frames(result, times, camera, width, height, inset=False, overlay=False)
    sheet = composed(stills, times)
    kinds = {"jpg": "JPEG", "jpeg": "JPEG", "png": "PNG", "pdf": "PDF"}
    # Without date and name of the file, the same run gives the same bytes.
    options: dict[str, Any] = {"quality": 92} if kinds[format] != "PNG" else {"optimize": True}
    if format == "pdf":
        options |= {"resolution": _DPI, "title": None, "creationDate": None, "modDate": None}
    with whole_file(path) as part, part.open("wb") as file:
        sheet.save(file, kinds[format], **options)
    return path


def strip_times(result: Result, count: int = FRAMES) -> list[float]:
    """Times, s, evenly from just before the first fitting that bends, branches or narrows to just
    after the last; over the whole run where there is none."""
    parts = [
        route.network.parts[passage.index]
        for route in result.routes()
        for passage in route.passages
    ]
    plain = {part.name for part in parts if part.fitting.is_plain}
    visits = [visit for visit in result.timeline() if visit.name not in plain]
    first, last = result.trajectory.time[[0, -1]].tolist()
    if visits:
        leave = visits[-1].time_leave_s
        first = max(first, visits[0].time_enter_s - BEFORE)
        last = last if leave is None else min(last, leave + BEFORE)
    return np.linspace(first, last, count).tolist()


def label(index: int) -> str:
    """The letter of a still: (a) for the first."""
    return f"({ascii_lowercase[index]})"


def composed(stills: Sequence[Image], times: Sequence[float]) -> Picture.Image:
    """One picture of stills (height, width, 3), in rows of at most three, or of four if they fill
    them, each over its letter and time in s."""
    height, width, _ = stills[0].shape
    columns = next((n for n in (3, 4) if len(stills) % n == 0), min(3, len(stills)))
    gap, line = max(2, round(0.02 * width)), round(0.085 * height)
    rows = -(-len(stills) // columns)
    size = (columns * (width + gap) + gap, rows * (height + line + gap) + gap)
    sheet = Picture.new("RGB", size, _PAPER)
    draw, letters = ImageDraw.Draw(sheet), font(max(1, round(0.6 * line)))
    for index, (still, time) in enumerate(zip(stills, times, strict=True)):
        left = gap + index % columns * (width + gap)
        top = gap + index // columns * (height + line + gap)
        sheet.paste(Picture.fromarray(still), (left, top))
        middle = left + width // 2, top + height + line // 2
        draw.text(middle, f"{label(index)}  ", font=letters, fill=_INK, anchor="rm")
        draw.text(middle, f"{time:.2f} s", font=letters, fill=_SOFT, anchor="lm")
    return sheet


def _checked(result: Result, times: Sequence[float]) -> list[float]:
    """Times that lie within the run."""
    first, last = result.trajectory.time[[0, -1]].tolist()
    faults = [
        Fault(f"times[{i}]", f"is {time:g} s; the run goes from {first:g} to {last:g} s")
        for i, time in enumerate(times)
        if not first <= time <= last
    ]
    if faults:
        raise InputError(faults)
    return [float(time) for time in times]
