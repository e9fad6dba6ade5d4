"""What the commands that run many trials share: their workers, progress, interruption."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Protocol, TypeVar

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import counted
from omnitrack_sim.cli.common import err, plain
from omnitrack_sim.cli.lines import WAIT, Lines, clock

if TYPE_CHECKING:
    from concurrent.futures import Executor

WorkersOption = Annotated[
    int | None,
    typer.Option(min=1, help="Processes on this machine; as many as cores when not given."),
]
DaskOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786.")
]


class Status(Protocol):
    """How many trials there are, were found done, are done now, and how often workers were lost."""

    @property
    def total(self) -> int: ...
    @property
    def found(self) -> int: ...
    @property
    def done(self) -> int: ...
    @property
    def lost(self) -> int: ...


_Status = TypeVar("_Status", bound=Status)


def make_workers(workers: int | None, dask: str | None) -> Callable[[], Executor] | None:
    """A function that makes the workers; None for trials in this process."""
    from omnitrack_sim.base.workers import DaskPool, LocalPool

    if dask is not None:
        if workers is not None:
            raise InputError(Fault("--workers, --dask", "give one of the two"))
        logging.disable(logging.ERROR)  # distributed logs each lost connection with its traceback
        return lambda: DaskPool(dask)
    count = workers or len(os.sched_getaffinity(0))
    return None if count == 1 else lambda: LocalPool(count)


@contextmanager
def trials_bar(
    title: str,
    words: Callable[[_Status, str], tuple[str, ...]],
    reached: Callable[[_Status], str],
) -> Iterator[Callable[[_Status], None]]:
    """How far trials are, on standard error: a bar, or a line now and then where that is no
    terminal; yields the function that is told the status.

    Args:
        title: stands before it.
        words: what stands behind it, from the status and the pace, which is empty at first.
        reached: how far the trials are, for the message of an interruption.

    Raises:
        typer.Exit: with status 130, when Ctrl-C has been pressed.
    """
    seen: list[_Status] = []
    try:
        with (_bar if err.is_terminal else _lines)(title, words) as show:

            def tell(status: _Status) -> None:
                seen[:] = [status]
                show(status)

            yield tell
    except KeyboardInterrupt:
        done = reached(seen[0]) if seen else "nothing is done"
        err.print(f"interrupted: {done}; the same command goes on from there", soft_wrap=True)
        raise typer.Exit(130) from None


@contextmanager
def _bar(
    title: str, words: Callable[[_Status, str], tuple[str, ...]]
) -> Iterator[Callable[[_Status], None]]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[text]}"),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(plain(title), total=None, text="")

        def show(status: _Status) -> None:
            text = _told(status, words, bar.tasks[0].elapsed or 0.0)
            bar.update(task, completed=status.done, total=status.total, text=text)

        yield show


@contextmanager
def _lines(
    title: str, words: Callable[[_Status, str], tuple[str, ...]]
) -> Iterator[Callable[[_Status], None]]:
    """First how many trials there are, then the pace when the first of them are done, if the others
    take a while, and in the end how many are done."""
    lines = Lines(title, err)
    last: _Status | None = None
    pace_is_told = False

    def show(status: _Status) -> None:
        nonlocal pace_is_told
        text = _line(status, _told(status, words, lines.elapsed))
        ran = status.done - status.found
        if ran and not pace_is_told:
            pace_is_told = True
            if _seconds_left(status, lines.elapsed) > WAIT:
                lines.say(text)
        lines.tell(status.done / max(status.total, 1), text)

    def first(status: _Status) -> None:
        nonlocal tell
        many = "all" if status.found == status.total else str(status.found)
        found = f", {many} of them done before" if status.found else ""
        lines.say(f"{counted(status.total, 'trial')}{found}")
        tell = show

    def keep(status: _Status) -> None:
        nonlocal last
        last = status
        tell(status)

    tell = first
    yield keep
    if last is not None:
        lines.say(_line(last, _told(last, words, 0.0)))


def _line(status: Status, told: str) -> str:
    """How many trials are done, and what else there is to tell."""
    return ", ".join(filter(None, (f"{status.done} of {counted(status.total, 'trial')}", told)))


def _told(status: _Status, words: Callable[[_Status, str], tuple[str, ...]], elapsed: float) -> str:
    """What stands behind a bar or in a line; without a pace after 0 s."""
    lost = f"workers lost {counted(status.lost, 'time')}" if status.lost else ""
    return ", ".join(filter(None, (*words(status, _pace(status, elapsed)), lost)))


def _pace(status: Status, elapsed: float) -> str:
    """Trials in a second, and the time that the others take; empty before the first trial."""
    ran = status.done - status.found
    if not ran or not elapsed:
        return ""
    left = clock(_seconds_left(status, elapsed))
    return f"{ran / elapsed:.2f} trials/s, {left} left"


def _seconds_left(status: Status, elapsed: float) -> float:
    """The time that the others take at the pace of those that ran."""
    return max(status.total - status.done, 0) * elapsed / (status.done - status.found)
