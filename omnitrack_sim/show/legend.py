"""Legends: colours and short names of a robot's parts, alike in curves, bars, arrows and badges."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from omnitrack_sim.record.display import Colour
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.show.plots.style import CURVE_COLOURS

RAMP: tuple[Colour, ...] = (
    (0.30, 0.38, 0.86),
    (0.05, 0.58, 0.68),
    (0.30, 0.66, 0.28),
    (0.86, 0.62, 0.05),
    (0.84, 0.30, 0.40),
)
"""Colours of parts, first to last, of which there are more than can be told apart one by one:
neighbours in the model, such as links of a snake, look alike. All show on white and on black."""
MAX_NAMED = 12
"""Parts that a legend names one by one; of more it names the first and the last."""
_WORDS = re.compile(r"[^\W_]+")


class Parts(NamedTuple):
    """Parts of one kind, such as bodies, that the columns of channels are of.

    Attributes:
        each: what one of them is, such as "body"; its plural stands before the legend.
        names: of all of them, in the order of the columns.
        owners: number of the body that each belongs to, or moves.
        active: which of them touch, move or act at all; the others have no line.
    """

    each: str
    names: tuple[str, ...]
    owners: tuple[int, ...]
    active: tuple[bool, ...]


class Legend(NamedTuple):
    """Names and colours of the parts of one kind.

    Attributes:
        heading: of the legend, such as "bodies".
        names: of all parts, in the order of the columns of their curves.
        short: the same without the words that all active ones share.
        colours: of the active ones; None of the others, which have no line.
        owners: number of the body that each belongs to, or moves.
    """

    heading: str
    names: tuple[str, ...]
    short: tuple[str, ...]
    colours: tuple[Colour | None, ...]
    owners: tuple[int, ...]

    @property
    def rows(self) -> list[tuple[str, str, Colour]]:
        """Short name, whole name and colour of each active part; of many those of the two ends."""
        rows = [
            (short, name, colour)
            for short, name, colour in zip(self.short, self.names, self.colours, strict=True)
            if colour is not None
        ]
        if len(rows) <= MAX_NAMED:
            return rows
        (short, name, colour), count = rows[-1], len(rows) - 1
        return [rows[0], (f"to {short}, {count} more", name, colour)]


PLURALS = {"body": "bodies"}


def legends_of(kinds: Iterable[Parts]) -> dict[str, Legend]:
    """Return the legend of each kind of parts, by its name.

    A part has the colour of the body that it belongs to or moves, if some of its kind belong to
    bodies that have one and no two to the same; else its kind has colours of its own.

    Args:
        kinds: of parts, the bodies first.
    """
    kinds = list(kinds)
    painted: set[int] = set()
    for one in kinds:
        own = _active_owners(one)
        if not painted or painted.intersection(own):
            painted.update(own)
    owners = sorted(painted)
    of_body = dict(zip(owners, colours(len(owners)), strict=True))
    return {one.each: _legend(one, of_body) for one in kinds}


def _active_owners(parts: Parts) -> list[int]:
    return [owner for owner, on in zip(parts.owners, parts.active, strict=True) if on]


def _legend(parts: Parts, of_body: Mapping[int, Colour]) -> Legend:
    rows, own = np.flatnonzero(parts.active).tolist(), _active_owners(parts)
    shared = len(set(own)) == len(own) and of_body.keys() >= set(own)
    chosen = [of_body[owner] for owner in own] if shared else colours(len(own))
    paint: list[Colour | None] = [None] * len(parts.names)
    short = list(parts.names)
    for row, colour, name in zip(
        rows, chosen, short_names([parts.names[r] for r in rows]), strict=True
    ):
        paint[row], short[row] = colour, name
    heading = PLURALS.get(parts.each, f"{parts.each}s")
    return Legend(heading, parts.names, tuple(short), tuple(paint), parts.owners)


def merged(legends: Iterable[Legend]) -> list[Legend]:
    """Return the legends that have rows; those with the same short names and colours as one."""
    found: dict[frozenset[tuple[str, Colour]], Legend] = {}
    for legend in legends:
        if not legend.rows:
            continue
        key = frozenset((short, colour) for short, _, colour in legend.rows)
        before = found.get(key)
        both = "" if before is None else f"{before.heading}, {legend.heading}"
        found[key] = legend if before is None else before._replace(heading=both)
    return list(found.values())


def colours(count: int) -> list[Colour]:
    """Return colours of ``count`` parts: apart with any colour vision, or a ramp of many."""
    if count <= len(CURVE_COLOURS):
        return list(CURVE_COLOURS[:count])
    place, steps = np.linspace(0, len(RAMP) - 1, count), np.arange(len(RAMP))
    columns = [np.interp(place, steps, column) for column in np.array(RAMP).T]
    return [(float(r), float(g), float(b)) for r, g, b in zip(*columns, strict=True)]


def short_names(names: Sequence[str]) -> list[str]:
    """Return names without the words that all of them share, where they stay different.

    Example:
        >>> from omnitrack_sim.show.legend import short_names
        >>> short_names(["front_left_wheel_assembly", "rear_left_wheel_assembly"])
        ['front', 'rear']
    """
    words = [_WORDS.findall(name) for name in names]
    shared = set.intersection(*map(set, words)) if len(names) > 1 else set()
    rest = [" ".join(word for word in own if word not in shared) for own in words]
    return rest if shared and all(rest) and len(set(rest)) == len(rest) else list(names)


def actuator_owners(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the number of the body that each actuator moves; 0 of one that moves several."""
    owners = []
    kinds = mujoco.mjtTrn
    for i, (target, _) in enumerate(model.actuator_trnid.tolist()):
        kind = kinds(int(model.actuator_trntype[i]))
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            owners.append(int(model.jnt_bodyid[target]))
        elif kind == kinds.mjTRN_SITE:
            owners.append(int(model.site_bodyid[target]))
        else:
            owners.append(target if kind == kinds.mjTRN_BODY else 0)
    return tuple(owners)


def parts_of_run(model: mujoco.MjModel, trajectory: Trajectory) -> list[Parts]:
    """Return the kinds of parts that the channels of a run have names for.

    Args:
        model: of the robot.
        trajectory: the record.
    """
    groups: dict[str, list[str]] = {}
    for name, channel in trajectory.schema.items():
        if channel.names and channel.display.each:
            groups.setdefault(channel.display.each, []).append(name)
    kinds = []
    for each, channels in groups.items():
        names = trajectory.schema[channels[0]].names
        alike = [one for one in channels if trajectory.schema[one].names == names]
        acts = [np.nan_to_num(trajectory[one]).any(axis=0).ravel() for one in alike]
        active = np.any(acts, axis=0)
        # Where nothing acts at all, each has its line at zero.
        active = tuple((active if active.any() else ~active).tolist())
        kinds.append(Parts(each, names, _owners(model, each, names), active))
    return sorted(kinds, key=lambda one: one.each != "body")


def _owners(model: mujoco.MjModel, each: str, names: Sequence[str]) -> tuple[int, ...]:
    """Return the bodies that parts belong to; of no body of the model a number below 0."""
    if each == "actuator" and len(names) == model.nu:
        return actuator_owners(model)
    bodies = range(1, model.nbody) if each == "body" else ()
    known: dict[str, int] = {str(model.body(i).name or f"body_{i}"): i for i in bodies}
    return tuple(known.get(name, -1 - i) for i, name in enumerate(names))
