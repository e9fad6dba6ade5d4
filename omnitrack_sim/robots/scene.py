"""Models of robots: in exact pipes, and alone."""

from __future__ import annotations

import operator
from functools import lru_cache, reduce
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from omnitrack_sim.pipes import Assembly
from omnitrack_sim.robots.model_sensors import add_touch
from omnitrack_sim.walls.around import add_pipes, wall_attributes
from omnitrack_sim.walls.geoms import add_plates, leave_no_log

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot, SceneOptions

PIPES = ("wall_", "relief_", "rim_", "plate_")
"""Names of the geoms of pipes, which the world carries, begin like this."""
CONTACT_TIME = 0.005
"""Time constant of contacts with the wall, s, of a robot for 160 mm."""
MAX_COMPILED = 256
"""Models of robots alone that are kept: a batch may have one for each robot."""


def scene(robot: Robot, network: Assembly, options: SceneOptions) -> mujoco.MjSpec:
    """Return a robot in exact pipes as one model, ready to compile; see ``Robot.scene``.

    Beside the robot's own sensors the model has one for each of its bodies that can touch the wall.
    """
    leave_no_log()
    spec = robot.spec()
    spec.option.timestep = options.timestep
    bodies = touching_bodies(spec)
    # Contacts as soft as MuJoCo's own let wheels sink in: they would run 2 % slower.
    soft = max(CONTACT_TIME * robot.time_scale, 2 * options.timestep)
    contact: dict[str, Any] = {"solref": [soft, 1.0]} | _touching_bits(spec)
    add_pipes(spec, network, friction=1.0, **contact)
    more = [end for end in options.plates if end not in network.closed_ends]
    walls = wall_attributes(1.0, contact)
    del walls["rgba"]
    add_plates(spec, network, more, options.looks, **walls)
    if not options.looks:
        for body in bodies:
            add_touch(spec, body)
    return spec


def _touching_bits(spec: mujoco.MjSpec) -> dict[str, int]:
    """Return the bits with which walls touch whatever of a robot can touch anything."""
    bits = reduce(operator.or_, (g.contype | g.conaffinity for g in spec.geoms), 1)
    return {"contype": bits, "conaffinity": bits}


def touching_bodies(spec: mujoco.MjSpec) -> list[str]:
    """Return the names of the bodies of a model whose geoms can touch, in order.

    Bodies without a name get one by their number.
    """
    for i, body in enumerate(spec.bodies):
        if not body.name:
            body.name = f"body_{i}"
    bodies = spec.bodies[1:]
    return [b.name for b in bodies if any(g.contype | g.conaffinity for g in b.geoms)]


def compiled(robot: Robot) -> mujoco.MjModel:
    """Return the model of a robot alone, with the sensors that ``scene`` adds; kept for later."""
    return _compiled(robot)  # type: ignore[arg-type]  # a frozen model is hashable


@lru_cache(maxsize=MAX_COMPILED)
def _compiled(robot: Robot) -> mujoco.MjModel:
    leave_no_log()
    spec = robot.spec()
    for body in touching_bodies(spec):
        add_touch(spec, body)
    return spec.compile()


def initial_state(robot: Robot) -> mujoco.MjData:
    """Return data of the model of a robot alone, in its initial state."""
    data = mujoco.MjData(compiled(robot))
    if robot.start_qpos is not None:
        data.qpos[:] = robot.start_qpos
    mujoco.mj_kinematics(data.model, data)
    return data


def is_similar(robot: Robot, other: Robot) -> bool:
    """Return whether the parts of robots that touch the wall have the same form and density."""
    own, its = compiled(robot), compiled(other)
    factor = other.nominal_bore / robot.nominal_bore
    touching = own.geom_contype | own.geom_conaffinity > 0
    pairs = (
        (own.geom_size[touching] * factor, its.geom_size[touching]),
        (own.geom_pos[touching] * factor, its.geom_pos[touching]),
        (own.body_pos * factor, its.body_pos),
        (own.body_mass * factor**3, its.body_mass),
    )
    least = 1e-4 * min(factor, factor**3)
    return all(np.allclose(a, b, rtol=0.01, atol=least) for a, b in pairs)
