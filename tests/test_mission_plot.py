"""The map of a run and the time chart below it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from PIL import Image
from samples import sample_result, sample_trajectory, two_legs_result

import omnitrack_sim as ot
from omnitrack_sim import plot_mission
from omnitrack_sim.record.events import FellOff, Outcome
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.plots.mission_figure import EventMark, _round_up, marks_of
from omnitrack_sim.show.plots.network_figure import extent


@pytest.fixture(scope="module")
def figure():
    return plot_mission(two_legs_result())


def texts(figure) -> list[str]:
    return [text.get_text() for axis in figure.axes for text in axis.texts]


def legends(figure) -> list[str]:
    found = [*figure.legends, *(axis.get_legend() for axis in figure.axes)]
    return [
        text.get_text() for legend in found if legend is not None for text in legend.get_texts()
    ]


def test_every_part_is_named_in_both_maps_and_every_fitting_in_the_chart(figure):
    """Parts of the network once a map; fittings driven through in the bands, legs below."""
    names = texts(figure)
    parts = [part.name for part in two_legs_result().routes()[0].network.parts]
    driven = [passage.name for passage in two_legs_result().timeline()]
    driven += [
        "shelf",
        "elbow_side",
    ]  # two bands each: the robot backed off from one into the other
    for part in parts:
        assert names.count(part) == 2 + driven.count(part), part
    assert [name.strip() for name in names if "leg" in name] == ["leg 1", "leg 2, tail first"]
    (strip,) = [axis for axis in figure.axes if any("leg" in t.get_text() for t in axis.texts)]
    renderer = figure.canvas.get_renderer()
    low = min(band.get_window_extent(renderer).y0 for band in strip.collections)
    bottom = strip.get_window_extent(renderer).y0
    legs = [t.get_window_extent(renderer) for t in strip.texts if "leg" in t.get_text()]
    assert all(bottom <= box.y0 < box.y1 <= low for box in legs)


def test_a_robot_is_drawn_where_it_drives_on_a_map_that_is_wrong():
    """Where ``distance`` stands still, or jumps as the robot finds itself elsewhere, path, travel
    and speed are those of the robot."""
    result = two_legs_result()
    right = plot_mission(result)
    distance = result.trajectory["distance"]
    distance[:300] = distance[0]
    distance[200] += 40.0
    wrong = plot_mission(result)

    def pieces(figure) -> int:
        lines = [line for axis in figure.axes for line in axis.collections]
        return sum(len(line.get_segments()) for line in lines if isinstance(line, LineCollection))

    assert pieces(wrong) == pieces(right) > 100
    assert [text.get_text() for text in wrong.texts] == [text.get_text() for text in right.texts]
    speed = next(axis for axis in wrong.axes if axis.get_ylabel().startswith("speed"))
    assert max(np.abs(speed.get_ylim())) < 1000  # mm/s


def test_a_long_route_names_so_many_parts_as_can_be_read():
    """Of 300 parts each fourth, from the first to the last; a few ticks on every axis of a route of
    kilometres."""
    pipes = [{"kind": "straight", "length": 8.0}] * 300
    figure = plot_mission(sample_result(scenario=validate({"pipes": pipes})))
    names = [name for name in texts(figure) if name.startswith("straight_")]
    every_fourth = [f"straight_{i}" for i in range(0, 300, 4)]
    assert names[: len(every_fourth)] == every_fourth
    assert len(names) == 2 * len(every_fourth) + 1  # both maps, and the band of the chart
    ticks = [axis.get_majorticklocs() for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    assert max(map(len, ticks)) < 15


def test_names_do_not_cover_each_other(figure):
    """No two names of a map overlap."""
    renderer = figure.canvas.get_renderer()
    assert max(len(axis.texts) for axis in figure.axes) > 10
    for axis in figure.axes:
        boxes = [text.get_window_extent(renderer) for text in axis.texts]
        for i, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[:i])


def test_names_of_short_legs_do_not_cover_each_other():
    """Of 40 legs each has its number alone, or no name where it is too short for that."""
    result = two_legs_result()
    record = result.trajectory
    turn = 40 * np.arange(len(record.time)) // len(record.time)
    channels = record.channels | {"leg": turn % 2}
    figure = plot_mission(replace(result, trajectory=replace(record, channels=channels)))
    renderer = figure.canvas.get_renderer()
    names = [text for axis in figure.axes for text in axis.texts if text.get_text().strip()]
    legs = [name for name in names if name.get_text().strip() in ("1", "2", "leg 1", "leg 2")]
    assert len(legs) > 10
    boxes = [name.get_window_extent(renderer) for name in legs]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_names_stand_by_their_parts(figure):
    """From each name of a map to the axis of its part it is no further than a bore and 13 points,
    the largest gap."""
    renderer = figure.canvas.get_renderer()
    parts = {part.name: part for part in two_legs_result().routes()[0].network.parts}
    maps = [axis for axis in figure.axes if axis.get_ylabel() in ("y [m]", "z [m]")]
    assert len(maps) == 4
    for axis in maps:
        # Of views one above the other only the lower one names the axis across.
        columns = [0, "xyz".index(axis.get_ylabel()[0])]
        for text in axis.texts:
            line, _, _ = parts[text.get_text()].axes[0]
            pixels = axis.transData.transform(
                line.at(np.linspace(0, line.length, 50))[0][:, columns]
            )
            box = text.get_window_extent(renderer)
            gaps = np.maximum(np.maximum(box.min - pixels, pixels - box.max), 0.0)
            bore = np.ptp(axis.transData.transform([[0, 0], [0.08, 0]])[:, 0])
            most = bore + 13.5 * renderer.points_to_pixels(1.0)
            assert np.linalg.norm(gaps, axis=1).min() < most, text.get_text()


def test_colours_are_the_recorded_values(figure):
    """The pieces of the first leg carry slip on the left and force on the right, in all four
    views."""
    lines = [[c for c in axis.collections if isinstance(c, LineCollection)] for axis in figure.axes]
    coloured = [[c.get_array() for c in found if c.get_array() is not None] for found in lines]
    first = [np.asarray(found[0]) for found in coloured if found]
    assert len(first) == 4
    assert first[0].min() == pytest.approx(0.01)
    assert first[0].max() == pytest.approx((0.31 + 0.11 + 0.09) / 3, rel=0.02)
    assert np.array_equal(first[0], first[1])
    assert first[2].max() == pytest.approx(25.0)
    assert 9.0 < first[2].min() < 11.0


def test_the_way_back_is_drawn_beside_the_way_there(figure):
    """A leg that is driven tail first half a radius to its right, in the planes of the maps."""
    position = two_legs_result().trajectory["position"]
    for axis in figure.axes:
        lines = [c for c in axis.collections if isinstance(c, LineCollection)]
        ways = [way for way in lines if way.get_array() is not None]
        if not ways:
            continue
        columns = [0, "xyz".index(axis.get_ylabel()[0])]
        there, back = (np.array([piece[0] for piece in way.get_segments()]) for way in ways)
        flat = position[:, columns]
        apart = [
            np.linalg.norm(way[:, None] - flat, axis=-1).min(axis=1).max() for way in (there, back)
        ]
        assert apart[0] < 1e-9
        assert apart[1] == pytest.approx(0.04, abs=1e-4)
        # On the page: from a point of the way to the nearest place of the robot is to the left.
        nearest = flat[np.linalg.norm(back[:, None] - flat, axis=-1).argmin(axis=1)]
        drawn, home = axis.transData.transform(back), axis.transData.transform(nearest)
        on, left = np.gradient(drawn, axis=0), home - drawn
        assert (on[:, 0] * left[:, 1] - on[:, 1] * left[:, 0]).sum() > 0


def test_signs_are_explained(figure):
    """The legends name what occurs: roll, retry, tail first, manoeuvres; and no end, for the goal
    was reached."""
    told = legends(figure)
    assert {"start", "goal", "tail first", "modules rolled", "backs off to retry"} <= set(told)
    assert {"straight", "elbow", "run to branch", "over the run"} <= set(told)
    assert not any(text.startswith("end") for text in told)


def test_a_fall_is_marked_where_it_was():
    """At the sample of its time, in every map and in the chart, with its meaning below."""
    result = two_legs_result()
    time = float(result.trajectory.time[100])
    fell = two_legs_result(events=[FellOff(0, time, "tee_1", "tee_1.run_end")])
    (mark,) = [mark for mark in marks_of(fell) if mark.text == "leaves its route"]
    assert mark.rows.tolist() == [100]
    assert "leaves its route" in legends(plot_mission(fell))
    assert "leaves its route" not in [mark.text for mark in marks_of(result)]


def test_a_failed_run_shows_its_end():
    """The outcome stands in the head and at the place where the run ended."""
    figure = plot_mission(two_legs_result(outcome=Outcome.STUCK))
    assert "end: stuck" in legends(figure)
    assert any("stuck after" in text.get_text() for text in figure.texts)


def test_the_head_has_the_headway_of_the_metrics():
    """Not the length of the path, which is another number."""
    run = two_legs_result()
    head = f"{run.metrics['distance_m']:.2f} m of headway"
    assert any(head in text.get_text() for text in plot_mission(run).figure.texts)


def test_a_plate_does_not_seem_to_close_what_lies_below_it():
    """It is drawn where no other pipe lies behind it, as in the plan of a level pipe above another
    one; the elevation shows it."""
    truth = {"sensing.kind": "truth", "record.pictures": False}
    sim = ot.Simulation([ot.load_scenario("missions/explore_onboard", truth)])
    # An explorer's time limit grows with its map.
    while sim.active.any():
        sim.step(ot.Command(np.zeros((1, 3)), over=np.ones(1, bool)))
    figure = plot_mission(sim.results()[0])
    views = {axis.get_title(loc="left"): len(axis.patches) for axis in figure.axes}
    assert (views["elevation, along y"], views["plan, from above"]) == (1, 0)


def test_same_run_same_bytes(tmp_path):
    """No clock enters; the bitmap is as wide as a page."""
    for name in ("a.png", "b.png"):
        plot_mission(two_legs_result(), path=tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.size[0] == 1575


@pytest.mark.parametrize("samples", [1, 2, 201])
def test_any_run_can_be_drawn(tmp_path, samples):
    """One pipe, a run that ended at once, and a record that ends in what is not a number."""
    full = sample_trajectory()
    channels = {name: np.array(values[:samples], float) for name, values in full.channels.items()}
    if samples > 2:
        for values in channels.values():
            values[-2:] = np.nan
        channels["leg"][:], channels["phase"][:], channels["gear"][:] = 0, 0, 1
    short = Trajectory(full.time[:samples], channels, full.phases, full.qpos[:samples], full.schema)
    plot_mission(
        sample_result(short, outcome=Outcome.DIVERGED, duration_s=0.0), path=tmp_path / "map.pdf"
    )
    assert (tmp_path / "map.pdf").stat().st_size > 5_000


def test_scales_of_the_chart_end_at_the_next_round_number():
    """In any decade at one of ten numbers a decade, that itself where it is one of them, and never
    at more than half as much again."""
    rounds = [float(f"{m}e{k}") for k in range(-4, 5) for m in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8)]
    assert [_round_up(value) for value in rounds] == pytest.approx(rounds)
    for value, above in zip(rounds, [*rounds[1:], 1e5], strict=True):
        assert _round_up(1.01 * value) == pytest.approx(above)
    assert [_round_up(value) for value in (0.0, -3.0, float("nan"))] == [1.0] * 3


def test_a_letter_that_marks_an_event_stands_in_the_middle_of_its_disc():
    """Its outline lies evenly about the place of the event; a plain marker has no disc."""
    _, glyph = EventMark("falls", "\u2193", "red", np.array([0])).looks()
    low, high = glyph["marker"].get_extents().get_points()
    assert low == pytest.approx(-high)
    (plain,) = EventMark("arrives", "o", "green", np.array([0])).looks()
    assert plain["marker"] == "o"


def test_signs_stand_where_things_were():
    """Start, goals and events in both views of the map, each at the robot's place at that time."""
    result = two_legs_result()
    figure = plot_mission(result)
    position = result.trajectory["position"]
    views = [axis for axis in figure.axes if re.fullmatch(r". \[m\]", axis.get_xlabel())]
    assert len(views) == 2
    for axis in views:
        columns = ["xyz".index(label[0]) for label in (axis.get_xlabel(), axis.get_ylabel())]
        drawn = [np.column_stack(line.get_data()).astype(float) for line in axis.lines]
        marks = marks_of(result)
        assert marks
        wanted = [position[:1], result.goal_points(), *(position[mark.rows] for mark in marks)]
        for places in wanted:
            flat = places[:, columns]
            assert any(d.shape == flat.shape and np.allclose(d, flat) for d in drawn)


def test_the_frame_of_a_map_is_wider_than_its_pipes_by_a_share_of_them():
    """4 % of the longest side all round, in any unit."""
    faces = np.array([[[0.0, 0.0, 0.0], [2.0, 1.0, 0.5], [1.0, 0.2, 0.1]]])
    for scale in (1.0, 1000.0):
        low, high = extent(scale * faces)
        np.testing.assert_allclose(low, scale * np.full(3, -0.08))
        np.testing.assert_allclose(high, scale * np.array([2.08, 1.08, 0.58]))
