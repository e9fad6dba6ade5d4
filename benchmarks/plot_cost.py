"""Processor time of the figures of a run.

    python benchmarks/plot_cost.py [RUN_DIR] [--repeat N]

Prints the processor seconds of ``plot_summary`` alone, once everything is imported and a figure was
drawn, and those of its first call in a new process, with what it imports; beside them, for scale,
those of ``import matplotlib.figure`` in a new process. Without RUN_DIR the tee turn is run first.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import omnitrack_sim as ot

_IMPORT = "import time; begin = time.process_time(); import matplotlib.figure"
_FIRST = """
import time
import omnitrack_sim as ot
result = ot.load_result({run!r})
begin = time.process_time()
ot.plot_summary(result, path={file!r})
"""
_TELL = "\nprint(time.process_time() - begin)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("run", nargs="?", type=Path, help="folder of a saved run")
    parser.add_argument("--repeat", type=int, default=5, help="of each measurement")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = asked.run or ot.run(ot.load_scenario("tee_turn")).save(Path(folder) / "run")
        measure(place, Path(folder), asked.repeat)


def measure(place: Path, folder: Path, repeat: int) -> None:
    """Print a row for each measurement: median and least of ``repeat``."""
    result, file = ot.load_result(place), folder / "summary.png"
    print(f"{result!r}; processor seconds, median (least) of {repeat}")
    first = _FIRST.format(run=str(place), file=str(file))
    _row("import matplotlib.figure, in a new process", lambda: _told(_IMPORT), repeat)
    _row("plot_summary with what it imports, there", lambda: _told(first), repeat)
    figures = {"plot_summary, not written": partial(ot.plot_summary, result)}
    for ending in ("png", "pdf", "svg"):
        to = file.with_suffix(f".{ending}")
        figures[f"plot_summary, {ending}"] = partial(ot.plot_summary, result, path=to)
    figures["plot_mission, png"] = partial(ot.plot_mission, result, path=file)
    figures["plot_compare, png"] = partial(ot.plot_compare, result, result, path=file)
    for text, draw in figures.items():
        draw()  # what is loaded or made once, is
        _row(text, partial(_timed, draw), repeat)


def _row(text: str, once: Callable[[], float], repeat: int) -> None:
    times = [once() for _ in range(repeat)]
    print(f"{text:44} {statistics.median(times):6.2f} ({min(times):.2f})", flush=True)


def _timed(draw: Callable[[], object]) -> float:
    begin = time.process_time()
    draw()
    return time.process_time() - begin


def _told(code: str) -> float:
    """What code measures and tells in a new process."""
    command = [sys.executable, "-c", code + _TELL]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


if __name__ == "__main__":
    main()
