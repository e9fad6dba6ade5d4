"""The tables of a study: every candidate that was tried, the front, and the check."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.scenario.tables import unit_of
from omnitrack_sim.show.plots.study import Scale, Tried, study_figure
from omnitrack_sim.show.plots.style import save_figure
from omnitrack_sim.trials.search import (
    Candidate,
    History,
    Measured,
    best_of,
    front,
    values_of,
    violations_of,
)
from omnitrack_sim.trials.study import OF_TRIALS, Study, metrics_of
from omnitrack_sim.trials.study_tables import SUCCESS_RATE, Objective

if TYPE_CHECKING:
    import pyarrow as pa


Rows = Sequence[tuple[Candidate, Measured]]
COUNTS = ("trials", "passed", "invalid", "lost")


def history_table(study: Study, rows: Rows) -> pa.Table:
    """One row a candidate: its number, generation and search, values, objectives, limits."""
    import pyarrow as pa

    return pa.table(_columns(study, rows), _schema(study, ()))


def front_table(study: Study, rows: Rows) -> pa.Table:
    """The rows of the candidates on the front, the best of the first objective first."""
    import pyarrow as pa

    # Of an empty list pyarrow does not know that it holds places.
    return history_table(study, rows).take(pa.array(front(study, rows), pa.int64()))


def final_table(study: Study, rows: Rows) -> pa.Table:
    """The candidates that were checked with what they have shown there.

    Success rates have their Wilson intervals beside them, in columns that end in ``_low`` and
    ``_high``.
    """
    import pyarrow as pa

    columns = _columns(study, rows)
    on_front, best = set(front(study, rows)), best_of(study, rows)
    for i, (name, objective) in enumerate(zip(study.columns, study.objectives, strict=True)):
        if objective.metric == SUCCESS_RATE:
            count = counted(study, objective)
            ends = [wilson_interval(round(own.values[i] * count), count) for _, own in rows]
            columns |= {f"{name}_low": [end[0] for end in ends]}
            columns |= {f"{name}_high": [end[1] for end in ends]}
    columns |= {"on_front": [place in on_front for place in range(len(rows))]}
    columns |= {"best": [place == best for place in range(len(rows))]}
    return pa.table(columns, _schema(study, tuple(columns)))


def counted(study: Study, objective: Objective) -> int:
    """How many trials of the check an objective is made of."""
    return sum(s.size for s in study.unseen if objective.trials in (None, s.name))


def unit_of_objective(study: Study, objective: Objective) -> str:
    """Unit of an objective's value."""
    bases = [base for sweep in study.trials for base in sweep.bases.values()]
    metric = metrics_of(bases).get(objective.metric)
    return OF_TRIALS.get(objective.metric, "1") if metric is None else metric.unit


def _columns(study: Study, rows: Rows) -> dict[str, list[Any]]:
    candidates, measured = [row[0] for row in rows], [row[1] for row in rows]
    violations = violations_of(study, values_of(rows))
    columns: dict[str, list[Any]] = {
        key: [getattr(one, key) for one in candidates] for key in ("number", "generation", "search")
    }
    for i, variable in enumerate(study.variables):
        columns[variable.name] = [one.values[i] for one in candidates]
    for i, name in enumerate(study.columns):
        columns[name] = [one.values[i] for one in measured]
    columns["feasible"] = (violations == 0).tolist()
    columns |= {key: [getattr(one, key) for one in measured] for key in COUNTS}
    return columns


def _schema(study: Study, extra: Sequence[str]) -> pa.Schema:
    """Columns with their units; those of ``extra`` that are no others come last."""
    import pyarrow as pa

    fields = dict(_fields(study))
    for name in extra:
        kind = pa.bool_() if name in ("on_front", "best") else pa.float64()
        fields.setdefault(name, pa.field(name, kind))
    return pa.schema(list(fields.values()), metadata={"study_sha256": study.hash})


def _fields(study: Study) -> Iterator[tuple[str, pa.Field]]:
    import pyarrow as pa

    kinds: list[tuple[str, pa.DataType, str | None]] = [
        (key, pa.int64(), None) for key in ("number", "generation", "search")
    ]
    for variable in study.variables:
        kind = pa.int64() if variable.whole else pa.float64()
        kinds.append((variable.name, kind, unit_of(variable.name)))
    for name, objective in zip(study.columns, study.objectives, strict=True):
        kinds.append((name, pa.float64(), unit_of_objective(study, objective)))
    kinds.append(("feasible", pa.bool_(), None))
    kinds += [(key, pa.int64(), None) for key in COUNTS]
    for name, kind, unit in kinds:
        yield name, pa.field(name, kind, metadata={"unit": unit} if unit else None)


def draw_front(study: Study, history: History, checked: History | None, best: Candidate) -> bytes:
    """``front.png``, of the objectives that have a weight; of the others the limits alone count."""
    weighed = list(study.weighed)
    scales = [
        Scale(name, unit_of_objective(study, objective), objective.goal, objective.limit)
        for name, objective in ((study.columns[i], study.objectives[i]) for i in weighed)
    ]
    values = values_of(history)
    again = values_of(checked)[:, weighed] if checked else np.empty((0, len(scales)))
    places = [one.number for one, _ in checked or ()]
    feasible = violations_of(study, values) == 0
    on_front = front(study, history)
    tried = Tried(values[:, weighed], feasible, on_front, best.number, again, places)
    buffer = io.BytesIO()
    save_figure(study_figure(scales, tried), buffer, "png")
    return buffer.getvalue()
