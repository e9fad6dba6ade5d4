"""Bores of a network, and how much of it a robot of each one's size fits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.towns.bores import BoreReach, bores_of, tried_bores
from omnitrack_sim.towns.features import FEATURES

BORES, LENGTHS, CONE = (0.160, 0.163, 0.165), (0.5, 0.7, 0.9), 0.1


def network() -> ot.Network:
    """Pipes of three bores that differ by 2 %, with a cone between each two."""
    fittings, joints = [], []
    for i, (bore, length) in enumerate(zip(BORES, LENGTHS, strict=True)):
        pipe = {"kind": "straight", "name": f"pipe_{i}", "length": length, "inner_diameter": bore}
        fittings.append(pipe)
        if i + 1 < len(BORES):
            cone = {"kind": "reducer", "name": f"cone_{i}", "length": CONE}
            fittings.append({**cone, "inner_diameter": bore, "end_diameter": BORES[i + 1]})
            joints.append({"ports": (f"pipe_{i}.end", f"cone_{i}.start")})
            joints.append({"ports": (f"cone_{i}.end", f"pipe_{i + 1}.start")})
    return ot.Network(fittings=fittings, joints=joints)


def passport(low: float | None, high: float, misfit=lambda bore: "") -> SimpleNamespace:
    """Of a robot for 160 mm, tried in straights of such bores over that; None: in no straight."""
    bounds = np.full((2, len(FEATURES)), np.nan)
    bounds[:, FEATURES.index("bore")] = low or 0.0, high
    kinds = {} if low is None else {"straight": SimpleNamespace(bounds=bounds)}
    return SimpleNamespace(robot=SimpleNamespace(nominal_bore=0.16, misfit=misfit), kinds=kinds)


def rows(of: SimpleNamespace) -> dict[float, BoreReach]:
    """Rows by bore; the robot gets to each other part for sure, to the rest half of the time."""
    parts = network().pipes.parts
    lengths = [part.fitting.length for part in parts]
    chances = [1.0 if i % 2 == 0 else 0.5 for i in range(len(parts))]
    found = bores_of(network(), of, lengths, chances)
    assert [row.length_m for row in found] == sorted((r.length_m for r in found), reverse=True)
    return {round(row.bore_m, 4): row for row in found}


def test_each_bore_has_its_length_what_is_reached_of_it_and_its_scale():
    """A cone counts for its wider end."""
    found = rows(passport(1.0, 1.0))
    assert sorted(found) == list(BORES)
    for bore, length, cones in zip(BORES, LENGTHS, (0, 1, 1), strict=True):
        row = found[bore]
        assert row.length_m == pytest.approx(length + cones * CONE)
        assert row.expected_m == pytest.approx(length + cones * CONE / 2)
        assert row.scale == pytest.approx(bore / 0.16)


@pytest.mark.parametrize(
    ("low", "high", "nets"),
    [
        # Of the trials' bores 2 % more and less count as tried: the next bore, not the one after.
        (1.0, 1.0, (0.5 + 0.1 + 0.7, 2.1 + 0.2, 0.7 + 0.1 + 0.9)),
        (0.9, 1.1, (2.3, 2.3, 2.3)),
        (1.0, 1.02, (2.3, 2.3, 1.7)),
        (None, 1.0, (1.3, 2.3, 1.7)),
    ],
)
def test_a_net_is_of_parts_that_hang_together_and_that_the_robot_was_tried_in(low, high, nets):
    """Whatever the size it is made in, by the bore over its own."""
    found = rows(passport(low, high))
    assert [found[bore].net_m for bore in BORES] == pytest.approx(nets)


def test_a_robot_that_misfits_gets_nowhere():
    """It is asked about bores over its scale."""
    asked: set[float] = set()

    def misfit(bore: float) -> str:
        asked.add(round(bore / 0.16, 6))
        return "too wide" if bore > 0.1601 else ""

    found = rows(passport(0.9, 1.1, misfit))
    assert found[0.160].net_m == pytest.approx(0.5)
    assert found[0.165].net_m == pytest.approx(sum(LENGTHS) + 2 * CONE)
    expected = {round(one / other, 6) for one in BORES for other in BORES}
    assert asked == expected


def test_without_straights_a_robot_was_tried_in_its_own_bore():
    assert tried_bores(passport(None, 1.0)) == (1.0, 1.0)
    assert tried_bores(passport(0.8, 1.2)) == (0.8, 1.2)
