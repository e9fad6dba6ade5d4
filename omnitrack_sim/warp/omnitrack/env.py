"""Environments of the paper's robot whose episodes never leave the device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.control.alignment import AlignmentTable
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURES
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp.env import DeviceVectorEnv
from omnitrack_sim.warp.omnitrack import driving
from omnitrack_sim.warp.plant import field_of, put_field


class WarpVectorEnv(DeviceVectorEnv):
    """Robots in pipes on a device, each in an episode of its own: see docs/how-to/gpu.md.

    Observations, rewards and what else is returned are arrays of Warp on the device. The next step
    writes into the same arrays. Rewards, observations, actions and episodes are those of
    ``gym.RobotVectorEnv`` with ``sensing="truth"``, but for single precision.

    Args:
        scenario: a shipped scenario or a file, with one route through straights, elbows and tees;
            or "random_network".
        num_envs: number of worlds.
        autoreset_mode: ``NextStep`` or ``SameStep``, see Gymnasium. In the second the last
            observations of episodes are ``infos["final_obs"]``.
        starts: number of starts that are drawn and seated when the environment is made; each
            episode begins in one of them.
        start_seed: of their draw.
        networks: number of random networks that stand side by side, for the scenario
            "random_network"; each episode begins in one of them.
        given: options of the environments of ``gym``.

    Raises:
        InputError: an option cannot be used; the fault names it and the choices.

    Attributes:
        entries: where each feature stands in a robot's vector of entries: slices by name.
        model: of MuJoCo, of pipes and robot.
        m: the same on the device, with a row a world of what worlds differ in.
        d: state of all worlds on the device.
        starts: states in which episodes begin.
        start: (n,) on the device, in which of them each world's episode has begun.
        outcomes: words for the numbers of ``infos["outcome"]``.

    Example:
        >>> env = ot.warp.WarpVectorEnv("tee_turn", num_envs=4096, observation="preview")
        >>> observations, infos = env.reset(seed=1)
        >>> actions = wp.full((env.num_envs, 4), 0.5, dtype=float)
        >>> observations, rewards, terminated, truncated, infos = env.step(actions)
    """

    actions, shipped = ACTIONS, FEATURES

    def check_robot(self, robot: Robot) -> None:
        """Refuse other robots, and motors that are not on the device."""
        if not isinstance(robot, Omnitrack):
            raise InputError(Fault("robot.kind", "is another robot", (Omnitrack.kind,)))
        if not drive_of(robot.drive).direct:
            raise InputError(Fault("robot.drive", f"is {robot.drive!r}", ("three_motors",)))

    def own_state(self, simulation: Simulation) -> Mapping[str, ArrayLike]:
        """Return the numbers (n, ...) of robots at their start, in the order of their sizes."""
        readings, setup, n = simulation.readings, simulation.setup, simulation.n
        own: dict[str, ArrayLike] = {
            "roll_set_point": setup.command.roll,
            "forward": belt_sign(setup.command.roll),
            "action": np.zeros((n, len(ACTIONS))),
            "correction": np.zeros((n, 3)),
            "first": np.zeros(n),
            "first_passage": np.full(n, -1.0),
            "speed_limit": setup.settings.speed_limit,
            "cruise_speed": setup.settings.cruise_speed,
            "motor": simulation.plant.motors.figures,
            "weight": setup.own("mass") * GRAVITY,
        }
        return {name: own[name] if name in own else readings[name] for name in driving.SIZES}

    def put_robot(self, simulation: Simulation) -> None:
        """Bring constants, addresses and force ranges of the motors to the device."""
        n = self.num_envs
        self._robot = robot_of(simulation)
        self._wanted, self._motors = wp.zeros((n, 3), dtype=float), wp.zeros((n, 9), dtype=float)
        put_field(self.m, "actuator_forcerange", np.tile(self.model.actuator_forcerange, (n, 1, 1)))

    def take_actions(self, actions: Any) -> None:
        """Keep the actions (n, 4) of a decision in the worlds' states."""
        inputs = [actions, self.outcome, self.state]
        wp.launch(driving.take_actions, self.num_envs, inputs=inputs)

    def command(self) -> None:
        """Write the inputs of one control step."""
        limits = field_of(self.m, "actuator_forcerange")
        moving = [self.state, self._wanted, self._motors, self.d.qpos, self.d.ctrl, limits]
        wp.launch(driving.command, self.num_envs, inputs=[self._robot, self.course, *moving])

    def read(self) -> None:
        """Read what robots measure after a control step."""
        d = self.d
        seen = [d.qpos, d.qvel, d.xpos, d.xmat, d.sensordata, d.actuator_force]
        inputs = [self._robot, *seen, self.origins, self.outcome, self.state]
        wp.launch(driving.read, self.num_envs, inputs=inputs)

    def write_entries(self, entries: Any) -> None:
        """Write the quantities of all shipped features (n, k)."""
        wp.launch(driving.observe, self.num_envs, inputs=[self.course, self.state, entries])


def robot_of(simulation: Simulation) -> Any:
    """Return the constants of the robots."""
    robot, at = simulation.scenarios[0].robot, simulation.readings.at
    own = driving.Robot()
    own.lug_radius, own.lug_pitch = robot.lug_radius, robot.lug_pitch
    own.roll_rate = robot.roll_rate
    own.band = AlignmentTable().no_motion_band
    own.chassis = int(at.chassis[0]) // 3
    bodies = at.places[:, 0] // 3
    vectors = {"slide": at.slide, "pitch": at.pitch, "roll": at.roll, "slide_dofs": at.slide_dofs}
    vectors |= {"pitch_dofs": at.pitch_dofs, "belt_dofs": at.belt_dofs[:, 0], "modules": bodies}
    vectors |= {"belt_motors": at.belt_motors, "roll_motors": at.roll_motors}
    for name, values in vectors.items():
        setattr(own, name, wp.vec3i(*values.tolist()))
    own.belts = driving.Pairs(*at.belts.ravel())
    own.sprockets = driving.Pairs(*at.sprockets.ravel())
    own.contact = driving.Parts(*at.contact[:, :, 0].ravel())
    own.touch = driving.Parts(*at.touch.ravel())
    return own
