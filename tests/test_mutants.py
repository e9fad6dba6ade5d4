"""Faults by lot: which are drawn, which tests are run, and what is told of them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import mutants
import pytest
from mutating.contexts import _moves
from mutating.faults import Module, Program

BENCHMARKS = Path(mutants.__file__).parent
PROGRAM = Program(mutants.ROOT)


def changed(source: str, tmp_path: Path) -> set[str]:
    """All that may become of the one line of a source that has faults, by its text."""
    (tmp_path / "source.py").write_text(source)
    module = Module(tmp_path, "source.py")
    faults = [f for scope in module.scopes for each in module.faults(scope).values() for f in each]
    assert all(fault.apply(module.text) != module.text for fault in faults)
    before = source.splitlines()
    after = [fault.apply(module.text).decode().splitlines() for fault in faults]
    return {a.strip() for lines in after for a, b in zip(lines, before, strict=True) if a != b}


@pytest.mark.parametrize(
    ("line", "faults"),
    [
        ("z = x - y", {"z = x + y", "z = x"}),
        ("z = x * y", {"z = x / y", "z = x", "z = y"}),
        ("z = (x + y) / w", {"z = (x - y) / w", "z = (x + y) * w", "z = (x + y)"}
         | {"z = (x) / w", "z = (y) / w"}),
        ("z += y", {"z -= y"}),
        ("z = x < y", {"z = x <= y", "z = x > y"}),
        ("z = x is not y", {"z = x is y"}),
        ("z = x not in y", {"z = x in y"}),
        ("z = 2", {"z = 3", "z = 1"}),
        ("z = 40", {"z = 80", "z = 20"}),
        ("z = 0.25", {"z = 0.5", "z = 0.125"}),
        ("z = True", {"z = False"}),
        ("z = x[0]", {"z = x[1]"}),
        ("z = x[1:]", {"z = x[2:]"}),
        ("z = -x", {"z = x"}),
        ("z = not x", {"z = x"}),
        ("z = x and y", {"z = x or y", "z = x", "z = y"}),
        ("z = max(x, y)", {"z = min(x, y)"}),
        ("z = np.sin(x)", {"z = np.cos(x)", "z = (x)"}),
        ("z = hit(x, y)", {"z = hit(y, x)"}),
        ("hit(x=y)", {"pass"}),
        ("if x: pass", {"if not (x): pass"}),
        ("return x.size", {"return 0.0"}),
        ("return 0.0", {"return 1.0"}),
        ("z = hit(x, x)", set()),
    ],
)  # fmt: skip
def test_faults_of_a_line(line: str, faults: set[str], tmp_path: Path) -> None:
    """A line has these faults and no others."""
    assert changed(f"def f() -> float:\n    {line}\n", tmp_path) == faults


@pytest.mark.parametrize(
    "source",
    [
        '"""Two + 2."""',
        "def f(x: tuple[int, 3]) -> Literal[4]: ...",
        "@cache(5)\ndef f(): ...",
        "def f():\n    raise ValueError(x + 1)",
        "assert x + 1 < 2",
        "z = f'{x + 1}'",
        "print(x + 1)",
        "logger.warning('%s', x + 1)",
        "if TYPE_CHECKING:\n    z = 1",
        "z = 'a' + x",
        "z = 1e-9",
        "z = np.stack(x, axis=-1)",
        "z = float(x)",
        "Number = int | float",
    ],
)
def test_what_no_test_can_see_is_not_changed(source: str, tmp_path: Path) -> None:
    """Docstrings, annotations, decorators, messages, tolerances and conversions have no fault."""
    assert changed(f"{source}\n", tmp_path) == set()


def test_a_drawn_fault_is_one_line_of_another_program() -> None:
    """Whatever is drawn changes one line, within the statement that it names, and is Python."""
    for number in range(40):
        fault = PROGRAM.draw(7, number)
        old = PROGRAM.modules[fault.file].text
        new = fault.apply(old)
        assert compile(old, fault.file, "exec") != compile(new, fault.file, "exec")
        lines = zip(old.splitlines(), new.splitlines(), strict=True)
        differ = [i for i, (a, b) in enumerate(lines, 1) if a != b]
        assert len(differ) == 1
        assert fault.lines[0] <= differ[0] <= fault.lines[1]


def test_a_seed_and_a_number_name_a_fault() -> None:
    """The same two give the same fault; another number or seed gives another."""
    drawn = [PROGRAM.draw(3, number) for number in range(20)]
    assert drawn == [PROGRAM.draw(3, number) for number in range(20)]
    assert len(set(drawn)) == 20
    assert not set(drawn) & {PROGRAM.draw(4, number) for number in range(20)}


def test_rooms_are_drawn_by_their_lines() -> None:
    """A room has its share of the lines of code among the faults, within four deviations."""
    drawn = Counter(PROGRAM.draw(5, number).room for number in range(400))
    for room, own in PROGRAM.lines.items():
        share = own / sum(PROGRAM.lines.values())
        deviation = (400 * share * (1 - share)) ** 0.5
        assert abs(drawn[room] - 400 * share) < 4 * deviation, room


def test_lines_that_moved_are_found_again(tmp_path: Path) -> None:
    """A measurement of an earlier text counts for the lines as they stand now."""
    before, now = tmp_path / "before", tmp_path / "now"
    before.write_text("a\nb\nc\nd\n")
    now.write_text("new\na\nB\nc\nd\n")
    assert [_moves(before, now)(line) for line in (1, 2, 3, 4)] == [2, 3, 4, 5]


def test_waves_keep_the_order_and_the_budget() -> None:
    """Tests run in their order, of few files first, and as many as the budget has room for."""
    tests = [f"tests/test_{i}.py::test" for i in range(100)]
    seconds = dict.fromkeys(tests, 1.0)
    first, rest = mutants.waves(tests, seconds, 50.0)
    assert first + rest == tests[:50]
    assert len(first) == mutants.FIRST_WAVE[1]
    assert list(mutants.waves(tests, dict.fromkeys(tests, 99.0), 50.0)) == [tests[:1]]


SUMS = '''
"""Sums."""

LEAST = 5


def double(x: float) -> float:
    return 2 * x


def triple(x: float) -> float:
    return 3 * x


def never(x: float) -> float:
    return x + 7


def count(n: int) -> int:
    done = 0
    while n > 0:
        n, done = n - 1, done + 1
    return done


def is_little(x: float) -> bool:
    return x < LEAST
'''
TESTS = """
import subprocess, sys
from omnitrack_sim.room import sums

def test_double():
    assert sums.double(3) == 6

def test_triple():
    sums.triple(3)

def test_count():
    assert [sums.count(n) for n in range(12)] == list(range(12))

def test_is_little():
    code = "from omnitrack_sim.room.sums import is_little as f; print(f(4.9), f(5.0))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert told.stdout.split() == ["True", "False"]

def test_that_fails_anyway():
    assert sums.double(1) == 0
"""
DRIVER = """
import sys
sys.path.insert(0, {benchmarks!r})
from mutating import trying
trying.LIBRARIES, trying.PATIENCE = ("coverage", "hypothesis", "xdist.plugin"), (10.0, 5.0)
import mutants
sys.argv = ["mutants.py", "--root", {root!r}, "--seed", "3", "--count", "12", "--jobs", "2"]
sys.exit(mutants.main())
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """What is told of twelve faults of a small program, at first and when asked again."""
    root = tmp_path_factory.mktemp("small")
    files = {
        "pyproject.toml": "[tool.pytest.ini_options]\n",
        "omnitrack_sim/__init__.py": "",
        "omnitrack_sim/room/__init__.py": "",
        "omnitrack_sim/room/sums.py": SUMS,
        "tests/test_sums.py": TESTS,
        ".gitignore": "out\n__pycache__\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q", root], check=True)
    code = DRIVER.format(benchmarks=str(BENCHMARKS), root=str(root))
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        for _ in range(2)
    ]
    assert [run.returncode for run in runs] == [1, 1], runs[0].stdout + runs[0].stderr
    assert (root / "omnitrack_sim/room/sums.py").read_text() == SUMS
    assert not [path for path in (root / "out/mutants").iterdir() if str(os.getpid()) in path.name]
    return runs[0].stdout, runs[1].stdout


@pytest.mark.long
def test_faults_are_noticed_or_survive(told: tuple[str, str]) -> None:
    """What tests assert is noticed, in a process of theirs too, and what never ends; what they only
    run survives them, and what they do not run survives none. A test that fails anyway notices
    nothing."""
    rows = [line for line in told[0].splitlines() if line.split(":")[0].isdigit()]
    lines = SUMS.splitlines()
    of = {name: [] for name in ("double", "triple", "never", "count", "is_little", "LEAST")}
    for row in (row for row in rows if " s)" in row):
        number = int(row.split(":")[2].split()[0])
        scope = next(s for s in reversed(lines[:number]) if s.startswith(("def", "LEAST")))
        of[scope.removeprefix("def ").partition("(")[0].partition(" ")[0]].append(row)
    assert all(of.values())
    assert all("test_double" in row for row in of["double"])
    assert all("SURVIVES (4 of 4 tests" in row for row in of["triple"])
    assert all("SURVIVES (0 of 0 tests" in row for row in of["never"])
    assert all("test_count" in row for row in of["count"])
    assert any("(hangs)" in row for row in of["count"])
    assert all("test_is_little" in row for row in of["is_little"] + of["LEAST"])
    assert "left out, for it fails without a fault: tests/test_sums.py::test_that_fails" in told[0]


@pytest.mark.long
def test_outcomes_are_kept(told: tuple[str, str]) -> None:
    """Asked again of the same program and tests, nothing is tried, and the same is reported."""
    first, again = told
    assert "test_sums.py: " not in again
    assert first.endswith(again.partition("\n")[2])
    assert "| room | 12 |" in again


def test_faults_that_nobody_sees_are_of_this_program() -> None:
    """Each fits a line of its file that would be another program, and says why it is not seen."""
    for row in mutants.unseen_rows():
        text = (mutants.ROOT / row["file"]).read_text(encoding="utf-8")
        assert row["old"] in map(str.strip, text.splitlines()), row
        assert row["new"] != row["old"]
        assert len(row["reason"].split()) > 5
