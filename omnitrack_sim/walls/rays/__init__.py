"""What rays meet: pictures of cameras and distances from walls, on the exact surfaces."""

from omnitrack_sim.walls.rays.walls import RayWalls

__all__ = ["RayWalls"]
