"""Robots whose physics MuJoCo Warp steps, on its CPU back end, against those of MuJoCo."""

import numpy as np
import pytest

pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")

import warp as wp

import omnitrack_sim as ot
import omnitrack_sim.warp
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.warp import plant

pytestmark = pytest.mark.device
wp.config.quiet = True
STEPS = 100
"""Control steps of an open-loop run, a second."""
TOLERANCES = {
    "position": 3e-5,
    "quaternion": 3e-4,
    "slide": 3e-5,
    "pitch": 1e-3,
    "roll": 1e-4,
    "belt_speed": 1e-3,
    "motor_torque": 2e-3,
    "normal_force": 0.1,
    "traction": 0.3,
    "contact_position": 5e-4,
    "slip_velocity": 1e-3,
}
"""Largest differences of readings after a second, in their units: m, rad, m/s, N m, N."""
WORLD = {"world.gravity": (-9.81, 0.0, 0.0)}


def simulations(scenarios):
    """The same robots on the processor and on the device."""
    made = (None, ot.warp.make_plant)
    return [ot.Simulation(scenarios, recording=False, make_plant=make) for make in made]


def drive(simulation, steps, first=0):
    """Drive robots without feedback: belts at speeds of their own, modules that roll to and fro."""
    when = 0.01 * np.arange(first + 1, first + 1 + steps)
    for t in when:
        start = simulation.setup.command
        wave = np.sin(4.0 * t) * np.ones((simulation.n, 3))
        speeds = np.array([0.1, 0.07, 0.085]) + 0.02 * wave
        simulation.step(start._replace(belt_speed=speeds, roll=start.roll + 0.3 * wave))


def test_walls_of_primitives_are_refused():
    """The error names the key."""
    scenario = ot.override(ot.load_scenario("straight"), {"physics.collider": "primitives"})
    with pytest.raises(InputError, match=r"physics\.collider"):
        ot.Simulation([scenario], make_plant=ot.warp.make_plant)


@pytest.mark.long
def test_a_second_without_feedback_is_that_of_mujoco():
    """In an elbow 30 m from the origin, and at the begin of the pipe: poses, forces, tracks.

    The commands are those by which the processor's robots are steered.
    """
    kinds = ("straight", "elbow", "straight")
    pipes = [{"kind": kind} for kind in kinds]
    pipes[0]["length"], pipes[1]["mean_radius"], pipes[2]["length"] = 30.0, 0.24, 0.3
    near = ot.load_scenario("elbow", {"pipes": pipes, "world.friction": 0.7, **WORLD})
    inside = {"start.distance": 29.95, "start.theta5_deg": 60.0, "robot.preload": 22.0}
    one, other = simulations([near, ot.override(near, inside)])
    for _ in range(STEPS):
        command = one.controller.step(one.observation)
        one.step(command)
        other.step(command)
    assert one.location.tilt[1] > 0.08
    assert np.abs(one.location.tilt - other.location.tilt).max() < 3e-4
    expected, found = one.readings, other.readings
    for name, most in TOLERANCES.items():
        assert np.abs(expected[name] - found[name]).max() < most, name
    assert found["time"] == pytest.approx(expected["time"], abs=1e-12)


@pytest.mark.long
def test_a_robot_that_begins_anew_is_a_fresh_one():
    """To the same bytes, while the other drives on."""
    base = ot.load_scenario("straight", WORLD)
    other = ot.override(base, {"start.theta5_deg": 75.0, "robot.preload": 21.0})
    _, simulation = simulations([base, base])
    drive(simulation, 6)
    simulation.reset([1], [other])
    drive(simulation, 8, first=0)
    _, fresh = simulations([other, other])
    drive(fresh, 8)
    assert (simulation.plant.qpos[1] == fresh.plant.qpos[1]).all()
    assert (simulation.plant.qpos[0] != fresh.plant.qpos[0]).any()
    for name in ("normal_force", "motor_torque", "time"):
        assert (simulation.readings[name][1] == fresh.readings[name][1]).all(), name


@pytest.mark.long
def test_a_robot_whose_run_is_over_stays_as_it_is():
    """The others drive on."""
    base = ot.load_scenario("straight", WORLD)
    _, simulation = simulations([ot.override(base, {"run.time_limit": 0.02}), base])
    drive(simulation, 2)
    assert simulation.active.tolist() == [False, True]
    before = simulation.plant.qpos.copy()
    drive(simulation, 3, first=2)
    assert (simulation.plant.qpos[0] == before[0]).all()
    assert (simulation.plant.qpos[1] != before[1]).any()


@pytest.mark.long
def test_another_robot_is_seated_and_driven_as_on_the_processor():
    """A presser, whose arms come to rest in steps of the physics: within 1 um after 0.1 s."""
    one, other = simulations([ot.load_scenario("robots/presser_tee")])
    for _ in range(10):
        command = one.controller.step(one.observation)
        one.step(command)
        other.step(command)
    expected, found = one.readings, other.readings
    assert expected["wall_force"].max() > 10.0
    assert np.abs(expected["position"] - found["position"]).max() < 1e-6
    assert np.abs(expected["wall_force"] - found["wall_force"]).max() < 0.01


@pytest.mark.long
@pytest.mark.parametrize("room", ["CONTACTS", "ROWS"])
def test_contacts_that_find_no_room_are_an_error(room, monkeypatch):
    """They would be left out."""
    monkeypatch.setattr(plant, room, 4)
    _, simulation = simulations([ot.load_scenario("straight", WORLD)])
    with pytest.raises(RuntimeError, match="contacts"):
        drive(simulation, 1)
