"""Surfaces that films and pages paint: of geoms, of pipes that are cut open, of welds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from omnitrack_sim.base.rotations import Pose, frame_along, matrix_from_quaternion
from omnitrack_sim.pipes import Part, Straight
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.show.surfaces import (
    MARK_HEIGHT,
    PIPE,
    PLAIN,
    SEAM_HEIGHT,
    SEAM_WIDTH,
    SECTION,
    Surface,
    body_spheres,
    cut_pipe,
    geoms_surface,
    opened_pipe,
    pipe_inside,
    rings,
    seam,
)
from omnitrack_sim.walls.meshes import TriangleMesh, cut_normal, fitting_mesh

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><asset><material name="m" rgba=".1 .2 .3 1" specular=".7"/>
    <mesh name="wedge" vertex="0 0 0  .03 0 0  0 .02 0  0 0 .01"/></asset><worldbody>
    <geom type="box" size=".01 .02 .03" pos=".1 0 0" euler="20 30 40" rgba=".5 .6 .7 1"/>
    <body pos="1 2 3"><geom type="sphere" size=".02"/></body>
    <body><geom type="capsule" size=".01 .03" pos="0 .2 0" euler="90 0 0" material="m"/></body>
    <body><geom type="cylinder" size=".01 .02" euler="0 45 0"/></body>
    <body><geom type="ellipsoid" size=".01 .02 .03" euler="10 0 70"/></body>
    <body><geom type="mesh" mesh="wedge"/></body></worldbody></mujoco>"""
)
NEEDS = {"straight": {"length": 0.5}, "elbow": {"mean_radius": 0.24}}
VOLUMES = {
    "box": 8 * 0.01 * 0.02 * 0.03,
    "sphere": 4 / 3 * np.pi * 0.02**3,
    "capsule": np.pi * 0.01**2 * 0.06 + 4 / 3 * np.pi * 0.01**3,
    "cylinder": np.pi * 0.01**2 * 0.04,
    "ellipsoid": 4 / 3 * np.pi * 0.01 * 0.02 * 0.03,
    "mesh": 0.03 * 0.02 * 0.01 / 6,
}


def volume(surface: Surface) -> float:
    """Of what the triangles enclose, m3; they are counterclockwise from outside."""
    return volume_of(TriangleMesh(surface.position, surface.faces))


def volume_of(mesh: TriangleMesh) -> float:
    """Of what a mesh encloses, m3."""
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[mesh.faces], 1, 0)
    return float((a * np.cross(b, c)).sum()) / 6


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize("kind", VOLUMES)
def test_a_geom_is_drawn_where_it_is(kind, fine):
    """Its volume, its middle and its second moments in the frame of its body; round ones are a
    little smaller, the finer the less; normals point out of it."""
    geom = list(VOLUMES).index(kind)
    surface = geoms_surface(MODEL, [geom], fine)
    short = {"box": 0, "mesh": 0}.get(kind, 0.05 if fine else 0.12)
    assert (1 - short) * (1 - 1e-6) < volume(surface) / VOLUMES[kind] < 1 + 1e-6
    assert set(surface.body) == {MODEL.geom_bodyid[geom]}
    points = surface.position - MODEL.geom_pos[geom]
    local = points @ matrix_from_quaternion(MODEL.geom_quat[geom])
    sizes = {"sphere": [0.02] * 3, "capsule": [0.01, 0.01, 0.04], "cylinder": [0.01, 0.01, 0.02]}
    box = np.array(sizes.get(kind, [0.01, 0.02, 0.03]))
    if kind != "mesh":
        assert np.allclose(np.abs(local).max(axis=0), box, rtol=1e-5)
        outward = (points * surface.normal).sum(axis=1)
        assert (outward > 0.3 * box.min()).all()
    assert np.allclose(np.linalg.norm(surface.normal, axis=1), 1)
    a, b, c = np.moveaxis(surface.position[surface.faces], 1, 0)
    flat = np.cross(b - a, c - a)
    assert ((flat[:, None] * surface.normal[surface.faces]).sum(axis=-1) > 0).all()


def test_colours_are_those_of_the_model():
    """Of the geom, or of its material with its gloss; one that states none has a plain one."""
    surface = geoms_surface(MODEL, range(MODEL.ngeom))
    colours = {int(b): surface.colour[surface.body == b] for b in set(surface.body)}
    assert np.allclose(colours[0], [0.5, 0.6, 0.7, 0.25])
    assert np.allclose(colours[1], [*PLAIN, 0.25])
    assert np.allclose(colours[2], [0.1, 0.2, 0.3, 0.7])
    centres, radii = body_spheres(surface, MODEL.nbody + 1)
    assert radii[MODEL.nbody] == 0
    for body in range(MODEL.nbody):
        points = surface.position[surface.body == body]
        far = np.linalg.norm(points - centres[body], axis=1)
        assert far.max() == pytest.approx(radii[body])


def test_a_weld_is_a_low_ridge_at_its_port():
    """In the bore, as wide and as high as it is stated; cut away on the side of the viewer."""
    port = Pose(frame_along([0.6, 0.0, 0.8], 0.3), np.array([1.0, 2.0, 3.0]))
    away = port.rotation[:, 0]
    weld = seam(port, 0.08, away)
    local = (weld.position - port.position) @ port.rotation
    assert np.ptp(local[:, 2]) == pytest.approx(SEAM_WIDTH)
    assert np.abs(local[:, 2]).max() == pytest.approx(SEAM_WIDTH / 2)
    off = 0.08 - np.linalg.norm(local[:, :2], axis=1)
    assert off.max() == pytest.approx(SEAM_HEIGHT)
    assert off.min() == pytest.approx(0.3 * SEAM_HEIGHT)
    # Highest in the middle, and seen from within the bore.
    assert np.allclose(off[np.abs(local[:, 2]) < 1e-9], SEAM_HEIGHT)
    inward = -(weld.normal @ port.rotation)[:, :2] * local[:, :2]
    assert (inward.sum(axis=1) > 0).all()
    faces = weld.position[weld.faces]
    assert ((faces.mean(axis=1) - port.position) @ away <= 0).all()
    a, b, c = np.moveaxis(faces, 1, 0)
    assert ((np.cross(b - a, c - a) * weld.normal[weld.faces[:, 0]]).sum(axis=1) > 0).all()
    around = np.arctan2(*local[np.unique(weld.faces)][:, 1::-1].T)
    assert np.abs(around).min() == pytest.approx(np.pi / 2, abs=0.14)


def test_rings_lie_on_the_wall_as_it_is():
    """Rings in a pipe with relief are whole, and as high over its wall as in an ideal one."""
    relief = [
        {"kind": "ovality", "ratio": 0.1, "direction_deg": 20.0},
        {"kind": "deposit", "at": 0.5, "length": 0.6, "depth": 0.03, "angle_deg": 0.0},
    ]
    fitting = Straight(1.0, relief=relief)
    old, ideal = (rings(Part("pipe", each, Pose())) for each in (fitting, Straight(1.0)))
    assert [len(ring.faces) for ring in old] == [len(ring.faces) for ring in ideal]
    corners = np.concatenate([ring.position for ring in old])
    normals = np.concatenate([ring.normal for ring in old])
    distance, gradient = fitting.signed_distance(corners)
    np.testing.assert_allclose(distance, MARK_HEIGHT * 0.16, atol=2e-5)
    np.testing.assert_allclose(normals, gradient, atol=1e-3)


@pytest.mark.parametrize("kind", ["straight", "elbow", "tee", "wye"])
def test_a_pipe_is_cut_open_on_the_side_of_its_viewer(kind):
    """What stays lies away from the viewer; both halves are the wall; the bore is seen from within,
    with its true normals; of what stays only the cut has the colour of a section."""
    fitting = fitting_class(kind)(**NEEDS.get(kind, {}))
    towards = np.array([0.2, 1.0, 0.1])
    normal = cut_normal(fitting, towards)
    kept, front, inside = opened_pipe(fitting, towards, 72)
    assert (kept.position @ normal).max() < 1e-6
    assert (front.position @ normal).min() > -1e-6
    whole = volume_of(fitting_mesh(fitting, sections=72))
    assert volume(kept) + volume(front) == pytest.approx(whole, rel=1e-4)
    alone = cut_pipe(fitting, towards)
    assert volume(alone) == pytest.approx(volume(kept), rel=1e-3)
    for surface in (inside, pipe_inside(fitting)):
        distance, inward = fitting.signed_distance(surface.position)
        assert np.abs(distance).max() < 1e-3
        # At an end its ring is square to the bore.
        aligned = (surface.normal * inward).sum(axis=-1)
        assert (aligned < -0.3).mean() < 0.005
        assert (aligned > 0.97).mean() > 0.6
    is_cut = np.isclose(kept.colour[:, :3], SECTION).all(axis=1)
    assert 0 < is_cut.sum() < len(is_cut)
    assert np.allclose(kept.colour[~is_cut, :3], PIPE)
    assert np.abs(kept.position[is_cut] @ normal).max() < 1e-6
    assert np.allclose(kept.normal[is_cut], normal, atol=0.05)
    assert not np.isclose(inside.colour[:, :3], SECTION).all(axis=1).any()
