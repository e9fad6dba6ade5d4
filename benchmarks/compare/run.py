"""The same robot, jobs and controller on other ways to simulate the pipe wall.

python benchmarks/compare/run.py [--quick] [--out DIR] [--peer NAME]... [--job NAME]...

Tries the settings of each peer on each job, takes the best (it finishes, then its wall error, then
its speed), and times these and all entries of this package again, in turns, on one thread. Writes
compare.json, compare.md and compare.svg.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import mujoco
from entries import NEEDS, OWN, TITLES, Work, entries, missing
from measure import PARTS, Case, settle
from report import best, plot, ratio, tables

from omnitrack_sim import load_scenario, override


def compare(options: argparse.Namespace) -> dict[str, Any]:
    """Measure, and return what goes into the JSON file.

    Rows and cases stay objects under ``rows`` and ``tried``.
    """
    notes = []
    peers = []
    for peer in options.peer or TITLES:
        reason = missing(peer)
        if reason is None:
            peers.append(peer)
        else:
            notes.append(f"{TITLES[peer]} is left out: {reason}")
            print(notes[-1], flush=True)
    work = Work(options.out / "pieces", options.decompose_limit)
    listed = entries(work, tuple(peers), options.quick)
    chosen: list[Case] = []
    tried = []
    for job in options.job or PARTS:
        scenario = override(load_scenario(job), {"physics.collider": "primitives"})
        if options.quick:
            scenario = override(scenario, {"run.time_limit": options.quick_time})
        for peer in peers:
            cases = [Case.of(e, job, scenario, options.probes) for e in listed if e.peer == peer]
            for case in cases:
                case.drive(options.budget)
                tried.append(dataclasses.replace(case.row))
                print(_told(case), flush=True)
            if peer in OWN:
                chosen += cases
            elif cases:
                top = best([case.row for case in cases])
                chosen.append(next(case for case in cases if case.row is top))
    rows = _timed(chosen, options)
    return {"rows": rows, "tried": tried, "notes": notes}


def _timed(cases: list[Case], options: argparse.Namespace) -> list[Any]:
    """All cases again, in turns, so that what else the machine does falls on all alike."""
    repeats: dict[int, list[Any]] = {
        index: [dataclasses.replace(c.row)] for index, c in enumerate(cases)
    }
    for _ in range(options.repeats - 1):
        for index, case in enumerate(cases):
            if case.row.error is None and case.row.outcome != "out_of_budget":
                case.drive(options.budget)
                repeats[index].append(dataclasses.replace(case.row))
    return [settle(found) for found in repeats.values()]


def _told(case: Case) -> str:
    row = case.row
    if row.error is not None:
        return f"{row.job:12s} {case.entry.name}: {row.error}"
    return (
        f"{row.job:12s} {case.entry.name}: {row.outcome} at {row.progress_m:.2f} m, wall "
        f"{row.wall_error_max_mm:.3f} mm, "
        f"{row.step_speed:.2f} simulated s a CPU s, {row.contacts_per_lug:.2f} contacts a lug"
    )


def machine() -> dict[str, Any]:
    """The machine and the versions."""
    versions = {"mujoco": mujoco.__version__}
    for package in NEEDS.values():
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "versions": versions,
    }


def finite(value: Any) -> Any:
    """``value`` with None for what JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def options_of() -> argparse.Namespace:
    """The command's options; numbers that are not given depend on ``--quick``."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one setting a peer, short runs")
    parser.add_argument(
        "--quick-time", type=float, default=0.4, help="simulated seconds of a quick run"
    )
    parser.add_argument("--out", type=Path, default=Path("out/compare"))
    parser.add_argument("--peer", action="append", choices=list(TITLES))
    parser.add_argument("--job", action="append", choices=list(PARTS))
    parser.add_argument(
        "--probes", type=int, default=None, help="probes of a wall; 2000, or 300 with --quick"
    )
    parser.add_argument(
        "--repeats", type=int, default=None, help="timed runs; 3, or 1 with --quick"
    )
    parser.add_argument(
        "--budget", type=float, default=None, help="CPU seconds of a run; 20, or 3 with --quick"
    )
    parser.add_argument(
        "--decompose-limit", type=float, default=None, help="seconds CoACD may take a fitting"
    )
    options = parser.parse_args()
    for name, full, quick in (
        ("probes", 2000, 300),
        ("repeats", 3, 1),
        ("budget", 20, 3),
        ("decompose_limit", 90, 15),
    ):
        if getattr(options, name) is None:
            setattr(options, name, quick if options.quick else full)
    return options


def main() -> None:
    """Compare, and write the results."""
    options = options_of()
    options.out.mkdir(parents=True, exist_ok=True)
    found = compare(options)
    rows, tried = found["rows"], found["tried"]
    data = {
        "machine": machine(),
        "quick": options.quick,
        "best": [
            dataclasses.asdict(r) | {"ratio": ratio(r, rows) if r.peer not in OWN else None}
            for r in rows
        ],
        "tried": [dataclasses.asdict(r) for r in tried],
        "notes": found["notes"],
    }
    (options.out / "compare.json").write_text(
        json.dumps(finite(data), indent=1) + "\n", encoding="utf-8"
    )
    text = tables(rows, tried, found["notes"])
    (options.out / "compare.md").write_text(text, encoding="utf-8")
    plot(
        rows,
        "tee_turn" if any(r.job == "tee_turn" for r in rows) else rows[0].job,
        options.out / "compare.svg",
    )
    print(text)


if __name__ == "__main__":
    main()
