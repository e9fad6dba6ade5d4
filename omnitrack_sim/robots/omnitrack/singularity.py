"""The motion singularity region of Section IV in closed form.

A pipe of radius R is cut at half the turn angle delta by the mitre plane. The section is an
ellipse, with semi-axes a = R / cos(delta/2) in the plane of the turn and R across it. A robot whose
modules reach rho > R from its axis touches it only where the ellipse is within rho. The part
beyond, projected along the pipe onto the circle at its end, is a sector centred on the outer
direction, opposite the turn: a module in it has no wall.

The authors' derivation is not public. ``ellipse`` is the literal reading of the text; ``crotch``
and ``strip`` are two rivals. docs/explanation/singularity.md derives all three. Angles are
in rad, lengths in one unit throughout; functions take arrays of any shape and broadcast.
theta5 is the angle of module 1 from the turning direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.robots.omnitrack import MODULES, Omnitrack
from omnitrack_sim.robots.omnitrack.tee_contact import (
    TeePath,
    outer_sector,
    turn_path,
    wall_distance,
)

Definition = Literal["ellipse", "crotch", "strip"]
DEFINITIONS: tuple[Definition, ...] = get_args(Definition)
"""``ellipse``: a circle of radius rho about the centre of the mitre ellipse. ``crotch``: a circle
of radius rho through the ellipse's inner vertex, where the crotch is. ``strip``: a point contact
needs the outermost |y| = R of the bores."""


def section_ellipse(pipe_radius: ArrayLike, tilt: ArrayLike) -> tuple[Array, Array]:
    """Semi-axes R / cos(tilt) and R of a pipe cut by a plane ``tilt`` rad from square (Fig. 7).

    Its eccentricity is sin(tilt).
    """
    radius, tilt = np.broadcast_arrays(np.asarray(pipe_radius, float), np.asarray(tilt, float))
    return radius / np.cos(tilt), radius.copy()


def sector_angle(
    pipe_radius: ArrayLike,
    reach: ArrayLike,
    turn_angle: ArrayLike = np.pi / 2,
    definition: Definition = "ellipse",
) -> Array:
    """Angle Phi of the singular sector, rad.

    It is 2 pi below rho = R, where nothing touches, and 0 where all directions touch.

    With T = tan(delta/2) and c = cos(delta/2), cos(Phi/2) is

    * ``ellipse``: sqrt(rho^2/R^2 - 1) / T; 180 degrees at rho = R, 0 from rho = R / c on;
    * ``crotch``: (2 c rho/R - 1 - c^2) / sin^2(delta/2), which is 2 sqrt(2) rho/R - 3 for a right
      angle;

    and for ``strip`` sin(Phi/2) = R / rho, at any turn angle.

    Args:
        pipe_radius: R.
        reach: rho, largest distance of a module's surface from the robot axis.
        turn_angle: delta, rad.
        definition: see ``DEFINITIONS``.
    """
    radius, rho, half = np.broadcast_arrays(
        np.asarray(pipe_radius, float), np.asarray(reach, float), np.asarray(turn_angle, float) / 2
    )
    # Below rho = R nothing touches: the formulas begin there, and the last line puts in 2 pi.
    ratio = np.maximum(rho / radius, 1.0)
    if definition == "strip":
        half_sector = np.arcsin(1.0 / ratio)
    else:
        c = np.cos(half)
        if definition == "ellipse":
            cosine = np.sqrt((ratio - 1.0) * (ratio + 1.0)) / np.tan(half)
        else:
            cosine = (2 * c * ratio - 1.0 - c * c) / np.sin(half) ** 2
        # A cosine above 1 belongs to a reach at which all directions touch: no sector.
        half_sector = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.where(rho < radius, 2 * np.pi, 2 * half_sector)


def reach_from_sector(
    sector: ArrayLike,
    pipe_radius: ArrayLike,
    turn_angle: ArrayLike = np.pi / 2,
    definition: Definition = "ellipse",
) -> Array:
    """Reach rho, in the unit of ``pipe_radius``, that gives the sector Phi.

    The inverse of ``sector_angle``. ``ellipse``: R sqrt(1 + T^2 cos^2(Phi/2)). Phi = 0 gives the
    least reach that has no sector.

    Raises:
        InputError: Phi is not between 0 and the sector at rho = R (for ``strip``, 0 itself has no
            finite reach).
    """
    radius, half_sector, half = np.broadcast_arrays(
        np.asarray(pipe_radius, float),
        np.asarray(sector, float) / 2,
        np.asarray(turn_angle, float) / 2,
    )
    # At rho = R; in units of R the bound is the same for all pipes.
    largest = sector_angle(1.0, 1.0, 2 * half, definition)
    low = half_sector > 0 if definition == "strip" else half_sector >= 0
    if not np.all(low & (2 * half_sector <= largest + 1e-12)):
        wanted = f"must lie between 0 and {np.degrees(np.min(largest)):.2f} degrees"
        angles = ", ".join(f"{angle:g}" for angle in np.ravel(np.degrees(sector)))
        raise InputError(Fault("sector", f"is {angles} degrees; it {wanted}, its value at rho = R"))
    if definition == "strip":
        return radius / np.sin(half_sector)
    c = np.cos(half)
    if definition == "ellipse":
        return radius * np.sqrt(1.0 + (np.tan(half) * np.cos(half_sector)) ** 2)
    return radius * (np.cos(half_sector) * np.sin(half) ** 2 + 1.0 + c * c) / (2 * c)


def safe_margin(sector: ArrayLike, modules: ArrayLike = 3) -> Array:
    """Half-width of the safe range of theta5 about its best value, rad.

    (period - Phi) / 2, at least 0.
    """
    return np.maximum(0.0, (2 * np.pi / np.asarray(modules) - np.asarray(sector, float)) / 2)


def failure_rate(sector: ArrayLike, modules: ArrayLike = 3) -> Array:
    """Share of all orientations that have a module in the sector.

    Phi over the period 2 pi / modules, at most 1. The paper's 80.45 % is 96.54 / 120 (Section VI).
    """
    return np.minimum(1.0, np.asarray(sector, float) * np.asarray(modules) / (2 * np.pi))


def success_rate(sector: ArrayLike, modules: ArrayLike = 3) -> Array:
    """Share of all orientations that keep every module out of the sector: 1 - failure rate."""
    return 1.0 - failure_rate(sector, modules)


def is_singular(theta5: ArrayLike, sector: ArrayLike, modules: ArrayLike = 3) -> NDArray[np.bool_]:
    """True where a module is in the sector: |theta5 + 2 pi k / modules - pi| < Phi / 2 for a k.

    Equal modules repeat after 2 pi / modules, so one wrapped angle answers for all of them.
    """
    per_period = np.asarray(modules) / (2 * np.pi)
    turns = (np.asarray(theta5, float) - np.pi) * per_period
    return np.abs(turns - np.rint(turns)) < np.asarray(sector, float) * (per_period / 2)


def best_theta5(modules: ArrayLike = 3) -> Array:
    """theta5 of the best orientation, modulo the period.

    The outer direction then lies midway between two modules. 0 for an odd number of modules (one
    points into the turn), half a period for an even one.
    """
    modules = np.asarray(modules)
    return np.where(modules % 2 == 1, 0.0, np.pi / modules)


def worst_theta5(modules: ArrayLike = 3) -> Array:
    """theta5 of the worst orientation, modulo the period: a module points outward."""
    modules = np.asarray(modules)
    return np.where(modules % 2 == 1, np.pi / modules, 0.0)


_DEFAULT = Omnitrack()
SHORTEST, LONGEST = 1e-6, 1000.0
"""Least and largest length of robot and tee, m."""
MIN_TURN = 1e-6
"""Least angle between run and branch, rad."""
MAX_MODULES = 12
"""The contact map takes time and memory in proportion to the number of modules."""


@dataclass(frozen=True)
class TurnCase:
    """A robot that turns in a tee. Angles in rad, lengths in m; the defaults are the paper's robot.

    Attributes:
        pipe_radius: R.
        reach: rho, from the robot axis to the module's surface, springs extended.
        turn_angle: delta, between run and branch.
        modules: number of equal modules.
        definition: of the region, see ``DEFINITIONS``.
        contact_length: L of a module, for the real geometry.
        bend_radius: of the arc that the robot's centre follows, for the real geometry; none: R,
            about the crotch.

    Raises:
        InputError: a value is out of range.

    Example:
        >>> import math
        >>> import omnitrack_sim as ot
        >>> case = ot.TurnCase()
        >>> round(math.degrees(case.sector), 2), round(math.degrees(case.margin), 2)
        (96.55, 11.73)
    """

    pipe_radius: float = _DEFAULT.nominal_pipe_radius
    reach: float = _DEFAULT.reach
    turn_angle: float = np.pi / 2
    modules: int = MODULES
    definition: Definition = "ellipse"
    contact_length: float = _DEFAULT.contact_length
    bend_radius: float | None = None

    def __post_init__(self) -> None:
        lengths = {name: getattr(self, name) for name in ("pipe_radius", "reach", "bend_radius")}
        faults = [
            Fault(name, f"is {value:g}; it must be positive, from {SHORTEST:g} to {LONGEST:g} m")
            for name, value in lengths.items()
            if value is not None and not SHORTEST <= value <= LONGEST
        ]
        if not 0 <= self.contact_length <= LONGEST:
            wanted = f"it must be from 0 to {LONGEST:g} m"
            faults.append(Fault("contact_length", f"is {self.contact_length:g}; {wanted}"))
        if not 1 <= self.modules <= MAX_MODULES or self.modules != int(self.modules):
            wanted = f"it must be a whole number from 1 to {MAX_MODULES}"
            faults.append(Fault("modules", f"is {self.modules:g}; {wanted}"))
        # The formulas divide by the sine of half the angle.
        if not MIN_TURN <= self.turn_angle < np.pi:
            problem = f"is {np.degrees(self.turn_angle):g} degrees; it must lie between 0 and 180"
            faults.append(Fault("turn_angle", problem))
        if self.definition not in DEFINITIONS:
            problem = f"is {self.definition!r}"
            faults.append(Fault("definition", problem, DEFINITIONS, self.definition))
        if faults:
            raise InputError(faults)

    @cached_property
    def sector(self) -> float:
        """Phi of the definition, rad."""
        return float(sector_angle(self.pipe_radius, self.reach, self.turn_angle, self.definition))

    @cached_property
    def margin(self) -> float:
        """Half-width of the safe range of theta5 about ``best``, rad."""
        return float(safe_margin(self.sector, self.modules))

    @property
    def best(self) -> float:
        """Best theta5, rad."""
        return float(best_theta5(self.modules))

    @property
    def real_sector(self) -> float:
        """Outer sector in the exact two-cylinder geometry, rad."""
        return _real_sector(self)

    @property
    def singular_range(self) -> SingularRange:
        """Orientations in which the robot cannot turn."""
        real = float(np.degrees((2 * np.pi / self.modules - self.real_sector) / 2))
        return SingularRange(float(np.degrees(self.sector)), real if real > 0 else None)

    def orientations(self, count: int) -> Array:
        """Return ``count`` values of theta5, rad, over one period, with ``best`` in the middle."""
        half = np.pi / self.modules
        return self.best + np.linspace(-half, half, count)

    def wall_distance(self, path: TeePath, theta5: Array) -> Array:
        """Return the distance (T, M, N) m of the N modules from the wall along T poses.

        Args:
            path: the T poses.
            theta5: (M,) rad; see ``tee_contact.wall_distance``.
        """
        angles = theta5[:, None] + 2 * np.pi / self.modules * np.arange(self.modules)
        return wall_distance(path, angles, self.pipe_radius, self.contact_length)

    @property
    def path_radius(self) -> float:
        """Radius of the arc that the robot's centre follows in the real geometry, m."""
        return self.pipe_radius if self.bend_radius is None else self.bend_radius

    def path(self, poses: int) -> TeePath:
        """Return the arc of the robot's centre in ``poses`` poses."""
        return turn_path(self.path_radius, self.turn_angle, poses)

    def summary(self) -> dict[str, Any]:
        """Every number with its unit in the name, for JSON."""
        theta5 = self.orientations(481)[:-1]  # the last one repeats the first
        touching = self.wall_distance(self.path(361), theta5) <= self.reach
        return {
            "pipe_diameter_m": 2 * self.pipe_radius,
            "reach_m": self.reach,
            "turn_angle_deg": float(np.degrees(self.turn_angle)),
            "modules": self.modules,
            "definition": self.definition,
            "best_theta5_deg": float(np.degrees(self.best)),
            **self._rates(self.sector),
            "definitions": {
                name: self._rates(
                    float(sector_angle(self.pipe_radius, self.reach, self.turn_angle, name))
                )
                for name in DEFINITIONS
            },
            "real_geometry": {
                "contact_length_m": self.contact_length,
                "bend_radius_m": self.path_radius,
                **self._rates(self.real_sector),
                "keeps_contact_rate": float(touching.all(axis=(0, 2)).mean()),
            },
        }

    def _rates(self, sector: float) -> dict[str, float]:
        return {
            "sector_deg": float(np.degrees(sector)),
            "margin_deg": float(np.degrees(safe_margin(sector, self.modules))),
            "failure_rate": float(failure_rate(sector, self.modules)),
            "success_rate": float(success_rate(sector, self.modules)),
        }


@cache
def _real_sector(case: TurnCase) -> float:
    """``TurnCase.real_sector``, which takes half a second, once for equal cases."""
    path = case.path(721)
    return float(outer_sector(path, case.reach, case.pipe_radius, case.contact_length))
