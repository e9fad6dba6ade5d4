"""Fit of parameters to logs: closed-loop runs of the scenario against what was measured."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.calibration.calibration import Calibration, FittedColumn
from omnitrack_sim.calibration.compare import Target, targets_of
from omnitrack_sim.calibration.contradictions import contradictions_of
from omnitrack_sim.calibration.doubt import (
    foreseeable,
    independent_count,
    indistinct_of,
    information_of,
    noise_of,
    smoothed,
)
from omnitrack_sim.calibration.logs import Log, as_logs
from omnitrack_sim.calibration.model_error import ModelError, effects_of, size_of
from omnitrack_sim.calibration.parameters import (
    Fit,
    Parameter,
    bounds_of,
    parameters_of,
    places_in,
)
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.scenario.loading import as_scenario
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.sim.simulation import Progress

SEARCHED = 12
"""Sets of values that are tried before the first step, to begin near the best valley: where a run
slips or does not, a small step from a bad start changes nothing."""
SEARCH_TIMES = 3.0
"""They lie between the start values over this and times this, and within the ranges."""
STEP, LONGEST = 0.01, 0.1
"""Steps of finite differences, as parts of values: the first ones, and the least later on, above
the jitter of contacts; and the longest. Between them a step is as long as the doubt is wide: along
what the logs hardly tell, a short one would measure little but chance."""
MODEL_ERROR = 0.01
"""Part by which a model is wrong, unless told otherwise; see ``model_error.ModelError``. Robots
that differ from the model by their walls, their lugs and the time step alone seem to have a grip
that is off by 0.2 to 2.3 %, 1.2 % in the mean square, another one in each test of the bench."""
NEAR = 0.05
"""Change of a value, as a part of it, up to which its derivatives serve a step."""
CLOSE = 0.1
"""Part of their standard deviations by which values may still move when the fit is done."""
ROUNDS, ITERATIONS = 4, 12
"""Most estimates of the noise, and most steps of Gauss and Newton with each."""
FAILED = 1e6
"""Residual, in standard deviations, of values with which there is no run."""

Source = Log | str | os.PathLike[str]
ScenarioLike = Scenario | str | os.PathLike[str]


def calibrate(
    logs: Sequence[Source],
    scenario: ScenarioLike | Sequence[ScenarioLike] | None = None,
    fit: Fit = (),
    *,
    model_error: float = MODEL_ERROR,
    threads: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """Fit numbers of a scenario and its robot to logs of runs.

    The scenario is simulated with its controller, motors and sensors, and what of it was measured
    is compared. Parameters are moved by Gauss-Newton steps until the sum of squares of the
    residuals, each over its noise, is least. The noise of each column is estimated from its
    residuals, with their correlation in time, so that a systematic misfit widens the doubt. To
    that comes what the model itself is wrong by, in each log anew.

    Args:
        logs: of the runs: files that ``load_log`` reads, or logs.
        scenario: of all runs, or a list with one for each log; None: the log's own.
        fit: dotted paths of numbers, as in ``override``; or a mapping to their ranges, (low, high)
            or None. Without a range a value stays within what its key allows, and within a tenth
            and ten times its start.
        model_error: part by which the model may be wrong in each log: the parameters that the log
            alone would have may differ by it, and its columns by this part of their size.
        threads: native threads for the physics; 0 uses all cores. The result does not depend on it.
        progress: see ``Progress``.

    Raises:
        InputError: lists every fault of logs, scenarios and paths.

    Example:
        >>> fit = ot.calibrate(  # doctest: +SKIP
        ...     ["slide.csv", "climb.csv"], "vertical_climb", fit=["world.friction"]
        ... )
        >>> fit.save("mine.toml")  # doctest: +SKIP
    """
    if not 0 <= model_error < 1:
        raise InputError(Fault("model_error", f"is {model_error:g}; it is a part, from 0 to 1"))
    read = as_logs(logs)
    scenarios = _scenarios_of(read, scenario)
    parameters = parameters_of(fit, scenarios)
    runs = _Runs(parameters, read, scenarios, threads)
    return _Fit(runs, model_error, progress).result()


def _scenarios_of(
    logs: Sequence[Log], given: ScenarioLike | Sequence[ScenarioLike] | None
) -> list[Scenario]:
    """Return the scenario of each log, which ends with it.

    Raises:
        InputError: a log has none, or there is not one for each.
    """
    if isinstance(given, Sequence) and not isinstance(given, str):
        sources: list[Any] = [*given]
        if len(sources) != len(logs):
            problem = f"are {len(sources)}, for {len(logs)} logs; give one, or one for each"
            raise InputError(Fault("scenarios", problem))
    else:
        sources = [given] * len(logs)
    faults: list[Fault] = []
    scenarios: list[Scenario] = []
    for log, source in zip(logs, sources, strict=True):
        try:
            scenarios.append(_scenario_of(log, source))
        except InputError as error:
            faults += [fault.at(f"{log.name}: {fault.where}") for fault in error.faults]
    if faults:
        raise InputError(list(dict.fromkeys(faults)))
    return scenarios


def _scenario_of(log: Log, source: ScenarioLike | None) -> Scenario:
    """Return the scenario of a log, with the log's changes and its length of time."""
    own = log.scenario if log.scenario is not None else source
    if own is None:
        raise InputError(Fault("scenario", "is missing: name one for all logs, or in its table"))
    scenario = override(as_scenario(own), log.changes)
    end = float(log.time[-1])
    if end <= 0:
        raise InputError(Fault("time", f"ends at {end:.6g} s; the simulated run begins at 0"))
    return override(scenario, {"run.time_limit": end + scenario.record.period})


@dataclass(frozen=True, eq=False)
class Point:
    """What was simulated with one set of values.

    Attributes:
        simulated: values (m,) of each target; None where the values allow no run.
        ends: time, s, and outcome of each log's run.
    """

    simulated: list[Array] | None
    ends: list[tuple[float, Outcome]]


class _Runs:
    """Runs of the logs' scenarios with sets of values, each set simulated once.

    Attributes:
        targets: columns of the logs that are compared.
        notes: what of the logs is left out.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        logs: Sequence[Log],
        scenarios: Sequence[Scenario],
        threads: int,
    ) -> None:
        self.parameters, self.logs, self.scenarios = parameters, logs, scenarios
        self._threads = threads
        self._paths = [
            [one.path for one in parameters if places_in(scenario, one.path)]
            for scenario in scenarios
        ]
        self._known: dict[bytes, Point] = {}
        self.notes: list[str] = []
        self.targets = self._targets()

    def _targets(self) -> list[Target]:
        """Return what is compared; the runs with the start values tell which columns there are."""
        results = run_batch(self.scenarios, threads=self._threads, no_load=False)
        targets: list[Target] = []
        faults: list[Fault] = []
        for i, (log, result) in enumerate(zip(self.logs, results, strict=True)):
            channels = [*result.trajectory.schema.values()]
            try:
                own, unknown = targets_of(i, log, channels, result.scenario.record.period)
            except InputError as error:
                faults += error.faults
                continue
            targets += own
            if unknown:
                names = ", ".join(unknown)
                self.notes.append(f"{log.name}: not compared, for the run has no such: {names}")
        if faults:
            raise InputError(faults)
        return targets

    def points(self, sets: Array) -> list[Point]:
        """Return what comes of sets of values (k, p)."""
        new = {own.tobytes(): own for own in sets if own.tobytes() not in self._known}
        if new:
            self._known |= dict(zip(new, self._simulate([*new.values()]), strict=True))
        return [self._known[own.tobytes()] for own in sets]

    @property
    def known(self) -> Array:
        """The sets of values (k, p) that were simulated."""
        return np.array([np.frombuffer(own) for own in self._known])

    def _simulate(self, sets: Sequence[Array]) -> list[Point]:
        """Run all logs with each of several sets of values, those that share a model in a batch."""
        valid: list[tuple[int, int, Scenario]] = []
        failed: set[int] = set()
        for k, values in enumerate(sets):
            changes = dict(zip([one.path for one in self.parameters], values.tolist(), strict=True))
            for i, scenario in enumerate(self.scenarios):
                own = {path: changes[path] for path in self._paths[i]}
                try:
                    valid.append((k, i, override(scenario, own)))
                except ScenarioError:
                    failed.add(k)
        runs = [(k, i, one) for k, i, one in valid if k not in failed]
        results = run_batch([one for _, _, one in runs], threads=self._threads, no_load=False)
        of = {(k, i): result for (k, i, _), result in zip(runs, results, strict=True)}
        return [
            Point(None, [])
            if k in failed
            else self._point([of[k, i] for i in range(len(self.logs))])
            for k in range(len(sets))
        ]

    def _point(self, results: Sequence[Any]) -> Point:
        columns = [
            {name: values for name, _, values in result.trajectory.columns()} for result in results
        ]
        simulated = [
            target.simulated(results[target.log].trajectory, columns[target.log])
            for target in self.targets
        ]
        if not all(np.isfinite(values).all() for values in simulated):
            return Point(None, [])
        return Point(simulated, [(result.duration_s, result.outcome) for result in results])


class _Fit:
    """Steps of a fit, and what comes of them.

    Args:
        runs: of the logs.
        model_error: see ``calibrate``.
        progress: told how far the fit is.
    """

    def __init__(self, runs: _Runs, model_error: float, progress: Progress | None) -> None:
        self._runs, self._model_error, self._progress = runs, model_error, progress
        self._parameters = runs.parameters
        self._low, self._high = bounds_of(self._parameters)
        self._start = np.array([one.start for one in self._parameters])
        self._scale = np.array([one.scale for one in self._parameters])
        # Positive values are fitted by their logarithms: what a guess is wrong by is a factor.
        self._by_ratio = self._low > 0
        self._prior = np.array([one.prior for one in self._parameters]) / self._scale
        self._weights: list[Array] = [np.ones(len(target.time)) for target in runs.targets]
        self._sizes = np.ones(len(runs.targets))
        lengths = [len(target.time) for target in runs.targets]
        # Index of the log, and of the target, of each residual.
        self._log_of = np.repeat([target.log for target in runs.targets], lengths)
        self._target_of = np.repeat(np.arange(len(runs.targets)), lengths)
        self._errors: list[ModelError] = []
        self._place = np.full(len(self._start), np.inf)
        self._steps = STEP * np.eye(len(self._start))
        self.independent: list[float] = []

    def result(self) -> Calibration:
        """Fit the parameters, and return them with their doubt."""
        values, number = self._search(), 0
        self._weigh(values, at_start=True)
        information = self._information(values)
        while True:
            number += 1
            self._tell(number / (ROUNDS + 1), f"round {number} of up to {ROUNDS}")
            before, values = values, self._best(self._descend(values))
            self._steps = self._longer(information)
            self._weigh(values)
            information = self._information(values)
            covariance = self._covariance(values, information)
            moved = np.abs(values - before) / np.sqrt(np.diag(covariance))
            if (number > 1 and (moved < CLOSE).all()) or number == ROUNDS:
                return self._calibration(values, information, covariance)

    def _tell(self, part: float, text: str) -> None:
        if self._progress is not None:
            self._progress(part, text)

    def _search(self) -> Array:
        """Return the best set of values (p,) around the start, and weigh columns by size."""
        self._tell(0.0, f"{SEARCHED + 1} sets of values around the start")
        count, p = SEARCHED, len(self._parameters)
        rng = np.random.default_rng(0)
        # A Latin hypercube: each parameter takes evenly spread values, in an order of its own.
        places = np.stack([(rng.permutation(count) + 0.5) / count for _ in range(p)], axis=1)
        sets = np.vstack([self._start, [self._between(place) for place in places]])
        points = self._runs.points(sets)
        known = [point.simulated for point in points if point.simulated is not None]
        if not known:
            raise InputError(Fault("fit", "no values in the ranges allow a run of all logs"))
        for t, target in enumerate(self._runs.targets):
            own = np.array([simulated[t] for simulated in known])
            size = max(target.spread, float(np.sqrt(own.var(axis=0).mean())), 1e-12)
            self._sizes[t] = size
            noise = max(float(np.hypot(target.noise, self._model_error * size)), 1e-12)
            self._weights[t] = np.full(len(target.time), 1 / noise)
        return sets[np.argmin(self._costs(sets))]

    def _costs(self, sets: Array) -> Array:
        """Return the sum of squares (k,) of sets of values (k, p)."""
        return np.sum(self._residuals(sets) ** 2, axis=0)

    def _coordinates(self, values: Array) -> Array:
        """Return values (..., p) as the steps see them: of about the size of 1 each."""
        safe = np.where(self._by_ratio, values, 1.0)
        return np.where(self._by_ratio, np.log(safe / self._scale), values / self._scale)

    def _values(self, coordinates: Array) -> Array:
        """Return the values of coordinates (..., p), within their ranges."""
        ratios = np.exp(np.where(self._by_ratio, coordinates, 0.0))
        own = self._scale * np.where(self._by_ratio, ratios, coordinates)
        return np.clip(own, self._low, self._high)

    def _between(self, place: Array) -> Array:
        """Return values at a place (p,) of the unit cube around the start."""
        values = []
        for one, share in zip(self._parameters, place, strict=True):
            if one.start:
                ends = sorted((one.start / SEARCH_TIMES, one.start * SEARCH_TIMES))
                low, high = max(one.low, ends[0]), min(one.high, ends[1])
            else:
                low, high = one.low, one.high
            # By ratios, as factors are what a guess is wrong by.
            ratio = low * (high / low) ** share if low * high > 0 else low + (high - low) * share
            values.append(ratio)
        return np.array(values)

    def _residuals(self, sets: Array) -> Array:
        """Return weighted residuals (r, k) of sets of values (k, p), those of the priors last."""
        columns = []
        for values, point in zip(sets, self._runs.points(sets), strict=True):
            own = np.concatenate(self._parts(point))
            for i, error in enumerate(self._errors):
                own[self._log_of == i] = error.whitened(own[self._log_of == i])
            columns.append(np.concatenate([own, self._surprise(values)]))
        return np.stack(columns, axis=1)

    def _unweighted(self, sets: Array) -> Array:
        """Return the logs' residuals (r, k), each in its unit, of sets of values (k, p)."""
        ones = [np.ones(len(target.time)) for target in self._runs.targets]
        points = self._runs.points(sets)
        return np.stack([np.concatenate(self._parts(point, ones)) for point in points], axis=1)

    def _surprise(self, values: Array) -> Array:
        """Return how far values (p,) are from what was known before, in standard deviations."""
        return (self._coordinates(values) - self._coordinates(self._start)) / self._prior

    def _parts(self, point: Point, weights: Sequence[Array] | None = None) -> list[Array]:
        """Return the weighted residuals of each target; by default with the fit's own weights."""
        targets = self._runs.targets
        if point.simulated is None:
            return [np.full(len(target.time), FAILED) for target in targets]
        of = zip(weights or self._weights, targets, point.simulated, strict=True)
        return [weight * target.residual(simulated) for weight, target, simulated in of]

    def _descend(self, values: Array) -> Array:
        """Return the values (p,) of the least sum of squares near ``values``."""
        from mujoco import minimize

        def residual(coordinates: Array) -> Array:
            return self._residuals(self._values(coordinates.T))

        def jacobian(coordinates: Array, _: Array) -> Array:
            at = coordinates.ravel()
            if np.abs(at - self._place).max() > NEAR:
                self._place = at
            return self._jacobian(self._place)  # of runs that are known where that is as before

        found, _ = minimize.least_squares(
            self._coordinates(values),
            residual,
            bounds=[self._coordinates(end) for end in (self._low, self._high)],
            jacobian=jacobian,
            x_scale="jac",
            mu_min=1e-2,
            mu_max=1e2,
            mu_factor=10.0,
            # With these scales a gradient is a distance from the least sum in standard deviations.
            gtol=CLOSE,
            max_iter=ITERATIONS,
            verbose=minimize.Verbosity.SILENT,
        )
        return self._values(found.ravel())

    def _weigh(self, values: Array, *, at_start: bool = False) -> None:
        """Weigh samples by the noise of their column and by what is chance in them.

        And by what the column changes by from one sample to the next, for the clocks of a log and
        of a run agree no better; and logs by what the model is wrong by in each. Of what is not met
        ``at_start`` only that counts as noise which no change of the parameters would meet.
        """
        (point,) = self._runs.points(values[None])
        assert point.simulated is not None
        slopes, doubts = self._differences(values)
        self._place = self._coordinates(values)
        self.independent = []
        effects = np.zeros((len(self._runs.targets), len(values)))
        for t, (target, simulated) in enumerate(
            zip(self._runs.targets, point.simulated, strict=True)
        ):
            rows, residual = self._target_of == t, target.residual(simulated)
            if at_start:
                residual = residual - slopes[rows] @ np.linalg.lstsq(slopes[rows], residual)[0]
            chance = smoothed(np.sum(doubts[rows] ** 2, axis=1), target.time)
            size = smoothed(np.sum((slopes[rows] @ self._steps) ** 2, axis=1), target.time)
            share = foreseeable(size, chance)
            least = self._model_error * self._sizes[t]
            # Where a value jumps, within a sample or two, a log and a run agree by luck.
            late = np.gradient(simulated, target.time) * np.median(np.diff(target.time))
            chance += late**2
            spread = noise_of(residual, chance + max(target.noise, least, 1e-12) ** 2)
            noise = np.sqrt(spread**2 + max(least, 1e-12) ** 2 + chance)
            independent = independent_count((residual / noise)[share > 0])
            self.independent.append(independent)
            count = max(np.count_nonzero(share), 1)
            self._weights[t] = np.sqrt(share * independent / count) / noise
            own = effects_of(slopes[rows], self._weights[t])
            effects[t] = own / max(size_of(target, simulated), 1e-12)
        weighted = slopes * np.concatenate(self._weights)[:, None]
        self._errors = []
        for i in range(len(self._runs.logs)):
            of = self._log_of == i
            own = effects[np.unique(self._target_of[of])]
            self._errors.append(ModelError.of(self._model_error, weighted[of], own))

    def _jacobian(self, coordinates: Array) -> Array:
        """Return the derivatives (r, p) of the weighted residuals."""
        slopes, _ = self._differences(self._values(coordinates))
        slopes *= np.concatenate(self._weights)[:, None]
        for i, error in enumerate(self._errors):
            slopes[self._log_of == i] = error.whitened(slopes[self._log_of == i])
        return np.vstack([slopes, np.diag(1 / self._prior)])

    def _longer(self, information: Array) -> Array:
        """Return steps (p, p), one a column: the axes of the doubt, and those of before, if longer.

        Else a doubt that long steps have made small would lead back to short ones, which measure
        chance again.
        """
        variances, axes = np.linalg.eigh(np.linalg.inv(information + np.diag(self._prior**-2.0)))
        before = np.linalg.norm(self._steps.T @ axes, axis=0)
        return axes * np.maximum(np.sqrt(variances), before).clip(STEP, LONGEST)

    def _best(self, values: Array) -> Array:
        """Return the values (p,) of the least sum of squares among all that were simulated."""
        sets = np.vstack([values, self._runs.known])
        return sets[np.argmin(self._costs(sets))]

    def _differences(self, values: Array) -> tuple[Array, Array]:
        """Return first derivatives (r, p) of the logs' residuals, and their chance (r, p).

        The first by relative changes of the values, the second by the steps. Where a robot sticks
        and slips, a small change leads to another course: the residual in the middle of two others
        is not in the middle of theirs, and what they differ by is as much chance as slope.
        """
        low, high = (self._coordinates(end) for end in (self._low, self._high))
        at = self._coordinates(values)
        ends = np.vstack([at + self._steps.T, at - self._steps.T]).clip(low, high)
        ways = ends - at
        residuals = self._unweighted(np.vstack([values, self._values(ends)]))
        changes = residuals[:, 1:] - residuals[:, :1]
        slopes = np.linalg.lstsq(ways, changes.T)[0].T
        own, other = np.split(changes - slopes @ ways.T, 2, axis=1)
        return np.asarray(slopes, float), np.abs(own + other) / 2

    def _information(self, values: Array) -> Array:
        """Return what the logs tell (p, p) of relative changes of the values."""
        weights = np.concatenate(self._weights)[:, None]
        slopes, doubts = (weights * own for own in self._differences(values))
        along = slopes @ self._steps
        told = np.zeros((len(values), len(values)))
        back = np.linalg.inv(self._steps)
        for i, error in enumerate(self._errors):
            own = np.zeros_like(told)
            for t in np.unique(self._target_of[self._log_of == i]):
                rows = self._target_of == t
                own += information_of(along[rows], doubts[rows])
            told += error.bounded(back.T @ own @ back)
        return told

    def _covariance(self, values: Array, information: Array) -> Array:
        """Return the covariance (p, p) of logs and what was known before together."""
        sizes = np.where(self._by_ratio, values, self._scale)
        inverse = np.linalg.inv(information + np.diag(self._prior**-2.0))
        return np.asarray(inverse * np.outer(sizes, sizes), float)

    def _wanted(self, values: Array) -> list[tuple[Array, Array]]:
        """Return what each log alone would ask for of each parameter, and its doubt."""
        sizes = np.where(self._by_ratio, values, self._scale)
        jacobian = self._jacobian(self._coordinates(values))[: -len(values)] / sizes
        residuals = self._residuals(values[None])[:, 0]
        of = self._log_of
        wanted = []
        for i in range(len(self._runs.logs)):
            own, rest = jacobian[of == i], residuals[: len(of)][of == i]
            strength = np.sum(own**2, axis=0)
            told = strength > 0
            safe = np.where(told, strength, 1.0)
            alone = values - np.where(told, own.T @ rest / safe, 0.0)
            wanted.append((alone, np.where(told, 1 / np.sqrt(safe), np.inf)))
        return wanted

    @property
    def _words(self) -> str:
        return f"a model that is wrong by {100 * self._model_error:.3g} % in each log"

    def _calibration(self, values: Array, information: Array, covariance: Array) -> Calibration:
        """Return the values with all that the residuals say."""
        runs = self._runs
        (point,) = runs.points(values[None])
        assert point.simulated is not None
        columns = [
            FittedColumn(
                runs.logs[target.log].name,
                target.name,
                target.channel.unit,
                target.time,
                target.values,
                target.values - target.residual(simulated),
                independent,
                target.noise,
                target.span,
            )
            for target, simulated, independent in zip(
                runs.targets, point.simulated, self.independent, strict=True
            )
        ]
        paths = [one.path for one in self._parameters]
        return Calibration(
            self._parameters,
            values,
            covariance,
            indistinct_of(paths, information),
            contradictions_of(
                columns,
                runs.logs,
                point.ends,
                self._parameters,
                values,
                self._wanted(values),
            ),
            [f"counted beside the noise: {self._words}", *runs.notes],
            columns,
            [log.name for log in runs.logs],
        )
