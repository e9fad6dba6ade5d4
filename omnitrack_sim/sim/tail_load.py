"""Forces on the tails of n robots: a pull that grows with time, and tethers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, with_rows
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.plant import Plant
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.robots.tail import TAIL_CHANNELS, TETHER_CHANNELS, Tether, rest
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.builder import each
from omnitrack_sim.sim.legs import Legs

VAGUE_CAUSES = (Outcome.STUCK, Outcome.STALLED, Outcome.SLIPPING)
"""Causes of a halt behind which there may be a tether's pull."""


@dataclass(frozen=True)
class TailSettings:
    """Numerical parameters of tethers, and threshold of their reports.

    Attributes:
        softening: part of mass over period² that a tether's stiffness may have. It acts once a
            control period, and a robot on a stiffer spring would swing up.
        holding: part of the robot's weight from which on a tether is what holds it.
    """

    softening: float = 0.1
    holding: float = 0.25


SETTINGS = TailSettings()


class TailLoad:
    """Pulls at the tails of n robots, backward along their routes.

    Args:
        scenarios: of one batch, which share the tether; the list is the simulation's, which
            changes it.
        legs: that the robots drive.
        plant: that the forces act in.

    Attributes:
        channels: whose values ``values`` returns.
        force: (n,) N, backward along the pipe.
        max_force: (n,) N, the largest so far.
    """

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs, plant: Plant) -> None:
        first, n = scenarios[0], len(scenarios)
        self._scenarios, self._half = scenarios, first.robot.length / 2
        self._legs, self._plant = legs, plant
        self._tethers = None
        self.channels: tuple[Channel, ...] = TAIL_CHANNELS
        if first.robot.tether is not None:
            self._tethers = Tethers(first.robot.tether, scenarios, legs)
            self.channels += TETHER_CHANNELS
        self.force, self.max_force, self._pull, self._rate = np.zeros((4, n))
        self.reset(np.arange(n))

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Reset robots ``rows`` (k,), which stand at the start of their legs."""
        if self._scenarios[0].pull is not None:
            self._pull, self._rate = (each(self._scenarios, name) for name in ("pull", "pull_rate"))
        self.force = with_rows(self.force, rows, self._pull[rows])
        if self._tethers is not None:
            self._tethers.reset(rows, self._legs.near[rows] - self._half)
            self.force = with_rows(self.force, rows, (self.force + self._tethers.tension)[rows])
        self.max_force = with_rows(self.max_force, rows, self.force[rows])

    def act(self, time: Array, location: Location) -> None:
        """Pull at all robots, at ``time`` (n,) s and where they are, until this is called again."""
        legs = self._legs
        # In reverse gear the tail leads.
        tail = location.distance - legs.gear * self._half
        self.force = self._pull + self._rate * time
        if self._tethers is not None:
            self.force += legs.gear * self._tethers.pull(tail)
        self.max_force = np.maximum(self.max_force, self.force)
        backward = -legs.routes.tangents(tail[:, None], location.route)[:, 0]
        self._plant.pull(self.force[:, None] * backward)

    def values(self) -> Mapping[str, NDArray]:
        """Return the values (n,) of ``channels``."""
        out = {} if self._tethers is None else {"tether_out": self._tethers.out}
        return {"tail_force": self.force, "tail_force_max": self.max_force, **out}

    def cause(self, robot: int, cause: Outcome) -> Outcome:
        """Return the cause for which a robot makes no headway, its own diagnosis or its tether."""
        tethers = self._tethers
        if tethers is None or cause not in VAGUE_CAUSES or not tethers.holds(robot):
            return cause
        return Outcome.HELD_BY_TETHER

    def words(self, robot: int) -> str:
        """Return the force on a robot's tail, for the reason of its outcome."""
        out = "" if self._tethers is None else self._tethers.words(robot)
        return f", pulled back by {self.force[robot]:.3g} N{out}"


class Tethers:
    """The tethers of n robots along the ways that they have passed.

    The tension at the tail lies between that of a line which is dragged on and that of one which
    slides back; in between the line is a spring. On a leg in reverse gear it is taken in by the
    reel, along the way by which it came.

    Args:
        tether: of every robot.
        scenarios: the simulation's list.
        legs: that the robots drive.

    Attributes:
        out: (n,) m, from the opening to the tail.
        tension: (n,) N, at the tail.
    """

    def __init__(self, tether: Tether, scenarios: Sequence[Scenario], legs: Legs) -> None:
        n, first = len(scenarios), scenarios[0]
        self._tether, self._scenarios, self._legs = tether, scenarios, legs
        self._period = first.physics.control_period
        self._shortest = np.zeros(n)  # m, a shorter line is no stiffer
        self._number, self._route = np.zeros((2, n), int)
        self.out, self.tension, self._from_out, self._from_tail = np.zeros((4, n))
        self._nodes = [np.zeros((1, 3)) for _ in range(n)]

    def reset(self, rows: NDArray[np.intp], tail: Array) -> None:
        """Lay the tethers of robots ``rows`` (k,) anew, from the beginning of their routes.

        They end at the ``tail`` at arc lengths (k,) m.
        """
        masses = np.array([self._scenarios[row].robot.mass for row in rows.tolist()])
        stiffest = SETTINGS.softening * masses / self._period**2
        self._shortest = with_rows(self._shortest, rows, self._tether.stiffness / stiffest)
        self.out = with_rows(self.out, rows, np.maximum(tail, 0.0))
        for row, place in zip(rows.tolist(), tail.tolist(), strict=True):
            self._nodes[row] = self._laid(row, 0.0)
            self._follow(row, place)
        self.tension = with_rows(self.tension, rows, self._limits()[1][rows])

    def pull(self, tail: Array) -> Array:
        """Return the tensions (n,) N with the tails at arc lengths (n,) m of their legs."""
        legs = self._legs
        changed = (legs.number != self._number) | (legs.route != self._route)
        for row in np.flatnonzero(changed).tolist() if np.count_nonzero(changed) else ():
            self._turn_off(row, float(tail[row]))
        before = self.out
        self.out = np.maximum(self._from_out + legs.gear * (tail - self._from_tail), 0.0)
        low, high = self._limits()
        change = self._spring(self.out) * (self.out - before)
        self.tension = np.minimum(np.maximum(self.tension + change, low), high)
        return self.tension

    def holds(self, robot: int) -> bool:
        """Return whether a robot that stands is held by its tether."""
        used_up = self.out[robot] > self._tether.length
        weight = self._scenarios[robot].robot.mass * GRAVITY
        return bool(used_up or self.tension[robot] > SETTINGS.holding * weight)

    def words(self, robot: int) -> str:
        """Return how much of a robot's tether is out."""
        return f", {self.out[robot]:.1f} of {self._tether.length:g} m of tether out"

    def _spring(self, length: Array) -> Array:
        """Stiffness (n,) N/m of lengths of tether (n,) m."""
        return self._tether.stiffness / np.maximum(length, self._shortest)

    def _limits(self) -> tuple[Array, Array]:
        """Tensions (n,) N at which lines slide back, and at which they are dragged on."""
        s = self._table[:, :, 0]
        node = np.count_nonzero(s <= self.out[:, None], axis=1) - 1
        each, following = np.arange(len(node)), np.minimum(node + 1, s.shape[1] - 1)
        first, last = self._table[each, node], self._table[each, following]
        span = last[:, 0] - first[:, 0]
        part = (self.out - first[:, 0]) / np.where(span > 0, span, np.inf)
        high, low = (first + part[:, None] * (last - first))[:, 1:].T
        length = self._tether.length
        used_up = self._spring(np.array(length)) * np.maximum(self.out - length, 0.0)
        return low + used_up, high + used_up

    def _laid(self, row: int, start: float, tension: tuple[float, float] | None = None) -> Array:
        """Nodes of a line along a robot's route from arc length ``start`` m on."""
        segments = rest(self._legs.routes.routes[self._legs.route[row]].segments, start)
        gravity = np.array(self._scenarios[row].world.gravity)
        return self._tether.tensions(segments, gravity, tension)

    def _follow(self, row: int, tail: float) -> None:
        """Measure the paid-out length from the tail at arc length ``tail`` m of the leg at hand."""
        self._number = with_rows(self._number, np.array([row]), self._legs.number[row])
        self._route = with_rows(self._route, np.array([row]), self._legs.route[row])
        self._from_out[row], self._from_tail[row] = self.out[row], tail
        # All robots' nodes in one array: those of shorter ways end in copies of their last one.
        most = max(map(len, self._nodes))
        fill = [np.arange(most).clip(max=len(nodes) - 1) for nodes in self._nodes]
        self._table = np.array([n[f] for n, f in zip(self._nodes, fill, strict=True)])

    def _turn_off(self, row: int, tail: float) -> None:
        """Lay the tether on along a robot's new leg, where it drives forward on that."""
        if self._legs.gear[row] > 0:
            nodes, out = self._nodes[row], self.out[row]
            drag, slack = (float(np.interp(out, nodes[:, 0], nodes[:, k])) for k in (1, 2))
            further = self._laid(row, tail, (drag, slack))
            further[:, 0] += out
            self._nodes[row] = np.concatenate([nodes[nodes[:, 0] < out], further])
        self._follow(row, tail)
