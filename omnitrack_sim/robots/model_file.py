"""A robot alone from a model that was made for a world of its own: MJCF, or URDF.

Models come with a floor, lights and things to push, and often with a base that stands on the world.
Here the pipes are the world: what else belongs to it is left out, and the robot is set free.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.bounds import MAX_MODEL_TEXT
from omnitrack_sim.base.reading import read_bytes
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import clipped, listed
from omnitrack_sim.robots.model_sensors import actuator_names
from omnitrack_sim.walls.geoms import set_numerics
from omnitrack_sim.walls.model_bounds import read_spec

MAX_EXTENT = 20.0
"""Longest side of a robot, m, beyond which its lengths are taken for millimetres: its pipe would be
wider than any that is built."""
MAX_QUOTED = 160
"""Letters of a line of the file that a message quotes."""
READABLE_MESHES = (".obj", ".stl", ".msh")
"""Files of meshes that MuJoCo reads."""

POINT_RADIUS, LEAST_INERTIA = 1e-3, 1e-12
"""Radius of gyration, m, of a mass whose inertia a file leaves at zero; and the least inertia,
kg m², that it gets: a thousand times what MuJoCo takes for nothing."""

_Kind = mujoco.mjtObj
_Reference = tuple[mujoco.mjtObj, str]
"""Kind and name of an element that another one refers to."""
_NEEDED = {
    "contact": mujoco.mjtDisableBit.mjDSBL_CONTACT,
    "constraint": mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    "gravity": mujoco.mjtDisableBit.mjDSBL_GRAVITY,
}
"""Physics without which a robot would pass through walls, or float in its pipe."""
_HINTS = (
    ("'mujocoinclude'", "it is a part of a model: name the file that includes it"),
    ("model type", "MJCF begins with <mujoco>, URDF with <robot>"),
    ("larger than mjMINVAL", "what moves needs a mass: a geom with a density, or <inertial>"),
    ("positive eigenvalues", "an <inertial> of no mass is to be left out"),
    ("opening file", "meshes are looked for beside the model, and in the folders above it"),
    ("no decoder found", f"MuJoCo reads meshes of {', '.join(READABLE_MESHES)}"),
)
"""What MuJoCo's words ask for, by a part of them."""
_XACRO = "it is a macro: `xacro IN > OUT.urdf` makes a URDF of it"


@dataclass(frozen=True)
class RobotModel:
    """A robot alone, ready to compile.

    Attributes:
        spec: the model.
        root: name of the body that carries the others, with a free joint.
        changes: what was left out or changed, in words; none where the file is a robot alone.
        keyframes: names of the states that the file has saved, see ``keyframe``.
    """

    spec: mujoco.MjSpec
    root: str
    changes: tuple[str, ...]
    keyframes: tuple[str, ...]

    @property
    def drivable(self) -> tuple[str, ...]:
        """Names of the joints that a motor can drive."""
        kinds = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
        return tuple(j.name for j in self.spec.joints if j.name and j.type in kinds)


class AmbiguousRootError(ValueError):
    """Several bodies of a model could be the robot."""


def robot_model(file: str, body: str = "") -> RobotModel:
    """Read the robot of a model file.

    Args:
        file: MJCF or URDF.
        body: a body of the robot; "" where the file tells which tree of bodies is meant: the only
            one that has actuators, or joints.

    Raises:
        AmbiguousRootError: it does not tell.
        ValueError: there is no such model or body, or it cannot be set free.
    """
    changes: list[str] = []
    spec = _read(file, changes)
    keyframes = tuple(key.name for key in spec.keys if key.name)
    root = _root(spec, body)
    root.name = root.name or _unique("chassis", spec.bodies)
    changes += _leave_out_world(spec, root)
    changes += _set_free(spec, root)
    changes += _enable_physics(spec)
    # Else the compiler does, and the bodies that sensors were added for are gone.
    if spec.compiler.fusestatic:
        spec.fuse_static()
    if body and spec.body(body) is None:
        raise ValueError(f"{body!r} is fixed to another body, of which it becomes a part")
    return RobotModel(spec, root.name, tuple(changes), keyframes)


def keyframe(file: str, name: str, model: mujoco.MjModel) -> tuple[Array, Array]:
    """Return joint positions (nq,) and control inputs (nu,) of a state that a file has saved.

    The joint that carries the robot stays where it is in the model.

    Args:
        file: MJCF.
        name: of the keyframe.
        model: of the robot alone.
    """
    whole = read_spec(Path(file)).compile()
    key, qpos, ctrl = whole.key(name), model.qpos0.copy(), np.zeros(model.nu)
    for i in range(whole.njnt):
        joint = whole.joint(i)
        own = mujoco.mj_name2id(model, _Kind.mjOBJ_JOINT, joint.name) if joint.name else -1
        if own >= 0 and joint.type[0] != mujoco.mjtJoint.mjJNT_FREE:
            model_joint = model.joint(own)
            size = len(model_joint.qpos0)
            first = model_joint.qposadr[0]
            qpos[first : first + size] = key.qpos[joint.qposadr[0] :][:size]
    names = actuator_names(whole)
    for i, actuator in enumerate(actuator_names(model)):
        ctrl[i] = key.ctrl[names.index(actuator)] if actuator in names else 0.0
    return qpos, ctrl


def check_robot(model: mujoco.MjModel) -> None:
    """Refuse a robot that cannot be in a pipe.

    Args:
        model: of the robot alone, compiled.

    Raises:
        ValueError: nothing of it can touch a wall, or it is larger than any pipe.
    """
    touching = (model.geom_contype | model.geom_conaffinity) > 0
    if not touching.any():
        hint = "what does has contype='1' in MJCF, and a <collision> in URDF"
        raise ValueError(f"nothing of it can touch a wall: {hint}")
    fields = np.flatnonzero(touching & (model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD))
    if len(fields):
        name = model.geom(fields[0]).name
        raise ValueError(f"geom {name!r} is a height field, which meets no wall: take a mesh")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places, reach = data.geom_xpos[touching], model.geom_rbound[touching, None]
    size = float(((places + reach).max(axis=0) - (places - reach).min(axis=0)).max())
    if size > MAX_EXTENT:
        problem = f"it is {size:.4g} m long: is it in millimetres?"
        raise ValueError(f"{problem} MuJoCo takes metres (meshes have scale='0.001 0.001 0.001')")


def in_words(error: Exception, file: str) -> str:
    """Return what MuJoCo says of a file, on one line, with what to do about it."""
    if isinstance(error, OSError) and error.strerror:
        return f"cannot be read: {error.strerror}"
    words = " ".join(str(error).split()).removeprefix("XML ").removeprefix("Error: ")
    words = words.removeprefix("Error: ").removeprefix("error: ")
    words = re.sub(r" Element name '', id \d+(, line \d+)?", r"\1", words)
    words = re.sub(r"'/[^']*/([^'/]+)'", r"'\1'", words)  # a mesh by its name, not all of its path
    words = f"{'the ' if words[:2].isupper() else ''}{words}{_quoted(words, file)}"
    hints = [hint for part, hint in _HINTS if part in words]
    if _has_macros(file):
        hints = [_XACRO]
    return "; ".join([words, *hints[:1]])


def _quoted(words: str, file: str) -> str:
    """Return the line of a file that a message is about, to stand behind it; "" if it has none."""
    place = re.search(r"Element '(\w+)', line (\d+)", words)
    if place is None:
        return ""
    lines = _text(file).splitlines()[int(place[2]) - 1 :]
    line = lines[0].strip() if lines else ""
    return f": {clipped(line, MAX_QUOTED)}" if f"<{place[1]}" in line else ""


def _has_macros(file: str) -> bool:
    """Return whether a file is one that ROS makes a URDF of."""
    return "<xacro:" in _text(file)


def _text(file: str) -> str:
    """Return the text of a file for a message on it; "" where it cannot be read."""
    try:
        return read_bytes(file, MAX_MODEL_TEXT).decode(errors="replace")
    except (OSError, ValueError):
        return ""


def _read(file: str, changes: list[str]) -> mujoco.MjSpec:
    """Read a file as a specification whose meshes are found."""
    spec = read_spec(Path(file))
    if Path(file).suffix.lower() == ".urdf":
        changes += _mend_urdf(spec, Path(file).resolve().parent)
    return spec


# URDF


def _mend_urdf(spec: mujoco.MjSpec, folder: Path) -> Iterator[str]:
    """Take what other readers of URDF take: paths of packages, and inertias that cannot be."""
    if not spec.authored.option:
        set_numerics(spec.option)
    for mesh in spec.meshes:
        mesh.file = _mesh_path(mesh.file, folder)
    impossible = [body for body in spec.bodies[1:] if not _is_possible(body)]
    for body in impossible:
        _mend_inertia(body)
    if impossible:
        spec.compiler.balanceinertia = True
        names = listed([body.name for body in impossible], 100)
        yield f"inertias that no body has were changed, of {names}"


def _mesh_path(file: str, folder: Path) -> str:
    """Return the path of a mesh, of a package that lies in one of the folders above as well."""
    scheme, colon, path = file.partition("://")
    path = path.lstrip("/") if colon and scheme in ("package", "model") else file
    for place in (folder, *folder.parents):
        if (place / path).is_file():
            return str(place / path)
    if colon:
        raise ValueError(f"mesh {file!r} is in none of the folders above the model")
    return file


def _is_possible(body: mujoco.MjsBody) -> bool:
    """Return whether a body has a mass, and the principal moments of inertia of some mass."""
    if not body.explicitinertial:
        return True
    a, b, c = _moments(body)
    return bool(body.mass > 0 and a > LEAST_INERTIA / 2 and a + b >= c)


def _moments(body: mujoco.MjsBody) -> Array:
    """Return the principal moments (3,) kg m² that a URDF states, the least first."""
    xx, yy, zz, xy, xz, yz = np.nan_to_num(body.fullinertia)
    return np.asarray(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), float)


def _mend_inertia(body: mujoco.MjsBody) -> None:
    """Take a body without extent as a small one, and one without mass for what its geoms are."""
    if body.mass <= 0:
        # MuJoCo asks the geoms where there is no place of an inertia.
        body.explicitinertial = False
        body.ipos, body.fullinertia = np.full(3, np.nan), np.full(6, np.nan)
    elif _moments(body)[0] <= LEAST_INERTIA / 2:
        own = max(body.mass * POINT_RADIUS**2, LEAST_INERTIA)
        body.fullinertia = [own, own, own, 0.0, 0.0, 0.0]


# The robot among the bodies of the world


def _root(spec: mujoco.MjSpec, body: str) -> mujoco.MjsBody:
    """Return the body of the world that carries the robot."""
    roots = [root for root in spec.worldbody.bodies if not root.mocap]
    if body:
        return _root_of(spec, body)
    driven = _driven(spec)
    moved = [root for root in roots if not driven.isdisjoint(_references_to(root))]
    if len(moved) > 1:
        # Of doors and turntables with motors a robot differs in that it can go away.
        moved = [root for root in moved if any(map(_is_free, root.joints))] or moved
    roots = moved or [root for root in roots if _all(root, _Kind.mjOBJ_JOINT)] or roots
    if not roots:
        raise ValueError("there is no body that could be the robot, but the world's own geoms")
    if len(roots) > 1:
        names = listed([root.name or "(without a name)" for root in roots], 200)
        problem = f"{len(roots)} bodies of the world could be the robot: {names}"
        raise AmbiguousRootError(f"{problem}; name the one that is, as robot.body")
    return roots[0]


def _root_of(spec: mujoco.MjSpec, body: str) -> mujoco.MjsBody:
    """Return the body of the world that a body of this name is or hangs on."""
    place = spec.body(body)
    if place is None or place.name == spec.worldbody.name:
        names = listed([other.name for other in spec.bodies[1:] if other.name])
        raise ValueError(f"there is no body {body!r} (choose from: {names})")
    while place.parent.name != spec.worldbody.name:
        place = place.parent
    if place.mocap:
        raise ValueError(f"{place.name!r} is a mocap body, which physics does not move")
    return place


def _driven(spec: mujoco.MjSpec) -> set[_Reference]:
    """Return what actuators act on, and what the tendons run along that they pull."""
    driven = {target for actuator in spec.actuators for target in _targets(actuator)}
    pulled = [t for t in spec.tendons if (_Kind.mjOBJ_TENDON, t.name) in driven]
    return driven.union(*map(_wrapped, pulled)) - {(_Kind.mjOBJ_SITE, "")}


def _is_free(joint: mujoco.MjsJoint) -> bool:
    return joint.type == mujoco.mjtJoint.mjJNT_FREE


def _all(body: mujoco.MjsBody, kind: mujoco.mjtObj) -> list[Any]:
    """Return all elements of a kind on a body and on what hangs on it."""
    own = {
        _Kind.mjOBJ_JOINT: body.joints,
        _Kind.mjOBJ_GEOM: body.geoms,
        _Kind.mjOBJ_SITE: body.sites,
        _Kind.mjOBJ_CAMERA: body.cameras,
        _Kind.mjOBJ_LIGHT: body.lights,
        _Kind.mjOBJ_BODY: [body],
    }[kind]
    return [*own, *(one for child in body.bodies for one in _all(child, kind))]


def _references_to(body: mujoco.MjsBody) -> set[_Reference]:
    """Return how others refer to a body, to what hangs on it, and to what these carry."""
    return {(kind, one.name) for kind in _PLACED for one in _all(body, kind) if one.name}


_PLACED = {
    _Kind.mjOBJ_BODY: "body",
    _Kind.mjOBJ_JOINT: "joint",
    _Kind.mjOBJ_GEOM: "geom",
    _Kind.mjOBJ_SITE: "site",
    _Kind.mjOBJ_CAMERA: "camera",
    _Kind.mjOBJ_LIGHT: "light",
}
"""Kinds of elements that stand in the tree of bodies, in words."""


def _leave_out_world(spec: mujoco.MjSpec, root: mujoco.MjsBody) -> Iterator[str]:
    """Remove what stands in the world beside the robot, and what refers to it."""
    others = [body for body in spec.worldbody.bodies if body.name != root.name]
    own = _of_world(spec)
    gone = {(_kind_of(one), one.name) for one in own if one.name}
    gone = gone.union(*map(_references_to, others))
    told = [_in_words(_PLACED[_kind_of(one)], one.name) for one in (*own, *others)]
    _touch_as_by_pairs(spec, gone)
    if told:
        told += _drop_references(spec, gone)
        yield f"left out, as the pipes are the world: {listed(list(dict.fromkeys(told)), 400)}"
    for one in (*_of_world(spec), *others):  # a camera may have gone with the body it looks at
        spec.delete(one)
    for texture in list(spec.textures):
        if texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            spec.delete(texture)


def _touch_as_by_pairs(spec: mujoco.MjSpec, gone: set[_Reference]) -> None:
    """Have geoms touch the walls that touch the world's own geoms by pairs alone."""
    for pair in spec.pairs:
        names = pair.geomname1, pair.geomname2
        own = [name for name in names if (_Kind.mjOBJ_GEOM, name) not in gone]
        if len(own) == 1:
            spec.geom(own[0]).contype |= 1


def _of_world(spec: mujoco.MjSpec) -> list[Any]:
    """Return what the world's own body carries beside other bodies."""
    world = spec.worldbody
    return [*world.geoms, *world.lights, *world.cameras, *world.sites]


def _kind_of(element: Any) -> mujoco.mjtObj:
    """Return the kind of an element that stands in the tree of bodies."""
    name = type(element).__name__.removeprefix("Mjs").upper()
    return getattr(_Kind, f"mjOBJ_{name}")


def _in_words(kind: str, name: str) -> str:
    return f"{kind} {name!r}" if name else f"unnamed {kind}"


def _set_free(spec: mujoco.MjSpec, root: mujoco.MjsBody) -> Iterator[str]:
    """Give the robot a free joint, in the place of joints that let it move in the world."""
    joints = list(root.joints)
    if any(map(_is_free, joints)):
        return
    names = [joint.name or "a joint" for joint in joints]
    references = {(_Kind.mjOBJ_JOINT, joint.name) for joint in joints if joint.name}
    driven = sorted(name for _, name in references & _driven(spec))
    if driven:
        problem = f"{root.name!r} hangs on the world by the joint {driven[0]!r}, which is driven"
        hint = "hang it on a body with <freejoint/>, that of the robot's chassis"
        raise ValueError(f"{problem}: {hint}")
    dropped = _drop_references(spec, references)
    for joint in joints:
        spec.delete(joint)
    root.add_freejoint(name=_unique(f"{root.name}_free", spec.joints))
    # Positions that a file has saved are those of other joints.
    for key in list(spec.keys):
        spec.delete(key)
    instead = f" in the place of {listed(names, 100)}" if names else ""
    without = f", without {listed(dropped, 100)}" if dropped else ""
    yield f"a free joint was put on {root.name!r}{instead}{without}"


def _unique(name: str, others: Iterable[Any]) -> str:
    """Return a name that none of the others has: this one, or with a number behind it."""
    taken = {other.name for other in others}
    names = chain([name], (f"{name}_{i}" for i in count(2)))
    return next(each for each in names if each not in taken)


def _enable_physics(spec: mujoco.MjSpec) -> Iterator[str]:
    """Enable what a robot in a pipe cannot be without."""
    off = [name for name, flag in _NEEDED.items() if spec.option.disableflags & flag]
    for name in off:
        spec.option.disableflags &= ~int(_NEEDED[name])
    if off:
        yield f"enabled, as a pipe needs it: {', '.join(off)}"


# What refers to what


def _targets(actuator: mujoco.MjsActuator) -> Iterator[_Reference]:
    """Yield what an actuator acts on."""
    kinds = mujoco.mjtTrn
    of = {
        kinds.mjTRN_JOINT: _Kind.mjOBJ_JOINT,
        kinds.mjTRN_JOINTINPARENT: _Kind.mjOBJ_JOINT,
        kinds.mjTRN_TENDON: _Kind.mjOBJ_TENDON,
        kinds.mjTRN_SITE: _Kind.mjOBJ_SITE,
        kinds.mjTRN_SLIDERCRANK: _Kind.mjOBJ_SITE,
        kinds.mjTRN_BODY: _Kind.mjOBJ_BODY,
    }
    if actuator.trntype in of:
        yield of[actuator.trntype], actuator.target
    yield _Kind.mjOBJ_SITE, actuator.refsite
    yield _Kind.mjOBJ_SITE, actuator.slidersite


def _wrapped(tendon: mujoco.MjsTendon) -> Iterator[_Reference]:
    """Yield what a tendon runs along."""
    for wrap in tendon.path:
        if wrap.target is not None:
            yield _kind_of(wrap.target), wrap.target.name


def _measured(sensor: mujoco.MjsSensor) -> Iterator[_Reference]:
    """Yield what a sensor is of, and relative to."""
    for kind, name in ((sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)):
        yield (_Kind.mjOBJ_BODY if kind == _Kind.mjOBJ_XBODY else kind), name


_REFERRING: tuple[
    tuple[str, mujoco.mjtObj, str, Callable[[Any], Iterable[_Reference]]],
    ...,
] = (
    ("tendons", _Kind.mjOBJ_TENDON, "tendon", _wrapped),
    ("actuators", _Kind.mjOBJ_ACTUATOR, "actuator", _targets),
    (
        "equalities",
        _Kind.mjOBJ_EQUALITY,
        "equality",
        lambda e: ((e.objtype, e.name1), (e.objtype, e.name2)),
    ),
    (
        "pairs",
        _Kind.mjOBJ_PAIR,
        "pair of geoms",
        lambda p: ((_Kind.mjOBJ_GEOM, p.geomname1), (_Kind.mjOBJ_GEOM, p.geomname2)),
    ),
    (
        "excludes",
        _Kind.mjOBJ_EXCLUDE,
        "exclusion",
        lambda e: ((_Kind.mjOBJ_BODY, e.bodyname1), (_Kind.mjOBJ_BODY, e.bodyname2)),
    ),
    ("sensors", _Kind.mjOBJ_SENSOR, "sensor", _measured),
    ("skins", _Kind.mjOBJ_SKIN, "skin", lambda s: ((_Kind.mjOBJ_BODY, n) for n in s.bodyname)),
    ("tuples", _Kind.mjOBJ_TUPLE, "tuple", lambda t: zip(t.objtype, t.objname, strict=True)),
    ("cameras", _Kind.mjOBJ_CAMERA, "camera", lambda c: ((_Kind.mjOBJ_BODY, c.targetbody),)),
    ("lights", _Kind.mjOBJ_LIGHT, "light", lambda c: ((_Kind.mjOBJ_BODY, c.targetbody),)),
)
"""Elements that refer to others, in an order in which none refers to a later one: collection, kind,
the same in words, and what one refers to."""


def _drop_references(spec: mujoco.MjSpec, gone: set[_Reference]) -> list[str]:
    """Remove what refers to elements that go, and what refers to that; return it in words."""
    dropped = []
    for collection, kind, words, references in _REFERRING:
        for element in list(getattr(spec, collection)):
            if gone.isdisjoint(references(element)):
                continue
            if element.name:
                gone.add((kind, element.name))
            dropped.append(_in_words(words, element.name))
            spec.delete(element)
    return dropped
