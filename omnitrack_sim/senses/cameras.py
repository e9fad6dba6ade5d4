"""Cameras by name."""

from __future__ import annotations

from typing import Any

from omnitrack_sim.base.naming import named
from omnitrack_sim.senses.depth import DepthCamera
from omnitrack_sim.senses.headlight import HeadlightCamera
from omnitrack_sim.senses.optics import Camera
from omnitrack_sim.senses.table import SensingTable

CAMERAS: dict[str, Any] = {"depth": DepthCamera, "headlight": HeadlightCamera}
"""Shipped cameras by the name that ``sensing.camera`` gives."""


def camera_of(table: SensingTable) -> Camera:
    """The camera that ``sensing.camera`` names, made from its table.

    Raises:
        InputError: there is no such camera.
    """
    found = named(table.camera, "sensing.camera", CAMERAS)
    if table.camera in CAMERAS:
        return found(getattr(table, table.camera))
    return found(found.Table(**table.camera_parameters))
