"""Straight, reducer, elbow and tee: sizes, ports, axis curves and the exact inner surface.

Frames: a straight or reducer runs along +z from the origin; an elbow enters along +z at the origin
and bends towards +x; a tee has its run along z, centred at the origin, and its branch along +x.
Port frames have z out of the fitting.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from omnitrack_sim.errors import Fault, GeometryError
from omnitrack_sim.pipes.saddle import tee_signed_distance
from omnitrack_sim.rotations import Array, Pose

Bend = tuple[float, float]
"""Length m and curvature 1/m of one segment of an axis curve."""


class TeeArcs(NamedTuple):
    """Radii, m, of the arcs that the centreline takes between run and branch; a short tee gets as
    much as fits it.

    Out of a branch the far wall of the run turns the robot while its tail is still in the branch: a
    wide arc, which begins to turn early and turns slowly, passes more often there; into a branch a
    tight one (docs/tee-turn.md).
    """

    turn: float = 0.09
    merge: float = 0.14


TEE_ARCS = TeeArcs()


@dataclass(frozen=True)
class Path:
    """The axis curve from one port to another, fitting frame: start point, direction, bending side,
    segments."""

    point: Array
    tangent: Array
    normal: Array
    segments: tuple[Bend, ...]


def _check(kind: str, **conditions: tuple[bool, str]) -> None:
    faults = [Fault(name, message) for name, (ok, message) in conditions.items() if not ok]
    if faults:
        raise GeometryError([Fault(f"{kind}.{f.where}", f.problem) for f in faults])


def _port(z: Array, x: Array, position: Array) -> Pose:
    return Pose(np.stack([x, np.cross(z, x), z], axis=-1), position)


_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True)
class Fitting:
    """What all fittings share: a bore of ``inner_diameter`` m, the same at all ports but for the
    reducer's."""

    kind: ClassVar[str]
    choices: ClassVar[tuple[str, ...]]

    @property
    def radius(self) -> float:
        """Bore radius, m; of a reducer that at ``start``."""
        return self.inner_diameter / 2  # type: ignore[attr-defined]

    def port_radius(self, port: str) -> float:
        """Bore radius at a port, m."""
        return self.radius

    @property
    def largest_radius(self) -> float:
        """Bore radius at the widest port, m."""
        return max(self.port_radius(port) for port in self.choices)

    @property
    def ports(self) -> Mapping[str, Pose]:
        """Port frames in the fitting frame, z outward."""
        raise NotImplementedError

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (...,) m from ``points`` (..., 3) m to the inner surface; its unit gradient
        (..., 3).

        Fitting frame, positive in the bore.
        Exact inside the bore and in the wall near it; the fitting is taken as open at its ports.
        """
        raise NotImplementedError

    def extent(self, points: Array) -> Array:
        """How far (...,) m ``points`` (..., 3) m lie inside the port planes, fitting frame;
        negative beyond one."""
        raise NotImplementedError

    def path(self, enter: str, leave: str, arcs: TeeArcs) -> Path:
        """Axis curve from port ``enter`` to port ``leave``; ``arcs`` round the corner of a tee."""
        raise NotImplementedError


@dataclass(frozen=True)
class _Axial(Fitting):
    """A fitting whose only axis is a line of ``length`` m along +z from the origin."""

    length: float
    choices: ClassVar[tuple[str, ...]] = ("start", "end")

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` at z = length."""
        return {"start": _port(-_Z, _X, np.zeros(3)), "end": _port(_Z, _X, self.length * _Z)}

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        z = np.asarray(points, float)[..., 2]
        return np.minimum(z, self.length - z)

    def path(self, enter: str, leave: str, arcs: TeeArcs) -> Path:
        """See ``Fitting``."""
        sign = 1.0 if enter == "start" else -1.0
        return Path(self.ports[enter].position, sign * _Z, _X, ((self.length, 0.0),))


@dataclass(frozen=True)
class Straight(_Axial):
    """A straight pipe of ``length`` m."""

    inner_diameter: float = 0.16
    kind: ClassVar[str] = "straight"

    def __post_init__(self) -> None:
        _check(
            self.kind,
            length=(self.length > 0, f"is {self.length} m; must be positive"),
            inner_diameter=(
                self.inner_diameter > 0,
                f"is {self.inner_diameter} m; must be positive",
            ),
        )

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``: R minus the distance from the axis."""
        across = np.array(points, float)
        across[..., 2] = 0.0
        return _bore_distance(across, self.radius)


STEEPEST_CONE = math.radians(20)
"""Largest half cone angle of a reducer, rad."""


@dataclass(frozen=True)
class Reducer(_Axial):
    """A concentric cone of ``length`` m from ``inner_diameter`` m at ``start`` to ``end_diameter``
    m at ``end``."""

    end_diameter: float
    inner_diameter: float = 0.16
    kind: ClassVar[str] = "reducer"

    def __post_init__(self) -> None:
        sizes = {name: getattr(self, name) for name in ("length", "inner_diameter", "end_diameter")}
        _check(
            self.kind,
            **{name: (size > 0, f"is {size} m; must be positive") for name, size in sizes.items()},
        )
        least = abs(self.end_diameter - self.inner_diameter) / 2 / math.tan(STEEPEST_CONE)
        angle = math.degrees(math.atan(abs(self.slope)))
        steepest = math.degrees(STEEPEST_CONE)
        _check(
            self.kind,
            end_diameter=(
                self.end_diameter != self.inner_diameter,
                f"is {self.end_diameter} m, as inner_diameter is; use a straight",
            ),
            length=(
                self.length >= least,
                f"is {self.length} m, a half cone angle of {angle:.3g} degrees; at most "
                f"{steepest:g} degrees are "
                f"possible, so at least {math.ceil(1e5 * least) / 1e5:.5f} m",
            ),
        )

    @property
    def slope(self) -> float:
        """Growth of the bore radius along +z, m/m: the tangent of the half cone angle, negative
        where it narrows."""
        return (self.end_diameter - self.inner_diameter) / 2 / self.length

    def port_radius(self, port: str) -> float:
        """See ``Fitting``."""
        return self.end_diameter / 2 if port == "end" else self.radius

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``: to the cone between the port planes, so to its edge where that is nearer
        than the rest."""
        points = np.asarray(points, float)
        x, y, z = np.moveaxis(points, -1, 0)
        from_axis, slope = np.hypot(x, y), self.slope
        cosine = 1 / math.hypot(1.0, slope)
        outward = np.where((from_axis > 0)[..., None], points * [1, 1, 0], _X)
        outward = outward / np.where(from_axis > 0, from_axis, 1.0)[..., None]
        # In the half plane through the axis and the point the wall is a straight line.
        distance = cosine * (self.radius + slope * z - from_axis)
        foot = z - slope * cosine * distance
        edge = np.clip(foot, 0.0, self.length)
        across, along = from_axis - self.radius - slope * edge, z - edge
        away = np.copysign(np.hypot(across, along), distance)
        safe = np.where(away == 0, 1.0, away)[..., None]
        on_cone = (foot == edge)[..., None]
        from_edge = (across[..., None] * outward + along[..., None] * _Z) / safe
        gradient = np.where(on_cone, cosine * (slope * _Z - outward), from_edge)
        return np.where(foot == edge, distance, away), gradient


@dataclass(frozen=True)
class Elbow(Fitting):
    """A bend of ``angle`` rad with the axis on a circle of ``mean_radius`` m; at least R, at most
    180 degrees."""

    mean_radius: float
    angle: float = math.pi / 2
    inner_diameter: float = 0.16
    kind: ClassVar[str] = "elbow"
    choices: ClassVar[tuple[str, ...]] = ("start", "end")

    def __post_init__(self) -> None:
        radius = self.inner_diameter / 2
        _check(
            self.kind,
            inner_diameter=(
                self.inner_diameter > 0,
                f"is {self.inner_diameter} m; must be positive",
            ),
            mean_radius=(
                self.mean_radius >= radius,
                f"is {self.mean_radius} m; must be at least the pipe radius of {radius} m",
            ),
            angle=(
                0 < self.angle <= math.pi,
                f"is {math.degrees(self.angle):.6g} degrees; must be over 0, at most 180",
            ),
        )

    @property
    def _end_axes(self) -> tuple[Array, Array]:
        """Tangent and inward normal at the end."""
        s, c = math.sin(self.angle), math.cos(self.angle)
        return np.array([s, 0, c]), np.array([c, 0, -s])

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` where the bend ends; x towards the centre of the
        bend."""
        tangent, normal = self._end_axes
        return {
            "start": _port(-_Z, _X, np.zeros(3)),
            "end": _port(tangent, normal, self.mean_radius * (_X - normal)),
        }

    def _torus(self, points: Array) -> tuple[Array, Array]:
        """Vector (..., 3) from the axis circle to each point, and the angle (...,) along the
        bend."""
        p = np.asarray(points, float) - self.mean_radius * _X
        flat = p * [1, 0, 1]
        distance = np.linalg.norm(flat, axis=-1, keepdims=True)
        outward = np.where(distance > 0, flat / np.where(distance > 0, distance, 1.0), -_X)
        return p - self.mean_radius * outward, np.arctan2(p[..., 2], -p[..., 0])

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``: R minus the distance from the axis circle."""
        return _bore_distance(self._torus(points)[0], self.radius)

    def extent(self, points: Array) -> Array:
        """See ``Fitting``; measured along the axis circle."""
        _, angle = self._torus(points)
        # Angles behind the start belong to whichever port plane is nearer.
        behind = (angle < 0) & (angle < self.angle / 2 - math.pi)
        angle = np.where(behind, angle + 2 * math.pi, angle)
        return self.mean_radius * np.minimum(angle, self.angle - angle)

    def path(self, enter: str, leave: str, arcs: TeeArcs) -> Path:
        """See ``Fitting``."""
        arc = ((self.mean_radius * self.angle, 1 / self.mean_radius),)
        if enter == "start":
            return Path(np.zeros(3), _Z, _X, arc)
        tangent, normal = self._end_axes
        return Path(self.ports["end"].position, -tangent, normal, arc)


@dataclass(frozen=True)
class Tee(Fitting):
    """An equal tee: run of ``run_length`` m, branch that ends ``branch_length`` m from the run's
    axis, rim rounded.

    The rim's ``fillet_radius`` m is that of a ball that rolls inside the wall: the solid wall is
    opened by it.
    """

    run_length: float = 0.32
    branch_length: float = 0.16
    fillet_radius: float = 0.005
    inner_diameter: float = 0.16
    kind: ClassVar[str] = "tee"
    choices: ClassVar[tuple[str, ...]] = ("run_start", "run_end", "branch")

    def __post_init__(self) -> None:
        least = self.inner_diameter / 2 + max(self.fillet_radius, 0.0)
        _check(
            self.kind,
            inner_diameter=(
                self.inner_diameter > 0,
                f"is {self.inner_diameter} m; must be positive",
            ),
            fillet_radius=(
                0 < self.fillet_radius <= self.inner_diameter / 4,
                f"is {self.fillet_radius} m; must be over 0 and at most a quarter of the diameter",
            ),
            run_length=(
                self.run_length / 2 >= least,
                f"is {self.run_length} m; must be at least {2 * least} m",
            ),
            branch_length=(
                self.branch_length >= least,
                f"is {self.branch_length} m; must be at least {least} m",
            ),
        )

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``run_start`` at z < 0, ``run_end`` at z > 0, ``branch``; x towards the branch, or along
        the run."""
        half = self.run_length / 2
        return {
            "run_start": _port(-_Z, _X, -half * _Z),
            "run_end": _port(_Z, _X, half * _Z),
            "branch": _port(_X, _Z, self.branch_length * _X),
        }

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """See ``Fitting``; the rounded rim included."""
        return tee_signed_distance(np.asarray(points, float), self.radius, self.fillet_radius)

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        p = np.asarray(points, float)
        return np.minimum(self.run_length / 2 - np.abs(p[..., 2]), self.branch_length - p[..., 0])

    def path(self, enter: str, leave: str, arcs: TeeArcs) -> Path:
        """See ``Fitting``: a line over the run, or line, arc, line between run and branch."""
        start = self.ports[enter]
        tangent, half = -start.rotation[:, 2], self.run_length / 2
        if "branch" not in (enter, leave):
            return Path(start.position, tangent, _X, ((self.run_length, 0.0),))
        wanted, first, last = (
            (arcs.turn, half, self.branch_length)
            if leave == "branch"
            else (arcs.merge, self.branch_length, half)
        )
        radius = min(wanted, half, self.branch_length)
        normal = self.ports[leave].rotation[:, 2]
        lines = ((first - radius, 0.0), (radius * math.pi / 2, 1 / radius), (last - radius, 0.0))
        return Path(
            start.position, tangent, normal, tuple(segment for segment in lines if segment[0] > 0)
        )


def _bore_distance(from_axis: Array, radius: float) -> tuple[Array, Array]:
    """Distance and gradient for vectors (..., 3) from the bore's axis."""
    away = np.linalg.norm(from_axis, axis=-1)
    safe = np.where(away > 0, away, 1.0)[..., None]
    return radius - away, -from_axis / safe
