"""A run as a file of other tools: MCAP for Foxglove and Rerun, CSV for spreadsheets and scripts."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import installing
from omnitrack_sim.base.writing import check_file, format_of, write_file
from omnitrack_sim.results.dataset import to_csv
from omnitrack_sim.results.result import Result, as_result

EXPORTS = ("mcap", "csv")
"""Formats, by the endings of their files."""


def check_export(format: str) -> None:
    """Refuse a format, before any work, that there is not or that needs what is not installed.

    Raises:
        InputError: it is so.
    """
    if format not in EXPORTS:
        raise InputError(Fault("export", f"is {format!r}", EXPORTS, given=format))
    if format == "mcap" and None in map(find_spec, ("mcap", "foxglove_schemas_protobuf")):
        problem = f"needs the extra mcap: {installing('mcap')}"
        raise InputError(Fault("export", problem))


def export_result(
    result: Result | str | os.PathLike[str], path: str | Path, *, trust: bool = False
) -> Path:
    """Export a run as a file for other tools, by its ending.

    ``.mcap`` has poses of all bodies, joints, contacts, channels, events, shapes of robot and
    pipes, for Foxglove and Rerun; it needs the extra ``mcap``. ``.csv`` has a row a sample: time,
    channels, and joint positions, with units in the header.

    Args:
        result: the run, or the folder of a saved one.
        path: file to write.
        trust: of a folder, see ``load_result``; without it, a robot from outside the package has
            no contacts in MCAP.

    Returns:
        The path.

    Raises:
        InputError: another ending, or the extra is not installed.
        OutputError: the folder is no run, or the file cannot be written.

    Example:
        >>> result = ot.run("straight", no_load=False)
        >>> table = ot.export_result(result, "straight.csv")
        >>> table.read_text().partition(",")[0]
        'time [s]'
    """
    format = format_of(path, None, "export", EXPORTS)
    check_export(format)
    check_file(path)
    run = as_result(result, trust)
    if format == "csv":
        data = to_csv(run)
    else:
        from omnitrack_sim.show.mcap import to_mcap

        data = to_mcap(run)
    write_file(path, data)
    return Path(path)
