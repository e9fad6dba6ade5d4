"""Puts candidates through their trials, on the engine of sweeps."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.errors import Fault, StudyError
from omnitrack_sim.base.text import counted
from omnitrack_sim.trials.optimise.explore import Candidate, Measured
from omnitrack_sim.trials.optimise.measure import Measure
from omnitrack_sim.trials.optimise.spec import Study
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep.batch import INVALID, Row
from omnitrack_sim.trials.sweep.dispatch import Pool, Progress, Store, run_missing
from omnitrack_sim.trials.sweep.table import made_by, result_fields
from omnitrack_sim.trials.sweep.trials import (
    Batch,
    Trial,
    batched,
    fitted,
    matches,
    places_of,
    trial_of,
    value_at,
)

if TYPE_CHECKING:
    import pyarrow as pa

_TOLD_REASONS = 3


class Layout:
    """The columns of the trials of a study."""

    def __init__(self, sweeps: Sequence[Sweep]):
        import pyarrow as pa

        bases = [base for sweep in sweeps for base in sweep.bases.values()]
        self.schema = pa.schema([pa.field("trial", pa.int64()), *result_fields(bases)])

    def table(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """The rows of a batch, with its hash and what made it in the metadata."""
        import pyarrow as pa

        rows = [row | {"model": batch.model} for row in rows]
        metadata = {"part": batch.hash, "made_by": json.dumps(made_by, sort_keys=True)}
        schema = self.schema.with_metadata(metadata)
        return pa.Table.from_pylist(rows, schema)


class Trials:
    """Evaluates candidates of a study: an ``Evaluate``.

    Every candidate is put through the same trials: one with the same number has the same draws.

    Args:
        study: with variables and objectives.
        sweeps: whose trials they are.
        store: keeps what has been run, and has what was run before.
        pool: runs the rest.
        progress: called with the status of each generation.
    """

    def __init__(
        self,
        study: Study,
        sweeps: Sequence[Sweep],
        store: Store,
        pool: Pool,
        progress: Progress | None,
    ):
        self.study, self.sweeps, self.store, self.pool = study, sweeps, store, pool
        self.progress = progress
        self.layout = Layout(sweeps)
        self.measure = Measure(study, sweeps)
        self.makers: set[str] = set()

    def __call__(self, candidates: Sequence[Candidate]) -> list[Measured]:
        """What the candidates have shown.

        Raises:
            StudyError: no trial of the first generation could run, or gave an objective.
        """
        import pyarrow as pa

        batches = batches_of(self.study, self.sweeps, candidates)
        run_missing(batches, self.store, self.layout, self.pool, self.progress)
        tables = [table for batch in batches if (table := self.store.read(batch)) is not None]
        self.makers |= {made_by(table) for table in tables}
        plain = [table.replace_schema_metadata(None) for table in tables]
        table = pa.concat_tables(plain).sort_by("trial")
        if candidates[0].number == 0 and self.sweeps is self.study.trials:
            _refuse_all_invalid(table)
            self.measure.refuse_unmeasured(table)
        return self.measure(table, len(candidates))


def _refuse_all_invalid(table: pa.Table) -> None:
    if set(table["outcome"].to_pylist()) == {INVALID}:
        reasons = list(dict.fromkeys(table["reason"].to_pylist()))
        first = counted(table.num_rows, "trial")
        raise StudyError(
            [
                Fault("variables", f"none of the first {first} is valid"),
                *(Fault("", reason) for reason in reasons[:_TOLD_REASONS]),
            ]
        )


def batches_of(
    study: Study, sweeps: Sequence[Sweep], candidates: Sequence[Candidate]
) -> list[Batch]:
    """The trials of candidates in batches that share a model.

    The trials of a candidate are numbered in the order of the sweeps, after those of the candidates
    with smaller numbers.
    """
    batches: list[Batch] = []
    size, first = sum(sweep.size for sweep in sweeps), 0
    for sweep in sweeps:
        plain = {name: base.model_dump(mode="json") for name, base in sweep.bases.items()}
        places, columns = places_of(plain, sweep.axes), sweep.trials()
        members = []
        for candidate in candidates:
            values = {name: _values(study, candidate, data) for name, data in plain.items()}
            for index in range(sweep.size):
                one = trial_of(places, columns, index)
                number = candidate.number * size + first + index
                members.append(Trial(number, one.base, one.changes | values[one.base]))
        batches += batched(plain, members, sweep.batch, len(batches))
        first += sweep.size
    return batches


def _values(study: Study, candidate: Candidate, data: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a candidate by every single place of a plain scenario that takes them."""
    return {
        place: fitted(value, value_at(data, place))
        for path, value in study.settings(candidate.values).items()
        for place in matches(data, path)
    }
