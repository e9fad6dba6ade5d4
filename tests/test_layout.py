"""Fields of MuJoCo's structures by its own declarations, and its library."""

from __future__ import annotations

import copy
import ctypes
from typing import Any

import mujoco
import pytest
from mujoco.introspect.structs import STRUCTS

from omnitrack_sim.walls import layout
from omnitrack_sim.walls.collider import MODEL_FIELDS


def model() -> mujoco.MjModel:
    """Two meshes on free bodies, and a site: a part of most kinds."""
    spec = mujoco.MjSpec()
    spec.nuser_geom = 7
    spec.add_mesh(name="mesh", uservert=[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])
    for _ in range(2):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
        body.add_site()
    return spec.compile()


def word(address: int, structure: str, name: str) -> int:
    (at,) = layout.words_of(structure, [name])
    return ctypes.c_size_t.from_address(address + 8 * at).value


def test_fields_are_where_a_model_has_them() -> None:
    """Pointers of all that the collider reads, and counts at both ends of the list."""
    made = model()
    for name in MODEL_FIELDS:
        assert word(made._address, "mjModel", name) == getattr(made, name).ctypes.data, name
    for name in ("nq", "nuser_geom", "ngeom", "nmeshvert", "nbuffer"):
        assert word(made._address, "mjModel", name) == getattr(made, name), name
    assert word(made._address, "mjModel", "signature") == made.signature


@pytest.mark.parametrize("name", ["geom_xpos", "geom_xmat", "qpos", "ctrl", "qfrc_constraint"])
def test_fields_are_where_data_have_them(name: str) -> None:
    """Behind arrays, statistics and flags, by C's rules of alignment."""
    data = mujoco.MjData(model())
    if getattr(data, name).size:
        assert word(data._address, "mjData", name) == getattr(data, name).ctypes.data


@pytest.mark.parametrize("structure", ["mjModel", "mjData"])
def test_a_library_of_another_layout_is_refused(structure: str, monkeypatch: Any) -> None:
    """With a field more before the others, by the name of the one that is elsewhere."""
    changed = copy.copy(STRUCTS[structure])
    object.__setattr__(changed, "fields", (changed.fields[0], *changed.fields))
    monkeypatch.setitem(STRUCTS, structure, changed)
    monkeypatch.setattr(layout, "_structure", layout._structure.__wrapped__)
    monkeypatch.setattr(layout, "_check", layout._check.__wrapped__)
    with pytest.raises(RuntimeError, match=f"MuJoCo's {structure} is not where"):
        layout.words_of(structure, ["geom_size" if structure == "mjModel" else "geom_xpos"])


def test_the_library_is_the_one_that_python_uses() -> None:
    """A callback that is set through one is seen through the other."""
    callback = ctypes.c_void_p.in_dll(layout.library(), "mjcb_control")
    assert callback.value is None
    try:
        mujoco.set_mjcb_control(lambda model, data: None)
        assert ctypes.c_void_p.in_dll(layout.library(), "mjcb_control").value is not None
    finally:
        mujoco.set_mjcb_control(None)
