"""Old pipes: relief and couplings are drawn by rates, and the network beneath stays as it was."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterator

import numpy as np
import pytest
from commands import omnitrack
from scipy import stats

import omnitrack_sim as ot
from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.pipes.condition import JOINTS, RELIEF, Condition, in_condition, load_condition
from omnitrack_sim.pipes.network import validate

BORE = 0.16
LENGTH, SEEDS = 20.0, 40
"""Of a straight, m; and how many are drawn for a rate: 800 m."""


def _table(*defects: dict) -> Condition:
    return Condition.model_validate(
        {"name": "mine", "defects": tuple({"source": "assumed", **one} for one in defects)}
    )


def _straight(length: float = LENGTH, axis=(1.0, 0.0, 0.0)) -> ot.Network:
    return ot.Network(
        place={"axis": axis},
        fittings=[{"kind": "straight", "name": "main", "length": length, "pipe": "P-1"}],
        ports={"near": "main.start", "far": "main.end"},
    )


def _found(network: ot.Network) -> Iterator[tuple[str, float, float]]:
    """Kind, size in bores, and place along the pipe, m, of each defect of a straight."""
    at = 0.0
    fittings = [part.fitting for part in network.pipes.parts]
    for before, fitting in zip([None, *fittings], fittings, strict=False):
        if fitting.kind == "coupling":
            if fitting.gap:
                yield "gap", fitting.gap / BORE, at
            elif fitting.end_diameter < fitting.inner_diameter:
                yield "step", (fitting.inner_diameter - fitting.end_diameter) / 2 / BORE, at
            elif fitting.offset and before.inner_diameter == BORE:
                yield "offset", fitting.offset / BORE, at
        for one in getattr(fitting, "relief", ()):
            size = one.ratio if one.kind == "ovality" else None
            size = size or (one.height if one.kind == "weld" else one.depth) / BORE
            yield one.kind, size, at + one.at
        at += fitting.length


@pytest.mark.parametrize("kind", [*JOINTS, *(kind for kind in RELIEF if kind != "corrosion")])
def test_rates_sizes_and_places_are_those_of_the_table(kind):
    """The number is Poisson's within four of its deviations, sizes and places uniform.

    A displaced pipe has two couplings, of which the first and the way back are as large.
    """
    rate, low, high = 40.0, 0.02, 0.06
    condition = _table({"kind": kind, "per_km": rate, "size": (low, high)})
    found = [
        one for seed in range(SEEDS) for one in _found(in_condition(_straight(), condition, seed))
    ]
    assert {one[0] for one in found} == {kind}
    expected = rate * LENGTH * SEEDS / 1000
    count = len(found) / (2 if kind == "offset" else 1)
    assert abs(count - expected) < 4 * math.sqrt(expected)
    sizes = [size for _, size, _ in found]
    assert stats.kstest(sizes, stats.uniform(low, high - low).cdf).pvalue > 1e-3
    places = [at for _, _, at in found]
    assert stats.kstest(places, stats.uniform(0, LENGTH).cdf).pvalue > 1e-3


def test_numbers_scatter_as_poissons_do():
    """Variance over mean of the counts of single pipes is 1 within four of its deviations."""
    condition = _table({"kind": "weld", "per_km": 200.0, "size": (0.02, 0.02)})
    counts = [
        len([*_found(in_condition(_straight(), condition, seed))]) for seed in range(2 * SEEDS)
    ]
    dispersion = np.var(counts, ddof=1) / np.mean(counts)
    assert abs(dispersion - 1) < 4 * math.sqrt(2 / len(counts))


@pytest.mark.parametrize("condition", ["good", "fair", "poor"])
def test_the_network_beneath_stays(condition):
    """The same seed gives the same ideal network, with its ends in place and its other fittings."""
    for seed in range(6):
        ideal, old = ot.random_network(seed), ot.random_network(seed, condition=condition)
        others = [part for part in ideal.fittings if part.kind != "straight"]
        kinds = ("straight", "coupling")
        assert [part for part in old.fittings if part.kind not in kinds] == others
        assert {part.name for part in ideal.fittings} <= {part.name for part in old.fittings}
        for end, worn in zip(ideal.open_ends, old.open_ends, strict=True):
            ports = [
                net.pipes.parts[i].port(p)
                for net in (ideal, old)
                for i, p in [net.end("", worn if net is old else end)]
            ]
            assert np.abs(ports[0].position - ports[1].position).max() < 1e-6
            assert np.abs(ports[0].rotation - ports[1].rotation).max() < 1e-6


def test_the_same_seed_gives_the_same_bytes_and_survives_a_file():
    for seed in range(4):
        old = ot.random_network(seed, condition="poor")
        assert old.to_toml() == ot.random_network(seed, condition="poor").to_toml()
        assert validate(tomllib.loads(old.to_toml())) == old
    assert old != ot.random_network(seed)
    assert in_condition(_straight(), "poor", 1) != in_condition(_straight(), "poor", 2)


def test_worse_conditions_have_more_of_everything():
    """And each rate of a shipped table says where it comes from, or that it is assumed."""
    rates = []
    for name in ("good", "fair", "poor"):
        condition = load_condition(name)
        assert condition.words
        for defect in condition.defects:
            assert any(word in defect.source for word in ("assumed", "TRL", "as of"))
        rates.append({one.kind: (one.per_km, one.size[1]) for one in condition.defects})
    for better, worse in itertools.pairwise(rates):
        assert {*better} <= {*worse}
        for kind, (rate, size) in better.items():
            assert worse[kind][0] >= rate
            assert worse[kind][1] >= size
    assert sum(rate for rate, _ in rates[-1].values()) == 1000.0


def test_a_displaced_pipe_lies_aside_by_its_size_and_comes_back():
    """Whatever the direction: the axis between both joints is that far from the others'."""
    condition = _table({"kind": "offset", "per_km": 100.0, "size": (0.05, 0.05)})
    parts = in_condition(_straight(), condition, 5).pipes.parts
    axis = [np.hypot(*part.port("start").position[1:]) for part in parts]
    kinds = [part.fitting.kind for part in parts]
    aside = [i for i, kind in enumerate(kinds) if kind == "straight" and i % 4 == 2]
    assert aside
    assert [axis[i] for i in aside] == pytest.approx([0.05 * BORE] * len(aside))
    level = [axis[i] for i, kind in enumerate(kinds) if kind == "straight" and i % 4 == 0]
    assert level == pytest.approx([0.0] * len(level), abs=1e-9)


def test_new_parts_are_named_after_their_pipe():
    """The first keeps the name and both ends theirs; all belong to the same imported pipe."""
    network = in_condition(_straight(), "poor", 3)
    names = [part.name for part in network.fittings]
    assert names[:3] == ["main", "main:2", "main:3"]
    assert {part.pipe for part in network.fittings} == {"P-1"}
    assert network.ports == {"near": "main.start", "far": f"{names[-1]}.end"}
    assert network.open_ends == ("main.start", f"{names[-1]}.end")


def test_nothing_settles_in_a_steep_pipe():
    condition = _table({"kind": "deposit", "per_km": 500.0, "size": (0.1, 0.1), "length": (3, 4)})
    assert not [*_found(in_condition(_straight(axis=(0.0, 0.0, 1.0)), condition, 0))]
    level = [*_found(in_condition(_straight(), condition, 0))]
    assert len(level) > 3


@pytest.mark.parametrize("condition", ["good", "fair", "poor"])
def test_narrow_pipes_take_every_condition(condition):
    """Of 20 mm, in which sizes by bores are less than relief may be."""
    row = {"kind": "straight", "name": "main", "length": 400.0, "inner_diameter": 0.02}
    old = in_condition(ot.Network(fittings=[row]), condition, 1)
    relief = {e.kind for p in old.pipes.parts for e in getattr(p.fitting, "relief", ())}
    assert {"weld", "ovality"} <= relief


def test_a_pipe_is_rough_once_all_over():
    """By Poisson's chance of one or more, each pipe with waves of its own."""
    rough = _table({"kind": "corrosion", "per_km": 200.0, "size": (0.006, 0.008)})
    pipes = [in_condition(_straight(5.0), rough, seed).fittings[0] for seed in range(2 * SEEDS)]
    found = [pipe.relief for pipe in pipes if pipe.relief]
    assert {len(relief) for relief in found} == {1}
    chance, count = 1 - math.exp(-1.0), 2 * SEEDS
    assert abs(len(found) - chance * count) < 4 * math.sqrt(count * chance * (1 - chance))
    assert len({relief[0].seed for relief in found}) == len(found)
    assert all(0.006 <= relief[0].roughness / BORE <= 0.008 for relief in found)


def test_elbows_get_what_the_table_draws_into_them():
    """By their own length, and beds never; without ``elbows`` they stay as they are."""
    row = {"kind": "elbow", "name": "bend", "mean_radius": 0.4}
    network, length = ot.Network(fittings=[row]), 0.4 * math.pi / 2
    bead = {"kind": "weld", "per_km": 2000.0, "size": (0.01, 0.02)}
    bed = bead | {"kind": "deposit", "length": (1.0, 2.0), "elbows": True}
    assert in_condition(network, _table(bead), 0) == network
    both = _table(bead | {"elbows": True}, bed)
    beads = [in_condition(network, both, seed).fittings[0].relief for seed in range(SEEDS)]
    assert {one.kind for relief in beads for one in relief} == {"weld"}
    expected = 2.0 * length * SEEDS
    assert abs(sum(map(len, beads)) - expected) < 4 * math.sqrt(expected)


def test_what_does_not_fit_is_left_out_of_short_pipes():
    """Beds are shortened; joints and what its ends do not hold are left out."""
    short = in_condition(
        _straight(0.3), _table({"kind": "offset", "per_km": 1e4, "size": (0.02, 0.02)}), 0
    )
    assert len(short.fittings) == 1
    bed = {"kind": "deposit", "per_km": 1e4, "size": (0.02, 0.02), "length": (10.0, 20.0)}
    (part,) = in_condition(_straight(0.3), _table(bed), 0).fittings
    assert all(one.length <= 0.3 for one in part.relief)
    deep = bed | {"size": (0.5, 0.5)}
    (part,) = in_condition(_straight(0.3), _table(deep), 0).fittings
    assert not part.relief


def test_pipes_that_have_a_section_or_relief_stay_as_they_are():
    egg = {"kind": "straight", "name": "a", "length": 5.0, "section": "egg"}
    bead = {"kind": "straight", "name": "b", "length": 5.0, "relief": [{"kind": "weld", "at": 1.0}]}
    for row in (egg, bead):
        network = ot.Network(fittings=[row])
        assert in_condition(network, "poor", 0) == network


OWN = """words = "mine"
[[defects]]
kind = "dent"
per_km = 1000.0
size = [0.05, 0.05]
source = "counted in our street"
"""


def test_a_table_of_a_user_takes_the_place_of_ours(tmp_path):
    (tmp_path / "street.toml").write_text(OWN)
    network = ot.random_network(3, 12, condition=tmp_path / "street.toml")
    kinds = {
        one.kind for part in network.pipes.parts for one in getattr(part.fitting, "relief", ())
    }
    assert kinds == {"dent"}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"dent"', '"dint"', r"defects\.0\.kind"),
        ("per_km = 1000.0", "per_km = -1.0", r"defects\.0\.per_km"),
        ("[0.05, 0.05]", "[0.06, 0.05]", "must have the lower one first"),
        ("[0.05, 0.05]", "[0.05, 0.9]", r"must be up to 0\.5 bores"),
        ('source = "counted in our street"', "", r"defects\.0\.source"),
    ],
)
def test_faults_of_a_table_are_told(tmp_path, old, new, told):
    (tmp_path / "street.toml").write_text(OWN.replace(old, new))
    with pytest.raises(NetworkError, match=told):
        load_condition(tmp_path / "street.toml")


def test_a_condition_that_is_not_there_is_refused():
    with pytest.raises(NetworkError, match="did you mean 'poor'"):
        ot.random_network(1, condition="poorr")
    with pytest.raises(NetworkError, match="give lower rates"):
        in_condition(
            _straight(900.0), _table({"kind": "gap", "per_km": 1e5, "size": (0.01, 0.01)}), 0
        )


PLANT = """ISOGEN-FILES ISOGEN.FLS
UNITS-BORE MM
UNITS-CO-ORDS MM
PIPE
    END-POINT 0.0 0.0 0.0 150
    END-POINT 60000.0 0.0 0.0 150
"""


def test_an_import_says_what_was_drawn(tmp_path, capsys):
    """By the command and in Python alike; without a condition nothing is drawn."""
    (tmp_path / "line.pcf").write_text(PLANT)
    ideal = ot.import_network(tmp_path / "line.pcf")
    old = ot.import_network(tmp_path / "line.pcf", condition="poor", seed=4)
    assert len(ideal.network.fittings) == 1 < len(old.network.fittings)
    assert old.notes[:-1] == ideal.notes
    assert old.notes[-1].where == "condition poor"
    assert "seed 4" in old.notes[-1].problem
    out = tmp_path / "line.toml"
    line = f"import {tmp_path / 'line.pcf'} --condition poor --seed 4 --out {out}"
    assert omnitrack(*line.split()).returncode == 0
    assert ot.load_network(out) == old.network
