"""Sweeps read back from their folders, finished or not."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pyarrow as pa

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.bounds import MAX_RUN_BYTES
from omnitrack_sim.base.errors import InputError, OutputError, SweepError
from omnitrack_sim.base.naming import NotTrustedError, trusting
from omnitrack_sim.base.reading import checked, parsed, read_bytes
from omnitrack_sim.base.writing import whole
from omnitrack_sim.results.files import read_table
from omnitrack_sim.scenario import read_back
from omnitrack_sim.trials.run import Status, TrialsResult
from omnitrack_sim.trials.store import SUMMARY, TRIALS, read_part, read_record, record_name
from omnitrack_sim.trials.sweep import Sweep, SweepTable, hash_of
from omnitrack_sim.trials.table import trials_table


def load_sweep_result(directory: str | Path, *, trust: bool = False) -> TrialsResult:
    """Read the result of a sweep back from its folder; of an unfinished one, the trials done.

    Nothing is run and nothing is written.

    Args:
        directory: folder of the sweep, as ``run_trials`` or ``omnitrack sweep`` left it.
        trust: import what its scenarios name, and read a robot's own file, to run its trials
            again. Without it a robot from outside the package is known by what the folder keeps.

    Raises:
        OutputError: it holds no sweep, or its record or table is damaged; the message names the
            file.

    Example:
        >>> sweep = ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01})
        >>> _ = ot.run_trials(sweep, out="sweep", shard=(1, 4))
        >>> ot.load_sweep_result("sweep").status
        Status(total=120, found=32, done=32, successes=0, lost=0, stage='', batch=32)
    """
    folder = whole(directory)
    with trusting(None if trust else ()):
        sweep = _sweep_in(folder)
    table = _whole_table(folder, sweep)
    summary = {} if table is None else _summary(folder, sweep)
    if table is None:
        table = _table_of_parts(folder, sweep)
    done, passed = table.num_rows, sum(table["success"].to_pylist())
    batch = min(sweep.batch, sweep.size)
    status = Status(sweep.size, found=done, done=done, successes=passed, batch=batch)
    return TrialsResult(sweep, {TRIALS: table}, summary, status, folder)


def as_sweep_result(
    result: TrialsResult | str | os.PathLike[str], trust: bool = False
) -> TrialsResult:
    """Return the result of a sweep itself, or load the one in a sweep's folder.

    Raises:
        OutputError: the folder holds no sweep. TypeError: it is neither result nor folder.
    """
    if isinstance(result, str | os.PathLike):
        return load_sweep_result(Path(result), trust=trust)
    return check_is(TrialsResult, "result", result)


def _sweep_in(folder: Path) -> Sweep:
    """Return the sweep that a folder is of."""
    name = record_name(Sweep)
    if not folder.is_dir():
        raise OutputError(f"{folder}: {'is a file' if folder.exists() else 'no such folder'}")
    if not (folder / name).is_file():
        raise OutputError(f"{folder}: holds no sweep: {name} is missing")
    record = read_record(folder, Sweep.noun)
    data = record[Sweep.noun]
    try:
        # Before anything is made of it.
        if hash_of(data) != record["sha256"]:
            raise ValueError("it is not the sweep of its hash")
        robots = dict(record.get("robots", {}))
        bases = {
            name: read_back(base, {"file": "", "values": robots[name]} if name in robots else None)
            for name, base in data["bases"].items()
        }
        keys = {key: value for key, value in data.items() if key in SweepTable.model_fields}
        table = checked(SweepTable, keys, SweepError)
        fields = {key: getattr(table, key) for key in SweepTable.model_fields}
        return Sweep(**fields, bases=bases, set=dict(data["set"]))
    except NotTrustedError as error:
        raise OutputError(f"{folder / name}: {error}") from error
    except (ValueError, KeyError, TypeError, AttributeError, InputError) as error:
        cause = "; ".join(str(error).splitlines())
        problem = f"is damaged, or names what is not here: {cause}"
        raise OutputError(f"{folder / name}: {problem}") from error


def _whole_table(folder: Path, sweep: Sweep) -> pa.Table | None:
    """Return the table of all trials; None of a sweep that is not finished."""
    file = folder / f"{TRIALS}.parquet"
    if not file.is_file():
        return None
    try:
        table = read_table(file, sweep.size)
        metadata = table.schema.metadata or {}
    except Exception as error:  # decoders raise anything on damaged bytes
        raise OutputError(f"{file}: is damaged: {error}; {_AGAIN}") from error
    if metadata.get(b"sha256") != sweep.hash.encode() or table.num_rows != sweep.size:
        raise OutputError(f"{file}: is of another sweep; {_AGAIN}")
    return table


def _summary(folder: Path, sweep: Sweep) -> dict[str, Any]:
    file = folder / SUMMARY
    try:
        summary = dict(parsed(read_bytes(file, MAX_RUN_BYTES).decode(), "JSON"))
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise OutputError(f"{file}: cannot be read: {error}; {_AGAIN}") from error
    if summary.get("sha256") != sweep.hash:
        raise OutputError(f"{file}: is of another sweep; {_AGAIN}")
    return summary


_AGAIN = "the command that ran the sweep makes it anew from the batches"


def _table_of_parts(folder: Path, sweep: Sweep) -> pa.Table:
    """Return the trials of the batches that are done, in order."""
    read = [(batch, read_part(folder, batch)) for batch in sweep.batches()]
    done = [(batch, part) for batch, part in read if part is not None]
    batches, parts = [batch for batch, _ in done], [part for _, part in done]
    return trials_table(batches, parts, sweep.trials(), sweep.units)
