"""Networks of the components of an isometric, and isometrics of networks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError, NetworkError
from omnitrack_sim.base.rotations import (
    TURNED,
    Array,
    Pose,
    angle_between,
    frame_along,
    frame_of,
    length,
    unit,
)
from omnitrack_sim.pipes.assembly import BORE_TOLERANCE, Part
from omnitrack_sim.pipes.fittings.base import Fitting
from omnitrack_sim.pipes.fittings.cross import Cross
from omnitrack_sim.pipes.fittings.elbow import Elbow
from omnitrack_sim.pipes.fittings.mitre import Mitre
from omnitrack_sim.pipes.fittings.reducer import Reducer
from omnitrack_sim.pipes.fittings.straight import Cap, Straight
from omnitrack_sim.pipes.fittings.tee import Tee
from omnitrack_sim.pipes.fittings.wye import MIN_BRANCH, Wye
from omnitrack_sim.pipes.importing.assumptions import Import, ImportNote
from omnitrack_sim.pipes.importing.building import Names
from omnitrack_sim.pipes.importing.pcf import (
    SLACK,
    Component,
    Point,
    bend_of,
    neighbours,
    pcf_text,
)
from omnitrack_sim.pipes.network import Network, connected, origin_of

SAME = 2e-3
"""Distance, m, within which two points are one: gaskets and rounded coordinates."""
PLATE_GAP = 2e-3
"""Between the plates of a closed valve, m."""
PIPES = ("PIPE", "CAP", "ELBOW", "BEND", "TEE", "CROSS", "OLET")


@dataclass
class _Plant:
    """Parts of a file while it is read.

    Attributes:
        parts: by name. lines: number of the line of each. notes: what was changed. names: of parts.
    """

    notes: list[ImportNote]
    parts: dict[str, Part] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    names: Names = field(default_factory=Names)

    def add(self, component: Component, fitting: Fitting, pose: Pose, more: str = "") -> None:
        """Add a part of a component."""
        word = component.words.get("NAME") or f"{component.kind.lower()}_{component.line}"
        name = self.names.new(word + more)
        self.parts[name], self.lines[name] = Part(name, fitting, pose), component.line

    def note(self, remedy: Any, component: Component, problem: str) -> None:
        """Add a note about a component."""
        self.notes.append(
            ImportNote(remedy, f"line {component.line}", f"{component.kind} {problem}")
        )


def build_plant(name: str, components: Sequence[Component], schedule: str) -> Import:
    """Build the network of an isometric, as ``read_pcf`` returns it.

    Raises:
        NetworkError: every component that is none, with its line.
    """
    what = "as in the file" if schedule == "none" else f"those of schedule {schedule}"
    plant = _Plant([ImportNote("assumed", "bores", f"are {what}")])
    ways: list[tuple[Component, Array, Array]] = [
        (component, point.place, way) for component, point, way in neighbours(components)
    ]
    components, faults = _without_olets(components, plant), []
    for component in components:
        try:
            _add(plant, component, ways)
        except NetworkError as error:
            faults += error.faults
        except GeometryError as error:
            problem = "; ".join(fault.problem for fault in error.faults)
            faults.append(component.fault(f"cannot be built: {problem}"))
    if not plant.parts and not faults:
        faults.append(Fault("file", "has no pipes"))
    if faults:
        raise NetworkError(faults)
    _close(plant, components)
    network = _network(name, plant)
    lengths = {name: part.fitting.length_of_axes for name, part in plant.parts.items()}
    return Import(network, tuple(plant.notes), {n: (own, own) for n, own in lengths.items()})


def _along(start: Array, end: Array) -> Pose:
    """Return the frame at ``start`` with z towards ``end``."""
    return Pose(frame_along(end - start, 0.0), start)


def _add(
    plant: _Plant, component: Component, ways: Sequence[tuple[Component, Array, Array]]
) -> None:
    """Add the parts of a component."""
    ends, kind = component.ends, component.kind
    if kind in ("CAP", "FLANGE-BLIND") and len(ends) == 1:
        return  # the pipe that ends there becomes a cap
    if not ends and not component.branches:
        if kind.startswith(PIPES):
            raise NetworkError(component.fault("has no END-POINT"))
        return
    if len(ends) != 2:
        raise NetworkError(component.fault(f"has {len(ends)} END-POINTs; it needs two"))
    (a, first), (b, second) = ends
    if component.branches:
        _add_branched(plant, component)
    elif component.centre is not None and not _in_line(a, b, component.centre):
        _add_bend(plant, component, ways)
    elif length(b - a) < 1e-5:
        return  # a weld
    elif abs(first - second) > BORE_TOLERANCE:
        if "ECCENTRIC" in kind:
            plant.note("mended", component, "is taken as concentric")
        cone = Reducer(float(length(b - a)), second, first)
        plant.add(component, cone, _along(a, b))
    else:
        _add_straight(plant, component, a, b, first)


def _in_line(a: Array, b: Array, centre: Array) -> bool:
    """Tell whether a point lies between two others."""
    one, other = a - centre, b - centre
    return float(length(one) + length(other)) <= float(length(b - a)) + 1e-6


def _add_straight(plant: _Plant, component: Component, a: Array, b: Array, bore: float) -> None:
    """Add a pipe, or what is one to a robot: a flange, valve or instrument."""
    long, kind = float(length(b - a)), component.kind
    if component.is_closed:
        plant.note("mended", component, "is closed: a plate stands in its middle")
        way, half = (b - a) / long, (long - PLATE_GAP) / 2
        if half < 1e-3:
            raise NetworkError(component.fault("is closed and too short for a plate"))
        plant.add(component, Cap(half, bore), _along(a, b), ":1")
        plant.add(component, Cap(half, bore), _along(b, b - way), ":2")
        return
    if kind == "CAP":
        plant.add(component, Cap(long, bore), _along(a, b))
        return
    if kind != "PIPE":
        plant.note("assumed", component, "is a straight pipe to the robot")
    plant.add(component, Straight(long, bore), _along(a, b))


def _add_bend(
    plant: _Plant, component: Component, ways: Sequence[tuple[Component, Array, Array]]
) -> None:
    """Add an elbow, or a mitre where the arc is too tight for one."""
    (a, bore), (b, other) = component.ends
    if abs(bore - other) > BORE_TOLERANCE:
        raise NetworkError(component.fault("has ends of two bores"))
    known = [
        next((w for c, p, w in ways if c is not component and length(p - end) < SAME), None)
        for end in (a, b)
    ]
    bend = bend_of(component, [None if w is None else unit(w) for w in known])
    sharp = component.words.get("SKEY", "").upper().startswith("MI") or bend.radius < bore / 2
    fitting: Fitting
    if sharp:
        fillet = _fillet(component, bore / 64)
        fitting = Mitre(bend.cut, bend.angle, fillet, bore)
    else:
        fitting = Elbow(bend.radius, bend.angle, bore)
    along, onward = unit(bend.corner - a), unit(b - bend.corner)
    inward = unit(onward - along * (along @ onward))
    plant.add(component, fitting, Pose(frame_of(inward, along), a))


def _fillet(component: Component, default: float) -> float:
    """Return the radius of a rim, m, an attribute of our own, in millimetres in the file."""
    try:
        return float(component.words["FILLET-RADIUS"]) / 1e3
    except (KeyError, ValueError):
        return default


def _add_branched(plant: _Plant, component: Component) -> None:
    """Add a tee, wye or cross, and straights where its run is longer on one side."""
    (a, first), (b, second) = component.ends
    centre, branches = component.centre, component.branches
    if centre is None:
        raise NetworkError(component.fault("has no CENTRE-POINT"))
    halves = float(length(a - centre)), float(length(b - centre))
    if min(halves) < 1e-4 or not _in_line(a, b, centre):
        raise NetworkError(component.fault("has a CENTRE-POINT that is not between its END-POINTs"))
    if abs(first - second) > BORE_TOLERANCE:
        raise NetworkError(component.fault("has a run of two bores"))
    half, run = min(halves), unit(b - a)
    far = float(length(branches[0].place - centre))
    if far < 1e-4:
        raise NetworkError(component.fault("has a BRANCH1-POINT at its CENTRE-POINT"))
    way = (branches[0].place - centre) / far
    if len(branches) == 2:
        back = centre - branches[1].place
        if angle_between(unit(back), way) > SLACK or abs(length(back) - far) > SAME:
            raise NetworkError(component.fault("has branches that are not opposite"))
        if abs(branches[0].bore - branches[1].bore) > BORE_TOLERANCE:
            raise NetworkError(component.fault("has branches of two bores"))
    angle = float(angle_between(run, way))
    if abs(angle - math.pi / 2) < SLACK:
        angle = math.pi / 2
    if angle > math.pi / 2:
        run, angle = -run, math.pi - angle
    fitting = _branched(component, angle, 2 * half, far, first, branches)
    y = unit(np.cross(run, way))
    rotation = np.stack([np.cross(y, run), y, run], axis=-1)
    plant.add(component, fitting, Pose(rotation, centre))
    for end, long in ((a, halves[0]), (b, halves[1])):
        if long - half > 1e-5:
            place = centre + (end - centre) * (half / long)
            plant.add(component, Straight(long - half, first), _along(place, end), ":more")


def _branched(
    component: Component, angle: float, run: float, far: float, bore: float, branches: Sequence[Any]
) -> Fitting:
    """Return the fitting of a component with branches."""
    branch = min(branches[0].bore, bore)
    fillet = _fillet(component, min(bore / 32, branch / 8))
    equal = abs(branch - bore) < 1e-9
    if len(branches) == 2:
        return Cross(run, far, angle, fillet, bore, branch)
    if equal and angle == math.pi / 2 and component.words.get("SKEY", "") != "WYE":
        return Tee(run, far, fillet, bore)
    return Wye(run, far, angle, fillet, bore, branch)


def _without_olets(components: Sequence[Component], plant: _Plant) -> list[Component]:
    """Return components with each olet as a tee in the pipe that it sits on."""
    kept = [c for c in components if not c.kind.endswith("OLET")]
    for olet in (c for c in components if c.kind.endswith("OLET")):
        place, branches = olet.centre, olet.branches
        if place is None or not branches:
            raise NetworkError(olet.fault("needs a CENTRE-POINT and a BRANCH1-POINT"))
        host = next((c for c in kept if _carries(c, place)), None)
        if host is None:
            raise NetworkError(olet.fault("sits on no pipe"))
        (a, bore), (b, other) = host.ends
        if branches[0].bore < MIN_BRANCH * bore:
            share = branches[0].bore / bore
            plant.note(
                "left out", olet, f"has a branch of {share:.2f} of its run; {MIN_BRANCH} at least"
            )
            continue
        way = unit(b - a)
        half = 0.75 * (bore + branches[0].bore / 2)
        half = min(half, float(length(place - a)), float(length(b - place)))
        tee = Component("TEE", olet.line, words=dict(olet.words))
        ends = [(place - half * way, bore), (place + half * way, other)]
        tee.points = {
            "END-POINT": [Point(*end) for end in ends],
            "CENTRE-POINT": [Point(place, 0.0)],
            "BRANCH1-POINT": [branches[0]],
        }
        pieces = []
        for start, end in ((host.ends[0], tee.ends[0]), (tee.ends[1], host.ends[1])):
            piece = Component(host.kind, host.line, words=dict(host.words))
            piece.points = {"END-POINT": [start, end]}
            pieces.append(piece)
        at = kept.index(host)
        kept[at : at + 1] = [pieces[0], tee, pieces[1]]
    return kept


def _carries(component: Component, place: Array) -> bool:
    """Tell whether a component is a pipe that a point lies on."""
    if component.kind != "PIPE" or len(component.ends) != 2:
        return False
    a, b = component.ends[0].place, component.ends[1].place
    return float(length(place - a) + length(b - place)) < float(length(b - a)) + 1e-4


def _close(plant: _Plant, components: Sequence[Component]) -> None:
    """Make caps of the pipes that end at a cap or blind flange of one point."""
    for component in components:
        if component.kind not in ("CAP", "FLANGE-BLIND") or len(component.ends) != 1:
            continue
        place = component.ends[0].place
        for name, part in plant.parts.items():
            fitting, start = part.fitting, part.pose.position
            if type(fitting) is not Straight:
                continue
            end = start + fitting.length * part.pose.rotation[:, 2]
            cap = Cap(fitting.length, fitting.inner_diameter)
            if length(end - place) < SAME:
                plant.parts[name] = replace(part, fitting=cap)
                break
            if length(start - place) < SAME:
                plant.parts[name] = Part(name, cap, _along(end, start))
                break
        else:
            plant.note("left out", component, "closes no straight pipe")


def _network(name: str, plant: _Plant) -> Network:
    """Return the network of parts; ports in one place are joined."""
    parts, lines = plant.parts, plant.lines
    ports = [
        (n, port, part.port(port))
        for n, part in parts.items()
        for port in part.fitting.port_names
        if port not in part.fitting.closed_ports
    ]
    joints, taken, faults = [], set(), []
    places = np.array([pose.position for _, _, pose in ports])
    for i, (one, port, pose) in enumerate(ports):
        near = np.flatnonzero(length(places - pose.position) < SAME)
        if len(near) > 2:
            faults.append(Fault(f"line {lines[one]}", f"{len(near)} ends meet at {port} of {one}"))
        if i in taken or len(near) != 2 or i != near[0]:
            continue
        j = int(near[1])
        other, there, back = ports[j]
        taken |= {i, j}
        joint: dict[str, Any] = {"ports": (f"{one}.{port}", f"{other}.{there}")}
        x = (back.rotation * TURNED)[:, 0]
        turn = math.degrees(math.atan2(pose.rotation[:, 1] @ x, pose.rotation[:, 0] @ x))
        if abs(turn) > 1e-9:
            joint["turn_deg"] = turn
        joints.append(joint)
    if faults:
        raise NetworkError(faults)
    pairs = [tuple(p.partition(".")[0] for p in joint["ports"]) for joint in joints]
    groups = connected(parts, pairs)
    groups.sort(key=lambda g: -sum(parts[n].fitting.length_of_axes for n in g))
    root = groups[0][0]
    try:
        return Network(
            name=name,
            place=origin_of(parts[root]),
            fittings=[
                {"name": n} | parts[n].fitting.to_table() for n in dict.fromkeys([root, *parts])
            ],
            joints=joints,
            places=[{"fitting": g[0]} | origin_of(parts[g[0]]) for g in groups[1:]],
        )
    except NetworkError as error:
        order = list(dict.fromkeys([root, *parts]))
        raise NetworkError([_by_line(f, order, lines, joints) for f in error.faults]) from None


def _by_line(
    fault: Fault, order: Sequence[str], lines: dict[str, int], joints: Sequence[dict[str, Any]]
) -> Fault:
    """Return a fault of the network at the line of its component."""
    table, _, rest = fault.where.partition(".")
    number = rest.partition(".")[0]
    if number.isdigit() and table in ("fittings", "joints"):
        part = (
            order[int(number)]
            if table == "fittings"
            else joints[int(number)]["ports"][1].partition(".")[0]
        )
        return fault.at(f"line {lines[part]}")
    return fault


def network_pcf(network: Network) -> str:
    """Return a network as a piping component file, in millimetres, bores true.

    Raises:
        NetworkError: a fitting that no component is for.
    """
    return pcf_text(network.name, [_written(part) for part in network.pipes.parts])


def _written(part: Part) -> Component:
    """Return the component of a part."""
    fitting, words = part.fitting, {"NAME": part.name}
    ports = [Point(part.port(p).position, 2 * fitting.port_radius(p)) for p in fitting.port_names]
    ends = {"END-POINT": ports[:2]}
    if isinstance(fitting, Cap | Straight):
        return Component("CAP" if isinstance(fitting, Cap) else "PIPE", 0, ends, words)
    if isinstance(fitting, Reducer):
        return Component("REDUCER-CONCENTRIC", 0, ends, {"SKEY": "RCBW"} | words)
    if isinstance(fitting, Elbow | Mitre):
        way = part.pose.rotation[:, 2]
        cut = (
            fitting.leg_length
            if isinstance(fitting, Mitre)
            else fitting.mean_radius * math.tan(fitting.angle / 2)
        )
        if fitting.angle > math.radians(170):
            raise NetworkError(Fault(part.name, "bends back, which no CENTRE-POINT can say"))
        centre = {"CENTRE-POINT": [Point(part.pose.position + cut * way, 0.0)]}
        more = {"SKEY": "ELBW", "ANGLE": f"{100 * math.degrees(fitting.angle):.9f}"}
        if isinstance(fitting, Mitre):
            more |= {"SKEY": "MIBW", "FILLET-RADIUS": f"{1e3 * fitting.fillet_radius:.9f}"}
        return Component("ELBOW", 0, ends | centre, more | words)
    if isinstance(fitting, Tee | Wye):
        centre = {"CENTRE-POINT": [Point(part.pose.position, 0.0)]}
        branches = {f"BRANCH{k}-POINT": [port] for k, port in enumerate(ports[2:], start=1)}
        kind = "CROSS" if isinstance(fitting, Cross) else "TEE"
        key = {Tee: "TEBW", Wye: "WYE", Cross: "CRBW"}[type(fitting)]
        more = {"SKEY": key, "FILLET-RADIUS": f"{1e3 * fitting.fillet_radius:.9f}"}
        return Component(kind, 0, ends | centre | branches, more | words)
    raise NetworkError(Fault(part.name, f"is a {fitting.kind}, which no component is for"))
