"""Tables that spreadsheets open: no name of a stranger's file is a formula in them."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable, Iterator

import pyarrow as pa
import pytest
from samples import sample_result

import omnitrack_sim as ot
from omnitrack_sim.base.text import csv_text
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.scenario import validate
from omnitrack_sim.trials.table import to_csv
from omnitrack_sim.walls.export import centreline_table

EVIL = ("=1+1", "+cmd|'C'!A0", "-2+3", "@SUM(A1)", "\t=1", "=HYPERLINK('x')", "-", "+")
NUMBERS = (1.5, -2.25, 3, -4, None, "-1.5", "+2e-3", "-.5")


def cells(text: str) -> Iterator[str]:
    for row in csv.reader(io.StringIO(text)):
        yield from row


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def named_run(name: str) -> ot.Result:
    """A run through a pipe of a name, with a phase of it."""
    pipe = {"kind": "straight", "length": 1.0, "name": name}
    scenario = validate({"pipes": [pipe]})
    return sample_result(scenario=scenario, provenance=provenance_of(scenario))


def timeline(tmp_path, name: str) -> str:
    return (named_run(name).save(tmp_path / "run") / "timeline.csv").read_text()


def samples(tmp_path, name: str) -> str:
    run = named_run(name)
    phases = (name, *run.trajectory.phases[1:])
    run = dataclasses.replace(run, trajectory=dataclasses.replace(run.trajectory, phases=phases))
    return ot.export_result(run, tmp_path / "run.csv").read_text()


def centrelines(_, name: str) -> str:
    fitting = {"kind": "straight", "length": 0.5, "name": name.replace("\t", "").replace(" ", "")}
    return centreline_table(Network(fittings=[fitting]).pipes)


WRITERS: dict[str, Callable[..., str]] = {
    "rows": lambda _, name: csv_text([[name, 1.0], [None, name]]),
    "timeline": timeline,
    "samples": samples,
    "centrelines": centrelines,
    "trials": lambda _, name: to_csv(pa.table({name: [1.0], "entry": [name]})).decode(),
}
"""What writes CSV, of a thing of a name."""


@pytest.mark.parametrize("name", EVIL)
@pytest.mark.parametrize("writer", WRITERS)
def test_no_text_begins_as_a_formula_does(writer, name, tmp_path):
    """Of all writers, whatever the name."""
    for cell in cells(WRITERS[writer](tmp_path, name)):
        assert not cell.startswith(("=", "+", "-", "@", "\t", "\r")) or is_number(cell)


def test_numbers_and_plain_texts_stay_as_they_are():
    """Also those that are texts: a sweep's mixed columns have them."""
    rows = [list(NUMBERS), ["a", "b=1", "x-y", "'quoted", "", "1", "2", "3"]]
    read = list(csv.reader(io.StringIO(csv_text(rows))))
    assert read == [["" if cell is None else str(cell) for cell in row] for row in rows]
    texts = [str(cell) for cell in NUMBERS if cell is not None]
    table = pa.table({"value": texts, "number": [float(text) for text in texts]})
    read = list(csv.DictReader(io.StringIO(to_csv(table).decode())))
    assert [row["value"] for row in read] == texts
    assert [float(row["number"]) for row in read] == [float(text) for text in texts]
