"""What lies ahead, found in pictures of both cameras."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from omnitrack_sim.autonomy.recognition import Recogniser
from omnitrack_sim.autonomy.recognition.forms import (
    DISTANCE,
    PLACES,
    STILL,
    TURN,
    PosePrior,
    cameras,
    forms,
    numbers_at,
)
from omnitrack_sim.autonomy.recognition.recogniser import Entries
from omnitrack_sim.autonomy.recognition.tuning import RECOGNISER
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Elbow, Part, Reducer, Straight, Tee, attached
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.senses.cameras import DepthCamera, DepthTable, HeadlightCamera, HeadlightTable
from omnitrack_sim.senses.draws import keys
from omnitrack_sim.senses.optics import rays_of
from omnitrack_sim.walls.rays import RayWalls

CAMERAS = {
    "depth": DepthCamera(DepthTable()),
    "headlight": HeadlightCamera(HeadlightTable()),
}
FITTINGS = {
    "elbow": (Elbow(0.09), "start"),
    "wide elbow": (Elbow(0.24, math.pi / 4), "start"),
    "tee over": (Tee(), "run_start"),
    "tee into": (Tee(), "branch"),
    "wye turn": (Wye(), "run_start"),
    "wye sharp": (Wye(), "run_end"),
    "wye merge": (Wye(), "branch"),
    "reducer": (Reducer(0.1, 0.13), "start"),
    "open end": (None, ""),
    "closed end": (None, ""),
}
ROLLED = (0.003, -0.002, 0.03, 0.02)
"""Offset, m, and tilt, rad, of the robot."""
BOTH = ("wye sharp", "reducer")
"""Fittings that both cameras are tried on, beside those of their approaches and ends below:
pictures of light take twice as long to read."""
KNOWN = [("depth", name) for name in FITTINGS] + [("headlight", name) for name in BOTH]
BESIDE = {"depth": (0.002, 0.015), "headlight": (0.006, 0.05)}
"""Errors of both, m and rad: in a picture of light, dirt of the wall looks like either."""


@cache
def recogniser(camera):
    """Its library takes a second to fill."""
    return Recogniser(CAMERAS[camera], 0.16, RayWalls)


def world(name):
    """Parts, and the ports that a plate closes; the port plane is z = 0, x as of the port."""
    lead = Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))
    if name == "straight":
        return [
            lead,
            Part("on", Straight(1.5), attached(lead.port("end"), lead.fitting, "start", 0.0)),
        ], ()
    fitting, enter = FITTINGS[name]
    if fitting is None:
        return [lead], [(0, "end")] if name == "closed end" else []
    return world_of(fitting, enter)


def world_of(fitting, enter="start"):
    """The same of a fitting with straights at all of its ports."""
    lead = Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))
    part = Part("ahead", fitting, attached(lead.port("end"), fitting, enter, 0.0))
    after = []
    for port in fitting.port_names:
        if port != enter:
            straight = Straight(0.6, 2 * fitting.port_radius(port))
            after.append(Part(port, straight, attached(part.port(port), straight, "start", 0.0)))
    return [lead, part, *after], ()


def pictures(camera, name, distances, turn=0.0, stands=(0.0, 0.0, 0.0, 0.0)):
    """Pictures (v, pixels²) and the motions between them."""
    numbers = np.array([[*stands, distance, turn] for distance in distances])
    return photographed(camera, world(name), numbers)


def photographed(camera, seen, numbers):
    """Pictures (v, pixels²) of a world from cameras at numbers (v, 6), and the motions between."""
    place, rotation = (pose[:, 0] for pose in cameras(numbers, [STILL]))
    parts, closed = seen
    lens, rays = CAMERAS[camera], rays_of(CAMERAS[camera].optics)
    which, pixels = np.zeros(len(numbers), int), np.arange(len(rays))
    walls = RayWalls([parts], [closed], dirty=True)
    hits = walls.trace(which, place, rotation, rays, 1.5, lens.lamp)
    taken = [
        lens.picture(hits[i : i + 1], rays, pixels, keys(["test"]), i) for i in range(len(numbers))
    ]
    back = rotation[-1].T
    motions = [
        Pose(back @ turned, back @ (at - place[-1]))
        for at, turned in zip(place, rotation, strict=True)
    ]
    return np.concatenate(taken), motions


def turned_by(sighting, turn, period=2 * math.pi):
    """Error of the direction, rad."""
    return abs((sighting.turn - turn + period / 2) % period - period / 2)


@pytest.mark.parametrize(("camera", "name"), KNOWN)
def test_a_fitting_is_known_by_its_picture(camera, name):
    """Kind, port, distance and direction, from one picture at a middle distance."""
    taken, _ = pictures(camera, name, [0.16], turn=1.9, stands=ROLLED)
    sighting = recogniser(camera).single(taken[0])
    fitting, enter = FITTINGS[name]
    assert (sighting.kind, sighting.enter) == (name if fitting is None else fitting.kind, enter)
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance == pytest.approx(0.16, abs=0.02)
    assert sighting.aside == pytest.approx(ROLLED[:2], abs=BESIDE[camera][0])
    assert sighting.tilt == pytest.approx(ROLLED[2:], abs=BESIDE[camera][1])
    if fitting is not None and not fitting.is_axial:
        period = math.pi if name == "tee into" else 2 * math.pi
        assert turned_by(sighting, 1.9, period) < math.radians(10)


@pytest.mark.parametrize(
    ("camera", "name"),
    [("depth", name) for name in ("straight", "elbow", "wide elbow", "tee over", "wye turn")]
    + [("headlight", "straight"), ("headlight", "elbow")],
)
def test_a_fitting_is_known_from_within_the_one_before_it(camera, name):
    """No straight wall shows from 20 mm before the port, by a lens that leans 17 degrees; a map
    tells how it stands, to a degree."""
    stand = np.array([0.003, -0.002, 0.25, 0.15, 0.02, 1.9])
    taken, _ = pictures(camera, name, [0.02], turn=1.9, stands=stand[:4])
    error = np.array([0.002, 0.001, -0.015, 0.015, 0.003, -1.9])
    prior = PosePrior(stand + error, RECOGNISER.camera_std)
    sighting = recogniser(camera).single(taken[0], prior)
    if name == "straight":
        assert sighting.kind == "straight"
        return
    fitting, enter = FITTINGS[name]
    assert (sighting.kind, sighting.enter) == (fitting.kind, enter)
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance == pytest.approx(0.02, abs=0.015)
    assert turned_by(sighting, 1.9) < math.radians(10)
    assert sighting.tilt == pytest.approx(stand[2:4], abs=0.05)


FOLLOWED = {
    "tee over": ({"run_end": Elbow(0.09)}, 0.19),
    "wye turn": ({"run_end": Elbow(0.09), "branch": Elbow(0.24)}, 0.12),
}
"""Fittings that follow others directly, by their ports, and the distance of the camera, m."""


@pytest.mark.parametrize("name", FOLLOWED)
def test_a_fitting_is_not_taken_for_straight_pipe_before_what_follows_it(name):
    """A bend right behind a tee explains more pixels than the tee's branch does; but no straight
    has a hole in its wall."""
    followers, distance = FOLLOWED[name]
    parts, _ = world(name)
    parts = parts[:2]
    for port, fitting in followers.items():
        place = attached(parts[1].port(port), fitting, "start", 2.0)
        parts.append(Part(port, fitting, place))
        on = Straight(0.4)
        parts.append(Part("on", on, attached(parts[-1].port("end"), on, "start", 0.0)))
    for port in set(FITTINGS[name][0].port_names) - {*followers, FITTINGS[name][1]}:
        on = Straight(0.4)
        parts.append(Part("on", on, attached(parts[1].port(port), on, "start", 0.0)))
    taken = photographed("depth", (parts, ()), np.array([[*ROLLED, distance, 1.9]]))[0]
    sighting = recogniser("depth").single(taken[0])
    fitting, enter = FITTINGS[name]
    assert (sighting.kind, sighting.enter) == (fitting.kind, enter)
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance == pytest.approx(distance, abs=0.01)


@pytest.mark.long
def test_a_bend_right_behind_a_shallow_reducer_is_no_fault_of_the_reducer():
    """A picture shows more of the bend than of the reducer. Both are fitted together: with pipe
    behind it, the cone seems 9 to 23 mm longer."""
    reducer, bend = Reducer(0.1, 0.15), Elbow(0.24, inner_diameter=0.15)
    parts = [Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))]
    for fitting in (reducer, bend, Straight(0.4, 0.15)):
        place = attached(parts[-1].port("end"), fitting, "start", 2.0)
        parts.append(Part("ahead", fitting, place))
    for distance in (0.08, 0.1, 0.115):
        numbers = np.array([[*ROLLED, distance, 0.0]])
        sighting = recogniser("depth").single(photographed("depth", (parts, ()), numbers)[0][0])
        assert sighting.kind == "reducer"
        assert 0.95 < sighting.confidence <= 1.0
        assert sighting.distance == pytest.approx(distance, abs=0.008)
        assert sighting.sizes["length"] == pytest.approx(0.1, abs=0.008)
        assert set(sighting.sizes) == {"end_diameter", "length"}


@pytest.mark.long
@pytest.mark.parametrize("distance", [0.02, 0.036])
def test_a_shallow_reducer_before_a_bend_is_seen_out_of_a_fitting(distance):
    """The bend explains more pixels than the reducer alone, as a bend of this bore farther on."""
    parts = [Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))]
    for fitting in (Reducer(0.1, 0.17), Elbow(0.24, inner_diameter=0.17), Straight(0.4, 0.17)):
        place = attached(parts[-1].port("end"), fitting, "start", 2.0)
        parts.append(Part("ahead", fitting, place))
    stand = np.array([0.003, -0.002, 0.05, 0.03, distance, 0.0])
    taken = photographed("depth", (parts, ()), stand[None])[0][0]
    error = np.array([0.002, 0.001, -0.015, 0.015, 0.003, 0.0])
    sighting = recogniser("depth").single(taken, PosePrior(stand + error, RECOGNISER.camera_std))
    assert sighting.kind == "reducer"
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance == pytest.approx(distance, abs=0.02)
    assert sighting.sizes["end_diameter"] == pytest.approx(0.17, abs=0.003)


@pytest.mark.long
@pytest.mark.parametrize(("distance", "enter"), [(0.03, "run_start"), (0.06, "run_end")])
def test_a_shallow_reducer_right_before_a_wye_is_seen_by_a_lamp(distance, enter):
    """The wye explains more pixels than the reducer alone, as a wye of this bore farther on."""
    reducer, wye = Reducer(0.1, 0.17), Wye(inner_diameter=0.17, branch_diameter=0.17)
    parts = [Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))]
    for fitting, port in ((reducer, "start"), (wye, enter)):
        place = attached(parts[-1].port("end"), fitting, port, 1.9 if fitting is wye else 0.0)
        parts.append(Part("ahead", fitting, place))
    for port in set(wye.port_names) - {enter}:
        on = Straight(0.6, 0.17)
        parts.append(Part(port, on, attached(parts[2].port(port), on, "start", 0.0)))
    taken = photographed("headlight", (parts, ()), np.array([[*ROLLED, distance, 0.0]]))[0]
    sighting = recogniser("headlight").single(taken[0])
    assert sighting.kind == "reducer"
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance == pytest.approx(distance, abs=0.01)
    assert sighting.sizes["end_diameter"] == pytest.approx(0.17, abs=0.003)


def test_any_bend_has_a_form_behind_a_reducer():
    """Its radius is brought into the bounds of the bore there."""
    every = {form.name: form for form in forms(0.16)}
    bend = every["elbow"]
    for name, sizes in (("wide", (0.256, 0.3)), ("narrow", (0.08, 0.3))):
        for radius in (bend.sizes[0].low, bend.sizes[0].high):
            parts, _ = every[name].before(bend).map((*sizes, radius, 1.0), 0.16)
            kinds = [part.fitting.kind for part in parts]
            assert kinds == ["straight", "reducer", "elbow", "straight"]
            assert parts[2].fitting.inner_diameter == sizes[0]


@pytest.mark.long
def test_a_joint_of_pipes_with_an_end_behind_it_is_no_reducer():
    """By a lamp, two dark rings in straight pipe fit a shallow reducer better than one joint; and
    pipe is free up to them, though a reducer right before the lens would hardly show."""
    lead, on = Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5]))), Straight(0.3)
    parts = [lead, Part("on", on, attached(lead.port("end"), on, "start", 0.0))]
    numbers = np.array([[*ROLLED, 0.194, 0.0]])
    sighting = recogniser("headlight").single(photographed("headlight", (parts, ()), numbers)[0][0])
    assert sighting.kind == "straight"
    assert 0.95 < sighting.confidence <= 1.0
    assert sighting.distance > 0.19


def test_the_angle_of_a_wye_is_told_before_it_sharply():
    """A search from one distance alone takes 45 degrees for 60, as the mouth moves with the
    angle."""
    for turn in (0.3, 1.5):
        taken, _ = pictures("depth", "wye sharp", [0.1], turn, ROLLED)
        sighting = recogniser("depth").single(taken[0])
        assert sighting.sizes["angle"] == pytest.approx(math.pi / 4, abs=math.radians(4))


def test_a_camera_before_a_port_has_the_numbers_that_place_it_there():
    """Whatever way it leans; the direction of the port's x axis is not among them."""
    for numbers in np.random.default_rng(1).normal(size=(20, 6)) * [0.02, 0.02, 0.3, 0.3, 0.1, 0]:
        position, frame = (pose[0, 0] for pose in cameras(numbers[None], [STILL]))
        assert numbers_at(Pose(), position, frame) == pytest.approx(numbers, abs=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", ["elbow", "tee over"])
def test_pictures_of_an_approach_tell_the_direction(camera, name):
    """Within 5 degrees, wherever it is; and within what the covariance lets expect."""
    for turn in (-2.4, 0.5) if camera == "depth" else (-2.4,):
        taken, motions = pictures(camera, name, [0.25, 0.2, 0.15], turn, ROLLED)
        sighting = recogniser(camera).approach(taken, motions)
        assert sighting.kind == name.split()[0]
        assert turned_by(sighting, turn) < math.radians(5)
        assert 0 < sighting.covariance[1, 1] < math.radians(10) ** 2


def test_sizes_are_told_with_their_spread():
    """Of an elbow, by the depth camera."""
    taken, _ = pictures("depth", "wide elbow", [0.1], 0.7)
    sighting = recogniser("depth").single(taken[0])
    assert sighting.sizes["mean_radius"] == pytest.approx(0.24, abs=0.05)
    assert sighting.sizes["angle"] == pytest.approx(math.pi / 4, abs=0.2)
    assert all(0 < spread < 0.5 for spread in sighting.stds[2:])


def test_a_bend_whose_far_end_is_hidden_is_taken_for_a_quarter():
    """Its angle hardly shows, and the best fit alone is off by up to 15 degrees; what shows of a
    bend of 45 degrees tells it apart."""
    for angle, turn in ((math.pi / 2, 2.0), (math.pi / 4, 4.5)):
        bend = Elbow(0.24, angle)
        lead = Part("lead", Straight(1.5), Pose(np.eye(3), np.array([0, 0, -1.5])))
        part = Part("ahead", bend, attached(lead.port("end"), bend, "start", 0.0))
        on = Part("on", Straight(0.6), attached(part.port("end"), Straight(0.6), "start", 0.0))
        numbers = np.array([[*ROLLED, 0.1, turn]])
        taken = photographed("depth", ([lead, part, on], ()), numbers)[0]
        sighting = recogniser("depth").single(taken[0])
        assert sighting.sizes["angle"] == pytest.approx(angle, abs=math.radians(4))


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize(("name", "distance"), [("open end", 0.23), ("closed end", 0.11)])
def test_how_far_an_end_is_is_told_with_its_spread(camera, name, distance):
    """To millimetres, though slopes of a picture know nothing of an open end."""
    sighting = recogniser(camera).single(pictures(camera, name, [distance], stands=ROLLED)[0][0])
    assert sighting.kind == name
    assert sighting.distance == pytest.approx(distance, abs=0.005)
    assert 0 < sighting.covariance[0, 0] < 0.006**2


@pytest.mark.parametrize("camera", CAMERAS)
def test_where_a_bend_begins_is_told_apart_from_how_narrow_it_is(camera):
    """Both look much alike: a search from one place alone ends centimetres off."""
    for distance in (0.16, 0.22) if camera == "depth" else (0.22,):
        sighting = recogniser(camera).single(pictures(camera, "wide elbow", [distance], 0.7)[0][0])
        assert sighting.distance == pytest.approx(distance, abs=0.006)
        assert sighting.sizes["mean_radius"] == pytest.approx(0.24, abs=0.03)


@pytest.mark.parametrize("turn", [0.4, 0.87])
def test_a_bend_at_the_edge_of_a_picture_is_not_taken_for_a_camera_that_leans(turn):
    """From 60 mm before it, by a lamp; the dark joint where it begins is hardly in the picture."""
    numbers = np.array([[0.002, -0.003, 0.0, 0.005, 0.06, turn]])
    taken, _ = photographed("headlight", world_of(Elbow(0.24)), numbers)
    sighting = recogniser("headlight").single(taken[0])
    assert sighting.kind == "elbow"
    assert sighting.distance == pytest.approx(0.06, abs=0.002)
    assert sighting.sizes["mean_radius"] == pytest.approx(0.24, rel=0.03)
    assert np.abs(sighting.tilt).max() < math.radians(2)


def test_the_length_of_a_reducer_is_that_to_the_joint_at_its_far_end():
    """By a lamp, of one of 6 % whose cone hardly shows: all lengths are tried."""
    numbers = np.array([[0.002, -0.003, 0.0, 0.005, 0.11, 0.0]])
    taken, _ = photographed("headlight", world_of(Reducer(0.1, 0.17)), numbers)
    sighting = recogniser("headlight").single(taken[0])
    assert sighting.kind == "reducer"
    assert sighting.sizes["length"] == pytest.approx(0.1, abs=0.003)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_straight_pipe_is_straight(camera):
    """As far as is seen; a fitting at 1 m is not told as one."""
    for name, distance in (("straight", 0.3), ("tee over", 1.0)):
        taken, _ = pictures(camera, name, [distance], stands=ROLLED)
        sighting = recogniser(camera).single(taken[0])
        assert sighting.kind == "straight" or sighting.confidence < 0.95
        assert sighting.distance < 1.0
        assert name != "straight" or sighting.distance > 0.2, "nothing nearer can be there"


def test_the_same_picture_gives_the_same_sighting():
    """Bit for bit, whatever was looked at between."""
    taken, _ = pictures("depth", "tee over", [0.2], 0.4)
    first = recogniser("depth").single(taken[0])
    recogniser("depth").single(pictures("depth", "elbow", [0.1])[0][0])
    again = recogniser("depth").single(taken[0])
    assert repr(first) == repr(again)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_picture_that_says_nothing_is_not_sure(camera):
    """Without a pixel, and of noise."""
    nothing = np.full(48 * 48, np.nan)
    assert recogniser(camera).single(nothing).confidence == 0.0
    noise = np.random.default_rng(1).uniform(0.0, 1.0, 48 * 48)
    assert recogniser(camera).single(noise).confidence < 0.95


def test_a_pipe_that_is_like_none_is_not_sure():
    """Where water stands in it, as straight pipe explains the most of that."""
    taken, _ = pictures("depth", "straight", [0.3])
    below = rays_of(CAMERAS["depth"].optics)[:, 0]
    for level in (0.068, 0.072):
        water = np.where(below > 0, level / np.maximum(below, 1e-9), np.inf)
        sighting = recogniser("depth").single(np.minimum(taken[0], water))
        assert sighting.confidence < 0.95


def test_searches_begin_at_entries_that_are_no_neighbours():
    """Those are apart in distance or in turn, which goes round; and each that is left out before
    the last of them has one of them beside it."""
    rng, bore = np.random.default_rng(3), 0.16
    apart = RECOGNISER.distinct_turn, RECOGNISER.distinct_distance * bore
    for _ in range(30):
        numbers = np.zeros((40, PLACES))
        numbers[:, TURN] = rng.uniform(-1.1, 1.1, 40) + math.pi * rng.integers(-1, 2, 40)
        numbers[:, DISTANCE] = 0.5 + rng.uniform(0.0, 1.5, 40) * apart[1]
        rows = rng.permutation(40)[:30]
        found = Entries(rows, rows, numbers).distinct(rows, bore)
        at = [rows.tolist().index(row) for row in found]
        assert at == sorted(at)
        assert 1 < len(found) <= RECOGNISER.starts
        turn, place = np.exp(1j * numbers[:, TURN]), numbers[:, DISTANCE]
        beside = (np.abs(np.angle(turn[:, None] / turn)) <= apart[0]) & (
            np.abs(place[:, None] - place) <= apart[1]
        )
        for k, row in enumerate(rows[: at[-1] + 1]):
            before = [other for other, i in zip(found, at, strict=True) if i < k]
            assert beside[row, before].any() == (row not in found)


@pytest.mark.parametrize("camera", CAMERAS)
def test_no_camera_is_traced_twice_in_one_picture(camera, monkeypatch):
    """A step of the search begins where an earlier one has ended, whose hits are kept."""
    finder, poses = recogniser(camera), []
    trace = RayWalls.trace

    def counted(walls, which, position, rotation, rays, far, lamp=None):
        of_each = [walls._maps[i][:, 3:].tobytes() for i in which]
        rows = zip(of_each, position, rotation, strict=True)
        poses.extend((m, p.tobytes(), r.tobytes(), len(rays)) for m, p, r in rows)
        return trace(walls, which, position, rotation, rays, far, lamp)

    taken, _ = pictures(camera, "tee into", [0.16], turn=1.9, stands=ROLLED)
    monkeypatch.setattr(RayWalls, "trace", counted)
    finder.single(taken[0])
    # A few come back after more cameras than are kept, or by numbers that are the same camera: 1 to
    # 5 %, by the processor's rounding; if none were kept, 14 to 16 %.
    assert len(poses) - len(set(poses)) < 0.08 * len(poses)
