"""Panels drawn into the frames of films: status of the run, map of the pipes, the robot's cameras.

Lengths are pixels of a film with 720 lines, unless something else is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.display import Bar, Colour, StatusText
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.show.film.shots import Eye
from omnitrack_sim.show.landmarks import Landmarks
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.projection import axis_lines, clearest

LEFT, WIDTH = 18, 337
"""Margin and width of the status panel."""
BARS, BAR_APART, CLOSE_APART, FEW_BARS = 128, 30, 22, 3
"""Height above the first bar, distance of bars, and of more than so many."""
SHORT = 108
"""Height of a status panel without bars."""
LABEL, TEXT, INSET = 172, 304, 16
"""Widest label of a bar, width of all text of a panel, and its distance from the edge."""
CAMERA_HEIGHT, CAMERA_GAP = 206, 10
"""Height of the panel of the robot's cameras, and its distance from the status panel below it."""
MARGIN = 14
"""Room above the highest panel that the pipes keep free."""
BESIDE = 0.005
"""Error of the estimated position, m, from which on it is marked on the map: less is a good
estimate."""
NOSE_FIRST, TAIL_FIRST = (255, 205, 70), (240, 120, 170)
"""Colours of the travelled path by gear. All colours are 8-bit RGB, panels with their opacity."""
_PANEL, _TEXT, _FAINT = (14, 18, 24, 190), (240, 243, 246), (160, 168, 178)
_EDGE, _PIPE, _ROBOT = (14, 18, 24), (120, 131, 144), (255, 255, 255)
_PLATE, _GOAL, _ESTIMATE = (226, 74, 60), (255, 230, 120), (90, 220, 255)
_LUMINANCE, DARK = (0.21, 0.72, 0.07), 0.38
"""Shares of red, green and blue in the luminance, and that below which a colour is dark."""
_FINER = 3  # the map is drawn so many times larger and then reduced, for smooth lines
_TILE, _GAP = 144, 16  # width of a camera's picture; space around it
# A power below one spreads the far end of the range, where most of a straight pipe's pixels are.
_NEAR, _DARKENING = 0.05, 0.6
"""Distance, m, up to which walls are shown at their brightest, as they are in turns; and the power
of one over the distance by which they darken, which tells far places apart."""
_NO_RETURN = (52, 30, 44)  # of pixels without a value
_DEPTH = ((6, 10, 24), (24, 62, 112), (52, 138, 160), (146, 200, 172), (252, 244, 214))
_LIGHT = ((0, 0, 0), (255, 250, 240))
"""Colours from far to near, and from dark to bright, at even steps."""


class Panel:
    """Base class of panels over painted frames of one size.

    Attributes:
        scale: pixels of a frame over those of a film with 720 lines.
        top: upper edge of panels in the lower left corner.
    """

    top = 0.0

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size
        self.scale = min(height / 720, width / 1280)

    def write(self, frame: NDArray[np.uint8], row: int) -> None:
        """Draw the panel at sample ``row`` into ``frame`` (h, w, 3)."""
        raise NotImplementedError

    def _px(self, size: float) -> int:
        return max(1, round(size * self.scale))

    def _open(
        self, frame: NDArray[np.uint8], above: float, height: float
    ) -> tuple[NDArray[np.uint8], Image.Image, ImageDraw.ImageDraw] | None:
        """Return a panel's corner of a frame and a picture to draw on; None without room.

        The panel's lower edge is ``above`` that of the frame.
        """
        px, bottom = self._px, len(frame) - self._px(above)
        corner = frame[max(0, bottom - px(height)) : bottom, px(LEFT) : px(LEFT) + px(WIDTH)]
        if 0 in corner.shape:
            return None
        image = Image.fromarray(np.ascontiguousarray(corner))
        draw = ImageDraw.Draw(image, "RGBA")
        draw.rounded_rectangle((0, 0, image.width - 1, image.height - 1), px(10), fill=_PANEL)
        return corner, image, draw


class StatusPanel(Panel):
    """Text and bars about the moment, in the lower left corner.

    Args:
        status: returns the text of a sample.
        size: width and height of the frames, pixels.
    """

    def __init__(self, status: Callable[[int], StatusText], size: tuple[int, int]) -> None:
        super().__init__(size)
        self._large, self._small = font(self._px(26)), font(self._px(17))
        bars = status(0).bars
        few = len(bars) <= FEW_BARS
        self._apart = BAR_APART if few else CLOSE_APART
        self._letters = self._small if few else font(self._px(15))
        self._status, self._full = status, BARS + self._apart * len(bars) + 6 if bars else SHORT
        widest = max((self._letters.getlength(bar.label) for bar in bars), default=0.0)
        self._label = min(LABEL, max(12.0, widest / self.scale))
        self.top = LEFT + self._full

    def write(self, frame: NDArray[np.uint8], row: int) -> None:
        """Write the text of sample ``row`` into ``frame`` (h, w, 3)."""
        opened = self._open(frame, LEFT, self._full)
        if opened is None:
            return
        corner, image, draw = opened
        px, small, status = self._px, self._small, self._status(row)
        # A long title is small before it is cut.
        fits = self._large.getlength(status.title) <= px(TEXT)
        letters, top = (self._large, 10) if fits else (small, 17)
        title = _cut(status.title, letters, px(TEXT))
        draw.text((px(INSET), px(top)), title, font=letters, fill=_TEXT)
        for number, line in enumerate(status.lines):
            place = (px(INSET), px(46 + 26 * number))
            draw.text(place, _cut(line, small, px(TEXT)), font=small, fill=_TEXT)
        draw.text((px(INSET), px(100)), status.caption, font=small, fill=_FAINT)
        for number, bar in enumerate(status.bars):
            self._bar(draw, px(INSET), px(BARS + self._apart * number), bar)
        corner[:] = np.asarray(image)

    def _bar(self, draw: ImageDraw.ImageDraw, left: int, top: int, bar: Bar) -> None:
        """Label, bar from the middle or from the left (positive to the right) and figure."""
        px, colour = self._px, _on_dark(bar.colour)
        label = _shortened(bar.label, self._letters, px(self._label))
        draw.text((left, top), label, font=self._letters, fill=colour)
        right = px(max(228, self._label + 80))
        box = (left + px(self._label + 16), top + px(4), left + right, top + px(18))
        draw.rectangle(box, fill=(255, 255, 255, 28))
        half = (box[2] - box[0]) // 2
        start = box[0] + half if bar.has_sign else box[0]
        end = start + round((half if bar.has_sign else 2 * half) * bar.share)
        draw.rectangle((min(start, end), box[1], max(start, end), box[3]), fill=colour)
        draw.line((start, top + px(1), start, top + px(21)), fill=_FAINT, width=px(1.5))
        text = bar.text.replace("-", "\u2212")
        draw.text((left + px(300), top), text, font=self._small, fill=_TEXT, anchor="ra")


class CameraPanel(Panel):
    """The last pictures of the robot's cameras ahead and behind, above the status panel.

    Args:
        pictures: of the cameras.
        playback: of the run.
        size: width and height of the frames, pixels.
        below: upper edge of the panel below.
    """

    def __init__(
        self, pictures: Pictures, playback: Playback, size: tuple[int, int], below: float
    ) -> None:
        super().__init__(size)
        self._above, self.top = below + CAMERA_GAP, below + CAMERA_GAP + CAMERA_HEIGHT
        self._playback = playback
        self._pictures, self._font = pictures, font(self._px(15))
        self._palette = palette(pictures.unit)

    def write(self, frame: NDArray[np.uint8], row: int) -> None:
        """Draw the last pictures at sample ``row`` into ``frame`` (h, w, 3)."""
        px, time = self._px, float(self._playback.time[row])
        gear = -1 if self._playback.backward[row] else 1
        last = {
            word: self._pictures.index_at(time, end * gear)
            for word, end in (("ahead", 1), ("behind", -1))
        }
        taken = {word: index for word, index in last.items() if index is not None}
        opened = self._open(frame, self._above, CAMERA_HEIGHT) if taken else None
        if opened is None:
            return
        corner, image, draw = opened
        draw.text((px(16), px(10)), "what the robot sees", font=self._font, fill=_FAINT)
        for number, (word, index) in enumerate(taken.items()):
            place = px(16) + number * px(_TILE + _GAP), px(34)
            image.paste(self._tile(index), place)
            draw.text((place[0], px(34 + _TILE + 4)), word, font=self._font, fill=_FAINT)
        corner[:] = np.asarray(image)

    def _tile(self, index: int) -> Image.Image:
        """A picture as wide as a tile."""
        pixels = self._palette[levels(self._pictures[index], self._pictures.unit)]
        size = self._px(_TILE)
        smaller = size < self._pictures.size
        grain = Image.Resampling.BOX if smaller else Image.Resampling.NEAREST
        return Image.fromarray(pixels).resize((size, size), grain)


def palette(unit: str) -> NDArray[np.uint8]:
    """Return the colours (256, 3) of ``levels`` for pictures in this unit.

    The first is for pixels without a value.
    """
    colours = np.array(_DEPTH if unit == "m" else _LIGHT, float)
    place = np.linspace(0, len(colours) - 1, 255)
    ramp = [np.interp(place, np.arange(len(colours)), column) for column in colours.T]
    return np.concatenate([[_NO_RETURN], np.round(np.stack(ramp, axis=-1))]).astype(np.uint8)


def levels(picture: Array, unit: str) -> NDArray[np.uint8]:
    """Indices of pixels into the palette, 0 where one has no value: near walls are bright."""
    known = np.isfinite(picture)
    value = np.where(known, picture, 0.0)
    if unit == "m":
        value = (_NEAR / np.maximum(value, _NEAR)) ** _DARKENING
    bright = np.clip(value, 0.0, 1.0)
    return np.where(known, 1 + np.round(254 * bright), 0).astype(np.uint8)


def draw_forces(frame: NDArray[np.uint8], forces: tuple[Array, Array, Array], eye: Eye) -> None:
    """Draw forces on the robot: a disc where each acts, and a line along it.

    Args:
        frame: picture (h, w, 3) to draw into.
        forces: points (n, 3) m and lines (n, 3) m along the forces, world frame, and red, green,
            blue (n, 3) of each.
        eye: that has seen the picture.
    """
    points, lines, colours = forces
    height, width, _ = frame.shape
    ends = np.stack([points, points + lines], axis=1).reshape(-1, 3)
    pixels, ahead = eye.pixels(ends, (_FINER * width, _FINER * height))
    shown = ahead.reshape(-1, 2).all(axis=1)
    if not shown.any():
        return
    # Drawn over the picture itself, where they are: that is all that is enlarged and reduced.
    ends = pixels.reshape(-1, 2, 2)[shown]
    unit = _FINER * min(height / 720, width / 1280)
    room = math.ceil(8 * unit / _FINER) + 1
    low = np.clip(np.floor(ends.min(axis=(0, 1)) / _FINER) - room, 0, [width, height]).astype(int)
    high = np.clip(np.ceil(ends.max(axis=(0, 1)) / _FINER) + room, 0, [width, height]).astype(int)
    if not (high > low).all():
        return
    (x, y), (right, bottom) = low.tolist(), high.tolist()
    corner = Image.fromarray(np.ascontiguousarray(frame[y:bottom, x:right]))
    size = (_FINER * corner.width, _FINER * corner.height)
    sheet = corner.resize(size, Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(sheet)
    for line, colour in zip(ends - _FINER * low, colours[shown], strict=True):
        # A dark edge sets off arrows from what has their colour.
        for fill, thick in ((_EDGE, 5.5), (_on_dark(colour.tolist()), 3.0)):
            draw.line([tuple(end) for end in line.tolist()], fill=fill, width=round(thick * unit))
            _disc(draw, line[0], max(_FINER, (thick + 1.5) * unit), fill=fill)
    frame[y:bottom, x:right] = np.asarray(sheet.reduce(_FINER))


def _on_dark(colour: Colour | list[float]) -> tuple[int, ...]:
    """Return a colour for a dark ground, mixed with some white to stand out; more if it is dark."""
    white = 0.12 if np.dot(_LUMINANCE, colour) > DARK else 0.4
    return tuple(round(255 * (white + (1 - white) * part)) for part in colour)


class MapPanel(Panel):
    """A map of the true pipes in the upper right corner: the travelled path, the robot, its goals.

    The pipes are drawn once, or again whenever the robot discovers more of them; of the path, what
    is new. All is drawn on a large map, and reduced for smooth lines.
    """

    def __init__(self, playback: Playback, landmarks: Landmarks, size: tuple[int, int]) -> None:
        super().__init__(size)
        self.unit = _FINER * self.scale  # pixels of the large map
        self.playback, self._parts = playback, playback.network.parts
        self.view, self.landmarks = clearest(playback.network), landmarks
        self._fit(*size)
        self._plates = [self._pixels(rim) for rim in landmarks.plate_rims]
        self._goals = self._pixels(landmarks.goal_points)
        self._show_discovered(0)
        self._rows = playback.path
        self._points = self._pixels(playback.position)  # (T, 2)
        self._estimates = self._pixels(playback.estimate)
        self._errors = np.linalg.norm(playback.estimate - playback.position, axis=-1)

    def _fit(self, width: int, height: int) -> None:
        """Choose the size of the map and its scale."""
        ever = self.landmarks.parts < len(self.playback.time)
        parts = [part for part, seen in zip(self._parts, ever, strict=True) if seen]
        axes = np.concatenate([self.view.flat(line) for p in parts for line in axis_lines(p)])
        radius = max(part.fitting.radius for part in parts)
        low, high = axes.min(axis=0) - radius, axes.max(axis=0) + radius
        pad = 14 * self.unit
        room = np.array([0.27 * width, 0.40 * height]) * _FINER - 2 * pad
        self.metre = float((room / (high - low)).min())  # pixels of the large map
        self.offset = np.array([pad - self.metre * low[0], pad + self.metre * high[1]])
        wide, tall = np.ceil((self.metre * (high - low) + 2 * pad) / _FINER).astype(int).tolist()
        self.size = (wide * _FINER, tall * _FINER)
        margin = round(18 * self.scale)
        self.place = (width - margin - wide, margin)

    def write(self, frame: NDArray[np.uint8], row: int) -> None:
        """Draw the map as of sample ``row`` into ``frame`` (h, w, 3)."""
        if self._shown != self.landmarks.count(row):
            self._show_discovered(row)
        self._travel(int(np.searchsorted(self._rows, row, side="right")))
        panel = self._large.copy()
        self._robot(panel, row)
        panel = panel.reduce(_FINER)
        left, top = self.place
        corner = frame[top : top + panel.height, left : left + panel.width]
        image = Image.fromarray(np.ascontiguousarray(corner))
        image.paste(panel.convert("RGB"), (0, 0), panel.getchannel("A"))
        corner[:] = np.asarray(image)

    def _show_discovered(self, row: int) -> None:
        """Draw panel, pipes, plates and goals that are on the map at sample ``row``."""
        landmarks, self._shown = self.landmarks, self.landmarks.count(row)
        self._background = Image.new("RGBA", self.size, (0, 0, 0, 0))
        draw, unit = ImageDraw.Draw(self._background), self.unit
        edges = (0, 0, self.size[0] - 1, self.size[1] - 1)
        draw.rounded_rectangle(edges, round(10 * unit), fill=_PANEL)
        parts = [self._parts[i] for i in np.flatnonzero(landmarks.parts <= row)]
        for number, ends in self.view.segments(parts):  # from the farthest to the nearest
            corners = self.offset + self.metre * ends * [1, -1]
            line = [tuple(corner) for corner in corners.tolist()]
            thick = max(5 * unit, 2 * self.metre * parts[number].fitting.radius)
            # The dark edge ends square, so that it shows at crossings only and not where pieces
            # meet.
            draw.line(line, fill=_EDGE, width=round(thick + 3 * unit))
            draw.line(line, fill=_PIPE, width=round(thick))
            for corner in corners:
                _disc(draw, corner, thick / 2, fill=_PIPE)
        for i in np.flatnonzero(landmarks.plates <= row):
            line = [tuple(corner) for corner in self._plates[i].tolist()]
            draw.polygon(line, fill=_PLATE)
            draw.line(line, fill=_PLATE, width=round(3 * unit))
        angle = np.pi * np.arange(10) / 5
        star = np.where(np.arange(10) % 2 == 0, 9.0, 4.0) * [np.sin(angle), -np.cos(angle)]
        for i in np.flatnonzero(landmarks.goals <= row):
            _polygon(draw, self._goals[i] + unit * star.T, _GOAL)
        self._large, self._travelled = self._background.copy(), 0

    def _travel(self, count: int) -> None:
        """Draw the path up to its first ``count`` points, in the colour of the gear."""
        if count < self._travelled:
            self._large, self._travelled = self._background.copy(), 0
        rows = self._rows[max(0, self._travelled - 1) : count]
        points, backward = self._points[rows], self.playback.backward[rows]
        draw, thick = ImageDraw.Draw(self._large), max(1, round(3.2 * self.unit))
        for i in range(1, len(rows)):
            colour = TAIL_FIRST if backward[i] else NOSE_FIRST
            ends = points[i - 1 : i + 1]
            draw.line([tuple(end) for end in ends.tolist()], fill=colour, width=thick)
            for end in ends:
                _disc(draw, end, thick / 2 - 0.5, fill=colour)
        self._travelled = count

    def _pixels(self, points: Array) -> Array:
        """Points (n, 3) m in pixels of the large map, (n, 2) to the right and down."""
        return self.offset + self.metre * self.view.flat(points) * [1, -1]

    def _robot(self, panel: Image.Image, row: int) -> None:
        """Draw a disc with an arrow towards the nose, short along the line of sight.

        A ring is at the estimated position, where that is not the true one.
        """
        places = np.stack([self._points[row], self._estimates[row]])
        if not np.isfinite(places).all():
            return
        draw, unit = ImageDraw.Draw(panel), self.unit
        centre, estimate = places
        ahead = self.view.flat(self.playback.ahead[row]) * [1, -1]
        aside = np.array([-ahead[1], ahead[0]]) / max(float(np.hypot(*ahead)), 1e-9)
        base = centre + 5 * unit * ahead
        arrow = (centre + 19 * unit * ahead, base + 6.5 * unit * aside, base - 6.5 * unit * aside)
        _polygon(draw, np.array(arrow), _ROBOT)
        for radius, colour in ((7.0, _EDGE), (5.5, _ROBOT)):
            _disc(draw, centre, radius * unit, fill=colour)
        if self._errors[row] > BESIDE:
            for radius, colour, thick in ((9.2, _EDGE, 4.6), (8.2, _ESTIMATE, 2.4)):
                width = max(1, round(thick * unit))
                _disc(draw, estimate, radius * unit, outline=colour, width=width)


def _cut(text: str, letters: Letters, width: int) -> str:
    """The text on one line, cut so that it is at most ``width`` pixels long."""
    text = text.replace("\n", " ")
    if letters.getlength(text) <= width:
        return text
    while text and letters.getlength(text + "\N{HORIZONTAL ELLIPSIS}") > width:
        text = text[:-1]
    return text + "\N{HORIZONTAL ELLIPSIS}"


def _shortened(text: str, letters: Letters, width: int) -> str:
    """The text, without a part of its middle if it is longer than ``width`` pixels.

    Names of alike parts differ at their ends.
    """
    text, kept = text.replace("\n", " "), len(text)
    shown = text
    while kept > 2 and letters.getlength(shown) > width:
        kept -= 1
        shown = f"{text[: kept - kept // 2]}\N{HORIZONTAL ELLIPSIS}{text[len(text) - kept // 2 :]}"
    return shown


def _disc(draw: ImageDraw.ImageDraw, centre: Array, radius: float, **look) -> None:
    low, high = centre - radius, centre + radius
    draw.ellipse((*low.tolist(), *high.tolist()), **look)


def _polygon(draw: ImageDraw.ImageDraw, corners: Array, colour: tuple[int, int, int]) -> None:
    draw.polygon([tuple(corner) for corner in corners.tolist()], fill=colour, outline=_EDGE)


Letters = ImageFont.FreeTypeFont | ImageFont.ImageFont


@cache
def font(size: int) -> Letters:
    """DejaVu Sans from matplotlib's data; Pillow's own letters if it is not there."""
    from importlib.util import find_spec

    # Found without an import, which would take half a second.
    spec = find_spec("matplotlib")
    folder = Path(spec.origin if spec and spec.origin else "").parent
    file = folder / "mpl-data/fonts/ttf/DejaVuSans.ttf"
    return ImageFont.truetype(str(file), size) if file.exists() else ImageFont.load_default(size)
