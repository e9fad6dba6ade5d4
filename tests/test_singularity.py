"""The motion singularity region in closed form: the paper's numbers, laws, limits."""

import time

import numpy as np
import pytest

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.robots.omnitrack.singularity import (
    DEFINITIONS,
    TurnCase,
    best_theta5,
    failure_rate,
    is_singular,
    reach_from_sector,
    safe_margin,
    section_ellipse,
    sector_angle,
    success_rate,
    worst_theta5,
)

R, RHO = 0.080, 0.0961016
PAPER_SECTOR = np.radians(96.54)
"""Of the paper's robot (Section IV)."""


def test_the_papers_numbers():
    """Sector 96.54, margin 11.73 (the paper prints 11.78), failure 80.45 %, success 19.55 %."""
    sector = sector_angle(R, RHO)
    assert np.degrees(sector) == pytest.approx(96.54, abs=0.01)
    assert np.degrees(safe_margin(sector)) == pytest.approx(11.73, abs=0.01)
    assert failure_rate(sector) == pytest.approx(0.8045, abs=2e-4)
    assert success_rate(sector) == pytest.approx(0.1955, abs=2e-4)


@pytest.mark.parametrize(
    ("definition", "reach"), [("ellipse", 96.102), ("crotch", 103.68), ("strip", 107.20)]
)
def test_reach_that_each_definition_needs(definition, reach):
    """Reach, mm, for a sector of 96.54 degrees in a pipe of R = 80 mm."""
    tolerance = 0.001 if definition == "ellipse" else 0.005
    assert reach_from_sector(PAPER_SECTOR, 80.0, definition=definition) == pytest.approx(
        reach, abs=tolerance
    )


def test_rivals_by_their_formulas_for_a_right_angle():
    """crotch: cos = 2 sqrt(2) rho/R - 3; strip: sector = 2 asin(R/rho)."""
    rho = np.linspace(1.0, 1.4, 30)
    crotch = sector_angle(1.0, rho, definition="crotch")
    assert np.allclose(np.cos(crotch / 2), 2 * np.sqrt(2) * rho - 3)
    assert np.allclose(sector_angle(1.0, rho, definition="strip"), 2 * np.arcsin(1 / rho))


@pytest.mark.parametrize("definition", DEFINITIONS)
def test_inverse_gives_back_the_reach(definition):
    """For any pipe and turn angle, wherever there is a sector."""
    rng = np.random.default_rng(2)
    radius, turn = rng.uniform(0.03, 0.5, (2, 3, 200))[0], rng.uniform(0.3, 2.8, (3, 200))
    reach = radius * (1 + rng.uniform(0, 1, (3, 200)) * (1 / np.cos(turn / 2) - 1))
    sector = sector_angle(radius, reach, turn, definition)
    assert np.allclose(reach_from_sector(sector, radius, turn, definition), reach, rtol=1e-9)


@pytest.mark.parametrize("definition", DEFINITIONS)
def test_sector_depends_on_the_ratio_only(definition):
    """Scale invariance."""
    rho = np.linspace(0.9, 1.5, 50)
    expected = sector_angle(1.0, rho, definition=definition)
    assert np.allclose(sector_angle(80.0, 80 * rho, definition=definition), expected, atol=1e-6)


@pytest.mark.parametrize("definition", DEFINITIONS)
def test_longer_reach_means_a_smaller_sector(definition):
    """Strictly, from rho = R to the reach that has no sector; at 96.1 mm by 3.46 degrees a
    millimetre."""
    end = 3.0 if definition == "strip" else np.sqrt(2)
    sector = sector_angle(1.0, np.linspace(1.0, end, 2000), definition=definition)
    assert (np.diff(sector) < 0).all()
    slope = (sector_angle(80.0, 96.112) - sector_angle(80.0, 96.092)) / 0.02
    assert np.degrees(slope) == pytest.approx(-3.46, abs=0.01)


def test_limits():
    """No contact below R, half the circle at R, no safe orientation up to 89.44 mm, no sector from
    sqrt(2) R on."""
    sector = np.degrees(
        sector_angle(80.0, [79.9, 80.0, 80 * np.sqrt(1.25), 80 * np.sqrt(2), 130.0])
    )
    assert np.allclose(sector, [360, 180, 120, 0, 0], atol=1e-5)
    rates = failure_rate(sector_angle(80.0, [79.9, 80.0, 89.4, 113.2]))
    assert rates.tolist() == [1, 1, 1, 0]
    assert safe_margin(sector_angle(80.0, 89.44)) == 0 < safe_margin(sector_angle(80.0, 89.45))


def test_a_slighter_turn_has_a_smaller_sector():
    """At one reach the sector grows with the turn angle; the needed reach goes to R /
    cos(delta/2)."""
    turn = np.radians(np.linspace(60, 150, 40))
    assert (np.diff(sector_angle(80.0, 92.0, turn)) > 0).all()
    assert np.allclose(reach_from_sector(0.0, 80.0, turn), 80 / np.cos(turn / 2))


def test_membership():
    """theta5 = 0, +-11.7 and 120 degrees are safe; 11.8, 60 and -30 are singular."""
    sector = sector_angle(R, RHO)
    singular = is_singular(np.radians([0, 11.7, -11.7, 120, 11.8, 60, -30]), sector)
    assert singular.tolist() == [False, False, False, False, True, True, True]


@pytest.mark.parametrize("modules", [1, 2, 3, 4, 5])
def test_membership_is_that_of_any_module(modules):
    """The one wrapped angle says the same as looking at every module in turn, and its mean is the
    failure rate."""
    theta5, sector = np.linspace(-7, 7, 5001), np.radians(50)
    directions = theta5[:, None] + 2 * np.pi * np.arange(modules) / modules
    off_outer = np.abs(np.angle(np.exp(1j * (directions - np.pi))))
    assert (is_singular(theta5, sector, modules) == (off_outer < sector / 2).any(axis=1)).all()
    period = np.linspace(0, 2 * np.pi / modules, 100_001)
    assert is_singular(period, sector, modules).mean() == pytest.approx(
        failure_rate(sector, modules), abs=1e-4
    )


@pytest.mark.parametrize("modules", [1, 2, 3, 4, 5, 6])
def test_best_and_worst_orientation(modules):
    """From the best one to its margin nothing is singular, beyond it is; the worst one is for any
    sector."""
    sector = np.radians(30)
    margin, best = safe_margin(sector, modules), best_theta5(modules)
    near, beyond = (
        best + margin * np.linspace(-0.999, 0.999, 99),
        best + margin * np.array([-1.001, 1.001]),
    )
    assert not is_singular(near, sector, modules).any()
    assert is_singular(beyond, sector, modules).all()
    assert is_singular(worst_theta5(modules), 1e-6, modules)


def test_intersections_found_by_search_project_to_the_sector():
    """Walk round the mitre ellipse and bisect where it crosses the circle of the reach."""
    for rho, turn in ((RHO, np.pi / 2), (0.085, np.pi / 2), (0.09, 1.2), (0.12, 2.0)):
        a, b = (float(axis) for axis in section_ellipse(R, turn / 2))

        def beyond(t, a=a, b=b, rho=rho):
            return np.hypot(a * np.cos(t), b * np.sin(t)) - rho

        low, high = 0.0, np.pi / 2  # beyond the circle at the vertex, within it across
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if beyond(middle) > 0 else (low, middle)
        x, y = a * np.cos(low), b * np.sin(low)
        # Along the pipe the point (x, y) of the section falls on (x cos(delta/2), y) of the end
        # circle.
        alpha = np.arctan2(y, x * np.cos(turn / 2))
        assert 2 * alpha == pytest.approx(float(sector_angle(R, rho, turn)), abs=1e-9)


def test_the_crotch_circle_meets_the_ellipse_where_its_formula_says():
    """Circle of radius rho through the inner vertex (-a, 0): its other meeting points project to
    the crotch sector."""
    rho, turn = 0.104, np.pi / 2
    a, b = (float(axis) for axis in section_ellipse(R, turn / 2))
    half_sector = float(sector_angle(R, rho, turn, "crotch")) / 2
    u, v = (
        a * np.cos(half_sector),
        b * np.sin(half_sector),
    )  # on the ellipse above that direction of the end circle
    assert np.hypot(u + a - rho, v) == pytest.approx(rho, abs=1e-12)


def test_sections_of_a_pipe_grow_eccentric_with_tilt():
    """Semi-axes R / cos and R; eccentricity sin(tilt)."""
    tilt = np.radians([0, 20, 45])
    a, b = section_ellipse(R, tilt)
    assert np.allclose(np.sqrt(1 - (b / a) ** 2), np.sin(tilt))
    assert np.allclose(section_ellipse(R, np.pi / 4), [np.sqrt(2) * R, R])


def test_a_million_orientations_take_under_a_tenth_of_a_second():
    """Of the processor's time, the best of five: what else the machine does, does not count."""
    theta5, sector = np.random.default_rng(0).uniform(-9, 9, 10**6), sector_angle(R, RHO)
    times = []
    for _ in range(5):
        start = time.process_time()
        is_singular(theta5, sector)
        times.append(time.process_time() - start)
    assert min(times) < 0.1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"pipe_radius": -0.5}, "pipe_radius: is -0.5; it must be positive"),
        ({"reach": np.nan}, "reach: is nan"),
        ({"turn_angle": np.pi}, "turn_angle: is 180 degrees; it must lie between 0 and 180"),
        ({"definition": "oval"}, "choose from: ellipse, crotch, strip"),
    ],
)
def test_bad_values_are_named(values, message):
    """Each fault says what it is about."""
    with pytest.raises(InputError, match=message):
        TurnCase(**values)


def test_sectors_that_no_reach_gives_are_refused():
    """Beyond the one at rho = R; none at all of the strip."""
    with pytest.raises(InputError, match=r"between 0 and 180\.00 degrees"):
        reach_from_sector(3.2, 80.0)
    with pytest.raises(InputError, match="sector"):
        reach_from_sector(0.0, 80.0, definition="strip")


def test_modules_that_are_no_whole_number_are_refused():
    """Whatever rounding would make of them."""
    with pytest.raises(InputError, match=r"modules: is 2\.5"):
        TurnCase(modules=2.5)  # type: ignore[arg-type]
