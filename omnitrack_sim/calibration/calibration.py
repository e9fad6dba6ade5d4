"""What a calibration has found: values with their doubt, saved as a file that ``--set`` takes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.bounds import MAX_NUMBER
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import CALIBRATION, checked, placed_in, refuse_missing, table_of
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import as_toml, toml_key
from omnitrack_sim.base.writing import write_files
from omnitrack_sim.calibration.doubt import Indistinct, draw_within
from omnitrack_sim.calibration.parameters import Parameter
from omnitrack_sim.robots.quantity import Provenance

CALIBRATED = "calibrated"
"""Provenance of a value that was fitted."""
MAX_PARAMETERS = 50
DIGITS = 9
"""Significant digits of the numbers in a file."""

Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]


@dataclass(frozen=True, eq=False)
class FittedColumn:
    """A column of a log, measured and as the fitted run has it.

    Attributes:
        log: name of the log.
        column: of the trajectory.
        unit: of its numbers.
        time: (m,) s, at which the two are compared.
        measured: (m,).
        fitted: (m,).
        independent: number of independent samples that the residuals are worth.
        noise: standard deviation of what changes from sample to sample in what was measured.
        span: range of its numbers below which they count as the same.
    """

    log: str
    column: str
    unit: str
    time: Array
    measured: Array
    fitted: Array
    independent: float
    noise: float
    span: float = 0.0

    @property
    def residual(self) -> Array:
        """(m,) measured less fitted."""
        return self.measured - self.fitted

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def bias(self) -> float:
        """Mean of the residuals."""
        return float(np.mean(self.residual))


@dataclass(frozen=True, eq=False)
class Calibration:
    """Parameters that were fitted to logs, with their doubt.

    Attributes:
        parameters: p of them, with their ranges and what was known before.
        values: (p,) fitted.
        covariance: (p, p) of their doubt, in their own units.
        indistinct: directions of parameters that the logs leave open, the widest first.
        contradictions: what the logs contradict, in words.
        notes: what else is worth knowing, in words.
        columns: what was compared; empty for a calibration that was read from a file.
        logs: names of the logs.

    Example:
        >>> fit = ot.load_calibration("mine.toml")  # doctest: +SKIP
        >>> robot = ot.override(ot.load_scenario("tee_turn"), fit.changes)  # doctest: +SKIP
    """

    parameters: Sequence[Parameter]
    values: Array
    covariance: Array
    indistinct: Sequence[Indistinct] = ()
    contradictions: Sequence[str] = ()
    notes: Sequence[str] = ()
    columns: Sequence[FittedColumn] = field(default=(), repr=False)
    logs: Sequence[str] = ()

    @property
    def fit(self) -> tuple[str, ...]:
        """Paths of the parameters."""
        return tuple(parameter.path for parameter in self.parameters)

    @property
    def changes(self) -> dict[str, float]:
        """The values by path, as ``override`` takes them."""
        return dict(zip(self.fit, self.values.tolist(), strict=True))

    @property
    def std(self) -> Array:
        """(p,) standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """(p, p) correlations of the values' doubts."""
        std = np.where(self.std > 0, self.std, 1.0)
        return self.covariance / np.outer(std, std)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper ends (p,) of the values."""
        pairs = [(parameter.low, parameter.high) for parameter in self.parameters]
        low, high = np.array(pairs).T
        return low, high

    def part(self, start: str) -> Calibration:
        """Return the calibration of the parameters whose paths begin with ``start``.

        Raises:
            InputError: there is none.
        """
        chosen = [i for i, path in enumerate(self.fit) if path.startswith(start)]
        if not chosen:
            raise InputError(Fault("calibration", f"has no parameter {start}*", self.fit))
        own = [self.parameters[i] for i in chosen]
        covariance = self.covariance[np.ix_(chosen, chosen)]
        return Calibration(own, self.values[chosen], covariance, logs=self.logs)

    def interval(self, level: float = 0.95) -> NDArray[np.float64]:
        """Return lower and upper ends (p, 2) of the intervals that hold the values at a level."""
        from scipy.special import ndtri

        half = float(ndtri((1 + level) / 2)) * self.std
        ends = np.stack([self.values - half, self.values + half], axis=1)
        return np.clip(ends, self.bounds[0][:, None], self.bounds[1][:, None])

    def draw(self, n: int, seed: int = 0) -> Array:
        """Return n sets (n, p) of values by their doubt, within their ranges."""
        points = np.random.default_rng(seed).random((n, len(self.parameters)))
        return draw_within(points, self.values, self.covariance, *self.bounds)

    def save(self, path: str | os.PathLike[str]) -> list[Path]:
        """Write the file of values, and beside it the page that shows the fit.

        Args:
            path: of the file, which ends in ``.toml``; the page ends in ``.html``.

        Returns:
            the paths of both.

        Raises:
            InputError: the path does not end in ``.toml``. OutputError: it cannot be written.
        """
        from omnitrack_sim.calibration.page import page_of

        target = output_place(path)
        page = page_of(self, target.name)
        return write_files(
            {target: self.to_toml().encode(), target.with_suffix(".html"): page.encode()}
        )

    def to_toml(self) -> str:
        """Return the values as a file that ``--set @FILE`` takes, with their doubt."""
        lines = [f"# Calibrated from {', '.join(self.logs)}." if self.logs else "# Calibrated."]
        lines += ["# --set @FILE sets these values; a sweep's axis of kind calibration draws them."]
        for path, value, std in zip(self.fit, self.values, self.std, strict=True):
            lines.append(f"{as_toml(path)} = {as_toml(_rounded(value))}  # +- {std:.3g}")
        lines += ["", f"[{CALIBRATION}]"]
        rows = [list(map(_rounded, row)) for row in self.covariance.tolist()]
        about = {
            "logs": list(self.logs),
            "covariance": rows,
            "indistinct": [
                {"weights": {k: _rounded(v) for k, v in one.weights.items()}, "doubt": one.doubt}
                for one in self.indistinct
            ],
            "contradictions": list(self.contradictions),
            "notes": list(self.notes),
        }
        lines += [f"{key} = {as_toml(value)}" for key, value in about.items()]
        for parameter, std in zip(self.parameters, self.std, strict=True):
            lines += ["", f"[{CALIBRATION}.parameters.{toml_key(parameter.path)}]"]
            lines += [f"{k} = {as_toml(v)}" for k, v in _row(parameter, std).items()]
        for column in self.columns:
            lines += ["", f"[[{CALIBRATION}.columns]]"]
            lines += [f"{k} = {as_toml(v)}" for k, v in _figures(column).items()]
        return "\n".join(lines) + "\n"


def output_place(path: str | os.PathLike[str]) -> Path:
    """Return the path of a calibration's file.

    Raises:
        InputError: it does not end in ``.toml``.
    """
    target = Path(path)
    if target.suffix.lower() != ".toml":
        raise InputError(Fault(str(target), "does not end in .toml, as a file of values does"))
    return target


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _row(parameter: Parameter, std: float) -> dict[str, Any]:
    """What a file says of a parameter."""
    return {
        "provenance": CALIBRATED,
        "std": _rounded(std),
        "unit": parameter.unit,
        "low": _rounded(parameter.low),
        "high": _rounded(parameter.high),
        "start": _rounded(parameter.start),
        "before": parameter.provenance,
        "prior": _rounded(parameter.prior),
    }


def _figures(column: FittedColumn) -> dict[str, Any]:
    """What a file says of a column that was compared."""
    return {
        "log": column.log,
        "column": column.column,
        "unit": column.unit,
        "samples": len(column.time),
        "independent": _rounded(column.independent),
        "rms": _rounded(column.rms),
        "bias": _rounded(column.bias),
        "noise": _rounded(column.noise),
    }


class _ParameterRow(Table):
    provenance: str
    std: Number
    unit: str = ""
    low: Number
    high: Number
    start: Number
    before: Provenance = "unstated"
    prior: Number


class _IndistinctRow(Table):
    weights: dict[str, Number]
    doubt: Number


class _About(Table):
    logs: tuple[str, ...] = ()
    covariance: tuple[tuple[Number, ...], ...]
    indistinct: tuple[_IndistinctRow, ...] = ()
    contradictions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    parameters: Annotated[dict[str, _ParameterRow], Field(min_length=1, max_length=MAX_PARAMETERS)]
    columns: tuple[dict[str, Any], ...] = ()


class _File(Table):
    calibration: _About


def load_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Read a calibration that was saved.

    Raises:
        InputError: there is no such file, or it is none of a calibration; lists every fault.

    Example:
        >>> try:
        ...     ot.load_calibration("mine.toml")
        ... except ot.InputError as error:
        ...     print(error)
        mine.toml: cannot be read: there is no such file
    """
    file = Path(path)
    refuse_missing(file)
    with placed_in(file):
        return _calibration(table_of(file, "calibration", InputError))


def _calibration(data: Mapping[str, Any]) -> Calibration:
    """Return a calibration from the contents of its file."""
    table = {CALIBRATION: data[CALIBRATION]} if CALIBRATION in data else {}
    about = checked(_File, table, InputError).calibration
    paths = [*about.parameters]
    values = [data.get(path) for path in paths]
    faults = [
        Fault(path, "is missing, or no number")
        for path, value in zip(paths, values, strict=True)
        if not isinstance(value, int | float) or isinstance(value, bool)
    ]
    covariance = np.array([[*row] for row in about.covariance], dtype=object)
    if covariance.shape != (len(paths), len(paths)):
        faults.append(Fault(f"{CALIBRATION}.covariance", f"is not {len(paths)} x {len(paths)}"))
    for path, row in about.parameters.items():
        if row.low > row.high:
            faults.append(Fault(f"{CALIBRATION}.parameters.{path}.low", "is over high"))
    if faults:
        raise InputError(faults)
    parameters = [
        Parameter(path, row.start, row.low, row.high, row.unit, row.before, row.prior)
        for path, row in about.parameters.items()
    ]
    return Calibration(
        parameters,
        np.array(values, float),
        covariance.astype(float),
        [Indistinct(one.weights, one.doubt) for one in about.indistinct],
        about.contradictions,
        about.notes,
        logs=about.logs,
    )
