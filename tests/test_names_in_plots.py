"""Names come from users: every plot draws them as they are, and one that fails costs no data."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from samples import sample_result, sample_trajectory

from omnitrack_sim import Result, plot_mission, plot_network, plot_summary
from omnitrack_sim.cli import runs
from omnitrack_sim.paper.claim_figures import contact_map_figure, elbow_figure, rates_figure
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import load_result
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.film.overlay import StatusPanel
from omnitrack_sim.show.plots.style import PictureWarning, attempt, figure_bytes
from omnitrack_sim.show.plots.success import Spread, sweep_figure
from omnitrack_sim.show.run_playback import RunPlayback

NAMES = ("$", "a$b$c", r"$\frac$", "_x^2_$", r"50%_\&#{}", "日本", "\x07\x1b[31m\x85", "n" * 250)
"""Mathematics, TeX, letters that the font lacks, control characters, length."""
PART_NAMES = [name for name in NAMES if "\\" not in name and "\x07" not in name]


def texts(figure: Figure) -> list[str]:
    """The texts of a figure that is drawn; none of them may be read as TeX."""
    figure_bytes(figure, "svg")
    found = [text for text in figure.findobj(Text) if text.get_text()]
    assert not any(text.get_parse_math() or text.get_usetex() for text in found)
    return [text.get_text() for text in found]


def named_result(name: str = "$a$") -> Result:
    """A run of a scenario with that name, whose parts and phases have all names."""
    pipes = [{"kind": "straight", "name": part, "length": 0.4} for part in NAMES]
    scenario = validate({"name": name, "pipes": [*pipes, {"kind": "elbow", "name": "bend"}]})
    plain = sample_trajectory()
    trajectory = Trajectory(plain.time, plain.channels, NAMES, plain.qpos, plain.schema)
    return sample_result(trajectory, scenario=scenario)


def test_names_of_scenarios_parts_and_phases():
    """In the summary, the map and the unrolled pipe, in warnings' silence."""
    result = named_result()
    found = texts(plot_summary(result))
    assert {"$a$", *(name.replace("_", " ") for name in NAMES[:3])} <= set(found)
    assert {"$a$", *NAMES} <= set(texts(plot_mission(result)))
    texts(contact_map_figure(result))


def test_names_of_networks_parts_and_ends():
    """In the figure of a network."""
    pipes = [{"kind": "straight", "name": name, "length": 0.5} for name in PART_NAMES]
    ends = itertools.pairwise(PART_NAMES)
    joints = [{"ports": [f"{a}.end", f"{b}.start"]} for a, b in ends]
    ports = {"$from$": f"{PART_NAMES[0]}.start"}
    data = {"name": "$net$", "fittings": pipes, "joints": joints, "ports": ports}
    found = texts(plot_network(validate_network(data)))
    assert {"$from$", *PART_NAMES} <= set(found)
    assert "$net$" in found


def test_names_of_axes_labels_and_groups():
    """In the figures of sweeps and comparisons."""
    passed, values = np.arange(len(NAMES)) % 2.0, np.arange(len(NAMES)) + 0.0
    words = Spread("$words$", "", NAMES, NAMES)
    number, theta5 = Spread("$n$", "1", values), Spread("start.theta5_deg", "deg", values)
    wrapped = {name.replace(" ", "\n", 1) for name in NAMES}
    assert {"$words$", "$n$", *wrapped} <= set(texts(sweep_figure([number, words], passed)))
    assert "$n$" in texts(sweep_figure([number, theta5], passed))
    few = Spread("$words$", "", (*NAMES[:3], *NAMES[:3], *NAMES[:2]), NAMES[:3])
    assert set(NAMES[:3]) <= set(texts(sweep_figure([theta5, few], passed)))
    assert set(NAMES) <= set(texts(rates_figure([(name, 1, 2) for name in NAMES], label="$r$")))
    assert set(NAMES) <= set(texts(elbow_figure({name: [sample_result()] for name in NAMES})))


@pytest.mark.parametrize("name", [*NAMES, "two\nlines"])
def test_names_in_films(name):
    """A frame can be written, whatever the part is called."""
    grey = np.full((180, 320, 3), 90, np.uint8)
    frame, result = grey.copy(), named_result()
    moment = RunPlayback(result).moment(0)._replace(part=name)
    StatusPanel(lambda row: result.scenario.robot.display.status(moment), (320, 180)).write(
        frame, 0
    )
    assert (frame != grey).any()


def test_what_fails_is_told_and_nothing_more():
    """Whatever is raised becomes a warning with its cause."""

    def fails():
        raise KeyError("tilt")

    assert attempt("map.png", lambda: 3) == 3
    with pytest.warns(PictureWarning, match=r"no map\.png: 'tilt'"):
        assert attempt("map.png", fails) is None


def test_plots_that_fail_cost_no_run(tmp_path, monkeypatch):
    """Plot, map, page and film fail: each is told, and the run is there and whole."""

    def fails(*_, **__):
        raise RuntimeError("no such colour")

    for target in (
        "omnitrack_sim.plot_summary",
        "omnitrack_sim.plot_mission",
        "omnitrack_sim.render_replay",
        "omnitrack_sim.render_video",
    ):
        monkeypatch.setattr(target, fails)
    result = named_result("chain")
    monkeypatch.setattr("omnitrack_sim.run", lambda *_, **__: result)
    with pytest.warns(PictureWarning) as told:
        runs.run("straight", folder=tmp_path / "run", as_json=False, camera=None, video=True)
    assert [str(w.message).partition(":")[0] for w in told] == [
        "no summary.png",
        "no map.png",
        "no replay.html",
        "no video",
    ]
    again = f"ot.plot_mission('{tmp_path}/run', path='{tmp_path}/run/map.png') draws it again"
    assert again in str(told[1].message)
    assert f"`omnitrack render {tmp_path}/run --camera side" in str(told[3].message)
    assert load_result(tmp_path / "run").scenario.name == "chain"
