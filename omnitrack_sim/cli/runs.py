"""run: one scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    ScenarioArgument,
    SetOption,
    app,
    load,
    out,
    plain,
    print_json,
    progress,
)
from omnitrack_sim.cli.film import check_camera, filmed
from omnitrack_sim.cli.replay import PAGE

if TYPE_CHECKING:
    from omnitrack_sim.pipes.compare import MapDifference
    from omnitrack_sim.results.result import Result


@app.command()
def run(
    scenario: ScenarioArgument,
    assignments: SetOption = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where the results go; out/NAME when not given."),
    ] = None,
    video: Annotated[bool, typer.Option(help="Also render video.mp4.")] = True,
    camera: Annotated[
        str | None,
        typer.Option(
            help=(
                "Camera of the video: side, follow or onboard; when not given follow for a "
                "mission and side otherwise."
            ),
            autocompletion=complete.cameras,
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print result.json instead of the table.")
    ] = False,
) -> None:
    """Run one scenario and save result, timeline, trajectory, plots, replay page and video."""
    from omnitrack_sim.base.writing import check_folder
    from omnitrack_sim.results.files import RESULT_FILE
    from omnitrack_sim.sim.run import run as run_scenario

    loaded = load(scenario, assignments)
    camera = camera or ("side" if loaded.mission is None else "follow")
    if video:
        check_camera(camera)
    target = folder or Path("out") / loaded.name
    check_folder(target, RESULT_FILE)
    with progress(f"run {loaded.name}", as_json) as report:
        result = run_scenario(loaded, progress=report)
    result.save(target)
    draw(result, target, camera if video else None, as_json)
    if as_json:
        print_json(result.summary())
    else:
        print_result(result, target)


def draw(result: Result, target: Path, camera: str | None, quiet: bool) -> None:
    """Add plots and replay page to a saved run, and the film where a camera is given; one that
    cannot be made is told as a warning and costs only itself."""
    from omnitrack_sim.show.film.inset import needs_map
    from omnitrack_sim.show.plots import plot_mission, plot_summary
    from omnitrack_sim.show.plots.style import attempt
    from omnitrack_sim.show.replay import write_replay

    def picture(name: str, plot: Callable[[Result, Path], object], called: str) -> None:
        file = target / name
        again = f"{called}({str(target)!r}, {str(file)!r})"
        attempt(name, lambda: plot(result, file), again)

    picture("summary.png", plot_summary, "ot.plot_summary")
    if needs_map(result.routes()):
        picture("map.png", plot_mission, "ot.plot_mission")
    picture(PAGE, write_replay, "ot.write_replay")
    if camera is not None:
        film = target / "video.mp4"
        again = f"`omnitrack render {target} --camera {camera} --out {film}`"
        attempt("video", lambda: filmed(result, film, camera, quiet), again)


def print_result(result: Result, target: Path) -> None:
    colour = "green" if result.success else "yellow"
    out.print(
        f"[bold {colour}]{result.outcome.value}[/] {plain(result.outcome.advice)}", soft_wrap=True
    )
    out.print(f"  {plain(result.reason)}", soft_wrap=True)
    for event in result.events:
        out.print(f"  {plain(str(event))}", soft_wrap=True)
    if result.as_expected is False:
        out.print(f"  [yellow]expected {result.scenario.run.expected_outcome}[/]")
    if _is_mission(result):
        out.print(_visit_table(result))
        out.print(
            "  tilt: largest; slip: mean ratio; force: least normal force of a module, 0.1 s mean",
            soft_wrap=True,
        )
    out.print(_module_table(result))
    metrics = result.metrics
    out.print(
        f"  simulated {result.duration_s:.2f} s, {metrics['distance_m']:.3f} m at "
        f"{metrics['mean_speed_m_s']:.4f} m/s, tilt up to {metrics['tilt_max_deg']:.1f} deg, at "
        f"the end {metrics['tilt_exit_deg']:.1f} deg, {metrics['energy_j']:.1f} J; slip without "
        f"load {metrics['no_load_slip_m_s']:.1e} m/s",
        soft_wrap=True,
    )
    if result.scenario.sensing.kind == "onboard":
        out.print(
            f"  by its own sensors: place known to {metrics['localisation_error_mean_m']:.4f} m on "
            f"average, {metrics['localisation_error_max_m']:.4f} m at worst; theta5 to "
            f"{metrics['theta5_error_p95_deg']:.1f} deg in 95 % of the time",
            soft_wrap=True,
        )
    found = result.map_difference() if result.map is not None else None
    if found is not None:
        out.print(f"  {_map_in_words(found)}", soft_wrap=True)
    out.print(f"  saved in {plain(str(target))}", soft_wrap=True)


def _map_in_words(found: MapDifference) -> str:
    """How good the map of a robot that explores is."""
    faults = {
        "kind": found.kinds,
        "size": found.wrong_sizes,
        "direction": found.angles,
        "joint": found.loose,
    }
    told = [
        f"wrong {what}: {', '.join(f'{mine} for {true}' for mine, true in pairs)}"
        for what, pairs in faults.items()
        if pairs
    ]
    told += [f"missing: {', '.join(found.missing)}"] if found.missing else []
    told += [f"not there: {', '.join(found.extra)}"] if found.extra else []
    parts = f"its map has {found.found} of {found.parts} parts, {found.length_error:.3f} m wrong in"
    return f"{parts} all lengths{'; ' if told else ''}{'; '.join(told)}"


def _is_mission(result: Result) -> bool:
    """Whether the timeline is worth printing: several legs, or two bends, tees or reducers."""
    routes = result.routes()
    turns = [
        passage
        for route in routes
        for passage in route.fittings
        if not route.network.parts[passage.index].fitting.is_plain
    ]
    return len(routes) > 1 or len(turns) > 1


def _visit_table(result: Result) -> Table:
    """The columns of the timeline that matter most."""
    legs = len(result.routes()) > 1
    heads = [
        ("enter", "s"),
        ("time", "s"),
        ("theta5", "deg"),
        ("tilt", "deg"),
        ("slip", "1"),
        ("force", "N"),
    ]
    heads += [("rolls", "1"), ("retries", "1")]
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=True)
    for name in ["leg", "fitting"] if legs else ["  fitting"]:
        table.add_column(name, no_wrap=True)
    table.add_column("manoeuvre")
    for name, unit in heads:
        table.add_column(f"{name}\n{unit}", justify="right", no_wrap=True)
    for visit in result.timeline():
        leg = f"{visit.leg + 1}{' tail' if visit.gear < 0 else ''}"
        slip = "-" if visit.slip_ratio_mean is None else f"{visit.slip_ratio_mean:.3f}"
        table.add_row(
            *((leg,) if legs else ()),
            plain(visit.name) if legs else f"  {plain(visit.name)}",
            visit.manoeuvre,
            f"{visit.time_enter_s:.2f}",
            f"{visit.duration_s:.2f}",
            f"{visit.theta5_enter_deg:z.0f}",
            f"{visit.tilt_max_deg:.1f}",
            slip,
            f"{visit.normal_force_min_n:.1f}",
            str(visit.rolls or "-"),
            str(visit.retries or "-"),
        )
    return table


_ROWS = {
    "slip_ratio_mean": ("mean slip ratio", "1", 3),
    "slip_distance_m": ("slip distance", "m", 4),
    "traction_rms_n": ("traction, rms", "N", 2),
    "normal_force_mean_n": ("mean normal force", "N", 1),
    "contact_fraction": ("time in contact", "1", 3),
    "spring_travel_max_m": ("largest spring travel", "m", 4),
    "motor_torque_max_nm": ("largest motor torque", "N m", 3),
    "torque_rms_nm": ("motor torque, rms", "N m", 3),
    "torque_change_nm_s": ("change of torque", "N m/s", 2),
    "time_at_limit_s": ("time at the torque limit", "s", 2),
    "stall_time_s": ("time stalled", "s", 2),
}


def _module_table(result: Result) -> Table:
    table = Table("figure", "unit", *(f"module {i}" for i in (1, 2, 3)), box=None, padding=(0, 2))
    for key, (label, unit, digits) in _ROWS.items():
        values = result.metrics[key]
        assert isinstance(values, list)
        table.add_row(label, unit, *(f"{v:.{digits}f}" for v in values))
    return table
