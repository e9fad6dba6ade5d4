"""Laws of what pulls at a robot's tail: statics of the line, levers of the pull, both gears."""

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.pipes.centreline import Segment
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.tail import TAIL_METRICS, TETHER_METRICS, rest
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.tail_load import SETTINGS, TailLoad, Tethers

RNG = np.random.default_rng(54)
BEGINNING = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_numbers():
    """Each test draws the same random ways, whichever run before it."""
    RNG.bit_generator.state = BEGINNING


def frame():
    """A random rotation, as three unit vectors."""
    q, _ = np.linalg.qr(RNG.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def line(length, axes=None):
    """A straight segment."""
    a = frame() if axes is None else axes
    return Segment(length, 0.0, np.zeros(3), a[0], a[1])


def arc(radius, angle, axes=None):
    """A bend of so many radians."""
    a = frame() if axes is None else axes
    return Segment(radius * angle, 1 / radius, np.zeros(3), a[0], a[1])


def end_of(segment):
    """Point, tangent and normal where a segment ends, if it begins at the origin."""
    t, n, s, k = segment.tangent, segment.normal, segment.length, segment.curvature
    if not k:
        return s * t, t, n
    cos, sin = math.cos(s * k), math.sin(s * k)
    return (t * sin + n * (1 - cos)) / k, t * cos + n * sin, n * cos - t * sin


def winding(count=6):
    """A smooth random way of lines and bends, and the points (k, 3) where they end."""
    segments, points, axes = [], [np.zeros(3)], frame()
    for i in range(count):
        piece = (
            arc(RNG.uniform(0.1, 0.5), RNG.uniform(0.3, 2.0), axes) if i % 2 else line(0.7, axes)
        )
        segments.append(piece)
        step, t, _ = end_of(piece)
        points.append(points[-1] + step)
        aside = RNG.normal(size=3)
        aside -= t * (aside @ t)
        axes = np.stack([t, aside / np.linalg.norm(aside), t])
    return segments, np.array(points)


def test_on_a_straight_tension_grows_by_friction_and_by_the_height():
    """In any direction, at any gravity and start: T0 + L (mu w_across - w_along), never below 0,
    and sliding back the friction helps; where it goes slack on the way there is a node."""
    for _ in range(50):
        segment, gravity = line(RNG.uniform(0.5, 3.0)), RNG.normal(size=3) * RNG.uniform(1, 10)
        tether = ot.Tether(weight=RNG.uniform(0, 3), friction=RNG.uniform(0, 1), tension=1.0)
        start = RNG.uniform(0, 3), RNG.uniform(0, 3)
        nodes = tether.tensions([segment], gravity, start)
        w = tether.weight * gravity / 9.81
        along = w @ segment.tangent
        across = math.sqrt(max(w @ w - along**2, 0.0))
        for column, sign in ((1, 1), (2, -1)):
            slope = sign * tether.friction * across - along
            s = np.linspace(0, segment.length, 7)
            law = np.maximum(start[column - 1] + slope * s, 0.0)
            assert np.interp(s, nodes[:, 0], nodes[:, column]) == pytest.approx(law, abs=1e-9)
    assert tether.tensions([segment], gravity)[0].tolist() == [0.0, 1.0, 1.0]


def test_without_friction_tension_is_the_weight_of_the_height():
    """Whatever way leads there, dragged on or slid back."""
    for _ in range(10):
        segments, points = winding()
        gravity = RNG.normal(size=3) * 5
        tether = ot.Tether(weight=2.0, friction=0.0, tension=60.0)
        nodes = tether.tensions(segments, gravity)
        heights = -points @ gravity / 9.81
        places = np.cumsum([0.0, *(segment.length for segment in segments)])
        for column in (1, 2):
            tensions = np.interp(places, nodes[:, 0], nodes[:, column])
            assert tensions == pytest.approx(60.0 + 2.0 * heights, abs=1e-4)


def test_in_a_bend_tension_follows_the_solution_of_its_equation():
    """With gravity in the bend's plane, while the line lies on its inside, and with gravity across
    the plane, where T = w R sinh(arsinh(T0 / w R) ± mu beta)."""
    for _ in range(20):
        axes, radius, angle = frame(), RNG.uniform(0.1, 0.5), RNG.uniform(0.5, 2.5)
        bend, mu, start = arc(radius, angle, axes), RNG.uniform(0.1, 0.8), 40.0
        tether, size = ot.Tether(weight=9.81, friction=mu), RNG.uniform(1, 10)
        nodes = tether.tensions([bend], size * np.cross(axes[0], axes[1]), (start, start))
        w = size * radius
        for column, sign in ((1, mu), (2, -mu)):
            law = w * np.sinh(np.arcsinh(start / w) + sign * nodes[:, 0] / radius)
            assert nodes[:, column] == pytest.approx(law, rel=1e-5)
        a, c = RNG.normal(size=2) * radius * 5
        nodes = tether.tensions([bend], (a * axes[0] + c * axes[1]) / radius, (start, start))
        b = nodes[:, 0] / radius
        for column, m in ((1, mu), (2, -mu)):
            e, square = np.exp(m * b), 1 + m**2
            cosine = (np.sin(b) - m * np.cos(b) + m * e) / square  # of exp(m (b - x)) cos x
            sine = (e - np.cos(b) - m * np.sin(b)) / square
            law = start * e + (m * c - a) * cosine - (m * a + c) * sine
            assert nodes[:, column] == pytest.approx(law, rel=1e-5)


def test_a_line_slides_back_as_it_is_dragged_the_other_way():
    """From the tension at its far end, on the way seen from there, sliding back leads to the
    tension at the opening: friction turns round with the motion, the weight does not."""
    for _ in range(10):
        segments, _ = winding(4)
        gravity = RNG.normal(size=3) * 4
        tether = ot.Tether(weight=1.0, friction=0.4, tension=30.0)
        drag, slack = tether.tensions(segments, gravity)[-1, 1:]
        turned = []
        for segment in reversed(segments):
            _, t, n = end_of(segment)
            turned.append(replace(segment, tangent=-t, normal=n))
        back = tether.tensions(turned, gravity, (slack, drag))
        assert back[-1, 1:] == pytest.approx((30.0, 30.0), rel=1e-5)


def test_a_way_cut_in_two_is_the_same_way():
    """What is left of a way behind any place goes on with the tension there."""
    segments, _ = winding()
    gravity, tether = np.array([1.0, 2.0, -3.0]), ot.Tether(weight=2.0, friction=0.5, tension=9.0)
    whole = tether.tensions(segments, gravity)
    for cut in (0.0, 0.3, 0.7, 0.9, 2.0, float(whole[-1, 0]) - 0.05):
        at = [float(np.interp(cut, whole[:, 0], whole[:, k])) for k in (1, 2)]
        left = list(rest(segments, cut))
        assert sum(segment.length for segment in left) == pytest.approx(whole[-1, 0] - cut)
        nodes = tether.tensions(left, gravity, tuple(at))
        assert nodes[-1, 1:] == pytest.approx(whole[-1, 1:], rel=1e-3)
    assert list(rest(segments, 99.0)) == []


def scenario(pipes, gravity=(0, 0, 0), kind="presser", goals=("c.end", "a.start"), **tether):
    """A mission of a robot with a tether through pipes in a row, named a, b, c..."""
    names = "abcdefg"[: len(pipes)]
    sizes = {"s": {"kind": "straight", "length": 0.4}, "e": {"kind": "elbow", "mean_radius": 0.24}}
    return validate(
        {
            "network": {
                "fittings": [{"name": n, **sizes[p]} for n, p in zip(names, pipes, strict=True)],
                "joints": [
                    {"ports": [f"{a}.end", f"{b}.start"], "turn_deg": 0.0}
                    for a, b in pairwise(names)
                ],
            },
            "mission": {"start": "a.start", "goals": list(goals)},
            "robot": {"kind": kind, "tether": tether},
            "world": {"gravity": list(gravity), "friction": 0.8},
            "run": {"time_limit": 90.0},
        }
    )


def test_motors_feel_the_capstan_in_both_gears():
    """Sums of motor torques over the wheels' radius, on the straights before and behind a bend of
    90 degrees: the reel's tension, exp(mu pi/2) of it ahead, and on the way back, when the reel
    takes the line in, exp(-mu pi/2) of it, which then pulls with the motion."""
    run = ot.run(scenario("ses", weight=0.0, friction=0.6, tension=2.0), no_load=False)
    assert run.success
    record, far = run.trajectory, 0.4 + 0.24 * math.pi / 2
    out, forward = record["tether_out"], record["gear"] > 0
    torque = record["actuator_force"].sum(axis=1) / 0.024
    before, behind = (out > 0.04) & (out < 0.2), (out > far + 0.04) & (out < far + 0.2)
    for where, gear, tension, tolerance in (
        (before, forward, 2.0, 0.01),
        (behind, forward, 2.0 * math.exp(0.6 * math.pi / 2), 0.02),
        (behind, ~forward, 2.0 * math.exp(-0.6 * math.pi / 2), 0.06),
        (before, ~forward, 2.0, 0.15),
    ):
        own = where & gear
        assert own.sum() > 20
        assert torque[own].mean() == pytest.approx(tension, rel=tolerance)
        sign = 1 if gear is forward else -1  # backward along the way, which the gear turns round
        assert record["tail_force"][own] == pytest.approx(sign * tension, rel=1e-3)
    assert run.metrics["tail_force_max_n"] == record["tail_force"].max()


def test_a_bend_turns_the_pull_where_the_tail_is():
    """The wrench of the pull points against the way at the tail, not at the robot's centre; in
    reverse gear the tail leads."""
    sim = ot.Simulation([scenario("es", goals=("b.end", "a.start"), weight=0.0, tension=3.0)])
    chassis = sim.model.body("chassis").id
    seen = set()
    while sim.active.any():
        for _ in range(20):
            at, gear = float(sim.location.distance[0]), int(sim.legs.gear[0])
            route = sim.legs.routes.routes[sim.legs.route[0]]
            sim.step(sim.controller.step(sim.observation))
        force = sim.data(0).xfrc_applied[chassis][:3]
        tangent = route.centreline.at(np.array([at - gear * 0.078]))[1][0]
        direction = -gear * force / np.linalg.norm(force)
        assert direction == pytest.approx(tangent, abs=2e-3)
        centre = route.centreline.at(np.array([at]))[1][0]
        if np.linalg.norm(centre - tangent) > 0.2:
            seen.add(gear)
    assert seen == {1, -1}


class Crooked(ot.Robot):
    """A robot whose mass lies off its axis, and whose tail is a site of an arm of its own."""

    @property
    def nominal_bore(self):
        return 0.16

    @property
    def length(self):
        return 0.2

    def spec(self):
        spec = mujoco.MjSpec()
        hull = spec.worldbody.add_body(name="chassis")
        hull.add_freejoint()
        hull.add_geom(size=[0.03, 0, 0], pos=[0.02, -0.01, 0.03], mass=2.0)
        hull.add_geom(size=[0.02, 0, 0], pos=[-0.01, 0.02, -0.02], mass=0.7)
        self.add_tail(hull)
        return spec

    def add_tail(self, hull):
        """A hinged arm behind, out of its middle, with a site at its end."""
        arm = hull.add_body(name="arm", pos=[0.01, 0.0, -0.03], quat=[0.9, 0.1, 0.3, 0.2])
        arm.add_joint(axis=[1, 0, 0], stiffness=5.0)
        arm.add_geom(size=[0.01, 0, 0], pos=[0.0, 0.01, -0.01], mass=0.2)
        arm.add_site(name="tail", pos=[0.005, 0.0, -0.02])


class Bare(Crooked):
    """The same without the arm: its tail lies half of its length behind."""

    def add_tail(self, hull):
        pass


@pytest.mark.parametrize("robot", [Crooked, Bare])
def test_the_lever_of_the_pull_is_that_of_the_tail(robot):
    """The generalised force is the tail's Jacobian transposed times the force, however the robot
    lies and wherever its masses are."""
    pipes = [{"kind": "straight", "length": 2.0}]
    data = {"robot": {"kind": robot().kind}, "pipes": pipes, "start": {"distance": 1.0}}
    data |= {"pull": {"force": 3.0}, "control": {"kind": "own"}, "run": {"time_limit": 1.0}}
    sim = ot.Simulation([validate({**data, "world": {"gravity": [0.3, -0.2, 0.1]}})])
    for _ in range(15):
        sim.step(sim.controller.step(sim.observation))
    model, before, jacobian = sim.model, sim.data(0), np.zeros((3, sim.model.nv))
    body = model.body("arm" if robot is Crooked else "chassis").id
    mujoco.mj_kinematics(model, before)
    mujoco.mj_comPos(model, before)
    frame = before.xmat[body].reshape(3, 3)
    chassis = before.xpos[body] - 0.1 * frame[:, 2]
    point = before.site("tail").xpos if robot is Crooked else chassis
    mujoco.mj_jac(model, before, jacobian, None, point, body)
    sim.step(sim.controller.step(sim.observation))
    force, torque = np.split(sim.data(0).xfrc_applied[body], 2)
    made = np.zeros(model.nv)
    mujoco.mj_applyFT(model, before, force, torque, before.xipos[body], body, made)
    assert np.linalg.norm(torque) > 0.01
    assert made == pytest.approx(jacobian.T @ [0.0, 0.0, -3.0], abs=2e-3)


def stood(tether, routes, gears=(1,)):
    """Tethers of robots that someone else drives, with the legs as one sets them."""
    n = len(gears)
    legs = SimpleNamespace(
        routes=SimpleNamespace(routes=routes),
        route=np.zeros(n, int),
        number=np.zeros(n, int),
        gear=np.array(gears),
    )
    made = scenario("s", goals=("a.end",), gravity=(0, 0, -9.81))
    return Tethers(tether, [made] * n, legs), legs, made


def route(*segments):
    """A way of segments, of which the tether asks no more."""
    return SimpleNamespace(segments=list(segments))


X = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])


def test_between_dragging_and_sliding_a_line_is_a_spring_of_its_length():
    """A robot that gives way by d feels EA d / L less, until the line slides back; as stiff as a
    control step stands at most."""
    tether = ot.Tether(weight=2.0, friction=0.5, tension=5.0, stiffness=40.0)
    tethers, _, made = stood(tether, [route(line(10.0, X))])
    tethers.reset(np.zeros(1, int), np.array([0.5]))
    assert tethers.tension[0] == pytest.approx(5.0 + 0.5)  # it lies as it was dragged in
    assert tethers.out[0] == 0.5
    (dragged,) = tethers.pull(np.array([4.0]))
    assert dragged == pytest.approx(5.0 + 4.0)
    (eased,) = tethers.pull(np.array([3.9]))
    assert eased == pytest.approx(9.0 - 0.1 * 40 / 3.9)
    (again,) = tethers.pull(np.array([3.95]))
    assert again == pytest.approx(eased + 0.05 * 40 / 3.95)
    (slid,) = tethers.pull(np.array([3.0]))
    assert slid == pytest.approx(5.0 - 3.0)
    stiff, _, made = stood(tether.model_copy(update={"stiffness": 1e9}), [route(line(10.0, X))])
    stiff.reset(np.zeros(1, int), np.array([4.0]))
    (first,), (less,) = stiff.pull(np.array([4.0])), stiff.pull(np.array([3.9999]))
    most = SETTINGS.softening * made.robot.mass / made.physics.control_period**2
    assert first - less == pytest.approx(1e-4 * most)


def test_a_tail_at_the_opening_feels_the_reel_alone():
    """None is out there, nor where the robot slides out; and what comes in again pays it out."""
    tether = ot.Tether(weight=2.0, friction=0.5, tension=5.0)
    tethers, _, _ = stood(tether, [route(line(10.0, X))])
    tethers.reset(np.zeros(1, int), np.array([0.0]))
    for tail, out in ((0.0, 0.0), (-0.05, 0.0), (-0.001, 0.0), (0.3, 0.3)):
        assert tethers.pull(np.array([tail])) == pytest.approx(5.0 + out)
        assert tethers.out[0] == pytest.approx(out)


def test_a_line_that_is_used_up_adds_the_stretch_of_all_of_it():
    """To the tension that is there anyway, by EA / L for each metre more."""
    tether = ot.Tether(weight=2.0, friction=0.5, tension=5.0, stiffness=40.0, length=3.0)
    tethers, _, _ = stood(tether, [route(line(10.0, X[::-1]))])  # straight up
    tethers.reset(np.zeros(1, int), np.array([2.0]))
    for out in np.arange(2.0, 3.61, 0.1):
        (tension,) = tethers.pull(np.array([out]))
        assert tension == pytest.approx(5.0 + 2 * out + 40 / 3 * max(out - 3.0, 0.0))
    assert tethers.holds(0)
    assert tethers.words(0) == ", 3.6 of 3 m of tether out"


def test_a_quarter_of_the_weight_holds_a_robot_that_stands_for_no_better_reason():
    """Where it is stuck, stalled or slipping; a definite cause stays, and so does that of a robot
    whose tether pulls less and has line left."""
    load = TailLoad.__new__(TailLoad)
    for part, held in ((0.251, True), (0.249, False)):
        weight = scenario("s", goals=("a.end",)).robot.mass * 9.81
        tether = ot.Tether(weight=0.0, friction=0.0, tension=part * weight, length=9.0)
        load._tethers, _, _ = stood(tether, [route(line(10.0, X))])
        load._tethers.reset(np.zeros(1, int), np.array([1.0]))
        load._tethers.pull(np.array([2.0]))
        for cause in Outcome:
            vague = cause in (Outcome.STUCK, Outcome.STALLED, Outcome.SLIPPING)
            wanted = Outcome.HELD_BY_TETHER if held and vague else cause
            assert load.cause(0, cause) is wanted
    load._tethers = None
    assert load.cause(0, Outcome.STUCK) is Outcome.STUCK


def test_a_branch_goes_on_with_the_tension_where_it_begins():
    """Back along a line to where a bend leads off, and round it: the capstan's law of the reel's
    tension there, of robots of one batch each by its own way, as alone."""
    first, bend = route(line(6.0, X)), route(line(0.5, X), arc(0.3, 1.2, X))
    tether = ot.Tether(weight=1.0, friction=0.4, tension=4.0)
    both, legs, _ = stood(tether, [first, bend], (1, 1))
    both.reset(np.arange(2), np.array([0.2, 0.2]))
    for s in np.arange(0.2, 5.0, 0.05):
        both.pull(np.array([s, s / 5]))
    legs.gear, legs.number = np.array([-1, 1]), np.array([1, 0])
    for s in np.arange(0.5, 3.45, 0.05):  # 2 m are left
        tensions = both.pull(np.array([s, 0.99]))
    assert both.out == pytest.approx([4.95 - 2.9, 0.99])
    assert tensions[0] == pytest.approx(4.0 - 0.4 * 2.05)
    legs.gear, legs.number, legs.route = np.ones(2, int), np.array([2, 0]), np.array([1, 0])
    for s in np.arange(0.5, 0.801, 0.01):  # a radian of the bend's 1.2
        tensions = both.pull(np.array([s, 0.99]))
    assert both.out == pytest.approx([2.05 + 0.3, 0.99])
    start = (4.0 + 0.4 * 2.05, 4.0 - 0.4 * 2.05)
    law = tether.tensions([arc(0.3, 1.0, X)], np.array([0, 0, -9.81]), start)[-1]
    assert tensions[0] == pytest.approx(law[1], rel=1e-3)
    assert tensions[1] == pytest.approx(4.0 + 0.4 * 0.99)
    assert tensions[0] > start[0] * math.exp(0.4)


def test_metrics_of_the_tail_are_of_the_last_leg_and_of_all_of_the_run():
    """What it held is the force where it was farthest on its last leg; the largest ones are of any
    leg."""
    record = {
        "leg": np.array([0, 0, 1, 1, 1]),
        "distance": np.array([0.1, 9.0, 0.5, 0.9, 0.7]),
        "tail_force": np.array([1.0, 8.0, 2.0, 3.0, -4.0]),
        "tether_out": np.array([0.0, 7.0, 6.5, 6.1, 6.3]),
    }
    run = SimpleNamespace(trajectory=record)
    values = {m.name: m.compute(run) for m in (*TAIL_METRICS, *TETHER_METRICS)}
    assert values == {"pull_held_n": 3.0, "tail_force_max_n": 8.0, "tether_out_max_m": 7.0}
