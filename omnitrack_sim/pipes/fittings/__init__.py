"""Kinds of fittings, one a module. A module put into this folder is found by itself."""

from omnitrack_sim.pipes.fittings.axial import Axial
from omnitrack_sim.pipes.fittings.base import (
    ARCS,
    BORE,
    Arcs,
    Axis,
    AxisCurve,
    Bore,
    Description,
    Fitting,
    FittingTable,
    Manoeuvre,
    X,
    Y,
    Z,
    bore_distance,
    check,
    port_pose,
    positive,
)
from omnitrack_sim.pipes.fittings.elbow import Elbow
from omnitrack_sim.pipes.fittings.reducer import Reducer
from omnitrack_sim.pipes.fittings.registry import (
    fitting_class,
    known_fittings,
    shipped_fittings,
)
from omnitrack_sim.pipes.fittings.straight import Straight
from omnitrack_sim.pipes.fittings.tee import Tee

__all__ = [
    "ARCS",
    "BORE",
    "Arcs",
    "Axial",
    "Axis",
    "AxisCurve",
    "Bore",
    "Description",
    "Elbow",
    "Fitting",
    "FittingTable",
    "Manoeuvre",
    "Reducer",
    "Straight",
    "Tee",
    "X",
    "Y",
    "Z",
    "bore_distance",
    "check",
    "fitting_class",
    "known_fittings",
    "port_pose",
    "positive",
    "shipped_fittings",
]
