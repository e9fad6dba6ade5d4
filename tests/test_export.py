"""Runs for other tools: MCAP, CSV and xarray hold what the record holds, with names and units."""

from __future__ import annotations

import csv
import io
import json
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import omnitrack

import omnitrack_sim as ot
from omnitrack_sim.results.dataset import joint_columns
from omnitrack_sim.show import export

TURN = {"run.time_limit": 3.0}


@pytest.fixture(scope="module")
def turn() -> ot.Result:
    """Into a tee, of three seconds."""
    return ot.run(ot.load_scenario("tee_turn", TURN), no_load=False)


@pytest.fixture(scope="module")
def snake() -> ot.Result:
    """A robot with bodies and actuators by name."""
    return ot.run(ot.load_scenario("robots/snake_elbow", {"run.time_limit": 1.0}), no_load=False)


class Messages:
    """An MCAP file as a reader that knows nothing of the package finds it.

    Attributes:
        of: (time, message) of each topic, decoded by the descriptions in the file.
        schemas, about: names of the schemas, and metadata, of the topics.
        attachments: contents by name.
    """

    def __init__(self, file: Path) -> None:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
        from mcap.reader import make_reader

        self.of, self.schemas, self.about, self.order = {}, {}, {}, []
        reader = make_reader(io.BytesIO(file.read_bytes()))
        classes = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            if schema.name not in classes:
                pool = descriptor_pool.DescriptorPool()
                for proto in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(proto)
                found = pool.FindMessageTypeByName(schema.name)
                classes[schema.name] = message_factory.GetMessageClass(found)
            made = classes[schema.name].FromString(message.data)
            self.of.setdefault(channel.topic, []).append((message.log_time, made))
            self.schemas[channel.topic] = schema.name
            self.about[channel.topic] = channel.metadata
            self.order.append(message.log_time)
        self.attachments = {one.name: one.data for one in reader.iter_attachments()}


@pytest.fixture(scope="module")
def messages(turn, tmp_path_factory) -> Messages:
    """The turn, exported and read."""
    pytest.importorskip("mcap")
    file = tmp_path_factory.mktemp("mcap") / "turn.mcap"
    assert ot.export_result(turn, file) == file
    return Messages(file)


def times(result: ot.Result) -> list[int]:
    """Times of the samples, ns."""
    return np.round(1e9 * result.trajectory.time).astype(int).tolist()


def test_channels_are_topics_with_units_and_all_values(turn, messages):
    """One for each channel, a field for each number, in order of time."""
    assert messages.order == sorted(messages.order)
    for name, channel in turn.trajectory.schema.items():
        topic = f"/channels/{name}"
        assert messages.about[topic]["unit"] == channel.unit
        assert messages.about[topic]["meaning"] == channel.meaning
        at, made = zip(*messages.of[topic], strict=True)
        assert list(at) == times(turn)
        fields = [f.name for f in made[0].DESCRIPTOR.fields][: len(channel.columns)]
        values = [[getattr(one, field) for field in fields] for one in made]
        own = turn.trajectory[name].reshape(len(at), -1)
        np.testing.assert_array_equal(values, own)
    phases = [one.name for _, one in messages.of["/channels/phase"]]
    assert phases == [turn.trajectory.phases[int(code)] for code in turn.trajectory["phase"]]


def test_frames_of_bodies_are_those_of_the_joints(turn, messages):
    """Of MuJoCo's kinematics, at each sample; the robot's own pose is beside them."""
    model = turn.scenario.to_spec().compile()
    data = mujoco.MjData(model)
    body = model.body("module_2").id
    assert [at for at, _ in messages.of["/tf"]] == times(turn)
    for (_, frames), qpos in zip(messages.of["/tf"], turn.qpos, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        (own,) = (one for one in frames.transforms if one.child_frame_id == "module_2")
        assert own.parent_frame_id == "world"
        place, turned = own.translation, own.rotation
        np.testing.assert_allclose([place.x, place.y, place.z], data.xpos[body], atol=1e-12)
        quaternion = np.array([turned.w, turned.x, turned.y, turned.z])
        assert abs(quaternion @ data.xquat[body]) == pytest.approx(1)
    poses = [one.pose.position for _, one in messages.of["/pose"]]
    position = [[place.x, place.y, place.z] for place in poses]
    np.testing.assert_array_equal(position, turn.trajectory["position"])


def test_joints_are_told_by_name(turn, messages):
    """All but the chassis' free joint."""
    _, states = messages.of["/joints"][-1]
    told = {one.name: one.position for one in states.joints}
    own = {n: c for n, c in turn.joints.items() if c.stop - c.start == 1}
    assert told == {name: turn.qpos[-1, columns.start] for name, columns in own.items()}
    assert "slide_1" in told


def test_contacts_lie_on_the_wall_and_point_into_the_bore(turn, messages):
    """Of each module at the start, in a straight of 160 mm."""
    _, first = messages.of["/contacts"][0]
    assert {one.body[-1] for one in first.contacts} == {*"123"}
    for one in first.contacts:
        across = np.array([one.x, one.y])
        assert np.linalg.norm(across) == pytest.approx(0.08, abs=0.001)
        assert np.array([one.nx, one.ny]) @ across < -0.079
        assert -0.001 < one.depth < 0.002


def test_shapes_are_there_once_each_in_the_frame_of_its_body(messages):
    """Those of the pipes in the world; triangles name points that there are."""
    ((at, scene),) = messages.of["/scene"]
    assert at == 0
    frames = {one.frame_id for one in scene.entities}
    known = {one.child_frame_id for one in messages.of["/tf"][0][1].transforms}
    assert "world" in frames
    assert frames - {"world"} <= known
    for entity in scene.entities:
        assert entity.frame_locked
        for triangles in entity.triangles:
            assert len(triangles.indices) % 3 == 0 < len(triangles.indices)
            assert max(triangles.indices) == len(triangles.points) - 1
    pipes = next(one for one in scene.entities if one.id == "pipes")
    assert all(0 < triangles.color.a < 1 for triangles in pipes.triangles)


def test_the_file_says_what_was_run(turn, messages):
    """Scenario and result are attached."""
    assert json.loads(messages.attachments["scenario.json"]) == json.loads(
        turn.scenario.model_dump_json()
    )
    assert json.loads(messages.attachments["result.json"])["outcome"] == turn.outcome.value
    assert [m.message for _, m in messages.of["/events"]] == [str(e) for e in turn.events]
    assert len(turn.events) > 0
    assert messages.schemas["/tf"] == "foxglove.FrameTransforms"
    assert messages.schemas["/scene"] == "foxglove.SceneUpdate"


def test_equal_runs_give_equal_files(turn, tmp_path):
    """Byte for byte; also from the folder of the run, by the command."""
    pytest.importorskip("mcap")
    turn.save(tmp_path / "run")
    ot.export_result(turn, tmp_path / "a.mcap")
    assert omnitrack("export", str(tmp_path / "run")).returncode == 0
    again = tmp_path / "run" / "trajectory.mcap"
    assert again.read_bytes() == (tmp_path / "a.mcap").read_bytes()


def test_any_robot_is_exported(snake, tmp_path):
    """Bodies of a snake by their names, in channels too."""
    pytest.importorskip("mcap")
    read = Messages(ot.export_result(snake, tmp_path / "snake.mcap"))
    _, first = read.of["/channels/wall_force"][0]
    names = snake.trajectory.schema["wall_force"].names
    assert [field.name for field in first.DESCRIPTOR.fields] == list(names)
    assert read.about["/channels/wall_force"]["fields"] == ", ".join(names)


def test_csv_reads_back_exactly(snake, tmp_path):
    """A row a sample: channels by name with units, phases in words, joints behind them."""
    file = ot.export_result(snake, tmp_path / "snake.csv")
    with file.open(newline="", encoding="utf-8") as text:
        head, *rows = csv.reader(text)
    columns = dict(zip(head, zip(*rows, strict=True), strict=True))
    assert list(map(float, columns["time [s]"])) == snake.trajectory.time.tolist()
    forces = snake.trajectory["wall_force"]
    for i, name in enumerate(snake.trajectory.schema["wall_force"].names):
        assert list(map(float, columns[f"wall_force {name} [N]"])) == forces[:, i].tolist()
    assert set(columns["phase"]) == {"drive"}
    for i, (name, unit) in enumerate(joint_columns(snake.scenario.robot)):
        told = columns[f"joint {name}" if unit == "1" else f"joint {name} [{unit}]"]
        assert list(map(float, told)) == snake.qpos[:, i].tolist()


def test_xarray_has_names_and_units(turn, snake, tmp_path):
    """Channels over time and what they are of; joints by name; the run as attributes."""
    xarray = pytest.importorskip("xarray")
    dataset = ot.to_xarray(turn)
    assert dataset.sizes["time"] == len(turn.trajectory.time)
    np.testing.assert_array_equal(
        dataset.belt_speed.sel(module=2), turn.trajectory["belt_speed"][:, 1]
    )
    np.testing.assert_array_equal(
        dataset.contact_position.sel(module=3, axis="z"),
        turn.trajectory["contact_position"][:, 2, 2],
    )
    assert dataset.normal_force.attrs["units"] == "N"
    w = dataset.quaternion.sel(quaternion_part="w")
    np.testing.assert_array_equal(w, turn.trajectory["quaternion"][:, 0])
    np.testing.assert_array_equal(
        dataset.joint_position.sel(joint="slide_1"), turn.qpos[:, turn.joints["slide_1"].start]
    )
    assert dataset.outcome == turn.outcome.value
    assert json.loads(dataset.phases) == list(turn.trajectory.phases)
    assert json.loads(dataset.scenario)["name"] == "tee_turn"
    pytest.importorskip("scipy")
    dataset.to_netcdf(tmp_path / "turn.nc", engine="scipy")
    back = xarray.open_dataset(tmp_path / "turn.nc", engine="scipy")
    np.testing.assert_array_equal(back.slide, dataset.slide)
    assert back.attrs["phases"] == dataset.attrs["phases"]
    back.close()
    other = ot.to_xarray(snake)
    assert other.wall_force.dims == ("time", "body")
    assert other.ctrl.dims == ("time", "actuator")
    assert other.body.values.tolist() == list(snake.trajectory.schema["wall_force"].names)


def test_a_run_writes_what_export_names(tmp_path):
    """Beside its other files."""
    pytest.importorskip("mcap")
    command = ("run", "straight", "--no-video", "--out", "a", "--set", "run.time_limit=0.1")
    done = omnitrack(*command, "--export", "csv", "--export", "mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {"trajectory.csv", "trajectory.mcap"} <= {p.name for p in (tmp_path / "a").iterdir()}


def test_what_cannot_be_exported_is_refused_before_the_run(tmp_path, monkeypatch):
    """Another format, and MCAP where what writes it is missing; xarray says what it needs."""
    run = ("run", "straight", "--no-video", "--export")
    done = omnitrack(*run, "mkap", cwd=tmp_path)
    assert done.returncode == 2
    assert "--export: is 'mkap'; did you mean 'mcap'?" in " ".join(done.stderr.split())
    monkeypatch.setattr(export, "find_spec", lambda name: find_spec(name) and None)
    done = omnitrack(*run, "mcap", cwd=tmp_path)
    assert done.returncode == 2
    assert "pip install 'omnitrack_sim[mcap]'" in " ".join(done.stderr.split())
    assert not (tmp_path / "out").exists()
    done = omnitrack("export", "nothing", "--out", "a.txt", cwd=tmp_path)
    assert "a.txt: has the export format 'txt' (choose from: mcap, csv)" in done.stderr


def test_a_robot_of_a_file_is_exported_without_reading_the_file(tmp_path, monkeypatch):
    """Without contacts, for which its model is needed; with trust they are there."""
    pytest.importorskip("mcap")
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(
        "<mujoco><worldbody><body name='ball'><freejoint name='root'/><geom size='0.07'/>"
        "<body name='arm'><joint name='swing' axis='1 0 0'/><geom size='0.01' pos='0 0 .01'/>"
        "</body></body></worldbody></mujoco>"
    )
    changes = {"robot": "ball.xml", "run.time_limit": 0.1}
    ot.run(ot.load_scenario("straight", changes), no_load=False).save("run")
    trusted = Messages(ot.export_result("run", "trusted.mcap", trust=True))
    assert {one.body for _, m in trusted.of["/contacts"] for one in m.contacts} == {"ball"}
    Path("ball.xml").unlink()
    read = Messages(ot.export_result("run", "run.mcap"))
    assert "/contacts" not in read.of
    (joint,) = read.of["/joints"][0][1].joints
    assert joint.name == "swing"
    assert {one.child_frame_id for one in read.of["/tf"][0][1].transforms} == {"ball", "arm"}
    head = ot.export_result("run", "run.csv").read_text().partition("\n")[0]
    assert head.endswith("joint root_qz,joint swing [rad]")


@pytest.fixture(scope="module")
def rolling() -> ot.Recording:
    """A ball with a hinged arm in a straight, recorded beside a loop of one's own."""
    spec = mujoco.MjSpec()
    ball = spec.worldbody.add_body(name="ball", pos=[0, 0, 0.2])
    ball.add_freejoint()
    ball.add_geom(size=[0.05, 0, 0])
    arm = ball.add_body(name="arm")
    arm.add_joint(name="swing", axis=[1, 0, 0], damping=[0.01, 0, 0])
    arm.add_geom(size=[0.01, 0, 0], pos=[0, 0, 0.06])
    straight = {"kind": "straight", "name": "pipe", "length": 0.5}
    pipes = ot.add_pipes(spec, ot.Network(fittings=[straight]), friction=0.8)
    model = spec.compile()
    data = mujoco.MjData(model)
    model.opt.gravity[:] = 0, -9.81, 0
    recording = ot.Recording(model, pipes, period=0.02)
    for _ in range(200):
        mujoco.mj_step(model, data)
        recording.append(data)
    return recording


def test_a_recording_is_exported_as_a_run_is(rolling, tmp_path):
    """Frames, joints, contacts with the forces of the wall, and its quantities, by its file too."""
    pytest.importorskip("mcap")
    file = ot.export_result(rolling, tmp_path / "ball.mcap")
    read = Messages(file)
    poses = [m.pose.position for _, m in read.of["/pose"]]
    body = rolling.model.body("ball").id
    np.testing.assert_allclose([[p.x, p.y, p.z] for p in poses], rolling.bodies[:, body, :3])
    joints = [one.position for _, m in read.of["/joints"] for one in m.joints]
    assert joints == rolling.qpos[:, 7].tolist()
    contacts, at = rolling.contacts, [len(m.contacts) for _, m in read.of["/contacts"]]
    assert at == np.bincount(contacts.sample, minlength=len(rolling)).tolist()
    told = [(one.fx, one.fy, one.fz) for _, m in read.of["/contacts"] for one in m.contacts]
    assert told == [tuple(force) for force in contacts.force.tolist()]
    depths = [one.depth for _, m in read.of["/contacts"] for one in m.contacts]
    assert depths == (-contacts.distance).tolist()
    assert max(force for _, force, _ in told) > 0.5  # the weight of the ball
    speeds = read.of["/channels/qvel"]
    assert speeds[-1][1].swing == rolling["qvel"][-1, 6]
    saved = rolling.save(tmp_path / "ball.npz")
    assert ot.export_result(saved, tmp_path / "b.mcap").read_bytes() == file.read_bytes()
    head, first, *_ = ot.export_result(saved, tmp_path / "b.csv").read_text().splitlines()
    assert next(csv.reader([head]))[1] == "qpos joint_0_x [m, rad]"
    assert float(first.partition(",")[0]) == rolling.time[0]


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        *("missions/fig14_onboard", "missions/fig14", "paper/tee_differential"),
        *(f"robots/{kind}_elbow" for kind in ("climber", "helix", "inchworm", "pirate", "presser")),
        *("robots/screw_elbow", "robots/snake_elbow"),
    ],
)
def test_every_robot_and_mission_is_exported(name, tmp_path):
    """Each number of the record, once."""
    pytest.importorskip("mcap")
    pytest.importorskip("xarray")
    result = ot.run(ot.load_scenario(name, {"run.time_limit": 0.5}), no_load=False)
    read = Messages(ot.export_result(result, tmp_path / "run.mcap"))
    assert {f"/channels/{name}" for name in result.trajectory.schema} <= read.of.keys()
    numbers = sum(len(channel.columns) for channel in result.trajectory.schema.values())
    head = ot.export_result(result, tmp_path / "run.csv").read_text().partition("\n")[0]
    assert len(next(csv.reader([head]))) == 1 + numbers + result.qpos.shape[1]
    assert ot.to_xarray(result).sizes["joint"] == result.qpos.shape[1]
