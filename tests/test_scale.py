"""The same robot for pipes of other bores: the law of dynamic similarity under gravity."""

import math
from functools import cache
from typing import ClassVar

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import features_of
from omnitrack_sim.robots.omnitrack.policy.file import DIRECT
from omnitrack_sim.robots.quantity import froude_exponent, quantity_of, similar
from omnitrack_sim.scenario import validate

SCALES = (0.625, 1.875)
"""For pipes of 100 and 300 mm."""


@pytest.mark.parametrize(
    ("unit", "exponent"),
    [
        ("m", 1),
        ("kg", 3),
        ("s", 0.5),
        ("m/s", 0.5),
        ("m/s²", 0),
        ("N", 3),
        ("N/m", 2),
        ("N s/m", 2.5),
        ("N m", 4),
        ("N m/rad", 4),
        ("N m s/rad", 4.5),
        ("rad/s", -0.5),
        ("kg m²", 5),
        ("rad", 0),
        ("1", 0),
        ("", 0),
    ],
)
def test_exponents_follow_from_the_unit(unit, exponent):
    """Lengths 1, masses 3, times 1/2, and so gravity 0."""
    assert froude_exponent(unit) == exponent


def test_an_unknown_unit_is_refused():
    """A unit that the law does not know is an error, not an exponent of zero."""
    with pytest.raises(ValueError, match="mm"):
        froude_exponent("N/mm")


def test_every_parameter_follows_the_law():
    """Each value of a scaled robot and of its motor is the reference's times s to its unit's
    exponent."""
    for s in SCALES:
        pairs = zip(ot.Omnitrack().parameters(), ot.Omnitrack(scale=s).parameters(), strict=True)
        for one, other in pairs:
            if one.name in ("scale", "values_at_scale", "motor.scale"):
                assert (one.value, other.value) == (1.0, s)
            else:
                assert other.value == similar(one.value, one.unit, s), one.name


def test_masses_forces_and_inertias_of_the_model_follow_the_law():
    """In the compiled model masses grow by s³, inertias by s⁵ and spring stiffnesses by s²."""
    one = _run_of(1.0).to_spec().compile()
    for s in SCALES:
        other = _run_of(s).to_spec().compile()
        assert other.body_mass == pytest.approx(one.body_mass * s**3)
        assert other.body_inertia == pytest.approx(one.body_inertia * s**5)
        assert other.tendon_stiffness == pytest.approx(one.tendon_stiffness * s**2)
        roll, belt = (one.joint(name).dofadr[0] for name in ("roll_1", "belt_upper_1"))
        assert other.dof_armature[roll] == pytest.approx(one.dof_armature[roll] * s**5)
        assert other.dof_armature[belt] == pytest.approx(one.dof_armature[belt] * s**3)


class Looking:
    """A controller that stands still and keeps what a policy would see."""

    seen: ClassVar[list] = []

    def __init__(self, setup):
        self.decisions = Decisions(setup, features_of("truth"), DIRECT)

    def step(self, observation):
        self.seen.append(self.decisions.observe(observation)[0])
        self.decisions.decide(np.zeros((1, 4), np.float32))
        return self.decisions.command(observation)


def test_a_policy_sees_the_same_at_any_scale():
    """Entries are in units of the robot's own bore, weight and speed."""
    Looking.seen.clear()
    for s in (1.0, *SCALES):
        periods = {"physics.timestep": 0.002, "physics.control_period": 0.01, "record.period": 0.01}
        turn = ot.override(_run_of(s, bend=True), {"run.time_limit": 0.01, **periods}).driven_by(
            Looking
        )
        ot.run(turn, no_load=False)
    one, *others = Looking.seen[:: len(Looking.seen) // 3]
    assert len(one) > 20
    for other in others:
        assert other == pytest.approx(one, rel=0.01, abs=0.01)


def test_a_scale_of_one_changes_no_bit():
    """The robot of scale 1 is the default robot, and what it dumps is read as itself."""
    assert ot.Omnitrack(scale=1.0) == ot.Omnitrack() == ot.Omnitrack().scaled(1.0)


def test_a_scaled_robot_is_read_again_as_it_is():
    """Its JSON says that the values are for its own scale, so nothing is scaled a second time."""
    scenario = _run_of(0.625)
    text = scenario.model_dump_json()
    again = ot.Scenario.model_validate_json(text)
    assert again == scenario
    assert again.model_dump_json() == text
    assert ot.override(scenario, {"control.cruise_speed": 0.05}).robot == scenario.robot


def test_asking_twice_for_a_scale_asks_for_the_same():
    """``robot.scale`` is a size and not a factor: setting it again does nothing, and setting it
    back returns to the reference within rounding."""
    small = ot.Omnitrack(scale=0.625)
    values = small.model_dump()
    assert ot.Omnitrack.model_validate(values | {"scale": 0.625}) == small
    back = ot.Omnitrack.model_validate(values | {"scale": 1.0})
    assert back.lug_radius == pytest.approx(ot.Omnitrack().lug_radius)
    assert ot.Omnitrack().scaled(0.625) == small


def test_given_values_are_for_160_mm_pipes_unless_they_say_otherwise():
    """A value in a file is scaled with the rest; with ``values_at_scale`` it is the actual one, and
    what is not given still comes from the reference."""
    s = 0.625
    assert ot.Omnitrack(scale=s, preload=30).preload == 30 * s**3
    measured = ot.Omnitrack(scale=s, values_at_scale=s, preload=8.0)
    assert measured.preload == 8.0
    assert measured.reach == ot.Omnitrack(scale=s).reach


@pytest.mark.parametrize("kind", ["omnitrack", "climber"])
def test_a_change_means_the_robot_at_hand(kind):
    """Beside a file that gives a size alone, a changed value is that of the robot of this size."""
    data = {"robot": {"kind": kind, "scale": 2.0}, "pipes": [{"kind": "straight", "length": 3.0}]}
    data["pipes"][0]["inner_diameter"] = 0.32
    changes = {"robot.preload": 150.0, "start.distance": 1.0}
    robot = validate(data, changes=changes).robot
    assert (robot.scale, robot.preload) == (2.0, 150.0)
    assert robot.chassis_mass == pytest.approx(8 * 0.28)


def test_a_product_keeps_its_figures_in_a_robot_of_any_size():
    """Only a motor that says which scale it is for is scaled."""
    assert ot.Omnitrack(scale=0.5, motor="pololu_1000_hpcb").motor == ot.MOTORS["pololu_1000_hpcb"]
    small = ot.Omnitrack(scale=0.25).motor
    assert small.reflected_inertia == pytest.approx(0.0088 / 1024)
    assert ot.Omnitrack(scale=0.25, motor=small).motor == small


def test_a_named_motor_is_for_scale_one_even_in_a_scaled_robot():
    """Naming the ideal motor again in a small robot gives the small robot's motor."""
    small = _run_of(0.625)
    assert ot.override(small, {"robot.motor": "simulation"}).robot == small.robot


def test_every_unit_of_robot_and_motor_is_known_to_the_law():
    """No field can be added with a unit that does not scale."""
    for model in (ot.Omnitrack, ot.Motor):
        for name in model.model_fields:
            assert math.isfinite(froude_exponent(quantity_of(model, name).unit))


def _run_of(s: float, bend: bool = False) -> ot.Scenario:
    """A vertical climb, or a turn in an elbow of 1.5 D, with everything that has a unit scaled.

    The speeds of ``equal`` do not depend on how the robot lies, so that only the robot and its
    motors are compared.
    """
    bore, root = 0.16 * s, math.sqrt(s)
    pipe = {"kind": "straight", "inner_diameter": bore}
    elbow = {"kind": "elbow", "inner_diameter": bore, "mean_radius": 0.24 * s}
    before, behind = pipe | {"length": 0.3 * s}, pipe | {"length": 0.4 * s}
    return validate(
        {
            "pipes": [before, elbow, behind] if bend else [pipe | {"length": 0.7 * s}],
            "robot": {"scale": s},
            "start": {"distance": 0.12 * s, "theta5_deg": 40.0},
            "run": {"goal_distance": 0.8 * s if bend else 0.5 * s},
            "control": {
                "kind": "equal",
                "align": False,
                "retry": False,
                "cruise_speed": 0.1 * root,
                "speed_limit": 0.2 * root,
            },
            "physics": {
                "timestep": 0.002 * root,
                "control_period": 0.01 * root,
                "collider": "exact" if bend else "primitives",
                "wall_tolerance": 1e-4 * s,
            },
            "record": {"period": 0.02 * root},
        }
    )


def _without_dimension(result: ot.Result) -> np.ndarray:
    """(T, 5): tilt, theta5, distance over D and speed over sqrt(g D), load of the motors over their
    limit, against time over sqrt(s)."""
    trajectory, robot = result.trajectory, result.scenario.robot
    bore = 2 * robot.nominal_pipe_radius
    speed = trajectory["belt_speed"].mean(axis=1) / math.sqrt(9.81 * bore)
    load = trajectory["motor_torque"].mean(axis=1) / robot.motor.torque_limit
    columns = (trajectory["tilt"], trajectory["theta5"], trajectory["distance"] / bore, speed, load)
    return np.stack(columns, axis=-1)


def test_robots_of_three_sizes_climb_alike():
    """Up a vertical pipe of 100, 160 and 300 mm the dimensionless trajectories agree to 1e-9.

    They start with the rounding of the inputs, 1e-16, and a steady climb does not make it grow.
    """
    one, *others = (_without_dimension(ot.run(_run_of(s), no_load=False)) for s in (1.0, *SCALES))
    for other in others:
        assert other == pytest.approx(one, abs=1e-9)


def test_robots_of_three_sizes_turn_alike():
    """Through an elbow of 1.5 D, where modules at one speed tilt the robot by 43 degrees and turn
    theta5 by 66, tilt and theta5 (rad) and distance over D agree to 2e-3.

    The true surfaces are similar, boxes in their place are not quite. A solver that stops at a
    tolerance, and lugs that touch or leave a step earlier, make rounding grow: to 4e-8 in
    the first half and to 8e-4 in all here.
    """
    results = [ot.run(_run_of(s, bend=True), no_load=False) for s in (1.0, *SCALES)]
    one, *others = (_without_dimension(result)[:, :3] for result in results)
    assert np.degrees(one[:, 0].max()) > 20
    for other in others:
        half = len(one) // 2
        assert other[:half] == pytest.approx(one[:half], abs=1e-6)
        assert other == pytest.approx(one, abs=2e-3)


def _turn_of(s: float) -> ot.Scenario:
    """A tee turn from askew, with all scaled that docs/explanation/physics.md lists."""
    root, bore = math.sqrt(s), {"inner_diameter": 0.16 * s}
    straight = {"kind": "straight", "length": 0.4 * s, **bore}
    return validate(
        {
            "pipes": [straight, {"kind": "tee", **bore}, straight],
            "robot": {"scale": s},
            "start": {"distance": 0.12 * s, "theta5_deg": 50.0},
            "world": {"gravity": [3.0, -5.0, -7.0]},
            "control": {"cruise_speed": 0.1 * root, "speed_limit": 0.2 * root},
            "physics": {"timestep": 0.002 * root, "control_period": 0.01 * root},
            "record": {"period": 0.02 * root},
        }
    )


@cache
def _turned(s: float) -> ot.Result:
    """A robot of that size, turned into a branch."""
    return ot.run(_turn_of(s), no_load=False)


@pytest.mark.parametrize("s", [0.625, 1.875, 3.0])
def test_robots_of_four_sizes_turn_into_a_branch_alike(s: float) -> None:
    """They take similar arcs, roll by the same angle, and go the same way in the same time over the
    root of the scale until they are far into the turn."""
    one, other = _turn_of(1.0), _turn_of(s)
    bends = [scenario.route.passages[1].bend_radius for scenario in (one, other)]
    assert bends[1] == pytest.approx(s * bends[0])
    small, large = _turned(1.0), _turned(s)
    assert small.success
    assert large.success
    assert large.duration_s == pytest.approx(math.sqrt(s) * small.duration_s, rel=0.02)
    shapes = [_without_dimension(result)[:, :3] for result in (small, large)]
    into = shapes[0][:, 2] < 0.55 / 0.16  # the arc begins at 0.47 m
    count = int(into.sum())
    assert shapes[1][:count] == pytest.approx(shapes[0][:count], abs=1e-3)


@pytest.mark.parametrize("key", ["tee_turn_radius", "tee_merge_radius"])
def test_a_radius_round_a_corner_is_for_160_mm(key: str) -> None:
    """In a file it is that of the standard robot's pipe, whatever the size of the robot."""
    changed = ot.override(_turn_of(3.0), {f"control.{key}": 0.1})
    turn, merge = changed.arcs
    assert (turn, merge) == pytest.approx((0.3, 0.42) if "turn" in key else (0.27, 0.3))
