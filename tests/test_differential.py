"""The 1-input 3-output differential: its gears, the mechanism alone, and the robot with it."""

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.errors import OutputError, ScenarioError
from omnitrack_sim.robots.omnitrack.body import add_belt_motors, belt_inertia
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.show.film.render import render_frame

LOADS = np.array([-6.0, -2.0, 1.0])
"""N, that pull at the three outputs."""


def _mechanism(**robot) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Motor and gears alone, with a mass of 5 kg at each output, as MuJoCo steps them."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep = [0, 0, 0], 1e-3
    for i in (1, 2, 3):
        body = spec.worldbody.add_body(mass=5.0, inertia=[1.0] * 3, explicitinertial=True)
        body.add_joint(name=f"belt_upper_{i}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    add_belt_motors(spec, ot.Omnitrack(drive="differential", **robot))
    model = spec.compile()
    return model, mujoco.MjData(model)


def _driven(model, data, loads, steps=400):
    """Let the motor turn at 0.1 m/s against loads (3,) N; velocities at begin and end."""
    data.ctrl[:] = 0.1
    data.qfrc_applied[:3] = loads
    before = data.qvel[:3].copy()
    mujoco.mj_step(model, data, steps)
    return before, data.qvel[:3].copy()


@pytest.mark.parametrize("loads", [np.zeros(3), LOADS])
def test_output_speeds_add_up_to_three_times_the_input(loads):
    """With and without load: the tendon of the motor moves with the mean of the outputs."""
    model, data = _mechanism()
    _driven(model, data, loads)
    mujoco.mj_forward(model, data)
    assert data.qvel[:3].sum() == pytest.approx(3 * data.joint("shaft_1").qvel[0], rel=0.01)
    assert np.ptp(data.qvel[:3]) > 0.1 or not loads.any()


@pytest.mark.parametrize("loads", [np.zeros(3), LOADS])
def test_outputs_are_given_equal_forces(loads):
    """By the momentum that each mass gains in 0.05 s: force of the gears plus load, within 1 %."""
    model, data = _mechanism()
    _driven(model, data, loads, steps=20)
    before, after = _driven(model, data, loads, steps=50)
    gears = 5.0 * (after - before) / 0.05 - loads
    assert gears == pytest.approx(np.full(3, gears.mean()), rel=0.01)
    assert gears.mean() > 1.0


@pytest.mark.parametrize("friction", [0.0, 2.0])
def test_power_in_is_power_out_and_friction_loss(friction):
    """Over 0.4 s the work of motor and loads is what the masses, the rotor and the friction
    took, within 1 %."""
    model, data = _mechanism(gear_friction=0.1)
    data.ctrl[:], data.qfrc_applied[:3] = 0.1, LOADS
    rubbing = [model.tendon(f"gear_{i}").id for i in (1, 2, 3)]
    model.tendon_frictionloss[rubbing] = friction
    rotor, work, lost = 3 * belt_inertia(ot.Omnitrack()), 0.0, 0.0
    for _ in range(400):
        before = data.qvel[:3].copy()
        mujoco.mj_step(model, data)
        speed = (before + data.qvel[:3]) / 2
        work += 1e-3 * (data.actuator_force[0] * speed.mean() + LOADS @ speed)
        lost += 1e-3 * friction * np.abs(speed - speed.mean()).sum()
    kept = 2.5 * (data.qvel[:3] ** 2).sum() + rotor / 2 * data.qvel[3] ** 2
    assert work == pytest.approx(kept + lost, rel=0.01)
    assert (lost > 0.05 * work) == (friction > 0)


def test_the_robot_s_friction_follows_the_force_that_is_passed_on():
    """In a climb with gear friction the tendons rub with that part of a belt's force."""
    change = {"robot.drive": "differential", "robot.gear_friction": 0.2, "run.time_limit": 0.5}
    simulation = ot.Simulation([ot.override(ot.load_scenario("vertical_climb"), change)])
    for _ in range(30):
        force = simulation.observation.motor_torque[0] / simulation.plant.robot.lug_radius
        simulation.step()
    loss = simulation.plant._gear_loss[0]
    rubbing = loss[loss > 0]
    assert rubbing == pytest.approx(np.full(3, 0.2 * abs(force[0])))


def test_a_climb_loads_the_modules_equally():
    """Without steering, the three modules of a climbing robot pull alike, within 1 %, and the belts
    share the motor's work."""
    change = {"robot.drive": "differential", "run.time_limit": 2.0, "run.goal_distance": None}
    result = ot.run(ot.override(ot.load_scenario("vertical_climb"), change))
    traction = result.trajectory["traction"][40:].mean(axis=0)
    assert traction == pytest.approx(np.full(3, 9.81 * ot.Omnitrack().mass / 3), rel=0.01)
    torque = result.trajectory["motor_torque"]
    assert np.array_equal(torque, np.repeat(torque[:, :1], 3, axis=1))


def test_in_an_elbow_the_belts_take_the_speeds_that_the_bend_asks_for():
    """The outer belts run faster than the inner one without being asked, and their mean is the
    cruise speed."""
    change = {"robot.drive": "differential", "start.theta5_deg": 0.0, "control.align": False}
    result = ot.run(ot.override(ot.load_scenario("elbow"), change))
    trajectory = result.trajectory
    bend = trajectory["phase"] == trajectory.phases.index("elbow")
    speeds = trajectory["wall_speed"][bend].mean(axis=0)
    assert result.success
    assert speeds[0] < 0.08 < 0.11 < min(speeds[1:])
    assert speeds.mean() == pytest.approx(0.1, rel=0.02)


def test_brakes_hold_a_belt_and_need_to_be_there():
    """A braked module's belt stands still; a robot without brakes cannot be told to brake, but may
    well be told not to."""
    change = {"robot.drive": "differential", "robot.brake_force": 60.0}
    simulation = ot.Simulation([ot.override(ot.load_scenario("straight"), change)])
    brake = np.array([[1.0, 0.0, 0.0]])
    for _ in range(20):
        simulation.step(ot.Command(np.full((1, 3), 0.05), brake=brake))
    assert abs(simulation.observation.belt_speed[0, 0]) < 1e-3
    without = ot.Simulation([ot.load_scenario("straight")])
    without.step(ot.Command(np.zeros((1, 3)), brake=np.zeros((1, 3))))
    assert without.time == pytest.approx(without.period)
    with pytest.raises(ValueError, match=r"brake_force is 0"):
        without.step(ot.Command(np.zeros((1, 3)), brake=brake))


SWAPPED = ot.Drive("swapped", ((0, 1, 0), (1, 0, 0), (0, 0, 1)))
PAIR = ot.Drive("pair", ((1, 0, 0), (0, 0.5, 0.5)), size=1.5)


@pytest.mark.parametrize("name", ["differential", f"{__name__}:PAIR", f"{__name__}:SWAPPED"])
def test_a_run_with_shafts_comes_back_and_is_drawn(name, tmp_path):
    """One, two and three shafts of their own stand in the replay beside the robot's joints; a
    replay of more is refused before it is unpacked, and one of fewer for its shape."""
    change = {"robot.drive": name, "run.time_limit": 0.2}
    result = ot.run(ot.override(ot.load_scenario("straight"), change))
    folder = result.save(tmp_path / "run")
    loaded = ot.load_result(folder)
    qpos = result.trajectory.qpos
    assert qpos.shape[1] == ot.Omnitrack().joint_count + drive_of(name).motors
    assert np.array_equal(loaded.trajectory.qpos, qpos)
    assert render_frame(folder, time=0.1, width=160, height=90).std() > 0
    time = result.trajectory.time
    many, few = np.zeros((len(time), 1000)), qpos[:, :-1]
    for wrong, told in ((many, "not of the same run"), (few, "shape")):
        np.savez(folder / "replay.npz", time=time, qpos=wrong)
        with pytest.raises(OutputError, match=told):
            ot.load_result(folder)


@pytest.mark.parametrize("name", ["three_motors", "differential", f"{__name__}:PAIR"])
def test_a_robot_too_weak_to_climb_is_at_the_limit_of_each_belt(name):
    """With a fifth of the torque that a climb takes every belt is given all that its motors have,
    within 1 %, which the metrics count as at the limit."""
    change = {"robot.drive": name, "robot.motor.torque_limit": 0.02, "run.time_limit": 1.0}
    result = ot.run(ot.override(ot.load_scenario("vertical_climb"), change))
    limits = 0.02 * drive_of(name).strength
    assert result.metrics["motor_torque_max_nm"] == pytest.approx(limits.tolist(), rel=0.01)
    assert min(result.metrics["time_at_limit_s"]) > 0.5 * result.duration_s


def test_controllers_are_told_what_they_can_command():
    """The differential does not steer; three motors do."""
    assert ot.DRIVES["three_motors"].steers
    assert not ot.DRIVES["differential"].steers


def test_a_drive_of_one_s_own_has_a_name_and_needs_independent_motors():
    """Two motors, of which one drives two belts; wrong gears say what is wrong."""
    own = ot.Drive("pair", ((1, 0, 0), (0, 0.5, 0.5)))
    assert own.motors == 2
    assert own.belt_values(np.array([[3.0, 4.0]])).tolist() == [[3.0, 2.0, 2.0]]
    assert own.motor_forces(np.array([[3.0, 2.0, 2.0]])) == pytest.approx(np.array([[3.0, 4.0]]))
    with pytest.raises(ValueError, match="not independent"):
        ot.Drive("twice", ((1, 0, 0), (1, 0, 0)))
    with pytest.raises(ValueError, match="rows of 3 numbers"):
        ot.Drive("short", ((1, 0),))


def test_an_unknown_drive_is_told_with_the_choices():
    """The scenario names the place and what there is."""
    with pytest.raises(ScenarioError, match=r"robot\.drive: is 'diferential'.*three_motors"):
        ot.override(ot.load_scenario("straight"), {"robot.drive": "diferential"})
    assert drive_of("differential").motors == 1
