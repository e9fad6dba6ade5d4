"""Published measurements beside simulated values: what an entry says, and its ratio."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.paper.claim import (
    FACTORS,
    Claim,
    ClaimVerdict,
    Figure,
    Finding,
    Measurement,
    Sample,
)
from omnitrack_sim.paper.experiments import SEED
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.result import Result


class Read(StrEnum):
    """How much of a publication could be read."""

    WHOLE = "the whole text"
    SUMMARY = "the summary alone"
    ABSTRACT = "the abstract alone"


class Publication(NamedTuple):
    """Where a measurement was published.

    Attributes:
        title: authors, title, place and year.
        address: at which it can be read.
        read: how much of it could be read.
    """

    title: str
    address: str
    read: Read


@dataclass(frozen=True, kw_only=True)
class Entry(Claim):
    """A published measurement, and the function that simulates its value.

    Attributes:
        publication: where it stands.
        robot: whose measurement it is.
        ours: kind of the simulated robot.
        quote: the publication's sentence that holds the figure.
        stated: the words of ``quote`` that are the figure, or the two of which it is the ratio.
        value: the published figure, in ``unit``.
        unit: of both figures.
        tuned: what was chosen so that the simulated figure comes out; empty: nothing.
    """

    publication: Publication
    robot: str
    ours: str
    quote: str
    stated: tuple[str, ...]
    value: float
    unit: str
    tuned: str = ""

    @property
    def text(self) -> str:
        """The statement, and what was tuned."""
        return f"{super().text}; tuned on it: {self.tuned or 'nothing'}"

    def __call__(self, given: Any, quick: bool = False) -> Comparison:
        """Simulate the figure; ``given`` is whether the quick form is asked for."""
        return Comparison(self, self.measure(given, **self.limits), quick)


@dataclass(frozen=True)
class Comparison(Finding):
    """An entry with the simulated figure."""

    claim: Entry

    @property
    def figure(self) -> Figure:
        """The simulated figure."""
        assert self.measurement.figure is not None
        return self.measurement.figure

    @property
    def ratio(self) -> Figure:
        """The simulated figure over the published one."""
        return self.figure.over(self.claim.value)

    @property
    def agrees(self) -> bool:
        """True if the interval of the ratio holds one."""
        return self.ratio.low <= 1.0 <= self.ratio.high

    @property
    def reason(self) -> str:
        """Why it misses; empty where it does not."""
        return "" if self.agrees else self.claim.why

    def row(self) -> dict[str, Any]:
        """See ``Finding``; with the figures as numbers."""
        entry, figures = self.claim, {"simulated": self.figure, "ratio": self.ratio}
        return super().row() | {
            "title": entry.publication.title,
            "address": entry.publication.address,
            "read": entry.publication.read,
            "quote": entry.quote,
            "robot": entry.robot,
            "ours": entry.ours,
            "published": entry.value,
            "unit": entry.unit,
            "tuned": entry.tuned,
            "agrees": self.agrees,
            **{
                name: {"value": figure.middle, "low": figure.low, "high": figure.high}
                for name, figure in figures.items()
            },
        }


def published(**fields: Any) -> Callable[[Callable[[bool], Figure]], Entry]:
    """Return a decorator that makes an entry of its data and the function that simulates it.

    The entry has the function's name. The function is given whether the quick form is asked for.
    """

    def made(simulate: Callable[[bool], Figure]) -> Entry:
        source: Publication = fields["publication"]
        value, unit = fields["value"], fields["unit"]

        def measure(quick: bool) -> Measurement:
            figure = simulate(quick)
            texts = figure.text(unit), f"ratio {figure.over(value).text()}"
            return Measurement("; ".join(texts), uncertainty=figure.how, figure=figure)

        return Entry(
            id=simulate.__name__,
            source=f"{source.title} ({source.read}): {source.address}",
            paper=f"{value:.3g} {unit}: “{fields['quote']}”",
            measure=measure,
            expected=ClaimVerdict.STUDY,
            sample=Sample.AVERAGE,
            **fields,
        )

    return made


def of_draws(values: ArrayLike) -> Figure:
    """Return the median of draws, and the interval that holds 95 % of them."""
    each = np.asarray(values, float)
    low, middle, high = np.quantile(each, [0.025, 0.5, 0.975])
    return Figure(float(middle), float(low), float(high), f"95 % of {each.size} draws")


def of_runs(results: Sequence[Result]) -> Figure:
    """Return the part of runs that pass, %, with Wilson's interval."""
    passed, total = sum(run.success for run in results), len(results)
    low, high = wilson_interval(passed, total)
    return Figure(100 * passed / total, 100 * low, 100 * high, f"Wilson, {total} runs")


def drawn(count: int, **ranges: tuple[float, float]) -> list[dict[str, float]]:
    """Return draws, uniform in each range, by name."""
    rng = np.random.default_rng(SEED)
    return [
        {name: float(rng.uniform(*ends)) for name, ends in ranges.items()} for _ in range(count)
    ]


def directions(count: int) -> list[list[float]]:
    """Return directions of a route's first axis, as ``start.axis``, uniform on the sphere."""
    return np.random.default_rng(SEED).normal(size=(count, 3)).tolist()


def around(value: float) -> tuple[float, float]:
    """Return the range in which an assumed size is drawn."""
    low, high = FACTORS
    return low * value, high * value
