"""Fittings, networks, routes and the exact inner surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.pipes import BORE_TOLERANCE, Elbow, Reducer, Step, Straight, Tee, route

REDUCERS = {
    "reducer": Reducer(0.1, 0.15),
    "widening reducer": Reducer(0.15, 0.18, 0.1),
    "steep reducer": Reducer(0.07, 0.11),
}
FITTINGS = {
    "straight": Straight(0.4),
    "elbow": Elbow(0.24),
    "short elbow": Elbow(0.09),
    "tee": Tee(),
} | REDUCERS


def mixed_route():
    """A straight, an elbow turned out of plane, a tee left by its branch, a straight."""
    return route(
        [
            Step("a", Straight(0.3), "start", "end"),
            Step("b", Elbow(0.24), "start", "end", 0.7),
            Step("c", Tee(), "run_start", "branch", -0.4),
            Step("d", Straight(0.3), "start", "end"),
        ]
    )


def inside(fitting, n: int, rng) -> np.ndarray:
    """Points (n, 3) in the bore or up to 3 mm in the wall, between the ports."""
    points = rng.uniform([-0.1, -0.1, -0.15], [0.25, 0.1, 0.4], (200 * n, 3))
    return points[(fitting.signed_distance(points)[0] > -0.003) & (fitting.extent(points) > 0)][:n]


@pytest.mark.parametrize("name", FITTINGS)
def test_gradient_is_the_derivative(name):
    """The gradient of the distance has length 1 and equals central differences."""
    fitting, h = FITTINGS[name], 1e-6
    points = inside(fitting, 500, np.random.default_rng(1))
    _, gradient = fitting.signed_distance(points)
    numeric = np.stack(
        [
            (
                fitting.signed_distance(points + h * e)[0]
                - fitting.signed_distance(points - h * e)[0]
            )
            / (2 * h)
            for e in np.eye(3)
        ],
        -1,
    )
    off = np.linalg.norm(numeric - gradient, axis=-1)
    assert len(points) > 200
    assert np.allclose(np.linalg.norm(gradient, axis=-1), 1)
    assert (
        np.quantile(off, 0.98) < 1e-4
    )  # the ridges, where two walls are equally near, have no derivative


@pytest.mark.parametrize("name", FITTINGS)
def test_ports_lie_on_the_axis(name):
    """A port's rim is on the wall, its centre on the port plane, and its z axis points out of the
    fitting."""
    fitting = FITTINGS[name]
    for end, port in fitting.ports.items():
        z = port.rotation[:, 2]
        rim = port.position + fitting.port_radius(end) * port.rotation[:, :2].T
        assert np.allclose(fitting.signed_distance(rim)[0], 0, atol=1e-9)
        assert fitting.port_radius(end) <= fitting.max_radius
        assert np.isclose(fitting.extent(port.position), 0, atol=1e-9)
        assert (
            fitting.extent(port.position - 0.01 * z) > 0 > fitting.extent(port.position + 0.01 * z)
        )
        assert np.isclose(np.linalg.det(port.rotation), 1)


@pytest.mark.parametrize("name", REDUCERS)
def test_reducer_distance_is_that_of_the_cone(name):
    """A reducer's distance is that to dense samples of the cone between its ports, positive in the
    bore."""
    reducer, spacing = REDUCERS[name], 5e-4
    z = np.linspace(0, reducer.length, round(reducer.length / spacing) + 1)
    radius = np.interp(
        z, [0, reducer.length], [reducer.port_radius("start"), reducer.port_radius("end")]
    )
    u = np.arange(0, 2 * np.pi, spacing / reducer.max_radius)
    cone = np.stack(
        [radius[:, None] * np.cos(u), radius[:, None] * np.sin(u), z[:, None] + 0 * u], -1
    ).reshape(-1, 3)
    points = inside(reducer, 200, np.random.default_rng(2))
    brute, _ = KDTree(cone).query(points)
    distance = reducer.signed_distance(points)[0]
    excess = brute - np.abs(distance)
    assert excess.min() > -1e-9
    assert excess[np.abs(distance) > 0.01].max() < 1e-5
    assert excess.max() < spacing
    narrower = np.hypot(points[:, 0], points[:, 1]) < np.interp(points[:, 2], z, radius)
    assert ((distance > 0) == narrower).all()


def test_reducer_distance_at_its_ends():
    """On the axis: the slant distance at the wide port, the radius itself at the narrow one, from
    either side."""
    for reducer in (Reducer(0.1, 0.15), Reducer(0.1, 0.16, 0.15)):
        wide, narrow = sorted(reducer.ports, key=reducer.port_radius, reverse=True)
        cosine = np.cos(np.arctan(0.05))
        assert np.isclose(
            reducer.signed_distance(reducer.ports[wide].position)[0], 0.08 * cosine, atol=1e-12
        )
        distance, gradient = reducer.signed_distance(reducer.ports[narrow].position)
        assert np.isclose(distance, 0.075, atol=1e-12)
        assert np.isclose(np.linalg.norm(gradient), 1)


def test_tee_distance_is_that_of_the_opened_wall():
    """A tee's distance in the bore is the one to dense samples of the shrunk wall's faces, less the
    fillet radius."""
    tee, spacing = Tee(), 1e-3
    rho = tee.radius + tee.fillet_radius
    u, w = np.meshgrid(np.arange(0, 2 * np.pi, spacing / rho), np.arange(-0.25, 0.25, spacing))
    u, w = u.ravel(), w.ravel()
    run = np.stack([rho * np.cos(u), rho * np.sin(u), w], -1)
    branch = np.stack([w, rho * np.sin(u), rho * np.cos(u)], -1)
    run = run[(run[:, 0] < 0) | (np.hypot(run[:, 1], run[:, 2]) >= rho)]
    branch = branch[(branch[:, 0] >= 0) & (np.hypot(branch[:, 0], branch[:, 1]) >= rho)]
    samples = np.concatenate([run, branch])
    points = inside(tee, 300, np.random.default_rng(2))
    points = points[tee.signed_distance(points)[0] > 0]
    excess = KDTree(samples).query(points)[0] - tee.fillet_radius - tee.signed_distance(points)[0]
    assert len(points) > 200
    assert excess.min() > -1e-9
    assert excess.max() < spacing


def test_tee_rim_is_round():
    """Points on the ball that rolls within the wall, on the rim's bore side, are at distance
    zero."""
    tee = Tee()
    rho, f = tee.radius + tee.fillet_radius, tee.fillet_radius
    edge = rho * np.array([1.0, 0, 1.0])
    point = edge - f * np.array([1.0, 0, 1.0]) / np.sqrt(2)
    assert np.isclose(tee.signed_distance(point)[0], 0, atol=1e-12)


def test_locate_inverts_at():
    """The arc length of a point of the centreline is found again, also off the axis, with and
    without a hint."""
    line = mixed_route().centreline
    s = np.linspace(-0.1, line.length + 0.1, 300)
    point, _, normal, _ = line.at(s)
    for offset in (0.0, 0.02, -0.02):
        assert np.allclose(line.locate(point + offset * normal, s + 0.02), s, atol=1e-9)
    assert np.allclose(line.locate(point), s, atol=1e-9)


def test_frames_follow_the_centreline():
    """Frames are rotations with z along the tangent, the tangent is the curve's derivative, and
    frames never jump."""
    line = mixed_route().centreline
    s, h = np.linspace(0.001, line.length - 0.001, 2000), 1e-6
    frame, (_, tangent, _, _) = line.frame(s), line.at(s)
    assert np.allclose(np.swapaxes(frame, 1, 2) @ frame, np.eye(3))
    assert np.allclose(frame[:, :, 2], tangent)
    assert np.allclose((line.at(s + h)[0] - line.at(s - h)[0]) / (2 * h), tangent, atol=1e-4)
    assert np.abs(np.diff(frame, axis=0)).max() < 0.02


def test_centreline_stays_in_the_bore():
    """Along straights and elbows the centreline is R from the wall; in the tee it is inside."""
    way = mixed_route()
    for passage in way.passages:
        s = np.linspace(passage.s_enter, passage.s_leave, 50)
        distance, _ = way.network.signed_distance(way.centreline.at(s)[0])
        assert distance.min() > 0.04
        if passage.kind != "tee":
            assert np.allclose(distance, passage.radius)


def test_elbows_without_turns_stay_in_one_plane():
    """A chain of elbows without turns keeps to the plane of its first bend and keeps bending the
    same way."""
    way = route([Step(str(i), Elbow(0.24), "start", "end") for i in range(3)])
    assert np.allclose(way.centreline.at(np.linspace(0, way.centreline.length, 50))[0][:, 1], 0)
    assert np.allclose(way.centreline.at(np.array([way.centreline.length]))[1], [[-1, 0, 0]])


def test_overlap_names_both_parts():
    """Four elbows that close on themselves are refused, and the message names both parts."""
    steps = [Step(f"bend{i}", Elbow(0.09), "start", "end") for i in range(4)]
    with pytest.raises(GeometryError, match=r"bend3.*bend0") as caught:
        route(steps)
    assert [fault.where for fault in caught.value.faults] == ["pipes.3"]
    with pytest.raises(GeometryError, match=r"tail.*bend0"):
        route([*steps, Step("tail", Straight(0.1), "start", "end")])


def test_bores_must_match():
    """Pipes of different bores are not joined; the fault names ports and diameters. One millimetre
    passes."""
    told = (
        r"inner_diameter: joins 'a' \(end\) of 0.16 m to 'b' \(start\) of 0.12 m; a reducer joins"
    )
    with pytest.raises(GeometryError, match=told):
        route(
            [
                Step("a", Straight(0.3), "start", "end"),
                Step("b", Straight(0.3, 0.12), "start", "end"),
            ]
        )
    for sign in (1, -1):
        bore = 0.16 + sign * BORE_TOLERANCE
        route(
            [
                Step("a", Straight(0.3), "start", "end"),
                Step("b", Straight(0.3, bore), "start", "end"),
            ]
        )
        with pytest.raises(GeometryError, match="a reducer joins bores"):
            route(
                [
                    Step("a", Straight(0.3, bore + sign * 1e-4), "start", "end"),
                    Step("b", Tee(), "branch", "run_end"),
                ]
            )


def test_a_reducer_counts_by_the_port_that_is_joined():
    """Each end takes its own bore; the fault of the far one stands at its own key."""
    first, last = (
        Step("a", Straight(0.3), "start", "end"),
        Step("c", Straight(0.3, 0.12), "start", "end"),
    )
    assert (
        route([first, Step("b", Reducer(0.1, 0.12), "start", "end"), last]).passages[2].radius
        == 0.06
    )
    assert (
        route([first, Step("b", Reducer(0.1, 0.16, 0.12), "end", "start"), last]).passages[1].radius
        == 0.08
    )
    with pytest.raises(GeometryError) as caught:
        route([first, Step("b", Reducer(0.1, 0.12), "end", "start"), last])
    assert [fault.where for fault in caught.value.faults] == [
        "pipes.1.end_diameter",
        "pipes.2.inner_diameter",
    ]


def test_bores_along_a_route():
    """Each passage has the bore of the port that it is entered by, and the centreline is clear."""
    way = route(
        [
            Step("a", Straight(0.3), "start", "end"),
            Step("b", Reducer(0.1, 0.15), "start", "end"),
            Step("c", Elbow(0.09, inner_diameter=0.15), "start", "end"),
            Step("d", Reducer(0.2, 0.15, 0.17), "end", "start", 0.4),
            Step("e", Tee(inner_diameter=0.17), "run_start", "branch"),
        ]
    )
    bend = 0.09 * np.pi / 2
    s = np.array([0.3, 0.35, 0.4, 0.45, 0.4 + bend + 0.1])
    assert [p.radius for p in way.passages] == pytest.approx([0.08, 0.08, 0.075, 0.075, 0.085])
    assert [passage.is_turn for passage in way.passages] == [False, False, True, False, True]
    assert np.isnan(way.passages[1].opening).all()
    ring = np.stack([way.centreline.at(s)[0] + r for r in 0.05 * np.eye(3)])
    assert (way.network.signed_distance(ring)[0] > 0).all()


@pytest.mark.parametrize(
    ("make", "faults"),
    [
        (lambda: Straight(-1.0, 0.0), 2),
        (lambda: Elbow(0.01, 4.0), 2),
        (lambda: Elbow(0.079), 1),
        (lambda: Tee(0.1, 0.01, -1.0), 3),
        (lambda: Reducer(-0.1, 0.0, -1.0), 3),
        (lambda: Reducer(0.1, 0.16), 1),
        (lambda: Reducer(0.05, 0.12), 1),
    ],
)
def test_every_fault_is_named(make, faults):
    """A fitting with several impossible sizes names each of them."""
    with pytest.raises(GeometryError) as caught:
        make()
    assert len(caught.value.faults) == faults


def test_a_reducer_says_how_long_it_has_to_be():
    """Over 20 degrees the fault names the least length, which then is accepted; equal bores: a
    straight."""
    with pytest.raises(
        GeometryError,
        match=r"reducer.length: is 0.01 m, a half cone angle of 26.6 .* 20 .* 0.01374 m",
    ):
        Reducer(0.01, 0.15)
    Reducer(0.01374, 0.15)
    with pytest.raises(GeometryError, match="use a straight"):
        Reducer(0.1, 0.16)


def test_unknown_ports_list_the_choices():
    """A port that the fitting lacks is refused with the names of those it has."""
    with pytest.raises(GeometryError, match="run_start, run_end, branch"):
        route([Step("a", Tee(), "start", "branch")])
