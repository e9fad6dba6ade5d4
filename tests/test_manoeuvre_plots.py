"""Figures of manoeuvres show the recorded values, the formula's numbers and the right names."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex, to_rgb, to_rgba
from samples import sample_result, sample_trajectory

from omnitrack_sim.paper.claim_figures import PHASES as SHADED
from omnitrack_sim.paper.claim_figures import (
    along_figure,
    angular_velocity_figure,
    contact_map_figure,
    elbow_figure,
    inner_module,
    rates_figure,
)
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.plots.style import save_figure
from omnitrack_sim.show.plots.success import FAILED_COLOUR, PASSED_COLOUR, success_figure

PHASES = ("cruise", "align", "elbow", "tee_turn", "tee_straight")
SECTOR, MARGIN = 96.54, (120 - 96.54) / 2


def _result(theta5=0.0, codes=(0, 1, 3, 0), **changes):
    """The sample run with the phases of ``codes``, a quarter of it each, at a constant theta5
    [rad]."""
    full = sample_trajectory(**changes)
    quarter = np.minimum(4 * np.arange(len(full.time)) // len(full.time), 3)
    channels = dict(full.channels) | {
        "phase": np.array(codes)[quarter],
        "theta5": np.full(len(full.time), theta5),
    }
    return sample_result(Trajectory(full.time, channels, PHASES, full.qpos, full.schema))


def _elbow_runs(thetas, **changes):
    pipes = [
        {"kind": "straight", "length": 0.3},
        {"kind": "elbow"},
        {"kind": "straight", "length": 0.4},
    ]
    scenarios = [
        validate({"name": "e", "pipes": pipes, "start": {"theta5_deg": float(t)}}) for t in thetas
    ]
    return [sample_result(scenario=scenario, **changes) for scenario in scenarios]


def _success(**changes):
    theta5 = np.arange(-60.0, 60.0, 5.0)
    given = {
        "theta5_deg": theta5,
        "passed": {"a": np.abs(theta5) < 22, "b": theta5 > 100},
        "sector_deg": SECTOR,
    }
    return success_figure(**(given | changes))


def _legend(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def _spans(axis, label):
    """(start, end) of the shades with this label."""
    found = [p for p in axis.patches if p.get_label() == label]
    return [(p.get_x(), p.get_x() + p.get_width()) for p in found]


DRAWN = {
    "angular_velocity": lambda: angular_velocity_figure(_result()),
    "contact_map": lambda: contact_map_figure(_result()),
    "along": lambda: along_figure(_result()),
    "success": _success,
    "elbow": lambda: elbow_figure({"a": _elbow_runs((0, 30)), "b": _elbow_runs((0, 30))}),
    "rates": lambda: rates_figure([("a", 9, 10), ("b", 0, 0)], 0.5),
}


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_is_written(tmp_path, name):
    """Every figure draws without a warning."""
    path = tmp_path / "figure.png"
    save_figure(DRAWN[name](), path)
    assert path.stat().st_size > 5_000


@pytest.mark.parametrize("name", DRAWN)
def test_every_axis_has_a_unit(name):
    """Every axis that carries numbers has its unit in brackets."""
    figure = DRAWN[name]()
    for axis in figure.axes:
        named = [axis.get_xlabel()] if axis.get_xlabel() or name in ("success", "rates") else []
        named += [] if name in ("success", "rates") else [axis.get_ylabel()]
        assert named
        assert all("[" in label and "]" in label for label in named)


def test_import_leaves_matplotlib_out():
    """Importing the module does not import matplotlib."""
    code = "import sys, omnitrack_sim.paper.claim_figures; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_angular_velocity_is_belt_speed_over_lug_radius():
    """Measured solid and commanded dashed lines hold belt speed over lug radius, in the modules'
    colours."""
    command = np.full((201, 3), 0.05)
    result = _result(belt_speed_command=command)
    radius = result.scenario.robot.lug_radius
    axis = angular_velocity_figure(result).axes[0]
    lines = {line.get_label(): line for line in axis.lines}
    for i, side in enumerate(("inner", "outer", "outer")):
        solid, dashed = lines[f"module {i + 1}, {side}"], lines[f"module {i + 1}, commanded"]
        assert to_rgb(solid.get_color()) == MODULE_COLOURS[i] == to_rgb(dashed.get_color())
        assert (solid.get_linestyle(), dashed.get_linestyle()) == ("-", "--")
        np.testing.assert_allclose(
            solid.get_ydata(), result.trajectory["belt_speed"][:, i] / radius
        )
        np.testing.assert_allclose(dashed.get_ydata(), 0.05 / radius)


def test_second_panel_is_the_roll():
    """The lower panel holds the module roll in deg."""
    roll = np.linspace(0, 1, 201)[:, None] * np.array([1.0, 2.0, 3.0])
    axis = angular_velocity_figure(_result(roll=roll)).axes[1]
    drawn = [line.get_ydata() for line in axis.lines if line.get_linestyle() == "-"]
    np.testing.assert_allclose(np.stack(drawn, axis=-1), np.degrees(roll))


def test_align_is_yellow_and_the_turn_green():
    """The phases are shaded over their times and named as in the paper."""
    result = _result()
    figure = angular_velocity_figure(result)
    spans = {name: (start, end) for name, start, end in result.trajectory.phase_spans()}
    for axis in figure.axes:
        assert _spans(axis, "holonomic motion") == [pytest.approx(spans["align"])]
        assert _spans(axis, "turn") == [pytest.approx(spans["tee_turn"])]
    faces = {p.get_label(): to_hex(p.get_facecolor()) for p in figure.axes[0].patches}
    assert faces == {name: colour for colour, name in (SHADED["align"], SHADED["tee_turn"])}
    assert _legend(figure)[-2:] == ["holonomic motion", "turn"]


@pytest.mark.parametrize(
    ("theta5_deg", "inner"), [(0, 0), (-110, 1), (130, 2), (-230, 2), (50, 0), (70, 2)]
)
def test_inner_module_points_into_the_turn(theta5_deg, inner):
    """The module nearest to the turning direction at the start of the turn is called inner, the
    others outer."""
    result = _result(np.radians(theta5_deg))
    assert inner_module(result.trajectory) == inner
    names = [f"module {i + 1}, {'inner' if i == inner else 'outer'}" for i in range(3)]
    assert _legend(angular_velocity_figure(result))[:3] == names


def test_inner_module_is_judged_when_the_turn_begins():
    """What theta5 was before the turn does not matter."""
    result = _result()
    theta5 = result.trajectory["theta5"]
    theta5[result.trajectory["phase"] != 3] = np.radians(-120)
    assert inner_module(result.trajectory) == 0


def test_no_turn_no_inner_module():
    """Without an elbow or a tee turn the modules have their numbers only."""
    assert inner_module(_result(codes=(0, 1, 2, 0)).trajectory) == 0
    result = _result(codes=(0, 1, 1, 0))
    assert inner_module(result.trajectory) is None
    assert _legend(along_figure(result))[:3] == ["module 1", "module 2", "module 3"]


def test_along_holds_the_channels():
    """Traction and normal force as recorded and slip in mm/s, all over the arc length."""
    result = _result()
    names = ("traction", 1.0), ("normal_force", 1.0), ("slip_velocity", 1e3)
    for axis, (name, scale) in zip(along_figure(result).axes, names, strict=True):
        np.testing.assert_allclose(
            np.stack([li.get_ydata() for li in axis.lines], -1), result.trajectory[name] * scale
        )
        for line in axis.lines:
            np.testing.assert_array_equal(line.get_xdata(), result.trajectory["distance"])


def test_along_shades_arc_length():
    """The shade of a phase spans the arc length driven in it; standing still leaves a narrow
    strip."""
    result = _result()
    distance = result.trajectory["distance"]
    ((low, high),) = _spans(along_figure(result).axes[0], "turn")
    inside = distance[result.trajectory["phase"] == 3]
    assert (low, high) == pytest.approx((inside[0], inside[-1]), abs=0.003)
    aligning = np.flatnonzero(result.trajectory["phase"] == 1)
    distance[aligning[0] : aligning[-1] + 2] = 0.2
    ((low, high),) = _spans(along_figure(result).axes[0], "holonomic motion")
    assert 0 < high - low < 0.01


def test_contact_map_places_the_modules():
    """Marks lie at the arc length and at theta5 plus the module's angle, coloured by normal
    force."""
    result = _result(np.radians(100))
    axis = contact_map_figure(result).axes[0]
    points = next(c for c in axis.collections if c.get_array() is not None)
    where = np.asarray(points.get_offsets())
    assert sorted(set(np.round(where[:, 1], 6))) == [-140, -20, 100]
    np.testing.assert_allclose(where[::3, 0], result.trajectory["distance"])
    np.testing.assert_allclose(points.get_array(), result.trajectory["normal_force"].ravel())
    assert axis.figure.axes[1].get_ylabel() == "normal force [N]"


def test_contact_map_marks_lost_contact():
    """Where the normal force is below 0.5 N, or not a number, there is a hollow grey mark and no
    coloured one."""
    force = np.full((201, 3), 20.0)
    force[:10, 1], force[10:13, 2] = 0.49, np.nan
    axis = contact_map_figure(_result(normal_force=force)).axes[0]
    ring, mark = (c for c in axis.collections if isinstance(c, PathCollection))
    assert (len(ring.get_offsets()), len(mark.get_offsets())) == (13, 603 - 13)
    assert to_rgba(ring.get_facecolor()[0]) == to_rgba("white")


def test_contact_map_shades_fittings_only():
    """Elbow and tee are shaded, the roll before them is not."""
    figure = contact_map_figure(_result(codes=(1, 2, 3, 4)))
    assert _legend(figure)[1:] == ["elbow", "turn", "tee, straight on"]
    assert {p.get_label() for p in figure.axes[0].patches} == {"turn", "elbow", "tee, straight on"}


def test_contact_map_names_the_route_fittings():
    """The ends of the elbow of the route are marked, with the elbow's name."""
    (run,) = _elbow_runs((0,))
    route = run.scenario.route
    axis = contact_map_figure(run).axes[0]
    elbow = route.passages[1]
    lines = [line.get_xdata()[0] for line in axis.lines]
    assert lines == pytest.approx([elbow.s_bend_start, elbow.s_bend_end])
    assert route.network.parts[1].name in [text.get_text() for text in axis.texts]


def test_singular_band_begins_at_the_margin():
    """The formula's range reaches from +-(120 - sector) / 2 to +-60 deg."""
    bands = _spans(_success().axes[0], "singular by the formula")
    assert bands == [pytest.approx((-60, -MARGIN)), pytest.approx((MARGIN, 60))]


@pytest.mark.parametrize(("sector", "bands"), [(0, []), (120, [(-60, 60)]), (150, [(-60, 60)])])
def test_band_of_extreme_sectors(sector, bands):
    """No sector, no band; one as wide as the period leaves nothing safe."""
    assert _spans(_success(sector_deg=sector).axes[0], "singular by the formula") == bands


def test_ring_band_is_as_wide_as_the_sector():
    """Around the circle the formula's range comes three times, each as wide as the sector."""
    ring = _success().axes[1]
    assert [np.degrees(p.get_width()) for p in ring.patches] == pytest.approx([SECTOR] * 3)
    assert [np.degrees(p.get_x() + p.get_width() / 2) for p in ring.patches] == pytest.approx(
        [60, 180, 300]
    )


def test_real_margin_is_dashed():
    """Two dashed lines stand at the margin of the real geometry."""
    axis = _success(real_margin_deg=23.4).axes[0]
    lines = [line for line in axis.lines if line.get_label() == "real geometry"]
    assert [line.get_xdata()[0] for line in lines] == [-23.4, 23.4]
    assert {line.get_linestyle() for line in lines} == {"--"}


def test_success_rows_are_named_and_rated():
    """Each row has its name at the left and its success rate in per cent at the right."""
    axis = _success().axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["a", "b"]
    assert [text.get_text() for text in axis.texts] == ["37.5 %", "0.0 %", "passed"]


def test_success_cells_have_the_outcome_at_their_orientation():
    """A cell lies about its orientation and is blue where the run passed, orange where it
    failed."""
    figure = _success(theta5_deg=[10, 110, 0], passed={"a": [True, True, False]})
    mesh = figure.axes[0].collections[1]
    assert mesh.get_array().ravel().tolist() == [1, 0, 1]
    assert list(mesh.get_coordinates()[0, :, 0]) == pytest.approx([-15, -5, 5, 15])
    colours = [to_hex(mesh.cmap(mesh.norm(value))) for value in (1, 0)]
    assert colours == [PASSED_COLOUR, FAILED_COLOUR]


def test_repeated_orientations_share_a_cell():
    """Several runs of one orientation give one cell with their success rate."""
    figure = _success(theta5_deg=[0, 0, 0, 0, 10], passed={"a": [1, 0, 1, 1, 0]})
    assert figure.axes[0].collections[1].get_array().ravel().tolist() == [0.75, 0]
    assert "some passed" in _legend(figure)


def test_cells_close_the_circle():
    """Evenly spaced orientations leave no gap where the period begins anew."""
    left, middle, _ = (
        mesh.get_coordinates()[0, :, 0] for mesh in _success().axes[0].collections[:3]
    )
    assert left[-1] == pytest.approx(middle[0]) == pytest.approx(-62.5)
    assert middle[-1] == pytest.approx(57.5)


def test_unequal_rows_are_refused():
    """An outcome is needed for every orientation."""
    with pytest.raises(ValueError, match="not two rows of one length"):
        _success(passed={"a": [True]})


def test_elbow_panels_hold_the_metrics():
    """The lines hold exit and largest tilt, mean slip distance in mm and duration, in the order of
    theta5."""
    metrics = {"tilt_exit_deg": 1.5, "tilt_max_deg": 7.0, "slip_distance_m": [0.001, 0.002, 0.006]}
    figure = elbow_figure({"a": _elbow_runs((40, -20), metrics=metrics, duration_s=9.0)})
    for axis, value in zip(figure.axes, (1.5, 7.0, 3.0, 9.0), strict=True):
        assert list(axis.lines[0].get_xdata()) == [-20, 40]
        assert axis.lines[0].get_ydata() == pytest.approx([value, value])


def test_failed_runs_are_hollow():
    """A run that passed has a filled mark, one that failed a white one."""
    runs = _elbow_runs((0,)) + _elbow_runs((30,), outcome=Outcome.NO_MOTION_LINE)
    for axis in elbow_figure({"a": runs}).axes:
        filled, hollow = axis.collections[0].get_facecolor()
        assert to_rgba(hollow) == to_rgba("white") != to_rgba(filled)


@pytest.mark.parametrize(
    ("passed", "total", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (5, 10, 0.2366, 0.7634),
        (0, 0, 0.0, 1.0),
        (94, 96, 0.9272, 0.9943),
    ],
)
def test_wilson_interval(passed, total, low, high):
    """Known intervals, also where nothing or everything passed."""
    assert wilson_interval(passed, total) == pytest.approx((low, high), abs=5e-5)


def test_rates_have_bars_whiskers_and_counts():
    """Bars are the rates in per cent, whiskers Wilson's interval, and the counts stand beside
    them."""
    axis = rates_figure([("a", 5, 10), ("b", 0, 10)], reference=0.1955).axes[0]
    assert [bar.get_width() for bar in axis.patches] == [50, 0]
    assert list(axis.lines[0].get_xdata()) == pytest.approx([23.66, 76.34], abs=0.005)
    assert axis.texts[0].get_text() == "50.0 %  (5 of 10)"
    (line,) = [line for line in axis.lines if line.get_label() == "reference"]
    assert (line.get_xdata()[0], axis.texts[-1].get_text()) == (19.55, "reference 19.55 %")


@pytest.mark.parametrize("figure", [angular_velocity_figure, along_figure, contact_map_figure])
@pytest.mark.parametrize("samples", [1, 2])
def test_shortest_runs_can_be_drawn(tmp_path, figure, samples):
    """A run that ended at once, and one whose record is not a number, still give a figure."""
    full = _result().trajectory
    channels = {name: values[:samples] for name, values in full.channels.items()}
    channels["normal_force"] = np.full((samples, 3), np.nan)
    short = Trajectory(full.time[:samples], channels, full.phases, full.qpos[:samples], full.schema)
    save_figure(figure(sample_result(short)), tmp_path / "short.png")
    assert (tmp_path / "short.png").stat().st_size > 5_000
