"""Single kinds of gross errors of cameras and belts, for explorations without physics.

Each errs in one way alone and far more than a robot does, so that a map which is right all the same
is right by what is meant against that error.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from point_robot import Errors, PointRobot

from omnitrack_sim.autonomy.sight import Sighting, side_of
from omnitrack_sim.base.rotations import rotation_about
from omnitrack_sim.pipes import Elbow, Fitting, Reducer, Tee
from omnitrack_sim.robots.omnitrack import Omnitrack

HALF = Omnitrack().length / 2
NEAR = HALF + 0.11
"""Distance from a robot's centre up to which a robot looks from close by, m."""


def out_of(robot: PointRobot) -> Fitting:
    """Return the fitting that a robot's centre is in."""
    return robot.pipes.parts[robot.part].fitting


def is_ahead(sighting: Sighting) -> bool:
    """Return whether an elbow or reducer is seen from before it, by its start."""
    return sighting.enter in ("start", "run_start")


def free(sighting: Sighting, distance: float) -> Sighting:
    """Return a sighting of free pipe up to ``distance`` m."""
    return Sighting(distance=distance, axis=sighting.axis)


class Drawn(Errors):
    """Errors by draws of a seed."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 8])


class WrongFromAfar(Drawn):
    """From afar a tee is taken for an elbow, and all is 40 mm nearer."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        if sighting.distance < NEAR + 0.05 or sighting.kind == ("", ""):
            return sighting
        nearer = replace(sighting, distance=sighting.distance - 0.04, distance_std=0.02)
        is_tee = isinstance(sighting.fitting, Tee)
        return replace(nearer, fitting=Elbow(0.12), enter="start") if is_tee else nearer


class Imagining(Drawn):
    """Out of a fitting a robot sees, now and then, what is not there: the rest of a bend, which
    moves on with the lens or is short, to the bend's own side; a plate right before its nose; or a
    cone whose ends do not show."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        fitting = out_of(robot)
        if fitting.is_plain or robot.looking_back or self.rng.random() < 0.5:
            return sighting
        if isinstance(fitting, Elbow):
            return self._rest(sighting, robot)
        if self.rng.random() < 0.5:
            return Sighting(end="closed", distance=HALF, axis=sighting.axis)
        at = HALF + 0.001 * self.rng.random()
        cone = Reducer(0.1, fitting.port_radius(robot.leave) * 2.2)
        return Sighting(cone, "start", distance=at, distance_std=0.035, axis=sighting.axis)

    def _rest(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """Return a sighting of the rest of the bend that a robot is in."""
        part = robot.pipes.parts[robot.part]
        leave, enter = (part.port(port).rotation[:, 2] for port in (robot.leave, robot.enter))
        side = side_of(robot.pose()[1], leave)
        turn = float(np.arctan2(enter @ np.cross(leave, side), enter @ side))
        moves = self.rng.random() < 0.5
        angle = float(np.radians(self.rng.uniform(*((40, 60) if moves else (10, 30)))))
        at = HALF if moves else robot.left - 0.01
        bend = Elbow(0.13 if moves else 0.24, angle)
        return Sighting(bend, "start", distance=at, turn=turn, axis=sighting.axis)


class Slipping(Drawn):
    """In each pipe belts may slip once by 50 mm, soon after a fitting; both cameras see up to
    0.4 m, to 2 mm."""

    REACH = 0.4

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._slipped: set[int] = set()

    def slip(self, travel: float, robot: PointRobot) -> float:
        """See ``Errors``: where the fitting behind shows, which tells the robot where it is."""
        new = robot.part not in self._slipped and robot.is_behind_fitting
        if not (new and out_of(robot).is_plain and 0.15 < robot.since < 0.25):
            return 0.0
        self._slipped.add(robot.part)
        return float(self.rng.choice([-0.05, 0.0, 0.05]))

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        if sighting.distance > self.REACH or sighting.kind == ("", ""):
            return free(sighting, min(sighting.distance, self.REACH))
        return replace(sighting, distance_std=0.002)


class Lagging(Drawn):
    """A robot takes itself to be 60 mm farther on after each new fitting."""

    def passed(self, turn: float, new: bool) -> float:
        """See ``Errors``."""
        return 0.06 * new


class Outlying(Drawn):
    """In pipe one look in ten is wrong, and never two soon after each other: it has the axis of the
    pipe off by 5 degrees and the distance by 30 mm, or back the distance alone, or ahead the radius
    of an elbow, by 60 mm."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._since = 0

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        sighting, fitting = replace(sighting, distance_std=0.002), sighting.fitting
        self._since += 1
        if self._since < 7 or self.rng.random() > 0.3 or not out_of(robot).is_plain:
            return sighting
        self._since = 0
        farther = replace(sighting, distance=sighting.distance + 0.03)
        if self.rng.random() < 0.5:
            axis = rotation_about([1.0, 0.0, 0.0], np.radians(5)) @ sighting.axis
            return replace(farther, axis=axis)
        if robot.looking_back:
            return farther
        if isinstance(fitting, Elbow):
            wider = replace(fitting, mean_radius=fitting.mean_radius + 0.06)
            return replace(sighting, fitting=wider)
        return sighting


class Overlooking(Drawn):
    """No reducer is seen ahead, and arms read 0.7 mm too much."""

    def bore(self, bore: float) -> float:
        """See ``Errors``."""
        return bore + 0.0007

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        if not isinstance(sighting.fitting, Reducer) or robot.looking_back:
            return sighting
        return replace(sighting, fitting=None, enter="", distance=sighting.distance + 0.12)


class Guessing(Drawn):
    """Lengths of reducers and radii of elbows show badly from before, and well from behind."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        fitting = sighting.fitting
        if robot.looking_back:
            return sighting
        if isinstance(fitting, Reducer):
            longer = replace(fitting, length=fitting.length + 0.02)
            return replace(sighting, fitting=longer, distance_std=0.015)
        if isinstance(fitting, Elbow):
            tighter = replace(fitting, mean_radius=fitting.mean_radius - 0.005)
            return replace(sighting, fitting=tighter, confidence=0.9)
        return sighting


class FirstLookWrong(Drawn):
    """Out of a fitting, the first look at the next one is off by 60 mm and 4 degrees."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._looked: Counter[tuple[int, str]] = Counter()

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        here = robot.part, robot.leave
        if out_of(robot).is_plain or sighting.fitting is None or robot.looking_back:
            return sighting
        self._looked[here] += 1
        if self._looked[here] > 1:
            return sighting
        at, turn = sighting.distance + 0.06, sighting.turn + np.radians(4)
        return replace(sighting, distance=at, turn=turn)


class Blind(Errors):
    """No elbow is recognised."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting | None:
        """See ``Errors``."""
        return None if isinstance(sighting.fitting, Elbow) else sighting


class Shallow(Errors):
    """Pipe shows up to 0.4 m, and as free to 90 % only."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting:
        """See ``Errors``."""
        return replace(free(sighting, 0.4), confidence=0.9) if sighting.distance > 0.4 else sighting


class FallsIn(Drawn):
    """A robot falls whenever it comes into one fitting of the network."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._number = int(self.rng.integers(100))

    def falls(self, robot: PointRobot) -> bool:
        """See ``Errors``."""
        fittings = [i for i, part in enumerate(robot.pipes.parts) if not part.fitting.is_plain]
        return robot.part == fittings[self._number % len(fittings)]
