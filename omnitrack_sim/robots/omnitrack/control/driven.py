"""Controller that obeys the orders of a driver, who may hand over to an autopilot.

An order says what is asked from its time on: a speed, a heading, a roll. The heading is a direction
and no rate of turning, because nobody reacts fast enough for a rate: in a tee, where the inner
module has lost the wall, the springs can turn a robot over in 0.2 s.

Orders are kept as they are given, so that a scenario that holds them repeats the run that they made
to the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np

from omnitrack_sim.base.rotations import Array, angle_between, cross, unit
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.record.events import Driven, Event
from omnitrack_sim.robots.control import Controller, ControlSetup, Observation
from omnitrack_sim.robots.driving import DriverTable, Order
from omnitrack_sim.robots.omnitrack.control.alignment import AlignmentTable, held_belt_sign
from omnitrack_sim.robots.omnitrack.control.command import Command, mirror_command
from omnitrack_sim.robots.omnitrack.control.jacobian import DampingTable
from omnitrack_sim.robots.omnitrack.control.tracking import TrackingTable, wall_speeds
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack
from omnitrack_sim.robots.size import REFERENCE_BORE

BY_HAND = "by_hand"
"""Phase of a robot that obeys its driver."""


class DrivenTable(DriverTable):
    """``[control.parameters]`` of the controller ``driven``."""

    autopilot: str = "jacobian"
    """The controller to which the driver can hand over: a shipped one, or `module:Class`."""
    # How the nose is turned towards a heading, as of "jacobian" in a tee turn.
    gain: Annotated[NotNegative, Unit("rad/m")] = TrackingTable().gain
    """Rotation towards the heading for each metre of travel while the nose is off it by 1 rad."""
    rotation_limit: Annotated[Part, Unit("rad/m")] = TrackingTable().rotation_limit
    """Cap on that rotation."""
    damping: Annotated[NotNegative, Unit("1")] = DampingTable().tee_turn
    """Rotation asked in addition, for each rad/s that the nose turns too slowly or too fast."""

    @classmethod
    def autopilots(cls) -> Mapping[str, type[Controller]]:
        """See ``DriverTable``."""
        return Omnitrack.controllers()


class DrivenController:
    """Obeys orders: those of its parameters, and those that it is given while it drives.

    A driver's robot is never taken for stuck. Its nose counts, not the gear of a mission's leg:
    forward stays forward when the robot is sent on tail first.

    Attributes:
        setup: what it was made from.
        roll: (n, 3) rad, what the rotary motors were asked last.
        by_hand: (n,) robots that obey their driver; the others are with their autopilots.
    """

    Parameters: ClassVar[type[Table]] = DrivenTable

    def __init__(self, setup: ControlSetup) -> None:
        self.setup, n = setup, setup.n
        self._tables: Sequence[DrivenTable] = setup.parameters
        self._orders = [list(table.orders) for table in self._tables]
        self._obeyed = [0] * n
        self._autopilots: list[Controller | None] = [None] * n
        self._first_phase: dict[str, int] = {}
        self.phases: tuple[str, ...] = (BY_HAND,)
        for table in self._tables:
            if table.autopilot not in self._first_phase:
                self._first_phase[table.autopilot] = len(self.phases)
                self.phases += tuple(getattr(table.autopilot_class, "phases", ("drive",)))
        self.roll = np.array(setup.command.roll, float)
        self._roll_target = self.roll.copy()
        self._speed, self._heading = np.zeros(n), np.zeros((n, 3))
        self._steered = np.zeros(n, bool)  # robots that have a heading
        self.by_hand, self._over = np.ones(n, bool), np.zeros(n, bool)
        bore = setup.robot.nominal_bore
        # Rotation per metre is given for 160 mm and falls as the robot, and so its way, grows.
        self._gain = setup.each("gain") * REFERENCE_BORE / bore
        self._limit = setup.each("rotation_limit") * REFERENCE_BORE / bore
        self._damping = setup.each("damping")
        self._band = AlignmentTable().no_motion_band
        self._belt_sign = belt_sign(self.roll)
        self._told = False

    def give(self, order: Order, robot: int = 0) -> None:
        """Add an order, to be obeyed from the first step on that is not before its time.

        Raises:
            ValueError: it is for a time before that of an earlier order.
        """
        orders = self._orders[robot]
        if orders and order.time < orders[-1].time:
            raise ValueError(
                f"an order for {order.time} s comes behind one for {orders[-1].time} s"
            )
        orders.append(order)

    def orders(self, robot: int = 0) -> tuple[Order, ...]:
        """All orders of a robot so far."""
        return tuple(self._orders[robot])

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        events = self._apply_due_orders(observation)
        command = self._driven(observation)
        for robot in np.flatnonzero(~self.by_hand).tolist():
            command = self._piloted(command, robot, observation)
        roll = mirror_command(command, observation.gear).roll
        assert roll is not None
        self.roll = np.array(roll)
        return command._replace(events=[*events, *command.events], over=self._over.copy())

    def _apply_due_orders(self, observation: Observation) -> list[Event]:
        """Take on the orders that are due."""
        events: list[Event] = []
        if not self._told:
            self._told = True
            events += [
                Driven(robot, float(time), table.driver)
                for robot, (time, table) in enumerate(
                    zip(observation.time, self._tables, strict=True)
                )
            ]
        for robot, orders in enumerate(self._orders):
            time = float(observation.time[robot])
            while self._obeyed[robot] < len(orders) and orders[self._obeyed[robot]].time <= time:
                events += self._take_on(robot, orders[self._obeyed[robot]], observation)
                self._obeyed[robot] += 1
        return events

    def _take_on(self, robot: int, order: Order, observation: Observation) -> Iterable[Event]:
        table, time, was = self._tables[robot], float(observation.time[robot]), self.by_hand[robot]
        self._over[robot] = order.by == "end"
        if order.by != "end":  # the last step is driven by who drives
            self.by_hand[robot] = order.by == "hand"
        self._speed[robot], self._steered[robot] = order.speed, order.heading is not None
        if order.heading is not None:
            self._heading[robot] = unit(np.array(order.heading))
        self._roll_target[robot] = self.roll[robot]
        if order.roll_deg is not None:
            self._roll_target[robot] = np.radians(order.roll_deg)
        if was and not self.by_hand[robot]:
            self._autopilots[robot] = self._autopilot(robot, observation)
            return [Driven(robot, time, f"controller {table.autopilot}")]
        return [Driven(robot, time, table.driver)] if self.by_hand[robot] and not was else []

    def _autopilot(self, robot: int, observation: Observation) -> Controller:
        """A new autopilot of one robot, which begins with the robot as it is.

        It is made for all robots, whose locations it shares; only the one row counts.
        """
        table = self._tables[robot]
        parameters = table.autopilot_model(**table.autopilot_parameters)
        setup = replace(
            self.setup,
            parameters=[parameters] * self.setup.n,
            location=observation.location,
            command=self.setup.command._replace(roll=self._roll_in_gear(observation)),
        )
        return table.autopilot_class(setup)

    def _roll_in_gear(self, observation: Observation) -> Array:
        """``roll`` as robots are told it that drive in the gear of their legs."""
        command = Command(np.zeros((self.setup.n, 3)), self.roll)
        roll = mirror_command(command, observation.gear).roll
        assert roll is not None
        return np.array(roll)

    def _driven(self, observation: Observation) -> Command:
        """The command of all robots as if all were driven by hand."""
        setup, gear = self.setup, observation.gear.astype(float)
        step = setup.robot.roll_rate * setup.period
        self.roll += np.clip(self._roll_target - self.roll, -step, step)
        speed = wall_speeds(
            observation.rotation,
            observation.angular_velocity,
            self._damping * self._steered,
            self._wanted_rotation(observation, gear),
            gear * self._speed,
            setup.routes.radius.take(observation.location.passage),
            setup.settings.speed_limit,
        )
        if not drive_of(setup.robot.drive).steers:
            # What cannot be given is not asked.
            straight = np.minimum(np.abs(self._speed), setup.settings.speed_limit)
            speed = np.repeat((gear * np.copysign(straight, self._speed))[:, None], 3, axis=1)
        self._belt_sign = held_belt_sign(observation.roll, self._band, self._belt_sign)
        nobody_hangs = np.ones(setup.n, bool)
        phase = np.zeros(setup.n, int)
        roll = self._roll_in_gear(observation)
        return Command(speed * self._belt_sign, roll, phase, nobody_hangs)

    def _wanted_rotation(self, observation: Observation, gear: Array) -> Array:
        """Return the rotation that turns the noses to their headings.

        Returns:
            (n, 3) rad/m, rotation for each metre of travel, world frame.
        """
        nose = gear[:, None] * observation.rotation[:, :, 2]
        angle = angle_between(nose, self._heading) * self._steered
        # The rate is this times the speed: backward, the sign changes so that the nose turns alike.
        size = np.minimum(self._gain * angle, self._limit) * np.sign(gear * self._speed)
        return unit(cross(nose, self._heading)) * size[:, None]

    def _piloted(self, command: Command, robot: int, observation: Observation) -> Command:
        """``command`` with the row of a robot as its autopilot has it."""
        autopilot = self._autopilots[robot]
        assert autopilot is not None
        own = autopilot.step(observation)
        belts, roll, phase, resting = (
            command.belt_speed,
            command.roll,
            command.phase,
            command.resting,
        )
        assert roll is not None
        assert phase is not None
        assert resting is not None
        belts[robot] = own.belt_speed[robot]
        if own.roll is not None:
            roll[robot] = own.roll[robot]
        first = self._first_phase[self._tables[robot].autopilot]
        phase[robot] = first + (0 if own.phase is None else int(own.phase[robot]))
        resting[robot] = False if own.resting is None else bool(own.resting[robot])
        events = [event for event in own.events if event.robot == robot]
        brake = command.brake
        if own.brake is not None:
            brake = np.zeros(belts.shape) if brake is None else brake
            brake[robot] = own.brake[robot]
        return command._replace(events=[*command.events, *events], brake=brake)
