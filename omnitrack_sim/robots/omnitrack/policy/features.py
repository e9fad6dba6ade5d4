"""The shipped features and sets of them. D is the bore that the robot is made for.

``ONBOARD`` and ``PREVIEW`` are read from what every robot is told, by its own sensors or truly;
``TRUTH`` also from what only the truth tells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ByName, named
from omnitrack_sim.base.text import shown
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.policy import readings
from omnitrack_sim.robots.omnitrack.policy.actions import ACTIONS
from omnitrack_sim.robots.omnitrack.policy.feature import Feature

MODULES, XYZ, XY = ("1", "2", "3"), ("x", "y", "z"), ("x", "y")
FARTHEST = 4.0
"""Distance from which on a fitting ahead counts as far, D: more than a robot rolls over on its
way."""


ONBOARD = (
    Feature(
        "wall_speed",
        "speed limits",
        -1.5,
        1.5,
        "forward speed of each module that its belt asks for at the wall",
        readings.wall_speed,
        MODULES,
    ),
    Feature(
        "wall_torque",
        "torque limits",
        -1,
        1,
        "torque of each belt's motor that drives the module forward",
        readings.wall_torque,
        MODULES,
    ),
    Feature(
        "slide",
        "D",
        -0.15,
        0.15,
        "arm travel from the nominal pipe, outward positive",
        lambda v: v.observation.slide / v.setup.robot.nominal_bore,
        MODULES,
    ),
    Feature(
        "roll",
        "1",
        -1,
        1,
        "cosine and sine of twice the roll, mean of the modules; -1, 0 on the no-motion line",
        readings.half_turns,
        ("cos", "sin"),
    ),
    Feature(
        "roll_lag",
        "rad",
        -0.5,
        0.5,
        "roll asked of the rotary motors less roll, mean of the modules",
        lambda v: (v.roll - v.observation.roll).mean(axis=-1),
    ),
    Feature(
        "angular_velocity",
        "rad/s",
        -3,
        3,
        "rotation rate of the chassis, robot frame",
        lambda v: v.observation.angular_velocity,
        XYZ,
    ),
    Feature(
        "weight",
        "g",
        -1.5,
        1.5,
        "acceleration of gravity in the robot frame",
        lambda v: v.in_robot(v.setup.gravity) / GRAVITY,
        XYZ,
    ),
    Feature(
        "theta5",
        "1",
        -1,
        1,
        "cosine and sine of theta5: module 1 from the turning direction of "
        "the fitting being passed or next",
        lambda v: readings.circle(v.observation.place.theta5),
        ("cos", "sin"),
    ),
    Feature(
        "theta5_std",
        "rad",
        0,
        np.pi,
        "standard deviation of theta5; 0 where it is known",
        readings.doubt,
    ),
    Feature(
        "tilt", "rad", 0, 1, "robot axis against the centreline", lambda v: v.observation.place.tilt
    ),
    Feature(
        "tangent",
        "1",
        -1,
        1,
        "centreline's direction at the robot's centre, robot frame",
        lambda v: v.in_robot(v.observation.place.tangent),
        XYZ,
    ),
    Feature(
        "aside",
        "D",
        -0.25,
        0.25,
        "robot's centre from the centreline, robot frame",
        readings.aside,
        XY,
    ),
    Feature("last_action", "1", -1, 1, "what was decided last", lambda v: v.action, ACTIONS),
    Feature("cruise_speed", "speed limits", 0, 1, "speed that is asked for", readings.cruise_speed),
)
"""What a robot feels, and where it takes itself to be."""
PREVIEW = (
    *ONBOARD,
    Feature(
        "to_fitting",
        "D",
        -FARTHEST,
        FARTHEST,
        "way from the robot's centre to where the bend or opening that it is in or comes to begins",
        readings.to("start"),
    ),
    Feature(
        "to_exit", "D", -FARTHEST, FARTHEST, "way to where that fitting ends", readings.to("end")
    ),
    Feature(
        "kind",
        "1",
        0,
        1,
        "1 where that fitting is such, all 0 after the last one: an elbow, a "
        "turn into a branch or out of one, straight over an opening",
        readings.kind,
        ("elbow", "into_branch", "out_of_branch", "straight_over"),
    ),
    Feature("turn", "deg", 0, 180, "by which the way turns there", readings.turn),
    Feature("bend", "1/D", 0, 2.5, "curvature of the centreline there", readings.bend),
    Feature(
        "bore",
        "1",
        -0.25,
        0.25,
        "radius of the bore there over the nominal one, less 1",
        readings.bore,
    ),
    Feature(
        "turning",
        "1",
        -1,
        1,
        "turning direction there, robot frame",
        lambda v: v.in_robot(v.observation.place.turning),
        XYZ,
    ),
    Feature(
        "way_ahead",
        "1",
        -1,
        1,
        f"centreline's direction {', '.join(map(str, readings.AHEAD))} D ahead of "
        "the robot's centre, robot frame",
        readings.way_ahead,
        tuple(f"{axis}{i + 1}" for i in range(len(readings.AHEAD)) for axis in XYZ),
    ),
)
"""The same, and what the route map says of the way ahead."""
TRUTH = (
    *PREVIEW,
    Feature(
        "normal_force",
        "weights",
        0,
        6,
        "sum of the normal forces between wall and lugs",
        readings.over_weight("normal_force"),
        MODULES,
    ),
    Feature(
        "traction",
        "weights",
        -3,
        3,
        "wall force on each module along its axis, forward positive",
        readings.over_weight("traction"),
        MODULES,
    ),
    Feature(
        "slip_velocity",
        "speed limits",
        -2,
        2,
        "belt surface relative to the wall at the contact",
        readings.over_limit("slip_velocity"),
        MODULES,
    ),
    Feature(
        "module_speed",
        "speed limits",
        -1.5,
        1.5,
        "speed of each module over the wall",
        readings.over_limit("module_speed"),
        MODULES,
    ),
    Feature(
        "touching",
        "1",
        0,
        1,
        "1 where a track touches the wall",
        readings.touching,
        tuple(f"{module}_{track}" for module in MODULES for track in ("upper", "lower")),
    ),
    Feature(
        "pitch",
        "rad",
        -0.1,
        0.1,
        "arm pitch; positive: the module's nose points outward",
        lambda v: v.observation.pitch,
        MODULES,
    ),
)
"""The same, and what only the truth tells: contacts, forces, slip."""

FEATURE_SETS: Mapping[str, tuple[Feature, ...]] = ByName(
    {"onboard": ONBOARD, "preview": PREVIEW, "truth": TRUTH}
)
"""Sets of features by name."""
FEATURES: Mapping[str, Feature] = ByName({feature.name: feature for feature in TRUTH})
"""Every shipped feature by name."""


def features_of(names: str | Sequence[str], where: str = "features") -> tuple[Feature, ...]:
    """Features by the names of sets, of single ones, and of a user's own, ``module:Object``: a
    ``Feature`` or a list of them.

    Args:
        names: one, or several that follow each other. where: they stand, for the fault.

    Raises:
        TypeError: one is no name.
        InputError: there is no such feature, there is none at all, or one comes twice.
    """
    found: list[Feature] = []
    for name in [names] if isinstance(names, str | Feature) else names:
        if not isinstance(name, str):
            told = f"the feature {name.name!r} itself" if isinstance(name, Feature) else shown(name)
            raise TypeError(
                f"{where}: has {told}; a name belongs here, such as named_features gives"
            )
        thing = named(name, where, {**FEATURE_SETS, **FEATURES})
        several = (thing,) if isinstance(thing, Feature) else thing
        if not (isinstance(several, list | tuple) and all(isinstance(f, Feature) for f in several)):
            problem = f"is {name!r}, which is neither a Feature nor a list of them"
            raise InputError(Fault(where, problem, (*FEATURE_SETS, *FEATURES, "module:Object")))
        found += several
    taken = [feature.name for feature in found]
    twice = sorted({name for name in taken if taken.count(name) > 1})
    if twice or not found:
        problem = f"has {', '.join(twice)} more than once" if twice else "is empty"
        raise InputError(Fault(where, problem))
    return tuple(found)
