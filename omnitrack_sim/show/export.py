"""A run as a file of other tools: MCAP for Foxglove and Rerun, CSV for spreadsheets and scripts."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import installing
from omnitrack_sim.base.writing import check_file, format_of, write_file
from omnitrack_sim.results.dataset import joint_series, series_of, to_csv
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.sources import is_recording

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
    result: Result | Recording | str | os.PathLike[str], path: str | Path, *, trust: bool = False
) -> Path:
    """Export a run or a recording as a file for other tools, by its ending.

    ``.mcap`` has poses of all bodies, joints, contacts, channels, events, shapes of robot and
    pipes, for Foxglove and Rerun; it needs the extra ``mcap``. ``.csv`` has a row a sample: time,
    channels, and joint positions, with units in the header. The channels of a recording are the
    columns of its ``to_pandas``.

    Args:
        result: the run, or the folder of a saved one; a recording of any model, or its file.
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
    source = _read(result, trust)
    if format == "csv":
        data = _csv_of(source)
    else:
        from omnitrack_sim.show.mcap import to_mcap

        data = to_mcap(source)
    write_file(path, data)
    return Path(path)


def _read(source: Result | Recording | str | os.PathLike[str], trust: bool) -> Result | Recording:
    if is_recording(source):
        return Recording.load(source, trust=trust)  # type: ignore[arg-type]
    return source if isinstance(source, Recording) else as_result(source, trust)


def _csv_of(source: Result | Recording) -> bytes:
    from omnitrack_sim.show.recording_tables import recorded_series

    if isinstance(source, Recording):
        return to_csv(source.time, recorded_series(source))
    return to_csv(source.trajectory.time, [*series_of(source), joint_series(source)])
