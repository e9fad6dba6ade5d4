"""Measured walls: what a laser profiler or scanner has of a pipe, as a smooth height of its wall.

A scan is many rays: length along the pipe, angle about its axis, and radius there. Their noise is
smoothed away, as much as the scan itself tells (generalised cross-validation), and its gaps are
filled from what is around them, by penalised least squares (Garcia, Computational Statistics & Data
Analysis 54, 2010): of all grids of radii z it takes the one with the least

    sum of w (r - z)² + (cut-off / 2 pi)^8 · sum of (Laplacian of the Laplacian of z)²,

w being the number of rays in a cell of the grid. Waves twice as long as the cut-off pass but for
0.4 %, of those half as long 0.4 % are left.
"""

from __future__ import annotations

import base64
import binascii
import csv
import math
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import beside, read_bytes
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Positive, Table, Unit
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.heights import PAD, Patch
from omnitrack_sim.pipes.relief import smooth, too_tight

if TYPE_CHECKING:
    from omnitrack_sim.pipes.fittings.relieved import Relieved

MAX_BYTES, MAX_RAYS = 50_000_000, 1_000_000
"""Of a scan's file: octets, and rows."""
MAX_NODES = 200_000
"""Nodes of a measured wall: 20 m of a bore of 160 mm at 10 mm."""
FADE = 0.5
"""Length over which a measured wall passes into the bore at both of its ends, bores; assumed."""
OFF = 0.25
"""Part of the bore's radius by which the mean measured one may differ: beyond it is another unit or
another pipe."""
UNIT = 1e-6
"""Of the radii that are kept, m."""
COLUMNS = {
    "length": {"m": 1.0, "mm": 1e-3},
    "angle": {"deg": math.pi / 180, "rad": 1.0},
    "radius": {"m": 1.0, "mm": 1e-3},
}
"""Quantities of a scan, and the units that they may have: SI units of one of each."""
HEAD = "its head must be length_m or length_mm, angle_deg or angle_rad, and radius_m or radius_mm"
RINGS, RAYS = 4, 8
"""Least numbers of rings of a scan, and of rays in one."""
SAME = 1e-7
"""Lengths, m, that differ by less are of the same ring."""
ROUNDS, CHANGE = 200, 1e-6
"""Of the filling of gaps: rounds at most, and the largest change, m, of the last one."""
PER_WAVE = 5
"""Nodes in a wave of the cut-off's length."""


class Profile(Table):
    """A measured wall: radii on a grid along and round a pipe, smoothed.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> rings, turns = np.meshgrid(np.arange(0, 1, 0.02), np.arange(0, 360, 5), indexing="ij")
        >>> radius = 0.08 + 0.002 * np.cos(np.radians(2 * turns))
        >>> oval = ot.Profile.from_rays(rings, np.radians(turns), radius)
        >>> pipe = ot.Straight(1.0, profile=oval)
        >>> distance, _ = pipe.signed_distance([0.05, 0.0, 0.5])
        >>> round(float(distance), 4)
        0.032
    """

    begin: Annotated[float, Field(ge=0, le=1000), Unit("m")]
    """Of the first ring of nodes, from the port `start`."""
    spacing: Annotated[Positive, Unit("m")]
    """Of the rings."""
    columns: Annotated[int, Field(ge=RAYS, le=10_000), Unit("1")]
    """Nodes of a ring, from the x axis on."""
    radii: Annotated[str, Field(max_length=2_000_000)]
    """Radii at the nodes, ring by ring, in micrometres: differences from one to the next, 32 bit
    little-endian integers, compressed (zlib), base64."""

    @model_validator(mode="after")
    def _check_radii(self) -> Self:
        """Refuse what is no grid of radii."""
        if len(self._grid) < RINGS:
            raise ValueError(f"has {len(self._grid)} rings; at least {RINGS}")
        return self

    @property
    def _grid(self) -> Array:
        """Radii (rings, columns), m."""
        return _unpacked(self.radii, self.columns)

    @classmethod
    def from_rays(cls, length: Array, angle: Array, radius: Array, name: str = "a scan") -> Profile:
        """Return the wall that the rays of a scan tell.

        Args:
            length: (...,) m along the pipe, from its port ``start``.
            angle: (...,) rad about its axis, from the x axis.
            radius: (...,) m, from the axis to the wall; NaN where a ray has found nothing.
            name: of the scan, in the warning.

        Raises:
            InputError: too few rays, or too many.

        A warning tells where rays are missing.
        """
        s, turn, r = (np.asarray(each, float).ravel() for each in (length, angle, radius))
        if not len(s) == len(turn) == len(r):
            raise InputError(Fault("profile", "has not as many lengths, angles and radii"))
        begin, steps, sums, weights = _binned(s, turn, r)
        _tell_of_gaps(weights, steps[0], name)
        grid, wave = _smoothed(sums, weights, (steps[0], steps[1] * float(np.nanmedian(r))))
        return cls.on_grid(begin, steps[0], grid, wave)

    @classmethod
    def on_grid(cls, begin: float, spacing: float, radii: Array, wave: float) -> Profile:
        """Return the wall of radii (rings, columns) m without noise, at fewer nodes.

        Args:
            begin: m, of the first ring.
            spacing: m, of the rings.
            radii: m, evenly all round from the x axis on.
            wave: m, length of the shortest waves.
        """
        stride = max(1, math.floor(wave / PER_WAVE / spacing))
        around = 2 * math.pi * float(radii.mean())
        columns = 4 * math.ceil(around * PER_WAVE / max(wave, PER_WAVE * spacing) / 4)
        columns = min(max(columns, 16), radii.shape[1])
        waves = np.fft.rfft(radii, axis=1)
        fewer = np.fft.irfft(waves, columns, axis=1)[::stride] * columns / radii.shape[1]
        if fewer.size > MAX_NODES:
            problem = f"has {fewer.size} nodes; at most {MAX_NODES}: cut it into several pipes"
            raise InputError(Fault("profile", problem))
        whole = np.rint(fewer.ravel() / UNIT).astype(np.int64)
        octets = np.diff(whole, prepend=0).astype("<i4").tobytes()
        text = base64.b64encode(zlib.compress(octets, 9)).decode()
        return cls(begin=begin, spacing=stride * spacing, columns=columns, radii=text)

    @property
    def ends(self) -> tuple[float, float]:
        """Places, m, of its first and last ring."""
        return self.begin, self.begin + self.spacing * (len(self._grid) - 1)

    def problems(self, pipe: Relieved) -> Iterator[str]:
        """Yield what is wrong with it in a pipe."""
        if pipe.shape is not None:
            yield "is of a circular bore alone"
            return
        if problem := too_tight(pipe):
            yield problem
        if self.ends[1] > pipe.axis_length + self.spacing:
            yield f"reaches to {self.ends[1]:g} m; the pipe is {pipe.axis_length:g} m long"
        mean = float(self._grid.mean())
        if abs(mean - pipe.radius) > OFF * pipe.radius:
            yield f"has a mean radius of {mean:g} m, and the bore one of {pipe.radius:g} m"
        elif self._grid.min() < pipe.radius / 4:
            yield f"has a radius of {self._grid.min():g} m, less than a quarter of the bore's"

    def patch(self, pipe: Relieved) -> Patch:
        """Return it as a height of the wall of a pipe, which dies out at both ends of the scan."""
        rows, columns = self._grid.shape
        first, last = self.ends[0], min(self.ends[1], pipe.axis_length)
        s: Array = first + self.spacing * np.arange(rows, dtype=float)
        fade = min(FADE * pipe.inner_diameter, (last - first) / 2)
        inside = smooth((s - first) / fade) * smooth((last - s) / fade)
        height = (pipe.radius - self._grid) * inside[:, None]
        padded = np.pad(height, ((PAD, PAD), (0, 0)))
        begin, step = first - PAD * self.spacing, 2 * math.pi / columns
        width = min(self.spacing, step * pipe.radius)
        return Patch.through(begin, self.spacing, 0.0, step, padded, width)


@lru_cache(maxsize=64)
def _unpacked(text: str, columns: int) -> Array:
    """Return the radii (rings, columns), m, of the text of a wall.

    Raises:
        ValueError: it is none.
    """
    try:
        reader = zlib.decompressobj()
        octets = reader.decompress(base64.b64decode(text, validate=True), 4 * MAX_NODES)
    except (binascii.Error, ValueError, zlib.error) as error:
        raise ValueError(f"has radii that cannot be read ({error})") from None
    if len(octets) % (4 * columns) or not reader.eof:
        raise ValueError(f"has radii that are no grid of {columns} columns")
    steps = np.frombuffer(octets, "<i4").astype(np.int64)
    radii: Array = np.cumsum(steps).reshape(-1, columns).astype(float) * UNIT
    if not (radii.min(initial=1.0) > 0 and radii.max(initial=0.0) < 1000):
        raise ValueError("has radii that are not over 0")
    radii.flags.writeable = False
    return radii


def _binned(
    length: Array, angle: Array, radius: Array
) -> tuple[float, tuple[float, float], Array, Array]:
    """Return a scan on a grid: its begin, m, steps along, m, and round, rad, means and weights.

    Of rings it has theirs, of another scan cells of one and a half rays.
    """
    kept = np.isfinite(length) & np.isfinite(angle)
    length, angle, radius = length[kept], angle[kept] % (2 * math.pi), radius[kept]
    rings = np.unique(length.round(7))
    many = RINGS * RAYS
    if np.isfinite(radius).sum() < many or len(rings) < RINGS:
        raise InputError(Fault("profile", f"needs {many} rays, and {RINGS} lengths"))
    if len(radius) > MAX_RAYS:
        raise InputError(Fault("profile", f"has {len(radius)} rays; at most {MAX_RAYS}"))
    if len(rings) * RAYS <= len(length):
        spacing = float(np.median(np.diff(rings)))
        columns = round(len(length) / len(rings))
    else:
        # A helix, or points by lot.
        around = 2 * math.pi * float(np.nanmedian(radius))
        spacing = math.sqrt(1.5 * (rings[-1] - rings[0]) * around / len(length))
        columns = round(around / spacing)
    columns, step = max(columns, RAYS), 2 * math.pi / max(columns, RAYS)
    rows = round((rings[-1] - rings[0]) / spacing) + 1
    if rows * columns > 4 * MAX_RAYS or rows < RINGS:
        raise InputError(Fault("profile", f"has {len(rings)} lengths, most of them far apart"))
    seen = np.isfinite(radius)
    row = np.rint((length[seen] - rings[0]) / spacing).astype(int)
    cell = row * columns + np.rint(angle[seen] / step).astype(int) % columns
    weights = np.bincount(cell, minlength=rows * columns).reshape(rows, columns).astype(float)
    sums = np.bincount(cell, radius[seen], rows * columns).reshape(rows, columns)
    means = np.divide(sums, weights, out=np.full(sums.shape, np.nan), where=weights > 0)
    return float(rings[0]), (spacing, step), means, weights


def _tell_of_gaps(weights: Array, spacing: float, name: str) -> None:
    """Warn where cells of a grid have no ray."""
    empty = weights == 0
    if not empty.any():
        return
    longest = 0
    run = np.zeros(weights.shape[1], int)
    for row in empty:
        run = np.where(row, run + 1, 0)
        longest = max(longest, int(run.max()))
    warnings.warn(
        f"{name} has no ray in {empty.mean():.1%} of its cells, {1e3 * longest * spacing:.0f} mm "
        "at most along the pipe; they are filled from those around them",
        stacklevel=4,
    )


def _smoothed(means: Array, weights: Array, steps: tuple[float, float]) -> tuple[Array, float]:
    """Return a grid without noise or gaps, and the cut-off's length, m; see the module.

    ``steps``: m, of both axes.
    """
    from scipy import fft

    transform: Any = fft
    rows, columns = means.shape
    known, middle = weights > 0, float(np.nanmean(means))
    along = (2 - 2 * np.cos(np.pi * np.arange(rows) / rows)) / steps[0] ** 2
    around = (2 - 2 * np.cos(2 * np.pi * np.arange(columns // 2 + 1) / columns)) / steps[1] ** 2
    square = (along[:, None] + around) ** 4
    # Waves of the half spectrum stand for two each, but the first, and the last of even columns.
    count = np.full(columns // 2 + 1, 2.0)
    count[0], count[-1] = 1.0, 1.0 if columns % 2 == 0 else 2.0

    def waves_of(grid: Array) -> Array:
        return transform.dct(np.fft.rfft(grid, axis=1, norm="ortho"), axis=0, norm="ortho")

    def grid_of(waves: Array) -> Array:
        back = transform.idct(waves, axis=0, norm="ortho")
        return np.fft.irfft(back, columns, axis=1, norm="ortho")

    # Rays of a cell beyond the usual number weigh no more.
    share = np.minimum(weights / np.median(weights[known]), 1.0)
    target = np.where(known, means, middle) - middle
    filled = _filled(target, known, waves_of, grid_of, square, steps)
    waves = waves_of(filled)
    power = np.abs(waves) ** 2 * count

    def score(wave: float) -> float:
        gain = 1 / (1 + (wave / (2 * math.pi)) ** 8 * square)
        rest = (power * (1 - gain) ** 2).sum()
        return float(rest / (means.size - (gain * count).sum()) ** 2)

    cut_offs = np.geomspace(0.5 * max(steps), steps[0] * rows / 2, 40)
    wave = float(min(cut_offs, key=score))
    gain = 1 / (1 + (wave / (2 * math.pi)) ** 8 * square)
    grid = filled
    for _ in range(ROUNDS):
        before, grid = grid, grid_of(gain * waves_of(grid + share * (target - grid)))
        if np.abs(grid - before).max() < CHANGE:
            break
    return grid + middle, wave


def _filled(
    target: Array,
    known: NDArray[np.bool_],
    waves_of: Callable[[Array], Array],
    grid_of: Callable[[Array], Array],
    square: Array,
    steps: tuple[float, float],
) -> Array:
    """Return a grid whose gaps are filled smoothly, for a first look at its noise."""
    grid = np.where(known, target, 0.0)
    for cells in (32, 8, 2):
        gain = 1 / (1 + (cells * max(steps) / (2 * math.pi)) ** 8 * square)
        for _ in range(10):
            grid = np.where(known, target, grid_of(gain * waves_of(grid)))
    return grid


def load_profile(path: str | Path) -> Profile:
    """Read the scan of a pipe's wall: a CSV file of rays. A warning tells where rays are missing.

    Its first line names the columns with their units, in any order: ``length_m`` or ``length_mm``
    along the pipe from its port ``start``, ``angle_deg`` or ``angle_rad`` about the axis from the
    x axis, ``radius_m`` or ``radius_mm``. A ray that has found nothing is left out, or has no
    radius.

    Raises:
        InputError: it cannot be read; what is wrong in which row.

    Example:
        >>> import omnitrack_sim as ot
        >>> try:
        ...     ot.load_profile("no_such_scan.csv")
        ... except ot.InputError as error:
        ...     print(error)
        'no_such_scan.csv': cannot be read: No such file or directory
    """
    try:
        content = read_bytes(path, MAX_BYTES, " of a scan")
        text = content.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        problem = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise InputError(Fault(shown(str(path)), problem)) from None
    try:
        return Profile.from_rays(*_rays(text), name=str(path))
    except InputError as error:
        raise InputError([Fault(shown(str(path)), f.problem) for f in error.faults]) from None


def _rays(text: str) -> Array:
    """Return lengths, angles and radii (3, k) in SI units of the text of a scan."""
    rows = csv.reader(text.splitlines())
    try:
        head = [name.strip() for name in next(rows, [])]
        places, factors = _columns_of(head)
        numbers = [
            _numbers(number, row, head, places)
            for number, row in enumerate(rows, start=2)
            if row and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise _problem(rows.line_num, str(error)) from None
    if len(numbers) > MAX_RAYS:
        raise InputError(Fault("profile", f"has {len(numbers)} rays; at most {MAX_RAYS}"))
    return np.array(numbers).reshape(-1, 3).T * np.array(factors)[:, None]


def _columns_of(head: Sequence[str]) -> tuple[list[int], list[float]]:
    """Return places of the three quantities in a head, and the SI units of one of theirs."""
    places, factors = [], []
    for quantity, units in COLUMNS.items():
        found = [f"{quantity}_{unit}" for unit in units if f"{quantity}_{unit}" in head]
        if len(found) != 1 or head.count(found[0]) != 1:
            names = shown(", ".join(head)) if any(head) else "nothing"
            raise _problem(1, f"has {names}; {HEAD}")
        places.append(head.index(found[0]))
        factors.append(units[found[0].removeprefix(f"{quantity}_")])
    return places, factors


def _numbers(
    number: int, row: Sequence[str], head: Sequence[str], places: Sequence[int]
) -> list[float]:
    """Return length, angle and radius of a row of a scan, NaN for no radius."""
    if len(row) != len(head):
        raise _problem(number, f"has {len(row)} values; the head names {len(head)}")
    values = []
    for place in places:
        cell, is_radius = row[place].strip(), head[place].startswith("radius")
        if is_radius and cell.lower() in ("", "nan"):
            values.append(math.nan)
            continue
        try:
            value = float(cell)
        except ValueError:
            raise _problem(number, f"{head[place]} is {shown(cell)}, no number") from None
        least = -1e-9 if head[place].startswith("length") else -1e9
        if is_radius and value <= 0:
            raise _problem(number, f"{head[place]} is {value:g}; must be over 0")
        if not least <= value <= 1e9:
            raise _problem(number, f"{head[place]} is {value:g}; must be from {least:g} to 1e9")
        values.append(value)
    return values


def _problem(row: int, what: str) -> InputError:
    return InputError(Fault("profile", f"row {row}: {what}"))


def with_profiles(parts: Any, folder: Path, where: str) -> tuple[Any, list[Fault]]:
    """Return tables of parts with the scans that they name read, and faults of these.

    Args:
        parts: of a file, unchecked.
        folder: that paths are relative to.
        where: path of the parts in the file.
    """
    faults: list[Fault] = []
    if not isinstance(parts, list | tuple):
        return parts, faults
    known: list[Any] = []
    for i, part in enumerate(parts):
        name = part.get("profile") if isinstance(part, Mapping) else None
        if isinstance(name, str):
            part = {key: value for key, value in part.items() if key != "profile"}
            try:
                part["profile"] = load_profile(beside(folder, name)).model_dump()
            except InputError as found:
                place = f"{where}.{i}.profile"
                faults += [Fault(place, f"{f.where}: {f.problem}") for f in found.faults]
        known.append(part)
    return known, faults
