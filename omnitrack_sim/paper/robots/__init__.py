"""Claims about robots other than the paper's, one module each."""

from __future__ import annotations

from collections.abc import Sequence

from omnitrack_sim.paper.claim import Claim
from omnitrack_sim.paper.robots import climber, helix, pirate, presser, screw
from omnitrack_sim.robots.climber import Climber
from omnitrack_sim.robots.helix import Helix
from omnitrack_sim.robots.pirate import Pirate
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.screw import Screw

_CLAIMS: dict[type[Robot], Sequence[Claim]] = {
    Climber: climber.CLAIMS,
    Helix: helix.CLAIMS,
    Pirate: pirate.CLAIMS,
    Presser: presser.CLAIMS,
    Screw: screw.CLAIMS,
}


def claims_of(robot: type[Robot]) -> Sequence[Claim]:
    """Return the claims about a robot, ours or its own."""
    return _CLAIMS.get(robot) or robot.claims()
