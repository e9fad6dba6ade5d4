"""Control steps of robots on a device: motors, readings, location, verdicts, entries.

What the processor states in compiled functions (location, motors) is translated from these; what it
states in arrays of NumPy (readings, features, terms of the reward) stands here once more, for one
robot, and is held against it by the tests.
"""

from __future__ import annotations

import warp as wp

from omnitrack_sim.pipes import centreline, route_map
from omnitrack_sim.robots.feature import AHEAD
from omnitrack_sim.robots.omnitrack import drive
from omnitrack_sim.robots.omnitrack.policy.features import FEATURES
from omnitrack_sim.robots.omnitrack.policy.sectors import SECTOR
from omnitrack_sim.warp.contacts import intrinsics
from omnitrack_sim.warp.starts import (
    ACTION,
    BELT_SPEED,
    CONTACT_COUNT,
    CONTACT_POSITION,
    CORRECTION,
    CRUISE_SPEED,
    FARTHEST,
    FIRST,
    FIRST_PASSAGE,
    FORWARD,
    GOAL,
    GRAVITY,
    MAX_STEPS,
    MODULE_SPEED,
    MOTOR,
    NORMAL_FORCE,
    PASSAGE,
    PATIENCE,
    PITCH,
    PLACE,
    POSITION,
    ROLL,
    ROLL_SET,
    ROTATION,
    SLIDE,
    SLIP,
    SPEED_LIMIT,
    SPIN,
    STEPS,
    TIME,
    TORQUE,
    TRACTION,
    WAITING,
    WEIGHT,
)
from omnitrack_sim.warp.translation import INT, INTS, REAL, REALS, Translation

wp.set_module_options({"enable_backward": False})

DISTANCE, OFFSET, TILT, THETA5 = PLACE, PLACE + 1, PLACE + 3, PLACE + 4
TORQUE_LIMIT = MOTOR + drive.LIMIT
ASIDE, TANGENT, TURNING = PLACE + 5, PLACE + 8, PLACE + 14
PROGRESS, TILTING, SLIPPING, TORQUE_CHANGE, ARRIVAL, FAILURE = 0, 1, 2, 3, 4, 5
"""Columns of the terms of the reward, in the order of ``gym.options.TERMS``."""
RUNNING, REACHED_GOAL, NO_HEADWAY, TIMED_OUT, LEFT_PIPE, DIVERGED, WEDGED = 0, 1, 2, 3, 4, 5, 6
"""How a world's episode has ended."""
OUTCOMES = ("", "reached_goal", "stuck", "timed_out", "left_pipe", "diverged", "wedged")
"""The same in words. Why a robot makes no headway is found on the processor alone."""
PASSAGE_RADIUS = route_map.RADIUS
PASSAGE_SIZE = route_map.PASSAGE
KIND_SIZE = 9
"""Numbers of a passage that features read: start, end, four kinds, turn, bend, bore."""
ARM = 8
"""Numbers of an arm of a branched fitting: begin, direction, length, radius."""
MAX_SPEED = 1e10
"""Size of a speed beyond which the physics has diverged; MuJoCo's own."""
ENTRIES = sum(feature.size for feature in FEATURES.values())
"""Of all shipped features."""
AHEAD_1, AHEAD_2, AHEAD_3 = AHEAD
Pairs, Parts = wp.types.matrix((3, 2), wp.int32), wp.types.matrix((3, 4), wp.int32)
"""Addresses of two tracks or sprockets, and of the four parts of the chain, of each module."""


@wp.struct
class Robot:
    """Constants of the robots of an environment, and addresses in MuJoCo's arrays."""

    period: float
    bore: float
    lug_radius: float
    lug_pitch: float
    roll_rate: float
    half_length: float
    route_length: float
    progress: float
    slide_back: float
    wedged_cosine: float
    band: float
    standard_gravity: float
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


@wp.struct
class Tables:
    """Tables of the route, see ``RouteMap.arrays``, and of what lies beside it."""

    segments: wp.array(dtype=float)
    lines: wp.array(dtype=int)
    passages: wp.array(dtype=float)
    spans: wp.array(dtype=int)
    kinds: wp.array2d(dtype=float)
    arms: wp.array2d(dtype=float)


def _snippets() -> tuple[str, str, str]:
    """Return what locates a robot, looks along its route, and advances its motors, in C++."""
    whole = Translation(intrinsics())
    kinds = [INT, REALS, INTS, REALS, INTS, INTS, REALS, REALS, REALS, INTS, REALS]
    locate = whole.function(route_map._locate, kinds).name
    segment = whole.function(centreline.segment_at, [REALS, INT, INT, REAL]).name
    place = whole.function(centreline.place_on, [REALS, REAL]).name
    advance = whole.function(drive._advance, [INT, INT, REAL, *[REALS] * 6]).name
    members = whole.members(locate, segment, place, advance)
    head = f"struct Laws {{ typedef float real;\n{members}\n}};\n"
    row = "float* row = &wp::index(state, world, 0);\n"
    locating = f"""{head}{row}    int route = 0, passage = 0;
    Laws::{locate}(
      1, tables.segments.data, tables.lines.data, tables.passages.data, tables.spans.data, &route,
      row + {POSITION}, row + {ROTATION}, row + {DISTANCE}, &passage, row + {PLACE});
    row[{PASSAGE}] = passage;"""
    looking = f"""{head}    float* segments = tables.segments.data;
    const int here = Laws::{segment}(segments, tables.lines.data[0], tables.lines.data[1], s);
    const auto tangent = Laws::{place}(segments + {centreline.COLUMNS} * here, s).a1;
    return wp::vec_t<3, wp::float32>(tangent.a0, tangent.a1, tangent.a2);"""
    driving = f"""{head}{row}    float asked[12];
    Laws::{advance}(
      1, 3, period, row + {MOTOR}, &wp::index(wanted, world, 0),
      row + {BELT_SPEED}, row + {TORQUE}, row + {CORRECTION}, asked);
    for (int i = 0; i < 9; ++i)
      wp::index(motors, world, i) = asked[i];"""
    return locating, looking, driving


_LOCATE, _LOOK, _ADVANCE = _snippets()


@wp.func_native(_LOCATE)
def locate(tables: Tables, state: wp.array2d(dtype=float), world: int):
    """Locate a robot on its route."""


@wp.func_native(_LOOK)
def tangent_at(tables: Tables, s: float) -> wp.vec3:
    """Return the direction of the route's centreline at an arc length, m."""


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
def three(values: wp.array2d(dtype=float), row: int, column: int) -> wp.vec3:
    """Return three numbers of a row as a vector."""
    return wp.vec3(values[row, column], values[row, column + 1], values[row, column + 2])


@wp.func
def sign_of(x: float) -> float:
    """Return 1 or -1."""
    return wp.where(x < 0.0, -1.0, 1.0)


@wp.kernel
def begin_decision(
    actions: wp.array2d(dtype=float),
    outcome: wp.array(dtype=int),
    state: wp.array2d(dtype=float),
    over: wp.array(dtype=int),
    terms: wp.array2d(dtype=float),
):
    """Take the actions of running robots, in their own order of modules; see ``Decisions``."""
    world = wp.tid()
    over[world] = wp.where(outcome[world] == RUNNING, 0, 1)
    for k in range(6):
        terms[world, k] = 0.0
    first = int(state[world, FIRST])
    for i in range(4):
        k = i
        if i < 3:
            k = (i - first + 3) % 3
        value = float(actions[world, k])
        if wp.isnan(value) or over[world] == 1:
            value = 0.0
        state[world, ACTION + i] = wp.clamp(value, -1.0, 1.0)


@wp.kernel
def command(
    robot: Robot,
    state: wp.array2d(dtype=float),
    wanted: wp.array2d(dtype=float),
    motors: wp.array2d(dtype=float),
    qpos: wp.array2d(dtype=float),
    ctrl: wp.array2d(dtype=float),
    force_range: wp.array2d(dtype=wp.vec2),
):
    """Turn actions into inputs of actuators, and move rows of lugs back by whole pitches."""
    world = wp.tid()
    turned = state[world, ACTION + 3] * robot.roll_rate * robot.period
    for i in range(3):
        cosine = wp.cos(state[world, ROLL + i])
        if wp.abs(cosine) > robot.band:
            state[world, FORWARD + i] = sign_of(cosine)
        wanted[world, i] = (
            state[world, ACTION + i] * state[world, SPEED_LIMIT] * state[world, FORWARD + i]
        )
        state[world, ROLL_SET + i] = state[world, ROLL_SET + i] + turned
    advance_motors(robot.period, wanted, state, motors, world)
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


@wp.func
def read(
    robot: Robot,
    world: int,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    xpos: wp.array2d(dtype=wp.vec3),
    xmat: wp.array2d(dtype=wp.mat33),
    sensors: wp.array2d(dtype=float),
    forces: wp.array2d(dtype=float),
    state: wp.array2d(dtype=float),
):
    """Write what ``robots.omnitrack.sensors`` reads."""
    w, x, y, z = qpos[world, 3], qpos[world, 4], qpos[world, 5], qpos[world, 6]
    turn = wp.quat_to_matrix(wp.normalize(wp.quat(x, y, z, w)))
    for i in range(3):
        state[world, POSITION + i] = qpos[world, i]
        state[world, SPIN + i] = qvel[world, 3 + i]
        for k in range(3):
            state[world, ROTATION + 3 * i + k] = turn[i, k]
    frame = xmat[world, robot.chassis]
    ex = wp.vec3(frame[0, 0], frame[1, 0], frame[2, 0])
    ey = wp.vec3(frame[0, 1], frame[1, 1], frame[2, 1])
    ez = wp.vec3(frame[0, 2], frame[1, 2], frame[2, 2])
    spin = qvel[world, 3] * ex + qvel[world, 4] * ey + qvel[world, 5] * ez
    speed = wp.vec3(qvel[world, 0], qvel[world, 1], qvel[world, 2])
    for i in range(3):
        roll = qpos[world, robot.roll[i]]
        belt = qvel[world, robot.belt_dofs[i]]
        state[world, SLIDE + i] = qpos[world, robot.slide[i]]
        state[world, PITCH + i] = qpos[world, robot.pitch[i]]
        state[world, ROLL + i] = roll
        state[world, BELT_SPEED + i] = belt
        state[world, TORQUE + i] = forces[world, robot.belt_motors[i]] * robot.lug_radius
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
        place = three(state, world, CONTACT_POSITION + 3 * i)
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
            state[world, CONTACT_POSITION + 3 * i + k] = place[k]
        state[world, CONTACT_COUNT + 2 * i] = upper
        state[world, CONTACT_COUNT + 2 * i + 1] = lower
        state[world, TRACTION + i] = traction
        state[world, NORMAL_FORCE + i] = normal
        state[world, MODULE_SPEED + i] = along
        state[world, SLIP + i] = slip


@wp.func
def belt_sign(roll: float) -> float:
    """Return the direction in which a positive belt speed drives a module."""
    return sign_of(wp.cos(roll))


@wp.func
def is_outside(robot: Robot, tables: Tables, state: wp.array2d(dtype=float), world: int) -> bool:
    """Return whether a robot has left its route, and is in no arm beside it either."""
    s, passage = state[world, DISTANCE], int(state[world, PASSAGE])
    if s < -robot.half_length or s > robot.route_length + robot.half_length:
        return True
    if state[world, OFFSET] <= tables.passages[PASSAGE_SIZE * passage + PASSAGE_RADIUS]:
        return False
    place = three(state, world, POSITION)
    for i in range(tables.arms.shape[0]):
        apart, axis = place - three(tables.arms, i, 0), three(tables.arms, i, 3)
        along = wp.dot(apart, axis)
        across = wp.length(apart - along * axis)
        if along >= 0.0 and along <= tables.arms[i, 6] and across <= tables.arms[i, 7]:
            return False
    return True


@wp.func
def is_diverged(qpos: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float), world: int) -> bool:
    """Return whether a world's state is no longer finite."""
    total = wp.float32(0.0)
    for i in range(qpos.shape[1]):
        total += wp.abs(qpos[world, i])
    for i in range(qvel.shape[1]):
        total += wp.abs(qvel[world, i])
    return not (total < MAX_SPEED)


@wp.kernel
def judge(
    robot: Robot,
    tables: Tables,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    xpos: wp.array2d(dtype=wp.vec3),
    xmat: wp.array2d(dtype=wp.mat33),
    sensors: wp.array2d(dtype=float),
    forces: wp.array2d(dtype=float),
    state: wp.array2d(dtype=float),
    outcome: wp.array(dtype=int),
    terms: wp.array2d(dtype=float),
):
    """Read, locate and judge running robots after a control step, and add to the reward's terms."""
    world = wp.tid()
    if outcome[world] != RUNNING:
        return
    if is_diverged(qpos, qvel, world):
        outcome[world] = DIVERGED
        return
    before, torque = float(state[world, DISTANCE]), three(state, world, TORQUE)
    read(robot, world, qpos, qvel, xpos, xmat, sensors, forces, state)
    locate(tables, state, world)
    s, tilt = state[world, DISTANCE], state[world, TILT]
    state[world, STEPS] = state[world, STEPS] + 1.0
    state[world, TIME] = state[world, STEPS] * robot.period
    slip, change = wp.float32(0.0), wp.float32(0.0)
    for i in range(3):
        slip += wp.abs(state[world, SLIP + i]) / 3.0
        change += wp.abs(state[world, TORQUE + i] - torque[i]) / 3.0
    terms[world, PROGRESS] = terms[world, PROGRESS] + (s - before) / robot.bore
    terms[world, TILTING] = terms[world, TILTING] + tilt * robot.period
    terms[world, SLIPPING] = terms[world, SLIPPING] + slip * robot.period / robot.bore
    terms[world, TORQUE_CHANGE] = terms[world, TORQUE_CHANGE] + change / state[world, TORQUE_LIMIT]
    state[world, WAITING] = state[world, WAITING] + robot.period
    if s > state[world, FARTHEST] + robot.progress:
        state[world, FARTHEST] = s
        state[world, WAITING] = 0.0
    hangs = state[world, WAITING] > state[world, PATIENCE]
    found = int(RUNNING)
    if is_outside(robot, tables, state, world):
        found = LEFT_PIPE
    if state[world, STEPS] >= state[world, MAX_STEPS]:
        found = TIMED_OUT
    if hangs or s < state[world, FARTHEST] - robot.slide_back:
        found = NO_HEADWAY
    if s >= state[world, GOAL]:
        found = REACHED_GOAL
        if wp.abs(wp.cos(tilt)) < robot.wedged_cosine:
            found = WEDGED
    outcome[world] = found


@wp.kernel
def end_decision(
    weights: wp.array(dtype=float),
    over: wp.array(dtype=int),
    outcome: wp.array(dtype=int),
    terms: wp.array2d(dtype=float),
    reward: wp.array(dtype=float),
    terminated: wp.array(dtype=bool),
    truncated: wp.array(dtype=bool),
    ending: wp.array(dtype=int),
):
    """Sum up the reward of a decision, and tell which episodes have ended in it."""
    world = wp.tid()
    found, was_over = outcome[world], over[world] == 1
    ended = found != RUNNING and not was_over
    terminated[world] = ended and found != TIMED_OUT
    truncated[world] = ended and found == TIMED_OUT
    ending[world] = wp.where(ended, found, RUNNING)
    if ended and found == REACHED_GOAL:
        terms[world, ARRIVAL] = 1.0
    if terminated[world] and found != REACHED_GOAL:
        terms[world, FAILURE] = 1.0
    total = wp.float32(0.0)
    for k in range(6):
        value = weights[k] * terms[world, k]
        if was_over or (found == DIVERGED and k != FAILURE):
            value = 0.0
        terms[world, k] = value
        total += value
    reward[world] = total


@wp.func
def put(entries: wp.array2d(dtype=float), world: int, begin: int, vector: wp.vec3) -> int:
    """Write three entries; returns where the next one goes."""
    for i in range(3):
        entries[world, begin + i] = vector[i]
    return begin + 3


@wp.func
def in_frame(frame: wp.mat33, vector: wp.vec3) -> wp.vec3:
    """Return a vector of the world in a frame."""
    return wp.transpose(frame) * vector


@wp.kernel
def observe(
    robot: Robot,
    tables: Tables,
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
    rows = three(state, world, ROTATION), three(state, world, ROTATION + 3)
    own = wp.matrix_from_rows(rows[0], rows[1], three(state, world, ROTATION + 6))
    about = wp.mat33(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
    frame = own * about
    limit, bore = state[world, SPEED_LIMIT], robot.bore
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
    n = put(
        entries, world, n, in_frame(frame, three(state, world, GRAVITY)) / robot.standard_gravity
    )
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
    n += 5
    s = state[world, DISTANCE]
    for i in range(KIND_SIZE):
        value = float(tables.kinds[passage, i])
        if i < 2:
            value = (value - s) / bore
        entries[world, n + i] = value
    n = put(entries, world, n + KIND_SIZE, in_frame(frame, three(state, world, TURNING)))
    n = put(entries, world, n, in_frame(frame, tangent_at(tables, s + AHEAD_1 * bore)))
    n = put(entries, world, n, in_frame(frame, tangent_at(tables, s + AHEAD_2 * bore)))
    n = put(entries, world, n, in_frame(frame, tangent_at(tables, s + AHEAD_3 * bore)))
    for i in range(3):
        k = (i + first) % 3
        entries[world, n + i] = state[world, NORMAL_FORCE + k] / state[world, WEIGHT]
        entries[world, n + 3 + i] = state[world, TRACTION + k] / state[world, WEIGHT]
        entries[world, n + 6 + i] = state[world, SLIP + k] / limit
        entries[world, n + 9 + i] = state[world, MODULE_SPEED + k] / limit
        for j in range(2):
            touches = state[world, CONTACT_COUNT + 2 * k + j] > 0.0
            entries[world, n + 12 + 2 * i + j] = wp.where(touches, 1.0, 0.0)
        entries[world, n + 18 + i] = state[world, PITCH + k]


@wp.kernel
def select(
    numbers: wp.array(dtype=int),
    ranges: wp.array2d(dtype=float),
    entries: wp.array2d(dtype=float),
    chosen: wp.array2d(dtype=float),
):
    """Write the entries that are observed, cut off at their ranges and within -1 and 1."""
    world, i = wp.tid()
    value, low, high = float(entries[world, numbers[i]]), ranges[i, 0], ranges[i, 1]
    if wp.isnan(value):
        value = 0.0
    chosen[world, i] = wp.clamp(value, low, high) / wp.max(wp.abs(low), wp.abs(high))


@wp.kernel
def draw(
    seeds: wp.array(dtype=int),
    episodes: wp.array(dtype=int),
    count: int,
    wanted: wp.array(dtype=bool),
    outcome: wp.array(dtype=int),
    start: wp.array(dtype=int),
):
    """Draw the starts of new episodes: by a world's seed and the number of its episode alone."""
    world = wp.tid()
    if wanted[world]:
        random = wp.rand_init(seeds[world], episodes[world])
        start[world] = wp.randi(random, 0, count)
        episodes[world] = episodes[world] + 1
        outcome[world] = RUNNING


@wp.kernel
def copy_rows(
    wanted: wp.array(dtype=bool),
    start: wp.array(dtype=int),
    source: wp.array2d(dtype=float),
    target: wp.array2d(dtype=float),
):
    """Copy the rows of starts to the worlds that begin anew."""
    world, i = wp.tid()
    if wanted[world]:
        target[world, i] = source[start[world], i]


@wp.kernel
def clear_rows(wanted: wp.array(dtype=bool), target: wp.array2d(dtype=float)):
    """Set the rows of worlds that begin anew to zero."""
    world, i = wp.tid()
    if wanted[world]:
        target[world, i] = 0.0


@wp.kernel
def mark(
    over: wp.array(dtype=int),
    terminated: wp.array(dtype=bool),
    truncated: wp.array(dtype=bool),
    at_once: bool,
    wanted: wp.array(dtype=bool),
):
    """Mark the worlds that begin anew: those that have ended, or that had before this decision."""
    world = wp.tid()
    if at_once:
        wanted[world] = terminated[world] or truncated[world]
    else:
        wanted[world] = over[world] == 1
