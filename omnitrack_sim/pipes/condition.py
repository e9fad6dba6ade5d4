"""Condition of old pipes: relief and couplings, drawn into the pipes of a network by rates.

A condition is a file: a table for each kind of defect, with its rate a kilometre, its sizes and
where these come from. Defects of one kind are independent of each other and of the place, so their
number in a length of pipe is Poisson's. What does not fit into a straight is left out of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import Field, field_validator

from omnitrack_sim.base.bounds import MAX_TOWN_PARTS
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.reading import CONDITION, NAME_PATTERN, checked, read_file
from omnitrack_sim.base.table import NotNegative, Positive, Table
from omnitrack_sim.pipes.fittings.coupling import MAX_OFFSET, Coupling
from omnitrack_sim.pipes.fittings.elbow import Elbow
from omnitrack_sim.pipes.fittings.relieved import Relieved
from omnitrack_sim.pipes.fittings.straight import MAX_STEEP, Straight
from omnitrack_sim.pipes.network import Network, validate
from omnitrack_sim.pipes.relief import (
    MAX_WAVE,
    MIN_BEAD_HEIGHT,
    MIN_BEAD_WIDTH,
    MIN_DENT,
    MIN_WAVE,
    Corrosion,
    Dent,
    Deposit,
    Ovality,
    Relief,
    Weld,
)

Kind = Literal["offset", "gap", "step", "weld", "ovality", "deposit", "dent", "corrosion"]
JOINTS: tuple[Kind, ...] = ("offset", "step", "gap")
RELIEF: tuple[Kind, ...] = ("weld", "ovality", "deposit", "dent", "corrosion")
"""Kinds that are couplings, and that are relief of a pipe."""
MAX_PARTS_EACH = 4
"""Parts that a displaced pipe adds to a straight."""
GAP_DEPTH = 0.1
"""Depth of the groove of an open joint, bores; assumed."""
LEAST = 0.1
"""Least length of pipe between two joints, bores."""
MAX_PIPE = 12.0
"""Longest pipe that is displaced between two joints, bores: 2 m at 160 mm; assumed."""
BEAD = 10 / 3
"""Width of a bead over its height, as of the default one."""
DENT = 6.0
"""Length and width of a dent over its depth; assumed."""
WAVES = 20.0
"""Wavelength of corrosion over its roughness, as of the default one."""
ROUNDED = 5
"""Decimals to which lengths, m, are rounded, so that files are short."""
_TRIES = 20
_Pipe = TypeVar("_Pipe", Straight, Elbow)


class Defect(Table):
    """What is drawn, how often and how large.

    Attributes:
        kind: a pipe that is displaced aside (``offset``) or of a narrower bore (``step``) between
            two joints, an open joint (``gap``), or a kind of relief.
        per_km: rate, a kilometre of straight pipe, with ``elbows`` of elbows too.
        size: bores, least and largest: of an offset, gap, step up, bead, bed or dent; roughness of
            corrosion; of ovality its ratio. It is uniform between both.
        length: bores, least and largest, of ovality and deposits.
        elbows: relief is drawn into elbows as well, where they take it.
        source: of the figures, or that they are assumed.
    """

    kind: Kind
    per_km: NotNegative
    size: tuple[Positive, Positive]
    length: tuple[Positive, Positive] | None = None
    elbows: bool = False
    source: Annotated[str, Field(min_length=1)]

    @field_validator("size", "length")
    @classmethod
    def _rises(cls, ends: tuple[float, float] | None) -> tuple[float, float] | None:
        if ends is not None and ends[0] > ends[1]:
            raise ValueError("must have the lower one first")
        return ends

    @field_validator("size")
    @classmethod
    def _is_possible(cls, size: tuple[float, float]) -> tuple[float, float]:
        if size[1] > MAX_SIZE:
            raise ValueError(f"must be up to {MAX_SIZE:g} bores")
        return size


MAX_SIZE = 0.5
"""Largest size of a defect, bores."""


class Condition(Table):
    """A table of defects. docs/reference/networks.md explains the keys.

    Attributes:
        name: of the file. words: what it stands for. defects: by kind.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    words: str = ""
    defects: Annotated[tuple[Defect, ...], Field(max_length=100)]


def load_condition(source: str | Path) -> Condition:
    """Read a condition's file, or a shipped one by name: ``good``, ``fair`` or ``poor``.

    Raises:
        NetworkError: no such file, bad TOML, or any fault in it.
    """
    _, data = read_file(source, CONDITION, NetworkError)
    return checked(Condition, data, NetworkError)


def in_condition(network: Network, condition: str | Path | Condition, seed: int) -> Network:
    """Return a network in a condition: ends, fittings and lengths stay, straights are as they are.

    A straight that joints are drawn into becomes several parts: the first keeps its name, those
    behind are numbered, ``NAME:2`` and so on. Pipes with a section, relief or a profile stay as
    they are.

    Args:
        network: of ideal pipes.
        condition: its file, a shipped one by name, or one that was read.
        seed: of the draws. The same arguments give the same network.

    Raises:
        NetworkError: no such condition; more parts than a network may have.

    Example:
        >>> import omnitrack_sim as ot
        >>> old = ot.random_network(7, fittings=5, condition="poor")
        >>> len(old.fittings) > 5
        True
    """
    if not isinstance(condition, Condition):
        condition = load_condition(condition)
    rate = sum(one.per_km for one in condition.defects if one.kind in JOINTS) / 1000
    parts = round(len(network.fittings) + MAX_PARTS_EACH * rate * network.length)
    if parts > MAX_TOWN_PARTS:
        problem = f"makes {parts} parts or less; at most {MAX_TOWN_PARTS}: give lower rates"
        raise NetworkError(Fault("condition", f"{condition.name!r} {problem}"))
    data = network.model_dump(mode="json")
    # A generator apart from that of a random network and its mission.
    ageing = _Ageing(condition, np.random.default_rng([seed, 2]), data["joints"])
    rows: list[dict[str, Any]] = []
    for i, row in enumerate(data["fittings"]):
        fitting = network.pipes.parts[i].fitting
        if type(fitting) is Straight and fitting == Straight(
            fitting.length, fitting.inner_diameter
        ):
            steep = abs(network.pipes.parts[i].pose.rotation[2, 2]) > MAX_STEEP
            rows += ageing.aged(row, bool(steep))
        elif type(fitting) is Elbow and not fitting.relief and fitting.profile is None:
            aged = ageing.relieved(fitting)
            rows.append(row | ({"relief": aged.to_table()["relief"]} if aged.relief else {}))
        else:
            rows.append(row)
    joints, ports = ageing.joints, data.get("ports", {})
    ports = {name: ageing.moved.get(port, port) for name, port in ports.items()}
    return validate({**data, "fittings": rows, "joints": joints, "ports": ports})


class _Joint(NamedTuple):
    """What two joints or one take of a straight: from where, in m, and the parts, in order."""

    begin: float
    parts: tuple[Coupling | Straight, ...]

    @property
    def end(self) -> float:
        """Where it ends, m."""
        return self.begin + sum(part.length for part in self.parts)


class _Ageing:
    """Draws of defects into the straights of a network, one after the other.

    Attributes:
        joints: tables of the network's joints.
        moved: by the port ``end`` of a straight that is now several parts, that of the last.
    """

    def __init__(
        self, condition: Condition, rng: np.random.Generator, joints: list[dict[str, Any]]
    ) -> None:
        self._condition, self._rng = condition, rng
        self._old_joints = joints
        self._new_joints: list[dict[str, Any]] = []
        self.moved: dict[str, str] = {}

    @property
    def joints(self) -> list[dict[str, Any]]:
        """The joints of the network, those of the new parts behind."""
        old = [
            {**joint, "ports": [self.moved.get(port, port) for port in joint["ports"]]}
            for joint in self._old_joints
        ]
        return [*old, *self._new_joints]

    def aged(self, row: Mapping[str, Any], steep: bool) -> list[dict[str, Any]]:
        """Return the parts of a straight, with what is drawn into it.

        Args:
            row: table of the straight.
            steep: it has no lowest side, so that nothing settles in it.
        """
        parts = self._jointed(row["length"], row["inner_diameter"])
        whole = [
            self.relieved(part, steep=steep) if isinstance(part, Straight) else part
            for part in parts
        ]
        name, common = row["name"], {"pipe": row["pipe"]} if row.get("pipe") else {}
        names = [name, *(f"{name}:{k}" for k in range(2, len(whole) + 1))]
        if len(whole) > 1:
            self.moved[f"{name}.end"] = f"{names[-1]}.end"
        for one, other in pairwise(names):
            self._new_joints.append({"ports": [f"{one}.end", f"{other}.start"], "turn_deg": 0.0})
        tables = [part.to_table() for part in whole]
        return [{**own, "name": n, **common} for n, own in zip(names, tables, strict=True)]

    def _drawn(
        self, length: float, kinds: Sequence[Kind], in_elbow: bool = False
    ) -> Iterator[Defect]:
        """Yield the defects of some kinds in a length, m, of pipe, in the order of the table."""
        for defect in self._condition.defects:
            if defect.kind in kinds and (defect.elbows or not in_elbow):
                count = int(self._rng.poisson(defect.per_km * length / 1000))
                yield from [defect] * count

    def _size(self, defect: Defect, bore: float) -> float:
        """Size of a defect, m."""
        return round(max(bore * float(self._rng.uniform(*defect.size)), MIN_BEAD_HEIGHT), ROUNDED)

    def _jointed(self, length: float, bore: float) -> list[Coupling | Straight]:
        """Return the parts of a straight, ``length`` m long, with joints drawn into it."""
        taken: list[_Joint] = []
        least = LEAST * bore
        for defect in self._drawn(length, JOINTS):
            parts = self._joint(defect, bore, length)
            need = sum(part.length for part in parts)
            for _ in range(_TRIES if need + 2 * least <= length else 0):
                begin = round(float(self._rng.uniform(least, length - least - need)), ROUNDED)
                joint = _Joint(begin, parts)
                if all(joint.end + least <= one.begin or one.end + least <= begin for one in taken):
                    taken.append(joint)
                    break
        made: list[Coupling | Straight] = []
        at = 0.0
        for joint in sorted(taken, key=lambda one: one.begin):
            made += [Straight(round(joint.begin - at, ROUNDED), bore), *joint.parts]
            at = joint.end
        return [*made, Straight(round(length - at, 9), bore)]

    def _joint(self, defect: Defect, bore: float, room: float) -> tuple[Coupling | Straight, ...]:
        """Return a joint, or a pipe that is displaced between two joints."""
        size, angle = self._size(defect, bore), round(float(self._rng.uniform(-180, 180)), 1)
        if defect.kind == "gap":
            return (Coupling(gap=size, depth=GAP_DEPTH * bore, inner_diameter=bore),)
        longest = max(min(MAX_PIPE * bore, room / 2) - 2 * bore, bore)
        pipe = round(float(self._rng.uniform(bore / 2, longest)), ROUNDED)
        if defect.kind == "step":
            narrow = bore - 2 * size
            return (
                Coupling(end_diameter=narrow, inner_diameter=bore),
                Straight(pipe, narrow),
                Coupling(end_diameter=bore, inner_diameter=narrow),
            )
        size, turn = min(size, MAX_OFFSET * bore), math.radians(angle)
        ways = [turn, math.remainder(turn + math.pi, 2 * math.pi)]
        aside, back = (Coupling(offset=size, direction=way, inner_diameter=bore) for way in ways)
        return aside, Straight(pipe, bore), back

    def relieved(self, pipe: _Pipe, *, steep: bool = False) -> _Pipe:
        """Return a pipe with relief drawn into it.

        Args:
            pipe: a straight or an elbow.
            steep: see ``aged``.
        """
        entries: list[Relief] = []
        for defect in self._drawn(pipe.axis_length, RELIEF, isinstance(pipe, Elbow)):
            entry = self._entry(defect, pipe)
            settles = not (steep and defect.kind == "deposit")
            # A wall is rough once, all over.
            rough = isinstance(entry, Corrosion)
            is_new = not (rough and any(isinstance(one, Corrosion) for one in entries))
            if settles and is_new and not any(entry.problems(pipe)):
                entries.append(entry)
        return replace(pipe, relief=tuple(entries)) if entries else pipe

    def _entry(self, defect: Defect, pipe: Relieved) -> Relief:
        """Return relief of a pipe; where it is too long for it, as long as the pipe."""
        rng, bore = self._rng, pipe.inner_diameter
        size, part, angle = self._size(defect, bore), rng.random(), rng.uniform(-180, 180)
        low, high = defect.length or (1.0, 1.0)
        length = min(bore * float(rng.uniform(low, high)), pipe.axis_length)
        direction = round(float(angle), 1)

        def at(reach: float) -> float:
            # Within the pipe, though rounded.
            place = reach / 2 + part * (pipe.axis_length - reach)
            return round(float(np.clip(place, 0, None)), ROUNDED)

        reach = math.floor(length * 10**ROUNDED - 1) / 10**ROUNDED
        if defect.kind == "ovality":
            ratio = round(size / bore, ROUNDED)
            return Ovality(
                kind="ovality", ratio=ratio, direction_deg=direction, at=at(length), length=reach
            )
        if defect.kind == "deposit":
            return Deposit(kind="deposit", at=at(length), length=reach, depth=size)
        if defect.kind == "dent":
            wide = round(max(DENT * size, MIN_DENT), ROUNDED)
            own = {"angle_deg": direction, "depth": size, "length": wide, "width": wide}
            return Dent(kind="dent", at=at(wide), **own)
        if defect.kind == "corrosion":
            waves = round(float(np.clip(WAVES * size, MIN_WAVE, MAX_WAVE)), ROUNDED)
            seed = int(rng.integers(2**32))
            return Corrosion(kind="corrosion", roughness=size, wavelength=waves, seed=seed)
        wide = round(max(BEAD * size, MIN_BEAD_WIDTH), ROUNDED)
        return Weld(kind="weld", at=at(wide), height=size, width=wide)
