"""Pipes: fittings, networks, routes and their exact inner surface. Pure NumPy."""

from omnitrack_sim.pipes.assembly import (
    BORE_TOLERANCE,
    Passage,
    PipeNetwork,
    Placed,
    Route,
    Step,
    attached,
    route,
    route_through,
)
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings import TEE_ARCS, Elbow, Fitting, Reducer, Straight, Tee, TeeArcs

__all__ = [
    "BORE_TOLERANCE",
    "TEE_ARCS",
    "Centreline",
    "Elbow",
    "Fitting",
    "Passage",
    "PipeNetwork",
    "Placed",
    "Reducer",
    "Route",
    "Segment",
    "Step",
    "Straight",
    "Tee",
    "TeeArcs",
    "attached",
    "route",
    "route_through",
]
