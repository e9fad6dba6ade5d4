"""Compare poses of robots with their pictures, limbs and gravity, on the maps that they know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pose_filter import POSE
from omnitrack_sim.base.rotations import Array, cross, dot, orthonormal, skew, turned_by
from omnitrack_sim.robots.odometry import Limbs
from omnitrack_sim.senses.optics import Mount
from omnitrack_sim.senses.settings import FilterTable
from omnitrack_sim.walls.rays import BEYOND, LIT, NORMALS, PART, RANGE, RayWalls


@dataclass(frozen=True)
class CandidateSettings:
    """Tolerances of comparing poses with pictures, limbs and gravity.

    Attributes:
        max_range_ratio: most by which ranges in pictures from places close together differ, as a
            factor either way: farther from there the wall is flat no longer, and where a ray grazes
            it, its tangent plane is no guide.
        huber: residual, in standard deviations, from which on it is down-weighted (Huber).
        min_valid_share: part of a picture's pixels that have to be comparable for a misfit of the
            map.
        max_error: residual, in standard deviations, at which the cost of a pixel stays: at an edge
            between near and far wall a pixel is as wrong as it can be.
        shift: m, and rad of rotations, between the pictures whose differences are the gradients of
            a picture: less than a pixel, and far more than rounding.
        distinct_turn: rad, rotation from which on two poses are different answers.
        distinct_place: m, the same of positions.
        blurs: factors of the pixels' standard deviations, of each improvement of the best
            candidates: first those are far apart, and a pixel differs by that much between two of
            them.
        finalists: number of candidates that are improved and compared again.
        max_shift: m, by which an improvement moves a candidate at most.
        max_turn: rad, the same of its rotation.
    """

    max_range_ratio: float = 1.4
    huber: float = 2.0
    min_valid_share: float = 0.1
    max_error: float = 3.0
    shift: float = 5e-4
    distinct_turn: float = 0.3
    distinct_place: float = 0.06
    blurs: tuple[float, ...] = (4.0, 4.0, 4.0, 2.0, 2.0, 1.0)
    finalists: int = 8
    max_shift: float = 0.03
    max_turn: float = 0.2


CANDIDATES = CandidateSettings()


def reprojected(
    hits: Array,
    rays: Array,
    place: Array,
    frame: Array,
    other: Array,
    turned: Array,
    lamp: Array | None,
) -> Array:
    """Return the hits (..., k, 8) of cameras from those of cameras close to them, without tracing.

    The wall is taken to be flat about each hit. Edges and shadows stay at their pixels. Shapes
    before those of each camera are broadcast: many may be close to the same one.

    Args:
        hits: (..., k, 8) of the cameras close to them.
        rays: (k, 3), camera frame.
        place: (..., 3) m, of the cameras of the hits.
        frame: (..., 3, 3), the same.
        other: (..., 3) m, of the other cameras.
        turned: (..., 3, 3), the same.
        lamp: (3,) m, camera frame.
    """
    normal, reach = hits[..., NORMALS], hits[..., RANGE]
    met = np.isfinite(reach)
    reach = np.where(met, reach, 1.0)
    before = np.einsum("...ij,kj->...ki", frame, rays)
    after = np.einsum("...ij,kj->...ki", turned, rays)
    ahead = reach * dot(normal, before) + dot(normal, (place - other)[..., None, :])
    far = ahead / np.minimum(dot(normal, after), -1e-9)
    near = np.broadcast_to(hits, (*far.shape, hits.shape[-1])).copy()
    low, high = reach / CANDIDATES.max_range_ratio, reach * CANDIDATES.max_range_ratio
    near[..., RANGE] = np.where(met, np.clip(far, low, high), np.inf)
    if lamp is not None:
        reach = np.where(met, near[..., RANGE], 1.0)
        at_lamp = np.einsum("...ij,j->...i", turned, lamp)[..., None, :]
        to_lamp = at_lamp - reach[..., None] * after
        facing = dot(to_lamp, normal) / np.sqrt(dot(to_lamp, to_lamp))
        near[..., LIT] = np.where(hits[..., LIT] > 0, np.maximum(facing, 0.0), 0.0)
    return near


def of_limbs(
    limbs: Limbs,
    walls: RayWalls,
    which: NDArray[np.intp],
    position: Array,
    rotation: Array,
    covariance: Array,
    std: float,
) -> tuple[Array, Array]:
    """Measurement that pressed limbs touch the wall where they reach.

    Args:
        limbs: of the robots.
        walls: of the maps.
        which: (n,) map of each robot.
        position: (n, 3) m, estimate.
        rotation: (n, 3, 3), estimate.
        covariance: (n, 6, 6) of the estimate.
        std: m, standard deviation of the place of a contact.

    Returns:
        Information matrix and vector, see ``normal_equations``.
    """
    place = limbs.points  # (n, b, p, 3), robot frame
    lever = np.einsum("nij,nmkj->nmki", rotation, place).reshape(len(place), -1, 3)
    distance, gradient, part = walls.nearest(which, position[:, None] + lever)
    distance, part = distance.reshape(place.shape[:3]), part.reshape(place.shape[:3])
    # Jacobian of the distances to the pose: of the position, then of the rotation.
    slopes = np.concatenate([gradient, cross(lever, gradient)], axis=-1)
    touching = distance.argmin(axis=-1)[..., None]
    gap = np.take_along_axis(distance, touching, axis=-1)[..., 0]
    slopes = slopes.reshape(*place.shape[:3], POSE)
    slopes = np.take_along_axis(slopes, touching[..., None], axis=2)[:, :, 0]
    # What neither the doubt of the contact nor that of the pose explains is a limb that swings out
    # over an opening, and touches nothing.
    doubt = np.einsum("nmi,nij,nmj->nm", slopes, covariance, slopes) + std**2
    held = limbs.pressed & np.all(part >= 0, axis=-1)
    held &= gap**2 < CANDIDATES.max_error**2 * doubt
    return normal_equations(slopes, -gap, held * huber(gap / std) / std**2)


def of_gravity(
    gravity: Array, force: Array, rotation: Array, std: float, valid: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Measurement of gravity by accelerometers, which at rest measure what holds a robot up.

    Args:
        gravity: (n, 3) m/s², world frame.
        force: (n, 3) m/s², measured, robot frame.
        rotation: (n, 3, 3), estimate.
        std: m/s², standard deviation.
        valid: (n,) robots that it is taken for.

    Returns:
        Information matrix and vector, see ``normal_equations``.
    """
    held = -np.einsum("nij,nj->ni", rotation, force)  # (n, 3) world
    error = gravity - held
    slopes = np.zeros((len(held), 3, POSE))
    slopes[:, :, 3:] = -skew(held)
    weight = np.where(valid, 1.0 / std**2, 0.0)
    return normal_equations(slopes, error, np.repeat(weight[:, None], 3, axis=1))


def normal_equations(slopes: Array, error: Array, weight: Array) -> tuple[Array, Array]:
    """Return the information matrix J' W J (n, 6, 6) and vector J' W r (n, 6) of measurements.

    Args:
        slopes: Jacobian J (n, k, 6).
        error: residuals r (n, k).
        weight: W (n, k).
    """
    weighted = slopes * weight[..., None]
    return np.swapaxes(weighted, 1, 2) @ slopes, np.einsum("nki,nk->ni", weighted, error)


def probabilities(cost: Array) -> Array:
    """Probabilities (m, ...), in proportion to exp(-cost)."""
    axes = tuple(range(1, cost.ndim))
    weight = np.exp(cost.min(axis=axes, keepdims=True) - cost)
    return weight / weight.sum(axis=axes, keepdims=True)


def moments(values: Array, probabilities: Array) -> tuple[Array, Array]:
    """Mean and variance (m,) of values (m, c)."""
    mean = (probabilities * values).sum(axis=1)
    return mean, (probabilities * (values - mean[:, None]) ** 2).sum(axis=1)


def huber(error: Array) -> Array:
    """Weights of residuals in standard deviations."""
    return np.minimum(1.0, CANDIDATES.huber / np.maximum(np.abs(error), 1e-12))


def median(size: Array, valid: NDArray[np.bool_]) -> Array:
    """Median (n,) of the ``valid`` ones of ``size`` (n, k); 0 where hardly any are."""
    # The others are sorted behind them as infinite, so one sort serves all rows.
    ordered = np.sort(np.where(valid, size, np.inf), axis=1)
    count = valid.sum(axis=1)
    middle = np.take_along_axis(ordered, (count // 2 % size.shape[1])[:, None], axis=1)[:, 0]
    return np.where(count > CANDIDATES.min_valid_share * size.shape[1], middle, 0.0)


class Shot(NamedTuple):
    """Pictures of n robots and their poses at exposure.

    Attributes:
        picture: (n, k).
        position: (n, 3) m, estimate.
        rotation: (n, 3, 3), estimate.
        facing: (n,) end that it was taken from, 1 for the nose, -1 for the tail.
        taken: (n,) robots that took one.
    """

    picture: Array
    position: Array
    rotation: Array
    facing: NDArray[np.int_]
    taken: NDArray[np.bool_]


class Difference(NamedTuple):
    """Residuals of pictures.

    Attributes:
        residual: (n, k) of the pixels, in their standard deviations; 0 where not valid.
        valid: (n, k) bool, pixels that can be compared.
        slopes: (n, k, 6) Jacobian of the expected pixels to the robots' poses, in standard
            deviations for each m and rad, world frame; 0 where not valid.
    """

    residual: Array
    valid: NDArray[np.bool_]
    slopes: Array


class Best(NamedTuple):
    """Best candidate of each robot.

    Attributes:
        place: (m, 3) m.
        frame: (m, 3, 3).
        cost: (m,).
        other: (m,) least cost of a candidate that is another answer.
    """

    place: Array
    frame: Array
    cost: Array
    other: Array


class Candidates:
    """Compares poses of n robots with their pictures, on the maps that they know.

    Args:
        table: of the filter.
        mount: the cameras.
        walls: of the maps.
        which: (n,) map of each robot.
        gravity: (n, 3) m/s², world frame, by the maps; the localiser's own array.

    Attributes:
        held: (n, 3) m/s², last mean of the accelerometers, robot frame.
        pixels: (k,) those of a picture that are compared with the map, counted row by row.
        few: some of these, for a first look.
        share: part of them that counts as independent.
    """

    def __init__(
        self,
        table: FilterTable,
        mount: Mount,
        walls: RayWalls,
        which: NDArray[np.intp],
        gravity: Array,
    ) -> None:
        self._table, self._mount, self._camera, self._walls = table, mount, mount.camera, walls
        self._which, self._gravity, self.held = which, gravity, np.zeros_like(gravity)
        self.share = table.pixel_share if self._camera.lamp is None else table.lamp_share
        side, stride = self._camera.optics.pixels, table.stride
        pixels = np.arange(side**2).reshape(side, side)
        self.pixels = pixels[stride // 2 :: stride, stride // 2 :: stride].ravel()
        self._rays = mount.rays[self.pixels]
        row, column = np.divmod(np.arange(len(self.pixels)), int(np.sqrt(len(self.pixels))))
        self._coarse = np.flatnonzero((row + column) % 2 == 0)
        self.few = np.flatnonzero((row % 2 == 0) & (column % 2 == 0))

    def difference(self, robots: NDArray[np.intp], shot: Shot) -> Difference:
        """Return the residuals of the pictures of robots (m,) at their estimated poses."""
        # Edges and shadows show a rotation about the lens, and gradients do not see them: these
        # rotations are left to the comparison of whole pictures.
        at = shot.position[robots], shot.rotation[robots], shot.facing[robots]
        which, picture = self._which[robots], shot.picture[robots]
        return self._difference(which, *at, picture, self._rays, about_lens=False)

    def around(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        axis: Array,
        steps: Array,
        turns: Array,
        pixels: NDArray[np.intp] | None = None,
    ) -> Array:
        """Return the cost (m, t, p) of poses around those of the picture.

        Args:
            robots: (m,).
            shot: the picture.
            axis: (m, 3) unit vectors.
            steps: (m, p) m, along ``axis``.
            turns: (m, t) rad, about the robots' own axis.
            pixels: see ``cost``.
        """
        m, t, p = len(robots), turns.shape[1], steps.shape[1]
        about = np.zeros((m, t, 3))
        about[..., 2] = turns
        frames = shot.rotation[robots, None] @ turned_by(about.reshape(-1, 3)).reshape(m, t, 3, 3)
        places = shot.position[robots, None] + steps[..., None] * axis[:, None]
        cost = self.cost(
            robots,
            shot,
            np.tile(places, (1, t, 1)),
            np.repeat(frames, p, axis=1),
            pixels=pixels,
            shared=True,
        )
        return cost.reshape(m, t, p)

    def best(self, robots: NDArray[np.intp], shot: Shot, places: Array, frames: Array) -> Best:
        """Return the best of candidates after the best few have been improved.

        Args:
            robots: (m,).
            shot: the picture.
            places: (m, c, 3) m, their positions.
            frames: (m, c, 3, 3), their rotations.
        """
        rows = np.arange(len(robots))[:, None]
        cost = self.cost(robots, shot, places, frames, CANDIDATES.blurs[0])
        best = np.argsort(cost, axis=1, kind="stable")[:, : CANDIDATES.finalists]
        places, frames = places[rows, best], frames[rows, best]
        for blur in CANDIDATES.blurs:
            places, frames = self._improved(robots, shot, places, frames, blur)
        cost = self.cost(robots, shot, places, frames)
        first = cost.argmin(axis=1)
        place, frame = places[rows[:, 0], first], frames[rows[:, 0], first]
        cosine = ((frame[:, None] * frames).sum(axis=(2, 3)) - 1) / 2
        aside = np.sqrt(((places - place[:, None]) ** 2).sum(axis=-1))
        apart = (cosine < np.cos(CANDIDATES.distinct_turn)) | (aside > CANDIDATES.distinct_place)
        other = np.where(apart, cost, np.inf).min(axis=1)
        return Best(place, frame, cost[rows[:, 0], first], other)

    def cost(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        places: Array,
        frames: Array,
        blur: float = 1.0,
        pixels: NDArray[np.intp] | None = None,
        *,
        shared: bool = False,
    ) -> Array:
        """Return half of the squared residuals of candidates (m, c), of picture and gravity.

        Args:
            robots: (m,).
            shot: the picture.
            places: (m, c, 3) m.
            frames: (m, c, 3, 3).
            blur: divides the residuals of pixels, where candidates are far apart.
            pixels: places in ``pixels`` of those compared; None: every other one.
            shared: pixels count in which all candidates see pipe that has been seen, as its end is
                no mark: else, where a picture fits badly, the candidate that compares the fewest
                pixels is the best.
        """
        pixels = self._coarse if pixels is None else pixels
        camera, rays = self._camera, self._rays[pixels]
        m, c = frames.shape[:2]
        facing = np.repeat(shot.facing[robots], c)
        position, lens = self._mount.lens(places.reshape(-1, 3), frames.reshape(-1, 3, 3), facing)
        which = np.repeat(self._which[robots], c)
        hits = self._walls.trace(which, position, lens, rays, camera.optics.far, camera.lamp)
        expected = camera.expected(hits, rays).reshape(m, c, -1)
        measured = shot.picture[robots][:, None, pixels]
        residual = (measured - expected) / camera.spread(expected) / blur
        # Where only one of both has a value, they differ as much as can be.
        nothing = np.isnan(measured) != np.isnan(expected)
        residual = np.where(nothing, CANDIDATES.max_error, np.nan_to_num(residual))
        size = np.abs(residual)
        # Beyond the end of the map every value is as probable: the cost of one standard deviation.
        beyond = np.isnan(hits[..., RANGE]).reshape(m, c, -1)
        if shared:
            unseen = (hits[..., PART] == BEYOND).reshape(m, c, -1)
            beyond |= unseen.any(axis=1, keepdims=True)
        loss = np.where(beyond, 0.5, np.minimum(size, CANDIDATES.max_error) ** 2 / 2)
        picture = self.share * len(self.pixels) / len(pixels)
        held = np.einsum("mcij,mi->mcj", frames, -self._gravity[robots])
        force = (held - self.held[robots, None]) / self._table.force_std
        return picture * loss.sum(axis=-1) + 0.5 * (force**2).sum(axis=-1)

    def _improved(
        self, robots: NDArray[np.intp], shot: Shot, places: Array, frames: Array, blur: float
    ) -> tuple[Array, Array]:
        """Return candidates (m, c, 3) and (m, c, 3, 3) after one Gauss-Newton step each."""
        m, c = places.shape[:2]
        facing, which = np.repeat(shot.facing[robots], c), np.repeat(self._which[robots], c)
        flat, turned = places.reshape(-1, 3), frames.reshape(-1, 3, 3)
        measured = np.repeat(shot.picture[robots][:, self._coarse], c, axis=0)
        rays = self._rays[self._coarse]
        residual, valid, slopes = self._difference(
            which, flat, turned, facing, measured, rays, blur
        )
        near = valid & (np.abs(residual) < 2 * CANDIDATES.max_error)
        information, evidence = normal_equations(slopes, residual, near.astype(float))
        # A prior of the longest step keeps directions that no pixel shows where they are.
        stiff = np.diag(1 / np.array([CANDIDATES.max_shift] * 3 + [CANDIDATES.max_turn] * 3) ** 2)
        change = np.linalg.solve(information + stiff, evidence[..., None])[..., 0]
        size = np.sqrt((change[:, :3] ** 2).sum(axis=-1)) / CANDIDATES.max_shift
        turn = np.sqrt((change[:, 3:] ** 2).sum(axis=-1)) / CANDIDATES.max_turn
        change = change / np.maximum(1.0, np.maximum(size, turn))[:, None]
        moved = flat + change[:, :3]
        rotated = orthonormal(turned_by(change[:, 3:]) @ turned)
        return moved.reshape(m, c, 3), rotated.reshape(m, c, 3, 3)

    def _difference(
        self,
        which: NDArray[np.intp],
        position: Array,
        rotation: Array,
        facing: NDArray[np.int_],
        measured: Array,
        rays: Array,
        blur: float = 1.0,
        *,
        about_lens: bool = True,
    ) -> Difference:
        """Return the residuals of pictures of robots at given poses.

        Args:
            which: (n,) map of each.
            position: (n, 3) m.
            rotation: (n, 3, 3).
            facing: (n,) see ``Shot``.
            measured: (n, k) the pictures.
            rays: (k, 3) of the pixels, camera frame.
            blur: see ``cost``.
            about_lens: False: rotations about the lens's axis change nothing.
        """
        place, frame = self._mount.lens(position, rotation, facing)
        camera, far = self._camera, self._camera.optics.far
        hits = self._walls.trace(which, place, frame, rays, far, camera.lamp)
        expected, slopes = camera.expected(hits, rays), camera.slopes(hits, rays, frame)
        if slopes is None:
            slopes = self._slopes(hits, place, frame, rays, expected)
        spread = camera.spread(expected) * blur
        residual = (measured - expected) / spread
        valid = np.isfinite(residual) & np.isfinite(slopes).all(axis=-1)
        if not about_lens:
            slopes[..., POSE - 1] = 0.0
        slopes = np.where(valid[..., None], slopes / np.where(valid, spread, 1.0)[..., None], 0.0)
        residual = np.where(valid, residual, 0.0)
        # From the camera's pose to the robot's, in the world frame.
        turns = np.einsum("nij,nkj->nki", frame, slopes[..., 3:])
        turns = turns + cross((place - position)[:, None], slopes[..., :3])
        return Difference(residual, valid, np.concatenate([slopes[..., :3], turns], axis=-1))

    def _slopes(
        self, hits: Array, position: Array, frame: Array, rays: Array, expected: Array
    ) -> Array:
        """Return the Jacobian (n, k, 6) by differences of pictures from neighbouring poses.

        They see the same pieces of wall; see ``Camera.slopes``.
        """
        slopes = np.empty((*expected.shape, POSE))
        for axis in range(POSE):
            place, turned, step = position, frame, CANDIDATES.shift
            change = np.zeros((len(position), 3))
            change[:, axis % 3] = step
            if axis < 3:
                place = position + change
            else:
                turned = frame @ turned_by(change)
            image = reprojected(hits, rays, position, frame, place, turned, self._camera.lamp)
            slopes[..., axis] = (self._camera.expected(image, rays) - expected) / step
        return slopes
