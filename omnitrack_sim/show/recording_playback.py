"""Playback of a recording of any MuJoCo model in exact pipes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import finite
from omnitrack_sim.record.channels import Display
from omnitrack_sim.record.display import (
    CarriedCamera,
    Curve,
    ForceArrow,
    StateValue,
    StatusText,
    model_cameras,
)
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.robots.actuator_units import actuator_units
from omnitrack_sim.robots.display import HIDDEN_FROM
from omnitrack_sim.robots.model_sensors import actuator_names
from omnitrack_sim.show.film.shots import is_outside
from omnitrack_sim.show.landmarks import Landmarks, PassageSpan
from omnitrack_sim.show.legend import Legend, Parts, actuator_owners, legends_of
from omnitrack_sim.show.playback import POINTS_APART, ContactForces, Playback, sound_rows
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.surfaces import DRAWN
from omnitrack_sim.show.wall_forces import ForceBars, body_arrows, body_forces, drawn_forces

BORE, REACH = 0.16, 0.16
"""Bore, and reach of a robot about its body, m, of pictures of size 1."""
EXTREMES = 20
"""Samples by which the robot's reach is judged: more would take longer than they tell."""
_SLIDE, _HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE


class RecordingPlayback(Playback):
    """Playback of a recording; its arrows are the forces of the walls.

    It ends where the body has left the pipes and does not come back.

    Args:
        recording: with at least one sample.

    Attributes:
        recording: what is shown of it.
        unshown: number of samples after that.

    Raises:
        InputError: it has no sample.
    """

    state: tuple[StateValue, ...] = (
        ("distance", "", 1e3, 0, " mm"),
        ("speed", "", 1e3, 0, " mm/s"),
    )

    def __init__(self, recording: Recording) -> None:
        recording.require_samples()
        self._whole, self.network = recording, recording.pipes.assembly
        shown = shown_samples(recording.places.part >= 0)
        self.recording, self.unshown = recording.head(shown), len(recording) - shown
        self._body_name = recording.model.body(recording.body).name or "the robot"
        self.name = f"recording of {self._body_name}"
        samples = len(self.recording)
        rows = np.linspace(0, samples - 1, EXTREMES).astype(int)
        self.extremes = tuple(np.unique(rows).tolist())
        carried = (mount for mount in self.mounts.values() if mount.body)
        self.page_camera = next((one for one in carried if not is_outside(self, one)), None)

    def __reduce__(self) -> tuple[Any, ...]:
        return RecordingPlayback, (self._whole,)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """See ``Playback``."""
        return self.recording.model

    @cached_property
    def time(self) -> Array:
        """See ``Playback``."""
        return self.recording.time

    @cached_property
    def qpos(self) -> Array:
        """See ``Playback``."""
        return self.recording.qpos[self._rows]

    @cached_property
    def mocap(self) -> Array:
        """See ``Playback``."""
        return self._mocap[self._rows]

    @cached_property
    def _mocap(self) -> Array:
        """Recorded poses of mocap bodies (T, nmocap, 7)."""
        poses = [self.recording[name] for name in ("mocap_pos", "mocap_quat")]
        return np.concatenate(poses, axis=-1)

    @cached_property
    def _rows(self) -> NDArray[np.intp]:
        """Samples (T,) that are shown for each."""
        return sound_rows([self.recording.qpos, self._mocap])

    @cached_property
    def visible_geoms(self) -> tuple[int, ...]:
        """Geoms that are drawn: neither walls nor hidden nor without an end."""
        model = self.model
        paint = np.where(model.geom_matid < 0, model.geom_rgba[:, 3], 1.0)
        shapes = np.isin(model.geom_type, [int(kind) for kind in DRAWN])
        shown = ~self.recording.is_wall & shapes & (paint > 0) & (model.geom_group < HIDDEN_FROM)
        if not (shown & (model.geom_bodyid > 0)).any():
            raise InputError(Fault("model", "has no visible geom of a body that can be drawn"))
        return tuple(np.flatnonzero(shown).tolist())

    @cached_property
    def body(self) -> int:
        """See ``Playback``."""
        return self.recording.body

    @cached_property
    def position(self) -> Array:
        """See ``Playback``."""
        return self.recording.bodies[self._rows, self.body, :3]

    @cached_property
    def ahead(self) -> Array:
        """Tangents of the pipes, as the robot set out."""
        return self.recording.progress()[1][self._rows]

    @cached_property
    def travel(self) -> Array:
        """See ``Playback``."""
        step = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        return np.append(0.0, np.cumsum(step + 1e-9))

    @cached_property
    def path(self) -> NDArray[np.intp]:
        """See ``Playback``."""
        marks = np.floor(self.travel / (self.size * POINTS_APART))
        return np.flatnonzero(np.diff(marks, prepend=-1) > 0)

    @cached_property
    def mounts(self) -> Mapping[str, CarriedCamera]:
        """See ``Playback``."""
        return model_cameras(self.model)

    @cached_property
    def size(self) -> float:
        """Size of pictures, by the widest bore and by the robot's reach."""
        bore = 2 * max(part.fitting.max_radius for part in self.network.parts)
        moving = np.unique(self.model.geom_bodyid[list(self.visible_geoms)])
        rows = list(self.extremes)
        away = self.recording.bodies[rows][:, moving[moving > 0], :3]
        away = away - self.position[rows][:, None]
        return max(bore / BORE, float(np.linalg.norm(away, axis=-1).max()) / REACH)

    # What is told of it

    def status(self, row: int) -> StatusText:
        """Return part, time, way, speed, contacts and force on the walls."""
        distance, speed, count, force = (
            self.curves[name].display.scale * float(self.curves[name].values[row, 0])
            for name in ("distance", "speed", "contact_count", "wall_force")
        )
        move = f"{self.time[row]:.2f} s     {1e3 * distance:.0f} mm     {speed:z.0f} mm/s"
        touch = f"{count:.0f} contacts, {force:.3g} N on the walls"
        part = self.recording.places.part[row]
        place = f"in {self.network.parts[part].name}" if part >= 0 else "outside"
        bars = self._bars
        return StatusText(place, (move, touch), bars.caption if bars.at(row) else "", bars.at(row))

    @cached_property
    def _bars(self) -> ForceBars:
        """Bars of the forces of the walls."""
        return ForceBars(self.legends["body"], self._body_forces)

    @cached_property
    def _body_forces(self) -> Array:
        """Normal force of the walls on each body but the world (T, nbody - 1), N."""
        return body_forces(self.recording.contacts, self.model, len(self.time))[:, 1:]

    @cached_property
    def legends(self) -> Mapping[str, Legend]:
        """Legends of bodies that touch the walls, of actuators, and of joints by their kind."""
        model, kinds = self.model, []
        names = tuple(model.body(i).name or f"body_{i}" for i in range(1, model.nbody))
        touches = tuple((self._body_forces != 0).any(axis=0).tolist())
        kinds.append(Parts("body", names, tuple(range(1, model.nbody)), touches))
        motors = actuator_names(model)
        kinds.append(Parts("actuator", motors, actuator_owners(model), (True,) * len(motors)))
        for kind, joints in self._joints.items():
            names = tuple(model.joint(i).name or f"joint_{i}" for i in joints)
            owners = tuple(model.jnt_bodyid[joints].tolist())
            kinds.append(Parts(kind, names, owners, (True,) * len(names)))
        return legends_of(kinds)

    @cached_property
    def _joints(self) -> dict[str, list[int]]:
        """Numbers of the slides and of the hinges."""
        kinds = {"slide": _SLIDE, "hinge": _HINGE}
        types = self.model.jnt_type
        return {word: np.flatnonzero(types == kind).tolist() for word, kind in kinds.items()}

    @cached_property
    def events(self) -> list[tuple[float, str]]:
        """The moment at which the body left the pipes, where it did."""
        if not self.unshown:
            return []
        return [(float(self.time[-1]), f"{self._body_name} left the pipes{self._rest}")]

    @property
    def _rest(self) -> str:
        """Words on the samples that are not shown."""
        return f"; {self.unshown} later samples are not shown" if self.unshown > 1 else ""

    @cached_property
    def passages(self) -> list[PassageSpan]:
        """See ``Playback``."""
        index, parts = self.recording.places.part, self.network.parts
        runs = [(parts[index[a]], a, b) for a, b in spans(index) if index[a] >= 0]
        return [PassageSpan(part, part.fitting.kind, a, b) for part, a, b in runs]

    @cached_property
    def landmarks(self) -> Landmarks | None:
        """See ``Playback``."""
        return Landmarks.none(self.network) if len(self.network.parts) > 1 else None

    @cached_property
    def forces(self) -> ContactForces:
        """Forces of the walls; the arrow of nearly the largest is half a bore long."""
        bore = 2 * self.network.parts[0].fitting.radius
        return drawn_forces(self.recording.contacts, self.model, self.legends["body"], bore)

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Way, speed and clearance of the body, forces, power, and the joints."""
        recording, time, samples = self.recording, self.time, len(self.time)
        distance, _ = recording.progress()
        speed = np.gradient(distance, time) if samples > 1 else np.zeros(samples)
        count = np.bincount(recording.contacts.sample, minlength=samples).astype(float)
        clearance, force = recording.places.clearance, recording.wall_force()
        single = {
            "distance": (Display("Way along the pipes", "m"), distance),
            "speed": (Display("Speed along the pipes", "mm/s", 1e3, span=10.0), speed),
            "clearance": (Display("Clearance of the body", "mm", 1e3, span=1.0), clearance),
            "wall_force": (Display("Normal force on the walls", "N", low=0.0), force),
            "contact_count": (Display("Contacts with the walls", "1", low=0.0), count),
            "power": (Display("Power of the actuators", "W"), recording.power()),
        }
        curves = {
            name: Curve(display, values[:, None]) for name, (display, values) in single.items()
        }
        position = recording.bodies[:, self.body, :3]
        places = Curve(Display("Position of the body", "m"), position, ("x", "y", "z"))
        return curves | self._part_curves() | {"position": places}

    def _part_curves(self) -> dict[str, Curve]:
        """Return the curves of bodies, actuators and joints, where there are any."""
        force = Display("Force on the wall, by body", "N", low=0.0, span=2.0, each="body")
        unit = actuator_units(self.model)["actuator_force"]
        motor = Display("Actuator forces", unit, each="actuator")
        slide = Display("Slides", "mm", 1e3, span=1.0, each="slide")
        hinge = Display("Hinges", "deg", float(np.degrees(1.0)), span=1.0, each="hinge")
        places = {
            kind: self.recording.qpos[:, self.model.jnt_qposadr[joints]]
            for kind, joints in self._joints.items()
        }
        rows = {
            "body_force": (force, self._body_forces),
            "actuator_force": (motor, self.recording["actuator_force"]),
            "slides": (slide, places["slide"]),
            "hinges": (hinge, places["hinge"]),
        }
        return {
            name: Curve(display, values, self.legends[display.each].names)
            for name, (display, values) in rows.items()
            if self.legends[display.each].rows
        }

    @cached_property
    def first_plots(self) -> Sequence[str]:
        """Curves with a single line, and the forces of the walls."""
        return (*super().first_plots, "body_force")

    @cached_property
    def heading(self) -> dict[str, Any]:
        """See ``Playback``."""
        curves, time = self.curves, self.time
        clearance = curves["clearance"].values
        least = 1e3 * np.min(clearance, where=np.isfinite(clearance), initial=np.inf)
        energy = np.trapezoid(self.recording.power(), time)
        rows = [
            ("way", "m", curves["distance"].values[-1], "along the pipes' axes"),
            ("largest force", "N", curves["wall_force"].values.max(), "sum on the walls"),
            ("least clearance", "mm", least, "of the body's origin"),
            ("energy", "J", energy, "of all actuators"),
        ]
        figures = [
            {"name": name, "unit": unit, "value": float(np.squeeze(value)), "meaning": meaning}
            for name, unit, value, meaning in rows
        ]
        first, last = time[[0, -1]]
        heading = {
            "name": self.name,
            "outcome": "left the pipes" if self.unshown else "ends",
            "success": None,
            "advice": "",
            "reason": f"{len(time)} samples from {first:.6g} to {last:.6g} s{self._rest}",
            "duration": float(np.ptp(time)),
            "figures": figures,
            "provenance": [["mujoco", mujoco.__version__]],
        }
        return finite(heading)

    @cached_property
    def arrows(self) -> list[ForceArrow]:
        """Forces of the walls on each body that touches them, where they act in the mean."""
        return body_arrows(self.recording.contacts, self.model, len(self.time))


def shown_samples(inside: NDArray[np.bool_]) -> int:
    """Return how many samples are shown of a body that is inside the pipes or not, (T,).

    The last one is that in which it has left them for good; all, if it was never inside.
    """
    within = np.flatnonzero(inside)
    return min(int(within[-1]) + 2, len(inside)) if len(within) else len(inside)
