"""Piping component files: the grammar, there and back, and files that are none."""

from __future__ import annotations

import json
import math
import random

import numpy as np
import pytest
from fuzzing.bases import PLANT
from fuzzing.damage import misprinted
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.errors import NetworkError, gathered
from omnitrack_sim.cli import app
from omnitrack_sim.pipes.importing.assumptions import true_bore
from omnitrack_sim.pipes.importing.isometric import build_plant, network_pcf
from omnitrack_sim.pipes.importing.pcf import read_pcf

MM = "UNITS-BORE MM\nUNITS-CO-ORDS MM\n"
IN_MM = "UNITS-BORE INCH\nUNITS-CO-ORDS MM\n"


def of(text: str, schedule: str = "") -> ot.Import:
    return build_plant("plant", *read_pcf(text, schedule))


def component(kind: str, *rows: str) -> str:
    return kind + "\n" + "".join(f"    {row}\n" for row in rows)


def pipe(a: str, b: str, bore: str = "100", kind: str = "PIPE", *more: str) -> str:
    return component(kind, f"END-POINT {a} {bore}", f"END-POINT {b} {bore}", *more)


def bend(centre: str, *more: str) -> str:
    """From (1000, 0) round a corner at (1150, 0) to (1150, 150), mm."""
    ends = "END-POINT 1000 0 0 100", "END-POINT 1150 150 0 100"
    return component("ELBOW", *ends, f"CENTRE-POINT {centre}", *more)


def only(imported: ot.Import, kind: str) -> ot.Fitting:
    (entry,) = (f for f in imported.network.fittings if f.kind == kind)
    return entry.fitting()


BEFORE, AFTER = pipe("0 0 0", "1000 0 0"), pipe("1150 150 0", "1150 900 0")
RUN = ("END-POINT 0 0 0 100", "END-POINT 300 0 0 100", "CENTRE-POINT 150 0 0")
CASES = {
    "corner": (MM + BEFORE + bend("1150 0 0") + AFTER, {"elbow": 1, "straight": 2}),
    "centre": (MM + BEFORE + bend("1000 150 0") + AFTER, {"elbow": 1, "straight": 2}),
    "hundredths": (MM + BEFORE + bend("1150 0 0", "ANGLE 9000"), {"elbow": 1, "straight": 1}),
    "degrees": (MM + BEFORE + bend("1150 0 0", "ANGLE 90.0"), {"elbow": 1, "straight": 1}),
    "mitre": (MM + bend("1150 0 0", "SKEY MIBW"), {"mitre": 1}),
    "inches": (IN_MM + pipe("0 0 0", "900 0 0", "4"), {"straight": 1}),
    "sixteenths": (
        "UNITS-BORE INCH-SIXTEENTH\nUNITS-CO-ORDS INCH-SIXTEENTH\n"
        + pipe("0 0 0", "1600 0 0", "64"),
        {"straight": 1},
    ),
    "feet": (
        "UNITS-BORE INCH\nUNITS-CO-ORDS FEET\n" + pipe("0 0 0", "9 0 0", "4"),
        {"straight": 1},
    ),
    "tee": (MM + component("TEE", *RUN, "BRANCH1-POINT 150 150 0 100"), {"tee": 1}),
    "reducing tee": (MM + component("TEE", *RUN, "BRANCH1-POINT 150 120 0 80"), {"wye": 1}),
    "skewed": (MM + component("TEE", *RUN, "BRANCH1-POINT 260 110 0 80"), {"wye": 1}),
    "skewed back": (MM + component("TEE", *RUN, "BRANCH1-POINT 40 110 0 80"), {"wye": 1}),
    "long run": (
        MM
        + component("TEE", RUN[0], "END-POINT 400 0 0 100", RUN[2], "BRANCH1-POINT 150 150 0 100"),
        {"tee": 1, "straight": 1},
    ),
    "cross": (
        MM + component("CROSS", *RUN, "BRANCH1-POINT 150 150 0 80", "BRANCH2-POINT 150 -150 0 80"),
        {"cross": 1},
    ),
    "reducer": (
        MM + component("REDUCER-CONCENTRIC", "END-POINT 0 0 0 100", "END-POINT 102 0 0 80"),
        {"reducer": 1},
    ),
    "olet": (
        MM + BEFORE + component("WELDOLET", "CENTRE-POINT 500 0 0", "BRANCH1-POINT 500 0 95 50"),
        {"straight": 2, "wye": 1},
    ),
    "small olet": (
        MM + BEFORE + component("WELDOLET", "CENTRE-POINT 500 0 0", "BRANCH1-POINT 500 0 95 25"),
        {"straight": 1},
    ),
    "valve": (
        MM
        + BEFORE
        + pipe("1000 0 0", "1060 0 0", "100", "FLANGE")
        + pipe("1060 0 0", "1062 0 0", "100", "GASKET")
        + pipe("1062 0 0", "1300 0 0", "100", "VALVE", "SKEY VTFL"),
        {"straight": 4},
    ),
    "closed": (
        MM + BEFORE + pipe("1000 0 0", "1230 0 0", "100", "VALVE", "STATUS NORMALLY-CLOSED"),
        {"cap": 2, "straight": 1},
    ),
    "instrument": (MM + pipe("0 0 0", "300 0 0", "100", "INSTRUMENT"), {"straight": 1}),
    "blind": (MM + BEFORE + component("FLANGE-BLIND", "END-POINT 1000 0 0 100"), {"cap": 1}),
    "weld and support": (
        MM
        + BEFORE
        + pipe("1000 0 0", "1000 0 0", "100", "WELD")
        + component("SUPPORT", "CO-ORDS 500 0 0 100")
        + pipe("1000 0 0", "1400 0 0"),
        {"straight": 2},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_components_of_the_grammar(case):
    """Each becomes its fitting; written and read again it is the same network."""
    text, kinds = CASES[case]
    network = of(text).network
    found = [f.kind for f in network.fittings]
    assert {kind: found.count(kind) for kind in sorted(set(found))} == kinds
    same(network, of(network_pcf(network)).network)


def same(one: ot.Network, other: ot.Network) -> None:
    """Parts of the same names and sizes lie in the same places, joined alike."""
    theirs = {part.name: part for part in other.pipes.parts}
    assert [part.name for part in one.pipes.parts] == list(theirs)
    for mine in one.pipes.parts:
        part = theirs[mine.name]
        assert type(part.fitting) is type(mine.fitting)
        assert part.fitting.sizes == pytest.approx(mine.fitting.sizes, abs=1e-9)
        for port in mine.fitting.port_names:
            a, b = mine.port(port), part.port(port)
            assert np.allclose(a.position, b.position, atol=1e-8)
            assert np.allclose(a.rotation[:, 2], b.rotation[:, 2], atol=1e-8)
    assert {frozenset(j.ports) for j in one.joints} == {frozenset(j.ports) for j in other.joints}


@pytest.mark.parametrize("name", ["fig14", "house_sewer", "tower", "annex", "ring", "narrow"])
def test_a_network_there_and_back(name):
    """Shipped networks, rings among them, are the same after a piping component file."""
    network = ot.load_network(name)
    same(network, of(network_pcf(network)).network)


def test_a_centre_point_is_the_corner_or_the_arcs_centre():
    """What a neighbour's direction decides; alone, at another angle than 90 degrees, the ANGLE."""
    for case in ("corner", "centre"):
        elbow = only(of(CASES[case][0]), "elbow")
        assert (elbow.mean_radius, elbow.angle) == pytest.approx((0.15, math.pi / 2))
    radius, turn = 300.0, math.radians(60)
    end = f"END-POINT {radius * math.sin(turn)} {radius * (1 - math.cos(turn))} 0 100"
    for centre, kind in (
        (f"0 {radius} 0", "arc"),
        (f"{radius * math.tan(turn / 2)} 0 0", "corner"),
    ):
        rows = "END-POINT 0 0 0 100", end, f"CENTRE-POINT {centre}", "ANGLE 6000"
        elbow = only(of(MM + component("BEND", *rows)), "elbow")
        assert (elbow.mean_radius, elbow.angle) == pytest.approx((0.3, turn)), kind


def test_nominal_bores_become_true_ones():
    """By inches or millimetres and the schedule; what is no nominal size stays."""
    assert true_bore(4 * 0.0254, "40") == pytest.approx(0.10226)
    assert true_bore(0.1, "80") == pytest.approx(0.09718)
    assert true_bore(0.16, "40") == true_bore(0.16, "none") == 0.16
    assert only(of(CASES["inches"][0]), "straight").inner_diameter == pytest.approx(0.10226)
    assert only(of(CASES["inches"][0], "none"), "straight").inner_diameter == pytest.approx(0.1016)
    skewed = only(of(CASES["skewed"][0], "none"), "wye")
    assert skewed.angle == pytest.approx(math.pi / 4)


@pytest.mark.parametrize(
    ("text", "where", "told"),
    [
        ("PIPE\n", "file", "has no UNITS-BORE"),
        ("UNITS-BORE CM\nUNITS-CO-ORDS MM\n" + BEFORE, "line 1", "choose from"),
        (MM, "file", "no components"),
        (MM + pipe("0 0", "x"), "line 4", "three coordinates and a bore"),
        (MM + component("PIPE", "END-POINT 0 0 0 100"), "line 3", "needs two"),
        (MM + pipe("0 0 0", "1e9 0 0"), "line 5", "farther than"),
        (MM + bend("1150 90 0"), "line 3", "different distances"),
        (MM + component("ELBOW", "END-POINT 0 0 0 9", "END-POINT 9 0 0 9"), "", ""),
        (
            MM + component("OLET", "CENTRE-POINT 500 0 0", "BRANCH1-POINT 500 0 95 50"),
            "line 3",
            "no pipe",
        ),
        (MM + component("TEE", *RUN, "BRANCH1-POINT 150 20 0 100"), "line 3", "must be at least"),
        (MM + BEFORE + BEFORE, "line 6", ""),
        (MM + BEFORE + pipe("1000 0 0", "1500 0 0", "80"), "line 6", "reducer"),
        (MM + BEFORE + pipe("500 -400 0", "500 400 0"), "line 6", "runs into"),
    ],
)
def test_a_fault_has_its_line(text, where, told):
    """What is no isometric, and what cannot be built of one, is told with the line."""
    if not where:
        assert of(text).network  # an elbow in a line is a pipe
        return
    with pytest.raises(NetworkError) as caught:
        of(text)
    assert where in {fault.where for fault in caught.value.faults}
    assert told in str(caught.value)


def test_damaged_files_are_read_or_refused_with_the_line():
    """Words and lines of a plant's file lost, doubled, moved and changed."""
    rng, faults = random.Random(7), []
    for _ in range(60):
        with gathered(faults):
            of(misprinted(rng, misprinted(rng, PLANT)))
    assert {fault.where.partition(" ")[0] for fault in faults} == {"line", "file"}


def test_a_file_that_cannot_be_read_is_told_of(tmp_path):
    """What opens and fails to be read, and a name that cannot be looked at."""
    (tmp_path / "odd.pcf").symlink_to("/proc/self/mem")
    for path in (tmp_path / "odd.pcf", "n" * 300 + ".pcf"):
        with pytest.raises(NetworkError, match=r"cannot be read|no such file"):
            ot.import_network(path)


def test_commands_read_and_write_isometrics_and_geojson(tmp_path):
    """`import` reads a file; `network --out` writes one, and centrelines, by the ending."""
    line, back = tmp_path / "line.pcf", tmp_path / "line.geojson"
    run = CliRunner().invoke(app, ["network", "fig14", "--out", str(line)])
    assert run.exit_code == 0, run.output
    run = CliRunner().invoke(app, ["import", str(line), "--json"])
    assert json.loads(run.output)["fittings"] == len(ot.load_network("fig14").fittings)
    run = CliRunner().invoke(app, ["network", "fig14", "--out", str(back)])
    features = json.loads(back.read_text())["features"]
    elbow = next(f for f in features if f["properties"]["kind"] == "elbow")
    points = np.array(elbow["geometry"]["coordinates"])
    assert len(points) >= 19
    assert elbow["properties"]["bore_m"] == [0.16, 0.16]
