"""Exact pipes around any robot: contacts of its geoms with every fitting, and their physics."""

import copy
import importlib
import math
import pickle
import re
import subprocess
import sys
import warnings
from itertools import product
from pathlib import Path

import contact_accuracy
import mujoco
import mujoco.rollout
import numpy as np
import pytest
import thrown_bodies
from in_pipes import swing_period
from mujoco import batch
from scipy.spatial import ConvexHull

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, frame_along, unit
from omnitrack_sim.pipes import Assembly, Elbow, Part, Reducer, Step, Straight, Tee, Wye, route
from omnitrack_sim.pipes.compiled import Wall, compiled
from omnitrack_sim.walls.record import has_record

GEOM = mujoco.mjtGeom
MARGIN = 0.004
_STRAIGHT = Straight.wall.surface


def alone(fitting):
    """One fitting at the origin."""
    return Assembly((Part("pipe", fitting, Pose()),))


def in_a_row(*steps):
    """Fittings one after the other: (fitting, enter, leave)."""
    return route([Step(f"part_{i}", *step) for i, step in enumerate(steps)]).network


def straights(*fittings):
    """Fittings of two ports one after the other."""
    return in_a_row(*((fitting, "start", "end") for fitting in fittings))


NETWORKS = {
    "straight": alone(Straight(0.4)),
    "elbow": alone(Elbow(0.24)),
    "elbow_tight": alone(Elbow(0.09)),
    "tee": alone(Tee()),
    "wye": alone(Wye(angle=math.radians(50))),
    "reducer": alone(Reducer(0.15, 0.12)),
    "onto_elbow": straights(Straight(0.3), Elbow(0.12), Straight(0.3)),
    "s_bend": straights(Elbow(0.12), Elbow(0.12)),
    "wide_end": straights(Straight(0.3), Reducer(0.2, 0.12)),
    "narrow_end": straights(Straight(0.2), Reducer(0.1, 0.12), Straight(0.2, 0.12)),
    "narrow_end_to_elbow": straights(Reducer(0.1, 0.12), Elbow(0.12, inner_diameter=0.12)),
    "tee_to_elbow": in_a_row((Tee(), "run_start", "branch"), (Elbow(0.12), "start", "end")),
}
SHAPES = {
    "sphere": {"type": GEOM.mjGEOM_SPHERE, "size": [0.025, 0, 0]},
    "capsule": {"type": GEOM.mjGEOM_CAPSULE, "size": [0.015, 0.04, 0]},
    "wheel": {"type": GEOM.mjGEOM_CYLINDER, "size": [0.03, 0.01, 0]},
    "roller": {"type": GEOM.mjGEOM_CYLINDER, "size": [0.012, 0.04, 0]},
    "ellipsoid": {"type": GEOM.mjGEOM_ELLIPSOID, "size": [0.035, 0.02, 0.012]},
    "box": {"type": GEOM.mjGEOM_BOX, "size": [0.03, 0.02, 0.01]},
    "mesh": {"type": GEOM.mjGEOM_MESH, "meshname": "stone"},
}
_POINTS = unit(np.random.default_rng(5).normal(size=(24, 3))) * [0.03, 0.02, 0.025]


def body_in(network, shape, walls=None, **attributes):
    """Model of a free body of one geom in pipes, without gravity; and the pipes."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    spec.add_mesh(name="stone", uservert=_POINTS.ravel())
    pipes = ot.add_pipes(spec, network, **walls or {})
    body = spec.worldbody.add_body(name="body")
    body.add_freejoint()
    body.add_geom(name="geom", **SHAPES[shape] | attributes)
    return spec.compile(), pipes


def surface(model, shape):
    """Points (n, 3) m all over a geom's surface, geom frame: 2 mm apart at most."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 161), np.linspace(0, 1, 41))
    c, s = np.cos(u), np.sin(u)
    a, b, size = *SHAPES[shape].get("size", [0, 0, 0])[:2], SHAPES[shape].get("size")
    if shape in ("sphere", "ellipsoid"):
        half = [a, a, a] if shape == "sphere" else size
        sin, cos = np.sin(np.pi * v), np.cos(np.pi * v)
        grids = [np.stack([c * sin, s * sin, cos], axis=-1) * half]
    elif shape == "capsule":
        cap = np.pi / 2 * v
        cap = a * np.stack([c * np.sin(cap), s * np.sin(cap), np.cos(cap)], axis=-1) + [0, 0, b]
        grids = [np.stack([a * c, a * s, b * (2 * v - 1)], axis=-1), cap, cap * [1, 1, -1]]
    elif shape in ("wheel", "roller"):
        lid = np.stack([a * v * c, a * v * s, b + 0 * v], axis=-1)
        grids = [np.stack([a * c, a * s, b * (2 * v - 1)], axis=-1), lid, lid * [1, 1, -1]]
    else:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        vertices = corners * size if shape == "box" else model.mesh_vert.astype(float)
        grids = [_faces(vertices)]
    return np.concatenate([grid.reshape(-1, 3) for grid in grids])


def _faces(vertices):
    """Points on all triangles of a convex hull."""
    weights = np.array([[i, j, 24 - i - j] for i in range(25) for j in range(25 - i)]) / 24
    return weights @ vertices[ConvexHull(vertices).simplices]


def min_distance(network, points, position, rotation):
    """Least distance, m, of a body's surface from the walls: of dense samples, and on from the best
    by the slope between them is below the tolerance."""
    distance, _ = network.signed_distance(points @ rotation.T + position)
    return distance.min()


def poses_near_the_wall(network, points, count, seed):
    """Positions, rotations and least distances of a body that just touches, over joints too."""
    rng = np.random.default_rng(seed)
    reach = np.linalg.norm(points, axis=1).max()
    ends = [network.parts[i].port(port) for i, port in network.open_ends]
    joints = [network.parts[i].port(port).position for (i, port), _ in network.joints]
    while count:
        part = network.parts[rng.integers(len(network.parts))]
        low, high = part.fitting.bounds
        centre = part.pose.apply(rng.uniform(low, high))
        if joints and count % 2:
            centre = joints[rng.integers(len(joints))] + rng.uniform(-0.06, 0.06, 3)
        distance, gradient = network.signed_distance(centre)
        rotation = np.empty(9)
        quaternion = rng.normal(size=4)
        mujoco.mju_quat2Mat(rotation, quaternion / np.linalg.norm(quaternion))
        rotation = rotation.reshape(3, 3)
        if distance < 0.0:
            continue
        # Some of the samples lead to the wall; all of them measure there.
        for _ in range(6):
            if abs(least := min_distance(network, points[::16], centre, rotation)) < 0.4e-3:
                break
            centre = centre - gradient * np.clip(least + 0.2e-3, -0.02, 0.02)
        least = min_distance(network, points, centre, rotation)
        # What is nearest beyond an open end is not the walls.
        open_end = any(abs(end.inverse().apply(centre)[2]) < reach + 0.01 for end in ends)
        if abs(least) < 0.5e-3 and not open_end:
            count -= 1
            yield centre, rotation, least


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", NETWORKS)
def test_the_deepest_contact_is_as_deep_as_the_body(name, shape):
    """The least distance of the contacts is that of dense samples of the body's surface, within
    0.05 mm and what lies between the samples; in every fitting, over joints, in any pose."""
    network = NETWORKS[name]
    model, _ = body_in(network, shape, margin=MARGIN)
    data, points = mujoco.MjData(model), surface(model, shape)
    poses = poses_near_the_wall(network, points, 6, seed=len(name + shape))
    for position, rotation, sampled in poses:
        # MuJoCo turns a mesh into its principal axes: the geom is what is placed.
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, model.geom("geom").quat)
        rotation = rotation @ turned.reshape(3, 3).T
        mujoco.mju_mat2Quat(data.qpos[3:], rotation.ravel())
        data.qpos[:3] = position - rotation @ model.geom("geom").pos
        mujoco.mj_forward(model, data)
        # A sample is up to 1.5 mm off the nearest point of a body that curves with 12 mm.
        assert sampled - 0.15e-3 < data.contact.dist.min() < sampled + 0.05e-3


@pytest.mark.parametrize("shape", contact_accuracy.SHAPES)
@pytest.mark.parametrize("walls", ["reducer's joints", "open end"])
def test_the_min_distance_is_that_of_an_independent_search(walls, shape):
    """To 0.02 mm, up to 0.5 mm off walls and edges; 0.1 mm deep across an edge to 0.03 mm."""
    worst = np.abs(contact_accuracy.errors(walls, shape, 3, seed=2)).max()
    assert worst < (0.03e-3 if walls == "open end" else 0.02e-3)


@pytest.mark.parametrize("shape", ["sphere", "capsule", "roller", "ellipsoid"])
def test_the_side_of_a_body_touches_the_inner_side_of_a_bend(shape):
    """A body that lies along the inner side of an elbow touches with the middle of its side."""
    elbow = Elbow(0.24)
    model, _ = body_in(alone(elbow), shape, margin=MARGIN)
    data, half = mujoco.MjData(model), SHAPES[shape]["size"]
    thick = half[2] if shape == "ellipsoid" else half[0]
    # The bend's axis is at x = 0.24, parallel to y; its inner side is 0.16 from it.
    from_axis, angle = 0.16 + thick + 0.3e-3, math.radians(40)
    inward = np.array([math.cos(angle), 0, -math.sin(angle)])
    along = np.array([math.sin(angle), 0, math.cos(angle)])
    frame = (
        np.stack([along, np.cross(inward, along), inward], axis=-1)
        if shape == "ellipsoid"
        else np.stack([inward, np.cross(along, inward), along], axis=-1)
    )
    mujoco.mju_mat2Quat(data.qpos[3:], frame.ravel())
    data.qpos[:3] = [0.24, 0, 0] - from_axis * inward
    mujoco.mj_forward(model, data)
    assert data.contact.dist.min() == pytest.approx(0.3e-3, abs=1e-6)


@compiled
def _narrow_surface(sizes, x, y, z, out):
    """A straight whose bore is 10 mm narrower than it says."""
    return _STRAIGHT(sizes, x, y, z, out) - 0.01


class Narrow(Straight):
    """A fitting from outside the package."""

    kind = "narrow"
    wall = Wall(_narrow_surface, Straight.wall.span)


def test_a_fitting_of_ones_own_is_a_wall_like_any_other():
    """Bodies touch the surface that its compiled function states."""
    network = alone(Narrow(0.4))
    for shape, radius in (("sphere", 0.025), ("capsule", 0.015)):
        model, _ = body_in(network, shape, margin=MARGIN)
        data = mujoco.MjData(model)
        data.qpos[:3] = [0.07 - radius - 0.001, 0, 0.2]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.contact.dist, 0.001, atol=1e-12)


BORE = 0.08


@pytest.mark.parametrize("shape", SHAPES)
def test_an_open_end_is_an_edge(shape):
    """A body that hangs out of a pipe touches its end: the deepest contact is no less deep than the
    edge lies in the body, by MuJoCo's own distance of geoms, and one with the edge is not twice as
    deep."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="stone", uservert=_POINTS.ravel())
    ot.add_pipes(spec, alone(Straight(0.4)))
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(name="geom", margin=MARGIN, **SHAPES[shape])
    probe = spec.worldbody.add_body(mocap=True)
    probe.add_geom(name="probe", size=[1e-6, 0, 0], contype=0, conaffinity=0)
    model = spec.compile()
    data, rng, seen = mujoco.MjData(model), np.random.default_rng(3), 0
    geom, probe = model.geom("geom").id, model.geom("probe").id
    angles = np.linspace(-0.7, 0.7, 1401)
    edge = np.stack([BORE * np.cos(angles), BORE * np.sin(angles), 0.4 + 0 * angles], axis=-1)
    for _ in range(30):
        data.qpos[:3] = [rng.uniform(0.03, 0.07), 0, 0.4 + rng.uniform(-0.01, 0.02)]
        data.qpos[3:] = rng.normal(size=4)
        least = MARGIN
        for data.mocap_pos[0] in edge:
            mujoco.mj_kinematics(model, data)
            gap = mujoco.mj_geomDistance(model, data, geom, probe, 2 * MARGIN, None)
            least = min(least, gap + 1e-6)
        mujoco.mj_forward(model, data)
        if not -2e-3 < least < MARGIN / 2:
            continue
        at_edge = [c.dist for c in data.contact if "rim" in model.geom(c.geom[0]).name]
        # Probes are 0.08 mm apart, so that a probe misses the deepest place by some micrometres.
        assert data.contact.dist.min() < least + 0.02e-3
        # Between the walls' normals the way out of a body may be longer than to its nearest face.
        assert min(at_edge, default=least) > least + min(least, 0.0) - 0.05e-3
        seen += len(at_edge) > 0
    assert seen > 0


RESTS = {
    "sphere": BORE - 0.025,
    "capsule": BORE - 0.015,
    "wheel": math.sqrt(BORE**2 - 0.01**2) - 0.03,
    "ellipsoid": BORE - 0.012,
    "box": math.sqrt(BORE**2 - 0.02**2) - 0.01,
    "brick": math.sqrt(BORE**2 - 0.02**2) - 0.01,
}
"""Depth of a body's centre below the axis of a level bore, m: a capsule lies along it, a wheel
stands across it."""
BRICK = {"type": GEOM.mjGEOM_MESH, "meshname": "brick"}
_CORNERS = [[x, y, z] for x in (-0.03, 0.03) for y in (-0.02, 0.02) for z in (-0.01, 0.01)]


def lying(shape, **attributes):
    """Model of a body that is laid onto the ground of a level bore along x, friction 0.5."""
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100
    spec.add_mesh(name="brick", uservert=np.ravel(_CORNERS))
    network = ot.Network(
        place={"axis": (1, 0, 0)},
        fittings=[
            {"kind": "straight", "name": "one", "length": 0.5},
            {"kind": "straight", "name": "two", "length": 0.5},
        ],
        joints=[{"ports": ("one.end", "two.start")}],
    )
    ot.add_pipes(spec, network, friction=0.5, **attributes)
    turn = {"capsule": [0.5**0.5, 0, 0.5**0.5, 0], "wheel": [0.5**0.5, 0.5**0.5, 0, 0]}
    body = spec.worldbody.add_body(
        name="body", pos=[0.25, 0, -RESTS[shape]], quat=turn.get(shape, [1, 0, 0, 0])
    )
    body.add_freejoint()
    body.add_geom(name="geom", **BRICK if shape == "brick" else SHAPES[shape])
    return spec.compile()


@pytest.mark.parametrize("shape", RESTS)
def test_a_body_lies_at_its_depth_and_presses_with_its_weight(shape):
    """It rests where the closed form has it, 0.4 mm in at most; contacts carry m g
    to 0.1 %, and at rest none is made or lost."""
    model = lying(shape)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1500)
    counts = set()
    for _ in range(100):
        mujoco.mj_step(model, data)
        counts.add(data.ncon)
    assert len(counts) == 1
    assert -0.4e-3 < RESTS[shape] + data.body("body").xpos[2] - model.geom("geom").pos[2] < 1e-5
    # Forces of contacts on the body, N: what holds it against gravity.
    mujoco.mj_rnePostConstraint(model, data)
    weight = 9.81 * model.body_mass.sum()
    assert data.qfrc_constraint[2] == pytest.approx(weight, rel=1e-3)
    assert abs(data.qvel).max() < 1e-4


@pytest.mark.parametrize("shape", ["box", "brick"])
def test_a_box_slides_at_the_friction_that_its_edges_find(shape):
    """Its edges stand against walls that lean, which press with m g / cos(lean): from mu times that
    on it slides, along two pipes."""
    model = lying(shape)
    steepest = 0.5 / math.sqrt(1 - (0.02 / BORE) ** 2)
    for part, slides in ((0.97, False), (1.03, True)):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 300)
        model.opt.gravity[:] = [9.81 * part * steepest, 0, -9.81]
        start = data.qpos[0]
        mujoco.mj_step(model, data, 500)
        assert (data.qpos[0] - start > 0.05) == slides
        model.opt.gravity[:] = [0, 0, -9.81]


_X, _Y, _Z = np.eye(3)
_OUT, _ON = np.array([-1, 0, 1]) / math.sqrt(2), np.array([1, 0, 1]) / math.sqrt(2)
"""Away from the axis of an elbow, half way round it, and along its centreline there."""
FLOORS = {
    "bore": (Straight(0.5), [-0.08, 0, 0.25], _X, _Z),
    "flat elbow": (Elbow(0.24), 0.24 * (_X + _OUT) - 0.08 * _Y, _Y, _ON),
    "sag of an elbow": (Elbow(0.24), 0.24 * _X + 0.32 * _OUT, -_OUT, _ON),
    "tee's rim": (Tee(), [0.095, 0, -0.08], _Z, _X),
    "wye's rim": (Wye(angle=math.pi / 2, branch_diameter=0.12), [0.1, 0, -0.06], _Z, _X),
}
"""A fitting, the lowest place (3,) m of its wall, and the directions up and along it there."""


@pytest.mark.parametrize("shape", ["wheel", "roller", "box", "brick"])
@pytest.mark.parametrize("name", FLOORS)
def test_a_body_at_rest_lies_still(name, shape):
    """A wheel, a roller, a box and a pad, which is a mesh, lie on the ground of each fitting, half
    over a rim of a tee, without a contact made or lost, and the contacts carry their weight."""
    fitting, floor, up, along = FLOORS[name]
    across = np.cross(along, up)
    axes = [along, -across, up] if shape in ("box", "brick") else [up, across, along]
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.impratio, spec.option.gravity = 10, -9.81 * up
    spec.add_mesh(name="brick", uservert=np.ravel(_CORNERS))
    ot.add_pipes(spec, alone(fitting), friction=0.6)
    body = spec.worldbody.add_body(name="body", pos=floor + 0.035 * up)
    mujoco.mju_mat2Quat(body.quat, np.stack(axes, axis=-1).ravel())
    # The damping is that of some grease: nothing else stops a wheel that rolls to and fro.
    body.add_freejoint().damping[0] = 3e-4
    body.add_geom(**BRICK if shape == "brick" else SHAPES[shape])
    model = spec.compile()
    data, counts = mujoco.MjData(model), []
    mujoco.mj_step(model, data, 3000)
    for _ in range(500):
        mujoco.mj_step(model, data)
        counts.append(data.ncon)
    assert counts == counts[:1] * 500
    assert np.abs(data.qvel).max() < 2e-3
    weight = model.body("body").mass[0] * 9.81
    carried = data.qfrc_constraint[:3] - weight * up
    assert np.abs(carried).max() < 1e-3 * weight


def test_the_robots_own_geom_decides_unless_the_walls_state_a_friction():
    """MuJoCo's rules: without a friction of the walls all is the geom's; with one, the walls
    outrank it; a priority of the geom's above theirs wins."""
    own = {"friction": [0.3, 0.01, 0.002], "condim": 6, "solref": [0.03, 2], "margin": 0.001}
    for walls, geom, friction, dimension, solref in (
        ({}, {}, 0.3, 6, 0.03),
        ({"friction": 0.7}, {}, 0.7, 3, 0.005),
        ({"friction": 0}, {}, 1e-5, 1, 0.005),
        ({"friction": 0.7}, {"priority": 2}, 0.3, 6, 0.03),
        ({"friction": 0.7, "solref": [0.01, 1]}, {}, 0.7, 3, 0.01),
    ):
        spec = mujoco.MjSpec()
        body = spec.worldbody.add_body(pos=[0.056, 0, 0.2])
        body.add_freejoint()
        body.add_geom(**SHAPES["sphere"] | own | geom)
        ot.add_pipes(spec, NETWORKS["straight"], **walls)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        (contact,) = data.contact
        assert contact.friction[0] == friction
        assert (contact.dim, contact.solref[0]) == (dimension, solref)


def test_a_ball_swings_in_a_bore_like_a_pendulum():
    """Without friction its period is that of a pendulum as long as its centre is off the axis, to
    0.1 % at 1 ms."""
    spec, length, angle = mujoco.MjSpec(), BORE - 0.02, 0.05
    spec.option.timestep = 0.001
    network = ot.Network(
        place={"axis": (1, 0, 0)}, fittings=[{"kind": "straight", "name": "level", "length": 1}]
    )
    ot.add_pipes(spec, network, priority=1, solref=[0.004, 1])
    start = [0.5, length * math.sin(angle), -length * math.cos(angle)]
    measured, period = swing_period(spec, start, 0.02, length, angle)
    assert measured == pytest.approx(period, rel=1e-3)


def test_a_wheel_rolls_down_an_inclined_pipe_without_slipping():
    """A full cylinder gains two thirds of gravity's part along the pipe, to 0.1 % at 1 ms, and its
    speed is its radius times its rate of turning."""
    spec, slope = mujoco.MjSpec(), math.radians(20)
    spec.option.timestep, spec.option.impratio = 0.001, 100
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.gravity = 9.81 * np.array([math.sin(slope), 0, -math.cos(slope)])
    network = ot.Network(
        place={"axis": (1, 0, 0)}, fittings=[{"kind": "straight", "name": "ramp", "length": 4}]
    )
    ot.add_pipes(spec, network, friction=0.8, solref=[0.004, 1])
    body = spec.worldbody.add_body(pos=[0.3, 0, -RESTS["wheel"]], quat=[0.5**0.5, 0.5**0.5, 0, 0])
    for axis in ([1, 0, 0], [0, 1, 0]):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    body.add_geom(**SHAPES["wheel"])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    begin, time = data.qvel.copy(), data.time
    mujoco.mj_step(model, data, 700)
    gain = (data.qvel - begin) / (data.time - time)
    assert gain[0] == pytest.approx(2 / 3 * 9.81 * math.sin(slope), rel=1e-3)
    assert abs(gain[2]) * 0.03 == pytest.approx(gain[0], rel=1e-3)


def test_pipes_on_a_body_move_with_it():
    """Contacts are the same wherever the body that carries the pipes is, and it weighs what it
    weighed."""
    spec = mujoco.MjSpec()
    carrier = spec.worldbody.add_body(mass=2.0, inertia=[0.1, 0.1, 0.1], explicitinertial=True)
    carrier.add_freejoint()
    ot.add_pipes(spec, NETWORKS["tee_to_elbow"], body=carrier)
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(**SHAPES["box"], margin=MARGIN)
    model = spec.compile()
    assert model.body_mass[1] == 2.0
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    data.qpos[7:] = [-0.063, 0, 0.1, *rng.normal(size=4)]
    mujoco.mj_forward(model, data)
    before = data.contact.dist.copy()
    rotation, place = rng.normal(size=4), rng.normal(size=3)
    rotation /= np.linalg.norm(rotation)
    data.qpos[:7] = [*place, *rotation]
    turned, quaternion = np.empty(3), np.empty(4)
    mujoco.mju_rotVecQuat(turned, data.qpos[7:10], rotation)
    mujoco.mju_mulQuat(quaternion, rotation, data.qpos[10:14])
    data.qpos[7:] = [*(place + turned), *quaternion]
    mujoco.mj_forward(model, data)
    assert len(before) > 0
    np.testing.assert_allclose(data.contact.dist, before, atol=1e-12)


@pytest.mark.parametrize("timestep", [0.001, 0.002])
@pytest.mark.parametrize("name", ["straight", "elbow", "tee", "wye"])
def test_fast_bodies_stay_in_the_pipe(name, timestep):
    """Bodies of all shapes at 12 m/s bounce about and do not get through the walls: 120 mm deep
    with MuJoCo's contact time of 20 ms, 60 mm with 5 ms."""
    network = NETWORKS[name]
    fitting, rng = network.parts[0].fitting, np.random.default_rng(7)
    stiff = {"friction": 0.8}
    for shape, (walls, depth) in product(SHAPES, (({}, 0.12), (stiff, 0.06))):
        model, pipes = body_in(network, shape, walls)
        model.opt.timestep = timestep
        for _ in range(4):
            data = mujoco.MjData(model)
            low, high = fitting.bounds
            while not pipes.clearance(data.qpos[:3]) > 0.045:
                data.qpos[:3] = rng.uniform(low, high)
            data.qvel[:3] = 12.0 * unit(rng.normal(size=3))
            data.qvel[3:] = rng.uniform(-50, 50, 3)
            for _ in range(60):
                mujoco.mj_step(model, data)
                if fitting.extent(data.qpos[None, :3])[0] < 0:
                    break  # out of a port
                assert pipes.clearance(data.qpos[:3]) > -depth


@pytest.mark.parametrize(("friction", "most"), [(None, 0.06), (0.0, 0.04)])
@pytest.mark.parametrize("name", ["straight", "wye", "reducer"])
def test_bodies_thrown_into_closed_pipes_stay_there(name, friction, most):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later, by their own soft
    contact and by that of the walls; corners between walls and caps hold them, and walls of which
    the next pipe leaves 66 mm."""
    network = thrown_bodies.fitting_alone(thrown_bodies.FITTINGS[name])
    for shape, timestep in product(thrown_bodies.SHAPES, (0.001, 0.002)):
        out, deepest = thrown_bodies.throw(network, shape, timestep, friction, 3, seed=2)
        assert out == 0
        assert deepest < most


def test_bodies_thrown_into_pipes_beside_each_other_stay_there():
    """In a bend back, whose limbs are 20 mm apart, bodies with soft contact at 1 to 12 m/s are in a
    bore half a second later."""
    network = thrown_bodies.capped(thrown_bodies.NETWORKS["bend back"])
    for shape in ("capsule", "wheel", "ellipsoid"):
        assert thrown_bodies.throw(network, shape, 0.001, None, 40, seed=1)[0] == 0


@pytest.mark.parametrize(
    ("walls", "geom", "firmness"),
    [
        ({}, {}, 16.0),
        ({}, {"solref": [0.01, 0.8]}, 2.56),
        ({}, {"solref": [-1e4, -50]}, 4.0),
        ({}, {"solref": [0.002, 1]}, 1.0),
        ({"friction": 0.7}, {}, 1.0),
        ({"friction": 0.7}, {"priority": 2}, 16.0),
        ({"solref": [0.01, 1], "solmix": 3}, {}, (0.0125 / 0.005) ** 2),
        ({"solref": [0.01, 1], "solmix": 3}, {"solref": [-1e4, -50]}, 4.0),
    ],
)
def test_soft_contact_is_as_stiff_as_a_firm_one_from_a_tenth_of_the_bores_radius_on(
    walls, geom, firmness
):
    """The depth beyond 8 mm counts as often as the stiffness of 5 ms is that of the contact."""
    model, _ = body_in(NETWORKS["straight"], "sphere", walls, **geom)
    data = mujoco.MjData(model)
    for depth in (0.002, 0.0079, 0.02, 0.05):
        data.qpos[:3] = [0.055 + depth, 0.0, 0.2]
        mujoco.mj_forward(model, data)
        (contact,) = data.contact
        assert contact.dist == pytest.approx(-depth - (firmness - 1) * max(depth - 0.008, 0))


def test_a_wall_beside_another_pipe_holds_what_has_not_come_half_way():
    """Of two pipes 10 mm apart each holds a capsule that points far into its wall, on the side away
    from the other however far, and neither touches one in the other."""
    other = Part("other", Straight(0.4), Pose(np.eye(3), [0.17, 0.0, 0.0]))
    model, _ = body_in(Assembly((*NETWORKS["straight"].parts, other)), "capsule")
    data = mujoco.MjData(model)
    for x, touched in (
        (0.05, "wall_pipe"),
        (0.084, "wall_pipe"),
        (-0.12, "wall_pipe"),
        (0.12, "wall_other"),
    ):
        data.qpos[:3] = [x, 0.0, 0.2]
        data.qpos[3:] = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]  # along x
        mujoco.mj_forward(model, data)
        assert {model.geom(each.geom[0]).name for each in data.contact} == {touched}


@pytest.mark.parametrize("geom", [{}, {"solref": [-1e4, -50]}])
def test_a_wall_is_thin_towards_another_pipe_only(geom):
    """Beside a pipe 10 mm apart, on the side away from it, a ball that has sunk in is held by as
    deep a wall, and one as soft, as in a pipe alone."""
    other = Part("other", Straight(0.4), Pose(np.eye(3), [0.17, 0.0, 0.0]))
    alone = NETWORKS["straight"]
    found = []
    for network in (alone, Assembly((*alone.parts, other))):
        model, _ = body_in(network, "sphere", **geom)
        data = mujoco.MjData(model)
        for depth in (0.004, 0.007, 0.03, 0.08, 0.12):
            data.qpos[:3] = [-0.055 - depth, 0.0, 0.2]
            mujoco.mj_forward(model, data)
            (contact,) = data.contact
            found.append((contact.dist, *contact.frame[:3]))
    np.testing.assert_allclose(found[:5], found[5:], atol=1e-12)


@pytest.mark.parametrize(
    ("walls", "geom"),
    [
        ({}, {}),
        ({}, {"solref": [-1e3, -20]}),
        ({}, {"solref": [0.002, 1]}),
        ({"friction": 0.7}, {"priority": 2}),
        ({"solref": [0.01, 1], "solmix": 3}, {"solref": [-1e4, -50]}),
    ],
)
def test_a_plate_is_as_firm_as_a_wall(walls, geom):
    """A ball that has sunk into the end of a cap is pushed out along the axis, with the stiffness
    and damping of a ball as deep in the wall, also beside the bore."""
    network = Assembly((Part("pipe", ot.Cap(0.4), Pose()),))
    model, _ = body_in(network, "sphere", walls, **geom)
    data, found = mujoco.MjData(model), []
    for depth in (0.002, 0.0079, 0.02, 0.05, 0.1):
        for aside, along in ((0.055 + depth, 0.2), (0.0, 0.375 + depth), (0.04, 0.375 + depth)):
            data.qpos[:3] = [aside, 0.0, along]
            mujoco.mj_forward(model, data)
            contact = data.contact[0]
            axis = 0 if along == 0.2 else 2
            assert contact.frame[axis] == pytest.approx(-1.0)
            found.append([contact.dist, *contact.solref, *contact.solimp])
    of_wall, of_plate, beside = np.array(found).reshape(5, 3, -1).transpose(1, 0, 2)
    np.testing.assert_allclose(of_plate, of_wall, atol=1e-12)
    np.testing.assert_allclose(beside, of_wall, atol=1e-12)


def test_a_plate_leaves_a_body_in_another_pipe_alone():
    """A closed end 10 mm before a pipe that passes it does not touch a ball in that pipe, which
    does not touch a ball in front of the end."""
    across = Pose(frame_along([1.0, 0.0, 0.0], 0.0), np.array([-0.2, 0.0, 0.49]))
    network = Assembly((Part("end", ot.Cap(0.4), Pose()), Part("across", Straight(0.4), across)))
    model, _ = body_in(network, "sphere")
    data = mujoco.MjData(model)
    for z, touched in ((0.43, "wall_across"), (0.415, "wall_across"), (0.38, "plate_end_end")):
        data.qpos[:3] = [0.0, 0.0, z]
        mujoco.mj_forward(model, data)
        assert {model.geom(each.geom[0]).name for each in data.contact} == {touched}


def tumbling():
    """Model of a body of seven geoms that tumbles through an elbow, and its state."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="stone", uservert=_POINTS.ravel())
    body = spec.worldbody.add_body(name="body", pos=[0, 0, 0.15])
    body.add_freejoint()
    for i, shape in enumerate(SHAPES.values()):
        body.add_geom(**shape, pos=[0.02 * (i - 3), 0.01 * (i % 3), 0.0])
    ot.add_pipes(spec, NETWORKS["onto_elbow"], friction=0.6)
    return spec, spec.compile()


def test_copies_pickles_and_threads_give_the_same_bytes():
    """A state goes on alike in data, in their copies and pickles, and in rollouts by any number of
    threads."""
    _, model = tumbling()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert data.ncon > 0
    others = [copy.copy(data), pickle.loads(pickle.dumps(data))]
    models = [copy.copy(model), pickle.loads(pickle.dumps(model))]
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_step(model, data, 100)
    for other, its_model in zip(others, models, strict=True):
        mujoco.mj_step(its_model, other, 100)
        assert other.qpos.tobytes() == data.qpos.tobytes()
    one, many = (
        mujoco.rollout.rollout(
            model, [mujoco.MjData(model) for _ in range(threads)], np.tile(state, (6, 1)), nstep=100
        )[0]
        for threads in (1, 3)
    )
    assert one.tobytes() == many.tobytes()
    assert (one[:, -1] == one[0, -1]).all()


def test_a_batch_steps_like_single_data():
    """Simulations of ``mujoco.batch`` go on as MjData do, by any number of threads."""
    _, model = tumbling()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 150)
    for threads in (1, 3):
        simulations = batch.Batch(model, nsim=5, nthread=threads)
        simulations.step(nstep=150)
        assert (simulations.bind("qpos") == data.qpos).all()
    assert data.ncon > 0


def test_an_unedited_robot_crawls_in_a_pipe():
    """Gymnasium's ant, as its file is, in a pipe of its size: it stays in it."""
    pytest.importorskip("gymnasium")
    import gymnasium

    folder = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
    spec = mujoco.MjSpec.from_file(str(folder / "ant.xml"))
    spec.delete(spec.geom("floor"))
    network = ot.Network(
        place={"axis": (1, 0, 0), "position": (-2, 0, 0)},
        fittings=[
            {"kind": "straight", "name": "level", "length": 6, "inner_diameter": 2},
            {"kind": "elbow", "name": "knee", "mean_radius": 3, "inner_diameter": 2},
        ],
        joints=[{"ports": ("level.end", "knee.start")}],
    )
    pipes = ot.add_pipes(spec, network)
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[2] = 0.0
    for _ in range(500):
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        mujoco.mj_step(model, data)
        assert pipes.clearance(data.body("torso").xpos) > 0.2
    assert data.ncon > 0


def test_user_data_of_the_robot_stay():
    """They stand at the beginning of each row, records of the walls at the end."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(size=[0.02, 0, 0], userdata=[4.0, 5.0])
    ot.add_pipes(spec, NETWORKS["s_bend"])
    ot.add_pipes(spec, Assembly((Part("other", Straight(0.3), Pose(np.eye(3), [2, 0, 0])),)))
    model = spec.compile()
    sphere = model.geom_type == GEOM.mjGEOM_SPHERE
    assert model.geom_user[sphere, :2].tolist() == [[4.0, 5.0]]
    assert not model.geom_user[~sphere, :2].any()
    assert all(has_record(row) for row in model.geom_user[~sphere])


def test_points_are_located_on_the_axes_of_their_parts():
    """A point beside an axis has its arc length and tangent there; its clearance is the exact
    distance; outside all is NaN."""
    pipes = ot.Pipes(ot.load_network("fig14"))
    parts, rng = pipes.assembly.parts, np.random.default_rng(1)
    for number, part in enumerate(parts):
        for line, (axis, *_) in enumerate(part.axes):
            # The beginning of a branch lies nearer to the run.
            s = rng.uniform(0.1 if line else 0.0, axis.length, 20)
            point, tangent, normal, _ = axis.at(s)
            points = point + rng.uniform(-0.03, 0.03, (20, 1)) * np.cross(tangent, normal)
            place = pipes.locate(points)
            assert (place.part == number).all()
            assert (place.line == line).all()
            np.testing.assert_allclose(place.arc_length, s, atol=1e-9)
            np.testing.assert_allclose(place.axis, tangent, atol=1e-9)
            exact = pipes.assembly.signed_distance(points)[0]
            np.testing.assert_allclose(place.clearance, exact, atol=1e-9)
            np.testing.assert_array_equal(pipes.clearance(points), place.clearance)
    outside = pipes.locate([[9.0, 9.0, 9.0]])
    assert outside.part[0] == outside.line[0] == -1
    assert np.isnan(outside.arc_length).all()


def test_rays_and_depths_are_those_of_the_wall():
    """A camera on the axis of a straight sees the wall at bore / tan(angle off the axis), by
    MuJoCo's conventions for cameras; rays go as far."""
    spec = mujoco.MjSpec()
    # Looks along +z, with the image's right towards +x.
    spec.worldbody.add_camera(name="eye", pos=[0, 0, 0.1], quat=[0, 1, 0, 0], fovy=90)
    pipes = ot.add_pipes(spec, alone(Straight(5.0)))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    depth = pipes.depth(data, "eye", size=(40, 30))
    assert depth.shape == (30, 40)
    x, y = np.meshgrid((np.arange(40) - 19.5) / 15, (np.arange(30) - 14.5) / 15)
    np.testing.assert_allclose(depth, BORE / np.hypot(x, y), rtol=1e-6)
    with pytest.raises(ot.InputError, match=r"data: .* mujoco.mj_forward"):
        pipes.depth(mujoco.MjData(model), "eye")
    np.testing.assert_allclose(pipes.rays([0.02, 0, 1], [[1, 0, 0], [-2, 0, 0]]), [0.06, 0.1])
    assert np.isinf(pipes.rays([0.0, 0, 1], [[0, 0, 1]])).all()


@pytest.mark.parametrize("is_carried", [True, False])
@pytest.mark.parametrize("length", [None, 60])
def test_pipes_keep_their_plugin_where_they_are_attached(length, is_carried):
    """A ball rests on them in the other model, which is refused where its user data are longer."""
    spec = mujoco.MjSpec()
    carrier, ball = spec.worldbody.add_body(), spec.worldbody.add_body(pos=[0, 0, 0.2])
    _ = ball.add_freejoint(), ball.add_geom(size=[0.02, 0, 0], mass=0.1)
    fittings = [{"kind": "straight", "name": "a", "length": 1.0}]
    level = ot.Network(fittings=fittings, place={"axis": (1.0, 0.0, 0.0)})
    ot.add_pipes(spec, level, body=carrier if is_carried else None, friction=0.8)
    # Pipes without a body of the model stand in the world's frame.
    place, ball.pos = [-0.5, 0, 0.2], [0, 0, 0.2] if is_carried else [0.5, 0, 0]
    carrier.pos = place if is_carried else [0, 0, 0]
    other = mujoco.MjSpec()
    other.nuser_geom = length or spec.nuser_geom
    frame = other.worldbody.add_frame(pos=[0, 0, 0] if is_carried else place)
    with warnings.catch_warnings():  # MuJoCo's about the other length
        warnings.simplefilter("ignore")
        other.attach(spec, frame=frame, prefix="own_")
        if length:
            with pytest.raises(ValueError, match="exact walls: the model has none at the ends"):
                other.compile()
            return
        model = other.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.qpos[2] == pytest.approx(0.2 - 0.06, abs=2e-4)


def test_a_saved_model_is_refused_where_its_walls_are_not_known(tmp_path):
    """Without the package MuJoCo does not load it; with its pipes it steps as before, in another
    process."""
    spec, model = tumbling()
    path = tmp_path / "saved.xml"
    path.write_text(spec.to_xml())
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 50)
    load = f"import mujoco\nmodel = mujoco.MjModel.from_xml_path({str(path)!r})\n"
    step = "data = mujoco.MjData(model)\nmujoco.mj_step(model, data, 50)\nprint(*data.qpos[:3])"
    known = (
        "import omnitrack_sim as ot\n"
        "parts = [{'kind': 'straight', 'name': 'a', 'length': 1}, {'kind': 'elbow', 'name': 'b'}]\n"
        "ot.Pipes(ot.Network(fittings=parts, joints=[{'ports': ('a.end', 'b.start')}]))\n"
    )
    for program, message in (
        (load, "plugin omnitrack_sim.walls not found"),
        (
            "from omnitrack_sim.walls.guard import register\nregister()\n" + load,
            "of a kind that this process does not know",
        ),
        (known + load + step, ""),
    ):
        run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert message in run.stderr
        assert (run.returncode == 0) == (not message)
    # MJCF keeps six digits.
    np.testing.assert_allclose(np.fromstring(run.stdout, sep=" "), data.qpos[:3], atol=1e-4)


def test_rows_that_grow_after_the_walls_are_refused():
    """User data that push the records from the ends of their rows leave no wall unseen."""
    spec = mujoco.MjSpec()
    ot.add_pipes(spec, NETWORKS["straight"])
    spec.nuser_geom += 1
    with pytest.raises(ValueError, match="give nuser_geom its length before"):
        spec.compile()


def test_what_exact_walls_cannot_touch_is_refused():
    """Flexes, signed distance fields and compiled models, each with the reason."""
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><flexcomp name="soft" type="grid" count="3 3 1" dim="2"
        spacing=".1 .1 .1" radius=".01" mass="1"/></worldbody></mujoco>"""
    )
    with pytest.raises(ot.InputError, match="flex"):
        ot.add_pipes(spec, NETWORKS["straight"])
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="field", type=GEOM.mjGEOM_SDF)
    with pytest.raises(ot.InputError, match=r"spec\.geoms\.field: is a signed distance field"):
        ot.add_pipes(spec, NETWORKS["straight"])
    with pytest.raises(ot.InputError, match="before it is compiled"):
        ot.add_pipes(mujoco.MjSpec().compile(), NETWORKS["straight"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"friction": -1}, "friction: is -1; a number from 0 on"),
        ({"friction": float("nan")}, "friction: is nan"),
        ({"friction": [0.8, 0.005, 0.0001]}, r"friction: is \[0.8"),
        ({"fricton": 0.8}, "fricton: is no attribute that walls take"),
        ({"size": [1, 1, 1]}, "size: is no attribute"),
        ({"body": "core"}, "body: is a str; a body of the MjSpec is needed"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(arguments, message):
    """Each by its name, before anything is added."""
    spec = mujoco.MjSpec()
    with pytest.raises(ot.InputError, match=message):
        ot.add_pipes(spec, NETWORKS["straight"], **arguments)
    assert not spec.geoms


def test_networks_are_networks_and_are_added_once():
    spec = mujoco.MjSpec()
    with pytest.raises(TypeError, match=r"network: is .*such as ot.load_network\('fig14'\) makes"):
        ot.add_pipes(spec, "fig14")
    ot.add_pipes(spec, NETWORKS["straight"])
    with pytest.raises(ot.InputError, match="that the model has a wall of already"):
        ot.add_pipes(spec, NETWORKS["straight"])


def test_the_page_runs(capsys):
    """The wheeled robot of any-robot.md climbs up to the elbow and into it."""
    page = Path(__file__).parents[1] / "docs" / "how-to" / "any-robot.md"
    program = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)[0]
    names = {}
    exec(compile(program, page.name, "exec"), names)
    assert 0.55 < names["place"][2] < 0.6
    assert "mm from the wall" in capsys.readouterr().out


def test_the_robot_of_a_class_on_the_page_rolls_through_its_pipe(tmp_path, monkeypatch, capsys):
    """The ball of any-robot.md comes to the end at the speed that the page names, upright."""
    page = Path(__file__).parents[1] / "docs" / "how-to" / "any-robot.md"
    program = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)[1]
    (tmp_path / "my_robot.py").write_text(program, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    result = importlib.import_module("my_robot").result
    sys.modules.pop("my_robot")
    assert capsys.readouterr().out == "reached_goal 0.13 m/s\n"
    assert result.metrics["distance_m"] > 0.6
    assert result.metrics["tilt_max_deg"] < 5
