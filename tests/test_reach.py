"""Maps of reach: probabilities, costs and forces along the way, and what stops the robot."""

import json
import math
import re

import pyarrow.parquet as pq
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from town_samples import passport

import omnitrack_sim as ot
from omnitrack_sim.pipes import route_through
from omnitrack_sim.towns.reach_files import CAUSES, REACHED


def chain(*kinds, length=2.0, bore=0.16):
    """A level network of fittings in a row: s(traight), e(lbow), b(ranch of a tee), w(ye), n(arrow:
    a reducer)."""
    fittings, joints, last, turns = [], [], None, iter((90.0, *[180.0] * 20))
    for i, kind in enumerate(kinds):
        name = f"{kind}_{i}"
        table = {
            "s": {"kind": "straight", "length": length},
            "e": {"kind": "elbow", "mean_radius": 0.24},
            "b": {"kind": "tee"},
            "w": {"kind": "wye"},
            "n": {"kind": "reducer", "length": 0.2, "end_diameter": 0.155},
        }[kind]
        fittings.append({"name": name, "inner_diameter": bore, **table})
        enter, leave = ("run_start", "branch") if kind in "bw" else ("start", "end")
        if last is not None:
            joints.append(
                {
                    "ports": (last, f"{name}.{enter}"),
                    "turn_deg": 0.0 if kind == "s" else next(turns),
                }
            )
        last = f"{name}.{leave}"
    return ot.Network(
        name="chain",
        fittings=fittings,
        joints=joints,
        place={"axis": (1.0, 0.0, 0.0), "position": (0.0, 0.0, 0.0)},
    )


def by_name(reach):
    return {part.name: part for part in reach.parts}


def test_fittings_multiply_and_straights_pass_alike():
    """Behind two elbows and a tee's branch the probability is the product of theirs; the worst of
    the straights counts once."""
    rates = {"elbow": 0.9, "tee, run to branch": 0.8, "straight": 0.95}
    robot = passport(rates)
    reach = ot.map_reach(chain(*"sesebs"), robot, ["s_0.start"], friction=(0.8, 0.8))
    made = by_name(reach)
    straight, elbow, tee = (
        robot.estimate(kind, [0.8, 0, 0, 0, turn, sharpness, 1, 0, 0, 0, 0]).probability[0]
        for kind, turn, sharpness in (
            ("straight", 0, 0),
            ("elbow", 90, 2 / 3),
            ("tee, run to branch", 90, 0),
        )
    )
    assert made["s_0"].probability == pytest.approx(straight, rel=1e-9)
    assert made["s_2"].probability == pytest.approx(straight * elbow, rel=1e-9)
    assert made["s_5"].probability == pytest.approx(straight * elbow**2 * tee, rel=1e-9)
    for part in made.values():
        assert 0 < part.low <= part.probability <= part.high <= 1
        assert part.back <= part.probability
    assert made["s_5"].low < made["s_2"].low
    assert made["s_5"].stopped_by.startswith(f"tee, run to branch (b_4): {tee:.2f}")


def test_time_and_energy_add_up_along_the_way():
    """Metres over speed and each fitting's own seconds; Wh by the efficiency and the base power."""
    supply = ot.Supply(efficiency=0.5, base_power=10.0)
    made = ot.map_reach(chain(*"ses"), passport(speed=0.2), ["s_0.start"], supply=supply)
    end = by_name(made)["s_2"]
    # A fitting's own time is that of half a bore, and more of it is straight.
    more = 0.24 * math.pi / 2 - 0.08
    seconds = (2 * 2.0 + 1 + more) / 0.2
    assert end.seconds == pytest.approx(seconds, rel=0.01)
    joules = (2.0 + 2.0 + 1.0 + more) * 2.0
    assert end.energy_wh == pytest.approx((joules / 0.5 + 10 * seconds) / 3600, rel=0.01)
    assert 0.05 < end.seconds_std < 1.0


def test_the_tether_pulls_by_its_law_and_ends():
    """Its force at a part's end is that of the route there; behind its length nothing is reached,
    and a robot that holds little is kept by the force."""
    network, tether = chain(*"sesesese"), ot.Tether(weight=2.0, friction=0.4, length=7.5)
    reach = ot.map_reach(network, passport(), ["s_0.start"], tether=tether)
    made = by_name(reach)
    route = route_through(network.pipes, reach.paths["s_4"])
    tension = tether.tensions(route.segments, [0, 0, -9.81])[-1, 1]
    assert made["s_4"].tether_n == pytest.approx(tension, rel=1e-9)
    assert made["s_4"].tether_out_m == pytest.approx(route.length)
    assert made["s_6"].probability == 0
    assert made["s_6"].stopped_by == "tether: 7.5 m are used up"
    assert made["e_7"].stopped_by == made["s_6"].stopped_by
    weak = by_name(ot.map_reach(network, passport(pull=0.6), ["s_0.start"], tether=tether))
    assert weak["s_4"].probability < 0.2 < made["s_4"].probability
    assert "tether pulls" in weak["s_4"].stopped_by


def test_a_battery_ends_the_way_and_first_the_way_back():
    """With energy for half of the chain and back, and no more for there and back of all of it."""
    network, supply = chain(*"sssss"), ot.Supply(efficiency=1.0, base_power=36.0)
    # 36 W over 100 s and 10 m.
    made = by_name(
        ot.map_reach(
            network, passport(), ["s_0.start"], supply=ot.Supply(1.3, supply.efficiency, 36.0)
        )
    )
    assert made["s_2"].back > 0.95
    assert made["s_4"].probability > 0.95
    assert made["s_4"].back < 0.05
    assert made["s_4"].stopped_by.startswith("battery: ")
    assert made["s_4"].stopped_by.endswith("too little back")


def test_what_was_not_tried_is_unknown_and_keeps_the_robot_from_all_behind():
    """A bore beyond the trials, and a kind without trials."""
    wide = by_name(ot.map_reach(chain(*"se", bore=0.2), passport(), ["s_0.start"]))
    assert wide["s_0"].probability == 0
    assert wide["s_0"].stopped_by == "unknown: straight with bore 1.25, tried 1 to 1 (s_0)"
    known = passport()
    without = ot.Passport(known.robot, {}, {k: v for k, v in known.kinds.items() if k != "elbow"})
    made = by_name(ot.map_reach(chain(*"ses"), without, ["s_0.start"]))
    assert made["s_0"].probability > 0.9
    assert made["s_2"].stopped_by == "unknown: no trials of elbow (e_1)"


def test_openings_are_chosen_by_what_each_adds():
    """Of three openings of a chain that a wye cuts, the far one on the long side comes first, and
    the second adds the other side; a fitting may be an opening."""
    network = chain(*"sssws")
    rates = {"wye, run to branch": 0.0, "wye, branch to run": 0.0}
    names = ["s_0.start", "s_1", "s_4.end"]
    both = ot.map_reach(network, passport(rates), names, openings=2)
    assert both.openings == ("s_0.start", "s_4.end")
    assert both.gains[0] == pytest.approx(6.44, abs=0.1)
    assert both.gains[1] == pytest.approx(2.0, abs=0.2)
    assert by_name(both)["s_4"].launch == "s_4.end"
    with pytest.raises(ot.InputError, match="nowhere"):
        ot.map_reach(network, passport(), ["nowhere"])
    with pytest.raises(ot.InputError, match="friction"):
        ot.map_reach(network, passport(), names, friction=(0.9, 0.6))


def test_files_of_a_map_tell_the_same(tmp_path):
    """Tables, GeoJSON and page have a row for each pipe and each other part, a table one for each
    part, pictures are drawn, and all have the same bytes again."""
    network = chain(*"sebn")
    made = ot.map_reach(network, passport(), ["s_0.start"], tether=ot.Tether())
    files = {path.name: path.read_bytes() for path in ot.save_reach(made, tmp_path / "a")}
    again = ot.map_reach(network, passport(), ["s_0.start"], tether=ot.Tether())
    for path in ot.save_reach(again, tmp_path / "b"):
        assert path.read_bytes() == files[path.name], path.name
    rows = pq.read_table(tmp_path / "a" / "reach.parquet").to_pylist()
    assert [row["name"] for row in rows] == [part.name for part in made.parts]
    assert pq.read_table(tmp_path / "a" / "reach_parts.parquet").to_pylist() == rows
    lines = (tmp_path / "a" / "reach.csv").read_text().splitlines()
    assert lines[0].split(",") == list(made.parts[0]._fields)
    features = json.loads(files["reach.geojson"])["features"]
    assert {feature["properties"]["name"] for feature in features} == {row["name"] for row in rows}
    (ends,) = features[0]["geometry"]["coordinates"]
    assert math.dist(ends[0], ends[-1]) == pytest.approx(2.0)
    page = files["reach.html"].decode()
    assert len(re.findall("<polyline ", page)) == sum(
        len(feature["geometry"]["coordinates"]) for feature in features
    )
    assert "$" not in page.partition("<script>")[2].replace("${", "")
    assert {name.rpartition(".")[2] for name in files} >= {"png", "pdf", "svg", "json"}


def test_a_pipe_of_several_parts_has_one_row_that_of_its_far_end():
    """Whichever end it is entered from: its whole length, and the reach of its least sure part; a
    node of the same name keeps its own."""
    data = chain(*"sesbs").model_dump(mode="json")
    for part, pipe in zip(data["fittings"], ("A", "A", "A", "", "b_3"), strict=True):
        part["pipe"] = pipe
    network = ot.Network.model_validate(data)
    again = ot.Network.model_validate(network.around(["s_0"], reach=20.0).model_dump())
    assert [part.pipe for part in again.fittings] == ["A", "A", "A", "", "b_3"]
    for launch, far in (("s_0.start", "s_2"), ("s_4.end", "s_0")):
        reach = ot.map_reach(network, passport({"elbow": 0.8}), [launch])
        parts = by_name(reach)
        first, node, last = reach.pipes
        assert first == parts[far]._replace(
            name="A", kind="pipe", length=sum(parts[name].length for name in ("s_0", "e_1", "s_2"))
        )
        assert node == parts["b_3"]
        assert (last.name, last.kind) == ("b_3", "pipe")


def test_a_map_says_all_that_it_assumes(tmp_path):
    """Passport and network by their hashes, openings, friction, supply, tether, gravity and
    versions; another passport has another hash."""
    network, tether = chain(*"ses"), ot.Tether(length=30.0)
    options = {"friction": (0.7, 0.8), "supply": ot.Supply(50.0), "tether": tether}
    ot.save_reach(ot.map_reach(network, passport(), ["s_0.start"], **options), tmp_path)
    assumed = json.loads((tmp_path / "reach.json").read_text())["assumed"]
    assert assumed.keys() == {
        *("passport", "network", "launches", "friction", "supply", "tether", "gravity_m_s2"),
        *("way", "versions"),
    }
    assert assumed["friction"] == [0.7, 0.8]
    assert assumed["supply"] == {"battery_wh": 50.0, "efficiency": 0.3, "base_power_w": 5.0}
    assert assumed["tether"]["length"] == 30.0
    assert assumed["launches"] == ["s_0.start"]
    assert assumed["passport"]["sha256"] == passport().sha256 != passport({"elbow": 0.5}).sha256
    assert assumed["passport"]["trials"] == sum(len(k.passed) for k in passport().kinds.values())
    assert "omnitrack_sim" in assumed["versions"]
    bare = ot.map_reach(network, passport(), ["s_0.start"]).assumed
    assert bare["supply"]["battery_wh"] is None
    assert bare["tether"] is None
    assert bare["network"] == assumed["network"]


def test_bores_say_which_size_would_fit_most():
    """A row a bore, whose lengths add up to the network; the net of a size is of what joins it in
    bores that it fits, as those of a chain that a wider part cuts."""
    wide = {"kind": "straight", "length": 5.0, "inner_diameter": 0.24}
    network = ot.Network(
        fittings=[wide | {"name": f"w_{i}"} for i in range(2)],
        joints=[{"ports": ("w_0.end", "w_1.start")}],
    )
    made = ot.map_reach(network, passport(), ["w_0.start"])
    (row,) = made.bores
    assert row.length_m == pytest.approx(made.length)
    assert row.scale == pytest.approx(0.24 / made_for(passport()))
    assert row.net_m == pytest.approx(10.0)
    assert row.expected_m == 0.0
    narrowed = ot.map_reach(chain(*"ssn"), passport(), ["s_0.start"])
    assert sum(row.length_m for row in narrowed.bores) == pytest.approx(narrowed.length)
    assert max(row.net_m for row in narrowed.bores) < narrowed.length


def made_for(robot):
    """The bore that a passport's robot is made for, m."""
    return robot.robot.nominal_bore


def test_what_is_not_reached_has_the_colour_of_its_cause(tmp_path):
    """In figure and page, with the length in the legend; openings are named, the axes fill the
    figure."""
    network, robot = chain(*"ssbs"), passport({"tee, run to branch": 0.0})
    made = ot.map_reach(network, robot, ["s_0.start"], supply=ot.Supply(0.05))
    figure = ot.plot_reach(made)
    axes = figure.axes[0]
    legend = axes.get_legend()
    words = [text.get_text() for text in legend.get_texts()]
    stopped = sum(part.length for part in made.parts if part.probability < REACHED)
    assert sum(float(text.rpartition(", ")[2].split()[0]) for text in words) == pytest.approx(
        stopped, rel=0.01
    )
    assert "s_0.start" in [text.get_text() for text in axes.texts]
    ot.save_reach(made, tmp_path)
    page = (tmp_path / "reach.html").read_text()
    for words, colour in CAUSES.values():
        assert (words in page) == (colour in page.partition("<script>")[0]), words
    assert '[["s_0.start", ' in page


def test_a_map_has_no_blank_margin():
    """The drawn axes and what belongs to them reach to within a tenth of each edge."""
    figure = ot.plot_reach(ot.map_reach(ot.load_network("fig14"), passport(), ["low"]))
    FigureCanvasAgg(figure).draw()
    box = figure.get_tightbbox(figure.canvas.get_renderer())
    wide, high = figure.get_size_inches()
    assert box.width > 0.9 * wide
    assert box.height > 0.9 * high


def test_a_step_larger_than_was_tried_is_named():
    network = ot.Network(
        fittings=[
            {"kind": "straight", "name": "near", "length": 2.0},
            {"kind": "coupling", "name": "joint", "offset": 0.016},
            {"kind": "straight", "name": "far", "length": 2.0},
        ],
        joints=[{"ports": ("near.end", "joint.start")}, {"ports": ("joint.end", "far.start")}],
    )
    made = by_name(ot.map_reach(network, passport(), ["near.start"]))
    assert made["far"].probability == 0
    assert re.fullmatch(
        r"unknown: coupling with step 0\.1, tried [0-9.]+ to 0\.0(5|49\d) \(joint\)",
        made["far"].stopped_by,
    )
