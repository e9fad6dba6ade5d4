"""Episodes of any robot on a device: places on routes, verdicts, rewards, and new beginnings.

What locates a robot on its route is translated from the processor's compiled functions; what the
processor states in arrays of NumPy (verdicts, terms of the reward) stands here once more, for one
robot, and is held against it by the tests.
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

import numpy as np
import warp as wp

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import centreline, route_map
from omnitrack_sim.robots.feature import AHEAD
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp.contacts import intrinsics
from omnitrack_sim.warp.translation import INT, INTS, REAL, REALS, Translation

wp.set_module_options({"enable_backward": False})

SIZES = {
    "position": 3,
    "rotation": 9,
    "angular_velocity": 3,
    "route": 1,
    "place": route_map.PLACE,
    "passage": 1,
    "slip": 1,
    "effort_change": 1,
    "waiting": 1,
    "farthest": 1,
    "steps": 1,
    "time": 1,
    "gravity": 3,
    "goal": 1,
    "patience": 1,
    "max_steps": 1,
}
"""Numbers that any robot has in its world's state beside MuJoCo's, in order: readings, location
(``route_map``'s place), slip and change of effort in a control step as the reward counts them, and
what belongs to the episode. Those of one kind of robot follow."""
(
    POSITION,
    ROTATION,
    SPIN,
    ROUTE,
    PLACE,
    PASSAGE,
    SLIP,
    EFFORT_CHANGE,
    WAITING,
    FARTHEST,
    STEPS,
    TIME,
    GRAVITY,
    GOAL,
    PATIENCE,
    MAX_STEPS,
    OWN,
) = accumulate(SIZES.values(), initial=0)
"""Where each begins, and where those of one kind of robot do."""
DISTANCE, OFFSET = PLACE + route_map.DISTANCE, PLACE + route_map.OFFSET
TILT, THETA5 = PLACE + route_map.TILT, PLACE + route_map.THETA5
ASIDE, TANGENT = PLACE + route_map.ASIDE, PLACE + route_map.TANGENT
TURNING = PLACE + route_map.TURNING
PROGRESS, TILTING, SLIPPING, CHANGE_OF_EFFORT, ARRIVAL, FAILURE = 0, 1, 2, 3, 4, 5
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
AHEAD_1, AHEAD_2, AHEAD_3 = AHEAD


@wp.struct
class Course:
    """Routes of the robots, and what their episodes end by.

    Tables are those of ``RouteMap.arrays``, lengths of routes, kinds of passages, and arms beside
    the routes.
    """

    segments: wp.array(dtype=float)
    lines: wp.array(dtype=int)
    passages: wp.array(dtype=float)
    spans: wp.array(dtype=int)
    lengths: wp.array(dtype=float)
    kinds: wp.array2d(dtype=float)
    arms: wp.array2d(dtype=float)
    period: float
    bore: float
    half_length: float
    progress: float
    slide_back: float
    wedged_cosine: float


def course_of(simulation: Simulation) -> Any:
    """Return the course of robots that the processor has seated."""
    routes, scenario = simulation.legs.routes, simulation.scenarios[0]
    segments, lines, passages, spans = routes.arrays
    robot, headway = scenario.robot, simulation.monitor.headway
    course, bore = Course(), robot.nominal_bore
    numbers = {"segments": segments, "passages": passages, "lengths": routes.lengths}
    for name, values in numbers.items():
        setattr(course, name, wp.array(values.ravel().astype(np.float32), dtype=float))
    for name, values in (("lines", lines), ("spans", spans)):
        setattr(course, name, wp.array(values.ravel().astype(np.int32), dtype=int))
    kinds = (
        *(routes.start, routes.end, routes.is_turn & ~routes.is_tee_turn, routes.into_branch),
        *(routes.out_of_branch, routes.is_straight_over, np.degrees(routes.turn) * routes.is_turn),
        *(bore / routes.bend_radius, routes.radius / (bore / 2) - 1),
    )
    course.kinds = wp.array(np.stack(kinds, axis=1).astype(np.float32), dtype=float)
    course.arms = wp.array(_arms(simulation), dtype=float)
    course.period, course.bore, course.half_length = simulation.period, bore, robot.length / 2
    course.progress, course.slide_back = headway.progress, headway.slide_back
    course.wedged_cosine = scenario.monitor.wedged_cosine
    return course


def _arms(simulation: Simulation) -> Array:
    """Return the arms (k, 8) of branched fittings: begin, direction, length and radius."""
    arms = []
    for part in simulation.scenarios[0].route.network.parts:
        ports = part.fitting.ports
        for name, port in ports.items() if len(ports) > 2 else ():
            axis = part.pose.rotation @ port.rotation[:, 2]
            length = float(np.linalg.norm(port.position))
            arms.append([*part.pose.position, *axis, length, part.fitting.port_radius(name)])
    return np.array(arms, np.float32).reshape(-1, ARM)


def _snippets() -> tuple[str, str]:
    """Return what locates a robot and looks along its route, in C++."""
    whole = Translation(intrinsics())
    kinds = [INT, REALS, INTS, REALS, INTS, INTS, REALS, REALS, REALS, INTS, REALS]
    locate = whole.function(route_map._locate, kinds).name
    segment = whole.function(centreline.segment_at, [REALS, INT, INT, REAL]).name
    place = whole.function(centreline.place_on, [REALS, REAL]).name
    head = f"struct Laws {{ typedef float real;\n{whole.members(locate, segment, place)}\n}};\n"
    locating = f"""{head}    float* row = &wp::index(state, world, 0);
    int route = (int)row[{ROUTE}], passage = 0;
    Laws::{locate}(
      1, course.segments.data, course.lines.data, course.passages.data, course.spans.data, &route,
      row + {POSITION}, row + {ROTATION}, row + {DISTANCE}, &passage, row + {PLACE});
    row[{PASSAGE}] = passage;"""
    looking = f"""{head}    float* segments = course.segments.data;
    const int* line = course.lines.data + 2 * route;
    const int here = Laws::{segment}(segments, line[0], line[1], s);
    const auto tangent = Laws::{place}(segments + {centreline.COLUMNS} * here, s).a1;
    return wp::vec_t<3, wp::float32>(tangent.a0, tangent.a1, tangent.a2);"""
    return locating, looking


_LOCATE, _LOOK = _snippets()


@wp.func_native(_LOCATE)
def locate(course: Course, state: wp.array2d(dtype=float), world: int):
    """Locate a robot on its route."""


@wp.func_native(_LOOK)
def tangent_at(course: Course, route: int, s: float) -> wp.vec3:
    """Return the direction of a route's centreline at an arc length, m."""


@wp.func
def three(values: wp.array2d(dtype=float), row: int, column: int) -> wp.vec3:
    """Return three numbers of a row as a vector."""
    return wp.vec3(values[row, column], values[row, column + 1], values[row, column + 2])


@wp.func
def read_pose(
    world: int,
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    origins: wp.array(dtype=wp.vec3d),
    state: wp.array2d(dtype=float),
):
    """Write a robot's position in the pipes, its rotation and rate of turning: a free joint's."""
    w, x, y, z = qpos[world, 3], qpos[world, 4], qpos[world, 5], qpos[world, 6]
    turn = wp.quat_to_matrix(wp.normalize(wp.quat(x, y, z, w)))
    for i in range(3):
        place = origins[world][i] + wp.float64(qpos[world, i])
        state[world, POSITION + i] = wp.float32(place)
        state[world, SPIN + i] = qvel[world, 3 + i]
        for k in range(3):
            state[world, ROTATION + 3 * i + k] = turn[i, k]


@wp.func
def rotation_of(state: wp.array2d(dtype=float), world: int) -> wp.mat33:
    """Return a robot's frame in the world."""
    rows = three(state, world, ROTATION), three(state, world, ROTATION + 3)
    return wp.matrix_from_rows(rows[0], rows[1], three(state, world, ROTATION + 6))


@wp.func
def is_outside(course: Course, state: wp.array2d(dtype=float), world: int) -> bool:
    """Return whether a robot has left its route, and is in no arm beside it either."""
    s, passage = state[world, DISTANCE], int(state[world, PASSAGE])
    length = course.lengths[int(state[world, ROUTE])]
    if s < -course.half_length or s > length + course.half_length:
        return True
    if state[world, OFFSET] <= course.passages[PASSAGE_SIZE * passage + PASSAGE_RADIUS]:
        return False
    place = three(state, world, POSITION)
    for i in range(course.arms.shape[0]):
        apart, axis = place - three(course.arms, i, 0), three(course.arms, i, 3)
        along = wp.dot(apart, axis)
        across = wp.length(apart - along * axis)
        if along >= 0.0 and along <= course.arms[i, 6] and across <= course.arms[i, 7]:
            return False
    return True


@wp.kernel
def end_diverged(
    qpos: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float), outcome: wp.array(dtype=int)
):
    """End the episodes of running robots whose state is no longer finite."""
    world = wp.tid()
    if outcome[world] != RUNNING:
        return
    total = wp.float32(0.0)
    for i in range(qpos.shape[1]):
        total += wp.abs(qpos[world, i])
    for i in range(qvel.shape[1]):
        total += wp.abs(qvel[world, i])
    if not (total < MAX_SPEED):
        outcome[world] = DIVERGED


@wp.kernel
def judge(
    course: Course,
    state: wp.array2d(dtype=float),
    outcome: wp.array(dtype=int),
    terms: wp.array2d(dtype=float),
):
    """Locate and judge running robots that have been read, and add to the reward's terms."""
    world = wp.tid()
    if outcome[world] != RUNNING:
        return
    before = float(state[world, DISTANCE])
    locate(course, state, world)
    s, tilt = state[world, DISTANCE], state[world, TILT]
    state[world, STEPS] = state[world, STEPS] + 1.0
    state[world, TIME] = state[world, STEPS] * course.period
    slip = state[world, SLIP] * course.period / course.bore
    terms[world, PROGRESS] = terms[world, PROGRESS] + (s - before) / course.bore
    terms[world, TILTING] = terms[world, TILTING] + tilt * course.period
    terms[world, SLIPPING] = terms[world, SLIPPING] + slip
    terms[world, CHANGE_OF_EFFORT] = terms[world, CHANGE_OF_EFFORT] + state[world, EFFORT_CHANGE]
    state[world, WAITING] = state[world, WAITING] + course.period
    if s > state[world, FARTHEST] + course.progress:
        state[world, FARTHEST] = s
        state[world, WAITING] = 0.0
    hangs = state[world, WAITING] > state[world, PATIENCE]
    found = int(RUNNING)
    if is_outside(course, state, world):
        found = LEFT_PIPE
    if state[world, STEPS] >= state[world, MAX_STEPS]:
        found = TIMED_OUT
    if hangs or s < state[world, FARTHEST] - course.slide_back:
        found = NO_HEADWAY
    if s >= state[world, GOAL]:
        found = REACHED_GOAL
        if wp.abs(wp.cos(tilt)) < course.wedged_cosine:
            found = WEDGED
    outcome[world] = found


@wp.kernel
def begin_decision(
    outcome: wp.array(dtype=int), over: wp.array(dtype=int), terms: wp.array2d(dtype=float)
):
    """Mark the worlds whose episodes are over already, and begin to add up terms anew."""
    world = wp.tid()
    over[world] = wp.where(outcome[world] == RUNNING, 0, 1)
    for k in range(6):
        terms[world, k] = 0.0


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
def copy_origins(
    wanted: wp.array(dtype=bool),
    start: wp.array(dtype=int),
    source: wp.array(dtype=wp.vec3d),
    target: wp.array(dtype=wp.vec3d),
):
    """Copy the origins of starts to the worlds that begin anew."""
    world = wp.tid()
    if wanted[world]:
        target[world] = source[start[world]]


@wp.kernel
def clear_rows(wanted: wp.array(dtype=bool), target: wp.array2d(dtype=float)):
    """Set the rows of worlds that begin anew to zero."""
    world, i = wp.tid()
    if wanted[world]:
        target[world, i] = 0.0


@wp.func
def in_frame(frame: wp.mat33, vector: wp.vec3) -> wp.vec3:
    """Return a vector of the world in a frame."""
    return wp.transpose(frame) * vector


@wp.func
def put(entries: wp.array2d(dtype=float), world: int, begin: int, vector: wp.vec3) -> int:
    """Write three entries; returns where the next one goes."""
    for i in range(3):
        entries[world, begin + i] = vector[i]
    return begin + 3


@wp.func
def put_route(
    course: Course,
    state: wp.array2d(dtype=float),
    world: int,
    frame: wp.mat33,
    entries: wp.array2d(dtype=float),
    begin: int,
) -> int:
    """Write ``feature.ROUTE``, the route ahead as seen in a frame; returns where the next goes."""
    s, n = state[world, DISTANCE], begin
    route, passage = int(state[world, ROUTE]), int(state[world, PASSAGE])
    for i in range(KIND_SIZE):
        value = float(course.kinds[passage, i])
        if i < 2:
            value = (value - s) / course.bore
        entries[world, n + i] = value
    n = put(entries, world, n + KIND_SIZE, in_frame(frame, three(state, world, TURNING)))
    ahead = wp.vec3(AHEAD_1, AHEAD_2, AHEAD_3) * course.bore
    for i in range(3):
        n = put(entries, world, n, in_frame(frame, tangent_at(course, route, s + ahead[i])))
    return n


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
