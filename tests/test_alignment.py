"""The roll before a fitting."""

import numpy as np

from omnitrack_sim.control.alignment import NO_MOTION_COSINE, PERIOD, orientation_error, plan_roll

RATIO = 0.0276 / 0.080


def _draw(n=2000):
    rng = np.random.default_rng(3)
    theta5, roll = rng.uniform(-np.pi, np.pi, n), rng.uniform(-6, 6, n)
    best, margin = rng.choice([0.0, np.pi / 3], n), np.radians(rng.uniform(5, 15, n))
    return theta5, roll, best, margin


def test_plan_ends_inside_the_margin_and_off_the_no_motion_line():
    """Every plan that exists meets both conditions."""
    theta5, roll, best, margin = _draw()
    change, exists = plan_roll(theta5, roll, best, margin, RATIO)
    assert exists.mean() > 0.95
    end = orientation_error(theta5 - change * RATIO, best)
    assert (np.abs(end) <= margin + 1e-9)[exists].all()
    assert (np.abs(np.cos(roll + change)) >= NO_MOTION_COSINE)[exists].all()


def test_plan_turns_by_no_more_than_three_halves_of_a_period():
    """No plan goes further round than the neighbouring equal orientation needs."""
    theta5, roll, best, margin = _draw()
    change, _ = plan_roll(theta5, roll, best, margin, RATIO)
    assert (np.abs(change) * RATIO <= 1.5 * PERIOD + margin).all()


def test_plan_is_mirrored_when_the_start_is():
    """Mirroring orientation and roll mirrors the plan."""
    theta5, roll, best, margin = _draw(500)
    change, exists = plan_roll(theta5, roll, best, margin, RATIO)
    mirrored, exists_too = plan_roll(-theta5, -roll, -best, margin, RATIO)
    assert (exists == exists_too).all()
    assert np.allclose(np.abs(change), np.abs(mirrored), atol=1e-9)
