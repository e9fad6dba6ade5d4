"""Pipe networks as files, and routes and missions through them."""

from omnitrack_sim.network.ahead import Ahead, Look, Sight
from omnitrack_sim.network.compare import MapDifference, compare_maps
from omnitrack_sim.network.exploration import Exploration
from omnitrack_sim.network.goals import Mission
from omnitrack_sim.network.mission import Planner
from omnitrack_sim.network.planning import Leg, shortest_route
from omnitrack_sim.network.random import random_network
from omnitrack_sim.network.spec import Network, load_network, validate

__all__ = [
    "Ahead",
    "Exploration",
    "Leg",
    "Look",
    "MapDifference",
    "Mission",
    "Network",
    "Planner",
    "Sight",
    "compare_maps",
    "load_network",
    "random_network",
    "shortest_route",
    "validate",
]
