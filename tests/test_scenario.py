"""Scenario files: what is accepted, and how faults are told."""

import math

import numpy as np
import pytest

from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.scenario import Scenario, load_scenario, override, validate
from omnitrack_sim.sim.builder import batch_key

PIPES = [{"kind": "straight", "length": 0.5}]


def _faults(data) -> dict[str, str]:
    with pytest.raises(ScenarioError) as caught:
        validate(data)
    return {fault.where: str(fault) for fault in caught.value.faults}


def test_shipped_scenarios_are_valid_and_expect_something():
    """Every shipped file loads and states its outcome."""
    assert {
        "straight",
        "vertical_climb",
        "elbow",
        "elbow_short",
        "tee_turn",
        "tee_straight",
    } <= set(shipped_files("scenarios"))
    for name in shipped_files("scenarios"):
        scenario = load_scenario(name)
        assert scenario.name == name.rpartition("/")[2]
        assert scenario.run.expected_outcome is not None


def test_a_scenario_survives_its_own_json():
    """Dumped and read again it is the same, with the same hash."""
    scenario = load_scenario("tee_turn")
    again = Scenario.model_validate_json(scenario.model_dump_json())
    assert again == scenario
    assert again.hash == scenario.hash


def test_scenarios_are_equal_by_their_keys():
    """Two of the same keys are equal with and without their routes built; another key differs."""
    one, other = load_scenario("tee_turn"), load_scenario("tee_turn")
    assert one.route is not other.route
    assert one == other == Scenario.model_validate(one.model_dump())
    assert one != override(other, {"world.friction": 0.5})
    assert one != "tee_turn"


@pytest.mark.parametrize(
    ("change", "where", "told"),
    [
        ({"colour": "red"}, "colour", "pipes"),
        ({"control": {"cruise_sped": 0.1}}, "control.cruise_sped", "cruise_speed"),
        ({"robot": {"prelaod": 1.0}}, "robot.prelaod", "preload"),
        ({"control": {"cruise_speed": "fast"}}, "control.cruise_speed", "valid number"),
        ({"control": {"kind": "magic"}}, "control.kind", "jacobian"),
        ({"robot": {"lug_radius": -0.01}}, "robot.lug_radius", "from 0.004 to 0.08 m"),
        ({"pipes": [{"kind": "bend"}]}, "pipes.0.kind", "elbow"),
        ({"pipes": [{"kind": "straight", "length": -1.0}]}, "pipes.0.length", "0.00001"),
        (
            {"pipes": [{"kind": "elbow", "mean_radius": 0.05}]},
            "pipes.0.mean_radius",
            "at least the pipe radius",
        ),
        ({"pipes": [{"kind": "tee", "enter": "side"}]}, "pipes.0.enter", "run_start"),
        ({"pipes": [{"kind": "reducer", "length": 0.1}]}, "pipes.0.end_diameter", "required"),
        (
            {"pipes": [{"kind": "reducer", "length": 0.1, "end_diameter": 0.16}]},
            "pipes.0.end_diameter",
            "a straight",
        ),
        (
            {"pipes": [{"kind": "reducer", "length": 0.01, "end_diameter": 0.15}]},
            "pipes.0.length",
            "20 degrees",
        ),
        (
            {
                "pipes": [
                    *PIPES,
                    {"kind": "reducer", "length": 0.1, "end_diameter": 0.15, "enter": "end"},
                ]
            },
            "pipes.1.end_diameter",
            "a reducer joins bores",
        ),
        (
            {"pipes": [{"kind": "tee", "enter": "branch", "leave": "branch"}]},
            "pipes.0.leave",
            "where the tee is entered",
        ),
        (
            {"pipes": [*PIPES, {"kind": "straight", "length": 1.0, "inner_diameter": 0.17}]},
            "pipes.1.inner_diameter",
            "joins",
        ),
        ({"pipes": []}, "pipes", "is missing"),
        ({"start": {"distance": 0.01}}, "start.distance", "inside the pipe"),
        ({"start": {"distance": 0.49}}, "start.distance", "inside the pipe"),
        ({"run": {"goal_distance": 0.05}}, "run.goal_distance", "over start.distance"),
        ({"physics": {"control_period": 0.003}}, "physics.control_period", "whole multiple"),
        ({"start": {"axis": [0.0, 0.0, 0.0]}}, "start.axis", "no direction"),
        ({"run": {"expected_outcome": "flew"}}, "run.expected_outcome", "reached_goal"),
        ({"pipes": [{"kind": "straight", "length": "0.5"}]}, "pipes.0.length", "valid number"),
        ({"pipes": [{"kind": "straight", "length": 500e3}]}, "pipes.0.length", "1000"),
        ({"control": {"align": "no"}}, "control.align", "valid boolean"),
        ({"seed": True}, "seed", "valid integer"),
        ({"robot": {"preload": math.inf}}, "robot.preload", "finite"),
        ({"name": "../elsewhere"}, "name", "or hold a slash"),
    ],
)
def test_a_fault_is_named_by_its_place_with_what_would_be_right(change, where, told):
    """Each wrong entry is reported at its dotted path."""
    faults = _faults({"pipes": PIPES} | change)
    assert where in faults
    assert told in faults[where]


def test_all_faults_are_told_at_once():
    """Three faults in three tables give three lines."""
    data = {"pipes": PIPES, "world": {"friction": -1}, "monitor": {"patience": "x"}, "seed": -1}
    assert set(_faults(data)) == {"world.friction", "monitor.patience", "seed"}


def test_a_faulty_pipe_is_one_fault():
    """A misspelt key of the only pipe does not also count as a missing pipe."""
    assert set(_faults({"pipes": [{"kind": "straight", "length": 0.5, "lenght": 0.5}]})) == {
        "pipes.0.lenght"
    }


def test_pipes_that_run_into_each_other_are_refused():
    """Five tight elbows in one plane come back into the first; both are named."""
    faults = _faults(
        {"pipes": [{"kind": "elbow", "mean_radius": 0.09}] * 5, "start": {"distance": 0.1}}
    )
    assert any("elbow_0" in text and "elbow_4" in text for text in faults.values())


def test_override_changes_by_dotted_path_and_leaves_the_original():
    """Tables and list items are reached by their path."""
    scenario = load_scenario("tee_turn")
    changed = override(
        scenario, {"control.cruise_speed": 0.05, "pipes.0.length": 0.5, "robot.preload": 20}
    )
    assert changed.control.cruise_speed == 0.05
    assert changed.pipes[0].length == 0.5
    assert changed.robot.preload == 20.0
    assert scenario.control.cruise_speed == 0.1


@pytest.mark.parametrize(
    ("path", "choice"),
    [
        ("control.speed", "cruise_speed"),
        ("pipes.9.length", "0"),
        ("wrold.gravity", "world"),
        ("pipes.0.0", "length"),
    ],
)
def test_override_with_an_unknown_path_lists_the_choices(path, choice):
    """A misspelt path is refused with what there is at that place."""
    with pytest.raises(ScenarioError) as caught:
        override(load_scenario("tee_turn"), {path: 1.0})
    assert choice in caught.value.faults[0].choices


def test_override_takes_numpy_values():
    """Values computed with NumPy, arrays included, do as well as plain ones."""
    changes = {
        "world.friction": np.float64(0.5),
        "seed": np.int64(3),
        "world.gravity": np.array([0.0, 0.0, 1.0]),
    }
    changed = override(load_scenario("tee_turn"), changes)
    assert (changed.world.friction, changed.seed, changed.world.gravity) == (
        0.5,
        3,
        (0.0, 0.0, 1.0),
    )


def test_only_floats_of_the_compiled_model_share_a_batch():
    """Start, friction, gravity and preload keep the batch key; pipes and lug count change it."""
    base = load_scenario("tee_turn")
    same = {
        "start.theta5_deg": 9.0,
        "world.friction": 0.5,
        "robot.preload": 20.0,
        "world.gravity": [0, 0, 1.0],
        "seed": 3,
    }
    assert batch_key(override(base, same).model_dump(mode="json")) == batch_key(
        base.model_dump(mode="json")
    )
    for change in (
        {"pipes.0.length": 0.35},
        {"robot.lugs_per_track": 5},
        {"physics.timestep": 0.001},
    ):
        assert batch_key(override(base, change).model_dump(mode="json")) != batch_key(
            base.model_dump(mode="json")
        )


def test_route_lies_along_the_start_axis():
    """The first pipe runs along start.axis from the origin, whatever the axis."""
    for axis in ([1.0, 0, 0], [0, 0, -1.0], [0.3, -0.5, 0.2]):
        route = validate({"pipes": PIPES, "start": {"axis": axis}}).route
        _, tangent, _, _ = route.centreline.at([0.1])
        assert tangent[0] == pytest.approx([a / math.hypot(*axis) for a in axis])


@pytest.mark.parametrize(
    ("axis", "turn_deg", "bends"),
    [
        ([0, 0, 1], 0, [1, 0, 0]),
        ([1, 0, 0], 0, [0, 0, -1]),
        ([1, 0, 0], 90, [0, 1, 0]),
        ([1, 0, 0], 180, [0, 0, 1]),
        ([1, 0, 0], 270, [0, -1, 0]),
        ([0, 1, 0], 0, [1, 0, 0]),
        ([0, 1, 0], 90, [0, 0, -1]),
        ([0, 1, 0], 180, [-1, 0, 0]),
        ([0, 1, 0], 270, [0, 0, 1]),
    ],
)
def test_an_elbow_bends_as_the_key_says(axis, turn_deg, bends):
    """Where ``start.turn_deg`` has an elbow lead, upright and level; the centreline's normal points
    to the inside of the bend, perpendicular to its tangent."""
    pipes = [{"kind": "elbow"}, {"kind": "straight", "length": 0.2}]
    route = validate({"pipes": pipes, "start": {"axis": axis, "turn_deg": turn_deg}}).route
    ends, middle = np.array([route.length]), np.array([0.24 * np.pi / 4])
    _, tangent, _, _ = route.centreline.at(ends)
    assert tangent[0] == pytest.approx(bends, abs=1e-12)
    _, along, normal, _ = route.centreline.at(middle)
    assert normal[0] == pytest.approx((np.array(bends) - axis) / math.sqrt(2))
    assert normal[0] @ along[0] == pytest.approx(0, abs=1e-12)


def test_not_toml_and_no_file_are_clear_errors(tmp_path):
    """A broken file and a missing one name the file."""
    broken = tmp_path / "broken.toml"
    broken.write_text("name = ")
    with pytest.raises(ScenarioError, match=r"broken\.toml"):
        load_scenario(broken)
    with pytest.raises(ScenarioError, match="tee_turn"):
        load_scenario("no_such_scenario")


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_the_route_s_axis_may_be_a_vector_of_any_size(size):
    """Only its direction counts; its square would vanish or overflow."""
    usual = validate({"pipes": PIPES, "start": {"axis": [1.0, 0.0, 2.0]}})
    other = validate({"pipes": PIPES, "start": {"axis": [size, 0.0, 2 * size]}})
    for s in (0.0, other.route.centreline.length):
        here, there = (x.route.centreline.at(np.array([s]))[0] for x in (usual, other))
        assert np.allclose(here, there, atol=1e-12)
