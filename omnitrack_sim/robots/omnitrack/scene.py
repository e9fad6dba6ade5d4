"""A scenario as one MuJoCo model: walls, robot and, for pictures, looks."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from omnitrack_sim.pipes import Assembly
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.walls.geoms import TIMESTEP, add_exact_walls, add_plates, add_walls, new_spec
from omnitrack_sim.walls.guard import add_guard

SLEEP_FROM = 1000
"""Number of geoms from which it pays to have MuJoCo pass over the walls, which needs an MjData for
each robot: a step no longer costs 9 ns for each wall piece, and states do not change."""


def build_scene(
    robot: Omnitrack,
    network: Assembly,
    *,
    plates: Sequence[tuple[int, str]] = (),
    timestep: float = TIMESTEP,
    wall_tolerance: float = 1e-4,
    staves: int | None = None,
    exact: bool = False,
    looks: bool = False,
) -> mujoco.MjSpec:
    """The robot at the world's origin and the walls of a network, ready to compile.

    Args:
        network: pipes, placed in the world.
        robot: parameters.
        plates: ports (part index, port) that are closed by a plate.
        timestep: s.
        wall_tolerance: m, largest distance of the walls from the exact surface on all but tees.
        staves: number of wall pieces around a bore, instead of what the tolerance asks for.
        exact: one geom a fitting and a line without gaps a track, for the compiled collider;
            ``wall_tolerance`` and ``staves`` then mean nothing.
        looks: add visual geoms, cameras and lights; they change neither mass nor contact.
    """
    spec = new_spec("omnitrack_scene")
    spec.option.timestep = timestep
    if exact:
        add_exact_walls(spec, network)
        add_guard(spec)
    else:
        add_walls(spec, network, tolerance=wall_tolerance, staves=staves)
    add_plates(spec, network, plates, looks)
    # The compiled collider takes a row of lugs as one line; walls of primitives need each lug.
    add_robot(spec, robot, line_tracks=exact)
    if looks:
        from omnitrack_sim.robots.omnitrack.looks import add_robot_looks
        from omnitrack_sim.walls.pipe_looks import add_cameras, add_pipe_looks

        add_robot_looks(spec, robot)
        add_pipe_looks(spec, network)
        add_cameras(spec, network, spec.body("chassis"), robot.scale)
    # MuJoCo does not let a model sleep in which tendons are tied, as those of shared motors are.
    if len(spec.geoms) >= SLEEP_FROM and drive_of(robot.drive).direct:
        spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        spec.body("chassis").sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER  # only walls sleep
    return spec


def build_looks(
    network: Assembly,
    robot: Omnitrack,
    plates: Sequence[tuple[int, str]] = (),
    coarse: bool = True,
) -> mujoco.MjSpec:
    """The robot, and the plates that close ports of a network, as they are seen: without walls.

    The joints are those of ``build_scene``; ``coarse`` as in ``add_robot_looks``.
    """
    from omnitrack_sim.robots.omnitrack.looks import add_robot_looks

    spec = new_spec("omnitrack_looks")
    add_plates(spec, network, plates, looks=True)
    add_robot(spec, robot)
    add_robot_looks(spec, robot, coarse)
    return spec
