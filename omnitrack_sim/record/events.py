"""Outcome of a run with advice, and the events on the way to it as values with a time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Self


class Outcome(StrEnum):
    """The end of one trial. A failed traversal is a result, not an error.

    Example:
        >>> ot.Outcome("timed_out").advice
        'Time ran out while the robot still moved: raise run.time_limit.'
    """

    REACHED_GOAL = "reached_goal", "The robot reached the goal."
    MOTION_SINGULARITY = (
        "motion_singularity",
        "A part of the robot lost the wall in a tee and the turn stopped: start with another "
        "start.theta5_deg.",
    )
    STALLED = (
        "stalled",
        "A motor stood still at its limit: find in the summary plot where, and give it more.",
    )
    STUCK = (
        "stuck",
        "The robot made no headway: look at tilt, wall force and actuator force in the summary "
        "plot.",
    )
    WEDGED = (
        "wedged",
        "The robot ended across the pipe: find in the summary plot where it began to tilt, and "
        "try another start.theta5_deg, more world.friction, or another control.kind.",
    )
    SLIPPING = (
        "slipping",
        "The robot slid along the wall, or fell free of it: raise world.friction, or press "
        "harder; if it touches no wall, take a narrower bore.",
    )
    HELD_BY_TETHER = (
        "held_by_tether",
        "The tether held the robot: its length is used up, or it pulled by more than a quarter of "
        "the robot's weight: start from a nearer opening, or take a lighter or longer tether, or "
        "one with less friction.",
    )
    NO_MOTION_LINE = (
        "no_motion_line",
        "No part of the robot could drive as it was rolled: start with another start.roll_deg.",
    )
    LEFT_PIPE = (
        "left_pipe",
        "The robot's centre left the pipes, or it fell into another one too often: check "
        "start.distance, gravity against the friction, and that the controller heeds the gear.",
    )
    TIMED_OUT = "timed_out", "Time ran out while the robot still moved: raise run.time_limit."
    WRONG_MAP = (
        "wrong_map",
        "The robot is back from exploring, but its map is not that of the network: the reason "
        "lists the differences, map.png shows them; try another sensing.camera or less noise.",
    )
    LOST = (
        "lost",
        "The robot did not know where it was, or took itself to be at a goal where it was not: "
        "look at the estimates in the record, and try another sensing.camera or less noise.",
    )
    ENDED = "ended", "Whoever drove the robot ended the run."
    DIVERGED = (
        "diverged",
        "The physics diverged: lower physics.timestep or look for extreme parameters.",
    )

    advice: str
    """One sentence: what happened and what to try."""

    def __new__(cls, value: str, advice: str) -> Self:
        """Make a member from its value and its advice."""
        member = str.__new__(cls, value)
        member._value_, member.advice = value, advice
        return member


@dataclass(frozen=True)
class Event:
    """Something that one robot did or met.

    A new kind of event is a frozen dataclass that inherits from this one and has a ``sentence``; it
    is written to ``result.json`` with its fields, and read back by the name of its class.

    Attributes:
        robot: index of the robot in its batch; not written to files and not compared.
        time: s of simulated time.
        sentence: the event in words, a format string over the fields.

    Example:
        >>> from dataclasses import dataclass
        >>> @dataclass(frozen=True)
        ... class Knocked(ot.Event):
        ...     force: float
        ...     sentence = "knocked by {force:.0f} N"
        >>> print(Knocked(robot=0, time=1.5, force=20.0))
        1.50 s, knocked by 20 N
    """

    robot: int = field(compare=False)
    time: float
    sentence: ClassVar[str] = ""
    kinds: ClassVar[dict[str, type[Event]]] = {}

    def __init_subclass__(cls) -> None:
        # Registered as it is defined, so that a user's own kind is read back without an edit here.
        Event.kinds[cls.__name__] = cls

    @property
    def text(self) -> str:
        """The event in words, without its time."""
        return self.sentence.format(**vars(self)) or type(self).__name__

    def __str__(self) -> str:
        return f"{self.time:.2f} s, {self.text}"

    def to_table(self) -> dict[str, Any]:
        """Plain data: ``kind``, ``text`` and the fields."""
        fields = {k: v for k, v in dataclasses.asdict(self).items() if k != "robot"}
        return {"kind": type(self).__name__, **fields, "text": str(self)}


@dataclass(frozen=True)
class Overloaded(Event):
    """A part of a robot pressed the wall harder than the model of its contacts stands for.

    Attributes:
        part: of the robot, such as "module 1".
        force: N, the largest normal force.
        times: what that is in units of ``unit``.
        unit: "the preload", or "the robot's weight".
    """

    part: str
    force: float
    times: float
    unit: str
    sentence = (
        "{part}: normal force of {force:.0f} N, {times:.0f} times {unit}; forces of this run are "
        "not to be relied on"
    )


@dataclass(frozen=True)
class Remark(Event):
    """An event without a kind of its own, such as a message of a user's controller.

    Example:
        >>> print(ot.Remark(robot=0, time=2.0, words="the lamp is off"))
        2.00 s, the lamp is off
    """

    words: str
    sentence = "{words}"


@dataclass(frozen=True)
class Note(Remark):
    """A remark about the set-up of a run, before it began."""

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class BackedOff(Event):
    """A turn fails, or is about to: the robot backs off to before the fitting and tries again.

    Attributes:
        cause: why.
        how: what it does first; where backing off is hopeless, another thing.
    """

    fitting: str
    distance: float
    tilt_deg: float
    cause: str = "no headway"
    how: str = "backs off"
    sentence = (
        "in {fitting}: {cause} at {distance:.3f} m, tilt {tilt_deg:.1f} deg: {how} and tries again"
    )


@dataclass(frozen=True)
class Driven(Event):
    """Somebody else drives the robot from here on: a driver, or a controller."""

    who: str
    sentence = "driven by {who} from here on"


@dataclass(frozen=True)
class GoalReached(Event):
    """A goal of a mission is reached, and there is another one to follow."""

    goal: str
    sentence = "reached {goal}"


@dataclass(frozen=True)
class TakenForClosed(Event):
    """A robot hangs before a port and plans on as if it were closed."""

    port: str
    distance: float
    sentence = "no headway at {distance:.3f} m: takes {port} for closed"


@dataclass(frozen=True)
class FellOff(Event):
    """A robot is off its route, in another pipe of its network, between two ports of a fitting."""

    fitting: str
    port: str
    sentence = "in {fitting}: left its route, nose towards {port}"


@dataclass(frozen=True)
class FittingFound(Event):
    """A robot that explores sees a fitting for the first time, and adds it to its map."""

    fitting: str
    distance: float
    sentence = "found {fitting}, {distance:.3f} m ahead"


@dataclass(frozen=True)
class EndInspected(Event):
    """A robot that explores stands with its nose at an end of the network, open or closed."""

    port: str
    what: str
    sentence = "inspected {port}: {what}"


@dataclass(frozen=True)
class LoopClosed(Event):
    """A robot that explores has come, by another way, to where it has been."""

    port: str
    other: str
    miss: float
    sentence = "closed a loop: {port} is {other}, they missed by {miss:.4f} m"


@dataclass(frozen=True)
class ExplorationComplete(Event):
    """A robot has seen into every port of its map: a fitting, an open or a closed end."""

    fittings: int
    ends: int
    sentence = "explored all: {fittings} fittings, {ends} ends"


@dataclass(frozen=True)
class ExplorationIncomplete(Event):
    """A robot that explores gives up ports that it has not seen into.

    Attributes:
        fittings: explored.
        ends: explored.
        unexplored: which ports it has not seen into, and why.
    """

    fittings: int
    ends: int
    unexplored: str
    sentence = "explored {fittings} fittings, {ends} ends; not explored: {unexplored}"


@dataclass(frozen=True)
class LegBegan(Event):
    """A robot sets out on its next leg."""

    what: str
    sentence = "{what}"


@dataclass(frozen=True)
class LostItself(Event):
    """A robot that localises itself by onboard sensors is lost, and stops."""

    sentence = "does not know where it is: stops and looks"


@dataclass(frozen=True)
class FoundItself(Event):
    """A lost robot has localised itself again."""

    sentence = "knows where it is again: goes on"


@dataclass(frozen=True)
class GaveUp(Event):
    """A robot that hangs has no other way left."""

    cause: str
    sentence = "{cause}: gives up"


def event_of(table: Mapping[str, Any]) -> Event:
    """Return an event from the plain data of ``Event.to_table``.

    A kind that is not known here, because the module that defines it has not been imported, is read
    as a ``Remark`` with its text. A number that is null, because files hold none that is not
    finite, is not a number.
    """
    kind = Event.kinds.get(table["kind"])
    if kind is not None:
        types = {field.name: field.type for field in dataclasses.fields(kind)}
        fields = {k: v for k, v in table.items() if k not in ("kind", "text")}
        # Annotations are texts in this module, hence the comparison with the name of the type.
        numbers = {k: math.nan for k, v in fields.items() if v is None and types.get(k) == "float"}
        return kind(robot=0, **(fields | numbers))
    # The text begins with the time, which the remark adds by itself.
    words = str(table["text"]).partition(" s, ")[2] or str(table["text"])
    return Remark(0, float(table["time"]), words)
