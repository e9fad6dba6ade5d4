"""The environments: one robot, and many robots on one batch of the engine; their pictures."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, quaternion_from_matrix
from omnitrack_sim.gym.episodes import (
    EpisodeBatch,
    Episodes,
    Observed,
    Transition,
    checked_actions,
    checked_reset_options,
    row_of,
)
from omnitrack_sim.gym.options import EnvOptions, options_of
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.channels import recorded
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.film.stage import Stage
from omnitrack_sim.show.playback import MAX_MAGNITUDE
from omnitrack_sim.show.run_playback import RunPlayback

if TYPE_CHECKING:
    from omnitrack_sim.show.viewer.window import Window


SPACING = 0.01
"""Distance of the places along the route that cameras are set up for, m."""


class EpisodeScreen:
    """Shows robots as they are now. What is needed to paint the pipes of a batch is made once."""

    def __init__(self, options: EnvOptions) -> None:
        self._options = options
        self._stages: dict[EpisodeBatch, tuple[Route, EpisodeStage]] = {}
        self._window: Window | None = None
        self._pipes: Route | None = None
        self._due = 0.0

    def picture(self, batch: EpisodeBatch, robot: int) -> NDArray[np.uint8]:
        """A robot of a batch (height, width, 3)."""
        scenario = batch.simulation.scenarios[robot]
        pipes, stage = self._stages.get(batch, (None, None))
        if stage is None or pipes is not scenario.route:
            if stage is not None:
                stage.__exit__()
            size = (self._options.width, self._options.height)
            stage = EpisodeStage(_along_the_route(scenario), size, self._options.camera)
            self._stages[batch] = scenario.route, stage
        return stage.frame(batch.simulation.plant.qpos[robot], batch.travel[robot])

    def show(self, batch: EpisodeBatch, robot: int) -> None:
        """Show a robot in the window, not faster than it drives.

        Once the window has been closed nothing is shown any more.
        """
        # Not at the top: a window needs GLFW, which pictures do not.
        from omnitrack_sim.show.viewer.window import Window, require_screen

        scenario = batch.simulation.scenarios[robot]
        if self._window is None or self._pipes is not scenario.route:
            require_screen()
            self._close_window()
            self._window = Window(scenario)
            self._window.__enter__()
            self._pipes = scenario.route
        qpos = np.array(batch.simulation.plant.qpos[robot])
        if not _is_sound(qpos):
            return
        scenario.robot.display.place_tracks(self._window.model, qpos, batch.travel[robot])
        self._window.show(qpos, [])
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + batch.decisions.hold * batch.simulation.period

    def _close_window(self) -> None:
        if self._window is not None:
            self._window.__exit__()
            self._window = None

    def close(self) -> None:
        """Close the window and free what pictures are painted with."""
        for _, stage in self._stages.values():
            stage.__exit__()
        self._stages.clear()
        self._close_window()


class EpisodeStage(Stage):
    """A stage on which a robot stands as it is now."""

    _live: Array | None = None

    def __init__(self, way: Result, size: tuple[int, int], camera: str) -> None:
        super().__init__(RunPlayback(way), size, camera, fine=False)
        self._display = way.scenario.robot.display
        self._places = way.trajectory["position"]

    def frame(self, qpos: Array, travel: Array) -> NDArray[np.uint8]:
        """Return the picture of a robot; one whose physics has diverged stays where it was.

        Args:
            qpos: (nq,) joint positions.
            travel: (3,) m, by which the belts have run on.
        """
        if _is_sound(qpos) or self._live is None:
            self._live = np.nan_to_num(qpos)
            self._display.place_tracks(self.model, self._live, travel)
        # The camera is that of the nearest place on the route.
        near = ((self._places - self._live[:3]) ** 2).sum(axis=1).argmin()
        return self.paint(int(near), self._live)


def _is_sound(qpos: Array) -> bool:
    return bool(np.abs(qpos).max() < MAX_MAGNITUDE)  # NaN is not less either


def _along_the_route(scenario: Scenario) -> Result:
    """Return a run along a scenario's route, by which cameras are placed."""
    route, planner = scenario.route, scenario.planner
    distance = np.arange(scenario.start.distance, scenario.goal_distance, SPACING)
    samples = len(distance)
    schema = recorded(scenario.robot.channels.values())
    channels = {name: np.zeros((samples, *channel.shape)) for name, channel in schema.items()}
    channels["position"] = route.centreline.at(distance)[0]
    channels["quaternion"] = quaternion_from_matrix(route.centreline.frame(distance))
    channels["distance"], channels["gear"] = distance, np.ones(samples)
    qpos = np.zeros((samples, scenario.robot.joint_count))
    # Cameras are set up by the poses alone: the joints may stay at 0.
    qpos[:, :3], qpos[:, 3:7] = channels["position"], channels["quaternion"]
    when = distance / scenario.control.cruise_speed
    trajectory = Trajectory(when - when[0], channels, ("drive",), qpos, schema=schema)
    legs = () if planner is None else (planner.first,)
    end = float(trajectory.time[-1])
    return Result(scenario, Outcome.REACHED_GOAL, "", end, {}, trajectory, {}, legs=legs)


FPS = 20
"""Decisions a second."""
MAX_ROBOTS = 65536
"""Most robots of one environment."""


class RobotEnv(gymnasium.Env):
    """One robot in pipes: see docs/how-to/gym.md.

    Args:
        given: the options, see ``EnvOptions``.

    Attributes:
        entries: where each feature stands in the vector of entries: slices by name.

    Raises:
        InputError: an option cannot be used; the fault names it and the choices.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as of Env
        "render_modes": ["rgb_array", "human"],
        "render_fps": FPS,
    }

    def __init__(self, **given: Any) -> None:
        options = options_of(given)
        self._episodes = Episodes(options, 1)
        self.action_space = self._episodes.action_space
        self.observation_space = self._episodes.observation_space
        self.entries = self._episodes.entries
        self.render_mode = options.render_mode
        self._screen = None if options.render_mode is None else EpisodeScreen(options)
        self._over = True

    @property
    def scenario(self) -> Scenario:
        """Scenario of the current episode.

        ``ot.run`` of it, under a controller that decides the same, gives the same bytes.
        """
        return self._episodes.scenario(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin an episode. ``options`` is of Gymnasium's signature; there are none.

        Raises:
            InputError: ``options`` holds something.
        """
        checked_reset_options(options, ())
        super().reset(seed=seed)
        self._episodes.reset(np.zeros(1, np.intp), [self.np_random])
        self._over = False
        self._show()
        return row_of(self._episodes.observe(), 0), self._info()

    def _info(self) -> dict[str, Any]:
        return {name: float(values[0]) for name, values in self._episodes.info().items()}

    def step(self, action: Any) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Carry out an action (k,) for one decision, 0.05 s.

        Raises:
            ValueError: it has another shape, or holds what is not a number.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("the episode is over; call reset")
        transition = self._episodes.advance(
            checked_actions(action, self._episodes.action_space.shape)[None]
        )
        terminated, truncated = bool(transition.terminated[0]), bool(transition.truncated[0])
        self._over = terminated or truncated
        info = self._info()
        info["terms"] = {name: float(values[0]) for name, values in transition.terms.items()}
        (outcome,) = self._episodes.outcomes()
        if outcome is not None:
            info["outcome"] = outcome.value
            info["is_success"] = outcome is Outcome.REACHED_GOAL
        self._show()
        observed = row_of(self._episodes.observe(), 0)
        return observed, float(transition.reward[0]), terminated, truncated, info

    def _show(self) -> None:
        if self.render_mode == "human" and self._screen is not None:
            self._screen.show(*self._episodes.batch_of(0))

    def render(self) -> Any:
        """A picture (height, width, 3) in the mode ``rgb_array``."""
        if self._screen is None:
            gymnasium.logger.warn("nothing is rendered: make the environment with a render_mode")
            return None
        if self.render_mode == "human":
            return self._show()
        return self._screen.picture(*self._episodes.batch_of(0))

    def close(self) -> None:
        """Close window and pictures."""
        if self._screen is not None:
            self._screen.close()


class RobotVectorEnv(VectorEnv):
    """Many robots in pipes, each in an episode of its own: see docs/how-to/gym.md.

    Robot i with the seed s + i sees, bit for bit, what the single environment with that seed sees.

    Args:
        num_envs: number of robots.
        autoreset_mode: when an episode that is over is followed by the next, see Gymnasium.
        given: the options, see ``EnvOptions``.

    Attributes:
        entries: where each feature stands in a robot's vector of entries: slices by name.

    Raises:
        InputError: an option cannot be used; the fault names it and the choices.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as of VectorEnv
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **given: Any,
    ) -> None:
        modes = tuple(mode.value for mode in AutoresetMode)
        if autoreset_mode not in (*AutoresetMode, *modes):
            problem = f"is {autoreset_mode!r}"
            raise InputError(Fault("autoreset_mode", problem, modes, str(autoreset_mode)))
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self._mode}
        if not isinstance(num_envs, int) or not 1 <= num_envs <= MAX_ROBOTS:
            raise InputError(Fault("num_envs", f"is {num_envs!r}; a number from 1 to {MAX_ROBOTS}"))
        options = options_of(given)
        if options.render_mode == "human":
            problem = "is 'human', which is for one robot alone"
            raise InputError(Fault("render_mode", problem, ("rgb_array",)))
        self.num_envs, self._episodes = num_envs, Episodes(options, num_envs)
        self.single_action_space = self._episodes.action_space
        self.single_observation_space = self._episodes.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.entries = self._episodes.entries
        self.render_mode = options.render_mode
        self._screen = None if options.render_mode is None else EpisodeScreen(options)
        self._rngs: list[np.random.Generator] = []
        self._over = np.ones(num_envs, bool)

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the current episodes."""
        return [self._episodes.scenario(robot) for robot in range(self.num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin an episode of every robot, or of those of ``options["reset_mask"]`` (n,) bool.

        ``seed``: robot i gets ``seed + i``; a list has one each.
        """
        mask = self._mask(options)
        self._seed(seed, mask)
        self._episodes.reset(np.flatnonzero(mask), self._rngs)
        self._over = self._over & ~mask
        return self._episodes.observe(), _masked(self._episodes.info(), mask)

    def _mask(self, options: Mapping[str, Any] | None) -> NDArray[np.bool_]:
        """The robots (n,) that a reset is of."""
        mask = checked_reset_options(options, ("reset_mask",)).get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, bool)
        whole = isinstance(mask, np.ndarray) and mask.dtype == bool
        if not whole or mask.shape != (self.num_envs,) or not mask.any():
            problem = f"must be an array ({self.num_envs},) of bool, with one True at least"
            raise InputError(Fault("options.reset_mask", problem))
        return mask.copy()

    def _seed(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_]) -> None:
        """Seed the robots' random numbers; those without a seed go on with theirs."""
        n = self.num_envs
        if isinstance(seed, int | np.integer):
            # Gymnasium's own generator is seeded, too, though no robot draws from it.
            super().reset(seed=int(seed))
            seeds: Sequence[int | None] = [int(seed) + robot for robot in range(n)]
        else:
            seeds = [None] * n if seed is None else list(seed)
        if len(seeds) != n:
            raise InputError(Fault("seed", f"is a list of {len(seeds)}; {n} robots need as many"))
        if not self._rngs:
            self._rngs = [seeding.np_random(number)[0] for number in seeds]
            return
        for robot in np.flatnonzero(mask).tolist():
            if seeds[robot] is not None:
                # A generator of each robot's own: its episodes do not depend on the others.
                self._rngs[robot] = seeding.np_random(seeds[robot])[0]

    def step(self, actions: Any) -> tuple[Observed, Array, NDArray, NDArray, dict[str, Any]]:
        """Carry out actions (n, k) for one decision, 0.05 s.

        Raises:
            ValueError: they have another shape, or hold what is not a number.
        """
        episodes, over = self._episodes, self._over
        if not episodes.batches or (self._mode is AutoresetMode.DISABLED and over.any()):
            raise gymnasium.error.ResetNeeded("an episode is over; call reset")
        actions = checked_actions(actions, (self.num_envs, *episodes.action_space.shape))
        # A robot whose episode is over is reset in this step, and its action counts for nothing.
        transition = episodes.advance(np.where(over[:, None], 0.0, actions))
        ended = transition.terminated | transition.truncated
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            info = self._follow(transition, ended)
        else:
            info = _ended(episodes.outcomes(), ended) | _terms(transition, ~over)
            if self._mode is AutoresetMode.NEXT_STEP and over.any():
                episodes.reset(np.flatnonzero(over), self._rngs)
        # After the resets, so that time and distance are those of the observation.
        info |= _masked(episodes.info(), np.ones(self.num_envs, bool))
        # In SAME_STEP the next episode has already begun.
        self._over = ended & (self._mode is not AutoresetMode.SAME_STEP)
        return (
            episodes.observe(),
            transition.reward,
            transition.terminated,
            transition.truncated,
            info,
        )

    def _follow(self, transition: Transition, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Begin the episodes after those that have ended in this step.

        Returns:
            ``info`` with the last observations of the episodes that have ended.
        """
        # Before the reset: the final observation is of the episode that has ended.
        episodes, rows, last = self._episodes, np.flatnonzero(ended), self._episodes.observe()
        observed = np.full(self.num_envs, None, object)
        for robot in rows.tolist():
            observed[robot] = row_of(last, robot)
        final = _ended(episodes.outcomes(), ended) | _terms(transition, ended)
        final |= _masked(episodes.info(), ended)
        episodes.reset(rows, self._rngs)
        info = _masked({"final_obs": observed, "final_info": final}, ended)
        return info | _terms(transition, ~ended)

    def render(self) -> tuple[NDArray, ...] | None:
        """A picture (height, width, 3) of each robot in the mode ``rgb_array``."""
        if self._screen is None:
            return None
        rows = [self._episodes.batch_of(robot) for robot in range(self.num_envs)]
        return tuple(self._screen.picture(*row) for row in rows)

    def close_extras(self, **_: Any) -> None:
        """Free what pictures are painted with."""
        if self._screen is not None:
            self._screen.close()


def _terms(transition: Transition, which: NDArray[np.bool_]) -> dict[str, Any]:
    """Terms of the reward of the robots ``which`` (n,), as ``info`` has them."""
    return _masked({"terms": _masked(transition.terms, which)}, which) if which.any() else {}


def _ended(outcomes: Sequence[Outcome | None], ended: NDArray[np.bool_]) -> dict[str, Any]:
    """Outcomes of the episodes that have ``ended`` (n,), as ``info`` has them."""
    if not ended.any():
        return {}
    pairs = zip(outcomes, ended, strict=True)
    words = np.array([own.value if own and over else None for own, over in pairs], object)
    reached = np.array([outcome is Outcome.REACHED_GOAL for outcome in outcomes])
    return _masked({"outcome": words, "is_success": reached & ended}, ended)


def _masked(values: Mapping[str, Any], which: NDArray[np.bool_]) -> dict[str, Any]:
    """Values (n,) as ``info`` has them: beside each, the mask of the robots that it is of."""
    info: dict[str, Any] = {}
    for name, value in values.items():
        info |= {name: value, f"_{name}": which.copy()}
    return info
