"""What a run leaves: outcome, metrics, trajectory, provenance; and its folder on disk."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import os
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.errors import OutputError
from omnitrack_sim.naming import ByName
from omnitrack_sim.network import Leg
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.channels import CHANNELS, Channel, Vector
from omnitrack_sim.record.events import Event, event_of
from omnitrack_sim.record.metrics import Metrics
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.record.timeline import Visit, timeline
from omnitrack_sim.record.trajectory import RECORDED, Trajectory
from omnitrack_sim.rotations import Array
from omnitrack_sim.scenario import Scenario, read_back
from omnitrack_sim.text import strict_json

RESULT_FILE = "result.json"


@dataclass(frozen=True)
class Result:
    """The end of one run.

    Attributes:
        scenario: what was run, resolved.
        outcome: how it ended. reason: where, and what was measured there.
        duration_s: simulated seconds.
        metrics: see ``metrics.summarise``.
        trajectory: the record.
        provenance: versions, seed, scenario hash, git commit.
        events: remarks of the controller and the runner.
        legs: of a mission, in the order of the trajectory's ``leg``; empty for plain pipes.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "metrics", ByName(self.metrics))

    def __repr__(self) -> str:
        name, record = self.scenario.name, len(self.trajectory)
        ended = f"{self.outcome.value} after {self.duration_s:.6g} s"
        return f"Result({name!r}: {ended}; {len(self.metrics)} metrics, {record} samples)"

    @property
    def success(self) -> bool:
        """Whether the robot reached the goal."""
        return self.outcome is Outcome.REACHED_GOAL

    @property
    def as_expected(self) -> bool | None:
        """Whether the outcome is the scenario's ``expect.outcome``; None where it expects
        nothing."""
        expected = self.scenario.expect.outcome
        return None if expected is None else self.outcome is expected

    def routes(self) -> tuple[Route, ...]:
        """The route of each leg, in the order of the trajectory's ``leg``."""
        planner = self.scenario.planner
        return (
            (self.scenario.route,)
            if planner is None
            else tuple(planner.route(leg) for leg in self.legs)
        )

    def goal_points(self) -> Array:
        """Where the robot's centre has to get to, (G, 3) m, world frame; of a mission the goals'
        ports, in order."""
        planner = self.scenario.planner
        if planner is not None:
            parts = planner.network.pipes.parts
            return np.array([parts[part].port(port).position for part, port in planner.ends[1:]])
        line = self.routes()[-1].centreline
        return line.at(np.clip([self.scenario.goal_distance], 0.0, line.length))[0]

    def plate_rims(self) -> Array:
        """Rims (P, 25, 3) m, world frame, of the plates that close ports."""
        parts, angle = self.routes()[0].network.parts, np.linspace(0.0, 2 * np.pi, 25)
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

    def write(self, folder: Path) -> None:
        """Write scenario, result, timeline, trajectory and replay, a file each, into an existing
        folder."""
        (folder / "scenario.json").write_text(
            self.scenario.model_dump_json(indent=2) + "\n", encoding="utf-8"
        )
        (folder / RESULT_FILE).write_text(strict_json(self.summary()) + "\n", encoding="utf-8")
        _write_timeline(self.timeline(), folder / "timeline.csv")
        _write_parquet(self.trajectory, folder / "trajectory.parquet")
        _write_npz(folder / "replay.npz", time=self.trajectory.time, qpos=self.trajectory.qpos)

    def save(self, directory: str | Path) -> Path:
        """Write the run into ``directory`` whole or not at all; an earlier run there is replaced.

        Raises:
            OutputError: the folder holds something that is no run, or cannot be written.
        """
        with run_folder(directory) as folder:
            self.write(folder)
        return Path(directory)


@contextmanager
def run_folder(directory: str | Path, mark: str = RESULT_FILE) -> Iterator[Path]:
    """A temporary folder beside ``directory`` that takes its place when the block ends without an
    error.

    ``mark`` is the file by which a folder that may be replaced is known.

    Raises:
        OutputError: ``directory`` holds something that is no run, or the disk is full or closed to
            us.
    """
    target = Path(directory).resolve()
    temporary: Path | None = None
    try:
        check_output(target, mark)
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        temporary.chmod(0o755)
        yield temporary
        _swap(temporary, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def check_output(directory: str | Path, mark: str = RESULT_FILE) -> None:
    """Refuse a place that a run must not overwrite.

    Raises:
        OutputError: it is a file, or a folder with other things than a run in it.
    """
    target = Path(directory)
    if target.is_dir():
        if any(target.iterdir()) and not (target / mark).is_file():
            raise OutputError(
                f"{target}: holds files but no {mark}, so it is no run; choose another folder"
            )
    elif target.exists():
        raise OutputError(f"{target}: is a file; choose a folder")


def _swap(new: Path, target: Path) -> None:
    """Put the folder ``new`` in the place of ``target``."""
    if not target.exists():
        os.rename(new, target)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}.old.", dir=target.parent))
    os.rename(target, old / "run")
    try:
        os.rename(new, target)
    except OSError:
        os.rename(old / "run", target)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def load_result(directory: str | Path) -> Result:
    """Read a run back from its folder.

    Raises:
        OutputError: it is no run, or a file of it is missing or damaged.
    """
    folder = Path(directory)
    try:
        summary = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        scenario = read_back(json.loads((folder / "scenario.json").read_text(encoding="utf-8")))
        trajectory = _read_trajectory(folder)
        return Result(
            scenario=scenario,
            outcome=Outcome(summary["outcome"]),
            reason=summary["reason"],
            duration_s=summary["duration_s"],
            metrics=summary["metrics"],
            trajectory=trajectory,
            provenance=summary["provenance"],
            events=[event_of(event) for event in summary["events"]],
            legs=tuple(_leg(leg) for leg in summary["legs"]),
        )
    except FileNotFoundError as error:
        raise OutputError(f"{folder}: is no run: {Path(error.filename).name} is missing") from error
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise OutputError(f"{folder}: cannot be read as a run: {error}") from error


def _leg(data: dict[str, Any]) -> Leg:
    way = tuple((int(part), str(enter), str(leave)) for part, enter, leave in data["way"])
    rest = {key: value for key, value in data.items() if key != "way"}
    return Leg(way, **rest)


def _write_timeline(visits: list[Visit], path: Path) -> None:
    """One row a visit. Numbers are written so that reading gives them back exactly; what there is
    not, is empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(field.name for field in dataclasses.fields(Visit))
        rows.writerows(dataclasses.astuple(visit) for visit in visits)


def _write_parquet(trajectory: Trajectory, path: Path) -> None:
    """One row a sample; unit and meaning stand in each column's metadata, phase names in the
    table's."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [pa.field("time", pa.float64(), metadata={"unit": "s", "meaning": "simulated time"})]
    columns = [pa.array(trajectory.time)]
    for name, channel, values in trajectory.columns():
        about = {"unit": channel.unit, "meaning": channel.meaning, "frame": channel.frame}
        columns.append(pa.array(values))
        fields.append(pa.field(name, columns[-1].type, metadata=about))
    own = [
        {**dataclasses.asdict(channel), "vector": isinstance(channel, Vector)}
        for name, channel in trajectory.schema.items()
        if name not in CHANNELS
    ]
    about_all = {"phases": json.dumps(trajectory.phases), "own_channels": json.dumps(own)}
    schema = pa.schema(fields, metadata=about_all)
    pq.write_table(pa.Table.from_arrays(columns, schema=schema), path, compression="zstd")


def _read_trajectory(folder: Path) -> Trajectory:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with (folder / "trajectory.parquet").open("rb") as file:
            table = pq.read_table(file)
    except pa.ArrowException as error:
        raise ValueError(f"trajectory.parquet: {error}") from error
    schema = {**RECORDED}
    for own in json.loads(table.schema.metadata[b"own_channels"]):
        kind = Vector if own.pop("vector") else Channel
        schema[own["name"]] = kind(**{**own, "shape": tuple(own["shape"])})
    channels = {}
    for name, channel in schema.items():
        values = np.stack([table[column].to_numpy() for column in channel.columns], axis=-1)
        channels[name] = values.reshape(table.num_rows, *channel.shape)
    phases = tuple(json.loads(table.schema.metadata[b"phases"]))
    with np.load(folder / "replay.npz") as replay:
        return Trajectory(replay["time"], channels, phases, replay["qpos"], schema)


def _write_npz(path: Path, **arrays: np.ndarray) -> None:
    """As ``numpy.savez_compressed``, but without the time of day, so that equal runs give equal
    bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array))
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, buffer.getvalue())


def provenance_of(scenario: Scenario) -> dict[str, Any]:
    """What made a result: seed, scenario hash, versions, platform, git commit of a checkout."""
    return {"seed": scenario.seed, "scenario_sha256": scenario.hash, **environment()}


@cache
def environment() -> dict[str, Any]:
    """Versions, platform and git commit of this process."""
    versions = {name: _version(name) for name in ("omnitrack_sim", "mujoco", "numpy")}
    return {
        "versions": versions | {"python": platform.python_version()},
        "platform": f"{platform.system()} {platform.machine()}",
        "git_commit": _git_commit(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_commit() -> str | None:
    """Commit of the checkout that the package runs from, with ``+changes`` where files differ; None
    outside one."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        command = [
            "git",
            "-C",
            str(root),
            "describe",
            "--always",
            "--abbrev=40",
            "--dirty=+changes",
            "--exclude=*",
        ]
        return subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=10
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
