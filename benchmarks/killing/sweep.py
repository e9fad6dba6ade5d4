"""A sweep, a benchmark and a passport that are killed and resumed until they are done."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from killing.processes import descendants, survivors

FILES = {
    "sweep": ("trials.parquet", "trials.csv", "summary.json", "success_map.png", "sweep.json"),
    "bench": ("results.parquet", "results.csv", "trials.parquet", "results.md", "bench.png"),
    "passport": ("passport.parquet", "summary.json", "trials.parquet"),
}
COURSES = ("--course", "straight", "--course", "elbow_150", "--course", "tee_run_start_branch")
SWEEP = """
base = "tee_turn"
samples = {trials}
batch = 8
[set]
"run.time_limit" = 1.5
[[axes]]
path = "start.theta5_deg"
kind = "uniform"
low = -60
high = 60
[[axes]]
path = "world.friction"
kind = "uniform"
low = 0.6
high = 1.0
[[axes]]
path = "world.gravity"
kind = "direction"
"""


def kill_trials(
    name: str, place: Path, kills: int, seed: int, trials: int, workers: int
) -> list[str]:
    """Kill a sweep, bench or passport, let it end, and return what differs from an undisturbed one.

    After each kill the workers must have died with their parent, and no finished batch may be lost
    or changed.
    """
    file = place / "kill_test.toml"
    file.write_text(SWEEP.format(trials=trials), encoding="utf-8")
    robots = ("--alone", "--robot", "presser", "--robot", "omnitrack", "--trials", str(trials))
    quick = ("--set", "run.time_limit=1.5")
    line = {
        "sweep": ("sweep", str(file)),
        "bench": ("bench", *robots, "--course", "tee_into", "--course", "pull", *quick),
        "passport": ("passport", "omnitrack", "--trials", str(trials), *COURSES, *quick),
    }
    command = [sys.executable, "-m", "omnitrack_sim.cli", *line[name], "--json", "--workers"]
    calm, killed = place / "calm", place / "killed"
    start = time.perf_counter()
    subprocess.run([*command, "1", "--out", str(calm)], check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - start
    print(f"{name}, uninterrupted, 1 worker: {seconds:.1f} s", flush=True)
    command = [*command, str(workers), "--out", str(killed)]
    faults = _kill_often(name, command, killed, kills, random.Random(seed), max(6.0, seconds / 2))
    return faults + [
        f"{name}: {file} differs from that of the undisturbed one"
        for file in FILES[name]
        if (calm / file).read_bytes() != (killed / file).read_bytes()
    ]


def _kill_often(
    name: str, command: list[str], folder: Path, kills: int, rng: random.Random, longest: float
) -> list[str]:
    """Run ``command`` to its end, killing it ``kills`` times on the way."""
    faults: list[str] = []
    done, before = 0, dict[str, bytes]()
    while True:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        # From the first moments of Python, over the start of the workers, into the batches; every
        # other time only when there is a new batch, however slowly all begins.
        until = time.monotonic() + rng.uniform(0.1, longest)
        wanted = len(before) + done % 2
        while done < kills and process.poll() is None:
            if time.monotonic() >= until and len(_parts(folder)) >= wanted:
                break
            time.sleep(0.01)
        if done >= kills or process.poll() is not None:
            status = process.wait()
            print(f"{name} ended with status {status} after {done} kills", flush=True)
            short = [f"{name}: only {done} kills before it was done"] if done < kills else []
            return faults + short + ([f"{name}: exit status {status}"] if status else [])
        children = descendants(process.pid)
        process.send_signal(signal.SIGKILL)
        process.wait()
        done += 1
        alive = survivors(children)
        parts = _parts(folder)
        lost = [part for part, data in before.items() if parts.get(part) != data]
        left = len(list(folder.rglob(".omnitrack-*.tmp")))
        print(
            f"{name}, kill {done}: {len(parts)} batches, {len(children)} workers, "
            f"{left} temporary folders",
            flush=True,
        )
        faults += [f"{name}, kill {done}: workers live on: {alive}"] if alive else []
        faults += [f"{name}, kill {done}: batches lost or changed: {lost}"] if lost else []
        before = parts


def _parts(folder: Path) -> dict[str, bytes]:
    """Contents of the files of finished batches."""
    files = folder.glob("parts/*.parquet")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
