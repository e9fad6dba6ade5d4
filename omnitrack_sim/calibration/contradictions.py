"""What logs contradict: columns that no values meet, ranges that are too narrow, logs at odds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.calibration.calibration import FittedColumn
from omnitrack_sim.calibration.logs import Log
from omnitrack_sim.calibration.parameters import Parameter
from omnitrack_sim.record.events import Outcome

MISFIT_PART, MISFIT_NOISE = 0.1, 3.0
"""A column is not met where its residuals are more than this part of what it ranges over, or of
what its channel counts as a change, and more than this many times its noise."""
AT_END = 1e-3
"""Part of a range at whose end a value lies on it."""
EARLY = 0.05
"""Part of a log that the fitted run may end before it."""
ODDS, ODDS_PART = 4.0, 0.1
"""Logs are at odds over a parameter where what they ask for differs by more than this many standard
deviations, and by more than this part of its value."""
_WAYS, _RATES = ("m",), ("m/s", "rad/s", "rad")
"""Units of ways and of the speeds of what drives, whose disagreement is slip."""


def contradictions_of(
    columns: Sequence[FittedColumn],
    logs: Sequence[Log],
    ends: Sequence[tuple[float, Outcome]],
    parameters: Sequence[Parameter],
    values: Array,
    wanted: Sequence[tuple[Array, Array]],
) -> list[str]:
    """Return what the logs contradict, in words; empty where the fitted runs meet them.

    Args:
        columns: measured and fitted.
        logs: that were fitted.
        ends: time, s, and outcome of each log's fitted run.
        parameters: p of them.
        values: (p,) fitted.
        wanted: for each log the values (p,) that it would have alone, each with the others as
            fitted, and their standard deviations; infinite where it says nothing.
    """
    return [
        *_early_ends(logs, ends),
        *_misfits(columns),
        *_ends_of_ranges(parameters, values),
        *_odds(logs, parameters, wanted),
    ]


def _early_ends(logs: Sequence[Log], ends: Sequence[tuple[float, Outcome]]) -> Iterator[str]:
    """Yield the fitted runs that end well before their logs."""
    for log, (time, outcome) in zip(logs, ends, strict=True):
        last = float(log.time[-1])
        if time < last * (1 - EARLY) and outcome is not Outcome.REACHED_GOAL:
            yield (
                f"{log.name}: goes on to {last:.3g} s, and the fitted run ends at {time:.3g} s as "
                f"{outcome.value}"
            )


def _misfits(columns: Sequence[FittedColumn]) -> Iterator[str]:
    """Yield the columns that the fitted run does not meet, and what that may mean."""
    unmet = [column for column in columns if _is_unmet(column)]
    for column in unmet:
        beyond = np.abs(column.residual) > max(MISFIT_NOISE * column.noise, column.rms)
        since = float(column.time[np.argmax(beyond)])
        text = (
            f"{column.log}: {column.column} is not met from {since:.3g} s on, by "
            f"{column.rms:.3g} {column.unit} (rms)"
        )
        if column.noise > 0:
            text += f", {column.rms / column.noise:.3g} times its noise"
        yield text + _meaning(column, [one for one in columns if one not in unmet])


def _is_unmet(column: FittedColumn) -> bool:
    range_of = float(np.ptp(column.measured)) or float(np.abs(column.measured).max())
    range_of = max(range_of, column.span)
    return column.rms > max(MISFIT_PART * range_of, MISFIT_NOISE * column.noise)


def _meaning(column: FittedColumn, met: Sequence[FittedColumn]) -> str:
    """What an unmet column means in the light of those of its log that are met."""
    beside = [one.column for one in met if one.log == column.log and one.unit in _RATES]
    if column.unit not in _WAYS or not beside:
        return ""
    less = column.bias < 0
    return (
        f", while {beside[0]} is met: the robot {'slips' if less else 'creeps'} where the fitted "
        "model does not, or the way is measured wrongly"
    )


def _ends_of_ranges(parameters: Sequence[Parameter], values: Array) -> Iterator[str]:
    """Yield the parameters that the logs press against an end of their range."""
    for parameter, value in zip(parameters, values.tolist(), strict=True):
        room = AT_END * (parameter.high - parameter.low)
        for end, at in (("lower", parameter.low), ("upper", parameter.high)):
            if abs(value - at) <= room:
                yield (
                    f"{parameter.path}: the logs ask for a value beyond the {end} end of its "
                    f"range, {at:.6g} {parameter.unit}".rstrip()
                )


def _odds(
    logs: Sequence[Log],
    parameters: Sequence[Parameter],
    wanted: Sequence[tuple[Array, Array]],
) -> Iterator[str]:
    """Yield the parameters over which two logs are at odds most."""
    for j, parameter in enumerate(parameters):
        own = [(values[j], stds[j], log) for (values, stds), log in zip(wanted, logs, strict=True)]
        pairs = [(a, b) for i, a in enumerate(own) for b in own[:i]]
        apart = [abs(a[0] - b[0]) / np.hypot(a[1], b[1]) for a, b in pairs]
        if not apart or max(apart) < ODDS:
            continue
        low, high = sorted(pairs[int(np.argmax(apart))], key=lambda one: one[0])
        if high[0] - low[0] > ODDS_PART * parameter.scale:
            unit = f" {parameter.unit}" if parameter.unit not in ("", "1") else ""
            yield (
                f"{parameter.path}: {low[2].name} asks for {low[0]:.4g}{unit}, {high[2].name} for "
                f"{high[0]:.4g}{unit}, {max(apart):.2g} standard deviations apart"
            )
