"""A run's record as other tools take it: a dataset of xarray, and a table of CSV."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.text import csv_text, installing, strict_json
from omnitrack_sim.record.channels import Channel, Vector
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.robots.recorded import Recorded
from omnitrack_sim.robots.robot import Robot

if TYPE_CHECKING:
    import xarray

TIME, PHASE = "time", "phase"
_TURN = {"qw": "1", "qx": "1", "qy": "1", "qz": "1"}
_PARTS: tuple[dict[str, str], ...] = (
    {"x": "m", "y": "m", "z": "m", **_TURN},
    _TURN,
    {"": "m"},
    {"": "rad"},
)
"""Numbers of a joint and their units: free, ball, slide and hinge, as MuJoCo numbers them."""


def to_xarray(result: Result | str | os.PathLike[str], *, trust: bool = False) -> xarray.Dataset:
    """Return the record of a run as a dataset of xarray, with units and names.

    Each channel is a variable over ``time`` and, where it has several numbers, over ``module``,
    ``body``, ``actuator`` or ``axis``, whose coordinates are their names; ``joint_position`` is
    over ``joint``. Variables have the attributes ``units``, ``long_name`` and ``frame``. The
    dataset has those of the run: ``outcome``, ``reason``, and as JSON ``scenario``, ``metrics`` and
    ``phases``, which the codes of ``phase`` index.

    Args:
        result: the run, or the folder of a saved one.
        trust: of a folder, see ``load_result``.

    Raises:
        ImportError: xarray is not installed; it is the extra ``xarray`` of this package.
        OutputError: the folder is no run.

    Example:
        >>> dataset = ot.to_xarray(ot.run("straight"))  # doctest: +SKIP
        >>> dataset.belt_speed.sel(module=1).plot()  # doctest: +SKIP
    """
    try:
        import xarray
    except ImportError as error:
        needed = f"to_xarray needs xarray: {installing('xarray')}"
        raise ImportError(needed) from error
    run = as_result(result, trust)
    trajectory, robot = run.trajectory, run.scenario.robot
    known: dict[str, Sequence[Any]] = {}
    variables: dict[str, Any] = {}
    for name, channel in trajectory.schema.items():
        dimensions = [TIME, *_dimensions(channel, robot, known)]
        about = {"units": channel.unit, "long_name": channel.meaning, "frame": channel.frame}
        variables[name] = (dimensions, trajectory[name], about)
    columns = joint_columns(robot)
    known["joint"] = [name for name, _ in columns]
    about = {"units": "m, rad", "long_name": "positions of the joints, MuJoCo's qpos"}
    variables["joint_position"] = ([TIME, "joint"], trajectory.qpos, about)
    coordinates = {name: (name, np.asarray(labels)) for name, labels in known.items()}
    coordinates[TIME] = (TIME, trajectory.time, {"units": "s"})  # type: ignore[assignment]
    return xarray.Dataset(variables, coordinates, _about(run))


def _about(run: Result) -> dict[str, Any]:
    """Attributes of a run's dataset, all of types that its files may hold."""
    return {
        "name": run.scenario.name,
        "outcome": run.outcome.value,
        "reason": run.reason,
        "phases": json.dumps(run.trajectory.phases),
        "metrics": strict_json(run.metrics),
        "scenario": run.scenario.model_dump_json(),
    }


def _dimensions(channel: Channel, robot: Robot, known: dict[str, Sequence[Any]]) -> list[str]:
    """Return the names of a channel's axes after time; add the coordinates of new ones."""
    names = []
    for axis in range(len(channel.shape)):
        name, labels = _axis(channel, axis, robot)
        if known.setdefault(name, labels) != labels or name in names:
            name = f"{channel.name}_{axis + 1}"
            known[name] = labels
        names.append(name)
    return names


def _axis(channel: Channel, axis: int, robot: Robot) -> tuple[str, Sequence[Any]]:
    """Name and coordinates of an axis of a channel."""
    size, is_last = channel.shape[axis], axis == len(channel.shape) - 1
    if channel.names and len(channel.shape) == 1:
        return channel.display.each or channel.name, list(channel.names)
    if isinstance(channel, Vector):
        return ("axis", [*"xyz"]) if size == 3 else ("quaternion_part", [*"wxyz"])
    if is_last and axis > 0:
        # Columns are the channel's name and a label of each axis.
        labels = [column.rpartition("_")[2] for column in channel.columns[:size]]
        return ("axis" if labels == [*"xyz"] else f"{channel.name}_{axis + 1}"), labels
    if size == robot.modules:
        return "module", [*range(1, size + 1)]
    return f"{channel.name}_{axis + 1}", [*range(1, size + 1)]


def joint_columns(robot: Robot) -> list[tuple[str, str]]:
    """Return name and unit of each joint position of a robot, in the order of ``qpos``."""
    from omnitrack_sim.robots.scene import compiled

    model = robot.spec().compile() if isinstance(robot, Recorded) else compiled(robot)
    kinds = model.jnt_type.tolist()
    return [
        (f"{name}_{part}" if part else name, unit)
        for name, kind in zip(robot.joints, kinds, strict=True)
        for part, unit in _PARTS[kind].items()
    ]


def labels_of(channel: Channel) -> list[str]:
    """Return a name for each number of a channel; "" where it has only one."""
    return [column.removeprefix(channel.name).removeprefix("_") for column in channel.columns]


class Series(NamedTuple):
    """Numbers over time that belong together, such as those of a channel.

    Attributes:
        name: of them all.
        labels: of each; "" of one alone.
        units: of each; empty or "1" without one.
        values: (T, n).
        meaning, frame: in words; empty where nothing is said.
        whole: they are whole numbers.
        words: what a code stands for, in each sample; None of what is no code.
    """

    name: str
    labels: Sequence[str]
    units: Sequence[str]
    values: NDArray
    meaning: str = ""
    frame: str = ""
    whole: bool = False
    words: Sequence[str] | None = None


def series_of(result: Result) -> list[Series]:
    """Return the channels of a run; joint positions are not among them."""
    trajectory = result.trajectory
    series = []
    for name, channel in trajectory.schema.items():
        values = trajectory[name].reshape(len(trajectory.time), -1)
        labels, phases = labels_of(channel), trajectory.phases
        words = [phases[int(code)] for code in values[:, 0]] if name == PHASE else None
        about = (channel.meaning, channel.frame, channel.whole, words)
        series.append(Series(name, labels, [channel.unit] * len(labels), values, *about))
    return series


def joint_series(result: Result) -> Series:
    """Return the joint positions of a run."""
    names, units = zip(*joint_columns(result.scenario.robot), strict=True)
    return Series("joint", names, units, result.qpos)


def to_csv(time: NDArray, series: Iterable[Series]) -> bytes:
    """Return series as CSV: a row a sample, units in brackets in the header, codes in words."""
    columns: dict[str, NDArray | Sequence[str]] = {"time [s]": time}
    for one in series:
        if one.words is not None:
            columns[one.name] = one.words
            continue
        for label, unit, values in zip(one.labels, one.units, one.values.T, strict=True):
            head = f"{one.name} {label}".strip()
            columns[head if unit in ("", "1") else f"{head} [{unit}]"] = values
    cells = [own.tolist() if isinstance(own, np.ndarray) else own for own in columns.values()]
    return csv_text(chain([list(columns)], zip(*cells, strict=True))).encode()
