"""One robot at one tee: the region, its rates and the real geometry together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.robots.omnitrack import MODULES, Robot
from omnitrack_sim.robots.omnitrack.singularity.contact import (
    ContactMap,
    TeePath,
    contact_map,
    outer_sector,
    turn_path,
)
from omnitrack_sim.robots.omnitrack.singularity.region import (
    DEFINITIONS,
    Definition,
    best_theta5,
    failure_rate,
    safe_margin,
    sector_angle,
    success_rate,
)

_DEFAULT = Robot()
SHORTEST, LONGEST = 1e-6, 1000.0
"""Least and largest length of robot and tee, m."""
LEAST_TURN = 1e-6
"""Least angle between run and branch, rad."""
MOST_MODULES = 12
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
        if not 1 <= self.modules <= MOST_MODULES:
            wanted = f"it must be a whole number from 1 to {MOST_MODULES}"
            faults.append(Fault("modules", f"is {self.modules:g}; {wanted}"))
        if 0 < self.turn_angle < LEAST_TURN:
            faults.append(Fault("turn_angle", "is too small for a turn"))
        if faults:
            raise InputError(faults)
        safe_margin(self.sector, self.modules)  # raises if a value is out of range

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

    @cached_property
    def real_sector(self) -> float:
        """Outer sector in the exact two-cylinder geometry, rad."""
        return float(
            outer_sector(self._path(721), self.reach, self.pipe_radius, self.contact_length)
        )

    def real_map(self, orientations: int = 241, poses: int = 181) -> ContactMap:
        """Contact along the turn over one period of theta5, with ``best`` in the middle."""
        half = np.pi / self.modules
        theta5 = self.best + np.linspace(-half, half, orientations)
        path = self._path(poses)
        return contact_map(
            path, theta5, self.reach, self.pipe_radius, self.contact_length, self.modules
        )

    @property
    def path_radius(self) -> float:
        """Radius of the arc that the robot's centre follows in the real geometry, m."""
        return self.pipe_radius if self.bend_radius is None else self.bend_radius

    def _path(self, poses: int) -> TeePath:
        return turn_path(self.path_radius, self.turn_angle, poses)

    def summary(self) -> dict[str, Any]:
        """Every number with its unit in the name, for JSON."""
        state = self.real_map(orientations=481, poses=361)
        one_period = state.keeps_contact[:-1]  # the last theta5 repeats the first
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
                "keeps_contact_rate": float(one_period.mean()),
            },
        }

    def _rates(self, sector: float) -> dict[str, float]:
        return {
            "sector_deg": float(np.degrees(sector)),
            "margin_deg": float(np.degrees(safe_margin(sector, self.modules))),
            "failure_rate": float(failure_rate(sector, self.modules)),
            "success_rate": float(success_rate(sector, self.modules)),
        }
