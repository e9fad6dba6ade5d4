"""Figures of the motion singularity region show the numbers of their case."""

from functools import cache

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.paper.region import FIGURES, SECTOR_COLOUR, plot_singularity
from omnitrack_sim.robots.omnitrack.singularity import TurnCase

CASE = TurnCase()


@cache
def _axes(name):
    return plot_singularity(CASE, figure=name).axes


def test_sections_are_the_ellipses_of_the_cuts():
    """From the circle to the mitre ellipse, and the circle of the reach."""
    _, shapes = _axes("sections")
    widths = [np.abs(line.get_xdata()).max() for line in shapes.lines]
    assert widths[0] == pytest.approx(80)
    assert widths[-2] == pytest.approx(80 * np.sqrt(2))
    assert widths[-1] == pytest.approx(96.1)


def test_cuts_go_through_the_crotch():
    """Every cut starts at the crotch and ends on the outer wall of the run."""
    cut, _ = _axes("sections")
    cuts = [line for line in cut.lines if line.get_linewidth() == 2 and len(line.get_xdata()) == 2][
        1:
    ]
    assert len(cuts) == 4
    for line in cuts:
        assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx((80, -80))
        assert line.get_xdata()[1] == pytest.approx(-80)


def test_only_the_worst_orientation_misses_the_wall():
    """The labels say so."""
    worst, best = _axes("orientations")
    assert "short of the wall" in worst.get_xlabel()
    assert best.get_xlabel() == "theta5 = 0°: all modules touch"


def test_sector_is_drawn_as_wide_as_it_is():
    """The shaded patch spans the sector's angle about the outer direction."""
    (axis,) = _axes("sector")
    shade = next(p for p in axis.patches if to_rgb(p.get_facecolor()[:3]) == to_rgb(SECTOR_COLOUR))
    rim = np.array([v for v in shade.get_xy() if np.hypot(*v) > 1])
    span = 2 * np.abs(np.angle(-rim[:, 0] - 1j * rim[:, 1])).max()
    assert span == pytest.approx(CASE.sector)
    assert "±11.73° of theta5 safe, failure rate 80.45 %" in axis.get_xlabel()


def test_definitions_cross_at_the_reach():
    """The curve of the definition passes through the marked point."""
    (axis,) = _axes("definitions")
    lines = {line.get_label(): line for line in axis.lines}
    assert {"ellipse", "crotch", "strip", "real, L = 0 mm", "real, L = 90 mm"} <= set(lines)
    ellipse = lines["ellipse"]
    at = np.interp(96.1, ellipse.get_xdata(), ellipse.get_ydata())
    assert at == pytest.approx(np.degrees(CASE.sector), abs=0.01)


def test_map_holds_the_contact_of_the_real_geometry():
    """Where the map is positive a module has lost the wall; the zero line ends near the margin."""
    axis = _axes("map")[0]
    values = axis.collections[0].get_array().reshape(181, 241)
    touching = CASE.wall_distance(CASE.path(181), CASE.orientations(241)) <= CASE.reach
    assert ((values <= 0).all(axis=0) == touching.all(axis=(0, 2))).all()


ODD = [
    TurnCase(reach=0.079),
    TurnCase(reach=0.12, modules=4, turn_angle=1.0),
    TurnCase(modules=1, contact_length=0.0, bend_radius=0.12),
]


@pytest.mark.parametrize("case", ODD)
def test_any_case_can_be_drawn(case):
    """No contact at all, no sector, another tee, one module; "all" has the panels of each."""
    panels = sum(len(_axes(name)) for name in FIGURES)
    assert len(plot_singularity(case, figure="all").axes) == panels


def test_same_case_same_bytes(tmp_path, monkeypatch):
    """In every format, and at any time of day."""
    for ending in ("png", "svg", "pdf"):
        paths = [tmp_path / f"{letter}.{ending}" for letter in "ab"]
        for day, path in enumerate(paths):
            # What matplotlib takes for the time where it writes one.
            monkeypatch.setenv("SOURCE_DATE_EPOCH", str(86400 * day))
            plot_singularity(CASE, path=path, figure="sector")
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_unknown_figures_are_refused(tmp_path):
    """With the names there are, before anything is written."""
    with pytest.raises(InputError, match="all, sections, orientations"):
        plot_singularity(CASE, path=tmp_path / "a.png", figure="pie")
    with pytest.raises(InputError, match="png, svg, pdf"):
        plot_singularity(CASE, path=tmp_path / "a.bmp", figure="sector")
    assert list(tmp_path.iterdir()) == []
