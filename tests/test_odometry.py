"""Robots of any kind that drive by their own sensors: what their odometry tells, and how far it
carries them."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from documents import page

import omnitrack_sim as ot
from omnitrack_sim.autonomy.relocalisation import PoseSearch
from omnitrack_sim.base.rotations import rotation_about
from omnitrack_sim.robots.odometry import rotation_by_sides
from omnitrack_sim.robots.presser import BendSpeeds, Presser
from omnitrack_sim.senses.settings import SearchTable
from omnitrack_sim.sim.odometry_check import OdometryCheck

MISSION = """
network = "knee_and_tee"
[robot]
kind = "my_rover:Rover"
file = "my_rover.xml"
bore = 0.16
[start]
distance = 0.2
theta5_deg = 30.0
[world]
friction = 0.8
[control]
kind = "my_rover:Forward"
cruise_speed = 0.12
[sensing]
kind = "onboard"
[mission]
start = "foot"
goals = ["far"]
"""


def python_of(name: str, contains: str) -> str:
    """The block of Python of a page that contains a text."""
    blocks = re.findall(r"```python\n(.*?)```", page(name), re.DOTALL)
    (block,) = (block for block in blocks if contains in block)
    return block


def test_a_robot_of_another_folder_drives_by_its_own_sensors(tmp_path):
    """The page's class, which states wheels and no more: up, round a bend and over a tee."""
    before, _, _ = python_of("any-robot", "spin_").partition("network = ot.Network(")
    names: dict = {}
    exec(before, names)
    (tmp_path / "my_rover.xml").write_text(names["spec"].to_xml(), encoding="utf-8")
    (tmp_path / "my_rover.py").write_text(python_of("autonomy", "class Rover"), encoding="utf-8")
    (tmp_path / "rover.toml").write_text(MISSION, encoding="utf-8")
    result = ot.run(ot.load_scenario(tmp_path / "rover.toml"))
    assert result.outcome is ot.Outcome.REACHED_GOAL, result.reason
    assert result.metrics["localisation_error_max_m"] < 0.08
    assert result.metrics["localisation_error_mean_m"] < 0.02
    assert result.metrics["theta5_error_p95_deg"] < 4


def test_encoders_of_the_wrong_sign_are_told_by_name(tmp_path, monkeypatch):
    """The same robot whose wheels count backward: an event says once which method to look at; right
    ones, and wheels that slip on the spot, are not suspected."""

    class Backward(type(Presser().odometry())):
        def surfaces(self, state):
            return -super().surfaces(state)

    changes = {"sensing.kind": "onboard", "run.time_limit": 8.0, "record.pictures": False}
    scenario = ot.load_scenario("robots/presser_tee", changes)
    plain = [str(event) for event in ot.run(scenario, no_load=False).events]
    assert not [text for text in plain if "odometry" in text]
    monkeypatch.setattr(Presser, "odometry", lambda self: Backward(self))
    told = [str(event) for event in ot.run(scenario, no_load=False).events]
    (one,) = [text for text in told if "odometry" in text]
    assert "Backward.surfaces" in one
    assert "wrong sign" in one


def test_odometry_is_judged_by_the_correlation_with_the_true_travel():
    """Opposite to the robot's motion along its axis in either gear, once a length has been driven;
    drives that run on the spot, that slip by half and robots that stand are none."""
    n, rng = 5, np.random.default_rng(0)
    place = {"time": np.zeros(n), "rotation": np.tile(np.eye(3), (n, 1, 1))}
    check = OdometryCheck("Wheels", 0.305, place | {"position": np.zeros((n, 3))})
    position, told = np.zeros((n, 3)), []
    for step in range(100):
        moved = np.array([0.01, -0.01, 0.01, 1e-4 * rng.normal(), 0.01])
        measured = np.array([-0.01, 0.01, 0.02, 0.01, -0.01])
        position[:, 2] += moved
        state = place | {"position": position, "time": np.full(n, 0.1 * (step + 1))}
        told += check.compare(measured, state, np.array([True] * 4 + [False]))
    assert [(event.robot, round(event.time, 1)) for event in told] == [(0, 3.1), (1, 3.1)]
    check.reset(np.array([0]), place | {"position": np.zeros((n, 3))})
    assert not check.compare(measured, place | {"position": np.zeros((n, 3))}, np.ones(n, bool))


def test_the_controller_of_the_page_drives_in_the_gear_that_it_is_told():
    """Tail first its wheels turn the other way."""
    names: dict = {}
    exec(python_of("autonomy", "class Rover"), names)
    setup, observation = SimpleNamespace(n=2), SimpleNamespace(gear=np.array([1, -1]))
    ahead, back = names["Forward"](setup).step(observation).ctrl
    assert (ahead > 0).all()
    assert back == pytest.approx(-ahead)


class Wheels(ot.Odometry):
    """Two wheels, and all that is needed."""

    surface_radius = 0.03

    def surfaces(self, state):
        return state.qpos[:, -2:]

    def look_around(self, command, order):
        return command


FAULTY = {
    "write Wheels(self)": lambda robot: Wheels,
    "returns a int, which does not inherit": lambda robot: 3,
    "no surface_radius: write surface_radius =": lambda robot: type(
        "Bare", (ot.Odometry,), {"surfaces": Wheels.surfaces, "look_around": Wheels.look_around}
    )(robot),
    "surface_radius -1": lambda robot: type("Odd", (Wheels,), {"surface_radius": -1.0})(robot),
    "write def surfaces(self, state)": lambda robot: type(
        "Bare", (Wheels,), {"surfaces": ot.Odometry.surfaces}
    )(robot),
    "write def look_around(self, command, order)": lambda robot: type(
        "Bare", (Wheels,), {"look_around": ot.Odometry.look_around}
    )(robot),
    "surfaces of shape (2,), and needs (n, w)": lambda robot: type(
        "Flat", (Wheels,), {"surfaces": lambda self, state: state.qpos[0, -2:]}
    )(robot),
    "surfaces of shape (1, 0)": lambda robot: type(
        "None", (Wheels,), {"surfaces": lambda self, state: state.qpos[:, :0]}
    )(robot),
    "arms of shape (3,), and needs (n, b)": lambda robot: type(
        "Arms", (Wheels,), {"arms": lambda self, state: np.zeros(3)}
    )(robot),
    "velocity of shape (1, 2), and needs (n, 3)": lambda robot: type(
        "Slow", (Wheels,), {"velocity": lambda self, state: np.zeros((1, 2))}
    )(robot),
}


@pytest.mark.parametrize("told", FAULTY)
def test_odometry_that_cannot_be_read_is_refused_as_the_run_begins(told, monkeypatch):
    """The fault is at the robot, and says what is wrong and what to write."""
    scenario = ot.load_scenario("robots/presser_tee")
    monkeypatch.setattr(Presser, "odometry", FAULTY[told])
    with pytest.raises(ot.InputError) as caught:
        ot.Simulation([ot.override(scenario, {"sensing.kind": "onboard"})])
    (fault,) = caught.value.faults
    assert fault.where == "robot"
    assert told in str(fault)


@pytest.mark.parametrize("robot", [pytest.param("presser", marks=pytest.mark.long), "climber"])
def test_other_robots_drive_through_fig14_by_their_own_sensors(robot):
    """Over two tees and round an elbow, and know where they are to centimetres."""
    result = ot.run(ot.load_scenario(f"robots/{robot}_fig14"))
    assert result.success, result.reason
    assert result.metrics["localisation_error_max_m"] < 0.05
    channels = result.trajectory.channels
    error = channels["distance_estimate"] - channels["distance"]
    assert np.mean(np.abs(error) < 3 * channels["distance_std"] + 1e-3) > 0.9


@pytest.mark.parametrize("count", [3, 4, 6])
def test_surfaces_around_the_axis_tell_how_the_robot_turns(count):
    """The travel of points on the wall of a robot that moves on and turns gives its rotation across
    the axis back, however fast it moves on."""
    rng, radius = np.random.default_rng(count), 0.08
    angles = rng.uniform(0, 1) + 2 * np.pi * np.arange(count) / count
    wanted = np.append(rng.normal(0, 0.01, 2), 0.0)
    points = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    travel = 0.003 + np.cross(wanted, points)[:, 2]
    assert rotation_by_sides(travel[None], angles, radius)[0] == pytest.approx(wanted, abs=1e-12)


def test_the_presser_reads_its_wheels_and_arms_by_their_joints():
    """Of two robots, each its own: travel of the wheels' rims, and places of the arms."""
    robot = Presser()
    odometry, rng = robot.odometry(), np.random.default_rng(2)
    qpos = rng.uniform(-1.0, 1.0, (2, max(at.stop for at in robot.joints.values())))
    state: Any = SimpleNamespace(qpos=qpos)
    columns = {name: qpos[:, at.start] for name, at in robot.joints.items()}
    arms = np.stack([columns[f"guide_{k}"] for k in range(3)], axis=-1)
    wheels = [columns[f"{end}_{k}"] for end in ("front", "rear") for k in range(3)]
    assert (odometry.arms(state) == arms).all()
    expected = robot.wheel_radius * np.stack(wheels, axis=-1)
    assert odometry.surfaces(state) == pytest.approx(expected)


@pytest.mark.parametrize("out", [-0.004, 0.0, 0.003])
def test_the_bore_of_the_presser_is_that_which_its_tyres_touch(out):
    """With its arms alike, by the farthest points of its tyres."""
    odometry = Presser().odometry()
    none, arms = np.zeros((1, 0)), np.full((1, 3), out)
    body = ot.BodyReadings(np.zeros((1, 6)), none, arms, np.zeros((1, 6)))
    points = odometry.limbs(body).points
    farthest = np.hypot(points[..., 0], points[..., 1]).max()
    assert odometry.bore(body)[0] == pytest.approx(2 * farthest)
    assert np.isnan(odometry.bore(body._replace(arm=np.array([[out, out, out - 0.02]])))[0])


def test_the_presser_turns_its_wheels_the_other_way_in_reverse():
    """In the same place in a bend, tail first: the same ratios of speeds, backward."""
    frame = rotation_about(np.array([[0.0, 0.0, 1.0]]), np.array([0.4]))
    location: Any = SimpleNamespace(normal=np.array([[1.0, 0.0, 0.0]]), curvature=np.array([4.0]))
    setup: Any = SimpleNamespace(robot=Presser())
    controller = BendSpeeds(setup)

    def wheels(gear: int) -> np.ndarray:
        location.frame = frame * [1.0, gear, gear]  # as locations have it, z ahead
        observation: Any = SimpleNamespace(location=location, gear=np.array([gear]))
        return controller.step(observation).ctrl

    assert np.ptp(wheels(1)) > 1
    assert wheels(-1) == pytest.approx(-wheels(1))


class Blind(ot.Odometry):
    """A robot on wheels, or one that rolls as well."""

    surface_radius = 0.03

    def __init__(self, robot, roll_rate):
        super().__init__(robot)
        self.roll_rate = roll_rate

    def look_around(self, command, order):
        self.orders.append((float(order.speed[0]), float(order.turn[0])))
        return command


@pytest.mark.parametrize("rolls", [True, False])
def test_a_lost_robot_that_cannot_roll_steps_back_at_once(rolls):
    """One that rolls sees its pipe from another side first; both give up after the same rounds."""
    odometry = Blind(Presser(), 1.5 if rolls else 0.0)
    odometry.orders = []
    table = SearchTable(tries=2, look=0.5)
    search = PoseSearch(table, odometry, 1)
    search.reset(np.zeros(1, int), np.array([0.08]))
    command, given_up, step = ot.Actuation(np.zeros((1, 6))), np.zeros(1, bool), 0
    while not given_up[0]:
        time = np.array([0.02 * step])
        command = command._replace(events=(), resting=None)
        command, given_up = search.step(command, np.ones(1, bool), {"time": time}, np.ones(1, int))
        assert command.resting[0]
        step += 1
    speeds, turns = np.array(odometry.orders).T
    first = speeds[: len(speeds) // 2]
    assert (first.min() < 0) != rolls
    assert speeds.min() == pytest.approx(-0.04)
    assert turns.max() == pytest.approx(2 * np.radians(table.roll_deg) if rolls else 0.0)


def test_a_robot_that_has_found_out_how_it_is_turned_knows_where_it_is():
    """The picture by which it has, and those on their way, are compared with the map as seen from
    its new pose: in the second after, its place is right as far as it says."""
    scenario = ot.load_scenario("robots/presser_fig14")
    turned = {"start.theta5_deg": 90.0, "run.time_limit": 3.2}
    found = ot.run(ot.override(scenario, turned)).trajectory.channels
    known = found["theta5_std"] < np.pi
    assert 5 < known.sum() < len(known) - 5
    error = (found["distance_estimate"] - found["distance"])[known]
    assert np.abs(error).max() < 0.02
    assert np.abs(error / found["distance_std"][known])[2:].max() < 4
