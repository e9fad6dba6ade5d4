"""Piping component files (PCF): isometrics of plants, read and written.

A component is a word at the beginning of a line, its attributes are indented below it. Points have
three coordinates, and those of ports a nominal bore. What is read: END-POINT, CENTRE-POINT,
BRANCH1-POINT and BRANCH2-POINT, CO-ORDS of olets, SKEY, ANGLE, STATUS and NAME; other attributes
are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.rotations import Array, length
from omnitrack_sim.pipes.importing.assumptions import INCH, true_bore

BORES = {"MM": 1e-3, "INCH": INCH, "INCH-SIXTEENTH": INCH / 16}
COORDINATES = {
    "MM": 1e-3,
    "INCH": INCH,
    "FEET": 12 * INCH,
    "M": 1.0,
    "MM-HUNDREDTH": 1e-5,
    "INCH-SIXTEENTH": INCH / 16,
}
"""Lengths of the units, m."""
MAX_COORDINATE, MAX_BORE, MIN_BORE = 1e5, 10.0, 1e-3
"""Largest coordinate, largest and smallest bore, m."""
MAX_LINES, MAX_LINE, MAX_TOLD = 200_000, 2_000, 20
POINTS = ("END-POINT", "CENTRE-POINT", "BRANCH1-POINT", "BRANCH2-POINT", "CO-ORDS")
HEADERS = ("ISOGEN-FILES", "PIPELINE-REFERENCE", "MATERIALS", "UNITS-")
"""Beginnings of words that are no components."""
PASSED = (
    "SUPPORT",
    "BOLT",
    "MESSAGE",
    "LOCATION-POINT",
    "ISO-SPLIT-POINT",
    "FLOW-ARROW",
    "WELD-NUMBER",
)
"""Components that are no pipe."""
TRUE_BORES = "TRUE-BORES"
"""Piping specification of files that are written here: bores are inner diameters."""


class Point(NamedTuple):
    """A point of a component.

    Attributes:
        place: (3,) m. bore: true one, m; 0 where the line has none.
    """

    place: Array
    bore: float


@dataclass
class Component:
    """A component of a file that was read, or is to be written.

    Attributes:
        kind: its word. line: number of its line; 0 of one to be written.
        points: by the word of their lines, in order.
        words: other attributes, by their first word.
    """

    kind: str
    line: int
    points: dict[str, list[Point]] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)

    @property
    def ends(self) -> list[Point]:
        """Its END-POINTs."""
        return self.points.get("END-POINT", [])

    @property
    def branches(self) -> list[Point]:
        """Its BRANCH-POINTs."""
        return [*self.points.get("BRANCH1-POINT", []), *self.points.get("BRANCH2-POINT", [])]

    @property
    def centre(self) -> Array | None:
        """Its CENTRE-POINT, m; of olets also the CO-ORDS."""
        points = self.points.get("CENTRE-POINT") or self.points.get("CO-ORDS")
        return points[0].place if points else None

    @property
    def is_closed(self) -> bool:
        """True for a valve that its STATUS calls closed."""
        return any(
            "CLOSED" in text.upper() for word, text in self.words.items() if "STATUS" in word
        )

    def add(self, words: Sequence[str], units: tuple[float, float], schedule: str) -> None:
        """Add the attribute of a line's words.

        Args:
            words: of the line.
            units: of bores and coordinates, m.
            schedule: of true bores.

        Raises:
            ValueError: it is no valid point, or one too many.
        """
        key = words[0].upper()
        if key not in POINTS:
            self.words.setdefault(key, " ".join(words[1:]))
            return
        numbers = []
        for word in words[1:5]:
            try:
                numbers.append(float(word))
            except ValueError:
                break
        needed = 4 if key in ("END-POINT", "BRANCH1-POINT", "BRANCH2-POINT") else 3
        if len(numbers) < needed:
            what = "three coordinates and a bore" if needed == 4 else "three coordinates"
            raise ValueError(f"{key} needs {what}; it has {' '.join(words[1:5]) or 'none'}")
        place = units[1] * np.array(numbers[:3])
        if not (np.abs(place) <= MAX_COORDINATE).all():
            raise ValueError(f"{key} is farther than {MAX_COORDINATE:g} m from the origin")
        bore = true_bore(units[0] * numbers[3], schedule) if len(numbers) > 3 else 0.0
        if needed == 4 and not MIN_BORE <= bore <= MAX_BORE:
            raise ValueError(f"{key} has a bore of {bore:g} m")
        self.points.setdefault(key, []).append(Point(place, bore))
        if len(self.points[key]) > 2:
            raise ValueError(f"is one {key} too many of {self.kind}")

    def fault(self, problem: str) -> Fault:
        """Return a fault of the component."""
        return Fault(f"line {self.line}", f"{self.kind} {problem}")


def read_pcf(text: str, schedule: str) -> tuple[list[Component], str]:
    """Read a file's components, and the schedule that bores were made true by.

    Args:
        text: the file.
        schedule: see ``ImportSettings``; "" is 40, unless the file says otherwise.

    Raises:
        NetworkError: every fault, with its line.
    """
    faults: list[Fault] = []
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise NetworkError(Fault("file", f"has {len(lines)} lines; at most {MAX_LINES} are read"))
    units = _units(lines, faults)
    if any(line.split()[:2] == ["PIPING-SPEC", TRUE_BORES] for line in lines):
        schedule = "none"
    schedule = schedule or "40"
    components: list[Component] = []
    current: Component | None = None
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        # Blanks of other kinds, as tabs are, are text as well.
        if len(line) > MAX_LINE or not line.replace("\t", " ").isprintable():
            problem = f"is no text of at most {MAX_LINE} characters"
            faults.append(Fault(f"line {number}", problem))
        if not line[0].isspace():
            passed = words[0].startswith((*HEADERS, *PASSED))
            current = None if passed else Component(words[0].upper(), number)
            components += [] if current is None else [current]
        elif current is not None:
            try:
                current.add(words, units, schedule)
            except ValueError as error:
                faults.append(Fault(f"line {number}", str(error)))
        if len(faults) >= MAX_TOLD:
            break
    if not components and not faults:
        faults.append(Fault("file", "has no components"))
    if faults:
        raise NetworkError(faults)
    return components, schedule


def _units(lines: Sequence[str], faults: list[Fault]) -> tuple[float, float]:
    """Return the units of bores and coordinates, m."""
    found = []
    for key, known in (("UNITS-BORE", BORES), ("UNITS-CO-ORDS", COORDINATES)):
        rows = [(n, line.split()) for n, line in enumerate(lines, 1) if line.startswith(key)]
        words = [(n, row[1].upper() if len(row) > 1 else "") for n, row in rows if row[0] == key]
        if not words:
            faults.append(Fault("file", f"has no {key}", tuple(known)))
            found.append(1.0)
            continue
        number, word = words[0]
        if word not in known:
            faults.append(
                Fault(f"line {number}", f"{key} {word or 'nothing'}", tuple(known), given=word)
            )
        found.append(known.get(word, 1.0))
    return found[0], found[1]


class Bend(NamedTuple):
    """A bend's shape.

    Attributes:
        corner: (3,) m, where the tangents cross. angle: rad. cut: m, from an end to the corner.
        radius: m, of the axis.
    """

    corner: Array
    angle: float
    cut: float
    radius: float


def bend_of(component: Component, ways: Sequence[Array | None]) -> Bend:
    """Return the shape of a bend; its CENTRE-POINT is the corner of tangents or the arc's centre.

    Args:
        component: the bend.
        ways: for each end the direction (3,) in which a neighbour leads away there, if it is known.

    Raises:
        NetworkError: its points are no bend.
    """
    (a, _), (b, _) = component.ends
    centre = component.centre
    if centre is None:
        raise NetworkError(component.fault("has no CENTRE-POINT"))
    one, other = a - centre, b - centre
    size = float(length(one) + length(other)) / 2
    if size < 1e-6 or abs(length(one) - length(other)) > max(0.02 * size, 2e-3):
        raise NetworkError(component.fault("has ends at different distances from its CENTRE-POINT"))
    between = float(np.arctan2(length(np.cross(one, other)), one @ other))
    asked = _degrees(component.words.get("ANGLE", ""))
    is_centre = _is_centre(between, asked, one, other, ways)
    angle = between if is_centre else math.pi - between
    angle = _rounded(angle, asked)
    if not 1e-8 < angle < math.radians(175):
        raise NetworkError(component.fault(f"bends by {math.degrees(angle):.1f} degrees"))
    half = math.tan(angle / 2)
    if is_centre:
        middle = (one + other) / 2
        corner = centre + middle * (size / math.cos(angle / 2) / float(length(middle)))
        return Bend(corner, angle, size * half, size)
    return Bend(centre, angle, size, size / half)


def _is_centre(
    between: float, asked: float | None, one: Array, other: Array, ways: Sequence[Array | None]
) -> bool:
    """Tell whether a CENTRE-POINT is that of the arc, from the vectors to both ends."""
    scores = []
    for end, way in ((one, ways[0]), (other, ways[1])):
        if way is not None:
            # From the corner the neighbour goes straight on, about the arc's centre it is square.
            scores.append(abs(float(end @ way)) / float(length(end)))
    if scores:
        return float(np.mean(scores)) < math.sqrt(0.5)
    if asked is not None and abs(asked - math.pi / 2) > math.radians(1):
        return abs(between - asked) < abs(math.pi - between - asked)
    return False


def _degrees(text: str) -> float | None:
    """Return an ANGLE, rad: hundredths of a degree, or degrees; None for none."""
    try:
        number = float(text.split()[0])
    except (ValueError, IndexError):
        return None
    number = number / 100 if abs(number) > 180 else number
    return math.radians(number) if 0 < number <= 180 else None


SLACK = math.radians(0.3)
"""Angle that rounded coordinates leave open, rad."""


def _rounded(angle: float, asked: float | None) -> float:
    """Return an angle without what rounded coordinates made of it."""
    for whole in (asked, math.pi / 2, math.pi / 4):
        if whole is not None and 1e-12 < abs(angle - whole) < SLACK:
            return whole
    return angle


def pcf_text(name: str, parts: Sequence[Component]) -> str:
    """Return the text of a file with components in millimetres, their bores true."""
    lines = [
        "ISOGEN-FILES ISOGEN.FLS",
        "UNITS-BORE MM",
        "UNITS-CO-ORDS MM",
        f"PIPELINE-REFERENCE {name}",
        f"    PIPING-SPEC {TRUE_BORES}",
    ]
    for part in parts:
        lines.append(part.kind)
        for word, (place, bore) in ((w, p) for w, points in part.points.items() for p in points):
            row = " ".join(f"{1e3 * x + 0.0:.9f}" for x in place)
            lines.append(f"    {word} {row}" + (f" {1e3 * bore:.9f}" if bore else ""))
        lines += [f"    {key} {text}" for key, text in part.words.items()]
    return "\n".join(lines) + "\n"


def neighbours(components: Sequence[Component]) -> Iterator[tuple[Component, Point, Array]]:
    """Yield the ports whose direction outward is plain from the component alone.

    They are those of straight ones, tees and crosses.
    """
    for component in components:
        ends = component.ends
        for branch in component.branches:
            if component.centre is not None and length(branch.place - component.centre) > 1e-6:
                yield component, branch, branch.place - component.centre
        if len(ends) == 2 and (component.branches or component.centre is None):
            along = ends[1].place - ends[0].place
            if length(along) > 1e-6:
                yield component, ends[0], -along
                yield component, ends[1], along
