"""Robot of a saved run as the run's folder has it: what can be looked at without its code.

The run of a robot that comes from outside the package keeps its sizes, the words about what was
measured, and its model for pictures. From these it is read, drawn and compared where nobody trusts
the code, or the model file, that the scenario names.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NoReturn, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from omnitrack_sim.base.errors import Fault, InputError, OutputError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.base.table import FileName, ObjectName, Positive, Table, marks_of
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.display import Colour
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.record.timeline import Touch
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot, SceneOptions

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.robots.display import RobotDisplay

MODEL_FILE = "robot.mjz"
"""File in a run's folder: the model of the robot as pictures show it, with all its meshes."""
Numbers3 = tuple[float, float, float]
Matrix = tuple[Numbers3, Numbers3, Numbers3]
Words = Annotated[tuple[str, ...], Field(max_length=1000)]


class RecordedMetric(Table):
    """Words about a metric; see ``Metric``."""

    name: str
    unit: str
    meaning: str
    per_module: bool
    in_tables: bool
    title: str
    digits: Annotated[int, Field(ge=0, le=15)]


class RecordedLooks(Table):
    """What a robot chooses of its figures and pages; see ``RobotDisplay``."""

    plots: Words
    first_plots: Words
    unplotted: Words
    headline: Words
    compared: Words
    summary: tuple[tuple[tuple[str, int | None], ...], ...]
    columns: tuple[tuple[str, Colour], ...]
    camera: tuple[str | int, Numbers3, Matrix, float]


class RecordedValues(Table):
    """What a run records of its robot; the names are those of ``Robot``."""

    chassis: str
    position: Numbers3
    rotation: Matrix
    ends: tuple[str, str] | None
    length: Positive
    nominal_bore: Positive
    mass: Annotated[float, Field(ge=0)]
    modules: Annotated[int, Field(ge=0, le=1000)]
    joints: dict[str, tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0, le=100_000)]]]
    metrics: Annotated[tuple[RecordedMetric, ...], Field(max_length=1000)]
    channels: Words
    advice: dict[str, str]
    bores: tuple[float, float | None]
    looks: RecordedLooks | None

    def __hash__(self) -> int:
        return hash(self.model_dump_json())  # models are kept by their robots

    @model_validator(mode="after")
    def _names_are_there(self) -> Self:
        """Refuse looks at channels and metrics that are not there."""
        looks, turn = self.looks, np.array(self.rotation)
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise ValueError("has a rotation that is none")
        if looks is None:
            return self
        panels = (name for row in looks.summary for name, _ in row)
        asked = {*looks.plots, *looks.first_plots, *looks.compared, *panels}
        lacking = asked - set(self.channels)
        lacking |= set(looks.headline) - {metric.name for metric in self.metrics}
        if lacking:
            raise ValueError(f"shows {min(lacking)!r}, which was not recorded")
        return self


def is_recorded(robot: Robot) -> bool:
    """Return whether a run keeps what is to be seen of its robot.

    It is the case for a robot that cannot be made again from the scenario and the package alone.
    """
    kind = type(robot)
    if isinstance(robot, Recorded) or not kind.__module__.startswith("omnitrack_sim."):
        return True
    named = (getattr(robot, key) for key in marks_of(kind, ObjectName))
    return bool(marks_of(kind, FileName)) or any(":" in name for name in named)


def values_of(robot: Robot, schema: Mapping[str, Channel] | None = None) -> dict[str, Any]:
    """Return what is recorded of a robot, as plain data.

    Args:
        robot: the robot.
        schema: channels of its run; None: it is not to be shown.
    """
    if isinstance(robot, Recorded):
        return robot.values.model_dump(mode="json")
    frame, (low, high) = robot.frame, robot.bores
    fields = ("name", "unit", "meaning", "per_module", "in_tables", "title", "digits")
    looks = None
    if schema is not None:
        display = robot.display
        looks = {key: getattr(display, key) for key in RecordedLooks.model_fields}
    return {
        "chassis": robot.chassis,
        "position": np.asarray(frame.position, float).tolist(),
        "rotation": np.asarray(frame.rotation, float).tolist(),
        "ends": robot.ends,
        "length": float(robot.length),
        "nominal_bore": float(robot.nominal_bore),
        "mass": float(robot.mass),
        "modules": robot.modules,
        "joints": {name: (part.start, part.stop) for name, part in robot.joints.items()},
        "metrics": [{key: getattr(metric, key) for key in fields} for metric in robot.metrics],
        "channels": list(schema or ()),
        "bores": (float(low), float(high) if math.isfinite(high) else None),
        "advice": {outcome.value: robot.advice(outcome) for outcome in Outcome},
        "looks": looks,
    }


def model_bytes(robot: Robot, network: Assembly, plates: Sequence[Port]) -> bytes:
    """Return the model of a robot in pipes as pictures show it, with all its files, as an archive.

    Raises:
        ValueError: MuJoCo cannot compile it.
    """
    import tempfile

    spec = robot.display.spec(network, plates)
    spec.compiler.saveinertial = True  # a body without geoms may have its mass from code alone
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / MODEL_FILE
        spec.encode(str(file), model=spec.compile())
        return file.read_bytes()


class Recorded(Robot):
    """Robot of a saved run, known by what the run has recorded of it. It can be shown, not run."""

    kind: ClassVar[str] = "recorded"
    colliders: ClassVar[tuple[str, ...]] = ("exact", "primitives")
    rolls: ClassVar[bool] = True
    table: str = quantity(..., "", "derived", "table of the scenario, as JSON")
    file: str = quantity(..., "", "derived", "model for pictures, in the folder of the run")
    values: RecordedValues = quantity(..., "", "derived", "what was recorded")

    @model_serializer(mode="wrap")
    def _with_kind(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:  # noqa: ARG002
        return json.loads(self.table)

    def to_table(self) -> dict[str, Any]:
        """Return the table that gives this robot again, unlike its own place in the scenario."""
        return {
            "kind": self.kind,
            "table": self.table,
            "file": self.file,
            "values": self.values.model_dump(mode="json"),
            "tether": None if self.tether is None else self.tether.model_dump(mode="json"),
        }

    @property
    def modules(self) -> int:  # type: ignore[override] - of the class elsewhere
        """See ``Robot``."""
        return self.values.modules

    @property
    def chassis(self) -> str:
        """See ``Robot``."""
        return self.values.chassis

    @property
    def frame(self) -> Pose:
        """See ``Robot``."""
        return Pose(np.array(self.values.rotation), np.array(self.values.position))

    @property
    def ends(self) -> tuple[str, str] | None:
        """See ``Robot``."""
        return self.values.ends

    @property
    def length(self) -> float:
        """See ``Robot``."""
        return self.values.length

    @property
    def nominal_bore(self) -> float:
        """See ``Robot``."""
        return self.values.nominal_bore

    @property
    def mass(self) -> float:
        """See ``Robot``."""
        return self.values.mass

    @property
    def bores(self) -> tuple[float, float]:
        """See ``Robot``."""
        low, high = self.values.bores
        return low, math.inf if high is None else high

    @property
    def joints(self) -> Mapping[str, slice]:
        """See ``Robot``."""
        return {name: slice(*columns) for name, columns in self.values.joints.items()}

    @property
    def channels(self) -> Mapping[str, Channel]:
        """None: the file of the trajectory describes them all."""
        return {}

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """See ``Robot``."""
        return tuple(
            Metric(compute=self._refuse, **metric.model_dump()) for metric in self.values.metrics
        )

    def advice(self, outcome: Outcome) -> str:
        """See ``Robot``."""
        return self.values.advice.get(outcome.value, outcome.advice)

    def touch(self, trajectory: Trajectory) -> Touch:
        """Return contacts and power where they were measured as of most robots; else no numbers."""
        if {"wall_force", "contact_speed", "actuator_power"} <= set(trajectory):
            return super().touch(trajectory)
        unknown = np.full((len(trajectory.time), 1), np.nan)
        return Touch(np.zeros(unknown.shape, bool), unknown, unknown, None, unknown)

    def spec(self) -> mujoco.MjSpec:
        """Return the model for pictures.

        Raises:
            OutputError: its file is missing or damaged.
        """
        from omnitrack_sim.walls.model_bounds import read_spec

        place = Path(self.file)
        try:
            spec = read_spec(place)
            model = spec.copy().compile()
        except (InputError, ValueError, OSError) as error:
            cause = "; ".join(str(error).splitlines())
            raise OutputError(f"{place}: no model to be drawn: {cause}") from error
        wanted = max((stop for _, stop in self.values.joints.values()), default=0)
        bodies = {model.body(i).name for i in range(model.nbody)}
        looks = self.values.looks
        camera = self.chassis if looks is None else looks.camera[0]
        there = camera in bodies if isinstance(camera, str) else 0 <= camera < model.nbody
        if model.nq != wanted or self.chassis not in bodies or not there:
            raise OutputError(f"{place}: is the model of another robot")
        return spec

    def notes(self, bores: Iterable[float], timestep: float) -> NoReturn:  # noqa: ARG002 - protocol
        """Refuse to be run.

        Raises:
            InputError: always.
        """
        self._refuse()

    def scene(self, network: Assembly, options: SceneOptions) -> NoReturn:  # noqa: ARG002
        """Refuse to be run.

        Raises:
            InputError: always.
        """
        self._refuse()

    def _refuse(self, *_: Any) -> NoReturn:
        kind = json.loads(self.table).get("kind", "")
        problem = (
            f"is {kind!r}, of which this run was read without its code and files: it can be shown, "
            "not run; ot.load_result(folder, trust=True) loads them"
        )
        raise InputError(Fault("robot.kind", problem))

    @property
    def display(self) -> RobotDisplay:
        """See ``Robot``."""
        from omnitrack_sim.robots.recorded_display import RecordedDisplay

        return RecordedDisplay(self)
