"""Features: the named quantities that a learned controller observes, and the shipped sets of them.

A policy observes a vector of entries within -1 and 1 and decides an action: four numbers within
-1 and 1, the forward speed of each module at the wall over the speed limit, and the rate at which
all modules roll together over the rotary motor's largest speed. D is the bore that the robot is
made for.

The sets ``ONBOARD`` and ``PREVIEW`` read what every robot observes, by its own sensors or by the
truth; ``TRUTH`` adds what only the truth gives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omnitrack_sim.base.naming import ByName
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.feature import (
    ANGULAR_VELOCITY,
    ASIDE,
    ROUTE,
    TANGENT,
    TILT,
    WEIGHT,
    Feature,
    FeatureInput,
    select_features,
)
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.size import GRAVITY

ACTIONS = ("wall_speed_1", "wall_speed_2", "wall_speed_3", "roll_rate")
"""Names of the entries of an action."""
_PER_MODULE = ("1", "2", "3")


@dataclass(frozen=True)
class ModuleInput(FeatureInput):
    """Everything that features of this robot may read.

    Attributes:
        roll: (n, 3) rad, set point of the rotary motors.
    """

    roll: Array

    @cached_property
    def forward(self) -> Array:
        """Direction (n, 3) in which a positive belt speed drives each module."""
        return belt_sign(self.observation.roll)


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


def _over_weight(channel: str) -> Callable[[FeatureInput], Array]:
    return lambda m: getattr(m.observation, channel) / (m.setup.own("mass") * GRAVITY)[:, None]


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
        lambda m: m.observation.motor_torque * m.forward / m.setup.own("motor.max_torque")[:, None],
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
    ANGULAR_VELOCITY,
    WEIGHT,
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
    TILT,
    TANGENT,
    ASIDE,
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
    *ROUTE,
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
SHIPPED: Mapping[str, Feature | Sequence[Feature]] = {**FEATURE_SETS, **FEATURES}
"""Sets and single features by name."""


def features_of(names: str | Sequence[str], where: str = "features") -> tuple[Feature, ...]:
    """Return features of this robot by names, as ``select_features`` does."""
    return select_features(names, where, SHIPPED)
