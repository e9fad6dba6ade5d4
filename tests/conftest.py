"""What several test files compare with or look with."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import typer.main
import typer.testing
from pages import chromium
from sweep_samples import (
    small_sweep,
)

from omnitrack_sim import run_trials
from omnitrack_sim.robots.omnitrack.track import install_lines
from omnitrack_sim.walls.collider import install

# A process of a user's makes its commands once, that of the tests for each of hundreds of calls.
typer.main.get_command = typer.testing._get_command = cache(typer.main.get_command)

WITHOUT_WALLS = ["test_recognition", "test_exploring_random", "test_reach", "test_passport_laws"]
"""Files that put no robot into pipes and start no process."""
LONGEST = ["test_robot_claims", "test_physics", SITE := "test_site", *WITHOUT_WALLS]
"""Files that take longest, in the order in which they begin. Whole files go to the processes of
`make test`: a long one that began last would leave the others idle. While one process compiles the
walls, of a fresh checkout, the others run files that need none."""
LONGEST += [
    *("test_sweep_workers", "test_exploring_onboard", "test_viewer", "test_any_robot"),
    *("test_notebook", "test_plots", "test_recording", "test_collider", "test_render"),
    *("test_odometry", "test_published", "test_study_run", "test_mission_run", "test_presser"),
    *("test_docs", "test_exploring_run", "test_cli", "test_sweep_run", "test_fittings"),
    *("test_make_figures", "test_reproduce", "test_couplings", "test_onboard", "test_relief"),
    *("test_sway", "test_robots", "test_calibrate", "test_gym", "test_docstrings"),
    *("test_layers", "test_pictures"),
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first."""
    rank = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


def pytest_collection() -> None:
    """Look for no garbage while tests are collected: what is made then stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave out of garbage collection what importing and collecting have made: to go through these
    objects again and again takes a seventh of the tests' time."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000, 20, 20)


@pytest.fixture(scope="module", autouse=True)
def walls(request: pytest.FixtureRequest) -> None:
    """Exact walls are compiled before a test starts a process, which would tell of it."""
    if request.path.stem not in {SITE, *WITHOUT_WALLS}:
        install()
        install_lines()


@pytest.fixture(scope="session")
def calm(tmp_path_factory) -> Path:
    """The small sweep, run in one process without interruption."""
    place = tmp_path_factory.mktemp("sweeps") / "calm"
    run_trials(small_sweep(), out=place)
    return place


@pytest.fixture(scope="session")
def table(calm):
    return pq.read_table(calm / "trials.parquet")


@pytest.fixture(scope="module")
def browser() -> Iterator:
    """Chromium without a screen or graphics hardware."""
    with chromium() as browser:
        yield browser
