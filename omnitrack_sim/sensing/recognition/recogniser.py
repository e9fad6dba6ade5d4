"""Finds what lies ahead by comparing pictures with what every form would look like."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnitrack_sim.rotations import Array
from omnitrack_sim.sensing.optics import Camera, rays_of
from omnitrack_sim.sensing.recognition.fit import SIZES, Fit, Level, Tries, Views, tries
from omnitrack_sim.sensing.recognition.forms import forms
from omnitrack_sim.sensing.recognition.library import Library, WallMaker
from omnitrack_sim.sensing.recognition.poses import ASIDE, DISTANCE, PLACES, STILL, TILT, TURN
from omnitrack_sim.sensing.recognition.scale import Scale
from omnitrack_sim.sensing.recognition.sighting import Motion, Sighting

HORIZON = 3.5
"""Distance, in bores, up to which a fitting is told; beyond it a pipe counts as straight."""
STARTS = 3
"""Starting values of a form that are followed."""
KEEP = [14, 5, 3]
SCAN = np.radians([0, -70, -45, -30, -20, -12, -6, 6, 12, 20, 30, 45, 70])


class Recogniser:
    """Tells what lies ahead of a robot in straight pipe of a known bore.

    Args:
        camera: at the robot's nose. bore: m. walls: makes what rays meet, ``model.rays.RayWalls``.
    """

    def __init__(self, camera: Camera, bore: float, walls: WallMaker) -> None:
        self._forms = forms(bore)
        self._bore = bore
        self._scale = Scale(camera)
        self._fit = Fit(camera, bore, walls, self._scale)
        self._library = Library(camera, bore, self._forms, walls, self._scale)
        rays, count = rays_of(camera.optics), camera.optics.pixels
        grid = np.arange(count * count).reshape(count, count)
        half = np.radians(camera.optics.field_of_view_deg) / 2
        corners = grid[[0, 0, -1, -1], [0, -1, 0, -1]]  # vignetting is told by them
        inner = rays[:, 2] > math.cos(0.56 * half)
        self._grids = []
        for within, without in ((2, 4), (1, 3)):
            every = np.union1d(grid[within // 2 :: within, within // 2 :: within], corners)
            some = np.zeros(count * count, bool)
            some[grid[within // 2 :: without, within // 2 :: without]] = True
            some[corners] = True
            pixels = every[(some | inner)[every]]
            row, column = np.divmod(every, count)
            over, beside = np.divmod(pixels, count)
            apart = np.abs(row[:, None] - over) + np.abs(column[:, None] - beside)
            own = np.searchsorted(every, pixels)
            self._grids.append((pixels, apart.argmin(axis=1), own))
        self._edge = (rays[self._grids[0][0], 2] < math.cos(0.75 * half)).astype(float)

    def single(self, picture: Array) -> Sighting:
        """What is ahead, from one picture (pixels²,)."""
        return self.approach(picture[None], [STILL])

    def approach(self, pictures: Array, motions: Sequence[Motion]) -> Sighting:
        """What is ahead of the last of pictures (v, pixels²).

        Args:
            pictures: of one approach, the last one last.
            motions: how the camera stood at each, seen from the last one.
        """
        views = Views(self._scale.of(pictures), list(motions))
        found = self.ranked(views)
        return self._told(found)

    def _level(self, grid: int, rough: float, *, edge: bool = False, free: str = "atdr") -> Level:
        pixels, stand, own = self._grids[grid]
        weight = self._edge if edge else np.ones(len(pixels))
        which = np.array([letter in free for letter in "aattdr"])
        reach = ((0.004, 0.09), (0.002, 0.05))[grid]
        return Level(pixels, stand, own, rough, which, weight, reach)

    def ranked(self, views: Views) -> Tries:
        last = Views(views.pictures[-1:], [STILL])
        pose = self._straight(last)
        begin = self._begin(last, pose)
        begin = self._fit.costs(begin, last, self._level(0, 8.0))
        stage = [begin]
        begin = self._kept(begin, KEEP[0])
        rough = self._fit.refined(begin, last, self._level(0, 8.0), 2)
        stage.append(rough)
        rough = self._kept(self._best_of_each(rough), KEEP[1])
        rough = self._scanned(rough, last, self._level(0, 6.0))
        stage.append(rough)
        v = len(views.motions)
        start = tries(rough.forms, rough.numbers, rough.sizes, v)
        fine = self._fit.refined(start, views, self._level(1, 5.0), 3)
        stage.append(fine)
        fine = self._fit.refined(self._kept(fine, KEEP[2]), views, self._level(1, 4.0), 3)
        stage.append(fine)
        self.stage = stage
        order = np.argsort(fine.cost)
        return fine.take(order)

    def _scanned(self, found: Tries, views: Views, level: Level) -> Tries:
        """Rows with the best of some turns beside their own."""
        n, m = len(found.forms), len(SCAN)
        rows = found.take(np.repeat(np.arange(n), m).tolist())
        rows.numbers[:, TURN] += np.tile(SCAN, n)
        cost = self._fit.costs(rows, views, level).cost.reshape(n, m)
        return rows.take((np.arange(n) * m + cost.argmin(axis=1)).tolist())

    def _straight(self, views: Views) -> Array:
        """Where the camera stands in the pipe, (6,), from what the edge of its picture sees."""
        begin = tries([self._forms[0]], np.zeros((1, PLACES)), np.zeros((1, SIZES)), 1)
        wide = self._fit.refined(begin, views, self._level(0, 12.0, free="at", edge=True), 2)
        edge = self._fit.refined(wide, views, self._level(0, 5.0, free="at", edge=True), 2)
        return self._fit.refined(edge, views, self._level(1, 4.0, free="at"), 2).numbers[0]

    def _kept(self, found: Tries, most: int) -> Tries:
        """The best rows, the straight pipe among them."""
        rows = np.argsort(found.cost, kind="stable")
        kept = rows[:most].tolist()
        kept += [i for i in rows[most:].tolist() if found.forms[i] is self._forms[0]]
        return found.take(kept)

    def _begin(self, views: Views, pose: Array) -> Tries:
        """The best starting values of every form."""
        library, entries = self._library, self._library.entries
        cost = library.costs(library.look(views.pictures[0], pose))
        joints = self._fit.joints(self._forms[0], pose, views, self._level(1, 4.0))
        chosen: list[int] = []
        places: list[float] = []
        for which in range(len(self._forms)):
            rows = np.flatnonzero(entries.form == which)
            kept: list[int] = []
            for row in rows[np.argsort(cost[rows])]:
                if all(self._apart(row, other) for other in kept):
                    kept.append(int(row))
                if len(kept) == STARTS:
                    break
            chosen += kept
            places += entries.numbers[kept, DISTANCE].tolist()
            for joint in joints if self._forms[which].parameters else ():
                near = rows[np.abs(entries.numbers[rows, DISTANCE] - joint) < 0.12 * self._bore]
                if len(near):
                    chosen.append(int(near[np.argmin(cost[near])]))
                    places.append(joint)
        numbers = library.entries.numbers[chosen].copy()
        numbers[:, :DISTANCE] = pose[:DISTANCE]
        numbers[:, DISTANCE] = places
        chosen_forms = [self._forms[i] for i in library.entries.form[chosen]]
        sizes = np.zeros((len(chosen), SIZES))
        for row, (form, at) in enumerate(
            zip(chosen_forms, library.entries.start[chosen], strict=True)
        ):
            sizes[row, : len(form.sizes)] = form.starts[at]
        return tries(chosen_forms, numbers, sizes, 1)

    def _apart(self, row: int, other: int) -> bool:
        """Whether two entries of the library are not just neighbours."""
        entries = self._library.entries
        a, b = entries.numbers[row], entries.numbers[other]
        turned = abs((a[TURN] - b[TURN] + math.pi) % (2 * math.pi) - math.pi)
        far = abs(a[DISTANCE] - b[DISTANCE]) > 0.4 * self._bore
        return turned > 0.8 or far

    def _pruned(self, found: Tries, factor: float) -> Tries:
        least = found.cost.min()
        return found.take([i for i in range(len(found.forms)) if found.cost[i] < factor * least + 300])

    def _best_of_each(self, found: Tries) -> Tries:
        best: dict[int, int] = {}
        for i in np.argsort(found.cost):
            best.setdefault(id(found.forms[i]), int(i))
        return found.take(list(best.values()))

    def _told(self, found: Tries) -> Sighting:
        score = found.cost
        likely = np.exp(-(score - score[0]) / 2)
        names = [(form.kind, form.enter) for form in found.forms]
        total = sum(p for p, name in zip(likely, names) if name == names[0])
        sure = float(total / likely.sum())
        form, numbers = found.forms[0], found.numbers[0]
        cov = np.linalg.inv(found.normal[0])
        at = [DISTANCE, TURN]
        return Sighting(
            form.kind,
            form.enter if form.kind != "straight" else "",
            {size.key: float(v) for size, v in zip(form.sizes, found.sizes[0])},
            float(numbers[DISTANCE]),
            float((numbers[TURN] + math.pi) % (2 * math.pi) - math.pi),
            cov[np.ix_(at, at)],
            {size.key: float(math.sqrt(cov[PLACES + i, PLACES + i])) for i, size in enumerate(form.sizes)},
            sure,
            numbers[ASIDE],
            numbers[TILT],
        )
