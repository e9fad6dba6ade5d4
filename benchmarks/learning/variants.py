"""What is trained: trials, start and reward of each variant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from batches import Batch

from omnitrack_sim.robots.size import GRAVITY

HALF = 32
"""Robots on each of two cores. More of them together learn less from as many decisions."""
VALIDATION_SEED = 1_000_000
"""Of the first validation trial; the others count on from it. Training begins at seeds below."""
TIME_LIMIT = 20.0
"""Of an episode, s; the feedback controller takes 12 s for a turn that it does not try again."""
OBSERVATION = "preview"
"""What robots without sensors for forces and slip know; policies of it run by own sensors, too."""
_THETA5 = (-60.0, 60.0)
"""One period of the robot's threefold symmetry, as in the suite ``control``, degrees."""
_PRELOAD = (20.0, 35.0)
"""N, likewise."""


@dataclass(frozen=True)
class Trials:
    """What robots of one batch drive.

    Attributes:
        robots: their number. friction, cruise: between which values each is drawn; no cruise: that
            of the scenario.
        downward: gravity along the run, in the direction of travel; otherwise it has any direction.
    """

    robots: int
    friction: tuple[float, float]
    cruise: tuple[float, float] | None = None
    downward: bool = False

    def options(self) -> dict[str, Any]:
        """Keyword arguments of ``gymnasium.make_vec``."""
        changes: dict[str, Any] = {"run.time_limit": TIME_LIMIT}
        if self.downward:
            changes["world.gravity"] = [0.0, 0.0, GRAVITY]
        ranges = {
            "start.theta5_deg": _THETA5,
            "world.friction": self.friction,
            "robot.preload": _PRELOAD,
            "control.cruise_speed": self.cruise,
        }
        gravity = "scenario" if self.downward else "any"
        return {"num_envs": self.robots, "changes": changes, "ranges": ranges, "gravity": gravity}


@dataclass(frozen=True)
class Variant:
    """One way to train for one task.

    Attributes:
        id: of the environment. acting: see docs/how-to/policies.md. words: what it is.
        trials: to train on. validation: by which the best policy is chosen.
        log_std: logarithm of the spread of the network's last weights that are tried, at first.
        ahead: belt actions at first.
        reward: weights of terms that are not the environment's own.
    """

    id: str
    acting: str
    words: str
    trials: Sequence[Trials]
    validation: Sequence[Trials]
    log_std: float
    ahead: float
    reward: Mapping[str, float]

    def batches(self, validation: bool = False) -> list[Batch]:
        """Of the training or of the validation, each in a process of its own."""
        same: dict[str, Any] = {
            "autoreset_mode": "NextStep" if validation else "SameStep",
            "observation": OBSERVATION,
            "sensing": "truth",
            "acting": self.acting,
            "reward": dict(self.reward),
        }
        trials = self.validation if validation else self.trials
        return [Batch(self.id, same | part.options()) for part in trials]


_CRUISE = (0.08, 0.12)
VARIANTS: Mapping[tuple[str, bool], Variant] = {
    ("tee_turn", False): Variant(
        "omnitrack_sim/TeeTurn-v0",
        "direct",
        "from scratch: belts and roll are the policy's alone",
        [Trials(HALF, (0.7, 1.0), _CRUISE), Trials(HALF, (0.5, 0.8), _CRUISE)],
        [Trials(HALF, (0.7, 1.0)), Trials(HALF, (0.5, 0.7))],
        -2.0,
        0.5,
        # With the environment's own weights standing still costs less than trying.
        {"torque_change": -0.004, "failure": -1.0},
    ),
    # The feedback controller fails where friction is low and the way leads down.
    ("tee_turn", True): Variant(
        "omnitrack_sim/TeeTurn-v0",
        "residual",
        "residual: added to the feedback controller",
        [
            Trials(HALF, (0.5, 0.7), _CRUISE),
            Trials(HALF, (0.47, 0.58), _CRUISE, downward=True),
        ],
        [Trials(HALF, (0.5, 0.7)), Trials(HALF, (0.5, 0.56), downward=True)],
        -2.0,
        0.0,
        {},
    ),
}
"""By task, and whether residual."""
