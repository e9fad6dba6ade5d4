"""Places where the commands cannot write: refused before any work, with the place named and
nothing written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from samples import sample_result
from typer.testing import CliRunner

from omnitrack_sim.base import writing
from omnitrack_sim.base.errors import InputError, OmnitrackError, OutputError
from omnitrack_sim.cli import app
from omnitrack_sim.pipes import network

LONG = "n" * 256


def refused(*arguments: object) -> str:
    """Why a command ends; it must be something that the user can mend."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert isinstance(done.exception, OmnitrackError), done.exception
    return str(done.exception)


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A working folder with odd things in it, and no work that could be done."""

    def work(*_, **__):
        raise AssertionError("the command has begun to work")

    for target in (
        "omnitrack_sim.pipes.network.load_network",
        "omnitrack_sim.robots.omnitrack.singularity.TurnCase",
        "omnitrack_sim.sim.run.run",
        "omnitrack_sim.results.result.load_result",
        "omnitrack_sim.paper.reproduce.run_all",
        "omnitrack_sim.trials.dispatch.run_rows",
    ):
        monkeypatch.setattr(target, work)
    monkeypatch.chdir(tmp_path)
    for folder in ("folder", "folder.svg", "folder.gif"):
        (tmp_path / folder).mkdir()
    (tmp_path / "file").write_text("mine")
    os.mkfifo(tmp_path / "pipe.svg")
    yield tmp_path
    assert (tmp_path / "file").read_text() == "mine"
    assert len(list(tmp_path.rglob("*"))) == 5


COMMANDS = {
    "network": ("network", "fig14", "--plot"),
    "singularity": ("singularity", "--plot"),
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
@pytest.mark.parametrize(
    ("plot", "told"),
    [
        ("folder", "png, svg, pdf"),
        ("folder.svg", "is a folder"),
        ("plot", "png, svg, pdf"),
        ("plot.gif", "png, svg, pdf"),
        ("/", "png, svg, pdf"),
        (".", "png, svg, pdf"),
        ("..", "png, svg, pdf"),
        ("/dev/full", "png, svg, pdf"),
        ("pipe.svg", "is a device"),
        ("missing/plot.svg", "missing does not exist"),
        ("file/plot.svg", "Not a directory"),
        ("/proc/plot.svg", "cannot be written"),
        (f"{LONG}.svg", "name too long"),
    ],
)
def test_figures(place, command, plot, told):
    """Of a network, and of the region."""
    assert told in refused(*command, plot)


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("folder", "is a folder"),
        ("/", "is a folder"),
        ("..", "is a folder"),
        ("/dev/full", "is a device"),
        ("missing/net.toml", "missing does not exist"),
        (f"{LONG}.toml", "name too long"),
    ],
)
def test_network_files(place, out, told):
    """The place of --out."""
    assert told in refused("network", "fig14", "--out", out)
    assert Path("/dev/full").is_char_device()


@pytest.mark.parametrize(
    ("export", "told"),
    [("file", "is a file"), ("file/out", "Not a directory"), ("/proc/out", "cannot be written")],
)
def test_network_exports(place, export, told):
    """The place of --export."""
    assert told in refused("network", "fig14", "--export", export)


RUN = ("run", "straight", "--no-video")


@pytest.mark.parametrize("command", [RUN, ("reproduce", "--quick")], ids=["run", "reproduce"])
@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("file", "is a file"),
        (".", "holds files"),
        ("/dev/full", "is a file"),
        ("/proc/run", "cannot be written"),
        (LONG, "name too long"),
        (f"missing/{LONG}/run", "name too long"),
    ],
)
def test_runs_and_reproductions(place, command, out, told):
    """Refused before the run, however long that would take."""
    assert told in refused(*command, "--out", out)


@pytest.mark.parametrize(("out", "told"), [("file", "is a file"), (LONG, "name too long")])
def test_sweeps_and_studies(place, out, told):
    """Refused before the first trial of a sweep or a study."""
    assert told in refused("sweep", "tee_orientation", "--workers", "1", "--out", out)
    assert told in refused("optimise", "robot_design", "--workers", "1", "--out", out)


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("film.png", "mp4, webm, gif"),
        ("film", "mp4, webm, gif"),
        ("folder.gif", "is a folder"),
        ("missing/film.mp4", "missing does not exist"),
        (f"{LONG}.mp4", "name too long"),
    ],
)
def test_films(place, out, told):
    """Refused before the run is read."""
    assert told in refused("render", "folder", "--out", out)


def test_a_name_of_250_letters_can_be_run(tmp_path):
    """The folders that are made on the way have short names."""
    folder = sample_result().save(tmp_path / ("n" * 250))
    assert (folder / "result.json").is_file()


def test_an_export_is_there_whole_or_not_at_all(tmp_path, monkeypatch):
    """The disk is full at one of three files: none of them is there, nor the folder made for
    them."""
    calls, usual = [], os.fsync

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) == 1:
            raise OSError(28, "No space left on device")
        usual(descriptor)

    monkeypatch.setattr(writing.os, "fsync", full)
    done = refused("network", "narrow", "--export", tmp_path / "out")
    assert "No space left" in done
    assert not (tmp_path / "out").exists()


def test_an_export_of_names_that_are_too_long_is_refused(tmp_path, monkeypatch):
    """Before the walls are made."""
    net = network.load_network("narrow").model_copy(update={"name": "n" * 250})
    from omnitrack_sim.walls import export as network_export

    monkeypatch.setattr(network_export, "network_stl", None)
    with pytest.raises(OutputError, match="name too long"):
        network_export.export_network(net.name, net.pipes, tmp_path / "out")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("--modules", "13"),
        ("--modules", "100000000"),
        ("--pipe-diameter", "1e300"),
        ("--pipe-diameter", "1e-300"),
        ("--reach", "1e308"),
        ("--contact-length", "1e300"),
        ("--bend-radius", "1e-300"),
        ("--turn-angle-deg", "1e-300"),
        ("--theta5-deg", "inf"),
        ("--theta5-deg", "10", "--roll-deg", "nan"),
    ],
)
def test_the_region_of_impossible_robots_is_refused(arguments):
    """In no time, and without a warning."""
    done = CliRunner().invoke(app, ["singularity", *arguments])
    assert isinstance(done.exception, InputError), done.exception
