"""One robot in PyBullet, in the place of the package's own plant.

Its pipe has one concave triangle mesh for a wall. What differs from the robot in MuJoCo, because
Bullet has no armature, no tied joints and no soft contacts of that kind:

* No reflected rotor inertia of crawler and rotary motors: as the mass of a link it would add
  weight.
* Belts are velocity motors that correct ``BulletSettings.servo`` of the error in a step, within the
  drive's force limits. The two runs of a chain are not tied: each has a motor of its own.
* Rotary motors are position motors with the time constant of the servo (kv / kp).
* Springs and dampers are joint forces, held for a step.
* Arms slide on a link of their own of ``SLIDER_MASS``.
* Contacts are Bullet's: error reduction and Coulomb friction by projected Gauss-Seidel.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pybullet as bullet
from bullet_robot import robot_urdf
from bullet_walls import LUG_GROUP, WALL_GROUP, BulletSettings, add_wall
from numpy.typing import NDArray

from omnitrack_sim import Scenario
from omnitrack_sim.base.rotations import Array, cross, dot, matrix_from_quaternion
from omnitrack_sim.robots.omnitrack import as_omnitrack
from omnitrack_sim.robots.omnitrack.body import (
    FREE_SPRING_LENGTH,
    spring_free_length,
)
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.drive import SpeedLoop, drive_of
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.sensors import AT_REST, SENSORS
from omnitrack_sim.robots.omnitrack.track_plant import BOTH_TRACKS_COSINE, NUMBERS, TrackPlant
from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.sim.simulation import MakePlant

JOINTS_PER_MODULE = 5
SLIDE, PITCH, ROLL, UPPER, LOWER = range(JOINTS_PER_MODULE)


class Readings(dict[str, Array]):
    """Values of channels, and the sensors of this package that they stand for."""

    def __init__(self, values: Mapping[str, Array]) -> None:
        super().__init__(values)
        self.sensors = {s.channel.name: s for s in SENSORS if s.channel.name in values}


class BulletPlant:
    """One robot in Bullet with what ``Simulation`` uses of ``Plant``."""

    def __init__(self, scenario: Scenario, start: Start, settings: BulletSettings):
        if len(start.friction) != 1:
            raise ValueError("Bullet runs one robot at a time")
        self.robot, self.settings, self.n = as_omnitrack(scenario.robot), settings, 1
        self.model, self._body = None, self.robot
        own = as_omnitrack(start.robots[0])
        self._period = scenario.physics.control_period
        self.motors = SpeedLoop(drive_of(own.drive), [own.motor], own.lug_radius)
        one, three = np.zeros(1), np.zeros((1, 3))
        flags = one.astype(bool)
        roll = np.repeat(start.roll[:, None], 3, axis=1)
        self.command = Command(three, roll, one.astype(int), flags, (), three, flags)
        self.period = scenario.physics.timestep
        self.client = bullet.connect(bullet.DIRECT)
        self._prepare(start.gravity[0])
        self.wall = add_wall(self.client, scenario.route.network, settings)
        self.body = self._add_robot(start)
        self.spring_free, self.roll_torque = spring_free_length(own, own.preload), own.roll_torque
        self.diverged = np.zeros(1, bool)
        self.time = 0.0
        self._contact_position = np.repeat(start.position[:, None], 3, axis=1)[0]
        self._at_wall = np.ones((3, 2), bool)
        self.qpos = np.zeros((1, 7 + 3 * JOINTS_PER_MODULE))
        self._refresh()

    def close(self) -> None:
        """Give the engine's memory back."""
        # The engine uses numbers again, so each may be given back only once.
        client, self.client = self.client, -1
        if client >= 0:
            bullet.disconnect(client)

    __del__ = close

    def _prepare(self, gravity: Array) -> None:
        s = self.settings
        bullet.setGravity(*gravity, physicsClientId=self.client)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=s.time_step,
            numSubSteps=0 if s.substeps == 1 else s.substeps,
            numSolverIterations=s.iterations,
            solverResidualThreshold=0.0,
            contactBreakingThreshold=s.breaking,
            contactERP=s.erp,
            erp=s.erp,
            enableConeFriction=int(s.cone),
            physicsClientId=self.client,
        )

    def _add_robot(self, start: Start) -> int:
        w, *xyz = start.quaternion[0]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(robot_urdf(self.robot), encoding="utf-8")
            body = bullet.loadURDF(
                str(file),
                start.position[0].tolist(),
                [*xyz, w],
                flags=bullet.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self.client,
            )
        self._name_joints(body)
        self._set_surfaces(body, float(start.friction[0]))
        slide = float(start.bore_radius[0]) - self.robot.nominal_pipe_radius
        for row in self._joint:
            bullet.resetJointState(body, row[SLIDE], slide, physicsClientId=self.client)
            bullet.resetJointState(body, row[ROLL], start.roll[0], physicsClientId=self.client)
        # Every joint comes with a velocity motor that brakes it.
        bullet.setJointMotorControlArray(
            body,
            self._sprung,
            bullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._sprung),
            physicsClientId=self.client,
        )
        return body

    def _name_joints(self, body: int) -> None:
        """Numbers of the joints by module and kind, looked up once."""
        joint = {
            bullet.getJointInfo(body, j, physicsClientId=self.client)[1].decode(): j
            for j in range(bullet.getNumJoints(body, physicsClientId=self.client))
        }
        kinds = ("slide", "pitch", "roll", "belt_upper", "belt_lower")
        # (3, 5), in the order of qpos
        self._joint = np.array([[joint[f"{k}_{i}"] for k in kinds] for i in NUMBERS])
        self._all = self._joint.ravel().tolist()
        self._sprung = self._joint[:, [SLIDE, PITCH]].ravel().tolist()
        self._belts = self._joint[:, [UPPER, LOWER]].ravel().tolist()
        self._rolls = self._joint[:, ROLL].tolist()
        self._links = [*self._joint[:, PITCH].tolist(), *self._rolls]  # arms and modules
        self._track_of = {int(j): divmod(i, 2) for i, j in enumerate(self._belts)}

    def _set_surfaces(self, body: int, friction: float) -> None:
        """No damping but the robot's own; friction and contacts of the lugs."""
        quiet = {
            "linearDamping": 0.0,
            "angularDamping": 0.0,
            "jointDamping": 0.0,
            "maxJointVelocity": 1e3,
        }
        for link in range(-1, bullet.getNumJoints(body, physicsClientId=self.client)):
            bullet.changeDynamics(body, link, **quiet, physicsClientId=self.client)
        for link in self._belts:
            surface = {
                "lateralFriction": friction,
                "spinningFriction": 0.0,
                "rollingFriction": 0.0,
            }
            if self.settings.stiffness is not None:
                surface |= {
                    "contactStiffness": self.settings.stiffness,
                    "contactDamping": self.settings.damping,
                }
            bullet.changeDynamics(
                body, link, restitution=0.0, **surface, physicsClientId=self.client
            )
            bullet.setCollisionFilterGroupMask(
                body, link, LUG_GROUP, WALL_GROUP, physicsClientId=self.client
            )

    def _refresh(self) -> None:
        """State of the engine to ``qpos``."""
        position, (x, y, z, w) = bullet.getBasePositionAndOrientation(
            self.body, physicsClientId=self.client
        )
        states = bullet.getJointStates(self.body, self._all, physicsClientId=self.client)
        self._velocity = np.array([s[1] for s in states]).reshape(3, JOINTS_PER_MODULE)
        self._motor_force = (
            np.array([s[3] for s in states]).reshape(3, JOINTS_PER_MODULE) * self.settings.substeps
        )
        self.qpos[0] = [*position, w, x, y, z, *(s[0] for s in states)]

    def contacts(self) -> list[tuple[int, int, Array, Array]]:
        """Contacts that press.

        Returns:
            For each: module, track (0 upper, 1 lower), point (3,) m, force on the track (3,) N.
        """
        found = []
        points = bullet.getContactPoints(self.body, self.wall, physicsClientId=self.client)
        for point in points:
            module, track = self._track_of[point[3]]
            if point[9] <= 0:
                continue
            force = (
                point[9] * np.array(point[7])
                + point[10] * np.array(point[11])
                + point[12] * np.array(point[13])
            )
            # Bullet reports the impulse of its last own step over the whole step.
            found.append((module, track, np.array(point[6]), force * self.settings.substeps))
        return found

    def read(self) -> dict[str, Array]:
        """The readings that ``Plant.read`` gives."""
        qpos = self.qpos[:, 7:].reshape(1, 3, JOINTS_PER_MODULE)
        links = bullet.getLinkStates(
            self.body,
            self._links,
            computeLinkVelocity=1,
            computeForwardKinematics=1,
            physicsClientId=self.client,
        )
        turned = np.array([s[5] for s in links])[:, [3, 0, 1, 2]]
        rotation = matrix_from_quaternion(turned)
        arm_out, forward = rotation[:3, :, 0], rotation[3:, :, 2]
        place, linear, spin = (np.array([s[i] for s in links[3:]]) for i in (4, 6, 7))
        number, total, known = self._sum_contacts()
        module_speed = dot(linear + cross(spin, self._contact_position - place), forward)
        belt_speed = self._velocity[:, UPPER]
        wall_speed = belt_speed * belt_sign(qpos[0, :, ROLL])
        slip = np.where(known, wall_speed - module_speed, 0.0)
        scale = np.maximum(np.abs(wall_speed), np.abs(module_speed))
        quaternion = np.array(self.qpos[:, 3:7])
        base = matrix_from_quaternion(quaternion)
        _, angular = bullet.getBaseVelocity(self.body, physicsClientId=self.client)
        values = {
            "time": np.array([self.time]),
            "position": np.array(self.qpos[:, :3]),
            "quaternion": quaternion,
            "rotation": base,
            "angular_velocity": np.array([angular]) @ base[0],
            "slide": np.array(qpos[..., SLIDE]),
            "pitch": np.array(qpos[..., PITCH]),
            "roll": np.array(qpos[..., ROLL]),
            "traction": dot(total, forward)[None],
            "normal_force": -dot(total, arm_out)[None],
            "belt_speed": belt_speed[None].copy(),
            "motor_torque": self._motor_force[None][..., [UPPER, LOWER]].sum(axis=-1)
            * self.robot.lug_radius,
            "module_speed": module_speed[None],
            "wall_speed": wall_speed[None],
            "slip_velocity": slip[None],
            "slip_ratio": np.where(
                scale > AT_REST, np.clip(slip / np.maximum(scale, AT_REST), -1, 1), 0.0
            )[None],
            "contact_count": number[None],
            "contact_position": self._contact_position[None].copy(),
        }
        self._last = Readings(values)
        return self._last

    def _sum_contacts(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Contacts (3, 2) of each track, force (3, 3) N on each module, and which modules touch.

        ``_contact_position`` is brought up to date for those that do.
        """
        number, total = np.zeros((3, 2)), np.zeros((3, 3))
        weight, centre = np.zeros(3), np.zeros((3, 3))
        for module, track, point, force in self.contacts():
            size = float(np.linalg.norm(force))
            number[module, track] += 1
            total[module] += force
            weight[module] += size
            centre[module] += size * point
        known = weight > 0
        self._contact_position[known] = centre[known] / weight[known, None]
        return number, total, known

    saturated, touches, slip_speed = (
        TrackPlant.saturated,
        TrackPlant.touches,
        TrackPlant.slip_speed,
    )
    to_controller, from_controller, commanded = (
        TrackPlant.to_controller,
        TrackPlant.from_controller,
        TrackPlant.commanded,
    )

    def step(self, active: NDArray[np.bool_], command: Command, substeps: int) -> None:
        """Do what ``Plant.step`` does; ``substeps`` counts the physics steps of the scenario.

        Bullet takes as many steps as its settings ask for.
        """
        if not active[0]:
            return
        if command.brake is not None:
            raise ValueError("this plant has no brakes")
        belts, torque = self._last["belt_speed"], self._last["motor_torque"]
        motors = self.motors.advance(command.belt_speed, belts, torque, self._period)
        assert command.roll is not None
        self._ask_motors(tuple(value[0] for value in motors), command.roll[0])
        self._move_rows_back()
        self._leave_out_far_tracks()
        steps = max(1, round(substeps * self.period / self.settings.time_step))
        for _ in range(steps):
            self._apply_springs()
            bullet.stepSimulation(physicsClientId=self.client)
        self.time += steps * self.settings.time_step
        self._refresh()
        self.diverged[0] |= not np.isfinite(self.qpos).all() or np.abs(self.qpos[0, :3]).max() > 1e3

    def _ask_motors(self, drive: tuple[Array, ...], roll: Array) -> None:
        set_point, lowest, highest = drive
        limit = np.where(set_point > self._velocity[:, UPPER], highest, -lowest)
        bullet.setJointMotorControlArray(
            self.body,
            self._belts,
            bullet.VELOCITY_CONTROL,
            targetVelocities=np.repeat(set_point, 2).tolist(),
            forces=np.repeat(np.maximum(limit, 0.0), 2).tolist(),
            velocityGains=[self.settings.servo] * len(self._belts),
            physicsClientId=self.client,
        )
        inner_step = self.settings.time_step / self.settings.substeps
        # kv / kp of a servo that is damped critically
        inertia = self.robot.rotary_motor.reflected_inertia
        servo_time = 2 * math.sqrt(inertia / self.robot.roll_stiffness)
        bullet.setJointMotorControlArray(
            self.body,
            self._rolls,
            bullet.POSITION_CONTROL,
            targetPositions=roll.tolist(),
            forces=[self.roll_torque] * 3,
            positionGains=[inner_step / servo_time] * 3,
            velocityGains=[1.0] * 3,
            physicsClientId=self.client,
        )

    def _move_rows_back(self) -> None:
        """Chains are endless: a row of lugs that has moved by a pitch is moved back by it."""
        pitch = self.robot.lug_pitch
        travel = self.qpos[0, 7:].reshape(3, JOINTS_PER_MODULE)[:, UPPER:]
        back = pitch * np.round(travel / pitch)
        for module, track in zip(*np.nonzero(back), strict=True):
            bullet.resetJointState(
                self.body,
                self._joint[module, UPPER + track],
                travel[module, track] - back[module, track],
                self._velocity[module, UPPER + track],
                physicsClientId=self.client,
            )
        travel -= back

    def _leave_out_far_tracks(self) -> None:
        """Leave out contacts of tracks that face away from the wall."""
        cosine = np.cos(self.qpos[0, 7:].reshape(3, JOINTS_PER_MODULE)[:, ROLL])
        facing = cosine > -BOTH_TRACKS_COSINE, cosine < BOTH_TRACKS_COSINE
        at_wall = np.stack(facing, axis=-1)  # (3, 2)
        for module, track in zip(*np.nonzero(at_wall != self._at_wall), strict=True):
            mask = WALL_GROUP if at_wall[module, track] else 0
            link = self._joint[module, UPPER + track]
            bullet.setCollisionFilterGroupMask(
                self.body, link, LUG_GROUP if mask else 0, mask, physicsClientId=self.client
            )
        self._at_wall = at_wall

    def _apply_springs(self) -> None:
        """Forces of the front and rear springs, which only push, and of the dampers."""
        robot = self.robot
        stiffness, lever = robot.module_stiffness / 2, robot.shaft_spacing / 2
        states = bullet.getJointStates(self.body, self._sprung, physicsClientId=self.client)
        forces = []
        for (slide, slide_rate, *_), (pitch, pitch_rate, *_) in zip(
            states[::2], states[1::2], strict=True
        ):
            front = stiffness * _push(slide + lever * pitch, self.spring_free)
            rear = stiffness * _push(slide - lever * pitch, self.spring_free)
            forces.append(front + rear - robot.slide_damping * slide_rate)
            forces.append(lever * (front - rear) - robot.pitch_damping * pitch_rate)
        bullet.setJointMotorControlArray(
            self.body,
            self._sprung,
            bullet.TORQUE_CONTROL,
            forces=forces,
            physicsClientId=self.client,
        )


def _push(length: float, free: float) -> float:
    """How far a spring is short of its dead band, m."""
    return max(free - length, 0.0) - max(length - FREE_SPRING_LENGTH, 0.0)


def make_bullet_plant(settings: BulletSettings) -> MakePlant:
    """A plant maker for ``Simulation``: Bullet in the place of MuJoCo."""

    def make(scenario: Scenario, start: Start, _threads: int) -> Plant:
        return BulletPlant(scenario, start, settings)  # type: ignore[return-value]

    return make
