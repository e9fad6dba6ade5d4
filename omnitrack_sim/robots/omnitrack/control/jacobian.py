"""The default controller: track the centreline, align before fittings, retry."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import TURNED, ordered_sum
from omnitrack_sim.base.table import NotNegative, Table, Unit
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.alignment import Aligner, AlignmentTable
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.control.orientation import manoeuvres
from omnitrack_sim.robots.omnitrack.control.recovery import Recovery, RecoveryTable
from omnitrack_sim.robots.omnitrack.control.sway import Sway, SwayTable
from omnitrack_sim.robots.omnitrack.control.tracking import (
    SLIPPERY,
    Tracking,
    TrackingTable,
    wall_speeds,
)
from omnitrack_sim.robots.omnitrack.drive import drive_of

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT, BACK_OFF = range(6)
_PHASES = {"elbow": ELBOW, "tee_turn": TEE_TURN, "tee_straight": TEE_STRAIGHT, None: CRUISE}


class DampingTable(Table):
    """Rotation asked in addition, per rad/s that the rotation is too slow or too fast."""

    elbow: Annotated[NotNegative, Unit("1")] = 2.5
    """In elbows; it keeps the robot centred."""
    tee_turn: Annotated[NotNegative, Unit("1")] = 1.85
    """In turns into a branch. There the inner module has lost the wall and the springs can turn the
    robot over in 0.2 s."""
    tee_straight: Annotated[NotNegative, Unit("1")] = 3.0
    """Straight over a tee."""
    # Out of a branch 298 of 300 robots pass, 294 with 5, 273 with 8, 296 with 1.5 (friction 0.7 to
    # 1.0, no retry). Also while backing off into the branch again, where the tail has to find the
    # way in: 7 of 10 robots pass in the end, and none without it. Backing off from elsewhere goes
    # better without.
    merge: Annotated[NotNegative, Unit("1")] = 2.5
    """Out of a branch into a run, and while backing off into the branch to try again."""
    rate_filter: Annotated[NotNegative, Unit("s")] = 0.005
    """Time constant of the low pass on the measured rotation rate, for D = 160 mm. Single lugs
    shake the robot."""


class FeedbackTable(Table):
    """``[control.parameters]`` of the controller ``jacobian``."""

    tracking: TrackingTable = TrackingTable()
    sway: SwayTable = SwayTable()
    damping: DampingTable = DampingTable()
    alignment: AlignmentTable = AlignmentTable()
    recovery: RecoveryTable = RecoveryTable()


class LegWatch:
    """Notices when robots have been sent onto another leg or route.

    Attributes:
        grown: routes have been added since the last observation: what was looked up in them has to
            be looked up again.
        extended: robots whose leg goes on, on a route that begins as the last one, and by how much
            the numbers of its passages are larger.
    """

    def __init__(self, setup: ControlSetup) -> None:
        self._leg, self._gear = np.zeros((2, setup.n), int)
        self._route = np.zeros(setup.n, np.intp)
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self._routes, self._version = setup.routes, setup.routes.version
        self._leg = self._leg.copy()  # an observation's own array
        self._leg[rows] = -1  # the first observation is no change
        self.grown = False
        self.extended: list[tuple[int, int]] = []

    def changes(self, observation: Observation) -> list[tuple[int, bool]]:
        """Robots on another leg than before, and whether each drives in the other gear now."""
        leg, gear, route = self._leg, self._gear, self._route
        self.grown = self._routes.version != self._version
        self._version = self._routes.version
        self._route = observation.location.route
        self.extended = []
        if leg is observation.leg and route is self._route:
            return []
        self._leg, self._gear = observation.leg, observation.gear
        known, same = leg >= 0, leg == observation.leg
        first = self._routes.first
        self.extended = [
            (robot, int(first[self._route[robot]] - first[route[robot]]))
            for robot in np.flatnonzero(known & same & (route != self._route)).tolist()
        ]
        robots = np.flatnonzero(known & ~same).tolist()
        return [(robot, bool(gear[robot] != observation.gear[robot])) for robot in robots]


class JacobianController:
    """Tracks the centreline of straights, elbows and tees through the inverse Jacobian.

    It stops and rolls the modules where theta5 is outside the safe margin.

    A robot that makes no headway in a turn rolls its tracks to the wall, backs off to where the
    turn began, aligns anew and tries again. One whose inner module slips in a turn into a branch
    sways, and once more when it tries again; where it slips much, the turn is begun again, sooner,
    before the robot slides past.
    """

    phases: ClassVar[tuple[str, ...]] = (
        "cruise",
        "align",
        "elbow",
        "tee_turn",
        "tee_straight",
        "back_off",
    )
    Parameters: ClassVar[type[Table]] = FeedbackTable

    def __init__(self, setup: ControlSetup) -> None:
        self.sway = Sway(setup, "sway")
        self.aligner = Aligner(setup, "alignment")
        self.recovery = Recovery(setup, "recovery")
        self._legs = LegWatch(setup)
        self._rows = np.arange(setup.n)
        self.resting = np.zeros(setup.n, bool)
        self.angular_velocity = np.zeros((setup.n, 3))  # rad/s, robot frame, smoothed
        self.reset(self._rows, setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        for part in (self.sway, self.aligner, self.recovery, self._legs):
            part.reset(rows, setup)
        self.routes, self.robot, self.settings = setup.routes, setup.robot, setup.settings
        self.tracking = Tracking(setup, "tracking")
        self._steers = drive_of(setup.robot.drive).steers
        self._turn_speed = setup.each("tracking.turn_speed")
        droop = setup.own("motor.speed_droop") * setup.robot.lug_radius  # m/s for 1 N m
        self._turn_yield = setup.each("tracking.turn_yield") * droop
        self._damping = {name: setup.each(f"damping.{name}") for name in DampingTable.model_fields}
        time = self._damping["rate_filter"] * setup.robot.time_scale
        # A low pass of first order by the backward Euler rule, which is stable for any period.
        self._smoothing = (setup.period / (time + setup.period))[:, None]
        self._forward, nobody = np.ones(setup.n), np.zeros(setup.n, bool)
        # Phase, and who is damped, turns into a branch or out of one, while all are on their way.
        self._cruising = np.full(setup.n, CRUISE), nobody, nobody, nobody
        self.resting = self.resting.copy()  # the last command holds the array
        self.resting[rows], self.angular_velocity[rows] = False, 0.0
        self._build_tables()

    def _build_tables(self) -> None:
        """Look up what each passage of the routes asks for."""
        wanted, none = manoeuvres(self.routes), np.zeros(len(self._rows))
        self.kind = np.array([_PHASES[m] for m in wanted])  # (Q,) phase in each passage
        gains = [none if m is None else self._damping[m] for m in wanted]  # Q times (n,)
        merge = self._damping["merge"]
        merging = zip(gains, self.routes.out_of_branch, strict=True)
        self.rate_gain = np.array([merge if out else gain for gain, out in merging])  # (Q, n)
        self.speed_inside = self.settings.speed_in(self.routes.sharpness[:, None])  # (Q, n) m/s

    def _follow_legs(self, observation: Observation) -> None:
        """Prepare robots that have been sent onto another route."""
        changes = self._legs.changes(observation)
        if self._legs.grown:
            self._build_tables()
            self.aligner.ranges.update()
        for robot, shift in self._legs.extended:
            self.aligner.extend_leg(robot, shift)
            self.recovery.extend_leg(robot, shift)
        for robot, turned in changes:
            self.aligner.begin_leg(robot, turned, int(observation.location.route[robot]))
            self.recovery.begin_leg(robot)
            if turned:
                # The same rotation, in the frame of a robot that drives the other way round from
                # now on.
                self.angular_velocity[robot] *= TURNED

    def _phase(
        self,
        inside: NDArray[np.bool_],
        backing: NDArray[np.bool_],
        aligning: NDArray[np.bool_],
        passage: NDArray[np.intp],
    ) -> NDArray[np.int_]:
        """Phase (n,) of robots that are inside a fitting, back off or roll."""
        phase = np.where(inside, self.kind.take(passage), CRUISE)
        return np.where(aligning, ALIGN, np.where(backing, BACK_OFF, phase))

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        self._follow_legs(observation)
        location, s = observation.location, self.settings
        room = self.routes.nose_room(location, self.robot.length)
        # Recovery first: it may have the aligner plan anew, in this very step.
        backing, retried = self.recovery.step(
            observation, self.resting, self.sway.slides, room, self.aligner
        )
        standing, rolled = self.aligner.step(observation, room)
        aligning = np.where(backing, self.aligner.rolls.waited_for, standing)
        self.resting = aligning | backing
        rate = self.angular_velocity
        self.angular_velocity = rate + self._smoothing * (observation.angular_velocity - rate)
        inside, direction = room < 0, self._forward
        cruise, damped, turning, merging = self._cruising
        phase, cruise_speed = cruise.copy(), s.cruise_speed
        if np.count_nonzero(inside | self.resting):
            phase = self._phase(inside, backing, aligning, location.passage)
            out = self.routes.out_of_branch.take(location.passage)
            damped = inside & ~self.recovery.hesitating & ~aligning
            damped = np.where(backing, out, damped)
            direction = np.where(backing, -1.0, 1.0)
            in_turn = phase == TEE_TURN
            turning = in_turn & self.routes.into_branch.take(location.passage)
            merging = in_turn & out
            # Where the belts on the outer side would have to run faster than the motors do.
            slower = self.speed_inside[location.passage, self._rows]
            cruise_speed = np.where(inside, slower, cruise_speed)
        speed = cruise_speed * np.where(turning, self._turn_speed, 1.0)
        centring = self.tracking.centring * ((phase == CRUISE) | (phase == TEE_STRAIGHT))
        again = self.recovery.retries > 0
        # The same commands would slip again. A turn that gripped has failed for want of torque, of
        # which leaning takes more.
        leaning = again & self.sway.slipped
        lean = self.sway.step(observation, turning, merging, leaning)
        wanted = self.tracking.wanted_rotation(
            location, observation.rotation, direction, centring, lean
        )
        wall_speed = wall_speeds(
            observation.rotation,
            self.angular_velocity,
            self.rate_gain[location.passage, self._rows] * damped,
            wanted,
            direction * speed,
            self.routes.radius.take(location.passage),
            s.speed_limit,
        )
        if np.count_nonzero(merging):
            # Until the slip is known it may be large.
            slips = ~self.sway.known | (self.sway.slip > SLIPPERY)
            raised = self.tracking.forward_out_of_branch(
                wall_speed, location, observation.rotation, slips, again, cruise_speed
            )
            raised = np.minimum(raised, s.speed_limit[:, None])
            wall_speed = np.where(merging[:, None], raised, wall_speed)
        if not self._steers:
            # What cannot be given is not asked: a cap on the speeds would change their mean.
            wall_speed = np.repeat((direction * speed)[:, None], 3, axis=1)
        sign = self.aligner.rolls.belt_sign(observation.roll)
        yielding = turning & self.sway.grips & ~leaning & self._steers
        if np.count_nonzero(yielding):
            load = observation.motor_torque * sign
            beyond = load - ordered_sum(load)[:, None] / load.shape[1]
            wall_speed = wall_speed - (self._turn_yield * yielding)[:, None] * beyond
        belt_speed = wall_speed * sign
        if np.count_nonzero(aligning):
            belt_speed = np.where(aligning[:, None], 0.0, belt_speed)
        roll = self.aligner.rolls.now.copy()
        return Command(belt_speed, roll, phase, self.resting, [*retried, *rolled])
