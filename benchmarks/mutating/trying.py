"""Runs of chosen tests in copies of the checkout, forked from a process with the libraries."""

from __future__ import annotations

import importlib
import itertools
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

LIBRARIES = (
    *("numpy", "scipy.optimize", "scipy.spatial", "scipy.stats", "mujoco", "matplotlib.pyplot"),
    *("pyarrow.parquet", "pydantic", "typer", "rich.progress", "networkx", "trimesh", "filelock"),
    *(
        "manifold3d",
        "imageio",
        "PIL.Image",
        "llvmlite.binding",
        "coverage",
        "hypothesis",
        "xdist.plugin",
    ),
)
"""What tests import, loaded once: they are half of the time of a short test."""
PATIENCE = 60.0, 20.0
"""A test hangs after so many seconds, and so many times the seconds that it took before. Time for
which it waits for a core does not count."""
MEMORY = 12 << 30
"""Octets of address space that a process of tests may ask for."""
FAILED, NONE_LEFT = (1, 2, 4), 5
"""Status of pytest where a test failed, it or conftest.py could not be read, and where no chosen
one is there."""


def load_libraries() -> None:
    """Import what the tests import, but for the program itself."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    for name in LIBRARIES:
        with suppress(ImportError):
            importlib.import_module(name)


def files_of_checkout(root: Path) -> list[str]:
    """Return the files that git knows or would take, below the checkout."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    return [name for name in listed.stdout.splitlines() if (root / name).is_file()]


class Copy:
    """A copy of the checkout, in which one file at a time may be changed.

    Attributes:
        place: its folder.
        compiled: folder of what the program without a fault compiles.
    """

    _times = itertools.count(1_000_000_000)

    def __init__(self, root: Path, place: Path, compiled: Path) -> None:
        self.place, self.compiled = place, compiled
        shutil.rmtree(place, ignore_errors=True)
        for name in files_of_checkout(root):
            target = place / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, target)
        if not compiled.is_dir():
            compiled.mkdir(parents=True)
            for code in (root / "omnitrack_sim").rglob("__pycache__/*.o"):
                shutil.copy2(code, compiled)

    def write(self, file: str, text: bytes) -> None:
        """Change a file, with a time that it never had: bytecode of before does not count."""
        (self.place / file).write_bytes(text)
        moment = next(self._times)
        os.utime(self.place / file, (moment, moment))

    def environment(self, scratch: Path, is_faulty: bool) -> dict[str, str]:
        """Return what is different for processes of this copy.

        What a fault compiles goes to a folder that is dropped with the scratch folder.
        """
        compiled = scratch / "compiled" if is_faulty else self.compiled
        if is_faulty:
            shutil.copytree(self.compiled, compiled, copy_function=os.link)
        return {
            "PYTHONPATH": str(self.place),
            "NUMBA_CACHE_DIR": str(compiled),
            "TMPDIR": str(scratch),
            "OPENBLAS_NUM_THREADS": "1",
        }


class Chosen:
    """A plugin of pytest: runs chosen tests in their order, and keeps a log of what it does.

    A test is chosen by the name of its function; its parameters come along.
    """

    def __init__(self, tests: Sequence[str] | None, log: Path) -> None:
        self._rank = None if tests is None else {name: i for i, name in enumerate(tests)}
        self._log = log.open("a", buffering=1, encoding="utf-8")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Leave the chosen tests."""
        if self._rank is not None:
            rank = self._rank
            items[:] = [item for item in items if base_name(item.nodeid) in rank]
            items.sort(key=lambda item: rank[base_name(item.nodeid)])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Tell which test begins."""
        self._log.write(f"begin {nodeid}\n")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Tell which test failed."""
        if report.failed:
            self._log.write(f"failed {report.nodeid}\n")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Tell which file could not be read."""
        if report.failed:
            self._log.write(f"failed {report.nodeid}\n")


def base_name(nodeid: str) -> str:
    """Return the name of a test without its parameters."""
    return nodeid.partition("[")[0]


class Run:
    """One process of pytest in a copy.

    Attributes:
        failed: the first test that failed or hung, "" before.
        begun: how many tests have begun.
    """

    def __init__(
        self,
        copy: Copy,
        tests: Sequence[str],
        scratch: Path,
        seconds: Mapping[str, float],
        *,
        is_faulty: bool = True,
        options: Sequence[str] = (),
        around: Callable[..., int] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.failed, self.begun, self.status = "", 0, None
        self._seconds, self._log = seconds, scratch / "log"
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        self._log.touch()
        files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
        arguments = ["-q", "-p", "no:cacheprovider", "-n", "0", "--tb=short", "-rfE"]
        # Of libraries that are loaded already, pytest says that it cannot rewrite them.
        arguments += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        arguments += [*options, f"--basetemp={scratch / 'base'}", *files]
        surroundings = copy.environment(scratch, is_faulty) | dict(environment or {})
        sys.stdout.flush()
        self._pid = os.fork()
        if self._pid == 0:
            _as_child(copy, scratch, surroundings)
            plugin = Chosen(None if around else list(tests), self._log)

            def run(more: list[Any]) -> int:
                return int(pytest.main(arguments, plugins=[plugin, *more]))

            status = 3
            with suppress(BaseException):
                status = around(run) if around else run([])
            sys.stdout.flush()
            os._exit(status)
        self._since, self._count = self._time(), 0

    def is_over(self) -> bool:
        """Look whether it has ended, and end it where a test hangs."""
        lines = self._log.read_text(encoding="utf-8").splitlines()
        begun = [line.partition(" ")[2] for line in lines if line.startswith("begin ")]
        if len(begun) > self._count:
            self._count, self._since = len(begun), self._time()
            self.begun = len(set(map(base_name, begun)))
        now = begun[-1] if begun else ""
        limit = PATIENCE[0] + PATIENCE[1] * self._seconds.get(base_name(now), 1.0)
        pid, status = os.waitpid(self._pid, os.WNOHANG)
        if pid == 0 and self._time() - self._since < limit:
            return False
        with suppress(ProcessLookupError):
            os.killpg(self._pid, signal.SIGKILL)
        if pid == 0:
            os.waitpid(self._pid, 0)
            self.failed = f"{now or 'reading of tests'} (hangs)"
            return True
        self.status = os.waitstatus_to_exitcode(status)
        failed = [line.partition(" ")[2] for line in lines if line.startswith("failed ")]
        if self.status in FAILED or self.status < 0:
            self.failed = failed[0] if failed else f"{now or 'conftest'} (ended with {self.status})"
        return True

    def _time(self) -> float:
        """Seconds without those for which it was ready and other processes had the cores."""
        waited = 0.0
        with suppress(OSError):
            waited = 1e-9 * int(Path(f"/proc/{self._pid}/schedstat").read_text().split()[1])
        return time.monotonic() - waited

    def stop(self) -> None:
        """End it, with what it has left behind."""
        with suppress(ProcessLookupError, ChildProcessError):
            os.killpg(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)


def _as_child(copy: Copy, scratch: Path, surroundings: Mapping[str, str]) -> None:
    """Make a forked process that of a copy, in a group of its own."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    told = os.open(scratch / "told", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(told, 1)
    os.dup2(told, 2)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.environ.update(surroundings)
    os.chdir(copy.place)
    sys.path[:] = [str(copy.place), *(p for p in sys.path if not (Path(p) / "mutating").exists())]
    sys.argv = ["pytest"]
    # What multiprocessing would run again in workers.
    sys.modules["__main__"] = ModuleType("__main__")
