"""The fuzzer: what it makes is the same every time, it sees faults, and finds none in a few odd
inputs. The long form is ``benchmarks/fuzz.py``."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tomllib
from datetime import date
from pathlib import Path

import pytest

from omnitrack_sim import shipped_files

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"

from fuzzing import writing  # noqa: E402
from fuzzing.arguments import command_of  # noqa: E402
from fuzzing.files import odd_file  # noqa: E402
from fuzzing.values import Raw, limits  # noqa: E402

pytestmark = pytest.mark.long

MISCHIEF = """
import os, sys, time, warnings
sys.path.insert(0, {place!r})
from fuzzing.watch import watched
from omnitrack_sim.base.errors import InputError

def hang():
    while True:
        pass

def stray():
    open("stray.txt", "w").close()

def deep():
    return deep()

WAYS = [
    lambda: None, deep, hang, lambda: os.kill(os.getpid(), 11), lambda: bytearray(1 << 40),
    lambda: warnings.warn("odd", RuntimeWarning), lambda: print("words"), stray,
    lambda: int("x"), lambda: 1 / 0, lambda: None,
]

def refuse():
    raise InputError([])

def task(number, desk):
    desk.attempt("mischief", 0.3, refuse if number == len(WAYS) else WAYS[number], InputError)
    desk.only("mischief")

for number, faults in watched(task, range(len(WAYS) + 1)):
    print(number, [fault.what for fault in faults])
    print(*faults, sep="\\n", file=sys.stderr)
"""
SEEN = [
    [],
    ["RecursionError"],
    ["too slow"],
    ["killed by SIGSEGV"],
    ["MemoryError"],
    ["RuntimeWarning"],
    ["prints"],
    ["left behind"],
    ["ValueError"],
    ["ZeroDivisionError"],
    [],
    [],
]


def test_the_fuzzer_sees_faults(tmp_path):
    """Endless recursion, a hang, a crash, hunger for memory, warnings, prints, files left behind
    and foreign exceptions are faults; nothing, and an error of the package, is none. After each
    the next case is tried."""
    script = tmp_path / "mischief.py"
    script.write_text(MISCHIEF.format(place=str(BENCHMARKS)))
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=100
    )
    assert done.stdout.splitlines() == [f"{i} {seen}" for i, seen in enumerate(SEEN)], done.stderr


def test_odd_inputs_are_accepted_or_refused_cleanly(tmp_path):
    """Odd files, damaged folders and odd arguments, of a fixed seed and of the day's, which
    ``FUZZ_SEED`` replaces: no traceback, no warning, no hang, nothing left behind."""
    seed = os.environ.get("FUZZ_SEED", str(date.today().toordinal()))
    few = ("--files", "20", "--folders", "66", "--arguments", "4", "--seed", "1", seed)
    command = [sys.executable, str(BENCHMARKS / "fuzz.py"), *few, "--keep", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, f"FUZZ_SEED={seed}\n{done.stdout}{done.stderr}"


def test_cases_come_from_seed_and_number():
    """The same seed and number give the same file and command; others give others."""
    assert all(odd_file(5, i) == odd_file(5, i) for i in range(20))
    assert all(command_of(5, i) == command_of(5, i) for i in range(20))
    assert len({odd_file(seed, i).data for seed in (5, 6) for i in range(20)}) > 30


@pytest.mark.parametrize(
    "path",
    [path for kind in ("scenarios", "sweeps", "networks") for path in shipped_files(kind).values()],
    ids=lambda path: path.stem,
)
def test_written_files_are_what_they_were_made_from(path):
    """Shipped data written as TOML and JSON and read again are the same."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    assert tomllib.loads(writing.toml(data)) == data
    assert json.loads(writing.as_json(data)) == data


def test_raw_text_stands_where_a_value_would():
    """Raw text is not quoted, in a list neither; other odd values are read back as they were."""
    data = {"a": Raw("0x10"), "b": [1.5, Raw("1e3")], "c d": {"é\x00\x7f": math.inf}}
    read = tomllib.loads(writing.toml(data))
    assert read == {"a": 16, "b": [1.5, 1000.0], "c d": {"é\x00\x7f": math.inf}}
    assert json.loads(writing.as_json({"a": [Raw("[[2]]")]})) == {"a": [[[2]]]}


def test_limits_are_those_of_the_tables():
    """Limits of scenario, robot, sweep and axes are among the odd numbers: friction 5, scale 0.01,
    4096 trials a batch, a grid of a million."""
    assert {5, 0.01, 4096, 1_000_000} <= set(limits())
