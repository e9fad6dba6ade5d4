"""view and drive: scenarios in MuJoCo's window, running or driven by keyboard, and saved runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli.common import (
    FolderOption,
    ScenarioArgument,
    SetOption,
    TrustOption,
    app,
    load,
    out,
)
from omnitrack_sim.cli.runs import draw, print_result
from omnitrack_sim.show.viewer.keys import DRIVE, REPLAY, VIEW, Key, help_lines

if TYPE_CHECKING:
    from omnitrack_sim.show.viewer.driver import Driver


def _keys(keys: tuple[Key, ...]) -> str:
    """The keys of a window, for ``--help``."""
    return "; ".join(f"{name}: {meaning}" for name, meaning in help_lines(keys))


SpeedOption = Annotated[
    str,
    typer.Option(
        "--speed",
        metavar="FACTOR",
        help="Simulated seconds in a second, such as 0.5; max: as fast as possible.",
    ),
]
SLOWEST, FASTEST = 0.01, 1000.0
"""Speeds that can be asked for."""


@app.command(
    epilog=f"Keys of a scenario: {_keys(VIEW)}. Keys of a saved run: {_keys(REPLAY)}. "
    "The mouse moves the camera."
)
def view(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|RUN_DIR",
            help="A scenario file or the name of a shipped one; or the folder of a saved run.",
        ),
    ],
    assignments: SetOption = None,
    speed: SpeedOption = "1",
    trust: TrustOption = False,
) -> None:
    """Show a scenario as it runs, or a saved run again, in a window (needs a screen)."""
    pace = _speed(speed)
    is_saved = _is_folder(source)
    if is_saved and assignments:
        raise InputError(Fault(source, "is a saved run; --set is for scenarios"))
    result = ot.load_result(source, trust=trust) if is_saved else None
    scenario = load(source, assignments) if result is None else result.scenario
    from omnitrack_sim.show.viewer.player import Player, Replayer
    from omnitrack_sim.show.viewer.window import Window, require_screen

    require_screen()
    with Window(scenario) as window:
        if result is None:
            Player(scenario, window, pace).play()
        else:
            Replayer(result, window, pace).play()


def _is_folder(source: str) -> bool:
    """Return whether a source is a folder, and not the name of a shipped scenario."""
    try:
        # Otherwise a folder that happens to have the name of a shipped scenario would hide it.
        return Path(source).is_dir() and source not in ot.shipped_files("scenarios")
    except OSError:  # too long, no permission; told by whoever reads it
        return False


@app.command(epilog=f"Keys: {_keys(DRIVE)}. The mouse moves the camera.")
def drive(
    scenario: ScenarioArgument,
    assignments: SetOption = None,
    folder: FolderOption = None,
    speed: SpeedOption = "1",
) -> None:
    """Drive a scenario's robot by keyboard, in a window (needs a screen), and save the run."""
    from omnitrack_sim.base.writing import check_folder
    from omnitrack_sim.results.files import RESULT_FILE
    from omnitrack_sim.scenario.loading import driven_name

    pace = _speed(speed)
    loaded = load(scenario, assignments)
    target = folder or Path("out") / driven_name(loaded.name)
    check_folder(target, RESULT_FILE)
    from omnitrack_sim.show.viewer.driver import Driver
    from omnitrack_sim.show.viewer.window import Window, require_screen

    require_screen()
    with Window(loaded) as window:
        driver = Driver(loaded, window, pace)
        try:
            driver.play()
        finally:  # what has been driven is kept when Ctrl-C ends the window, too
            _save(driver, target)


def _save(driver: Driver, target: Path) -> None:
    """Save the driven run with its plots, and print its outcome."""
    if not driver.driven:
        out.print("nothing was driven, and nothing is saved")
        return
    result = driver.result()
    result.save(target)
    draw(result, target, None, quiet=False)
    print_result(result, target)


def _speed(text: str) -> float:
    """Simulated over wall seconds, of ``--speed``."""
    if text == "max":
        return math.inf
    try:
        speed = float(text)
    except ValueError:
        # A number that fails every comparison leads to the same message as one out of range.
        speed = math.nan
    if not SLOWEST <= speed <= FASTEST:
        problem = f"is {text!r}; it must be a number from {SLOWEST:g} to {FASTEST:g}, or max"
        raise InputError(Fault("--speed", problem))
    return speed
