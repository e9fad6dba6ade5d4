"""Plans of trials: which trials come next, given the results of those that are done."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from omnitrack_sim.trials.batches import Batch

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Round:
    """Trials that a plan asks for together.

    Attributes:
        batches: of the trials, whose indices are 0 to n - 1.
        columns: (n,) each, what the plan adds to the rows of the trials, by name; a vector of
            three numbers becomes three columns, and None an empty cell.
        total: number of trials of the whole plan as far as it is known by now; none: as known
            before, or as many as have been asked for.
        stage: of the plan, such as "generation 2 of 20"; empty for a plan of one round.
        tables: what is known so far, by name, for the folder.
        units: of the columns that have one, by name.

    Example:
        >>> asked = next(ot.load_sweep("tee_orientation").rounds())
        >>> len(asked.batches), list(asked.columns)
        (4, ['start.theta5_deg'])
    """

    batches: Sequence[Batch]
    columns: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    total: int | None = None
    stage: str = ""
    tables: Mapping[str, pa.Table] = field(default_factory=dict)
    units: Mapping[str, str | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Conclusion:
    """What a plan makes of the results of all its trials.

    Attributes:
        summary: plain data, for ``summary.json``.
        tables: by name, for ``NAME.parquet`` and ``NAME.csv``.
        files: contents of other files, by path in the folder.
        draw: makes the plan's figure; none: there is none.

    Example:
        >>> ot.Conclusion({"passed": 3}).summary
        {'passed': 3}
    """

    summary: dict[str, Any]
    tables: Mapping[str, pa.Table] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    draw: Callable[[], bytes] | None = None


Rounds = Generator[Round, "pa.Table", Conclusion]


class Plan(ABC):
    """A plan of trials, for ``run_trials``: a ``Sweep``, a ``Study``, a ``Bench``, or your own.

    Attributes:
        noun: what it is; its record in a folder is the file of that name in JSON.
        names: of the tables that it makes beside ``trials``.
        files: names of other files that it makes; ``figure``: of its figure.
        folder: that holds further files of it; empty for none.
        free: keys of its data that its trials do not depend on.
        packages: whose versions its record names as well.
        name: of the plan.

    Example:
        >>> isinstance(ot.load_sweep("tee_orientation"), ot.Plan)
        True
    """

    noun: ClassVar[str]
    names: ClassVar[tuple[str, ...]] = ()
    files: ClassVar[tuple[str, ...]] = ()
    figure: ClassVar[str] = ""
    folder: ClassVar[str] = ""
    free: ClassVar[tuple[str, ...]] = ()
    packages: ClassVar[tuple[str, ...]] = ()
    name: Any

    @property
    @abstractmethod
    def hash(self) -> str:
        """SHA-256 of everything that its trials depend on, hexadecimal."""

    @abstractmethod
    def data(self) -> dict[str, Any]:
        """Return the plan as plain data, for its record."""

    def kept(self) -> dict[str, Any]:
        """Return what its record keeps beside, for who reads it without the code it names."""
        return {}

    @abstractmethod
    def rounds(self) -> Rounds:
        """Yield rounds of trials, receive the table of each, and return the conclusion.

        A plan that is resumed is sent the same tables and must ask for the same trials.
        """
