"""Draw faults of one line, and look whether the tests notice.

python benchmarks/mutants.py --seed S --count N [--room ROOM] [--jobs N] [--tests EXPRESSION]

Each fault is made in a copy of the checkout, and the tests that run its line are run there until
one fails. Which tests these are is measured first, once for each test file. Outcomes are kept in
out/mutants; a run that is broken off goes on from there, as long as neither program nor tests have
changed. Faults that nobody can see stand with the reason in mutants.toml, and do not count.

Ends with status 1 where a fault survives.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import json
import os
import shutil
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from mutating.contexts import Contexts, measuring, tests_of
from mutating.faults import Fault, Program
from mutating.trying import NONE_LEFT, Copy, Run, files_of_checkout, load_libraries

ROOT = Path(__file__).resolve().parents[1]
UNSEEN = Path(__file__).with_suffix(".toml")
FIRST_WAVE = 40, 12
"""Tests, and files of these, that run first: to read all test files takes ten seconds."""


@dataclass(frozen=True)
class Outcome:
    """What became of a fault.

    Attributes:
        seed, number, only_room: it was drawn by. room, file, line, kind: of it.
        diff: what it changes.
        noticed_by: the first test that failed; "" where it survived.
        tests_run, tests: how many tests ran, and how many could notice it.
        seconds: that it took.
        unseen: why nobody can see it, if so.
    """

    seed: int
    number: int
    only_room: str
    room: str
    file: str
    line: int
    kind: str
    diff: str
    noticed_by: str
    tests_run: int
    tests: int
    seconds: float
    unseen: str = ""


def main() -> int:
    """Measure, draw, try, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=20, help="faults that are drawn")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--room", default="", help="a part of the package; none: by lines of code")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--tests", default="not long", help="pytest's expression of markers")
    parser.add_argument("--files", nargs="+", default=[], help="test files; none: all")
    parser.add_argument("--budget", type=float, default=300.0, help="seconds of tests for a fault")
    parser.add_argument("--root", type=Path, default=ROOT, help="another checkout")
    parser.add_argument("--measure", action="store_true", help="measure test files, no more")
    parser.add_argument("--stale", action="store_true", help="measure nothing anew")
    parser.add_argument("--list", action="store_true", help="show the faults that are drawn")
    given = parser.parse_args()
    program = Program(given.root)
    if given.room and given.room not in program.rooms:
        parser.error(f"--room: choose from {', '.join(program.rooms)}")
    numbers = range(given.first, given.first + given.count)
    if given.list:
        for number in numbers:
            print(diff_of(program.draw(given.seed, number, given.room), program))
        return 0
    load_libraries()
    trial = Trial(given, program)
    try:
        trial.measure()
        return 0 if given.measure else report(trial.outcomes(numbers))
    finally:
        trial.close()


class Trial:
    """Faults, each made in one of as many copies as are tried at a time."""

    def __init__(self, given: argparse.Namespace, program: Program) -> None:
        self._given, self._program = given, program
        self._place = given.root / "out" / "mutants"
        self.contexts = Contexts(given.root, self._place / "contexts")
        names = given.files or sorted(p.name for p in (given.root / "tests").glob("test_*.py"))
        self._test_files = [f"tests/{Path(name).name}" for name in names]
        self._copies: list[Copy] = []
        self._compiled = self._place / "compiled"

    def _copy(self, slot: int) -> Copy:
        while len(self._copies) <= slot:
            name = f"copy_{len(self._copies)}.{os.getpid()}"
            self._copies.append(Copy(self._given.root, self._place / name, self._compiled))
        return self._copies[slot]

    def measure(self) -> None:
        """Measure the test files that have changed, and read what is known of all."""
        missing = [f for f in self._test_files if not self.contexts.is_measured(f)]
        self._in_parallel([] if self._given.stale else missing, self._measure)
        self.contexts.read(self._test_files)
        for test in sorted(self.contexts.failed):
            print(f"left out, for it fails without a fault: {test}")

    def _measure(self, test_file: str, slot: int) -> Iterator[None]:
        copy, scratch = self._copy(slot), self._place / f"scratch_{slot}.{os.getpid()}"
        around, environment = measuring(copy, scratch)
        run = Run(
            copy, [test_file], scratch, {}, is_faulty=False, around=around, environment=environment,
            options=["-m", self._given.tests] if self._given.tests else [],
        )  # fmt: skip
        begin = time.monotonic()
        while not run.is_over():
            yield
        told = f"{time.monotonic() - begin:.0f} s"
        if run.status in (0, 1, NONE_LEFT):
            self.contexts.keep(test_file, copy, scratch)
        else:
            text = (scratch / "told").read_text(encoding="utf-8", errors="replace")
            told = f"could not be measured: {run.failed}\n{text[-1000:]}"
        print(f"{test_file}: {told}", flush=True)

    def _in_parallel(self, works: Sequence, make) -> None:
        """Do works in as many slots as there are jobs; what they start ends with them."""
        waiting, slots = list(works), {}
        while waiting or slots:
            for slot in set(range(self._given.jobs)) - set(slots):
                if waiting:
                    slots[slot] = make(waiting.pop(0), slot)
            for slot, work in list(slots.items()):
                if next(work, slots) is slots:
                    del slots[slot]
            time.sleep(0.05)

    def outcomes(self, numbers: Sequence[int]) -> list[Outcome]:
        """Return what becomes of the faults of these numbers; those that are known are kept."""
        kept = self._place / f"{digest(self._given.root)}.jsonl"
        lines = kept.read_text(encoding="utf-8").splitlines() if kept.is_file() else []
        known = [Outcome(**json.loads(line)) for line in lines]
        key = self._given.seed, self._given.room
        found = {o.number: o for o in known if (o.seed, o.only_room) == key and o.number in numbers}

        def attempt(number: int, slot: int) -> Iterator[None]:
            outcome = yield from self._try(number, slot)
            found[number] = outcome
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
            show(outcome)

        missing = [number for number in numbers if number not in found]
        if missing:
            self._compile()
        self._in_parallel(missing, attempt)
        return [found[number] for number in numbers]

    def _compile(self) -> None:
        """Run the quickest test without a fault: what it compiles is then there for all."""
        passing = set(self.contexts.seconds) - self.contexts.failed
        quickest = min(passing, key=lambda test: self.contexts.seconds[test])
        scratch = self._place / f"scratch_0.{os.getpid()}"
        run = Run(self._copy(0), [quickest], scratch, {}, is_faulty=False)
        while not run.is_over():
            time.sleep(0.05)
        if run.failed:
            raise RuntimeError(f"fails without a fault: {run.failed}")

    def close(self) -> None:
        """Remove the copies."""
        for path in self._place.glob(f"*.{os.getpid()}*"):
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)

    def _try(self, number: int, slot: int) -> Iterator[None]:
        """Try one fault in a copy; return its outcome."""
        begin = time.monotonic()
        seed, room = self._given.seed, self._given.room
        fault = self._program.draw(seed, number, room)
        tests = tests_of(fault, self._program, self.contexts)
        unseen = reason(fault, self._program)
        by, ran = "", 0
        if not unseen:
            copy, text = self._copy(slot), self._program.modules[fault.file].text
            copy.write(fault.file, fault.apply(text))
            try:
                for wave in waves(tests, self.contexts.seconds, self._given.budget):
                    by, begun = yield from self._run(copy, wave, slot)
                    ran += begun
                    if by:
                        break
            finally:
                copy.write(fault.file, text)
        line = text_before(fault, self._program).count("\n") + 1
        return Outcome(
            seed, number, room, fault.room, fault.file, line, fault.kind,
            diff_of(fault, self._program), by, ran, len(tests), time.monotonic() - begin, unseen,
        )  # fmt: skip

    def _run(self, copy: Copy, tests: Sequence[str], slot: int) -> Iterator[None]:
        scratch = self._place / f"scratch_{slot}.{os.getpid()}"
        run = Run(copy, tests, scratch, self.contexts.seconds, options=["-x"])
        try:
            while not run.is_over():
                yield
        finally:
            run.stop()
        if run.status not in (0, NONE_LEFT) and not run.failed:
            told = (scratch / "told").read_text(encoding="utf-8", errors="replace")
            raise RuntimeError(f"pytest ended with {run.status}:\n{told[-2000:]}")
        # Where a fault takes the chosen tests away, a file has other tests than before.
        gone = "tests that are no longer there" if run.status == NONE_LEFT else ""
        return run.failed or gone, run.begun


def waves(tests: Sequence[str], seconds: dict[str, float], budget: float) -> Iterator[list[str]]:
    """Yield tests in their order: first a few of few files, then what the budget leaves."""
    total, within = 0.0, []
    for test in tests:
        total += seconds[test]
        if total > budget and within:
            break
        within.append(test)
    files: set[str] = set()
    first = 0
    for test in within[: FIRST_WAVE[0]]:
        files.add(test.partition("::")[0])
        if len(files) > FIRST_WAVE[1]:
            break
        first += 1
    yield from filter(None, (within[:first], within[first:]))


def text_before(fault: Fault, program: Program) -> str:
    """Return the text of the file up to the fault."""
    return program.modules[fault.file].text[: fault.begin].decode()


def diff_of(fault: Fault, program: Program) -> str:
    """Return a fault as a unified diff."""
    old = program.modules[fault.file].text
    new = fault.apply(old)
    names = f"a/{fault.file}", f"b/{fault.file}  ({fault.scope or 'module'}: {fault.kind})"
    before, after = (text.decode().splitlines() for text in (old, new))
    return "\n".join(difflib.unified_diff(before, after, *names, n=0, lineterm=""))


def unseen_rows() -> list[dict[str, str]]:
    """Return the rows of mutants.toml: file, line before and after, reason."""
    return tomllib.loads(UNSEEN.read_text(encoding="utf-8")).get("unseen", [])


def reason(fault: Fault, program: Program) -> str:
    """Return why nobody can see a fault: what mutants.toml says of it, or ""."""
    old, new = diff_of(fault, program).splitlines()[3:]
    for row in unseen_rows():
        same = row["old"] == old[1:].strip() and row["new"] == new[1:].strip()
        if row["file"] == fault.file and same:
            return row["reason"]
    return ""


def digest(root: Path) -> str:
    """Return a digest of program, tests and scenarios: outcomes hold for these."""
    parts = ("omnitrack_sim/", "tests/", "scenarios/")
    found = hashlib.sha256()
    for name in sorted(files_of_checkout(root)):
        if name.startswith(parts):
            found.update(name.encode() + b"\0" + (root / name).read_bytes())
    return found.hexdigest()[:16]


def show(outcome: Outcome) -> None:
    """Print one outcome."""
    told = f"{outcome.number}: {outcome.file}:{outcome.line} {outcome.kind}: "
    told += outcome.unseen or outcome.noticed_by or "SURVIVES"
    print(f"{told} ({outcome.tests_run} of {outcome.tests} tests, {outcome.seconds:.0f} s)")
    sys.stdout.flush()


def report(outcomes: Sequence[Outcome]) -> int:
    """Print survivors and the score by room; return the exit status."""
    # Only here: forked processes import the program of their copy.
    from omnitrack_sim.record.statistics import rate_text

    counted = [o for o in outcomes if not o.unseen]
    survivors = [o for o in counted if not o.noticed_by]
    for o in survivors:
        print(f"\n{o.number}: survives {o.tests_run} of {o.tests} tests\n{o.diff}")
    print("\n| room | faults | noticed |\n|---|---|---|")
    for room in [*sorted({o.room for o in counted}), "all"]:
        of_room = [o for o in counted if room in (o.room, "all")]
        noticed = sum(bool(o.noticed_by) for o in of_room)
        print(f"| {room} | {len(of_room)} | {rate_text(noticed, len(of_room))} |")
    print(f"\n{len(outcomes) - len(counted)} faults that nobody can see are left out")
    return 1 if survivors else 0


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        sys.exit(main())
    sys.exit(130)
