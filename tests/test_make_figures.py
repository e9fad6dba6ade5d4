"""Figures and tables of the pages: each is some part's, and is of today's physics or says so."""

from __future__ import annotations

import argparse
import json
import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from typer.main import get_command

import omnitrack_sim as ot
from omnitrack_sim.cli import app

ROOT = Path(__file__).parents[1]

import make_figures  # noqa: E402
import sweep_tables  # noqa: E402
from making import pages, parts, probes  # noqa: E402

DOCS = ROOT / "docs"
MANIFEST = DOCS / "figures.toml"
PARTS = parts.read_parts(MANIFEST)
RECORDS = parts.read_records(DOCS / "figures.json")
PAGES = pages.pages_of(DOCS)
SUFFIXES = (".png", ".svg", ".jpg", ".ipynb")


@cache
def usual(probe: str) -> probes.Values:
    """What a probe measures today."""
    return probes.measured(probe)


def shown(command: list[str], root: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run make_figures.py with some arguments."""
    line = [sys.executable, str(ROOT / "benchmarks" / "make_figures.py"), *command]
    return subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)


def test_every_picture_is_made_by_one_part():
    """The pictures and notebooks below docs are those of the manifest, none of two parts."""
    made = [file for part in PARTS.values() for file in part.files]
    assert len(made) == len(set(made))
    there = {
        str(path.relative_to(DOCS))
        for folder in (DOCS, DOCS / "figures", DOCS / "tutorials")
        for path in folder.iterdir()
        if path.suffix in SUFFIXES
    }
    assert there == set(made)


def test_every_picture_is_shown():
    """Some page shows each picture."""
    pictures = {
        (page.parent / path).resolve()
        for page in PAGES
        for path in pages.PICTURE.findall(page.read_text(encoding="utf-8"))
    }
    made = {p for part in PARTS.values() for p in part.files if not p.endswith(".ipynb")}
    assert made == {str(path.relative_to(DOCS)) for path in pictures}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_marks_name_parts_and_the_foot_says_what_made_them(page):
    """Every mark names a part; a page with marks or pictures of parts says at its foot mark of each
    part by which commit it was made, or that it is to be made."""
    text = page.read_text(encoding="utf-8")
    assert {match["part"] for match in pages.MARK.finditer(text)} <= set(PARTS)
    assert text.count("<!-- made by") == len(pages.MARK.findall(text)) + len(
        pages.FOOT.findall(text)
    )
    names = pages.parts_of(page, DOCS, PARTS)
    feet = [match["body"].strip("\n") for match in pages.FOOT.finditer(text)]
    assert feet == ([pages.foot(names, RECORDS)] if names else [])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pieces_of_older_physics_say_so(page):
    """A piece between marks has the note that the record of its part asks for, and no other."""
    for match in pages.MARK.finditer(page.read_text(encoding="utf-8")):
        body = match["body"].strip("\n")
        assert "/out/" not in body  # a path of the machine that made it
        assert not re.search(r"\bnan\b", body)
        assert body == pages.with_note(body, match["part"], RECORDS.get(match["part"]))


@pytest.mark.parametrize(
    "page", [PAGES[0], *sorted((DOCS / "studies").glob("*.md"))], ids=lambda page: page.stem
)
def test_counts_of_trials_stand_between_marks(page):
    """README and studies have no rate that a part does not fill."""
    text = pages.MARK.sub("", page.read_text(encoding="utf-8"))
    assert re.findall(r"\b\d+ of \d+\b|\d passe[ds]\b|\d % pass", text) == []


@pytest.mark.long
def test_figures_are_of_todays_physics():
    """Of each part that is not marked as older, the short runs give today what they gave when it
    was made. Otherwise its figures are silently stale: make them, or mark them."""
    made = [PARTS[name] for name, record in RECORDS.items() if not record.older]
    physics = {name: usual(name) for name in parts.probes_of(made)}
    stale = parts.stale(PARTS, RECORDS, physics)
    changed = sorted({probe for names in stale.values() for probe in names})
    assert not stale, (
        f"the physics of {', '.join(changed)} has changed: make figures "
        f'PARTS="{" ".join(stale)}", or mark them: '
        f"python benchmarks/make_figures.py --older {' '.join(stale)}"
    )


@pytest.mark.parametrize(
    ("probe", "change"),
    [
        ("tee", {"robot.contact_time": 0.0101}),
        ("climb", {"robot.motor.speed_bandwidth": 18.2}),
        ("tee", {"control.parameters.tracking.gain": 40.4}),
        ("tee", {"robot.contact_length": 0.0909}),
        ("elbow", {"control.parameters.damping.elbow": 2.525}),
        ("depth", {"sensing.filter.pixel_share": 0.0505}),
        ("headlight", {"sensing.headlight.gamma": 2.22}),
    ],
    ids=lambda value: value if isinstance(value, str) else next(iter(value)),
)
def test_probes_notice_a_change_of_a_percent(probe, change):
    """A constant of contact, drive, control or estimation that is one in a hundred off moves a
    probe beyond its tolerance."""
    moved = probes.difference(usual(probe), probes.measured(probe, change))
    assert moved > 3 * probes.TOLERANCE


def test_a_probe_repeats_far_within_its_tolerance():
    """States that differ by 1e-9 at the start end within a tenth of the tolerance, so rounding of
    another processor, a millionth of that, does not count as a change."""
    preload = 25.0 * (1 + 1e-9)
    for name in ("tee", "merge", "elbow"):
        moved = probes.measured(name, {"robot.preload": preload})
        assert probes.difference(usual(name), moved) < probes.TOLERANCE / 10


def test_values_of_other_shapes_differ():
    """A probe that measures another quantity than when a part was made has changed."""
    one = {"energy": [1.0], "force": [20.0]}
    assert probes.difference(one, one) == 0.0
    assert probes.difference(one, {"energy": [1.0]}) == 1.0
    assert probes.difference(one, {"energy": [1.001], "force": [20.0]}) == pytest.approx(1e-3, 0.01)


class Understood(Exception):
    """A script has read its arguments."""


@pytest.mark.parametrize("part", PARTS.values(), ids=lambda part: part.name)
def test_commands_of_parts_are_commands(part, monkeypatch):
    """Each names a command of the package with options that it has, or a script that understands
    the arguments, and makes its pictures below its own folder."""
    parse_args = argparse.ArgumentParser.parse_args

    def parse(self: argparse.ArgumentParser) -> None:
        parse_args(self)
        raise Understood

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse)
    for line in part.lines("OUT"):
        words = shlex.split(line)
        options = {word for word in words if word.startswith("--")}
        if words[0] == "omnitrack":
            command = get_command(app).commands[words[1]]
            known = [(*option.opts, *option.secondary_opts) for option in command.params]
            assert options <= {name for names in known for name in names}, line
        else:
            if "learning" in words[0]:
                pytest.importorskip("torch")
            monkeypatch.setattr(sys, "argv", words)
            monkeypatch.syspath_prepend(str((ROOT / words[0]).parent))
            with pytest.raises(Understood):
                runpy.run_path(str(ROOT / words[0]), run_name="__main__")
    assert part.minutes > 0
    assert part.about


def test_part_names_are_checked():
    """An unknown part ends with status 2 and the names that there are; nothing is run."""
    told = shown(["tee_mergee"])
    assert told.returncode == 2
    assert "did you mean 'tee_merge'?" in told.stderr
    assert all(name in told.stderr for name in PARTS)


def test_the_list_shows_every_part_and_its_cost():
    """A line for each part."""
    lines = shown(["--list"]).stdout.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == list(PARTS)


def test_tables_of_a_sweep_count_each_trial_once():
    """Rows of a range, of a direction and of words add up to all trials."""
    quick = {"run.time_limit": 0.01}
    sweep = ot.load_sweep("tee_monte_carlo", quick).model_copy(update={"samples": 16})
    result = ot.run_trials(sweep)
    for cuts in sweep_tables.TABLES["tee_monte_carlo"].values():
        for cut in cuts:
            assert sum(
                which.astype(int) for which in sweep_tables.groups(result, cut).values()
            ) == (pytest.approx(1))
        _, rows = sweep_tables.rows_of(result, cuts)
        assert sum(int(row[-1].split()[2]) for row in rows) == 16


TOY = """
[toy]
about = "counts"
minutes = 1
commands = ["FOLDER/first.py {out}", "FOLDER/second.py {out}"]
files = { "figures/toy.png" = "toy.png" }
"""
FIRST = """
import pathlib, sys
with pathlib.Path(sys.argv[1], "../../count").open("a") as file:
    file.write("1")
print("## one\\n\\n| a |\\n|---|\\n| 1 |")
"""
SECOND = """
import pathlib, sys, time
out = pathlib.Path(sys.argv[1])
if not (out / "../../go").exists():
    (out / "../../waits").touch()
    time.sleep(60)
(out / "toy.png").write_bytes(b"picture")
print("## two\\n\\nNew text.")
"""
PAGE = """# Page

<!-- made by: toy one -->
<!-- end -->

Between.

<!-- made by: toy two -->
Old text.
<!-- end -->

<!-- made by -->
<!-- end -->
"""


@pytest.fixture
def toy(tmp_path) -> Path:
    """A checkout of a page and one part of two commands, of which the second waits to be killed."""
    (tmp_path / "docs" / "figures").mkdir(parents=True)
    (tmp_path / "figures.toml").write_text(TOY.replace("FOLDER", str(tmp_path)))
    (tmp_path / "first.py").write_text(FIRST)
    (tmp_path / "second.py").write_text(SECOND)
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    (tmp_path / "README.md").write_text("# Toy\n")
    return tmp_path


def options(root: Path) -> list[str]:
    names = {"--manifest": "figures.toml", "--docs": "docs", "--out": "out/figures"}
    return [word for name, path in names.items() for word in (name, str(root / path))]


@pytest.mark.long
def test_a_part_that_was_killed_goes_on_and_then_fills_its_page(toy):
    """Its first command is not run again; before all is made page and pictures stay as they are,
    then they have the new pieces, and the foot the commit; made once more, nothing is run."""
    script = str(ROOT / "benchmarks" / "make_figures.py")
    killed = subprocess.Popen([sys.executable, script, *options(toy)], start_new_session=True)
    for _ in range(600):
        if (toy / "out" / "waits").exists():
            break
        time.sleep(0.1)
    os.killpg(killed.pid, signal.SIGKILL)  # its command, too
    killed.wait()
    assert (toy / "docs" / "page.md").read_text() == PAGE
    (toy / "out" / "go").touch()
    assert shown(options(toy)).returncode == 0
    assert (toy / "out" / "count").read_text() == "1"
    text = (toy / "docs" / "page.md").read_text()
    assert "-->\n| a |\n|---|\n| 1 |\n<!-- end -->" in text
    assert "New text." in text
    assert "Old text." not in text
    record = json.loads((toy / "docs" / "figures.json").read_text())["parts"]["toy"]
    assert f"commit {record['commit'][:7]}" in text
    assert (toy / "docs" / "figures" / "toy.png").read_bytes() == b"picture"
    assert "made by today's physics" in shown(options(toy)).stdout
    assert (toy / "out" / "count").read_text() == "1"
    told = shown([*options(toy), "--older", "toy"])
    assert told.returncode == 0, told.stderr
    assert "*Made by older physics, at commit" in (toy / "docs" / "page.md").read_text()


QUOTES = """# Page

It leans by 67.6 degrees, as said: that is 90
times as much. By 67.65 it would fall. Within 10 s.

<!-- made by: toy one -->
0.75 against 67.6 degrees, 90 times, in 10 s
<!-- end -->

```
67.6 degrees
```
"""


def test_sentences_that_quote_a_figure_which_is_printed_no_longer_are_named(toy):
    """By the figure with its fraction or its unit, whatever the line breaks; what the part still
    prints, other numbers and code are not. All is put in place, and the exit status is 1."""
    made = {"one": "0.77 against 32.4 degrees, 42 times, in 10 s"}
    found = pages.stale_sentences(QUOTES, "toy", made)
    assert found == ["It leans by 67.6 degrees, as said:", "that is 90 times as much."]
    assert pages.stale_sentences(QUOTES, "other", made) == []
    assert pages.stale_sentences(pages.filled(QUOTES, lambda _: made["one"]), "toy", made) == []
    (toy / "out").mkdir()
    (toy / "out" / "go").touch()
    page = toy / "docs" / "page.md"
    page.write_text(PAGE.replace("Between.", "There are 12.5 N.").replace("Old text.", "12.5 N"))
    told = shown(options(toy))
    assert told.returncode == 1
    assert "toy no longer prints a figure of docs/page.md: There are 12.5 N." in told.stderr
    assert "New text." in page.read_text()
    assert shown(options(toy)).returncode == 0


def test_a_part_that_leaves_a_piece_out_changes_nothing(toy):
    """A mark that no heading of the commands answers is a fault that names it; exit status 1."""
    (toy / "out").mkdir()
    (toy / "out" / "go").touch()
    (toy / "second.py").write_text(SECOND.replace("## two", "## too"))
    told = shown(options(toy))
    assert (told.returncode, "did not make ## two" in told.stderr) == (1, True)
    assert (toy / "docs" / "page.md").read_text() == PAGE
    assert not (toy / "docs" / "figures.json").exists()


def test_two_runs_at_once_keep_the_records_of_each_other(toy):
    """Each reads them as it begins, and makes another part."""
    (toy / "out").mkdir()
    (toy / "out" / "go").touch()
    more = f"""
[more]
about = "another one"
minutes = 1
commands = ["{toy}/first.py {{out}}"]
"""
    (toy / "figures.toml").write_text(TOY.replace("FOLDER", str(toy)) + more)
    folders = toy / "figures.toml", toy / "docs", toy / "out" / "figures"
    one, other = (make_figures.Maker(*folders, workers=1, quick=False) for _ in range(2))
    one.make("toy")
    other.make("more")
    assert set(parts.read_records(toy / "docs" / "figures.json")) == {"toy", "more"}


def test_records_are_read_as_they_were_written(tmp_path):
    """Measurements that parts share stand in the file once."""
    values = {"energy": [1.5]}
    one = parts.Record("abc", "2026", 3.0, probes={"tee": values}, commands=("a",))
    records = {"a": one, "b": replace(one, probes={"tee": values, "climb": values})}
    parts.write_records(records, tmp_path / "records.json")
    assert parts.read_records(tmp_path / "records.json") == records
    assert len(json.loads((tmp_path / "records.json").read_text())["probes"]["tee"]) == 1
