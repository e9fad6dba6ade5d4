"""Pose estimates by pictures of pipes: what a picture tells, and what it does not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.autonomy.localiser import LOCALISER, Localiser
from omnitrack_sim.autonomy.pose_filter import PLACE, TURN, standing_covariance
from omnitrack_sim.base.rotations import Pose, length, rotation_vector, turned_by
from omnitrack_sim.pipes import Part, Straight, Tee
from omnitrack_sim.robots.omnitrack.odometry import TrackOdometry
from omnitrack_sim.senses.draws import keys
from omnitrack_sim.senses.optics import Eyes, Mount
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.walls.rays import RayWalls

PIPE = 0.5
"""Length of the pipe before the tee, m."""
ONE = np.zeros(1, np.intp)


def straight(length: float) -> list[Part]:
    """A pipe along z."""
    return [Part("pipe", Straight(length, 0.16), Pose(np.eye(3), np.zeros(3)))]


def before_tee() -> list[Part]:
    """A pipe along z, and a tee at its end."""
    return [*straight(PIPE), Part("tee", Tee(), Pose(np.eye(3), np.array([0.0, 0.0, PIPE])))]


class Trial:
    """One robot that stands in a pipe, ``along`` m from its beginning, and takes pictures.

    Args:
        parts: the map.
        true: the pipes as they are; the same as the map when left out.
        off: m, of the estimate along the pipe.
        turned: rad, of the estimate about the axis.
        known: the robot takes its rotation for known.
        std: m and rad, of an estimate that is as sure as that; None: as it begins.
    """

    def __init__(
        self, parts, *, true=None, along=0.38, off=0.0, turned=0.0, known=True, std=None, seed="a"
    ):
        table = SensingTable.model_validate({"start": {"theta5_known": known}})
        mount = Mount(camera_of(table), ot.Omnitrack().length / 2)
        self.localiser = Localiser(
            table, TrackOdometry(ot.Omnitrack()), mount, RayWalls([parts]), ONE, 0.01
        )
        self.eyes = Eyes(mount, RayWalls([true or parts]), 1)
        self.eyes.reset(ONE, keys([seed]))
        self.place, self.frame = np.array([[0.0, 0.0, along]]), np.eye(3)[None]
        estimate = turned_by(np.array([[0.0, 0.0, turned]]))
        gravity = np.array([[0.0, 0.0, -9.81]])
        self.localiser.reset(ONE, gravity, self.place + np.array([[0.0, 0.0, off]]), estimate)
        if std is not None:
            self.localiser.filter.covariance[:, :6, :6] = standing_covariance(
                self.frame[:, :, 2], std[0] ** 2, std[1] ** 2
            )

    def picture(self, number: int) -> np.ndarray:
        """One from the nose."""
        facing, pixels = np.ones(1, int), self.localiser.pixels
        return self.eyes.take(ONE, self.place, self.frame, facing, number, pixels)

    def look(self, pictures: int) -> Trial:
        """Take pictures from the nose, and correct the estimate by them."""
        for number in range(pictures):
            self.localiser.shoot(self.picture(number), np.ones(1, int), 0, np.ones(1, bool))
            assert self.localiser.see(np.ones(1, bool))
        return self

    @property
    def off(self) -> float:
        """Error along the pipe, m."""
        return float((self.localiser.filter.position - self.place)[0, 2])

    @property
    def turned(self) -> float:
        """Error of the rotation about the axis, rad."""
        relative = np.swapaxes(self.frame, 1, 2) @ self.localiser.filter.rotation
        return float(rotation_vector(relative)[0, 2])

    def std(self, block: slice) -> float:
        """Standard deviation along or about the pipe."""
        return float(self.localiser.filter.std(block, self.frame[:, :, 2])[0])


@pytest.mark.parametrize("turned", [0.0, 0.52, 1.3, -2.4, 3.1])
def test_a_branch_tells_how_a_robot_is_turned(turned):
    """One of unknown rotation, 8 mm off along the pipe, finds both out before a tee."""
    trial = Trial(before_tee(), along=0.4, known=False, turned=turned, off=0.008).look(12)
    assert not trial.localiser.unknown[0]
    assert np.degrees(abs(trial.turned)) < 3
    assert abs(trial.off) < 0.004


def test_pixels_of_a_picture_deviate_from_the_right_map_as_much_as_is_stated():
    """Half of them by less than 0.6745 standard deviations, as normal errors do; from a place 20 mm
    off, by more."""
    at_home = [Trial(before_tee(), along=0.4, seed=seed).look(2) for seed in "abcdefgh"]
    misfits = [trial.localiser.misfit[0] for trial in at_home]
    assert np.mean(misfits) == pytest.approx(0.6745, abs=0.06)
    sure_and_wrong = Trial(before_tee(), along=0.4, std=(0.002, 0.01), off=0.02).look(1)
    assert sure_and_wrong.localiser.misfit[0] > 0.85


def test_a_straight_pipe_tells_neither_place_nor_rotation():
    """Of a robot of unknown rotation it stays so, however many pictures it takes; and where it is
    along the pipe it knows no better than before: all places and rotations look alike."""
    lost = Trial(straight(9.0), along=4.0, known=False).look(12)
    assert lost.localiser.unknown[0]
    sure = Trial(straight(9.0), along=4.0, std=(0.03, 0.1)).look(12)
    assert sure.std(PLACE) == pytest.approx(0.03, rel=0.05)
    assert sure.std(TURN) > 0.09


@pytest.mark.parametrize(
    ("off", "std"),
    [(-0.06, 0.03), (-0.03, 0.03), (0.03, 0.03), (0.06, 0.03), (-0.08, 0.5), (-0.1, 0.5)],
)
def test_whole_pictures_bring_a_robot_back_from_afar(off, std):
    """Two standard deviations off along the pipe, where gradients lead astray, or so unsure that
    positions throughout what it takes for possible would be too far apart."""
    trial = Trial(before_tee(), off=off, std=(std, 0.02)).look(6)
    assert abs(trial.off) < 0.004
    assert abs(trial.off) < 4 * trial.std(PLACE)


@pytest.mark.parametrize("turned", [0.2, -0.2])
def test_whole_pictures_turn_a_robot_back(turned):
    """Two standard deviations off about its axis, which gradients never correct."""
    trial = Trial(before_tee(), turned=turned, std=(0.003, 0.1)).look(8)
    assert np.degrees(abs(trial.turned)) < 2.5
    assert abs(trial.turned) < 4 * trial.std(TURN)


def candidates(trial: Trial, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses along the pipe, as far as 0.2 m off, in six rotations."""
    steps = np.arange(-0.2, 0.1, spacing)
    places = trial.place + steps[:, None] * [[0.0, 0.0, 1.0]]
    frames = turned_by(np.arange(6)[:, None] * [[0.0, 0.0, np.pi / 3]])
    return np.tile(places, (6, 1))[None], np.repeat(frames, len(steps), axis=0)[None]


def sought(trial: Trial) -> bool:
    """Whether a robot relocalises among these by one picture."""
    trial.look(1)
    return bool(trial.localiser.seek(ONE, *candidates(trial, 0.11))[0])


def test_a_robot_relocalises_where_one_pose_alone_explains_its_picture():
    """Before a tee, from candidates 0.11 m and 60 degrees apart, to millimetres."""
    trial = Trial(before_tee(), off=0.1, turned=2.0)
    trial.localiser.reject(0)
    assert trial.localiser.inconsistent[0]
    assert sought(trial)
    assert abs(trial.off) < 0.003
    assert np.degrees(abs(trial.turned)) < 6
    assert abs(trial.off) < trial.std(PLACE) < 0.03
    assert abs(trial.turned) < trial.std(TURN) < 0.15
    assert not trial.localiser.inconsistent[0]


def test_a_robot_does_not_relocalise_where_poses_look_alike():
    """In a straight pipe: no answer is better than all others."""
    assert not sought(Trial(straight(9.0), along=4.0))


def test_a_robot_does_not_relocalise_by_a_picture_that_no_pose_explains():
    """Before a wall that is on no map."""
    blocked = straight(0.53)
    trial = Trial(before_tee(), true=blocked)
    trial.eyes = Eyes(trial.eyes.mount, RayWalls([blocked], [[(0, "end")]]), 1)
    trial.eyes.reset(ONE, keys(["a"]))
    assert not sought(trial)
    # Nor where there is no other pose to be compared with.
    assert not trial.localiser.seek(ONE, trial.place[None], trial.frame[None])[0]


def test_a_wrong_rotation_is_noticed_before_a_fitting():
    """By one comparison with all others; a right one is left alone."""
    right, wrong = (Trial(before_tee(), turned=turned, std=(0.003, 0.1)) for turned in (0.0, np.pi))
    for trial, unknown in ((right, False), (wrong, True)):
        trial.look(1)
        trial.localiser.verify(ONE)
        assert trial.localiser.unknown[0] == unknown


def test_pictures_on_their_way_follow_a_robot_that_has_moved_to_another_pose():
    """Put elsewhere by a picture, it takes the ones that it has shot since with it."""
    trial = Trial(before_tee(), off=0.05, turned=1.0)
    for number, latency in ((0, 0), (1, 3)):
        trial.localiser.shoot(trial.picture(number), np.ones(1, int), latency, np.ones(1, bool))
    assert trial.localiser.see(np.ones(1, bool))
    assert trial.localiser.seek(ONE, trial.place[None], trial.frame[None])[0]
    for later in (trial.localiser.shot, trial.localiser._arriving[0][1]):
        assert later is not None
        assert length(later.position - trial.localiser.filter.position)[0] < 1e-9
        turn = np.swapaxes(later.rotation, 1, 2) @ trial.localiser.filter.rotation
        assert length(rotation_vector(turn))[0] < 1e-6


def test_a_robot_moves_with_the_part_of_the_map_that_it_is_in():
    """It keeps its pose in that part, with the pictures that are on their way; others stay."""
    trial, rng = Trial(before_tee(), off=0.05, turned=1.0), np.random.default_rng(1)
    trial.localiser.shoot(trial.picture(0), np.ones(1, int), 3, np.ones(1, bool))
    turns = turned_by(rng.uniform(-1.0, 1.0, (4, 3)))
    before, after = (Pose(turn, rng.uniform(-1.0, 1.0, 3)) for turn in turns[:2])
    pose = trial.localiser.filter
    pose.position, pose.rotation = rng.uniform(-1.0, 1.0, (2, 3)), turns[2:]
    shot = trial.localiser._arriving[0][1]
    there = {"pose": (pose.position, pose.rotation), "shot": (shot.position, shot.rotation)}
    trial.localiser.move(0, before, after)
    later = trial.localiser._arriving[0][1]
    for name, estimate in (("pose", pose), ("shot", later)):
        position, rotation = there[name]
        inside = before.inverse() @ Pose(rotation[0], position[0])
        expected = after @ inside
        assert estimate.position[0] == pytest.approx(expected.position)
        assert estimate.rotation[0] == pytest.approx(expected.rotation)
    assert (pose.position[1] == there["pose"][0][1]).all()
    assert (pose.rotation[1] == there["pose"][1][1]).all()


def test_a_map_that_changes_makes_a_robot_less_sure():
    """By the deviations of ``LocaliserSettings``, in every direction."""
    trial = Trial(before_tee(), std=(0.002, 0.01))
    place, turn = trial.std(PLACE), trial.std(TURN)
    trial.localiser.inflate(0)
    assert trial.std(PLACE) == pytest.approx(np.hypot(place, LOCALISER.remapped_place_std))
    assert trial.std(TURN) == pytest.approx(np.hypot(turn, LOCALISER.remapped_turn_std))
    assert trial.std(PLACE) > 2 * place
    assert trial.std(TURN) > 1.3 * turn


def test_a_robot_that_knows_how_it_is_turned_is_sure_of_it():
    """By the deviation that it begins with: it may enter a fitting at once."""
    assert np.degrees(Trial(before_tee()).std(TURN)) < SensingTable().filter.sure_deg


def test_pictures_that_look_alike_are_not_compared_again_at_once():
    """After one without information, two of the same end pass: comparing costs the most time."""
    trial = Trial(straight(9.0), along=4.0, known=False)
    around, calls = trial.localiser._candidates.around, []

    def counted(*arguments):
        calls.append(1)
        return around(*arguments)

    trial.localiser._candidates.around = counted  # type: ignore[method-assign]
    trial.look(9)
    assert len(calls) == 3


def test_what_stands_in_a_pipe_hardly_moves_a_robot():
    """A tenth of the pixels sees something near that is on no map: the others prevail."""
    trial, every = Trial(before_tee(), std=(0.005, 0.02)), np.ones(1, bool)
    for number in range(6):
        picture = trial.picture(number)
        picture[:, ::10] = 0.05
        trial.localiser.shoot(picture, np.ones(1, int), 0, every)
        trial.localiser.see(every)
    assert abs(trial.off) < 0.003


def test_a_picture_of_hardly_any_pixels_makes_no_robot_lost():
    """Some that are left are wrong: that is no misfit of the map."""
    trial, every = Trial(before_tee()), np.ones(1, bool)
    picture = np.full_like(trial.picture(0), np.nan)
    picture[:, ::25] = 0.05
    trial.localiser.shoot(picture, np.ones(1, int), 0, every)
    trial.localiser.see(every)
    assert trial.localiser.misfit[0] == 0


def test_gradients_of_a_camera_that_states_none_are_those_of_one_that_does():
    """By differences of pictures: the depth camera's, within a thousandth for most pixels."""
    trial = Trial(before_tee())
    candidates, camera = trial.localiser._candidates, trial.eyes.mount.camera
    rays = trial.eyes.mount.rays[trial.localiser.pixels]
    place, frame = trial.eyes.mount.lens(trial.place, trial.frame, np.ones(1, int))
    hits = RayWalls([before_tee()]).trace(ONE, place, frame, rays, camera.optics.far)
    stated = camera.slopes(hits, rays, frame)
    assert stated is not None
    found = candidates._slopes(hits, place, frame, rays, camera.expected(hits, rays))
    known = np.isfinite(found).all(axis=-1) & (np.abs(stated).max(axis=-1) < 10)
    assert known.mean() > 0.5
    error = np.abs(found - stated)[known].max(axis=-1) / np.abs(stated[known]).max(axis=-1)
    assert np.percentile(error, 90) < 1e-3


def test_tilt_is_as_unsure_at_the_axis_of_a_bend_as_beside_it():
    """At the axis all points of a bend are equally near, and no error there has any bound."""
    axes = np.eye(3)
    location: Any = SimpleNamespace(
        tangent=axes[None, 2], normal=axes[None, 0], curvature=np.array([5.0])
    )
    deviations = []
    for aside in (0.1, 0.1999):
        location.aside = aside * axes[None, 0]
        deviations.append(float(Trial(before_tee()).localiser.filter.tilt_std(location)[0]))
    assert deviations[0] < deviations[1] < 5 * deviations[0]
