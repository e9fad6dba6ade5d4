"""Makes the results of a simulation whose robots have all come to their ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from omnitrack_sim.autonomy.judged_sight import JudgedSight
from omnitrack_sim.record.metrics import METRICS, Metric, Metrics, summarise
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result

if TYPE_CHECKING:
    from omnitrack_sim.sim.simulation import Simulation


def gathered(
    simulation: Simulation, no_load_slip: Sequence[float] | None, metrics: Sequence[Metric]
) -> list[Result]:
    """One result a robot; arguments as of ``Simulation.results``."""
    n, album = simulation.n, simulation.album
    slips = [math.nan] * n if no_load_slip is None else no_load_slip
    albums = [None] * n if album is None else album.pictures()
    results = []
    for i, trajectory in enumerate(simulation.recorder.trajectories(simulation.end_time)):
        scenario, ending = simulation.scenarios[i], simulation.endings[i]
        assert ending is not None
        results.append(
            Result(
                scenario=scenario,
                outcome=ending.outcome,
                reason=ending.reason,
                duration_s=float(simulation.end_time[i]),
                metrics=_figures(simulation, i, trajectory, slips[i], metrics),
                trajectory=trajectory,
                provenance=provenance_of(scenario),
                events=simulation.events[i],
                legs=simulation.legs.driven(i),
                map=simulation.legs.map(i),
                album=albums[i],
            )
        )
    return results


def _figures(
    simulation: Simulation, i: int, trajectory: Trajectory, slip: float, metrics: Sequence[Metric]
) -> Metrics:
    """All metrics of robot ``i``, which slips by ``slip`` m/s without load."""
    scenario, motors = simulation.scenarios[i], simulation.motors
    figures = summarise(
        trajectory,
        no_load_slip=slip,
        lug_radius=scenario.robot.lug_radius,
        torque_limit=float(motors.torque_limit[i, 0]),
        drive=motors.drive,
        efficiency=scenario.robot.motor.efficiency,
        metrics=(*METRICS, *scenario.own_metrics, *metrics),
    )
    found, exploration = simulation.legs.map(i), scenario.exploration
    if found is not None and exploration is not None:
        figures |= exploration.difference(found).figures()
    if isinstance(sight := simulation.sights[i], JudgedSight):
        figures |= sight.figures(i)
    return figures
