"""What takes the time of a simulation: physics, recording, and the rest, which is control."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from omnitrack_sim.sim.simulation import Progress, Simulation


@dataclass
class Shares:
    """Seconds of a simulation by what took them; control includes sensors and monitor."""

    physics: float = 0.0
    control: float = 0.0
    recording: float = 0.0


def timed(
    simulation: Simulation,
    steps: int | None = None,
    *,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
    into: Shares | None = None,
) -> Shares:
    """Run a simulation for ``steps`` control steps, or to its end, and say what took the time.

    Args:
        simulation: its plant and recorder are watched while it runs.
        steps: of control; none: to the end.
        progress: called now and then, when it runs to the end.
        clock: s.
        into: where the seconds are added up; whoever passes it has them even where the run is
            broken off.
    """
    shares = Shares() if into is None else into
    plant, recorder = simulation.plant, simulation.recorder

    def watched(call: Callable[..., Any], name: str) -> Callable[..., Any]:
        def measured(*given: Any) -> Any:
            begin = clock()
            answer = call(*given)
            setattr(shares, name, getattr(shares, name) + clock() - begin)
            return answer

        return measured

    plain = plant.step, recorder.sample
    before = shares.physics + shares.recording
    plant.step, recorder.sample = watched(plain[0], "physics"), watched(plain[1], "recording")
    begin = clock()
    try:
        if steps is None:
            simulation.advance(progress)
        else:
            for _ in range(steps):
                simulation.step()
    finally:
        shares.control += clock() - begin - (shares.physics + shares.recording - before)
        plant.step, recorder.sample = plain
    return shares
