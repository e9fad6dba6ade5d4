"""A controller that gives constant or periodic inputs to any actuators, which a file states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from omnitrack_sim.base.naming import by_pattern
from omnitrack_sim.base.table import Angle, NotNegative, Table, Unit
from omnitrack_sim.robots.control import Actuation, ControlSetup, Observation

MAX_NAMED = 1_000
"""Actuators, or patterns of their names, that a file gives inputs to."""


class Wave(Table):
    """An input over time: offset + amplitude sin(2 pi frequency t + phase)."""

    offset: float = 0.0
    """Mean, in the unit of the input."""
    amplitude: float = 0.0
    """Largest distance from it, in the unit of the input."""
    frequency: Annotated[NotNegative, Unit("Hz")] = 1.0
    phase_deg: Angle = 0.0
    """At time 0, where 0 is the mean with the input rising."""


class Periodic:
    """Constant and periodic inputs, by the names of the actuators; nothing is measured.

    Example:
        >>> inputs = {"wheel_*": 4.0, "tail": {"amplitude": 0.3, "frequency": 2.0}}
        >>> ot.Periodic.Parameters(inputs=inputs).inputs["tail"].phase_deg
        0.0
    """

    class Parameters(Table):
        """Inputs of the robot's actuators over time."""

        inputs: Annotated[dict[str, float | Wave], Field(max_length=MAX_NAMED)] = Field(
            default_factory=dict
        )
        """By the name of an actuator, or a pattern such as "wheel_*": a number, or a table with
        offset, amplitude, frequency and phase_deg. Others stay as they are at the start."""
        ramp: Annotated[NotNegative, Unit("s")] = 0.5
        """Time over which the inputs rise from those of the start: servos that are asked for full
        speed at once throw a robot."""

    def __init__(self, setup: ControlSetup) -> None:
        names = setup.robot.channels["ctrl"].names
        waves = [_waves(each.inputs, names) for each in setup.parameters]
        start = setup.command.ctrl  # (n, nu)
        given = np.array([[wave is not None for wave in row] for row in waves], bool)
        rows = [
            [_numbers(wave, own) for wave, own in zip(row, before, strict=True)]
            for row, before in zip(waves, start.tolist(), strict=True)
        ]
        numbers = np.array(rows, float).reshape(*start.shape, 4)
        self._offset, self._amplitude, self._rate, self._phase = np.moveaxis(numbers, -1, 0)
        self._start, self._given, self._ramp = start, given, setup.each("ramp")

    def step(self, observation: Observation) -> Actuation:
        """Return the inputs at this moment."""
        time = observation.time[:, None]  # (n, 1) s
        inputs = self._offset + self._amplitude * np.sin(self._rate * time + self._phase)
        share = np.clip(time / np.maximum(self._ramp, 1e-9)[:, None], 0.0, 1.0)
        risen = self._start + share * (inputs - self._start)
        return Actuation(np.where(self._given, risen, self._start))


def _waves(inputs: Mapping[str, float | Wave], names: Sequence[str]) -> list[Wave | None]:
    """Return the wave of each actuator, None of those without one."""
    found: dict[str, Any] = by_pattern(inputs, names, "control.parameters.inputs")
    given = {n: w if isinstance(w, Wave) else Wave(offset=w) for n, w in found.items()}
    return [given.get(name) for name in names]


def _numbers(wave: Wave | None, own: float) -> tuple[float, float, float, float]:
    """Return offset, amplitude, angular frequency, rad/s, and phase, rad, of an input."""
    if wave is None:
        return own, 0.0, 0.0, 0.0
    rate, phase = 2 * math.pi * wave.frequency, math.radians(wave.phase_deg)
    return wave.offset, wave.amplitude, rate, phase
