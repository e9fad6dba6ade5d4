"""The same robot in PyBullet, in a pipe whose wall is one concave triangle mesh.

python benchmarks/compare/bullet.py [--job NAME]... [--setting NAME]... [--probes N]

Drives the jobs at each setting with the package's own controller and prints outcome, speed and wall
error.

What differs from the robot in MuJoCo, because Bullet has no armature, no tied joints and no soft
contacts of that kind:

* No reflected rotor inertia of crawler and rotary motors: as the mass of a link it would add
  weight.
* Belts are velocity motors that correct ``BulletSettings.servo`` of the error in a step, within the
  drive's force
  limits. The two runs of a chain are not tied: each has a motor of its own.
* Rotary motors are position motors with the time constant of the servo (kv / kp).
* Springs and dampers are joint forces, held for a step.
* Arms slide on a link of their own of ``SLIDER_MASS``.
* Contacts are Bullet's: error reduction and Coulomb friction by projected Gauss-Seidel.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import pybullet as bullet
import trimesh
from numpy.typing import NDArray

from omnitrack_sim import Scenario, load_scenario
from omnitrack_sim.model.meshes import fitting_mesh
from omnitrack_sim.model.robot import FREE_SPRING_LENGTH, lug_pitch, lug_places
from omnitrack_sim.pipes import Assembly, Fitting, Part
from omnitrack_sim.record.channels import TRACKS
from omnitrack_sim.robot import MODULE_ANGLES, Robot
from omnitrack_sim.rotations import Array, Pose, cross, dot, matrix_from_quaternion
from omnitrack_sim.sensing.truth import AT_REST
from omnitrack_sim.sim.plant import BOTH_TRACKS_COSINE, NUMBERS, Plant, Start
from omnitrack_sim.sim.shares import timed
from omnitrack_sim.sim.simulation import MakePlant, Simulation
from omnitrack_sim.theory.kinematics import belt_sign

JOBS = ("straight", "elbow_short", "tee_turn")
SLIDER_MASS = 1e-3
"""Mass of the link between slide and pitch joint, kg; taken off the arm."""
LUG_GROUP, WALL_GROUP = 1, 2
"""Collision groups: lugs touch walls and nothing else."""
ON_SURFACE = 2e-4
"""Distance from the exact inner surface within which a mesh vertex belongs to it, m."""
PROBE_GAP = 5e-4
"""Gap between probe sphere and exact surface, m."""
JOINTS_PER_MODULE = 5
SLIDE, PITCH, ROLL, UPPER, LOWER = range(JOINTS_PER_MODULE)


@dataclass(frozen=True)
class BulletSettings:
    """Numerics of Bullet.

    Attributes:
        time_step: of ``stepSimulation``, s. Springs are computed once in each.
        substeps: Bullet's own steps within it.
        iterations: of the constraint solver.
        sections, along: edges of the wall mesh around the bore; rings in 90 degrees of an elbow.
        erp: part of a contact's depth that is corrected in a step.
        breaking: distance from which contacts are kept, m.
        stiffness, damping: of a contact, N/m and N s/m, instead of ``erp``; None for rigid
            contacts.
        servo: part of a belt's speed error that its motor corrects in a step; ``time_step /
            robot.motor.servo_time`` is the motor's own lag without load.
        cone: friction cone instead of a pyramid.
    """

    time_step: float = 0.001
    substeps: int = 1
    iterations: int = 50
    sections: int = 96
    along: int = 24
    erp: float = 0.2
    breaking: float = 0.001
    stiffness: float | None = None
    damping: float | None = None
    servo: float = 1.0
    cone: bool = False


SETTINGS: dict[str, BulletSettings] = {
    "default": BulletSettings(),
    "2ms": BulletSettings(time_step=0.002),
    "4ms": BulletSettings(time_step=0.004),
    "iterations_200": BulletSettings(iterations=200),
    "fine_mesh": BulletSettings(sections=192, along=48),
    "breaking_20mm": BulletSettings(breaking=0.02),
    "soft_4ms": BulletSettings(time_step=0.004, stiffness=2e4, damping=50.0),
    "4ms_iterations_200": BulletSettings(time_step=0.004, iterations=200),
    "4ms_iterations_100": BulletSettings(time_step=0.004, iterations=100),
    "4ms_iterations_200_fine": BulletSettings(
        time_step=0.004, iterations=200, sections=192, along=48
    ),
}


def inner_mesh(fitting: Fitting, settings: BulletSettings) -> trimesh.Trimesh:
    """Inner surface of a fitting, m, fitting frame; the exact surface lies amid each facet around
    the bore."""
    n = settings.sections
    if len(fitting.axes) == 1:
        mesh = _swept(fitting, n, settings.along)
    else:
        solid = fitting_mesh(fitting, sections=n)
        off = np.abs(fitting.signed_distance(solid.vertices)[0])
        keep = (off[solid.faces] < ON_SURFACE).all(axis=1)
        centre = solid.triangles_center[keep]
        # End caps have their corners on the surface too, and their middles in the port planes.
        faces = solid.faces[keep][fitting.extent(centre) > 1e-7]
        mesh = trimesh.Trimesh(solid.vertices, faces, process=False)
        mesh.remove_unreferenced_vertices()
    _, gradient = fitting.signed_distance(mesh.vertices)
    sagitta = fitting.radius * (1 - math.cos(math.pi / n))
    mesh.vertices = mesh.vertices - gradient * sagitta / 2
    return mesh


def _swept(fitting: Fitting, sections: int, along: int) -> trimesh.Trimesh:
    """Rings along the one axis of a fitting, ``along`` in a right angle, joined by triangles;
    corners on the exact surface."""
    line, first, last = Part("part", fitting, Pose()).axes()[0]
    ends = line.at(np.array([0.0, line.length]))
    bend = line.length * float(ends[3].max())
    turns = max(2, math.ceil(along * bend / (math.pi / 2))) if bend else 1
    s, u = np.linspace(0, line.length, turns + 1), 2 * np.pi * np.arange(sections) / sections
    circle = np.stack([np.cos(u), np.sin(u), 0 * u], axis=-1)
    radius = np.linspace(first, last, turns + 1)[:, None, None]
    points = line.at(s)[0][:, None] + radius * np.einsum("sij,kj->ski", line.frame(s), circle)
    index = np.arange((turns + 1) * sections).reshape(turns + 1, sections)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [
        np.stack(corners, axis=-1).reshape(-1, 3)
        for corners in ((a, b, a_next), (a_next, b, b_next))
    ]
    return trimesh.Trimesh(points.reshape(-1, 3), np.concatenate(faces), process=False)


def add_wall(client: int, network: Assembly, settings: BulletSettings) -> int:
    """The inner surface of a network as one static concave body; returns its number."""
    meshes = []
    for part in network.parts:
        mesh = inner_mesh(part.fitting, settings)
        meshes.append(trimesh.Trimesh(part.pose.apply(mesh.vertices), mesh.faces, process=False))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wall.obj"
        file.write_text(
            trimesh.util.concatenate(meshes).export(file_type="obj", digits=9), encoding="utf-8"
        )
        shape = bullet.createCollisionShape(
            bullet.GEOM_MESH,
            fileName=str(file),
            flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
    if shape < 0:
        raise RuntimeError("Bullet did not take the wall mesh")
    wall = bullet.createMultiBody(0, shape, physicsClientId=client)
    bullet.setCollisionFilterGroupMask(wall, -1, WALL_GROUP, LUG_GROUP, physicsClientId=client)
    bullet.changeDynamics(wall, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
    return wall


def _vector(*values: float) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def _inertial(mass: float, across: float, axial: float) -> str:
    return (
        f'<inertial><mass value="{mass:.9g}"/><inertia ixx="{across:.9g}" iyy="{across:.9g}" '
        f'izz="{axial:.9g}"'
        ' ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def _cylinder(mass: float, radius: float, length: float) -> str:
    """Inertia of a solid cylinder along z."""
    return _inertial(mass, mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2)


def _joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str,
    limits: tuple[float, float],
    origin: str = "",
) -> str:
    bounds = f'<limit lower="{limits[0]:.9g}" upper="{limits[1]:.9g}" effort="1e4" velocity="1e3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child '
        f'link="{child}"/>{origin}'
        f'<axis xyz="{axis}"/>{bounds}<dynamics damping="0" friction="0"/></joint>'
    )


def robot_urdf(robot: Robot) -> str:
    """The robot as URDF text, frames and signs as in ``omnitrack_sim.model.robot``."""
    chassis = _cylinder(robot.chassis_mass, robot.chassis_radius, robot.chassis_length)
    slider_body = _cylinder(SLIDER_MASS, robot.arm_radius, robot.shaft_spacing)
    arm_body = _cylinder(robot.arm_mass - SLIDER_MASS, robot.arm_radius, robot.shaft_spacing)
    parts = [f'<link name="chassis">{chassis}</link>']
    radius, free = robot.lug_radius - robot.track_offset, (1.0, -1.0)
    track_inertia = robot.track_mass * robot.lug_radius**2
    track_body = _inertial(robot.track_mass, track_inertia, track_inertia)
    for number, angle in zip(NUMBERS, MODULE_ANGLES, strict=True):
        place = robot.module_distance * np.array([math.cos(angle), math.sin(angle), 0.0])
        origin = f'<origin xyz="{_vector(*place)}" rpy="{_vector(0, 0, angle)}"/>'
        slider, arm, module = f"slider_{number}", f"arm_{number}", f"module_{number}"
        parts += [
            f'<link name="{slider}">{slider_body}</link>',
            _joint(
                f"slide_{number}",
                "prismatic",
                "chassis",
                slider,
                "1 0 0",
                robot.slide_range,
                origin,
            ),
            f'<link name="{arm}">{arm_body}</link>',
            _joint(
                f"pitch_{number}",
                "revolute",
                slider,
                arm,
                "0 1 0",
                (-robot.pitch_limit, robot.pitch_limit),
            ),
            "<link "
            f'name="{module}">'
            f"{_cylinder(robot.module_mass, robot.lug_radius, robot.length)}</link>",
            _joint(f"roll_{number}", "continuous", arm, module, "0 0 1", free),
        ]
        for track, side in zip(TRACKS, (1.0, -1.0), strict=True):
            name = f"track_{track}_{number}"
            lugs = "".join(
                f'<collision><origin xyz="{_vector(side * robot.track_offset, 0, z)}"/>'
                f'<geometry><sphere radius="{radius:.9g}"/></geometry></collision>'
                for z in lug_places(robot)
            )
            parts += [
                f'<link name="{name}">{track_body}{lugs}</link>',
                _joint(f"belt_{track}_{number}", "prismatic", module, name, f"0 0 {-side:g}", free),
            ]
    return f'<?xml version="1.0"?><robot name="omnitrack">{"".join(parts)}</robot>'


class BulletPlant:
    """One robot in Bullet with what ``Simulation`` uses of ``Plant``."""

    def __init__(self, scenario: Scenario, start: Start, settings: BulletSettings):
        if len(start.friction) != 1:
            raise ValueError("Bullet runs one robot at a time")
        self.robot, self.settings, self.n = scenario.robot, settings, 1
        self.period = scenario.physics.timestep
        self.client = bullet.connect(bullet.DIRECT)
        self._prepare(start.gravity[0])
        began = time.perf_counter()
        self.wall = add_wall(self.client, scenario.route.network, settings)
        self.body = self._add_robot(start)
        self.build_seconds = time.perf_counter() - began
        self.spring_free, self.roll_torque = (
            float(start.spring_free[0]),
            float(start.roll_torque[0]),
        )
        self.engine_seconds, self.engine_steps = 0.0, 0
        self.diverged = np.zeros(1, bool)
        self.time = 0.0
        self._contact_position = np.repeat(start.position[:, None], 3, axis=1)[0]
        self._at_wall = np.ones((3, 2), bool)
        self.qpos = np.zeros((1, 7 + 3 * JOINTS_PER_MODULE))
        self._refresh()

    def close(self) -> None:
        """Give the engine's memory back."""
        # The engine gives numbers again: each may be given back once only.
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
        joint = {
            bullet.getJointInfo(body, j, physicsClientId=self.client)[1].decode(): j
            for j in range(bullet.getNumJoints(body, physicsClientId=self.client))
        }
        kinds = ("slide", "pitch", "roll", "belt_upper", "belt_lower")
        self._joint = np.array(
            [[joint[f"{k}_{i}"] for k in kinds] for i in NUMBERS]
        )  # (3, 5), as in qpos
        self._all = self._joint.ravel().tolist()
        self._sprung = self._joint[:, [SLIDE, PITCH]].ravel().tolist()
        self._belts = self._joint[:, [UPPER, LOWER]].ravel().tolist()
        self._rolls = self._joint[:, ROLL].tolist()
        self._links = [*self._joint[:, PITCH].tolist(), *self._rolls]  # arms and modules
        self._track_of = {int(j): divmod(i, 2) for i, j in enumerate(self._belts)}
        quiet = {
            "linearDamping": 0.0,
            "angularDamping": 0.0,
            "jointDamping": 0.0,
            "maxJointVelocity": 1e3,
        }
        for link in range(-1, len(joint)):
            bullet.changeDynamics(body, link, **quiet, physicsClientId=self.client)
        for link in self._belts:
            surface = {
                "lateralFriction": float(start.friction[0]),
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
        for row, slide, roll in zip(self._joint, start.slide[0], start.roll[0], strict=True):
            bullet.resetJointState(body, row[SLIDE], slide, physicsClientId=self.client)
            bullet.resetJointState(body, row[ROLL], roll, physicsClientId=self.client)
        # Every joint comes with a velocity motor that brakes it.
        bullet.setJointMotorControlArray(
            body,
            self._sprung,
            bullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._sprung),
            physicsClientId=self.client,
        )
        return body

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

    def contacts(self) -> list[tuple[int, int, Array, Array, float]]:
        """Contacts that press: module, track (0 upper, 1 lower), point (3,) m, force on the track
        (3,) N, gap m."""
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
            found.append(
                (module, track, np.array(point[6]), force * self.settings.substeps, point[8])
            )
        return found

    def read(self) -> dict[str, Array]:
        """As ``Plant.read``."""
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
        number, total, weight, centre = (
            np.zeros((3, 2)),
            np.zeros((3, 3)),
            np.zeros(3),
            np.zeros((3, 3)),
        )
        for module, track, point, force, _ in self.contacts():
            size = float(np.linalg.norm(force))
            number[module, track] += 1
            total[module] += force
            weight[module] += size
            centre[module] += size * point
        known = weight > 0
        self._contact_position[known] = centre[known] / weight[known, None]
        module_speed = dot(linear + cross(spin, self._contact_position - place), forward)
        belt_speed = self._velocity[:, UPPER]
        wall_speed = belt_speed * belt_sign(qpos[0, :, ROLL])
        slip = np.where(known, wall_speed - module_speed, 0.0)
        scale = np.maximum(np.abs(wall_speed), np.abs(module_speed))
        quaternion = np.array(self.qpos[:, 3:7])
        base = matrix_from_quaternion(quaternion)
        _, angular = bullet.getBaseVelocity(self.body, physicsClientId=self.client)
        return {
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

    def step(
        self,
        active: NDArray[np.bool_],
        drive: tuple[Array, Array, Array],
        roll: Array,
        substeps: int,
    ) -> None:
        """As ``Plant.step``; ``substeps`` counts the scenario's physics steps, Bullet takes as many
        as it is set to."""
        if not active[0]:
            return
        self._ask_motors(tuple(value[0] for value in drive), roll[0])
        self._move_rows_back()
        self._leave_out_far_tracks()
        steps = max(1, round(substeps * self.period / self.settings.time_step))
        for _ in range(steps):
            self._apply_springs()
            start = time.perf_counter()
            bullet.stepSimulation(physicsClientId=self.client)
            self.engine_seconds += time.perf_counter() - start
        self.engine_steps += steps
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
        """Chains are endless: a row of lugs that has moved on by a pitch is the same row, moved
        back."""
        pitch = lug_pitch(self.robot)
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
        """As ``Plant``: no contacts of tracks that face away from the wall."""
        cosine = np.cos(self.qpos[0, 7:].reshape(3, JOINTS_PER_MODULE)[:, ROLL])
        at_wall = np.stack(
            [cosine > -BOTH_TRACKS_COSINE, cosine < BOTH_TRACKS_COSINE], axis=-1
        )  # (3, 2)
        for module, track in zip(*np.nonzero(at_wall != self._at_wall), strict=True):
            mask = WALL_GROUP if at_wall[module, track] else 0
            link = self._joint[module, UPPER + track]
            bullet.setCollisionFilterGroupMask(
                self.body, link, LUG_GROUP if mask else 0, mask, physicsClientId=self.client
            )
        self._at_wall = at_wall

    def _apply_springs(self) -> None:
        """Front and rear springs push only; dampers of slide and pitch."""
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

    def make(scenario: Scenario, start: Start, threads: int) -> Plant:
        return BulletPlant(scenario, start, settings)  # type: ignore[return-value]

    return make


def contacts_per_lug(plant: BulletPlant) -> float:
    """Pressing contacts over lugs that have any; not a number where there is none."""
    found = plant.contacts()
    if not found:
        return math.nan
    links = bullet.getLinkStates(
        plant.body, plant._belts, computeForwardKinematics=1, physicsClientId=plant.client
    )
    places, lugs = lug_places(plant.robot), set()
    for module, track, point, _, _ in found:
        state = links[2 * module + track]
        rotation = matrix_from_quaternion(np.array([state[5]])[:, [3, 0, 1, 2]])[0]
        z = rotation[:, 2] @ (point - np.array(state[4]))
        lugs.add((module, track, int(np.argmin(np.abs(places - z)))))
    return len(found) / len(lugs)


def bullet_wall_error(
    scenario: Scenario, settings: BulletSettings, probes: int = 4000, seed: int = 0
) -> tuple[float, float]:
    """Largest and 99 % distance, mm, of the surface that lugs meet from the exact one.

    A sphere as large as a lug is held ``PROBE_GAP`` off the exact surface, and the engine is asked
    for the gap. On the fittings that bend or branch; in a straight route on all of it.
    """
    network = scenario.route.network
    radius = scenario.robot.lug_radius - scenario.robot.track_offset
    parts = [p for p in network.parts if not p.fitting.is_plain] or list(network.parts)
    centres = probe_centres(network, parts, radius, probes, seed)
    client = bullet.connect(bullet.DIRECT)
    try:
        wall = add_wall(client, network, settings)
        shape = bullet.createCollisionShape(
            bullet.GEOM_SPHERE, radius=radius, physicsClientId=client
        )
        probe = bullet.createMultiBody(1.0, shape, physicsClientId=client)
        errors = np.full(len(centres), np.inf)
        exact = network.signed_distance(centres)[0]
        for i, centre, distance in zip(count(), centres, exact):
            bullet.resetBasePositionAndOrientation(
                probe, centre.tolist(), [0, 0, 0, 1], physicsClientId=client
            )
            points = bullet.getClosestPoints(probe, wall, 0.01, physicsClientId=client)
            if points:
                errors[i] = distance - radius - min(point[8] for point in points)
    finally:
        bullet.disconnect(client)
    size = 1e3 * np.abs(errors)
    return float(size.max()), float(np.quantile(size, 0.99))


def probe_centres(network: Assembly, parts: list, radius: float, number: int, seed: int) -> Array:
    """Centres (number, 3) m of spheres that stand ``PROBE_GAP`` off the exact surface, at random
    over ``parts``."""
    rng = np.random.default_rng(seed)
    samples = np.concatenate([part.bore_samples() for part in parts])
    chosen = []
    while sum(map(len, chosen)) < number:
        points = samples[rng.integers(len(samples), size=number)] + rng.normal(0, 0.01, (number, 3))
        distance, gradient = network.signed_distance(points)
        points = points + gradient * (radius + PROBE_GAP - distance)[:, None]
        distance = network.signed_distance(points)[0]
        # Not where a sphere reaches past an open end, nor where it touches elsewhere.
        inside = np.max([part.extent(points) for part in parts], axis=0) > radius
        chosen.append(points[inside & (np.abs(distance - radius - PROBE_GAP) < PROBE_GAP / 2)])
    return np.concatenate(chosen)[:number]


@dataclass(frozen=True)
class Drive:
    """One job at one setting."""

    outcome: str
    reason: str
    duration_s: float
    speed: float  # simulated s per wall s, stepping only: engine, springs, motors
    speed_engine: float  # simulated s per wall s in stepSimulation
    speed_all: float  # simulated s per wall s with control and recording
    step_us: float  # microseconds a stepSimulation
    contacts_per_lug: float
    exit_tilt_deg: float
    build_s: float


def drive(scenario: Scenario, settings: BulletSettings) -> Drive:
    """Run a scenario at a setting."""
    simulation = Simulation([scenario], make_plant=make_bullet_plant(settings))
    plant: BulletPlant = simulation.plant  # type: ignore[assignment]
    contacts: list[float] = []
    inner = plant.step

    def watched(*given) -> None:  # type: ignore[no-untyped-def]
        inner(*given)
        if plant.engine_steps % 50 == 0:
            spent = time.perf_counter()
            contacts.append(contacts_per_lug(plant))
            watched.spent += time.perf_counter() - spent  # type: ignore[attr-defined]

    watched.spent = 0.0  # type: ignore[attr-defined]
    plant.step = watched  # type: ignore[method-assign]
    shares, spent = timed(simulation), watched.spent  # type: ignore[attr-defined]
    duration = float(simulation.end_time[0])
    (trajectory,) = simulation.recorder.trajectories(simulation.end_time)
    (ending,) = simulation.endings
    assert ending is not None
    result = Drive(
        outcome=ending.outcome.value,
        reason=ending.reason,
        duration_s=duration,
        speed=duration / (shares.physics - spent),
        speed_engine=duration / plant.engine_seconds,
        speed_all=duration / (shares.physics - spent + shares.control + shares.recording),
        step_us=1e6 * plant.engine_seconds / max(plant.engine_steps, 1),
        contacts_per_lug=float(np.nanmean(contacts)) if contacts else math.nan,
        exit_tilt_deg=float(np.degrees(trajectory["tilt"][-1])),
        build_s=plant.build_seconds,
    )
    plant.close()
    return result


def main() -> None:
    """Drive the jobs at the settings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--job", action="append", choices=JOBS)
    parser.add_argument("--setting", action="append", choices=sorted(SETTINGS))
    parser.add_argument("--probes", type=int, default=2000)
    given = parser.parse_args()
    for name in given.setting or SETTINGS:
        for job in given.job or JOBS:
            scenario = load_scenario(job)
            result = drive(scenario, SETTINGS[name])
            largest, most = bullet_wall_error(scenario, SETTINGS[name], given.probes)
            values = "  ".join(
                f"{k} {v:.3g}"
                for k, v in dataclasses.asdict(result).items()
                if isinstance(v, float)
            )
            print(
                f"{name:16} {job:12} {result.outcome}  wall {largest:.3f}/{most:.3f} mm  {values}  "
                f"{result.reason}"
            )


if __name__ == "__main__":
    main()
