"""The plant: n robots in one batch. The only door to MuJoCo's state."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from omnitrack_sim.model.robot import LUG_CONAFFINITY, LUG_CONTYPE, lug_pitch
from omnitrack_sim.record.trajectory import TRACKS
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array, cross, dot, matrix_from_quaternion
from omnitrack_sim.theory.kinematics import belt_sign

NUMBERS = (1, 2, 3)
BOTH_TRACKS_COSINE = 0.5
"""Size of cos(roll) below which both tracks of a module can touch; beyond, the track away from the
wall is left out."""
AT_REST = 1e-3
"""Speed below which no slip ratio is formed, m/s."""


@dataclass(frozen=True)
class Trials:
    """What differs between the n trials of one batch.

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


@dataclass(frozen=True)
class Readings:
    """What the plant measures, for n robots; fields as in ``trajectory.CHANNELS``."""

    time: Array  # (n,) s
    position: Array  # (n, 3) m
    quaternion: Array  # (n, 4)
    rotation: Array  # (n, 3, 3)
    angular_velocity: Array  # (n, 3) rad/s, robot frame
    slide: Array  # (n, 3) m
    pitch: Array  # (n, 3) rad
    roll: Array  # (n, 3) rad
    traction: Array  # (n, 3) N
    normal_force: Array  # (n, 3) N
    belt_speed: Array  # (n, 3) m/s
    motor_torque: Array  # (n, 3) N m
    module_speed: Array  # (n, 3) m/s, module over the wall at the contact, along its axis
    wall_speed: Array  # (n, 3) m/s
    slip_velocity: Array  # (n, 3) m/s
    slip_ratio: Array  # (n, 3)
    contact_count: Array  # (n, 3, 2)
    contact_position: Array  # (n, 3, 3) m


def _sleeps(model: mujoco.MjModel) -> bool:
    """Whether MuJoCo passes over what never moves; it then needs an MjData a simulation."""
    return bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP)


def _touching_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms of a body that collide: the lugs of a track, or the one line in their place."""
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    return [g for g in range(first, first + count) if model.geom_contype[g]]


class Plant:
    """n copies of a model, each with its own start, friction, gravity and springs, stepped on
    ``threads`` threads."""

    def __init__(self, model: mujoco.MjModel, robot: Robot, trials: Trials, threads: int = 1):
        self.model, self.robot = model, robot
        self.n = len(trials.friction)
        self._batch = batch.Batch(model, nsim=self.n, nthread=threads, persistent=_sleeps(model))
        self._pitch_of_lugs = lug_pitch(robot)
        self._resolve_names()
        self._bind()
        self._set_trials(trials)
        self._contact_position = np.repeat(trials.position[:, None], 3, axis=1)
        self.diverged = np.zeros(self.n, bool)
        self._batch.forward()
        self._warnings = self._count_warnings()

    def _resolve_names(self) -> None:
        """Names to addresses, once."""
        model = self.model
        joint = {
            k: [model.joint(f"{k}_{i}").qposadr[0] for i in NUMBERS]
            for k in ("slide", "pitch", "roll")
        }
        self._slide, self._pitch, self._roll = (
            np.array(joint[k]) for k in ("slide", "pitch", "roll")
        )
        self._arms = np.array([model.body(f"arm_{i}").id for i in NUMBERS])
        self._modules = np.array([model.body(f"module_{i}").id for i in NUMBERS])
        contact = [[model.sensor(f"contact_{t}_{i}").adr[0] for t in TRACKS] for i in NUMBERS]
        self._contact = np.array(contact)[:, :, None] + np.arange(7)  # (3, 2, 7)
        self._velocity = np.array([model.sensor(f"velocity_{i}").adr[0] for i in NUMBERS])[
            :, None
        ] + np.arange(3)
        self._spin = np.array([model.sensor(f"spin_{i}").adr[0] for i in NUMBERS])[
            :, None
        ] + np.arange(3)
        self._tracks = np.array(
            [[model.body(f"track_{t}_{i}").id for t in TRACKS] for i in NUMBERS]
        )  # (3, 2)
        self._lugs = np.array(
            [[_touching_geoms(model, body) for body in pair] for pair in self._tracks]
        )  # (3, 2, K)
        self._springs = np.array(
            [model.tendon(f"spring_{e}_{i}").id for e in ("front", "rear") for i in NUMBERS]
        )
        self._belts = np.array(
            [[model.joint(f"belt_{t}_{i}").qposadr[0] for t in TRACKS] for i in NUMBERS]
        )  # (3, 2)
        self._belt_dofs = np.array(
            [[model.joint(f"belt_{t}_{i}").dofadr[0] for t in TRACKS] for i in NUMBERS]
        )
        self._belt_motors = np.array([model.actuator(f"belt_{i}").id for i in NUMBERS])
        self._roll_motors = np.array([model.actuator(f"roll_{i}").id for i in NUMBERS])

    def _bind(self) -> None:
        b = self._batch
        self._time, self.qpos, self._ctrl = b.bind("time"), b.bind("qpos"), b.bind("ctrl")
        self._sensors, self._xpos, self._xmat = b.bind("sensordata"), b.bind("xpos"), b.bind("xmat")
        self._qvel, self._actuator_force = b.bind("qvel"), b.bind("actuator_force")
        self._force_range = b.expand("actuator_forcerange")
        self._geom_contype, self._body_contype = b.expand("geom_contype"), b.expand("body_contype")
        self._body_conaffinity, self._geom_conaffinity = (
            b.expand("body_conaffinity"),
            b.expand("geom_conaffinity"),
        )
        self._at_wall = np.ones((self.n, 3, 2), bool)

    def _set_trials(self, trials: Trials) -> None:
        b = self._batch
        b.expand("geom_friction")[:, self._lugs.ravel(), 0] = trials.friction[:, None]
        b.expand("opt.gravity")[:] = trials.gravity
        b.expand("tendon_lengthspring")[:, self._springs, 0] = trials.spring_free[:, None]
        torque = trials.roll_torque[:, None, None] * np.array([-1.0, 1.0])
        self._force_range[:, self._roll_motors] = torque
        self.qpos[:, :3], self.qpos[:, 3:7] = trials.position, trials.quaternion
        self.qpos[:, self._slide], self.qpos[:, self._roll] = trials.slide, trials.roll
        self._ctrl[:, self._roll_motors] = trials.roll

    def read(self) -> Readings:
        """Readings of all robots. Forces and velocities are those of the last physics step."""
        qpos, sensors = self.qpos, self._sensors
        arm_out = self._xmat[:, self._arms, 0::3]  # (n, 3, 3) world: radially outward
        forward = self._xmat[:, self._modules, 2::3]  # (n, 3, 3) world: module axis
        contact = sensors[:, self._contact]  # (n, 3, 2, 7)
        force = -contact[..., 1:4]  # (n, 3, 2, 3) N, wall on track
        along = dot(force, forward[:, :, None])  # (n, 3, 2) N
        total = force[:, :, 0] + force[:, :, 1]
        position = self._contact_centre(contact, force)
        arm = position - self._xpos[:, self._modules]
        module_speed = dot(sensors[:, self._velocity] + cross(sensors[:, self._spin], arm), forward)
        roll = qpos[:, self._roll]
        belt_speed = self._qvel[:, self._belt_dofs[:, 0]]
        wall_speed = belt_speed * belt_sign(roll)
        touching = contact[..., 0].max(axis=-1) > 0
        slip = np.where(touching, wall_speed - module_speed, 0.0)
        scale = np.maximum(np.abs(wall_speed), np.abs(module_speed))
        quaternion = np.array(qpos[:, 3:7])
        return Readings(
            time=np.array(self._time),
            position=np.array(qpos[:, :3]),
            quaternion=quaternion,
            rotation=matrix_from_quaternion(quaternion),
            angular_velocity=np.array(self._qvel[:, 3:6]),
            slide=qpos[:, self._slide],
            pitch=qpos[:, self._pitch],
            roll=roll,
            traction=along[..., 0] + along[..., 1],
            normal_force=-dot(total, arm_out),
            belt_speed=belt_speed,
            motor_torque=self._actuator_force[:, self._belt_motors] * self.robot.lug_radius,
            module_speed=module_speed,
            wall_speed=wall_speed,
            slip_velocity=slip,
            slip_ratio=np.where(
                scale > AT_REST, np.clip(slip / np.maximum(scale, AT_REST), -1, 1), 0.0
            ),
            contact_count=contact[..., 0],
            contact_position=position,
        )

    def _contact_centre(self, contact: Array, force: Array) -> Array:
        """Force-weighted centre of each module's contacts (n, 3, 3) m; where there is none, the
        last one."""
        weight = np.sqrt(dot(force, force))  # (n, 3, 2)
        total = weight[..., 0] + weight[..., 1]
        centre = weight[..., :1] * contact[:, :, 0, 4:7] + weight[..., 1:] * contact[:, :, 1, 4:7]
        known = total > 0
        self._contact_position = np.where(
            known[..., None],
            centre / np.where(known, total, 1.0)[..., None],
            self._contact_position,
        )
        return self._contact_position

    def step(
        self,
        active: NDArray[np.intp],
        drive: tuple[Array, Array, Array],
        roll: Array,
        substeps: int,
    ) -> None:
        """Advance the ``active`` robots (m,) by ``substeps`` physics steps.

        Args:
            active: indices (m,).
            drive: belt speed set points (n, 3) m/s, least and largest belt force (n, 3) N, see
                ``Drive.advance``.
            roll: (n, 3) rad asked of the rotary motors.
            substeps: physics steps.
        """
        set_point, lowest, highest = drive
        self._ctrl[:, self._belt_motors], self._ctrl[:, self._roll_motors] = set_point, roll
        self._force_range[:, self._belt_motors, 0] = lowest
        self._force_range[:, self._belt_motors, 1] = highest
        # Chains are endless: a row of lugs that has moved on by a pitch is the same row, moved
        # back.
        travel = self.qpos[:, self._belts]
        self.qpos[:, self._belts] = travel - self._pitch_of_lugs * np.round(
            travel / self._pitch_of_lugs
        )
        self._leave_out_far_tracks()
        try:
            self._batch.step(active, nstep=substeps)
        except batch.SimulationError as error:
            self.diverged[error.ids] = True
        warnings = self._count_warnings()
        self.diverged |= (warnings > self._warnings) | ~np.isfinite(self.qpos).all(axis=-1)

    def _leave_out_far_tracks(self) -> None:
        """Switch off the contacts of tracks that face away from the wall: half of the collision
        work."""
        cosine = np.cos(self.qpos[:, self._roll])
        at_wall = np.stack(
            [cosine > -BOTH_TRACKS_COSINE, cosine < BOTH_TRACKS_COSINE], axis=-1
        )  # (n, 3, 2)
        if np.array_equal(at_wall, self._at_wall):
            return
        self._at_wall = at_wall
        self._geom_contype[:, self._lugs] = at_wall[..., None] * LUG_CONTYPE
        self._body_contype[:, self._tracks] = at_wall * LUG_CONTYPE
        self._body_conaffinity[:, self._tracks] = at_wall * LUG_CONAFFINITY
        # A geom touches where either mask fits, so both have to go.
        self._geom_conaffinity[:, self._lugs] = at_wall[..., None] * LUG_CONAFFINITY

    def _count_warnings(self) -> NDArray[np.int64]:
        """MuJoCo warnings of each robot so far, (n,)."""
        last_info_and_number = self._batch.warning  # (n, kinds, 2)
        return last_info_and_number[:, :, 1].sum(axis=-1)
