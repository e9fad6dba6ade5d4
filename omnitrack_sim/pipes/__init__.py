"""Pipes: fittings, assemblies, routes and their exact inner surface, without MuJoCo.

All that a fitting of a user's own needs is imported from here; docs/how-to/extending.md has an
example.
"""

from omnitrack_sim.base.rotations import Array as Array
from omnitrack_sim.base.rotations import Pose as Pose
from omnitrack_sim.base.table import Size as Size
from omnitrack_sim.base.table import Unit as Unit
from omnitrack_sim.pipes.assembly import BORE_TOLERANCE as BORE_TOLERANCE
from omnitrack_sim.pipes.assembly import Assembly as Assembly
from omnitrack_sim.pipes.assembly import Part as Part
from omnitrack_sim.pipes.assembly import Port as Port
from omnitrack_sim.pipes.assembly import attached as attached
from omnitrack_sim.pipes.centreline import Centreline as Centreline
from omnitrack_sim.pipes.centreline import Segment as Segment
from omnitrack_sim.pipes.compiled import EDGE as EDGE
from omnitrack_sim.pipes.compiled import FACE as FACE
from omnitrack_sim.pipes.compiled import Wall as Wall
from omnitrack_sim.pipes.compiled import clip as clip
from omnitrack_sim.pipes.compiled import compiled as compiled
from omnitrack_sim.pipes.compiled import put as put
from omnitrack_sim.pipes.fittings.base import ARCS as ARCS
from omnitrack_sim.pipes.fittings.base import BORE as BORE
from omnitrack_sim.pipes.fittings.base import Arcs as Arcs
from omnitrack_sim.pipes.fittings.base import Axial as Axial
from omnitrack_sim.pipes.fittings.base import Axis as Axis
from omnitrack_sim.pipes.fittings.base import AxisCurve as AxisCurve
from omnitrack_sim.pipes.fittings.base import Bore as Bore
from omnitrack_sim.pipes.fittings.base import Description as Description
from omnitrack_sim.pipes.fittings.base import Fitting as Fitting
from omnitrack_sim.pipes.fittings.base import FittingTable as FittingTable
from omnitrack_sim.pipes.fittings.base import X as X
from omnitrack_sim.pipes.fittings.base import Y as Y
from omnitrack_sim.pipes.fittings.base import Z as Z
from omnitrack_sim.pipes.fittings.base import check as check
from omnitrack_sim.pipes.fittings.base import port_pose as port_pose
from omnitrack_sim.pipes.fittings.base import positive as positive
from omnitrack_sim.pipes.fittings.coupling import Coupling as Coupling
from omnitrack_sim.pipes.fittings.cross import Cross as Cross
from omnitrack_sim.pipes.fittings.elbow import Elbow as Elbow
from omnitrack_sim.pipes.fittings.mitre import Mitre as Mitre
from omnitrack_sim.pipes.fittings.reducer import Reducer as Reducer
from omnitrack_sim.pipes.fittings.straight import Straight as Straight
from omnitrack_sim.pipes.fittings.tee import Tee as Tee
from omnitrack_sim.pipes.fittings.wye import Wye as Wye
from omnitrack_sim.pipes.routes import Passage as Passage
from omnitrack_sim.pipes.routes import Route as Route
from omnitrack_sim.pipes.routes import Step as Step
from omnitrack_sim.pipes.routes import route as route
from omnitrack_sim.pipes.routes import route_through as route_through
from omnitrack_sim.pipes.shapes import Kit as Kit
from omnitrack_sim.pipes.shapes import Pieces as Pieces
from omnitrack_sim.pipes.shapes import Ring as Ring
from omnitrack_sim.pipes.shapes import Solid as Solid
from omnitrack_sim.pipes.shapes import stave_count as stave_count
