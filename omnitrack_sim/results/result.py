"""Result of a run: outcome, metrics, trajectory, provenance; saved as a folder and read back."""

from __future__ import annotations

import dataclasses
import math
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.bounds import MAX_RUN_BYTES
from omnitrack_sim.base.errors import Fault, InputError, NetworkError, OutputError
from omnitrack_sim.base.naming import ByName, trusting
from omnitrack_sim.base.reading import parsed, read_bytes, table_of
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted, shown, strict_json
from omnitrack_sim.base.writing import whole, whole_folder
from omnitrack_sim.pipes import Assembly, Route, route_through
from omnitrack_sim.pipes.map_difference import MapDifference
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.record.events import Event, Outcome, event_of
from omnitrack_sim.record.metrics import Metric, Metrics
from omnitrack_sim.record.timeline import PassageRecord, timeline
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.files import (
    MAP_FILE,
    RESULT_FILE,
    SCENARIO_FILE,
    TIMELINE_FILE,
    TRAJECTORY_FILE,
    read_trajectory,
    reading,
    write_timeline,
    write_trajectory,
)
from omnitrack_sim.results.html import safe, sketch, table_html
from omnitrack_sim.results.pictures import PICTURES_FILE, Pictures, read_pictures
from omnitrack_sim.robots.recorded import MODEL_FILE, is_recorded, model_bytes, values_of
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario import Scenario, read_back
from omnitrack_sim.scenario.model import sha256_of


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
        map_stds: standard deviations that such a robot gives the sizes on its map, m and rad, by
            the names of its parts and the keys of their constructors; see ``map_difference``.
        album: ``pictures``; None where none were recorded.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}))
        >>> result.outcome.value, round(result.duration_s, 3)
        ('timed_out', 0.1)
        >>> result.qpos[:, result.joints["slide_1"]].shape
        (6, 1)
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
    map_stds: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    album: Pictures | None = None

    def __post_init__(self) -> None:
        # The dataclass is frozen; a mistyped name of a metric then lists the valid ones.
        object.__setattr__(self, "metrics", ByName(self.metrics))

    def __repr__(self) -> str:
        name, record = self.scenario.name, len(self.trajectory.time)
        ended = f"{self.outcome.value} after {self.duration_s:.6g} s"
        return f"Result({name!r}: {ended}; {len(self.metrics)} metrics, {record} samples)"

    def _repr_html_(self) -> str:
        """Return the outcome, headline figures, a small picture and the events, for a notebook."""
        colour = "#1a7f4b" if self.success else "#c8322b"
        head = (
            f"<p><b>{safe(self.scenario.name)}</b>: <b style='color:{colour}'>"
            f"{safe(self.ending)}</b> after "
            f"{self.duration_s:.2f} s<br>{safe(self.reason)}</p>"
        )
        known = [metric for metric in self.scenario.robot.metrics if metric.name in _HEADLINE]
        known.sort(key=lambda metric: _HEADLINE.index(metric.name))
        figures = [_headline(metric, self.metrics[metric.name]) for metric in known]
        table = table_html(("figure", "unit", "value"), figures)
        picture = sketch(self.trajectory)
        beside = f"<div style='display:flex;gap:2em;flex-wrap:wrap'>{table}{picture}</div>"
        lines = [str(event) for event in self.events[:_MAX_EVENTS]]
        rest = len(self.events) - len(lines)
        lines += [f"and {rest} more events"] if rest else []
        items = "".join(f"<li>{safe(line)}</li>" for line in lines)
        return f"<div>{head}{beside}{f'<ul>{items}</ul>' if lines else ''}</div>"

    @property
    def success(self) -> bool:
        """True if the robot reached the goal."""
        return self.outcome is Outcome.REACHED_GOAL

    @cached_property
    def missing(self) -> tuple[str, ...]:
        """Parts of the network that are not on the map of a robot that is back from exploring.

        Who searches for goals has no need of a whole map.
        """
        mission = self.scenario.mission
        if not self.success or mission is None or mission.task == "find":
            return ()
        difference = self.map_difference()
        return () if difference is None else difference.missing

    @property
    def ending(self) -> str:
        """The outcome in words, and how many parts are missing from the map where some are."""
        words = self.outcome.value.replace("_", " ")
        return (
            f"{words}, {counted(len(self.missing), 'part')} not mapped" if self.missing else words
        )

    @property
    def advice(self) -> str:
        """What happened and what to try."""
        if not self.missing:
            return self.scenario.robot.advice(self.outcome)
        return (
            f"The robot is back at the start, but its map lacks {', '.join(self.missing)}, and it "
            "says so: the reason has what it left unexplored, and why."
        )

    @property
    def as_expected(self) -> bool | None:
        """True if the outcome is the scenario's ``run.expected_outcome``; None without one."""
        expected = self.scenario.run.expected_outcome
        return None if expected is None else self.outcome is expected

    @property
    def qpos(self) -> Array:
        """Joint positions of all samples, (T, nq) m and rad, as MuJoCo's ``data.qpos`` has them.

        A sample can be set in an ``MjData`` of the scenario's own model and looked at or rendered.
        The first seven numbers are the chassis' position and unit quaternion (w, x, y, z), world
        frame; ``joints`` names the columns.
        """
        return self.trajectory.qpos

    @property
    def joints(self) -> dict[str, slice]:
        """Columns of ``qpos`` by the name of the joint in the model; see ``Robot.joints``."""
        return dict(self.scenario.robot.joints)

    @property
    def pictures(self) -> Pictures:
        """Pictures of the robot's cameras, read on demand.

        Raises:
            InputError: none were recorded.
        """
        if self.album is None:
            raise InputError(Fault("record.pictures", "is false: this run has recorded none"))
        return self.album

    def routes(self) -> tuple[Route, ...]:
        """The route of each leg, in the order of the trajectory's ``leg``."""
        # An explorer's legs lead through its own map, in which parts have other numbers.
        planner = self.scenario.planner
        if self.map is not None:
            arcs = self.scenario.arcs
            return tuple(route_through(self.map.pipes, leg.path, arcs) for leg in self.legs)
        return (
            (self.scenario.route,)
            if planner is None
            else tuple(planner.route(leg.path) for leg in self.legs)
        )

    @property
    def pipes(self) -> Assembly:
        """The pipes that it was run in, whatever the robot believes."""
        return self.scenario.route.network

    def map_difference(self) -> MapDifference | None:
        """Return the differences of an explorer's map from its network, and their doubt.

        Only the reachable part of the network counts.

        None for other robots.
        """
        exploration = self.scenario.exploration
        if exploration is None or self.map is None:
            return None
        return exploration.difference(self.map, self.map_stds)

    def goal_points(self) -> Array:
        """Goal points (G, 3) m, world frame: of a mission the goals' ports."""
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
        discs = [
            (parts[i].port(port), parts[i].fitting.outline(port, angle)[:, None])
            for i, port in self.scenario.plates
        ]
        return np.array([pose.apply(edge * circle) for pose, edge in discs]).reshape(-1, 25, 3)

    def timeline(self) -> list[PassageRecord]:
        """The run fitting by fitting, in order of time; see ``timeline.timeline``."""
        return timeline(self.trajectory, self.routes(), self.scenario.robot.touch(self.trajectory))

    def summary(self) -> dict[str, Any]:
        """The contents of ``result.json``."""
        return {
            "name": self.scenario.name,
            "outcome": self.outcome.value,
            "advice": self.advice,
            "reason": self.reason,
            "success": self.success,
            "as_expected": self.as_expected,
            "duration_s": self.duration_s,
            "metrics": self.metrics,
            "events": [event.to_table() for event in self.events],
            "legs": [dataclasses.asdict(leg) for leg in self.legs],
            "map_stds": self.map_stds,
            "provenance": self.provenance,
            **self._robot(),
        }

    def _robot(self) -> dict[str, Any]:
        """What is kept of a robot that the scenario and the package alone do not make again."""
        robot = self.scenario.robot
        return {"robot": values_of(robot, self.trajectory.schema)} if is_recorded(robot) else {}

    def save(self, directory: str | Path) -> Path:
        """Save the run as a folder, completely or not at all; replace an earlier run there.

        Scenario, result, timeline, trajectory, replay, map and pictures are a file each, and so is
        the model of a robot from outside the package.

        Raises:
            OutputError: the folder holds something that is no run, or cannot be written.
        """
        with whole_folder(directory, RESULT_FILE) as folder:
            scenario = self.scenario.model_dump_json(indent=2)
            (folder / SCENARIO_FILE).write_text(scenario + "\n", encoding="utf-8")
            summary = strict_json(self.summary())
            (folder / RESULT_FILE).write_text(summary + "\n", encoding="utf-8")
            write_timeline(self.timeline(), folder / TIMELINE_FILE)
            write_trajectory(self.trajectory, folder, self.scenario.robot)
            if is_recorded(self.scenario.robot):
                model = model_bytes(self.scenario.robot, self.pipes, self.scenario.plates)
                (folder / MODEL_FILE).write_bytes(model)
            if self.map is not None:
                (folder / MAP_FILE).write_text(self.map.to_toml(), encoding="utf-8")
            if self.album is not None:
                self.album.write(folder / PICTURES_FILE)
        return Path(directory)


_HEADLINE = (
    *("distance_m", "mean_speed_m_s", "tilt_max_deg", "energy_j"),
    *("slip_ratio_mean", "normal_force_mean_n", "motor_torque_max_nm"),
)
"""Metrics that notebooks show."""
_MAX_EVENTS = 12
END_TOLERANCE = 1e-6
"""Largest distance of the last sample from the end of the run, s."""


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _LegTable(_Part):
    path: Annotated[tuple[tuple[Annotated[int, Field(ge=0)], str, str], ...], Field(min_length=1)]
    gear: Literal[-1, 1]
    begin: float
    end: float
    goal: int
    note: str


class _Summary(_Part):
    """The part of ``result.json`` that is read back."""

    outcome: Outcome
    reason: str
    duration_s: Annotated[float, Field(ge=0)]
    metrics: dict[str, Any]
    provenance: dict[str, Any]
    events: tuple[dict[str, Any], ...]
    legs: tuple[_LegTable, ...]
    map_stds: dict[str, dict[str, Annotated[float, Field(ge=0)]]] = {}
    robot: dict[str, Any] | None = None


def load_result(directory: str | Path, *, trust: bool = False) -> Result:
    """Read a run back from its folder.

    Nothing that its scenario names is imported, and no file outside of the folder is read: a robot
    from outside the package is known by what the run has recorded of it. It can be shown, not run.

    Args:
        directory: of the run.
        trust: import what the scenario names, and read the robot's own file.

    Raises:
        OutputError: it is no run, or a file of it is missing or damaged; the message names the
            file.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}))
        >>> folder = result.save("run")
        >>> ot.load_result(folder).duration_s == result.duration_s
        True
    """
    with trusting(None if trust else ()):
        return _loaded(whole(directory))


def _loaded(folder: Path) -> Result:
    """Return the run in a folder; see ``load_result``."""
    with reading(folder / RESULT_FILE) as path:
        summary = _summary(read_bytes(path, MAX_RUN_BYTES))
    with reading(folder / SCENARIO_FILE) as path:
        data = parsed(read_bytes(path, MAX_RUN_BYTES).decode(), "JSON")
        # Files of two runs may be mixed by hand: the hash ties the result to its scenario. It is
        # looked at before anything that the scenario names.
        if sha256_of(data) != summary.provenance.get("scenario_sha256"):
            raise ValueError(f"it is not the scenario that {RESULT_FILE} tells the end of")
        kept = {"file": str((folder / MODEL_FILE).absolute()), "values": summary.robot}
        scenario = read_back(data, None if summary.robot is None else kept)
    with reading(folder / RESULT_FILE):
        # Only now: kinds of events of the robot are known once its class is.
        events = [event_of(table) for table in summary.events]
        # The fields of a damaged file may be of any type, which shows when the text is made.
        _ = [str(event) for event in events]
        _check_metrics(summary.metrics, scenario.robot)
    explored = None
    if scenario.exploration is not None:
        with _advised(folder), reading(folder / MAP_FILE) as path:
            explored = Network.believed_from(table_of(path, "network", NetworkError))
    with _advised(folder):
        trajectory = read_trajectory(folder, scenario.robot)
        # The clock of physics that has diverged begins anew.
        end = math.inf if summary.outcome is Outcome.DIVERGED else summary.duration_s
        album = read_pictures(folder, end) if scenario.record.pictures else None
    result = Result(
        scenario=scenario,
        outcome=summary.outcome,
        reason=summary.reason,
        duration_s=summary.duration_s,
        metrics=summary.metrics,
        trajectory=trajectory,
        provenance=summary.provenance,
        events=events,
        legs=tuple(Leg(**vars(leg)) for leg in summary.legs),
        map=explored,
        map_stds=summary.map_stds,
        album=album,
    )
    with reading(folder / RESULT_FILE):
        _check_legs(result)
        routes = len(result.routes())
    # Only now: the legs' routes tell which values of the channel `leg` can be right.
    with _advised(folder), reading(folder / TRAJECTORY_FILE):
        _check_trajectory(result, routes)
    return result


def as_result(result: Result | str | os.PathLike[str], trust: bool = False) -> Result:
    """Return a result itself, or load the one in the folder of a saved run; see ``load_result``.

    Raises:
        OutputError: the folder is no run. TypeError: it is neither result nor folder.
    """
    if isinstance(result, str | os.PathLike):
        return load_result(Path(result), trust=trust)
    return check_is(Result, "result", result)


@contextmanager
def _advised(folder: Path) -> Iterator[None]:
    """Add to an error of a damaged record the command that repeats the run."""
    try:
        yield
    except OutputError as error:
        scenario, place = (shlex.quote(str(path)) for path in (folder / SCENARIO_FILE, folder))
        again = f"`omnitrack run {scenario} --out {place}` makes the run again"
        raise OutputError(f"{error}; {again}") from error


def _summary(text: bytes) -> _Summary:
    try:
        return _Summary.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{where}: {first['msg']}".lstrip(": ")) from error


def _check_metrics(metrics: Metrics, robot: Robot) -> None:
    """Refuse metrics of the robot of another kind; those of a user's own may be anything."""
    for metric in robot.metrics:
        if metric.name not in metrics:
            continue
        value: Any = metrics[metric.name]
        if metric.per_module:
            right = isinstance(value, list) and len(value) == robot.modules
            numbers = value if right else ()
        else:
            right = True
            numbers = value.values() if isinstance(value, dict) else (value,)
        if not right or not all(x is None or type(x) in (int, float) for x in numbers):
            raise ValueError(f"metrics.{metric.name} is {shown(value)}")


def _check_legs(result: Result) -> None:
    """Refuse paths that do not lead through the run's network, or through the robot's map of it."""
    network = result.scenario.network if result.map is None else result.map
    if network is None:
        if result.legs:
            raise ValueError("legs: are of missions only")
        return
    parts = network.pipes.parts
    for number, leg in enumerate(result.legs):
        before = None
        for part, enter, leave in leg.path:
            there = part < len(parts) and {enter, leave} <= set(parts[part].fitting.port_names)
            if not there or enter == leave:
                raise ValueError(f"legs.{number}.path: there is no {part}, {enter}, {leave}")
            end = f"{parts[part].name}.{enter}"
            if before is not None and network.joined_to.get(before) != end:
                raise ValueError(f"legs.{number}.path: {before} is not joined to {end}")
            before = f"{parts[part].name}.{leave}"


def _check_trajectory(result: Result, routes: int) -> None:
    """Refuse a trajectory that is not of this run."""
    trajectory = result.trajectory
    leg, end = trajectory["leg"], float(trajectory.time[-1])
    if not 0 <= leg.min() <= leg.max() < routes:
        raise ValueError(f"it has legs beyond the {routes} of {RESULT_FILE}")
    # The clock of physics that has diverged begins anew.
    diverged = result.outcome is Outcome.DIVERGED
    if not diverged and abs(end - result.duration_s) > END_TOLERANCE:
        raise ValueError(
            f"it ends at {end:.6f} s, and the run of {RESULT_FILE} at {result.duration_s:.6f} s"
        )


def _headline(metric: Metric, value: Any) -> tuple[str, ...]:
    numbers: Sequence[Any] = value if isinstance(value, list) else [value]
    texts = ["-" if number is None else f"{number:.{metric.digits}f}" for number in numbers]
    return metric.title, "" if metric.unit == "1" else metric.unit, " / ".join(texts)
