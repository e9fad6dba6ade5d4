"""Short runs that several test files compare byte for byte."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnitrack_sim import Result, Scenario, load_scenario, override
from omnitrack_sim.scenario import validate


def rolling_tee(**changes: Any) -> Scenario:
    """A tee turn from a bad orientation, so that the modules are rolled before the tee."""
    base = {
        "run.time_limit": 3.0,
        "start.distance": 0.25,
        "start.theta5_deg": 50.0,
    }
    return override(load_scenario("tee_turn"), base | changes)


def there_and_back(**changes: Any) -> Scenario:
    """A mission to the end of a pipe and back to its start: the gear changes on the way."""
    pipes = [{"kind": "straight", "name": name, "length": 0.2} for name in ("a", "b")]
    network = {"fittings": pipes, "joints": [{"ports": ["a.end", "b.start"]}]}
    mission = {"start": "a.start", "goals": ["b.end", "a.start"]}
    scenario = validate(
        {
            "network": network,
            "mission": mission,
            "control": {"cruise_speed": 0.15},
        }
    )
    return override(scenario, changes)


def same_record(a: Result, b: Result) -> bool:
    """Whether two results have the same bytes in every channel, in time and in joint positions."""
    one, two = a.trajectory, b.trajectory
    return (
        one.phases == two.phases
        and set(one.channels) == set(two.channels)
        and one.time.tobytes() == two.time.tobytes()
        and one.qpos.tobytes() == two.qpos.tobytes()
        and all(one[name].tobytes() == np.asarray(two[name]).tobytes() for name in one.channels)
    )


def same_result(a: Result, b: Result) -> bool:
    """Whether two results are the same in all but where they ran, and the slip without load."""
    return (
        same_record(a, b)
        and (a.scenario, a.outcome, a.reason, a.duration_s)
        == (
            b.scenario,
            b.outcome,
            b.reason,
            b.duration_s,
        )
        and (a.events, a.legs) == (b.events, b.legs)
        and _figures(a) == _figures(b)
    )


def _figures(result: Result) -> dict[str, Any]:
    return {key: value for key, value in result.metrics.items() if key != "no_load_slip_m_s"}
