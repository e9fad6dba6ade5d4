"""Modular Pipe Climber III: what it has from its sister, and what the differential makes of it."""

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots.climber import Climber


def test_what_it_has_from_its_sister_is_assumed():
    """A place in the sister's paper is no source for this robot; what is numerical stays so."""
    rows = {row.name: row for row in Climber().parameters()}
    sister = {row.name: row for row in ot.Omnitrack().parameters()}
    assert rows["drive"].provenance == "published"
    assert rows["spring_stiffness"].provenance == "assumed"
    assert sister["spring_stiffness"].provenance == "published"
    assert rows["contact_time"] == sister["contact_time"]
    assert [n for n, r in rows.items() if r.provenance == "published" and "." not in n] == ["drive"]


def test_it_is_a_kind_of_its_own_in_files():
    """It reads back as itself, takes its own controller, and does not understand rolls."""
    scenario = ot.load_scenario("robots/climber_elbow")
    assert scenario.model_dump(mode="json")["robot"]["kind"] == "climber"
    assert scenario.control.kind == "steady"
    with pytest.raises(ot.ScenarioError, match=r"start\.roll_deg"):
        ot.override(scenario, {"start.roll_deg": 20.0})


def test_the_tracks_share_speed_and_force_and_never_roll():
    """In a bend the tracks' speeds add up to three times the motor's, their forces are equal within
    1 %, and the modules stay upright."""
    changes = {"start.distance": 0.45, "run.time_limit": 2.0, "run.expected_outcome": "timed_out"}
    run = ot.run(ot.load_scenario("robots/climber_elbow", changes)).trajectory
    later = run.time > 1.0
    speed, torque = run["belt_speed"][later], run["motor_torque"][later]
    assert np.ptp(speed, axis=1).max() > 0.03
    assert speed.mean() == pytest.approx(0.1, rel=0.01)
    assert np.ptp(torque, axis=1).max() < 0.01 * np.abs(torque).max()
    assert np.degrees(np.abs(run["roll"])).max() < 3
