"""Random networks that are always valid: grown from open ends, with a straight between any two other fittings."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnitrack_sim.errors import Fault, NetworkError
from omnitrack_sim.frames import Pose
from omnitrack_sim.network.spec import Network, validate
from omnitrack_sim.pipes import Elbow, Fitting, Placed, Straight, Tee, attached

CLEARANCE = 0.05
"""Least room between the bores of two parts that are not joined, m: more than any wall is thick."""
TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
_TRIES, _STARTS = 60, 20


def random_network(
    seed: int,
    fittings: int | tuple[int, int] = (6, 12),
    *,
    lengths: tuple[float, float] = (0.3, 0.8),
    mean_radii: tuple[float, ...] = (0.09, 0.24),
    tee_share: float = 0.5,
    inner_diameter: float = 0.16,
) -> Network:
    """A valid network; the same arguments give the same one.

    Args:
        seed: of NumPy's default generator.
        fittings: how many, or the least and greatest number.
        lengths: m, least and greatest length of a straight; multiples of 10 mm are drawn.
        mean_radii: m, of the elbows to draw from.
        tee_share: part of the fittings between straights that are tees; the first one always is.
        inner_diameter: m, of every bore.

    Raises:
        NetworkError: the arguments make no sense, or no network of that size was found.
    """
    low, high = (fittings, fittings) if isinstance(fittings, int) else fittings
    if not 1 <= low <= high:
        raise NetworkError(Fault("fittings", f"is {fittings}; at least 1, and the least number first"))
    if seed < 0:
        raise NetworkError(Fault("seed", f"is {seed}; at least 0"))
    rng = np.random.default_rng(seed)
    count = int(rng.integers(low, high, endpoint=True))
    for _ in range(_STARTS):
        rows, joints = _grown(rng, count, lengths, mean_radii, tee_share, inner_diameter)
        if len(rows) == count:
            return validate({"name": f"random_{seed}", "fittings": rows, "joints": joints})
    raise NetworkError(Fault("fittings", f"no network of {count} fittings was found; ask for fewer"))


def _grown(
    rng: np.random.Generator,
    count: int,
    lengths: tuple[float, float],
    mean_radii: tuple[float, ...],
    tee_share: float,
    inner_diameter: float,
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Tables of fittings and joints; fewer than ``count`` fittings where there was no room."""
    length = _draw_length(rng, lengths)
    parts = [Placed("straight_1", Straight(length, inner_diameter), Pose())]
    rows: list[dict[str, Any]] = [_row("straight_1", parts[0].fitting)]
    joints: list[dict[str, Any]] = []
    free = [(0, "start"), (0, "end")]
    tries = 0
    while len(rows) < count and tries < _TRIES:
        tries += 1
        index, port = free[int(rng.integers(len(free)))]
        if not isinstance(parts[index].fitting, Straight):
            fitting: Fitting = Straight(_draw_length(rng, lengths), inner_diameter)
        elif len(rows) == 1 or rng.random() < tee_share:
            fitting = Tee(inner_diameter=inner_diameter)
        else:
            fitting = Elbow(float(rng.choice(mean_radii)), inner_diameter=inner_diameter)
        enter = fitting.choices[int(rng.integers(len(fitting.choices)))]
        # A straight looks the same however it is turned.
        turn_deg = 0.0 if isinstance(fitting, Straight) else float(rng.choice(TURNS_DEG))
        pose = attached(parts[index].port(port), fitting, enter, np.radians(turn_deg))
        new = Placed(f"{fitting.kind}_{len(rows) + 1}", fitting, pose)
        if _has_room(parts, index, new):
            parts.append(new)
            rows.append(_row(new.name, fitting))
            joints.append({"ports": [f"{parts[index].name}.{port}", f"{new.name}.{enter}"], "turn_deg": turn_deg})
            free.remove((index, port))
            free += [(len(parts) - 1, other) for other in fitting.choices if other != enter]
            tries = 0
    return rows, joints


def _draw_length(rng: np.random.Generator, lengths: tuple[float, float]) -> float:
    return round(float(rng.uniform(*lengths)), 2)


def _has_room(parts: list[Placed], joined: int, new: Placed) -> bool:
    """Whether a new part keeps clear of all parts but the one it is joined to."""
    samples = new.bore_samples()
    centre = (samples.max(axis=0) + samples.min(axis=0)) / 2
    reach = float(np.linalg.norm(samples - centre, axis=1).max()) + 2 * CLEARANCE
    for index, part in enumerate(parts):
        if index == joined:
            continue
        others = part.bore_samples()
        near = others[np.linalg.norm(others - centre, axis=1) < reach]
        if part.holds(samples, -CLEARANCE) or (len(near) and new.holds(near, -CLEARANCE)):
            return False
    return True


def _row(name: str, fitting: Fitting) -> dict[str, Any]:
    """A fitting as a table of a network file."""
    row: dict[str, Any] = {"kind": fitting.kind, "name": name}
    if isinstance(fitting, Straight):
        row["length"] = fitting.length
    elif isinstance(fitting, Elbow):
        row["mean_radius"] = fitting.mean_radius
    return row | {"inner_diameter": fitting.inner_diameter}  # type: ignore[attr-defined]
