"""What notebooks show: results by themselves, and the tutorial as it is stored."""

from __future__ import annotations

import copy
import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path

import nbformat
import numpy as np
import pytest
from samples import sample_result, sample_trajectory, two_legs_result

from omnitrack_sim.record.events import Outcome, Remark
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.html import sketch
from omnitrack_sim.scenario import validate

pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[1] / "docs" / "tutorials"
PICTURES = {"tutorial": 4, "learn-in-5-minutes": 1, "your-robot-in-10-minutes": 2}
"""Notebooks, and how many pictures each shows at least."""
SHORTER = {
    "tutorial": {
        'load_scenario("tee_turn")': 'load_scenario("tee_turn", {"run.time_limit": 1.0})',
        "samples = 6": "samples = 1",
        "[0.3, 0.4, 0.5, 0.6, 0.8]": "[0.3, 0.8]",
        "[set]": '[set]\n"run.time_limit" = 0.5',
        'load_scenario("elbow")': 'load_scenario("elbow", {"run.time_limit": 1.0})',
    },
    "learn-in-5-minutes": {
        "num_envs=48": "num_envs=16",
        '"control.kind": "policy",': '"run.time_limit": 0.5, "control.kind": "policy",',
        'load_scenario("straight"))': 'load_scenario("straight", {"run.time_limit": 0.5}))',
        "for generation in range(10):": "for generation in (0, 1):",
        '"run.time_limit": 3.0': '"run.time_limit": 0.3',
    },
    "your-robot-in-10-minutes": {
        "while data.time < 8.0:": "while data.time < 0.5:",
        "for _ in range(8):": "for _ in range(2):",
        "start.distance = 0.15": "start.distance = 0.15\nrun.time_limit = 0.5",
    },
}
"""What the test runs less of: it passes through the same code."""
SVG = "{http://www.w3.org/2000/svg}"


def kinds(notebook) -> list[list[object]]:
    """What each cell of code shows: streams by name, values by the kinds they have."""
    return [
        [sorted(one.data) if "data" in one else (one.output_type, one.get("name")) for one in shown]
        for shown in (cell.outputs for cell in notebook.cells if cell.cell_type == "code")
    ]


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_runs_and_shows_what_is_stored(name, tmp_path):
    """Every cell ends without an error and shows things of the kinds that stand in the file."""
    if name == "learn-in-5-minutes":
        pytest.importorskip("gymnasium")
    stored = nbformat.read(DOCS / f"{name}.ipynb", as_version=4)
    nbformat.validate(stored)
    shorter = copy.deepcopy(stored)
    for longer, short in SHORTER[name].items():
        assert sum(longer in cell.source for cell in shorter.cells) == 1, longer
        for cell in shorter.cells:
            cell.source = cell.source.replace(longer, short)
    nbformat.write(shorter, tmp_path / "shorter.ipynb")
    run = runpy.run_path(str(DOCS / "tutorial.py"))["executed"]
    assert kinds(run(tmp_path / "shorter.ipynb", tmp_path)) == kinds(stored)
    shown = sum("image/png" in kind for cell in kinds(stored) for kind in cell)
    assert shown >= PICTURES[name]


@pytest.mark.parametrize("name", PICTURES)
def test_links_of_a_notebook_lead_somewhere(name):
    """To files of the documentation, and to headings that are there."""
    cells = nbformat.read(DOCS / f"{name}.ipynb", as_version=4).cells
    links = re.findall(r"\]\(([^)]+)\)", "\n".join(cell.source for cell in cells))
    assert len(links) > 5
    for file, _, heading in (link.partition("#") for link in links):
        text = (DOCS / file).read_text(encoding="utf-8")
        heads = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
        assert not heading or heading in [head.lower().replace(" ", "-") for head in heads]


def test_a_result_shows_outcome_figures_picture_and_events():
    """With units; of three modules all three numbers."""
    result = sample_result()
    html = result._repr_html_()
    assert "reached goal</b> after 4.00 s" in html
    assert "1.00 s, a remark" in html
    torque = " / ".join(f"{value:.3f}" for value in result.metrics["motor_torque_max_nm"])
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", html)
    place = cells.index("largest motor torque")
    assert cells[place : place + 3] == ["largest motor torque", "N m", torque]
    assert html.count("<svg") == 1
    assert "stuck</b>" in sample_result(outcome=Outcome.STUCK)._repr_html_()


def test_names_and_events_are_text():
    """What users have named is no markup, and no control characters reach the page."""
    part = "<script>alert(1)</script>\x1b"
    pipes = [{"kind": "straight", "name": part, "length": 1.0}]
    events = [Remark(0, 1.0, f"before {part}")] + [Remark(0, 2.0, "more")] * 20
    scenario = validate({"name": "a", "pipes": pipes})
    html = sample_result(scenario=scenario, reason=part, events=events)._repr_html_()
    assert "<script>" not in html
    assert "\x1b" not in html
    assert html.count("&lt;script&gt;") == 2
    assert "and 9 more events" in html


@pytest.mark.parametrize("samples", [1, 2, 201])
def test_any_run_can_be_shown(samples):
    """One that ended at once, and one that ends in what is not a number."""
    full = sample_trajectory()
    channels = {name: np.array(values[:samples], float) for name, values in full.channels.items()}
    channels["tilt"][-1] = np.inf
    channels["normal_force"][:] = np.nan
    channels["phase"] = full["phase"][:samples]
    short = Trajectory(full.time[:samples], channels, full.phases, full.qpos[:samples], full.schema)
    metrics = dict(sample_result().metrics) | {"energy_j": None}
    drawn = ET.fromstring(sketch(short))
    assert len(drawn.findall(f"{SVG}polyline")) == 5
    assert "nan" not in sketch(short)
    html = sample_result(short, metrics=metrics, outcome=Outcome.DIVERGED)._repr_html_()
    assert "diverged</b>" in html


def test_the_picture_holds_the_record():
    """Its lines go through the recorded values from the first to the last, phases behind them."""
    trajectory = sample_trajectory()
    drawn = ET.fromstring(sketch(trajectory))
    lines = [
        np.array([point.split(",") for point in line.attrib["points"].split()], float)
        for line in drawn.findall(f"{SVG}polyline")
    ]
    assert len(lines) == 5  # distance, tilt, three normal forces
    distance, tilt = lines[:2]
    assert len(distance) == 201
    rise = np.interp(trajectory["distance"], *np.array([[0.1, 0.5], distance[[0, -1], 1]]))
    np.testing.assert_allclose(distance[:, 1], rise, atol=0.06)  # a tenth of a pixel is written
    assert int(tilt[:, 1].argmin()) == int(trajectory["tilt"].argmax())
    assert len(drawn.findall(f"{SVG}rect")) == 3 * len(trajectory.phase_spans())


def test_a_long_record_is_thinned_to_what_can_be_seen():
    """Of 100,000 samples the least and the largest of each pixel stay: a single peak too."""
    tilt = np.zeros(100_000)
    tilt[51_234] = 1.0
    long = sketch(sample_trajectory(100_000, 2000.0, tilt=tilt))
    assert len(long) < 60_000
    line = ET.fromstring(long).findall(f"{SVG}polyline")[1].attrib["points"].split()
    heights = np.array([point.split(",")[1] for point in line], float)
    assert np.ptp(heights) == pytest.approx(44.0)
    assert len(sketch(two_legs_result().trajectory)) < 60_000
