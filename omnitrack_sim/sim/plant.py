"""The plant: n robots in one batch. The only door to MuJoCo's state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, set_rows, with_rows
from omnitrack_sim.record.channels import CHANNELS, TRACKS
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.body import (
    LUG_CONAFFINITY,
    LUG_CONTYPE,
    MODULE_ENDS,
    friction_tendons,
    lug_pitch,
)
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.senses import SENSORS, Sensor, State
from omnitrack_sim.senses.sensor import Addresses

NUMBERS = (1, 2, 3)
BOTH_TRACKS_COSINE = 0.5
"""Size of cos(roll) below which both rows of lugs of a module can touch; beyond, the one away
from the wall is left out."""
SEATING_ROOM = 0.1
"""Largest movement of an arm before the first step, in radii of a lug."""
SEATING_HALVINGS = 20
"""Halvings of that room: a lug of 28 mm is placed to 5 nm. Much finer, rounding would decide, and
robots of different sizes would not start alike."""


@dataclass(frozen=True)
class Start:
    """Start values and physical constants that differ between the n robots of one batch.

    Attributes:
        position, quaternion: (n, 3) m and (n, 4), start pose of the robot in the world.
        slide, roll: (n, 3) m and rad, start values of the joints.
        friction: (n,) Coulomb coefficient of the lugs on the wall.
        gravity: (n, 3) m/s², world frame.
        spring_free: (n,) m, arm travel at which the springs are free.
        roll_torque: (n,) N m, limit of the rotary motors.
    """

    position: Array
    quaternion: Array
    slide: Array
    roll: Array
    friction: Array
    gravity: Array
    spring_free: Array
    roll_torque: Array


class Plant:
    """n copies of a model, each with its own start, friction, gravity and springs, stepped on
    ``threads`` threads.

    Attributes:
        n: number of robots. qpos: (n, nq) joint positions, the engine's own array.
        diverged: (n,) bool, robots whose physics has gone wrong.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: Robot,
        start: Start,
        threads: int = 1,
        sensors: Sequence[Sensor] = SENSORS,
    ):
        self.model, self.robot = model, robot
        self.n = len(start.friction)
        # Where MuJoCo passes over what never moves, each robot needs an MjData.
        sleeps = bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._batch = batch.Batch(model, nsim=self.n, nthread=threads, persistent=sleeps)
        self._pitch_of_lugs = lug_pitch(robot)
        self._at = _addresses(model)
        self._bind()
        self._sensors = {sensor.channel.name: sensor for sensor in sensors}
        self._own = [name for name in self._sensors if name not in CHANNELS]
        self._last: State | dict[str, Array] = {"contact_position": np.zeros((self.n, 3, 3))}
        self.diverged = np.zeros(self.n, bool)
        self._warnings = self._count_warnings()
        self.reset(np.arange(self.n), start)

    def reset(self, rows: NDArray[np.intp], start: Start) -> None:
        """Put robots ``rows`` (k,) to new starts (k rows); the others stay as they are."""
        model = self.model
        self._batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._force_range[rows] = model.actuator_forcerange
        if self._gears:
            self._gear_loss[rows] = model.tendon_frictionloss
        if self.robot.brake_force > 0:
            self._belt_loss[rows] = model.dof_frictionloss
        self._set_start(rows, start)
        places = with_rows(self._last["contact_position"], rows, start.position[:, None])
        self._last = {"contact_position": places}
        set_rows(self, rows, diverged=False)
        self._leave_out_far_tracks()
        self._seat_arms(rows)
        self._warnings[rows] = self._count_warnings()[rows]

    def _bind(self) -> None:
        b, model, at = self._batch, self.model, self._at
        self.qpos, self._ctrl = b.bind("qpos"), b.bind("ctrl")
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
        self._drive = drive_of(self.robot.drive)
        self._gears: list[tuple[int, int]] = []
        if not self._drive.direct:
            shafts = [f"shaft_{k + 1}" for k in range(self._drive.motors)]
            self._shafts = [model.joint(name).qposadr[0] for name in shafts]
        if self.robot.gear_friction > 0:
            self._gears = [(i, model.tendon(n).id) for i, n in friction_tendons(self._drive)]
            self._gear_loss = b.expand("tendon_frictionloss")
        if self.robot.brake_force > 0:
            self._belt_loss = b.expand("dof_frictionloss")
        names = ("time", "qpos", "qvel", "sensordata", "actuator_force", "xpos", "xmat")
        self._arrays = {name: b.bind(name) for name in names}
        for name in ("xpos", "xmat"):
            self._arrays[name] = self._arrays[name].reshape(self.n, -1)
        self._belt_motors, self._roll_motors = _slice(at.belt_motors), _slice(at.roll_motors)

    def _set_start(self, robots: NDArray[np.intp], start: Start) -> None:
        b, model, at = self._batch, self.model, self._at
        springs = [model.tendon(f"spring_{e}_{i}").id for e in MODULE_ENDS for i in NUMBERS]
        each = robots[:, None]
        touching = np.flatnonzero(model.geom_contype == LUG_CONTYPE)
        b.expand("geom_friction")[each, touching, 0] = start.friction[:, None]
        b.expand("opt.gravity")[robots] = start.gravity
        b.expand("tendon_lengthspring")[each, springs, 0] = start.spring_free[:, None]
        torque = start.roll_torque[:, None, None] * np.array([-1.0, 1.0])
        self._force_range[each, at.roll_motors] = torque
        self.qpos[robots, :3], self.qpos[robots, 3:7] = start.position, start.quaternion
        self.qpos[each, at.slide], self.qpos[each, at.roll] = start.slide, start.roll
        # The servos' set points are where the modules stand: nothing rolls at the start.
        self._ctrl[each, at.roll_motors] = start.roll

    def _seat_arms(self, robots: NDArray[np.intp]) -> None:
        """Move each arm of ``robots`` (k,) to where its springs and the wall are in equilibrium, by
        bisection.

        Nothing holds the springs of an arm whose lugs do not touch the wall or only just do: they
        would throw it into the wall in the first step, the further the higher the preload.
        """
        acceleration = self._batch.bind("qacc")
        slides, dofs = (robots[:, None], self._at.slide), (robots[:, None], self._at.slide_dofs)
        room = SEATING_ROOM * self.robot.lug_radius
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

    def read(self) -> State:
        """Values of all sensors at this moment, (n, ...) by the names of their channels.

        Forces and velocities are those of the last physics step.
        """
        # The engine writes into its arrays again; a state stays what it was.
        arrays = {name: array.copy() for name, array in self._arrays.items()}
        self._last = State(arrays, self._at, self.robot, self._sensors, self._last)
        # A user's own sensor may add up what it sees, so it is read at every step.
        for name in self._own:
            self._last[name]
        return self._last

    def data(self, robot: int) -> mujoco.MjData:
        """Return a copy of MuJoCo's data of one robot as it is now."""
        return self._batch.get_data(robot)

    def step(
        self,
        active: NDArray[np.bool_],
        motors: tuple[Array, Array, Array],
        roll: Array,
        substeps: int,
        brake: Array | None = None,
    ) -> None:
        """Advance the ``active`` robots by ``substeps`` physics steps.

        Args:
            active: (n,) bool.
            motors: set points (n, m) m/s of the motors of the drive, least and largest force (n, m)
                N, see ``SpeedLoop.advance``.
            roll: (n, 3) rad asked of the rotary motors.
            substeps: physics steps.
            brake: (n, 3) part of the brakes' force, 0 to 1; none: they are off.
        """
        set_point, lowest, highest = motors
        self._rub(brake)
        self._ctrl[:, self._belt_motors], self._ctrl[:, self._roll_motors] = set_point, roll
        self._force_range[:, self._belt_motors, 0] = lowest
        self._force_range[:, self._belt_motors, 1] = highest
        # Chains are endless: a row of lugs that has moved on by a pitch is the same row, moved
        # back. Both runs of a chain go together, as the tie between them would pull them level.
        travel = self.qpos.take(self._belts, axis=1)
        pitches = np.rint(travel[..., :1] / self._pitch_of_lugs) * active[:, None, None]
        if np.count_nonzero(pitches):
            back = self._pitch_of_lugs * pitches
            self.qpos[:, self._belts] = travel - back
            if not self._drive.direct:
                # Shafts are tied to their belts and have to be moved back with them.
                self.qpos[:, self._shafts] -= self._drive.motor_values(back[..., 0])
            self.qpos[:, self._at.sprockets] -= back / self.robot.lug_radius
        self._leave_out_far_tracks()
        try:
            self._batch.step(active, nstep=substeps)
        except batch.SimulationError as error:
            self.diverged[error.ids] = True
        warnings = self._count_warnings()
        # A sum is finite where all its terms are, unless they are beyond all reason.
        if warnings.tobytes() != self._warnings.tobytes() or not math.isfinite(self.qpos.sum()):
            broken = ~np.isfinite(self.qpos).all(axis=-1)
            self.diverged = self.diverged | (warnings > self._warnings) | broken

    def _rub(self, brake: Array | None) -> None:
        """Set the friction of the gears and of the brakes for the next steps."""
        if self._gears:
            # What a motor passes on to each of its outputs, N.
            forces = self._arrays["actuator_force"].take(self._at.belt_motors, axis=1)
            passed = np.abs(self._drive.belt_values(forces))
            for belt, tendon in self._gears:
                self._gear_loss[:, tendon] = self.robot.gear_friction * passed[:, belt]
        if self.robot.brake_force > 0:
            force = 0.0 if brake is None else self.robot.brake_force * brake
            self._belt_loss[:, self._at.belt_dofs[:, 0]] = force

    def _leave_out_far_tracks(self) -> None:
        """Switch off the contacts of rows of lugs that face away from the wall: half of the
        collision work. Of tracks that are lines the collider tells by the wall itself."""
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

    def _count_warnings(self) -> NDArray[np.int64]:
        """MuJoCo warnings of each robot so far, (n,)."""
        last_info_and_number = self._batch.warning  # (n, kinds, 2)
        return last_info_and_number[:, :, 1].sum(axis=-1)


def _slice(indices: NDArray[np.intp]) -> slice:
    """Equally spaced addresses as a slice, through which NumPy writes faster."""
    step = int(indices[1] - indices[0]) if len(indices) > 1 else 1
    addresses = slice(int(indices[0]), int(indices[-1]) + 1, step)
    assert np.array_equal(np.arange(addresses.stop)[addresses], indices)
    return addresses


def _addresses(model: mujoco.MjModel) -> Addresses:
    """Names to addresses, once."""

    def joints(kind: str) -> NDArray[np.intp]:
        return np.array([model.joint(f"{kind}_{i}").qposadr[0] for i in NUMBERS])

    def dofs(kind: str) -> NDArray[np.intp]:
        return np.array([model.joint(f"{kind}_{i}").dofadr[0] for i in NUMBERS])

    def bodies(kind: str) -> NDArray[np.intp]:
        return np.array([model.body(f"{kind}_{i}").id for i in NUMBERS])

    # Sprockets touch exact walls alone.
    exact = model.body("sprocket_front_1").geomnum[0] > 0
    parts = (*TRACKS, *MODULE_ENDS) if exact else TRACKS

    def of_chain(kind: str) -> NDArray[np.intp]:
        return np.array([[model.sensor(f"{kind}_{p}_{i}").adr[0] for p in parts] for i in NUMBERS])

    chassis = model.body("chassis").id
    actuators = [model.actuator(i) for i in range(model.nu)]
    return Addresses(
        slide=joints("slide"),
        pitch=joints("pitch"),
        roll=joints("roll"),
        belts=np.array(
            [[model.joint(f"belt_{t}_{i}").qposadr[0] for t in TRACKS] for i in NUMBERS]
        ),
        slide_dofs=dofs("slide"),
        pitch_dofs=dofs("pitch"),
        belt_dofs=np.array(
            [[model.joint(f"belt_{t}_{i}").dofadr[0] for t in TRACKS] for i in NUMBERS]
        ),
        places=3 * bodies("module")[:, None] + np.arange(3),
        forward=9 * bodies("module")[:, None] + np.arange(2, 9, 3),
        chassis=3 * chassis + np.arange(3),
        frame=9 * chassis + np.arange(9).reshape(3, 3).T,
        sprockets=np.array(
            [[model.joint(f"sprocket_{e}_{i}").qposadr[0] for e in MODULE_ENDS] for i in NUMBERS]
        ),
        tracks=np.array([[model.body(f"track_{t}_{i}").id for t in TRACKS] for i in NUMBERS]),
        contact=of_chain("contact")[:, :, None] + np.arange(7),
        touch=of_chain("touch"),
        belt_motors=np.array([a.id for a in actuators if a.name.startswith("belt_")]),
        roll_motors=np.array([model.actuator(f"roll_{i}").id for i in NUMBERS]),
    )
