"""The default controller's decisions before a fitting."""

import dataclasses

import numpy as np
import pytest

from omnitrack_sim import Scenario, Simulation, load_scenario, override, run_batch
from omnitrack_sim.base.rotations import matrix_from_quaternion
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES
from omnitrack_sim.robots.omnitrack.control.alignment import AlignmentTable
from omnitrack_sim.robots.omnitrack.control.orientation import orientation_error, preferred_theta5
from omnitrack_sim.robots.omnitrack.control.roll_plan import no_motion_distance
from omnitrack_sim.robots.omnitrack.control.sway import Lean
from omnitrack_sim.robots.omnitrack.events import NotAligned, Rolled
from omnitrack_sim.robots.omnitrack.singularity import safe_margin, sector_angle
from omnitrack_sim.robots.omnitrack.track_plant import TrackPlant
from omnitrack_sim.robots.plant import Plant, Start


@pytest.fixture(scope="module")
def results():
    """The first seconds of tee turns from the worst orientation: as it is, and with a reach that
    has no safe one."""
    base = override(
        load_scenario("tee_turn"),
        {"start.theta5_deg": 60, "run.time_limit": 4.0, "control.retry": False},
    )
    return run_batch([base, override(base, {"robot.reach": 0.088})])


def test_the_roll_is_told(results):
    """One event, with time, fitting, roll and theta5."""
    (event,) = results[0].events
    assert isinstance(event, Rolled)
    assert event.fitting == "tee_1"
    assert "before tee_1: rolls the modules by" in str(event)
    assert "theta5 from 60.0 to" in str(event)


def test_the_roll_comes_true(results):
    """After it theta5 is inside the margin of the robot's reach and the belts run the other way
    round."""
    trajectory = results[0].trajectory
    phases = np.array(trajectory.phases)[trajectory["phase"].astype(int)]
    after = np.flatnonzero(phases == "align")[-1] + 1
    assert abs(trajectory["theta5"][after]) < safe_margin(sector_angle(0.08, 0.0961))
    assert np.cos(trajectory["roll"][after]).max() < -0.5
    assert (
        trajectory["belt_speed_command"][after].max()
        < 0
        < trajectory["belt_speed_command"][1].min()
    )


def test_a_robot_without_safe_orientation_says_so_and_drives_on(results):
    """The event names the cause; it does not stand still for a roll that does not help."""
    (event,) = results[1].events
    assert isinstance(event, NotAligned)
    assert "not aligned: the safe margin is zero" in str(event)
    assert np.ptp(results[1].trajectory["roll_command"]) == 0


def test_modules_on_the_no_motion_line_are_rolled_off_it():
    """A robot that reaches the fitting with its modules near 90 degrees stops to roll, though
    theta5 is best."""
    base = override(load_scenario("tee_turn"), {"start.roll_deg": 70, "run.time_limit": 5.0})
    (result,) = run_batch([base])
    assert "rolls the modules by" in str(result.events[0])
    rolled = np.flatnonzero(result.trajectory["phase"] == result.trajectory.phases.index("align"))[
        -1
    ]
    clear = no_motion_distance(result.trajectory["roll"][rolled])
    limits = AlignmentTable()
    assert (clear > np.radians(limits.clear_enough_deg) - 2 * limits.roll_settled).all()
    assert abs(
        orientation_error(result.trajectory["theta5"][rolled], preferred_theta5("tee_turn"))
    ) < np.radians(11.73)


BESIDE = 0.008
"""How far beside the centreline a robot is set, m."""


class PlantBeside(TrackPlant):
    """A plant of robots that stand ``BESIDE`` the centreline."""

    def _set_start(self, rows, start):
        super()._set_start(rows, start)
        self.qpos[rows[:, None], self._at.slide] -= BESIDE * np.cos(MODULE_ANGLES)


def plant_beside(scenario: Scenario, start: Start, threads: int) -> Plant:
    """The robots ``BESIDE`` the centreline towards module 1, with their arms at the wall."""
    towards = matrix_from_quaternion(start.quaternion)[:, :, 0]
    moved = dataclasses.replace(start, position=start.position + BESIDE * towards)
    model, period = scenario.to_spec().compile(), scenario.physics.control_period
    return PlantBeside(model, scenario.robot, moved, period, threads)


def test_a_robot_beside_the_centreline_drives_back_to_it():
    """On a straight 8 mm are less than 2 mm after half a metre; with ``centring = 0`` the robot
    stays where friction holds it."""
    base = load_scenario("straight")
    without = {"control.parameters.tracking.centring": 0.0}
    simulation = Simulation([base, override(base, without)], make_plant=plant_beside)
    simulation.advance()
    offsets = []
    for result in simulation.results():
        trajectory = result.trajectory
        assert trajectory["offset"][0] == pytest.approx(BESIDE)
        after = np.searchsorted(trajectory["distance"], trajectory["distance"][0] + 0.5)
        offsets.append(trajectory["offset"][after:].max())
    assert offsets[0] < 0.002
    assert offsets[1] > 0.005


MERGES = {
    "tracking.upward_speed": {
        "start.theta5_deg": -18.0,
        "world.friction": 0.55,
        "robot.preload": 23.6,
        "world.gravity": [3.7, 1.9, -8.9],
    },
    "tracking.retry_speed": {
        "start.theta5_deg": -43.0,
        "world.friction": 0.507,
        "robot.preload": 20.5,
        "world.gravity": [-4.6, 0.2, 8.66],
    },
}
"""Turns out of a branch that fail without a law, by its parameter."""


@pytest.mark.parametrize("law", MERGES)
def test_a_robot_turns_out_of_a_branch_on_a_slippery_wall(law: str) -> None:
    """Up the run it falls out of the tee if its outer belts hold against the springs; down the run
    it hangs at the rim for good if the inner belt brakes at another attempt, too."""
    scenario = override(load_scenario("tee_merge"), MERGES[law])
    without = override(scenario, {f"control.parameters.{law}": 0.0})
    passed = [result.success for result in run_batch([scenario, without], no_load=False)]
    assert passed == [True, False]


def test_a_robot_past_a_branch_comes_back_with_its_tracks_to_the_wall() -> None:
    """One retry is enough then; with the tracks left as they are the robot hangs where it is."""
    changes = {
        "start.theta5_deg": -31.0,
        "world.friction": 0.705,
        "robot.preload": 18.2,
        "world.gravity": [-8.6, -2.1, 4.3],
        "control.parameters.recovery.retries": 1,
    }
    scenario = load_scenario("tee_turn", changes)
    without = override(scenario, {"control.parameters.recovery.square": False})
    passed = [result.success for result in run_batch([scenario, without], no_load=False)]
    assert passed == [True, False]


def wanted_beyond_the_arc(axis: list[float], turn_deg: float, ahead_deg: float) -> np.ndarray:
    """Rotation wanted per metre, about the axes of the tee, of a robot that looks past the arc of a
    turn and has turned ``ahead_deg`` beyond the branch's direction."""
    changes = {"start.axis": axis, "start.turn_deg": turn_deg}
    simulation = Simulation([load_scenario("tee_turn", changes)])
    routes, one = simulation.setup.routes, np.zeros(1, np.intp)
    passage = routes.routes[0].passages[1]
    s = np.array([passage.s_bend_end - 0.025])
    place, own = routes.centreline.at(s, one)[0], passage.part.pose.rotation
    angle = np.radians(90.0 + ahead_deg)
    z, x = (
        np.array([np.sin(angle), 0.0, np.cos(angle)]),
        np.array([np.cos(angle), 0, -np.sin(angle)]),
    )
    frame = own @ np.stack([x, np.cross(z, x), z], axis=-1)
    location = routes.locate(place, frame[None], one, s)
    nothing, upright = np.zeros(1), Lean(np.zeros((1, 3)), np.zeros(1), np.zeros(1))
    tracking = simulation.controller.tracking
    wanted = tracking.wanted_rotation(location, frame[None], np.ones(1), nothing, upright)
    return own.T @ wanted[0]


@pytest.mark.parametrize("ahead_deg", [0.0, 2.0, -2.0])
def test_rounding_does_not_decide_how_a_robot_leaves_a_turn(ahead_deg):
    """Where all of the centreline ahead is straight, pipes that are turned in the world ask for the
    same rotation, and a robot that points along the branch for none: the rest of the arc beneath
    it, 11 rad/m, would turn it on."""
    rng = np.random.default_rng(2)
    asked = [wanted_beyond_the_arc([0.0, 0.0, 1.0], 0.0, ahead_deg)]
    for _ in range(8):
        axis = rng.normal(size=3).tolist()
        asked.append(wanted_beyond_the_arc(axis, float(rng.uniform(-180, 180)), ahead_deg))
    assert np.array(asked) == pytest.approx(np.tile(asked[0], (9, 1)), abs=1e-4)
    expected = -40.0 * np.radians(ahead_deg)
    assert asked[0] == pytest.approx([0.0, expected, 0.0], abs=0.2)
