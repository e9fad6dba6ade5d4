"""What the documents show, runs."""

import re
import runpy
import shlex
import tomllib
from pathlib import Path

import pytest
from documents import page, tables
from pydantic import BaseModel
from typer.main import get_command

import omnitrack_sim
from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.base.naming import (
    shipped_files,
)
from omnitrack_sim.base.reading import checked
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import assignment
from omnitrack_sim.pipes.condition import Condition
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings, table_of
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.robots.control import parameters_model
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.robots.omnitrack.control.jacobian import FeedbackTable
from omnitrack_sim.robots.omnitrack.control.open_loop import PaperTable
from omnitrack_sim.robots.omnitrack.metrics import METRICS
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack
from omnitrack_sim.scenario import Scenario, load_scenario
from omnitrack_sim.scenario import validate as validate_scenario
from omnitrack_sim.scenario.tables import (
    Pipe,
)
from omnitrack_sim.senses.settings import SensingTable
from omnitrack_sim.trials.axes import AXES
from omnitrack_sim.trials.search_plan import Objective, Variable
from omnitrack_sim.trials.study import RESERVED, Final
from omnitrack_sim.trials.study_file import StudyFile
from omnitrack_sim.trials.study_file import resolve as resolve_study
from omnitrack_sim.trials.sweep_file import SweepFile, resolve

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = get_command(app).commands  # type: ignore[attr-defined]


@pytest.mark.long
def test_python_of_the_readme_runs(capsys, monkeypatch):
    """The README's Python runs as it stands, in a checkout, and prints two outcomes."""
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(compile(code, "README.md", "exec"), {"__name__": "readme"})
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_the_readme_is_short():
    """Whoever opens the README reads it to its end: at most 1,200 words."""
    assert len(README.split()) <= 1200


SHORTER = {
    "brake_steering": ('"control.retry": False', '"control.retry": False, "run.time_limit": 1.5'),
    "reach_against_success": ("0.1121, 0.004", "0.1121, 0.02"),
    "tee_orientations": ('"control.align": False', '"control.align": False, "run.time_limit": 1.5'),
}
"""What the test runs less of: it passes through the same code."""


@pytest.mark.long
@pytest.mark.parametrize(
    "script", sorted((ROOT / "scenarios" / "scripts").glob("*.py")), ids=lambda p: p.stem
)
def test_scripts_run(script, tmp_path, capsys):
    """Each script on the public API runs and prints a table."""
    longer, shorter = SHORTER.get(script.stem, ("", ""))
    code = script.read_text(encoding="utf-8")
    assert longer in code
    (tmp_path / script.name).write_text(code.replace(longer, shorter), encoding="utf-8")
    runpy.run_path(str(tmp_path / script.name), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) >= 2


def test_pages_name_every_command_and_scenario():
    """No command and no shipped scenario is missing from commands.md and scenarios.md."""
    commands, scenarios = page("commands"), page("scenarios")
    assert len(app.registered_commands) > 10
    for command in app.registered_commands:
        assert command.callback is not None
        assert f"omnitrack {command.name or command.callback.__name__}" in commands
    for name in shipped_files("scenarios"):
        assert name.startswith("missions/") or f"`{name}`" in scenarios


def test_sweeps_and_their_keys_are_documented():
    """sweeps.md names every shipped sweep and every key of a sweep file."""
    text = page("sweeps")
    for name in shipped_files("sweeps"):
        assert f"`{name}`" in text
    keys = {
        *SweepFile.model_fields,
        *(key for axis in AXES.values() for key in axis.model_fields),
    }
    assert sorted(key for key in keys if f"`{key}`" not in text) == []


def test_laws_for_use_while_editing_are_there():
    """`make quick` names test files that exist: pytest over several processes tells of no other."""
    rule = (ROOT / "Makefile").read_text().partition("QUICK := ")[2].partition("quick:")[0]
    named = rule.replace("\\", "").split()
    assert len(named) > 20
    assert not [name for name in named if not (ROOT / f"tests/test_{name}.py").is_file()]


def test_studies_and_their_keys_are_documented():
    """optimise.md names every shipped study, every key of a study file, every column and
    file; its example is valid, and its Python has none but public names."""
    text = page("optimise")
    for name in shipped_files("studies"):
        assert f"`{name}`" in text
    keys = {key for table in (StudyFile, Variable, Objective, Final) for key in table.model_fields}
    keys |= set(RESERVED) - {"on_front", "best"}
    assert sorted(key for key in keys if f"`{key}`" not in text) == []
    (example,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    study = resolve_study({"name": "example"} | tomllib.loads(example))
    assert (study.size, study.search_count, study.asked_each) == (32, 5, 6)
    for name in re.findall(r"\bot\.(\w+)", text):
        assert name in omnitrack_sim.__all__


def test_example_of_the_sweep_page_is_valid():
    """The TOML of sweeps.md is a sweep, and its Python is none but public names."""
    text = page("sweeps")
    (example,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    assert resolve({"name": "example"} | tomllib.loads(example)).size == 400
    for name in re.findall(r"\bot\.(\w+)", text):
        assert name in omnitrack_sim.__all__


def test_the_page_of_figures_has_every_function_and_shows_what_there_is():
    """Each public function that plots; names that are public, pictures that are there."""
    text = page("plots")
    used = set(re.findall(r"\bot\.(\w+)", text))
    assert {name for name in omnitrack_sim.__all__ if name.startswith("plot_")} <= used
    assert used - {"plot_"} <= set(omnitrack_sim.__all__)
    for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
        assert (ROOT / "docs" / "how-to" / picture).is_file()


def test_networks_and_their_keys_are_documented():
    """networks.md names every shipped network and every key of a network file."""
    text = page("networks")
    for name in shipped_files("networks"):
        assert f"`{name}`" in text
    text += page("scenarios")  # of the sizes of fittings
    schema = Network.model_json_schema()
    keys = {
        *schema["properties"],
        *(key for table in schema["$defs"].values() for key in table["properties"]),
        *(key for kind in shipped_fittings().values() for key in kind.Table.model_fields),
    }
    assert sorted(key for key in keys if f"`{key}`" not in text) == []


@pytest.mark.long
def test_examples_of_the_network_page_run(capsys):
    """The TOML of networks.md are networks and a condition, and its Python runs."""
    text = page("networks")
    examples = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    *examples, condition = [tomllib.loads(example) for example in examples]
    drawn = checked(Condition, {"name": "street", **condition}, NetworkError).defects
    assert [d.kind for d in drawn] == ["offset", "deposit", "weld", "corrosion"]
    networks = [example for example in examples if "fittings" in example]
    (scan,) = (example for example in examples if "pipes" in example)
    assert scan["pipes"][0]["profile"] == "scan.csv"
    found = [validate_network(example).open_ends for example in networks]
    assert found == [
        ("riser.start", "t1.run_end", "bend.end"),
        ("main.start", "end.end"),
        ("old.start", "old.end"),
        ("before.start", "behind.end"),
    ]
    for code in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(code, "networks.md", "exec"), {"__name__": "networks"})
    assert "bridge" not in capsys.readouterr().out


@pytest.mark.long
def test_examples_of_the_mission_page_run(capsys):
    """The TOML of missions.md is a scenario, its Python prints five legs, and it names all
    missions."""
    text = page("missions")
    (example,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    assert len(validate_scenario(tomllib.loads(example)).plates) == 1
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    exec(compile(code, "missions.md", "exec"), {"__name__": "missions"})
    assert len(capsys.readouterr().out.splitlines()) == 5
    missions = [name for name in shipped_files("scenarios") if name.startswith("missions/")]
    assert [name for name in missions if f"`{name}`" not in text] == []


def test_the_drive_of_the_page_on_extending_does_not_steer():
    """Two motors cannot give three belts speeds of their own."""
    codes = re.findall(r"```python\n(.*?)```", page("extending"), flags=re.DOTALL)
    (code,) = (code for code in codes if "PAIR" in code)
    names: dict = {}
    exec(compile(code, "extending.md", "exec"), names)
    assert (names["PAIR"].motors, names["PAIR"].steers) == (2, False)


def test_links_of_the_documents_lead_somewhere():
    """Every relative link of README and docs points to a file that exists."""
    links = [
        (page, target)
        for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        if "://" not in target
    ]
    assert len(links) > 30
    broken = [
        f"{page.name}: {target}" for page, target in links if not (page.parent / target).exists()
    ]
    assert broken == []


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOLDERS = (".", "omnitrack_sim", "benchmarks")
"""Folders that a path in a page may be relative to, besides the page's own."""
PATH = re.compile(
    r"(?<![\w/.-])(?:(?:omnitrack_sim|benchmarks|tests|scenarios|docs|models|assets)/[\w/.-]+"
    r"|(?:[\w-]+/)*[\w-]+\.py)(?![\w/])"
)
"""A file or folder of the checkout, or a module."""


def code_of(page: Path) -> list[str]:
    """The lines of code in a page, and what stands in backticks."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```\w*\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    joined = "\n".join(blocks).replace("\\\n", " ")
    return [*joined.splitlines(), *re.findall(r"`([^`\n]+)`", text)]


def is_own(name: str) -> bool:
    """Whether a name stands for something of the reader's."""
    return name.isupper() or Path(name).name.startswith(("mine", "my_"))


@pytest.mark.parametrize("document", PAGES, ids=lambda page: page.stem)
def test_files_that_pages_name_are_there(document):
    """Modules, and whatever is below a folder of the checkout, but for environments by name and
    files of the reader's own."""
    found = {path.rstrip(".") for line in code_of(document) for path in PATH.findall(line)}
    places = [document.parent, *(ROOT / folder for folder in FOLDERS)]
    missing = {path for path in found if not any((place / path).exists() for place in places)}
    assert {path for path in missing if not is_own(path) and not path.endswith("-v0")} == set()


NAMED = {
    "run": "scenarios",
    "view": "scenarios",
    "drive": "scenarios",
    "sweep": "sweeps",
    "optimise": "studies",
    "network": "networks",
    "policies": "policies",
}
"""What the first argument of a command names, unless it is a file."""


@pytest.mark.parametrize("document", PAGES, ids=lambda page: page.stem)
def test_commands_that_pages_show_name_what_there_is(document):
    """Commands exist with their options; scenarios, sweeps, studies, networks and policies come
    with the package, or are files of the checkout, of an earlier command (``out/``) or of the
    reader's own."""
    for line in code_of(document):
        if not line.startswith("omnitrack "):
            continue
        words = shlex.split(line, comments=True)
        if len(words) < 2 or words[1].startswith("-"):
            continue
        assert words[1] in COMMANDS, line
        options = COMMANDS[words[1]].params
        known = {name for option in options for name in (*option.opts, *option.secondary_opts)}
        known.add("--help")
        assert {w.strip("[]").partition("=")[0] for w in words if w.startswith("--")} <= known, line
        first = next((word for word in words[2:3] if not re.match(r"[-\[.]", word)), None)
        if first is None or words[1] not in NAMED or is_own(first.partition("|")[0].split(".")[0]):
            continue
        there = (ROOT / first).exists() or first.startswith("out/")
        kind = "sweeps" if "--trial" in words else NAMED[words[1]]
        assert there or first in shipped_files(kind), line
        given = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
        # What the reader's own files and those of earlier commands hold is not known here.
        known = all(text[0] != "@" and not is_own(text.split("=")[1]) for text in given)
        if first in shipped_files("scenarios") and known:
            assert load_scenario(first, dict(map(assignment, given))), line


def test_marks_of_tables_name_tables_and_no_table_is_left_over():
    """Each table that is made from the code has its place on one page, and every mark a table."""
    marks = [
        mark["name"]
        for document in PAGES
        for mark in tables.MARK.finditer(document.read_text("utf-8"))
    ]
    assert sorted(marks) == sorted([*tables.MODELS, *tables.TABLES])


def test_tables_of_the_pages_are_as_the_code_makes_them():
    """No page has a table that differs; one that does is named, and mended by --write."""
    assert tables.pages_to_write() == {}
    row = "| `tilt_max_deg` | deg |"
    text = page("metrics")
    assert row in text
    assert tables.with_tables(text.replace(row, "| `tilt_max_deg` | rad |")) == text


def test_the_page_of_sweeps_says_which_metrics_its_tables_leave_out():
    """All that are in no table, by name."""
    sweeps = page("sweeps")
    left_out = [metric.name for metric in METRICS if not metric.in_tables]
    assert [name for name in left_out if f"`{name}`" not in sweeps] == []


def test_tables_of_the_pages_are_those_of_the_code():
    """A row has key, default, unit and meaning as the model declares them; a key of several kinds
    of fitting names them."""
    text = page("scenarios")
    for row in (
        "| `cruise_speed` | 0.1 | m/s | Speed of the robot's centre, in turns as well. |",
        "| `mean_radius` | elbow | 0.24 | m | Of the axis, at least the pipe radius. |",
        "| `length` | straight, cap |  | m | Along the axis. |",
        "| `turn_deg` | all | 0.0 | deg | Rotation about the joint's axis; elbows in a row without "
        "it stay in one plane. |",
    ):
        assert f"\n{row}\n" in text
    count = CHANNELS["contact_count"]
    row = f"| `contact_count` | 1 | 3 x 2 | - | swapped | yes | yes | {count.meaning} |"
    assert f"\n{row}\n" in page("channels")
    travel = next(one for one in METRICS if one.name == "spring_travel_max_m")
    assert f"\n| `{travel.name}` | m | 3 | {travel.meaning} |\n" in page("metrics")
    named = {"channels": CHANNELS, "metrics": [one.name for one in METRICS]}
    for name, every in named.items():
        assert [one for one in every if f"\n| `{one}` |" not in page(name)] == []


def test_every_table_of_parameters_and_sensors_is_documented():
    """scenarios.md has a section, with its table, for each table of the shipped controllers and of
    the sensors."""
    named = {
        f"control.parameters.{key}"
        for controller in Omnitrack.controllers().values()
        for key, info in parameters_model(controller).model_fields.items()
        if isinstance(info.get_default(call_default_factory=True), BaseModel)
    }
    named |= {f"sensing.{key}" for key, value in SensingTable() if isinstance(value, BaseModel)}
    assert named <= set(tables.MODELS)
    assert PaperTable().alignment == FeedbackTable().alignment


def test_every_key_of_a_scenario_is_documented():
    """scenarios.md names every table and key."""
    text = page("scenarios")
    schema = Scenario.model_json_schema()
    keys = set(schema["properties"])
    for table in (
        "Mission",
        "StartTable",
        "WorldTable",
        "PullTable",
        "ControlTable",
        "MonitorTable",
        "RecordTable",
        "PhysicsTable",
        "RunTable",
    ):
        keys |= set(schema["$defs"][table]["properties"])
    for kind in shipped_fittings():
        keys |= set(table_of(kind, Pipe).model_fields)
    missing = sorted(key for key in keys if f"`{key}`" not in text)
    assert missing == []
