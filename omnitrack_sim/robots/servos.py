"""Servos that are too stiff for the inertia that they drive."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from omnitrack_sim.base.text import listed

MAX_RATIO = 10.0
"""Velocity gain times the time step over the inertia, up to which contacts see the servo hold.

MuJoCo finds contact forces before its implicit integration has a servo act, as if the joint turned
freely. A wheel of a robot that speeds up by 0.1 m/s² then slips by 0.2 mm/s at 8, 2 mm/s at 40 and
59 mm/s at 250 (six wheels of 25 mm, elliptic cones, a step of 2 ms)."""
_SCALAR = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_ON_JOINTS = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT


def stiff_servos(model: mujoco.MjModel, timestep: float) -> Iterator[tuple[str, float, float]]:
    """Yield joints whose servos are stiffer than ``MAX_RATIO``.

    Args:
        model: of a robot.
        timestep: s, of the physics.

    Yields:
        Name of the joint, its ratio, and the inertia, kg m² or kg, with which it would be right.
    """
    scalar = np.isin(model.jnt_type, [int(kind) for kind in _SCALAR])
    for joint in map(int, np.flatnonzero(scalar)):
        dof = model.jnt_dofadr[joint]
        gain = model.dof_damping[dof] + _velocity_gain(model, joint)
        inertia = model.dof_M0[dof]
        if gain * timestep > MAX_RATIO * inertia:
            yield model.joint(joint).name, gain * timestep / inertia, gain * timestep / MAX_RATIO


def _velocity_gain(model: mujoco.MjModel, joint: int) -> float:
    """Return by how much the actuators of a joint brake it, N m s/rad or N s/m."""
    on_joints = np.isin(model.actuator_trntype, [int(kind) for kind in _ON_JOINTS])
    drives = on_joints & (model.actuator_trnid[:, 0] == joint)
    gains = -model.actuator_biasprm[:, 2] * model.actuator_gear[:, 0] ** 2
    return float(gains[drives].clip(min=0.0).sum())


def servo_notes(model: mujoco.MjModel, timestep: float) -> Iterator[str]:
    """Yield a remark on the joints whose servos are too stiff for their inertia."""
    stiff = list(stiff_servos(model, timestep))
    if not stiff:
        return
    names = listed([f"{name!r}" for name, _, _ in stiff], 200)
    ratio, least = max(r for _, r, _ in stiff), max(i for _, _, i in stiff)
    yield (
        f"servos of {names} are up to {ratio:.3g} times stiffer than contacts can follow at a step "
        f"of {timestep:.3g} s: wheels slip more than they should while a robot speeds up. Give "
        f"these joints the inertia of their motor and gears (armature), {least:.2g} or more, or "
        "lower gain or physics.timestep"
    )
