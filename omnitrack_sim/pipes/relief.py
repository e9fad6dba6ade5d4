"""Relief: how the inner surface of a real pipe differs from its bore, kind by kind.

A kind is one table, in files and in Python. What stands narrow on the wall is a solid of closed
distance (``obstacles``), what is wide and smooth a height of the wall (``heights``). Both end
before the ports, so that parts with relief are joined as others are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny

from omnitrack_sim.base.errors import Fault, GeometryError, InputError
from omnitrack_sim.base.reading import by_kind, checked
from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.base.table import Angle, Positive, Table, Unit
from omnitrack_sim.pipes.heights import PAD, Patch, total_height
from omnitrack_sim.pipes.obstacles import Obstacle, bead, bed

if TYPE_CHECKING:
    from omnitrack_sim.pipes.fittings.relieved import Relieved

FADE = 1.0
"""Length over which an oval passes into the round bore, bores; assumed."""
SLOPE, ROUNDING = math.radians(30.0), 0.005
"""Of the ends of a bed, rad, about the angle of repose of sand; radius of its edges, m, but half of
its depth at most. Both assumed."""
MIN_BEND = 2.0
"""Least mean radius of a bend with heights, bore radii: nearer to its centre they are squeezed to
less than half of their length."""
MAX_RELIEF = 200
"""Entries of a pipe's relief."""


class Relief(Table):
    """An entry of a pipe's ``relief``."""

    needs_circle: ClassVar[bool] = True
    is_height: ClassVar[bool] = True

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:
        """Return the table of the ``kind`` in ``value``; the entry's own without one."""
        return relief_kinds().get(str(value.get("kind")), cls)

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """Yield keys, and what is wrong with them in a pipe."""
        if self.needs_circle and pipe.shape is not None:
            shape = pipe.shape.name
            yield "kind", f"needs a circular bore; in {shape!r} there are deposits alone"
        if self.is_height and (problem := too_tight(pipe)):
            yield "kind", problem

    def obstacle(self, _pipe: Relieved) -> Obstacle | None:
        """Return what it is as a solid on the wall of a pipe."""
        return None

    def patch(self, _pipe: Relieved) -> Patch | None:
        """Return what it is as a height of the wall of a pipe."""
        return None


def too_tight(pipe: Relieved) -> str:
    """Return what is wrong with heights on the wall of a pipe whose bend is too tight; else ""."""
    if pipe.curvature * MIN_BEND * pipe.radius <= 1:
        return ""
    least = f"{MIN_BEND * pipe.radius:g} m"
    return f"squeezes in a bend of {1 / pipe.curvature:g} m: its mean radius is at least {least}"


MIN_BEAD_HEIGHT, MIN_BEAD_WIDTH = 1e-4, 1e-3
"""Least sizes of a bead, m."""
MIN_DENT = 0.01
"""Least length and width of a dent, m."""
MIN_WAVE, MAX_WAVE = 0.005, 10.0
"""Least and largest wavelength of corrosion, m."""
At = Annotated[float, Field(ge=0, le=1000), Unit("m")]


def _beyond(at: float, half: float, pipe: Relieved) -> Iterator[tuple[str, str]]:
    """Yield the problem of what reaches beyond a port."""
    if not half - 1e-9 <= at <= pipe.axis_length - half + 1e-9:
        room = f"must be from {half:g} to {pipe.axis_length - half:g} m"
        if 2 * half > pipe.axis_length:
            room = f"does not fit into a pipe of {pipe.axis_length:g} m"
        yield "at", f"is {at:g} m; {room}, as it reaches {half:g} m to both sides"


def _not_over(key: str, value: float, most: float, what: str) -> Iterator[tuple[str, str]]:
    """Yield the problem of a size over another."""
    if value > most:
        yield key, f"is {value:g} m; at most {most:g} m, {what}"


class Ovality(Relief):
    """A stretch of pipe that is pressed out of round, and passes into the round bore."""

    kind: Literal["ovality"]
    """A stretch that is pressed out of round, and passes into the round bore at its ends."""
    ratio: Annotated[float, Field(gt=0, le=0.2), Unit("1")]
    """Difference of the longest and shortest diameter over the nominal, at most 0.2."""
    direction_deg: Annotated[Angle, Unit("deg")] = 0.0
    """Of the longest diameter, about the axis from the x axis."""
    at: Annotated[float | None, Field(ge=0, le=1000), Unit("m")] = None
    """Middle of the stretch; left out: that of the pipe."""
    length: Annotated[Positive | None, Unit("m")] = None
    """Of the stretch, its transitions included, which are as long as the bore is wide, or half of
    it; left out: the whole pipe."""

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """See ``Relief``."""
        yield from super().problems(pipe)
        at, half = self._stretch(pipe)
        yield from _beyond(at, half, pipe)

    def _stretch(self, pipe: Relieved) -> tuple[float, float]:
        """Middle and half length of the stretch, m."""
        at = pipe.axis_length / 2 if self.at is None else self.at
        return at, (pipe.axis_length if self.length is None else self.length) / 2

    def patch(self, pipe: Relieved) -> Patch:
        """See ``Relief``: the second harmonic."""
        at, half = self._stretch(pipe)
        fade, turn = min(FADE * pipe.inner_diameter, half), math.radians(self.direction_deg)
        amplitude = self.ratio * pipe.inner_diameter / 4

        def height(s: Array, angle: Array) -> Array:
            inside = smooth((half - np.abs(s - at)) / fade)
            return -amplitude * inside * np.cos(2 * (angle - turn))

        ends = at - half, at + half
        patch = Patch.over(height, ends, fade / 12, None, 2 * math.pi / 32, fade / 4)
        # Where the wall bends inward along the pipe it is concave round it.
        return replace(patch, bulges=False)


class Weld(Relief):
    """The bead of a weld, an arc of a circle in cross-section, all round or part of the way."""

    is_height: ClassVar[bool] = False
    kind: Literal["weld"]
    """A bead, an arc of a circle in cross-section, all round or part of the way; it lies on the
    wall's mean radius and second harmonic."""
    at: At
    """Its middle, from the port `start`."""
    height: Annotated[float, Field(ge=MIN_BEAD_HEIGHT, le=1), Unit("m")] = 0.003
    """Above the wall, at most half the width; 3 mm is assumed."""
    width: Annotated[float, Field(ge=MIN_BEAD_WIDTH, le=1), Unit("m")] = 0.010
    """Along the pipe; 10 mm is assumed."""
    from_deg: Annotated[Angle, Unit("deg")] = 0.0
    """Where it begins, about the axis from the x axis."""
    to_deg: Annotated[Angle, Unit("deg")] = 360.0
    """Where it ends, 360 degrees on at most."""

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """See ``Relief``."""
        yield from super().problems(pipe)
        yield from _beyond(self.at, self.width / 2, pipe)
        yield from _not_over("height", self.height, self.width / 2, "half its width")
        yield from _not_over("height", self.height, pipe.radius / 2, "half the bore's radius")
        if not 0 < self.to_deg - self.from_deg <= 360:
            own, start = f"{self.to_deg:g}", f"{self.from_deg:g}"
            yield "to_deg", f"is {own}; must be over from_deg, {start}, by 360 at most"

    def obstacle(self, pipe: Relieved) -> Obstacle:
        """See ``Relief``: an arc of a torus, on a wall that is out of round of an oval one."""
        middle = math.radians((self.from_deg + self.to_deg) / 2)
        half = math.radians((self.to_deg - self.from_deg) / 2)
        turns = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
        places = np.stack([np.full(64, self.at), turns], axis=-1)
        wall = pipe.radius - total_height(pipe.patches, places)
        second = 2 * complex((wall * np.exp(2j * turns)).mean())
        # Without heights below it the rest is of rounding.
        oval = abs(second) if abs(second) > 1e-9 else 0.0
        toward = math.atan2(second.imag, second.real) / 2
        shape = self.height, self.width, middle, half, oval, toward
        return bead(self.at, float(wall.mean()), *shape)


class Deposit(Relief):
    """A flat bed of what has settled, with ends that slope by 30 degrees."""

    is_height: ClassVar[bool] = False
    kind: Literal["deposit"]
    """A flat bed, with ends that slope by 30 degrees (assumed)."""
    at: At
    """Its middle, from the port `start`."""
    length: Annotated[Positive, Unit("m")]
    """Along the floor, with its ends."""
    depth: Annotated[Positive, Unit("m")]
    """In its middle, less than 0.95 of the way from the floor to the axis."""
    angle_deg: Annotated[Angle | None, Unit("deg")] = None
    """Of its middle, about the axis from the x axis; left out: the lowest side of the pipe, which
    then is at most 60 degrees steep."""
    friction: Annotated[float | None, Field(ge=0, le=10), Unit("1")] = None
    """Its own; left out: that of the wall."""
    needs_circle: ClassVar[bool] = False

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """See ``Relief``."""
        yield from super().problems(pipe)
        if pipe.curvature:
            yield "kind", "lies in straights and caps alone"
            return
        yield from _beyond(self.at, self.length / 2, pipe)
        most = 0.95 * self._floor(pipe)
        if self.depth >= most:
            limit = f"must be less than {most:g} m, 0.95 of the way to the axis"
            yield "depth", f"is {self.depth:g} m; {limit}"
        least = 2 * self.depth / math.tan(SLOPE)
        if self.length < least:
            yield "length", f"is {self.length:g} m; its slopes alone take {least:.4f} m"

    @property
    def _angle(self) -> float:
        """Angle, rad, of its middle; where it is not settled yet, that of the x axis."""
        return math.radians(self.angle_deg or 0.0)

    def _floor(self, pipe: Relieved) -> float:
        """Distance of the floor from the axis, m."""
        return pipe.radius if pipe.shape is None else float(pipe.shape.radii(np.array(self._angle)))

    def obstacle(self, pipe: Relieved) -> Obstacle:
        """See ``Relief``."""
        rounding = min(ROUNDING, self.depth / 2)
        return bed(
            self.at,
            self._floor(pipe),
            pipe.max_radius,
            self.depth,
            self.length / 2,
            SLOPE,
            rounding,
            self._angle,
            self.friction,
        )


class Dent(Relief):
    """A dent: the wall pushed into the bore, by a smooth bump."""

    kind: Literal["dent"]
    """The wall pushed into the bore: depth (1 - q²)³ at the part q of the way to its edge."""
    at: At
    """Its middle, from the port `start`."""
    angle_deg: Annotated[Angle, Unit("deg")] = 0.0
    """Of its middle, about the axis from the x axis."""
    depth: Annotated[Positive, Unit("m")]
    """In its middle, at most half the bore's radius, and a quarter of length and width."""
    length: Annotated[float, Field(ge=MIN_DENT, le=1000), Unit("m")]
    """Along the pipe, from edge to edge."""
    width: Annotated[float, Field(ge=MIN_DENT, le=1000), Unit("m")]
    """Round the pipe, from edge to edge, less than the way round."""

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """See ``Relief``."""
        yield from super().problems(pipe)
        yield from _beyond(self.at, self.length / 2, pipe)
        least = min(pipe.radius * 2, self.length, self.width) / 4
        what = "half the bore's radius, and a quarter of length and width"
        yield from _not_over("depth", self.depth, least, what)
        yield from _not_over("width", self.width, 1.9 * math.pi * pipe.radius, "round the pipe")

    def patch(self, pipe: Relieved) -> Patch:
        """See ``Relief``."""
        turn, half = math.radians(self.angle_deg), self.width / 2 / pipe.radius

        def height(s: Array, angle: Array) -> Array:
            aside = wrap_angle(angle - turn)
            square = (2 * (s - self.at) / self.length) ** 2 + (aside / half) ** 2
            return self.depth * np.maximum(1 - square, 0.0) ** 3

        ends = self.at - self.length / 2, self.at + self.length / 2
        narrowest = min(self.length, self.width) / 4
        return Patch.over(height, ends, self.length / 16, (turn, half), half / 8, narrowest)


MAX_NODES = 400_000
"""Nodes of the heights of a pipe: corrosion on 40 m at a wavelength of 20 mm."""


class Corrosion(Relief):
    """A wall that is rough by random waves."""

    kind: Literal["corrosion"]
    """Random waves all over the pipe, which die out over one wavelength at both ports."""
    roughness: Annotated[Positive, Unit("m")] = 0.001
    """Standard deviation of the height, at most a sixteenth of the wavelength; 1 mm is assumed."""
    wavelength: Annotated[float, Field(ge=MIN_WAVE, le=MAX_WAVE), Unit("m")] = 0.02
    """Of the waves, most of which are within a fifth of it; 20 mm is assumed."""
    seed: Annotated[int, Field(ge=0, le=2**32), Unit("1")] = 0
    """Other waves for each."""

    def problems(self, pipe: Relieved) -> Iterator[tuple[str, str]]:
        """See ``Relief``."""
        yield from super().problems(pipe)
        what = "a sixteenth of the wavelength"
        yield from _not_over("roughness", self.roughness, self.wavelength / 16, what)
        if self.wavelength > min(pipe.axis_length / 3, pipe.radius):
            yield "wavelength", f"is {self.wavelength:g} m; at most a third of the pipe, or R"
        elif math.prod(self._grid(pipe)) > MAX_NODES:
            yield "wavelength", f"is {self.wavelength:g} m, too fine for {pipe.axis_length:g} m"

    def _grid(self, pipe: Relieved) -> tuple[int, int]:
        """Return how many nodes there are along and round the pipe, five in a wavelength."""
        rows = math.ceil(5 * pipe.axis_length / self.wavelength) + 1
        return rows, 4 * math.ceil(5 * 2 * math.pi * pipe.radius / self.wavelength / 4)

    def patch(self, pipe: Relieved) -> Patch:
        """See ``Relief``: white noise, of which a band of wavelengths is kept."""
        rows, columns = self._grid(pipe)
        spacing, step = pipe.axis_length / (rows - 1), 2 * math.pi / columns
        more = 5  # that its ends do not know each other
        noise = np.random.default_rng(self.seed).normal(size=(rows + more, columns))
        along = np.fft.fftfreq(rows + more, spacing)[:, None]
        around = np.fft.fftfreq(columns, step * pipe.radius)[None]
        waves = np.hypot(along, around) * self.wavelength
        band = np.exp(-(((waves - 1) / 0.2) ** 2))
        height = np.fft.ifft2(np.fft.fft2(noise) * band).real[:rows]
        s: Array = spacing * np.arange(rows, dtype=float)
        height *= self.roughness / height.std()
        fade = smooth((s - spacing) / self.wavelength)
        height *= (fade * fade[::-1])[:, None]
        padded = np.pad(height, ((PAD, PAD), (0, 0)))
        return Patch.through(-PAD * spacing, spacing, 0.0, step, padded, self.wavelength / 5)


def smooth(part: Array) -> Array:
    """Return 0 below 0, 1 above 1, and between a curve whose first two derivatives end at 0."""
    t = np.clip(part, 0.0, 1.0)
    return t * t * t * (10 - 15 * t + 6 * t * t)


@cache
def relief_kinds() -> Mapping[str, type[Relief]]:
    """Return the kinds of relief by name."""
    return {get_args(k.model_fields["kind"].annotation)[0]: k for k in Relief.__subclasses__()}


def relief_kind(kind: str) -> type[Relief]:
    """Return the table of a kind of relief.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in relief_kinds():
        raise InputError(Fault("kind", f"is {kind!r}", tuple(relief_kinds()), given=kind))
    return relief_kinds()[kind]


Entries = Annotated[
    tuple[Annotated[SerializeAsAny[Relief], by_kind(relief_kind, strict=True)], ...],
    # Pipes of a scenario come as lists of Python, which strict tuples are not.
    BeforeValidator(lambda relief: tuple(relief) if isinstance(relief, list) else relief),
    Field(max_length=MAX_RELIEF),
]
"""Type of a pipe's ``relief`` in a table."""


class _Pipe(Table):
    """A pipe, of which the relief alone is read."""

    relief: Entries


def relief_tables(entries: Any, kind: str) -> tuple[Relief, ...]:
    """Return the relief of a pipe of some kind as tables, from tables or plain data of them.

    Raises:
        GeometryError: lists every fault, with its place.
    """
    if isinstance(entries, tuple) and all(isinstance(one, Relief) for one in entries):
        return entries
    try:
        return checked(_Pipe, {"relief": entries}, GeometryError).relief
    except GeometryError as error:
        places = [fault.at(f"{kind}.{fault.where}") for fault in error.faults]
        raise GeometryError(places) from None
