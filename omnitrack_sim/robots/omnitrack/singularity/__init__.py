"""Section IV of the paper: where a module loses the wall while the robot turns in a tee.

``region`` has the motion singularity region in closed form, ``contact`` the contact of modules of
finite length in the exact geometry of two pipes, ``case`` both together for one robot at one tee.
"""

from omnitrack_sim.robots.omnitrack.singularity.case import TurnCase
from omnitrack_sim.robots.omnitrack.singularity.contact import (
    ContactMap,
    TeePath,
    contact_map,
    outer_sector,
    straight_path,
    turn_path,
    wall_distance,
)
from omnitrack_sim.robots.omnitrack.singularity.region import (
    DEFINITIONS,
    PAPER_SECTOR,
    Definition,
    best_theta5,
    failure_rate,
    is_singular,
    mitre_ellipse,
    mitre_intersection,
    reach_from_sector,
    safe_margin,
    section_ellipse,
    sector_angle,
    success_rate,
    worst_theta5,
)

__all__ = [
    "DEFINITIONS",
    "PAPER_SECTOR",
    "ContactMap",
    "Definition",
    "TeePath",
    "TurnCase",
    "best_theta5",
    "contact_map",
    "failure_rate",
    "is_singular",
    "mitre_ellipse",
    "mitre_intersection",
    "outer_sector",
    "reach_from_sector",
    "safe_margin",
    "section_ellipse",
    "sector_angle",
    "straight_path",
    "success_rate",
    "turn_path",
    "wall_distance",
    "worst_theta5",
]
