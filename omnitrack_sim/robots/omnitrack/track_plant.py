"""Plant of the omnidirectional robot: its model in pipes, motors, endless chains, springs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, with_rows
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.omnitrack import MODULES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import (
    LINE_IMPEDANCE,
    LUG_CONAFFINITY,
    LUG_CONTYPE,
    MODULE_ENDS,
    add_robot,
    friction_tendons,
    impedance,
    spring_free_length,
)
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.robots.omnitrack.control.command import Command, mirror_command, mirror_readings
from omnitrack_sim.robots.omnitrack.drive import Drive, SpeedLoop, drive_of
from omnitrack_sim.robots.omnitrack.parameters import MASSES
from omnitrack_sim.robots.omnitrack.sensors import SENSORS, Addresses
from omnitrack_sim.robots.plant import MakeBatch, Plant, Start
from omnitrack_sim.robots.robot import SceneOptions
from omnitrack_sim.robots.scene import compiled
from omnitrack_sim.robots.sensor import Sensor, State
from omnitrack_sim.walls.geoms import add_exact_walls, add_plates, add_walls, new_spec
from omnitrack_sim.walls.guard import add_guard

SLEEP_FROM = 1000
"""Number of geoms from which it pays to have MuJoCo pass over the walls, which needs an MjData for
each robot: a step no longer costs 9 ns for each wall piece, and states do not change."""
NUMBERS = (1, 2, 3)
BOTH_TRACKS_COSINE = 0.5
"""Size of cos(roll) below which both rows of lugs of a module can touch; beyond, the one away
from the wall is left out."""
SEATING_ROOM = 0.1
"""Largest movement of an arm before the first step, in radii of a lug."""
SEATING_HALVINGS = 20
"""Halvings of that room: a lug of 28 mm is placed to 5 nm. Much finer, rounding would decide, and
robots of different sizes would not start alike."""


INERTIA_FIELDS = (
    *("body_mass", "body_inertia", "body_subtreemass", "body_invweight0"),
    *("dof_armature", "dof_M0", "dof_invweight0", "tendon_invweight0"),
    *("actuator_acc0", "actuator_gainprm", "actuator_biasprm"),
)
"""Fields of the model that follow from masses, rotors and servos of a robot."""


def inertia_of(robot: Omnitrack) -> tuple[float, ...]:
    """Return the values that robots of one batch may differ in and that enter the model's inertia.

    Robots in whom they are the same have the same ``INERTIA_FIELDS``.
    """
    motor = robot.motor
    masses = (getattr(robot, name) for name in MASSES)
    return (*masses, motor.rotor_inertia, motor.gear_ratio, motor.speed_bandwidth)


def robot_alone(robot: Omnitrack) -> mujoco.MjSpec:
    """Return the robot at the world's origin, ready to compile; see ``Robot.spec``."""
    spec = new_spec("omnitrack")
    add_robot(spec, robot)
    return spec


def scene(robot: Omnitrack, network: Assembly, options: SceneOptions) -> mujoco.MjSpec:
    """Return the robot at the world's origin and the walls of a network, ready to compile.

    See ``Robot.scene``.
    """
    spec = new_spec("omnitrack_scene")
    spec.option.timestep = options.timestep
    if options.exact:
        # On what has a friction of its own lugs are as stiff as elsewhere.
        stiffness = impedance(*LINE_IMPEDANCE, robot.contact_depth)
        deposits = {"solref": [robot.contact_time, 1.0], "solimp": stiffness}
        add_exact_walls(spec, network, deposits=deposits)
        add_guard(spec, f"wall_{network.parts[0].name}")
    else:
        add_walls(spec, network, tolerance=options.wall_tolerance, staves=options.staves)
    add_plates(spec, network, options.plates, options.looks)
    # The compiled collider takes a row of lugs as one line; walls of primitives need each lug.
    add_robot(spec, robot, line_tracks=options.exact)
    if options.looks:
        from omnitrack_sim.robots.omnitrack.looks import add_robot_looks
        from omnitrack_sim.walls.pipe_looks import add_cameras, add_pipe_looks

        add_robot_looks(spec, robot)
        add_pipe_looks(spec, network)
        add_cameras(spec, network, spec.body("chassis"), robot.scale)
    # MuJoCo does not let a model sleep in which tendons are tied, as those of shared motors are.
    if len(spec.geoms) >= SLEEP_FROM and drive_of(robot.drive).direct:
        spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        spec.body("chassis").sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER  # only walls sleep
    return spec


class TrackPlant(Plant):
    """n robots of one model; see ``Plant``.

    Attributes:
        motors: between the commands and the belts.
    """

    array_names = ("time", "qpos", "qvel", "sensordata", "actuator_force", "xpos", "xmat")

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: Omnitrack,
        start: Start,
        period: float,
        threads: int = 1,
        sensors: Sequence[Sensor] = (),
        make_batch: MakeBatch = batch.Batch,
    ) -> None:
        self._drive = drive_of(robot.drive)
        own: Sequence[Omnitrack] = start.robots  # type: ignore[assignment]
        self.motors = SpeedLoop(self._drive, [each.motor for each in own], robot.lug_radius)
        self._body = robot
        super().__init__(model, robot, start, period, threads, sensors, make_batch)

    def shipped_sensors(self) -> Sequence[Sensor]:
        """See ``Plant``."""
        return SENSORS

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Modules (n, 3) with a motor at its torque limit."""
        return self.motors.saturated

    @property
    def effort_limit(self) -> Array:
        """See ``Plant``; of the belts' motors."""
        return self.motors.torque_limit

    def effort(self, readings: Mapping[str, Array]) -> Array:
        """See ``Plant``; of the belts' motors."""
        return readings["motor_torque"]

    def touches(self, readings: Mapping[str, Array]) -> NDArray[np.bool_]:
        """See ``Plant``."""
        return np.count_nonzero(readings["normal_force"], axis=1) > 0

    def slip_speed(self, readings: Mapping[str, Array]) -> Array:
        """See ``Plant``; mean of the modules."""
        return np.abs(readings["slip_velocity"]).mean(axis=1)

    def _bind(self) -> None:
        self._at = _addresses(self.model, self._drive)
        b, model, at = self._batch, self.model, self._at
        self._pitch_of_lugs = self._body.lug_pitch
        self._force_range = b.expand("actuator_forcerange")
        self._geom_contype, self._body_contype = b.expand("geom_contype"), b.expand("body_contype")
        self._body_conaffinity = b.expand("body_conaffinity")
        self._geom_conaffinity = b.expand("geom_conaffinity")
        # (3, 2, K) geoms of each track that collide: its lugs, or the one line in their place
        colliding = np.flatnonzero(model.geom_contype)
        bodies = model.geom_bodyid[colliding]
        self._lugs = np.array([[colliding[bodies == body] for body in pair] for pair in at.tracks])
        self._belts = at.belts
        self._at_wall = np.ones((self.n, 3, 2), bool)
        self._gears: list[tuple[int, int]] = []
        if not self._drive.direct:
            shafts = [f"shaft_{k + 1}" for k in range(self._drive.motors)]
            self._shafts = [model.joint(name).qposadr[0] for name in shafts]
        if self._body.gear_friction > 0:
            self._gears = [(i, model.tendon(n).id) for i, n in friction_tendons(self._drive)]
            self._gear_loss = b.expand("tendon_frictionloss")
        if self._body.brake_force > 0:
            self._belt_loss = b.expand("dof_frictionloss")
        self._belt_motors, self._roll_motors = _slice(at.belt_motors), _slice(at.roll_motors)
        self._last = {"contact_position": np.zeros((self.n, 3, 3))}
        three = np.zeros((self.n, 3))
        self.command = Command(
            belt_speed=three,
            roll=three,
            phase=np.zeros(self.n, int),
            resting=np.zeros(self.n, bool),
            brake=three,
            over=np.zeros(self.n, bool),
        )

    def _set_start(self, rows: NDArray[np.intp], start: Start) -> None:
        """See ``Plant``."""
        b, model, at = self._batch, self.model, self._at
        own: Sequence[Omnitrack] = start.robots  # type: ignore[assignment]
        self._set_inertia(rows, own)
        self._force_range[rows] = model.actuator_forcerange
        if self._gears:
            self._gear_loss[rows] = model.tendon_frictionloss
        if self._body.brake_force > 0:
            self._belt_loss[rows] = model.dof_frictionloss
        springs = [model.tendon(f"spring_{e}_{i}").id for e in MODULE_ENDS for i in NUMBERS]
        each = rows[:, None]
        touching = np.flatnonzero(model.geom_contype == LUG_CONTYPE)
        b.expand("geom_friction")[each, touching, 0] = start.friction[:, None]
        b.expand("opt.gravity")[rows] = start.gravity
        spring_free = np.array([spring_free_length(r, r.preload) for r in own])
        b.expand("tendon_lengthspring")[each, springs, 0] = spring_free[:, None]
        roll_torque = np.array([r.roll_torque for r in own])
        torque = roll_torque[:, None, None] * np.array([-1.0, 1.0])
        self._force_range[each, at.roll_motors] = torque
        self.qpos[rows, :3], self.qpos[rows, 3:7] = start.position, start.quaternion
        slide = start.bore_radius - np.array([r.nominal_pipe_radius for r in own])
        roll = np.repeat(start.roll[:, None], MODULES, axis=1)
        self.qpos[each, at.slide], self.qpos[each, at.roll] = slide[:, None], roll
        # The servos' set points are where the modules stand: nothing rolls at the start.
        self._ctrl[each, at.roll_motors] = roll
        self.command = self.command._replace(roll=with_rows(self.command.roll, rows, roll))

    def _set_inertia(self, rows: NDArray[np.intp], robots: Sequence[Omnitrack]) -> None:
        """Give robots ``rows`` (k,) the masses, rotors and servos of their own ``robots`` (k)."""
        keys = [inertia_of(robot) for robot in robots]
        if not self._own_fields and set(keys) == {inertia_of(self._body)}:
            return  # all are as the model is
        models = {
            key: compiled(robot) for key, robot in dict(zip(keys, robots, strict=True)).items()
        }
        self._set_fields(rows, INERTIA_FIELDS, [models[key] for key in keys])

    def read(self) -> State:
        """See ``Plant``; the motors' figures are among the arrays."""
        self._arrays["motor_figures"] = self.motors.figures
        return super().read()

    def _settle(self, rows: NDArray[np.intp], start: Start) -> None:
        """See ``Plant``: the arms come to rest without a step of the physics."""
        own: Sequence[Omnitrack] = start.robots  # type: ignore[assignment]
        self.motors.reset(rows, [each.motor for each in own])
        places = with_rows(self._last["contact_position"], rows, start.position[:, None])
        self._last = {"contact_position": places}
        self._leave_out_far_tracks()
        self._seat_arms(rows)

    def _seat_arms(self, robots: NDArray[np.intp]) -> None:
        """Move each arm of ``robots`` (k,) to where its springs and the wall are in equilibrium.

        The place is found by bisection. Nothing holds the springs of an arm whose lugs do not touch
        the wall or only just do: they would throw it into the wall in the first step, the further
        the higher the preload.
        """
        acceleration = self._batch.bind("qacc")
        slides, dofs = (robots[:, None], self._at.slide), (robots[:, None], self._at.slide_dofs)
        room = SEATING_ROOM * self._body.lug_radius
        low = self.qpos[slides] - room
        high = low + 2 * room
        for _ in range(SEATING_HALVINGS):
            self.qpos[slides] = middle = (low + high) / 2
            self._batch.forward(robots)
            # Pushed outward, the springs prevail, and the equilibrium lies farther out.
            outward = acceleration[dofs] > 0
            low, high = np.where(outward, middle, low), np.where(outward, high, middle)
        self.qpos[slides] = high  # on the side where the wall carries
        self._batch.forward(robots)

    def step(self, active: NDArray[np.bool_], command: Command, substeps: int) -> None:
        """See ``Plant``; the motors hold the belts' speeds and the modules' roll."""
        belts, torque = self._last["belt_speed"], self._last["motor_torque"]
        motors = self.motors.advance(command.belt_speed, belts, torque, self.period)
        self._set_friction(command.brake)
        set_point, lowest, highest = motors
        self._ctrl[:, self._belt_motors], self._ctrl[:, self._roll_motors] = set_point, command.roll
        self._force_range[:, self._belt_motors, 0] = lowest
        self._force_range[:, self._belt_motors, 1] = highest
        # Chains are endless: a row of lugs that has moved on by a pitch is the same row, moved
        # back. Both runs of a chain go together, as the tie between them would pull them level.
        travel = self.qpos.take(self._belts, axis=1)
        if np.abs(travel).max() > self._pitch_of_lugs / 2:
            pitches = np.rint(travel[..., :1] / self._pitch_of_lugs) * active[:, None, None]
            back = self._pitch_of_lugs * pitches
            self.qpos[:, self._belts] = travel - back
            if not self._drive.direct:
                # Shafts are tied to their belts and have to be moved back with them.
                self.qpos[:, self._shafts] -= self._drive.motor_values(back[..., 0])
            self.qpos[:, self._at.sprockets] -= back / self._body.lug_radius
        self._leave_out_far_tracks()
        self._advance(active, substeps)

    def to_controller(
        self, readings: Mapping[str, Array], gear: NDArray[np.int_], channels: Iterable[Channel]
    ) -> Mapping[str, Array]:
        """See ``Plant``: nose and tail are alike, so a robot in reverse sees itself mirrored."""
        return mirror_readings(readings, gear, channels)

    def from_controller(self, command: Command, gear: NDArray[np.int_]) -> Command:
        """See ``Plant``."""
        if command.brake is not None and not self._body.brake_force and np.any(command.brake):
            raise ValueError("command.brake is given to a robot whose robot.brake_force is 0")
        return mirror_command(command, gear)

    def commanded(self, command: Command) -> Mapping[str, Array]:
        """See ``Plant``."""
        roll: Any = command.roll
        return {"belt_speed_command": command.belt_speed, "roll_command": roll}

    def _set_friction(self, brake: Array | None) -> None:
        """Set the friction of the gears and of the brakes for the next steps."""
        if self._gears:
            # What a motor passes on to each of its outputs, N.
            forces = self._arrays["actuator_force"].take(self._at.belt_motors, axis=1)
            passed = np.abs(self._drive.belt_values(forces))
            for belt, tendon in self._gears:
                self._gear_loss[:, tendon] = self._body.gear_friction * passed[:, belt]
        if self._body.brake_force > 0:
            part = 0.0 if brake is None else np.minimum(np.maximum(brake, 0.0), 1.0)
            force = self._body.brake_force * part
            self._belt_loss[:, self._at.belt_dofs[:, 0]] = force

    def _leave_out_far_tracks(self) -> None:
        """Switch off the contacts of rows of lugs that face away from the wall.

        They are half of the collision work. For tracks that are lines the collider decides by the
        wall's normal.
        """
        if self._lugs.shape[-1] == 1:
            return
        cosine = np.cos(self.qpos.take(self._at.roll, axis=1))
        at_wall = np.empty((self.n, 3, 2), bool)
        np.greater(cosine, -BOTH_TRACKS_COSINE, out=at_wall[..., 0])
        np.less(cosine, BOTH_TRACKS_COSINE, out=at_wall[..., 1])
        # Modules roll rarely: in most steps there is nothing to write.
        if at_wall.tobytes() == self._at_wall.tobytes():
            return
        self._at_wall = at_wall
        tracks = self._at.tracks
        self._geom_contype[:, self._lugs] = at_wall[..., None] * LUG_CONTYPE
        self._body_contype[:, tracks] = at_wall * LUG_CONTYPE
        self._body_conaffinity[:, tracks] = at_wall * LUG_CONAFFINITY
        # A geom touches where either mask fits, so both have to go.
        self._geom_conaffinity[:, self._lugs] = at_wall[..., None] * LUG_CONAFFINITY


def _slice(indices: NDArray[np.intp]) -> slice:
    """Equally spaced addresses as a slice, through which NumPy writes faster."""
    step = int(indices[1] - indices[0]) if len(indices) > 1 else 1
    addresses = slice(int(indices[0]), int(indices[-1]) + 1, step)
    assert np.array_equal(np.arange(addresses.stop)[addresses], indices)
    return addresses


def _addresses(model: mujoco.MjModel, drive: Drive) -> Addresses:
    """Names to addresses, once."""

    def joints(*kinds: str) -> NDArray[np.intp]:
        return np.array([[model.joint(f"{k}_{i}").qposadr[0] for k in kinds] for i in NUMBERS])

    def dofs(*kinds: str) -> NDArray[np.intp]:
        return np.array([[model.joint(f"{k}_{i}").dofadr[0] for k in kinds] for i in NUMBERS])

    belts = [f"belt_{track}" for track in TRACKS]
    # Sprockets touch exact walls alone.
    exact = model.body("sprocket_front_1").geomnum[0] > 0
    parts = (*TRACKS, *MODULE_ENDS) if exact else TRACKS

    def of_chain(kind: str) -> NDArray[np.intp]:
        return np.array([[model.sensor(f"{kind}_{p}_{i}").adr[0] for p in parts] for i in NUMBERS])

    chassis = model.body("chassis").id
    modules = np.array([[model.body(f"module_{i}").id] for i in NUMBERS])
    actuators = [model.actuator(i) for i in range(model.nu)]
    return Addresses(
        slide=joints("slide")[:, 0],
        pitch=joints("pitch")[:, 0],
        roll=joints("roll")[:, 0],
        belts=joints(*belts),
        slide_dofs=dofs("slide")[:, 0],
        pitch_dofs=dofs("pitch")[:, 0],
        belt_dofs=dofs(*belts),
        places=3 * modules + np.arange(3),
        forward=9 * modules + np.arange(2, 9, 3),
        chassis=3 * chassis + np.arange(3),
        frame=9 * chassis + np.arange(9).reshape(3, 3).T,
        sprockets=joints(*(f"sprocket_{end}" for end in MODULE_ENDS)),
        tracks=np.array([[model.body(f"track_{t}_{i}").id for t in TRACKS] for i in NUMBERS]),
        contact=of_chain("contact")[:, :, None] + np.arange(7),
        touch=of_chain("touch"),
        belt_motors=np.array([a.id for a in actuators if a.name.startswith("belt_")]),
        roll_motors=np.array([model.actuator(f"roll_{i}").id for i in NUMBERS]),
        drive=drive,
    )
