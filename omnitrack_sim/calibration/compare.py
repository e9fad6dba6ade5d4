"""Measured against simulated: a log's columns brought to the samples of a simulated run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.calibration.logs import Log
from omnitrack_sim.calibration.units import named_units, unit_of
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.trajectory import Trajectory

MIN_SAMPLES = 8
"""Samples of a column below which nothing can be said of its noise."""


@dataclass(frozen=True, eq=False)
class Target:
    """One column of one log, at the times at which it is compared with a run.

    Attributes:
        log: index of the log.
        name: column of the trajectory.
        channel: that it is a number of.
        time: (m,) s.
        values: (m,) measured, in the channel's unit.
        noise: standard deviation of what changes from sample to sample, at these times.
    """

    log: int
    name: str
    channel: Channel
    time: Array
    values: Array
    noise: float

    @property
    def spread(self) -> float:
        """Standard deviation of the measured values."""
        return float(np.std(self.values))

    @property
    def span(self) -> float:
        """Range of values below which they count as the same, as figures show them."""
        return self.channel.display.span / self.channel.display.scale

    def residual(self, simulated: Array) -> Array:
        """Return measured less simulated values (m,); angles by the shorter way."""
        difference = self.values - simulated
        if self.channel.display.wraps:
            difference = wrap_angle(difference)
        return difference

    def simulated(self, trajectory: Trajectory, columns: Mapping[str, Array]) -> Array:
        """Return a run's values (m,) at the target's times; beyond its end those of its end."""
        values = columns[self.name]
        if self.channel.display.wraps:
            values = np.unwrap(values)
        return np.interp(self.time, trajectory.time, values)


def targets_of(
    index: int, log: Log, channels: Sequence[Channel], period: float
) -> tuple[list[Target], list[str]]:
    """Return what of a log is compared with runs that are recorded every ``period`` seconds.

    A log that is finer is averaged over each period, which a coarser one is compared at its own
    times. Where nothing was read nothing is compared, and neither before the run begins.

    Returns:
        the targets, and the names of columns that the trajectory does not have.

    Raises:
        InputError: no column is one of the trajectory's, a unit does not fit, or there are too few
            samples.
    """
    columns = {column: channel for channel in channels for column in channel.columns}
    unknown = [name for name in log.values if name not in columns]
    named = [name for name in log.values if name in columns]
    if not named:
        problem = "has no column of the trajectory"
        raise InputError(Fault(log.name, problem, tuple(columns), *unknown[:1]))
    targets = []
    for name in named:
        _check_unit(log, name, columns[name])
        time, values = _regular(log.time, log.values[name], period)
        if len(time) < MIN_SAMPLES:
            problem = f"has {len(time)} samples that can be compared; {MIN_SAMPLES} are needed"
            raise InputError(Fault(f"{log.name}: {name}", problem))
        targets.append(Target(index, name, columns[name], time, values, _noise(values)))
    return targets, unknown


def _check_unit(log: Log, name: str, channel: Channel) -> None:
    """Raise an error for a column in a unit of another kind than its channel's."""
    own, wanted = log.units.get(name), unit_of(channel.unit, name).dimension
    if own is not None and unit_of(own, name).dimension != wanted:
        problem = f"is in {own!r}, another kind of unit than {channel.unit!r} of {name}"
        fitting = tuple(named_units(wanted)) or (channel.unit,)
        raise InputError(Fault(f"{log.name}: {name}", problem, fitting, own))


def _regular(time: Array, values: Array, period: float) -> tuple[Array, Array]:
    """Return times and values of those samples that count, means over a period where finer."""
    known = np.isfinite(values) & (time >= 0)
    time, values = time[known], values[known]
    if len(time) < 2 or np.median(np.diff(time)) >= period * (1 - 1e-6):
        return time, values
    # A mean over a period is what the run's samples are compared with, at the mean of its times.
    bins, of, counts = np.unique(
        np.floor(time / period + 0.5), return_inverse=True, return_counts=True
    )
    means = [np.bincount(of, own) / counts for own in (time, values)]
    return means[0][: len(bins)], means[1][: len(bins)]


def _noise(values: Array) -> float:
    """Standard deviation of white noise in a series, by its second differences."""
    second = np.diff(values, 2)
    # The median does not see a few steps of a quantity that is smooth otherwise; a second
    # difference of white noise has six times its variance.
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6)) if len(second) else 0.0
