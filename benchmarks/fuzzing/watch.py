"""Cases tried in processes of their own, so that a hang, a crash or a hunger for memory is seen.

A worker is forked from this process, which has the package loaded. It tries one case after the
other and tells what it found through a pipe. Time is processor time: a busy machine changes
nothing.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO

from fuzzing.desk import Desk
from fuzzing.faults import Fault, place_in_dump

MEMORY = 4 << 30
"""Address space that a worker may take on top of what the loaded package takes, bytes."""
PATIENCE = 300.0
"""Seconds by the clock after which a case that takes no processor time counts as hung."""
SHARE = 40
"""Cases a worker tries before the next one takes its place."""
Task = Callable[[int, Desk], None]
"""Tries one case by number at a desk, which keeps the faults."""
_NAMES = {signal.SIGPROF: "too slow", signal.SIGXCPU: "too slow"}


def watched(task: Task, numbers: Sequence[int]) -> Iterator[tuple[int, list[Fault]]]:
    """Number and faults of each case, in order."""
    left = list(numbers)
    gc.collect()
    gc.freeze()  # what is loaded is no matter of the cases
    while left:
        done = 0
        for number, faults in _one_worker(task, left[:SHARE]):
            done += 1
            yield number, faults
        left = left[done:]


def _one_worker(task: Task, numbers: Sequence[int]) -> Iterator[tuple[int, list[Fault]]]:
    """What one worker tells, up to its end or its death."""
    place = Path(tempfile.mkdtemp(prefix="fuzz."))
    reader, writer = os.pipe()
    # What this process has printed and not yet written, the worker would write once more.
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        _work(task, numbers, place, writer)  # does not return
    os.close(writer)
    told = 0
    try:
        with os.fdopen(reader, encoding="utf-8") as pipe:
            for faults in _faults_by_case(pipe, pid):
                yield numbers[told], faults
                told += 1
        status = os.waitpid(pid, 0)[1]
        if told < len(numbers):
            yield numbers[told], [_death(status, place)]
    finally:
        with contextlib.suppress(ChildProcessError, ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        shutil.rmtree(place, ignore_errors=True)


def _faults_by_case(pipe: IO[str], pid: int) -> Iterator[list[Fault]]:
    """The faults of one case after the other, as the worker writes them.

    A case ends with an empty line.
    """
    faults: list[Fault] = []
    while True:
        if not select.select([pipe], [], [], PATIENCE)[0]:
            os.kill(pid, signal.SIGKILL)
            return
        while line := pipe.readline():
            if line.strip():
                faults.append(Fault.from_json(line))
            else:
                break
        if not line:
            return
        yield faults
        faults = []


def _work(task: Task, numbers: Sequence[int], place: Path, writer: int) -> None:
    """The life of a worker."""
    code = 1
    try:
        told = os.fdopen(writer, "w", encoding="utf-8")
        dump = (place / "dump").open("w")
        faulthandler.enable(dump)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        faulthandler.register(signal.SIGPROF, dump, all_threads=False, chain=True)
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        desk = Desk(place)
        for number in numbers:
            (place / "doing").write_text("starts")
            with desk.case():
                task(number, desk)
            told.writelines(f"{fault.to_json()}\n" for fault in desk.faults)
            told.write("\n")
            told.flush()
        code = 0
    except BaseException:
        (place / "dump").write_text(traceback.format_exc()[-1000:])
    finally:
        os._exit(code)


def _death(status: int, place: Path) -> Fault:
    """What a worker died of."""
    doing = (place / "doing").read_text()
    dump = (place / "dump").read_text(errors="replace")
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        what = _NAMES.get(number, f"killed by {signal.Signals(number).name}")
    else:
        what = f"worker ended with status {os.WEXITSTATUS(status)}"
    return Fault(what, f"{doing}: {place_in_dump(dump)}", dump[:600])
