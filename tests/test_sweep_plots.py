"""The figure of a sweep shows the rates of the table, in the form that fits the axes."""

import re
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.show.plots.success import (
    SINGULAR_COLOUR,
    THETA5,
    Spread,
    bench_figure,
    success_figure,
    sweep_figure,
)
from omnitrack_sim.trials.run import Status, TrialsResult
from omnitrack_sim.trials.sweep_figure import CLASSES, draw_map, singular_range, spreads
from omnitrack_sim.trials.sweep_file import load_sweep, resolve

RNG = np.random.default_rng(0)
N = 400
PRELOAD = Spread("robot.preload", "N", RNG.uniform(5, 40, N))
FRICTION = Spread("world.friction", "1", RNG.uniform(0.3, 1.2, N))
KIND = Spread("control.kind", "", ["a", "b"] * (N // 2), ("a", "b"), compared=True)
WORD = replace(KIND, compared=False)
ORIENTATION = Spread(THETA5, "deg", np.linspace(-60, 59, N))
SINGULAR = TurnCase().singular_range
PASSED = (np.asarray(PRELOAD.values, float) > 20).astype(float)
FORMS = {
    "orientation": [ORIENTATION],
    "orientation by word": [ORIENTATION, KIND],
    "map": [PRELOAD, FRICTION],
    "maps by word": [PRELOAD, FRICTION, KIND],
    "effects": [FRICTION, PRELOAD, WORD],
    "effects by word": [FRICTION, PRELOAD, ORIENTATION, KIND],
    "one word": [KIND],
}


@pytest.mark.parametrize(
    ("form", "left_out"),
    [
        *((form, "some") for form in FORMS),
        *((form, "none") for form in ("map", "effects")),
        *((form, "all") for form in ("orientation", "maps by word", "effects by word")),
    ],
)
def test_every_form_is_drawn_and_repeats(form, left_out):
    """Each form draws without a warning, with trials that have no outcome too, and twice the same
    bytes."""
    passed = np.where(
        {"none": PASSED < 0, "some": PASSED > 0, "all": PASSED >= 0}[left_out], np.nan, PASSED
    )
    times = 2 if left_out == "some" else 1
    files = [figure_bytes(sweep_figure(FORMS[form], passed, SINGULAR)) for _ in range(times)]
    assert files[0] == files[-1]
    assert len(files[0]) > 5_000


@pytest.mark.parametrize(("failed", "lowest"), [(1, True), (N // 2, False)])
def test_rates_near_one_are_seen_apart(failed, lowest):
    """Where nearly all have passed the scale begins little below the lowest interval, at a whole
    5 %; otherwise at 0. No interval is cut."""
    passed = (np.arange(N) >= failed).astype(float)
    for panel in sweep_figure(FORMS["effects"], passed, SINGULAR).axes[:3]:
        low, high = panel.get_ylim()
        assert (low > 50) == lowest
        assert high > 100
        ends = np.concatenate([line.get_segments() for line in panel.collections])[..., 1]
        assert ends.min() >= low


def test_orientations_have_the_sector_of_the_case_behind_them():
    """The singular range is that of the robot; without a tee there is none."""

    def shades(case):
        axis = sweep_figure([ORIENTATION], PASSED, case and case.singular_range).axes[0]
        return [patch for patch in axis.patches if patch.get_label() == "singular by the formula"]

    case = TurnCase()
    ends = sorted(abs(end) for p in shades(case) for end in (p.get_x(), p.get_x() + p.get_width()))
    assert ends[:2] == pytest.approx([np.degrees(case.margin)] * 2)
    assert {to_hex(patch.get_facecolor()) for patch in shades(case)} == {SINGULAR_COLOUR}
    assert shades(None) == []


@pytest.mark.parametrize(("sector", "shaded"), [(96.54, 96.54), (120.0, 120.0), (150.0, 120.0)])
def test_rings_have_the_sector_three_times_up_to_the_whole_circle(sector, shaded):
    """About 60, 180 and 300 degrees; a sector wider than the period covers all and overlaps
    nowhere."""
    ring = success_figure(np.arange(-60, 61), {"row": np.ones(121)}, sector).axes[1]
    bars = [bar for bar in ring.patches if to_hex(bar.get_facecolor()) == SINGULAR_COLOUR]
    assert np.degrees([bar.get_width() for bar in bars]) == pytest.approx([shaded] * 3)
    middles = np.degrees([bar.get_x() + bar.get_width() / 2 for bar in bars])
    assert middles == pytest.approx([60, 180, 300])


def test_a_map_has_a_cell_a_grid_point_and_bins_of_draws():
    """Grid cells hold their own trial; draws are binned 8 x 8, and bins of few trials tell how
    many."""
    x, y = (v.ravel() for v in np.meshgrid([1.0, 2.0, 3.0], [10.0, 20.0], indexing="ij"))
    passed = np.array([0, 1, 1, 0, np.nan, 1.0])
    axis = sweep_figure([Spread("a", "m", x), Spread("b", "1", y)], passed).axes[0]
    rates = np.ma.asarray(axis.collections[0].get_array()).reshape(2, 3)
    assert rates.filled(-1).tolist() == [[0, 100, -1], [100, 0, 100]]
    assert not axis.texts
    # A cell is one value: it has an edge, the mark of its trial, and its value at the axis.
    assert axis.collections[0].get_linewidth().min() > 0
    (trials,) = axis.lines
    tried = {(a, b) for a, b, known in zip(x, y, np.isfinite(passed), strict=True) if known}
    assert set(zip(*trials.get_data(), strict=True)) == tried
    assert (axis.get_xticks().tolist(), axis.get_yticks().tolist()) == ([1, 2, 3], [10, 20])
    assert axis.get_xlim() == (0.5, 3.5)
    axis = sweep_figure([PRELOAD, FRICTION], PASSED).axes[0]
    assert np.ma.asarray(axis.collections[0].get_array()).size == 64
    assert axis.texts
    assert all(re.fullmatch("[0-4]", text.get_text()) for text in axis.texts)
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("robot.preload [N]", "world.friction")


def test_cells_of_two_values_have_a_legend_and_no_scale():
    """Where each cell has all passed or all failed; with gaps they are named too. Rates between
    have a scale."""
    x, y = (v.ravel() for v in np.meshgrid([1.0, 2.0, 3.0], [10.0, 20.0], indexing="ij"))
    spreads = [Spread("a", "m", x), Spread("b", "1", y)]

    def legend(passed, x=spreads[0]):
        figure = sweep_figure([x, spreads[1]], passed)
        names = figure.axes[0].get_legend()
        return len(figure.axes), names and [text.get_text() for text in names.get_texts()]

    assert legend(np.array([0, 1, 1, 0, 1, 1.0])) == (1, ["passed", "failed", "a trial"])
    gap = np.array([0, 1, 1, 0, np.nan, 1.0])
    assert legend(gap) == (1, ["passed", "failed", "no outcome", "a trial"])
    twice = Spread("a", "m", np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0]))
    both = [twice, Spread("b", "1", np.ones(6))]
    figure = sweep_figure(both, np.array([0, 1, 1, 1, 0, 0.0]))
    assert (len(figure.axes), figure.axes[0].get_legend()) == (2, None)
    assert [text.get_text() for text in figure.axes[0].texts] == ["1/2", "2/2", "0/2"]


AXES = [
    {"path": "world.friction", "kind": "list", "values": [0.5, 0.7]},
    {"path": "robot.preload", "kind": "list", "values": [10.0, 20.0, 30.0]},
    {"path": "control.kind", "kind": "list", "values": ["jacobian", "paper"]},
]


def sweep_result(axes):
    """A sweep with a table as it would leave: trials with a preload above 15 N pass."""
    sweep = resolve({"name": "s", "base": "straight", "axes": axes})
    preload = sweep.trials().get("robot.preload", [20.0] * sweep.size)
    passed = [value > 15.0 for value in preload]
    ends = ["reached_goal" if good else "slipping" for good in passed]
    table = pa.table({"outcome": ends, "success": passed})
    return TrialsResult(sweep, {"trials": table}, {}, Status(sweep.size))


def test_one_chart_of_a_sweep_goes_into_an_axis(tmp_path):
    """Rates over one axis, a map over two, and without a choice all axes, if one chart can show
    them; on paper the figure of the folder."""
    result = sweep_result(AXES)
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert ot.plot_sweep(result, over="robot.preload", ax=left) is figure
    assert left.lines[0].get_ydata().tolist() == [0, 100, 100]
    assert (left.get_xlabel(), left.get_ylabel()) == ("preload [N]", "success rate [%]")
    ot.plot_sweep(result, over=["world.friction", "robot.preload"], ax=right)
    rates = np.ma.asarray(right.collections[0].get_array())
    assert rates.tolist() == [[0, 0], [100, 100], [100, 100]]
    ot.plot_sweep(sweep_result(AXES[:1]), ax=Figure().subplots())
    ot.plot_sweep(result, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == draw_map(result.plan, result.table)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"over": "friction"}, "over: is 'friction'; did you mean 'world.friction'"),
        ({"over": ["world.friction", "control.kind"]}, "over: name one axis, or two of numbers"),
        ({"ax": Figure().subplots()}, "over: name one axis, or two of numbers"),
        ({"over": []}, "over: name one axis"),
        ({"path": "a.bmp"}, "png, svg, pdf"),
    ],
)
def test_a_chart_of_a_sweep_that_there_is_not_is_refused(given, told):
    """With what there is."""
    with pytest.raises(InputError, match=told):
        ot.plot_sweep(sweep_result(AXES), **given)


def test_a_result_without_all_trials_is_refused():
    """Other shares of the sweep are missing."""
    result = sweep_result(AXES)
    share = replace(result, tables={"trials": result.table.slice(1)})
    with pytest.raises(InputError, match="result: has 11 of 12 trials of 's'"):
        ot.plot_sweep(share)
    with pytest.raises(TypeError, match="result: is 3"):
        ot.plot_sweep(3)


def test_main_effects_are_sorted_by_their_spread():
    """The axis that decides comes first; ten bins of a draw hold the rates of the trials in
    them."""
    figure = sweep_figure([FRICTION, WORD, PRELOAD], PASSED)
    panels = [axis for axis in figure.axes if axis.get_visible()]
    assert panels[0].get_xlabel() == "robot.preload [N]"
    rates = panels[0].lines[0].get_ydata()
    assert len(rates) == 10
    assert (rates[0], rates[-1]) == (0, 100)
    assert np.mean(rates) == pytest.approx(100 * PASSED.mean())


def test_groups_that_are_compared_are_drawn_apart():
    """Each word has a map of its own over two numbers, and curves of its own over more; no panel
    mixes trials of both. Every figure has the sweep and the count as its title."""
    passed = np.where(np.array(KIND.values) == "a", 1.0, 0.0)
    maps = sweep_figure([PRELOAD, FRICTION, KIND], passed, name="sweep")
    panels = [axis for axis in maps.axes if axis.get_title(loc="left")]
    titles = [axis.get_title(loc="left") for axis in panels]
    assert titles == ["a: 200 of 200 passed", "b: 0 of 200 passed"]
    for axis, rate in zip(panels, (100, 0), strict=True):
        assert set(np.ma.asarray(axis.collections[0].get_array()).compressed()) == {rate}
    effects = sweep_figure([PRELOAD, FRICTION, ORIENTATION, KIND], passed, name="sweep")
    for axis in (axis for axis in effects.axes if axis.get_xlabel() == "world.friction"):
        curves, words = axis.get_legend_handles_labels()
        assert words == ["a", "b"]
        assert [set(curve.lines[0].get_ydata()) for curve in curves] == [{100}, {0}]
    assert [text.get_text() for text in effects.legends[0].get_texts()] == ["a", "b"]
    rows = sweep_figure([ORIENTATION, KIND], passed, name="sweep")
    heads = [maps.get_suptitle(), effects.get_suptitle(), rows.axes[0].get_title(loc="left")]
    assert all(head.startswith("sweep: 200 of 400 passed") for head in heads)


def test_gravity_is_shown_by_its_angle_to_the_run():
    """Down along an upward run is against it; thirds of the sphere are of one size."""
    down = {"path": "world.gravity", "kind": "list", "values": [[0, 0, -9.81], [9.81, 0, 0]]}
    axes = [{"path": "world.gravity", "kind": "direction"}]
    sweep = resolve(
        {"name": "s", "base": "tee_turn", "samples": 900, "sampling": "sobol", "axes": axes}
    )
    (spread,) = spreads(sweep)
    assert spread.order == CLASSES
    assert [list(spread.values).count(name) for name in CLASSES] == pytest.approx([300] * 3, abs=15)
    vectors = np.array(sweep.trials()["world.gravity"])
    assert all(
        name == CLASSES[0] for name, v in zip(spread.values, vectors, strict=True) if v[2] < -4
    )
    (words,) = spreads(resolve({"name": "s", "base": "tee_turn", "axes": [down]}))
    assert words.order == ("[0.0, 0.0, -9.81]", "[9.81, 0.0, 0.0]")


def test_the_case_is_that_of_the_base():
    """Pipe, reach and arc come from the base; an elbow has no case."""
    sweep = resolve(
        {
            "name": "s",
            "base": "tee_turn",
            "set": {"robot.reach": 0.098},
            "axes": [{"path": THETA5, "kind": "list", "values": [0]}],
        }
    )
    case = TurnCase(reach=0.098, pipe_radius=0.08, bend_radius=0.09)
    assert singular_range(sweep) == case.singular_range != TurnCase().singular_range
    assert singular_range(load_sweep("elbow_orientation")) is None
    (angle, kind) = spreads(load_sweep("elbow_orientation"))
    assert angle.unit == "deg"
    assert kind.order == ("feedback", "as written (Eq. 20)")


@pytest.mark.parametrize("count", [6, 30, 60, 319])
def test_a_map_of_few_draws_is_a_scatter(count):
    """Each trial is a mark where it was, by its outcome, without cells; a grid of as many trials
    has cells, and more draws have bins."""
    x, y = RNG.uniform(0, 1, (2, count))
    passed = (x > 0.5).astype(float)
    passed[0] = np.nan
    (axis,) = sweep_figure([Spread("a", "m", x), Spread("b", "1", y)], passed).axes
    assert not axis.collections
    marks = {line.get_label(): np.stack(line.get_data(), axis=-1) for line in axis.lines}
    told = {"passed": passed == 1, "failed": passed == 0, "no outcome": np.isnan(passed)}
    for label, these in told.items():
        np.testing.assert_array_equal(marks[label], np.stack([x, y], axis=-1)[these])
    assert [text.get_text() for text in axis.get_legend().get_texts()] == list(told)
    rows = np.arange(count)
    grid = [Spread("a", "m", 1.0 * (rows % 3)), Spread("b", "1", 1.0 * (rows // 3))]
    assert sweep_figure(grid, passed).axes[0].collections


def test_a_course_that_an_entry_cannot_drive_says_why():
    """In place of a rate; what was driven has its rate and interval, in per cent."""
    driven = {"success": 0.5, "success_low": 0.15, "success_high": 0.85, "passed": 2, "trials": 4}
    never = dict.fromkeys(driven) | {"others": "too wide for the bore"}
    rows = [
        {"course": "tee_turn", "entry": "mine"} | driven | {"others": "2 stuck"},
        {"course": "tee_turn", "entry": "yours"} | never,
    ]
    (panel,) = (axis for axis in bench_figure(rows).axes if axis.get_title(loc="left"))
    assert [text.get_text() for text in panel.texts] == ["too wide for the bore"]
    interval, rate = panel.lines[:2]
    np.testing.assert_allclose(interval.get_xdata(), [15.0, 85.0])
    np.testing.assert_allclose(rate.get_xdata(), [50.0])
