"""Runs read back from their folders, each checked as a whole."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import NetworkError, OutputError
from omnitrack_sim.base.files import table_of
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.record.events import Event, event_of
from omnitrack_sim.record.metrics import METRICS, Metrics
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.results.files import (
    MAP_FILE,
    RESULT_FILE,
    SCENARIO_FILE,
    TRAJECTORY_FILE,
    read_trajectory,
    reading,
)
from omnitrack_sim.results.pictures import read_pictures
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.scenario import read_back

END_TOLERANCE = 1e-6
"""How far the last sample may be from the end of the run, s."""


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _LegTable(_Part):
    way: Annotated[tuple[tuple[Annotated[int, Field(ge=0)], str, str], ...], Field(min_length=1)]
    gear: Literal[-1, 1]
    begin: float
    end: float
    goal: int
    note: str


class _Summary(_Part):
    """What is read of ``result.json``."""

    outcome: Outcome
    reason: str
    duration_s: Annotated[float, Field(ge=0)]
    metrics: dict[str, Any]
    provenance: dict[str, Any]
    events: tuple[dict[str, Any], ...]
    legs: tuple[_LegTable, ...]


def load_result(directory: str | Path) -> Result:
    """Read a run back from its folder.

    Raises:
        OutputError: it is no run, or a file of it is missing or damaged; the message names the
            file.
    """
    folder = Path(directory)
    with reading(folder / RESULT_FILE) as path:
        summary = _summary(path.read_bytes())
        events = [_event(table) for table in summary.events]
        _check_metrics(summary.metrics)
    with reading(folder / SCENARIO_FILE) as path:
        scenario = read_back(json.loads(path.read_bytes()))
        if scenario.hash != summary.provenance.get("scenario_sha256"):
            raise ValueError(f"it is not the scenario that {RESULT_FILE} tells the end of")
    found = None
    if scenario.exploration is not None:
        with _advised(folder), reading(folder / MAP_FILE) as path:
            found = Network.believed_from(table_of(path, "network", NetworkError))
    with _advised(folder):
        trajectory = read_trajectory(folder, drive_of(scenario.robot.drive))
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
        map=found,
        album=album,
    )
    with reading(folder / RESULT_FILE):
        _check_legs(result)
        routes = len(result.routes())
    with _advised(folder), reading(folder / TRAJECTORY_FILE):
        _check_trajectory(result, routes)
    return result


def as_result(result: Result | str | os.PathLike[str]) -> Result:
    """A result itself, or the one in the folder of a saved run.

    Raises:
        OutputError: the folder is no run. TypeError: it is neither result nor folder.
    """
    if isinstance(result, str | os.PathLike):
        return load_result(Path(result))
    return check_is(Result, "result", result)


@contextmanager
def _advised(folder: Path) -> Iterator[None]:
    """Say of a damaged record of a run, whose scenario has been read, how it is made again."""
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


def _event(table: dict[str, Any]) -> Event:
    """An event that tells itself in words as it did when it was written."""
    event = event_of(table)
    str(event)
    return event


def _check_metrics(metrics: Metrics) -> None:
    """Refuse shipped metrics of another kind; those of a user's own may be anything."""
    for metric in METRICS:
        if metric.name not in metrics:
            continue
        value: Any = metrics[metric.name]
        if metric.per_module:
            right = isinstance(value, list) and len(value) == MODULES
            numbers = value if right else ()
        else:
            right = True
            numbers = value.values() if isinstance(value, dict) else (value,)
        if not right or not all(x is None or type(x) in (int, float) for x in numbers):
            raise ValueError(f"metrics.{metric.name} is {shown(value)}")


def _check_legs(result: Result) -> None:
    """Refuse ways that do not lead from part to part of the run's network, or of the map that the
    robot has made of it."""
    network = result.scenario.network if result.map is None else result.map
    if network is None:
        if result.legs:
            raise ValueError("legs: are of missions only")
        return
    parts = network.pipes.parts
    for number, leg in enumerate(result.legs):
        before = None
        for part, enter, leave in leg.way:
            there = part < len(parts) and {enter, leave} <= set(parts[part].fitting.port_names)
            if not there or enter == leave:
                raise ValueError(f"legs.{number}.way: there is no {part}, {enter}, {leave}")
            end = f"{parts[part].name}.{enter}"
            if before is not None and network.joined_to.get(before) != end:
                raise ValueError(f"legs.{number}.way: {before} is not joined to {end}")
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
