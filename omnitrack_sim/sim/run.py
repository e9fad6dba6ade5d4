"""Runs scenarios to their ends: one run is a batch of one."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from omnitrack_sim.base.arguments import check_all
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.table import FileName, marks_of
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.control import Controller, parameters_model
from omnitrack_sim.robots.sensor import Sensor
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.loading import as_scenario, autopilot_of
from omnitrack_sim.sim.builder import batch_key
from omnitrack_sim.sim.sensing import MakeSenses
from omnitrack_sim.sim.simulation import MakePilot, Progress, Simulation

BASELINE_TIME, BASELINE_SETTLED = 1.2, 0.8
"""Length of the run that measures the no-load slip, and from when on it counts, s."""
SLIP = "slip_velocity"
"""Channel that it is measured by; robots without it have no such run."""


def run(
    scenario: Scenario | str | os.PathLike[str],
    *,
    controller: type[Controller] | None = None,
    pilot: MakePilot = Scenario.pilot,
    senses: MakeSenses | None = None,
    sensors: Sequence[Sensor] = (),
    metrics: Sequence[Metric] = (),
    threads: int = 0,
    progress: Progress | None = None,
    no_load: bool = True,
) -> Result:
    """Run one scenario to its end. A robot that fails is a result, not an error.

    Args:
        scenario: what to run; a file, or the name of a shipped one.
        controller: see ``Simulation``.
        pilot: see ``Simulation``.
        senses: see ``Simulation``.
        sensors: see ``Simulation``.
        metrics: further ones, see docs/how-to/extending.md.
        threads: native threads for the physics; 0 uses all cores. The results do not depend on it.
        progress: see ``Progress``.
        no_load: also measure the slip without load, by a short run for each robot, friction and
            speed; without it ``no_load_slip_m_s`` is not a number.

    Raises:
        ScenarioError: the file cannot be used, or there is no scenario of that name.
        TypeError: an argument is of another type.

    Example:
        >>> ot.run("straight", no_load=False).success
        True
        >>> scenario = ot.load_scenario("straight", {"run.time_limit": 0.2})
        >>> result = ot.run(scenario, no_load=False)
        >>> result.outcome.value, round(result.duration_s, 2)
        ('timed_out', 0.2)
    """
    return run_batch(
        [as_scenario(scenario)],
        controller=controller,
        pilot=pilot,
        senses=senses,
        sensors=sensors,
        metrics=metrics,
        threads=threads,
        progress=progress,
        no_load=no_load,
    )[0]


@trusting()
def run_batch(
    scenarios: Sequence[Scenario],
    *,
    controller: type[Controller] | None = None,
    pilot: MakePilot = Scenario.pilot,
    senses: MakeSenses | None = None,
    sensors: Sequence[Sensor] = (),
    metrics: Sequence[Metric] = (),
    threads: int = 0,
    progress: Progress | None = None,
    no_load: bool = True,
) -> list[Result]:
    """Run scenarios, those that share a model in one batch; results in the order of ``scenarios``.

    Args:
        scenarios: any number, none too.
        controller: see ``run``.
        pilot: see ``run``.
        senses: see ``run``.
        sensors: see ``run``.
        metrics: see ``run``.
        threads: see ``run``.
        progress: see ``run``.
        no_load: see ``run``.

    Raises:
        TypeError: an argument is of another type.

    Example:
        >>> base = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.1})
        >>> wet = ot.override(base, {"world.friction": 0.5})
        >>> [result.success for result in ot.run_batch([base, wet], no_load=False)]
        [False, False]
    """
    scenarios = check_all(Scenario, "scenarios", scenarios)
    sensors, metrics = check_all(Sensor, "sensors", sensors), check_all(Metric, "metrics", metrics)
    if controller is not None:
        scenarios = [scenario.driven_by(controller) for scenario in scenarios]
    slips = no_load_slips(scenarios, sensors) if no_load else None
    results: dict[int, Result] = {}
    for indices in _batches(scenarios):
        done = len(results) / len(scenarios)
        share = len(indices) / len(scenarios)
        report = (
            None
            if progress is None
            # Bound as defaults: the loop changes both before the last report.
            else (lambda part, text, d=done, s=share: progress(d + s * part, text))
        )
        batch = [scenarios[i] for i in indices]
        simulation = Simulation(batch, pilot=pilot, senses=senses, sensors=sensors, threads=threads)
        simulation.advance(report)
        baseline = None if slips is None else [slips[i] for i in indices]
        results.update(zip(indices, simulation.results(baseline, metrics), strict=True))
    return [results[i] for i in range(len(scenarios))]


def no_load_slips(scenarios: Sequence[Scenario], sensors: Sequence[Sensor] = ()) -> list[float]:
    """Measure the mean slip speed, m/s, of robots in a straight pipe without gravity.

    Regularised friction creeps: this is what slip reads when nothing pulls. Measured by a short
    run, one for each robot, physics, friction and speed; not a number of a robot without a channel
    ``slip_velocity``, and where that run ends early, as that of a robot that diverges does.
    ``sensors`` are there for controllers that look at them.
    """
    loaded = [i for i, scenario in enumerate(scenarios) if SLIP in scenario.robot.channels]
    # Robots that are alike in friction, speed and physics share one measurement.
    data = [_unloaded(scenarios[i]) for i in loaded]
    texts = [repr(each) for each in data]
    bare = {text: validate(each) for text, each in dict(zip(texts, data, strict=True)).items()}
    slips = {text: _known[text] for text in bare if text in _known and not sensors}
    names = [text for text in bare if text not in slips]
    runs = [bare[text] for text in names]
    for indices in _batches(runs):
        simulation = Simulation([runs[i] for i in indices], sensors=sensors)
        simulation.advance()
        trajectories = simulation.recorder.trajectories(simulation.end_time)
        for index, trajectory in zip(indices, trajectories, strict=True):
            slip = np.abs(trajectory[SLIP][trajectory.time >= BASELINE_SETTLED])
            slips[names[index]] = float(slip.mean()) if len(slip) else math.nan
            if not sensors and _says_all(runs[index]):
                _known[names[index]] = slips[names[index]]
    known = {i: slips[text] for i, text in zip(loaded, texts, strict=True)}
    return [known.get(i, math.nan) for i in range(len(scenarios))]


_known: dict[str, float] = {}
"""Slips without load that this process has measured, by the data of the run: measuring one takes a
sixth of the time of a turn."""


def _says_all(scenario: Scenario) -> bool:
    """Return whether a scenario's data decide its run, and no file or code of a user's.

    Those may change while a process lasts.
    """
    controller = scenario.controller_class
    tables = (type(scenario.robot), parameters_model(controller))
    own = all(one.__module__.startswith("omnitrack_sim.") for one in (tables[0], controller))
    return own and not any(marks_of(table, FileName) for table in tables)


def _batches(scenarios: Sequence[Scenario]) -> list[list[int]]:
    """Indices of the scenarios that can be stepped together, in order of their first."""
    groups: dict[str, list[int]] = defaultdict(list)
    for index, scenario in enumerate(scenarios):
        groups[batch_key(scenario.model_dump(mode="json"))].append(index)
    return list(groups.values())


def _unloaded(scenario: Scenario) -> dict[str, Any]:
    """Plain data of the scenario's robot in a straight pipe without gravity."""
    first, own = scenario.route.passages[0], scenario.robot.length
    # Long enough for it not to arrive before its slip is measured.
    travel = scenario.control.cruise_speed * BASELINE_TIME
    return {
        "name": "no_load",
        "robot": scenario.robot.model_dump() | {"tether": None},
        "physics": scenario.physics.model_dump(),
        "run": {"time_limit": BASELINE_TIME},
        "control": autopilot_of(scenario),
        "monitor": scenario.monitor.model_dump(),
        "record": scenario.record.model_dump() | {"pictures": False},
        "world": scenario.world.model_dump() | {"gravity": [0.0, 0.0, 0.0]},
        "pipes": [
            {"kind": "straight", "length": 1.5 * own + travel, "inner_diameter": 2 * first.radius}
        ],
        "start": {"distance": own / 2},
    }
