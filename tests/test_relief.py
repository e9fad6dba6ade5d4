"""Relief of pipes: what differs from the ideal bore, kind by kind."""

from __future__ import annotations

import json
import math
import time
import tomllib
from collections.abc import Collection, Iterable
from typing import Any

import contact_lots
import mujoco
import numpy as np
import pytest
import thrown_bodies
from in_pipes import check_that_thrown_bodies_stay, gradient_error, swing_period
from scipy.spatial import cKDTree
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.cli import app
from omnitrack_sim.pipes import Assembly, Part, Straight
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.scenario import validate
from omnitrack_sim.walls.meshes import fitting_mesh
from omnitrack_sim.walls.rays import RayWalls

RELIEF = {
    "weld": {"kind": "weld", "at": 0.15},
    "part of a weld": {"kind": "weld", "at": 0.15, "height": 0.005, "from_deg": -40, "to_deg": 60},
    "flat weld": {"kind": "weld", "at": 0.15, "height": 0.001, "width": 0.02},
    "deposit": {"kind": "deposit", "at": 0.15, "length": 0.16, "depth": 0.02, "angle_deg": 30},
    "ovality": {"kind": "ovality", "ratio": 0.06, "direction_deg": 20},
}
RELIEF |= {
    "dent": {"kind": "dent", "at": 0.15, "depth": 0.008, "length": 0.08, "width": 0.06},
    "corrosion": {"kind": "corrosion", "roughness": 0.001, "wavelength": 0.03, "seed": 3},
}
SEVERAL = {name: (name,) for name in RELIEF} | {
    "weld on an ovality": ("ovality", "weld"),
    "all": ("ovality", "part of a weld", "deposit"),
}
"""Relief of a pipe by name."""


def but_for(quick: Collection[str], names: Iterable[str]) -> list[Any]:
    """Return parameters of a test, those that are not ``quick`` marked as long."""
    return [n if n in quick else pytest.param(n, marks=pytest.mark.long) for n in names]


def pipe(*names: str, length: float = 0.3, **keys) -> Straight:
    return Straight(length, relief=tuple(RELIEF[name] for name in names), **keys)


def places_of(fitting: Straight, near: np.ndarray, spacing: float) -> np.ndarray:
    """Places (k, 3) of the wall up to 0.1 m from some points, found along rays from the axis.

    A ray goes on to where the signed distance changes its sign; it shares nothing else with the
    search for feet.
    """
    low, high = near[:, 2].min() - 0.05, near[:, 2].max() + 0.05
    s = np.arange(max(low, 0.0), min(high, fitting.length), spacing)
    angle = np.arange(0.0, 2 * np.pi, spacing / 0.08)
    s, angle = (grid.ravel() for grid in np.meshgrid(s, angle))
    way = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    base, inside, outside = s[:, None] * [0, 0, 1.0], np.zeros(len(s)), np.full(len(s), 0.1)
    for _ in range(22):
        middle = (inside + outside) / 2
        free = fitting.signed_distance(base + middle[:, None] * way)[0] > 0
        inside, outside = np.where(free, middle, inside), np.where(free, outside, middle)
    return base + inside[:, None] * way


@pytest.mark.parametrize("spacing", [2e-3, pytest.param(4e-4, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", SEVERAL)
def test_the_distance_is_that_of_the_nearest_place(name, spacing):
    """In the bore, near and far from the wall, no place of the wall is nearer than the distance,
    the gradient leads to one that is as near, and is its derivative."""
    fitting, rng = pipe(*SEVERAL[name]), np.random.default_rng(1)
    points = rng.uniform(-0.078, 0.078, (2500, 3))
    points[:, 2] = rng.uniform(0.12, 0.18, len(points))
    distance, gradient = fitting.signed_distance(points)
    kept = distance > 1e-4
    points, distance, gradient = points[kept], distance[kept], gradient[kept]
    away = cKDTree(places_of(fitting, points, spacing)).query(points)[0]
    # No place is nearer, and there is a place that near.
    assert (distance - away).max() < 1e-7
    assert np.abs(fitting.signed_distance(points - distance[:, None] * gradient)[0]).max() < 1e-7
    error = gradient_error(fitting, points, gradient)
    # But for points that are as near to two places.
    assert np.quantile(error, 0.98) < 1e-5
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("name", RELIEF)
def test_the_distance_of_a_place_has_a_closed_form(name):
    """Right below the middle of a bead, over a bed, and in the middle of an oval it is that of the
    circle, the plane and the half axis."""
    fitting, turn = pipe(name), math.radians(RELIEF[name].get("angle_deg", 0.0))
    point = np.array([0.05 * math.cos(turn), 0.05 * math.sin(turn), 0.15])
    wanted = {
        "weld": 0.027,
        "part of a weld": 0.025,
        "flat weld": 0.029,
        "deposit": 0.010,
        "ovality": None,
        "dent": 0.022,
        "corrosion": None,
    }[name]
    if wanted is not None:
        assert fitting.signed_distance(point)[0] == pytest.approx(wanted, abs=2e-6)
    if name != "ovality":
        return
    long = math.radians(20.0)
    for side, half in ((0.0, 0.08 * 1.03), (math.pi / 2, 0.08 * 0.97)):
        way = np.array([math.cos(long + side), math.sin(long + side), 0.0])
        d = fitting.signed_distance((half - 0.004) * way + [0, 0, 0.15])[0]
        assert d == pytest.approx(0.004, abs=2e-6)


def test_the_volume_of_a_bed_is_that_of_its_segment():
    """A bed far longer than its slopes takes away the segment of a circle, times its length."""
    deposit = RELIEF["deposit"] | {"length": 2.0, "at": 1.2}
    with_bed = fitting_mesh(Straight(2.4, relief=[deposit]), sections=600).volume
    without = fitting_mesh(Straight(2.4), sections=600).volume
    half = math.acos(0.06 / 0.08)
    segment = 0.08**2 * (half - math.sin(half) * math.cos(half))
    # Each slope is 20 mm high and 35 mm long; of a segment that shallow 2/5 of the area remains.
    slopes = 2 * 0.02 / math.tan(math.radians(30))
    low, high = segment * (2.0 - slopes), segment * (2.0 - 0.5 * slopes)
    assert low < with_bed - without < high
    assert with_bed - without == pytest.approx(segment * (2.0 - 0.6 * slopes), rel=2e-3)


@pytest.mark.parametrize("name", SEVERAL)
def test_meshes_lie_on_the_wall(name):
    """Corners of the inner surface of a fitting's mesh are on the exact wall, to 0.05 mm, and the
    mesh is one closed body."""
    fitting = pipe(*SEVERAL[name])
    mesh = fitting_mesh(fitting)
    distance = fitting.signed_distance(mesh.vertices)[0]
    inner = distance > -0.002
    assert np.abs(distance[inner]).max() < 5e-5
    assert inner.mean() > 0.4
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("name", SEVERAL)
def test_the_widest_place_of_a_bore_is_its_largest_radius(name):
    """To a tenth of a millimetre: it is that of the nodes of the heights."""
    fitting = pipe(*SEVERAL[name])
    places = places_of(fitting, np.array([[0.0, 0.0, 0.15]]), 2e-3)
    widest = np.hypot(places[:, 0], places[:, 1]).max()
    assert fitting.max_radius == pytest.approx(widest, abs=1e-4)


@pytest.mark.parametrize("name", SEVERAL)
def test_rays_end_on_the_wall(name):
    """Rays end on the wall, tell its normal, and pass through none."""
    fitting = pipe(*SEVERAL[name])
    parts = (Part("pipe", fitting, Pose()),)
    rays = unit(np.random.default_rng(2).normal((0.0, 0.0, 0.3), 1.0, (400, 3)))
    position = np.array([[0.01, -0.02, 0.1]])
    hits = RayWalls([parts]).trace(np.zeros(1, int), position, np.eye(3)[None], rays, 9)
    reach, normal = hits[0, :, 0], hits[0, :, 1:4]
    met = np.isfinite(reach)
    assert met.mean() > 0.6
    distance, gradient = fitting.signed_distance(position + reach[met, None] * rays[met])
    assert np.abs(distance).max() < 1e-8
    assert (normal[met] * gradient).sum(axis=1).min() > 1 - 1e-6
    for part in (0.3, 0.6, 0.95, 0.99):
        along = position + part * reach[met, None] * rays[met]
        assert fitting.signed_distance(along)[0].min() > 0


@pytest.mark.parametrize("shape", contact_lots.SHAPES)
@pytest.mark.parametrize("name", but_for(("all", "dent"), SEVERAL))
def test_contacts_tell_the_least_distance_of_any_body(name, shape):
    """The deepest contact of each type of geom is as deep as branch and bound over its whole
    surface finds, to 0.02 mm."""
    lot = contact_lots.Lot(pipe(*SEVERAL[name]), shape)
    lot._bore *= 0.7
    errors = lot.errors(12, np.random.default_rng([7]))
    assert errors.max() < 2e-5


def cost_of_a_contact(fitting: Straight, shape: str) -> float:
    """Return processor time, s, of the collision of a body that lies along the wall."""
    lot, reach = contact_lots.Lot(fitting, shape), {"capsule": 0.015, "wheel": 0.03}[shape]
    out = np.array([math.cos(0.3), math.sin(0.3), 0.0])
    away = fitting.signed_distance(0.06 * out + [0, 0, 0.15])[0] + 0.06
    lot.data.qpos[:3] = (away - reach + 2e-4) * out + [0, 0, 0.15]
    mujoco.mj_kinematics(lot.model, lot.data)
    times = []
    for _ in range(8):
        start = time.process_time()
        for _ in range(50):
            mujoco.mj_collision(lot.model, lot.data)
        times.append((time.process_time() - start) / 50)
    assert lot.data.ncon > 0
    return min(times)


def test_a_level_wall_costs_no_search_without_end():
    """A capsule along a wall that is out of round costs less than 15 times as much as at the ideal
    wall: some 3 times, where a proof from ball to ball takes over 100 times."""
    ideal = cost_of_a_contact(Straight(0.3), "capsule")
    assert cost_of_a_contact(pipe("ovality"), "capsule") < 15 * ideal


@pytest.mark.parametrize("name", but_for(("weld", "dent"), RELIEF))
def test_bodies_thrown_into_closed_pipes_stay_there(name):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later."""
    relief = [RELIEF[name]]
    network = thrown_bodies.fitting_alone({"kind": "straight", "length": 0.3, "relief": relief})
    check_that_thrown_bodies_stay(network)


@pytest.mark.parametrize("side", [0, 90])
def test_a_ball_swings_in_an_ovality_by_the_curvature_at_its_axis(side):
    """Without friction its period is that of a pendulum as long as the radius of curvature of
    r (1 + e / 2 cos 2 phi) at an axis, less the ball's, to 0.1 % at 1 ms."""
    ratio, ball, angle = 0.06, 0.02, 0.03
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    relief = [{"kind": "ovality", "ratio": ratio, "direction_deg": side}]
    level = {"kind": "straight", "name": "level", "length": 1.0, "relief": relief}
    network = ot.Network(place={"axis": (1, 0, 0)}, fittings=[level])
    ot.add_pipes(spec, network, priority=1, solref=[0.004, 1])
    sign = 1 if side == 0 else -1
    below = 0.08 * (1 + sign * ratio / 2)
    length = below**2 / (below + sign * 2 * ratio * 0.08) - ball
    start = [0.5, length * math.sin(angle), -below + ball + length * (1 - math.cos(angle))]
    measured, period = swing_period(spec, start, ball, length, angle)
    assert measured == pytest.approx(period, rel=1e-3)


def rolling(friction: float, height: float, width: float, ball: float) -> float:
    """Return how far, m, a ball rolls that a motor turns slowly along the floor to a bead 0.2 m
    from the beginning of a pipe, in 4 s."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.impratio = 0.0005, 100
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    weld = {"kind": "weld", "at": 0.2, "height": height, "width": width}
    level = {"kind": "straight", "name": "level", "length": 0.6, "relief": [weld]}
    network = ot.Network(place={"axis": (1, 0, 0)}, fittings=[level])
    ot.add_pipes(spec, network, friction=friction, solref=[0.001, 1])
    body = spec.worldbody.add_body(pos=[0.18, 0, -0.08 + ball])
    for axis in ([1, 0, 0], [0, 0, 1]):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(name="turn", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    body.add_geom(size=[ball, 0, 0], mass=1.0)
    motor = spec.add_actuator(name="motor", target="turn", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_velocity(kv=0.5)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.01 / ball
    mujoco.mj_step(model, data, 8000)
    return float(data.qpos[0])


def test_a_driven_wheel_climbs_a_bead_up_to_the_friction_of_statics():
    """Lifted off the floor it is held by the bead alone: it climbs if the friction is over the
    tangent of the angle between the contact's normal and the vertical, to 1 %."""
    ball, height, width = 0.03, 0.004, 0.012
    tube = (width**2 / 4 + height**2) / (2 * height)
    needed = math.tan(math.acos((ball + tube - height) / (ball + tube)))
    assert rolling(1.01 * needed, height, width, ball) > 0.015
    assert rolling(0.99 * needed, height, width, ball) < 0.005


@pytest.mark.parametrize("wall", [0.2, 0.9])
@pytest.mark.parametrize(("slope", "slides"), [(0.49, False), (0.51, True)])
def test_a_deposit_has_a_friction_of_its_own(slope, slides, wall):
    """A body that does not turn slides on a bed of friction 0.5 if that is less than the slope,
    whatever the friction of the wall."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.impratio = 0.001, 100
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.gravity = [9.81 * slope, 0, -9.81]
    deposit = {"kind": "deposit", "at": 0.5, "length": 0.9, "depth": 0.02, "friction": 0.5}
    level = {"kind": "straight", "name": "level", "length": 1.0, "relief": [deposit]}
    network = ot.Network(place={"axis": (1, 0, 0)}, fittings=[level])
    pipes = ot.add_pipes(spec, network, friction=wall)
    body = spec.worldbody.add_body(pos=[0.3, 0, -0.04])
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_geom(size=[0.02, 0, 0], mass=1.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    assert data.qpos[2] == pytest.approx(0.0, abs=1e-4)
    moved = 9.81 * (slope - 0.5) / math.hypot(1, 0) / 2
    assert data.qpos[0] == pytest.approx(moved if slides else 0.0, abs=2e-3)
    names = {model.geom(i).name for i in pipes.geoms(model)}
    assert {"wall_level", "deposit_level_0"} <= names


def tables(*relief: dict, **keys) -> list[dict]:
    """Tables of a file: a pipe with relief between two others."""
    plain = {"kind": "straight", "length": 0.3}
    return [
        plain | {"name": "a"},
        plain | {"name": "b", "relief": list(relief)} | keys,
        plain | {"name": "c"},
    ]


def in_a_row(pipes: list[dict], **keys) -> ot.Network:
    joints = [{"ports": ("a.end", "b.start")}, {"ports": ("b.end", "c.start")}]
    return ot.Network(fittings=pipes, joints=joints, **keys)


def test_a_deposit_lies_on_the_lowest_side():
    """Without an angle a bed is where gravity has it, however pipes are turned; a pipe that is
    steeper than 60 degrees has no lowest side."""
    bed = {"kind": "deposit", "at": 0.15, "length": 0.2, "depth": 0.02}
    for turn in (0.0, 70.0):
        network = in_a_row(tables(bed), place={"axis": (1.0, 0.3, 0.2), "turn_deg": turn})
        middle = network.pipes.parts[1]
        below = middle.pose.apply([0, 0, 0.15]) - [0, 0, 0.05]
        assert middle.signed_distance(below)[0] < 0.012
        assert middle.signed_distance(below + 0.1 * np.eye(3)[2])[0] > 0.02
    with pytest.raises(ot.NetworkError) as caught:
        in_a_row(tables(bed), place={"axis": (0.0, 0.0, 1.0)})
    (fault,) = caught.value.faults
    assert fault.where == "fittings.1.relief"
    assert "steep" in str(fault)
    assert len(in_a_row(tables(bed | {"angle_deg": 10.0})).pipes.parts) == 3


def test_relief_is_kept_in_files():
    """A network's file and a scenario's data have the relief of a pipe, and are read again as they
    were; a pipe without has no such key."""
    network = in_a_row(tables(RELIEF["weld"], RELIEF["part of a weld"], RELIEF["ovality"]))
    assert validate_network(tomllib.loads(network.to_toml())) == network
    assert network.pipes.parts[1].fitting == pipe("weld", "part of a weld", "ovality")
    scenario = validate({"name": "welds", "pipes": tables(RELIEF["weld"])})
    assert type(scenario).model_validate_json(scenario.model_dump_json()) == scenario
    data = json.loads(scenario.model_dump_json())["pipes"]
    assert ["relief" in one for one in data] == [False, True, False]
    assert ot.override(scenario, {"pipes.1.relief.0.height": 0.002}) != scenario
    table = {"fittings": [{"name": "b", **pipe("weld").to_table()}]}
    again = validate_network(table).fittings[0].fitting()
    assert again == pipe("weld")


@pytest.mark.parametrize(
    ("entry", "where", "told"),
    [
        ({"kind": "wled", "at": 0.1}, "kind", "weld"),
        ({"kind": "weld", "at": 0.001}, "at", "from 0.005 to 0.295 m"),
        ({"kind": "weld", "at": 0.1, "height": 0.006}, "height", "half its width"),
        ({"kind": "weld", "at": 0.1, "to_deg": -10.0}, "to_deg", "over from_deg, 0,"),
        ({"kind": "weld", "at": 0.1, "deep": 1.0}, "deep", "height"),
        ({"kind": "deposit", "at": 0.15, "length": 0.05, "depth": 0.02}, "length", "slopes"),
        ({"kind": "deposit", "at": 0.15, "length": 0.28, "depth": 0.08}, "depth", "0.076 m"),
        ({"kind": "ovality", "ratio": 0.3}, "ratio", "0.2"),
        ({"kind": "ovality", "ratio": 0.1, "at": 0.1, "length": 0.4}, "at", "does not fit into"),
    ],
)
def test_relief_that_cannot_be_is_told(entry, where, told):
    """Unknown kinds and keys, and what reaches beyond a pipe, are faults at their keys."""
    with pytest.raises(ot.ScenarioError) as caught:
        validate({"name": "wrong", "pipes": tables(RELIEF["weld"], entry)})
    (fault,) = caught.value.faults
    assert fault.where == f"pipes.1.relief.1.{where}"
    assert told in str(fault)


@pytest.mark.parametrize(
    ("relief", "told"),
    [
        (["weld"], "straight.relief.0: input should be a table (given: 'weld')"),
        ([{"at": 0.1}], "straight.relief.0.kind: is missing (choose from: ovality, "),
        ([{"kind": "weld", "at": 0.1, "hieght": 1.0}], "did you mean 'height'?"),
        ([{"kind": "weld", "at": 0.1, "height": -1.0}], "straight.relief.0.height: "),
        ({"kind": "weld", "at": 0.1}, "straight.relief: is a table; it must be a list"),
    ],
)
def test_relief_in_python_is_checked_as_in_files(relief, told):
    """What is no relief is a fault at its place, in the words of files."""
    with pytest.raises(ot.GeometryError) as caught:
        Straight(0.3, relief=relief)
    assert told in str(caught.value)


def test_an_entry_of_a_network_in_python_that_is_no_table_is_told():
    """It is told in words of files, not by the name of a class."""
    with pytest.raises(
        ot.NetworkError, match=r"relief\.0: input should be a table \(given: 'weld'\)"
    ):
        in_a_row(tables("weld"))


def test_a_section_has_deposits_alone():
    """A bead in an egg is refused, a bed lies on its invert."""
    egg = Straight(0.3, section="egg", relief=[RELIEF["deposit"] | {"angle_deg": 0.0}])
    assert egg.signed_distance(np.array([0.13, 0.0, 0.15]))[0] == pytest.approx(0.01, abs=1e-9)
    with pytest.raises(ot.GeometryError, match=r"straight\.relief\.0\.kind"):
        Straight(0.3, section="egg", relief=[RELIEF["weld"]])


def test_a_saved_model_asks_for_its_relief():
    """A model with relief in its wall is refused by a process that has not made these pipes."""
    spec = mujoco.MjSpec()
    ot.add_pipes(spec, Assembly((Part("pipe", pipe("ovality"), Pose()),)))
    model = spec.compile()
    record = model.geom_user[0]
    record[-10:-8] = 123456, 654321
    with pytest.raises(mujoco.FatalError, match="relief"):
        mujoco.MjData(model)


def test_the_list_of_a_network_names_its_relief(tmp_path):
    """A part's sizes end with the kinds of its relief, and how often there is each."""
    weld, dent = RELIEF["weld"], RELIEF["dent"]
    path = tmp_path / "welded.toml"
    path.write_text(in_a_row(tables(weld, dent, weld | {"at": 0.2})).to_toml())
    done = CliRunner().invoke(app, ["network", str(path)], env={"COLUMNS": "200"})
    assert "2 x weld, dent" in done.stdout
