"""A run, or two of them, as one HTML document that plays them without a network."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.bounds import MAX_PAGE_NUMBERS
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped, counted, printable
from omnitrack_sim.base.writing import check_file, format_of, write_file
from omnitrack_sim.pipes import Part
from omnitrack_sim.results.comparison import compare as compare_results
from omnitrack_sim.results.comparison import value_row
from omnitrack_sim.results.result import Result
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.replay import contents
from omnitrack_sim.show.sources import Source, playback_of

FORMATS = ("html",)
SAME_POSE = 1e-6
"""Difference of positions, m, and of rotation matrices, within which two parts lie alike."""
MAX_DIFFERENCES = 60
"""Differences of two scenarios that are listed; of further ones only the number."""
LIBRARY = Path(__file__).parent / "vendor" / "three"
"""three.js as its package on npm has it (README.md in it names the release)."""
SCRIPTS = (
    "unpack",
    "motion",
    "stage",
    "cameras",
    "arrows",
    "plots",
    "strip",
    "chart",
    "pictures",
    "words",
    "main",
)
"""The page's own scripts; each imports others as ``replay/NAME``."""


@dataclass(frozen=True, repr=False)
class ReplayPage:
    """A page that plays a run in a browser; notebooks show it.

    Attributes:
        html: the whole page.
        height: of the frame in a notebook, pixels.

    Example:
        >>> import omnitrack_sim as ot
        >>> ot.ReplayPage(html="<p>a run</p>", height=480)
        ReplayPage(12 characters)
    """

    html: str
    height: int = 640

    def __repr__(self) -> str:
        return f"ReplayPage({len(self.html)} characters)"

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self.height}px;border:1px solid #ccc"
        source = html.escape(self.html)
        return f'<iframe srcdoc="{source}" style="{style}" allowfullscreen></iframe>'


def render_replay(
    source: Source,
    *,
    path: str | Path | None = None,
    compare: Source | None = None,
) -> ReplayPage:
    """Render a run or a recording as a page that plays it in a browser: one file, without network.

    Args:
        source: the run, the folder of a saved one, or a recording of any model.
        path: ``.html`` file to write; none: nothing is written, and a notebook shows the page.
        compare: a second one through the same pipes, shown as a translucent robot and as paler
            curves.

    Raises:
        InputError: another ending, or a second run through other pipes.
        RenderError: a run has no pose that can be shown.
        OutputError: a folder is no run, or the file cannot be written.

    Example:
        >>> import omnitrack_sim as ot
        >>> short = {"run.time_limit": 0.1}
        >>> result = ot.run(ot.override(ot.load_scenario("straight"), short))
        >>> page = ot.render_replay(result)
        >>> page.html.startswith("<!doctype html>")
        True
    """
    if path is not None:
        format_of(path, None, "page", FORMATS)
        check_file(Path(path))
    playbacks = [playback_of(source, coarse=False)]
    if compare is not None:
        playbacks.append(playback_of(compare, coarse=False))
        if problem := pipes_mismatch(*playbacks):
            hint = "ot.compare(a, b) compares figures and scenarios of any two runs"
            raise InputError(Fault("compare", f"{problem}; {hint}"))
    _refuse_large(playbacks)
    page = ReplayPage(_document(replay_data(*playbacks)))
    if path is not None:
        write_file(Path(path), page.html.encode("utf-8"))
    return page


def _refuse_large(playbacks: Sequence[Playback]) -> None:
    """Raise an ``InputError`` for runs of which a page would be too large for a browser."""
    numbers = sum(7 * len(one.time) * one.model.nbody for one in playbacks)
    if numbers > MAX_PAGE_NUMBERS:
        samples = " and ".join(str(len(one.time)) for one in playbacks)
        problem = f"of {samples} samples is too large: {numbers:.3g} numbers of poses"
        hint = f"at most {MAX_PAGE_NUMBERS:.3g}; a longer record.period makes fewer samples"
        raise InputError(Fault("page", f"{problem}, {hint}"))


def pipes_mismatch(one: Playback, other: Playback) -> str:
    """Return in words how the pipes of a second run differ from those of the first; "" if alike."""
    problem = _part_mismatch(one.network.parts, other.network.parts)
    if not problem and tuple(one.plates) != tuple(other.plates):
        problem = "other ports are closed by plates"
    return f"it drove through other pipes than the first run: {problem}" if problem else ""


def _part_mismatch(first: Sequence[Part], second: Sequence[Part]) -> str:
    """Return how parts differ in number, kind, size or place; "" if alike."""
    if len(first) != len(second):
        return f"it has {counted(len(second), 'fitting')}, and the first run {len(first)}"
    for a, b in zip(first, second, strict=True):
        if a.fitting != b.fitting:
            one, other = (part.fitting.to_table() for part in (a, b))
            keys = [key for key in {**one, **other} if one.get(key) != other.get(key)]
            differ = (f"{key} is {other.get(key)}, not {one.get(key)}" for key in keys)
            return f"of {clipped(b.name, 60)} {'; '.join(differ) or 'the shape is another'}"
        moved = np.abs(a.pose.position - b.pose.position).max() > SAME_POSE
        turned = np.abs(a.pose.rotation - b.pose.rotation).max() > SAME_POSE
        if moved or turned:
            place = "lies elsewhere" if moved else "lies in another direction"
            return f"{clipped(b.name, 60)} {place} (start.axis, start.turn_deg, place, joints)"
    return ""


def replay_data(*playbacks: Playback) -> dict[str, Any]:
    """Return the data of the page of one or two playbacks, of which the first brings the pipes."""
    first, pack = playbacks[0], contents.Pack()
    with np.errstate(invalid="ignore", over="ignore"):  # of physics that has diverged
        data = contents.scene_data(playbacks, pack)
    runs = [playback.result for playback in playbacks if playback.result is not None]
    return data | {
        "map": contents.map_table(first, pack),
        "pictures": contents.pictures_table(first),
        "panels": [contents.panel_table(first, name) for name in first.plots],
        "columns": [
            [name, [round(255 * part) for part in colour]] for name, colour in first.columns
        ],
        "legends": contents.legends_table(first),
        "state": first.state,
        "headline": first.headline,
        "differences": differences(*runs) if len(runs) > 1 else [],
        "data": pack.text(),
    }


def differences(one: Result, other: Result) -> list[list[str]]:
    """Return rows of path, unit and both values where two scenarios differ but for names."""
    rows = [
        list(value_row(value))
        for value in compare_results(one, other).values
        if value.name.rpartition(".")[2] != "name"
    ]
    rest = len(rows) - MAX_DIFFERENCES
    return [*rows[:MAX_DIFFERENCES], [f"and {rest} more", "", "", ""]] if rest > 0 else rows


def _document(data: dict[str, Any]) -> str:
    """Return markup, style, scripts and data as one text, the same of the same data."""
    folder = LIBRARY.parents[1] / "page"
    library = {
        "three-core": LIBRARY / "three.core.min.js",
        "three": LIBRARY / "three.module.min.js",
        "orbit-controls": LIBRARY / "OrbitControls.js",
    }
    scripts = library | {f"replay/{name}": folder / f"{name}.js" for name in SCRIPTS}
    # No text in the data can end the script element that holds it, or begin a comment.
    table = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    fields = {
        "TITLE": html.escape(printable(f"{data['runs'][0]['heading']['name']}, replay")),
        "STYLE": _text(folder / "style.css"),
        "DATA": table,
        "LICENCE": html.escape(_text(LIBRARY / "LICENSE"), quote=False),
        "SCRIPTS": "\n".join(
            f'<script type="text/plain" data-module="{name}">{_text(path)}</script>'
            for name, path in scripts.items()
        ),
    }
    document = _text(folder / "replay.html")
    for field, text in fields.items():
        before, mark, after = document.partition(f"<!--{field}-->")
        assert mark, field
        document = before + text + after
    return document


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
