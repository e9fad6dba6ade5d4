"""Stores of the rows of batches: in memory, or in the folder that a plan leaves.

A part file holds the rows of one batch under the hash of its contents, and is all that a run is
resumed from. Several processes may work in one folder.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa

from omnitrack_sim.base.bounds import MAX_RUN_BYTES
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.reading import parsed, read_bytes
from omnitrack_sim.base.text import clipped
from omnitrack_sim.base.writing import as_output_error, check_folder, is_workshop, write_file
from omnitrack_sim.results.comparison import differing
from omnitrack_sim.results.files import read_table
from omnitrack_sim.results.html import LONGEST
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.show.plots.style import attempt
from omnitrack_sim.trials.batches import Batch, Rows
from omnitrack_sim.trials.plan import Conclusion, Plan
from omnitrack_sim.trials.table import is_part, made_by, part_table, to_csv, to_json, to_parquet

PARTS, TRIALS, SUMMARY = "parts", "trials", "summary.json"
_MAX_DIFFERENCES = 5
"""Largest number of differences of two records in a message."""


class Store:
    """Rows of batches, kept as long as the process lives; a ``Folder`` keeps them for good.

    Attributes:
        path: of the folder; None in memory.
    """

    path: Path | None = None

    def __init__(self) -> None:
        self._parts: dict[str, pa.Table] = {}

    def read(self, batch: Batch) -> pa.Table | None:
        """Return the rows of a batch; None where it is not done."""
        return self._parts.get(batch.hash)

    def write(self, batch: Batch, results: Rows) -> pa.Table:
        """Keep the rows of a batch and return them as a table."""
        return self._parts.setdefault(batch.hash, part_table(batch, results))

    def put_tables(self, tables: Mapping[str, pa.Table]) -> None:
        """Keep tables of a plan that is on its way, by name."""

    def finish(self, conclusion: Conclusion, tables: Mapping[str, pa.Table]) -> None:
        """Keep what a plan has come to, with all its tables by name."""


class Folder(Store):
    """The folder of one plan.

    Args:
        path: of the folder; it is made where it is missing.
        plan: whose trials it holds.

    Raises:
        OutputError: it holds another plan, or other files, or cannot be written.
    """

    def __init__(self, path: str | Path, plan: Plan):
        super().__init__()
        self.path = self._place = Path(path)
        self.plan = plan
        self.record = record_name(type(plan))
        tables = (f"{name}{end}" for name in (TRIALS, *plan.names) for end in (".parquet", ".csv"))
        figures = [plan.figure] if plan.figure else []
        self.files = (self.record, *tables, SUMMARY, *plan.files, *figures)
        self._folders = (PARTS, *filter(None, [plan.folder]))
        check_folder(self._place, files=self.files)
        with as_output_error(self._place):
            self._open(plan.data())

    def _open(self, data: dict[str, Any]) -> None:
        """Make the folder, or check that it holds this plan."""
        noun, sha256 = self.plan.noun, self.plan.hash
        there = self._recorded() if self._place.is_dir() else None
        if there is not None and there["sha256"] != sha256:
            raise OutputError(
                f"{self._place}: holds a different {noun}: "
                f"{_differences(there[noun], data, self.plan.free)}; choose another folder "
                "with --out, or remove this one to begin anew"
            )
        for name in self._folders:
            (self._place / name).mkdir(parents=True, exist_ok=True)
            check_folder(self._place / name)
        versions = {name: version(name) for name in self.plan.packages}
        record = {"sha256": sha256, noun: data} | self.plan.kept()
        self._new_record = to_json(record | environment() | versions)
        # As it is read again, with lists for tuples.
        self._is_renamed = there is not None and there[noun] != json.loads(self._new_record)[noun]
        # The record of an earlier run stays until all is finished: names may have changed.
        if there is None:
            write_file(self._place / self.record, self._new_record)

    def _recorded(self) -> dict[str, Any] | None:
        """Contents of the record; None in a folder that holds nothing yet, or parts only."""
        noun = self.plan.noun
        if not (self._place / self.record).is_file():
            names = [path.name for path in self._place.iterdir()]
            # A process may have been killed after it made the folders and before it wrote the
            # record.
            strange = [n for n in names if n not in self._folders and not is_workshop(n)]
            if strange:
                raise OutputError(
                    f"{self._place}: holds {strange[0]!r} but no {self.record}, so it is no "
                    f"{noun}; choose another folder"
                )
            return None
        try:
            return read_record(self._place, noun)
        except OutputError as error:
            raise OutputError(f"{error}; choose another folder") from error

    def read(self, batch: Batch) -> pa.Table | None:
        """Return the rows of a batch; None where its file is missing, damaged, or of others."""
        return read_part(self._place, batch)

    def write(self, batch: Batch, results: Rows) -> pa.Table:
        """Keep the rows of a batch and return them as a table."""
        table = part_table(batch, results)
        with self._keeping():
            write_file(_part_of(self._place, batch), to_parquet(table))
        return table

    def put_tables(self, tables: Mapping[str, pa.Table]) -> None:
        """Write tables of a plan that is on its way, by name."""
        for name, data in _table_files(tables).items():
            self._put(name, data)

    def finish(self, conclusion: Conclusion, tables: Mapping[str, pa.Table]) -> None:
        """Write what a plan has come to, and then its figure.

        Nothing is written where all is there already. A figure that cannot be drawn is a warning,
        and the same call tries again.
        """
        # Files of an earlier run of this plan that it makes no more are to go.
        files: dict[str, bytes | None] = dict.fromkeys(self._made_before())
        files |= conclusion.files
        files |= _table_files(tables) | {SUMMARY: to_json(conclusion.summary)}
        # The table of all trials comes last: users take it for the end.
        files |= {name: files.pop(name) for name in (f"{TRIALS}.csv", f"{TRIALS}.parquet")}
        figure, draw = self.plan.figure, conclusion.draw
        is_drawn = draw is None or (self._place / figure).is_file()
        as_asked = all(self._holds(name, data) for name, data in files.items())
        if as_asked and is_drawn and not self._is_renamed:
            return
        # The figure goes first: as long as it is missing, the same command does all of this again.
        if figure:
            self._put(figure, None)
        for name, data in files.items():
            self._put(name, data)
        if self._is_renamed:
            self._put(self.record, self._new_record)
        picture = None if draw is None else attempt(figure, draw)
        if picture is not None:
            self._put(figure, picture)

    def _made_before(self) -> Iterator[str]:
        """Names of the files that a finished plan may have left."""
        yield from (name for name in self.files if name not in (self.record, self.plan.figure))
        if self.plan.folder:
            for path in (self._place / self.plan.folder).iterdir():
                if not is_workshop(path.name):
                    yield f"{self.plan.folder}/{path.name}"

    def _put(self, name: str, data: bytes | None) -> None:
        """Write a file, whole or not at all, or remove it; nothing where it is as asked for."""
        with self._keeping():
            if data is None:
                (self._place / name).unlink(missing_ok=True)
            elif not self._holds(name, data):
                write_file(self._place / name, data)

    def _holds(self, name: str, data: bytes | None) -> bool:
        file = self._place / name
        try:
            return file.read_bytes() == data if file.is_file() else data is None
        except OSError:  # what cannot be read is written anew
            return False

    @contextlib.contextmanager
    def _keeping(self) -> Iterator[None]:
        """Add to an error of writing that the same command continues the work."""
        try:
            with as_output_error(self._place):
                yield
        except OutputError as error:
            raise OutputError(
                f"{error}; the finished batches are kept, and the same command goes on from there"
            ) from error


def read_record(folder: Path, noun: str) -> dict[str, Any]:
    """Return the record of a plan in a folder: ``sha256``, its data under ``noun``, and more.

    Raises:
        OutputError: it cannot be read, or is none.
    """
    file = folder / f"{noun}.json"
    try:
        data = parsed(read_bytes(file, MAX_RUN_BYTES).decode(), "JSON")
        return {**data, "sha256": data["sha256"], noun: dict(data[noun])}
    except OSError as error:
        raise OutputError(f"{file}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, RecursionError, MemoryError) as error:
        raise OutputError(f"{file}: is no description of a {noun} ({error})") from error


def read_part(folder: Path, batch: Batch) -> pa.Table | None:
    """Return the rows of a batch in a folder; None where they are missing, damaged or of others."""
    try:
        table = read_table(_part_of(folder, batch), len(batch.trials))
        made_by(table)
        is_part_table = is_part(table)  # names are decoded only now; a wrong byte may be in one
    except Exception:  # decoders raise anything on damaged bytes; the batch is run again
        return None
    # A file of the right name may be copied from another one.
    is_whole = table.schema.metadata.get(b"part") == batch.hash.encode()
    is_whole = is_whole and is_part_table and table.num_rows == len(batch.trials)
    return table if is_whole else None


def _part_of(folder: Path, batch: Batch) -> Path:
    return folder / PARTS / f"{batch.hash}.parquet"


def record_name(plan: type[Plan]) -> str:
    """Return the name of the file that describes a plan in its folder."""
    return f"{plan.noun}.json"


def _table_files(tables: Mapping[str, pa.Table]) -> dict[str, bytes | None]:
    files: dict[str, bytes | None] = {}
    for name, table in tables.items():
        files |= {f"{name}.csv": to_csv(table), f"{name}.parquet": to_parquet(table)}
    return files


def _differences(there: Any, ours: Any, free: Sequence[str]) -> str:
    """Text of the differences of two tables of plain data, apart from their keys of ``free``."""
    first, second = ({k: v for k, v in table.items() if k not in free} for table in (there, ours))
    lines = [
        f"{path} is {_shown(before)} there and {_shown(now)} here"
        for path, before, now in differing(first, second)
    ]
    rest = len(lines) - _MAX_DIFFERENCES
    text = ", ".join(lines[:_MAX_DIFFERENCES]) or "it was made by another version of the program"
    return f"{text} and {rest} more" if rest > 0 else text


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("path") or value.get("name") or "a table")
    return "missing" if value is None else clipped(json.dumps(value), LONGEST)
