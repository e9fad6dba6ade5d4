"""Runs scenarios. One run is a batch of one; trials that share a model share a batch."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control import CONTROLLERS, Observation
from omnitrack_sim.control.gear import carried_out, heading, seen
from omnitrack_sim.control.guide import Guide, Place
from omnitrack_sim.model.collider import why_not
from omnitrack_sim.record.metrics import summarise
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.robot.drive import Drive
from omnitrack_sim.rotations import Array
from omnitrack_sim.scenario import Scenario, model_key
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.monitor import Monitor
from omnitrack_sim.sim.plant import Plant, Readings, Trials
from omnitrack_sim.sim.recorder import Recorder
from omnitrack_sim.sim.result import Result, provenance_of
from omnitrack_sim.sim.setup import scene_of, settings_of, trials_of, uses_exact_collider

Progress = Callable[[float, str], None]
"""Called with the part done, 0 to 1, and a word about the run."""
MakePlant = Callable[[Scenario, Trials, int], Plant]
"""Makes a plant from the first scenario of a batch, the start values of all, and the number of
threads."""


def run(scenario: Scenario, *, threads: int = 1, progress: Progress | None = None) -> Result:
    """Run one scenario to its end. A robot that fails is a result, not an error."""
    return run_batch([scenario], threads=threads, progress=progress)[0]


def run_batch(
    scenarios: Sequence[Scenario],
    *,
    threads: int = 0,
    progress: Progress | None = None,
    no_load: bool = True,
) -> list[Result]:
    """Run scenarios, those that share a model in one batch; results in the order of ``scenarios``.

    Args:
        scenarios: any number.
        threads: native threads for the physics; 0 uses all cores. The results do not depend on it.
        progress: see ``Progress``.
        no_load: also measure the slip without load, by a short run for each robot, friction and
            speed; without it ``no_load_slip_m_s`` is not a number.
    """
    groups: dict[str, list[int]] = defaultdict(list)
    for index, scenario in enumerate(scenarios):
        groups[batch_key(scenario.model_dump())].append(index)
    results: dict[int, Result] = {}
    for indices in groups.values():
        done = len(results) / len(scenarios)
        share = len(indices) / len(scenarios)
        report = (
            None
            if progress is None
            else (lambda part, text, d=done, s=share: progress(d + s * part, text))
        )
        batch = BatchRun([scenarios[i] for i in indices], threads)
        batch.advance(report)
        results.update(zip(indices, batch.results(no_load), strict=True))
    return [results[i] for i in range(len(scenarios))]


def batch_key(data: Mapping[str, Any]) -> str:
    """What trials must share to run in one batch: the model, the route, the controller and the
    clock.

    Args:
        data: a scenario as plain data with every key. It need not be valid, and no route is built.
    """
    physics, control = data["physics"], data["control"]
    clock = [physics["control_period"], physics["record_period"]]
    return json.dumps(
        [
            model_key(data),
            control["kind"],
            control["tee_turn_radius"],
            control["tee_merge_radius"],
            clock,
        ]
    )


def _own_plant(scenario: Scenario, trials: Trials, threads: int) -> Plant:
    return Plant(scene_of(scenario).compile(), scenario.robot, trials, threads)


@dataclass
class Shares:
    """Wall seconds of a batch by what took them; filled when ``BatchRun.advance`` is given a
    clock."""

    physics: float = 0.0
    control: float = 0.0
    recording: float = 0.0


class BatchRun:
    """n trials of one model in closed loop."""

    def __init__(
        self, scenarios: Sequence[Scenario], threads: int = 1, make_plant: MakePlant | None = None
    ):
        """``make_plant`` puts another plant in the place of the scenarios' own: other walls,
        another engine."""
        first = scenarios[0]
        self.scenarios = scenarios
        self.period = first.physics.control_period
        self.substeps = max(1, round(self.period / first.physics.timestep))
        self.record_every = max(1, round(first.physics.record_period / self.period))
        start = np.array([s.start.distance for s in scenarios])
        self.legs = Legs(scenarios)
        self.guide = Guide(self.legs.routes, self.legs.way, start)
        trials = trials_of(scenarios, self.guide)
        self.settings, self.notes = settings_of(scenarios, self.guide)
        self.collider = "exact" if uses_exact_collider(first) else "primitives"
        if self.collider != first.physics.collider:
            text = f"exact collider not used: {why_not()}; walls and tracks are primitives"
            self.notes = [text if note is None else f"{note}; {text}" for note in self.notes]
        self.plant = (make_plant or _own_plant)(first, trials, threads)
        limits = [s.robot.crawler_motor.torque_limit for s in scenarios]
        self.drive = Drive(first.robot.motor, limits, first.robot.lug_radius, len(scenarios))
        self.controller = CONTROLLERS[first.control.kind](
            self.guide, first.robot, self.settings, trials.roll, self.period
        )
        self.monitor = Monitor(
            self.guide,
            first.robot,
            self.legs.end,
            start,
            self.settings.cruise_speed,
            np.array([s.time_limit_s for s in scenarios]),
            self.period,
            self._sends_on,
        )
        self.recorder = Recorder(self.controller.phases)
        self.belt_command = np.zeros((len(scenarios), 3))
        self.roll_command = trials.roll.copy()
        self.phase = np.zeros(len(scenarios), int)
        self.shares = Shares()

    def advance(
        self, progress: Progress | None = None, clock: Callable[[], float] = lambda: 0.0
    ) -> None:
        """Run all trials to their ends. ``clock`` (s) measures ``shares``."""
        tick = 0
        while True:
            t0 = clock()
            readings = self.plant.read()
            place = self._locate(readings)
            if self._judge(readings, place):
                place = self._locate(readings)
            active = self.monitor.active
            t1 = clock()
            recorded = tick % self.record_every == 0 or len(active) == 0
            if recorded:
                self._record(readings, place)
            t2 = clock()
            self.shares.control += t1 - t0
            self.shares.recording += t2 - t1
            if len(active) == 0:
                return
            drive = self._command(readings, place, active)
            t3 = clock()
            self.plant.step(active, drive, self.roll_command, self.substeps)
            self.shares.control += t3 - t2
            self.shares.physics += clock() - t3
            tick += 1
            if progress is not None and tick % 50 == 0:
                self._report(progress, place, active)

    def _locate(self, readings: Readings) -> Place:
        return self.guide.locate(readings.position, heading(readings.rotation, self.legs.gear))

    def _judge(self, readings: Readings, place: Place) -> bool:
        """Whether a robot was sent onto another leg."""
        before = self.legs.number.copy()
        self.monitor.update(
            readings,
            place,
            self.belt_command,
            self.drive.saturated,
            self.controller.resting,
            self.plant.diverged,
        )
        return bool((self.legs.number != before).any())

    def _sends_on(self, robot: int, place: Place, time: float, arrived: bool) -> float | None:
        """Send a robot that has arrived at the end of its leg, or hangs, onto its next one, if it
        has one.

        Returns:
            Simulated seconds that the leg may take; None where there is none.
        """
        gear = self.legs.gear[robot]
        leg, told = self.legs.next_of(robot, float(place.distance[robot]), arrived)
        self.controller.events[robot] += [f"{time:.2f} s, {text}" for text in told]
        if leg is None:
            return None
        way = self.legs.way_of(robot, self.guide)
        self.guide.send(robot, way, leg.begin)
        self.controller.begin_leg(robot, bool(leg.gear != gear))
        return self.scenarios[robot].time_for(float(self.guide.lengths[way]))

    def _command(
        self, readings: Readings, place: Place, active: NDArray[np.intp]
    ) -> tuple[Array, Array, Array]:
        """Ask the controller, drive the motors. Trials that have ended keep their last command."""
        seen_so = seen(self._observation(readings, place), self.legs.gear)
        command = carried_out(self.controller.step(seen_so), self.legs.gear)
        self.belt_command[active] = command.belt_speed[active]
        self.roll_command[active] = command.roll[active]
        self.phase[active] = command.phase[active]
        return self.drive.advance(
            self.belt_command, readings.belt_speed, readings.motor_torque, self.period
        )

    def _observation(self, readings: Readings, place: Place) -> Observation:
        return Observation(
            time=readings.time,
            position=readings.position,
            rotation=readings.rotation,
            angular_velocity=readings.angular_velocity,
            slide=readings.slide,
            pitch=readings.pitch,
            roll=readings.roll,
            belt_speed=readings.belt_speed,
            motor_torque=readings.motor_torque,
            traction=readings.traction,
            normal_force=readings.normal_force,
            slip_velocity=readings.slip_velocity,
            module_speed=readings.module_speed,
            contact_count=readings.contact_count,
            contact_position=readings.contact_position,
            place=place,
        )

    def _record(self, readings: Readings, place: Place) -> None:
        self.recorder.sample(
            time=readings.time,
            qpos=self.plant.qpos,
            position=readings.position,
            quaternion=readings.quaternion,
            leg=self.legs.number,
            gear=self.legs.gear,
            distance=place.distance,
            offset=place.offset,
            tilt=place.tilt,
            theta5=place.theta5,
            phase=self.phase,
            belt_speed_command=self.belt_command,
            belt_speed=readings.belt_speed,
            wall_speed=readings.wall_speed,
            motor_torque=readings.motor_torque,
            traction=readings.traction,
            normal_force=readings.normal_force,
            slip_velocity=readings.slip_velocity,
            slip_ratio=readings.slip_ratio,
            contact_count=readings.contact_count,
            contact_position=readings.contact_position,
            slide=readings.slide,
            pitch=readings.pitch,
            roll=readings.roll,
            roll_command=self.roll_command,
        )

    def _report(self, progress: Progress, place: Place, active: NDArray[np.intp]) -> None:
        part = np.clip(place.distance / self.legs.end, 0, 1)
        part[np.setdiff1d(np.arange(len(part)), active)] = 1.0
        phase = self.controller.phases[self.phase[active[0]]]
        text = phase if len(part) == 1 else f"{len(active)} of {len(part)} running"
        progress(float(part.mean()), text)

    def results(self, no_load: bool = True) -> list[Result]:
        """One result a trial, after ``advance``; ``no_load`` as in ``run_batch``."""
        end_time: Array = self.monitor.end_time
        slips = no_load_slips(self.scenarios) if no_load else [math.nan] * len(self.scenarios)
        results = []
        for i, trajectory in enumerate(self.recorder.trajectories(end_time)):
            scenario, outcome = self.scenarios[i], self.monitor.outcome[i]
            assert outcome is not None
            reason, missed = self.monitor.reason[i], self.legs.missed(i)
            if outcome is Outcome.REACHED_GOAL and missed:
                outcome, reason = Outcome.STUCK, f"no way to {', '.join(missed)} is left; {reason}"
            metrics = summarise(
                trajectory,
                no_load_slip=slips[i],
                lug_radius=scenario.robot.lug_radius,
                torque_limit=float(self.drive.torque_limit[i, 0]),
            )
            note = self.notes[i]
            results.append(
                Result(
                    scenario=scenario,
                    outcome=outcome,
                    reason=reason,
                    duration_s=float(end_time[i]),
                    metrics=metrics,
                    trajectory=trajectory,
                    provenance=provenance_of(scenario) | {"collider": self.collider},
                    events=[*([] if note is None else [note]), *self.controller.events[i]],
                    legs=self.legs.driven(i),
                )
            )
        return results


BASELINE_TIME, BASELINE_SETTLED = 0.8, 0.5
"""Length of the run that measures the no-load slip, and from when on it counts, s."""


def no_load_slips(scenarios: Sequence[Scenario]) -> list[float]:
    """Mean slip speed, m/s, of the same robots at the same speed in a straight pipe without
    gravity.

    Regularised friction creeps: this is what slip reads when nothing pulls. Measured by a short
    run, one for each robot, physics, friction and speed.
    """
    bare = [_unloaded(s) for s in scenarios]
    distinct = list(dict.fromkeys(bare))
    batch = BatchRun([Scenario.model_validate_json(text) for text in distinct])
    batch.advance()
    slips = {}
    for text, trajectory in zip(
        distinct, batch.recorder.trajectories(batch.monitor.end_time), strict=True
    ):
        settled = trajectory.time >= BASELINE_SETTLED
        slips[text] = float(np.abs(trajectory["slip_velocity"][settled]).mean())
    return [slips[text] for text in bare]


def _unloaded(scenario: Scenario) -> str:
    """JSON of the scenario in a straight pipe without gravity."""
    first, size = scenario.route().fittings[0], scenario.robot.scale
    bare = {
        "name": "no_load",
        "robot": scenario.robot.model_dump(),
        "physics": scenario.physics.model_dump() | {"time_limit": BASELINE_TIME},
        "contact": scenario.contact.model_dump(),
        "control": scenario.control.model_dump(),
        "world": {"gravity": [0.0, 0.0, 0.0]},
        "pipes": [{"kind": "straight", "length": size, "inner_diameter": 2 * first.radius}],
        "start": {"distance": 0.15 * size},
    }
    return Scenario.model_validate(bare).model_dump_json()
