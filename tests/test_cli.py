"""The command line: files left behind, exit status, messages."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from omnitrack_sim import load_result, load_scenario

SHORT = ["--set", "physics.time_limit=0.3"]


def omnitrack(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "omnitrack_sim.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120)


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "straight"
    done = omnitrack("run", "straight", *SHORT, "--no-video", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    return folder


def test_run_leaves_its_files(run_dir):
    """A run without video leaves five files and nothing temporary beside them."""
    names = {p.name for p in run_dir.iterdir()}
    assert names == {"scenario.json", "result.json", "trajectory.parquet", "replay.npz", "summary.png"}
    assert [p.name for p in run_dir.parent.iterdir()] == ["straight"]


def test_result_file_says_what_happened(run_dir):
    """result.json has outcome, success, duration, metrics of three modules and provenance."""
    result = json.loads((run_dir / "result.json").read_text())
    assert result["outcome"] == "timed_out"
    assert result["success"] is False
    assert result["duration_s"] == pytest.approx(0.3)
    for name in ("slip_ratio_mean", "traction_rms_n", "normal_force_mean_n", "contact_fraction", "stall_time_s"):
        assert len(result["metrics"][name]) == 3
    assert {"seed", "scenario_sha256", "versions", "git_commit"} <= set(result["provenance"])


def test_an_override_reaches_the_run(run_dir):
    """--set is in the resolved scenario."""
    assert load_result(run_dir).scenario.physics.time_limit == 0.3


def test_json_goes_to_standard_output(tmp_path):
    """--json prints result.json and nothing else."""
    done = omnitrack("run", "straight", *SHORT, "--no-video", "--json", "--out", str(tmp_path / "a"))
    assert json.loads(done.stdout)["outcome"] == "timed_out"


def test_same_scenario_same_bytes(tmp_path, run_dir):
    """Run twice, every file is the same byte for byte."""
    omnitrack("run", "straight", *SHORT, "--no-video", "--out", str(tmp_path / "again"))
    for path in run_dir.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "nowhere"], "tee_turn"),
        (["run", "straight", "--set", "control.sped=1"], "control.sped"),
        (["run", "straight", "--set", "contact.friction"], "PATH=VALUE"),
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


def test_a_folder_that_is_no_run_is_left_alone(tmp_path):
    """A folder with other files is refused before anything runs, and keeps its files."""
    (tmp_path / "thesis.txt").write_text("mine")
    done = omnitrack("run", "straight", *SHORT, "--no-video", "--out", str(tmp_path))
    assert done.returncode == 2
    assert "no run" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


def test_scenarios_and_parameters_are_listed_for_machines():
    """The lists are valid JSON with every shipped scenario and every robot field."""
    listed = json.loads(omnitrack("scenarios", "--json").stdout)
    assert "tee_turn" in listed
    rows = {row["name"]: row for row in json.loads(omnitrack("parameters", "--json").stdout)}
    assert rows["spring_stiffness"]["provenance"] == "published"
    assert set(rows) == set(type(load_scenario("straight").robot).model_fields)


def test_view_without_a_screen_says_so(monkeypatch):
    """The viewer needs a screen; without one it is a clear error."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = omnitrack("view", "straight")
    assert done.returncode == 2
    assert "screen" in done.stderr
