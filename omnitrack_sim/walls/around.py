"""Exact pipes around any robot: ``add_pipes``, and ``Pipes``, which tells where points lie."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from ctypes import CFUNCTYPE
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Part, Port
from omnitrack_sim.pipes.assembly import JOINED, Stretch, touching
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.fittings.base import MAX_SIZES
from omnitrack_sim.pipes.native import INTEGER, NUMBERS, WORD, c_function, pointers
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.obstacles import Obstacle
from omnitrack_sim.walls.collider import FIRM_TIME
from omnitrack_sim.walls.geoms import (
    MIN_ROOM,
    WALL_COLOUR,
    add_ends,
    add_exact_walls,
    add_rims,
)
from omnitrack_sim.walls.guard import add_guard, register
from omnitrack_sim.walls.pipe_looks import PIPE_GROUP, add_pipe_insides
from omnitrack_sim.walls.rays import RayWalls
from omnitrack_sim.walls.record import DEPTH_IN_BORE, kinds, long_sizes

LINE, BEGIN, LENGTH, CURVATURE, POINT, TANGENT, NORMAL, ROW = 0, 1, 2, 3, 4, 7, 10, 13
"""Indices in the row of a segment, and its size: number of the line among those of its part, arc
length at which it begins, m, length, m, curvature, 1/m, and first point (3), tangent (3) and normal
(3), world frame."""
ANSWER = 5
"""Numbers of an answer: arc length, m, tangent (3), number of the line."""
_ALONG = CFUNCTYPE(INTEGER, NUMBERS, NUMBERS, NUMBERS, NUMBERS, WORD, NUMBERS)


class Axes:
    """Axes of placed parts, to look points up on.

    Args:
        parts: of an assembly.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        rows, ends = [], [0]
        for part in parts:
            for number, axis in enumerate(part.fitting.axes):
                begin = 0.0
                for segment in part.segments(axis.curve):
                    along = [number, begin, segment.length, segment.curvature]
                    rows.append([*along, *segment.point, *segment.tangent, *segment.normal])
                    begin += segment.length
            ends.append(len(rows))
        self._rows, self._ends = np.array(rows), np.array(ends, float)

    def along(self, points: Array, parts: Array) -> tuple[Array, Array, Array]:
        """Look up the nearest place on the axes of the part that each point lies in.

        Args:
            points: (n, 3) m, world frame.
            parts: (n,) number of the part, negative for none.

        Returns:
            Arc lengths (n,) m and unit tangents (n, 3), NaN for points in no part; and which of the
            part's lines it is (n,), -1 for none.
        """
        answers = np.empty((len(points), ANSWER))
        arrays = self._rows, self._ends, np.ascontiguousarray(points), np.ascontiguousarray(parts)
        along = c_function(_along, _ALONG).ctypes
        along(*pointers(*arrays), len(points), *pointers(answers))
        return answers[:, 0], answers[:, 1:4], answers[:, 4]


@compiled
def _on_segment(rows, r, x, y, z):
    """Return the arc length of a segment's place nearest to a point, and the squared distance."""
    dx, dy, dz = x - rows[r + POINT], y - rows[r + POINT + 1], z - rows[r + POINT + 2]
    t, n = r + TANGENT, r + NORMAL
    ahead = dx * rows[t] + dy * rows[t + 1] + dz * rows[t + 2]
    aside = dx * rows[n] + dy * rows[n + 1] + dz * rows[n + 2]
    square, k, length = dx * dx + dy * dy + dz * dz, rows[r + CURVATURE], rows[r + LENGTH]
    if k == 0.0:
        s = min(max(ahead, 0.0), length)
        return s, square - ahead * ahead + (ahead - s) * (ahead - s)
    # Behind the start by less than half of what the arc leaves of the circle counts as the start.
    angle = math.atan2(ahead * k, 1.0 - aside * k)
    if angle < 0.5 * length * k - math.pi:
        angle += 2.0 * math.pi
    s = min(max(angle / k, 0.0), length)
    a, b = ahead - math.sin(s * k) / k, aside - (1.0 - math.cos(s * k)) / k
    return s, square - ahead * ahead - aside * aside + a * a + b * b


def _along(rows, ends, points, parts, count, answers):
    """Write the answers (count, ANSWER) of points (count, 3) in parts (count,), see ``Axes``."""
    for i in range(count):
        a, best = ANSWER * i, math.inf
        for j in range(4):
            answers[a + j] = math.nan
        answers[a + 4] = -1.0
        if parts[i] < 0.0:
            continue
        for row in range(int(ends[int(parts[i])]), int(ends[int(parts[i]) + 1])):
            r = ROW * row
            s, square = _on_segment(rows, r, points[3 * i], points[3 * i + 1], points[3 * i + 2])
            if square < best:
                best, k = square, rows[r + CURVATURE]
                answers[a], answers[a + 4] = rows[r + BEGIN] + s, rows[r + LINE]
                for j in range(3):
                    tangent, normal = rows[r + TANGENT + j], rows[r + NORMAL + j]
                    answers[a + 1 + j] = math.cos(s * k) * tangent + math.sin(s * k) * normal
    return 0


YIELDING = {
    "contype": 1,
    "conaffinity": 1,
    "condim": 1,
    "friction": [0.0, 0.0, 0.0],
    "solmix": 0.0,
    "margin": 0.0,
    "gap": 0.0,
    "mass": 0.0,
    "rgba": [*WALL_COLOUR[:3], 0.0],
}
"""Attributes of walls that leave every contact to the robot's geom: MuJoCo takes the larger
friction and dimension, and mixes the rest by ``solmix``. What they do not state is that of the
model's own default class. Without opacity a wall's box is neither drawn nor met by MuJoCo's own
rays."""

DECIDING = {
    "priority": 1,
    "condim": 3,
    "solmix": 1.0,
    "solref": [FIRM_TIME, 1.0],
    "solimp": [0.9, 0.95, 0.001, 0.5, 2.0],
}
"""Attributes of walls that state a friction: these outrank those of the robot's geoms. With
MuJoCo's own contact time, 20 ms, wheels sink in and run 2 % slower."""
THROUGH = 1e-3
"""Depth, m, to which a plane may reach into a bore before it is told of."""
ATTRIBUTES = (
    "conaffinity",
    "condim",
    "contype",
    "gap",
    "group",
    "margin",
    "priority",
    "rgba",
    "solimp",
    "solmix",
    "solref",
    "surfacevel",
)
"""Attributes of a geom that a user may give the walls."""


def add_pipes(
    spec: mujoco.MjSpec,
    network: Network | Assembly,
    *,
    friction: float | None = None,
    body: mujoco.MjsBody | None = None,
    visible: bool = False,
    **attributes: Any,
) -> Pipes:
    """Put exact pipes around any robot.

    Spheres, capsules, cylinders, ellipsoids, boxes and meshes (their convex hulls) of the model
    touch the exact surface of every fitting. ``mj_step``, rollouts, batches, copies and pickles
    work as ever. The first process on a machine compiles the walls, which takes some 10 s.

    Args:
        spec: of the robot, before or after its bodies are added; its geoms and their user data
            stay. The world gets a geom ``wall_<part>`` for each fitting, one
            ``relief_<part>_<index>`` for each solid of its relief, ``deposit_<part>_<index>`` for
            one with a friction of its own, and one ``rim_<part>_<port>`` for each open end and
            each other sharp edge; and a sensor without values, with which ``MjSpec.attach`` takes
            the walls' plugin along.
        network: the pipes.
        friction: sliding friction of the walls, which then decides, with a contact time of 5 ms;
            None: friction and contact time are those of the robot's geoms.
        body: that carries the pipes, in whose frame the network then stands; None: the world.
        visible: add the bores as meshes ``look_inside_<part>`` that nothing touches (group 1), for
            MuJoCo's own viewer and renderer, which look into them through the nearer wall.
        attributes: of the walls' geoms, by MuJoCo's names; see ``ATTRIBUTES``.

    Raises:
        InputError: the model has flexes or geoms of signed distance fields, which MuJoCo does not
            collide by its table of functions, or pipes with parts of the same names; or an
            argument is not what it should be.
        GeometryError: a fitting of one's own has a wall that does not compile.

    Warns:
        UserWarning: a plane of the model's world lies in a bore.

    Example:
        >>> import mujoco
        >>> spec = mujoco.MjSpec()
        >>> ball = spec.worldbody.add_body(pos=[0.0, 0.0, 0.2])
        >>> _ = ball.add_freejoint(), ball.add_geom(size=[0.02, 0, 0])
        >>> network = ot.Network(fittings=[{"kind": "straight", "name": "a", "length": 0.5}])
        >>> pipes = ot.add_pipes(spec, network, friction=0.8)
        >>> model = spec.compile()
        >>> data = mujoco.MjData(model)
        >>> mujoco.mj_step(model, data, 10)
        >>> bool(pipes.clearance(data.body(1).xpos) > 0.02)
        True
    """
    _check(spec)
    pipes = Pipes(network)
    _check_arguments(spec, pipes.assembly, friction, body, attributes)
    if body is None:
        _warn_of_planes(spec, pipes.assembly)
    walls = wall_attributes(friction, attributes)
    depths = solid_depths(pipes.assembly)
    ends = {end: end_depth(pipes.assembly, end, depths) for end in pipes.assembly.closed_ends}
    deposits = DECIDING | dict(attributes)
    add_exact_walls(spec, pipes.assembly, depths, ends, body, deposits, **walls)
    add_rims(spec, pipes.assembly, depths, body, **walls)
    add_ends(spec, pipes.assembly, ends, body, **walls)
    if visible:
        add_pipe_insides(spec, pipes.assembly, body, PIPE_GROUP)
    add_guard(spec, f"wall_{pipes.assembly.parts[0].name}")
    return pipes


def wall_attributes(friction: float | None, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes of the geoms of walls and plates, as ``add_pipes`` takes both."""
    # A wall with a friction of its own has to outrank the robot's: MuJoCo's default is 1.
    deciding: dict[str, Any] = {}
    if friction is not None:
        deciding = DECIDING | {"friction": [friction, 0.005, 0.0001]}
    # MuJoCo divides by the friction of a contact that has one.
    deciding |= {"condim": 1} if friction == 0 else {}
    return YIELDING | deciding | dict(attributes)


def solid_depths(network: Assembly) -> list[float]:
    """Return the depths, m, to which the walls of an assembly's parts are solid.

    They are as deep as bodies may be thrown into them, and half of the way to the nearest other
    bore at most.
    """
    depths = [DEPTH_IN_BORE * part.fitting.max_radius for part in network.parts]
    joined = {frozenset((i, j)) for (i, _), (j, _) in network.joints}
    every = [(i, stretch) for i, part in enumerate(network.parts) for stretch in part.stretches()]
    centres = np.array([stretch.centre for _, stretch in every])
    reach = np.array([stretch.reach + depths[i] / 2 for i, stretch in every])
    for one, other in (pair for block in touching(centres, reach) for pair in block.tolist()):
        for (i, _), (j, stretch) in ((every[one], every[other]), (every[other], every[one])):
            if i != j and frozenset((i, j)) not in joined:
                gap = _gap(network.parts[i], network.parts[j], stretch)
                depths[i] = min(depths[i], max(gap / 2, MIN_ROOM))
    return depths


def end_depth(network: Assembly, end: Port, depths: Sequence[float]) -> float:
    """Return the depth, m, to which a closed end is solid: half of the way to a bore behind it."""
    part, port = network.parts[end[0]], network.parts[end[0]].port(end[1])
    whole = DEPTH_IN_BORE * part.fitting.max_radius
    across, inverse, far = (
        part.fitting.port_reach(end[1]) + depths[end[0]],
        port.inverse(),
        4 * whole,
    )
    depth = whole
    for other in network.parts:
        for stretch in other.stretches() if other is not part else ():
            if np.linalg.norm(stretch.centre - port.position) < stretch.reach + far:
                x, y, behind = inverse.apply(other.bore_samples(stretch)).T
                there = (behind > JOINED) & (np.hypot(x, y) < across)
                depth = min(depth, behind[there].min(initial=np.inf) / 2)
    return max(depth, MIN_ROOM)


def _gap(part: Part, other: Part, stretch: Stretch) -> float:
    """Return the least thickness, m, of a part's wall towards a stretch of another's bore."""
    points = other.bore_samples(stretch)
    beside = points[part.extent(points) > 0]
    # Samples stand off their own wall by 5 % of the radius (``Part.bore_samples``).
    inset = 0.05 * other.fitting.max_radius
    return -float(part.signed_distance(beside)[0].max(initial=-np.inf)) - inset


def _check(spec: mujoco.MjSpec) -> None:
    """Refuse what exact walls cannot touch."""
    if not isinstance(spec, mujoco.MjSpec):
        problem = (
            f"is a {type(spec).__name__}; walls are added to an MjSpec, such as "
            "mujoco.MjSpec.from_file gives, before it is compiled (a binary model has none)"
        )
        raise InputError(Fault("spec", problem))
    faults = [
        Fault(f"spec.flexes.{i}", "is a flex, which would pass through exact walls")
        for i in range(len(spec.flexes))
    ]
    faults += [
        Fault(f"spec.geoms.{geom.name or i}", "is a signed distance field; take its mesh instead")
        for i, geom in enumerate(spec.geoms)
        if geom.type == mujoco.mjtGeom.mjGEOM_SDF
    ]
    if faults:
        raise InputError(faults)


def _warn_of_planes(spec: mujoco.MjSpec, network: Assembly) -> None:
    """Warn of a floor of the model that stands in a bore."""
    points = np.concatenate(
        [part.bore_samples(stretch) for part in network.parts for stretch in part.stretches()]
    )
    for geom in spec.worldbody.geoms:
        touches = geom.contype | geom.conaffinity
        if geom.type != mujoco.mjtGeom.mjGEOM_PLANE or not touches:
            continue
        normal, place = matrix_from_quaternion(np.array(geom.quat))[:, 2], np.array(geom.pos)
        if ((points - place) @ normal).min() < -THROUGH:
            warnings.warn(
                f"the plane {geom.name!r} of the world lies in the pipes, and the robot would "
                "stand on it: delete it (spec.delete), or take ot.Mjcf(file=...).spec(), which is "
                "the robot of a file alone",
                stacklevel=3,
            )


def _check_arguments(
    spec: mujoco.MjSpec, network: Assembly, friction: Any, body: Any, attributes: Mapping[str, Any]
) -> None:
    """Refuse what MuJoCo would refuse without a reason, or take without a word."""
    faults = [
        Fault(name, "is no attribute that walls take", ATTRIBUTES, given=name)
        for name in sorted(set(attributes) - set(ATTRIBUTES))
    ]
    real = isinstance(friction, int | float) and not isinstance(friction, bool)
    if friction is not None and not (real and 0 <= friction < math.inf):
        problem = f"is {friction!r}; a number from 0 on, the sliding friction, is needed"
        faults.append(Fault("friction", problem))
    if body is not None and not isinstance(body, mujoco.MjsBody):
        problem = f"is a {type(body).__name__}; a body of the MjSpec is needed, as spec.body gives"
        faults.append(Fault("body", problem))
    names = {geom.name for geom in spec.geoms}
    twice = [part.name for part in network.parts if f"wall_{part.name}" in names]
    if twice:
        problem = f"has a part {twice[0]!r} that the model has a wall of already"
        faults.append(Fault("network", f"{problem}; parts of two networks need different names"))
    if faults:
        raise InputError(faults)


class AxisPoints(NamedTuple):
    """Nearest points on the axes of pipes to some points, and clearances from the walls.

    Attributes:
        part: (...,) number of the part in the assembly; -1 outside all port planes.
        line: (...,) which of the part's axes the point is nearest to; of a tee 0 is the run, 1 the
            branch. -1 outside.
        arc_length: (...,) m, along that axis; NaN outside, like the following.
        clearance: (...,) m, from the wall; negative within it.
        axis: (..., 3) unit tangent of the axis there, world frame.
    """

    part: Any
    line: Any
    arc_length: Array
    clearance: Array
    axis: Array


class Pipes:
    """Exact pipes around a robot, and what is measured in them.

    ``add_pipes`` returns them. Made by themselves they prepare a process for a model that was saved
    with these pipes: without them the file is refused.

    Attributes:
        assembly: the fittings, placed in the world.

    Example:
        >>> pipes = ot.Pipes(ot.load_network("fig14"))
        >>> round(float(pipes.clearance(pipes.assembly.parts[0].pose.apply([0.0, 0.05, 0.1]))), 6)
        0.03
    """

    def __init__(self, network: Network | Assembly) -> None:
        if not isinstance(network, Assembly):
            network = check_is(Network, "network", network).pipes
        self.assembly = network
        register()
        for part in self.assembly.parts:
            kinds.add(type(part.fitting))
            if part.fitting.obstacles:
                kinds.add(Obstacle)
            if len(part.fitting.wall_sizes) > MAX_SIZES:
                long_sizes.add(part.fitting.wall_sizes)
        self._walls = RayWalls([self.assembly.parts], [self.assembly.closed_ends])
        self._axes = Axes(self.assembly.parts)

    def geoms(self, model: mujoco.MjModel) -> NDArray[np.intp]:
        """Return the numbers of the pipes' geoms in a model: walls, relief, rims, plates, looks.

        Raises:
            InputError: the model lacks the wall of a part.
        """
        names = {model.geom(i).name: i for i in range(model.ngeom)}
        missing = [part.name for part in self.assembly.parts if f"wall_{part.name}" not in names]
        if missing:
            problem = f"has no wall of the part {missing[0]!r}: these pipes were not added to it"
            raise InputError(Fault("model", problem))
        kinds = ("wall_{0}", "rim_{0}_{1}", "plate_{0}_{1}", "look_inside_{0}")
        wanted = {
            kind.format(part.name, port)
            for part in self.assembly.parts
            for port in part.fitting.port_names
            for kind in kinds
        }
        wanted |= {
            f"{kind}_{part.name}_{index}"
            for part in self.assembly.parts
            for index in range(len(part.fitting.obstacles))
            for kind in ("relief", "deposit")
        }
        return np.array(sorted(names[name] for name in wanted & set(names)), np.intp)

    def clearance(self, points: ArrayLike) -> Array:
        """Return the distances (...,) m of points (..., 3) m, world frame, from the walls.

        Positive in a bore, negative within a wall, NaN outside the port planes of all fittings.
        """
        return self.locate(points).clearance

    def locate(self, points: ArrayLike) -> AxisPoints:
        """Return where points (..., 3) m, world frame, lie in the pipes.

        Example:
            >>> pipes = ot.Pipes(ot.load_network("fig14"))
            >>> place = pipes.locate(pipes.assembly.parts[0].pose.apply([0.0, 0.05, 0.1]))
            >>> pipes.assembly.parts[place.part].name, round(float(place.arc_length), 3)
            ('riser', 0.1)
        """
        points = np.asarray(points, float)
        shape, flat = points.shape[:-1], points.reshape(-1, 3)
        distance, _, part = self._walls.nearest(np.zeros(1, int), flat[None])
        arc_length, axis, line = self._axes.along(flat, part[0])
        distance = np.where(part < 0, np.nan, distance)
        for index, port in self.assembly.closed_ends:
            wall = self.assembly.parts[index].port(port)
            before = (wall.position - flat) @ wall.rotation[:, 2]
            distance = np.where(part == index, np.minimum(distance, before), distance)
        return AxisPoints(
            part[0].astype(int).reshape(shape)[()],
            line.astype(int).reshape(shape)[()],
            arc_length.reshape(shape),
            distance.reshape(shape),
            axis.reshape(points.shape),
        )

    def rays(self, position: ArrayLike, directions: ArrayLike, far: float = 10.0) -> Array:
        """Return the distances (...,) m to the walls along rays; infinite where they meet none.

        Args:
            position: (3,) m, world frame, in a bore.
            directions: (..., 3) world frame, of any length above 0.
            far: m, beyond which nothing is seen.
        """
        directions = np.asarray(directions, float)
        flat = directions.reshape(-1, 3)
        unit_rays = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        start, frame = np.asarray(position, float)[None], np.eye(3)[None]
        hits = self._walls.trace(np.zeros(1, int), start, frame, unit_rays, far)
        return hits[0, :, 0].reshape(directions.shape[:-1])

    def depth(
        self,
        data: mujoco.MjData,
        camera: str,
        size: tuple[int, int] = (160, 120),
        far: float = 10.0,
    ) -> Array:
        """Return the depth picture (height, width) m that a camera of the model sees of the walls.

        Distances along its optical axis, infinite for none. The robot itself is not seen.

        Args:
            data: whose cameras are in place, as after ``mj_step`` or ``mj_forward``.
            camera: name; its ``fovy`` counts.
            size: width and height, pixels.
            far: m, length of a ray beyond which nothing is seen.

        Raises:
            InputError: the cameras are not in place yet.
        """
        width, height = size
        number = data.model.camera(camera).id
        if not data.cam_xmat[number].any():
            problem = "its cameras are not in place yet; call mujoco.mj_forward(model, data) before"
            raise InputError(Fault("data", problem))
        # Pixel centres on the plane at distance 1; a camera of MuJoCo looks along -z, y is up.
        pixel = 2 * math.tan(math.radians(data.model.cam_fovy[number]) / 2) / height
        x = (np.arange(width) - (width - 1) / 2) * pixel
        y = ((height - 1) / 2 - np.arange(height)) * pixel
        rays = np.stack([*np.meshgrid(x, y), -np.ones((height, width))], axis=-1)
        turned = rays @ data.cam_xmat[number].reshape(3, 3).T
        return self.rays(data.cam_xpos[number], turned, far) / np.linalg.norm(rays, axis=-1)
