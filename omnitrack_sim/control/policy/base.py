"""The controllers to whose commands decisions are added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.interface import Command, Controller, ControlSetup, Observation
from omnitrack_sim.rotations import Array


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
        (first, controller), *others = self._controllers.items()
        whole = _filled(controller.step(observation), first, self._which)
        for number, other in others:
            whole = _joined(
                whole, _filled(other.step(observation), number, self._which), number, self._which
            )
        return whole


def _filled(command: Command, number: int, which: NDArray[np.int_]) -> Command:
    """A command with the events of its own robots alone."""
    events = [event for event in command.events if which[event.robot] == number]
    return command._replace(events=events)


def _joined(a: Command, b: Command, number: int, which: NDArray[np.int_]) -> Command:
    """``a`` with the rows of ``b`` where robots have that number."""
    own = which == number

    def rows(one: Array | None, other: Array | None) -> Array | None:
        if one is None or other is None:
            return None
        return np.where(own.reshape(-1, *[1] * (other.ndim - 1)), other, one)

    joined = [
        rows(getattr(a, n), getattr(b, n)) for n in ("belt_speed", "roll", "phase", "resting")
    ]
    belt_speed, roll, phase, resting = joined
    assert belt_speed is not None
    return Command(belt_speed, roll, phase, resting, [*a.events, *b.events])
