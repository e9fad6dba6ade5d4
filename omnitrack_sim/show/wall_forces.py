"""Forces of the walls on a robot's bodies, as films, pages and panels show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.display import Bar, Colour, ForceArrow
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.show.legend import Legend
from omnitrack_sim.show.playback import ContactForces
from omnitrack_sim.show.recording import WallContacts

LARGE_PERCENTILE, ARROW_BORES = 98, 0.5
"""Percentile of the forces whose arrow is so long, in bores: single shocks do not set the scale."""
MIN_DEPTH = 1e-6
"""Depth that each contact counts for at least, m, where one force is shared among several."""
MAX_BARS = 6
"""Bodies of which a status panel has a bar: of more, those that press hardest in the mean."""


def contacts_of_run(model: mujoco.MjModel, trajectory: Trajectory) -> WallContacts:
    """Return where the walls press on a robot in a run, and how hard; without traction.

    A run records the normal force on each body (``wall_force``); where it acts, and in which
    direction, follows from the pose. Of several contacts of a body the deeper one bears more.

    Args:
        model: of the robot in its walls, which are the geoms of the world.
        trajectory: the record.
    """
    data, rows = mujoco.MjData(model), []
    column = {model.body(n).id: i for i, n in enumerate(trajectory.schema["wall_force"].names)}
    forces = np.nan_to_num(trajectory["wall_force"])
    for sample in np.flatnonzero(forces.any(axis=1)).tolist():
        data.qpos[:] = trajectory.qpos[sample]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        rows.append(_pressed(model, data, forces[sample], column, sample))
    return WallContacts(*(np.concatenate(values) for values in zip(_NOTHING, *rows, strict=True)))


_NOTHING = WallContacts(*np.zeros((2, 0), np.intp), *np.zeros((3, 0, 3)), *np.zeros((2, 0)))


def _pressed(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    forces: Array,
    column: Mapping[int, int],
    sample: int,
) -> WallContacts:
    """Return the contacts of a state, among which the ``forces`` (bodies,) N are shared out."""
    contact = data.contact
    of_world = model.geom_bodyid[contact.geom] == 0  # (ncon, 2)
    rows = np.flatnonzero(of_world[:, 0] != of_world[:, 1])
    first = of_world[rows, 0]  # the robot's geom is the second one
    geom = np.where(first, contact.geom[rows, 1], contact.geom[rows, 0])
    place = np.array([column.get(body, -1) for body in model.geom_bodyid[geom].tolist()], np.intp)
    # A contact may just have closed, and press from the next step on.
    known = (place >= 0) & (forces[place] > 0)
    rows, first, geom, place = rows[known], first[known], geom[known], place[known]
    # Forces are of the step before, after which a contact may just have opened.
    weight = np.maximum(-contact.dist[rows], 0.0) + MIN_DEPTH
    total = np.bincount(place, weight, len(forces))
    size = forces[place] * weight / total[place]
    # Rows of the frame are normal and tangents; the normal points to the second geom.
    normal = np.where(first, 1.0, -1.0)[:, None] * contact.frame[rows].reshape(-1, 3, 3)[:, 0]
    return WallContacts(
        np.full(len(rows), sample, np.intp),
        geom.astype(np.intp),
        np.array(contact.pos[rows]),
        size[:, None] * normal,
        normal,
        size,
        np.array(contact.dist[rows]),
    )


def body_forces(contacts: WallContacts, model: mujoco.MjModel, samples: int) -> Array:
    """Return the sums of the normal forces of the walls on each body, (samples, nbody) N."""
    body = model.geom_bodyid[contacts.geom]
    cell = contacts.sample * model.nbody + body
    sums = np.bincount(cell, contacts.normal_force, samples * model.nbody)
    return sums.reshape(samples, model.nbody).astype(float)


def drawn_forces(
    contacts: WallContacts, model: mujoco.MjModel, legend: Legend, bore: float
) -> ContactForces:
    """Return the forces that films draw, each in the colour of its body.

    The arrow of nearly the largest is ``ARROW_BORES`` long; ``bore`` in m.
    """
    sizes = np.linalg.norm(contacts.force, axis=1)
    large = float(np.percentile(sizes, LARGE_PERCENTILE)) if len(sizes) else 0.0
    metres = ARROW_BORES * bore / large if large > 0 else 0.0
    paint = np.zeros((model.nbody, 3))
    for owner, colour in zip(legend.owners, legend.colours, strict=True):
        if colour is not None and owner >= 0:
            paint[owner] = colour
    colour = paint[model.geom_bodyid[contacts.geom]]
    return ContactForces(contacts.sample, contacts.position, contacts.force, colour, metres)


def body_arrows(contacts: WallContacts, model: mujoco.MjModel, samples: int) -> list[ForceArrow]:
    """Return normal force and traction of the walls on each body, where they act in the mean.

    A kind of force that is nowhere is left out.
    """
    arrows: list[ForceArrow] = []
    bodies = model.geom_bodyid[contacts.geom]
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
    acts = {arrow.kind for arrow in arrows if arrow.force.any()}
    return [arrow for arrow in arrows if arrow.kind in acts]


def _summed(values: Array, sample: NDArray[Any], samples: int) -> Array:
    """Return the sums (samples, 3) of vectors (C, 3) over those of the same sample."""
    columns = [np.bincount(sample, column, samples) for column in values.T]
    return np.stack(columns, axis=-1).astype(float)


class ForceBars:
    """Bars of the force of the wall on each body, for status panels.

    Args:
        legend: of the bodies.
        forces: (T, bodies) N, in the order of the legend.
    """

    caption = "force on the wall, N"

    def __init__(self, legend: Legend, forces: Array) -> None:
        known = np.nan_to_num(forces)
        touching = np.flatnonzero([colour is not None for colour in legend.colours])
        hardest = touching[np.argsort(-known[:, touching].mean(axis=0), kind="stable")]
        self._rows: Sequence[int] = np.sort(hardest[:MAX_BARS]).tolist()
        self._legend, self._forces = legend, known
        shown = known[:, self._rows]
        shown = shown[shown > 0]
        self._full = float(np.percentile(shown, LARGE_PERCENTILE)) if shown.size else 1.0

    def at(self, row: int) -> tuple[Bar, ...]:
        """Return the bars at a sample; a force beyond the scale fills its bar."""
        return tuple(self._bar(column, float(self._forces[row, column])) for column in self._rows)

    def _bar(self, column: int, force: float) -> Bar:
        colour: Colour | None = self._legend.colours[column]
        share = min(force / self._full, 1.0)
        name = self._legend.short[column]
        return Bar(name, colour or (0.5, 0.5, 0.5), share, f"{force:.1f}", has_sign=False)
