"""Fittings at the nodes of a drawing: bends, tees, wyes and crosses, turned to where pipes lead.

A fitting has fewer directions than a node: what is left over is a bend behind one of its ports.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, angle_between, frame_of, unit
from omnitrack_sim.pipes.fittings.base import Fitting
from omnitrack_sim.pipes.fittings.cross import Cross
from omnitrack_sim.pipes.fittings.elbow import Elbow
from omnitrack_sim.pipes.fittings.mitre import MAX_ANGLE, Mitre
from omnitrack_sim.pipes.fittings.straight import Straight
from omnitrack_sim.pipes.fittings.tee import Tee
from omnitrack_sim.pipes.fittings.wye import ANGLES, MIN_BRANCH, Wye
from omnitrack_sim.pipes.importing.assumptions import ImportSettings

STRAIGHT_ON = 1e-8
"""Angle, rad, below which two directions are one: over 10 km that makes 0.1 mm."""
MIN_LEAN = math.radians(1)
"""Of two pipes out of a node: with less between them they lie in each other."""
COST_OF_BEND, COST_OF_REDUCER, WIDE_BEND = 0.2, 0.3, math.radians(30)
"""Of the choice among turned fittings: a bend counts 0.2 and the square of its angle over 30
degrees; so two bends of 30 degrees are taken rather than one of 60."""


class CannotBuildError(Exception):
    """No fitting joins these pipes; the text says why."""


@dataclass(frozen=True)
class Junction:
    """A fitting at a node.

    Attributes:
        fitting: it. pose: with the node at the origin.
        ports: for each pipe of the node the port that leads to it.
        problem: what is not as drawn; empty.
    """

    fitting: Fitting
    pose: Pose
    ports: tuple[str, ...]
    problem: str = ""

    def port(self, pipe: int) -> Pose:
        """Return the port that leads to a pipe."""
        return self.pose @ self.fitting.ports[self.ports[pipe]]


def junction(
    ways: Sequence[Array], bores: Sequence[float], settings: ImportSettings, tight: bool
) -> Junction:
    """Return the fitting of a node.

    Args:
        ways: unit vectors (3,) out of the node along its two to four pipes.
        bores: of these, m.
        settings: of the import.
        tight: as short as the fitting can be.

    Raises:
        CannotBuildError: there is no such fitting.
    """
    if len(ways) == 2:
        return _bend(ways, max(bores), settings, tight)
    best = min(_crossings(ways, bores, settings), key=lambda c: c.cost, default=None)
    if best is None:
        raise CannotBuildError("pipes lie in each other")
    fitting = _sized(best, tight)
    y = unit(np.cross(best.run, best.branch))
    rotation = np.stack([np.cross(y, best.run), y, best.run], axis=-1)
    return Junction(fitting, Pose(rotation, np.zeros(3)), best.ports, best.problem)


def _bend(ways: Sequence[Array], bore: float, settings: ImportSettings, tight: bool) -> Junction:
    """Return a bend between two pipes, or a piece of pipe."""
    along, onward = -ways[0], ways[1]
    angle = float(angle_between(along, onward))
    inward = unit(onward - along * (along @ onward))
    if angle < STRAIGHT_ON:
        length = 0.05 * bore if tight else 0.5 * bore
        inward = unit(np.cross(along, np.eye(3)[np.abs(along).argmin()]))
        fitting: Fitting = Straight(length, bore)
        before = length / 2
    else:
        options = bends(angle, bore, settings)
        if not options:
            raise CannotBuildError(f"its pipes turn back by {math.degrees(angle):.0f} degrees")
        fitting, before = options[-1 if tight else 0]
    return Junction(fitting, Pose(frame_of(inward, along), -before * along), ("start", "end"))


def bends(angle: float, bore: float, settings: ImportSettings) -> list[tuple[Fitting, float]]:
    """Return the bends of an angle, rad, with the length, m, that each takes of either pipe.

    The one that is wanted comes first, the shortest last; none for a way back.
    """
    fillet = bore / 64
    options: list[tuple[Fitting, float]] = []
    if angle > math.radians(settings.deflection_deg):
        radii = dict.fromkeys((settings.bend_radius, min(1.0, settings.bend_radius), 0.6))
        for radius in sorted((radius * bore for radius in radii), reverse=True):
            if angle <= math.radians(170):
                cut = radius * math.tan(angle / 2)
                options.append((Elbow(radius, angle, bore), cut))
    if angle <= MAX_ANGLE:
        least = Mitre.min_leg(angle, bore, fillet)
        legs = (least,) if options else (max(least, 0.25 * bore), least)
        options += [(Mitre(leg, angle, fillet, bore), leg) for leg in legs]
    return sorted(options, key=lambda option: -option[1])


@dataclass(frozen=True)
class _Crossing:
    """A way to lay a run and branches through a node.

    Attributes:
        run, branch: unit vectors (3,), towards ``run_end`` and out of the port ``branch``.
        angle: between them, rad. ports: of the pipes. bore, branch_bore: m.
        cost: of bends and reducers behind its ports. problem: what is not as drawn.
    """

    run: Array
    branch: Array
    angle: float
    ports: tuple[str, ...]
    bore: float
    branch_bore: float
    cost: float
    problem: str


def _crossings(
    ways: Sequence[Array], bores: Sequence[float], settings: ImportSettings
) -> Iterator[_Crossing]:
    """Yield the ways to lay a tee, wye or cross."""
    everyone = range(len(ways))
    for i, j in combinations(everyone, 2):
        rest = [k for k in everyone if k not in (i, j)]
        branches = _lines(ways, rest[0], rest[1]) if len(rest) == 2 else [ways[rest[0]]]
        for run, branch in product(_lines(ways, i, j), branches):
            yield from _crossing(ways, bores, settings, (i, j, *rest), run, branch)


def _lines(ways: Sequence[Array], i: int, j: int) -> list[Array]:
    """Return the lines, towards pipe ``i``, that a straight pipe between two may have."""
    return [ways[i], -ways[j], unit(ways[i] - ways[j])]


def _crossing(
    ways: Sequence[Array],
    bores: Sequence[float],
    settings: ImportSettings,
    order: tuple[int, ...],
    run: Array,
    branch: Array,
) -> Iterator[_Crossing]:
    """Yield a run and a branch along two lines, brought to an angle that fittings have.

    Nothing is yielded where they are in one line.
    """
    i, j, *rest = order
    drawn = float(angle_between(run, branch))
    if min(drawn, math.pi - drawn) < MIN_LEAN:
        return
    low = ANGLES[0]
    angle = min(max(drawn, low), math.pi - low)
    if abs(angle - math.pi / 2) <= math.radians(settings.deflection_deg):
        angle = math.pi / 2
    across = unit(branch - run * (run @ branch))
    branch = run * math.cos(angle) + across * math.sin(angle)
    ports = {i: "run_end", j: "run_start"} | dict(zip(rest, ("branch", "opposite"), strict=False))
    towards = {i: run, j: -run} | dict(zip(rest, (branch, -branch), strict=False))
    bore = max(bores)
    branch_bore = min(max(*(bores[k] for k in rest), MIN_BRANCH * bore), bore)
    wide = {k: bore if k in (i, j) else branch_bore for k in order}
    cost = 0.0
    for k in order:
        bend = float(angle_between(ways[k], towards[k]))
        if bend > STRAIGHT_ON:
            cost += COST_OF_BEND + (bend / WIDE_BEND) ** 2
        cost += COST_OF_REDUCER * (abs(bores[k] - wide[k]) > 1e-6)
        if bend > math.radians(100):
            return
    if angle > math.pi / 2:
        run, angle = -run, math.pi - angle
        swapped = {"run_end": "run_start", "run_start": "run_end"}
        ports = {k: swapped.get(port, port) for k, port in ports.items()}
    problem = ""
    if min(drawn, math.pi - drawn) < low - 1e-9:
        degrees = math.degrees(min(drawn, math.pi - drawn))
        problem = (
            f"a pipe leaves at {degrees:.0f} degrees: a branch of "
            f"{math.degrees(angle):.0f} degrees and a bend behind it"
        )
    names = tuple(ports[k] for k in range(len(ways)))
    yield _Crossing(run, branch, angle, names, bore, branch_bore, cost, problem)


def _sized(crossing: _Crossing, tight: bool) -> Fitting:
    """Return the fitting of a crossing, as short as can be or of common length."""
    angle, bore, branch = crossing.angle, crossing.bore, crossing.branch_bore
    if len(crossing.ports) == 3 and angle == math.pi / 2 and branch == bore:
        least = (bore / 2 + bore / 32) * (1 + 1e-6)
        return Tee(2 * least, least, inner_diameter=bore) if tight else Tee(inner_diameter=bore)
    kind = Wye if len(crossing.ports) == 3 else Cross
    fillet = min(bore / 32, branch / 8)
    if kind is Wye and angle == math.pi / 2:
        fitting = Wye(2 * bore, bore, angle, fillet, bore, branch)
    else:
        fitting = kind(
            angle=angle, fillet_radius=fillet, inner_diameter=bore, branch_diameter=branch
        )
    if not tight:
        return fitting
    half, far = fitting.min_lengths
    return replace(fitting, run_length=2 * half * (1 + 1e-6), branch_length=far * (1 + 1e-6))
