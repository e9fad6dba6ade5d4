"""Units of the inputs, forces and speeds of a model's actuators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import mujoco

_TRN, _JOINT = mujoco.mjtTrn, mujoco.mjtJoint
_TURNING = {"actuator_force": "N m", "actuator_velocity": "rad/s", "position": "rad"}
_SLIDING = {"actuator_force": "N", "actuator_velocity": "m/s", "position": "m"}


def actuator_units(model: mujoco.MjModel) -> dict[str, str]:
    """Return the units of ``ctrl``, ``actuator_force`` and ``actuator_velocity``.

    One each where all actuators are of one kind, else all that there are: "N, N m". An input of a
    servo is the position or speed that it is asked for; of others it has the unit 1.

    Example:
        >>> import mujoco
        >>> spec = mujoco.MjSpec()
        >>> joint = spec.worldbody.add_body().add_joint(name="wheel")
        >>> _ = spec.bodies[1].add_geom(size=[0.1, 0, 0])
        >>> motor = spec.add_actuator(target="wheel", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        >>> motor.set_to_velocity(kv=1.0)
        >>> actuator_units(spec.compile())
        {'ctrl': 'rad/s', 'actuator_force': 'N m', 'actuator_velocity': 'rad/s'}
    """
    kinds = [_TURNING if _turns(model, i) else _SLIDING for i in range(model.nu)]
    inputs = (kind.get(_servo(model, i), "1") for i, kind in enumerate(kinds))
    names = "actuator_force", "actuator_velocity"
    outputs = {name: _joined(kind[name] for kind in kinds or (_SLIDING,)) for name in names}
    return {"ctrl": _joined(inputs) or "1", **outputs}


def _joined(units: Iterable[str]) -> str:
    return ", ".join(sorted(set(units)))


def _turns(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether the length of an actuator is an angle."""
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind in (_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT):
        return _joint_turns(model, target) or (
            int(model.jnt_type[target]) == _JOINT.mjJNT_FREE and _gear_turns(model, actuator)
        )
    if kind == _TRN.mjTRN_TENDON:
        joints = list(_joints_of(model, target))
        return bool(joints) and all(_joint_turns(model, joint) for joint in joints)
    return kind == _TRN.mjTRN_SITE and _gear_turns(model, actuator)


def _joint_turns(model: mujoco.MjModel, joint: int) -> bool:
    return int(model.jnt_type[joint]) in (_JOINT.mjJNT_HINGE, _JOINT.mjJNT_BALL)


def _gear_turns(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator of a free joint or a site turns it, and does not push."""
    gear = model.actuator_gear[actuator]
    return bool(gear[3:].any() and not gear[:3].any())


def _joints_of(model: mujoco.MjModel, tendon: int) -> Iterator[int]:
    """Yield the joints of a fixed tendon; of one along sites and geoms there are none."""
    first = int(model.tendon_adr[tendon])
    for i in range(first, first + int(model.tendon_num[tendon])):
        if int(model.wrap_type[i]) == mujoco.mjtWrap.mjWRAP_JOINT:
            yield int(model.wrap_objid[i])


def _servo(model: mujoco.MjModel, actuator: int) -> str:
    """Return what an actuator is asked for: a position, a speed, or "" of others."""
    gain = float(model.actuator_gainprm[actuator, 0])
    _, position, speed = model.actuator_biasprm[actuator, :3].tolist()
    is_servo = (
        int(model.actuator_gaintype[actuator]) == mujoco.mjtGain.mjGAIN_FIXED
        and int(model.actuator_biastype[actuator]) == mujoco.mjtBias.mjBIAS_AFFINE
        and gain != 0
    )
    if is_servo and position == -gain:
        # An integrator before it makes a position of a speed.
        integrates = int(model.actuator_dyntype[actuator]) == mujoco.mjtDyn.mjDYN_INTEGRATOR
        return "actuator_velocity" if integrates else "position"
    return "actuator_velocity" if is_servo and position == 0 and speed == -gain else ""
