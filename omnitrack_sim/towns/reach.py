"""Reach of a robot in a network by its passport, without a run.

That is how surely it gets to each pipe and back, at what cost, and what stops it.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError, NetworkError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Passage, Port
from omnitrack_sim.pipes.centreline import Segment
from omnitrack_sim.pipes.network import Network, both_ways
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.statistics import Z95
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.robots.tail import Tether
from omnitrack_sim.towns.bores import BoreReach, bores_of
from omnitrack_sim.towns.features import (
    FEATURES,
    RELIEF,
    TRIED,
    kind_of,
    relief_of,
    shape_of,
    slopes_of,
)
from omnitrack_sim.towns.passport import Passport
from omnitrack_sim.trials.batches import sha256_of

NO_WAY = "no way leads there"
"""Reason where pipes are not joined to those of the opening."""
FRICTION, PULL = FEATURES.index("friction"), FEATURES.index("pull")
MAX_LAUNCHES = 24
"""Open ends, at most, that are tried as openings where none are named: each takes a search through
the whole network."""


@dataclass(frozen=True)
class ReachSettings:
    """Numerics of the map.

    Attributes:
        frictions: values of the friction's range over which is averaged. It is the same all along a
            run, so that probabilities multiply at each of them and not on average.
        pulls: values of the pull at the tail between which is interpolated.
        chunk: points whose estimates are made at once, of some kB each.
    """

    frictions: int = 6
    pulls: int = 7
    chunk: int = 20_000


NUMERICS = ReachSettings()


@dataclass(frozen=True)
class Supply:
    """Energy supply of a robot: battery, efficiency, and power used all the time.

    Example:
        >>> ot.Supply(efficiency=0.5, base_power=10.0).energy(seconds=360.0, joules=1800.0)
        2.0

    Attributes:
        battery_wh: Wh; infinite where it is fed by its tether.
        efficiency: of motors and gears, from the battery to mechanical work. Assumed.
        base_power: W, of what runs all the time. Assumed.
    """

    battery_wh: float = math.inf
    efficiency: float = 0.3
    base_power: float = 5.0

    def energy(self, seconds: Any, joules: Any) -> Any:
        """Return what is used, Wh, in a time, s, with mechanical work, J."""
        return (joules / self.efficiency + seconds * self.base_power) / 3600


class PipeReach(NamedTuple):
    """Reach of a part of a network, or of a pipe of several, on the surest way to its far end.

    Attributes:
        name, kind: of the part; of a pipe "pipe". length: of its longest axis, or of all, m.
        probability: of getting there. low, high: 95 % interval, of what trials leave open.
        back: probability of getting there and back by the same way.
        seconds, seconds_std: mean time to get there, s, and its standard deviation.
        energy_wh: used on the way there.
        tether_n: pull of the tether there, N. tether_out_m: length of it that is out, m.
        launch: opening that it is reached from.
        stopped_by: what costs most on the way there or, unreached, what keeps the robot from it.
    """

    name: str
    kind: str
    length: float
    probability: float = 0.0
    low: float = 0.0
    high: float = 0.0
    back: float = 0.0
    seconds: float = math.nan
    seconds_std: float = math.nan
    energy_wh: float = math.nan
    tether_n: float = math.nan
    tether_out_m: float = math.nan
    launch: str = ""
    stopped_by: str = ""


@dataclass(frozen=True, eq=False)
class ReachMap:
    """Reach of a robot from openings of a network.

    Attributes:
        network: of the pipes.
        parts: in the order of the network's fittings; of several openings the surest.
        openings: names, best first: each adds most to the length that is reached and returned from.
        gains: m, expected length that each opening adds.
        paths: the way to each part that is reached, by its name.
        bores: of the network, the longest first, each with the size of a robot made for it.
        assumed: what the map rests on, as plain data: passport, network, friction, supply, tether,
            gravity, versions.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=4)
        >>> passport = plan.passport(ot.run_trials(plan).table)
        >>> reach = ot.map_reach(ot.load_network("tower"), passport, ["foot"])
        >>> reach.parts[1].name, reach.parts[1].probability  # tees were not tried
        ('tee_low', 0.0)
    """

    network: Network
    parts: tuple[PipeReach, ...]
    openings: tuple[str, ...]
    gains: tuple[float, ...]
    paths: Mapping[str, tuple[Edge, ...]] = field(default_factory=dict)
    bores: tuple[BoreReach, ...] = ()
    assumed: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"ReachMap({self.expected_length:.4g} of {self.length:.4g} m from {self.openings})"

    @cached_property
    def row_of(self) -> tuple[int, ...]:
        """Row in ``pipes`` of each part."""
        # A pipe and a node may have the same name.
        keys = [(fitting.pipe, fitting.pipe or fitting.name) for fitting in self.network.fittings]
        rows = {key: row for row, key in enumerate(dict.fromkeys(keys))}
        return tuple(rows[key] for key in keys)

    @cached_property
    def pipes(self) -> tuple[PipeReach, ...]:
        """One row for each pipe of the imported file, and for each other part.

        What is said of a pipe is said of its part that is reached least surely, or last.
        """
        rows: list[list[int]] = [[] for _ in set(self.row_of)]
        for part, row in enumerate(self.row_of):
            rows[row].append(part)
        return tuple(map(self._pipe, rows))

    def _pipe(self, parts: Sequence[int]) -> PipeReach:
        """The row of some parts of a pipe, or of a part of none."""
        own, pipe = [self.parts[i] for i in parts], self.network.fittings[parts[0]].pipe
        if not pipe:
            return own[0]
        length = sum(part.length for part in own)
        return max(own, key=_hard_to_reach)._replace(name=pipe, kind="pipe", length=length)

    @property
    def length(self) -> float:
        """Length of all parts, m."""
        return sum(part.length for part in self.parts)

    @property
    def expected_length(self) -> float:
        """Length that the robot is expected to get to, m."""
        return sum(part.length * part.probability for part in self.parts)


def _hard_to_reach(part: PipeReach) -> tuple[float, float]:
    """Order of parts: that which is reached least surely, or last, is the largest."""
    return -part.probability, math.inf if math.isnan(part.seconds) else part.seconds


class _Way(NamedTuple):
    """One passage of the network: its edge, row in the tables, kind, words and segments."""

    edge: Edge
    row: int
    kind: str
    what: str
    length: float
    segments: list[Segment]


@dataclass(frozen=True, eq=False)
class _Tables:
    """Estimates of all passages.

    Attributes:
        values: (7, ways, frictions, pulls): logarithm of the probability, minus infinity where
            nothing is known, and its standard deviation; seconds and joules of a pass, their
            standard deviations, and the standard error of the mean seconds.
        pulls: (pulls,) robot weights.
        reasons: why a way is unknown, by its row; "" where it is known.
    """

    values: Array
    pulls: Array
    reasons: list[str]

    def at(self, row: int, pull: float) -> Array:
        """Values (7, frictions) of a way at a pull."""
        place = np.interp(pull, self.pulls, np.arange(len(self.pulls)))
        low = min(int(place), max(len(self.pulls) - 2, 0))
        high, part = min(low + 1, len(self.pulls) - 1), place - low
        own = self.values[:, row]
        # Between an infinite value and itself there is no number.
        return own[..., low] if part == 0 else (1 - part) * own[..., low] + part * own[..., high]


@dataclass(frozen=True, eq=False)
class _Label:
    """Robot at the end of a way, by the surest path.

    Attributes:
        fittings, straights: logarithms (2, frictions) of the probabilities, there and back: of all
            fittings together, and of the worst straight, as all straights pass or fail alike.
        spread: by kind, of the logarithm there.
        costs: (2, 2, frictions) s and J, there and back.
        variances: (2, 2, frictions) of the costs: what differs from pass to pass.
        errors: (frictions,) s, by kind, of the means, alike in all passes of a kind.
        drag, slack: N, of the tether. out: m of it.
        worst: largest loss of one way on the path, and what it was.
        path: of the robot.
    """

    fittings: Array
    straights: Array
    spread: Mapping[str, float]
    costs: Array
    variances: Array
    errors: Mapping[str, Array]
    drag: float
    slack: float
    out: float
    worst: tuple[float, str]
    path: tuple[Any, ...]

    @property
    def logs(self) -> Array:
        """Logarithm (frictions,) of the probability of getting there."""
        return self.fittings[0] + self.straights[0]


def map_reach(
    network: Network,
    passport: Passport,
    launches: Sequence[str] = (),
    *,
    friction: tuple[float, float] = (0.6, 0.9),
    supply: Supply | None = None,
    tether: Tether | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -GRAVITY),
    openings: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> ReachMap:
    """Map where a robot gets to in a network.

    The robot takes the surest way to each pipe, nose first, and comes back by the same; the way
    back is judged as if it were driven nose first. Fittings pass independently, given the friction;
    straights alike.

    Args:
        network: of the pipes.
        passport: of the robot.
        launches: openings: open ends, or names of fittings that the robot is put into. All open
            ends, or some spread over them, when not given.
        friction: range of the walls'.
        supply: battery; none: without limit.
        tether: that the robot drags; none: it has none.
        gravity: (3,) m/s², world frame.
        openings: how many of the openings are used, the best first; all when not given.
        progress: called with the part done and a text.

    Raises:
        InputError: there is no such opening, or no passport for that friction.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=4)
        >>> passport = plan.passport(ot.run_trials(plan).table)
        >>> reach = ot.map_reach(ot.load_network("tower"), passport, ["foot"])
        >>> len(reach.parts) == len(reach.network.fittings), reach.openings
        (True, ('foot',))
    """
    check_is(Network, "network", network)
    planner = _Planner(network, passport, friction, supply or Supply(), tether, gravity)
    ends = network.open_ends
    if not launches:
        launches = ends[:: max(1, math.ceil(len(ends) / MAX_LAUNCHES))]
    for launch in launches:  # before the work
        deque(planner.starts(launch))
    planner.prepare(lambda part: progress and progress(part / 2, "estimates"))
    reaches: dict[str, list[PipeReach]] = {}
    paths: dict[str, dict[str, tuple[Edge, ...]]] = {}
    for k, launch in enumerate(launches):
        if progress is not None:
            progress(0.5 + k / len(launches) / 2, f"from {launch}")
        reaches[launch], paths[launch] = planner.spread(launch)
    made = _combined(network, reaches, paths, openings or len(launches))
    lengths, chances = zip(*((part.length, part.probability) for part in made.parts), strict=True)
    rows = bores_of(network, passport, lengths, chances)
    return replace(made, bores=rows, assumed=planner.assumed(friction, launches))


def _combined(
    network: Network,
    reaches: Mapping[str, list[PipeReach]],
    paths: Mapping[str, Mapping[str, tuple[Edge, ...]]],
    count: int,
) -> ReachMap:
    """Map of the best openings, chosen one after the other by the length that each adds."""
    lengths = np.array([part.length for part in next(iter(reaches.values()))])
    returns = {name: np.array([part.back for part in own]) for name, own in reaches.items()}
    best, chosen, gains = np.zeros(len(lengths)), [], []
    while len(chosen) < min(count, len(reaches)):
        more = {
            name: float(lengths @ np.maximum(own - best, 0.0))
            for name, own in returns.items()
            if name not in chosen
        }
        name = max(more, key=lambda name: more[name])
        chosen.append(name)
        gains.append(more[name])
        best = np.maximum(best, returns[name])
    # The surest of those chosen; what is unreached keeps the first reason on a way there.
    parts = [
        max(
            (reaches[name][i] for name in chosen),
            key=lambda part: (part.probability, part.stopped_by != NO_WAY),
        )
        for i in range(len(lengths))
    ]
    ways = {
        part.name: paths[part.launch][part.name]
        for part in parts
        if part.launch and part.name in paths[part.launch]
    }
    return ReachMap(network, tuple(parts), tuple(chosen), tuple(gains), ways)


class _Planner:
    """Estimates of all ways of a network, and the surest paths through it."""

    def __init__(
        self,
        network: Network,
        passport: Passport,
        friction: tuple[float, float],
        supply: Supply,
        tether: Tether | None,
        gravity: Sequence[float],
    ) -> None:
        low, high = friction
        lowest, highest = TRIED.friction
        if not lowest <= low <= high <= highest:
            problem = f"is {low:g}:{high:g}; two numbers from {lowest:g} to {highest:g}, ascending"
            raise InputError(Fault("friction", problem))
        self.network, self.passport = network, passport
        self.supply, self.tether, self.gravity = supply, tether, np.array(gravity, float)
        self.weight = passport.robot.mass * GRAVITY
        # Middles of equal parts of the range.
        count = 1 if low == high else NUMERICS.frictions
        self.friction = low + (high - low) * (np.arange(count) + 0.5) / count
        self.joined = both_ways(network.pipes.joints)
        self.ways: dict[Port, list[_Way]] = {}
        self.rows: dict[Edge, int] = {}

    def prepare(self, progress: Callable[[float], Any]) -> None:
        """Describe all ways, and estimate them."""
        points: dict[str, list[tuple[int, list[float]]]] = {}
        lengths: list[float] = []
        bore = self.passport.robot.nominal_bore
        parts = self.network.pipes.parts
        for i, part in enumerate(parts):
            for enter, leave in itertools.permutations(part.fitting.port_names, 2):
                passage = Passage.of(self.network.pipes, (i, enter, leave))
                kind, row = kind_of(passage), len(self.rows)
                climb, lift, _ = slopes_of(passage, self.gravity)
                shape, relief = shape_of(passage, bore), relief_of(passage, bore)
                points.setdefault(kind, []).append((row, [0.0, 0.0, climb, lift, *shape, *relief]))
                lengths.append(passage.length)
                segments = part.segments(passage.curve)
                what = _what(kind, part.fitting.kind, relief)
                way = _Way((i, enter, leave), row, kind, what, passage.length, segments)
                self.ways.setdefault((i, enter), []).append(way)
                self.rows[i, enter, leave] = row
            if i % 100 == 0:
                progress(i / len(parts) / 2)
        self.tables = self._estimated(points, np.array(lengths), progress)

    def _estimated(
        self,
        points: Mapping[str, list[tuple[int, list[float]]]],
        lengths: Array,
        progress: Callable[[float], Any],
    ) -> _Tables:
        """Tables of all ways, kind by kind; their lengths, m, by row."""
        pulls = np.linspace(0.0, TRIED.pull, NUMERICS.pulls) if self.tether else np.zeros(1)
        shape = (len(self.rows), len(self.friction), len(pulls))
        tables = np.full((7, *shape), np.nan)
        tables[0], reasons = -np.inf, [""] * len(self.rows)
        grid = np.stack(np.meshgrid(self.friction, pulls, indexing="ij"), axis=-1).reshape(-1, 2)
        done = 0
        for kind, own in points.items():
            step = max(1, NUMERICS.chunk // len(grid))
            for start in range(0, len(own), step):
                rows = [row for row, _ in own[start : start + step]]
                ways = np.array([point for _, point in own[start : start + step]])
                each = np.repeat(ways, len(grid), axis=0)
                each[:, [FRICTION, PULL]] = np.tile(grid, (len(ways), 1))
                made = self.passport.estimate(kind, each, np.repeat(lengths[rows], len(grid)))
                p = np.clip(np.where(made.is_known, made.probability, 1.0), 1e-12, 1.0)
                values = (
                    np.where(made.is_known, np.log(p), -np.inf),
                    (1 - p) * np.nan_to_num(made.logit_std),
                    *(np.maximum(np.nan_to_num(v), 0.0) for v in (made.seconds, made.joules)),
                    *(np.nan_to_num(v) for v in (made.seconds_std, made.joules_std)),
                    np.nan_to_num(made.seconds_error),
                )
                for table, value in zip(tables, values, strict=True):
                    table[rows] = value.reshape(len(rows), *shape[1:])
                for k, row in enumerate(rows):
                    if not np.isfinite(tables[0, row, :, 0]).any():
                        reasons[row] = self._unknown(kind, ways[k])
                done += len(rows)
                progress(0.5 + done / len(self.rows) / 2)
        return _Tables(tables, pulls, reasons)

    def _unknown(self, kind: str, point: Array) -> str:
        """Reason why nothing is known of a way."""
        bore = float(point[FEATURES.index("bore")]) * self.passport.robot.nominal_bore
        # What is left is narrower by its sharpness, but for elbows, which have one bore.
        sharpness = 0.0 if kind == "elbow" else float(point[FEATURES.index("sharpness")])
        for each in (bore, bore * (1 - sharpness)):
            misfit = self.passport.robot.misfit(each)
            if misfit:
                return f"bore {1000 * each:.0f} mm: {misfit}"
        trials = self.passport.kinds.get(kind)
        if trials is None:
            return f"unknown: no trials of {kind}"
        low, high = trials.bounds
        outside = [
            f"{name} {value:.3g}, tried {a:.3g} to {b:.3g}"
            for k, (name, value, a, b) in enumerate(zip(FEATURES, point, low, high, strict=True))
            if k not in (FRICTION, PULL) and not a - 0.02 <= value <= b + 0.02
        ]
        return (
            f"unknown: {kind} with {', '.join(outside) or 'features that were not tried together'}"
        )

    def assumed(self, friction: tuple[float, float], launches: Sequence[str]) -> dict[str, Any]:
        """Return what the map rests on; see ``ReachMap``."""
        passport, network, supply = self.passport, self.network, self.supply
        return {
            "passport": {
                "robot": passport.robot.kind,
                "changes": dict(passport.changes),
                "trials": sum(len(kind.passed) for kind in passport.kinds.values()),
                "sha256": passport.sha256,
            },
            "network": {"name": network.name, "sha256": sha256_of(network.model_dump(mode="json"))},
            "launches": list(launches),
            "friction": list(friction),
            "supply": {
                "battery_wh": supply.battery_wh if math.isfinite(supply.battery_wh) else None,
                "efficiency": supply.efficiency,
                "base_power_w": supply.base_power,
            },
            "tether": None if self.tether is None else self.tether.model_dump(mode="json"),
            "gravity_m_s2": self.gravity.tolist(),
            "way": "nose first, and back by the same way, judged as driven nose first",
            "versions": dict(environment()["versions"]),
        }

    def starts(self, launch: str) -> Iterator[Port]:
        """Yield the ports through which the robot goes into parts from an opening."""
        names = [fitting.name for fitting in self.network.fittings]
        try:
            start = self.network.end("--from", launch)
        except NetworkError as error:
            if launch not in names:
                raise InputError(error.faults) from None
            start = names.index(launch), ""
        if not start[1]:  # a fitting: into all that is joined to it
            ports = self.network.pipes.parts[start[0]].fitting.port_names
            yield from (self.joined[start[0], p] for p in ports if (start[0], p) in self.joined)
            return
        yield start

    def spread(self, launch: str) -> tuple[list[PipeReach], dict[str, tuple[Edge, ...]]]:
        """Return the reach of all parts from an opening, and the paths to those reached."""
        count = len(self.friction)
        pull = 0.0 if self.tether is None else self.tether.tension
        begin = _Label(
            fittings=np.zeros((2, count)),
            straights=np.zeros((2, count)),
            spread={},
            costs=np.zeros((2, 2, count)),
            variances=np.zeros((2, 2, count)),
            errors={},
            drag=pull,
            slack=pull,
            out=0.0,
            worst=(0.0, ""),
            path=(),
        )
        order = itertools.count()
        waiting = [(0.0, next(order), end, begin) for end in self.starts(launch)]
        blocked: list[tuple[float, int, Port, str]] = []
        best: dict[int, tuple[float, _Label]] = {}
        done: set[Port] = set()
        while waiting:
            cost, _, enter, label = heapq.heappop(waiting)
            if enter in done:
                continue
            done.add(enter)
            for way in self.ways.get(enter, ()):
                after = self._after(label, way)
                beyond = self.joined.get((way.edge[0], way.edge[2]))
                if isinstance(after, str):
                    blocked.append((cost, next(order), enter, after))
                    continue
                # A little for the length, that of two ways as sure the shorter one is taken.
                price = -_log_mean(after.logs) + 1e-7 * after.out
                part = way.edge[0]
                if part not in best or price < best[part][0]:
                    best[part] = price, after
                if beyond is not None and beyond not in done:
                    heapq.heappush(waiting, (price, next(order), beyond, after))
        reasons = self._reasons(blocked, {*best})
        return self._rows(launch, best, reasons)

    def _after(self, label: _Label, way: _Way) -> _Label | str:
        """The label behind a way, or why the robot does not take it."""
        tables, name = self.tables, self.network.pipes.parts[way.edge[0]].name
        out = label.out + way.length
        if self.tether is not None and out > self.tether.length:
            return f"tether: {self.tether.length:g} m are used up"
        drag, slack = self._pull(label, way)
        if self.tether is not None and drag > TRIED.pull * self.weight:
            return f"tether: pulls {drag:.0f} N in {name}, more than was tried"
        if tables.reasons[way.row]:
            return f"{tables.reasons[way.row]} ({name})"
        there = tables.at(way.row, drag / self.weight)
        if not np.isfinite(there[0]).any():
            return f"unknown: {way.kind} at a pull of {drag:.0f} N ({name})"
        i, enter, leave = way.edge
        # (7, 2, frictions), there and back, without a tether on the way back.
        both = np.stack([there, tables.at(self.rows[i, leave, enter], 0.0)], axis=1)
        logs = both[0]
        straight = way.kind == "straight"
        amount = way.length if straight else 1.0
        loss = -_log_mean(logs[0])
        if straight:
            loss = max(loss + _log_mean(label.straights[0]), 0.0)
        reason = f"{way.what} ({name}): {math.exp(-loss):.2f}"
        if self.tether is not None and drag > self.weight:
            reason += f", tether pulls {drag:.0f} N"
        spreads = dict(label.spread)
        own = float(np.mean(there[1]))
        before = spreads.get(way.kind, 0.0)
        spreads[way.kind] = max(before, own) if straight else before + own
        error = label.errors.get(way.kind, 0.0) + amount * there[6]
        return replace(
            label,
            fittings=label.fittings if straight else label.fittings + logs,
            straights=np.minimum(label.straights, logs) if straight else label.straights,
            spread=spreads,
            costs=label.costs + amount * both[2:4].swapaxes(0, 1),
            variances=label.variances + amount * both[4:6].swapaxes(0, 1) ** 2,
            errors={**label.errors, way.kind: error},
            drag=drag,
            slack=slack,
            out=out,
            worst=max(label.worst, (loss, reason)),
            path=(label.path, way.edge),
        )

    def _pull(self, label: _Label, way: _Way) -> tuple[float, float]:
        """The tether's pull and slack behind a way; see ``_Label``."""
        if self.tether is None:
            return label.drag, label.slack
        nodes = self.tether.tensions(way.segments, self.gravity, (label.drag, label.slack))
        return float(nodes[-1, 1]), float(nodes[-1, 2])

    def _reasons(
        self, blocked: Sequence[tuple[float, int, Port, str]], reached: set[int]
    ) -> dict[int, str]:
        """Return what keeps the robot from each part out of reach: the nearest block before it."""
        reasons: dict[int, str] = {}
        waiting = list(blocked)
        heapq.heapify(waiting)
        seen: set[Port] = set()
        while waiting:
            cost, order, enter, reason = heapq.heappop(waiting)
            if enter in seen:
                continue
            seen.add(enter)
            part = enter[0]
            if part not in reached:
                reasons.setdefault(part, reason)
            for way in self.ways.get(enter, ()):
                beyond = self.joined.get((way.edge[0], way.edge[2]))
                if beyond is not None:
                    heapq.heappush(waiting, (cost + 1e-6 * way.length, order, beyond, reason))
        return reasons

    def _rows(
        self, launch: str, best: Mapping[int, tuple[float, _Label]], reasons: Mapping[int, str]
    ) -> tuple[list[PipeReach], dict[str, tuple[Edge, ...]]]:
        rows, paths = [], {}
        for i, part in enumerate(self.network.pipes.parts):
            length = max(line.length for line, _, _ in part.axes)
            row = PipeReach(part.name, part.fitting.kind, length)
            if i in best:
                label = best[i][1]
                rows.append(self._row(row, label, launch))
                paths[part.name] = _edges(label.path)
            else:
                rows.append(row._replace(stopped_by=reasons.get(i, NO_WAY)))
        return rows, paths

    def _row(self, row: PipeReach, label: _Label, launch: str) -> PipeReach:
        """The reach of a part by the label at its far end."""
        supply = self.supply
        energy, back = (supply.energy(*costs) for costs in label.costs)
        own, own_back = (supply.energy(*costs) for costs in np.sqrt(label.variances))
        variance = own**2 + (0.01 * energy) ** 2
        variance_back = variance + own_back**2 + (0.01 * back) ** 2
        enough = _chance(supply.battery_wh - energy, variance)
        enough_back = _chance(supply.battery_wh - energy - back, variance_back)
        there = np.exp(label.logs)
        probability = float(np.mean(there * enough))
        returned = there * np.exp(label.fittings[1] + label.straights[1]) * enough_back
        weights = there / max(there.sum(), 1e-300)
        deviation = Z95 * math.sqrt(sum(each**2 for each in label.spread.values()))
        reason = label.worst[1] if label.worst[0] > 0.005 else ""
        if float(np.mean(there * enough_back)) < 0.9 * float(np.mean(there)):
            lost = "there" if probability < 0.9 * float(np.mean(there)) else "back"
            used = float(weights @ (energy + back))
            reason = f"battery: {used:.3g} Wh there and back, too little {lost}"
        # Mean over frictions, weighted by how often the robot gets there at each.
        seconds = weights @ label.costs[0, 0]
        between = weights @ (label.costs[0, 0] - seconds) ** 2
        shared = sum(float(weights @ error) ** 2 for error in label.errors.values())
        return row._replace(
            probability=probability,
            low=probability * math.exp(-deviation),
            high=min(probability * math.exp(deviation), 1.0),
            back=float(np.mean(returned)),
            seconds=float(seconds),
            seconds_std=math.sqrt(float(weights @ label.variances[0, 0] + between + shared)),
            energy_wh=float(weights @ energy),
            tether_n=label.drag if self.tether else math.nan,
            tether_out_m=label.out if self.tether else math.nan,
            launch=launch,
            stopped_by=reason,
        )


def _what(kind: str, fitting: str, relief: Sequence[float]) -> str:
    """Return what a way is, such as "elbow", or what stands in it: "step and gap in coupling"."""
    names = [name for name, size in zip(RELIEF, relief, strict=True) if size > 0]
    return f"{' and '.join(names)} in {fitting}" if names else kind


def _edges(path: tuple[Any, ...]) -> tuple[Edge, ...]:
    """The edges of a path that is linked from its end: (path before, edge)."""
    edges = []
    while path:
        path, edge = path
        edges.append(edge)
    return tuple(reversed(edges))


def _chance(left: Array, variance: Array) -> Array:
    """Chance that what is left of a battery, Wh, is more than nothing, by its variance, Wh²."""
    # A way that costs nothing, or of which nothing is known, does not vary.
    return ndtr(left / np.sqrt(np.maximum(variance, 1e-24)))


def _log_mean(logs: Array) -> float:
    """Logarithm of the mean of what ``logs`` are logarithms of."""
    return float(np.logaddexp.reduce(logs) - math.log(len(logs)))
