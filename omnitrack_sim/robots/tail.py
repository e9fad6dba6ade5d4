"""Force on a robot's tail: the tether that it drags along; channels and metrics of the force."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.centreline import Segment
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.metrics import Metric, Run
from omnitrack_sim.robots.quantity import QuantityModel, quantity

STANDARD_GRAVITY = 9.81
"""Acceleration, m/s², at which a metre of tether weighs what its table says."""
STEP = math.radians(5.0)
"""Angle of a bend that one step of the tension's integration covers: it errs by 1e-7 at a friction
of 1."""


class Tether(QuantityModel):
    """A line that the robot drags from where it came in: cable, hose or rope.

    Along the way passed, s from the opening to the robot's tail, its tension T grows by

        dT/ds = mu norm(T kappa n + w g') - w g . t,    T >= 0

    where t is the tangent, n the normal towards the bend, kappa the curvature, g the direction of
    gravity, g' its part across the way, and mu and w friction and weight. In a bend without weight
    this is the capstan's law, T = T0 exp(mu beta); on a slope the weight's part along the way
    counts with its sign. While the robot goes back, friction acts the other way, and tension falls
    to that of its stretch. A line that is used up holds as a spring does.

    Example:
        >>> tether = ot.Tether(weight=0.8, friction=0.25)
        >>> route = ot.load_scenario("elbow").route
        >>> round(float(tether.tensions(route.segments, [0, 0, -9.81])[-1, 1]), 2)
        0.74
    """

    weight: float = quantity(0.5, "N/m", "assumed", "of a metre: a cable of 8 mm", (0.0, 1e4))
    friction: float = quantity(0.3, "1", "assumed", "of its sheath on the wall", (0.0, 5.0))
    stiffness: float = quantity(
        2e4, "N", "assumed", "of a metre: tension over strain, of aramid strands", (1.0, 1e9)
    )
    length: float = quantity(100.0, "m", "assumed", "that there is", (1e-3, 1e5))
    tension: float = quantity(0.0, "N", "assumed", "at the opening: the reel's", (0.0, 1e5))

    def tensions(
        self,
        segments: Iterable[Segment],
        gravity: Array,
        start: tuple[float, float] | None = None,
    ) -> Array:
        """Return tensions (k, 3) at nodes of a way, between which they are linear.

        Each row is arc length, m, tension while the robot drags the line forward, and while it
        slides back, N.

        Args:
            segments: of the way, in order.
            gravity: (3,) m/s², world frame.
            start: both tensions where the way begins; the reel's when not given.
        """
        down = np.asarray(gravity, float) * (self.weight / STANDARD_GRAVITY)  # N/m
        drag, slack = (self.tension, self.tension) if start is None else start
        nodes, s = [(0.0, drag, slack)], 0.0
        for segment in segments:
            forward = self._along(segment, down, drag, self.friction)
            backward = self._along(segment, down, slack, -self.friction)
            # Either may go slack in between.
            places = np.unique([s for s, _ in (*forward, *backward)])
            drags = np.interp(places, *np.array(forward).T)
            slacks = np.interp(places, *np.array(backward).T)
            nodes += zip((s + places).tolist(), drags.tolist(), slacks.tolist(), strict=True)
            s, drag, slack = s + segment.length, forward[-1][1], backward[-1][1]
        return np.array(nodes)

    def _along(
        self, segment: Segment, down: Array, tension: float, friction: float
    ) -> list[tuple[float, float]]:
        """Return arc lengths and tensions along one segment.

        Of a straight they are given where it begins, ends or goes slack, of an arc at steps.
        """
        length, t, n = segment.length, segment.tangent, segment.normal
        if segment.curvature == 0:
            part = float(down @ t)
            slope = friction * float(np.linalg.norm(down - part * t)) - part
            end = tension + slope * length
            slack = [] if end >= 0 else [(-tension / slope, 0.0)]
            return [(0.0, tension), *slack, (length, max(end, 0.0))]
        along, across = float(down @ t), float(down @ n)
        aside = float(down @ np.cross(t, n))

        def rate(s: float, tension: float) -> float:
            cos, sin = math.cos(s * segment.curvature), math.sin(s * segment.curvature)
            inward = tension * segment.curvature + across * cos - along * sin
            return friction * math.hypot(inward, aside) - (along * cos + across * sin)

        count = math.ceil(length * segment.curvature / STEP)
        h, nodes = length / count, [(0.0, tension)]
        for i in range(count):
            s = i * h
            # The classical method of Runge and Kutta.
            a = rate(s, tension)
            b = rate(s + h / 2, tension + h / 2 * a)
            c = rate(s + h / 2, tension + h / 2 * b)
            d = rate(s + h, tension + h * c)
            tension = max(tension + h / 6 * (a + 2 * b + 2 * c + d), 0.0)
            nodes.append((s + h, tension))
        return nodes


def rest(segments: Iterable[Segment], start: float) -> Iterator[Segment]:
    """Yield what is left of segments behind arc length ``start`` m."""
    for segment in segments:
        if start <= 0:
            yield segment
        elif start < segment.length:
            angle = start * segment.curvature
            cos, sin = math.cos(angle), math.sin(angle)
            t, n = segment.tangent, segment.normal
            tangent, normal = (t, n) if not angle else (t * cos + n * sin, n * cos - t * sin)
            left = segment.length - start
            yield replace(segment, length=left, tangent=tangent, normal=normal)
        start -= segment.length


TAIL_CHANNELS = (
    Channel(
        "tail_force",
        (),
        "N",
        "force on the robot's tail along the pipe, positive backward",
        "route",
        source="route",
    ),
    Channel(
        "tail_force_max",
        (),
        "N",
        "largest `tail_force` so far, as the drag pointer of a spring balance shows it",
        "route",
        source="route",
    ),
)
"""Recorded where something pulls at robots' tails."""
TETHER_CHANNELS = (
    Channel("tether_out", (), "m", "tether from the opening to the robot's tail", source="route"),
)
"""Recorded beside them with a tether."""


def _force_at_max_distance(run: Run) -> float:
    """Force at the sample in which the robot was farthest on its last leg, N."""
    leg, distance = run.trajectory["leg"], run.trajectory["distance"]
    # Arc lengths of different legs cannot be compared.
    farthest = np.where(leg == leg[-1], distance, -np.inf).argmax()
    return float(run.trajectory["tail_force"][farthest])


TAIL_METRICS = (
    Metric(
        "pull_held_n",
        "N",
        "force at the tail when the robot was farthest on its last leg: the largest that it still "
        "moved against; of a robot that nothing stopped a lower bound",
        _force_at_max_distance,
    ),
    Metric(
        "tail_force_max_n",
        "N",
        "largest force at the tail, also while the robot slid back",
        lambda run: float(run.trajectory["tail_force"].max()),
    ),
)
"""Computed where something pulls at robots' tails."""
TETHER_METRICS = (
    Metric(
        "tether_out_max_m",
        "m",
        "largest length of tether from the opening to the robot's tail",
        lambda run: float(run.trajectory["tether_out"].max()),
    ),
)
"""Computed beside them with a tether."""
