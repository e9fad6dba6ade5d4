"""Workers of sweeps: two give the same bytes as none, and those that die are survived."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sweep_samples import (
    DEADLY,
    GATED,
    PATIENCE,
    deadly_batch,
    environment,
    once_deadly_batch,
    parts,
    same,
    small_sweep,
    write_sweep,
)

from omnitrack_sim import load_sweep, run_trials
from omnitrack_sim.base import workers
from omnitrack_sim.base.workers import DaskPool, LocalPool, WorkersLost, cores
from omnitrack_sim.trials import dispatch

pytestmark = pytest.mark.long


def started(*arguments: object, **more: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "omnitrack_sim.cli", *map(str, arguments)]
    pipe, env = subprocess.PIPE, environment(**more)
    # A shell's background jobs ignore Ctrl-C, and so would what the tests start from one.
    heed = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, preexec_fn=heed, env=env)


def children(pid: int) -> list[int]:
    """Processes that ``pid`` has started, without zombies."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            except OSError:
                continue
            if int(parent) == pid and state != "Z":
                found.append(int(entry.name))
    return found


def runs(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(holds: Callable[[], object], what: str) -> None:
    """Wait for a state, as long as it takes."""
    until = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < until, what
        time.sleep(0.01)


def wait_for_parts(process: subprocess.Popen, place: Path, count: int) -> list[int]:
    """Wait until there are ``count`` parts of a sweep whose workers wait for each other at the
    gate, so that it cannot end by itself; its workers."""
    wait_until(lambda: len(parts(place)) >= count or process.poll() is not None, "no parts")
    assert process.poll() is None, process.communicate()
    wait_until(lambda: len(children(process.pid)) >= 2, "no workers")
    return children(process.pid)


def wait_until_gone(pids: list[int]) -> None:
    """Wait until workers have died by themselves; those that do not are ended for them."""
    try:
        wait_until(lambda: not any(map(runs, pids)), f"some of {pids} live on")
    finally:
        for pid in filter(runs, pids):
            os.kill(pid, signal.SIGKILL)


def test_two_workers_give_the_same_bytes(calm, tmp_path):
    """All files of two worker processes are those of one process."""
    told = []
    run_trials(
        small_sweep(), out=tmp_path / "two", executor=lambda: LocalPool(2), progress=told.append
    )
    assert same(calm, tmp_path / "two")
    assert [status.done for status in told] == sorted(status.done for status in told)
    assert (told[0].done, told[-1].done, told[-1].total) == (0, 10, 10)


def test_a_trial_that_kills_its_worker_makes_one_row(table, monkeypatch):
    """Its batch is split after three deaths; it alone becomes a row, the others are as usual."""
    monkeypatch.setattr(dispatch, "run_rows", deadly_batch)
    told = []
    rows = run_trials(small_sweep(), workers=2, progress=told.append).table.to_pylist()
    assert (rows[DEADLY]["outcome"], rows[DEADLY]["reason"]) == ("error", "the worker died")
    expected = table.to_pylist()
    assert rows[:DEADLY] + rows[DEADLY + 1 :] == expected[:DEADLY] + expected[DEADLY + 1 :]
    assert told[-1].lost >= 5


def test_a_worker_that_is_killed_once_costs_nothing(calm, tmp_path, monkeypatch):
    """After one death the batch is run again, and the files are the usual ones."""
    monkeypatch.setattr(dispatch, "run_rows", once_deadly_batch)
    monkeypatch.setenv("ONCE_DEADLY", str(tmp_path / "mark"))
    run_trials(small_sweep(), out=tmp_path / "sweep", workers=2)
    assert (tmp_path / "mark").exists()
    assert same(calm, tmp_path / "sweep")


def test_workers_that_never_work_are_told(monkeypatch):
    """Workers that die at once, and a given executor that breaks, end with an error that says
    so."""
    # Ends a worker as it begins, and needs no module of the package there.
    monkeypatch.setattr("omnitrack_sim.base.workers.begin_worker", os._exit)
    with pytest.raises(WorkersLost, match="before they run anything"):
        run_trials(small_sweep(), executor=lambda: LocalPool(1))
    with LocalPool(1) as pool, pytest.raises(WorkersLost, match="callable"):
        run_trials(small_sweep(), executor=pool)


def test_kill_of_the_parent_and_ctrl_c(tmp_path):
    """Killed and interrupted on the way, workers die with their parent, and the same command ends
    with equal files."""
    file, killed = write_sweep(tmp_path, samples=12, kinds=GATED), tmp_path / "killed"
    run_trials(load_sweep(file), out=tmp_path / "calm")
    command = ("sweep", file, "--out", killed, "--workers", 2)
    process = started(*command, GATE_FOLDER=killed, GATE_PARTS=2)
    under = wait_for_parts(process, killed, 2)
    process.kill()
    process.wait()
    wait_until_gone(under)  # before its pipes are read, which workers would hold open
    process.communicate()
    before = {path: path.stat().st_mtime_ns for path in parts(killed)}
    assert 2 <= len(before) < 8
    moment = len(before) + 1
    process = started(*command, "--continue", GATE_FOLDER=killed, GATE_PARTS=moment)
    under = wait_for_parts(process, killed, moment)
    process.send_signal(signal.SIGINT)
    process.wait(PATIENCE)
    wait_until_gone(under)
    _, told = process.communicate()
    assert process.returncode == 130
    assert "of 24 trials done, and the batch of up to 3 trials" in told
    assert "Traceback" not in told
    assert run_trials(load_sweep(file), out=killed).status.total == 24
    assert same(tmp_path / "calm", killed)
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())


def test_mujoco_starts_no_other_process_in_a_worker():
    """With its library named, glfw asks no second Python, which would outlive a killed worker."""
    code = """
import os, subprocess
from omnitrack_sim.base.workers import name_glfw_library
name_glfw_library()
subprocess.Popen = None
import glfw
assert glfw.get_version() >= (3, 3) and os.environ["PYGLFW_LIBRARY"].endswith("libglfw.so")
"""
    env = {name: value for name, value in environment().items() if name != "PYGLFW_LIBRARY"}
    subprocess.run([sys.executable, "-c", code], check=True, env=env, timeout=PATIENCE)


def test_a_dask_cluster_that_loses_a_worker_gives_the_same_bytes(tmp_path, monkeypatch):
    """A scheduler and two workers, one killed on the way: the files are those of one process."""
    file = write_sweep(tmp_path, samples=12)
    sweep = load_sweep(file)
    run_trials(sweep, out=tmp_path / "calm")
    address = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(address), "--no-dashboard", "--host", "127.0.0.1"]
    one = ["--nthreads", "1", "--no-nanny", "--death-timeout", str(PATIENCE)]
    monkeypatch.setattr(workers, "DASK_PATIENCE", PATIENCE)
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", f"{PATIENCE:.0f}s")
    cluster = [_dask("scheduler", *common, "--port", "0", cwd=tmp_path)]
    cluster += [_dask("worker", *common, *one, "--name", name, cwd=tmp_path) for name in "ab"]
    try:
        wait_until(lambda: contact_of(address), "no scheduler")
        contact = contact_of(address)
        assert contact is not None

        def kill_one(status):
            if status.done:
                cluster[1].kill()

        run_trials(
            sweep, out=tmp_path / "dask", executor=lambda: DaskPool(contact), progress=kill_one
        )
    finally:
        for process in cluster:
            process.kill()
            process.wait()
    assert same(tmp_path / "calm", tmp_path / "dask")


def contact_of(address: Path) -> str | None:
    """What a scheduler's file says, once it is written."""
    with contextlib.suppress(OSError, ValueError, KeyError):
        return json.loads(address.read_text())["address"]
    return None


def _dask(*arguments: str, cwd: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "dask", *arguments]
    return subprocess.Popen(command, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def test_a_missing_scheduler_or_package_is_told(monkeypatch):
    """Where no scheduler answers, and without distributed, the error says what to do."""
    monkeypatch.setattr(workers, "DASK_PATIENCE", 1)
    with pytest.raises(Exception, match="no scheduler answers"):
        DaskPool("tcp://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(Exception, match="pip install"):
        DaskPool("tcp://127.0.0.1:9")


def test_cores_are_those_that_this_process_may_use(monkeypatch):
    """Of Linux those it is bound to; elsewhere all of the machine, one where nobody knows."""
    if hasattr(os, "sched_getaffinity"):
        assert cores() == len(os.sched_getaffinity(0))
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    for known, told in ((6, 6), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda known=known: known)
        assert cores() == told
