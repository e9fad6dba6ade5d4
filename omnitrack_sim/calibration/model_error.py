"""What a model is wrong by in a log: an error that all of the log's samples share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.calibration.compare import Target

UNSEEN = 1e-9
"""Part of a column below which a parameter does not act on it."""
_WAYS = ("m", "rad")
"""Units of columns that count from an arbitrary zero."""


def size_of(target: Target, simulated: Array) -> float:
    """Return the size of a column: its root mean square, of a way and of an angle its spread."""
    spread = float(np.std(simulated))
    return spread if target.channel.unit in _WAYS else float(np.hypot(spread, np.mean(simulated)))


def effects_of(slopes: Array, weights: Array) -> Array:
    """Return what parameters change of a column (p,), in the mean square over what counts of it.

    Args:
        slopes: (m, p) derivatives of its samples by relative changes of the parameters.
        weights: (m,) of the samples in the fit.
    """
    power = weights**2
    return np.sqrt(power @ slopes**2 / max(float(power.sum()), np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class ModelError:
    """Covariance that a model's own error gives the residuals of one log.

    In each log the model is wrong as if each parameter were another one, by a normal distribution
    about its value. Its standard deviation is a part e of the value; where all columns of the log
    answer to the parameter weakly, it is what changes one of them by the part e of its size. So
    the covariance is

        C = N + J D D J^T

    with the noise N, the derivatives J by the parameters and D = diag(d): an error of the shape of
    what parameters do, fully correlated within the log and independent of that of other logs.
    However many samples a log has, it tells no parameter better than d.

    Attributes:
        deviations: (p,) d, as parts of the parameters.
        directions: (r, k) orthonormal, along which N^-1/2 C N^-1/2 is not 1.
        cuts: (k,) by which C^-1/2 N^1/2 makes them shorter, from 0 to 1.
    """

    deviations: Array
    directions: Array
    cuts: Array

    @classmethod
    def of(cls, part: float, slopes: Array, effects: Array) -> ModelError:
        """Return the error of a log.

        Args:
            part: e.
            slopes: (r, p) derivatives of the residuals over their noise, by relative changes of
                the parameters.
            effects: (c, p) what these change of each column, as parts of its size.
        """
        strongest = np.maximum(effects.max(axis=0, initial=0.0), UNSEEN)
        deviations = part * np.maximum(1.0, 1 / strongest)
        directions, strengths, _ = np.linalg.svd(slopes * deviations, full_matrices=False)
        return cls(deviations, directions, 1 - 1 / np.sqrt(1 + strengths**2))

    def whitened(self, residuals: Array) -> Array:
        """Return residuals (r,) or (r, k) over their noise by C^-1/2 instead of N^-1/2."""
        return residuals - (residuals.T @ self.directions * self.cuts @ self.directions.T).T

    def bounded(self, information: Array) -> Array:
        """Return what a log tells (p, p) that would tell ``information`` with a perfect model."""
        # (F^-1 + D D)^-1 with F = R R^T, which need not have an inverse. Of R, rows of parameters
        # that do not act are 0 to rounding, and stay small beside any D.
        strengths, directions = np.linalg.eigh(information)
        root = directions * np.sqrt(np.maximum(strengths, 0.0))
        within = (root.T * self.deviations**2) @ root
        told = root @ np.linalg.solve(np.eye(len(information)) + within, root.T)
        return (told + told.T) / 2
