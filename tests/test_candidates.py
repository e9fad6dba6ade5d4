"""Poses are compared by what all of them see."""

from __future__ import annotations

import numpy as np
import pytest

from omnitrack_sim.autonomy.candidates import Candidates, Shot
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Part, Straight
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.senses.optics import Mount
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.walls.rays import RayWalls


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
