"""Claims about robots other than the paper's, one module each."""

from __future__ import annotations

from collections.abc import Sequence

from omnitrack_sim.paper.claim import ClaimMeasure
from omnitrack_sim.paper.robots import climber, helix, pirate, presser, screw
from omnitrack_sim.robots.climber import Climber
from omnitrack_sim.robots.helix import Helix
from omnitrack_sim.robots.pirate import Pirate
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.screw import Screw

_MEASURES: dict[type[Robot], Sequence[ClaimMeasure]] = {
    Climber: climber.MEASURES,
    Helix: helix.MEASURES,
    Pirate: pirate.MEASURES,
    Presser: presser.MEASURES,
    Screw: screw.MEASURES,
}


def measures_of(robot: type[Robot]) -> Sequence[ClaimMeasure]:
    """Return the functions that measure claims about a robot, ours or its own."""
    return _MEASURES.get(robot) or robot.claims()
