"""Model of the trials of one kind of passage: chances of passing, costs, and where it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.statistics import Z95
from omnitrack_sim.towns.features import FEATURES, TRIED
from omnitrack_sim.towns.regression import Logistic, fit_with_best_priors, probability_of


@dataclass(frozen=True)
class ModelSettings:
    """Model of the trials of a kind of passage.

    Attributes:
        intercept: standard deviation of the prior of the constant, in logits: 10 says next to
            nothing.
        linear, quadratic: those of the features and of their squares and products, each running
            from -1 to 1, of which the trials choose: nothing to say, or much. Finer steps predict
            left-out trials no better, and squares that may say still more predict them worse.
        certain: the least of ``linear`` for friction and pull, which always matter. Where few
            trials show no effect of any feature they would otherwise count for none, and a robot
            that pulls nothing would get the chances of those that were held back. The logarithmic
            loss of left-out trials falls by a seventh for the motor ``simulation``, and stays as it
            is, but for chance, for the published one.
        slack: by feature, how far outside the trials' range a point still counts as inside.
        leverage: how many times farther from the middle of the trials than the farthest of them a
            point may lie, in the measure of regression: combinations that nobody tried are unknown.
        scatter: standard deviation of a cost's logarithm about its mean, which each pass counts
            with that is missing from ``few``: typical of bends, tees and wyes.
        way: length, bores, of the way through a fitting whose costs are modelled; what it is longer
            costs as much as straight pipe. The shorter, the more do costs beside that of the length
            scatter in the logarithm: our left-out trials are predicted best by 0.25 to 0.5.
        min_cost: over the median of their sizes, below which no cost counts: what is left of a
            run without its straights may be little.
    """

    intercept: float = 10.0
    linear: tuple[float, ...] = (0.3, 10.0)
    quadratic: tuple[float, ...] = (0.1, 1.0)
    certain: float = 3.0
    slack: tuple[float, ...] = (0.02, 0.05, 0.02, 0.02, 5.0, 0.06, 0.015, 0.002, 0.02, 0.01, 0.01)
    leverage: float = 1.5
    scatter: float = 0.4
    few: int = 8
    way: float = 0.5
    min_cost: float = 0.05


MODEL = ModelSettings()
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


@dataclass(frozen=True, eq=False)
class KindTrials:
    """Trials of one kind of passage, and a model of their success and costs.

    Success is modelled by Bayesian logistic regression on the features, their squares and products.

    The widths of the priors are those with the largest evidence, so that a feature which does not
    matter costs nothing. The estimate is the mode, whose probabilities add up to the passes; its
    interval is Laplace's. Costs are lognormal (see ``cost``).

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
        ends = (probability_of(logit + side * Z95 * std) for side in (-1, 1))
        values = (probability_of(logit), std, *ends, *means, *deviations[:2], errors[0])
        known = self._knows(points)
        return Estimate(*(np.where(known, value, np.nan) for value in values))

    def cost(self, points: Array) -> tuple[Array, Array, Array]:
        """Return the costs of a pass (3, q): means, standard deviations, errors of the means.

        They are given where nothing is known, too. Costs are lognormal, as what makes a pass long,
        such as slip and second attempts, multiplies it: their logarithms are linear in the
        features.
        """
        done = np.isfinite(self.costs).all(axis=1)
        if not done.any():
            nothing = np.full((3, len(points)), np.nan)
            return nothing, nothing, nothing
        basis, costs = self._linear(self.points[done]), self.costs[done]
        least = MODEL.min_cost * np.median(np.abs(costs), axis=0) + 1e-9
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
        drawn_low = [TRIED.friction[0], 0.0, -1.0, -1.0, *low[4:]]
        drawn_high = [TRIED.friction[1], high[1], 1.0, 1.0, *high[4:]]
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
    def _fit(self) -> Logistic:
        basis = self._basis(self.points)
        low, high = self.bounds
        varies = np.flatnonzero(high - low > 1e-9)
        least = np.where(np.isin(varies, CERTAIN), MODEL.certain, 0.0)
        rest = basis.shape[1] - 1 - len(varies)
        stds = [
            np.concatenate([[MODEL.intercept], np.maximum(first, least), np.full(rest, second)])
            for first, second in product(MODEL.linear, MODEL.quadratic)
        ]
        return fit_with_best_priors(basis, self.passed, stds)

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
