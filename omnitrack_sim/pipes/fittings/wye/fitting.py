"""A wye: a run with an oblique branch of equal or smaller bore; at 90 degrees the (reducing) tee.

Frame: run along z, centred at the origin; the branch leaves the origin along (sin a, 0, cos a).
Port frames have z out of the fitting and x towards the branch, or along the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array, Pose, unit
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import Wall
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    Arcs,
    Axis,
    AxisCurve,
    Bore,
    Description,
    Fitting,
    FittingTable,
    X,
    Y,
    Z,
    check,
    port_pose,
    positive,
)
from omnitrack_sim.pipes.fittings.wye import solids, walls
from omnitrack_sim.pipes.fittings.wye.exact import EQUAL, wye_signed_distance
from omnitrack_sim.pipes.fittings.wye.surface import clear, span, surface
from omnitrack_sim.pipes.kit import Kit, Solid
from omnitrack_sim.pipes.pieces import Pieces

ANGLES = (math.radians(45), math.radians(90))
"""Least and largest angle between branch and run, rad."""
LEAST_BRANCH = 0.4
"""Least diameter of the branch, in diameters of the run."""
CLEARANCE = 0.5
"""Least distance of an axis curve from the rim inside its turn, in radii of the branch."""


@dataclass(frozen=True)
class Wye(Fitting):
    """A run of ``run_length`` m with a branch that leans by ``angle`` rad from +z and ends
    ``branch_length`` m from the point where the axes meet.

    The rim's ``fillet_radius`` m is that of a ball that rolls inside the wall: the solid wall is
    opened by it.
    """

    run_length: float = 0.44
    branch_length: float = 0.22
    angle: float = math.pi / 4
    fillet_radius: float = 0.005
    inner_diameter: float = BORE
    branch_diameter: float = BORE
    kind: ClassVar[str] = "wye"
    port_names: ClassVar[tuple[str, ...]] = ("run_start", "run_end", "branch")
    default_way: ClassVar[tuple[str, str]] = ("run_start", "branch")
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
        """Keys in files."""

        run_length: Annotated[Size, Unit("m", "run")] = 0.44
        """Along the run, at least as long as the rim asks for."""
        branch_length: Annotated[Size, Unit("m", "branch")] = 0.22
        """From the run's axis."""
        angle_deg: Annotated[float, Field(ge=45, le=90), Unit("deg", "")] = 45.0
        """Between the branch and the run towards `run_end`; 45 to 90."""
        fillet_radius: Annotated[Size, Unit("m")] = 0.005
        """Of the rounded rim."""
        branch_diameter: Bore = BORE
        """Of the branch, 0.4 to 1 of `inner_diameter`, which is the run's."""

    def __post_init__(self) -> None:
        run, branch, fillet = self.inner_diameter, self.branch_diameter, self.fillet_radius
        apart = run - branch
        check(
            self.kind,
            inner_diameter=positive(run),
            angle=(
                ANGLES[0] - 1e-9 <= self.angle <= ANGLES[1] + 1e-9,
                f"is {math.degrees(self.angle):.6g} degrees; must be between 45 and 90",
            ),
            branch_diameter=(
                LEAST_BRANCH * run <= branch * (1 + 1e-9) and apart >= -2 * EQUAL,
                f"is {branch} m; must be between {LEAST_BRANCH * run:.6g} m and the run's {run} m",
            ),
            fillet_radius=(
                0 < fillet <= branch / 4,
                f"is {fillet} m; must be over 0 and at most a quarter of the branch's diameter",
            ),
            run_length=positive(self.run_length),
            branch_length=positive(self.branch_length),
        )
        half, far = self.least_lengths
        check(
            self.kind,
            run_length=(
                self.run_length / 2 >= half - 1e-12,
                f"is {self.run_length} m; the rim asks for at least "
                f"{math.ceil(2e5 * half) / 1e5:.5f} m",
            ),
            branch_length=(
                self.branch_length >= far - 1e-12,
                f"is {self.branch_length} m; the rim asks for at least "
                f"{math.ceil(1e5 * far) / 1e5:.5f} m",
            ),
        )

    @property
    def least_lengths(self) -> tuple[float, float]:
        """Least half run and branch length, m: how far the rim's fillet reaches along them at the
        crotch."""
        big, small = self.radius + self.fillet_radius, self.branch_radius + self.fillet_radius
        sin, cos = math.sin(self.angle), math.cos(self.angle)
        return (big * cos + small) / sin, (big + small * cos) / sin

    @property
    def branch_radius(self) -> float:
        """Bore radius of the branch, m."""
        return self.branch_diameter / 2

    @property
    def branch_axis(self) -> Array:
        """Unit vector (3,) along the branch, outward."""
        return np.array([math.sin(self.angle), 0.0, math.cos(self.angle)])

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``wye.surface``: lengths and radii, m, sine and cosine of the angle."""
        lengths = (self.run_length / 2, self.branch_length)
        radii = (self.radius, self.branch_radius, self.fillet_radius)
        return (*lengths, *radii, math.sin(self.angle), math.cos(self.angle))

    def bore_key(self, port: str) -> str:
        """See ``Fitting``."""
        return "branch_diameter" if port == "branch" else "inner_diameter"

    def port_radius(self, port: str) -> float:
        """See ``Fitting``."""
        return self.branch_radius if port == "branch" else self.radius

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``run_start`` at z < 0, ``run_end`` at z > 0, ``branch``; x towards the branch, or along
        the run."""
        half, out = self.run_length / 2, self.branch_axis
        along = np.array([-out[2], 0.0, out[0]])
        return {
            "run_start": port_pose(-Z, X, -half * Z),
            "run_end": port_pose(Z, X, half * Z),
            "branch": port_pose(out, along, self.branch_length * out),
        }

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``; the rounded rim included."""
        return wye_signed_distance(
            points, self.radius, self.branch_radius, self.fillet_radius, self.angle
        )

    def extent(self, points: Array) -> Array:
        """See ``Fitting``; each leg by its own ports, for the legs of an oblique wye cross the
        other's port planes.

        A point belongs to the branch where it is nearer to that bore's wall than to the run's, or
        less deep in the run.
        """
        p = np.asarray(points, float)
        x, y, z = np.moveaxis(p, -1, 0)
        out = self.branch_axis
        t, w = x * out[0] + z * out[2], x * out[2] - z * out[0]
        in_branch = (t > 0) & (np.hypot(y, w) - self.branch_radius < np.hypot(x, y) - self.radius)
        return np.where(in_branch, self.branch_length - t, self.run_length / 2 - np.abs(z))

    def turn_angle(self, enter: str, leave: str) -> float:
        """By how much the way from port ``enter`` to port ``leave`` turns, rad: 0, the angle, or
        180 degrees less it."""
        if "branch" not in (enter, leave):
            return 0.0
        return self.angle if "run_start" in (enter, leave) else math.pi - self.angle

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: a line over the run, or line, arc, line between run and branch.

        The arc is as wide as the two legs and the rim inside the turn leave room for.
        """
        start = self.ports[enter]
        tangent, half = -start.rotation[:, 2], self.run_length / 2
        turn = self.turn_angle(enter, leave)
        if turn == 0:
            return AxisCurve(start.position, tangent, X, ((self.run_length, 0.0),))
        wanted, first, last = (
            (arcs.turn, half, self.branch_length)
            if leave == "branch"
            else (arcs.merge, self.branch_length, half)
        )
        # An arc of radius q takes q tan(turn / 2) of either axis.
        slope = math.tan(turn / 2)
        onward = self.ports[leave].rotation[:, 2]
        normal = unit(onward - tangent * (onward @ tangent))
        radius = self._clear_of_rim(
            min(wanted, half / slope, self.branch_length / slope), tangent, normal, turn
        )
        cut = radius * slope
        lines = ((first - cut, 0.0), (radius * turn, 1 / radius), (last - cut, 0.0))
        return AxisCurve(
            start.position,
            tangent,
            normal,
            tuple(segment for segment in lines if segment[0] > 1e-12),
        )

    def _clear_of_rim(self, radius: float, tangent: Array, normal: Array, turn: float) -> float:
        """``radius`` m of an arc by ``turn`` rad, or the largest that stays ``CLEARANCE`` off the
        wall inside it."""
        around = np.linspace(0, turn, 97)[:, None]
        # Per metre of radius, from where the axes meet.
        arc = normal * (1 - np.cos(around)) + tangent * (np.sin(around) - math.tan(turn / 2))

        def is_clear(radius: float) -> bool:
            return bool(
                self.signed_distance(radius * arc)[0].min() >= CLEARANCE * self.branch_radius
            )

        if is_clear(radius):
            return radius
        low, high = 0.0, radius
        for _ in range(24):
            low, high = (middle, high) if is_clear(middle := (low + high) / 2) else (low, middle)
        return low

    def opening(self, enter: str) -> tuple[float, float]:
        """First and last arc length, m from port ``enter`` along its axis, beside the mouth between
        run and branch.

        Along the run the mouth (the sharp edge of the bores) is 2 r / sin a long, about R cot a
        from where the axes meet, towards the side the branch leans to. Out of the branch it begins
        where the crotch is and ends at the far wall of the run.
        """
        run, branch, sin, cos = (
            self.radius,
            self.branch_radius,
            math.sin(self.angle),
            math.cos(self.angle),
        )
        if enter == "branch":
            return self.branch_length - (run + branch * cos) / sin, self.branch_length + run / sin
        middle = self.run_length / 2 + (run if enter == "run_start" else -run) * cos / sin
        return middle - branch / sin, middle + branch / sin

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``."""
        run, half = self.radius, self.run_length / 2
        far, end = self.branch_length * self.branch_axis, self.branch_radius * self.branch_axis
        high = np.array([max(run, far[0] + end[2]), run, max(half, far[2] + end[0])])
        return np.array([-run, -run, -half]), high

    @property
    def axes(self) -> tuple[Axis, ...]:
        """See ``Fitting``: the run, and the branch from the run's axis."""
        run = AxisCurve(self.ports["run_start"].position, Z, X, ((self.run_length, 0.0),))
        branch = AxisCurve(np.zeros(3), self.branch_axis, Y, ((self.branch_length, 0.0),))
        return (
            Axis(run, self.radius, self.radius),
            Axis(branch, self.branch_radius, self.branch_radius),
        )

    def describe(self, enter: str, leave: str) -> Description:
        """See ``Fitting``."""
        first, last = self.opening(enter)
        opening = ((first + last) / 2, (last - first) / 2)
        if "branch" not in (enter, leave):
            return Description("over the run", "tee_straight", opening=opening)
        into = leave == "branch"
        return Description(
            "run to branch" if into else "branch to run",
            "tee_turn",
            into_branch=into,
            out_of_branch=not into,
            opening=opening,
            turn_angle=self.turn_angle(enter, leave),
        )

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves cut back along the rim, strips along it, capsules as the rim."""
        walls.add_walls(self, pieces, tolerance, staves)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        return walls.piece_count(self, tolerance, staves)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``."""
        return solids.fill(self, kit, more)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``."""
        return solids.fill(self, kit, 0.0, longer=kit.overcut)
