"""Runs a sweep: the batches that are missing, and then the files of the whole."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError, SweepError
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.trials.batches import ERROR, INVALID, Batch
from omnitrack_sim.trials.dispatch import MakeExecutor, Pool, Progress, all_found, run_missing
from omnitrack_sim.trials.store import Folder, Layout, Memory, made_by
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_figure import draw_map

if TYPE_CHECKING:
    import pyarrow as pa
if TYPE_CHECKING:
    import pyarrow as pa


_TOLD_REASONS = 3


def run_sweep(
    sweep: Sweep,
    directory: str | Path | None = None,
    *,
    executor: Executor | MakeExecutor | None = None,
    shard: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> pa.Table:
    """Run the trials that are not done yet.

    Args:
        sweep: what to run.
        directory: where part files and table are written, and part files of earlier runs are found;
            without one nothing is written.
        executor: runs the batches; without one this process does. A callable makes one, and is
            asked again when workers die. An executor given as such is left open.
        shard: (i, n), i from 1: run only every n-th batch. The shard that finishes last writes the
            files of the whole.
        progress: called with the ``Status`` at the beginning and after each batch.

    Returns:
        One row for each trial, in order: the whole sweep if all batches are done, else the trials
            of this shard.

    Raises:
        SweepError: all trials are invalid.
        InputError: no such shard.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.
    """
    check_is(Sweep, "sweep", sweep)
    layout, batches = Layout(sweep), sweep.batches()
    mine = batches if shard is None else batches[_checked(shard)[0] - 1 :: shard[1]]
    store: Folder | Memory = Memory() if directory is None else Folder(directory, sweep, layout)
    if isinstance(store, Folder):
        table = _finished(sweep, store)
        if table is not None:
            if progress is not None:
                progress(all_found(table))
            return table
    with Pool(executor) as pool:
        run_missing(mine, store, layout, pool, progress)
    return _finish(sweep, batches, mine, store, layout)


def _finished(sweep: Sweep, folder: Folder) -> pa.Table | None:
    """The table of a sweep that is finished, with a summary that tells it as it is now; None where
    it has to be made from the batches."""
    table, there = folder.finished(), folder.summary()
    try:
        makers = {json.dumps(maker, sort_keys=True) for maker in there["provenance"]["made_by"]}
    except (KeyError, TypeError):
        return None
    if table is not None:
        summary = summarise_sweep(sweep, table, makers)
        if folder.renamed or json.loads(json.dumps(summary)) != there:
            folder.finish(table, summary, lambda: draw_map(sweep, table))
    return table


def _checked(shard: tuple[int, int]) -> tuple[int, int]:
    if not 1 <= shard[0] <= shard[1]:
        raise InputError(
            Fault(
                "shard",
                f"is {shard[0]}/{shard[1]}; it must be from 1/{shard[1]} to {shard[1]}/{shard[1]}",
            )
        )
    return shard


def _finish(
    sweep: Sweep,
    batches: Sequence[Batch],
    mine: Sequence[Batch],
    store: Folder | Memory,
    layout: Layout,
) -> pa.Table:
    """Merge the batches; if all are done, write the files of the whole sweep."""
    tables = [store.read(batch) for batch in batches]
    present = [table for table in tables if table is not None]
    if len(present) < len(batches):
        numbers = {batch.number for batch in mine}
        own = [
            table
            for batch, table in zip(batches, tables, strict=True)
            if table is not None and batch.number in numbers
        ]
        return layout.merged(own)
    table = layout.merged(present)
    _refuse_all_invalid(table)
    if isinstance(store, Folder):
        summary = summarise_sweep(sweep, table, {made_by(found) for found in present})
        store.finish(table, summary, lambda: draw_map(sweep, table))
    return table


def _refuse_all_invalid(table: pa.Table) -> None:
    if set(table["outcome"].to_pylist()) == {INVALID}:
        reasons = list(dict.fromkeys(table["reason"].to_pylist()))
        raise SweepError(
            [
                Fault("axes", f"none of {counted(table.num_rows, 'trial')} is valid"),
                *(Fault("", r) for r in reasons[:_TOLD_REASONS]),
            ]
        )


def summarise_sweep(sweep: Sweep, table: pa.Table, makers: Collection[str]) -> dict[str, Any]:
    """The contents of ``summary.json``.

    Rates are over the trials that ran to an outcome: ``invalid`` and ``error`` are counted, but not
    in the rates.

    Args:
        sweep: the sweep that ran.
        table: all trials.
        makers: versions and commits that the batches were made by, as JSON.
    """
    outcomes = table["outcome"].to_pylist()
    columns = sweep.trials()
    groups = {}
    for name in sweep.groups:
        members: dict[str, list[str]] = {
            sweep.label(name, value): [] for value in sweep.crossed[name]
        }
        for value, outcome in zip(columns[name], outcomes, strict=True):
            members[sweep.label(name, value)].append(outcome)
        groups[name] = [{"value": label, **_rate(found)} for label, found in members.items()]
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
    """Numbers of trials and successes, and the success rate with its Wilson 95 % interval.

    The rate is None if no trial counts.
    """
    counts = Counter(outcomes)
    counted = len(outcomes) - counts[INVALID] - counts[ERROR]
    passed = counts[Outcome.REACHED_GOAL]
    low, high = wilson_interval(passed, counted)
    return {
        "trials": len(outcomes),
        "invalid": counts[INVALID],
        "error": counts[ERROR],
        "counted": counted,
        "successes": passed,
        "success_rate": passed / counted if counted else None,
        "success_rate_95": [low, high],
    }
