"""Playback: a model in pipes with its states over time, which all pictures are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.record.display import (
    CarriedCamera,
    Colour,
    Curve,
    ForceArrow,
    StateValue,
    StatusText,
    Track,
)
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.results.result import Result
from omnitrack_sim.show.landmarks import Landmarks, PassageSpan
from omnitrack_sim.show.legend import MAX_NAMED, Legend, colours

MAX_MAGNITUDE = 1e5
"""Largest magnitude of positions, m, and other shown values of a valid sample: far outside of any
network, and far below where a film's numbers of single precision end."""
POINTS_APART = 0.01
"""Travel between two points of a path on a map, m: a pixel or less in all maps."""
STANDARD = ("side", "follow")
"""Cameras of every playback: one shows the pipes on the way, the other stays with the robot."""


class PhaseSpan(NamedTuple):
    """A phase of the controller: its name, begin and end, s, and number."""

    name: str
    start: float
    end: float
    code: int


class ContactForces(NamedTuple):
    """Forces on the robot that films draw, world frame.

    Attributes:
        sample: (C,) in which sample, in order.
        position: (C, 3) m.
        force: (C, 3) N.
        colour: (C, 3) red, green, blue, from 0 to 1.
        metres: length of an arrow for a force of 1 N, m.
    """

    sample: NDArray[Any]
    position: Array
    force: Array
    colour: Array
    metres: float

    def lines(self, row: int) -> tuple[Array, Array, Array]:
        """Return begins and vectors (n, 3) m and colours of the lines drawn at sample ``row``."""
        these = slice(*np.searchsorted(self.sample, [row, row + 1]))
        return self.position[these], self.metres * self.force[these], self.colour[these]


class Badge(NamedTuple):
    """A number that stands on a body, on pages, in the colour of the body's curves."""

    body: str
    text: str
    colour: Colour


class Line(NamedTuple):
    """A line of a curve: its column, its name, and its colour; None: of a curve with one line."""

    column: int
    name: str
    colour: Colour | None


class Playback:
    """Base class: a model in pipes with its states over time, and what pictures tell of it.

    Films, pages, figures and the window take a playback alone. ``playback_of`` makes one of a run
    or a recording; what is costly is made when it is first asked for. Below stand the defaults.

    Attributes:
        result: the run; None of a recording.
        name: title of pages and figures.
        network: the pipes, world frame.
        plates: ports (part index, port) that are closed.
        extremes: samples that tell how far the robot reaches about its body.
        album: pictures of the robot's cameras.
        page_camera: camera on board of pages; None without one.
        tracks: bodies that lie on others, by name.
        track_pitch: way after which a track looks the same, m.
        columns: name and colour of each column of curves with so many.
        state: values below the phase, on pages.
    """

    result: Result | None = None
    name: str
    network: Assembly
    plates: Sequence[Port] = ()
    extremes: tuple[int, ...] = (0,)
    album: Pictures | None = None
    page_camera: CarriedCamera | None = None
    tracks: Mapping[str, Track] = {}
    track_pitch: float = 1.0
    columns: tuple[tuple[str, Colour], ...] = ()
    state: tuple[StateValue, ...] = ()

    # States over time

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Model with the geoms that are seen."""
        raise NotImplementedError

    @cached_property
    def time(self) -> Array:
        """Times of the samples (T,), s."""
        raise NotImplementedError

    @cached_property
    def qpos(self) -> Array:
        """Joint positions (T, nq) as they are shown."""
        raise NotImplementedError

    @cached_property
    def size(self) -> float:
        """Size of lengths in pictures, over those for a robot in a bore of 160 mm."""
        raise NotImplementedError

    @cached_property
    def mocap(self) -> Array:
        """Positions, m, and quaternions of the model's mocap bodies (T, nmocap, 7)."""
        return np.zeros((len(self.time), self.model.nmocap, 7))

    @cached_property
    def visible_geoms(self) -> tuple[int, ...]:
        """Geoms that are seen; those of the world stand still like the pipes."""
        raise NotImplementedError

    @cached_property
    def casting(self) -> tuple[int, ...]:
        """Geoms that throw shadows."""
        return self.visible_geoms

    @cached_property
    def body(self) -> int:
        """Number of the body that cameras keep with."""
        raise NotImplementedError

    @cached_property
    def position(self) -> Array:
        """Position of that body (T, 3), m."""
        raise NotImplementedError

    @cached_property
    def ahead(self) -> Array:
        """Unit vectors (T, 3), world frame, along which it drives."""
        raise NotImplementedError

    @cached_property
    def travel(self) -> Array:
        """Way that it has gone (T,), m, which always grows a little, so that it can be inverted."""
        raise NotImplementedError

    @cached_property
    def path(self) -> NDArray[np.intp]:
        """Samples (N,) through which maps draw its way."""
        raise NotImplementedError

    @cached_property
    def backward(self) -> NDArray[np.bool_]:
        """True (T,) where it drives tail first, which maps draw in another colour."""
        return np.zeros(len(self.time), bool)

    @cached_property
    def estimate(self) -> Array:
        """Position (T, 3), m, where the robot takes itself to be; the true one by default."""
        return self.position

    @cached_property
    def mounts(self) -> Mapping[str, CarriedCamera]:
        """Cameras that bodies carry, by name."""
        raise NotImplementedError

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras of films."""
        return (*STANDARD, *(name for name in self.mounts if name not in STANDARD))

    # What is told of them

    def status(self, row: int) -> StatusText:
        """Return the text of the status panel at a sample."""
        raise NotImplementedError

    @cached_property
    def passages(self) -> list[PassageSpan]:
        """Passages of the body through the parts, in order of time."""
        raise NotImplementedError

    @cached_property
    def leg(self) -> NDArray[np.intp] | None:
        """Index of the leg (T,); None where there is only one."""
        return None

    @cached_property
    def phases(self) -> list[PhaseSpan]:
        """Phases of the controller, in order of time."""
        return []

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """Events with their times, s, in words, in order of time."""
        return []

    @cached_property
    def notes(self) -> list[str]:
        """Remarks about the set-up."""
        return []

    @cached_property
    def landmarks(self) -> Landmarks | None:
        """What a map shows, and from when on; None where pictures need no map."""
        return None

    @cached_property
    def forces(self) -> ContactForces | None:
        """Forces on the robot that films draw; None of a playback without them."""
        return None

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Values over time, by name, of pages and figures."""
        raise NotImplementedError

    @cached_property
    def legends(self) -> Mapping[str, Legend]:
        """Names and colours of the parts that curves are of, by what one of them is."""
        return {}

    @cached_property
    def badges(self) -> Sequence[Badge]:
        """Bodies with numbers on them, on pages: those of the legend, if it names them all."""
        bodies = self.legends.get("body")
        if bodies is None or len(bodies.colours) - bodies.colours.count(None) > MAX_NAMED:
            return ()
        return [Badge(name, str(i + 1), paint) for i, (_, name, paint) in enumerate(bodies.rows)]

    def lines(self, name: str) -> list[Line]:
        """Return the lines of a curve: those of parts that never act are left out."""
        curve = self.curves[name]
        return self._lines(curve.display.each, curve.names)

    def _lines(self, each: str, names: tuple[str, ...]) -> list[Line]:
        """Return the lines of columns with these names, of parts that are called ``each``."""
        legend = self.legends.get(each)
        if legend is not None and legend.names == names:
            rows = zip(legend.short, legend.colours, strict=True)
            return [Line(i, short, c) for i, (short, c) in enumerate(rows) if c is not None]
        if not names:
            return [Line(0, "", None)]
        paints = colours(len(names))
        return [Line(i, word, paints[i]) for i, word in enumerate(names)]

    @cached_property
    def plots(self) -> Sequence[str]:
        """Names of the curves that have a plot on pages."""
        return tuple(self.curves)

    @cached_property
    def first_plots(self) -> Sequence[str]:
        """Names of those that are shown before the reader chooses."""
        return tuple(name for name, curve in self.curves.items() if not curve.names)

    @cached_property
    def heading(self) -> dict[str, Any]:
        """Name, outcome, figures and provenance, for the head of a page."""
        raise NotImplementedError

    @cached_property
    def headline(self) -> Mapping[str, str]:
        """Titles of the figures in the head of a page, by their names."""
        return {row["name"]: row["name"] for row in self.heading["figures"]}

    @cached_property
    def arrows(self) -> list[ForceArrow]:
        """Arrows of forces on pages."""
        return []

    @cached_property
    def track_travel(self) -> Array:
        """Way (T, k), m, that the tracks have run."""
        return np.zeros((len(self.time), 0))

    # Looking things up

    def row(self, time: float) -> int:
        """Return the sample nearest to ``time`` s, the earlier one of two."""
        clipped = np.clip(time, self.time[0], self.time[-1])
        return int(np.abs(self.time - clipped).argmin())

    def place(self, data: mujoco.MjData, row: int, qpos: Array | None = None) -> None:
        """Put the bodies of ``data`` where they are at a sample, or with joint positions (nq,)."""
        data.qpos[:] = self.qpos[row] if qpos is None else qpos
        data.mocap_pos[:], data.mocap_quat[:] = np.split(self.mocap[row], [3], axis=-1)
        mujoco.mj_kinematics(self.model, data)

    def body_poses(self, bodies: Sequence[int]) -> Array:
        """Return positions, m, and quaternions (T, len(bodies), 7) without jumps in sign."""
        data, rows = mujoco.MjData(self.model), list(bodies)
        poses = np.zeros((len(self.time), len(rows), 7))
        for row, pose in enumerate(poses):
            self.place(data, row)
            pose[:, :3], pose[:, 3:] = data.xpos[rows], data.xquat[rows]
        turns = poses[..., 3:]
        # q and -q are the same turn, but who shows them interpolates between neighbours.
        flips = np.where((turns[1:] * turns[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
        turns[1:] *= np.cumprod(flips, axis=0)[..., None]
        return poses

    @property
    def still(self) -> tuple[int, ...]:
        """Geoms of the world that are seen, such as plates."""
        return tuple(geom for geom in self.visible_geoms if self.model.geom_bodyid[geom] == 0)

    @property
    def moving(self) -> tuple[int, ...]:
        """Geoms of bodies that are seen."""
        return tuple(geom for geom in self.visible_geoms if self.model.geom_bodyid[geom] > 0)


def sound_rows(values: list[Array]) -> NDArray[np.intp]:
    """Return for each sample the last one up to it, or the first of all, that can be shown.

    Args:
        values: arrays (T, ...) that must be finite, and below ``MAX_MAGNITUDE``.

    Raises:
        RenderError: no sample can be shown.
    """
    samples = len(values[0])
    far = [np.abs(value.reshape(samples, -1)).max(axis=1, initial=0.0) for value in values]
    sound = np.all([distance < MAX_MAGNITUDE for distance in far], axis=0)  # NaN is not less either
    if not sound.any():
        raise RenderError("the run has no pose that can be shown")
    first = int(np.argmax(sound))
    return np.maximum.accumulate(np.where(sound, np.arange(samples), first))
