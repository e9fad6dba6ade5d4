"""The cameras of films: where each stands, what light there is, and which pipes are in the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly, Route
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.omnitrack.looks import (
    FIELD_OF_VIEW,
    camera_frame,
    follow_direction,
    view_direction,
)
from omnitrack_sim.show.film.sight import Eye, Sun
from omnitrack_sim.show.film.viewpoint import (
    DISTANCE,
    in_the_way,
    over_the_shoulder,
    upright,
    view_directions,
)
from omnitrack_sim.walls.meshes import THICKNESS

AROUND_WAY = 0.3
"""How far around the robot's way the camera ``side`` shows pipes, m, along a pipe."""
SHADOW_REACH = 0.17
"""How far behind the robot it throws a shadow, m."""
_MARGIN = 1.06
PANEL = 0.33
"""Of the picture's height: the panel in the lower left corner."""
_PANEL_WIDE = 0.28  # of its width
_HALF = np.tan(np.radians(FIELD_OF_VIEW / 2))  # half of the picture's height at 1 m
_CLEAR = 0.12  # how much is left of a pipe that is in the way
_ONBOARD_ANGLE, _ONBOARD_PLACE = 88.0, 0.086  # degrees; m before the robot's centre
_FARTHEST = 30.0  # m seen by the moving cameras


class View(NamedTuple):
    """How one sample is seen.

    Attributes:
        eye: from where.
        sun: of the robot's shadow; None where the camera has a lamp.
        clearness: of each part, 0 to 1; 0 where it is not in the picture.
    """

    eye: Eye
    sun: Sun | None
    clearness: tuple[float, ...]


class Camera(Protocol):
    """A camera.

    Attributes:
        stands: whether eye and sun are the same all the time.
        lamp: whether it brings its own light.
        cut: (3,) direction to which pipes are cut open, or zeros where their insides are seen.
    """

    stands: bool
    lamp: bool
    cut: Array

    def view(self, row: int, centre: Array, quaternion: Array) -> View:
        """How sample ``row`` is seen, with the chassis at ``centre`` (3,) m and ``quaternion``."""
        ...

    def still_sun(self) -> Sun | None:
        """The sun in whose light pipes throw shadows."""
        ...


class Side:
    """Stands still, before pipes that are cut open towards it."""

    stands, lamp = True, False

    def __init__(
        self, trajectory: Trajectory, network: Assembly, aspect: float, reach: float, panel: float
    ):
        """For pictures of this aspect ratio.

        ``reach``: of the robot about its centre, m; ``panel``: part of the
        picture's height that panels cover in its lower left corner.
        """
        self._network, self._reach = network, reach
        self.cut = view_direction(network)
        self._frame = camera_frame(self.cut)
        seen = _seen_from(trajectory, network)
        middle, distance = _fit(seen, self._frame, aspect)
        if _behind_panel(seen, self._frame, middle, distance, aspect, panel):
            middle, distance = _fit(seen, self._frame, aspect * (1 - _PANEL_WIDE))
            middle -= _PANEL_WIDE * distance * _HALF * aspect * self._frame[:, 0]
        far = 2 * distance + float(np.linalg.norm(seen - middle, axis=1).max())
        self._eye = Eye(
            middle + distance * self._frame[:, 2],
            self._frame,
            np.radians(FIELD_OF_VIEW),
            0.1 * distance,
            max(far, _FARTHEST),
        )
        right, up, _ = self._frame.T
        self._towards = over_the_shoulder(self.cut, right, up)
        eye = self._eye
        spheres = [_sphere(part.bore_samples()) for part in network.parts]
        self._clearness = tuple(float(eye.sees(*sphere, aspect)) for sphere in spheres)
        self._shown = np.concatenate(
            [p.bore_samples() for p, c in zip(network.parts, self._clearness, strict=True) if c]
        )

    def view(self, row: int, centre: Array, quaternion: Array) -> View:
        """See ``Camera``."""
        sun = Sun(self._towards, centre, self._reach, SHADOW_REACH)
        return View(self._eye, sun, self._clearness)

    def still_sun(self) -> Sun:
        """See ``Camera``."""
        middle, radius = _sphere(self._shown)
        radius += THICKNESS
        return Sun(self._towards, middle, radius, radius)


class Follow:
    """Keeps with the robot, looks into pipes that are open towards it, and through those that are
    in the way. The sun goes with it."""

    stands, lamp = False, False
    cut = np.zeros(3)

    def __init__(
        self, trajectory: Trajectory, routes: Sequence[Route], aspect: float, reach: float
    ):
        """For pictures of this aspect ratio; ``reach``: of the robot about its centre, m."""
        network = routes[0].network
        self._parts, self._aspect, self._reach = network.parts, aspect, reach
        self._back = view_directions(trajectory, routes, follow_direction(network))  # (T, 3)
        self._spheres = [_sphere(part.bore_samples()) for part in network.parts]

    def view(self, row: int, centre: Array, quaternion: Array) -> View:
        """See ``Camera``."""
        back = self._back[row]
        right, up = upright(back)
        place = centre + DISTANCE * back
        frame = np.stack([right, up, back], axis=-1)
        eye = Eye(place, frame, np.radians(FIELD_OF_VIEW), 0.05, _FARTHEST)
        sun = Sun(over_the_shoulder(back, right, up), centre, self._reach, SHADOW_REACH)
        nose = matrix_from_quaternion(quaternion)[:, 2]
        targets = centre + 0.05 * np.array([[0.0], [1.0], [-1.0]]) * nose
        seen = [eye.sees(*sphere, self._aspect) for sphere in self._spheres]
        clearness = np.array(seen, float)
        near = [
            i
            for i, sphere in enumerate(self._spheres)
            if seen[i] and _meets(sphere, targets, place)
        ]
        covers = in_the_way([self._parts[i] for i in near], place, targets)
        clearness[near] = 1 - (1 - _CLEAR) * covers
        return View(eye, sun, tuple(clearness.tolist()))

    def still_sun(self) -> None:
        """See ``Camera``."""


class Onboard:
    """Looks ahead from the robot's nose, in the light of its lamp."""

    stands, lamp = False, True
    cut = np.zeros(3)

    def __init__(self, network: Assembly, aspect: float, size: float):
        """For pictures of this aspect ratio; ``size``: scale of the robot."""
        self._aspect, self._ahead = aspect, size * _ONBOARD_PLACE
        self._spheres = [_sphere(part.bore_samples()) for part in network.parts]

    def view(self, row: int, centre: Array, quaternion: Array) -> View:
        """See ``Camera``."""
        x, y, z = matrix_from_quaternion(quaternion).T
        frame = np.stack([y, x, -z], axis=-1)
        place = centre + self._ahead * z
        eye = Eye(place, frame, np.radians(_ONBOARD_ANGLE), 0.01, _FARTHEST)
        clearness = tuple(float(eye.sees(*sphere, self._aspect)) for sphere in self._spheres)
        return View(eye, None, clearness)

    def still_sun(self) -> None:
        """See ``Camera``."""


def _seen_from(trajectory: Trajectory, network: Assembly) -> Array:
    """Points (n, 3) m of the pipes near the robot's way."""
    step = max(1, len(trajectory.time) // 400)
    way = trajectory["position"][::step]
    points = np.concatenate([part.bore_samples() for part in network.parts])
    near = np.array([((way - point) ** 2).sum(axis=1).min() for point in points])
    return points[near < AROUND_WAY**2] if (near < AROUND_WAY**2).any() else points


def _meets(sphere: tuple[Array, float], targets: Array, eye: Array) -> bool:
    """Whether a sphere is touched by a line from one of ``targets`` (k, 3) m to ``eye`` (3,) m."""
    centre, radius = sphere
    lines = eye - targets
    along = ((centre - targets) * lines).sum(axis=1) / (lines**2).sum(axis=1)
    nearest = targets + np.clip(along, 0.0, 1.0)[:, None] * lines
    return bool((((centre - nearest) ** 2).sum(axis=1) < radius**2).any())


def _sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) m and radius m of a sphere around pipes with these points of their bores."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle, float(np.linalg.norm(points - middle, axis=1).max()) + THICKNESS


def _fit(points: Array, frame: Array, aspect: float) -> tuple[Array, float]:
    """What to look at (3,) m, and from how far, m, to have ``points`` in the picture with a small
    margin."""
    half = _HALF
    seen = points @ frame  # right, up, back
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    distance = 0.0
    for _ in range(20):  # what is nearer to the eye takes more room: the middle shifts
        about = seen - middle
        wanted = np.abs(about[:, :2]) / [half * aspect, half]
        distance = _MARGIN * float((wanted.max(axis=1) + about[:, 2]).max())
        flat = about[:, :2] / (distance - about[:, 2:])
        middle[:2] += distance * (flat.min(axis=0) + flat.max(axis=0)) / 2
    return frame @ middle, distance


def _behind_panel(
    points: Array, frame: Array, middle: Array, distance: float, aspect: float, high: float
) -> bool:
    """Whether one of ``points`` (n, 3) m would be behind panels in the lower left corner that are
    ``high``, a part of the picture's height."""
    right, up, back = ((points - middle) @ frame).T
    half = _HALF * (distance - back)
    left, low = 0.5 + 0.5 * right / (half * aspect), 0.5 + 0.5 * up / half
    return bool(((left < _PANEL_WIDE) & (low < high)).any())
