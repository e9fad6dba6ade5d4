"""What the robot's own cameras see, as colours, and as a panel of the frames of a film."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.show.film.overlay import FAINT, HEIGHT, LEFT, PANEL, WIDTH, font

TALL = 206
"""Of the panel, pixels of a film with 720 lines."""
ROOM = (LEFT + HEIGHT + 10 + TALL + 14) / 720
"""What panel and text take of a picture's height, with the gap between them and the margin."""
_TILE, _GAP = 144, 16  # width of a picture; space around it
_NEAR, _SPREAD = 0.05, 0.6
"""Distance, m, up to which walls are shown at their brightest, as they are in turns; and the power
of one over the distance by which they darken, which tells far places apart."""
_NOTHING = (52, 30, 44)
"""Of pixels that say nothing, 8-bit RGB."""
_DEPTH = ((6, 10, 24), (24, 62, 112), (52, 138, 160), (146, 200, 172), (252, 244, 214))
_LIGHT = ((0, 0, 0), (255, 250, 240))
"""Colours from far to near, and from dark to bright, at even steps."""


def palette(unit: str) -> NDArray[np.uint8]:
    """Colours (256, 3) of ``levels`` for pictures in this unit; the first one is for pixels that
    say nothing."""
    colours = np.array(_DEPTH if unit == "m" else _LIGHT, float)
    place = np.linspace(0, len(colours) - 1, 255)
    ramp = [np.interp(place, np.arange(len(colours)), column) for column in colours.T]
    return np.concatenate([[_NOTHING], np.round(np.stack(ramp, axis=-1))]).astype(np.uint8)


def levels(picture: Array, unit: str) -> NDArray[np.uint8]:
    """Places of pixels in the palette, 0 where one says nothing: near walls are bright."""
    known = np.isfinite(picture)
    value = np.where(known, picture, 0.0)
    if unit == "m":
        value = (_NEAR / np.maximum(value, _NEAR)) ** _SPREAD
    bright = np.clip(value, 0.0, 1.0)
    return np.where(known, 1 + np.round(254 * bright), 0).astype(np.uint8)


class Seen:
    """The last pictures ahead and behind, in a panel above the one of the text."""

    def __init__(self, pictures: Pictures, width: int, height: int) -> None:
        self._pictures, self._scale = pictures, min(height / 720, width / 1280)
        self._palette, self._font = palette(pictures.unit), font(self._px(15))
        self._tiles: dict[int, Image.Image] = {}

    def _px(self, size: float) -> int:
        return max(1, round(size * self._scale))

    def write(self, frame: NDArray[np.uint8], time: float, gear: int) -> None:
        """Draw what was seen last at ``time`` s into ``frame`` (h, w, 3) of a robot that drives in
        ``gear``."""
        px, bottom = self._px, len(frame) - self._px(LEFT + HEIGHT + 10)
        left, corner = px(LEFT), frame[max(0, bottom - px(TALL)) : bottom]
        corner = corner[:, left : left + px(WIDTH)]
        seen = [(word, self._pictures.seen_at(time, end * gear)) for word, end in _ENDS]
        seen = [(word, index) for word, index in seen if index is not None]
        if 0 in corner.shape or not seen:
            return
        image = Image.fromarray(np.ascontiguousarray(corner))
        draw = ImageDraw.Draw(image, "RGBA")
        draw.rounded_rectangle((0, 0, image.width - 1, image.height - 1), px(10), fill=PANEL)
        draw.text((px(16), px(10)), "what the robot sees", font=self._font, fill=FAINT)
        for number, (word, index) in enumerate(seen):
            place = px(16) + number * px(_TILE + _GAP), px(34)
            image.paste(self._tile(index), place)
            draw.text((place[0], px(34 + _TILE + 4)), word, font=self._font, fill=FAINT)
        corner[:] = np.asarray(image)

    def _tile(self, index: int) -> Image.Image:
        """A picture as wide as a tile."""
        if index not in self._tiles:
            if len(self._tiles) == len(_ENDS):
                self._tiles.pop(next(iter(self._tiles)))
            picture = levels(self._pictures[index], self._pictures.unit)
            image = Image.fromarray(self._palette[picture])
            size, grain = self._px(_TILE), Image.Resampling.NEAREST
            smaller = size < self._pictures.size
            self._tiles[index] = image.resize(
                (size, size), Image.Resampling.BOX if smaller else grain
            )
        return self._tiles[index]


_ENDS = (("ahead", 1), ("behind", -1))
