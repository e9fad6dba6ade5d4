"""Pace of a window: steps that are due in step with wall time, pictures and rests between them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

LADDER = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0, 16.0, math.inf)
"""Speeds that can be chosen, simulated over wall seconds; the last one is as fast as possible."""
FRAME = 1 / 30
"""Wall time between two pictures, s."""
LATE_FRAME = 0.25
"""The same while steps are overdue, s."""
STINT = 0.1
"""Wall time that steps may take before keys are looked at again, s."""
MAX_OVERDUE = 0.5
"""Largest delay of steps, s of wall time; beyond it simulated time falls behind."""
_MEASURED = 1.0  # s of wall time over which the reached speed is measured
_ROUNDING = 1e-9  # s


class Stepped(Protocol):
    """Protocol of what is played, step by step."""

    @property
    def time(self) -> float:
        """Simulated time, s."""
        ...

    @property
    def next_time(self) -> float | None:
        """Time after the next step, s; None at the end."""
        ...

    def step(self) -> None:
        """Take one step."""


class Pace:
    """Takes the steps that are due, and says when to draw and how long to sleep.

    Steps come first: while some are overdue there are fewer pictures. What the machine cannot make
    up for is given up, so that simulated time falls behind and does not hurry afterwards.

    Args:
        speed: simulated over wall seconds; infinite: as fast as possible.
        clock: wall time, s.

    Attributes:
        speed: as above.
        paused: no steps are due.
        reached: the speed of the last second.
        overdue: steps are late.
    """

    def __init__(self, speed: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        self.speed, self.paused, self._clock = speed, False, clock
        self.reached, self.overdue = 0.0, False
        self._from: tuple[float, float] | None = None  # wall and simulated time, s, in step
        self._drawn = -math.inf
        self._mark: tuple[float, float] | None = None

    def anew(self) -> None:
        """Count from now on: after a leap, a pause, another speed."""
        self._from = self._mark = None
        self.overdue = False

    def faster(self, steps: int) -> None:
        """The speed that is ``steps`` further up the ladder, or down it."""
        nearest = min(
            range(len(LADDER)), key=lambda i: abs(self._log(LADDER[i]) - self._log(self.speed))
        )
        self.speed = LADDER[min(max(nearest + steps, 0), len(LADDER) - 1)]
        self.anew()

    @staticmethod
    def _log(speed: float) -> float:
        # The infinite speed is one rung above the fastest finite one.
        return min(math.log2(speed), math.log2(LADDER[-2]) + 1)

    def advance(self, run: Stepped) -> None:
        """Take the steps that are due by now."""
        now = self._clock()
        if self.paused or run.next_time is None:
            self.anew()
            return
        if self._from is None:
            self._from = self._mark = (now, run.time)
        wall, simulated = self._from
        due = simulated + (now - wall) * self.speed if now > wall else simulated
        while run.next_time is not None and run.next_time <= due + _ROUNDING:
            run.step()
            if self._clock() > now + STINT:
                break
        self.overdue = run.next_time is not None and run.next_time <= due + _ROUNDING
        # Without this a slow stretch would be followed by a rush.
        if self.overdue and (due - run.time) / self.speed > MAX_OVERDUE:
            self._from = (self._clock(), run.time)
        self._measure(run.time)

    def _measure(self, simulated: float) -> None:
        now = self._clock()
        if self._mark is None:
            self._mark = (now, simulated)
        wall, before = self._mark
        if now - wall >= _MEASURED:
            self.reached, self._mark = (simulated - before) / (now - wall), (now, simulated)

    def begin_frame(self) -> bool:
        """Begin a frame if one is due, and return whether; the next is due a frame later."""
        now = self._clock()
        if now - self._drawn < (LATE_FRAME if self.overdue else FRAME) - _ROUNDING:
            return False
        self._drawn = now
        return True

    def rest(self, run: Stepped) -> float:
        """Return the time, s, in which nothing will be due; a key may come before."""
        if self.overdue:
            return 0.0
        now = self._clock()
        left = self._drawn + FRAME - now
        if self._from is not None and run.next_time is not None and not self.paused:
            wall, simulated = self._from
            left = min(left, wall + (run.next_time - simulated) / self.speed - now)
        return max(left, 0.0)
