"""What is written and read again is what it was: values of ``--set``, paths, files, rotations."""

from __future__ import annotations

import json
import math
import tomllib

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.paths import expand, matches, value_at
from omnitrack_sim.base.rotations import (
    Pose,
    angle_between,
    cross,
    frame_along,
    heading,
    matrix_from_quaternion,
    orthonormal,
    quaternion_from_matrix,
    rotation_about,
    rotation_vector,
    skew,
    turned_by,
    wrap_angle,
)
from omnitrack_sim.base.text import as_toml, strict_json
from omnitrack_sim.cli.common import assignment, settings_of
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.scenario.loading import read_back, set_value
from omnitrack_sim.trials.axes import AXES
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_file import resolve

LAW = settings(derandomize=True, database=None, deadline=None, max_examples=30)
"""The same examples every time."""
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
KEYS = st.text(st.characters(codec="utf-8"), max_size=6)
PLAIN = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | NUMBERS | KEYS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)
NAMES = st.from_regex(r"[a-z][a-z_0-9]{0,5}", fullmatch=True)
TREES = st.dictionaries(
    NAMES,
    st.recursive(
        NUMBERS,
        lambda inner: (
            st.lists(inner, min_size=1, max_size=3)
            | st.dictionaries(NAMES, inner, min_size=1, max_size=3)
        ),
        max_leaves=8,
    ),
    min_size=1,
    max_size=3,
)
VECTORS = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
ANGLES = st.floats(-20, 20)


def directions():
    """Vectors whose direction is well defined."""
    return VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-3)


def poses():
    """Frames anywhere."""
    return st.builds(lambda z, t, p: Pose(frame_along(z, t), p), directions(), ANGLES, VECTORS)


def leaves(data, before=""):
    """Path and value of everything in nested tables and lists that is neither."""
    rows = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in rows:
        if isinstance(value, dict | list) and value:
            yield from leaves(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def same(a, b):
    """Equal, and of the same kinds of numbers, the sign of zero included."""
    return repr(a) == repr(b)


@LAW
@given(st.lists(NAMES, min_size=1, max_size=4), PLAIN, st.sampled_from(["", " ", "  "]))
def test_an_assignment_reads_what_was_written(keys, value, blank):
    """PATH=VALUE, with or without blanks, gives path and value back; a bare word is a text."""
    path = ".".join(keys)
    assert same(assignment(f"{blank}{path}{blank}={blank}{as_toml(value)}{blank}"), (path, value))
    assert assignment(f"{path}={path}word") == (path, f"{path}word")
    with pytest.raises(InputError):
        assignment(f"={as_toml(value)}")


@LAW
@given(TREES)
def test_a_file_of_values_gives_every_leaf_at_its_path(tmp_path_factory, tree):
    """``--set @FILE`` gives the leaves of its tables, lists whole, whichever way they are written:
    as tables, or as paths in quotes."""
    expected = dict(leaves_of_tables(tree))
    folder = tmp_path_factory.mktemp("values")
    nested = "".join(f"{key} = {as_toml(value)}\n" for key, value in tree.items())
    flat = "".join(f"{json.dumps(path)} = {as_toml(value)}\n" for path, value in expected.items())
    for name, text in (("nested", nested), ("flat", flat)):
        file = folder / f"{name}.toml"
        file.write_text(text, encoding="utf-8")
        assert same(settings_of(f"@{file}"), expected)


def leaves_of_tables(data, before=""):
    """Path and value of everything in nested tables that is no table."""
    for key, value in data.items():
        if isinstance(value, dict):
            yield from leaves_of_tables(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


@LAW
@given(TREES, st.data())
def test_a_path_leads_to_its_value_and_a_star_to_all_of_a_list(tree, data):
    """Every leaf lies at its path and nowhere else; with stars for indices the path stands for
    those of all items, of which those match that are there."""
    rows = list(leaves(tree))
    path, value = data.draw(st.sampled_from(rows))
    assert same(value_at(tree, path), value)
    assert value_at(tree, f"{path}.more") is None
    keys = path.split(".")
    place, starred = tree, []
    for key in keys:
        starred.append("*" if isinstance(place, list) else key)
        place = place[int(key)] if isinstance(place, list) else place[key]
    pattern = ".".join(starred)
    assert path in expand(tree, pattern)
    others = {
        one
        for one, _ in [*leaves(tree), *inner(tree)]
        if len(one.split(".")) == len(keys)
        and all(
            s == k or (s == "*" and k.isdigit())
            for s, k in zip(starred, one.split("."), strict=True)
        )
    }
    assert set(matches(tree, pattern)) == others


def inner(data, before=""):
    """Path and value of all tables and lists within tables and lists, but empty ones."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if isinstance(value, dict | list) and value:
            yield f"{before}{key}", value
            yield from inner(value, f"{before}{key}.")


TURN = ot.load_scenario("tee_turn")
FACTORS = {
    "world.friction": 0.9,
    "robot.preload": 1.1,
    "control.cruise_speed": 0.7,
    "pipes.0.length": 1.5,
    "world.gravity.2": 0.5,
    "control.parameters.tracking.gain": 1.2,
    "robot.motor.speed_droop": 2.0,
    "sensing.imu.gyro_scale": 3.0,
}


@LAW
@given(st.sampled_from(list(leaves(TURN.model_dump(mode="json")))))
def test_a_value_set_to_itself_changes_nothing(leaf):
    """Every value of a scenario may be set at its path, and is then what it was."""
    path, value = leaf
    data = TURN.model_dump(mode="json")
    assert set_value(data, path, value) is None
    assert data == TURN.model_dump(mode="json")
    again = ot.override(TURN, {path: value})
    assert again == TURN
    assert again.hash == TURN.hash


@LAW
@given(st.permutations(list(FACTORS)), st.integers(1, len(FACTORS)))
def test_overrides_set_what_they_name_in_any_order_and_go_back(paths, count):
    """The values named are set, all others stay, the order does not matter, and setting the old
    values again gives the old scenario."""
    before = dict(leaves(TURN.model_dump(mode="json")))
    changes = {path: before[path] * FACTORS[path] for path in paths[:count]}
    changed = ot.override(TURN, changes)
    assert dict(leaves(changed.model_dump(mode="json"))) == before | changes
    assert ot.override(TURN, dict(reversed(changes.items()))).hash == changed.hash
    assert changed.hash != TURN.hash
    assert ot.override(changed, {path: before[path] for path in changes}).hash == TURN.hash


@pytest.mark.parametrize(
    "name", ["missions/fig14_onboard", "missions/explore_loop", "robots/helix_tee"]
)
def test_a_scenario_is_read_back_as_it_was(name, tmp_path):
    """By JSON of a run, and as a file of its own, with the same hash."""
    scenario = ot.load_scenario(name)
    text = scenario.model_dump_json()
    assert read_back(json.loads(text)) == scenario
    (tmp_path / "again.json").write_text(text)
    again = ot.load_scenario(tmp_path / "again.json")
    assert (again, again.hash) == (scenario, scenario.hash)


FITTINGS = st.one_of(
    st.fixed_dictionaries({"kind": st.just("straight"), "length": st.floats(0.05, 3)}),
    st.fixed_dictionaries(
        {
            "kind": st.just("elbow"),
            "mean_radius": st.floats(0.1, 0.5),
            "angle_deg": st.floats(5, 120),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("tee"), "run_length": st.none() | st.floats(0.35, 1.0)}),
    st.fixed_dictionaries({"kind": st.just("mitre"), "angle_deg": st.floats(5, 90)}),
)
PLACES = st.fixed_dictionaries(
    {
        "axis": st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
        "turn_deg": st.floats(-180, 180),
        "position": st.tuples(*[st.floats(-50, 50)] * 3),
    }
)


@st.composite
def networks(draw):
    """Plain data of two or three fittings in a row, anywhere, with their ends named."""
    kinds = draw(st.lists(FITTINGS, min_size=2, max_size=3))
    names = draw(st.lists(NAMES, min_size=len(kinds), max_size=len(kinds), unique=True))
    ends = [("run_start", "branch") if one["kind"] == "tee" else ("start", "end") for one in kinds]
    rows = [
        {key: value for key, value in one.items() if value is not None} | {"name": name}
        for one, name in zip(kinds, names, strict=True)
    ]
    joints = [
        {
            "ports": [f"{names[i]}.{ends[i][1]}", f"{names[i + 1]}.{ends[i + 1][0]}"],
            "turn_deg": draw(st.floats(-180, 180)),
        }
        for i in range(len(kinds) - 1)
    ]
    ports = {"way_in": f"{names[0]}.{ends[0][0]}"}
    return {
        "name": "drawn",
        "place": draw(PLACES),
        "fittings": rows,
        "joints": joints,
        "ports": ports,
    }


@LAW
@given(networks())
def test_a_network_is_read_back_as_it_was(data):
    """By TOML and by JSON, to the last bit of its sizes, turns and place."""
    try:
        network = validate_network(data)
    except InputError:
        assume(False)
    for again in (
        validate_network(tomllib.loads(network.to_toml())),
        validate_network(json.loads(network.model_dump_json())),
    ):
        assert again == network
        assert same(again.model_dump(mode="json"), network.model_dump(mode="json"))
        for one, other in zip(again.pipes.parts, network.pipes.parts, strict=True):
            np.testing.assert_array_equal(one.pose.position, other.pose.position)


RANGES = {
    "grid": {"start": st.floats(0.1, 1), "stop": st.floats(0.1, 1), "count": st.integers(1, 4)},
    "list": {"values": st.lists(st.floats(0.1, 1), min_size=1, max_size=3)},
    "uniform": {"low": st.floats(0.1, 0.5), "high": st.floats(0.6, 1)},
    "normal": {"mean": st.floats(0.1, 1), "std": st.floats(0.01, 1), "low": st.just(0.05)},
    "calibration": {
        "file": st.just("mine.toml"),
        "values": st.tuples(st.floats(0.2, 1)).map(list),
        "covariance": st.tuples(st.tuples(st.floats(0, 1)).map(list)).map(list),
        "low": st.just([0.1]),
        "high": st.just([2.0]),
    },
}


@settings(LAW, max_examples=12)
@given(
    st.sampled_from(list(RANGES)).flatmap(
        lambda kind: st.fixed_dictionaries({"kind": st.just(kind), **RANGES[kind]})
    ),
    st.sampled_from(["random", "latin_hypercube", "sobol"]),
    st.integers(0, 2**40),
)
def test_a_sweep_is_read_back_as_it_was(axis, sampling, seed):
    """By its plain data: the same hash, and the same value in every trial."""
    assert set(RANGES) == set(AXES) - {"direction"}
    table = {"name": "s", "base": "straight", "samples": 3, "seed": seed, "sampling": sampling}
    sweep = resolve({**table, "axes": [{"path": "world.friction", **axis}]})
    again = Sweep.model_validate(json.loads(json.dumps(sweep.data())))
    assert again.hash == sweep.hash
    assert same(again.trials(), sweep.trials())


@LAW
@given(PLAIN)
def test_strict_json_is_what_was_written(value):
    """Plain data read from strict JSON are the same; what is not finite is null."""
    assert same(json.loads(strict_json(value)), value)
    assert json.loads(strict_json({"a": [value, math.nan, -math.inf]})) == {
        "a": [value, None, None]
    }


# Frames and rotations


@LAW
@given(poses(), poses(), poses(), VECTORS)
def test_poses_are_a_group(a, b, c, point):
    """They are associative, their inverses undo them, and a product applies the right one first."""
    for one, other in (((a @ b) @ c, a @ (b @ c)), (a @ a.inverse(), Pose())):
        np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-12)
        np.testing.assert_allclose(one.position, other.position, atol=1e-12)
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-12)
    np.testing.assert_allclose(a.inverse().apply(a.apply(point)), point, atol=1e-12)


@LAW
@given(directions(), ANGLES, VECTORS)
def test_rotations_have_one_meaning_in_all_their_forms(axis, angle, vector):
    """Quaternions are MuJoCo's; matrix, quaternion and rotation vector lead to each other; about
    an axis each angle turns by its right-handed Rodrigues formula."""
    turn = rotation_about(axis, angle)
    n = axis / np.linalg.norm(axis)
    formula = (
        vector * np.cos(angle)
        + np.cross(n, vector) * np.sin(angle)
        + n * (n @ vector) * (1 - np.cos(angle))
    )
    np.testing.assert_allclose(turn @ vector, formula, atol=1e-12)
    quaternion = quaternion_from_matrix(turn)
    assert quaternion[0] >= 0
    assert np.linalg.norm(quaternion) == pytest.approx(1, abs=1e-12)
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    np.testing.assert_allclose(flat.reshape(3, 3), turn, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), turn, atol=1e-12)
    if abs(wrap_angle(angle)) < 3:
        back = rotation_vector(turn[None])[0]
        np.testing.assert_allclose(back, n * wrap_angle(angle), atol=1e-9)
        np.testing.assert_allclose(turned_by(back[None])[0], turn, atol=1e-9)
    np.testing.assert_allclose(skew(axis) @ vector, np.cross(axis, vector), atol=1e-12)
    np.testing.assert_allclose(cross(axis, vector), np.cross(axis, vector), atol=1e-12)


@LAW
@given(directions(), ANGLES, ANGLES)
def test_a_frame_along_an_axis_has_it_as_z_and_turns_about_it(axis, turn, more):
    """It is right-handed and square; a further turn turns it about its own z; a frame that is
    nearly square becomes it; tail first twice is nose first."""
    frame = frame_along(axis, turn)
    np.testing.assert_allclose(frame[:, 2], axis / np.linalg.norm(axis), atol=1e-12)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1, abs=1e-12)
    about = rotation_about([0.0, 0.0, 1.0], more)
    np.testing.assert_allclose(frame_along(axis, turn + more), frame @ about, atol=1e-12)
    np.testing.assert_allclose(orthonormal(1.5 * frame[None])[0], frame, atol=1e-12)
    back = np.array([-1])
    np.testing.assert_array_equal(heading(heading(frame[None], back), back)[0], frame)
    np.testing.assert_array_equal(heading(frame[None], back)[0, :, 2], -frame[:, 2])


@LAW
@given(ANGLES, st.floats(0.1, 7), directions(), directions())
def test_angles_wrap_and_are_measured_between_vectors(angle, period, a, b):
    """Wrapped into half a period to either side, by whole periods; between unit vectors the angle
    has their scalar product as cosine."""
    wrapped = float(wrap_angle(angle, period))
    assert -period / 2 <= wrapped <= period / 2
    turns = (angle - wrapped) / period
    assert turns == pytest.approx(round(turns), abs=1e-9)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    assert math.cos(angle_between(a, b)) == pytest.approx(a @ b, abs=1e-12)
    assert 0 <= angle_between(a, b) <= math.pi
