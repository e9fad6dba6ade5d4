"""Laws of maps of reach: two pipes worked out by hand, and twenty by drawing runs at random."""

import html
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.pipes import Passage
from omnitrack_sim.towns import reach_files
from omnitrack_sim.towns.features import FEATURES, kind_of, relief_of, shape_of, slopes_of
from omnitrack_sim.towns.passage_model import Estimate
from omnitrack_sim.towns.reach_files import _page, summary_of

ROBOT = ot.load_scenario("robots/presser_elbow").robot
WEIGHT = ROBOT.mass * 9.81
TEMPLATE = Path(reach_files.__file__).with_name("reach_map.html").read_text("utf-8")
OPEN = ("A.start", "B.end")


@dataclass(frozen=True, eq=False)
class Stated(ot.Passport):
    """A passport whose estimates are stated by a function of the kind and the named features.

    The function returns any fields of ``Estimate``; what it leaves out is 0.
    """

    law: Callable[..., dict] = dict

    def estimate(self, kind, points, lengths=None):
        columns = np.asarray(points, float).T
        stated = self.law(kind, **dict(zip(FEATURES, columns, strict=True)))
        values = dict.fromkeys(Estimate._fields, 0.0) | stated
        return Estimate(**{name: value + 0.0 * columns[0] for name, value in values.items()})


def slope(kind, friction, pull, climb, lift, **_):
    """Chances and costs that depend on where a passage leads up."""
    if kind == "straight":
        return {
            "probability": 0.9 - 0.1 * climb,
            "logit_std": 0.5,
            "seconds": 10 + 5 * climb,
            "joules": 20 + 10 * climb,
            "seconds_std": 0.6,
            "joules_std": 3.6,
            "seconds_error": 0.3,
        }
    return {
        "probability": 0.7 - 0.1 * lift,
        "logit_std": 0.4,
        "seconds": 3 + lift,
        "joules": 6 + 2 * lift,
        "seconds_std": 0.8 - 0.2 * lift,
        "joules_std": 4.8 - 1.2 * lift,
        "seconds_error": 1.2,
    }


def two_pipes(names="AeB"):
    """2 m straight up, an elbow, and 3 m on the level."""
    a, e, b = names
    sizes = ({"length": 2.0}, {"mean_radius": 0.24}, {"length": 3.0})
    kinds = ("straight", "elbow", "straight")
    return ot.Network(
        fittings=[
            {"name": name, "kind": kind, **size}
            for name, kind, size in zip(names, kinds, sizes, strict=True)
        ],
        joints=[{"ports": (f"{a}.end", f"{e}.start")}, {"ports": (f"{e}.end", f"{b}.start")}],
        place={"axis": (0, 0, 1), "position": (0, 0, 0)},
    )


def mapped(law=slope, openings=("A.start",), count=None, **how):
    """The map of two pipes, its parts by name."""
    how = {"friction": (0.8, 0.8), "openings": count} | how
    reach = ot.map_reach(two_pipes(), Stated(ROBOT, {}, {}, law=law), openings, **how)
    return reach, {part.name: part for part in reach.parts}


def test_the_way_back_has_its_own_chances():
    """Up 0.8, round the bend 0.7, on the level 0.9; back on the level 0.9, down round the bend 0.8
    and down 1.0: of the straights of either way the worst one counts."""
    _, made = mapped()
    assert made["A"].probability == pytest.approx(0.8)
    assert made["A"].back == pytest.approx(0.8 * 1.0)
    assert made["e"].probability == pytest.approx(0.8 * 0.7)
    assert made["e"].back == pytest.approx(0.56 * 1.0 * 0.8)
    assert made["B"].probability == pytest.approx(0.56)
    assert made["B"].back == pytest.approx(0.56 * 0.9 * 0.8)
    turned = {part.name: part for part in mapped(openings=["B.end"])[0].parts}
    assert turned["A"].probability == pytest.approx(0.9 * 0.8)
    assert turned["A"].back == pytest.approx(0.72 * 0.8 * 0.7)


def test_gravity_decides_which_way_is_up():
    """With gravity along the second pipe that one climbs, and of any strength by its slope."""
    for size in (9.81, 1.62):
        _, made = mapped(gravity=(-size, 0.0, 0.0))
        level, up = made["A"].probability, made["B"].probability
        assert level == pytest.approx(0.9)
        assert up == pytest.approx(0.8 * 0.6)
    _, made = mapped(gravity=(0.0, 0.0, 0.0))
    assert made["B"].probability == pytest.approx(0.9 * 0.7)


def test_chances_are_averaged_over_the_friction_of_a_whole_run():
    """Where each of two fittings passes with the probability mu, both do with the mean of mu²,
    which is not the square of the mean."""

    def grip(kind, friction, **_):
        return {"probability": friction if kind == "elbow" else np.sqrt(friction), "seconds": 1.0}

    _, made = mapped(grip, friction=(0.4, 1.0))
    mean = 2 / 5 * (1 - 0.4**2.5) / 0.6  # of mu^1.5
    assert made["B"].probability == pytest.approx(mean, rel=1e-3)
    assert made["B"].back == pytest.approx((1 - 0.4**4) / 4 / 0.6, rel=6e-3)


def test_times_deviations_and_errors_add_up_as_they_should():
    """Means add; deviations of passes, and the errors of kinds, add in squares, while the errors of
    two passes of a kind add as they are; a straight's variance grows with its length."""
    _, made = mapped()
    assert made["B"].seconds == pytest.approx(2 * 15 + 3 + 3 * 10)
    passes = 5 * 0.6**2 + 0.8**2
    assert made["B"].seconds_std == pytest.approx(math.sqrt(passes + (5 * 0.3) ** 2 + 1.2**2))
    assert made["A"].seconds_std == pytest.approx(math.sqrt(2 * 0.6**2 + 0.6**2))


def test_what_differs_with_friction_adds_to_the_deviation_of_the_time():
    """Weighted by how often the robot gets there: twice as often at the upper end as at zero
    friction would be, it is the variance of that distribution."""

    def law(kind, friction, **_):
        return {"probability": friction, "seconds": 100 * friction}

    _, made = mapped(law, friction=(0.4, 1.0))
    f = 0.4 + 0.1 * (np.arange(6) + 0.5)
    mean = 2 * (f @ f) / f.sum() * 100
    assert made["A"].seconds == pytest.approx(mean)
    assert made["A"].seconds_std ** 2 == pytest.approx(f @ (200 * f - mean) ** 2 / f.sum())


def test_intervals_add_alike_passes_and_independent_kinds():
    """The logarithm's deviation is (1 - p) times the logit's; straights share one, kinds add in
    squares, and the interval of 95 % is a factor up and down, at most 1."""
    _, made = mapped()
    deviation = 1.959964 * math.hypot(0.2 * 0.5, 0.3 * 0.4)
    assert made["B"].low == pytest.approx(0.56 * math.exp(-deviation))
    assert made["B"].high == pytest.approx(0.56 * math.exp(deviation))
    assert made["A"].low == pytest.approx(0.8 * math.exp(-1.959964 * 0.2 * 0.5))

    def unsure(kind, **_):
        return {"probability": 0.9, "logit_std": 5.0}

    assert mapped(unsure)[1]["B"].high == 1.0


def test_a_battery_that_is_just_enough_is_enough_half_of_the_time():
    """0.7 Wh there and 7/15 Wh back; one deviation more is enough for 84 %, and deviations of both
    ways, with a hundredth of either way's energy, add in squares."""
    supply = {"efficiency": 0.5, "base_power": 36.0}
    there, back = (126 / 0.5 + 36 * 63) / 3600, (84 / 0.5 + 36 * 42) / 3600
    assert (there, back) == pytest.approx((0.7, 7 / 15))
    # A joule of the motors is two of the battery: the deviations of one pass go together.
    one = (5 * (2 * 3.6 + 36 * 0.6) ** 2 + (2 * 4.8 + 36 * 0.8) ** 2) / 3600**2
    other = (5 * (2 * 3.6 + 36 * 0.6) ** 2 + (2 * 6.0 + 36 * 1.0) ** 2) / 3600**2
    std = math.sqrt(one + (0.01 * there) ** 2)
    both = math.sqrt(one + other + (0.01 * there) ** 2 + (0.01 * back) ** 2)
    for more, part in ((0.0, 0.5), (1.0, 0.841345), (-1.0, 0.158655), (8.0, 1.0)):
        _, made = mapped(supply=ot.Supply(there + more * std, **supply))
        assert made["B"].probability == pytest.approx(0.56 * part, rel=1e-5)
        _, made = mapped(supply=ot.Supply(there + back + more * both, **supply))
        assert made["B"].back == pytest.approx(0.4032 * part, rel=1e-5)
    assert made["B"].energy_wh == pytest.approx(there)
    assert made["B"].stopped_by == "elbow (e): 0.70"
    _, made = mapped(supply=ot.Supply(there - 9 * std, **supply))
    assert made["B"].stopped_by == "battery: 1.17 Wh there and back, too little there"
    _, made = mapped(supply=ot.Supply(there + back - 9 * both, **supply))
    assert made["B"].stopped_by == "battery: 1.17 Wh there and back, too little back"
    assert made["B"].probability == pytest.approx(0.56)


def test_a_tether_reaches_as_far_as_it_is_long():
    """A line of exactly the way's length gets to its end, one that is a micrometre shorter does
    not."""
    way = 5.0 + 0.24 * math.pi / 2
    _, made = mapped(tether=ot.Tether(length=way + 1e-9))
    assert made["B"].tether_out_m == pytest.approx(way)
    _, made = mapped(tether=ot.Tether(length=way - 1e-6))
    assert made["e"].probability > 0
    assert made["B"].probability == 0
    assert made["B"].stopped_by.startswith("tether: ")
    assert math.isnan(mapped()[1]["B"].tether_n)


def test_the_pull_of_the_tether_is_that_at_the_end_of_each_way_and_there_alone():
    """At the top of 2 m it hangs with its weight; behind the bend the capstan's law multiplies the
    reel's tension. The chances there are those of that pull, and none pulls on the way back."""

    def law(kind, pull, **_):
        return {"probability": 1 - 0.1 * pull}

    line = {"friction": 0.3, "length": 99.0}
    _, made = mapped(law, tether=ot.Tether(weight=WEIGHT / 2, **line))
    assert made["A"].tether_n == pytest.approx(WEIGHT)
    assert made["A"].probability == pytest.approx(0.9)
    assert made["A"].back == pytest.approx(0.9)
    _, made = mapped(law, tether=ot.Tether(weight=0.0, tension=2 * WEIGHT, **line))
    pull = 2 * math.exp(0.3 * math.pi / 2)
    assert made["e"].tether_n == pytest.approx(pull * WEIGHT, rel=1e-6)
    low, high = (math.log(1 - 0.1 * k) for k in (3, 4))  # tables stand at whole weights
    elbow = math.exp(low + (pull - 3) * (high - low))
    assert made["e"].probability == pytest.approx(0.8 * elbow, rel=1e-5)
    assert made["e"].stopped_by == f"elbow (e): {elbow:.2f}, tether pulls {pull * WEIGHT:.0f} N"
    # The second straight is pulled at more than the first.
    assert made["B"].probability == pytest.approx(elbow**2, rel=1e-5)
    assert made["B"].back == pytest.approx(elbow**2, rel=1e-5)


def test_no_pull_is_taken_that_was_not_tried():
    """Six robot weights are, more are not; a pull of which the passport knows nothing stops it by
    name."""
    line = {"friction": 0.0, "length": 99.0}

    def unknown(kind, pull, **_):
        return {"probability": np.where(pull < 3.5, 0.9, np.nan)}

    for weights, reached in ((5.999, True), (6.001, False)):
        _, made = mapped(tether=ot.Tether(weight=0.0, tension=weights * WEIGHT, **line))
        assert (made["A"].probability > 0) == reached
    assert made["A"].stopped_by == f"tether: pulls {6.001 * WEIGHT:.0f} N in A, more than was tried"
    for weights, reached in ((3.0, True), (3.1, False)):
        _, made = mapped(unknown, tether=ot.Tether(weight=0.0, tension=weights * WEIGHT, **line))
        assert (made["A"].probability > 0) == reached
    assert made["A"].stopped_by == f"unknown: straight at a pull of {3.1 * WEIGHT:.0f} N (A)"


def test_a_friction_that_nobody_tried_counts_as_no_pass():
    """Where the passport knows the upper half of the range alone, the rest adds nothing to the
    chances, to the times or to the battery's."""

    def law(kind, friction, **_):
        stated = slope(kind, friction, 0.0, 0.0, 0.0)
        return {name: np.where(friction > 0.7, value, np.nan) for name, value in stated.items()}

    whole = mapped(supply=ot.Supply(0.15))[1]["A"]
    _, made = mapped(law, friction=(0.4, 1.0), gravity=(0, 0, 0), supply=ot.Supply(0.15))
    level = mapped(gravity=(0, 0, 0), supply=ot.Supply(0.15))[1]["A"]
    assert whole != level
    assert made["A"].probability == pytest.approx(level.probability / 2)
    assert made["A"].back == pytest.approx(level.back / 2)
    for name in ("seconds", "seconds_std", "energy_wh"):
        assert getattr(made["A"], name) == pytest.approx(getattr(level, name)), name


def test_of_two_openings_each_part_has_the_surer_and_gains_are_of_ways_back():
    """From below B is reached with 0.56, from beside it with 0.9. The opening whose parts are
    returned from with the greater length comes first, and the other adds what it does better."""
    reach, made = mapped(openings=OPEN)
    assert made["A"].launch == "A.start"
    assert made["B"].launch == "B.end"
    assert made["A"].probability == pytest.approx(0.8)
    assert made["B"].probability == pytest.approx(0.9)
    arc = 0.24 * math.pi / 2
    # A, e and B from below; from beside them A is 0.9 * 0.8 there and 0.8 * 0.7 back.
    below = np.array([0.8, 0.8 * 0.7 * 0.8, 0.56 * 0.9 * 0.8])
    beside = np.array([0.72 * 0.8 * 0.7, 0.9 * 0.8 * 0.9 * 0.7, 0.9 * 0.9])
    lengths = np.array([2.0, arc, 3.0])
    assert reach.openings == ("B.end", "A.start")
    assert reach.gains == pytest.approx(
        (lengths @ beside, lengths @ np.maximum(below - beside, 0.0))
    )
    best = np.array([0.8, 0.9 * 0.8, 0.9])
    assert reach.expected_length == pytest.approx(lengths @ best)
    assert reach.length == pytest.approx(5.0 + arc)
    assert [edge[0] for edge in reach.paths["e"]] == [2, 1]
    one, _ = mapped(openings=OPEN, count=1)
    assert one.openings == ("B.end",)
    assert {part.launch for part in one.parts} == {"B.end"}
    # A fitting as an opening: the robot goes from it into what is joined to it.
    _, made = mapped(openings=["e"])
    assert made["A"].probability == pytest.approx(1.0)  # down
    assert made["B"].probability == pytest.approx(0.9)


def test_without_openings_all_open_ends_are_tried_or_up_to_24_of_them_evenly_spread():
    """Each takes a search through the whole network."""
    for fittings, step in ((20, 1), (110, 2)):
        network = ot.random_network(3, fittings)
        count = len(network.open_ends)
        assert 24 * (step - 1) < count <= 24 * step
        reach = ot.map_reach(network, Stated(ROBOT, {}, {}, law=slope))
        assert {*reach.openings} == {*network.open_ends[::step]}


def simple_ways(network, opening):
    """All ways from an opening that pass no part twice, by the part at their end, as edges."""
    parts, across, ways = network.pipes.parts, {}, {}
    for a, b in network.pipes.joints:
        across[a], across[b] = b, a

    def walk(port, path):
        part, enter = port
        for leave in set(parts[part].fitting.port_names) - {enter}:
            longer = [*path, (part, enter, leave)]
            ways.setdefault(part, []).append(longer)
            beyond = across.get((part, leave))
            if beyond is not None and beyond[0] not in {edge[0] for edge in longer}:
                walk(beyond, longer)

    walk(network.end("here", opening), [])
    return ways


class Runs:
    """Runs through a town, drawn one by one from what a passport states.

    Args:
        law: what it states.
        network: of the town.
        gravity: (3,) m/s².
        friction: its range.
        supply: of the robot.
    """

    COUNT = 20_000

    def __init__(self, law, network, gravity, friction, supply):
        self.law, self.network, self.gravity, self.supply = law, network, gravity, supply
        self.rng = np.random.default_rng(5)
        self.friction = self.rng.uniform(*friction, self.COUNT)

    def normal(self):
        """A standard normal number for each run."""
        return self.rng.normal(size=self.COUNT)

    def one_way(self, edges):
        """Which runs pass all edges; their time, s, work, J; and the time by which means err."""
        luck = self.rng.uniform(size=self.COUNT)  # of all straights
        passed, errors = np.ones(self.COUNT, bool), {}
        seconds, joules, late = np.zeros((3, self.COUNT))
        for edge in edges:
            passage = Passage.of(self.network.pipes, edge)
            kind, (climb, lift, _) = kind_of(passage), slopes_of(passage, self.gravity)
            bore = ROBOT.nominal_bore
            shape, relief = shape_of(passage, bore), relief_of(passage, bore)
            point = (self.friction, 0.0, climb, lift, *shape, *relief)
            stated = self.law(kind, **dict(zip(FEATURES, point, strict=True)))
            straight = kind == "straight"
            own = luck if straight else self.rng.uniform(size=self.COUNT)
            passed &= own < stated["probability"]
            amount, z = passage.length if straight else 1.0, self.normal()
            seconds += amount * stated["seconds"] + math.sqrt(amount) * z * stated["seconds_std"]
            joules += amount * stated["joules"] + math.sqrt(amount) * z * stated["joules_std"]
            late += amount * stated["seconds_error"] * errors.setdefault(kind, self.normal())
        return passed, seconds, joules, late

    def along(self, way):
        """Chances there, and back; mean and deviation of the time there; mean energy, Wh."""
        passed, seconds, joules, late = self.one_way(way)
        returned, *more, _ = self.one_way([(part, b, a) for part, a, b in reversed(way)])
        used = self.energy(seconds, joules)
        home = used + self.energy(*more) < self.supply.battery_wh
        there = passed & (used < self.supply.battery_wh)
        took = (seconds + late)[passed]
        back = (passed & returned & home).mean()
        energy = self.supply.energy(seconds, joules)[passed].mean()
        return there.mean(), back, took.mean(), took.std(), energy

    def energy(self, seconds, joules):
        """Wh used, of which the model errs by a hundredth."""
        return self.supply.energy(seconds, joules) * (1 + 0.01 * self.normal())


def lively(kind, friction, climb, lift, turn, **_):
    """Everything depends on something."""
    if kind == "straight":
        chance = 0.86 + 0.1 * friction - 0.05 * climb
        seconds, joules = 10 + 3 * climb - 2 * friction, 20 + 12 * climb
    else:
        chance = 0.75 + 0.25 * friction - 0.1 * lift - 0.0005 * turn
        seconds, joules = 6 + lift + 0.02 * turn, 15 + 8 * climb
    return {
        "probability": chance,
        "seconds": seconds,
        "joules": joules,
        "seconds_std": 0.2 * seconds,
        "joules_std": 2 * 0.2 * seconds,
        "seconds_error": 0.05 * seconds,
    }


@pytest.mark.parametrize("battery", [0.2, 0.4])
def test_in_a_town_of_twenty_parts_runs_drawn_at_random_say_the_same(battery):
    """Chances there and back, mean and deviation of the time and energy of each part are those of
    20,000 runs drawn from the passport; and of all ways to a part none is surer."""
    network = ot.random_network(1, 20, lengths=(0.5, 3.0))
    how = {"gravity": (4.0, -7.0, 5.0), "friction": (0.4, 1.0)}
    how["supply"] = ot.Supply(battery_wh=battery, efficiency=0.5, base_power=5.0)
    opening = network.open_ends[0]
    passport = Stated(ROBOT, {}, {}, law=lively)
    reach = ot.map_reach(network, passport, [opening], **how)
    free = ot.map_reach(network, passport, [opening], **how | {"supply": ot.Supply()})
    ways, runs = simple_ways(network, opening), Runs(lively, network, **how)
    noise = 2 / math.sqrt(runs.COUNT) + 0.002  # four deviations at most, and six frictions for all
    limited = []
    for i, part in enumerate(reach.parts):
        way = list(reach.paths[part.name])
        assert way in ways[i]
        there, back, seconds, std, energy = runs.along(way)
        assert part.probability == pytest.approx(there, abs=noise), part.name
        assert part.back == pytest.approx(back, abs=noise), part.name
        assert part.seconds == pytest.approx(seconds, rel=0.01), part.name
        assert part.seconds_std == pytest.approx(std, rel=0.05), part.name
        assert part.energy_wh == pytest.approx(energy, rel=0.01), part.name
        for other in ways[i]:
            assert runs.along(other)[0] < there + noise
        parts = part.probability / free.parts[i].probability, part.back / free.parts[i].back
        limited.append(any(0.02 < one < 0.95 for one in parts))
    assert sum(limited) >= 3  # by the battery, more or less


def test_progress_goes_from_nothing_to_one_and_says_at_what_it_is():
    """First over the estimates, then from opening to opening, never back."""
    told = []
    mapped(openings=OPEN, progress=lambda part, text: told.append((part, text)))
    parts = [part for part, _ in told]
    assert parts == sorted(parts)
    assert parts[0] == 0
    assert max(part for part, text in told if text == "estimates") == 0.5
    assert [text for _, text in told[-2:]] == ["from A.start", "from B.end"]
    assert parts[-2:] == [0.5, 0.75]


def test_progress_of_a_town_of_many_parts_stays_within_its_bounds():
    """However many parts are described first."""
    told = []
    chain = [{"kind": "straight", "name": f"p{k}", "length": 0.5} for k in range(230)]
    joints = [{"ports": (f"p{k}.end", f"p{k + 1}.start")} for k in range(229)]
    network = ot.Network(fittings=chain, joints=joints)
    ot.map_reach(
        network,
        Stated(ROBOT, {}, {}, law=slope),
        ["p0.start"],
        friction=(0.8, 0.8),
        progress=lambda part, text: told.append(part),
    )
    assert told == sorted(told)
    assert told[0] == 0.0
    assert 0.2 < told[2] <= 0.25  # 200 of 230 parts, half of the half that estimates take


def ladder(rungs):
    """Two rails of tees, whose neighbours' branches are joined by rungs: loops."""
    fittings, joints = [], []
    for rail in "ab":
        for k in range(rungs + 1):
            fittings.append({"name": f"{rail}{k}", "kind": "straight", "length": 0.5 + 0.1 * k})
            if k < rungs:
                fittings.append({"name": f"t{rail}{k}", "kind": "tee"})
                joints.append({"ports": (f"{rail}{k}.end", f"t{rail}{k}.run_start")})
                joints.append({"ports": (f"t{rail}{k}.run_end", f"{rail}{k + 1}.start")})
    for k in range(rungs):
        fittings.append({"name": f"r{k}", "kind": "straight", "length": 0.6})
        joints += [{"ports": (f"ta{k}.branch", f"r{k}.start")}]
        joints += [{"ports": (f"r{k}.end", f"tb{k}.branch")}]
    return ot.Network(fittings=fittings, joints=joints)


@pytest.mark.parametrize("run", [0.5, 0.97, 1.0])
def test_in_loops_the_surest_way_is_taken_and_of_ways_as_sure_the_shortest(run):
    """Of all ways that pass no part twice: round by the rungs, where the run of a tee is passed
    more seldom than two branches, and straight on where it is not."""

    def law(kind, **_):
        chance = {"straight": 0.99, "tee, over the run": run}.get(kind, 0.9 if run < 1 else 1.0)
        return {"probability": chance}

    network, passport = ladder(3), Stated(ROBOT, {}, {}, law=law)
    reach, parts = ot.map_reach(network, passport, ["a0.start"]), network.pipes.parts
    detours = 0
    for i, ways in simple_ways(network, "a0.start").items():
        passages = [[Passage.of(network.pipes, edge) for edge in way] for way in ways]
        chances = [
            0.99
            * math.prod(law(kind_of(p))["probability"] for p in way if kind_of(p) != "straight")
            for way in passages
        ]
        lengths = [sum(p.length for p in way) for way in passages]
        surest = max(chances)
        shortest = min(
            n for n, chance in zip(lengths, chances, strict=True) if chance > surest - 1e-9
        )
        assert reach.parts[i].probability == pytest.approx(surest), parts[i].name
        taken = ways.index(list(reach.paths[parts[i].name]))
        assert lengths[taken] == pytest.approx(shortest)
        detours += lengths[taken] > min(lengths) + 0.1
    assert (detours > 2) == (run == 0.5)


def test_a_page_runs_nothing_that_a_name_says():
    """Names of pipes, parts and openings stay text: the page has the two script tags of its own and
    no tag of theirs, and says each name as it is."""
    parts, pipes = (
        ("<!--<script>", "<b>$title&amp;", '"`;alert(1)'),
        ("</script><i/>", "", "</svg>"),
    )
    data = two_pipes(parts).model_dump(mode="json")
    for part, pipe in zip(data["fittings"], pipes, strict=True):
        part["pipe"] = pipe
    data["ports"] = {"<img>": f"{parts[0]}.start"}
    network = ot.Network.model_validate(data)
    page = _page(ot.map_reach(network, Stated(ROBOT, {}, {}, law=slope), ["<img>"]))
    assert len(re.findall("<[!/]*-*(?:script|b>|i/|/svg|img)", page)) == len(
        re.findall("<[!/]*-*(?:script|b>|i/|/svg|img)", TEMPLATE)
    )
    rows, heads = re.search(r"const rows = (.*), heads = (.*);", page).groups()
    said = json.loads(rows)
    assert [row[0] for row in said] == [pipes[0], parts[1], pipes[2]]
    assert {row[8] for row in said} == {"<img>"}
    assert [len(row) for row in said] == [len(json.loads(heads))] * 3
    about = page.partition('id="about"')[2].partition("</div>")[0]
    assert html.unescape(about).count("<img>") == 1


def test_the_page_and_the_summary_say_what_the_map_says():
    """A row has chances with their interval, the time with 1.96 deviations, energy and pull; the
    lengths lost are shared out by cause, and add up to what is not expected."""
    reach, made = mapped(tether=ot.Tether(tension=7.0, weight=0.0, friction=0.0))
    row, b = json.loads(re.search("const rows = (.*), heads", _page(reach))[1])[2], made["B"]
    assert row == [
        *("B", "straight", "3.00 m"),
        f"{b.probability:.3f} ({b.low:.3f} to {b.high:.3f})",
        f"{b.back:.3f}",
        f"63 s, give or take {1.96 * b.seconds_std:.0f} s",
        f"{b.energy_wh:.3g} Wh",
        "7.0 N, 5.4 m",
        "A.start",
        "elbow (e): 0.70",
    ]
    lengths = f"{reach.expected_length:.3g} m of {reach.length:.3g} m"
    assert f"{lengths} expected to be reached from A.start" in _page(reach)
    about = summary_of(reach)
    assert about["expected_m"] == pytest.approx(2 * 0.8 + 0.56 * (3 + 0.12 * math.pi))
    assert about["expected_there_and_back_m"] == pytest.approx(
        2 * 0.8 + 0.12 * math.pi * 0.56 * 0.8 + 3 * 0.56 * 0.72
    )
    assert about["openings"] == [
        {"opening": "A.start", "adds_m": pytest.approx(about["expected_there_and_back_m"])}
    ]
    lost = dict(about["stops"])
    assert lost == {
        "straight": pytest.approx(2 * 0.2),
        "elbow": pytest.approx(0.44 * (3 + 0.12 * math.pi)),
    }
    assert list(lost) == ["elbow", "straight"]

    def closed(kind, **_):
        return {"probability": np.nan if kind == "elbow" else 1.0}

    reach, made = mapped(closed)
    assert dict(summary_of(reach)["stops"])["unknown: no trials of elbow"] == pytest.approx(
        3 + 0.12 * math.pi
    )
    (_, _, row) = json.loads(re.search("const rows = (.*), heads", _page(reach))[1])
    assert row == ["B", "straight", "3.00 m", "no", *[""] * 5, "unknown: no trials of elbow (e)"]


def test_pictures_show_all_pipes_in_true_proportion_and_where_the_robot_goes_in():
    """From above, or of a town that is taller than wide the larger elevation; every pipe lies
    within, coloured by its chance, and an opening is marked where it is."""
    level, tall, aside = (0, 1, 0), (1, 0, 0), {"axis": (0, 1, 0), "turn_deg": 90}
    for place, columns in (({"axis": level}, "xy"), ({"axis": tall}, "xz"), (aside, "yz")):
        network = ot.Network.model_validate(
            two_pipes().model_dump(mode="json") | {"place": {"position": (7, 8, 9)} | place}
        )
        passport = Stated(ROBOT, {}, {}, law=slope)
        reach = ot.map_reach(network, passport, ["A.start", "e"], friction=(0.8, 0.8))
        (axes, *_) = ot.plot_reach(reach).axes
        assert (axes.get_xlabel(), axes.get_ylabel()) == tuple(f"{name} [m]" for name in columns)
        assert axes.get_aspect() == 1
        plane = ["xyz".index(name) for name in columns]
        lines = [line for part in network.pipes.parts for line in part.polylines()]
        points = np.concatenate(lines)[:, plane]
        low, high = points.min(axis=0), points.max(axis=0)
        limits = np.array([axes.get_xlim(), axes.get_ylim()])
        assert (limits[:, 0] < low - 0.05).all()
        assert (limits[:, 1] > high + 0.05).all()
        reached = axes.collections[-1]
        assert sorted(reached.get_array()) == sorted(part.probability for part in reach.parts)
        assert reached.get_clim() == (0, 1)
        pairs = zip(axes.texts, axes.lines, strict=True)
        marks = {text.get_text(): mark.get_xydata()[0] for text, mark in pairs}
        assert marks["A.start"] == pytest.approx(np.array([7.0, 8.0, 9.0])[plane])
        assert marks["e"] == pytest.approx(lines[1].mean(axis=0)[plane])
        left, top, width, height = map(float, re.search('viewBox="(.*?)"', _page(reach))[1].split())
        margin = 0.03 * (high - low).max()
        assert (left, left + width) == pytest.approx((low[0] - margin, high[0] + margin), abs=0.01)
        assert (-top - height, -top) == pytest.approx((low[1] - margin, high[1] + margin), abs=0.01)
        drawn = re.findall('data-i="(.)" points="(.*?)"', _page(reach))
        assert [int(row) for row, _ in drawn] == sorted(range(3), key=lambda i: reach.parts[i][3])
        for row, line in drawn:
            there = np.array([[float(x) for x in point.split(",")] for point in line.split()])
            assert there * [1, -1] == pytest.approx(lines[int(row)][:, plane], abs=1e-3)


def test_pictures_name_openings():
    """All at their marks, and up to six in the title; of more that has the number."""
    network = ot.random_network(3, 20)
    for count in (1, 6, 7):
        openings = network.open_ends[:count]
        reach = ot.map_reach(network, Stated(ROBOT, {}, {}, law=slope), openings)
        (axes, *_) = ot.plot_reach(reach).axes
        assert {text.get_text() for text in axes.texts} == {*reach.openings}
        assert len(axes.lines) == count
        told = ", ".join(reach.openings) if count < 7 else "7 openings"
        assert axes.get_title(loc="left").endswith(f" from {told}")


def test_lengths_of_towns_are_told_to_three_digits_without_powers_of_ten():
    """In kilometres from where metres would take a fourth digit."""
    lengths = {4.0: "4 m", 999.4: "999 m", 999.6: "1 km", 5000.0: "5 km", 52_349.0: "52.3 km"}
    assert {x: reach_files.length_text(x) for x in lengths} == lengths


def aged(kind, step, deposit, **_):
    """A robot that passes beds in 8 of 10, up to a depth, and steps in 1 of 2."""
    chance = 1 - 0.2 * (deposit > 0) - 0.5 * (step > 0)
    seconds = {"straight": 10.0, "straight, relief": 42.0, "coupling": 5.0}[kind]
    return {"probability": chance, "seconds": seconds, "joules": 2 * seconds}


def test_what_stops_a_robot_in_a_town_of_two_old_pipes():
    """By hand: 8 of 10 pass the bed and half the displaced joint behind it, so 4 of 10 get to the
    far pipe, and 16 of 100 back; it is the step that stops most."""
    bed = {"kind": "deposit", "at": 2.0, "length": 1.0, "depth": 0.016}
    network = ot.Network(
        place={"axis": (1.0, 0.0, 0.0)},
        fittings=[
            {"kind": "straight", "name": "silted", "length": 4.0, "relief": [bed]},
            {"kind": "coupling", "name": "joint", "offset": 0.004},
            {"kind": "straight", "name": "far", "length": 3.0},
        ],
        joints=[{"ports": ("silted.end", "joint.start")}, {"ports": ("joint.end", "far.start")}],
    )
    reach = ot.map_reach(network, Stated(ROBOT, {}, {}, law=aged), ["silted.start"])
    silted, joint, far = reach.parts
    assert [part.probability for part in reach.parts] == pytest.approx([0.8, 0.4, 0.4])
    assert [part.back for part in reach.parts] == pytest.approx([0.64, 0.16, 0.16])
    assert far.seconds == pytest.approx(42.0 + 5.0 + 30.0)
    assert silted.stopped_by == "deposit in straight (silted): 0.80"
    assert joint.stopped_by == far.stopped_by == "step in coupling (joint): 0.50"
    causes = dict(summary_of(reach)["stops"])
    assert causes["deposit in straight"] == pytest.approx(0.2 * 4.0)
    assert causes["step in coupling"] == pytest.approx(0.6 * (joint.length + 3.0))
