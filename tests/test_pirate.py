"""PIRATE: its clamps' forces, the shape that its controller asks for, and the branch it takes."""

import math

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.paper.robots.pirate import clamp_forces
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.pirate import SIDES, Pirate, bending, chain
from omnitrack_sim.robots.scene import initial_state


@pytest.mark.parametrize("bore", [0.051, 0.1, 0.12])
def test_it_touches_both_walls_of_its_bore(bore):
    """All six tyres end at the wall, and the angles of its joints are those between its nodes."""
    robot = Pirate(bore=bore)
    data = initial_state(robot)
    nodes = np.array([data.body(f"wheel_{k}").xpos for k in range(6)])
    np.testing.assert_allclose(nodes[:, 0], SIDES * robot.reach, atol=1e-9)
    edge = math.hypot(robot.reach + robot.wheel_radius, robot.wheel_width / 2)
    assert edge == pytest.approx(bore / 2, rel=1e-3)
    lengths = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    np.testing.assert_allclose(lengths, robot.link)
    np.testing.assert_allclose(bending(nodes[None])[0], robot.bends(robot.slope), atol=1e-9)


@pytest.mark.parametrize(("name", "within"), [("pirate_elbow", 0.2e-3), ("pirate_tee", 1.25e-3)])
def test_links_of_the_wanted_shape_have_their_length(name, within):
    """All along a route, within a millimetre or so; at the walls nodes are at the reach."""
    scenario = ot.load_scenario(f"robots/{name}")
    robot, routes = scenario.robot, RouteMap([scenario.route])
    s = np.linspace(0.25, routes.lengths[0] - 0.25, 200)
    zero = np.zeros(len(s), int)
    line = routes.centreline
    place = routes.locate(line.at(s, zero)[0], line.frame(s, zero), zero, s)
    nodes, ratios = chain(robot, routes, place)
    lengths = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
    # Between the two V's the middle link is as long as the way there lets it be.
    assert np.abs(lengths[:, [0, 1, 3, 4]] - robot.link).max() < within
    first = line.at(s[:1], zero[:1])[0][0]
    np.testing.assert_allclose(nodes[0, :, 0] - first[0], SIDES * robot.reach, atol=1e-9)
    np.testing.assert_allclose(ratios[0], 1.0)


def test_a_clamp_at_rest_presses_as_torque_over_lever():
    """Walls bear N = T / (L cos a) at the ends of a V, and 2 N at its apex, without friction."""
    robot = Pirate(bore=0.08)
    single = robot.clamp_torque / (robot.link * math.cos(robot.slope))
    forces = clamp_forces(robot, 1e-12)
    np.testing.assert_allclose(forces[1:], single * np.array([1, 2, 1, 1, 2, 1]))
    assert forces[0] == pytest.approx(robot.pull(1e-12))
    changes = {"robot.bore": 0.08, "world.gravity": [0, 0, 0], "run.time_limit": 1.0}
    pipes = [{"kind": "straight", "length": 1.0, "inner_diameter": 0.08}]
    base = ot.load_scenario("robots/pirate_elbow", {"run.expected_outcome": None})
    run = ot.run(ot.override(base, {"pipes": pipes, **changes}))
    force = run.trajectory["wall_force"][run.trajectory.time > 0.5].mean(axis=0)
    assert force.sum() == pytest.approx(8 * single, rel=0.02)


def test_traction_takes_from_the_clamp_ahead():
    """Of the wheels at the noses of the two V's the front one presses less, the more friction there
    is; the sum of all tractions is the pull."""
    robot = Pirate(bore=0.06)
    noses = [clamp_forces(robot, mu)[6] for mu in (0.0, 0.4, 0.8)]
    assert noses == sorted(noses, reverse=True)
    forces = clamp_forces(robot, 0.8)
    assert forces[0] == pytest.approx(0.8 * forces[1:].sum())
    assert (SIDES * forces[1:]).sum() == pytest.approx(0.0, abs=1e-9)


def test_bores_beyond_the_published_ones_are_refused():
    """It is for 51 to 120 mm, ends included."""
    assert not Pirate().misfit(0.051)
    assert not Pirate().misfit(0.12)
    assert "bores from" in Pirate().misfit(0.05)


def test_its_model_names_all_that_can_be_driven():
    """Actuators stand in the order of the inputs."""
    model = Pirate().spec().compile()
    names = [model.actuator(i).name for i in range(model.nu)]
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, f"bend_{k}") for k in range(1, 5)]
    robot = Pirate()
    bends = np.array([[0.1, 0.2, 0.3, 0.4]])
    inputs = robot.inputs(bends, np.array([0.5]), np.zeros((1, 6)), np.array([[1.0, 0.5]]))[0]
    press = robot.clamp_torque / robot.joint_stiffness
    np.testing.assert_allclose(inputs[ids], bends[0] + [press, 0, 0, -press / 2])
    assert inputs[names.index("roll")] == 0.5
    wheels = robot.inputs(bends, np.zeros(1), np.arange(1.0, 7.0)[None], np.ones((1, 2)))[0]
    for k in range(6):
        turn = SIDES[k] * (k + 1) / robot.wheel_radius
        assert wheels[names.index(f"wheel_{k}")] == pytest.approx(turn)


def test_it_turns_into_the_plane_of_a_bend():
    """From 90 degrees beside it, upwards, without sliding back."""
    changes = {"start.theta5_deg": 90.0, "run.time_limit": 6.0, "run.expected_outcome": None}
    trajectory = ot.run(ot.load_scenario("robots/pirate_elbow", changes)).trajectory
    settled = trajectory.time > 5.0
    assert np.abs(np.degrees(trajectory["theta5"][settled])).max() < 15
    assert trajectory["distance"].min() > trajectory["distance"][0] - 0.005
