"""From where a robot is seen best on its way through pipes that turn in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, cross, dot, unit
from omnitrack_sim.pipes import Part, Passage, Route
from omnitrack_sim.record.trajectory import Trajectory

DISTANCE = 0.68
"""From the robot's centre to the viewer, m."""
SPACING = 0.06
"""Travel between two neighbouring places for which a direction is chosen, m."""
SUN_UP, SUN_RIGHT = 0.55, -0.40
"""How far above the viewer, and to the right, the sun stands, in parts of the way to the viewer."""
WALL = 0.004
"""How far into its wall a pipe still hides what is behind it, m."""
_ELEVATIONS, _AZIMUTHS = np.radians([-15, 0, 15, 30, 45, 60]), np.radians(np.arange(0, 360, 22.5))
_NEAR = 0.08  # m before and behind a bend or tee in which the viewer looks across its plane, too
_SIGHT = np.linspace(0.16, 1.0, 8)  # places on the sight line, 0 at the robot and 1 at the viewer
_ALONG, _BEND, _LIKING, _HIDDEN, _TURN = 6.0, 1.0, 0.3, 4.0, 1.5  # weights
_FREE = 0.25  # cosine to the pipe's axis below which one looks across it well enough


def view_directions(trajectory: Trajectory, routes: Sequence[Route], liking: ArrayLike) -> Array:
    """Unit vectors (T, 3), world frame, from the robot to the viewer, which change slowly.

    Of a set of directions up to 60 degrees above the horizon the cheapest sequence is taken. A
    direction is cheap if it looks across the pipe's axis and across the plane of a bend or tee, not
    through other pipes, and lies near ``liking``; turning costs, too.

    Args:
        trajectory: the record.
        routes: of each leg.
        liking: (3,) direction to prefer where nothing speaks against it.
    """
    liking = unit(liking)
    rows, travel = _nodes(trajectory)
    choices = np.concatenate([liking[None], _sphere()])
    tangent, plane = _geometry(trajectory, routes, rows)
    along = np.maximum(np.abs(tangent @ choices.T) - _FREE, 0.0) ** 2
    bend = np.where((plane != 0).any(axis=1)[:, None], 1 - (plane @ choices.T) ** 2, 0.0)
    hidden = _hidden(routes[0].network.parts, trajectory["position"][rows], choices)
    cost = _ALONG * along + _BEND * bend + _HIDDEN * hidden + _LIKING * (1 - choices @ liking)
    turn = np.arccos(np.clip(choices @ choices.T, -1, 1)) ** 2
    chosen = choices[_cheapest(cost, _TURN * turn)]
    for _ in range(4):
        padded = np.concatenate([chosen[:1], chosen, chosen[-1:]])
        chosen = unit(padded[:-2] + 2 * padded[1:-1] + padded[2:])
    return unit(np.stack([np.interp(travel, travel[rows], column) for column in chosen.T], axis=-1))


def upright(back: Array) -> tuple[Array, Array]:
    """Right and up (3,), of a picture that is seen from the direction ``back`` (3,)."""
    right = unit(np.cross([0.0, 0.0, 1.0], back))
    return right, np.cross(back, right)


def over_the_shoulder(back: Array, right: Array, up: Array) -> Array:
    """Direction (3,) to a sun that stands over the shoulder of a viewer in the direction ``back``
    (3,), whose picture has these directions (3,)."""
    return unit(back + SUN_UP * up + SUN_RIGHT * right)


def in_the_way(parts: Sequence[Part], eye: Array, targets: Array) -> Array:
    """How far each part (P,) stands between ``eye`` (3,) m and ``targets`` (k, 3) m: 0 not at all,
    1 in full.

    A part with a target in its bore is not in the way.
    """
    steps = np.linspace(0.0, 1.0, 14)[:, None, None]
    points = (targets + steps * (eye - targets)).reshape(-1, 3)
    found = np.zeros(len(parts))
    for i, part in enumerate(parts):
        if not (_depth(part, targets) > WALL).any():
            found[i] = np.clip(_depth(part, points).max() / (0.25 * part.fitting.radius), 0.0, 1.0)
    return found


def _depth(part: Part, points: Array) -> Array:
    """How deep ``points`` (..., 3) m lie within the outside of a part, m; negative outside."""
    return np.minimum(part.signed_distance(points)[0], part.extent(points)) + WALL


def _sphere() -> Array:
    """Directions (n, 3) on rings of equal elevation."""
    up, around = (angle.ravel() for angle in np.meshgrid(_ELEVATIONS, _AZIMUTHS, indexing="ij"))
    return np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)


def _nodes(trajectory: Trajectory) -> tuple[NDArray[np.intp], Array]:
    """Rows (N,) about ``SPACING`` of travel apart, and the travel (T,) m of all samples.

    The travel always grows by a little, so that it can be interpolated where the robot stands
    still.
    """
    step = np.abs(np.diff(trajectory["distance"]))
    step = np.where((np.diff(trajectory["leg"]) == 0) & np.isfinite(step), step, 0.0)
    travel = np.append(0.0, np.cumsum(step + 1e-9))
    grid = np.arange(0.0, travel[-1] + SPACING, SPACING)
    rows = np.unique(
        np.append(np.searchsorted(travel, grid).clip(0, len(travel) - 1), len(travel) - 1)
    )
    return rows[np.isfinite(trajectory["position"][rows]).all(axis=1)], travel


def _geometry(
    trajectory: Trajectory, routes: Sequence[Route], rows: NDArray[np.intp]
) -> tuple[Array, Array]:
    """For each row the centreline's tangent and the normal of a bend's or tee's plane, (N, 3).

    The normal is 0 away from bends and tees.
    """
    tangent, plane = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    for index, route in enumerate(routes):
        on = np.flatnonzero(trajectory["leg"][rows] == index)
        distance = trajectory["distance"][rows[on]]
        tangent[on] = route.centreline.at(distance)[1]
        for passage in route.passages:
            if passage.asks_orientation:
                here = (distance > passage.s_enter - _NEAR) & (distance < passage.s_leave + _NEAR)
                plane[on[here]] = _normal(route, passage)
    return tangent, plane


def _normal(route: Route, passage: Passage) -> Array:
    """Normal (3,) of the plane that a bend or tee lies in."""
    entry = route.centreline.at(np.array([passage.s_enter]))[1]
    return unit(cross(entry, passage.turn_direction[None]))[0]


def _hidden(parts: Sequence[Part], centres: Array, choices: Array) -> Array:
    """Part (N, C) of the sight line from ``centres`` (N, 3) m in direction ``choices`` (C, 3)
    within other parts."""
    hidden = np.zeros((len(centres), len(choices)))
    for part in parts:
        samples = part.bore_samples()
        middle = (samples.max(axis=0) + samples.min(axis=0)) / 2
        reach = np.sqrt(dot(samples - middle, samples - middle).max()) + DISTANCE
        near = np.flatnonzero(np.linalg.norm(centres - middle, axis=1) < reach)
        near = near[_depth(part, centres[near]) <= WALL]
        if len(near):
            points = (
                centres[near][:, None, None] + DISTANCE * _SIGHT[:, None] * choices[:, None]
            )  # (n, C, k, 3)
            hidden[near] += (_depth(part, points) > 0).mean(axis=-1)
    return np.minimum(hidden, 1.0)


def _cheapest(cost: Array, turn: Array) -> NDArray[np.intp]:
    """Indices (N,) of the cheapest sequence of choices.

    A choice costs ``cost`` (N, C) at each place, and going on to another one at the next place
    costs ``turn`` (C, C).
    """
    total, came = cost[0], np.zeros(cost.shape, np.intp)
    for i in range(1, len(cost)):
        step = total[:, None] + turn
        came[i] = step.argmin(axis=0)
        total = step.min(axis=0) + cost[i]
    chosen = np.zeros(len(cost), np.intp)
    chosen[-1] = total.argmin()
    for i in range(len(cost) - 1, 0, -1):
        chosen[i - 1] = came[i, chosen[i]]
    return chosen
