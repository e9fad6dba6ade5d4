"""Numbers of the joints, geoms and actuators of a model file, as keys of a scenario.

``robot.joint.front.stiffness`` is the stiffness of the joint ``front``, by MJCF's own words; a
pattern such as ``wheel_*`` in the place of a name stands for all that it fits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import counted, shown

MAX_VALUE, MIN_SIZE = 1e12, 1e-6
"""Size of a number, and of a geom, m, beyond and below which it is a slip."""
Number = float | tuple[float, ...]
Values = Mapping[str, Any]
Elements = dict[str, dict[str, Any]]
"""Values, each a number or a tuple of numbers, by the names of the elements and their own."""
_Hinge, _Slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_JOINT_UNITS = {
    _Hinge: {
        "stiffness": "N m/rad",
        "springref": "rad",
        "damping": "N m s/rad",
        "armature": "kg m²",
        "frictionloss": "N m",
    },
    _Slide: {
        "stiffness": "N/m",
        "springref": "m",
        "damping": "N s/m",
        "armature": "kg",
        "frictionloss": "N",
    },
}
_GEOM_UNITS = {"size": "m", "mass": "kg", "density": "kg/m³"}
_ACTUATOR_UNITS = {
    _Hinge: {"kp": "N m/rad", "kv": "N m s/rad", "gear": "1"},
    _Slide: {"kp": "N/m", "kv": "N s/m", "gear": "1"},
}
_SIZES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: 1,
    mujoco.mjtGeom.mjGEOM_CAPSULE: 2,
    mujoco.mjtGeom.mjGEOM_CYLINDER: 2,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: 3,
    mujoco.mjtGeom.mjGEOM_BOX: 3,
}
"""Numbers of the size of a geom; of a mesh there are none."""


@dataclass(frozen=True)
class _Kind:
    """A kind of element.

    Attributes:
        elements: of a model.
        read: returns the numbers of an element that may be set, by name.
        write: sets some of them.
        units: returns the units of the numbers of an element.
    """

    elements: Callable[[mujoco.MjSpec], list[Any]]
    read: Callable[[Any], dict[str, Number]]
    write: Callable[[Any, Values], None]
    units: Callable[[mujoco.MjSpec, Any], Mapping[str, str]]


def values_of(spec: mujoco.MjSpec, kind: str) -> Elements:
    """Return the numbers of the named elements of a kind, by name: ``KINDS``."""
    own = KINDS[kind]
    found = {one.name: own.read(one) for one in own.elements(spec) if one.name}
    return {name: values for name, values in found.items() if values}


def with_changes(known: Elements, changes: Mapping[str, Values]) -> Elements:
    """Return all values of elements, some of them changed by names or patterns.

    Args:
        known: values of all elements.
        changes: by the names of elements, or patterns; where several fit, the last one counts.

    Raises:
        InputError: a name, or a value of it, that there is not, or a number that cannot be; its
            place is a path below the table of the elements.
    """
    result = {name: dict(values) for name, values in known.items()}
    for pattern, values in changes.items():
        names = [pattern] if pattern in known else [n for n in known if fnmatchcase(n, pattern)]
        if not names:
            raise InputError(Fault(pattern, "fits no name", tuple(known), pattern))
        for key, value in values.items():
            fitting = [name for name in names if key in known[name]]
            place = f"{pattern}.{key}"
            if not fitting:
                choices = tuple(dict.fromkeys(key for name in names for key in known[name]))
                raise InputError(Fault(place, "unknown key", choices, key))
            for name in fitting:
                result[name][key] = _checked(value, known[name][key], key, place)
    return result


def _checked(value: Any, present: Number, key: str, where: str) -> Number:
    """Return a value that may take the place of one."""
    if isinstance(present, tuple):
        if not isinstance(value, tuple | list) or len(value) != len(present):
            wanted = counted(len(present), "number")
            raise InputError(Fault(where, f"is {shown(value)}; it must be a list of {wanted}"))
        return tuple(_number(one, key, f"{where}.{i}") for i, one in enumerate(value))
    return _number(value, key, where)


def _number(value: Any, key: str, where: str) -> float:
    least = {"size": MIN_SIZE, "springref": -MAX_VALUE, "gear": -MAX_VALUE}.get(key, 0.0)
    if type(value) not in (int, float) or not least <= value <= MAX_VALUE:
        problem = f"is {shown(value)}; it must be a number from {least:g} to {MAX_VALUE:g}"
        raise InputError(Fault(where, problem))
    return float(value)


def apply(spec: mujoco.MjSpec, kind: str, wanted: Elements) -> None:
    """Set the values of a kind of elements in a model where they are other ones."""
    own = KINDS[kind]
    for element in own.elements(spec):
        present = own.read(element)
        asked = wanted.get(element.name, {})
        changed = {key: value for key, value in asked.items() if value != present.get(key)}
        if changed:
            own.write(element, changed)


def unit_of(spec: mujoco.MjSpec, kind: str, name: str, key: str) -> str | None:
    """Return the unit of a value of all elements that a name or pattern fits.

    None where they have none, or not the same.
    """
    own = KINDS[kind]
    units = {
        own.units(spec, one).get(key)
        for one in own.elements(spec)
        if one.name == name or fnmatchcase(one.name, name)
    }
    found = {unit for unit in units if unit is not None}
    return found.pop() if len(found) == 1 else None


# Joints


def _read_joint(joint: Any) -> dict[str, Number]:
    if joint.type not in _JOINT_UNITS:
        return {}
    return {
        "stiffness": float(joint.stiffness[0]),
        "springref": _in_radians(joint, float(joint.springref)),
        "damping": float(joint.damping[0]),
        "armature": float(joint.armature),
        "frictionloss": float(joint.frictionloss),
    }


def _write_joint(joint: Any, values: Values) -> None:
    for key, value in values.items():
        assert isinstance(value, float)
        if key in ("stiffness", "damping"):
            getattr(joint, key)[0] = value
        elif key == "springref" and _is_in_degrees(joint):
            joint.springref = math.degrees(value)
        else:
            setattr(joint, key, value)


def _is_in_degrees(joint: Any) -> bool:
    return bool(joint.type == _Hinge and joint.compiler.degree)


def _in_radians(joint: Any, value: float) -> float:
    return math.radians(value) if _is_in_degrees(joint) else value


# Geoms


def _read_geom(geom: Any) -> dict[str, Number]:
    count = _SIZES.get(geom.type, 0)
    if np.isfinite(geom.fromto).all():
        count = min(count, 1)  # how long it is, its two ends say
    size = tuple(geom.size[:count].tolist())
    by_mass = bool(np.isfinite(geom.mass))
    own = {"mass": float(geom.mass)} if by_mass else {"density": float(geom.density)}
    return ({"size": size} if size else {}) | own


def _write_geom(geom: Any, values: Values) -> None:
    for key, value in values.items():
        if isinstance(value, tuple):
            geom.size[: len(value)] = value
        else:
            setattr(geom, key, value)


# Actuators


def _read_actuator(actuator: Any) -> dict[str, Number]:
    """Gains of a servo of a position or speed, and the gear of those that drive a joint."""
    gain, (_, position, speed) = float(actuator.gainprm[0]), actuator.biasprm[:3].tolist()
    values: dict[str, Number] = {}
    is_servo = (
        actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
    )
    if is_servo and position == -gain:
        values["kp"] = gain
        # A ratio of the critical damping stands there with the other sign until it is compiled.
        if speed <= 0:
            values["kv"] = -speed
    elif is_servo and position == 0 and speed == -gain:
        values["kv"] = gain
    if actuator.trntype in (
        mujoco.mjtTrn.mjTRN_JOINT,
        mujoco.mjtTrn.mjTRN_JOINTINPARENT,
        mujoco.mjtTrn.mjTRN_TENDON,
    ):
        values["gear"] = float(actuator.gear[0])
    return values


def _write_actuator(actuator: Any, values: Values) -> None:
    of_position = "kp" in _read_actuator(actuator)
    for key, value in values.items():
        if key == "gear":
            actuator.gear[0] = value
        elif key == "kp":
            actuator.gainprm[0], actuator.biasprm[1] = value, -value
        else:
            actuator.biasprm[2] = -value
            if not of_position:
                actuator.gainprm[0] = value


def _actuator_units(spec: mujoco.MjSpec, actuator: Any) -> Mapping[str, str]:
    """Those of the joint that it drives; of a tendon or the like they are not known."""
    kinds = {joint.name: joint.type for joint in spec.joints}
    kind = kinds.get(actuator.target)
    known = _ACTUATOR_UNITS.get(kind, {"gear": "1"}) if kind is not None else {"gear": "1"}
    return {key: unit for key, unit in known.items() if key in _read_actuator(actuator)}


KINDS = {
    "joint": _Kind(
        lambda spec: list(spec.joints),
        _read_joint,
        _write_joint,
        lambda _, joint: _JOINT_UNITS.get(joint.type, {}),
    ),
    "geom": _Kind(
        lambda spec: list(spec.geoms),
        _read_geom,
        _write_geom,
        lambda _, geom: {key: _GEOM_UNITS[key] for key in _read_geom(geom)},
    ),
    "actuator": _Kind(
        lambda spec: list(spec.actuators), _read_actuator, _write_actuator, _actuator_units
    ),
}
"""Kinds of elements by the keys of a robot's table."""
