"""The robot turned by 120 degrees is the same, and policies see it so."""

from __future__ import annotations

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import matrix_from_quaternion
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import TRUTH
from omnitrack_sim.robots.omnitrack.policy.sectors import counted_from, modules_from

THIRD = 120.0


def turn(theta5_deg: float, **changes: object) -> ot.Scenario:
    """A tee turn by the policy that drives alone, gravity askew to everything."""
    return ot.load_scenario(
        "tee_turn",
        {
            "control.kind": "policy",
            "control.parameters.policy": "tee_turn",
            "start.theta5_deg": (theta5_deg + 180.0) % 360.0 - 180.0,
            "world.gravity": [3.0, -5.0, -7.0],
            **changes,
        },
    )


def three(theta5_deg: float, **changes: object) -> ot.Simulation:
    """Three robots that are the same but for which module is called the first."""
    return ot.Simulation([turn(theta5_deg + k * THIRD, **changes) for k in range(3)])


def features(simulation: ot.Simulation) -> np.ndarray:
    """What policies see of three robots, (3, k)."""
    decisions = Decisions(simulation.setup, TRUTH)
    return decisions.observe(simulation.observation)


@pytest.mark.parametrize("theta5_deg", [-50.0, 10.0, 41.0])
def test_policies_see_the_three_turned_robots_alike(theta5_deg: float) -> None:
    """All features, of the truth too, are those of the robot within 60 degrees of the turning
    direction: at the start, and after a tenth of a second in which it has moved."""
    simulation = three(theta5_deg, **{"world.gravity": [0.0, 0.0, -9.81]})
    for _ in range(2):
        seen = features(simulation)
        assert seen[1:] == pytest.approx(np.repeat(seen[:1], 2, axis=0), abs=1e-3)
        assert np.abs(seen[0]).max() > 0.1
        for _ in range(10):
            simulation.step()


def test_the_three_turned_robots_drive_alike() -> None:
    """Belt speeds, contacts and poses of three robots turned by 120 degrees are the same, module by
    module from another one on, until rounding has grown: over 1 s to 1e-6."""
    simulation = three(33.0)
    for _ in range(100):
        simulation.step()
    own = simulation.observation
    # Robot k has its module 1 where the first robot has the one k places on.
    shown = counted_from(own, np.array([0, 2, 1]))
    for name in ("belt_speed", "motor_torque", "slide", "roll", "contact_position"):
        values = getattr(shown, name)
        assert values[1:] == pytest.approx(np.repeat(values[:1], 2, axis=0), abs=1e-6), name
    assert shown.location.theta5[1:] == pytest.approx(shown.location.theta5[0], abs=1e-6)
    assert shown.rotation[1:] == pytest.approx(np.repeat(shown.rotation[:1], 2, axis=0), abs=1e-6)
    assert shown.angular_velocity[1:] == pytest.approx(
        np.repeat(shown.angular_velocity[:1], 2, axis=0), abs=1e-4
    )
    assert own.angular_velocity[1] != pytest.approx(own.angular_velocity[0], abs=1e-4)
    frames = matrix_from_quaternion(shown.quaternion)
    assert frames == pytest.approx(shown.rotation, abs=1e-9)


def test_an_order_of_modules_comes_back() -> None:
    """From module ``first`` on and from ``-first`` on leaves the robots' own order; from module 2
    on, numbered from 0, it comes first."""
    values, first = np.arange(18.0).reshape(3, 3, 2), np.array([0, 1, 2])
    turned = modules_from(values, first)
    assert turned[2, 0].tolist() == values[2, 2].tolist()
    assert modules_from(turned, -first).tolist() == values.tolist()


def test_the_policy_that_drives_alone_turns_from_any_orientation() -> None:
    """It was trained within 60 degrees of the turning direction; from eight orientations beyond
    that it passes too."""
    scenarios = [turn(theta5_deg) for theta5_deg in (-170, -140, -100, -70, 70, 100, 140, 170)]
    results = ot.run_batch(scenarios, no_load=False)
    assert [result.outcome.value for result in results] == ["reached_goal"] * 8
