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
from omnitrack_sim.record.channels import COMMON
from omnitrack_sim.record.display import CarriedCamera, Curve, ForceArrow, Moment, StatusText
from omnitrack_sim.record.events import Note
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.recorded import Recorded
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.landmarks import Landmarks, PassageSpan, passage_spans
from omnitrack_sim.show.playback import POINTS_APART, STANDARD, PhaseSpan, Playback, sound_rows
from omnitrack_sim.show.projection import needs_map
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
    """

    def __init__(self, result: Result, coarse: bool = True) -> None:
        self._run, self._coarse = result, coarse
        scenario, display = result.scenario, result.scenario.robot.display
        self.result, self.display = result, display
        self.name, self.network, self.plates = scenario.name, result.pipes, scenario.plates
        self.album, self.page_camera = result.album, display.page_camera
        self.badges, self.columns, self.state = display.badges, display.columns, display.state
        self.tracks, self.track_pitch = display.tracks, display.track_pitch

    def __reduce__(self) -> tuple[Any, ...]:
        # Tables of fittings are classes made while files are read, which cannot be pickled.
        scenario, robot = self._run.scenario, self._run.scenario.robot
        data = scenario.model_dump(mode="json", exclude_none=True)
        if isinstance(robot, Recorded):
            data["robot"] = robot.to_table()
        rest: Any = replace(self._run, scenario=None)  # type: ignore[arg-type]
        return _run_again, (data, rest, self._coarse, tuple(sys.modules))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The record, each sample that has diverged replaced by the last one before it."""
        trajectory = self._run.trajectory
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
        return self._run.trajectory.time

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
        """Return what the robot tells of a sample."""
        return self.display.status(self.moment(row))

    @cached_property
    def passages(self) -> list[PassageSpan]:
        """See ``Playback``."""
        return passage_spans(self._run, self.trajectory)

    @cached_property
    def _begins(self) -> list[int]:
        """First sample of each passage."""
        return [passage.first for passage in self.passages]

    @cached_property
    def leg(self) -> NDArray[np.intp] | None:
        """See ``Playback``."""
        return self.trajectory["leg"] if len(self._run.routes()) > 1 else None

    @cached_property
    def phases(self) -> list[PhaseSpan]:
        """See ``Playback``."""
        codes = {name: code for code, name in enumerate(self.trajectory.phases)}
        return [PhaseSpan(*span, codes[span[0]]) for span in self.trajectory.phase_spans()]

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """See ``Playback``."""
        events = sorted(self._run.events, key=lambda event: event.time)
        return [
            (event.time, event.text)
            for event in events
            if not isinstance(event, Note) and math.isfinite(event.time)
        ]

    @cached_property
    def notes(self) -> list[str]:
        """See ``Playback``."""
        return [str(event) for event in self._run.events if isinstance(event, Note)]

    @cached_property
    def landmarks(self) -> Landmarks | None:
        """See ``Playback``."""
        return Landmarks.of(self._run, self.trajectory) if needs_map(self._run) else None

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Channels of the plots with their commands, and those that the robot's page needs."""
        trajectory, plots = self.trajectory, self.plots
        commands = [trajectory.schema[name].display.command for name in plots]
        names = (*plots, *filter(None, commands), *self.display.page_channels)
        return {name: Curve(trajectory.schema[name].display, trajectory[name]) for name in names}

    @cached_property
    def plots(self) -> Sequence[str]:
        """The robot's own choice of channels, and those of sensors that it knows nothing of."""
        plots, known = self.display.plots, {*COMMON, *self.display.plots, *self.display.unplotted}
        own = [
            name
            for name, channel in self._run.trajectory.schema.items()
            if name not in known and len(channel.columns) <= MAX_COLUMNS
        ]
        return (*plots, *own)

    @cached_property
    def first_plots(self) -> Sequence[str]:
        """See ``Playback``."""
        return self.display.first_plots

    @cached_property
    def heading(self) -> dict[str, Any]:
        """Name, outcome, metrics and versions."""
        run, provenance = self._run, self._run.provenance
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
        metrics = _metrics(self._run)
        modules = self.display.robot.modules
        return {name: _title(metrics[name], modules) for name in self.display.headline}

    @cached_property
    def arrows(self) -> list[ForceArrow]:
        """See ``Playback``."""
        poses = self.body_poses([self.model.body(name).id for name in self.badges])
        return self.display.arrows(self.trajectory, list(np.moveaxis(poses, 1, 0)))

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
    """Return the metrics of a run's robot by name."""
    return {metric.name: metric for metric in result.scenario.robot.metrics}


def _title(metric: Metric, modules: int) -> str:
    """Return the title of a metric, with the modules where it has a value for each."""
    numbers = ", ".join(str(i + 1) for i in range(modules))
    return metric.title + (f", modules {numbers}" if metric.per_module else "")
