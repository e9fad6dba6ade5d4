"""Replay pages as files: what is in them, when there is none, and the command that writes them."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from commands import omnitrack
from documents import page
from samples import sample_result, sample_trajectory, two_legs_result

import omnitrack_sim as ot
from omnitrack_sim import override, render_replay
from omnitrack_sim.base.errors import InputError, OutputError, RenderError
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.scenario import validate
from omnitrack_sim.scenario.model import sha256_of
from omnitrack_sim.show.replay.contents import STEPS, Pack
from omnitrack_sim.show.replay.document import LIBRARY, differences, pipes_mismatch, replay_data
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.surfaces import geoms_surface


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return sample_result().save(tmp_path_factory.mktemp("runs") / "run")


def in_pipes(**changes):
    """A sample whose scenario has other values."""
    scenario = override(sample_result().scenario, changes)
    return sample_result(scenario=scenario, provenance=provenance_of(scenario))


def test_the_library_is_that_of_its_package():
    """three.js is unchanged: each file has the hash that stands beside it, and no file is without
    one."""
    lines = (LIBRARY / "SHA256SUMS").read_text().splitlines()
    told = {name: digest for digest, name in (line.split() for line in lines)}
    files = {path.name for path in LIBRARY.iterdir()} - {"SHA256SUMS", "README.md"}
    assert set(told) == files
    for name, digest in told.items():
        assert hashlib.sha256((LIBRARY / name).read_bytes()).hexdigest() == digest


def test_no_script_ends_its_element():
    """Scripts stand in the page as they are, so none may hold what ends or comments out one."""
    for path in (*LIBRARY.glob("*.js"), *(LIBRARY.parents[1] / "page").glob("*.js")):
        text = path.read_text(encoding="utf-8").lower()
        assert "</script" not in text, path
        assert "<!--" not in text, path


def test_the_same_run_gives_the_same_bytes(run, tmp_path):
    """From the result and from its folder; it holds no address of anything to fetch, and no
    path."""
    for name in ("one", "other"):
        render_replay(run if name == "one" else sample_result(), path=tmp_path / f"{name}.html")
    page = (tmp_path / "one.html").read_bytes()
    assert page == (tmp_path / "other.html").read_bytes()
    assert str(tmp_path).encode() not in page
    assert re.findall(rb'(?:src|href)="(?!data:,")[^"]*"', page) == []


def test_a_page_holds_the_licence(run, tmp_path):
    """three.js goes with its licence wherever the page goes."""
    page = render_replay(run, path=tmp_path / "a.html").html
    assert (LIBRARY / "LICENSE").read_text(encoding="utf-8") in page


def test_words_in_the_data_are_no_markup(tmp_path):
    """No name can end the element of the data, and the title is escaped."""
    name, reason = "<!--<script>&<b>", "</script><script>alert(1)</script>"
    scenario = validate({"name": name, "pipes": [{"kind": "straight", "length": 1.0}]})
    result = sample_result(scenario=scenario, reason=reason)
    page = render_replay(result, path=tmp_path / "a.html").html
    assert name not in page
    assert reason not in page
    assert "<title>&lt;!--&lt;script&gt;&amp;&lt;b&gt;, replay</title>" in page
    (data,) = re.findall(r'id="data">(.*?)</script>', page, flags=re.DOTALL)
    heading = json.loads(data)["runs"][0]["heading"]
    assert (heading["name"], heading["reason"]) == (name, reason)


def test_a_run_of_two_legs_has_map_legs_and_gears():
    """What the page tells of a mission: the map, fittings by leg and gear, phases in order."""
    data = replay_data(RunPlayback(two_legs_result(), coarse=False))
    fittings = data["runs"][0]["fittings"]
    assert {(fitting["leg"], fitting["tail"]) for fitting in fittings} == {(1, False), (2, True)}
    assert data["map"]["goals"]
    assert len(data["map"]["view"]) == 2
    starts = [phase["start"] for phase in data["runs"][0]["phases"]]
    assert starts == sorted(starts)
    assert replay_data(RunPlayback(sample_result(), coarse=False))["map"] is None


def test_physics_that_diverged_is_shown_up_to_there(tmp_path):
    """Unsound samples stand still; of a run without a sound one there is no page."""
    trajectory = sample_trajectory()
    trajectory.qpos[100:] = np.nan
    trajectory.channels["tilt"][100:] = np.inf
    assert len(render_replay(sample_result(trajectory)).html) > 800_000
    trajectory.qpos[:] = np.nan
    with pytest.raises(RenderError, match="no pose"):
        render_replay(sample_result(trajectory), path=tmp_path / "b.html")
    assert not (tmp_path / "b.html").exists()


def test_a_run_of_one_sample_has_a_page():
    """A run may end where it began."""
    two = sample_trajectory(samples=2)
    channels = {name: values[:1] for name, values in two.channels.items()}
    one = replace(two, time=two.time[:1], qpos=two.qpos[:1], channels=channels)
    assert render_replay(sample_result(one)).html


def test_channels_of_own_sensors_have_plots():
    """A channel of one's own is among the plots, with its unit; one of many numbers is not."""
    plain = sample_trajectory()
    own = {
        "current": Channel("current", (2,), "A", "of two motors"),
        "picture": Channel("picture", (64,), "1", "of a camera"),
    }
    channels = {**plain.channels, "current": np.ones((201, 2)), "picture": np.zeros((201, 64))}
    trajectory = Trajectory(plain.time, channels, plain.phases, plain.qpos, {**RECORDED, **own})
    data = replay_data(RunPlayback(sample_result(trajectory), coarse=False))
    panels = {panel["channel"]: panel["unit"] for panel in data["panels"]}
    assert panels["current"] == "A"
    assert "picture" not in panels
    assert data["runs"][0]["curves"]["current"]["columns"] == 2


def test_tables_keep_numbers_and_gaps():
    """Rounded to a part of their range, and whole numbers exactly, negative ones too."""
    pack, values = Pack(), np.array([[0.0, 5.0], [np.nan, 5.0], [1.0, 5.0]])
    place = pack.ranged(values)
    assert (place["rows"], place["columns"], place["gap"]) == (3, 2, STEPS + 1)
    assert place["low"] == [0.0, 5.0]
    assert pack.whole(np.array([-3, 70_000, -70_000]))["bytes"] == 3


def test_edges_stay_sharp_and_round_things_round():
    """The normals of a box, also of one that is a mesh, are those of its faces; those of a ball
    point away from its centre."""
    spec, box = mujoco.MjSpec(), trimesh.creation.box()
    spec.add_mesh(name="mesh", uservert=box.vertices.ravel(), userface=box.faces.ravel())
    kinds = mujoco.mjtGeom
    spec.worldbody.add_geom(type=kinds.mjGEOM_MESH, meshname="mesh")
    spec.worldbody.add_geom(type=kinds.mjGEOM_BOX, size=[0.5, 0.5, 0.5])
    spec.worldbody.add_geom(type=kinds.mjGEOM_SPHERE, size=[0.5, 0, 0])
    mesh, primitive, ball = (geoms_surface(spec.compile(), [i], fine=True) for i in range(3))
    for surface in (mesh, primitive):
        corners, normals = surface.position[surface.faces], surface.normal[surface.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        np.testing.assert_allclose(normals, np.repeat(across[:, None], 3, axis=1), atol=1e-6)
    np.testing.assert_allclose(ball.normal, 2 * ball.position, atol=0.02)


def test_arrows_are_as_long_as_half_a_bore_at_most():
    """98 % of the forces are at most 80 mm long; the scale is 1, 2 or 5 times a power of ten."""
    data, trajectory = replay_data(RunPlayback(sample_result(), coarse=False)), sample_trajectory()
    assert list(data["arrows"]) == ["normal_force", "traction"]
    for name, kind in data["arrows"].items():
        longest = kind["scale"] * np.percentile(np.abs(trajectory[name]), 98)
        assert 0.03 < longest <= 0.08
        assert f"{kind['scale']:.0e}"[0] in "125"


def test_differences_of_scenarios_are_told_by_path():
    """Both values; nothing of what is the same."""
    pipe = {"kind": "straight", "length": 1.0}
    one, named, other = (
        sample_result(scenario=validate({"name": "a", "pipes": [pipe | {"name": name}]} | changes))
        for name, changes in (("x", {}), ("y", {}), ("y", {"world": {"friction": 0.3}}))
    )
    assert differences(one, named) == []
    friction = one.scenario.world.friction
    assert differences(one, other) == [["world.friction", "1", f"{friction:.4g}", "0.3"]]


@pytest.mark.parametrize(
    ("pipes", "told"),
    [
        ([{"kind": "straight", "length": 1.1}], "of straight_0 length is 1.1, not 1.0"),
        ([{"kind": "straight", "length": 0.5}] * 2, "has 2 fittings, and the first run 1; ot.comp"),
    ],
)
def test_a_run_through_other_pipes_is_refused(tmp_path, pipes, told):
    """A ghost in the walls would mislead."""
    scenario = validate({"name": "other", "pipes": pipes})
    with pytest.raises(InputError, match=told):
        render_replay(
            sample_result(), path=tmp_path / "a.html", compare=sample_result(scenario=scenario)
        )
    assert [*tmp_path.iterdir()] == []


def test_a_robot_of_another_size_is_a_ghost_of_its_own():
    """Its solids are its own; what both have in common stands in the page once."""
    alone = len(replay_data(RunPlayback(in_pipes(), coarse=False))["shapes"])
    same = replay_data(
        RunPlayback(in_pipes(), coarse=False),
        RunPlayback(in_pipes(**{"world.friction": 0.4}), coarse=False),
    )
    other = replay_data(
        RunPlayback(in_pipes(), coarse=False),
        RunPlayback(in_pipes(**{"robot.contact_length": 0.1}), coarse=False),
    )
    assert len(same["shapes"]) == alone < len(other["shapes"])


def test_the_example_of_the_page_on_replays_runs(tmp_path, monkeypatch):
    """Its Python writes the page of two runs."""
    text = page("replay")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    exec(compile(code, "replay.md", "exec"), {"__name__": "replay"})
    assert [path.name for path in tmp_path.iterdir()] == ["replay.html"]
    assert "control.cruise_speed" in (tmp_path / "replay.html").read_text(encoding="utf-8")


def test_another_ending_is_refused(run, tmp_path):
    """A page is HTML."""
    with pytest.raises(InputError, match=r"choose from: html"):
        render_replay(run, path=tmp_path / "a.pdf")


def test_what_is_no_run_is_refused(run, tmp_path):
    """No positions, a damaged file, no folder; as the run and as the one beside it."""
    damaged = Path(shutil.copytree(run, tmp_path / "damaged"))
    (damaged / "replay.npz").unlink()
    with pytest.raises(OutputError, match=r"is no run: replay\.npz is missing"):
        render_replay(damaged, path=tmp_path / "a.html")
    later = json.loads((run / "scenario.json").read_text()) | {"of_a_later_version": 1}
    (damaged / "scenario.json").write_text(json.dumps(later))
    told = json.loads((run / "result.json").read_text())
    told["provenance"]["scenario_sha256"] = sha256_of(later)
    (damaged / "result.json").write_text(json.dumps(told))
    with pytest.raises(OutputError, match=r"scenario\.json: .*of_a_later_version"):
        render_replay(damaged, path=tmp_path / "a.html")
    for name in ("scenario.json", "result.json"):
        shutil.copy(run / name, damaged)
    (damaged / "replay.npz").write_bytes(b"PK")
    for one, other in ((damaged, None), (run, damaged)):
        with pytest.raises(OutputError, match=r"replay\.npz: is damaged"):
            render_replay(one, path=tmp_path / "a.html", compare=other)
    with pytest.raises(TypeError, match=r"it must be an ot\.Result"):
        render_replay(3, path=tmp_path / "a.html")  # type: ignore[arg-type]
    assert [*tmp_path.iterdir()] == [damaged]


def test_the_command_writes_a_page_beside_the_run(run):
    """And says where; a second one takes its place."""
    for _ in range(2):
        done = omnitrack("replay", str(run), "--compare", str(run))
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == f"saved {run}/replay.html"
    assert (run / "replay.html").stat().st_size < 4e6


def test_the_command_ends_with_2_for_bad_input(run, tmp_path):
    """A file, no folder, an ending that is none, pipes that differ."""
    scenario = validate({"name": "other", "pipes": [{"kind": "straight", "length": 2.0}]})
    other = sample_result(scenario=scenario, provenance=provenance_of(scenario))
    other.save(tmp_path / "other")
    for words, told in (
        ([tmp_path / "nothing"], "no such folder"),
        ([run / "result.json"], "is a file"),
        ([run, "--out", tmp_path / "a.txt"], "choose from: html"),
        ([run, "--out", tmp_path / "none" / "a.html"], "none"),
        ([run, "--compare", tmp_path / "other"], f"--compare {tmp_path / 'other'}: it drove"),
        ([run, "--compare", tmp_path / "other"], f"`omnitrack compare {run} {tmp_path / 'other'}`"),
    ):
        done = omnitrack("replay", *map(str, words))
        assert done.returncode == 2, words
        assert told in " ".join(done.stderr.split())
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"start.axis": [0.0, 1.0, 0.0]}, "straight_0 lies in another direction (start.axis, "),
        ({"pipes.0.length": 1.7}, "of straight_0 length is 1.7, not "),
    ],
)
def test_other_pipes_are_told_by_what_differs(changes, told):
    """The direction of the start, or the size of a part by its key."""
    scenario = ot.load_scenario("straight", {"run.time_limit": 0.1})
    one, other = (
        RunPlayback(ot.run(ot.override(scenario, own), no_load=False)) for own in ({}, changes)
    )
    assert told in pipes_mismatch(one, other)
    assert pipes_mismatch(one, one) == ""
