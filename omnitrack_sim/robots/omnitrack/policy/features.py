"""Features: the named quantities that a learned controller observes, and the shipped sets of them.

A policy observes a vector of entries within -1 and 1 and decides an action: four numbers within
-1 and 1, the forward speed of each module at the wall over the speed limit, and the rate at which
all modules roll together over the rotary motor's largest speed. D is the bore that the robot is
made for.

The sets ``ONBOARD`` and ``PREVIEW`` read what every robot observes, by its own sensors or by the
truth; ``TRUTH`` adds what only the truth gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ByName, named
from omnitrack_sim.base.rotations import Array, dot
from omnitrack_sim.base.text import shown
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign

ACTIONS = ("wall_speed_1", "wall_speed_2", "wall_speed_3", "roll_rate")
"""Names of the entries of an action."""
_PER_MODULE, _XYZ, _XY = ("1", "2", "3"), ("x", "y", "z"), ("x", "y")
FARTHEST = 4.0
"""Distance from which on a fitting ahead counts as far, D: more than a robot rolls over on its
way."""
AHEAD = (0.25, 0.75, 1.5)
"""Distances ahead of the robot's centre of the preview of the centreline's direction, D: where the
default controller looks, the robot's nose, and a robot's length ahead."""

FloatRows = NDArray[np.float32]
"""Entries or actions (n, k) of n robots."""


@dataclass(frozen=True)
class FeatureInput:
    """Everything that features may read of n robots at one moment.

    Attributes:
        setup: routes, robot and settings.
        observation: measurements of the robots.
        action: (n, 4), the last decision.
        roll: (n, 3) rad, set point of the rotary motors.
    """

    setup: ControlSetup
    observation: Observation
    action: Array
    roll: Array

    @cached_property
    def forward(self) -> Array:
        """Direction (n, 3) in which a positive belt speed drives each module."""
        return belt_sign(self.observation.roll)

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


def entry_slices(features: Sequence[Feature]) -> dict[str, slice]:
    """Positions of each feature's entries among the entries of all, by its name."""
    ends = np.cumsum([feature.size for feature in features]).tolist()
    return {
        feature.name: slice(end - feature.size, end)
        for feature, end in zip(features, ends, strict=True)
    }


def _mean_double_roll(m: FeatureInput) -> Array:
    # Twice the roll: both tracks drive alike, so a module rolled by 180 degrees is the same one.
    roll = m.observation.roll
    return np.stack([np.cos(2 * roll).mean(axis=-1), np.sin(2 * roll).mean(axis=-1)], axis=-1)


def _cosine_and_sine_of_theta5(m: FeatureInput) -> Array:
    theta5 = m.observation.location.theta5
    return np.stack([np.cos(theta5), np.sin(theta5)], axis=-1)


def _theta5_std(m: FeatureInput) -> Array:
    std = m.observation.location.theta5_std
    return np.zeros(m.setup.n) if std is None else std


def _distance_to(mark: str) -> Callable[[FeatureInput], Array]:
    """Distance (n,), D, from the robot's centre to the ``start`` or ``end`` of the fitting being
    passed or next."""
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


def _over_weight(channel: str) -> Callable[[FeatureInput], Array]:
    return lambda m: getattr(m.observation, channel) / (m.setup.robot.mass * GRAVITY)


def _over_speed_limit(channel: str) -> Callable[[FeatureInput], Array]:
    return lambda m: getattr(m.observation, channel) / m.setup.settings.speed_limit[:, None]


ONBOARD = (
    Feature(
        "wall_speed",
        "speed limits",
        -1.5,
        1.5,
        "forward speed of each module that its belt asks for at the wall",
        _over_speed_limit("wall_speed"),
        _PER_MODULE,
    ),
    Feature(
        "wall_torque",
        "torque limits",
        -1,
        1,
        "torque of each belt's motor that drives the module forward",
        lambda m: m.observation.motor_torque * m.forward / m.setup.robot.motor.torque_limit,
        _PER_MODULE,
    ),
    Feature(
        "slide",
        "D",
        -0.15,
        0.15,
        "arm travel from the nominal pipe, outward positive",
        lambda m: m.observation.slide / m.setup.robot.nominal_bore,
        _PER_MODULE,
    ),
    Feature(
        "roll",
        "1",
        -1,
        1,
        "cosine and sine of twice the roll, mean of the modules; -1, 0 on the no-motion line",
        _mean_double_roll,
        ("cos", "sin"),
    ),
    Feature(
        "roll_lag",
        "rad",
        -0.5,
        0.5,
        "roll asked of the rotary motors less roll, mean of the modules",
        lambda m: (m.roll - m.observation.roll).mean(axis=-1),
    ),
    Feature(
        "angular_velocity",
        "rad/s",
        -3,
        3,
        "rotation rate of the chassis, robot frame",
        lambda m: m.observation.angular_velocity,
        _XYZ,
    ),
    Feature(
        "weight",
        "g",
        -1.5,
        1.5,
        "acceleration of gravity in the robot frame",
        lambda m: m.in_robot(m.setup.gravity) / GRAVITY,
        _XYZ,
    ),
    Feature(
        "theta5",
        "1",
        -1,
        1,
        "cosine and sine of theta5: module 1 from the turning direction of "
        "the fitting being passed or next",
        _cosine_and_sine_of_theta5,
        ("cos", "sin"),
    ),
    Feature(
        "theta5_std",
        "rad",
        0,
        np.pi,
        "standard deviation of theta5; 0 where it is known",
        _theta5_std,
    ),
    Feature(
        "tilt",
        "rad",
        0,
        1,
        "robot axis against the centreline",
        lambda m: m.observation.location.tilt,
    ),
    Feature(
        "tangent",
        "1",
        -1,
        1,
        "centreline's direction at the robot's centre, robot frame",
        lambda m: m.in_robot(m.observation.location.tangent),
        _XYZ,
    ),
    Feature(
        "aside",
        "D",
        -0.25,
        0.25,
        "robot's centre from the centreline, robot frame",
        lambda m: m.in_robot(m.observation.location.aside)[:, :2] / m.setup.robot.nominal_bore,
        _XY,
    ),
    Feature("last_action", "1", -1, 1, "what was decided last", lambda m: m.action, ACTIONS),
    Feature(
        "cruise_speed",
        "speed limits",
        0,
        1,
        "speed that is asked for",
        lambda m: m.setup.settings.cruise_speed / m.setup.settings.speed_limit,
    ),
)
"""Proprioception and the estimated location."""
PREVIEW = (
    *ONBOARD,
    Feature(
        "to_fitting",
        "D",
        -FARTHEST,
        FARTHEST,
        "way from the robot's centre to where the bend or opening that it is in or comes to begins",
        _distance_to("start"),
    ),
    Feature(
        "to_exit", "D", -FARTHEST, FARTHEST, "way to where that fitting ends", _distance_to("end")
    ),
    Feature(
        "kind",
        "1",
        0,
        1,
        "1 where that fitting is such, all 0 after the last one: an elbow, a "
        "turn into a branch or out of one, straight over an opening",
        _kind_of_fitting,
        ("elbow", "into_branch", "out_of_branch", "straight_over"),
    ),
    Feature(
        "turn",
        "deg",
        0,
        180,
        "by which the way turns there",
        lambda m: np.degrees(m.of_passage("turn")) * m.of_passage("is_turn"),
    ),
    Feature(
        "bend",
        "1/D",
        0,
        2.5,
        "curvature of the centreline there",
        lambda m: m.setup.robot.nominal_bore / m.of_passage("bend_radius"),
    ),
    Feature(
        "bore",
        "1",
        -0.25,
        0.25,
        "radius of the bore there over the nominal one, less 1",
        lambda m: m.of_passage("radius") / m.setup.robot.nominal_pipe_radius - 1,
    ),
    Feature(
        "turning",
        "1",
        -1,
        1,
        "turning direction there, robot frame",
        lambda m: m.in_robot(m.observation.location.turning),
        _XYZ,
    ),
    Feature(
        "way_ahead",
        "1",
        -1,
        1,
        f"centreline's direction {', '.join(map(str, AHEAD))} D ahead of "
        "the robot's centre, robot frame",
        _tangents_ahead,
        tuple(f"{axis}{i + 1}" for i in range(len(AHEAD)) for axis in _XYZ),
    ),
)
"""``ONBOARD`` and the route ahead, from the route map."""
TRUTH = (
    *PREVIEW,
    Feature(
        "normal_force",
        "weights",
        0,
        6,
        "sum of the normal forces between wall and lugs",
        _over_weight("normal_force"),
        _PER_MODULE,
    ),
    Feature(
        "traction",
        "weights",
        -3,
        3,
        "wall force on each module along its axis, forward positive",
        _over_weight("traction"),
        _PER_MODULE,
    ),
    Feature(
        "slip_velocity",
        "speed limits",
        -2,
        2,
        "belt surface relative to the wall at the contact",
        _over_speed_limit("slip_velocity"),
        _PER_MODULE,
    ),
    Feature(
        "module_speed",
        "speed limits",
        -1.5,
        1.5,
        "speed of each module over the wall",
        _over_speed_limit("module_speed"),
        _PER_MODULE,
    ),
    Feature(
        "touching",
        "1",
        0,
        1,
        "1 where a track touches the wall",
        lambda m: (m.observation.contact_count > 0).reshape(-1, 6).astype(float),
        tuple(f"{module}_{track}" for module in _PER_MODULE for track in ("upper", "lower")),
    ),
    Feature(
        "pitch",
        "rad",
        -0.1,
        0.1,
        "arm pitch; positive: the module's nose points outward",
        lambda m: m.observation.pitch,
        _PER_MODULE,
    ),
)
"""``PREVIEW`` and what only the truth gives: contacts, forces, slip."""

FEATURE_SETS: Mapping[str, tuple[Feature, ...]] = ByName(
    {"onboard": ONBOARD, "preview": PREVIEW, "truth": TRUTH}
)
"""Sets of features by name."""
FEATURES: Mapping[str, Feature] = ByName({feature.name: feature for feature in TRUTH})
"""Every shipped feature by name."""


def features_of(names: str | Sequence[str], where: str = "features") -> tuple[Feature, ...]:
    """Return features by the names of sets, of single ones, and of a user's own, ``module:Object``:
    a ``Feature`` or a list of them.

    Args:
        names: one, or several that follow each other.
        where: key that holds the names, for faults.

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
        value = named(name, where, {**FEATURE_SETS, **FEATURES})
        several = (value,) if isinstance(value, Feature) else value
        if not (isinstance(several, list | tuple) and all(isinstance(f, Feature) for f in several)):
            problem = f"is {name!r}, which is neither a Feature nor a list of them"
            raise InputError(Fault(where, problem, (*FEATURE_SETS, *FEATURES, "module:Object")))
        features += several
    if not features:
        raise InputError(Fault(where, "is empty"))
    taken = [feature.name for feature in features]
    twice = sorted({name for name in taken if taken.count(name) > 1})
    if twice:
        raise InputError(Fault(where, f"has {', '.join(twice)} more than once"))
    return tuple(features)
