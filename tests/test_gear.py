"""A robot that drives tail first is one that drives nose first, seen from behind."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omnitrack_sim import (
    Outcome,
    Simulation,
)
from omnitrack_sim.autonomy.pilots import Pilot
from omnitrack_sim.base.rotations import Array, heading
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.robots.omnitrack.control.command import (
    SWAPPED,
    Command,
    mirror_command,
    mirror_readings,
)
from omnitrack_sim.robots.omnitrack.events import Rolled
from omnitrack_sim.robots.omnitrack.track_plant import TrackPlant
from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.scenario import Scenario, validate


def readings(n: int = 4) -> dict[str, Array]:
    """Random values of all channels that controllers see, for n robots."""
    rng = np.random.default_rng(0)
    observed = [channel for channel in CHANNELS.values() if channel.source == "plant"]
    values = {channel.name: rng.normal(size=(n, *channel.shape)) for channel in observed}
    return values | {"rotation": np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]}


def test_turning_twice_is_the_identity():
    """Seen from behind and from behind again, a robot is what it was; likewise a command and a
    frame."""
    gear = np.array([1, -1, -1, 1])
    first = readings()
    once, twice = mirror_readings(first, gear), mirror_readings(mirror_readings(first, gear), gear)
    assert not np.array_equal(once["rotation"], first["rotation"])
    assert set(once) == set(twice) == set(first)
    for name, values in first.items():
        # A quaternion and its negative are one rotation.
        sign = np.where(gear < 0, -1.0, 1.0)[:, None] if name == "quaternion" else 1.0
        assert np.array_equal(twice[name], sign * values), name
    frames = first["rotation"]
    assert np.allclose(np.linalg.det(heading(frames, gear)), np.linalg.det(frames))
    rolls = [Rolled(robot, 0.0, "tee_1", 30.0, 50.0, 5.0) for robot in (0, 1)]
    command = Command(first["belt_speed"], roll=first["roll"], phase=gear, events=rolls)
    assert [e.roll_deg for e in mirror_command(command, gear).events] == [30.0, -30.0]
    again = mirror_command(mirror_command(command, gear), gear)
    assert again.events == rolls
    assert np.array_equal(again.belt_speed, command.belt_speed)
    assert again.roll is not None
    assert np.array_equal(again.roll, first["roll"])
    assert np.array_equal(
        mirror_command(command, gear).belt_speed[1], -command.belt_speed[1, SWAPPED]
    )


def test_every_channel_is_seen_from_behind_as_its_schema_says():
    """Robots in reverse see each observed channel turned as its ``tail_first`` says, the others as
    it is."""
    gear, first = np.array([1, -1]), readings(2)
    turned = {
        "same": lambda v: v,
        "swapped": lambda v: v[SWAPPED],
        "negated": lambda v: -v[SWAPPED],
        "turned": lambda v: v * [1.0, -1.0, -1.0],
        "facing": lambda v: v * [1.0, -1.0, -1.0],
        "behind": lambda v: np.array([-v[1], v[0], v[3], -v[2]]),
    }
    for name, values in mirror_readings(first, gear).items():
        assert np.array_equal(values[0], first[name][0]), name
        expected = turned[CHANNELS[name].tail_first](first[name][1])
        assert np.array_equal(values[1], expected), name


def tail_first_plant(scenario: Scenario, start: Start, threads: int) -> Plant:
    """The robots turned by 180 degrees about their x axes."""
    w, x, y, z = start.quaternion.T
    turned = np.stack([-x, w, z, -y], axis=-1)  # the product with a half turn about x
    moved, period = dataclasses.replace(start, quaternion=turned), scenario.physics.control_period
    return TrackPlant(scenario.to_spec().compile(), scenario.robot, moved, period, threads)


def tail_first_pilot(scenario: Scenario, robot: int) -> Pilot:
    """Drives the whole route tail first."""
    pilot = scenario.pilot(robot)
    pilot.leg = dataclasses.replace(pilot.leg, gear=-1)
    return pilot


@pytest.mark.parametrize(("theta5_deg", "until"), [(0.0, 99.0), (50.0, 4.5)])
def test_tail_first_is_nose_first_seen_from_behind(theta5_deg, until):
    """Through an elbow: the same way, with belts and rolls of modules 2 and 3 exchanged.

    From 50 degrees the modules are rolled first. In the elbow, where the robot is then not
    symmetric, contacts that come and go make much of differences by rounding from about 5 s on.
    """
    pipes = [{"kind": "straight", "length": 0.4}, {"kind": "elbow", "mean_radius": 0.24}]
    pipes.append({"kind": "straight", "length": 0.4})
    start = {"distance": 0.12, "theta5_deg": theta5_deg}
    scenario = validate({"pipes": pipes, "start": start})
    there = Simulation([scenario])
    back = Simulation([scenario], pilot=tail_first_pilot, make_plant=tail_first_plant)
    runs = [there, back]
    for run in runs:
        run.advance()
    nose, tail = (run.results()[0] for run in runs)
    assert nose.outcome is tail.outcome is Outcome.REACHED_GOAL
    assert (tail.trajectory["gear"] == -1).all()
    assert tail.duration_s == pytest.approx(nose.duration_s, abs=0.1)
    a, b = nose.trajectory, tail.trajectory
    n = int(np.searchsorted(a.time, min(until, tail.duration_s)))
    assert a["distance"][n - 1] > 0.35  # the nose is in the elbow at least
    assert np.abs(a["position"][:n] - b["position"][:n]).max() < 0.001
    assert np.abs(a["tilt"][:n] - b["tilt"][:n]).max() < np.radians(0.5)
    assert np.abs(a["roll_command"][:n] + b["roll_command"][:n][:, SWAPPED]).max() < np.radians(0.1)
    assert np.abs(a["belt_speed"][:n] + b["belt_speed"][:n][:, SWAPPED]).max() < 0.02
