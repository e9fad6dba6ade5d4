"""Contact of modules with the wall during a turn in a tee, in the exact two-cylinder geometry.

Two bores of radius R, a run along z and a branch that leaves it at the turn angle delta in the
plane of x and z; the edge where they meet is sharp. The robot is an axis and, around it, modules
that are lines of length L parallel to it. A module pushes straight outward until the first point of
its line meets the wall; it touches if that is within the reach rho. The robot comes up the run; its
axis follows a given path.

Tee frame: y across the plane of the turn, origin where the axes meet. A module's angle is measured
about the robot axis from the turning direction, theta5 for module 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.base.rotations import Array

_Y = np.array([0.0, 1.0, 0.0])
# Angles from the outer direction.
_OFFSETS = np.radians(np.concatenate([np.arange(0, 100, 0.25), np.arange(100, 181, 2)]))
_BLOCK = 8000
"""Distances that are found at once: their arrays stay in the processor's cache, 2.5 times as fast
as all of half a million."""


@dataclass(frozen=True)
class TeePath:
    """Path of a robot's axis through a tee, T poses.

    Attributes:
        centre: (T, 3) m, robot centre, tee frame.
        axis: (T, 3) unit vectors along the robot, in the plane of the turn.
        turn_angle: delta, rad, between the run's and the branch's direction.
    """

    centre: Array
    axis: Array
    turn_angle: float = np.pi / 2

    @property
    def turned(self) -> Array:
        """Angle (T,) rad of the robot's axis from the run's."""
        return np.arctan2(self.axis[:, 0], self.axis[:, 2])

    @property
    def turning_direction(self) -> Array:
        """Unit vectors (T, 3) across the axis in the plane of the turn, towards the branch."""
        return np.cross(_Y, self.axis)


def turn_path(bend_radius: float, turn_angle: float = np.pi / 2, poses: int = 721) -> TeePath:
    """The arc of radius ``bend_radius`` m from the axis of the run to that of the branch.

    Its ``poses`` are equal steps of angle apart. With bend_radius = R the centre of the arc is the
    inner vertex of the tee's edge: the robot pivots about the crotch at the distance R. Larger
    radii cut the corner.
    """
    turned = np.linspace(0.0, turn_angle, poses)
    zero = np.zeros(poses)
    inward = np.stack([np.cos(turned), zero, -np.sin(turned)], axis=-1)
    axis = np.stack([np.sin(turned), zero, np.cos(turned)], axis=-1)
    # The arc touches both axes at bend_radius tan(delta / 2) from where they meet.
    pivot = bend_radius * np.array([1.0, 0.0, -np.tan(turn_angle / 2)])
    return TeePath(pivot - bend_radius * inward, axis, turn_angle)


def outer_sector(
    path: TeePath, reach: ArrayLike, pipe_radius: float, contact_length: float
) -> Array:
    """Angle (...,) rad of the sector about the outer direction in which a module loses the wall.

    A module in it has no wall somewhere on the path. The counterpart of ``sector_angle``.
    Between directions a quarter of a degree apart the needed reach is interpolated. It has a sharp
    peak along the turn: with 721 poses of a right angle the sector is within 0.05 degrees of its
    limit, with 181 within 0.5. There may be further directions without contact, apart from this
    sector: see ``TurnCase.wall_distance``.

    Args:
        path: T poses.
        reach: rho (...,), m.
        pipe_radius: R, m.
        contact_length: L, m.
    """
    # The pose in which the wall is farthest away decides for the whole path.
    needed = wall_distance(path, np.pi - _OFFSETS, pipe_radius, contact_length).max(axis=0)
    # Going out from the outer direction, the sector ends where the needed reach first falls to rho.
    least = np.minimum.accumulate(np.minimum(needed, 1e6 * pipe_radius))
    return 2 * np.interp(-np.asarray(reach, float), -least, _OFFSETS)


def wall_distance(
    path: TeePath, module_angle: ArrayLike, pipe_radius: float, contact_length: float
) -> Array:
    """Distance (T, *A) m from the robot axis at which a module first meets the wall.

    It is infinite where the module looks through an open end. Along the module the distance to the
    wall is concave except where it crosses the edge, so its least value is at an end of the line or
    on the edge. These few points are tried; nothing is sampled.

    Args:
        path: T poses.
        module_angle: (*A,) rad from the turning direction.
        pipe_radius: R, m.
        contact_length: L, m; 0 is a point contact. A line whose end on the robot axis lies outside
            the bores gives 0.
    """
    angle = np.asarray(module_angle, float)
    poses = max(_BLOCK // max(angle.size, 1), 1)
    if len(path.axis) > poses:
        some = (slice(i, i + poses) for i in range(0, len(path.axis), poses))
        blocks = [TeePath(path.centre[k], path.axis[k], path.turn_angle) for k in some]
        return np.concatenate(
            [wall_distance(block, angle, pipe_radius, contact_length) for block in blocks]
        )
    shape = (len(path.axis), *(1,) * angle.ndim)
    centre, axis, inward = (
        v.reshape(*shape, 3) for v in (path.centre, path.axis, path.turning_direction)
    )
    centre = centre / pipe_radius  # from here on lengths are in pipe radii
    outward = np.cos(angle)[..., None] * inward + np.sin(angle)[..., None] * _Y  # (T, *A, 3)
    half = contact_length / pipe_radius / 2
    bores = _Bores(path.turn_angle)
    distance = np.minimum(*(bores.exit(centre + s * axis, outward) for s in (-half, half)))
    for along, reach in bores.edge_crossings(centre, axis, outward):
        within = (np.abs(along) <= half) & (reach > 0)
        foot = centre + np.where(within, along, 0.0)[..., None] * axis
        distance = np.where(
            within, np.minimum(distance, np.minimum(bores.exit(foot, outward), reach)), distance
        )
    return distance * pipe_radius


class _Bores:
    """Union of the bores of run and branch, radius 1."""

    def __init__(self, turn_angle: float):
        # Unit vectors across the axes in the plane of the turn, and along the branch.
        self.across_run = np.array([1.0, 0.0, 0.0])
        self.across_branch = np.array([np.cos(turn_angle), 0.0, -np.sin(turn_angle)])
        self.branch = np.array([np.sin(turn_angle), 0.0, np.cos(turn_angle)])

    def exit(self, start: Array, direction: Array) -> Array:
        """Length (...,) of rays from ``start`` (..., 3) to where they leave the union.

        It is 0 for rays that start outside.
        """
        run_in, run_out = _through_cylinder(start, direction, self.across_run)
        branch_in, branch_out = self._through_branch(start, direction)
        in_run, in_branch = (run_in <= 0) & (run_out >= 0), (branch_in <= 0) & (branch_out >= 0)
        first = np.where(in_run, run_out, np.where(in_branch, branch_out, 0.0))
        # The ray goes on in the other bore if it is inside that one when it leaves the first.
        on_in_branch = in_run & (branch_in <= first) & (branch_out > first)
        on_in_run = ~in_run & in_branch & (run_in <= first) & (run_out > first)
        return np.where(on_in_branch, branch_out, np.where(on_in_run, run_out, first))

    def _through_branch(self, start: Array, direction: Array) -> tuple[Array, Array]:
        """Distances at which rays enter and leave the branch's half of its cylinder."""
        enter, leave = _through_cylinder(start, direction, self.across_branch)
        height, slope = start @ self.branch, direction @ self.branch
        # A ray across the branch never crosses its end plane: inside for ever, or never.
        safe = np.where(slope == 0, 1.0, slope)
        crossing = np.where(slope == 0, np.where(height >= 0, -np.inf, np.inf), -height / safe)
        rising = slope >= 0
        return np.where(rising, np.maximum(enter, crossing), enter), np.where(
            rising, leave, np.minimum(leave, crossing)
        )

    def edge_crossings(
        self, centre: Array, axis: Array, outward: Array
    ) -> list[tuple[Array, Array]]:
        """Intersections of the plane of axis and module with the edge.

        Pairs (along the axis, outward); infinite where they do not meet. On the edge the point is
        as far across the run as across the branch: it lies in one of the two planes that bisect
        them, which the plane (centre + s axis + q outward) meets in a line, and on the run's
        cylinder.
        """
        crossings = []
        for normal in (self.across_run - self.across_branch, self.across_run + self.across_branch):
            # A point and the direction, in (s, q), of the line normal . (centre + s axis +
            # q outward) = 0.
            a, b, c = axis @ normal, outward @ normal, centre @ normal
            size = a * a + b * b
            # Parallel planes have no line in common; 1e-24 is rounding of unit vectors, squared.
            ok = size > 1e-24
            size = np.where(ok, size, 1.0)
            s0, q0, ds, dq = -a * c / size, -b * c / size, -b, a
            start = centre + s0[..., None] * axis + q0[..., None] * outward
            direction = ds[..., None] * axis + dq[..., None] * outward
            for t in _through_cylinder(start, direction, self.across_run):
                met = ok & np.isfinite(t)
                t = np.where(met, t, 0.0)
                at = start + t[..., None] * direction
                # The branch is half a cylinder: what lies behind its end is no edge.
                met &= at @ self.branch >= 0
                crossings.append(
                    (np.where(met, s0 + t * ds, np.inf), np.where(met, q0 + t * dq, np.inf))
                )
        return crossings


def _through_cylinder(start: Array, direction: Array, across: Array) -> tuple[Array, Array]:
    """Parameters t at which lines start + t direction enter and leave a cylinder of radius 1."""
    sx, sy, dx, dy = start @ across, start[..., 1], direction @ across, direction[..., 1]
    a, b, c = dx * dx + dy * dy, sx * dx + sy * dy, sx * sx + sy * sy - 1.0
    # A line along the axis has no crossing to solve for: it is inside for ever, or never.
    along = a < 1e-24
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    safe = np.where(along, 1.0, a)
    enter, leave = (-b - root) / safe, (-b + root) / safe
    misses = np.where(along, c > 0, b * b < a * c)
    enter = np.where(along, -np.inf, enter)
    leave = np.where(along, np.inf, leave)
    return np.where(misses, np.inf, enter), np.where(misses, -np.inf, leave)
