"""The command line: files left behind, exit status, messages."""

import dataclasses
import json
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import mujoco
import pytest
from commands import omnitrack
from samples import two_legs_result
from typer.testing import CliRunner

from omnitrack_sim import load_result, load_scenario
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out
from omnitrack_sim.cli.runs import print_result, usual_camera

SHORT = ["--set", "run.time_limit=0.3"]


def process(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "omnitrack_sim.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "straight"
    done = process("run", "straight", *SHORT, "--no-video", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    return folder


def test_run_leaves_its_files(run_dir):
    """A run without video leaves seven files and nothing temporary beside them."""
    names = {p.name for p in run_dir.iterdir()}
    assert names == {
        "scenario.json",
        "result.json",
        "timeline.csv",
        "trajectory.parquet",
        "replay.npz",
        "replay.html",
        "summary.png",
    }
    assert [p.name for p in run_dir.parent.iterdir()] == ["straight"]


def test_a_run_through_many_fittings_has_a_map_and_a_table(tmp_path):
    """More than three fittings: map.png beside the others, the fittings with units on the screen,
    rows in the CSV."""
    pipes = [
        ("straight", ""),
        ("elbow", ""),
        ("straight", ""),
        ("tee", 'enter = "run_start"\nleave = "branch"'),
    ]
    text = "".join(f'[[pipes]]\nkind = "{kind}"\n{rest}\n' for kind, rest in pipes)
    text = text.replace('"straight"\n', '"straight"\nlength = 0.4\n')
    (tmp_path / "chain.toml").write_text(text)
    limit = ["--set", "run.time_limit=0.3", "--set", "start.distance=0.385"]
    done = omnitrack(
        "run", str(tmp_path / "chain.toml"), *limit, "--no-video", "--out", str(tmp_path / "chain")
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "chain" / "map.png").stat().st_size > 10_000
    rows = (tmp_path / "chain" / "timeline.csv").read_text().splitlines()
    assert [row.split(",")[2] for row in rows] == ["name", "straight_0", "elbow_1"]
    assert "straight_0" in done.stdout
    assert "theta5" in done.stdout
    assert " deg " in done.stdout


def test_result_file_says_what_happened(run_dir):
    """result.json has outcome, success, duration, metrics of three modules and provenance."""
    result = json.loads((run_dir / "result.json").read_text())
    assert result["outcome"] == "timed_out"
    assert result["success"] is False
    assert result["duration_s"] == pytest.approx(0.3)
    for name in (
        "slip_ratio_mean",
        "traction_rms_n",
        "normal_force_mean_n",
        "contact_fraction",
        "stall_time_s",
    ):
        assert len(result["metrics"][name]) == 3
    assert {"seed", "scenario_sha256", "versions", "git_commit"} <= set(result["provenance"])
    versions = result["provenance"]["versions"]
    assert versions["python"] == platform.python_version()
    assert versions["mujoco"] == mujoco.__version__
    assert versions["omnitrack_sim"] == metadata.version("omnitrack_sim")


def test_an_override_reaches_the_run(run_dir):
    """--set is in the resolved scenario."""
    assert load_result(run_dir).scenario.run.time_limit == 0.3


def test_json_goes_to_standard_output(tmp_path):
    """--json prints result.json and nothing else."""
    done = omnitrack(
        "run", "straight", *SHORT, "--no-video", "--json", "--out", str(tmp_path / "a")
    )
    assert json.loads(done.stdout)["outcome"] == "timed_out"


def test_same_scenario_same_bytes(tmp_path, run_dir):
    """Run twice, every file is the same byte for byte."""
    omnitrack("run", "straight", *SHORT, "--no-video", "--out", str(tmp_path / "again"))
    names = sorted(path.name for path in run_dir.iterdir())
    assert sorted(path.name for path in (tmp_path / "again").iterdir()) == names
    for name in names:
        assert (run_dir / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "nowhere"], "tee_turn"),
        (["run", "straight", "--set", "control.sped=1"], "control.sped"),
        (["run", "straight", "--set", "world.friction"], "PATH=VALUE"),
        (["run", "straight", "--set", "pipes.0.length=-1"], "pipes.0.length"),
        (["run", "straight", "--camera", "above"], "follow"),
        (["render", "nowhere"], "nowhere"),
        (["models"], "--check"),
    ],
)
def test_bad_input_ends_with_status_2_and_names_the_place(arguments, told, tmp_path):
    """Bad arguments end with status 2 and a message, without a traceback or a file."""
    done = omnitrack(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_robots_in_networks_are_filmed_by_the_camera_that_follows_them():
    """Pipes of a network turn away from one that stands still."""
    names = {"tee_turn": "side", "missions/fig14": "follow", "missions/explore_house": "follow"}
    assert {name: usual_camera(load_scenario(name)) for name in names} == names


def test_a_folder_that_is_no_run_is_left_alone(tmp_path):
    """A folder with other files is refused before anything runs, and keeps its files."""
    (tmp_path / "thesis.txt").write_text("mine")
    done = omnitrack("run", "straight", *SHORT, "--no-video", "--out", str(tmp_path))
    assert done.returncode == 2
    assert "no run" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


def test_what_python_warns_of_is_told_without_its_code():
    """A command prints a warning on standard error, a line each, as it is."""
    code = (
        "import warnings\nfrom omnitrack_sim.cli import program\n"
        "program.app = lambda **_: warnings.warn('slippery [wet]\\nand dark')\n"
        "program.run_command()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    told = "warning: slippery [wet]\nwarning: and dark\n"
    assert (done.returncode, done.stdout, done.stderr) == (0, "", told)


def test_scenarios_and_parameters_are_listed_for_machines():
    """The lists are valid JSON with every shipped scenario and every robot field."""
    listed = json.loads(omnitrack("scenarios", "--json").stdout)
    assert "tee_turn" in listed
    rows = {row["name"]: row for row in json.loads(omnitrack("parameters", "--json").stdout)}
    assert rows["spring_stiffness"]["provenance"] == "published"
    assert rows["motor.gear_ratio"]["value"] == 986.41
    robot = load_scenario("straight").robot
    assert {name.partition(".")[0] for name in rows} == set(type(robot).model_fields) - {
        "tether"
    }  # none


def test_view_without_a_screen_says_so(monkeypatch):
    """The viewer needs a screen; without one it is a clear error."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = omnitrack("view", "straight")
    assert done.returncode == 2
    assert "screen" in done.stderr


def test_singularity_prints_the_papers_numbers():
    """The default robot at the reach of 96.54 degrees: every key that scripts rely on, with its
    value."""
    done = omnitrack("singularity", "--sector-deg", "96.54", "--json")
    told = json.loads(done.stdout)
    assert told["sector_deg"] == pytest.approx(96.54)
    assert told["margin_deg"] == pytest.approx(11.73)
    assert told["failure_rate"] == pytest.approx(0.8045)
    assert told["success_rate"] == pytest.approx(0.1955)
    assert told["reach_m"] == pytest.approx(0.0961017, abs=1e-7)
    assert told["definition"] == "ellipse"
    assert told["real_geometry"]["sector_deg"] == pytest.approx(94.5, abs=0.1)
    assert told["real_geometry"]["contact_length_m"] == 0.09
    assert set(told["definitions"]) == {"ellipse", "crotch", "strip"}


def test_singularity_table_judges_an_orientation_and_plans_its_roll():
    """The table has each definition; theta5 = 60 is singular and rolls out, a robot without margin
    is told why not."""
    done = omnitrack("singularity", "--theta5-deg", "60")
    assert all(name in done.stdout for name in ("ellipse", "crotch", "strip", "real", "96.55"))
    assert "theta5 60 deg: singular" in done.stdout
    assert (
        "theta5 becomes 11.73 deg, and the belts then drive backward for a positive speed"
        in done.stdout
    )
    done = omnitrack("singularity", "--theta5-deg", "60", "--reach", "0.088")
    assert "no plan: the safe margin is zero" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((60, -90), "theta5 becomes 11.73 deg, and the belts then drive forward for a positive"),
        ((0, 0), "theta5 0 deg: safe\n  no roll needed\n"),
    ],
    ids=["forward", "no roll"],
)
def test_a_plan_says_which_way_the_belts_drive_after_it(arguments, told):
    """A roll that ends beyond 90 degrees turns the belts round; where it is safe none is needed."""
    theta5, roll = map(str, arguments)
    done = CliRunner().invoke(app, ["singularity", "--theta5-deg", theta5, "--roll-deg", roll])
    assert done.exit_code == 0, done.output
    assert told in done.stdout


def test_singularity_writes_its_figure(tmp_path):
    """--plot leaves the file and nothing beside it."""
    done = omnitrack("singularity", "--plot", str(tmp_path / "sector.svg"), "--figure", "sector")
    assert done.returncode == 0, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["sector.svg"]
    assert (tmp_path / "sector.svg").read_text().lstrip().startswith("<?xml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--reach", "-1"], "reach: is -1; it must be positive"),
        (["--turn-angle-deg", "200"], "turn_angle: is 200 degrees"),
        (["--modules", "0"], "modules: is 0"),
        (["--definition", "oval"], "choose from: ellipse, crotch, strip"),
        (["--reach", "0.1", "--sector-deg", "90"], "--reach, --sector-deg: give one"),
        (["--sector-deg", "300"], "sector: is 300 degrees"),
        (["--contact-length", "-1"], "contact_length"),
        (["--plot", "a.gif"], "choose from: png, svg, pdf"),
        (
            ["--plot", "a.png", "--figure", "x"],
            "all, sections, orientations, sector, definitions, map",
        ),
        (["--plot", "missing/a.png"], "a.png: the folder missing does not exist"),
    ],
)
def test_singularity_refuses_bad_input(tmp_path, arguments, message):
    """Status 2, the fault named, nothing written."""
    done = omnitrack("singularity", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("measured", [True, False])
def test_slip_is_printed_where_it_was_measured(measured, monkeypatch, capsys, tmp_path):
    """A column of the passages and its words below; robots without tracks have neither."""
    run = two_legs_result()
    passages = run.timeline()
    if not measured:
        passages = [dataclasses.replace(passage, slip_ratio_mean=None) for passage in passages]
    monkeypatch.setattr(type(run), "timeline", lambda self: passages)
    monkeypatch.setattr(out, "_width", 200)
    print_result(run, tmp_path)
    text = capsys.readouterr().out
    assert ("slip: mean ratio" in text) is measured
    (heads,) = [line.split() for line in text.splitlines() if "theta5" in line and "tilt" in line]
    assert ("slip" in heads) is measured
