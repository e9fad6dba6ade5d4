"""Playback of a recording of any MuJoCo model in exact pipes."""

from __future__ import annotations

from collections.abc import Mapping
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
from omnitrack_sim.robots.display import HIDDEN_FROM
from omnitrack_sim.show.landmarks import Landmarks, PassageSpan
from omnitrack_sim.show.playback import POINTS_APART, ContactForces, Playback, sound_rows
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.surfaces import DRAWN

MAX_CURVES = 6
"""Lines of one plot: there are as many colours."""
BORE, REACH = 0.16, 0.16
"""Bore, and reach of a robot about its body, m, of pictures of size 1."""
EXTREMES = 20
"""Samples by which the robot's reach is judged: more would take longer than they tell."""
LARGE_PERCENTILE, ARROW_BORES = 98, 0.5
"""Percentile of the forces whose arrow is so long, in bores: single shocks do not set the scale."""


class RecordingPlayback(Playback):
    """Playback of a recording; its arrows are the forces of the walls.

    Args:
        recording: with at least one sample.

    Raises:
        InputError: it has no sample.
    """

    state: tuple[StateValue, ...] = (
        ("distance", "", 1e3, 0, " mm"),
        ("speed", "", 1e3, 0, " mm/s"),
    )

    def __init__(self, recording: Recording) -> None:
        recording.require_samples()
        self.recording, self.network = recording, recording.pipes.assembly
        self.name = f"recording of {recording.model.body(recording.body).name or 'a robot'}"
        samples = len(recording)
        rows = np.linspace(0, samples - 1, EXTREMES).astype(int)
        self.extremes = tuple(np.unique(rows).tolist())
        carried = [mount for mount in self.mounts.values() if mount.body]
        self.page_camera = carried[0] if carried else None

    def __reduce__(self) -> tuple[Any, ...]:
        return RecordingPlayback, (self.recording,)

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
        return StatusText(place, (move, touch))

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
        contacts = self.recording.contacts
        sizes = np.linalg.norm(contacts.force, axis=1)
        large = float(np.percentile(sizes, LARGE_PERCENTILE)) if len(sizes) else 0.0
        bore = 2 * self.network.parts[0].fitting.radius
        metres = ARROW_BORES * bore / large if large > 0 else 0.0
        return ContactForces(contacts.sample, contacts.position, contacts.force, metres)

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
        curves["position"] = Curve(Display("Position of the body", "m"), position, ("x", "y", "z"))
        return curves | self._model_curves()

    def _model_curves(self) -> dict[str, Curve]:
        """Return the curves of actuators and joints, where there are not too many."""
        model, curves = self.model, {}
        names = tuple(model.actuator(i).name or str(i) for i in range(model.nu))
        forces = self.recording["actuator_force"]
        curves["actuator_force"] = Curve(Display("Actuator forces", "N, N m"), forces, names)
        slides = Display("Slides", "mm", 1e3, span=1.0)
        hinges = Display("Hinges", "deg", float(np.degrees(1.0)), span=1.0)
        for name, kind, display in (
            ("slides", mujoco.mjtJoint.mjJNT_SLIDE, slides),
            ("hinges", mujoco.mjtJoint.mjJNT_HINGE, hinges),
        ):
            joints = np.flatnonzero(model.jnt_type == kind).tolist()
            names = tuple(model.joint(i).name or str(i) for i in joints)
            values = self.recording.qpos[:, model.jnt_qposadr[joints]]
            curves[name] = Curve(display, values, names)
        return {
            name: curve for name, curve in curves.items() if 1 <= len(curve.names) <= MAX_CURVES
        }

    @cached_property
    def heading(self) -> dict[str, Any]:
        """See ``Playback``."""
        curves, time = self.curves, self.time
        least = 1e3 * curves["clearance"].values.min()
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
            "outcome": "ends",
            "success": None,
            "advice": "",
            "reason": f"{len(time)} samples from {first:.6g} to {last:.6g} s",
            "duration": float(np.ptp(time)),
            "figures": figures,
            "provenance": [["mujoco", mujoco.__version__]],
        }
        return finite(heading)

    @cached_property
    def arrows(self) -> list[ForceArrow]:
        """Forces of the walls on each body that touches them, where they act in the mean."""
        contacts, samples, arrows = self.recording.contacts, len(self.time), []
        bodies = self.model.geom_bodyid[contacts.geom]
        for body in np.unique(bodies).tolist():
            mine = bodies == body
            sample, weight = contacts.sample[mine], contacts.normal_force[mine] + 1e-12
            total = np.bincount(sample, weight, samples)
            there = total > 0
            # Without contact an arrow has no length and stays where it was last.
            last = np.maximum.accumulate(np.where(there, np.arange(samples), np.argmax(there)))
            push = contacts.normal[mine] * contacts.normal_force[mine, None]
            moment = _summed(contacts.position[mine] * weight[:, None], sample, samples)
            point = moment[last] / total[last, None]
            pull = contacts.force[mine] - push
            arrows.append(ForceArrow("normal_force", point, _summed(push, sample, samples)))
            arrows.append(ForceArrow("traction", point, _summed(pull, sample, samples)))
        return arrows


def _summed(values: Array, sample: NDArray[Any], samples: int) -> Array:
    """Return the sums (samples, 3) of vectors (C, 3) over those of the same sample."""
    columns = [np.bincount(sample, column, samples) for column in values.T]
    return np.stack(columns, axis=-1).astype(float)
