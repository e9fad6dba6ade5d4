"""What a run costs beyond MuJoCo's own steps, alone and as one of a batch.

python benchmarks/overhead.py [--batch N] [--repeats K] [--primitives]

One job, the dry tee turn with exact walls, is done three ways on one thread: by bare ``mj_step``
on the states and controls of the run, which is the floor; as a run of its own; and as one of a
batch of N equal ones. Printed are microseconds a physics step and robot, the least of K repeats,
and the ratios. Before that it is checked that all three end in the same state, to the bit.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim import Scenario, Simulation, load_scenario, override

VARYING = ("geom_contype", "geom_conaffinity", "body_contype", "body_conaffinity")
"""Fields of the model that the plant changes while it runs."""
GIVEN = ("geom_friction", "tendon_lengthspring", "actuator_forcerange")
"""Fields of the model that differ between the robots of a batch."""


@dataclass
class Tape:
    """What a run hands to the physics at each control step.

    Attributes:
        model: compiled, as the run has it. substeps: physics steps a control step.
        start: (nq,) joint positions. steps: for each control step the joint positions, controls,
            and fields of the model.
        end: (nq,) joint positions of the last one.
    """

    model: mujoco.MjModel
    substeps: int
    steps: list[dict[str, NDArray]] = field(default_factory=list)
    end: NDArray = field(default_factory=lambda: np.zeros(0))


def taped(scenario: Scenario) -> Tape:
    """Run a scenario and keep what its physics was given."""
    simulation = Simulation([scenario])
    plant, inner = simulation.plant, simulation.plant._batch
    substeps = round(simulation.period / scenario.physics.timestep)
    tape = Tape(plant.model, substeps)
    expanded = {name: inner.expand(name) for name in (*VARYING, *GIVEN)}
    bound = {name: inner.bind(name) for name in ("qpos", "qvel", "ctrl")}
    stepping = inner.step

    def keep(*given: object, **more: object) -> None:
        arrays = {**expanded, **bound}
        tape.steps.append({name: array[0].copy() for name, array in arrays.items()})
        stepping(*given, **more)

    inner.step = keep  # type: ignore[method-assign]
    simulation.advance()
    tape.end = plant.qpos[0].copy()
    return tape


def replayed(tape: Tape) -> tuple[float, NDArray]:
    """Seconds of bare ``mj_step`` over a tape, and the joint positions at its end."""
    model, spent = tape.model, 0.0
    data = mujoco.MjData(model)
    for given in tape.steps:
        for name in (*VARYING, *GIVEN):
            getattr(model, name)[:] = given[name].reshape(getattr(model, name).shape)
        data.qpos[:], data.ctrl[:] = given["qpos"], given["ctrl"]
        begin = time.perf_counter()
        mujoco.mj_step(model, data, tape.substeps)
        spent += time.perf_counter() - begin
    return spent, data.qpos.copy()


def run(scenario: Scenario, n: int) -> tuple[float, NDArray]:
    """Seconds of the loop of n equal robots on one thread, and the last one's joint positions."""
    simulation = Simulation([scenario] * n)
    begin = time.perf_counter()
    simulation.advance()
    return time.perf_counter() - begin, simulation.plant.qpos[-1].copy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batch", type=int, default=96)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--primitives", action="store_true", help="walls of boxes")
    options = parser.parse_args()
    collider = "primitives" if options.primitives else "exact"
    scenario = override(load_scenario("tee_turn"), {"physics.collider": collider})
    tape = taped(scenario)
    steps = len(tape.steps) * tape.substeps
    least = dict.fromkeys(("bare", "alone", "batch"), float("inf"))
    for _ in range(options.repeats):
        for name, (seconds, end), share in (
            ("bare", replayed(tape), 1),
            ("alone", run(scenario, 1), 1),
            ("batch", run(scenario, options.batch), options.batch),
        ):
            assert np.array_equal(end, tape.end), f"{name} ends elsewhere"
            least[name] = min(least[name], 1e6 * seconds / steps / share)
    print(f"tee turn, {collider} walls, {steps} physics steps, microseconds a step and robot")
    print(f"bare mj_step      {least['bare']:7.1f}")
    print(f"one run           {least['alone']:7.1f}")
    print(f"one of {options.batch:<4d}       {least['batch']:7.1f}")
    print(f"one run over one of {options.batch}: {least['alone'] / least['batch']:.2f}")
    print(f"bare mj_step over one of {options.batch}: {100 * least['bare'] / least['batch']:.0f} %")


if __name__ == "__main__":
    main()
