"""What a mission asks for: where to go in a network, checked against it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from omnitrack_sim.base.bounds import MOST_GOALS, MOST_PARTS
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.network import Network


class Mission(Table):
    """Where to go in a network."""

    start: str
    """Open end where the robot begins, such as "inlet" or "riser.start"."""
    map: Literal["known", "unknown"] = "known"
    """Whether the robot knows the network; with "unknown" it makes a map of it."""
    task: Literal["explore", "find"] | None = None
    """With an unknown map: "explore" all of it and come back, or "find" the goals."""
    goals: Annotated[tuple[str, ...], Field(max_length=MOST_GOALS)] = ()
    """Open ends, in the order they are driven to; at least one. To find: in any order. None to
    explore."""
    avoid: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()
    """Fittings that are not entered; with a known map."""
    blocked: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()
    """Ports closed by a plate that the robot does not know of."""


def _task_faults(mission: Mission) -> list[Fault]:
    """What does not go together of map, task and goals."""
    faults = []
    if mission.map == "known" and mission.task is not None:
        faults.append(Fault("task", 'is for an unknown map (mission.map = "unknown")'))
    if mission.map == "unknown" and mission.task is None:
        faults.append(Fault("task", "is missing with an unknown map", ("explore", "find")))
    if mission.map == "unknown" and mission.avoid:
        faults.append(Fault("avoid", "is for a known map: nobody avoids what he does not know"))
    if mission.task == "explore" and mission.goals:
        faults.append(Fault("goals", 'are to be found (mission.task = "find"); none to explore'))
    if mission.task != "explore" and not mission.goals:
        faults.append(Fault("goals", "must have at least 1 item, not 0"))
    return faults


def ports_of(network: Network, mission: Mission) -> tuple[list[End], tuple[End, ...]]:
    """Ports of start and goals, and ports closed by a plate.

    Raises:
        NetworkError: see ``Planner``.
    """
    ends, plates, faults = [], [], _task_faults(mission)
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
