"""Sensors and metrics of a user's own: seen, recorded, computed, saved and read back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from runs import COLLIDER, same_record, there_and_back

import omnitrack_sim as ot
from omnitrack_sim.record.channels import CHANNELS, Vector
from omnitrack_sim.sensing import State

POWER = ot.Sensor(
    ot.Channel("belt_power", (3,), "W", "mechanical power of each belt", tail_first="swapped"),
    lambda state: state["motor_torque"] / state.robot.lug_radius * state["belt_speed"],
)
"""Computed from other sensors."""
CHASSIS = ot.Sensor(
    Vector("chassis", (3,), "m", "where the chassis is", "world"), lambda state: state.qpos[:, :3]
)
"""A view of the engine's own array."""
TURNS = ot.Sensor(
    ot.Channel("turns", (), "1", "whole metres so far", whole=True, recorded=False),
    lambda state: np.floor(state["position"][:, 0]),
)
SENSORS = (POWER, CHASSIS, TURNS)
PEAK = ot.Metric(
    "belt_power_max_w",
    "W",
    "largest power of a belt",
    lambda run: run.trajectory["belt_power"].max(axis=0).tolist(),
    per_module=True,
)
HALF = ot.Metric("half_way_m", "m", "half of the headway", lambda run: run.travelled / 2)
METRICS = (PEAK, HALF)


class Watcher:
    """Cruises, and keeps what it sees."""

    seen: list[ot.Observation]

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.speed = np.repeat(setup.settings.cruise_speed[:, None], 3, axis=1)
        Watcher.seen = []

    def step(self, observation: ot.Observation) -> ot.Command:
        assert observation.belt_power.shape == self.speed.shape
        Watcher.seen.append(observation)
        return ot.Command(self.speed)


def straight(**changes: object) -> ot.Scenario:
    short = {"physics.time_limit": 0.3, "physics.collider": COLLIDER}
    return ot.override(ot.load_scenario("straight"), short | changes)


@pytest.fixture(scope="module")
def result() -> ot.Result:
    """A run with all of them, driven by the shipped controller."""
    return ot.run(straight(), sensors=SENSORS, metrics=METRICS)


@pytest.fixture(scope="module")
def folder(result: ot.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result.save(tmp_path_factory.mktemp("own") / "run")


def test_what_is_measured_is_recorded(result: ot.Result) -> None:
    """Channels of own sensors stand in the trajectory with their values at each sample; one that is
    not to be recorded does not."""
    trajectory = result.trajectory
    robot = result.scenario.robot
    power = trajectory["motor_torque"] * trajectory["belt_speed"] / robot.lug_radius
    assert trajectory["belt_power"] == pytest.approx(power)
    assert trajectory.schema["belt_power"] is POWER.channel
    assert set(trajectory.channels) - set(CHANNELS) == {"belt_power", "chassis"}


def test_a_view_of_the_engines_array_is_recorded_as_it_was(result: ot.Result) -> None:
    """A sensor that returns a part of the engine's array, which changes with every step, is
    recorded sample by sample."""
    assert np.array_equal(result.trajectory["chassis"], result.trajectory["position"])
    assert np.ptp(result.trajectory["chassis"][:, 0]) > 0.01


def test_the_shipped_channels_do_not_change(result: ot.Result) -> None:
    """With and without own sensors the shipped channels have the same bytes."""
    plain = ot.run(straight()).trajectory
    assert result.trajectory.qpos.tobytes() == plain.qpos.tobytes()
    for name in plain.channels:
        assert result.trajectory[name].tobytes() == plain[name].tobytes(), name


def test_a_controller_sees_what_is_measured() -> None:
    """Own channels are attributes of the observation, in the run and in the short one without load
    as well; what is not there is an error that names what is."""
    result = ot.run(straight(), controller=Watcher, sensors=SENSORS)
    assert np.isfinite(result.metrics["no_load_slip_m_s"])  # type: ignore[arg-type]
    every = round(0.02 / 0.01)
    told = np.array([observation.belt_power[0] for observation in Watcher.seen[::every]])
    assert np.array_equal(told, result.trajectory["belt_power"][: len(told)])
    assert Watcher.seen[0].turns.tolist() == [0.0]
    with pytest.raises(AttributeError, match=r"no channel 'belt_pwer' is observed .*belt_speed"):
        _ = Watcher.seen[0].belt_pwer


def test_a_controller_of_a_robot_in_reverse_sees_own_channels_turned() -> None:
    """``tail_first`` of an own channel is obeyed: modules 2 and 3 change places."""
    simulation = ot.Simulation([there_and_back()], sensors=[POWER])
    while simulation.active.any() and simulation.legs.gear[0] > 0:
        simulation.step()
    for _ in range(3):
        simulation.step()
    seen, (real, *_) = simulation.observation.belt_power[0], simulation.plant.read()["belt_power"]
    assert simulation.legs.gear[0] == -1
    assert len(set(real.tolist())) == 3
    assert seen.tolist() == real[[0, 2, 1]].tolist()


def test_metrics_are_computed_from_own_channels(result: ot.Result, folder: Path) -> None:
    """Own metrics stand beside the shipped ones in the result and in result.json."""
    assert result.metrics["belt_power_max_w"] == result.trajectory["belt_power"].max(0).tolist()
    assert result.metrics["half_way_m"] == result.metrics["distance_m"] / 2  # type: ignore[operator]
    told = json.loads((folder / "result.json").read_text(encoding="utf-8"))["metrics"]
    assert told["belt_power_max_w"] == result.metrics["belt_power_max_w"]
    assert told["half_way_m"] == result.metrics["half_way_m"]
    assert ot.load_result(folder).metrics == result.metrics


def test_the_table_tells_unit_and_meaning(folder: Path) -> None:
    """Columns of own channels are named and described as the shipped ones are."""
    schema = pq.read_schema(folder / "trajectory.parquet")
    for module in (1, 2, 3):
        assert schema.field(f"belt_power_{module}").metadata == {
            b"unit": b"W",
            b"meaning": b"mechanical power of each belt",
            b"frame": b"",
        }
    assert schema.field("chassis_z").metadata[b"frame"] == b"world"
    assert not any(name.startswith("turns") for name in schema.names)


def test_a_run_with_own_channels_is_read_back(result: ot.Result, folder: Path) -> None:
    """All channels, own ones too, and what is said of them, come back from the folder."""
    again = ot.load_result(folder)
    assert again.trajectory.schema == result.trajectory.schema
    for name in result.trajectory.channels:
        assert np.array_equal(again.trajectory[name], result.trajectory[name]), name
    assert type(again.trajectory.schema["chassis"]) is Vector


def test_a_batch_measures_every_robot() -> None:
    """Own channels of a robot in a batch have the bytes that they have alone."""
    scenarios = [straight(**{"contact.friction": f}) for f in (0.5, 0.9)]
    together = ot.run_batch(scenarios, sensors=SENSORS, metrics=METRICS, no_load=False)
    for scenario, result in zip(scenarios, together, strict=True):
        alone = ot.run(scenario, sensors=SENSORS, metrics=METRICS)
        assert same_record(alone, result)
        assert alone.metrics["belt_power_max_w"] == result.metrics["belt_power_max_w"]


def test_sensors_read_the_state() -> None:
    """A sensor is handed the state of all robots at once."""
    shapes = []

    def read(state: State) -> np.ndarray:
        shapes.append(state.qpos.shape)
        return np.zeros(len(state.time))

    sensor = ot.Sensor(ot.Channel("nothing", (), "1", "always zero"), read)
    simulation = ot.Simulation([straight()] * 2, sensors=[sensor])
    assert shapes == [simulation.plant.qpos.shape]
    assert simulation.observation.nothing.tolist() == [0.0, 0.0]
