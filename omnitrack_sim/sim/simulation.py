"""The loop, opened: n robots of one model, every one a control step on at each call of ``step``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pilots import Decision, Pilot
from omnitrack_sim.base.arguments import check_all, check_is, refuse_taken
from omnitrack_sim.base.rotations import Array, heading, set_rows, with_rows
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import CHANNELS, Channel
from omnitrack_sim.record.events import Event, Note, Outcome
from omnitrack_sim.record.metrics import METRICS, Metric, Run, summarise
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.control import Command, Controller, ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.gear import carried_out, seen
from omnitrack_sim.robots.omnitrack.drive import SpeedLoop, drive_of
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.model import METRIC_NAMES
from omnitrack_sim.senses import SENSORS, Sensor
from omnitrack_sim.sim.builder import each, settings_of, start_of
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.monitor import Monitor, Verdict, strains
from omnitrack_sim.sim.plant import Plant, Start
from omnitrack_sim.sim.sensing import MakeSenses, Senses, Truth

Progress = Callable[[float, str], None]
"""Called with the part done, 0 to 1, which never falls, and with simulated time and place."""
MakePlant = Callable[[Scenario, Start, int], Plant]
"""Makes a plant from the first scenario of a batch, the start values of all, and the number of
threads."""
MakePilot = Callable[[Scenario, int], Pilot]
"""Makes the pilot of a robot from its scenario and its index in the batch."""
BLOCK = 1024
"""Samples that are put together into one array as soon as there are so many of them: an array of
its own for each sample takes seven times the memory."""
REPORT_EVERY = 50
"""Control steps between two reports of progress."""


@dataclass(frozen=True)
class Ending:
    """Outcome of one robot's run, and the reason."""

    outcome: Outcome
    reason: str


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
        active: (n,) bool, robots whose run is not over.
        observation: what the robots measure now.
        setup: what the controller was made from, with the settings of the runs at hand.
        endings: how each robot's run ended; None while it runs.
        end_time: (n,) s.
        events: what there is to tell of each robot.
        legs: what they drive, with their pilots.
        senses: what controllers and pilots receive.
        plant, motors, monitor, recorder: the other parts of the loop.
    """

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
        self._make_pilot = pilot
        self.legs = Legs([pilot(scenario, i) for i, scenario in enumerate(self.scenarios)])
        start = start_of(self.scenarios, self.legs.routes, self.legs.route)
        settings, notes = settings_of(self.scenarios, self.legs.routes, self.legs.route)
        sensors = (*first.own_sensors, *check_all(Sensor, "sensors", sensors))
        refuse_taken("sensors", [sensor.channel.name for sensor in sensors], CHANNELS)
        every = (*SENSORS, *sensors)
        self.plant = (
            Plant(first.to_spec().compile(), first.robot, start, threads, every)
            if make_plant is None
            else make_plant(first, start, threads)
        )
        drive, motor = drive_of(first.robot.drive), first.robot.motor
        torque = each(self.scenarios, "torque_limit")
        self.motors = SpeedLoop(drive, motor, torque, first.robot.lug_radius, self.n)
        self._readings = self.plant.read()
        self._check_shapes(sensors)
        make_senses = _senses_of(first) if senses is None else senses
        self.senses: Senses = make_senses(self.scenarios, self.legs, self._readings)
        self.active, self.end_time = np.ones(self.n, bool), np.zeros(self.n)
        self.endings: list[Ending | None] = [None] * self.n
        self.events: list[list[Event]] = [[] for _ in notes]
        self._near, self._tick, self._begun = np.zeros(self.n), 0, np.zeros(self.n, int)
        self._progress = 0.0
        self._belt_command, self._roll_command = np.zeros((2, self.n, 3))
        self._phase, self._brake = np.zeros(self.n, int), None
        self._resting, self._over, self._given_up = np.zeros((3, self.n), bool)
        self._begin(np.arange(self.n), start, notes)
        self.setup = ControlSetup(
            routes=self.legs.routes,
            robot=first.robot,
            settings=settings,
            parameters=[s.control_parameters for s in self.scenarios],
            location=self.senses.location,
            roll=start.roll,
            period=self.period,
            gravity=start.gravity,
        )
        self.controller: Controller = first.controller_class(self.setup)
        self.phases: tuple[str, ...] = getattr(self.controller, "phases", ("drive",))
        self.monitor = Monitor(
            self.legs.routes,
            first.robot,
            first.monitor,
            each(self.scenarios, "distance"),
            settings.cruise_speed,
            np.array([s.time_limit_s for s in self.scenarios]),
            self.period,
            self.period * self._record_every,
        )
        own = [sensor.channel for sensor in sensors]
        self.channels: tuple[Channel, ...] = (*CHANNELS.values(), *own, *self.senses.recorded)
        schema = {channel.name: channel for channel in self.channels if channel.recorded}
        self.recorder = Recorder(self.phases, schema)
        self._measured = ["time", *(c.name for c in schema.values() if c.source == "plant")]
        self._settle(self.active)

    def __repr__(self) -> str:
        names = ", ".join(dict.fromkeys(scenario.name for scenario in self.scenarios))
        running = f"{np.count_nonzero(self.active)} of {self.n} robots run"
        return f"Simulation({running}, at {self.time.max():.6g} s: {shown(names)})"

    def reset(self, rows: Sequence[int] | NDArray, scenarios: Sequence[Scenario]) -> None:
        """Have robots begin new runs, each to the bytes of a simulation of its own; the others are
        left as they are. The controller is not told: who calls this gives the commands.

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
            self.scenarios[row] = scenario
            pilots.append(self._make_pilot(scenario, row))
        self.legs.reset(rows, pilots)
        routes, route = self.legs.routes, self.legs.route[rows]
        start = start_of(scenarios, routes, route)
        settings, notes = settings_of(scenarios, routes, route)
        self.plant.reset(rows, start)
        self.motors.reset(rows, each(scenarios, "torque_limit"))
        limits = np.array([s.time_limit_s for s in scenarios])
        self.monitor.reset(rows, each(scenarios, "distance"), settings.cruise_speed, limits)
        self._readings = self.plant.read()
        self.senses.reset(rows, scenarios, self._readings)
        self._begin(rows, start, notes)
        self.setup = replace(
            self.setup,
            settings=self.setup.settings.with_rows(rows, settings),
            parameters=[s.control_parameters for s in self.scenarios],
            location=self.senses.location,
            roll=with_rows(self.setup.roll, rows, start.roll),
            gravity=with_rows(self.setup.gravity, rows, start.gravity),
        )
        self._settle(with_rows(np.zeros(self.n, bool), rows, True))

    def _begin(self, rows: NDArray[np.intp], start: Start, notes: Sequence[Sequence[str]]) -> None:
        """Begin the runs of robots ``rows`` (k,) with remarks ``notes`` (k,) on each, and find
        them."""
        set_rows(self, rows, active=True, end_time=np.nan, _begun=self._tick)
        set_rows(self, rows, _belt_command=0.0, _roll_command=start.roll, _phase=0)
        set_rows(self, rows, _resting=False, _over=False, _given_up=False)
        for row, words in zip(rows.tolist(), notes, strict=True):
            self.endings[row] = None
            self.events[row] = [Note(row, 0.0, each) for each in words]
        self._near = with_rows(self._near, rows, self.legs.near[rows])
        self._locate()

    def _check_shapes(self, sensors: Sequence[Sensor]) -> None:
        """Refuse sensors that read arrays of another shape than they declare."""
        for channel in (sensor.channel for sensor in sensors):
            value, shape = self._readings[channel.name], (self.n, *channel.shape)
            if np.shape(value) != shape:
                raise ValueError(f"sensor {channel.name!r} reads {np.shape(value)}, not {shape}")

    @property
    def observation(self) -> Observation:
        """Measurements of the robots now, as their controllers receive them."""
        gear, senses = self.legs.gear, self.senses
        readings = seen(senses.readings, gear, senses.channels)
        return Observation(readings, senses.location, self.legs.number, gear)

    @property
    def readings(self) -> Mapping[str, Array]:
        """True values of all channels now, by name, each robot in its own frame whatever its
        gear."""
        return self._readings

    @property
    def location(self) -> Location:
        """True locations of the robots along their routes."""
        return self._location

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of pipes and robot. What differs between the robots, such as friction and
        gravity, each simulation of the batch has of its own."""
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
        return [self.phases[code] for code in self._phase]

    @property
    def time(self) -> Array:
        """Simulated time (n,) s."""
        return self._readings["time"]

    def step(self, command: Command | None = None) -> None:
        """Carry out a command for one control period; robots whose run is over stay as they are.

        Args:
            command: for all n robots; the controller's own when not given.

        Raises:
            TypeError: it is no ``Command``.
            ValueError: an array of the command has the wrong shape.
        """
        where = "command"
        if command is None:
            command = self.controller.step(self.observation)
            where = f"what {type(self.controller).__name__}.step returns"
        check_is(Command, where, command)
        if command.brake is not None and not self.plant.robot.brake_force and np.any(command.brake):
            raise ValueError("command.brake is given to a robot whose robot.brake_force is 0")
        command, self._given_up = self.senses.guard(command.checked(self.n))
        self._take(carried_out(command, self.legs.gear))
        readings = self._readings
        motors = self.motors.advance(
            self._belt_command, readings["belt_speed"], readings["motor_torque"], self.period
        )
        self.plant.step(self.active, motors, self._roll_command, self._substeps, self._brake)
        self._tick += 1
        self._readings = self.plant.read()
        self.senses.read(self._readings, self.active)
        self._locate()
        self._settle(self.active)

    def advance(self, progress: Progress | None = None) -> None:
        """Run all robots to their ends under their controller."""
        while self.active.any():
            self.step()
            if progress is not None and self._tick % REPORT_EVERY == 0:
                self._report(progress)

    def _take(self, command: Command) -> None:
        """Keep what is asked of the robots that still run."""
        speed, roll, phase, resting, _, brake, over = command
        roll = self._roll_command if roll is None else roll
        phase = self._phase if phase is None else phase
        # Robots whose run is over keep what they were asked last.
        if np.count_nonzero(self.active) < self.n:
            speed = np.where(self.active[:, None], speed, self._belt_command)
            roll = np.where(self.active[:, None], roll, self._roll_command)
            phase = np.where(self.active, phase, self._phase)
        # Copies: whoever made the command may write into its arrays again.
        self._belt_command, self._roll_command = speed.copy(), roll.copy()
        self._phase = phase.copy()
        self._resting = np.zeros(self.n, bool) if resting is None else resting
        self._over = np.zeros(self.n, bool) if over is None else over
        self._brake = None if brake is None else np.minimum(np.maximum(brake, 0.0), 1.0)
        for event in command.events:
            if self.active[event.robot]:
                self.events[event.robot].append(event)

    def _locate(self) -> None:
        """Find the robots on their routes, and where they take themselves to be."""
        legs, truth = self.legs, self._readings
        frames = heading(truth["rotation"], legs.gear)
        self._location = legs.routes.locate(truth["position"], frames, legs.route, self._near)
        # The next search starts from here: a route may pass the same pipe twice.
        self._near = self._location.distance
        self.senses.locate(self._location)
        legs.near = self.senses.location.distance

    def _settle(self, robots: NDArray[np.bool_]) -> None:
        """Judge where ``robots`` (n,) are now, send on who is due, record."""
        # Averages first: the cause of a failure is read from them.
        due = robots & ((self._tick - self._begun) % self._record_every == 0)
        if np.count_nonzero(due):
            self.monitor.average(self._readings, self._belt_command, self.motors.saturated, due)
        # Before the verdicts: a look may lengthen the leg at whose end the robot seems to be.
        self._look_ahead(robots)
        verdicts = self._verdicts(robots)
        if verdicts:
            self._dispatch(verdicts)
        # Last, and by the truth: who was sent on is judged on the new route.
        self._end_those_outside(robots)
        if self._recording and (self._tick % self._record_every == 0 or not self.active.any()):
            self._record()

    def _verdicts(self, robots: NDArray[np.bool_]) -> list[Verdict]:
        """Verdicts on ``robots`` (n,) by the monitor, by their search, and by the controller, in
        the order in which they count."""
        location = self.senses.location
        arrived = location.distance >= self.legs.end
        resting, diverged = self._resting, self.plant.diverged
        verdicts = self.monitor.look(self._readings, location, arrived, resting, diverged, robots)
        if np.count_nonzero(self._given_up):
            lost = np.flatnonzero(self._given_up & robots).tolist()
            verdicts = [*(Verdict(robot, Outcome.LOST) for robot in lost), *verdicts]
        if np.count_nonzero(self._over):
            ended = np.flatnonzero(self._over & robots).tolist()
            verdicts += [Verdict(robot, Outcome.ENDED) for robot in ended]
        return verdicts

    def _end_those_outside(self, robots: NDArray[np.bool_]) -> None:
        """End the runs of robots that truly are in no pipe, whatever they take themselves to be
        in."""
        outside = self.monitor.outside(self._location) & robots & self.active
        for robot in np.flatnonzero(outside).tolist() if np.count_nonzero(outside) else ():
            if not self.scenarios[robot].holds(*self._pose(robot)):
                self._end(robot, Outcome.LEFT_PIPE)

    def _pose(self, robot: int) -> tuple[Array, Array]:
        """The true position (3,) m of a robot and the direction (3,) of its nose, world frame."""
        return self._readings["position"][robot], self._readings["rotation"][robot, :, 2]

    def _dispatch(self, verdicts: Sequence[Verdict]) -> None:
        """Send robots that have arrived, hang, or have fallen off their route onto their next legs;
        end the runs of others."""
        sent: list[int] = []
        for robot, outcome in verdicts:
            # A robot may have several verdicts: the first one counts.
            if robot in sent or not self.active[robot]:
                continue
            decision = self._decision(robot, outcome)
            if decision.leg is not None:
                sent.append(robot)
                self._follow(robot, decision)
                continue
            # Who may be elsewhere than he takes himself to be looks around before he gives up.
            if outcome is not Outcome.LEFT_PIPE or not self.senses.doubt(robot):
                self.events[robot] += decision.events
                self._end(robot, outcome or self.monitor.cause(robot, self._location))
        self._locate_again(sent)

    def _decision(self, robot: int, outcome: Outcome | None) -> Decision:
        """Return the decision of a robot's pilot on a verdict."""
        pilot, senses, time = self.legs.pilots[robot], self.senses, float(self.time[robot])
        if outcome is Outcome.LEFT_PIPE:
            position, rotation = (senses.readings[k][robot] for k in ("position", "rotation"))
            return pilot.on_fall(time, position, rotation[:, 2])
        if outcome not in (None, Outcome.REACHED_GOAL):
            return Decision(None)
        scenario, (position, axis) = self.scenarios[robot], self._pose(robot)
        goal = scenario.goal_at(position + scenario.robot.length / 2 * self.legs.gear[robot] * axis)
        distance = float(senses.location.distance[robot])
        if outcome is Outcome.REACHED_GOAL:
            return pilot.on_arrival(time, distance, goal)
        # Belts that slip before an obstacle push an estimate into it.
        return pilot.on_blockage(time, distance - 2 * float(senses.distance_std[robot]), goal)

    def _look_ahead(self, robots: NDArray[np.bool_]) -> None:
        """Have those of ``robots`` (n,) look ahead that have come to where they want to."""
        looking = (self.senses.location.distance >= self.legs.look_at) & robots
        if not np.count_nonzero(looking) or not self.senses.can_look:
            return
        rows = np.flatnonzero(looking).tolist()
        for robot in rows:
            pilot, distance = self.legs.pilots[robot], self.senses.location.distance[robot]
            look = self.senses.look(robot, pilot.looks_back(float(distance)))
            self._follow(robot, pilot.on_look(look))
        self._locate_again(rows)

    def _follow(self, robot: int, decision: Decision) -> None:
        """Have a robot do what its pilot has decided, and give it time for that."""
        length = self.legs.follow(robot, decision)
        if decision.shift:
            self.senses.shift(robot, decision.shift)
        self.events[robot] += decision.events
        scenario = self.scenarios[robot]
        if decision.goes_on:
            # The fixed part of the time was granted when the leg began.
            self.monitor.goes_on(robot, scenario.time_for(length) - scenario.time_for(0.0))
        else:
            self.monitor.sent_on(robot, scenario.time_for(length))

    def _locate_again(self, robots: Sequence[int]) -> None:
        """Find robots on their routes that are on another one now."""
        if robots:
            self.senses.update_maps(robots)
            self._near = with_rows(self._near, np.array(robots), self.legs.near[robots])
            self._locate()

    def _end(self, robot: int, outcome: Outcome) -> None:
        """End a robot's run."""
        time, location = float(self.time[robot]), self._location
        reason = self.monitor.reason(robot, location, float(self.legs.end[robot]), time)
        missed = self.legs.pilots[robot].missed
        error = float(self.senses.location.distance[robot] - location.distance[robot])
        if outcome is Outcome.REACHED_GOAL:
            # A robot that localises itself may take itself to be where it is not.
            if not self.scenarios[robot].is_done_at(*self._pose(robot), error):
                outcome, reason = Outcome.LOST, f"took itself to be at the goal; {reason}"
            elif missed:
                reason = f"no way to {', '.join(missed)} is left; {reason}"
                outcome = Outcome.STUCK
            elif self.monitor.lies_across(robot, location):
                outcome = Outcome.WEDGED
            else:
                outcome, reason = self._judged_map(robot, reason)
        elif outcome is Outcome.LEFT_PIPE:
            place = ", ".join(f"{x:.3f}" for x in self._readings["position"][robot])
            reason = f"left the pipe at ({place}) m, {location.offset[robot]:.3f} m off; {reason}"
        self.endings[robot] = Ending(outcome, reason)
        set_rows(self, np.array([robot]), active=False, end_time=time)

    def _judged_map(self, robot: int, reason: str) -> tuple[Outcome, str]:
        """Return the outcome and reason of a robot that is where it wanted to be, in view of its
        map: what it says that it has not explored may be missing."""
        left, network = self.legs.pilots[robot].left, self.legs.map(robot)
        exploration = self.scenarios[robot].exploration
        # Who searches for goals has no need of a whole map.
        if exploration is None or network is None or exploration.mission.task == "find":
            return Outcome.REACHED_GOAL, reason
        if left:
            reason = f"not explored: {left}; {reason}"
        difference = exploration.difference(network)
        if difference.same:
            return Outcome.REACHED_GOAL, reason
        right = difference.consistent and (left or difference.complete)
        return Outcome.REACHED_GOAL if right else Outcome.WRONG_MAP, f"{difference}; {reason}"

    def _record(self) -> None:
        location, legs = self._location, self.legs
        if self._phase.max() >= len(self.phases):
            raise ValueError(f"command.phase is {self._phase.max()}; phases are {self.phases}")
        self.recorder.sample(
            self.plant.qpos,
            {
                **{name: self._readings[name] for name in self._measured},
                "leg": legs.number,
                "gear": legs.gear,
                "distance": location.distance,
                "offset": location.offset,
                "tilt": location.tilt,
                "theta5": location.theta5,
                "phase": self._phase,
                "belt_speed_command": self._belt_command,
                "roll_command": self._roll_command,
                **self.senses.estimates(),
            },
        )

    def _report(self, progress: Progress) -> None:
        running, distance = np.flatnonzero(self.active), self._location.distance
        if len(running) == 0:
            return
        part = np.ones(self.n)
        part[running] = [self.legs.pilots[i].done_at(float(distance[i])) for i in running]
        # A detour makes the way longer, and a robot may slide back: progress then stands still.
        self._progress = max(self._progress, float(part.mean()))
        text = f"{len(running)} of {self.n} running"
        if self.n == 1:
            route = self.legs.routes.routes[self.legs.route[0]]
            passage = route.passages[route.index_at(float(distance[0]))]
            text = f"{self.phases[self._phase[0]]} in {passage.part.name}"
        progress(self._progress, f"{self.time.max():.0f} s, {text}")

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
        taken = {*METRIC_NAMES, *(metric.name for metric in self.scenarios[0].own_metrics)}
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
        scenario, ending, motors = self.scenarios[robot], self.endings[robot], self.motors
        assert ending is not None
        limit, efficiency = float(motors.torque_limit[robot, 0]), scenario.robot.motor.efficiency
        run = Run(trajectory, slip, scenario.robot.lug_radius, limit, motors.drive, efficiency)
        values = summarise(run, (*METRICS, *scenario.own_metrics, *metrics))
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
                [*self.events[robot], *strains(trajectory, scenario.robot)], key=lambda e: e.time
            ),
            legs=self.legs.begun(robot),
            map=network,
            album=pictures,
        )


class Recorder:
    """Samples of n robots. Every sample is an array (n, ...) a channel; a robot's record ends where
    its run ended.

    Args:
        phases: names that the codes of the channel ``phase`` index.
        schema: the channels to keep, by name.

    Attributes:
        count: number of samples so far.
    """

    def __init__(self, phases: tuple[str, ...], schema: Mapping[str, Channel]):
        self.phases, self.schema = phases, schema
        self.count = 0
        self._samples: dict[str, list[NDArray]] = {n: [] for n in ("time", "qpos", *schema)}
        self._blocks: dict[str, list[NDArray]] = {name: [] for name in self._samples}

    def sample(self, qpos: Array, values: Mapping[str, NDArray]) -> None:
        """Add one sample.

        Args:
            qpos: (n, nq), copied.
            values: ``time`` (n,) and every channel (n, ...), which must not be changed afterwards.
        """
        samples = self._samples
        samples["qpos"].append(np.array(qpos))
        for name in ("time", *self.schema):
            samples[name].append(values[name])
        self.count += 1
        if len(samples["time"]) == BLOCK:
            self._put_together()

    def _put_together(self) -> None:
        """Make one array a channel of the samples since the last time."""
        for name, values in self._samples.items():
            if values:
                self._blocks[name].append(np.array(values))
                values.clear()

    def trajectories(self, end_time: Array) -> Iterator[Trajectory]:
        """Yield one trajectory a robot, up to ``end_time`` (n,) s."""
        self._put_together()
        stacked = {name: np.concatenate(blocks) for name, blocks in self._blocks.items()}
        time, qpos = stacked.pop("time"), stacked.pop("qpos")  # (T, n), (T, n, nq)
        for i, end in enumerate(end_time):
            # A robot whose run has ended stands still in time: keep the samples up to the first
            # one at the end.
            # 1e-9 s: times are sums of steps, and rounded.
            count = int(np.searchsorted(time[:, i], end - 1e-9)) + 1
            channels = {name: values[:count, i] for name, values in stacked.items()}
            yield Trajectory(time[:count, i], channels, self.phases, qpos[:count, i], self.schema)


def _senses_of(scenario: Scenario) -> MakeSenses:
    """The senses that ``sensing.kind`` names."""
    if scenario.sensing.kind == "truth":
        return Truth
    # Loaded where it is asked for: the rays of its cameras are compiled, which takes seconds.
    from omnitrack_sim.sim.onboard import Onboard

    return Onboard
