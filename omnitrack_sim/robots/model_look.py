"""What a model of somebody else tells of itself: size, forward axis, wheels, and inputs to try."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import takewhile
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.reading import checked
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.mjcf import Axis, Mjcf, Servo, turn_to
from omnitrack_sim.robots.model_file import robot_model
from omnitrack_sim.robots.plant import SETTINGS
from omnitrack_sim.robots.scene import compiled, initial_state
from omnitrack_sim.robots.servos import MAX_RATIO
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.walls.geoms import TIMESTEP

ROUND = 0.95
"""Least over largest radius of a wheel, about its axle: treads and coarse meshes are round."""
SECTORS = 12
"""Of the circle about an axle, in each of which a wheel has a largest radius."""
SWING = 0.2
"""Part of its range that an input to try swings about its mean: seen, and far from the stops."""
RATE = 0.5
"""Of that swing, Hz: slow enough for limbs that carry the robot."""
PLAY = 0.05
"""Part of the bore that a robot without wheels round it has to spare: it would wedge."""
BELOW = 0.1
"""Radii by which a wheel is to be below the middle of a cart, or off the axis of a robot."""
CROSSING = 0.3
"""Cosine to an axle, beyond the least one, up to which an axis may be the forward one."""
SLOW, GIVES_ANGLE, GIVES = 0.2, 0.2, 0.05
"""Of servos that carry the weight: part of the nominal speed by which a wheel falls behind, angle,
rad, by which a joint gives way, and part of the bore by which a slide does."""
STIFFEST = 125.0
"""Largest natural frequency of a joint with its servo alone, rad/s: a quarter of one over 2 ms."""
MAX_STEPS, MAX_HALVINGS = 3_000, 4
"""Physics steps in which a robot alone comes to rest, and times that a step is halved for that."""
STEADY = 0.02
"""Part of the bore that is gained at least where an axis beside the chassis' own is taken."""
DIRECTIONS = 64
"""In which the points are looked for that lie farthest out."""
PLAUSIBLE = 1.2
"""An axis has to be more slender by this than x, or x and y, to be the forward one."""
AXES: tuple[Axis, ...] = ("x", "y", "z")


@dataclass(frozen=True)
class Wheel:
    """A joint that turns something round about its axle.

    Attributes:
        joint: its name.
        radius: m.
        axle: (3,) unit vector, chassis frame.
        middle: (3,) m, chassis frame.
    """

    joint: str
    radius: float
    axle: Array
    middle: Array

    def rate(self, robot: Mjcf, up: Array) -> float:
        """Return the rate, rad/s, of the joint at which its robot drives forward by 1 m/s.

        Args:
            robot: that it drives.
            up: (3,) unit vector, chassis frame: where a wheel is beside the robot's axis, its wall
                is below.
        """
        turn = turn_to(robot.forward)
        # The wall is beyond the wheel, seen from the robot's axis; its rim goes backward there.
        for out in ((self.middle - robot.centre) @ turn, -up @ turn):
            slope = -np.cross(self.axle @ turn, out * [1.0, 1.0, 0.0])[2]
            if abs(slope) > BELOW * self.radius:
                return math.copysign(1 / self.radius, slope)
        return 0.0


@dataclass(frozen=True)
class ModelLook:
    """What a model tells of the robot that it is.

    Attributes:
        robot: with the forward axis, centre, bore and servos that were found.
        wheels: that were found.
        inputs: to try, by the names of the actuators, as plain data of ``Periodic``.
        up: (3,) unit vector that is up in the model's own world, in the frame of the robot.
        timestep: s, that the file's own physics needs.
    """

    robot: Mjcf
    wheels: tuple[Wheel, ...]
    inputs: Mapping[str, Any]
    up: Array
    timestep: float


def look_at(file: str, body: str = "") -> ModelLook:
    """Return what the model in a file tells of its robot.

    Args:
        file: MJCF or URDF.
        body: its chassis; "" where the file tells.

    Raises:
        InputError: it is no robot.
    """
    given = {"file": file, "body": body}
    try:
        robot = checked(Mjcf, given, InputError)
    except InputError as error:
        raise InputError([fault.at(file) for fault in error.faults]) from None
    data = initial_state(robot)
    chassis = _Chassis.of(data, robot.chassis)
    wheels = [wheel for name in _endless_joints(data.model) if (wheel := _wheel(chassis, name))]
    forward = _forward(chassis, wheels)
    turn = turn_to(forward)
    at_rest, timestep = _at_rest(robot, min(data.model.opt.timestep, TIMESTEP))
    settled = _Chassis.of(at_rest, robot.chassis)
    aside, _ = _circle(*chassis.section(turn))
    width = 2 * max(_reach(*each.section(turn), aside) for each in (chassis, settled))
    # Wheels round it hold a robot by pressing on the wall; another one has to have its play.
    width *= 1.0 if wheels and not _is_cart(chassis, wheels) else 1 + PLAY
    size = {"centre": _rounded(turn @ [*aside, 0.0]), "bore": _upward(width)}
    robot = Mjcf(**given, forward=forward, **size)
    turning = {wheel.joint: wheel.rate(robot, chassis.rotation[2]) for wheel in wheels}
    if not data.model.nu:
        servos = _servos(robot, {wheel.joint: wheel.radius for wheel in wheels})
        robot = Mjcf(**given, forward=forward, **size, servos=_grouped(servos))
        _, timestep = _at_rest(robot, timestep)
    return ModelLook(
        robot=robot,
        wheels=tuple(wheels),
        inputs=dict(_inputs(robot, turning)),
        up=(chassis.rotation @ turn)[2],
        timestep=timestep,
    )


@dataclass(frozen=True)
class _Chassis:
    """A robot in a state, as its chassis sees it.

    Attributes:
        data: of the robot alone.
        position, rotation: (3,) m and (3, 3), of the chassis in the world.
    """

    data: mujoco.MjData
    position: Array
    rotation: Array

    @classmethod
    def of(cls, data: mujoco.MjData, name: str) -> _Chassis:
        body = data.model.body(name).id
        return cls(data, data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy())

    def balls(self, body: int | None = None) -> tuple[Array, Array]:
        """Return points (k, 3) m and radii (k,) m of balls that fill the geoms which touch walls.

        Args:
            body: whose geoms; None: all.
        """
        data, model = self.data, self.data.model
        touches = (model.geom_contype | model.geom_conaffinity) > 0
        if body is not None:
            touches &= model.geom_bodyid == body
        points, radii = [np.zeros((0, 3))], [np.zeros(0)]
        for geom in np.flatnonzero(touches).tolist():
            local, radius = _shape(model, geom)
            points.append(data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T)
            radii.append(np.full(len(local), radius))
        return (np.concatenate(points) - self.position) @ self.rotation, np.concatenate(radii)

    def section(self, turn: Array) -> tuple[Array, Array]:
        """Return points (k, 2) m and radii (k,) m across the third column of a rotation (3, 3)."""
        points, radii = self.balls()
        return (points @ turn)[:, :2], radii


def _settled(robot: Mjcf, timestep: float) -> mujoco.MjData | None:
    """Return the robot alone when its joints have come to rest, as it does before a run begins.

    None where its physics diverges with a time step, s.
    """
    model = copy.copy(compiled(robot))
    model.opt.gravity[:] = 0.0
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    data.ctrl[:] = robot.start_ctrl
    root = model.body_rootid[model.body(robot.chassis).id]
    place, speed = model.jnt_qposadr[model.body_jntadr[root]], model.body_dofadr[root]
    steps = math.ceil(SETTINGS.seating_time * robot.time_scale / timestep)
    for _ in range(min(steps, MAX_STEPS)):
        mujoco.mj_step(model, data)
        data.qpos[place : place + 7] = model.qpos0[place : place + 7]
        data.qvel[speed : speed + 6] = 0.0
    mujoco.mj_kinematics(model, data)
    return None if data.warning.number.any() else data


def _at_rest(robot: Mjcf, timestep: float) -> tuple[mujoco.MjData, float]:
    """Return the robot alone at rest, and the time step, s, at which it comes to rest."""
    for halvings in range(MAX_HALVINGS + 1):
        data = _settled(robot, timestep / 2**halvings)
        if data is not None:
            return data, timestep / 2**halvings
    return initial_state(robot), timestep


# Size


def _shape(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Return points (k, 3) m, geom frame, and a radius, m, of balls about them that fill it."""
    kinds, (a, b, c) = mujoco.mjtGeom, model.geom_size[geom].tolist()
    match int(model.geom_type[geom]):
        case kinds.mjGEOM_SPHERE:
            return np.zeros((1, 3)), a
        case kinds.mjGEOM_CAPSULE:
            return np.array([[0.0, 0.0, b], [0.0, 0.0, -b]]), a
        case kinds.mjGEOM_CYLINDER:
            angles = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
            circle = np.stack([a * np.cos(angles), a * np.sin(angles), 0 * angles], axis=-1)
            half = np.array([0.0, 0.0, b])
            return np.concatenate([circle + half, circle - half]), 0.0
        case kinds.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            return model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float), 0.0
        case kinds.mjGEOM_ELLIPSOID:
            rays = np.array([r for r in itertools.product((-1, 0, 1), repeat=3) if any(r)], float)
            return rays / np.linalg.norm(rays, axis=1, keepdims=True) * [a, b, c], 0.0
    corners = np.array([*itertools.product((-1.0, 1.0), repeat=3)])
    return model.geom_aabb[geom, :3] + corners * model.geom_aabb[geom, 3:], 0.0


def _circle(points: Array, radii: Array) -> tuple[Array, float]:
    """Return the centre (2,) m and radius, m, of a circle round discs, nearly the least one."""
    # Those that lie farthest out in some direction make the circle.
    angles = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    outward = points @ np.stack([np.cos(angles), np.sin(angles)]) + radii[:, None]
    outer = np.unique(outward.argmax(axis=0))
    centre, places = np.zeros(2), points[outer]
    for i in range(400):
        # Bădoiu and Clarkson: towards the farthest one, by less and less.
        away = np.linalg.norm(places - centre, axis=1) + radii[outer]
        centre = centre + (places[away.argmax()] - centre) / (i + 2)
    best, own = (_reach(points, radii, place) for place in (centre, np.zeros(2)))
    # The chassis' own axis is easier to read, and hardly wider.
    return (centre, best) if best < (1 - STEADY) * own else (np.zeros(2), own)


def _reach(points: Array, radii: Array, centre: Array) -> float:
    return float((np.linalg.norm(points - centre, axis=1) + radii).max())


def _is_cart(chassis: _Chassis, wheels: list[Wheel]) -> bool:
    """Return whether all wheels of a robot are below its middle."""
    (points, radii), up = chassis.balls(), chassis.rotation[2]
    heights = points @ up
    middle = ((heights + radii).max() + (heights - radii).min()) / 2
    return bool(wheels) and all(w.middle @ up < middle - BELOW * w.radius for w in wheels)


def _forward(chassis: _Chassis, wheels: list[Wheel]) -> Axis:
    """Return the likely forward axis: the most slender one, across the axles of wheels.

    Of a cart, whose wheels are all below its middle, it is a level one.
    """
    points, radii = chassis.balls()
    across = [np.zeros(3), *(wheel.axle for wheel in wheels)]
    if _is_cart(chassis, wheels):
        across.append(chassis.rotation[2])
    crossing = np.abs(across).max(axis=0)
    best, slender = AXES[0], 0.0
    for axis, along in zip(AXES, crossing, strict=True):
        local = points @ turn_to(axis)
        length = float((local[:, 2] + radii).max() - (local[:, 2] - radii).min())
        ratio = length / _circle(local[:, :2], radii)[1]
        if along <= crossing.min() + CROSSING and ratio > PLAUSIBLE * slender:
            best, slender = axis, ratio
    return best


def _rounded(vector: Array) -> tuple[float, float, float]:
    """Return a vector to a tenth of a millimetre."""
    x, y, z = (round(float(value), 4) + 0.0 for value in vector)
    return x, y, z


def _upward(length: float) -> float:
    """Return a length with three digits, not less than it is."""
    digit = 10.0 ** (math.floor(math.log10(length)) - 2)
    return float(f"{math.ceil(length / digit - 1e-6) * digit:.6g}")


# Wheels


def _endless_joints(model: mujoco.MjModel) -> Iterator[str]:
    """Yield the names of the hinges without limits."""
    for i in range(model.njnt):
        joint = model.joint(i)
        if joint.name and joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE and not joint.limited[0]:
            yield joint.name


def _wheel(chassis: _Chassis, name: str) -> Wheel | None:
    """Return the wheel that a joint turns; None where what hangs on it is not round about it."""
    data, model = chassis.data, chassis.data.model
    joint = model.joint(name).id
    axle = data.xaxis[joint] @ chassis.rotation
    anchor = (data.xanchor[joint] - chassis.position) @ chassis.rotation
    points, radii = chassis.balls(model.jnt_bodyid[joint])
    if not len(points):
        return None
    along = (points - anchor) @ axle
    radius = _wheel_radius(points - anchor - along[:, None] * axle, axle, radii)
    middle = anchor + axle * (along.min() + along.max()) / 2
    return Wheel(name, radius, axle, middle) if radius else None


def _wheel_radius(aside: Array, axis: Array, radii: Array) -> float:
    """Return the radius of balls about points (k, 3) m, from the axle; 0 where it is not round."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    x, y = aside @ first, aside @ np.cross(axis, first)
    distance = np.hypot(x, y)
    if distance.max() < 0.05 * radii.max():
        return float((distance + radii).max())
    sector = ((np.arctan2(y, x) / (2 * np.pi) % 1.0) * SECTORS).astype(int) % SECTORS
    largest = np.zeros(SECTORS)
    np.maximum.at(largest, sector, distance + radii)
    return float(largest.max()) if largest.min() > ROUND * largest.max() else 0.0


# Inputs


def _servos(robot: Mjcf, rims: Mapping[str, float]) -> tuple[Servo, ...]:
    """Return motors of all joints of a robot without any; ``rims``: radii of wheels by joint, m.

    They carry its weight: those of wheels at their rims, others at the wall.
    """
    model, weight = compiled(robot), robot.mass * GRAVITY
    servos = []
    for name in robot_model(robot.file, robot.body).drivable:
        joint = model.joint(name)
        is_slide = joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
        lever = rims.get(name, robot.nominal_bore / 2)
        force = weight if is_slide else weight * lever
        if name in rims:
            kind, gain = "velocity", force / (SLOW * robot.nominal_speed / lever)
        else:
            gives = GIVES * robot.nominal_bore if is_slide else GIVES_ANGLE
            stiffest = float(model.dof_M0[joint.dofadr[0]]) * STIFFEST**2
            kind, gain = "position", min(force / gives, stiffest)
        own = model.jnt_actfrclimited[joint.id]  # the file's own
        limit = None if own else _short(force)
        more = _short(_missing_inertia(model, name, gain)) if kind == "velocity" else 0.0
        servos.append(Servo(joints=name, kind=kind, gain=_short(gain), limit=limit, armature=more))
    return tuple(servos)


def _missing_inertia(model: mujoco.MjModel, joint: str, gain: float) -> float:
    """Return the inertia, kg m², with which a wheel's servo of a gain does not make it slip."""
    own = float(model.dof_M0[model.joint(joint).dofadr[0]])
    return max(gain * TIMESTEP / (0.8 * MAX_RATIO) - own, 0.0)


def _grouped(servos: tuple[Servo, ...]) -> tuple[Servo, ...]:
    """Return servos with one for all that are alike, where a pattern fits their joints alone."""
    names, groups = [servo.joints for servo in servos], {}
    for servo in servos:
        groups.setdefault(servo.model_copy(update={"joints": ""}), []).append(servo.joints)
    grouped = []
    for alike, joints in groups.items():
        turned = [name[::-1] for name in joints]
        pattern = f"{_common_start(joints)}*{_common_start(turned)[::-1]}"
        fits = [name for name in names if fnmatchcase(name, pattern)] == joints
        for each in [pattern] if fits and len(joints) > 1 else joints:
            grouped.append(alike.model_copy(update={"joints": each}))
    return tuple(grouped)


def _common_start(words: list[str]) -> str:
    """Return the letters with which all words begin."""
    columns = takewhile(lambda letters: len(set(letters)) == 1, zip(*words, strict=False))
    return "".join(letters[0] for letters in columns)


def _inputs(robot: Mjcf, rates: Mapping[str, float]) -> Iterator[tuple[str, Any]]:
    """Yield an input to try for each actuator: wheels turn; without any, all swing.

    Args:
        robot: whose actuators they are.
        rates: of the joints of wheels, rad/s at 1 m/s.
    """
    model, start = compiled(robot), robot.start_ctrl
    names, speed = robot.channels["ctrl"].names, robot.nominal_speed
    for i, name in enumerate(names):
        joint = model.joint(model.actuator_trnid[i, 0]).name if _is_of_joint(model, i) else ""
        if joint in rates and _is_speed_servo(model, i):
            yield name, _short(_clipped(model, i, _input_of_speed(model, i) * rates[joint] * speed))
            continue
        mean, swing = _range(model, i, float(start[i]), robot)
        wave = {"frequency": RATE, "phase_deg": round(360.0 * i / len(names))}
        offset = {"offset": _short(mean)} if mean else {}
        # A robot on wheels would weave.
        yield name, _short(mean) if rates else {**offset, "amplitude": _short(swing), **wave}


def _is_of_joint(model: mujoco.MjModel, actuator: int) -> bool:
    kinds = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT
    return int(model.actuator_trntype[actuator]) in kinds


def _is_speed_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator's force falls with speed, and not with position."""
    _, position, speed = model.actuator_biasprm[actuator, :3].tolist()
    return position == 0 and speed < 0


def _input_of_speed(model: mujoco.MjModel, actuator: int) -> float:
    """Return the input of a servo of speed for 1 rad/s of its joint."""
    gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, 2]
    return float(-model.actuator_gear[actuator, 0] * bias / gain) if gain else 0.0


def _clipped(model: mujoco.MjModel, actuator: int, value: float) -> float:
    if not model.actuator_ctrllimited[actuator]:
        return value
    low, high = model.actuator_ctrlrange[actuator].tolist()
    return min(max(value, low), high)


def _range(model: mujoco.MjModel, actuator: int, start: float, robot: Mjcf) -> tuple[float, float]:
    """Return mean and amplitude of an input to try; ``start``: that of the start."""
    if model.actuator_ctrllimited[actuator]:
        low, high = model.actuator_ctrlrange[actuator].tolist()
        swing = SWING * (high - low) / 2
        return min(max(start, low + swing), high - swing), swing
    if model.actuator_biasprm[actuator, 1]:
        return start, SWING  # of a position
    # A force: that of a twentieth of the weight at the wall.
    torque = robot.mass * GRAVITY * robot.nominal_bore / 2
    gear = float(np.abs(model.actuator_gear[actuator]).max()) or 1.0
    gain = abs(float(model.actuator_gainprm[actuator, 0])) or 1.0
    return 0.0, 0.05 * torque / gear / gain


def _short(value: float) -> float:
    return float(f"{value:.3g}") + 0.0
