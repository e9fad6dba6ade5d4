"""Pictures of onboard cameras on a page: which of them, where, and in which colours."""

from __future__ import annotations

import base64
import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from omnitrack_sim.show.film.overlay import levels, palette
from omnitrack_sim.show.replay.contents import (
    MAX_PICTURES,
    PICTURE_PERIOD,
    TILE,
    TILES_ACROSS,
    pictures_table,
)


class Album(list):
    """Pictures of both ends in turn, each with its time."""

    def __init__(self, count: int, size: int, unit: str, period: float) -> None:
        rng = np.random.default_rng(3)
        super().__init__(rng.uniform(0.02, 1.0, (2 * count, size, size)))
        self.time = np.repeat(np.arange(count) * period, 2)
        self.end = np.tile([1, -1], count).astype(np.int8)
        self.size, self.unit = size, unit


def shown(album: Album | None, turns_at: float = np.inf) -> SimpleNamespace:
    """A run with these pictures, that drives tail first from a moment on."""
    time = np.linspace(0.0, 1.0 if album is None else float(album.time[-1]), 400)
    return SimpleNamespace(album=album, time=time, backward=time > turns_at)


def tiles(table: dict) -> list[np.ndarray]:
    """The tiles of a table, as indices of its palette."""
    image = Image.open(io.BytesIO(base64.b64decode(table["png"])))
    assert image.mode == "P"
    sheet, side = np.array(image), table["side"]
    across = sheet.shape[1] // side
    assert across <= table["columns"] == TILES_ACROSS
    places = [divmod(number, across) for number in range(len(table["time"]))]
    return [sheet[r * side : (r + 1) * side, c * side : (c + 1) * side] for r, c in places]


@pytest.mark.parametrize(("size", "unit"), [(32, "1"), (32, "m"), (96, "m")])
def test_pictures_ahead_are_shown_once_a_period(size, unit):
    """Those of the leading end, the first of each half second, pixel by pixel or each second one;
    in the colours of films."""
    album = Album(60, size, unit, 0.1)
    table = pictures_table(shown(album, turns_at=3.01))
    times = np.arange(0.0, 6.0, PICTURE_PERIOD)
    assert table["time"] == pytest.approx(times)
    assert table["side"] == min(size, TILE)
    for time, tile in zip(times, tiles(table), strict=True):
        end = -1 if time > 3.01 else 1
        (number,) = np.flatnonzero(np.isclose(album.time, time) & (album.end == end))
        step = size // table["side"]
        wanted = levels(album[number], unit)
        assert any((tile == wanted[i::step, i::step]).all() for i in range(step))
    image = Image.open(io.BytesIO(base64.b64decode(table["png"])))
    colours = np.array(image.getpalette()).reshape(-1, 3)
    assert (colours == palette(unit)[: len(colours)]).all()


def test_a_long_run_has_no_more_pictures_than_a_page_takes():
    """They are then farther apart, evenly from the first to the last."""
    album = Album(900, 4, "1", 0.5)
    table = pictures_table(shown(album))
    assert len(table["time"]) <= MAX_PICTURES
    assert len(table["time"]) > 0.6 * MAX_PICTURES
    gaps = np.diff(table["time"])
    assert gaps.min() > 0.5 - 1e-9
    assert gaps.max() < 1.01 + 1e-9
    assert len(tiles(table)) == len(table["time"])


def test_a_run_without_pictures_has_no_table():
    """Nor one whose cameras never looked ahead."""
    assert pictures_table(shown(None)) is None
    behind = Album(5, 4, "1", 0.5)
    behind.end[:] = -1
    assert pictures_table(shown(behind)) is None
