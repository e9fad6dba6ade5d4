"""Distances of points from the exact walls: plain Python on numbers, compiled by ``walls``."""

from __future__ import annotations

from omnitrack_sim.pipes.compiled import HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.walls.collider.through import at, scratch
from omnitrack_sim.walls.rays.layout import (
    CENTRE,
    PART_SIZE,
    REACH,
    ROTATION,
    SHORT,
    enter,
    span_in,
    surface_at,
)


@compiled("nearest")
def nearest(parts, maps, points, robots, count, work, found):
    """Distances of points from the walls, positive in the bore, with gradients.

    Args:
        parts, maps: as of ``trace``, a map for each robot.
        points: (robots, count, 3) m, world frame.
        work: room for 6 numbers, and zeros for ports.
        found: (robots, count, 5), written to: distance, m; unit gradient (3), world frame; number
            of the part, from the first of the map, -1 where the point lies between the port planes
            of none, and then the distance counts for nothing.
    """
    out = scratch()
    for robot in range(robots):
        first, last = int(maps[2 * robot]), int(maps[2 * robot + 1])
        for point in range(count):
            i = robot * count + point
            x, y, z = points[3 * i], points[3 * i + 1], points[3 * i + 2]
            best = -1e30
            found[5 * i], found[5 * i + 4] = 0.0, -1.0
            found[5 * i + 1] = found[5 * i + 2] = found[5 * i + 3] = 0.0
            for part in range(first, last):
                p = part * PART_SIZE
                cx, cy, cz = (
                    x - parts[p + CENTRE],
                    y - parts[p + CENTRE + 1],
                    z - parts[p + CENTRE + 2],
                )
                if cx * cx + cy * cy + cz * cz > parts[p + REACH] * parts[p + REACH]:
                    continue
                out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -SHORT, SHORT, 0.0, 0.0
                enter(parts, p, x, y, z, 0.57735, 0.57735, 0.57735, work)
                span_in(parts, p, work, at(work, 6), out)
                if out[HIGH] < out[LOW]:
                    continue
                d = surface_at(parts, p, work, 0.0, out)
                if d > best:
                    best = d
                    found[5 * i], found[5 * i + 4] = d, float(part - first)
                    for row in range(3):
                        r = p + ROTATION + 3 * row
                        found[5 * i + 1 + row] = (
                            parts[r] * out[0] + parts[r + 1] * out[1] + parts[r + 2] * out[2]
                        )
    return 0
