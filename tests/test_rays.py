"""Rays on the exact walls, against the walls' own distance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bulge import Bulge
from network_samples import elbow, joint, straight

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Cross, Mitre, Part, Reducer, Straight, Tee
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.walls.rays import RayWalls

AHEAD, SIDE = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
ONE = np.zeros(1, int)


def cone(count=300, half_angle=0.9):
    """Directions spread evenly about z, camera frame."""
    k = np.arange(count) + 0.5
    tilt, turn = half_angle * np.sqrt(k / count), k * 2.399963
    return np.stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=-1
    )


@pytest.mark.parametrize("name", ["tee_turn", "elbow_short", "reducer", "wye_turn"])
def test_rays_end_on_the_wall_and_pass_through_none(name):
    """Where a ray ends the distance from the wall is nothing, and it is positive all along it."""
    route = ot.load_scenario(name).route
    walls, line = RayWalls([route.network.parts]), route.centreline
    distance = np.linspace(0.1, line.length - 0.1, 7)
    position, frames = line.at(distance)[0], line.frame(distance)
    rays = cone()
    hits = walls.trace(np.zeros(7, int), position, frames, rays, 2.0)
    reach, normal = hits[..., 0], hits[..., 1:4]
    directions = np.einsum("nij,kj->nki", frames, rays)
    met = np.isfinite(reach)
    assert met.mean() > 0.8
    far = np.where(met, reach, 0.0)[..., None]
    ends, gradient = route.network.signed_distance(position[:, None] + far * directions)
    assert np.abs(ends[met]).max() < 6e-4
    assert np.quantile(np.abs(ends[met]), 0.99) < 1e-5
    beside_joints = met & (hits[..., 6] > 1e-3)  # at a reducer's end the wall has an edge
    assert (normal * gradient).sum(axis=-1)[beside_joints].min() > 0.999
    for part in np.linspace(0.05, 0.98, 12):
        inside, _ = route.network.signed_distance(position[:, None] + part * far * directions)
        assert inside[met].min() > -1e-6


BRANCHES = [
    {"kind": "tee"},
    *({"kind": "wye", "angle_deg": angle} for angle in (30.0, 45.0, 60.0, 75.0, 90.0)),
    {"kind": "wye", "angle_deg": 60.0, "branch_diameter": 0.1},
    {"kind": "cross"},
    {"kind": "cross", "angle_deg": 60.0},
]


@pytest.mark.parametrize("port", ["branch", "run_end"])
@pytest.mark.parametrize(
    "branched", BRANCHES, ids=lambda fitting: "-".join(map(str, fitting.values()))
)
def test_rays_in_a_bend_right_behind_a_branch_end_on_the_wall(branched, port):
    """Around the joint, and in the bend, too: the bore of a leg goes on behind its port as a line
    of the fitting before, but no ray does. What is left, half a millimetre, is a step over the
    plane of a joint."""
    bore = branched.get("branch_diameter", 0.16) if port == "branch" else 0.16
    data = {
        "fittings": [
            straight("foot", 0.3),
            {"name": "fork", **branched},
            elbow("knee", mean_radius=0.12, inner_diameter=bore),
        ],
        "joints": [
            joint("foot.end", "fork.run_start"),
            joint(f"fork.{port}", "knee.start", 90.0),
        ],
    }
    pipes = validate_network(data).pipes
    parts, knee = pipes.parts, pipes.parts[2]
    turned = np.linspace(0.02, math.pi / 2 - 0.02, 9)
    axis = 0.12 * np.stack([1 - np.cos(turned), 0 * turned, np.sin(turned)], axis=-1)
    position = knee.pose.apply(axis)
    walls, frames = RayWalls([parts]), np.tile(knee.pose.rotation, (9, 1, 1))
    around = np.concatenate([cone(half_angle=math.pi / 2), -cone(half_angle=math.pi / 2)])
    hits = walls.trace(np.zeros(9, int), position, frames, around, 2.0)
    ends = position[:, None] + hits[..., :1] * np.einsum("nij,kj->nki", frames, around)
    met = np.isfinite(hits[..., 0])
    off = np.abs(pipes.signed_distance(ends[met])[0])
    assert met.mean() > 0.7
    assert off.max() < 6e-4


FITTINGS = (
    Straight(0.4),
    Reducer(0.1, 0.1),
    Reducer(0.1, 0.16, inner_diameter=0.1),
    Tee(),
    Wye(),
    Wye(angle=math.radians(60), branch_diameter=0.1),
    Cross(angle=math.radians(60), branch_diameter=0.1),
    Mitre(),
    Mitre(angle=math.radians(150)),
)


@pytest.mark.parametrize("fitting", FITTINGS, ids=lambda fitting: fitting.kind)
def test_what_is_clear_for_certain_is_bore_up_to_the_wall(fitting):
    """A line leads through the bore as far as ``clear`` says; most such lines end on the wall, and
    none begins in the wall."""
    generator = np.random.default_rng(7)
    low, high = fitting.bounds
    points = generator.uniform(low, high, (400, 3))
    ways = generator.normal(size=(400, 3))
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    clear = np.array(
        [
            fitting.wall.clear(np.array(fitting.sizes), *p, *a)
            for p, a in zip(points, ways, strict=True)
        ]
    )
    start = fitting.signed_distance(points)[0]
    assert (clear[start < -1e-9] == 0.0).all()
    known = np.isfinite(clear) & (clear > 0.0)
    assert known.sum() > 150
    beyond_ports = fitting.extent(points + np.where(known, clear, 0.0)[:, None] * ways) < 0
    known &= ~beyond_ports  # there the fitting ends, and its distance with it
    points, ways, clear = points[known], ways[known], clear[known]
    for part in np.linspace(0.0, 1.0, 21):
        inside = fitting.signed_distance(points + part * clear[:, None] * ways)[0]
        assert inside.min() > -1e-9
    assert np.quantile(inside, 0.5) < 1e-9


def test_rays_meet_a_fitting_that_says_nothing_of_what_is_clear():
    """A fitting from outside with the two functions alone is met on its wall."""
    bulge = Bulge(0.1)
    part = Part("bulge", bulge, Pose())
    position, frame = np.array([[0.0, 0.01, 0.05]]), np.eye(3)[None]
    rays = cone(200, np.pi)
    hits = RayWalls([[part]]).trace(ONE, position, frame, rays, 1.0)[0]
    met = np.isfinite(hits[:, 0])
    assert 50 < met.sum() < 200
    ends = bulge.signed_distance(position + hits[met, :1] * rays[met])[0]
    assert np.abs(ends).max() < 6e-4
    assert np.quantile(np.abs(ends), 0.9) < 1e-6


def test_walls_without_dirt_have_no_grain():
    """A map knows of no dirt: all else is as on the true walls."""
    route = ot.load_scenario("tee_turn").route
    line, lamp = route.centreline, np.array([0.015, 0.0, 0.0])
    position, frame = line.at(np.array([0.2]))[0], line.frame(np.array([0.2]))
    true, known = (
        RayWalls([route.network.parts], dirty=dirty).trace(ONE, position, frame, cone(), 2.0, lamp)
        for dirty in (True, False)
    )
    assert np.ptp(true[..., 7]) > 0.5
    assert (known[..., 7] == 0.0).all()
    assert known[..., :7].tobytes() == true[..., :7].tobytes()


def test_a_ray_along_a_pipe_leaves_through_its_open_end_and_meets_a_plate():
    """Nothing is met where the pipe is open; a plate is met in the port's plane."""
    route = ot.load_scenario("straight").route
    line = route.centreline
    position, frame = line.at(np.array([0.2]))[0], line.frame(np.array([0.2]))
    parts = route.network.parts
    way_out = line.length - 0.2
    last = len(parts) - 1, route.passages[-1].leave
    for closed, wanted in (((), np.inf), ((last,), way_out)):
        walls = RayWalls([parts], [closed])
        hit = walls.trace(ONE, position, frame, AHEAD[None], way_out + 1.0)[0, 0]
        assert hit[0] == pytest.approx(wanted, abs=1e-5)
    assert hit[1:4] @ frame[0, :, 2] == pytest.approx(-1.0)


def test_an_open_end_before_another_pipe_is_open():
    """The other pipe lies between its own port planes there, and is no plate."""
    pipe = Part("pipe", Straight(0.4), Pose())
    across = Pose(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.array([-0.5, 0.0, 0.52]))
    walls = RayWalls([[pipe, Part("across", Straight(1.0), across)]])
    hits = walls.trace(ONE, np.array([[0.0, 0.0, 0.2]]), np.eye(3)[None], AHEAD[None], 1.5)
    assert hits[0, 0, 0] == math.inf


def test_beyond_a_port_that_nothing_is_known_of_nothing_is_told():
    """Neither a wall nor an end; and a map can be put in the place of another."""
    route = ot.load_scenario("straight").route
    line, parts = route.centreline, route.network.parts
    position, frame = line.at(np.array([0.2]))[0], line.frame(np.array([0.2]))
    last = len(parts) - 1, route.passages[-1].leave
    walls = RayWalls([parts], unknown=[[last]])
    assert np.isnan(walls.trace(ONE, position, frame, AHEAD[None], 9.0)[0, 0, 0])
    walls.replace(0, parts, [last])
    hit = walls.trace(ONE, position, frame, AHEAD[None], 9.0)[0, 0, 0]
    assert hit == pytest.approx(line.length - 0.2, abs=1e-5)


def test_where_a_straight_has_not_been_seen_to_end_there_is_no_ring():
    """At a fitting's port there is a joint, known or not. A straight that has been seen to go so
    far may go on: right before that nothing is told, and before it no ring is expected."""
    route = ot.load_scenario("tee_turn").route
    line, parts = route.centreline, route.network.parts
    tee = next(i for i, part in enumerate(parts) if part.fitting.kind == "tee")
    leave = route.passages[tee].leave
    lamp = np.array([0.01, 0.0, 0.0])

    def seen(end, back):
        at = np.array([line.length - back]) if end[0] == len(parts) - 1 else None
        at = np.array([route.passages[tee].s_leave - back]) if at is None else at
        position, frame = line.at(at)[0], line.frame(at)
        found = {}
        for name, unknown in (("open", [[]]), ("unknown", [[end]])):
            walls = RayWalls([parts[: end[0] + 1]], unknown=unknown)
            found[name] = walls.trace(ONE, position, frame, cone(2000, 0.9), 9.0, lamp)[0]
        return found

    straight = seen((len(parts) - 1, route.passages[-1].leave), 0.15)
    near = straight["open"][:, 6] < 0.025
    assert near.sum() > 50
    assert np.isnan(straight["unknown"][near, 0]).all()
    shown = np.isfinite(straight["unknown"][:, 0]) & (straight["open"][:, 6] < 0.07)
    assert shown.any()
    assert np.isinf(straight["unknown"][shown, 6]).all()
    fitting = seen((tee, leave), 0.1)
    ring = np.isfinite(fitting["open"][:, 0]) & (fitting["open"][:, 6] < 0.004)
    assert ring.any()
    assert (fitting["unknown"][ring, 6] == fitting["open"][ring, 6]).all()


def test_the_lamp_does_not_shine_round_the_corner_of_a_branch():
    """A lamp beside the lens leaves a part of what the lens sees in the dark, at the lens none."""
    route = ot.load_scenario("tee_turn").route
    walls, line = RayWalls([route.network.parts]), route.centreline
    tee = next(part for part in route.network.parts if part.fitting.kind == "tee")
    start = route.passages[0].s_enter
    at = np.array([float(np.linalg.norm(tee.pose.position)) - 0.12 + start])
    position, frame = line.at(at)[0], line.frame(at)
    lit = {}
    for beside in (0.0, 0.03):
        lamp = np.array([beside, 0.0, 0.0])
        hits = walls.trace(ONE, position, frame, cone(2000, 1.2), 2.0, lamp)[0]
        lit[beside] = (hits[np.isfinite(hits[:, 0]), 5] > 0).mean()
    assert lit[0.0] > 0.99
    assert lit[0.03] < lit[0.0]


def test_points_lie_as_deep_as_the_network_says():
    """``nearest`` is ``Assembly.signed_distance`` within the bore."""
    network = ot.load_scenario("tee_turn").route.network
    line = ot.load_scenario("tee_turn").route.centreline
    generator = np.random.default_rng(1)
    middle = line.at(generator.uniform(0.05, line.length - 0.05, 400))[0]
    points = middle + generator.uniform(-0.04, 0.04, (400, 3))
    distance, gradient, part = RayWalls([network.parts]).nearest(ONE, points[None])
    wanted, slope = network.signed_distance(points)
    inside = wanted > 0.001
    assert inside.sum() > 300
    assert (part[0, inside] >= 0).all()
    assert distance[0, inside] == pytest.approx(wanted[inside], abs=1e-12)
    assert gradient[0, inside] == pytest.approx(slope[inside], abs=1e-9)


def test_each_camera_has_a_map_of_its_own():
    """Cameras look at the map that they are given, in one call."""
    straight, tee = (ot.load_scenario(name).route for name in ("straight", "tee_turn"))
    walls = RayWalls([straight.network.parts, tee.network.parts])
    line = tee.centreline
    position, frame = line.at(np.array([0.2] * 2))[0], line.frame(np.array([0.2] * 2))
    both = walls.trace(np.array([0, 1]), position, frame, cone(), 2.0)
    alone = RayWalls([tee.network.parts]).trace(ONE, position[:1], frame[:1], cone(), 2.0)
    assert both[1].tobytes() == alone[0].tobytes()
    assert both[0].tobytes() != alone[0].tobytes()
