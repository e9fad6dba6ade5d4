"""Passages of a robot through the true pipes of its run, and when it has seen each of these.

Pictures show true pipes. A robot that explores has a map of its own, whose parts differ from the
true ones in number, order, names and sizes, and its legs lead through that: nothing here is taken
from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.sight import SIGHT
from omnitrack_sim.base.rotations import Array, dot, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.record.timeline import passage_indices
from omnitrack_sim.record.trajectory import Trajectory, spans
from omnitrack_sim.results.result import Result

SHADES = {
    "straight": "#f1f3f5",
    "elbow": "#d7e4f2",
    "reducer": "#e8dcec",
    "run to branch": "#f8dfbd",
    "branch to run": "#f3c9bb",
    "over the run": "#d3eadb",
}
"""Colours of the bands of parts over time, by manoeuvre."""
STEP = 0.02
"""Distance of the points along a line of sight, and travel between two looks, m: less than a port's
distance from any other, so that no part is overlooked."""


@dataclass(frozen=True)
class PassageSpan:
    """Samples in which a robot's centre passes one true part, on one leg and in one gear.

    Attributes:
        part: the part.
        words: how it is passed, such as "run to branch".
        first: its first sample.
        last: the first sample after it, or the last one of the run.
    """

    part: Part
    words: str
    first: int
    last: int

    @property
    def colour(self) -> str:
        """Colour of its band over time."""
        return SHADES.get(self.words, SHADES["straight"])


def passage_spans(result: Result, trajectory: Trajectory) -> list[PassageSpan]:
    """Return the passages of a run in order of time, by its record or the valid part of it."""
    leg, gear = trajectory["leg"].astype(int), trajectory["gear"]
    if result.map is None:
        routes = result.routes()
        place = passage_indices(trajectory, routes)
        runs = spans(leg, place, gear)
        passages = [routes[leg[first]].passages[place[first]] for first, _ in runs]
        parts = [(passage.part, passage.words) for passage in passages]
    else:
        position, every = trajectory["position"], result.pipes.parts
        inside, _ = _holders(every, position)
        runs = spans(leg, inside, gear)
        parts = [
            (every[inside[first]], _words(every[inside[first]], position[[first, last]]))
            for first, last in runs
        ]
    return [PassageSpan(*part, *rows) for part, rows in zip(parts, runs, strict=True)]


def _words(part: Part, ends: Array) -> str:
    """Return the passage of a part in words.

    It leads from the port nearest to the first of ``ends`` (2, 3) m, world frame, to another one
    nearest to the last.
    """
    names = part.fitting.port_names
    ports = np.array([part.port(name).position for name in names])
    far = np.linalg.norm(ends[:, None] - ports, axis=-1)  # (2, ports)
    enter = int(far[0].argmin())
    # A robot that backs out has not been at another port; the nearest one is where it was heading.
    far[1, enter] = np.inf
    description = part.fitting.describe(names[enter], names[int(far[1].argmin())])
    return description.words


@dataclass(frozen=True, eq=False)
class Landmarks:
    """True parts, plates and goals, and the first sample at which the map in a picture has each.

    The number of samples stands for what is never on it. A robot with a map has all parts and goals
    on it from the first sample on, and plates, which it does not know of, when its tip is there. A
    robot that explores has what has come into its sight: along its pipe to the end of the next
    fitting, as far as it can see.

    Attributes:
        parts: (P,) first sample of each part of the network.
        plates: (Q,) first sample of each plate of the scenario.
        goals: (G,) first sample of each goal.
        plate_rims: (Q, 25, 3) m, world frame.
        goal_points: (G, 3) m, world frame.
    """

    parts: NDArray[np.intp]
    plates: NDArray[np.intp]
    goals: NDArray[np.intp]
    plate_rims: Array
    goal_points: Array

    def count(self, row: int) -> int:
        """Return the number of parts, plates and goals that are on the map at a sample."""
        return sum(int((each <= row).sum()) for each in (self.parts, self.plates, self.goals))

    @classmethod
    def of(cls, result: Result, trajectory: Trajectory) -> Self:
        """Return the landmarks of a run, by its record or the valid part of it."""
        parts, exploration = result.pipes.parts, result.scenario.exploration
        never, rows = len(trajectory.time), _rows(trajectory)
        plates = result.plate_rims()
        points, part = _sight(result, trajectory, rows)  # (N, K, 3), (N, K), -1 unseen
        first = np.full(len(parts), never)
        lines, _ = np.nonzero(part >= 0)
        np.minimum.at(first, part[part >= 0], rows[lines])
        # The robot knows the pipe that it is in, even with its tip at the wall.
        np.minimum.at(first, _holders(parts, trajectory["position"][rows])[0], rows)
        seen = np.where(part[..., None] >= 0, points, np.inf)
        radius = result.scenario.robot.nominal_bore / 2

        def first_near(places: Array) -> NDArray[np.intp]:
            near = [np.linalg.norm(seen - place, axis=-1).min(axis=1) < radius for place in places]
            return np.array([rows[n.argmax()] if n.any() else never for n in near], np.intp)

        goals = result.goal_points()
        searches = exploration is not None and bool(exploration.mission.goals)
        return cls(
            np.zeros(len(parts), np.intp) if exploration is None else first,
            first_near(plates.mean(axis=1) if len(plates) else plates),
            first_near(goals) if searches else np.zeros(len(goals), np.intp),
            plates,
            goals,
        )

    @classmethod
    def none(cls, network: Assembly) -> Self:
        """Return pipes that are on the map from the first sample on, and nothing beside them."""
        nothing, parts = np.zeros(0, np.intp), np.zeros(len(network.parts), np.intp)
        return cls(parts, nothing, nothing, np.zeros((0, 25, 3)), np.zeros((0, 3)))


def _rows(trajectory: Trajectory) -> NDArray[np.intp]:
    """Rows (N,) about ``STEP`` of travel apart, the first and the last among them."""
    travel = np.linalg.norm(np.diff(trajectory["position"], axis=0), axis=1)
    marks = np.floor(np.cumsum(travel) / STEP)
    new = np.flatnonzero(np.diff(marks, prepend=0.0) > 0) + 1
    return np.unique(np.concatenate([[0], new, [len(trajectory.time) - 1]]))


def _sight(
    result: Result, trajectory: Trajectory, rows: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp]]:
    """Return points of the lines of sight from the leading tip, and their parts.

    Returns:
        Points (N, K, 3) m at ``rows`` (N,), and parts (N, K), -1 for those that are not seen.
    """
    parts, robot = result.pipes.parts, result.scenario.robot
    gear = np.where(trajectory["gear"][rows] < 0, -1.0, 1.0)[:, None]
    ahead = gear * matrix_from_quaternion(trajectory["quaternion"][rows])[:, :, 2]
    tip = trajectory["position"][rows] + robot.length / 2 * ahead
    inside, _ = _holders(parts, tip)
    for i in np.unique(inside):
        # Along a pipe one sees its end, even where one leans a little.
        if parts[i].fitting.is_plain:
            on = inside == i
            point, tangent, *_ = parts[i].axes[0][0].at(np.zeros(1))
            tip[on] = point + dot(tip[on] - point, tangent)[:, None] * tangent
            ahead[on] = np.sign(dot(ahead[on], tangent))[:, None] * tangent
    away = np.arange(0.0, _reach(result) + STEP, STEP)  # (K,) m
    points = tip[:, None] + away[:, None] * ahead[:, None]
    part, depth = _holders(parts, points)
    hidden = depth <= 0
    plain = np.array([part.fitting.is_plain for part in parts])
    # It does not look out of a fitting before it stands at the port.
    leaves = (np.diff(part, axis=1) != 0) & ~plain[part[:, :-1]] & (away[1:] > SIGHT.port)
    hidden[:, 1:] |= leaves
    for i, name in result.scenario.plates:
        port = parts[i].port(name)
        axis = port.rotation[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):  # of sight along the plate
            crossing = dot(port.position - tip, axis) / dot(ahead, axis)
            miss = np.linalg.norm(tip + crossing[:, None] * ahead - port.position, axis=1)
        meets = (crossing > 0) & (miss < parts[i].fitting.port_radius(name))
        hidden |= meets[:, None] & (away > crossing[:, None])
    return points, np.where(np.logical_or.accumulate(hidden, axis=1), -1, part)


def _reach(result: Result) -> float:
    """Range of sight beyond the robot's tip, m; 0 of a robot that has a map."""
    scenario = result.scenario
    if scenario.exploration is None:
        return 0.0
    if scenario.sensing.kind == "onboard":
        # With the recognition of fittings, which only explorers need.
        from omnitrack_sim.autonomy.camera_sight import CAMERA_SIGHT

        return CAMERA_SIGHT.reach * scenario.robot.nominal_bore
    return SIGHT.reach * scenario.robot.nominal_bore


def _holders(parts: Sequence[Part], points: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the part that each point (..., 3) m is in or nearest to, and the depth.

    Returns:
        Index (...,) of the part and depth (...,) m, negative outside.
    """
    index, deepest = np.zeros(points.shape[:-1], np.intp), np.full(points.shape[:-1], -np.inf)
    for i, part in enumerate(parts):
        depth = np.minimum(part.signed_distance(points)[0], part.extent(points))
        index[depth > deepest] = i
        deepest = np.maximum(deepest, np.where(np.isfinite(depth), depth, -np.inf))
    return index, deepest
