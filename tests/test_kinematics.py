"""Section III of the paper: its equations, laws of rigid bodies, symmetries and limits."""

import numpy as np
import pytest

from omnitrack_sim.base.rotations import rotation_about
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES
from omnitrack_sim.robots.omnitrack import kinematics as kin

RADIUS, LEVER, D = 0.0276, 0.0524, 0.16
ROOT3 = np.sqrt(3)
EXCHANGED = [0, 2, 1]
"""Modules 2 and 3 exchanged: from ours, module 2 at +120 degrees, to Eqs. 11-20 as printed."""


def inverse_jacobian(r, l):
    """Closed form (..., 4, 4) of the inverse of J, as docs/explanation/kinematics.md has it."""
    inverse = np.zeros((*np.shape(r), 4, 4))
    inverse[..., :3, 0] = np.divide(l, r)[..., None] * np.sin(MODULE_ANGLES)
    inverse[..., :3, 1] = -np.divide(l, r)[..., None] * np.cos(MODULE_ANGLES)
    inverse[..., :3, 3] = np.divide(1, r)[..., None]
    inverse[..., 3, 2] = 1.0
    return inverse


def radius_of_curvature(speeds, omega):
    """Eq. 19 as printed, (...,) m: (|V_1| + |V_2| + |V_3|) / (3 |omega|)."""
    return _ratio(np.abs(speeds).mean(axis=-1), np.linalg.norm(omega, axis=-1))


def path_radius(speeds, omega):
    """Radius (...,) m of the centre's path: |V_cz| / sqrt(omega_x^2 + omega_y^2)."""
    omega = np.asarray(omega, float)
    return _ratio(np.abs(kin.forward_speed(speeds)), np.hypot(omega[..., 0], omega[..., 1]))


def _ratio(speed, rate):
    moving = np.where(speed > 0, np.inf, np.nan)
    return np.where(rate > 0, speed / np.where(rate > 0, rate, 1.0), moving)


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_module_velocities_are_equations_5_to_7(rng):
    """Component by component as printed."""
    V, (l1, l2, l3), w = rng.normal(size=3), rng.uniform(0.04, 0.06, 3), 0.7
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    printed = [[0, w * l1, V[0]], [-l2 * c * w, -l2 * s * w, V[1]], [l3 * c * w, -l3 * s * w, V[2]]]
    assert np.allclose(kin.module_velocities(V, w, [l1, l2, l3]), printed, atol=1e-15)


def test_coriolis_term_is_that_of_a_rotating_frame():
    """Eq. 4 against a finite difference of a vector that moves in a rotating frame."""
    spin, step = np.array([0.3, -0.2, 0.9]), 1e-6

    def rotating(t):
        return np.array([0.1 + 0.4 * t, 0.2 * t, -0.3])

    def inertial(t):
        return rotation_about(spin, np.linalg.norm(spin) * t) @ rotating(t)

    difference = (inertial(step) - inertial(-step)) / (2 * step)
    assert np.allclose(kin.inertial_rate([0.4, 0.2, 0], spin, rotating(0)), difference, atol=1e-9)


def test_equal_arms_leave_only_the_forward_speed(rng):
    """Eq. 9: with equal arms the mean velocity is V_cz along z, whatever the spin."""
    V, w = rng.normal(size=(50, 3)), rng.normal(size=50)
    mean = kin.mean_velocity(V, w, np.full(3, LEVER))
    assert np.allclose(mean[:, :2], 0, atol=1e-16)
    assert np.allclose(mean[:, 2], kin.forward_speed(V))


def test_unequal_arms_leave_a_cross_velocity(rng):
    """Eq. 8 = Eq. 9 + cross velocity; one longer arm drifts by theta4_dot (l1 - l) / 3 across
    it."""
    V, w, arms = rng.normal(size=(50, 3)), rng.normal(size=50), rng.uniform(0.03, 0.06, (50, 3))
    mean = kin.mean_velocity(V, w, arms)
    assert np.allclose(mean[:, :2], kin.cross_velocity(w, arms))
    assert np.allclose(kin.cross_velocity(0.6, [0.06, 0.05, 0.05]), [0, 0.6 * 0.01 / 3])


def test_each_module_turns_about_the_line_of_the_other_two(rng):
    """Eqs. 10-12: each rotation leaves the other two modules at rest and gives its own the speed
    V_i."""
    V = rng.normal(size=3)
    points = LEVER * np.stack([np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES), np.zeros(3)], axis=-1)
    for i, omega in enumerate(kin.rotation_by_module(V, LEVER)):
        on_line = points[(i + 1) % 3]
        speeds = np.cross(omega, points - on_line)[:, 2]
        assert np.allclose(speeds, np.where(np.arange(3) == i, V[i], 0))


def test_angular_velocity_is_equations_14_to_16(rng):
    """As printed, with modules 2 and 3 exchanged."""
    V, w = rng.normal(size=3), 0.4
    v1, v2, v3 = V[EXCHANGED]
    printed = [(-v2 + v3) * ROOT3 / (3 * LEVER), (-2 * v1 + v2 + v3) / (3 * LEVER), w]
    assert np.allclose(kin.angular_velocity(V, w, LEVER), printed)


def test_jacobian_is_equation_18():
    """As printed, with the columns of modules 2 and 3 exchanged; Eqs. 1-16 put together give the
    same."""
    r, l = RADIUS, LEVER
    printed = [
        [0, -ROOT3 * r / (3 * l), ROOT3 * r / (3 * l), 0],
        [-2 * r / (3 * l), r / (3 * l), r / (3 * l), 0],
        [0, 0, 0, 1],
        [r / 3, r / 3, r / 3, 0],
    ]
    assert np.allclose(kin.jacobian(r, l)[:, [*EXCHANGED, 3]], printed, rtol=1e-14)
    shafts, spin = np.array([1.0, -2.0, 0.5]), 0.3
    V = shafts * r  # Eqs. 1-3
    together = [*kin.angular_velocity(V, spin, l), kin.forward_speed(V)]
    assert np.allclose(kin.jacobian(r, l) @ [*shafts, spin], together)


def test_jacobian_times_its_inverse_is_the_identity(rng):
    """For arrays of sizes, either way round."""
    r, l = rng.uniform(0.01, 0.05, (4, 5)), rng.uniform(0.03, 0.1, (4, 5))
    J, inverse = kin.jacobian(r, l), inverse_jacobian(r, l)
    assert J.shape == inverse.shape == (4, 5, 4, 4)
    assert np.allclose(J @ inverse, np.eye(4), atol=1e-14)
    assert np.allclose(inverse @ J, np.eye(4), atol=1e-14)


def test_jacobian_agrees_with_finite_differences_of_a_rigid_body(rng):
    """Contact points of a body moved by a small motion advance along z by r theta_dot dt, with the
    motion from J."""
    shafts, step = rng.normal(size=(20, 4)), 1e-5
    motion = np.einsum("ij,nj->ni", kin.jacobian(RADIUS, LEVER), shafts)
    points = LEVER * np.stack([np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES), np.zeros(3)], axis=-1)
    for rates, (wx, wy, wz, v) in zip(shafts, motion, strict=True):
        spin = np.array([wx, wy, wz])

        def moved(t, spin=spin, v=v):
            return points @ rotation_about(spin, np.linalg.norm(spin) * t).T + [0, 0, v * t]

        advance = (moved(step) - moved(-step))[:, 2] / (2 * step)
        assert np.allclose(advance, RADIUS * rates[:3], atol=1e-9)


def test_module_speeds_are_the_inverse_jacobian(rng):
    """Wall speeds over r are its first three rows."""
    v, wx, wy = rng.normal(size=(3, 40))
    motion = np.stack([wx, wy, np.zeros(40), v], axis=1)
    shafts = motion @ inverse_jacobian(RADIUS, LEVER).T
    assert np.allclose(kin.module_speeds(v, wx, wy, LEVER) / RADIUS, shafts[:, :3])


def test_turning_the_wanted_motion_by_120_degrees_permutes_the_modules(rng):
    """What module 1 did, module 2 does, and so on round."""
    v, wx, wy = rng.normal(size=(3, 40))
    c, s = np.cos(2 * np.pi / 3), np.sin(2 * np.pi / 3)
    speeds = kin.module_speeds(v, wx, wy, LEVER)
    turned = kin.module_speeds(v, c * wx - s * wy, s * wx + c * wy, LEVER)
    assert np.allclose(turned, np.roll(speeds, 1, axis=-1))
    radii = kin.elbow_radii(wx, 0.24, 0.08)
    assert np.allclose(kin.elbow_radii(wx - 2 * np.pi / 3, 0.24, 0.08), np.roll(radii, 1, axis=-1))


def test_lever_of_half_the_diameter_gives_the_elbow_ratios(rng):
    """Inverse J with l = D/2, turning at V / 1.5 D towards theta5, gives Eq. 20 to 1e-12; l = D/2 -
    r does not."""
    theta5, omega = rng.uniform(-np.pi, np.pi, 200), 0.1 / (1.5 * D)
    # In the robot frame the turning direction lies at -theta5; turning towards d is a rotation
    # about z x d.
    wx, wy = omega * np.sin(theta5), omega * np.cos(theta5)
    paths = 1.5 * D - 0.5 * D * np.cos(theta5[:, None] + np.array(MODULE_ANGLES))
    ratios = paths / paths.sum(axis=-1, keepdims=True)
    speeds = kin.module_speeds(0.1, wx, wy, D / 2)
    assert np.abs(speeds / speeds.sum(axis=-1, keepdims=True) - ratios).max() < 1e-12
    assert np.allclose(kin.elbow_speeds(0.1, theta5, 1.5 * D, D / 2), speeds, atol=1e-15)
    centre = kin.module_speeds(0.1, wx, wy, D / 2 - RADIUS)
    assert np.abs(centre / 0.3 - ratios).max() > 0.03


def test_elbow_radii_of_the_two_elbows():
    """Preferred orientation, mm: 160:280:280 for 1.5 D and 10:130:130 for 90 mm: no module runs
    backward in either."""
    assert np.allclose(kin.elbow_radii(0.0, 0.24, 0.08) * 1e3, [160, 280, 280])
    assert np.allclose(kin.elbow_radii(0.0, 0.09, 0.08) * 1e3, [10, 130, 130])


def test_mean_of_the_elbow_radii_is_that_of_the_centreline(rng):
    """At any orientation."""
    theta5, mean = rng.uniform(-9, 9, 30), rng.uniform(0.09, 1, 30)
    assert np.allclose(kin.elbow_radii(theta5, mean, 0.08).mean(axis=-1), mean)


def test_radius_of_curvature_is_that_of_the_elbow():
    """Eq. 19 gives back the elbow's mean radius while all modules run forward, and so does the path
    radius."""
    theta5 = np.linspace(-np.pi, np.pi, 25)
    speeds = kin.elbow_speeds(0.1, theta5, 0.24, 0.08)
    omega = kin.angular_velocity(speeds, 0.0, 0.08)
    assert np.allclose(radius_of_curvature(speeds, omega), 0.24)
    assert np.allclose(path_radius(speeds, omega), 0.24)


def test_limits_of_the_radius_of_curvature():
    """Infinite on a line, NaN at rest, and on the spot 0.667 l or 0.577 l by Eq. 19 where the path
    has radius 0."""
    assert (
        radius_of_curvature([0.1, 0.1, 0.1], [0, 0, 0])
        == np.inf
        == path_radius([0.1, 0.1, 0.1], [0, 0, 0])
    )
    assert np.isnan(radius_of_curvature([0, 0, 0], [0, 0, 0]))
    assert np.isnan(path_radius([0, 0, 0], [0, 0, 0]))
    for wx, wy, expected in ((0.0, 1.0, 2 / 3), (1.0, 0.0, 1 / ROOT3)):
        speeds = kin.module_speeds(0.0, wx, wy, LEVER)
        omega = [wx, wy, 0.0]
        assert radius_of_curvature(speeds, omega) == pytest.approx(expected * LEVER)
        assert path_radius(speeds, omega) == pytest.approx(0, abs=1e-17)


def test_belt_sign_follows_the_cosine_of_the_roll():
    """Upper track below 90 degrees, lower one beyond, neither on the no-motion line."""
    assert kin.belt_sign(np.radians([0, 80, 90, 100, 180, -100, 360])).tolist() == [
        1,
        1,
        0,
        -1,
        -1,
        -1,
        1,
    ]


def test_half_a_roll_turns_the_robot_by_62_degrees():
    """-180 r / R = -62.1 degrees for the published sizes."""
    assert np.degrees(kin.turn_from_roll(np.pi, RADIUS, 0.08)) == pytest.approx(-62.1)


def test_arrays_of_any_leading_shape(rng):
    """Shapes broadcast through every function."""
    V, spin, arms = (
        rng.normal(size=(2, 5, 3)),
        rng.normal(size=(2, 5)),
        rng.uniform(0.04, 0.06, (5, 3)),
    )
    assert kin.module_velocities(V, spin, arms).shape == (2, 5, 3, 3)
    assert (
        kin.mean_velocity(V, spin, arms).shape
        == kin.angular_velocity(V, spin, LEVER).shape
        == (2, 5, 3)
    )
    assert kin.cross_velocity(spin, arms).shape == (2, 5, 2)
    assert radius_of_curvature(V, V).shape == path_radius(V, V).shape == (2, 5)
    assert kin.elbow_radii(spin, 0.24, np.full(5, 0.08)).shape == (2, 5, 3)
