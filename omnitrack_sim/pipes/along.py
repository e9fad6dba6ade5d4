"""A way in numbers: where along it its fittings begin, bend and end.

Planning compares many ways, and lays the centreline of none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from omnitrack_sim.pipes import Arcs, Fitting


class Passed(NamedTuple):
    """A fitting that is passed from one port to another, in arc length from the port entered.

    Attributes:
        lengths: m, of the lines and arcs of its axis.
        bend: m, where the first arc begins and the last one ends; None where it does not bend.
        opening: m, middle and half length of an opening beside the way; None without one.
        asks_orientation: whether it matters how a robot in it is turned about its axis.
    """

    lengths: tuple[float, ...]
    bend: tuple[float, float] | None
    opening: tuple[float, float] | None
    asks_orientation: bool

    @classmethod
    def of(cls, fitting: Fitting, enter: str, leave: str, arcs: Arcs) -> Passed:
        """One of a fitting's ways."""
        segments, told = (
            fitting.axis_curve(enter, leave, arcs).segments,
            fitting.describe(enter, leave),
        )
        starts = np.cumsum([0.0, *(length for length, _ in segments)]).tolist()
        bends = [i for i, (_, curvature) in enumerate(segments) if curvature > 0]
        return cls(
            tuple(length for length, _ in segments),
            (starts[bends[0]], starts[bends[-1] + 1]) if bends else None,
            told.opening,
            told.manoeuvre is not None,
        )

    @property
    def length(self) -> float:
        """Of its axis, m."""
        return sum(self.lengths)

    def span(self, begin: float) -> tuple[float, float]:
        """Arc lengths, m, where its bend or opening begins and ends if it is entered at ``begin``;
        where it asks for no orientation, its end, and nothing that ends."""
        if not self.asks_orientation:
            return begin + self.length, -math.inf
        if self.bend is not None:
            return begin + self.bend[0], begin + self.bend[1]
        middle, half = self.opening or (math.nan, math.nan)
        return begin + middle - half, begin + middle + half


@dataclass
class Along:
    """A way, fitting by fitting, as ``Route.fittings`` has it.

    Attributes:
        begins, ends: m, port planes of each fitting.
        starts: m, where each one's bend or opening begins; its end if it has neither.
        cleared: m, where the last bend or opening up to each one ends; minus infinity without one.
        length: m, of the whole way.
    """

    begins: list[float] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)
    cleared: list[float] = field(default_factory=list)
    length: float = 0.0

    @classmethod
    def of(cls, passed: Sequence[Passed]) -> Along:
        """The way that passes fittings in order."""
        along, begin, clear = cls(), 0.0, -math.inf
        for one in passed:
            start, over = one.span(begin)
            clear = over if one.asks_orientation else clear
            along.begins.append(begin)
            along.starts.append(start)
            along.cleared.append(clear)
            begin += one.length
            along.ends.append(begin)
        along.length = sum(length for one in passed for length in one.lengths)
        return along

    def at(self, distance: float) -> int:
        """Number of the fitting at arc length ``distance`` m; beyond the end the last one."""
        return next((i for i, end in enumerate(self.ends) if distance < end), len(self.ends) - 1)

    def stand(self, index: int, other: Passed, length: float, room: float) -> float:
        """Arc length, m, where a robot stands to pass fitting ``index`` another way.

        Args:
            index: of the fitting.
            other: that way.
            length: m, of the robot. room: m, before its nose.
        """
        start = other.span(self.begins[index])[0]
        while index > 0 and start - self.cleared[index - 1] < length + room:
            index -= 1
            start = self.starts[index]
        return max(start - length / 2 - room, length / 2)
