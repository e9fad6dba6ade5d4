"""Path planning in a network: a graph of its ports, and shortest paths through it.

A path is a tuple of edges, each a part from one port to another. A leg is a path driven in one
gear, from one arc length to another.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.pipes import ARCS, Arcs, Port, Route, route_through
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.routes import Edge

if TYPE_CHECKING:
    import networkx

Closed = Collection[Port | Edge]
"""Ports, and edges between ports, that are not passed."""


@dataclass(frozen=True)
class Leg:
    """A stretch of a route, driven in one gear.

    Attributes:
        path: edges of the graph of ports, in order.
        gear: 1 nose first, -1 tail first.
        begin: m, arc length of the robot's centre along the route where the leg begins.
        end: m, arc length of the robot's centre where it ends.
        goal: number of the goal that is reached at its end; -1 if the robot only backs out.
        note: the manoeuvre, as text.
    """

    path: tuple[Edge, ...]
    gear: int
    begin: float
    end: float
    goal: int = -1
    note: str = ""


def port_graph(
    network: Network, arcs: Arcs = ARCS, avoid: Collection[str] = ()
) -> networkx.DiGraph[Any]:
    """Return the graph of a network's ports (part index, port name).

    Its edges have a ``length``, m, of the axis between two ports of a fitting, or 0 at a joint.

    Fittings to ``avoid`` are left out.
    """
    import networkx

    graph = networkx.DiGraph()
    for i, part in enumerate(network.pipes.parts):
        for enter, leave in permutations(part.fitting.port_names, 2):
            curve = part.fitting.axis_curve(enter, leave, arcs)
            graph.add_edge((i, enter), (i, leave), length=curve.length)
    for a, b in network.pipes.joints:
        graph.add_edge(a, b, length=0.0)
        graph.add_edge(b, a, length=0.0)
    # Nodes are removed only now, since adding a joint's edges would bring them back.
    left_out = set(avoid)
    graph.remove_nodes_from([node for node in graph if network.fittings[node[0]].name in left_out])
    return graph


def without(
    graph: networkx.DiGraph[Any], closed: Closed, joints: Collection[tuple[Port, Port]] = ()
) -> networkx.DiGraph[Any]:
    """Return a view of a graph of ports without what is closed, and without some joints.

    A joint is given from one port to another.
    """
    import networkx

    ports = [port for port in closed if len(port) == 2]
    edges = [((edge[0], edge[1]), (edge[0], edge[2])) for edge in closed if len(edge) == 3]
    return networkx.restricted_view(graph, ports, [*edges, *joints])


def shortest_path(graph: networkx.DiGraph[Any], start: Port, goal: Port) -> tuple[Edge, ...] | None:
    """Return the shortest path between two ports of a graph of ports; None if there is none."""
    import networkx

    # The edge between two ports of a part is the shortest way between them, so the path never
    # takes two edges of the same part one after the other.
    try:
        nodes = networkx.shortest_path(graph, start, goal, weight="length")
    except (networkx.NetworkXNoPath, networkx.NodeNotFound):
        return None
    return tuple(
        (part, enter, leave)
        for (part, enter), (_, leave) in zip(nodes[::2], nodes[1::2], strict=True)
    )


class PathsToGoals:
    """Shortest paths from all ports to the nearest of several goals, for a robot that never turns.

    It leaves a part by another port than it entered.

    It may come through a part a second time, back from a loop: then no path of ``shortest_path`` is
    as short.

    Args:
        graph: of ``port_graph``.
        goals: ports to get to, one of them.

    Attributes:
        lengths: m, from each port at which a part is entered to the nearest goal.
    """

    def __init__(self, graph: networkx.DiGraph[Any], goals: Collection[Port]) -> None:
        self._graph, self._goals = graph, set(goals)
        self.lengths: dict[Port, float] = {}
        self._leave: dict[Port, Port] = {}
        # Dijkstra's algorithm, backward from the goals.
        waiting = [(0.0, goal) for goal in goals if goal in graph]
        heapq.heapify(waiting)
        while waiting:
            rest, leave = heapq.heappop(waiting)
            for enter, edge in graph.pred[leave].items():
                length = rest + edge["length"]
                # Only within a part: from a joint the search goes on to the part behind it.
                if enter[0] == leave[0] and length < self.lengths.get(enter, math.inf):
                    self.lengths[enter], self._leave[enter] = length, leave
                    # Backward through the joint: the exit of the part before it.
                    for before in graph.pred[enter]:
                        if before[0] != enter[0]:
                            heapq.heappush(waiting, (length, before))

    def exits(self, enter: Port) -> Iterator[tuple[str, float]]:
        """Exits of a part entered by ``enter``, with the remaining distance to a goal, m."""
        if enter not in self._graph:
            return
        for leave, edge in self._graph.succ[enter].items():
            if leave[0] == enter[0]:
                rest = 0.0 if leave in self._goals else self._distance_to_goal(leave)
                if rest < math.inf:
                    yield leave[1], edge["length"] + rest

    def path(self, enter: Port) -> tuple[Edge, ...] | None:
        """Return the shortest path on from ``enter``; None where it passes a port twice."""
        path, passed = list[Edge](), set[Port]()
        here: Port | None = enter
        while here is not None and here in self._leave:
            leave = self._leave[here]
            if passed & {here, leave}:
                return None
            passed |= {here, leave}
            path.append((here[0], here[1], leave[1]))
            if leave in self._goals:
                return tuple(path)
            here = self._joined_to(leave)
        return None

    def _distance_to_goal(self, leave: Port) -> float:
        """Distance to a goal beyond an exit, m; infinite where no path leads on."""
        beyond = self._joined_to(leave)
        return math.inf if beyond is None else self.lengths.get(beyond, math.inf)

    def _joined_to(self, leave: Port) -> Port | None:
        return next((port for port in self._graph.succ[leave] if port[0] != leave[0]), None)


def shortest_route(
    network: Network,
    start: str,
    goal: str,
    avoid: Iterable[str] = (),
    arcs: Arcs = ARCS,
) -> Route:
    """Return the shortest route from one open end to another; no fitting is passed twice.

    Args:
        network: all of it is kept in the route, side branches included.
        start: open end, as ``part.port`` or by its name in ``network.ports``.
        goal: likewise.
        avoid: names of fittings that are not entered.
        arcs: of the centreline in tees.

    Raises:
        NetworkError: no such port, no open end, start and goal the same, unknown fittings to avoid,
            or no path.

    Example:
        >>> import omnitrack_sim as ot
        >>> route = ot.shortest_route(ot.load_network("fig14"), "inlet", "low")
        >>> route.passages[0].kind
        'straight'
    """
    check_is(Network, "network", network)
    ends, faults = [], []
    for where, port in (("start", start), ("goal", goal)):
        try:
            ends.append(network.end(where, port))
        except NetworkError as error:
            faults += error.faults
    if len(ends) == 2 and ends[0] == ends[1]:
        faults.append(Fault("goal", f"{goal!r} is the start"))
    avoided = set(avoid)
    faults += unknown_fittings(network, [("avoid", name) for name in sorted(avoided)])
    if faults:
        raise NetworkError(faults)
    path = shortest_path(port_graph(network, arcs, avoided), ends[0], ends[1])
    if path is None:
        raise NetworkError(unreachable("goal", start, goal, avoided))
    return route_through(network.pipes, path, arcs)


def around_route(
    network: Network, start: str, goal: str, reach: float = 1.0
) -> tuple[Network, str, str]:
    """Return the parts of a town on and beside the shortest route between two places, and its ends.

    Args:
        network: of the town.
        start: an open end, or a fitting, at which the town is cut: the robot is put into the pipe
            behind it.
        goal: likewise.
        reach: m of pipe, as of ``Network.around``.

    Raises:
        NetworkError: no such place, or no path.

    Example:
        >>> import omnitrack_sim as ot
        >>> from omnitrack_sim.pipes.planning import around_route
        >>> part, start, goal = around_route(ot.load_network("fig14"), "inlet", "low", reach=0.1)
        >>> len(part.fittings), start
        (11, 'inlet')
    """
    number = {fitting.name: i for i, fitting in enumerate(network.fittings)}
    import networkx

    # A node's name in ``ports`` comes before that of a fitting.
    cut = [name for name in (start, goal) if name in number and name not in network.ports]
    graph = port_graph(network)
    ends: list[list[Port]] = []
    for where, place in (("start", start), ("goals.0", goal)):
        joined = [
            b if a[0] == number[place] else a
            for a, b in network.pipes.joints
            if place in cut and number[place] in (a[0], b[0])
        ]
        ends.append(joined if place in cut else [network.end(where, place)])
    graph.remove_nodes_from([port for port in graph if network.fittings[port[0]].name in cut])
    # Two nodes more, before all ports that the route may begin at and behind those it may end at.
    first, last = (-1, "first"), (-1, "last")
    graph.add_edges_from(((first, port) for port in ends[0]), length=0.0)
    graph.add_edges_from(((port, last) for port in ends[1]), length=0.0)
    try:
        ports = networkx.shortest_path(graph, first, last, weight="length")[1:-1]
    except (networkx.NetworkXNoPath, networkx.NodeNotFound):
        raise NetworkError(unreachable("goals.0", start, goal, ())) from None
    names = dict.fromkeys(network.fittings[part].name for part, _ in ports)
    begin = network.port_name(ports[0]) if start in cut else start
    end = network.port_name(ports[-1]) if goal in cut else goal
    return network.around([*names], reach, cut), begin, end


def unknown_fittings(network: Network, names: Iterable[tuple[str, str]]) -> list[Fault]:
    """Faults of names, each with its place in a file or call, that no fitting has."""
    known = tuple(dict.fromkeys(part.name for part in network.fittings))
    return [
        Fault(where, f"there is no fitting {name!r}", known, given=name)
        for where, name in names
        if name not in known
    ]


def unreachable(where: str, start: str, goal: str, avoid: Collection[str]) -> Fault:
    """Return the fault of a goal that cannot be reached; ``where`` names the argument."""
    around = f" without {', '.join(sorted(avoid))}" if avoid else ""
    return Fault(where, f"{goal!r} cannot be reached from {start!r}{around}")
