"""A scenario as one MuJoCo model: walls, robot and, for pictures, looks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco

from omnitrack_sim.mjcf.robot import add_robot
from omnitrack_sim.mjcf.spec import new_spec
from omnitrack_sim.mjcf.walls import add_walls
from omnitrack_sim.pipes import PipeNetwork
from omnitrack_sim.robot import Robot


def build_scene(
    network: PipeNetwork,
    robot: Robot,
    *,
    timestep: float = 0.002,
    wall_tolerance: float = 1e-4,
    staves: int | None = None,
    looks: bool = False,
) -> mujoco.MjSpec:
    """The robot at the world's origin and the walls of a network, ready to compile.

    Args:
        network: pipes, placed in the world.
        robot: parameters.
        timestep: s.
        wall_tolerance: m, largest distance of the walls from the exact surface on straights and elbows.
        staves: number of staves around a pipe, instead of the one the tolerance asks for.
        looks: add visual geoms, cameras and lights; they change neither mass nor contact.
    """
    spec = new_spec("omnitrack_scene")
    spec.option.timestep = timestep
    add_walls(spec, network, tolerance=wall_tolerance, staves=staves)
    add_robot(spec, robot)
    if looks:
        from omnitrack_sim.mjcf.looks import add_cameras, add_pipe_looks, add_robot_looks

        add_robot_looks(spec, robot)
        add_pipe_looks(spec, network)
        add_cameras(spec, network)
    return spec
