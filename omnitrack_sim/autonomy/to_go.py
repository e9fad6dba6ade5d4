"""Least lengths from all ports of a network at once to a goal, or to the nearest of several, for a
robot that never turns round."""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.planning import Way

if TYPE_CHECKING:
    import networkx


class ToGo:
    """How far it is to the nearest goal for a robot that comes into a part by one of its ports.

    It leaves by another port, so it never turns round. It may come through a part a second time,
    back from a loop: then no shortest way of ``planning.shortest_way`` is as short.

    Args:
        graph: of ``planning.port_graph``. goals: ports to get to, one of them.

    Attributes:
        lengths: m, for each port that is come in by, from there to the goal.
    """

    def __init__(self, graph: networkx.DiGraph[Any], goals: Collection[End]) -> None:
        self._graph, self._goals = graph, set(goals)
        self.lengths: dict[End, float] = {}
        self._leave: dict[End, End] = {}
        waiting = [(0.0, goal) for goal in goals if goal in graph]
        heapq.heapify(waiting)
        while waiting:
            rest, leave = heapq.heappop(waiting)
            for enter, edge in graph.pred[leave].items():
                length = rest + edge["length"]
                if enter[0] == leave[0] and length < self.lengths.get(enter, math.inf):
                    self.lengths[enter], self._leave[enter] = length, leave
                    for before in graph.pred[enter]:
                        if before[0] != enter[0]:
                            heapq.heappush(waiting, (length, before))

    def options(self, enter: End) -> Iterator[tuple[End, float]]:
        """The ports by which a part that is come into by ``enter`` may be left, with the least
        length from ``enter`` to a goal, m."""
        if enter not in self._graph:
            return
        for leave, edge in self._graph.succ[enter].items():
            if leave[0] == enter[0]:
                beyond = self._beyond(leave)
                rest = math.inf if beyond is None else self.lengths.get(beyond, math.inf)
                rest = 0.0 if leave in self._goals else rest
                if rest < math.inf:
                    yield leave, edge["length"] + rest

    def way(self, enter: End) -> Way | None:
        """The shortest way on from ``enter``, where there is one that comes to no port twice."""
        way, seen = list[tuple[int, str, str]](), set[End]()
        here: End | None = enter
        while here is not None and here in self._leave:
            leave = self._leave[here]
            if seen & {here, leave}:
                return None
            seen |= {here, leave}
            way.append((here[0], here[1], leave[1]))
            if leave in self._goals:
                return tuple(way)
            here = self._beyond(leave)
        return None

    def _beyond(self, leave: End) -> End | None:
        """The port that ``leave`` is joined to."""
        for other in self._graph.succ[leave]:
            if other[0] != leave[0]:
                return other
        return None
