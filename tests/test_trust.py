"""Looking at somebody else's files runs none of their code, and waits for nothing."""

from __future__ import annotations

import dataclasses
import functools
import importlib.abc
import inspect
import json
import os
import pickle
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import omnitrack
from documents import page
from policy_samples import driver
from samples import sample_result
from town_samples import passport

import omnitrack_sim as ot
from omnitrack_sim.base.errors import OmnitrackError
from omnitrack_sim.base.writing import npz_of
from omnitrack_sim.cli import app
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.scenario import validate
from omnitrack_sim.scenario.model import sha256_of
from omnitrack_sim.show.sources import playback_of

EVIL = "evil_module"
THING = f"{EVIL}:Thing"
SCENARIO = {"pipes": [{"kind": "straight", "length": 1.0}]}


class Watch(importlib.abc.MetaPathFinder):
    """Hook of imports that writes down what of the evil module is looked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def find_spec(self, name: str, *_: Any) -> None:
        if name.startswith("evil"):
            self.asked.append(name)


@pytest.fixture
def watch(tmp_path, monkeypatch) -> Iterator[Watch]:
    """The hook; the evil module lies in the working folder, where Python looks for it."""
    (tmp_path / f"{EVIL}.py").write_text("open('ran', 'w').close()\nThing = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    hook = Watch()
    sys.meta_path.insert(0, hook)
    yield hook
    sys.meta_path.remove(hook)
    sys.modules.pop(EVIL, None)


class Stranger(Omnitrack):
    """A robot from outside the package."""


def hostile(folder: Path, path: str, value: Any, robot: str = "", **tables: Any) -> Path:
    """Save a run whose scenario names ``value`` at a dotted path, with a hash that fits it."""
    scenario = validate(SCENARIO | tables | ({"robot": {"kind": robot}} if robot else {}))
    sample_result(scenario=scenario, provenance=provenance_of(scenario)).save(folder)
    file, summary = folder / "scenario.json", folder / "result.json"
    plain, told = json.loads(file.read_text()), json.loads(summary.read_text())
    *tables_in, key = path.split(".")
    place: Any = plain
    for name in tables_in:
        place = place[int(name) if name.isdigit() else name]
    place[key] = value
    file.write_text(json.dumps(plain))
    told["provenance"]["scenario_sha256"] = sha256_of(plain)
    summary.write_text(json.dumps(told))
    return folder


def network(folder: Path) -> Path:
    """A network with a fitting of evil."""
    file = folder / "network.toml"
    file.write_text(f'[[fittings]]\nkind = "{THING}"\nname = "a"\nlength = 0.5\n')
    return file


def evil_passport(folder: Path) -> Path:
    """A passport of a robot and controller of evil."""
    table = passport(trials=3).table()
    about = json.loads(table.schema.metadata[b"passport"])
    about["changes"] = {"robot.kind": THING, "control.kind": THING}
    file = folder / "passport.parquet"
    pq.write_table(table.replace_schema_metadata({"passport": json.dumps(about)}), file)
    return file


def evil_policy(folder: Path) -> Path:
    """A policy that observes a feature of evil."""
    driver().save(folder / "policy.npz")
    arrays = dict(np.load(folder / "policy.npz"))
    arrays["features"] = np.array([THING])
    (folder / "policy.npz").write_bytes(npz_of(arrays))
    return folder / "policy.npz"


def evil_recording(folder: Path) -> Path:
    """A recording in pipes of evil."""
    head = {"format": 1, "mujoco": mujoco.__version__, "period": 0.0, "body": 1, "joints": []}
    head["parts"] = [{"kind": THING, "name": "a"}]
    arrays = {"part_position": np.zeros((1, 3)), "part_rotation": np.eye(3)[None]}
    octets = np.frombuffer(json.dumps(head).encode(), np.uint8)
    (folder / "recording.npz").write_bytes(npz_of(arrays | {"head": octets}))
    return folder / "recording.npz"


RUNS: dict[str, Callable[[Path], Path]] = {
    "robot": lambda at: hostile(at, "robot.kind", THING, Stranger.kind),
    "robot without a record": lambda at: hostile(at, "robot.kind", THING),
    "drive": lambda at: hostile(at, "robot.drive", THING),
    "fitting": lambda at: hostile(at, "pipes.0.kind", THING),
    "controller": lambda at: hostile(at, "control.kind", THING),
    "sensors": lambda at: hostile(at, "record.sensors", [THING]),
    "metrics": lambda at: hostile(at, "record.metrics", [THING]),
    "camera": lambda at: hostile(at, "sensing.camera", THING, sensing={"kind": "onboard"}),
    "features": lambda at: hostile(
        at, "control.parameters", {"policy": THING}, control={"kind": "jacobian"}
    ),
}
"""Runs that name code at each place of a scenario."""
FILES: dict[str, tuple[Callable[[Path], Path], tuple[Callable[[Any], object], ...]]] = {
    "network": (network, (ot.load_network,)),
    "passport": (evil_passport, (ot.load_passport,)),
    "policy": (evil_policy, (ot.load_policy,)),
    "recording": (evil_recording, (ot.Recording.load, ot.render_replay)),
}
"""Files that name code, and what reads them."""


def look(folder: Path, out: Path) -> Iterator[str]:
    """Look at a run in every way; yield what is said where one is refused."""
    ways: tuple[Callable[[Any], object], ...] = (
        ot.load_result,
        lambda run: ot.compare(run, run)._repr_html_(),
        lambda run: ot.load_result(run).save(out / "copy"),
        lambda run: ot.load_result(run)._repr_html_(),
        lambda run: ot.render_replay(run, path=out / "page.html", compare=ot.load_result(run)),
        lambda run: ot.plot_summary(run),
        lambda run: ot.plot_compare(run, run),
        lambda run: pickle.loads(pickle.dumps(playback_of(run))).model,
    )
    for way in ways:
        try:
            way(folder)
        except OmnitrackError as error:
            yield str(error)


def assert_nothing_ran(watch: Watch, folder: Path) -> None:
    """Neither looked for nor run."""
    assert not watch.asked
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("name", RUNS)
def test_looking_at_a_run_imports_nothing_that_it_names(name, watch, tmp_path):
    """Whatever the scenario names at any place; what cannot be shown without it is refused in one
    line, which names it and says how it is trusted."""
    folder = RUNS[name](tmp_path / "run")
    for told in look(folder, tmp_path):
        assert THING in told
        assert "--trust" in told
        assert len(told.splitlines()) == 1
    assert_nothing_ran(watch, tmp_path)


@pytest.mark.parametrize("name", FILES)
def test_looking_at_a_file_imports_nothing_that_it_names(name, watch, tmp_path):
    """Networks, passports, policies and recordings."""
    make, ways = FILES[name]
    file = make(tmp_path)
    for way in ways:
        with pytest.raises(OmnitrackError, match=THING):
            way(file)
    assert_nothing_ran(watch, tmp_path)


def test_whoever_trusts_a_file_has_its_code_imported(watch, tmp_path):
    """The law above is no accident of a module that cannot be found."""
    folder = RUNS["robot"](tmp_path / "run")
    with pytest.raises(OmnitrackError, match=r"no ot\.Robot"):
        ot.load_result(folder, trust=True)
    assert watch.asked == [EVIL]
    assert (tmp_path / "ran").exists()


def test_a_strangers_run_is_shown_as_it_is_where_its_class_is(watch, tmp_path):
    """The page is that of the class but for what its display adds; the numbers are the same."""
    own = sample_result(scenario=validate(SCENARIO | {"robot": {"kind": Stranger.kind}}))
    known = ot.load_result(own.save(tmp_path / "known"))
    other = ot.load_result(RUNS["robot"](tmp_path / "run"))
    assert type(known.scenario.robot) is Stranger
    assert other.scenario.robot.kind == "recorded"
    assert known.trajectory.schema == other.trajectory.schema
    for name, values in known.trajectory.items():
        assert np.array_equal(values, other.trajectory[name])
    for one in ("metrics", "advice", "joints", "reason"):
        assert getattr(known, one) == getattr(other, one)
    assert ot.compare(known, other).figures == ot.compare(known, known).figures
    ours, theirs = (playback_of(run) for run in (known, other))
    for one in ("plots", "first_plots", "columns", "visible_geoms", "body"):
        assert getattr(ours, one) == getattr(theirs, one)
    assert ours.headline == theirs.headline
    moved = np.abs(ours.body_poses([ours.body]) - theirs.body_poses([theirs.body]))
    assert moved.max() < 1e-5


def test_a_run_that_was_only_looked_at_is_not_run(watch, tmp_path):
    """A robot without its code would drive by another physics."""
    other = ot.load_result(RUNS["robot"](tmp_path / "run"))
    with pytest.raises(OmnitrackError, match="it can be shown, not run"):
        ot.run(other.scenario)
    assert other.scenario.hash == other.provenance["scenario_sha256"]


OUTSIDE = {
    "above": ("", "../secret.obj"),
    "elsewhere": ("", "/dev/zero"),
    "of Windows": ("", "C:\\\\secret.obj"),
    "by a folder": ("/tmp", "m.obj"),
    "not there": ("", "n.obj"),
}
"""Meshes that are named from outside of an archive: folder, file."""


@pytest.mark.parametrize("kind", ["pipe", "endless", "folder", "text", "other robot", *OUTSIDE])
def test_a_damaged_model_for_pictures_is_told(kind, watch, tmp_path):
    """The numbers of the run are read without it."""
    folder = RUNS["robot"](tmp_path / "run")
    file = folder / "robot.mjz"
    data = file.read_bytes()
    file.unlink()
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "endless":
        file.symlink_to("/dev/zero")
    elif kind == "folder":
        file.mkdir()
    elif kind == "text":
        file.write_bytes(b"no archive" + data[:100])
    else:
        body = "<body name='chassis'><freejoint/><geom size='1'/></body>"
        mesh = ""
        if kind in OUTSIDE:
            place, name = OUTSIDE[kind]
            mesh = f"<compiler meshdir='{place}'/><asset><mesh name='m' file='{name}'/></asset>"
        text = f"<mujoco>{mesh}<worldbody>{body}</worldbody></mujoco>"
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("model.xml", text)
            archive.writestr("m.obj", "v 0 0 0")
    run = ot.load_result(folder)
    assert run.metrics["distance_m"] > 0
    why = "which is not in it" if kind in OUTSIDE else ""
    with pytest.raises(ot.OutputError, match=rf"robot\.mjz: .*{why}"):
        ot.render_replay(run, path=tmp_path / "page.html")


@pytest.mark.long
def test_painting_processes_import_nothing(watch, tmp_path):
    """They get the run from the process that has read it, and trust what that one did."""
    folder = RUNS["robot"](tmp_path / "run")
    hostile_camera = hostile(
        tmp_path / "camera", "sensing.camera", THING, sensing={"kind": "onboard"}
    )
    for number, run in enumerate((folder, hostile_camera)):
        ot.render_video(
            run, path=tmp_path / f"{number}.mp4", width=160, height=96, fps=10, processes=2
        )
    assert_nothing_ran(watch, tmp_path)


@pytest.mark.parametrize("name", RUNS)
def test_commands_end_with_a_page_or_one_line(name, watch, tmp_path):
    """Status 0 where a run can be shown without what it names, else 2 and one line."""
    folder = str(RUNS[name](tmp_path / "run"))
    file = str(tmp_path / "a.html")
    for words in (["replay", folder, "--out", file], ["compare", folder, folder]):
        done = omnitrack(*words)
        if done.returncode == 0:
            continue
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ")
        assert THING in line
    assert_nothing_ran(watch, tmp_path)


def test_every_command_that_looks_can_be_told_to_trust():
    """Those that the page says look, but for imports, logs and calibrations, whose files name no
    code."""
    can = {
        command.name or command.callback.__name__
        for command in app.registered_commands
        if command.callback and "trust" in inspect.signature(command.callback).parameters
    }
    (row,) = (line for line in page("trust").splitlines() if line.startswith("| look |"))
    looks = {words.split()[0] for words in re.findall(r"`([^`]+)`", row.split("|")[2])}
    assert can == looks - {"import"}
    names = {name for name in re.findall(r"`([^`]+)`", row.split("|")[3]) if "load" in name}
    for name in {*names, "compare"} - {"load_calibration", "load_log"}:
        take = functools.reduce(getattr, name.split("."), ot)
        assert "trust" in inspect.signature(take).parameters, name
    assert len(names) > 5


def test_a_strangers_passport_says_where_his_robot_gets_to(watch, tmp_path):
    """Its robot's sizes are in it, so that a map of its reach is that of its class."""
    own = passport(trials=30)
    own = dataclasses.replace(own, robot=Stranger(), changes={"robot.kind": Stranger.kind})
    table = own.table()
    about = table.schema.metadata[b"passport"].replace(Stranger.kind.encode(), THING.encode())
    file = tmp_path / "passport.parquet"
    pq.write_table(table.replace_schema_metadata({"passport": about}), file)
    read = ot.load_passport(file)
    assert read.robot.kind == "recorded"
    for name in ("mass", "nominal_bore", "length", "bores"):
        assert getattr(read.robot, name) == getattr(own.robot, name)
    network = ot.load_network("tower")
    maps = [ot.map_reach(network, one, ["foot"]) for one in (own, read)]
    assert maps[0].parts == maps[1].parts
    assert_nothing_ran(watch, tmp_path)


def test_a_sweep_is_read_without_the_file_of_its_robot(tmp_path):
    """Tables need the robot's words alone, which the sweep has recorded."""
    file = tmp_path / "ball.xml"
    body = "<body name='ball'><freejoint/><geom size='0.05'/></body>"
    file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    robot = {"kind": "mjcf", "file": str(file)}
    brief = {"run": {"time_limit": 0.05}, "start": {"distance": 0.2}}
    base = validate(SCENARIO | brief | {"robot": robot})
    (tmp_path / "base.json").write_text(base.model_dump_json())
    axis = '[[axes]]\nkind = "list"\npath = "world.friction"\nvalues = [0.5, 0.9]\n'
    (tmp_path / "sweep.toml").write_text(f'base = "base.json"\n{axis}')
    result = ot.run_trials(ot.load_sweep(tmp_path / "sweep.toml"), out=tmp_path / "out")
    file.unlink()
    read = ot.load_sweep_result(tmp_path / "out")
    assert read.table.equals(result.table)
    ot.plot_sweep(tmp_path / "out", over="world.friction")
    with pytest.raises(ot.OutputError, match="no such file"):
        ot.load_sweep_result(tmp_path / "out", trust=True)
