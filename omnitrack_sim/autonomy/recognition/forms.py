"""Sightings, and the forms of what may lie ahead with the numbers that describe them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.pipes import Elbow, Fitting, Part, Port, Reducer, Straight, Tee, attached
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.walls.rays import RayWalls


@dataclass(frozen=True)
class Detection:
    """Detection of what lies ahead in a straight pipe.

    The robot frame has its origin at the lens, z forward and x towards module 1. Where two
    directions are the same, as from the branch of a tee, the turn is one of them.

    Attributes:
        kind: "straight", "elbow", "tee", "wye", "reducer", "open end" or "closed end".
        enter: port by which the fitting is entered, "" without one. An elbow and a reducer are
            reported as entered by `start`, which describes them whichever way they lie.
        sizes: keys of the fitting's constructor in SI units.
        distance: m, from the lens along the pipe's axis to the port plane; of "straight": how far
            is seen to be straight.
        turn: rad, angle about the robot's forward axis from the robot's x axis to the x axis of the
            port that is entered: to where an elbow bends and a branch opens, and, where a branch is
            entered, along the run (of a wye: to its `run_end`). 0 for what is round about the axis.
        covariance: (2 + k, 2 + k) of distance, turn and the k sizes, m and rad; infinite for a
            straight pipe.
        confidence: probability of the kind and the port; below
            ``RECOGNISER.confidence`` the detection is ambiguous.
        aside: (2,) m, where the pipe's axis lies in the robot's frame, nearest to the lens.
        tilt: (2,) rad, by which the pipe's axis leans from the robot's towards its x and y.
    """

    kind: str
    enter: str
    sizes: dict[str, float]
    distance: float
    turn: float
    covariance: Array
    confidence: float
    aside: Array
    tilt: Array

    @property
    def stds(self) -> Array:
        """Standard deviations (2 + k,) of distance, turn and sizes, m and rad."""
        return np.sqrt(np.diag(self.covariance))


OWN, SIZES = 2, 4
"""Most sizes of a form alone, and of one with another directly behind it."""
ANGLE = LENGTH = 1
"""Places of the angle in the sizes of an elbow, and of the length in those of a reducer."""
PIECE = 0
"""Place of the length in the sizes of a piece of straight pipe between two joints."""
ASIDE, TILT, DISTANCE, TURN, PLACES = slice(0, 2), slice(2, 4), 4, 5, 6
"""Places in a row of numbers: m and rad, as of a ``Detection``."""


def cameras(numbers: Array, motions: list[Pose]) -> tuple[Array, Array]:
    """Return positions and rotations of v cameras for rows of numbers (n, 6).

    (n, v, 3) m and (n, v, 3, 3), in the frame of the port plane (z on into the fitting, x as of the
    port).
    """
    turn, tilt = numbers[:, TURN], numbers[:, TILT]
    cos, sin = np.cos(turn), np.sin(turn)
    back, axis = np.zeros((len(turn), 3, 3)), np.zeros((len(turn), 3))
    back[:, 0, 0], back[:, 0, 1] = cos, sin
    back[:, 1, 0], back[:, 1, 1] = -sin, cos
    back[:, 2, 2] = 1.0
    lean = np.hypot(tilt[:, 0], tilt[:, 1])
    axis[:, 0], axis[:, 1] = -tilt[:, 1], tilt[:, 0]
    # Without a tilt any axis will do, but not the zero vector.
    axis[lean == 0] = 0.0, 0.0, 1.0
    leaning = rotation_about(axis, lean)
    rotation = back @ leaning.transpose(0, 2, 1)  # (n, 3, 3) camera to port
    lens = -np.concatenate([numbers[:, ASIDE], numbers[:, DISTANCE, None]], axis=1)
    position = np.einsum("nij,nj->ni", back, lens)
    turned = np.stack([motion.rotation for motion in motions])
    moved = np.stack([motion.position for motion in motions])
    places = position[:, None] + np.einsum("nij,vj->nvi", rotation, moved)
    return places, rotation[:, None] @ turned[None]


@dataclass(frozen=True)
class PosePrior:
    """Normal prior of a camera's numbers, see ``cameras``; distance and direction are free.

    Attributes:
        mean: (6,).
        std: (6,).
    """

    mean: Array
    std: Array

    @property
    def nearest(self) -> float:
        """Least distance, m, of a fitting.

        In straight pipe it is ahead of the lens; beyond a known port that the lens may have passed
        it begins there at the earliest.
        """
        return 0.0 if self is CENTRED else float(self.mean[DISTANCE]) - RECOGNISER.port_std


CENTRED = PosePrior(np.zeros(PLACES), RECOGNISER.camera_std)
"""Prior of a camera in straight pipe, of which the picture itself tells more."""


def numbers_at(port: Pose, position: Array, frame: Array) -> Array:
    """Return the numbers (6,) of a camera before a port: the inverse of ``cameras``.

    The camera is at ``position`` (3,) m with ``frame`` (3, 3), the port has z outward. The
    direction is 0.
    """
    axis = frame.T @ port.rotation[:, 2]
    across = float(np.hypot(axis[0], axis[1]))
    lean = math.atan2(across, float(axis[2]))
    tilt = lean / across * axis[:2] if across > 0 else np.zeros(2)
    row = np.array([0.0, 0.0, *tilt, 0.0, 0.0])
    x, y, z = cameras(row[None], [STILL])[1][0, 0] @ frame.T @ (port.position - position)
    return np.array([x, y, *tilt, z, 0.0])


def straightened(numbers: Array, directions: Array, radius: float) -> Array:
    """Map rays of a camera on the pipe's axis to those of one displaced.

    For the same points of a straight wall: ``directions`` (k, 3) in camera frames, ``numbers`` (6,)
    of the displaced one.
    """
    across = np.hypot(directions[:, 0], directions[:, 1])
    points = directions * (radius / across)[:, None]
    points = points + np.array([*numbers[ASIDE], 0.0])
    row = np.concatenate([numbers[:TURN], [0.0]])[None]
    rotation = cameras(row, [STILL])[1][0, 0]
    rays = points @ rotation  # port to camera
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


STILL = Pose(np.eye(3), np.zeros(3))
"""Pose of the camera at the last picture, in its frame then."""


Map = tuple[tuple[Part, ...], tuple[Port, ...]]
"""Parts, and the ports of them that a plate closes."""
WallMaker = Callable[[Sequence[Sequence[Part]], Sequence[Sequence[Port]]], RayWalls]
"""Makes walls of maps and the ports that plates close, such as ``walls.rays.RayWalls``."""


@dataclass(frozen=True)
class Size:
    """A size of a fitting that is sought.

    Attributes:
        key: of the fitting's constructor.
        low: lower bound.
        high: upper bound.
        step: of its finite differences.
        middle: mean of its prior.
        spread: standard deviation of its prior.
    """

    key: str
    low: float
    high: float
    step: float
    middle: float
    spread: float


@dataclass(frozen=True)
class Form:
    """Hypothesis of what lies ahead.

    Attributes:
        name: of its own.
        kind: see ``Detection``.
        enter: see ``Detection``.
        make: the fitting of given sizes; none: the pipe ends, or goes on.
        closed: a plate closes the pipe.
        ends: the pipe ends.
        sizes: that are sought, its own before those of ``behind``.
        starts: their values that the search begins with.
        period: rad, turn after which it looks the same; 0 for what is round about the axis.
        behind: another form that begins at its end; None where straights do.
    """

    name: str
    kind: str
    enter: str = ""
    make: Callable[..., Fitting] | None = None
    closed: bool = False
    ends: bool = False
    sizes: tuple[Size, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ((),)
    period: float = 0.0
    behind: Form | None = None

    def before(self, other: Form) -> Form:
        """Return this form with another directly behind it."""
        name, sizes = f"{self.name} before {other.name}", (*self.sizes, *other.sizes)
        return replace(self, name=name, period=other.period, sizes=sizes, behind=other)

    @property
    def own_sizes(self) -> tuple[Size, ...]:
        """Those of ``sizes`` that are not of ``behind``."""
        further = 0 if self.behind is None else len(self.behind.sizes)
        return self.sizes[: len(self.sizes) - further]

    @property
    def parameters(self) -> int:
        """Number of parameters besides the camera's pose across the straight pipe."""
        placed = self.ends or self.make is not None
        return placed + (self.period > 0) + len(self.sizes)

    @cached_property
    def sought(self) -> NDArray[np.bool_]:
        """Which of the numbers (6,) of the camera are parameters before it."""
        placed = self.ends or self.make is not None
        return np.array([True] * DISTANCE + [placed, self.period > 0])

    @property
    def padded_starts(self) -> Array:
        """Starting sizes (s, SIZES), filled up with zeros."""
        return np.array([[*start, *[0.0] * (SIZES - len(start))] for start in self.starts])

    def restarts(self, sizes: Array) -> Array:
        """Return sizes (k, SIZES) from which its search begins again.

        It has come to ``sizes`` (SIZES,). None where gradients lead to the best from anywhere.

        Start, radius and angle of a bend are nearly confounded. The length of a reducer shows by
        the dark joint at its far end, to which gradients lead from nearby only.
        """
        if self.kind == "reducer":
            low, high = self.sizes[LENGTH].low, self.sizes[LENGTH].high
            lengths = np.arange(low, high, RECOGNISER.restart_length * low)
            rows = np.tile(sizes, (len(lengths), 1))
            rows[:, LENGTH] = lengths
            return rows
        many = self.period > 0 and len(self.starts) > 1
        return self.padded_starts if many else np.empty((0, SIZES))

    def map(self, sizes: Sequence[float], bore: float) -> Map:
        """Return its parts in the frame of the port plane.

        The port plane is z = 0, the robot comes along +z, and the x axis of the port is x.
        """
        if self.make is None and not self.ends:
            middle = Pose(np.eye(3), np.array([0, 0, -RECOGNISER.beyond]))
            return (Part("straight", Straight(2 * RECOGNISER.beyond, bore), middle),), ()
        lead = _lead(bore)
        if self.make is None:
            return (lead,), (((0, "end"),) if self.closed else ())
        keys = [size.key for size in self.own_sizes]
        fitting = self.make(**dict(zip(keys, sizes[: len(keys)], strict=True)))
        parts, enter = [lead, _joined(lead, "end", fitting, self.enter)], self.enter
        if self.behind is not None:
            after, name = forms(2 * fitting.port_radius("end")), self.behind.name
            other = next(form for form in after if form.name == name)
            assert other.make is not None
            # A wider pipe has no bends as sharp as a narrower one.
            fitting = other.make(
                **{
                    size.key: min(max(value, size.low), size.high)
                    for size, value in zip(other.sizes, sizes[len(keys) :], strict=True)
                }
            )
            enter = other.enter
            parts.append(_joined(parts[-1], "end", fitting, enter))
        last = parts[-1]
        after = [
            _joined(last, port, Straight(RECOGNISER.beyond, 2 * fitting.port_radius(port)), "start")
            for port in fitting.port_names
            if port != enter
        ]
        return (*parts, *after), ()


@lru_cache(maxsize=64)
def _lead(bore: float) -> Part:
    """Return the straight pipe before every fitting."""
    start = Pose(np.eye(3), np.array([0, 0, -RECOGNISER.behind]))
    return Part("before", Straight(RECOGNISER.behind, bore), start)


def _joined(part: Part, port: str, fitting: Fitting, enter: str) -> Part:
    return Part("ahead", fitting, attached(part.port(port), fitting, enter, 0.0))


# Reducers lead to many bores, each from many lengths.
@lru_cache(maxsize=256)
def forms(bore: float) -> tuple[Form, ...]:
    """Every form for pipes of a bore, m."""
    whole, half = 2 * math.pi, math.pi
    radius = Size("mean_radius", 0.505 * bore, 3.0 * bore, 0.02 * bore, 1.2 * bore, bore)
    angle = Size("angle", math.radians(10), math.radians(120), 0.03, half / 2, 0.5)
    lean = Size("angle", math.radians(45), math.radians(75), 0.03, math.radians(52), 0.15)
    length = Size("length", 0.2 * bore, 2.5 * bore, 0.03 * bore, 0.7 * bore, 0.3 * bore)
    piece = Size("length", 0.2 * bore, RECOGNISER.beyond, 0.03 * bore, 4.0 * bore, 4.0 * bore)
    narrow = Size("end_diameter", 0.5 * bore, 0.97 * bore, 0.01 * bore, 0.8 * bore, 0.2 * bore)
    wide = Size("end_diameter", 1.03 * bore, 1.6 * bore, 0.01 * bore, 1.2 * bore, 0.2 * bore)
    elbow, reducer = partial(Elbow, inner_diameter=bore), partial(_reducer, bore)
    tee = partial(Tee, inner_diameter=bore)
    wye = partial(Wye, inner_diameter=bore, branch_diameter=bore)
    # The search starts from bends of 45 and 90 degrees and five radii, wyes of 45 and 60 degrees.
    bends = tuple(
        (r * bore, a) for r in (0.5625, 0.75, 1.0, 1.4, 1.9) for a in (half / 4, half / 2)
    )
    leans = ((half / 4,), (half / 3,))
    return (
        Form("straight", "straight"),
        # Behind a joint of straight pipes the next one follows, or none where light reaches.
        Form(
            "joint",
            "straight",
            "start",
            partial(Straight, inner_diameter=bore),
            sizes=(piece,),
            starts=((RECOGNISER.beyond,),),
        ),
        Form("elbow", "elbow", "start", elbow, sizes=(radius, angle), starts=bends, period=whole),
        Form("tee over", "tee", "run_start", tee, period=whole),
        Form("tee into", "tee", "branch", tee, period=half),
        Form("wye turn", "wye", "run_start", wye, sizes=(lean,), starts=leans, period=whole),
        Form("wye sharp", "wye", "run_end", wye, sizes=(lean,), starts=leans, period=whole),
        Form("wye merge", "wye", "branch", wye, sizes=(lean,), starts=leans, period=whole),
        Form(
            "narrow",
            "reducer",
            "start",
            reducer,
            sizes=(narrow, length),
            starts=tuple((e * bore, 0.65 * bore) for e in (0.65, 0.8, 0.94)),
        ),
        Form(
            "wide",
            "reducer",
            "start",
            reducer,
            sizes=(wide, length),
            starts=tuple((e * bore, 0.65 * bore) for e in (1.06, 1.2, 1.4)),
        ),
        Form("open", "open end", ends=True),
        Form("closed", "closed end", ends=True, closed=True),
    )


def _reducer(bore: float, end_diameter: float, length: float) -> Reducer:
    """A reducer of any sizes, made longer where it would be too steep."""
    least = 1.001 * abs(end_diameter - bore) / 2 / math.tan(math.radians(20))
    return Reducer(max(length, least), end_diameter, bore)
