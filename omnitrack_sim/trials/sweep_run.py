"""Sweep runs: the missing trials, then table, summary and figure of the whole."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError, SweepError
from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.kinds import DEFAULT
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.scenario.model import unit_of, words_of
from omnitrack_sim.show.plots.style import chart, figure_bytes, page
from omnitrack_sim.show.plots.success import (
    CHART,
    SingularRange,
    Spread,
    draw_chart,
    groups_of,
    sweep_figure,
)
from omnitrack_sim.trials.axes import DirectionAxis
from omnitrack_sim.trials.batches import ERROR, INVALID
from omnitrack_sim.trials.dispatch import Engine, MakeExecutor, Progress, Status
from omnitrack_sim.trials.store import (
    PARTS,
    Folder,
    Store,
    TrialColumns,
    made_by,
    passed_of,
    refuse_all_invalid,
    to_csv,
    to_json,
    to_parquet,
)
from omnitrack_sim.trials.sweep import FOR_THE_RECORD, Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TABLE_FILE, CSV_FILE, SUMMARY_FILE = "trials.parquet", "trials.csv", "summary.json"
ALONG = 1 / 3
"""Components of a unit vector along the run axis, from - to + this, that count as across.

Each of the three classes has a third of the sphere.
"""
CLASSES = ("against the run axis", "across", "along")


class SweepFolder(Folder):
    """The folder of a sweep."""

    noun = "sweep"
    files = (TABLE_FILE, CSV_FILE, SUMMARY_FILE, "success_map.png")
    folders = (PARTS,)
    digits = 6
    free = FOR_THE_RECORD


@dataclass(frozen=True, eq=False)
class SweepResult:
    """Result of a sweep.

    Attributes:
        sweep: that was run.
        table: one row for each trial, in order: of the whole sweep, or of what was run here if
            other shares of it are missing.
        status: how many trials there are, were found done, and are done now.
        folder: of the files; None if nothing was written.
        summary: as in ``summary.json``: counts and success rates; None if shares are missing.

    Example:
        >>> result = ot.run_sweep(ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01}))
        >>> result.table.num_rows, result.status.done, result.summary["outcomes"], result.folder
        (120, 120, {'timed_out': 120}, None)
    """

    sweep: Sweep
    table: pa.Table
    status: Status
    folder: Path | None
    summary: dict[str, Any] | None


def run_sweep(
    sweep: Sweep,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Progress | None = None,
    shard: tuple[int, int] | None = None,
) -> SweepResult:
    """Run the trials of a sweep that are not done yet.

    The table depends on the sweep alone: not on the number of workers, and not on interruptions.

    Args:
        sweep: what to run.
        out: folder of the files; trials of earlier runs are found there. Without one nothing is
            written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, or a callable that makes one, and is called again when workers
            die. An executor given as such is left open.
        progress: called with the ``Status`` at the beginning and after each batch of trials.
        shard: (i, n), i from 1: run only every n-th batch. The shard that finishes last writes the
            files of the whole.

    Raises:
        SweepError: all trials are invalid.
        InputError: no such shard or number of workers.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.

    Example:
        >>> sweep = ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01})
        >>> reports = []
        >>> result = ot.run_sweep(sweep, shard=(1, 4), progress=reports.append)
        >>> [status.done for status in reports], result.table.num_rows
        ([0, 32], 32)
    """
    check_is(Sweep, "sweep", sweep)
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        problem = f"is {shard[0]}/{shard[1]}; it must be from 1/{shard[1]} to {shard[1]}/{shard[1]}"
        raise InputError(Fault("shard", problem))
    batches = sweep.batches()
    # Every n-th batch, not a stretch: neighbouring trials take like times, so shares last as long.
    mine = batches if shard is None else batches[shard[0] - 1 :: shard[1]]
    with Engine(workers, executor, progress) as engine:
        store = sweep_store(sweep, out)
        engine.begin(sum(len(batch.trials) for batch in mine))
        tables = engine.run([(store, batch) for batch in mine])
    folder = store.path if isinstance(store, Folder) else None
    # With shares, others may have run the rest by now, or are still at it.
    known = tables if shard is None else [store.read(batch) for batch in batches]
    whole = [table for table in known if table is not None]
    if len(whole) < len(batches):
        return SweepResult(sweep, store.columns.merged(tables), engine.status, folder, None)
    table = store.columns.merged(whole)
    refuse_all_invalid(table, "axes", "", SweepError)
    summary = finish_sweep(sweep, store, table, {made_by(part) for part in whole})
    return SweepResult(sweep, table, engine.status, folder, summary)


def sweep_store(sweep: Sweep, out: str | Path | None) -> Store:
    """Return the store of a sweep's trials: a folder, or memory where there is none.

    Raises:
        OutputError: the folder holds something else, or cannot be written.
    """
    columns = TrialColumns(sweep.bases.values(), sweep.trials(), {"sweep_sha256": sweep.hash})
    if out is None:
        return Store(columns)
    return SweepFolder(out, sweep.hash, sweep.model_dump(mode="json"), columns)


def finish_sweep(
    sweep: Sweep, store: Store, table: pa.Table, makers: Collection[str], draws: bool = True
) -> dict[str, Any]:
    """Return the summary of a sweep; where its store is a folder, write the files of the whole.

    Args:
        sweep: that ran.
        store: of its batches.
        table: of all trials.
        makers: versions and commits that the batches were made by, as JSON.
        draws: also write the figure.
    """
    summary = summarise_sweep(sweep, table, makers)
    if isinstance(store, Folder):
        files = {
            CSV_FILE: to_csv(table),
            SUMMARY_FILE: to_json(summary),
            TABLE_FILE: to_parquet(table),
        }
        store.finish(files, (lambda: draw_map(sweep, table)) if draws else None)
    return summary


def summarise_sweep(sweep: Sweep, table: pa.Table, makers: Collection[str]) -> dict[str, Any]:
    """Return the contents of ``summary.json``.

    Rates are over the trials that ran to an outcome: ``invalid`` and ``error`` are counted, but not
    in the rates.

    Args:
        sweep: the sweep that ran.
        table: all trials.
        makers: versions and commits that the batches were made by, as JSON.
    """
    outcomes = table["outcome"].to_pylist()
    values = sweep.trials()
    groups = {}
    for name in sweep.groups:
        members: dict[str, list[str]] = {
            sweep.label(name, value): [] for value in sweep.crossed[name]
        }
        for value, outcome in zip(values[name], outcomes, strict=True):
            members[sweep.label(name, value)].append(outcome)
        groups[name] = [{"value": label, **_rate(own)} for label, own in members.items()]
    return {
        "name": sweep.name,
        "sweep_sha256": sweep.hash,
        **_rate(outcomes),
        "outcomes": dict(sorted(Counter(outcomes).items())),
        "groups": groups,
        "provenance": {
            "seed": sweep.seed,
            "sampling": sweep.sampling,
            "samples": sweep.samples,
            "made_by": [json.loads(text) for text in sorted(makers)],
        },
    }


def _rate(outcomes: Collection[str]) -> dict[str, Any]:
    """Numbers of trials and successes, and the success rate with its Wilson 95 % interval."""
    counts = Counter(outcomes)
    # They say nothing of the robot, only of the plan or the program.
    valid = len(outcomes) - counts[INVALID] - counts[ERROR]
    passed = counts[Outcome.REACHED_GOAL]
    low, high = wilson_interval(passed, valid)
    return {
        "trials": len(outcomes),
        "invalid": counts[INVALID],
        "error": counts[ERROR],
        "counted": valid,
        "successes": passed,
        "success_rate": passed / valid if valid else None,
        "success_rate_95": [low, high],
    }


def plot_sweep(
    result: SweepResult,
    path: str | Path | None = None,
    *,
    over: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Plot success over the axes of a sweep.

    Args:
        result: of ``run_sweep``, all trials.
        path: file to write; none: the figure is returned and nothing is written.
        over: one axis of the sweep for the rates over it with Wilson 95 % intervals, or two that
            are numbers for a map; none: as in a sweep's folder (docs/how-to/sweeps.md).
        ax: where to draw one chart; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: trials are missing; no such axis or format; ``ax`` is given, and the sweep has
            more axes than one chart can show; ``path`` is given with ``ax``.
        OutputError: the file cannot be written.

    Example:
        >>> result = ot.run_sweep(ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01}))
        >>> figure = ot.plot_sweep(result)
    """
    sweep = check_is(SweepResult, "result", result).sweep
    if result.table.num_rows != sweep.size:
        problem = f"has {result.table.num_rows} of {counted(sweep.size, 'trial')} of {sweep.name!r}"
        raise InputError(Fault("result", problem))
    passed = passed_of(result.table)
    if over is None and ax is None:
        return page(lambda: _figure(sweep, passed), path, format)
    axes = spreads(sweep)
    chosen, groups = _chosen(axes, over), groups_of(axes)
    return chart(lambda axis: draw_chart(axis, chosen, passed, groups), CHART, path, ax, format)


def _figure(sweep: Sweep, passed: Array) -> Figure:
    case = turn_case(sweep)
    singular = None if case is None else singular_range(case)
    return sweep_figure(spreads(sweep), passed, singular, sweep.name)


def _chosen(axes: list[Spread], over: str | Sequence[str] | None) -> list[Spread]:
    """Axes of one chart, by their names; all where none are named."""
    by_name = {spread.name: spread for spread in axes}
    names = list(by_name) if over is None else [over] if isinstance(over, str) else [*over]
    for name in names:
        if name not in by_name:
            raise InputError(Fault("over", f"is {name!r}", tuple(by_name), str(name)))
    chosen = [by_name[name] for name in names]
    if len(chosen) not in (1, 2) or (len(chosen) == 2 and any(one.order for one in chosen)):
        problem = "name one axis, or two of numbers, for one chart"
        raise InputError(Fault("over", problem, tuple(by_name)))
    return chosen


def draw_map(sweep: Sweep, table: pa.Table) -> bytes:
    """Draw ``success_map.png``."""
    return figure_bytes(_figure(sweep, passed_of(table)))


def spreads(sweep: Sweep) -> list[Spread]:
    """Return the axes with their values, as numbers or words, one for each trial."""
    axes = []
    axis_of = {axis.name: axis for axis in sweep.axes}
    for name, values in sweep.trials().items():
        axis = axis_of.get(name)
        if isinstance(axis, DirectionAxis):
            # By the angle to the run axis of the first base.
            run_axis = direction_of(next(iter(sweep.bases.values())).start.axis)
            places = np.digitize(direction_of(values) @ run_axis, (-ALONG, ALONG))
            values = [CLASSES[k] for k in places]
            axes.append(Spread(name, "", values, CLASSES, words=words_of(name)))
        elif (
            # By exact type, since a truth value is an integer to isinstance, and has no place on a
            # scale.
            all(type(value) in (int, float) for value in values)
            and getattr(axis, "labels", None) is None
        ):
            numbers = np.array(values, float)
            axes.append(Spread(name, unit_of(name) or "1", numbers, words=words_of(name)))
        else:
            order = tuple(sweep.label(name, value) for value in sweep.crossed[name])
            words = [sweep.label(name, value) for value in values]
            axes.append(Spread(name, "", words, order, compared=True, words=words_of(name)))
    return axes


def singular_range(case: TurnCase) -> SingularRange:
    """Return the range of orientations in which the robot of a case cannot turn."""
    real = float(np.degrees((2 * np.pi / case.modules - case.real_sector) / 2))
    return SingularRange(float(np.degrees(case.sector)), real if real > 0 else None)


def turn_case(sweep: Sweep) -> TurnCase | None:
    """Return robot and tee of the first base; None if its route does not turn in a tee, or the
    robot has no modules that turn it."""
    scenario = next(iter(sweep.bases.values()))
    if scenario.robot.kind != DEFAULT:
        return None
    # Missions are left out: they may turn in several tees.
    for passage in scenario.route.passages if scenario.pipes else ():
        if passage.manoeuvre == "tee_turn":
            return TurnCase(
                pipe_radius=passage.corner_radius,
                turn_angle=passage.description.turn_angle,
                reach=scenario.robot.reach,
                contact_length=scenario.robot.contact_length,
                bend_radius=scenario.control.tee_turn_radius,
            )
    return None
