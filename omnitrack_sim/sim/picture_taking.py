"""Pictures that n robots take in the true pipes: when, from which end, and which pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import set_rows, with_rows
from omnitrack_sim.results.pictures import Album, Pictures, coding_of
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.senses.draws import Keys
from omnitrack_sim.senses.optics import Eyes


class PictureTaking:
    """Takes the pictures of n robots when they are due.

    Args:
        eyes: their cameras in the pipes as they are.
        period: s between two control steps.
        both_ends: cameras at both ends take turns.
        compared: (k,) pixels that are compared with the map, counted row by row.
        records: all pixels are kept.

    Attributes:
        eyes: as given.
        latency: control steps until a picture arrives.
        due: (n,) bool, robots that take one at this control step.
        picture: (n, k) the last one of each, of the compared pixels.
    """

    def __init__(
        self,
        eyes: Eyes,
        period: float,
        both_ends: bool,
        compared: NDArray[np.intp],
        records: bool,
    ) -> None:
        n, camera = len(eyes.keys), eyes.mount.camera
        self.eyes, self._both_ends = eyes, both_ends
        self._every = round(1 / (camera.optics.rate * period))
        self.latency = round(camera.optics.latency / period)
        # A recorded picture has all pixels. Noise belongs to a pixel, so the compared ones are the
        # same.
        self._pixels = np.arange(len(eyes.mount.rays)) if records else compared
        self._metered = np.searchsorted(self._pixels, compared)
        self._album = Album(coding_of(camera), n) if records else None
        self._tick, self._taken = np.zeros((2, n), int)
        self.due = np.zeros(n, bool)
        self.picture = np.zeros((n, len(compared)))

    def reset(self, rows: NDArray[np.intp], keys: Keys) -> None:
        """Begin anew for robots ``rows`` (k,), whose random numbers have ``keys`` (k,)."""
        self.eyes.reset(rows, keys)
        set_rows(self, rows, _tick=0, _taken=0, due=True, picture=np.nan)

    def advance(self) -> None:
        """Go on by a control step."""
        self._tick = self._tick + 1
        self.due = self._tick % self._every == 0

    def facing(self, gear: NDArray[np.int_]) -> NDArray[np.int_]:
        """Return the ends (n,), 1 nose and -1 tail, that robots look from next.

        Args:
            gear: (n,) 1 nose first, -1 tail first; the leading end comes first.
        """
        behind = (self._taken % 2 == 1) & self._both_ends
        return np.where(behind, -gear, gear)

    def take(
        self,
        state: State,
        facing: NDArray[np.int_],
        due: NDArray[np.bool_],
        active: NDArray[np.bool_],
    ) -> None:
        """Take pictures of the true pipes.

        Args:
            state: of the physics.
            facing: (n,) see ``facing``.
            due: (n,) robots whose turn it is.
            active: (n,) robots whose run is not over.
        """
        robots = np.flatnonzero(due & active)
        numbers = self._taken[robots]
        # One number for all robots is drawn faster, with the same result.
        number = int(self._taken[0]) if np.ptp(self._taken) == 0 else numbers
        position, rotation = state["position"][robots], state["rotation"][robots]
        taken = self.eyes.take(
            robots, position, rotation, facing[robots], number, self._pixels, self._metered
        )
        self.picture = with_rows(self.picture, robots, taken[:, self._metered])
        if self._album is not None:
            whole = np.full((len(facing), len(self._pixels)), np.nan)
            whole[robots] = taken
            self._album.add(state["time"], facing, whole, active)
        self._taken = self._taken + due

    def pictures(self) -> Sequence[Pictures | None]:
        """Return the pictures that each robot has taken, where they are recorded."""
        return [None] * len(self.due) if self._album is None else self._album.pictures()
