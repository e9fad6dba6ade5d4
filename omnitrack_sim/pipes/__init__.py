"""Pipes: fittings, networks, routes and their exact inner surface. Pure NumPy."""

from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings import Elbow, Fitting, Reducer, Straight, Tee
from omnitrack_sim.pipes.network import (
    BORE_TOLERANCE,
    TEE_TURN_RADIUS,
    Passage,
    PipeNetwork,
    Placed,
    Route,
    Step,
    attached,
    route,
    route_through,
)

__all__ = [
    "BORE_TOLERANCE",
    "TEE_TURN_RADIUS",
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
    "attached",
    "route",
    "route_through",
]
