"""Coarse pictures of all that may lie ahead, computed once, that a first look is compared with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.recognition.forms import Form
from omnitrack_sim.autonomy.recognition.poses import (
    DISTANCE,
    PLACES,
    STILL,
    TURN,
    cameras,
    straightened,
)
from omnitrack_sim.autonomy.recognition.scale import Scale
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Part
from omnitrack_sim.senses.optics import Camera, OpticsTable, Walls, rays_of

WallMaker = Callable[[Sequence[Sequence[Part]], Sequence[Sequence[tuple[int, str]]]], Walls]
"""Makes walls of maps and the ports that plates close, such as ``model.rays.RayWalls``."""
Coarse = NDArray[np.float32]
AROUND = 16
"""Rays of a ring, and turns of a form."""
RINGS = np.array(
    [0.05, 0.08, 0.11, 0.14, 0.17, 0.21, 0.25, 0.3, 0.36, 0.43, 0.52, 0.63, 0.76, 0.88]
)
"""Angles of the rings from the axis, as parts of half the field of view."""
DISTANCES = np.arange(0.15, 3.8, 0.1875)
"""Of the port plane, in bores."""
BLUR = 3.0
"""Standard deviations by which a coarse picture is off besides the steps of the library: the pose
of the camera is roughly known, and sizes are only those of the starts."""
CAP = 9.0
"""Most that a ray can cost."""


@dataclass(frozen=True)
class Entries:
    """Rows of the library.

    Attributes:
        form: (m,) numbers of the forms. start: (m,) of their starting sizes.
        numbers: (m, 6) where the camera stands.
    """

    form: NDArray[np.intp]
    start: NDArray[np.intp]
    numbers: Array


class Library:
    """Pictures of all forms at all distances and turns, of a camera on the pipe's axis."""

    def __init__(
        self, camera: Camera, bore: float, forms: Sequence[Form], walls: WallMaker, scale: Scale
    ) -> None:
        self._camera, self._scale, self._radius = camera, scale, bore / 2
        self._half = np.radians(camera.optics.field_of_view_deg) / 2
        angle, around = np.meshgrid(
            RINGS * self._half, 2 * np.pi * np.arange(AROUND) / AROUND, indexing="ij"
        )
        self.rays = np.stack(
            [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
        ).reshape(-1, 3)
        every = rays_of(camera.optics)
        # What the edge of a picture sees is nearly straight pipe; the exposure depends on it.
        edge = every[every[:, 2] < np.cos(0.9 * self._half)]
        self._rays = np.concatenate([self.rays, edge[:: max(1, len(edge) // 150)]])
        self._straight = walls(*_maps([forms[0].map((), bore)]))
        self.straight = self._picture(self._straight, np.zeros(1, int), np.zeros((1, PLACES)))[0]
        self.entries, self.pictures, self._sharp, self._level = self._filled(forms, bore, walls)

    def _filled(
        self, forms: Sequence[Form], bore: float, walls: WallMaker
    ) -> tuple[Entries, Coarse, Coarse, Coarse]:
        rows, found, sharp = [], [], []
        for which, form in enumerate(forms):
            made = walls(*_maps([form.map(sizes, bore) for sizes in form.starts]))
            turns = (
                np.arange(0, form.period - 1e-9, 2 * np.pi / AROUND) if form.period else np.zeros(1)
            )
            places = DISTANCES * bore if form.parameters else np.zeros(1)
            start, place, turn = (
                grid.ravel()
                for grid in np.meshgrid(np.arange(len(form.starts)), places, turns, indexing="ij")
            )
            numbers = np.zeros((len(start), PLACES))
            numbers[:, DISTANCE], numbers[:, TURN] = place, turn
            pictures = self._picture(made, start.astype(np.intp), numbers)
            rows.append((np.full(len(start), which), start, numbers))
            found.append(pictures.astype(np.float32))
            shape = (len(form.starts), len(places), len(turns), -1)
            sharp.append(_sharpness(pictures.reshape(shape)).reshape(len(start), -1))
        which, start, numbers = (np.concatenate(column) for column in zip(*rows, strict=True))
        weight = np.concatenate(sharp).astype(np.float32)
        level = -2 * np.log(weight).sum(axis=1)
        return Entries(which, start, numbers), np.concatenate(found), weight, level

    def _picture(self, walls: Walls, which: NDArray[np.intp], numbers: Array) -> Array:
        place, rotation = cameras(numbers, [STILL])
        far, lamp = self._camera.optics.far, self._camera.lamp
        hits = walls.trace(which, place[:, 0], rotation[:, 0], self._rays, far, lamp)
        return self._scale.of(self._camera.expected(hits, self._rays)[:, : len(self.rays)])

    def look(self, picture: Array, numbers: Array) -> Array:
        """What a picture (pixels²,), on the scale, of a camera at ``numbers`` (6,) would be from
        the axis (k,), as if the wall were that of straight pipe."""
        seen = straightened(numbers, self.rays, self._radius)
        place, rotation = cameras(numbers[None], [STILL])
        rays = np.concatenate([seen, self._rays[len(seen) :]])
        far, lamp = self._camera.optics.far, self._camera.lamp
        hits = self._straight.trace(np.zeros(1, int), place[:, 0], rotation[:, 0], rays, far, lamp)
        there = self._scale.of(self._camera.expected(hits, rays)[:, : len(seen)])[0]
        return interpolated(picture, seen, self._camera.optics) + self.straight - there

    def costs(self, look: Array) -> Array:
        """How badly each entry (m,) agrees with a look (k,)."""
        apart = (self.pictures - look.astype(np.float32)) * self._sharp
        apart *= apart
        return self._level + (apart / (1 + apart / np.float32(CAP))).sum(axis=1)


def _sharpness(pictures: Array) -> Array:
    """One over the standard deviation of each ray of pictures (starts, distances, turns, k), whose
    true distance and turn lie up to half a step beside."""
    spread = np.full(pictures.shape, BLUR**2)
    count = pictures.shape[1]
    if count > 1:
        steps = np.abs(np.diff(pictures, axis=1)) / 2
        before, after = np.minimum(np.arange(count), count - 2), np.maximum(np.arange(count) - 1, 0)
        spread += np.maximum(steps[:, before], steps[:, after]) ** 2
    if pictures.shape[2] > 1:
        steps = np.abs(pictures - np.roll(pictures, 1, axis=2)) / 2
        spread += np.maximum(steps, np.roll(steps, -1, axis=2)) ** 2
    return 1 / np.sqrt(spread)


def _maps(
    maps: Sequence[tuple[tuple[Part, ...], tuple[tuple[int, str], ...]]],
) -> tuple[list[tuple[Part, ...]], list[tuple[tuple[int, str], ...]]]:
    return [parts for parts, _ in maps], [closed for _, closed in maps]


def interpolated(picture: Array, directions: Array, optics: OpticsTable) -> Array:
    """Values (k,) of a picture (pixels²,) in directions (k, 3), camera frame; at its edge beyond
    it."""
    count, edge = optics.pixels, np.radians(optics.field_of_view_deg) / 2
    angle = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    size = angle * (1 + optics.distortion * angle**2) / (edge * (1 + optics.distortion * edge**2))
    across = np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-12)
    column, row = (
        np.clip((size * directions[:, i] / across + 1) / 2 * count - 0.5, 0, count - 1)
        for i in range(2)
    )
    left, low = np.minimum(column.astype(int), count - 2), np.minimum(row.astype(int), count - 2)
    a, b = column - left, row - low
    grid = picture.reshape(count, count)
    return (
        grid[low, left] * (1 - a) * (1 - b)
        + grid[low, left + 1] * a * (1 - b)
        + grid[low + 1, left] * (1 - a) * b
        + grid[low + 1, left + 1] * a * b
    )
