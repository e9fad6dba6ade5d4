"""Conversion of the trainer's network to a policy."""

from __future__ import annotations

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

import omnitrack_sim as ot
from omnitrack_sim.robots.feature import FloatRows
from omnitrack_sim.robots.omnitrack.policy.file import ACTINGS, Mlp

NEARNESS = 1e-6
"""By which the policy's actions may differ from those of the trainer's network."""


def network_of(model: PPO, normalise: VecNormalize) -> Mlp:
    """The mean of the trainer's actions as a network in NumPy."""
    layers = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    rms = normalise.obs_rms
    return Mlp(
        weights=[layer.weight.detach().numpy().T for layer in linear],
        biases=[layer.bias.detach().numpy() for layer in linear],
        mean=rms.mean,
        std=np.sqrt(rms.var + normalise.epsilon),
        reach=normalise.clip_obs,
        activation="tanh",
        output="clip",
    )


def policy_of(
    model: PPO, normalise: VecNormalize, observation: str, acting: str, note: str
) -> ot.Policy:
    """Return the policy that a file holds."""
    return ot.Policy(network_of(model, normalise), [observation], ACTINGS[acting], note)


def difference(policy: ot.Policy, model: PPO, normalise: VecNormalize, entries: FloatRows) -> float:
    """Largest difference between the actions (n, 4) of policy and trainer for entries (n, k).

    The trainer's network is evaluated in double precision: in single precision its own sums are
    rounded by up to 1e-6.
    """
    rms = normalise.obs_rms
    seen = (entries.astype(float) - rms.mean) / np.sqrt(rms.var + normalise.epsilon)
    given = torch.from_numpy(np.clip(seen, -normalise.clip_obs, normalise.clip_obs))
    trained = model.policy
    with torch.no_grad():
        trained.double()
        actions = trained.action_net(trained.mlp_extractor.forward_actor(given)).numpy()
        trained.float()
    return float(np.abs(policy(entries) - np.clip(actions, -1, 1)).max())
