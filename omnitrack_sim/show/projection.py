"""Pipes projected onto a plane, for all maps in figures, films and the replay page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Centreline, Part, Route
from omnitrack_sim.results.result import Result

FEW_FITTINGS = 3
"""A route through no more fittings than this needs no map."""
SPACING = 0.03
"""Distance of neighbouring points of a drawn axis, m: a bend of 90 mm still looks round."""
CORNERS = 24
"""Corners of a drawn pipe's cross-section."""
_MAX_COMPARED = 500  # points of the pipes between which overlaps are looked for
# Azimuth and elevation, degrees: elevations from two sides, then oblique views from above.
_OBLIQUE = [
    (0, 0),
    (90, 0),
    *((side * turn, up) for up in (22, 35) for turn in (25, 40, 60) for side in (1, -1)),
]


@dataclass(frozen=True, eq=False)
class Projection:
    """Parallel projection of the world onto a picture.

    Attributes:
        axes: (3, 3) directions to the right, up and towards the viewer, as columns.
        columns: world axes along the picture's edges, where it is an elevation or a plan.
        title: what an engineer calls it.
    """

    axes: Array
    columns: tuple[int, int] = (0, 0)
    title: str = ""

    @property
    def falls(self) -> bool:
        """True where the second of ``columns`` points down.

        With y to the right, x seen from above does.
        """
        return bool(self.axes[self.columns[1], 1] < 0)

    def flat(self, points: Array) -> Array:
        """Project points (..., 3) m: (..., 2) m to the right and up."""
        return points @ self.axes[:, :2]

    def segments(self, parts: Sequence[Part]) -> list[tuple[int, Array]]:
        """Return part number and flat ends (2, 2) m of short pieces of all axes, from far to near.

        Painted in this order, nearer pipes cross over farther ones.
        """
        pieces = [
            (number, line[i : i + 2])
            for number, part in enumerate(parts)
            for line in axis_lines(part, SPACING)
            for i in range(len(line) - 1)
        ]
        depth = [float((piece @ self.axes[:, 2]).mean()) for _, piece in pieces]
        return [(pieces[i][0], self.flat(pieces[i][1])) for i in np.argsort(depth, kind="stable")]


def aligned(size: Array) -> tuple[Projection, Projection, Projection]:
    """Elevation, side elevation and plan of pipes that extend over ``size`` (3,) m.

    The longer horizontal extent lies to the right in the elevation and the plan. Right and up are
    world axes; where the plan has y to the right, x points down in it.
    """
    across = 0 if size[0] >= size[1] else 1
    other = 1 - across
    identity = np.eye(3)
    plan = np.stack([identity[across], identity[other] * (1 - 2 * across), identity[2]], axis=-1)
    return (
        _elevation(across, other),
        _elevation(other, across),
        Projection(plan, (across, other), "plan, from above"),
    )


def _elevation(across: int, along: int) -> Projection:
    right, up = np.eye(3)[across], np.eye(3)[2]
    axes = np.stack([right, up, np.cross(right, up)], axis=-1)
    return Projection(axes, (across, 2), f"elevation, along {'xyz'[along]}")


def clearest(pipes: Assembly) -> Projection:
    """Return the elevation or oblique view from above in which the fewest pipes overlap.

    Pipes that are seen end on count, too. World z is up.
    """
    lines = [line for part in pipes.parts for line in axis_lines(part, SPACING)]
    points = np.concatenate(lines)
    # All pairs are compared, so that their number has to be bounded for networks of any size.
    points = points[:: max(1, len(points) // _MAX_COMPARED)]
    steps = np.concatenate([np.diff(line, axis=0) for line in lines])
    length = np.linalg.norm(steps, axis=1)
    apart = _distances(points)
    width = 2 * max(part.fitting.radius for part in pipes.parts)
    best, least = Projection(np.eye(3)), np.inf
    for azimuth, elevation in np.radians(_OBLIQUE):
        # Of a viewer who goes from -y to the right, and up.
        level = np.cos(elevation)
        back = np.array([np.sin(azimuth) * level, -np.cos(azimuth) * level, np.sin(elevation)])
        right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        view = Projection(np.stack([right, np.cross(back, right), back], axis=-1))
        # Points of one pipe are near each other in any view: only those apart in space count.
        over = (_distances(view.flat(points)) < width) & (apart > 1.5 * width)
        shown = np.linalg.norm(view.flat(steps), axis=1) / length
        end_on = length @ np.maximum(0.6 - shown, 0.0) / length.sum()
        short = length @ (1 - shown) / length.sum()
        cost = over.any(axis=1).mean() + 2 * end_on + 0.2 * short
        if cost < least - 1e-9:  # of equals the first, whatever the last digits are
            best, least = view, cost
    return best


def _distances(points: Array) -> Array:
    """Distances (n, n) m between ``points`` (n, d) m."""
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def needs_map(result: Result) -> bool:
    """Return whether pictures of a run have a map.

    They have one of more than ``FEW_FITTINGS`` fittings, of several legs, and of a robot that makes
    a map.
    """
    routes = result.routes()
    explores = result.map is not None
    many = any(len(route.passages) > FEW_FITTINGS for route in routes)
    return explores or len(routes) > 1 or many


def axis_lines(part: Part, straight: float = np.inf) -> list[Array]:
    """Return the axes of a part, points (n, 3) m.

    Those of straight axes are ``straight`` m apart, or their two ends.
    """
    return [line.at(_stations(line, straight))[0] for line, _, _ in part.axes]


def route_line(route: Route) -> Array:
    """Points (n, 3) m of a route's centreline, 10 mm apart."""
    length = route.centreline.length
    return route.centreline.at(np.linspace(0, length, max(2, round(100 * length))))[0]


def _stations(line: Centreline, straight: float) -> Array:
    """Arc lengths (n,) m of the points through which an axis is drawn."""
    spacing = straight if line.is_straight else SPACING
    return np.linspace(0, line.length, max(2, round(line.length / spacing) + 1))


def bore_faces(pipes: Assembly) -> Array:
    """Corners (n, 4, 3) m of the faces of all bores, world frame."""
    angles, faces = np.linspace(0, 2 * np.pi, CORNERS + 1), []
    axes = ((part.fitting.ring(angles), *one) for part in pipes.parts for one in part.drawn_bores)
    for edge, line, first, last in axes:
        s = _stations(line, np.inf)
        ring = np.einsum("sij,kj->ski", line.frame(s), edge)  # (n, CORNERS + 1, 3)
        ring = line.at(s)[0][:, None] + np.linspace(first, last, len(s))[:, None, None] * ring
        corners = np.stack([ring[:-1, :-1], ring[1:, :-1], ring[1:, 1:], ring[:-1, 1:]], axis=-2)
        faces.append(corners.reshape(-1, 4, 3))
    return np.concatenate(faces)


def port_discs(pipes: Assembly) -> list[Array]:
    """Return the discs (CORNERS, 3) m that close the parts' ports.

    Seen along its axis a pipe is one of them.
    """
    angles = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    disc = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    return [
        part.port(port).apply(part.fitting.outline(port, angles)[:, None] * disc)
        for part in pipes.parts
        for port in part.fitting.port_names
    ]
