"""Runs one entry on one job: what came of it, how exact its walls are, and how fast it went."""

from __future__ import annotations

import dataclasses
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from entries import Built, Entry

from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.simulation import Simulation

sys.path.insert(0, str(Path(__file__).parents[1]))

from shares import Shares, timed

PARTS = {"straight": 0, "elbow_short": 1, "tee_turn": 1}
"""Index of the fitting, in the pipes of each job, whose wall is probed."""
OUR_FAULTS = (AttributeError, NameError, TypeError)
"""What a peer does not fail with, but code that has fallen behind the package's."""


@dataclass
class Row:
    """What was measured of an entry on a job.

    Attributes:
        outcome: as in ``omnitrack_sim.Outcome``, or ``out_of_budget`` when the CPU time ran out, or
            ``error``.
        error: why there is nothing, or None.
        wall_error_max_mm, wall_error_99_mm: of the collision surface on the job's fitting.
        step_speed, speed: simulated seconds a CPU second, of the physics alone and with control.
        step_us: CPU microseconds a physics step.
        contacts_per_lug: contacts a lug of the rows at the wall, mean of the run.
        contacts: of the robot, mean of the run.
        tilt_deg: of the robot from the centreline at the end.
        progress_m: along the centreline at the end. duration_s: simulated.
        build_s: CPU seconds to make walls and model. elements: wall pieces or triangles.
    """

    peer: str
    job: str
    settings: dict[str, object]
    timestep: float
    outcome: str = "error"
    error: str | None = None
    wall_error_max_mm: float = float("nan")
    wall_error_99_mm: float = float("nan")
    step_speed: float = float("nan")
    speed: float = float("nan")
    step_us: float = float("nan")
    contacts_per_lug: float = float("nan")
    contacts: float = float("nan")
    tilt_deg: float = float("nan")
    progress_m: float = float("nan")
    duration_s: float = float("nan")
    build_s: float = float("nan")
    elements: int | None = None
    repeats: int = 0

    @property
    def finishes(self) -> bool:
        """Whether the robot reached the goal."""
        return self.outcome == Outcome.REACHED_GOAL.value


class OutOfBudgetError(Exception):
    """A run took more CPU time than it may."""


@dataclass
class Case:
    """An entry on a job: built once, driven as often as wanted."""

    entry: Entry
    scenario: Scenario
    row: Row
    built: Built | None

    @classmethod
    def of(cls, entry: Entry, job: str, scenario: Scenario, probes: int) -> Case:
        """Build it and measure its walls. What fails is noted in ``row.error``."""
        own = entry.scenario(scenario)
        row = Row(entry.peer, job, entry.settings, own.physics.timestep)
        case = cls(entry, own, row, None)
        try:
            case.built = entry.prepare(scenario)
            row.build_s, row.elements = case.built.build_s, case.built.elements
            part = own.route.network.parts[PARTS[job]]
            row.wall_error_max_mm, row.wall_error_99_mm = case.built.wall_error(part, probes)
        except OUR_FAULTS:
            raise
        except Exception as error:  # whatever else a peer fails with is its result
            row.error = f"{type(error).__name__}: {error}"
        return case

    def drive(self, budget_s: float) -> None:
        """Drive once, for at most ``budget_s`` CPU seconds, and fill the row.

        See ``settle`` for repeats.
        """
        if self.built is None:
            return
        start = time.process_time()

        def watch(_part: float, _text: str) -> None:
            if time.process_time() - start > budget_s:
                raise OutOfBudgetError

        row = self.row
        try:
            simulation, shares = (
                Simulation([self.scenario], make_plant=self.built.make_plant),
                Shares(),
            )
            outcome = "out_of_budget"
            try:
                timed(simulation, progress=watch, clock=time.process_time, into=shares)
                (ending,) = simulation.endings
                assert ending is not None
                outcome = ending.outcome.value
            except OutOfBudgetError:
                pass
            self._fill(simulation, shares, outcome)
        except OUR_FAULTS:
            raise
        except Exception as error:  # likewise
            row.error = f"{type(error).__name__}: {error}"

    def _fill(self, simulation: Simulation, shares: Shares, outcome: str) -> None:
        row, location = self.row, simulation.observation.location
        row.outcome, row.error = outcome, None
        row.duration_s, row.progress_m = float(simulation.time[0]), float(location.distance[0])
        row.tilt_deg = float(np.degrees(location.tilt[0]))
        (trajectory,) = simulation.recorder.trajectories(simulation.time)
        row.contacts = float(trajectory["contact_count"].sum(axis=(-1, -2)).mean())
        row.contacts_per_lug = row.contacts / (MODULES * self.scenario.robot.lugs_per_track)
        row.step_speed = row.duration_s / shares.physics
        row.speed = row.duration_s / (shares.physics + shares.control)
        row.step_us = 1e6 * row.timestep / row.step_speed
        row.repeats = 1


def settle(rows: list[Row]) -> Row:
    """One row from repeats of the same run: medians of the speeds."""
    settled = dataclasses.replace(rows[0], repeats=len(rows))
    for name in ("step_speed", "speed", "step_us"):
        setattr(settled, name, float(np.median([getattr(row, name) for row in rows])))
    return settled
