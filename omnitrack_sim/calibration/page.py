"""Page of a calibration: measured against fitted, residuals, doubt, and what is contradicted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import printable
from omnitrack_sim.calibration.calibration import Calibration, FittedColumn
from omnitrack_sim.results.html import line, safe, table_html, text

_WIDTH, _LEFT, _HEIGHT, _LOW = 720, 96, 150, 70  # pixels
_MEASURED, _FITTED = "#9aa1ab", "#c2410c"
_STYLE = (
    "body{font-family:sans-serif;color:#22262b;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .8em .2em 0}"
    "li{margin:.3em 0}h2{margin-top:1.6em}p.key{color:#7a7f87}"
)


def page_of(fit: Calibration, file: str) -> str:
    """Return the page of a calibration whose values are in ``file``."""
    parts = [
        f"<h1>Calibration {safe(file)}</h1>",
        f"<p>From {safe(', '.join(fit.logs))}.</p>",
        f"<p><code>--set @{safe(file)}</code> sets the values.</p>",
        table_html(("parameter", "value", "std", "of the value", "before", "range"), _rows(fit)),
        *_list("What the logs contradict", fit.contradictions),
        *_list("What the logs leave open", [one.text for one in fit.indistinct]),
        *_list("Notes", fit.notes),
        "<h2>Correlation of the doubts</h2>",
        table_html(("", *fit.fit), _correlations(fit)),
        *_columns(fit.columns),
    ]
    title = f"<title>Calibration {safe(file)}</title>"
    head = f'<meta charset="utf-8">{title}<style>{_STYLE}</style>'
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n{body}\n</body></html>\n'


def _rows(fit: Calibration) -> Iterator[tuple[str, ...]]:
    for parameter, value, std in zip(fit.parameters, fit.values, fit.std, strict=True):
        unit = f" {parameter.unit}" if parameter.unit not in ("", "1") else ""
        part = f"{100 * std / abs(value):.2g} %" if value else ""
        before = f"{parameter.start:.6g} ({parameter.provenance})"
        within = f"{parameter.low:.4g} to {parameter.high:.4g}"
        yield parameter.path, f"{value:.6g}{unit}", f"{std:.2g}{unit}", part, before, within


def _correlations(fit: Calibration) -> Iterator[tuple[str, ...]]:
    for path, row in zip(fit.fit, fit.correlation, strict=True):
        yield path, *(f"{value:.2f}" for value in row)


def _list(title: str, texts: Sequence[str]) -> list[str]:
    """Return a heading and a list; nothing where there is nothing to tell."""
    if not texts:
        return []
    items = "".join(f"<li>{escape(printable(one))}</li>" for one in texts)
    return [f"<h2>{title}</h2>", f"<ul>{items}</ul>"]


def _columns(columns: Sequence[FittedColumn]) -> Iterator[str]:
    """Yield the parts of a page for each log and column."""
    if columns:
        yield "<h2>Measured and fitted</h2>"
        yield "<p class=key>Grey: measured; orange: fitted; below: measured less fitted.</p>"
    for column in columns:
        yield f"<h3>{safe(column.log)}: {safe(column.column)}</h3>"
        yield (
            f"<p>residual {column.rms:.3g} {safe(column.unit)} rms, mean {column.bias:.3g}; noise "
            f"from sample to sample {column.noise:.3g}; {len(column.time)} samples, worth "
            f"{column.independent:.3g} independent ones</p>"
        )
        yield _chart(column)


def _chart(column: FittedColumn) -> str:
    """Measured and fitted values over time, and their difference below."""
    both = [(column.measured, _MEASURED), (column.fitted, _FITTED)]
    upper = _panel(column.time, both, 8, _HEIGHT)
    lower = _panel(column.time, [(column.residual, _MEASURED)], _HEIGHT + 24, _LOW)
    height = _HEIGHT + _LOW + 48
    first, last = (f"{time:.4g} s" for time in (column.time[0], column.time[-1]))
    axis = text(_LEFT, height - 8, first) + text(_WIDTH - 8, height - 8, last, "end")
    size = f'width="{_WIDTH}" height="{height}" font-family="sans-serif" font-size="11"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{upper}{lower}{axis}</svg>'


def _panel(time: Array, series: Sequence[tuple[Array, str]], top: float, height: float) -> str:
    """Lines of some colours over the same time, with their range at the left."""
    low = min(float(np.min(values)) for values, _ in series)
    high = max(float(np.max(values)) for values, _ in series)
    span = float(time[-1] - time[0]) or 1.0
    x = _LEFT + (_WIDTH - _LEFT - 8) * (time - time[0]) / span
    lines = [
        line(x, top + height * (1 - (values - low) / max(high - low, 1e-12)), colour)
        for values, colour in series
    ]
    ends = text(_LEFT - 6, top + 10, f"{high:.4g}", "end")
    ends += text(_LEFT - 6, top + height, f"{low:.4g}", "end")
    return "".join([ends, *lines])
