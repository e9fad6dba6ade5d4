"""Pictures and a window of robots in episodes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, quaternion_from_matrix
from omnitrack_sim.gym.episodes import EpisodeBatch
from omnitrack_sim.gym.options import EnvOptions
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.channels import recorded
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.film.stage import Stage
from omnitrack_sim.show.playback import FARTHEST, playback_of

if TYPE_CHECKING:
    from omnitrack_sim.show.viewer.window import Window

SPACING = 0.01
"""Distance of the places along the route that cameras are set up for, m."""


class EpisodeScreen:
    """Shows robots as they are now. What is needed to paint the pipes of a lane is made once."""

    def __init__(self, options: EnvOptions) -> None:
        self._options = options
        self._stages: dict[EpisodeBatch, tuple[Route, EpisodeStage]] = {}
        self._window: Window | None = None
        self._pipes: Route | None = None
        self._due = 0.0

    def picture(self, lane: EpisodeBatch, robot: int) -> NDArray[np.uint8]:
        """A robot of a lane (height, width, 3)."""
        scenario = lane.simulation.scenarios[robot]
        pipes, stage = self._stages.get(lane, (None, None))
        if stage is None or pipes is not scenario.route:
            if stage is not None:
                stage.__exit__()
            size = (self._options.width, self._options.height)
            stage = EpisodeStage(_along_the_route(scenario), size, self._options.camera)
            self._stages[lane] = scenario.route, stage
        return stage.now(lane.simulation.plant.qpos[robot], lane.travel[robot])

    def show(self, lane: EpisodeBatch, robot: int) -> None:
        """Show a robot in the window, not faster than it drives; not any more where the window has
        been closed."""
        # Not at the top: a window needs GLFW, which pictures do not.
        from omnitrack_sim.show.viewer.window import Window, require_screen

        scenario = lane.simulation.scenarios[robot]
        if self._window is None or self._pipes is not scenario.route:
            require_screen()
            self._close_window()
            self._window = Window(scenario)
            self._window.__enter__()
            self._pipes = scenario.route
        qpos = np.array(lane.simulation.plant.qpos[robot])
        if not _is_sound(qpos):
            return
        looks = scenario.robot.display.live(self._window.model, scenario.robot)
        looks.travel = lane.travel[robot]
        looks.place(qpos)
        self._window.show(qpos, [])
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + lane.decisions.hold * lane.simulation.period

    def _close_window(self) -> None:
        if self._window is not None:
            self._window.__exit__()
            self._window = None

    def close(self) -> None:
        """Close the window and free what pictures are painted with."""
        for _, stage in self._stages.values():
            stage.__exit__()
        self._stages.clear()
        self._close_window()


class EpisodeStage(Stage):
    """A stage on which a robot stands as it is now."""

    _live: Array | None = None

    def __init__(self, way: Result, size: tuple[int, int], camera: str) -> None:
        super().__init__(playback_of(way), size, camera, fine=False)
        robot = way.scenario.robot
        self._looks = robot.display.live(self.model, robot)
        self._places = way.trajectory["position"]

    def now(self, qpos: Array, travel: Array) -> NDArray[np.uint8]:
        """The picture of a robot with joint positions (nq,) and belts that have run on by
        ``travel`` (3,) m; one whose physics has diverged stays where it was."""
        if _is_sound(qpos) or self._live is None:
            self._live = np.nan_to_num(qpos)
            self._looks.travel = travel
            self._looks.place(self._live)
        # The camera is that of the nearest place on the route.
        near = ((self._places - self._live[:3]) ** 2).sum(axis=1).argmin()
        return self.paint(int(near), self._live)


def _is_sound(qpos: Array) -> bool:
    return bool(np.abs(qpos).max() < FARTHEST)  # NaN is not less either


def _along_the_route(scenario: Scenario) -> Result:
    """A run along a scenario's route, which tells cameras where the robot will be."""
    route, planner = scenario.route, scenario.planner
    distance = np.arange(scenario.start.distance, scenario.goal_distance, SPACING)
    samples = len(distance)
    schema = recorded(scenario.robot.channels.values())
    channels = {name: np.zeros((samples, *channel.shape)) for name, channel in schema.items()}
    channels["position"] = route.centreline.at(distance)[0]
    channels["quaternion"] = quaternion_from_matrix(route.centreline.frame(distance))
    channels["distance"], channels["gear"] = distance, np.ones(samples)
    qpos = np.zeros((samples, scenario.robot.joint_count))
    # Cameras are set up by the poses alone: the joints may stay at 0.
    qpos[:, :3], qpos[:, 3:7] = channels["position"], channels["quaternion"]
    when = distance / scenario.control.cruise_speed
    trajectory = Trajectory(when - when[0], channels, ("drive",), qpos, schema=schema)
    legs = () if planner is None else (planner.first,)
    end = float(trajectory.time[-1])
    return Result(scenario, Outcome.REACHED_GOAL, "", end, {}, trajectory, {}, legs=legs)
