"""What several looks of a robot that explores tell together, and when it looks again.

One sighting may be wrong in kind, position and sizes, most of all from afar and out of a fitting.
So a robot looks several times. Each reason to look again is a ``LookRecord``: it keeps the looks
that it has had, and hears of another leg and of parts that are removed from the map.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.belief import BELIEF, Belief
from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.autonomy.sight import Sighting
from omnitrack_sim.base.rotations import Array, angle_between
from omnitrack_sim.pipes import Elbow, Fitting, Reducer, Route, Wye


@dataclass(frozen=True)
class LookSettings:
    """Conditions in which a robot that explores looks again at what it has observed or passed.

    Attributes:
        sure: probability from which on an observation is not in doubt.
        step: m, travel between two looks along a pipe whose end is not in sight.
        step_again: m, travel to the next look where one was ambiguous or another is to agree: what
            a picture shows changes little within 10 mm. It doubles with each look back that tells
            nothing.
        in_sight: m, to a fitting behind it up to which a robot looks back whenever it looks ahead:
            a lamp shows no more from farther off.
        max_shift: m, shift of arc length from which on two looks have to agree.
        close: m, from one end of the robot to the end of a straight, or to a fitting, when it looks
            there from close by: from there both cameras measure distances to 1 or 2 mm. From half
            of it a lens sees too little of the wall before it.
        gate: standard deviations by which two measurements contradict each other, such as two looks
            between which belts have slipped: of 440 looks by both cameras one was off by more.
        travel_std: standard deviation of a travel along a pipe, as a part of it. With 1 %, as in
            the filter, which has to follow belts that slip, ten lengths were off by a quarter of
            what was stated.
        through_cone: m, from its rear to a fitting behind it up to which a robot may look through
            the cone of a reducer directly behind that, and not see it.
        max_axis_error: rad, between the axis of a pipe on the map and in a picture, from which on
            sizes and distances in that are wrong: by a lamp radii and distances are 20 mm too
            great.
        max_reducer_std: m, standard deviation of the distance of a reducer from which on its ends
            hardly show: right ones have 8 to 14 mm, wrong ones 29 to 40.
        common_std: m, standard deviation of what looks at one size have in common, which no
            mean of them reduces.
        min_looks: looks from one side that a size is the mean of.
        max_looks: the same where they leave a size in doubt, or the length of the pipe before it,
            or differ: looks by depth at reducers of 3 % scatter by 5 to 7 mm, and now and then one
            is off by 20 mm; of looks by a lamp at elbows of 45 degrees one in five is off by 60 mm.
            The least and the greatest of more than ``min_looks`` are left out.
    """

    sure: float = RECOGNISER.confidence
    step: float = 0.1
    step_again: float = 0.01
    in_sight: float = 0.4
    max_shift: float = 0.1
    close: float = 0.1
    gate: float = 3.0
    travel_std: float = 0.005
    through_cone: float = 0.2
    max_axis_error: float = math.radians(1.5)
    max_reducer_std: float = 0.02
    common_std: float = 0.001
    min_looks: int = 3
    max_looks: int = 6


LOOKS = LookSettings()

SHALLOW = "a shallow reducer may be in it"
"""Doubt about pipe that a lamp shows as free."""
HARDLY_SHOWS = "its sizes hardly show"
"""Doubt about a fitting that was seen unsurely."""


class LookRecord:
    """What a robot remembers of its looks, for one purpose."""

    def begin_leg(self) -> None:
        """Forget what was of the leg before."""

    def forget_part(self, part: int) -> None:
        """Forget a part, which is removed from the map."""


def has_slipped(shift: float, *stds: float) -> bool:
    """Return whether belts have slipped where looks place a robot ``shift`` m elsewhere.

    ``stds`` are the standard deviations of these looks, m.
    """
    return abs(shift) > LOOKS.gate * math.hypot(LOOKS.common_std, *stds)


def weights_of(stds: Sequence[float]) -> Array:
    """Return weights (n,) of measurements, 1/m², by their standard deviations, m."""
    return np.maximum(stds, BELIEF.resolution) ** -2


def without_extremes(values: Array) -> NDArray[np.intp]:
    """Return indices of values in ascending order, without the extremes of many.

    The least and the greatest of more than ``LOOKS.min_looks`` are left out: one look may be far
    off.
    """
    order = np.argsort(values, kind="stable")
    return order[1:-1] if len(order) > LOOKS.min_looks else order


def common_std(stds: Sequence[float], values: Sequence[float] = ()) -> float:
    """Standard deviation of the mean of looks at one size.

    Args:
        stds: of each look, as it tells; 0 by error-free sight, whose mean has none.
        values: of the size by each look: what they scatter by counts where it is more.
    """
    if not any(stds):
        return 0.0
    told = float(weights_of(stds).sum()) ** -0.5
    scatter = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return math.hypot(LOOKS.common_std, max(told, scatter))


def reducer_std(stds: Sequence[float], lengths: Sequence[float]) -> float:
    """Return the standard deviation, m, of the mean length of a reducer by looks from one side.

    As ``common_std``; but what blurs the ends of a shallow cone is the same in all of them: their
    mean is known no better than by the best.
    """
    return max(common_std(stds, lengths), min(stds))


def provisional_passage(belief: Belief, route: Route) -> int | None:
    """Return the number of the passage through the straight whose end is provisional.

    None where the route has none.
    """
    parts = [passage.index for passage in route.passages]
    part = belief.provisional
    return None if part is None or part not in parts else parts.index(part)


def is_along(ahead: Sighting, frame: Array, axis: Array) -> bool:
    """Return whether a sighting has the axis of the pipe where it is on the map.

    A picture in which that is wrong has wrong sizes and distances too. ``frame`` (3, 3) is that of
    the sighting, ``axis`` (3,) that of the pipe, world frame.
    """
    return float(angle_between(frame @ ahead.axis, axis)) < LOOKS.max_axis_error


def size_stds(looks: Sequence[Sighting], mean: Fitting) -> dict[str, float]:
    """Return the standard deviations of sizes that are the mean of looks from before a fitting.

    In m and rad, by their keys. The angle of a bend is hidden there, and has none.
    """
    seen = [look.fitting for look in looks]
    stds: dict[str, float] = {}
    if isinstance(mean, Elbow):
        stds["mean_radius"] = common_std(
            [look.size_stds.get("mean_radius", 0.0) for look in looks],
            [elbow.mean_radius for elbow in seen if isinstance(elbow, Elbow)],
        )
    elif isinstance(mean, Reducer):
        reducers = [one for one in seen if isinstance(one, Reducer)]
        stds["length"] = reducer_std(
            [look.distance_std for look in looks], [one.length for one in reducers]
        )
        stds["end_diameter"] = common_std(
            [look.size_stds.get("end_diameter", 0.0) for look in looks],
            [one.end_diameter for one in reducers],
        )
    elif isinstance(mean, Wye):
        (look,) = looks
        told = look.size_stds.get("angle", 0.0)
        stds["angle"] = math.hypot(BELIEF.angle_std, told) if told else 0.0
    return stds
