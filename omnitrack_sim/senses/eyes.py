"""Cameras as they stand at both ends of robots, and the pictures that they take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, heading, set_rows
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.senses.draws import Keys
from omnitrack_sim.senses.optics import Camera, Walls, rays_of


class Mount:
    """A camera at either end of a robot.

    Attributes:
        camera: as given. rays: (pixels², 3) unit vectors, camera frame, row by row.
        ahead: m, from the robot's centre to the lens.
    """

    def __init__(self, camera: Camera, robot: Robot) -> None:
        self.camera, self.rays = camera, rays_of(camera.optics)
        self.ahead = robot.length / 2 + camera.optics.ahead

    def lens(
        self, position: Array, rotation: Array, facing: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        """Place (n, 3) m and frame (n, 3, 3) of the lens of robots at a pose; ``facing`` (n,): 1 at
        the nose, -1 at the tail."""
        frame = heading(rotation, facing)
        return position + self.ahead * frame[:, :, 2], frame


class Eyes:
    """The cameras of n robots, among the pipes as they are.

    Args:
        mount: of each. walls: whose first map is the true pipes.
        n: number of robots.

    Attributes:
        keys: (n,) of the robots' random numbers, set by ``reset``.
    """

    def __init__(self, mount: Mount, walls: Walls, n: int) -> None:
        self.mount, self._walls = mount, walls
        self.keys: Keys = np.zeros(n, np.uint64)

    def reset(self, rows: NDArray[np.intp], keys: Keys) -> None:
        """Begin anew for robots ``rows`` (k,), whose random numbers have ``keys`` (k,)."""
        set_rows(self, rows, keys=keys)

    def take(
        self,
        robots: NDArray[np.intp],
        position: Array,
        rotation: Array,
        facing: NDArray[np.int_],
        number: int | NDArray[np.int_],
        pixels: NDArray[np.intp],
        metered: NDArray[np.intp] | None = None,
    ) -> Array:
        """Pictures (m, k) of robots (m,).

        Args:
            position: (m, 3) m, world frame, of the robots. rotation: (m, 3, 3). facing: (m,), see
                ``Mount.lens``.
            number, pixels, metered: see ``Camera.picture``.
        """
        camera, rays = self.mount.camera, self.mount.rays[pixels]
        place, frame = self.mount.lens(position, rotation, facing)
        true = np.zeros(len(robots), np.intp)
        hits = self._walls.trace(true, place, frame, rays, camera.optics.far, camera.lamp)
        return camera.picture(hits, rays, pixels, self.keys[robots], number, metered)
