"""What a run leaves: outcome, metrics, trajectory, provenance; and how it is saved."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ByName
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import strict_json
from omnitrack_sim.base.writing import whole_folder
from omnitrack_sim.pipes import Assembly, Route
from omnitrack_sim.pipes.compare import MapDifference
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg, route_of
from omnitrack_sim.record.events import Event
from omnitrack_sim.record.metrics import Metrics
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.record.timeline import Visit, timeline
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.files import (
    MAP_FILE,
    RESULT_FILE,
    SCENARIO_FILE,
    TIMELINE_FILE,
    write_timeline,
    write_trajectory,
)
from omnitrack_sim.results.notebook import result_html
from omnitrack_sim.results.pictures import PICTURES_FILE, Pictures
from omnitrack_sim.scenario import Scenario


@dataclass(frozen=True)
class Result:
    """The end of one run.

    Attributes:
        scenario: what was run, resolved.
        outcome: how it ended.
        reason: where, and what was measured there.
        duration_s: simulated seconds.
        metrics: see ``metrics.summarise``.
        trajectory: the record.
        provenance: versions, seed, scenario hash, git commit.
        events: remarks of the controller and the runner.
        legs: of a mission, in the order of the trajectory's ``leg``; empty for plain pipes.
        map: what a robot that explores has made of its network; its legs lead through that. None
            for other robots.
        album: ``pictures``; None where none were recorded.
    """

    scenario: Scenario
    outcome: Outcome
    reason: str
    duration_s: float
    metrics: Metrics
    trajectory: Trajectory
    provenance: dict[str, Any]
    events: list[Event] = field(default_factory=list)
    legs: tuple[Leg, ...] = ()
    map: Network | None = None
    album: Pictures | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "metrics", ByName(self.metrics))

    def __repr__(self) -> str:
        name, record = self.scenario.name, len(self.trajectory.time)
        ended = f"{self.outcome.value} after {self.duration_s:.6g} s"
        return f"Result({name!r}: {ended}; {len(self.metrics)} metrics, {record} samples)"

    def _repr_html_(self) -> str:
        return result_html(self)

    @property
    def success(self) -> bool:
        """Whether the robot reached the goal."""
        return self.outcome is Outcome.REACHED_GOAL

    @property
    def as_expected(self) -> bool | None:
        """Whether the outcome is the scenario's ``run.expected_outcome``; None where it expects
        nothing."""
        expected = self.scenario.run.expected_outcome
        return None if expected is None else self.outcome is expected

    @property
    def pictures(self) -> Pictures:
        """What the robot's cameras have seen, read picture by picture.

        Raises:
            InputError: none were recorded.
        """
        if self.album is None:
            raise InputError(Fault("record.pictures", "is false: this run has recorded none"))
        return self.album

    def routes(self) -> tuple[Route, ...]:
        """The route of each leg, in the order of the trajectory's ``leg``."""
        planner = self.scenario.planner
        if self.map is not None:
            arcs = self.scenario.control.arcs
            return tuple(route_of(self.map, leg.way, arcs) for leg in self.legs)
        return (
            (self.scenario.route,)
            if planner is None
            else tuple(planner.route(leg) for leg in self.legs)
        )

    @property
    def pipes(self) -> Assembly:
        """The pipes that it was run in, whatever the robot believes."""
        return self.scenario.route.network

    def map_difference(self) -> MapDifference | None:
        """How the map of a robot that explores differs from what can be reached of its network;
        None for other robots."""
        exploration = self.scenario.exploration
        if exploration is None or self.map is None:
            return None
        return exploration.difference(self.map)

    def goal_points(self) -> Array:
        """Where the robot's centre has to get to, (G, 3) m, world frame; of a mission the goals'
        ports, in order."""
        planner, exploration = self.scenario.planner, self.scenario.exploration
        if exploration is not None:
            return np.array(exploration.points())
        if planner is not None:
            parts = planner.network.pipes.parts
            return np.array([parts[part].port(port).position for part, port in planner.ends[1:]])
        line = self.routes()[-1].centreline
        return line.at(np.clip([self.scenario.goal_distance], 0.0, line.length))[0]

    def plate_rims(self) -> Array:
        """Rims (P, 25, 3) m, world frame, of the plates that close ports."""
        parts, angle = self.pipes.parts, np.linspace(0.0, 2 * np.pi, 25)
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(25)], axis=-1)
        found = [
            (parts[i].port(port), parts[i].fitting.port_radius(port))
            for i, port in self.scenario.plates
        ]
        return np.array([pose.apply(radius * circle) for pose, radius in found]).reshape(-1, 25, 3)

    def timeline(self) -> list[Visit]:
        """The run fitting by fitting, in order of time; see ``timeline.timeline``."""
        return timeline(self.trajectory, self.routes(), self.scenario.robot.lug_radius)

    def summary(self) -> dict[str, Any]:
        """The contents of ``result.json``."""
        return {
            "name": self.scenario.name,
            "outcome": self.outcome.value,
            "advice": self.outcome.advice,
            "reason": self.reason,
            "success": self.success,
            "as_expected": self.as_expected,
            "duration_s": self.duration_s,
            "metrics": self.metrics,
            "events": [event.to_table() for event in self.events],
            "legs": [dataclasses.asdict(leg) for leg in self.legs],
            "provenance": self.provenance,
        }

    def save(self, directory: str | Path) -> Path:
        """Write scenario, result, timeline, trajectory, replay, map and pictures, a file each, into
        ``directory``, whole or not at all; an earlier run there is replaced.

        Raises:
            OutputError: the folder holds something that is no run, or cannot be written.
        """
        with whole_folder(directory, RESULT_FILE) as folder:
            scenario = self.scenario.model_dump_json(indent=2)
            (folder / SCENARIO_FILE).write_text(scenario + "\n", encoding="utf-8")
            summary = strict_json(self.summary())
            (folder / RESULT_FILE).write_text(summary + "\n", encoding="utf-8")
            write_timeline(self.timeline(), folder / TIMELINE_FILE)
            write_trajectory(self.trajectory, folder)
            if self.map is not None:
                (folder / MAP_FILE).write_text(self.map.to_toml(), encoding="utf-8")
            if self.album is not None:
                self.album.write(folder / PICTURES_FILE)
        return Path(directory)
