"""Robots in episodes: the scenario that each episode runs, and the simulations that run them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.options import EnvOptions, Tally, check_for
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.feature import bounds, entry_slices, steps_of_decision
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.scenario import Scenario, load_scenario, override, validate
from omnitrack_sim.senses.settings import camera_of
from omnitrack_sim.sim.onboard import Onboard
from omnitrack_sim.sim.simulation import Simulation

RANDOM = "random_network"
"""In the place of a scenario: a random network in each episode."""
NETWORKS = 2**31
"""Number of random networks that episodes are drawn from."""
NO_RETURN = 1.0
"""Entry of a depth picture where nothing comes back: as far as the camera sees."""
Observed = Any
"""Observation of one robot or of n: entries (k,) or (n, k), or a table of entries and picture."""


class EpisodeSampler:
    """Draws the scenario of each episode.

    Attributes:
        alike: whether all episodes share a batch; otherwise each has pipes of its own.
        example: a scenario with the largest of all values that are drawn.

    Raises:
        InputError: the scenario, or one of the values that may be drawn, cannot be used.
    """

    def __init__(self, options: EnvOptions) -> None:
        self._options, self.alike = options, options.scenario != RANDOM
        self._changes: dict[str, Any] = dict(options.changes)
        robot = (self._scenario() if self.alike else self.mission(0)).robot
        check_for(options, robot)
        self._drawn, senses = options.drawn(robot), options.senses(robot)
        if robot.odometry() is not None:
            self._changes = {"sensing.kind": senses} | self._changes
        if options.picture:
            # Cameras at both ends would take turns: the picture would jump from one to the other.
            self._changes = {"sensing.both_ends": False} | self._changes
        if self.alike:
            self._base = self._scenario()
            if self._base.exploration is not None:
                problem = "explores: its pipes are to be known"
                raise InputError(Fault("scenario", problem))
            _ = self._base.route  # computed once: all episodes share it
        base = self._base if self.alike else self.mission(0)
        # Values between both ends of a range are valid where the ends are.
        override(base, {path: low for path, (low, _) in self._drawn.items()})
        self.example = override(base, {path: high for path, (_, high) in self._drawn.items()})
        kind = self.example.sensing.kind
        if kind != senses:
            problem = (
                f"is {senses!r} (left out, it follows from the observation), and the "
                f"changes make sensing.kind {kind!r}; use the option, and leave out the change"
            )
            raise InputError(Fault("sensing", problem))
        # Raises where a decision is no whole number of control steps, before the first episode.
        steps_of_decision(self.example.physics.control_period)
        if options.picture and self.example.sensing.camera != "depth":
            raise InputError(Fault("picture", "is that of the camera 'depth'", ("depth",)))

    def draw(self, rng: np.random.Generator) -> Scenario:
        """The scenario of the next episode; the same from the same numbers."""
        values = self.values(rng)
        if self.alike:
            return with_values(self._base, values)
        return override(self.mission(int(rng.integers(NETWORKS))), values)

    def values(self, rng: np.random.Generator) -> dict[str, Any]:
        """Draw the values of an episode, by dotted path."""
        options = self._options
        values: dict[str, Any] = {
            path: float(rng.uniform(low, high)) for path, (low, high) in self._drawn.items()
        }
        if options.gravity == "any":
            # Three normal numbers have no preferred direction.
            direction = rng.normal(size=3)
            direction *= GRAVITY / np.linalg.norm(direction)
            values["world.gravity"] = tuple(direction.tolist())
        # Sensors draw their errors from seed and world: the seed makes those of each episode new.
        values["seed"] = int(rng.integers(2**63))
        return values

    def _scenario(self) -> Scenario:
        return load_scenario(self._options.scenario, self._changes)

    def mission(self, seed: int) -> Scenario:
        """A random mission through the random network of a seed, and what the options change."""
        network = random_network(seed, self._options.fittings)
        start, goal = np.random.default_rng([seed, 1]).choice(network.open_ends, 2, replace=False)
        data = {
            "name": f"random_{seed}",
            "network": network.model_dump(mode="json"),
            "mission": {"start": str(start), "goals": [str(goal)]},
        }
        return validate(data, changes=self._changes)


def with_values(table: Any, values: Mapping[str, Any]) -> Any:
    """Copy a scenario in plain pipes with values by dotted path, without checking them.

    The route stays: nothing of what a batch's robots need not share changes it.
    """
    fields = {key: getattr(table, key) for key in type(table).model_fields}
    for path, value in values.items():
        key, _, below = path.partition(".")
        fields[key] = with_values(fields[key], {below: value}) if below else value
    changed = table.model_fields_set | {path.partition(".")[0] for path in values}
    # Not validated: both ends of each range were, and what lies between them is valid, too.
    copy = table.model_construct(_fields_set=changed, **fields)
    # Other cached properties hold what old values gave, and are computed anew.
    if "route" in table.__dict__:
        copy.__dict__["route"] = table.__dict__["route"]
    return copy


class EpisodeBatch:
    """n robots that share a simulation, each in an episode of its own, driven by actions.

    Attributes:
        simulation: that runs the episodes.
        decisions: from actions to commands.
        travel: (n, 3) m, travel of each belt since its episode began; (n, 0) without belts.
    """

    def __init__(self, scenarios: Sequence[Scenario], options: EnvOptions) -> None:
        self._options = options
        self._simulate(scenarios)

    def _simulate(self, scenarios: Sequence[Scenario]) -> None:
        options = self._options
        self.simulation = Simulation(scenarios, threads=options.threads, recording=False)
        robot = scenarios[0].robot
        make = robot.decisions
        self.decisions = make(
            self.simulation.setup, options.features(robot), make.actings[options.acting]
        )
        self._has_tracks = "belt_speed" in robot.channels
        self.travel = np.zeros((self.simulation.n, 3 if self._has_tracks else 0))

    def reset(self, rows: NDArray[np.intp], scenarios: Sequence[Scenario]) -> None:
        """Begin new episodes of robots ``rows`` (k,), ascending, with ``scenarios`` (k)."""
        if self._options.scenario == RANDOM:  # other pipes are another model
            self._simulate(scenarios)
            return
        self.simulation.reset(rows, scenarios)
        self.decisions.reset(rows, self.simulation.setup)
        self.travel[rows] = 0.0

    def advance(self, actions: Array) -> Mapping[str, Array]:
        """Carry out actions (n, k) for one decision.

        Robots whose episode is over stay as they are.

        Returns:
            The terms (n,) of the reward, before weights.
        """
        simulation, decisions = self.simulation, self.decisions
        running, tally = simulation.active, Tally(simulation)
        # Whatever the caller gives for an episode that is over, it must not be refused.
        decisions.decide(np.where(running[:, None], actions, 0.0))
        for _ in range(decisions.hold):
            simulation.step(decisions.command(simulation.observation))
            tally.add(simulation)
            if self._has_tracks:
                self.travel += simulation.readings["belt_speed"] * simulation.period
        ended, outcomes = running & ~simulation.active, np.array(self.outcomes(), object)
        arrived = ended & (outcomes == Outcome.REACHED_GOAL)
        failed = ended & ~arrived & (outcomes != Outcome.TIMED_OUT)
        return tally.over(arrived, failed, ended & (outcomes == Outcome.DIVERGED))

    def outcomes(self) -> list[Outcome | None]:
        """Outcome of each robot's episode; None while it runs."""
        endings = self.simulation.endings
        return [None if ending is None else ending.outcome for ending in endings]

    def entries(self) -> NDArray[np.float32]:
        """Entries (n, k) of the robots' observations."""
        return self.decisions.observe(self.simulation.observation)

    def pictures(self) -> NDArray[np.float32]:
        """Last depth picture (n, rows, columns) of each robot, as parts of the camera's range."""
        senses = self.simulation.senses
        assert isinstance(senses, Onboard)
        near = np.nan_to_num(senses.picture / senses.camera.optics.far, nan=NO_RETURN)
        side = round(np.sqrt(near.shape[1]))
        return np.clip(near, 0.0, 1.0).reshape(-1, side, side).astype(np.float32)


class Transition(NamedTuple):
    """Outcome of one decision of n robots.

    Attributes:
        reward: (n,).
        terms: (n,) each by name, with their weights.
        terminated: (n,) bool, episodes that ended, other than by the end of their time.
        truncated: (n,) bool, episodes whose time is over.
    """

    reward: Array
    terms: Mapping[str, Array]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Episodes:
    """n robots in episodes, in as few simulations as their pipes allow.

    Attributes:
        sampler: draws the scenario of each episode.
        entries: where each feature stands in the vector of entries, by name.
        action_space, observation_space: of one robot.
        batches: the simulations, equally large; empty before the first episode.
    """

    def __init__(self, options: EnvOptions, n: int) -> None:
        self._options, self.n = options, n
        self.sampler = EpisodeSampler(options)
        robot = self.sampler.example.robot
        features = options.features(robot)
        ones = np.ones(len(robot.decisions.actions_of(robot)), np.float32)
        self.action_space = gymnasium.spaces.Box(-ones, ones)
        self.observation_space: gymnasium.Space = gymnasium.spaces.Box(*bounds(features))
        self.entries = entry_slices(features)
        if options.picture:
            table = self.sampler.example.sensing
            stride = table.filter.stride  # robots look at every so many rows and columns
            side = len(range(stride // 2, camera_of(table).optics.pixels, stride))
            # Parts of the camera's range, see ``EpisodeBatch.pictures``.
            picture = gymnasium.spaces.Box(0.0, 1.0, (side, side), np.float32)
            self.observation_space = gymnasium.spaces.Dict(
                entries=self.observation_space, picture=picture
            )
        self.batches: list[EpisodeBatch] = []

    def reset(self, rows: NDArray[np.intp], rngs: list[np.random.Generator]) -> None:
        """Begin new episodes of some robots.

        Args:
            rows: (k,) robots, ascending.
            rngs: n generators; each robot draws from its own.
        """
        drawn = [self.sampler.draw(rngs[robot]) for robot in rows.tolist()]
        if not self.batches:
            if len(rows) < self.n:
                raise gymnasium.error.ResetNeeded("the first reset has to be of all robots")
            # Robots in the same pipes share a batch; other pipes are another model.
            groups = [drawn] if self.sampler.alike else [[scenario] for scenario in drawn]
            self.batches = [EpisodeBatch(group, self._options) for group in groups]
        elif self.sampler.alike:
            self.batches[0].reset(rows, drawn)
        else:
            for robot, scenario in zip(rows.tolist(), drawn, strict=True):
                self.batches[robot].reset(np.zeros(1, np.intp), [scenario])

    def advance(self, actions: Array) -> Transition:
        """Carry out actions (n, k); robots whose episode is over stay as they are."""
        before = self._gather(lambda batch: batch.simulation.active)
        parts = np.split(actions, len(self.batches))
        measured = [b.advance(part) for b, part in zip(self.batches, parts, strict=True)]
        terms = {
            name: weight * np.nan_to_num(np.concatenate([terms[name] for terms in measured]))
            for name, weight in self._options.weights.items()
        }
        ended = before & ~self._gather(lambda batch: batch.simulation.active)
        late = np.array(self.outcomes(), object) == Outcome.TIMED_OUT
        return Transition(sum(terms.values(), np.zeros(self.n)), terms, ended & ~late, ended & late)

    def outcomes(self) -> list[Outcome | None]:
        """Outcome of each robot's episode; None while it runs."""
        return [outcome for batch in self.batches for outcome in batch.outcomes()]

    def observe(self) -> Observed:
        """Observation of all robots, in fresh arrays."""
        entries = self._gather(EpisodeBatch.entries)
        if not self._options.picture:
            return entries
        return {"entries": entries, "picture": self._gather(EpisodeBatch.pictures)}

    def info(self) -> dict[str, Array]:
        """True arc length, m, and time, s, of each robot (n,), for Gymnasium's ``info``."""
        values = {
            "distance": self._gather(lambda batch: batch.simulation.location.distance),
            "time": self._gather(lambda batch: batch.simulation.time),
        }
        return {name: np.nan_to_num(array) for name, array in values.items()}

    def batch_of(self, robot: int) -> tuple[EpisodeBatch, int]:
        """The batch of a robot, and its row there."""
        if not self.batches:
            raise gymnasium.error.ResetNeeded("call reset first")
        # All batches are equally large: one of all robots, or one for each.
        size = self.n // len(self.batches)
        return self.batches[robot // size], robot % size

    def scenario(self, robot: int) -> Scenario:
        """The scenario that a robot's episode runs."""
        batch, row = self.batch_of(robot)
        return batch.simulation.scenarios[row]

    def _gather(self, read: Callable[[EpisodeBatch], NDArray]) -> NDArray:
        return np.concatenate([read(batch) for batch in self.batches])


def checked_actions(given: Any, shape: tuple[int, ...]) -> NDArray:
    """Return actions as an array; a ``ValueError`` where it has another shape."""
    actions = np.asarray(given)
    if actions.shape != shape:
        raise ValueError(f"action has shape {actions.shape}, expected {shape}")
    return actions


def checked_reset_options(
    given: Mapping[str, Any] | None, known: tuple[str, ...]
) -> Mapping[str, Any]:
    """Return the options of a reset; an ``InputError`` for those that are not ``known``."""
    problem = "unknown key" if known else "unknown key; a reset of one robot has no options"
    odd = [
        Fault(f"options.{key}", problem, known, str(key)) for key in given or {} if key not in known
    ]
    if odd:
        raise InputError(odd)
    return given or {}


def row_of(observed: Observed, robot: int) -> Observed:
    """Copy the observation of one robot from that of all."""
    if isinstance(observed, dict):
        return {name: values[robot].copy() for name, values in observed.items()}
    return observed[robot].copy()
