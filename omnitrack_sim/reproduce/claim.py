"""One statement of the paper and what the simulation says about it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Claim:
    """A statement made measurable, and its measurement.

    Attributes:
        id: short name, a word or two with underscores.
        source: place in the paper.
        paper: the paper's value or wording.
        statement: what is measured and when it counts as true, with tolerance and unit.
        measured: the figure found, with its unit.
        uncertainty: how sure it is: interval, number of trials, or "exact".
        holds: the verdict.
        how: scenarios and number of runs, or the function.
        note: why, where it disagrees; what else was seen.
    """

    id: str
    source: str
    paper: str
    statement: str
    measured: str
    uncertainty: str
    holds: bool
    how: str
    note: str = ""

    @property
    def verdict(self) -> str:
        """``holds`` or ``fails``."""
        return "holds" if self.holds else "fails"

    def row(self) -> dict[str, Any]:
        """The claim as a table of claims.json."""
        row = asdict(self)
        row["holds"] = bool(self.holds)
        return row | {"verdict": self.verdict}
