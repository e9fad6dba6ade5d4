"""Readings of the shipped sensors: on a made-up state whose values are known, and of robots that
drive."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Array, rotation_about
from omnitrack_sim.robots.omnitrack.odometry import TrackOdometry
from omnitrack_sim.robots.omnitrack.sensors import SENSORS, Addresses
from omnitrack_sim.robots.sensor import MAX_UNREAD, State, moments_together, read_together
from omnitrack_sim.senses.draws import keys
from omnitrack_sim.senses.proprioception import Proprioception
from omnitrack_sim.senses.settings import ImuTable, SensingTable

THREE = np.arange(3)
CONTACT = np.arange(84).reshape(3, 4, 7)
TOUCH = 84 + np.arange(12).reshape(3, 4)
AT = Addresses(
    slide=7 + THREE,
    pitch=10 + THREE,
    roll=13 + THREE,
    belts=16 + np.arange(6).reshape(3, 2),
    sprockets=22 + np.arange(6).reshape(3, 2),
    slide_dofs=6 + THREE,
    pitch_dofs=9 + THREE,
    belt_dofs=15 + np.arange(6).reshape(3, 2),
    places=3 + np.arange(9).reshape(3, 3),
    forward=9 + 9 * THREE[:, None] + np.arange(2, 9, 3),
    chassis=THREE,
    frame=np.arange(9).reshape(3, 3).T,
    tracks=np.zeros((3, 2), int),
    contact=CONTACT,
    touch=TOUCH,
    belt_motors=THREE,
    roll_motors=THREE,
    drive=ot.DRIVES["three_motors"],
)
"""Addresses of a state of four bodies: the chassis and its modules."""
READ = {sensor.channel.name: sensor for sensor in SENSORS}
NONE, EYE = np.zeros((3, 4, 3)), np.eye(3)


def state_of(
    before: dict[str, Array] | None = None,
    force: Array = NONE,
    contact: Array = NONE,
    touch: Any = 0.0,
    velocity: Any = 0.0,
    spin: Any = 0.0,
    belts: Any = 0.0,
    roll: Any = 0.0,
    frame: Array = EYE,
) -> State:
    """The state of one robot at the origin, all of whose bodies have the same ``frame``.

    Args:
        before: values of sensors at the moment before.
        force: (3, 4, 3) N that upper and lower track, front and rear sprocket put on the wall.
        contact: (3, 4, 3) m, where.
        touch: (3, 4) N, normal forces.
        velocity: (3,) m/s of the chassis, world frame.
        spin: (3,) rad/s of the chassis, its own frame.
        belts: (3,) m/s of the upper tracks.
        roll: (3,) rad.
        frame: rotation of the bodies.
    """
    sensors, qpos, qvel = np.zeros((1, 96)), np.zeros((1, 28)), np.zeros((1, 27))
    sensors[:, CONTACT[..., 0]] = np.linalg.norm(force, axis=-1) > 0
    sensors[:, CONTACT[..., 1:4]] = force
    sensors[:, CONTACT[..., 4:7]] = contact
    sensors[:, TOUCH] = touch
    qpos[:, AT.roll] = roll
    qvel[:, :3], qvel[:, 3:6], qvel[:, AT.belt_dofs[:, 0]] = velocity, spin, belts
    arrays = {
        "time": np.zeros(1),
        "qpos": qpos,
        "qvel": qvel,
        "sensordata": sensors,
        "actuator_force": np.zeros((1, 6)),
        "xpos": np.zeros((1, 12)),
        "xmat": np.tile(frame.reshape(9), 4)[None],
    }
    before = {"contact_position": np.zeros((1, 3, 3))} if before is None else before
    return State(arrays, AT, ot.Omnitrack(), READ, before)


def on_part(part: int, *vector: float) -> Array:
    """A vector (3, 4, 3) on one part of each module's chain, and nothing on the others."""
    vectors = np.zeros((3, 4, 3))
    vectors[:, part] = vector
    return vectors


@pytest.mark.parametrize("part", range(4), ids=["upper", "lower", "front", "rear"])
def test_forces_count_on_every_part_of_the_chain(part: int) -> None:
    """A module's touch sensors read its normal force, and its push back along its axis is its
    traction, whichever part of its chain it stands on; a sprocket's contact is both tracks'."""
    touch = np.zeros((3, 4))
    touch[:, part] = 20.0
    state = state_of(force=on_part(part, 20.0, 0.0, -3.0), touch=touch)
    count = [[1, 0], [0, 1], [1, 1], [1, 1]][part]
    assert state["contact_count"][0].tolist() == [count] * 3
    assert state["normal_force"][0] == pytest.approx([20.0] * 3)
    assert state["traction"][0] == pytest.approx([3.0] * 3)


def test_forces_are_taken_along_the_module_and_across_it() -> None:
    """Of modules that are turned with the robot the components along their own axes count."""
    turned = rotation_about([0.3, -1.0, 0.5], 1.1)
    force = on_part(0, 20.0, 0.0, -3.0) @ turned.T
    state = state_of(force=force, frame=turned)
    assert state["traction"][0] == pytest.approx([3.0] * 3)


def test_the_centre_of_contact_is_nearer_to_the_stronger_track() -> None:
    """Weighed with the force of each track: with three times the force on the upper one it is a
    quarter of the way from there to the lower one's."""
    force = on_part(0, 15.0, 0.0, 0.0) + on_part(1, 5.0, 0.0, 0.0)
    contact = on_part(0, 0.08, 0.0, 0.04) + on_part(1, 0.08, 0.0, -0.04)
    assert state_of(force=force, contact=contact)["contact_position"][0] == pytest.approx(
        np.tile([0.08, 0.0, 0.02], (3, 1))
    )


def test_a_module_that_has_lost_the_wall_is_where_it_touched_last() -> None:
    """Its contact position stays, as that of the others moves on; its slip is none."""
    before = {"contact_position": np.arange(9.0).reshape(1, 3, 3)}
    force, contact = on_part(0, 10.0, 0.0, 0.0), on_part(0, 0.08, 0.0, 0.5)
    force[1] = contact[1] = 0.0
    state = state_of(before, force=force, contact=contact, belts=np.full(3, 0.1))
    assert state["contact_position"][0, 1].tolist() == [3.0, 4.0, 5.0]
    assert state["contact_position"][0, 2] == pytest.approx([0.08, 0.0, 0.5])
    assert state["slip_velocity"][0] == pytest.approx([0.1, 0.0, 0.1])
    assert state["contact_count"][0, :, 0].tolist() == [1.0, 0.0, 1.0]


def test_moments_read_together_have_the_bits_of_one_after_the_other() -> None:
    """All channels of several moments, also where a module has lost the wall before, at and after
    the moments that are read."""
    simulation = ot.Simulation([ot.load_scenario("tee_turn")] * 2)
    simulation.step()
    chain: list[list[State]] = [[], []]
    for i in range(9):
        simulation.step()
        arrays = {name: values.copy() for name, values in simulation.readings.arrays.items()}
        if i in (0, 2, 3, 6):
            lost = simulation.readings.at.contact[1]
            arrays["sensordata"][i % 2, lost] = 0.0  # of one robot's second module
        for states in chain:
            known = states[-1] if states else {"contact_position": np.ones((2, 3, 3))}
            one = simulation.readings
            states.append(State(arrays, one.at, one.robot, one.sensors, known, one.looks_back))
    one_by_one, together = chain
    read_together(together[1::2], READ)
    for state, alone in zip(together[1::2], one_by_one[1::2], strict=True):
        assert {name: state[name].tobytes() for name in READ} == {
            name: alone[name].tobytes() for name in READ
        }


def test_a_run_keeps_few_moments_in_memory() -> None:
    """Twice as long a run keeps as many states, without Python's search for cycles: in gigabytes of
    arrays it sees a few objects, and comes too late."""
    simulation = ot.Simulation([ot.load_scenario("tee_turn")])
    alive: list[weakref.ref[State]] = []
    counts = []
    gc.disable()
    try:
        for steps in (2 * MAX_UNREAD, 4 * MAX_UNREAD):
            while len(alive) < steps:
                simulation.step()
                alive.append(weakref.ref(simulation.readings))
            counts.append(sum(ref() is not None for ref in alive))
    finally:
        gc.enable()
    assert 1 <= max(counts) <= MAX_UNREAD + moments_together(1) + 1


def test_moments_are_read_together_where_that_is_faster() -> None:
    """Of few robots, and no longer than earlier moments are kept anyway where every second one is
    recorded; of hundreds one by one."""
    assert 8 < moments_together(1) == moments_together(64) < MAX_UNREAD / 2
    assert moments_together(128) == 1


def test_the_speed_of_a_module_is_that_at_the_wall() -> None:
    """A rigid robot that turns in a bend: the speed over the wall is the rate times the distance of
    the contact, not of the module's middle, from the bend's centre."""
    rate, bend, lever = 0.4, 0.24, 0.08  # about the y axis, through (-bend, 0, 0)
    contact = on_part(0, lever, 0.0, 0.0)
    velocity = [0.0, 0.0, rate * bend]
    state = state_of(
        force=on_part(0, 10.0, 0.0, 0.0),
        contact=contact,
        velocity=velocity,
        spin=[0.0, -rate, 0.0],
    )
    assert state["module_speed"][0] == pytest.approx([rate * (bend + lever)] * 3)


@pytest.mark.parametrize(
    ("belt", "module", "slip", "ratio"),
    [
        (0.1, 0.05, 0.05, 0.5),  # the belt runs ahead
        (0.05, 0.1, -0.05, -0.5),  # it is dragged along
        (0.1, -0.1, 0.2, 1.0),  # the robot slides back: cut at 1
        (0.0, 0.1, -0.1, -1.0),  # the belt stands
        (0.0, 0.00095, -0.00095, 0.0),  # at rest, below 1 mm/s
    ],
)
@pytest.mark.parametrize("roll", [0.0, np.pi], ids=["upright", "turned"])
def test_slip_is_the_lead_of_the_belt_over_the_robot(
    belt: float, module: float, slip: float, ratio: float, roll: float
) -> None:
    """Slip velocity is wall speed less module speed, and its ratio is over the larger of the two,
    also of a module that stands on its lower track and whose belt runs the other way."""
    velocity = [0.0, 0.0, module]
    track, sign = (0, 1.0) if roll == 0.0 else (1, -1.0)
    state = state_of(
        force=on_part(track, 10.0, 0.0, 0.0),
        velocity=velocity,
        belts=np.full(3, sign * belt),
        roll=np.full(3, roll),
    )
    assert state["wall_speed"][0] == pytest.approx([belt] * 3)
    assert state["slip_velocity"][0] == pytest.approx([slip] * 3)
    assert state["slip_ratio"][0] == pytest.approx([ratio] * 3)


@pytest.mark.parametrize("period", [0.004, 0.02, 0.1])
def test_noise_of_the_gyro_is_white(period: float) -> None:
    """Over a control step the angle of a robot at rest has the density of the noise times the root
    of the step, so that the angle after a second does not depend on the steps."""
    table = SensingTable(imu=ImuTable(gyro_bias_deg=0.0, gyro_walk_deg=0.0, gyro_noise_deg=0.01))
    n, state = 1, state_of()
    state.qpos[:, 3] = 1.0
    gyro = Proprioception(table, TrackOdometry(ot.Omnitrack()), period, state)
    gyro.reset(np.arange(n), keys(["a"]), np.zeros((n, 3)), [ot.Omnitrack()], state)
    angles = np.array([gyro.read(state).rotation[0] for _ in range(2000)])
    assert angles.std() == pytest.approx(np.radians(0.01) * np.sqrt(period), rel=0.05)
    assert abs(angles.mean()) < 4 * angles.std() / np.sqrt(angles.size)


CLIMB = {"run.time_limit": 1.5, "start.distance": 0.3}


@pytest.fixture(scope="module")
def driven() -> dict[str, ot.Result]:
    """Up a vertical pipe: upright and with the modules turned; and on a wall that is so slippery
    that the robot slides down."""
    base = ot.override(ot.load_scenario("vertical_climb"), CLIMB)
    changes = {"upright": {}, "turned": {"start.roll_deg": 180.0}}
    changes["slippery"] = {"world.friction": 0.1}
    scenarios = [ot.override(base, change) for change in changes.values()]
    return dict(zip(changes, ot.run_batch(scenarios, no_load=False), strict=True))


@pytest.mark.parametrize("name", ["upright", "turned", "slippery"])
def test_slip_is_the_belts_speed_less_the_headway(driven: dict[str, ot.Result], name: str) -> None:
    """While a module touches, its slip velocity is the belt's speed at the wall less the rate at
    which the robot gets on: within 5 %, or 2 mm/s. A robot that slides down has lots of it."""
    trajectory = driven[name].trajectory
    rate = np.gradient(trajectory["distance"], trajectory.time)
    expected = (trajectory["wall_speed"] - rate[:, None])[3:]
    touching = trajectory["contact_count"].sum(axis=-1)[3:] > 0
    assert touching.sum() > 25
    slip = trajectory["slip_velocity"][3:]
    assert slip[touching] == pytest.approx(expected[touching], rel=0.05, abs=0.002)
    assert bool(expected.min() > 0.2) == (name == "slippery")


@pytest.mark.parametrize("name", ["upright", "turned"])
def test_contacts_lie_on_the_wall(driven: dict[str, ot.Result], name: str) -> None:
    """The centre of each module's contact is at the bore's surface, beside the robot, and normal
    forces are those of the springs on either track."""
    trajectory, scenario = driven[name].trajectory, driven[name].scenario
    contact = trajectory["contact_position"][5:]
    distance = scenario.route.network.signed_distance(contact)[0]
    assert np.abs(distance).max() < 1e-3
    ahead = contact[..., 2] - trajectory["position"][5:, None, 2]
    assert np.abs(ahead).max() < scenario.robot.contact_length / 2
    springs = scenario.robot.preload - scenario.robot.module_stiffness * trajectory["slide"][5:]
    assert trajectory["normal_force"][20:].mean(0) == pytest.approx(springs.mean(0), rel=0.05)


def test_speeds_are_those_of_the_geometry_that_friction_acted_in():
    """Speed over the wall is that of MuJoCo's Jacobian before a step times the velocities after
    it, in a turn in which arms slide and pitch."""
    changes = {"physics.control_period": 0.002, "start.distance": 0.24}
    sim = ot.Simulation([ot.load_scenario("tee_turn", changes)] * 2)
    model, seen = sim.model, 0.0
    for step in range(1500):
        before = sim.data(1) if step % 50 == 0 else None
        sim.step()
        if before is None:
            continue
        mujoco.mj_kinematics(model, before)
        mujoco.mj_comPos(model, before)
        velocity, places = sim.data(1).qvel, sim.readings["contact_position"][1]
        for i, found in enumerate(sim.readings["module_speed"][1]):
            jacobian, body = np.zeros((3, model.nv)), model.body(f"module_{i + 1}").id
            mujoco.mj_jac(model, before, jacobian, None, places[i], body)
            forward = before.xmat[body].reshape(3, 3)[:, 2]
            assert found == pytest.approx(forward @ jacobian @ velocity, abs=1e-12)
            pitch = velocity[model.joint(f"pitch_{i + 1}").dofadr[0]]
            seen = max(seen, abs(pitch))
    assert seen > 0.1
