"""The batch: determinism, order, independence of neighbours, divergence."""

from typing import Any

import mujoco.batch
import numpy as np
import pytest

from omnitrack_sim import (
    Channel,
    Outcome,
    Result,
    Sensor,
    Simulation,
    load_scenario,
    override,
    run,
    run_batch,
)
from omnitrack_sim.record import trajectory as recording
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.sim import run as running


def _short_tee(**changes):
    base = override(load_scenario("tee_turn"), {"run.time_limit": 3.2, "control.align": False})
    return override(base, {k.replace("__", "."): v for k, v in changes.items()})


def _equal(a: Result, b: Result) -> bool:
    names = all(np.array_equal(a.trajectory[n], b.trajectory[n]) for n in RECORDED)
    return (
        names
        and np.array_equal(a.trajectory.qpos, b.trajectory.qpos)
        and a.summary() == b.summary()
    )


def test_same_bytes_at_any_thread_count_alone_and_in_a_batch():
    """A trial is bit for bit the same at 1 and 2 threads, alone and among 15 others."""
    scenario = _short_tee(start__theta5_deg=5.0)
    others = [
        _short_tee(start__theta5_deg=a, world__friction=0.8)
        for a in np.linspace(-30, 30, 15).tolist()
    ]
    alone, threaded = run(scenario), run(scenario, threads=2)
    batch = run_batch([*others[:7], scenario, *others[7:]], threads=2)
    assert _equal(alone, threaded)
    assert _equal(alone, batch[7])


def test_a_trial_that_ends_earlier_keeps_its_own_record():
    """A neighbour that runs longer changes neither the length nor the end of a trial's record."""
    scenario = _short_tee()
    short = override(scenario, {"run.time_limit": 1.005})
    alone, (together, longer) = run(short), run_batch([short, scenario])
    assert _equal(alone, together)
    assert together.trajectory.time[-1] == pytest.approx(together.duration_s)
    assert len(longer.trajectory.time) > len(together.trajectory.time)


def test_results_keep_the_order_of_the_scenarios():
    """Scenarios of different models and speeds come back in the order they were given."""
    names = ["straight", "vertical_climb", "straight", "elbow"]
    limit = {"run.time_limit": 0.3}
    results = run_batch(
        [override(load_scenario(n), limit | {"seed": i}) for i, n in enumerate(names)]
    )
    assert [r.scenario.seed for r in results] == [0, 1, 2, 3]
    assert [r.scenario.name for r in results] == names


def test_a_diverging_trial_ends_alone():
    """A trial whose state becomes infinite ends as diverged; its neighbour goes on."""
    simulation = Simulation([_short_tee(run__time_limit=0.5)] * 2)
    simulation.plant.qpos[0, 0] = np.nan
    simulation.advance()
    assert [r.outcome for r in simulation.results()] == [Outcome.DIVERGED, Outcome.TIMED_OUT]


class RaisingBatch:
    """The batch of a plant whose engine raises for one robot from some call on."""

    def __init__(self, batch: Any, robot: int, calls: int) -> None:
        self._batch, self._robot, self._calls = batch, robot, calls

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)

    def step(self, active: np.ndarray, nstep: int) -> None:
        """As the engine does it: the robot keeps its state, the others are stepped."""
        self._calls -= 1
        if self._calls >= 0 or not active[self._robot]:
            self._batch.step(active, nstep=nstep)
            return
        others = active.copy()
        others[self._robot] = False
        self._batch.step(others, nstep=nstep)
        raise mujoco.batch.SimulationError(np.array([self._robot]), "singular", len(active))


def test_a_trial_on_which_the_engine_raises_ends_alone():
    """It ends as diverged at that step, with the record up to there; its neighbours go on, with
    the bytes that they have without it."""
    scenario = _short_tee(run__time_limit=0.5)
    plain, simulation = Simulation([scenario] * 2), Simulation([scenario] * 3)
    simulation.plant._batch = RaisingBatch(simulation.plant._batch, 1, calls=20)
    plain.advance()
    simulation.advance()
    first, broken, last = simulation.results()
    assert broken.outcome is Outcome.DIVERGED
    assert broken.duration_s == pytest.approx(0.2, abs=0.011)
    assert len(broken.trajectory.time) == 11
    for neighbour, expected in zip((first, last), plain.results(), strict=True):
        assert neighbour.outcome is Outcome.TIMED_OUT
        assert _equal(neighbour, expected)


def test_time_is_strictly_increasing_and_samples_are_regular():
    """Samples stand one record period apart."""
    time = run(_short_tee(run__time_limit=0.5)).trajectory.time
    assert np.allclose(np.diff(time), 0.02)


def test_progress_reports_rise_to_the_end():
    """Progress is called with parts between 0 and 1 that do not fall."""
    parts: list[float] = []
    run(_short_tee(), progress=lambda part, text: parts.append(part))
    assert len(parts) > 2
    assert parts == sorted(parts)
    assert 0 <= parts[0] <= parts[-1] <= 1


def test_samples_are_kept_in_blocks_without_a_gap(monkeypatch):
    """A record of several blocks, the last one not full, is that of a single block, bit for bit."""
    scenario = override(load_scenario("straight"), {"run.time_limit": 0.5})
    whole = run(scenario)
    monkeypatch.setattr(recording, "BLOCK", 7)
    pieces = run(scenario)
    assert len(whole.trajectory.time) == 26
    assert _equal(whole, pieces)


def test_slip_without_load_is_measured_once_and_again_for_what_differs(monkeypatch):
    """Of robots that are alike in robot, friction and speed, in this call or an earlier one; not
    where a user's sensor looks on, whose code may have changed."""
    made: list[int] = []

    class Counted(Simulation):
        def __init__(self, scenarios, **options) -> None:
            made.append(len(scenarios))
            super().__init__(scenarios, **options)

    monkeypatch.setattr(running, "Simulation", Counted)
    monkeypatch.setattr(running, "_known", {})
    height = Channel("height", (), "m", "height of the centre", "world")
    looks_on = Sensor(height, lambda state: state["position"][:, 2])
    turns = [load_scenario("tee_turn", {"start.theta5_deg": float(i)}) for i in range(3)]
    wet = override(turns[0], {"world.friction": 0.5})
    no_load_slips = running.no_load_slips
    first = no_load_slips([*turns, wet])
    assert made == [2]
    assert first[0] == first[1] == first[2] != first[3]
    assert no_load_slips([wet, turns[1]]) == [first[3], first[0]]
    assert made == [2]
    assert no_load_slips([wet], [looks_on]) == [first[3]]
    assert made == [2, 1]
