"""Tee turns in which the default controller's commands are corrected while it turns.

The physics is deterministic and has no way back. So robots are driven to just before their turn
once, and every set of corrections goes on from there in a copy of the process (``go_on``).
"""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim import Command, Observation, Outcome, Scenario, Simulation
from omnitrack_sim.base.rotations import Array, angle_between
from omnitrack_sim.robots.omnitrack.control import ControlSetup, JacobianController
from omnitrack_sim.robots.omnitrack.control.jacobian import TEE_TURN

KNOTS = 10
TRAVEL = 0.04
"""Corrections are linear in time between knots, which are as far apart as a robot takes for so many
metres at the speed of its turn."""
HANDED_BACK_DEG = 10.0
"""Angle between the robot's axis and the branch's from which on the default controller drives
alone again."""


class Turn(NamedTuple):
    """The tee turn of a scenario.

    Attributes:
        way_in, way_out: (3,) directions of run and branch.
        mouth: (3,) m, where the route's arc ends in the branch. radius: m, of the run.
    """

    way_in: Array
    way_out: Array
    mouth: Array
    radius: float

    @classmethod
    def of(cls, scenario: Scenario) -> Turn:
        """The first tee turn on a scenario's way."""
        passage = next(p for p in scenario.route.passages if p.description.into_branch)
        line = scenario.route.centreline
        places, tangents, *_ = line.at(np.array([0.0, passage.s_bend_end]))
        return cls(
            way_in=tangents[0],
            way_out=tangents[1],
            mouth=places[1],
            radius=passage.radius,
        )

    def left(self, position: Array, rotation: Array) -> Array:
        """How far robots (n,) are from having turned: radii to the mouth plus right angles."""
        away = np.linalg.norm(position - self.mouth, axis=1) / self.radius
        return away + angle_between(rotation[:, :, 2], self.way_out) / (np.pi / 2)


class Steered(JacobianController):
    """The default controller, corrected for the time of a turn.

    Attributes:
        knots: (n, KNOTS, 3) m/s, added to the modules' wall speeds, the first where a turn begins.
        begun: (n,) s, when the turn began; not a number before.
        spacing: (n,) s between two knots.
    """

    def __init__(self, setup: ControlSetup) -> None:
        super().__init__(setup)
        self.begun, self.spacing = np.full(setup.n, np.nan), np.ones(setup.n)
        self.handed_back = np.zeros(setup.n, bool)
        self.knots = np.zeros((setup.n, KNOTS, 3))
        way = setup.routes.route_of[:1]
        self._way_out = setup.routes.centreline.at(setup.routes.lengths[way], way)[1]
        self._in_turn = setup.each("tracking.turn_speed")

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        command = super().step(observation)
        begins = np.isnan(self.begun) & (command.phase == TEE_TURN)
        self.begun = np.where(begins, observation.time, self.begun)
        speed = self._in_turn * self.speed_inside[observation.location.passage, range(len(begins))]
        self.spacing = np.where(begins, TRAVEL / speed, self.spacing)
        off = angle_between(observation.rotation[:, :, 2], self._way_out)
        self.handed_back |= off < np.radians(HANDED_BACK_DEG)
        since = (observation.time - self.begun) / self.spacing
        steered = (since < KNOTS - 1) & ~self.handed_back
        sign = self.aligner.rolls.belt_sign(observation.roll)
        speed = command.belt_speed * sign + between(self.knots, np.nan_to_num(since))
        limit = self.settings.speed_limit[:, None]
        belt_speed = np.where(
            steered[:, None], np.clip(speed, -limit, limit) * sign, command.belt_speed
        )
        return command._replace(belt_speed=belt_speed)


def between(knots: Array, at: Array) -> Array:
    """Values (n, 3) of ``knots`` (n, K, 3), linear between them, at ``at`` (n,) spacings."""
    first = np.clip(at.astype(int), 0, knots.shape[1] - 2)
    part = np.clip(at - first, 0.0, 1.0)[:, None]
    rows = np.arange(len(at))
    return (1 - part) * knots[rows, first] + part * knots[rows, first + 1]


class Tried(NamedTuple):
    """What came of n robots.

    Attributes:
        passed: (n,) bool. loss: (n,) least that was left of the turn, see ``Turn.left``; -1 where
            it passed.
        begun: (n,) s, when the turn began; not a number where it did not.
        belt_speed: (T, n, 3) m/s, asked of the belts. roll: (T, n, 3) rad, asked of the modules.
    """

    passed: NDArray[np.bool_]
    loss: Array
    begun: Array
    belt_speed: Array
    roll: Array


def steered(sim: Simulation) -> Steered:
    """The controller of a simulation of steered robots."""
    assert isinstance(sim.controller, Steered)
    return sim.controller


def ready(scenarios: Sequence[Scenario], until: float = 0.0) -> Simulation:
    """Steered robots under the default controller's commands, driven up to ``until`` s."""
    sim = Simulation(scenarios, controller=Steered)
    while sim.time[0] < until - sim.period / 2:
        sim.step()
    return sim


def passed(sim: Simulation) -> NDArray[np.bool_]:
    """Which robots (n,) have reached their goal."""
    ends = [ending is not None and ending.outcome for ending in sim.endings]
    return np.array([outcome is Outcome.REACHED_GOAL for outcome in ends])


def finish(sim: Simulation, knots: Array | None = None) -> Tried:
    """Drive on, corrected by ``knots`` (n, KNOTS, 3) if there are such, to the end."""
    controller = steered(sim)
    if knots is not None:
        controller.knots = knots
    turn, commands = Turn.of(sim.scenarios[0]), []
    loss = np.full(sim.n, np.inf)
    while sim.active.any():
        running, command = sim.active, controller.step(sim.observation)
        sim.step(command)
        commands.append((command.belt_speed, command.roll))
        left = turn.left(sim.observation.position, sim.observation.rotation)
        loss = np.where(running, np.minimum(loss, left), loss)
    through = passed(sim)
    belt_speed, roll = map(np.array, zip(*commands, strict=True))
    return Tried(through, np.where(through, -1.0, loss), controller.begun, belt_speed, roll)


def go_on(sim: Simulation, knots: Array) -> Tried:
    """``finish`` in a copy of this process: ``sim`` stays where it is."""
    fork = get_context("fork")
    here, there = fork.Pipe(duplex=False)
    copy = fork.Process(target=lambda: there.send(finish(sim, knots)))
    copy.start()
    there.close()
    try:
        return here.recv()
    except EOFError:
        raise RuntimeError("the copy of the process ended without an answer") from None
    finally:
        copy.join()


def replay(scenario: Scenario, belt_speed: Array, roll: Array) -> bool:
    """Whether a robot passes that is told commands (T, 3) one after the other, unseen.

    Args:
        scenario: of the robot.
        belt_speed: m/s.
        roll: rad.
    """
    sim = Simulation([scenario])
    for speed, angle in zip(belt_speed, roll, strict=True):
        if sim.active.any():
            sim.step(Command(speed[None], angle[None]))
    return bool(passed(sim)[0])
