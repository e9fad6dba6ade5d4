"""The progress bar of sweeps and studies: what stands behind it, and what an interruption says."""

from types import SimpleNamespace

import pytest
import typer
from rich.progress import Progress

from omnitrack_sim.cli import trials
from omnitrack_sim.cli.trials import trials_bar


def _status(done, found=0, lost=0):
    return SimpleNamespace(total=10, found=found, done=done, lost=lost)


def _bar(quiet=False):
    return trials_bar(
        "sweep [x]", quiet, lambda s, pace: (pace, f"{s.done} passed"), lambda s: f"{s.done} done"
    )


def test_the_bar_tells_pace_and_losses_of_this_run(monkeypatch):
    """Pace and time left count what this run did; what is not known yet is left out."""
    told = []
    monkeypatch.setattr(Progress, "update", lambda self, task, **new: told.append(new["text"]))
    pace = trials._pace
    monkeypatch.setattr(trials, "_pace", lambda status, elapsed: pace(status, 4.0))
    with _bar() as tell:
        tell(_status(2, found=2))
        tell(_status(4, found=2, lost=1))
    assert told == ["2 passed", "0.50 trials/s, 0:00:12 left, 4 passed, 1 times workers lost"]


def _interrupted(quiet, told):
    with _bar(quiet) as tell:
        for done in told:
            tell(_status(done))
        raise KeyboardInterrupt


@pytest.mark.parametrize("quiet", [False, True])
@pytest.mark.parametrize(
    ("told", "said"), [([], "nothing is done"), ([1, 3], "3 done")], ids=["at once", "on the way"]
)
def test_an_interruption_says_how_far_it_came(quiet, told, said, capfd):
    """Exit status 130, and the last status is the one that counts."""
    with pytest.raises(typer.Exit) as ended:
        _interrupted(quiet, told)
    assert ended.value.exit_code == 130
    assert f"interrupted: {said}; the same command goes on" in capfd.readouterr().err
