"""What the shipped sensors read, on a made-up state whose values are known, and on robots that
drive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from runs import COLLIDER

import omnitrack_sim as ot
from omnitrack_sim.rotations import Array, rotation_about
from omnitrack_sim.sensing import SENSORS, State
from omnitrack_sim.sensing.sensor import Addresses

THREE = np.arange(3)
MATRICES = 9 * THREE[:, None]
CONTACT = np.arange(42).reshape(3, 2, 7)
VELOCITY, SPIN = 42 + np.arange(9).reshape(3, 3), 51 + np.arange(9).reshape(3, 3)
TOUCH = 60 + np.arange(6).reshape(3, 2)
AT = Addresses(
    slide=THREE,
    pitch=THREE,
    roll=7 + THREE,
    slide_dofs=THREE,
    belt_dofs=np.stack([6 + THREE, 9 + THREE], axis=-1),
    places=np.arange(9).reshape(3, 3),
    forward=MATRICES + np.arange(2, 9, 3),
    tracks=np.zeros((3, 2), int),
    contact=CONTACT,
    touch=TOUCH,
    velocity=VELOCITY,
    spin=SPIN,
    belt_motors=THREE,
    roll_motors=THREE,
)
"""Where a state made by ``made`` has what: the three modules are its only bodies."""
READ = {sensor.channel.name: sensor.read for sensor in SENSORS}


def made(before: dict[str, Array] | None = None, **given: Any) -> State:
    """The state of one robot at rest at the origin, with all axes those of the world.

    Args:
        before: values of sensors at the moment before.
        given: force (3, 2, 3) N that each track puts on the wall, contact (3, 2, 3) m where, touch
            (3, 2) N its normal forces; velocity and spin (3, 3) of the modules, their frames
            (3, 3, 3), belts (3,) m/s, roll (3,) rad.
    """
    sensors, qpos, qvel = np.zeros((1, 66)), np.zeros((1, 20)), np.zeros((1, 20))
    force = np.asarray(given.get("force", np.zeros((3, 2, 3))), float)
    sensors[:, CONTACT[..., 0]] = (np.linalg.norm(force, axis=-1) > 0)[None]
    sensors[:, CONTACT[..., 1:4]] = force
    sensors[:, TOUCH] = given.get("touch", np.zeros((3, 2)))
    sensors[:, CONTACT[..., 4:7]] = given.get("contact", np.zeros((3, 2, 3)))
    sensors[:, VELOCITY] = given.get("velocity", np.zeros((3, 3)))
    sensors[:, SPIN] = given.get("spin", np.zeros((3, 3)))
    qpos[:, AT.roll] = given.get("roll", np.zeros(3))
    qvel[:, AT.belt_dofs[:, 0]] = given.get("belts", np.zeros(3))
    arrays = {
        "time": np.zeros(1),
        "qpos": qpos,
        "qvel": qvel,
        "sensordata": sensors,
        "actuator_force": np.zeros((1, 6)),
        "xpos": np.zeros((1, 9)),
        "xmat": np.asarray(given.get("frames", np.tile(np.eye(3), (3, 1, 1)))).reshape(1, 27),
    }
    before = {"contact_position": np.zeros((1, 3, 3))} if before is None else before
    return State(arrays, AT, ot.Robot(), READ, before)


def on_track(track: int, *vector: float) -> Array:
    """A vector (3, 2, 3) on one track of each module, and nothing on the other."""
    found = np.zeros((3, 2, 3))
    found[:, track] = vector
    return found


@pytest.mark.parametrize("track", [0, 1], ids=["upper", "lower"])
def test_forces_count_on_either_track(track: int) -> None:
    """What a module's touch sensors read is its normal force, and what it pushes back along its
    axis its traction, whichever track it stands on."""
    touch = np.zeros((3, 2))
    touch[:, track] = 20.0
    state = made(force=on_track(track, 20.0, 0.0, -3.0), touch=touch)
    assert state["normal_force"][0] == pytest.approx([20.0] * 3)
    assert state["traction"][0] == pytest.approx([3.0] * 3)


def test_forces_are_taken_along_the_module_and_across_it() -> None:
    """Of modules that are turned with the robot the components along their own axes count."""
    turned = rotation_about([0.3, -1.0, 0.5], 1.1)
    force = on_track(0, 20.0, 0.0, -3.0) @ turned.T
    state = made(force=force, frames=np.tile(turned, (3, 1, 1)))
    assert state["traction"][0] == pytest.approx([3.0] * 3)


def test_the_centre_of_contact_is_nearer_to_the_stronger_track() -> None:
    """Weighed with the force of each track: with three times the force on the upper one it is a
    quarter of the way from there to the lower one's."""
    force = on_track(0, 15.0, 0.0, 0.0) + on_track(1, 5.0, 0.0, 0.0)
    contact = on_track(0, 0.08, 0.0, 0.04) + on_track(1, 0.08, 0.0, -0.04)
    assert made(force=force, contact=contact)["contact_position"][0] == pytest.approx(
        np.tile([0.08, 0.0, 0.02], (3, 1))
    )


def test_a_module_that_has_lost_the_wall_is_where_it_touched_last() -> None:
    """Its contact position stays, as that of the others moves on; its slip is none."""
    before = {"contact_position": np.arange(9.0).reshape(1, 3, 3)}
    force, contact = on_track(0, 10.0, 0.0, 0.0), on_track(0, 0.08, 0.0, 0.5)
    force[1] = contact[1] = 0.0
    state = made(before, force=force, contact=contact, belts=np.full(3, 0.1))
    assert state["contact_position"][0, 1].tolist() == [3.0, 4.0, 5.0]
    assert state["contact_position"][0, 2] == pytest.approx([0.08, 0.0, 0.5])
    assert state["slip_velocity"][0] == pytest.approx([0.1, 0.0, 0.1])
    assert state["contact_count"][0, :, 0].tolist() == [1.0, 0.0, 1.0]


def test_the_speed_of_a_module_is_that_at_the_wall() -> None:
    """A rigid robot that turns in a bend: the speed over the wall is the rate times the distance of
    the contact, not of the module's middle, from the bend's centre."""
    rate, bend, lever = 0.4, 0.24, 0.08  # about the y axis, through (-bend, 0, 0)
    contact = on_track(0, lever, 0.0, 0.0)
    velocity = np.tile([0.0, 0.0, rate * bend], (3, 1))
    state = made(
        force=on_track(0, 10.0, 0.0, 0.0),
        contact=contact,
        velocity=velocity,
        spin=np.tile([0.0, -rate, 0.0], (3, 1)),
    )
    assert state["module_speed"][0] == pytest.approx([rate * (bend + lever)] * 3)


@pytest.mark.parametrize(
    ("belt", "module", "slip", "ratio"),
    [
        (0.1, 0.05, 0.05, 0.5),  # the belt runs ahead
        (0.05, 0.1, -0.05, -0.5),  # it is dragged along
        (0.1, -0.1, 0.2, 1.0),  # the robot slides back: cut at 1
        (0.0, 0.1, -0.1, -1.0),  # the belt stands
        (0.0, 0.0005, -0.0005, 0.0),  # at rest
    ],
)
@pytest.mark.parametrize("roll", [0.0, np.pi], ids=["upright", "turned"])
def test_slip_is_what_the_belt_is_ahead_of_the_robot(
    belt: float, module: float, slip: float, ratio: float, roll: float
) -> None:
    """Slip velocity is wall speed less module speed, and its ratio is over the larger of the two,
    also of a module that stands on its lower track and whose belt runs the other way."""
    velocity = np.tile([0.0, 0.0, module], (3, 1))
    track, sign = (0, 1.0) if roll == 0.0 else (1, -1.0)
    state = made(
        force=on_track(track, 10.0, 0.0, 0.0),
        velocity=velocity,
        belts=np.full(3, sign * belt),
        roll=np.full(3, roll),
    )
    assert state["wall_speed"][0] == pytest.approx([belt] * 3)
    assert state["slip_velocity"][0] == pytest.approx([slip] * 3)
    assert state["slip_ratio"][0] == pytest.approx([ratio] * 3)


CLIMB = {"physics.collider": COLLIDER, "physics.time_limit": 1.5, "start.distance": 0.3}


@pytest.fixture(scope="module")
def driven() -> dict[str, ot.Result]:
    """Up a vertical pipe: upright and with the modules turned; and on a wall that is so slippery
    that the robot slides down."""
    base = ot.override(ot.load_scenario("vertical_climb"), CLIMB)
    changes = {"upright": {}, "turned": {"start.roll_deg": 180.0}}
    changes["slippery"] = {"contact.friction": 0.1}
    scenarios = [ot.override(base, change) for change in changes.values()]
    return dict(zip(changes, ot.run_batch(scenarios, no_load=False), strict=True))


@pytest.mark.parametrize("name", ["upright", "turned", "slippery"])
def test_slip_is_what_the_belts_run_and_the_robot_does_not(
    driven: dict[str, ot.Result], name: str
) -> None:
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
