"""run, render, replay, export, compare: running one scenario, and showing saved runs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    FolderOption,
    JsonOption,
    ScenarioArgument,
    SetOption,
    TrustOption,
    app,
    load,
    out,
    plain,
    print_json,
    print_saved,
    progress,
    with_changes,
)
from omnitrack_sim.cli.word_table import WordTable

PAGE, EXPORT = "replay.html", "trajectory"
"""Names of the page, and of what is exported, in the folder of its run."""
TABLE_FILE, FIGURE_FILE = "comparison.json", "comparison.png"
"""Files that ``compare --out`` leaves in a folder."""
_MIN_VALUE_WIDTH = 6
"""Characters that a column of values has at least."""
FILM: dict[str, Any] = {"width": 1280, "height": 720, "fps": 25}
GIF: dict[str, Any] = {"width": 640, "height": 360, "fps": 10}
"""Size and rate of films, and of a GIF, which is not compressed as well."""
FRAMES_A_PROCESS = 150
"""Frames for which another process pays, which takes 2 s to begin."""
CameraOption = Annotated[
    str | None,
    typer.Option(
        help="side, follow or onboard; when not given follow for a mission and side otherwise.",
        autocompletion=complete.cameras,
    ),
]
RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN_DIR", help="A folder that `omnitrack run` wrote.")
]


@app.command()
def run(
    scenario: ScenarioArgument,
    assignments: SetOption = None,
    folder: FolderOption = None,
    video: Annotated[bool, typer.Option(help="Also render video.mp4.")] = True,
    camera: CameraOption = None,
    exports: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            metavar="FORMAT",
            help="Also write trajectory.FORMAT: mcap for Foxglove and Rerun, or csv. Repeat for "
            "both.",
        ),
    ] = None,
    trial: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="SCENARIO is a sweep, or the folder of one: run its trial N again, to the same "
            "bytes.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run one scenario and save result, timeline, trajectory, plots, replay page and video."""
    from omnitrack_sim.base.writing import check_folder
    from omnitrack_sim.results.files import RESULT_FILE

    if trial is None:
        loaded, name = load(scenario, assignments), None
    else:
        loaded, name = _trial_of(scenario, trial, assignments)
    camera = camera or usual_camera(loaded)
    if video:
        check_camera(camera)
    for format in exports or ():
        _check_export(format)
    # Places and cameras are checked before the run, which may take minutes.
    target = folder or Path("out") / (name or loaded.name)
    check_folder(target, RESULT_FILE)
    with progress(f"run {loaded.name}", as_json) as report:
        result = ot.run(loaded, progress=report)
    result.save(target)
    draw(result, target, camera if video else None, as_json)
    for format in exports or ():
        ot.export_result(result, target / f"{EXPORT}.{format}")
    if as_json:
        print_json(result.summary())
    else:
        print_result(result, target)


def _trial_of(
    source: str, trial: int, assignments: Sequence[str] | None
) -> tuple[ot.Scenario, str]:
    """Return a trial of a sweep, by file, name or folder, and a name for its own folder."""

    def chosen(changes: dict[str, Any]) -> tuple[ot.Scenario, str]:
        if Path(source).is_dir():
            sweep = ot.load_sweep_result(source, trust=True).plan
            assert isinstance(sweep, ot.Sweep)
        else:
            sweep, changes = ot.load_sweep(source, changes), {}
        if trial >= sweep.size:
            problem = f"is {trial}; {sweep.name} has trials 0 to {sweep.size - 1}"
            raise InputError(Fault("--trial", problem))
        scenario = sweep.scenario(trial)
        return ot.override(scenario, changes) if changes else scenario, f"{sweep.name}_{trial}"

    return with_changes(chosen, assignments)


def draw(result: ot.Result, target: Path, camera: str | None, quiet: bool) -> None:
    """Add plots and replay page to a saved run, and the film where a camera is given.

    Warns of those that cannot be made.
    """
    from omnitrack_sim.show.plots.style import attempt
    from omnitrack_sim.show.projection import needs_map

    def picture(name: str, plot: Callable[..., object], called: str) -> None:
        file = target / name
        again = f"{called}({str(target)!r}, path={str(file)!r})"
        attempt(name, lambda: plot(result, path=file), again)

    # After the run has been saved: a plot that fails costs nothing of it.
    picture("summary.png", ot.plot_summary, "ot.plot_summary")
    if needs_map(result):
        picture("map.png", ot.plot_mission, "ot.plot_mission")
    picture(PAGE, ot.render_replay, "ot.render_replay")
    if camera is not None:
        film = target / "video.mp4"
        again = f"`omnitrack render {target} --camera {camera} --out {film}`"
        attempt("video", lambda: filmed(result, film, camera, quiet), again)


def print_result(result: ot.Result, target: Path) -> None:
    """Print outcome, events and figures of a run, and where it was saved."""
    colour = "green" if result.success else "yellow"
    out.say(f"[bold {colour}]{result.outcome.value}[/] {plain(result.advice)}")
    out.say(f"  {plain(result.reason)}")
    for event in result.events:
        out.say(f"  {plain(str(event))}")
    # It is None where the scenario expects nothing, which is no reason to warn.
    if result.as_expected is False:
        out.print(f"  [yellow]expected {result.scenario.run.expected_outcome}[/]")
    if _is_mission(result):
        passages = result.timeline()
        out.print(_passage_table(result, passages))
        slip = "slip: mean ratio; " if _has_slip(passages) else ""
        part = "module" if result.scenario.robot.modules else "body"
        out.say(f"  tilt: largest; {slip}force: least normal force of a {part}, 0.1 s mean")
    out.print(_figure_table(result))
    metrics = result.metrics
    out.say(
        f"  simulated {result.duration_s:.2f} s, {metrics['distance_m']:z.3f} m at "
        f"{metrics['mean_speed_m_s']:z.4f} m/s, tilt up to {metrics['tilt_max_deg']:.1f} deg, at "
        f"the end {metrics['tilt_exit_deg']:.1f} deg, {metrics['energy_j']:.1f} J{_slip(result)}"
    )
    if result.scenario.sensing.kind == "onboard":
        out.say(
            f"  onboard sensors: position error {metrics['localisation_error_mean_m']:.4f} m on "
            f"average, {metrics['localisation_error_max_m']:.4f} m at worst; error of "
            f"theta5 below {metrics['theta5_error_p95_deg']:.1f} deg in 95 % of the time"
        )
    difference = result.map_difference() if result.map is not None else None
    if difference is not None:
        out.print(_size_table(difference))
        out.say(f"  {_map_in_words(difference)}")
    out.say(f"  saved in {plain(str(target))}")


def _size_table(difference: ot.MapDifference) -> Table:
    """Table of how sure an explorer is of the sizes on its map."""
    table = WordTable("its map", "true part", "size", "unit", "value", "std", "error", gap=1)
    for size in difference.sizes:
        table.add_row(plain(size.part), plain(size.true) or "-", size.key, *size.cells)
    return table


def _map_in_words(difference: ot.MapDifference) -> str:
    """Text of the quality of an explorer's map."""
    pairs = {
        "kind": difference.kinds,
        "size": difference.wrong_sizes,
        "direction": difference.angles,
        "end": difference.ends,
        "joint": difference.loose,
    }
    lists = {
        f"wrong {what}": [f"{mine} for {true}" for mine, true in own] for what, own in pairs.items()
    }
    lists |= {"missing": [*difference.missing], "not there": [*difference.extra]}
    faults = [f"{head}: {', '.join(names)}" for head, names in lists.items() if names]
    verdict = ", and is the same as the network" if difference.same else ""
    parts = f"its map has {difference.found} of {difference.parts} parts{verdict}"
    error = 1000 * difference.length_error
    lengths = f"errors of all lengths, also round bends, add up to {error:.1f} mm"
    return "; ".join([parts, lengths, *faults])


def _is_mission(result: ot.Result) -> bool:
    """True if the timeline is worth printing: several legs, or two bends, tees or reducers."""
    routes = result.routes()
    turns = [
        passage
        for route in routes
        for passage in route.passages
        if not route.network.parts[passage.index].fitting.is_plain
    ]
    return len(routes) > 1 or len(turns) > 1


def _has_slip(passages: Sequence[ot.PassageRecord]) -> bool:
    """Return whether a slip ratio was measured; robots other than the tracked one have none."""
    return any(passage.slip_ratio_mean is not None for passage in passages)


def _passage_table(result: ot.Result, passages: Sequence[ot.PassageRecord]) -> Table:
    """The columns of the timeline that matter most; without slip where none was measured."""
    legs = len(result.routes()) > 1
    has_slip = _has_slip(passages)
    heads = ("enter\ns", "time\ns", "theta5\ndeg", "tilt\ndeg", *["slip\n1"] * has_slip, "force\nN")
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=True)
    for name in ["leg", "fitting"] if legs else ["  fitting"]:
        table.add_column(name, no_wrap=True)
    table.add_column("manoeuvre")
    for head in (*heads, "rolls\n1", "retries\n1"):
        table.add_column(head, justify="right", no_wrap=True)
    for passage in passages:
        leg = f"{passage.leg + 1}{' tail' if passage.gear < 0 else ''}"
        slip = "-" if passage.slip_ratio_mean is None else f"{passage.slip_ratio_mean:.3f}"
        table.add_row(
            *((leg, plain(passage.name)) if legs else (f"  {plain(passage.name)}",)),
            passage.manoeuvre,
            f"{passage.time_enter_s:.2f}",
            f"{passage.duration_s:.2f}",
            f"{passage.theta5_enter_deg:z.0f}",
            f"{passage.tilt_max_deg:.1f}",
            *[slip] * has_slip,
            f"{passage.normal_force_min_n:.1f}",
            str(passage.rolls or "-"),
            str(passage.retries or "-"),
        )
    return table


def _slip(result: ot.Result) -> str:
    """Words on the slip of a robot that has a slip without load."""
    metrics = result.metrics
    if "no_load_slip_m_s" not in metrics:
        return ""
    excess = f"{metrics['slip_excess']:.0%}".replace("%", " %")
    without_load = f"{metrics['no_load_slip_m_s']:.1e} m/s without load"
    return f"; slip reads {excess} high by the time step, and {without_load}"


def _figure_table(result: ot.Result) -> Table:
    """Figures of each module, or of a robot whose metrics have one value each; then own ones."""
    from omnitrack_sim.results.comparison import figure_text

    robot = result.scenario.robot
    metrics = robot.metrics
    of_modules = [metric for metric in metrics if metric.per_module]
    heads = [f"module {i + 1}" for i in range(robot.modules)] if of_modules else ["value"]
    table = WordTable("figure", "unit", *heads)
    for metric in of_modules or metrics:
        value = result.metrics[metric.name]
        if isinstance(value, float):
            table.add_row(metric.name, metric.unit, figure_text(value))
        elif isinstance(value, list) and metric.title:
            table.add_row(metric.title, metric.unit, *(f"{v:z.{metric.digits}f}" for v in value))
    for metric in result.scenario.named_metrics:
        value = result.metrics[metric.name]
        values = value if isinstance(value, list) else [value]
        numbers = [f"{v:.4g}" for v in values if isinstance(v, int | float)]
        if numbers:
            table.add_row(plain(metric.title or metric.name), plain(metric.unit), *numbers)
    return table


def check_camera(camera: str) -> None:
    """Raise for an unknown camera."""
    from omnitrack_sim.show.film.render import CAMERAS

    if camera not in CAMERAS:
        raise ScenarioError(Fault("--camera", f"is {camera!r}", CAMERAS, given=camera))


def usual_camera(scenario: ot.Scenario) -> str:
    """Return the camera that sees a robot all along.

    One that stands still would lose it in a network, where pipes turn away from the plane of the
    first.
    """
    return "side" if scenario.mission is None else "follow"


def processes_for(duration: float, fps: int) -> int:
    """Return how many processes paint a film of this length, s, fastest on this machine."""
    from omnitrack_sim.base.workers import cores

    spare = cores() // 2  # each painter keeps the one that encodes busy, too
    return max(1, min(spare, int(duration * fps) // FRAMES_A_PROCESS))


@app.command()
def render(
    run_dir: RunArgument,
    camera: CameraOption = None,
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
        typer.Option(metavar="N", help="Processes that paint; by default half of the processors."),
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
    trust: TrustOption = False,
) -> None:
    """Render a saved run from any camera: as a film, or as stills side by side."""
    if camera is not None:
        check_camera(camera)
    pixels = {} if size is None else _size(size)
    if strip is None and at is None:
        _film(run_dir, trust, camera, file, pixels, fps, processes)
        return
    idle = {"--fps": fps, "--processes": processes}
    faults = [Fault(name, "is for films, not strips") for name, v in idle.items() if v is not None]
    if faults:
        raise InputError(faults)
    _strip(run_dir, trust, camera, file, pixels, strip, None if at is None else _times(at))


def _strip(
    run_dir: Path,
    trust: bool,
    camera: str | None,
    file: Path | None,
    size: dict[str, int],
    count: int | None,
    times: list[float] | None,
) -> None:
    if count is not None and times is not None and count != len(times):
        raise InputError(Fault("--strip", f"is {count}, but --at has {len(times)} times"))
    # Loaded this late, since faults of the options should not wait for a renderer.
    from omnitrack_sim.show.film.strip import FRAMES

    target = file or run_dir / "strip.png"
    count = FRAMES if count is None else count
    result = ot.load_result(run_dir, trust=trust)
    camera = camera or usual_camera(result.scenario)
    try:
        ot.render_strip(result, path=target, count=count, times=times, camera=camera, **size)
    except InputError as error:
        faults = [f.at("--at") if f.where.startswith("times") else f for f in error.faults]
        raise InputError(faults) from None
    print_saved(target)


def _film(
    run_dir: Path,
    trust: bool,
    camera: str | None,
    file: Path | None,
    size: dict[str, int],
    fps: int | None,
    processes: int | None,
) -> None:
    from omnitrack_sim.base.writing import check_file
    from omnitrack_sim.show.film.encoding import film_format
    from omnitrack_sim.show.film.render import CAMERAS, check_request

    format = "mp4" if file is None else film_format(file)
    wanted = dict(GIF if format == "gif" else FILM)
    wanted |= size | ({} if fps is None else {"fps": fps})
    # Before the run is read, whose trajectory may take seconds.
    painters = 1 if processes is None else processes
    check_request(camera or CAMERAS[0], **wanted, format=format, processes=painters)
    if file is not None:
        check_file(file)
    result = ot.load_result(run_dir, trust=trust)
    camera = camera or usual_camera(result.scenario)
    target = file or run_dir / f"{camera}.mp4"
    filmed(result, target, camera, False, processes, **wanted)
    print_saved(target)


def filmed(
    result: ot.Result,
    target: Path,
    camera: str,
    quiet: bool,
    processes: int | None = None,
    fps: int = 25,
    **size: Any,
) -> None:
    """Film a run, with a progress bar unless ``quiet``; by default in the fastest ``processes``."""
    if processes is None:
        processes = processes_for(result.duration_s, fps)
    with progress("video", quiet) as report:
        ot.render_video(
            result,
            path=target,
            camera=camera,
            fps=fps,
            progress=report,
            processes=processes,
            **size,
        )


def _size(text: str) -> dict[str, int]:
    """Width and height of WxH."""
    # At most six digits each: int() refuses numbers of thousands of digits with words of its own.
    numbers = re.fullmatch(r"([0-9]{1,6})x([0-9]{1,6})", text)
    if numbers is None:
        raise InputError(Fault("--size", f"is {text!r}; it is WIDTHxHEIGHT, such as 1280x720"))
    return {"width": int(numbers[1]), "height": int(numbers[2])}


def _times(text: str) -> list[float]:
    """The times of --at."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError(Fault("--at", f"is {text!r}; it is times in s, such as 2.0,3.5")) from None


@app.command()
def replay(
    run_dir: RunArgument,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN_DIR2",
            help="A second run through the same pipes, shown as a translucent robot.",
        ),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help=f"A .html; RUN_DIR/{PAGE} when not given."),
    ] = None,
    trust: TrustOption = False,
) -> None:
    """Write a page that plays a saved run in any browser, without a network."""
    from omnitrack_sim.show.replay.document import pipes_mismatch
    from omnitrack_sim.show.run_playback import RunPlayback

    # A run that cannot be read is the clearer message of the two.
    # And before the place of the page, which may be in its folder.
    result, *others = (
        RunPlayback(ot.load_result(folder, trust=trust), coarse=False)
        for folder in (run_dir, compare)
        if folder is not None
    )
    other = others[0] if others else None
    if other is not None and (problem := pipes_mismatch(result, other)):
        hint = "compares figures and scenarios of any two runs"
        problem += f"; `omnitrack compare {run_dir} {compare}` {hint}"
        raise InputError(Fault(f"--compare {compare}", problem))
    target = file or run_dir / PAGE
    ot.render_replay(result, path=target, compare=other)
    print_saved(target)


@app.command()
def export(
    run_dir: RunArgument,
    file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help=f"A .mcap for Foxglove and Rerun, or a .csv; RUN_DIR/{EXPORT}.mcap when not "
            "given.",
        ),
    ] = None,
    trust: TrustOption = False,
) -> None:
    """Export a saved run for other tools: poses, joints, contacts and channels."""
    print_saved(ot.export_result(run_dir, file or run_dir / f"{EXPORT}.mcap", trust=trust))


def _check_export(format: str) -> None:
    """Refuse a format of ``--export``, by the name of the option."""
    from omnitrack_sim.show.export import check_export

    try:
        check_export(format)
    except InputError as error:
        raise InputError([fault.at("--export") for fault in error.faults]) from None


@app.command()
def compare(
    a: RunArgument,
    b: RunArgument,
    target: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER_OR_FILE",
            help="A figure (.png, .pdf or .svg), or a folder for figure and table.",
        ),
    ] = None,
    as_json: JsonOption = False,
    trust: TrustOption = False,
) -> None:
    """Compare two saved runs: scenarios, outcomes, metrics, and curves in one figure."""
    _check_target(target)
    comparison = ot.compare(a, b, trust=trust)
    if as_json:
        print_json(comparison.summary())
    else:
        _print_comparison(comparison)
    files = _save_comparison(comparison, target)
    # JSON on standard output stays alone, for the program that reads it.
    for path in files if not as_json else ():
        print_saved(path)


def _is_figure(target: Path) -> bool:
    from omnitrack_sim.show.plots.style import FORMATS

    return target.suffix[1:].lower() in FORMATS and not target.is_dir()


def _check_target(target: Path | None) -> None:
    """Refuse places that cannot be written, before anything is read."""
    from omnitrack_sim.base.writing import check_file, check_folder
    from omnitrack_sim.show.plots.style import FORMATS

    if target is not None and _is_figure(target):
        check_file(target)
    elif target is not None:
        if target.suffix and not target.is_dir():
            problem = f"no figure ends in {target.suffix}, and a new folder has no ending"
            endings = tuple(f".{format}" for format in FORMATS)
            raise InputError(Fault(f"--out {target}", problem, endings))
        check_folder(target)


def _save_comparison(comparison: ot.Comparison, target: Path | None) -> list[Path]:
    """Write the files that ``--out`` asks for, and return their paths."""
    from omnitrack_sim.base.text import strict_json
    from omnitrack_sim.base.writing import write_files
    from omnitrack_sim.show.plots.style import figure_bytes, save_figure

    if target is None:
        return []
    figure = ot.plot_compare(comparison.a, comparison.b)
    if _is_figure(target):
        save_figure(figure, target)
        return [target]
    # Drawn before anything is written, so that the folder gets both files or none.
    table = strict_json(comparison.summary()) + "\n"
    files = {target / TABLE_FILE: table.encode(), target / FIGURE_FILE: figure_bytes(figure)}
    return write_files(files)


def _print_comparison(comparison: ot.Comparison) -> None:
    from omnitrack_sim.results.comparison import figure_row, value_row

    for side, run in (("A", comparison.a), ("B", comparison.b)):
        colour = "green" if run.success else "yellow"
        ended = f"[bold {colour}]{run.outcome.value}[/] after {run.duration_s:.2f} s"
        out.say(f"{side}  {plain(run.scenario.name)}: {ended}")
        out.say(f"   {plain(run.reason)}")
    if comparison.values:
        _print_rows(("scenario value", "unit", "A", "B"), map(value_row, comparison.values))
    else:
        out.say("the scenarios are the same")
    changed = [one for one in comparison.figures if one.differs]
    if changed:
        _print_rows(("figure", "unit", "A", "B", "B - A"), map(figure_row, changed))
    else:
        out.say("all figures are the same")


def _print_rows(heads: tuple[str, ...], rows) -> None:
    table = Table(box=None, padding=(0, 2))
    for head in heads:
        numbers = head in ("A", "B", "B - A")
        # Values are broken where a line is short, names at their dots alone.
        justify, least = ("right", _MIN_VALUE_WIDTH) if numbers else ("left", None)
        table.add_column(
            head, justify=justify, overflow="fold", no_wrap=not numbers, min_width=least
        )
    for name, *others in rows:
        table.add_row(_at_dots(plain(name), out.width // 2), *map(plain, others))
    out.print(table)


def _at_dots(name: str, most: int) -> str:
    """Break a dotted name into lines of ``most`` characters, where its parts are no longer."""
    lines = [""]
    for part in re.split(r"(?<=\.)", name):
        if lines[-1] and len(lines[-1]) + len(part) > most:
            lines.append("  ")
        lines[-1] += part
    return "\n".join(lines)
