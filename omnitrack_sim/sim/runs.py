"""The runs of n robots: where each is on its leg, what its pilot has it do next, how it ended."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.autonomy.pilots import Decision, Hindrance, Situation
from omnitrack_sim.base.rotations import Array, heading, set_rows, with_rows
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.events import Event, Note, Outcome
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.ending import Ending, ending_at_goal
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.monitor import Monitor, Verdict
from omnitrack_sim.sim.sensing import Senses


class Runs:
    """The runs of n robots, which pilots decide and the monitor judges.

    Args:
        scenarios: of the robots; the list is the simulation's, which changes it.
        legs: that they drive, with their pilots.
        senses: of theirs.
        monitor: judges them.

    Attributes:
        active: (n,) bool, robots whose run is not over.
        end_time: (n,) s.
        endings: how each robot's run ended; None while it runs.
        events: of each robot's run.
        location: true locations along their routes.
    """

    location: Location

    def __init__(
        self, scenarios: Sequence[Scenario], legs: Legs, senses: Senses, monitor: Monitor
    ) -> None:
        self._scenarios, self._legs, self._senses, self._monitor = scenarios, legs, senses, monitor
        n = len(scenarios)
        self.active, self.end_time = np.ones(n, bool), np.zeros(n)
        self.endings: list[Ending | None] = [None] * n
        self.events: list[list[Event]] = [[] for _ in scenarios]
        self._near, self._done = np.zeros(n), 0.0

    def reset(
        self,
        rows: NDArray[np.intp],
        readings: Mapping[str, Array],
        notes: Sequence[Sequence[str]],
    ) -> None:
        """Begin the runs of some robots.

        Args:
            rows: (k,) numbers of the robots.
            readings: of all n.
            notes: (k,) remarks on each.
        """
        set_rows(self, rows, active=True, end_time=np.nan, _near=self._legs.near[rows])
        for row, words in zip(rows.tolist(), notes, strict=True):
            self.endings[row] = None
            self.events[row] = [Note(row, 0.0, each) for each in words]
        self.locate(readings)

    def locate(self, readings: Mapping[str, Array]) -> None:
        """Locate the robots on their routes by ``readings``, and update their estimates."""
        self._readings, legs = readings, self._legs
        frames = heading(readings["rotation"], legs.gear)
        self.location = legs.routes.locate(readings["position"], frames, legs.route, self._near)
        # The next search starts from here: a route may pass the same pipe twice.
        self._near = self.location.distance
        self._senses.locate(self.location)
        legs.near = self._senses.location.distance

    def add_events(self, events: Iterable[Event]) -> None:
        """Keep events of the controller, of robots whose run is not over."""
        for event in events:
            if self.active[event.robot]:
                self.events[event.robot].append(event)

    def look_ahead(self, robots: NDArray[np.bool_]) -> None:
        """Let those of ``robots`` (n,) look ahead that have reached their next viewpoint."""
        looking = (self._senses.location.distance >= self._legs.look_at) & robots
        if not np.count_nonzero(looking) or not self._senses.can_look:
            return
        rows = np.flatnonzero(looking).tolist()
        for robot in rows:
            pilot, distance = self._legs.pilots[robot], self._senses.location.distance[robot]
            look = self._senses.look(robot, pilot.looks_back(float(distance)))
            self._follow(robot, pilot.on_look(look))
        self._locate_again(rows)

    def carry_out(self, verdicts: Sequence[Verdict]) -> None:
        """Put robots onto the legs that their pilots decide on verdicts; end the runs of others.

        Of several verdicts on a robot the first one counts.
        """
        sent: list[int] = []
        for robot, found in verdicts:
            if robot in sent or not self.active[robot]:
                continue
            decision = self._legs.pilots[robot].decide(found, self._situation(robot, found))
            if decision.leg is not None:
                sent.append(robot)
                self._follow(robot, decision)
            elif decision.doubt and self._senses.doubt(robot):
                continue
            elif (outcome := self._outcome(robot, found, decision)) is not None:
                self.events[robot] += decision.events
                self._end(robot, outcome)
        self._locate_again(sent)

    def _outcome(
        self, robot: int, found: Outcome | Hindrance, decision: Decision
    ) -> Outcome | None:
        """Outcome of a robot whose pilot knows no further leg; None: it drives on, and asks again.

        Off its route it drives on in whatever pipe it is, unless its pilot has given up.
        """
        if found is Hindrance.NO_HEADWAY:
            return self._monitor.cause(robot, self.location, self._readings)
        if found is Hindrance.OFF_ROUTE and decision.events:
            return Outcome.LEFT_PIPE
        return found if isinstance(found, Outcome) else None

    def end_outside(self, robots: NDArray[np.bool_]) -> None:
        """End the runs of those of ``robots`` (n,) that are truly in no pipe."""
        off = self._monitor.off_route(self.location) & robots & self.active
        for robot in np.flatnonzero(off).tolist() if np.count_nonzero(off) else ():
            if self._is_outside(robot):
                self._end(robot, Outcome.LEFT_PIPE)

    def _is_outside(self, robot: int) -> bool:
        """Return whether neither the centre of a robot nor its chassis is in a pipe.

        Of a robot that bends the point half-way between nose and tail need not lie in it.
        """
        scenario, centre = self._scenarios[robot], self._readings["position"][robot]
        own = scenario.robot.frame
        way = self._readings["rotation"][robot] @ own.rotation.T @ own.position
        network = scenario.route.network
        return not (network.holds(centre) or network.holds(centre - way))

    def _situation(self, robot: int, found: Outcome | Hindrance) -> Situation:
        """What a robot's pilot is told where it has to decide: by its senses, but for the goal."""
        senses, location = self._senses, self._senses.location
        position, axis = self._pose(robot)
        nose = position + self._scenarios[robot].robot.length / 2 * self._legs.gear[robot] * axis
        stands = found in (Outcome.REACHED_GOAL, Hindrance.NO_HEADWAY)
        return Situation(
            time=float(self._readings["time"][robot]),
            distance=float(location.distance[robot]),
            distance_std=float(senses.distance_std[robot]),
            goal=self._scenarios[robot].goal_at(nose) if stands else "",
            position=senses.readings["position"][robot],
            axis=senses.readings["rotation"][robot, :, 2],
            across=bool(location.tilt[robot] > LEG_PLANNER.along),
        )

    def _pose(self, robot: int) -> tuple[Array, Array]:
        """The true position (3,) m of a robot and the direction (3,) of its nose, world frame."""
        return self._readings["position"][robot], self._readings["rotation"][robot, :, 2]

    def _follow(self, robot: int, decision: Decision) -> None:
        """Carry out a pilot's decision for a robot, and extend its time limit accordingly."""
        length = self._legs.follow(robot, decision)
        if decision.shift:
            self._senses.shift(robot, decision.shift)
            self._monitor.shift_progress(robot, decision.shift)
        self.events[robot] += decision.events
        scenario = self._scenarios[robot]
        if decision.same_leg:
            # The fixed part of the time was granted when the leg began.
            more = scenario.time_for(length) - scenario.time_for(0.0)
            self._monitor.extend_time_limit(robot, more)
        else:
            self._monitor.start_leg(robot, scenario.time_for(length))

    def _locate_again(self, robots: Sequence[int]) -> None:
        """Find robots on their routes that are on another one now."""
        if robots:
            self._senses.update_maps(robots)
            self._near = with_rows(self._near, np.array(robots), self._legs.near[robots])
            self.locate(self._readings)

    def _end(self, robot: int, outcome: Outcome) -> None:
        """End a robot's run."""
        time, location = float(self._readings["time"][robot]), self.location
        goal = float(self._legs.end[robot])
        reason = self._monitor.reason(robot, location, goal, self._readings)
        reason += self._against_gear(robot)
        ending = Ending(outcome, reason)
        if outcome is Outcome.REACHED_GOAL:
            scenario, pilot = self._scenarios[robot], self._legs.pilots[robot]
            error = float(self._senses.location.distance[robot] - location.distance[robot])
            across = self._monitor.lies_across(robot, location)
            ending = ending_at_goal(scenario, pilot, reason, self._pose(robot), error, across)
        elif outcome is Outcome.LEFT_PIPE:
            place = ", ".join(f"{x:.3f}" for x in self._readings["position"][robot])
            off = f"left the pipe at ({place}) m, {location.offset[robot]:.3f} m off"
            ending = Ending(outcome, f"{off}; {reason}")
        self.endings[robot] = ending
        set_rows(self, np.array([robot]), active=False, end_time=time)

    def _against_gear(self, robot: int) -> str:
        """Return words on a robot that is ahead of where a leg in reverse gear began; "" if not."""
        leg, length = self._legs.pilots[robot].leg, self._scenarios[robot].robot.length
        gone = float(leg.begin - self.location.distance[robot])
        # The leg begins at an estimate, which may be off by some centimetres.
        if leg.gear > 0 or gone < length / 4:
            return ""
        return (
            f"; it moved nose first by {1000 * gone:.0f} mm though its leg is driven tail first: "
            "controllers get `observation.gear`"
        )

    def progress(self, phase: Sequence[str]) -> tuple[float, str]:
        """Return the part of all tasks that is done, 0 to 1, and a text of time and place.

        The part never decreases. ``phase`` is of each robot.
        """
        running, distance, legs = np.flatnonzero(self.active), self.location.distance, self._legs
        part = np.ones(len(self.active))
        part[running] = [legs.pilots[i].done_at(float(distance[i])) for i in running]
        # A detour makes the way longer, and a robot may slide back: progress then stands still.
        self._done = max(self._done, float(part.mean()))
        text = f"{len(running)} of {len(part)} running"
        if len(part) == 1:
            route = legs.routes.routes[legs.route[0]]
            passage = route.passages[route.index_at(float(distance[0]))]
            text = f"{phase[0]} in {passage.part.name}"
        return self._done, f"{self._readings['time'].max():.0f} s, {text}"
