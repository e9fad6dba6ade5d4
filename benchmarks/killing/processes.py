"""Processes that are started to be killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path

GRACE = 60.0
"""Seconds in which processes must be gone after the one that started them."""


def started(command: list[str], **options: object) -> subprocess.Popen[bytes]:
    """A process in a group of its own, whose output nobody sees."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    return subprocess.Popen(command, **{**quiet, **options})  # type: ignore[call-overload]


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a process of ``started`` and all that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def descendants(parent: int) -> list[int]:
    """Processes whose parent is ``parent``, from /proc."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == parent:
                found.append(int(entry.name))
    return found


def survivors(pids: list[int]) -> list[int]:
    """Those that still run after ``GRACE`` seconds."""
    until = time.monotonic() + GRACE
    while time.monotonic() < until and any(map(running, pids)):
        time.sleep(0.05)
    return [pid for pid in pids if running(pid)]


def running(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
