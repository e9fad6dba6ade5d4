"""Files that wait, never end, or ask for more than there is: refused at once, in one line."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from samples import sample_result
from town_samples import passport

import omnitrack_sim as ot
from omnitrack_sim.base.bounds import MAX_MODEL_FILES, MAX_TRIALS
from omnitrack_sim.base.errors import OmnitrackError
from omnitrack_sim.cli.common import settings_of
from omnitrack_sim.trials.suite import load_suite
from omnitrack_sim.walls.model_bounds import check_binary, check_model

PATIENCE = 5.0
"""Time, s, in which a file is refused on a machine that does other things, too; alone it takes
less than one."""


@contextmanager
def in_time() -> Iterator[None]:
    """Raise an ``AssertionError`` in a block that takes too long, whatever it waits for."""

    def late(*_: Any) -> None:
        raise AssertionError(f"takes more than {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def refused(read: Callable[[], object]) -> str:
    """What is said, on one line, of a file that is refused in time."""
    with in_time(), pytest.raises(OmnitrackError) as caught:
        read()
    assert len(str(caught.value).splitlines()) == 1, caught.value
    return str(caught.value)


def listen(path: Path) -> None:
    """Leave the socket of a server."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


SPECIAL: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "folder": Path.mkdir,
    "socket": listen,
}
"""What may stand in the place of a file."""
READ: dict[str, tuple[str, Callable[[Path], object]]] = {
    "scenario": ("a.toml", ot.load_scenario),
    "saved scenario": ("a.json", ot.load_scenario),
    "sweep": ("a.toml", ot.load_sweep),
    "study": ("a.toml", ot.load_study),
    "suite": ("a.toml", load_suite),
    "network": ("a.toml", ot.load_network),
    "values": ("a.toml", lambda path: settings_of(f"@{path}")),
    "policy": ("a.npz", ot.load_policy),
    "recording": ("a.npz", ot.Recording.load),
    "passport": ("passport.parquet", ot.load_passport),
    "town": ("a.inp", ot.import_network),
    "isometric": ("a.pcf", ot.import_network),
    "robot": ("a.xml", lambda path: ot.load_scenario("straight", {"robot": str(path)})),
    "robot of ROS": ("a.urdf", lambda path: ot.load_scenario("straight", {"robot": str(path)})),
}
"""What reads files, and a name for one."""


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("name", READ)
def test_what_is_no_regular_file_is_not_read(name, kind, tmp_path, monkeypatch):
    """Nothing waits for a pipe, and nothing reads a device without end."""
    monkeypatch.chdir(tmp_path)  # a socket's path is short
    file, read = READ[name]
    SPECIAL[kind](Path(file))
    refused(lambda: read(Path(file)))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The folder of a run."""
    return sample_result().save(tmp_path_factory.mktemp("runs") / "run")


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize(
    "name", ["result.json", "scenario.json", "trajectory.parquet", "replay.npz"]
)
def test_a_run_with_such_a_file_is_refused_by_its_name(run, name, kind, tmp_path, monkeypatch):
    """Each file of a run's folder."""
    for file in run.iterdir():
        if file.name != name:
            (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    SPECIAL[kind](Path(name))
    assert name in refused(lambda: ot.load_result("."))


BODY = '<body name="a"><freejoint/><geom size="0.05"/></body>'
MODELS = {
    "copies": f'<worldbody><replicate count="100000"><body>{BODY}</body></replicate></worldbody>',
    "copies of copies": "<worldbody>"
    + '<replicate count="99">' * 4
    + BODY
    + "</replicate>" * 4
    + "</worldbody>",
    "height field": f'<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
    f"<worldbody>{BODY}</worldbody>",
    "texture": '<asset><texture type="2d" builtin="flat" width="99999" height="99999"/></asset>',
    "mesh": '<asset><mesh name="m" builtin="plate" params="99999 99999"/></asset>',
    "memory": f'<size memory="900G"/><worldbody>{BODY}</worldbody>',
    "user data": f'<size nuserdata="2000000000"/><worldbody>{BODY}</worldbody>',
    "grid": '<worldbody><flexcomp name="f" type="grid" count="9999 9999 9999"/></worldbody>',
    "nesting": "<worldbody>" + "<body>" * 5000 + "</body>" * 5000 + "</worldbody>",
    "no number": f'<worldbody><replicate count="nan">{BODY}</replicate></worldbody>',
    "mesh of a device": '<asset><mesh name="m" file="/dev/zero"/></asset>'
    f"<worldbody>{BODY}</worldbody>",
    "includes of a pipe": '<include file="pipe.xml"/>',
    "includes of itself": f'<include file="robot.xml"/><worldbody>{BODY}</worldbody>',
}
"""Models that ask for too much, without their outermost element."""
TOLD = {
    "copies": "asks for 100002 elements",
    "copies of copies": "asks for 980201 elements",
    "height field": "asks for 1e+10 cells",
    "texture": "asks for 9.9998e+09 cells",
    "mesh": "asks for 9.9998e+09 cells",
    "memory": "asks for 9.66368e+11 bytes",
    "user data": "asks for 2e+09 in size nuserdata",
    "grid": "asks for 9.997e+11 elements",
    "nesting": "asks for 401 levels",
    "no number": "asks for nan in replicate count",
    "mesh of a device": "is no regular file",
    "includes of a pipe": "is no regular file",
    "includes of itself": "already included",
}
"""What is said of each."""


@pytest.mark.parametrize("name", MODELS)
def test_a_model_that_asks_for_too_much_is_refused(name, tmp_path):
    """Before MuJoCo makes anything of it, and it is told of what there is too much."""
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "robot.xml").write_text(f"<mujoco>{MODELS[name]}</mujoco>")
    told = refused(lambda: ot.load_scenario("straight", {"robot": str(tmp_path / "robot.xml")}))
    assert told.startswith("robot.file: ")
    assert TOLD[name] in told


def test_a_picture_that_unpacks_to_gigabytes_is_refused(tmp_path):
    """Its size stands at its beginning."""
    head = struct.pack(">8s4s4sII", b"\x89PNG\r\n\x1a\n", b"\0\0\0\r", b"IHDR", 90_000, 90_000)
    (tmp_path / "big.png").write_bytes(head + bytes(100))
    asset = '<asset><texture name="t" type="2d" file="big.png"/></asset>'
    text = f"<mujoco>{asset}<worldbody>{BODY}</worldbody></mujoco>"
    (tmp_path / "robot.xml").write_text(text)
    told = refused(lambda: ot.load_scenario("straight", {"robot": str(tmp_path / "robot.xml")}))
    assert "8.1e+09 pixels of big.png" in told


def test_a_page_that_no_browser_shows_is_not_made(monkeypatch):
    """Before the poses of millions of samples are looked for."""
    monkeypatch.setattr("omnitrack_sim.show.replay.document.MAX_PAGE_NUMBERS", 1000)
    run = sample_result()
    assert "page: of 201 samples is too large" in refused(lambda: ot.render_replay(run))


def test_a_robot_whose_file_is_gone_is_told(tmp_path):
    """With its place, whatever else of the robot depends on the file."""
    told = refused(lambda: ot.load_scenario("straight", {"robot": str(tmp_path / "robot.xml")}))
    assert told.startswith("robot.file: cannot be read: no such file")


def test_entities_that_grow_are_not_read(tmp_path):
    """Ten lines of XML may stand for a billion words."""
    lines = [f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10)]
    text = f'<!DOCTYPE m [<!ENTITY e0 "w">{"".join(lines)}]><mujoco model="&e9;"/>'
    (tmp_path / "robot.xml").write_text(text)
    refused(lambda: ot.load_scenario("straight", {"robot": str(tmp_path / "robot.xml")}))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", '{"pipes":' + "[" * 100_000 + "]" * 100_000 + "}"),
        ("a.json", '{"a":' * 500 + "1" + "}" * 500),
        ("a.toml", "a = " + "[" * 100_000 + "]" * 100_000),
        ("a.toml", "a." * 100_000 + "b = 1"),
        ("a.toml", "a = '" + "x" * 3_000_000 + "'"),
        ("a.json", '{"seed": ' + "9" * 100_000 + "}"),
    ],
)
def test_tables_without_bound_are_refused(name, text, tmp_path):
    """Depth, length and digits."""
    (tmp_path / name).write_text(text)
    refused(lambda: ot.load_scenario(tmp_path / name))


def test_a_zip_that_unpacks_to_more_than_the_memory_is_refused(tmp_path):
    """What it says of its size is believed before it is unpacked."""
    file = tmp_path / "a.npz"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("head.npy", b"")
        archive.filelist[0].file_size = 10**13
    assert "unpacks to more" in refused(lambda: ot.Recording.load(file))
    assert "unpacks to more" in refused(lambda: ot.load_policy(file))


def rewritten(folder: Path, table: pa.Table) -> Path:
    """A passport with other rows."""
    about = passport(trials=2).table().schema.metadata
    pq.write_table(table.replace_schema_metadata(about), folder / "passport.parquet")
    return folder / "passport.parquet"


def test_a_table_of_millions_of_equal_rows_is_refused(tmp_path):
    """They take a few bytes of a file."""
    zeros = pa.array(np.zeros(MAX_TRIALS + 1))
    own = passport(trials=2).table().column_names
    file = rewritten(tmp_path, pa.table(dict.fromkeys(own, zeros)))
    assert file.stat().st_size < 1_000_000
    assert f"at most {MAX_TRIALS}" in refused(lambda: ot.load_passport(file))


def test_a_table_whose_rows_share_a_long_text_is_refused(tmp_path):
    """A text of a megabyte in a thousand rows takes a gigabyte."""
    table = passport(trials=100).table()
    text = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(table.num_rows, np.int32)), pa.array(["x" * 1_000_000])
    )
    place = table.column_names.index("outcome")
    file = rewritten(tmp_path, table.set_column(place, "outcome", text))
    assert file.stat().st_size < 2_000_000
    assert "is too long" in refused(lambda: ot.load_passport(file))


def test_a_table_of_lists_without_end_is_refused(tmp_path):
    """One row may hold any number of values."""
    table = pa.table({"kind": pa.array([[0] * 1_000_000])})
    assert "lists" in refused(lambda: ot.load_passport(rewritten(tmp_path, table)))


def test_damaged_passports_are_refused_in_words(tmp_path):
    """Whatever stands in the place of what a passport says of itself."""
    table = passport(trials=2).table()
    whole = json.loads(table.schema.metadata[b"passport"])
    for key, value in [
        *(("changes", value) for value in (None, [], {"robot.kind": 3}, {"robot": {}}, {"a": 1})),
        *(("misfits", value) for value in (None, [1], "x")),
        *(("format", value) for value in (None, [], 10**30)),
        ("robot", {"length": -1}),
        ("changes", {"robot.kind": "mjcf", "robot.file": "/dev/zero"}),
    ]:
        about = json.dumps(whole | {key: value})
        pq.write_table(
            table.replace_schema_metadata({"passport": about}), tmp_path / "passport.parquet"
        )
        if key != "robot" and value not in ({"a": 1}, {"robot": {}}):
            refused(lambda: ot.load_passport(tmp_path))


TOWN = """[JUNCTIONS]
a {height}
b 0
c 0
[PIPES]
p a b {length} {bore} 100 0 Open
q b c 100 300 100 0 Open
[COORDINATES]
a {place} 0
b 100 0
c 100 100
[OPTIONS]
Units LPS
"""
SIZES = {"height": "0", "length": "100", "bore": "300", "place": "0"}


@pytest.mark.parametrize("value", ["nan", "inf", "1e308", "-1e308", "-5", "1e-300", "0", "x", ""])
@pytest.mark.parametrize("key", SIZES)
def test_a_town_of_odd_numbers_is_built_or_refused(key, value, tmp_path):
    """No number of a file of EPANET ends in anything but a network or a sentence."""
    pytest.importorskip("wntr")
    (tmp_path / "town.inp").write_text(TOWN.format(**SIZES | {key: value}))
    told = ""
    with in_time():
        try:
            made = ot.import_network(tmp_path / "town.inp")
        except OmnitrackError as error:
            told = str(error)
    if told:
        assert "town.inp" in told
    else:
        assert value in ("0", "-5", "1e-300")
        assert 0 < made.network.length < 1e4


@pytest.mark.parametrize(
    ("key", "what", "allowed", "odd"),
    [
        ("height", "height", (), (-10_001, 10_001)),
        ("length", "length", (0.01, 199_999), (0.0099, 200_001)),
        ("bore", "diameter", (1, 19_999), (0.99, 20_001)),  # mm
        ("place", "coordinate", (-999_999_999, 999_999_999), (-1.01e9, 1.01e9)),
    ],
)
def test_a_town_may_have_the_sizes_of_any_on_earth(key, what, allowed, odd, tmp_path):
    """What is beyond them is named."""
    pytest.importorskip("wntr")
    for value in (*allowed, *odd):
        (tmp_path / "town.inp").write_text(TOWN.format(**SIZES | {key: f"{value:.9g}"}))
        told = ""
        try:
            ot.import_network(tmp_path / "town.inp")
        except OmnitrackError as error:
            told = str(error)
        assert (f"has a {what} of" in told) == (value in odd), told


@pytest.mark.parametrize("scale", [1e6, 1e300, 1e-300, float("nan"), -1.0])
def test_a_town_at_an_absurd_scale_is_refused(scale, tmp_path):
    """A town as large as a planet is not laid out."""
    pytest.importorskip("wntr")
    (tmp_path / "town.inp").write_text(TOWN.format(**SIZES))
    refused(lambda: ot.import_network(tmp_path / "town.inp", scale=scale))


def test_files_that_a_model_names_count_together(tmp_path):
    """Each is small enough, both are not."""
    names = ("one.stl", "other.stl")
    for name in names:
        with (tmp_path / name).open("wb") as file:
            file.truncate(MAX_MODEL_FILES // 2 + 1)  # takes no room on the disk
    for count in (1, 2):
        meshes = "".join(f'<mesh file="{name}"/>' for name in names[:count])
        (tmp_path / "model.xml").write_text(f"<mujoco><asset>{meshes}</asset></mujoco>")
        if count == 1:
            check_model(tmp_path / "model.xml")
    with pytest.raises(ValueError, match="bytes of files; at most"):
        check_model(tmp_path / "model.xml")


def test_every_size_of_a_binary_model_is_bounded():
    """MuJoCo would take the memory, or turn in a circle, before it looks for what it is of."""
    text = f"<mujoco><worldbody>{BODY}</worldbody></mujoco>"
    model = mujoco.MjSpec.from_string(text).compile()
    whole = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, whole)
    check_binary(whole.tobytes())
    count = int(whole[8:12].view(np.int32)[0])
    for place in range(count):
        for size in (2**62, -(2**62), 10**10):
            odd = whole.copy()
            odd[20 + 8 * place : 28 + 8 * place] = np.array([size]).view(np.uint8)
            with pytest.raises(ValueError, match="as its n"):
                check_binary(odd.tobytes())
    for data in (b"", b"x" * 19, whole.tobytes()[:100], bytes(1000)):
        with pytest.raises(ValueError, match="is no model"):
            check_binary(data)


@pytest.mark.parametrize(
    "record",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"sha256": [], "sweep": {}}',
        b'{"sha256": "x", "sweep": []}',
        b'{"sha256": "x", "sweep": {"bases": 3, "axes": null}}',
        b'{"sha256": "x", "sweep": {"name": {"a": [[[]]]}}, "sweep": 3}',
    ],
)
def test_damaged_records_of_trials_are_refused_in_words(record, tmp_path):
    """Of a sweep, a bench and a passport, as they are gone on with and as they are read."""
    plans = [
        ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01}),
        ot.Bench.of("control", ["elbow"], ["feedback"], quick=True),
        ot.PassportPlan.of("presser", courses=["straight"], trials=1),
    ]
    for plan in plans:
        folder = tmp_path / plan.noun
        folder.mkdir()
        text = record.replace(b"sweep", plan.noun.encode())
        (folder / f"{plan.noun}.json").write_bytes(text)
        refused(lambda plan=plan, folder=folder: ot.run_trials(plan, out=folder))
    refused(lambda: ot.load_sweep_result(tmp_path / "sweep"))
