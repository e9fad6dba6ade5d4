"""Claims of papers as data, their measurements and verdicts, and what measurements share."""

from __future__ import annotations

from collections import Counter, UserDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.record.statistics import mean_interval, wilson_interval
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
    """Nothing is judged: the paper says nothing about it, or two figures stand side by side."""


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


class Figure(NamedTuple):
    """A figure with its interval.

    Attributes:
        middle: the figure.
        low: lower end of its 95 % interval.
        high: upper end.
        how: what the interval is over.
    """

    middle: float
    low: float
    high: float
    how: str

    def over(self, value: float) -> Figure:
        """Return the ratio to a positive value."""
        return Figure(self.middle / value, self.low / value, self.high / value, self.how)

    def text(self, unit: str = "") -> str:
        """Return figure, unit and interval to three digits."""
        middle, low, high = (format(Decimal(f"{value:.3g}"), "f") for value in self[:3])
        return f"{' '.join(filter(None, (middle, unit)))} ({low} to {high})"


class Measurement(NamedTuple):
    """What the measurement of a claim found.

    Attributes:
        measured: the measured figure, with its unit.
        holds: the paper's statement comes out; None of a study.
        other_holds: another statement of the paper does, which says something else about the same
            thing. The paper contradicts itself where only the other one comes out.
        uncertainty: of the figure: interval, number of trials, or "exact".
        calibrated: a parameter of the robot was chosen so that the statement comes out.
        figure: the figure as numbers, where it stands beside a published one.
    """

    measured: str
    holds: bool | None = None
    other_holds: bool = False
    uncertainty: str = "one run"
    calibrated: bool = False
    figure: Figure | None = None

    @property
    def verdict(self) -> ClaimVerdict:
        """Verdict that follows from the figures."""
        if self.holds is None:
            return ClaimVerdict.STUDY
        if self.holds:
            return ClaimVerdict.CALIBRATED if self.calibrated else ClaimVerdict.HOLDS
        return ClaimVerdict.CONTRADICTION if self.other_holds else ClaimVerdict.FAILS


@dataclass(frozen=True)
class Claim:
    """A published statement made measurable, and the function that measures it.

    Attributes:
        id: short name, a word or two with underscores.
        source: place in the paper.
        paper: the paper's value or wording.
        statement: what is measured and when it counts as true, with tolerance and unit; of a study,
            what is asked. Limits stand in it by their names, as in ``{percent:g} %``.
        how: scenarios and number of runs, or the function.
        measure: called with the runs of the omnidirectional robot, or of another robot with whether
            the quick form is asked for; limits are keywords.
        limits: tolerances and bounds of the statement, by name.
        expected: verdict of the full form of the package as it stands; another one is a change.
        why: the reason of the expected verdict, as far as it is known, where the claim is not
            expected to hold.
        note: further observations.
        figures: keys of ``reproduce.FIGURES`` that show it, of the omnidirectional robot.
        sample: verdicts that the runs of the quick form can decide.

    Raises:
        ValueError: a claim that is not expected to hold gives no reason.
    """

    id: str
    source: str
    paper: str
    statement: str
    how: str
    measure: Callable[..., Measurement]
    limits: Mapping[str, float] = field(default_factory=dict)
    expected: ClaimVerdict = ClaimVerdict.HOLDS
    why: str = ""
    note: str = ""
    figures: tuple[str, ...] = ()
    sample: Sample = Sample.SAME

    def __post_init__(self) -> None:
        if self.expected in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS) and not self.why:
            raise ValueError(f"{self.id} gives no reason why it is expected not to hold")

    @property
    def text(self) -> str:
        """The statement with its limits."""
        return self.statement.format(**self.limits)

    def __call__(self, given: Any, quick: bool = False) -> Finding:
        """Measure the claim.

        Args:
            given: runs of the omnidirectional robot; of another robot, whether the quick form is
                asked for.
            quick: the measurement is that of the quick form.
        """
        runs = _Reading(given) if isinstance(given, Mapping) else given
        measurement = self.measure(runs, **self.limits)
        read = runs.read if isinstance(runs, _Reading) else {}
        return Finding(self, measurement, quick, driving(r for own in read.values() for r in own))


class _Reading(UserDict[str, Sequence[Result]]):
    """Runs that keep those that a claim reads."""

    def __init__(self, runs: Mapping[str, Sequence[Result]]) -> None:
        super().__init__(runs)
        self.read: dict[str, Sequence[Result]] = {}

    def __getitem__(self, name: str) -> Sequence[Result]:
        return self.read.setdefault(name, super().__getitem__(name))


CONTROLLERS = {
    "jacobian": "feedback",
    "paper": "as written",
    "equal": "equal speeds",
    "Preset": "set beforehand",
}
"""What drives the paper's robot, by ``control.kind``; another name stands for itself."""


def driving(results: Iterable[Result]) -> str:
    """Return by which controllers and which motors some runs are driven; nothing of no runs."""
    ways: dict[str, dict[str, None]] = {}
    for result in results:
        scenario = result.scenario
        kind = scenario.control.kind.rpartition(":")[2]
        motor, drive = scenario.robot.motor, scenario.robot.drive
        way = CONTROLLERS.get(kind, kind)
        way += "" if drive == "three_motors" else f" with one motor, {drive}"
        ways.setdefault(f"{motor.name} up to {motor.torque_limit:.3g} N m", {})[way] = None
    return "; ".join(f"{', '.join(own)}: {motor}" for motor, own in ways.items())


def claim(**fields: Any) -> Callable[[Callable[..., Measurement]], Claim]:
    """Return a decorator that makes a claim of its data and the function that measures it.

    The claim has the function's name.
    """
    return lambda measure: Claim(id=measure.__name__, measure=measure, **fields)


def study(**fields: Any) -> Callable[[Callable[..., Measurement]], Claim]:
    """Return a decorator like ``claim``, of a question that the paper does not answer."""
    return claim(expected=ClaimVerdict.STUDY, sample=Sample.AVERAGE, **fields)


@dataclass(frozen=True)
class Finding:
    """A claim with its measurement.

    Attributes:
        claim: what was measured.
        measurement: what came out.
        quick: these are the runs of the quick form.
        driven: controllers and motors of the runs that it was measured on; empty without runs.

    Raises:
        ValueError: a study is judged, or a claim is not.
    """

    claim: Claim
    measurement: Measurement
    quick: bool = False
    driven: str = ""

    def __post_init__(self) -> None:
        study = ClaimVerdict.STUDY
        if (self.verdict is study) != (self.claim.expected is study):
            raise ValueError(f"{self.claim.id}: {self.claim.expected} came out as {self.verdict}")

    @property
    def verdict(self) -> ClaimVerdict:
        """Verdict that follows from the figures."""
        return self.measurement.verdict

    @property
    def decided(self) -> bool:
        """True if there are enough runs for the verdict; there always are in the full form."""
        study = self.verdict is ClaimVerdict.STUDY
        return not self.quick or study or self.claim.sample.decides(self.verdict)

    @property
    def changed(self) -> bool:
        """True if the verdict is decided, and not the expected one."""
        return self.decided and self.verdict is not self.claim.expected

    @property
    def label(self) -> str:
        """The verdict, and whether the runs are too few for it."""
        return self.verdict if self.decided else f"{self.verdict}, few runs"

    @property
    def difference(self) -> str:
        """Sentence with the expected verdict and the actual one; empty if they are the same."""
        expected = self.claim.expected
        if self.verdict is expected:
            return ""
        text = f"{self.claim.id}: expected {expected}, came out {self.verdict}"
        return text if self.decided else f"{text}; the quick form has too few runs to decide"

    @property
    def reason(self) -> str:
        """Reason for which the claim does not hold; empty where it does, and of a study."""
        if self.verdict not in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS):
            return ""
        # The reason given is that of the expected verdict and of no other.
        known = self.verdict is self.claim.expected
        return self.claim.why if known else f"Not known; expected was: {self.claim.expected}."

    def row(self) -> dict[str, Any]:
        """The finding as a table of claims.json."""
        claim, measurement = self.claim, self.measurement
        return {
            "id": claim.id,
            "source": claim.source,
            "paper": claim.paper,
            "statement": claim.text,
            "driven": self.driven,
            "measured": measurement.measured,
            "uncertainty": measurement.uncertainty,
            "verdict": self.verdict,
            "expected": claim.expected,
            "decided": self.decided,
            "changed": self.changed,
            "reason": self.reason,
            "how": claim.how,
            "note": claim.note,
            "figures": claim.figures,
        }


def tally(findings: Iterable[Finding]) -> dict[ClaimVerdict, int]:
    """Count the findings of each verdict."""
    count = Counter(finding.verdict for finding in findings)
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


class Difference(NamedTuple):
    """Mean of one figure less the mean of another, over the same draws, with its 95 % interval.

    Attributes:
        first: mean of the one.
        second: mean of the other.
        low: end of the interval of ``first - second``, by Student's t of the pairs; not a number
            for fewer than two pairs, of which nothing holds.
        high: its other end.
    """

    first: float
    second: float
    low: float
    high: float

    def over(self, least: float = 0.0) -> bool:
        """Return whether the first is larger by more than ``least``, whatever the draws were."""
        return self.low > least

    @property
    def under(self) -> bool:
        """True if the first is smaller, whatever the draws were."""
        return self.high < 0.0

    def gain(self, digits: int = 0) -> str:
        """Return what the first has more than the second, with the interval."""
        ends = self.first - self.second, self.low, self.high
        mean, low, high = (f"{value:.{digits}f}" for value in ends)
        return f"{mean} more, 95 % interval {low} to {high}"

    def text(self, unit: str, digits: int = 0) -> str:
        """Return both means, and what the first has more than the second."""
        means = f"{self.first:.{digits}f} against {self.second:.{digits}f} {unit}"
        return f"{means} ({self.gain(digits)})"


def difference(first: ArrayLike, second: ArrayLike) -> Difference:
    """Return how much more a figure is than another one.

    Args:
        first: (n,) figure of each draw.
        second: (n,) the other figure, of the same draws in their order.

    Raises:
        ValueError: the draws are not the same.
    """
    one, other = np.asarray(first, float), np.asarray(second, float)
    if one.shape != other.shape:
        raise ValueError(f"{one.size} draws have no pairs among {other.size}")
    return Difference(
        float(one.mean()), float(other.mean()), *mean_interval((one - other).tolist())
    )


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
    """Return the speed along the route, m/s, by a line fitted to samples after ``begin`` s."""
    time, s = result.trajectory.time, result.trajectory["distance"]
    return float(np.polyfit(time[time > begin], s[time > begin], 1)[0])


def passes(results: Sequence[Result]) -> Measurement:
    """Return the measurement of the claim that every run reaches its goal."""
    passed, total, text = rate(results)
    return Measurement(text, passed == total, uncertainty="Wilson, 95 %")


FACTORS = 0.7, 1.4
"""Factors by which assumed sizes are varied, one at a time."""


def varied(robot: Robot, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return changes of a scenario with each named parameter of its robot smaller and larger."""
    return [
        {f"robot.{name}": factor * getattr(robot, name)} for name in names for factor in FACTORS
    ]
