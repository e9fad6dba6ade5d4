"""Odometry beside the truth: encoders of the wrong sign, which look like bad luck, are told."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, set_rows
from omnitrack_sim.record.events import Event, Remark
from omnitrack_sim.robots.sensor import State

REVERSED = -0.9
"""Correlation of measured and true travel below which they are opposite.

Right odometry has one near 1, and one that slips on the spot near 0: it cannot come near -1 but by
a wrong sign, or where the robot slides back while its drives run.
"""


class OdometryCheck:
    """Comparison of the travel that n robots measure with that by which they truly move.

    The robots know nothing of it: it is told to whoever reads the record.

    Args:
        name: of the class of the odometry.
        path: m, that a robot moves along its axis, to and fro, before it is judged: less than it
            takes to be found without headway, which is what a robot that seems to go backward is.
        state: of the physics as they begin.
    """

    def __init__(self, name: str, path: float, state: State) -> None:
        self._name, self._path, n = name, path, len(state["time"])
        self._position = state["position"].copy()
        self._products = np.zeros((n, 3))
        self._moved, self._told = np.zeros(n), np.zeros(n, bool)

    def reset(self, rows: NDArray[np.intp], state: State) -> None:
        """Begin anew for robots ``rows`` (k,)."""
        set_rows(self, rows, _position=state["position"][rows], _products=0.0, _moved=0.0)
        set_rows(self, rows, _told=False)

    def compare(self, travel: Array, state: State, active: NDArray[np.bool_]) -> list[Event]:
        """Compare one control period; return an event for each robot found to be opposite.

        Args:
            travel: (n,) m, by odometry, along the robots' axes.
            state: of the physics at the end of the period.
            active: (n,) robots that count.
        """
        step, self._position = state["position"] - self._position, state["position"].copy()
        moved = (step * state["rotation"][:, :, 2]).sum(axis=1)
        measured, moved = np.where(active, travel, 0.0), np.where(active, moved, 0.0)
        self._products += np.stack([measured * moved, measured**2, moved**2], axis=1)
        self._moved += np.abs(moved)
        both, own, true = self._products.T
        wrong = ~self._told & (self._moved > self._path) & (both < REVERSED * np.sqrt(own * true))
        self._told |= wrong
        return [self._event(int(i), float(state["time"][i])) for i in np.flatnonzero(wrong)]

    def _event(self, robot: int, time: float) -> Event:
        words = (
            f"odometry: over {self._moved[robot]:.2f} m it has measured travel backward where the "
            f"robot moved forward, or the reverse: {self._name}.surfaces, or what "
            f"{self._name}.motion makes of it, has the wrong sign, unless the robot slides back "
            "while its drives run"
        )
        return Remark(robot, time, words)
