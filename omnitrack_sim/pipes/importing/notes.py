"""Report of an import, place by place: assumed, mended and left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from omnitrack_sim.pipes.network import Network

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
    def length_ratio(self) -> float:
        """Length that was built of the pipes over that in the file."""
        there, built = (sum(column) for column in zip(*self.lengths.values(), strict=True))
        return built / there

    def of(self, remedy: Remedy) -> list[ImportNote]:
        """Return the notes of one remedy."""
        return [note for note in self.notes if note.remedy == remedy]


def listed_once(notes: Iterable[ImportNote]) -> tuple[ImportNote, ...]:
    """Return notes in order, each once."""
    return tuple(dict.fromkeys(notes))
