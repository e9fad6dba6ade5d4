"""What the robot saw ahead, as one picture of many tiles for the page."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.show.film.seen import levels, palette

EVERY = 0.5
"""Time between two pictures of a page, s."""
MOST = 600
"""Pictures of a page, which of a long run are farther apart."""
SIDE = 48
"""Pixels of a tile's side at most."""
COLUMNS = 25
"""Tiles beside each other."""


def seen_table(pictures: Pictures | None, trajectory: Trajectory) -> dict[str, Any] | None:
    """The pictures from the end that leads: a PNG of tiles row by row, from the first one on; and
    from which time on, s, each is the last one. None where there are none."""
    chosen = [] if pictures is None else _chosen(pictures, trajectory)
    if pictures is None or not chosen:
        return None
    side, rows = min(SIDE, pictures.size), -(-len(chosen) // COLUMNS)
    sheet = np.zeros((rows * side, min(COLUMNS, len(chosen)) * side), np.uint8)
    for number, index in enumerate(chosen):
        top, left = side * (number // COLUMNS), side * (number % COLUMNS)
        tile = levels(pictures[index][_thinned(pictures.size, side)], pictures.unit)
        sheet[top : top + side, left : left + side] = tile
    return {
        "png": _png(sheet, palette(pictures.unit)),
        "side": side,
        "columns": COLUMNS,
        "time": [round(float(pictures.time[index]), 6) for index in chosen],
    }


def _chosen(pictures: Pictures, trajectory: Trajectory) -> list[int]:
    """Pictures ahead, the first ones of each half second."""
    rows = np.clip(np.searchsorted(trajectory.time, pictures.time), 0, len(trajectory.time) - 1)
    ahead = np.flatnonzero(pictures.end == trajectory["gear"][rows])
    every = max(EVERY, float(np.ptp(pictures.time)) / (MOST - 1))
    slot = np.floor(pictures.time[ahead] / every + 1e-6)
    return ahead[np.diff(slot, prepend=-1.0) > 0].tolist()


def _thinned(size: int, side: int) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of a picture that its tile has."""
    places = ((np.arange(side) + 0.5) * size / side).astype(np.intp)
    return np.ix_(places, places)


def _png(sheet: NDArray[np.uint8], colours: NDArray[np.uint8]) -> str:
    """A picture of palette places in base64."""
    image, buffer = Image.fromarray(sheet, "P"), io.BytesIO()
    image.putpalette(colours.tobytes())
    image.save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()
