"""Robots that explore by their own cameras."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from network_samples import elbow, joint, straight, tee

import omnitrack_sim as ot
from omnitrack_sim.autonomy import camera_sight
from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.camera_sight import (
    CameraSight,
    behind_lens,
    by_depth,
    by_lamp,
    sighting_of,
)
from omnitrack_sim.autonomy.looks import LOOKS, common_std
from omnitrack_sim.autonomy.loop_closure import close_loop
from omnitrack_sim.autonomy.recognition import Detection
from omnitrack_sim.autonomy.sight import Sighting
from omnitrack_sim.base.rotations import Pose, rotation_about
from omnitrack_sim.cli.runs import print_result
from omnitrack_sim.pipes import (
    ARCS,
    Elbow,
    Part,
    Passage,
    Reducer,
    Straight,
    Tee,
    Wye,
    route_through,
)
from omnitrack_sim.record.events import EndInspected, ExplorationComplete
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.sim.onboard import Onboard


def bend(**sensing) -> Scenario:
    """A pipe with one bend, which the robot does not know."""
    network = {
        "fittings": [straight("foot", 0.4), elbow("bend", mean_radius=0.16), straight("on", 0.3)],
        "joints": [joint("foot.end", "bend.start"), joint("bend.end", "on.start")],
    }
    return validate(
        {
            "name": "bend",
            "network": network,
            "mission": {"start": "foot.start", "map": "unknown", "task": "explore"},
            "sensing": {"kind": "onboard", **sensing},
        }
    )


@pytest.fixture(scope="module")
def explored():
    """A network with an elbow directly on a tee's branch, explored."""
    network = {
        "fittings": [
            straight("inlet", 0.3),
            tee("tee"),
            straight("run", 0.3),
            elbow("knee", mean_radius=0.12),
            straight("arm", 0.3),
        ],
        "joints": [
            joint("inlet.end", "tee.run_start"),
            joint("tee.run_end", "run.start"),
            joint("tee.branch", "knee.start", 90.0),
            joint("knee.end", "arm.start"),
        ],
    }
    mission = {"start": "inlet.start", "map": "unknown", "task": "explore"}
    scenario = validate({"network": network, "mission": mission, "sensing": {"kind": "onboard"}})
    return ot.run(scenario, no_load=False)


def test_a_robot_explores_by_its_camera_and_comes_back(explored):
    """The map is complete, though the robot is told nothing but by its sensors. The elbow hangs on
    the tee itself, from within which it is seen: a pipe of millimetres between them would be one
    too many."""
    assert explored.success, explored.reason
    kinds = [type(event) for event in explored.events]
    assert (kinds.count(EndInspected), kinds.count(ExplorationComplete)) == (2, 1)
    difference = explored.map_difference()
    assert difference.complete, difference
    assert not difference.extra
    assert not difference.angles, difference


def test_a_robot_says_how_sure_it_is_of_its_map(explored, tmp_path, capsys):
    """Each size that it has measured has a standard deviation, of millimetres, that its error
    agrees with; the result keeps them, and the command prints them."""
    sizes = explored.map_difference().sizes
    assert {size.key for size in sizes} == {"length", "mean_radius", "angle"}
    for size in sizes:
        assert size.std is not None, size
        assert abs(size.error) < 3 * size.std, size
        assert 0.0005 < size.std < 0.02, size
    explored.save(tmp_path / "run")
    again = ot.load_result(tmp_path / "run")
    assert again.map_stds == explored.map_stds
    assert [size.cells for size in again.map_difference().sizes] == [size.cells for size in sizes]
    again.save(tmp_path / "again")
    one, other = ((tmp_path / run / "result.json").read_bytes() for run in ("run", "again"))
    assert one == other
    slip = {"no_load_slip_m_s": 1e-4, "slip_excess": 0.0}  # not measured by this run
    print_result(replace(again, metrics={**again.metrics, **slip}), tmp_path)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    for size in sizes:
        assert [size.part, size.true, size.key, *size.cells] in lines


def test_what_a_loop_moves_is_as_doubtful_as_it_has_moved():
    """Where a loop closes, its lengths take up the gap, and are no surer than that."""
    belief, end = Belief(Pose(np.eye(3), np.zeros(3)), 0.16, 0.5), (0, "end")
    for length in (0.5, 0.5, 0.53):
        belief.set_stds(end[0], length=0.001)
        bend = belief.attach(end, Elbow(0.24), "start", belief.port(end).rotation[:, 0])
        end = belief.attach_straight((bend, "end"), length), "end"
    belief.set_stds(end[0], length=0.001)
    bend = belief.attach(end, Elbow(0.24), "start", belief.port(end).rotation[:, 0])
    before = [belief.fitting(part).length_of_axes for part in range(0, 8, 2)]
    close_loop(belief, (bend, "end"), belief.start)
    after = [belief.fitting(part).length_of_axes for part in range(0, 8, 2)]
    moved = np.abs(np.subtract(after, before))
    stds = [belief.stds[belief.part_name(part)]["length"] for part in range(0, 8, 2)]
    assert moved.max() > 0.005
    np.testing.assert_allclose(stds, np.maximum(moved, 0.001), atol=2e-6)
    belief.lengthen(0, 0.1)
    assert not belief.stds["straight_1"]


def test_the_mean_of_looks_is_no_surer_than_what_they_have_in_common():
    """Looks that agree have a common error, and looks that scatter are not as sure as they say."""
    common = LOOKS.common_std
    assert common_std([common / 3] * 1000) == pytest.approx(common, rel=0.01)
    assert common_std([common]) == pytest.approx(math.sqrt(2) * common)
    assert common_std([common, common], [0.1, 0.12]) == pytest.approx(0.01, rel=0.01)
    assert common_std([0.0, 0.0]) == 0.0


def test_how_much_a_bend_bends_is_measured_after_it(explored):
    """From before it the end of a bend is hidden; past it the pose tells the angle to a degree."""
    (found,) = [f for f in explored.map.fittings if f.kind == "elbow"]
    assert found.angle_deg == pytest.approx(90.0, abs=1.0)


def test_its_place_is_known_on_its_own_map(explored):
    """To centimetres where the map is right."""
    channels = explored.trajectory.channels
    error = channels["distance_estimate"] - channels["distance"]
    assert np.median(np.abs(error)) < 0.01


def test_a_camera_sees_what_is_there():
    """The same as true sight, with its errors; and no farther than it can be trusted."""
    scenario = ot.load_scenario("missions/explore_onboard")
    senses, true = ot.Simulation([scenario]).senses, scenario.sight
    assert isinstance(senses, Onboard)
    sight, pipe = CameraSight(senses.taking.eyes, scenario.sensing), scenario.route.passages[0]
    line = scenario.route.centreline
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.array(0.7))
    for along in (0.1, 0.2, 0.28):
        at = np.array([along])
        position, frame = line.at(at)[0][0], line.frame(at)[0] @ turn
        seen = sight.look(0, Pose(frame, position), pipe)
        wanted = true.look(0, position, frame)
        assert seen is not None
        assert wanted is not None
        assert seen.fitting is not None
        assert wanted.fitting is not None
        assert seen.fitting.kind == wanted.fitting.kind == "tee"
        assert seen.enter == wanted.enter
        assert seen.distance == pytest.approx(wanted.distance, abs=0.005)
        assert seen.turn == pytest.approx(wanted.turn, abs=np.radians(3))
        assert seen.axis @ wanted.axis > np.cos(np.radians(1.5))


def directly(*fittings) -> Scenario:
    """A pipe with fittings that follow each other directly."""
    parts = [straight("foot", 0.5), *fittings, straight("on", 0.5)]
    names = [part["name"] for part in parts]
    joints = [joint(f"{a}.end", f"{b}.start") for a, b in pairwise(names)]
    return validate(
        {
            "network": {"fittings": parts, "joints": joints},
            "mission": {"start": "foot.start", "map": "unknown", "task": "explore"},
            "sensing": {"kind": "onboard"},
        }
    )


def test_what_follows_a_bend_directly_is_seen_by_a_lens_that_has_passed_the_port():
    """A lens comes out of a bend leaning, and sees on only when it is past it."""
    scenario = directly(
        elbow("bend", mean_radius=0.09), {"kind": "elbow", "name": "other", "mean_radius": 0.24}
    )
    senses = ot.Simulation([scenario]).senses
    assert isinstance(senses, Onboard)
    sight = CameraSight(senses.taking.eyes, scenario.sensing)
    parts = scenario.exploration.network.pipes.parts
    port = parts[1].port("end")
    passage = Passage.of(scenario.exploration.network.pipes, (1, "start", "end"), ARCS)
    lens = senses.taking.eyes.mount.ahead
    for past in (0.01, 0.02):
        lean = rotation_about(port.rotation[:, 1], np.array(0.25))
        frame = lean @ port.rotation
        centre = port.position + past * port.rotation[:, 2] - lens * frame[:, 2]
        ahead = sight.look(0, Pose(frame, centre), passage, Pose(frame, centre))
        assert ahead is not None
        assert isinstance(ahead.fitting, Elbow)
        assert ahead.distance == pytest.approx(lens * np.cos(0.25) - past, abs=0.01)


def test_a_lens_before_a_wall_sees_no_plate():
    """A flat wall at the lens is no end of the pipe: the robot lies across it."""
    plate = Detection(
        "closed end", "", {}, 0.01, 0.0, 1e-6 * np.eye(2), 1.0, np.zeros(2), np.zeros(2)
    )
    assert sighting_of(plate, 0.16, 0.07, 0.024) is None
    assert sighting_of(replace(plate, distance=0.05), 0.16, 0.07, 0.024).end == "closed"


def test_a_camera_is_believed_as_far_as_it_was_right():
    """0.35 m; pipe that is free up to there may have a fitting beyond. Free pipe right before the
    lens tells nothing."""
    tee_at = Detection(
        "tee", "branch", {}, 0.34, 0.0, 1e-6 * np.eye(2), 1.0, np.zeros(2), np.zeros(2)
    )
    assert isinstance(sighting_of(tee_at, 0.16, 0.07, 0.024).fitting, Tee)
    far = sighting_of(replace(tee_at, distance=0.37), 0.16, 0.07, 0.024)
    assert far.fitting is None
    assert far.distance == pytest.approx(0.07 + 0.352)
    free = replace(tee_at, kind="straight", enter="", distance=0.03)
    assert sighting_of(free, 0.16, 0.07, 0.024) is None
    assert sighting_of(replace(free, distance=0.05), 0.16, 0.07, 0.024).kind == ("", "")


def test_a_lens_looks_out_of_the_fitting_that_it_has_just_left():
    """Where nothing is known beyond it: the pipe that it sees begins behind the port, and the
    fitting tells how the lens stands until the wall beside it shows."""
    network = directly(elbow("bend", mean_radius=0.24)).exploration.network.pipes
    route = route_through(network, [(part, "start", "end") for part in range(3)])
    end = route.passages[1].s_leave
    for past, kind in ((-0.02, "elbow"), (0.05, "elbow"), (0.09, "elbow"), (0.11, "straight")):
        assert behind_lens(route, end + past).part.fitting.kind == kind
    known = route_through(network, [(part, "start", "end") for part in range(2)])
    assert behind_lens(known, 0.45).part.fitting.kind == "straight"


def test_looks_share_recognisers_and_no_noise_with_the_pictures_of_the_estimate(monkeypatch):
    """To make a recogniser takes seconds, and bores on a map differ by less than shows; numbers of
    pictures, by which noise is drawn, are those of looks alone for a day."""
    scenario = directly(elbow("bend", mean_radius=0.24))
    senses = ot.Simulation([scenario]).senses
    assert isinstance(senses, Onboard)
    sight, taken, made = CameraSight(senses.taking.eyes, scenario.sensing), [], []
    nothing = Detection("straight", "", {}, 0.0, 0.0, np.eye(2), 0.0, np.zeros(2), np.zeros(2))
    take = senses.taking.eyes.take

    def counted(robots, position, rotation, facing, number, pixels):
        taken.append(number)
        return take(robots, position, rotation, facing, number, pixels)

    def recogniser(table, bore):
        made.append(bore)
        return SimpleNamespace(single=lambda picture, prior: nothing)

    monkeypatch.setattr(senses.taking.eyes, "take", counted)
    monkeypatch.setattr(camera_sight, "_recogniser", recogniser)
    for bore in (0.1598, 0.16, 0.1603):
        pipe = Part("pipe", Straight(1.0, bore), Pose(np.eye(3), np.zeros(3)))
        passage = Passage.of(SimpleNamespace(parts=[pipe]), (0, "start", "end"))
        assert sight.look(0, Pose(np.eye(3), np.array([0.0, 0.0, 0.5])), passage) is None
    assert len(set(made)) == 1
    assert len(set(taken)) == 3
    assert min(taken) > 86_400 * 10
    # And a wall right before the lens is no end of the pipe.
    for distance, end in ((0.01, None), (0.05, "closed")):
        nothing = replace(nothing, kind="closed end", distance=distance, confidence=1.0)
        seen = sight.look(0, Pose(np.eye(3), np.array([0.0, 0.0, 0.5])), passage)
        assert (seen and seen.end) == end


@pytest.mark.parametrize(("length", "told"), [(0.034, False), (0.1, True)])
def test_a_reducer_as_short_as_can_be_is_none(length, told):
    """Out of a wye, a lens that leant saw one of 32 to 35 mm twice, and another one behind it."""
    sizes = {"end_diameter": 0.17, "length": length}
    seen = Detection(
        "reducer", "start", sizes, 0.1, 0.0, 1e-6 * np.eye(4), 1.0, np.zeros(2), np.zeros(2)
    )
    assert (sighting_of(seen, 0.16, 0.07, 0.024) is not None) == told


@pytest.mark.parametrize(
    ("seen", "in_pipe", "angle", "confidence"),
    [
        (Elbow(0.24, np.radians(100)), True, 90, 1.0),
        (Elbow(0.24, np.radians(50)), False, 45, 0.9),
        (Elbow(0.24, np.radians(67)), True, 67, 1.0),
        (Reducer(0.1, 0.14), True, None, 0.9),
        (Tee(), True, None, 1.0),
        (None, True, None, 0.9),
    ],
)
def test_what_a_lamp_shows_badly_is_not_taken_for_sure(seen, in_pipe, angle, confidence):
    """An elbow that seems to bend farther than one that is sold has its angle, and the radius that
    was seen; cones and free pipe hardly show."""
    told = by_lamp(Sighting(fitting=seen), in_pipe)
    assert told.confidence == confidence
    if angle is not None:
        assert isinstance(told.fitting, Elbow)
        assert np.degrees(told.fitting.angle) == pytest.approx(angle)
        assert told.fitting.mean_radius == 0.24


def test_a_lamp_shows_a_radius_to_what_its_looks_scatter_by():
    """Whatever a single look tells."""
    stds = {"mean_radius": 0.002, "angle": 0.1}
    told = by_lamp(Sighting(fitting=Elbow(0.24), size_stds=stds), True)
    assert told.size_stds == {"mean_radius": pytest.approx(0.006), "angle": 0.1}


@pytest.mark.parametrize(
    ("seen", "told", "std"),
    [
        (Elbow(0.24), 0.012, 0.0034),
        (Elbow(0.24), 0.002, 0.0016),
        (Wye(), 0.012, 0.006),
        (Tee(), 0.006, 0.006),
    ],
)
def test_by_depth_a_fitting_is_better_known_than_a_picture_tells(seen, told, std):
    """Its sizes and its position are confounded there, and agree better than they tell."""
    known = by_depth(Sighting(fitting=seen, distance_std=told, covariance=np.eye(1)))
    assert known.distance_std == pytest.approx(std, abs=5e-5)
    # Where its sizes are known, half of what the picture tells.
    assert known.covariance == pytest.approx(0.25 * np.eye(1))


def test_arms_of_a_robot_off_the_middle_measure_no_bore(monkeypatch):
    """One of them hangs free there, and tells nothing of the wall."""
    ahead = Detection("straight", "", {}, 0.2, 0.0, np.eye(2), 1.0, np.zeros(2), np.zeros(2))
    reader = SimpleNamespace(single=lambda picture, prior: ahead)  # takes no second a picture
    monkeypatch.setattr(camera_sight, "_recogniser", lambda table, bore: reader)
    simulation = ot.Simulation([directly()])
    senses = simulation.senses
    assert isinstance(senses, Onboard)
    slides = {
        "centred": [0.0, 0.0, 0.0],
        "wider": [0.005, 0.004, 0.006],
        "off": [0.012, -0.01, -0.01],
    }
    bores = {}
    for name, slide in slides.items():
        senses.body = senses.body._replace(arm=np.array([slide]))
        bores[name] = senses.look(0, back=False).bore
    assert bores["centred"] == pytest.approx(0.16)
    assert bores["wider"] == pytest.approx(0.17)
    assert np.isnan(bores["off"])


def test_a_robot_sees_alone_what_it_sees_in_a_batch():
    """The noise of its looks is its own."""
    scenario = bend(both_ends=False)
    other = ot.override(scenario, {"world.friction": 0.8, "start.theta5_deg": 30.0})
    alone, among = ot.Simulation([scenario]), ot.Simulation([other, scenario])
    # A part of the run: legs of explorers lengthen its limit of time. By then it has seen the bend
    # from afar and from close by.
    for simulation in (alone, among):
        while simulation.time[0] < 1.4:
            simulation.step()
    assert alone.events[0]
    assert [str(event) for event in alone.events[0]] == [str(event) for event in among.events[1]]
    assert alone.data(0).qpos.tobytes() == among.data(1).qpos.tobytes()
    estimates = alone.observation.location, among.observation.location
    for name in ("distance", "aside", "frame", "distance_std"):
        first, second = (getattr(each, name) for each in estimates)
        assert first[0].tobytes() == second[1].tobytes(), name


def test_a_robot_stays_where_pipe_that_was_taken_back_gave_its_number_to_a_fitting():
    """Nothing of the map around it has moved."""
    simulation = ot.Simulation([bend()])
    senses, belief = simulation.senses, simulation.legs.pilots[0].belief
    assert isinstance(senses, Onboard)
    assert belief is not None
    (end,) = belief.unexplored
    part = belief.attach_straight(end, 0.5)
    senses.update_maps([0])
    at = belief.port(end)
    senses.localiser.filter.position[0] = at.position + 0.1 * at.rotation[:, 2]
    before = senses.localiser.filter.position.copy()
    assert belief.is_removable(part)
    belief.remove(part)
    belief.attach(end, Tee(), "branch", at.rotation[:, 0])
    senses.update_maps([0])
    np.testing.assert_array_equal(senses.localiser.filter.position, before)
