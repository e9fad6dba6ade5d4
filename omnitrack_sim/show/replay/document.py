"""A run, or two of them, as one HTML document that plays them without a network."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped, counted, finite, printable
from omnitrack_sim.base.writing import check_file, format_of, write_file
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.results.comparison import compare as compare_results
from omnitrack_sim.results.comparison import value_row
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.show.landmarks import Landmarks, passage_spans
from omnitrack_sim.show.playback import playback_of, sound
from omnitrack_sim.show.projection import needs_map
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.replay import contents

FORMATS = ("html",)
SAME_POSE = 1e-6
"""Difference of positions, m, and of rotation matrices, within which two parts lie alike."""
MOST_DIFFERENCES = 60
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
    result: Result | Recording | str | os.PathLike[str],
    *,
    path: str | Path | None = None,
    compare: Result | str | os.PathLike[str] | None = None,
) -> ReplayPage:
    """Render a run or a recording as a page that plays it in a browser: one file, without network.

    Args:
        result: the run, the folder of a saved one, or a recording of any model.
        path: ``.html`` file to write; none: nothing is written, and a notebook shows the page.
        compare: a second run through the same pipes, shown as a translucent robot and as paler
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
    page = ReplayPage(_document(_data_of(result, compare)))
    if path is not None:
        write_file(Path(path), page.html.encode("utf-8"))
    return page


def _data_of(
    result: Result | Recording | str | os.PathLike[str],
    compare: Result | str | os.PathLike[str] | None,
) -> dict[str, Any]:
    """Return the data of the page that ``render_replay`` is asked for."""
    if isinstance(result, Recording):
        if compare is not None:
            raise InputError(Fault("compare", "is for runs; a recording is shown alone"))
        return result.replay_data()
    runs = [as_result(result)]
    if compare is not None:
        runs.append(as_result(compare))
        if problem := pipes_mismatch(*runs):
            hint = "ot.compare(a, b) compares figures and scenarios of any two runs"
            raise InputError(Fault("compare", f"{problem}; {hint}"))
    return replay_data(runs)


def pipes_mismatch(one: Result, other: Result) -> str:
    """Say in words how the pipes of a second run differ from those of the first; empty where they
    are the same, with the same ports closed."""
    problem = _part_mismatch(one, other)
    if not problem and one.scenario.plates != other.scenario.plates:
        problem = "other ports are closed by plates"
    return f"it drove through other pipes than the first run: {problem}" if problem else ""


def _part_mismatch(one: Result, other: Result) -> str:
    first, second = (run.pipes.parts for run in (one, other))
    if len(first) != len(second):
        return f"it has {counted(len(second), 'fitting')}, and the first run {len(first)}"
    for a, b in zip(first, second, strict=True):
        moved = np.abs(a.pose.position - b.pose.position).max() > SAME_POSE
        turned = np.abs(a.pose.rotation - b.pose.rotation).max() > SAME_POSE
        if a.fitting != b.fitting or moved or turned:
            return f"{clipped(b.name, 60)} is not {clipped(a.name, 60)} of the first run"
    return ""


def replay_data(runs: list[Result]) -> dict[str, Any]:
    """Collect the data of the page of one or two runs, of which the first one brings the pipes."""
    first, pack, display = runs[0], contents.Pack(), runs[0].scenario.robot.display
    trajectory, schema = sound(first), first.trajectory.schema
    with np.errstate(invalid="ignore", over="ignore"):  # of physics that has diverged
        pages = [_page_run(run) for run in runs]
        data = contents.page_data(pages, pack)
    landmarks = Landmarks.of(first, trajectory) if needs_map(first) else None
    return data | {
        "map": None
        if landmarks is None
        else contents.map_table(pages[0].playback, landmarks, pack),
        "pictures": contents.pictures_table(first.album, trajectory),
        "panels": [
            {"channel": name, "first": name in display.first_plots, **asdict(schema[name].display)}
            for name in contents.plotted(first.trajectory, display.plots)
        ],
        "columns": [
            [name, [round(255 * part) for part in colour]] for name, colour in display.columns
        ],
        "state": display.state,
        "headline": {name: _title(_metrics(first)[name]) for name in display.headline},
        "differences": differences(*runs) if len(runs) > 1 else [],
        "data": pack.text(),
    }


def _page_run(result: Result) -> contents.PageRun:
    """Collect the contents of a page for one run, including its robot."""
    trajectory, robot = sound(result), result.scenario.robot
    playback, display = playback_of(result, coarse=False), robot.display
    bodies = [playback.model.body(name).id for name in display.badges]
    badges = contents.body_poses(playback, bodies)
    return contents.PageRun(
        heading=heading_table(result),
        playback=playback,
        curves=contents.curves_of(trajectory, display.plots, display.page_channels),
        phases=contents.phases_table(trajectory),
        fittings=contents.fittings_table(
            passage_spans(result, trajectory),
            playback,
            trajectory["leg"] if len(result.routes()) > 1 else None,
        ),
        events=contents.events_table(result),
        arrows=display.arrows(trajectory, list(np.moveaxis(badges, 1, 0))),
        onboard=display.page_camera,
        scale=robot.length_scale,
        badges=display.badges,
        tracks=display.tracks,
        travel=display.travel(trajectory),
        pitch=display.track_pitch,
    )


def heading_table(result: Result) -> dict[str, Any]:
    """Name, outcome, metrics and versions of a run."""
    provenance = result.provenance
    versions: Mapping[str, Any] = provenance.get("versions") or {}
    keys = ("seed", "scenario_sha256", "git_commit", "platform")
    return finite(
        {
            "name": result.scenario.name,
            "outcome": result.outcome.value.replace("_", " "),
            "success": result.success,
            "advice": result.scenario.robot.advice(result.outcome),
            "reason": result.reason,
            "duration": result.duration_s,
            "figures": _figure_rows(result),
            "provenance": [
                *([name, str(version)] for name, version in versions.items() if version),
                *(
                    [key.replace("_", " "), str(provenance[key])]
                    for key in keys
                    if provenance.get(key) is not None
                ),
            ],
        }
    )


def _figure_rows(result: Result) -> list[dict[str, Any]]:
    """The metrics of a run in the order of its file, with a row for each entry of a table."""
    known, rows = _metrics(result), []
    for name, value in result.metrics.items():
        metric = known.get(name)
        words = {"unit": "", "meaning": "a metric of the user's own"}
        if metric is not None:
            words = {"unit": metric.unit, "meaning": metric.meaning.replace("`", "")}
        entries = value if isinstance(value, dict) else {"": value}
        for entry, one in entries.items():
            rows.append({"name": f"{name} {entry}".strip(), "value": one, **words})
    return rows


def _metrics(result: Result) -> dict[str, Metric]:
    """Return the metrics of a run's robot by name."""
    return {metric.name: metric for metric in result.scenario.robot.metrics}


def _title(metric: Metric) -> str:
    """Return the title of a metric, with the modules where it has a value for each."""
    return metric.title + (", modules 1, 2, 3" if metric.per_module else "")


def differences(one: Result, other: Result) -> list[list[str]]:
    """Rows of dotted path, unit and both values, as text, where the scenarios of two runs differ
    but for names."""
    rows = [
        list(value_row(value))
        for value in compare_results(one, other).values
        if value.name.rpartition(".")[2] != "name"
    ]
    rest = len(rows) - MOST_DIFFERENCES
    return [*rows[:MOST_DIFFERENCES], [f"and {rest} more", "", "", ""]] if rest > 0 else rows


def _document(data: dict[str, Any]) -> str:
    """Put markup, style, scripts and data together. The same data give the same text."""
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
