"""Runs for films, drawn along centrelines, without physics."""

from __future__ import annotations

import numpy as np
from samples import JOINT_POSITIONS, drive, sample_result

from omnitrack_sim.base.rotations import quaternion_from_matrix
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.scenario import validate

SIZE = (320, 180)
PIPES = [
    {"kind": "straight", "length": 0.5},
    {"kind": "elbow", "mean_radius": 0.24},
    {"kind": "straight", "length": 0.4},
]


def elbow_result(pipes: list[dict] = PIPES) -> Result:
    """A robot drawn along a centreline for one second, without physics."""
    scenario = validate({"name": "film", "pipes": pipes})
    line = scenario.route.centreline
    time = np.linspace(0.0, 1.0, 51, dtype=np.float64)
    distance = 0.1 + 0.5 * time
    channels = {name: np.zeros((len(time), *channel.shape)) for name, channel in RECORDED.items()}
    position, frame = line.at(distance)[0], line.frame(distance)
    channels |= {
        "position": position,
        "quaternion": quaternion_from_matrix(frame),
        "distance": distance,
    }
    channels["belt_speed"] = np.full((len(time), 3), 0.1)
    qpos = np.concatenate(
        [position, channels["quaternion"], np.zeros((len(time), JOINT_POSITIONS - 7))], axis=1
    )
    channels["gear"] = np.ones(len(time))
    trajectory = Trajectory(time, channels, ("straight",), qpos, RECORDED)
    return sample_result(trajectory, scenario=scenario)


def chain_result() -> Result:
    """A robot drawn through bends in three planes and a tee: more fittings than a film goes without
    a map."""
    pipes = [
        *PIPES,
        {"kind": "elbow", "mean_radius": 0.09, "turn_deg": 90.0},
        {"kind": "straight", "length": 0.5},
    ]
    pipes += [{"kind": "tee", "enter": "run_start", "leave": "branch", "turn_deg": 120.0}]
    scenario = validate({"name": "chain", "pipes": [*pipes, {"kind": "straight", "length": 0.4}]})
    way = scenario.route
    distance = np.arange(0.1, way.centreline.length - 0.1, 0.01)
    channels = drive(way, distance)
    qpos = np.concatenate(
        [
            channels["position"],
            channels["quaternion"],
            np.zeros((len(distance), JOINT_POSITIONS - 7)),
        ],
        axis=1,
    )
    trajectory = Trajectory(0.1 * np.arange(len(distance)), channels, ("cruise",), qpos, RECORDED)
    return sample_result(trajectory, scenario=scenario)
