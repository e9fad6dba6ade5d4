"""Playback of a scenario's run: its robot as it shows itself, its passages, events and metrics."""

from __future__ import annotations

import math
import sys
from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.base.text import finite
from omnitrack_sim.record.channels import COMMON, Channel, Vector
from omnitrack_sim.record.display import CarriedCamera, Curve, ForceArrow, Moment, StatusText
from omnitrack_sim.record.events import Note
from omnitrack_sim.record.metrics import ESTIMATE_METRICS, Metric
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.recorded import Recorded
from omnitrack_sim.robots.robot import SceneOptions
from omnitrack_sim.robots.scene import scene
from omnitrack_sim.robots.tail import TAIL_METRICS, TETHER_METRICS
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.landmarks import Landmarks, PassageSpan, passage_spans
from omnitrack_sim.show.legend import Legend, legends_of, parts_of_run
from omnitrack_sim.show.playback import (
    POINTS_APART,
    STANDARD,
    Badge,
    ContactForces,
    Line,
    PhaseSpan,
    Playback,
    sound_rows,
)
from omnitrack_sim.show.projection import needs_map
from omnitrack_sim.show.recording import WallContacts
from omnitrack_sim.show.wall_forces import ForceBars, body_arrows, contacts_of_run, drawn_forces
from omnitrack_sim.walls.pipe_looks import ROBOT_GROUP

CAMERAS = (*STANDARD, "onboard")
"""Cameras of every run: ``onboard`` looks ahead."""
MAX_COLUMNS = 6
"""A channel of a further sensor with more numbers than this has no plot: its lines could not be
told apart."""
PROVENANCE = ("seed", "scenario_sha256", "git_commit", "platform")
"""Entries of a run's provenance that pages show."""


class RunPlayback(Playback):
    """Playback of a scenario's run.

    Args:
        result: the run.
        coarse: faces may be coarse, which is enough for films.

    Attributes:
        run: as given as ``result``.
        display: of its robot.
    """

    def __init__(self, result: Result, coarse: bool = True) -> None:
        self.run, self._coarse = result, coarse
        scenario, display = result.scenario, result.scenario.robot.display
        self.result, self.display = result, display
        self.name, self.network, self.plates = scenario.name, result.pipes, scenario.plates
        self.album, self.page_camera = result.album, display.page_camera
        self.columns, self.state = display.columns, display.state
        self.tracks, self.track_pitch = display.tracks, display.track_pitch

    def __reduce__(self) -> tuple[Any, ...]:
        # Tables of fittings are classes made while files are read, which cannot be pickled.
        scenario, robot = self.run.scenario, self.run.scenario.robot
        data = scenario.model_dump(mode="json", exclude_none=True)
        if isinstance(robot, Recorded):
            data["robot"] = robot.to_table()
        rest: Any = replace(self.run, scenario=None)  # type: ignore[arg-type]
        return _run_again, (data, rest, self._coarse, tuple(sys.modules))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The record, each sample that has diverged replaced by the last one before it."""
        trajectory = self.run.trajectory
        values = [trajectory.qpos, *(trajectory[name] for name in self.display.finite)]
        rows = sound_rows([value.reshape(len(trajectory.time), -1) for value in values])
        if (rows == np.arange(len(rows))).all():
            return trajectory
        channels = {name: values[rows] for name, values in trajectory.channels.items()}
        return replace(trajectory, channels=channels, qpos=trajectory.qpos[rows])

    @cached_property
    def model(self) -> mujoco.MjModel:
        """See ``Playback``."""
        return self.display.spec(self.network, self.plates, self._coarse).compile()

    @cached_property
    def time(self) -> Array:
        """See ``Playback``."""
        return self.run.trajectory.time

    @cached_property
    def qpos(self) -> Array:
        """See ``Playback``."""
        return self.display.poses(self.model, self.trajectory)

    @cached_property
    def size(self) -> float:
        """See ``Playback``."""
        return self.display.robot.length_scale

    @cached_property
    def visible_geoms(self) -> tuple[int, ...]:
        """See ``Playback``."""
        return tuple(np.flatnonzero(self.model.geom_group == ROBOT_GROUP).tolist())

    @cached_property
    def casting(self) -> tuple[int, ...]:
        """See ``Playback``."""
        casts = self.display.casts_shadow
        return tuple(geom for geom in self.visible_geoms if casts(self.model.geom(geom).name))

    @cached_property
    def body(self) -> int:
        """See ``Playback``."""
        return self.model.body(self.display.robot.chassis).id

    @cached_property
    def position(self) -> Array:
        """See ``Playback``."""
        return self.trajectory["position"]

    @cached_property
    def ahead(self) -> Array:
        """See ``Playback``."""
        return matrix_from_quaternion(self.trajectory["quaternion"])[:, :, 2]

    @cached_property
    def travel(self) -> Array:
        """Travel (T,) m along the legs."""
        trajectory = self.trajectory
        step = np.abs(np.diff(trajectory["distance"]))
        step = np.where((np.diff(trajectory["leg"]) == 0) & np.isfinite(step), step, 0.0)
        return np.append(0.0, np.cumsum(step + 1e-9))

    @cached_property
    def path(self) -> NDArray[np.intp]:
        """Samples at the beginnings of the legs, and about ``POINTS_APART`` of travel apart."""
        trajectory = self.trajectory
        step = np.abs(np.diff(trajectory["distance"], prepend=trajectory["distance"][0]))
        marks = np.floor(np.cumsum(np.where(np.isfinite(step), step, 0.0)) / POINTS_APART)
        known = np.isfinite(trajectory["position"]).all(axis=1)
        new_leg = np.diff(trajectory["leg"], prepend=trajectory["leg"][:1]) != 0
        return np.flatnonzero(known & ((np.diff(marks, prepend=-1) > 0) | new_leg))

    @cached_property
    def backward(self) -> NDArray[np.bool_]:
        """See ``Playback``."""
        return self.trajectory["gear"] < 0

    @cached_property
    def estimate(self) -> Array:
        """See ``Playback``."""
        return self.trajectory.channels.get("position_estimate", self.position)

    @cached_property
    def mounts(self) -> Mapping[str, CarriedCamera]:
        """See ``Playback``."""
        return {"onboard": self.display.camera}

    # What is told of it

    def moment(self, row: int) -> Moment:
        """Return the robot at a sample."""
        trajectory = self.trajectory
        place = bisect_right(self._begins, row) - 1
        return Moment(
            time=trajectory.time[row],
            phase=trajectory.phases[int(trajectory["phase"][row])],
            part=self.passages[place].part.name,
            value=lambda name: trajectory[name][row],
        )

    def status(self, row: int) -> StatusText:
        """Return the robot's text of a sample, with bars of the walls' forces if it has none."""
        status = self.display.status(self.moment(row))
        if status.bars or self._bars is None:
            return status
        return status._replace(caption=self._bars.caption, bars=self._bars.at(row))

    @cached_property
    def _bars(self) -> ForceBars | None:
        """Bars of the forces of the walls; None of a robot without such a channel."""
        legend = self.legends.get("body")
        if legend is None or "wall_force" not in self.trajectory.channels:
            return None
        return ForceBars(legend, self.trajectory["wall_force"])

    @cached_property
    def legends(self) -> Mapping[str, Legend]:
        """See ``Playback``."""
        trajectory = self.trajectory
        if not any(channel.names for channel in trajectory.schema.values()):
            return {}
        return legends_of(parts_of_run(self.model, trajectory))

    @cached_property
    def badges(self) -> Sequence[Badge]:
        """See ``Playback``; a robot with modules says itself where their numbers stand."""
        if not self.columns:
            return super().badges
        rows = zip(self.display.badges, self.columns, strict=False)
        return [Badge(body, str(i + 1), paint) for i, (body, (_, paint)) in enumerate(rows)]

    @cached_property
    def passages(self) -> list[PassageSpan]:
        """See ``Playback``."""
        return passage_spans(self.run, self.trajectory)

    @cached_property
    def _begins(self) -> list[int]:
        """First sample of each passage."""
        return [passage.first for passage in self.passages]

    @cached_property
    def leg(self) -> NDArray[np.intp] | None:
        """See ``Playback``."""
        return self.trajectory["leg"] if len(self.run.routes()) > 1 else None

    @cached_property
    def phases(self) -> list[PhaseSpan]:
        """See ``Playback``."""
        codes = {name: code for code, name in enumerate(self.trajectory.phases)}
        return [PhaseSpan(*span, codes[span[0]]) for span in self.trajectory.phase_spans()]

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """See ``Playback``."""
        events = sorted(self.run.events, key=lambda event: event.time)
        return [
            (event.time, event.text)
            for event in events
            if not isinstance(event, Note) and math.isfinite(event.time)
        ]

    @cached_property
    def notes(self) -> list[str]:
        """See ``Playback``."""
        return [str(event) for event in self.run.events if isinstance(event, Note)]

    @cached_property
    def landmarks(self) -> Landmarks | None:
        """See ``Playback``."""
        return Landmarks.of(self.run, self.trajectory) if needs_map(self.run) else None

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Channels of the plots with their commands, and those that the robot's page needs."""
        trajectory, plots = self.trajectory, self.plots
        commands = [trajectory.schema[name].display.command for name in plots]
        names = (*plots, *filter(None, commands), *self.display.page_channels)
        every = {name: self._curve(name) for name in names}
        return {name: curve for name, curve in every.items() if curve.values[0].size}

    def _curve(self, name: str) -> Curve:
        """Return the curve of a channel."""
        channel = self.trajectory.schema[name]
        return Curve(channel.display, self.trajectory[name], self._names(channel))

    def _names(self, channel: Channel) -> tuple[str, ...]:
        """Return names of the numbers of a channel: none of a single one and of modules."""
        count = math.prod(channel.shape)
        of_modules = count == len(self.columns) and not isinstance(channel, Vector)
        if channel.names or count <= 1 or of_modules:
            return channel.names
        return tuple(one.removeprefix(f"{channel.name}_") for one in channel.columns)

    def lines_of(self, channel: Channel) -> list[Line]:
        """Return the lines of any channel of several numbers, also of one without a curve."""
        return self._lines(channel.display.each, self._names(channel))

    @cached_property
    def plots(self) -> Sequence[str]:
        """The robot's own choice of channels, and those of sensors that it knows nothing of."""
        plots, known = self.display.plots, {*COMMON, *self.display.plots, *self.display.unplotted}
        own = [
            name
            for name, channel in self.run.trajectory.schema.items()
            if name not in known and len(channel.columns) <= MAX_COLUMNS
        ]
        return tuple(name for name in (*plots, *own) if self.trajectory[name][0].size)

    @cached_property
    def first_plots(self) -> Sequence[str]:
        """See ``Playback``."""
        return self.display.first_plots

    @cached_property
    def heading(self) -> dict[str, Any]:
        """Name, outcome, metrics and versions."""
        run, provenance = self.run, self.run.provenance
        versions: Mapping[str, Any] = provenance.get("versions") or {}
        kept = {key: provenance.get(key) for key in PROVENANCE}
        return finite(
            {
                "name": self.name,
                "outcome": run.ending,
                "success": run.success,
                "advice": run.advice,
                "reason": run.reason,
                "duration": run.duration_s,
                "figures": _figure_rows(run),
                "provenance": [
                    *([name, str(version)] for name, version in versions.items() if version),
                    *([k.replace("_", " "), str(v)] for k, v in kept.items() if v is not None),
                ],
            }
        )

    @cached_property
    def headline(self) -> Mapping[str, str]:
        """See ``Playback``."""
        metrics = _metrics(self.run)
        modules = self.display.robot.modules
        return {name: _title(metrics[name], modules) for name in self.display.headline}

    @cached_property
    def arrows(self) -> list[ForceArrow]:
        """See ``Playback``."""
        poses = self.body_poses([self.model.body(name).id for name in self.display.badges])
        own = self.display.arrows(self.trajectory, list(np.moveaxis(poses, 1, 0)))
        if own is not None or self._contacts is None:
            return own or []
        return body_arrows(*self._contacts, len(self.time))

    @cached_property
    def forces(self) -> ContactForces | None:
        """See ``Playback``."""
        if self.columns or self._contacts is None:
            return None
        bore = 2 * self.network.parts[0].fitting.radius
        return drawn_forces(*self._contacts, self.legends["body"], bore)

    @cached_property
    def _contacts(self) -> tuple[WallContacts, mujoco.MjModel] | None:
        """Contacts with the walls, and their model; None where no forces of bodies are recorded."""
        trajectory = self.trajectory
        if "wall_force" not in trajectory.channels or not trajectory["wall_force"].size:
            return None
        robot, step = self.display.robot, self.run.scenario.physics.timestep
        # The model of a recorded robot has its plates.
        plates = () if isinstance(robot, Recorded) else self.plates
        options = SceneOptions(plates, step, 0.0, None, exact=True, looks=True)
        model = scene(robot, self.network, options).compile()
        return contacts_of_run(model, trajectory), model

    @cached_property
    def track_travel(self) -> Array:
        """See ``Playback``."""
        return self.display.travel(self.trajectory)


def _run_again(
    data: dict[str, Any], rest: Result, coarse: bool, modules: Collection[str]
) -> RunPlayback:
    """Return a playback of a run whose scenario was sent apart, by a process with ``modules``."""
    with trusting(modules):
        scenario = Scenario.model_validate(data)
    return RunPlayback(replace(rest, scenario=scenario), coarse)


def _figure_rows(result: Result) -> list[dict[str, Any]]:
    """Return the metrics of a run in their order, with a row for each entry of a table."""
    known, rows = _metrics(result), []
    for name, value in result.metrics.items():
        metric = known.get(name)
        words = {"unit": "", "meaning": "a metric of the user's own"}
        if metric is not None:
            words = {"unit": metric.unit, "meaning": metric.meaning.replace("`", "")}
        entries = value if isinstance(value, dict) else {"": value}
        for entry, one in entries.items():
            rows.append({"name": f"{name} {entry}".strip(), "value": one, **words})
    return rows


def _metrics(result: Result) -> dict[str, Metric]:
    """Return the package's metrics of a run by name; a user's own are not looked up."""
    shipped = (*result.scenario.robot.metrics, *ESTIMATE_METRICS, *TAIL_METRICS, *TETHER_METRICS)
    return {metric.name: metric for metric in shipped}


def _title(metric: Metric, modules: int) -> str:
    """Return the title of a metric, with the modules where it has a value for each."""
    numbers = ", ".join(str(i + 1) for i in range(modules))
    return metric.title + (f", modules {numbers}" if metric.per_module else "")
