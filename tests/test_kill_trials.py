"""The tool that kills commands at each change of a file. The long form is
``benchmarks/kill_test.py``."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"

from killing.outputs import _described, _moments, _state  # noqa: E402


def launched(place: Path, deadly: int) -> int:
    """Write a network below ``place / "out"``; the status with which that ends."""
    (place / "out").mkdir(exist_ok=True)
    launch = str(BENCHMARKS / "killing" / "launch.py")
    watch = [str(place / "out"), str(deadly), str(place / "count"), "-"]
    command = [sys.executable, launch, *watch, "network", "tower", "--out", "out/tower.toml"]
    options = {"cwd": place, "start_new_session": True, "stdout": subprocess.DEVNULL}
    return subprocess.run(command, **options, timeout=100).returncode


def test_a_command_dies_before_the_change_that_is_named(tmp_path):
    """Killed before its first change a command has written nothing, before the third one a
    temporary folder and not the file that was asked for; undisturbed it counts its changes, and
    takes away what the killed one left."""
    assert launched(tmp_path, 1) == -signal.SIGKILL
    assert list((tmp_path / "out").iterdir()) == []
    assert launched(tmp_path, 3) == -signal.SIGKILL
    assert [path.name[:5] for path in (tmp_path / "out").iterdir()] == [".omni"]
    assert launched(tmp_path, 0) == 0
    assert int((tmp_path / "count").read_text()) >= 3
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["tower.toml"]


def test_kills_fall_all_over_the_life():
    """Half of the kills come before a change, on the last ones and all over; half at any time."""
    moments = _moments(random.Random(0), 20, 30)
    assert len(moments) == 20
    assert moments.count(0) == 10
    assert {1, 27, 28, 29, 30} <= set(moments)
    assert max(moments) == 30


def test_a_lost_and_a_changed_file_are_described(tmp_path):
    """States tell apart what is missing and what differs."""
    (tmp_path / "a").write_text("a")
    (tmp_path / "b").write_text("b")
    known = _state(tmp_path)
    (tmp_path / "a").unlink()
    (tmp_path / "b").write_text("c")
    assert _described(_state(tmp_path), [known]) == "a is missing, b differs"
