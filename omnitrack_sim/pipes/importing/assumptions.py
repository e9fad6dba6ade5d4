"""Assumptions of an import, and its report, place by place.

True bores are those of steel pipe after ASME B36.10M. Schedule 40 is as Grinnell's Mechanical
Installation Handbook (IH-1000M, p. 360) prints the standard; 80 and 160 are from memory of the
standard, not checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.table import Table, Unit
from omnitrack_sim.pipes.network import Network


class ImportSettings(Table):
    """Assumptions for what the file of a town does not say, and limits of mending a drawing."""

    bend_radius: Annotated[float, Field(ge=0.5, le=20), Unit("bores")] = 1.5
    """Of bends: mean radius over bore; smaller where there is no room."""
    deflection_deg: Annotated[float, Field(ge=0, le=15), Unit("deg")] = 5.0
    """Up to which pipes bend in a joint, without a bend, and a branch counts as square: couplings
    of mains allow 3 to 5 degrees."""
    simplify: Annotated[float, Field(ge=0, le=1e4), Unit("m")] = 0.1
    """Points of a line are left out where it moves by less: a drawing is not as exact."""
    move: Annotated[float, Field(ge=0, le=1e4), Unit("m")] = 1.0
    """By how much a node may be moved to make room for fittings."""
    scale: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Length of a unit of the coordinates; 0: as the lengths of the pipes say."""
    profile: Literal["even", "low", "high"] = "even"
    """Of a pipe between two nodes: it rises evenly, or lies level at the height of its lower or
    its higher end and rises by 45 degrees beside the other."""
    schedule: str = ""
    """Schedule of ASME B36.10 that gives true bores to the nominal ones of the file, such as "40";
    none: the file's bores are true."""


INCH = 0.0254
SCHEDULES = ("40", "80", "160")
_SIZES = """
0.125    6  10.3  1.73  2.41     -
0.25     8  13.7  2.24  3.02     -
0.375   10  17.1  2.31  3.20     -
0.5     15  21.3  2.77  3.73  4.78
0.75    20  26.7  2.87  3.91  5.56
1       25  33.4  3.38  4.55  6.35
1.25    32  42.2  3.56  4.85  6.35
1.5     40  48.3  3.68  5.08  7.14
2       50  60.3  3.91  5.54  8.74
2.5     65  73.0  5.16  7.01  9.53
3       80  88.9  5.49  7.62 11.13
3.5     90 101.6  5.74  8.08     -
4      100 114.3  6.02  8.56 13.49
5      125 141.3  6.55  9.53 15.88
6      150 168.3  7.11 10.97 18.26
8      200 219.1  8.18 12.70 23.01
10     250 273.0  9.27 15.09 28.58
12     300 323.8 10.31 17.48 33.32
14     350 355.6 11.13 19.05 35.71
16     400 406.4 12.70 21.44 40.49
18     450 457.0 14.27 23.83 45.24
20     500 508.0 15.09 26.19 50.01
24     600 610.0 17.48 30.96 59.54
"""
"""NPS, in; DN, mm; outside diameter, mm; walls of the schedules, mm."""
NEAR = 0.021
"""Difference from a nominal size, share, up to which a bore is that one."""


def check_schedule(schedule: str) -> None:
    """Raise a ``NetworkError`` if there is no such schedule; none is one, too."""
    if schedule not in ("", "none", *SCHEDULES):
        problem = f"there is no schedule {schedule!r}"
        raise NetworkError(Fault("schedule", problem, ("none", *SCHEDULES), given=schedule))


def true_bore(nominal: float, schedule: str) -> float:
    """Return the true bore, m, of a nominal one, m; itself without a schedule that has the size."""
    if schedule not in SCHEDULES:
        return nominal
    for line in _SIZES.strip().splitlines():
        inches, metric, outside, *walls = line.split()
        sizes = float(inches) * INCH, float(metric) / 1e3
        wall = walls[SCHEDULES.index(schedule)]
        if min(abs(nominal / size - 1) for size in sizes) < NEAR and wall != "-":
            return (float(outside) - 2 * float(wall)) / 1e3
    return nominal


Remedy = Literal["assumed", "mended", "left out"]


class ImportNote(NamedTuple):
    """One thing that the network is not as the file has it.

    Attributes:
        remedy: "assumed" for what the file does not say, "mended", or "left out" with a plate where
            something else was joined to it.
        where: the node, pipe or line. problem: what is not as drawn, and why.
    """

    remedy: Remedy
    where: str
    problem: str

    def __str__(self) -> str:
        return f"{self.where}: {self.problem} ({self.remedy})"


@dataclass(frozen=True)
class Import:
    """A network made of another program's file.

    Attributes:
        network: it. notes: what it is not as in the file, in order.
        lengths: of each pipe of the file, by name, m: there, and built.

    Example:
        >>> imported = ot.import_network("line.pcf")  # doctest: +SKIP
        >>> [str(note) for note in imported.notes]  # doctest: +SKIP
    """

    network: Network
    notes: tuple[ImportNote, ...]
    lengths: Mapping[str, tuple[float, float]]

    @property
    def length(self) -> float:
        """Length of all pipes as built, m."""
        return sum(built for _, built in self.lengths.values())

    @property
    def length_in_file(self) -> float:
        """Length of all pipes in the file, m."""
        return sum(there for there, _ in self.lengths.values())

    @property
    def length_ratio(self) -> float:
        """Length that was built of the pipes over that in the file."""
        return self.length / self.length_in_file

    def summary(self) -> dict[str, Any]:
        """Return name, size and notes as plain data."""
        return {
            "name": self.network.name,
            "fittings": len(self.network.fittings),
            "length_m": self.length,
            "length_in_file_m": self.length_in_file,
            "notes": [note._asdict() for note in self.notes],
        }

    def of(self, remedy: Remedy) -> list[ImportNote]:
        """Return the notes of one remedy."""
        return [note for note in self.notes if note.remedy == remedy]


def listed_once(notes: Iterable[ImportNote]) -> tuple[ImportNote, ...]:
    """Return notes in order, each once."""
    return tuple(dict.fromkeys(notes))
