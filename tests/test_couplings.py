"""Joints of pipes as they are: steps, offsets, gaps and deflections."""

from __future__ import annotations

import math

import contact_lots
import mujoco
import numpy as np
import pytest
import thrown_bodies
import trimesh
from in_pipes import check_that_thrown_bodies_stay

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Array, unit
from omnitrack_sim.pipes import Coupling, Step, Straight, route
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.scenario import validate
from omnitrack_sim.walls.meshes import ManifoldKit, fitting_mesh, network_mesh
from omnitrack_sim.walls.rays import RayWalls

COUPLINGS = {
    "nothing": Coupling(),
    "offset": Coupling(offset=0.006, direction=1.0),
    "step up": Coupling(end_diameter=0.15),
    "step down": Coupling(end_diameter=0.168, offset=0.002, direction=0.3),
    "gap": Coupling(gap=0.012, depth=0.015),
    "blunt": Coupling(offset=0.0003, edge_radius=0.002),
    "old": Coupling(
        end_diameter=0.156,
        offset=0.004,
        direction=2.0,
        angle=math.radians(3),
        gap=0.012,
        depth=0.01,
        edge_radius=0.001,
    ),
    "bent": Coupling(angle=math.radians(5), direction=-1.0),
}


def in_solid(joint: Coupling, points: Array) -> Array:
    """Tell which points (n, 3) m, fitting frame, lie in the wall before its edges are rounded.

    Both pipes begin as solids with bores wider by the edges' radius, half a gap and that radius
    from the middle, and end square to their axes.
    """
    edge, space = joint.edge_radius, joint.gap + 2 * joint.edge_radius if joint.gap else 0.0
    collar = (joint.length - space) / 2
    first = np.hypot(*points[:, :2].T)
    onward = np.array([math.sin(joint.angle), 0.0, math.cos(joint.angle)])
    behind = points - [joint.offset, 0.0, collar + space]
    along = behind @ onward
    second = np.linalg.norm(behind - along[:, None] * onward, axis=1)
    solid = (points[:, 2] <= collar) & (first >= joint.inner_diameter / 2 + edge)
    solid |= (along >= 0) & (second >= joint.end_diameter / 2 + edge)
    if joint.gap:
        wide = max(joint.inner_diameter / 2, joint.offset + joint.end_diameter / 2) + joint.depth
        solid |= (points[:, 2] > collar) & (along < 0) & (first >= wide + edge)
    return solid


def lot(joint: Coupling, count: int, beyond: float = 0.0) -> Array:
    """Random points (n, 3) m between the ports, up to ``beyond`` m beside the box of the bore."""
    low, high = joint.bounds
    points = np.random.default_rng(1).uniform(low - beyond, high + beyond, (count, 3))
    return points[joint.extent(points) > 0]


@pytest.mark.parametrize("name", COUPLINGS)
def test_the_distance_is_that_from_the_nearest_of_both_ends(name):
    """The ball about a point that the distance says is free, and the edges' radius more, holds no
    point of the solids at any of 400 places of its surface, and its foot is in them; 10,000 points.
    In the wall it is the other way round, to 0.02 mm, up to 5 mm deep."""
    joint = COUPLINGS[name]
    points, rng = lot(joint, 10_000, 0.004), np.random.default_rng(2)
    distance, gradient = joint.signed_distance(points)
    apart = distance + joint.edge_radius
    solid = in_solid(joint, points)
    assert ((apart < 0) == solid).all()
    near = (distance > -0.005) | ~solid
    points, apart, solid = points[near], apart[near], solid[near]
    gradient = gradient[near]
    feet = points - apart[:, None] * gradient
    room = np.where(solid, 2e-5, 1e-8)[:, None]
    assert in_solid(joint, feet - room * gradient).all()
    assert not in_solid(joint, feet + room * gradient).any()
    some = slice(0, 1500)
    ways = unit(rng.normal(size=(len(points[some]), 400, 3)))
    around = points[some, None] + np.abs(apart[some, None, None]) * (1 - 1e-9) * ways
    held = in_solid(joint, around.reshape(-1, 3)).reshape(-1, 400)
    assert (held == solid[some, None]).all()
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("name", COUPLINGS)
def test_its_box_holds_the_bore(name):
    """No point beside the box of a coupling is in its bore."""
    joint = COUPLINGS[name]
    points = lot(joint, 200_000, 0.02)
    low, high = joint.bounds
    beside = ((points < low - 1e-9) | (points > high + 1e-9)).any(axis=1)
    assert beside.sum() > 10_000
    assert joint.signed_distance(points[beside])[0].max() <= 1e-9


def joined(joint: Coupling, length: float = 0.3, turn: float = 0.0, backward: bool = False):
    """A straight, a coupling and a straight in a row."""
    ways = [("end", "start"), ("start", "end")]
    enter, leave = ways[0] if backward else ways[1]
    bores = [joint.inner_diameter, joint.end_diameter][:: -1 if backward else 1]
    return route(
        [
            Step("before", Straight(length, bores[0]), "start", "end"),
            Step("joint", joint, enter, leave, turn),
            Step("behind", Straight(length, bores[1]), "start", "end"),
        ]
    )


@pytest.mark.parametrize("name", COUPLINGS)
def test_rays_end_on_the_wall_of_a_joint(name):
    """Rays of a camera in the pipe before end on the joint's wall and pass through none, but for a
    few that graze an edge within 0.2 mm; their normals are the wall's."""
    course = joined(COUPLINGS[name])
    pipes = course.network
    rays = unit(np.random.default_rng(2).normal((0.0, 0.0, 0.6), 1.0, (1500, 3)))
    position = np.array([[0.03, -0.02, 0.25]])
    hits = RayWalls([pipes.parts]).trace(np.zeros(1, int), position, np.eye(3)[None], rays, 9)
    reach, normal, part = hits[0, :, 0], hits[0, :, 1:4], hits[0, :, 4]
    met = np.isfinite(reach)
    assert (part[met] == 1).sum() > 200
    ends = position + reach[met, None] * rays[met]
    joint = pipes.parts[1]
    at_joint = part[met] == 1
    distance, gradient = joint.signed_distance(ends[at_joint])
    assert np.quantile(np.abs(distance), 0.98) < 1e-9
    assert np.abs(distance).max() < 2e-4
    assert (normal[met][at_joint] * gradient).sum(axis=1).min() > 1 - 1e-6
    for share in np.linspace(0.05, 0.999, 40):
        along = position + share * reach[met, None] * rays[met]
        assert pipes.signed_distance(along)[0].min() > -1e-9


def test_a_camera_sees_the_face_of_a_step():
    """A ray along the axis, 2 mm off the wall, meets the face of a step of 5 mm, half of the
    coupling and an edge's radius before it; one 6 mm off the wall passes it."""
    joint = COUPLINGS["step up"]
    pipes = ot.Pipes(joined(joint).network)
    face = 0.3 + 0.08 - joint.edge_radius
    assert pipes.rays([0.0, 0.078, 0.1], [0.0, 0.0, 1.0]) == pytest.approx(face - 0.1, abs=1e-9)
    assert pipes.rays([0.0, 0.074, 0.1], [0.0, 0.0, 1.0]) == math.inf
    assert pipes.clearance([0.0, 0.078, face - 0.001]) == pytest.approx(0.001, abs=1e-9)


@pytest.mark.parametrize("shape", contact_lots.SHAPES)
@pytest.mark.parametrize(
    "name",
    [*(pytest.param(n, marks=pytest.mark.long) for n in ("offset", "step")), "gap", "old joint"],
)
def test_contacts_tell_the_least_distance_of_any_body(name, shape):
    """Of each type of geom the deepest contact is as deep as branch and bound finds."""
    errors = contact_lots.Lot(contact_lots.FITTINGS[name], shape).errors(
        25, np.random.default_rng([8])
    )
    assert errors.max() < 2e-5


@pytest.mark.parametrize("name", ["offset", "step", "old joint"])
def test_bodies_thrown_into_joints_stay_there(name):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later."""
    network = thrown_bodies.fitting_alone(thrown_bodies.FITTINGS[name])
    check_that_thrown_bodies_stay(network)


def test_a_ball_before_a_step_touches_the_floor_and_the_edge():
    """A ball in the corner has a contact with each: one up, one by the angle at which it lies
    against the rounded edge; before and behind the corner it has one."""
    step, radius, edge = 0.004, 0.03, 0.001
    spec = mujoco.MjSpec()
    course = joined(Coupling(offset=step, direction=math.pi, edge_radius=edge))
    ot.add_pipes(spec, course.network)
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(size=[radius, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    # The bore behind lies towards -x, so that its wall stands out on the side +x.
    angle = math.acos(1 - step / (radius + edge))
    corner = 0.38 - (radius + edge) * math.sin(angle)
    for z, count in ((corner - 0.002, 1), (corner + 1e-6, 2)):
        data.qpos[:3] = [0.08 - radius + 1e-6, 0.0, z]
        mujoco.mj_forward(model, data)
        assert data.ncon == count
    normals = data.contact.frame[:, :3]
    expected = [[-1.0, 0.0, 0.0], [-math.cos(angle), 0.0, -math.sin(angle)]]
    np.testing.assert_allclose(np.abs(normals), np.abs(expected), atol=1e-3)


def climbs(step: float, friction: float, radius: float = 0.03, edge: float = 0.002) -> bool:
    """Tell whether a wheel that is turned slowly, with nothing to push it, climbs a step."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.cone = 1e-3, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator, spec.option.impratio = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, 100.0
    # The x axis of a level pipe points down; the bore behind lies higher.
    network = ot.Network(
        place={"axis": (1, 0, 0)},
        fittings=[
            {"kind": "straight", "name": "before", "length": 0.3},
            {
                "kind": "coupling",
                "name": "joint",
                "offset": step,
                "direction_deg": 180,
                "edge_radius": edge,
            },
            {"kind": "straight", "name": "behind", "length": 0.3},
        ],
        joints=[{"ports": ("before.end", "joint.start")}, {"ports": ("joint.end", "behind.start")}],
    )
    ot.add_pipes(spec, network, friction=friction)
    before = (radius + edge) * math.sin(math.acos(1 - step / (radius + edge)))
    wheel = spec.worldbody.add_body(pos=[0.3 + 0.08 - before - 5e-4, 0, radius - 0.08])
    wheel.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    wheel.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    wheel.add_joint(name="axle", axis=[0, 1, 0], armature=1e-3)
    wheel.add_geom(size=[radius, 0, 0], mass=0.5)
    motor = spec.add_actuator(target="axle", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_velocity(kv=5.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    # Soft contacts that slip are lifted by as much as their speed.
    data.ctrl[:] = 0.05
    mujoco.mj_step(model, data, 26_000)
    return bool(data.qpos[1] > 0.9 * step)


@pytest.mark.parametrize("step", [0.002, 0.005, 0.009])
def test_a_driven_wheel_climbs_a_step_by_the_friction_that_statics_asks_for(step):
    """Lifted, it stands on the rounded edge alone: the force there is upright, so that friction is
    the tangent of the angle between normal and plumb; 1 % more does, 1 % less does not."""
    angle = math.acos(1 - step / (0.03 + 0.002))
    assert climbs(step, 1.01 * math.tan(angle))
    assert not climbs(step, 0.99 * math.tan(angle))


def test_the_volume_of_a_gap_is_that_of_its_groove():
    """The bore holds more than a straight one by the groove's ring and, by Pappus, by what the
    rounded edges leave."""
    joint, radius, edge = Coupling(gap=0.012, depth=0.015, edge_radius=0.002), 0.08, 0.002
    kit = ManifoldKit(2000, overcut=0.0)
    more = joint.bore(kit).volume() - math.pi * radius**2 * joint.length
    groove = math.pi * ((radius + 0.015) ** 2 - radius**2) * 0.012
    corner, centroid = (1 - math.pi / 4) * edge**2, (10 - 3 * math.pi) / (12 - 3 * math.pi) * edge
    lips = 2 * 2 * math.pi * (radius + centroid) * corner
    assert more == pytest.approx(groove + lips, rel=2e-3)


@pytest.mark.parametrize("name", COUPLINGS)
def test_meshes_show_the_joint(name):
    """The wall is one watertight solid with a hole, alone and between pipes, and its inner corners
    lie on the wall, to a tenth of the edges' radius and the turn between corners of an edge."""
    joint = COUPLINGS[name]
    mesh = trimesh.Trimesh(*fitting_mesh(joint), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 0
    distance = joint.signed_distance(mesh.vertices)[0]
    inner = distance > -1.5e-3
    assert inner.sum() > 400
    assert np.abs(distance[inner]).max() < 0.12 * joint.edge_radius + 1e-6
    whole = trimesh.Trimesh(*network_mesh(joined(joint).network), process=False)
    assert whole.is_watertight
    assert whole.euler_number == 0


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_the_pipe_behind_lies_aside_and_is_deflected(turn):
    """By the offset and the angle, in the direction from the x axis of the pipe before, and the
    turn of the joint."""
    joint = Coupling(offset=0.004, direction=0.5, angle=math.radians(3), length=0.2)
    behind = joined(joint, turn=turn).network.parts[2]
    aside = np.array([math.cos(0.5 + turn), math.sin(0.5 + turn), 0.0])
    onward = math.sin(joint.angle) * aside + math.cos(joint.angle) * np.array([0, 0, 1.0])
    np.testing.assert_allclose(behind.pose.rotation[:, 2], onward, atol=1e-12)
    middle = 0.3 + 0.1 + (joint.gap / 2 + joint.edge_radius)
    start = 0.004 * aside + [0, 0, middle]
    collar = 0.1 - (joint.gap / 2 + joint.edge_radius)
    np.testing.assert_allclose(behind.pose.position, start + collar * onward, atol=1e-12)


def test_a_joint_is_the_same_from_both_sides():
    """Entered by its end, it lies aside by as much, to the other side."""
    joint = Coupling(offset=0.004, end_diameter=0.156)
    there, back = joined(joint).network, joined(joint, backward=True).network
    points = np.random.default_rng(3).uniform([-0.1, -0.1, 0.28], [0.1, 0.1, 0.48], (3000, 3))
    mirrored = (points - there.parts[1].pose.position) @ there.parts[1].pose.rotation
    again = back.parts[1].pose.apply(mirrored)
    a, b = (pipes.signed_distance(p)[0] for pipes, p in ((there, points), (back, again)))
    near = np.abs(a) < 0.02
    np.testing.assert_allclose(a[near], b[near], atol=1e-12)
    assert back.parts[2].pose.position[0] == pytest.approx(-0.004, abs=1e-12)


@pytest.mark.parametrize("name", ["offset", "old", "bent"])
@pytest.mark.parametrize("backward", [False, True])
def test_robots_do_not_jump_along_the_route_at_a_joint(name, backward):
    """The centreline is smooth, and within the offset of both axes; a point that goes along the
    pipe before or behind, 20 mm off its axis, goes as far along the route, to 2 mm, and by no more
    than a tenth of a millimetre more or less than its step of 1 mm."""
    course = joined(COUPLINGS[name], backward=backward)
    line, (before, _, behind) = course.centreline, course.network.parts
    s = np.linspace(0, course.length, 3001)
    point, tangent = line.at(s)[:2]
    way = np.linalg.norm(np.diff(point, axis=0), axis=1)
    np.testing.assert_allclose(way, np.diff(s), rtol=1e-4)
    assert (tangent[1:] * tangent[:-1]).sum(axis=1).min() > 1 - 1e-6
    for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        aside = 0.02 * np.array([math.cos(angle), math.sin(angle), 0.0])
        for part, places in (
            (before, np.arange(0, 0.38, 1e-3)),
            (behind, np.arange(-0.08, 0.3, 1e-3)),
        ):
            points = part.pose.apply(aside + places[:, None] * [0, 0, 1.0])
            near = line.locate(points[:1])
            found = [near]
            for place in points[1:]:
                found.append(line.locate(place[None], found[-1]))
            steps = np.diff(np.concatenate(found))
            assert np.abs(steps - 1e-3).max() < 1e-4
            assert steps.sum() == pytest.approx(places[-1] - places[0], abs=2e-3)


def test_couplings_are_kept_in_files():
    """A network's file has them as any fitting, and they are read again as they were."""
    fittings = [
        {"kind": "straight", "name": "before", "length": 0.3},
        {"kind": "coupling", "name": "joint", "end_diameter": 0.156, "offset": 0.003, "gap": 0.01},
        {"kind": "straight", "name": "behind", "length": 0.3, "inner_diameter": 0.156},
    ]
    joints = [{"ports": ("before.end", "joint.start")}, {"ports": ("joint.end", "behind.start")}]
    network = ot.Network(fittings=fittings, joints=joints)
    import tomllib

    assert validate_network(tomllib.loads(network.to_toml())) == network
    fitting = network.pipes.parts[1].fitting
    assert isinstance(fitting, Coupling)
    table = Coupling.Table(**{k: v for k, v in fitting.to_table().items() if k != "kind"})
    assert Coupling.from_table(table) == fitting
    assert (fitting.depth, fitting.edge_radius) == (0.004, 0.0005)


@pytest.mark.parametrize(
    ("keys", "where", "told"),
    [
        ({"offset": 0.05}, "offset", "from 0 to a quarter of the bore, 0.04 m"),
        ({"offset": -0.001}, "offset", "greater than or equal to 0"),
        ({"angle_deg": 11}, "angle_deg", "less than or equal to 10"),
        ({"angle_deg": 3, "gap": 0.002}, "gap", "at least 0.00419 m"),
        ({"gap": 0.2}, "gap", "from 0 to the bore, 0.16 m"),
        ({"gap": 0.01, "depth": 0.0}, "depth", "over 0 and at most half of the bore, 0.08 m"),
        ({"depth": 0.01}, "depth", "without one it is 0"),
        ({"edge_radius": 0.02}, "edge_radius", "at most a 16th of the bore, 0.01 m"),
        ({"end_diameter": 0.1}, "end_diameter", "at most a quarter"),
        ({"length": 0.05, "offset": 0.003}, "length", "at least 0.04"),
        ({"offest": 0.003}, "offest", "offset"),
    ],
)
def test_keys_that_do_not_go_together_are_told(keys, where, told):
    """Each value out of its range is a fault at its key that says the range, in a file."""
    pipes = [{"kind": "straight", "length": 0.3}, {"kind": "coupling", **keys}]
    if where == "length":
        pipes[1]["length"] = 0.02
    with pytest.raises(ot.ScenarioError) as caught:
        validate({"name": "wrong", "pipes": pipes})
    faults = [fault for fault in caught.value.faults if where.removesuffix("_deg") in fault.where]
    assert faults
    assert told in str(faults[0])


def test_a_step_without_a_coupling_is_refused_by_name():
    """Bores that differ by more than 1 mm are joined by a reducer or, as a step, by a coupling."""
    straights = [
        Step(f"p{i}", Straight(0.3, bore), "start", "end") for i, bore in ((0, 0.16), (1, 0.15))
    ]
    with pytest.raises(ot.GeometryError, match="a coupling as a step"):
        route(straights)


@pytest.mark.parametrize("collider", ["exact", "primitives"])
def test_a_robot_drives_over_a_small_step(collider):
    """Up and down by 2 mm, level, with either collider."""
    pipes = [
        {"kind": "straight", "length": 0.5},
        {"kind": "coupling", "end_diameter": 0.156},
        {"kind": "straight", "length": 0.3, "inner_diameter": 0.156},
        {"kind": "coupling", "inner_diameter": 0.156, "end_diameter": 0.16},
        {"kind": "straight", "length": 0.5},
    ]
    level = {"start": {"axis": [1.0, 0.0, 0.0]}, "physics": {"collider": collider}}
    result = ot.run(validate({"name": "steps", "pipes": pipes, **level}))
    assert result.outcome == "reached_goal"
    assert result.trajectory["normal_force"].max() > 0
