"""Sight of robots that explore by their own cameras: pictures, recognised."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.autonomy.recognition import Detection, Recogniser
from omnitrack_sim.autonomy.recognition.forms import (
    CENTRED,
    DISTANCE,
    PLACES,
    STILL,
    TURN,
    PosePrior,
    cameras,
    forms,
    numbers_at,
)
from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.autonomy.sight import Sighting
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Elbow, Passage, Reducer, Route, Wye
from omnitrack_sim.senses.optics import Eyes
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.walls.rays import RayWalls


@dataclass(frozen=True)
class CameraSightSettings:
    """Range of sightings by camera, and the cost of making them.

    Attributes:
        reach: bores, from the lens up to which a fitting is believed: 0.35 m in a bore of 0.16 m,
            to which the recogniser was right in 100 of 100 trials with the depth camera.
        nearest: bores, from the lens up to which a fitting or an end is ignored: a lens within a
            bend takes the bend to begin where the lens is, and one before a wall sees a plate.
        shortest: bores, length of a reducer up to which it is none: the search has ended near its
            bound of 0.2, so the picture shows something else.
        bore_step: m, bores that differ by less share a recogniser: making one takes seconds.
        least_free: bores, from the lens up to which a pipe has to be free of fittings for a look to
            tell anything.
        past: bores, from a fitting to the lens up to which the fitting tells how the lens stands:
            the picture shows the wall from 0.4 bores beyond the lens on.
        by_lamp: most probability, by a lamp, that free pipe is free, and that sizes are right of a
            reducer, as cones hardly show, and of an elbow that is seen out of a fitting.
        angles: rad, of elbows as most are sold. By a lamp, an angle nearby counts as such a one
            until it is measured behind the elbow: before, the end of the elbow is hidden.
        angle_error: rad, how near: a lamp shows 5 to 18 degrees too much.
        radius: standard deviation of a mean radius by a lamp, as a part of it. What a look itself
            tells, 0.8 to 4 %, says little: 120 looks at 90 degrees of 1.5 bores scattered by 1.7 %,
            those of robots by 2.3 %.
        elbow_share: standard deviation of how far an elbow is by the depth camera, as a part of
            what a picture tells, as distance, radius and angle are confounded: 28 looks by robots
            were off by at most 3.6 mm, also where a picture tells 13.
        elbow_std: m, the same in addition.
        wye_share: the same of a wye: 23 looks by robots were off by 0.3 of what a picture tells
            (root mean square, less two that were off by 14 mm).
        given_share: standard deviation by the depth camera of how far a fitting of known sizes is,
            as a part of what a picture tells: 139 looks at elbows, wyes and reducers scattered by
            0.3 to 0.5 of that (wyes entered by `run_end` by 0.7).
        first_picture: number of a look's first picture. The estimate counts its own from 0; each
            number has noise of its own.
    """

    reach: float = 2.2
    nearest: float = 0.15
    least_free: float = 0.25
    past: float = 0.6
    shortest: float = 0.24
    bore_step: float = 1e-3
    by_lamp: float = 0.9
    angles: tuple[float, ...] = (math.radians(45), math.radians(90))
    angle_error: float = math.radians(20)
    radius: float = 0.025
    elbow_share: float = 0.25
    elbow_std: float = 0.0015
    wye_share: float = 0.5
    given_share: float = 0.5
    first_picture: int = 1_000_000


CAMERA_SIGHT = CameraSightSettings()


ENDS = {"open end": "open", "closed end": "closed"}


class CameraSight:
    """Sight of n robots with cameras at both ends.

    Args:
        eyes: of the robots.
        table: ``[sensing]``.
    """

    def __init__(self, eyes: Eyes, table: SensingTable) -> None:
        self._eyes, self._table = eyes, table
        self._looks = np.zeros(len(eyes.keys), int)

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Count the looks of robots ``rows`` (k,) anew."""
        self._looks[rows] = 0

    def look(
        self, robot: int, truth: Pose, passage: Passage, estimate: Pose | None = None
    ) -> Sighting | None:
        """Return the sighting of one robot; see ``TrueSight.look``.

        As by error-free sight, a robot in a fitting sees on when it lies along the pipe beyond.

        Args:
            robot: index in its batch.
            truth: of the robot in its gear, which serves the camera.
            passage: of the part that it looks out of, by its map; see ``behind_lens``.
            estimate: of the robot's pose in its gear, on its map, of a look ahead.
        """
        fitting, port = passage.part.fitting, passage.part.port(passage.leave)
        bore = round(2 * fitting.port_radius(passage.leave) / CAMERA_SIGHT.bore_step)
        bore *= CAMERA_SIGHT.bore_step
        lens, prior, nearest = self._eyes.mount.ahead, CENTRED, CAMERA_SIGHT.nearest * bore
        if estimate is not None and not fitting.is_plain:
            # Out of a fitting no straight wall shows that would tell how the camera stands in the
            # pipe beyond; the map does.
            frame = estimate.rotation
            if frame[:, 2] @ port.rotation[:, 2] < math.cos(LEG_PLANNER.along):
                return None  # It sees little but the wall before it.
            mean = numbers_at(port, estimate.position + lens * frame[:, 2], frame)
            bends = isinstance(fitting, Elbow)
            prior = PosePrior(mean, RECOGNISER.bend_std if bends else RECOGNISER.camera_std)
            # What follows directly begins at the port, which a lens that leans may have passed.
            nearest = min(prior.nearest, 0.0)
        number = CAMERA_SIGHT.first_picture + int(self._looks[robot])
        self._looks[robot] += 1
        nose, every = np.ones(1, int), np.arange(len(self._eyes.mount.rays))
        pose = truth.position[None], truth.rotation[None], nose
        picture = self._eyes.take(np.array([robot]), *pose, number, every)[0]
        recogniser = _recogniser(self._table.model_dump_json(), bore)
        ahead = sighting_of(recogniser.single(picture, prior), bore, lens, nearest)
        if ahead is None:
            return None
        lamp = self._eyes.mount.camera.lamp
        return by_depth(ahead) if lamp is None else by_lamp(ahead, fitting.is_plain)


def behind_lens(route: Route, lens: float) -> Passage:
    """Return the passage that a lens at arc length ``lens`` m looks out of.

    It is the one that the lens is in, or at the end of a route the fitting that it has just left.
    """
    index = route.index_at(lens)
    here = route.passages[index]
    past = CAMERA_SIGHT.past * 2 * here.part.fitting.port_radius(here.enter)
    new = here.part.fitting.is_plain and index == len(route.passages) - 1 and index > 0
    return route.passages[index - 1] if new and lens - here.s_enter < past else here


def sighting_of(detection: Detection, bore: float, lens: float, nearest: float) -> Sighting | None:
    """Return a sighting as seen from the robot's centre; None where it is ambiguous.

    Args:
        detection: as seen from the lens.
        bore: m, of the pipe.
        lens: m, from the robot's centre to the lens.
        nearest: m, from the lens up to which a fitting or an end is ignored.
    """
    if detection.confidence < RECOGNISER.confidence:
        return None
    numbers = np.zeros((1, PLACES))
    numbers[0, :DISTANCE] = *detection.aside, *detection.tilt
    numbers[0, TURN] = detection.turn
    # The robot's frame in that of the port plane, z on into the fitting and x as of the port.
    frame = cameras(numbers, [STILL])[1][0, 0]
    centre, reach = lens * float(frame[2, 2]), CAMERA_SIGHT.reach * bore
    ahead = Sighting(
        distance=centre + min(detection.distance, reach),
        confidence=detection.confidence,
        axis=frame[2],
    )
    if detection.kind == "straight" and detection.distance < CAMERA_SIGHT.least_free * bore:
        return None
    if detection.kind == "straight" or detection.distance > reach:
        return ahead
    if detection.distance < nearest:
        return None
    along, about, *spread = detection.stds.tolist()
    if detection.kind in ENDS:
        return replace(ahead, end=ENDS[detection.kind], distance_std=along)
    names = detection.kind, detection.enter
    form = next(form for form in forms(bore) if (form.kind, form.enter) == names)
    assert form.make is not None
    try:
        fitting = form.make(**detection.sizes)
    except GeometryError:
        return None
    if isinstance(fitting, Reducer) and fitting.length < CAMERA_SIGHT.shortest * bore:
        return None
    turn = math.atan2(-float(frame[1, 0]), float(frame[0, 0])) if form.period else 0.0
    located = replace(ahead, distance_std=along, turn=turn, turn_std=about)
    stds = dict(zip(detection.sizes, spread, strict=True))
    both = np.delete(np.delete(detection.covariance, 1, 0), 1, 1)  # less the turn
    return replace(located, fitting=fitting, enter=detection.enter, size_stds=stds, covariance=both)


def by_depth(ahead: Sighting) -> Sighting:
    """Return a sighting by the depth camera with the standard deviations that looks have."""
    std = ahead.distance_std
    if isinstance(ahead.fitting, Elbow):
        std = math.hypot(CAMERA_SIGHT.elbow_std, CAMERA_SIGHT.elbow_share * std)
    elif isinstance(ahead.fitting, Wye):
        std *= CAMERA_SIGHT.wye_share
    if ahead.covariance is None:
        return replace(ahead, distance_std=std)
    covariance = CAMERA_SIGHT.given_share**2 * ahead.covariance
    return replace(ahead, distance_std=std, covariance=covariance)


def by_lamp(ahead: Sighting, in_pipe: bool) -> Sighting:
    """Return a sighting by a lamp with what a lamp shows badly, out of a pipe or of a fitting."""
    seen = ahead.fitting
    # Its sizes are off by more than they scatter, and would move the distance with them.
    ahead = replace(ahead, covariance=None)
    if isinstance(seen, Elbow):
        told = max(ahead.size_stds.get("mean_radius", 0.0), CAMERA_SIGHT.radius * seen.mean_radius)
        ahead = replace(ahead, size_stds={**ahead.size_stds, "mean_radius": told})
        nearest = min(CAMERA_SIGHT.angles, key=lambda angle: abs(angle - seen.angle))
        if abs(nearest - seen.angle) < CAMERA_SIGHT.angle_error:
            ahead = replace(ahead, fitting=replace(seen, angle=nearest))
    free = ahead.kind == ("", "")
    if free or isinstance(seen, Reducer) or (isinstance(seen, Elbow) and not in_pipe):
        return replace(ahead, confidence=min(ahead.confidence, CAMERA_SIGHT.by_lamp))
    return ahead


# Keyed by text, as tables are no keys: a recogniser takes seconds to make.
@lru_cache(maxsize=8)
def _recogniser(table: str, bore: float) -> Recogniser:
    """Return the recogniser of a table's camera (as JSON) in pipes of a bore, m."""
    return Recogniser(camera_of(SensingTable.model_validate_json(table)), bore, RayWalls)
