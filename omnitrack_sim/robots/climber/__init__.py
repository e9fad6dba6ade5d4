"""Modular Pipe Climber III: three tracks that one motor drives through an open differential."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.pipes import Passage
from omnitrack_sim.robots.control import Controller, ControlSetup, Observation
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.odometry import TrackOdometry
from omnitrack_sim.robots.quantity import borrowed, quantity
from omnitrack_sim.robots.robot import Robot


@borrowed("as of the omnidirectional robot")
class Climber(Omnitrack):
    """Modular Pipe Climber III, the sister of the omnidirectional robot.

    Its modules do not roll, and one motor drives their three tracks through a differential. The
    outputs' speeds add up to three times the motor's, and their forces are equal, so that in a
    bend each track finds the speed of its own way on the wall,

        v_i = omega (R - d cos theta_i)

    with R the bend's mean radius, d the wall's distance from the axis and theta_i the module's
    angle from the inside of the bend.

    Example:
        >>> from omnitrack_sim.robots.climber import Climber
        >>> climber = Climber()
        >>> climber.drive, climber.nominal_bore
        ('differential', 0.16)
    """

    kind: ClassVar[str] = "climber"
    rolls: ClassVar[bool] = False
    # The motor of the one that was built is not known.
    built: ClassVar[Mapping[str, Any]] = Robot.built

    drive: str = quantity(
        "differential",
        "",
        "published",
        "abstract of arXiv 2112.02996: a three-output open differential modulates the track speeds "
        "mechanically; the motor is as strong and heavy as three of the sister robot's (assumed)",
    )

    @classmethod
    def controllers(cls) -> Mapping[str, type[Controller]]:
        """See ``Robot``."""
        return {"steady": Steady}

    def singular_range(self, passage: Passage, bend_radius: float | None) -> None:
        """See ``Robot``: no orientation is held in a turn, as its modules do not roll."""
        return None

    def odometry(self) -> TrackOdometry:
        """See ``Robot``: its modules do not roll."""
        return TrackOdometry(self, rolls=False)


class Steady:
    """Ask the motor for the speed of cruising, whatever comes."""

    phases: ClassVar[tuple[str, ...]] = ("drive",)

    def __init__(self, setup: ControlSetup) -> None:
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: Any) -> None:
        """Begin anew; it remembers nothing."""
        self._speed = np.repeat(setup.settings.cruise_speed[:, None], 3, axis=1)

    def step(self, observation: Observation) -> Command:
        """Return one speed for all tracks, which the differential takes as their mean."""
        return Command(self._speed, np.zeros_like(self._speed))
