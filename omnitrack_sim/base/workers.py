"""Where batches run besides processes of this machine (``pool``): on a Dask cluster."""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from omnitrack_sim.base.errors import Fault, InputError, OmnitrackError

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
            problem = "needs the package distributed: pip install 'omnitrack_sim[dask]'"
            raise InputError(Fault("--dask", problem)) from None
        try:
            self._client = Client(address, timeout=DASK_PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            problem = (
                f"no scheduler answers at {address!r} ({error}); start one with `dask scheduler`"
            )
            raise InputError(Fault("--dask", problem)) from None
        self._executor = self._client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """As ``Executor.submit``."""
        return self._executor.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the pool; without ``wait`` batches under way are given up."""
        self._executor.shutdown(wait)
        self._client.close()


def killed_its_worker(error: BaseException) -> bool:
    """Whether Dask gave up a batch because the workers that ran it died."""
    if "distributed" not in sys.modules:
        return False
    from distributed import KilledWorker

    return isinstance(error, KilledWorker)
