"""Models of robots that were made for other worlds: each in a straight pipe of its own size.

    python benchmarks/strangers.py FILE_OR_FOLDER ... [--quick] [--seconds 0.5] [--workers N]

Of a folder come all MJCF and URDF files in it; parts of models, which others include, are passed
over. Each model is run for half a second as `omnitrack run FILE` does: in a straight of the size
that is found in it, with inputs to try. What does not run says why in a sentence.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from shape import Arguments, run_tasks, table

import omnitrack_sim as ot
from omnitrack_sim.robots.kinds import is_model_file
from omnitrack_sim.sim.model_template import model_scenario

SHOWN = 60
"""Letters of a path that the table shows, its last ones."""
ROOTS = re.compile(rb"<(mujoco|robot)[\s>]")
BODIES = re.compile(rb"<(body|link|include|attach|replicate)[\s>]")
"""Elements with which a file is a model, and of which one without bodies has none."""
GIVEN = re.compile(r" \(given: .*\)$")
"""What a message repeats of the input."""


class Answer(NamedTuple):
    """What became of a model.

    Attributes:
        file: its path.
        words: the outcome of its run; or why there was none.
        runs: it ran to the end.
        bore: m, of its pipe.
        travel: rad or m, of the joint that moved most.
        inputs: number of its actuators.
        seconds: that it took, the reading of its meshes included.
    """

    file: Path
    words: str
    runs: bool = False
    bore: float = np.nan
    travel: float = np.nan
    inputs: int = 0
    seconds: float = np.nan


def models_in(places: Sequence[Path]) -> Iterator[Path]:
    """Yield the model files at these places and in folders below them, in order."""
    for place in places:
        files = sorted(place.rglob("*")) if place.is_dir() else [place]
        for file in files:
            if is_model_file(str(file)) and file.is_file() and _is_whole(file):
                yield file


def _is_whole(file: Path) -> bool:
    """Return whether a file is a model, and not a part of one or other XML."""
    text = file.read_bytes()
    return bool(ROOTS.search(text) and BODIES.search(text))


def answer(file: Path, seconds: float) -> Answer:
    """Run a model in a straight of its size, as `omnitrack run` does."""
    begin = time.perf_counter()
    try:
        scenario = model_scenario(str(file), {"run.time_limit": seconds})
        result = ot.run(scenario, no_load=False)
    except ot.OmnitrackError as error:
        words = " ".join(str(error).split()).removeprefix(f"{file}: ")
        return Answer(file, GIVEN.sub("", words))
    moved = np.abs(result.qpos - result.qpos[0]).max(axis=0)[7:]
    return Answer(
        file,
        result.outcome.value,
        result.outcome is not ot.Outcome.DIVERGED,
        scenario.robot.nominal_bore,
        float(moved.max(initial=0.0)),
        len(scenario.robot.channels["ctrl"].names),
        time.perf_counter() - begin,
    )


def main() -> None:
    """Print what becomes of each model."""
    arguments = Arguments(__doc__, trials=100_000, quick=10, of="models", workers=True)
    arguments.add_argument("places", nargs="+", type=Path, metavar="FILE_OR_FOLDER")
    arguments.add_argument("--seconds", type=float, default=0.5, help="of each run; default 0.5")
    given = arguments.read()
    files = list(models_in(given.places))[: given.models]
    answers = run_tasks(partial(answer, seconds=given.seconds), files, given.workers)
    heads = ("model", "runs", "bore, m", "inputs", "largest travel", "s", "outcome, or why not")
    table("models", heads, map(_cells, answers))
    print(f"\n{sum(each.runs for each in answers)} of {len(answers)} models run")


def _cells(one: Answer) -> tuple[str, ...]:
    """Return the cells of a model's row."""
    name, runs = str(one.file)[-SHOWN:], "yes" if one.runs else "no"
    if np.isnan(one.bore):
        return name, runs, "-", "-", "-", "-", one.words
    figures = f"{one.bore:.3g}", str(one.inputs), f"{one.travel:.2g}", f"{one.seconds:.1f}"
    return name, runs, *figures, one.words


if __name__ == "__main__":
    main()
