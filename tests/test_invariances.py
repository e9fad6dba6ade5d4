"""What stays the same when the world is turned, all is twice as large, or the robot is turned by
120 degrees or seen in a mirror."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, frame_along, rotation_about
from omnitrack_sim.pipes import Cross, Elbow, Mitre, Reducer, Step, Straight, Tee, Wye, route
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.robots.omnitrack import kinematics, singularity

LAW = settings(derandomize=True, database=None, deadline=None, max_examples=20)
"""The same examples every time."""
LENGTHS = (
    "inner_diameter",
    "end_diameter",
    "branch_diameter",
    "length",
    "run_length",
    "branch_length",
    "leg_length",
    "mean_radius",
    "fillet_radius",
)
FITTINGS = {
    "straight": Straight(0.4),
    "elbow": Elbow(0.24),
    "sharp elbow": Elbow(0.12, math.radians(130)),
    "reducer": Reducer(0.15, 0.12),
    "tee": Tee(),
    "wye": Wye(angle=math.radians(50), branch_diameter=0.12),
    "cross": Cross(angle=math.radians(70)),
    "mitre": Mitre(angle=math.radians(60)),
}
STEPS = (
    Step("a", Straight(0.5), "start", "end"),
    Step("b", Elbow(0.24), "start", "end", 0.3),
    Step("c", Tee(), "run_start", "branch", 1.1),
    Step("d", Straight(0.4), "start", "end"),
    Step("e", Mitre(angle=math.radians(40)), "start", "end", -0.7),
    Step("f", Wye(angle=math.radians(50)), "branch", "run_end", 0.4),
)
MODULES = st.floats(-7, 7)


def directions():
    """Vectors whose direction is well defined."""
    vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
    return vectors.filter(lambda v: np.linalg.norm(v) > 1e-2)


def frames():
    """Frames anywhere."""
    places = st.tuples(*[st.floats(-20, 20)] * 3).map(np.array)
    return st.builds(
        lambda z, turn, place: Pose(frame_along(z, turn), place),
        directions(),
        st.floats(-7, 7),
        places,
    )


def scaled(fitting, factor):
    """A fitting all of whose lengths are multiplied."""
    keys = {k: v * factor if k in LENGTHS else v for k, v in fitting.to_table().items()}
    kind = fitting_class(keys.pop("kind"))
    return kind.from_table(kind.Table.model_validate(keys))


def points_in(fitting, count=300):
    """Points (count, 3) m in and around a fitting."""
    low, high = fitting.bounds
    rng = np.random.default_rng(2)
    return rng.uniform(low - 0.02, high + 0.02, (count, 3))


@LAW
@given(st.sampled_from(list(FITTINGS)), st.floats(0.2, 8))
def test_a_fitting_twice_as_large_is_the_same_twice_as_large(name, factor):
    """Distances, extents, bounds, ports and axes grow with it, and no direction changes."""
    one, other = FITTINGS[name], scaled(FITTINGS[name], factor)
    points = points_in(one)
    (d, gradient), (large, same) = (
        one.signed_distance(points),
        other.signed_distance(factor * points),
    )
    np.testing.assert_allclose(large, factor * d, atol=1e-9 * factor)
    away = np.abs(d) < 0.9 * one.radius  # on an axis there is no one direction
    np.testing.assert_allclose(same[away], gradient[away], atol=1e-5)
    np.testing.assert_allclose(
        other.extent(factor * points), factor * one.extent(points), atol=1e-9 * factor
    )
    np.testing.assert_allclose(other.bounds, factor * np.array(one.bounds), atol=1e-9 * factor)
    assert other.length_of_axes == pytest.approx(factor * one.length_of_axes)
    for port, pose in one.ports.items():
        np.testing.assert_allclose(other.ports[port].rotation, pose.rotation, atol=1e-12)
        np.testing.assert_allclose(other.ports[port].position, factor * pose.position, atol=1e-9)
        assert other.port_radius(port) == pytest.approx(factor * one.port_radius(port))


@settings(LAW, max_examples=5)
@given(frames(), st.floats(0.3, 4))
def test_a_route_is_the_same_anywhere_and_of_any_size(frame, factor):
    """Turned and moved, and larger: arc lengths grow, points, frames and curvatures go along, what
    is located is where it was, and the walls are as far from every point."""
    there = route(STEPS, frame)
    one = route(STEPS)
    assert there.length == pytest.approx(one.length, rel=1e-12)
    s = np.linspace(-0.1, one.length + 0.1, 90)
    line, other = one.centreline, there.centreline
    np.testing.assert_allclose(other.at(s)[0], frame.apply(line.at(s)[0]), atol=1e-10)
    np.testing.assert_allclose(other.at(s)[1], line.at(s)[1] @ frame.rotation.T, atol=1e-10)
    np.testing.assert_allclose(
        other.frame(s), np.einsum("ij,sjk->sik", frame.rotation, line.frame(s)), atol=1e-10
    )
    inner = s[(s > 0.01) & (s < one.length - 0.01)]
    np.testing.assert_allclose(other.locate(other.at(inner)[0], inner + 0.03), inner, atol=1e-9)
    points = line.at(inner)[0] + np.random.default_rng(4).uniform(-0.1, 0.1, (len(inner), 3))
    d, gradient = one.network.signed_distance(points)
    moved, turned = there.network.signed_distance(frame.apply(points))
    np.testing.assert_allclose(moved, d, atol=1e-10)
    np.testing.assert_allclose(turned, gradient @ frame.rotation.T, atol=1e-6)
    large = route([_step_scaled(step, factor) for step in STEPS], Pose())
    for i, step in enumerate(STEPS):
        # Round a corner a robot of one size drives arcs of its own.
        if isinstance(step.fitting, Straight | Elbow):
            assert large.passages[i].length == pytest.approx(factor * one.passages[i].length)
    bigger, _ = large.network.signed_distance(factor * points)
    np.testing.assert_allclose(bigger, factor * d, atol=1e-9 * factor)


def _step_scaled(step, factor):
    """A step with a larger fitting."""
    return Step(step.name, scaled(step.fitting, factor), step.enter, step.leave, step.turn)


@settings(LAW, max_examples=4)
@given(frames())
def test_rays_and_depths_turn_with_the_world(frame):
    """Rays from within meet the wall as far away, at the same slant, wherever the pipes lie."""
    one, there = route(STEPS), route(STEPS, frame)
    rng = np.random.default_rng(7)
    s = rng.uniform(0.05, one.length - 0.05, 40)
    origins = one.centreline.at(s)[0]
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    np.testing.assert_allclose(
        met(there, frame.apply(origins), ways @ frame.rotation.T),
        met(one, origins, ways),
        atol=1e-8,
    )


def met(way, origins, directions):
    """Distances (n,) m along rays (n, 3) to the walls of a route."""
    pipes = ot.Pipes(way.network)
    return [pipes.rays(o, d[None])[0] for o, d in zip(origins, directions, strict=True)]


# The robot


@LAW
@given(MODULES, st.floats(0.1, 1), st.floats(0.01, 0.09))
def test_modules_are_alike(theta5, mean_radius, distance):
    """Turned by 120 degrees, each module does what the one before it did; mirrored, modules 2 and
    3 change places; what is singular is so in three orientations."""
    third = 2 * math.pi / 3
    radii = kinematics.elbow_radii(theta5, mean_radius, distance)
    after = kinematics.elbow_radii(theta5 + third, mean_radius, distance)
    np.testing.assert_allclose(after, np.roll(radii, -1), atol=1e-12)
    mirrored = kinematics.elbow_radii(-theta5, mean_radius, distance)
    np.testing.assert_allclose(mirrored, radii[[0, 2, 1]], atol=1e-12)
    twice = kinematics.elbow_radii(theta5, 2 * mean_radius, 2 * distance)
    np.testing.assert_allclose(twice, 2 * radii, rtol=1e-12)
    speeds = kinematics.elbow_speeds(0.1, theta5, mean_radius, distance)
    np.testing.assert_allclose(
        speeds, kinematics.elbow_speeds(0.1, theta5, 2 * mean_radius, 2 * distance), atol=1e-12
    )
    sector = math.radians(96.54)
    assert singularity.is_singular(theta5, sector) == singularity.is_singular(-theta5, sector)
    # An orientation at the very edge may be rounded to either side.
    edge = (abs(theta5) % third) - sector / 2
    if abs(edge) > 1e-6 and abs(edge - (third - sector)) > 1e-6:
        assert singularity.is_singular(theta5, sector) == singularity.is_singular(
            theta5 + third, sector
        )


@LAW
@given(st.tuples(*[st.floats(-1, 1)] * 4), st.floats(0.01, 0.05), st.floats(0.02, 0.1))
def test_velocities_turn_with_the_modules_and_grow_with_the_robot(shafts, radius, lever):
    """With the speeds of the modules handed on to the next, the rotation is turned by 120 degrees
    and the forward speed stays; a robot twice as large turns half as fast at the same belt
    speeds."""
    speeds, spin = np.array(shafts[:3]), shafts[3]
    omega = kinematics.angular_velocity(speeds, spin, lever)
    turn = rotation_about([0.0, 0.0, 1.0], 2 * math.pi / 3)
    handed_on = kinematics.angular_velocity(np.roll(speeds, 1), spin, lever)
    np.testing.assert_allclose(handed_on, turn @ omega, atol=1e-9)
    large = kinematics.angular_velocity(speeds, spin, 2 * lever)
    np.testing.assert_allclose(large[:2], omega[:2] / 2, atol=1e-9)
    assert kinematics.forward_speed(np.roll(speeds, 1)) == pytest.approx(
        kinematics.forward_speed(speeds), abs=1e-15
    )


def driven(changes):
    """Half a second of a robot that enters a tee, in a world that is changed."""
    base = {"run.time_limit": 3.2, "run.expected_outcome": None, "record.period": 0.1}
    return ot.run(ot.override(ot.load_scenario("tee_turn"), {**base, **changes})).trajectory


def test_a_robot_drives_alike_in_a_world_that_is_turned():
    """With pipes and gravity turned alike it is at each time as far, commands and slips alike; with
    the pipes alone turned it is not."""
    plain = driven({})
    axis, turn = [0.3, -0.5, 0.8], math.radians(33)
    gravity = frame_along(axis, turn) @ [0, 0, -9.81]
    turned = {"start.axis": axis, "start.turn_deg": 33.0}
    alike = driven({**turned, "world.gravity": gravity.tolist()})
    for name in ("distance", "belt_speed", "roll", "theta5"):
        np.testing.assert_allclose(alike[name], plain[name], atol=2e-4, err_msg=name)
    other = driven(turned)
    assert np.abs(other["motor_torque"] - plain["motor_torque"]).max() > 0.02
