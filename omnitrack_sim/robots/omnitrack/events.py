"""Events of the robot, and what the ends of its runs mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from omnitrack_sim.record.events import Event, Outcome

ADVICE: Mapping[Outcome, str] = {
    Outcome.MOTION_SINGULARITY: (
        "A module lost the wall in a tee and the turn stopped: align before the tee "
        "(control.align = true) or start with theta5 inside the safe margin."
    ),
    Outcome.STALLED: (
        "A crawler motor stood still at its torque limit: with a tilt of a few degrees raise "
        "robot.motor.torque_limit, lower robot.preload or take another robot.motor; with one of "
        "tens of degrees none of these frees the robot: find in the summary plot where it began "
        "to tilt, and try another start.theta5_deg or control.kind."
    ),
    Outcome.STUCK: (
        "The robot stopped without a stall or slip: look at tilt and contact in the summary "
        "plot, and try another start.theta5_deg or robot.contact_length; if robot.drive is not "
        "three_motors, its belts may lack the speeds that the way asks for, or the force where "
        "a module has no wall, and three_motors shows whether that is the cause."
    ),
    Outcome.WEDGED: (
        "The robot ended across the pipe: find in the summary plot where it began to tilt, and "
        "try another start.theta5_deg, more world.friction or robot.preload, or another "
        "control.kind."
    ),
    Outcome.SLIPPING: (
        "The belts ran but the robot did not follow: raise world.friction or robot.preload."
    ),
    Outcome.NO_MOTION_LINE: (
        "The modules lie on the no-motion line (roll near 90 degrees), where both tracks touch "
        "and oppose each other: start with another start.roll_deg."
    ),
}
"""What happened and what to try, where the robot's own keys are to be named."""


@dataclass(frozen=True)
class BeyondStop(Event):
    """An arm stood beyond its stop."""

    module: int
    depth_mm: float
    sentence = "arm {module}: stood {depth_mm:.1f} mm beyond its stop"


@dataclass(frozen=True)
class Rolled(Event):
    """A robot plans to roll its modules for a fitting. Angles in degrees.

    Attributes:
        place: "before" the fitting, or "in" it where the robot's nose is inside.
    """

    fitting: str
    roll_deg: float
    theta5_from_deg: float
    theta5_to_deg: float
    place: str = "before"
    sentence = (
        "{place} {fitting}: rolls the modules by {roll_deg:.1f} deg, theta5 from "
        "{theta5_from_deg:z.1f} to {theta5_to_deg:z.1f} deg"
    )


@dataclass(frozen=True)
class NotAligned(Event):
    """No roll helps a robot, "before" a fitting or "in" it (``place``); it drives on as it is."""

    fitting: str
    theta5_deg: float
    cause: str
    place: str = "before"
    sentence = "{place} {fitting}: theta5 {theta5_deg:.1f} deg, not aligned: {cause}"
