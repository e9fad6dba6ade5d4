"""Figures of one run, computed from its trajectory alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.record.trajectory import Trajectory

STALL_SPEED = 0.005
"""Belt speed below which a motor at its limit counts as stalled, m/s."""
Metrics = dict[str, float | list[float] | dict[str, float]]


def summarise(
    trajectory: Trajectory, *, no_load_slip: float, lug_radius: float, torque_limit: float
) -> Metrics:
    """Summary of a run; lists have one entry a module.

    Means are over time, by the trapezoidal rule. Slip counts only where a module touches the wall.

    Args:
        trajectory: the record.
        no_load_slip: m/s, what slip reads in a straight pipe without load; reported beside it.
        lug_radius: m, belt speed over shaft speed.
        torque_limit: N m, of a crawler motor.

    Returns:
        ``slip_ratio_mean`` (of the magnitude), ``slip_distance_m``, ``traction_rms_n``,
        ``normal_force_mean_n``, ``contact_fraction`` (of the time), ``spring_travel_max_m``,
        ``stall_time_s``, ``pitch_max_deg``, ``motor_torque_max_n_m`` (lists of three);
        ``tilt_max_deg``, ``tilt_exit_deg``, ``mean_speed_m_s``, ``distance_m`` (headway along the
        way, the legs added up), ``energy_j`` (mechanical, braking not recovered),
        ``no_load_slip_m_s``, ``phase_time_s``.
    """
    time = trajectory.time
    travelled = _travelled(trajectory)
    duration = float(time[-1] - time[0])
    power = trajectory["motor_torque"] * trajectory["belt_speed"] / lug_radius  # (T, 3) W
    at_limit = np.abs(trajectory["motor_torque"]) >= 0.99 * torque_limit
    stalled = at_limit & (np.abs(trajectory["belt_speed"]) < STALL_SPEED)
    touching = trajectory["contact_count"].sum(axis=-1) > 0
    slide, pitch = trajectory["slide"], trajectory["pitch"]
    return {
        "distance_m": travelled,
        "mean_speed_m_s": travelled / duration if duration > 0 else 0.0,
        "tilt_max_deg": float(np.degrees(trajectory["tilt"].max())),
        "tilt_exit_deg": float(np.degrees(trajectory["tilt"][-1])),
        "energy_j": float(_integral(np.maximum(power, 0.0), time).sum()),
        "no_load_slip_m_s": no_load_slip,
        "slip_ratio_mean": _mean(np.abs(trajectory["slip_ratio"]), time).tolist(),
        "slip_distance_m": _integral(np.abs(trajectory["slip_velocity"]), time).tolist(),
        "traction_rms_n": np.sqrt(_mean(trajectory["traction"] ** 2, time)).tolist(),
        "normal_force_mean_n": _mean(trajectory["normal_force"], time).tolist(),
        "contact_fraction": _mean(touching.astype(float), time).tolist(),
        "spring_travel_max_m": np.abs(slide - slide[0]).max(axis=0).tolist(),
        "pitch_max_deg": np.degrees(np.abs(pitch).max(axis=0)).tolist(),
        "motor_torque_max_n_m": np.abs(trajectory["motor_torque"]).max(axis=0).tolist(),
        "stall_time_s": _integral(stalled.astype(float), time).tolist(),
        "phase_time_s": _phase_times(trajectory),
    }


def _travelled(trajectory: Trajectory) -> float:
    """Headway along the way from beginning to end of each leg, added up, m."""
    distance, leg = trajectory["distance"], trajectory["leg"]
    ends = np.append(np.flatnonzero(np.diff(leg)), len(leg) - 1)
    starts = np.append(0, ends[:-1] + 1)
    return float((distance[ends] - distance[starts]).sum())


def _integral(values: NDArray, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integral over time (...,) of samples (T, ...)."""
    return np.trapezoid(values, time, axis=0)


def _mean(values: NDArray, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over time (...,) of samples (T, ...); the sample itself where there is only one."""
    duration = time[-1] - time[0]
    return _integral(values, time) / duration if duration > 0 else np.asarray(values[0], float)


def _phase_times(trajectory: Trajectory) -> dict[str, float]:
    """Seconds spent in each phase that occurred."""
    times: dict[str, float] = {}
    for name, start, end in trajectory.phase_spans():
        times[name] = times.get(name, 0.0) + end - start
    return times
