"""Robots whose inner module slips in a turn into a branch swing across the plane of the turn."""

from __future__ import annotations

import numpy as np
import pytest
from test_control_laws import PERIOD, Bench, scenario_of

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import cross, rotation_about
from omnitrack_sim.record.events import BackedOff
from omnitrack_sim.robots.omnitrack.control.sway import SWAY, Sway
from omnitrack_sim.robots.omnitrack.kinematics import module_speeds

RATE = 1.5
"""rad/s, by which belts turn the robots here."""
TURN = np.pi / 2
FIRST = np.array([False])
NOT = np.zeros(1, bool)
"""Robots at their first attempt."""


def lean(theta5_deg: float, slip: float, progress: float, **changes: float) -> np.ndarray:
    """What is asked for (3,) when a robot has turned by a part of the turn, while so much of the
    rotation by its belts slipped."""
    keys = {f"control.parameters.sway.{key}": value for key, value in changes.items()}
    bench = Bench(scenario_of("tee_turn", **keys))
    sway = Sway(bench.setup, "sway")
    before, inside = bench.observe(0.1, theta5_deg), bench.inside()
    assert not sway.step(before, NOT, NOT, FIRST).aside.any()
    theta5 = np.radians(theta5_deg)
    # About the normal of the turn's plane, in the robot's frame.
    normal = np.array([np.sin(theta5), np.cos(theta5), 0.0])
    radius = float(bench.routes.radius[0])
    wall_speed = module_speeds(0.1, RATE * normal[0], RATE * normal[1], radius)
    ahead, towards = bench.routes.ahead[0], bench.routes.directions[0]
    # Where the nose points counts from the way in, not from the centreline's tangent.
    _, upright = bench.routes.start_poses(bench.route, np.array([0.1]), np.array([theta5]))
    readings = {"wall_speed": wall_speed, "angular_velocity": (1 - slip) * RATE * normal}

    def step(part: float, **more: np.ndarray) -> np.ndarray:
        axis = cross(ahead, towards) * part * TURN
        turned = rotation_about(axis, np.linalg.norm(axis)) @ upright[0]
        seen = bench.observe(inside, theta5_deg, rotation=turned, **more)
        return sway.step(seen, ~NOT, NOT, FIRST).aside

    for _ in range(round(1.2 * SWAY.min_turn / RATE / PERIOD)):
        step(0.5 * SWAY.judged, **readings)
    # What slips later does not count.
    asked = step(progress, wall_speed=wall_speed) if progress > SWAY.judged else step(progress)
    assert sway.slip == pytest.approx([slip])
    return asked[0]


@pytest.mark.parametrize("part", range(len(SWAY.progress)))
@pytest.mark.parametrize("error_deg", [6.0, -6.0])
@pytest.mark.parametrize("best_deg", [0.0, 120.0, -120.0])
def test_a_robot_leans_by_the_shape_away_from_the_inner_module(
    best_deg: float, error_deg: float, part: int
) -> None:
    """Whichever of the three equal modules that is."""
    asked = lean(best_deg + error_deg, 0.5, SWAY.progress[part], lean_deg=30.0)
    bench = Bench(scenario_of("tee_turn"))
    side = cross(bench.routes.ahead[0], bench.routes.directions[0])
    expected = -np.sign(error_deg) * np.tan(np.radians(30.0)) * SWAY.lean[part]
    assert asked == pytest.approx(expected * side, abs=1e-6)


def test_a_robot_first_swings_a_little_the_other_way() -> None:
    """As the turn begins it leans towards its inner module, by less than a quarter of what follows,
    and is upright again before the turn ends."""
    first, most, last = (lean(5.0, 0.5, progress) for progress in (0.05, 1 / 3, 0.85))
    assert -0.25 < np.dot(first, most) / np.dot(most, most) < -0.05
    assert not last.any()


def test_the_lean_grows_with_the_slip_of_the_turn() -> None:
    """None on a wall that holds, half of it in the middle of the range."""
    sizes = [np.linalg.norm(lean(5.0, slip, 1 / 3)) for slip in (-0.1, 0.1, 0.2, 0.3, 0.8)]
    full = np.tan(np.radians(40.0))
    assert sizes == pytest.approx([0.0, 0.0, full / 2, full, full], abs=1e-6)


def test_the_slip_is_that_of_this_turn() -> None:
    """A robot that has left its turn begins the next one afresh."""
    bench = Bench(scenario_of("tee_turn"))
    sway = Sway(bench.setup, "sway")
    entry = float(bench.routes.start[0]) + 0.005
    seen = bench.observe(entry, wall_speed=module_speeds(0.1, 0.0, RATE, 0.08))
    for _ in range(20):
        sway.step(seen, ~NOT, NOT, FIRST)
    assert sway.slip == pytest.approx([1.0])
    sway.step(seen, NOT, NOT, FIRST)
    assert sway.slip == pytest.approx([0.0])


def test_a_robot_may_be_told_to_sway_in_full() -> None:
    bench = Bench(scenario_of("tee_turn"))
    seen = bench.observe(bench.inside(), 5.0)
    once, again = (
        Sway(bench.setup, "sway").step(seen, ~NOT, NOT, full).aside for full in (FIRST, ~FIRST)
    )
    assert not once.any()
    assert np.linalg.norm(again) > 0.1


def slides(slip: float, progress: float, again: bool = False, preload: float = 25.0) -> bool:
    """Whether a turn in which so much of the rotation by the belts slips should be begun again,
    when a robot has turned by a part of it."""
    bench = Bench(scenario_of("tee_turn", **{"robot.preload": preload}))
    sway, turning = Sway(bench.setup, "sway"), np.array([True])
    radius = float(bench.routes.radius[0])
    ahead, towards = bench.routes.ahead[0], bench.routes.directions[0]
    upright = bench.observe(0.1).rotation[0]
    normal = upright.T @ cross(ahead, towards)
    for part in np.linspace(0.0, progress, 20):
        axis = cross(ahead, towards) * part * TURN
        turned = rotation_about(axis, np.linalg.norm(axis)) @ upright
        wall_speed = module_speeds(0.1, RATE * normal[0], RATE * normal[1], radius)
        seen = bench.observe(
            bench.inside(),
            rotation=turned,
            wall_speed=wall_speed,
            angular_velocity=(1 - slip) * RATE * normal,
        )
        lean = sway.step(seen, turning, ~turning, np.array([again]))
        assert lean.slip == 0.0
    assert sway.slip == pytest.approx([slip])
    return bool(sway.slides[0])


def test_a_turn_that_slips_in_its_beginning_is_begun_again() -> None:
    """Not one that slips less, nor later, nor at a further attempt, which would be given up as
    well; and not by a robot whose springs leave the outer modules without a wall to lean on."""
    assert slides(0.7, 0.2)
    assert slides(0.6, 0.2)
    assert not slides(0.5, 0.2)
    assert not slides(0.7, 0.1)
    assert not slides(0.7, 0.4)
    assert not slides(0.7, 0.2, again=True)
    assert slides(0.7, 0.2, preload=19.0)
    assert not slides(0.7, 0.2, preload=18.0)


SLIPPERY = {
    "robot.preload": 33.0,
    "start.theta5_deg": 5.0,
    "control.align": False,
    "control.retry": False,
}


def test_a_robot_that_drives_downward_on_a_slippery_wall_passes_by_its_sway() -> None:
    """The same turn fails without it; on a dry wall it changes nothing."""
    base = ot.override(ot.load_scenario("tee_turn"), SLIPPERY)
    down = 9.81 * base.route.centreline.at(np.zeros(1))[1][0]
    slippery = ot.override(base, {"world.gravity": down.tolist(), "world.friction": 0.54})
    none = {"control.parameters.sway.lean_deg": 0.0}
    dry = ot.override(base, {"world.friction": 0.9})
    scenarios = [slippery, ot.override(slippery, none), dry, ot.override(dry, none)]
    sways, never, a, b = ot.run_batch(scenarios, no_load=False)
    assert (sways.success, never.success) == (True, False)
    assert np.array_equal(a.trajectory["position"], b.trajectory["position"])


def test_a_robot_that_would_slide_past_a_branch_begins_its_turn_again() -> None:
    """Straight down on a slippery wall it backs off once and passes; if it only backs off when it
    has slid past, it falls out of the pipe at the second retry."""
    base = ot.load_scenario("tee_turn")
    down = 9.81 * base.route.centreline.at(np.zeros(1))[1][0]
    slippery = {"world.gravity": down.tolist(), "world.friction": 0.52}
    turn = ot.override(base, slippery | {"robot.preload": 24.0, "start.theta5_deg": -7.0})
    never = ot.override(turn, {"control.parameters.sway.begin_again": 1e3})
    for result, passes in zip(
        ot.run_batch([turn, never], no_load=False), (True, False), strict=True
    ):
        backed_off = [event for event in result.events if isinstance(event, BackedOff)]
        assert (result.success, len(backed_off)) == (passes, 1 if passes else 2)
        assert backed_off[0].cause == ("slips" if passes else "slips past")


def test_a_robot_that_was_turned_back_slips_by_more_than_all() -> None:
    """At the next attempt its slip is that of the first, which full lean leaves as it is; one that
    turns faster than its belts has none."""
    bench = Bench(scenario_of("tee_turn"))
    for spin, slip in ((-0.5, 1.5), (1.2, 0.0)):
        sway, entry = Sway(bench.setup, "sway"), float(bench.routes.start[0]) + 0.005
        plane = cross(bench.routes.ahead[0], bench.routes.directions[0])
        normal = bench.observe(entry).rotation[0].T @ plane
        belts = module_speeds(0.0, RATE * normal[0], RATE * normal[1], 0.08)
        now = {"wall_speed": belts, "angular_velocity": spin * RATE * normal}
        seen = bench.observe(entry, **now)
        for _ in range(20):
            sway.step(seen, ~NOT, NOT, FIRST)
        assert sway.step(seen, ~NOT, NOT, ~FIRST).slip == pytest.approx([slip])
