"""What is handed to the package's functions in the place of something else is told by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from samples import sample_result, sample_trajectory

import omnitrack_sim as ot
from omnitrack_sim.show.film.render import render_frames

STRAIGHT = ot.load_scenario("straight")
ANY: Any = ot
RESULT = sample_result()
AXES = Figure().subplots(2)
NETWORK = ot.load_network("fig14")


@pytest.mark.parametrize(
    ("call", "place"),
    [
        (lambda: ot.render_frame(RESULT, time=float("nan")), "time"),
        (lambda: render_frames(RESULT, times=[0.0, float("nan")]), r"times\[1\]"),
        (lambda: ot.render_strip(RESULT, path="a.png", times=[np.nan]), r"times\[0\]"),
    ],
)
def test_a_time_that_is_none_is_refused(call, place):
    """NaN shows no sample; nothing is painted."""
    with pytest.raises(ot.InputError, match=f"{place}: is nan; it must be a number, s"):
        call()


class NoController:
    """Has no ``step``."""


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: ANY.run(None), "scenario: is None; .* ot.load_scenario makes"),
        (lambda: ANY.run_batch(STRAIGHT), "scenarios: is one ot.Scenario, not a list"),
        (lambda: ANY.run_batch("straight"), "scenarios: is 'straight', of type str"),
        (lambda: ANY.run_batch([STRAIGHT, "tee_turn"]), r"scenarios\[1\]: is 'tee_turn'"),
        (lambda: ANY.Simulation(STRAIGHT), "scenarios: is one ot.Scenario, not a list"),
        (lambda: ANY.override("straight", {}), "scenario: is 'straight'"),
        (lambda: ANY.override(STRAIGHT, "a.b=1"), "changes: is 'a.b=1', of type str"),
        (lambda: ANY.override(STRAIGHT, {0: 1}), "changes: has the path 0, of type int"),
        (lambda: ANY.load_scenario("straight", "a=1"), "changes: is 'a=1'"),
        (lambda: ANY.run(STRAIGHT, controller="paper"), "controller: is 'paper'.*control.kind"),
        (lambda: ANY.run(STRAIGHT, controller=5), "controller: is 5, of type int"),
        (lambda: ANY.Simulation([STRAIGHT], controller=NoController), "no method step"),
        (lambda: ANY.run(STRAIGHT, sensors=ot.MOTORS), "sensors: is"),
        (lambda: ANY.run(STRAIGHT, metrics=[len]), r"metrics\[0\]: is <built-in"),
        (lambda: ANY.Simulation([STRAIGHT]).step([0.1] * 3), "command: is .* an ot.Command"),
        (
            lambda: ANY.plot_channel(RESULT, channel="tilt", ax=3),
            "ax: is 3, of type int.*must be axes",
        ),
        (
            lambda: ANY.plot_channel(RESULT, channel="tilt", ax=AXES),
            "ax: is an array of axes; give one",
        ),
        (lambda: ANY.plot_network(NETWORK, ax=AXES), "ax: is an array of axes; give one of them"),
        (lambda: ANY.render_frame(RESULT, time="x"), "time: is 'x', of type str; .* a number, s"),
        (
            lambda: render_frames(RESULT, times=[0, None]),
            r"times\[1\]: is None; it must be a number",
        ),
        (lambda: render_frames(RESULT, times=3), "times: is 3, of type int; .* a list of numbers"),
        (lambda: ANY.render_strip(RESULT, path="a.png", times=["x"]), r"times\[0\]: is 'x'"),
        (lambda: ANY.plot_summary(3, path="a.png"), "result: is 3, of type int.*ot.load_result"),
        (lambda: ANY.plot_mission(None, path="a.png"), "result: is None"),
        (lambda: ANY.render_frame(STRAIGHT, time=0.0), "result: is Scenario"),
        (lambda: ANY.run_trials("tee_lugs"), r"plan: is .* ot.load_sweep\('tee_lugs'\) or"),
        (lambda: ANY.run_trials("robot_design"), r"plan: is .* ot.load_study\('robot_design'\)"),
        (lambda: ANY.run_trials(["elbow"]), r"must be an ot.Plan, such as ot.load_sweep or"),
        (lambda: ANY.shortest_route("fig14", "inlet", "low"), "network: is .*load_network"),
        (lambda: ANY.plot_singularity("a", path="a.png"), "case: is 'a', of type str; it must be"),
    ],
)
def test_another_type_is_told_by_the_name_of_the_argument(call, told):
    """A TypeError says what was given, and where there is a way to what is wanted, that way."""
    with pytest.raises(TypeError, match=told):
        call()


def test_a_simulation_of_nothing_is_refused_and_a_batch_of_nothing_is_empty():
    """One has no model to be made from; the other no results."""
    with pytest.raises(ValueError, match="scenarios: is empty"):
        ot.Simulation([])
    assert ot.run_batch([]) == []


def test_what_a_controller_returns_is_told_as_its_own():
    """The class is named, not the argument of ``step``."""

    class Mine:
        def __init__(self, setup):
            pass

        def step(self, observation):
            return [0.1] * 3

    simulation = ot.Simulation([STRAIGHT], controller=Mine)
    told = r"Mine, step 1 \(0 s\): TypeError: what Mine.step returns: is \[0.1, 0.1, 0.1\]"
    with pytest.raises(ot.ControllerError, match=told) as caught:
        simulation.step()
    assert isinstance(caught.value.__cause__, TypeError)


def test_every_picture_takes_a_result_or_its_folder(tmp_path):
    """Summary and map of a saved run are those of the result."""
    result = sample_result()
    folder = result.save(tmp_path / "run")
    for number, plot in enumerate((ot.plot_summary, ot.plot_mission)):
        plot(result, path=tmp_path / f"a{number}.png")
        plot(str(folder), path=tmp_path / f"b{number}.png")
        made, again = (tmp_path / f"{name}{number}.png" for name in "ab")
        assert made.read_bytes() == again.read_bytes()


def test_a_trajectory_is_a_mapping_of_its_channels():
    """Names in the order of the file, arrays by name; the number of samples is that of the
    times."""
    trajectory = sample_trajectory()
    assert "normal_force" in trajectory
    assert "time" not in trajectory
    assert list(trajectory) == list(trajectory.channels) == list(trajectory.keys())
    assert len(trajectory) == len(dict(trajectory)) == len(trajectory.schema)
    assert trajectory.get("nothing") is None
    assert trajectory == trajectory
    assert trajectory != sample_trajectory()
    for name, told in (("time", "trajectory.time"), ("rotation", "observed, but not recorded")):
        with pytest.raises(KeyError, match=told):
            trajectory[name]


@pytest.mark.parametrize("speed", [0.1, None, "fast", [0.1], [[1, 2], [3]], np.float64(0.1)])
def test_any_command_can_be_printed(speed):
    """Also one that will be refused."""
    assert repr(ot.Command(belt_speed=speed)).startswith("Command(")
