"""The window on the pipes and the robot of a scenario."""

from __future__ import annotations

import math
import os
import queue
import re
import sys
import time
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import installing
from omnitrack_sim.record.display import Lines
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.film.shots import DISTANCE, in_the_way, over_the_shoulder, upright
from omnitrack_sim.walls.pipe_looks import (
    FIELD_OF_VIEW,
    INSIDE_GROUP,
    ROBOT_GROUP,
    add_cameras,
    add_pipe_insides,
    follow_direction,
)

if TYPE_CHECKING:
    from mujoco.viewer import Handle


LINE, LETTER, MARGIN = 23, 7, 20
"""Height of a line of a panel, mean width of a letter, and total gap around its columns, pixels: of
MuJoCo's font at the windows' size (mjFONTSCALE_100)."""
ROBOT = 0.2
"""Half the extent of the robot in the window, where the camera is at first, in heights of it."""


def covers_robot(lines: Lines, width: int, height: int) -> bool:
    """Return whether a panel in an upper corner overlaps the robot in the middle of a window.

    Width and height are those of the window, pixels.
    """
    letters = sum(max(len(line[column]) for line in lines) for column in (0, 1))
    beside = LETTER * letters + MARGIN <= width / 2 - ROBOT * height
    above = LINE * len(lines) <= (0.5 - ROBOT) * height
    return not (beside or above)


NAME = "omnitrack_sim"
"""Name in the title of the window."""
INSTALL = installing("view")
"""Command that installs the window's library."""
SUN = [0.26, 0.25, 0.23]
"""Red, green, blue of the sun, which throws no shadow here and may not outshine the pipes."""
_BACK = 1.25
"""Distance of the camera, in that of the films: the window has panels in its corners."""
_CLOSING = 5.0  # s, longest wait for the window to go
_CLEAR = 0.88  # by how much a pipe that stands before the robot becomes clear


def require_screen() -> None:
    """Refuse what would fail in the window's own thread, where no error could be caught.

    Raises:
        RenderError: no screen, no library, or no OpenGL; the message says what to do.
    """
    try:
        import glfw
    except ImportError as error:
        raise RenderError(f"the viewer's library cannot be loaded ({error}): {INSTALL}") from error
    if not sys.platform.startswith("linux"):
        return  # elsewhere windows may be opened by one thread only, which is MuJoCo's
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not screen:
        told = "the viewer needs a screen; `omnitrack run` and `omnitrack render` do without one"
        raise RenderError(f"{told} (DISPLAY and WAYLAND_DISPLAY are not set)")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        opened = _opens_window(glfw)
    if not opened:
        reasons = "; ".join(str(each.message) for each in caught) or "no reason is given"
        raise RenderError(f"no window with OpenGL opens on the screen {screen!r} ({reasons})")


def _opens_window(glfw: Any) -> bool:
    """Try to open a window, which nobody sees."""
    if not glfw.init():
        return False
    glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
    window = glfw.create_window(64, 64, "", None, None)
    if window is not None:
        glfw.destroy_window(window)
    glfw.terminate()
    return window is not None


def window_spec(scenario: Scenario) -> mujoco.MjSpec:
    """Return the robot of a scenario as it shows itself, and the insides of its pipes."""
    network = scenario.route.network
    spec = scenario.robot.display.spec(network, scenario.plates, coarse=False)
    spec.modelname = NAME
    for each in (*spec.cameras, *spec.lights):
        each.name = ""  # a user's own may be called as those below
    add_pipe_insides(spec, network)
    add_cameras(spec, network)
    spec.visual.global_.fovy = FIELD_OF_VIEW
    spec.light("sun").diffuse = SUN
    return spec


class Window:
    """The window on one scenario's pipes and robot, as a context.

    The pipes are drawn as their insides, which are open towards any viewer; one that stands between
    robot and viewer becomes clear. The camera keeps with the robot, and the mouse turns it, moves
    it and brings it nearer, as in every window of MuJoCo.

    Attributes:
        model: of the scene with looks, to which the poses that are shown belong.
    """

    def __init__(self, scenario: Scenario) -> None:
        network, robot = scenario.route.network, scenario.robot
        self.model = window_spec(scenario).compile()
        self._data = mujoco.MjData(self.model)
        self._parts, self._chassis = network.parts, robot.chassis
        self._nose = robot.frame.rotation[:, 2]
        self._insides = [self.model.geom(f"look_inside_{part.name}").id for part in self._parts]
        self._back, self._size = follow_direction(network), robot.length_scale
        self._keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._centre: Array | None = None
        self._handle: Handle | None = None

    def __enter__(self) -> Window:
        self._handle = handle = self._launched()
        with handle.lock():
            option, eye = handle.opt, handle.cam
            option.geomgroup[:] = 0
            option.geomgroup[[ROBOT_GROUP, INSIDE_GROUP]] = 1
            option.sitegroup[:] = 0
            option.flags[int(mujoco.mjtVisFlag.mjVIS_ACTUATOR)] = 0
            # The nearer halves of the pipes are not drawn, but they would throw shadows.
            assert handle.user_scn is not None
            handle.user_scn.flags[int(mujoco.mjtRndFlag.mjRND_SHADOW)] = 0
            eye.distance = _BACK * DISTANCE * self._size
            eye.azimuth = math.degrees(math.atan2(-self._back[1], -self._back[0]))
            eye.elevation = -math.degrees(math.asin(max(-1.0, min(1.0, self._back[2]))))
        return self

    def _launched(self) -> Handle:
        """Return MuJoCo's window, in a thread of its own.

        Raises:
            RenderError: it cannot open one, as on macOS without its own launcher.
        """
        try:
            import mujoco.viewer

            return mujoco.viewer.launch_passive(
                self.model,
                self._data,
                key_callback=self._keys.put,
                show_left_ui=False,
                show_right_ui=False,
            )
        except (ImportError, RuntimeError) as error:
            raise RenderError(f"MuJoCo opens no window: {error}") from error

    def close(self) -> None:
        """Close it, as its user can."""
        if self._handle is not None:
            self._handle.close()

    def __exit__(self, *_: object) -> None:
        import glfw

        self.close()
        # The process must not end while the window's thread is still taking it down.
        patience = time.monotonic() + _CLOSING
        while self._handle is not None and time.monotonic() < patience:
            if self._handle.m is None:
                glfw.terminate()
                self._handle = None
            else:
                time.sleep(0.02)

    @property
    def is_open(self) -> bool:
        """True until somebody closes it."""
        return self._handle is not None and self._handle.is_running()

    @property
    def towards(self) -> Array:
        """Unit vector (3,), world frame, from the picture to the viewer."""
        assert self._handle is not None
        eye = self._handle.cam
        if eye.type == mujoco.mjtCamera.mjCAMERA_FIXED:
            return self._data.cam_xmat[eye.fixedcamid].reshape(3, 3)[:, 2].copy()
        up, around = math.radians(eye.elevation), math.radians(eye.azimuth)
        ahead = [math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)]
        return -np.array(ahead)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels; nothing before the first picture."""
        area = None if self._handle is None else self._handle.viewport
        return (0, 0) if area is None else (area.width, area.height)

    def pressed(self, seconds: float) -> list[int]:
        """The keys since the last call, by GLFW's numbers; waits for one for some seconds."""
        found = []
        try:
            found.append(
                self._keys.get(timeout=seconds) if seconds > 0 else self._keys.get_nowait()
            )
            while True:
                found.append(self._keys.get_nowait())
        except queue.Empty:
            return found

    def show(self, qpos: Array, panels: Sequence[tuple[mujoco.mjtGridPos, Lines]]) -> None:
        """Show the robot at joint positions (nq,), and panels of words and values in corners."""
        if not self.is_open:
            return
        assert self._handle is not None
        data, handle = self._data, self._handle
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        # The window's thread moves the camera, too, when the mouse is dragged.
        with handle.lock():
            self._follow(handle.cam)
        handle.set_texts([_text(corner, lines) for corner, lines in panels])
        handle.sync()

    def _follow(self, eye: Any) -> None:
        """Move the camera as the robot has moved, and light and pipes with it."""
        chassis = self._data.body(self._chassis)
        centre = np.array(chassis.xpos)
        moved = centre - (eye.lookat if self._centre is None else self._centre)
        self._centre = centre
        eye.lookat[:] = eye.lookat + moved
        if eye.type != mujoco.mjtCamera.mjCAMERA_FREE:
            return
        back = self.towards
        nose = chassis.xmat.reshape(3, 3) @ self._nose
        targets = centre + 0.05 * self._size * np.array([[0.0], [1.0], [-1.0]]) * nose
        red, green, blue, _ = self.model.material("pipe").rgba
        clear = in_the_way(self._parts, eye.lookat + eye.distance * back, targets)
        for geom, share in zip(self._insides, clear, strict=True):
            self.model.geom_rgba[geom] = (red, green, blue, 1 - _CLEAR * share)
        sun = over_the_shoulder(back, *upright(back))
        self._data.light_xdir[self.model.light("sun").id] = -sun


def _text(corner: mujoco.mjtGridPos, lines: Lines) -> tuple[int | None, int, str, str]:
    """A panel as MuJoCo takes it, in the letters that its font has."""
    words, values = zip(*lines, strict=True) if lines else ((), ())
    left, right = (
        "\n".join(re.sub("[^ -~]", "?", text) for text in column) for column in (words, values)
    )
    return int(mujoco.mjtFontScale.mjFONTSCALE_100), int(corner), left, right
