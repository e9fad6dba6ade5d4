"""Ranges of the robot's parameters: what is refused, and that what is accepted can be simulated."""

import math

import pytest
from random_robots import random_robots, standing

import omnitrack_sim as ot
from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.robots.quantity import SCALES, quantity_of
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.run import no_load_slips


def _faults(**robot) -> dict[str, str]:
    with pytest.raises(ScenarioError) as caught:
        validate({"pipes": [{"kind": "straight", "length": 1.0}], "robot": robot})
    return {fault.where.removeprefix("robot."): fault.problem for fault in caught.value.faults}


def _numbers(model: type[ot.Omnitrack] | type[ot.Motor]) -> dict[str, tuple[float, float]]:
    found = {name: quantity_of(model, name).within for name in model.model_fields}
    return {name: within for name, within in found.items() if within is not None}


def test_every_number_of_robot_and_motor_has_a_range():
    """Only names, sources and the motors themselves have none."""
    without = {
        name
        for model in (ot.Omnitrack, ot.Motor, ot.Winding)
        for name in model.model_fields
        if name not in _numbers(model)
    }
    assert without == {"name", "source", "motor", "winding", "roll_motor", "drive", "tether"}


@pytest.mark.parametrize("value", [-1e300, -1.0, 1e-300, 1e300])
def test_a_number_out_of_its_range_is_refused_with_limits_and_unit(value):
    """Every number of the robot beyond either end of its range is a fault of its own; all are told
    at once."""
    values = {
        name: value
        for name, (low, high) in _numbers(ot.Omnitrack).items()
        if not low <= value <= high and name not in ("lugs_per_track", "springs_per_module")
    }
    faults = _faults(**values)
    assert faults.keys() == values.keys()
    for name, (low, high) in _numbers(ot.Omnitrack).items():
        if name in values and "scale" not in name:
            unit = quantity_of(ot.Omnitrack, name).unit
            assert f"must be from {low:.6g} to {high:.6g} {unit}".removesuffix(" 1") in faults[name]


def test_limits_scale_with_the_values():
    """At half the scale the preload, a force, has an eighth of its limit, and the message says at
    which scale."""
    half = {"scale": 0.5, "values_at_scale": 0.5}
    assert "from 0 to 250 N at scale 0.5" in _faults(**half, preload=260.0)["preload"]
    assert ot.Omnitrack(**half, preload=250.0).preload == 250.0


def test_a_robot_at_the_ends_of_its_ranges_may_be_scaled_to_either_end():
    """Rounding of the scaled value does not push it over the scaled limit."""
    stiffest = ot.Omnitrack(spring_stiffness=1e5, preload=2000.0, chassis_mass=0.01, reach=0.4)
    for scale in SCALES:
        there = stiffest.scaled(scale)
        assert ot.Omnitrack.model_validate(there.model_dump()) == there


@pytest.mark.parametrize(
    ("robot", "where", "told"),
    [
        ({"preload": 2000.0, "spring_stiffness": 100.0}, "preload", "at most 1 m"),
        ({"reach": 0.079}, "reach", "over nominal_pipe_radius, 0.08 m"),
        ({"nominal_pipe_radius": 0.03, "lug_radius": 0.04}, "lug_radius", "under"),
        ({"slide_travel_inward": 0.06}, "slide_travel_inward", "under 0.0524 m"),
        ({"track_offset": 0.0139}, "track_offset", "0.0138 m"),
        ({"module_mass": 20.0, "motor": "pololu_1000_hpcb"}, "motor.stall_torque", "5.451 N m"),
    ],
)
def test_values_that_do_not_go_together_are_refused(robot, where, told):
    """Each value is within its range, and together they are no robot."""
    assert told in _faults(**robot)[where]


@pytest.mark.parametrize("collider", ["primitives", "exact"])
def test_every_robot_within_the_ranges_can_be_simulated(collider):
    """Robots drawn over the whole ranges, many values at their ends, compile in MuJoCo and take a
    first step. What becomes of them after it is a result."""
    for robot in random_robots(seed=5, count=6):
        simulation = ot.Simulation([validate(standing(robot, collider))])
        simulation.step()
        assert simulation.time[0] > 0


def test_a_run_of_any_robot_ends_with_an_outcome_and_without_a_warning():
    """Robots at the ends of their ranges may diverge or leave the pipe at once; their slip without
    load is then not a number, and nothing divides by zero on the way."""
    scenarios = [
        validate(standing(robot, "primitives") | {"run": {"time_limit": 0.1}})
        for robot in random_robots(seed=3, count=4)
    ]
    results = ot.run_batch(scenarios)
    assert any(math.isnan(result.metrics["no_load_slip_m_s"]) for result in results)
    assert all(math.isfinite(result.metrics["energy_j"]) for result in results)


@pytest.mark.parametrize("robot", [{"contact_length": 1.0}, {"scale": 0.1}])
def test_slip_without_load_is_measured_for_long_and_for_small_robots(robot):
    """The pipe that it is measured in holds the robot, and does not end before the measurement."""
    made = ot.Omnitrack(**robot)
    slips = no_load_slips([validate(standing(made, "primitives"))])
    assert all(0 <= slip < 0.1 for slip in slips)
