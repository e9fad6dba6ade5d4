"""The run fitting by fitting, on made-up records whose figures are known."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from samples import (
    PHASES,
    drive,
    legs_trajectory,
    sample_result,
    two_legs,
    two_legs_result,
)

import omnitrack_sim as ot
from omnitrack_sim.cli.runs import print_result
from omnitrack_sim.pipes import Elbow, Route, Step, Straight, route
from omnitrack_sim.record.metrics import summarise
from omnitrack_sim.record.timeline import PassageRecord, passage_indices, timeline
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import load_result
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.scenario import validate

WAY = np.arange(0.1, 1.2, 0.002)


@pytest.fixture(scope="module")
def bend() -> Route:
    """A straight of 0.5 m, an elbow of 0.377 m, a straight of 0.5 m."""
    steps = [Step("a", Straight(0.5), "start", "end"), Step("b", Elbow(0.24), "start", "end")]
    return route([*steps, Step("c", Straight(0.5), "start", "end")])


def record(
    way: Route, distance: np.ndarray = WAY, phases: tuple[str, ...] = PHASES, **changes
) -> Trajectory:
    channels = drive(way, distance) | changes
    qpos = np.zeros((len(distance), 22))
    return Trajectory(0.02 * np.arange(len(distance)), channels, phases, qpos, RECORDED)


def visits(trajectory: Trajectory, *ways: Route) -> list[PassageRecord]:
    return timeline(trajectory, ways, Omnitrack().touch(trajectory))


def test_one_row_for_each_fitting(bend):
    """Entry and exit are the first samples past the port planes; the last fitting is not left."""
    rows = visits(record(bend), bend)
    assert [row.name for row in rows] == ["a", "b", "c"]
    assert [row.manoeuvre for row in rows] == ["straight", "elbow", "straight"]
    assert [row.time_enter_s for row in rows] == pytest.approx(
        [0.0, 4.0, 7.78]
    )  # 0.4 m and 0.777 m at 0.1 m/s
    assert [row.time_leave_s for row in rows[:2]] == pytest.approx([4.0, 7.78])
    assert rows[2].time_leave_s is None
    assert [(row.leg, row.gear, row.enter, row.leave) for row in rows] == [
        (0, 1, "start", "end")
    ] * 3


def test_durations_energy_and_slip_add_up_to_the_run(bend):
    """No interval is counted twice or lost, whatever the robot does in it."""
    wave = np.sin(WAY / 0.03)[:, None] * [1.0, 0.5, -2.0]
    trajectory = record(bend, motor_torque=wave, slip_velocity=0.01 * wave)
    rows = visits(trajectory, bend)
    robot = Omnitrack()
    whole = summarise(robot.run_record(trajectory, 0.0, 0.0), robot.metrics)
    assert sum(row.duration_s for row in rows) == pytest.approx(trajectory.time[-1])
    assert sum(row.energy_j for row in rows) == pytest.approx(whole["energy_j"])
    assert sum(row.slip_distance_m for row in rows) == pytest.approx(
        np.mean(whole["slip_distance_m"])
    )


def test_means_are_of_the_modules_and_the_time_in_contact(bend):
    """A module in the air does not count for slip; without any contact there is no slip ratio."""
    count = np.zeros((len(WAY), 3, 2))
    count[:250, 0, 1] = 2
    slip = np.tile([-0.3, 0.9, 0.9], (len(WAY), 1))
    force = np.tile([30.0, 0.0, 15.0], (len(WAY), 1))
    first, _, last = visits(
        record(bend, contact_count=count, slip_ratio=slip, normal_force=force), bend
    )
    assert first.slip_ratio_mean == pytest.approx(0.3)
    assert last.slip_ratio_mean is None
    assert first.normal_force_mean_n == pytest.approx(15.0)
    assert first.normal_force_min_n == pytest.approx(0.0)


def test_least_force_is_of_a_tenth_of_a_second(bend):
    """A lug that lifts for one sample is no lost contact; a module that hangs for 0.3 s is."""
    force = np.full((len(WAY), 3), 20.0)
    force[100, 1], force[300:315, 2] = 0.0, 0.0
    once, hanging, never = visits(record(bend, normal_force=force), bend)
    assert once.normal_force_min_n == pytest.approx(16.0)  # 20 ms of 100 ms
    assert hanging.normal_force_min_n == pytest.approx(0.0, abs=1e-9)
    assert never.normal_force_min_n == pytest.approx(20.0)


def test_tilt_and_theta5_are_in_degrees(bend):
    """Largest tilt within the fitting, tilt of the last sample in it, theta5 of the first."""
    tilt, theta5 = np.zeros(len(WAY)), np.full(len(WAY), 0.5)
    tilt[250], tilt[388], theta5[200] = 0.2, 0.1, -1.0
    _, elbow, last = visits(record(bend, tilt=tilt, theta5=theta5), bend)
    assert (elbow.tilt_max_deg, elbow.tilt_leave_deg) == pytest.approx(
        tuple(np.degrees([0.2, 0.1]))
    )
    assert elbow.theta5_enter_deg == pytest.approx(np.degrees(-1.0))
    assert last.tilt_max_deg == 0.0


def test_a_retry_does_not_split_a_visit(bend):
    """Backed out of the elbow and in again: one row, from first entry to last exit, less the time
    outside."""
    there = np.concatenate(
        [np.arange(0.1, 0.6, 0.002), np.arange(0.6, 0.4, -0.002), np.arange(0.4, 1.2, 0.002)]
    )
    phase = np.zeros(len(there))
    phase[250:350] = 2
    first, elbow, _ = visits(record(bend, there, phase=phase), bend)
    assert (first.name, elbow.name) == ("a", "b")
    assert elbow.time_enter_s == pytest.approx(4.0)
    assert elbow.time_leave_s == pytest.approx(4.0 + 2 * 2.0 + 3.78, abs=0.05)
    assert elbow.duration_s == pytest.approx(elbow.time_leave_s - 4.0 - 2.0, abs=0.05)
    assert (first.retries, elbow.retries) == (0, 1)


def test_a_roll_counts_for_the_fitting_ahead(bend):
    """Rolls begun before the elbow are the elbow's; after the last bend they count where the robot
    stands."""
    phase = np.zeros(len(WAY))
    phase[150:160] = phase[170:175] = phase[450:460] = 1
    assert [row.rolls for row in visits(record(bend, phase=phase), bend)] == [0, 2, 1]


def test_a_roll_for_a_fitting_that_was_never_reached_counts_where_it_was(bend):
    """A run that ends before the elbow keeps its roll."""
    phase = np.zeros(100)
    phase[50:60] = 1
    (only,) = visits(record(bend, WAY[:100], phase=phase), bend)
    assert (only.name, only.rolls) == ("a", 1)


def test_controllers_without_these_phases_have_none(bend):
    """Phase codes mean what the trajectory's names say."""
    rows = visits(
        record(bend, phases=("cruise", "elbow", "coast"), phase=np.arange(len(WAY)) % 3), bend
    )
    assert [(row.rolls, row.retries) for row in rows] == [(0, 0)] * 3


def test_every_leg_has_its_own_rows():
    """Into an arm and back out of it: tail first, with the ports the other way round, and nothing
    mixed up."""
    rows = two_legs_result().timeline()
    names = ["riser", "tee_1", "shelf", "elbow_side", "link", "tee_3", "side_arm"]
    assert [row.name for row in rows] == [
        *names,
        "side_arm",
        "tee_3",
        "drop",
        "elbow_low",
        "low_arm",
    ]
    assert [row.leg for row in rows] == [0] * 7 + [1] * 5
    assert [row.gear for row in rows] == [1] * 7 + [-1] * 5
    assert (rows[5].manoeuvre, rows[8].manoeuvre) == ("over the run", "run to branch")
    assert (rows[6].enter, rows[6].leave, rows[7].enter, rows[7].leave) == (
        "start",
        "end",
        "end",
        "start",
    )
    assert rows[6].time_leave_s == rows[7].time_enter_s
    assert [row.name for row in rows if row.rolls] == ["tee_1"]
    assert [row.name for row in rows if row.retries] == ["elbow_side"]


def test_a_leg_that_was_not_begun_has_no_rows():
    """A mission that ends on its first leg tells of that leg alone."""
    routes = two_legs()
    trajectory = legs_trajectory((routes[0],), [np.arange(0.1, 0.4, 0.002)], [1])
    assert [row.name for row in timeline(trajectory, routes, Omnitrack().touch(trajectory))] == [
        "riser"
    ]


def test_broken_and_short_records_have_rows(bend):
    """One sample, and a record that ends in what is not a number, are told as they are."""
    (only,) = visits(record(bend, WAY[:1]), bend)
    assert (only.duration_s, only.energy_j, only.time_leave_s) == (0.0, 0.0, None)
    assert only.normal_force_mean_n == pytest.approx(25.0)
    broken = WAY.copy()
    broken[-3:] = np.nan
    assert passage_indices(record(bend, distance=broken), [bend])[-1] == 2
    broken[210:] = np.nan
    assert [row.name for row in visits(record(bend, distance=broken), bend)] == ["a", "b"]


@pytest.mark.parametrize(("robot", "has_slip"), [("omnitrack", True), ("presser", False)])
def test_slip_is_printed_where_it_is_measured(robot, has_slip, capsys, tmp_path):
    """The printed timeline of a wheeled robot has neither a column nor a legend of slip ratios."""
    straight, elbow = {"kind": "straight", "length": 0.5}, {"kind": "elbow", "mean_radius": 0.24}
    table = {"name": "bends", "robot": {"kind": robot}, "run": {"time_limit": 0.1}}
    scenario = validate({**table, "pipes": [straight, elbow, straight, elbow, straight]})
    print_result(ot.run(scenario, no_load=False), tmp_path)
    printed = capsys.readouterr().out
    assert "force: least normal force" in printed
    assert (" slip " in printed.partition("tilt: largest")[0]) is has_slip
    assert ("slip: mean ratio" in printed) is has_slip


def test_table_reads_back_exactly(tmp_path):
    """timeline.csv has the fields as columns and every number to the last bit; what there is not,
    is empty."""
    result = sample_result()
    folder = result.save(tmp_path / "run")
    with (folder / "timeline.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result.timeline()) == 1
    for field in dataclasses.fields(PassageRecord):
        value, written = getattr(result.timeline()[0], field.name), rows[0][field.name]
        assert written == ("" if value is None else str(value))
        if isinstance(value, float):
            assert float(written) == value
    assert load_result(folder).timeline() == result.timeline()
