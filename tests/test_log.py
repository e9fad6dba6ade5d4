"""MuJoCo's own log: none in the working folder, in any process; somebody's own log stays."""

from __future__ import annotations

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from omnitrack_sim.walls.geoms import new_spec

DIVERGING = """
import omnitrack_sim as ot

scenario = ot.override(ot.load_scenario("straight"), {{"run.time_limit": 0.1}})
sim = ot.Simulation([scenario] * 2, threads={threads})
sim.plant._batch.bind("qvel")[:, 8] = 1e12
sim.advance()
print([str(result.outcome) for result in sim.results()])
"""


def unstable_step() -> None:
    """One step of a small model of the package's that MuJoCo warns about."""
    spec = new_spec("ball")
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(size=[1, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[0] = np.nan
    mujoco.mj_step(model, data)
    assert data.warning.number.sum() == 1


@pytest.mark.parametrize("threads", [1, 2])
def test_a_process_that_diverges_leaves_no_file(tmp_path, threads):
    """Two robots diverge in an empty working folder, on one thread and on two: it stays empty, and
    the warnings, which go to standard error, make the outcome."""
    script = DIVERGING.format(threads=threads)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("diverged") == 2
    assert "The simulation is unstable" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_somebody_asked_for_stays(tmp_path, monkeypatch):
    """A log under a name of its own goes on; the one under MuJoCo's name, asked for again, does
    not."""
    monkeypatch.chdir(tmp_path)
    before = mujoco.MjLogConfig.get()
    config = mujoco.MjLogConfig.get()
    config.logto_console = False
    try:
        for name, left in (("MUJOCO_LOG.TXT", []), ("mine.txt", ["mine.txt"])):
            config.logto_file, config.logfile = True, name
            config.set()
            unstable_step()
            assert [path.name for path in tmp_path.iterdir()] == left
    finally:
        before.set()
