"""A study's folder: the trials that were run, and the files made of them.

The trials are all that is kept of a search. With their values it takes the same way again, so it
goes on from wherever it was killed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.errors import OutputError
from omnitrack_sim.optimise.spec import FOR_THE_RECORD, Study
from omnitrack_sim.sim.result import environment
from omnitrack_sim.sweep.folder import sweep_out, told, told_differences, write_whole
from omnitrack_sim.sweep.table import from_parquet, to_parquet
from omnitrack_sim.sweep.trials import Batch

if TYPE_CHECKING:
    import pyarrow as pa

STUDY_FILE, SUMMARY_FILE, BEST_FILE = "study.json", "summary.json", "best.toml"
PARTS, VALUES = "parts", "values"


class Folder:
    """The folder of one study.

    Raises:
        OutputError: it holds another study or other files, or cannot be written.
    """

    def __init__(self, directory: str | Path, study: Study):
        self.path = Path(directory)
        with told(self.path):
            self._open(study)

    def _open(self, study: Study) -> None:
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path}: is a file; choose a folder")
        ours = {"sha256": study.hash, "study": study.model_dump(mode="json")}
        there = self._there() if self.path.is_dir() else None
        if there is not None and there["sha256"] != ours["sha256"]:
            raise OutputError(
                f"{self.path}: holds a different study: "
                f"{told_differences(there['study'], ours['study'], FOR_THE_RECORD)}; choose "
                "another folder with --out, or remove this one to begin anew"
            )
        (self.path / PARTS).mkdir(parents=True, exist_ok=True)
        (self.path / VALUES).mkdir(exist_ok=True)
        for place in (self.path, self.path / PARTS, self.path / VALUES):
            sweep_out(place)
        if there is None or there["study"] != ours["study"]:
            made_by = environment() | {"cmaes": version("cmaes")}
            self.write_file(STUDY_FILE, json.dumps(ours | made_by, indent=2) + "\n")

    def _there(self) -> dict[str, Any] | None:
        """What ``study.json`` says; None in a folder that holds nothing yet, or trials only."""
        file = self.path / STUDY_FILE
        if not file.is_file():
            strange = [p.name for p in self.path.iterdir() if p.name not in (PARTS, VALUES)]
            strange = [name for name in strange if not name.startswith(".")]
            if strange:
                raise OutputError(
                    f"{self.path}: holds {strange[0]!r} but no {STUDY_FILE}, so it is no study; "
                    "choose another folder"
                )
            return None
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            return {"sha256": data["sha256"], "study": dict(data["study"])}
        except (ValueError, KeyError, TypeError) as error:
            raise OutputError(
                f"{file}: is no description of a study ({error}); choose another folder"
            ) from error

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where its file is missing or damaged."""
        import pyarrow as pa

        try:
            table = from_parquet(self._file(batch).read_bytes())
        except (OSError, pa.ArrowException):
            return None
        whole = (table.schema.metadata or {}).get(b"part") == batch.hash.encode()
        numbers = [trial.index for trial in batch.trials]
        return table if whole and table["trial"].to_pylist() == numbers else None

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        with told(self.path):
            write_whole(self._file(batch), to_parquet(table))

    def write_file(self, name: str, content: str | bytes) -> None:
        """Write a file of the folder, whole or not at all; nothing where it is there already."""
        data = content.encode() if isinstance(content, str) else content
        file = self.path / name
        with told(self.path):
            if not file.is_file() or file.read_bytes() != data:
                write_whole(file, data)

    def write_values(self, files: Mapping[str, str]) -> None:
        """Write the files of values, by name; others that were there go."""
        for name, content in files.items():
            self.write_file(f"{VALUES}/{name}", content)
        with told(self.path):
            for file in (self.path / VALUES).glob("*.toml"):
                if file.name not in files:
                    file.unlink()

    def _file(self, batch: Batch) -> Path:
        return self.path / PARTS / f"{batch.trials[0].index:09d}-{batch.hash}.parquet"


class Memory:
    """The trials of a study that is not written to a folder."""

    def __init__(self) -> None:
        self._tables: dict[str, pa.Table] = {}

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where it is not done."""
        return self._tables.get(batch.hash)

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        self._tables[batch.hash] = table
