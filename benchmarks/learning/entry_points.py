"""Other learners' entry points, each with the environments as they come.

python benchmarks/learning/entry_points.py [--steps N]

PPO and SAC of stable-baselines3, a loop as CleanRL writes it, and two wrappers of Gymnasium drive
tee turns for some hundred decisions of each robot. Printed is a table: what each did, and how long
it took. Episodes are cut to 2 s, so that each sees many ends of them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from torch import nn

import omnitrack_sim.gym  # noqa: F401  registers the environments

ID = "omnitrack_sim/TeeTurn-v0"
BRIEF = {"sensing": "truth", "changes": {"run.time_limit": 2.0}}
ROBOTS, ROLLOUT, GAMMA, EPOCHS, CLIP = 8, 32, 0.99, 4, 0.2
AHEAD = np.float32([0.5, 0.5, 0.5, 0.0])


def ppo(steps: int) -> str:
    """PPO of stable-baselines3 on the single environment."""
    model = PPO("MlpPolicy", gymnasium.make(ID, **BRIEF), n_steps=128, seed=1, device="cpu")
    return _learned(model.learn(steps))


def sac(steps: int) -> str:
    """SAC of stable-baselines3 on the single environment."""
    model = SAC("MlpPolicy", gymnasium.make(ID, **BRIEF), seed=1, learning_starts=50, device="cpu")
    return _learned(model.learn(steps))


def _learned(model: PPO | SAC) -> str:
    mean, _ = evaluate_policy(model, model.get_env(), n_eval_episodes=2)
    ended = len(model.ep_info_buffer or ())
    return f"{model.num_timesteps} decisions, {ended} episodes; return then {mean:.2f}"


def cleanrl(steps: int) -> str:
    """Train by PPO in one loop over the native vector environment, as CleanRL writes it.

    In the mode NextStep the decision after an episode's end only begins the next one, and is left
    out.
    """
    torch.manual_seed(1)
    envs = RecordEpisodeStatistics(gymnasium.make_vec(ID, num_envs=ROBOTS, **BRIEF))
    size = envs.single_observation_space.shape[0]
    actor = nn.Sequential(nn.Linear(size, 32), nn.Tanh(), nn.Linear(32, 4))
    critic = nn.Sequential(nn.Linear(size, 32), nn.Tanh(), nn.Linear(32, 1))
    spread = nn.Parameter(torch.full((4,), -1.0))
    adam = torch.optim.Adam([*actor.parameters(), *critic.parameters(), spread], 1e-3)

    def chances(seen: torch.Tensor) -> torch.distributions.Normal:
        return torch.distributions.Normal(actor(seen), spread.exp())

    seen, _ = envs.reset(seed=1)
    begun, episodes, counted, loss = np.zeros(ROBOTS, bool), 0, 0, torch.zeros(())
    for _ in range(max(1, steps // ROLLOUT)):
        kept = []
        for _ in range(ROLLOUT):
            before = torch.from_numpy(seen)
            with torch.no_grad():
                actions = chances(before).sample()
                chance = chances(before).log_prob(actions).sum(1)
            seen, reward, terminated, truncated, infos = envs.step(actions.clamp(-1, 1).numpy())
            with torch.no_grad():
                after = critic(torch.from_numpy(seen))[:, 0]
            target = torch.as_tensor(
                reward, dtype=torch.float32
            ) + GAMMA * after * ~torch.as_tensor(terminated)
            own = torch.from_numpy(~begun)
            kept.append((before[own], actions[own], chance[own], target[own]))
            begun = terminated | truncated
            episodes += int(np.count_nonzero(infos["_episode"])) if "episode" in infos else 0
        before, actions, chance, target = (torch.cat(each) for each in zip(*kept, strict=True))
        counted += len(before)
        for _ in range(EPOCHS):
            value = critic(before)[:, 0]
            gain = (target - value).detach()
            ratio = (chances(before).log_prob(actions).sum(1) - chance).exp()
            kept_near = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain)
            loss = ((target - value) ** 2).mean() - kept_near.mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
    return f"{counted} decisions, {episodes} episodes; loss then {loss.item():.2f}"


def statistics(steps: int) -> str:
    """``RecordEpisodeStatistics`` on the native vector environment."""
    envs = RecordEpisodeStatistics(gymnasium.make_vec(ID, num_envs=ROBOTS, **BRIEF))
    envs.reset(seed=1)
    returns: list[float] = []
    for _ in range(steps):
        *_, infos = envs.step(np.tile(AHEAD, (ROBOTS, 1)))
        if "episode" in infos:
            returns += infos["episode"]["r"][infos["_episode"]].tolist()
    return f"{len(returns)} episodes; mean return {np.mean(returns):.2f}"


def video(steps: int) -> str:
    """``RecordVideo`` on the single environment."""
    with TemporaryDirectory() as folder:
        env = gymnasium.make(ID, render_mode="rgb_array", width=320, height=192, **BRIEF)
        env = RecordVideo(env, f"{folder}/films", episode_trigger=lambda episode: episode == 0)
        env.reset(seed=1)
        for _ in range(min(steps, 60)):
            *_, terminated, truncated, _ = env.step(AHEAD)
            if terminated or truncated:
                env.reset()
        env.close()
        files = sorted(Path(folder).glob("films/*.mp4"))
        return f"{len(files)} film, {sum(file.stat().st_size for file in files) / 1e3:.0f} kB"


ENTRIES: Mapping[str, Callable[[int], str]] = {
    "stable-baselines3 PPO": ppo,
    "stable-baselines3 SAC": sac,
    "CleanRL-style loop": cleanrl,
    "RecordEpisodeStatistics": statistics,
    "RecordVideo": video,
}


def main() -> None:
    """Try all learners."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=256, help="decisions of each robot")
    steps = parser.parse_args().steps
    torch.set_num_threads(1)
    print("| entry point | did | took, s |\n|---|---|---|", flush=True)
    for name, entry in ENTRIES.items():
        begin = time.monotonic()
        told = entry(steps)
        print(f"| {name} | {told} | {time.monotonic() - begin:.0f} |", flush=True)


if __name__ == "__main__":
    main()
