"""The command line. Exit status: 0 it ran, whatever the robot did; 2 bad input or output."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from omnitrack_sim.errors import Fault, OmnitrackError, RenderError, ScenarioError

if TYPE_CHECKING:
    from omnitrack_sim.scenario import Scenario
    from omnitrack_sim.sim.result import Result

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Simulate the Omnidirectional Tractable Three Module Robot in pipes.",
)
out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def main() -> None:
    """Entry point: every error that the user can mend ends with status 2 and says what to mend."""
    try:
        app()
    except OmnitrackError as error:
        for line in str(error).splitlines():
            err.print(f"[red]error:[/red] {_plain(line)}", soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _plain(text: str) -> str:
    from rich.markup import escape

    return escape(text)


ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a shipped one.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Override a value, such as control.cruise_speed=0.12."),
]


def _load(source: str, assignments: list[str] | None) -> Scenario:
    from omnitrack_sim.scenario import load_scenario, override

    scenario = load_scenario(source)
    return override(scenario, dict(_assignment(text) for text in assignments)) if assignments else scenario


def _assignment(text: str) -> tuple[str, Any]:
    """PATH=VALUE; the value as in TOML, a bare word as a string."""
    path, equals, value = text.partition("=")
    if not equals or not path:
        raise ScenarioError(Fault(f"--set {text}", "is not PATH=VALUE, such as control.cruise_speed=0.12"))
    try:
        return path.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


@contextmanager
def _progress(title: str, quiet: bool) -> Iterator[Any]:
    """A progress bar on standard error; a callable (part done, text) drives it."""
    if quiet:
        yield None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda part, text="": bar.update(task, completed=part, description=f"{title} {text}".strip())


@app.command()
def run(
    scenario: ScenarioArgument,
    assignments: SetOption = None,
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where the results go; out/NAME when not given.")
    ] = None,
    video: Annotated[bool, typer.Option(help="Also render video.mp4.")] = True,
    camera: Annotated[str, typer.Option(help="Camera of the video: side, follow or onboard.")] = "side",
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead of the table.")] = False,
) -> None:
    """Run one scenario and save result, trajectory, plot and video."""
    from omnitrack_sim.plots import plot_summary
    from omnitrack_sim.sim.result import check_output, run_folder
    from omnitrack_sim.sim.runner import run as run_scenario

    loaded = _load(scenario, assignments)
    if video:
        _check_camera(camera)
    target = folder or Path("out") / loaded.name
    check_output(target)
    with _progress(f"run {loaded.name}", as_json) as report:
        result = run_scenario(loaded, progress=report)
    with run_folder(target) as temporary:
        result.write(temporary)
        plot_summary(result, temporary / "summary.png")
        if video:
            _try_video(result, temporary / "video.mp4", camera, as_json)
    if as_json:
        print(json.dumps(result.summary(), indent=2))
    else:
        _print_result(result, target)


def _check_camera(camera: str) -> None:
    from omnitrack_sim.render import CAMERAS

    if camera not in CAMERAS:
        raise ScenarioError(Fault("--camera", f"is {camera!r}", CAMERAS))


def _try_video(result: Result, path: Path, camera: str, quiet: bool) -> None:
    """Render, or say why not: the run itself is not lost for want of OpenGL."""
    from omnitrack_sim.render import render_video

    try:
        with _progress("video", quiet) as report:
            render_video(result, path, camera=camera, progress=report)
    except RenderError as error:
        err.print(f"[yellow]no video:[/yellow] {_plain(str(error))}", soft_wrap=True)


def _print_result(result: Result, target: Path) -> None:
    colour = "green" if result.success else "yellow"
    out.print(f"[bold {colour}]{result.outcome.value}[/] {_plain(result.outcome.advice)}", soft_wrap=True)
    out.print(f"  {_plain(result.reason)}", soft_wrap=True)
    for event in result.events:
        out.print(f"  {_plain(event)}", soft_wrap=True)
    if result.as_expected is False:
        out.print(f"  [yellow]expected {result.scenario.expect.outcome}[/]")
    out.print(_module_table(result))
    metrics = result.metrics
    out.print(
        f"  simulated {result.duration_s:.2f} s, {metrics['distance_m']:.3f} m at {metrics['mean_speed_m_s']:.4f} m/s, "
        f"tilt up to {metrics['tilt_max_deg']:.1f} deg, at the end {metrics['tilt_exit_deg']:.1f} deg, "
        f"{metrics['energy_j']:.1f} J; slip without load {metrics['no_load_slip_m_s']:.1e} m/s",
        soft_wrap=True,
    )
    out.print(f"  saved in {target}", soft_wrap=True)


_ROWS = {
    "slip_ratio_mean": ("mean slip ratio", "1", 3),
    "slip_distance_m": ("slip distance", "m", 4),
    "traction_rms_n": ("traction, rms", "N", 2),
    "normal_force_mean_n": ("mean normal force", "N", 1),
    "contact_fraction": ("time in contact", "1", 3),
    "spring_travel_max_m": ("largest spring travel", "m", 4),
    "motor_torque_max_n_m": ("largest motor torque", "N m", 3),
    "stall_time_s": ("time stalled", "s", 2),
}


def _module_table(result: Result) -> Table:
    table = Table("figure", "unit", *(f"module {i}" for i in (1, 2, 3)), box=None, padding=(0, 2))
    for key, (label, unit, digits) in _ROWS.items():
        values = result.metrics[key]
        assert isinstance(values, list)
        table.add_row(label, unit, *(f"{v:.{digits}f}" for v in values))
    return table


@app.command()
def render(
    run_dir: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="A folder that `omnitrack run` wrote.")],
    camera: Annotated[str, typer.Option(help="side, follow or onboard.")] = "side",
    file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.mp4", help="RUN_DIR/CAMERA.mp4 when not given.")
    ] = None,
) -> None:
    """Render a saved run from another camera."""
    from omnitrack_sim.render import render_video
    from omnitrack_sim.sim.result import load_result

    _check_camera(camera)
    target = file or run_dir / f"{camera}.mp4"
    result = load_result(run_dir)
    with _progress("video", False) as report:
        render_video(result, target, camera=camera, progress=report)
    out.print(f"saved {target}")


@app.command()
def scenarios(as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False) -> None:
    """List the scenarios that come with the package; `omnitrack run NAME` finds them."""
    from omnitrack_sim.scenario import shipped_scenarios

    rows = {name: _comment(path) for name, path in shipped_scenarios().items()}
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    table = Table("name", "what it shows", box=None, padding=(0, 2))
    for name, text in rows.items():
        table.add_row(name, _plain(text))
    out.print(table)


def _comment(path: Path) -> str:
    """The comment at the head of a scenario file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = lines[: next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))]
    return " ".join(line.lstrip("# ") for line in head)


@app.command()
def parameters(
    scenario: Annotated[
        str | None, typer.Argument(help="Show the robot of this scenario instead of the default one.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
) -> None:
    """The robot's parameters with unit, provenance and source."""
    from omnitrack_sim.robot import Robot

    robot = _load(scenario, None).robot if scenario else Robot()
    rows = robot.parameters()
    if as_json:
        print(json.dumps([vars(row) for row in rows], indent=2))
        return
    table = Table("parameter", "value", "unit", "provenance", "source", box=None, padding=(0, 1))
    for row in rows:
        value = f"{row.value:.6g}" if isinstance(row.value, float) else str(row.value)
        table.add_row(row.name, value, row.unit, row.provenance, _plain(row.source))
    out.print(table)


@app.command()
def models(
    check: Annotated[bool, typer.Option("--check", help="Say which files differ; status 1 if any does.")] = False,
    write: Annotated[bool, typer.Option("--write", help="Write the files.")] = False,
    root: Annotated[Path, typer.Option(help="Folder that holds models/ and assets/.")] = Path(),
) -> None:
    """Check or write the published MJCF models and meshes."""
    from omnitrack_sim.mjcf.export import check_models, write_models

    if check == write:
        raise ScenarioError(Fault("omnitrack models", "say one of --check and --write", ("--check", "--write")))
    folders = root / "models", root / "assets"
    if write:
        out.print(f"wrote {len(write_models(*folders))} files below {root.resolve()}")
        return
    different = check_models(*folders)
    for name in different:
        out.print(f"differs: {name}")
    out.print("models and assets are up to date" if not different else "run `omnitrack models --write`")
    raise typer.Exit(1 if different else 0)


@app.command()
def view(scenario: ScenarioArgument, assignments: SetOption = None) -> None:
    """Open a scenario's model in MuJoCo's viewer (needs a screen)."""
    import os

    loaded = _load(scenario, assignments)
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RenderError("the viewer needs a screen; `omnitrack run` renders a video without one")
    import mujoco.viewer

    from omnitrack_sim.sim.setup import scene_of, start_qpos

    model = scene_of(loaded, looks=True).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = start_qpos(loaded, model)
    mujoco.viewer.launch(model, data)


if __name__ == "__main__":
    main()
