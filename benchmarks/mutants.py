"""Changes one line of the program at a time and looks whether the tests notice.

python benchmarks/mutants.py [--quick] [--only NAME ...] [--jobs N] [--results FILE]

The changes stand in benchmarks/mutations/, a file a field. Each is made in a copy of the checkout
in a temporary folder. The test files that are likeliest to notice run first, and all others where
these pass. Before that the same files run on the program as it is, and have to pass. Verdicts are
kept in the results file; a run that is broken off goes on from there, as long as neither program
nor tests have changed.

Ends with status 1 if more than 3 of the 67 are not caught, if a change that is not caught has no
explanation, or, of a part of the changes, if more than 3 are not caught.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

from omnitrack_sim.base.text import no_such

ROOT = Path(__file__).resolve().parents[1]
MUTATIONS = Path(__file__).with_name("mutations")
MAX_MISSED = 3
"""How many changes may go unnoticed."""
QUICK = (
    "turning_sign",
    "slip_turned_round",
    "tilt_at_the_start",
    "braking_never_saturates",
    "no_cap_on_belts",
    "ways_counted_in_joints",
)
"""Changes of the quick form; their test files take seconds."""
PATIENCE = 1800.0
"""Seconds after which tests that go on for ever count as having noticed."""
NOTICED = (1, 2)
"""Exit status of pytest when tests failed, and when a test file could not even be read."""


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        name: of the change. file: below the checkout.
        old: the line as it is, without indentation; it stands there exactly once.
        new: the line in its place.
        breaks: what is wrong then.
        tests: the test files that are likeliest to notice.
        unnoticed: why the tests need not notice it; empty where they have to.
    """

    name: str
    file: str
    old: str
    new: str
    breaks: str
    tests: tuple[str, ...]
    unnoticed: str = ""

    def apply(self, text: str) -> str:
        """The text of the file with the line changed.

        Raises:
            ValueError: the line does not stand there exactly once.
        """
        lines = text.splitlines(keepends=True)
        at = [i for i, line in enumerate(lines) if line.strip() == self.old]
        if len(at) != 1:
            raise ValueError(f"{self.name}: the line stands {len(at)} times in {self.file}")
        lines[at[0]] = lines[at[0]].replace(self.old, self.new)
        return "".join(lines)


@dataclass(frozen=True)
class Verdict:
    """What became of one change: the test that noticed it, or "" where none did."""

    by: str
    seconds: float


def load(folder: Path = MUTATIONS) -> list[Mutant]:
    """All changes, in the order of their files."""
    rows = [
        row
        for path in sorted(folder.glob("*.toml"))
        for row in tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    ]
    return [Mutant(**row | {"tests": tuple(row["tests"])}) for row in rows]


def main() -> int:
    """Choose, try, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a few, and their likeliest tests")
    parser.add_argument("--named", action="store_true", help="the likeliest tests only")
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", help="these changes; the files in mutations/ name them"
    )
    parser.add_argument("--jobs", type=int, default=1, help="changes tried at a time")
    parser.add_argument("--results", type=Path, default=Path("out/mutants.json"), metavar="FILE")
    given = parser.parse_args()
    every = load()
    names = given.only or (QUICK if given.quick else [mutant.name for mutant in every])
    known = [mutant.name for mutant in every]
    unknown = [name for name in names if name not in known]
    if unknown:
        parser.error(f"--only: {no_such(unknown[0], known, 'change ')}")
    chosen = [mutant for mutant in every if mutant.name in names]
    with tempfile.TemporaryDirectory(prefix="mutants.") as place:
        trial = Trial(Path(place), given.jobs, given.quick or given.named)
        if not trial.unchanged_passes(chosen):
            return 2
        verdicts = try_all(chosen, trial, given.jobs, given.results)
    return report(chosen, verdicts)


def try_all(chosen: Sequence[Mutant], trial: Trial, jobs: int, results: Path) -> dict[str, Verdict]:
    """The verdicts of all changes by their names; those in ``results`` are not asked for again."""
    key = f"{digest()}{' named' if trial.named_only else ''}"
    kept = read_results(results, key)
    verdicts = {mutant.name: kept[mutant.name] for mutant in chosen if mutant.name in kept}
    missing = [mutant for mutant in chosen if mutant.name not in verdicts]
    with ThreadPoolExecutor(jobs) as pool:
        for mutant, verdict in zip(missing, pool.map(trial.of, missing), strict=True):
            verdicts[mutant.name] = verdict
            told = f"caught by {verdict.by}" if verdict.by else "NOT CAUGHT"
            print(f"{mutant.name}: {told} ({verdict.seconds:.0f} s)", flush=True)
            write_results(results, key, kept | verdicts)
    return verdicts


class Trial:
    """Copies of the checkout, in which one change at a time is made and tested."""

    def __init__(self, place: Path, jobs: int, named_only: bool) -> None:
        self.named_only = named_only
        self._place = place
        # One path for many copies: what the exact collider has compiled is found again.
        self._free: Queue[Path] = Queue()
        for number in range(jobs):
            self._free.put(place / f"copy_{number}")

    def unchanged_passes(self, chosen: Sequence[Mutant]) -> bool:
        """Whether the tests pass on the program as it is, told where they do not."""
        named = sorted({name for mutant in chosen for name in mutant.tests})
        files = named if self.named_only else every_test_file()
        copy = self._free.get()
        fill(copy)
        found = self._run(copy, files)
        self._free.put(copy)
        if found:
            print(f"the tests do not pass on the program as it is: {found}")
        return not found

    def of(self, mutant: Mutant) -> Verdict:
        """Make one change and run the tests, the likeliest first."""
        begin = time.monotonic()
        copy = self._free.get()
        try:
            fill(copy)
            file = copy / mutant.file
            changed = mutant.apply(file.read_text(encoding="utf-8"))
            compile(changed, mutant.file, "exec")
            file.write_text(changed, encoding="utf-8")
            self._is_imported(copy, mutant.file)
            found = self._run(copy, mutant.tests)
            if not found and not self.named_only:
                others = [name for name in every_test_file() if name not in mutant.tests]
                found = self._run(copy, others)
        finally:
            self._free.put(copy)
        return Verdict(found, time.monotonic() - begin)

    def _environment(self, copy: Path) -> dict[str, str]:
        """The copy's package goes before one that is installed, and leaves no trace in it."""
        more = {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(self._place / "numba")}
        return os.environ | more | {"PYTHONDONTWRITEBYTECODE": "1"}

    def _is_imported(self, copy: Path, file: str) -> None:
        """Make sure that the changed file is the one that tests import."""
        module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        ask = f"from importlib.util import find_spec; print(find_spec({module!r}).origin)"
        command = [sys.executable, "-c", ask]
        told = subprocess.run(
            command, cwd=copy, env=self._environment(copy), capture_output=True, text=True
        )
        if told.stdout.strip() != str(copy / file):
            raise RuntimeError(f"tests would import {told.stdout.strip() or told.stderr}")

    def _run(self, copy: Path, files: Sequence[str]) -> str:
        """The first test of ``files`` that fails, or "" where all pass.

        Raises:
            RuntimeError: pytest could not run.
        """
        options = ["-x", "-q", "--no-header", "--tb=no", "-rfE", "-p", "no:cacheprovider"]
        paths = [f"tests/{name}" for name in files]
        with tempfile.TemporaryDirectory(prefix="tmp.", dir=self._place) as base:
            command = [sys.executable, "-m", "pytest", *options, f"--basetemp={base}/t", *paths]
            status, told = run_in_a_group(command, copy, self._environment(copy))
        if status is None:
            return f"tests that did not end in {PATIENCE:.0f} s"
        if status == 0:
            return ""
        failed = re.search(r"^(?:FAILED|ERROR) tests/(\S+)", told, flags=re.MULTILINE)
        if status not in NOTICED or failed is None:
            raise RuntimeError(f"pytest ended with {status}:\n{told}")
        return failed[1]


def run_in_a_group(
    command: Sequence[str], folder: Path, environment: dict[str, str]
) -> tuple[int | None, str]:
    """Exit status of a command, None where it took too long, and what it printed.

    Whatever it has started ends with it: a changed program may forget its workers.
    """
    # To a file: a pipe would be held open by those that are left.
    with tempfile.TemporaryFile("w+") as told:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdout=told,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        status: int | None = None
        try:
            with suppress(subprocess.TimeoutExpired):
                status = process.wait(PATIENCE)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        told.seek(0)
        return status, told.read()


def every_test_file() -> list[str]:
    """Names of all test files of the checkout, but for the one of the list of changes itself.

    That one would know each of them by its text.
    """
    names = sorted(path.name for path in (ROOT / "tests").glob("test_*.py"))
    return [name for name in names if name != "test_mutants.py"]


def files_of_checkout() -> list[str]:
    """Files that belong to the checkout, below it: those that git knows, or would take."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def fill(copy: Path) -> None:
    """Copy the checkout to ``copy``, with the times of its files; what was there goes."""
    shutil.rmtree(copy, ignore_errors=True)
    for name in files_of_checkout():
        target = copy / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)


def digest() -> str:
    """Of the program, its tests and the changes: verdicts hold for these."""
    parts = ("omnitrack_sim/", "tests/", "benchmarks/mutations/", "scenarios/")
    found = hashlib.sha256()
    for name in sorted(files_of_checkout()):
        if name.startswith(parts):
            found.update(name.encode() + b"\0" + (ROOT / name).read_bytes())
    return found.hexdigest()[:16]


def read_results(path: Path, key: str) -> dict[str, Verdict]:
    """Verdicts of an earlier run of the same program and tests; none where there are no such."""
    if not path.is_file():
        return {}
    data = json.loads(path.read_text(encoding="utf-8"))
    return {name: Verdict(**row) for name, row in data.get(key, {}).items()}


def write_results(path: Path, key: str, verdicts: dict[str, Verdict]) -> None:
    """Keep verdicts; those of another program are dropped."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = {name: vars(verdict) for name, verdict in verdicts.items()}
    path.write_text(json.dumps({key: rows}, indent=2) + "\n", encoding="utf-8")


def report(chosen: Sequence[Mutant], verdicts: dict[str, Verdict]) -> int:
    """Print a row a change, and the exit status."""
    missed = [mutant for mutant in chosen if not verdicts[mutant.name].by]
    print("\n| change | what it breaks | caught by |\n|---|---|---|")
    for mutant in chosen:
        by = verdicts[mutant.name].by or f"not caught: {mutant.unnoticed or 'UNEXPLAINED'}"
        print(f"| {mutant.name} | {mutant.breaks} | {by} |")
    print(f"\n{len(chosen) - len(missed)} of {len(chosen)} caught")
    unexplained = [mutant.name for mutant in missed if not mutant.unnoticed]
    return 1 if len(missed) > MAX_MISSED or unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
