"""Control steps of the robot on a device: motors, readings, entries.

What the processor states in compiled functions (motors) is translated from these; what it states in
arrays of NumPy (readings, features) stands here once more, for one robot, and is held against it by
the tests.
"""

from __future__ import annotations

from itertools import accumulate

import warp as wp

from omnitrack_sim.robots.omnitrack import drive
from omnitrack_sim.robots.omnitrack.policy.features import FEATURES
from omnitrack_sim.robots.omnitrack.policy.sectors import SECTOR
from omnitrack_sim.robots.size import GRAVITY as STANDARD_GRAVITY
from omnitrack_sim.warp.contacts import intrinsics
from omnitrack_sim.warp.episodes import (
    ASIDE,
    EFFORT_CHANGE,
    GRAVITY,
    OWN,
    PASSAGE,
    RUNNING,
    SLIP,
    SPIN,
    TANGENT,
    THETA5,
    TILT,
    Course,
    in_frame,
    put,
    put_route,
    read_pose,
    rotation_of,
    three,
)
from omnitrack_sim.warp.translation import INT, REAL, REALS, Translation

wp.set_module_options({"enable_backward": False})

SIZES = {
    "roll": 3,
    "slide": 3,
    "pitch": 3,
    "belt_speed": 3,
    "motor_torque": 3,
    "normal_force": 3,
    "traction": 3,
    "slip_velocity": 3,
    "module_speed": 3,
    "contact_count": 6,
    "contact_position": 9,
    "roll_set_point": 3,
    "forward": 3,
    "action": 4,
    "correction": 3,
    "first": 1,
    "first_passage": 1,
    "speed_limit": 1,
    "cruise_speed": 1,
    "motor": drive.FIGURES,
    "weight": 1,
}
"""Numbers that this robot has in its world's state beside those of any, see ``episodes.SIZES``."""
(
    ROLL,
    SLIDE,
    PITCH,
    BELT_SPEED,
    TORQUE,
    NORMAL_FORCE,
    TRACTION,
    SLIP_VELOCITY,
    MODULE_SPEED,
    CONTACT_COUNT,
    CONTACT_POSITION,
    ROLL_SET,
    FORWARD,
    ACTION,
    CORRECTION,
    FIRST,
    FIRST_PASSAGE,
    SPEED_LIMIT,
    CRUISE_SPEED,
    MOTOR,
    WEIGHT,
    STATE_SIZE,
) = accumulate(SIZES.values(), initial=OWN)
"""Where each begins, and how many there are."""
TORQUE_LIMIT = MOTOR + drive.LIMIT
ENTRIES = sum(feature.size for feature in FEATURES.values())
"""Of all shipped features."""
Pairs, Parts = wp.types.matrix((3, 2), wp.int32), wp.types.matrix((3, 4), wp.int32)
"""Addresses of two tracks or sprockets, and of the four parts of the chain, of each module."""


@wp.struct
class Robot:
    """Constants of the robots of an environment, and addresses in MuJoCo's arrays."""

    lug_radius: float
    lug_pitch: float
    roll_rate: float
    band: float
    slide: wp.vec3i
    pitch: wp.vec3i
    roll: wp.vec3i
    belts: Pairs
    sprockets: Pairs
    slide_dofs: wp.vec3i
    pitch_dofs: wp.vec3i
    belt_dofs: wp.vec3i
    modules: wp.vec3i
    chassis: int
    belt_motors: wp.vec3i
    roll_motors: wp.vec3i
    contact: Parts
    touch: Parts


def _snippet() -> str:
    """Return what advances a robot's motors, in C++."""
    whole = Translation(intrinsics())
    advance = whole.function(drive._advance, [INT, INT, REAL, *[REALS] * 6]).name
    return f"""struct Laws {{ typedef float real;
{whole.members(advance)}
}};
    float* row = &wp::index(state, world, 0);
    float asked[12];
    Laws::{advance}(
      1, 3, period, row + {MOTOR}, &wp::index(wanted, world, 0),
      row + {BELT_SPEED}, row + {TORQUE}, row + {CORRECTION}, asked);
    for (int i = 0; i < 9; ++i)
      wp::index(motors, world, i) = asked[i];"""


_ADVANCE = _snippet()


@wp.func_native(_ADVANCE)
def advance_motors(
    period: float,
    wanted: wp.array2d(dtype=float),
    state: wp.array2d(dtype=float),
    motors: wp.array2d(dtype=float),
    world: int,
):
    """Write set points, least and largest forces of a robot's belt motors."""


@wp.func
def sign_of(x: float) -> float:
    """Return 1 or -1."""
    return wp.where(x < 0.0, -1.0, 1.0)


@wp.func
def belt_sign(roll: float) -> float:
    """Return the direction in which a positive belt speed drives a module."""
    return sign_of(wp.cos(roll))


@wp.kernel
def take_actions(
    actions: wp.array2d(dtype=float), outcome: wp.array(dtype=int), state: wp.array2d(dtype=float)
):
    """Take the actions of running robots, in their own order of modules; see ``Decisions``."""
    world = wp.tid()
    first = int(state[world, FIRST])
    for i in range(4):
        k = i
        if i < 3:
            k = (i - first + 3) % 3
        value = float(actions[world, k])
        if wp.isnan(value) or outcome[world] != RUNNING:
            value = 0.0
        state[world, ACTION + i] = wp.clamp(value, -1.0, 1.0)


@wp.kernel
def command(
    robot: Robot,
    course: Course,
    state: wp.array2d(dtype=float),
    wanted: wp.array2d(dtype=float),
    motors: wp.array2d(dtype=float),
    qpos: wp.array2d(dtype=float),
    ctrl: wp.array2d(dtype=float),
    force_range: wp.array2d(dtype=wp.vec2),
):
    """Turn actions into inputs of actuators, and move rows of lugs back by whole pitches."""
    world = wp.tid()
    turned = state[world, ACTION + 3] * robot.roll_rate * course.period
    for i in range(3):
        cosine = wp.cos(state[world, ROLL + i])
        if wp.abs(cosine) > robot.band:
            state[world, FORWARD + i] = sign_of(cosine)
        wanted[world, i] = (
            state[world, ACTION + i] * state[world, SPEED_LIMIT] * state[world, FORWARD + i]
        )
        state[world, ROLL_SET + i] = state[world, ROLL_SET + i] + turned
    advance_motors(course.period, wanted, state, motors, world)
    for i in range(3):
        ctrl[world, robot.belt_motors[i]] = motors[world, i]
        force_range[world, robot.belt_motors[i]] = wp.vec2(
            motors[world, 3 + i], motors[world, 6 + i]
        )
        ctrl[world, robot.roll_motors[i]] = state[world, ROLL_SET + i]
        travel = qpos[world, robot.belts[i, 0]]
        back = robot.lug_pitch * wp.rint(travel / robot.lug_pitch)
        for k in range(2):
            a, b = robot.belts[i, k], robot.sprockets[i, k]
            qpos[world, a] = qpos[world, a] - back
            qpos[world, b] = qpos[world, b] - back / robot.lug_radius


@wp.kernel
def read(
    robot: Robot,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    xpos: wp.array2d(dtype=wp.vec3),
    xmat: wp.array2d(dtype=wp.mat33),
    sensors: wp.array2d(dtype=float),
    forces: wp.array2d(dtype=float),
    origins: wp.array(dtype=wp.vec3d),
    outcome: wp.array(dtype=int),
    state: wp.array2d(dtype=float),
):
    """Write what ``robots.omnitrack.sensors`` reads of running robots."""
    world = wp.tid()
    if outcome[world] != RUNNING:
        return
    read_pose(world, qpos, qvel, origins, state)
    origin = wp.vec3(origins[world])
    frame = xmat[world, robot.chassis]
    ex = wp.vec3(frame[0, 0], frame[1, 0], frame[2, 0])
    ey = wp.vec3(frame[0, 1], frame[1, 1], frame[2, 1])
    ez = wp.vec3(frame[0, 2], frame[1, 2], frame[2, 2])
    spin = qvel[world, 3] * ex + qvel[world, 4] * ey + qvel[world, 5] * ez
    speed = wp.vec3(qvel[world, 0], qvel[world, 1], qvel[world, 2])
    slips, change = wp.float32(0.0), wp.float32(0.0)
    for i in range(3):
        roll = qpos[world, robot.roll[i]]
        belt = qvel[world, robot.belt_dofs[i]]
        state[world, SLIDE + i] = qpos[world, robot.slide[i]]
        state[world, PITCH + i] = qpos[world, robot.pitch[i]]
        state[world, ROLL + i] = roll
        state[world, BELT_SPEED + i] = belt
        torque = forces[world, robot.belt_motors[i]] * robot.lug_radius
        change += wp.abs(torque - state[world, TORQUE + i]) / 3.0
        state[world, TORQUE + i] = torque
        body = xmat[world, robot.modules[i]]
        forward = wp.vec3(body[0, 2], body[1, 2], body[2, 2])
        total, centre = wp.float32(0.0), wp.vec3(0.0)
        traction, normal = wp.float32(0.0), wp.float32(0.0)
        for k in range(4):
            a = robot.contact[i, k]
            force = -three(sensors, world, a + 1)
            weight = wp.length(force)
            total += weight
            centre += weight * three(sensors, world, a + 4)
            traction += wp.dot(force, forward)
            normal += sensors[world, robot.touch[i, k]]
        ends = sensors[world, robot.contact[i, 2]] + sensors[world, robot.contact[i, 3]]
        upper = sensors[world, robot.contact[i, 0]] + ends
        lower = sensors[world, robot.contact[i, 1]] + ends
        place = three(state, world, CONTACT_POSITION + 3 * i) - origin
        if total > 0.0:
            place = centre / total
        angle = SECTOR * float(i)
        if i == 2:
            angle = -SECTOR
        cos, sin = wp.cos(angle), wp.sin(angle)
        moved = speed + wp.cross(spin, place - xpos[world, robot.chassis])
        moved += qvel[world, robot.slide_dofs[i]] * (cos * ex + sin * ey)
        lever = place - xpos[world, robot.modules[i]]
        moved += qvel[world, robot.pitch_dofs[i]] * wp.cross(cos * ey - sin * ex, lever)
        along = wp.dot(moved, forward)
        slip = wp.float32(0.0)
        if upper > 0.0 or lower > 0.0:
            slip = belt * belt_sign(roll) - along
        for k in range(3):
            state[world, CONTACT_POSITION + 3 * i + k] = place[k] + origin[k]
        state[world, CONTACT_COUNT + 2 * i] = upper
        state[world, CONTACT_COUNT + 2 * i + 1] = lower
        state[world, TRACTION + i] = traction
        state[world, NORMAL_FORCE + i] = normal
        state[world, MODULE_SPEED + i] = along
        state[world, SLIP_VELOCITY + i] = slip
        slips += wp.abs(slip) / 3.0
    state[world, SLIP] = slips
    state[world, EFFORT_CHANGE] = change / state[world, TORQUE_LIMIT]


@wp.kernel
def observe(
    course: Course,
    state: wp.array2d(dtype=float),
    entries: wp.array2d(dtype=float),
):
    """Write the quantities of all shipped features, in their order, modules from the first on."""
    world = wp.tid()
    passage = int(state[world, PASSAGE])
    if state[world, FIRST_PASSAGE] != float(passage):
        turns = int(wp.round(-state[world, THETA5] / SECTOR))
        state[world, FIRST] = float((turns + 3) % 3)
        state[world, FIRST_PASSAGE] = float(passage)
    first = int(state[world, FIRST])
    turn = SECTOR * float(first)
    cos, sin = wp.cos(turn), wp.sin(turn)
    about = wp.mat33(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
    frame = rotation_of(state, world) * about
    limit, bore = state[world, SPEED_LIMIT], course.bore
    double = wp.vec2(0.0, 0.0)
    lag = wp.float32(0.0)
    for i in range(3):
        k = (i + first) % 3
        roll = state[world, ROLL + k]
        sign = belt_sign(roll)
        entries[world, i] = state[world, BELT_SPEED + k] * sign / limit
        entries[world, 3 + i] = state[world, TORQUE + k] * sign / state[world, TORQUE_LIMIT]
        entries[world, 6 + i] = state[world, SLIDE + k] / bore
        double += wp.vec2(wp.cos(2.0 * roll), wp.sin(2.0 * roll)) / 3.0
        lag += (state[world, ROLL_SET + k] - roll) / 3.0
    entries[world, 9] = double[0]
    entries[world, 10] = double[1]
    entries[world, 11] = lag
    n = put(entries, world, 12, in_frame(about, three(state, world, SPIN)))
    n = put(entries, world, n, in_frame(frame, three(state, world, GRAVITY)) / STANDARD_GRAVITY)
    theta5 = state[world, THETA5] + turn
    entries[world, n] = wp.cos(theta5)
    entries[world, n + 1] = wp.sin(theta5)
    entries[world, n + 2] = 0.0
    entries[world, n + 3] = state[world, TILT]
    n = put(entries, world, n + 4, in_frame(frame, three(state, world, TANGENT)))
    aside = in_frame(frame, three(state, world, ASIDE)) / bore
    entries[world, n] = aside[0]
    entries[world, n + 1] = aside[1]
    n += 2
    for i in range(3):
        entries[world, n + i] = state[world, ACTION + (i + first) % 3]
    entries[world, n + 3] = state[world, ACTION + 3]
    entries[world, n + 4] = state[world, CRUISE_SPEED] / limit
    n = put_route(course, state, world, frame, entries, n + 5)
    for i in range(3):
        k = (i + first) % 3
        entries[world, n + i] = state[world, NORMAL_FORCE + k] / state[world, WEIGHT]
        entries[world, n + 3 + i] = state[world, TRACTION + k] / state[world, WEIGHT]
        entries[world, n + 6 + i] = state[world, SLIP_VELOCITY + k] / limit
        entries[world, n + 9 + i] = state[world, MODULE_SPEED + k] / limit
        for j in range(2):
            touches = state[world, CONTACT_COUNT + 2 * k + j] > 0.0
            entries[world, n + 12 + 2 * i + j] = wp.where(touches, 1.0, 0.0)
        entries[world, n + 18 + i] = state[world, PITCH + k]
