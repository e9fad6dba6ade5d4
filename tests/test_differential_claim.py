"""The claim about the differential, and pieces of the benchmark beside it; the benchmark itself
takes minutes."""

from __future__ import annotations

import differential as study
import numpy as np
import pytest
from brake_steering import BRAKES, BrakeSteering
from samples import sample_result, sample_trajectory

import omnitrack_sim as ot
from omnitrack_sim.paper import turns
from omnitrack_sim.paper.claim import ClaimVerdict
from omnitrack_sim.paper.experiments import scenarios


def slipping(millimetres: float, **changes: object) -> ot.Result:
    """A result whose three modules slip by so much together."""
    result = sample_result(**changes)
    metrics = result.metrics | {"slip_distance_m": [millimetres / 3000] * 3}
    return sample_result(metrics=metrics, **changes)


def claim(slip: float, equal: float, **changes: object):
    """The claim, measured where each drive slips by the same in both elbows to a millimetre."""
    runs = {
        f"elbow_{place}": [slipping(value + more, **changes) for more in (0.0, 1.0)]
        for value, places in (
            (slip, ("240_differential_real", "90_differential")),
            (equal, ("240_equal_real", "90_equal")),
        )
        for place in places
    }
    return turns.differential_slips_less(runs)


@pytest.mark.parametrize(
    ("slip", "outcome", "verdict"),
    [
        (50.0, ot.Outcome.REACHED_GOAL, ClaimVerdict.HOLDS),
        (150.0, ot.Outcome.REACHED_GOAL, ClaimVerdict.FAILS),
        (50.0, ot.Outcome.STUCK, ClaimVerdict.FAILS),
    ],
    ids=["less slip", "more slip", "stuck"],
)
def test_the_differential_has_to_pass_and_to_slip_less_than_equal_speeds(slip, outcome, verdict):
    """In both elbows."""
    found = claim(slip, 100.0, outcome=outcome)
    assert found.verdict is verdict
    assert f"{slip + 0.5:.0f} against 100 mm ({slip - 100:.0f} more" in found.measurement.measured
    assert found.changed == (verdict is ClaimVerdict.FAILS)


def test_its_runs_have_one_motor_and_the_draws_of_the_others():
    """In both elbows, as many as every other drive, with the motor that the paper names."""
    lists = scenarios(quick=True)
    for one, three in turns.ONE_MOTOR.items():
        assert {s.robot.drive for s in lists[one]} == {"differential"}
        assert {s.robot.drive for s in lists[three]} == {"three_motors"}
        for a, b in zip(lists[one], lists[three], strict=True):
            assert (a.start, a.world, a.robot.preload) == (b.start, b.world, b.robot.preload)
            assert a.physics == b.physics
            assert a.robot.motor.name == b.robot.motor.name == "pololu_1000_hpcb"
            assert a.route.centreline.length == b.route.centreline.length


@pytest.mark.parametrize("cell", study.cells(quick=False), ids=str)
def test_a_cell_of_the_benchmark_is_what_its_names_say(cell):
    """Drive, friction, place, rolled first or not; gravity in three directions for each start."""
    scenarios = study.trials(cell, [0.0, 30.0])
    assert [s.start.theta5_deg for s in scenarios] == [0.0, 30.0] * 3
    way_in = [s.route.centreline.frame(np.zeros(1))[0, :, 2] @ s.world.gravity for s in scenarios]
    assert np.allclose(way_in, np.repeat([-9.81, 9.81, 0.0], 2))
    first = scenarios[0]
    assert first.world.friction == cell.friction
    assert first.robot.drive == ("three_motors" if "three" in cell.way else "differential")
    assert (first.robot.gear_friction > 0) == ("gear friction" in cell.way)
    assert (first.robot.brake_force > 0) == ("brakes" in cell.way)
    assert first.control.align == (cell.place in (study.OVER, study.TURN))
    radius = {"240 mm elbow": 0.24, "90 mm elbow": 0.09, study.TURN: 0.09}.get(cell.place, np.nan)
    assert first.route.passages[1].bend_radius == pytest.approx(radius, nan_ok=True)


@pytest.mark.parametrize("place", study.ELBOWS | study.TEES)
def test_no_trial_is_the_mirror_image_of_another(place):
    """Gravity lies in the plane of the bend, so that one orientation and its negative would be one
    trial counted twice."""
    theta5 = study.orientations(study.Cell(place, study.ONE), quick=False)
    assert (
        len(theta5) == len({abs(angle) for angle in theta5}) == (12 if place == study.TURN else 6)
    )
    assert 0.0 not in theta5
    assert all(gravity[1] == 0.0 for gravity in study.GRAVITIES.values())


def test_needed_friction_is_that_of_the_module_that_needs_most():
    """Of those that carry 5 N or more, within the fitting; nothing where the robot did not get
    there."""
    normal, traction = np.full((201, 3), 20.0), np.full((201, 3), 4.0)
    normal[:, 1], traction[:, 1] = 2.0, 1.8
    traction[:, 2] = -10.0
    elbow = ot.load_scenario("elbow")
    place = {"distance": np.linspace(0.1, 0.9, 201)}
    forces = {"normal_force": normal, "traction": traction}
    there = sample_result(sample_trajectory(**place, **forces), scenario=elbow)
    assert study.needed_friction(there) == pytest.approx(0.5)
    before = sample_result(sample_trajectory(distance=np.full(201, 0.1)), scenario=elbow)
    assert study.needed_friction(before) == 0.0


def test_the_interval_of_a_median_holds_it_and_repeats():
    """The same draws each time; nothing to vary, no interval."""
    values = np.random.default_rng(3).normal(10.0, 2.0, 36).tolist()
    middle, low, high = study.median(values)
    assert low < middle < high
    assert high - low < 4.0
    assert study.median(values) == (middle, low, high)
    assert study.median([7.0] * 5) == (7.0, 7.0, 7.0)


def test_rows_count_what_passed_and_show_its_figures():
    """Failures stand by their outcome, and their figures do not enter."""
    good = {
        "success": True,
        "outcome": "reached_goal",
        **{f"slip_distance_m_{i}": 0.05 / 3 for i in (1, 2, 3)},
        **{f"traction_rms_n_{i}": float(i) for i in (1, 2, 3)},
        "needed_friction": 0.5,
        "tilt_max_deg": 8.0,
        "energy_j": 7.0,
    }
    bad = good | {"success": False, "outcome": "stuck", "energy_j": 900.0}
    assert study.figures(good) == pytest.approx((50.0, 3.0, 0.5, 8.0, 7.0))
    cell = study.Cell("240 mm elbow", study.ONE, 0.2)
    cells = study.row(cell, [good, good, bad])
    assert cells[1:4] == ["2 (21 to 94 %)", "50 (50 to 50)", "3.0 (3.0 to 3.0)"]
    assert cells[4].startswith("0.50 (")
    assert cells[-1] == "1 stuck"
    assert study.row(cell, [bad]).count("-") == 5
    trials = {cell._replace(way=way): [good, good, bad] for way in study.SLIPPERY_WAYS}
    (slippery,) = study.slippery_rows("240 mm elbow", trials)
    assert slippery[:3] == ["240 mm elbow", "0.2", "2; 50"]


def test_brakes_hold_what_runs_faster_than_asked():
    """In a turn the inner belt is braked below the outer ones, and one that is slower than asked is
    not braked."""
    changes = BRAKES | {"start.distance": 0.25}
    changes |= {"run.time_limit": 2.5}
    simulation = ot.Simulation(
        [ot.override(ot.load_scenario("tee_turn"), changes)], controller=BrakeSteering
    )
    while simulation.active.any():
        simulation.step()
    trajectory = simulation.results()[0].trajectory
    late = trajectory.time > 1.8
    speeds = trajectory["wall_speed"][late].mean(axis=0)
    assert speeds[0] < 0.6 * min(speeds[1:])
    assert np.degrees(trajectory["tilt"].max()) < 30.0
