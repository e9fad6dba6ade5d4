"""How a run can end, and what to try next."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """The end of one trial. A failed traversal is a result, not an error."""

    REACHED_GOAL = "reached_goal"
    MOTION_SINGULARITY = "motion_singularity"
    STALLED = "stalled"
    STUCK = "stuck"
    SLIPPING = "slipping"
    NO_MOTION_LINE = "no_motion_line"
    LEFT_PIPE = "left_pipe"
    TIMED_OUT = "timed_out"
    LOST = "lost"
    ENDED = "ended"
    DIVERGED = "diverged"

    @property
    def advice(self) -> str:
        """One sentence: what happened and what to try."""
        return _ADVICE[self]


_ADVICE = {
    Outcome.REACHED_GOAL: "The robot reached the goal.",
    Outcome.MOTION_SINGULARITY: (
        "A module lost the wall in a tee and the turn stopped: align before the tee (control.align "
        "= true) or start "
        "with theta5 inside the safe margin."
    ),
    Outcome.STALLED: (
        "A crawler motor stood still at its torque limit: with a tilt of a few degrees raise "
        "robot.motor.torque_limit, lower robot.preload or take another robot.motor; with one of "
        "tens of degrees the robot is wedged across the pipe, and none of these frees it: find in "
        "the summary plot where it began to tilt, and try another start.theta5_deg or control.kind."
    ),
    Outcome.STUCK: (
        "The robot stopped without a stall or slip: look at tilt and contact in the summary plot, "
        "and try another start.theta5_deg or robot.contact_length; if robot.drive is not "
        "three_motors, its belts may lack the speeds that the way asks for, or the force where a "
        "module has no wall, and three_motors shows whether that is the cause."
    ),
    Outcome.SLIPPING: "The belts ran but the robot did not follow: raise world.friction or "
    "robot.preload.",
    Outcome.NO_MOTION_LINE: (
        "The modules lie on the no-motion line (roll near 90 degrees), where both tracks touch and "
        "oppose each other: "
        "start with another start.roll_deg."
    ),
    Outcome.LEFT_PIPE: (
        "The robot's centre left its way, out of a pipe or past a tee into another one: check "
        "start.distance, and "
        "gravity against the friction."
    ),
    Outcome.TIMED_OUT: "Time ran out while the robot still moved: raise run.time_limit.",
    Outcome.LOST: (
        "The robot did not know where it was, or took itself to be at a goal where it was not: "
        "look at the estimates in the record, and try another sensing.camera or less noise."
    ),
    Outcome.ENDED: "Whoever drove the robot ended the run.",
    Outcome.DIVERGED: "The physics diverged: lower physics.timestep or look for extreme "
    "parameters.",
}
