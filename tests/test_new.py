"""`omnitrack new`: a scenario file with all keys, which is read as the one that it begins from."""

import re
import tomllib

import pytest
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError, OutputError
from omnitrack_sim.cli import app
from omnitrack_sim.robots.control import controller_of, parameters_model
from omnitrack_sim.scenario import validate
from omnitrack_sim.scenario.template import UNSET, WIDTH

DEFAULT = re.compile(rf"^{UNSET}(\w+ = (?!\(none\)).*)$", re.MULTILINE)


def new(*arguments):
    """Run the command; what it has raised is raised here."""
    result = CliRunner().invoke(app, ["new", *map(str, arguments)])
    if result.exception is not None:
        raise result.exception
    return result.stdout


def plain(scenario):
    """A scenario's values without its name."""
    return scenario.model_dump(mode="json", exclude={"name"})


@pytest.mark.parametrize("name", ot.shipped_files("scenarios"))
def test_the_file_is_the_scenario_that_it_begins_from(tmp_path, monkeypatch, name):
    """With what is set, and with every default written out as well; only the name is another."""
    monkeypatch.chdir(tmp_path)
    new("mine", "--from", name)
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    shipped = ot.load_scenario(name)
    mine = ot.load_scenario("mine.toml")
    assert plain(mine) == plain(shipped)
    assert mine.name == "mine"
    written_out, count = DEFAULT.subn(r"\1", text)
    assert count > 60
    assert plain(validate(tomllib.loads(written_out))) == plain(shipped)
    assert max(map(len, text.splitlines())) <= WIDTH


def test_it_has_every_key_there_is(tmp_path, monkeypatch):
    """Of scenarios, fittings, missions, the robot and its motor, and the controller, each with a
    unit where it has one."""
    monkeypatch.chdir(tmp_path)
    new("mine")
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    keys = set(re.findall(r"^(?:#|#: )?(\w+) = ", text, re.MULTILINE))
    schema = ot.Scenario.model_json_schema()["$defs"]
    for table in (
        "StartTable",
        "WorldTable",
        "PhysicsTable",
        "MonitorTable",
        "Mission",
    ):
        assert set(schema[table]["properties"]) <= keys
    assert set(ot.Omnitrack.model_fields) <= keys
    assert {"mean_radius", "end_diameter", "branch_diameter", "no_load_speed"} <= keys
    for key, table in parameters_model(controller_of("jacobian", ot.Omnitrack.controllers()))():
        assert f"[control.parameters.{key}]" in text
        assert set(type(table).model_fields) <= keys
    assert "\n#preload = 25.0  # N, 0 to 2000: force of a module's springs" in text


def test_it_runs_to_the_same_bytes(tmp_path, monkeypatch):
    """Trajectory and replay of a run of the new file are those of the shipped scenario."""
    monkeypatch.chdir(tmp_path)
    new("mine", "--from", "straight")
    short = {"run.time_limit": 0.5}
    for name in ("straight", "mine.toml"):
        ot.run(ot.load_scenario(name, short)).save(tmp_path / name.partition(".")[0])
    for file in ("replay.npz", "timeline.csv"):
        assert (tmp_path / "mine" / file).read_bytes() == (
            tmp_path / "straight" / file
        ).read_bytes()
    one, other = (ot.load_result(tmp_path / name).trajectory for name in ("mine", "straight"))
    assert all((one[name] == other[name]).all() for name in one if one[name].dtype.kind != "f")


@pytest.mark.parametrize(
    "changes",
    [
        {"robot.motor": "pololu_1000_hpcb"},
        {"robot.motor.speed_bandwidth": 20.0, "robot.scale": 1.01},
        {"control.kind": "paper", "control.parameters.elbow_delay": 0.0726},
    ],
)
def test_it_begins_from_the_scenario_of_a_saved_run(tmp_path, monkeypatch, changes):
    """scenario.json has every key, tables of motors and controllers among them."""
    monkeypatch.chdir(tmp_path)
    scenario = ot.load_scenario("elbow", changes)
    (tmp_path / "scenario.json").write_text(scenario.model_dump_json(), encoding="utf-8")
    new("mine.toml", "--from", "scenario.json")
    assert plain(ot.load_scenario("mine.toml")) == plain(scenario)


def test_the_network_of_a_file_is_found_from_the_new_one(tmp_path, monkeypatch):
    """A path that is relative to the one file is written relative to the other."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    (tmp_path / "old" / "net.toml").write_text(ot.load_network("fig14").to_toml(), encoding="utf-8")
    mission = 'network = "net.toml"\n[mission]\nstart = "inlet"\ngoals = ["low"]\n'
    (tmp_path / "old" / "m.toml").write_text(mission, encoding="utf-8")
    new("new/mine", "--from", "old/m.toml")
    assert 'network = "../old/net.toml"' in (tmp_path / "new" / "mine.toml").read_text("utf-8")
    assert plain(ot.load_scenario("new/mine.toml")) == plain(ot.load_scenario("old/m.toml"))


@pytest.mark.parametrize(
    ("arguments", "error", "told"),
    [
        (["mine"], OutputError, "mine.toml: exists already; choose another name"),
        ([".mine"], InputError, "NAME: is '.mine'"),
        (["a\nb"], InputError, "no control characters"),
        (["other", "--from", "tee_trun"], InputError, "did you mean 'tee_turn'?"),
        (["gone/other"], OutputError, "gone"),
    ],
)
def test_bad_names_are_refused_and_nothing_is_lost(tmp_path, monkeypatch, arguments, error, told):
    """What is there stays, and nothing else is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("precious", encoding="utf-8")
    with pytest.raises(error, match=re.escape(told)):
        new(*arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "precious"


def test_a_robot_of_a_file_comes_along_with_what_is_changed_of_it(tmp_path, monkeypatch):
    """Also in its short form; the path leads from the new file, and values of joints are kept."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "given").mkdir()
    (tmp_path / "given" / "ball.xml").write_text(
        "<mujoco><worldbody><body name='ball'><freejoint/><geom size='0.07' mass='1'/>"
        "<body><joint name='swing'/><geom size='0.01'/></body></body></worldbody></mujoco>"
    )
    pipe = '[[pipes]]\nkind = "straight"\nlength = 1.0\n[start]\ndistance = 0.3\n'
    for robot in (
        'robot = "ball.xml"\n',
        '[robot]\nkind = "mjcf"\nfile = "ball.xml"\n[robot.joint.swing]\nstiffness = 3.0\n',
    ):
        base = tmp_path / "given" / "base.toml"
        base.write_text(f"{robot}{pipe}" if "[" not in robot else f"{pipe}{robot}")
        (tmp_path / "mine.toml").unlink(missing_ok=True)
        new("mine", "--from", base)
        ours, theirs = ot.load_scenario("mine.toml"), ot.load_scenario(base)
        assert ours.robot.model_dump() == theirs.robot.model_dump()
        assert 'file = "given/ball.xml"' in (tmp_path / "mine.toml").read_text()
