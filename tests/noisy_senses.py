"""Errors of cameras, odometry and arms, drawn at random, for explorations without physics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from point_robot import Errors, PointRobot

from omnitrack_sim.autonomy.sight import Sighting
from omnitrack_sim.base.rotations import Array, rotation_about
from omnitrack_sim.pipes import Elbow, Fitting, Reducer, Tee, Wye
from omnitrack_sim.robots.omnitrack import Omnitrack

HALF = Omnitrack().length / 2
BORE = 0.16
REACH = 2.2 * BORE
"""From the lens up to which a camera is believed, m."""


class CameraErrors(Errors):
    """Errors of a robot that explores by its own camera, of the size that docs measure.

    Args:
        seed: of all draws.
        lamp: it has a headlight, and no depth camera.
        fall_rate: probability of a fall in a fitting that it comes into.
    """

    std = 0.003

    def __init__(self, seed: int, lamp: bool = False, fall_rate: float = 0.0) -> None:
        self._rng, self._lamp, self._fall_rate = np.random.default_rng(seed), lamp, fall_rate
        self._scale = 1 + 0.003 * self._rng.normal()
        self._too_wide = 0.0003 * self._rng.normal()

    def frame(self, frame: Array) -> Array:
        """See ``Errors``: off by a third of a degree."""
        return self._tilted(frame, 0.3)

    def slip(self, travel: float, robot: PointRobot) -> float:
        """See ``Errors``: some per mille, the same all the time, and some slip."""
        slips = self._rng.random() < travel / 5.0
        return travel * (self._scale - 1) + slips * 0.01 * self._rng.normal()

    def passed(self, turn: float, new: bool) -> float:
        """See ``Errors``: some millimetres in a bend or branch."""
        return 0.006 * self._rng.normal() if turn > 0.1 else 0.0

    def bore(self, bore: float) -> float:
        """See ``Errors``."""
        return bore + self._too_wide + 0.0002 * self._rng.normal()

    def falls(self, robot: PointRobot) -> bool:
        """See ``Errors``."""
        return bool(self._rng.random() < self._fall_rate)

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting | None:
        """See ``Errors``."""
        rng, away = self._rng, sighting.distance - HALF
        axis = self._tilted(np.eye(3), 0.4) @ sighting.axis
        hidden = isinstance(sighting.fitting, Reducer) and self._lamp and rng.random() < 0.15
        if away > REACH or sighting.kind == ("", "") or hidden:
            free = min(away, REACH)
            confidence = 0.9 if self._lamp else 1.0
            return Sighting(distance=HALF + free, axis=axis, confidence=confidence)
        if rng.random() < 0.04:
            return None
        if sighting.end:
            std = 0.001 + 0.004 * away / REACH
            return replace(
                sighting,
                distance=sighting.distance + std * rng.normal(),
                distance_std=std,
                axis=axis,
            )
        return self._fitting_seen(sighting, away, axis)

    def _fitting_seen(self, sighting: Sighting, away: float, axis: Array) -> Sighting | None:
        rng, far = self._rng, away / REACH
        assert sighting.fitting is not None
        seen, stds, along = self._sizes(sighting.fitting, far)
        turn_std = math.radians((1.2 if self._lamp else 0.3) + (1.0 if self._lamp else 0.5) * far)
        turn = sighting.turn + turn_std * rng.normal() * (not seen.is_axial)
        distance = sighting.distance + along * rng.normal()
        if self._lamp and rng.random() < 0.03:
            # A picture in which the pipe seems to lean has its distance wrong too.
            lean = 3.0 * rng.normal()
            axis = rotation_about([1.0, 0.0, 0.0], math.radians(lean)) @ sighting.axis
            distance += 0.008 * lean
        if far > 0.7 and rng.random() < (0.05 if self._lamp else 0.02):
            seen, stds = self._confused(seen), {}
        confidence = 1.0
        if self._lamp and isinstance(seen, Reducer):
            confidence = 0.9
        return replace(
            sighting,
            fitting=seen,
            enter=sighting.enter if seen.kind == sighting.fitting.kind else seen.port_names[0],
            distance=distance,
            turn=turn,
            distance_std=along,
            turn_std=turn_std,
            confidence=confidence,
            axis=axis,
            size_stds=stds,
        )

    def _sizes(self, fitting: Fitting, far: float) -> tuple[Fitting, dict[str, float], float]:
        """Return a fitting as seen, with standard deviations of its sizes and of its distance."""
        rng = self._rng
        if isinstance(fitting, Elbow):
            radius_std = (0.025 if self._lamp else 0.012) * fitting.mean_radius
            angle_std = math.radians(6.0 if self._lamp else 2.0)
            seen = replace(
                fitting,
                mean_radius=max(fitting.mean_radius + radius_std * rng.normal(), 0.082),
                angle=fitting.angle + angle_std * rng.normal() * (not self._lamp),
            )
            return seen, {"mean_radius": radius_std, "angle": angle_std}, 0.002 + 0.003 * far
        if isinstance(fitting, Reducer):
            std = (0.008 if self._lamp else 0.004) * (1 + far)
            off = std * rng.normal() + (0.02 * rng.normal() if rng.random() < 0.05 else 0.0)
            bore = fitting.end_diameter + 0.0004 * rng.normal()
            seen = replace(fitting, length=max(fitting.length + off, 0.05), end_diameter=bore)
            return seen, {"length": std, "end_diameter": 0.0004}, std
        if isinstance(fitting, Wye):
            angle_std = math.radians(1.5 + 2.0 * far)
            angle = fitting.angle + angle_std * rng.normal()
            seen = replace(fitting, angle=max(angle, math.radians(45)))
            return seen, {"angle": angle_std}, 0.002 + 0.004 * far
        return fitting, {}, 0.001 + 0.003 * far

    def _confused(self, fitting: Fitting) -> Fitting:
        """Return another fitting that one from afar is taken for."""
        bore = 2 * fitting.port_radius(fitting.port_names[0])
        if isinstance(fitting, Tee):
            return Elbow(1.5 * bore, inner_diameter=bore)
        return Tee(inner_diameter=bore)

    def _tilted(self, frame: Array, std_deg: float) -> Array:
        """Return a frame (3, 3) turned a little about a random axis across its z axis."""
        around = self._rng.uniform(0, 2 * np.pi)
        axis = [math.cos(around), math.sin(around), 0.0]
        turned: Array = frame @ rotation_about(axis, math.radians(std_deg) * self._rng.normal())
        return turned
