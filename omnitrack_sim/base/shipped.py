"""Where the files are that come with the package. It is light: completions of a shell ask it."""

from __future__ import annotations

from pathlib import Path

from omnitrack_sim.base.naming import ByName


def _scenario_folder() -> Path:
    """Where the shipped scenarios are: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "_scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


def shipped_scenarios() -> ByName[Path]:
    """Scenarios that come with the package, by name.

    The name is the file's path below ``scenarios/`` without its ending.
    """
    folder = _scenario_folder()
    groups = ("*.toml", "paper/*.toml", "missions/*.toml")
    files = [path for group in groups for path in sorted(folder.glob(group))]
    return ByName((path.relative_to(folder).with_suffix("").as_posix(), path) for path in files)


def shipped_sweeps() -> ByName[Path]:
    """Sweep files that come with the package, by name."""
    files = sorted((_scenario_folder() / "sweeps").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_studies() -> ByName[Path]:
    """Study files that come with the package, by name."""
    files = sorted((_scenario_folder() / "studies").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_networks() -> ByName[Path]:
    """Network files that come with the package, by name."""
    files = sorted((_scenario_folder() / "networks").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_policies() -> ByName[Path]:
    """Policy files that come with the package, by name."""
    files = sorted((_scenario_folder() / "policies").glob("*.npz"))
    return ByName((path.stem, path) for path in files)
