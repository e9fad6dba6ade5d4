"""What is printed: no control characters of a user's, bounded length, JSON that is JSON."""

from __future__ import annotations

import json
import math
import pickle
import sys

import pytest
from samples import sample_result

import omnitrack_sim as ot
from omnitrack_sim import cli
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped, listed, nearest, printable
from omnitrack_sim.cli import common, runs
from omnitrack_sim.cli.common import out
from omnitrack_sim.scenario import validate

EVIL = "\x1b[31mred\x07\n\x9b2J\u202e"
"""A colour, a bell, a new line, a C1 control sequence, and a mark that turns writing round."""


@pytest.fixture
def omnitrack(monkeypatch, capsys):
    """Runs the command line in this process; status, standard output, standard error."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["omnitrack", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return run


def is_harmless(text: str) -> bool:
    return all(character.isprintable() or character == "\n" for character in text)


def test_printable_text_shows_what_a_terminal_would_obey():
    """Control characters, marks and halves of characters become escapes; other text stays."""
    assert printable("Rohr 5 µm, 管") == "Rohr 5 µm, 管"
    assert printable(EVIL) == "\\x1b[31mred\\x07\\n\\x9b2J\\u202e"
    assert printable("\udcff") == "\\udcff"


def test_a_fault_is_printable_and_bounded():
    """Whatever place, problem and choices are, its text is harmless and at most 3 kB."""
    fault = Fault(EVIL * 10_000, EVIL * 10_000, tuple(f"{EVIL}{i}" for i in range(10_000)), EVIL)
    assert is_harmless(str(fault))
    assert "\n" not in str(fault)
    assert len(str(fault)) < 12_000  # escapes are longer than what they stand for
    assert len(str(Fault("x" * 10_000, "y" * 10_000, ("z" * 10_000,) * 10_000))) < 3_000


def test_a_list_of_faults_says_how_many_more_there_are():
    """Thirty are told, and the number of the others; all of them are in ``faults``."""
    error = InputError([Fault(f"key{i}", "unknown key") for i in range(1000)])
    lines = str(error).splitlines()
    assert len(lines) == 31
    assert lines[-1] == "and 970 more faults"
    assert len(error.faults) == 1000


def test_an_error_survives_the_way_between_processes():
    """Pickled, as workers of a sweep send it, it has the same faults."""
    error = ot.ScenarioError([Fault("a", "is 1", ("2", "3"), "1"), Fault("b", "is missing")])
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is ot.ScenarioError
    assert again.faults == error.faults


def test_choices_are_listed_as_far_as_they_fit():
    """The list ends with how many are left out, and has one at least."""
    assert listed(["a", "b"]) == "a, b"
    assert listed([f"name_{i:03}" for i in range(300)], 25) == "name_000, name_001 and 298 more"
    assert listed(["x" * 50, "y"], 10) == "xxxxxxxxxx... (50 characters) and 1 more"
    assert clipped("abc", 3) == "abc"
    names = ["one", "a", "three", "of", "these"]
    for length in range(1, 30):
        fits = max(k for k in range(1, 6) if k == 1 or len(", ".join(names[:k])) <= length)
        rest = f" and {5 - fits} more" if fits < 5 else ""
        shortened = [clipped(name, length) for name in names[:fits]]
        assert listed(names, length) == ", ".join(shortened) + rest


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("cruise_sped", "cruise_speed"),
        ("Cruise_Speed", "cruise_speed"),
        ("frction", "world.friction"),
        ("misaligned", "paper/tee_turn_misaligned"),
        ("tee", "paper/tee_turn_misaligned"),
        ("ted", None),
        ("quaternion", None),
        ("", None),
    ],
)
def test_the_nearest_choice_is_found(given, meant):
    """Whole names first, whatever the case, then parts of names; nothing where nothing is near."""
    choices = ["kind", "cruise_speed", "world.friction", "paper/tee_turn_misaligned"]
    assert nearest(given, choices) == meant


def test_names_do_not_reach_the_terminal_as_they_are(omnitrack, tmp_path):
    """Names and values in files, in options and of files are told with escapes."""
    file = tmp_path / "evil.json"
    data = {"name": EVIL, EVIL: 1, "pipes": [{"kind": EVIL, "length": 1.0, EVIL: 2}]}
    file.write_text(json.dumps(data))
    for arguments in (
        ("run", str(file)),
        ("run", EVIL),
        ("run", "straight", "--set", f"{EVIL}=1"),
        ("run", "straight", "--set", f"control.kind={EVIL}"),
        ("run", "straight", f"--{EVIL}"),
        ("run", "straight", "--camera", EVIL),
        ("network", "fig14", "--from", EVIL, "--to", "low"),
        ("render", EVIL),
        (EVIL,),
    ):
        status, stdout, stderr = omnitrack(*arguments)
        assert (status, stdout) == (2, "")
        assert "\\x1b[31mred" in stderr
        assert is_harmless(stderr), arguments


def test_tables_show_names_with_escapes(capsys):
    """A name in a table of a run is escaped, markup and emoji codes in it stay as written."""
    name = "[red]:boom:\n[/red]\x1b[31m"
    pipes = [{"kind": "straight", "name": name, "length": 0.5}] * 1
    scenario = validate({"name": "a", "pipes": pipes})
    result = sample_result(scenario=scenario)
    out.print(runs._passage_table(result, result.timeline()))
    out.print("\x1b[31mnot escaped by who printed it")
    shown = capsys.readouterr().out
    assert "[red]:boom:\\n[/red]\\x1b[31m" in shown
    assert is_harmless(shown)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "x" * 100_000),
        ("run", "straight", "--set", "x" * 100_000 + "=1"),
        ("run", "straight", "--set", f"control.kind={'x' * 100_000}"),
        ("run", "straight", "--" + "x" * 100_000),
        ("run", "straight", *(text for i in range(300) for text in ("--set", f"k{i}=1"))),
        ("network", "fig14", "--from", "x" * 100_000, "--to", "low"),
        ("x" * 100_000,),
    ],
)
def test_messages_are_bounded(omnitrack, arguments):
    """However long what is at fault, or the list of faults, a message is 40 kB at most."""
    status, stdout, stderr = omnitrack(*arguments)
    assert (status, stdout) == (2, "")
    assert 10 < len(stderr) < 40_000


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("a=" + "[" * 5000, "--set a: is nested too deeply"),
        ("seed=" + "9" * 5000, "--set seed: has an integer of thousands of digits"),
        ("seed=" + "9" * 50, "seed: is an integer of more than 64 bits"),
        ("a." * 2_000 + "a=1", "there is no 'a' here"),
        ("pipes." + "9" * 5000 + ".length=1", "(choose from: 0)"),
        (
            "preload=20",
            "preload: is the end of a path; give all of it (choose from: robot.preload)",
        ),
        ("recovery.square=false", "(choose from: control.parameters.recovery.square)"),
        ("mission.start=a", "pipes: are given as well as a mission; give one of them"),
        ("pipes.-1.length=1", "pipes.-1.length: there is no '-1' here"),
        ("network=" + "x" * 300, "cannot be read: File name too long"),
        ("name=\udcff", "name: is '\\udcff', which has bytes"),
        ("seed=1\nb=2", "seed: input should be a valid integer (given: '1\\nb=2')"),
        ("=5", "--set =5: is not PATH=VALUE"),
        ("pipes.0=5", "pipes.0: input should be a table (given: 5)"),
        ("control.kind=[1]", "control.kind: input should be a valid string (given: [1])"),
    ],
)
def test_an_odd_assignment_is_a_fault(omnitrack, assignment, message):
    """Whatever --set is given, a fault comes out of it, and status 2."""
    status, stdout, stderr = omnitrack("run", "straight", "--set", assignment)
    assert (status, stdout) == (2, "")
    assert message in stderr


def test_faults_of_the_file_and_of_set_are_told_at_once(omnitrack, tmp_path):
    """A text that is no assignment, a path that leads nowhere, and what the file has wrong."""
    file = tmp_path / "bad.toml"
    file.write_text('seed = -1\n[[pipes]]\nkind = "straight"\nlength = 1.0\n[control]\nalign = 3\n')
    options = ("--set", "oops", "--set", "contrl.kind=paper", "--set", "control.align=false")
    _, _, stderr = omnitrack("run", str(file), *options)
    places = {line.removeprefix("error: ").split(": ")[0] for line in stderr.splitlines()}
    assert places == {"--set oops", "contrl.kind", "seed"}
    assert "did you mean 'control'?" in stderr


def test_the_version_is_told(omnitrack):
    """--version prints name and version, and nothing else."""
    assert omnitrack("--version") == (0, f"omnitrack_sim {ot.__version__}\n", "")


def test_json_of_a_run_is_strict(omnitrack, monkeypatch, tmp_path):
    """The figures of a diverged run are null in --json as they are in result.json."""
    result = sample_result()
    result.metrics["energy_j"] = math.inf
    result.metrics["no_load_slip_m_s"] = math.nan
    monkeypatch.setattr(
        "omnitrack_sim.show.plots.run_figures.plot_summary", lambda result, path: path.touch()
    )
    monkeypatch.setattr("omnitrack_sim.run", lambda scenario, progress: result)
    status, stdout, _ = omnitrack(
        "run", "straight", "--no-video", "--json", "--out", str(tmp_path / "a")
    )
    assert status == 0

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    figures = json.loads(stdout, parse_constant=refuse)["metrics"]
    assert (figures["energy_j"], figures["no_load_slip_m_s"]) == (None, None)
    assert json.loads((tmp_path / "a" / "result.json").read_text()) == json.loads(stdout)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "straight", "--out", ""], "--out: is empty"),
        (["run", "straight", "--out="], "--out: is empty"),
        (["run", ""], "an argument: is empty"),
        (["render", "nowhere", "--out", "."], ".: is a folder; name a file in it; the ending"),
        (["render", "nowhere", "--out", "film"], "film: has no ending; the ending says the film"),
        (["network", "fig14", "--plot", "."], ".: is a folder; name a file in it"),
    ],
)
def test_places_that_are_empty_or_no_file_are_refused(omnitrack, arguments, told):
    """Before anything is run: an empty text would be the working folder."""
    status, _, shown = omnitrack(*arguments)
    assert status == 2
    assert told in shown


def test_a_command_that_is_interrupted_says_so(omnitrack, monkeypatch):
    """Control and C while a scenario runs: one word, and the status of an interruption."""

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("omnitrack_sim.run", interrupt)
    status, printed, told = omnitrack("run", "straight", "--no-video")
    assert (status, printed, told.strip()) == (130, "", "interrupted")


def test_a_table_that_is_set_points_to_the_way_to_change_it():
    """Scenarios and their tables are frozen."""
    scenario = ot.load_scenario("straight")
    for table, name in ((scenario, "seed"), (scenario.world, "friction")):
        with pytest.raises(TypeError, match=rf"{name} cannot be set: ot\.override"):
            setattr(table, name, 1)


def test_the_time_that_is_left_is_told_when_there_is_a_pace(monkeypatch, capsys):
    """By the work since it first moved on: 70 s before that, of compilation, do not count; and
    not before 5 % of it are done."""
    now = [0.0]
    monkeypatch.setattr(common.time, "monotonic", lambda: now[0])
    lines = common._Lines("run r")
    for seconds, part in ((70.0, 0.02), (71.0, 0.03), (80.0, 0.22)):
        now[0] = seconds
        lines.report(part, "straight")
    first, second = capsys.readouterr().err.splitlines()
    assert "left" not in first
    assert first.endswith("straight")
    assert second.endswith("0:00:39 left")
