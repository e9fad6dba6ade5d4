"""What pictures and pages are told of a run: its way, its gears, its parts and its events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import sample_result, sample_trajectory, two_legs, two_legs_result

from omnitrack_sim.record.events import Note, Remark
from omnitrack_sim.show.playback import POINTS_APART
from omnitrack_sim.show.run_playback import RunPlayback


@pytest.fixture(scope="module")
def run():
    """Two legs, the second tail first, with a retry on the first one."""
    return two_legs_result()


@pytest.fixture(scope="module")
def playback(run):
    return RunPlayback(run)


def test_travel_is_the_way_along_the_legs(playback):
    """To and fro counts; the jump from one route to the next does not."""
    there, back = (route.centreline.length for route in two_legs())
    # The first leg begins 0.1 m from its begin, ends as far from its end, and goes back by 0.2 m.
    ways = [there - 0.2 + 2 * 0.2, back - 0.2]
    assert playback.travel[0] == 0.0
    assert (np.diff(playback.travel) > 0).all()
    assert playback.travel[-1] == pytest.approx(sum(ways), abs=0.02)


def test_the_path_is_drawn_through_points_of_equal_travel(playback):
    """A centimetre apart, from the first sample on, and at the begin of each leg."""
    leg, path = playback.trajectory["leg"], playback.path
    begins = np.flatnonzero(np.diff(leg, prepend=-1))
    assert set(begins) <= set(path)
    apart = np.diff(playback.travel[path])[np.diff(leg[path]) == 0]
    assert np.median(apart) == pytest.approx(POINTS_APART, rel=1e-3)
    assert apart.max() < POINTS_APART + 0.0021


def test_tracks_travel_by_the_integral_of_their_speeds(run):
    """Whatever the speeds: one that grows evenly gives a parabola, to the last sample."""
    record = run.trajectory
    name = run.scenario.robot.display.track_speed
    speed = np.outer(record.time, [0.1, -0.2, 0.3])
    changed = replace(run, trajectory=replace(record, channels=record.channels | {name: speed}))
    travel = RunPlayback(changed).track_travel
    squares = (record.time**2 - record.time[0] ** 2) / 2
    assert travel == pytest.approx(np.outer(squares, [0.1, -0.2, 0.3]))


def test_all_of_a_robot_but_its_springs_throws_a_shadow(playback):
    """Light between their coils would be a row of dots."""
    names = {geom: playback.model.geom(geom).name for geom in playback.visible_geoms}
    springs = {geom for geom, name in names.items() if "spring" in name}
    assert springs
    assert set(playback.casting) == set(names) - springs


def test_the_robot_points_along_its_way_in_its_gear(playback, run):
    """Its nose goes ahead on the first leg and behind on the second."""
    leg = playback.trajectory["leg"].astype(int)
    np.testing.assert_array_equal(playback.backward, leg == 1)
    routes = run.routes()
    for number, gear in ((0, 1), (1, -1)):
        rows = np.flatnonzero(leg == number)[::50]
        s = playback.trajectory["distance"][rows]
        tangent = routes[number].centreline.frame(s)[:, :, 2]
        along = (playback.ahead[rows] * tangent).sum(axis=1)
        assert along == pytest.approx(np.full(len(rows), gear), abs=1e-9)
    assert playback.leg is playback.trajectory["leg"]
    assert RunPlayback(sample_result()).leg is None


def test_a_moment_names_time_phase_and_part(playback):
    """The part is that of the passage in which the sample is."""
    for row in (0, 150, 650, len(playback.time) - 1):
        moment = playback.moment(row)
        assert moment.time == playback.time[row]
        assert moment.phase == playback.trajectory.phases[int(playback.trajectory["phase"][row])]
        (inside,) = [p for p in playback.passages if p.first <= row <= p.last][-1:]
        assert moment.part == inside.part.name
        assert moment.value("distance") == playback.trajectory["distance"][row]
    assert {playback.moment(row).phase for row in (150, 650)} == {"align", "back_off"}


def test_events_are_told_in_their_order_and_notes_apart():
    """Those without a time are left out."""
    told = [Remark(0, 3.0, "late"), Note(0, 0.0, "set up"), Remark(0, 1.0, "early")]
    shown = RunPlayback(sample_result(events=[*told, Remark(0, np.nan, "never")]))
    assert shown.events == [(1.0, "early"), (3.0, "late")]
    assert shown.notes == ["set up"]


def test_where_a_robot_takes_itself_to_be_is_where_it_is_without_an_estimate():
    """With one it is that."""
    record = sample_trajectory()
    assert RunPlayback(sample_result(record)).estimate is record["position"]
    own = record["position"] + [0.0, 0.01, 0.0]
    guessed = replace(
        record,
        channels=record.channels | {"position_estimate": own},
        schema=record.schema | {"position_estimate": record.schema["position"]},
    )
    np.testing.assert_array_equal(RunPlayback(sample_result(guessed)).estimate, own)


def test_a_sample_that_has_diverged_is_shown_as_the_last_sound_one():
    """In all channels that are drawn, and in no other; a sound record is not copied."""
    record = sample_trajectory()
    assert RunPlayback(sample_result(record)).trajectory is record
    position = record["position"].copy()
    position[-3:] = np.inf
    shown = RunPlayback(
        sample_result(replace(record, channels=record.channels | {"position": position}))
    ).trajectory
    np.testing.assert_array_equal(shown["position"][:-3], record["position"][:-3])
    np.testing.assert_array_equal(shown["position"][-3:], [record["position"][-4]] * 3)
    np.testing.assert_array_equal(shown["distance"][-3:], [record["distance"][-4]] * 3)
    np.testing.assert_array_equal(shown.time, record.time)
