"""Provenance of a result: seed, scenario, versions, platform, commit."""

from __future__ import annotations

import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from omnitrack_sim.robots.driving import DriverTable
from omnitrack_sim.scenario import Scenario


def provenance_of(scenario: Scenario) -> dict[str, Any]:
    """Return the provenance of a result.

    That is seed, scenario hash, collider, versions, platform and git commit of a checkout; and who
    drove, where that was no controller.
    """
    made = {
        "seed": scenario.seed,
        "scenario_sha256": scenario.hash,
        "collider": scenario.physics.collider,
        **environment(),
    }
    table = scenario.control_parameters
    if not isinstance(table, DriverTable):
        return made
    return made | {"driven_by": table.driver, "orders": len(table.orders)}


@cache
def environment() -> dict[str, Any]:
    """Versions, platform and git commit of this process."""
    versions = {name: _version(name) for name in ("omnitrack_sim", "mujoco", "numpy")}
    return {
        "versions": versions | {"python": platform.python_version()},
        "platform": f"{platform.system()} {platform.machine()}",
        "git_commit": _git_commit(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_commit() -> str | None:
    """Return the commit of the checkout that the package runs from; None outside one.

    ``+changes`` stands behind it where files differ.
    """
    root = Path(__file__).parents[2]
    # An installed package may lie inside somebody's repository, whose commit is not ours.
    if not (root / ".git").exists():
        return None
    # Without tags, so that the full hash is given and not a distance from a release.
    describe = ["describe", "--always", "--abbrev=40", "--dirty=+changes", "--exclude=*"]
    command = ["git", "-C", str(root), *describe]
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=10
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
