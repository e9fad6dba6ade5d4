"""The closed loop, step by step: n robots of one model, advanced by a control step at each call."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pilots import Pilot
from omnitrack_sim.base.arguments import check_all, check_is, refuse_taken
from omnitrack_sim.base.errors import ControllerError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.rotations import Array, with_rows
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import Channel, recorded
from omnitrack_sim.record.events import Event
from omnitrack_sim.record.metrics import Metric, summarise
from omnitrack_sim.record.trajectory import Recorder, Trajectory
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.control import (
    Controller,
    ControlSetup,
    Observation,
    checked,
    endless,
    held_command,
    with_command_rows,
)
from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.robots.sensor import Sensor, State, moments_together, read_together
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.builder import each, settings_of, start_of
from omnitrack_sim.sim.ending import Ending
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.monitor import Monitor
from omnitrack_sim.sim.own_controller import own_errors
from omnitrack_sim.sim.runs import Runs
from omnitrack_sim.sim.sensing import MakeSenses, Senses, Truth
from omnitrack_sim.sim.tail_load import TailLoad

Progress = Callable[[float, str], None]
"""Called with the part done, 0 to 1, which never decreases, and with simulated time and place."""
MakePlant = Callable[[Scenario, Start, int], Plant]
"""Makes a plant from the first scenario of a batch, the start values of all, and the number of
threads."""
MakePilot = Callable[[Scenario, int], Pilot]
"""Makes the pilot of a robot from its scenario and its index in the batch."""
REPORT_EVERY = 50
"""Control steps between two reports of progress."""


class Simulation:
    """n robots of one model in closed loop.

    Example:
        >>> sim = ot.Simulation([ot.load_scenario("straight")] * 2)
        >>> for _ in range(10):
        ...     sim.step(sim.controller.step(sim.observation))  # or a command of your own
        >>> sim.time
        array([0.1, 0.1])
        >>> sim.data(1).qpos.shape == (sim.model.nq,)
        True

    Args:
        scenarios: at least one; they share pipes, robot and clock, see ``builder.batch_key``.
        controller: a class in the place of the scenarios' own; see ``ot.Controller``.
        pilot: makes each robot's pilot in the place of the scenarios' own; see ``Pilot``.
        senses: makes the robots' senses in the place of the scenarios' own; see ``Senses``.
        sensors: further ones; their channels are observed and recorded as the shipped ones are.
        threads: native threads for the physics; 0 uses all cores. The results do not depend on it.
        make_plant: puts another plant in the place of the scenarios' own: other walls, another
            engine.
        recording: without it nothing is kept, however long it runs; there are no results then, and
            robots can begin anew, see ``reset``.

    Raises:
        TypeError: an argument is of another type.
        ValueError: there are no scenarios.

    Attributes:
        scenarios: as given.
        n: their number.
        period: s between two control steps.
        controller: made for these robots.
        readings: true values (n, ...) of all channels now, by name, each robot in its own frame
            whatever its gear.
        setup: what the controller was made from, with the settings of the runs at hand.
        legs: what they drive, with their pilots.
        senses: what controllers and pilots receive.
        plant, monitor, runs, recorder: the other parts of the loop.
    """

    @trusting()
    def __init__(
        self,
        scenarios: Sequence[Scenario],
        *,
        controller: type[Controller] | None = None,
        pilot: MakePilot = Scenario.pilot,
        senses: MakeSenses | None = None,
        sensors: Sequence[Sensor] = (),
        threads: int = 1,
        make_plant: MakePlant | None = None,
        recording: bool = True,
    ):
        scenarios = check_all(Scenario, "scenarios", scenarios)
        if not scenarios:
            raise ValueError("scenarios: is empty; a simulation is of one robot at least")
        self.scenarios = [s if controller is None else s.driven_by(controller) for s in scenarios]
        first, self.n = self.scenarios[0], len(self.scenarios)
        self.period, self._recording = first.physics.control_period, recording
        self._substeps = max(1, round(self.period / first.physics.timestep))
        self._record_every = max(1, round(first.record.period / self.period))
        self._make_pilot, self._tick = pilot, 0
        self.legs = Legs([pilot(scenario, i) for i, scenario in enumerate(self.scenarios)])
        start = start_of(self.scenarios, self.legs.routes, self.legs.route)
        settings, notes = settings_of(self.scenarios)
        sensors = (*first.own_sensors, *check_all(Sensor, "sensors", sensors))
        robot = first.robot
        refuse_taken("sensors", [sensor.channel.name for sensor in sensors], robot.channels)
        self.plant = (
            robot.plant(first.to_spec().compile(), start, self.period, threads, sensors)
            if make_plant is None
            else make_plant(first, start, threads)
        )
        self.readings: State = self.plant.read()
        _check_shapes(sensors, self.readings, self.n)
        make_senses = _senses_of(first) if senses is None else senses
        self.senses: Senses = make_senses(self.scenarios, self.legs, self.readings)
        self._tail = TailLoad(self.scenarios, self.legs, self.plant) if first.is_pulled else None
        self._robots = [*start.robots]
        self.monitor = Monitor(
            self.legs.routes,
            self._robots,
            first.monitor,
            each(self.scenarios, "distance"),
            settings.min_cruise_speed,
            np.array([s.time_limit_s for s in self.scenarios]),
            self.period,
            self._record_every,
            self._tail,
            self.legs.rights(np.arange(self.n)),
        )
        self.runs = Runs(self.scenarios, self.legs, self.senses, self.monitor)
        everyone = np.arange(self.n)
        notes = self._with_loose(everyone, start, notes)
        self.runs.reset(everyone, self.readings, notes)
        self._command = self.plant.command
        self.setup = ControlSetup(
            routes=self.legs.routes,
            robot=robot,
            model=self.plant.model,
            settings=settings,
            parameters=[s.control_parameters for s in self.scenarios],
            location=self.senses.location,
            command=self.plant.command,
            period=self.period,
            gravity=start.gravity,
            robots=start.robots,
        )
        kind = first.controller_class
        with own_errors(kind, lambda: "as it is made"):
            self.controller: Controller = kind(self.setup)
        self.phases: tuple[str, ...] = getattr(self.controller, "phases", ("drive",))
        own = [*robot.channels.values(), *(sensor.channel for sensor in sensors)]
        pull = self._tail.channels if self._tail else ()
        self.channels: tuple[Channel, ...] = (*own, *self.senses.recorded, *pull)
        schema, together = recorded(self.channels), moments_together(self.n)
        self.recorder = Recorder(self.phases, schema, read_together, together)
        self._users = [
            own for own in (kind, type(robot)) if not own.__module__.startswith("omnitrack_sim.")
        ]
        self._returned = f"what {type(self.controller).__name__}.step returns"
        self._judge(self.active, np.zeros(self.n, bool))
        if self._recording:
            self._record()

    def __repr__(self) -> str:
        names = ", ".join(dict.fromkeys(scenario.name for scenario in self.scenarios))
        running = f"{np.count_nonzero(self.active)} of {self.n} robots run"
        return f"Simulation({running}, at {self.time.max():.6g} s: {shown(names)})"

    def reset(self, rows: Sequence[int] | NDArray, scenarios: Sequence[Scenario]) -> None:
        """Start new runs of some robots, each to the bytes of a simulation of its own.

        The others are unchanged. The controller is not reset: the caller gives the commands.

        Args:
            rows: numbers of the robots, k, ascending.
            scenarios: what each runs now, k of the same ``builder.batch_key``, which is not
                checked here.

        Raises:
            RuntimeError: the simulation records, or its robots explore.
        """
        # A robot that makes a map of its own would drive almost, but not quite, as it does alone.
        if self._recording or any(pilot.belief for pilot in self.legs.pilots):
            raise RuntimeError("reset is for robots that do not explore, and are not recorded")
        rows = np.asarray(rows, np.intp)
        pilots = []
        for row, scenario in zip(rows.tolist(), scenarios, strict=True):
            self.scenarios[row], self._robots[row] = scenario, scenario.robot
            pilots.append(self._make_pilot(scenario, row))
        self.legs.reset(rows, pilots)
        routes, route = self.legs.routes, self.legs.route[rows]
        start = start_of(scenarios, routes, route)
        settings, notes = settings_of(scenarios)
        self.plant.reset(rows, start)
        if self._tail is not None:
            self._tail.reset(rows)
        limits = np.array([s.time_limit_s for s in scenarios])
        begin, rights = each(scenarios, "distance"), self.legs.rights(rows)
        self.monitor.reset(rows, begin, settings.min_cruise_speed, limits, rights)
        self.readings = self.plant.read()
        self.senses.reset(rows, scenarios, self.readings)
        self.runs.reset(rows, self.readings, self._with_loose(rows, start, notes))
        self._command = with_command_rows(self._command, rows, self.plant.command)
        self.setup = replace(
            self.setup,
            settings=self.setup.settings.with_rows(rows, settings),
            parameters=[s.control_parameters for s in self.scenarios],
            location=self.senses.location,
            command=with_command_rows(self.setup.command, rows, self.plant.command),
            gravity=with_rows(self.setup.gravity, rows, start.gravity),
            robots=[*self._robots],
        )
        nobody = np.zeros(self.n, bool)
        self._judge(with_rows(nobody, rows, True), nobody)

    def _with_loose(
        self, rows: NDArray[np.intp], start: Start, notes: Sequence[Sequence[str]]
    ) -> list[list[str]]:
        """Notes on robots ``rows`` (k,), with one on each that touches no wall at its start."""
        touches = self.plant.touches(self.readings)[rows]
        noted = []
        for words, held, radius, robot in zip(
            notes, touches, start.bore_radius, start.robots, strict=True
        ):
            loose = (
                "nothing of the robot touches the wall at the start, so it falls from there; "
                f"the bore is {2000 * radius:.4g} mm, and the robot is made for "
                f"{1000 * robot.nominal_bore:.4g} mm"
            )
            noted.append([*words] if held else [*words, loose])
        return noted

    @property
    def observation(self) -> Observation:
        """Measurements of the robots now, as their controllers receive them."""
        gear, senses = self.legs.gear, self.senses
        readings = self.plant.to_controller(senses.readings, gear, senses.channels)
        return Observation(readings, senses.location, self.legs.number, gear)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Robots (n,) whose run is not over."""
        return self.runs.active

    @property
    def end_time(self) -> Array:
        """End (n,) s of each robot's run; not a number while it runs."""
        return self.runs.end_time

    @property
    def endings(self) -> Sequence[Ending | None]:
        """Outcome of each robot's run, and the reason; None while it runs."""
        return self.runs.endings

    @property
    def events(self) -> Sequence[Sequence[Event]]:
        """Events of each robot's run."""
        return self.runs.events

    @property
    def location(self) -> Location:
        """True locations of the robots along their routes."""
        return self.runs.location

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of pipes and robot.

        What differs between the robots, such as friction and gravity, each simulation of the batch
        has of its own.
        """
        return self.plant.model

    def data(self, robot: int) -> mujoco.MjData:
        """Return a copy of MuJoCo's data of one robot.

        The model has no visual geoms: for pictures, put its ``qpos`` into the data of a model of
        ``scenario.to_spec(looks=True)``.
        """
        return self.plant.data(robot)

    @property
    def phase(self) -> list[str]:
        """The phase of each robot."""
        return [self.phases[code] for code in self._command.phase]

    @property
    def time(self) -> Array:
        """Simulated time (n,) s."""
        return self.readings["time"]

    def step(self, command: Any = None) -> None:
        """Carry out a command for one control period; robots whose run is over stay as they are.

        Args:
            command: for all n robots; the controller's own when not given.

        Raises:
            TypeError: it is no command of this kind of robot.
            ValueError: an array of the command has the wrong shape.
            ControllerError: a user's own controller raised an error, one of these holds for what it
                returned, or a number in that is not finite.
        """
        command = self._own_command() if command is None else self._checked(command, "command")
        command, lost = self.senses.guard(command)
        active, given = self.active, self.plant.from_controller(command, self.legs.gear)
        self._command = held_command(given, self._command, active)
        self.runs.add_events(given.events)
        if self._tail is not None:
            self._tail.act(self.time, self.location)
        self.plant.step(active, self._command, self._substeps)
        self._tick += 1
        self.readings = self.plant.read()
        self.senses.read(self.readings, active)
        self.runs.locate(self.readings)
        self._judge(active, lost)
        if self._recording:
            self._record()

    def _own_command(self) -> Any:
        """Return the command of the robots' controller."""
        with own_errors(type(self.controller), self._step_at_hand):
            command = self._checked(self.controller.step(self.observation), self._returned)
            self._refuse_endless(command)
            return command

    def _refuse_endless(self, command: Any) -> None:
        """Raise a ``ControllerError`` for a number that is not finite, from a user's own code."""
        place = endless(command, self.active) if self._users else None
        if place is not None:
            field, robot, *numbers = place
            what = f"command.{field}[{', '.join(map(str, [robot, *numbers]))}]"
            if field == "ctrl":
                actuator = self.plant.model.actuator(numbers[0])
                what += f" (actuator {actuator.name or actuator.id!r})"
            value, own = getattr(command, field)[(robot, *numbers)], self._users[0]
            name = f"{own.__module__}:{own.__qualname__}"
            raise ControllerError(f"{name}, {self._step_at_hand()}: {what} is {value}")

    def _step_at_hand(self) -> str:
        return f"step {self._tick + 1} ({self.time.max():.6g} s)"

    def _checked(self, command: Any, whose: str) -> Any:
        """Return a command that fits the robots; see ``step`` for what is raised."""
        start = self.plant.command
        if type(command) is not type(start):
            check_is(type(start), whose, command)
        return checked(command, start)

    def advance(self, progress: Progress | None = None) -> None:
        """Run all robots to their ends under their controller."""
        while self.active.any():
            self.step()
            if progress is not None and self._tick % REPORT_EVERY == 0 and self.active.any():
                progress(*self.runs.progress(self.phase))

    def _judge(self, robots: NDArray[np.bool_], lost: NDArray[np.bool_]) -> None:
        """Have the monitor judge robots, and carry out what their pilots decide.

        Args:
            robots: (n,) those that are judged.
            lost: (n,) those that search no longer for their pose.
        """
        plant, command, runs, monitor = self.plant, self._command, self.runs, self.monitor
        # Averages first: the cause of a failure is read from them.
        monitor.average(self.readings, command, plant.saturated, robots)
        # Before the verdicts: a look may lengthen the leg at whose end the robot seems to be.
        runs.look_ahead(robots)
        location = self.senses.location
        verdicts = monitor.look(
            self.readings,
            location,
            robots,
            arrived=location.distance >= self.legs.end,
            resting=command.resting,
            diverged=plant.diverged,
            lost=lost,
            over=command.over,
        )
        if verdicts:
            runs.carry_out(verdicts)
        # Last, and by the truth: who was put onto another leg is judged on the new route.
        if verdicts or location is not runs.location:
            runs.end_outside(robots)

    def _record(self) -> None:
        """Record a sample where one is due."""
        if self._tick % self._record_every and self.active.any():
            return
        location, legs, held = self.location, self.legs, self._command
        if held.phase.max() >= len(self.phases):
            raise ValueError(f"command.phase is {held.phase.max()}; phases are {self.phases}")
        self.recorder.sample(
            self.plant.qpos,
            self.readings,
            {
                "leg": legs.number,
                "gear": legs.gear,
                "distance": location.distance,
                "offset": location.offset,
                "tilt": location.tilt,
                "theta5": location.theta5,
                "phase": held.phase,
                **self.plant.commanded(held),
                **self.senses.estimates(),
                **({} if self._tail is None else self._tail.values()),
            },
        )

    @trusting()
    def results(
        self, no_load_slip: Sequence[float] | None = None, metrics: Sequence[Metric] = ()
    ) -> list[Result]:
        """One result a robot, after all runs are over.

        Args:
            no_load_slip: (n,) m/s, what slip reads without load; see ``run.no_load_slips``. Without
                it ``no_load_slip_m_s`` is not a number.
            metrics: further ones beside the shipped.

        Raises:
            RuntimeError: a robot still runs, or nothing was recorded.
        """
        if not self._recording:
            raise RuntimeError("nothing was recorded")
        if self.active.any():
            raise RuntimeError(f"{int(self.active.sum())} of {self.n} robots still run")
        metrics = check_all(Metric, "metrics", metrics)
        taken = {metric.name for metric in self.scenarios[0].all_metrics}
        refuse_taken("metrics", [metric.name for metric in metrics], taken)
        slips = [math.nan] * self.n if no_load_slip is None else no_load_slip
        pictures = self.senses.pictures()
        return [
            self._result(i, trajectory, slips[i], metrics, pictures[i])
            for i, trajectory in enumerate(self.recorder.trajectories(self.end_time))
        ]

    def _result(
        self,
        robot: int,
        trajectory: Trajectory,
        slip: float,
        metrics: Sequence[Metric],
        pictures: Pictures | None,
    ) -> Result:
        """The result of a robot that slips by ``slip`` m/s without load."""
        scenario, ending = self.scenarios[robot], self.endings[robot]
        assert ending is not None
        run = scenario.robot.run_record(trajectory, slip, scenario.physics.timestep)
        values = summarise(run, (*scenario.all_metrics, *metrics))
        network = self.legs.map(robot)
        return Result(
            scenario=scenario,
            outcome=ending.outcome,
            reason=ending.reason,
            duration_s=float(self.end_time[robot]),
            metrics=values | scenario.map_metrics(network) | dict(self.senses.metrics(robot)),
            trajectory=trajectory,
            provenance=provenance_of(scenario),
            events=sorted(
                [*self.events[robot], *scenario.robot.strains(trajectory)], key=lambda e: e.time
            ),
            legs=self.legs.begun(robot),
            map=network,
            map_stds=self.legs.map_stds(robot),
            album=pictures,
        )


def _check_shapes(sensors: Sequence[Sensor], readings: Mapping[str, Array], n: int) -> None:
    """Refuse sensors that read arrays of another shape than they declare."""
    for channel in (sensor.channel for sensor in sensors):
        value, shape = readings[channel.name], (n, *channel.shape)
        if np.shape(value) != shape:
            raise ValueError(f"sensor {channel.name!r} reads {np.shape(value)}, not {shape}")


def _senses_of(scenario: Scenario) -> MakeSenses:
    """The senses that ``sensing.kind`` names."""
    if scenario.sensing.kind == "truth":
        return Truth
    # Loaded where it is asked for: the rays of its cameras are compiled, which takes seconds.
    from omnitrack_sim.sim.onboard import Onboard

    return Onboard
