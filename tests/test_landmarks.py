"""Pictures of robots that explore: true pipes, whatever the map that they make."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from film_samples import SIZE
from network_samples import elbow, joint, straight, tee
from pages import needs_browser, opened
from samples import legs_trajectory, sample_result

from omnitrack_sim import Network, plot_mission, render_replay
from omnitrack_sim.pipes import route_through
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.film.overlay import MapPanel
from omnitrack_sim.show.film.render import render_frames
from omnitrack_sim.show.film.shots import FollowCamera
from omnitrack_sim.show.film.strip import strip_times
from omnitrack_sim.show.landmarks import Landmarks, passage_spans
from omnitrack_sim.show.replay.document import replay_data
from omnitrack_sim.show.run_playback import RunPlayback

TRUE = {
    "fittings": [
        straight("on", 0.9),
        straight("foot", 0.4),
        straight("shaft", 0.3),
        tee("fork"),
        straight("off", 0.4),
        elbow("bend", mean_radius=0.24),
        straight("low", 0.5),
    ],
    "joints": [
        joint("foot.end", "shaft.start"),
        joint("shaft.end", "fork.run_start"),
        joint("fork.run_end", "on.start"),
        joint("fork.branch", "off.start"),
        joint("off.end", "bend.start"),
        joint("bend.end", "low.start"),
    ],
}
"""A tee with a bend in its branch, and a plate at the end of its run."""
FOOT, SHAFT, FORK, OFF, BEND, LOW, ON = 1, 2, 3, 4, 5, 6, 0
FOOT_IN, SHAFT_IN, OFF_IN, BEND_IN, LOW_IN, ON_IN = (
    (part, "start", "end") for part in (FOOT, SHAFT, OFF, BEND, LOW, ON)
)
INTO = (FOOT_IN, SHAFT_IN, (FORK, "run_start", "branch"), OFF_IN, BEND_IN, LOW_IN)
BACK = tuple((part, leave, enter) for part, enter, leave in INTO[::-1])
OVER = (FOOT_IN, SHAFT_IN, (FORK, "run_start", "run_end"), ON_IN)


def whole() -> tuple[Network, tuple]:
    """A map of all of it, with both straights of the foot as one, in the order of sightings."""
    network = Network(
        fittings=[
            straight("straight_1", 0.7),
            tee("tee_1"),
            straight("straight_2", 0.4),
            elbow("elbow_1", mean_radius=0.24),
            straight("straight_3", 0.5),
            straight("straight_4", 0.9),
        ],
        joints=[
            joint("straight_1.end", "tee_1.run_start"),
            joint("tee_1.branch", "straight_2.start"),
            joint("straight_2.end", "elbow_1.start"),
            joint("elbow_1.end", "straight_3.start"),
            joint("tee_1.run_end", "straight_4.start"),
        ],
    )
    start = (0, "start", "end")
    into = (start, (1, "run_start", "branch"), *((i, "start", "end") for i in (2, 3, 4)))
    back = tuple((part, leave, enter) for part, enter, leave in into[::-1])
    return network, (into, back, (start, (1, "run_start", "run_end"), (5, "start", "end")))


def wrong() -> tuple[Network, tuple]:
    """A map with one part, a pipe that is too long."""
    ahead, back = ((0, "start", "end"),), ((0, "end", "start"),)
    return Network(fittings=[straight("straight_1", 3.0)]), (ahead, back, ahead)


def explored(mapped, **mission) -> Result:
    """Into the branch and its bend, back out tail first, and on to the plate, with a map."""
    network, paths = mapped
    table = {"start": "foot.start", "map": "unknown", "task": "explore", "blocked": ["on.end"]}
    scenario = validate({"name": "fork", "network": TRUE, "mission": table | mission})
    pipes = scenario.route.network
    into, back, over = (route_through(pipes, path) for path in (INTO, BACK, OVER))
    to = into.centreline.length - 0.07
    ends = [(0.1, to), (back.centreline.length - to, to), (0.5, over.centreline.length - 0.08)]
    trajectory = legs_trajectory(
        (into, back, over), [np.arange(*end, 0.004) for end in ends], [1, -1, 1]
    )
    legs = tuple(Leg(path, 1, 0.1, 1.0, 0, "") for path in paths)
    return sample_result(trajectory, scenario=scenario, map=network, legs=legs)


@pytest.fixture(scope="module")
def runs() -> list[Result]:
    """The same record with two maps."""
    return [explored(whole()), explored(wrong())]


def test_pictures_do_not_depend_on_the_map_that_a_robot_makes(runs):
    """With a map that has other parts in another order, and with a wrong one, the same record gives
    the same frames, strip and page."""
    good, bad = runs
    times = np.linspace(0, good.trajectory.time[-1], 3).tolist()
    size = {"width": SIZE[0], "height": SIZE[1]}
    for camera in ("follow", "onboard", "side"):
        frames = [render_frames(run, times=times, camera=camera, **size) for run in runs]
        assert np.array_equal(*frames), camera
    assert strip_times(good) == strip_times(bad)
    pages = [replay_data(RunPlayback(run, coarse=False)) for run in runs]
    for table in ("pipes", "map", "follow", "data"):
        assert pages[0][table] == pages[1][table], table
    assert pages[0]["runs"][0]["fittings"] == pages[1]["runs"][0]["fittings"]


def test_the_robot_is_in_a_pipe_that_is_seen(runs):
    """At every sample the part around the robot is in the picture in full, and on the map."""
    run = runs[0]
    record, parts, playback = run.trajectory, run.pipes.parts, RunPlayback(run)
    data = mujoco.MjData(playback.model)
    camera = FollowCamera(playback, 16 / 9, 0.12)
    landmarks = Landmarks.of(run, record)
    for span in passage_spans(run, record):
        for row in range(span.first, span.last):
            centre = record["position"][row]
            assert span.part.signed_distance(centre)[0] > 0
            assert span.part.extent(centre) > -1e-9
            number = parts.index(span.part)
            playback.place(data, row)
            assert camera.shot(row, data).clearness[number] == 1
            assert landmarks.parts[number] <= row


def test_parts_are_called_by_their_true_names(runs):
    """In passages, on the page and in the figure, with the words of how they are passed."""
    names = ["foot", "shaft", "fork", "off", "bend", "low"]
    for run in runs:
        passages = passage_spans(run, run.trajectory)
        assert [v.part.name for v in passages] == [*names, *names[::-1], "shaft", "fork", "on"]
        words = [v.words for v in passages if v.part.name == "fork"]
        assert words == ["run to branch", "branch to run", "over the run"]
        fittings = replay_data(RunPlayback(run, coarse=False))["runs"][0]["fittings"]
        assert [row["name"] for row in fittings] == [v.part.name for v in passages]
        figure = plot_mission(run)
        texts = {text.get_text() for axis in figure.axes for text in axis.texts}
        assert texts >= {"foot", "shaft", "fork", "on"}
        assert not {text for text in texts if text[-2:] in ("_1", "_2", "_3", "_4")}


def test_the_map_grows_with_what_the_robot_sees(runs):
    """A fitting comes with the pipe before it, what is beyond its port when the robot stands there,
    and the plate when it is in sight; nothing before."""
    run = runs[0]
    record, names = run.trajectory, [part.name for part in run.pipes.parts]
    first = dict(zip(names, Landmarks.of(run, record).parts.tolist(), strict=True))
    begin = {v.part.name: v.first for v in reversed(passage_spans(run, record))}
    assert first["foot"] == first["shaft"] == first["fork"] == 0
    order = [first[name] for name in ("fork", "off", "bend", "low", "on")]
    assert order == sorted(order)
    assert begin["fork"] < first["off"] == first["bend"] < begin["off"] < begin["bend"]
    assert begin["bend"] < first["low"] < begin["low"]
    assert record["leg"][first["on"]] == 2
    (plate,) = Landmarks.of(run, record).plates
    assert first["on"] <= plate < begin["on"]
    assert Landmarks.of(explored(whole(), blocked=[]), record).plates.size == 0


def test_goals_to_be_found_come_onto_the_map_when_they_are_seen():
    """A goal that nobody has been to is not on it, and a render of such a run has all frames."""
    run = explored(wrong(), task="find", goals=["low.end"], blocked=["on.end"])
    record = run.trajectory
    (goal,) = Landmarks.of(run, record).goals
    assert record["leg"][goal] == 0
    assert goal > passage_spans(run, record)[4].first  # the bend
    before = slice(0, goal - 20)
    channels = {name: values[before] for name, values in record.channels.items()}
    early = replace(record, time=record.time[before], channels=channels, qpos=record.qpos[before])
    assert Landmarks.of(run, early).goals[0] == len(early.time)  # never
    frames = render_frames(run, times=[0.0, 5.0, 10.0], camera="follow", width=64, height=36)
    assert len(frames) == 3


def test_a_robot_with_a_map_meets_its_plates():
    """It has all parts and goals on the map from the first, and a plate once its tip is there."""
    table = {"start": "foot.start", "goals": ["on.end"], "blocked": ["on.end"]}
    scenario = validate({"name": "fork", "network": TRUE, "mission": table})
    route = route_through(scenario.route.network, OVER)
    end = route.centreline.length
    record = legs_trajectory((route,), [np.arange(0.1, end - 0.08, 0.004)], [1])
    run = sample_result(record, scenario=scenario, legs=(Leg(OVER, 1, 0.1, end, 0, ""),))
    landmarks = Landmarks.of(run, record)
    assert not landmarks.parts.any()
    assert not landmarks.goals.any()
    tip = end - record["distance"][landmarks.plates[0]] - scenario.robot.length / 2
    assert 0.04 < tip <= 0.08


def test_a_plate_is_in_every_picture(runs):
    """Of the camera that stands still from the first frame on, and of the other ones where the
    robot has come to it: right before the nose it fills the picture."""
    end = float(runs[0].trajectory.time[-1])
    for camera, time, least in (("side", 0.0, 20), ("follow", end, 500), ("onboard", end, 20_000)):
        look = {"camera": camera, "width": 640, "height": 360, "overlay": False}
        (frame,) = render_frames(runs[0], times=[time], inset=False, **look)
        red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
        assert ((red > 60) & (red > 2 * green) & (red > 2 * blue)).sum() > least, camera


def test_film_and_page_show_the_same_map(runs):
    """At any time both have the same parts, plates and goals, more and more of them."""
    run = runs[0]
    record, page = run.trajectory, replay_data(RunPlayback(run, coarse=False))["map"]
    panel = MapPanel(RunPlayback(run), Landmarks.of(run, record), (1280, 720))
    grey = np.full((720, 1280, 3), 90, np.uint8)
    drawn = []
    for row in (0, 300, 500, len(record.time) - 1):
        landmarks = panel.landmarks
        parts = {i for i, first in enumerate(landmarks.parts) if first <= row}
        pieces = [piece for piece in page["pieces"] if piece["from"] <= row]
        view = panel.view.segments(run.pipes.parts)
        assert len(pieces) == sum(number in parts for number, _ in view)
        assert sum(p["from"] <= row for p in page["plates"]) == (landmarks.plates <= row).sum()
        frame = grey.copy()
        panel.write(frame, row)
        drawn.append(int((np.abs(frame.astype(int) - [120, 131, 144]).sum(axis=-1) < 20).sum()))
    assert drawn == sorted(drawn)
    assert drawn[0] < 0.6 * drawn[-1]


@pytest.mark.long
@needs_browser
def test_the_map_of_the_page_is_painted_anew_as_it_grows(browser, runs, tmp_path):
    """Forward and back again, with the pieces of that time."""
    record = runs[0].trajectory
    render_replay(runs[0], path=tmp_path / "page.html")
    code = "time => { replay.seek(time); replay.draw(); return replay.chart.picture.toDataURL(); }"
    times = [float(record.time[row]) for row in (0, 300, len(record.time) - 1)]
    with opened(browser, tmp_path / "page.html") as page:
        seen = [page.evaluate(code, time) for time in (*times, *times[::-1])]
    assert seen[:3] == seen[:2:-1]
    assert len(set(seen)) == 3
