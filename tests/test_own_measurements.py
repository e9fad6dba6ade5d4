"""Sensors and metrics of a user's own: seen, recorded, computed, saved and read back."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from runs import same_record, there_and_back

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.cli.runs import print_result
from omnitrack_sim.record.channels import Vector
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.trials.sweep_file import resolve

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
    lambda run: run.trajectory["belt_power"].max(axis=0),  # an array of NumPy
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
    short = {"run.time_limit": 0.3}
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
    assert len(told) == len(result.trajectory.time) - 1  # no command follows the last sample
    assert np.array_equal(told, result.trajectory["belt_power"][:-1])
    assert Watcher.seen[0].turns.tolist() == [0.0]
    with pytest.raises(
        AttributeError, match=r"no channel 'belt_pwer' is observed; did .*belt_speed"
    ):
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
    scenarios = [straight(**{"world.friction": f}) for f in (0.5, 0.9)]
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


# By name, in a scenario

MODULE = """
import omnitrack_sim as ot

CELSIUS = ot.Sensor(
    ot.Channel("temperature", (3,), "K", "a motor's temperature"),
    lambda state: 293.0 + abs(state["motor_torque"]),
)
WARMTH = ot.Metric(
    "warmth_max_k",
    "K",
    "highest temperature",
    lambda run: run.trajectory["temperature"].max(axis=0),
    per_module=True,
)
COLD = ot.Metric("cold_k", "K", "lowest one", lambda run: run.trajectory["temperature"].min())
"""
NAMED = {"record.sensors": ["gauges:CELSIUS"], "record.metrics": ["gauges:WARMTH", "gauges:COLD"]}


@pytest.fixture
def gauges(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A module ``gauges`` in a folder outside the package, where Python finds it."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "gauges.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    yield importlib.import_module("gauges")
    del sys.modules["gauges"]


def test_what_a_scenario_names_is_there_in_its_run(gauges, tmp_path, capsys) -> None:
    """Sensors and metrics of ``[record]`` give the same as those that are handed over, and the
    table of ``run`` has the metrics."""
    named = ot.run(straight(**NAMED))
    handed_over = ot.run(straight(), sensors=[gauges.CELSIUS], metrics=[gauges.WARMTH, gauges.COLD])
    assert same_record(named, handed_over)
    assert named.metrics == handed_over.metrics
    assert named.scenario.record.sensors == ("gauges:CELSIUS",)
    print_result(named, tmp_path)
    rows = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines() if line}
    assert rows["warmth_max_k"][1:] == ["K", *(f"{v:.4g}" for v in named.metrics["warmth_max_k"])]
    assert rows["cold_k"][1:] == ["K", f"{named.metrics['cold_k']:.4g}"]
    assert named.metrics["cold_k"] == named.trajectory["temperature"].min()


@pytest.mark.parametrize(
    ("path", "name", "told"),
    [
        ("record.sensors", "gauges:WARMTH", "which is no Sensor"),
        ("record.metrics", "gauges:CELSIUS", "which is no Metric"),
        ("record.sensors", "gauges:KELVIN", "gauges:CELSIUS"),
        ("record.metrics", "nowhere:COLD", "'nowhere' cannot be imported"),
    ],
)
def test_a_bad_name_in_record_is_a_fault(gauges, path: str, name: str, told: str) -> None:
    """It is told by its place in the list, with what was looked for."""
    with pytest.raises(ot.ScenarioError) as caught:
        straight(**{path: [name]})
    (fault,) = caught.value.faults
    assert fault.where == f"{path}.0"
    assert told in str(fault)


def test_named_metrics_are_columns_of_sweeps(gauges) -> None:
    """The table of a sweep has the metrics that its base names, with units, at two workers as in
    one process."""
    axis = {"path": "world.friction", "kind": "list", "values": [0.5, 0.9]}
    short = {"run.time_limit": 0.2}
    sweep = resolve({"name": "s", "base": "straight", "set": short | NAMED, "axes": [axis]})
    table = ot.run_trials(sweep).table
    result = ot.run(sweep.scenario(1))
    assert table["cold_k"][1].as_py() == result.metrics["cold_k"]
    columns = [table[f"warmth_max_k_{i}"][1].as_py() for i in (1, 2, 3)]
    assert columns == result.metrics["warmth_max_k"]
    assert table.schema.field("cold_k").metadata == {b"unit": b"K"}
    assert ot.run_trials(sweep, workers=2).table.equals(table)


def test_a_run_is_read_where_its_sensors_are_unknown(
    gauges, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A saved run has all that its own sensors and metrics gave, without their module."""
    result = ot.run(straight(**NAMED))
    folder = result.save(tmp_path / "run")
    monkeypatch.setitem(sys.modules, "gauges", None)
    again = ot.load_result(folder)
    assert again.metrics == result.metrics
    assert again.trajectory.schema["temperature"].unit == "K"
    assert np.array_equal(again.trajectory["temperature"], result.trajectory["temperature"])
    with pytest.raises(InputError, match=r"record\.sensors\.0: .*'gauges' cannot be imported"):
        ot.run(again.scenario)


def test_a_sensor_may_add_up() -> None:
    """A sensor that adds to what it was a step before integrates: work is the sum over the control
    steps of power times the control period, though only every second step is recorded."""
    period = 0.01
    power = ot.Sensor(
        ot.Channel("power", (), "W", "of all belts"),
        lambda state: (
            (state["motor_torque"] * state["belt_speed"]).sum(axis=1) / state.robot.lug_radius
        ),
    )
    work = ot.Sensor(
        ot.Channel("work", (), "J", "of all belts"),
        lambda state: state.last("work", np.zeros(len(state.time))) + period * state["power"],
    )
    base = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.5})
    fine = ot.override(base, {"record.period": period})
    every = ot.run(fine, sensors=[power, work]).trajectory
    np.testing.assert_allclose(every["work"], period * np.cumsum(every["power"]), rtol=1e-12)
    coarse = ot.run(base, sensors=[power, work]).trajectory
    np.testing.assert_array_equal(coarse["work"], every["work"][::2])


@pytest.mark.parametrize("name", ["pitch", "battery"])
def test_a_channel_that_is_there_already_is_refused(name: str) -> None:
    """A sensor with a shipped name, or with the name of another own one, is an input error."""
    sensor = ot.Sensor(ot.Channel(name, (), "1", "a gauge"), lambda state: state.time)
    base = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.05})
    with pytest.raises(InputError, match=f"'{name}' is taken"):
        ot.Simulation([base], sensors=[sensor, sensor])


def test_a_metric_that_is_there_already_is_refused() -> None:
    """A metric with a shipped name is an input error."""
    metric = ot.Metric("energy_j", "J", "another energy", lambda run: 0.0)
    base = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.05})
    with pytest.raises(InputError, match="'energy_j' is taken"):
        ot.run(base, metrics=[metric])


def test_a_list_without_per_module_is_refused() -> None:
    """A metric says whether it gives one number or one a module."""
    metric = ot.Metric("three", "1", "a list", lambda run: [1.0, 2.0, 3.0])
    base = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.05})
    with pytest.raises(ValueError, match="per_module is False"):
        ot.run(base, metrics=[metric])


@pytest.mark.parametrize(("shape", "how"), [((), "swapped"), ((3,), "flip"), ((3,), "facing")])
def test_mirroring_fits_the_shape(shape: tuple[int, ...], how: str) -> None:
    """A channel is refused where its way of mirroring is unknown or does not fit its shape."""
    with pytest.raises(ValueError, match="tail_first"):
        ot.Channel("gauge", shape, "1", "", tail_first=how)  # type: ignore[arg-type]
