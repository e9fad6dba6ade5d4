"""Plans of a user's own: rounds that follow from the results before, run by the one engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import pyarrow.parquet as pq
import pytest

import omnitrack_sim as ot
from omnitrack_sim.trials import dispatch
from omnitrack_sim.trials.batches import Batch, Trial, batched, sha256_of
from omnitrack_sim.trials.plan import Rounds

SPEEDS = (0.05, 0.1)


def samples(result: ot.Result) -> dict[str, float]:
    """Return the number of samples of a run."""
    return {"samples": float(len(result.trajectory.time))}


class Faster(ot.Plan):
    """Drives at two speeds, and then once more at the one that got farther."""

    noun: ClassVar[str] = "race"
    names: ClassVar[tuple[str, ...]] = ("speeds",)
    name: str = "faster"

    def __init__(self, copies: int = 1) -> None:
        scenario = ot.load_scenario("straight", {"run.time_limit": 0.1})
        self.copies = copies
        self.bases = {"straight": scenario.model_dump(mode="json")}

    @property
    def hash(self) -> str:
        """Of its bases."""
        return sha256_of(self.bases)

    def data(self) -> dict[str, Any]:
        """Return its bases."""
        return {"bases": self.bases}

    def _asked(self, *speeds: float) -> list[Batch]:
        changes = [{"control.cruise_speed": speed} for speed in speeds]
        trials = (Trial(i, "straight", own) for i, own in enumerate(changes))
        return batched(self.bases, trials, 1)

    def rounds(self) -> Rounds:
        """Ask for both speeds, then for the better one."""
        first = yield ot.Round(
            self._asked(*SPEEDS), {"speed": SPEEDS}, total=2 + self.copies, stage="both"
        )
        far = first["distance_m"].to_pylist()
        best = SPEEDS[far.index(max(far))]
        again = yield ot.Round(
            self._asked(*[best] * self.copies),
            {"speed": [best] * self.copies, "again": [True] * self.copies},
            stage="again",
            tables={"speeds": first.select(["speed", "distance_m"])},
        )
        assert again["trial"].to_pylist() == list(range(2, 2 + self.copies))
        return ot.Conclusion({"best": best}, {"speeds": first.select(["speed"])})


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A folder in which the plan has run."""
    place = tmp_path_factory.mktemp("plans") / "race"
    ot.run_trials(Faster(), out=place)
    return place


def test_a_round_follows_from_the_results_of_the_one_before(done):
    """Its trials stand behind those before, with the columns of both rounds."""
    table = pq.read_table(done / "trials.parquet")
    assert table["speed"].to_pylist() == [0.05, 0.1, 0.1]
    assert table["again"].to_pylist() == [None, None, True]
    assert table["trial"].to_pylist() == [0, 1, 2]
    assert table["distance_m"].to_pylist()[1] == table["distance_m"].to_pylist()[2]
    assert json.loads((done / "summary.json").read_text())["best"] == 0.1
    assert "race" in json.loads((done / "race.json").read_text())
    assert pq.read_table(done / "speeds.parquet").column_names == ["speed"]


def test_equal_batches_are_run_once(done):
    """Parts are named by their contents: the third trial is the second one again."""
    assert len(list((done / "parts").glob("*.parquet"))) == 2
    told: list[Any] = []
    result = ot.run_trials(Faster(copies=3), progress=told.append)
    assert (result.table.num_rows, result.status.done, result.status.total) == (5, 5, 5)
    assert [status.stage for status in (told[0], told[-1])] == ["both", "again"]


def test_a_plan_that_is_resumed_runs_nothing_again(done, monkeypatch):
    """All of its rounds are found in the folder."""
    monkeypatch.setattr(dispatch, "run_rows", None)
    status = ot.run_trials(Faster(), out=done).status
    assert (status.found, status.done) == (3, 3)


def test_a_share_ends_where_it_needs_the_trials_of_others(tmp_path):
    """The share that comes last in a round goes on to the next one."""
    first = ot.run_trials(Faster(), out=tmp_path / "race", shard=(1, 2))
    assert (first.table.num_rows, first.summary) == (1, {})
    assert not (tmp_path / "race" / "trials.parquet").exists()
    last = ot.run_trials(Faster(), out=tmp_path / "race", shard=(2, 2))
    assert (last.table.num_rows, last.summary["best"]) == (3, 0.1)


def test_a_plan_in_the_folder_of_another_kind_is_refused(done):
    """A sweep does not write into a race."""
    with pytest.raises(ot.OutputError, match=r"no sweep\.json, so it is no sweep"):
        ot.run_trials(ot.load_sweep("elbow_orientation"), out=done)


def test_a_batch_measures_what_no_metric_says(tmp_path):
    """Its function of results adds columns to the rows, the same from other processes and from the
    folder; a trial that did not run has none, and another function makes another batch."""

    class Measured(Faster):
        names: ClassVar[tuple[str, ...]] = ()

        def rounds(self) -> Rounds:
            speeds = (*SPEEDS, -1.0)
            changes = [{"control.cruise_speed": speed} for speed in speeds]
            trials = (Trial(i, "straight", own) for i, own in enumerate(changes))
            yield ot.Round(batched(self.bases, trials, 1, samples))
            return ot.Conclusion({})

    result = ot.run_trials(Measured(), out=tmp_path / "race", workers=2)
    assert result.table["samples"].to_pylist() == [6.0, 6.0, None]
    assert result.table["outcome"].to_pylist() == ["timed_out", "timed_out", "invalid"]
    again = ot.run_trials(Measured(), out=tmp_path / "race")
    assert again.status.found == 3
    assert again.table.equals(result.table)
    (plain,) = batched(Measured().bases, [Trial(0, "straight", {})], 1)
    (measured,) = batched(Measured().bases, [Trial(0, "straight", {})], 1, samples)
    assert plain.hash != measured.hash
