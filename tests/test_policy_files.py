"""Policy files: written, read back, and refused where they are not what they say."""

from __future__ import annotations

import io
import json
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from policy_samples import driver, random_network, random_policy

import omnitrack_sim as ot
from omnitrack_sim.base.bounds import MAX_LAYERS, MAX_POLICY_BYTES, MAX_WIDTH
from omnitrack_sim.base.writing import npz_of
from omnitrack_sim.cli import main
from omnitrack_sim.robots.feature import Feature
from omnitrack_sim.robots.omnitrack.policy.features import FEATURE_SETS, FEATURES
from omnitrack_sim.robots.omnitrack.policy.file import (
    DIRECT,
    RESIDUAL,
    Acting,
    Mlp,
    Policy,
    named_features,
)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    random_policy().save(tmp_path / "one.npz")
    return tmp_path / "one.npz"


def _changed(path: Path, **arrays: object) -> Path:
    """The file at ``path`` with arrays replaced, or left out where None is given."""
    with np.load(path) as found:
        data = dict(found) | arrays
    np.savez(path, **{key: value for key, value in data.items() if value is not None})
    return path


def _refused(path: Path, pattern: str) -> None:
    with pytest.raises(ot.PolicyError, match=pattern) as caught:
        ot.load_policy(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_a_row_gives_the_same_bytes_alone_and_among_others(activation, output):
    network = random_network(53, hidden=(64, 64), activation=activation, output=output)
    entries = np.random.default_rng(1).normal(0, 1, (193, 53)).astype(np.float32)
    together = network(entries)
    assert together.dtype == np.float32
    assert together.shape == (193, 4)
    for rows in (slice(0, 1), slice(70, 71), slice(64, 192), slice(None, None, -1)):
        assert network(entries[rows]).tobytes() == together[rows].tobytes()


def test_it_is_the_network_of_a_trainer():
    """As a trainer evaluates it, in matrix products of single precision."""
    network = random_network(53, hidden=(64, 64))
    entries = np.random.default_rng(1).normal(0, 1, (200, 53)).astype(np.float32)
    x = ((entries - network.mean) / network.std).astype(np.float32)
    single = [
        (w.astype(np.float32), b.astype(np.float32))
        for w, b in zip(network.weights, network.biases, strict=True)
    ]
    for weight, bias in single[:-1]:
        x = np.tanh(x @ weight + bias)
    expected = np.clip(x @ single[-1][0] + single[-1][1], -1, 1)
    assert np.abs(network(entries) - expected).max() < 1e-5
    exact = Mlp([w for w, _ in single], [b for _, b in single], network.mean, network.std)
    rows = (entries.astype(float) - network.mean) / network.std
    for weight, bias in single[:-1]:
        rows = np.tanh(rows @ weight + bias)
    rows = np.clip(rows @ single[-1][0] + single[-1][1], -1, 1)
    assert np.abs(exact(entries) - rows).max() < 1e-6


@pytest.mark.parametrize("policy", [random_policy(), random_policy("truth", RESIDUAL, 3)])
def test_a_policy_is_read_back_as_it_was_written(tmp_path, policy):
    policy.save(tmp_path / "a.npz")
    policy.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    found = ot.load_policy(tmp_path / "a.npz")
    for name in ("features", "acting", "note"):
        assert getattr(found, name) == getattr(policy, name)
    entries = np.random.default_rng(0).normal(0, 1, (5, policy.network.inputs))
    assert found(entries).tobytes() == policy(entries).tobytes()
    assert len(found.sha256) == 64


OWN = Feature("power", "W", 0.0, 5.0, "of nothing", lambda view: np.zeros(view.setup.n))
SEVERAL = [OWN, FEATURES["tilt"]]


def test_features_of_a_users_own_are_found_again_by_their_names(tmp_path):
    names = named_features(["tilt", f"{__name__}:OWN"])
    assert names == ("tilt", f"{__name__}:OWN")
    Policy(random_network(2), names).save(tmp_path / "own.npz")
    assert ot.load_policy(tmp_path / "own.npz").inputs == (FEATURES["tilt"], OWN)
    assert len(named_features("onboard")) == len(FEATURE_SETS["onboard"])
    with pytest.raises(ot.InputError, match="is a list; name its features one by one"):
        named_features(f"{__name__}:SEVERAL")


def test_what_is_made_for_other_features_is_refused(saved):
    """Of another range, of no such name, or of another number of entries."""
    with np.load(saved) as found:
        features, ranges = found["features"], found["ranges"]
    wider = ranges.copy()
    wider[0, 1] = 3.0
    _refused(_changed(saved, ranges=wider), r"made for 'wall_speed' from -1.5 to 3, which is now")
    _refused(_changed(saved, ranges=ranges[1:]), r"ranges has shape \(13, 2\), expected \(14, 2\)")
    unknown = np.array(["wall_sped", *features[1:]])
    _refused(_changed(saved, features=unknown, ranges=None), "did you mean 'wall_speed'")
    fewer = {"features": features[1:], "ranges": None}
    _refused(_changed(saved, **fewer), "takes 32 entries, and its features have 29")


@pytest.mark.parametrize(
    ("arrays", "pattern"),
    [
        ({"activation": "swish"}, r"activation is 'swish' \(choose from: tanh, relu, elu\)"),
        ({"output": "softmax"}, r"output is 'softmax' \(choose from: clip, tanh\)"),
        ({"acting": "os:system"}, r"acting is 'os:system' \(choose from: direct, residual\)"),
        ({"activation": ["tanh", "relu"]}, "size 1"),
        ({"reach": -1.0}, "reach holds numbers that are not larger"),
        ({"extra": 1}, "has unknown arrays: extra"),
        ({"weight_0": np.zeros((31, 16))}, r"mean has shape \(32,\), expected \(31,\)"),
        ({"bias_1": np.zeros(3)}, r"weight_1 has shape \(16, 16\), expected \(16, 3\)"),
        ({"weight_2": np.zeros((16, 5)), "bias_2": np.zeros(5)}, r"gives \(1, 5\) for one robot"),
        ({"weight_1": np.full((16, 16), np.nan)}, "weight_1 holds what is not a number"),
        ({"mean": np.full(32, np.inf)}, "mean holds what is not a number"),
        ({"weight_0": np.full((32, 16), 1e7)}, "weight_0 holds numbers larger than 1e"),
        ({"std": np.zeros(32)}, "std holds numbers that are not larger"),
        ({"bias_0": None}, "lacks arrays: bias_0"),
        ({"features": None}, "lacks arrays: features"),
        ({"weight_0": np.zeros((32, 16, 1))}, r"weight_0 has shape \(32, 16, 1\), expected"),
        ({"weight_0": np.array(["a"])}, "no plain numbers"),
        ({"features": np.zeros(3)}, "no text"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(saved, arrays, pattern):
    _refused(_changed(saved, **arrays), pattern)


def test_a_learner_writes_a_file_by_numpy_alone(tmp_path):
    """What is left out of a file is not normalised, and acts directly."""
    weight, bias = np.full((2, 4), 0.25), np.array([0.1, 0.2, 0.3, 0.0])
    np.savez(tmp_path / "own.npz", features=["roll"], weight_0=weight, bias_0=bias)
    policy = ot.load_policy(tmp_path / "own.npz")
    assert policy.acting is DIRECT
    np.testing.assert_allclose(policy(np.ones((3, 2)))[0], bias + 0.5, rtol=1e-6)


def straight_ahead(entries: np.ndarray) -> np.ndarray:
    return np.tile([0.5, 0.5, 0.5, 0.0], (len(entries), 1))


AHEAD = Policy(straight_ahead, ["tilt"])


def test_a_callable_of_a_users_own_drives(tmp_path):
    """As ``module:Object``, as a file with the same decisions does; it is written to no file."""
    driver(0.5).save(tmp_path / "driver.npz")
    runs = [
        ot.run(
            ot.load_scenario(
                "tee_turn",
                {
                    "run.time_limit": 0.5,
                    "control.kind": "policy",
                    "control.parameters.policy": source,
                },
            )
        )
        for source in (str(tmp_path / "driver.npz"), f"{__name__}:AHEAD")
    ]
    assert runs[0].trajectory.qpos.tobytes() == runs[1].trajectory.qpos.tobytes()
    assert "sha256" in runs[0].scenario.control.parameters
    assert runs[1].scenario.control.parameters.get("sha256") is None
    with pytest.raises(TypeError, match="a file holds an Mlp"):
        AHEAD.save(tmp_path / "none.npz")
    with pytest.raises(ot.PolicyError, match=r"is no ot\.Policy"):
        ot.load_policy(f"{__name__}:straight_ahead")
    with pytest.raises(ot.PolicyError, match="cannot be imported"):
        ot.load_policy("no_such_module:AHEAD", trust=True)
    with pytest.raises(ValueError, match=r"gives \(1, 3\) for one robot"):
        Policy(lambda entries: np.zeros((len(entries), 3)), ["tilt"])


def test_a_conversion_that_files_do_not_name_is_not_written(tmp_path):
    policy = Policy(random_network(1), ["tilt"], Acting("mine"))
    with pytest.raises(ValueError, match="a file names one of: direct, residual"):
        policy.save(tmp_path / "one.npz")
    assert not list(tmp_path.iterdir())


class _Trap:
    """Leaves a file where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_nothing_in_a_file_is_executed(saved, tmp_path):
    trap = tmp_path / "sprung"
    pickled = pickle.dumps(_Trap(trap))
    (tmp_path / "plain.npz").write_bytes(pickled)
    _refused(tmp_path / "plain.npz", "is no policy file, or damaged")
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.array([_Trap(trap)], object), allow_pickle=True)
    with zipfile.ZipFile(saved, "a") as archive:
        archive.writestr("weight_3.npy", buffer.getvalue())
        archive.writestr("bias_3.npy", buffer.getvalue())
    _refused(saved, "Object arrays cannot be loaded")
    assert not trap.exists()


def test_damaged_and_huge_files_are_refused(saved, tmp_path):
    data = saved.read_bytes()
    for part in (0, 10, len(data) // 2, len(data) - 1):
        saved.write_bytes(data[:part])
        _refused(saved, "is no policy file, or damaged")
    flipped = bytearray(data)
    flipped[len(data) // 3] ^= 0xFF
    saved.write_bytes(flipped)
    with pytest.raises(ot.PolicyError):
        ot.load_policy(saved)
    saved.write_bytes(npz_of({"mean": np.zeros(MAX_POLICY_BYTES + 1, np.uint8)}))
    assert saved.stat().st_size < 100_000
    _refused(saved, f"unpacks to more than {MAX_POLICY_BYTES} bytes")
    with saved.open("wb") as file:
        file.truncate(MAX_POLICY_BYTES + 1)
    _refused(saved, "is too large")
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(header, shape)
    with zipfile.ZipFile(saved, "w") as archive:
        for name in ("mean", "weight_0", "bias_0", "features"):
            archive.writestr(f"{name}.npy", header.getvalue())
    # Where the memory suffices, the rows are missed instead.
    _refused(saved, "is damaged: Unable to allocate|EOF: reading array data")
    _refused(tmp_path, "no such file, nor a shipped policy")
    _refused(tmp_path / "none.npz", "no such file, nor a shipped policy")


def test_a_policy_and_its_network_have_to_fit():
    with pytest.raises(ValueError, match="takes 7 entries, and its features have 1"):
        Policy(random_network(7), ("tilt",))
    with pytest.raises(TypeError, match="network: is None"):
        Policy(None, ("tilt",))
    for features in (FEATURES["tilt"], FEATURE_SETS["onboard"]):
        with pytest.raises(TypeError, match=r"the feature '\w+' itself; a name belongs here"):
            Policy(random_network(32), features)


def test_networks_that_are_too_deep_or_too_wide_are_refused():
    """Those at the bounds of layers and widths are taken."""
    for layers in (MAX_LAYERS, MAX_LAYERS + 1):
        weights, biases = [np.zeros((1, 1))] * layers, [np.zeros(1)] * layers
        if layers > MAX_LAYERS:
            with pytest.raises(ValueError, match="as many of each, 1 to 8"):
                Mlp(weights, biases)
        else:
            assert Mlp(weights, biases).widths == (1,) * (layers + 1)
    for width in (MAX_WIDTH, MAX_WIDTH + 1):
        weights, biases = [np.zeros((1, width)), np.zeros((width, 1))], [np.zeros(width), [0.0]]
        if width > MAX_WIDTH:
            with pytest.raises(ValueError, match="widths go from 1 to 2048"):
                Mlp(weights, biases)
        else:
            assert Mlp(weights, biases).widths == (1, width, 1)


def test_a_policy_has_the_names_of_single_features(tmp_path):
    """Though the set was named; a file needs a name for each."""
    policy = Policy(random_network(32), ("onboard",))
    assert policy.features == named_features("onboard")
    policy.save(tmp_path / "one.npz")
    assert ot.load_policy(tmp_path / "one.npz").features == policy.features


def test_entries_of_another_shape_are_refused():
    policy = random_policy("preview")
    for shape in ((53,), (2, 52), (1, 1, 53)):
        with pytest.raises(ValueError, match=r"needs \(n, 53\)"):
            policy(np.zeros(shape))


def test_a_policy_is_shown_in_one_line(saved):
    shown = "Policy(Mlp(32-16-16-4, tanh, clip), 14 features, direct"
    assert repr(random_policy()) == f"{shown})"
    assert re.fullmatch(re.escape(shown) + ", sha256 [0-9a-f]{12}\\)", repr(ot.load_policy(saved)))


def test_the_command_tells_what_a_file_says(saved, capsys, monkeypatch):
    def status(*arguments: str) -> int:
        monkeypatch.setattr("sys.argv", ["omnitrack", "policies", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    assert status(str(saved)) == 0
    assert "32-16-16-4, tanh" in capsys.readouterr().out
    assert status(str(saved), "--json") == 0
    assert json.loads(capsys.readouterr().out)["network"] == "Mlp(32-16-16-4, tanh, clip)"
    assert status() == 0
    saved.write_bytes(b"no npz")
    assert status(str(saved)) == 2
    assert "is no policy file" in " ".join(capsys.readouterr().err.split())
