"""Provenance of a result: seed, scenario, versions, platform, commit."""

from __future__ import annotations

import ctypes
import platform
import re
import subprocess
import warnings
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.text import clipped, printable
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


PACKAGES = ("omnitrack_sim", "mujoco", "numpy", "scipy", "numba")
"""Packages on whose versions the numbers of a run depend."""
OWN = ("omnitrack_sim",)
"""Those of them that say nothing of the machine."""


def unlike(makers: Iterable[Mapping[str, Any]]) -> str:
    """Return in what the machines and libraries differ that made results; "" where they do not.

    Args:
        makers: provenance of each, as of ``environment``; what one does not say is passed over.
    """
    known: dict[str, set[str]] = {}
    for maker in makers:
        versions = maker.get("versions")
        own = {k: v for k, v in (versions or {}).items() if k not in OWN}
        machine = {key: maker.get(key) for key in ("platform", "processor", "blas")}
        for key, value in {**machine, **own}.items():
            if value is not None:
                known.setdefault(key, set()).add(str(value))
    differ = [f"{key}: {' / '.join(sorted(v))}" for key, v in known.items() if len(v) > 1]
    return "; ".join(differ)


def warn_of_unlike(makers: Iterable[Mapping[str, Any]], what: str) -> None:
    """Warn where results of unlike machines are put together; ``what`` they are."""
    if differ := printable(unlike(makers)):
        warnings.warn(
            f"{what} were made by unlike machines or libraries, so equal runs may differ in their "
            f"last digits, and in what follows from them ({clipped(differ, 400)})",
            stacklevel=3,
        )


@cache
def environment() -> dict[str, Any]:
    """Versions, platform, processor, kernels of linear algebra and git commit of this process."""
    versions = {name: _version(name) for name in PACKAGES}
    return {
        "versions": versions | {"python": platform.python_version()},
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "blas": _blas(),
        "git_commit": _git_commit(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str | None:
    """Return the model of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            head = file.read(4096)  # of the first one: there may be hundreds
    except OSError:
        head = ""
    found = re.search(r"^model name\s*:\s*(.+)$", head, re.MULTILINE)
    return found[1].strip() if found else platform.processor() or None


def _blas() -> str | None:
    """Return NumPy's library of linear algebra, and the kernels that it runs on this processor."""
    config: Any = np.show_config(mode="dicts")
    about = config.get("Build Dependencies", {}).get("blas", {})
    words = [about.get("name"), about.get("version"), _kernel()]
    return " ".join(word for word in words if word) or None


def _kernel() -> str:
    """Return the name of the kernels that OpenBLAS has chosen; "" of another library."""
    for file in Path(np.__file__).parents[1].glob("numpy.libs/libscipy_openblas*"):
        try:
            core = ctypes.CDLL(str(file)).scipy_openblas_get_corename64_
        except (OSError, AttributeError):
            continue
        core.restype = ctypes.c_char_p
        return core().decode()
    return ""


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
