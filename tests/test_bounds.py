"""Bounds on the work that a file may ask for: what is refused, where, and what is still allowed."""

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base import bounds
from omnitrack_sim.base.errors import InputError, NetworkError, ScenarioError, SweepError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Cross, Elbow, Mitre, Part, Reducer, Straight, Tee, network
from omnitrack_sim.pipes.assembly import touching
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.pipes.shapes import Pieces
from omnitrack_sim.scenario import validate
from omnitrack_sim.trials.sweep_file import resolve

PIPE = {"kind": "straight", "length": 1.2}
KILOMETRE = {"kind": "straight", "length": 1000.0}
PIECES = {"collider": "primitives"}
FINE = {"physics": {"timestep": 1e-6, "control_period": 1e-6}, "record": {"period": 1e-6}}


def _faults(read, data, error: type[InputError]) -> dict[str, str]:
    with pytest.raises(error) as caught:
        read(data)
    return {fault.where: fault.problem for fault in caught.value.faults}


def _chain(fittings: int, goals: int = 1) -> dict:
    """A mission to and fro at the ends of straights in a row with a tee at their beginning."""
    tables = [{"kind": "straight", "length": 0.5, "name": f"s{i}"} for i in range(fittings - 3)]
    tables += [{"kind": "tee", "name": "t"}, *({**PIPE, "name": name} for name in "ab")]
    joints = [[f"s{i}.end", f"s{i + 1}.start"] for i in range(fittings - 4)]
    joints += [["t.run_start", "a.end"], ["t.branch", "b.start"], ["t.run_end", "s0.start"]]
    ends = (f"s{fittings - 4}.end", "b.end")
    return {
        "network": {"fittings": tables, "joints": [{"ports": ports} for ports in joints]},
        "mission": {"start": "a.start", "goals": [ends[i % 2] for i in range(goals)]},
    }


@pytest.mark.parametrize(
    ("change", "where", "told"),
    [
        ({"physics": {"timestep": 1e-9}}, "physics.timestep", "1e-09"),
        (
            {"physics": {"timestep": 1e-6}, "run": {"time_limit": 101.0}},
            "physics.timestep",
            "1.01e+08 time",
        ),
        ({"run": {"time_limit": 1e300}}, "run.time_limit", "at most 100,000,000"),
        (FINE | {"run": {"time_limit": 9.0}}, "record.period", "9e+06 samples"),
        ({"control": {"cruise_speed": 1e-12}}, "control.cruise_speed", "1e-12"),
        ({"control": {"cruise_speed": 2e-6}}, "control.cruise_speed", "2.4e+06 s"),
        ({"pipes": [KILOMETRE] * 11}, "pipes", "are 11000 m long together; at most 10000 m"),
        ({"pipes": [KILOMETRE] * 3}, "record.period", "6.001e+06 samples"),
        ({"pipes": [PIPE] * 1001}, "pipes", "at most 1000 items"),
        (
            {"pipes": [PIPE] * 300, "physics": PIECES | {"staves": 720}},
            "physics.staves",
            "216,000 pieces",
        ),
        (
            {"pipes": [PIPE, {"kind": "elbow"}] * 2, "physics": PIECES | {"wall_tolerance": 1e-6}},
            "physics.wall_tolerance",
            "at most 200,000",
        ),
        ({"pipes": [{**PIPE, "length": 1e-300}]}, "pipes.0.length", "0.00001"),
        ({"pipes": [{**PIPE, "turn_deg": 1e300}]}, "pipes.0.turn_deg", "3600"),
        ({"world": {"gravity": [0, 0, 1e300]}}, "world.gravity.2", "1000"),
        ({"control": {"parameters": {"tracking": {"gain": 1e300}}}}, "", "1000000"),
        ({"monitor": {"memory": 1e-300}}, "monitor.memory", "0.000001"),
        (_chain(5, goals=201) | {"pipes": []}, "mission.goals", "at most 200 items"),
        (_chain(1001) | {"pipes": []}, "network.fittings", "at most 1000 items"),
    ],
)
def test_work_without_bound_is_refused_with_key_figure_and_bound(change, where, told):
    """Each figure is refused before anything is built, at the key that is to be changed."""
    faults = _faults(validate, {"pipes": [PIPE]} | change, ScenarioError)
    where = where or "control.parameters.tracking.gain"
    assert told in faults[where]


def test_generous_work_is_allowed():
    """A kilometre of pipe at ten samples a second, a day at 2 ms, and the finest step for a
    second."""
    slow = {"period": 0.1}
    assert validate({"pipes": [KILOMETRE], "record": slow}).route.centreline.length == 1000
    validate({"pipes": [PIPE], "run": {"time_limit": 86_400.0}, "record": slow})
    validate({"pipes": [PIPE], **FINE, "run": {"time_limit": 1.0}})


def test_legs_of_a_mission_count_together():
    """Each leg has a time limit of its own: 200 goals 60 m apart are refused for their steps, and
    the exact collider makes no walls of pieces."""
    data = _chain(120, goals=200) | {"physics": {"timestep": 0.001}}
    assert "time steps" in _faults(validate, data, ScenarioError)["mission.goals"]


def test_a_network_beyond_the_bound_is_refused_as_such(monkeypatch):
    """The length counts in a network of its own, too, up to that of a town."""
    monkeypatch.setattr(network, "MAX_TOWN_LENGTH", 1e4)
    data = _chain(9)["network"]
    for fitting in data["fittings"][:6] + data["fittings"][7:]:
        fitting["length"] = 999.0
    data["fittings"][6] |= {"run_length": 999.0, "branch_length": 999.0}
    data["fittings"] += [{**KILOMETRE, "name": "last"}]
    data["joints"] += [{"ports": ["b.end", "last.start"]}]
    read = network.validate
    assert "at most 10000 m" in _faults(read, data, NetworkError)["fittings"]


@pytest.mark.parametrize(
    ("change", "where", "told"),
    [
        ({"batch": 2000}, "batch", "at most 5000000, 1923 trials"),
        ({"axes": [{"count": 1_000_001}]}, "axes.0.count", "1000000"),
        ({"axes": [{"stop": 1e300}]}, "axes.0.stop", "1000000000000000"),
        ({"samples": 10**6, "axes": [{}]}, "axes", "at most 1000000"),
        ({"axes": [{"count": 1}] * 51}, "axes", "at most 50 items"),
        ({"axes": [{"kind": "list", "values": [f"x{i}" for i in range(201)]}]}, "", "at most 200"),
    ],
)
def test_sweeps_have_bounds_too(change, where, told):
    """Trials, samples of a batch, words and numbers of an axis."""
    grid = {"kind": "grid", "path": "world.friction", "start": 0.1, "stop": 1, "count": 5000}
    uniform = {"kind": "uniform", "path": "robot.preload", "low": 20, "high": 30}
    axes = [*(_axis(grid, axis) for axis in change.get("axes", [{}])), uniform]
    faults = _faults(
        resolve, {"name": "s", "base": "straight"} | change | {"axes": axes}, SweepError
    )
    assert told in faults[where or "axes.0.values"]


def _axis(grid: dict, changes: dict) -> dict:
    if changes.get("kind") == "list":
        return {"path": "control.kind"} | changes
    return grid | changes


@pytest.mark.parametrize(
    "fitting",
    [
        Straight(1.0),
        Reducer(0.4, 0.1, 0.16),
        Elbow(0.24),
        Elbow(0.08, np.pi),
        Tee(),
        Tee(inner_diameter=1.0, run_length=3.0, branch_length=2.0),
        Wye(),
        Wye(angle=np.pi / 2, branch_diameter=0.08),
        Wye(angle=np.pi / 6),
        Cross(),
        Cross(angle=np.pi / 6, branch_diameter=0.08),
        Mitre(),
        Mitre(angle=2.5),
    ],
    ids=repr,
)
@pytest.mark.parametrize(("tolerance", "staves"), [(1e-3, None), (1e-4, None), (1e-4, 60)])
def test_pieces_are_counted_without_making_them(fitting, tolerance, staves):
    """The count is that of the pieces, or up to 1.6 times as many where there is a rim."""
    pieces = Pieces()
    fitting.add_walls(pieces, tolerance, staves)
    made = len(pieces.boxes) + len(pieces.capsules)
    assert made <= fitting.piece_count(tolerance, staves) <= 1.6 * made


def _zigzag(count: int) -> dict:
    """Straights and elbows by turns, up and down: each comes close to a few others."""
    elbow = {"kind": "elbow", "mean_radius": 0.24}
    turns = [{**elbow, "turn_deg": 180.0 if k % 2 else 0.0} for k in range(count // 2)]
    pipes = [pipe for turn in turns for pipe in ({"kind": "straight", "length": 0.02}, turn)]
    return {"pipes": pipes}


def test_overlaps_are_looked_for_in_linear_time(monkeypatch):
    """Twice as many parts are compared twice as often, and not four times."""
    compared = []
    original = Part.holds
    monkeypatch.setattr(
        Part, "holds", lambda self, *given: compared.append(len(given[0])) or original(self, *given)
    )
    points = []
    for count in (50, 100):
        compared.clear()
        validate(_zigzag(count))
        points.append(sum(compared))
    assert 0 < points[1] <= 2.1 * points[0]


def test_long_pipes_are_compared_only_where_they_come_close(monkeypatch):
    """Two pipes of 200 m that meet at a corner are compared there, and not along all of them."""
    compared = []
    original = Part.holds
    monkeypatch.setattr(
        Part, "holds", lambda self, *given: compared.append(len(given[0])) or original(self, *given)
    )
    long = {"kind": "straight", "length": 200.0}
    pipes = [long, {"kind": "elbow", "mean_radius": 0.24}, long]
    validate({"pipes": pipes, "record": {"period": 0.1}})
    every = len(Part("p", Straight(200.0), Pose()).bore_samples())
    assert sum(compared) < 0.1 * every


def test_parts_in_one_place_are_told_up_to_a_bound():
    """A circle of elbows that is driven round fifty times has 2,500 overlaps; the first are
    told."""
    faults = _faults(validate, {"pipes": [{"kind": "elbow"}] * 200}, ScenarioError)
    assert 1 <= len(faults) <= 2 * bounds.MAX_FAULTS


def test_touching_balls_are_those_that_touch():
    """Against all pairs, for clouds of many densities and balls of very different sizes."""
    rng = np.random.default_rng(1)
    for count in (0, 1, 2, 60, 200):
        for spread in (0.01, 1.0, 30.0):
            centres = rng.normal(size=(count, 3)) * spread
            radii = rng.uniform(0.1, 1, count) * 10.0 ** rng.uniform(-1, 0.5, count)
            found = [tuple(pair) for block in touching(centres, radii) for pair in block.tolist()]
            apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
            touch = np.triu(apart < radii[:, None] + radii, k=1)
            assert sorted(found) == [tuple(pair) for pair in np.argwhere(touch).tolist()]


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"fittings": 1001}, "fittings"),
        ({"lengths": (0.3, 1e9)}, "lengths"),
        ({"lengths": (-1.0, 0.2)}, "lengths"),
        ({"lengths": (np.nan, 1.0)}, "lengths"),
        ({"inner_diameter": 1e300}, "inner_diameter"),
        ({"mean_radii": ()}, "mean_radii"),
        ({"tee_share": 5.0}, "tee_share"),
    ],
)
def test_a_random_network_of_senseless_sizes_is_refused(change, where):
    """Sizes that no network can have, or that would fill the memory."""
    given = {"fittings": 8} | change
    assert where in _faults(lambda more: ot.random_network(1, **more), given, NetworkError)
