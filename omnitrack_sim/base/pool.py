"""Worker processes of this machine."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from concurrent.futures import ProcessPoolExecutor

_PR_SET_PDEATHSIG = 1


class LocalPool(ProcessPoolExecutor):
    """Worker processes that die with this one.

    They are killed at once if the pool is shut down without waiting.
    """

    def __init__(self, workers: int):
        self._others = set(multiprocessing.active_children())
        super().__init__(
            workers,
            multiprocessing.get_context("spawn"),
            initializer=begin_worker,
            initargs=(os.getpid(),),
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without ``wait`` the workers are killed."""
        if not wait:
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
        super().shutdown(wait, cancel_futures=cancel_futures)


def begin_worker(parent: int) -> None:
    """Bind a worker's life to its parent's, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent had died before prctl was called
        os._exit(1)
