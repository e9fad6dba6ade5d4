"""What a controller sees and what it answers. All arrays have a leading axis of n trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from numpy.typing import NDArray

from omnitrack_sim.control.guide import Guide, Place
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array


@dataclass(frozen=True)
class Observation:
    """The sensors of n robots at one moment.

    Attributes:
        time: (n,) s.
        position: (n, 3) m, robot centre, world frame.
        rotation: (n, 3, 3) robot frame in the world.
        angular_velocity: (n, 3) rad/s, robot frame.
        slide: (n, 3) m. pitch, roll: (n, 3) rad, see ``trajectory.CHANNELS``.
        belt_speed: (n, 3) m/s, positive drives forward when the upper track is at the wall.
        motor_torque: (n, 3) N m.
        traction, normal_force: (n, 3) N.
        slip_velocity, module_speed: (n, 3) m/s; the latter is forward, at the contact.
        contact_count: (n, 3, 2) lugs in contact, (upper, lower) track.
        contact_position: (n, 3, 3) m, world frame.
        place: where the robots are along the route.
    """

    time: Array
    position: Array
    rotation: Array
    angular_velocity: Array
    slide: Array
    pitch: Array
    roll: Array
    belt_speed: Array
    motor_torque: Array
    traction: Array
    normal_force: Array
    slip_velocity: Array
    module_speed: Array
    contact_count: Array
    contact_position: Array
    place: Place


@dataclass(frozen=True)
class Command:
    """What n robots shall do until the next control step.

    Attributes:
        belt_speed: (n, 3) m/s asked of the crawler motors.
        roll: (n, 3) rad asked of the rotary motors.
        phase: (n,) index into the controller's ``phases``.
    """

    belt_speed: Array
    roll: Array
    phase: NDArray


@dataclass(frozen=True)
class Settings:
    """Control parameters of n trials; each field is (n,). See the scenario's ``[control]`` for the
    meaning."""

    cruise_speed: Array  # m/s
    align: NDArray  # bool
    retry: NDArray  # bool
    gain: Array  # 1/m
    lookahead: Array  # m
    rotation_limit: Array  # rad/m
    speed_limit: Array  # m/s
    safe_margin: Array  # rad; nan: by the reach
    reach: Array  # m
    elbow_delay: Array  # m
    tee_trigger: Array  # m


class Controller(Protocol):
    """Turns observations into commands for n robots, each on its way. State is held per trial.

    Robots that drive tail first are seen as if they drove nose first (``gear``).
    """

    phases: ClassVar[tuple[str, ...]]
    resting: NDArray  # (n,) bool, robots that stand still or drive backward on purpose
    events: list[list[str]]  # for each robot, what it decided and when, in words

    def __init__(
        self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float
    ) -> None:
        """``roll`` (n, 3) rad is the start roll of the modules, ``period`` s the time between two
        steps."""
        ...

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        ...

    def begin_leg(self, robot: int, turned: bool) -> None:
        """A robot has been sent onto another way; ``turned``: it drives in the other gear from now
        on."""
        ...
