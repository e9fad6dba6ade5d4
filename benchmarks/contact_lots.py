"""Least distances of bodies from exact walls against branch and bound, in many poses by lot.

    python benchmarks/contact_lots.py [--quick] [--poses 100000] [--seed 1] [--workers N]

Prints, for each type of geom in each fitting, the largest error of the least distance that MuJoCo's
contacts tell, over random poses up to 1 mm off the wall and up to 1 mm in it. The reference cuts
the body's whole surface into cells and drops one only if no point of it can be nearer, by 5 um,
than the nearest that is known: from any point p of the bore the distance from the wall changes by
no more than a metre a metre. It shares the formulas of the walls with the collider, and nothing
else.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from ctypes import CFUNCTYPE
from itertools import product
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from shape import Arguments, run_tasks, table
from touching_geom import SHAPES as COMMON
from touching_geom import add_body

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import (
    NUMBER,
    NUMBERS,
    WORD,
    c_function,
    call_span,
    call_surface,
    pointers,
    scratch,
)

GEOM = mujoco.mjtGeom
FITTINGS = {
    "straight": ot.Straight(0.4),
    "oval": ot.Straight(0.4, section="oval", ovality=0.2, direction=0.5),
    "egg": ot.Straight(0.4, section="egg", direction=1.0),
    "mouth": ot.Straight(0.4, section="mouth", direction=2.0),
    "arch": ot.Straight(0.4, section="arch", direction=3.0),
    "elbow": ot.Elbow(0.24),
    "tight elbow": ot.Elbow(0.09),
    "reducer": ot.Reducer(0.15, 0.12),
    "tee": ot.Tee(),
    "wye": ot.Wye(angle=math.radians(50)),
    "sharp wye": ot.Wye(angle=math.radians(30)),
    "narrow wye": ot.Wye(branch_diameter=0.1),
    "cross": ot.Cross(),
    "oblique cross": ot.Cross(angle=math.radians(60)),
    "narrow cross": ot.Cross(angle=math.radians(50), branch_diameter=0.1),
    "mitre": ot.Mitre(),
    "flat mitre": ot.Mitre(angle=math.radians(40)),
    "sharp mitre": ot.Mitre(angle=math.radians(135)),
    "offset": ot.Coupling(offset=0.006, direction=1.0),
    "step": ot.Coupling(end_diameter=0.15, edge_radius=0.002),
    "gap": ot.Coupling(gap=0.012, depth=0.015),
    "old joint": ot.Coupling(
        0.2, 0.156, 0.004, direction=2.0, angle=math.radians(3), gap=0.012, depth=0.01
    ),
}
SHAPES = {
    **COMMON,
    "tyre": (GEOM.mjGEOM_ELLIPSOID, [0.035, 0.035, 0.01]),
    "disc": (GEOM.mjGEOM_CYLINDER, [0.04, 0.003, 0]),
}
MARGIN, GAP = 0.004, 1e-3
"""Of the geom, m; largest distance of a pose from the wall, m, to either side."""
LOOSE, TOLERANCE, ALLOWED = 2e-4, 5e-6, 2e-5
"""Accuracy of the reference, m, while a body is placed, and of the error; and the largest error, m,
that passes."""
CELLS = 8000
"""That wait to be looked at, at most."""
DIRECTIONS = unit(np.array([p for p in product((-1.0, 0.0, 1.0), repeat=3) if any(p)]))
"""Unit vectors all around (26, 3)."""
TRIANGLE, MANTLE, LID, SIDE, LINE, ROW = 0.0, 1.0, 2.0, 3.0, 4.0, 13
"""Kinds of patches of a surface, and numbers of one: a triangle, a cylinder's mantle and its lids,
sides of an ellipsoid, and the line along which a ball is moved."""
_LEAST = CFUNCTYPE(NUMBER, WORD, WORD, *[NUMBERS] * 3, WORD, *[NUMBER] * 3, NUMBERS, NUMBERS)


@compiled
def _place_on(patches, k, u, v, du, dv, out):
    """Write a patch's point and normal to out[8:14]; return the radius of a ball about the cell."""
    kind = patches[k]
    if kind == TRIANGLE:
        s, t = 0.5 * (u + 1.0), 0.5 * (v + 1.0)
        along = across = 0.0
        for i in range(3):
            a, b = patches[k + 4 + i], patches[k + 7 + i]
            way = (1.0 - t) * a + t * b
            out[8 + i], out[11 + i] = patches[k + 1 + i] + s * way, patches[k + 10 + i]
            along, across = along + way * way, across + (b - a) * (b - a)
        return 0.5 * du * math.sqrt(along) + 0.5 * dv * (s + 0.5 * du) * math.sqrt(across)
    a, b = patches[k + 1], patches[k + 2]
    cos, sin = math.cos(math.pi * v), math.sin(math.pi * v)
    if kind == MANTLE:
        out[8], out[9], out[10], out[11], out[12], out[13] = a * cos, a * sin, b * u, cos, sin, 0.0
        return math.hypot(math.pi * a * dv, b * du)
    if kind == LID:
        r = 0.5 * a * (u + 1.0)
        out[8], out[9], out[10] = r * cos, r * sin, b
        out[11], out[12], out[13] = 0.0, 0.0, math.copysign(1.0, b)
        return math.hypot(0.5 * a * du, math.pi * (r + 0.5 * a * du) * dv)
    if kind == LINE:
        out[8], out[9], out[10], out[11], out[12], out[13] = 0.0, 0.0, b * u, 0.0, 0.0, 0.0
        return b * du
    size, axis = 0.0, int(a)
    for i in range(3):
        way = b if i == axis else (u if i == (axis + 1) % 3 else v)
        way /= math.sqrt(1.0 + u * u + v * v)
        half = patches[k + 3 + i]
        out[8 + i], out[11 + i] = half * way, way / half
        size += out[11 + i] * out[11 + i]
    for i in range(3):
        out[11 + i] /= math.sqrt(size)
    least = 1.0 + max(abs(u) - du, 0.0) ** 2 + max(abs(v) - dv, 0.0) ** 2
    most = max(patches[k + 3], patches[k + 4], patches[k + 5])
    return most * math.sqrt((du * du + dv * dv) / least)


@compiled
def _lower_bound(surface, sizes, patches, k, frame, h, place, d, bore, enough, out):
    """Return a bound below the distance over a cell, about whose middle the distance is d m.

    A convex body lies behind the plane that touches it there.
    """
    x, y, z = place
    gx, gy, gz = out[0], out[1], out[2]
    lx = frame[3] * gx + frame[6] * gy + frame[9] * gz
    ly = frame[4] * gx + frame[7] * gy + frame[10] * gz
    lz = frame[5] * gx + frame[8] * gy + frame[11] * gz
    facing = -(lx * out[11] + ly * out[12] + lz * out[13])
    aside = h
    if patches[k] == LINE:
        aside = h * abs(lz)
    elif facing > 0.0:
        aside = h * math.sqrt(max(1.0 - facing * facing, 0.0))
    least, r = d - h, max(bore - d, h)
    for _ in range(6):
        there = call_surface(surface, sizes, x + r * gx, y + r * gy, z + r * gz, out)
        least = max(least, there - math.sqrt(r * r + 2.0 * r * aside + h * h))
        if there > d + r - 1e-9 or least >= enough:
            break
        r = max(min(0.48 * (there - d + r), 0.6 * r), 0.2 * r)
    return least


@compiled
def _is_held(span, sizes, x, y, z, out):
    """Tell whether a point lies between the port planes."""
    out[0], out[1], out[2], out[3] = -1e-9, 1e-9, 0.0, 0.0
    # No end is one of the wall's.
    call_span(span, sizes, out, x, y, z, 0.6, 0.48, 0.64, out)
    return out[1] >= out[0]


def _least_distance(surface, span, sizes, patches, frame, count, bore, tolerance, best, work, told):
    """Return the least distance, m, of the points between the port planes, at most ``best``.

    ``told`` gets the number of cells, negative where there is no room for more.
    """
    out, n, cells = scratch(), count, 0
    for i in range(count):
        work[5 * i] = float(ROW * i)
        work[5 * i + 1] = work[5 * i + 2] = 0.0
        work[5 * i + 3] = work[5 * i + 4] = 1.0
    while n > 0:
        n -= 1
        cells += 1
        k, u, v = int(work[5 * n]), work[5 * n + 1], work[5 * n + 2]
        du, dv = work[5 * n + 3], work[5 * n + 4]
        h = _place_on(patches, k, u, v, du, dv, out)
        x = frame[0] + frame[3] * out[8] + frame[4] * out[9] + frame[5] * out[10]
        y = frame[1] + frame[6] * out[8] + frame[7] * out[9] + frame[8] * out[10]
        z = frame[2] + frame[9] * out[8] + frame[10] * out[9] + frame[11] * out[10]
        d = call_surface(surface, sizes, x, y, z, out)
        if d - h >= best - tolerance:
            continue
        enough, place = best - tolerance, (x, y, z)
        low = _lower_bound(surface, sizes, patches, k, frame, h, place, d, bore, enough, out)
        if d < best:
            if _is_held(span, sizes, x, y, z, out):
                best = d
            elif h < LOOSE:
                continue
        if low >= best - tolerance:
            continue
        if n + 4 > CELLS:
            told[0] = -1.0
            return best
        for i in range(4):
            first, second = 2.0 * (i & 1) - 1.0, (i & 2) - 1.0
            work[5 * n], work[5 * n + 1], work[5 * n + 2] = float(k), u + 0.5 * du * first, v
            work[5 * n + 3], work[5 * n + 4] = 0.5 * du, dv
            if patches[k] != LINE:
                work[5 * n + 2], work[5 * n + 4] = v + 0.5 * dv * second, 0.5 * dv
            n += 1 * (patches[k] != LINE or i < 2)
    told[0] = float(cells)
    return best


def patches_of(
    shape: str, size: list[float], vertices: np.ndarray
) -> tuple[list[list[float]], float]:
    """Return the patches of a geom's surface, and the radius, m, of the ball about a line."""
    a, b, c = size
    kind = SHAPES[shape][0]
    if kind in (GEOM.mjGEOM_SPHERE, GEOM.mjGEOM_CAPSULE):
        return [_row(LINE, a, b if kind == GEOM.mjGEOM_CAPSULE else 0.0)], a
    if kind == GEOM.mjGEOM_CYLINDER:
        return [_row(MANTLE, a, b), _row(LID, a, b), _row(LID, a, -b)], 0.0
    if kind == GEOM.mjGEOM_ELLIPSOID:
        return [_row(SIDE, i, sign, a, b, c) for i in range(3) for sign in (-1.0, 1.0)], 0.0
    if kind == GEOM.mjGEOM_BOX:
        vertices = np.array([[x, y, z] for x in (-a, a) for y in (-b, b) for z in (-c, c)])
    rows, middle = [], vertices.mean(axis=0)
    for p, q, r in vertices[ConvexHull(vertices).simplices]:
        normal = unit(np.cross(q - p, r - p))
        rows.append(
            _row(TRIANGLE, *p, *(q - p), *(r - p), *normal * np.sign(normal @ (p - middle)))
        )
    return rows, 0.0


def _row(kind: float, *numbers: float) -> list[float]:
    return [kind, *numbers, *[0.0] * (ROW - 1 - len(numbers))]


class Lot:
    """A geom in a fitting, in poses by lot.

    Attributes:
        model, data: of MuJoCo, with the fitting's exact wall.
    """

    def __init__(self, fitting: ot.Fitting, shape: str) -> None:
        spec = mujoco.MjSpec()
        ot.add_pipes(spec, Assembly((Part("pipe", fitting, Pose()),)))
        if shape in COMMON:
            geom = add_body(spec, shape)
        else:
            kind, size = SHAPES[shape]
            body = spec.worldbody.add_body()
            body.add_freejoint()
            geom = body.add_geom(type=kind, size=size)
        geom.margin = MARGIN
        self.fitting, self.model = fitting, spec.compile()
        self.data = mujoco.MjData(self.model)
        number = self.model.ngeom - 1
        self.bound, matrix = self.model.geom_rbound[number], np.empty(9)
        mujoco.mju_quat2Mat(matrix, self.model.geom_quat[number])
        # MuJoCo turns a mesh into its principal axes: the geom is what is placed.
        self._own = Pose(matrix.reshape(3, 3), self.model.geom_pos[number]).inverse()
        size, vertices = list(self.model.geom_size[number]), self.model.mesh_vert.astype(float)
        rows, self._reach = patches_of(shape, size, vertices)
        self._count, self._frame = len(rows), np.empty(12)
        self._kept = np.array(fitting.sizes), np.ravel(rows), np.empty(5 * CELLS), np.zeros(1)
        self._pointers = pointers(*self._kept)
        self._walls = fitting.wall_address("surface"), fitting.wall_address("span")
        self._bore = 0.95 * min(fitting.port_radius(port) for port in fitting.port_names)
        self._call = c_function(_least_distance, _LEAST).ctypes

    def least(self, pose: Pose, tolerance: float, best: float = 1.0) -> float:
        """Return the least distance, m, of a body in a pose: ``best`` if none is that much less."""
        self._frame[:3], self._frame[3:] = pose.position, pose.rotation.ravel()
        sizes, rows, work, told = self._pointers
        frame, room = pointers(self._frame)[0], (self._bore, tolerance, best + self._reach)
        least = self._call(*self._walls, sizes, rows, frame, self._count, *room, work, told)
        assert self._kept[3][0] > 0, "more cells than there is room for"
        return least - self._reach

    def poses(self, count: int, rng: np.random.Generator) -> Iterator[Pose]:
        """Yield ``count`` random poses up to ``GAP`` from the wall, away from the ports."""
        while count:
            centre, quaternion = rng.uniform(*self.fitting.bounds), rng.normal(size=4)
            gap, matrix = rng.uniform(-GAP, GAP), np.empty(9)
            mujoco.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
            pose = self._moved(centre, matrix.reshape(3, 3), gap)
            if pose is not None:
                count -= 1
                yield pose

    def _moved(self, centre: np.ndarray, rotation: np.ndarray, gap: float) -> Pose | None:
        """Return the pose that a body reaches at the nearest wall, None if it is not wanted."""
        distance, gradient = self.fitting.signed_distance(centre)
        if distance < 0 or self.fitting.extent(centre) < 0:
            return None
        for _ in range(8):
            pose = Pose(rotation, centre)
            off = self.least(pose, LOOSE) - gap
            if abs(off) < 1.5 * LOOSE:
                around = centre + self.bound * DIRECTIONS
                is_inside = self.fitting.extent(around).min() > 0
                return pose if is_inside and self.fitting.signed_distance(centre)[0] > 0 else None
            centre = centre - gradient * np.clip(off, -0.02, 0.02)
        return None

    def told(self, pose: Pose) -> float:
        """Return the least distance, m, that the contacts of a body in a pose tell."""
        placed = pose @ self._own
        self.data.qpos[:] = *placed.position, *placed.quaternion
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return float(self.data.contact.dist.min(initial=MARGIN))

    def errors(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Return by how much, m, contacts of ``count`` poses tell too large a distance."""
        found = []
        for pose in self.poses(count, rng):
            told = self.told(pose)
            found.append(told - self.least(pose, TOLERANCE, told))
        return np.array(found)


def measure(task: tuple[str, str, int, int]) -> tuple[float, int]:
    """Return the largest error of a pair, m, and in how many poses it is more than allowed."""
    name, shape, count, seed = task
    rng = np.random.default_rng([seed, *name.encode(), *shape.encode()])
    errors = Lot(FITTINGS[name], shape).errors(count, rng)
    return float(errors.max()), int((errors > ALLOWED).sum())


def main() -> None:
    """Measure and print the table."""
    arguments = Arguments(__doc__, trials=100_000, quick=500, of="poses", seed=1, workers=True)
    given: Any = arguments.read()
    pairs = list(product(FITTINGS, SHAPES))
    tasks = [(*pair, given.poses, given.seed) for pair in pairs]
    found = dict(zip(pairs, run_tasks(measure, tasks, given.workers), strict=True))
    beyond = sum(count for _, count in found.values())
    text = (
        f"Largest error, um, in {given.poses:,} poses of each geom in each fitting; of "
        f"{given.poses * len(pairs):,} in all {beyond or 'none'} is told more than "
        f"{1e6 * ALLOWED:.0f} um too high:"
    )
    worst = {pair: 1e6 * error for pair, (error, _) in found.items()}
    rows = ([name, *(micrometres(worst[name, shape]) for shape in SHAPES)] for name in FITTINGS)
    largest = [micrometres(max(worst[name, shape] for name in FITTINGS)) for shape in SHAPES]
    table("lots", ("fitting", *SHAPES), [*rows, ["largest", *largest]], text)


def micrometres(error: float) -> str:
    """Return an error, um, as text."""
    return f"{error:.1f}" if error > 0.1 else "< 0.1"


if __name__ == "__main__":
    main()
