"""Observations for controllers and pilots of n robots: ``Senses``, and the ground truth."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.sight import Look
from omnitrack_sim.base.rotations import Array, heading
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.legs import Legs


class Senses(Protocol):
    """Observations for controllers and pilots of n robots.

    The plant, the monitor and all metrics know the truth.

    A class of a user's own takes the three arguments of ``MakeSenses``. It may inherit from
    ``Truth`` and change what ``readings`` and ``location`` hold, such as by adding noise. Where it
    leaves out the others, its robots know their poses and can look at any time.

    Attributes:
        readings: (n, ...) by the names of the channels, each in its robot's own frame.
        channels: of the readings.
        recorded: further channels, whose values ``estimates`` returns.
        location: of the robots along their routes, found by ``locate``.
        distance_std: (n,) m, standard deviation of the distances of ``location``.
        can_look: robots that look ahead can do so at this control step.

    Example:
        >>> sim = ot.Simulation([ot.load_scenario("tee_turn")])
        >>> type(sim.senses).__name__, sim.senses.distance_std
        ('Truth', array([0.]))
    """

    readings: Mapping[str, Array]
    channels: Sequence[Channel]
    recorded: Sequence[Channel] = ()
    location: Location

    @property
    def distance_std(self) -> Array:
        """Standard deviation (n,) m of the distances of ``location``."""
        return np.zeros(len(self.location.distance))

    @property
    def can_look(self) -> bool:
        """True where robots that look ahead can do so at this control step."""
        return True

    def reset(self, rows: NDArray[np.intp], scenarios: Sequence[Scenario], state: State) -> None:
        """Reset robots ``rows`` (k,) to the start of ``scenarios`` (k).

        Args:
            rows: numbers of the robots, ascending.
            scenarios: that they run now.
            state: of the physics of all n robots.
        """
        ...

    def read(self, state: State, active: NDArray[np.bool_]) -> None:
        """Read the sensors, once a control step.

        Args:
            state: of the physics.
            active: (n,) robots whose run is not over.
        """
        ...

    def locate(self, truth: Location) -> None:
        """Set ``location``, whose true value is ``truth``, from the readings."""
        ...

    def guard(self, command: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Restrict a command for robots whose pose is unknown.

        Returns:
            The command, and the robots (n,) that have searched for their pose in vain.
        """
        return command, np.zeros(len(self.location.distance), bool)

    def look(self, robot: int, back: bool) -> Look:
        """Return a robot's look ahead and, with ``back``, behind it too."""
        ...

    def update_maps(self, robots: Collection[int]) -> None:
        """Take note that robots may have changed the maps that they make."""

    def shift(self, robot: int, more: float) -> None:
        """Move a robot's estimate ``more`` m farther along its route."""

    def doubt(self, robot: int) -> bool:
        """Discard the estimate of a robot whose pose lies in no pipe.

        Returns:
            False where the pose is no estimate, and the run is over.
        """
        return False

    def estimates(self) -> Mapping[str, NDArray]:
        """Return the values (n, ...) of the channels ``recorded``."""
        return {}

    def metrics(self, robot: int) -> Mapping[str, float]:
        """Return metrics of a robot's senses."""
        return {}

    def pictures(self) -> Sequence[Pictures | None]:
        """Return the pictures that each of the n robots has taken, where they are recorded."""
        return [None] * len(self.location.distance)


MakeSenses = Callable[[Sequence[Scenario], Legs, State], Senses]
"""Makes the senses of n robots from their scenarios, legs, and the physics as they begin."""


class Truth(Senses):
    """Senses without error: controllers receive the ground truth. See ``Senses``.

    Example:
        >>> class Late(ot.Truth):
        ...     def locate(self, truth):  # believes to be at the start for ever
        ...         self.location = getattr(self, "location", truth)
        >>> sim = ot.Simulation([ot.load_scenario("straight")], senses=Late)
        >>> sim.step()
        >>> sim.observation.location is sim.location
        False
    """

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs, state: State) -> None:
        self._scenarios, self._legs = list(scenarios), legs
        self.channels = [sensor.channel for sensor in state.sensors.values()]
        self.reset(np.arange(len(scenarios)), scenarios, state)

    def reset(self, rows: NDArray[np.intp], scenarios: Sequence[Scenario], state: State) -> None:
        """See ``Senses``."""
        for row, scenario in zip(rows.tolist(), scenarios, strict=True):
            self._scenarios[row] = scenario
        self.readings = state

    def read(self, state: State, active: NDArray[np.bool_]) -> None:
        """See ``Senses``."""
        self.readings = state

    def locate(self, truth: Location) -> None:
        """See ``Senses``."""
        self.location = truth

    def look(self, robot: int, back: bool) -> Look:
        """See ``Senses``."""
        gear = int(self._legs.gear[robot])
        sight = self._scenarios[robot].sight
        position, rotation = (self.readings[name][robot] for name in ("position", "rotation"))
        frame = frame_ahead(rotation, gear)
        ahead = sight.look(robot, position, frame)
        behind = sight.look(robot, position, frame_ahead(rotation, -gear)) if back else None
        time, distance = self.readings["time"][robot], self.location.distance[robot]
        return Look(float(time), float(distance), ahead, behind, frame)


def frame_ahead(rotation: Array, gear: int) -> Array:
    """Return the frame (3, 3) that looks ahead of a robot in a gear; see ``heading``."""
    return heading(rotation[None], np.array([gear]))[0]
