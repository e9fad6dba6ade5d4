"""Pipes: fittings, assemblies, routes and their exact inner surface. Pure NumPy."""

from omnitrack_sim.pipes.assembly import BORE_TOLERANCE, Assembly, Part, attached
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings import ARCS, Arcs, Elbow, Fitting, Reducer, Straight, Tee
from omnitrack_sim.pipes.routes import Passage, Route, Step, route, route_through

__all__ = [
    "ARCS",
    "BORE_TOLERANCE",
    "Arcs",
    "Assembly",
    "Centreline",
    "Elbow",
    "Fitting",
    "Part",
    "Passage",
    "Reducer",
    "Route",
    "Segment",
    "Step",
    "Straight",
    "Tee",
    "attached",
    "route",
    "route_through",
]
