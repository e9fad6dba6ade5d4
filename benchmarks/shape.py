"""The shape of a benchmark: its arguments, what it draws, what it runs on all cores, its tables.

Where the tables of trials say all that a benchmark shows, what it draws is a plan of trials
(``Trials``), and what it shows is made of their rows; what else it needs of a run is measured there
(``measure``). What is no run, or is timed, are tasks of its own (``run_tasks``).
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from omnitrack_sim import Conclusion, Plan, Round, Scenario, run_trials
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.record.statistics import rate_text, wilson_interval
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.trials.batches import Measure, Trial, batched, sha256_of
from omnitrack_sim.trials.plan import Rounds

Row = Mapping[str, Any]
"""A trial: a row of ``trials.parquet``, see docs/how-to/sweeps.md."""
_Task, _Answer = TypeVar("_Task"), TypeVar("_Answer")


class Arguments(argparse.ArgumentParser):
    """Arguments of a benchmark, whose description is its docstring.

    Args:
        doc: docstring of the module.
        trials: default of ``--trials``, or of the option ``of``; none: there is no such option.
        quick: the same of the quick form, ``--quick``; none: there is none.
        of: name of that option.
        seed: default of ``--seed``; none: there is no such option.
        workers: there is an option ``--workers``, all cores by default.
    """

    def __init__(
        self,
        doc: str | None,
        *,
        trials: int | None = None,
        quick: int | None = None,
        of: str = "trials",
        seed: int | None = None,
        workers: bool = False,
    ) -> None:
        raw = argparse.RawDescriptionHelpFormatter
        super().__init__(description=doc, formatter_class=raw)
        self._of, self._counts = of, (trials, quick)
        if trials is not None:
            self.add_argument(f"--{of}", type=int, metavar="N", help=f"default {trials}")
        if quick is not None:
            self.add_argument("--quick", action="store_true", help=f"{quick} {of}")
        if seed is not None:
            self.add_argument("--seed", type=int, default=seed, help=f"default {seed}")
        if workers:
            self.add_argument(
                "--workers", type=int, default=os.cpu_count() or 1, help="processes; all cores"
            )

    def read(self) -> argparse.Namespace:
        """Return the arguments of the command line, with the number of trials that they mean."""
        given = self.parse_args()
        whole, quick = self._counts
        if whole is not None and getattr(given, self._of) is None:
            setattr(given, self._of, quick if getattr(given, "quick", False) else whole)
        return given


class Trials(Plan):
    """Trials that a benchmark draws.

    Args:
        name: of the benchmark.
        groups: scenarios by what they are trials of, such as a variant or a cell of a table.
        columns: what of a scenario stands in its row as well, by name.
        measure: what of a result stands in its row as well.
        batch: trials that run together, at most.
    """

    noun = "benchmark"

    def __init__(
        self,
        name: str,
        groups: Mapping[Hashable, Sequence[Scenario]],
        columns: Mapping[str, Callable[[Scenario], Any]] | None = None,
        measure: Measure | None = None,
        batch: int = 32,
    ) -> None:
        self.name, self.groups = name, groups
        scenarios = [scenario for group in groups.values() for scenario in group]
        labels = [str(key) for key, group in groups.items() for _ in group]
        drawn = {name: [read(one) for one in scenarios] for name, read in (columns or {}).items()}
        self._columns = {"group": labels, **drawn}
        bases = {str(i): one.model_dump(mode="json") for i, one in enumerate(scenarios)}
        trials = (Trial(i, str(i), {}) for i in range(len(bases)))
        self._batches = batched(bases, trials, batch, measure)

    @property
    def hash(self) -> str:
        """SHA-256 of everything that its trials depend on, hexadecimal."""
        return sha256_of([batch.hash for batch in self._batches])

    def data(self) -> dict[str, Any]:
        """Return the plan as plain data, for its record."""
        return {"name": self.name, "groups": {str(k): len(v) for k, v in self.groups.items()}}

    def rounds(self) -> Rounds:
        """Yield all trials at once."""
        table = yield Round(self._batches, self._columns)
        return Conclusion({"trials": table.num_rows})

    def run(self, workers: int = 1, out: Path | None = None) -> dict[Any, list[Row]]:
        """Run all trials, and return the rows of each group; the folder ``out`` keeps them."""
        rows = iter(run_trials(self, out=out, workers=workers).table.to_pylist())
        return {key: [next(rows) for _ in group] for key, group in self.groups.items()}


def random_gravity(rng: np.random.Generator) -> list[float]:
    """Draw gravity (3,), m/s², in any direction."""
    # Normal components have no preferred direction.
    direction = rng.normal(size=3)
    return (GRAVITY * direction / np.linalg.norm(direction)).tolist()


def run_tasks(
    function: Callable[[_Task], _Answer], tasks: Iterable[_Task], workers: int
) -> list[_Answer]:
    """Return the answers of a function to tasks, in their order, from several processes."""
    with LocalPool(workers) as pool:
        return list(pool.map(function, tasks))


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[Any]], text: str = "") -> None:
    """Print a table of Markdown below a heading, each row as it comes.

    Args:
        title: of the heading, by which pages find the table.
        heads: of the columns.
        rows: cells, each shown by ``str``.
        text: between heading and table.
    """
    print(*filter(None, (f"\n## {title}", text, markdown(heads, ()))), sep="\n\n", flush=True)
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |", flush=True)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table of Markdown."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])


def interval(passed: Iterable[bool], digits: int = 0) -> str:
    """Return Wilson's 95 % interval of a rate, in %."""
    each = list(passed)
    low, high = (100 * end for end in wilson_interval(sum(each), len(each)))
    return f"{low:.{digits}f} to {high:.{digits}f} %"


def rate(rows: Sequence[Row]) -> str:
    """Return how many trials passed, with the interval of their rate."""
    return rate_text(sum(row["success"] for row in rows), len(rows))


def endings(failed: Iterable[str]) -> str:
    """Return how often runs ended in each way, the commonest first."""
    counts = Counter(failed).most_common()
    return ", ".join(f"{count} {name}" for name, count in counts) or "-"


def modules_of(row: Row, metric: str) -> list[float]:
    """Return the values of a metric of a trial: of the modules, or the one of the robot."""
    return [row[name] for name in (metric, *(f"{metric}_{i}" for i in (1, 2, 3))) if name in row]


def mean_of(rows: Sequence[Row], metric: str) -> str:
    """Return the mean of a metric over trials that passed and modules, to three digits."""
    values = [np.mean(modules_of(row, metric)) for row in rows if row["success"]]
    return f"{np.mean(values):.3g}" if values else "-"


def compare(
    title: str,
    variants: Mapping[str, Sequence[Row]],
    columns: Mapping[str, Callable[[Sequence[Row]], str]],
    head: str = "variant",
) -> None:
    """Print a table of variants: the trials of each, by its name, in the columns."""
    rows = ([name, *(text(own) for text in columns.values())] for name, own in variants.items())
    table(title, [head, *columns], rows)
