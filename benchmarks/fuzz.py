"""Tries odd files, damaged folders and odd arguments, and tells what stumbles.

python benchmarks/fuzz.py [--quick] [--only files|folders|arguments] [--seed S ...] [--case N] ...

Files are scenarios, networks, sweeps, studies and suites. Folders are those of runs, sweeps,
studies, benches and passports, and single files of others: passports, policies, models of robots
(MJCF), towns (.inp), plants (.pcf) and scans of pipes (.csv).

Every case is made from the seed and its number, so a fault can be had again: --seed 1 --only files
--case 17. A fault is any exception that is not of the package's own, a refusal that names no place,
a warning, a message of over 10 kB, control characters on the screen, a file left behind, more than
5 s of processor time to read a file, or a process that dies. Files of the faults are kept. Ends
with status 1 where there is one.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fuzzing.faults import Fault, grouped
from fuzzing.watch import watched

PARTS = ("files", "folders", "arguments")


def main() -> int:
    """Try what the options ask for."""
    given = _options()
    found: list[tuple[str, Fault]] = []
    for part in PARTS if given.only is None else (given.only,):
        start = time.perf_counter()
        numbers = [given.case] if given.case is not None else range(getattr(given, part))
        faults = [
            fault for seed in given.seed for fault in try_all(part, numbers, seed, given.keep)
        ]
        found += faults
        bad = len({case for case, _ in faults})
        print(
            f"{part}: {len(numbers) * len(given.seed)} cases of seed "
            f"{', '.join(map(str, given.seed))} in {time.perf_counter() - start:.0f} s, "
            f"{bad} with a fault",
            flush=True,
        )
    for fault, cases in grouped(found):
        print(
            f"\n{fault.what} in {fault.place}: {len(cases)} cases, such as {', '.join(cases[:3])}"
        )
        print(f"  {fault.detail}")
    return 1 if found else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="about a minute")
    parser.add_argument("--files", type=int, metavar="N")
    parser.add_argument("--folders", type=int, metavar="N")
    parser.add_argument("--arguments", type=int, metavar="N")
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--case", type=int, metavar="N", help="only the case of this number")
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"), help="for files of faults")
    given = parser.parse_args()
    for part, (short, whole) in {
        "files": (120, 3000),
        "folders": (60, 500),
        "arguments": (40, 400),
    }.items():
        if getattr(given, part) is None:
            setattr(given, part, short if given.quick else whole)
    return given


def try_all(part: str, numbers: Sequence[int], seed: int, keep: Path) -> list[tuple[str, Fault]]:
    """Try the cases of one part; the faults with the names of their cases."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from fuzzing import arguments, folders, reading

    tries = {"files": reading, "folders": folders, "arguments": arguments}[part]
    tries.prepare()
    found: list[tuple[str, Fault]] = []
    seen = set[tuple[str, str]]()
    for number, faults in watched(lambda n, desk: tries.attempt(seed, n, desk), numbers):
        case = f"--seed {seed} --only {part} --case {number}"
        found += [(case, fault) for fault in faults]
        for fault in faults:
            if (fault.what, fault.place) not in seen:
                print(f"  {case}: {fault.what} in {fault.place}", flush=True)
            seen.add((fault.what, fault.place))
        if faults:
            tries.keep(seed, number, keep.resolve())
            _note(keep / "faults.jsonl", case, faults)
    return found


def _note(path: Path, case: str, faults: Sequence[Fault]) -> None:
    """Add the faults of a case to a list, one line of JSON each."""
    with path.open("a", encoding="utf-8") as file:
        for fault in faults:
            file.write(json.dumps({"case": case, **vars(fault)}) + "\n")


if __name__ == "__main__":
    sys.exit(main())
