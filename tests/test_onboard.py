"""Robots that drive by their own sensors: what they know, how well, and what they do when lost."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.events import LostItself
from omnitrack_sim.robots.omnitrack.events import Rolled
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.plots.run_figures import draw_error
from omnitrack_sim.show.plots.style import new_figure

ONBOARD = {"sensing.kind": "onboard"}


def onboard(name="tee_turn", **changes):
    """A shipped scenario, driven by onboard sensors."""
    return ot.override(
        ot.load_scenario(name),
        ONBOARD | {key.replace("__", "."): value for key, value in changes.items()},
    )


@pytest.fixture(scope="module")
def turn():
    """A tee turn of a robot that does not know how it is turned about its axis."""
    return ot.run(onboard(start__theta5_deg=40.0))


def test_a_robot_finds_out_how_it_is_turned_and_takes_the_tee(turn):
    """It rolls as it has to, and knows its orientation to a degree by then."""
    assert turn.success
    assert any(isinstance(event, Rolled) for event in turn.events)
    channels = turn.trajectory.channels
    turning = channels["phase"] == turn.trajectory.phases.index("tee_turn")
    first = int(np.flatnonzero(turning)[0])
    error = channels["theta5_estimate"][first] - channels["theta5"][first]
    assert abs(np.degrees(error)) < 1.5
    assert channels["theta5_std"][0] == pytest.approx(np.pi)
    assert np.degrees(channels["theta5_std"][first]) < 4.0


def test_its_estimate_is_as_good_as_it_says(turn):
    """After the turn its place is known to millimetres, and the standard deviations are neither
    boast nor excuse."""
    channels = turn.trajectory.channels
    half = 2 * len(turn.trajectory.time) // 3
    error = channels["distance_estimate"] - channels["distance"]
    assert np.abs(error[half:]).max() < 0.02
    assert 1e-4 < np.median(channels["distance_std"][half:]) < 0.02
    metrics = turn.metrics
    assert metrics["localisation_error_rel"] < 0.05
    assert metrics["localisation_error_mean_m"] <= metrics["localisation_error_max_m"]


@pytest.mark.parametrize("ahead", [0.01, -0.01])
def test_theta5_and_its_estimate_are_before_the_same_fitting(ahead):
    """Where the robot takes itself to be out of the tee, and is not yet, or the other way round,
    the record has no error of a right angle."""
    # A tee, and a bend out of its plane.
    mission = {"network": "annex", "mission": {"start": "inlet", "goals": ["low"]}}
    sim = ot.Simulation([ot.override(validate(mission), ONBOARD)])
    senses, routes, one = sim.senses, sim.legs.routes, np.zeros(1, int)
    end = float(routes.end[0])
    sim.legs.near = np.array([end])
    places, frames = routes.poses(np.zeros(2, int), end + np.array([-ahead, ahead]), np.zeros(2))
    truth = routes.locate(places[:1], frames[:1], one, sim.legs.near)
    senses.readings = {**senses.readings, "position": places[1:], "rotation": frames[1:]}
    senses.locate(truth)
    assert senses.location.passage != truth.passage
    error = wrap_angle(senses.estimates()["theta5_estimate"] - truth.theta5)
    assert np.degrees(np.abs(error)) < 3
    assert np.degrees(np.abs(wrap_angle(senses.location.theta5 - truth.theta5))) > 80


def test_tilt_is_as_sure_as_it_says(turn):
    """In a turn an error along the centreline turns the tangent that the tilt is measured from."""
    channels = turn.trajectory.channels
    error = channels["tilt_estimate"] - channels["tilt"]
    off = error / channels["tilt_std"]
    assert np.mean(np.abs(off) < 2) > 0.95
    assert np.sqrt(np.mean(off**2)) < 1


def test_the_largest_error_is_seen_in_its_panel(turn):
    """However short it is, as long as the robot claims to know how it is turned."""
    estimate = turn.trajectory["distance_estimate"].copy()
    estimate[-3] = turn.trajectory["distance"][-3] + 0.1
    channels = {**turn.trajectory.channels, "distance_estimate": estimate}
    axis = new_figure((3, 2)).add_subplot()
    draw_error(axis, dataclasses.replace(turn.trajectory, channels=channels), "distance")
    low, high = axis.get_ylim()
    assert low < -100 < 100 < high


def test_a_run_is_saved_and_read_back_with_its_estimates(turn, tmp_path):
    """The channels of the estimate stand in the file."""
    turn.save(tmp_path / "run")
    again = ot.load_result(tmp_path / "run")
    for name in ("theta5_estimate", "position_estimate", "distance_std"):
        assert np.array_equal(again.trajectory.channels[name], turn.trajectory.channels[name])


def test_a_look_back_shows_what_is_behind():
    """A tee ahead, and where the robot came from the open end of its pipe."""
    near = onboard(start__distance=0.2, sensing__start__theta5_known=True)
    simulation = ot.Simulation([near])
    for _ in range(3):
        simulation.step()
    look = simulation.senses.look(0, back=True)
    assert look.ahead is not None
    assert look.behind is not None
    assert look.ahead.kind[0] == "tee"
    assert look.behind.end == "open"
    assert look.behind.distance == pytest.approx(simulation.location.distance[0], abs=0.02)
    assert simulation.senses.look(0, back=False).behind is None


def test_nothing_of_the_truth_reaches_the_controller():
    """With the truth poisoned while it decides, the controller gives the same commands."""
    simulation, clean = (ot.Simulation([onboard()]) for _ in range(2))
    for _ in range(300):
        truth = simulation.readings, simulation.location
        fields = {
            field.name: value * np.nan
            for field in dataclasses.fields(simulation.location)
            if isinstance(value := getattr(simulation.location, field.name), np.ndarray)
            and value.dtype.kind == "f"
        }
        poisoned = dataclasses.replace(simulation.location, **fields)
        simulation.runs.location = poisoned
        simulation.readings = {
            name: np.full_like(value, np.nan)
            for name, value in simulation.readings.items()
            if np.asarray(value).dtype.kind == "f"
        }
        command = simulation.controller.step(simulation.observation)
        simulation.readings, simulation.runs.location = truth
        wanted = clean.controller.step(clean.observation)
        assert command.belt_speed.tobytes() == wanted.belt_speed.tobytes()
        assert command.roll.tobytes() == wanted.roll.tobytes()
        simulation.step(command)
        clean.step(wanted)


def test_a_robot_drives_the_same_alone_and_among_others():
    """Its noise, its pictures and its estimate do not depend on its neighbours, of which one ends
    before it, or on threads."""
    robots = [
        onboard(start__theta5_deg=angle, run__time_limit=limit)
        for angle, limit in ((0.0, 1.0), (50.0, 2.5), (-80.0, 2.5))
    ]
    alone = ot.run(robots[1]).trajectory.channels
    for threads in (1, 2):
        among = ot.run_batch(robots, threads=threads)[1].trajectory.channels
        for name in ("position", "position_estimate", "theta5_std", "misfit"):
            assert among[name].tobytes() == alone[name].tobytes(), name


def test_noise_belongs_to_seed_and_world():
    """Name, expectation and time limit change nothing; another controller has the same noise,
    another seed, start or friction other noise."""
    base = onboard(run__time_limit=0.2)
    changes = [
        {},
        {"name": "other", "run.expected_outcome": "timed_out", "run.time_limit": 0.3},
        {"control.kind": "equal"},
        {"seed": 1},
        {"start.theta5_deg": 1.0},
        {"world.friction": 0.8},
    ]
    runs = [ot.run(ot.override(base, change)).trajectory.channels for change in changes]
    estimates = [run["position_estimate"] for run in runs]
    assert estimates[1][: len(estimates[0])].tobytes() == estimates[0].tobytes()
    errors = [run["position_estimate"][0] - run["position"][0] for run in runs[2:]]
    first = estimates[0][0] - runs[0]["position"][0]
    assert np.abs(errors[0] - first).max() < 1e-9
    assert min(np.abs(error - first).max() for error in errors[1:]) > 1e-6


def test_controllers_see_what_sensors_say_and_no_more():
    """Slip and contact forces are not felt."""
    observation = ot.Simulation([onboard()]).observation
    assert observation.roll.shape == (1, 3)
    with pytest.raises(AttributeError, match="no channel 'slip_ratio' is observed"):
        _ = observation.slip_ratio


def test_a_blind_robot_stops_before_the_bend_and_gives_up():
    """With gravity along its pipe nothing tells it how it is turned: it does not drive into the
    elbow, looks for itself by steps back and rolls, and ends as lost."""
    blind = onboard("elbow", sensing__depth__dropouts=1.0, sensing__search__tries=1)
    result = ot.run(blind)
    assert result.outcome is ot.Outcome.LOST
    assert [type(event) for event in result.events] == [LostItself]
    channels, first = result.trajectory.channels, result.routes()[0].passages[1].s_enter
    nose = channels["distance"] + result.scenario.robot.length / 2
    assert nose.max() < first + 0.005
    assert np.degrees(np.ptp(channels["roll"])) > 30


def test_a_robot_that_is_elsewhere_finds_itself():
    """Put half a pipe farther on than it is, and sure of it, it sees that the picture is not that
    of its map, compares the poses around, and goes on from where it really is."""
    scenario = onboard("elbow", sensing__start__theta5_known=True, start__distance=0.15)
    simulation = ot.Simulation([scenario])
    pose = simulation.senses.localiser.filter
    pose.position = pose.position + 0.2 * pose.rotation[:, :, 2]
    pose.covariance = pose.covariance * 1e-2
    while simulation.active.any():
        simulation.step()
    (result,) = simulation.results()
    error = result.trajectory.channels["distance_estimate"] - result.trajectory.channels["distance"]
    assert error[5] > 0.15
    assert result.success
    assert np.abs(error[-100:]).max() < 0.03


def test_without_noise_the_estimate_is_the_truth():
    """With perfect sensors and a known start, millimetres and tenths of a degree remain, of slip
    and of the model."""
    perfect = {
        "sensing__start__distance_std": 0.0,
        "sensing__start__theta5_known": True,
        "sensing__encoders__radius_error": 0.0,
        "sensing__imu__gyro_bias_deg": 0.0,
        "sensing__imu__gyro_scale": 0.0,
        "sensing__depth__noise": 0.0,
        "sensing__depth__scale_error": 0.0,
        "sensing__depth__dropouts": 0.0,
    }
    result = ot.run(onboard("elbow", **perfect))
    assert result.success
    assert result.metrics["localisation_error_mean_m"] < 0.003
    assert result.metrics["theta5_error_p95_deg"] < 0.6


def test_the_headlight_takes_an_elbow():
    """By brightness alone the robot finds its orientation and passes the bend."""
    result = ot.run(onboard("elbow_short", sensing__camera="headlight", start__theta5_deg=70.0))
    assert result.success
    assert result.metrics["localisation_error_mean_m"] < 0.03
