"""Distances from walls with relief, sections and scans against brute force.

    python benchmarks/relief_distances.py [--quick] [--points 10000] [--seed 1]

Prints, for each wall, the largest error of the signed distance at random points of the bore at
least 1 mm from the wall. The reference is the nearest of all places of the wall 0.25 mm apart,
refined over a grid about it ten times as fine, and again: nowhere does it follow a slope.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from shape import Arguments, table

import omnitrack_sim as ot

SPACING, FINER, ROUNDS = 2.5e-4, 10, 3
"""Of the places, m; how much finer a grid about the nearest one is, and how often."""
MIDDLE, ASIDE, AROUND = 0.19, 0.012, 0.08
"""Where the points are along a pipe, and how far to both sides, m; and how far beyond that places
are looked at."""
CHUNK = 500
"""Points that are looked at together."""
KINDS: dict[str, dict[str, Any]] = {
    "ovality": {"kind": "ovality", "ratio": 0.06, "direction_deg": 20},
    "dent": {"kind": "dent", "at": MIDDLE, "depth": 0.008, "length": 0.08, "width": 0.06},
    "narrow dent": {"kind": "dent", "at": MIDDLE, "depth": 0.004, "length": 0.02, "width": 0.02},
    "corrosion": {"kind": "corrosion", "roughness": 0.001, "wavelength": 0.03, "seed": 3},
    "fine corrosion": {"kind": "corrosion", "roughness": 5e-4, "wavelength": 0.01, "seed": 4},
}


def scanned() -> ot.Profile:
    """A scan with noise of an oval pipe with a dent."""
    wall, rng = ot.Straight(0.4, relief=[KINDS["ovality"], KINDS["dent"]]), np.random.default_rng(1)
    s, angle = np.meshgrid(np.arange(0, 0.4, 0.004), np.radians(np.arange(360.0)), indexing="ij")
    x, y, _ = np.moveaxis(wall.on_wall(np.stack([s, angle], axis=-1)), -1, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ot.Profile.from_rays(s, angle, np.hypot(x, y) + rng.normal(0, 5e-4, s.shape))


def walls() -> Iterator[tuple[str, ot.Straight | ot.Elbow]]:
    """Yield walls by name."""
    for name, kind in KINDS.items():
        yield name, ot.Straight(0.4, relief=[kind])
        yield f"{name}, bend", ot.Elbow(0.24, relief=[kind])
        yield f"{name}, tight bend", ot.Elbow(0.16, math.pi / 1.3, relief=[kind])
    yield "scan", ot.Straight(0.4, profile=scanned())
    yield "scan, bend", ot.Elbow(0.26, profile=scanned())


def nearest(on_wall: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Return the distances of points (k, 3) m from a wall, by its places alone."""
    s = np.arange(MIDDLE - ASIDE - AROUND, MIDDLE + ASIDE + AROUND, SPACING)
    angles = np.arange(0, 2 * np.pi, SPACING / 0.08)
    places = np.stack(np.meshgrid(s, angles, indexing="ij"), axis=-1).reshape(-1, 2)
    found = places[cKDTree(on_wall(places)).query(points)[1]]
    chunks = range(0, len(points), CHUNK)
    parts = (refined(on_wall, points[i : i + CHUNK], found[i : i + CHUNK]) for i in chunks)
    return np.concatenate(list(parts))


def refined(
    on_wall: Callable[[np.ndarray], np.ndarray], points: np.ndarray, found: np.ndarray
) -> np.ndarray:
    """Return the distances of points (k, 3) m from the nearest places about ``found`` (k, 2)."""
    away, size = np.zeros(len(points)), np.array([SPACING, SPACING / 0.08])
    grid = np.arange(-FINER, FINER + 1) / FINER
    offsets = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    for _ in range(ROUNDS):
        tried = found[:, None] + size * offsets
        distances = np.linalg.norm(on_wall(tried) - points[:, None], axis=-1)
        best = distances.argmin(axis=1)
        found, away = tried[np.arange(len(points)), best], distances.min(axis=1)
        size = size / FINER
    return away


def error(fitting: ot.Straight | ot.Elbow, count: int, rng: np.random.Generator) -> float:
    """Return the largest error of the distance, m."""
    s, angle = rng.uniform(MIDDLE - ASIDE, MIDDLE + ASIDE, count), rng.uniform(0, 2 * np.pi, count)
    far = 0.078 * np.sqrt(rng.uniform(0, 1, count))
    across = np.stack([far * np.cos(angle), far * np.sin(angle), 0 * s], axis=-1)
    frames = [fitting.axis_frame(float(each)) for each in s]
    points = np.array([f.position + f.rotation @ p for f, p in zip(frames, across, strict=True)])
    distances = fitting.signed_distance(points)[0]
    points, distances = points[distances > 1e-3], distances[distances > 1e-3]
    return float(np.abs(distances - nearest(fitting.on_wall, points)).max())


def main() -> None:
    """Measure and print the table."""
    arguments = Arguments(__doc__, trials=10_000, quick=300, of="points", seed=1)
    given: Any = arguments.read()

    def rows() -> Iterator[list[str]]:
        for name, fitting in walls():
            largest = error(fitting, given.points, np.random.default_rng(given.seed))
            yield [name, f"{1e6 * largest:.2f}"]

    text = f"At {given.points:,} points of each wall:"
    table("relief_distances", ("wall", "largest error, um"), rows(), text)


if __name__ == "__main__":
    main()
