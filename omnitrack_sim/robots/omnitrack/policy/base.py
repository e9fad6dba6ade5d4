"""The controllers to whose commands decisions are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.control.catalogue import controller_of, parameters_model
from omnitrack_sim.robots.omnitrack.control.interface import (
    Command,
    Controller,
    ControlSetup,
    Observation,
)

_OURS = "omnitrack_sim.robots.omnitrack.control"
"""Where the classes are whose objects hold states of robots."""


class Bases:
    """The shipped controller of one name, with its defaults, of n robots that begin at different
    times. Those that begin together share an instance, which takes in the one before after its
    first step: all robots then cost as much as if they had begun together.

    Attributes:
        phases: of the controller.
    """

    def __init__(self, setup: ControlSetup, kind: str) -> None:
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
        command = joined([(self._which == number, command) for number, command in steps])
        self._merge()
        return command

    def _merge(self) -> None:
        """Let the newest instance drive the robots of older ones, too, where their states can be
        told apart."""
        *older, newest = sorted(self._controllers)
        for number in older:
            rows = self._which == number
            changes = _carried(self._controllers[number], self._controllers[newest], rows)
            if changes is not None:
                for holder, name, value in changes:
                    holder[name] = value
                self._which = np.where(rows, newest, self._which)
                del self._controllers[number]


_Changes = list[tuple[dict[str, Any], str, Any]]


def _carried(old: Any, new: Any, rows: NDArray[np.bool_]) -> _Changes | None:
    """What brings the state of the robots ``rows`` (n,) of one instance into another of its kind,
    as (table, key, value); None where a difference is not of robots alone."""
    changes: _Changes = []
    fresh = new if isinstance(new, dict) else vars(new)
    for name, have in (old if isinstance(old, dict) else vars(old)).items():
        other = fresh[name]
        if have is other:
            continue
        if isinstance(have, np.ndarray):
            mixed = _mixed(have, other, rows)
            found = None if mixed is None else [(fresh, name, mixed)]
        elif isinstance(have, dict) or type(have).__module__.startswith(_OURS):
            found = _carried(have, other, rows)
        else:
            found = [] if have == other else None
        if found is None:
            return None
        changes += found
    return changes


def _mixed(old: Array, new: Array, rows: NDArray[np.bool_]) -> Array | None:
    """``new`` with the rows of ``old``, along the one axis that is of robots; None where that is
    not to be seen."""
    if old.shape != new.shape:
        return None
    if np.array_equal(old, new, equal_nan=old.dtype.kind == "f"):
        return new
    axes = [axis for axis, size in enumerate(old.shape) if size == len(rows)]
    if len(axes) != 1:
        return None
    return np.where(rows.reshape(-1, *[1] * (old.ndim - 1 - axes[0])), old, new)


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
