"""Laws of the shapes of fittings: where they begin and end, and the box around them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omnitrack_sim.pipes import Cross, Elbow, Mitre, Reducer, Straight, Tee, Wye

ELBOWS = [Elbow(0.24), Elbow(0.09), Elbow(0.3, math.radians(20)), Elbow(0.2, math.radians(170))]
FITTINGS = {
    "straight": Straight(0.4),
    "elbow": Elbow(0.24),
    "slight elbow": Elbow(0.3, math.radians(20)),
    "bend back": Elbow(0.2, math.radians(170)),
    "reducer": Reducer(0.15, 0.12),
    "tee": Tee(),
    "wye": Wye(angle=math.radians(50)),
    "cross": Cross(),
    "mitre": Mitre(),
}


@pytest.mark.parametrize("elbow", ELBOWS, ids=lambda elbow: f"{math.degrees(elbow.angle):.0f}")
def test_the_extent_of_an_elbow_is_along_its_arc(elbow: Elbow) -> None:
    """A point's extent is the arc to the nearer port, negative behind it, all around the bend: half
    the bend's angle less the angle from its middle."""
    rng = np.random.default_rng(1)
    angle = elbow.angle / 2 + rng.uniform(-math.pi, math.pi, 2000)
    rho = rng.uniform(0.01, 0.4, 2000)
    x, z = elbow.mean_radius - rho * np.cos(angle), rho * np.sin(angle)
    points = np.stack([x, rng.uniform(-0.1, 0.1, 2000), z], axis=-1)
    arc = elbow.mean_radius * (elbow.angle / 2 - abs(angle - elbow.angle / 2))
    np.testing.assert_allclose(elbow.extent(points), arc, atol=1e-12)


@pytest.mark.parametrize("name", FITTINGS)
def test_the_extent_vanishes_on_the_planes_of_the_ports(name: str) -> None:
    """It changes its sign where a bore is entered, from outside to inside by a metre a metre."""
    fitting, rng = FITTINGS[name], np.random.default_rng(2)
    for port in fitting.ports.values():
        across = rng.uniform(-0.5, 0.5, (50, 2)) * fitting.radius
        for step in (-1e-4, 0.0, 1e-4):
            # A port's z axis looks out of the fitting.
            disc = np.column_stack([across, np.full(50, step)])
            extent = fitting.extent(port.apply(disc))
            assert (np.sign(np.round(extent, 12)) == -np.sign(step)).all()


@pytest.mark.parametrize("name", FITTINGS)
def test_bounds_hold_the_bore_and_no_more(name: str) -> None:
    """All of the bore between the ports lies within the bounds, and comes within 4 mm of each of
    their sides."""
    fitting, rng = FITTINGS[name], np.random.default_rng(3)
    low, high = fitting.bounds
    size = high - low
    points = rng.uniform(low - 0.2 * size, high + 0.2 * size, (300_000, 3))
    # Many near each side: the bore touches it in a line or a point.
    for axis in range(3):
        for side in (low, high):
            near = rng.uniform(low, high, (60_000, 3))
            near[:, axis] = side[axis] + rng.uniform(-0.004, 0.004, len(near))
            points = np.concatenate([points, near])
    bore = points[(fitting.signed_distance(points)[0] > 0) & (fitting.extent(points) > 0)]
    assert (bore >= low - 1e-9).all()
    assert (bore <= high + 1e-9).all()
    np.testing.assert_allclose(bore.min(axis=0), low, atol=0.004)
    np.testing.assert_allclose(bore.max(axis=0), high, atol=0.004)
