"""Laws of rotations and poses."""

import numpy as np
import pytest

from omnitrack_sim.base import rotations
from omnitrack_sim.base.rotations import (
    Pose,
    direction_of,
    frame_along,
    heading,
    matrix_from_quaternion,
    orthonormal,
    quaternion_from_matrix,
    rotation_about,
    rotation_vector,
    turned_by,
    unit,
    wrap_angle,
)
from omnitrack_sim.pipes import vectors

RNG = np.random.default_rng(0)


def test_quaternion_and_matrix_are_inverse_near_every_half_turn():
    """Quaternion -> matrix -> quaternion is the identity up to sign, also where w is zero."""
    axes = unit(RNG.normal(size=(200, 3)))
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 150), np.full(50, np.pi)])
    q = np.concatenate([np.cos(angles / 2)[:, None], axes * np.sin(angles / 2)[:, None]], axis=1)
    back = quaternion_from_matrix(matrix_from_quaternion(q))
    assert np.allclose(np.abs((q * back).sum(-1)), 1.0, atol=1e-12)


def test_rotation_about_is_right_handed_and_proper():
    """A quarter turn about z takes x to y, and every rotation has determinant 1."""
    assert np.allclose(rotation_about([0, 0, 1], np.pi / 2) @ [1, 0, 0], [0, 1, 0])
    turns = rotation_about(RNG.normal(size=(50, 3)), RNG.uniform(-7, 7, 50))
    assert np.allclose(np.linalg.det(turns), 1.0)


def test_rotation_about_repeats_for_one_axis_and_many_angles():
    """One axis with an array of angles gives one matrix an angle."""
    assert rotation_about([0, 0, 1], np.zeros(4)).shape == (4, 3, 3)


def test_pose_inverse_undoes_the_pose():
    """A pose composed with its inverse is the identity, on points as well."""
    pose = Pose(rotation_about([1, 2, 3], 0.7), np.array([0.1, -0.2, 0.3]))
    points = RNG.normal(size=(5, 3))
    assert np.allclose(pose.inverse().apply(pose.apply(points)), points)
    assert np.allclose((pose @ pose.inverse()).rotation, np.eye(3))


@pytest.mark.parametrize("period", [2 * np.pi, 2 * np.pi / 3])
def test_wrapped_angles_stay_in_half_a_period(period):
    """Wrapping changes an angle by whole periods and leaves it in [-period/2, period/2)."""
    angles = np.linspace(-20, 20, 401)
    wrapped = wrap_angle(angles, period)
    assert ((wrapped >= -period / 2) & (wrapped < period / 2)).all()
    turns = (angles - wrapped) / period
    assert np.allclose(turns, np.round(turns))


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e-160, 1e160, 1e300])
def test_a_direction_of_any_size_has_length_one(size):
    """Squares of its components overflow or vanish; frame and direction are those of the same
    vector at a usual size."""
    assert np.allclose(direction_of([0.0, -size, 0.0]), [0, -1, 0], atol=1e-12)
    assert np.allclose(frame_along([size, 0.0, size], 0.3), frame_along([1.0, 0.0, 1.0], 0.3))


def test_a_direction_of_a_usual_size_is_the_unit_vector_bit_for_bit():
    """Dividing by a power of two first changes no bit; zero stays zero."""
    vectors = RNG.normal(size=(500, 3)) * 10.0 ** RNG.integers(-9, 9, (500, 1))
    assert np.array_equal(direction_of(vectors), unit(vectors))
    assert not direction_of(np.zeros(3)).any()


def test_rotation_vectors_and_matrices_are_inverse():
    """From no rotation at all to nearly half a turn; the matrix is that of axis and angle."""
    axes = unit(RNG.normal(size=(60, 3)))
    angles = np.concatenate([[0.0, 1e-12, 1e-7], np.linspace(1e-3, 3.1, 57)])
    vectors = axes * angles[:, None]
    assert np.allclose(turned_by(vectors), rotation_about(axes, angles), atol=1e-12)
    assert np.allclose(rotation_vector(turned_by(vectors)), vectors, atol=1e-9)


def test_orthonormal_keeps_the_axis_and_mends_the_rest():
    """A rotation with rounding becomes one without, about the same axis."""
    sound = turned_by(RNG.normal(size=(20, 3)))
    mended = orthonormal(sound + RNG.normal(size=sound.shape) * 1e-4)
    assert np.allclose(np.swapaxes(mended, 1, 2) @ mended, np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(mended), 1.0)
    assert np.abs(mended - sound).max() < 1e-3


def test_a_heading_looks_out_of_the_tail_of_a_robot_that_drives_backward():
    """Its z is turned round and its x stays; of many candidates of one robot, too."""
    frames = turned_by(RNG.normal(size=(3, 3)))
    ahead = heading(frames, np.array([1, -1, 1]))
    assert np.array_equal(ahead[[0, 2]], frames[[0, 2]])
    assert np.array_equal(ahead[1, :, 2], -frames[1, :, 2])
    assert np.array_equal(ahead[1, :, 0], frames[1, :, 0])
    several = np.repeat(frames[:, None], 4, axis=1)
    assert np.array_equal(heading(several, np.array([[1], [-1], [1]]))[:, 2], ahead)


def test_compiled_vectors_are_those_of_arrays():
    """Sums, products, lengths and angles of compiled functions are those of arrays, to the bit."""
    rng = np.random.default_rng(3)
    for a, b in rng.normal(size=(20, 2, 3)):
        pairs = (
            (vectors.cross(a, b), rotations.cross(a, b)),
            (vectors.dot(a, b), rotations.dot(a, b)),
            (vectors.length(a), rotations.length(a)),
            (vectors.unit(a), rotations.unit(a)),
            (vectors.plus(a, vectors.scaled(b, 2.0)), a + 2.0 * b),
            (vectors.over(vectors.minus(a, b), 3.0), (a - b) / 3.0),
        )
        for mine, array in pairs:
            assert np.array_equal(mine, array)
        a, b = rotations.unit(a), rotations.unit(b)
        assert vectors.angle_between(a, b) == pytest.approx(np.arccos(a @ b))
    assert vectors.unit((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
