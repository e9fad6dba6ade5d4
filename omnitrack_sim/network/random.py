"""Random networks that are always valid: grown from open ends, with a straight between any two
other fittings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from omnitrack_sim.errors import Fault, GeometryError, NetworkError
from omnitrack_sim.network.spec import Network, validate
from omnitrack_sim.pipes import Elbow, Fitting, Part, Reducer, Straight, Tee, attached
from omnitrack_sim.rotations import Array, Pose

CLEARANCE = 0.05
"""Least room between the bores of two parts that are not joined, m: more than any wall is thick."""
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
REDUCER_ANGLE = math.radians(10)
"""Largest half cone angle of the reducers made here, rad."""
SHORTEST_REDUCER = 0.1
"""Least length of the reducers made here, m."""
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
) -> Network:
    """A valid network, every open end a straight that a robot can stand in; the same arguments give
    the same one.

    Args:
        seed: of NumPy's default generator.
        fittings: how many, or the least and greatest number.
        lengths: m, least and greatest length of a straight; multiples of 10 mm are drawn.
        mean_radii: m, of the elbows to draw from.
        tee_share: part of the fittings between straights that are tees; the first one is, where
            there is room for it.
        inner_diameter: m, of every bore; with ``diameters`` of the first one.
        diameters: m, bores that reducers lead to; without them all bores are the same.
        reducer_share: with ``diameters``, part of the fittings between straights that are reducers;
            the first never is.

    Raises:
        NetworkError: the arguments make no sense, or no network of that size was found.
    """
    low, high = (fittings, fittings) if isinstance(fittings, int) else fittings
    if not 1 <= low <= high:
        raise NetworkError(
            Fault("fittings", f"is {fittings}; at least 1, and the least number first")
        )
    if seed < 0:
        raise NetworkError(Fault("seed", f"is {seed}; at least 0"))
    _check_bores(diameters or (), mean_radii)
    rng = np.random.default_rng(seed)
    count = int(rng.integers(low, high, endpoint=True))
    for _ in range(_STARTS):
        rows, joints = _grown(
            rng,
            count,
            lengths,
            mean_radii,
            tee_share,
            inner_diameter,
            diameters or (),
            reducer_share,
        )
        if len(rows) == count:
            return validate({"name": f"random_{seed}", "fittings": rows, "joints": joints})
    raise NetworkError(
        Fault("fittings", f"no network of {count} fittings was found; ask for fewer")
    )


def _check_bores(diameters: tuple[float, ...], mean_radii: tuple[float, ...]) -> None:
    """Refuse bores that no tee, or none of the elbows, can have."""
    faults = []
    for diameter in diameters:
        try:
            Tee(inner_diameter=diameter)
            Elbow(max(mean_radii, default=math.inf), inner_diameter=diameter)
        except GeometryError as error:
            faults += [
                Fault("diameters", f"{diameter} m does not go: {fault}") for fault in error.faults
            ]
    if faults:
        raise NetworkError(faults)


def _grown(
    rng: np.random.Generator,
    count: int,
    lengths: tuple[float, float],
    mean_radii: tuple[float, ...],
    tee_share: float,
    inner_diameter: float,
    diameters: tuple[float, ...],
    reducer_share: float,
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Tables of fittings and joints; fewer than ``count`` fittings where there was no room.

    Tees, elbows and reducers are added together with the straights at their other ports, so every
    open end is a straight.
    """
    first = Part("straight_1", Straight(_draw_length(rng, lengths), inner_diameter), Pose())
    parts, samples = [first], [first.bore_samples()]
    joints: list[dict[str, Any]] = []
    free = [(0, "start"), (0, "end")]
    tries = 0
    while len(parts) < count and tries < _TRIES:
        tries += 1
        left = count - len(parts)
        index, port = free[int(rng.integers(len(free)))]
        bore = 2 * parts[index].fitting.port_radius(port)
        others = [diameter for diameter in diameters if diameter != bore]
        if left == 1:
            fitting: Fitting = Straight(_draw_length(rng, lengths), bore)
        elif len(parts) > 1 and others and rng.random() < reducer_share:
            fitting = _reducer(rng, bore, others)
        elif left > 2 and (len(parts) == 1 or rng.random() < tee_share):
            fitting = Tee(inner_diameter=bore)
        else:
            possible = [radius for radius in mean_radii if radius >= bore / 2] or mean_radii
            fitting = Elbow(float(rng.choice(possible)), inner_diameter=bore)
        fits = [end for end in fitting.port_names if 2 * fitting.port_radius(end) == bore]
        enter = fits[int(rng.integers(len(fits)))]
        turn_deg = 0.0 if fitting.is_axial else float(rng.choice(TURNS_DEG))
        new = [_joined_to(parts[index], port, fitting, enter, turn_deg, len(parts))]
        ends = [(len(parts), end) for end in fitting.port_names if end != enter]
        added = [
            {
                "ports": [f"{parts[index].name}.{port}", f"{new[0].name}.{enter}"],
                "turn_deg": turn_deg,
            }
        ]
        if not fitting.is_plain:
            for _, end in ends:
                straight = Straight(_draw_length(rng, lengths), 2 * fitting.port_radius(end))
                new.append(_joined_to(new[0], end, straight, "start", 0.0, len(parts) + len(new)))
                added.append(
                    {"ports": [f"{new[0].name}.{end}", f"{new[-1].name}.start"], "turn_deg": 0.0}
                )
            ends = [(len(parts) + 1 + i, "end") for i in range(len(ends))]
        new_samples = [part.bore_samples() for part in new]
        if all(
            _has_room(parts, samples, index if i == 0 else None, part, points)
            for i, (part, points) in enumerate(zip(new, new_samples, strict=True))
        ):
            parts += new
            samples += new_samples
            joints += added
            free.remove((index, port))
            free += ends
            tries = 0
    return [part.fitting.to_table() | {"name": part.name} for part in parts], joints


def _joined_to(
    part: Part, port: str, fitting: Fitting, enter: str, turn_deg: float, index: int
) -> Part:
    """A fitting placed at a port of another one, with a name that says which part it is."""
    pose = attached(part.port(port), fitting, enter, np.radians(turn_deg))
    return Part(f"{fitting.kind}_{index + 1}", fitting, pose)


def _reducer(rng: np.random.Generator, bore: float, others: list[float]) -> Reducer:
    """A reducer between ``bore`` m and one of ``others`` m; either may be at its start."""
    ends = [bore, float(rng.choice(others))]
    if rng.random() < 0.5:
        ends.reverse()
    least = abs(ends[0] - ends[1]) / 2 / math.tan(REDUCER_ANGLE)
    return Reducer(max(SHORTEST_REDUCER, math.ceil(100 * least) / 100), ends[1], ends[0])


def _draw_length(rng: np.random.Generator, lengths: tuple[float, float]) -> float:
    return round(float(rng.uniform(*lengths)), 2)


def _has_room(
    parts: list[Part], samples_of: list[Array], joined: int | None, new: Part, samples: Array
) -> bool:
    """Whether a new part, with points of its bore, keeps clear of all ``parts`` but the one that it
    is joined to."""
    centre = (samples.max(axis=0) + samples.min(axis=0)) / 2
    reach = float(np.linalg.norm(samples - centre, axis=1).max()) + 2 * CLEARANCE
    for index, part in enumerate(parts):
        if index == joined:
            continue
        others = samples_of[index]
        near = others[np.linalg.norm(others - centre, axis=1) < reach]
        if part.holds(samples, -CLEARANCE) or (len(near) and new.holds(near, -CLEARANCE)):
            return False
    return True
