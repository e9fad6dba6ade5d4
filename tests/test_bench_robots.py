"""The benchmark of calibrated robots: logs as strangers keep them, and doubt parted from chance."""

import sys
from pathlib import Path

import numpy as np
import pytest

import omnitrack_sim as ot

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from bench_robots import GAP, TURNS, jumped, spoilt, spread_of, strangers_rows, written

TIME = np.arange(0.0, 3.0, 0.02)
LOG = ot.Log(
    "pull",
    TIME,
    {
        "tail_force_max": 20.0 * TIME,
        **{f"motor_current_{i}": 0.1 * i + 0.05 * TIME for i in (1, 2, 3)},
    },
)


def test_a_strangers_log_reads_as_the_log_itself(tmp_path):
    """Other names, units and decimal commas lead to the same values; what was not read is not."""
    read = ot.load_log(written(tmp_path, strangers_rows(LOG)))
    assert not ((read.time > GAP[0] + 1e-6) & (read.time < GAP[1] - 1e-6)).any()
    of = np.searchsorted(TIME, read.time - 1e-6)
    np.testing.assert_allclose(read.time, TIME[of], atol=1e-4)
    for name, values in LOG.values.items():
        known = np.isfinite(read.values[name])
        np.testing.assert_allclose(read.values[name][known], values[of][known], atol=1e-3, rtol=0)
    assert np.isfinite(read.values["tail_force_max"]).mean() == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(jumped, r"the clock jumps at line \d+"), (spoilt, r"line 41: .* is no number")],
)
def test_a_log_that_cannot_be_read_is_refused_with_its_line(spoil, words, tmp_path):
    """A clock that jumps, or a word among the numbers, names the line of the file."""
    with pytest.raises(ot.InputError, match=words):
        ot.load_log(written(tmp_path, spoil(strangers_rows(LOG))))


def test_the_spread_of_rates_is_parted_from_chance():
    """Sets of parameters that pass alike leave no doubt; sets that pass or fail leave all of it."""
    assert spread_of([TURNS // 2] * 6)[:2] == (0.5, 0.0)
    rate, between, chance = spread_of([0, TURNS] * 50)
    assert rate == 0.5
    assert between == pytest.approx(np.sqrt(0.25 - 0.25 / TURNS), rel=0.02)
    assert chance == pytest.approx(np.sqrt(0.25 / TURNS / 100))
