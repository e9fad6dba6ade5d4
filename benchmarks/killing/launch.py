"""Starts ``omnitrack``, which dies by SIGKILL right before its n-th change below a folder.

python launch.py FOLDER N COUNT_FILE RUNS ARGUMENT...

With N = 0 it lives, and writes the number of its changes into COUNT_FILE. RUNS is a folder
that keeps the simulations of ``reproduce`` from the first start on, so that later ones need not
wait for them; ``-`` where there are none.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omnitrack_sim import Scenario
    from omnitrack_sim.paper.experiments import Runs

CHANGES = {
    *("os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.link", "os.symlink", "os.chmod"),
    *("os.truncate", "shutil.rmtree", "shutil.move", "tempfile.mkdtemp", "tempfile.mkstemp"),
}
"""Audit events of changes to files. Opening for writing counts, too."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def main() -> None:
    """Watch, and run the command line."""
    folder, deadly, count_file, runs, *arguments = sys.argv[1:]
    _watch(folder, int(deadly), Path(count_file))
    if runs != "-":
        _remember(Path(runs))
    sys.argv = ["omnitrack", *arguments]
    from omnitrack_sim.cli import main as omnitrack

    omnitrack()


def _watch(folder: str, deadly: int, count_file: Path) -> None:
    count = 0

    def look(event: str, given: tuple[Any, ...]) -> None:
        nonlocal count
        if _changes(event, given, folder):
            count += 1
            if count == deadly:
                os.killpg(0, signal.SIGKILL)

    def tell() -> None:
        if deadly == 0:
            count_file.write_text(str(count))

    sys.addaudithook(look)
    atexit.register(tell)


def _changes(event: str, given: tuple[Any, ...], folder: str) -> bool:
    """Whether an event is a change below the folder."""
    if event == "open":
        return bool(given[2] & WRITING) and _below(given[0], folder)
    if event not in CHANGES:
        return False
    # What is removed with a whole folder goes by a name alone and the descriptor of its folder.
    by_name = event in ("os.remove", "os.rmdir") and given[-1] != -1
    return by_name or any(_below(path, folder) for path in given)


def _below(path: Any, folder: str) -> bool:
    if not isinstance(path, str | bytes | os.PathLike):
        return False
    return os.path.realpath(os.path.dirname(os.path.abspath(os.fsdecode(path)))).startswith(folder)


def _remember(folder: Path) -> None:
    """Have ``reproduce`` take its runs from a folder, which the first start writes."""
    from omnitrack_sim import load_result
    from omnitrack_sim.paper import reproduce as command

    simulate = command.run_all

    def remembered(lists: Mapping[str, Sequence[Scenario]], progress: Any = None) -> Runs:
        if not folder.is_dir():
            new = folder.with_name("new_runs")
            for name, results in simulate(lists, progress).items():
                for i, result in enumerate(results):
                    result.save(new / name / str(i))
            new.rename(folder)
        return {
            name: [load_result(folder / name / str(i)) for i in range(len(scenarios))]
            for name, scenarios in lists.items()
        }

    command.run_all = remembered


if __name__ == "__main__":
    main()
