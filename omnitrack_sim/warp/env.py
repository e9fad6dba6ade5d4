"""Environments of the paper's robot whose episodes never leave the device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import mujoco_warp as mjw
import numpy as np
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.options import TERMS, options_of
from omnitrack_sim.robots.feature import bounds, entry_slices
from omnitrack_sim.robots.omnitrack.control.alignment import AlignmentTable
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp import driving
from omnitrack_sim.warp.plant import (
    CONTACTS,
    ROWS,
    UNREAD,
    field_of,
    put_field,
    put_seated_model,
)
from omnitrack_sim.warp.starts import STATE_SIZE, Starts, entry_numbers, starts_of

SEEDS = 2**31
"""Number of seeds that worlds draw the starts of their episodes by."""


class WarpVectorEnv(VectorEnv):
    """Robots in pipes on a device, each in an episode of its own: see docs/how-to/gpu.md.

    Observations, rewards and what else is returned are arrays of Warp on the device. The next step
    writes into the same arrays. Rewards, observations, actions and episodes are those of
    ``gym.RobotVectorEnv`` with ``sensing="truth"``, but for single precision.

    Args:
        scenario: a shipped scenario or a file, with one route through straights, elbows and tees.
        num_envs: number of worlds.
        autoreset_mode: ``NextStep`` or ``SameStep``, see Gymnasium. In the second the last
            observations of episodes are ``infos["final_obs"]``.
        starts: number of starts that are drawn and seated when the environment is made; each
            episode begins in one of them.
        start_seed: of their draw.
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

    outcomes = driving.OUTCOMES

    def __init__(
        self,
        scenario: str = "tee_turn",
        num_envs: int = 1024,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        starts: int = 1024,
        start_seed: int = 0,
        **given: Any,
    ) -> None:
        self._at_once = _mode(autoreset_mode) is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": _mode(autoreset_mode), "render_modes": []}
        for name, value in (("num_envs", num_envs), ("starts", starts)):
            if not isinstance(value, int) or value < 1:
                raise InputError(Fault(name, f"is {value!r}; a number from 1 on is needed"))
        options = options_of({"scenario": scenario, "sensing": "truth", **given})
        self.num_envs = num_envs
        self.starts = starts_of(options, starts, start_seed)
        self.model = self.starts.simulation.model
        robot = self.starts.simulation.scenarios[0].robot
        features = options.features(robot)
        ones = np.ones(len(ACTIONS), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-ones, ones)
        self.single_observation_space = gymnasium.spaces.Box(*bounds(features))
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.entries = entry_slices(features)
        self._put_worlds()
        weights = [options.weights[name] for name in TERMS]
        self._put_results(features, weights, entry_numbers(options, robot))
        self._graph: Any = None
        self._begun = False

    def _put_worlds(self) -> None:
        """Bring the model, the worlds and their starts to the device."""
        n, starts = self.num_envs, self.starts
        self.m = put_seated_model(self.model)
        self.d = mjw.make_data(self.model, nworld=n, nconmax=CONTACTS, njmax=ROWS)
        self._robot, self._tables = robot_of(starts), tables_of(starts.simulation)
        wide = np.tile(self.model.actuator_forcerange, (n, 1, 1))
        put_field(self.m, "actuator_forcerange", wide)
        self._state = wp.zeros((n, STATE_SIZE), dtype=float)
        targets = {"state": self._state, "qpos": self.d.qpos, "ctrl": self.d.ctrl}
        self._copies = []
        for name, values in starts.arrays.items():
            if name in UNREAD:
                continue
            if name not in targets:
                shape = np.shape(field_of(self.model, name))
                put_field(self.m, name, np.tile(values[0].reshape(shape), (n, *[1] * len(shape))))
                targets[name] = field_of(self.m, name)
            source = wp.array(values.astype(np.float32), dtype=float)
            self._copies.append((source, _flat(targets[name], values.shape[1])))
        cleared = self.d.qvel, self.d.qacc_warmstart
        self._cleared = [_flat(each, each.shape[1]) for each in cleared]

    def _put_results(
        self, features: Sequence[Any], weights: Sequence[float], numbers: Array
    ) -> None:
        """Bring the numbers of observations and rewards to the device, and make room for them."""
        n = self.num_envs
        self._actions = wp.zeros((n, len(ACTIONS)), dtype=float)
        self._wanted, self._motors = wp.zeros((n, 3), dtype=float), wp.zeros((n, 9), dtype=float)
        self._outcome, self._over = wp.zeros(n, dtype=int), wp.zeros(n, dtype=int)
        self._ending = wp.zeros(n, dtype=int)
        self._terms, self._reward = wp.zeros((n, 6), dtype=float), wp.zeros(n, dtype=float)
        self._terminated, self._truncated = wp.zeros(n, dtype=bool), wp.zeros(n, dtype=bool)
        self._anew, self.start = wp.zeros(n, dtype=bool), wp.zeros(n, dtype=int)
        self._seeds, self._episodes = wp.zeros(n, dtype=int), wp.zeros(n, dtype=int)
        self._all_entries = wp.zeros((n, driving.ENTRIES), dtype=float)
        self._numbers = wp.array(numbers, dtype=int)
        ranges = np.repeat(
            [(each.low, each.high) for each in features], [each.size for each in features], axis=0
        )
        self._ranges = wp.array(ranges.astype(np.float32), dtype=float)
        self._observed = wp.zeros((n, len(numbers)), dtype=float)
        self._last_observed = wp.zeros((n, len(numbers)), dtype=float)
        self._weights = wp.array(weights, dtype=float)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every world, or in those of ``options["reset_mask"]`` (n,) bool.

        Args:
            seed: world i draws by seed + i; None: it goes on with its draws.
            options: see above; an array of NumPy or Warp.

        Raises:
            InputError: another option, or a mask of another shape.
        """
        chosen = _chosen(options, self.num_envs) | (not self._begun)
        if seed is not None or not self._begun:
            first = int(np.random.default_rng().integers(SEEDS)) if seed is None else seed
            seeds = (first + np.arange(self.num_envs)) % SEEDS
            self._seeds.assign(np.where(chosen, seeds, self._seeds.numpy()).astype(np.int32))
            self._episodes.assign(np.where(chosen, 0, self._episodes.numpy()).astype(np.int32))
        self._anew.assign(chosen)
        self._begun = True
        self._begin_anew()
        self._observe(self._observed)
        return self._observed, self._infos()

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Carry out actions (n, 4) for one decision, 0.05 s.

        Args:
            actions: an array of Warp, PyTorch or NumPy; what is not a number counts as 0.

        Raises:
            ResetNeeded: before the first reset.
            ValueError: they have another shape.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("call reset first")
        given = _on_device(actions)
        if tuple(given.shape) != self._actions.shape:
            shape = self._actions.shape
            raise ValueError(f"action has shape {tuple(given.shape)}, expected {shape}")
        wp.copy(self._actions, given)
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._decide()
            if wp.get_device().is_cuda:
                # What is captured is not carried out; all is loaded by now.
                with wp.ScopedCapture() as capture:
                    self._decide()
                self._graph = capture.graph
        results = self._observed, self._reward, self._terminated, self._truncated
        return *results, self._infos()

    def _decide(self) -> None:
        """Carry out a decision in all worlds, and begin episodes anew where that is due."""
        n, d, starts, state = self.num_envs, self.d, self.starts, self._state
        inputs = [self._actions, self._outcome, state, self._over, self._terms]
        wp.launch(driving.begin_decision, n, inputs=inputs)
        limits = field_of(self.m, "actuator_forcerange")
        moving = [state, self._wanted, self._motors, d.qpos, d.ctrl, limits]
        seen = [d.qpos, d.qvel, d.xpos, d.xmat, d.sensordata, d.actuator_force, state]
        own = [self._robot, self._tables]
        for _ in range(starts.hold):
            wp.launch(driving.command, n, inputs=[self._robot, *moving])
            for _ in range(starts.substeps):
                mjw.step(self.m, d)
            wp.launch(driving.judge, n, inputs=[*own, *seen, self._outcome, self._terms])
        told = [self._reward, self._terminated, self._truncated, self._ending]
        inputs = [self._weights, self._over, self._outcome, self._terms, *told]
        wp.launch(driving.end_decision, n, inputs=inputs)
        if self._at_once:
            self._observe(self._last_observed)
        inputs = [self._over, self._terminated, self._truncated, self._at_once, self._anew]
        wp.launch(driving.mark, n, inputs=inputs)
        self._begin_anew()
        self._observe(self._observed)

    def _begin_anew(self) -> None:
        """Begin new episodes in the worlds that are marked."""
        n, count = self.num_envs, len(self.starts.arrays["state"])
        inputs = [self._seeds, self._episodes, count, self._anew, self._outcome, self.start]
        wp.launch(driving.draw, n, inputs=inputs)
        for source, target in self._copies:
            inputs = [self._anew, self.start, source, target]
            wp.launch(driving.copy_rows, target.shape, inputs=inputs)
        for target in self._cleared:
            wp.launch(driving.clear_rows, target.shape, inputs=[self._anew, target])

    def _observe(self, target: Any) -> None:
        inputs = [self._robot, self._tables, self._state, self._all_entries]
        wp.launch(driving.observe, self.num_envs, inputs=inputs)
        inputs = [self._numbers, self._ranges, self._all_entries, target]
        wp.launch(driving.select, target.shape, inputs=inputs)

    def _infos(self) -> dict[str, Any]:
        """Arrays beside the results: place, time, terms of the reward, outcomes."""
        state = self._state
        infos = {
            "distance": state[:, driving.DISTANCE],
            "time": state[:, driving.TIME],
            "terms": {name: self._terms[:, k] for k, name in enumerate(TERMS)},
            "outcome": self._ending,
        }
        return infos | ({"final_obs": self._last_observed} if self._at_once else {})


def robot_of(starts: Starts) -> Any:
    """Return the constants of the robots."""
    simulation = starts.simulation
    robot, headway = simulation.scenarios[0].robot, simulation.monitor.headway
    at, route = simulation.readings.at, simulation.legs.routes
    own = driving.Robot()
    own.period, own.bore = simulation.period, robot.nominal_bore
    own.standard_gravity = GRAVITY
    own.lug_radius, own.lug_pitch = robot.lug_radius, robot.lug_pitch
    own.roll_rate = robot.roll_rate
    own.half_length, own.route_length = robot.length / 2, float(route.lengths[0])
    own.progress, own.slide_back = headway.progress, headway.slide_back
    own.wedged_cosine = simulation.scenarios[0].monitor.wedged_cosine
    own.band = AlignmentTable().no_motion_band
    own.chassis = int(at.chassis[0]) // 3
    bodies = at.places[:, 0] // 3
    vectors = {"slide": at.slide, "pitch": at.pitch, "roll": at.roll, "slide_dofs": at.slide_dofs}
    vectors |= {"pitch_dofs": at.pitch_dofs, "belt_dofs": at.belt_dofs[:, 0], "modules": bodies}
    vectors |= {"belt_motors": at.belt_motors, "roll_motors": at.roll_motors}
    for name, values in vectors.items():
        setattr(own, name, wp.vec3i(*values.tolist()))
    own.belts, own.sprockets = (
        driving.Pairs(*at.belts.ravel()),
        driving.Pairs(*at.sprockets.ravel()),
    )
    own.contact = driving.Parts(*at.contact[:, :, 0].ravel())
    own.touch = driving.Parts(*at.touch.ravel())
    return own


def tables_of(simulation: Simulation) -> Any:
    """Return the tables of the route."""
    routes, robot = simulation.legs.routes, simulation.scenarios[0].robot
    segments, lines, passages, spans = routes.arrays
    tables, bore = driving.Tables(), robot.nominal_bore
    for name, values in (("segments", segments), ("passages", passages)):
        setattr(tables, name, wp.array(values.ravel().astype(np.float32), dtype=float))
    for name, values in (("lines", lines), ("spans", spans)):
        setattr(tables, name, wp.array(values.ravel().astype(np.int32), dtype=int))
    kinds = (
        *(routes.start, routes.end, routes.is_turn & ~routes.is_tee_turn, routes.into_branch),
        *(routes.out_of_branch, routes.is_straight_over, np.degrees(routes.turn) * routes.is_turn),
        *(bore / routes.bend_radius, routes.radius / (bore / 2) - 1),
    )
    tables.kinds = wp.array(np.stack(kinds, axis=1).astype(np.float32), dtype=float)
    tables.arms = wp.array(_arms(simulation), dtype=float)
    return tables


def _arms(simulation: Simulation) -> Array:
    """Return the arms (k, 8) of branched fittings: begin, direction, length and radius."""
    arms = []
    for part in simulation.scenarios[0].route.network.parts:
        ports = part.fitting.ports
        for name, port in ports.items() if len(ports) > 2 else ():
            axis = part.pose.rotation @ port.rotation[:, 2]
            length = float(np.linalg.norm(port.position))
            arms.append([*part.pose.position, *axis, length, part.fitting.port_radius(name)])
    return np.array(arms, np.float32).reshape(-1, driving.ARM)


def _mode(given: AutoresetMode | str) -> AutoresetMode:
    modes = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
    if given not in (*modes, *(mode.value for mode in modes)):
        choices = tuple(mode.value for mode in modes)
        raise InputError(Fault("autoreset_mode", f"is {given!r}", choices, str(given)))
    return AutoresetMode(given)


def _chosen(options: Mapping[str, Any] | None, n: int) -> NDArray[np.bool_]:
    """Return the worlds (n,) that the options of a reset mean."""
    given, known = options or {}, ("reset_mask",)
    odd = [Fault(f"options.{key}", "unknown key", known, key) for key in given if key not in known]
    if odd:
        raise InputError(odd)
    mask = given.get("reset_mask", np.ones(n, bool))
    mask = mask.numpy() if isinstance(mask, wp.array) else np.asarray(mask)
    if mask.dtype != bool or mask.shape != (n,):
        raise InputError(Fault("options.reset_mask", f"must be an array ({n},) of bool"))
    return mask


def _on_device(actions: Any) -> Any:
    """Return actions as an array of Warp on the device."""
    if isinstance(actions, wp.array):
        return actions
    if hasattr(actions, "detach"):
        return wp.from_torch(actions.detach().float().contiguous())
    return wp.array(np.asarray(actions, np.float32), dtype=float)


def _flat(array: Any, size: int) -> Any:
    """Return an array of worlds as rows of numbers, in the same memory."""
    assert array.is_contiguous
    shape = array.shape[0], size
    rows = wp.array(ptr=array.ptr, dtype=float, shape=shape, device=array.device)
    rows._kept = array
    return rows
