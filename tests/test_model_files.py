"""Robots of files that were made for a world of their own: what is left out, mended and refused."""

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots.model_file import robot_model
from omnitrack_sim.scenario.loading import validate

FLOOR = "<light/><geom name='floor' type='plane' size='0 0 1'/>"
BALL = "<geom name='skin' size='0.04' mass='0.5'/>"
URDF = """<robot name="cart">
<link name="base"/>
<link name="hull"><inertial><mass value="1"/><inertia ixx="{ixx}" iyy="1e-3" izz="1e-3"
 ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.06 0.02 0.02"/></geometry></collision></link>
<joint name="weld" type="fixed"><parent link="base"/><child link="hull"/></joint>
<link name="rim"><inertial><mass value="0.1"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"
 ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="axle" type="continuous"><origin xyz="0.03 0 -0.01"/><parent link="hull"/>
<child link="rim"/><axis xyz="0 1 0"/></joint></robot>"""


def mjcf(world, more=""):
    """An MJCF model."""
    return f"<mujoco><worldbody>{world}</worldbody>{more}</mujoco>"


def written(text, name="robot.xml"):
    """Return the name of a file with a text."""
    Path(name).write_text(text)
    return name


def in_a_pipe(file, bore=0.1, **robot):
    """Scenario of a robot in a straight along its x axis, wide enough."""
    return validate(
        {
            "robot": {"kind": "mjcf", "file": file, "forward": "x", "bore": bore, **robot},
            "start": {"distance": 0.3, "axis": [1, 0, 0]},
            "run": {"time_limit": 0.1},
            "pipes": [{"kind": "straight", "length": 0.6, "inner_diameter": bore}],
        }
    )


def compiled(file, body=""):
    """The robot of a file, compiled."""
    return robot_model(file, body).spec.compile()


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_what_else_is_in_the_world_is_left_out_and_named():
    """A floor, a light, a camera, a static body, and what refers to them; the run tells which."""
    world = (
        f"{FLOOR}<camera name='side' mode='targetbody' target='hull'/><site name='goal'/>"
        "<body name='table'><geom size='0.3'/></body>"
        f"<body name='hull' pos='0 0 3'><freejoint/>{BALL}<site name='eye'/></body>"
    )
    more = (
        "<contact><pair geom1='floor' geom2='skin'/></contact>"
        "<tendon><spatial name='leash'><site site='goal'/><site site='eye'/></spatial></tendon>"
        "<actuator><motor name='winch' tendon='leash'/></actuator>"
        "<sensor><framepos name='aim' objtype='site' objname='goal'/>"
        "<actuatorfrc name='pull' actuator='winch'/><gyro name='spin' site='eye'/></sensor>"
    )
    scenario = in_a_pipe(written(mjcf(world, more)))
    model = scenario.to_spec().compile()
    assert model.nbody == 2
    assert model.nu == model.ntendon == model.npair == 0
    assert model.ncam == model.nlight == 0
    (note,) = [str(event) for event in ot.run(scenario).events if "left out" in str(event)]
    names = ("floor", "side", "goal", "table", "leash", "winch", "aim", "pull")
    assert all(repr(name) in note for name in names)
    assert "'spin'" not in note


def test_a_robot_alone_stays_as_it_is():
    """Nothing is told, and the model has the bytes of the file's own."""
    file = written(mjcf(f"<body name='hull'><freejoint/>{BALL}</body>"))
    robot = robot_model(file)
    assert robot.changes == ()
    assert robot.root == "hull"
    models = robot.spec.compile(), mujoco.MjModel.from_xml_path(file)
    sizes = [mujoco.mj_sizeModel(model) for model in models]
    own, its = (np.zeros(size, np.uint8) for size in sizes)
    mujoco.mj_saveModel(models[0], None, own)
    mujoco.mj_saveModel(models[1], None, its)
    assert own.tobytes() == its.tobytes()


def test_a_model_without_a_free_joint_gets_one():
    """On the body that carries the tree, in the place of joints that let it move in a plane; what
    referred to those goes with them, and saved positions, which had other joints."""
    planar = (
        "<joint name='rootx' type='slide' axis='1 0 0'/><joint name='rooty' axis='0 1 0'/>"
        f"{BALL}<body pos='0.05 0 0'><joint name='hip'/><geom size='0.01'/></body>"
    )
    more = (
        "<actuator><motor joint='hip'/></actuator>"
        "<sensor><jointpos name='way' joint='rootx'/><jointpos joint='hip'/></sensor>"
        "<keyframe><key name='home' qpos='1 0 0.2'/></keyframe>"
    )
    for inside, count in ((planar, 7 + 1), (BALL, 7)):
        file = written(mjcf(f"{FLOOR}<body name='hull'>{inside}</body>", more * (inside != BALL)))
        model = compiled(file)
        assert model.nq == count
        assert model.body("hull").dofnum[0] == 6
        assert model.nkey == 0
        assert model.nsensor == (inside != BALL)
        assert "free joint was put on 'hull'" in robot_model(file).changes[-1]
    assert ot.run(in_a_pipe(file)).outcome.value == "timed_out"


def test_a_free_joint_has_a_name_of_its_own():
    """Where others have the name that it would get, with the first number that none has."""
    for taken in ((), ("",), ("", "_2", "_3")):
        axes = zip(taken, ("1 0 0", "0 1 0", "0 0 1"), strict=False)
        joints = "".join(f"<joint name='hull_free{end}' axis='{axis}'/>" for end, axis in axes)
        limb = f"<body pos='0.05 0 0'>{joints}<geom size='0.01'/></body>"
        model = compiled(written(mjcf(f"<body name='hull'>{BALL}{limb}</body>")))
        number = f"_{len(taken) + 1}" if taken else ""
        assert model.joint(f"hull_free{number}").type[0] == mujoco.mjtJoint.mjJNT_FREE


def test_a_joint_to_the_world_that_is_driven_is_no_free_robot():
    """What pushes a cart along its rail has nothing to push it from in a pipe."""
    world = f"<body name='cart'><joint name='rail' type='slide'/>{BALL}</body>"
    file = written(mjcf(world, "<actuator><motor joint='rail'/></actuator>"))
    with pytest.raises(ot.ScenarioError, match=r"robot.file: .*'rail', which is driven: hang it"):
        in_a_pipe(file)


def test_of_several_bodies_the_robot_is_the_driven_one():
    """Things to push are left out; of two robots one has to be named, and is then taken."""
    robot = (
        "<body name='{0}' pos='0 {1} 0'><freejoint/><geom size='0.03'/>"
        "<body><joint name='hip_{0}'/><geom size='0.02'/></body></body>"
    )
    ball = "<body name='ball' pos='1 0 0'><freejoint/><geom size='0.1'/></body>"
    world = f"{ball}{robot.format('one', 0)}{robot.format('two', 1)}"
    one, two = (f"<motor joint='hip_{name}'/>" for name in ("one", "two"))
    alone = written(mjcf(world, f"<actuator>{two}</actuator>"))
    assert robot_model(alone).root == "two"
    assert compiled(alone).nbody == 3
    both = written(mjcf(world, f"<actuator>{one}{two}</actuator>"))
    with pytest.raises(ot.ScenarioError, match=r"robot.body: 2 bodies .*: one, two; name"):
        in_a_pipe(both)
    chosen = in_a_pipe(both, body="one").robot
    assert chosen.chassis == "one"
    assert len(chosen.channels["ctrl"].names) == 1
    nothing = written(mjcf(f"{FLOOR}<body name='stand' mocap='true'><geom size='1'/></body>"))
    with pytest.raises(ot.ScenarioError, match=r"robot.file: .*no body that could be the robot"):
        in_a_pipe(nothing)


def test_what_touched_the_floor_touches_the_wall():
    """By bits that the walls of other robots do not have, and by pairs with the floor alone."""
    ball = "<body name='hull'><freejoint/><geom name='skin' size='0.04' {0}/></body>"
    pair = "<contact><pair geom1='floor' geom2='skin'/></contact>"
    for bits, more in (("contype='4' conaffinity='8'", ""), ("contype='0' conaffinity='0'", pair)):
        file = written(mjcf(FLOOR + ball.format(bits), more))
        result = ot.run(in_a_pipe(file, bore=0.081))
        assert result.trajectory["wall_force"].max() > 0.1
    file = written(mjcf(FLOOR + ball.format("contype='0' conaffinity='0'")))
    with pytest.raises(ot.ScenarioError, match=r"robot.file: .*nothing of it can touch a wall"):
        in_a_pipe(file)


def test_a_robot_meets_walls_and_gravity_whatever_its_file_disables():
    """Flags that a robot on show, or in water, has."""
    world = f"<body name='hull'><freejoint/>{BALL}</body>"
    flags = "<option><flag contact='disable' constraint='disable' gravity='disable'/></option>"
    file = written(f"<mujoco>{flags}<worldbody>{world}</worldbody></mujoco>")
    result = ot.run(in_a_pipe(file, bore=0.081))
    assert result.trajectory["wall_force"].max() > 0.1
    assert any("contact, constraint, gravity" in str(event) for event in result.events)


def test_walls_of_a_run_are_as_firm_as_ever_whatever_the_files_defaults():
    """The default class of a model is for its own geoms, not for the pipe's."""
    defaults = "<default><geom solimp='0.2 0.2 0.1' margin='0.01' gap='0.005'/></default>"
    ball = f"<worldbody><body name='hull'><freejoint/>{BALL}</body></worldbody>"
    model = in_a_pipe(written(f"<mujoco>{defaults}{ball}</mujoco>")).to_spec().compile()
    wall = model.geom("wall_straight_0")
    np.testing.assert_array_equal(wall.solimp, [0.9, 0.95, 0.001, 0.5, 2.0])
    assert (wall.margin[0], wall.gap[0]) == (0.0, 0.0)
    assert model.geom("skin").margin[0] == 0.01


def test_a_robot_that_bends_has_not_left_the_pipe():
    """The point half-way to the end of a leg goes through the wall where the chassis turns and the
    leg does not; the run goes on, as the chassis lies in the pipe."""
    world = (
        f"<body name='hull'><freejoint/>{BALL}<body name='leg'><joint name='hip' axis='0 1 0'/>"
        "<geom size='0.01' pos='0.5 0 0' mass='0.01'/></body></body>"
    )
    changes = {"pipes.0.length": 1.5, "run.time_limit": 0.3, "monitor.slide_back": 1.0}
    scenario = ot.override(in_a_pipe(written(mjcf(world))), changes)
    sim = ot.Simulation([scenario])
    sim.plant.qpos[0, 3:7] = [0.5**0.5, 0, 0.5**0.5, 0]
    sim.plant.qpos[0, 7] = -np.pi / 2
    sim.step()
    assert abs(sim.readings["position"][0, 2]) > 0.2
    assert sim.active.all()
    sim.plant.qpos[0, 2] += 1.0
    sim.step()
    assert sim.endings[0].outcome.value == "left_pipe"


def test_a_sensor_with_the_name_of_a_channel_does_not_take_its_place():
    """``position`` stays that of the robot's middle, and the sensor is ``sensor_position``."""
    world = f"<body name='hull' pos='0 0 5'><freejoint/>{BALL}<site name='s'/></body>"
    sensors = (
        "<framepos name='position' objtype='body' objname='hull'/><gyro name='tilt' site='s'/>"
    )
    text = mjcf(world, f"<sensor>{sensors}</sensor>")
    trajectory = ot.run(in_a_pipe(written(text))).trajectory
    assert trajectory["position"][0] == pytest.approx([0.3, 0, 0], abs=1e-6)
    assert trajectory["tilt"].shape == trajectory.time.shape
    assert trajectory["sensor_position"][0] == pytest.approx([0.3, 0, 0], abs=1e-3)
    assert trajectory["sensor_tilt"].shape == (len(trajectory.time), 3)


@pytest.mark.parametrize("free", ["<freejoint/>", "<joint type='slide'/>"])
def test_a_robot_begins_in_a_keyframe_of_its_file(free):
    """Joints and inputs are those that were saved, by their names, whatever else is in the world;
    its size is that of this state."""
    world = (
        "<body name='ball'><freejoint/><geom size='0.1'/></body>"
        f"<body name='hull'>{free}{BALL}<body><joint name='hip' axis='0 1 0' damping='1'/>"
        "<geom size='0.01' pos='0.06 0 0'/></body></body>"
    )
    own = "0 0 0 1 0 0 0" if free == "<freejoint/>" else "0"
    more = (
        "<actuator><velocity name='turn' joint='hip' kv='0'/>"
        "<position name='swing' joint='hip' kp='1'/></actuator><keyframe>"
        f"<key name='up' qpos='0 0 0 1 0 0 0 {own} 1.5708' ctrl='0.2 1.5708'/></keyframe>"
    )
    file = written(mjcf(world, more))
    straight, up = (in_a_pipe(file, bore=0.2, keyframe=name) for name in ("", "up"))
    assert straight.robot.length == pytest.approx(0.11)
    assert up.robot.length == pytest.approx(0.08)
    result = ot.run(up)
    assert result.qpos[0, result.joints["hip"]] == pytest.approx(1.5708, abs=0.01)
    assert result.trajectory["ctrl"][0] == pytest.approx([0.2, 1.5708])
    with pytest.raises(ot.ScenarioError, match=r"robot.keyframe: .*'down' \(choose from: up\)"):
        in_a_pipe(file, keyframe="down")


def test_lengths_of_fifty_metres_are_asked_about():
    """A robot in millimetres is wider than any pipe."""
    file = written(mjcf(f"{FLOOR}<body><freejoint/><geom size='25'/></body>"))
    with pytest.raises(ot.ScenarioError, match=r"robot.file: .*50 m long: is it in millimetres\?"):
        in_a_pipe(file)


def test_what_a_model_is_made_of_stays():
    """Include, default classes, a keyframe, tendon and equality of the robot's own, a mocap body
    and a mesh beside the file: the robot runs, and keeps what is its own."""
    Path("parts").mkdir()
    corners = " ".join(str(0.03 * (2 * (i >> k & 1) - 1)) for i in range(8) for k in range(3))
    faces = "0 2 1 1 2 3 4 5 6 5 7 6 0 1 4 1 5 4 2 6 3 3 6 7 0 4 2 2 4 6 1 3 5 3 7 5"
    vertices = np.array(corners.split(), float).reshape(8, 3)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [
        "f " + " ".join(str(int(v) + 1) for v in faces.split()[i : i + 3]) for i in range(0, 36, 3)
    ]
    Path("parts/stone.obj").write_text("\n".join(lines))
    Path("defaults.xml").write_text(
        "<mujoco><default><default class='leg'><joint range='-20 20' damping='0.01'/>"
        "<geom size='0.01'/></default></default></mujoco>"
    )
    legs = "".join(
        f"<body name='{name}' pos='{x} 0 0' childclass='leg'><joint name='{name}' axis='0 1 0'/>"
        "<geom/></body>"
        for name, x in (("front", 0.04), ("rear", -0.04))
    )
    text = (
        "<mujoco><include file='defaults.xml'/><compiler meshdir='parts'/>"
        "<asset><mesh name='stone' file='stone.obj'/></asset><worldbody>"
        f"{FLOOR}<body name='hand' mocap='true'><geom size='0.01'/></body>"
        f"<body name='hull'><freejoint/><geom type='mesh' mesh='stone'/>{legs}</body></worldbody>"
        "<equality><weld body1='hand' body2='hull'/><joint joint1='front' joint2='rear'/>"
        "</equality><tendon><fixed name='both'><joint joint='front' coef='1'/>"
        "<joint joint='rear' coef='1'/></fixed></tendon>"
        "<actuator><position name='swing' tendon='both' kp='1'/></actuator>"
        "<keyframe><key name='home' mpos='0 0 1' qpos='0 0 0 1 0 0 0 0.1 0.1'/></keyframe></mujoco>"
    )
    file = written(text)
    scenario = in_a_pipe(file, bore=0.12)
    model = scenario.to_spec().compile()
    assert (model.neq, model.ntendon, model.nu, model.nmocap, model.nmesh) == (1, 1, 1, 0, 1)
    np.testing.assert_allclose(model.joint("front").range, np.radians([-20, 20]))
    assert ot.run(scenario).outcome.value == "timed_out"


def test_a_urdf_is_a_robot():
    """Its links that are fixed to each other are one body, and it is free; an inertia that no body
    has is changed, which is told."""
    file = written(URDF.format(ixx="1e-3"), "cart.urdf")
    scenario = validate(
        {
            "robot": file,
            "start": {"distance": 0.3},
            "run": {"time_limit": 0.1},
            "pipes": [{"kind": "straight", "length": 0.6}],
        }
    )
    assert scenario.robot.chassis == "base"
    assert scenario.robot.mass == pytest.approx(1.1)
    assert [*scenario.robot.joints] == ["base_free", "axle"]
    assert ot.run(scenario).outcome.value == "timed_out"
    for ixx in ("1", "0"):
        robot = robot_model(written(URDF.format(ixx=ixx), "cart.urdf"))
        assert robot.changes[0] == "inertias that no body has were changed, of hull"
        assert robot.spec.compile().body("base").mass == pytest.approx(1.0)


@pytest.mark.parametrize("inertia", ["1e-5", "0"])
def test_a_link_without_mass_weighs_what_its_geoms_do(inertia):
    """Of a URDF, at the density of water, whatever inertia it states; that is told."""
    text = URDF.format(ixx="1e-3").replace('<mass value="0.1"/>', '<mass value="0"/>')
    robot = robot_model(written(text.replace("1e-5", inertia), "cart.urdf"))
    assert robot.changes[0] == "inertias that no body has were changed, of rim"
    model, mass = robot.spec.compile(), 1000 * 4 / 3 * np.pi * 0.02**3
    assert model.body("rim").mass == pytest.approx(mass)
    assert model.body("rim").inertia == pytest.approx(np.full(3, 0.4 * mass * 0.02**2))


def level(height):
    """A level pipe of 160 mm whose axis lies at a height, m."""
    return ot.Network(
        place={"axis": (1, 0, 0), "position": (0, 0, height)},
        fittings=[{"kind": "straight", "name": "pipe", "length": 1}],
    )


def test_the_robot_of_a_file_is_put_into_pipes_that_mujoco_steps():
    """Of a URDF and of MJCF, also of a specification that has been compiled already."""
    for text, name in (
        (URDF.format(ixx="1e-3"), "cart.urdf"),
        (mjcf(f"{FLOOR}<body name='base'><freejoint/>{BALL}</body>"), "ball.xml"),
    ):
        spec = ot.Mjcf(file=written(text, name)).spec()
        spec.compile()
        pipes = ot.add_pipes(spec, level(0.0), friction=0.8)
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[0] = 0.5
        mujoco.mj_step(model, data, 500)
        assert 0 < pipes.clearance(data.body("base").xpos) < 0.08


@pytest.mark.parametrize(("height", "told"), [(0.0, True), (0.2, False)])
def test_a_floor_in_the_pipes_is_told_of(height, told):
    """A plane that pipes stand on is not."""
    spec = mujoco.MjSpec.from_string(mjcf(FLOOR))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ot.add_pipes(spec, level(height))
    assert [("'floor'" in str(warning.message)) for warning in caught] == [True] * told


def test_meshes_of_packages_are_found_in_the_folders_above():
    """``package://`` is what ROS calls the folder of a package."""
    folder = Path("share/cart/urdf")
    folder.mkdir(parents=True)
    (folder.parent / "skin.obj").write_text(
        "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    text = URDF.format(ixx="1e-3")
    mesh = text.replace('<sphere radius="0.02"/>', '<mesh filename="package://cart/skin.obj"/>')
    file = written(mesh, folder / "cart.urdf")
    assert compiled(str(file)).nmesh == 1
    lost = written(mesh.replace("skin.obj", "lost.obj"), folder / "lost.urdf")
    with pytest.raises(ot.ScenarioError, match=r"robot.file: mesh 'package://cart/lost.obj' is"):
        in_a_pipe(str(lost))


def test_a_height_field_of_the_robot_is_refused():
    """It would pass through the walls."""
    text = mjcf(
        "<body><freejoint/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
        "<geom name='relief' type='hfield' hfield='h'/></body>",
        "<asset><hfield name='h' nrow='2' ncol='2' size='.1 .1 .1 .1' elevation='0 1 1 0'/>"
        "</asset>",
    )
    with pytest.raises(ot.ScenarioError, match=r"robot.file: geom 'relief' is a height field"):
        in_a_pipe(written(text))


@pytest.mark.parametrize(
    ("name", "text", "hint"),
    [
        ("part.xml", "<mujocoinclude/>", "name the file that includes it"),
        ("odd.xml", "<scene/>", "MJCF begins with <mujoco>, URDF with <robot>"),
        ("odd.urdf", "<robot name='a'><link name='${x}'/><xacro:b/></robot>", "`xacro IN > OUT"),
        ("light.xml", mjcf("<body><joint/></body>"), "what moves needs a mass"),
        ("lost.xml", mjcf("<body>\n<geom size='a b'/></body>"), "line 2: <geom size='a b'/>"),
        ("lost.urdf", URDF.format(ixx=1).replace('child link="rim"', 'child link="rin"'), '"axle"'),
    ],
)
def test_what_cannot_be_read_is_told_with_what_to_do(name, text, hint):
    """MuJoCo's own words, and a hint behind them, on one line."""
    with pytest.raises(ot.ScenarioError) as caught:
        in_a_pipe(written(text, name))
    (fault,) = caught.value.faults
    assert fault.where == "robot.file"
    assert hint in fault.problem
    assert "\n" not in str(fault)


def test_a_robot_is_told_in_which_bore_it_would_fit():
    """And at which size: both are true."""
    ball = "<body name='hull'><freejoint/><geom size='{0}'/></body>"
    with pytest.raises(ot.InputError, match="does not fit") as caught:
        ot.Simulation([in_a_pipe(written(mjcf(ball.format(0.06))), bore=0.1)])
    bore, size = map(
        float, re.search(r"in one of ([\d.]+) mm, or at ([\d.]+) of", str(caught.value)).groups()
    )
    assert ot.Simulation([in_a_pipe("robot.xml", bore=bore / 1000)]).n == 1
    assert size > 0.8
    small = written(mjcf(ball.format(0.06 * size)), "small.xml")
    assert ot.Simulation([in_a_pipe(small, bore=0.1)]).n == 1
    long = "<body><freejoint/><geom type='capsule' size='0.02 0.5' euler='0 90 0'/></body>"
    with pytest.raises(ot.ScenarioError, match=r"pipes: the robot is 1.04 m long, .* 0.6 m"):
        in_a_pipe(written(mjcf(long)))


ARMS = "".join(
    f"<body><joint name='arm_{i}' damping='0.1'/><geom size='0.01' pos='0.02 0 0'/></body>"
    for i in (1, 2)
)
TWO_ARMS = mjcf(
    f"<body name='hull'><freejoint/>{BALL}{ARMS}</body>",
    "<actuator><motor name='one' joint='arm_1'/><position joint='arm_2' kp='1'/></actuator>",
)


def inputs(table, ramp=0.0):
    """Control inputs (T, nu) over time (T,) of a robot with two arms."""
    control = {"kind": "periodic", "parameters": {"inputs": table, "ramp": ramp}}
    data = in_a_pipe(written(TWO_ARMS)).model_dump(mode="json")
    result = ot.run(validate(data | {"control": control, "run": {"time_limit": 0.5}}))
    return result.trajectory["ctrl"][1:], result.trajectory.time[1:]


def test_inputs_are_constant_or_periodic():
    """By names of actuators, of their joints, and patterns, of which the last counts; others stay;
    they rise over the ramp."""
    wave = {"offset": 0.1, "amplitude": 0.2, "frequency": 2.0, "phase_deg": 90}
    ctrl, time = inputs({"*": 0.3, "arm_2": wave})
    # The inputs of a sample were given one control period before it.
    expected = 0.1 + 0.2 * np.cos(4 * np.pi * (time - 0.01))
    np.testing.assert_allclose(ctrl[:, 0], 0.3)
    np.testing.assert_allclose(ctrl[:, 1], expected, atol=1e-9)
    ctrl, time = inputs({"arm_2": 1}, ramp=0.2)
    np.testing.assert_allclose(ctrl[:, 1], np.clip((time - 0.01) / 0.2, 0, 1), atol=1e-9)
    assert not ctrl[:, 0].any()
    with pytest.raises(ot.InputError, match=r"inputs.leg: fits no name.*one, arm_2"):
        inputs({"leg": 1.0})


def test_joints_of_a_urdf_get_motors():
    """A wheel turns at the speed that its servo is asked for, a position is held within the limit
    of its torque, and a force is the input's."""
    file = written(URDF.format(ixx="1e-3"), "cart.urdf")
    servo = {"joints": "ax*", "kind": "velocity", "gain": 0.5}
    scenario = in_a_pipe(file, bore=0.16, servos=[servo])
    assert scenario.robot.channels["ctrl"].names == ("axle",)
    data = scenario.model_dump(mode="json")
    control = {"kind": "periodic", "parameters": {"inputs": {"axle": 3.0}, "ramp": 0.2}}
    driven = validate(data | {"control": control, "run": {"time_limit": 0.6}})
    assert ot.run(driven).trajectory["actuator_velocity"][-1] == pytest.approx([3.0], rel=0.02)
    for servo, force in (
        ({"kind": "position", "gain": 10.0, "limit": 0.5}, 0.5),
        ({"kind": "position", "gain": 0.1, "damping": 0.0}, 0.3),
        ({"kind": "force", "gain": 0.1}, 0.3),
    ):
        model = ot.Mjcf(file=file, servos=[{"joints": "axle", **servo}]).spec().compile()
        data = mujoco.MjData(model)
        data.ctrl[0] = 3.0
        mujoco.mj_forward(model, data)
        assert data.actuator_force[0] == pytest.approx(force)
    with pytest.raises(ot.ScenarioError, match=r"robot.servos: joints.leg: fits no name.*axle"):
        in_a_pipe(file, servos=[{"joints": "leg"}])


ACTUATORS = (
    "<motor joint='hip'/>",
    "<position joint='hip' kp='1' timeconst='0.05'/>",
    "<velocity joint='hip' kv='0.01'/>",
    "<intvelocity joint='hip' kp='1' actrange='-1 1'/>",
    "<cylinder joint='hip' timeconst='0.1' area='0.01'/>",
    "<muscle joint='hip' lengthrange='-1 1'/>",
    "<adhesion body='leg' gain='1' ctrlrange='0 1'/>",
    "<motor site='tip' gear='0 0 1 0 0 0'/>",
    "<motor tendon='cord'/>",
    "<general joint='hip' dyntype='filter' dynprm='0.1' gainprm='0.1'/>",
)


@pytest.mark.parametrize("actuator", ACTUATORS, ids=lambda text: text.split()[0].strip("<"))
def test_actuators_of_any_type_are_driven(actuator):
    """Each takes the input of the scenario, and the physics goes on."""
    world = (
        f"<body name='hull'><freejoint/>{BALL}<body name='leg'><joint name='hip' axis='0 1 0' "
        "range='-60 60' damping='0.01'/><geom size='0.01' pos='0.02 0 0'/><site name='tip'/>"
        "</body></body>"
    )
    cord = "<tendon><fixed name='cord'><joint joint='hip' coef='1'/></fixed></tendon>"
    file = written(mjcf(world, f"{cord}<actuator>{actuator}</actuator>"))
    control = {"kind": "periodic", "parameters": {"inputs": {"*": 0.5}, "ramp": 0.0}}
    data = in_a_pipe(file).model_dump(mode="json") | {"control": control}
    result = ot.run(validate(data))
    assert result.outcome.value == "timed_out"
    assert result.trajectory["ctrl"][-1] == pytest.approx([0.5])
    assert np.abs(result.trajectory["actuator_force"]).max() > 1e-6


@pytest.mark.parametrize("name", ["odd.xml", "odd.urdf"])
def test_a_file_that_opens_and_cannot_be_read_is_refused(name, tmp_path):
    """In words, as one that is not there."""
    (tmp_path / name).symlink_to("/proc/self/mem")
    with pytest.raises(ot.ScenarioError, match=r"robot\.file: cannot be read"):
        validate({"robot": str(tmp_path / name), "pipes": [{"kind": "straight", "length": 1.0}]})
