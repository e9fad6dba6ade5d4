"""Which tests run which lines, measured once by coverage.py, and kept."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from mutating.faults import PACKAGE, Fault, Program, Scope
from mutating.trying import Copy, base_name

SHARED = "shared"
"""Context of what a fixture of several tests does: it counts for all tests of the file."""
IMPORT = ""
"""Context of what runs while a test file is read."""
SITE = "import coverage\ncoverage.process_startup()\n"
"""What Python runs first in processes that tests start."""


class Measured:
    """A plugin of pytest: lines count for the test that runs them."""

    def __init__(self, coverage: Any) -> None:
        self._switch = coverage.switch_context
        self._now = IMPORT
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        """Lines count for this test."""
        self._now = base_name(item.nodeid)
        self._switch(self._now)
        answer = yield
        self._switch(IMPORT)
        return answer

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Any:
        """Lines of a fixture of several tests count for all."""
        if fixturedef.scope == "function":
            return (yield)
        self._switch(SHARED)
        try:
            return (yield)
        finally:
            self._switch(self._now)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Any:
        """Add up seconds of the processor, in processes of the test too."""
        begin = sum(os.times()[:4])
        try:
            return (yield)
        finally:
            self.seconds[base_name(item.nodeid)] += sum(os.times()[:4]) - begin

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note which test fails without a fault."""
        if report.failed:
            self.failed.add(base_name(report.nodeid))


def measuring(copy: Copy, scratch: Path) -> tuple[Callable[..., int], dict[str, str]]:
    """Return what measures a run of pytest around it, and the environment of its processes."""
    include = [str(copy.place / PACKAGE / "*")]
    settings = scratch.parent / f"{scratch.name}.rc"
    settings.write_text(
        f"[run]\ninclude = {include[0]}\nparallel = true\nsigterm = true\n"
        f"data_file = {scratch / 'process'}\ncontext = ${{PYTEST_CURRENT_TEST}}\n"
    )
    site = scratch.parent / f"{scratch.name}.site"
    site.mkdir(exist_ok=True)
    (site / "sitecustomize.py").write_text(SITE)

    def around(run: Callable[[list[Any]], int]) -> int:
        import coverage

        measure = coverage.Coverage(scratch / "main", include=include, config_file=False)
        # Of the cores of coverage.py this one knows contexts.
        measure.config.core = "ctrace"
        plugin = Measured(measure)
        measure.start()
        status = run([plugin])
        measure.stop()
        measure.save()
        rows = {"seconds": plugin.seconds, "failed": sorted(plugin.failed), "status": status}
        (scratch / "tests.json").write_text(json.dumps(rows))
        return status

    path = f"{site}:{copy.place}"
    return around, {"COVERAGE_PROCESS_START": str(settings), "PYTHONPATH": path}


class Contexts:
    """Measurements of test files, kept in a folder, a file each."""

    def __init__(self, root: Path, folder: Path) -> None:
        self._root, self._folder = root, folder
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()
        # By source file and line: tests, and files of tests where it runs for all of a file.
        self._lines: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))

    def is_measured(self, test_file: str) -> bool:
        """Return whether a test file is measured as it is."""
        kept = self._file(test_file)
        return kept.is_file() and json.loads(kept.read_text())["digest"] == self._digest(test_file)

    def keep(self, test_file: str, copy: Copy, scratch: Path) -> None:
        """Keep what a run of a test file has left in its scratch folder."""
        import coverage

        rows = json.loads((scratch / "tests.json").read_text())
        lines: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        for path in scratch.glob("[mp][ar]*"):
            if not path.name.startswith(("main", "process")):
                continue
            data = coverage.CoverageData(path)
            data.read()
            for source in data.measured_files():
                name = Path(source).relative_to(copy.place).as_posix()
                for line, found in data.contexts_by_lineno(source).items():
                    lines[name][line] |= {base_name(each.partition(" (")[0]) for each in found}
        rows["digest"] = self._digest(test_file)
        rows["texts"] = {name: self._keep_text(copy.place / name) for name in lines}
        tests = sorted({t for each in lines.values() for found in each.values() for t in found})
        index = {test: i for i, test in enumerate(tests)}
        rows["tests"] = tests
        rows["lines"] = {
            name: {line: [index[t] for t in found] for line, found in each.items()}
            for name, each in lines.items()
        }
        self._file(test_file).parent.mkdir(parents=True, exist_ok=True)
        self._file(test_file).write_text(json.dumps(rows))

    def read(self, test_files: Sequence[str]) -> None:
        """Read the measurements of test files."""
        for test_file in filter(lambda each: self._file(each).is_file(), test_files):
            rows = json.loads(self._file(test_file).read_text())
            self.seconds |= rows["seconds"]
            self.failed |= set(rows["failed"])
            for name, lines in rows["lines"].items():
                moved = self._moved(name, rows["texts"][name])
                for line, found in lines.items():
                    names = {rows["tests"][i] for i in found}
                    if SHARED in names:
                        names = names - {SHARED} | set(rows["seconds"])
                    # A test that is left out takes no time.
                    self._lines[name][moved(int(line))] |= names & {IMPORT, *rows["seconds"]}

    def of_lines(self, file: str, first: int, last: int) -> set[str]:
        """Return the tests that run a line of these."""
        lines = self._lines.get(file, {})
        return {t for line in range(first, last + 1) for t in lines.get(line, ())} - {IMPORT}

    def runs_at_import(self, file: str, line: int) -> bool:
        """Return whether a line runs where its module is imported."""
        return IMPORT in self._lines.get(file, {}).get(line, ())

    def of_scope(self, file: str, scope: Scope) -> set[str]:
        """Return the tests that run something of a function."""
        body = scope.statements
        return {t for s in body for t in self.of_lines(file, s.lineno, s.end_lineno or s.lineno)}

    def of_file(self, file: str) -> set[str]:
        """Return the tests that run something of a module."""
        return {t for found in self._lines.get(file, {}).values() for t in found} - {IMPORT}

    def _file(self, test_file: str) -> Path:
        return self._folder / f"{Path(test_file).stem}.json"

    def _digest(self, test_file: str) -> str:
        return hashlib.sha1((self._root / test_file).read_bytes()).hexdigest()

    def _keep_text(self, path: Path) -> str:
        """Keep the text of a source once, and return its name."""
        text = path.read_bytes()
        name = hashlib.sha1(text).hexdigest()
        kept = self._folder / "texts" / name
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(text)
        return name

    def _moved(self, name: str, text: str) -> Callable[[int], int]:
        """Return where lines stand now that stood elsewhere when they were measured."""
        return _moves(self._folder / "texts" / text, self._root / name)


@cache
def _moves(before: Path, now: Path) -> Callable[[int], int]:
    if not now.is_file() or before.read_bytes() == now.read_bytes():
        return int
    old, new = (path.read_text(encoding="utf-8").splitlines() for path in (before, now))
    places: dict[int, int] = {}
    for tag, a, b, c, d in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        for i in range(a, b):
            places[i + 1] = c + 1 + (i - a if tag == "equal" else min(i - a, max(d - c - 1, 0)))
    return lambda line: places.get(line, line)


def tests_of(fault: Fault, program: Program, contexts: Contexts) -> list[str]:
    """Return the tests that may notice a fault, the likeliest first.

    First those that run the statement, the quickest first. Where it is compiled, those that run
    anything of its module or of one that imports it: what is compiled no measure of coverage sees.
    Where it lies outside of functions, or runs while its module is imported, those that run a
    function which uses the name that it assigns. After these the other tests of the same files,
    which may use what was made once for several.
    """
    ordered: list[str] = []
    done = set(contexts.failed)
    for group in _groups(fault, program, contexts):
        ordered += sorted(group - done, key=lambda test: (contexts.seconds[test], test))
        done |= group
    files = {test.partition("::")[0] for test in ordered}
    others = {test for test in contexts.seconds if test.partition("::")[0] in files} - done
    return ordered + sorted(others, key=lambda test: (contexts.seconds[test], test))


def _groups(fault: Fault, program: Program, contexts: Contexts) -> Iterator[set[str]]:
    scope, file = program.scope(fault), fault.file
    if scope.is_function:
        found = contexts.of_lines(file, *fault.lines)
        if scope.is_compiled:
            files = [file, *program.importers(file)]
            found = found.union(*map(contexts.of_file, files))
        yield found
        if not contexts.runs_at_import(file, fault.lines[0]):
            return
    users = list(program.users(fault))
    for is_own in (True, False):
        yield set().union(*(contexts.of_scope(f, s) for f, s in users if (f == file) is is_own))
    yield contexts.of_file(file)
