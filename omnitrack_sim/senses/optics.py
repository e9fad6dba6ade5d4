"""Interface of cameras, and cameras at both ends of robots among pipes."""

from __future__ import annotations

from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, heading, set_rows
from omnitrack_sim.base.table import Part, Table, Unit
from omnitrack_sim.senses.draws import Keys
from omnitrack_sim.walls.rays import RayWalls


class OpticsTable(Table):
    """Optics that all cameras have.

    The camera stands on the robot's axis at the end that leads, and looks along it; x of the
    picture is that of the robot's frame, towards module 1.
    """

    pixels: Annotated[int, Field(ge=8, le=512), Unit("1")] = 48
    """Rows and columns of the picture."""
    field_of_view_deg: Annotated[float, Field(ge=20, le=170)] = 100.0
    """From the left edge of the picture to the right one, through its middle."""
    distortion: Annotated[float, Field(ge=-0.3, le=0.3), Unit("1")] = 0.0
    """Of the lens: a ray at angle a from the axis falls on the picture at a (1 + distortion a²), in
    proportion; 0 is an equidistant lens."""
    ahead: Annotated[float, Field(ge=0, le=0.1), Unit("m")] = 0.0
    """Of the lens before the robot's nose. Behind it, the modules would stand in the picture."""
    rate: Annotated[Part, Unit("1/s")] = 10.0
    """Pictures a second; a whole number of control periods lies between two."""
    latency: Annotated[float, Field(ge=0, le=1), Unit("s")] = 0.05
    """From the picture to its arrival; a whole number of control periods."""
    far: Annotated[Part, Unit("m")] = 1.5
    """Beyond this the camera sees nothing."""


def rays_of(optics: OpticsTable) -> Array:
    """Directions (pixels², 3) of the pixels, row by row, unit vectors in the camera frame."""
    middle = (np.arange(optics.pixels) + 0.5) / optics.pixels * 2 - 1
    x, y = np.meshgrid(middle, middle)
    size = np.hypot(x, y)
    edge = np.radians(optics.field_of_view_deg) / 2
    # Scaled so that the edge of the picture sees half of the field of view, whatever the lens.
    wanted = size * edge * (1 + optics.distortion * edge**2)
    angle = wanted
    for _ in range(20):  # of a (1 + k a²), which is monotone for the distortions that are taken
        angle = wanted / (1 + optics.distortion * angle**2)
    scale = np.sin(angle) / np.maximum(size, 1e-12)
    return np.stack([x * scale, y * scale, np.cos(angle)], axis=-1).reshape(-1, 3)


class Camera(Protocol):
    """A camera: how it makes a picture of what its rays meet, and what picture a robot expects.

    Attributes:
        optics: lens, pixels, rate and latency.
        lamp: (3,) m, camera frame, of the lamp beside the lens; None without one.
    """

    optics: OpticsTable
    lamp: Array | None

    def __init__(self, table: Any) -> None: ...

    def picture(
        self,
        hits: Array,
        rays: Array,
        pixels: NDArray[np.intp],
        keys: Keys,
        number: int | NDArray[np.int_],
        metered: NDArray[np.intp] | None = None,
    ) -> Array:
        """Return the picture (n, k) with its noise; NaN where a pixel says nothing.

        Args:
            hits: (n, k, 8) what the rays have met.
            rays: (k, 3) of the pixels, camera frame.
            pixels: (k,) which ones they are, row by row: the noise of each does not depend on
                which others are looked at.
            keys: (n,) of the robots' random numbers.
            number: of the picture, or (n,) that of each robot's.
            metered: (m,) places among ``pixels`` of those that an exposure goes by, the same ones
                whichever others are looked at; without it all.
        """
        ...

    def expected(self, hits: Array, rays: Array, metered: NDArray[np.intp] | None = None) -> Array:
        """Return the picture (n, k) without noise and dirt; NaN where nothing is expected.

        Args:
            hits: (n, k, 8) what the rays meet.
            rays: (k, 3) of the pixels, camera frame.
            metered: (m,) places among the k pixels of those that an exposure goes by, where one
                may stand for several; without it all.
        """
        ...

    def spread(self, expected: Array) -> Array:
        """Standard deviation (n, k) of a pixel about what is expected of it."""
        ...

    def slopes(self, hits: Array, rays: Array, rotation: Array) -> Array | None:
        """Return the Jacobian (n, k, 6) of the expected picture.

        It is for each metre along the world's axes, and each rad about the camera's own. None: it
        has to be found from pictures of neighbouring poses.
        """
        ...


class Mount:
    """A camera at either end of a robot.

    Args:
        camera: of both ends.
        lens: m, from the robot's centre to where a camera's ``ahead`` is 0; see ``Odometry.lens``.

    Attributes:
        camera: as given.
        rays: (pixels², 3) unit vectors, camera frame, row by row.
        ahead: m, from the robot's centre to the lens.
    """

    def __init__(self, camera: Camera, lens: float) -> None:
        self.camera, self.rays = camera, rays_of(camera.optics)
        self.ahead = lens + camera.optics.ahead

    def lens(
        self, position: Array, rotation: Array, facing: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        """Return the place (n, 3) m and frame (n, 3, 3) of the lens of robots.

        Args:
            position: (n, 3) m, of the robots.
            rotation: (n, 3, 3).
            facing: (n,) 1 at the nose, -1 at the tail.
        """
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

    def __init__(self, mount: Mount, walls: RayWalls, n: int) -> None:
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
        """Return pictures (m, k) of robots.

        Args:
            robots: (m,) their numbers.
            position: (m, 3) m, world frame.
            rotation: (m, 3, 3).
            facing: (m,) see ``Mount.lens``.
            number: see ``Camera.picture``.
            pixels: (k,) see ``Camera.picture``.
            metered: see ``Camera.picture``.
        """
        camera, rays = self.mount.camera, self.mount.rays[pixels]
        place, frame = self.mount.lens(position, rotation, facing)
        true = np.zeros(len(robots), np.intp)
        hits = self._walls.trace(true, place, frame, rays, camera.optics.far, camera.lamp)
        return camera.picture(hits, rays, pixels, self.keys[robots], number, metered)
