"""A cross: a run and a second pipe, of the same bore or a smaller one, through each other.

Frame: run along z, centred at the origin; the branch leaves the origin along (sin a, 0, cos a), the
opposite one against it. Half a turn about the y axis takes the cross to itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array, Pose, cross
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import FACE, Wall, compiled, in_bore, out_of_two, put
from omnitrack_sim.pipes.fittings.base import Axis, AxisCurve, Description, Y, in_bores, port_pose
from omnitrack_sim.pipes.fittings.wye import MIN_ANGLE_DEG, Wye
from omnitrack_sim.pipes.fittings.wye_surface import clip_leg, from_edge, in_branch, in_run
from omnitrack_sim.pipes.shapes import Kit, Pieces, Ring, Solid, stave_count

HALF_TURN = np.array([-1.0, 1.0, -1.0])
"""What half a turn about the y axis makes of the coordinates."""


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``; sizes, coordinates and edge as in ``wye_surface``.

    The wall shrunk by the fillet's ball is E = {A or more from the run's axis, B or more from the
    branches'}. No point of E is nearer to an axis than that, so the foot on a cylinder is nearest
    if it is on E; else one of the two edges is.
    """
    fillet, sin, cos = sizes[4], sizes[5], sizes[6]
    big, small = sizes[2] + fillet, sizes[3] + fillet
    # Half a turn brings every point to the side of the branch.
    turn = -1.0 if x * sin + z * cos < 0.0 else 1.0
    x, z = turn * x, turn * z
    t, w = x * sin + z * cos, x * cos - z * sin
    from_run, from_branch = math.sqrt(x * x + y * y), math.sqrt(y * y + w * w)
    deep = from_run >= big and from_branch >= small
    ox, oy = (x / from_run, y / from_run) if from_run > 0.0 else (0.0, 1.0)
    foot_w = big * ox * cos - z * sin
    onto_run = from_run <= big and big * big * oy * oy + foot_w * foot_w >= small * small
    # Deep in the wall the nearest face is that of the cylinder whose wall is less deep.
    if onto_run or (deep and from_run - big <= from_branch - small):
        put(out, -turn * ox, -oy, 0.0, FACE)
        return big - from_run - fillet
    if from_branch > 0.0:
        bw, by = w / from_branch, y / from_branch
    else:
        # On the branch's axis all feet are equally far: the one farthest from the run counts.
        bw = min(1.0, t * cos / (sin * small))
        by = math.sqrt(1.0 - bw * bw)
    foot_x, foot_y = t * sin + small * bw * cos, small * by
    if deep or (from_branch <= small and foot_x * foot_x + foot_y * foot_y >= big * big):
        put(out, -turn * bw * cos, -by, turn * bw * sin, FACE)
        return small - from_branch - fillet
    away = from_edge(big, small, sin, cos, x, y, z, out)
    gx, gy, gz, face = out[0], out[1], out[2], out[3]
    # At a right angle the opposite edge is the mirror image and never nearer.
    other = from_edge(big, small, sin, cos, -x, y, -z, out) if cos > 1e-12 else math.inf
    if other < away:
        away, gx, gy, gz, face = other, -out[0], out[1], -out[2], out[3]
    put(out, turn * gx, gy, turn * gz, face)
    return away - fillet


@compiled
def span(sizes, ends, px, py, pz, ax, ay, az, out):
    """See ``compiled.Wall``, and the wye's."""
    run_low, run_high = in_run(sizes, px, py, pz, ax, ay, az)
    low, high = in_branch(sizes, px, py, pz, ax, ay, az, sizes[1])
    clip_leg(-pz - sizes[0], -az, ends[0], low, high, out)
    clip_leg(pz - sizes[0], az, ends[1], low, high, out)
    t, along = px * sizes[5] + pz * sizes[6], ax * sizes[5] + az * sizes[6]
    clip_leg(t - sizes[1], along, ends[2], run_low, run_high, out)
    clip_leg(-t - sizes[1], -along, ends[3], run_low, run_high, out)
    return 1.0


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: up to where the line leaves both cylinders; the rim leaves more."""
    sin, cos = sizes[5], sizes[6]
    low, high = in_bore(px, py, ax, ay, sizes[2])
    w, across = px * cos - pz * sin, ax * cos - az * sin
    branch_low, branch_high = in_bore(w, py, across, ay, sizes[3])
    return out_of_two(low, high, branch_low, branch_high)


@dataclass(frozen=True)
class Cross(Wye):
    """A run of ``run_length`` m and two opposite branches at ``angle`` rad from it.

    Either branch ends ``branch_length`` m from the point where the axes meet.

    Between a run and a branch a robot turns as in a tee; it may also go straight on over the run,
    or across it from branch to branch.

    Example:
        >>> cross = ot.Cross(branch_diameter=0.12)
        >>> cross.describe("branch", "opposite").words
        'across the run'
    """

    run_length: float = in_bores(2)
    branch_length: float = in_bores(1)
    angle: float = math.pi / 2
    kind: ClassVar[str] = "cross"
    wall: ClassVar[Wall] = Wall(surface, span, clear)
    branches: ClassVar[tuple[str, ...]] = ("branch", "opposite")
    port_names: ClassVar[tuple[str, ...]] = ("run_start", "run_end", *branches)

    class Table(Wye.Table):
        """Keys in files."""

        run_length: Annotated[Size | None, Unit("m", "run")] = None
        """Along the run. Left out: 2 `inner_diameter`, or what the rim asks for."""
        branch_length: Annotated[Size | None, Unit("m", "branch")] = None
        """Of either branch, from the run's axis. Left out: `inner_diameter`, or what the rim asks
        for."""
        angle_deg: Annotated[float, Field(ge=MIN_ANGLE_DEG, le=90), Unit("deg", "")] = 90.0
        """Between the port `branch` and the run towards `run_end`; 30 to 90."""
        branch_diameter: Annotated[Size | None, Unit("m")] = None
        """Of both branches, 0.4 to 1 of `inner_diameter`, which is the run's. Left out:
        `inner_diameter`."""

    @property
    def ports(self) -> dict[str, Pose]:
        """As those of a wye, and ``opposite``; its x axis along the run, towards ``run_start``."""
        out = -self.branch_axis
        opposite = port_pose(out, cross(out, Y), self.branch_length * out)
        return {**super().ports, "opposite": opposite}

    @property
    def axes(self) -> tuple[Axis, ...]:
        """See ``Fitting``: the run, and the branches in one."""
        run, _ = super().axes
        start = self.branch_length * -self.branch_axis
        curve = AxisCurve(start, self.branch_axis, Y, ((2 * self.branch_length, 0.0),))
        return run, Axis(curve, self.branch_radius, self.branch_radius)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``."""
        _, high = super().bounds
        return -high, high

    def turn_angle(self, enter: str, leave: str) -> float:
        """See ``Branched``."""
        if (enter in self.branches) == (leave in self.branches):
            return 0.0
        acute = {enter, leave} in ({"run_start", "branch"}, {"run_end", "opposite"})
        return self.angle if acute else math.pi - self.angle

    def mouth(self, enter: str) -> tuple[float, float]:
        """See ``Branched``: of both branches together; out of a branch as in a wye."""
        if enter in self.branches:
            return super().mouth("branch")
        sin, cos = self.sin_cos
        return self.run_length / 2, (self.radius * cos + self.branch_radius) / sin

    def describe(self, enter: str, leave: str) -> Description:
        """See ``Fitting``."""
        description = super().describe(enter, leave)
        if enter not in self.branches or leave not in self.branches:
            return description
        sin, cos = self.sin_cos
        opening = self.branch_length, (self.radius + self.branch_radius * cos) / sin
        return replace(description, words="across the run", opening=opening)

    def extent(self, points: Array) -> Array:
        """See ``Branched``."""
        p = np.asarray(points, float)
        # Half a turn brings the side of the opposite branch to that of the branch.
        beyond = (p @ self.branch_axis < 0)[..., None]
        return super().extent(np.where(beyond, p * HALF_TURN, p))

    def mouth_at(self, middle: float, half_angle: float) -> tuple[float, float] | None:
        """See ``Branched``: of either branch."""
        one = super().mouth_at(middle, half_angle)
        other = super().mouth_at(middle + math.pi, half_angle)
        if other is None:
            return one
        low, high = -other[1], -other[0]
        return (low, high) if one is None else (min(one[0], low), max(one[1], high))

    def add_branches(self, pieces: Pieces, run_ring: Ring, branch_ring: Ring, depth: float) -> None:
        """See ``Branched``: once more after half a turn about the y axis."""
        side = Pieces()
        super().add_branches(side, run_ring, branch_ring, depth)
        pieces.add(side)
        pieces.add(side, Pose(np.diag(HALF_TURN)))

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``: the rim is there twice, and one more ring of staves of a branch."""
        around = staves or stave_count(self.radius, tolerance)
        return 2 * (super().piece_count(tolerance, staves) - around)

    def branch_solids(self, kit: Kit, more: float, longer: float) -> list[Solid]:
        """See ``Branched``: once more after half a turn about the y axis."""
        solids, turn = super().branch_solids(kit, more, longer), Pose(np.diag(HALF_TURN))
        return [*solids, *(kit.moved(solid, turn) for solid in solids)]
