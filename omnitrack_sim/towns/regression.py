"""Bayesian logistic regression, with the widths of its priors chosen by their evidence.

Trials pass (y = 1) with probability p = 1 / (1 + exp(-B w)), where B has a row of basis values for
each trial, and the coefficients w have independent normal priors of precisions t. The logarithm of
the joint density is, but for a constant,

    s(w) = y B w - sum log(1 + exp(B w)) - sum t w^2 / 2,

its gradient B' (y - p) - t w, and minus its Hessian H = B' diag(p (1 - p)) B + diag(t), which is
positive: s has one maximum, and Newton's method finds it. Laplace's approximation puts a normal
density of covariance H^-1 there. Integrated over w, it gives the logarithm of the evidence of the
priors, again but for a constant,

    s(w) + (sum log t - log det H) / 2,

whose largest value chooses the priors (MacKay 1992, "Bayesian interpolation"; Bishop, "Pattern
recognition and machine learning", 4.4 and 4.5.1).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array


class Logistic(NamedTuple):
    """Fit of a logistic regression.

    Attributes:
        coefficients: (c,) at the maximum.
        covariance: (c, c) of Laplace's approximation.
        evidence: logarithm, but for a constant.
    """

    coefficients: Array
    covariance: Array
    evidence: float


def probability_of(logit: Array) -> Array:
    """Return the probability of a logit; those beyond 40 are as good as certain."""
    return 1 / (1 + np.exp(-np.clip(logit, -40, 40)))


def fit_with_best_priors(basis: Array, passed: Array, stds: Iterable[Array]) -> Logistic:
    """Return the fit of the priors with the largest evidence.

    Args:
        basis: (n, c).
        passed: (n,) 1 or 0.
        stds: standard deviations (c,) of the priors that are tried.
    """
    fits: list[Logistic] = []
    for std in stds:
        # From the one before, which is near.
        start = fits[-1].coefficients if fits else np.zeros(basis.shape[1])
        fits.append(fit(basis, passed, std**-2.0, start))
    return max(fits, key=lambda one: one.evidence)


def fit(basis: Array, passed: Array, precision: Array, start: Array) -> Logistic:
    """Fit a logistic regression with independent normal priors by Newton's method.

    Args:
        basis: (n, c).
        passed: (n,) 1 or 0.
        precision: (c,) of the priors, inverses of variances.
        start: (c,) where the search begins.
    """

    def score(w: Array) -> float:
        logit = basis @ w
        likelihood = passed @ logit - np.logaddexp(0, logit).sum()
        return float(likelihood - (precision * w**2).sum() / 2)

    def curvature(w: Array) -> Array:
        rate = probability_of(basis @ w)
        return (basis * (rate * (1 - rate))[:, None]).T @ basis + np.diag(precision)

    w = start
    for _ in range(50):
        slope = basis.T @ (passed - probability_of(basis @ w)) - precision * w
        step, before = np.linalg.solve(curvature(w), slope), score(w)
        # Half steps where the parabola reaches too far: certain trials make a flat top.
        while score(w + step) < before - 1e-12 and np.abs(step).max() > 1e-9:
            step = step / 2
        w = w + step
        if np.abs(step).max() < 1e-8:
            break
    hessian = curvature(w)
    evidence = score(w) + (np.log(precision).sum() - np.linalg.slogdet(hessian)[1]) / 2
    return Logistic(w, np.asarray(np.linalg.inv(hessian), float), float(evidence))
