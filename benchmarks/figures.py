"""Processor time of the figures of a run.

    python benchmarks/figures.py [RUN_DIR] [--repeat N]

Prints the processor seconds that ``plot_summary`` takes alone, once everything is imported and one
figure was drawn, and those of a new process that imports what it needs and draws one; beside them,
for scale, those of ``import matplotlib.figure`` in a new process. Without RUN_DIR the tee turn is
run first.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from omnitrack_sim import load_result, load_scenario, plot_summary, run

_READ = "import omnitrack_sim as ot; result = ot.load_result({run!r}); "
_DRAW = "import time, sys; before = time.process_time(); ot.plot_summary(result, {out!r}); "
_TELL = "print(time.process_time() - before)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("run", nargs="?", type=Path, help="folder of a saved run")
    parser.add_argument("--repeat", type=int, default=5, help="of each measurement")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = asked.run or run(load_scenario("tee_turn")).save(Path(folder) / "run")
        measure(place, Path(folder), asked.repeat)


def measure(place: Path, folder: Path, repeat: int) -> None:
    """Print a row for each measurement: median and least of ``repeat``."""
    result = load_result(place)
    print(f"{result!r}; processor seconds, median (least) of {repeat}")
    own = {"run": str(place), "out": str(folder / "summary.png")}
    whole = (_READ + _DRAW + _TELL).format(**own)
    _row(
        "import matplotlib.figure, new process", lambda: _spent("import matplotlib.figure"), repeat
    )
    _row("plot_summary and what it imports", lambda: float(_output(whole)), repeat)
    for ending in ("png", "pdf", "svg"):
        file = folder / f"summary.{ending}"
        plot_summary(result, file)
        _row(f"plot_summary alone, {ending}", lambda f=file: _timed(result, f), repeat)


def _row(text: str, once: Callable[[], float], repeat: int) -> None:
    times = [once() for _ in range(repeat)]
    print(f"{text:42} {statistics.median(times):6.2f} ({min(times):.2f})", flush=True)


def _timed(result, file: Path | None) -> float:
    before = time.process_time()
    plot_summary(result, file)
    return time.process_time() - before


def _output(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


def _spent(code: str) -> float:
    """Processor seconds of a new Python that runs ``code``, less those of one that runs nothing."""
    return _child(code) - _child("pass")


def _child(code: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    _output(code)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)


if __name__ == "__main__":
    main()
