"""The wheeled wall-presser: what holds it, how fast it climbs, what it passes and what stops it."""

import numpy as np
import pytest
from in_pipes import DOWN, LEVEL, UP, Drive, pipe

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import rotation_about
from omnitrack_sim.pipes import Elbow
from omnitrack_sim.robots.presser import ARMS, Presser, bend_ratios


@pytest.mark.parametrize("axis", [UP, LEVEL, DOWN])
@pytest.mark.parametrize("payload", [0.0, 0.6])
def test_it_climbs_at_the_speed_of_its_motors_and_their_droop(axis, payload):
    """Its speed is r (w0 - m g r / 6 k), within 1 %, up, level and down."""

    def load(spec):
        spec.body("chassis").add_geom(size=[0.01, 0, 0], mass=payload + 1e-9, contype=0)

    robot = Presser()
    drive = Drive(robot, pipe("straight", axis=axis), edit=load).run(4.0)
    droop = axis[2] * drive.weight * robot.wheel_radius / 6 / robot.motor_gain
    law = robot.speed - robot.wheel_radius * droop
    assert drive.speed(2.0) == pytest.approx(law, rel=0.01)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_preload_times_friction_holds_its_weight(part):
    """It climbs if the springs' forces times the friction exceed its weight by a tenth; a tenth
    below them it slides down."""
    weight = 9.81 * Presser().spec().compile().body_mass.sum()
    robot = Presser(friction=part * weight / (3 * 40.0))
    drive = Drive(robot, pipe("straight", "straight"), s=0.7).run(1.5)
    assert (drive.s > 0.75) == (part > 1)
    assert (drive.s < 0.6) == (part < 1)


@pytest.mark.parametrize(("axis", "roll"), [(UP, 0), (UP, 60), (LEVEL, 0), (DOWN, 60)])
def test_it_passes_elbows(axis, roll):
    """With an arm at the inside or at the outside of the bend."""
    assert Drive(Presser(), pipe("elbow", axis=axis), roll=roll).run(15.0, until=1.1).s > 1.1


@pytest.mark.parametrize(
    ("axis", "turn", "roll"),
    [(UP, 0, 0), (UP, 0, 30), (LEVEL, 90, 0), (LEVEL, 90, 60), (LEVEL, 180, 30)],
)
def test_it_crosses_a_tee_with_the_branch_at_any_side(axis, turn, roll):
    """Its arms' outer stops keep wheels over the opening from falling in."""
    course = pipe("tee", axis=axis, turns=[turn])
    assert Drive(Presser(), course, roll=roll).run(15.0, until=1.1).s > 1.1


def test_too_little_preload_leaves_it_in_the_tee():
    """At 25 N a wheel that hangs in the opening stops at the far edge."""
    drive = Drive(Presser(preload=25.0), pipe("tee")).run(12.0)
    assert 0.6 < drive.s < 0.75
    assert abs(drive.speed(2.0)) < 0.002


def test_it_does_not_turn_into_a_branch():
    """All its wheels turn alike: it goes straight on."""
    drive = Drive(Presser(), pipe("branch", axis=LEVEL, turns=[90])).run(8.0)
    run_end = drive.course.network.parts[1].port("run_end")
    assert (drive.chassis.xpos - run_end.position) @ run_end.rotation[:, 2] > -0.1


def test_a_tight_elbow_stops_it():
    """Of 90 mm: its wheelbase is 104 mm."""
    drive = Drive(Presser(), pipe((Elbow(0.09), "start", "end"))).run(8.0)
    assert drive.s < 0.6
    assert abs(drive.speed(2.0)) < 0.002
    assert np.isfinite(drive.data.qpos).all()


def test_speeds_of_a_bend_are_those_of_turning_about_its_centre():
    """Wheels of a robot that turns at a rate w about a centre R away roll at w times their own
    distance from it, at any roll; in a straight all roll alike."""
    rng = np.random.default_rng(1)
    rolls = rng.uniform(0, 2 * np.pi, 5)
    frames = np.stack([rotation_about([0, 0, 1], roll) for roll in rolls])
    inwards, bore, radius = np.array([1.0, 0.0, 0.0]), 0.08, 0.24
    wheels = bore * np.stack([np.cos(ARMS), np.sin(ARMS), 0 * ARMS], axis=-1)
    centred = wheels @ np.moveaxis(frames, -1, -2) - radius * inwards  # (5, 3, 3)
    ratios = bend_ratios(frames, np.tile(inwards, (5, 1)), np.full(5, bore / radius))
    np.testing.assert_allclose(ratios, -centred[:, :, 0] / radius)
    assert (bend_ratios(frames, np.tile(inwards, (5, 1)), np.zeros(5)) == 1).all()


def test_speeds_of_the_bend_spare_the_motors():
    """Wheels that are asked for what the bend makes them roll at do not work against each other."""
    runs = [
        ot.run(ot.load_scenario("robots/presser_elbow", {"control.kind": kind}))
        for kind in ("bend", "own")
    ]
    assert all(run.success for run in runs)
    assert runs[0].metrics["energy_j"] < 0.95 * runs[1].metrics["energy_j"]


@pytest.mark.parametrize("name", ["presser_tee", "presser_branch"])
def test_a_shipped_scenario_ends_as_it_says(name):
    """Straight over a tee; across in one whose branch is to be entered."""
    assert ot.run(ot.load_scenario(f"robots/{name}")).as_expected
