"""Sight of robots that explore by their own cameras: pictures, recognised."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.recognition import Recogniser, Sighting
from omnitrack_sim.autonomy.recognition.forms import (
    DISTANCE,
    PLACES,
    STILL,
    SURE,
    TURN,
    cameras,
    forms,
)
from omnitrack_sim.autonomy.sight import Ahead
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.senses.optics import Eyes
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.walls.rays import RayWalls

TRUSTED = 2.2
"""How far from the lens what is seen is believed, in bores: 0.35 m in the bore of 0.16 m, up to
which the recogniser has been right in 100 of 100 trials with the depth camera."""
NEAREST = 0.15
"""How near to the lens the port of a fitting is believed, in bores: a lens in a bend sees a bend
begin where it is."""
BORE_STEP = 1e-3
"""Bores, m, that differ by less have one recogniser: to make one takes seconds."""
LOOKS = 1_000_000
"""Pictures of looks are counted from here on, those of the estimate from 0: each has noise of its
own."""
ENDS = {"open end": "open", "closed end": "closed"}


class CameraSight:
    """See ``Sight``; of n robots with cameras at both ends.

    Args:
        eyes: of the robots. table: ``[sensing]``.
        bore: what a robot takes for the bore that it looks along, m.
    """

    def __init__(self, eyes: Eyes, table: SensingTable, bore: Callable[[int], float]) -> None:
        self._eyes, self._table, self._bore = eyes, table, bore
        self._looks = np.zeros(len(eyes.keys), int)

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Count the looks of robots ``rows`` (k,) anew."""
        self._looks[rows] = 0

    def look(self, robot: int, position: Array, frame: Array) -> Ahead | None:
        """See ``Sight``."""
        bore = round(self._bore(robot) / BORE_STEP) * BORE_STEP
        picture = self._picture(robot, position, frame)
        return ahead_of(
            _recogniser(self._table, bore).single(picture), bore, self._eyes.mount.ahead
        )

    def _picture(self, robot: int, position: Array, frame: Array) -> Array:
        """A picture (pixels²,) from the end of a robot that leads."""
        number = LOOKS + int(self._looks[robot])
        self._looks[robot] += 1
        ahead, every = np.ones(1, int), np.arange(len(self._eyes.mount.rays))
        at = position[None], frame[None], ahead
        return self._eyes.take(np.array([robot]), *at, number, every)[0]


def ahead_of(seen: Sighting, bore: float, lens: float) -> Ahead | None:
    """What a robot takes a sighting for; None where that is not sure.

    Args:
        bore: m, of the pipe. lens: m, from the robot's centre to the lens.
    """
    if seen.confidence < SURE:
        return None
    numbers = np.zeros((1, PLACES))
    numbers[0, :DISTANCE] = *seen.aside, *seen.tilt
    numbers[0, TURN] = seen.turn
    # The robot's frame in that of the port plane, z on into the fitting and x as of the port.
    frame = cameras(numbers, [STILL])[1][0, 0]
    centre = lens * float(frame[2, 2])
    reach = TRUSTED * bore
    distance, spread, axis = centre + seen.distance, np.sqrt(np.diag(seen.covariance)), frame[2]
    if seen.kind == "straight" or seen.distance > reach:
        return Ahead(
            distance=centre + min(seen.distance, reach), confidence=seen.confidence, axis=axis
        )
    if seen.kind in ENDS:
        end = ENDS[seen.kind]
        return Ahead(
            end=end,
            distance=distance,
            distance_std=spread[0],
            confidence=seen.confidence,
            axis=axis,
        )
    if seen.distance < NEAREST * bore:
        return None
    form = next(form for form in forms(bore) if (form.kind, form.enter) == (seen.kind, seen.enter))
    assert form.make is not None
    try:
        fitting = form.make(**seen.sizes)
    except GeometryError:
        return None
    turn = math.atan2(-float(frame[1, 0]), float(frame[0, 0])) if form.period else 0.0
    along, about = spread.tolist()
    return Ahead(fitting, seen.enter, "", distance, turn, along, about, seen.confidence, axis)


def _recogniser(table: SensingTable, bore: float) -> Recogniser:
    return _made(table.model_dump_json(), bore)


@lru_cache(maxsize=8)
def _made(table: str, bore: float) -> Recogniser:
    """The recogniser of a table's camera in pipes of a bore, m."""
    return Recogniser(camera_of(SensingTable.model_validate_json(table)), bore, RayWalls)
