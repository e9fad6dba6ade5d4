"""A sweep's folder: damaged files are told or made anew, and a figure that fails costs no trial."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sweep_samples import small_sweep

from omnitrack_sim import OutputError, run_trials
from omnitrack_sim.show.plots.style import PictureWarning
from omnitrack_sim.trials import dispatch, sweep_figure

FILES = ("trials.parquet", "trials.csv", "summary.json", "success_map.png", "sweep.json")


def tiny_sweep():
    return small_sweep(samples=2)


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("sweeps") / "done"
    run_trials(tiny_sweep(), out=place)
    return place


@pytest.fixture
def place(done, tmp_path, monkeypatch) -> Path:
    """A copy to be damaged; its figure, which takes a second, is not drawn again."""
    figure = (done / "success_map.png").read_bytes()
    monkeypatch.setattr(sweep_figure, "draw_map", lambda *_: figure)
    return Path(shutil.copytree(done, tmp_path / "sweep"))


@pytest.mark.parametrize("text", ["", "[]", "[" * 100_000, '{"made_by": 3}', "9" * 9000])
def test_a_damaged_summary_is_made_anew(place, done, text):
    """From the batches, without running one."""
    (place / "summary.json").write_text(text)
    run_trials(tiny_sweep(), out=place)
    assert contents(place) == contents(done)


def test_a_summary_that_tells_something_else_is_made_anew(place, done):
    """A number or a key of it is another one."""
    data = json.loads((place / "summary.json").read_text())
    for wrong in (data | {"successes": 99}, {**data, "grouqs": data["groups"]}):
        (place / "summary.json").write_text(json.dumps(wrong))
        run_trials(tiny_sweep(), out=place)
        assert contents(place) == contents(done)


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, "9" * 9000, '{"sha256": 1}'])
def test_a_damaged_description_is_named(place, text):
    """It cannot be known whose batches these are."""
    (place / "sweep.json").write_text(text)
    with pytest.raises(OutputError, match=r"sweep\.json"):
        run_trials(tiny_sweep(), out=place)


def test_damaged_tables_are_made_anew(place, done, monkeypatch):
    """Wherever a few bytes of the table are other ones, it is made from the batches again."""
    draw, data = random.Random(1), (place / "trials.parquet").read_bytes()
    monkeypatch.setattr(dispatch, "run_rows", None)
    for size in (0, 10, len(data) // 2, len(data) - 1):
        (place / "trials.parquet").write_bytes(data[:size])
        run_trials(tiny_sweep(), out=place)
        assert contents(place) == contents(done), size
    for _ in range(20):
        damaged = bytearray(data)
        damaged[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        (place / "trials.parquet").write_bytes(bytes(damaged))
        assert run_trials(tiny_sweep(), out=place).table.num_rows == 4


def test_damaged_batches_are_run_again(place, done):
    """Of bytes that are other ones in the words of a batch about itself, too."""
    part = next((place / "parts").glob("*.parquet"))
    data = part.read_bytes()
    for word in (b"made_by", b"part"):
        (place / "trials.parquet").unlink(missing_ok=True)
        part.write_bytes(data.replace(word, word[:-1] + b"?"))
        run_trials(tiny_sweep(), out=place)
        assert contents(place) == contents(done)


@pytest.mark.parametrize("name", ["outcome", "duration_s", "success"])
def test_batches_with_other_columns_are_run_again(place, done, name):
    """A column that is missing, or holds texts for numbers or numbers for texts."""
    part = next((place / "parts").glob("*.parquet"))
    table = pq.read_table(part)
    at, odd = table.column_names.index(name), pa.array([[1.0]] * len(table))
    for other in (table.set_column(at, name, odd), table.drop_columns([name])):
        (place / "trials.parquet").unlink(missing_ok=True)
        pq.write_table(other, part)
        run_trials(tiny_sweep(), out=place)
        assert contents(place) == contents(done)


def test_a_table_that_cannot_be_read_is_named(place):
    """What stands in its place opens, fails to be read, and cannot be written."""
    (place / "trials.csv").unlink()
    (place / "trials.csv").symlink_to("/proc/self/mem")
    with pytest.raises(OutputError, match=r"trials\.csv: cannot be written"):
        run_trials(tiny_sweep(), out=place)


def test_a_figure_that_fails_costs_no_trial(tmp_path, done, monkeypatch):
    """All other files are there; the same command tries the figure again."""

    def fails(*_):
        raise ValueError("no such colour")

    draw_map = sweep_figure.draw_map
    monkeypatch.setattr(sweep_figure, "draw_map", fails)
    with pytest.warns(PictureWarning, match=r"no success_map\.png: no such colour"):
        table = run_trials(tiny_sweep(), out=tmp_path / "sweep").table
    assert table.num_rows == 4
    names = {path.name for path in (tmp_path / "sweep").iterdir()}
    assert names == {*FILES, "parts"} - {"success_map.png"}
    monkeypatch.setattr(sweep_figure, "draw_map", draw_map)
    run_trials(tiny_sweep(), out=tmp_path / "sweep")
    assert contents(tmp_path / "sweep") == contents(done)
