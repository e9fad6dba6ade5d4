"""Contact of modules of finite length in the exact two-cylinder geometry."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.singularity import TurnCase, safe_margin, sector_angle
from omnitrack_sim.robots.omnitrack.tee_contact import (
    TeePath,
    outer_sector,
    turn_path,
    wall_distance,
)

R = 0.080
PIVOT = turn_path(R)  # about the crotch at the distance R
ALONG_RUN = np.array([0.0, 0.0, 1.0])
STRAIGHT = TeePath(
    np.linspace(-2 * R, 2 * R, 721)[:, None] * ALONG_RUN, np.tile(ALONG_RUN, (721, 1))
)


def touching(path: TeePath, theta5: Array, reach: float, length: float) -> NDArray[np.bool_]:
    """Modules of a robot that have a wall within reach, (T, M, 3)."""
    case = TurnCase(reach=reach, contact_length=length)
    return case.wall_distance(path, theta5) <= reach


@pytest.mark.parametrize(
    ("length", "reach", "sector"),
    [(1.0, 1.10, 113.4), (1.0, 1.20, 98.5), (1.0, np.sqrt(2), 78.8), (0.5, 1.20, 109.4)],
)
def test_outer_sector_of_lines(length, reach, sector):
    """Pivot about the crotch: sector in degrees for L / R and rho / R, from an independent
    calculation."""
    assert np.degrees(outer_sector(PIVOT, reach * R, R, length * R)) == pytest.approx(
        sector, abs=0.3
    )


def test_outer_sector_of_points_is_the_strip_bound():
    """Without length a module needs |y| = R within reach: 2 asin(R / rho)."""
    rho = R * np.linspace(1.02, 1.4, 20)
    strip = sector_angle(R, rho, definition="strip")
    assert np.allclose(np.degrees(outer_sector(PIVOT, rho, R, 0.0)), np.degrees(strip), atol=0.1)


def test_the_papers_sector_at_the_calibrated_reach():
    """At rho = 96.10 mm 96.54 degrees belong to a contact line of 85 mm, within 2 mm."""
    lengths = np.array([0.083, 0.085, 0.087])
    sectors = np.degrees([outer_sector(PIVOT, 0.0961016, R, length) for length in lengths])
    assert sectors[0] > 96.54 > sectors[2]
    assert sectors[1] == pytest.approx(96.54, abs=0.3)


@pytest.mark.parametrize(
    ("turn_angle", "length"),
    [(np.pi / 2, length) for length in (0.0, 0.04, 0.085, 0.15)]
    + [(np.radians(60), 0.085), (np.radians(120), 0.04)],
)
def test_wall_distance_is_that_of_marching_outward(turn_angle, length):
    """Against the first sample outside the union of the two bores, along 101 places of the
    module."""
    rng = np.random.default_rng(4)
    path, angles = turn_path(R, turn_angle, poses=5), rng.uniform(-np.pi, np.pi, 4)
    exact = wall_distance(path, angles, R, length)  # (T, A)
    outward = np.cos(angles)[:, None] * path.turning_direction[:, None] + np.sin(angles)[
        :, None
    ] * np.array([0, 1, 0])
    along = np.linspace(-length / 2, length / 2, 101)
    out = np.linspace(0, 0.3, 1001)
    line = path.centre[:, None] + along[:, None] * path.axis[:, None]  # (T, S, 3)
    points = line[:, None, :, None] + out[:, None] * outward[:, :, None, None]  # (T, A, S, Q, 3)
    branch = np.array([np.sin(turn_angle), 0, np.cos(turn_angle)])
    from_branch = np.linalg.norm(np.cross(points, branch), axis=-1)
    inside = (np.hypot(points[..., 0], points[..., 1]) < R) | (
        (points @ branch > 0) & (from_branch < R)
    )
    marched = np.where(inside.all(axis=-1), np.inf, out[np.argmin(inside, axis=-1)]).min(axis=-1)
    far = marched > 0.299
    late = np.where(far, 0.0, marched - np.where(far, 0.0, exact))
    assert late.min() > -1e-9  # a sample can only find the wall late
    assert late.max() < 1e-3
    assert (exact[far] > 0.299).all()


def test_all_touch_at_the_radius_in_a_straight_pipe():
    """Far from the branch the wall is at R for every direction and length."""
    path = TeePath(np.array([[0.0, 0.0, -0.4]]), np.array([[0.0, 0.0, 1.0]]))
    assert np.allclose(wall_distance(path, np.linspace(-3, 3, 30), R, 0.09), R)


def test_longer_modules_and_longer_reach_have_smaller_sectors():
    """More line, less to lose; more reach likewise."""
    by_length = [outer_sector(PIVOT, 0.0961, R, length) for length in (0.0, 0.06, 0.12)]
    assert (np.diff(by_length) < 0).all()
    assert (np.diff(outer_sector(PIVOT, R * np.linspace(1.01, 1.5, 30), R, 0.09)) < 0).all()


def test_reach_below_the_pipe_touches_nowhere():
    """The whole circle."""
    assert outer_sector(PIVOT, 0.079, R, 0.09) == pytest.approx(2 * np.pi)


def test_lengths_scale():
    """Only the ratios to R matter."""
    small, large = turn_path(1.1, poses=91), turn_path(11.0, poses=91)
    angles = np.linspace(0, np.pi, 40)
    assert np.allclose(
        10 * wall_distance(small, angles, 1.0, 0.9), wall_distance(large, angles, 10.0, 9.0)
    )


def test_map_mirrors_with_the_orientation():
    """theta5 and -theta5 exchange modules 2 and 3."""
    theta5 = np.radians(np.linspace(-60, 60, 25))
    distance = TurnCase().wall_distance(turn_path(0.09, poses=31), theta5)
    assert np.allclose(distance[:, ::-1, [0, 2, 1]], distance)
    assert distance.shape == (31, 25, 3)


def test_orientations_that_keep_contact_are_those_of_the_sector():
    """On the pivot path with L = 85 mm they are the safe margin of the outer sector: no other
    direction is lost."""
    theta5 = np.radians(np.arange(-60, 60, 0.5))
    keeps_contact = touching(PIVOT, theta5, 0.0961, 0.085).all(axis=(0, 2))
    margin = safe_margin(outer_sector(PIVOT, 0.0961, R, 0.085))
    clear = np.abs(np.abs(theta5) - margin) > np.radians(0.5)
    assert (keeps_contact == (np.abs(theta5) < margin))[clear].all()
    assert keeps_contact.mean() == pytest.approx(0.1955, abs=0.01)


def test_straight_over_a_tee_modules_beside_the_opening_hold():
    """At theta5 = 60 all modules touch throughout; a module that faces the opening loses the
    wall."""
    touch = touching(STRAIGHT, np.radians([60.0, 0.0]), 0.0961, 0.09)
    assert touch.all(axis=(0, 2)).tolist() == [True, False]
    assert not touch[:, 1, 0].all()
    assert touch[:, 1, 1:].all()


def test_module_facing_the_opening_bridges_it_when_long_enough():
    """Straight over, at theta from the opening the gap is 2 R cos(theta): a line that long never
    leaves the wall."""
    angle = np.radians(50)
    gap = 2 * R * np.cos(angle)
    longest = [
        wall_distance(STRAIGHT, angle, R, length).max() for length in (gap - 0.002, gap + 0.002)
    ]
    assert longest[0] > R + 1e-4
    assert longest[1] == pytest.approx(R)


def test_turned_angle_of_a_path():
    """From 0 to the turn angle; nothing straight over."""
    assert np.allclose(turn_path(0.09, 1.0, poses=5).turned, np.linspace(0, 1, 5))
    assert np.allclose(STRAIGHT.turned, 0)


def test_case_puts_the_figures_together():
    """One period of theta5, best in the middle; summary and properties agree; bad values are
    refused at once."""
    case = TurnCase(reach=0.0961016, contact_length=0.085)
    told = case.summary()
    assert (
        told["sector_deg"]
        == pytest.approx(96.54, abs=0.01)
        == told["definitions"]["ellipse"]["sector_deg"]
    )
    assert told["real_geometry"]["sector_deg"] == pytest.approx(np.degrees(case.real_sector))
    nominal, real = case.singular_range
    assert nominal == pytest.approx(np.degrees(case.sector))
    assert real == pytest.approx((120.0 - np.degrees(case.real_sector)) / 2)
    assert told["real_geometry"]["keeps_contact_rate"] == pytest.approx(0.1955, abs=0.01)
    assert np.degrees(TurnCase(modules=4).orientations(5)) == pytest.approx([0, 22.5, 45, 67.5, 90])
    with pytest.raises(InputError, match="modules"):
        TurnCase(modules=0)
    with pytest.raises(InputError, match="contact_length"):
        TurnCase(contact_length=-0.1)
