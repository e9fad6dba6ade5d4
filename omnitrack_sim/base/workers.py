"""Worker processes of this machine or of a Dask cluster."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from omnitrack_sim.base.errors import Fault, InputError, OmnitrackError
from omnitrack_sim.base.text import installing

_PR_SET_PDEATHSIG = 1


def cores() -> int:
    """Return the number of cores that this process may use, which may be fewer than there are."""
    if hasattr(os, "sched_getaffinity"):  # of Linux alone
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class LocalPool(ProcessPoolExecutor):
    """Worker processes that die with this one.

    They are killed at once if the pool is shut down without waiting.
    """

    def __init__(self, workers: int):
        # Processes that were there before belong to somebody else: `shutdown` must not kill them.
        self._others = set(multiprocessing.active_children())
        super().__init__(
            workers,
            # A forked child would inherit locks of MuJoCo's and numba's threads in any state.
            multiprocessing.get_context("spawn"),
            initializer=begin_worker,
            initargs=(os.getpid(),),
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without ``wait`` the workers are killed."""
        if not wait:
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
        # The thread that serves dead workers ends at once. Python waits for it on its way out too,
        # but wakes it there by a pipe that the thread may be closing, which ends in a traceback.
        super().shutdown(wait=True, cancel_futures=cancel_futures)


def begin_worker(parent: int) -> None:
    """Bind a worker's life to its parent's, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent had died before prctl was called
        os._exit(1)
    name_glfw_library()


def name_glfw_library() -> None:
    """Tell the package glfw which library to load, where nobody has.

    MuJoCo imports glfw, which else starts another Python to ask each library for its version: 70 ms
    of every start, and a traceback from that Python if a worker is killed meanwhile.
    """
    package = find_spec("glfw")
    if sys.platform != "linux" or package is None or package.origin is None:
        return
    # As glfw itself chooses.
    variant = os.environ.get("PYGLFW_LIBRARY_VARIANT", os.environ.get("XDG_SESSION_TYPE", ""))
    folder = "wayland" if variant.lower() == "wayland" else "x11"
    library = Path(package.origin).parent / folder / "libglfw.so"
    if library.is_file():
        os.environ.setdefault("PYGLFW_LIBRARY", str(library))


DASK_PATIENCE = 8
"""Seconds to wait for an answer of a Dask scheduler."""


class WorkersLost(OmnitrackError):
    """The workers are gone and cannot be replaced."""


class DaskPool(Executor):
    """The workers of a Dask cluster. Shutting it down closes its client."""

    def __init__(self, address: str):
        try:
            from distributed import Client
        except ImportError:
            problem = f"needs the package distributed: {installing('dask')}"
            raise InputError(Fault("--dask", problem)) from None
        try:
            self._client = Client(address, timeout=DASK_PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            problem = (
                f"no scheduler answers at {address!r} ({error}); start one with `dask scheduler`"
            )
            raise InputError(Fault("--dask", problem)) from None
        # Dask merges pure calls with equal arguments into one; a batch that is tried again must
        # run.
        self._executor = self._client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """As ``Executor.submit``."""
        return self._executor.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:  # noqa: ARG002 - Executor's
        """End the pool; without ``wait`` batches under way are given up."""
        self._executor.shutdown(wait)
        self._client.close()


def killed_its_worker(error: BaseException) -> bool:
    """Return whether Dask gave up a batch because the workers that ran it died."""
    # Where Dask was never imported no error can be Dask's, and the import would cost time.
    if "distributed" not in sys.modules:
        return False
    from distributed import KilledWorker

    return isinstance(error, KilledWorker)
