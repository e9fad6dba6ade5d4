"""The contract of ``pipes.fittings.Fitting``, for every kind that comes with the package and for
one from outside it."""

from __future__ import annotations

import itertools
import math

import bulge
import mujoco
import numpy as np
import pytest
import reference_surfaces
from trimesh import Trimesh

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.base.table import Unit, marks_of
from omnitrack_sim.pipes import Arcs, Assembly, Fitting, Part
from omnitrack_sim.pipes.compiled import HIGH, LOW
from omnitrack_sim.pipes.fittings.base import MAX_PORTS, MAX_SIZES
from omnitrack_sim.pipes.fittings.kinds import fitting_class, shipped_fittings
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.model import unit_of
from omnitrack_sim.show.projection import bore_faces
from omnitrack_sim.walls.geoms import add_walls
from omnitrack_sim.walls.meshes import THICKNESS, fitting_mesh

OUTSIDE = "bulge:Bulge"
REQUIRED = {
    "cap": {"length": 0.3},
    "straight": {"length": 0.3},
    "reducer": {"length": 0.1, "end_diameter": 0.14},
    OUTSIDE: {"length": 0.2},
}
"""Keys without a default; a kind that has a default for every key needs no entry."""
KINDS = [*shipped_fittings(), OUTSIDE]
HALF = 0.04


MORE = {
    "widening reducer": ("reducer", {"length": 0.1, "end_diameter": 0.15, "inner_diameter": 0.12}),
    "short elbow": ("elbow", {"mean_radius": 0.09}),
    "reducing wye": ("wye", {"angle_deg": 60.0, "branch_diameter": 0.1}),
    "reducing tee": ("wye", {"angle_deg": 90.0, "branch_diameter": 0.12}),
    "lean wye": ("wye", {"angle_deg": 30.0, "branch_diameter": 0.12}),
    "reducing cross": ("cross", {"branch_diameter": 0.1}),
    "oblique cross": ("cross", {"angle_deg": 50.0}),
    "lean reducing cross": ("cross", {"angle_deg": 30.0, "branch_diameter": 0.12}),
    "deflected joint": ("mitre", {"angle_deg": 5.0}),
    "sharp mitre": ("mitre", {"angle_deg": 135.0}),
    "oval": (
        "straight",
        {"length": 0.3, "section": "oval", "ovality": 0.06, "direction_deg": 20.0},
    ),
    "egg": ("straight", {"length": 0.3, "section": "egg", "direction_deg": -100.0}),
    "mouth": ("cap", {"length": 0.3, "section": "mouth", "direction_deg": 50.0}),
    "arch": ("straight", {"length": 0.3, "section": "arch"}),
    "step": ("coupling", {"end_diameter": 0.15}),
    "old joint": (
        "coupling",
        {"offset": 0.004, "angle_deg": 2.5, "gap": 0.012, "depth": 0.01, "direction_deg": 40.0},
    ),
}
"""Other sizes of the same kinds."""


def example(kind: str) -> Fitting:
    kind, keys = MORE.get(kind, (kind, REQUIRED.get(kind, {})))
    fitting = fitting_class(kind)
    return fitting.from_table(fitting.Table(**keys))


def inside(fitting: Fitting, count: int, seed: int, margin: float = 0.0) -> np.ndarray:
    """Points (n, 3) m in the bore, or up to 3 mm in the wall, between the ports."""
    low, high = fitting.bounds
    points = np.random.default_rng(seed).uniform(low, high, (3 * count, 3))
    kept = (fitting.signed_distance(points)[0] > -0.003) & (fitting.extent(points) > margin)
    return points[kept][:count]


@pytest.fixture(params=[*KINDS, *MORE])
def fitting(request) -> Fitting:
    return example(request.param)


def test_ports_are_frames_that_look_out(fitting):
    """A port's frame is right-handed with z out of the fitting, its rim on the wall."""
    assert tuple(fitting.ports) == fitting.port_names
    assert set(fitting.default_way) <= set(fitting.port_names)
    for name, port in fitting.ports.items():
        z = port.rotation[:, 2]
        assert np.allclose(port.rotation.T @ port.rotation, np.eye(3))
        assert np.linalg.det(port.rotation) == pytest.approx(1)
        assert (
            fitting.extent(port.position - 0.01 * z) > 0 > fitting.extent(port.position + 0.01 * z)
        )
        assert fitting.extent(port.position) == pytest.approx(0, abs=1e-9)
        edge = fitting.outline(name, np.array([0.0, np.pi / 2]))
        rim = port.position + edge[:, None] * port.rotation[:, :2].T
        assert np.allclose(fitting.signed_distance(rim)[0], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "lengths"),
    [
        (ot.Tee, {"run_length": 0.32, "branch_length": 0.16, "fillet_radius": 0.005}),
        (ot.Wye, {"run_length": 0.44, "branch_length": 0.22, "fillet_radius": 0.005}),
        (ot.Cross, {"run_length": 0.32, "branch_length": 0.16}),
        (ot.Mitre, {"leg_length": 0.1, "fillet_radius": 0.0025}),
    ],
)
@pytest.mark.parametrize("bore", [0.1, 0.16, 0.3])
def test_fittings_are_similar_in_every_bore(kind, lengths, bore):
    """Where a file or a caller gives the bore alone all lengths are in proportion to it, the
    branch's bore too; at 160 mm they are the figures of the documentation."""
    fitting, scale = kind(inner_diameter=bore), bore / 0.16
    own = {name: getattr(fitting, name) for name in lengths}
    assert own == pytest.approx({name: scale * length for name, length in lengths.items()})
    points = inside(kind(), 200, 3)
    distance = fitting.signed_distance(scale * points)[0]
    assert distance == pytest.approx(scale * kind().signed_distance(points)[0], abs=1e-9)
    table = kind.Table(inner_diameter=bore)
    assert kind.from_table(table) == fitting
    # At the bore of 160 mm nothing rounds: trajectories are the same to the bit.
    assert bore != 0.16 or own == lengths


def test_axis_curves_lead_from_port_to_port(fitting):
    """Between any two ports the curve starts and ends at them along their axes, and stays in the
    bore; there and back it is as long where both arcs are."""
    part = Part("part", fitting, Pose())
    for enter, leave in itertools.permutations(fitting.port_names, 2):
        line = part.axis(enter, leave)
        point, tangent, _, _ = line.at(np.array([0.0, line.length]))
        ports = [fitting.ports[enter], fitting.ports[leave]]
        assert np.allclose(point, [port.position for port in ports])
        assert np.allclose(tangent, [-ports[0].rotation[:, 2], ports[1].rotation[:, 2]])
        assert fitting.axis_curve(enter, leave, Arcs()).length == pytest.approx(line.length)
        along = line.at(np.linspace(0, line.length, 50))[0]
        narrowest = min(fitting.port_radius(port) for port in fitting.port_names)
        assert fitting.signed_distance(along)[0].min() > 0.45 * narrowest
        there, back = (
            fitting.axis_curve(*ends, Arcs(0.1, 0.1)).length
            for ends in ((enter, leave), (leave, enter))
        )
        assert there == pytest.approx(back)


def test_axes_tell_length_and_bores(fitting):
    """The axes have the bores of the ports at their ends, and add up to the fitting's length."""
    radii = {fitting.port_radius(port) for port in fitting.port_names}
    found = {r for axis in fitting.axes for r in (axis.start_radius, axis.end_radius)}
    assert found == radii
    assert max(map(fitting.port_reach, fitting.port_names)) == fitting.max_radius
    assert max(radii) == fitting.max_radius or not fitting.is_round
    assert sum(a.curve.length for a in fitting.axes) == pytest.approx(fitting.length_of_axes)


def test_descriptions_are_of_one_cloth(fitting):
    """A way round a branch is a turn with an opening; words are the same both ways or tell which
    is which."""
    for enter, leave in itertools.permutations(fitting.port_names, 2):
        told = fitting.describe(enter, leave)
        assert told.words
        if told.into_branch or told.out_of_branch:
            assert told.manoeuvre == "tee_turn"
        if told.manoeuvre in ("tee_turn", "tee_straight"):
            assert told.opening is not None
        length = fitting.axis_curve(enter, leave, Arcs()).length
        middle, half = told.opening or (length / 2, 0.0)
        # Round the sharp side of a lean branch the way is shorter than the mouth.
        assert 0 < middle - half <= middle + half < 3 * length


def test_the_turn_angle_is_between_the_axes_of_the_ports(fitting):
    """A way turns by the angle from the axis it comes in along to the one it goes out along."""
    for enter, leave in itertools.permutations(fitting.port_names, 2):
        inward, outward = -fitting.ports[enter].rotation[:, 2], fitting.ports[leave].rotation[:, 2]
        sine, cosine = np.linalg.norm(np.cross(inward, outward)), inward @ outward
        assert fitting.describe(enter, leave).turn_angle == pytest.approx(np.arctan2(sine, cosine))


def test_gradient_is_the_derivative(fitting):
    """The gradient of the distance has length 1 and equals central differences, off ridges."""
    points, h = inside(fitting, 400, 1), 1e-6
    gradient = fitting.signed_distance(points)[1]
    sides = [
        fitting.signed_distance(points + h * e)[0] - fitting.signed_distance(points - h * e)[0]
        for e in np.eye(3)
    ]
    assert np.allclose(np.linalg.norm(gradient, axis=-1), 1)
    off = np.linalg.norm(np.stack(sides, -1) / (2 * h) - gradient, axis=-1)
    assert np.quantile(off, 0.98) < 1e-4


def test_the_surface_is_that_of_an_independent_formula(fitting):
    """Distance and gradient in the bore are those of an independent NumPy formula."""
    assert len(fitting.sizes) <= MAX_SIZES
    points = inside(fitting, 2000, 2)
    distance, gradient = fitting.signed_distance(points)
    points, gradient, distance = (a[distance > 1e-3] for a in (points, gradient, distance))
    if isinstance(fitting, bulge.Bulge):
        return
    wanted, slope = reference_surfaces.signed_distance(fitting, points)
    np.testing.assert_allclose(distance, wanted, atol=1e-11)
    # On a ridge between two walls the nearest point jumps.
    assert (np.abs(gradient - slope).max(axis=-1) < 1e-7).mean() > 0.998


def test_the_span_of_a_line_is_what_lies_between_the_ports(fitting):
    """Of a line near the wall the span holds what is well between the ports, and nothing well
    beyond them."""
    assert len(fitting.port_names) <= MAX_PORTS
    rng = np.random.default_rng(3)
    points = inside(fitting, 3000, 4)
    distance, gradient = fitting.signed_distance(points)
    near = (points - (distance - 0.025)[:, None] * gradient)[distance > 0.025][:300]
    _, gradient = fitting.signed_distance(near)
    axes = rng.normal(size=near.shape)
    axes = unit(axes - (axes * gradient).sum(-1, keepdims=True) * gradient)
    s, seen = np.linspace(-HALF, HALF, 41), 0
    sizes, ends = np.array(fitting.sizes), np.ones(len(fitting.port_names))
    for point, axis in zip(near, axes, strict=True):
        line = point + s[:, None] * axis
        out = np.array([-HALF, HALF, 1.0, 1.0])
        fitting.wall.span(sizes, ends, *point.tolist(), *axis.tolist(), out)
        within = (s >= out[LOW]) & (s <= out[HIGH])
        extent, distance = fitting.extent(line), fitting.signed_distance(line)[0]
        beside = (distance > 0.005) & (distance < 0.05)
        assert within[beside & (extent > 0.01)].all()
        assert (extent[within & beside] > -0.01).all()
        seen += len(s) - within.sum()
    assert seen > 50


def test_walls_are_where_the_surface_is(fitting):
    """Rays within the bore meet the pieces of the wall within 0.1 mm of the exact surface, and
    within 0.5 mm by a rounded rim."""
    spec = mujoco.MjSpec()
    add_walls(spec, Assembly((Part("pipe", fitting, Pose()),)))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(5)
    points = inside(fitting, 1500, 6, 2e-3)
    points = points[fitting.signed_distance(points)[0] > 1e-3]
    rays = unit(rng.normal(size=points.shape))
    exact = np.zeros(len(points))
    for _ in range(100):
        exact += np.maximum(fitting.signed_distance(points + rays * exact[:, None])[0], 0)
    ends = points + rays * exact[:, None]
    kept = (fitting.extent(ends) > 2e-3) & (np.abs(fitting.signed_distance(ends)[0]) < 1e-6)
    points, rays, ends = points[kept], rays[kept], ends[kept]
    geom = np.zeros(1, np.int32)
    error = []
    for point, ray in zip(points, rays, strict=True):
        length = mujoco.mj_ray(model, data, point, ray, None, 1, -1, geom)
        assert length > 0
        error.append(float(fitting.signed_distance(point + length * ray)[0]))
    assert len(error) > 300
    assert np.abs(error).max() < 5.5e-4
    assert np.quantile(np.abs(error), 0.8) < 1.1e-4


def test_the_mesh_is_a_solid_on_the_surface(fitting):
    """Watertight, of genus openings - 1, corners on the inner surface or outside the bore."""
    mesh = Trimesh(*fitting_mesh(fitting), process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0
    openings = len(fitting.ports) - len(fitting.closed_ports)
    assert 1 - mesh.euler_number / 2 == openings - 1
    distance = fitting.signed_distance(np.asarray(mesh.vertices))[0]
    inner = distance > -THICKNESS / 2
    assert inner.sum() > 100
    assert np.abs(distance[inner]).max() < 3e-4


def test_the_table_and_back(fitting):
    """A fitting's table gives an equal fitting, every number has its unit, bores their keys."""
    table = fitting.to_table()
    assert fitting_class(table.pop("kind")) is type(fitting)
    assert type(fitting).from_table(fitting.Table(**table)) == fitting
    numbers = {key for key, value in table.items() if not isinstance(value, str)}
    assert set(marks_of(fitting.Table, Unit)) == numbers
    for port in fitting.port_names:
        edge = fitting.edge(port)
        bore = 2 * fitting.port_radius(port) if edge is None else edge.size
        assert table[fitting.bore_key(port)] == bore
    assert all(unit_of(f"pipes.0.{key}") for key in numbers)


def test_it_is_drawn(fitting):
    """Its faces in drawings lie on the wall but where a branch leaves the run."""
    corners = bore_faces(Assembly((Part("part", fitting, Pose()),))).reshape(-1, 3)
    distance = np.abs(fitting.signed_distance(corners)[0])
    assert np.median(distance) < 5e-3


def test_kinds_of_the_folder_are_found():
    """The shipped kinds are found in their folder, each by its own word."""
    assert {"elbow", "reducer", "straight", "tee"} <= set(shipped_fittings())
    for kind, fitting in shipped_fittings().items():
        assert fitting.kind == fitting.file_kind() == kind
        assert ".pipes.fittings." in fitting.__module__


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("crank", "cross"),
        ("no_such_module:Cross", "cannot be imported"),
        ("bulge:Cross", "there is no 'Cross'"),
        ("math:sin", "is no fitting"),
        ("omnitrack_sim.pipes:Fitting", "is no fitting"),
    ],
)
def test_a_kind_that_does_not_exist_is_told_with_the_choices(kind, told):
    """Words that are no kind, modules that are not there and classes that are no fittings."""
    with trusting(), pytest.raises(InputError) as caught:
        fitting_class(kind)
    assert told in str(caught.value)
    assert "straight" in caught.value.faults[0].choices


ROUTE = [
    {"kind": "straight", "length": 0.3},
    {"kind": OUTSIDE, "length": 0.2, "enter": "end"},
    {"kind": "straight", "length": 0.3},
]


@pytest.mark.parametrize("collider", ["primitives", "exact"])
def test_a_robot_drives_through_a_fitting_from_outside(collider):
    """A scenario names the user's class; the robot passes it with either collider."""
    scenario = validate({"name": "outside", "pipes": ROUTE, "physics": {"collider": collider}})
    assert scenario.pipes[1].model_dump()["leave"] == "start"
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    result = ot.run(scenario)
    assert result.success
    assert result.provenance["collider"] == collider
    assert [passage.name for passage in result.timeline()] == [
        "straight_0",
        "bulge_1",
        "straight_2",
    ]
    assert result.metrics["tilt_max_deg"] < 2


@pytest.mark.parametrize(
    ("name", "words", "turn_deg", "collider"),
    [
        ("wye_turn", "run to branch", 45, "exact"),
        ("wye_turn", "run to branch", 45, "primitives"),
        ("wye_merge", "branch to run", 45, "exact"),
        ("wye_straight", "over the run", 0, "exact"),
        ("wye_sharp", "run to branch", 135, "exact"),
    ],
)
def test_a_robot_passes_a_wye(name, words, turn_deg, collider):
    """The shipped scenarios of a wye end as they expect; walls of primitives take it, too."""
    scenario = ot.override(ot.load_scenario(name), {"physics.collider": collider})
    passage = scenario.route.passages[1]
    assert (passage.words, passage.description.turn_angle) == (
        words,
        pytest.approx(np.radians(turn_deg)),
    )
    assert ot.run(scenario, no_load=False).outcome == scenario.run.expected_outcome


def test_a_corner_has_the_same_size_both_ways():
    """Into a smaller branch and out of it, the corner counts with the bore of the run, in which the
    wall is lost; the robot prepares for it in the bore it comes from."""
    run, branch = ({"kind": "straight", "length": 0.4, "inner_diameter": d} for d in (0.16, 0.14))
    wye = {"kind": "wye", "angle_deg": 60.0, "branch_diameter": 0.14}
    into = [run, wye | {"enter": "run_start", "leave": "branch"}, branch]
    out = [branch, wye | {"enter": "branch", "leave": "run_start"}, run]
    scenarios = [validate({"pipes": pipes}) for pipes in (into, out)]
    passages = [scenario.route.passages[1] for scenario in scenarios]
    assert [p.radius for p in passages] == [0.08, 0.07]
    assert [p.corner_radius for p in passages] == [0.08, 0.08]
    controllers = [ot.Simulation([scenario]).controller for scenario in scenarios]
    aligners = [c.aligner for c in controllers if isinstance(c, JacobianController)]
    turn, merge = (
        (np.abs(a.ranges.best) + a.ranges.half_width)[:, 0, 0, 0] for a in aligners
    )  # the far borders
    assert turn == pytest.approx(merge)


def test_a_network_has_a_fitting_from_outside():
    """A network file names the user's class; it has a length, a route and a file again."""
    network = validate_network(
        {
            "fittings": [
                {"name": "a", "kind": "straight", "length": 0.3},
                {"name": "b", "kind": OUTSIDE, "length": 0.2, "depth": 0.003},
            ],
            "joints": [{"ports": ["a.end", "b.start"]}],
        }
    )
    assert network.length == pytest.approx(0.5)
    assert isinstance(network.pipes.parts[1].fitting, bulge.Bulge)
    way = ot.shortest_route(network, "a.start", "b.end")
    assert [passage.words for passage in way.passages] == ["straight", "bulge"]
    assert f'kind = "{OUTSIDE}"' in network.to_toml()


def test_faults_of_a_fitting_from_outside_are_told_at_their_keys():
    """Wrong keys and values of a user's table stand at their dotted paths, with the choices."""
    entry = {"kind": OUTSIDE, "length": -1.0, "deep": 0.1, "leave": "side"}
    with pytest.raises(ot.ScenarioError) as caught:
        validate({"name": "wrong", "pipes": [entry]})
    told = {fault.where: str(fault) for fault in caught.value.faults}
    assert set(told) == {"pipes.0.length", "pipes.0.deep", "pipes.0.leave"}
    assert "depth" in told["pipes.0.deep"]
    assert "end" in told["pipes.0.leave"]


def test_a_bend_of_any_kind_limits_the_speed():
    """The sharpest bend is the bore over the least arc between any two ports."""
    assert example("straight").sharpest_bend(Arcs()) == 0
    assert example("elbow").sharpest_bend(Arcs()) == pytest.approx(0.08 / 0.24)
    assert example("tee").sharpest_bend(Arcs(0.1, 0.05)) == pytest.approx(0.08 / 0.05)
    assert math.isfinite(example(OUTSIDE).sharpest_bend(Arcs()))


@pytest.mark.parametrize("kind", ["mitre", "wye", "tee", "cross"])
def test_the_distance_is_continuous_at_the_plane_of_symmetry(kind):
    """In the plane of the axes itself the distance is that right beside it: there two places of the
    rim are as near, and the one between them is not nearest."""
    fitting = fitting_class(kind)()
    low, high = fitting.bounds
    points = np.random.default_rng(3).uniform(low, high, (4000, 3))
    points = points[fitting.signed_distance(points)[0] > 0]
    within, beside = points * [1, 0, 1], points * [1, 0, 1] + [0, 1e-9, 0]
    here, there = fitting.signed_distance(within)[0], fitting.signed_distance(beside)[0]
    np.testing.assert_allclose(here, there, atol=1e-8)


@pytest.mark.parametrize(
    ("make", "where"),
    [
        (lambda: ot.Straight(1.0, 160.0), "straight.inner_diameter"),
        (lambda: ot.Elbow(240.0, inner_diameter=0.16), "elbow.mean_radius"),
        (lambda: ot.Elbow(240.0, inner_diameter=160.0), "elbow.inner_diameter"),
        (lambda: ot.Tee(inner_diameter=160.0), "tee.inner_diameter"),
        (lambda: ot.Reducer(1.0, 160.0), "reducer.end_diameter"),
        (lambda: ot.Wye(inner_diameter=160.0), "wye.inner_diameter"),
        (lambda: ot.Mitre(inner_diameter=160.0), "mitre.inner_diameter"),
    ],
)
def test_sizes_in_millimetres_are_asked_about(make, where):
    """A bore of 160 m, or a bend of 1,500 bores; tunnels and long bends are made."""
    with pytest.raises(ot.InputError) as told:
        make()
    assert f"{where}: is " in str(told.value)
    assert "is it in millimetres?" in str(told.value)
    assert ot.Straight(100.0, 15.0).inner_diameter == 15.0
    assert ot.Elbow(150.0, inner_diameter=0.16).mean_radius == 150.0


@pytest.mark.parametrize("kind", [ot.Wye, ot.Cross])
@pytest.mark.parametrize("degrees", [29.9, 90.1, 120.0])
def test_branches_lean_by_30_to_90_degrees(kind, degrees):
    """Both ends are possible, and nothing beyond: what leans the other way is entered there."""
    kind(angle=math.radians(30)), kind(angle=math.radians(90))
    with pytest.raises(ot.InputError, match=f"is {degrees:g} degrees; must be between 30 and 90"):
        kind(angle=math.radians(degrees))
