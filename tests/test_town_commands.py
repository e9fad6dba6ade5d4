"""The commands of towns: `omnitrack reach` and `omnitrack passport` say what the functions do."""

from __future__ import annotations

import json
import math

import pytest
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out
from omnitrack_sim.towns.passport import PASSPORT_FILE
from omnitrack_sim.towns.reach_files import length_text, summary_of

WIDE = {"COLUMNS": "200"}


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal on which no line is wrapped, whatever made the console before."""
    monkeypatch.setattr(out, "_width", 200)


def invoked(*arguments: str):
    return CliRunner().invoke(app, list(map(str, arguments)), env=WIDE)


@pytest.mark.parametrize(
    ("options", "made"),
    [
        ("", {}),
        (
            "--friction 0.4:0.8 --from low --from top --launches 1 "
            "--battery-wh 0.05 --efficiency 0.2 --base-w 1",
            {
                "friction": (0.4, 0.8),
                "launches": ["low", "top"],
                "openings": 1,
                "supply": ot.Supply(0.05, 0.2, 1.0),
            },
        ),
        (
            "--friction 0.5 --from top --tether-m 3 --tether friction=0.4 --tether weight=2",
            {
                "friction": (0.5, 0.5),
                "launches": ["top"],
                "tether": ot.Tether(length=3.0, friction=0.4, weight=2.0),
            },
        ),
    ],
)
def test_reach_prints_what_its_map_holds(options, made, tmp_path):
    """With each of its options; files beside it."""
    network = ot.load_network("fig14")
    launches = made.pop("launches", [])
    usual = {"friction": (0.6, 0.9), "supply": ot.Supply(math.inf, 0.3, 5.0), "tether": None}
    reach = ot.map_reach(network, ot.load_passport("omnitrack"), launches, **{**usual, **made})
    run = invoked("reach", "fig14", *options.split(), "--out", tmp_path / "map", "--json")
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout) == json.loads(json.dumps(summary_of(reach)))
    assert {path.name for path in (tmp_path / "map").iterdir()} >= {"reach.csv", "reach.html"}


def test_reach_prints_openings_stops_and_lengths(tmp_path):
    """In tables and a line, with the files that it wrote."""
    told = invoked("reach", "fig14", "--from", "low", "--from", "top", "--out", tmp_path).stdout
    passport, launches = ot.load_passport("omnitrack"), ["low", "top"]
    made = ot.map_reach(ot.load_network("fig14"), passport, launches, friction=(0.6, 0.9))
    summary = summary_of(made)
    for row in summary["openings"]:
        assert [row["opening"], *length_text(row["adds_m"]).split()] in map(
            str.split, told.splitlines()
        )
    for why, length in summary["stops"]:
        assert f"{why} " in told
        assert length_text(length) in told
    expected, whole = (length_text(summary[key]) for key in ("expected_m", "length_m"))
    assert f"{expected} of {whole} expected to be reached" in told
    assert "reach.html" in told


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--friction", "low"], "--friction: is 'low', not LOW:HIGH"),
        (["--tether", "weight=2"], "give its length, --tether-m"),
        (["--tether-m", "3", "--tether", "wieght=2"], "wieght"),
        (["--passport", "nobody"], "nobody"),
        (["--from", "nowhere"], "nowhere"),
    ],
)
def test_odd_options_of_reach_are_told(options, told, tmp_path, capfd):
    """Nothing is written."""
    with pytest.raises(ot.InputError) as caught:
        CliRunner().invoke(
            app,
            ["reach", "fig14", *options, "--out", str(tmp_path / "map")],
            catch_exceptions=False,
        )
    assert told in str(caught.value)
    assert not (tmp_path / "map").exists()


def test_a_passport_prints_its_ways_and_misfits(tmp_path):
    """A row for each kind of passage with Wilson's interval and what stopped the others; the file
    it wrote is that of its trials, and as JSON it is the summary."""
    options = ["presser", "--quick", "--trials", "2", "--course", "straight", "--out", tmp_path]
    run = invoked("passport", *options)
    assert run.exit_code == 0, run.output
    plan = ot.PassportPlan.of("presser", controller="", changes={}, trials=2, courses=["straight"])
    summary = ot.run_trials(plan).summary
    assert json.loads(invoked("passport", *options, "--json").stdout) == json.loads(
        json.dumps(summary)
    )
    rows = [line.split() for line in run.stdout.splitlines()]
    for row in summary["ways"]:
        low, high = (f"{100 * end:.0f}" for end in row["success_95"])
        begin = [row["kind"], str(row["passed"]), "of", str(row["trials"]), low, "to", high, "%"]
        (found,) = [line for line in rows if line[: len(begin)] == begin]
        assert ("-" in found) == (not row["stopped_by"])
    assert PASSPORT_FILE in run.stdout
    assert ot.load_passport(tmp_path / PASSPORT_FILE).robot == ot.load_passport(tmp_path).robot
