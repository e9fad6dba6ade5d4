"""render: pictures of a saved run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, out, plain, progress
from omnitrack_sim.errors import Fault, ScenarioError

GIF: dict[str, Any] = {"width": 640, "height": 360, "fps": 10}
"""What ``render`` makes of a GIF, which has no such compression as an MP4."""


def check_camera(camera: str) -> None:
    """Refuse a camera that there is not."""
    from omnitrack_sim.film.render import CAMERAS

    if camera not in CAMERAS:
        raise ScenarioError(Fault("--camera", f"is {camera!r}", CAMERAS, given=camera))


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
            help="A .mp4, or a smaller .gif; RUN_DIR/CAMERA.mp4 when not given.",
        ),
    ] = None,
) -> None:
    """Render a saved run from another camera, as MP4 or GIF."""
    from omnitrack_sim.film.encoding import film_format
    from omnitrack_sim.film.render import render_video
    from omnitrack_sim.sim.loading import load_result
    from omnitrack_sim.writing import check_file

    check_camera(camera)
    target = file or run_dir / f"{camera}.mp4"
    size = GIF if film_format(target) == "gif" else {}
    if file is not None:
        check_file(file)
    result = load_result(run_dir)
    with progress("video", False) as report:
        render_video(result, target, camera=camera, progress=report, **size)
    out.print(f"saved {plain(str(target))}", soft_wrap=True)
