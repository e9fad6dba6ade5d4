"""Poses are compared by what all of them see."""

from __future__ import annotations

import numpy as np
import pytest

from omnitrack_sim.autonomy.candidates import Candidates, Shot, reprojected
from omnitrack_sim.base.rotations import Pose, length, rotation_vector, turned_by
from omnitrack_sim.pipes import Part, Straight, Tee
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.senses.optics import Mount
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.walls.rays import RANGE, RayWalls


def pipe(length: float) -> list[Part]:
    return [Part("pipe", Straight(length, 0.16), Pose(np.eye(3), np.zeros(3)))]


@pytest.mark.parametrize("camera", ["headlight", "depth"])
def test_a_picture_that_fits_badly_moves_no_robot_to_the_end_of_the_pipe_seen_so_far(camera):
    """One that is 7 % too dim, in pipe that goes on beyond what is on the map: no position along
    the pipe is better than another."""
    table = SensingTable(camera=camera)
    mount = Mount(camera_of(table), Omnitrack().length / 2)
    known = RayWalls([pipe(1.0)], unknown=[[(0, "end")]])
    which, gravity = np.zeros(1, np.intp), np.zeros((1, 3))
    candidates = Candidates(table.filter, mount, known, which, gravity)
    position, rotation, facing = np.array([[0.0, 0.0, 0.8]]), np.eye(3)[None], np.ones(1, int)
    rays = mount.rays[candidates.pixels]
    there = RayWalls([pipe(3.0)]).trace(
        which, *mount.lens(position, rotation, facing), rays, 10.0, mount.camera.lamp
    )
    picture = 0.93 * mount.camera.expected(there, rays)
    shot = Shot(picture, position, rotation, facing, np.ones(1, bool))
    steps, still = np.linspace(-0.03, 0.03, 13)[None], np.zeros((1, 1))
    cost = candidates.around(which, shot, rotation[:, :, 2], steps, still, candidates.few)
    assert np.ptp(cost) < 0.5


def tee() -> tuple[list[Part], Mount]:
    """A pipe of 0.5 m along z before a tee, and the cameras of a robot."""
    there = Part("tee", Tee(), Pose(np.eye(3), np.array([0.0, 0.0, 0.5])))
    return [*pipe(0.5), there], Mount(camera_of(SensingTable()), Omnitrack().length / 2)


def test_a_picture_from_close_by_is_that_of_rays_but_where_they_graze_or_pass_an_edge():
    """Moved by millimetres and turned by degrees; no ray comes out far from where it was."""
    parts, mount = tee()
    walls, rng, which = RayWalls([parts]), np.random.default_rng(1), np.zeros(20, np.intp)
    place = [0.0, 0.0, 0.38] + rng.normal(size=(20, 3)) * [0.003, 0.003, 0.06]
    frame = turned_by(0.1 * rng.normal(size=(20, 3)))
    other = place + 0.003 * rng.normal(size=(20, 3))
    turned = frame @ turned_by(0.03 * rng.normal(size=(20, 3)))
    here = walls.trace(which, place, frame, mount.rays, 1.5)
    there = walls.trace(which, other, turned, mount.rays, 1.5)[..., RANGE]
    near = reprojected(here, mount.rays, place, frame, other, turned, None)[..., RANGE]
    both = np.isfinite(there) & np.isfinite(near)
    error, moved = (np.abs(ranges[both] - there[both]) for ranges in (near, here[..., RANGE]))
    assert np.median(error) < 0.05 * np.median(moved)
    assert error.max() < 0.2


def test_a_candidate_is_improved_by_steps_that_its_picture_can_tell():
    """One that lies across the pipe goes on from there, not to wherever the slopes lead."""
    parts, mount = tee()
    which, gravity = np.zeros(1, np.intp), np.zeros((1, 3))
    candidates = Candidates(SensingTable().filter, mount, RayWalls([parts]), which, gravity)
    place, frame, facing = np.array([[0.0, 0.0, 0.38]]), np.eye(3)[None], np.ones(1, int)
    rays, camera = mount.rays[candidates.pixels], mount.camera
    hits = RayWalls([parts]).trace(which, *mount.lens(place, frame, facing), rays, 10.0)
    shot = Shot(camera.expected(hits, rays), place, frame, facing, np.ones(1, bool))
    turns = np.random.default_rng(1).normal(size=(30, 3)) * 0.5
    steps = np.random.default_rng(2).normal(size=(30, 3)) * [0.01, 0.01, 0.1]
    places, frames = (place + steps)[None], turned_by(turns)[None]
    moved, turned = candidates._improved(which, shot, places, frames, 1.0)
    assert length(moved - places).max() < 0.031
    apart = rotation_vector((np.swapaxes(frames, -1, -2) @ turned)[0])
    assert length(apart).max() < 0.21
