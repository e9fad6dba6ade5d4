"""What is found in the model of a stranger's robot, and the scenario that is written from it."""

import json
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import strangers
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base import naming
from omnitrack_sim.cli import app
from omnitrack_sim.robots import model_look
from omnitrack_sim.robots.mjcf import Servo
from omnitrack_sim.robots.model_look import look_at
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.model_template import model_scenario

INERTIA = (
    '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="{1}" izz="{1}" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
WHEEL = (
    '<link name="rim_{0}">'
    + INERTIA.format(0.05, 2e-5)
    + '<collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="0.02" length="0.01"/>'
    '</geometry></collision></link><joint name="axle_{0}" type="continuous">'
    '<origin xyz="{1} {2} 0"/>'
    '<parent link="hull"/><child link="rim_{0}"/><axis xyz="0 1 0"/></joint>'
)
CART = (
    '<robot name="cart"><link name="hull">'
    + INERTIA.format(0.5, 1e-3)
    + '<collision><origin xyz="0 0 0.02"/><geometry><box size="0.12 0.03 0.02"/></geometry>'
    "</collision></link>"
    + "".join(
        WHEEL.format(f"{i}{k}", x, y)
        for i, x in enumerate((-0.04, 0.04))
        for k, y in enumerate((-0.025, 0.025))
    )
    + "</robot>"
)
"""On wheels below its hull, along x; without actuators."""
ARM = (
    "<body euler='0 0 {0}'><body pos='0.05 0 {1}'><joint name='{0}_{1}' axis='0 {2} 0'/>"
    "<geom type='cylinder' size='0.02 0.005' euler='90 0 0' mass='0.05'/></body></body>"
)
RING = ((0, 1), (120, -1), (240, 1))
WHEELS = [(angle, z, way) for z in (0.04, -0.04) for angle, way in RING]
SERVO = "<velocity joint='{0}_{1}' kv='1' {2}/>"
RINGED = (
    "<mujoco><option timestep='0.0005' integrator='implicitfast'/><worldbody><body name='hull'>"
    "<freejoint/><geom type='capsule' size='0.02 0.04' mass='0.3'/>"
    + "".join(ARM.format(*wheel) for wheel in WHEELS)
    + "</body></worldbody><actuator>"
    + "".join(
        SERVO.format(*wheel[:2], "gear='2'" if i == 1 else "") for i, wheel in enumerate(WHEELS)
    )
    + "</actuator></mujoco>"
)
"""Two rings of three wheels about its axis, z; some turn the other way, one is geared."""
DOG = (
    "<mujoco><worldbody><body name='trunk' pos='0 0 1'><freejoint/>"
    "<geom type='box' size='0.1 0.03 0.02'/>"
    + "".join(
        f"<body name='leg_{x}{y}' pos='{0.08 * x} {0.04 * y} 0'>"
        f"<joint name='hip_{x}{y}' axis='0 1 0' range='-60 60' damping='0.01'/>"
        "<geom type='capsule' size='0.01' fromto='0 0 0 0 0 -0.08'/>"
        "</body>"
        for x in (-1, 1)
        for y in (-1, 1)
    )
    + "</body></worldbody><actuator>"
    + "".join(
        f"<position joint='hip_{x}{y}' kp='3' dampratio='1' ctrlrange='-1 1'/>"
        for x in (-1, 1)
        for y in (-1, 1)
    )
    + "</actuator></mujoco>"
)


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mine_control", raising=False)
    monkeypatch.setattr(naming, "_FOLDERS", [])


def new(text, name, *arguments):
    """The output of ``omnitrack new mine --robot`` for a model of this text."""
    Path(name).write_text(text)
    result = CliRunner().invoke(app, ["new", "mine", "--robot", name, *arguments])
    if result.exception is not None:
        raise result.exception
    return result.stdout


def driven(seconds=1.0):
    """Result of the scenario that was written."""
    return ot.run(ot.load_scenario("mine.toml", {"run.time_limit": seconds}), no_load=False)


def started(scenario):
    """MuJoCo's data of a robot at its start."""
    sim = ot.Simulation([scenario])
    data = sim.data(0)
    mujoco.mj_kinematics(sim.model, data)
    return data


def test_a_urdf_of_a_cart_drives_in_its_pipe():
    """Wheels, the axis that they roll along, its bore, and motors; it stands on its wheels, and
    moves on by what was found, under the controller that was written beside it."""
    assert new(CART, "cart.urdf").startswith("wrote mine.toml and mine_control.py")
    data = tomllib.loads(Path("mine.toml").read_text())
    assert data["robot"]["forward"] == "x"
    assert data["control"]["kind"] == "mine_control:Controller"
    assert [servo["joints"] for servo in data["robot"]["servos"]] == ["axle_*"]
    assert len(set(data["control"]["parameters"]["inputs"].values())) == 1
    way, speed = data["pipes"][0]["length"], data["robot"]["bore"] / 5
    assert data["run"]["time_limit"] == pytest.approx(1.5 * way / speed, rel=0.01)
    result = driven()
    assert [str(event) for event in result.events if "stiffer" in str(event)] == []
    assert result.metrics["distance_m"] > 0.6 * result.scenario.robot.nominal_speed
    assert result.trajectory["tilt"].max() < 0.1
    top = started(result.scenario).body("hull").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(top, [0, 0, 1], atol=1e-6)


def test_wheels_about_the_axis_drive_to_the_nose():
    """Whichever way they turn and are geared; the time step is the file's own."""
    new(RINGED, "ringed.xml")
    data = tomllib.loads(Path("mine.toml").read_text())
    assert data["robot"]["forward"] == "z"
    assert data["robot"]["bore"] == pytest.approx(0.141, abs=0.002)
    assert data["physics"]["timestep"] == 0.0005
    first, second, third, *_ = data["control"]["parameters"]["inputs"].values()
    assert abs(first) == pytest.approx(0.2 * data["robot"]["bore"] / 0.02, rel=0.01)
    assert second == pytest.approx(-2 * first)
    assert third == first
    assert driven().metrics["distance_m"] > 0.4 * data["robot"]["bore"] / 5


def test_legs_swing_about_where_they_are():
    """A robot without wheels has its longer level side along the pipe, its back up, and legs that
    move from the start on, none beyond its range."""
    new(DOG, "dog.xml")
    scenario = ot.load_scenario("mine.toml")
    assert scenario.robot.forward == "x"
    top = started(scenario).body("trunk").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(top, [0, 0, 1], atol=1e-3)
    result = driven(2.0)
    swing = np.ptp(result.trajectory["ctrl"], axis=0)
    assert (swing > 0.3).all()
    assert np.abs(result.trajectory["ctrl"]).max() < 1.0


def test_the_bore_is_that_of_the_narrowest_pipe():
    """With 5 % of play, about the middle of the cross section, which need not be the chassis' own
    axis; at rest as well, when springs have moved limbs out."""
    two = (
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.02'/>"
        "<geom size='0.02' pos='0.2 0.1 0'/><geom size='0.02' pos='0.1 0.1 0'/>{0}</body>"
        "</worldbody></mujoco>"
    )
    Path("two.xml").write_text(two.format(""))
    found = look_at("two.xml").robot
    assert found.bore == pytest.approx(1.05 * 0.14, rel=0.01)
    np.testing.assert_allclose(found.centre, [0, 0.05, 0], atol=1e-3)
    assert found.length == pytest.approx(0.24)
    sprung = (
        "<body pos='0 0.05 0'><joint type='slide' axis='0 0 1' stiffness='50' damping='2' "
        "springref='0.1'/><geom size='0.01' mass='0.01'/></body>"
    )
    Path("two.xml").write_text(two.format(sprung))
    assert look_at("two.xml").robot.bore > 0.2


def test_the_axis_of_a_robot_may_be_beside_its_chassis():
    """The robot's middle is where ``centre`` is, in a start and in what is measured."""
    Path("ball.xml").write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/>"
        "<geom name='ball' size='0.03' pos='0 0.1 0.02'/></body></worldbody></mujoco>"
    )
    pipes = [{"kind": "straight", "length": 0.6, "inner_diameter": 0.1}]
    robot = {"kind": "mjcf", "file": "ball.xml", "centre": [0.5, 0.1, 0.02], "forward": "x"}
    start = {"distance": 0.3, "axis": [1, 0, 0]}
    scenario = validate({"pipes": pipes, "robot": robot, "start": start})
    place = ot.Simulation([scenario]).readings["position"][0]
    np.testing.assert_allclose(place, [0.3, 0, 0], atol=1e-12)
    np.testing.assert_allclose(started(scenario).geom("ball").xpos, [0.3, 0, 0], atol=1e-12)
    assert scenario.robot.nominal_bore == pytest.approx(0.06)


def test_servos_of_position_hold_the_pose_of_the_file():
    """At the start each is asked for where it is; others for nothing."""
    Path("bent.xml").write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.03'/><body>"
        "<joint name='hip' ref='40'/><geom size='0.01'/></body></body></worldbody>"
        "<actuator><position joint='hip' kp='2'/><velocity joint='hip' kv='1'/>"
        "<position joint='hip' kp='2' ctrlrange='-0.5 0.5'/>"
        "<general joint='hip' gainprm='2' biastype='affine' biasprm='1 -4'/></actuator></mujoco>"
    )
    angle = np.radians(40)
    expected = [angle, 0, 0.5, (4 * angle - 1) / 2]
    np.testing.assert_allclose(ot.Mjcf(file="bent.xml").start_ctrl, expected)


def test_physics_that_diverges_before_the_start_ends_the_run():
    """With that outcome, and not as a robot that does not fit or that has slid back; the time step
    that is written is one at which it does not."""
    Path("stiff.xml").write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.03'/><body>"
        "<joint name='hip' stiffness='1' springref='60'/>"
        "<geom size='0.001' pos='0.02 0 0' mass='1e-3'/></body></body></worldbody></mujoco>"
    )
    scenario = model_scenario("stiff.xml", {"run.time_limit": 0.1})
    assert scenario.physics.timestep == 0.001
    assert ot.run(scenario).outcome is ot.Outcome.TIMED_OUT
    coarse = ot.override(scenario, {"physics.timestep": 0.002})
    assert ot.run(coarse).outcome is ot.Outcome.DIVERGED


@pytest.mark.parametrize(
    ("names", "grouped"),
    [
        (("axle_1", "axle_2"), ("axle_*",)),
        (("axle_1", "axle_2", "axle_3"), ("axle_*",)),
        (("left_axle", "right_axle"), ("*t_axle",)),
        (("axle_1",), ("axle_1",)),
        (("axle_1", "axle_2", "axle_tail!"), ("axle_1", "axle_2", "axle_tail!")),
    ],
)
def test_servos_that_are_alike_are_one_where_a_pattern_fits_them_alone(names, grouped):
    """The last one, marked, is another servo whose joint the pattern would fit as well."""
    servos = tuple(
        Servo(joints=name.rstrip("!"), kind="velocity", gain=2.0 if "!" in name else 1.0)
        for name in names
    )
    found = [servo.joints for servo in model_look._grouped(servos)]
    assert found == [name.rstrip("!") for name in grouped]


def test_a_robot_that_never_comes_to_rest_is_looked_at_as_its_file_has_it(monkeypatch):
    """With the time step of its file: no step is known to be better."""
    Path("still.xml").write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.03'/></body></worldbody>"
        "</mujoco>"
    )
    known = look_at("still.xml")
    monkeypatch.setattr(model_look, "_settled", lambda *_: None)
    assert look_at("still.xml").robot == known.robot
    assert look_at("still.xml").timestep == known.timestep


def test_a_coarser_time_step_than_the_files_own_is_told_of():
    """From one and a half times on."""
    Path("fine.xml").write_text(
        "<mujoco><option timestep='0.001'/><worldbody><body name='hull'><freejoint/>"
        "<geom size='0.03'/></body></worldbody></mujoco>"
    )
    scenario = model_scenario("fine.xml", {"run.time_limit": 0.02})
    for step, told in ((0.001, False), (0.002, True)):
        events = ot.run(ot.override(scenario, {"physics.timestep": step})).events
        assert any("time step of 0.001 s" in str(event) for event in events) == told


def test_a_lever_is_no_wheel_and_a_cube_has_its_x_axis_forward():
    """What turns without end is a wheel if it is round about its axle; an axis that is hardly
    longer than another is not the forward one, and a centre that is hardly off is the chassis'."""
    Path("cube.xml").write_text(
        "<mujoco><worldbody><body name='hull'><freejoint/>"
        "<geom type='box' size='0.05 0.05 0.054' pos='0 0 0.0005'/><body><joint name='crank'/>"
        "<geom type='capsule' size='0.01' fromto='-0.02 0 0 0.02 0 0'/></body></body></worldbody>"
        "</mujoco>"
    )
    look = look_at("cube.xml")
    assert look.wheels == ()
    assert look.robot.forward == "x"
    assert look.robot.centre == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("height", "round_"), [(0.02, True), (0.0175, False)])
def test_a_wheel_of_a_mesh_is_round(height, round_):
    """An oval of the same width, which would hop, is none."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([0.02 * np.cos(angles), height * np.sin(angles)], axis=-1)
    corners = [(*point, z) for z in (-0.005, 0.005) for point in ring.tolist()]
    vertices = " ".join(map(str, np.ravel(corners)))
    Path("tyre.xml").write_text(
        f"<mujoco><asset><mesh name='tyre' vertex='{vertices}'/></asset>"
        "<worldbody><body name='hull'><freejoint/><geom size='0.02'/><body pos='0 0 -0.02'>"
        "<joint name='axle'/><geom type='mesh' mesh='tyre'/></body></body></worldbody></mujoco>"
    )
    wheels = look_at("tyre.xml").wheels
    assert [wheel.joint for wheel in wheels] == ["axle"] * round_
    assert all(wheel.radius == pytest.approx(0.02) for wheel in wheels)


def test_servos_that_are_added_carry_the_robots_weight():
    """A wheel drives with the weight at its rim; a joint holds the weight at the wall, 0.2 rad off,
    but is no stiffer than its own inertia allows; limits of the file stay."""
    finger = (
        '<link name="tip">{0}<collision><geometry><sphere radius="0.005"/></geometry></collision>'
        '</link><joint name="bend" type="revolute"><limit lower="-1" upper="1" effort="{1}" '
        'velocity="1"/><parent link="hull"/><child link="tip"/><axis xyz="0 1 0"/></joint></robot>'
    )
    weight = 9.81 * 0.7
    for inertia, effort, gain in ((1e-2, 7, 1.0), (1e-5, 0.5, None)):
        text = CART.replace("</robot>", finger.format(INERTIA.format(1e-9, inertia), effort))
        Path("cart.urdf").write_text(text)
        robot = look_at("cart.urdf").robot
        servos = {servo.joints: servo for servo in robot.servos}
        wheel, bend = servos["axle_*"], servos["bend"]
        assert wheel.limit == pytest.approx(weight * 0.02, rel=0.01)
        slow = 0.2 * robot.nominal_speed / 0.02
        assert wheel.gain * slow == pytest.approx(wheel.limit, rel=0.01)
        assert bend.limit is None
        carried = weight * robot.bore / 2 / 0.2
        stiffest = inertia * 125**2
        assert bend.gain == pytest.approx(carried if gain else stiffest, rel=0.02)


def test_neither_file_is_overwritten():
    """Of the two that are written."""
    for taken in ("mine.toml", "mine_control.py"):
        Path(taken).write_text("mine")
        with pytest.raises(ot.OutputError, match=f"{taken}: exists already"):
            new(CART, "cart.urdf")
        assert sorted(p.name for p in Path().iterdir()) == sorted(["cart.urdf", taken])
        Path(taken).unlink()


def test_all_keys_are_written_from_it_wherever_the_file_stands():
    """`omnitrack new --from` leads to the model from another folder, and reads as the same run."""
    new(CART, "cart.urdf")
    Path("sub").mkdir()
    CliRunner().invoke(app, ["new", "sub/all", "--from", "mine.toml"], catch_exceptions=False)
    same = ot.load_scenario("sub/all.toml").model_dump(exclude={"name"})
    assert same == ot.load_scenario("mine.toml").model_dump(exclude={"name"})
    assert "../cart.urdf" in Path("sub/all.toml").read_text()


def test_a_chassis_is_named_where_several_could_be_it():
    """Without a name the file is refused with the choices."""
    body = "<body name='{0}' pos='0 {1} 0'><freejoint/><geom size='0.03'/></body>"
    text = f"<mujoco><worldbody>{body.format('one', 0)}{body.format('two', 1)}</worldbody></mujoco>"
    with pytest.raises(ot.InputError, match="one, two; name the one that is"):
        new(text, "twins.xml")
    new(text, "twins.xml", "--body", "two")
    assert ot.load_scenario("mine.toml").robot.chassis == "two"
    assert model_scenario("twins.xml", {"robot.body": "one"}).robot.chassis == "one"


def test_the_survey_runs_models_of_a_folder_or_says_why_not():
    """Of files of models, not of parts of them; a model that is refused has its sentence."""
    Path("part.xml").write_text("<mujocoinclude><body/></mujocoinclude>")
    Path("colours.xml").write_text("<mujoco><asset/></mujoco>")
    Path("a.urdf").write_text(CART)
    Path("b.xml").write_text(
        "<mujoco><worldbody><body name='pole'><joint name='pin'/><geom size='0.1'/></body>"
        "</worldbody><actuator><motor joint='pin'/></actuator></mujoco>"
    )
    files = [*strangers.models_in([Path()])]
    assert [file.name for file in files] == ["a.urdf", "b.xml"]
    cart, pole = (strangers.answer(file, 0.1) for file in files)
    assert (cart.runs, cart.words, cart.inputs) == (True, "timed_out", 4)
    assert not pole.runs
    assert pole.words.startswith("'pole' hangs on the world by the joint 'pin'")
    assert "given" not in pole.words


def test_the_parameters_of_a_model_file_are_those_of_its_run():
    """Axis, bore and servos as they are found; as JSON and in a table of 80 columns, in which names
    are parted behind dots only."""
    Path("cart.urdf").write_text(CART.replace("axle_00", "front_left_suspension"))
    told = CliRunner().invoke(app, ["parameters", "cart.urdf", "--json"], catch_exceptions=False)
    rows = {row["name"]: row["value"] for row in json.loads(told.stdout)}
    robot = model_scenario("cart.urdf").robot
    assert isinstance(robot, ot.Mjcf)
    assert (rows["forward"], rows["bore"]) == (robot.forward, robot.bore) == ("x", robot.bore)
    servo = robot.servos[0]
    assert rows["servos.0.kind"] == servo.kind == "velocity"
    assert rows["servos.0.gain"] == servo.gain
    table = CliRunner().invoke(app, ["parameters", "cart.urdf"], env={"COLUMNS": "80"})
    firsts = {line.strip().split(" ")[0] for line in table.stdout.splitlines()}
    assert {"joint.", "front_left_suspension.", "stiffness", "damping"} <= firsts


def test_a_model_file_is_run_as_it_is():
    """`omnitrack run` puts it into the pipe that would be written; options change that."""
    Path("my_cart.urdf").write_text(CART)
    arguments = ["run", "my_cart.urdf", "--no-video", "--json", "--set", "run.time_limit=0.1"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    saved = ot.load_result("out/my_cart")
    assert saved.scenario.control.kind == "periodic"
    assert saved.duration_s == pytest.approx(0.1)
    with pytest.raises(ot.InputError, match=r"^lost.urdf: cannot be read: no such file"):
        CliRunner().invoke(app, ["run", "lost.urdf"], catch_exceptions=False)
