"""Kills a sweep at random moments, resumes it, and compares its table with an undisturbed one.

python benchmarks/kill_test.py [--kills N] [--trials N] [--workers N] [--seed N]

After each kill it checks that the workers have died with their parent and that no finished batch
was lost or changed. Ends with status 1 if a worker lives on, a batch is lost, or a file of the two
folders differs by a byte.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FILES = ("trials.parquet", "trials.csv", "summary.json", "success_map.png", "sweep.json")
SWEEP = """
base = "tee_turn"
samples = {trials}
batch = 8
[set]
"physics.time_limit" = 1.5
"physics.wall_tolerance" = 0.0005
[[axes]]
path = "start.theta5_deg"
kind = "uniform"
low = -60
high = 60
[[axes]]
path = "contact.friction"
kind = "uniform"
low = 0.6
high = 1.0
[[axes]]
path = "world.gravity"
kind = "direction"
"""
GRACE = 5.0
"""Seconds in which workers must be gone after their parent."""


def main() -> int:
    """Kill, go on, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "kill_test.toml"
        file.write_text(SWEEP.format(trials=given.trials), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "omnitrack_sim.cli",
            "sweep",
            str(file),
            "--json",
            "--workers",
        ]
        calm, killed = Path(place) / "calm", Path(place) / "killed"
        start = time.perf_counter()
        subprocess.run([*command, "1", "--out", str(calm)], check=True, stdout=subprocess.DEVNULL)
        print(f"uninterrupted, 1 worker: {time.perf_counter() - start:.1f} s", flush=True)
        faults = kill_often(
            [*command, str(given.workers), "--out", str(killed)], killed, given.kills, given.seed
        )
        different = [
            name for name in FILES if (calm / name).read_bytes() != (killed / name).read_bytes()
        ]
    print("all files equal" if not different else f"different: {', '.join(different)}")
    return 1 if faults or different else 0


def kill_often(command: list[str], folder: Path, kills: int, seed: int) -> int:
    """Run ``command`` to its end, killing it ``kills`` times on the way; number of faults seen."""
    rng = random.Random(seed)
    faults = done = 0
    before: dict[str, bytes] = {}
    while True:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        # From the first moments of Python, over the start of the workers, into the batches.
        until = time.monotonic() + rng.choice([rng.uniform(0.1, 3.0), rng.uniform(3.0, 6.0)])
        while done < kills and time.monotonic() < until and process.poll() is None:
            time.sleep(0.01)
        if done >= kills or process.poll() is not None:
            status = process.wait()
            print(f"ended with status {status} after {done} kills", flush=True)
            return faults + (status != 0) + (done < kills)
        children = descendants(process.pid)
        process.send_signal(signal.SIGKILL)
        process.wait()
        done += 1
        alive = survivors(children)
        parts = {path.name: path.read_bytes() for path in (folder / "parts").glob("[0-9]*.parquet")}
        lost = [name for name, data in before.items() if parts.get(name) != data]
        left = len(list(folder.rglob(".omnitrack-*.tmp")))
        print(
            f"kill {done}: {len(parts)} batches, {len(children)} workers, {left} temporary folders",
            flush=True,
        )
        if alive or lost:
            print(f"  FAULT: alive {alive}, lost or changed {lost}")
            faults += 1
        before = parts


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


if __name__ == "__main__":
    sys.exit(main())
