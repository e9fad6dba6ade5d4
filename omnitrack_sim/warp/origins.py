"""Origins of worlds: single precision counts from a place in the pipes near the robot."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.warp.walls import Walls

FAR = 1.0
"""Distance from its origin, m, from which on a robot gets a new one: so near, the last digit of a
position is 0.1 um."""
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
wp.set_module_options({"enable_backward": False})


@wp.kernel
def _move_origins(
    far: float,
    addresses: wp.array(dtype=int),
    qpos: wp.array2d(dtype=float),
    origins: wp.array(dtype=wp.vec3d),
):
    world = wp.tid()
    a = addresses[0]
    moved = wp.vec3(qpos[world, a], qpos[world, a + 1], qpos[world, a + 2])
    if wp.length_sq(moved) < far * far:
        return
    # Numbers with few digits, so that all positions move by the same to the last bit.
    for k in range(3):
        moved[k] = wp.round(moved[k] * 8.0) / 8.0
    origins[world] = origins[world] + wp.vec3d(
        wp.float64(moved[0]), wp.float64(moved[1]), wp.float64(moved[2])
    )
    for i in range(addresses.shape[0]):
        for k in range(3):
            qpos[world, addresses[i] + k] = qpos[world, addresses[i] + k] - moved[k]


def set_origins(m: mjw.Model, d: mjw.Data, origins: ArrayLike) -> None:
    """Say where the origin of each world's positions lies in the pipes.

    Positions in single precision have seven digits: 10 m from the origin a contact is off by
    micrometres, and a turn ends elsewhere. Worlds of one model may be in different parts of its
    pipes, or in different pipes. States are not changed: ``qpos`` counts from the new origin.

    Args:
        m: model of ``put_model``.
        d: its data.
        origins: (nworld, 3) or (3,) m, frame of the pipes.

    Raises:
        InputError: another number of origins, or a robot that is not free to be placed.
    """
    walls = _walls_of(m)
    values = np.asarray(origins, float)
    if values.shape not in ((3,), (d.nworld, 3)) or not np.isfinite(values).all():
        problem = f"has the shape {values.shape}; (3,) or ({d.nworld}, 3) is needed, in metres"
        raise InputError(Fault("origins", problem))
    walls.origins = wp.array(np.broadcast_to(values, (d.nworld, 3)).copy(), dtype=wp.vec3d)


def recentre(m: mjw.Model, d: mjw.Data, far: float = FAR) -> None:
    """Move the origins of worlds whose robot is far from them to near the robot.

    Positions in ``qpos`` change by as much, and nothing else does. A CUDA graph may hold it. The
    first free body decides; bodies that hang on the world by other joints stay where they are, so
    there must be none.

    Args:
        m: model of ``put_model``.
        d: its data.
        far: m.

    Raises:
        InputError: a body of the model hangs on the world by a joint that is not free.
    """
    walls = _walls_of(m)
    if walls.free is None:
        problem = "has a joint between the world and a body that is not free: its origin is fixed"
        raise InputError(Fault("model", problem))
    if walls.origins is None:
        walls.origins = wp.zeros(d.nworld, dtype=wp.vec3d)
    wp.launch(_move_origins, d.nworld, inputs=[far, walls.free, d.qpos, walls.origins])


def _walls_of(m: mjw.Model) -> Walls:
    walls = m.callback.contactfilter
    if not isinstance(walls, Walls):
        raise InputError(Fault("m", "has no exact walls: ot.warp.put_model puts a model with them"))
    return walls
