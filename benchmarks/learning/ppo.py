"""Proximal policy optimisation in NumPy, for thousands of robots at once.

A network of ten thousand numbers learns in a part of the time that thousands of worlds take for
what it learns from; it needs no library of tensors. What is tried are changes of the policy's last
weights, for some decisions at a time (generalised state-dependent exploration).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.robots.omnitrack.policy.file import Mlp

Numbers = NDArray[np.float32]
REACH = 10.0
"""Size at which normalised entries are cut off."""
MIN_VARIANCE = 1e-4
"""Added to the variance of entries, so that those that never vary in training are not blown up."""


@dataclass(frozen=True)
class Settings:
    """Settings of a learner.

    Attributes:
        rate: of Adam at first; it falls to a tenth at the end.
        epochs: times that each decision is learned from.
        batch: decisions of one step of Adam.
        discount: of a reward a decision later: 0.995 counts for 10 s, as long as a turn takes.
        trace: lambda of the advantages.
        clip: by how much the probability of an action may change, as a part of it.
        most_change: mean Kullback-Leibler divergence from which on a round ends early.
        hold: decisions for which a change of the last weights is tried.
        log_std: logarithm of the spread of these changes at first.
        layers: widths of the hidden layers, of policy and of value.
    """

    rate: float = 5e-4
    epochs: int = 4
    batch: int = 8192
    discount: float = 0.995
    trace: float = 0.95
    clip: float = 0.2
    most_change: float = 0.02
    hold: int = 16
    log_std: float = -2.0
    layers: Sequence[int] = (64, 64)


class Rollout:
    """Decisions (t, n) of n robots.

    Attributes:
        seen: (t, n, k) normalised entries.
        action: (t, n, a), with their ``log_probability`` (t, n).
        value: (t, n), worth of what was seen.
        reward: (t, n).
        ended: (t, n) bool, the episode is over after it.
        value_after: (t, n), worth of what was seen last in episodes whose time was over.
    """

    def __init__(self, steps: int, robots: int, entries: int, actions: int) -> None:
        self.seen = np.zeros((steps, robots, entries), np.float32)
        self.action = np.zeros((steps, robots, actions), np.float32)
        self.log_probability, self.value, self.reward, self.value_after = np.zeros(
            (4, steps, robots), np.float32
        )
        self.ended = np.zeros((steps, robots), bool)

    def advantages(self, last: Numbers, discount: float, trace: float) -> Numbers:
        """Return the advantages (t, n) of the actions.

        Args:
            last: (n,) worth of what is seen after the last decision.
            discount: see ``Settings``.
            trace: see ``Settings``.
        """
        found, later, ahead = np.zeros_like(self.value), last, np.zeros_like(last)
        for t in reversed(range(len(self.value))):
            goes_on = ~self.ended[t]
            worth = np.where(goes_on, later, self.value_after[t])
            error = self.reward[t] + discount * worth - self.value[t]
            ahead = error + discount * trace * goes_on * ahead
            found[t], later = ahead, self.value[t]
        return found


class Scale:
    """Mean and variance of all rows so far."""

    def __init__(self, size: int) -> None:
        self.mean, self.variance, self.count = np.zeros(size), np.ones(size), 1e-4

    def add(self, rows: NDArray) -> None:
        """Add rows (m, size)."""
        count, apart = len(rows), rows.mean(axis=0) - self.mean
        whole = self.count + count
        squares = self.variance * self.count + rows.var(axis=0) * count
        self.variance = (squares + apart**2 * self.count * count / whole) / whole
        self.mean, self.count = self.mean + apart * count / whole, whole

    @property
    def std(self) -> NDArray:
        """By which rows are divided, (size,)."""
        return np.sqrt(self.variance + MIN_VARIANCE)

    def __call__(self, rows: NDArray) -> Numbers:
        """Return rows normalised."""
        return np.clip((rows - self.mean) / self.std, -REACH, REACH).astype(np.float32)


class Layers:
    """A multilayer perceptron: arrays ``parts``, weights and biases in turn."""

    def __init__(self, rng: np.random.Generator, widths: Sequence[int], last: float) -> None:
        self.parts: list[Numbers] = []
        for i, (rows, columns) in enumerate(pairwise(widths)):
            gain = last if i == len(widths) - 2 else 1.0
            weights = rng.normal(0.0, gain / np.sqrt(rows), (rows, columns))
            self.parts += [weights.astype(np.float32), np.zeros(columns, np.float32)]

    def __call__(self, rows: Numbers) -> list[Numbers]:
        """Return the input, the outputs of all hidden layers and that of the last."""
        outputs = [rows]
        for i in range(0, len(self.parts), 2):
            whole = outputs[-1] @ self.parts[i] + self.parts[i + 1]
            outputs.append(np.tanh(whole) if i < len(self.parts) - 2 else whole)
        return outputs

    def gradients(self, outputs: Sequence[Numbers], slope: Numbers) -> list[Numbers]:
        """Return the gradients of ``parts``, from those (m, a) of a loss by the last output."""
        found: list[Numbers] = []
        for i in range(len(self.parts) - 2, -1, -2):
            before = outputs[i // 2]
            found = [before.T @ slope, slope.sum(axis=0), *found]
            if i:
                slope = (slope @ self.parts[i].T) * (1.0 - before**2)
        return found


class Adam:
    """Steps down gradients of some arrays, in place."""

    def __init__(self, arrays: Sequence[Numbers]) -> None:
        self.arrays, self.steps = list(arrays), 0
        self._means = [np.zeros_like(array) for array in arrays]
        self._squares = [np.zeros_like(array) for array in arrays]

    def step(self, gradients: Sequence[Numbers], rate: float, most: float = 0.5) -> None:
        """Take a step; gradients longer than ``most`` together are shortened."""
        self.steps += 1
        length = float(np.sqrt(sum(float((g**2).sum()) for g in gradients)))
        shorter = min(1.0, most / max(length, 1e-9))
        step = rate * np.sqrt(1 - 0.999**self.steps) / (1 - 0.9**self.steps)
        parts = zip(self.arrays, gradients, self._means, self._squares, strict=True)
        for array, gradient, mean, square in parts:
            mean += 0.1 * (shorter * gradient - mean)
            square += 0.001 * ((shorter * gradient) ** 2 - square)
            array -= (step * mean / (np.sqrt(square) + 1e-8)).astype(np.float32)


class Ppo:
    """A policy that learns from rollouts.

    Args:
        entries, actions: numbers that a robot observes and decides.
        robots: n that try at the same time.
        ahead: actions (a,) at first.
        settings: see there.
        seed: of weights, trials and order.
    """

    def __init__(
        self,
        entries: int,
        actions: int,
        robots: int,
        ahead: Sequence[float],
        settings: Settings,
        seed: int,
    ) -> None:
        self.settings, self._rng = settings, np.random.default_rng(seed)
        widths = [entries, *settings.layers]
        self.scale = Scale(entries)
        self.actor = Layers(self._rng, [*widths, actions], 0.01)
        self.actor.parts[-1][:] = ahead
        self.critic = Layers(self._rng, [*widths, 1], 1.0)
        self.log_std = np.full((widths[-1], actions), settings.log_std, np.float32)
        self._adam = Adam([*self.actor.parts, self.log_std, *self.critic.parts])
        self._tried = np.zeros((robots, widths[-1], actions), np.float32)
        self._decisions = 0

    def act(self, seen: Numbers) -> tuple[Numbers, Numbers]:
        """Return actions (n, a) to try for normalised entries (n, k), and their log probability."""
        if self._decisions % self.settings.hold == 0:
            shape = self._tried.shape
            drawn = self._rng.standard_normal(shape, np.float32)
            self._tried = np.exp(self.log_std) * drawn
        self._decisions += 1
        *_, hidden, mean = self.actor(seen)
        action = mean + np.einsum("nh,nha->na", hidden, self._tried)
        return action, log_probability(action - mean, self._variance(hidden))

    def value(self, seen: Numbers) -> Numbers:
        """Return the worth (n,) of normalised entries (n, k)."""
        return self.critic(seen)[-1][:, 0]

    def _variance(self, hidden: Numbers) -> Numbers:
        return hidden**2 @ np.exp(2.0 * self.log_std) + 1e-6

    def learn(self, rollout: Rollout, last: Numbers, part: float) -> float:
        """Learn from a rollout.

        Args:
            rollout: of all robots.
            last: (n, k) normalised entries after it.
            part: of the training that is over, 0 to 1.

        Returns:
            The change of the policy: the mean Kullback-Leibler divergence of the last epoch.
        """
        settings = self.settings
        gain = rollout.advantages(self.value(last), settings.discount, settings.trace)
        worth, count = (gain + rollout.value).ravel(), gain.size
        gain = ((gain - gain.mean()) / (gain.std() + 1e-8)).ravel()
        seen = rollout.seen.reshape(count, -1)
        action, before = rollout.action.reshape(count, -1), rollout.log_probability.ravel()
        rate, change = settings.rate * (1.0 - 0.9 * min(part, 1.0)), 0.0
        for _ in range(settings.epochs):
            order, changes = self._rng.permutation(count), []
            for first in range(0, count, settings.batch):
                own = order[first : first + settings.batch]
                slopes, moved = self._slopes(seen[own], action[own], before[own], gain[own])
                outputs = self.critic(seen[own])
                error = (outputs[-1][:, 0] - worth[own])[:, None] / len(own)
                self._adam.step([*slopes, *self.critic.gradients(outputs, error)], rate)
                changes.append(moved)
            change = float(np.mean(changes))
            if change > settings.most_change:
                break
        return change

    def _slopes(
        self, seen: Numbers, action: Numbers, before: Numbers, gain: Numbers
    ) -> tuple[list[Numbers], float]:
        """Return the gradients of policy and spread, and how far the policy has moved."""
        outputs = self.actor(seen)
        hidden, apart = outputs[-2], action - outputs[-1]
        variance = self._variance(hidden)
        moved = log_probability(apart, variance) - before
        ratio, clip = np.exp(np.clip(moved, -20.0, 20.0)), self.settings.clip
        # Beyond the clip an action that has become likelier, or unlikelier, as it should is left.
        counts = np.where(gain > 0, ratio < 1.0 + clip, ratio > 1.0 - clip)
        slope = (-(gain * ratio * counts) / len(seen))[:, None]
        # The layers below are not taught to make what is tried larger or smaller.
        by_variance = 0.5 * slope * (apart**2 / variance - 1.0) / variance
        spread = 2.0 * np.exp(2.0 * self.log_std) * (hidden.T**2 @ by_variance)
        parts = self.actor.gradients(outputs, slope * apart / variance)
        return [*parts, spread], float((ratio - 1.0 - moved).mean())

    def network(self) -> Mlp:
        """Return the policy, of entries as they come."""
        parts = self.actor.parts
        return Mlp(parts[::2], parts[1::2], self.scale.mean, self.scale.std, REACH)


def log_probability(apart: Numbers, variance: Numbers) -> Numbers:
    """Return the log probability (n,) of actions that lie ``apart`` (n, a) from their mean."""
    return -0.5 * (apart**2 / variance + np.log(2.0 * np.pi * variance)).sum(axis=1)
