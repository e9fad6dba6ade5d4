"""A network of a drawing: fittings at its nodes, chains of parts along its pipes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any

from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.rotations import Pose, length
from omnitrack_sim.pipes.assembly import Assembly, Part
from omnitrack_sim.pipes.fittings.base import Fitting
from omnitrack_sim.pipes.fittings.straight import Cap, Straight
from omnitrack_sim.pipes.importing.assumptions import (
    Import,
    ImportNote,
    ImportSettings,
    listed_once,
)
from omnitrack_sim.pipes.importing.chains import Chain, Outlet, TooShortError, chain
from omnitrack_sim.pipes.importing.drawing import Drawing, lowered, under, without_straight
from omnitrack_sim.pipes.importing.junctions import CannotBuildError, Junction, junction
from omnitrack_sim.pipes.network import Network, connected, origin_of

ROUNDS = 12
"""How often nodes are moved to make room, all of those that need it at a time."""
NOTABLE = 0.05
"""Share of a pipe's length by which it may be built longer or shorter without a note."""
MAX_OVERLAPS = 200
"""Pairs of parts that share space which are mended at a time."""
CLEARANCE = 0.3
"""Between pipes that cross, m, as mains are laid."""
PLATE = 0.25
"""Length of the cap at a port that nothing leads on from, bores."""
PipeEnd = tuple[str, int]


@dataclass
class _Town:
    """Fittings and chains of a drawing while it is being built.

    Attributes:
        drawing, settings: of the import. at_nodes: legs at each node, see ``Drawing``.
        tight: nodes whose fittings are as short as can be. moved: by how much nodes were, m.
        junctions: fittings of nodes with several pipes. chains: parts of the legs.
        left: legs that are left out, and why. short: legs that did not fit, and why.
    """

    drawing: Drawing
    settings: ImportSettings
    at_nodes: dict[str, list[PipeEnd]]
    tight: set[str] = field(default_factory=set)
    moved: dict[str, float] = field(default_factory=dict)
    junctions: dict[str, Junction] = field(default_factory=dict)
    chains: dict[str, Chain] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    short: dict[str, str] = field(default_factory=dict)

    def make_junction(self, node: str) -> None:
        """Make the fitting of a node anew; legs of a node without one are left out."""
        here = self.at_nodes[node]
        self.junctions.pop(node, None)
        if len(here) < 2:
            return
        legs = [self.drawing.legs[name] for name, _ in here]
        ways = [leg.towards(end) for leg, (_, end) in zip(legs, here, strict=True)]
        try:
            made = junction(ways, [leg.bore for leg in legs], self.settings, node in self.tight)
        except CannotBuildError as error:
            for leg in legs:
                self.left[leg.name] = f"node {node}: {error}"
                self.chains.pop(leg.name, None)
            return
        pose = Pose(made.pose.rotation, made.pose.position + self.drawing.nodes[node])
        self.junctions[node] = replace(made, pose=pose)

    def outlet(self, name: str, end: int) -> Outlet | None:
        """Return the port that a leg has at an end; None at a node of its own."""
        node = self.drawing.legs[name].ends[end]
        made = self.junctions.get(node)
        if made is None:
            return None
        place = self.at_nodes[node].index((name, end))
        bore = 2 * made.fitting.port_radius(made.ports[place])
        return Outlet(made.port(place), bore)

    def make_chain(self, name: str) -> float:
        """Make the parts of a leg anew; returns by how much it is too short, m, or 0."""
        leg = self.drawing.legs[name]
        ends = self.outlet(name, 0), self.outlet(name, 1)
        try:
            self.chains[name] = chain(leg.points, *ends, leg.bore, self.settings)
        except TooShortError as error:
            self.chains.pop(name, None)
            self.short[name] = str(error)
            return error.short
        return 0.0


def build(name: str, drawing: Drawing, settings: ImportSettings) -> Import:
    """Build a network of a drawing.

    Args:
        name: of the network.
        drawing: which is changed.
        settings: of the import.

    Raises:
        NetworkError: nothing of it can be built.
    """
    drawing.split_crowds()
    drawing.simplify(settings.simplify)
    town = _Town(drawing, settings, drawing.at_nodes())
    for node in drawing.nodes:
        town.make_junction(node)
    _make_room(town)
    notes = [*drawing.notes, *_notes(town)]
    parts = _Parts(town)
    notes += parts.keep_apart()
    lengths = _compared(town)
    for pipe, (there, made) in lengths.items():
        if made and abs(made / there - 1) > NOTABLE:
            notes.append(
                ImportNote("mended", f"pipe {pipe}", f"is {made:.2f} m long, not {there:.2f} m")
            )
    return Import(parts.network(name), listed_once(notes), lengths)


def _compared(town: _Town) -> dict[str, tuple[float, float]]:
    """Return the length of each pipe in the file and as built, m."""
    drawing = town.drawing
    built = dict.fromkeys(drawing.lengths, 0.0)
    for leg, made in town.chains.items():
        built[drawing.legs[leg].pipe] += made.length
    for node, made in town.junctions.items():
        # What a fitting takes of a pipe is the pipe's.
        for place, (leg, _) in enumerate(town.at_nodes[node]):
            if leg in town.chains:
                port = made.fitting.ports[made.ports[place]].position
                corner = made.pose.inverse().apply(drawing.nodes[node])
                built[drawing.legs[leg].pipe] += float(length(port - corner))
    return {pipe: (there, built[pipe]) for pipe, there in drawing.lengths.items()}


def _make_room(town: _Town) -> None:
    """Make the parts of all legs; where they do not fit shorten fittings, then move nodes."""
    drawing = town.drawing
    todo = set(drawing.legs) - set(town.left)
    for attempt in range(ROUNDS):
        short = {name: by for name in sorted(todo) if (by := town.make_chain(name)) > 0}
        nodes: set[str] = set()
        for name, by in short.items():
            ends = drawing.legs[name].ends
            if attempt == 0:
                town.tight |= set(ends)
                nodes |= set(ends)
            else:
                nodes |= _moved(town, name, by)
        if not nodes:
            break
        # What moved turns the fittings at the other ends of its pipes too.
        around = nodes | {
            drawing.legs[leg].ends[1 - end] for node in nodes for leg, end in town.at_nodes[node]
        }
        for node in sorted(around):  # the order of a set differs from process to process
            town.make_junction(node)
        todo = {leg for node in around for leg, _ in town.at_nodes[node]} - set(town.left)
    for name in drawing.legs:
        if name not in town.left and name not in town.chains:
            town.left[name] = f"pipe {drawing.legs[name].pipe}: {town.short[name]}"


def _moved(town: _Town, name: str, by: float) -> set[str]:
    """Move the end of a leg that has fewer pipes away from the other; returns its node."""
    leg = town.drawing.legs[name]
    end = 0 if len(town.at_nodes[leg.ends[0]]) < len(town.at_nodes[leg.ends[1]]) else 1
    node, by = leg.ends[end], by * 1.02 + 1e-3
    done = town.moved.get(node, 0.0)
    if done + by > town.settings.move:
        end = 1 - end
        node = leg.ends[end]
        done = town.moved.get(node, 0.0)
        if done + by > town.settings.move:
            return set()
    town.moved[node] = done + by
    town.drawing.move(node, -leg.towards(end) * by)
    return {node}


def _notes(town: _Town) -> list[ImportNote]:
    """Return what was changed, and what is left out."""
    notes = [
        ImportNote("mended", f"node {node}", made.problem)
        for node, made in town.junctions.items()
        if made.problem
    ]
    notes += [
        ImportNote("mended", f"node {node}", f"is moved by {by:.2f} m to make room for fittings")
        for node, by in town.moved.items()
    ]
    for name, reason in town.left.items():
        where, _, problem = reason.partition(": ")
        pipe = town.drawing.legs[name].pipe
        notes.append(ImportNote("left out", f"pipe {pipe}", problem if pipe in where else reason))
    return notes


class _Parts:
    """Parts by name, and the ports that are joined."""

    def __init__(self, town: _Town) -> None:
        self.town = town
        self._collect()

    def _collect(self) -> None:
        """Collect the parts of the town as it is."""
        town = self.town
        self.fittings: dict[str, Fitting] = {}
        self.joints: list[tuple[str, str, float]] = []
        self.poses: dict[str, Pose] = {}
        self.ports: dict[str, str] = {}
        self.of: dict[str, str] = {}
        self._names = Names()
        self._nodes = {node: self._names.new(node) for node in town.junctions}
        for node, made in town.junctions.items():
            self.fittings[self._nodes[node]] = made.fitting
            self.poses[self._nodes[node]] = made.pose
            self.of[self._nodes[node]] = node
        for name in town.drawing.legs:
            if name in town.chains:
                self._add_chain(name)
        for node, made in town.junctions.items():
            for place, (leg, _) in enumerate(town.at_nodes[node]):
                if leg not in town.chains:
                    self._add_plate(node, made, place)

    def _add_plate(self, node: str, made: Junction, place: int) -> None:
        """Put a cap on a port that nothing leads on from."""
        bore = 2 * made.fitting.port_radius(made.ports[place])
        name = self._names.new(f"{self._nodes[node]}:plate")
        self.fittings[name] = Cap(PLATE * bore, bore)
        self.of[name] = node
        self.joints.append((f"{self._nodes[node]}.{made.ports[place]}", f"{name}.start", 0.0))

    def _add_chain(self, name: str) -> None:
        """Add the parts of a leg; a pipe that ends at a node of its own gets a cap there."""
        leg, made = self.town.drawing.legs[name], self.town.chains[name]
        links = list(made.links)
        free = [leg.ends[end] not in self.town.junctions for end in (0, 1)]
        if free[1] and leg.ends[1] not in self.town.drawing.open_ends:
            last = links[-1].fitting
            assert isinstance(last, Straight)
            links[-1] = links[-1]._replace(fitting=Cap(last.length, last.inner_diameter))
        before = None if free[0] else self._port(name, 0)
        for number, link in enumerate(links):
            part = self._names.new(f"{leg.name}:{number + 1}" if len(links) > 1 else leg.name)
            self.fittings[part], self.of[part] = link.fitting, leg.name
            if before is None:
                self.ports[plain_name(leg.ends[0])] = f"{part}.start"
            else:
                self.joints.append((before, f"{part}.start", link.turn))
            before = f"{part}.end"
        assert before is not None  # a chain between free ends has a part
        if free[1]:
            self.ports[plain_name(leg.ends[1])] = before
        else:
            self.joints.append((before, self._port(name, 1), made.turn))

    def _port(self, leg: str, end: int) -> str:
        """Return the name of the port of a node's fitting that a leg has."""
        node = self.town.drawing.legs[leg].ends[end]
        place = self.town.at_nodes[node].index((leg, end))
        return f"{self._nodes[node]}.{self.town.junctions[node].ports[place]}"

    def keep_apart(self) -> list[ImportNote]:
        """Mend pipes that run into others or themselves, or leave them out; returns the notes."""
        notes: dict[str, ImportNote] = {}
        for attempt in range(ROUNDS):
            pairs = self._assembly().overlaps(MAX_OVERLAPS)
            if not pairs:
                break
            names = list(self._data()["fittings"])
            owners = [(self.of[names[i]["name"]], self.of[names[j]["name"]]) for i, j in pairs]
            changed: set[str] = set()
            for one, other in dict.fromkeys(owners):
                legs = [n for n in (one, other) if n in self.town.chains]
                if changed.intersection((one, other)):
                    continue
                if legs:
                    name = min(legs, key=lambda n: (self.town.drawing.legs[n].bore, n))
                    notes[name] = self._mend(name, other if name == one else one, attempt)
                else:
                    name = min((one, other), key=lambda n: len(self.town.at_nodes[n]))
                    notes |= self._without(name, other if name == one else one)
                changed.add(name)
            if not changed:
                break
            self._collect()  # plates stand where pipes were left out
        return list(notes.values())

    def _mend(self, name: str, other: str, attempt: int) -> ImportNote:
        """Change a leg that runs into another, a node's fitting or itself; or leave it out."""
        drawing, pipe = self.town.drawing, f"pipe {self.town.drawing.legs[name].pipe}"
        leg = drawing.legs[name]
        note = None
        if attempt < ROUNDS // 2 and (other == name or other in leg.ends):
            tolerance = 2.0**attempt
            points = without_straight(leg.points, tolerance)
            drawing.legs[name] = replace(leg, points=points)
            note = ImportNote("mended", pipe, f"folds back on itself: {tolerance:g} m straighter")
        elif attempt < ROUNDS // 2 and self._share_a_node(name, other):
            by = (attempt + 1) * self._depth(name, other)
            drawing.legs[name] = replace(leg, points=lowered(leg.points, by))
            problem = f"lies in pipe {drawing.legs[other].pipe}: is laid below it"
            note = ImportNote("mended", pipe, problem)
        elif attempt < ROUNDS // 2:
            line = drawing.legs[other].points if other in drawing.legs else None
            by = self._depth(name, other)
            if (points := under(leg.points, line, drawing.nodes.get(other), by)) is not None:
                drawing.legs[name] = replace(leg, points=points)
                note = ImportNote(
                    "mended", pipe, f"crosses {other} without a node: passes under it"
                )
        if note is None or self.town.make_chain(name) > 0:
            self.town.chains.pop(name, None)
            self.town.left[name] = f"{pipe}: runs into {other}"
            return ImportNote("left out", pipe, f"runs into {other}")
        return note

    def _without(self, node: str, other: str) -> dict[str, ImportNote]:
        """Leave out a node, whose fitting runs into another's, with its pipes; returns notes."""
        self.town.junctions.pop(node, None)
        notes = {}
        for name, _ in self.town.at_nodes[node]:
            self.town.chains.pop(name, None)
            self.town.left[name] = f"node {node}: runs into {other}"
            pipe = f"pipe {self.town.drawing.legs[name].pipe}"
            notes[name] = ImportNote("left out", pipe, f"node {node} runs into {other}")
        return notes

    def _share_a_node(self, name: str, other: str) -> bool:
        """Tell whether two legs end at one node."""
        legs = self.town.drawing.legs
        return other in legs and bool(set(legs[name].ends) & set(legs[other].ends))

    def _depth(self, name: str, other: str) -> float:
        """Return by how much a leg has to pass below another, or below a node, m."""
        drawing = self.town.drawing
        bores = [drawing.legs[n].bore for n in (name, other) if n in drawing.legs]
        if len(bores) == 1:
            bores.append(self.town.junctions[other].fitting.inner_diameter)
        return max(bores) + CLEARANCE

    def _data(self) -> dict[str, Any]:
        """Return network's name of fittings and joints as plain data."""
        if not self.fittings:
            raise NetworkError(Fault("pipes", "nothing of the file can be built"))
        first, *others = self._places()
        root = first.pop("fitting")
        fittings = {root: self.fittings[root]} | self.fittings
        legs = self.town.drawing.legs
        return {
            "fittings": [
                {
                    "name": n,
                    **f.to_table(),
                    "pipe": legs[self.of[n]].pipe if self.of[n] in legs else "",
                }
                for n, f in fittings.items()
            ],
            "joints": [_joint(*joint) for joint in self.joints],
            "ports": self.ports,
            "place": first,
            "places": others,
        }

    def _places(self) -> list[dict[str, Any]]:
        """Return where the first port of each connected group is, the longest group first."""
        joints = [(a.partition(".")[0], b.partition(".")[0]) for a, b, _ in self.joints]
        groups = connected(self.fittings, joints)
        groups.sort(key=lambda group: -sum(self.fittings[n].length_of_axes for n in group))
        roots = [next((n for n in group if n in self.poses), group[0]) for group in groups]
        return [{"fitting": name} | self._place(name) for name in roots]

    def _place(self, name: str) -> dict[str, Any]:
        """Return where the first port of a part is: a node's fitting, or the first of a pipe."""
        if name in self.poses:
            return origin_of(Part(name, self.fittings[name], self.poses[name]))
        leg = self.town.drawing.legs[self.of[name]]
        way = leg.towards(0)
        return {"position": tuple(leg.points[0].tolist()), "axis": tuple(way.tolist())}

    def _assembly(self) -> Assembly:
        """Return the parts, placed, that need not fit together."""
        return self.network("town", checked=False).pipes

    def network(self, name: str, *, checked: bool = True) -> Network:
        """Return the network."""
        data = self._data() | {"name": name}
        return Network(**data) if checked else Network.believed_from(data)


def plain_name(name: str) -> str:
    """Return a name without what names in a network may not have."""
    return re.sub(r"[\s./\\\x00-\x1f]", "_", name)


class Names:
    """Names of parts, each once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def new(self, name: str) -> str:
        """Return a plain name, with a number where it is taken."""
        name = plain_name(name)
        taken, number = name, 1
        while taken in self._taken:
            number += 1
            taken = f"{name}~{number}"
        self._taken.add(taken)
        return taken


def _joint(one: str, other: str, turn: float) -> dict[str, Any]:
    joint: dict[str, Any] = {"ports": (one, other)}
    if abs(turn) > 1e-12:
        joint["turn_deg"] = math.degrees(turn)
    return joint
