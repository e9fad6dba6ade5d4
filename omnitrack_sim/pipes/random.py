"""Random networks that are always valid.

They are grown from open ends, with a straight between any two other fittings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.bounds import MAX_LENGTH, MAX_PARTS
from omnitrack_sim.base.errors import Fault, GeometryError, NetworkError
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Elbow, Fitting, Part, Reducer, Straight, Tee, attached
from omnitrack_sim.pipes.condition import in_condition
from omnitrack_sim.pipes.network import Network, validate

CLEARANCE = 0.05
"""Least room between the bores of parts that are not joined, m: more than a wall's thickness."""
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
REDUCER_ANGLE = math.radians(10)
"""Largest half cone angle of the reducers, rad."""
MIN_REDUCER = 0.1
"""Least length of the reducers, m."""
MIN_STRAIGHT = 0.01
"""Least length of the straights, m, which are drawn in multiples of it."""
_TRIES, _STARTS = 60, 100


def random_network(
    seed: int,
    fittings: int | tuple[int, int] = (6, 12),
    *,
    lengths: tuple[float, float] = (0.3, 0.8),
    mean_radii: tuple[float, ...] = (0.09, 0.24),
    tee_share: float = 0.5,
    inner_diameter: float = 0.16,
    diameters: tuple[float, ...] | None = None,
    reducer_share: float = 0.25,
    condition: str | Path | None = None,
) -> Network:
    """Generate a valid random network whose open ends are straights that a robot fits in.

    The same arguments give the same network.

    Args:
        seed: of NumPy's default generator.
        fittings: how many, or the least and greatest number.
        lengths: m, least and greatest length of a straight; multiples of 10 mm are drawn.
        mean_radii: m, of the elbows to draw from.
        tee_share: share of tees among the fittings between straights; the first is one if there is
            room for it.
        inner_diameter: m, of every bore; with ``diameters`` of the first one.
        diameters: m, bores that reducers lead to; without them all bores are the same.
        reducer_share: with ``diameters``, share of reducers among the fittings between straights;
            the first never is one.
        condition: of the pipes: ``good``, ``fair``, ``poor`` or a file, by whose rates relief and
            couplings are drawn into the straights; without one all are ideal.

    Raises:
        NetworkError: the arguments make no sense, there is no such condition, or no network of that
            size was found.

    Example:
        >>> import omnitrack_sim as ot
        >>> len(ot.random_network(7, fittings=5).fittings)
        5
    """
    low, high = (fittings, fittings) if isinstance(fittings, int) else fittings
    supply = _Supply(lengths, mean_radii, tee_share, inner_diameter, diameters or (), reducer_share)
    faults = [*_bad_numbers(seed, low, high, supply), *_bad_bores(supply)]
    if faults:
        raise NetworkError(faults)
    rng = np.random.default_rng(seed)
    count = int(rng.integers(low, high, endpoint=True))
    for _ in range(_STARTS):
        # Growth may wall itself in: another start with the same generator is another network.
        rows, joints = _grown(rng, count, supply)
        if len(rows) == count:
            network = validate({"name": f"random_{seed}", "fittings": rows, "joints": joints})
            return network if condition is None else in_condition(network, condition, seed)
    raise NetworkError(
        Fault("fittings", f"no network of {count} fittings was found; ask for fewer")
    )


def _bad_numbers(seed: int, low: int, high: int, supply: _Supply) -> Iterator[Fault]:
    """Faults of numbers that are invalid or ask for too large a network."""
    if not 1 <= low <= high <= MAX_PARTS:
        problem = f"is from {low} to {high}; from 1 to {MAX_PARTS}, and the least number first"
        yield Fault("fittings", problem)
    if seed < 0:
        yield Fault("seed", f"is {seed}; at least 0")
    shortest, longest = supply.lengths
    if not MIN_STRAIGHT <= shortest <= longest:
        problem = f"is from {shortest} to {longest} m; at least {MIN_STRAIGHT} m, and the least"
        yield Fault("lengths", f"{problem} first")
    elif not high * longest <= MAX_LENGTH:
        problem = f"{high} fittings of up to {longest} m may make {high * longest:.6g} m of pipe"
        yield Fault("lengths", f"{problem}; at most {MAX_LENGTH:.6g} m")
    for name in ("tee_share", "reducer_share"):
        share = getattr(supply, name)
        if not 0 <= share <= 1:
            yield Fault(name, f"is {share}; from 0 to 1")
    if not supply.mean_radii:
        yield Fault("mean_radii", "is empty; name at least one mean radius")


def _bad_bores(supply: _Supply) -> Iterator[Fault]:
    """Faults of bores that no tee, or none of the elbows, can have."""
    largest = max(supply.mean_radii, default=math.inf)
    bores = [("inner_diameter", supply.inner_diameter)]
    for where, diameter in bores + [("diameters", bore) for bore in supply.diameters]:
        try:
            Tee(inner_diameter=diameter)
            Elbow(largest, inner_diameter=diameter)
        except GeometryError as error:
            for fault in error.faults:
                yield Fault(where, f"{diameter} m does not go: {fault}")


@dataclass(frozen=True)
class _Supply:
    """Distribution that fittings are drawn from; fields as arguments of ``random_network``."""

    lengths: tuple[float, float]
    mean_radii: tuple[float, ...]
    tee_share: float
    inner_diameter: float
    diameters: tuple[float, ...]
    reducer_share: float

    def length(self, rng: np.random.Generator) -> float:
        """Length of a straight, m."""
        return round(float(rng.uniform(*self.lengths)), 2)

    def fitting(self, rng: np.random.Generator, bore: float, left: int, first: bool) -> Fitting:
        """Draw the next fitting.

        Args:
            rng: draws it.
            bore: m, of the port that it is joined to.
            left: how many fittings the network still lacks.
            first: whether it is the first one after the straight that the network grows from.
        """
        others = [diameter for diameter in self.diameters if diameter != bore]
        # The last fitting is a straight, since any other one brings straights along.
        if left == 1:
            return Straight(self.length(rng), bore)
        if not first and others and rng.random() < self.reducer_share:
            return _reducer(rng, bore, others)
        if left > 2 and (first or rng.random() < self.tee_share):
            return Tee(inner_diameter=bore)
        # An elbow's mean radius is at least that of its bore.
        possible = [radius for radius in self.mean_radii if radius >= bore / 2] or self.mean_radii
        return Elbow(float(rng.choice(possible)), inner_diameter=bore)


def _reducer(rng: np.random.Generator, bore: float, others: list[float]) -> Reducer:
    """A reducer between ``bore`` m and one of ``others`` m; either may be at its start."""
    # The order of draws is part of what a seed means: another one gives other networks.
    ends = [bore, float(rng.choice(others))]
    if rng.random() < 0.5:
        ends.reverse()
    least = abs(ends[0] - ends[1]) / 2 / math.tan(REDUCER_ANGLE)
    return Reducer(max(MIN_REDUCER, math.ceil(100 * least) / 100), ends[1], ends[0])


def _grown(
    rng: np.random.Generator, count: int, supply: _Supply
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Tables of fittings and joints; fewer than ``count`` fittings where there was no room."""
    growth = _Growth(rng, supply)
    tries = 0
    while len(growth.parts) < count and tries < _TRIES:
        tries = 0 if growth.add(count - len(growth.parts)) else tries + 1
    return [part.fitting.to_table() | {"name": part.name} for part in growth.parts], growth.joints


class _Growth:
    """A network that grows from one straight.

    Tees, elbows and reducers are added together with the straights at their other ports, so every
    open end is a straight.

    Attributes:
        parts: what has been placed.
        joints: tables of a network file.
    """

    def __init__(self, rng: np.random.Generator, supply: _Supply) -> None:
        self._rng, self._supply = rng, supply
        first = Part("straight_1", Straight(supply.length(rng), supply.inner_diameter), Pose())
        self.parts, self._surroundings = [first], [_Surroundings.of(first)]
        self.joints: list[dict[str, Any]] = []
        self._free = [(0, "start"), (0, "end")]

    def add(self, left: int) -> bool:
        """Try one fitting at one open end; return whether there was room for it.

        Args:
            left: how many fittings the network still lacks.
        """
        rng = self._rng
        index, port = self._free[int(rng.integers(len(self._free)))]
        # The new fitting is entered by a port of the very same bore.
        bore = 2 * self.parts[index].fitting.port_radius(port)
        fitting = self._supply.fitting(rng, bore, left, first=len(self.parts) == 1)
        fits = [end for end in fitting.port_names if 2 * fitting.port_radius(end) == bore]
        enter = fits[int(rng.integers(len(fits)))]
        # A straight or reducer looks the same however it is turned.
        turn_deg = 0.0 if fitting.is_axial else float(rng.choice(TURNS_DEG))
        part = _joined_to(self.parts[index], port, fitting, enter, turn_deg, len(self.parts))
        joint = _joint(self.parts[index], port, part, enter, turn_deg)
        ends = [end for end in fitting.port_names if end != enter]
        more, more_joints = [], []
        if not fitting.is_plain:
            more, more_joints = self._closed_by_straights(part, ends)
        if not self._take([part, *more], index):
            return False
        self.joints += [joint, *more_joints]
        self._free.remove((index, port))
        count = len(self.parts)
        if more:
            self._free += [(count - len(more) + i, "end") for i in range(len(more))]
        else:
            self._free += [(count - 1, end) for end in ends]
        return True

    def _closed_by_straights(
        self, part: Part, ends: list[str]
    ) -> tuple[list[Part], list[dict[str, Any]]]:
        """A straight at each of the ports ``ends`` of a part, and their joints."""
        straights: list[Part] = []
        for end in ends:
            straight = Straight(self._supply.length(self._rng), 2 * part.fitting.port_radius(end))
            index = len(self.parts) + 1 + len(straights)
            straights.append(_joined_to(part, end, straight, "start", 0.0, index))
        pairs = zip(ends, straights, strict=True)
        joints = [_joint(part, end, straight, "start", 0.0) for end, straight in pairs]
        return straights, joints

    def _take(self, new: list[Part], index: int) -> bool:
        """Keep new parts, the first of them joined to part ``index``, if there is room for all."""
        around = [_Surroundings.of(part) for part in new]
        for i, (part, surroundings) in enumerate(zip(new, around, strict=True)):
            joined = index if i == 0 else None
            if not self._has_room(part, surroundings, joined):
                return False
        self.parts += new
        self._surroundings += around
        return True

    def _has_room(self, new: Part, surroundings: _Surroundings, joined: int | None) -> bool:
        """Return whether a new part keeps clear of all ``parts`` but the one it is joined to."""
        centres = np.array([one.centre for one in self._surroundings])
        reaches = np.array([one.reach for one in self._surroundings])
        centre, samples = surroundings.centre, surroundings.samples
        apart = np.linalg.norm(centres - centre, axis=1)
        for index in np.flatnonzero(apart < reaches + surroundings.reach).tolist():
            if index == joined:
                continue
            others = self._surroundings[index].samples
            # Both ways round, as for overlaps: a wide bore's samples may miss a narrow one.
            near = others[np.linalg.norm(others - centre, axis=1) < surroundings.reach]
            if self.parts[index].holds(samples, -CLEARANCE) or (
                len(near) and new.holds(near, -CLEARANCE)
            ):
                return False
        return True


@dataclass(frozen=True)
class _Surroundings:
    """Samples of a part's bore, and a ball around them.

    Attributes:
        samples: (k, 3) m, points of its bore, world frame.
        centre, reach: (3,) m and m, a ball that holds the bore and the room to keep around it.
    """

    samples: Array
    centre: Array
    reach: float

    @classmethod
    def of(cls, part: Part) -> _Surroundings:
        samples = part.bore_samples()
        centre = (samples.max(axis=0) + samples.min(axis=0)) / 2
        # Samples stand at 0.95 of the radius.
        room = 0.1 * part.fitting.max_radius + 2 * CLEARANCE
        return cls(samples, centre, float(np.linalg.norm(samples - centre, axis=1).max()) + room)


def _joint(part: Part, port: str, new: Part, enter: str, turn_deg: float) -> dict[str, Any]:
    """Two ports in one place, as a table of a network file."""
    return {"ports": [f"{part.name}.{port}", f"{new.name}.{enter}"], "turn_deg": turn_deg}


def _joined_to(
    part: Part, port: str, fitting: Fitting, enter: str, turn_deg: float, index: int
) -> Part:
    """A fitting placed at a port of a part, named by its kind and number."""
    pose = attached(part.port(port), fitting, enter, np.radians(turn_deg))
    return Part(f"{fitting.kind}_{index + 1}", fitting, pose)
