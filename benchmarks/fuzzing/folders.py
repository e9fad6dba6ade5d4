"""What is done with a damaged folder: read it, and go on with what is accepted."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from fuzzing import bases
from fuzzing.damage import damaged, removed
from fuzzing.desk import Desk

if TYPE_CHECKING:
    from omnitrack_sim import Result

READING, DRAWING = 5.0, 30.0
"""Seconds of processor time that reading may take, and pictures or the rest of a sweep."""
SWEEPS, WHOLE = 0.25, 0.02
"""Part of the folders that are sweeps, and part of which the folder as a whole is hit."""
PLOTTED, FILMED = 6, 40
"""Every which run that was read is plotted, and filmed."""


def prepare() -> None:
    """Load what the cases need, and make the folders."""
    from fuzzing import reading

    reading.prepare()
    bases.runs()
    bases.sweeps()


def laid_out(seed: int, number: int, folder: Path) -> tuple[str, str]:
    """Make the damaged folder of that number; its kind, run or sweep, and what was done to it."""
    rng = random.Random(f"folder {seed} {number}")
    kind = "sweep" if rng.random() < SWEEPS else "run"
    known = bases.sweeps() if kind == "sweep" else bases.runs()
    name, other = rng.sample(sorted(known), 2)
    bases.lay_out(known[name], folder)
    if rng.random() < WHOLE:
        return kind, f"{name}: {removed(rng, folder)}"
    others = {Path(path).name: data for path, data in known[other].items()}
    story = damaged(rng, folder, others, rng.choice((1, 1, 1, 2)))
    return kind, f"{name}: {'; '.join(story)}"


def attempt(seed: int, number: int, desk: Desk) -> None:
    """Read the folder of that number, and go on with it as far as it gets."""
    kind, _ = laid_out(seed, number, desk.folder / "it")
    if kind == "sweep":
        _try_sweep(desk)
    else:
        _try_run(number, desk)


def keep(seed: int, number: int, folder: Path) -> None:
    """Keep the folder of a case."""
    place = folder / f"folder_{seed}_{number}"
    shutil.rmtree(place, ignore_errors=True)
    _, story = laid_out(seed, number, place / "it")
    (place / "story.txt").write_text(f"{story}\n", encoding="utf-8", errors="replace")


def _try_run(number: int, desk: Desk) -> None:
    from omnitrack_sim import OmnitrackError, load_result

    folder = desk.folder / "it"
    result, error = desk.attempt(
        "load_result", READING, lambda: load_result(folder), OmnitrackError
    )
    if error is not None:
        desk.command(["render", "it", "--out", "film.mp4"], READING, (2,))
        desk.only("refusing a run", "it")
    if result is None:
        return
    uses = {
        "timeline": result.timeline,
        "repr": lambda: repr(result),
        "summary": lambda: json.dumps(result.summary()),
        "phase_spans": result.trajectory.phase_spans,
        "routes": result.routes,
        "save": lambda: load_result(result.save(desk.folder / "again")),
    }
    for name, use in uses.items():
        desk.attempt(f"a run that was read: {name}", READING, use, OmnitrackError)
        if desk.faults:
            return
    if number % PLOTTED == 0:
        desk.attempt(
            "a run that was read: plots", DRAWING, lambda: _draw(result, desk), OmnitrackError
        )
    if number % FILMED == 0:
        desk.command(["render", "it", "--out", "film.mp4"], DRAWING)
    desk.only("using a run", "it", "again", "summary.png", "map.png", "film.mp4")


def _draw(result: Result, desk: Desk) -> None:
    from omnitrack_sim import plot_mission, plot_summary

    plot_summary(result, path=desk.folder / "summary.png")
    plot_mission(result, path=desk.folder / "map.png")


def _try_sweep(desk: Desk) -> None:
    """Go on with a damaged sweep: a clean error, or the table that it would have had."""
    from omnitrack_sim import OmnitrackError, run_trials

    result, _ = desk.attempt(
        "run_trials",
        DRAWING,
        lambda: run_trials(bases.sweep(), out=desk.folder / "it"),
        OmnitrackError,
    )
    desk.only("resuming a sweep", "it")
    if result is not None and result.table.num_rows != bases.sweep().size:
        desk.add("rows lost", "run_trials", f"{result.table.num_rows} rows")
    left = [p.name for p in (desk.folder / "it").rglob(".*")] if result is not None else []
    if left:
        desk.add("left behind", "run_trials", ", ".join(left))
