"""`omnitrack render`: films and strips of a saved run."""

from __future__ import annotations

from contextlib import contextmanager

import av
import imageio.v3 as imageio
import pytest
from samples import sample_result
from typer.testing import CliRunner

from omnitrack_sim.cli import app
from omnitrack_sim.cli.runs import FRAMES_A_PROCESS, processes_for


@pytest.fixture
def folder(tmp_path):
    """A saved run."""
    return sample_result().save(tmp_path / "run")


def rendered(*arguments: object):
    """What a call of the command ends with."""
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def test_size_and_rate_are_those_asked_for(folder, tmp_path):
    """Of a film, whatever its format."""
    for ending in ("mp4", "webm"):
        path = tmp_path / f"film.{ending}"
        done = rendered(folder, "--size", "64x36", "--fps", 5, "--out", path, "--processes", 1)
        assert done.exit_code == 0, done.output
        with av.open(str(path)) as film:
            stream = film.streams.video[0]
            assert (stream.width, stream.height, stream.average_rate) == (64, 36, 5)


def test_progress_of_a_film_is_told_to_its_end(folder, tmp_path, monkeypatch):
    """Beside its title, unless the film goes with a run that is quiet."""
    told, parts = [], []

    @contextmanager
    def progress(title, quiet):
        told.append((title, quiet))
        yield lambda part, text="": parts.append(part)

    monkeypatch.setattr("omnitrack_sim.cli.runs.progress", progress)
    done = rendered(folder, "--size", "64x36", "--fps", 5, "--out", tmp_path / "film.mp4")
    assert done.exit_code == 0, done.output
    assert told == [("video", False)]
    assert parts[-1] == 1.0
    assert parts == sorted(parts)


def test_a_strip_of_times(folder):
    """Two stills in a row; without --out in the folder of the run."""
    done = rendered(folder, "--at", "0.0,0.02", "--size", "80x60")
    assert done.exit_code == 0, done.output
    assert imageio.imread(folder / "strip.png").shape[1] == 2 * (80 + 2) + 2


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["--size", "64"], "--size: is '64'; it is WIDTHxHEIGHT"),
        (["--size", "0x36"], "width: is 0; must be from 1 to 7680"),
        (["--size", "64x99999"], "height: is 99999; must be from 1 to 7680"),
        (["--fps", "241"], "fps: is 241; must be from 1 to 240"),
        (["--fps", "51", "--out", "film.gif"], "fps: is 51; must be from 1 to 50"),
        (["--processes", "0"], "processes: is 0; must be from 1 to 64"),
        (["--strip", "0"], "count: are 0 stills; must be from 1 to 26"),
        (["--strip", "2", "--fps", "5"], "--fps: is for films"),
        (["--strip", "2", "--at", "0.0"], "--strip: is 2, but --at has 1 times"),
        (["--at", "soon"], "--at: is 'soon'; it is times in s"),
        (["--at", "0.0,1e9"], "--at: is 1e+09 s; the run goes from 0 to"),
        (["--strip", "2", "--out", "strip.mp4"], "png, jpg, jpeg, pdf"),
        (["--out", "film.avi"], "mp4, webm, gif"),
    ],
)
def test_what_cannot_be_made_is_refused(folder, monkeypatch, capsys, asked, told):
    """With status 2 and the place of the fault, and nothing is written."""
    from omnitrack_sim.cli import main

    monkeypatch.chdir(folder.parent)
    monkeypatch.setattr("sys.argv", ["omnitrack", "render", "run", *asked])
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert sorted(folder.rglob("*")) == before


def test_processes_are_as_many_as_pay(monkeypatch):
    """One for each so many frames, and at most half as many as processors."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)))
    assert processes_for(1.0, 25) == 1
    assert processes_for(2 * FRAMES_A_PROCESS / 25, 25) == 2
    assert processes_for(3600.0, 25) == 4
