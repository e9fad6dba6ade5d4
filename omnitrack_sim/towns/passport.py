"""Passport of a robot: what it passes, how surely and at what cost, measured once by random trials.

For each kind of fitting and way through it the trials are kept as they are. An estimate at a point
counts them by their nearness, so it says how many stand behind it, and says nothing where there are
none.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.writing import write_files
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.robot import GRAVITY, Robot
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.towns.features import FEATURES, kind_of, shape_of, slopes_of
from omnitrack_sim.trials.axes import DirectionAxis, NormalAxis, UniformAxis
from omnitrack_sim.trials.dispatch import MakeExecutor, Progress
from omnitrack_sim.trials.mobility import CourseFile, entry_of, robot_of
from omnitrack_sim.trials.store import numbers_of, passed_of, to_json, to_parquet
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_run import run_sweep

FORMAT = 1
"""Version of the file."""
PASSPORT_FILE, SUMMARY_FILE = "passport.parquet", "passport.json"
SEED = 73_000
FULL, QUICK = 64, 8
"""Trials of a course."""
LEAD = 0.75
"""Length of the straights before and behind a fitting, bores, beside that of the robot."""
BORES = (1.0, 0.97, 1.03)
"""Bores of the courses that are tried in several, over the nominal one."""


@dataclass(frozen=True)
class PassportSettings:
    """Model of a passport.

    Attributes:
        widths: that may be chosen for the nearness in one feature, parts of its range; infinite:
            it does not matter.
        prior: trials of the kind's overall rate that stand behind every estimate.
        least: trials, counted by their nearness, below which a point is unknown.
        slack: by feature, how far outside the trials' range a point still counts as inside.
        pull: largest pull that is tried, robot weights. spread: standard deviation of the pulls'
            half normal distribution: tethers pull little on most of a way.
        friction: range of the walls'.
    """

    widths: tuple[float, ...] = (0.1, 0.2, 0.35, 0.6, math.inf)
    prior: float = 1.0
    least: float = 3.0
    slack: tuple[float, ...] = (0.02, 0.05, 0.02, 0.02, 5.0, 0.06, 0.015)
    pull: float = 6.0
    spread: float = 2.0
    friction: tuple[float, float] = (0.3, 1.0)


SETTINGS = PassportSettings()


class Estimate(NamedTuple):
    """Estimates (q,) at points of one kind of passage.

    Attributes:
        probability: of passing.
        low, high: ends of its 95 % interval.
        support: trials behind it, counted by their nearness.
        is_known: the point lies inside what was tried; elsewhere all else is not a number.
        seconds, joules, slip: means of a pass: s, J and m; in straights of a metre.
        seconds_std, joules_std: standard deviations from pass to pass.
    """

    probability: Array
    low: Array
    high: Array
    support: Array
    is_known: Array
    seconds: Array
    joules: Array
    slip: Array
    seconds_std: Array
    joules_std: Array


@dataclass(frozen=True, eq=False)
class KindTrials:
    """Trials of one kind of passage.

    Attributes:
        points: (n, features).
        passed: (n,) 1 or 0.
        costs: (n, 3) s, J and m of slip; not a number of failures.
        outcomes: (n,) of the runs.
    """

    points: Array
    passed: Array
    costs: Array
    outcomes: Sequence[str]

    @cached_property
    def widths(self) -> Array:
        """Widths (features,) of the nearness, in the features' units.

        Of each feature in turn the one is taken with which the other trials foretell each trial
        best, by the sum of the logarithms of the probabilities that they give to what happened.
        """
        ranges = np.ptp(self.points, axis=0)
        squares = [np.square(x[:, None] - x[None, :]) for x in self.points.T]
        parts = np.where(ranges > 0, SETTINGS.widths[-2], math.inf)

        def exponent(feature: int, part: float) -> Array:
            # A feature that never varied cannot tell trials apart.
            if math.isinf(part) or ranges[feature] == 0:
                return np.zeros((len(self.passed),) * 2)
            return squares[feature] / (part * ranges[feature]) ** 2

        for _ in range(2):
            for feature in np.flatnonzero(ranges > 0).tolist():
                others = sum(exponent(k, parts[k]) for k in range(len(parts)) if k != feature)
                scores = [
                    self._left_out_score(np.exp(-(others + exponent(feature, part)) / 2))
                    for part in SETTINGS.widths
                ]
                # The widest of equally good ones: it has more trials behind it.
                best = max(scores)
                parts[feature] = max(
                    part
                    for part, score in zip(SETTINGS.widths, scores, strict=True)
                    if score >= best - 1e-9
                )
        return parts * np.where(ranges > 0, ranges, 1.0)

    @property
    def rate(self) -> float:
        """Rate of passes, by Jeffreys' prior."""
        return (float(self.passed.sum()) + 0.5) / (len(self.passed) + 1)

    def _left_out_score(self, weights: Array) -> float:
        np.fill_diagonal(weights, 0.0)
        passed = weights @ self.passed + SETTINGS.prior * self.rate
        rate = passed / (weights.sum(axis=1) + SETTINGS.prior)
        return float(np.log(np.where(self.passed == 1, rate, 1 - rate)).sum())

    def estimate(self, points: Array) -> Estimate:
        """Return estimates at points (q, features)."""
        from scipy.stats import beta

        squared = np.zeros((len(points), len(self.passed)))
        for x, own, width in zip(points.T, self.points.T, self.widths, strict=True):
            if np.isfinite(width):
                squared += np.square((x[:, None] - own) / width)
        weights = np.exp(-squared / 2)
        support = weights.sum(axis=1)
        passes = weights @ self.passed + SETTINGS.prior * self.rate
        fails = support + SETTINGS.prior - passes
        slack = np.array(SETTINGS.slack)
        low, high = self.points.min(axis=0) - slack, self.points.max(axis=0) + slack
        inside = ((points >= low) & (points <= high)).all(axis=1)
        known = inside & (support >= SETTINGS.least)
        ends = [beta.ppf(q, passes, fails) for q in (0.025, 0.975)]
        means, deviations = self._cost(weights)
        values = (passes / (passes + fails), *ends)
        return Estimate(
            *(np.where(known, value, np.nan) for value in values),
            support,
            known,
            *(np.where(known, value, np.nan) for value in means),
            *(np.where(known, value, np.nan) for value in deviations[:2]),
        )

    def _cost(self, weights: Array) -> tuple[Array, Array]:
        """Means and standard deviations (3, q) of the costs of passes near points."""
        done = (self.passed == 1) & np.isfinite(self.costs).all(axis=1)
        if not done.any():
            return np.full((2, 3, len(weights)), np.nan)  # type: ignore[return-value]
        costs, near = self.costs[done], weights[:, done]
        overall = costs.mean(axis=0)
        total = near.sum(axis=1, keepdims=True) + SETTINGS.prior
        means = (near @ costs + SETTINGS.prior * overall) / total
        # Of one pass about the mean here; the prior stands for the spread of all.
        squares = near @ costs**2 + SETTINGS.prior * (costs**2).mean(axis=0)
        variance = np.maximum(squares / total - means**2, 0.0)
        return means.T, np.sqrt(variance).T


@dataclass(frozen=True, eq=False)
class Passport:
    """What a robot passes, measured by trials.

    Attributes:
        robot: of which it is.
        changes: that make the robot and its controller in a scenario, by dotted path.
        kinds: trials by the kind of passage; see ``towns.features.kind_of``.
        misfits: why the robot does not fit a course, by the course's name.

    Example:
        >>> passport = ot.run_passport("presser", courses=["straight"], trials=2)
        >>> list(passport.kinds), passport.estimate("elbow", [[0.8, 0, 0, 0, 90, 0.7, 1]]).is_known
        (['straight'], array([False]))
    """

    robot: Robot
    changes: Mapping[str, Any]
    kinds: Mapping[str, KindTrials]
    misfits: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        trials = sum(len(kind.passed) for kind in self.kinds.values())
        return f"Passport({self.robot.kind!r}: {trials} trials of {len(self.kinds)} ways)"

    def estimate(self, kind: str, points: Any) -> Estimate:
        """Return estimates at points (q, features) of a kind of passage; see ``FEATURES``."""
        points = np.asarray(points, float).reshape(-1, len(FEATURES))
        if kind not in self.kinds:
            unknown = np.full(len(points), np.nan)
            known = np.zeros(len(points), bool)
            return Estimate(*[unknown] * 3, np.zeros(len(points)), known, *[unknown] * 5)
        return self.kinds[kind].estimate(points)

    def summary(self) -> dict[str, Any]:
        """Return what ``passport.json`` holds: rates and means by kind, and misfits."""
        rows = []
        for name, kind in self.kinds.items():
            passed, count = int(kind.passed.sum()), len(kind.passed)
            costs = kind.costs[kind.passed == 1]
            means = costs.mean(axis=0).tolist() if len(costs) else [None] * 3
            stopped = sorted({o for o, p in zip(kind.outcomes, kind.passed, strict=True) if not p})
            rows.append(
                {
                    "kind": name,
                    "trials": count,
                    "passed": passed,
                    "success_95": wilson_interval(passed, count),
                    **dict(zip(("seconds", "joules", "slip_m"), means, strict=True)),
                    "stopped_by": {o: kind.outcomes.count(o) for o in stopped},
                    "matters": [
                        name
                        for name, width in zip(FEATURES, kind.widths, strict=True)
                        if np.isfinite(width)
                    ],
                }
            )
        return {"robot": self.robot.kind, "ways": rows, "misfits": dict(self.misfits)}

    def to_bytes(self) -> bytes:
        """Return the passport as a Parquet file: one row a trial."""
        import pyarrow as pa

        columns: dict[str, Any] = {
            "kind": [name for name, kind in self.kinds.items() for _ in kind.passed]
        }
        kinds = self.kinds.values()
        for k, name in enumerate(FEATURES):
            columns[name] = np.concatenate([kind.points[:, k] for kind in kinds])
        columns["passed"] = np.concatenate([kind.passed for kind in kinds]).astype(bool)
        for k, name in enumerate(("seconds", "joules", "slip")):
            columns[name] = np.concatenate([kind.costs[:, k] for kind in kinds])
        columns["outcome"] = [outcome for kind in kinds for outcome in kind.outcomes]
        about = {
            "format": FORMAT,
            "changes": dict(self.changes),
            "misfits": dict(self.misfits),
            **environment(),
        }
        table = pa.table(columns)
        text = json.dumps(about, sort_keys=True)
        return to_parquet(table.replace_schema_metadata({"passport": text}))


def load_passport(path: str | Path) -> Passport:
    """Read a passport from its file or the folder that it is in.

    Raises:
        InputError: there is none, or it is not a passport of this version.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = Path(path) / PASSPORT_FILE if Path(path).is_dir() else Path(path)
    try:
        table = pq.read_table(io.BytesIO(file.read_bytes()))
        about = json.loads((table.schema.metadata or {})[b"passport"])
        if about["format"] != FORMAT:
            raise KeyError("format")
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        problem = f"{file} is no passport of this version: `omnitrack passport` makes one ({error})"
        raise InputError(Fault("passport", problem)) from error
    names = table["kind"].to_pylist()
    points = np.stack([table[name].to_numpy() for name in FEATURES], axis=-1)
    passed = table["passed"].to_numpy().astype(float)
    costs = np.stack([table[name].to_numpy() for name in ("seconds", "joules", "slip")], axis=-1)
    outcomes = table["outcome"].to_pylist()
    kinds = {}
    for name in dict.fromkeys(names):
        rows = np.array([own == name for own in names])
        own = [outcome for outcome, row in zip(outcomes, rows, strict=True) if row]
        kinds[name] = KindTrials(points[rows], passed[rows], costs[rows], own)
    robot = robot_of(about["changes"])
    return Passport(robot, about["changes"], kinds, about["misfits"])


# Measuring


def _pipes() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Names and pipes of all courses, lengths in bores."""
    lead = {"kind": "straight", "length": LEAD}
    tee = (("run_start", "branch"), ("branch", "run_end"), ("run_start", "run_end"))
    for bore in BORES:
        name = "" if bore == 1 else f"_bore_{round(100 * bore)}"
        own = {"inner_diameter": bore}
        yield f"straight{name}", [{**lead, "length": 2 * LEAD, **own}]
        elbow = {"kind": "elbow", "mean_radius": 1.5}
        yield f"elbow_150{name}", [{**one, **own} for one in (lead, elbow, lead)]
        for enter, leave in tee:
            way = {"kind": "tee", "enter": enter, "leave": leave}
            pipes = [{**one, **own} for one in (lead, way, lead)]
            yield f"tee_{enter}_{leave}{name}", pipes
    for radius, angle in ((0.6, 90), (1.0, 90), (3.0, 90), (1.5, 45), (3.0, 20), (1.0, 30)):
        elbow = {"kind": "elbow", "mean_radius": radius, "angle_deg": angle}
        yield f"elbow_{round(100 * radius)}_{angle}", [lead, elbow, lead]
    for angle in (8, 22.5, 45, 90):
        mitre = {"kind": "mitre", "angle_deg": angle}
        yield f"mitre_{angle:g}".replace(".", "_"), [lead, mitre, lead]
    for enter, leave in (*tee, ("run_end", "branch"), ("branch", "run_start")):
        yield (
            f"wye_{enter}_{leave}",
            [lead, {"kind": "wye", "angle_deg": 45, "enter": enter, "leave": leave}, lead],
        )
    for enter, leave in (*tee, ("branch", "opposite")):
        yield (
            f"cross_{enter}_{leave}",
            [lead, {"kind": "cross", "enter": enter, "leave": leave}, lead],
        )
    for bore in (0.95, 1.05):
        reducer = {"kind": "reducer", "length": 0.6, "end_diameter": bore}
        last = {**lead, "inner_diameter": bore}
        yield f"reducer_{round(100 * bore)}", [lead, reducer, last]


def passport_sweep(
    changes: Mapping[str, Any], trials: int, courses: Sequence[str] | None = None
) -> tuple[Sweep, dict[str, str]]:
    """Return the trials of a robot's passport, and why it does not fit some courses.

    Args:
        changes: that make the robot, by dotted path.
        trials: of each course.
        courses: names; all when not given.

    Raises:
        InputError: there is no such course, or the robot fits none.
    """
    made = dict(_pipes())
    for name in courses or ():
        if name not in made:
            raise InputError(Fault("--course", f"is {name!r}", tuple(made), given=name))
    bases: dict[str, Scenario] = {}
    misfits: dict[str, str] = {}
    for name, pipes in made.items():
        if courses and name not in courses:
            continue
        course = CourseFile(name=name, words=name, pipes=tuple(pipes))
        try:
            bases[name] = course.scenario(0, {**changes, "pull.force": 0.0})
        except ScenarioError as error:
            misfits[name] = "; ".join(str(error).splitlines())
    if not bases:
        raise InputError(Fault("robot", f"fits no course: {next(iter(misfits.values()))}"))
    weight = robot_of(changes).mass * GRAVITY
    low, high = SETTINGS.friction
    sweep = Sweep(
        name="passport",
        seed=SEED,
        samples=trials,
        sampling="latin_hypercube",
        draws="independent",
        batch=16,
        axes=(
            UniformAxis(path="world.friction", kind="uniform", low=low, high=high),
            UniformAxis(path="start.theta5_deg", kind="uniform", low=-180, high=180),
            DirectionAxis(path="world.gravity", kind="direction", magnitude=GRAVITY),
            NormalAxis(
                path="pull.force",
                kind="normal",
                mean=0,
                std=SETTINGS.spread * weight,
                low=0,
                high=SETTINGS.pull * weight,
            ),
        ),
        bases=bases,
        set=dict(changes),
    )
    return sweep, misfits


def run_passport(
    robot: str,
    *,
    controller: str = "",
    changes: Mapping[str, Any] | None = None,
    trials: int = FULL,
    courses: Sequence[str] | None = None,
    out: str | Path | None = None,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Progress | None = None,
) -> Passport:
    """Measure a robot: run the trials of its passport that are not done yet.

    Args:
        robot: kind of a robot, an MJCF or URDF file, or ``module:Class``.
        controller: its kind, or ``module:Class``; the robot's own when not given.
        changes: of all scenarios, by dotted path.
        trials: of each course.
        courses: names; all when not given.
        out: folder of the files; trials of earlier runs are found there. Without one nothing is
            written.
        workers: processes that run trials.
        executor: runs them instead, as in ``run_sweep``.
        progress: called with the ``Status`` of all trials.

    Raises:
        InputError: there is no such robot or course, or the robot fits none.
        OutputError: the folder holds something else, or cannot be written.

    Example:
        >>> passport = ot.run_passport("presser", courses=["straight"], trials=2)
        >>> passport
        Passport('presser': 2 trials of 1 ways)
    """
    made = {**entry_of(robot, controller).changes, **(changes or {})}
    sweep, misfits = passport_sweep(made, trials, courses)
    folder = None if out is None else Path(out)
    result = run_sweep(
        sweep,
        out=None if folder is None else folder / "trials",
        workers=workers,
        executor=executor,
        progress=progress,
    )
    passport = Passport(robot_of(made), made, _kinds(sweep, result.table, made), misfits)
    if folder is not None:
        files = {
            PASSPORT_FILE: passport.to_bytes(),
            SUMMARY_FILE: to_json(passport.summary()),
        }
        write_files({folder / name: data for name, data in files.items()})
    return passport


def _kinds(sweep: Sweep, table: Any, changes: Mapping[str, Any]) -> dict[str, KindTrials]:
    """Trials by the kind of passage, from the table of a sweep."""
    robot = robot_of(changes)
    weight = robot.mass * GRAVITY
    passed, names = passed_of(table), table["outcome"].to_pylist()
    bases = table["base"].to_pylist() if len(sweep.bases) > 1 else [*sweep.bases] * table.num_rows
    columns = {name: numbers_of(table, name) for name in ("duration_s", "energy_j", "distance_m")}
    slip = _slip(table)
    gravity = _vectors(table)
    friction, pull = (numbers_of(table, name) for name in ("world.friction", "pull.force"))
    points: dict[str, list[list[float]]] = {}
    rows: dict[str, list[int]] = {}
    ways: dict[int, tuple[float, float, float, float]] = {}
    for i, base in enumerate(bases):
        # Trials that could not begin say nothing of the robot.
        if np.isnan(passed[i]):
            continue
        scenario = sweep.bases[base]
        passages = scenario.route.passages
        passage = passages[len(passages) // 2]
        climb, lift, leaving = slopes_of(passage, gravity[i])
        shape = shape_of(passage, robot.nominal_bore)
        kind = kind_of(passage)
        point = [friction[i], pull[i] / weight, climb, lift, *shape]
        points.setdefault(kind, []).append(point)
        rows.setdefault(kind, []).append(i)
        before = passages[0].s_leave - scenario.start.distance if len(passages) > 1 else 0.0
        behind = scenario.goal_distance - passages[-1].s_enter if len(passages) > 1 else 0.0
        ways[i] = before, climb, behind, leaving
    raw = np.stack([columns["duration_s"], columns["energy_j"], slip], axis=-1)
    kinds: dict[str, KindTrials] = {}
    for kind in sorted(points, key=lambda name: name != "straight"):
        own = np.array(rows[kind])
        place, costs = np.array(points[kind]), raw[own]
        if kind == "straight":
            costs = costs / np.maximum(columns["distance_m"][own], 1e-3)[:, None]
        elif "straight" in kinds:
            costs = costs - _of_straights(kinds["straight"], place, [ways[i] for i in rows[kind]])
        costs = np.where(passed[own, None] == 1, costs, np.nan)
        kinds[kind] = KindTrials(place, passed[own], costs, [names[i] for i in rows[kind]])
    return kinds


def _of_straights(
    straight: KindTrials, points: Array, ways: Sequence[tuple[float, float, float, float]]
) -> Array:
    """Costs (n, 3) of the straights before and behind a fitting."""
    total = np.zeros((len(points), 3))
    before, climb, behind, leaving = np.array(ways).T
    for length, slope in ((before, climb), (behind, leaving)):
        there = points.copy()
        there[:, 2], there[:, 3], there[:, 4], there[:, 5] = slope, 0.0, 0.0, 0.0
        estimate = straight.estimate(there)
        costs = np.stack([estimate.seconds, estimate.joules, estimate.slip], axis=-1)
        total += length[:, None] * costs
    return total


def _slip(table: Any) -> Array:
    """Mean slip distance (n,) m of the bodies or modules that touch."""
    names = [name for name in table.column_names if name.startswith("slip_distance")]
    return np.mean([numbers_of(table, name) for name in names], axis=0)


def _vectors(table: Any) -> Array:
    """Gravity (n, 3) of each trial."""
    return np.stack([numbers_of(table, f"world.gravity_{axis}") for axis in "xyz"], axis=-1)
