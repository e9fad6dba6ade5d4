"""What rays meet: pictures of cameras and distances from walls, on the exact surfaces."""

from omnitrack_sim.model.rays.walls import RayWalls

__all__ = ["RayWalls"]
