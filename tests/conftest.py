"""What several test files of sweeps compare with."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from sweep_samples import (
    small_sweep,
)

from omnitrack_sim import run_sweep


@pytest.fixture(scope="session")
def calm(tmp_path_factory) -> Path:
    """The small sweep, run in one process without interruption."""
    place = tmp_path_factory.mktemp("sweeps") / "calm"
    run_sweep(small_sweep(), place)
    return place


@pytest.fixture(scope="session")
def table(calm):
    return pq.read_table(calm / "trials.parquet")
