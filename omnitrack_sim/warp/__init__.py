"""Exact walls in MuJoCo Warp: thousands of worlds of any robot in pipes at once (extra ``warp``).

Names are loaded on first use; the first step of a model compiles its walls, once a machine.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "WarpVectorEnv": "omnitrack.env",
    "make_plant": "plant",
    "put_model": "walls",
    "recentre": "origins",
    "set_origins": "origins",
}
__all__ = ["WarpVectorEnv", "make_plant", "put_model", "recentre", "set_origins"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    except ModuleNotFoundError as error:
        if error.name not in ("mujoco_warp", "warp"):
            raise
        problem = f"{error}: pip install 'omnitrack_sim[warp]' brings MuJoCo Warp"
        raise ImportError(problem, name=error.name) from error
