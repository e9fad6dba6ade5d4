"""A sweep that is killed and resumed until it is done."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from killing.processes import descendants, survivors

FILES = ("trials.parquet", "trials.csv", "summary.json", "success_map.png", "sweep.json")
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


def kill_sweep(place: Path, kills: int, seed: int, trials: int, workers: int) -> list[str]:
    """Kill a sweep on its way, let it end, and compare it with an undisturbed one; what was wrong.

    After each kill the workers must have died with their parent, and no finished batch may be lost
    or changed.
    """
    file = place / "kill_test.toml"
    file.write_text(SWEEP.format(trials=trials), encoding="utf-8")
    command = [sys.executable, "-m", "omnitrack_sim.cli", "sweep", str(file), "--json", "--workers"]
    calm, killed = place / "calm", place / "killed"
    start = time.perf_counter()
    subprocess.run([*command, "1", "--out", str(calm)], check=True, stdout=subprocess.DEVNULL)
    print(f"sweep, uninterrupted, 1 worker: {time.perf_counter() - start:.1f} s", flush=True)
    faults = _kill_often([*command, str(workers), "--out", str(killed)], killed, kills, seed)
    return faults + [
        f"sweep: {name} differs from that of the undisturbed one"
        for name in FILES
        if (calm / name).read_bytes() != (killed / name).read_bytes()
    ]


def _kill_often(command: list[str], folder: Path, kills: int, seed: int) -> list[str]:
    """Run ``command`` to its end, killing it ``kills`` times on the way."""
    rng = random.Random(seed)
    faults: list[str] = []
    done, before = 0, dict[str, bytes]()
    while True:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        # From the first moments of Python, over the start of the workers, into the batches.
        until = time.monotonic() + rng.choice([rng.uniform(0.1, 3.0), rng.uniform(3.0, 6.0)])
        while done < kills and time.monotonic() < until and process.poll() is None:
            time.sleep(0.01)
        if done >= kills or process.poll() is not None:
            status = process.wait()
            print(f"sweep ended with status {status} after {done} kills", flush=True)
            short = [f"sweep: only {done} kills before it was done"] if done < kills else []
            return faults + short + ([f"sweep: exit status {status}"] if status else [])
        children = descendants(process.pid)
        process.send_signal(signal.SIGKILL)
        process.wait()
        done += 1
        alive = survivors(children)
        parts = {path.name: path.read_bytes() for path in (folder / "parts").glob("[0-9]*.parquet")}
        lost = [name for name, data in before.items() if parts.get(name) != data]
        left = len(list(folder.rglob(".omnitrack-*.tmp")))
        print(
            f"sweep, kill {done}: {len(parts)} batches, {len(children)} workers, "
            f"{left} temporary folders",
            flush=True,
        )
        faults += [f"sweep, kill {done}: workers live on: {alive}"] if alive else []
        faults += [f"sweep, kill {done}: batches lost or changed: {lost}"] if lost else []
        before = parts
