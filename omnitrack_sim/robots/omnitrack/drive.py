"""Drives: the crawler motors, the gears between them and the three belts, and their speed loops."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import CFUNCTYPE
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ByName, named
from omnitrack_sim.base.rotations import Array, ordered_sum, set_rows
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBER,
    NUMBERS,
    WORD,
    c_function,
    compiled,
    pointers,
)
from omnitrack_sim.robots.omnitrack.channels import MODULES
from omnitrack_sim.robots.omnitrack.motors import Motor

_NOTHING = 1e-9
"""Size of a coefficient that counts as zero."""


@dataclass(frozen=True)
class Drive:
    """m motors that drive the three belts through gears without loss between their speeds.

    The gears are a matrix B. A motor turns at B times the speeds of the belts; by the balance of
    power each belt is given B's transpose times the forces of the motors. For three motors B is
    the identity. For the 1-input 3-output differential it is (1/3, 1/3, 1/3): the speeds of the
    outputs add up to three times that of the input, and their forces are equal.

    Speeds are in m/s and forces in N, at the belts.

    Attributes:
        name: for messages.
        gears: (m, 3), the matrix B, row by row.
        size: torque and rotor inertia of each motor, as multiples of those of ``robot.motor``.

    Raises:
        ValueError: ``gears`` is not (m, 3), a motor drives nothing, or two drive the same.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> drive = ot.Drive("front_and_rear", ((1, 0, 0), (0, 0.5, 0.5)))
        >>> drive.motors, drive.steers
        (2, False)
        >>> drive.motor_values(np.array([[0.1, 0.08, 0.12]]))  # m/s
        array([[0.1, 0.1]])
    """

    name: str
    gears: Sequence[Sequence[float]]
    size: float = 1.0

    def __post_init__(self) -> None:
        matrix = self.matrix
        if matrix.ndim != 2 or matrix.shape[1] != MODULES or not np.isfinite(matrix).all():
            raise ValueError(f"gears of drive {self.name!r} are no rows of {MODULES} numbers")
        # Motors of the same motion would leave it undecided which of them gives how much force.
        if np.linalg.matrix_rank(matrix) < len(matrix):
            raise ValueError(f"gears of drive {self.name!r}: its motors are not independent")
        if not self.size > 0:
            raise ValueError(f"size of drive {self.name!r} is {self.size}; it must be positive")

    @cached_property
    def matrix(self) -> Array:
        """The gears B (m, 3)."""
        return np.asarray(self.gears, float)

    @property
    def motors(self) -> int:
        """Number of motors, m."""
        return len(self.gears)

    @property
    def steers(self) -> bool:
        """True if the belts can be given three independent speeds."""
        return self.motors == MODULES

    @cached_property
    def direct(self) -> bool:
        """True if motor i drives belt i and nothing else."""
        return np.array_equal(self.matrix, np.eye(MODULES))

    @property
    def strength(self) -> Array:
        """Largest torque (3,) at each belt, in torque limits of one ``robot.motor``."""
        return self.size * np.abs(self.matrix).sum(axis=0)

    @property
    def shafts(self) -> int:
        """Number of shafts that the model has beside the belts, each a joint of its own.

        One for each motor; none where every motor turns its own belt and nothing else.
        """
        return 0 if self.direct else self.motors

    @cached_property
    def relative(self) -> Array:
        """Projection (3, 3) of the belts' speeds onto those with all motors at rest."""
        # pinv(B) B projects onto the motions that turn a motor; the rest is what the gears leave
        # free.
        free = np.eye(MODULES) - np.linalg.pinv(self.matrix) @ self.matrix
        return np.where(np.abs(free) > _NOTHING, free, 0.0)

    @cached_property
    def _inverse(self) -> Array:
        """Forces of the motors for those of the belts, (m, 3)."""
        # Least squares: where motors are shared, the belts' forces need not be ones that they can
        # give.
        return np.asarray(np.linalg.pinv(self.matrix.T), float)

    def motor_values(self, belts: Array) -> Array:
        """Speeds of the motors (n, m) for those of the belts (n, 3)."""
        return belts if self.direct else _product(belts, self.matrix)

    def belt_values(self, motors: Array) -> Array:
        """Forces of the belts (n, 3) for those of the motors (n, m)."""
        return motors if self.direct else _product(motors, self.matrix.T)

    def motor_forces(self, belts: Array) -> Array:
        """Forces of the motors (..., m) that give the belts theirs (..., 3)."""
        return belts if self.direct else _product(belts, self._inverse)


def _product(values: Array, matrix: Array) -> Array:
    """``matrix`` (a, b) times each of ``values`` (..., b), the same bits alone and in a batch."""
    return ordered_sum(values[..., None, :] * matrix)


class SpeedLoop:
    """The electrical side of n robots' motors: set points and force limits of the speed servos.

    The belts, with the reflected rotor inertia and the proportional part of the loop, are part of
    the physics. Here are the integral part with its droop, the torque-speed line and the limit.

    Args:
        drive: number of motors, and the gears between them and the belts.
        motors: ``robot.motor`` of each robot.
        lug_radius: m, belt speed over shaft speed (Eq. 1).

    Attributes:
        figures: (n, k) of the motors, in the order of the constants below.
        saturated: (n, 3) bool, modules whose motor is at its limit.
    """

    def __init__(self, drive: Drive, motors: Sequence[Motor], lug_radius: float):
        self.drive, self.lug_radius = drive, lug_radius
        n = len(motors)
        self.figures = np.zeros((n, FIGURES))
        self.saturated: NDArray[np.bool_] = np.zeros((n, 3), bool)
        self._correction = np.zeros((n, drive.motors))  # m/s, integral part
        self._driven = np.abs(drive.matrix) > 0  # (m, 3) belts of each motor
        self.reset(np.arange(n), motors)

    @property
    def torque_limit(self) -> Array:
        """Largest driving torque (n, 1) of each robot's motors, N m."""
        return self.figures[:, LIMIT : LIMIT + 1]

    def reset(self, rows: NDArray[np.intp], motors: Sequence[Motor]) -> None:
        """Begin anew for robots ``rows`` (k,), with k ``motors``."""
        figures = np.array([self._figures(motor) for motor in motors])
        set_rows(self, rows, figures=figures, saturated=False, _correction=0.0)

    def _figures(self, motor: Motor) -> tuple[float, ...]:
        return (
            self.lug_radius,
            self.drive.size,
            motor.stall_torque,
            motor.no_load_speed,
            motor.efficiency,
            motor.speed_droop,
            motor.speed_integral_time,
            motor.friction_torque,
            motor.reflected_inertia,
            motor.max_torque,
            motor.speed_bandwidth,
            motor.torque_per_ampere,
        )

    def advance(
        self, command: Array, belt_speed: Array, torque: Array, dt: float
    ) -> tuple[Array, Array, Array]:
        """One control step.

        Args:
            command: (n, 3) m/s, belt speeds asked.
            belt_speed: (n, 3) m/s, as they are.
            torque: (n, 3) N m, what the motors gave the modules' shafts last.
            dt: s since the last call.

        Returns:
            Set points of the m speed servos (n, m) m/s, and the least and largest force (n, m) N
            that each may give, all at the belts.
        """
        drive, wanted = self.drive, self.drive.motor_values(command)
        speed, force = drive.motor_values(belt_speed), drive.motor_forces(torque)
        asked = np.empty((4, *wanted.shape))
        given = (np.ascontiguousarray(each, float) for each in (wanted, speed, force))
        arrays = self.figures, *given, self._correction, asked
        c_function(_advance, _ADVANCE).ctypes(*wanted.shape, dt, *pointers(*arrays))
        saturated = asked[3] > 0
        self.saturated = saturated if drive.direct else self._of_modules(saturated)
        return asked[0], asked[1], asked[2]

    def _of_modules(self, motors: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Modules (n, 3) that one of the ``motors`` (n, m) drives."""
        return np.any(motors[:, :, None] & self._driven, axis=1)


# Figures of a robot's motors, and their number.
LUG_RADIUS, SIZE, STALL_TORQUE, NO_LOAD_SPEED, EFFICIENCY, DROOP, INTEGRAL_TIME = range(7)
FRICTION, INERTIA, LIMIT, BANDWIDTH, TORQUE_PER_AMPERE, FIGURES = range(7, 13)
AT_LIMIT = 0.999
"""Part of the limit from which a motor counts as at it: forces come back through gears, rounded."""


@compiled
def within(torque, limit):
    """Return ``torque`` cut to the range from 0 to ``limit``."""
    return min(max(torque, 0.0), limit)


@compiled
def held_by_losses(motor, driving):
    """Return what losses hold beyond the torque, N m, that the motor would drive with."""
    part = motor[EFFICIENCY]
    return driving * (1.0 / (part * part) - 1.0) + 2.0 * motor[FRICTION] / part


@compiled
def driving_range(motor, speed):
    """Return the least and largest torque, N m, with which the motor drives at ``speed`` rad/s.

    Both the torque-speed line and the limit hold as the maker states them, at the output shaft.
    """
    line, limit = motor[STALL_TORQUE] / motor[NO_LOAD_SPEED], motor[LIMIT]
    highest = within(motor[STALL_TORQUE] - line * speed, limit)
    return -within(motor[STALL_TORQUE] + line * speed, limit), highest


@compiled
def torque_range(motor, lowest, highest, speed, dt):
    """Return the least and largest torque, N m, at the shaft at ``speed`` rad/s for ``dt`` s.

    Driving, a motor gives ``lowest`` to ``highest``. Against its direction of turning losses help
    it twice: the gears' and the rotor's friction once for what it does not lose on the way out, and
    once for what it does lose on the way in. Losses only stop: they get no more than stops the
    rotor within ``dt``.
    """
    stopping = motor[INERTIA] * abs(speed) / dt
    if speed > 0.0:
        lowest -= min(held_by_losses(motor, -lowest), stopping)
    elif speed < 0.0:
        highest += min(held_by_losses(motor, highest), stopping)
    return lowest, highest


@compiled
def figures_of(figures, robot):
    """Return the figures of a robot's motors."""
    i = robot * FIGURES
    return (
        figures[i],
        figures[i + 1],
        figures[i + 2],
        figures[i + 3],
        figures[i + 4],
        figures[i + 5],
        figures[i + 6],
        figures[i + 7],
        figures[i + 8],
        figures[i + 9],
        figures[i + 10],
    )


def _advance(count, motors, dt, figures, wanted, speeds, forces, corrections, asked):
    """Write set points, least and largest forces and saturation to ``asked`` (4, count, motors).

    See ``SpeedLoop.advance``.
    """
    plane = count * motors
    for i in range(count):
        motor = figures_of(figures, i)
        per_force, mean = motor[SIZE] / motor[LUG_RADIUS], 0.0
        for k in range(i * motors, (i + 1) * motors):
            mean += forces[k] / motor[SIZE]
        mean /= motors
        for k in range(i * motors, (i + 1) * motors):
            moment = forces[k] / motor[SIZE]  # N m, of one robot.motor
            turning = speeds[k] / motor[LUG_RADIUS]  # rad/s
            lowest, highest = torque_range(motor, *driving_range(motor, turning), turning, dt)
            saturated = moment <= AT_LIMIT * lowest or moment >= AT_LIMIT * highest
            # Only what differs from the mean gives way: belts that work against each other relax,
            # and a climb keeps its speed.
            droop = motor[DROOP] * motor[LUG_RADIUS] * (moment - mean)
            error = wanted[k] - droop - speeds[k]
            # No wind-up: the integral grows only as far as the shaft gives more, and a motor at its
            # limit lets go when it is asked to turn back.
            upper, lower = AT_LIMIT * highest, AT_LIMIT * lowest
            gives_more = moment < upper if error > 0.0 else moment > lower
            if gives_more:
                corrections[k] += error * dt / motor[INTEGRAL_TIME]
            # What losses hold changes from step to step, and the moment is of the step before: it
            # may stay below the range of a belt that is dragged on.
            per_speed = motor[BANDWIDTH] * motor[INERTIA] / motor[LUG_RADIUS]  # N m for 1 m/s
            most = (motor[LIMIT] + held_by_losses(motor, motor[LIMIT])) / per_speed
            corrections[k] = min(max(corrections[k], -most), most)
            asked[k] = wanted[k] + corrections[k]
            asked[plane + k], asked[2 * plane + k] = lowest * per_force, highest * per_force
            asked[3 * plane + k] = 1.0 if saturated else 0.0
    return 0


_ADVANCE = CFUNCTYPE(INTEGER, WORD, WORD, NUMBER, *[NUMBERS] * 6)


DRIVES: ByName[Drive] = ByName(
    three_motors=Drive("three_motors", ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    # One motor as strong and as heavy as the three together, so that only the gears differ.
    differential=Drive("differential", ((1 / 3, 1 / 3, 1 / 3),), size=3.0),
)
"""Shipped drives by the name that a scenario's ``robot.drive`` gives. Others are named by
``module:Object``.

Example:
    >>> import omnitrack_sim as ot
    >>> ot.DRIVES["differential"].gears
    ((0.3333333333333333, 0.3333333333333333, 0.3333333333333333),)
"""


def drive_of(name: str) -> Drive:
    """The drive that ``robot.drive`` names.

    Raises:
        InputError: there is no such drive.
    """
    drive = named(name, "robot.drive", DRIVES)
    if not isinstance(drive, Drive):
        problem = f"is {name!r}, which is no ot.Drive"
        raise InputError(Fault("robot.drive", problem, (*DRIVES, "module:Object")))
    return drive
