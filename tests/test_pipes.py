"""Fittings, networks, routes and the exact inner surface."""

from __future__ import annotations

import numpy as np
import pytest

from omnitrack_sim.errors import GeometryError
from omnitrack_sim.pipes import Elbow, Step, Straight, Tee, route

FITTINGS = {"straight": Straight(0.4), "elbow": Elbow(0.24), "short elbow": Elbow(0.09), "tee": Tee()}


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
            (fitting.signed_distance(points + h * e)[0] - fitting.signed_distance(points - h * e)[0]) / (2 * h)
            for e in np.eye(3)
        ],
        -1,
    )
    off = np.linalg.norm(numeric - gradient, axis=-1)
    assert len(points) > 200
    assert np.allclose(np.linalg.norm(gradient, axis=-1), 1)
    assert np.quantile(off, 0.98) < 1e-4  # the ridges, where two walls are equally near, have no derivative


@pytest.mark.parametrize("name", FITTINGS)
def test_ports_lie_on_the_axis(name):
    """A port's centre is R from the wall, on the port plane, and its z axis points out of the fitting."""
    fitting = FITTINGS[name]
    for port in fitting.ports.values():
        z = port.rotation[:, 2]
        assert np.isclose(fitting.signed_distance(port.position)[0], fitting.radius, atol=1e-9)
        assert np.isclose(fitting.extent(port.position), 0, atol=1e-9)
        assert fitting.extent(port.position - 0.01 * z) > 0 > fitting.extent(port.position + 0.01 * z)
        assert np.isclose(np.linalg.det(port.rotation), 1)


def test_tee_distance_is_that_of_the_opened_wall():
    """A tee's distance in the bore is the one to dense samples of the shrunk wall's faces, less the fillet radius."""
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
    brute = np.array([np.sqrt(((samples - p) ** 2).sum(-1).min()) for p in points]) - tee.fillet_radius
    excess = brute - tee.signed_distance(points)[0]
    assert len(points) > 200
    assert excess.min() > -1e-9
    assert excess.max() < spacing


def test_tee_rim_is_round():
    """Points on the ball that rolls within the wall, on the rim's bore side, are at distance zero."""
    tee = Tee()
    rho, f = tee.radius + tee.fillet_radius, tee.fillet_radius
    edge = rho * np.array([1.0, 0, 1.0])
    point = edge - f * np.array([1.0, 0, 1.0]) / np.sqrt(2)
    assert np.isclose(tee.signed_distance(point)[0], 0, atol=1e-12)


def test_locate_inverts_at():
    """The arc length of a point of the centreline is found again, also off the axis, with and without a hint."""
    line = mixed_route().centreline
    s = np.linspace(-0.1, line.length + 0.1, 300)
    point, _, normal, _ = line.at(s)
    for offset in (0.0, 0.02, -0.02):
        assert np.allclose(line.locate(point + offset * normal, s + 0.02), s, atol=1e-9)
    assert np.allclose(line.locate(point), s, atol=1e-9)


def test_frames_follow_the_centreline():
    """Frames are rotations with z along the tangent, the tangent is the curve's derivative, and frames never jump."""
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
    for passage in way.fittings:
        s = np.linspace(passage.s_enter, passage.s_leave, 50)
        distance, _ = way.network.signed_distance(way.centreline.at(s)[0])
        assert distance.min() > 0.04
        if passage.kind != "tee":
            assert np.allclose(distance, passage.radius)


def test_elbows_without_turns_stay_in_one_plane():
    """A chain of elbows without turns keeps to the plane of its first bend and keeps bending the same way."""
    way = route([Step(str(i), Elbow(0.24), "start", "end") for i in range(3)])
    assert np.allclose(way.centreline.at(np.linspace(0, way.centreline.length, 50))[0][:, 1], 0)
    assert np.allclose(way.centreline.at(np.array([way.centreline.length]))[1], [[-1, 0, 0]])


def test_overlap_names_both_parts():
    """Four elbows that close on themselves are refused, and the message names both parts."""
    steps = [Step(f"bend{i}", Elbow(0.09), "start", "end") for i in range(4)]
    with pytest.raises(GeometryError, match=r"bend3.*bend0"):
        route(steps)
    with pytest.raises(GeometryError, match=r"tail.*bend0"):
        route([*steps, Step("tail", Straight(0.1), "start", "end")])


def test_bores_must_match():
    """Pipes of different bores are not joined."""
    with pytest.raises(GeometryError, match="inner_diameter"):
        route([Step("a", Straight(0.3), "start", "end"), Step("b", Straight(0.3, 0.12), "start", "end")])


@pytest.mark.parametrize(
    ("make", "faults"),
    [
        (lambda: Straight(-1.0, 0.0), 2),
        (lambda: Elbow(0.01, 4.0), 2),
        (lambda: Elbow(0.079), 1),
        (lambda: Tee(0.1, 0.01, -1.0), 3),
    ],
)
def test_every_fault_is_named(make, faults):
    """A fitting with several impossible sizes names each of them."""
    with pytest.raises(GeometryError) as caught:
        make()
    assert len(caught.value.faults) == faults


def test_unknown_ports_list_the_choices():
    """A port that the fitting lacks is refused with the names of those it has."""
    with pytest.raises(GeometryError, match="run_start, run_end, branch"):
        route([Step("a", Tee(), "start", "branch")])
