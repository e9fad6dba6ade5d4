"""Names that installed distributions add: robots, controllers and fittings, by entry points."""

from __future__ import annotations

import re
import sys
import tomllib

import pytest
from commands import omnitrack
from documents import page

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError, ScenarioError
from omnitrack_sim.base.naming import installed
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.robots.control import controller_of
from omnitrack_sim.robots.kinds import robot_class
from omnitrack_sim.scenario import validate

EXTENDING, ANY_ROBOT = page("extending"), page("any-robot")
MODULES = dict(re.findall(r"`(\w+\.py)`:\n\n```python\n(.*?)```", EXTENDING, re.DOTALL))
SNIPPETS = [
    tomllib.loads("\n".join(line.strip() for line in block.splitlines()))
    for text in (EXTENDING, ANY_ROBOT)
    for block in re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    if "entry-points" in block
]
GROUPS = SNIPPETS[0]["project"]["entry-points"]
PIPES = [{"kind": "straight", "length": 1.0}]
BRIEF = {"run": {"time_limit": 0.1}, "start": {"distance": 0.2}}


def install(folder, groups, name="pipe-crawlers"):
    """Write what an installed distribution leaves: its name, version and entry points."""
    place = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    place.mkdir()
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [
        line
        for group, entries in groups.items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
    ]
    (place / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def crawlers(tmp_path, monkeypatch):
    """The distribution of extending.md, with the robot of any-robot.md, where Python looks."""
    (robot,) = re.findall(r"```python\n([^`]*?class Ball.*?)\nchanges =", ANY_ROBOT, re.DOTALL)
    for file, code in {**MODULES, "my_robot.py": robot}.items():
        (tmp_path / file).write_text(code, encoding="utf-8")
    install(tmp_path, GROUPS)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for file in (*MODULES, "my_robot.py"):
        sys.modules.pop(file.removesuffix(".py"), None)


def test_the_pages_declare_the_same_robot():
    """any-robot.md shows the lines of extending.md that concern robots."""
    group = "omnitrack_sim.robots"
    assert SNIPPETS[1]["project"]["entry-points"] == {group: GROUPS[group]}
    assert set(GROUPS) == {f"omnitrack_sim.{g}" for g in ("robots", "controllers", "fittings")}


def test_a_robot_of_a_distribution_runs_by_its_short_name(crawlers):
    """It runs as one of the package does, and its saved scenario names the class itself."""
    data = {"robot": {"kind": "ball", "radius": 0.04}, "pipes": PIPES, **BRIEF}
    result = ot.run(validate(data))
    assert result.duration_s == pytest.approx(0.1)
    assert result.scenario.robot.kind == "my_robot:Ball"
    loaded = ot.load_result(result.save(crawlers / "run"))
    assert loaded.scenario.robot == result.scenario.robot
    assert robot_class("ball") is type(result.scenario.robot)


def test_controllers_and_fittings_of_a_distribution_run(crawlers):
    """A scenario names both, and the controller gets its parameters."""
    pipes = [PIPES[0], {"kind": "bulge", "length": 0.2, "depth": 0.003}, PIPES[0]]
    control = {"kind": "upright", "parameters": {"slowing": 3.0}}
    scenario = validate({"pipes": pipes, "control": control, **BRIEF})
    assert scenario.controller_class.__name__ == "Upright"
    assert scenario.control_parameters.slowing == 3.0
    assert type(scenario.route.network.parts[1].fitting).__name__ == "Bulge"
    assert ot.run(scenario).duration_s == pytest.approx(0.1)


def test_nothing_is_imported_that_a_file_does_not_name(crawlers):
    """Neither a file with shipped names nor one with a wrong name imports a distribution's code."""
    validate({"pipes": PIPES})
    with pytest.raises(ScenarioError):
        validate({"robot": {"kind": "bal"}, "pipes": PIPES, "control": {"kind": "uprigt"}})
    assert not {"my_robot", "my_control", "my_pipes"} & sys.modules.keys()


def test_a_wrong_name_is_asked_back_with_those_of_distributions(crawlers):
    """Each of the three kinds lists them, and the nearest is offered."""
    with pytest.raises(InputError, match=r"did you mean 'ball'\?.*presser") as caught:
        robot_class("bal")
    assert "ball" in caught.value.faults[0].choices
    with pytest.raises(ScenarioError, match=r"control\.kind.*did you mean 'upright'\?"):
        validate({"pipes": PIPES, "control": {"kind": "uprigt"}})
    with pytest.raises(InputError, match=r"did you mean 'bulge'\?"):
        fitting_class("bulg")


def test_what_is_no_controller_is_told_with_those_of_distributions(crawlers):
    """A name that leads to something else has the same choices as one that leads nowhere."""
    faults = []
    for kind in ("math:pi", "nowhere"):
        with pytest.raises(InputError) as caught:
            controller_of(kind, {"own": object})
        faults.append(caught.value.faults[0])
    assert faults[0].problem == "is 'math:pi', which is no class with a step"
    assert faults[0].choices == faults[1].choices == ("own", "upright", "module:Object")


def test_commands_know_the_names_of_distributions(crawlers):
    """The parameters of such a robot are listed, and a shell completes its name."""
    from omnitrack_sim.cli.complete import kinds

    done = omnitrack("parameters", "ball")
    assert done.returncode == 0, done.stderr
    assert "radius" in done.stdout
    assert kinds("ba") == [("ball", "")]


def test_names_of_the_package_go_first(tmp_path, monkeypatch):
    """No distribution replaces a shipped robot, controller or fitting."""
    own = {"robots": "presser", "controllers": "jacobian", "fittings": "straight"}
    install(tmp_path, {f"omnitrack_sim.{g}": {name: "nothing:X"} for g, name in own.items()})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "presser" in installed("robots")
    assert robot_class("presser").__module__ == "omnitrack_sim.robots.presser"
    assert fitting_class("straight").kind == "straight"
    assert validate({"pipes": PIPES}).controller_class.__name__ == "JacobianController"


def test_the_first_distribution_on_the_path_has_a_name(tmp_path, monkeypatch):
    """Of two that give one name, that counts which Python finds first, as with modules."""
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        entry = {"omnitrack_sim.robots": {"crawler": f"{name}:X"}}
        install(tmp_path / name, entry, f"dist-{name}")
    monkeypatch.syspath_prepend(str(tmp_path / "two"))
    monkeypatch.syspath_prepend(str(tmp_path / "one"))
    assert installed("robots")["crawler"].value == "one:X"


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("not_there:X", r"'not_there:X' of pipe-crawlers 1\.0 cannot be imported"),
        ("json:Missing", r"'json:Missing' of pipe-crawlers 1\.0 cannot be imported"),
        ("json:dumps", r"is 'crawler', which is no ot\.Robot"),
    ],
)
def test_an_entry_point_that_leads_nowhere_is_a_fault_of_the_file(
    tmp_path, monkeypatch, value, told
):
    """The fault names the distribution, and the command ends with status 2."""
    install(tmp_path, {"omnitrack_sim.robots": {"crawler": value}})
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ScenarioError, match=rf"robot\.kind.*{told}"):
        validate({"robot": "crawler", "pipes": PIPES})
    done = omnitrack("run", "straight", "--set", "robot.kind=crawler", "--no-video")
    assert done.returncode == 2
    assert "crawler" in done.stderr
