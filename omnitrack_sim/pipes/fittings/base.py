"""Fittings: the contract that every kind of pipe fulfils, shipped or brought by a user.

A kind of fitting is one class in one module. A new one names its keys (``Table``), its ports, its
axes, its exact inner surface, and how that surface is made of wall pieces, of solids for pictures
and of compiled functions; then networks, routes, controllers, colliders, meshes and drawings
take it like any other.

Frames: a fitting has its own right-handed frame. One that is not round about the z axis lies with
its axes in the plane y = 0, which pictures cut it along. Port frames have z out of the fitting.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose, frame_of
from omnitrack_sim.base.table import Size, Table, Unit
from omnitrack_sim.pipes.compiled import Wall, distances
from omnitrack_sim.pipes.native import SIGNATURES, CompilationError, c_function
from omnitrack_sim.pipes.obstacles import Obstacle
from omnitrack_sim.pipes.sections import Section
from omnitrack_sim.pipes.shapes import Kit, Pieces, Solid, stave_count

BORE = 0.16
"""Bore of a pipe where a file does not say otherwise, m."""
X, Y, Z = np.eye(3)
"""Unit vectors of the fitting frame."""
Manoeuvre = Literal["elbow", "tee_turn", "tee_straight"]
"""Preparation of a robot for a fitting, and its drive through it: round a bend; round the corner of
a branch, where its inner module loses the wall; straight over an opening."""


class Arcs(NamedTuple):
    """Radii, m, of the arcs that the centreline takes between a run and its branch.

    A short fitting gets as wide an arc as fits it.

    Out of a branch the far wall of the run turns the robot while its tail is still in the branch: a
    wide arc, which begins to turn early and turns slowly, passes more often there; into a branch a
    tight one (docs/studies/tee-turn.md).
    """

    turn: float = 0.09
    merge: float = 0.14


ARCS = Arcs()


@dataclass(frozen=True)
class AxisCurve:
    """A curve along a fitting's axis, fitting frame.

    Attributes:
        point: (3,) m, where it starts.
        tangent: (3,) unit vector there, its direction.
        normal: (3,) unit vector there, to the side that it bends to, or, where it does not bend,
            the one that an opening is on.
        segments: length m and curvature 1/m of each line (curvature 0) or arc, in order. Arcs that
            bend away from the normal, carried along, have a curvature below 0.
    """

    point: Array
    tangent: Array
    normal: Array
    segments: tuple[tuple[float, float], ...]

    @property
    def length(self) -> float:
        """Arc length, m."""
        return sum(length for length, _ in self.segments)


class Axis(NamedTuple):
    """One of the lines that a fitting's bore lies about.

    Attributes:
        curve: the line.
        start_radius, end_radius: bore radius at its ends, m; linear between.
    """

    curve: AxisCurve
    start_radius: float
    end_radius: float


@dataclass(frozen=True)
class Description:
    """Passage from one port of a fitting to another, as a robot has to know it.

    Attributes:
        words: for people: "run to branch"; the fitting's kind where there is no more to say.
        manoeuvre: what a robot has to do; None where it drives on as it is.
        into_branch, out_of_branch: whether the way leads round the corner of a branch.
        opening: arc length, m, from the port that is entered to the middle of an opening in the
            wall, and half of its length, m; None without one.
        turn_angle: by how much the way turns, rad; 0 straight on. The aligner derives from it how
            a robot has to be turned about its axis before the corner of a branch.
    """

    words: str
    manoeuvre: Manoeuvre | None = None
    into_branch: bool = False
    out_of_branch: bool = False
    opening: tuple[float, float] | None = None
    turn_angle: float = 0.0


Bore = Annotated[Size, Unit("m")]
"""Key of a file: a diameter, m. Lists of sizes have the bores of the ports."""


class FittingTable(Table):
    """Keys of a fitting in files; every kind adds its own. Each number has its ``Unit`` beside it.

    A key is the name of the constructor's argument. One that ends in ``_deg`` stands, in degrees,
    for an argument in radians that has no such ending.
    """

    inner_diameter: Bore = BORE
    """The bore; of a reducer that at its port `start`; joined bores differ by at most 1 mm."""


class Fitting(ABC):
    """A kind of pipe. Kinds are frozen dataclasses that check their sizes in ``__post_init__``.

    Attributes:
        kind: one word; the name in files of the kinds that come with the package.
        port_names: in the order that is used everywhere; the first is where a network begins.
        default_way: ports that a scenario's pipe is entered and left at where it does not say.
        is_plain: whether it is a straight of one bore, which a robot passes without any manoeuvre.
        closed_ports: ports at which a flat wall ends the pipe; nothing is joined to them.
        inner_diameter: bore, m, at the first port and wherever no other key is for it.
        Table: keys of its file form.
        wall: its wall as compiled functions; see ``compiled.Wall``.

    Example:
        >>> isinstance(ot.Tee(), ot.Fitting)
        True
        >>> distance, gradient = ot.Straight(0.5).signed_distance([0.0, 0.05, 0.2])
        >>> round(float(distance), 6)  # m from the wall of a bore of 160 mm
        0.03
    """

    kind: ClassVar[str]
    port_names: ClassVar[tuple[str, ...]] = ("start", "end")
    default_way: ClassVar[tuple[str, str]] = ("start", "end")
    is_plain: ClassVar[bool] = False
    closed_ports: ClassVar[tuple[str, ...]] = ()
    inner_diameter: float
    Table: ClassVar[type[FittingTable]]
    wall: ClassVar[Wall]

    # In files

    @classmethod
    def file_kind(cls) -> str:
        """Return the ``kind`` of its tables in files: a word, or a user's ``module:Class``."""
        # A user's class must be importable by its name again when the file is read on another day.
        shipped = cls.__module__.startswith(f"{__package__}.")
        return cls.kind if shipped else f"{cls.__module__}:{cls.__qualname__}"

    @classmethod
    def from_table(cls, table: FittingTable) -> Self:
        """Return the fitting that a table describes; further keys of the table do not count.

        Raises:
            GeometryError: sizes that do not go together.
        """
        values = {key: getattr(table, key) for key in cls.Table.model_fields}
        return cls(
            **{
                key.removesuffix("_deg"): math.radians(value) if key.endswith("_deg") else value
                for key, value in values.items()
                # The class has the default of a key that may be left out.
                if value is not None
            }
        )

    def to_table(self) -> dict[str, Any]:
        """Its table in a file as plain data, with every key and the kind."""
        table: dict[str, Any] = {"kind": self.file_kind()}
        for key in self.Table.model_fields:
            value = getattr(self, key.removesuffix("_deg"))
            table[key] = math.degrees(value) if key.endswith("_deg") else value
        return table

    def bore_key(self, port: str) -> str:
        """Return the key that gives the bore at a port."""
        return "inner_diameter"

    # Ports and axes

    def extended(self, length: float) -> Fitting:
        """Return the fitting with bores that go on by ``length`` m behind its closed ports.

        These are the walls of bodies that sink into the end.
        """
        return self

    @property
    def radius(self) -> float:
        """Bore radius at the first port, m."""
        return self.inner_diameter / 2

    def port_radius(self, port: str) -> float:
        """Bore radius at a port, m; where the bore is no circle, that of the largest one in it."""
        return self.radius

    @property
    def is_round(self) -> bool:
        """True if the bore is a circle at every port."""
        return all(self.edge(port) is None for port in self.port_names)

    def port_reach(self, port: str) -> float:
        """Greatest distance of the bore's edge at a port from the port's z axis, m."""
        edge = self.edge(port)
        return self.port_radius(port) if edge is None else edge.max_radius

    def outline(self, port: str, angles: Array) -> Array:
        """Return the distances (...) m of the bore's edge at a port from the port's z axis.

        ``angles``: (...) rad about that axis, from the port's x axis.
        """
        edge = self.edge(port)
        if edge is not None:
            return edge.radii(angles)
        return np.full(np.shape(angles), self.port_radius(port))

    def ring(self, angles: Array) -> Array:
        """Return vectors (k, 3) of the bore's edge, in radii of the largest circle in it.

        ``angles``: (k,) rad about an axis of the fitting, from the axis curve's normal.
        """
        ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
        if self.is_round:
            return ring
        end = self.port_names[-1]
        return ring * (self.outline(end, angles) / self.port_radius(end))[:, None]

    def edge(self, port: str) -> Section | None:
        """Return the section of the bore at a port, in the port's frame; None for a circle."""
        return None

    @property
    def max_radius(self) -> float:
        """Bore radius at the widest port, m; of a bore that is no circle, the greatest."""
        return max(self.port_radius(port) for port in self.port_names)

    @property
    @abstractmethod
    def ports(self) -> Mapping[str, Pose]:
        """Port frames in the fitting frame by name, z outward."""

    @abstractmethod
    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """Return the axis curve from one port to another; ``arcs`` round a branch's corner."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The lines that the bore lies about; of two ports, the one between them.

        They are drawn, counted as the fitting's length, and searched for parts that run into each
        other.
        """
        # A fitting of three ports has no single axis and overrides this.
        start, end = self.port_names
        curve = self.axis_curve(start, end, ARCS)
        return (Axis(curve, self.port_radius(start), self.port_radius(end)),)

    @property
    def drawn_bores(self) -> tuple[Axis, ...]:
        """The lines that the bore is drawn about in maps: of a stepped one, one for each bore."""
        return self.axes

    @property
    def length_of_axes(self) -> float:
        """Length of all its axes, m."""
        return sum(axis.curve.length for axis in self.axes)

    def sharpest_bend(self, arcs: Arcs) -> float:
        """Bore radius over the radius of the sharpest arc between any two ports; 0 without one."""
        return max(
            self.port_radius(enter) / (1 / abs(curvature)) if curvature else 0.0
            for enter, leave in permutations(self.port_names, 2)
            for _, curvature in self.axis_curve(enter, leave, arcs).segments
        )

    @property
    def is_axial(self) -> bool:
        """True if the fitting lies about one straight axis.

        A bore that is a circle is then symmetric under any rotation about it.
        """
        curvatures = [k for axis in self.axes for _, k in axis.curve.segments]
        return len(self.axes) == 1 and not any(curvatures)

    @property
    def is_cut_square(self) -> bool:
        """True if the bore lies between the planes of its two ports, about one straight line."""
        return isinstance(self, Axial)

    def describe(self, enter: str, leave: str) -> Description:
        """Describe the passage from port ``enter`` to port ``leave``.

        Here it asks nothing of a robot.
        """
        return Description(self.kind)

    # The inner surface

    @classmethod
    def wall_address(cls, name: Literal["surface", "span", "clear"]) -> int:
        """Address of a function of ``wall`` as compiled C code.

        Raises:
            GeometryError: it does not compile.
        """
        try:
            return c_function(getattr(cls.wall, name), SIGNATURES[name]).address
        except CompilationError as error:
            problem = f"{name} of its wall does not compile: {error}"
            raise GeometryError(Fault(cls.file_kind(), problem)) from error

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (...,) m from points (..., 3) m to the inner surface; unit gradient (..., 3).

        Fitting frame, positive in the bore.
        Exact inside the bore and in the wall near it; the fitting is taken as open at its ports.
        """
        return distances(self.wall_address("surface"), self.sizes, points)

    @abstractmethod
    def extent(self, points: Array) -> Array:
        """Return the depth (...,) m of ``points`` (..., 3) m inside the port planes, fitting frame.

        It is negative beyond one.
        """

    @property
    @abstractmethod
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) m of a box around the bore, fitting frame."""

    @property
    @abstractmethod
    def sizes(self) -> tuple[float, ...]:
        """The numbers that the functions of ``wall`` get; over ``MAX_SIZES`` are kept for good."""

    @property
    def wall_sizes(self) -> tuple[float, ...]:
        """The sizes of the wall without its ``obstacles``, which touch bodies by themselves."""
        return self.sizes

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What stands on the wall as solids of their own, and counts in ``sizes``."""
        return ()

    @property
    def bumps(self) -> float:
        """Width, m, of the narrowest bumps of the wall into the bore; 0 without any.

        At them a flat face may touch that is not near with its edges.
        """
        return 0.0

    @property
    def waves(self) -> float:
        """Width, m, of the narrowest waves of a wall that is smooth all over; 0 for any other.

        Samples of the distance that lie as close miss no minimum.
        """
        return 0.0

    def axis_frame(self, s: float) -> Pose:
        """Return the frame (fitting frame) of obstacles at arc length ``s`` m: z along the axis."""
        return Pose(np.eye(3), s * Z)

    def settled(self, down: Array) -> Self:
        """Return the fitting with what lies on its lowest side.

        ``down``: (3,) unit vector, fitting frame.

        Raises:
            GeometryError: it has no lowest side.
        """
        return self

    def flare(self, port: str) -> float:
        """Growth of the bore radius, m/m, on the way into the fitting right behind a port."""
        return 0.0

    def bends_at(self, port: str) -> bool:
        """Tell whether contact of a track on the neighbour's wall ends at a port.

        It does where the wall turns away from the neighbour's cylinder right behind the port.
        """
        return self.flare(port) != 0

    def depth_between(self, enter: str, leave: str, points: Array) -> Array:
        """Return the depth (...,) m of ``points`` (..., 3) m in the bore from one port to another.

        Fitting frame; it is negative in the wall and beyond the port planes, and never more than
        the distance from them. Here it is that in the whole bore; where arms branch off, those
        that are not passed do not count.
        """
        return np.minimum(self.signed_distance(points)[0], self.extent(points))

    # What it is made of elsewhere

    @abstractmethod
    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """Add its wall as boxes and capsules, fitting frame.

        Args:
            pieces: to add to.
            tolerance: m, largest distance from the exact surface.
            staves: pieces around the bore, instead of what the tolerance asks for.
        """

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """Estimate, rather too high, how many pieces ``add_walls`` adds, without making them.

        A file that asks for too many is refused. Here: staves along each of the axes that lead from
        the first port to another.
        """
        # The widest bore needs the most staves for a given sagitta.
        around = staves or stave_count(self.max_radius, tolerance)
        return around * (len(self.port_names) - 1)

    @abstractmethod
    def fill(self, kit: Kit, more: float) -> Solid:
        """Return the solid of the bore and ``more`` m around it, fitting frame.

        It lies between the port planes, and goes on by ``more`` m beyond those of closed ports.
        """

    def bore(self, kit: Kit) -> Solid:
        """Return the solid of what is empty: ``fill`` without a wall, more where rims are round."""
        return self.fill(kit, 0.0)


MAX_SIZES, MAX_PORTS, ADDRESS = 10, 4, 3
"""Room in the exact collider for the numbers and ports of a fitting; and index, in sizes that are
longer, of one that is an address in this process."""
MAX_BORE = 20.0
"""Bore, m, beyond which a diameter was meant in millimetres: water and road tunnels have 15 m."""
MILLIMETRES = ": is it in millimetres? Lengths are in metres"


def check(kind: str, **conditions: tuple[bool, str]) -> None:
    """Raise every fault of a fitting's sizes at once.

    Args:
        kind: of the fitting.
        conditions: by the name of the size: whether it is valid, and the problem if it is not.

    Raises:
        GeometryError: a condition does not hold.
    """
    faults = [
        Fault(f"{kind}.{name}", message) for name, (ok, message) in conditions.items() if not ok
    ]
    if faults:
        raise GeometryError(faults)


def positive(size: float) -> tuple[bool, str]:
    """Return the condition, for ``check``, that a size is positive."""
    return size > 0, f"is {size} m; must be positive"


def possible_bore(size: float) -> tuple[bool, str]:
    """Return the condition, for ``check``, that a size is that of a bore."""
    return (size <= MAX_BORE, f"is {size} m{MILLIMETRES}") if size > 0 else positive(size)


def port_pose(z: Array, x: Array, position: Array) -> Pose:
    """Return a port frame at ``position`` (3,) m: ``z`` out of the fitting, ``x`` across it."""
    return Pose(frame_of(x, z), position)


@dataclass(frozen=True)
class Bores:
    """Default of a size of a fitting that is similar in every bore: ``count`` inner diameters."""

    count: float


def in_bores(count: float) -> Any:
    """Return the default of a field that ``fill_in`` gives ``count`` inner diameters."""
    return Bores(count)


def fill_in(fitting: Fitting) -> list[str]:
    """Give sizes that were left out their default in bores (``in_bores``); return their names."""
    left_out = [name for name, value in vars(fitting).items() if isinstance(value, Bores)]
    for name in left_out:
        # Its class is a frozen dataclass, which is still being made here.
        size = getattr(fitting, name).count * fitting.inner_diameter
        object.__setattr__(fitting, name, size)
    return left_out


def lengthen(fitting: Fitting, left_out: Collection[str], **least: float) -> None:
    """Raise lengths, m, that were left out to the least that a rim needs; refuse shorter ones."""
    for name in least.keys() & left_out:
        object.__setattr__(fitting, name, max(getattr(fitting, name), least[name]))
    problem = "is {0} m; the rim asks for at least {1:.5f} m"
    lengths = {name: (getattr(fitting, name), size) for name, size in least.items()}
    check(
        fitting.kind,
        **{
            # Rounded up, so that the advised length passes.
            name: (own >= size - 2e-12, problem.format(own, math.ceil(1e5 * size) / 1e5))
            for name, (own, size) in lengths.items()
        },
    )


_AXIAL_START, _AXIAL_END = port_pose(-Z, X, np.zeros(3)), port_pose(Z, X, np.zeros(3))


@dataclass(frozen=True)
class Axial(Fitting):
    """A fitting whose only axis is a line of ``length`` m along +z from the origin."""

    length: float

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` at z = length; x along the fitting's x axis."""
        return {"start": _AXIAL_START, "end": Pose(_AXIAL_END.rotation, self.length * Z)}

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: the line."""
        sign = 1.0 if enter == "start" else -1.0
        return AxisCurve(self.ports[enter].position, sign * Z, X, ((self.length, 0.0),))

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        z = np.asarray(points, float)[..., 2]
        return np.minimum(z, self.length - z)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``."""
        r = self.max_radius
        return np.array([-r, -r, 0.0]), np.array([r, r, self.length])
