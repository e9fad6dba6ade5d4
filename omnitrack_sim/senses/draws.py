"""Random numbers by counting: each is a function of a key, a name and a number of the draw.

So a robot draws the same alone and in a batch, whatever the others do, and whatever was drawn
before.
"""

from __future__ import annotations

import functools
import hashlib

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array

# The increment of SplitMix64, 2^64 over the golden ratio, and its two multipliers.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
Keys = NDArray[np.uint64]


def keys(texts: list[str]) -> Keys:
    """A key (n,) for each robot, from a text of its own."""
    digests = (hashlib.sha256(text.encode()).digest()[:8] for text in texts)
    return np.array([int.from_bytes(digest, "little") for digest in digests], np.uint64)


def uniform(
    keys: Keys, name: str, draw: int | NDArray[np.int_], which: int | NDArray[np.intp]
) -> Array:
    """Return numbers (n, k) in (0, 1).

    The mixing is that of SplitMix64 (Steele, Lea and Flood, 2014).

    Args:
        keys: (n,) of the robots.
        name: of what is drawn.
        draw: its number, or (n,) that of each.
        which: how many, or (k,) which of them: each depends on its place alone.
    """
    numbers = [draw] if isinstance(draw, int) else draw.tolist()
    with np.errstate(over="ignore"):
        start = _mixed(keys ^ np.array([_stream(name, number) for number in numbers], np.uint64))
        places = np.arange(which) if isinstance(which, int) else which
        z = _mixed(start[:, None] + (places + 1).astype(np.uint64) * _GOLDEN)
    # 53 bits fill a double; half a step keeps out 0, of which there is no logarithm.
    return ((z >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53


@functools.lru_cache(4096)
def _stream(name: str, draw: int) -> int:
    """Stream number that the draws of one name and number have in common."""
    return int.from_bytes(hashlib.sha256(f"{name} {draw}".encode()).digest()[:8], "little")


def normal(
    keys: Keys, name: str, draw: int | NDArray[np.int_], which: int | NDArray[np.intp]
) -> Array:
    """Return numbers (n, k) of the standard normal distribution, by Box and Muller.

    Arguments as of ``uniform``.
    """
    places = np.arange(which) if isinstance(which, int) else which
    both = uniform(keys, name, draw, np.concatenate([2 * places, 2 * places + 1]))
    # Copies: on arrays with gaps NumPy's functions may round otherwise, so that a robot would draw
    # other numbers among others than alone.
    u, v = both[:, : len(places)].copy(), both[:, len(places) :].copy()
    return np.sqrt(-2.0 * np.log(u)) * np.cos(2 * np.pi * v)


def _mixed(z: Keys) -> Keys:
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))
