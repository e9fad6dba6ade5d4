"""A linear model of steering: speed loop, rate loop and heading loop.

The robot is between walls that do not hold it, as in the opening of a tee.

Most of the inertia against a change of heading is that of the three rotors, which the gears
multiply: 11.5 kg at each belt of a robot of 1 kg. So the modules turn as fast as their belts do,
and what a belt does with the speed that it is asked for is the plant of the rate loop. The chassis,
which carries the gyroscope, follows the modules on the springs of its arms. Between its rate and
the command stand the filter of the measured rate and the hold of one control period. Walls and slip
are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack import MODULES, Omnitrack

FREQUENCIES = np.geomspace(0.1, 3000.0, 4000)
"""At which crossovers are looked for, rad/s."""


@dataclass(frozen=True)
class Margin:
    """How far a loop is from swinging.

    Attributes:
        crossover: rad/s, highest frequency at which the loop has a gain of 1; 0 where it has none.
        phase: rad, phase left there; negative: the loop swings.
        delay: s, further delay that the loop would bear.
    """

    crossover: float
    phase: float

    @property
    def delay(self) -> float:
        """Further delay that the loop bears, s; infinite where it never crosses over."""
        return self.phase / self.crossover if self.crossover else float("inf")


@dataclass(frozen=True)
class SteeringLoop:
    """The loops by which the controller ``jacobian`` turns the robot.

    Attributes:
        bandwidth: rad/s, ``motor.speed_bandwidth``.
        integral_time: s, ``motor.speed_integral_time``.
        rate_gain: rotation asked per rotation missing, ``damping.tee_turn``.
        rate_filter: s, time constant of the measured rate.
        period: s, between two control steps.
        heading_gain: 1/s, rate of turning asked per angle missing: ``tracking.gain`` in 1/m times
            the cruise speed.
        spring_frequency: rad/s, at which the chassis swings on the springs of its arms.
        spring_damping: damping ratio of that.
        droop: ``motor.speed_droop`` times reflected inertia times bandwidth, 1.
    """

    bandwidth: float
    integral_time: float
    rate_gain: float
    rate_filter: float
    period: float
    heading_gain: float
    spring_frequency: float
    spring_damping: float
    droop: float = 0.0

    @classmethod
    def of(
        cls,
        robot: Omnitrack,
        *,
        rate_gain: float,
        rate_filter: float,
        period: float,
        heading_gain: float,
    ) -> Self:
        """The loops of a robot under a controller; arguments as the attributes."""
        # An arm of three pitches with the chassis wholly, or two by half: 3/2 in every direction.
        arms = MODULES / 2
        pitch_stiffness = robot.module_stiffness * (robot.shaft_spacing / 2) ** 2  # N m/rad
        stiffness, damping = arms * pitch_stiffness, arms * robot.pitch_damping
        radius, length = robot.chassis_radius, robot.chassis_length
        inertia = robot.chassis_mass * (3 * radius**2 + length**2) / 12
        motor = robot.motor
        return cls(
            bandwidth=motor.speed_bandwidth,
            integral_time=motor.speed_integral_time,
            rate_gain=rate_gain,
            rate_filter=rate_filter,
            period=period,
            heading_gain=heading_gain,
            spring_frequency=math.sqrt(stiffness / inertia),
            spring_damping=damping / (2 * math.sqrt(stiffness * inertia)),
            droop=motor.speed_droop * motor.reflected_inertia * motor.speed_bandwidth,
        )

    def speed_loop(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Speed of a belt over the speed asked, at frequencies (...,) rad/s."""
        s = 1j * np.asarray(frequency, float)
        lead = self.bandwidth * (1 + s * self.integral_time)
        return lead / (s * (s * self.integral_time + self.droop) + lead)

    def springs(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Rate of the chassis over that of the modules, at frequencies (...,) rad/s."""
        s = 1j * np.asarray(frequency, float) / self.spring_frequency
        damping = 2 * self.spring_damping * s
        return (1 + damping) / (1 + damping + s**2)

    def rate_loop(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """The opened rate loop: gain, filter, hold, speed loop and springs."""
        s = 1j * np.asarray(frequency, float)
        step = np.exp(-s * self.period)
        hold = (1 - step) / (s * self.period)
        share = self.period / (self.rate_filter + self.period)
        smooth = share / (1 - (1 - share) * step)
        return self.rate_gain * smooth * hold * self.speed_loop(frequency) * self.springs(frequency)

    def turning(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Rotation rate over the rate wanted, with the rate loop closed."""
        s = 1j * np.asarray(frequency, float)
        hold = (1 - np.exp(-s * self.period)) / (s * self.period)
        plant = hold * self.speed_loop(frequency) * self.springs(frequency)
        ahead = (1 + self.rate_gain) * plant
        return ahead / (1 + self.rate_loop(frequency))

    def heading_loop(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """The opened heading loop, with the rate loop closed."""
        s = 1j * np.asarray(frequency, float)
        return self.heading_gain / s * self.turning(frequency)

    def rate_margin(self) -> Margin:
        """Margin of the rate loop."""
        return _margin(self.rate_loop(FREQUENCIES))

    def heading_margin(self) -> Margin:
        """Margin of the heading loop. It means something only where the rate loop has one."""
        return _margin(self.heading_loop(FREQUENCIES))


def _margin(loop: NDArray[np.complex128]) -> Margin:
    above = np.flatnonzero(np.abs(loop) > 1)
    if len(above) == 0:
        return Margin(0.0, np.pi)
    last = int(above[-1])
    phases: Array = np.unwrap(np.angle(loop))
    return Margin(float(FREQUENCIES[last]), float(np.pi + phases[last]))
