"""Policies with random weights, for tests of what reads them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURES
from omnitrack_sim.robots.omnitrack.policy.file import (
    DIRECT,
    Acting,
    Mlp,
    Policy,
    named_features,
)


def random_network(inputs: int, seed: int = 0, hidden: Sequence[int] = (16, 16), **more) -> Mlp:
    """An mlp with weights whose outputs go over all of their range."""
    draw = np.random.default_rng(seed)
    widths = (inputs, *hidden, len(ACTIONS))
    return Mlp(
        weights=[draw.normal(0, 1.5 / np.sqrt(a), (a, b)) for a, b in pairwise(widths)],
        biases=[draw.normal(0, 0.1, b) for b in widths[1:]],
        mean=draw.normal(0, 0.1, inputs),
        std=draw.uniform(0.5, 2.0, inputs),
        **more,
    )


def random_policy(
    features: str = "onboard", acting: Acting = DIRECT, seed: int = 0, **more
) -> Policy:
    """A policy that knows nothing."""
    names = named_features(features)
    size = sum(FEATURES[name].size for name in names)
    return Policy(random_network(size, seed, **more), names, acting, "random weights")


def driver(speed: float = 0.5) -> Policy:
    """Drives all modules forward at a part of the speed limit, whatever it observes."""
    names = named_features("tilt")
    network = Mlp([np.zeros((1, 4))], [np.array([speed] * 3 + [0.0])], np.zeros(1), np.ones(1))
    return Policy(network, names)
