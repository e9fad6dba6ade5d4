"""Pipes projected onto a plane: which way is right, up and near, and what crosses over what."""

from __future__ import annotations

import math

import numpy as np
import pytest
from samples import sample_result, two_legs_result

from omnitrack_sim.base.rotations import Pose, frame_along
from omnitrack_sim.pipes import Coupling, Elbow, Step, Straight, Tee, route
from omnitrack_sim.pipes.assembly import Assembly, Part
from omnitrack_sim.pipes.network import load_network
from omnitrack_sim.show.projection import (
    CORNERS,
    SPACING,
    aligned,
    axis_lines,
    bore_faces,
    clearest,
    needs_map,
    port_discs,
    route_line,
)

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("size", [(3.0, 1.0, 2.0), (1.0, 3.0, 2.0), (2.0, 2.0, 0.0)])
def test_elevations_and_plan_are_drawings_along_world_axes(size):
    """Frames are right-handed; elevations have z up and look along the other horizontal axis, the
    plan looks down; the longer extent lies to the right, and a column falls where its axis points
    down the page."""
    views = aligned(np.array(size))
    for view in views:
        np.testing.assert_allclose(view.axes.T @ view.axes, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.axes) == pytest.approx(1.0)
        right, up = (np.eye(3)[column] for column in view.columns)
        assert abs(right @ view.axes[:, 0]) == 1.0
        assert up @ view.axes[:, 1] == (-1.0 if view.falls else 1.0)
        point = np.array([0.3, -0.5, 0.7])
        sign = -1.0 if view.falls else 1.0
        expected = [point[view.columns[0]], sign * point[view.columns[1]]]
        assert view.flat(point) == pytest.approx(expected)
    elevation, side, plan = views
    longer = int(size[1] > size[0])
    assert elevation.columns == (longer, 2)
    assert side.columns == (1 - longer, 2)
    assert plan.columns == (longer, 1 - longer)
    for view, along in ((elevation, 1 - longer), (side, longer)):
        np.testing.assert_array_equal(view.axes[:, 1], UP)
        assert np.abs(view.axes[:, 2]).argmax() == along
        assert view.title == f"elevation, along {'xyz'[along]}"
    np.testing.assert_array_equal(plan.axes[:, 2], UP)
    assert plan.falls == bool(longer)


def two_pipes(near_first: bool) -> Assembly:
    """A pipe along x, and one along z before it, as seen against y."""
    along = Part("along", Straight(1.0), Pose(frame_along([1, 0, 0], 0), np.array([-0.5, 0, 0.5])))
    before = Part("before", Straight(1.0), Pose(np.eye(3), np.array([0.0, -0.5, 0.0])))
    return Assembly((before, along) if near_first else (along, before))


@pytest.mark.parametrize("near_first", [True, False])
def test_nearer_pipes_cross_over_farther_ones(near_first):
    """Whatever their order is; all of both axes is drawn, in pieces."""
    pipes = two_pipes(near_first)
    view = aligned(np.array([3.0, 1.0, 2.0]))[0]
    toward = view.axes[:, 2]
    depth = {i: part.pose.position @ toward for i, part in enumerate(pipes.parts)}
    pieces = view.segments(pipes.parts)
    drawn = [depth[number] for number, _ in pieces]
    assert drawn == sorted(drawn)
    for i in range(2):
        length = sum(np.linalg.norm(b - a) for number, (a, b) in pieces if number == i)
        assert length == pytest.approx(1.0)
    assert max(np.linalg.norm(b - a) for _, (a, b) in pieces) < 1.1 * SPACING


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_a_flat_town_is_seen_square(axis):
    """Pipes in an upright plane are shown by the elevation of that plane, nothing foreshortened."""
    pipes = route(
        [
            Step("riser", Straight(0.6), "start", "end"),
            Step("knee", Elbow(0.24), "start", "end"),
            Step("level", Straight(0.6), "start", "end"),
        ],
        Pose(np.stack([axis, np.cross(UP, axis), UP], axis=-1), np.zeros(3)),
    ).network
    view = clearest(pipes)
    assert abs(view.axes[:, 2] @ axis) < 1e-9
    np.testing.assert_allclose(view.axes[:, 1], UP, atol=1e-12)
    for line in (line for part in pipes.parts for line in axis_lines(part)):
        flat = np.linalg.norm(np.diff(view.flat(line), axis=0), axis=1)
        assert flat == pytest.approx(np.linalg.norm(np.diff(line, axis=0), axis=1))


def test_pipes_behind_each_other_are_seen_apart():
    """Two risers in a line along y, of which an elevation along y would show one."""
    risers = [
        Part(f"riser_{i}", Straight(1.0), Pose(np.eye(3), np.array([0.0, 0.6 * i, 0.0])))
        for i in range(3)
    ]
    view = clearest(Assembly(tuple(risers)))
    middles = np.sort(view.flat(np.array([part.pose.position for part in risers]))[:, 0])
    assert np.diff(middles).min() > 0.16
    assert view.axes[2, 1] > 0.9


def test_axes_are_drawn_by_points_close_together_where_they_bend():
    """From port to port; straight ones by their ends, or by pieces of the length asked for."""
    tee = Part("tee", Tee(), Pose())
    for line in axis_lines(tee):
        assert len(line) == 2
    bend = Elbow(0.24, math.pi / 3)
    (line,) = axis_lines(Part("bend", bend, Pose()))
    ends = bend.ports["start"].position, bend.ports["end"].position
    assert line[[0, -1]] == pytest.approx(np.array(ends))
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.max() < 1.5 * SPACING
    assert steps.sum() == pytest.approx(0.24 * math.pi / 3, rel=1e-3)
    (line,) = axis_lines(Part("pipe", Straight(0.5), Pose()), 0.1)
    np.testing.assert_allclose(np.diff(line, axis=0), [[0, 0, 0.1]] * 5)


def test_the_line_of_a_route_is_10_mm_apart():
    """From its begin to its end."""
    way = route([Step("knee", Elbow(0.24), "start", "end")])
    line = route_line(way)
    assert line[[0, -1]] == pytest.approx(way.centreline.at(np.array([0.0, way.length]))[0])
    assert np.linalg.norm(np.diff(line, axis=0), axis=1) == pytest.approx(0.01, rel=0.03)


def test_discs_close_the_ports():
    """Round their middles, in their planes, as wide as the bores."""
    part = Part("tee", Tee(), Pose(frame_along([0.3, 0.4, 0.5], 0.2), np.array([1.0, 2.0, 3.0])))
    discs = port_discs(Assembly((part,)))
    assert len(discs) == 3
    for name, disc in zip(part.fitting.port_names, discs, strict=True):
        own = part.port(name).inverse().apply(disc)
        assert own.shape == (CORNERS, 3)
        assert np.hypot(own[:, 0], own[:, 1]) == pytest.approx(part.fitting.port_radius(name))
        assert own.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
        assert np.abs(own[:, 2]).max() < 1e-12


def test_a_step_is_drawn_as_one():
    """The drawn bores of a joint are those of its pipes up to their ends, and of its groove,
    within the rounding of its edges."""
    joint = Coupling(end_diameter=0.15, offset=0.002, gap=0.02)
    corners = bore_faces(Assembly((Part("joint", joint, Pose()),))).reshape(-1, 3)
    distance = joint.signed_distance(corners)[0]
    assert len(corners) == 4 * 3 * CORNERS
    assert np.abs(distance).max() < 2 * joint.edge_radius


def test_pictures_have_a_map_of_many_fittings_and_of_several_legs():
    """Not of a run through three parts."""
    assert not needs_map(sample_result())
    assert needs_map(two_legs_result())
    pipes = {"kind": "straight", "length": 0.5}
    from omnitrack_sim.scenario import validate

    for count in (3, 4):
        run = sample_result(scenario=validate({"pipes": [pipes] * count}))
        assert needs_map(run) == (count > 3)
    assert len(load_network("fig14").pipes.parts) > 3
