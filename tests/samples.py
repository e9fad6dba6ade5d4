"""A plausible run made by formula, for tests of what reads a run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from omnitrack_sim.base.rotations import quaternion_from_matrix
from omnitrack_sim.pipes import Assembly, Route
from omnitrack_sim.pipes.network import load_network
from omnitrack_sim.pipes.planning import shortest_route
from omnitrack_sim.record.events import Outcome, Remark
from omnitrack_sim.record.metrics import summarise
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.scenario import validate

JOINT_POSITIONS = Omnitrack().joint_count


def sample_trajectory(samples: int = 201, end: float = 4.0, **changes: np.ndarray) -> Trajectory:
    """0.1 m/s along a pipe with a turn in the middle half; ``changes`` replace channels."""
    time = np.linspace(0.0, end, samples)
    wave = np.where((time >= end / 4) & (time < 3 * end / 4), np.sin(2 * np.pi * time / end), 0.0)
    channels = {name: np.zeros((samples, *channel.shape)) for name, channel in RECORDED.items()}
    channels["quaternion"][:, 0] = channels["gear"][:] = 1.0
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
    qpos = np.outer(np.cos(time), np.arange(JOINT_POSITIONS))
    return Trajectory(time, channels | changes, ("straight", "turn", "leave"), qpos, RECORDED)


def sample_result(trajectory: Trajectory | None = None, **changes: object) -> Result:
    """A result around ``trajectory`` in a 1 m straight pipe; ``changes`` replace fields."""
    trajectory = sample_trajectory() if trajectory is None else trajectory
    scenario = changes.get("scenario") or validate(
        {"name": "sample", "pipes": [{"kind": "straight", "length": 1.0}]}
    )
    fields: dict = {
        "scenario": scenario,
        "outcome": Outcome.REACHED_GOAL,
        "reason": "reached 0.5 m",
        "duration_s": float(trajectory.time[-1]),
        "metrics": summarise(
            scenario.robot.run_record(trajectory, 1e-4, 0.0), scenario.robot.metrics
        ),
        "trajectory": trajectory,
        "provenance": provenance_of(scenario),
        "events": [Remark(0, 1.0, "a remark")],
    }
    return Result(**(fields | changes))


@dataclass(frozen=True)
class LegsResult(Result):
    """A result whose routes are given instead of the scenario's one route."""

    driven: tuple[Route, ...] = field(default=())

    def routes(self) -> tuple[Route, ...]:
        return self.driven

    def goal_points(self) -> np.ndarray:
        return self.driven[-1].network.parts[-1].port("end").position[None]

    @property
    def pipes(self) -> Assembly:
        return self.driven[0].network


PHASES = ("cruise", "align", "back_off")


def two_legs() -> tuple[Route, Route]:
    """Into an arm of the network ``fig14``, and back out of it into another."""
    network = load_network("fig14")
    return shortest_route(network, "inlet", "side"), shortest_route(network, "side", "low")


def drive(route: Route, distance: np.ndarray, leg: int = 0, gear: int = 1) -> dict[str, np.ndarray]:
    """Channels of a robot that is at ``distance`` (T,) m of a route's centreline, nose or tail
    along it."""
    samples = len(distance)
    channels = {name: np.zeros((samples, *channel.shape)) for name, channel in RECORDED.items()}
    position, frame = route.centreline.at(distance)[0], route.centreline.frame(distance)
    bend = route.centreline.at(distance)[3][:, None] / 11.0  # 1 on the tightest bend
    channels |= {
        "position": position,
        "quaternion": quaternion_from_matrix(frame * [1.0, gear, gear]),
    }
    channels |= {"distance": distance, "leg": np.full(samples, leg), "gear": np.full(samples, gear)}
    channels["tilt"] = 0.1 * bend[:, 0]
    channels["belt_speed"] = channels["belt_speed_command"] = np.full((samples, 3), 0.1 * gear)
    channels["motor_torque"] = np.full((samples, 3), 0.05 * gear)
    channels["normal_force"] = 25.0 + bend * [-15.0, 5.0, 5.0]
    channels["slip_ratio"] = 0.01 + bend * [0.3, 0.1, -0.1]
    channels["slip_velocity"] = 0.1 * channels["slip_ratio"]
    channels["contact_count"][:, :, 0] = 17
    return channels


def legs_trajectory(
    routes: tuple[Route, ...], distances: list[np.ndarray], gears: list[int]
) -> Trajectory:
    """Legs one after the other at one sample in 20 ms; the phase is cruise throughout."""
    legs = zip(routes, distances, range(len(routes)), gears, strict=True)
    parts = [drive(*leg) for leg in legs]
    channels = {name: np.concatenate([part[name] for part in parts]) for name in RECORDED}
    time = 0.02 * np.arange(len(channels["distance"]))
    qpos = np.concatenate(
        [channels["position"], channels["quaternion"], np.zeros((len(time), JOINT_POSITIONS - 7))],
        axis=1,
    )
    return Trajectory(time, channels, PHASES, qpos, RECORDED)


def two_legs_result(**changes: object) -> LegsResult:
    """The legs of ``two_legs`` at 0.1 m/s, the second tail first; a roll before ``tee_1``, a retry
    in the elbow."""
    routes = two_legs()
    there, back = (route.centreline.length for route in routes)
    ahead = np.concatenate(
        [
            np.arange(0.1, 1.3, 0.002),
            np.arange(1.3, 1.1, -0.002),
            np.arange(1.1, there - 0.1, 0.002),
        ]
    )
    trajectory = legs_trajectory(routes, [ahead, np.arange(0.1, back - 0.1, 0.002)], [1, -1])
    trajectory.channels["phase"][np.isclose(ahead, 0.4, atol=0.001).nonzero()[0]] = 1
    trajectory.channels["phase"][600:700] = 2
    plain = sample_result(trajectory, **changes)
    return LegsResult(
        **{name: getattr(plain, name) for name in plain.__dataclass_fields__}, driven=routes
    )
