"""Commands that replace what is there, killed on their way.

After each kill whoever reads finds the earlier output whole, or the data of the new one: pictures
are drawn after the data are saved. After the next undisturbed start the new one must be there
whole, with its pictures and nothing beside it.
"""

from __future__ import annotations

import hashlib
import random
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from killing.processes import kill_group, started
from omnitrack_sim.base.writing import whole

LAUNCH = Path(__file__).with_name("launch.py")
LAST = 0.4
"""Part of the kills by count that fall on the last changes, where the output takes its place."""
PATIENCE = 3600.0
"""Seconds by the clock that one start may take; the first one of ``reproduce`` takes minutes."""
PICTURES = (".png", ".svg", ".html", ".mp4")
"""Endings of what is drawn from the data."""
State = Mapping[str, str]
"""Digests of all files below a folder by path."""


@dataclass(frozen=True)
class Subject:
    """A command to be killed.

    Attributes:
        name: of it.
        earlier: arguments of the commands that make the earlier output.
        command: arguments of the one that is killed. It writes below the folder ``out``.
        loads: whether what is below ``out`` can be read.
        draws: whether pictures are drawn after its data are saved.
        remembers: whether its simulations are kept from start to start.
        statuses: with which it may end.
    """

    name: str
    earlier: tuple[tuple[str, ...], ...]
    command: tuple[str, ...]
    loads: Callable[[Path], object]
    draws: bool = False
    remembers: bool = False
    statuses: tuple[int, ...] = (0,)


class Trial:
    """Starts and kills one subject in a folder of its own."""

    def __init__(self, subject: Subject, place: Path) -> None:
        self.subject, self.place = subject, place.resolve()
        self.out, self.kept = self.place / "out", self.place / "earlier"
        self.out.mkdir(parents=True)
        self.states: list[State] = []
        self._said = ""

    def kill_often(self, kills: int, seed: int) -> list[str]:
        """Kill the command so many times, each time anew; what was wrong."""
        rng, name = random.Random(f"{self.subject.name} {seed}"), self.subject.name
        for arguments in self.subject.earlier:
            self._start(arguments)
        shutil.copytree(self.out, self.kept)
        begun = time.monotonic()
        changes = self._start(self.subject.command)
        life = time.monotonic() - begun
        earlier, new = _state(self.kept), _state(self.out)
        data = {path: digest for path, digest in new.items() if not path.endswith(PICTURES)}
        self.states = [earlier, new, *([data] if self.subject.draws else [])]
        print(f"{name}: {life:.1f} s, {changes} changes of files", flush=True)
        faults = ["both outputs are the same"] if self.states[0] == self.states[1] else []
        for number, moment in enumerate(_moments(rng, kills, changes)):
            found = list(self._killed(moment, life, rng))
            found += self._undisturbed()
            told = "; ".join(found) or "whole"
            print(f"{name}, kill {number + 1} {self._said}: {told}", flush=True)
            faults += [f"{name}, kill {number + 1} {self._said}: {fault}" for fault in found]
        return faults

    def _killed(self, moment: int, life: float, rng: random.Random) -> Iterator[str]:
        """Kill the command before a change of that number, or at a random time with 0."""
        self._restore()
        if moment:
            self._said = f"before change {moment}"
            process = started(self._line(self.subject.command, moment), cwd=self.place)
            process.wait(PATIENCE)
        else:
            process = self._killed_in_time(life, rng)
        if process.returncode in self.subject.statuses:
            yield "was not killed"
        for path in self.kept.iterdir():
            whole(self.out / path.name)  # as what reads a folder does
        state = _state(self.out)
        if all(state.items() & known.items() != known.items() for known in self.states):
            yield f"neither the earlier output nor the new one: {_described(state, self.states)}"
            return
        try:
            self.subject.loads(self.out)
        except Exception as error:
            yield f"cannot be read: {error}"

    def _killed_in_time(self, life: float, rng: random.Random) -> subprocess.Popen[bytes]:
        """Kill the command at a random time of its life; again where it was quicker."""
        while True:
            wait = rng.uniform(0, life)
            process = started(self._line(self.subject.command, 0), cwd=self.place)
            try:
                process.wait(wait)
            except subprocess.TimeoutExpired:
                kill_group(process)
                self._said = f"after {wait:.1f} s"
                return process
            self._restore()

    def _undisturbed(self) -> Iterator[str]:
        """Start the command once more and let it end."""
        try:
            self._start(self.subject.command)
        except subprocess.CalledProcessError as error:
            yield f"the next start ends with status {error.returncode}"
            return
        state = _state(self.out)
        left = sorted(state.keys() - self.states[1].keys())
        if left:
            yield f"left behind after the next start: {', '.join(left[:3])}"
        elif state != self.states[1]:
            yield f"the next start gives other files: {_described(state, self.states[1:2])}"

    def _restore(self) -> None:
        """The state before the command: the earlier output alone."""
        shutil.rmtree(self.out)
        shutil.copytree(self.kept, self.out)

    def _start(self, arguments: tuple[str, ...]) -> int:
        """Let a command end; the number of its changes."""
        process = started(self._line(arguments, 0), cwd=self.place)
        status = process.wait(PATIENCE)
        if status not in self.subject.statuses:
            raise subprocess.CalledProcessError(status, shlex.join(arguments))
        return int((self.place / "count").read_text())

    def _line(self, arguments: tuple[str, ...], deadly: int) -> list[str]:
        runs = str(self.place / "runs") if self.subject.remembers else "-"
        watch = [str(self.out), str(deadly), str(self.place / "count"), runs]
        return [sys.executable, str(LAUNCH), *watch, *arguments]


def _moments(rng: random.Random, kills: int, changes: int) -> list[int]:
    """Before which change each kill comes, all over the life of the process; 0 at a random time."""
    by_count = kills - kills // 2
    last = round(LAST * by_count)
    ends = [changes - i for i in range(last) if changes > i]
    spread = [1 + i * changes // max(1, by_count - len(ends)) for i in range(by_count - len(ends))]
    moments = [*ends, *spread, *[0] * (kills // 2)]
    rng.shuffle(moments)
    return moments


def _state(folder: Path) -> State:
    """Digests of the files below a folder; folders count by their names, with no digest."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else ""
        for path in sorted(folder.rglob("*"))
    }


def _described(state: State, known: list[State]) -> str:
    """How a state differs from each of those that are known."""
    return " / ".join(
        ", ".join(
            f"{name} {'differs' if name in state else 'is missing'}"
            for name in [name for name in other if state.get(name) != other[name]][:3]
        )
        for other in known
    )
