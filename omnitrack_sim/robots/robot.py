"""Robot: what the simulator asks of one. A robot is a table of a scenario file, with its own kind.

The folders of this room are the robots of the package. One of a user's own is a class that
inherits from ``Robot`` and is named ``module:Class`` in the file, or an MJCF file.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import SerializerFunctionWrapHandler, model_serializer

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import name_of
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes import Assembly, Passage, Port
from omnitrack_sim.record.channels import COMMON, Channel
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.record.events import Event, Outcome, Overloaded
from omnitrack_sim.record.metrics import COMMON_METRICS, Metric, Run
from omnitrack_sim.record.timeline import Touch
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.control import Controller, OwnController
from omnitrack_sim.robots.periodic import Periodic
from omnitrack_sim.robots.quantity import Parameter, parameter_rows, quantity, unit_at
from omnitrack_sim.robots.size import GRAVITY, Sized
from omnitrack_sim.robots.tail import Tether

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.robots.diagnosis import Diagnosis
    from omnitrack_sim.robots.display import RobotDisplay
    from omnitrack_sim.robots.odometry import Odometry
    from omnitrack_sim.robots.plant import Plant, Start


MAX_WEIGHTS = 20.0
"""Normal force of a body on the wall, in weights of its robot, from which on a result carries a
note. Robots begin with 1 to 3 and pass tees with 12 at most; what presses harder is jammed, and how
hard depends on how soft the contacts are."""


@dataclass(frozen=True)
class SceneOptions:
    """Options of the model of a robot in pipes.

    Attributes:
        plates: ports (part index, port) that are closed by a plate.
        timestep: s.
        wall_tolerance, staves: of walls of primitives.
        exact: exact walls.
        looks: for pictures.
    """

    plates: Sequence[Port]
    timestep: float
    wall_tolerance: float
    staves: int | None
    exact: bool
    looks: bool


class Robot(Sized, ABC):
    """Base class of robots: a frozen table of parameters, and what is derived from them.

    A subclass declares its parameters as fields, by ``ot.quantity`` with unit and source each. It
    has to have ``spec``; ``nominal_bore`` where it has no field ``bore``; and ``length`` where its
    model has no sites ``nose`` and ``tail``. All else has a default. In the robot's frame z points
    to the nose, and the origin lies half-way between nose and tail.

    Attributes:
        kind: name of the class in files: a word for robots of the package, else ``module:Class``.
        colliders: values of ``physics.collider`` that it can drive with.
        rolls: it has modules that roll, which ``start.roll_deg`` is for.
        nose, tail: names of sites at its ends, where ``length`` or ``ends`` go by them.
        tether: that it drags along; None: it has none.
        modules: number of its alike parts, numbered from 1, that its metrics ``per_module`` have a
            value of each of; 0: it has none.
        built: keys of ``[robot]`` that make it the robot that was built, where its defaults are
            those of a simulation; benches and passports take them.
        own_values: dotted paths below ``[robot]`` of the numbers in which robots of one batch may
            differ, a ``*`` for any key; see ``Plant.reset``.

    Example:
        >>> import mujoco
        >>> class Ball(ot.Robot):
        ...     radius: float = 0.05
        ...     @property
        ...     def nominal_bore(self):
        ...         return 0.16
        ...     @property
        ...     def length(self):
        ...         return 2 * self.radius
        ...     def spec(self):
        ...         spec = mujoco.MjSpec()
        ...         ball = spec.worldbody.add_body(name="chassis")
        ...         _ = ball.add_freejoint(), ball.add_geom(size=[self.radius, 0, 0])
        ...         return spec
        >>> Ball(radius=0.06).length
        0.12
    """

    tether: Tether | None = quantity(
        None, "", "assumed", "a table of the line that it drags; left out: none"
    )
    OTHER_KEYS: ClassVar[tuple[str, ...]] = ("kind",)
    kind: ClassVar[str]
    colliders: ClassVar[tuple[str, ...]] = ("exact",)
    rolls: ClassVar[bool] = False
    nose: ClassVar[str] = "nose"
    tail: ClassVar[str] = "tail"
    modules: ClassVar[int] = 0
    built: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    own_values: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        # A user's class must be importable by its name again when the file is read on another day.
        if "kind" not in vars(cls):
            cls.kind = name_of(cls)

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:
        """Return the class of the ``kind`` in ``value``, or that of the default robot."""
        from omnitrack_sim.robots.kinds import DEFAULT, robot_class

        try:
            return robot_class(str(value.get("kind", DEFAULT)))
        except InputError:
            return cls

    @model_serializer(mode="wrap")
    def _with_kind(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        from omnitrack_sim.robots.kinds import DEFAULT

        values = handler(self)
        if self.tether is None:
            values.pop("tether", None)  # most robots have none
        return values if self.kind == DEFAULT else {"kind": self.kind, **values}

    def parameters(self) -> list[Parameter]:
        """Return the parameter table: value, unit, provenance and source of every field.

        Fields of tables in it have names such as ``motor.NAME``.
        """
        return [row for row in parameter_rows(self) if row.name != "tether"]

    def unit_at(self, path: str) -> str | None:
        """Return the unit of the value at a dotted path below its table; None where none is there.

        Example:
            >>> ot.Omnitrack().unit_at("motor.stall_torque")
            'N m'
        """
        return unit_at(type(self), path)

    def check(self) -> None:
        """Refuse names of things that are not there.

        Raises:
            InputError: at the key.
        """

    @classmethod
    def claims(cls) -> Sequence[Any]:
        """Return what was published of it, as claims; see docs/how-to/any-robot.md."""
        return ()

    # Model

    @abstractmethod
    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone as a MuJoCo model, ready to compile.

        In its initial state its frame is the world's: z along the pipe, the origin on the pipe's
        axis.
        """

    def scene(self, network: Assembly, options: SceneOptions) -> mujoco.MjSpec:
        """Return the robot and the pipes, placed in the world, as one model, ready to compile."""
        from omnitrack_sim.robots.scene import scene

        return scene(self, network, options)

    @property
    def chassis(self) -> str:
        """Name of the body that carries the robot's frame."""
        return "chassis"

    @property
    def frame(self) -> Pose:
        """The robot's frame in that of the chassis."""
        return Pose(np.eye(3), np.zeros(3))

    @property
    def ends(self) -> tuple[str, str] | None:
        """Names of sites at nose and tail, between which z lies; None: it is the chassis' own."""
        return None

    @property
    def start_frame(self) -> Pose:
        """The robot's frame in the world of ``spec``, in its initial state."""
        return Pose(np.eye(3), np.zeros(3))

    @property
    def length(self) -> float:
        """Nose to tail along the robot axis, m.

        By default between the sites of these names along z, in the initial state.
        """
        from omnitrack_sim.robots.scene import initial_state

        data = initial_state(self)
        return float(data.site(self.nose).xpos[2] - data.site(self.tail).xpos[2])

    @property
    def mass(self) -> float:
        """Whole robot, kg."""
        from omnitrack_sim.robots.scene import compiled

        return float(compiled(self).body_mass.sum())

    @property
    def joints(self) -> Mapping[str, slice]:
        """Columns of joint positions by the names of the joints; one without goes by its number."""
        from omnitrack_sim.robots.scene import compiled

        model = compiled(self)
        starts = [*model.jnt_qposadr.tolist(), model.nq]
        given = [model.joint(i).name for i in range(model.njnt)]
        columns: dict[str, slice] = {}
        for i, name in enumerate(given):
            own = name or f"joint_{i}"
            while not name and own in given:  # another joint is called so
                own += "_"
            columns[own] = slice(*starts[i : i + 2])
        return columns

    @property
    def joint_count(self) -> int:
        """Number of joint positions, ``nq`` of the model."""
        return max(columns.stop for columns in self.joints.values())

    # Limits

    @property
    def nominal_speed(self) -> float:
        """Speed along a level straight that it is made for, m/s.

        Benchmarks take time limits from it. By default a fifth of a bore a second, slow enough for
        most.
        """
        return self.nominal_bore / 5

    @property
    def bores(self) -> tuple[float, float]:
        """Smallest and largest bore, m, that the robot fits; bores beyond them are refused."""
        return 0.0, math.inf

    def misfit(self, bore: float) -> str:
        """Return why the robot does not fit a bore of ``bore`` m; "" where it does."""
        low, high = self.bores
        fits = low < bore < high
        return "" if fits else f"the robot is for bores from {low:.4g} to {high:.4g} m"

    @property
    def top_speed(self) -> float:
        """Speed of its fastest part, m/s, that the motors hold; infinite where nothing is known."""
        return math.inf

    @property
    def drive_name(self) -> str:
        """What holds ``top_speed``, as messages name it."""
        return "the robot's drive"

    # Control

    def plant(self, model: mujoco.MjModel, start: Start, *more: Any) -> Plant:
        """Return the plant of n robots; arguments as of ``Plant``."""
        from omnitrack_sim.robots.plant import Plant

        return Plant(model, self, start, *more)

    @property
    def start_qpos(self) -> Array | None:
        """Joint positions (nq,) of the initial state; None: those of the model (``qpos0``).

        A start sets the position of the free joint that carries the robot.
        """
        return None

    @property
    def start_ctrl(self) -> Array | None:
        """Control inputs (nu,) until the controller's first command; None: zeros.

        The robot settles in its pipe with them.
        """
        return None

    @property
    def input_range(self) -> Array:
        """Least and largest value (nu, 2) of each control input, between which learners decide.

        By default the actuators' ``ctrlrange``.

        Raises:
            InputError: an actuator has none.
        """
        from omnitrack_sim.robots.scene import compiled

        model = compiled(self)
        names = [model.actuator(i).name or f"number {i}" for i in range(model.nu)]
        free = [
            n for n, limited in zip(names, model.actuator_ctrllimited, strict=True) if not limited
        ]
        if free:
            problem = f"learners need a ctrlrange of the actuators {', '.join(free)}"
            raise InputError(Fault("robot", problem))
        return model.actuator_ctrlrange.copy()

    @classmethod
    def controllers(cls) -> Mapping[str, type[Controller]]:
        """Return the shipped controllers by the name that ``control.kind`` may give.

        The first is the default. Controllers of installed distributions are beside them, see
        ``controller_of``.
        """
        return {"own": OwnController, "periodic": Periodic}

    @property
    def decisions(self) -> Any:
        """Class from a learner's actions to commands of this robot; see ``InputDecisions``."""
        from omnitrack_sim.robots.decisions import InputDecisions

        return InputDecisions

    def gait(self, observation: Any) -> Array | None:
        """Return the control inputs (n, nu) of the robot's own gait; None: it has none.

        Without one its actuators stay as they are at the start.
        """
        return None

    def odometry(self) -> Odometry | None:
        """Return what its body measures of its motion; None: nothing is known of that.

        Runs by its own sensors need it (``sensing.kind = "onboard"``).
        """
        return None

    # What is measured, judged and shown

    @property
    def channels(self) -> Mapping[str, Channel]:
        """Channels that are measured, by name, in the order of the file."""
        from omnitrack_sim.robots.model_sensors import model_channels
        from omnitrack_sim.robots.scene import compiled

        return {**COMMON, **model_channels(compiled(self))}

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics of each run."""
        return COMMON_METRICS

    def run_record(self, trajectory: Trajectory, no_load_slip: float, timestep: float) -> Run:
        """Return what the metrics of a run are computed from.

        Args:
            trajectory: the record.
            no_load_slip: m/s, see ``run.no_load_slips``.
            timestep: s, of the physics.
        """
        return Run(trajectory, self.mass * GRAVITY)

    def touch(self, trajectory: Trajectory) -> Touch:
        """Return the contacts and the power of a run, for its timeline."""
        force, speed = trajectory["wall_force"], trajectory["contact_speed"]
        # Means are over those bodies that touch the wall at all, such as wheels.
        carrying = (force > 0).any(axis=0)
        if carrying.any():
            force, speed = force[:, carrying], speed[:, carrying]
        return Touch(force > 0, force, speed, None, trajectory["actuator_power"])

    def advice(self, outcome: Outcome) -> str:
        """Return what an outcome means for a robot of this kind, and what to try."""
        return outcome.advice

    def strains(self, trajectory: Trajectory) -> list[Event]:
        """Return notes on forces or travel that a run should not have shown.

        Here that on the body that presses hardest on the wall, from ``MAX_WEIGHTS`` on.
        """
        forces = np.nan_to_num(trajectory["wall_force"])  # (T, bodies); no number if it diverged
        if not forces.size:
            return []
        sample, body = np.unravel_index(forces.argmax(), forces.shape)
        force, weight = float(forces[sample, body]), self.mass * GRAVITY
        if force <= MAX_WEIGHTS * weight:
            return []
        part = f"body {self.channels['wall_force'].names[body]!r}"
        time = float(trajectory.time[sample])
        return [Overloaded(0, time, part, force, force / weight, "the robot's weight")]

    def singular_range(self, passage: Passage, bend_radius: float | None) -> SingularRange | None:
        """Return the orientations in which the robot cannot turn; None where it can in all.

        Args:
            passage: that it takes.
            bend_radius: of the arc that its centre follows round a corner, m; None: its own.
        """
        return None

    def notes(self, bores: Iterable[float], timestep: float) -> Iterator[str]:
        """Yield remarks on a run through bores (m), with a time step (s), before it begins.

        Here one on servos that are too stiff for the inertia of their joints.
        """
        from omnitrack_sim.robots.scene import compiled
        from omnitrack_sim.robots.servos import servo_notes

        return servo_notes(compiled(self), timestep)

    def diagnosis(self, limits: Any, period: float, robots: Sequence[Robot]) -> Diagnosis:
        """Return what finds the causes of failures of robots; arguments as of ``Diagnosis``."""
        from omnitrack_sim.robots.diagnosis import Diagnosis

        return Diagnosis(self, limits, period, robots)

    @property
    def display(self) -> RobotDisplay:
        """What the robot shows of itself in films, pages, figures and windows."""
        # It has looks, which need MuJoCo and the boolean kernel.
        from omnitrack_sim.robots.display import RobotDisplay

        return RobotDisplay(self)
