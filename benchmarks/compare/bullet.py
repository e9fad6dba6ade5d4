"""The same robot in PyBullet, in a pipe whose wall is one concave triangle mesh.

What differs from the robot in MuJoCo, because Bullet has no armature, no tied joints and no soft
contacts of that kind:

* No reflected rotor inertia of crawler and rotary motors: as the mass of a link it would add
  weight.
* Belts are velocity motors that correct ``BulletSettings.servo`` of the error in a step, within the
  drive's force limits. The two runs of a chain are not tied: each has a motor of its own.
* Rotary motors are position motors with the time constant of the servo (kv / kp).
* Springs and dampers are joint forces, held for a step.
* Arms slide on a link of their own of ``SLIDER_MASS``.
* Contacts are Bullet's: error reduction and Coulomb friction by projected Gauss-Seidel.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bullet_plant import BulletPlant, contacts_per_lug, make_bullet_plant
from bullet_walls import BulletSettings

from omnitrack_sim import Scenario
from omnitrack_sim.sim.simulation import Simulation

sys.path.insert(0, str(Path(__file__).parents[1]))

from shares import timed

JOBS = ("straight", "elbow_short", "tee_turn")


@dataclass(frozen=True)
class Drive:
    """One job at one setting."""

    outcome: str
    reason: str
    duration_s: float
    speed: float  # simulated s per wall s, stepping only: engine, springs, motors
    speed_engine: float  # simulated s per wall s in stepSimulation
    speed_all: float  # simulated s per wall s with control and recording
    step_us: float  # microseconds a stepSimulation
    contacts_per_lug: float
    exit_tilt_deg: float
    build_s: float


def drive(scenario: Scenario, settings: BulletSettings) -> Drive:
    """Run a scenario at a setting."""
    simulation = Simulation([scenario], make_plant=make_bullet_plant(settings))
    plant: BulletPlant = simulation.plant  # type: ignore[assignment]
    contacts: list[float] = []
    inner = plant.step

    def watched(*given) -> None:  # type: ignore[no-untyped-def]
        inner(*given)
        if plant.engine_steps % 50 == 0:
            spent = time.perf_counter()
            contacts.append(contacts_per_lug(plant))
            watched.spent += time.perf_counter() - spent  # type: ignore[attr-defined]

    watched.spent = 0.0  # type: ignore[attr-defined]
    plant.step = watched  # type: ignore[method-assign]
    shares, spent = timed(simulation), watched.spent  # type: ignore[attr-defined]
    duration = float(simulation.end_time[0])
    (trajectory,) = simulation.recorder.trajectories(simulation.end_time)
    (ending,) = simulation.endings
    assert ending is not None
    result = Drive(
        outcome=ending.outcome.value,
        reason=ending.reason,
        duration_s=duration,
        speed=duration / (shares.physics - spent),
        speed_engine=duration / plant.engine_seconds,
        speed_all=duration / (shares.physics - spent + shares.control + shares.recording),
        step_us=1e6 * plant.engine_seconds / max(plant.engine_steps, 1),
        contacts_per_lug=float(np.nanmean(contacts)) if contacts else math.nan,
        exit_tilt_deg=float(np.degrees(trajectory["tilt"][-1])),
        build_s=plant.build_seconds,
    )
    plant.close()
    return result
