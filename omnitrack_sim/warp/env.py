"""Environments whose episodes never leave the device: what is any robot's of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import mujoco_warp as mjw
import numpy as np
import warp as wp
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.gym.options import TERMS, options_of
from omnitrack_sim.robots.feature import Feature, bounds, entry_slices
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp import episodes
from omnitrack_sim.warp.origins import recentre
from omnitrack_sim.warp.plant import (
    CONTACTS,
    ROWS,
    UNREAD,
    field_of,
    put_field,
    put_seated_model,
)
from omnitrack_sim.warp.starts import entry_numbers, sampler_of, starts_of

SEEDS = 2**31
"""Number of seeds that worlds draw the starts of their episodes by."""


class DeviceVectorEnv(VectorEnv, ABC):
    """Robots of one kind in pipes on a device, each in an episode of its own.

    A class for one kind of robot says what it adds: ``actions``, ``shipped``, and the methods
    without a body here, of which ``take_actions``, ``command``, ``read`` and ``write_entries``
    launch kernels of its own for all worlds. Arguments, attributes: see ``ot.warp.WarpVectorEnv``.
    """

    outcomes = episodes.OUTCOMES
    actions: ClassVar[tuple[str, ...]]
    """Names of the entries of an action."""
    shipped: ClassVar[Mapping[str, Feature]]
    """Features by name, in the order of the entries that ``write_entries`` writes."""

    def __init__(
        self,
        scenario: str = "tee_turn",
        num_envs: int = 1024,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        starts: int = 1024,
        start_seed: int = 0,
        networks: int = 8,
        **given: Any,
    ) -> None:
        self._at_once = _mode(autoreset_mode) is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": _mode(autoreset_mode), "render_modes": []}
        counts = {"num_envs": num_envs, "starts": starts, "networks": networks}
        for name, value in counts.items():
            if not isinstance(value, int) or value < 1:
                raise InputError(Fault(name, f"is {value!r}; a number from 1 on is needed"))
        options = options_of({"scenario": scenario, "sensing": "truth", **given})
        self.num_envs = num_envs
        sampler = sampler_of(options)
        robot = sampler.example.robot
        self.check_robot(robot)
        self.starts = starts_of(
            sampler, starts, start_seed, networks, options.threads, self.own_state
        )
        self.model = self.starts.simulation.model
        features = options.features(robot)
        ones = np.ones(len(self.actions), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-ones, ones)
        self.single_observation_space = gymnasium.spaces.Box(*bounds(features))
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.entries = entry_slices(features)
        self._put_worlds()
        self._put_results(features, [options.weights[name] for name in TERMS])
        self.put_robot(self.starts.simulation)
        self._graph: Any = None
        self._begun = False

    # What a kind of robot adds

    @abstractmethod
    def check_robot(self, robot: Robot) -> None:
        """Raise an ``InputError`` for a robot that is of another kind, or not on the device."""

    @abstractmethod
    def own_state(self, simulation: Simulation) -> Mapping[str, ArrayLike]:
        """Return the numbers (n, ...) of robots at their start that follow ``episodes.SIZES``."""

    @abstractmethod
    def put_robot(self, simulation: Simulation) -> None:
        """Bring what is the robot's own to the device."""

    @abstractmethod
    def take_actions(self, actions: Any) -> None:
        """Keep the actions (n, k) of a decision in the worlds' states."""

    @abstractmethod
    def command(self) -> None:
        """Write the inputs of one control step."""

    @abstractmethod
    def read(self) -> None:
        """Read what robots measure after a control step: ``episodes.SIZES`` up to the effort."""

    @abstractmethod
    def write_entries(self, entries: Any) -> None:
        """Write the quantities of all ``shipped`` features (n, k)."""

    def _put_worlds(self) -> None:
        """Bring the model, the worlds and their starts to the device."""
        n, arrays = self.num_envs, self.starts.arrays
        self.m = put_seated_model(self.model)
        self.d = mjw.make_data(self.model, nworld=n, nconmax=CONTACTS, njmax=ROWS)
        self.course = episodes.course_of(self.starts.simulation)
        self.state = wp.zeros((n, arrays["state"].shape[1]), dtype=float)
        targets = {"state": self.state, "qpos": self.d.qpos, "ctrl": self.d.ctrl}
        self._copies = []
        for name, values in arrays.items():
            if name in UNREAD:
                continue
            if name not in targets:
                shape = np.shape(field_of(self.model, name))
                put_field(self.m, name, np.tile(values[0].reshape(shape), (n, *[1] * len(shape))))
                targets[name] = field_of(self.m, name)
            source = wp.array(values.astype(np.float32), dtype=float)
            self._copies.append((source, _flat(targets[name], values.shape[1])))
        walls = self.m.callback.contactfilter
        walls.origins = self.origins = wp.zeros(n, dtype=wp.vec3d)
        self._start_origins = wp.array(self.starts.origins, dtype=wp.vec3d)
        cleared = self.d.qvel, self.d.qacc_warmstart
        self._cleared = [_flat(each, each.shape[1]) for each in cleared]

    def _put_results(self, features: Sequence[Feature], weights: Sequence[float]) -> None:
        """Bring the numbers of observations and rewards to the device, and make room for them."""
        n, numbers = self.num_envs, entry_numbers(features, self.shipped)
        self._actions = wp.zeros((n, len(self.actions)), dtype=float)
        self.outcome, self._over = wp.zeros(n, dtype=int), wp.zeros(n, dtype=int)
        self._ending = wp.zeros(n, dtype=int)
        self._terms, self._reward = wp.zeros((n, 6), dtype=float), wp.zeros(n, dtype=float)
        self._terminated, self._truncated = wp.zeros(n, dtype=bool), wp.zeros(n, dtype=bool)
        self._anew, self.start = wp.zeros(n, dtype=bool), wp.zeros(n, dtype=int)
        self._seeds, self._episodes = wp.zeros(n, dtype=int), wp.zeros(n, dtype=int)
        count = sum(feature.size for feature in self.shipped.values())
        self._all_entries = wp.zeros((n, count), dtype=float)
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
        """Carry out actions (n, k) for one decision, 0.05 s.

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
        n, d = self.num_envs, self.d
        wp.launch(episodes.begin_decision, n, inputs=[self.outcome, self._over, self._terms])
        self.take_actions(self._actions)
        recentre(self.m, self.d)
        for _ in range(self.starts.hold):
            self.command()
            for _ in range(self.starts.substeps):
                mjw.step(self.m, d)
            wp.launch(episodes.end_diverged, n, inputs=[d.qpos, d.qvel, self.outcome])
            self.read()
            inputs = [self.course, self.state, self.outcome, self._terms]
            wp.launch(episodes.judge, n, inputs=inputs)
        told = [self._reward, self._terminated, self._truncated, self._ending]
        inputs = [self._weights, self._over, self.outcome, self._terms, *told]
        wp.launch(episodes.end_decision, n, inputs=inputs)
        if self._at_once:
            self._observe(self._last_observed)
        inputs = [self._over, self._terminated, self._truncated, self._at_once, self._anew]
        wp.launch(episodes.mark, n, inputs=inputs)
        self._begin_anew()
        self._observe(self._observed)

    def _begin_anew(self) -> None:
        """Begin new episodes in the worlds that are marked."""
        n, count = self.num_envs, len(self.starts.arrays["state"])
        inputs = [self._seeds, self._episodes, count, self._anew, self.outcome, self.start]
        wp.launch(episodes.draw, n, inputs=inputs)
        for source, target in self._copies:
            inputs = [self._anew, self.start, source, target]
            wp.launch(episodes.copy_rows, target.shape, inputs=inputs)
        inputs = [self._anew, self.start, self._start_origins, self.origins]
        wp.launch(episodes.copy_origins, n, inputs=inputs)
        for target in self._cleared:
            wp.launch(episodes.clear_rows, target.shape, inputs=[self._anew, target])

    def _observe(self, target: Any) -> None:
        self.write_entries(self._all_entries)
        inputs = [self._numbers, self._ranges, self._all_entries, target]
        wp.launch(episodes.select, target.shape, inputs=inputs)

    def _infos(self) -> dict[str, Any]:
        """Arrays beside the results: place, time, terms of the reward, outcomes."""
        state = self.state
        infos = {
            "distance": state[:, episodes.DISTANCE],
            "time": state[:, episodes.TIME],
            "terms": {name: self._terms[:, k] for k, name in enumerate(TERMS)},
            "outcome": self._ending,
        }
        return infos | ({"final_obs": self._last_observed} if self._at_once else {})


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
