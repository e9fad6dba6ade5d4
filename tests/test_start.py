"""A run starts with springs and wall in equilibrium, and normal forces are sums over contacts."""

import mujoco
import numpy as np
import pytest

from omnitrack_sim import Outcome, Simulation, load_scenario, override, run, run_batch

PRELOADS = (5.0, 25.0, 100.0, 1000.0)


@pytest.mark.parametrize("collider", ["primitives", "exact"])
def test_arms_start_in_equilibrium(collider):
    """From the first sample on, the wall carries each module's spring force within 1 %, and no arm
    moves by more than 10 um, whether it is pressed with 5 or with 1000 N."""
    climb = override(
        load_scenario("vertical_climb"),
        {"physics.collider": collider, "run.time_limit": 0.2, "record.period": 0.01},
    )
    for preload, result in zip(
        PRELOADS, run_batch([override(climb, {"robot.preload": p}) for p in PRELOADS]), strict=True
    ):
        force, slide = result.trajectory["normal_force"], result.trajectory["slide"]
        spring = preload - climb.robot.module_stiffness * slide
        assert force == pytest.approx(spring, rel=0.01)
        assert np.ptp(slide, axis=0).max() < 1e-5


@pytest.mark.parametrize("collider", ["primitives", "exact"])
def test_a_falling_robot_starts_on_the_wall_too(collider):
    """In a level pipe the lowest module carries from the start, though its springs do not: the
    chassis still falls."""
    level = override(
        load_scenario("straight"), {"physics.collider": collider, "run.time_limit": 0.1}
    )
    force = run(level).trajectory["normal_force"]
    assert (force[0] > 0.9 * level.robot.preload).all()


def test_a_hard_pressed_robot_stays_in_its_pipe():
    """With 1000 N a module, exact walls hold the robot: it drives on."""
    hard = override(load_scenario("straight"), {"robot.preload": 1000.0})
    assert run(hard).outcome is Outcome.REACHED_GOAL


def test_normal_force_adds_up_the_contacts():
    """The touch sensors read the sum of the normal forces of a track's contacts, in a robot that is
    pressed and slides sideways on a sticky wall."""
    model = override(load_scenario("tee_turn"), {"world.friction": 5.0}).to_spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = Simulation([load_scenario("tee_turn")]).data(0).qpos
    data.joint("robot").qpos[:2] += 0.002  # into the wall, off the axis
    data.joint("robot").qvel[:2] = 0.05, -0.03
    mujoco.mj_forward(model, data)
    sums, force = np.zeros(model.nbody), np.zeros(6)
    for number, contact in enumerate(data.contact):
        mujoco.mj_contactForce(model, data, number, force)
        sums[model.geom_bodyid[contact.geom]] += force[0]
    tracks = [f"{side}_{i}" for side in ("upper", "lower") for i in (1, 2, 3)]
    expected = [sums[model.body(f"track_{track}").id] for track in tracks]
    assert max(expected) > 10.0
    assert [data.sensor(f"touch_{track}").data[0] for track in tracks] == pytest.approx(expected)


@pytest.mark.parametrize("collider", ["primitives", "exact"])
def test_walls_never_pull(collider):
    """On a wall with a friction of 5, where friction along an arm exceeds the normal force, no
    normal force is negative."""
    sticky = override(
        load_scenario("elbow_short"),
        {"physics.collider": collider, "world.friction": 5.0, "run.time_limit": 4.0},
    )
    force = run(sticky).trajectory["normal_force"]
    assert force.min() >= 0.0
    assert force.max() > 50.0
