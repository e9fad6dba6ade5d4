"""Networks: fittings and joints as a file, placed in the world part by part from the first."""

from __future__ import annotations

import heapq
import math
import re
from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import Field, SerializeAsAny, ValidationError, model_validator

from omnitrack_sim.base.bounds import MAX_COORDINATE, MAX_TOWN_LENGTH, MAX_TOWN_PARTS, too_long
from omnitrack_sim.base.errors import Fault, GeometryError, NetworkError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.paths import Document
from omnitrack_sim.base.reading import (
    NAME_PATTERN,
    NETWORK,
    by_kind,
    checked,
    faults_of,
    read_file,
)
from omnitrack_sim.base.rotations import TURNED, Pose, frame_along
from omnitrack_sim.base.table import Angle, Direction, Table
from omnitrack_sim.base.text import as_toml, toml_key
from omnitrack_sim.pipes import Assembly, Fitting, Part, Port, attached
from omnitrack_sim.pipes.assembly import joined
from omnitrack_sim.pipes.fittings.kinds import FittingEntry, table_of
from omnitrack_sim.pipes.profile import with_profiles

CLOSES = 1e-3
"""Distance by which the two ports of a joint that closes a loop may miss each other, m."""
CLOSES_ANGLE = math.radians(0.1)
"""Angle by which the axes of these two ports may miss being opposite, rad."""
_Port = TypeVar("_Port")
_Name = TypeVar("_Name", str, int)


def both_ways(joints: Iterable[tuple[_Port, _Port]]) -> dict[_Port, _Port]:
    """Map each port of some joints to the port that it is joined to."""
    return {port: other for a, b in joints for port, other in ((a, b), (b, a))}


Joined = tuple[tuple[Port, Port], float]
"""Two ports in one place, and the turn, rad, of the later part about the joint's axis."""


def lay_out(
    fittings: Mapping[str, Fitting],
    joints: Sequence[Joined],
    first: Mapping[int, Pose],
    *,
    checked: bool = True,
) -> Assembly:
    """Place the fittings along the joints, breadth first.

    Args:
        fittings: by name, in order.
        joints: ports that exist, each in one joint at most.
        first: by the index of a fitting, in each connected group one, the frame of its first port,
            z into the pipe, world frame.
        checked: False for parts that need not fit together.

    Raises:
        NetworkError: parts that hang on nothing, loops that do not close, bores that differ, parts
            that run into each other. Every fault is listed.
    """
    names, kinds = list(fittings), list(fittings.values())
    poses, used = _placed(kinds, joints, first)
    if not checked:
        placed = tuple(Part(name, kinds[i], poses[i]) for i, name in enumerate(names))
        return Assembly.unchecked(placed, tuple(ends for ends, _ in joints))
    faults = [
        Fault(f"fittings.{i}", f"{name!r} is not connected to {names[0]!r}")
        for i, name in enumerate(names)
        if i not in poses
    ]
    parts = {i: Part(names[i], kinds[i], poses[i]) for i in sorted(poses)}
    for k, (ends, _) in enumerate(joints):
        # A joint that placed no part closes a loop: its two ports were placed from elsewhere.
        if k not in used and ends[0][0] in parts:
            faults += _misses(k, ends, parts)
    # Parts that hang on nothing have no place; the others are checked against each other all the
    # same.
    order = {i: place for place, i in enumerate(parts)}
    kept = [((order[i], p), (order[j], q)) for ((i, p), (j, q)), _ in joints if i in order]
    try:
        network = Assembly(tuple(parts.values()), tuple(kept))
    except GeometryError as error:
        raise NetworkError([*faults, *_in_file(error.faults, list(order))]) from None
    if faults:
        raise NetworkError(faults)
    return network


def _placed(
    kinds: Sequence[Fitting], joints: Sequence[Joined], first: Mapping[int, Pose]
) -> tuple[dict[int, Pose], set[int]]:
    """Return poses by part, and the joints that placed a part.

    The others close loops, or lie apart from the first part.
    """
    at_part: list[list[tuple[int, Port, Port, float]]] = [[] for _ in kinds]
    for k, (ends, turn) in enumerate(joints):
        for here, there in (ends, ends[::-1]):
            at_part[here[0]].append((k, here, there, turn))
    ports = [kind.ports for kind in kinds]
    poses = {
        i: attached(frame, kinds[i], kinds[i].port_names[0], 0.0) for i, frame in first.items()
    }
    used: set[int] = set()
    queue = deque(poses)
    while queue:
        part = queue.popleft()
        for k, (here, port), (there, other), turn in at_part[part]:
            if there not in poses:
                out = poses[here] @ ports[here][port]
                poses[there] = joined(out, ports[there][other], turn)
                used.add(k)
                queue.append(there)
    return poses, used


def _misses(k: int, ends: tuple[Port, Port], parts: Mapping[int, Part]) -> list[Fault]:
    """Fault of a loop that does not close."""
    (i, port_i), (j, port_j) = ends
    a, b = parts[i].port(port_i), parts[j].port(port_j)
    gap = float(np.linalg.norm(a.position - b.position))
    # As chord, not cosine: exact for small angles.
    chord = float(np.linalg.norm(a.rotation[:, 2] + b.rotation[:, 2]))
    angle = 2 * math.asin(min(1.0, chord / 2))
    if gap <= CLOSES and angle <= CLOSES_ANGLE:
        return []
    words = f"{parts[i].name}.{port_i} and {parts[j].name}.{port_j}"
    problem = (
        f"does not close the loop: {words} miss by {1e3 * gap:.3f} mm and "
        f"{math.degrees(angle):.3f} degrees"
    )
    return [Fault(f"joints.{k}", problem)]


def _in_file(faults: Iterable[Fault], order: Sequence[int]) -> list[Fault]:
    """Faults of ``Assembly`` with the paths of a network file."""

    def renamed(text: str) -> str:
        return re.sub(r"\bpipes\.(\d+)", lambda match: f"fittings.{order[int(match[1])]}", text)

    return [
        replace(fault, where=renamed(fault.where), problem=renamed(fault.problem))
        for fault in faults
    ]


PartName = Annotated[str, Field(pattern=r"^[^\s./\\\x00-\x1f]+$")]
"""A part's name is also one of a port and of a geom: no dot, no space, no separator."""


Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]


class NetworkFitting(FittingEntry):
    """A fitting in the list ``fittings``."""

    name: PartName
    pipe: Annotated[str, Field(exclude_if=lambda pipe: not pipe)] = ""
    """Pipe of an imported file that the part belongs to."""


class Origin(Table):
    """Position of the first port of the first fitting, and direction of the pipe, world frame.

    Attributes:
        axis: direction into the pipe.
        turn_deg: rotation of the whole network about that axis.
        position: of that port, m.
    """

    axis: Direction = (0.0, 0.0, 1.0)
    turn_deg: Angle = 0.0
    position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)


class PartOrigin(Origin):
    """The same of another fitting, in a part of the network that is not connected to the first."""

    fitting: str


class Joint(Table):
    """Two ports in one place.

    Attributes:
        ports: two, in any order, such as "riser.end" and "t1.run_start".
        turn_deg: rotation about the joint's axis.
    """

    ports: tuple[str, str]
    turn_deg: Angle = 0.0


class Network(Table):
    """A pipe network as data: fittings by name and what is joined to what.

    Keys and units: see docs/reference/networks.md.

    Attributes:
        name: of the network; the file's name if left out.
        place: where the first port of the first fitting is.
        fittings: a list of parts, at least one; all are connected, but by `places`.
        joints: a list of joints.
        places: like `place`, each with the name of its part as `fitting`, of a part in each group
            that is not connected to the first.
        ports: names for open ends.

    Raises:
        NetworkError: every fault, with its dotted path.

    Example:
        >>> import omnitrack_sim as ot
        >>> network = ot.Network(
        ...     fittings=[
        ...         {"kind": "straight", "name": "inlet", "length": 0.5},
        ...         {"kind": "elbow", "name": "knee"},
        ...     ],
        ...     joints=[{"ports": ("inlet.end", "knee.start")}],
        ... )
        >>> network.open_ends
        ('inlet.start', 'knee.end')
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)] = "network"
    place: Origin = Origin()
    fittings: Annotated[
        tuple[
            Annotated[
                SerializeAsAny[NetworkFitting],
                by_kind(partial(table_of, entry=NetworkFitting)),
            ],
            ...,
        ],
        Field(min_length=1, max_length=MAX_TOWN_PARTS),
    ]
    joints: Annotated[tuple[Joint, ...], Field(max_length=2 * MAX_TOWN_PARTS)] = ()
    # Left out of plain data where there is none: noise is drawn by a scenario's data.
    places: Annotated[
        tuple[PartOrigin, ...],
        Field(max_length=MAX_TOWN_PARTS, exclude_if=lambda places: not places),
    ] = ()
    ports: dict[str, str] = Field(default_factory=dict)

    def __init__(self, **data: Any) -> None:
        try:
            with trusting():  # a program states it; files are read without this method
                super().__init__(**data)
        except ValidationError as reason:
            keys_at = Document(Network, data).keys_at
            raise NetworkError(faults_of(reason, keys_at, _fault)) from None

    # Files are read by pydantic's strict rules, which it leaves where a class has its own __init__.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        faults = self._naming_faults()
        # Each check needs the ones before it: lengths need valid sizes, placing needs a bounded
        # number.
        faults = faults or too_long(self.length, "fittings", MAX_TOWN_LENGTH)
        if not faults:
            _ = self.pipes  # raises by itself
            free = dict.fromkeys(self.open_ends)
            faults = [
                Fault(f"ports.{name}", f"{port!r} is no open end", tuple(free), given=port)
                for name, port in self.ports.items()
                if port not in free
            ]
        if faults:
            raise NetworkError(faults)
        return self

    def __repr__(self) -> str:
        counts = f"{len(self.fittings)} fittings, {len(self.joints)} joints"
        return f"Network({self.name!r}: {counts})"

    __str__ = __repr__

    def __eq__(self, other: object) -> bool:
        """Return whether both hold the same data; what was derived from it does not count."""
        return isinstance(other, Network) and self.model_dump() == other.model_dump()

    # Equality by contents would need a hash of them; nothing keeps networks in sets.
    __hash__ = None  # type: ignore[assignment]

    @cached_property
    def pipes(self) -> Assembly:
        """The fittings, placed in the world."""
        return lay_out(*self._to_lay_out())

    @classmethod
    def believed(
        cls,
        name: str,
        place: Origin,
        fittings: Mapping[str, Fitting],
        joints: Sequence[Joint],
        ports: Mapping[str, str],
        places: Sequence[PartOrigin] = (),
    ) -> Network:
        """Return the network of a map that a robot makes, from connected fittings by name.

        Unlike one from a file it may be impossible: parts may overlap, and loops need not close.

        Raises:
            NetworkError: joints or names of ports that are not there.
        """
        network = cls.model_construct(
            name=name,
            place=place,
            fittings=tuple(
                table_of(fitting.file_kind(), NetworkFitting).model_construct(
                    **fitting.to_table(), name=part
                )
                for part, fitting in fittings.items()
            ),
            joints=tuple(joints),
            places=tuple(places),
            ports=dict(ports),
        )
        faults = network._naming_faults()
        if faults:
            raise NetworkError(faults)
        # ``pipes`` from now on, instead of one that is checked.
        vars(network)["pipes"] = lay_out(*network._to_lay_out(), checked=False)
        return network

    @classmethod
    def believed_from(cls, data: Mapping[str, Any]) -> Network:
        """Return a network as ``believed`` does, from the plain data of its file.

        Raises:
            NetworkError, ValidationError, KeyError: it is no such data.
        """
        fittings = {
            row["name"]: table_of(row["kind"], NetworkFitting).model_validate(row).fitting()
            for row in data["fittings"]
        }
        joints = [Joint.model_validate(row) for row in data.get("joints", ())]
        place = Origin.model_validate(data.get("place", {}))
        places = [PartOrigin.model_validate(row) for row in data.get("places", ())]
        ports = data.get("ports", {})
        return cls.believed(data["name"], place, fittings, joints, ports, places)

    def _to_lay_out(self) -> tuple[dict[str, Fitting], list[Joined], dict[int, Pose]]:
        """Fittings by name, joints, and the frames of the first ports of those with a place."""
        ends = self._ends
        joints = [
            ((ends[j.ports[0]], ends[j.ports[1]]), math.radians(j.turn_deg)) for j in self.joints
        ]
        fittings = {part.name: part.fitting() for part in self.fittings}
        number = {name: i for i, name in enumerate(fittings)}
        first = {0: self.place} | {number[place.fitting]: place for place in self.places}
        frames = {
            i: Pose(frame_along(at.axis, math.radians(at.turn_deg)), np.array(at.position))
            for i, at in first.items()
        }
        return fittings, joints, frames

    def around(
        self, names: Collection[str], reach: float = 1.0, without: Collection[str] = ()
    ) -> Network:
        """Return the network of some fittings and of those within ``reach`` m of pipe, in place.

        It leaves out ``without``; a run along a route through a town needs no more.

        Raises:
            NetworkError: there is no such fitting.

        Example:
            >>> network = ot.load_network("fig14")
            >>> len(network.around(["riser"], reach=0.1).fittings) < len(network.fittings)
            True
        """
        number = {part.name: i for i, part in enumerate(self.fittings)}
        if missing := [name for name in names if name not in number]:
            raise NetworkError(self._unknown_port("names", f"{missing[0]}."))
        beside: dict[int, list[int]] = {i: [] for i in number.values()}
        for (i, _), (j, _) in self.pipes.joints:
            beside[i].append(j)
            beside[j].append(i)
        far = {number[name]: 0.0 for name in names}
        waiting = [(0.0, i) for i in far]
        while waiting:
            distance, i = heapq.heappop(waiting)
            onward = distance + self.fittings[i].fitting().length_of_axes * (distance > 0)
            for j in (j for j in beside[i] if self.fittings[j].name not in without):
                # What is joined to a named fitting is beside it, however long that is.
                if onward <= reach and onward < far.get(j, math.inf):
                    far[j] = max(onward, 1e-9)
                    heapq.heappush(waiting, (far[j], j))
        return self._subnetwork(sorted(far))

    def _subnetwork(self, parts: Sequence[int]) -> Network:
        """Return the network of some of the parts, in their places."""
        kept = set(parts)
        names = {self.fittings[i].name for i in parts}
        joints = [j for j in self.joints if {p.partition(".")[0] for p in j.ports} <= names]
        first, *others = connected(
            [self.fittings[i].name for i in parts],
            [(j.ports[0].partition(".")[0], j.ports[1].partition(".")[0]) for j in joints],
        )
        placed = {part.name: part for part in self.pipes.parts}
        order = dict.fromkeys([first[0], *(self.fittings[i].name for i in parts)])
        return Network(
            name=self.name,
            place=origin_of(placed[first[0]]),
            fittings=[self._by_name[name].model_dump() for name in order],
            joints=[joint.model_dump() for joint in joints],
            places=[{"fitting": g[0]} | origin_of(placed[g[0]]) for g in others],
            ports={n: p for n, p in self.ports.items() if self._ends[p][0] in kept},
        )

    @cached_property
    def _by_name(self) -> dict[str, NetworkFitting]:
        return {part.name: part for part in self.fittings}

    @property
    def open_ends(self) -> tuple[str, ...]:
        """Ports that nothing is joined to, such as ``"riser.start"``, also those of caps.

        A route may start and end there.
        """
        taken = {port for joint in self.joints for port in joint.ports}
        return tuple(port for port in self._ends if port not in taken)

    @cached_property
    def joined_to(self) -> dict[str, str]:
        """The port that each port is joined to; open ends are left out."""
        return both_ways(joint.ports for joint in self.joints)

    @property
    def length(self) -> float:
        """Length of all axes, m: a tee counts its run and its branch from the run's axis."""
        return sum(part.fitting().length_of_axes for part in self.fittings)

    def end(self, where: str, port: str) -> Port:
        """Return the port of an open end: ``part.port``, or its name in ``ports``.

        Raises:
            NetworkError: no such port, or none that is open; ``where`` names what asked for it.
        """
        name = self.ports.get(port, port)
        if name in self._ends and name not in self.joined_to:
            return self._ends[name]
        problem = (
            f"{port!r} is no open end: it is joined to {self.joined_to[name]}"
            if name in self._ends
            else f"there is no port {port!r}"
        )
        # The nearest name helps where there is no such port; a joined port is spelt right.
        word = "" if name in self._ends else port
        raise NetworkError(Fault(where, problem, (*self.ports, *self.open_ends), given=word))

    def port(self, port: str, where: str = "port") -> Port:
        """Return the port of a name: ``part.port``, or an open end's name in ``ports``.

        Raises:
            NetworkError: no such port; ``where`` names what asked for it.
        """
        name = self.ports.get(port, port)
        if name in self._ends:
            return self._ends[name]
        if "." not in port:
            return self.end(where, port)  # Raises: it was meant for the name of an end.
        raise NetworkError(self._unknown_port(where, port))

    def port_name(self, port: Port) -> str:
        """``part.port`` of a port given as part index and port name."""
        return f"{self.fittings[port[0]].name}.{port[1]}"

    def to_toml(self) -> str:
        """Return the file's text; read again it gives an equal network."""
        data = self.model_dump(mode="json", exclude_defaults=True)
        lines = [f"name = {as_toml(self.name)}"]
        for table in ("place", "ports"):
            if data.get(table):
                lines += [
                    "",
                    f"[{table}]",
                    *(f"{toml_key(k)} = {as_toml(v)}" for k, v in data[table].items()),
                ]
        for table in ("fittings", "joints", "places"):
            for row in data.get(table, ()):
                lines += ["", f"[[{table}]]", *(f"{k} = {as_toml(v)}" for k, v in row.items())]
        return "\n".join(lines) + "\n"

    @cached_property
    def _ends(self) -> dict[str, Port]:
        """Every port, in order, by its name in the file."""
        return {
            f"{part.name}.{port}": (i, port)
            for i, part in enumerate(self.fittings)
            for port in part.of.port_names
        }

    def _naming_faults(self) -> list[Fault]:
        """Faults of sizes, repeated names, and joints of missing or already joined ports."""
        faults: list[Fault] = []
        # All faults of a file are collected, so that they can be mended in one go.
        names: set[str] = set()
        for i, part in enumerate(self.fittings):
            if part.name in names:
                faults.append(
                    Fault(f"fittings.{i}.name", f"{part.name!r} is taken by an earlier fitting")
                )
            names.add(part.name)
            try:
                part.fitting()
            except GeometryError as error:
                faults += [f.at(f"fittings.{i}.{f.where.partition('.')[2]}") for f in error.faults]
        taken: dict[str, int] = {}
        for k, joint in enumerate(self.joints):
            for which, port in enumerate(joint.ports):
                where = f"joints.{k}.ports.{which}"
                if port not in self._ends:
                    faults.append(self._unknown_port(where, port))
                elif port in taken:
                    faults.append(Fault(where, f"{port!r} is used by joints.{taken[port]} already"))
                taken.setdefault(port, k)
            if joint.ports[0].partition(".")[0] == joint.ports[1].partition(".")[0]:
                faults.append(Fault(f"joints.{k}.ports", "joins a fitting to itself"))
        for k, place in enumerate(self.places):
            if place.fitting not in names:
                problem = f"there is no fitting {place.fitting!r}"
                faults.append(Fault(f"places.{k}.fitting", problem, tuple(names)))
        for name, port in self.ports.items():
            if port not in self._ends:
                faults.append(self._unknown_port(f"ports.{name}", port))
            if name in self._ends:
                faults.append(Fault(f"ports.{name}", "is the name of a port of a fitting"))
        return faults

    def _unknown_port(self, where: str, port: str) -> Fault:
        """Fault of a missing port, with the ports of its fitting, or else the fittings."""
        name = port.partition(".")[0]
        of_part = tuple(end for end in self._ends if end.startswith(f"{name}."))
        if of_part:
            return Fault(where, f"there is no port {port!r}", of_part, given=port)
        problem = f"there is no fitting {name!r} (given: {port!r})"
        names = dict.fromkeys(part.name for part in self.fittings)
        return Fault(where, problem, tuple(names), given=name)


def origin_of(part: Part) -> dict[str, Any]:
    """Return the keys of an ``Origin`` that puts a part's first port where it is."""
    port = part.port(part.fitting.port_names[0])
    entry = port.rotation * TURNED
    plain = frame_along(entry[:, 2], 0.0)
    turn = math.atan2(plain[:, 1] @ entry[:, 0], plain[:, 0] @ entry[:, 0])
    return {
        "position": tuple(port.position.tolist()),
        "axis": tuple(entry[:, 2].tolist()),
        "turn_deg": math.degrees(turn),
    }


def connected(names: Iterable[_Name], joints: Iterable[tuple[_Name, _Name]]) -> list[list[_Name]]:
    """Return the connected groups of some names, in order, each from its first on outward."""
    beside: dict[_Name, list[_Name]] = {name: [] for name in names}
    for one, other in joints:
        beside[one].append(other)
        beside[other].append(one)
    groups: list[list[_Name]] = []
    taken: set[_Name] = set()
    for name in beside:
        if name in taken:
            continue
        group = [name]
        taken.add(name)
        for member in group:  # which grows meanwhile
            new = [other for other in dict.fromkeys(beside[member]) if other not in taken]
            taken.update(new)
            group += new
        groups.append(group)
    return groups


def load_network(source: str | Path, *, trust: bool = False) -> Network:
    """Read a network file, or a shipped network by name.

    Args:
        source: the file or name.
        trust: import modules of fittings of somebody's own, ``module:Class``. Otherwise a file that
            names one is refused, unless the module has been imported already.

    Raises:
        NetworkError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.

    Example:
        >>> import omnitrack_sim as ot
        >>> ot.load_network("fig14").open_ends[0]
        'riser.start'
    """
    with trusting(None if trust else ()):
        return validate(network_data(source))


def network_data(source: str | Path) -> dict[str, Any]:
    """Read the plain data of a network file or a shipped network, unchecked.

    Raises:
        NetworkError: there is no such file, or it cannot be read.
    """
    path, data = read_file(source, NETWORK, NetworkError)
    return with_scans(data, path.parent)


def with_scans(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the plain data of a network with the scans read that its fittings name.

    ``folder``: that their paths are relative to.

    Raises:
        NetworkError: a scan cannot be read.
    """
    fittings, faults = with_profiles(data.get("fittings"), folder, "fittings")
    if faults:
        raise NetworkError(faults)
    return {**data, "fittings": fittings} if fittings else dict(data)


def validate(data: Mapping[str, Any]) -> Network:
    """Return a network from plain data, as read from TOML or JSON.

    Raises:
        NetworkError: lists every fault with its dotted path.
    """
    return checked(Network, data, NetworkError, own_fault=_fault)


def _fault(item: Mapping[str, Any]) -> Fault | None:
    """Fault of an invalid part name, in the terms of a network file."""
    if item["type"] == "string_pattern_mismatch" and item["loc"][0] == "fittings":
        where = f"fittings.{item['loc'][1]}.name"
        return Fault(
            where,
            f"is {item['input']!r}; a part's name has no dot, space or separator and is not empty",
        )
    return None
