"""Random networks are valid, repeat, and keep clear of themselves."""

from __future__ import annotations

import itertools
import tomllib

import pytest

from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.pipes.network import validate
from omnitrack_sim.pipes.random import CLEARANCE, random_network


@pytest.mark.parametrize("block", range(5))
def test_random_networks_are_valid_and_repeat(block):
    """Networks of ten seeds are valid, have the size asked for, are the same again, and survive
    being written."""
    for seed in range(10 * block, 10 * block + 10):
        network = random_network(seed)
        assert 6 <= len(network.fittings) <= 12
        assert len(network.open_ends) >= 3  # the first fitting that is no straight is a tee
        assert validate(tomllib.loads(network.to_toml())) == network
        for part in network.fittings:
            if part.kind == "straight":
                assert 0.3 <= part.length <= 0.8
    assert random_network(block) == random_network(block)
    assert random_network(block) != random_network(block + 100)


def test_random_networks_with_reducers():
    """With ``diameters`` bores change at reducers and nowhere else; every network is valid and the
    same again."""
    bores = (0.16, 0.15, 0.1)
    reducers = 0
    for seed in range(30):
        network = random_network(seed, 10, diameters=bores)
        assert network == random_network(seed, 10, diameters=bores)
        assert validate(tomllib.loads(network.to_toml())) == network
        assert {part.inner_diameter for part in network.fittings} <= set(bores)
        reducers += sum(part.kind == "reducer" for part in network.fittings)
        for (i, port), (j, other) in network.pipes.joints:
            a, b = network.pipes.parts[i].fitting, network.pipes.parts[j].fitting
            assert a.port_radius(port) == b.port_radius(other)
    assert reducers > 10
    assert random_network(5, 10, diameters=(0.16,)).fittings == random_network(5, 10).fittings
    with pytest.raises(NetworkError, match=r"diameters: 0\.6 m"):
        random_network(5, 10, diameters=(0.16, 0.6))


def test_random_networks_of_any_size():
    """One fitting and thirty are possible; nonsense is refused."""
    assert len(random_network(0, 1).fittings) == 1
    assert len(random_network(0, 30).fittings) == 30
    for seed, size in ((0, 0), (0, (5, 3)), (-1, 5)):
        with pytest.raises(NetworkError):
            random_network(seed, size)


@pytest.mark.parametrize("seed", range(5))
def test_pipes_of_random_networks_keep_clear_of_each_other(seed: int) -> None:
    """Bores of parts that are not joined are at least ``CLEARANCE`` apart, so that a wall fits
    between them."""
    network = random_network(seed, 14)
    parts, joints = network.pipes.parts, network.pipes.joints
    joined = {frozenset((i, j)) for (i, _), (j, _) in joints}
    samples = [part.bore_samples() for part in parts]
    apart = [
        (i, j)
        for i, j in itertools.permutations(range(len(parts)), 2)
        if frozenset((i, j)) not in joined
    ]
    assert len(apart) > 100
    assert not any(parts[i].holds(samples[j], -CLEARANCE) for i, j in apart)
