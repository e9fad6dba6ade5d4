"""Passport of a robot: what it passes, how surely and at what cost, measured once by random trials;
and the features of a passage that its success depends on."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.base.writing import write_files
from omnitrack_sim.pipes import Passage
from omnitrack_sim.record.statistics import Z95, wilson_interval
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.robot import GRAVITY, Robot
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.trials.axes import DirectionAxis, NormalAxis, UniformAxis
from omnitrack_sim.trials.dispatch import MakeExecutor, Progress
from omnitrack_sim.trials.mobility import CourseFile, entry_of, robot_of
from omnitrack_sim.trials.store import numbers_of, passed_of, to_json, to_parquet
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_run import run_sweep

FEATURES = ("friction", "pull", "climb", "lift", "turn", "sharpness", "bore")
"""Of a passage, in the order of arrays:

* friction: of the walls;
* pull: force at the tail over the robot's weight;
* climb: sine of the slope by which the fitting is entered, 1 straight up;
* lift: the same of the direction to which it turns, or in which a branch opens; 0 without one;
* turn: degrees by which the way turns;
* sharpness: bore over bend radius of an elbow; of a reducer the bore's part that it loses;
* bore: over the one that the robot is made for.
"""


def kind_of(passage: Passage) -> str:
    """Return the name of a fitting's kind and of the way through it: "tee, run to branch"."""
    if passage.kind == "cap":  # a straight, whose end is opened where the robot goes in there
        return "straight"
    return passage.kind if passage.words == passage.kind else f"{passage.kind}, {passage.words}"


def slopes_of(passage: Passage, gravity: Array) -> tuple[float, float, float]:
    """Return climb and lift of a passage, and the sine of the slope by which it is left.

    Args:
        passage: of parts that are placed in the world.
        gravity: (3,) m/s², world frame; without any nothing climbs.
    """
    if not np.any(gravity):
        return 0.0, 0.0, 0.0
    up = -direction_of(gravity)
    first, *_, last = [*passage.part.segments(passage.curve)] * 2
    angle = last.length * last.curvature
    leave = last.tangent * math.cos(angle) + last.normal * math.sin(angle)
    turns = passage.asks_orientation
    lift = float(up @ passage.turn_direction) if turns else 0.0
    return float(up @ first.tangent), lift, float(up @ leave)


def shape_of(passage: Passage, nominal_bore: float) -> tuple[float, float, float]:
    """Return turn, sharpness and bore of a passage."""
    turn = math.degrees(passage.description.turn_angle) if passage.is_turn else 0.0
    entry, exit_ = passage.radius, passage.part.fitting.port_radius(passage.leave)
    # From branch to branch a cross leads through its run, which may be wider than both.
    if max(entry, exit_) < passage.part.fitting.radius:
        exit_ = passage.part.fitting.radius
    # Round the corner of a branch the arc is the controller's, not the pipe's.
    bend = 2 * entry / passage.bend_radius if passage.kind == "elbow" else 0.0
    return turn, bend + 1 - exit_ / entry, 2 * entry / nominal_bore


FORMAT = 2
"""Version of the file."""
PASSPORT_FILE, SUMMARY_FILE = "passport.parquet", "passport.json"
SEED = 73_000
FULL, QUICK = 64, 8
"""Trials of a course."""
LEAD = 0.75
"""Length of the straights before and behind a fitting, bores, beside that of the robot."""
MATTERS = 1.0
"""Change of the logit over a feature's range from which on the feature is said to matter."""
BORES = (1.0, 0.95, 1.05)
"""Bores of the courses that are tried in several, over the nominal one."""
NARROW = 0.9
"""Bore of a branch that is narrower than its run, over the run's."""


@dataclass(frozen=True)
class PassportSettings:
    """Trials of a passport.

    Attributes:
        friction: range of the walls'.
        pull: largest pull that is tried, robot weights. spread: standard deviation of the normal
            distribution of the pulls, of which the half below 0 is none: tethers pull little on
            most of a way, and many robots have none.
    """

    friction: tuple[float, float] = (0.3, 1.0)
    pull: float = 6.0
    spread: float = 2.0


@dataclass(frozen=True)
class ModelSettings:
    """Model of the trials of a kind of passage.

    Attributes:
        intercept: standard deviation of the prior of the constant, in logits: 10 says next to
            nothing.
        linear, quadratic: those of the features and of their squares and products, each running
            from -1 to 1, of which the trials choose.
        certain: the least of ``linear`` for friction and pull, which always matter. Where few
            trials show no effect of any feature they would otherwise count for none, and a robot
            that pulls nothing would get the chances of those that were held back. Left-out trials
            are predicted better by it: their logarithmic loss falls by a tenth.
        slack: by feature, how far outside the trials' range a point still counts as inside.
        leverage: how many times farther from the middle of the trials than the farthest of them a
            point may lie, in the measure of regression: combinations that nobody tried are unknown.
        scatter: standard deviation of a cost's logarithm about its mean, which each pass counts
            with that is missing from ``few``: typical of bends, tees and wyes.
        way: length, bores, of the way through a fitting whose costs are modelled; what it is longer
            costs as much as straight pipe. The shorter, the more do costs beside that of the length
            scatter in the logarithm: our left-out trials are predicted best by 0.25 to 0.5.
        least_cost: over the median of their sizes, below which no cost counts: what is left of a
            run without its straights may be little.
    """

    intercept: float = 10.0
    linear: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    quadratic: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    certain: float = 3.0
    slack: tuple[float, ...] = (0.02, 0.05, 0.02, 0.02, 5.0, 0.06, 0.015)
    leverage: float = 1.5
    scatter: float = 0.4
    few: int = 8
    way: float = 0.5
    least_cost: float = 0.05


SETTINGS, MODEL = PassportSettings(), ModelSettings()
CERTAIN = [FEATURES.index(name) for name in ("friction", "pull")]
"""Features that always matter."""


class Estimate(NamedTuple):
    """Estimates (q,) at points of one kind of passage; not numbers where nothing is known.

    Attributes:
        probability: of passing.
        logit_std: standard deviation of its logit.
        low, high: ends of its 95 % interval.
        seconds, joules, slip: means of a pass: s, J and m; of a straight by the metre, of another
            fitting as of a way through it of ``ModelSettings.way``.
        seconds_std, joules_std: standard deviations from pass to pass.
        seconds_error: standard error of the mean, which all passes of a kind share, s.
    """

    probability: Array
    logit_std: Array
    low: Array
    high: Array
    seconds: Array
    joules: Array
    slip: Array
    seconds_std: Array
    joules_std: Array
    seconds_error: Array

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """Points (q,) inside of what was tried."""
        return np.isfinite(self.probability)


class _Logistic(NamedTuple):
    """Fit of a logistic regression: coefficients, their covariance, and logarithm of the
    evidence."""

    coefficients: Array
    covariance: Array
    evidence: float


@dataclass(frozen=True, eq=False)
class KindTrials:
    """Trials of one kind of passage, and the model of them: Bayesian logistic regression on the
    features, their squares and products.

    Priors are normal, and their widths those with the largest evidence (MacKay 1992, "Bayesian
    interpolation"), so that a feature which does not matter costs nothing. The estimate is the
    mode, whose probabilities add up to the passes; its interval is Laplace's.

    Attributes:
        points: (n, features).
        passed: (n,) 1 or 0.
        costs: (n, 3) s, J and m of slip, of straights by the metre, of other fittings brought to
            the length of ``ModelSettings.way``; not a number of failures.
        outcomes: (n,) of the runs.
    """

    points: Array
    passed: Array
    costs: Array
    outcomes: Sequence[str]

    def estimate(self, points: Array) -> Estimate:
        """Return estimates at points (q, features)."""
        basis = self._basis(points)
        logit = basis @ self._fit.coefficients
        std = np.sqrt(((basis @ self._fit.covariance) * basis).sum(axis=1))
        means, deviations, errors = self.cost(points)
        ends = (_probability(logit + side * Z95 * std) for side in (-1, 1))
        values = (_probability(logit), std, *ends, *means, *deviations[:2], errors[0])
        known = self._knows(points)
        return Estimate(*(np.where(known, value, np.nan) for value in values))

    def cost(self, points: Array) -> tuple[Array, Array, Array]:
        """Return means, standard deviations and standard errors of the means (3, q) of the costs of
        a pass, also where nothing is known.

        Costs are lognormal, as what makes a pass long, such as slip and second attempts, multiplies
        it: their logarithms are linear in the features.
        """
        done = np.isfinite(self.costs).all(axis=1)
        if not done.any():
            nothing = np.full((3, len(points)), np.nan)
            return nothing, nothing, nothing
        basis, costs = self._linear(self.points[done]), self.costs[done]
        least = MODEL.least_cost * np.median(np.abs(costs), axis=0) + 1e-9
        logs = np.log(np.maximum(costs, least))
        middle = logs.mean(axis=0)
        # A trial's weight for each coefficient but the constant: a few passes make no slope.
        ridge = np.diag([0.0, *[1.0] * (basis.shape[1] - 1)]) + 1e-9 * np.eye(basis.shape[1])
        inverse = np.asarray(np.linalg.inv(basis.T @ basis + ridge), float)
        coefficients = inverse @ basis.T @ (logs - middle)
        residuals = logs - middle - basis @ coefficients
        free = max(len(costs) - float(np.trace(inverse @ basis.T @ basis)), 1.0)
        variance = (residuals**2).sum(axis=0) / free
        missing = max(1 - len(costs) / MODEL.few, 0.0)
        variance = (1 - missing) * variance + missing * MODEL.scatter**2
        there = self._linear(points)
        means = np.exp(middle + there @ coefficients + variance / 2)
        # Student's distribution, as a normal one of the same 95 %: few trials know it badly.
        wide = float(stdtrit(max(free, 3.0), 0.975)) / Z95
        deviations = means * np.sqrt(np.expm1(variance)) * wide
        leverage = ((there @ inverse) * there).sum(axis=1)
        errors = means * np.sqrt(variance) * np.sqrt(leverage)[:, None] * wide
        return means.T, deviations.T, errors.T

    def effect(self, feature: int) -> float:
        """Return by how much a feature changes the logit over its range, others in the middle."""
        low, high = self.bounds
        line = np.tile((low + high) / 2, (21, 1))
        line[:, feature] = np.linspace(low[feature], high[feature], 21)
        return float(np.ptp(self._basis(line) @ self._fit.coefficients))

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Smallest and largest features of what was tried: of those that are drawn, their range."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        varies = high - low > 1e-9
        drawn_low = [SETTINGS.friction[0], 0.0, -1.0, -1.0, *low[4:]]
        drawn_high = [SETTINGS.friction[1], high[1], 1.0, 1.0, *high[4:]]
        ends = np.minimum(low, drawn_low), np.maximum(high, drawn_high)
        return np.where(varies, ends[0], low), np.where(varies, ends[1], high)

    def _linear(self, points: Array) -> Array:
        """Columns (q, c): 1, and features that vary, from -1 to 1."""
        low, high = self.bounds
        varies = high - low > 1e-9
        z = 2 * (points - low)[:, varies] / (high - low)[varies] - 1
        return np.concatenate([np.ones((len(points), 1)), z], axis=1)

    def _basis(self, points: Array) -> Array:
        """Columns (q, c) of ``_linear``, and squares and products of the features."""
        linear = self._linear(points)
        z = linear.T[1:]
        more = [*z**2, *(a * b for a, b in combinations(z, 2))]
        return np.stack([*linear.T, *more], axis=-1)

    @cached_property
    def _fit(self) -> _Logistic:
        basis = self._basis(self.points)
        low, high = self.bounds
        varies = np.flatnonzero(high - low > 1e-9)
        least = np.where(np.isin(varies, CERTAIN), MODEL.certain, 0.0)
        rest = basis.shape[1] - 1 - len(varies)
        fits: list[_Logistic] = []
        for first, second in product(MODEL.linear, MODEL.quadratic):
            widths = np.maximum(first, least), np.full(rest, second)
            std = np.concatenate([[MODEL.intercept], *widths])
            # From the one before, which is near.
            begin = fits[-1].coefficients if fits else np.zeros(basis.shape[1])
            fits.append(_fitted(basis, self.passed, std**-2.0, begin))
        return max(fits, key=lambda fit: fit.evidence)

    @cached_property
    def _hat(self) -> tuple[Array, float]:
        """Matrix of the leverages, and the largest of the trials."""
        basis = self._linear(self.points)
        square = basis.T @ basis + 1e-6 * len(basis) * np.eye(basis.shape[1])
        inverse = np.asarray(np.linalg.inv(square), float)
        return inverse, float(((basis @ inverse) * basis).sum(axis=1).max())

    def _knows(self, points: Array) -> NDArray[np.bool_]:
        """Points (q,) inside of what was tried."""
        slack = np.array(MODEL.slack)
        low, high = self.bounds[0] - slack, self.bounds[1] + slack
        inverse, most = self._hat
        basis = self._linear(points)
        leverage = ((basis @ inverse) * basis).sum(axis=1)
        inside = ((points >= low) & (points <= high)).all(axis=1)
        return inside & (leverage <= MODEL.leverage * most)


def _probability(logit: Array) -> Array:
    return 1 / (1 + np.exp(-np.clip(logit, -40, 40)))


def _fitted(basis: Array, passed: Array, precision: Array, begin: Array) -> _Logistic:
    """Fit a logistic regression with independent normal priors by Newton's method."""

    def score(w: Array) -> float:
        logit = basis @ w
        fit = passed @ logit - np.logaddexp(0, logit).sum()
        return float(fit - (precision * w**2).sum() / 2)

    def curvature(w: Array) -> Array:
        rate = _probability(basis @ w)
        return (basis * (rate * (1 - rate))[:, None]).T @ basis + np.diag(precision)

    w = begin
    for _ in range(50):
        slope = basis.T @ (passed - _probability(basis @ w)) - precision * w
        step, before = np.linalg.solve(curvature(w), slope), score(w)
        # Half steps where the parabola reaches too far: certain trials make a flat top.
        while score(w + step) < before - 1e-12 and np.abs(step).max() > 1e-9:
            step = step / 2
        w = w + step
        if np.abs(step).max() < 1e-8:
            break
    hessian = curvature(w)
    evidence = score(w) + (np.log(precision).sum() - np.linalg.slogdet(hessian)[1]) / 2
    return _Logistic(w, np.asarray(np.linalg.inv(hessian), float), float(evidence))


@dataclass(frozen=True, eq=False)
class Passport:
    """Chances of a robot to pass fittings, measured by trials.

    Attributes:
        robot: of which it is.
        changes: that make the robot and its controller in a scenario, by dotted path.
        kinds: trials by the kind of passage; see ``towns.ways.kind_of``.
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

    def estimate(self, kind: str, points: Any, lengths: Any = None) -> Estimate:
        """Return estimates at points (q, features) of a kind of passage; see ``FEATURES``.

        Args:
            kind: of the passages. points: features.
            lengths: (q,) m, of the ways; when not given, ``ModelSettings.way``.
        """
        points = np.asarray(points, float).reshape(-1, len(FEATURES))
        if kind not in self.kinds:
            return Estimate(*[np.full(len(points), np.nan)] * len(Estimate._fields))
        made, straight = self.kinds[kind].estimate(points), self.kinds.get("straight")
        if lengths is None or straight is None or kind == "straight":
            return made
        way = MODEL.way * self.robot.nominal_bore
        more = (lengths - way) * straight.cost(_as_straights(points))[0]
        seconds, joules, slip = np.stack([made.seconds, made.joules, made.slip]) + more
        return made._replace(seconds=seconds, joules=joules, slip=slip)

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
                        name for k, name in enumerate(FEATURES) if kind.effect(k) > MATTERS
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
    """Read a passport from its file or the folder that it is in, or a shipped one by name.

    Raises:
        InputError: there is none, or it is not a passport of this version.

    Example:
        >>> made = ot.run_passport("presser", courses=["straight"], trials=1, out="presser")
        >>> ot.load_passport("presser")
        Passport('presser': 1 trials of 1 ways)
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = shipped_files("passports").get(str(path), Path(path))
    file = path / PASSPORT_FILE if path.is_dir() else path
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
    for radius, angle in (
        (0.6, 90),
        (1.0, 90),
        (3.0, 90),
        (1.5, 45),
        (1.5, 6),
        (1.0, 30),
        (1.5, 150),
    ):
        elbow = {"kind": "elbow", "mean_radius": radius, "angle_deg": angle}
        yield f"elbow_{round(100 * radius)}_{angle}", [lead, elbow, lead]
    for angle in (3, 8, 22.5, 45, 90):
        mitre = {"kind": "mitre", "angle_deg": angle}
        yield f"mitre_{angle:g}".replace(".", "_"), [lead, mitre, lead]
    sharp = (("run_end", "branch"), ("branch", "run_start"))
    for angle, (enter, leave) in product((35, 70), (*tee, *sharp)):
        wye = {"kind": "wye", "angle_deg": angle, "enter": enter, "leave": leave}
        yield f"wye_{angle}_{enter}_{leave}", [lead, wye, lead]
    for enter, leave in tee[:2]:
        own = {"branch_diameter": NARROW, "angle_deg": 70, "enter": enter, "leave": leave}
        narrow = {**lead, "inner_diameter": NARROW}
        ends = (lead, narrow) if leave == "branch" else (narrow, lead)
        yield f"wye_narrow_{enter}_{leave}", [ends[0], {"kind": "wye", **own}, ends[1]]
    for enter, leave in (*tee, ("branch", "opposite")):
        cross = {"kind": "cross", "enter": enter, "leave": leave}
        yield f"cross_{enter}_{leave}", [lead, cross, lead]
    for enter, leave in (*tee[:2], *sharp):
        cross = {"kind": "cross", "angle_deg": 60, "enter": enter, "leave": leave}
        yield f"cross_60_{enter}_{leave}", [lead, cross, lead]
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
                clipped=True,
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
        middle, half = (passage.s_enter + passage.s_leave) / 2, MODEL.way * robot.nominal_bore / 2
        before = middle - half - scenario.start.distance
        ways[i] = before, climb, scenario.goal_distance - middle - half, leaving
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
    """Costs (n, 3) of straights as long as the ways before and behind the middle of a fitting."""
    total = np.zeros((len(points), 3))
    before, climb, behind, leaving = np.array(ways).T
    for length, slope in ((before, climb), (behind, leaving)):
        there = _as_straights(points)
        there[:, FEATURES.index("climb")] = slope
        total += length[:, None] * straight.cost(there)[0].T
    return total


def _as_straights(points: Array) -> Array:
    """Points (n, features) of straights at the friction, pull, climb and bore of fittings."""
    there = points.copy()
    there[:, [FEATURES.index(name) for name in ("lift", "turn", "sharpness")]] = 0.0
    return there


def _slip(table: Any) -> Array:
    """Mean slip distance (n,) m of the bodies or modules that touch."""
    names = [name for name in table.column_names if name.startswith("slip_distance")]
    return np.mean([numbers_of(table, name) for name in names], axis=0)


def _vectors(table: Any) -> Array:
    """Gravity (n, 3) of each trial."""
    return np.stack([numbers_of(table, f"world.gravity_{axis}") for axis in "xyz"], axis=-1)
