"""A plugin of MuJoCo without which a model that has exact walls does not load.

Such a model saved as MJCF holds height fields that are boxes to a MuJoCo without this package: a
robot would fall through. The model names the plugin; a process that has not registered it refuses
the file, and one that has refuses a model whose walls it does not know. The plugin computes
nothing.
"""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE
from functools import cache

import mujoco
from llvmlite import ir

from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import INTEGER, WORD, WORDS, c_function, intrinsic
from omnitrack_sim.walls.collider import (
    GEOM_COUNT,
    MESSAGES,
    RAISE,
    TYPE,
    USER,
    USER_SIZE,
    block_of_process,
    doubles,
    functions_of,
    install,
    integers,
    long_sizes_at,
    word,
)
from omnitrack_sim.walls.layout import library
from omnitrack_sim.walls.record import KIND, LONG, MARK, PLATE, RECORD_SIZE

PLUGIN = "omnitrack_sim.walls"
FIELD_OF_DISTANCES, UNKNOWN, NO_WALLS, OTHER = range(4)
_MESSAGES = (
    "exact walls: the model has a geom of a signed distance field, which would pass through them",
    "exact walls: the model has a fitting of a kind that this process does not know; before it is "
    "loaded, ot.Pipes(network) has to be made with the network that it was saved with",
    "exact walls: the model has none at the ends of its user data; give nuser_geom its length "
    "before ot.add_pipes",
    "exact walls: the model has a pipe with relief that this process does not know; before it is "
    "loaded, ot.Pipes(network) has to be made with the network that it was saved with",
)
"""What is wrong with a model that is refused."""
_TEXTS = [ctypes.create_string_buffer(message.encode()) for message in _MESSAGES]
_FIELD, _SDF = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF)
_CALLBACKS = (
    "nstate nsensordata init destroy copy reset compute advance visualize actuator_act_dot "
    "sdf_distance sdf_gradient sdf_staticdistance sdf_attribute sdf_aabb"
)


class _Plugin(ctypes.Structure):
    """MuJoCo's mjpPlugin."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.c_void_p),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in _CALLBACKS.split()),
    )


def nothing(_model, _data, _instance):
    """State and values of the plugin: none; and what it does when data are reset or stepped."""
    return 0


@intrinsic
def call_raise(_context, _address, _message):
    """Call ``mju_error`` at an address."""

    def code(_context, builder, _signature, arguments):
        # It takes what its message has marks for, too: a call by another type may crash.
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)], var_arg=True)
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return ir.Constant(ir.IntType(32), -1)

    return CFUNCTYPE(INTEGER, WORD, WORD), code


@compiled
def _refuse(message):
    """Raise MuJoCo's error with a message, which does not return."""
    return call_raise(word(RAISE), word(MESSAGES + message))


def check_walls(model, _data, _instance):
    """Return 0 if all walls of a model are known, and are in their place; else refuse it."""
    count, walls = model[word(USER_SIZE)], 0
    records, kinds = doubles(model[word(USER)]), integers(model[word(TYPE)])
    for geom in range(model[word(GEOM_COUNT)]):
        if kinds[geom] == _SDF:
            return _refuse(FIELD_OF_DISTANCES)
        w = count * (geom + 1) - RECORD_SIZE
        if kinds[geom] == _FIELD and count >= RECORD_SIZE and records[w] == MARK:
            walls += 1
            kind = records[w + KIND]
            if kind > PLATE and functions_of(kind)[0] == 0:
                return _refuse(UNKNOWN)
            if records[w + LONG] > 0.0 and long_sizes_at(records, w) == 0:
                return _refuse(OTHER)
    # Rows that became longer since the walls were added have no record at their end.
    return 0 if walls > 0 else _refuse(NO_WALLS)


@cache
def register() -> None:
    """Make this process one that steps models with exact walls.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    install()
    plugin, mujoco_, block = _Plugin(), library(), block_of_process()
    block[RAISE] = ctypes.cast(mujoco_.mju_error, ctypes.c_void_p).value
    # The texts are kept for good by the constant.
    block[MESSAGES : MESSAGES + len(_TEXTS)] = [ctypes.addressof(text) for text in _TEXTS]
    mujoco_.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = PLUGIN.encode()
    plugin.capabilityflags = int(mujoco.mjtPluginCapabilityBit.mjPLUGIN_SENSOR)
    plugin.nstate = c_function(nothing, CFUNCTYPE(INTEGER, WORDS, WORDS, INTEGER)).address
    plugin.nsensordata = plugin.reset = plugin.compute = plugin.nstate
    plugin.init = c_function(check_walls, CFUNCTYPE(INTEGER, WORDS, WORDS, INTEGER)).address
    mujoco_.mjp_registerPlugin(ctypes.byref(plugin))


def add_guard(spec: mujoco.MjSpec, wall: str) -> None:
    """Have a model ask for the plugin: a sensor without values refers to the geom of a wall.

    ``MjSpec.attach`` takes along what refers to a geom, but not what the world's body refers to; a
    body for the plugin would change the numbers of the robot's.
    """
    register()
    if not any(plugin.plugin_name == PLUGIN for plugin in spec.plugins):
        spec.activate_plugin(PLUGIN)
        spec.add_plugin(name=PLUGIN, plugin_name=PLUGIN, active=True)
    sensor = spec.add_sensor(
        type=mujoco.mjtSensor.mjSENS_PLUGIN, objtype=mujoco.mjtObj.mjOBJ_GEOM, objname=wall
    )
    sensor.plugin.name = sensor.plugin.plugin_name = PLUGIN
    sensor.plugin.active = True
