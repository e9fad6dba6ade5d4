"""Routes and legs through a network: a graph of its ports, and the shortest way between two open
ends."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.pipes import ARCS, Arcs, Route, route_through
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.network import Network

if TYPE_CHECKING:
    import networkx

Step = tuple[int, str, str]
"""A part as it is passed: its index, port entered, port left."""
Way = tuple[Step, ...]
"""Parts in order."""
Closed = Collection[End | Step]
"""What is not passed: ports, and parts from one port to another."""


@dataclass(frozen=True)
class Leg:
    """A way in one gear.

    Attributes:
        way: (part index, port entered, port left) of the parts in order.
        gear: 1 nose first, -1 tail first.
        begin, end: m, arc length of the robot's centre along the way where the leg begins and ends.
        goal: number of the goal that is reached at its end; -1 if the robot only backs out.
        note: what is done, as text.
    """

    way: Way
    gear: int
    begin: float
    end: float
    goal: int
    note: str


def port_graph(
    network: Network, arcs: Arcs = ARCS, avoid: Collection[str] = ()
) -> networkx.DiGraph[Any]:
    """Ports (part index, port name) as nodes; ``length`` m of the axis between the ports of a
    fitting, 0 at joints.

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
    left_out = set(avoid)
    graph.remove_nodes_from([node for node in graph if network.fittings[node[0]].name in left_out])
    return graph


def shortest_route(
    network: Network,
    start: str,
    goal: str,
    avoid: Iterable[str] = (),
    arcs: Arcs = ARCS,
) -> Route:
    """The shortest way from one open end to another; no fitting is passed twice.

    Args:
        network: where to go. The route keeps all of it, side branches included.
        start, goal: open ends, as ``part.port`` or by their names in ``network.ports``.
        avoid: names of fittings that are not entered.
        arcs: of the centreline in tees.

    Raises:
        NetworkError: no such port, no open end, start and goal the same, unknown fittings to avoid,
            or no way.
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
    names = [part.name for part in network.fittings]
    avoided = set(avoid)
    faults += [
        Fault("avoid", f"there is no fitting {name!r}", tuple(names), given=name)
        for name in sorted(avoided)
        if name not in names
    ]
    if faults:
        raise NetworkError(faults)
    way = shortest_way(port_graph(network, arcs, avoided), ends[0], ends[1])
    if way is None:
        raise NetworkError(unreachable("goal", start, goal, avoided))
    return route_of(network, way, arcs)


def without(graph: networkx.DiGraph[Any], closed: Closed) -> networkx.DiGraph[Any]:
    """A graph of ``port_graph`` without what is closed."""
    import networkx

    ports = [port for port in closed if len(port) == 2]
    passed = [((step[0], step[1]), (step[0], step[2])) for step in closed if len(step) == 3]
    return networkx.restricted_view(graph, ports, passed) if closed else graph


def shortest_way(graph: networkx.DiGraph[Any], start: End, goal: End) -> Way | None:
    """The shortest way between two ports of a graph of ``port_graph``; None if there is none."""
    import networkx

    # The edge between two ports of a part is the shortest way between them, so the way never
    # takes two edges of the same part one after the other.
    try:
        nodes = networkx.shortest_path(graph, start, goal, weight="length")
    except (networkx.NetworkXNoPath, networkx.NodeNotFound):
        return None
    return tuple(
        (part, enter, leave)
        for (part, enter), (_, leave) in zip(nodes[::2], nodes[1::2], strict=True)
    )


def unreachable(where: str, start: str, goal: str, avoid: Collection[str]) -> Fault:
    """The fault of a goal that cannot be reached; ``where`` names what asked for it."""
    around = f" without {', '.join(sorted(avoid))}" if avoid else ""
    return Fault(where, f"{goal!r} cannot be reached from {start!r}{around}")


def route_of(network: Network, way: Way, arcs: Arcs = ARCS) -> Route:
    """A way through a network with its centreline."""
    return route_through(network.pipes, way, arcs)
