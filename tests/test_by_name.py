"""What is asked for by name, and what things say of themselves in a line."""

from __future__ import annotations

import builtins

import numpy as np
import pyarrow.parquet as pq
import pytest
from samples import sample_result, sample_trajectory

import omnitrack_sim as ot
from omnitrack_sim.pipes.network import load_network


@pytest.mark.parametrize(
    ("things", "name", "near", "another"),
    [
        (sample_trajectory(), "positon", "position", "motor_torque"),
        (sample_result().metrics, "energy", "energy_j", "distance_m"),
        (ot.MOTORS, "simulaton", "simulation", "pololu_1000_hpcb"),
        (ot.shipped_files("scenarios"), "tee_trun", "tee_turn", "missions/fig14"),
        (ot.shipped_files("networks"), "figure14", "fig14", "tower"),
        (ot.shipped_files("sweeps"), "tee_lug", "tee_lugs", "fig14_pairs"),
    ],
    ids=["trajectory", "metrics", "motors", "scenarios", "networks", "sweeps"],
)
def test_a_name_that_is_not_there_lists_those_that_are(things, name, near, another):
    """The KeyError asks the nearest name back and lists all."""
    with pytest.raises(KeyError) as caught:
        things[name]
    assert f"did you mean {near!r}?" in str(caught.value.args[0])
    assert another in str(caught.value.args[0])


def test_names_that_are_no_text_are_refused_too():
    """A number in place of a name gives the same message."""
    with pytest.raises(KeyError, match="there is no channel 0"):
        sample_trajectory()[0]  # type: ignore[index]


def test_loaded_metrics_list_their_names(tmp_path):
    """Metrics read back from a folder say what there is as well."""
    loaded = ot.load_result(sample_result().save(tmp_path / "run"))
    with pytest.raises(KeyError, match="energy_j"):
        loaded.metrics["energie_j"]


def test_an_unknown_channel_of_an_observation_is_asked_back():
    """An attribute that no sensor reads names the nearest one."""
    simulation = ot.Simulation([ot.load_scenario("straight")])
    with pytest.raises(AttributeError, match="did you mean 'belt_speed'"):
        _ = simulation.observation.belt_sped


def test_what_is_printed_of_a_thing_is_a_line_or_two():
    """No table or array is dumped, and each tells what it is about."""
    mission, tee = ot.load_scenario("missions/narrow"), ot.load_scenario("tee_turn")
    simulation = ot.Simulation([tee] * 3)
    for thing, *words in (
        (mission, "narrow", "Network"),
        (tee, "tee_turn", "3 pipes", "jacobian"),
        (sample_result(), "sample", "reached_goal", "201 samples"),
        (sample_trajectory(), "201 samples", "4 s"),
        (simulation, "3 of 3 robots", "tee_turn"),
        (simulation.observation, "3 robots"),
        (simulation.observation.location, "3 robots"),
        (ot.Command(np.zeros((3, 3))), "3 robots", "belt_speed"),
        (load_network("fig14"), "fig14", "fittings"),
        (tee.route, "3 passages"),
        (tee.route.network, "3 parts"),
        (tee.route.network.parts[0], "Straight"),
        (ot.load_sweep("tee_lugs"), "tee_lugs", "robot.lugs_per_track"),
        (ot.Omnitrack(scale=0.5, preload=20.0), "scale=0.5", "preload=2.5"),
    ):
        for text in (repr(thing), str(thing)):
            assert all(word in text for word in words), text
            assert len(text) < 200, text
            assert "\n" not in text


def test_a_trajectory_as_a_table_of_pandas(tmp_path):
    """Columns, types and values are those of trajectory.parquet; units and phases stand in
    attrs."""
    result = sample_result()
    frame = result.trajectory.to_pandas()
    table = pq.read_table(result.save(tmp_path / "run") / "trajectory.parquet")
    assert list(frame.columns) == table.column_names
    for field in table.schema:
        np.testing.assert_array_equal(frame[field.name], table[field.name].to_numpy())
        assert frame[field.name].dtype == field.type.to_pandas_dtype()
        assert frame.attrs["units"][field.name] == field.metadata[b"unit"].decode()
    assert frame["phase"].dtype == np.int32
    assert frame.attrs["phases"] == ["straight", "turn", "leave"]


def test_without_pandas_the_error_says_how_to_install_it(monkeypatch):
    """pandas is no dependency."""
    found = builtins.__import__

    def without_pandas(name, *rest):
        if name == "pandas":
            raise ImportError(name)
        return found(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without_pandas)
    with pytest.raises(ImportError, match="pip install pandas"):
        sample_trajectory().to_pandas()
