"""What a policy file says of itself, beside its arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.table import Table
from omnitrack_sim.robots.omnitrack.policy.actions import ACTIONS, DECISION_PERIOD, Acting
from omnitrack_sim.robots.omnitrack.policy.feature import Feature
from omnitrack_sim.robots.omnitrack.policy.features import features_of

Word = Annotated[str, Field(max_length=200)]


class FeatureEntry(Table):
    """One feature, as it was when the policy was trained."""

    name: Word
    size: Annotated[int, Field(ge=1)]
    unit: Word
    low: float
    high: float

    @classmethod
    def of(cls, name: str, feature: Feature) -> Self:
        """What a feature is now. ``name``: under which it is found."""
        low, high = float(feature.low), float(feature.high)
        return cls(name=name, size=feature.size, unit=feature.unit, low=low, high=high)

    def feature(self) -> Feature:
        """The feature of that name.

        Raises:
            ValueError: there is none, or it is another one by now.
        """
        try:
            found = features_of([self.name])
        except InputError as error:
            raise ValueError(str(error)) from None
        if len(found) != 1:
            raise ValueError(f"features: {self.name!r} is a set of them, not one")
        now = FeatureEntry.of(self.name, found[0])
        if now != self:
            raise ValueError(f"features: was made for {self._told()}, which is now {now._told()}")
        return found[0]

    def _told(self) -> str:
        numbers = "1 number" if self.size == 1 else f"{self.size} numbers"
        return f"{self.name!r} of {numbers} from {self.low:g} to {self.high:g} {self.unit}"


class ActingEntry(Table):
    """How the policy's decisions become commands, see ``Acting``."""

    name: Word
    base: Literal["jacobian", "paper", "equal"] | None = None
    speed: Annotated[float, Field(gt=0, le=1)]
    roll_reach: Annotated[float, Field(ge=0, le=math.pi)] | None = None

    @classmethod
    def of(cls, acting: Acting) -> Self:
        """A way to act, as a file says it."""
        reach = acting.roll_reach if math.isfinite(acting.roll_reach) else None
        return cls.model_validate(vars(acting) | {"roll_reach": reach})

    def acting(self) -> Acting:
        """The way to act."""
        reach = math.inf if self.roll_reach is None else self.roll_reach
        return Acting(self.name, self.base, self.speed, reach)


class TrainingRecord(Table):
    """How a policy came about."""

    command: Annotated[str, Field(max_length=2000)] = ""
    """That trained it."""
    seed: int | None = None
    """Of the training."""
    steps: Annotated[int, Field(ge=0)] | None = None
    """Decisions that it was trained for."""
    date: Word = ""
    """Of the training, as ISO 8601 has it."""
    package_version: Word = ""
    """Of omnitrack_sim."""
    note: Annotated[str, Field(max_length=2000)] = ""
    """What else there is to say, such as what it was trained on."""


class Header(Table):
    """The JSON entry of a policy file."""

    format: Literal[1]
    architecture: Literal["mlp"]
    activation: Word
    output: Word
    reach: float
    features: Annotated[tuple[FeatureEntry, ...], Field(min_length=1, max_length=200)]
    actions: tuple[Word, ...]
    decision_period_s: float
    acting: ActingEntry
    record: TrainingRecord = TrainingRecord()

    @model_validator(mode="after")
    def _is_for_these_actions(self) -> Self:
        _same("actions", self.actions, ACTIONS)
        _same("decision_period_s", self.decision_period_s, DECISION_PERIOD)
        return self


def _same(key: str, given: str | float | Sequence[str], now: str | float | Sequence[str]) -> None:
    if given != now:
        raise ValueError(f"{key}: was made for {given}, and here it is {now}")
