"""A plausible run made by formula, for tests of what reads a run."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.metrics import summarise
from omnitrack_sim.outcome import Outcome
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.result import Result, provenance_of
from omnitrack_sim.trajectory import CHANNELS, Trajectory

LUG_RADIUS, TORQUE_LIMIT = 0.0276, 0.245


def sample_trajectory(samples: int = 201, end: float = 4.0, **changes: np.ndarray) -> Trajectory:
    """0.1 m/s along a pipe with a turn in the middle half; ``changes`` replace channels."""
    time = np.linspace(0.0, end, samples)
    wave = np.where((time >= end / 4) & (time < 3 * end / 4), np.sin(2 * np.pi * time / end), 0.0)
    channels = {name: np.zeros((samples, *channel.shape)) for name, channel in CHANNELS.items()}
    channels["quaternion"][:, 0] = 1.0
    channels["position"][:, 2] = channels["distance"] = 0.1 + 0.1 * time
    channels["tilt"] = 0.1 * np.abs(wave)
    channels["phase"] = np.select([time < end / 4, time < 3 * end / 4], [0, 1], 2)
    factors = np.array([-1.0, 0.5, 0.5])
    channels["belt_speed"] = channels["belt_speed_command"] = 0.1 + 0.08 * wave[:, None] * factors
    channels["wall_speed"] = channels["belt_speed"]
    channels["motor_torque"] = 0.05 + 0.02 * wave[:, None] * factors
    channels["traction"] = 1.0 + 0.5 * wave[:, None] * factors
    channels["normal_force"] = 25.0 + 10.0 * wave[:, None] * factors
    channels["slip_velocity"] = 0.002 + 0.01 * wave[:, None] * factors
    channels["slip_ratio"] = channels["slip_velocity"] / 0.1
    channels["contact_count"][:, :, 0] = 17
    channels["slide"] = 0.01 * wave[:, None] * factors
    qpos = np.stack([np.cos(time), np.sin(time)], axis=1)
    return Trajectory(time, channels | changes, ("straight", "turn", "leave"), qpos)


def sample_result(trajectory: Trajectory | None = None, **changes: object) -> Result:
    """A result around ``trajectory`` in a 1 m straight pipe; ``changes`` replace fields."""
    trajectory = sample_trajectory() if trajectory is None else trajectory
    scenario = validate({"name": "sample", "pipes": [{"kind": "straight", "length": 1.0}]})
    fields: dict = {
        "scenario": scenario,
        "outcome": Outcome.REACHED_GOAL,
        "reason": "reached 0.5 m",
        "duration_s": float(trajectory.time[-1]),
        "metrics": summarise(trajectory, no_load_slip=1e-4, lug_radius=LUG_RADIUS, torque_limit=TORQUE_LIMIT),
        "trajectory": trajectory,
        "provenance": provenance_of(scenario),
        "events": ["a remark"],
    }
    return Result(**(fields | changes))
