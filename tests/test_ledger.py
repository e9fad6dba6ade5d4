"""Published measurements beside simulated values: sources, ratios, and what is drawn.

Runs of the entries are made up; what is tested is what the entries measure on them.
"""

from __future__ import annotations

import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from documents import page
from typer.testing import CliRunner

from omnitrack_sim.cli import app
from omnitrack_sim.paper import measured
from omnitrack_sim.paper.claim import ClaimVerdict, Figure
from omnitrack_sim.paper.ledger import Publication, Read, drawn, of_draws, of_runs, published
from omnitrack_sim.paper.measured import ENTRIES
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.inchworm import Inchworm

SOURCE = Publication("Nobody, On nothing", "https://example.org/nothing", Read.ABSTRACT)
MIDDLES = pytest.mark.parametrize("middle", [3.0, 4.0, 5.0])


def entry(figure: Figure, **changes):
    """An entry of 4 N whose simulated figure is given."""

    @published(
        **{
            "publication": SOURCE,
            "robot": "nothing",
            "ours": "ball",
            "quote": "it pulls with 4 N",
            "stated": ("4 N",),
            "value": 4.0,
            "unit": "N",
            "statement": "pull",
            "how": "by lot",
            "why": "it slips",
            **changes,
        }
    )
    def made_up(quick: bool) -> Figure:
        return figure

    return made_up


@pytest.mark.parametrize("given", ENTRIES, ids=lambda given: given.id)
def test_each_figure_stands_in_the_words_of_a_source_with_an_address(given):
    """The number that is compared is the quoted one, but for its unit's power of ten."""
    source = given.publication
    assert re.fullmatch(r"https://\S+\.\S+/\S+", source.address)
    assert source.title
    assert given.unit
    assert given.how
    assert given.why, "a miss would have no reason"
    assert all(words in given.quote for words in given.stated)
    numbers = [float(n) for words in given.stated for n in re.findall(r"[\d.]+", words)]
    if len(numbers) == 2:
        assert given.value == pytest.approx(numbers[1] / numbers[0])
    elif numbers:
        power = math.log10(given.value / numbers[0])
        assert power == pytest.approx(round(power), abs=1e-9)
    else:
        assert given.stated == ("every single time",)
        assert (given.value, given.unit) == (100.0, "%")


def test_the_ledger_is_wide_enough_to_say_something():
    """Ten figures of six publications, six of which nothing was tuned on."""
    assert len({given.id for given in ENTRIES}) == len(ENTRIES) >= 10
    assert len({given.publication for given in ENTRIES}) >= 6
    assert sum(not given.tuned for given in ENTRIES) >= 6


@MIDDLES
@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_ratio_is_ours_over_theirs(middle, factor):
    """A figure twice as large has a ratio twice as large, interval and all."""
    figure = Figure(factor * middle, factor * (middle - 0.5), factor * (middle + 1), "by hand")
    ratio = entry(figure)(True).ratio
    expected = [factor * value / 4.0 for value in (middle, middle - 0.5, middle + 1)]
    assert ratio[:3] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("low", "high", "agrees"),
    [(3.0, 5.0, True), (4.0, 5.0, True), (4.1, 5.0, False), (3.0, 3.9, False)],
)
def test_it_agrees_where_the_interval_of_the_ratio_holds_one(low, high, agrees):
    """Then no reason is given; nothing is judged either way, and no verdict changes."""
    pair = entry(Figure((low + high) / 2, low, high, "by hand"))(True)
    assert pair.agrees is agrees
    assert pair.reason == ("" if agrees else "it slips")
    assert pair.verdict is ClaimVerdict.STUDY
    assert not pair.changed


def test_a_figure_reads_as_number_unit_and_interval():
    """To three digits, without exponents, and without a gap where there is no unit."""
    assert Figure(12345.0, 0.001234, 1e6, "").text("N") == "12300 N (0.00123 to 1000000)"
    assert Figure(0.5, 0.0, 1.0, "").text() == "0.5 (0 to 1)"


def test_figures_of_draws_are_their_median_and_95_percent():
    """They go along with the draws' scale and offset, whatever their order."""
    draws = np.random.default_rng(1).permutation(np.linspace(0.0, 100.0, 1001))
    assert of_draws(draws)[:3] == pytest.approx((50.0, 2.5, 97.5))
    assert of_draws(3 * draws + 1)[:3] == pytest.approx((151.0, 8.5, 293.5))
    assert of_draws([7.0])[:3] == (7.0, 7.0, 7.0)


@pytest.mark.parametrize("passed", [0, 3, 10])
def test_figures_of_runs_are_the_part_that_passes(passed):
    """In %, with Wilson's interval, which ends at 100 where all pass."""
    runs = [SimpleNamespace(success=k < passed) for k in range(10)]
    low, high = wilson_interval(passed, 10)
    assert of_runs(runs)[:3] == pytest.approx((10 * passed, 100 * low, 100 * high))


def test_draws_lie_in_their_ranges_and_the_quick_form_takes_the_first():
    """Of any number; they fill their ranges."""
    draws = drawn(200, friction=(0.6, 1.0), bore=(0.05, 0.12))
    assert drawn(3, friction=(0.6, 1.0), bore=(0.05, 0.12)) == draws[:3]
    for name, low, high in (("friction", 0.6, 1.0), ("bore", 0.05, 0.12)):
        values = np.array([draw[name] for draw in draws])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high


@pytest.fixture
def simulated(monkeypatch):
    """Return the figure of an entry whose runs are made of the changes that it asks for."""

    def figure(given, made) -> Figure:
        for name in ("runs_of", "alone"):
            monkeypatch.setattr(
                measured, name, lambda scenario, changes: [made(change) for change in changes]
            )
        for shared in (measured._inchworm_speeds, measured._inchworm_pulls):
            shared.cache_clear()
        try:
            return given(True, True).figure
        finally:
            for shared in (measured._inchworm_speeds, measured._inchworm_pulls):
                shared.cache_clear()

    return figure


def worm(change) -> Inchworm:
    """Our inchworm with the sizes of a change."""
    sizes = {key: value for key, value in change.items() if key.startswith("robot.")}
    return Inchworm(**{key.removeprefix("robot."): value for key, value in sizes.items()})


def test_speed_of_an_inchworm_is_that_of_whole_cycles(simulated):
    """A stride a cycle, though the run ends within one; the first cycle does not count."""
    speeds = []

    def run(change):
        robot, time = worm(change), np.linspace(0.0, 8.0, 4001)
        cycle = 2 * (robot.stretch_time + 2 * robot.switch_time)
        speeds.append(1e3 * robot.stride / cycle)
        # All of a stride in the middle of its cycle, and none in the first one.
        strides = np.maximum(np.floor(time / cycle + 0.5) - 1, 0.0)
        record = type("Record", (dict,), {"time": time})(distance=robot.stride * strides)
        return SimpleNamespace(scenario=SimpleNamespace(robot=robot), trajectory=record)

    figure = simulated(measured.inchworm_speed, run)
    assert figure[:3] == pytest.approx(of_draws(speeds)[:3], rel=1e-6)
    assert min(speeds) < max(speeds)


def test_traction_of_an_inchworm_is_compared_with_what_its_clamp_holds(simulated):
    """Half of 8 friction grip is a half, whatever friction and grip are."""

    def run(change):
        robot, friction = worm(change), change["world.friction"]
        pull = 4 * friction * robot.grip
        world = SimpleNamespace(friction=friction)
        scenario = SimpleNamespace(robot=robot, world=world)
        return SimpleNamespace(scenario=scenario, metrics={"pull_held_n": pull})

    figure = simulated(measured.inchworm_traction_of_hold, run)
    assert figure[:3] == pytest.approx((0.5, 0.5, 0.5))


def test_what_is_not_published_is_drawn(simulated):
    """Bores and frictions of PIRATE's pull, and gaps and rolls between its elbows, differ."""
    asked = []

    def run(change):
        asked.append(change)
        return SimpleNamespace(metrics={"pull_held_n": 7.0}, success=len(asked) % 2 == 0)

    pull = simulated(measured.pirate_pull, run)
    assert pull[:3] == (7.0, 7.0, 7.0)
    bores = {change["robot.bore"] for change in asked}
    assert bores == {change["pipes"][0]["inner_diameter"] for change in asked}
    assert len(bores) == len({change["world.friction"] for change in asked}) == len(asked)
    asked.clear()
    assert simulated(measured.double_elbows, run).middle == 50.0
    assert len({change["pipes"][2]["length"] for change in asked}) == len(asked)
    assert len({change["start.theta5_deg"] for change in asked}) == len(asked)


@pytest.mark.parametrize(("friction", "side"), [(0.3, 5.0), (0.6, 15.0), (1.0, 10.0)])
def test_a_cart_slides_where_its_weight_beats_its_friction(friction, side):
    """Wheels beside the lowest line press by 1 / cos of their angle: tan = friction / cos."""
    law = math.degrees(math.atan(friction / math.cos(math.radians(side))))
    assert measured.slide_angle(friction, side) == pytest.approx(law, abs=1.0)


def test_the_command_writes_the_figures_of_each_entry(tmp_path, monkeypatch):
    """Numbers in claims.json, the source's words on the page, the reason of a miss on the
    screen; exit status 0, as nothing is judged."""
    made = entry(Figure(6.0, 5.0, 8.0, "by hand"), tuned="the spring")
    monkeypatch.setattr("omnitrack_sim.paper.reproduce.ENTRIES", (made,))
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["reproduce", "measured", "--quick"])
    assert done.exit_code == 0, done.output
    assert "made_up: study. it slips" in done.output
    folder = tmp_path / "out" / "reproduce_measured"
    (row,) = json.loads((folder / "claims.json").read_text())["claims"]
    assert row["published"] == 4.0
    assert row["tuned"] == "the spring"
    assert row["simulated"] == {"value": 6.0, "low": 5.0, "high": 8.0}
    assert row["ratio"] == {"value": 1.5, "low": 1.25, "high": 2.0}
    assert row["agrees"] is False
    text = (folder / "report.html").read_text()
    for words in (made.quote, SOURCE.address, "the abstract alone", "tuned on it: the spring"):
        assert words in text


def test_the_page_has_the_source_and_the_words_of_each_entry():
    """And its published figure."""
    text = page("measured")
    for given in ENTRIES:
        assert f"]({given.publication.address})" in text, given.id
        assert f"“{given.quote}”" in text, given.id
        assert f"| {given.value:.3g} {given.unit} |" in text, given.id
