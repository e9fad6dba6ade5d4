"""The progress of sweeps and studies, and of single works: the bar of a terminal, the lines
elsewhere, and what an interruption says."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pyarrow as pa
import pytest
import typer
from rich.progress import Progress
from typer.testing import CliRunner

from omnitrack_sim import load_sweep, plot_sweep
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.cli import app, common, trials
from omnitrack_sim.cli.common import Screen, progress
from omnitrack_sim.cli.trials import trials_bar
from omnitrack_sim.trials.run import Status, TrialsResult


def _status(done, found=0, lost=0, total=10, batch=0):
    return Status(total, found, done, successes=done, lost=lost, batch=batch)


def _bar():
    return trials_bar("sweep [x]")


@pytest.fixture
def terminal(monkeypatch):
    """Standard error is a terminal."""
    monkeypatch.setattr(common, "err", Screen(stderr=True, force_terminal=True))


@pytest.fixture
def clock(monkeypatch):
    """The time that lines are told at; the test turns it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(common.time, "monotonic", lambda: now.s)
    return now


def test_the_bar_tells_what_is_done_and_lost(monkeypatch, terminal):
    """How far this run is of what it has to do, and in words how many trials passed."""
    told = []
    monkeypatch.setattr(
        Progress,
        "update",
        lambda self, task, completed, description: told.append((completed, description)),
    )
    with _bar() as tell:
        tell(_status(2, found=2))
        tell(_status(4, found=2, lost=1))
    title = "sweep \\[x]"
    assert told == [
        (0.0, f"{title} 10 trials, 2 of them done before"),
        (0.25, f"{title} 4 of 10 trials, 4 passed, workers lost 1 time"),
    ]


def test_without_a_terminal_lines_tell_size_pace_and_losses(clock, capfd):
    """At once how many trials there are; then a line each 5 s at most, when a tenth more is done
    or five minutes have passed, at the pace of this run; and the end."""
    with _bar() as tell:
        for after, done, lost in (
            (0, 2, 0),
            (8, 4, 0),
            (4, 6, 0),  # too soon
            (6, 6, 1),
            (20, 6, 1),  # no headway
            (281, 6, 1),
            (20, 10, 1),
        ):
            clock.s += after
            tell(_status(done, found=2, lost=lost))
    assert capfd.readouterr().err.splitlines() == [
        "sweep [x]: 10 trials, 2 of them done before",
        "sweep [x]: 25 %, 4 of 10 trials, 4 passed, 0:00:24 left",
        "sweep [x]: 50 %, 6 of 10 trials, 6 passed, workers lost 1 time, 0:00:18 left",
        "sweep [x]: 50 %, 6 of 10 trials, 6 passed, workers lost 1 time, 0:05:19 left",
        "sweep [x]: done in 0:05:39",
    ]


def test_one_trial_is_told_in_the_singular(clock, capfd, tmp_path):
    """In the lines of the progress, in the lists of a sweep and a study, and where the table of
    another sweep is refused."""
    with _bar() as tell:
        for done, lost in ((0, 0), (1, 1)):
            tell(_status(done, lost=lost, total=1))
    assert capfd.readouterr().err.splitlines() == [
        "sweep [x]: 1 trial",
        "sweep [x]: done in 0:00:00",
    ]
    assert trials._in_words(Status(1, 0, 1, 1, 1)) == "1 of 1 trial, 1 passed, workers lost 1 time"
    file = tmp_path / "one.toml"
    axis = '[[axes]]\npath = "world.friction"\nkind = "list"\nvalues = [0.8]\n'
    file.write_text(f'base = "straight"\n{axis}', encoding="utf-8")
    listed = CliRunner().invoke(app, ["sweep", str(file), "--list"])
    assert listed.stdout.startswith("1 trial in 1 batch of 1 model\n")
    sweep = load_sweep(file)
    assert repr(sweep) == "Sweep('one': 1 trial of straight; world.friction)"
    result = TrialsResult(sweep, {"trials": pa.table({})}, {}, Status(1))
    with pytest.raises(InputError, match=r"has 0 of 1 trial of 'one'$"):
        plot_sweep(result, tmp_path / "one.png")
    assert trials._work(1, 1) == "1 candidate of 1 trial, 1 trial in all"
    assert trials._work(2, 3) == "2 candidates of 3 trials, 6 trials in all"


def test_without_a_terminal_work_that_takes_a_while_tells_lines(clock, capfd):
    """How much there is; nothing in the first 5 s, and then a line each 5 s at most: how far it
    is, simulated time and place, and what is left."""
    with progress("run \x1b[2J", False) as tell:
        tell(0.0, "3 runs")
        for part in (0.1, 0.2, 0.25, 0.4, 1.0):
            clock.s += 3.0
            tell(part, "12 s, cruise in t1")
    assert capfd.readouterr().err.splitlines() == [
        "run \\x1b[2J: 3 runs",
        "run \\x1b[2J: 20 %, 12 s, cruise in t1, 0:00:24 left",
        "run \\x1b[2J: 40 %, 12 s, cruise in t1, 0:00:18 left",
        "run \\x1b[2J: done in 0:00:15",
    ]


def test_a_short_or_quiet_work_tells_nothing(capfd):
    """What is over within seconds, and what prints for machines."""
    with progress("run", False) as tell:
        tell(0.5, "cruise")
    with progress("run", True) as tell:
        assert tell is None
    assert capfd.readouterr().err == ""


def _interrupted(told, total=10, batch=0):
    with _bar() as tell:
        for done in told:
            tell(_status(done, total=total, batch=batch))
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("told", "said"),
    [([], "nothing is done"), ([1, 3], "3 of 10 trials done")],
    ids=["at once", "on the way"],
)
def test_an_interruption_says_how_far_it_came(told, said, capfd):
    """Exit status 130, and the last status is the one that counts."""
    with pytest.raises(typer.Exit) as ended:
        _interrupted(told)
    assert ended.value.exit_code == 130
    assert f"interrupted: {said}; the same command goes on" in capfd.readouterr().err


@pytest.mark.parametrize(("size", "told"), [(32, "the batch of up to 32 trials"), (1, "the trial")])
def test_an_interruption_says_what_begins_anew(size, told, capfd):
    """The batch that each worker was at."""
    with pytest.raises(typer.Exit):
        _interrupted([64], total=120, batch=size)
    said = f"64 of 120 trials done, and {told} that each worker was at begins anew; the same"
    assert said in " ".join(capfd.readouterr().err.split())


def test_a_piped_sweep_tells_its_size_and_its_end_and_keeps_its_json_clean(tmp_path):
    """Of the command itself, also where nothing is left to do: standard output is the summary
    alone."""
    (tmp_path / "two.toml").write_text(
        'base = "straight"\n'
        '[[axes]]\npath = "world.friction"\nkind = "list"\nvalues = [0.8, 0.9]\n',
        encoding="utf-8",
    )
    command = [Path(sys.executable).with_name("omnitrack"), "sweep", "two.toml", "--json"]
    command += ["--set", "run.time_limit=0.1", "--workers", "1"]
    for first in ("2 trials", "2 trials, all of them done before"):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        lines = done.stderr.splitlines()  # a slow machine tells its pace between the two
        assert (done.returncode, lines[0]) == (0, f"sweep two: {first}")
        assert lines[-1].startswith("sweep two: done in 0:")
        assert json.loads(done.stdout)["trials"] == 2
