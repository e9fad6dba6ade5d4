"""A statement of a paper with its measurement and expected verdict; and runs that claims about
robots are measured on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario import load_scenario, override
from omnitrack_sim.sim.run import run_batch


class ClaimVerdict(StrEnum):
    """Result of the measurement of a claim."""

    HOLDS = "holds"
    CALIBRATED = "calibrated"
    """It comes out because a parameter of the robot was chosen so that it does: no evidence."""
    CONTRADICTION = "the paper contradicts itself"
    FAILS = "does not come out"
    STUDY = "study"
    """The paper says nothing about it, so there is nothing to judge."""


def verdict_of(holds: bool, other_holds: bool = False) -> ClaimVerdict:
    """Return the verdict of a measurement.

    Args:
        holds: the paper's statement comes out.
        other_holds: another statement of the paper does, which says something else about the same
            thing. The paper contradicts itself where only the other one comes out.
    """
    if holds:
        return ClaimVerdict.HOLDS
    return ClaimVerdict.CONTRADICTION if other_holds else ClaimVerdict.FAILS


class Sample(StrEnum):
    """Kind of sample, which says whether the fewer runs of the quick form can decide a claim."""

    SAME = "both forms take the same runs"
    EVERY = "it is about every run: one that fails in the quick form fails in the full form, too"
    AVERAGE = "it is about rates and averages, which fewer runs cannot decide"

    def decides(self, verdict: ClaimVerdict) -> bool:
        """True if the full form must come to the verdict of the quick form."""
        if self is Sample.EVERY:
            return verdict is not ClaimVerdict.HOLDS
        return self is Sample.SAME


_COLUMNS = (
    *("id", "source", "paper", "statement", "measured", "uncertainty", "verdict", "expected"),
    *("decided", "changed", "reason", "how", "note", "figures"),
)


@dataclass(frozen=True)
class Claim:
    """A statement made measurable, and its measurement.

    Attributes:
        id: short name, a word or two with underscores.
        source: place in the paper.
        paper: the paper's value or wording.
        statement: what is measured and when it counts as true, with tolerance and unit; of a study,
            what is asked.
        measured: the measured figure, with its unit.
        verdict: result of the measurement.
        how: scenarios and number of runs, or the function.
        uncertainty: of the measurement: interval, number of trials, or "exact".
        expected: verdict of the full form of the package as it stands; another one is a change. Of
            a study it is a study.
        why: the reason of the expected verdict, as far as it is known, where the claim is not
            expected to hold.
        note: further observations.
        figures: keys of ``reproduce.FIGURES`` that show it, of the omnidirectional robot.
        sample: verdicts that the runs of the quick form can decide.
        quick: these are the runs of the quick form.

    Raises:
        ValueError: a claim that is not expected to hold gives no reason, or a study has a verdict.
    """

    id: str
    source: str
    paper: str
    statement: str
    measured: str
    verdict: ClaimVerdict
    how: str
    uncertainty: str = "one run"
    expected: ClaimVerdict = ClaimVerdict.HOLDS
    why: str = ""
    note: str = ""
    figures: tuple[str, ...] = ()
    sample: Sample = Sample.SAME
    quick: bool = False

    def __post_init__(self) -> None:
        if self.expected in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS) and not self.why:
            raise ValueError(f"{self.id} gives no reason why it is expected not to hold")
        if self.verdict is ClaimVerdict.STUDY:
            object.__setattr__(self, "expected", ClaimVerdict.STUDY)  # the dataclass is frozen
        elif self.expected is ClaimVerdict.STUDY:
            raise ValueError(f"{self.id} is a study and is judged")

    @property
    def decided(self) -> bool:
        """True if there are enough runs for the verdict; there always are in the full form."""
        study = self.verdict is ClaimVerdict.STUDY
        return not self.quick or study or self.sample.decides(self.verdict)

    @property
    def changed(self) -> bool:
        """True if the verdict is decided, and not the expected one."""
        return self.decided and self.verdict is not self.expected

    @property
    def label(self) -> str:
        """The verdict, and whether the runs are too few for it."""
        return self.verdict if self.decided else f"{self.verdict}, few runs"

    @property
    def difference(self) -> str:
        """Sentence with the expected verdict and the actual one; empty if they are the same."""
        if self.verdict is self.expected:
            return ""
        text = f"{self.id}: expected {self.expected}, came out {self.verdict}"
        return text if self.decided else f"{text}; the quick form has too few runs to decide"

    @property
    def reason(self) -> str:
        """Reason for which the claim does not hold; empty where it does, and of a study."""
        if self.verdict not in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS):
            return ""
        # The reason given is that of the expected verdict and of no other.
        known = self.verdict is self.expected
        return self.why if known else f"Not known; expected was: {self.expected}."

    def row(self) -> dict[str, Any]:
        """The claim as a table of claims.json."""
        return {name: getattr(self, name) for name in _COLUMNS}


ClaimMeasure = Callable[[bool], Claim | list[Claim]]
"""Function that measures claims about a robot; True asks for the quick form."""


def tally(claims: Sequence[Claim]) -> dict[ClaimVerdict, int]:
    """Count the claims of each verdict."""
    count = Counter(claim.verdict for claim in claims)
    return {verdict: count[verdict] for verdict in ClaimVerdict}


def rate(results: Sequence[Result]) -> tuple[int, int, str]:
    """Return passed, total, and both as text with the Wilson 95 % interval."""
    passed, total = sum(r.success for r in results), len(results)
    return passed, total, rate_text(passed, total)


def rate_text(count: int, total: int) -> str:
    """Return a count as text, with its rate and Wilson's 95 % interval."""
    low, high = (100 * end for end in wilson_interval(count, total))
    percent = f"{100 * count / total:.1f} %, 95 % interval {low:.1f} to {high:.1f}"
    return f"{count} of {total} ({percent})"


def slip_of(result: Result) -> float:
    """Return the slip distance, m, summed over the modules."""
    return float(np.sum(np.asarray(result.metrics["slip_distance_m"])))


def largest(result: Result, name: str) -> float:
    """Return a metric of a run, or the largest of its modules' values, in the metric's unit."""
    return float(np.max(result.metrics[name]))  # type: ignore[arg-type]


def runs_of(scenario: str, changes: Iterable[Mapping[str, Any]]) -> list[Result]:
    """Return the results of a shipped scenario with each of the ``changes``, whatever it expects.

    Args:
        scenario: its name.
        changes: new values by dotted key, for each run.
    """
    base = load_scenario(scenario, {"run.expected_outcome": None})
    return list(run_batch([override(base, change) for change in changes]))


def alone(scenario: str, changes: Iterable[Mapping[str, Any]]) -> list[Result]:
    """Return results as ``runs_of`` does, of runs that share no batch: in pipes of their own."""
    return [run for change in changes for run in runs_of(scenario, [change])]


def speed_of(result: Result, begin: float) -> float:
    """Return the speed along the route, m/s, by a straight fitted to the samples after ``begin``
    s."""
    time, s = result.trajectory.time, result.trajectory["distance"]
    return float(np.polyfit(time[time > begin], s[time > begin], 1)[0])


def all_pass(results: Sequence[Result], **words: Any) -> Claim:
    """Return the claim that every run reaches its goal; ``words`` are its further fields."""
    passed, total, text = rate(results)
    words |= {"measured": text, "uncertainty": "Wilson, 95 %", "sample": Sample.EVERY}
    return Claim(verdict=verdict_of(passed == total), **words)


def study(**words: Any) -> Claim:
    """Return a claim about rates or averages of which the paper says nothing."""
    return Claim(verdict=ClaimVerdict.STUDY, sample=Sample.AVERAGE, **words)


FACTORS = 0.7, 1.4
"""Factors by which assumed sizes are varied, one at a time."""


def varied(robot: Robot, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return changes of a scenario by which each named parameter of its robot is smaller and
    larger."""
    return [
        {f"robot.{name}": factor * getattr(robot, name)} for name in names for factor in FACTORS
    ]
