"""What a mission asks for: where to go in a network, checked against it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from omnitrack_sim.bounds import MOST_GOALS, MOST_PARTS
from omnitrack_sim.errors import Fault, NetworkError
from omnitrack_sim.network.layout import End
from omnitrack_sim.network.spec import Network
from omnitrack_sim.table import Table


class Mission(Table):
    """Where to go in a network."""

    start: str
    """Open end where the robot begins, such as "inlet" or "riser.start"."""
    goals: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_GOALS)]
    """Open ends, in the order they are driven to; at least one."""
    avoid: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()
    """Fittings that are not entered."""
    blocked: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()
    """Ports closed by a plate that the robot does not know of."""


def ports_of(network: Network, mission: Mission) -> tuple[list[End], tuple[End, ...]]:
    """Ports of start and goals, and ports closed by a plate.

    Raises:
        NetworkError: see ``Planner``.
    """
    ends, plates, faults = [], [], []
    asked = [
        ("start", mission.start),
        *((f"goals.{i}", goal) for i, goal in enumerate(mission.goals)),
    ]
    for where, port in asked:
        try:
            ends.append(network.end(where, port))
            if len(ends) > 1 and ends[-1] == ends[-2]:
                faults.append(Fault(where, f"{port!r} is where the robot is already"))
        except NetworkError as error:
            faults += error.faults
    names = dict.fromkeys(part.name for part in network.fittings)
    faults += [
        Fault(f"avoid.{i}", f"there is no fitting {name!r}", tuple(names), given=name)
        for i, name in enumerate(mission.avoid)
        if name not in names
    ]
    for i, port in enumerate(mission.blocked):
        try:
            plates.append(network.port(port, f"blocked.{i}"))
        except NetworkError as error:
            faults += error.faults
    if faults:
        raise NetworkError(faults)
    return ends, tuple(plates)
