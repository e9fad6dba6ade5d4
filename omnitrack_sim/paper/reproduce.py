"""Reproduction of the paper: all runs, all claims, and one folder with a page of them."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.writing import check_folder, whole_folder, write_file
from omnitrack_sim.paper import driving, elbows, tees
from omnitrack_sim.paper import formulas as theory
from omnitrack_sim.paper.claim import Claim, ClaimVerdict, FigureName, tally
from omnitrack_sim.paper.experiments import SEED, Runs, run_all, scenarios
from omnitrack_sim.paper.plots.groups import elbow_figure, rates_figure
from omnitrack_sim.paper.plots.over_time import (
    along_figure,
    angular_velocity_figure,
    contact_map_figure,
)
from omnitrack_sim.paper.plots.region import plot_singularity
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.show.plots.style import attempt, save_figure
from omnitrack_sim.show.plots.success_figure import success_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.results.result import Result


CLAIMS_FILE, FIGURES = "claims.json", "figures"
MEASURES: tuple[Callable[[Runs], Claim | list[Claim]], ...] = (
    theory.mean_speed,
    theory.unequal_arms,
    theory.jacobian,
    theory.region,
    driving.climb,
    driving.holonomic,
    driving.sign_change,
    driving.past_180,
    driving.no_motion_line,
    driving.preload,
    driving.motors,
    elbows.eq20,
    elbows.straight_exit,
    elbows.short_elbow,
    elbows.preferred,
    tees.compression,
    tees.as_written,
    tees.inner_slip,
    tees.unaligned,
    tees.towards_worst,
    tees.falls_into_place,
    tees.aligned,
    tees.slippery,
    tees.few_lugs,
    tees.climb_then_turn,
    tees.straight_over,
    elbows.differential,
)
"""Functions that measure the claims, in the order of the page."""
STRIPS = {
    "paper/tee_turn_misaligned": (
        "tee_turn_misaligned",
        "Tee turn from the worst orientation: roll, drive, turn, drive",
    ),
    "paper/straight_over_tee_aligned": (
        "straight_over_aligned",
        "Straight over a tee, modules on either side",
    ),
    "elbow_short": ("elbow_90_jacobian", "Elbow of 90 mm"),
}
FRAMES = 6
_Figures: TypeAlias = "dict[FigureName, tuple[str, Callable[[], Figure]]]"
TEE_TURNS = {
    "aligned": "aligned, friction 0.8 to 1.0",
    "slippery": "aligned, friction 0.6 to 0.8",
    "few_lugs": "5 lugs a track, friction 0.8 to 1.0",
    "few_lugs_slippery": "5 lugs a track, friction 0.6 to 0.8",
    "map_jacobian": "not aligned, feedback",
    "map_paper": "not aligned, as written",
}
"""Lists of tee turns whose success rates are compared, with their labels."""


def reproduce(
    directory: str | Path,
    *,
    quick: bool = False,
    format: str = "svg",
    progress: Callable[[float, str], None] | None = None,
) -> list[Claim]:
    """Run the paper and write ``claims.json``, ``report.html`` and ``figures/`` into ``directory``.

    Args:
        directory: made, or replaced if it holds an earlier reproduction. The claims are there
            first; a figure that cannot be drawn is told as a warning and left out.
        quick: fewer orientations and trials.
        format: of the files in ``figures/``: ``svg``, ``pdf`` or ``png``.
        progress: called with the fraction done, 0 to 1, and a word about the run.

    Returns:
        The claims in the order of the page.

    Raises:
        OutputError: ``directory`` holds something else, or cannot be written.
    """
    # Before the runs, which take long: a folder that may not be replaced is refused at once.
    check_folder(directory, CLAIMS_FILE)
    lists = scenarios(quick)
    runs = run_all(lists, progress)
    claims = measure(runs, quick)
    provenance = _provenance(runs, quick)
    rows = {"provenance": provenance, "claims": [claim.row() for claim in claims]}
    # Before anything is drawn: a figure that fails must not cost the claims.
    with whole_folder(directory, CLAIMS_FILE) as folder:
        (folder / FIGURES).mkdir()
        (folder / CLAIMS_FILE).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    pictures, missing = _draw(figures(runs), Path(directory) / FIGURES, format)
    strips, remarks = _strips(runs)
    text = page(claims, pictures, strips, provenance, [*_lead(quick), *missing, *remarks])
    write_file(Path(directory) / "report.html", text.encode())
    return claims


def _draw(figures: _Figures, folder: Path, format: str) -> tuple[list[ReportFigure], list[str]]:
    """Write the figures into a folder; those that can be drawn, for the page, and a sentence about
    the others."""

    def draw(name: str, caption: str, make: Callable[[], Figure]) -> ReportFigure:
        figure = make()
        save_figure(figure, folder / f"{name}.{format}")
        return ReportFigure(name, caption, _file(figure), "svg")

    made = {
        name: attempt(f"figure {name}", partial(draw, name, caption, make))
        for name, (caption, make) in figures.items()
    }
    missing = ", ".join(name for name, picture in made.items() if picture is None)
    sentences = [f"These figures could not be drawn: {missing}."] if missing else []
    return [picture for picture in made.values() if picture is not None], sentences


def measure(runs: Runs, quick: bool) -> list[Claim]:
    """All claims, from the runs of the quick or of the full form."""
    claims: list[Claim] = []
    for function in MEASURES:
        claim = function(runs)
        claims.extend(claim if isinstance(claim, list) else [claim])
    return [replace(claim, quick=quick) for claim in claims]


def figures(runs: Runs) -> _Figures:
    """Caption, and what draws the figure, by file name, in the order of the page."""
    return (
        _region_figures()
        | _success_figures(runs)
        | _turn_figures(runs)
        | _elbow_figures(runs)
        | _friction_figures(runs)
    )


def _region_figures() -> _Figures:
    """The singular region in closed form and in the exact geometry."""
    case = TurnCase()
    return {
        "fig9_sector": (
            "Fig. 9: the singular sector.",
            partial(plot_singularity, case, figure="sector"),
        ),
        "contact_map_geometry": (
            "Contact over orientation and turn in the exact geometry of two pipes; red: a module "
            "has no wall.",
            partial(plot_singularity, case, figure="map"),
        ),
    }


def _success_figures(runs: Runs) -> _Figures:
    """Tee turns that pass, over the start orientation and in groups."""
    case = TurnCase()
    theta5 = np.array([r.scenario.start.theta5_deg for r in runs["map_jacobian"]])
    passed = {
        kind: np.array([r.success for r in runs[f"map_{kind}"]]) for kind in ("jacobian", "paper")
    }
    # Safe on either side in the exact geometry, as ``safe_margin`` is by the formula.
    margin = float(np.degrees((2 * np.pi / 3 - case.real_sector) / 2))
    groups = [
        (label, sum(r.success for r in runs[name]), len(runs[name]))
        for name, label in TEE_TURNS.items()
    ]
    return {
        "success_map": (
            "Tee turns without alignment over the start orientation, and the singular range of the "
            "formula.",
            partial(
                success_figure,
                theta5,
                passed,
                float(np.degrees(case.sector)),
                real_margin_deg=margin,
            ),
        ),
        "success_rates": (
            "Success rates of tee turns with Wilson 95 % intervals; dashed: the paper's 19.55 %.",
            partial(rates_figure, groups, reference=0.1955),
        ),
    }


def _turn_figures(runs: Runs) -> _Figures:
    """Single tee turns, as written and with feedback."""
    misaligned, written = runs["tee_turn_misaligned"][0], runs["tee_turn_as_written"][0]
    return {
        "fig13_as_written": (
            "Fig. 13: shaft speeds with the paper's open-loop speeds.",
            partial(angular_velocity_figure, written),
        ),
        "fig13_feedback": (
            "The same turn with feedback along the centreline.",
            partial(angular_velocity_figure, misaligned),
        ),
        "unrolled_contacts": (
            "The unrolled pipe: where the modules touch and how hard, tee turn from the worst "
            "orientation.",
            partial(contact_map_figure, misaligned, misaligned.scenario.route),
        ),
        "forces_along_the_way": (
            "Traction, normal force and slip over arc length.",
            partial(along_figure, misaligned),
        ),
    }


def _elbow_figures(runs: Runs) -> _Figures:
    """Elbows by controller and drive."""
    return {
        "fig10_speeds": (
            "Fig. 10(b): shaft speeds through the 90 mm elbow by Eq. 20, open loop, preferred "
            "orientation.",
            partial(angular_velocity_figure, _at(runs["elbow_90_paper"], 0.0)),
        ),
        "elbow_240": (
            "Fig. 10: elbow of 240 mm by controller and drive.",
            partial(elbow_figure, _elbows(runs, "240")),
        ),
        "elbow_90": (
            "Fig. 15: elbow of 90 mm by controller and drive.",
            partial(elbow_figure, _elbows(runs, "90")),
        ),
    }


def _friction_figures(runs: Runs) -> _Figures:
    """Tee turns with alignment over friction."""
    slippery = runs["slippery_downward"][0]
    friction = slippery.scenario.world.friction
    return {
        "success_by_friction": (
            "Success of aligned tee turns by friction, with Wilson 95 % intervals.",
            partial(rates_figure, _by_friction([*runs["slippery"], *runs["aligned"]])),
        ),
        "slippery_turn": (
            f"Downward at friction {friction:.2f}, without retry: {slippery.outcome.value}, "
            f"{slippery.reason}.",
            partial(along_figure, slippery),
        ),
    }


def _at(results: Sequence[Result], theta5_deg: float) -> Result:
    """The run that starts nearest to an orientation."""
    return min(results, key=lambda r: abs(r.scenario.start.theta5_deg - theta5_deg))


def _by_friction(results: Sequence[Result], step: float = 0.05) -> list[tuple[str, int, int]]:
    """Label, passed and total by range of friction."""
    bins: dict[int, list[bool]] = {}
    for result in results:
        # 1e-9: a friction on a border must not fall below it by rounding.
        bins.setdefault(int(result.scenario.world.friction / step + 1e-9), []).append(
            result.success
        )
    return [
        (f"friction {step * k:.2f} to {step * (k + 1):.2f}", sum(passed), len(passed))
        for k, passed in sorted(bins.items())
    ]


def _elbows(runs: Runs, radius: str) -> dict[str, Sequence[Any]]:
    labels = {
        "jacobian": "feedback",
        "paper": "as written (Eq. 20)",
        "equal": "equal speeds",
        "differential": "one motor, differential",
    }
    return {label: runs[f"elbow_{radius}_{kind}"] for kind, label in labels.items()}


def _file(figure: Figure) -> bytes:
    import io

    buffer = io.BytesIO()
    save_figure(figure, buffer, "svg")
    return buffer.getvalue()


def _strips(runs: Runs) -> tuple[list[FrameStrip], list[str]]:
    """Frames of a few runs; where they cannot be made, as without OpenGL, a sentence that says
    so."""
    from omnitrack_sim.show.film.render import render_frames, strip_times

    strips = []
    try:
        for name, title in STRIPS.values():
            result = runs[name][len(runs[name]) // 2]
            times = strip_times(result, FRAMES)
            strips.append(
                FrameStrip(title, render_frames(result, times=times, width=640, height=360), times)
            )
    except Exception as error:  # as of ``attempt``
        return [], [f"No frames: {error}"]
    return strips, []


def _lead(quick: bool) -> list[str]:
    text = (
        "Each statement of the paper is turned into something that can be measured in simulation, "
        "with a tolerance. Its verdict follows from the measurement, with the reason as far as it "
        "is known where it does not hold. What is no statement of the paper is a study, without "
        "verdict."
    )
    short = (
        "Quick form: fewer orientations and trials than the full reproduction; intervals are wide, "
        "and where it says so the full form may come to another verdict."
    )
    return [text, short] if quick else [text]


def _provenance(runs: Runs, quick: bool) -> dict[str, Any]:
    first = next(iter(runs.values()))[0]
    made = {
        k: v
        for k, v in provenance_of(first.scenario).items()
        if k not in ("scenario_sha256", "seed")
    }
    return {
        **made,
        "form": "quick" if quick else "full",
        "seed": SEED,
        "runs": sum(len(group) for group in runs.values()),
        "simulated_s": round(sum(r.duration_s for group in runs.values() for r in group), 1),
    }


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the page: ``data`` is an SVG or PNG file."""

    name: str
    caption: str
    data: bytes
    format: str


@dataclass(frozen=True)
class FrameStrip:
    """Frames of one run in order, (height, width, 3) uint8 each, with their times in s."""

    title: str
    frames: Sequence[NDArray]
    times: Sequence[float]


_CSS = """
:root { color-scheme: light dark; --ink: #22262b; --soft: #6a7079; --line: #dde1e6;
  --page: #ffffff; --card: #f6f7f9;
  --holds: #1b7a4d; --contradiction: #8a6100; --fails: #b5382f; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --soft: #9aa1ab; --line: #363b43;
  --page: #16181c;
  --card: #1f2228; --holds: #58c48f; --contradiction: #d9ae4a; --fails: #ec8077; } }
body { margin: 0 auto; max-width: 68rem; padding: 2.5rem 1.5rem 5rem; background: var(--page);
  color: var(--ink);
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; } h2 { margin: 3rem 0 .8rem; font-size: 1.3rem; }
p.lead { color: var(--soft); margin: 0 0 1.5rem; max-width: 48rem; }
.tally { display: flex; gap: 1rem; flex-wrap: wrap; } .tally div { background: var(--card);
  padding: .7rem 1.2rem;
  border-radius: .5rem; } .tally b { font-size: 1.5rem; display: block; line-height: 1.2; }
table { border-collapse: collapse; width: 100%; font-size: .92rem; } td, th { text-align: left;
  vertical-align: top;
  padding: .45rem .7rem .45rem 0; border-bottom: 1px solid var(--line); } th { color: var(--soft);
  font-weight: 500; }
.scroll { overflow-x: auto; }
article { border-top: 1px solid var(--line); padding: 1rem 0; } article h3 { margin: 0 0 .4rem;
  font-size: 1.02rem; }
dl { display: grid; grid-template-columns: 7.5rem 1fr; gap: .15rem 1rem; margin: 0;
  font-size: .94rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }
.chip { font-size: .8rem; font-weight: 600; padding: .1rem .55rem; border-radius: 1rem;
  border: 1px solid currentColor; white-space: nowrap;
  margin-right: .6rem; } .holds { color: var(--holds); } .fails { color: var(--fails); }
.contradiction { color: var(--contradiction); } .study { color: var(--soft); }
figure { margin: 1.5rem 0; } figure img { max-width: 100%; height: auto; background: #fff;
  border-radius: .4rem; } figcaption { color: var(--soft); font-size: .9rem; margin-top: .4rem; }
.strip { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: .6rem; }
.strip figure { margin: 0; } .strip img { width: 100%; } code { font-size: .9em; }
  a { color: inherit; }
"""


def page(
    claims: Sequence[Claim],
    pictures: Sequence[ReportFigure],
    strips: Sequence[FrameStrip],
    provenance: Mapping[str, Any],
    remarks: Sequence[str],
) -> str:
    """The whole page as HTML text.

    Args:
        claims: in the order of the page.
        pictures: figures.
        strips: frames of runs; none where nothing could be rendered.
        provenance: versions, commit, platform, runs.
        remarks: sentences below the title.
    """
    sentences = [*remarks, *(f"{c.difference}." for c in claims if c.difference)]
    head = "".join(f'<p class="lead">{_text(r)}</p>' for r in sentences)
    counts = "".join(f"<div><b>{n}</b>{verdict}</div>" for verdict, n in tally(claims).items())
    body = [
        "<h1>Omnidirectional Tractable Three Module Robot, reproduced</h1>",
        head,
        f'<div class="tally">{counts}</div>',
        "<h2>Verdicts</h2>",
        _table(claims),
        "<h2>Figures</h2>",
        *(_figure(p, [c for c in claims if p.name in c.figures]) for p in pictures),
        *(["<h2>Frames</h2>", *(_strip(s) for s in strips)] if strips else []),
        "<h2>Claims</h2>",
        *(_article(c) for c in claims),
        "<h2>Provenance</h2>",
        '<div class="scroll"><table>',
        *(f"<tr><th>{_text(k)}</th><td>{_text(v)}</td></tr>" for k, v in provenance.items()),
        "</table></div>",
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Three module robot, reproduced</title><style>{_CSS}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _text(value: Any) -> str:
    return html.escape(str(value))


def _chip(claim: Claim) -> str:
    return f'<span class="chip {claim.verdict.name.lower()}">{claim.told}</span>'


def _table(claims: Sequence[Claim]) -> str:
    rows = "".join(
        f'<tr><td>{_chip(c)}</td><td><a href="#{_text(c.id)}">{_text(c.paper)}</a><br>'
        f"<small>{_text(c.source)}</small></td><td>{_text(c.measured)}{_small(c.reason)}</td></tr>"
        for c in claims
    )
    head = "<tr><th></th><th>paper</th><th>measured</th></tr>"
    return f'<div class="scroll"><table>{head}{rows}</table></div>'


def _small(text: str) -> str:
    return f"<br><small>{_text(text)}</small>" if text else ""


def _article(claim: Claim) -> str:
    question = "asked" if claim.verdict is ClaimVerdict.STUDY else "true if"
    rows = (
        ("source", claim.source),
        ("paper", claim.paper),
        (question, claim.statement),
        ("measured", claim.measured),
        ("how sure", claim.uncertainty),
        ("expected", claim.expected),
        ("how", claim.how),
        ("why", claim.reason),
        ("beside it", claim.note),
    )
    entries = "".join(f"<dt>{name}</dt><dd>{_text(value)}</dd>" for name, value in rows if value)
    name = _text(claim.id)
    return f'<article id="{name}"><h3>{_chip(claim)}{name}</h3><dl>{entries}</dl></article>'


def _figure(picture: ReportFigure, claims: Sequence[Claim]) -> str:
    """A figure, with the verdicts of the claims that it shows."""
    kind = "svg+xml" if picture.format == "svg" else picture.format
    source = f"data:image/{kind};base64,{base64.b64encode(picture.data).decode()}"
    caption = _text(picture.caption)
    shown = "".join(f'<br>{_chip(c)}<a href="#{_text(c.id)}">{_text(c.id)}</a>' for c in claims)
    return (
        f'<figure><img src="{source}" alt="{caption}">'
        f"<figcaption>{caption}{shown}</figcaption></figure>"
    )


def _strip(strip: FrameStrip) -> str:
    from omnitrack_sim.show.film.render import label

    frames = "".join(
        f'<figure><img src="data:image/jpeg;base64,{_jpeg(frame)}" '
        f'alt="{_text(strip.title)} at {time:.1f} s">'
        f"<figcaption>{label(index)} {time:.1f} s</figcaption></figure>"
        for index, (frame, time) in enumerate(zip(strip.frames, strip.times, strict=True))
    )
    return f'<h3>{_text(strip.title)}</h3><div class="strip">{frames}</div>'


def _jpeg(frame: NDArray) -> str:
    import imageio.v3 as imageio

    data = imageio.imwrite("<bytes>", frame, plugin="pillow", extension=".jpg", quality=82)
    assert data is not None  # it is for files only
    return base64.b64encode(data).decode()
