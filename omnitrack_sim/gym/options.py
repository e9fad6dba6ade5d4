"""Options of ``gymnasium.make``, checked as scenarios are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import checked
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import shown
from omnitrack_sim.gym.reward import TERMS
from omnitrack_sim.robots.omnitrack.policy.features import (
    FEATURE_SETS,
    FEATURES,
    Feature,
    features_of,
)
from omnitrack_sim.robots.omnitrack.policy.file import ACTINGS

RANGES: Mapping[str, tuple[float, float]] = {
    "world.friction": (0.6, 1.0),
    "robot.preload": (20.0, 30.0),
    "start.theta5_deg": (-180.0, 180.0),
    "control.cruise_speed": (0.08, 0.12),
}
"""Values that each episode draws evenly, with their ranges, by dotted path."""
_DRAWN = (
    *RANGES,
    "start.distance",
    "start.roll_deg",
    "robot.motor.torque_limit",
    "robot.roll_torque",
)
"""Values that an episode may draw: those that robots of one batch need not share."""
Range = tuple[float, float]
_SEVERAL = {
    "ranges": (2, "a range (least, largest), one number, or None for the scenario's own"),
    "observation": (1, "a name, or a list of names"),
}
"""Values of several types: at which level they stand, and what they may be."""


class EnvOptions(Table):
    """Options of an environment."""

    scenario: str = "tee_turn"
    """A shipped scenario, a scenario file, or "random_network": a random mission through a random
    network in each episode."""
    changes: dict[str, Any] = Field(default_factory=dict)
    """Values of the scenario by dotted path, as of `ot.override`."""
    observation: str | tuple[str, ...] = "onboard"
    """A set of features (`onboard`, `preview`, `truth`), or a list of sets, of single features and
    of your own, `module:Object`."""
    sensing: Literal["onboard", "truth"] | None = None
    """Source of the entries: the robot's own sensors or the truth. Left out: `truth`
    for the observation `truth`, otherwise `onboard`."""
    picture: bool = False
    """The observation has the depth picture, too."""
    acting: str = "direct"
    """`direct`: actions are the command; `residual`: they are added to that of the feedback
    controller."""
    ranges: dict[str, Range | float | None] = Field(default_factory=dict)
    """Draws of each trial, by dotted path: least and largest value, a number for one value, or
    None for that of the scenario."""
    gravity: Literal["any", "scenario"] = "any"
    """`any`: 9.81 m/s² in a random direction in each trial; `scenario`: as the scenario says."""
    fittings: Annotated[tuple[int, int], Field()] = (6, 12)
    """Of a random network: the least and largest number of its fittings."""
    reward: dict[str, float] = Field(default_factory=dict)
    """Weights of terms of the reward; those left out stay as they are."""
    threads: Annotated[int, Field(ge=0, le=1024)] = 1
    """Native threads for the physics; 0 uses all cores. The results do not depend on it."""
    render_mode: Literal["rgb_array", "human"] | None = None
    """`rgb_array`: `render` returns a picture; `human`: a window shows the robot."""
    camera: Literal["side", "follow", "onboard"] = "side"
    """Of the pictures."""
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    """Of the pictures, pixels."""
    height: Annotated[int, Field(ge=16, le=4096)] = 360
    """Of the pictures, pixels."""

    @property
    def features(self) -> tuple[Feature, ...]:
        """Observed features, in the order of the entries."""
        return features_of(self.observation, "observation")

    @property
    def senses(self) -> str:
        """The scenario's ``sensing.kind``."""
        # Features of the truth need it; any other set can be had from the robot's own sensors.
        truth = self.sensing or ("truth" if self.observation == "truth" else "onboard")
        return str(truth)

    @property
    def drawn(self) -> dict[str, Range]:
        """Least and largest value of what each trial draws, by dotted path."""
        ranges = {**RANGES, **self.ranges}
        return {
            path: value if isinstance(value, tuple) else (value, value)
            for path, value in ranges.items()
            if value is not None
        }

    @property
    def weights(self) -> dict[str, float]:
        """Of all terms of the reward."""
        return {term.name: self.reward.get(term.name, term.weight) for term in TERMS.values()}


def options_of(given: Mapping[str, Any]) -> EnvOptions:
    """Options from the keyword arguments of an environment.

    Raises:
        InputError: lists every fault with its place and the choices.
    """

    def fault(item: Mapping[str, Any]) -> Fault | None:
        level, right = _SEVERAL.get(item["loc"][0], (0, ""))
        if not 0 < level < len(item["loc"]):
            return None
        place, value = item["loc"][:level], given
        for key in place:
            value = value[key]
        return Fault(".".join(place), f"is {shown(value)}; it must be {right}")

    options = checked(EnvOptions, given, InputError, own_fault=fault)
    faults = [*_unknown("ranges", options.ranges, _DRAWN)]
    faults += _unknown("reward", options.reward, tuple(TERMS))
    for path, value in options.ranges.items():
        if isinstance(value, tuple) and value[0] > value[1]:
            problem = f"is from {value[0]:g} to {value[1]:g}; the least value stands first"
            faults.append(Fault(f"ranges.{path}", problem))
    if options.acting not in ACTINGS:
        faults.append(
            Fault("acting", f"is {options.acting!r}", tuple(ACTINGS), given=options.acting)
        )
    # Robots that observe the truth have no camera.
    if options.picture and options.senses != "onboard":
        faults.append(Fault("picture", 'is there with sensing = "onboard" alone'))
    low, high = options.fittings
    if not 1 <= low <= high:
        faults.append(Fault("fittings", f"is from {low} to {high}; from 1, the least number first"))
    faults += _unseen(options)
    if faults:
        raise InputError(faults)
    return options


def _unseen(options: EnvOptions) -> Sequence[Fault]:
    """Features that there are not, or not for these robots."""
    try:
        names = {feature.name for feature in options.features}
    except InputError as error:
        return error.faults
    observable = {feature.name for feature in FEATURE_SETS["preview"]}
    only_true = [name for name in FEATURES if name in names and name not in observable]
    if options.senses == "truth" or not only_true:
        return []
    problem = f'asks for {", ".join(only_true)}, which are there with sensing = "truth" alone'
    return [Fault("observation", problem)]


def _unknown(where: str, given: Mapping[str, Any], known: tuple[str, ...]) -> list[Fault]:
    return [
        Fault(f"{where}.{key}", "unknown key", known, given=key)
        for key in given
        if key not in known
    ]
