"""Robots of other kinds in scenarios: the protocol, the plant, results, missions, sweeps, films."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import mujoco
import numpy as np
import pytest
from commands import omnitrack
from pages import chromium, needs_browser, opened
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.naming import name_of
from omnitrack_sim.cli import app
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.record.display import Moment, StatusText
from omnitrack_sim.record.events import Overloaded
from omnitrack_sim.robots.display import RobotDisplay
from omnitrack_sim.robots.kinds import ROBOTS, robot_class
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.scene import is_similar
from omnitrack_sim.scenario import kinds_first, validate
from omnitrack_sim.show.run_playback import RunPlayback

ROOMS = ("walls", "pipes", "show", "sim")
PIPES = [{"kind": "straight", "length": 0.5}]
SHORT = {"run.time_limit": 0.6}


class Ball(ot.Robot):
    """A ball that does nothing."""

    radius: float = 0.05
    preload: float = 1.0

    @property
    def nominal_bore(self):
        return 0.16

    @property
    def length(self):
        return 2 * self.radius

    def spec(self):
        spec = mujoco.MjSpec()
        ball = spec.worldbody.add_body(name="chassis")
        _ = ball.add_freejoint(), ball.add_geom(size=[self.radius, 0, 0])
        return spec


class Still:
    """A controller of any robot, which leaves its inputs as they are."""

    def __init__(self, setup):
        self.command = setup.command

    def step(self, observation):
        return self.command


class Rod(Ball):
    """A rod of 200 mm across the pipe."""

    def spec(self):
        spec = mujoco.MjSpec()
        rod = spec.worldbody.add_body(name="chassis")
        kind, ends = mujoco.mjtGeom.mjGEOM_CAPSULE, [-0.09, 0, 0, 0.09, 0, 0]
        _ = rod.add_freejoint(), rod.add_geom(type=kind, size=[0.01, 0, 0], fromto=ends)
        return spec


class Twins(Ball):
    """Two balls, one 20 mm deep in the other."""

    def spec(self):
        spec = mujoco.MjSpec()
        chassis = spec.worldbody.add_body(name="chassis")
        _ = chassis.add_freejoint(), chassis.add_geom(size=[0.03, 0, 0])
        other = chassis.add_body(name="other", pos=[0, 0, 0.04])
        hinge = other.add_joint(axis=[1, 0, 0])
        hinge.armature = 0.01
        other.add_geom(size=[0.001, 0, 0])
        middle = other.add_body(name="middle")  # neighbours do not touch in MuJoCo
        slide = middle.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        slide.stiffness[0] = 1e6
        middle.add_geom(size=[0.03, 0, 0])
        return spec


def ball(**changes: Any) -> ot.Scenario:
    """A ball in a straight pipe that lies level."""
    data = {"robot": {"kind": name_of(Ball)}, "pipes": PIPES, "start": {"axis": [1, 0, 0]}}
    return validate(data, changes={"start.distance": 0.2, **SHORT, **changes})


@pytest.fixture(scope="module")
def run() -> ot.Result:
    """A presser that has begun to climb."""
    return ot.run(ot.load_scenario("robots/presser_elbow", SHORT))


@pytest.mark.parametrize("kind", ["presser", "inchworm", "snake"])
def test_a_robot_drives_through_a_scenario(kind):
    """Each of the shipped robots makes headway up a pipe, in contact with the wall all the time."""
    changes = {"run.time_limit": 4.0, "run.expected_outcome": "timed_out"}
    result = ot.run(ot.load_scenario(f"robots/{kind}_elbow", changes))
    assert result.as_expected
    assert result.metrics["mean_speed_m_s"] > 0.02
    settled = result.trajectory.time > 0.5
    assert (result.trajectory["wall_force"][settled] > 0).any(axis=1).all()
    assert np.abs(result.trajectory["tilt"]).max() < np.radians(20)


def test_climbing_costs_the_energy_of_the_height(run):
    """The work of the actuators is at least what the weight gains; cost of transport agrees."""
    robot, metrics = run.scenario.robot, run.metrics
    weight = robot.mass * 9.81
    # Samples every 20 ms miss a little of the start.
    assert metrics["energy_j"] > 0.98 * weight * metrics["distance_m"]
    cost = metrics["energy_j"] / (weight * metrics["distance_m"])
    assert metrics["cost_of_transport"] == pytest.approx(cost)


def test_rolling_wheels_hardly_slip_and_carry_the_preload(run):
    """Each wheel presses with half of its arm's spring and rolls: its contact moves by under a
    hundredth of the way."""
    after = run.trajectory.time > 0.3
    wheels = run.trajectory["wall_force"][after]
    pressed = wheels[:, wheels.max(axis=0) > 0]
    assert pressed.shape[1] == 6
    assert pressed.mean(axis=0) == pytest.approx(np.full(6, 20.0), rel=0.2)
    slip = run.trajectory["contact_speed"][after].max()
    assert slip < 0.05 * run.metrics["mean_speed_m_s"]


def test_the_timeline_is_of_what_touches(run):
    """Mean and least force of a straight are those of the wheels, not of bodies in the air."""
    (passage,) = run.timeline()
    assert passage.normal_force_mean_n == pytest.approx(20.0, rel=0.1)
    assert passage.normal_force_min_n > 10.0


def test_a_run_reads_back_as_it_was_saved(run, tmp_path):
    """Channels of the robot's model, joints and scenario come back with the folder."""
    back = ot.load_result(run.save(tmp_path / "run"))
    assert back.scenario == run.scenario
    assert back.qpos.tobytes() == run.qpos.tobytes()
    assert list(back.trajectory.schema) == list(run.trajectory.schema)
    for name in run.trajectory:
        assert np.array_equal(back.trajectory[name], run.trajectory[name]), name
    assert back.trajectory.schema["wall_force"].unit == "N"
    assert back.joints == run.joints
    assert "<svg" in back._repr_html_()


def test_robots_of_a_batch_are_alone():
    """Friction, gravity and orientation are each one's own; the bytes are those of single runs."""
    base = ot.load_scenario("robots/presser_elbow", {"run.time_limit": 0.3})
    other = ot.override(base, {"world.friction": 0.4, "start.theta5_deg": 40.0})
    both = ot.run_batch([base, other], threads=2)
    for scenario, result in zip([base, other], both, strict=True):
        alone = ot.run(scenario, threads=1)
        assert result.trajectory.qpos.tobytes() == alone.trajectory.qpos.tobytes()
    assert both[0].trajectory.qpos.tobytes() != both[1].trajectory.qpos.tobytes()


def test_a_ball_without_friction_falls_as_balls_do():
    """Down a vertical pipe it gains g t; in a level one it comes to rest, with its weight on the
    wall."""
    falling = ot.run(ball(**{"start.axis": [0, 0, -1], "run.time_limit": 0.2}))
    drop = falling.metrics["distance_m"]
    assert drop == pytest.approx(9.81 / 2 * 0.2**2, rel=0.03)
    resting = ot.run(ball(**{"world.friction": 0.5, "run.time_limit": 2.0}))
    weight = resting.scenario.robot.mass * 9.81
    assert resting.trajectory["wall_force"][-1] == pytest.approx([weight], rel=0.01)


def test_a_robot_that_does_not_fit_is_refused():
    """A rod across a pipe is in the wall by half of what it is too long."""
    with pytest.raises(ot.InputError, match=r"does not fit: body 'chassis' is 20.* mm deep"):
        ot.run(ball(**{"robot.kind": name_of(Rod)}))


@pytest.mark.parametrize("depth", [0.002, 0.004])
def test_a_body_that_is_wider_than_the_bore_is_refused_with_its_depth(depth):
    """A rigid ball cannot give way: by a hundredth of the bore and more it is refused, also beside
    one that fits."""
    fits, does_not = (ball(**{"robot.radius": radius}) for radius in (0.05, 0.08 + depth))
    with pytest.raises(ot.InputError, match=r"does not fit: body 'chassis'") as told:
        ot.Simulation([does_not])
    (said,) = re.findall(r"is ([\d.]+) mm deep in the wall of a bore of 160 mm", str(told.value))
    assert float(said) == pytest.approx(1000 * depth, rel=0.15)
    assert ot.Simulation([fits]).n == 1
    with pytest.raises(ot.InputError, match="does not fit"):
        ot.Simulation([narrowing(0.2), narrowing(0.9)])


def narrowing(distance: float) -> ot.Scenario:
    """A ball of 60 mm in a pipe that narrows to 100 mm."""
    narrow = {"kind": "straight", "length": 0.5, "inner_diameter": 0.1}
    pipes = [*PIPES, {"kind": "reducer", "length": 0.2, "end_diameter": 0.1}, narrow]
    return ball(**{"robot.radius": 0.06, "pipes": pipes, "start.distance": distance})


@pytest.mark.parametrize("kind", ["snake", "helix"])
def test_a_robot_gives_way_to_a_narrower_bore_before_it_starts(kind):
    """A helix that was made for a bore 3 % wider begins pressed by its own joints, with a few
    weights, and not by how soft the wall is: its middle link is not held in there."""
    narrow = {"pipes": [{"kind": "straight", "length": 1.6, "inner_diameter": 0.97 * 0.16}]}
    simulation = ot.Simulation([ot.load_scenario(f"robots/{kind}_elbow", narrow)])
    weight = simulation.scenarios[0].robot.mass * 9.81
    assert simulation.readings["wall_force"].max() < 15 * weight


def test_a_force_beyond_what_contacts_stand_for_is_noted():
    """A snake in a bore that is 5 % too narrow jams itself: its result says which body presses
    hardest, when, and with how many of its weights; in its own bore it says nothing."""
    notes = {}
    for bore in (0.16, 0.152):
        pipes = [{"kind": "straight", "length": 1.6, "inner_diameter": bore}]
        changes = {"pipes": pipes, "run.time_limit": 0.5, "run.expected_outcome": "timed_out"}
        result = ot.run(ot.load_scenario("robots/snake_elbow", changes), no_load=False)
        force = result.trajectory["wall_force"]
        notes[bore] = [e for e in result.events if isinstance(e, Overloaded)]
        weight = result.scenario.robot.mass * 9.81
        assert len(notes[bore]) == (force.max() > 20 * weight)
    (note,) = notes[0.152]
    sample, body = np.unravel_index(force.argmax(), force.shape)
    assert note.time == pytest.approx(result.trajectory.time[sample])
    names = result.scenario.robot.channels["wall_force"].names
    times = force.max() / weight
    assert note.text.startswith(f"body {names[body]!r}: normal force of {force.max():.0f} N, ")
    assert f"{times:.0f} times the robot's weight" in note.text
    assert notes[0.16] == []


def test_friction_is_that_of_all_of_a_pipe():
    """Walls, sharp edges and plates have the friction of the scenario."""
    pipes = [*PIPES, {"kind": "mitre"}, {"kind": "cap", "length": 0.1}]
    simulation = ot.Simulation([ball(**{"pipes": pipes, "world.friction": 0.37})])
    model = simulation.model
    fixed = [i for i in range(model.ngeom) if model.geom_bodyid[i] == 0]
    names = {model.geom(i).name.split("_")[0] for i in fixed}
    assert names >= {"wall", "rim", "plate"}
    friction = simulation.plant._friction[0, fixed, 0]
    assert friction == pytest.approx(0.37)


@pytest.mark.parametrize(
    ("changes", "where", "words"),
    [
        ({"robot": {"kind": "presse"}}, "robot.kind", "did you mean 'presser'"),
        ({"robot": {"kind": "presser", "prelaod": 3}}, "robot.prelaod", "preload"),
        ({"robot": "gone.xml"}, "robot.file", "cannot be read"),
        ({"robot": "presser", "physics": {"collider": "primitives"}}, "physics.collider", "kind"),
        ({"robot": "snake", "sensing": {"kind": "onboard"}}, "sensing.kind", "odometry"),
        ({"robot": "presser", "start": {"roll_deg": 20}}, "start.roll_deg", "kind"),
        ({"robot": "presser", "control": {"kind": "jacobian"}}, "control.kind", "own"),
    ],
)
def test_what_means_nothing_is_refused(changes, where, words):
    """The fault is at its key and has the valid choices."""
    with pytest.raises(ot.ScenarioError) as caught:
        validate({"pipes": PIPES, **changes})
    fault = next(fault for fault in caught.value.faults if fault.where == where)
    assert words in str(fault)


def test_another_kind_brings_its_own_controller():
    """An override of the kind leaves nothing of the robot before."""
    scenario = ot.override(ot.load_scenario("straight"), {"robot.kind": "presser"})
    assert type(scenario.robot).__name__ == "Presser"
    assert scenario.control.kind == "bend"
    assert scenario.model_dump(mode="json")["robot"]["kind"] == "presser"
    back = ot.override(scenario, {"robot.kind": "omnitrack"})
    assert back.robot == ot.Omnitrack()
    assert back.control.kind == "jacobian"


def test_the_kind_comes_first_whatever_the_order_of_changes():
    """It drops the values of the file's robot, and none that is set in the same call; the
    controller, which a robot brings, is set after it."""
    changes = {
        "control.parameters.gain": 2.0,
        "control.kind": "bend",
        "robot.bore": 0.16,
        "robot.kind": "presser",
    }
    for each in (changes, dict(reversed(changes.items()))):
        order = list(kinds_first(each))
        assert order[0] == "robot.kind"
        assert order.index("control.kind") < order.index("control.parameters.gain")
    base = ot.override(ot.load_scenario("straight"), {"robot.lugs_per_track": 20})
    preload = {"robot.wheel_radius": 0.02, "robot.kind": "presser"}
    for each in (preload, dict(reversed(preload.items()))):
        assert ot.override(base, each).robot == Presser(wheel_radius=0.02)
    ball = {"control.kind": name_of(Still), "robot.kind": "presser"}
    assert ot.override(base, ball).control.kind == name_of(Still)


def test_values_of_a_kind_that_is_not_there_are_not_faults():
    """What it has is not known: the fault is at the kind alone."""
    changes = {"robot.file": "rover.xml", "robot.kind": "presse"}
    with pytest.raises(ot.ScenarioError) as caught:
        ot.load_scenario("straight", changes)
    assert [fault.where for fault in caught.value.faults] == ["robot.kind"]


def test_only_classes_of_the_kind_are_offered_for_a_misspelt_one(tmp_path, monkeypatch):
    """Of a module of robots, controllers, fittings and constants."""
    (tmp_path / "mixed_things.py").write_text(
        "import omnitrack_sim as ot\nSPEED = 3\ndef helper(): ...\n"
        "class Rover(ot.Mjcf): ...\n"
        "class Forward:\n    def step(self, observation): ...\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    for changes, fits in (
        ({"robot.kind": "mixed_things:Nope"}, "mixed_things:Rover"),
        ({"control.kind": "mixed_things:Nope"}, "mixed_things:Forward"),
    ):
        with pytest.raises(ot.ScenarioError) as caught:
            ot.load_scenario("straight", changes)
        (fault,) = caught.value.faults
        assert [name for name in fault.choices if name.startswith("mixed_things")] == [fits]
    with pytest.raises(ot.InputError) as caught:
        fitting_class("mixed_things:Nope")
    assert not [name for name in caught.value.faults[0].choices if "mixed_things" in name]


class Loaded(ot.Mjcf):
    """A robot whose file has to be given."""


def test_parameters_of_a_model_file_are_listed_and_of_its_class_are_asked_for(tmp_path):
    """A class that needs a file cannot be shown by its name alone: the fault says what to name."""
    file = tmp_path / "hull.xml"
    file.write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.05'/></body></worldbody>"
        "</mujoco>"
    )
    shown = CliRunner().invoke(app, ["parameters", str(file), "--json"])
    assert shown.exit_code == 0, shown.output
    assert str(file) in [row["value"] for row in json.loads(shown.output)]
    with pytest.raises(ot.InputError, match=r"needs file, .* name a scenario"):
        CliRunner().invoke(app, ["parameters", name_of(Loaded)], catch_exceptions=False)


def test_an_mjcf_file_is_a_robot(tmp_path, monkeypatch):
    """Its path is relative to the scenario, its nose lies along ``forward``, and another file than
    the scenario's digest says is refused."""
    monkeypatch.chdir(tmp_path)
    text = (
        "<mujoco><worldbody><body name='hull' pos='0 0 3'><freejoint/>"
        "<geom type='capsule' size='0.03' fromto='-0.05 0 0 0.05 0 0'/></body>"
        "</worldbody></mujoco>"
    )
    Path("hull.xml").write_text(text)
    Path("mine.toml").write_text(
        'robot = { kind = "mjcf", file = "hull.xml", forward = "x", bore = 0.1 }\n'
        "[start]\ndistance = 0.3\naxis = [1, 0, 0]\n[run]\ntime_limit = 0.1\n"
        '[[pipes]]\nkind = "straight"\nlength = 0.6\ninner_diameter = 0.1\n'
    )
    scenario = ot.load_scenario("mine.toml")
    assert scenario.robot.length == pytest.approx(0.16)
    result = ot.run(scenario)
    assert result.trajectory["distance"][0] == pytest.approx(0.3, abs=1e-6)
    assert result.trajectory["tilt"].max() < 1e-3
    Path("hull.xml").write_text(text.replace("0.03", "0.031"))
    with pytest.raises(ot.ScenarioError, match="the file has changed"):
        ot.override(scenario, {"run.time_limit": 0.2})


@pytest.mark.parametrize(
    ("inside", "place"),
    [
        ("<freejoint/><geom size='0'/>", "robot.file"),
        ("<geom size='0.05'/></body><body><geom size='0.05'/>", "robot.body"),
        (None, "robot.file"),
    ],
    ids=["cannot be compiled", "two bodies", "a folder"],
)
def test_a_model_that_is_no_robot_is_refused_at_its_key(
    tmp_path, monkeypatch, capfd, inside, place
):
    """MuJoCo's own words follow the key; where the file is a folder it is not asked at all."""
    monkeypatch.chdir(tmp_path)
    if inside is None:
        Path("odd.xml").mkdir()
    else:
        Path("odd.xml").write_text(
            f"<mujoco><worldbody><body name='hull'>{inside}</body></worldbody></mujoco>"
        )
    data = {"pipes": [{"kind": "straight", "length": 1.0}]}
    with pytest.raises(ot.ScenarioError) as caught:
        validate({**data, "robot": {"kind": "mjcf", "file": "odd.xml", "bore": 0.16}})
    assert [fault.where for fault in caught.value.faults] == [place]
    assert capfd.readouterr() == ("", "")


def test_a_robot_that_nothing_drives_says_so(tmp_path, monkeypatch):
    """A file with actuators and no controller is told of at the start; one without is a body that
    may be pulled or may fall."""
    monkeypatch.chdir(tmp_path)
    motor = "<actuator><motor joint='rim'/></actuator>"
    for actuators in (motor, ""):
        Path("car.xml").write_text(
            "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.03'/>"
            "<body pos='0 0 0.03'><joint name='rim'/><geom size='0.02'/></body></body></worldbody>"
            f"{actuators}</mujoco>"
        )
        scenario = validate(
            {
                "robot": {"kind": "mjcf", "file": "car.xml", "bore": 0.1},
                "start": {"distance": 0.3},
                "run": {"time_limit": 0.1},
                "pipes": [{"kind": "straight", "length": 0.6, "inner_diameter": 0.1}],
            }
        )
        told = [str(event) for event in ot.run(scenario).events if "nothing drives" in str(event)]
        assert len(told) == bool(actuators)


def test_a_controller_of_ones_own_answers_with_inputs():
    """It sees joints, sensors by name and its place; its inputs are recorded."""

    class Push:
        phases = ("push",)

        def __init__(self, setup):
            self.model = setup.model

        def step(self, observation):
            assert observation.qpos.shape[1] == self.model.nq
            assert observation.location.distance.shape == (1,)
            return ot.Actuation(np.full((1, self.model.nu), 2.0))

    result = ot.run(
        ot.load_scenario("robots/presser_elbow", {"run.time_limit": 0.2}), controller=Push
    )
    assert (result.trajectory["ctrl"][1:] == 2.0).all()
    assert result.trajectory.phases == ("push",)


def test_a_command_for_another_robot_is_refused():
    """A robot takes the kind of command that its plant carries out."""
    sim = ot.Simulation([ot.load_scenario("robots/presser_elbow")])
    with pytest.raises(TypeError, match="Actuation"):
        sim.step(ot.Command(np.zeros((1, 3))))
    with pytest.raises(ValueError, match=r"command.ctrl has shape \(1, 2\), expected \(1, 6\)"):
        sim.step(ot.Actuation(np.zeros((1, 2))))


def test_a_sweep_has_the_robots_metrics(tmp_path):
    """A sweep over a parameter of another robot fills its table with that robot's metrics."""
    (tmp_path / "grip.toml").write_text(
        'base = "robots/presser_elbow"\n[set]\n"run.time_limit" = 0.2\n'
        '[[axes]]\npath = "robot.preload"\nkind = "list"\nvalues = [20.0, 40.0]\n'
    )
    sweep = ot.load_sweep(tmp_path / "grip.toml")
    result = ot.run_trials(sweep, out=tmp_path / "sweep", workers=1)
    force = result.table["wall_force_sum_mean_n"].to_numpy()
    assert force[1] == pytest.approx(2 * force[0], rel=0.1)


def test_a_film_shows_the_robot_in_its_pipe(run, tmp_path):
    """Orange of the presser's chassis is seen, and moves up the picture."""
    first = ot.render_frame(run, time=0.0, width=320, height=240)
    assert first.shape == (240, 320, 3)
    red, blue = (first[..., i].astype(int) for i in (0, 2))
    assert np.count_nonzero((red > 150) & (red - blue > 80)) > 20
    path = ot.render_strip(run, path=tmp_path / "strip.png", count=2, width=160, height=120)
    assert iio.imread(path).std() > 10


def test_the_camera_on_board_is_the_robots_own():
    """That of a snake is on its head, far from the chassis in its middle, and within the pipe: it
    sees lit walls in most of its picture."""
    changes = {"robot": "snake", "start.distance": 0.3, "run.time_limit": 0.5}
    run = ot.run(ot.load_scenario("straight", changes))
    look = {"inset": False, "overlay": False, "width": 160, "height": 90}
    view = ot.render_frame(run, time=0.5, camera="onboard", **look)
    assert (view.max(axis=-1) > 20).mean() > 0.5


class RollingDisplay(RobotDisplay):
    """Display of a user's own."""

    first_plots = ("theta5",)

    def status(self, moment: Moment) -> StatusText:
        """Return one line."""
        return StatusText("rolling", (f"{moment.time:.1f} s",))


class Shown(Ball):
    """A ball with a display of its own."""

    @property
    def display(self) -> RobotDisplay:
        """See ``RollingDisplay``."""
        return RollingDisplay(self)


def test_a_robot_of_ones_own_shows_itself():
    """What its display overrides is shown in films and on pages; all else is as of any robot."""
    run = ot.run(ball(**{"robot.kind": name_of(Shown), "run.time_limit": 0.1}))
    playback = RunPlayback(run)
    assert playback.status(2).title == "rolling"
    assert playback.first_plots == ("theta5",)
    assert playback.headline.keys() == set(RobotDisplay.headline)
    assert ot.render_frame(run, time=0.1, width=160, height=90).std() > 5


def test_figures_and_pages_show_what_the_robot_has(run):
    """Nine panels of its own channels, and a page that holds its bodies."""
    figure = ot.plot_summary(run)
    titles = " ".join(axis.get_title() + axis.get_ylabel() for axis in figure.axes)
    assert len(figure.axes) == 9
    assert "Force on the wall" in titles
    page = ot.render_replay(run)
    assert "wall_force" in page.html
    assert "chassis" in page.html


@pytest.mark.long
@needs_browser
def test_titles_of_plots_stand_on_one_line(tmp_path):
    """Also of a robot with a curve for each of its thirteen bodies, whose values are not told."""
    changes = {"robot": "snake", "start.distance": 0.3, "run.time_limit": 0.1}
    path = tmp_path / "snake.html"
    ot.render_replay(ot.run(ot.load_scenario("straight", changes)), path=path)
    with chromium() as browser, opened(browser, path) as page:
        code = "[...document.querySelectorAll('figure:not([hidden]) figcaption')]"
        heights = page.evaluate(f"{code}.map(title => title.offsetHeight)")
    assert len(heights) == 4
    assert max(heights) < 30


def test_the_command_tells_figures_of_the_robots_own(tmp_path):
    """`omnitrack run` and `compare` of another robot end without a word of modules."""
    changes = ["--set", "run.time_limit=0.3", "--set", "run.expected_outcome=timed_out"]
    folder = str(tmp_path / "a")
    told = omnitrack("run", "robots/presser_network", *changes, "--no-video", "--out", folder)
    assert told.returncode == 0, told.stderr
    assert "wall_force_max_n" in told.stdout
    assert "module" not in told.stdout
    again = omnitrack("compare", folder, folder, "--out", str(tmp_path / "both.png"))
    assert again.returncode == 0, again.stderr


def test_limbs_that_touch_each_other_are_no_misfit():
    """Only the wall is what a robot has to fit into."""
    assert ot.Simulation([ball(**{"robot.kind": name_of(Twins)})]).n == 1


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_know_no_robot_by_name(room):
    """No module of these rooms imports a folder of a robot, but for what is that robot's alone: its
    own senses, and driving it by hand."""
    alone = {"sim/onboard.py", "show/viewer/player.py"}
    package = Path(ot.__file__).parent
    folders = tuple(
        f"omnitrack_sim.robots.{path.name}"
        for path in (package / "robots").iterdir()
        if path.is_dir()
    )
    for path in sorted((package / room).rglob("*.py")):
        names = [
            node.module or ""
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom)
        ]
        known = [name for name in names if name.startswith(folders)]
        assert not known or path.relative_to(package).as_posix() in alone, (path, known)


@pytest.mark.parametrize("kind", [kind for kind in ROBOTS if kind != "mjcf"])
def test_channels_are_shown_by_names_and_units(kind):
    """A title begins with a capital letter, a unit is one of few."""
    units = {"1", "N", "N m", "code", "deg", "deg/s", "m", "m/s", "mm", "mm/s", "rad", "rad/s", "s"}
    for name, channel in robot_class(kind)().channels.items():
        assert channel.display.title[:1].isupper(), name
        assert channel.display.unit in units | {channel.unit}, name


@pytest.mark.parametrize("kind", ["omnitrack", "presser"])
def test_a_robot_is_written_with_its_tether_and_without_where_it_has_none(kind):
    """And with its kind, but for the one that is left out; it reads back as it was."""
    for tether in (None, ot.Tether(weight=2.0)):
        robot = robot_class(kind)(tether=tether)
        data = robot.model_dump(mode="json")
        assert ("tether" in data) == (tether is not None)
        assert data.get("kind") == (None if kind == "omnitrack" else kind)
        assert robot_class(kind)(**{k: v for k, v in data.items() if k != "kind"}) == robot


@pytest.mark.parametrize("factor", [0.1, 0.5, 1.0, 3.0])
def test_robots_are_similar_where_all_sizes_and_masses_are_scaled(factor, tmp_path):
    """By the bore's ratio and its cube; each may be off by a hundredth, also the lightest part."""

    def robot(scale: float, **off: float) -> ot.Mjcf:
        size, at, mass = (off.get(key, 1.0) for key in ("size", "at", "mass"))
        file = tmp_path / f"{scale}{off}.xml"
        file.write_text(
            "<mujoco><compiler boundmass='0' boundinertia='0'/><worldbody><body name='hull'>"
            f"<freejoint/><geom size='{0.04 * scale}' mass='{scale**3}'/>"
            f"<body pos='{0.05 * scale * at} 0 0'><joint/>"
            f"<geom size='{0.01 * scale * size}' mass='{0.01 * scale**3 * mass}'/>"
            "</body></body></worldbody></mujoco>"
        )
        return ot.Mjcf(file=str(file), bore=0.1 * scale)

    one = robot(1.0)
    assert is_similar(one, robot(factor))
    assert is_similar(one, robot(factor, size=1.005, at=0.995, mass=1.005))
    for what in ("size", "at", "mass"):
        assert not is_similar(one, robot(factor, **{what: 1.1}))


def test_shipped_robots_have_pages_and_names():
    """Each short name leads to a class that says the same name."""
    for kind in set(ROBOTS) - {"mjcf"}:
        bore = robot_class(kind)().nominal_bore
        scenario = validate(
            {
                "robot": kind,
                "pipes": [{"kind": "straight", "length": 1.5, "inner_diameter": bore}],
                "start": {"distance": 0.5},
            }
        )
        assert scenario.robot.kind == kind


@pytest.mark.parametrize("name", ["presser", "inchworm", "snake", "pirate", "helix"])
def test_robots_are_seated_at_rest_at_any_angle_about_the_pipe(name):
    """The held chassis takes what springs and servos push: no limb is left in motion, none deep in
    the wall, and the pose is the same turned about the pipe's axis."""
    turned = [
        ot.load_scenario(
            f"robots/{name}_tee", {"start.theta5_deg": angle, "world.gravity": (0, 0, 0)}
        )
        for angle in (0.0, 30.0, 200.0)
    ]
    simulation = ot.Simulation(turned)
    depths, joints = [], []
    for i in range(3):
        data = simulation.data(i)
        mujoco.mj_forward(simulation.model, data)
        depths.append(-data.contact.dist.min())
        joints.append(data.qpos[7:].copy())
    assert max(depths) < 0.0005
    assert np.allclose(joints[1:], joints[0], atol=0.02)


@pytest.mark.parametrize("name", ["straight", "robots/presser_tee"])
def test_a_saved_model_of_a_scenario_is_refused_without_the_package(name, tmp_path):
    """Its exact walls would be open air to a MuJoCo that does not know them."""
    path = tmp_path / "saved.xml"
    path.write_text(ot.load_scenario(name).to_spec().to_xml(), encoding="utf-8")
    code = f"import mujoco\nmujoco.MjModel.from_xml_path({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode != 0
    assert "plugin omnitrack_sim.walls not found" in done.stderr


@pytest.mark.parametrize("kind", [kind for kind in ROBOTS if kind != "mjcf"])
def test_every_joint_has_columns_of_its_own(kind):
    """One after the other, all that there are: also beside a joint without a name."""
    from omnitrack_sim.robots.scene import compiled

    robot = robot_class(kind)()
    columns = list(robot.joints.values())
    assert len(columns) == compiled(robot).njnt
    ends = [0, *(own.stop for own in columns)]
    assert [own.start for own in columns] == ends[:-1]
    assert ends[-1] == compiled(robot).nq == robot.joint_count
