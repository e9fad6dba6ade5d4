"""Forces on a robot's tail: a pull that grows, and what it does to any kind of robot."""

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.scenario import validate


class Slug(ot.Robot):
    """A capsule of 2 kg that nothing drives."""

    @property
    def nominal_bore(self):
        return 0.16

    @property
    def length(self):
        return 0.2

    def spec(self):
        spec = mujoco.MjSpec()
        slug = spec.worldbody.add_body(name="chassis")
        slug.add_freejoint()
        slug.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.06, 0.04, 0], mass=2.0)
        return spec


def in_straight(kind, changes=None, **pull):
    """A robot without weight in a straight of 4 m."""
    data = {
        "robot": {"kind": kind},
        "pipes": [{"kind": "straight", "length": 4.0}],
        "start": {"distance": 2.0},
        "world": {"gravity": [0, 0, 0]},
        "pull": pull,
        "control": {"kind": "jacobian" if kind == "omnitrack" else "own"},
        "run": {"time_limit": 1.0},
        "monitor": {"slide_back": 5.0, "patience_time": 2.0},
    }
    return ot.override(validate(data), changes or {})


def bytes_of(result):
    trajectory: Trajectory = result.trajectory
    return [trajectory.qpos.tobytes(), *(trajectory[name].tobytes() for name in trajectory)]


def test_a_pull_accelerates_what_nothing_holds():
    """Backward by F t² / 2 m of a steady pull, and by R t³ / 6 m of one that grows."""
    for pull, rate in ((0.8, 0.0), (0.0, 0.8)):
        run = ot.run(in_straight(Slug().kind, force=pull, rate=rate))
        way = pull / 2 / 2 + rate / 6 / 2
        assert run.trajectory["distance"][-1] == pytest.approx(2.0 - way, abs=0.02 * way)
        assert run.metrics["tail_force_max_n"] == pytest.approx(pull + rate, rel=0.02)
        assert run.metrics["pull_held_n"] == pull


@pytest.mark.parametrize("kind", ["omnitrack", "presser", "inchworm"])
def test_the_pull_acts_at_the_tail(kind):
    """The plant's wrench is that of a force at the tail, also of a robot that lies askew."""
    sim = ot.Simulation([in_straight(kind, force=5.0)])
    for _ in range(20):
        sim.step()
    data, model, robot = sim.data(0), sim.model, sim.setup.robot
    mujoco.mj_forward(model, data)
    wrench, wanted = np.zeros(model.nv), np.zeros(model.nv)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, robot.tail)
    body = model.body(robot.chassis).id if site < 0 else model.site_bodyid[site]
    force, torque = np.split(data.xfrc_applied[body], 2)
    mujoco.mj_applyFT(model, data, force, torque, data.xipos[body], body, wrench)
    chassis = data.xmat[body].reshape(3, 3)
    tail = data.xpos[body] - robot.length / 2 * chassis[:, 2] if site < 0 else data.site_xpos[site]
    mujoco.mj_applyFT(model, data, np.array([0, 0, -5.0]), np.zeros(3), tail, body, wanted)
    assert wrench == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize(("kind", "press"), [("omnitrack", 3 * 25.0), ("presser", 3 * 40.0)])
def test_friction_and_springs_bound_the_pull_that_a_robot_holds(kind, press):
    """It moves until the pull exceeds friction times the forces of the springs, within 5 %, and
    the reason says what pulled."""
    changes = {"start.distance": 0.3, "run.time_limit": 60.0, "world.friction": 0.3}
    run = ot.run(in_straight(kind, changes, rate=8.0), no_load=False)
    assert run.metrics["pull_held_n"] == pytest.approx(0.3 * press, rel=0.05)
    assert not run.success
    assert f"pulled back by {run.trajectory['tail_force'][-1]:.3g} N" in run.reason


def test_a_pull_is_the_same_alone_and_in_a_batch_and_not_recorded_without():
    """Bytes do not depend on the batch; without a pull there is no channel of it."""
    pulled = [in_straight("presser", {"world.friction": f}, rate=9.0) for f in (0.3, 0.8)]
    both = ot.run_batch(pulled)
    assert [bytes_of(run) for run in both] == [bytes_of(ot.run(each)) for each in pulled]
    free = ot.run(in_straight("presser"))
    assert "tail_force" not in free.trajectory
    assert "pull_held_n" not in free.metrics
