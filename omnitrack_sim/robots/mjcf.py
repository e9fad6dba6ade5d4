"""A robot of somebody else: MJCF or URDF."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import ValidationInfo, field_validator

from omnitrack_sim.base.bounds import MAX_MODEL_TEXT
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.naming import by_pattern
from omnitrack_sim.base.reading import below, exists, read_bytes
from omnitrack_sim.base.rotations import Array, Pose, frame_of
from omnitrack_sim.base.table import FileName, NotNegative, Positive
from omnitrack_sim.base.text import listed
from omnitrack_sim.robots.model_file import (
    AmbiguousRootError,
    RobotModel,
    check_robot,
    in_words,
    keyframe,
    robot_model,
)
from omnitrack_sim.robots.model_values import (
    KINDS,
    Elements,
    apply,
    unit_of,
    values_of,
    with_changes,
)
from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.robots.quantity import Parameter, QuantityModel, quantity
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.scene import compiled, initial_state

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
MAX_SERVOS = 1_000
"""Tables of servos of one robot; one may be for many joints."""


class Servo(QuantityModel):
    """Motors of joints, for files without actuators. Each is an actuator with its joint's name.

    Example:
        >>> ot.Servo(joints="wheel_*", kind="velocity", gain=2.0, limit=5.0).gain
        2.0
    """

    joints: str = quantity(..., "", "unstated", 'name of a joint, or a pattern such as "wheel_*"')
    kind: Literal["velocity", "position", "force"] = quantity(
        "position", "", "unstated", "what its input asks for; of a hinge in rad/s, rad or N m"
    )
    gain: Positive = quantity(
        1.0,
        "",
        "unstated",
        "force for a unit that is missing: of a hinge N m s/rad of speed, N m/rad of angle; of a "
        "force that of its input",
    )
    damping: NotNegative | None = quantity(
        None, "", "unstated", "of a position, N m s/rad of a hinge. Left out: critical at the start"
    )
    limit: Positive | None = quantity(
        None, "", "unstated", "largest force, N, or torque, N m. Left out: that of the joint"
    )

    armature: NotNegative = quantity(
        0.0,
        "",
        "unstated",
        "inertia of motor and gears at the joint, beside that of the file: of a hinge kg m²",
    )

    def add_to(self, spec: mujoco.MjSpec, joint: str) -> None:
        """Add the motor of a joint to a model."""
        spec.joint(joint).armature += self.armature
        motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        match self.kind:
            case "velocity":
                motor.set_to_velocity(kv=self.gain)
            case "position" if self.damping is None:
                motor.set_to_position(kp=self.gain, dampratio=1.0)
            case "position":
                motor.set_to_position(kp=self.gain, kv=self.damping)
            case "force":
                motor.set_to_motor()
                motor.gainprm[0] = self.gain
        if self.limit is not None:
            motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            motor.forcerange = [-self.limit, self.limit]


class Mjcf(Robot):
    """Robot of an MJCF or URDF file, driven by a controller of your own.

    Its nose and tail are the ends of what can touch the wall, along ``forward``, in the state in
    which the file has it. What the file has beside the robot, such as a floor, is left out.

    Example:
        >>> from pathlib import Path
        >>> _ = Path("ball.xml").write_text(
        ...     "<mujoco><worldbody><body name='ball'><freejoint/>"
        ...     "<geom size='0.07'/></body></worldbody></mujoco>"
        ... )
        >>> robot = ot.Mjcf(file="ball.xml")
        >>> robot.chassis, round(robot.length, 3), round(robot.nominal_bore, 3)
        ('ball', 0.14, 0.14)
    """

    kind: ClassVar[str] = "mjcf"
    own_values: ClassVar[tuple[str, ...]] = (
        *(f"joint.*.{key}" for key in ("stiffness", "damping", "frictionloss")),
        *("actuator.*.kp", "actuator.*.kv"),
    )
    file: Annotated[str, FileName("sha256", tuple(KINDS))] = quantity(
        ..., "", "unstated", "MJCF or URDF file, relative to the scenario", max_length=4096
    )
    sha256: str | None = quantity(
        None,
        "",
        "derived",
        "of that file. Left out, it is filled in; another file than it says is refused, so that a "
        "saved run repeats itself or says why not. Files that it names in turn are not in it",
        validate_default=True,
    )
    body: str = quantity(
        "",
        "",
        "derived",
        "chassis: the body whose pose is the robot's. Left out: the one of the world that carries "
        "actuators, a free joint or joints",
        validate_default=True,
    )
    keyframe: str = quantity(
        "",
        "",
        "unstated",
        "state that the file has saved, in which the robot begins: joints and inputs. Left out: "
        "the pose of its bodies",
    )
    forward: Axis = quantity(
        "z", "", "unstated", "axis of the chassis that points to the robot's nose"
    )
    centre: tuple[float, float, float] = quantity(
        (0.0, 0.0, 0.0),
        "m",
        "unstated",
        "point of the chassis, in its frame, that the robot's axis goes through; what it is along "
        "the axis means nothing",
    )
    bore: Positive | None = quantity(
        None,
        "m",
        "derived",
        "inner diameter of the pipe that it is made for. Left out: twice its largest extent from "
        "its axis along the two others",
    )
    servos: tuple[Servo, ...] = quantity(
        (),
        "",
        "unstated",
        "a list of motors of joints, for files without actuators such as URDF",
        max_length=MAX_SERVOS,
    )
    joint: Elements = quantity(
        {},
        "",
        "derived",
        "of a joint by its name: stiffness, springref, damping, armature, frictionloss. Left out: "
        "as the file has it",
        validate_default=True,
    )
    geom: Elements = quantity(
        {},
        "",
        "derived",
        "of a geom by its name: size, and mass or density. Left out: as the file has it",
        validate_default=True,
    )
    actuator: Elements = quantity(
        {},
        "",
        "derived",
        "of an actuator by its name: kp and kv of servos, gear. Left out: as the file has it",
        validate_default=True,
    )

    @field_validator("file")
    @classmethod
    def _can_be_read(cls, file: str) -> str:
        try:
            _loaded(file, "")
        except AmbiguousRootError:
            pass  # which body it is, ``body`` may tell
        except (ValueError, OSError) as error:
            raise ValueError(in_words(error, file)) from None
        return file

    @field_validator("sha256")
    @classmethod
    def _is_that_file(cls, sha256: str | None, info: ValidationInfo) -> str | None:
        if "file" not in info.data:
            return sha256  # reported at the file's own key
        digest = _digest(info.data["file"])
        if sha256 not in (None, digest):
            raise ValueError(f"the file has changed: it has {digest}")
        return digest

    @field_validator("body")
    @classmethod
    def _is_a_body(cls, body: str, info: ValidationInfo) -> str:
        if "file" not in info.data:
            return body  # reported at the file's own key
        try:
            _loaded(info.data["file"], body)
        except (ValueError, OSError) as error:
            raise ValueError(in_words(error, info.data["file"])) from None
        return body

    @field_validator("keyframe")
    @classmethod
    def _is_saved(cls, keyframe: str, info: ValidationInfo) -> str:
        if keyframe and {"file", "body"} <= info.data.keys():
            names = _loaded(info.data["file"], info.data["body"]).keyframes
            if keyframe not in names:
                choices = f" (choose from: {listed(names)})" if names else ", and no other"
                raise ValueError(f"the file has no keyframe {keyframe!r}{choices}")
        return keyframe

    @field_validator("servos")
    @classmethod
    def _have_joints(cls, servos: tuple[Servo, ...], info: ValidationInfo) -> tuple[Servo, ...]:
        if {"file", "body"} <= info.data.keys():
            names = _loaded(info.data["file"], info.data["body"]).drivable
            try:
                by_pattern({servo.joints: servo for servo in servos}, names, "joints")
            except InputError as error:
                raise ValueError(str(error)) from None
        return servos

    @field_validator("joint", "geom", "actuator")
    @classmethod
    def _of_the_file(cls, changes: Elements, info: ValidationInfo) -> Elements:
        """Return the values of all elements, with those that were given."""
        if not {"file", "body"} <= info.data.keys() or info.field_name is None:
            return changes  # reported at the file's own key
        spec = _loaded(info.data["file"], info.data["body"]).spec
        try:
            return with_changes(values_of(spec, info.field_name), changes)
        except InputError as error:
            raise below(error) from None

    def plant(self, model: mujoco.MjModel, start: Start, *more: Any) -> Plant:
        """See ``Robot``."""
        from omnitrack_sim.robots.file_plant import FilePlant

        return FilePlant(model, self, start, *more)

    def __hash__(self) -> int:
        return hash(self._text)

    @cached_property
    def _text(self) -> str:
        return self.model_dump_json()

    def unit_at(self, path: str) -> str | None:
        """See ``Robot``."""
        kind, _, rest = path.partition(".")
        keys = rest.split(".")
        if kind not in KINDS or len(keys) < 2:
            return super().unit_at(path)
        spec = _loaded(self.file, self.body).spec
        # The last number of a size has the unit of the size.
        key = keys[-2] if keys[-1].isdecimal() else keys[-1]
        return unit_of(spec, kind, rest.partition(f".{key}")[0], key)

    def parameters(self) -> list[Parameter]:
        """See ``Robot``; each value of a servo, joint, geom or actuator has a row."""
        own = [
            (f"servos.{i}.{key}", value, "of motors that are added")
            for i, servo in enumerate(self.servos)
            for key, value in servo
            if value is not None
        ] + [
            (f"{kind}.{element}.{key}", value, "of the file")
            for kind in KINDS
            for element, values in getattr(self, kind).items()
            for key, value in values.items()
        ]
        rows = [row for row in super().parameters() if row.name not in (*KINDS, "servos")]
        return rows + [
            Parameter(
                name=name,
                value=value,
                unit=self.unit_at(name) or "",
                provenance="unstated",
                source=source,
            )
            for name, value, source in own
        ]

    def spec(self) -> mujoco.MjSpec:
        """See ``Robot``."""
        robot = _loaded(self.file, self.body)
        spec, wanted = robot.spec.copy(), {servo.joints: servo for servo in self.servos}
        for kind in KINDS:
            apply(spec, kind, getattr(self, kind))
        motors = by_pattern(wanted, robot.drivable, "robot.servos")
        for joint in robot.drivable:
            if joint in motors:
                motors[joint].add_to(spec, joint)
        if motors:
            # By Euler's own method a servo of a light wheel would blow up at a step of 2 ms.
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return spec

    def notes(self, bores: Iterable[float], timestep: float) -> Iterator[str]:
        """See ``Robot``; what was left out of the file or changed."""
        yield from super().notes(bores, timestep)
        changes = _loaded(self.file, self.body).changes
        if changes:
            yield f"{Path(self.file).name}: {'; '.join(changes)}"
        own = _loaded(self.file, self.body).spec.option.timestep
        if timestep > 1.5 * own:
            yield (
                f"{Path(self.file).name} is made for a time step of {own:.4g} s, and "
                f"physics.timestep is {timestep:.4g} s: a model may diverge that is stiffer"
            )

    @property
    def keyframes(self) -> tuple[str, ...]:
        """Names of the states that the file has saved."""
        return _loaded(self.file, self.body).keyframes

    @property
    def chassis(self) -> str:
        """See ``Robot``."""
        return self.body or _loaded(self.file, "").root

    @cached_property
    def _extent(self) -> tuple[float, float, float]:
        """Extent of the parts that touch, m, along and about the robot's axis.

        Tail and nose along the axis from the chassis' origin, and the largest distance from it.
        """
        data = initial_state(self)
        model = data.model
        touching = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T  # (8, 3)
        boxes = model.geom_aabb[touching]
        local = boxes[:, None, :3] + corners * boxes[:, None, 3:]
        frames = data.geom_xmat[touching].reshape(-1, 3, 3)
        points = np.einsum("gij,gkj->gki", frames, local) + data.geom_xpos[touching, None]
        body = model.body(self.chassis).id
        own = data.xmat[body].reshape(3, 3) @ turn_to(self.forward)
        x, y, z = ((points.reshape(-1, 3) - data.xpos[body]) @ own - self._aside).T
        return float(z.min()), float(z.max()), float(np.abs([x, y]).max())

    @property
    def _aside(self) -> Array:
        """Way (3,) m from the chassis' origin across to the robot's axis, robot frame."""
        return (self.centre @ turn_to(self.forward)) * [1.0, 1.0, 0.0]

    @property
    def frame(self) -> Pose:
        """See ``Robot``."""
        tail, nose, _ = self._extent
        turn = turn_to(self.forward)
        return Pose(turn, turn @ (self._aside + np.array([0.0, 0.0, (tail + nose) / 2])))

    @property
    def start_ctrl(self) -> Array:
        """See ``Robot``: those of the keyframe.

        Without one, servos of position are asked for where they are, others for nothing.
        """
        return np.array(self._saved[1] if self.keyframe else self._held_inputs)

    @property
    def start_qpos(self) -> Array | None:
        """See ``Robot``: those of the keyframe."""
        return np.array(self._saved[0]) if self.keyframe else None

    @cached_property
    def _saved(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Joint positions and inputs of the keyframe."""
        qpos, ctrl = keyframe(self.file, self.keyframe, compiled(self))
        return tuple(qpos.tolist()), tuple(ctrl.tolist())

    @cached_property
    def _held_inputs(self) -> tuple[float, ...]:
        data = initial_state(self)
        model = data.model
        mujoco.mj_forward(model, data)
        affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED
        gain, (constant, slope) = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, :2].T
        holds = affine & fixed & (gain != 0) & (slope != 0)
        force = constant + slope * data.actuator_length
        ctrl = np.where(holds, -force / np.where(gain == 0, 1.0, gain), 0.0)
        low, high = model.actuator_ctrlrange.T
        limited = model.actuator_ctrllimited.astype(bool)
        return tuple((np.where(limited, np.clip(ctrl, low, high), ctrl) + 0.0).tolist())

    @property
    def start_frame(self) -> Pose:
        """See ``Robot``."""
        data = initial_state(self)
        body = data.model.body(self.chassis).id
        return Pose(data.xmat[body].reshape(3, 3), data.xpos[body]) @ self.frame

    @property
    def length(self) -> float:
        """See ``Robot``."""
        tail, nose, _ = self._extent
        return nose - tail

    @property
    def nominal_bore(self) -> float:
        """See ``Robot``."""
        return 2 * self._extent[2] if self.bore is None else self.bore


def _digest(file: str) -> str:
    return hashlib.sha256(read_bytes(file, MAX_MODEL_TEXT)).hexdigest()


def _loaded(file: str, body: str) -> RobotModel:
    """Return the robot of a file, once for each of its versions.

    Raises:
        OSError: it cannot be read.
        ValueError: MuJoCo cannot make a model of it, or it is no robot in a pipe.
    """
    if not exists(Path(file)):
        raise ValueError("cannot be read: no such file")
    return _checked(file, body, _digest(file))


@lru_cache(maxsize=16)
def _checked(file: str, body: str, _version: str) -> RobotModel:
    robot = robot_model(file, body)
    check_robot(robot.spec.compile())
    return robot


def turn_to(forward: Axis) -> Array:
    """Rotation (3, 3) whose z is an axis of the chassis."""
    z = np.zeros(3)
    z["xyz".index(forward[-1])] = -1.0 if forward.startswith("-") else 1.0
    x = np.roll(np.abs(z), 1)
    return frame_of(x, z)
