"""Environments of Gymnasium, as they are registered."""

from __future__ import annotations

import gymnasium


def single(name="TeeTurn", **options):
    """One robot's environment, as it is registered."""
    return gymnasium.make(f"omnitrack_sim/{name}-v0", **options)


def vector(n, name="TeeTurn", **options):
    """Many robots' environment, as it is registered."""
    return gymnasium.make_vec(
        f"omnitrack_sim/{name}-v0",
        num_envs=n,
        vectorization_mode="vector_entry_point",
        **options,
    )
