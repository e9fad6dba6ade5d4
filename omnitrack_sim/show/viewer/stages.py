"""What a window shows: a simulation as it runs, or the record of one."""

from __future__ import annotations

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, heading, matrix_from_quaternion
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.looks import look_pitch
from omnitrack_sim.show.film.poses import show_belts, smooth_belts, sound
from omnitrack_sim.show.viewer.figures import Lines, Moment, contact_lines, place_lines
from omnitrack_sim.sim.simulation import Simulation


class LiveStage:
    """A simulation of one robot. It is stepped by ``Simulation.step`` and by nothing else, so what
    is seen is what ``omnitrack run`` computes.

    Args:
        simulation: of one robot. model: of the scene with looks.
    """

    def __init__(self, simulation: Simulation, model: mujoco.MjModel) -> None:
        self.simulation, self._model = simulation, model
        self._pitch = look_pitch(simulation.scenarios[0].robot)
        self._travel = np.zeros(3)  # m, of the belts

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self.simulation.time[0])

    @property
    def next_time(self) -> float | None:
        """The time after the next step, s; None when the run is over."""
        return self.time + self.simulation.period if self.simulation.active[0] else None

    def step(self) -> None:
        """One control step."""
        self.simulation.step()
        self._travel += self.simulation.readings["belt_speed"][0] * self.simulation.period

    def qpos(self) -> Array:
        """Joint positions (nq,) as they are shown."""
        qpos = np.array(self.simulation.plant.qpos[0])
        show_belts(self._model, qpos, self._travel, self._pitch)
        return qpos

    def status(self) -> Lines:
        """Time, phase, outcome, place."""
        ending = self.simulation.endings[0]
        return [
            ("time", f"{self.time:.2f} s"),
            ("phase", self.simulation.phase[0].replace("_", " ")),
            ("outcome", "runs" if ending is None else ending.outcome.value),
            *place_lines(self._moment()),
        ]

    def figures(self) -> Lines:
        """What the modules do at the wall."""
        return contact_lines(self._moment())

    def _moment(self) -> Moment:
        simulation = self.simulation
        readings = simulation.readings
        return Moment(
            slip_ratio=readings["slip_ratio"][0],
            traction=readings["traction"][0],
            normal_force=readings["normal_force"][0],
            routes=simulation.legs.routes,
            location=simulation.location,
            reach=simulation.scenarios[0].robot.reach,
        )


class ReplayStage:
    """A saved run, sample by sample.

    Attributes:
        row: the sample that is shown. count: number of samples.
    """

    def __init__(self, result: Result, model: mujoco.MjModel) -> None:
        self._result, self.row = result, 0
        self._trajectory = sound(result.trajectory)
        self.count = len(self._trajectory.time)
        self._qpos = smooth_belts(model, self._trajectory, look_pitch(result.scenario.robot))
        self._routes = RouteMap(result.routes())

    @property
    def time(self) -> float:
        """Time of the sample, s."""
        return float(self._trajectory.time[self.row])

    @property
    def next_time(self) -> float | None:
        """Time of the next sample, s; None at the end."""
        last = self.row + 1 >= self.count
        return None if last else float(self._trajectory.time[self.row + 1])

    def step(self) -> None:
        """To the next sample."""
        self.leap(1)

    def leap(self, samples: int) -> None:
        """On or back by some samples, as far as there are any."""
        self.row = min(max(self.row + samples, 0), self.count - 1)

    def leap_to(self, time: float) -> None:
        """To the first sample that is not before ``time`` s, or to the last one."""
        found = int(np.searchsorted(self._trajectory.time, time - 1e-9))
        self.row = min(max(found, 0), self.count - 1)

    def qpos(self) -> Array:
        """Joint positions (nq,) as they are shown."""
        return self._qpos[self.row]

    def status(self) -> Lines:
        """Time, phase, outcome, place."""
        trajectory = self._trajectory
        driver = self._result.provenance.get("driven_by")
        return [
            ("time", f"{self.time:.2f} of {trajectory.time[-1]:.2f} s"),
            ("phase", trajectory.phases[int(trajectory["phase"][self.row])].replace("_", " ")),
            ("outcome", self._result.outcome.value),
            *([("driven by", str(driver))] if driver is not None else []),
            *place_lines(self._moment()),
        ]

    def figures(self) -> Lines:
        """What the modules do at the wall."""
        return contact_lines(self._moment())

    def _moment(self) -> Moment:
        one = {name: values[self.row : self.row + 1] for name, values in self._trajectory.items()}
        frame = heading(matrix_from_quaternion(one["quaternion"]), one["gear"].astype(int))
        location = self._routes.locate(
            one["position"], frame, one["leg"].astype(np.intp), one["distance"]
        )
        return Moment(
            slip_ratio=one["slip_ratio"][0],
            traction=one["traction"][0],
            normal_force=one["normal_force"][0],
            routes=self._routes,
            location=location,
            reach=self._result.scenario.robot.reach,
        )
