"""Laws of the shipped controllers, asked one observation at a time: no physics."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from documents import page

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import (
    Array,
    angle_between,
    cross,
    dot,
    length,
    rotation_about,
    unit,
)
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.record.events import BackedOff
from omnitrack_sim.robots.control import Controller, ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.robots.omnitrack.control.alignment import Aligner
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController
from omnitrack_sim.robots.omnitrack.control.orientation import AIMS, orientation_error
from omnitrack_sim.robots.omnitrack.control.sway import Lean
from omnitrack_sim.robots.omnitrack.control.tracking import Tracking
from omnitrack_sim.robots.omnitrack.events import Rolled
from omnitrack_sim.robots.omnitrack.kinematics import module_speeds
from omnitrack_sim.robots.omnitrack.singularity import safe_margin, sector_angle
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.builder import settings_of

PERIOD, BORE = 0.01, 0.16
ASIDE = "control.parameters.alignment.aside_tee_turn"
UPRIGHT = Lean(np.zeros((1, 3)), np.zeros(1), np.zeros(1))
STRAIGHT = {"kind": "straight", "length": 0.5}
WAYS = {
    "elbow": {"kind": "elbow", "mean_radius": 0.24},
    "tee_turn": {"kind": "tee", "enter": "run_start", "leave": "branch"},
    "tee_straight": {"kind": "tee", "enter": "run_start", "leave": "run_end"},
    "merge": {"kind": "tee", "enter": "branch", "leave": "run_end"},
}
"""A fitting passed in each way, by the name of its damping."""


def scenario_of(*middle: str | dict[str, Any], **changes: Any) -> ot.Scenario:
    """A straight, the fittings ``middle``, a straight."""
    pipes = [WAYS[m] if isinstance(m, str) else m for m in middle]
    scenario = validate({"pipes": [STRAIGHT, *pipes, STRAIGHT]})
    return ot.override(scenario, {"control.align": False, "control.retry": False} | changes)


class Bench:
    """One controller on one route, and robots put where a test wants them."""

    def __init__(self, scenario: ot.Scenario) -> None:
        self.scenario, self.time = scenario, 0.0
        self.routes, self.route = RouteMap([scenario.route]), np.zeros(1, np.intp)
        settings, _ = settings_of([scenario])
        self.setup = ControlSetup(
            self.routes,
            scenario.robot,
            settings,
            [scenario.control_parameters],
            self.observe(0.1).location,
            ot.Command(np.zeros((1, 3)), np.zeros((1, 3))),
            PERIOD,
            np.array([scenario.world.gravity]),
        )
        self.controller: Controller = scenario.controller_class(self.setup)

    def observe(
        self, distance: float, theta5_deg: float = 0.0, tilt: Array | None = None, **more: Any
    ) -> Observation:
        """What a robot measures at arc length ``distance`` m, on the centreline or ``aside`` (3,) m
        from it, tilted by the rotation vector ``tilt`` (3,) rad, with other readings as given."""
        at, theta5 = np.array([distance]), np.radians([theta5_deg])
        position, rotation = self.routes.start_poses(self.route, at, theta5)
        if tilt is not None:
            rotation = rotation_about(tilt, np.linalg.norm(tilt)) @ rotation
        aside = np.asarray(more.pop("aside", np.zeros(3)))
        location = self.routes.locate(position + aside, rotation, self.route, at)
        readings = {c.name: np.zeros((1, *c.shape)) for c in CHANNELS.values()}
        readings |= {"rotation": rotation, "time": np.array([self.time])}
        readings |= {name: np.asarray(value, float)[None] for name, value in more.items()}
        return Observation(readings, location, np.zeros(1, int), np.ones(1, int))

    def step(self, distance: float, *location: Any, **more: Any) -> Command:
        """The command for an observation, a period after the one before."""
        self.time += PERIOD
        return self.controller.step(self.observe(distance, *location, **more))

    def inside(self, number: int = 0) -> float:
        """Arc length, m, in the middle of the bend or opening of a passage."""
        return float((self.routes.start[number] + self.routes.end[number]) / 2)


@pytest.mark.parametrize(("slip", "droops"), [(0.0, 2.0), (0.0, 0.5), (0.6, 2.0)])
def test_belts_give_way_in_a_turn_that_grips(slip: float, droops: float) -> None:
    """Each by ``turn_yield`` droops for its torque beyond the mean of all, so that the mean of the
    speeds stays; none in a turn that slips, nor before the turn."""
    path = "control.parameters.tracking.turn_yield"
    scenario = scenario_of("tee_turn", **{path: droops, "robot.motor.speed_droop": 1.5})
    inside = float(Bench(scenario).routes.start[0]) + 0.005
    torque = np.array([-0.3, 0.2, 0.04])
    for distance, gives in ((inside, slip == 0.0), (0.2, False)):
        loaded, idle = Bench(scenario), Bench(scenario)
        plane = cross(loaded.routes.ahead[0], loaded.routes.directions[0])
        normal = loaded.observe(distance).rotation[0].T @ plane
        belts = module_speeds(0.0, normal[0], normal[1], 0.08)
        moving = {"wall_speed": belts, "angular_velocity": (1.0 - slip) * normal}
        for _ in range(20):  # until the slip is known
            a = loaded.step(distance, motor_torque=torque, **moving)
            b = idle.step(distance, **moving)
        droop = 1.5 * scenario.robot.lug_radius
        expected = -droops * droop * (torque - torque.mean()) * gives
        assert a.belt_speed - b.belt_speed == pytest.approx(expected[None], abs=1e-9)


@pytest.mark.parametrize(("slip", "leans"), [(0.0, False), (0.6, True)])
def test_another_attempt_leans_where_the_turn_has_slipped(slip: float, leans: bool) -> None:
    """And not where it gripped: leaning takes torque."""
    commands = []
    for lean_deg in (0.0, 40.0):
        bench = Bench(scenario_of("tee_turn", **{"control.parameters.sway.lean_deg": lean_deg}))
        controller, inside = bench.controller, float(bench.routes.start[0]) + 0.005
        assert isinstance(controller, JacobianController)
        plane = cross(bench.routes.ahead[0], bench.routes.directions[0])
        normal = bench.observe(inside).rotation[0].T @ plane
        belts = module_speeds(0.0, normal[0], normal[1], 0.08)
        for part in (1.0 - slip, 1.0):
            for _ in range(20):
                command = bench.step(inside, wall_speed=belts, angular_velocity=part * normal)
            controller.recovery.retries[:] = 1
            bench.step(0.2)
        commands.append(command.belt_speed)
    assert np.array_equal(*commands) != leans


@pytest.mark.parametrize("gain", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("name", WAYS)
def test_each_fitting_has_its_own_damping(name: str, gain: float) -> None:
    """In a fitting the belts turn the robot against its rotation rate by as much as the damping of
    that way says, and the dampings of the other ways do not matter; before it there is none."""
    changes = {f"control.parameters.damping.{other}": 0.7 for other in WAYS}
    changes |= {f"control.parameters.damping.{name}": gain, "control.cruise_speed": 0.01}
    changes |= {"control.parameters.damping.rate_filter": 0.0}
    scenario = scenario_of(name, **changes)
    rate = np.array([0.03, -0.02, 0.5])
    for distance, expected in ((Bench(scenario).inside(), gain), (0.2, 0.0)):
        still, turning = Bench(scenario), Bench(scenario)
        for _ in range(50):  # until the filter of the rate has settled
            a = still.step(distance)
            b = turning.step(distance, angular_velocity=rate)
        against = -expected * rate
        wanted = module_speeds(0.0, against[0], against[1], BORE / 2)
        assert (b.belt_speed - a.belt_speed)[0] == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("name", ["tee_turn", "merge"])
def test_a_robot_that_hangs_is_not_turned_at_all_costs(name: str) -> None:
    """The rate loop is left out from ``hesitation`` without progress on, and back with the next
    headway: a rotation that does not come would be asked for again and again."""
    hesitation = {"control.parameters.recovery.hesitation": 0.002, "control.cruise_speed": 0.01}
    scenario = scenario_of(name, **hesitation)
    still, turning = Bench(scenario), Bench(scenario)
    at, rate = still.inside(), np.array([0.03, -0.02, 0.0])

    def against(distance: float) -> float:
        pair = still.step(distance), turning.step(distance, angular_velocity=rate)
        return float(np.abs(pair[1].belt_speed - pair[0].belt_speed).max())

    sizes = [against(at) for _ in range(40)]
    assert min(sizes[:20]) > 1e-4
    assert max(sizes[22:]) == 0.0
    assert against(at + 0.003) > 1e-4


@pytest.mark.parametrize("name", WAYS)
def test_belts_resist_a_rotation_in_every_fitting_and_a_jerk_less(name: str) -> None:
    """At once by less than nine tenths of what they do once the rotation has lasted: single lugs
    shake the robot."""
    scenario = scenario_of(name, **{"control.cruise_speed": 0.02})  # no belt is at its limit
    still, turning = Bench(scenario), Bench(scenario)
    at, rate = still.inside(), np.array([0.03, -0.02, 0.0])
    against = [
        float(np.abs(turning.step(at, angular_velocity=rate).belt_speed - calm.belt_speed).max())
        for calm in (still.step(at) for _ in range(10))
    ]
    assert against[-1] > BORE / 2 * float(np.linalg.norm(rate))
    assert 0.0 < against[0] < 0.9 * against[-1]


def test_belts_keep_their_direction_where_its_sign_is_noise() -> None:
    """A roll that is measured now on one side of the no-motion line and now on the other, by half a
    degree, turns no belt round; one that goes on by 10 degrees does."""
    rolls = Aligner(Bench(scenario_of("elbow")).setup, "alignment").rolls
    beside = [80.0, 90.5, 89.5, 90.5, 100.0]
    signs = [rolls.belt_sign(np.radians(np.full((1, 3), roll)))[0, 0] for roll in beside]
    assert signs == [1.0, 1.0, 1.0, 1.0, -1.0]


def test_the_rotation_rate_is_filtered() -> None:
    """A low pass of the first order, whose time constant is ``rate_filter``."""
    bench = Bench(scenario_of("elbow", **{"control.parameters.damping.rate_filter": 0.03}))
    assert isinstance(bench.controller, JacobianController)
    rate, left = np.array([0.3, -0.2, 0.5]), 1.0
    for _ in range(5):
        bench.step(0.2, angular_velocity=rate)
        left *= 0.03 / (0.03 + PERIOD)
        assert bench.controller.angular_velocity[0] == pytest.approx((1 - left) * rate)


@pytest.mark.parametrize("kind", ["jacobian", "paper", "equal"])
@pytest.mark.parametrize("name", WAYS)
def test_no_belt_is_asked_for_more_than_the_limit(name: str, kind: str) -> None:
    """However the robot lies and turns, every belt speed is within the speed limit, forward and
    backward, and some belt is at it."""
    limit = 0.06
    changes = {"control.kind": kind, "control.speed_limit": limit, "control.cruise_speed": 0.1}
    bench, rng = Bench(scenario_of(name, **changes)), np.random.default_rng(5)
    asked = []
    for distance in np.linspace(0.1, bench.routes.lengths[0] - 0.1, 25).tolist():
        for _ in range(4):
            where = {"tilt": rng.normal(scale=0.3, size=3), "aside": rng.normal(scale=0.01, size=3)}
            rate, roll = rng.normal(scale=2.0, size=3), rng.uniform(-4.0, 4.0, 3)
            asked.append(bench.step(distance, 30.0, **where, angular_velocity=rate, roll=roll))
    speeds = np.array([command.belt_speed for command in asked])
    assert np.abs(speeds).max() == limit
    assert speeds.min() == -limit


def test_the_limit_of_the_belts_is_what_the_motor_holds() -> None:
    """A limit beyond what the motor holds against a third of the robot's weight is cut to that."""
    changes = {"robot.motor": "pololu_1000_hpcb", "control.speed_limit": 0.5}
    bench = Bench(scenario_of("elbow", **changes))
    held = bench.scenario.robot.feasible_belt_speed
    assert bench.setup.settings.speed_limit == pytest.approx([held])
    slow = Bench(scenario_of("elbow", **changes | {"control.speed_limit": 0.05}))
    assert slow.setup.settings.speed_limit == pytest.approx([0.05])


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"control.cruise_speed": 0.2}, None),
        ({"control.cruise_speed": 0.25}, "from 0.25 to 0.2 m/s: control.speed_limit caps"),
        ({"control.cruise_speed": 0.5}, "to 0.2 m/s: control.speed_limit .* without it 0.4"),
        (
            {"robot.motor": "pololu_1000_hpcb"},
            r"0.1 to 0.09227 m/s, and to 0.0692 m/s in bends: motor pololu_.*robot.motor.* 1.33 ",
        ),
    ],
)
def test_a_cruise_speed_that_is_not_driven_is_told(changes: dict, told: str | None) -> None:
    """The note names the smaller cap, its key, and on a straight the robot drives no faster."""
    scenario = scenario_of("elbow", **changes)
    (notes,) = settings_of([scenario])[1]
    assert len(notes) == (told is not None)
    if told is None:
        return
    (note,) = notes
    assert re.search(told, note)
    bench = Bench(scenario)
    speed = max(bench.step(0.15, 30.0).belt_speed.max() for _ in range(20))
    named = float(re.search(r"to ([\d.]+) m/s", note).group(1))  # type: ignore[union-attr]
    assert speed == pytest.approx(named, rel=1e-3)


@pytest.mark.parametrize("kind", ["jacobian", "paper", "eq20"])
def test_a_robot_slows_down_where_its_belts_would_have_to_be_faster(kind: str) -> None:
    """Before an elbow its belts run as fast as the motor holds; from where its nose is inside they
    run as much slower as the outer side of the bend is longer than its centreline."""
    changes = {"robot.motor": "pololu_1000_hpcb", "control.kind": kind}
    bench = Bench(scenario_of("elbow", **changes))
    held, sharp = bench.scenario.robot.feasible_belt_speed, 0.08 / 0.24
    before = bench.step(0.1, 0.0).belt_speed
    assert before[0] == pytest.approx([held] * 3)
    inside = bench.step(bench.routes.start[0] - 0.05, 0.0).belt_speed
    assert inside.mean() == pytest.approx(held / (1 + sharp), rel=0.02)
    assert inside.max() <= held


def test_time_limits_follow_the_speed() -> None:
    """A run may take longer by as much as its robot is slowed in the sharpest bend; patience is
    that of a robot which is as slow."""
    usual = scenario_of("tee_turn")
    slow = scenario_of("tee_turn", **{"robot.motor": "pololu_1000_hpcb"})
    factor = 0.1 / slow.min_cruise_speed
    assert 1.5 < factor < 3.0
    assert slow.time_limit_s == pytest.approx(factor * usual.time_limit_s)
    lengths = {"hesitation": 0.04, "patience": 0.15, "back_off": 0.6}
    recovery = Bench(slow).controller.recovery  # type: ignore[attr-defined]
    for name, way in lengths.items():
        assert getattr(recovery, f"_{name}") == pytest.approx(way / slow.min_cruise_speed), name


def notes_on(name: str, **changes: Any) -> list[str]:
    """Notes on a shipped scenario with changes."""
    scenario = ot.load_scenario(name, changes)
    return settings_of([scenario])[1][0]


def test_a_robot_made_for_another_bore_is_told() -> None:
    """The force by which its springs press in this bore, and the scale at which it is made for it,
    which is told no more; a reducer within the springs' travel is the robot's work."""
    (tight,) = notes_on("straight", **{"robot.scale": 1.25})
    robot = ot.Omnitrack(scale=1.25)
    force = robot.preload + robot.module_stiffness * 0.02
    assert f"in the bore of 0.16 m the springs press each module with {force:.3g} N" in tight
    assert "robot.scale = 1 makes" in tight
    (loose,) = notes_on("straight", **{"robot.scale": 0.86, "physics.timestep": 0.001})
    assert "in the bore of 0.16 m the springs are slack" in loose
    assert notes_on("straight") == notes_on("reducer") == []
    fitting = {"robot.scale": 0.625, "pipes.*.inner_diameter": 0.1, "control.cruise_speed": 0.05}
    fitting["physics.timestep"] = 0.001
    assert notes_on("straight", **fitting) == []


def test_notes_of_the_bore_begin_where_the_page_says() -> None:
    """Where the springs press with twice the preload, and with half of it."""
    robot = ot.Omnitrack()
    low = 2 * (robot.nominal_pipe_radius - robot.preload / robot.module_stiffness)
    high = 2 * (robot.nominal_pipe_radius + robot.preload / robot.module_stiffness / 2)
    said = f"below {1e3 * low:.4g} mm or above {1e3 * high:.4g} mm for the standard robot"
    assert said in page("scenarios")
    for bore, notes in ((low - 1e-6, 1), (low + 1e-6, 0), (high - 1e-6, 0), (high + 1e-6, 1)):
        assert len(list(robot.notes([bore], 0.001))) == notes, bore


def test_the_springs_press_with_the_force_of_their_law() -> None:
    """A robot at rest presses by ``spring_force`` of its bore, weightless, to 1 %."""
    for scale in (1.0, 1.25):
        changes = {"robot.scale": scale, "world.gravity": [0, 0, 0], "run.time_limit": 1.0}
        scenario = ot.load_scenario("straight", changes)
        force = ot.run(scenario).trajectory["normal_force"][-1]
        assert force == pytest.approx(scenario.robot.spring_force(0.08), rel=0.01)


@pytest.mark.parametrize(("key", "value"), [("wall_tolerance", 1e-3), ("staves", 48)])
def test_keys_of_walls_of_primitives_are_told_with_exact_walls(key: str, value: float) -> None:
    """They have no effect there; with primitives they have, and at their defaults nobody means
    them."""
    (note,) = notes_on("straight", **{f"physics.{key}": value})
    assert note.startswith(f"physics.{key} has no effect on exact walls")
    primitives = {"physics.collider": "primitives"}
    assert notes_on("straight", **{f"physics.{key}": value}, **primitives) == []


def test_a_robot_is_turned_by_its_heading_error_up_to_a_limit() -> None:
    """On a straight the rotation a metre is gain times error, towards the tangent, and never more
    than ``rotation_limit``."""
    scenario = scenario_of("elbow")
    bench, table = Bench(scenario), scenario.control_parameters.tracking
    tracking, one, straight = Tracking(bench.setup, "tracking"), np.ones(1), UPRIGHT
    for error in (0.01, 0.1, 0.3, 0.6, 1.2):
        observation = bench.observe(0.15, tilt=np.array([error, 0.0, 0.0]))
        wanted = tracking.wanted_rotation(
            observation.location, observation.rotation, one, 0 * one, straight
        )
        size = min(table.gain * error, table.rotation_limit)
        assert wanted[0] == pytest.approx([-size, 0.0, 0.0], abs=1e-9)
    assert table.gain * 0.3 < table.rotation_limit < table.gain * 0.6


def test_a_robot_that_points_to_where_it_looks_turns_with_the_bend_up_to_its_end() -> None:
    """By the curvature of an elbow of 90 degrees, until it looks at the straight behind it."""
    bench = Bench(scenario_of("elbow"))
    tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
    ahead, end = bench.scenario.control_parameters.tracking.lookahead, float(bench.routes.end[0])
    radius = bench.scenario.route.network.parts[1].fitting.mean_radius
    for before_end, rate in ((3 * ahead, 1 / radius), (1.1 * ahead, 1 / radius), (0.9 * ahead, 0)):
        at = end - before_end
        axis = bench.observe(at).rotation[0, :, 2]
        (tangent,) = bench.routes.tangents(np.array([[at + ahead]]), bench.route)[0]
        turn = unit(cross(axis, tangent)) * angle_between(axis, tangent)
        seen = bench.observe(at, tilt=turn)
        wanted = tracking.wanted_rotation(seen.location, seen.rotation, one, 0 * one, UPRIGHT)
        assert wanted[0] == pytest.approx(rate * unit(turn), abs=1e-6)


def test_a_robot_beside_the_centreline_heads_back_to_it_at_a_low_slope() -> None:
    """In proportion to its offset, and by less than 10 degrees however far it is beside."""
    bench = Bench(scenario_of("elbow"))
    tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
    gain, slopes = bench.scenario.control_parameters.tracking.gain, []
    for offset in (0.004, 0.008, 0.03, 0.06):
        seen = bench.observe(0.15, aside=[offset, 0.0, 0.0])
        wanted = tracking.wanted_rotation(
            seen.location, seen.rotation, one, tracking.centring, UPRIGHT
        )
        slopes.append(-wanted[0, 1] / gain)
    assert slopes[1] == pytest.approx(2 * slopes[0], rel=1e-2)
    assert slopes[1] < slopes[2] == pytest.approx(slopes[3])
    assert 0.0 < slopes[3] < np.radians(10.0)


def test_a_robot_that_backs_off_follows_the_centreline_behind_it() -> None:
    """Just past an elbow a robot in line with the pipe has nothing to turn for on its way forward;
    backward it is turned, as it goes, towards the tangents in the bend behind."""
    bench = Bench(scenario_of("elbow"))
    tracking = Tracking(bench.setup, "tracking")
    observation = bench.observe(float(bench.routes.end[0]) + 0.01)
    location, rotation = observation.location, observation.rotation
    ahead, back = (
        tracking.wanted_rotation(location, rotation, np.array([way]), np.zeros(1), UPRIGHT)
        for way in (1.0, -1.0)
    )
    assert length(ahead) == pytest.approx([0.0], abs=1e-9)
    # Backward is a negative speed: the rotation that comes of it is the opposite of ``back``.
    behind = bench.routes.tangents(location.distance[:, None] - 0.05, location.route)[:, 0]
    assert angle_between(rotation[:, :, 2], behind) > 0.1
    assert dot(cross(rotation[:, :, 2], behind), -back) > 0.1


@pytest.mark.parametrize("ahead", np.linspace(0.02, 0.08, 13).tolist())
def test_a_robot_that_points_anywhere_into_the_stretch_ahead_is_hardly_turned(ahead: float) -> None:
    """At any place of the stretch behind the lookahead point, in the sharpest bend that it leads
    through: at most a third of what turns a robot."""
    bench = Bench(scenario_of("tee_turn"))
    tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
    table, at = bench.scenario.control_parameters.tracking, float(bench.routes.start[0])
    points = np.array([at, at + table.lookahead + ahead])
    tangent, before = bench.routes.tangents(points[1:, None], bench.route)[0], bench.observe(at)
    axis = before.rotation[0, :, 2]
    turn = unit(cross(axis, tangent[0])) * angle_between(axis, tangent[0])
    seen = bench.observe(at, tilt=turn)
    wanted = tracking.wanted_rotation(seen.location, seen.rotation, one, 0 * one, UPRIGHT)
    assert angle_between(axis, tangent[0]) > 0.2
    assert length(wanted)[0] < table.rotation_limit / 3


def test_a_turn_up_a_run_begins_sooner_and_is_sharper() -> None:
    """Out of a branch with the weight against it a robot is turned by a lead and a cap of its own;
    level and downward by those of all turns."""
    routes = Bench(scenario_of("merge")).routes
    begun, sizes = [], []
    for share in (-0.9, 0.0, 0.9):
        gravity = (9.81 * share * routes.directions[0]).tolist()
        bench = Bench(scenario_of("merge", **{"world.gravity": gravity}))
        tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
        before = bench.observe(float(bench.routes.start[0]) - 0.035)
        inside = bench.observe(bench.inside(), tilt=np.array([0.0, 0.0, 1.5]))
        first, wanted = (
            tracking.wanted_rotation(seen.location, seen.rotation, one, 0 * one, UPRIGHT)
            for seen in (before, inside)
        )
        begun.append(bool(length(first)[0] > 0.01))
        sizes.append(float(length(wanted)[0]))
    table = bench.scenario.control_parameters.tracking
    assert begun == [True, False, False]
    assert sizes == pytest.approx([table.upward_rotation_limit] + [table.rotation_limit] * 2)
    assert table.upward_rotation_limit > 1.2 * table.rotation_limit


def test_a_turn_up_a_run_is_steered_harder() -> None:
    """By a gain of its own where the weight is against the robot; level and downward by that of all
    turns."""
    directions, gains = Bench(scenario_of("merge")).routes.directions, []
    for share in (-0.9, 0.0, 0.9):
        gravity = (9.81 * share * directions[0]).tolist()
        bench = Bench(scenario_of("merge", **{"world.gravity": gravity}))
        tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
        seen = bench.observe(0.1, tilt=0.1 * cross(bench.routes.ahead[0], directions[0]))
        wanted = tracking.wanted_rotation(seen.location, seen.rotation, one, 0 * one, UPRIGHT)
        gains.append(float(length(wanted)[0]) / 0.1)
    table = bench.scenario.control_parameters.tracking
    assert gains == pytest.approx([table.upward_gain] + [table.gain] * 2)
    assert table.upward_gain > 1.2 * table.gain


@pytest.mark.parametrize("name", WAYS)
def test_a_robot_hurries_in_a_turn_into_a_branch_only(name: str) -> None:
    """There its weight would carry it past; elsewhere its belts run at the cruise speed in the
    mean."""
    bench = Bench(scenario_of(name, **{"control.cruise_speed": 0.05}))
    cruise = bench.scenario.control.cruise_speed
    mean = bench.step(float(bench.routes.start[0])).belt_speed.mean()
    assert bench.step(0.1).belt_speed.mean() == pytest.approx(cruise)
    if name == "tee_turn":
        assert mean > 1.1 * cruise
    else:
        assert mean == pytest.approx(cruise)


def merging(
    share: float,
    progress: float,
    rate: float = 6.0,
    slip: float = 1.0,
    again: bool = False,
    over: float = 0.0,
    aside: float = 0.0,
) -> Array:
    """Wall speeds (3,) m/s, inner module first, of a robot that turns out of a branch at ``rate``
    rad/s, ``share`` of its weight along the run, is at ``progress`` of the arc and has turned
    further by ``over`` rad, and leans out of the turn's plane by ``aside`` rad; in the beginning of
    the turn it has slipped by ``slip``."""
    scenario = scenario_of("merge", **{"control.retry": True})
    routes = Bench(scenario).routes
    gravity = (9.81 * share * routes.directions[0]).tolist()
    bench = Bench(ot.override(scenario, {"world.gravity": gravity}))
    assert isinstance(bench.controller, JacobianController)
    bench.controller.recovery.retries[:] = again
    bench.controller.recovery.passage[:] = 0
    start, end = float(routes.start[0]), float(routes.end[0])
    plane = cross(routes.ahead[0], routes.directions[0])

    across = unit(
        routes.directions[0] - routes.ahead[0]
    )  # in the plane, square to half of the turn

    def turned(
        progress: float, rate: float, slip: float, over: float = 0.0, aside: float = 0.0
    ) -> Array:
        distance = start + progress * (end - start)
        tilt = over * plane + aside * across if over or aside else None
        normal = bench.observe(distance, tilt=tilt).rotation[0].T @ plane
        belts = module_speeds(0.0, rate * normal[0], rate * normal[1], BORE / 2)
        spin = (1.0 - slip) * rate * normal
        seen = {"wall_speed": belts, "angular_velocity": spin}
        return bench.step(distance, tilt=tilt, **seen).belt_speed[0]

    for part in np.linspace(0.05, 0.3, 10):
        turned(part, 2.0, slip)
    # The filter of the rate settles, and the robot does not hang yet.
    return [turned(progress, rate, 0.0, over, aside) for _ in range(20)][-1]


def test_a_robot_that_leans_out_of_its_turn_is_turned_back_into_it_first() -> None:
    """Up a run the outer belts hold one that leans by more than 15 degrees, and drive one that
    leans by less."""
    cruise = scenario_of("merge").control.cruise_speed
    less, more = (merging(-0.9, 0.5, aside=np.radians(lean))[1:] for lean in (12.0, 18.0))
    assert less.min() == pytest.approx(2 * cruise)
    assert more.min() < cruise


def test_up_a_run_the_outer_belts_never_hold_a_robot_that_turns_too_fast() -> None:
    """Out of a branch with the weight against it, as long as it turns and slips: at the far wall
    they would drive it down. Elsewhere they turn it back."""
    cruise = scenario_of("merge").control.cruise_speed
    assert merging(-0.9, 0.5)[1:] == pytest.approx([2 * cruise] * 2)
    others = (
        merging(-0.9, 0.9, over=0.3),
        merging(-0.9, 0.5, slip=0.2),
        merging(-0.7, 0.5),
        merging(0.9, 0.5),
    )
    for speeds in others:
        assert (speeds[1:] < 0.5 * cruise).all()


def test_no_belt_brakes_when_a_robot_tries_again_out_of_a_branch() -> None:
    """One that holds on to the rim is as strong as another one that pushes."""
    cruise = scenario_of("merge").control.cruise_speed
    assert merging(0.9, 0.35, rate=0.0)[0] < 0.0
    assert merging(0.9, 0.35, rate=0.0, again=True)[0] == pytest.approx(0.5 * cruise)


@pytest.mark.parametrize(("progress", "rolls"), [(0.5, False), (0.8, True)])
def test_a_robot_that_hangs_upright_before_a_branch_rolls_there(
    progress: float, rolls: bool
) -> None:
    """Backing off it would fall into the other half of the run. It rolls until the opening is
    between two modules, as for driving past."""
    changes = {"control.retry": True, "control.align": True}
    recovery = {"merge_patience": 0.016, "back_off": 10.0, "retries": 1}
    changes |= {f"control.parameters.recovery.{key}": value for key, value in recovery.items()}
    bench = Bench(scenario_of("merge", **changes))
    start, end = bench.routes.start[0], bench.routes.end[0]
    at = float(start + progress * (end - start))
    commands = [bench.step(at) for _ in range(400)]
    events = [event for command in commands for event in command.events]
    assert isinstance(events[0], BackedOff)
    assert ("rolls where it is" in str(events[0])) == rolls
    assert [type(event) for event in events[1:2]] == [Rolled] * rolls
    if rolls:
        turn = -np.degrees(commands[-1].roll[0, 0]) * bench.scenario.robot.lug_radius / (BORE / 2)
        margin = np.degrees(safe_margin(sector_angle(BORE / 2, bench.scenario.robot.reach)))
        assert abs(turn) == pytest.approx(60.0, abs=margin)


@pytest.mark.parametrize(
    ("progress", "moves", "rolls"), [(0.2, False, 1), (0.2, True, 0), (0.5, False, 0)]
)
def test_a_robot_that_hangs_beside_a_branch_rolls_astride_it_before_it_backs_off(
    progress: float, moves: bool, rolls: int
) -> None:
    """Upright, where its belts do not bring it back, and once: a module at the opening has no wall,
    and the others are not pressed to theirs. It rolls until the opening is between two modules,
    stands meanwhile, and backs off."""
    recovery = {"patience": 0.016, "hesitation": 0.04, "back_off": 2.0, "retries": 1}
    changes = {f"control.parameters.recovery.{key}": value for key, value in recovery.items()}
    changes |= {"control.retry": True, "control.align": True}
    bench = Bench(scenario_of("tee_turn", **changes))
    start, end = bench.routes.start[0], bench.routes.end[0]
    at, back = float(start + progress * (end - start)), 0.0002 * moves  # m, and m a step
    commands = [bench.step(at - back * k, 6.0) for k in range(200 if moves else 1700)]
    events = [(k, event) for k, command in enumerate(commands) for event in command.events]
    assert isinstance(events[0][1], BackedOff)
    assert [type(event) for _, event in events[1:]] == [Rolled] * rolls
    if rolls:
        turn = -np.degrees(commands[-1].roll[0, 0]) * bench.scenario.robot.lug_radius / (BORE / 2)
        margin = np.degrees(safe_margin(sector_angle(BORE / 2, bench.scenario.robot.reach)))
        assert abs(turn) == pytest.approx(60.0, abs=margin)
        assert (commands[events[1][0]].belt_speed == 0.0).all()
        assert (commands[-1].belt_speed < 0.0).all()


@pytest.mark.parametrize("gain", [40.0, 5.0])
@pytest.mark.parametrize("slip", [0.1, 0.3, 0.6, 1.0, 1.5])
def test_a_turn_that_has_slipped_begins_sooner(slip: float, gain: float) -> None:
    """By the distance that its heading would lag behind an arc, up to ``slip_lead``: belts that
    give 1 - slip of the rotation follow an arc with an error of slip / (1 - slip) / gain, and those
    of a robot that was turned back not at all."""
    bench = Bench(scenario_of("tee_turn", **{"control.parameters.tracking.gain": gain}))
    table = bench.scenario.control_parameters.tracking
    lag = slip / (1 - slip) / gain if slip < 1 else np.inf
    lead = begun(bench) - begun(bench, UPRIGHT._replace(slip=np.array([slip])))
    assert lead == pytest.approx(min(lag, table.slip_lead), abs=3e-4)
    assert lead > 0.001


def begun(bench: Bench, lean: Lean = UPRIGHT, way: float = 1.0) -> float:
    """Where, m along the route, a robot that has not turned is first asked to turn.

    ``way``: -1 for one that drives backward.
    """
    tracking, one = Tracking(bench.setup, "tracking"), np.ones(1)
    upright = bench.observe(0.1).rotation  # as before the turn
    start, end = float(bench.routes.start[0]), float(bench.routes.end[0])
    for distance in np.arange(start - 0.06, end, 0.0002):
        location = bench.observe(distance).location
        wanted = tracking.wanted_rotation(location, upright, way * one, 0 * one, lean)
        if length(wanted)[0] > 0.1:
            return float(distance)
    raise AssertionError("the turn does not begin")


WEAK = {"like": "pololu_1000_hpcb", "torque_limit": 0.4}
"""A motor that gives less than the 0.52 N m which bend a robot of 25 N."""
NO_LEAD = {"control.parameters.tracking.downward_lead": 0.0}


@pytest.mark.parametrize(
    ("down", "share"), [(-1.0, 0.0), (0.0, 0.0), (0.5, 0.0), (0.65, 0.5), (0.8, 1.0), (1.0, 1.0)]
)
@pytest.mark.parametrize("slip", [0.0, 0.99])
def test_a_weak_motor_begins_its_turn_into_a_branch_sooner_down_a_steep_run(
    down: float, share: float, slip: float
) -> None:
    """From half of the weight down the run on, in full from 0.8 on; one that has slipped as well
    begins sooner by the longer of both leads. Backing off knows none."""
    weight = [0.0, -9.81 * np.sqrt(1 - down**2), 9.81 * down]
    changes: dict[str, Any] = {"world.gravity": weight, "robot.motor": WEAK}
    bench, plain = (Bench(scenario_of("tee_turn", **changes, **own)) for own in ({}, NO_LEAD))
    table = bench.scenario.control_parameters.tracking
    lean = UPRIGHT._replace(slip=np.array([slip]))
    lead = max(share * table.downward_lead, table.slip_lead if slip else 0.0)
    assert begun(plain) - begun(bench, lean) == pytest.approx(lead, abs=3e-4)
    assert begun(bench, way=-1.0) == begun(plain, way=-1.0)


@pytest.mark.parametrize(
    ("limit", "preload", "share"),
    [(0.2, 10.0, 1.0), (0.5, 20.0, 0.58), (0.6, 20.0, 0.1), (0.6, 15.0, 0.0), (1.18, 35.0, 0.0)],
)
def test_the_lead_down_a_run_goes_by_the_torque_that_bends_the_robot(
    limit: float, preload: float, share: float
) -> None:
    """Two thirds of preload times contact length act at the lug radius over the pipe's: in full up
    to as much, none from half as much again."""
    changes: dict[str, Any] = {
        "world.gravity": [0.0, 0.0, 9.81],
        "robot.motor": WEAK | {"torque_limit": limit},
        "robot.preload": preload,
    }
    robot = scenario_of("tee_turn", **changes).robot
    bends = 2 / 3 * preload * robot.contact_length * robot.lug_radius / (BORE / 2)
    assert share == pytest.approx(np.clip((1.5 - limit / bends) / 0.5, 0, 1), abs=0.01)
    bench, plain = (Bench(scenario_of("tee_turn", **changes, **own)) for own in ({}, NO_LEAD))
    table = bench.scenario.control_parameters.tracking
    assert begun(plain) - begun(bench) == pytest.approx(share * table.downward_lead, abs=4e-4)


def test_what_nothing_presses_needs_no_lead() -> None:
    """A robot without preload, whatever its motor."""
    changes: dict[str, Any] = {
        "world.gravity": [0.0, 0.0, 9.81],
        "robot.motor": WEAK | {"torque_limit": 0.01},
        "robot.preload": 0.0,
    }
    bench, plain = (Bench(scenario_of("tee_turn", **changes, **own)) for own in ({}, NO_LEAD))
    assert begun(bench) == begun(plain)


@pytest.mark.parametrize("name", ["merge", "elbow"])
@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_elbows_and_turns_out_of_a_branch_know_no_downward_lead(
    name: str, index: int, sign: float
) -> None:
    """Whichever way the weight points."""
    weight = (sign * 9.81 * np.eye(3)[index]).tolist()
    changes: dict[str, Any] = {"world.gravity": weight, "robot.motor": WEAK}
    bench, plain = (Bench(scenario_of(name, **changes, **own)) for own in ({}, NO_LEAD))
    assert begun(bench) == begun(plain)


@pytest.mark.parametrize("name", ["elbow", "tee_straight", "tee_turn"])
def test_a_stop_inside_is_worth_it_before_a_tee_turn_only(name: str) -> None:
    """With its nose in the fitting already, a robot from the worst orientation stops to roll for a
    tee turn; where any orientation goes it drives on."""
    worst = {"elbow": 60.0, "tee_straight": 0.0, "tee_turn": 60.0}[name]
    bench = Bench(scenario_of(name, **{"control.align": True}))
    nose_in = float(bench.routes.start[0]) - bench.scenario.robot.length / 2 + 0.005
    commands = [bench.step(nose_in, worst) for _ in range(200)]
    stops = any(command.resting.any() for command in commands[150:])  # type: ignore[union-attr]
    rolls = [event for command in commands for event in command.events]
    assert stops == (name == "tee_turn")
    assert bool(rolls) == (name == "tee_turn")


@pytest.mark.parametrize(("theta5_deg", "rolls"), [(0.0, -1), (2.0, 1), (-5.0, 0), (9.0, 0)])
def test_a_robot_does_not_turn_into_a_branch_dead_on(theta5_deg: float, rolls: int) -> None:
    """Before a tee turn it rolls off the best orientation, to the nearer side, and stays where it
    is beside it; told to keep nothing beside, it stays dead on."""
    changes: dict[str, Any] = {"control.align": True}
    for aside, sign in (({}, rolls), ({ASIDE: (0.0, 0.0, 0.0)}, 0)):
        bench = Bench(scenario_of("tee_turn", **changes, **aside))
        before = float(bench.routes.start[0]) - bench.scenario.robot.length / 2 - 0.01
        command = [bench.step(before, theta5_deg) for _ in range(50)][-1]
        turn = -np.degrees(command.roll[0, 0]) * bench.scenario.robot.lug_radius / (BORE / 2)
        assert np.sign(turn) == sign
        if sign:
            margin = np.degrees(safe_margin(sector_angle(BORE / 2, bench.scenario.robot.reach)))
            assert abs(theta5_deg + turn) == pytest.approx(0.45 * margin)


@pytest.mark.parametrize("attempts", [1, 3])
def test_a_robot_whose_rolls_do_not_help_gives_up_after_its_attempts(attempts: int) -> None:
    """Before a tee, with modules that do not turn, it plans as many rolls as it may, and goes
    on."""
    alignment = {"attempts": attempts, "patience": 0.1, "roll_settled": 0.001}
    changes = {f"control.parameters.alignment.{key}": value for key, value in alignment.items()}
    changes |= {"control.align": True, "robot.roll_rate": 10.0}
    bench = Bench(scenario_of("tee_turn", **changes))
    before = float(bench.routes.start[0]) - bench.scenario.robot.length / 2 - 0.01
    commands = [bench.step(before, 60.0) for _ in range(300)]
    events = [event for command in commands for event in command.events]
    assert [type(event) for event in events] == [Rolled] * attempts
    assert commands[10].resting.all()  # type: ignore[union-attr]
    assert not commands[-1].resting.any()  # type: ignore[union-attr]


@pytest.mark.parametrize("turn_deg", [-130.0, -10.0, 10.0, 130.0])
def test_two_elbows_close_together_are_prepared_for_at_once(turn_deg: float) -> None:
    """A robot oriented as the aligner wants it before the first of two elbows, turned against each
    other, comes into both of them within the range that each asks for."""
    pipes = [WAYS["elbow"], WAYS["elbow"] | {"turn_deg": turn_deg}]
    bench = Bench(scenario_of(*pipes, **{"control.align": True}))
    aligner = Aligner(bench.setup, "alignment")
    best, margin = aligner.ranges.best[:, 0, 0, 0], aligner.ranges.half_width[:, 0, 0, 0]
    assert best.shape == margin.shape == (AIMS,)
    start, frame = bench.routes.start[:2], bench.scenario.route.centreline.frame
    # Without twist: a direction keeps its coordinates in the frame of the centreline.
    towards = [bench.routes.directions[i] @ frame(start[i : i + 1])[0] for i in (0, 1)]
    later = np.arctan2(towards[0][1], towards[0][0]) - np.arctan2(towards[1][1], towards[1][0])
    single = Bench(scenario_of("elbow", **{"control.align": True}))
    asked = Aligner(single.setup, "alignment").ranges.half_width[:, 0, 0, 0]
    assert (np.abs(orientation_error(best, 0.0)) <= asked + 1e-9).all()
    assert (np.abs(orientation_error(best + later, 0.0)) <= asked + 1e-9).all()
    assert (margin < asked).all()


@pytest.mark.parametrize(("length", "together"), [(0.15, True), (0.6, False)])
def test_elbows_with_room_to_stand_between_are_prepared_for_one_by_one(
    length: float, together: bool
) -> None:
    """The first as if there were no other; with less room the range is narrower."""
    later = WAYS["elbow"] | {"turn_deg": 130.0}
    pipes = [WAYS["elbow"], {"kind": "straight", "length": length}, later]
    two, one = (
        Aligner(Bench(scenario_of(*way, **{"control.align": True})).setup, "alignment").ranges
        for way in (pipes, ["elbow"])
    )
    first = two.half_width[:, 0, 0, 0], one.half_width[:, 0, 0, 0]
    assert (first[0] < first[1]).all() if together else (first[0] == first[1]).all()
    if not together:
        assert (two.best[:, 0, 0, 0] == one.best[:, 0, 0, 0]).all()


@pytest.mark.parametrize(("name", "backs"), [("tee_turn", True), ("merge", False)])
def test_a_robot_that_has_gone_past_a_branch_backs_off(name: str, backs: bool) -> None:
    """Beside the centreline by more than ``beside`` radii, ``weak_beside`` with weak springs, it
    backs off at once; out of a branch there is nothing to go past, and up to there it drives on."""
    limits = ((25.0, 0.5, False), (25.0, 0.7, backs), (16.0, 0.35, False), (16.0, 0.5, backs))
    for preload, share, off in limits:
        bench = Bench(scenario_of(name, **{"control.retry": True, "robot.preload": preload}))
        observation = bench.observe(bench.inside())
        out = -cross(observation.location.tangent, observation.location.normal)[0]
        command = bench.step(bench.inside(), aside=share * BORE / 2 * out)
        assert [type(event) for event in command.events] == [BackedOff] * off
        assert command.resting.tolist() == [off]  # type: ignore[union-attr]


@pytest.mark.parametrize(("part", "off"), [(0.6, True), (0.9, False)])
def test_a_robot_that_has_nearly_turned_is_past_nothing(part: float, off: bool) -> None:
    """As far beside the centreline as one that backs off, it goes on: its nose is in the branch."""
    bench = Bench(scenario_of("tee_turn", **{"control.retry": True, "robot.preload": 25.0}))
    seen, routes = bench.observe(bench.inside()).location, bench.routes
    out, plane = -cross(seen.tangent, seen.normal)[0], cross(routes.ahead[0], routes.directions[0])
    tilt = part * np.pi / 2 * plane
    here = bench.observe(0.1).rotation  # as before the turn
    rotation = rotation_about(tilt, np.linalg.norm(tilt)) @ here
    assert routes.progress(seen.passage, rotation) == pytest.approx([part])
    command = bench.step(bench.inside(), aside=0.7 * BORE / 2 * out, rotation=rotation[0])
    assert [type(event) for event in command.events] == [BackedOff] * off


@pytest.mark.parametrize(
    ("roll_deg", "changes", "held"),
    [
        (30.0, {}, False),
        (-100.0, {}, False),
        (30.0, {}, True),
        (30.0, {"control.parameters.recovery.square": False}, False),
        (30.0, {"control.align": False}, False),
    ],
)
def test_tracks_roll_to_the_wall_before_a_robot_backs_off(
    roll_deg: float, changes: dict[str, Any], held: bool
) -> None:
    """The short way, on the spot, until they face it, or for a time where friction holds them; then
    the belts run backward. A robot that is not to align does not roll."""
    usual = {"control.align": True, "control.retry": True}
    bench = Bench(scenario_of("tee_turn", **usual | changes))
    controller = bench.controller
    assert isinstance(controller, JacobianController)
    aligner, roll = controller.aligner, np.full((1, 3), np.radians(roll_deg))
    aligner.rolls.now[:] = aligner.rolls.target[:] = roll
    aligner.aligned[:] = 1
    observation = bench.observe(bench.inside())
    out = -cross(observation.location.tangent, observation.location.normal)[0]
    steps, wanted = 0, np.radians(roll_deg)
    facing = np.pi * np.round(wanted / np.pi)
    while steps < 400:
        seen = np.full(3, wanted) if held else roll[0]
        command = bench.step(bench.inside(), aside=0.7 * BORE / 2 * out, roll=seen)
        roll = command.roll
        if np.any(command.belt_speed):
            break
        steps += 1
    if not changes:
        table = bench.scenario.control_parameters.alignment
        rolling = abs(facing - wanted) / bench.scenario.robot.roll_rate
        wait = table.patience if held else 0.0
        assert steps * PERIOD == pytest.approx(rolling + wait, abs=0.03)
        wanted = facing
    else:
        assert steps == 0
    assert roll == pytest.approx(np.full((1, 3), wanted), abs=0.02)
    assert (command.belt_speed * np.sign(np.cos(roll))).mean() < 0
    assert controller.phases[int(command.phase[0])] == "back_off"


def test_a_robot_that_is_about_to_slide_past_backs_off_as_it_is() -> None:
    """It is in the pipe yet, and has no time to roll."""
    changes = {"control.align": True, "control.retry": True}
    bench = Bench(scenario_of("tee_turn", **changes))
    controller, roll = bench.controller, np.full((1, 3), 0.5)
    assert isinstance(controller, JacobianController)
    controller.aligner.rolls.now[:] = controller.aligner.rolls.target[:] = roll
    controller.aligner.aligned[:] = 1
    controller.sway.slides = np.ones(1, bool)
    command = bench.step(bench.inside(), roll=roll[0])
    assert [event.cause for event in command.events if isinstance(event, BackedOff)] == ["slips"]
    assert command.roll == pytest.approx(roll)
    assert command.belt_speed.mean() < 0


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_a_robot_backs_off_as_often_as_it_may(retries: int) -> None:
    """In a turn in which it hangs for good, whatever it tries."""
    recovery = {"retries": retries, "patience": 0.016, "back_off": 0.032}
    changes = {f"control.parameters.recovery.{key}": value for key, value in recovery.items()}
    bench = Bench(scenario_of("elbow", **changes | {"control.retry": True}))
    commands = [bench.step(bench.inside()) for _ in range(400)]
    events = [event for command in commands for event in command.events]
    assert [type(event) for event in events] == [BackedOff] * retries


@pytest.mark.parametrize(
    ("theta5_deg", "retry", "rolls"), [(0.0, True, 1), (60.0, True, 0), (0.0, False, 0)]
)
def test_a_robot_that_hangs_straight_over_an_opening_rolls_there(
    theta5_deg: float, retry: bool, rolls: int
) -> None:
    """Where it is badly oriented, as one is that has fallen there; it does not drive meanwhile. As
    long as it does not hang, it drives on as it is."""
    changes = {"control.retry": retry, "control.align": True}
    changes |= {"control.parameters.recovery.patience": 0.016}
    bench = Bench(scenario_of("tee_straight", **changes))
    at = bench.inside()
    first = [bench.step(at, theta5_deg) for _ in range(10)]
    assert [event for command in first for event in command.events] == []
    then = [bench.step(at, theta5_deg) for _ in range(20)]
    events = [event for command in then for event in command.events]
    assert [(type(event), event.place) for event in events] == [(Rolled, "in")] * rolls
    assert then[-1].resting.tolist() == [rolls > 0]  # type: ignore[union-attr]


def test_the_state_of_a_controller_turns_round_with_the_robot() -> None:
    """A robot sent back the way it came goes on with the rolls of its modules, and its rotation
    rate, as they are seen from behind; one sent on nose first keeps them as they are."""
    for gear, expected in ((-1, [-0.1, -0.3, -0.2]), (1, [0.1, 0.2, 0.3])):
        bench = Bench(scenario_of("tee_turn"))
        controller, rate = bench.controller, np.array([0.3, -0.2, 0.5])
        assert isinstance(controller, JacobianController)
        aligner = controller.aligner
        aligner.rolls.now[0] = aligner.rolls.target[0] = [0.1, 0.2, 0.3]
        for _ in range(20):
            bench.step(0.2, angular_velocity=rate)
        seen = rate * [1.0, gear, gear]
        after = bench.observe(0.2, angular_velocity=seen)
        after.leg, after.gear = np.ones(1, int), np.array([gear])
        command = controller.step(after)
        assert command.roll == pytest.approx(np.array([expected]))
        assert controller.angular_velocity[0] == pytest.approx(seen)
