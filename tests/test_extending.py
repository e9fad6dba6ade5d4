"""extending.md: every example runs, beside the package and not in it."""

import re
import sys
import tomllib
from pathlib import Path

import pytest
from documents import page
from test_entry_points import GROUPS, install

import omnitrack_sim as ot
from omnitrack_sim.scenario import validate

PAGE = page("extending")
BLOCKS = re.findall(r"(?:`(\w+\.py)`:\n\n)?```(python|toml)\n(.*?)```", PAGE, flags=re.DOTALL)
MODULES = {name: code for name, _, code in BLOCKS if name}
SCRIPTS = [code for name, kind, code in BLOCKS if kind == "python" and not name]
# Entry points of a distribution: tests/test_entry_points.py.
TABLES = [code for _, kind, code in BLOCKS if kind == "toml" and "entry-points" not in code]


@pytest.fixture(autouse=True)
def _own_modules(tmp_path, monkeypatch):
    """The page's modules in a folder of the user's, and what installs them; forgotten
    afterwards."""
    for name, code in MODULES.items():
        (tmp_path / name).write_text(code, encoding="utf-8")
    install(tmp_path, GROUPS)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    for name in MODULES:
        sys.modules.pop(name.removesuffix(".py"), None)


@pytest.mark.parametrize("script", SCRIPTS, ids=range(len(SCRIPTS)))
def test_scripts_of_the_page_run(script, capsys):
    """Each Python example that is no module of its own runs and prints a line."""
    exec(compile(script, "extending.md", "exec"), {"__name__": "extending"})
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("table", TABLES, ids=range(len(TABLES)))
def test_tables_of_the_page_are_scenarios(table):
    """Each TOML example, with pipes where it has none, is a valid scenario that runs."""
    data = tomllib.loads(table)
    data = {"pipes": [{"kind": "straight", "length": 1.0}], "run": {"time_limit": 0.2}} | data
    result = ot.run(validate(data))
    assert result.duration_s == pytest.approx(0.2)
    assert result.outcome is ot.Outcome.TIMED_OUT


def test_every_kind_of_extension_has_an_example():
    """Controller, sensor, metric, motor, feature, drive and fitting each have a section."""
    assert re.findall(r"^## A (\w+)", PAGE, flags=re.MULTILINE) == [
        "controller",
        "sensor",
        "metric",
        "motor",
        "feature",
        "drive",
        "fitting",
    ]


def test_the_drive_of_the_page_drives_two_modules_alike():
    """Named in a scenario, its second motor gives modules 2 and 3 equal torques."""
    change = {"robot.drive": "my_drives:PAIR", "run.time_limit": 0.3}
    result = ot.run(ot.override(ot.load_scenario("vertical_climb"), change))
    first, second, third = result.trajectory["motor_torque"][-1]
    assert second == third != first


def test_the_fitting_of_the_page_is_the_one_that_is_driven():
    """The fitting that the page shows is the one of tests/test_fittings.py, to the letter."""
    module = Path(__file__).with_name("bulge.py").read_text(encoding="utf-8")
    assert MODULES["my_pipes.py"] == module
