"""Fits of hypotheses to pictures: robust damped least squares on variance-stabilised pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.candidates import reprojected
from omnitrack_sim.autonomy.recognition.forms import (
    DISTANCE,
    PLACES,
    SIZES,
    TURN,
    Form,
    PosePrior,
    WallMaker,
    cameras,
)
from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Part
from omnitrack_sim.senses.optics import Camera, rays_of
from omnitrack_sim.walls.rays import JOINT, PART, RANGE, RayWalls


class VarianceStabiliser:
    """Variance-stabilising transform of a camera: integral of 1 / std from 0 to a pixel's value.

    A difference of 1 is one standard deviation anywhere. Pixels that are no number are replaced by
    the top of the range.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.top = max(camera.optics.far, 1.0)
        self._values = np.linspace(0.0, self.top, RECOGNISER.scale_values)
        spread = camera.spread(self._values[None])[0]
        # The trapezoidal rule for the integral of one over the standard deviation.
        steps = (1 / spread[1:] + 1 / spread[:-1]) / 2 * np.diff(self._values)
        self._steps = np.concatenate([[0.0], np.cumsum(steps)])

    def of(self, picture: Array) -> Array:
        """Return the transform of a picture (...,)."""
        filled = np.where(np.isnan(picture), self.top, picture)
        return np.interp(filled, self._values, self._steps)

    def slope(self, expected: Array) -> Array:
        """Change on the scale with the pixel's value (...,); 0 without an answer."""
        spread = self._camera.spread(np.where(np.isnan(expected), self.top, expected))
        return np.where(np.isnan(expected), 0.0, 1 / spread)


CameraKey = tuple[int, str, bytes, bytes]
"""A camera among the walls of a form: number of its rays, name and sizes of the form, numbers of
the camera."""
_EDGES = DISTANCE, TURN
"""Places of the numbers that move the edges of shadows in a picture."""
_COLUMNS = ("numbers", "sizes", "gains", "cost", "normal")


@dataclass(frozen=True)
class Views:
    """Pictures of one approach.

    Attributes:
        pictures: (v, pixels²) on the scale.
        motions: poses of the v cameras, in the frame of the last one.
        prior: of the camera's numbers at the last picture.
        hit_cache: hits and ``beyond`` of cameras that the search comes by again; see ``Fit``.
    """

    pictures: Array
    motions: list[Pose]
    prior: PosePrior
    hit_cache: dict[CameraKey, tuple[Array, Array]] = field(default_factory=dict)


@dataclass(frozen=True)
class Level:
    """Resolution and robustness of a fit.

    Attributes:
        pixels: (k,) numbers of the pixels.
        stand: (s,) for each pixel of a regular grid over the whole picture, the index in ``pixels``
            of the nearest one: the exposure is computed over these.
        loss_scale: of the Geman-McClure loss, in standard deviations.
        free: which of the six numbers of a camera are sought.
        weight: (k,) of each pixel.
        reach: m along the pipe and rad about it, steps of the finite differences by a lamp: wide
            enough to move the edges of shadows.
    """

    pixels: NDArray[np.intp]
    stand: NDArray[np.intp]
    loss_scale: float
    free: NDArray[np.bool_]
    weight: Array
    reach: tuple[float, float]


@dataclass(frozen=True)
class Hypotheses:
    """Forms that are fitted, n rows.

    Attributes:
        forms: of each row.
        numbers: (n, 6), see ``cameras``.
        sizes: (n, SIZES).
        gains: (n, v).
        cost: (n,) twice the negative logarithm of the likelihood, without what all share.
        normal: (n, p, p) matrix of the normal equations, of numbers, sizes, gains.
    """

    forms: tuple[Form, ...]
    numbers: Array
    sizes: Array
    gains: Array
    cost: Array
    normal: Array

    def take(self, rows: Sequence[int]) -> Hypotheses:
        """Some of the rows."""
        rows = list(rows)
        return Hypotheses(
            tuple(self.forms[i] for i in rows),
            *(getattr(self, name)[rows] for name in _COLUMNS),
        )

    def split(self, counts: Sequence[int]) -> list[Hypotheses]:
        """The first rows, the next ones and so on, as many as the ``counts``."""
        ends = np.cumsum(counts).tolist()
        return [self.take(range(end - k, end)) for end, k in zip(ends, counts, strict=True)]


def hypotheses(forms: Sequence[Form], numbers: Array, sizes: Array, views: int) -> Hypotheses:
    """Rows to begin with."""
    n, p = len(forms), PLACES + SIZES + views
    cost, normal = np.full(n, np.inf), np.tile(np.eye(p), (n, 1, 1))
    return Hypotheses(tuple(forms), numbers, sizes, np.ones((n, views)), cost, normal)


def joined(rows: Sequence[Hypotheses]) -> Hypotheses:
    """Rows of several in one."""
    columns = [np.concatenate([getattr(row, name) for row in rows]) for name in _COLUMNS]
    return Hypotheses(tuple(form for row in rows for form in row.forms), *columns)


def merged(better: NDArray[np.bool_], first: Hypotheses, second: Hypotheses) -> Hypotheses:
    """Rows of the first where it is better, of the second elsewhere."""
    values = {}
    for name in _COLUMNS:
        one, other = getattr(first, name), getattr(second, name)
        values[name] = np.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, other)
    return Hypotheses(first.forms, **values)


class Fit:
    """Fits forms to the pictures of a camera in pipes of a bore."""

    def __init__(
        self, camera: Camera, bore: float, walls: WallMaker, scale: VarianceStabiliser
    ) -> None:
        self._camera, self._bore, self._walls, self._scale = camera, bore, walls, scale
        self._rays = rays_of(camera.optics)
        self._kept: dict[tuple[str | float, ...], tuple[RayWalls, Array]] = {}

    def refined(self, start: Hypotheses, views: Views, level: Level, steps: int) -> Hypotheses:
        """Rows after steps of the search; none is worse than it was.

        Each step is tried with several dampings at once, and the best is taken: edges make the
        slopes rough.
        """
        best = self.costs(start, views, level)
        for number in range(steps):
            side = -1.0 if number % 2 else 1.0  # edges may be on either side
            normal, gradient = self._equations(best, views, level, side)
            best = replace(best, normal=normal)
            stepped = [_stepped(best, gradient, each, views) for each in RECOGNISER.dampings]
            # All together: calls for a few rows take most of their time for themselves.
            tried = self.costs(joined(stepped), views, level)
            tried = tried.split([len(best.forms)] * len(stepped))
            least = np.argmin([best.cost, *(row.cost for row in tried)], axis=0)
            for i, row in enumerate(tried, 1):
                best = merged(least == i, row, best)
        return best

    def costs(self, at: Hypotheses, views: Views, level: Level) -> Hypotheses:
        """Return the rows with their costs: twice the negative log posterior."""
        pictures = views.pictures[:, level.pixels]
        hits, beyond = self._hits_of(at, views, level)
        image = self._image(hits, level)
        cost = _loss(
            pictures - self._scale.of(image * at.gains[..., None]), pictures > beyond, level
        ).sum(axis=(1, 2))
        weights, off = _prior(at, views, level)
        return replace(
            at,
            cost=cost
            + (np.where(weights < RECOGNISER.fixed_weight, weights, 0) * off**2).sum(axis=1),
        )

    def misfit(self, at: Hypotheses, views: Views, level: Level) -> float:
        """Return the mean cost of the only row's pixels that show no more than its form."""
        pictures = views.pictures[:, level.pixels]
        hits, beyond = self._hits_of(at, views, level)
        image = self._scale.of(self._image(hits, level) * at.gains[..., None])
        own = pictures <= beyond
        cost = _loss(pictures - image, ~own, level)
        return float(cost[own].mean()) if own.mean() > RECOGNISER.min_own else np.inf

    def scores(self, at: Hypotheses, views: Views, level: Level, alike: float) -> Array:
        """Twice the negative logarithm of the evidence (n,) for each row, without what all share.

        Laplace's approximation: each fitted parameter adds the Occam term
        2 log(prior std / posterior std).

        Args:
            at: the rows.
            views: the pictures.
            level: of the comparison.
            alike: pixels of which the errors are alike.
        """
        weights, _ = _prior(at, views, level)
        for place, width in ((DISTANCE, RECOGNISER.max_distance), (TURN, 2 * np.pi)):
            sought = weights[:, place] < RECOGNISER.fixed_weight
            weights[sought, place] = 2 * np.pi / width**2
        sought = (weights < RECOGNISER.fixed_weight).sum(axis=1)
        known = np.linalg.slogdet(at.normal)[1] - sought * np.log(alike)
        return at.cost / alike + known - np.log(weights).sum(axis=1)

    def _equations(
        self, at: Hypotheses, views: Views, level: Level, side: float
    ) -> tuple[Array, Array]:
        """Matrix (n, p, p) of the normal equations and the gradient (n, p)."""
        residual, rough, slopes = self._linearised(at, views, level, side)
        weight = np.tile(level.weight, at.gains.shape[1])
        weighted = slopes * (weight / (1 + (residual / rough) ** 2) ** 2)[..., None]
        weights, off = _prior(at, views, level)
        normal = weighted.swapaxes(1, 2) @ slopes + np.eye(off.shape[1]) * weights[:, None]
        return normal, (weighted * residual[..., None]).sum(axis=1) - weights * off

    def _linearised(
        self, at: Hypotheses, views: Views, level: Level, side: float
    ) -> tuple[Array, Array, Array]:
        """Return residuals, what they lose their weight at, and the Jacobian.

        (n, v k), (n, v k), (n, v k, p).
        """
        n, v, k = len(at.forms), len(views.motions), len(level.pixels)
        hits, beyond = self._hits_of(at, views, level)
        expected, moved = self._moved(at, hits, views, level)
        slopes = np.zeros((n, v, k, PLACES + SIZES + v))
        for i, image in moved.items():
            rows = [form.sought[i] for form in at.forms]
            slopes[rows, ..., i] = (image - expected)[rows] / RECOGNISER.nudge[i]
        changes = [*self._changed(at, level, side)]
        if changes:
            together = joined([changed for _, _, changed, _ in changes])
            images = self._image(self._hits_of(together, views, level)[0], level)
            ends = np.cumsum([len(rows) for _, rows, _, _ in changes])[:-1]
            for (column, rows, _, by), image in zip(changes, np.split(images, ends), strict=True):
                slopes[rows, ..., column] = (image - expected[rows]) / by[:, None, None]
        gained = expected * at.gains[..., None]
        pictures = views.pictures[None, :, level.pixels]
        residual = pictures - self._scale.of(gained)
        rough = _rough(pictures > beyond, level)
        slopes *= at.gains[..., None, None]
        for i in range(v):
            slopes[:, i, :, PLACES + SIZES + i] = expected[:, i]
        slopes *= self._scale.slope(gained)[..., None]
        slopes = np.nan_to_num(slopes, copy=False)
        flat = n, v * k
        return residual.reshape(flat), rough.reshape(flat), slopes.reshape(*flat, -1)

    def _moved(
        self, at: Hypotheses, hits: Array, views: Views, level: Level
    ) -> tuple[Array, dict[int, Array]]:
        """Return the pictures that are expected, and those after small motions of the camera.

        (n, v, k), from hits (n, v, k, 8); the latter by the places in its numbers that change.
        """
        n, v, k, rays = *hits.shape[:3], self._rays[level.pixels]
        lamp = self._camera.lamp
        free = [i for i in np.flatnonzero(level.free).tolist() if lamp is None or i not in _EDGES]
        nudges = np.concatenate([np.zeros((1, PLACES)), np.diag(RECOGNISER.nudge)[free]])
        numbers = (at.numbers + nudges[:, None]).reshape(-1, PLACES)
        place, rotation = cameras(numbers, views.motions)
        near = _nearby(
            hits.reshape(n * v, k, -1),
            rays,
            place.reshape(len(nudges), n * v, 3),
            rotation.reshape(len(nudges), n * v, 3, 3),
            lamp,
        )
        expected, *images = self._image(near.reshape(-1, n, v, k, near.shape[-1]), level)
        return expected, dict(zip(free, images, strict=True))

    def _changed(
        self, at: Hypotheses, level: Level, side: float
    ) -> Iterator[tuple[int, NDArray[np.intp], Hypotheses, Array]]:
        """Yield what changes in each column of the Jacobian that needs rays of its own.

        The column, the rows (m,) that it counts for, these rows changed, and by how much (m,).
        """
        if self._camera.lamp is not None:
            # The edges of shadows tell most, and they move: hits from close by do not show it.
            for i in _EDGES:
                rows = np.flatnonzero([level.free[i] and form.sought[i] for form in at.forms])
                if len(rows):
                    reach = side * level.reach[i - DISTANCE]
                    part = at.take(rows.tolist())
                    farther = replace(part, numbers=part.numbers + reach * np.eye(PLACES)[i])
                    yield i, rows, farther, np.full(len(rows), reach)
        for i in range(SIZES):
            rows = np.flatnonzero([len(form.sizes) > i for form in at.forms])
            if len(rows):
                part = at.take(rows.tolist())
                steps = np.array([form.sizes[i].step for form in part.forms])
                high = np.array([form.sizes[i].high for form in part.forms])
                # Inwards at the upper bound, where larger sizes do not exist.
                steps = np.where(part.sizes[:, i] + steps > high, -steps, steps)
                larger = replace(part, sizes=part.sizes + steps[:, None] * np.eye(SIZES)[i])
                yield PLACES + i, rows, larger, steps

    def joints(self, straight: Form, pose: Array, views: Views, level: Level) -> list[float]:
        """Return the distances, m, at which the last picture shows joints of straight pipes.

        Best first; none where a joint does not show.

        Args:
            straight: the form.
            pose: (6,) of the camera.
            views: the pictures.
            level: of the comparison.
        """
        at = hypotheses([straight], pose[None], np.zeros((1, SIZES)), len(views.motions))
        hits = self._hits_of(at, views, level)[0][0, -1]
        rotation = cameras(pose[None], views.motions[-1:])[1][0, 0]
        along = hits[:, RANGE] * (self._rays[level.pixels] @ rotation.T)[:, 2]
        where = np.arange(*RECOGNISER.joint_range)
        other = np.repeat(hits[None], len(where) + 1, axis=0)
        other[1:, :, JOINT] = np.abs(along - where[:, None])
        expected = self._scale.of(self._image(other, level))
        missed = ((views.pictures[-1, level.pixels] - expected) / level.loss_scale) ** 2
        cost = level.loss_scale**2 * (missed / (1 + missed)).sum(axis=1)
        less = cost[0] - cost[1:]
        least = np.r_[True, less[1:] >= less[:-1]] & np.r_[less[:-1] >= less[1:], True]
        visible = np.flatnonzero(least & (less > RECOGNISER.joint_cost))
        return where[visible[np.argsort(-less[visible])]][: RECOGNISER.joints].tolist()

    def _walls_of(self, form: Form, sizes: Array) -> tuple[RayWalls, Array]:
        """Walls of a form and its exits, which are kept: many steps come by the same sizes."""
        values = sizes[: len(form.sizes)].tolist()
        key = (form.name, *values)
        kept = self._kept.get(key)
        if kept is None:
            parts, closed = form.map(values, self._bore)
            kept = self._walls([parts], [closed]), exits_of(parts)
            if len(self._kept) >= RECOGNISER.kept_walls:  # the oldest ones go first
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = kept
        return kept

    def _image(self, hits: Array, level: Level) -> Array:
        """Pictures (..., k) that are expected of hits (..., k, 8), exposed as whole ones."""
        # What pixels stand for counts in the exposure alone.
        flat, rays = hits.reshape(-1, *hits.shape[-2:]), self._rays[level.pixels]
        return self._camera.expected(flat, rays, level.stand).reshape(hits.shape[:-1])

    def _hits_of(self, at: Hypotheses, views: Views, level: Level) -> tuple[Array, Array]:
        """Return the hits of the cameras of all rows, and the values of ``beyond``.

        (n, v, k, 8) and (n, v, k) on the scale.
        """
        k, met = len(level.pixels), views.hit_cache
        keys = [
            (k, form.name, sizes[: len(form.sizes)].tobytes(), numbers.tobytes())
            for form, sizes, numbers in zip(at.forms, at.sizes, at.numbers, strict=True)
        ]
        new = {key: row for row, key in enumerate(keys) if key not in met}
        found = None
        if new:
            found = self._traced(at.take([*new.values()]), views, level)
            met.update(zip(new, zip(*found, strict=True), strict=True))
        if found is None or len(new) < len(keys):
            every = [met[key] for key in keys]
            found = np.stack([hits for hits, _ in every]), np.stack([least for _, least in every])
        for key in list(islice(met, max(len(met) - RECOGNISER.kept_cameras, 0))):
            del met[key]  # the oldest ones go first
        return found

    def _traced(self, at: Hypotheses, views: Views, level: Level) -> tuple[Array, Array]:
        """As ``_hits_of``, by tracing all rays."""
        n, v, rays = len(at.forms), len(views.motions), self._rays[level.pixels]
        place, rotation = cameras(at.numbers, views.motions)
        place, rotation = place.reshape(-1, 3), rotation.reshape(-1, 3, 3)
        kept = [self._walls_of(*row) for row in zip(at.forms, at.sizes, strict=True)]
        # Rows of equal walls share them; all are traced together.
        distinct = {id(walls): walls for walls, _ in kept}
        number = {key: i for i, key in enumerate(distinct)}
        which = np.repeat([number[id(walls)] for walls, _ in kept], v)
        walls = RayWalls.joined([*distinct.values()])
        far, lamp = self._camera.optics.far, self._camera.lamp
        hits = walls.trace(which, place, rotation, rays, far, lamp)
        exits = np.zeros((n, max(len(exits) for _, exits in kept), 6))
        for row, (_, own) in enumerate(kept):
            exits[row, : len(own)] = own
        least = beyond(hits, place, rotation, rays, np.repeat(exits, v, axis=0), self._scale, lamp)
        return hits.reshape(n, v, len(rays), -1), least.reshape(n, v, -1)


def exits_of(parts: Sequence[Part]) -> Array:
    """Return position and direction (parts, 6) of the ports by which a form is left.

    Of the straights beyond its fittings; 0 of the other parts.
    """
    exits = np.zeros((len(parts), 6))
    for i, part in enumerate(parts[2:], 2):  # after the straight before it and the fitting
        if not part.fitting.is_plain:  # another fitting directly behind
            continue
        port = part.port("start")
        exits[i] = *port.position, *-port.rotation[:, 2]
    return exits


def beyond(
    hits: Array,
    place: Array,
    rotation: Array,
    rays: Array,
    exits: Array,
    scale: VarianceStabiliser,
    lamp: Array | None,
) -> Array:
    """Return the transformed value (m, k) of each ray at the plane where it leaves the form.

    Beyond that a picture may show a fitting that is not modelled. Infinite for rays that do not
    leave; for those that do by a lamp, minus infinity.

    Args:
        hits: (m, k, 8).
        place: (m, 3) m, of the cameras.
        rotation: (m, 3, 3) of the cameras.
        rays: (k, 3), camera frame.
        exits: (m, parts, 6), of their forms; see ``exits_of``.
        scale: of the camera.
        lamp: of the camera.
    """
    least, part = np.full(hits.shape[:2], np.inf), hits[..., PART]
    for number in range(2, exits.shape[1]):
        leaves = np.any(exits[:, number] != 0, axis=-1, keepdims=True)
        camera, ray = np.nonzero((part == number) & leaves)
        if lamp is not None:
            least[camera, ray] = -np.inf
            continue
        # A wall nearer than the exit contradicts the form all the same.
        position, direction = exits[:, number, :3], exits[:, number, 3:]
        away = ((position - place) * direction).sum(axis=-1)
        along = (direction[:, None] @ rotation)[:, 0] @ rays.T  # (m, k)
        reach = away[camera] / np.maximum(along[camera, ray], 1e-6)
        least[camera, ray] = scale.of(reach) - RECOGNISER.exit_error
    return least


def _rough(free: NDArray[np.bool_], level: Level) -> Array:
    """Standard deviations at which pixels lose their weight; less where they are ``free``."""
    return np.where(free, RECOGNISER.beyond_rough * level.loss_scale, level.loss_scale)


def _loss(residual: Array, free: NDArray[np.bool_], level: Level) -> Array:
    """Costs of pixels with a residual; those that are ``free`` may show something else."""
    # The loss of Geman and McClure: a pixel that misses by far costs a constant.
    rough = _rough(free, level)
    missed = (residual / rough) ** 2
    # A lower bound also lowers the mean cost of noise, which must not speak for a form.
    bias = free * RECOGNISER.beyond_bias
    return level.weight * (rough**2 * missed / (1 + missed) + bias)


def _nearby(hits: Array, rays: Array, place: Array, rotation: Array, lamp: Array | None) -> Array:
    """Return hits (f, m, k, 8) of cameras at f poses close together, from those at the first.

    Poses (f, m, 3), (f, m, 3, 3), hits (m, k, 8). The joint at the port plane, z = 0, stays where
    it is.
    """
    f, m = place.shape[:2]
    near = reprojected(hits, rays, place[0], rotation[0], place, rotation, lamp)
    if lamp is None:
        return near
    reach = np.where(np.isfinite(near[..., RANGE]), near[..., RANGE], 0.0)
    ahead = (rotation[:, :, 2].reshape(f * m, 3) @ rays.T).reshape(reach.shape)
    along = np.abs(place[..., 2, None] + reach * ahead)
    joint = hits[..., JOINT]
    at_plane = np.abs(along[0] - np.where(np.isfinite(joint), joint, -1.0)) < 1e-6
    near[..., JOINT] = np.where(at_plane, along, joint)
    return near


def _prior(at: Hypotheses, views: Views, level: Level) -> tuple[Array, Array]:
    """Return the weights (n, p) of the priors, and the deviations (n, p) from their means."""
    n, v = at.gains.shape
    weights = np.full((n, PLACES + SIZES + v), RECOGNISER.fixed_weight)
    off = np.zeros(weights.shape)
    weights[:, PLACES + SIZES :], off[:, PLACES + SIZES :] = (
        1 / RECOGNISER.gain_std**2,
        at.gains - 1,
    )
    sought = level.free & np.array([form.sought for form in at.forms])
    places = slice(0, PLACES)
    weights[:, places] = np.where(sought, 1 / views.prior.std**2, RECOGNISER.fixed_weight)
    # Distance and direction are free: their widths serve the normal equations alone.
    across = slice(0, DISTANCE)
    off[:, across] = np.where(sought, at.numbers - views.prior.mean, 0.0)[:, across]
    for j, form in enumerate(at.forms):
        for s, size in enumerate(form.sizes):
            weights[j, PLACES + s] = 1 / size.spread**2
            off[j, PLACES + s] = at.sizes[j, s] - size.middle
    return weights, off


def _stepped(at: Hypotheses, gradient: Array, damping: float, views: Views) -> Hypotheses:
    """Rows one step on."""
    p = at.normal.shape[1]
    scale = np.eye(p) * np.diagonal(at.normal, axis1=1, axis2=2)[:, None]
    step = np.linalg.solve(at.normal + damping * scale, gradient[..., None])[..., 0]
    moved = np.clip(step[:, :PLACES], -RECOGNISER.max_step, RECOGNISER.max_step)
    sizes = at.sizes.copy()
    for j, form in enumerate(at.forms):
        for s, size in enumerate(form.sizes):
            most = RECOGNISER.max_size_step * size.step
            changed = sizes[j, s] + np.clip(step[j, PLACES + s], -most, most)
            grain = size.step / RECOGNISER.size_grain  # equal sizes share their walls
            sizes[j, s] = np.clip(round(changed / grain) * grain, size.low, size.high)
    numbers = at.numbers + moved
    numbers[:, DISTANCE] = np.clip(
        numbers[:, DISTANCE], views.prior.nearest, RECOGNISER.max_distance
    )
    gains = np.clip(at.gains + step[:, PLACES + SIZES :], *RECOGNISER.gain_range)
    return replace(at, numbers=numbers, sizes=sizes, gains=gains)
