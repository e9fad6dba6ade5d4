"""The forms that what lies ahead may have: fittings as they are entered, and their sizes.

Lengths of tees and wyes cannot be told from what they look like, so the ones of their tables are
taken: a tee of another length is seen at the right place, and its port plane is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Elbow, Fitting, Part, Reducer, Straight, Tee, attached
from omnitrack_sim.pipes.fittings.wye import Wye

BEHIND, BEYOND = 0.9, 1.6
"""Length, m, of the straight before a fitting and of those beyond it."""
Map = tuple[tuple[Part, ...], tuple[tuple[int, str], ...]]
"""Parts, and the ports of them that a plate closes."""


@dataclass(frozen=True)
class Size:
    """A size of a fitting that is sought.

    Attributes:
        key: of the fitting's constructor. low, high: its bounds. step: by which it is changed to
            see what that does to a picture. middle, spread: what is expected of it beforehand.
    """

    key: str
    low: float
    high: float
    step: float
    middle: float
    spread: float


@dataclass(frozen=True)
class Form:
    """What may lie ahead.

    Attributes:
        name: of its own. kind, enter: as of a ``Sighting``.
        make: the fitting of given sizes; none: the pipe ends, or goes on.
        closed: whether a plate closes the pipe. ends: whether the pipe ends.
        sizes: that are sought. starts: their values that the search begins with.
        period: rad, turn after which it looks the same; 0 for what is round about the axis.
    """

    name: str
    kind: str
    enter: str = ""
    make: Callable[..., Fitting] | None = None
    closed: bool = False
    ends: bool = False
    sizes: tuple[Size, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ((),)
    period: float = 0.0

    @property
    def parameters(self) -> int:
        """How many numbers describe it, besides where the camera stands in the straight pipe."""
        placed = self.ends or self.make is not None
        return placed + (self.period > 0) + len(self.sizes)

    def map(self, sizes: Sequence[float], bore: float) -> Map:
        """Its parts where the port plane is z = 0, the robot comes along +z, and the x axis of the
        port is x."""
        if self.make is None and not self.ends:
            middle = Pose(np.eye(3), np.array([0, 0, -BEYOND]))
            return (Part("straight", Straight(2 * BEYOND, bore), middle),), ()
        lead = Part("before", Straight(BEHIND, bore), Pose(np.eye(3), np.array([0, 0, -BEHIND])))
        if self.make is None:
            return (lead,), (((0, "end"),) if self.closed else ())
        fitting = self.make(**dict(zip([size.key for size in self.sizes], sizes, strict=True)))
        part = _joined(lead, "end", fitting, self.enter)
        others = [port for port in fitting.port_names if port != self.enter]
        after = [
            _joined(part, port, Straight(BEYOND, 2 * fitting.port_radius(port)), "start")
            for port in others
        ]
        return (lead, part, *after), ()


def _joined(part: Part, port: str, fitting: Fitting, enter: str) -> Part:
    return Part("ahead", fitting, attached(part.port(port), fitting, enter, 0.0))


def forms(bore: float) -> tuple[Form, ...]:
    """Every form for pipes of a bore, m."""
    whole, half = 2 * math.pi, math.pi
    radius = Size("mean_radius", 0.505 * bore, 3.0 * bore, 0.02 * bore, 1.2 * bore, bore)
    angle = Size("angle", math.radians(10), math.radians(120), 0.03, 1.2, 0.5)
    lean = Size("angle", math.radians(45), math.radians(75), 0.03, math.radians(52), 0.15)
    length = Size("length", 0.2 * bore, 2.5 * bore, 0.03 * bore, 0.7 * bore, 0.3 * bore)
    narrow = Size("end_diameter", 0.5 * bore, 0.97 * bore, 0.01 * bore, 0.8 * bore, 0.2 * bore)
    wide = Size("end_diameter", 1.03 * bore, 1.6 * bore, 0.01 * bore, 1.2 * bore, 0.2 * bore)
    elbow, reducer = partial(Elbow, inner_diameter=bore), partial(_reducer, bore)
    tee = partial(Tee, inner_diameter=bore)
    wye = partial(Wye, inner_diameter=bore, branch_diameter=bore)
    bends = tuple(
        (r * bore, a) for r in (0.5625, 0.75, 1.0, 1.4, 1.9) for a in (half / 4, half / 2)
    )
    leans = ((half / 4,), (half / 3,))
    return (
        Form("straight", "straight"),
        Form("joint", "straight", "start", partial(Straight, BEYOND, bore)),
        Form("elbow", "elbow", "start", elbow, sizes=(radius, angle), starts=bends, period=whole),
        Form("tee over", "tee", "run_start", tee, period=whole),
        Form("tee into", "tee", "branch", tee, period=half),
        Form("wye turn", "wye", "run_start", wye, sizes=(lean,), starts=leans, period=whole),
        Form("wye sharp", "wye", "run_end", wye, sizes=(lean,), starts=leans, period=whole),
        Form("wye merge", "wye", "branch", wye, sizes=(lean,), starts=leans, period=whole),
        Form(
            "narrow",
            "reducer",
            "start",
            reducer,
            sizes=(narrow, length),
            starts=tuple((e * bore, 0.65 * bore) for e in (0.65, 0.8, 0.94)),
        ),
        Form(
            "wide",
            "reducer",
            "start",
            reducer,
            sizes=(wide, length),
            starts=tuple((e * bore, 0.65 * bore) for e in (1.06, 1.2, 1.4)),
        ),
        Form("open", "open end", ends=True),
        Form("closed", "closed end", ends=True, closed=True),
    )


def _reducer(bore: float, end_diameter: float, length: float) -> Reducer:
    """A reducer of any sizes, made longer where it would be too steep."""
    least = 1.001 * abs(end_diameter - bore) / 2 / math.tan(math.radians(20))
    return Reducer(max(length, least), end_diameter, bore)
