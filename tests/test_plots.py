"""Figures of runs and networks: summary, channels, and what all functions that plot share."""

from __future__ import annotations

import gc
import io
import re
import subprocess
import sys
import weakref

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image
from samples import sample_result, sample_trajectory, two_legs_result

import omnitrack_sim as ot
from omnitrack_sim import plot_channel, plot_summary
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.pipes.planning import shortest_route
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.record.channels import Display
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.show.plots.run_figures import LEFT, PanelGrid, limits_of
from omnitrack_sim.show.plots.style import PAGE, PAPER, style

NETWORK = ot.load_network("fig14")
DRAWN = {
    "summary": lambda **where: ot.plot_summary(sample_result(), **where),
    "channel": lambda **where: ot.plot_channel(sample_result(), channel="slide", **where),
    "mission": lambda **where: ot.plot_mission(two_legs_result(), **where),
    "network": lambda **where: ot.plot_network(NETWORK, **where),
    "singularity": lambda **where: ot.plot_singularity(ot.TurnCase(), figure="sector", **where),
    "compare": lambda **where: ot.plot_compare(sample_result(), sample_result(), **where),
}
"""Every public function that plots, called with what it draws; ``plot_sweep`` has its own test."""
ENDINGS = ("png", "pdf", "svg")


@pytest.mark.parametrize("name", DRAWN)
def test_without_a_path_a_figure_comes_back_and_nothing_is_written(name, tmp_path, monkeypatch):
    """It shows itself in a notebook, as a bitmap some 800 pixels wide at most."""
    monkeypatch.chdir(tmp_path)
    figure = DRAWN[name]()
    assert isinstance(figure, Figure)
    assert list(tmp_path.iterdir()) == []
    with Image.open(io.BytesIO(figure._repr_png_())) as image:
        assert image.format == "PNG"
        assert 300 < image.size[0] < 900


@pytest.mark.parametrize("name", DRAWN)
def test_a_path_is_written_by_its_ending_and_the_figure_comes_back(name, tmp_path):
    """The same bytes twice and by the figure's own ``savefig``; no date in it, and in PDF
    fonts that journals take."""
    # Bitmaps of all figures are those that notebooks show, above.
    endings = ENDINGS if name == "channel" else ("svg",)
    for ending in endings:
        assert isinstance(DRAWN[name](path=tmp_path / f"a.{ending}"), Figure)
    # SVG is written soonest, and has all that is drawn.
    DRAWN[name]().savefig(tmp_path / "own.svg")
    assert (tmp_path / "own.svg").read_bytes() == (tmp_path / "a.svg").read_bytes()
    for ending in ENDINGS if name == "channel" else ():
        DRAWN[name](path=tmp_path / "b", format=ending)
        assert (tmp_path / "b").read_bytes() == (tmp_path / f"a.{ending}").read_bytes()
    assert b"<dc:date>" not in (tmp_path / "a.svg").read_bytes()
    if "pdf" in endings:
        pdf = (tmp_path / "a.pdf").read_bytes()
        assert b"CreationDate" not in pdf
        assert b"/Type3" not in pdf


@pytest.mark.parametrize("name", DRAWN)
def test_a_format_that_there_is_not_is_refused(name, tmp_path):
    """Nothing is written; a format without a path would do nothing, and is told."""
    with pytest.raises(InputError, match="png, svg, pdf"):
        DRAWN[name](path=tmp_path / "a.bmp")
    with pytest.raises(InputError, match="without a path"):
        DRAWN[name](format="png")
    assert list(tmp_path.iterdir()) == []


def test_figures_do_not_pile_up():
    """A figure that nothing holds is gone, and pyplot, which keeps lists of figures, is not
    loaded."""
    code = (
        "import sys; sys.path.insert(0, 'tests'); from samples import sample_result\n"
        "import omnitrack_sim as ot; ot.plot_summary(sample_result())\n"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
    gone = weakref.ref(plot_summary(sample_result()))
    gc.collect()
    assert gone() is None


def test_every_panel_has_its_unit_and_none_has_one_without_a_name():
    """The axes of the summary: name and unit, or the name alone of numbers without a unit."""
    labels = [axis.get_ylabel() for axis in plot_summary(sample_result()).axes]
    assert len(set(labels)) == len(labels) == 15
    bare = [label for label in labels if not label.endswith("]")]
    assert sorted(bare) == ["Contact points", "Slip ratio"]
    assert not any("[1]" in label for label in labels)
    for channel in RECORDED.values():
        panel, unit = channel.display, channel.unit
        scale = {"m": 1.0, "mm": 1e3, "m/s": 1.0, "mm/s": 1e3, "deg": 180 / np.pi}
        assert panel.scale == pytest.approx(scale.get(panel.unit, 1.0))
        assert panel.unit.removeprefix("m") == unit or (unit, panel.unit) in {
            ("rad", "deg"),
            ("m", "m"),
            ("1", "1"),
            (unit, unit),
        }


def test_command_and_measured_value_of_a_module_are_apart():
    """A panel of one module has two lines of other colour and width, both with their values, and
    the three panels of the belt speeds have one scale."""
    command = np.full((201, 3), 0.1) + np.array([0.0, 0.02, 0.04])
    result = sample_result(sample_trajectory(belt_speed_command=command))
    axes = [a for a in plot_summary(result).axes if a.get_ylabel().startswith("Belt speed")]
    assert len({axis.get_ylim() for axis in axes}) == 1
    for i, axis in enumerate(axes):
        measured, asked = axis.lines
        np.testing.assert_allclose(
            measured.get_ydata(), 1e3 * result.trajectory["belt_speed"][:, i]
        )
        np.testing.assert_allclose(asked.get_ydata(), 1e3 * command[:, i])
        assert to_rgb(measured.get_color()) == MODULE_COLOURS[i] != to_rgb(asked.get_color())
        assert asked.get_linewidth() > measured.get_linewidth()
        assert asked.get_zorder() < measured.get_zorder()


def test_module_lines_hold_the_channels():
    """The lines of a panel with all modules are the recorded values in the modules' colours."""
    result = sample_result()
    axis = next(a for a in plot_summary(result).axes if a.get_ylabel() == "Normal force [N]")
    for i in range(3):
        line = next(line for line in axis.lines if line.get_label() == f"module {i + 1}")
        assert to_rgb(line.get_color()) == MODULE_COLOURS[i]
        np.testing.assert_array_equal(line.get_ydata(), result.trajectory["normal_force"][:, i])


def test_phases_and_modules_are_named_once():
    """The legends name each module and each phase that occurred exactly once."""
    figure = plot_summary(sample_result())
    assert all(legend.get_texts() for legend in figure.legends)
    names = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert sorted(names) == sorted(
        ["module 1", "module 2", "module 3", "command", "straight", "turn", "leave"]
    )


def test_noise_gets_no_axis_of_its_own():
    """A curve that varies by rounding errors is level, at its least span or a share of its value;
    and what is written beside an axis is a number alone, with no power of ten elsewhere."""
    distance = 0.1 + 1e-9 * np.arange(201) / 200
    figure = plot_summary(sample_result(sample_trajectory(distance=distance)))
    FigureCanvasAgg(figure).draw()
    (axis,) = [a for a in figure.axes if a.get_ylabel() == "Distance along the centreline [m]"]
    assert np.ptp(axis.get_ylim()) == pytest.approx(RECORDED["distance"].display.span)
    assert not any(a.yaxis.get_offset_text().get_text() for a in figure.axes)
    low, high = limits_of(Display("own", "m"), np.array([5.0, 5.0 + 1e-12]))
    assert high - low == pytest.approx(5e-4)


def test_lines_of_other_robots_have_the_names_of_their_model(tmp_path):
    """Bodies that touch the wall, and actuators, each in the colour of its name; a saved run has
    the names, too."""
    run = ot.run(ot.load_scenario("robots/presser_tee", {"run.time_limit": 0.1}), no_load=False)
    wheels = [f"{end}_{i}" for end in ("front", "rear") for i in range(3)]
    for result in (run, ot.load_result(run.save(tmp_path / "run"))):
        figure = plot_summary(result)
        (bodies,) = figure.legends  # motors have the names and colours of their wheels
        assert sorted(text.get_text() for text in bodies.get_texts()) == wheels
        assert "bodies, actuators" in {text.get_text() for text in figure.texts}
        panels = {axis.get_ylabel(): axis for axis in figure.axes}
        lines = panels["Force on the wall, by body [N]"].lines
        index = result.trajectory.schema["wall_force"].names.index("rear_1")
        (line,) = [line for line in lines if line.get_label() == "rear_1"]
        np.testing.assert_array_equal(line.get_ydata(), result.trajectory["wall_force"][:, index])
        (handle,) = [h for h in bodies.legend_handles if h.get_label() == "rear_1"]
        assert handle.get_color() == line.get_color()


def test_a_legend_has_as_many_columns_as_fit_into_its_width():
    """In half of a page, too: it ends within its width, and takes less lines where it has more."""
    handles = [Line2D([], [], label=f"module {k} of twelve") for k in range(12)]
    lines = {}
    for width in (2.0, 3.5, PAGE - LEFT):
        with style(PAPER):
            grid = PanelGrid(1, 1)
            lines[width] = grid.legend(handles, 0.1, width=width)
            (legend,) = grid.figure.legends
            canvas = FigureCanvasAgg(grid.figure)
            canvas.draw()
            box = legend.get_window_extent(canvas.get_renderer())
        inches = box.transformed(grid.figure.dpi_scale_trans.inverted())
        assert LEFT - 0.01 < inches.x0 < inches.x1 < LEFT + width
        assert inches.width > 0.6 * width
    assert list(lines.values()) == sorted(lines.values(), reverse=True)
    assert len(set(lines.values())) == 3


def test_outcome_is_written():
    """The head says how the run ended."""
    figure = plot_summary(sample_result(outcome=Outcome.NO_MOTION_LINE))
    assert any("no motion line after 4.00 s" in text.get_text() for text in figure.texts)


def test_texts_of_the_summary_keep_apart():
    """Names, ticks and legends of the page do not cover each other, and none is cut off."""
    figure = plot_summary(two_legs_result())
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    names = [axis.yaxis.label for axis in figure.axes] + [*figure.texts]
    names += [text for legend in figure.legends for text in legend.get_texts()]
    boxes = [text.get_window_extent(renderer) for text in names]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:i]), names[i].get_text()
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1


@pytest.mark.parametrize("samples", [1, 2])
def test_shortest_runs_can_be_drawn(tmp_path, samples):
    """A run that ended at once, and one whose record is not a number, still give a figure."""
    full = sample_trajectory()
    channels = {name: values[:samples] for name, values in full.channels.items()}
    channels["traction"] = np.full((samples, 3), np.nan)
    short = Trajectory(full.time[:samples], channels, full.phases, full.qpos[:samples], full.schema)
    plot_summary(sample_result(short), path=tmp_path / "short.png")
    assert (tmp_path / "short.png").stat().st_size > 10_000


@pytest.mark.parametrize("channel", RECORDED)
def test_every_channel_can_be_drawn_beside_others(channel):
    """In the axis that is given: a line for each of its numbers, contacts of both tracks added."""
    figure = Figure()
    left, right = figure.subplots(1, 2)
    result = sample_result()
    assert plot_channel(result, channel=channel, ax=right) is figure
    assert not left.lines
    count = 3 if channel == "contact_count" else int(np.prod(RECORDED[channel].shape, dtype=int))
    own = [line for line in right.lines if "command" not in str(line.get_label())]
    assert len(own) == count
    assert right.get_ylabel() == RECORDED[channel].display.label()
    assert [line for line in right.lines if len(line.get_ydata()) != 201] == []


def test_one_module_of_a_channel():
    """Its measured value and its command, and a legend that names them and the phases."""
    figure = plot_channel(sample_result(), channel="roll", module=2)
    (axis,) = figure.axes
    assert axis.get_ylabel() == "Module roll, module 2 [deg]"
    assert [line.get_label() for line in axis.lines] == ["module 2", "command"]
    names = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert names == ["module 2", "command", "straight", "turn", "leave"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"channel": "slipratio"},
            "channel: is 'slipratio'; did you mean 'slip_ratio'.*choose from",
        ),
        ({"channel": "slide", "module": 4}, r"module: is 4 \(choose from: 1, 2, 3"),
        ({"channel": "tilt", "module": 1}, "module: tilt has no modules"),
        ({"channel": "tilt", "ax": Figure().subplots(), "path": "a.png"}, "given with ax"),
    ],
)
def test_a_chart_that_there_is_not_is_refused(given, told):
    """By the name of the argument, with what would be right."""
    with pytest.raises(InputError, match=told):
        plot_channel(sample_result(), **given)


def test_a_view_of_a_network_goes_into_an_axis():
    """The view that is asked for, with the parts that it shows lengthwise; others are refused. What
    comes back is the whole figure, also of an axis in a part of one."""
    figure = Figure()
    axis = figure.subfigures(1, 2)[0].subplots()
    assert ot.plot_network(NETWORK, view="plan", ax=axis) is figure
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("x [m]", "y [m]")
    names = {text.get_text() for text in axis.texts}
    assert "shelf" in names
    assert "riser" not in names  # it stands upright
    with pytest.raises(InputError, match=r"view: is 'top'.*elevation, side, plan"):
        ot.plot_network(NETWORK, view="top")


def test_where_a_network_lies_changes_nothing_but_the_figures_at_its_axes():
    """Page, place of each view in it and what a view shows have the same sizes; one view likewise
    but for the room of the figures."""
    data = NETWORK.model_dump()
    far = {"place": data["place"] | {"position": (30.0, -20.0, 10.0)}}
    networks = [ot.Network(**each) for each in (data, data | far)]
    here, there = map(ot.plot_network, networks)
    assert there.get_size_inches() == pytest.approx(here.get_size_inches())
    for one, other in zip(here.axes, there.axes, strict=True):
        assert other.get_position().bounds == pytest.approx(one.get_position().bounds)
        assert np.ptp(other.get_xlim()) == pytest.approx(np.ptp(one.get_xlim()))
        assert np.ptp(other.get_ylim()) == pytest.approx(np.ptp(one.get_ylim()))
    here, there = (ot.plot_network(each, view="plan").get_size_inches() for each in networks)
    assert there == pytest.approx(here)


def test_names_of_a_network_keep_apart_and_stand_by_their_parts():
    """Of 50 parts: each is named once, no two names overlap, and from each name to the axis of its
    part it is no further than a bore and 13 points (the largest gap), in the view where it is. A
    name that stands off its bore has a line to the axis, and there is no other."""
    network = ot.random_network(3, 50)
    figure = ot.plot_network(network)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer, parts = canvas.get_renderer(), {part.name: part for part in network.pipes.parts}
    views = [axis for axis in figure.axes if re.fullmatch(r". \[m\]", axis.get_xlabel())]
    named = [text.get_text() for axis in views for text in axis.texts]
    assert sorted(named) == sorted(parts)
    far = []  # names that stand off their bores
    for axis in views:
        columns = ["xyz".index(label[0]) for label in (axis.get_xlabel(), axis.get_ylabel())]
        boxes = [text.get_window_extent(renderer) for text in axis.texts]
        for i, (text, box) in enumerate(zip(axis.texts, boxes, strict=True)):
            assert not any(box.overlaps(other) for other in boxes[:i]), text.get_text()
            part = parts[text.get_text()]
            line, _, _ = part.axes[0]
            points = line.at(np.linspace(0, line.length, 50))[0][:, columns]
            pixels = axis.transData.transform(points)
            gaps = np.maximum(np.maximum(box.min - pixels, pixels - box.max), 0.0)
            bore = np.ptp(axis.transData.transform([[0, 0], [part.fitting.radius, 0]])[:, 0])
            point = renderer.points_to_pixels(1.0)
            gap = np.linalg.norm(gaps, axis=1).min()
            assert gap < bore + 13.5 * point, text.get_text()
            lines = [axis.transData.transform(line.get_xydata()) for line in axis.lines]
            ties = [
                tie
                for tie in lines
                if len(tie) == 2
                and np.linalg.norm(pixels - tie[0], axis=1).min() < point
                and (np.maximum(box.min - tie[1], tie[1] - box.max) < 0.5 * point).all()
            ]
            assert len(ties) == (gap > bore + 3.5 * point), text.get_text()
            far += ties
    assert 0 < len(far) < len(parts)
    assert len(far) == sum(len(line.get_xydata()) == 2 for axis in views for line in axis.lines)


def test_names_of_a_network_keep_off_its_route():
    """Where a route lies across a name, the name stands elsewhere, and no name is on the route."""
    network = ot.load_network("fig14")
    route = shortest_route(network, "inlet", "side")
    figure = ot.plot_network(network, route=route, view="elevation")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (axis,) = [axis for axis in figure.axes if axis.get_xlabel() == "x [m]"]
    places = route.centreline.at(np.linspace(0, route.centreline.length, 400))[0]
    pixels = axis.transData.transform(places[:, [0, 2]])
    for text in axis.texts:
        box = text.get_window_extent(canvas.get_renderer())
        on_it = ((pixels > box.min) & (pixels < box.max)).all(axis=1)
        assert not on_it.any(), text.get_text()


@pytest.mark.parametrize("name", ["fig14", "house_sewer", "annex", "long"])
def test_no_name_of_a_network_is_cut_at_the_margin(name):
    """In every view, the one in space too, each text lies within the figure, whichever open ends a
    route leads to and however long their names."""
    network = random_network(7) if name == "long" else ot.load_network(name)
    for goal in network.open_ends[1::2]:
        figure = ot.plot_network(network, route=shortest_route(network, network.open_ends[0], goal))
        renderer = FigureCanvasAgg(figure).get_renderer()
        texts = [text for axis in figure.axes for text in axis.texts if text.get_text()]
        assert sum(text.get_text().startswith(("from ", "to ")) for text in texts) == 2
        for text in (*texts, *figure.texts):
            box = text.get_window_extent(renderer)
            assert min(box.x0, box.y0) >= 0, text
            assert box.x1 <= figure.bbox.width, text
            assert box.y1 <= figure.bbox.height, text
