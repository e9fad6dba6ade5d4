"""A plugin of MuJoCo without which a model that has exact walls does not load.

Such a model saved as MJCF holds height fields that are boxes to a MuJoCo without this package: a
robot would fall through. The model names the plugin; a process that has not registered it refuses
the file, and one that has refuses a model whose walls it does not know. The plugin computes
nothing.
"""

from __future__ import annotations

import ctypes
from functools import cache

import mujoco
from numba import types

from omnitrack_sim.pipes.native import WORDS, c_function
from omnitrack_sim.walls.collider import (
    GEOM_COUNT,
    TYPE,
    USER,
    USER_SIZE,
    doubles,
    functions_of,
    install,
    integers,
    library,
    word,
)
from omnitrack_sim.walls.record import KIND, MARK, RECORD_SIZE
from omnitrack_sim.walls.rims import RIM

PLUGIN = "omnitrack_sim.walls"
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


def nothing(model, data, instance):
    """State of the plugin: none; and what it does when data are reset or stepped."""
    return 0


def check_walls(model, data, instance):
    """Return 0 if all walls of a model are known, and are in their place, else -1."""
    count, walls = model[word(USER_SIZE)], 0
    records, kinds = doubles(model[word(USER)]), integers(model[word(TYPE)])
    for geom in range(model[word(GEOM_COUNT)]):
        if kinds[geom] == _SDF:
            return -1
        w = count * (geom + 1) - RECORD_SIZE
        if kinds[geom] == _FIELD and count >= RECORD_SIZE and records[w] == MARK:
            walls += 1
            kind = records[w + KIND]
            if kind != RIM and functions_of(kind)[0] == 0:
                return -1
    # Rows that became longer since the walls were added have no record at their end.
    return 0 if walls > 0 else -1


@cache
def register() -> None:
    """Make this process one that steps models with exact walls.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    install()
    plugin = _Plugin()
    mujoco_ = library()
    mujoco_.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = PLUGIN.encode()
    plugin.nstate = c_function(nothing, types.int32(WORDS, WORDS, types.int32)).address
    plugin.reset = plugin.compute = plugin.nstate
    plugin.init = c_function(check_walls, types.int32(WORDS, WORDS, types.int32)).address
    mujoco_.mjp_registerPlugin(ctypes.byref(plugin))


def add_guard(spec: mujoco.MjSpec) -> None:
    """Have a model ask for the plugin."""
    register()
    if not any(plugin.plugin_name == PLUGIN for plugin in spec.plugins):
        spec.activate_plugin(PLUGIN)
        spec.add_plugin(name=PLUGIN, plugin_name=PLUGIN, active=True)
