"""What scenarios share to run in one batch, and that the rest is taken from each on its own."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from runs import rolling_tee, same_record, same_result, there_and_back

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.motors import WINDING_FIGURES
from omnitrack_sim.scenario.tables import PullTable
from omnitrack_sim.sim.builder import CARRIED, EACH, batch_key
from omnitrack_sim.trials.batches import Trial, batched

OWN = (*EACH.values(), *CARRIED, *(f"robot.{path}" for path in Omnitrack.own_values))
"""Paths that robots of one batch may differ in."""
SCENARIOS = {"tee": rolling_tee, "mission": there_and_back}


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths of all plain values in tables and lists of tables; a list of plain values is one."""
    if isinstance(value, Mapping):
        items = list(value.items())
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        items = list(enumerate(value))
    else:
        items = []
    if not items:
        yield path
    for key, inner in items:
        yield from leaves(inner, (*path, str(key)))


def changed(data: Any, path: tuple[str, ...]) -> Any:
    """A copy of plain data with another value at a path."""
    data = copy.deepcopy(data)
    *tables, key = path
    place = functools.reduce(lambda d, k: d[int(k) if isinstance(d, list) else k], tables, data)
    place[int(key) if isinstance(place, list) else key] = "another value"
    return data


@functools.cache
def plain(name: str) -> dict[str, Any]:
    """A scenario with every key, as plain data."""
    return SCENARIOS[name]().model_dump(mode="json")


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_value_is_each_robots_own_or_shared(name: str) -> None:
    """Every key of a resolved scenario is either taken from each robot on its own, and changing it
    keeps the key of the batch, or it is shared, and changing it changes the key."""
    data = plain(name)
    kept, own = [], []
    for path in leaves(data):
        dotted = ".".join(path)
        if batch_key(changed(data, path)) == batch_key(data):
            kept.append(dotted)
        if any(dotted == key or dotted.startswith(key + ".") for key in OWN):
            own.append(dotted)
    assert own, "no key is a robot's own"
    assert kept == own


def test_all_that_is_taken_of_each_is_a_key() -> None:
    """No path of the two lists is misspelt: each leads to a value of a scenario."""
    known = {
        ".".join(path[:depth])
        for name in SCENARIOS
        for path in leaves(plain(name))
        for depth in range(5)
    }
    known |= {"mission.avoid", *(f"pull.{key}" for key in PullTable.model_fields)}
    known |= {f"robot.motor.winding.{key}" for key in WINDING_FIGURES}
    assert [path for path in OWN if path not in known] == []


def test_the_key_does_not_depend_on_the_order_of_the_data() -> None:
    """Data with its tables in another order has the same key."""
    data = plain("tee")
    assert batch_key(dict(reversed(data.items()))) == batch_key(data)


OTHER: dict[str, Any] = {
    "start.distance": 0.27,
    "start.theta5_deg": -20.0,
    "start.roll_deg": 30.0,
    "world.gravity": [0.0, 3.0, 0.0],
    "world.friction": 0.3,
    "robot.preload": 15.0,
    "robot.chassis_mass": 0.5,
    "robot.arm_mass": 0.1,
    "robot.module_mass": 0.3,
    "robot.motor.rotor_inertia": 2e-8,
    "robot.motor.gear_ratio": 700.0,
    "robot.motor.no_load_speed": 6.0,
    "robot.motor.stall_torque": 0.3,
    "robot.motor.torque_limit": 0.05,
    "robot.motor.speed_bandwidth": 9.0,
    "robot.motor.speed_integral_time": 0.3,
    "robot.motor.speed_droop": 9.0,
    "robot.roll_torque": 0.02,
    "control.cruise_speed": 0.06,
    "control.align": False,
    "control.retry": False,
    "control.speed_limit": 0.05,
    "control.safe_margin_deg": 59.0,
    "control.parameters": {"recovery": {"retries": 0}, "tracking": {"gain": 1.0}},
    "run.time_limit": 0.7,
    "run.goal_distance": 0.31,
    "pull.force": 4.0,
    "pull.rate": 9.0,
}
"""Another value for each path that a batch takes of each robot, and for the goal that each brings
to its own legs."""


def tee(**changes: Any) -> ot.Scenario:
    """Before a tee the modules are rolled a little; in it no way is far enough to count as headway,
    so that the robot backs off."""
    base = {
        "control.parameters.recovery.patience": 0.08,
        "control.parameters.recovery.progress": 0.16,
        "run.time_limit": 2.2,
        "start.theta5_deg": 15.0,
        "start.distance": 0.30,
        "pull.force": 1.0,
    }
    return rolling_tee(**(base | changes))


def test_another_value_is_there_for_all_that_is_taken_of_each() -> None:
    """``OTHER`` has a value for every path of ``EACH``."""
    assert set(EACH.values()) <= set(OTHER)


@functools.cache
def together(order: int = 1) -> dict[str | None, ot.Result]:
    """Results of a turn, and of that with the other value at each path, in one batch.

    Args:
        order: of the robots in it; -1 begins with the last one.
    """
    paths = [None, *OTHER][::order]
    scenarios = [tee() if path is None else tee(**{path: OTHER[path]}) for path in paths]
    assert len({batch_key(scenario.model_dump(mode="json")) for scenario in scenarios}) == 1
    simulation = ot.Simulation(scenarios)
    simulation.advance()
    return dict(zip(paths, simulation.results(), strict=True))


def test_robots_that_differ_share_a_batch_and_not_their_numbers() -> None:
    """Robots that differ in what is taken of each run in one batch, and each has the bytes that it
    has alone, or beside others than before; the other value leads to another record, so that the
    comparison can fail."""
    results = together()
    for path in (None, "start.theta5_deg", "robot.motor.torque_limit", "pull.force"):
        (alone,) = ot.run_batch(
            [tee() if path is None else tee(**{path: OTHER[path]})], threads=1, no_load=False
        )
        assert same_result(results[path], alone), path
    for path, result in together(-1).items():
        assert same_result(results[path], result), path
        assert same_record(results[None], result) is (path is None), path


def test_currents_of_a_batch_are_those_of_each_robots_own_winding() -> None:
    """To the last bit, where torque constants and frictions differ."""
    base = ot.load_scenario("calibration/climb", {"run.time_limit": 0.5})
    paths = ("torque_constant", "no_load_current", "current_limit")
    others = [
        ot.override(base, {f"robot.motor.winding.{path}": value})
        for path, value in zip(paths, (0.004, 0.05, 0.2), strict=True)
    ]
    together = ot.run_batch([base, *others], no_load=False)
    assert len({batch_key(one.model_dump(mode="json")) for one in [base, *others]}) == 1
    for one, other in zip(together, [base, *others], strict=True):
        (alone,) = ot.run_batch([other], no_load=False)
        current = alone.trajectory["motor_current"]
        assert one.trajectory["motor_current"].tobytes() == current.tobytes()
    currents = [one.trajectory["motor_current"] for one in together]
    assert not any((current == currents[0]).all() for current in currents[1:])


@pytest.mark.parametrize(("base", "count"), [("tee_turn", 1), ("robots/presser_elbow", 2)])
def test_what_trials_share_follows_from_their_robot(base: str, count: int) -> None:
    """Robots of one batch may differ in the springs of the one kind, and not of the other."""
    bases = {"base": ot.load_scenario(base).model_dump(mode="json")}
    trials = [Trial(i, "base", {"robot.preload": 25.0 + i}) for i in range(2)]
    assert len(batched(bases, trials, 8)) == count
