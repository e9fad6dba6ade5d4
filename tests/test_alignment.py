"""The roll before a fitting."""

import numpy as np
import pytest

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.robots.omnitrack.control.orientation import (
    OrientationRange as Range,
)
from omnitrack_sim.robots.omnitrack.control.orientation import (
    intersect,
    orientation_error,
    preferred_theta5,
)
from omnitrack_sim.robots.omnitrack.control.roll_plan import (
    NO_MOTION_MARGIN,
    Obstacle,
    no_motion_distance,
    plan_roll,
)
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.singularity import is_singular, safe_margin, sector_angle

RATIO = 0.0276 / 0.080


def _draw(n=4000, seed=3):
    """Random starts: theta5, roll, best, margin, radius ratio, no-motion margin."""
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(-np.pi, np.pi, n),
        rng.uniform(-9, 9, n),
        rng.uniform(-np.pi, np.pi, n),
        np.radians(rng.uniform(0.5, 40, n)),
        rng.uniform(0.1, 0.9, n),
        np.radians(rng.uniform(0, 80, n)),
    )


def _plan(draw, **more):
    *places, clearance = draw
    return plan_roll(*places, no_motion_margin=clearance, **more)


def test_plan_ends_inside_the_margin_and_off_the_no_motion_line():
    """Every plan that exists meets both conditions, and says where it ends."""
    theta5, roll, best, margin, ratio, clearance = draw = _draw()
    plan = _plan(draw)
    assert 0.5 < plan.exists.mean() < 1
    end = orientation_error(theta5 - plan.change * ratio, best)
    assert (np.abs(end) <= margin + 2e-9)[plan.exists].all()
    assert (no_motion_distance(roll + plan.change) >= clearance - 2e-9)[plan.exists].all()
    assert np.allclose(np.exp(1j * plan.theta5), np.exp(1j * (theta5 - plan.change * ratio)))
    assert (plan.belt_sign == belt_sign(roll + plan.change)).all()
    assert (plan.belt_sign != 0)[plan.exists].all()


@pytest.mark.parametrize("modules", [2, 3, 4])
@pytest.mark.parametrize("turn_limit", [np.pi / 3, np.pi])
def test_no_admissible_roll_is_shorter(modules, turn_limit):
    """Against a fine grid of all rolls within the turn limit: none is shorter, none there where the
    plan has none."""
    theta5, roll, best, margin, ratio, clearance = draw = _draw(150, seed=modules)
    plan = _plan(draw, modules=modules, turn_limit=turn_limit)
    turn = np.linspace(-turn_limit, turn_limit, 40_001)
    step = turn[1] - turn[0]
    change = turn / ratio[:, None]
    wanted = (
        np.abs(orientation_error(theta5[:, None] - turn, best[:, None], modules)) <= margin[:, None]
    )
    admissible = wanted & (no_motion_distance(roll[:, None] + change) >= clearance[:, None])
    shortest = np.where(admissible, np.abs(change), np.inf).min(axis=1)
    # The grid misses ranges narrower than its step: it may find nothing, never something shorter.
    assert (np.abs(plan.change) <= shortest + 1e-9)[plan.exists].all()
    assert np.isinf(shortest)[~plan.exists].all()
    found = np.isfinite(shortest)
    assert found.mean() > 0.4
    assert (np.abs(plan.change)[found] >= shortest[found] - 2 * step / ratio[found]).mean() > 0.97


def test_a_plan_turns_the_robot_by_up_to_half_a_turn():
    """As far as the equal orientation opposite, where nearer ones end at the no-motion line, and no
    farther."""
    theta5, roll = np.random.default_rng(2).uniform(-np.pi, np.pi, (2, 4000))
    plan = plan_roll(theta5, roll, 0.0, 0.1, 0.345, no_motion_margin=1.0)
    turns = np.abs(plan.change) * 0.345
    assert 0.95 * np.pi < turns.max() <= np.pi + 1e-6


def test_robot_that_is_well_placed_does_not_roll():
    """Inside the margin and off the line: nothing to do."""
    plan = plan_roll([0.0, 0.1, 2 * np.pi / 3], [0.2, np.pi, -0.3], 0.0, 0.2, RATIO)
    assert plan.change.tolist() == [0, 0, 0]
    assert plan.exists.all()
    assert plan.belt_sign.tolist() == [1, -1, 1]


def test_modules_on_the_no_motion_line_roll_off_it():
    """Well oriented, but rolled by 90 degrees: the shortest way off, 30 degrees, stays within 11.7
    of theta5."""
    plan = plan_roll(0.0, np.pi / 2, 0.0, np.radians(11.7), RATIO)
    assert abs(plan.change) == pytest.approx(NO_MOTION_MARGIN)
    assert plan.change > 0  # of two equal ones the positive
    assert plan.belt_sign == -1


def test_worst_orientation_goes_to_the_border_of_the_safe_range():
    """From theta5 = 60 by 48.27 degrees of robot, 139.9 of roll: the module ends on its lower
    track."""
    margin = safe_margin(sector_angle(0.08, 0.0961016))
    plan = plan_roll(np.pi / 3, 0.0, 0.0, margin, RATIO)
    assert np.degrees(abs(plan.change)) == pytest.approx(
        (60 - np.degrees(margin)) / RATIO, abs=1e-6
    )
    assert plan.belt_sign == -1
    assert not is_singular(plan.theta5, sector_angle(0.08, 0.0961016) - 1e-6)


def test_plan_is_mirrored_when_the_start_is():
    """Mirroring orientation and roll mirrors the plan."""
    theta5, roll, best, margin, ratio, clearance = draw = _draw(2000)
    plan, mirrored = _plan(draw), _plan((-theta5, -roll, -best, margin, ratio, clearance))
    assert (plan.obstacle == mirrored.obstacle).all()
    assert np.allclose(plan.change, -mirrored.change, atol=1e-8)


def test_equal_orientations_have_the_same_plan():
    """A third of a turn of the robot and a whole turn of the modules change nothing."""
    theta5, roll, best, margin, ratio, clearance = draw = _draw(2000)
    plan = _plan(draw)
    again = _plan(
        (theta5 + 2 * np.pi / 3, roll - 2 * np.pi, best - 4 * np.pi / 3, margin, ratio, clearance)
    )
    assert np.allclose(plan.change, again.change, atol=1e-8)


@pytest.mark.parametrize(
    ("more", "obstacle"),
    [
        ({"margin": 0.0}, Obstacle.NO_SAFE_ORIENTATION),
        ({"no_motion_margin": np.radians(91)}, Obstacle.NO_ROLL_OFF_THE_LINE),
        ({"turn_limit": 0.1}, Obstacle.OUT_OF_RANGE),
        ({"margin": 0.01, "no_motion_margin": np.radians(89)}, Obstacle.OUT_OF_RANGE),
    ],
)
def test_impossible_margins_are_said(more, obstacle):
    """No roll, and the reason with what to try."""
    plan = plan_roll(
        **{
            "theta5": np.pi / 3,
            "roll": 0.0,
            "best": 0.0,
            "margin": 0.2,
            "radius_ratio": RATIO,
            **more,
        }
    )
    assert not plan.exists
    assert plan.change == 0
    assert Obstacle(int(plan.obstacle)) is obstacle
    assert len(obstacle.text) > 40


def test_preferred_orientations():
    """A module innermost in an elbow and towards a tee's branch; on either side of an opening
    driven past."""
    assert [
        np.degrees(preferred_theta5(m)) for m in ("elbow", "tee_turn", "tee_straight")
    ] == pytest.approx([0, 0, 60])
    assert np.degrees(preferred_theta5("tee_turn", modules=4)) == pytest.approx(45)
    with pytest.raises(InputError, match="elbow, tee_turn, tee_straight"):
        preferred_theta5("cross")


def test_any_shape():
    """Arguments broadcast."""
    plan = plan_roll(np.zeros((4, 1)), np.zeros(5), 0.0, 0.1, RATIO)
    assert plan.change.shape == plan.obstacle.shape == plan.theta5.shape == (4, 5)
    assert plan_roll(np.zeros((0,)), 0.0, 0.0, 0.1, RATIO).change.shape == (0,)


def test_bad_values_are_named():
    """Radius ratio and turn limit."""
    with pytest.raises(InputError, match="radius_ratio"):
        plan_roll(0.0, 0.0, 0.0, 0.1, 0.0)
    with pytest.raises(InputError, match="turn_limit"):
        plan_roll(0.0, 0.0, 0.0, 0.1, RATIO, turn_limit=-1.0)


def test_wishes_agree_on_what_they_have_in_common():
    """The common range of two wishes, the first one's where they have none, modulo the period of
    the modules."""
    margin = np.radians([10.0])
    best, width = intersect([Range(0.0, margin), Range(np.radians(12.0), margin)])
    assert np.degrees([best[0], width[0]]) == pytest.approx([6.0, 4.0])
    best, width = intersect([Range(0.0, margin), Range(np.radians(132.0), margin)])
    assert np.degrees([best[0], width[0]]) == pytest.approx([6.0, 4.0])
    best, width = intersect(
        [
            Range(0.0, margin),
            Range(np.radians(60.0), margin),
            Range(np.radians(-8.0), margin),
        ]
    )
    assert np.degrees([best[0], width[0]]) == pytest.approx([-4.0, 6.0])
    best, width = intersect([Range(0.3, np.array([0.1, 0.2])), Range(0.5, np.array([0.05, 0.1]))])
    assert best == pytest.approx([0.3, 0.45])
    assert width == pytest.approx([0.1, 0.05])
