"""Eyes and suns: viewpoint, light and visible parts of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, cross, dot, matrix_from_quaternion, unit
from omnitrack_sim.pipes import Part
from omnitrack_sim.record.display import CarriedCamera
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.walls.meshes import THICKNESS
from omnitrack_sim.walls.pipe_looks import (
    FIELD_OF_VIEW,
    camera_frame,
    follow_direction,
    view_direction,
)


@dataclass(frozen=True)
class Eye:
    """Viewpoint of a picture.

    Attributes:
        position: (3,) m.
        frame: (3, 3) directions right, up and back as columns.
        angle: vertical field of view, rad.
        near, far: what lies between these distances is seen, m.
    """

    position: Array
    frame: Array
    angle: float
    near: float
    far: float

    def matrix(self, aspect: float) -> Array:
        """World to clip coordinates (4, 4); y points down, so that rows come from the top."""
        scale, depth = 1 / np.tan(self.angle / 2), self.near - self.far
        view = np.zeros((4, 4))
        view[0, 0], view[1, 1] = scale / aspect, -scale
        view[2, 2:] = (self.far + self.near) / depth, 2 * self.far * self.near / depth
        view[3, 2] = -1.0
        return view @ _rigid(self.frame.T, -self.frame.T @ self.position)

    def pixels(self, points: Array, size: tuple[int, int]) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (n, 3) m into a picture.

        Returns:
            Pixels (n, 2) to the right and down, and which (n,) lie in front of the eye.
        """
        matrix = self.matrix(size[0] / size[1])
        clip = points @ matrix[:, :3].T + matrix[:, 3]
        ahead = clip[:, 3] > self.near
        depth = np.where(ahead, clip[:, 3], 1.0)[:, None]
        return (0.5 + 0.5 * clip[:, :2] / depth) * size, ahead

    def sees(self, centre: Array, radius: float, aspect: float) -> bool:
        """Return True for a sphere that can come into the picture."""
        right, up, back = (centre - self.position) @ self.frame
        half = np.tan(self.angle / 2)
        inside = [-back * half * a - abs(v) for a, v in ((aspect, right), (1.0, up))]
        walls = [np.hypot(1.0, half * a) * radius for a in (aspect, 1.0)]
        near = -back + radius > self.near
        return near and all(i > -w for i, w in zip(inside, walls, strict=True))


@dataclass(frozen=True)
class Sun:
    """Parallel light on a part of the world.

    Attributes:
        towards: (3,) unit vector to the sun.
        middle: (3,) m, radius: m, of the sphere that is looked at.
        reach: how far behind the middle there may be shadows, m.
    """

    towards: Array
    middle: Array
    radius: float
    reach: float

    @cached_property
    def matrix(self) -> Array:
        """World to clip coordinates (4, 4) of the sun's view."""
        side = unit(cross(np.eye(3)[np.abs(self.towards).argmin()], self.towards))
        frame = np.stack([side, cross(self.towards, side), self.towards])
        place = self.middle + (self.radius - self.reach) / 2 * self.towards
        scale = 2 / np.array([2 * self.radius, 2 * self.radius, -(self.radius + self.reach)])
        return np.diag([*scale, 1.0]) @ _rigid(frame, -frame @ place)


def _rigid(rotation: Array, place: Array) -> Array:
    """Rotation (3, 3) and place (3,) as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


DISTANCE = 0.68
"""Distance of the viewer from the robot's centre, m. Lengths here are for a bore of 160 mm, and are
scaled by ``Playback.size``."""
SPACING = 0.06
"""Travel between two neighbouring places for which a direction is chosen, m."""
SUN_UP, SUN_RIGHT = 0.55, -0.40
"""Height of the sun above the viewer, and offset to the right, over the viewer's distance."""
WALL = 0.004
"""Thickness of a pipe's wall for occlusion, m."""
_ELEVATIONS, _AZIMUTHS = np.radians([-15, 0, 15, 30, 45, 60]), np.radians(np.arange(0, 360, 22.5))
_NEAR = 0.08  # m before and behind a bend or tee in which the viewer looks across its plane, too
_SIGHT = np.linspace(0.16, 1.0, 8)  # places on the sight line, 0 at the robot and 1 at the viewer
# Weights of the costs: a view along the robot shows nothing and costs most, then a hidden robot;
# the direction that is liked only decides between equals.
_ALONG, _BEND, _LIKING, _HIDDEN, _TURN = 6.0, 1.0, 0.3, 4.0, 1.5
_FREE = 0.25  # cosine to the robot's axis below which one looks across it well enough


def view_directions(playback: Playback, liking: ArrayLike) -> Array:
    """Unit vectors (T, 3), world frame, from the robot to the viewer, which change slowly.

    Of a set of directions up to 60 degrees above the horizon the cheapest sequence is taken. A
    direction is cheap if it looks across the robot and across the plane of a bend or tee, not
    through other pipes, and lies near ``liking`` (3,); turning costs, too.
    """
    liking, travel = unit(liking), playback.travel
    rows = _nodes(playback)
    up, around = (a.ravel() for a in np.meshgrid(_ELEVATIONS, _AZIMUTHS, indexing="ij"))
    rings = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    choices = np.concatenate([liking[None], rings])
    position, parts, size = playback.position[rows], playback.network.parts, playback.size
    along = np.maximum(np.abs(playback.ahead[rows] @ choices.T) - _FREE, 0.0) ** 2
    plane = _planes(parts, position, size)
    bend = np.where((plane != 0).any(axis=1)[:, None], 1 - (plane @ choices.T) ** 2, 0.0)
    hidden = _hidden(parts, position, choices, size)
    cost = _ALONG * along + _BEND * bend + _HIDDEN * hidden + _LIKING * (1 - choices @ liking)
    turn = np.arccos(np.clip(choices @ choices.T, -1, 1)) ** 2
    chosen = choices[_cheapest(cost, _TURN * turn)]
    # The choices are steps of up to 22.5 degrees: four passes of a binomial filter turn them into
    # a pan over some 0.3 m of travel.
    for _ in range(4):
        padded = np.concatenate([chosen[:1], chosen, chosen[-1:]])
        chosen = unit(padded[:-2] + 2 * padded[1:-1] + padded[2:])
    return unit(np.stack([np.interp(travel, travel[rows], column) for column in chosen.T], axis=-1))


def upright(back: Array) -> tuple[Array, Array]:
    """Right and up (3,), of a picture that is seen from the direction ``back`` (3,)."""
    right = unit(np.cross([0.0, 0.0, 1.0], back))
    return right, np.cross(back, right)


def over_the_shoulder(back: Array, right: Array, up: Array) -> Array:
    """Return the direction (3,) to a sun over the shoulder of a viewer.

    Args:
        back: (3,) to the viewer.
        right: (3,) of the picture.
        up: (3,) of the picture.
    """
    return unit(back + SUN_UP * up + SUN_RIGHT * right)


def in_the_way(parts: Sequence[Part], eye: Array, targets: Array, size: float = 1.0) -> Array:
    """Return the share (P,), 0 to 1, by which each part hides targets from an eye.

    A part with a target in its bore hides none.

    Args:
        parts: pipes.
        eye: (3,) m.
        targets: (k, 3) m.
        size: of ``Playback``.
    """
    steps = np.linspace(0.0, 1.0, 14)[:, None, None]
    points = (targets + steps * (eye - targets)).reshape(-1, 3)
    found = np.zeros(len(parts))
    for i, part in enumerate(parts):
        if not (_depth(part, targets, size) > size * WALL).any():
            found[i] = np.clip(
                _depth(part, points, size).max() / (0.25 * part.fitting.radius), 0.0, 1.0
            )
    return found


def _depth(part: Part, points: Array, size: float) -> Array:
    """Depth of ``points`` (..., 3) m within the outside of a part, m; negative outside."""
    return np.minimum(part.signed_distance(points)[0], part.extent(points)) + size * WALL


def _nodes(playback: Playback) -> NDArray[np.intp]:
    """Rows (N,) about ``SPACING`` of travel apart."""
    travel, spacing = playback.travel, playback.size * SPACING
    grid = np.arange(0.0, travel[-1] + spacing, spacing)
    rows = np.unique(
        np.append(np.searchsorted(travel, grid).clip(0, len(travel) - 1), len(travel) - 1)
    )
    return rows[np.isfinite(playback.position[rows]).all(axis=1)]


def _planes(parts: Sequence[Part], centres: Array, size: float) -> Array:
    """Normals (N, 3) of the plane of a bend or tee at ``centres`` (N, 3) m; 0 away from them."""
    plane = np.zeros(centres.shape)
    for part in parts:
        if not part.fitting.is_axial:
            beside = part.signed_distance(centres)[0] > -size * WALL
            # Fittings that bend or branch are symmetric about y = 0, the plane of all their axes.
            plane[beside & (part.extent(centres) > -size * _NEAR)] = part.pose.rotation[:, 1]
    return plane


def _hidden(parts: Sequence[Part], centres: Array, choices: Array, size: float) -> Array:
    """Return the part (N, C) of each sight line that lies within other parts.

    The lines go from ``centres`` (N, 3) m in direction ``choices`` (C, 3).
    """
    hidden, distance = np.zeros((len(centres), len(choices))), size * DISTANCE
    for part in parts:
        samples = part.bore_samples()
        middle = (samples.max(axis=0) + samples.min(axis=0)) / 2
        reach = np.sqrt(dot(samples - middle, samples - middle).max()) + distance
        near = np.flatnonzero(np.linalg.norm(centres - middle, axis=1) < reach)
        near = near[_depth(part, centres[near], size) <= size * WALL]
        if len(near):
            points = (
                centres[near][:, None, None] + distance * _SIGHT[:, None] * choices[:, None]
            )  # (n, C, k, 3)
            hidden[near] += (_depth(part, points, size) > 0).mean(axis=-1)
    return np.minimum(hidden, 1.0)


def _cheapest(cost: Array, turn: Array) -> NDArray[np.intp]:
    """Return the indices (N,) of the cheapest sequence of choices of ``cost`` (N, C).

    To go on to another choice costs ``turn`` (C, C).
    """
    # Viterbi's algorithm: the cheapest way to each choice, then back from the cheapest end.
    total, came = cost[0], np.zeros(cost.shape, np.intp)
    for i in range(1, len(cost)):
        step = total[:, None] + turn
        came[i] = step.argmin(axis=0)
        total = step.min(axis=0) + cost[i]
    chosen = np.zeros(len(cost), np.intp)
    chosen[-1] = total.argmin()
    for i in range(len(cost) - 1, 0, -1):
        chosen[i - 1] = came[i, chosen[i]]
    return chosen


AROUND_WAY = 0.3
"""Distance from the robot's path up to which the camera ``side`` shows pipes, m."""
SHADOW_REACH = 0.17
"""Length of the robot's shadow, m."""
_MARGIN = 1.06  # distance over that at which the pipes touch the picture's edges
_PANEL_WIDE = 0.28  # part of the picture's width that panels take
_HALF = np.tan(np.radians(FIELD_OF_VIEW / 2))  # half of the picture's height at 1 m
_CLEAR = 0.12  # opacity of a pipe that is in the way: enough to see that there is one
_ONBOARD_NEAR = 0.004  # m, what is nearer to a camera on board is not seen
_FAR = 30.0  # m seen by the moving cameras


class Framing(NamedTuple):
    """Eye, sun and pipes of one sample.

    Attributes:
        eye: from where.
        sun: of the robot's shadow; None where the camera has a lamp.
        clearness: of each part, 0 to 1; 0 where it is not in the picture.
    """

    eye: Eye
    sun: Sun | None
    clearness: tuple[float, ...]


class FilmCamera:
    """Base of the cameras of films, with pictures of width over height ``aspect``.

    Attributes:
        lamp: it brings its own light.
        cut: (3,) direction to which pipes are cut open, or zeros where their insides are seen.
        still_sun: the sun in whose light pipes throw shadows; None where it moves.
    """

    lamp = False
    cut = np.zeros(3)
    still_sun: Sun | None = None

    def __init__(self, playback: Playback, aspect: float) -> None:
        self._playback, self._aspect = playback, aspect
        self._parts, self._size = playback.network.parts, playback.size
        self._spheres = [_sphere(part.bore_samples()) for part in self._parts]

    def shot(self, row: int, data: mujoco.MjData) -> Framing:
        """Return how sample ``row`` is seen, with the bodies where ``data`` has them."""
        raise NotImplementedError

    def _visible(self, eye: Eye) -> list[float]:
        """Return 1 for each part that can come into the picture, 0 for the others."""
        return [float(eye.sees(*sphere, self._aspect)) for sphere in self._spheres]


class SideCamera(FilmCamera):
    """Camera that stands still, before pipes that are cut open towards it.

    Args:
        playback: that is seen.
        aspect: width over height of the pictures.
        reach: of the robot about its centre, m.
        panel: part of the pictures' height that panels cover in the lower left corner.
    """

    def __init__(self, playback: Playback, aspect: float, reach: float, panel: float) -> None:
        super().__init__(playback, aspect)
        self._reach, self.cut = reach, view_direction(playback.network)
        frame = camera_frame(self.cut)
        near = _near_path(playback)
        middle, distance = _fit(near, frame, aspect)
        if _behind_panel(near, frame, middle, distance, aspect, panel):
            middle, distance = _fit(near, frame, aspect * (1 - _PANEL_WIDE))
            middle -= _PANEL_WIDE * distance * _HALF * aspect * frame[:, 0]
        far = 2 * distance + float(np.linalg.norm(near - middle, axis=1).max())
        place, angle = middle + distance * frame[:, 2], np.radians(FIELD_OF_VIEW)
        self._eye = Eye(place, frame, angle, 0.1 * distance, max(far, _FAR))
        self._towards = over_the_shoulder(self.cut, frame[:, 0], frame[:, 1])
        self._clearness = tuple(self._visible(self._eye))
        parts = zip(self._parts, self._clearness, strict=True)
        middle, radius = _sphere(np.concatenate([p.bore_samples() for p, seen in parts if seen]))
        radius += THICKNESS
        self.still_sun = Sun(self._towards, middle, radius, radius)

    def shot(self, row: int, data: mujoco.MjData) -> Framing:
        """See ``FilmCamera``."""
        centre = np.array(data.xpos[self._playback.body])
        sun = Sun(self._towards, centre, self._reach, self._size * SHADOW_REACH)
        return Framing(self._eye, sun, self._clearness)


class FollowCamera(FilmCamera):
    """Camera that keeps with the robot and looks into open pipes, through those in the way.

    The sun goes with it.

    Args:
        playback: that is seen.
        aspect: width over height of the pictures.
        reach: of the robot about its centre, m.
    """

    def __init__(self, playback: Playback, aspect: float, reach: float) -> None:
        super().__init__(playback, aspect)
        self._reach = reach
        liking = follow_direction(playback.network)
        self._back = view_directions(playback, liking)  # (T, 3)

    def shot(self, row: int, data: mujoco.MjData) -> Framing:
        """See ``FilmCamera``."""
        back, size = self._back[row], self._size
        right, up = upright(back)
        centre = np.array(data.xpos[self._playback.body])
        place = centre + size * DISTANCE * back
        frame = np.stack([right, up, back], axis=-1)
        eye = Eye(place, frame, np.radians(FIELD_OF_VIEW), size * 0.05, size * _FAR)
        sun = Sun(over_the_shoulder(back, right, up), centre, self._reach, size * SHADOW_REACH)
        ahead = self._playback.ahead[row]
        targets = centre + size * 0.05 * np.array([[0.0], [1.0], [-1.0]]) * ahead
        clearness = np.array(self._visible(eye))
        near = np.flatnonzero(clearness)
        covers = in_the_way([self._parts[i] for i in near], place, targets, size)
        clearness[near] = 1 - (1 - _CLEAR) * covers
        return Framing(eye, sun, tuple(clearness.tolist()))


class CarriedCameraShots(FilmCamera):
    """Base of the cameras that a body, or the world, carries."""

    def __init__(self, playback: Playback, aspect: float, mount: CarriedCamera) -> None:
        super().__init__(playback, aspect)
        self._mount = mount

    def _eye(self, data: mujoco.MjData) -> Eye:
        mount, body = self._mount, data.model.body(self._mount.body).id
        rotation = matrix_from_quaternion(np.array(data.xquat[body]))
        position = data.xpos[body] + rotation @ np.array(mount.position)
        frame, near = rotation @ np.array(mount.frame), self._size * _ONBOARD_NEAR
        return Eye(position, frame, np.radians(mount.angle_deg), near, self._size * _FAR)


class OnboardCamera(CarriedCameraShots):
    """Camera within the pipes, in the light of its own lamp."""

    lamp = True

    def shot(self, row: int, data: mujoco.MjData) -> Framing:
        """See ``FilmCamera``."""
        eye = self._eye(data)
        return Framing(eye, None, tuple(self._visible(eye)))


class OutsideCamera(CarriedCameraShots):
    """Camera outside the pipes, which looks into them as if they were cut open.

    Args:
        playback: that is seen.
        aspect: width over height of the pictures.
        mount: the camera.
        reach: of the robot about its centre, m.
    """

    def __init__(
        self, playback: Playback, aspect: float, mount: CarriedCamera, reach: float
    ) -> None:
        super().__init__(playback, aspect, mount)
        self._reach = reach

    def shot(self, row: int, data: mujoco.MjData) -> Framing:
        """See ``FilmCamera``."""
        eye, centre = self._eye(data), np.array(data.xpos[self._playback.body])
        right, up, back = eye.frame.T
        towards, shadow = over_the_shoulder(back, right, up), self._size * SHADOW_REACH
        sun = Sun(towards, centre, self._reach, shadow)
        return Framing(eye, sun, tuple(self._visible(eye)))


def is_outside(playback: Playback, mount: CarriedCamera, row: int = 0) -> bool:
    """Return whether a camera is outside the pipes at a sample."""
    data = mujoco.MjData(playback.model)
    playback.place(data, row)
    body = playback.model.body(mount.body).id
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ np.array(mount.position)
    return float(playback.network.signed_distance(place)[0]) < 0.0


def _near_path(playback: Playback) -> Array:
    """Points (n, 3) m of the pipes near the robot's path."""
    step = max(1, len(playback.time) // 400)
    way, around = playback.position[::step], playback.size * AROUND_WAY
    points = np.concatenate([part.bore_samples() for part in playback.network.parts])
    near = np.array([((way - point) ** 2).sum(axis=1).min() for point in points])
    return points[near < around**2] if (near < around**2).any() else points


def _sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) m and radius m of a sphere around pipes with these points of their bores."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle, float(np.linalg.norm(points - middle, axis=1).max()) + THICKNESS


def _fit(points: Array, frame: Array, aspect: float) -> tuple[Array, float]:
    """Return the point (3,) m to look at, and the distance, m, to see all points.

    There is a small margin around them.
    """
    seen = points @ frame  # right, up, back
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    distance = 0.0
    for _ in range(20):  # what is nearer to the eye takes more room: the middle shifts
        about = seen - middle
        wanted = np.abs(about[:, :2]) / [_HALF * aspect, _HALF]
        distance = _MARGIN * float((wanted.max(axis=1) + about[:, 2]).max())
        flat = about[:, :2] / (distance - about[:, 2:])
        middle[:2] += distance * (flat.min(axis=0) + flat.max(axis=0)) / 2
    return frame @ middle, distance


def _behind_panel(
    points: Array, frame: Array, middle: Array, distance: float, aspect: float, high: float
) -> bool:
    """Return whether points (n, 3) m would be behind panels in the lower left corner.

    The panels are ``high``, a part of the picture's height.
    """
    right, up, back = ((points - middle) @ frame).T
    half = _HALF * (distance - back)
    left, low = 0.5 + 0.5 * right / (half * aspect), 0.5 + 0.5 * up / half
    return bool(((left < _PANEL_WIDE) & (low < high)).any())
