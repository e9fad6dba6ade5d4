"""Reproduction of published statements about a robot: claims, and a folder with a page of them.

Claims of the omnidirectional robot are measured on lists of runs, which figures show as well; those
of other robots each make runs of their own.
"""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.writing import check_folder, whole_folder, write_file
from omnitrack_sim.paper import driving, turns
from omnitrack_sim.paper.claim import Claim, ClaimVerdict, Finding, tally
from omnitrack_sim.paper.claim_figures import (
    along_figure,
    angular_velocity_figure,
    contact_map_figure,
    elbow_figure,
    rates_figure,
)
from omnitrack_sim.paper.experiments import SEED, Runs, run_all, scenarios
from omnitrack_sim.paper.measured import ENTRIES
from omnitrack_sim.paper.region import plot_singularity
from omnitrack_sim.paper.robots import claims_of
from omnitrack_sim.results.provenance import environment, provenance_of
from omnitrack_sim.robots.kinds import DEFAULT, robot_class
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.show.plots.style import attempt, figure_bytes, save_figure
from omnitrack_sim.show.plots.success import success_figure
from omnitrack_sim.sim.simulation import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.results.result import Result


CLAIMS_FILE = "claims.json"
LEDGER = "measured"
"""In place of a robot: measurements of several, beside simulated values."""
CLAIMS: tuple[Claim, ...] = (*driving.CLAIMS, *turns.CLAIMS)
"""Claims of the omnidirectional robot's paper, in the order of the page."""
STRIPS = {
    "tee_turn_misaligned": "Tee turn from the worst orientation: roll, drive, turn, drive",
    "straight_over_aligned": "Straight over a tee, modules on either side",
    "elbow_90_jacobian": "Elbow of 90 mm",
}
"""Lists of runs of which the middle one is shown in stills, with the captions."""
STILLS = 6
TEE_TURNS = {
    "aligned": "aligned, friction 0.8 to 1.0",
    "aligned_real": "the same, motor and walls of Section VI",
    "written": "aligned, as written",
    "written_real": "the same, motor and walls of Section VI",
    "slippery": "aligned, friction 0.6 to 0.8",
    "few_lugs": "5 lugs a track, friction 0.8 to 1.0",
    "few_lugs_slippery": "5 lugs a track, friction 0.6 to 0.8",
    "map_jacobian": "not aligned, feedback, Section VI",
    "map_paper": "not aligned, as written, Section VI",
}
"""Lists of tee turns whose success rates are compared, with their labels."""
DRIVES = {
    "jacobian": "feedback",
    "paper": "as written (Eq. 20)",
    "equal": "equal speeds",
    "differential": "one motor, differential",
}
"""Drives that are compared in elbows, with their labels."""


def reproduce(
    directory: str | Path,
    *,
    robot: str = DEFAULT,
    quick: bool = False,
    format: str = "svg",
    progress: Progress | None = None,
) -> list[Finding]:
    """Measure published statements about a robot, and write a folder with a page of them.

    It holds ``claims.json``, ``report.html`` and, of the omnidirectional one, ``figures/``.

    Args:
        directory: made, or replaced if it holds an earlier reproduction. The claims are there
            first; a figure that cannot be drawn is reported as a warning and left out.
        robot: kind of robot, as ``robot.kind`` of a scenario, or ``LEDGER``.
        quick: fewer orientations and trials.
        format: of the files in ``figures/``: ``svg``, ``pdf`` or ``png``.
        progress: called with the fraction done, 0 to 1, and a word about the run.

    Returns:
        The findings in the order of the page.

    Raises:
        OutputError: ``directory`` holds something else, or cannot be written.
        InputError: there is no such robot, or it has no claims.
    """
    # Before the runs, which take long: a folder that may not be replaced is refused at once.
    check_folder(directory, CLAIMS_FILE)
    standard = robot == DEFAULT
    if standard:
        runs = run_all(scenarios(quick), progress)
        findings, title = measure(runs, quick), TITLE
    else:
        runs, title = {}, "Measurements" if robot == LEDGER else robot
        findings = measure_robot(robot, quick, progress)
    provenance = _provenance(runs, quick)
    rows = {"provenance": provenance, "claims": [finding.row() for finding in findings]}
    # Before anything is drawn: a figure that fails must not cost the claims.
    with whole_folder(directory, CLAIMS_FILE) as folder:
        if standard:
            (folder / "figures").mkdir()
        (folder / CLAIMS_FILE).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    pictures = _draw(runs, Path(directory) / "figures", format) if standard else {}
    missing = ", ".join(name for name, picture in pictures.items() if picture is None)
    remarks = [LEDGER_REMARK if robot == LEDGER else REMARK]
    remarks += [*([DRIVES_REMARK] if standard else []), *([QUICK_REMARK] if quick else [])]
    if missing:
        remarks.append(f"These figures could not be drawn: {missing}.")
    figures = [picture for picture in pictures.values() if picture is not None]
    text = page(findings, figures, provenance, remarks, title)
    write_file(Path(directory) / "report.html", text.encode())
    return findings


def measure(runs: Runs, quick: bool) -> list[Finding]:
    """Measure the claims of the paper on the runs of the quick or of the full form."""
    return [claim(runs, quick) for claim in CLAIMS]


def measure_robot(
    robot: str, quick: bool = False, progress: Progress | None = None
) -> list[Finding]:
    """Measure the claims about a robot other than the omnidirectional one.

    Args:
        robot: its kind, or ``LEDGER``.
        quick: fewer trials.
        progress: called with the fraction done, 0 to 1, and a word about the claim.

    Raises:
        InputError: there is no such robot, or it has no claims.
    """
    claims: Sequence[Claim] = ENTRIES
    if robot != LEDGER:
        with trusting():
            claims = claims_of(robot_class(robot))
    if not claims:
        raise InputError(Fault("ROBOT", f"{robot!r} has no claims: its class has no `claims`"))
    findings: list[Finding] = []
    for i, claim in enumerate(claims):
        if progress is not None:
            progress(i / len(claims), claim.id)
        findings.append(claim(quick, quick))
    return findings


def _draw(runs: Runs, folder: Path, format: str) -> dict[str, ReportFigure | None]:
    """Write the figures into a folder.

    Returns:
        The figures and the stills for the page, by name; None where one cannot be drawn, such as
        stills without OpenGL.
    """

    def draw(name: str) -> ReportFigure:
        caption, make = FIGURES[name]
        figure = make(runs)
        save_figure(figure, folder / f"{name}.{format}")
        # The caption of a failure states how it ended.
        caption = caption.format(*runs.get("slippery_downward", ()))
        return ReportFigure(name, caption, figure_bytes(figure, "svg"), "svg+xml")

    def stills(name: str) -> ReportFigure:
        from omnitrack_sim.show.film.render import render_frames
        from omnitrack_sim.show.film.strip import composed, strip_times

        result, data = runs[name][len(runs[name]) // 2], io.BytesIO()
        times = strip_times(result, STILLS)
        frames = render_frames(result, times=times, width=640, height=360)
        composed(frames, times).save(data, "JPEG", quality=82)
        return ReportFigure(name, STRIPS[name], data.getvalue(), "jpeg")

    figures = {name: attempt(f"figure {name}", lambda n=name: draw(n)) for name in FIGURES}
    strips = {name: attempt(f"stills {name}", lambda n=name: stills(n)) for name in STRIPS}
    return {**figures, **strips}


def _success_map(runs: Runs) -> Figure:
    """Tee turns that pass, over the start orientation."""
    theta5 = np.array([r.scenario.start.theta5_deg for r in runs["map_jacobian"]])
    kinds = ("jacobian", "paper")
    passed = {kind: np.array([r.success for r in runs[f"map_{kind}"]]) for kind in kinds}
    return success_figure(theta5, passed, *TurnCase().singular_range)


def _success_rates(runs: Runs) -> Figure:
    """Tee turns that pass, by group."""
    rates = [
        (label, sum(r.success for r in runs[name]), len(runs[name]))
        for name, label in TEE_TURNS.items()
    ]
    return rates_figure(rates, reference=0.1955)


def _elbows(runs: Runs, radius: int) -> Figure:
    """Elbows of a radius, mm, by drive."""
    return elbow_figure({label: runs[f"elbow_{radius}_{kind}"] for kind, label in DRIVES.items()})


def by_friction(results: Iterable[Result]) -> list[tuple[str, int, int]]:
    """Return label, passed and total by range of friction, each 0.05 wide."""
    step = 0.05
    bins: dict[int, list[bool]] = {}
    for result in results:
        # 1e-9: a friction on a border must not fall below it by rounding.
        bin = int(result.scenario.world.friction / step + 1e-9)
        bins.setdefault(bin, []).append(result.success)
    return [
        (f"friction {step * k:.2f} to {step * (k + 1):.2f}", sum(passed), len(passed))
        for k, passed in sorted(bins.items())
    ]


def preferred(results: Sequence[Result]) -> Result:
    """Return the run that starts nearest to the preferred orientation, theta5 = 0."""
    return min(results, key=lambda result: abs(result.scenario.start.theta5_deg))


FIGURES: dict[str, tuple[str, Callable[[Runs], Figure]]] = {
    "fig9_sector": (
        "Fig. 9: the singular sector.",
        lambda _: plot_singularity(TurnCase(), figure="sector"),
    ),
    "contact_map_geometry": (
        "Contact over orientation and turn in the exact geometry of two pipes; red: a module has "
        "no wall.",
        lambda _: plot_singularity(TurnCase(), figure="map"),
    ),
    "success_map": (
        "Tee turns without alignment over the start orientation, and the singular range of the "
        "formula.",
        _success_map,
    ),
    "success_rates": (
        "Success rates of tee turns with Wilson 95 % intervals; dashed: the paper's 19.55 %.",
        _success_rates,
    ),
    "fig13_as_written": (
        "Fig. 13: shaft speeds with the paper's open-loop speeds.",
        lambda runs: angular_velocity_figure(runs["written"][0]),
    ),
    "fig13_feedback": (
        "The same turn with feedback along the centreline.",
        lambda runs: angular_velocity_figure(runs["tee_turn_misaligned"][0]),
    ),
    "unrolled_contacts": (
        "The unrolled pipe: where the modules touch and how hard, tee turn from the worst "
        "orientation.",
        lambda runs: contact_map_figure(runs["tee_turn_misaligned"][0]),
    ),
    "forces_along_the_way": (
        "Traction, normal force and slip over arc length.",
        lambda runs: along_figure(runs["tee_turn_misaligned"][0]),
    ),
    "fig10_speeds": (
        "Fig. 10(b): shaft speeds through the 90 mm elbow by Eq. 20, open loop, preferred "
        "orientation.",
        lambda runs: angular_velocity_figure(preferred(runs["elbow_90_paper"])),
    ),
    "elbow_240": (
        "Fig. 10: elbow of 240 mm by controller and drive.",
        lambda runs: _elbows(runs, 240),
    ),
    "elbow_90": (
        "Fig. 15: elbow of 90 mm by controller and drive.",
        lambda runs: _elbows(runs, 90),
    ),
    "success_by_friction": (
        "Success of aligned tee turns by friction, with Wilson 95 % intervals.",
        lambda runs: rates_figure(by_friction([*runs["slippery"], *runs["aligned"]])),
    ),
    "slippery_turn": (
        "Downward at friction {0.scenario.world.friction:.2f}, without retry: {0.outcome}, "
        "{0.reason}.",
        lambda runs: along_figure(runs["slippery_downward"][0]),
    ),
}
"""Caption and drawing function of each figure, by name in the order of the page."""
TITLE = "Omnidirectional Tractable Three Module Robot"
REMARK = (
    "Each published statement is turned into something that can be measured in simulation, with a "
    "tolerance. Its verdict follows from the measurement, with the reason as far as it is known "
    "where it does not hold. What nobody has stated is a study, without verdict."
)
LEDGER_REMARK = (
    "Each published measurement stands beside the simulated value: its interval is over draws of "
    "what the publication does not say, and the ratio is ours over theirs. Nothing is judged; "
    "where the interval of the ratio does not hold one, the reason is said as far as it is known."
)
DRIVES_REMARK = (
    "What the robot's reach was inferred from is calibrated. Claims of Section V have a motor "
    "that holds the belts at their speeds, and walls of primitives, on which tracks are rows of "
    "lugs, as in the paper's simulation; those of Section VI have the motor that it names, and "
    "exact walls, on which tracks are smooth lines. Where two numbers are compared, friction, "
    "preload, walls and some degrees of orientation are drawn by lot, and the interval of the "
    "difference decides."
)
QUICK_REMARK = (
    "Quick form: fewer orientations and trials than the full reproduction; intervals are wide, "
    "and where it says so the full form may come to another verdict."
)


def _provenance(runs: Runs, quick: bool) -> dict[str, Any]:
    """Versions, commit, platform, and the amount of simulation."""
    form = "quick" if quick else "full"
    results = [result for group in runs.values() for result in group]
    if not results:
        return {**environment(), "form": form}
    kept = provenance_of(results[0].scenario)
    del kept["scenario_sha256"]
    return {
        **kept,
        "form": form,
        "seed": SEED,
        "runs": len(results),
        "simulated_s": round(sum(result.duration_s for result in results), 1),
    }


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the page.

    Attributes:
        name: of the figure, or of the run whose stills it shows.
        caption: sentence below it.
        data: the picture as a file.
        format: subtype of its media type, "svg+xml" or "jpeg".
    """

    name: str
    caption: str
    data: bytes
    format: str


def page(
    findings: Sequence[Finding],
    figures: Sequence[ReportFigure],
    provenance: Mapping[str, Any],
    remarks: Sequence[str],
    title: str = TITLE,
) -> str:
    """Return the whole page as HTML text.

    Args:
        findings: in the order of the page.
        figures: those that could be drawn.
        provenance: versions, commit, platform, runs.
        remarks: sentences below the title.
        title: name of the robot.
    """
    sentences = [*remarks, *(f"{f.difference}." for f in findings if f.difference)]
    counts = tally(findings).items()
    template = Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    drawn = "\n".join(_figure(figure, findings) for figure in figures)
    return Template(template).substitute(
        title=_text(title),
        remarks="\n".join(f'<p class="lead">{_text(text)}</p>' for text in sentences),
        tally="".join(f"<div><b>{count}</b>{verdict}</div>" for verdict, count in counts),
        verdicts="\n".join(map(_row, findings)),
        figures=f"<h2>Figures</h2>\n{drawn}" if drawn else "",
        claims="\n".join(map(_article, findings)),
        provenance="\n".join(
            f"<tr><th>{_text(key)}</th><td>{_text(value)}</td></tr>"
            for key, value in provenance.items()
        ),
    )


def _text(value: Any) -> str:
    return html.escape(str(value))


def _chip(finding: Finding) -> str:
    return f'<span class="chip {finding.verdict.name.lower()}">{finding.label}</span>'


def _row(finding: Finding) -> str:
    """Return a finding in the table of verdicts."""
    claim, measured = finding.claim, _text(finding.measurement.measured)
    beside = [text for text in (finding.driven, finding.reason) if text]
    small = "".join(f"<br><small>{_text(text)}</small>" for text in beside)
    return (
        f'<tr><td>{_chip(finding)}</td><td><a href="#{_text(claim.id)}">{_text(claim.paper)}</a>'
        f"<br><small>{_text(claim.source)}</small></td><td>{measured}{small}</td></tr>"
    )


def _article(finding: Finding) -> str:
    """Return a finding with all of its fields."""
    question = "asked" if finding.verdict is ClaimVerdict.STUDY else "true if"
    claim, measurement = finding.claim, finding.measurement
    rows = (
        ("source", claim.source),
        ("paper", claim.paper),
        (question, claim.text),
        ("driven by", finding.driven),
        ("measured", measurement.measured),
        ("how sure", measurement.uncertainty),
        ("expected", claim.expected),
        ("how", claim.how),
        ("why", finding.reason),
        ("beside it", claim.note),
    )
    entries = "".join(f"<dt>{name}</dt><dd>{_text(value)}</dd>" for name, value in rows if value)
    name = _text(claim.id)
    return f'<article id="{name}"><h3>{_chip(finding)}{name}</h3><dl>{entries}</dl></article>'


def _figure(figure: ReportFigure, findings: Sequence[Finding]) -> str:
    """Return a figure, with the verdicts of the claims that it shows."""
    source = f"data:image/{figure.format};base64,{base64.b64encode(figure.data).decode()}"
    caption = _text(figure.caption)
    shown = "".join(
        f'<br>{_chip(finding)}<a href="#{_text(finding.claim.id)}">{_text(finding.claim.id)}</a>'
        for finding in findings
        if figure.name in finding.claim.figures
    )
    return (
        f'<figure><img src="{source}" alt="{caption}">'
        f"<figcaption>{caption}{shown}</figcaption></figure>"
    )
