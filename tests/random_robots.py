"""Robots drawn over the whole ranges of their parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import ValidationError

import omnitrack_sim as ot
from omnitrack_sim.robots.quantity import Quantity, quantity_of

STANDING = 0.02
"""Room between the robot's tail and the start of its pipe, in bores."""


def random_robots(seed: int, count: int, edge_share: float = 0.2) -> Iterator[ot.Omnitrack]:
    """``count`` robots whose numbers are log-uniform over their ranges, or at one of the ends of
    them with the probability ``edge_share``; draws that do not go together are left out."""
    rng, found = np.random.default_rng(seed), 0
    while found < count:
        values = _drawn(rng, ot.Omnitrack, edge_share)
        del values["values_at_scale"]
        for motor in ("motor", "roll_motor"):
            values[motor] = _drawn(rng, ot.Motor, edge_share) | {"scale": None}
        try:
            robot = ot.Omnitrack.model_validate(values)
        except ValidationError as error:
            if any(item["type"] != "misfit" for item in error.errors()):
                raise
            continue
        found += 1
        yield robot


def standing(robot: ot.Omnitrack, collider: str) -> dict[str, Any]:
    """A scenario, as plain data, in which a robot stands upright in a straight pipe of the bore
    that it is made for."""
    bore, length = robot.nominal_bore, robot.length
    start = length / 2 + STANDING * bore
    return {
        "pipes": [{"kind": "straight", "inner_diameter": bore, "length": 2 * length + 4 * bore}],
        "robot": robot.model_dump(),
        "start": {"distance": start, "theta5_deg": 20.0},
        "physics": {"collider": collider},
        "run": {"time_limit": 0.5},
    }


def _drawn(rng: np.random.Generator, model: Any, edge_share: float) -> dict[str, Any]:
    return {
        name: _number(rng, quantity_of(model, name), edge_share, info.annotation is int)
        for name, info in model.model_fields.items()
        if quantity_of(model, name).within is not None
    }


def _number(rng: np.random.Generator, quantity: Quantity, edge_share: float, whole: bool) -> float:
    assert quantity.within is not None
    low, high = quantity.within
    least = low if low > 0 else high * 1e-6
    value = least * (high / least) ** rng.random()
    if rng.random() < edge_share:
        value = (low, high)[int(rng.integers(2))]
    if whole:
        even = 2 if low == 2 else 1
        return int(np.clip(even * round(value / even), low, high))
    return float(value)
