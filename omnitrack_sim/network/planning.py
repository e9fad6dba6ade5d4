"""Routes through a network: a graph of ports, and the shortest way between two open ends."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from typing import TYPE_CHECKING, Any

from omnitrack_sim.errors import Fault, NetworkError
from omnitrack_sim.network.spec import Network
from omnitrack_sim.pipes import TEE_TURN_RADIUS, Route, route_through

if TYPE_CHECKING:
    import networkx


def port_graph(network: Network, tee_turn_radius: float = TEE_TURN_RADIUS) -> networkx.Graph[Any]:
    """Ports (part index, port name) as nodes; ``length`` m of the axis between the ports of a fitting, 0 at joints."""
    import networkx

    graph = networkx.Graph()
    for i, part in enumerate(network.pipes.parts):
        for enter, leave in combinations(part.fitting.choices, 2):
            path = part.fitting.path(enter, leave, tee_turn_radius)
            graph.add_edge((i, enter), (i, leave), length=sum(length for length, _ in path.segments))
    graph.add_edges_from(network.pipes.joints, length=0.0)
    return graph


def shortest_route(
    network: Network,
    start: str,
    goal: str,
    avoid: Iterable[str] = (),
    tee_turn_radius: float = TEE_TURN_RADIUS,
) -> Route:
    """The shortest way from one open end to another; no fitting is passed twice.

    Args:
        network: where to go. The route keeps all of it, side branches included.
        start, goal: open ends, as ``part.port`` or by their names in ``network.ports``.
        avoid: names of fittings that are not entered.
        tee_turn_radius: m, radius of the centreline's arc between run and branch.

    Raises:
        NetworkError: no such port, no open end, start and goal the same, unknown fittings to avoid, or no way.
        GeometryError: the arc does not fit a tee.
    """
    import networkx

    # Between two ports of one fitting the direct edge is the shortest, so each fitting is passed at most once.
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
        Fault("avoid", f"there is no fitting {name!r}", tuple(names)) for name in sorted(avoided) if name not in names
    ]
    if faults:
        raise NetworkError(faults)
    graph = port_graph(network, tee_turn_radius)
    graph.remove_nodes_from([node for node in graph if names[node[0]] in avoided])
    try:
        nodes = networkx.shortest_path(graph, ends[0], ends[1], weight="length")
    except (networkx.NetworkXNoPath, networkx.NodeNotFound):
        around = f" without {', '.join(sorted(avoided))}" if avoided else ""
        raise NetworkError(Fault("goal", f"{goal!r} cannot be reached from {start!r}{around}")) from None
    way = [(part, enter, leave) for (part, enter), (_, leave) in zip(nodes[::2], nodes[1::2], strict=True)]
    return route_through(network.pipes, way, tee_turn_radius)
