"""What several test files compare with or look with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from pages import chromium
from sweep_samples import (
    small_sweep,
)

from omnitrack_sim import run_sweep
from omnitrack_sim.robots.omnitrack.track import install_lines
from omnitrack_sim.walls.collider import install


@pytest.fixture(scope="session", autouse=True)
def walls() -> None:
    """Exact walls are compiled before a test starts a process, which would tell of it."""
    install()
    install_lines()


@pytest.fixture(scope="session")
def calm(tmp_path_factory) -> Path:
    """The small sweep, run in one process without interruption."""
    place = tmp_path_factory.mktemp("sweeps") / "calm"
    run_sweep(small_sweep(), out=place)
    return place


@pytest.fixture(scope="session")
def table(calm):
    return pq.read_table(calm / "trials.parquet")


@pytest.fixture(scope="module")
def browser() -> Iterator:
    """Chromium without a screen or graphics hardware."""
    with chromium() as browser:
        yield browser
