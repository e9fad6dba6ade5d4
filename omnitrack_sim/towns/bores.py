"""Bores of a network, and the size of a robot that would fit most of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.towns.features import FEATURES
from omnitrack_sim.towns.passport import Passport

MARGIN = 0.02
"""Bore beyond those of the trials, over the nominal one, that counts as tried."""
STEP = 1e-4
"""Bores that differ by less, m, are one."""


class BoreReach(NamedTuple):
    """Pipes of one bore in a network.

    Attributes:
        bore_m: m.
        length_m: of all parts of that bore, m.
        expected_m: of it the robot is expected to get to, m.
        scale: size of a robot made for this bore, over that of the one on the map.
        net_m: length of the longest connected net of parts, of any bore, that a robot of that size
            fits, m: it may be put in anywhere there; fittings, slopes and supply may stop it.
    """

    bore_m: float
    length_m: float
    expected_m: float
    scale: float
    net_m: float


def bores_of(
    network: Network,
    passport: Passport,
    lengths: Sequence[float],
    probabilities: Sequence[float],
) -> tuple[BoreReach, ...]:
    """Return a row for each bore of a network, the longest first.

    Args:
        network: of the pipes.
        passport: of the robot.
        lengths: of the parts, m.
        probabilities: of getting to each.
    """
    ports = _port_bores(network)
    own = np.array([max(each) for each in ports])
    length, reached = np.array(lengths), np.array(lengths) * np.array(probabilities)
    nominal, rows = passport.robot.nominal_bore, []
    for number in np.unique(np.round(own / STEP)):
        here = np.round(own / STEP) == number
        bore = float(own[here].mean())
        net = _longest_net(network, _fitting(ports, passport, bore / nominal), length)
        whole, expected = (float(values[here].sum()) for values in (length, reached))
        rows.append(BoreReach(bore, whole, expected, bore / nominal, net))
    return tuple(sorted(rows, key=lambda row: -row.length_m))


def _port_bores(network: Network) -> list[list[float]]:
    """Bores at the ports of each part, m."""
    fittings = [part.fitting for part in network.pipes.parts]
    return [[2 * each.port_radius(port) for port in each.port_names] for each in fittings]


def _fitting(ports: Sequence[Sequence[float]], passport: Passport, scale: float) -> Array:
    """Return which parts (P,) have only bores that the robot, made larger by ``scale``, fits."""
    low, high = tried_bores(passport)
    robot, nominal = passport.robot, passport.robot.nominal_bore * scale
    known: dict[float, bool] = {}
    for bore in {bore for each in ports for bore in each}:
        in_trials = low - MARGIN <= bore / nominal <= high + MARGIN
        known[bore] = in_trials and not robot.misfit(bore / scale)
    return np.array([all(known[bore] for bore in each) for each in ports])


def tried_bores(passport: Passport) -> tuple[float, float]:
    """Return the range of bores in the trials of straights, over the nominal one."""
    straight, column = passport.kinds.get("straight"), FEATURES.index("bore")
    if straight is None:
        return 1.0, 1.0
    low, high = straight.bounds
    return float(low[column]), float(high[column])


def _longest_net(network: Network, fits: Array, lengths: Array) -> float:
    """Return the length, m, of the longest connected net of parts that fit, (P,)."""
    pairs = [(a, b) for (a, _), (b, _) in network.pipes.joints if fits[a] and fits[b]]
    rows, columns = np.array(pairs, int).reshape(-1, 2).T
    count = len(fits)
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    net = connected_components(graph, directed=False)[1]
    return float(np.bincount(net, np.where(fits, lengths, 0.0)).max(initial=0.0))
