"""Pipes whose bore is no circle: ovals, and the egg, mouth and arch of sewers."""

from __future__ import annotations

import json
import math
import tomllib

import contact_lots
import mujoco
import numpy as np
import pytest
import thrown_bodies
from in_pipes import check_that_thrown_bodies_stay, swing_period
from scipy.spatial import cKDTree

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Assembly, Part, Straight
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.pipes.sections import MAX_OVALITY, Section
from omnitrack_sim.scenario import validate
from omnitrack_sim.walls.export import network_geojson
from omnitrack_sim.walls.meshes import ManifoldKit, network_mesh
from omnitrack_sim.walls.rays import RayWalls

OVAL = {"section": "oval", "ovality": 0.06}
SECTIONS = {
    "oval": OVAL | {"direction": 0.4},
    "flat oval": {"section": "oval", "ovality": MAX_OVALITY, "direction": -2.0},
    "egg": {"section": "egg", "direction": 1.0},
    "mouth": {"section": "mouth", "direction": -0.7},
    "arch": {"section": "arch", "direction": 3.0},
}


def pipe(name: str, length: float = 0.3) -> Straight:
    return Straight(length, **SECTIONS[name])


def shape_of(fitting: Straight) -> Section:
    assert fitting.shape is not None
    return fitting.shape


@pytest.mark.parametrize(
    ("name", "area", "circumference", "width", "height"),
    [
        # DIN 4263 has areas and circumferences of full pipes in half widths.
        ("egg", 4.594, 7.930, 2.0, 3.0),
        ("mouth", 2.378, 5.603, 2.0, 1.5),
        # ASTM C506, 18 by 11 inches: 1.1 square feet.
        ("arch", 1.09 * 144 / 81, None, 2.0, 11 / 9),
    ],
)
def test_the_sections_of_sewers_are_those_of_their_standards(
    name, area, circumference, width, height
):
    """Area, circumference, width and height, in half widths, are the standards' figures."""
    places = Section(name, 2.0).points(np.linspace(0, 2 * np.pi, 200_001))
    x, y = places.T
    assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2 == pytest.approx(area, rel=5e-4)
    around = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    assert circumference is None or around == pytest.approx(circumference, rel=2e-4)
    assert np.ptp(y) == pytest.approx(width, abs=1e-6)
    assert np.ptp(x) == pytest.approx(height, rel=1.2e-3)


def test_the_volume_of_an_oval_pipe_is_that_of_its_ellipse():
    """The solid of a bore has the volume of its axes, but for the corners of the drawn section."""
    fitting = Straight(0.5, **OVAL)
    volume = fitting.fill(ManifoldKit(2000), 0.0).volume()
    a, b = 0.08 * 1.03, 0.08 * 0.97
    assert volume == pytest.approx(math.pi * a * b * 0.5, rel=1e-5)
    assert 2 * (a - b) / 0.16 == pytest.approx(fitting.ovality)
    assert (fitting.max_radius, fitting.port_radius("end")) == pytest.approx((a, b))


@pytest.mark.parametrize("name", SECTIONS)
def test_the_distance_is_that_of_the_nearest_place(name):
    """In the bore and deep in the wall the distance is that of the nearest of 200,000 places of the
    edge, to their spacing, and the gradient leads there; on the axis, too."""
    fitting = pipe(name)
    edge = shape_of(fitting).points(np.linspace(0, 2 * np.pi, 200_001))
    reach, points = 1.3 * fitting.max_radius, np.zeros((3000, 3))
    points[:, :2] = np.random.default_rng(1).uniform(-reach, reach, (3000, 2))
    turn = fitting.direction
    # Along its axis of symmetry two places may be as near.
    points[:40, :2] = np.linspace(-reach, reach, 40)[:, None] * [math.cos(turn), math.sin(turn)]
    # Close to it the nearest place is beside it, and hard to find.
    points[40:80, :2] = points[:40, :2] + 10.0 ** np.linspace(-16, -4, 40)[:, None]
    points[0] = 0.0
    distance, gradient = fitting.signed_distance(points)
    away = cKDTree(edge).query(points[:, :2])[0]
    np.testing.assert_allclose(np.abs(distance), away, atol=1e-6)
    polar = np.arctan2(points[:, 1], points[:, 0])
    inside = np.hypot(*points.T[:2]) < shape_of(fitting).radii(polar)
    assert (inside == (distance > 0)).all()
    feet = points - distance[:, None] * gradient
    assert cKDTree(edge).query(feet[:, :2])[0].max() < 1e-5
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-12)
    assert distance[0] == pytest.approx(fitting.port_radius("start"))


@pytest.mark.parametrize("name", SECTIONS)
def test_the_widest_place_of_a_section_is_its_largest_radius(name):
    """Free places are found up to it, and none beyond, all round."""
    fitting = pipe(name)
    angle = np.linspace(-np.pi, np.pi, 4000)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    for part, held in ((1 - 1e-4, True), (1 + 1e-6, False)):
        points = [0.0, 0.0, 0.15] + part * fitting.max_radius * circle
        assert (fitting.signed_distance(points)[0] > 0).any() == held


@pytest.mark.parametrize("name", SECTIONS)
def test_rays_and_pictures_are_of_the_section(name):
    """Rays of a camera end on the wall, pass through none, tell its normal and, squarely lit, the
    lamp's angle; in pipes joined to each other as in one."""
    turn = math.degrees(SECTIONS[name]["direction"])
    table = {k: v for k, v in SECTIONS[name].items() if k != "direction"} | {"direction_deg": turn}
    parts = [{"kind": "straight", "name": f"p{i}", "length": 0.3, **table} for i in range(2)]
    pipes = ot.Network(fittings=parts, joints=[{"ports": ("p0.end", "p1.start")}]).pipes
    rays = unit(np.random.default_rng(2).normal((0.0, 0.0, 0.5), 1.0, (500, 3)))
    position, lamp = np.array([[0.01, -0.02, 0.25]]), np.array([0.0, 0.0, 0.0])
    hits = RayWalls([pipes.parts]).trace(np.zeros(1, int), position, np.eye(3)[None], rays, 9, lamp)
    reach, normal, lit = hits[0, :, 0], hits[0, :, 1:4], hits[0, :, 5]
    met = np.isfinite(reach)
    assert met.mean() > 0.6
    ends = position + reach[met, None] * rays[met]
    distance, gradient = pipes.parts[0].fitting.signed_distance(ends)
    assert np.abs(distance).max() < 1e-9
    assert (normal[met] * gradient).sum(axis=1).min() > 1 - 1e-9
    np.testing.assert_allclose(lit[met], -(normal[met] * rays[met]).sum(axis=1), atol=0.05)
    for part in (0.3, 0.6, 0.95):
        along = position + part * reach[met, None] * rays[met]
        assert pipes.parts[0].fitting.signed_distance(along)[0].min() > 0


@pytest.mark.parametrize("shape", contact_lots.SHAPES)
@pytest.mark.parametrize("name", ["oval", "egg", "mouth", "arch"])
def test_contacts_tell_the_least_distance_of_any_body(name, shape):
    """As in a round pipe, whose distance is concave along lines as well: of each type of geom the
    deepest contact is as deep as branch and bound finds."""
    lot = contact_lots.Lot(contact_lots.FITTINGS[name], shape)
    errors = lot.errors(25, np.random.default_rng([7]))
    assert errors.max() < 1e-5


@pytest.mark.parametrize("name", ["oval", "egg", "mouth", "arch"])
def test_bodies_thrown_into_closed_pipes_stay_there(name):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later."""
    network = thrown_bodies.fitting_alone(thrown_bodies.FITTINGS[name])
    check_that_thrown_bodies_stay(network)


@pytest.mark.parametrize("shape", ["sphere", "wheel", "ellipsoid", "box"])
@pytest.mark.parametrize("name", ["oval", "egg", "mouth"])
def test_an_open_end_is_an_edge_in_the_shape_of_the_section(name, shape):
    """A body that hangs out of either end touches the edge no less deep than one of 4,000 places of
    it lies in the body, by MuJoCo's own distance of geoms, and not twice as deep."""
    spec = mujoco.MjSpec()
    fitting = pipe(name)
    ot.add_pipes(spec, Assembly((Part("pipe", fitting, Pose()),)))
    geom = contact_lots.add_body(spec, shape)
    geom.margin = 0.003
    probe = spec.worldbody.add_body(mocap=True)
    probe.add_geom(size=[1e-6, 0, 0], contype=0, conaffinity=0)
    model = spec.compile()
    data, rng, seen = mujoco.MjData(model), np.random.default_rng(5), 0
    places = shape_of(fitting).points(np.linspace(0, 2 * np.pi, 4001))
    for port, height, sign in (("end", 0.3, 1), ("start", 0.0, -1)):
        for _ in range(12):
            middle = 0.75 * places[rng.integers(4000)]
            data.qpos[:3] = [*middle, height + sign * rng.uniform(-0.01, 0.02)]
            data.qpos[3:] = unit(rng.normal(size=4))
            near = places[np.linalg.norm(places - middle, axis=1) < 0.07]
            least = 0.01
            for place in near:
                data.mocap_pos[0] = [*place, height]
                mujoco.mj_kinematics(model, data)
                gap = mujoco.mj_geomDistance(
                    model, data, model.ngeom - 2, model.ngeom - 1, 0.01, None
                )
                least = min(least, gap + 1e-6)
            mujoco.mj_forward(model, data)
            if not -2e-3 < least < 1.5e-3:
                continue
            edges = [
                c.dist for c in data.contact if model.geom(c.geom[0]).name == f"rim_pipe_{port}"
            ]
            assert data.contact.dist.min() < least + 3e-5
            assert min(edges, default=least) > least + min(least, 0.0) - 1e-4
            seen += len(edges) > 0
    assert seen > 0


@pytest.mark.parametrize("side", [0, 90])
def test_a_ball_swings_in_an_oval_by_the_curvature_at_its_axis(side):
    """Without friction its period at the end of either axis is that of a pendulum as long as the
    radius of curvature there less the ball's, to 0.1 % at 1 ms."""
    a, b, ball, angle = 0.08 * 1.03, 0.08 * 0.97, 0.02, 0.03
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    # The x axis of a pipe along the world's x points down.
    level = {"kind": "straight", "name": "level", "length": 1.0, "direction_deg": side, **OVAL}
    network = ot.Network(place={"axis": (1, 0, 0)}, fittings=[level])
    ot.add_pipes(spec, network, priority=1, solref=[0.004, 1])
    below, curved = (a, b * b / a) if side == 0 else (b, a * a / b)
    length = curved - ball
    start = [0.5, length * math.sin(angle), -below + ball + length * (1 - math.cos(angle))]
    measured, period = swing_period(spec, start, ball, length, angle)
    assert measured == pytest.approx(period, rel=1e-3)


def straights(*tables) -> list[dict]:
    """Tables of a file: straights by their further keys, joined in a row."""
    return [
        {"kind": "straight", "name": f"p{i}", "length": 0.3} | table
        for i, table in enumerate(tables)
    ]


def joined(*tables, turn_deg=0.0) -> ot.Network:
    """Straights joined in a row, all turned by an angle against the one before."""
    joints = [
        {"ports": (f"p{i}.end", f"p{i + 1}.start"), "turn_deg": turn_deg}
        for i in range(len(tables) - 1)
    ]
    return ot.Network(fittings=straights(*tables), joints=joints)


def test_joined_sections_are_the_same_and_stand_the_same_way():
    """A section is joined to an equal one, its direction being that of the pipe's x axis, which a
    turned joint turns; any other is refused, by name."""
    oval, egg = OVAL | {"direction_deg": 20.0}, {"section": "egg", "direction_deg": 20.0}
    assert len(joined(oval, oval).pipes.parts) == 2
    turned = joined(egg, egg | {"direction_deg": -10.0}, turn_deg=30.0)
    # An ellipse is symmetric about both axes, an egg about one.
    assert len(joined(oval, oval | {"direction_deg": 200.0}).pipes.parts) == 2
    wrong = [
        (oval, {}),
        (oval, egg),
        (oval, oval | {"ovality": 0.08}),
        (oval, oval | {"direction_deg": 21.0}),
        (egg, egg | {"inner_diameter": 0.1601}),
        (egg, egg | {"direction_deg": 200.0}),
    ]
    for one, other in wrong:
        with pytest.raises(ot.NetworkError) as caught:
            joined(one, other)
        assert "'p0' (end) to 'p1' (start)" in str(caught.value)
    samples = turned.pipes.parts[1].bore_samples()
    # Samples of a bore stay 5 % off its wall, measured from the axis.
    assert 0 < turned.pipes.parts[1].signed_distance(samples)[0].min() < 0.006
    assert network_mesh(turned.pipes).volume > 0


def test_parts_that_run_into_the_wide_side_of_a_section_are_refused():
    """An egg of 160 mm reaches 160 mm below its axis: a pipe that passes 120 mm below it runs into
    it, one above does not."""
    for place, clash in ((0.22, True), (-0.22, False)):
        tables = {
            "fittings": straights({"section": "egg"}, {}),
            "places": [
                {"fitting": "p1", "position": (place, -0.15, 0.15), "axis": (0.0, 1.0, 0.0)}
            ],
        }
        if clash:
            with pytest.raises(ot.NetworkError, match="runs into"):
                ot.Network(**tables)
        else:
            assert len(ot.Network(**tables).pipes.parts) == 2


def test_sections_are_kept_in_files():
    """A network's file has the keys of a section, and a pipe that is round none of them; both are
    read again as they were, and written for maps."""
    network = joined(OVAL | {"direction_deg": 30.0}, OVAL | {"direction_deg": 30.0})
    text = network.to_toml()
    assert text.count('section = "oval"') == text.count("direction_deg = 30.0") == 2
    assert validate_network(tomllib.loads(text)) == network
    assert "section" not in joined({}, {}).to_toml()
    features = json.loads(network_geojson(network.pipes))["features"]
    assert [f["properties"]["section"] for f in features] == ["oval", "oval"]
    scenario = validate({"name": "egg", "pipes": straights({"section": "egg"}, {"section": "egg"})})
    assert type(scenario).model_validate_json(scenario.model_dump_json()) == scenario
    plain = validate({"name": "plain", "pipes": straights({}, {})}).model_dump()
    assert not {"section", "ovality", "direction_deg"} & set(plain["pipes"][0])


@pytest.mark.parametrize(
    ("keys", "where", "told"),
    [
        ({"section": "square"}, "section", "circle, oval"),
        ({"section": "oval"}, "ovality", "over 0"),
        ({"section": "oval", "ovality": 0.6}, "ovality", "0.5"),
        ({"section": "egg", "ovality": 0.1}, "ovality", "only a section 'oval'"),
        ({"ovality": 0.1}, "ovality", "only a section 'oval'"),
        ({"direction_deg": 10.0}, "direction", "a circle has no direction"),
    ],
)
def test_keys_of_a_section_that_do_not_go_together_are_told(keys, where, told):
    """Unknown sections, ovality of anything but an oval, and a direction of a circle are faults at
    their keys, in a file and in Python."""
    with pytest.raises(ot.ScenarioError) as caught:
        validate({"name": "wrong", "pipes": straights(keys)})
    (fault,) = caught.value.faults
    assert fault.where.startswith(f"pipes.0.{where}")
    assert told in str(fault)
    with pytest.raises(ot.GeometryError):
        Straight(0.3, **{key.removesuffix("_deg"): value for key, value in keys.items()})


@pytest.mark.parametrize("side", [0, 90])
def test_a_modules_spring_follows_the_oval(side):
    """Without gravity each module slides to the oval's wall, and presses by its preload less its
    stiffness times the slide: 0.1 % where the wall faces the module, 1 % where it leans."""
    oval = {"kind": "straight", "length": 0.8, "section": "oval", "ovality": 0.05}
    still = {"run": {"time_limit": 2.0}, "world": {"gravity": [0.0, 0.0, 0.0]}}
    scenario = validate({"name": "oval", "pipes": [oval | {"direction_deg": side}], **still})
    trajectory, robot = ot.run(scenario, no_load=False).trajectory, scenario.robot
    slide, force = trajectory["slide"][-1], trajectory["normal_force"][-1]
    angles = np.radians([0.0, 120.0, -120.0])
    walls = shape_of(scenario.route.passages[0].part.fitting).radii(angles) - 0.08
    np.testing.assert_allclose(slide, walls, atol=2.5e-4)
    assert np.abs(slide).max() > 1.5e-3
    spring = robot.preload - robot.module_stiffness * slide
    np.testing.assert_allclose(force, spring, rtol=1e-2)
    assert force[0] == pytest.approx(spring[0], rel=1e-3)


@pytest.mark.parametrize("collider", ["exact", "primitives"])
def test_a_robot_drives_through_an_egg(collider):
    """A level egg, its invert down, is passed by the robot with either collider, over a joint."""
    egg = {"section": "egg", "length": 0.5}
    level = {"start": {"axis": [1.0, 0.0, 0.0]}, "physics": {"collider": collider}}
    result = ot.run(validate({"name": "egg", "pipes": straights(egg, egg), **level}))
    assert result.success
    # Its lower modules stand wider than in a round bore, and one may hang free below the axis.
    assert result.metrics["normal_force_mean_n"][1] > 5
    down = result.trajectory["position"][-1, 2]
    assert -0.03 < down < 0.0
