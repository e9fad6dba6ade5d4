"""Runs a shipped study with a smaller search.

python benchmarks/study.py NAME --out DIR --generations N --samples N [N ...] [--workers N]

Without check of the best. Each direction asks for as few candidates as CMA-ES takes, and there is
one direction for each objective. --samples is of the random trials, in the order of the study's
tables. The folder is that of `omnitrack optimise`; prints how the search was made and its best.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from shape import Arguments

import omnitrack_sim as ot

POPULATION = 4


def smaller(study: ot.Study, generations: int, samples: Sequence[int]) -> ot.Study:
    """Return a study of fewer candidates and trials, without a check."""
    left = list(samples)
    trials = [
        sweep.model_copy(update={"samples": left.pop(0)}) if sweep.samples > 1 else sweep
        for sweep in study.trials
    ]
    fewer = {
        "generations": generations,
        "population": POPULATION,
        "directions": len(study.objectives),
        "trials": tuple(trials),
        "final": study.final.model_copy(update={"candidates": 0}),
    }
    return study.model_copy(update=fewer)


def main() -> None:
    """Search and print how."""
    parser = Arguments(__doc__)
    parser.add_argument("name")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--generations", type=int, required=True)
    parser.add_argument("--samples", type=int, nargs="+", required=True)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.read()
    study = smaller(ot.load_study(given.name), given.generations, given.samples)
    result = ot.run_trials(study, out=given.out, workers=given.workers)
    print(
        f"## extent\n\nA search of {given.generations} generations, {result.summary['candidates']} "
        f"candidates, {study.size} trials each; {result.tables['front'].num_rows} are on the front."
    )


if __name__ == "__main__":
    main()
