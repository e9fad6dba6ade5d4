"""Pipes: fittings, assemblies, routes and their exact inner surface, without MuJoCo.

All that a fitting of a user's own needs is imported from here; docs/extending.md has an example.
"""

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.assembly import BORE_TOLERANCE, Assembly, Part, attached
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.compiled import EDGE, FACE, Wall, clip, compiled, put
from omnitrack_sim.pipes.fittings.base import (
    ARCS,
    BORE,
    Arcs,
    Axial,
    Axis,
    AxisCurve,
    Bore,
    Description,
    Fitting,
    FittingTable,
    X,
    Y,
    Z,
    check,
    port_pose,
    positive,
)
from omnitrack_sim.pipes.fittings.cross import Cross
from omnitrack_sim.pipes.fittings.elbow import Elbow
from omnitrack_sim.pipes.fittings.mitre import Mitre
from omnitrack_sim.pipes.fittings.reducer import Reducer
from omnitrack_sim.pipes.fittings.straight import Straight
from omnitrack_sim.pipes.fittings.tee import Tee
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.pipes.routes import Passage, Route, Step, route, route_through
from omnitrack_sim.pipes.shapes import Kit, Pieces, Ring, Solid, stave_count

__all__ = [
    "ARCS",
    "BORE",
    "BORE_TOLERANCE",
    "EDGE",
    "FACE",
    "Arcs",
    "Array",
    "Assembly",
    "Axial",
    "Axis",
    "AxisCurve",
    "Bore",
    "Centreline",
    "Cross",
    "Description",
    "Elbow",
    "Fitting",
    "FittingTable",
    "Kit",
    "Mitre",
    "Part",
    "Passage",
    "Pieces",
    "Pose",
    "Reducer",
    "Ring",
    "Route",
    "Segment",
    "Size",
    "Solid",
    "Step",
    "Straight",
    "Tee",
    "Unit",
    "Wall",
    "Wye",
    "X",
    "Y",
    "Z",
    "attached",
    "check",
    "clip",
    "compiled",
    "port_pose",
    "positive",
    "put",
    "route",
    "route_through",
    "stave_count",
]
