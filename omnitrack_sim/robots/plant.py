"""The plant: n robots of one model in exact pipes, the only door to MuJoCo's state."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import (
    Array,
    Pose,
    cross,
    dot,
    frame_of,
    matrix_from_quaternion,
    quaternion_from_matrix,
    set_rows,
)
from omnitrack_sim.record.channels import COMMON, Channel
from omnitrack_sim.robots.control import Actuation
from omnitrack_sim.robots.model_sensors import model_sensors
from omnitrack_sim.robots.scene import PIPES
from omnitrack_sim.robots.sensor import Sensor, State

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot


MakeBatch = Callable[[mujoco.MjModel, int, int, bool], batch.Batch]
"""Makes a batch as ``mujoco.batch.Batch`` does."""


@dataclass(frozen=True)
class PlantSettings:
    """Seating of a robot in its pipe.

    Attributes:
        seating_time: s, for the robot's own pipe of 160 mm, for which springs and limbs settle
            while the chassis is held in its place.
        held_mass: inertia that holds the chassis meanwhile, masses of the robot.
        misfit: part of the bore by which a robot may be in the wall when it is seated: 5 mm of
            160 mm. What presses with the force of springs sinks in by 1 or 2 mm.
        rigid_misfit: the same of the chassis and what is fixed to it, which no spring presses.
    """

    seating_time: float = 0.3
    held_mass: float = 1e4
    misfit: float = 0.03
    rigid_misfit: float = 0.01


SETTINGS = PlantSettings()


@dataclass(frozen=True)
class Start:
    """Start of n robots of one batch, and what differs between them.

    Attributes:
        position, quaternion: (n, 3) m and (n, 4), pose of the chassis in the world.
        friction: (n,) Coulomb coefficient of the walls.
        gravity: (n, 3) m/s², world frame.
        bore_radius: (n,) m, of the pipe that each starts in.
        roll: (n,) rad, of modules that roll.
        robots: n, the parameters of each: ``Robot.own_values`` may differ.
    """

    position: Array
    quaternion: Array
    friction: Array
    gravity: Array
    bore_radius: Array
    roll: Array
    robots: Sequence[Robot]


class WallContact(NamedTuple):
    """A contact of a robot with a pipe.

    Attributes:
        depth: m, in the wall.
        body: that touches.
        is_rigid: the body is the chassis, or fixed to it.
    """

    depth: float
    body: str
    is_rigid: bool


NONE = WallContact(0.0, "", is_rigid=False)
"""What is taken where there is no contact."""


class Plant:
    """n copies of a model, each with its own start, friction and gravity.

    Args:
        model: pipes and robot; see ``scene``.
        robot: parameters.
        start: of the robots.
        period: s, between two control steps.
        threads: native threads; 0 uses all cores.
        sensors: of a user's own.
        make_batch: makes the engine's batch from model, number of robots, threads, and whether each
            robot needs an MjData of its own; steps of another class may be another engine's.

    Raises:
        InputError: the robot has no free chassis, or does not fit into its pipe.

    Attributes:
        n: number of robots.
        model, robot, period: as given.
        qpos: (n, nq) joint positions, the engine's own array.
        diverged: (n,) bool, robots whose physics has gone wrong.
        command: that the robots carry out at the start, with an array in every field.
    """

    command: Any

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: Robot,
        start: Start,
        period: float,
        threads: int = 1,
        sensors: Sequence[Sensor] = (),
        make_batch: MakeBatch = batch.Batch,
    ) -> None:
        self.model, self.robot, self.period = model, robot, period
        self.n = len(start.friction)
        # Where MuJoCo passes over what never moves, each robot needs an MjData.
        sleeps = bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._batch = make_batch(model, self.n, threads, sleeps)
        shipped = self.shipped_sensors()
        self._sensors = {sensor.channel.name: sensor for sensor in (*shipped, *sensors)}
        self._own = [sensor.channel.name for sensor in sensors]
        self._looks_back = [sensor.channel.name for sensor in shipped if sensor.looks_back]
        self._last: State | dict[str, Array] = {}
        self.diverged = np.zeros(self.n, bool)
        self.qpos, self._ctrl = self._batch.bind("qpos"), self._batch.bind("ctrl")
        self._arrays = {name: self._batch.bind(name) for name in self.array_names}
        for name in ("xpos", "xmat", "site_xpos"):
            if name in self._arrays:
                self._arrays[name] = self._arrays[name].reshape(self.n, -1)
        self._bind()
        self._own_fields: set[str] = set()
        self._warnings = self._count_warnings()
        self.reset(np.arange(self.n), start)

    array_names = (
        *("time", "qpos", "qvel", "sensordata", "actuator_force", "actuator_velocity", "ctrl"),
        *("xpos", "xmat", "site_xpos"),
    )
    """Arrays of the engine that sensors read."""

    def reset(self, rows: NDArray[np.intp], start: Start) -> None:
        """Put robots ``rows`` (k,) to new starts (k rows); the others stay as they are."""
        self._batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        if self.robot.start_qpos is not None:
            self.qpos[rows] = self.robot.start_qpos
        set_rows(self, rows, diverged=False)
        self._set_start(rows, start)
        self._warnings[rows] = self._count_warnings()[rows]
        self._settle(rows, start)
        self._warnings[rows] = self._count_warnings()[rows]

    def read(self) -> State:
        """Values of all sensors at this moment, (n, ...) by the names of their channels.

        Forces and velocities are those of the last physics step.
        """
        # The engine writes into its arrays again; a state stays what it was.
        arrays = {name: array.copy() for name, array in self._arrays.items()}
        self._last = State(
            arrays, self._at, self.robot, self._sensors, self._last, self._looks_back
        )
        # A user's own sensor may add up what it sees, so it is read at every step.
        for name in self._own:
            self._last[name]
        return self._last

    def data(self, robot: int) -> mujoco.MjData:
        """Return a copy of MuJoCo's data of one robot as it is now."""
        return self._batch.get_data(robot)

    def step(self, active: NDArray[np.bool_], command: Any, substeps: int) -> None:
        """Advance the ``active`` robots by ``substeps`` physics steps.

        Args:
            active: (n,) bool.
            command: that they carry out, with an array in every field that stands until it changes.
            substeps: physics steps.
        """
        self._ctrl[:] = command.ctrl
        self._advance(active, substeps)

    def pull(self, force: Array) -> None:
        """Have forces (n, 3) N, world frame, act at the robots' tails until the next call."""
        body, lever = self._tail
        axes = self._arrays["xmat"][:, 9 * body : 9 * body + 9].reshape(-1, 3, 3)
        applied = self._batch.bind("xfrc_applied").reshape(self.n, -1, 6)
        applied[:, body, :3] = force
        applied[:, body, 3:] = cross(_turned(axes, lever), force)

    @cached_property
    def _tail(self) -> tuple[int, Array]:
        """Body that carries the tail, and the lever of forces there.

        The lever (3,) m is about the body's centre of mass, in its frame.
        """
        model, robot = self.model, self.robot
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, robot.tail)
        if site >= 0:
            body, place = int(model.site_bodyid[site]), model.site_pos[site]
        else:
            body, own = model.body(robot.chassis).id, robot.frame
            place = own.position - own.rotation[:, 2] * robot.length / 2
        return body, place - model.body_ipos[body]

    def to_controller(
        self, readings: Mapping[str, Array], gear: NDArray[np.int_], channels: Iterable[Channel]
    ) -> Mapping[str, Array]:
        """Return the readings of robots as their controllers receive them.

        Args:
            readings: (n, ...) by the names of the channels.
            gear: (n,) 1 nose first, -1 tail first.
            channels: schema of the readings.
        """
        return readings

    def from_controller(self, command: Any, gear: NDArray[np.int_]) -> Any:
        """Return the command that robots carry out for one that their controllers give.

        Controllers take the robot as ``to_controller`` shows it.
        """
        return command

    def commanded(self, command: Any) -> Mapping[str, Array]:
        """Values (n, ...) of the recorded channels that say what the robots were asked."""
        return {"ctrl": command.ctrl}

    # What robots differ in

    def shipped_sensors(self) -> Sequence[Sensor]:
        """Sensors of the channels that every robot of this kind has."""
        return (*_POSE_SENSORS, *model_sensors(self.model))

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Motors at their limit (n, m)."""
        return np.zeros((self.n, 0), bool)

    @property
    def effort_limit(self) -> Array:
        """Largest force or torque of each motor, (m,) or (n, m), infinite where it has no limit."""
        limited = self.model.actuator_forcelimited.astype(bool)
        return np.where(limited, np.abs(self.model.actuator_forcerange).max(axis=1), np.inf)

    def effort(self, readings: Mapping[str, Array]) -> Array:
        """Return the force or torque (n, m) of each motor."""
        return readings["actuator_force"]

    def touches(self, readings: Mapping[str, Array]) -> NDArray[np.bool_]:
        """Return the robots (n,) of which anything touches a wall."""
        return np.count_nonzero(readings["wall_force"], axis=1) > 0

    def slip_speed(self, readings: Mapping[str, Array]) -> Array:
        """Return the speed (n,) m/s over the wall of what touches it, mean of the bodies."""
        touches = readings["wall_force"] > 0
        count = np.maximum(touches.sum(axis=1), 1)
        return (readings["contact_speed"] * touches).sum(axis=1) / count

    def _bind(self) -> None:
        """Look up addresses, and ask the engine for what differs between the robots."""
        self._at = _Root.of(self.model, self.robot)
        fixed = np.flatnonzero(self.model.geom_bodyid == 0).tolist()
        self._walls = np.array([i for i in fixed if self.model.geom(i).name.startswith(PIPES)])
        self._friction = self._batch.expand("geom_friction")
        self._gravity = self._batch.expand("opt.gravity")
        self._armature = self._batch.expand("dof_armature")
        ctrl = self.robot.start_ctrl
        inputs = np.zeros(self.model.nu) if ctrl is None else ctrl
        self.command = Actuation(
            ctrl=np.tile(inputs, (self.n, 1)),
            phase=np.zeros(self.n, int),
            resting=np.zeros(self.n, bool),
            over=np.zeros(self.n, bool),
        )

    def _set_start(self, rows: NDArray[np.intp], start: Start) -> None:
        """Set what differs between robots, and how they begin."""
        self._friction[rows[:, None], self._walls, 0] = start.friction[:, None]
        self._ctrl[rows] = self.command.ctrl[rows]

    def _set_fields(
        self, rows: NDArray[np.intp], names: Iterable[str], models: Sequence[mujoco.MjModel]
    ) -> None:
        """Give robots ``rows`` (k,) fields of their own ``models`` (k), which are without pipes.

        Pipes have neither bodies, joints nor actuators: the robot alone has them in the same order.
        """
        for name in names:
            own = np.stack([getattr(model, name) for model in models])
            if name in self._own_fields or (own != getattr(self.model, name)).any():
                self._own_fields.add(name)
                self._batch.expand(name)[rows] = own.reshape(len(rows), *own.shape[1:])

    def _settle(self, rows: NDArray[np.intp], start: Start) -> None:
        """Have robots ``rows`` come to rest between springs and wall, without gravity."""
        self._gravity[rows] = 0.0
        place = self._at.placed(start.position, start.quaternion)
        qvel, armature = self._batch.bind("qvel"), self._armature
        held = rows[:, None], self._at.qvel
        own = armature[held].copy()
        # The solver has to know that the chassis is held: with its speed set to zero afterwards
        # alone, limbs that push it against the wall would gain energy at every step.
        armature[held] = own + SETTINGS.held_mass * self.robot.mass
        at, size = self._at.qpos, self.robot.time_scale
        steps = math.ceil(SETTINGS.seating_time * size / self.model.opt.timestep)
        chosen = np.zeros(self.n, bool)
        chosen[rows] = True
        for _ in range(steps):
            # The chassis is held: what hangs on it comes to rest between springs and wall.
            self.qpos[rows[:, None], at] = place
            qvel[rows[:, None], self._at.qvel] = 0.0
            self._batch.step(chosen)
        self.qpos[rows[:, None], at] = place
        qvel[rows] = 0.0
        armature[held] = own
        self._yield(self._misfits(rows, start), steps)
        self._gravity[rows] = start.gravity
        self._batch.bind("time")[rows] = 0.0
        self._batch.forward(rows)
        self._find_diverged()
        self._check_fit(rows, start)

    def _misfits(self, rows: NDArray[np.intp], start: Start) -> NDArray[np.intp]:
        """Return those of ``rows`` that are in the wall by more than a rigid body may be."""
        limit = SETTINGS.rigid_misfit * 2 * start.bore_radius
        depths = [max(self._wall_contacts(row), default=NONE).depth for row in rows.tolist()]
        return rows[np.array(depths) > limit]

    def _yield(self, rows: NDArray[np.intp], steps: int) -> None:
        """Have the wall push robots out of it, chassis and all, as slowly as they come to rest."""
        if not len(rows):
            return
        chosen = np.zeros(self.n, bool)
        chosen[rows] = True
        qvel = self._batch.bind("qvel")
        for _ in range(steps):
            self._batch.step(chosen)
            qvel[rows] = 0.0

    def _check_fit(self, rows: NDArray[np.intp], start: Start) -> None:
        """Refuse robots that are in the wall where they have settled."""
        for row, radius in zip(rows.tolist(), start.bore_radius.tolist(), strict=True):
            if self.diverged[row]:
                continue  # its run ends with that
            contacts = self._wall_contacts(row)
            rigid = max((each for each in contacts if each.is_rigid), default=NONE)
            deepest = max(contacts, default=NONE)
            limits = (rigid, SETTINGS.rigid_misfit), (deepest, SETTINGS.misfit)
            for contact, limit in limits:
                if contact.depth > limit * 2 * radius:
                    problem = (
                        f"does not fit: body {contact.body!r} is {1000 * contact.depth:.1f} mm "
                        f"deep in the wall of a bore of {2000 * radius:.4g} mm once it has settled "
                        f"with its axis on the pipe's; {self._way_to_fit(2 * radius, contact)}"
                    )
                    raise InputError(Fault("robot", problem))

    def _way_to_fit(self, bore: float, contact: WallContact) -> str:
        """Return the bore, and the size of the robot, with which a robot would fit, in words."""
        made_for = self.robot.nominal_bore
        wanted = made_for if made_for > bore else bore + 2 * contact.depth
        part = math.floor(1000 * bore / wanted) / 1000
        return f"it would in one of {1000 * wanted:.4g} mm, or at {part:.3g} of its size"

    def _wall_contacts(self, robot: int) -> list[WallContact]:
        """Contacts of a robot with the pipes as it is now; the batch keeps none."""
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[:] = self.qpos[robot]
        mujoco.mj_fwdPosition(model, data)
        walls, chassis = set(self._walls.tolist()), model.body(self.robot.chassis).id
        contacts = []
        for i in range(data.ncon):
            others = [g for g in data.contact[i].geom.tolist() if g not in walls]
            # Limbs may touch each other as they like.
            if len(others) == 1:
                body = int(model.geom_bodyid[others[0]])
                fixed = bool(model.body_weldid[body] == model.body_weldid[chassis])
                depth = -float(data.contact[i].dist)
                contacts.append(WallContact(depth, model.body(body).name, fixed))
        return contacts

    def _advance(self, active: NDArray[np.bool_], substeps: int) -> None:
        """Advance the ``active`` robots (n,), and find those whose physics goes wrong."""
        try:
            self._batch.step(active, nstep=substeps)
        except batch.SimulationError as error:
            self.diverged[error.ids] = True
        self._find_diverged()

    def _find_diverged(self) -> None:
        """Find the robots whose physics has gone wrong since the warnings were counted last."""
        warnings = self._count_warnings()
        # A sum is finite where all its terms are, unless they are beyond all reason.
        if warnings.tobytes() != self._warnings.tobytes() or not math.isfinite(self.qpos.sum()):
            broken = ~np.isfinite(self.qpos).all(axis=-1)
            self.diverged = self.diverged | (warnings > self._warnings) | broken

    def _count_warnings(self) -> NDArray[np.int64]:
        """MuJoCo warnings of each robot so far, (n,)."""
        last_info_and_number = self._batch.warning  # (n, kinds, 2)
        return last_info_and_number[:, :, 1].sum(axis=-1)


@dataclass(frozen=True)
class _Root:
    """Addresses of a robot's chassis and of the free joint that carries it.

    Attributes:
        qpos, qvel: (7,) and (6,), of the free joint.
        chassis: (3,) in ``xpos``. axes: (9,) in ``xmat``.
        own: the robot's frame in that of the chassis.
        ends: (6,) in ``site_xpos``, of nose and tail; empty where the z axis is the chassis' own.
        start: of the free body in the robot's frame, in the model's initial state.
    """

    qpos: NDArray[np.intp]
    qvel: NDArray[np.intp]
    chassis: NDArray[np.intp]
    axes: NDArray[np.intp]
    own: Pose
    ends: NDArray[np.intp]
    start: Pose

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot) -> _Root:
        """Find a robot's chassis.

        Raises:
            InputError: there is no such body, or it cannot move freely.
        """
        chassis = robot.chassis
        names = tuple(model.body(i).name for i in range(1, model.nbody) if model.body(i).name)
        if chassis not in names:
            problem = f"there is no body {chassis!r} in the robot's model"
            raise InputError(Fault("robot.chassis", problem, names, given=chassis))
        body = model.body(chassis).id
        root = model.body_rootid[body]
        joint = model.body_jntadr[root]
        if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            problem = f"{chassis!r} hangs on {model.body(root).name!r}, which has no free joint"
            raise InputError(Fault("robot.chassis", problem))
        qpos = model.jnt_qposadr[joint] + np.arange(7)
        place = model.qpos0[qpos]
        root_pose = Pose(matrix_from_quaternion(place[3:]), place[:3])
        ends = [model.site(name).id for name in robot.ends or ()]
        return cls(
            qpos=qpos,
            qvel=model.jnt_dofadr[joint] + np.arange(6),
            chassis=3 * body + np.arange(3),
            axes=9 * body + np.arange(9),
            own=robot.frame,
            ends=np.array([3 * site + axis for site in ends for axis in range(3)], np.intp),
            start=robot.start_frame.inverse() @ root_pose,
        )

    def placed(self, position: Array, quaternion: Array) -> Array:
        """Return the free joint's positions (n, 7) for poses of the robot."""
        rotation = matrix_from_quaternion(quaternion)
        origin = position + _turned(rotation, self.start.position)
        turned = np.stack([_turned(rotation, c) for c in self.start.rotation.T], axis=-1)
        return np.concatenate([origin, quaternion_from_matrix(turned)], axis=1)


def _axes(state: State) -> Array:
    """Rotation (n, 3, 3) of the chassis."""
    return state.xmat.take(state.at.axes, axis=1).reshape(-1, 3, 3)


def _turned(rotation: Array, vector: Array) -> Array:
    """Vectors (n, 3) that ``rotation`` (n, 3, 3) makes of one (3,), in one order of sums."""
    x, y, z = vector
    return x * rotation[..., 0] + y * rotation[..., 1] + z * rotation[..., 2]


def _position(state: State) -> Array:
    place = state.xpos.take(state.at.chassis, axis=1)
    return place + _turned(_axes(state), state.at.own.position)


def _rotation(state: State) -> Array:
    axes = _axes(state)
    own = np.stack([_turned(axes, column) for column in state.at.own.rotation.T], axis=-1)
    if not len(state.at.ends):
        return own
    # The chassis may roll about the way, or wind round it: nose and tail give the axis.
    ends = state.site_xpos.take(state.at.ends, axis=1)
    z = ends[:, :3] - ends[:, 3:]
    z /= np.sqrt(dot(z, z))[:, None]
    x = own[..., 0] - dot(own[..., 0], z)[:, None] * z
    x /= np.sqrt(dot(x, x))[:, None]
    return frame_of(x, z)


def _spin(state: State) -> Array:
    """Rotation rate (n, 3) rad/s of the free body, in the robot's axes at the start."""
    spin = state.qvel.take(state.at.qvel[3:], axis=1)
    return np.stack([dot(spin, row) for row in state.at.start.rotation], axis=1)


_READ = {
    "time": lambda state: state.time,
    "position": _position,
    "quaternion": lambda state: quaternion_from_matrix(state["rotation"]),
    "rotation": _rotation,
    "angular_velocity": _spin,
}
_POSE_SENSORS = tuple(
    Sensor(channel, _READ[name]) for name, channel in COMMON.items() if channel.source == "plant"
)
