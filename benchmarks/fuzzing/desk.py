"""Where a case is tried: an empty working folder, its output caught, its time limited."""

from __future__ import annotations

import gc
import math
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from fuzzing.faults import Fault, below, fault_of

STARTING = 4.0
"""Processor time that Python and the package may take to start, s."""
PATIENCE = 300.0
"""Seconds by the clock that a process may take."""
MAX_TOLD = 10_000
"""Characters that a message or the output of a refused command may have."""
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_Value = TypeVar("_Value")


class Desk:
    """A worker's place.

    Attributes:
        folder: working folder of the case, empty as it begins.
        faults: found in the case so far.
        real: whether commands are run as processes, as a user does; in this process otherwise.
        output: what the last attempt wrote to standard output and standard error.
    """

    def __init__(self, place: Path) -> None:
        self._place = place
        self.folder = place / "here"
        self.faults: list[Fault] = []
        self.real = False
        self.output = ("", "")

    @contextmanager
    def case(self) -> Iterator[None]:
        """A clean desk for one case."""
        self.faults, self.real = [], False
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        os.chdir(self.folder)
        yield
        os.chdir(self._place)

    def attempt(
        self, doing: str, seconds: float, call: Callable[[], _Value], allowed: type[Exception]
    ) -> tuple[_Value | None, Exception | None]:
        """Do something within a limit of processor time; what it gave, or the allowed error.

        Any other exception, any warning, and all that is printed is a fault.
        """
        value, error = None, None
        with self._caught(doing, seconds):
            try:
                value = call()
            except allowed as refused:
                error = refused
                if len(str(refused)) > MAX_TOLD:
                    self.add("long message", doing, f"{len(str(refused))} characters")
                if not all(fault.where for fault in getattr(refused, "faults", ())):
                    self.add("no place in the message", doing, str(refused)[:300])
            except Exception as other:
                self.faults.append(fault_of(other, doing))
        if any(self.output):
            self.add("prints", doing, " | ".join(self.output))
        return value, error

    def command(
        self,
        arguments: list[str],
        seconds: float,
        statuses: Collection[int] = (0, 2),
        largest: int | None = None,
    ) -> int | None:
        """Run the command line; its exit status, None where it raised.

        Args:
            arguments: of the command line.
            seconds: processor time that it may take.
            statuses: with which it may end.
            largest: bytes that a file may grow to, as if the disk were full then.
        """
        doing, status = f"omnitrack {' '.join(arguments[:1])[:30]}", None
        call = _process if self.real else _called
        with self._caught(doing, seconds), _disk(largest):
            try:
                status = call(arguments, seconds)
            except Exception as error:
                self.faults.append(fault_of(error, doing))
        self.judge(doing, status, statuses)
        return status

    def judge(self, doing: str, status: int | None, statuses: Collection[int]) -> None:
        """Faults of exit status and output."""
        if status is not None and status not in statuses:
            self.add(f"exit status {status}", doing, self.output[1][-300:])
        text = "".join(self.output)
        for word in ("Traceback", "Warning"):
            if word in text:
                self.add(f"{word} on the screen", doing, text[:300])
        if _CONTROL.search(text):
            self.add("control characters on the screen", doing, repr(text[:300]))
        if status == 2 and len(text) > MAX_TOLD:
            self.add("long message", doing, f"{len(text)} characters")
        if status == 2 and not text.strip():
            self.add("no message", doing)

    def only(self, doing: str, *names: str) -> None:
        """The working folder holds nothing but files of these names."""
        strange = sorted(path.name for path in self.folder.iterdir() if path.name not in names)
        if strange:
            self.add("left behind", doing, ", ".join(strange)[:300])

    def add(self, what: str, place: str, detail: str = "") -> None:
        """Note a fault of the case."""
        self.faults.append(Fault(what, place, detail))

    @contextmanager
    def _caught(self, doing: str, seconds: float) -> Iterator[None]:
        """Output goes to files, warnings become faults, and processor time is limited."""
        (self._place / "doing").write_text(doing)
        paths = [self._place / name for name in ("out", "err")]
        with warnings.catch_warnings(record=True) as seen, _redirected(paths):
            warnings.simplefilter("always")
            signal.setitimer(signal.ITIMER_PROF, seconds)
            try:
                yield
            finally:
                gc.collect()  # so that what is left open is told here
                signal.setitimer(signal.ITIMER_PROF, 0)
        self.output = (paths[0].read_text(errors="replace"), paths[1].read_text(errors="replace"))
        for warning in seen:
            where = f": {below(str(warning.filename))}:{warning.lineno}"
            left_open = issubclass(warning.category, ResourceWarning)  # told at any later line
            place = doing if left_open else f"{doing}{where}"
            self.add(warning.category.__name__, place, str(warning.message)[:300])


def _called(arguments: list[str], _seconds: float) -> int:
    """Exit status of the command line in this process."""
    from omnitrack_sim.cli import main

    sys.argv = ["omnitrack", *arguments]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _process(arguments: list[str], seconds: float) -> int:
    """Exit status of the command line as a process of its own, without a terminal or UTF-8."""
    most = math.ceil(seconds + STARTING)
    return subprocess.run(
        [sys.executable, "-m", "omnitrack_sim.cli", *arguments],
        stdin=subprocess.DEVNULL,
        env={**os.environ, "LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1)),
        timeout=PATIENCE,
    ).returncode


@contextmanager
def _disk(largest: int | None) -> Iterator[None]:
    """A disk that no file of over ``largest`` bytes goes onto."""
    if largest is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextmanager
def _redirected(paths: list[Path]) -> Iterator[None]:
    """Standard output and standard error of this process and what it calls go to two files."""
    saved = [os.dup(1), os.dup(2)]
    try:
        for descriptor, path in enumerate(paths, start=1):
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, descriptor)
            os.close(file)
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        for descriptor, old in enumerate(saved, start=1):
            os.dup2(old, descriptor)
            os.close(old)
