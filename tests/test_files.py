"""Files that are read: TOML and JSON, of the wanted kind, of bounded size and depth."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from omnitrack_sim.base.errors import (
    InputError,
    NetworkError,
    ScenarioError,
    StudyError,
    SweepError,
)
from omnitrack_sim.base.reading import MAX_BYTES
from omnitrack_sim.base.text import printable
from omnitrack_sim.cli.common import settings_of
from omnitrack_sim.pipes.network import load_network
from omnitrack_sim.scenario import load_scenario
from omnitrack_sim.trials.study_file import load_study
from omnitrack_sim.trials.sweep_file import load_sweep

PIPE = '[[pipes]]\nkind = "straight"\nlength = 1.0\n'
JSON = '{"pipes": [{"kind": "straight", "length": 1.0}], "seed": 3'


def told(load, source: str | Path) -> str:
    with pytest.raises(InputError) as caught:
        load(source)
    return str(caught.value)


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


def test_json_says_the_same_as_toml(tmp_path):
    """A scenario in JSON equals the one in TOML, in capitals and with a byte order mark too."""
    toml = load_scenario(written(tmp_path, "pipe.toml", f"seed = 3\n{PIPE}"))
    assert load_scenario(written(tmp_path, "pipe.json", JSON + "}")) == toml
    marked = written(tmp_path, "pipe.JSON", f'\ufeff{JSON}, "name": "pipe"}}')
    assert load_scenario(marked) == toml
    assert load_scenario(written(tmp_path, "pipe.toml", f"\ufeffseed = 3\n{PIPE}")) == toml


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "", "is not valid JSON: Expecting value: line 1 column 1"),
        ("a.json", JSON + ', "seed": 4}', "the key 'seed' stands twice"),
        ("a.json", "[1, 2]", "holds no table; a scenario is a table"),
        ("a.json", '{"pipes": [{"kind": "straight", "length": NaN}]}', "pipes.0.length: "),
        ("a.json", JSON.replace("3", "1e999") + "}", "seed: "),
        ("a.json", '{"a":' * 100_000, "is nested too deeply"),
        ("a.json", '{"a":' * 40 + "1" + "}" * 40, "is nested too deeply"),
        ("a.json", JSON.replace("3", "9" * 5000) + "}", "an integer of thousands of digits"),
        ("a.json", JSON.replace("3", "9" * 50) + "}", "seed: is an integer of more than 64 bits"),
        ("a.json", JSON + ', "name": "\\ud800"}', "name: is '\\ud800', which has bytes or halves"),
        ("a.toml", "seed = 1\nseed = 2", "is not valid TOML: Cannot overwrite a value"),
        ("a.toml", "x = " + "[" * 5000, "is nested too deeply"),
        ("a.toml", "x = " + "[" * 40 + "]" * 40, "is nested too deeply"),
        ("a.toml", "a." * 200_000 + "b = 1", "is nested too deeply"),
        ("a.toml", "seed = " + "9" * 5000, "an integer of thousands of digits"),
        ("a.toml", f"seed = 0x{'f' * 99_999}\n{PIPE}", "seed: is an integer of more than 64 bits"),
        ("a.toml", f"name = 2020-01-01\n{PIPE}", "name: is the date or time 2020-01-01"),
        ("a.txt", f" {JSON}", "is JSON, it seems; the name of such a file ends in .json"),
        (
            "a.toml",
            "[pipes]\nlength = 1",
            "pipes: is a table; it must be a list of tables, each of ",
        ),
        ("a.toml", PIPE * 1001, "pipes: must have at most 1000 items, not 1001"),
        ("a.toml", "pipes = [1, []]", "pipes.1: input should be a table (given: [])"),
        ("a.toml", "#" * (MAX_BYTES["TOML"] + 1), "is too large: at most 1000000 bytes of TOML"),
        ("a.json", " " * (MAX_BYTES["JSON"] + 1), "is too large: at most 2000000 bytes of JSON"),
    ],
)
def test_a_file_that_cannot_be_used_is_a_fault(tmp_path, name, text, message):
    """What is no scenario is refused with its place, never with an error of Python's own."""
    path = written(tmp_path, name, text)
    found = told(load_scenario, path)
    assert message in found
    if message.partition(":")[0] not in ("seed", "name", "pipes", "pipes.0.length", "pipes.1"):
        assert found.startswith(f"{path}: ")


def test_paths_that_cannot_be_looked_at_are_faults(tmp_path):
    """Too long a path, a loop of links, a pipe, a folder and a null character, as a file's path
    and as the network of a scenario."""
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to("loop")
    for source, message in (
        ("x" * 300, "File name too long"),
        (tmp_path / "fifo", "is no regular file"),
        (tmp_path / "loop", "no such file"),
        (tmp_path, "is a folder, not a scenario file"),
        ("", "'': is a folder"),
        ("a\0b", "no such file"),
    ):
        assert message in told(load_scenario, source)
    text = f'network = "{"x" * 300}"\n[mission]\nstart = "a"\ngoals = ["b"]\n'
    assert "File name too long" in told(load_scenario, written(tmp_path, "a.toml", text))


@pytest.mark.parametrize(
    ("load", "source", "message"),
    [
        (load_scenario, "fig14", "is a network, not a scenario; `omnitrack network fig14` takes"),
        (load_scenario, "tee_lugs", "is a sweep, not a scenario; `omnitrack sweep tee_lugs` takes"),
        (load_sweep, "straight", "is a scenario, not a sweep; `omnitrack run straight` takes it"),
        (load_scenario, "robot_design", "is a study, not a scenario; `omnitrack optimise robot_d"),
        (load_study, "tee_lugs", "is a sweep, not a study; `omnitrack sweep tee_lugs` takes it"),
        (load_study, "controler_gains", "did you mean 'controller_gains'?"),
        (load_network, "missions/fig14", "is a scenario, not a network"),
        (load_scenario, "straigt", "did you mean 'straight'?"),
        (load_scenario, "tee_turn_misaligned", "did you mean 'paper/tee_turn_misaligned'?"),
        (load_scenario, "tee_orientaton", "did you mean the sweep 'tee_orientation' (`omnitrack"),
        (load_sweep, "tee_lug", "did you mean 'tee_lugs'?"),
        (load_network, "Fig41", "did you mean 'fig14'?"),
    ],
)
def test_names_of_another_kind_and_misspelt_names_are_told(load, source, message):
    """A shipped name of another kind names the command that takes it, a misspelt one the name."""
    assert message in told(load, source)


@pytest.mark.parametrize(
    ("load", "text"),
    [
        (load_scenario, PIPE),
        (load_sweep, 'base = "straight"\n'),
        (load_study, '[[objectives]]\nmetric = "energy_j"\n'),
        (load_network, '[[fittings]]\nkind = "straight"\nname = "a"\nlength = 1.0\n'),
    ],
)
@pytest.mark.parametrize("name", ["", ".hidden", "a/b", "a\\b", "a\nb"])
def test_a_name_that_is_none_of_a_folder_is_refused(load, text, name, tmp_path):
    """The message has the name and the whole rule."""
    path = written(tmp_path, "file.toml", f"name = {json.dumps(name)}\n{text}")
    rule = (
        f"name: is {name!r}; it names a folder, so it must not be empty, begin with a dot, or hold "
        "a slash, a backslash or a control character"
    )
    assert printable(rule) in told(load, path).splitlines()


def test_a_file_of_another_kind_names_the_command_that_takes_it(tmp_path):
    """By the keys at its top; a file with keys of the wanted kind is told its faults instead."""
    files = {
        "scenario": written(tmp_path, "pipes.toml", PIPE),
        "sweep": written(tmp_path, "many.toml", 'base = "straight"\n[[axes]]\nkind = "grid"\n'),
        "study": written(tmp_path, "best.toml", '[[objectives]]\nmetric = "energy_j"\n'),
        "network": written(tmp_path, "net.toml", '[[fittings]]\nkind = "straight"\n'),
    }
    commands = {"scenario": "run", "sweep": "sweep", "study": "optimise", "network": "network"}
    readers = {
        "scenario": load_scenario,
        "sweep": load_sweep,
        "study": load_study,
        "network": load_network,
    }
    for wanted, load in readers.items():
        for noun, path in files.items():
            if noun != wanted:
                message = f"is a {noun}, not a {wanted}; `omnitrack {commands[noun]} {path}` takes"
                assert message in told(load, path)
    both = written(tmp_path, "both.toml", PIPE + "[axes]\n")
    assert told(load_scenario, both).startswith("axes: unknown key")


def test_the_files_of_a_run_are_told_apart(tmp_path):
    """result.json and the folder itself lead to scenario.json, a study's record to its file."""
    written(tmp_path, "study.json", '{"sha256": "1", "study": {}}')
    assert "is the record of a study" in told(load_study, tmp_path / "study.json")
    written(tmp_path, "result.json", '{"outcome": "reached_goal", "metrics": {}}')
    written(tmp_path, "scenario.json", JSON + "}")
    assert "scenario.json" in told(load_scenario, tmp_path / "result.json")
    assert f"the scenario of this run is {tmp_path / 'scenario.json'}" in told(
        load_scenario, tmp_path
    )


@pytest.mark.parametrize(
    ("load", "text", "error"),
    [
        (load_scenario, PIPE + "[contrl]\nkind = 1", ScenarioError),
        (load_network, '[[fittings]]\nkind = "straight"\nname = "a"\nlenght = 1', NetworkError),
        (load_sweep, 'base = "straight"\n[[axes]]\nkind = "grid"\npaht = "a"', SweepError),
        (load_study, '[[trials]]\nbase = "straight"\n[[variables]]\npaht = "a"', StudyError),
    ],
)
def test_a_misspelt_key_is_asked_back(tmp_path, load, text, error):
    """Unknown keys of all kinds of files come with the nearest key there is."""
    with pytest.raises(error, match=r"unknown key; did you mean '(control|length|path)'\?"):
        load(written(tmp_path, "a.toml", text))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "a = 1\na = 2", "is not valid TOML"),
        ("a.toml", "x = " + "[" * 5000, "is nested too deeply"),
        ("a.json", '{"a": 1, "a": 2}', "the key 'a' stands twice"),
        ("a.json", "[1]", "holds no table; a file of values is a table"),
        ("a.toml", "\ud800", "is no text in UTF-8; a file of values is a file of TOML or JSON"),
        ("a.txt", '{"a": 1}', "is JSON, it seems; the name of such a file ends in .json"),
        ("a.toml", "#" * (MAX_BYTES["TOML"] + 1), "is too large"),
    ],
)
def test_a_file_of_values_that_cannot_be_used_is_a_fault(tmp_path, name, text, message):
    """``--set @FILE`` reads files as all others are read, and names the option."""
    path = written(tmp_path, name, text)
    found = told(settings_of, f"@{path}")
    assert found.startswith(f"--set @{path}: ")
    assert message in found


def test_a_file_of_values_is_a_regular_file(tmp_path):
    """Of JSON as well; pipes, folders and files that are not there are refused."""
    os.mkfifo(tmp_path / "fifo")
    for source in (tmp_path / "fifo", tmp_path, tmp_path / "nowhere", "", "a\0b"):
        assert "cannot be read: there is no such file" in told(settings_of, f"@{source}")
    path = written(tmp_path, "a.json", '{"robot": {"preload": 7}, "pipes.*.length": 2}')
    assert settings_of(f"@{path}") == {"robot.preload": 7, "pipes.*.length": 2}


def test_work_to_read_grows_with_the_file_and_no_faster(tmp_path):
    """Twice as many unknown keys take at most twice as many calls to be told."""
    calls = []
    for count in (2_000, 4_000):
        keys = ", ".join(f'"key{i}": 1' for i in range(count))
        path = written(tmp_path, "a.json", f"{{{keys}}}")
        calls.append(0)

        def counted(*_: object) -> None:
            calls[-1] += 1

        sys.setprofile(counted)
        try:
            message = told(load_scenario, path)
        finally:
            sys.setprofile(None)
        assert message.endswith(f"and {count - 30} more faults")
    assert calls[0] < calls[1] < 2.2 * calls[0]
