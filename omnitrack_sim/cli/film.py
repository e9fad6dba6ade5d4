"""render: films and strips of a saved run."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, out, plain, progress

if TYPE_CHECKING:
    from omnitrack_sim.results.result import Result

GIF: dict[str, Any] = {"width": 640, "height": 360, "fps": 10}
"""What ``render`` makes of a GIF, which has no such compression as a film."""
FRAMES_A_PROCESS = 150
"""Frames for which another process pays, which takes 2 s to begin."""


def check_camera(camera: str) -> None:
    """Refuse a camera that there is not."""
    from omnitrack_sim.show.film.limits import CAMERAS

    if camera not in CAMERAS:
        raise ScenarioError(Fault("--camera", f"is {camera!r}", CAMERAS, given=camera))


def processes_for(duration: float, fps: int) -> int:
    """How many processes paint a film of this length, s, fastest on this machine."""
    spare = len(os.sched_getaffinity(0)) // 2  # each painter keeps the one that encodes busy, too
    return max(1, min(spare, int(duration * fps) // FRAMES_A_PROCESS))


@app.command()
def render(
    run_dir: Annotated[
        Path, typer.Argument(metavar="RUN_DIR", help="A folder that `omnitrack run` wrote.")
    ],
    camera: Annotated[
        str, typer.Option(help="side, follow or onboard.", autocompletion=complete.cameras)
    ] = "side",
    file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help=(
                "A .mp4, .webm or smaller .gif, RUN_DIR/CAMERA.mp4 when not given; of a strip a "
                ".png, .jpg or .pdf, RUN_DIR/strip.png when not given."
            ),
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Pixels; 1280x720, or 640x360 of a GIF, when not given."),
    ] = None,
    fps: Annotated[
        int | None,
        typer.Option(metavar="N", help="Frames a second; 25, or 10 of a GIF, when not given."),
    ] = None,
    processes: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Processes that paint; when not given as many as the machine is for."
        ),
    ] = None,
    strip: Annotated[
        int | None,
        typer.Option(metavar="N", help="N stills, (a), (b), (c), in one picture, and no film."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="S,S,..",
            help="Times of the stills, s; evenly over the manoeuvres if not given.",
        ),
    ] = None,
) -> None:
    """Render a saved run from any camera: as a film, or as stills side by side."""
    check_camera(camera)
    asked = {} if size is None else _size(size)
    if strip is None and at is None:
        _film(run_dir, camera, file, asked, fps, processes)
        return
    idle = {"--fps": fps, "--processes": processes}
    faults = [Fault(name, "is for films, not strips") for name, v in idle.items() if v is not None]
    if faults:
        raise InputError(faults)
    times = None if at is None else _times(at)
    if strip is not None and times is not None and strip != len(times):
        raise InputError(Fault("--strip", f"is {strip}, but --at has {len(times)} times"))
    from omnitrack_sim.show.film.strip import FRAMES, render_strip

    target = file or run_dir / "strip.png"
    count = FRAMES if strip is None else strip
    render_strip(run_dir, target, count, times=times, camera=camera, **asked)
    out.print(f"saved {plain(str(target))}", soft_wrap=True)


def _film(
    run_dir: Path,
    camera: str,
    file: Path | None,
    size: dict[str, int],
    fps: int | None,
    processes: int | None,
) -> None:
    from omnitrack_sim.base.writing import check_file
    from omnitrack_sim.results.result import load_result
    from omnitrack_sim.show.film.encoding import film_format
    from omnitrack_sim.show.film.limits import check_request

    target = file or run_dir / f"{camera}.mp4"
    format = film_format(target)
    wanted = {"width": 1280, "height": 720, "fps": 25} if format != "gif" else dict(GIF)
    wanted |= size | ({} if fps is None else {"fps": fps})
    check_request(camera, **wanted, format=format, processes=1 if processes is None else processes)
    if file is not None:
        check_file(file)
    filmed(load_result(run_dir), target, camera, False, processes, **wanted)
    out.print(f"saved {plain(str(target))}", soft_wrap=True)


def filmed(
    result: Result,
    target: Path,
    camera: str,
    quiet: bool,
    processes: int | None = None,
    fps: int = 25,
    **size: Any,
) -> None:
    """Film a run, with a progress bar unless ``quiet``, by as many processes as pay if not told."""
    from omnitrack_sim.show.film.render import render_video

    if processes is None:
        processes = processes_for(result.duration_s, fps)
    with progress("video", quiet) as report:
        render_video(
            result, target, camera=camera, fps=fps, progress=report, processes=processes, **size
        )


def _size(text: str) -> dict[str, int]:
    """Width and height of WxH."""
    found = re.fullmatch(r"([0-9]{1,6})x([0-9]{1,6})", text)
    if found is None:
        raise InputError(Fault("--size", f"is {text!r}; it is WIDTHxHEIGHT, such as 1280x720"))
    return {"width": int(found[1]), "height": int(found[2])}


def _times(text: str) -> list[float]:
    """The times of --at."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError(Fault("--at", f"is {text!r}; it is times in s, such as 2.0,3.5")) from None
