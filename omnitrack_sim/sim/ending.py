"""The outcome of a run that is over, judged by the truth."""

from __future__ import annotations

from dataclasses import dataclass

from omnitrack_sim.autonomy.pilots import Pilot
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.scenario import Scenario


@dataclass(frozen=True)
class Ending:
    """Outcome of one robot's run, and the reason."""

    outcome: Outcome
    reason: str


def ending_at_goal(
    scenario: Scenario,
    pilot: Pilot,
    reason: str,
    pose: tuple[Array, Array],
    error: float,
    lies_across: bool,
) -> Ending:
    """Judge a robot that takes itself to have reached its goal.

    Args:
        scenario: that it runs.
        pilot: which may know of goals that were missed, and has made a map perhaps.
        reason: where it is, and the measurements there.
        pose: its true position (3,) m and the direction (3,) of its nose, world frame.
        error: m, by which its estimated arc length is too large.
        lies_across: it lies across its pipe.
    """
    # A robot that localises itself may take itself to be where it is not.
    if not scenario.is_done_at(*pose, error):
        return Ending(Outcome.LOST, f"took itself to be at the goal; {reason}")
    if pilot.missed:
        return Ending(Outcome.STUCK, f"no way to {', '.join(pilot.missed)} is left; {reason}")
    if lies_across:
        return Ending(Outcome.WEDGED, reason)
    return _by_map(scenario, pilot, reason)


def _by_map(scenario: Scenario, pilot: Pilot, reason: str) -> Ending:
    """Judge a robot at its goal by the map that it has made.

    Parts that it reports as unexplored may be missing.
    """
    exploration, belief = scenario.exploration, pilot.belief
    # Who searches for goals has no need of a whole map.
    if exploration is None or belief is None or exploration.mission.task == "find":
        return Ending(Outcome.REACHED_GOAL, reason)
    left = pilot.unexplored
    if left:
        reason = f"not explored: {left}; {reason}"
    difference = exploration.difference(belief.network)
    if difference.same:
        return Ending(Outcome.REACHED_GOAL, reason)
    right = difference.consistent and left
    outcome = Outcome.REACHED_GOAL if right else Outcome.WRONG_MAP
    return Ending(outcome, f"{difference}; {reason}")
