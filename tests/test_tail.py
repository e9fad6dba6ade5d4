"""Forces on a robot's tail: a pull that grows, and the tether that a robot of any kind drags."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.tail import rest
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.tail_load import Tethers


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
        "pull": pull or None,
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


def test_a_drag_pointer_keeps_the_largest_force():
    """The largest force so far rises with the force, stays where it falls, and begins anew."""
    held = {"robot.tether": {"weight": 0.0, "friction": 0.0, "stiffness": 40.0, "length": 0.2}}
    orders = [{"time": 0.0, "speed": 0.06}, {"time": 1.0, "speed": -0.06}]
    changes = {"control.parameters.orders": orders, "run.time_limit": 1.8}
    own = held | changes | {"start.distance": 0.25, "start.axis": [1.0, 0.0, 0.0]}
    base = ot.load_scenario("calibration/climb", own)
    record = ot.run(base).trajectory
    force, largest = record["tail_force"], record["tail_force_max"]
    assert force[-1] < 0.8 * force.max()
    np.testing.assert_allclose(largest, np.maximum.accumulate(force), rtol=0.01)
    sim = ot.Simulation([base], recording=False)
    for _ in range(80):
        sim.step()
    assert sim._tail.max_force[0] > 1.0
    sim.reset([0], [base])
    assert sim._tail.max_force[0] == sim._tail.force[0] == 0.0


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


DOWN = np.array([0.0, 0.0, -9.81])


def way(*kinds, axis=(1, 0, 0), turns=()):
    """A route through straights of 2 m and elbows of 0.24 m, by their first letters."""
    pipes = []
    for i, kind in enumerate(kinds):
        size = {"length": 2.0} if kind == "s" else {"mean_radius": 0.24}
        turn = turns[i] if turns else 0.0
        pipes.append({"kind": "straight" if kind == "s" else "elbow", "turn_deg": turn, **size})
    data = {"pipes": pipes, "start": {"axis": list(axis)}, "robot": {"kind": "presser"}}
    return validate(data | {"control": {"kind": "own"}}).route


@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_bends_amplify_a_tension_by_the_law_of_the_capstan(friction):
    """T0 exp(mu beta), whatever the planes of the bends and the straights between them."""
    tether = ot.Tether(weight=0.0, friction=friction, tension=3.0)
    nodes = tether.tensions(way(*"sesee", turns=[0, 30, 0, 200, 90]).segments, DOWN)
    assert nodes[-1, 1] == pytest.approx(3.0 * np.exp(friction * 1.5 * np.pi), rel=1e-6)
    assert nodes[-1, 2] == pytest.approx(3.0 * np.exp(-friction * 1.5 * np.pi), rel=1e-6)


@pytest.mark.parametrize("slope", [-70, -10, 0, 25, 90])
def test_a_straight_drags_by_weight_and_friction_with_its_slope(slope):
    """w L (mu cos a + sin a), and never pushes; sliding back it is w L (sin a - mu cos a)."""
    cos, sin = np.cos(np.radians(slope)), np.sin(np.radians(slope))
    nodes = ot.Tether(weight=0.7, friction=0.4).tensions(
        way("s", axis=(cos, 0, sin)).segments, DOWN
    )
    assert nodes[-1, 1] == pytest.approx(max(1.4 * (0.4 * cos + sin), 0.0), rel=1e-9, abs=1e-9)
    assert nodes[-1, 2] == pytest.approx(max(1.4 * (sin - 0.4 * cos), 0.0), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0, 0, -1), (1, 1, 1)])
def test_in_a_bend_with_weight_the_steps_have_converged(axis):
    """A sixth of the step changes the tension by less than a thousandth of the bend's weight,
    also where the line goes slack."""
    tether, segments = ot.Tether(weight=8.0, friction=0.5), way("s", "e", axis=axis).segments
    bend, count = segments[1], 108
    parts = [next(rest([bend], k * bend.length / count)) for k in range(count)]
    fine = [segments[0], *(replace(part, length=bend.length / count) for part in parts)]
    coarse, exact = (tether.tensions(each, DOWN)[-1, 1] for each in (segments, fine))
    assert coarse == pytest.approx(exact, rel=1e-6, abs=1e-3 * 8.0 * bend.length)


def test_a_robot_feels_the_tension_of_the_way_behind_it():
    """The recorded force is that of the law where its tail is, within 1 %, up an elbow onto a
    level pipe; the metrics are of it."""
    tether = {"weight": 3.0, "friction": 0.5, "tension": 1.0}
    scenario = ot.load_scenario("robots/presser_elbow", {"robot.tether": tether})
    run = ot.run(scenario)
    assert run.success
    nodes = scenario.robot.tether.tensions(scenario.route.segments, DOWN)
    out, force = run.trajectory["tether_out"], run.trajectory["tail_force"]
    assert out == pytest.approx(run.trajectory["distance"] - scenario.robot.length / 2, abs=1e-3)
    # Where it drives on: a robot that is thrown back a little feels less.
    law = np.interp(out, nodes[:, 0], nodes[:, 1])
    assert np.median(force / law) == pytest.approx(1.0, abs=1e-6)
    assert np.mean(np.abs(force / law - 1) < 0.01) > 0.95
    assert run.metrics["tail_force_max_n"] == force.max()
    assert run.metrics["tether_out_max_m"] == out.max()


def test_the_bends_at_which_a_pull_stops_are_those_of_the_capstan():
    """As many as the pull that it holds in a straight says, within one; and the outcome says what
    held it."""
    changes = {"start.distance": 0.3, "run.time_limit": 60.0, "world.friction": 0.3}
    held = ot.run(in_straight("presser", changes, rate=8.0)).metrics["pull_held_n"]
    pipes = [{"kind": "straight", "length": 0.5}]
    for i in range(6):
        pipes.append({"kind": "elbow", "turn_deg": 90.0 if i == 0 else 180.0, "mean_radius": 0.24})
    data = {
        "robot": {"kind": "presser", "tether": {"weight": 6.0, "friction": 0.6}},
        "pipes": [*pipes, {"kind": "straight", "length": 0.5}],
        "start": {"distance": 0.2, "axis": [1, 0, 0]},
        "world": {"friction": 0.3},
        "control": {"kind": "own", "cruise_speed": 0.08},
    }
    scenario = validate(data)
    run = ot.run(scenario)
    nodes = scenario.robot.tether.tensions(scenario.route.segments, DOWN)
    bends = np.array([p.s_leave for p in scenario.route.passages if p.is_turn])
    law = np.count_nonzero(np.interp(bends, nodes[:, 0], nodes[:, 1]) < held)
    passed = np.count_nonzero(bends < run.metrics["tether_out_max_m"])
    assert 2 <= law <= 5
    assert abs(law - passed) <= 1
    assert run.outcome is ot.Outcome.HELD_BY_TETHER
    assert "of 100 m of tether out" in run.reason


def test_a_tether_that_is_used_up_holds_the_robot():
    """It stops where the stretch of its length holds what it pulls."""
    tether = {"weight": 0.0, "length": 0.5, "stiffness": 400.0}
    changes = {"robot.tether": tether, "start.distance": 0.3, "run.time_limit": 60.0}
    run = ot.run(in_straight("presser", changes | {"world.friction": 0.3}))
    assert run.outcome is ot.Outcome.HELD_BY_TETHER
    stretch = run.metrics["tether_out_max_m"] - 0.5
    assert run.metrics["tail_force_max_n"] == pytest.approx(400 / 0.5 * stretch, rel=1e-6)
    assert run.metrics["pull_held_n"] == pytest.approx(36, rel=0.1)


def test_in_reverse_gear_the_reel_takes_the_tether_in():
    """On the way back less is out, and a branch adds to what is out where it begins."""
    long, branch = way(*"sess", turns=[0, 90, 0, 0]), way(*"ss", axis=(0, 1, 0))
    legs = SimpleNamespace(
        routes=SimpleNamespace(routes=[long, branch]),
        route=np.zeros(1, int),
        number=np.zeros(1, int),
        gear=np.ones(1, int),
    )
    scenario = in_straight(
        "presser", {"robot.tether": {"weight": 1.0}, "world.gravity": [0, 0, -9.8]}
    )
    tethers = Tethers(scenario.robot.tether, [scenario], legs)
    tethers.reset(np.zeros(1, int), np.array([0.1]))
    forward = [tethers.pull(np.array([s]))[0] for s in (1.0, 2.0, 4.0)]
    assert forward == sorted(forward)
    assert tethers.out[0] == pytest.approx(4.0)
    legs.gear, legs.number = -legs.gear, legs.number + 1
    tethers.pull(np.array([0.5]))
    tethers.pull(np.array([3.5]))
    assert tethers.out[0] == pytest.approx(1.0)
    legs.gear, legs.number, legs.route = -legs.gear, legs.number + 1, legs.route + 1
    tethers.pull(np.array([0.3]))
    tension = tethers.pull(np.array([1.3]))[0]
    assert tethers.out[0] == pytest.approx(2.0)
    assert tension == pytest.approx(2.0 * 0.3 * 9.8 / 9.81, rel=1e-6)
