"""Environments of Gymnasium for learned controllers (extra ``gym``).

``import omnitrack_sim.gym`` registers them; ``gymnasium.make("omnitrack_sim/TeeTurn-v0")`` makes
that of one robot, ``gymnasium.make_vec`` that of many on one batch. ``Any-v0`` is for
``scenario="..."`` of any robot. docs/how-to/gym.md lists
observations, actions, reward and options.
"""

try:
    from gymnasium.envs.registration import register, registry
except ImportError as error:
    from omnitrack_sim.base.text import installing

    text = f"omnitrack_sim.gym needs Gymnasium: {installing('gym')}"
    raise ImportError(f"{text} ({error})") from error

from omnitrack_sim.gym.env import RobotEnv, RobotVectorEnv
from omnitrack_sim.gym.options import TERMS

__all__ = ["IDS", "TERMS", "RobotEnv", "RobotVectorEnv"]

_SCENARIOS = {
    "omnitrack_sim/TeeTurn-v0": "tee_turn",
    "omnitrack_sim/TeeMerge-v0": "tee_merge",
    "omnitrack_sim/Elbow-v0": "elbow",
    "omnitrack_sim/Straight-v0": "straight",
    "omnitrack_sim/Network-v0": "random_network",
    "omnitrack_sim/Any-v0": "straight",
}
IDS = tuple(_SCENARIOS)
"""Of the registered environments."""

for _id, _scenario in _SCENARIOS.items():
    if _id not in registry:
        register(
            _id,
            entry_point="omnitrack_sim.gym.env:RobotEnv",
            vector_entry_point="omnitrack_sim.gym.env:RobotVectorEnv",
            kwargs={"scenario": _scenario},
        )
