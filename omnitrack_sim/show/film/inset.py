"""A small map of all pipes in the corner of a film: the way so far, the robot and its goals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Part, Route
from omnitrack_sim.record.trajectory import Trajectory

FEW_FITTINGS = 3
"""A route through no more fittings than this needs no map."""
SPACING = 0.04
"""Distance of neighbouring points of a drawn axis, m."""
NOSE_FIRST, TAIL_FIRST = (255, 205, 70), (240, 120, 170)
"""Colours of the way driven, 8-bit RGB."""
_PANEL, _EDGE, _PIPE, _ROBOT = (14, 18, 24, 190), (14, 18, 24), (120, 131, 144), (255, 255, 255)
_PLATE = (226, 74, 60)
_BELIEVED = (90, 220, 255)
BESIDE = 0.005
"""How far the place that a robot takes itself to be at is from where it is, m, for it to be marked
on the map: that and less is a good estimate."""
_FINER = 3  # the map is drawn so many times larger and then reduced, for smooth lines
# Azimuth and elevation, degrees: elevations from two sides, then oblique views from above.
_VIEWS = [
    (0, 0),
    (90, 0),
    *((side * turn, up) for up in (22, 35) for turn in (25, 40, 60) for side in (1, -1)),
]
_MOST = 500  # how many points of the pipes are compared to find overlaps


def needs_map(routes: Sequence[Route]) -> bool:
    """Whether a run goes through more than ``FEW_FITTINGS`` fittings, or over several legs."""
    return len(routes) > 1 or len(routes[0].passages) > FEW_FITTINGS


class Inset:
    """The map for frames of one size, upper right corner. The pipes are drawn once."""

    def __init__(
        self,
        trajectory: Trajectory,
        routes: Sequence[Route],
        goals: Array,
        plates: Array,
        width: int,
        height: int,
        found: NDArray[np.intp] | None = None,
    ) -> None:
        """For frames of ``width`` and ``height`` pixels.

        Args:
            trajectory: the record.
            routes: of each leg.
            goals: (G, 3) m, world frame.
            plates: (P, k, 3) m, world frame, rims of plates that close a pipe.
            width, height: of the frames, pixels.
            found: for each part the sample from which on it is on the map; all are when not given.
        """
        network = routes[0].network
        self.trajectory = trajectory
        self.view = projection(network)
        # Pixels of the large map for one pixel of a film with 720 lines.
        self.unit = _FINER * min(height / 720, width / 1280)
        axes = [self._flat(line) for part in network.parts for line in axis_lines(part)]
        radius = max(part.fitting.radius for part in network.parts)
        low = np.min([axis.min(axis=0) for axis in axes], axis=0) - radius
        high = np.max([axis.max(axis=0) for axis in axes], axis=0) + radius
        pad = 14 * self.unit
        room = np.array([0.27 * width, 0.40 * height]) * _FINER - 2 * pad
        self.scale = float((room / (high - low)).min())  # pixels a metre
        self.offset = np.array([pad - self.scale * low[0], pad + self.scale * high[1]])
        size = np.ceil((self.scale * (high - low) + 2 * pad) / _FINER).astype(int)
        self.size = (int(size[0]) * _FINER, int(size[1]) * _FINER)
        self.place = (
            width - round(18 * self.unit / _FINER) - int(size[0]),
            round(18 * self.unit / _FINER),
        )
        parts = len(network.parts)
        self._found = np.zeros(parts, np.intp) if found is None else found
        self._drawn, self._on_it = (network, goals, plates), np.zeros(parts, bool)
        self._grow(0)
        step = np.abs(np.diff(trajectory["distance"], prepend=trajectory["distance"][0]))
        marks = np.floor(np.cumsum(np.where(np.isfinite(step), step, 0.0)) / 0.01)
        known = np.isfinite(trajectory["position"]).all(axis=1)
        self._rows = np.flatnonzero(
            known & ((np.diff(marks, prepend=-1) > 0) | _changed(trajectory["leg"]))
        )
        self._points = self._pixels(trajectory["position"])  # (T, 2)
        believed = trajectory.channels.get("position_estimate")
        believed = trajectory["position"] if believed is None else believed
        self._believed = self._pixels(believed)
        self._apart = np.linalg.norm(believed - trajectory["position"], axis=-1)

    def write(self, frame: NDArray[np.uint8], row: int) -> None:
        """Draw the map as of sample ``row`` into ``frame`` (h, w, 3)."""
        if (self._on_it != (self._found <= row)).any():
            self._grow(row)
        self._drive(int(np.searchsorted(self._rows, row, side="right")))
        panel = self._small.copy()
        self._robot(panel, row)
        left, top = self.place
        corner = frame[top : top + panel.height, left : left + panel.width]
        image = Image.fromarray(np.ascontiguousarray(corner))
        image.paste(panel.convert("RGB"), (0, 0), panel.getchannel("A"))
        corner[:] = np.asarray(image)

    def _grow(self, row: int) -> None:
        """Draw the pipes that are on the map at sample ``row``."""
        self._on_it = self._found <= row
        self._background = self._pipes(*self._drawn)
        self._panel, self._driven = self._background.copy(), 0
        self._small = self._panel.reduce(_FINER)

    def _drive(self, count: int) -> None:
        """Have the way drawn up to the first ``count`` of its points, in the colour of the gear."""
        if count < self._driven:
            self._panel, self._driven = self._background.copy(), 0
            self._small = self._panel.reduce(_FINER)
        if count > self._driven:
            draw, first = ImageDraw.Draw(self._panel), max(0, self._driven - 1)
            for i in range(first, count - 1):
                self._step(draw, self._rows[i], self._rows[i + 1])
            self._driven = count
            points = self._points[self._rows[first:count]]
            self._renew(points.min(axis=0), points.max(axis=0))

    def _renew(self, low: Array, high: Array) -> None:
        """Reduce what has been drawn between two corners (2,) of the large map, pixels."""
        box = self._box(low - 4 * self.unit, high + 4 * self.unit)
        if box is not None:
            self._small.paste(self._crop(box).reduce(_FINER), box[:2])

    def _crop(self, box: tuple[int, int, int, int]) -> Image.Image:
        """What of the large map shows in a box of the small one."""
        left, top, right, bottom = (_FINER * edge for edge in box)
        return self._panel.crop((left, top, right, bottom))

    def _box(self, low: Array, high: Array) -> tuple[int, int, int, int] | None:
        """Pixels of the small map that two corners of the large one span; None without any."""
        size = self._small.size
        left, top = np.floor(low / _FINER).astype(int).clip(0, size).tolist()
        right, bottom = np.ceil(high / _FINER).astype(int).clip(0, size).tolist()
        return (left, top, right, bottom) if right > left and bottom > top else None

    def _flat(self, points: Array) -> Array:
        """``points`` (n, 3) m projected onto the map, (n, 2) m to the right and up."""
        return points @ self.view[:, :2]

    def _pixels(self, points: Array) -> Array:
        """``points`` (n, 3) m in pixels of the large map, (n, 2) to the right and down."""
        return self.offset + self.scale * self._flat(points) * [1, -1]

    def _pipes(self, network: Assembly, goals: Array, plates: Array) -> Image.Image:
        """Panel, pipes from the farthest to the nearest, plates, goals."""
        image = Image.new("RGBA", self.size, (0, 0, 0, 0))
        draw = ImageDraw.Draw(image)
        draw.rounded_rectangle(
            (0, 0, self.size[0] - 1, self.size[1] - 1), round(10 * self.unit), fill=_PANEL
        )
        shown = [part for part, on in zip(network.parts, self._on_it, strict=True) if on]
        lines = [(part, line) for part in shown for line in axis_lines(part)]
        pieces = [
            (part.fitting.radius, line[i : i + 2])
            for part, line in lines
            for i in range(len(line) - 1)
        ]
        order = np.argsort(
            [float((piece @ self.view[:, 2]).mean()) for _, piece in pieces], kind="stable"
        )
        for radius, piece in (pieces[i] for i in order):
            ends = [tuple(end) for end in self._pixels(piece).tolist()]
            thick = max(5 * self.unit, 2 * self.scale * radius)
            # The dark edge ends square, so that it shows at crossings only and not where pieces
            # meet.
            draw.line(ends, fill=_EDGE, width=round(thick + 3 * self.unit))
            draw.line(ends, fill=_PIPE, width=round(thick))
            for x, y in ends:
                draw.ellipse(
                    (x - thick / 2, y - thick / 2, x + thick / 2, y + thick / 2), fill=_PIPE
                )
        for rim in plates:
            corners = [tuple(corner) for corner in self._pixels(rim).tolist()]
            draw.polygon(corners, fill=_PLATE)
            draw.line(corners, fill=_PLATE, width=round(3 * self.unit))
        for goal in self._pixels(goals):
            self._star(draw, goal)
        return image

    def _star(self, draw: ImageDraw.ImageDraw, centre: Array) -> None:
        angle = np.pi * np.arange(10) / 5
        reach = np.where(np.arange(10) % 2 == 0, 9.0, 4.0) * self.unit
        corners = centre + reach[:, None] * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
        draw.polygon(
            [tuple(corner) for corner in corners.tolist()], fill=(255, 230, 120), outline=_EDGE
        )

    def _step(self, draw: ImageDraw.ImageDraw, row: int, after: int) -> None:
        """The way from one sample to another one."""
        ends = self._points[[row, after]]
        colour = TAIL_FIRST if self.trajectory["gear"][after] < 0 else NOSE_FIRST
        thick = max(1, round(3.2 * self.unit))
        draw.line([tuple(end) for end in ends.tolist()], fill=colour, width=thick)
        for x, y in ends.tolist():
            reach = thick / 2 - 0.5
            draw.ellipse((x - reach, y - reach, x + reach, y + reach), fill=colour)

    def _robot(self, panel: Image.Image, row: int) -> None:
        """A dot with an arrow towards the nose, short if that points along the line of sight; and
        a hollow mark where the robot takes itself to be, where it is not there."""
        places = np.stack([self._points[row], self._believed[row]])
        if not np.isfinite(places).all():
            return
        reach = 24 * self.unit
        box = self._box(places.min(axis=0) - reach, places.max(axis=0) + reach)
        if box is not None:
            near, corner = self._crop(box), _FINER * np.array(box[:2])
            draw = ImageDraw.Draw(near)
            self._draw_robot(draw, places[0] - corner, row)
            if self._apart[row] > BESIDE:
                self._draw_believed(draw, places[1] - corner)
            panel.paste(near.reduce(_FINER), box[:2])

    def _draw_believed(self, draw: ImageDraw.ImageDraw, centre: Array) -> None:
        """``centre`` (2,) pixels."""
        for reach, colour, thick in ((9.2, _EDGE, 4.6), (8.2, _BELIEVED, 2.4)):
            low, high = centre - reach * self.unit, centre + reach * self.unit
            width = max(1, round(thick * self.unit))
            draw.ellipse((*low.tolist(), *high.tolist()), outline=colour, width=width)

    def _draw_robot(self, draw: ImageDraw.ImageDraw, centre: Array, row: int) -> None:
        """``centre`` (2,) pixels."""
        nose = matrix_from_quaternion(self.trajectory["quaternion"][row])[:, 2]
        ahead = (nose @ self.view[:, :2]) * [1, -1]
        aside = np.array([-ahead[1], ahead[0]]) / max(float(np.hypot(*ahead)), 1e-9)
        tip, base = centre + 19 * self.unit * ahead, centre + 5 * self.unit * ahead
        corners = [tip, base + 6.5 * self.unit * aside, base - 6.5 * self.unit * aside]
        draw.polygon(
            [tuple(corner) for corner in np.array(corners).tolist()], fill=_ROBOT, outline=_EDGE
        )
        for reach, colour in ((7.0, _EDGE), (5.5, _ROBOT)):
            low, high = centre - reach * self.unit, centre + reach * self.unit
            draw.ellipse((*low.tolist(), *high.tolist()), fill=colour)


def projection(network: Assembly) -> Array:
    """Axes of the picture as columns (3, 3): right, up, towards the viewer. World z is up.

    Of elevations and oblique views from above the one in which the fewest pipes lie over others or
    are seen end on.
    """
    lines = [line for part in network.parts for line in axis_lines(part)]
    points = np.concatenate(lines)
    points = points[:: max(1, len(points) // _MOST)]
    steps = np.concatenate([np.diff(line, axis=0) for line in lines])
    length = np.linalg.norm(steps, axis=1)
    apart = _distances(points)
    width = 2 * max(part.fitting.radius for part in network.parts)
    best, least = np.eye(3), np.inf
    for azimuth, elevation in np.radians(_VIEWS):
        view = _axes(azimuth, elevation)
        over = (_distances(points @ view[:, :2]) < width) & (apart > 1.5 * width)
        shown = np.linalg.norm(steps @ view[:, :2], axis=1) / length
        end_on = length @ np.maximum(0.6 - shown, 0.0) / length.sum()
        short = length @ (1 - shown) / length.sum()
        cost = over.any(axis=1).mean() + 2 * end_on + 0.2 * short
        if cost < least - 1e-9:
            best, least = view, cost
    return best


def _axes(azimuth: float, elevation: float) -> Array:
    """Axes (3, 3) of the picture for a viewer at ``azimuth`` and ``elevation``, rad.

    At azimuth 0 the viewer stands on the side of -y; a positive one moves the viewer to the right.
    """
    back = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            -np.cos(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.stack([right, np.cross(back, right), back], axis=-1)


def _distances(points: Array) -> Array:
    """Distances (n, n) m between ``points`` (n, d) m."""
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def axis_lines(part: Part) -> list[Array]:
    """Axes of a part, points (n, 3) m."""
    return [
        line.at(np.linspace(0, line.length, max(2, round(line.length / SPACING) + 1)))[0]
        for line, _, _ in part.axes
    ]


def _changed(codes: NDArray) -> NDArray[np.bool_]:
    """Where (T,) codes differ from the sample before."""
    return np.diff(codes, prepend=codes[:1]) != 0
