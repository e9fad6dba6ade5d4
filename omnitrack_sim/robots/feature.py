"""Learned controllers: the features that they observe, those that any robot has, and their actions.

D is the bore that the robot is made for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.base.rotations import Array, dot
from omnitrack_sim.base.text import shown
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.size import GRAVITY

XYZ, XY = ("x", "y", "z"), ("x", "y")
MAX_DISTANCE = 4.0
"""Distance from which on a fitting ahead counts as far, D: more than a robot rolls over on its
way."""
AHEAD = (0.25, 0.75, 1.5)
"""Distances ahead of the robot's centre of the preview of the centreline's direction, D: where the
default controller looks, the robot's nose, and a robot's length ahead."""

DECISION_PERIOD = 0.05
"""Time that a decision holds, s: 5 mm of travel at 0.1 m/s, a third of the time in which the
springs of a wall-pressing robot can turn it over in a tee."""
ROUNDING = 1e-6
"""Part of a control step by which a decision period may miss a whole number of them."""
FloatRows = NDArray[np.float32]
"""Entries or actions (n, k) of n robots."""


def held_actions(action: ArrayLike, like: Array) -> Array:
    """Return actions (n, k), cut off at -1 and 1, as they are held in single precision.

    Args:
        action: of n robots.
        like: of the same shape.

    Raises:
        ValueError: another shape, or a number that is none.
    """
    # A learner holds actions in single precision: in a run they have to be the same numbers.
    values = np.asarray(action, np.float32)
    if values.shape != like.shape:
        raise ValueError(f"action has shape {values.shape}, expected {like.shape}")
    if not np.isfinite(values).all():
        raise ValueError("action: is not a number, or infinite")
    return np.minimum(np.maximum(values, -1), 1).astype(float)


def steps_of_decision(period: float) -> int:
    """Return the number of control periods of ``period`` s in a decision period.

    Raises:
        InputError: it is not whole.
    """
    steps = round(DECISION_PERIOD / period)
    if steps < 1 or abs(DECISION_PERIOD / period - steps) > ROUNDING:
        problem = f"is {period:g} s, of which no whole number makes a decision period, "
        raise InputError(Fault("physics.control_period", f"{problem}{DECISION_PERIOD:g} s"))
    return steps


@dataclass(frozen=True)
class FeatureInput:
    """Everything that features may read of n robots at one moment.

    Attributes:
        setup: routes, robot and settings.
        observation: measurements of the robots.
        action: (n, k), the last decision.
    """

    setup: ControlSetup
    observation: Observation
    action: Array

    def in_robot(self, vectors: Array) -> Array:
        """Vectors (n, 3) of the world in the robot frame."""
        frame = self.observation.location.frame
        return np.stack([dot(vectors, frame[:, :, axis]) for axis in range(3)], axis=-1)

    def of_passage(self, name: str) -> Array:
        """Attribute ``name`` of the route map (n, ...) at the fitting being passed or next."""
        return getattr(self.setup.routes, name).take(self.observation.location.passage)


@dataclass(frozen=True)
class Feature:
    """One named quantity of a learned controller's observation: one entry, or several of a kind.

    An entry is the quantity, cut off at ``low`` and ``high``, over the larger of their sizes, so
    that it lies within -1 and 1. What is not a number becomes 0.

    Attributes:
        name: of the quantity.
        unit: of the values that ``read`` returns.
        low: least value, below which it is cut off.
        high: largest value, above which it is cut off.
        meaning: one line for the docs.
        read: (n,) or (n, k) of a ``FeatureInput`` of n robots, each from its own rows alone.
        labels: of the k entries, behind the name; one empty label where there is one entry.

    Example:
        >>> import omnitrack_sim as ot
        >>> slide = ot.Feature(
        ...     "slide_mm", "mm", -20, 20, "arm travel",
        ...     lambda moment: 1e3 * moment.observation.slide, ("1", "2", "3"),
        ... )
        >>> slide.entry_names
        ('slide_mm_1', 'slide_mm_2', 'slide_mm_3')
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str
    read: Callable[[FeatureInput], Array]
    labels: tuple[str, ...] = ("",)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"{self.name}: {self.low} to {self.high} is no range")
        if not self.labels:
            raise ValueError(f"{self.name}: labels is empty; one entry has the label ''")

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.labels)

    @property
    def scale(self) -> float:
        """Value of an entry of 1, in ``unit``."""
        return max(abs(self.low), abs(self.high))

    @property
    def entry_names(self) -> tuple[str, ...]:
        """The name of each entry."""
        return tuple(f"{self.name}_{label}" if label else self.name for label in self.labels)

    def entries(self, source: FeatureInput) -> FloatRows:
        """The entries (n, size) of n robots.

        Raises:
            AttributeError: a channel is not observed.
            ValueError: ``read`` returns another shape.
        """
        values = np.asarray(self.read(source), float)
        values = values[:, None] if values.ndim == 1 else values
        if values.shape != (source.setup.n, self.size):
            expected = (source.setup.n, self.size)
            raise ValueError(f"feature {self.name!r} reads {values.shape}, not {expected}")
        # What is infinite lies beyond the range and ends at its border; only NaN is unknown.
        values = np.nan_to_num(values, nan=0.0, posinf=self.high, neginf=self.low)
        scaled = np.minimum(np.maximum(values, self.low), self.high) / self.scale
        # Learners compute in single precision: runs hand out the same numbers.
        return scaled.astype(np.float32)


def bounds(features: Sequence[Feature]) -> tuple[FloatRows, FloatRows]:
    """Least and largest value (k,) of all entries of features, in their order."""
    sizes = [feature.size for feature in features]
    low = np.repeat([feature.low / feature.scale for feature in features], sizes)
    high = np.repeat([feature.high / feature.scale for feature in features], sizes)
    return low.astype(np.float32), high.astype(np.float32)


def entries_of(features: Sequence[Feature], source: FeatureInput) -> FloatRows:
    """Return the entries (n, k) of features, in their order.

    Raises:
        InputError: a feature needs what these robots do not observe.
    """
    entries = []
    for feature in features:
        try:
            entries.append(feature.entries(source))
        except AttributeError as error:
            problem = f"{feature.name!r} is not there for these robots: {error}"
            raise InputError(Fault("features", problem)) from error
    return np.concatenate(entries, axis=1)


def entry_slices(features: Sequence[Feature]) -> dict[str, slice]:
    """Positions of each feature's entries among the entries of all, by its name."""
    ends = np.cumsum([feature.size for feature in features]).tolist()
    return {
        feature.name: slice(end - feature.size, end)
        for feature, end in zip(features, ends, strict=True)
    }


def select_features(
    names: str | Sequence[str], where: str, shipped: Mapping[str, Feature | Sequence[Feature]]
) -> tuple[Feature, ...]:
    """Return features by names: of sets, of single ones, and of a user's own, ``module:Object``.

    The last are a ``Feature`` or a list of them.

    Args:
        names: one, or several that follow each other.
        where: key that holds the names, for faults.
        shipped: sets and single features by name.

    Raises:
        TypeError: one is no name.
        InputError: there is no such feature, there is none at all, or one comes twice.
    """
    features: list[Feature] = []
    for name in [names] if isinstance(names, str | Feature) else names:
        if not isinstance(name, str):
            value = (
                f"the feature {name.name!r} itself" if isinstance(name, Feature) else shown(name)
            )
            raise TypeError(
                f"{where}: has {value}; a name belongs here, such as named_features gives"
            )
        value = named(name, where, shipped)
        several = (value,) if isinstance(value, Feature) else value
        if not (isinstance(several, list | tuple) and all(isinstance(f, Feature) for f in several)):
            problem = f"is {name!r}, which is neither a Feature nor a list of them"
            raise InputError(Fault(where, problem, (*shipped, "module:Object")))
        features += several
    if not features:
        raise InputError(Fault(where, "is empty"))
    taken = [feature.name for feature in features]
    twice = sorted({name for name in taken if taken.count(name) > 1})
    if twice:
        raise InputError(Fault(where, f"has {', '.join(twice)} more than once"))
    return tuple(features)


def _distance_to(mark: str) -> Callable[[FeatureInput], Array]:
    """Return the distance (n,), D, to the ``start`` or ``end`` of the fitting being passed or next.

    It is counted from the robot's centre.
    """
    return lambda m: (
        (m.of_passage(mark) - m.observation.location.distance) / m.setup.robot.nominal_bore
    )


def _kind_of_fitting(m: FeatureInput) -> Array:
    routes, passage = m.setup.routes, m.observation.location.passage
    kinds = (
        routes.is_turn & ~routes.is_tee_turn,
        routes.into_branch,
        routes.out_of_branch,
        routes.is_straight_over,
    )
    return np.stack([kind.take(passage) for kind in kinds], axis=-1).astype(float)


def _tangents_ahead(m: FeatureInput) -> Array:
    location, setup = m.observation.location, m.setup
    ahead = location.distance[:, None] + np.array(AHEAD) * setup.robot.nominal_bore
    tangents = setup.routes.tangents(ahead, location.route)  # (n, len(AHEAD), 3)
    return np.concatenate([m.in_robot(tangents[:, i]) for i in range(len(AHEAD))], axis=-1)


ANGULAR_VELOCITY = Feature(
    "angular_velocity",
    "rad/s",
    -3,
    3,
    "rotation rate of the chassis, robot frame",
    lambda m: m.observation.angular_velocity,
    XYZ,
)
WEIGHT = Feature(
    "weight",
    "g",
    -1.5,
    1.5,
    "acceleration of gravity in the robot frame",
    lambda m: m.in_robot(m.setup.gravity) / GRAVITY,
    XYZ,
)
TILT = Feature(
    "tilt",
    "rad",
    0,
    1,
    "robot axis against the centreline",
    lambda m: m.observation.location.tilt,
)
TANGENT = Feature(
    "tangent",
    "1",
    -1,
    1,
    "centreline's direction at the robot's centre, robot frame",
    lambda m: m.in_robot(m.observation.location.tangent),
    XYZ,
)
ASIDE = Feature(
    "aside",
    "D",
    -0.25,
    0.25,
    "robot's centre from the centreline, robot frame",
    lambda m: m.in_robot(m.observation.location.aside)[:, :2] / m.setup.robot.nominal_bore,
    XY,
)
TO_FITTING = Feature(
    "to_fitting",
    "D",
    -MAX_DISTANCE,
    MAX_DISTANCE,
    "way from the robot's centre to where the bend or opening that it is in or comes to begins",
    _distance_to("start"),
)
TO_EXIT = Feature(
    "to_exit",
    "D",
    -MAX_DISTANCE,
    MAX_DISTANCE,
    "way to where that fitting ends",
    _distance_to("end"),
)
KIND = Feature(
    "kind",
    "1",
    0,
    1,
    "1 where that fitting is such, all 0 after the last one: an elbow, a "
    "turn into a branch or out of one, straight over an opening",
    _kind_of_fitting,
    ("elbow", "into_branch", "out_of_branch", "straight_over"),
)
TURN = Feature(
    "turn",
    "deg",
    0,
    180,
    "by which the way turns there",
    lambda m: np.degrees(m.of_passage("turn")) * m.of_passage("is_turn"),
)
BEND = Feature(
    "bend",
    "1/D",
    0,
    2.5,
    "curvature of the centreline there",
    lambda m: m.setup.robot.nominal_bore / m.of_passage("bend_radius"),
)
BORE = Feature(
    "bore",
    "1",
    -0.25,
    0.25,
    "radius of the bore there over the nominal one, less 1",
    lambda m: m.of_passage("radius") / (m.setup.robot.nominal_bore / 2) - 1,
)
TURNING = Feature(
    "turning",
    "1",
    -1,
    1,
    "turning direction there, robot frame",
    lambda m: m.in_robot(m.observation.location.turning),
    XYZ,
)
WAY_AHEAD = Feature(
    "way_ahead",
    "1",
    -1,
    1,
    f"centreline's direction {', '.join(map(str, AHEAD))} D ahead of "
    "the robot's centre, robot frame",
    _tangents_ahead,
    tuple(f"{axis}{i + 1}" for i in range(len(AHEAD)) for axis in XYZ),
)

PLACE = (TILT, TANGENT, ASIDE, WEIGHT, ANGULAR_VELOCITY)
"""How any robot lies in its pipe."""
ROUTE = (TO_FITTING, TO_EXIT, KIND, TURN, BEND, BORE, TURNING, WAY_AHEAD)
"""Route ahead of any robot, from the route map."""
