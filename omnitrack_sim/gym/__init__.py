"""Environments of Gymnasium for learned controllers (extra ``gym``).

``import omnitrack_sim.gym`` registers them; ``gymnasium.make("omnitrack_sim/TeeTurn-v0")`` makes
one robot's, ``gymnasium.make_vec`` many robots' on one batch. docs/how-to/gym.md describes
observations, actions, rewards and all options.
"""

try:
    from gymnasium.envs.registration import register, registry
except ImportError as error:
    told = "omnitrack_sim.gym needs Gymnasium: pip install 'omnitrack_sim[gym]'"
    raise ImportError(f"{told} ({error})") from error

from omnitrack_sim.gym.env import RobotEnv
from omnitrack_sim.gym.terms import TERMS
from omnitrack_sim.gym.vector import RobotVectorEnv

__all__ = ["IDS", "TERMS", "RobotEnv", "RobotVectorEnv"]

_SCENARIOS = {
    "omnitrack_sim/TeeTurn-v0": "tee_turn",
    "omnitrack_sim/TeeMerge-v0": "tee_merge",
    "omnitrack_sim/Elbow-v0": "elbow",
    "omnitrack_sim/Straight-v0": "straight",
    "omnitrack_sim/Network-v0": "random_network",
}
IDS = tuple(_SCENARIOS)
"""Of the registered environments."""

for _id, _scenario in _SCENARIOS.items():
    if _id not in registry:
        register(
            _id,
            entry_point="omnitrack_sim.gym.env:RobotEnv",
            vector_entry_point="omnitrack_sim.gym.vector:RobotVectorEnv",
            kwargs={"scenario": _scenario},
        )
