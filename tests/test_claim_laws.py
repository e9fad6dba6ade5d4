"""Claims hold on runs that do as the law says, and on none that is off by more.

The runs are made up: what is tested is what the claims measure on them, and the bounds.
"""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from omnitrack_sim.paper import driving, experiments
from omnitrack_sim.paper.claim import Claim, ClaimVerdict, varied
from omnitrack_sim.paper.robots import climber, helix, pirate, presser, screw
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.climber import Climber
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.kinematics import elbow_radii
from omnitrack_sim.robots.pirate import Pirate
from omnitrack_sim.robots.presser import ARMS, Presser
from omnitrack_sim.robots.screw import Screw
from omnitrack_sim.robots.size import GRAVITY

TIME = np.linspace(0.0, 5.0, 501)


class Record(dict):
    """Channels of a made-up run, with their time."""

    time = TIME


def run(distance=0.0, success=True, robot=None, **given) -> SimpleNamespace:
    """A run with such a distance, (T,) m, or such a speed, m/s, after a second at another one."""
    late = np.maximum(TIME - 1.0, 0.0)
    way = distance if np.ndim(distance) else 0.3 * np.minimum(TIME, 1.0) + distance * late
    channels = {"distance": np.asarray(way, float)}
    metrics = {}
    for name, value in given.items():
        (channels if np.ndim(value) else metrics)[name] = value
    outcome = Outcome.REACHED_GOAL if success else Outcome.STALLED
    scenario = SimpleNamespace(robot=robot)
    return SimpleNamespace(
        trajectory=Record(channels), metrics=metrics, success=success, outcome=outcome,
        scenario=scenario,
    )  # fmt: skip


@pytest.mark.parametrize(("inner", "counted"), [(2, 2), (1, 1), (0, 0), (None, 0)])
def test_the_load_of_a_turn_is_that_of_its_inner_module(inner, counted, monkeypatch):
    """Over what the motor's maker recommends; of a robot that does not turn, of the first one."""
    torque = np.tile([0.1, -0.2, 0.3], (len(TIME), 1))
    result = run(robot=Omnitrack(), motor_torque=torque)
    result.metrics["stall_time_s"] = np.array([0.0, 0.4, 0.0])
    monkeypatch.setattr(driving, "inner_module", lambda _: inner)
    load, stalls = driving._inner_load(result)
    recommended = Omnitrack().motor.recommended_torque
    assert load == pytest.approx((0.1, 0.2, 0.3)[counted] / recommended)
    assert stalls == (counted == 1)


@pytest.fixture
def holds(monkeypatch):
    """Return whether a claim holds on such runs, one list of them a call or as many as asked."""

    def measured(module, claim: Claim, *lists, quick=False) -> bool:
        waiting = list(lists)
        for name in ("runs_of", "alone"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, lambda _, changes: take(waiting, changes))
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()
        verdict = claim(quick, quick).verdict
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()
        return verdict in (ClaimVerdict.HOLDS, ClaimVerdict.CALIBRATED)

    return measured


def take(waiting, changes):
    """The next list of runs, or what makes them of the changes that are asked for."""
    made = waiting.pop(0) if len(waiting) > 1 else waiting[0]
    asked = list(changes)
    runs = made(asked) if callable(made) else made
    assert len(runs) == len(asked)
    return runs


OFF = pytest.mark.parametrize("sign", [-1, 1])


@OFF
def test_laws_of_the_screw(holds, sign):
    """Speeds within 1 %, torques within 2 %, the pull at which it slips within 5 %."""
    robot = Screw()

    def speeds(part):
        weights = (robot.mass * GRAVITY * up for up in (1, 0, -1))
        return [
            run(part * robot.speed_at(robot.speed, weight), actuator_force=0 * TIME)
            for weight in weights
        ]

    assert holds(screw, screw.speed_under_weight, speeds(1 + 0.009 * sign))
    assert not holds(screw, screw.speed_under_weight, speeds(1 + 0.011 * sign))

    def torques(part):
        # What it gave before the last second does not count.
        late = np.where(TIME > 4.0, 1.0, 7.0)
        return [run(actuator_force=part * pull * robot.lever * late) for pull in (5, 15, 25)]

    assert holds(screw, screw.torque_of_a_pull, torques(1 + 0.019 * sign))
    assert not holds(screw, screw.torque_of_a_pull, torques(1 + 0.021 * sign))

    def pulls(part):
        return [run(pull_held_n=part * 3 * robot.rotor_preload * mu * np.cos(robot.lead))
                for mu in (0.2, 0.4)]  # fmt: skip

    assert holds(screw, screw.slip_limit, pulls(1 + 0.049 * sign))
    assert not holds(screw, screw.slip_limit, pulls(1 + 0.051 * sign))


@pytest.mark.parametrize(
    ("turns", "expected"), [((4, 46), True), ((6, 46), False), ((4, 44), False)]
)
def test_the_stator_of_the_screw_turns_from_its_limit_on(holds, turns, expected):
    """By less than 5 degrees below the limit and by more than 45 above it, about the pipe."""
    runs = []
    for turn in turns:
        angle = 2.0 + np.radians(turn) * TIME / TIME[-1]
        columns = [np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)]
        runs.append(run(quaternion=np.stack(columns, axis=1)))

    def made(asked):
        robot = Screw(stator_preload=2.0, lead=0.35)
        law = 3 * robot.stator_preload * 0.8 / math.tan(robot.lead)
        assert [case["pull.force"] / law for case in asked] == pytest.approx([0.8, 1.2])
        return runs

    assert holds(screw, screw.stator_limit, made) is expected


@OFF
def test_laws_of_the_presser(holds, sign):
    """It climbs from the friction on that holds its weight; its motors droop by its weight."""
    robot = Presser()
    up, down = 0.6 + 0.05 * TIME, 0.6 - 0.05 * TIME
    assert holds(presser, presser.presser_climb_limit, [run(down), run(down), run(up), run(up)])
    still = 0.6 + 0 * TIME
    for ways in ((down, up, up, up), (down, down, down, up), (down, still, up, up)):
        assert not holds(presser, presser.presser_climb_limit, [run(way) for way in ways])
    # A wheel's torque is a sixth of the weight at its radius; it costs torque over gain, rad/s.
    torque = robot.mass * GRAVITY * robot.wheel_radius / 6
    law = robot.speed - robot.wheel_radius * torque / robot.motor_gain
    assert holds(presser, presser.presser_motor_droop, [run((1 + 0.009 * sign) * law)])
    assert not holds(presser, presser.presser_motor_droop, [run((1 + 0.011 * sign) * law)])


def test_speeds_and_energy_of_the_presser_in_a_bend(holds):
    """Wheels at the speeds of the geometry, to 10 % of the speed; energy a metre 10 % below that
    at equal speeds; samples in which an end is outside the bend do not count."""
    robot = Presser()
    begin, end = presser.INLET, presser.INLET + np.pi / 2 * presser.BEND
    way = np.linspace(begin - 0.2, end + 0.2, len(TIME))
    inside = (way > begin + robot.wheelbase / 2) & (way < end - robot.wheelbase / 2)
    speed = np.gradient(way, TIME)
    theta5 = np.linspace(0.3, 0.5, len(TIME))
    sides = np.cos(theta5[:, None] + ARMS)
    law = np.tile(speed[:, None] * (1 - robot.bore / 2 / presser.BEND * sides), 2)

    def bends(off, power):
        # Outside of the bend all is wrong.
        wheels = np.where(inside[:, None], law + off * speed[:, None], 9.0) / robot.wheel_radius
        work = np.where(inside, power, 99.0)
        powers = np.stack([work, work - 2 * power], axis=1)  # the second one brakes: it is lost
        return lambda asked: [
            run(way, robot=robot, theta5=theta5, actuator_velocity=wheels, actuator_power=powers)
            for _ in asked
        ]

    speeds, energy = presser.presser_bend_speeds, presser.presser_bend_energy
    assert holds(presser, speeds, bends(0.099, 1.0), bends(0.9, 1.0))
    assert not holds(presser, speeds, bends(0.101, 1.0), bends(0.9, 1.0))
    assert not holds(presser, speeds, bends(-0.101, 1.0), bends(0.9, 1.0))
    assert presser._energy_a_metre(bends(0, 2.0)([{}])[0]) == pytest.approx(
        2.0 / speed[0], rel=0.02
    )
    assert holds(presser, energy, bends(0, 0.89), bends(0, 1.0))
    assert not holds(presser, energy, bends(0, 0.91), bends(0, 1.0))


@pytest.mark.parametrize(
    ("failed", "turns", "as_modules"), [(4, True, False), (5, False, False), (38, False, True)]
)
def test_branches_of_the_presser(holds, failed, turns, as_modules):
    """It turns if over 90 % of 48 pass; as three modules do if 80.45 % can be its failures."""
    runs = [run(success=k >= failed) for k in range(48)]
    assert holds(presser, presser.presser_branch, runs) is turns
    assert holds(presser, presser.presser_branch_as_three_modules, runs) is as_modules


@OFF
def test_laws_of_pirate(holds, sign):
    """80 mm/s within 1 %; 14 N within 0.5 N; the statics of the clamped chain within 15 %."""
    assert holds(pirate, pirate.pirate_speed, [run(0.08 * (1 + 0.009 * sign))])
    assert not holds(pirate, pirate.pirate_speed, [run(0.08 * (1 + 0.011 * sign))])
    assert holds(pirate, pirate.pirate_pull, [run(pull_held_n=14 + 0.49 * sign)])
    assert not holds(pirate, pirate.pirate_pull, [run(pull_held_n=14 + 0.51 * sign)])

    def pulls(part):
        def made(asked):
            (case,) = asked
            chain = Pirate(bore=case["robot.bore"], clamp_torque=case["robot.clamp_torque"])
            law = pirate.clamp_forces(chain, case["world.friction"])[0]
            return [run(pull_held_n=part * law)]

        return made

    def cases(part):
        return lambda asked: [pulls(part)([case])[0] for case in asked]

    assert holds(pirate, pirate.pirate_pull_law, cases(1 + 0.149 * sign))
    assert not holds(pirate, pirate.pirate_pull_law, cases(1 + 0.151 * sign))


def test_pirate_pulls_less_in_a_bend(holds):
    """What it pulls in a straight stops it in an elbow."""
    strong, weak = [run(pull_held_n=14.0)], [run(pull_held_n=12.9)]
    stopped, passed = [run(success=False)], [run()]
    # The elbow is run first.
    assert holds(pirate, pirate.pirate_pull_in_bends, stopped, strong)
    assert not holds(pirate, pirate.pirate_pull_in_bends, passed, strong)
    assert not holds(pirate, pirate.pirate_pull_in_bends, stopped, weak)


def test_forces_of_the_clamped_chain_balance():
    """Pull and traction along the pipe, walls across it; without friction only the walls press."""
    robot = Pirate(bore=0.1)
    for friction in (0.0, 0.4, 0.8):
        pull, *normals = pirate.clamp_forces(robot, friction)
        assert pull == pytest.approx(friction * sum(normals))
        assert sum(pirate.SIDES * normals) == pytest.approx(0, abs=1e-9)
        assert min(normals) > -1e-9
    pull, *normals = pirate.clamp_forces(robot, 0.0)
    arm = robot.link * np.cos(robot.slope)
    assert normals[0] == pytest.approx(robot.clamp_torque / arm)
    assert normals == pytest.approx(normals[::-1])


@OFF
def test_laws_of_the_climber(holds, sign):
    """Slip below 3 % of the way; speeds of the bend within 0.1; climbing within 5 %."""

    def slips(part):
        return [run(distance_m=2.0, slip_distance_m=3 * 2.0 * part) for _ in range(4)]

    assert holds(climber, climber.no_slip_in_bends, slips(0.029), slips(0.5))
    assert not holds(climber, climber.no_slip_in_bends, slips(0.031), slips(0.5))
    failed = [*slips(0.01)[:3], run(success=False, distance_m=2.0, slip_distance_m=0.0)]
    assert not holds(climber, climber.no_slip_in_bends, failed, slips(0.5))
    robot = Climber()

    def bends(off):
        def made(asked):
            runs = []
            for case in asked:
                theta5 = case["start.theta5_deg"]
                radii = elbow_radii(np.radians(theta5), climber.BEND, robot.nominal_bore / 2)
                law = radii / climber.BEND
                inside = (TIME > 2.0 + 0.25) & (TIME < 3.0 - 0.25)
                speed = np.where(inside[:, None], 0.3 * (law + off * np.array([1, -1, 0])), 5.0)
                one = run(TIME, robot=robot, belt_speed=speed)
                one.scenario.start = SimpleNamespace(theta5_deg=theta5)
                bend = SimpleNamespace(s_enter=2.0, s_leave=3.0)
                one.scenario.route = SimpleNamespace(passages=[None, bend, None])
                runs.append(one)
            return runs

        return made

    assert holds(climber, climber.bend_speeds, bends(0.099 * sign))
    assert not holds(climber, climber.bend_speeds, bends(0.101 * sign))

    def climb(part, **given):
        one = run(mean_speed_m_s=part * 0.1, **given)
        one.scenario.control = SimpleNamespace(cruise_speed=0.1)
        return [one]

    assert holds(climber, climber.climbs, climb(1 + 0.049 * sign))
    assert not holds(climber, climber.climbs, climb(1 + 0.051 * sign))
    assert not holds(climber, climber.climbs, climb(1.0, success=False))


@OFF
def test_laws_of_the_helix(holds, monkeypatch, sign):
    """Speed within 5 % of joint angles and 10 % of a smooth helix, the bore within 1 %; up by more
    than 80 % of the speed downwards."""
    for name, value in (("_estimated_speed", 0.1), ("_smooth_speed", 0.1)):
        monkeypatch.setattr(helix, name, lambda _, value=value: value)
    for claim, within in ((helix.helix_speed, 5), (helix.helix_smooth_speed, 10)):
        for off, expected in ((within - 0.1, True), (within + 0.1, False)):
            runs = [settled(0.1), settled(0.1), settled(0.1 * (1 + 0.01 * sign * off))]
            assert holds(helix, claim, runs) is expected
    for up, expected in ((0.081, True), (0.079, False)):
        there = [settled(up + 1e-5 * k) for k in range(3)]
        back = [settled(0.1 + 1e-5 * k) for k in range(3)]
        assert holds(helix, helix.helix_climb, there, back) is expected

    def bore(off):
        def made(asked):
            runs = []
            for case in asked:
                one = settled(0.1)
                one.bore = (1 + 0.01 * sign * off) * case["pipes"][0]["inner_diameter"]
                runs.append(one)
            return runs

        return made

    monkeypatch.setattr(helix, "_estimated_bore", lambda one: one.bore)
    assert holds(helix, helix.helix_bore, bore(0.9))
    assert not holds(helix, helix.helix_bore, bore(1.1))


def settled(speed: float) -> SimpleNamespace:
    """A run at a speed that it has after two seconds."""
    return run(np.where(TIME <= 2.0, 0.5 * TIME, 1.0 + speed * (TIME - 2.0)))


def test_every_claim_of_every_robot_says_what_it_compares():
    """A number that bounds it stands in its statement."""
    for module in (climber, helix, pirate, presser, screw):
        for claim in module.CLAIMS:
            assert dataclasses.is_dataclass(claim)
            assert "{" not in claim.text
            for value in claim.limits.values():
                assert f"{value:g}" in claim.text, claim.id


def paper_run(**channels) -> SimpleNamespace:
    return SimpleNamespace(trajectory=Record(channels), outcome=Outcome.NO_MOTION_LINE)


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [((11.7, -11.7, 131.7, -251.7), True), ((0, 11.8), False), ((60,), False)],
)
def test_an_alignment_ends_near_the_best_of_three_orientations(degrees, expected):
    """Within half of what the region leaves of 120 degrees, for every start."""
    runs = {"holonomic": [paper_run(theta5=np.radians([40.0, end])) for end in degrees]}
    finding = driving.holonomic_alignment.measure(runs, **driving.holonomic_alignment.limits)
    assert finding.verdict is (ClaimVerdict.HOLDS if expected else ClaimVerdict.FAILS)
    assert f"{sum(abs((d + 60) % 120 - 60) < 11.73 for d in degrees)} of {len(degrees)}" in (
        finding.measured
    )


@pytest.mark.parametrize(
    ("travel", "touching", "expected"), [(4.9, 0.91, True), (5.1, 1.0, False), (0.0, 0.89, False)]
)
def test_on_the_no_motion_line_all_tracks_touch_and_nothing_moves(travel, touching, expected):
    """Under 5 mm of travel, both ways together; both tracks of every module over 90 %."""
    samples = 1000
    count = np.ones((samples, 3, 2))
    count[: round((1 - touching) * samples), 2, 1] = 0
    distance = 1e-3 * travel / 2 * np.sin(np.linspace(0, 7, samples))
    run = paper_run(distance=distance, contact_count=count, tilt=np.zeros(samples))
    claim = driving.no_motion_line
    assert (
        claim.measure({"no_motion_line": [run]}, **claim.limits).verdict is ClaimVerdict.HOLDS
    ) is expected


@pytest.mark.parametrize(
    ("least", "expected"),
    [(1.05, True), (1.10, True), (1.2, False), (0.95, True), (0.9, False), (0.8, False)],
)
def test_a_climb_begins_at_the_preload_that_friction_asks_for(least, expected, monkeypatch):
    """Within 10 %; half of the cruise speed in the last second is a climb, and sliding is none."""
    factors = experiments.PRELOAD_FACTORS
    runs = []
    for _ in experiments.FRICTIONS:
        for factor in factors:
            speed = 0.06 if factor >= least - 1e-9 else (-0.1 if factor < 0.95 else 0.04)
            one = paper_run(distance=speed * TIME)
            one.scenario = SimpleNamespace(robot=Omnitrack())
            runs.append(one)
    claim = driving.climbing_preload
    finding = claim.measure({"preload": runs}, **claim.limits)
    assert finding.verdict is (ClaimVerdict.HOLDS if expected else ClaimVerdict.FAILS)


def test_assumed_sizes_are_varied_one_at_a_time():
    """Each once smaller and once larger by the same factors, of the robot's own value."""
    robot = Presser()
    changes = varied(robot, ["preload", "stiffness"])
    values = [next(iter(change.items())) for change in changes]
    assert [len(change) for change in changes] == [1, 1, 1, 1]
    assert values == [
        (f"robot.{name}", factor * getattr(robot, name))
        for name in ("preload", "stiffness")
        for factor in (0.7, 1.4)
    ]
