"""A study's folder: the trials that were run, and the files made of them.

The trials are all that is kept of a search. With their values it takes the same way again, so it
goes on from wherever it was killed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.writing import check_folder, is_workshop, told, write_file
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.show.plots.style import attempt
from omnitrack_sim.trials.batches import Batch, Row
from omnitrack_sim.trials.store import kept, read_part, result_fields, to_parquet, told_differences
from omnitrack_sim.trials.study import FOR_THE_RECORD, Study
from omnitrack_sim.trials.sweep import Sweep

if TYPE_CHECKING:
    import pyarrow as pa

STUDY_FILE, SUMMARY_FILE, BEST_FILE = "study.json", "summary.json", "best.toml"
HISTORY_FILE, HISTORY_CSV, FRONT_FILE = "history.parquet", "history.csv", "front.csv"
FINAL_FILE, FIGURE_FILE = "final.csv", "front.png"
FILES = (
    STUDY_FILE,
    HISTORY_FILE,
    HISTORY_CSV,
    FRONT_FILE,
    FINAL_FILE,
    BEST_FILE,
    SUMMARY_FILE,
    FIGURE_FILE,
)
PARTS, VALUES = "parts", "values"


class Layout:
    """The columns of the trials of a study."""

    def __init__(self, sweeps: Sequence[Sweep]):
        import pyarrow as pa

        bases = [base for sweep in sweeps for base in sweep.bases.values()]
        self.schema = pa.schema([pa.field("trial", pa.int64()), *result_fields(bases)])

    def table(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """The rows of a batch, with its hash and what made it in the metadata."""
        import pyarrow as pa

        rows = [row | {"model": batch.model} for row in rows]
        metadata = {"part": batch.hash, "made_by": json.dumps(made_by, sort_keys=True)}
        schema = self.schema.with_metadata(metadata)
        return pa.Table.from_pylist(rows, schema)


class Folder:
    """The folder of one study.

    Raises:
        OutputError: it holds another study or other files, or cannot be written.
    """

    def __init__(self, directory: str | Path, study: Study):
        self.path, self.schema = Path(directory), Layout(study.trials).schema
        check_folder(self.path, files=FILES)
        with told(self.path):
            self._open(study)

    def _open(self, study: Study) -> None:
        ours = {"sha256": study.hash, "study": study.model_dump(mode="json")}
        there = self._there() if self.path.is_dir() else None
        if there is not None and there["sha256"] != ours["sha256"]:
            raise OutputError(
                f"{self.path}: holds a different study: "
                f"{told_differences(there['study'], ours['study'], FOR_THE_RECORD)}; choose "
                "another folder with --out, or remove this one to begin anew"
            )
        for name in (PARTS, VALUES):
            (self.path / name).mkdir(parents=True, exist_ok=True)
            check_folder(self.path / name)
        if there is None or there["study"] != ours["study"]:
            made_by = environment() | {"cmaes": version("cmaes")}
            self.write_file(STUDY_FILE, json.dumps(ours | made_by, indent=2) + "\n")

    def _there(self) -> dict[str, Any] | None:
        """What ``study.json`` says; None in a folder that holds nothing yet, or trials only."""
        file = self.path / STUDY_FILE
        if not file.is_file():
            names = [path.name for path in self.path.iterdir()]
            strange = [n for n in names if n not in (PARTS, VALUES) and not is_workshop(n)]
            if strange:
                raise OutputError(
                    f"{self.path}: holds {strange[0]!r} but no {STUDY_FILE}, so it is no study; "
                    "choose another folder"
                )
            return None
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            return {"sha256": data["sha256"], "study": dict(data["study"])}
        except (ValueError, KeyError, TypeError, RecursionError, MemoryError) as error:
            raise OutputError(
                f"{file}: is no description of a study ({error}); choose another folder"
            ) from error

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where its file is missing or damaged."""
        return read_part(self._file(batch), batch, self.schema)

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        with kept(self.path):
            write_file(self._file(batch), to_parquet(table))

    def write_file(self, name: str, content: str | bytes) -> None:
        """Write a file of the folder, whole or not at all; nothing where it is there already."""
        data = content.encode() if isinstance(content, str) else content
        file = self.path / name
        with kept(self.path):
            if not file.is_file() or file.read_bytes() != data:
                write_file(file, data)

    def write_figure(self, draw: Callable[[], bytes]) -> None:
        """Write the figure. One that cannot be drawn is told as a warning, an earlier one goes, and
        the same command tries again."""
        figure = attempt(FIGURE_FILE, draw)
        if figure is not None:
            self.write_file(FIGURE_FILE, figure)
        else:
            self.remove(FIGURE_FILE)

    def remove(self, name: str) -> None:
        """Take a file away that an earlier run has left and this one does not make."""
        with told(self.path):
            (self.path / name).unlink(missing_ok=True)

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
