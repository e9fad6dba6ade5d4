"""What a shell completes, asked as a shell asks."""

import os
import subprocess
import sys
from unittest import mock

import pytest
import typer.main
from commands import omnitrack

import omnitrack_sim as ot
from omnitrack_sim.cli import complete
from omnitrack_sim.show.film.render import CAMERAS


def completed(line, cwd, shell="bash"):
    """The words that a shell is told for the last one of a line."""
    words = line.split(" ")
    asked = {"_OMNITRACK_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line}
    bash = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    with mock.patch.dict(os.environ, asked | bash):
        done = omnitrack(cwd=cwd)
    assert done.stderr == ""
    return done.stdout.split("\n")[:-1] if done.stdout.strip() else []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("omnitrack reprod", ["reproduce"]),
        ("omnitrack run tee", ["tee_merge", "tee_straight", "tee_turn", "tee_mine.toml"]),
        ("omnitrack run ", [*ot.shipped_files("scenarios"), "mine/", "tee_mine.toml"]),
        ("omnitrack run mine/", ["mine/a.json"]),
        ("omnitrack new x --from paper/elbow_p", ["paper/elbow_preferred"]),
        ("omnitrack sweep tee_f", ["tee_factors"]),
        ("omnitrack optimise rob", ["robot_design"]),
        ("omnitrack network tow", ["tower"]),
        ("omnitrack parameters vert", ["vertical_climb"]),
        ("omnitrack parameters pre", ["presser"]),
        ("omnitrack reproduce m", ["mjcf", "measured"]),
        ("omnitrack render out --camera ", list(CAMERAS)),
        ("omnitrack run tee_turn --set world.f", ["world.friction="]),
        ("omnitrack run x --set control.parameters.sway.s", [
            "control.parameters.sway.slip=", "control.parameters.sway.slip_range="]),
        ("omnitrack sweep x --set robot.motor.gear", ["robot.motor.gear_ratio="]),
        ("omnitrack run x --set pipes.*.mean", ["pipes.*.mean_radius="]),
        ("omnitrack run nothing/of/the/kind", []),
    ],
)  # fmt: skip
def test_words_that_begin_so_are_offered(tmp_path, line, words):
    """Commands, shipped names and files beside them, cameras and paths of values."""
    (tmp_path / "mine").mkdir()
    for name in ("tee_mine.toml", "tee_mine.txt", ".hidden.toml", "mine/a.json"):
        (tmp_path / name).touch()
    assert completed(line, tmp_path) == words


@pytest.mark.parametrize(
    "name",
    [
        *(
            "scenarios",
            "sweeps",
            "studies",
            "suites",
            "networks",
            "conditions",
            "policies",
            "towns",
            "kinds",
        ),
        *("reproduced", "robots", "cameras", "settings"),
    ],
)
def test_what_begins_so_is_offered_of_all(name, tmp_path, monkeypatch):
    """Of everything that is offered for nothing that which begins as what is typed, and no more; a
    word for itself; shipped names and files of the kind that the command reads."""
    for file in ("a.toml", "a.json", "a.npz", "a.inp", "a.pcf", "a.md"):
        (tmp_path / file).touch()
    monkeypatch.chdir(tmp_path)
    offered = getattr(complete, name)
    words = [word for word, _ in offered("")]
    assert len(set(words)) == len(words) > 1
    first = words[0].rstrip("=")
    for begin in ("a", "t", "zz", first, words[-1][:-1]):
        assert [word for word, _ in offered(begin)] == [w for w in words if w.startswith(begin)]
    endings = {"policies": {".npz"}, "towns": {".inp", ".pcf"}}.get(name, {".toml", ".json"})
    reads_files = name not in ("kinds", "reproduced", "cameras", "settings")
    found = {f".{word.partition('.')[2]}" for word in words if word.startswith("a.")}
    assert found == (endings if reads_files else set())
    for word, meaning in offered(first):
        assert "\n" not in meaning
        assert len(meaning) <= 76, word
    if name == "settings":
        assert max(len(meaning) for _, meaning in offered("")) > 60  # of a line of 80 columns


def test_every_offered_path_can_be_set():
    """Each path of --set that is offered is one of a scenario with pipes."""
    from omnitrack_sim.cli.complete import settings
    from omnitrack_sim.scenario.loading import set_value

    data = ot.load_scenario("elbow").model_dump(mode="json")
    offered = [word.removesuffix("=") for word, _ in settings("")]
    assert len(offered) == len(set(offered)) > 100
    for path in offered:
        if not path.startswith("pipes."):
            assert set_value(data, path, 0) is None, path


def test_a_shell_that_shows_more_is_told_meanings(tmp_path):
    """zsh shows the comment of a file, and unit and meaning of a value, each in one line."""
    (line,) = completed("omnitrack run reduc", tmp_path, "zsh")
    assert '"reducer":"' in line
    (line,) = completed("omnitrack run x --set start.dist", tmp_path, "zsh")
    assert "Along the centreline" in line


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_and_shown(tmp_path, shell):
    """--install-completion writes into the shell's files of the user, whose home is another here;
    --show-completion prints the same."""
    asked = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    # Commands made anew: Typer asks for that variable as it makes them.
    anew = mock.patch.object(typer.main, "get_command", typer.main.get_command.__wrapped__)
    with mock.patch.dict(os.environ, asked), anew:
        for option in ("--install-completion", "--show-completion"):
            done = omnitrack(option, shell)
            assert (done.returncode, done.stderr) == (0, "")
    assert "_OMNITRACK_COMPLETE" in done.stdout
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert any("OMNITRACK" in path.read_text(encoding="utf-8").upper() for path in written)


def test_completing_a_name_loads_nothing_heavy():
    """A name is completed without pydantic, NumPy and MuJoCo, so that a shell does not wait."""
    code = (
        "import sys; from omnitrack_sim.cli import complete; import omnitrack_sim.cli; "
        "assert complete.scenarios('tee'); "
        "print([m for m in ('pydantic', 'numpy', 'mujoco') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
