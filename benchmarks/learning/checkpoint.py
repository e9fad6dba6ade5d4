"""What a training that was killed goes on from."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from omnitrack_sim.base.writing import write_file


def save(path: Path, model: PPO, normalise: VecNormalize, progress: dict[str, Any]) -> None:
    """Write a checkpoint, whole or not at all. ``progress``: numbers, words and lists of them."""
    state = {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "observations": _of(normalise.obs_rms),
        "returns": _of(normalise.ret_rms),
        "decisions": model.num_timesteps,
        "random": torch.get_rng_state(),
        "progress": progress,
    }
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_file(path, buffer.getvalue())


def load(path: Path, model: PPO, normalise: VecNormalize) -> dict[str, Any]:
    """Bring model and normalisation to where they were; the progress that was saved."""
    state = torch.load(path, weights_only=True)
    model.policy.load_state_dict(state["policy"])
    model.policy.optimizer.load_state_dict(state["optimizer"])
    _bring(normalise.obs_rms, state["observations"])
    _bring(normalise.ret_rms, state["returns"])
    model.num_timesteps = state["decisions"]
    torch.set_rng_state(state["random"])
    return state["progress"]


def _of(rms: RunningMeanStd) -> dict[str, Any]:
    mean, var = torch.from_numpy(np.array(rms.mean)), torch.from_numpy(np.array(rms.var))
    return {"mean": mean, "var": var, "count": float(rms.count)}


def _bring(rms: RunningMeanStd, state: dict[str, Any]) -> None:
    rms.mean, rms.var = state["mean"].numpy(), state["var"].numpy()
    rms.count = state["count"]
