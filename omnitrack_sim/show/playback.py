"""Recorded runs as they are shown: poses that are sound, belts where they have run to."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.record.channels import TRACKS
from omnitrack_sim.record.trajectory import Trajectory

if TYPE_CHECKING:
    import mujoco

FARTHEST = 1e5
"""Size of positions, m, and of all that is shown beside them, beyond which a sample is unsound."""


def sound(trajectory: Trajectory) -> Trajectory:
    """The trajectory with the last sound sample in the place of each that physics which has
    diverged left without a pose.

    Raises:
        RenderError: no sample is sound.
    """
    names = ("position", "distance", "tilt", "belt_speed")
    values = [trajectory.qpos, *(trajectory[name] for name in names)]
    far = [np.abs(value.reshape(len(trajectory.time), -1)).max(axis=1) for value in values]
    sound = np.all([distance < FARTHEST for distance in far], axis=0)  # NaN is not less either
    if sound.all():
        return trajectory
    if not sound.any():
        raise RenderError("the run has no pose that can be shown")
    first = int(np.argmax(sound))
    rows = np.maximum.accumulate(np.where(sound, np.arange(len(trajectory.time)), first))
    channels = {name: values[rows] for name, values in trajectory.channels.items()}
    return replace(trajectory, channels=channels, qpos=trajectory.qpos[rows])


def belt_travel(trajectory: Trajectory) -> NDArray[np.float64]:
    """Travel of each belt since the first sample (T, 3), m: the integral of its recorded speed."""
    # Trapezia: the speed is recorded at the ends of each step.
    speed, step = trajectory["belt_speed"], np.diff(trajectory.time)[:, None]
    run = np.cumsum(step * (speed[1:] + speed[:-1]) / 2, axis=0)
    return np.concatenate([np.zeros((1, speed.shape[1])), run])


def smooth_belts(
    model: mujoco.MjModel, trajectory: Trajectory, pitch: float
) -> NDArray[np.float64]:
    """Joint positions (T, nq) with the belts where they have run to: see ``show_belts``."""
    qpos = np.array(trajectory.qpos, float)
    show_belts(model, qpos, belt_travel(trajectory), pitch)
    return qpos


def show_belts(
    model: mujoco.MjModel, qpos: NDArray[np.float64], travel: NDArray[np.float64], pitch: float
) -> None:
    """Put the belts in joint positions (..., nq) where ``travel`` (..., 3) m has brought them,
    within half a visible pitch, m.

    The physics moves its closely spaced lugs back after every pitch; seen 25 times a second they
    would seem to stand still or to run backward.
    """
    shown = (travel + pitch / 2) % pitch - pitch / 2
    for module in range(shown.shape[-1]):
        for track in TRACKS:
            qpos[..., model.joint(f"belt_{track}_{module + 1}").qposadr[0]] = shown[..., module]
