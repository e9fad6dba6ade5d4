"""Recognise what lies ahead by comparing pictures with what every form would look like.

First with a library of coarse pictures, computed once, then by fitting the best forms.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.recognition.fit import (
    Fit,
    Hypotheses,
    Level,
    VarianceStabiliser,
    Views,
    beyond,
    exits_of,
    hypotheses,
    joined,
)
from omnitrack_sim.autonomy.recognition.forms import (
    ANGLE,
    ASIDE,
    CENTRED,
    DISTANCE,
    LENGTH,
    OWN,
    PIECE,
    PLACES,
    SIZES,
    STILL,
    TILT,
    TURN,
    Detection,
    Form,
    PosePrior,
    WallMaker,
    cameras,
    forms,
    straightened,
)
from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.base.rotations import Array, Pose, wrap_angle
from omnitrack_sim.senses.optics import Camera, OpticsTable, rays_of
from omnitrack_sim.walls.rays import RayWalls

Coarse = NDArray[np.float32]


@dataclass(frozen=True)
class Entries:
    """Rows of the library.

    Attributes:
        form: (m,) indices of the forms.
        start: (m,) indices of their starting sizes.
        numbers: (m, 6) of the camera.
    """

    form: NDArray[np.intp]
    start: NDArray[np.intp]
    numbers: Array

    def distinct(self, rows: NDArray[np.intp], bore: float) -> list[int]:
        """Return the first of ``rows`` (k,) that are no neighbours of each other.

        Of two neighbours the first counts; at most ``RECOGNISER.starts`` are returned. Neighbours
        are near in distance, by bores of ``bore`` m, and in turn.
        """
        kept: list[int] = []
        for row in rows.tolist():
            apart = self.numbers[row] - self.numbers[kept]
            turned = np.abs(wrap_angle(apart[:, TURN])) > RECOGNISER.distinct_turn
            far = np.abs(apart[:, DISTANCE]) > RECOGNISER.distinct_distance * bore
            if (turned | far).all():
                kept.append(row)
            if len(kept) == RECOGNISER.starts:
                break
        return kept


class Library:
    """Pictures of all forms at all distances and turns, of a camera on the pipe's axis."""

    def __init__(
        self,
        camera: Camera,
        bore: float,
        forms: Sequence[Form],
        walls: WallMaker,
        scale: VarianceStabiliser,
    ) -> None:
        self._camera, self._scale, self._radius = camera, scale, bore / 2
        self._half = np.radians(camera.optics.field_of_view_deg) / 2
        angle, around = np.meshgrid(
            RECOGNISER.rings * self._half,
            2 * np.pi * np.arange(RECOGNISER.ring_rays) / RECOGNISER.ring_rays,
            indexing="ij",
        )
        self.rays = np.stack(
            [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
        ).reshape(-1, 3)
        every = rays_of(camera.optics)
        # What the edge of a picture sees is nearly straight pipe; the exposure depends on it.
        edge = every[every[:, 2] < np.cos(RECOGNISER.exposed_part * self._half)]
        self._rays = np.concatenate(
            [self.rays, edge[:: max(1, len(edge) // RECOGNISER.exposed_rays)]]
        )
        parts, closed = forms[0].map((), bore)
        self._straight = walls([parts], [closed])
        one, centred = np.zeros(1, int), np.zeros((1, PLACES))
        self.straight = self._picture(self._straight, one, centred, self._rays)[0]
        self.entries, self.pictures, self._sharp, self._beyond = self._filled(forms, bore, walls)
        # Normalisation of the normal distribution: blurred entries do not win by their blur.
        self._level = -2 * np.log(self._sharp)

    def _filled(
        self, forms: Sequence[Form], bore: float, walls: WallMaker
    ) -> tuple[Entries, Coarse, Coarse, Coarse]:
        rows, images, sharp, least = [], [], [], []
        for which, form in enumerate(forms):
            maps = [form.map(sizes, bore) for sizes in form.starts]
            made = walls([parts for parts, _ in maps], [closed for _, closed in maps])
            turns = (
                np.arange(0, form.period - 1e-9, 2 * np.pi / RECOGNISER.ring_rays)
                if form.period
                else np.zeros(1)
            )
            places = RECOGNISER.library_distances * bore if form.parameters else np.zeros(1)
            start, along, turn = (
                grid.ravel()
                for grid in np.meshgrid(np.arange(len(form.starts)), places, turns, indexing="ij")
            )
            numbers = np.zeros((len(start), PLACES))
            numbers[:, DISTANCE], numbers[:, TURN] = along, turn
            start = start.astype(np.intp)
            hits, place, rotation = self._hits(made, start, numbers, self._rays)
            pictures = self._seen(hits, self._rays)
            hits = hits[:, : len(self.rays)]
            exits = np.stack([exits_of(parts) for parts, _ in maps])[start]
            lamp = self._camera.lamp
            here = beyond(hits, place, rotation, self.rays, exits, self._scale, lamp)
            least.append(here.astype(np.float32))
            rows.append((np.full(len(start), which), start, numbers))
            images.append(pictures.astype(np.float32))
            shape = (len(form.starts), len(places), len(turns), -1)
            sharp.append(_sharpness(pictures.reshape(shape)).reshape(len(start), -1))
        which, start, numbers = (np.concatenate(column) for column in zip(*rows, strict=True))
        weight = np.concatenate(sharp).astype(np.float32)
        return Entries(which, start, numbers), np.concatenate(images), weight, np.concatenate(least)

    def _picture(
        self, walls: RayWalls, which: NDArray[np.intp], numbers: Array, rays: Array
    ) -> Array:
        return self._seen(self._hits(walls, which, numbers, rays)[0], rays)

    def _hits(
        self, walls: RayWalls, which: NDArray[np.intp], numbers: Array, rays: Array
    ) -> tuple[Array, Array, Array]:
        place, rotation = (pose[:, 0] for pose in cameras(numbers, [STILL]))
        far, lamp = self._camera.optics.far, self._camera.lamp
        return walls.trace(which, place, rotation, rays, far, lamp), place, rotation

    def _seen(self, hits: Array, rays: Array) -> Array:
        return self._scale.of(self._camera.expected(hits, rays)[:, : len(self.rays)])

    def look(self, picture: Array, numbers: Array) -> Array:
        """Return the coarse picture (k,) as from the pipe's axis.

        Of a picture (pixels²,), on the scale, of a camera at ``numbers`` (6,), as if the wall were
        that of straight pipe; not numbers where a leaning camera does not see.
        """
        directions = straightened(numbers, self.rays, self._radius)
        rays = np.concatenate([directions, self._rays[len(directions) :]])
        there = self._picture(self._straight, np.zeros(1, int), numbers[None], rays)[0]
        # The same walls from the axis and from the camera: their difference corrects the picture.
        look = interpolated(picture, directions, self._camera.optics) + self.straight - there
        return np.where(directions[:, 2] > np.cos(self._half), look, np.nan)

    def costs(self, look: Array) -> tuple[Array, Array]:
        """Return the cost of each entry (m,) for a coarse picture (k,).

        Where other fittings may follow its own, and where none does.
        """
        known = np.isfinite(look)
        # The costs only choose where fits start, so single precision is enough.
        seen = look[known].astype(np.float32)
        apart = (self.pictures[:, known] - seen) * self._sharp[:, known]
        apart *= apart
        level, cap = self._level[:, known].sum(axis=1), np.float32(RECOGNISER.library_cap)
        alone = apart / (1 + apart / cap)
        less = np.float32(RECOGNISER.beyond_rough**2) * cap
        followed = np.where(seen > self._beyond[:, known], apart / (1 + apart / less), alone)
        return level + followed.sum(axis=1), level + alone.sum(axis=1)


def _sharpness(pictures: Array) -> Array:
    """Return one over the standard deviation of each ray of pictures in the library.

    Pictures (starts, distances, turns, k), whose true distance and turn lie up to half a step
    beside.
    """
    spread = np.full(pictures.shape, RECOGNISER.library_blur**2)
    count = pictures.shape[1]
    if count > 1:
        steps = np.abs(np.diff(pictures, axis=1)) / 2
        before, after = np.minimum(np.arange(count), count - 2), np.maximum(np.arange(count) - 1, 0)
        spread += np.maximum(steps[:, before], steps[:, after]) ** 2
    if pictures.shape[2] > 1:
        steps = np.abs(pictures - np.roll(pictures, 1, axis=2)) / 2
        spread += np.maximum(steps, np.roll(steps, -1, axis=2)) ** 2
    return 1 / np.sqrt(spread)


def interpolated(picture: Array, directions: Array, optics: OpticsTable) -> Array:
    """Return values (k,) of a picture (pixels²,) in directions (k, 3), camera frame.

    Beyond its edge those at the edge.
    """
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


class Recogniser:
    """Recognises the fitting ahead of a robot in straight pipe of a known bore.

    Args:
        camera: at the robot's nose.
        bore: m.
        walls: makes the walls that rays meet, such as ``walls.rays.RayWalls``.
    """

    def __init__(self, camera: Camera, bore: float, walls: WallMaker) -> None:
        self._forms = forms(bore)
        self._joint = next(form for form in self._forms if form.name == "joint")
        self._dim = camera.lamp is not None
        self._bore, self._alike = bore, RECOGNISER.lamp_alike if self._dim else 1.0
        self._scale = VarianceStabiliser(camera)
        self._fit = Fit(camera, bore, walls, self._scale)
        self._library = Library(camera, bore, self._forms, walls, self._scale)
        rays, count = rays_of(camera.optics), camera.optics.pixels
        self._pixels = count * count
        grid = np.arange(count * count).reshape(count, count)
        half = np.radians(camera.optics.field_of_view_deg) / 2
        self._blind = bore / 2 / math.tan(half)  # m, from the lens to where it sees the wall
        corners = grid[[0, 0, -1, -1], [0, -1, 0, -1]]  # they show the vignetting
        inner = rays[:, 2] > math.cos(RECOGNISER.inner_part * half)
        self._grids = []
        for within, without in RECOGNISER.pixel_steps:
            every = np.union1d(grid[within // 2 :: within, within // 2 :: within], corners)
            some = np.zeros(count * count, bool)
            some[grid[within // 2 :: without, within // 2 :: without]] = True
            some[corners] = True
            pixels = every[(some | inner)[every]]
            row, column = np.divmod(every, count)
            over, beside = np.divmod(pixels, count)
            apart = np.abs(row[:, None] - over) + np.abs(column[:, None] - beside)
            self._grids.append((pixels, apart.argmin(axis=1)))
        border = math.cos(RECOGNISER.border_part * half)
        self._edge = (rays[self._grids[0][0], 2] < border).astype(float)

    def single(self, picture: Array, prior: PosePrior = CENTRED) -> Detection:
        """Return the detection in one picture (pixels²,) or (pixels, pixels).

        Such as ``result.pictures[i]``; for ``prior`` see ``approach``.
        """
        return self.approach(picture.reshape(1, -1), [STILL], prior)

    def approach(
        self, pictures: Array, motions: Sequence[Pose], prior: PosePrior = CENTRED
    ) -> Detection:
        """Return the detection at the last of some pictures.

        Args:
            pictures: (v, pixels²), of one approach.
            motions: poses of the camera at each of them, in its frame at the last one.
            prior: of the camera before the port through which it looks out of a fitting, from a
                map. By default the camera is in straight pipe: the edge of the picture tells its
                pose.

        Raises:
            ValueError: the pictures are not of the recogniser's camera.
        """
        if pictures.shape != (len(motions), self._pixels):
            raise ValueError(
                f"pictures of shape {pictures.shape}, not ({len(motions)}, {self._pixels}): one "
                "row for each motion, of as many pixels as the recogniser's camera has"
            )
        if np.isfinite(pictures).mean(axis=1).min() < RECOGNISER.min_valid:
            unknown = np.full((2, 2), np.inf)
            none = np.zeros(2)
            return Detection("straight", "", {}, 0.0, 0.0, unknown, 0.0, none, none)
        views = Views(self._scale.of(pictures), list(motions), prior)
        fits, straight = self._ranked(views)
        return self._detection(fits, straight, views)

    def _ranked(self, views: Views) -> tuple[Hypotheses, float]:
        """Return fits of the forms that may be ahead, and the free distance in straight pipe, m."""
        last, inside = Views(views.pictures[-1:], [STILL], views.prior), views.prior is not CENTRED
        pose = views.prior.mean if inside else self._pose(last)
        rough, straight = self._searched(last, pose)
        off = ((pose - views.prior.mean) / views.prior.std)[:DISTANCE]
        if inside:
            # A map tells the pose to a degree, and what fits the picture best tells it better.
            again, straight = self._searched(last, rough.numbers[rough.cost.argmin()])
            rough = joined([rough, again])
        elif off @ off > RECOGNISER.usual_stand:
            # A bend at the edge of the picture looks like a camera that leans.
            rough = joined([rough, self._searched(last, views.prior.mean)[0]])
        seen = rough.forms[int(rough.cost.argmin())].kind == "reducer"
        if self._dim or inside or seen:
            # Out of a fitting, no straight wall before the cone shows that it widens. And where it
            # shows, a fitting that hides its end makes it seem longer or shorter.
            rough = joined([rough, *self._with_reducers(rough, last)])
        # All pictures from here on: of one every pixel near the axis, of several every other one.
        many = len(views.motions)
        grid = 1 if many == 1 else 0
        start = hypotheses(rough.forms, rough.numbers, rough.sizes, many)
        fine = self._fit.refined(start, views, self._level(grid, RECOGNISER.search_loss), 2)
        level = self._level(grid, RECOGNISER.last_loss)
        fine = self._fit.refined(self._best_rows(fine, 2), views, level, 2)
        fine = self._best_directions(fine, views, level)
        return self._fit.refined(fine, views, level, RECOGNISER.last_steps), straight

    def _searched(self, last: Views, pose: Array) -> tuple[Hypotheses, float]:
        """Return rough fits to the last picture, and the free distance in straight pipe, m.

        The camera is at about ``pose`` (6,).
        """
        joints = self._fit.joints(self._forms[0], pose, last, self._level(1, RECOGNISER.last_loss))
        if last.prior is not CENTRED:
            # A fitting that follows another directly begins at the port itself.
            joints = [float(last.prior.mean[DISTANCE]), *joints]
        begin, straight, near = self._starts(last, pose, joints)
        wide = self._level(0, RECOGNISER.start_loss)
        begin = self._fit.costs(begin, last, wide)
        rough = self._fit.refined(self._best_rows(begin, 0), last, wide, 2)
        best: dict[int, int] = {}
        for i in np.argsort(rough.cost):
            best.setdefault(id(rough.forms[i]), int(i))  # of each form
        rough = self._best_rows(rough.take(list(best.values())), 1)
        rough = self._best_neighbours(rough, joints, last, self._level(0, RECOGNISER.compared_loss))
        rough = joined([rough, *self._restarted(rough, pose, joints, last)])
        rough = joined([rough, *self._between_joints(rough, last)])
        first = int(rough.cost.argmin())
        if self._dim and self._name(rough.forms[first], rough.numbers[first])[0] == "straight":
            nearby = self._near_candidates(near, pose, joints, last) if len(near) else []
            rough = joined([rough, *nearby, *self._lamp_candidates(pose, last)])
        return rough, straight

    def _best_directions(self, fits: Hypotheses, views: Views, level: Level) -> Hypotheses:
        """Return rows with the best of some directions close to their own."""
        n, m = len(fits.forms), len(RECOGNISER.fine_turns)
        rows = fits.take(np.repeat(np.arange(n), m).tolist())
        rows.numbers[:, TURN] += np.tile(RECOGNISER.fine_turns, n)
        cost = self._fit.costs(rows, views, level).cost.reshape(n, m)
        return rows.take((np.arange(n) * m + cost.argmin(axis=1)).tolist())

    def _level(self, grid: int, rough: float, *, edge: bool = False, free: str = "atdr") -> Level:
        pixels, stand = self._grids[grid]
        weight = self._edge if edge else np.ones(len(pixels))
        which = np.array([letter in free for letter in "aattdr"])
        return Level(pixels, stand, rough, which, weight, RECOGNISER.edge_reach[grid])

    def _best_neighbours(
        self, fits: Hypotheses, joints: Sequence[float], views: Views, level: Level
    ) -> Hypotheses:
        """Return rows with the best of other directions, starting sizes and visible joints."""
        rows = []
        for row, form in enumerate(fits.forms):
            numbers = fits.numbers[row]
            few = form.sizes and len(form.starts) <= RECOGNISER.few_starts
            part = _combined(
                fits.take([row]),
                sizes=[fits.sizes[row], *(form.padded_starts if few else ())],
                distances=[numbers[DISTANCE], *(joints[:1] if form.parameters else ())],
                turns=numbers[TURN] + RECOGNISER.rough_turns[: None if form.period else 1],
                stands=[numbers[:DISTANCE]],
            )
            best = self._fit.costs(part, views, level).cost.argmin()
            rows.append(part.take([int(best)]))
        return joined(rows)

    def _restarted(
        self, fits: Hypotheses, pose: Array, joints: Sequence[float], views: Views
    ) -> list[Hypotheses]:
        """Return rows of forms whose search begins again.

        From the best of other sizes and nearby distances.
        """
        # A search that errs in one of several numbers that are nearly confounded does not come out
        # of it.
        begin, most = [], RECOGNISER.restart_cost * fits.cost.min()
        for row, form in enumerate(fits.forms):
            sizes = form.restarts(fits.sizes[row])
            if not len(sizes) or fits.cost[row] > most:
                continue
            numbers, nearest = fits.numbers[row], views.prior.nearest
            offsets = numbers[DISTANCE] + RECOGNISER.restart_offsets
            places = np.unique(
                np.clip([*offsets, *joints], nearest, RECOGNISER.max_distance)
            ).tolist()
            part = _combined(
                replace(fits.take([row]), gains=np.ones((1, fits.gains.shape[1]))),
                sizes=sizes,
                distances=places,
                turns=[numbers[TURN]],
                stands=np.unique([pose[:DISTANCE], 0 * pose[:DISTANCE]], axis=0),
            )
            part = self._fit.costs(part, views, self._level(0, RECOGNISER.compared_loss))
            each = part.cost.reshape(len(sizes), -1).argmin(axis=1)
            each += np.arange(len(sizes)) * (len(part.forms) // len(sizes))
            each = each[np.argsort(part.cost[each], kind="stable")[: RECOGNISER.restart_sizes]]
            begin.append(part.take(each.tolist()))
        best = [_best(part) for part in self._refined(begin, views, 2)]
        return self._refined(best, views, 2)

    def _between_joints(self, fits: Hypotheses, views: Views) -> list[Hypotheses]:
        """Return the best reducer of each form as a piece of straight pipe between its joints."""
        # Two joints show the most of a shallow reducer, and a single one does not explain them.
        best: dict[int, int] = {}
        for i in np.argsort(fits.cost, kind="stable").tolist():
            if fits.forms[i].kind == "reducer":
                best.setdefault(id(fits.forms[i]), i)
        rows = []
        for i in best.values():
            sizes = np.zeros((1, SIZES))
            sizes[0, PIECE] = fits.sizes[i, LENGTH]
            rows.append(hypotheses([self._joint], fits.numbers[[i]], sizes, 1))
        return self._refined(rows, views, 2)

    def _with_reducers(self, fits: Hypotheses, views: Views) -> list[Hypotheses]:
        """Return rows of a reducer directly before the best of the fittings.

        And of the latter alone from where it lies then.
        """
        # The cone of a shallow one hardly shows, but what is behind it does: taken for a fitting in
        # this bore, it explains more pixels than a reducer with straight pipe behind it.
        order = np.argsort(fits.cost, kind="stable").tolist()
        most = fits.cost[order[0]] + RECOGNISER.follow_cost[2]
        if fits.forms[order[0]].kind == "reducer":
            others = [i for i in order if fits.forms[i].period]
        else:
            others = [i for i in order if fits.cost[i] < most and fits.forms[i].kind != "reducer"]
            if not fits.forms[others[0]].period:
                return []
        best: dict[int, int] = {}
        for i in others:
            if fits.forms[i].period and fits.numbers[i, DISTANCE] >= self._blind:
                best.setdefault(id(fits.forms[i]), i)  # of each form
        few = [fits.take([i]) for i in [*best.values()][: RECOGNISER.preceded]]
        begin = [self._reducer_starts(fits, behind, views) for behind in few]
        both = [
            part.take([int(part.cost.argmin())])
            for part in self._refined(
                [joined(rows) for rows in begin], views, RECOGNISER.chain_steps
            )
        ]
        alone = [
            self._second_fitting(chain, behind) for chain, behind in zip(both, few, strict=True)
        ]
        alone = self._refined(alone, views, 2)
        return [part for pair in zip(both, alone, strict=True) for part in pair]

    def _reducer_starts(
        self, fits: Hypotheses, behind: Hypotheses, views: Views
    ) -> list[Hypotheses]:
        """Return rows of every reducer before a fitting, from which a search begins.

        Directly before that of the only row of ``behind``.
        """
        order, starts = np.argsort(fits.cost, kind="stable").tolist(), []
        for reducer in (form for form in self._forms if form.kind == "reducer"):
            starts.append(self._reducer_before(behind, reducer, views))
            alone = [i for i in order if fits.forms[i] is reducer]
            if alone:
                own = fits.take(alone[:1])
                own.numbers[:, TURN] = behind.numbers[:, TURN]
                own.sizes[:, OWN:] = behind.sizes[:, :OWN]
                starts.append(replace(own, forms=starts[-1].forms[:1]))
        return starts

    def _second_fitting(self, both: Hypotheses, behind: Hypotheses) -> Hypotheses:
        """Return a row of the second of two fittings alone.

        That of ``behind``, from where it lies by a row of ``both``, it and a reducer.
        """
        end, length = both.sizes[0, :OWN].tolist()
        numbers, sizes = both.numbers.copy(), np.zeros((1, SIZES))
        numbers[0, DISTANCE] = (numbers[0, DISTANCE] + length) * self._bore / end
        sizes[:, :OWN] = both.sizes[:, OWN:]
        return hypotheses(behind.forms, numbers, sizes, 1)

    def _reducer_before(self, behind: Hypotheses, reducer: Form, views: Views) -> Hypotheses:
        """Return the best rows of a reducer of several lengths before a fitting.

        That of the only row of ``behind``, as of this bore.
        """
        start = min(reducer.starts, key=lambda sizes: abs(sizes[0] - self._bore))
        low, nearest = reducer.sizes[LENGTH].low, views.prior.nearest
        # A picture tells angles: what is wider by a factor is farther by it.
        far = behind.numbers[0, DISTANCE] * start[0] / self._bore
        most = min(self._bore, max(far - nearest, low) + low)
        chain, further = reducer.before(behind.forms[0]), behind.sizes[0, :OWN]
        rows = []
        for length in np.arange(low, most, RECOGNISER.restart_length * low):
            numbers = behind.numbers.copy()
            numbers[0, DISTANCE] = max(far - length, nearest)
            rows.append(hypotheses([chain], numbers, np.array([[start[0], length, *further]]), 1))
        return _best(self._fit.costs(joined(rows), views, self._level(0, RECOGNISER.compared_loss)))

    def _refined(self, rows: Sequence[Hypotheses], views: Views, steps: int) -> list[Hypotheses]:
        """Return several rows after steps of the search, made for all together."""
        if not rows:
            return []
        every = self._fit.refined(
            joined(rows), views, self._level(0, RECOGNISER.search_loss), steps
        )
        return every.split([len(row.forms) for row in rows])

    def _near_candidates(
        self, near: NDArray[np.intp], pose: Array, joints: Sequence[float], views: Views
    ) -> list[Hypotheses]:
        """Return rows of fittings so near that only parts of them show.

        Each from a search of its own, for those entries ``near`` of the library that the picture
        does not exclude.
        """
        best: dict[int, int] = {}
        for row in near.tolist():
            best.setdefault(int(self._library.entries.form[row]), row)
        begin = self._from_library(np.array([*best.values()], np.intp), pose)
        begin = self._fit.refined(begin, views, self._level(0, RECOGNISER.compared_loss), 2)
        return [begin, *self._restarted(begin, pose, joints, views)]

    def _lamp_candidates(self, pose: Array, views: Views) -> list[Hypotheses]:
        """Return rows of fittings in what seems straight pipe, each from a search of its own."""
        # By a lamp, distant things are dim and cover a few pixels at the middle of the picture,
        # which the coarse pictures of the library pass over.
        rows = []
        for form in self._forms:
            few = len(form.starts) <= RECOGNISER.dim_starts
            if form.make is None or form.kind == "straight" or not few:
                continue
            step = form.period / RECOGNISER.dim_turns
            part = _combined(
                hypotheses([form], np.zeros((1, PLACES)), np.zeros((1, SIZES)), 1),
                sizes=form.padded_starts,
                distances=RECOGNISER.dim_distances * self._bore,
                turns=np.arange(0.0, form.period, step) if form.period else [0.0],
                stands=[pose[:DISTANCE]],
            )
            part = self._fit.costs(part, views, self._level(0, RECOGNISER.compared_loss))
            rows.append(part.take([int(part.cost.argmin())]))
        return self._refined(rows, views, 2)

    def _pose(self, views: Views) -> Array:
        """Return the numbers (6,) of the camera in the pipe, from the edge of its picture.

        It shows straight wall.
        """
        begin = hypotheses([self._forms[0]], np.zeros((1, PLACES)), np.zeros((1, SIZES)), 1)
        for grid, rough, edge in (
            (0, RECOGNISER.pose_loss, True),
            (0, RECOGNISER.search_loss, True),
            (1, RECOGNISER.last_loss, False),
        ):
            level = self._level(grid, rough, free="at", edge=edge)
            begin = self._fit.refined(begin, views, level, 2)
        return begin.numbers[0]

    def _best_rows(self, fits: Hypotheses, stage: int) -> Hypotheses:
        """Return the best rows, the best ones of the best forms, and the straight pipe.

        All others have to beat the latter.
        """
        rows = np.argsort(fits.cost, kind="stable").tolist()
        least = fits.cost[rows[0]] + RECOGNISER.follow_cost[stage]
        kept = [i for i in rows if fits.cost[i] < least][: RECOGNISER.followed[stage]]
        first: dict[int, int] = {}
        for i in rows:
            first.setdefault(id(fits.forms[i]), i)  # the best of each form
        forms = [*first.values()][: RECOGNISER.follow_forms[stage]]
        straight = [i for i in first.values() if fits.forms[i] is self._forms[0]]
        # What is taken for two fittings may be the latter alone.
        latter = [fits.forms[i].behind for i in (*kept, *forms)]
        alone = [i for i in first.values() if fits.forms[i] in latter]
        return fits.take(list(dict.fromkeys([*kept, *forms, *straight, *alone])))

    def _starts(
        self, views: Views, pose: Array, joints: Sequence[float]
    ) -> tuple[Hypotheses, float, NDArray[np.intp]]:
        """Return starts of every form, the free distance, and entries that may be nearer.

        The distance is that in straight pipe, m; these entries of the library have a search of
        their own.
        """
        library, entries = self._library, self._library.entries
        cost, alone = library.costs(library.look(views.pictures[0], pose))
        place = entries.numbers[:, DISTANCE]
        possible = (place == 0) | (place > views.prior.nearest)
        chosen: list[int] = []
        places: list[float] = []
        for which in range(len(self._forms)):
            rows = np.flatnonzero((entries.form == which) & possible)
            kept = entries.distinct(rows[np.argsort(cost[rows])], self._bore)
            chosen += kept
            places += entries.numbers[kept, DISTANCE].tolist()
            for joint in joints if self._forms[which].parameters else ():
                off = np.abs(entries.numbers[rows, DISTANCE] - joint)
                near = rows[off < max(RECOGNISER.joint_distance * self._bore, off.min() + 1e-9)]
                if len(near):
                    chosen.append(int(near[np.argmin(cost[near])]))
                    places.append(joint)
        begin = self._from_library(np.array(chosen, np.intp), pose)
        begin.numbers[:, DISTANCE] = places
        plain = np.array([form.kind == "straight" for form in self._forms])[entries.form]
        possible &= ~plain & (alone < alone[plain].min() + RECOGNISER.excluded_cost)
        open_rows, near = np.flatnonzero(possible), np.array([], np.intp)
        if self._dim:
            # By a lamp, a shallow reducer that begins before the picture does hardly shows.
            before = entries.numbers[open_rows, DISTANCE] < self._blind
            near = self._not_excluded(open_rows[before], pose, views)
            open_rows = self._not_excluded(open_rows[~before], pose, views)
        straight = float(
            np.min(entries.numbers[open_rows, DISTANCE], initial=RECOGNISER.horizon * self._bore)
        )
        return begin, straight, near

    def _from_library(self, rows: NDArray[np.intp], pose: Array) -> Hypotheses:
        """Return entries of the library (m,) as seen by a camera at ``pose`` (6,)."""
        entries = self._library.entries
        forms, numbers = [self._forms[i] for i in entries.form[rows]], entries.numbers[rows]
        numbers[:, :DISTANCE] = pose[:DISTANCE]
        starts = zip(forms, entries.start[rows], strict=True)
        sizes = np.array([form.padded_starts[at] for form, at in starts])
        return hypotheses(forms, numbers, sizes, 1)

    def _not_excluded(self, rows: NDArray[np.intp], pose: Array, views: Views) -> NDArray[np.intp]:
        """Return the nearest of those entries of the library (m,) that no pixels exclude.

        By a lamp coarse pictures of shallow reducers are hardly those of straight pipe.
        """
        entries, level = self._library.entries, self._level(0, RECOGNISER.compared_loss)
        plain = hypotheses([self._forms[0]], np.zeros((1, PLACES)), np.zeros((1, SIZES)), 1)
        plain.numbers[:, :DISTANCE] = pose[:DISTANCE]
        most = self._fit.costs(plain, views, level).cost[0]
        most += RECOGNISER.excluded_cost * self._alike
        rows = rows[np.argsort(entries.numbers[rows, DISTANCE], kind="stable")]
        for first in range(0, len(rows), RECOGNISER.excluded_together):
            some = rows[first : first + RECOGNISER.excluded_together]
            near = self._fit.costs(self._from_library(some, pose), views, level).cost < most
            if near.any():
                return some[near]
        return rows[:0]

    def _at_mean_distance(
        self, fits: Hypotheses, views: Views, level: Level
    ) -> tuple[Hypotheses, float]:
        """Return a row of an end at its posterior mean distance, and the variance, m²."""
        # Gradients do not see the edge of an end; positions around it are weighed by likelihood.
        rows = fits.take([0] * len(RECOGNISER.end_offsets))
        rows.numbers[:, DISTANCE] = np.clip(
            rows.numbers[:, DISTANCE] + RECOGNISER.end_offsets, views.prior.nearest, None
        )
        cost = self._fit.costs(rows, views, level).cost / (
            2 * RECOGNISER.error_scale**2 * self._alike
        )
        chance = np.exp(cost.min() - cost)  # the least cost is subtracted against underflow
        chance /= chance.sum()
        distance = rows.numbers[:, DISTANCE]
        mean = float(chance @ distance)
        fits.numbers[0, DISTANCE] = mean
        return fits, float(chance @ (distance - mean) ** 2) + (
            RECOGNISER.end_offsets[1] - RECOGNISER.end_offsets[0]
        ) ** 2 / 12

    def _at_mean_angle(self, fits: Hypotheses, views: Views, level: Level) -> Hypotheses:
        """Return a row of an elbow at its posterior mean angle."""
        # Where its far end is hidden a picture hardly tells the angle, and noise has many minima.
        usual, width = RECOGNISER.usual_bend, RECOGNISER.usual_bend_std
        size = fits.forms[0].sizes[ANGLE]
        angles = np.clip(fits.sizes[0, ANGLE] + RECOGNISER.angle_offsets, size.low, size.high)
        rows = fits.take([0] * len(angles))
        rows.sizes[:, ANGLE] = angles
        cost = self._fit.costs(rows, views, level).cost / (
            2 * RECOGNISER.error_scale**2 * self._alike
        )
        # A bend is a usual one or, as often, any.
        near = np.exp(-0.5 * ((angles - usual) / width) ** 2) / (width * math.sqrt(2 * math.pi))
        chance = np.exp(cost.min() - cost) * (near + 1 / (size.high - size.low))
        fits.sizes[0, ANGLE] = float(chance @ angles / chance.sum())
        return fits

    def _detection(self, fits: Hypotheses, straight: float, views: Views) -> Detection:
        """Return the most probable of the forms, with its confidence."""
        level = self._level(0 if fits.gains.shape[1] > 1 else 1, RECOGNISER.last_loss)
        score = self._fit.scores(fits, views, level, self._alike)
        names = [self._name(form, at) for form, at in zip(fits.forms, fits.numbers, strict=True)]
        least = {
            name: min(s for s, n in zip(score, names, strict=True) if n == name) for name in names
        }
        best = int(np.argmin(score))
        confidence = 1 / sum(math.exp((score[best] - other) / 2) for other in least.values())
        row, variance = fits.take([best]), None
        pixels = len(level.pixels) * fits.gains.shape[1]
        misfit = min(fits.cost[best] / pixels, self._fit.misfit(row, views, level))
        if misfit > RECOGNISER.misfit_cost:
            confidence = min(confidence, RECOGNISER.misfit_confidence)
        if row.forms[0].ends:
            row, variance = self._at_mean_distance(row, views, level)
        elif row.forms[0].kind == "elbow":
            row = self._at_mean_angle(row, views, level)
        return _reported(row, names[best], straight, confidence, self._alike, variance)

    def _name(self, form: Form, numbers: Array) -> tuple[str, str]:
        """Return the kind and port of a form: beyond the horizon a pipe is straight."""
        straight = form.kind == "straight" or numbers[DISTANCE] > RECOGNISER.horizon * self._bore
        return ("straight", "") if straight else (form.kind, form.enter)


def _best(fits: Hypotheses) -> Hypotheses:
    """Return the best rows, as many as are followed."""
    return fits.take(np.argsort(fits.cost, kind="stable")[: RECOGNISER.restarts].tolist())


def _combined(
    start: Hypotheses,
    *,
    sizes: Iterable[Array],
    distances: Iterable[float],
    turns: Iterable[float],
    stands: Iterable[Array],
) -> Hypotheses:
    """Return copies of the only row of ``start`` at all combinations of values.

    Sizes (SIZES,), distances, m, directions, rad, and poses (4,) of the camera across the pipe.
    """
    every = list(product(sizes, distances, turns, stands))
    rows = start.take([0] * len(every))
    for i, (size, distance, turn, stand) in enumerate(every):
        rows.sizes[i], rows.numbers[i] = size, [*stand, distance, turn]
    return rows


def _reported(
    fits: Hypotheses,
    name: tuple[str, str],
    straight: float,
    confidence: float,
    alike: float,
    variance: float | None,
) -> Detection:
    """Return the detection of a row; ``variance``, m², of the distance of an end."""
    form, numbers = fits.forms[0], fits.numbers[0]
    plain = name[0] == "straight"
    sizes = () if plain else form.own_sizes
    covariance = RECOGNISER.error_scale**2 * alike * np.linalg.inv(fits.normal[0])
    if variance is not None:
        covariance[DISTANCE] = covariance[:, DISTANCE] = 0.0
        covariance[DISTANCE, DISTANCE] = variance
    for i, size in enumerate(sizes, start=PLACES):
        covariance[i, i] += (size.step / 2) ** 2
    told = [DISTANCE, TURN, *range(PLACES, PLACES + len(sizes))]
    return Detection(
        *name,
        {size.key: float(fits.sizes[0, i]) for i, size in enumerate(sizes)},
        straight if plain else float(numbers[DISTANCE]),
        0.0 if plain or not form.period else float(wrap_angle(numbers[TURN])),
        np.full((2, 2), np.inf) if plain else covariance[np.ix_(told, told)],
        confidence,
        numbers[ASIDE],
        numbers[TILT],
    )
