"""The published models: generated, complete, reproducible; looks change nothing."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from omnitrack_sim.cli import main
from omnitrack_sim.pipes import Elbow, Step, route
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack import published as export
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.looks import add_robot_looks
from omnitrack_sim.robots.omnitrack.published import check_models, write_models
from omnitrack_sim.walls.geoms import new_spec
from omnitrack_sim.walls.pipe_looks import add_cameras, add_pipe_looks

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("published")
    write_models(root / "models", root / "assets")
    return root / "models", root / "assets"


def test_written_models_pass_their_check(folders):
    """What was just written is what would be written: generation is reproducible to the byte."""
    assert check_models(*folders) == []


def test_check_names_changed_missing_and_stray_files(folders, tmp_path, monkeypatch):
    """Every file that is not as generated is named."""
    models, assets = (shutil.copytree(folder, tmp_path / folder.name) for folder in folders)
    (models / "robot.xml").write_text("<mujoco/>")
    (assets / "tee.stl").unlink()
    (models / "old.xml").write_text("<mujoco/>")
    # As just written: making them again is tested above.
    monkeypatch.setattr(
        export,
        "_files",
        lambda *places: {
            place / path.name: path.read_bytes()
            for place, folder in zip(places, folders, strict=True)
            for path in folder.iterdir()
        },
    )
    assert check_models(models, assets) == ["old.xml", "robot.xml", "tee.stl"]


def test_the_published_models_are_those_of_the_package(folders):
    """What lies in the checkout is what would be written."""
    for folder in folders:
        published = ROOT / folder.name
        assert sorted(p.name for p in published.iterdir()) == sorted(
            p.name for p in folder.iterdir()
        )
        for path in folder.iterdir():
            assert (published / path.name).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize(
    ("argument", "root", "message"),
    [
        ("--check", "nothing_here", "live in a checkout of the project, not in the installed"),
        ("--check", "n" * 300, "cannot be read: File name too long"),
        ("--write", "file", "cannot be written: Not a directory"),
        ("--write", "n" * 300, "cannot be written: File name too long"),
        ("--write", "taken", "robot.xml: is a folder; choose a file"),
        ("--write", "closed", "cannot be written: Permission denied"),
    ],
)
def test_the_command_refuses_odd_places(tmp_path, monkeypatch, capsys, argument, root, message):
    """`omnitrack models` ends with status 2 and one message, and changes nothing."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "taken" / "models" / "robot.xml").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    small = {"assets": "tee.obj", "models": "robot.xml"}
    monkeypatch.setattr(
        export, "_files", lambda *folders: {f / small[f.name]: b"new" for f in folders[::-1]}
    )
    if root == "closed":  # whoever runs the tests may write everywhere
        monkeypatch.setattr(Path, "mkdir", _denied)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["omnitrack", "models", argument, "--root", root])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert sorted(tmp_path.rglob("*")) == before


def _denied(path: Path, **_: object) -> None:
    raise PermissionError(errno.EACCES, "Permission denied", str(path))


def test_scenes_start_with_every_module_on_the_wall(folders):
    """In the keyframe of a scene all three modules push on the wall after a moment."""
    scenes = sorted(folders[0].glob("scene_*.xml"))
    assert len(scenes) == 3
    for path in scenes:
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
        for _ in range(50):
            mujoco.mj_step(model, data)
        lugs = [model.body(model.geom_bodyid[g]).name for c in data.contact for g in c.geom]
        for module in (1, 2, 3):
            assert any(lug.startswith(f"lug_{module}_") for lug in lugs), path.name


def test_a_robot_of_another_size_looks_the_same():
    """Every geom and mesh of a scaled robot is the reference's, scaled."""
    models = []
    for scale in (1.0, 0.625):
        spec, robot = new_spec("robot"), Omnitrack(scale=scale)
        add_robot(spec, robot)
        add_robot_looks(spec, robot)
        models.append(spec.compile())
    one, small = models
    for name in ("geom_pos", "geom_size", "mesh_vert", "body_pos"):
        assert getattr(small, name) == pytest.approx(0.625 * getattr(one, name), abs=1e-8), name


def test_both_tracks_of_a_module_have_its_hue():
    """Those of the lower track are paler, and no darker, so that modules are told apart by it."""
    spec, robot = new_spec("robot"), Omnitrack()
    add_robot(spec, robot)
    add_robot_looks(spec, robot)
    for number, colour in enumerate(MODULE_COLOURS, start=1):
        upper, lower = (spec.material(f"{t}_{number}").rgba[:3] for t in ("upper", "lower"))
        np.testing.assert_allclose(upper, colour, atol=1e-6)
        assert (lower > upper).all()
        assert np.ptp(lower) > 0.5 * np.ptp(upper)
        assert np.argsort(lower).tolist() == np.argsort(upper).tolist()


def test_looks_change_nothing_physical():
    """With looks the robot has the same bodies, masses and inertias, and no look can touch
    anything."""
    plain, dressed = new_spec("plain"), new_spec("dressed")
    network = route([Step("bend", Elbow(0.24), "start", "end")]).network
    for spec in (plain, dressed):
        add_robot(spec, Omnitrack())
    add_robot_looks(dressed, Omnitrack())
    add_pipe_looks(dressed, network)
    add_cameras(dressed, network, dressed.body("chassis"))
    a, b = plain.compile(), dressed.compile()
    np.testing.assert_array_equal(a.body_mass, b.body_mass)
    np.testing.assert_array_equal(a.body_inertia, b.body_inertia)
    np.testing.assert_array_equal(a.body_ipos, b.body_ipos)
    looks = [g for g in range(b.ngeom) if b.geom(g).name.startswith("look_")]
    assert len(looks) == b.ngeom - a.ngeom > 0
    assert not b.geom_contype[looks].any()
    assert not b.geom_conaffinity[looks].any()
    assert {b.camera(i).name for i in range(b.ncam)} == {"side", "follow", "onboard"}
