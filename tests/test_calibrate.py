"""Calibration: logs are read or refused, parameters found again, and doubt is told as it is."""

from __future__ import annotations

import json
import math
import re
import tomllib
from inspect import signature

import numpy as np
import pytest
from mcap.writer import Writer

import omnitrack_sim as ot
from omnitrack_sim.calibration import fit as fitting
from omnitrack_sim.calibration.calibration import FittedColumn
from omnitrack_sim.calibration.compare import Target, targets_of
from omnitrack_sim.calibration.contradictions import contradictions_of
from omnitrack_sim.calibration.doubt import (
    draw_within,
    foreseeable,
    independent_count,
    indistinct_of,
    information_of,
    noise_of,
    smoothed,
)
from omnitrack_sim.calibration.fit import MODEL_ERROR
from omnitrack_sim.calibration.model_error import ModelError, effects_of
from omnitrack_sim.calibration.page import page_of
from omnitrack_sim.calibration.parameters import Parameter, parameters_of
from omnitrack_sim.calibration.units import unit_of
from omnitrack_sim.cli import common
from omnitrack_sim.cli.calibrate import calibrate as command
from omnitrack_sim.robots.tail import TAIL_CHANNELS
from omnitrack_sim.show.mcap import to_mcap
from omnitrack_sim.trials.sweep_file import resolve

FORCE, GRAVITY = "pull.force", "world.gravity.2"
NOISE = {"distance": 1e-3, "motor_torque_1": 0.005, "motor_torque_2": 0.005, "belt_speed_1": 1e-3}
BASE = {"run.time_limit": 1.2, "pull.force": 4.0}


@pytest.fixture(scope="module")
def climb():
    """Up a vertical pipe for 1.2 s, with a pull at the tail."""
    return ot.load_scenario("vertical_climb", BASE)


@pytest.fixture(scope="module")
def pulled(climb):
    """What was recorded of such a run under a pull of 6 N."""
    return ot.run(ot.override(climb, {FORCE: 6.0}), no_load=False).trajectory


def noisy(trajectory, seed, noise=NOISE):
    """Return a log of some columns of a run, with white noise."""
    rng = np.random.default_rng(seed)
    columns = {name: values for name, _, values in trajectory.columns() if name in noise}
    values = {k: v + rng.normal(0, noise[k], len(v)) for k, v in columns.items()}
    return ot.Log("climb", trajectory.time, values)


@pytest.fixture(scope="module")
def found(climb, pulled):
    """The pull, fitted to a noisy log of that run."""
    return ot.calibrate([noisy(pulled, 1)], climb, [FORCE])


def test_a_fit_finds_the_value_that_a_log_was_made_with(found):
    """Within three of its standard deviations, which are small against what it was off by."""
    assert abs(found.changes[FORCE] - 6.0) < 3 * found.std[0] < 1.0
    assert found.contradictions == []
    assert found.indistinct == []


@pytest.mark.long
def test_a_fit_is_the_same_again(found, climb, pulled):
    """To the last bit, on one thread and on two."""
    again = ot.calibrate([noisy(pulled, 1)], climb, [FORCE], threads=1)
    assert again.to_toml() == found.to_toml()


@pytest.mark.long
def test_doubt_agrees_with_the_scatter_over_noise(climb, pulled):
    """Values under other draws of the noise scatter as the standard deviation of each fit says."""
    loud = dict.fromkeys(NOISE, 0.02)
    fits = [ot.calibrate([noisy(pulled, seed, loud)], climb, [FORCE]) for seed in range(12)]
    scatter = np.std([fit.values[0] for fit in fits], ddof=1)
    # chi-square of 11 degrees of freedom, 99.8 %
    assert 0.45 < scatter / np.mean([fit.std[0] for fit in fits]) < 1.7


@pytest.mark.parametrize("part", [0.005, 0.05])
def test_no_log_tells_a_parameter_better_than_the_model_is_right(part, climb, pulled):
    """One without noise tells it to that part of its size, or of a column that it changes less; two
    together to less by the root of 2."""
    quiet = noisy(pulled, 1, dict.fromkeys(NOISE, 1e-9))
    one = ot.calibrate([quiet], climb, [FORCE], model_error=part)
    two = ot.calibrate([quiet, quiet], climb, [FORCE], model_error=part)
    assert part < one.std[0] / one.values[0] < 4 * part  # the weight is 1.6 times the pull
    assert two.std[0] == pytest.approx(one.std[0] / 2**0.5, rel=0.05)


@pytest.mark.long
def test_doubt_covers_the_error_of_a_model_in_each_log(climb):
    """Logs of pairs of robots whose loads are off by a known part each, normally drawn: what is
    fitted to them is off by what is stated, in the mean square over eight pairs."""
    part, rng, errors = 0.05, np.random.default_rng(3), []
    load = 6.0 + 9.81 * climb.robot.mass
    for _ in range(8):
        pulls = 6.0 + load * part * rng.normal(size=2)
        runs = [ot.run(ot.override(climb, {FORCE: pull}), no_load=False) for pull in pulls]
        logs = [noisy(run.trajectory, seed) for seed, run in enumerate(runs)]
        fit = ot.calibrate(logs, climb, [FORCE], model_error=part)
        errors.append((fit.values[0] - 6.0) / fit.std[0])
    # chi-square of 8 degrees of freedom, 99.8 %; a fit without it would be off by hundreds
    assert 0.1 < np.mean(np.square(errors)) < 3.3


def test_slopes_that_are_chance_tell_nothing():
    """Those of a column that changes at random with each parameter add no information; a slope
    that both share is kept."""
    rng = np.random.default_rng(0)
    slope, chance = rng.normal(size=(400, 1)), 3 * rng.normal(size=(400, 2))
    told = information_of(slope + chance, np.full((400, 2), 3.2))
    strengths = np.linalg.eigvalsh(told)
    assert strengths[0] == pytest.approx(0.0, abs=1e-9)
    assert strengths[1] < 0.5 * 2 * 400
    clean = information_of(slope + np.zeros(2), np.zeros((400, 2)))
    np.testing.assert_allclose(clean, np.full((2, 2), float(slope.ravel() @ slope.ravel())))


def test_samples_that_are_chance_count_less():
    """The noise of a column is that of its foreseeable samples, whatever the others do; running
    means keep the mean."""
    rng = np.random.default_rng(0)
    chance = np.repeat([0.0, 25.0], 500)
    residual = rng.normal(size=1000) * np.sqrt(1 + chance)
    assert noise_of(residual, 1 + chance) == pytest.approx(1.0, abs=0.1)
    squares, time = rng.random(400), 0.02 * np.arange(400)
    means = smoothed(squares, time)
    assert means[100:300].mean() == pytest.approx(squares[100:300].mean(), rel=0.03)
    assert means[100] == pytest.approx(squares[75:126].mean())
    np.testing.assert_allclose(smoothed(np.ones(5), time[:5]), 1.0)


def test_samples_whose_slope_may_be_chance_do_not_count():
    """Where slope and uncertainty are alike; smooth ones count all, and so do those of no slope."""
    slopes, chances = np.array([4.0, 1.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.1, 0.0])
    np.testing.assert_allclose(foreseeable(slopes, chances), [1.0, 0.0, 0.7, 1.0])


def test_what_a_parameter_changes_is_told_by_the_samples_that_count():
    """Of a column, half of which is chance, it is as if that half were not there."""
    slopes = np.random.default_rng(0).normal(size=(100, 2)) * [3.0, 0.1]
    noisy = np.vstack([slopes, 1e3 * slopes])
    weights = np.repeat([2.0, 0.0], 100)
    expected = np.sqrt(np.mean(slopes**2, axis=0))
    np.testing.assert_allclose(effects_of(noisy, weights), expected)


TIME = np.linspace(0.0, 10.0, 200)


class _Formulas:
    """Runs that follow a formula, and a log of it with noise.

    Args:
        course: of values (p,) to columns (k, m).
        true: values that the log is made with.
        shift: samples by which it is late.
        seed: of its noise.
    """

    def __init__(self, course, true, *, shift=0, seed=0):
        self.course, self.known, self.notes = course, np.zeros((0, len(true))), []
        clean = np.roll(course(np.array(true)), shift, axis=-1)
        measured = clean + np.random.default_rng(seed).normal(0.0, 0.01, clean.shape)
        channels = [ot.Channel(f"force_{k}", (), "N", "a force") for k in range(len(clean))]
        self.targets = [
            Target(0, channel.name, channel, TIME, values, 0.01)
            for channel, values in zip(channels, measured, strict=True)
        ]
        self.logs = [ot.Log("log", TIME, {})]
        self.parameters = [
            Parameter(f"number_{i}", 1.0, 0.2, 5.0, "", "assumed", 1.0) for i in range(len(true))
        ]

    def points(self, sets):
        """Return what comes of sets of values (k, p)."""
        self.known = np.unique(np.vstack([self.known, sets]), axis=0)
        ends = [(10.0, ot.Outcome.REACHED_GOAL)]
        return [fitting.Point([*self.course(values)], ends) for values in sets]


def _rippled(values):
    """Return a column that tells the product of two numbers, and one that hardly tells their ratio,
    with ripples over the numbers as fine as those of contacts."""
    a, b = values
    ripple = 0.003 * np.sin(np.outer([1.0, 1.3], 4e3 * a + 5e3 * b + np.arange(200)))
    return np.stack([a * b * np.sin(TIME), 0.1 * a / b * np.cos(TIME)]) + ripple


def _pulsed(values):
    """Return a steady column with a pulse of ten times its height, two samples wide."""
    return values[:1, None] * (1.0 + 10.0 * np.exp(-(((TIME - 5.0) / 0.1) ** 2)))


def test_ripples_tell_nothing_of_what_logs_hardly_tell():
    """A ratio is off by what is stated, and stated as well as its course allows, though short steps
    change it by less than its ripples."""
    errors, stated, slope = [], [], np.array([1 / 1.2, -1 / 0.85])
    for seed in range(20):
        found = fitting._Fit(_Formulas(_rippled, [1.2, 0.85], seed=seed), 0.01, None).result()
        errors.append(slope @ (found.values - [1.2, 0.85]))
        stated.append(np.sqrt(slope @ found.covariance @ slope))
    assert 0.4 < np.sqrt(np.mean(np.square(errors) / np.square(stated))) < 1.5
    assert np.median(stated) < 0.03


def test_a_jump_that_comes_a_sample_late_tells_little():
    """What is fitted is the level before and after it, to what is stated."""
    found = fitting._Fit(_Formulas(_pulsed, [1.2], shift=1), 0.01, None).result()
    assert abs(found.values[0] - 1.2) < 2 * found.std[0]
    assert found.std[0] < 0.025


def test_a_log_tells_nothing_less_than_nothing():
    """Of three parameters with one effect, and a model's error that is huge in one of them."""
    rng = np.random.default_rng(0)
    slopes = 1000 * rng.normal(size=(50, 1)) * [1.0, 0.9, 0.04] + rng.normal(size=(50, 3))
    error = ModelError.of(0.01, slopes, np.array([[1.0, 1.0, 0.0]]))
    assert np.linalg.eigvalsh(error.bounded(slopes.T @ slopes)).min() > -1e-12


@pytest.mark.long
def test_a_pull_until_the_belts_slip_tells_friction():
    """With currents that stick and slip by chance once they do."""
    scenario = ot.load_scenario("calibration/pull")
    run = ot.run(ot.override(scenario, {"world.friction": 0.72}), no_load=False)
    noise = {"tail_force_max": 0.5, **{f"motor_current_{i}": 0.005 for i in (1, 2, 3)}}
    fit = ot.calibrate([noisy(run.trajectory, 7, noise)], scenario, ["world.friction"])
    assert abs(fit.values[0] - 0.72) < 2.5 * fit.std[0] < 0.03


def test_parameters_that_cannot_be_told_apart_are_named(climb, pulled):
    """In a vertical pipe a pull at the tail and gravity load the robot alike."""
    fit = ot.calibrate([noisy(pulled, 2)], climb, {FORCE: None, GRAVITY: (-14.0, -6.0)})
    widest = fit.indistinct[0]
    assert set(widest.weights) == {FORCE, GRAVITY}
    assert abs(fit.correlation[0, 1]) > 0.9
    assert "cannot tell" in widest.text


def test_a_log_of_a_slipping_run_contradicts_a_fit_that_cannot_slip(climb, pulled):
    """Its belts are met, and its way falls behind from some time on."""
    log = noisy(pulled, 3)
    way = log.values["distance"].copy()
    late = log.time > 0.6
    way[late] -= 0.7 * (way[late] - way[late][0])
    slipped = ot.Log("slipping", log.time, {**log.values, "distance": way})
    fit = ot.calibrate([slipped], climb, [FORCE])
    assert any("distance is not met" in text and "slips" in text for text in fit.contradictions)


def test_what_is_known_before_follows_from_where_a_value_is_from():
    """A tenth of values that are published or derived from such, a quarter of inferred ones, a
    factor of two of others; of a range that is given, its own spread, and that is the most."""
    scenario = ot.load_scenario("straight")
    parts = {
        "robot.spring_stiffness": ("published", 0.1),
        "robot.lug_radius": ("derived", 0.1),
        "robot.reach": ("inferred", 0.25),
        "robot.contact_time": ("numerical", math.log(2)),
        "world.friction": ("unstated", math.log(2)),
    }
    for one in parameters_of(list(parts), [scenario]):
        provenance, part = parts[one.path]
        assert one.provenance == provenance
        assert one.prior == pytest.approx(part * one.start), one.path
    (given,) = parameters_of({"robot.reach": (0.095, 0.097)}, [scenario])
    assert given.prior == pytest.approx(0.002 / math.sqrt(12))
    (narrow,) = parameters_of(["robot.scale"], [scenario])
    assert narrow.prior == pytest.approx((narrow.high - narrow.low) / math.sqrt(12))


def test_the_page_of_a_fit_has_a_row_of_each_parameter(found):
    """Its value with the standard deviation, what that is of the value, and what was before."""
    page = page_of(found, "pull.toml")
    table = page.partition("<tbody>")[2].partition("</tbody>")[0]
    cells = re.findall("<td.*?>(.*?)</td>", table)
    (value,), (std,) = found.values, found.std
    assert cells[:4] == [FORCE, f"{value:.6g}", f"{std:.2g}", f"{100 * std / value:.2g} %"]
    assert cells[4].startswith(f"{found.parameters[0].start:.6g} (")


def test_numbers_of_a_fits_file_have_nine_digits(found):
    """All of them: they read back as they are, and no more is known."""

    def numbers(data):
        if isinstance(data, dict | list):
            for each in data.values() if isinstance(data, dict) else data:
                yield from numbers(each)
        elif isinstance(data, float):
            yield data

    told = list(numbers(tomllib.loads(found.to_toml())))
    assert len(told) > 10
    assert told == [float(f"{value:.9g}") for value in told]


def test_angles_differ_by_the_shorter_way():
    """Those that wrap; a tilt of a whole turn more is another one."""
    channels, time = ot.Omnitrack().channels, np.linspace(0.0, 1.0, 9)
    for name, apart in (("theta5", 0.2), ("tilt", 0.2 - 2 * math.pi)):
        target = Target(0, name, channels[name], time, np.full(9, -3.1), 0.0)
        residual = target.residual(np.full(9, -3.1 - 0.2 + 2 * math.pi))
        assert residual == pytest.approx(np.full(9, apart))


def test_what_no_figure_would_show_is_no_contradiction():
    """A tilt of a millionth of a radian that the fit does not meet; one of two degrees is one."""
    channel, time = ot.Omnitrack().channels["tilt"], np.linspace(0.0, 1.0, 50)
    for size, count in ((1e-6, 0), (0.035, 1)):
        log = ot.Log("still", time, {"tilt": size * np.sin(9 * time)})
        ((target,), _) = targets_of(0, log, [channel], 0.02)
        column = FittedColumn(
            *("still", "tilt", "rad", time, target.values, np.zeros(50)), 50.0, 0.0, target.span
        )
        assert len(contradictions_of([column], [], [], [], np.zeros(0), [])) == count


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.5])
def test_a_column_is_not_met_beyond_a_tenth_of_its_range_and_three_times_its_noise(noise):
    """The larger of the two decides; the text tells how many times the noise it is."""
    time = np.linspace(0.0, 1.0, 50)
    measured = np.sin(9 * time)
    limit = max(0.1 * np.ptp(measured), 3 * noise)
    for off, count in ((0.99, 0), (1.01, 1)):
        column = FittedColumn(
            *("log", "tilt", "rad", time, measured, measured - off * limit), 50.0, noise
        )
        told = contradictions_of([column], [], [], [], np.zeros(0), [])
        assert len(told) == count
        times = f", {off * limit / noise:.3g} times its noise" if noise else f"by {off * limit:.3g}"
        assert all(times in text for text in told)


def test_what_was_saved_is_read_back(found, tmp_path):
    """Values, covariance and ranges; `--set @FILE` takes the values alone, and a page stands by."""
    file, page = found.save(tmp_path / "mine.toml")
    again = ot.load_calibration(file)
    np.testing.assert_allclose(again.values, found.values, rtol=1e-8)
    np.testing.assert_allclose(again.covariance, found.covariance, rtol=1e-8)
    assert again.fit == found.fit
    assert again.bounds[0] == pytest.approx(found.bounds[0])
    assert common.settings_of(f"@{file}") == again.changes
    assert page.read_text().count("<svg") == len(found.columns) == len(NOISE)


def test_a_sweep_draws_robots_from_a_calibration(found, tmp_path):
    """One column a parameter, with the spread of its doubt, and the file's contents in its hash."""
    file, _ = found.save(tmp_path / "mine.toml")
    table = {"name": "s", "base": "vertical_climb", "samples": 64, "sampling": "sobol"}
    table |= {"axes": [{"kind": "calibration", "file": file.name}], "set": {"pull.force": 1.0}}
    with pytest.raises(ot.SweepError, match=r"set by axes\.0 too"):
        resolve(table, tmp_path)
    del table["set"]
    twice = {**table, "axes": [{**table["axes"][0], "path": FORCE}]}
    with pytest.raises(ot.SweepError, match=r"axes\.0\.path: stands in the file"):
        resolve(twice, tmp_path)
    sweep = resolve({**table, "set": {"pull.rate": 0.1}}, tmp_path)
    values = np.array(sweep.trials()[FORCE])
    assert values.mean() == pytest.approx(found.values[0], abs=0.1 * found.std[0])
    assert values.std() == pytest.approx(found.std[0], rel=0.1)
    again = ot.Sweep.model_validate(json.loads(json.dumps(sweep.data())))
    assert again.trials() == sweep.trials()
    assert again.hash == sweep.hash


def test_draws_have_the_covariance_and_stay_within():
    """Far from the ends; near one they are cut there."""
    points = np.random.default_rng(0).random((20000, 2))
    covariance = np.array([[0.04, 0.03], [0.03, 0.09]])
    wide = draw_within(points, np.ones(2), covariance, np.full(2, -9.0), np.full(2, 9.0))
    np.testing.assert_allclose(np.cov(wide.T), covariance, atol=2e-3)
    low, high = np.array([1.1, 0.5]), np.array([1.2, 2.0])
    cut = draw_within(points, np.ones(2), covariance, low, high)
    assert (cut >= low).all()
    assert (cut <= high).all()
    assert len(np.unique(cut[:, 0])) > 19000


def test_correlated_residuals_count_less():
    """White ones count each, those of first order by (1 - a) / (1 + a), an offset once."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=4000)
    assert independent_count(white) > 0.9 * 4000
    slow = np.zeros(4000)
    for i in range(1, 4000):
        slow[i] = 0.9 * slow[i - 1] + white[i]
    assert independent_count(slow) == pytest.approx(4000 * 0.1 / 1.9, rel=0.4)
    assert independent_count(np.ones(4000)) == pytest.approx(1, abs=1e-2)


def test_the_open_direction_is_that_of_the_product():
    """Where only x y is known, x up with y down is open."""
    slope = np.array([[1.0, 1.0]]) / 0.01
    (one,) = indistinct_of(["x", "y"], slope.T @ slope)
    assert one.weights["x"] * one.weights["y"] == pytest.approx(-0.5)
    assert one.text.startswith("the logs cannot tell")


@pytest.mark.parametrize(
    ("text", "factor"),
    [("mm/s", 1e-3), ("N cm", 1e-2), ("rpm", np.pi / 30), ("kg m²", 1), ("mA", 1e-3), ("", 1)],
)
def test_units_lead_to_si(text, factor):
    """Each by its factor."""
    assert unit_of(text, "x").factor == pytest.approx(factor)


def test_a_strangers_log_is_read(climb, pulled, tmp_path):
    """Other names, units, delimiter and decimal commas, empty cells: the same numbers."""
    rows = ["# logger 3", "t_ms;odo [mm];note"]
    for time, way in zip(pulled.time, pulled["distance"], strict=True):
        way = "" if 0.3 < time < 0.5 else f"{1e3 * way:.6f}".replace(".", ",")
        rows.append(f"{1e3 * time:.3f}".replace(".", ",") + f";{way};ok")
    (tmp_path / "run.csv").write_text("\n".join(rows))
    table = 'file = "run.csv"\n[time]\ncolumn = "t_ms"\nunit = "ms"\n'
    (tmp_path / "run.toml").write_text(table + '[columns]\ndistance = { column = "odo [mm]" }\n')
    log = ot.load_log(tmp_path / "run.toml")
    known = np.isfinite(log.values["distance"])
    assert 0 < (~known).sum() < 20
    np.testing.assert_allclose(log.time, pulled.time, atol=1e-6)
    np.testing.assert_allclose(log.values["distance"][known], pulled["distance"][known], atol=1e-8)


def test_a_log_of_mcap_is_read(climb, tmp_path):
    """Numbers and times are those of the run that was exported; zeros are no gaps."""
    run = ot.run(ot.override(climb, {"run.time_limit": 0.2}), no_load=False)
    (tmp_path / "run.mcap").write_bytes(to_mcap(run))
    names = {"way": "distance", "leg": "leg"}
    rows = [f"{k} = {{ column = '/channels/{v}.value' }}" for k, v in names.items()]
    columns = "\n".join(rows)
    (tmp_path / "run.toml").write_text(f'file = "run.mcap"\n[columns]\n{columns}\n')
    log = ot.load_log(tmp_path / "run.toml")
    np.testing.assert_allclose(log.time, run.trajectory.time, atol=1e-8)
    np.testing.assert_array_equal(log.values["way"], run.trajectory["distance"])
    np.testing.assert_array_equal(log.values["leg"], run.trajectory["leg"])
    (tmp_path / "run.mcap").write_bytes(b"no such format")
    with pytest.raises(ot.InputError, match="is damaged, or no file of MCAP"):
        ot.load_log(tmp_path / "run.toml")


@pytest.mark.parametrize("ending", ["db3", "mcap"])
def test_a_bag_of_ros_is_a_log(ending, tmp_path):
    """Numbers and lists of numbers in messages become columns, in either storage of ROS 2."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    joints, header, stamp = (store.types[kind] for kind in kinds)
    plugin = {"db3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}[ending]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as bag:
        topic = bag.add_connection("/belts", kinds[0], typestore=store)
        for k in range(20):
            turned, none = np.array([0.1 * k, -0.2 * k]), np.zeros(0)
            message = joints(header(stamp(k, 0), "base"), ["a", "b"], turned, none, none)
            bag.write(topic, 10_000_000 * k + 5, store.serialize_cdr(message, kinds[0]))
    name = next((tmp_path / "bag").glob(f"*.{ending}")).name
    (tmp_path / "run.toml").write_text(
        f'file = "bag/{name}"\n[columns]\nroll_2 = {{ column = "/belts.position.1" }}\n'
    )
    log = ot.load_log(tmp_path / "run.toml")
    np.testing.assert_allclose(log.time, 0.01 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose(log.values["roll_2"], -0.2 * np.arange(20))
    (tmp_path / "bag" / "metadata.yaml").write_text("no: bag")
    (tmp_path / "bag" / name).write_bytes(b"no such format")
    with pytest.raises(ot.InputError, match="is damaged, or no"):
        ot.load_log(tmp_path / "run.toml")


def test_the_time_of_an_mcap_is_since_its_first_message(tmp_path):
    """Whatever the clock's epoch is: nanoseconds since 1970 leave no digit for a millisecond."""
    with (tmp_path / "bag.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("odometry", "jsonschema", b"{}")
        channel = writer.register_channel("/way", "json", schema)
        for step in range(4):
            time = 1_764_000_000_123_456_789 + 1_000_001 * step
            writer.add_message(channel, time, json.dumps({"value": 0.1 * step}).encode(), time)
        writer.finish()
    (tmp_path / "bag.toml").write_text(
        'file = "bag.mcap"\n[columns]\ndistance = { column = "/way.value" }\n'
    )
    log = ot.load_log(tmp_path / "bag.toml")
    np.testing.assert_allclose(log.time, 1.000001e-3 * np.arange(4), rtol=1e-12)
    np.testing.assert_array_equal(log.values["distance"], 0.1 * np.arange(4))


def test_the_csv_of_an_exported_run_is_a_log_of_all_its_channels(climb, tmp_path):
    """Each channel's columns have the names of the trajectory's, and its numbers."""
    run = ot.run(ot.override(climb, {"run.time_limit": 0.2}), no_load=False)
    log = ot.load_log(ot.export_result(run, tmp_path / "run.csv"))
    for name, _, values in run.trajectory.columns():
        if name not in ("time", "phase"):
            np.testing.assert_allclose(log.values[name], np.asarray(values, float), rtol=1e-6)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["0,1", "0.1,2", "0.05,3"], "clock goes back at line 4"),
        (["0,1", "0.1,x", "0.2,3"], "line 3: 'x' in the column 'distance' is no number"),
        (["0,1", "0.1,2,7", "0.2,3"], "line 3 has 3 cells"),
        (["0,1", ",2", "0.2,3"], "line 3 has no time"),
        (
            [f"{0.02 * i + 3 * (i > 30)},{0.002 * i}" for i in range(60)],
            "clock jumps at line 33",
        ),
    ],
)
def test_a_damaged_log_is_refused_with_its_line(rows, words, tmp_path):
    """A clock that goes back or jumps, a word for a number, a cell too many, a missing time."""
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["time,distance", *rows]))
    with pytest.raises(ot.InputError, match=words):
        ot.load_log(file)


def test_a_damaged_table_of_a_log_is_named_once(tmp_path):
    """Where it is no TOML, and, for each of its faults, where a key is wrong."""
    table = tmp_path / "run.toml"
    for text, told in (("file = ", f"{table}: is not valid TOML"), ("x = 1\n", f"{table}: x: unk")):
        table.write_text(text)
        with pytest.raises(ot.InputError) as caught:
            ot.load_log(table)
        assert any(line.startswith(told) for line in str(caught.value).splitlines())


def test_a_gap_is_no_jump_of_the_clock(tmp_path):
    """The robot has moved on in it."""
    times = [0.02 * i + 3 * (i > 30) for i in range(60)]
    rows = [f"{time},{0.1 * time}" for time in times]
    (tmp_path / "log.csv").write_text("\n".join(["time,distance", *rows]))
    assert len(ot.load_log(tmp_path / "log.csv").time) == 60


def test_a_fine_log_is_averaged_and_a_coarse_one_kept():
    """A line stays a line, and noise falls with the root of the samples in a period."""
    channel = ot.Omnitrack().channels["distance"]
    time = np.arange(0, 2, 1e-3)
    noise = np.random.default_rng(0).normal(0, 0.01, len(time))
    fine = ot.Log("fine", time, {"distance": 0.1 * time + noise})
    ((target,), _) = targets_of(0, fine, [channel], 0.02)
    assert np.std(target.values - 0.1 * target.time) == pytest.approx(0.01 / 20**0.5, rel=0.3)
    coarse = ot.Log("coarse", time[::100], {"distance": time[::100]})
    ((target,), _) = targets_of(0, coarse, [channel], 0.02)
    assert len(target.time) == 20


@pytest.mark.parametrize(
    ("fit", "words"),
    [
        (["world.fricton"], "did you mean 'friction'"),
        (["robot.motor"], "is a table; name one number in it"),
        (["robot.lugs_per_track"], "a whole number"),
        (["control.align"], "has to be a number"),
        ({"pull.force": (9.0, 10.0)}, "must lie in it"),
        (["pull.rate"], "give a range"),
        ([], "is empty"),
        (["pipes.0.length", "pipes.*.length"], "is fitted by pipes.0.length too"),
    ],
)
def test_what_cannot_be_fitted_is_refused(fit, words, climb, pulled):
    """Before anything is simulated, with the place and the choices."""
    with pytest.raises(ot.InputError, match=words):
        ot.calibrate([noisy(pulled, 1)], climb, fit)


def test_a_column_of_another_kind_is_refused(climb, pulled, tmp_path):
    """A way in kilograms, and a log without any column of the run."""
    rows = [f"{t},{d}" for t, d in zip(pulled.time, pulled["distance"], strict=True)]
    file = tmp_path / "log.csv"
    for head, words in (
        ("distance [kg]", "is in 'kg', another kind of unit than 'm'"),
        ("way", "no column of the"),
    ):
        file.write_text("\n".join([f"time,{head}", *rows]))
        with pytest.raises(ot.InputError, match=words):
            ot.calibrate([file], climb, [FORCE])


def test_a_unit_of_another_kind_is_named_with_those_that_fit():
    """A balance that is read in kilograms was meant in kilograms-force."""
    time = np.arange(0, 1, 0.02)
    log = ot.Log("pull", time, {"tail_force": time}, {"tail_force": "kg"})
    with pytest.raises(ot.InputError, match=r"is in 'kg'.*than 'N' .*did you mean 'kgf'"):
        targets_of(0, log, TAIL_CHANNELS, 0.02)


def test_the_command_takes_the_model_error_that_python_takes():
    """The default stands in the command as well, which is read before anything heavy is loaded."""
    assert signature(command).parameters["model_error"].default == MODEL_ERROR


def test_a_calibration_of_many_parameters_is_read_back(tmp_path):
    """Fifty are kept; more are no calibration that anybody fits."""
    for count in (50, 51):
        rows = [Parameter(f"robot.p{k}", 1.0, 0.0, 2.0, "N", "assumed", 1.0) for k in range(count)]
        made = ot.Calibration(rows, np.ones(count), np.eye(count))
        made.save(tmp_path / f"{count}.toml")
    assert len(ot.load_calibration(tmp_path / "50.toml").fit) == 50
    with pytest.raises(ot.InputError, match="at most 50"):
        ot.load_calibration(tmp_path / "51.toml")


def test_a_passport_draws_the_robots_own_parameters(found):
    """A robot a trial, beside walls, slope and pull; what is not the robot's is left out."""
    own = Parameter("robot.preload", 40.0, 4.0, 400.0, "N", "assumed", 28.0)
    both = [found.parameters[0], own]
    fit = ot.Calibration(both, np.array([6.0, 44.0]), np.diag([1.0, 4.0]))
    plan = ot.PassportPlan.of("presser", courses=["straight"], trials=16, calibration=fit)
    drawn = np.array(plan.sweep.trials()["robot.preload"])
    assert drawn.mean() == pytest.approx(44.0, abs=1.0)
    assert drawn.std() == pytest.approx(2.0, rel=0.3)
    assert plan.hash != ot.PassportPlan.of("presser", courses=["straight"], trials=16).hash
    with pytest.raises(ot.InputError, match="has no parameter"):
        ot.PassportPlan.of("presser", calibration=found)
