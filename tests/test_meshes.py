"""Fitting meshes: solid, open where a pipe is open, and lying on the exact surface."""

from __future__ import annotations

import math

import numpy as np
import pytest
from trimesh import Trimesh

from omnitrack_sim.pipes import Elbow, Reducer, Step, Straight, Tee, route
from omnitrack_sim.robots.omnitrack.looks import coil, lug_row, triangular_prism
from omnitrack_sim.walls.meshes import (
    SECTIONS,
    THICKNESS,
    cutaway_mesh,
    fitting_mesh,
    inside_mesh,
    network_mesh,
)

FITTINGS = [
    Straight(0.5),
    Reducer(0.1, 0.15),
    Reducer(0.1, 0.2, 0.15),
    Elbow(0.24),
    Elbow(0.09),
    Elbow(0.24, math.pi),
    Tee(),
    Tee(inner_diameter=0.1, fillet_radius=0.002),
]


def genus(mesh):
    return 1 - mesh.euler_number / 2


@pytest.mark.parametrize("fitting", FITTINGS, ids=str)
def test_wall_is_a_solid_with_open_bores(fitting):
    """A fitting is watertight, wound outward, and of genus openings - 1: a blocked branch would
    lower it."""
    mesh = Trimesh(*fitting_mesh(fitting), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert genus(mesh) == len(fitting.ports) - 1


@pytest.mark.parametrize(
    ("mean_radii", "bore"), [(0.5, 0.05), (0.5, 0.3), (0.5625, 0.05), (1.5, 0.3), (6.0, 0.05)]
)
def test_elbows_of_any_angle_are_open_tubes(bore, mean_radii):
    """From 10 to 180 degrees the wall is one solid of genus 1, its inside an annulus (Euler
    characteristic 0), and no face lies across a mouth. At the least mean radius the wall has no
    thickness along its inner line, so that it is a bent sheet of genus 0, with a disc inside."""
    tube = mean_radii > 0.5
    for degrees in (10, 22.5, 37, 60, 89.9, 90, 154.3, 180):
        elbow = Elbow(mean_radii * bore, math.radians(degrees), bore)
        wall = Trimesh(*fitting_mesh(elbow, sections=48), process=False)
        inside = Trimesh(*inside_mesh(elbow, sections=48), process=False)
        assert (wall.is_watertight, wall.body_count, genus(wall)) == (True, 1, tube), degrees
        assert inside.euler_number == 1 - tube, degrees
        for port in elbow.ports.values():
            across = port.inverse().apply(wall.triangles_center)
            mouth = (np.abs(across[:, 2]) < 1e-4) & (np.hypot(*across.T[:2]) < 0.98 * bore / 2)
            assert not mouth.any(), degrees


@pytest.mark.parametrize("fitting", FITTINGS, ids=str)
def test_corners_lie_on_the_inner_or_outer_surface(fitting):
    """No corner of the mesh is nearer to the axis than the exact inner surface, or outside the
    wall."""
    mesh = fitting_mesh(fitting)
    distance, _ = fitting.signed_distance(mesh.vertices)
    inner = distance > -THICKNESS / 2
    assert inner.sum() > 100
    assert distance.max() < 3e-4
    assert np.abs(distance[inner]).max() < (3e-4 if isinstance(fitting, Tee) else 1e-6)


@pytest.mark.parametrize("fitting", [Elbow(0.24), Elbow(0.09), Elbow(0.24, math.pi)], ids=str)
def test_elbow_volume_is_pappus(fitting):
    """The wall's volume is its cross-section times the length of the centreline, less what the
    corners cut off."""
    inner, outer = fitting.radius, fitting.radius + THICKNESS
    expected = math.pi * (outer**2 - inner**2) * fitting.mean_radius * fitting.angle
    assert fitting_mesh(fitting).volume == pytest.approx(expected, rel=3e-3)


def cone_volume(length: float, start: float, end: float) -> float:
    """Volume of a frustum, m³, with the polygon of a mesh as its cross-section."""
    polygon = SECTIONS / 2 * math.sin(2 * math.pi / SECTIONS)
    return polygon * length / 3 * (start**2 + start * end + end**2)


@pytest.mark.parametrize("reducer", [Reducer(0.1, 0.15), Reducer(0.15, 0.2, 0.12)], ids=str)
def test_reducer_volume_is_that_of_two_frustums(reducer):
    """The wall is one frustum less another, 4 mm apart across the axis."""
    bores = reducer.port_radius("start"), reducer.port_radius("end")
    outer, inner = (
        cone_volume(reducer.length, *(r + more for r in bores)) for more in (THICKNESS, 0.0)
    )
    assert fitting_mesh(reducer).volume == pytest.approx(outer - inner, rel=1e-5)


def test_joints_of_a_reducer_are_whole():
    """A chain with reducers is one watertight solid: the sum of its parts, with nothing cut off or
    put on at joints."""
    steps = [
        Step("a", Straight(0.3), "start", "end"),
        Step("b", Reducer(0.1, 0.12), "start", "end"),
        Step("c", Straight(0.3, 0.12), "start", "end"),
        Step("d", Reducer(0.1, 0.12), "end", "start"),
        Step("e", Straight(0.3, 0.1605), "start", "end"),
    ]
    network = route(steps).network
    mesh = Trimesh(*network_mesh(network), process=False)
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert genus(mesh) == 1
    parts = sum(fitting_mesh(part.fitting).volume for part in network.parts)
    assert mesh.volume == pytest.approx(parts, rel=2e-4)


def test_fillet_takes_material_off_the_rim():
    """A larger fillet leaves less wall."""
    volumes = [fitting_mesh(Tee(fillet_radius=f)).volume for f in (0.001, 0.005, 0.01)]
    assert volumes[0] > volumes[1] + 1e-7
    assert volumes[1] > volumes[2] + 1e-7


@pytest.mark.parametrize("fitting", FITTINGS, ids=str)
def test_cut_halves_make_the_whole(fitting):
    """The half that stays and the half taken away are solids, and together have the volume of the
    fitting."""
    cut = [cutaway_mesh(fitting, [0.3, 1.0, 0.2], keep=keep) for keep in (True, False)]
    halves = [Trimesh(*half, process=False) for half in cut]
    assert all(half.is_watertight for half in halves)
    assert sum(half.volume for half in halves) == pytest.approx(
        fitting_mesh(fitting).volume, rel=1e-6
    )


@pytest.mark.parametrize("towards", [[0.0, 1, 0], [0.0, -1, 0]])
def test_the_viewers_half_is_taken_away(towards):
    """Nothing of the half that stays is on the viewer's side of the axis."""
    for fitting in FITTINGS:
        assert (cutaway_mesh(fitting, towards).vertices @ towards).max() < 1e-6


@pytest.mark.parametrize(
    "part",
    [
        triangular_prism(0.012, 0.1),
        lug_row(0.0276, 0.006, 0.016, 6, 36),
        coil(0.0056, 0.0009, 0.02, 6, 14, 6),
    ],
)
def test_robot_parts_are_solids(part):
    """Chassis, lugs and springs are watertight with outward faces."""
    solid = Trimesh(*part, process=False)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(part.volume)
    assert part.volume > 0


def test_lug_row_reaches_the_module_radius():
    """The lugs that are drawn end at the radius of those that touch the wall, and stay on their own
    side."""
    row = lug_row(0.0276, 0.006, 0.016, 6, 36)
    assert np.hypot(row.vertices[:, 0], row.vertices[:, 1]).max() == pytest.approx(0.0276, abs=1e-6)
    assert row.vertices[:, 0].min() > 0
