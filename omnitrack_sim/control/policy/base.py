"""The controllers to whose commands decisions are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.interface import Command, Controller, ControlSetup, Observation


class Bases:
    """The shipped controller of one name, with its defaults, of n robots that begin at different
    times: those that begin together share an instance.

    Attributes:
        phases: of the controller.
    """

    def __init__(self, setup: ControlSetup, kind: str) -> None:
        from omnitrack_sim.control.catalogue import controller_of, parameters_model  # knows us

        self._kind = controller_of(kind)
        self._table = parameters_model(self._kind)()
        self.phases: tuple[str, ...] = getattr(self._kind, "phases", ("drive",))
        self._controllers: dict[int, Controller] = {}
        self._which, self._number = np.zeros(setup.n, int), -1
        self.begin(np.ones(setup.n, bool), setup)

    def begin(self, robots: NDArray[np.bool_], setup: ControlSetup) -> None:
        """Robots (n,) begin anew; ``setup`` is of all."""
        self._number += 1
        own = replace(setup, parameters=[self._table] * setup.n)
        self._controllers[self._number] = self._kind(own)
        self._which = np.where(robots, self._number, self._which)
        used = set(self._which.tolist())
        self._controllers = {i: c for i, c in self._controllers.items() if i in used}

    def step(self, observation: Observation) -> Command:
        """The command of all robots, each by its own instance."""
        steps = [(number, c.step(observation)) for number, c in self._controllers.items()]
        return joined([(self._which == number, command) for number, command in steps])


def joined(parts: Sequence[tuple[NDArray[np.bool_], Command]]) -> Command:
    """One command of several that say all of speed, roll, phase and resting, each with the robots
    (n,) that it counts for."""
    whole: dict[str, Any] = {}
    for own, command in parts:
        for name in ("belt_speed", "roll", "phase", "resting"):
            values: Any = getattr(command, name)
            rows = own.reshape(-1, *[1] * (values.ndim - 1))
            whole[name] = np.where(rows, values, whole.get(name, values))
    events = [event for own, command in parts for event in command.events if own[event.robot]]
    return Command(**whole, events=events)
