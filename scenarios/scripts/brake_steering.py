"""One motor, a differential and a brake on each of its outputs: a controller of a user's own that
steers through a tee with the brakes. Four drives on the same turn in one go.

Run: python scenarios/scripts/brake_steering.py
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack.control.jacobian import (
    DampingTable,
    FeedbackTable,
    JacobianController,
)

BRAKES = {"robot.drive": "differential", "robot.brake_force": 60.0}
DRIVES = {
    "three motors": {},
    "differential": {"robot.drive": "differential"},
    "differential, gear friction 0.3": {"robot.drive": "differential", "robot.gear_friction": 0.3},
    "differential, brakes": BRAKES,
}


class BrakeSteering:
    """Asks for the belt speeds that the default controller would give three motors, and brakes each
    belt that runs faster than asked.

    The motor holds the mean of the speeds. What a brake takes from a belt that is too fast goes to
    the others: the inner module of a turn is slowed, and one that has lost its wall does not race.
    """

    phases = JacobianController.phases

    class Parameters(FeedbackTable):
        """``[control.parameters]``: those of the default controller, and the brakes' gain."""

        # Chosen on turns of its own: with twice as much it swings (docs/studies/differential.md).
        damping: DampingTable = DampingTable(tee_turn=2.5)
        brake_gain: float = Field(10.0, ge=0)  # part of the brake's force for each m/s too fast

    def __init__(self, setup: ot.ControlSetup) -> None:
        three = setup.robot.model_copy(update={"drive": "three_motors"})
        self.steering = JacobianController(replace(setup, robot=three))
        self.gain = setup.each("brake_gain")[:, None]

    def step(self, observation: ot.Observation) -> ot.Command:
        command = self.steering.step(observation)
        forward = np.sign(np.cos(observation.roll))  # (n, 3): which way the belts drive forward
        asked = command.belt_speed * forward
        way = np.sign(asked.mean(axis=1, keepdims=True))  # (n, 1): -1 while backing off
        too_fast = way * (observation.belt_speed * forward - asked)
        return command._replace(brake=np.clip(self.gain * too_fast, 0.0, 1.0))


def main() -> None:
    base = ot.load_scenario("tee_turn")
    print("drive                            outcome              time, s  energy, J  slip, mm")
    for name, changes in DRIVES.items():
        scenario = ot.override(base, {"control.retry": False, **changes})
        controller = BrakeSteering if changes is BRAKES else None
        result = ot.run(scenario, controller=controller)
        slip = 1000 * sum(result.metrics["slip_distance_m"])
        print(
            f"{name:32s} {result.outcome.value:20s} {result.duration_s:7.1f}  "
            f"{result.metrics['energy_j']:9.1f}  {slip:8.0f}"
        )


if __name__ == "__main__":
    main()
