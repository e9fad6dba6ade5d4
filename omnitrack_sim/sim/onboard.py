"""Robots that know only what their own sensors say: sensors, estimate, and what a controller is
told."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.graft import graft
from omnitrack_sim.autonomy.localiser import Localiser
from omnitrack_sim.autonomy.search import Search, Searching
from omnitrack_sim.base.rotations import Array, heading, quaternion_from_matrix, turned_by
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.omnitrack.body import lug_pitch
from omnitrack_sim.robots.omnitrack.control.interface import Command
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.senses.cameras import camera_of
from omnitrack_sim.senses.draws import keys, normal, uniform
from omnitrack_sim.senses.eyes import Eyes, Mount
from omnitrack_sim.senses.proprioception import Felt, Proprioception
from omnitrack_sim.senses.sensor import State
from omnitrack_sim.senses.table import BeginTable, SensingTable
from omnitrack_sim.sim.builder import each
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.own_maps import OwnMaps
from omnitrack_sim.walls.rays import RayWalls

AROUND, SPACING, TURNS = 1.0, 0.02, 24
"""Stretch of the way before and behind it in which a robot that is lost looks for itself, m; the
distance of the places that it compares, m; and the turns about the axis at each."""
CHECK_EVERY = 1.0
"""Time between two checks of a robot's turn about its axis before a fitting, s."""
INSIDE = 0.03
"""A robot whose nose is farther inside a fitting than this, m, goes on with it."""


class Onboard:
    """Sensors and estimates of n robots.

    Args:
        scenarios: of the robots; they share ``[sensing]``.
        state: of the physics as they begin. torque_limit: (n,) N m.
        legs: of theirs. period: s between two control steps.

    Attributes:
        readings: what controllers see, (n, ...) by the names of the channels, robot frame.
        camera: at their ends. eyes: these cameras in the pipes as they are.
        localiser: where the robots take themselves to be.
        turned: (n, 3, 3) the robots' rotations by the gyro alone, without regard to any map: they
            drift, slowly.
        picture: (n, k) the last one that each has taken, of the pixels that robots compare with
            their map.
        whole: (n, pixels²) the picture that was taken at this moment, of all pixels, NaN of robots
            that took none, with the ends (n,) that it was taken from; None where none was, or
            nobody records them.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        state: State,
        torque_limit: Array,
        legs: Legs,
        period: float,
    ) -> None:
        first, n = scenarios[0], len(scenarios)
        table = _table(first)
        self._robot, self._period, self._routes = first.robot, period, legs.routes
        self._search = Search(table.search, first.robot, each(scenarios, "cruise_speed"))
        self._sure = np.radians(table.filter.sure_deg)
        mount = Mount(camera_of(table), first.robot)
        self.camera, optics = mount.camera, mount.camera.optics
        self._every = round(1 / (optics.rate * period))
        self._latency = round(optics.latency / period)
        self._both_ends, self._records = table.both_ends, first.record.pictures
        self.eyes = Eyes(mount, _true_walls(first), keys([_drawn_from(s) for s in scenarios]))
        gravity = each(scenarios, "gravity").astype(float)
        self._senses = Proprioception(
            table,
            first.robot,
            self.eyes.keys,
            gravity,
            torque_limit,
            period,
            lug_pitch(first.robot),
            state,
        )
        self._maps = OwnMaps(scenarios, legs)
        position, rotation, tangent = self._begin(scenarios, table, legs.route)
        self.localiser = Localiser(
            table,
            first.robot,
            mount,
            self._maps.walls,
            self._maps.which,
            gravity,
            position,
            rotation,
            tangent,
            period,
        )
        self._found: list[int] = []
        self._lost, self._checked = np.zeros(n, bool), np.full(n, -np.inf)
        self._tick, self._pictures = np.zeros(n, int), np.zeros(n, int)
        self._due = np.ones(n, bool)
        self.turned: Array = self.localiser.filter.rotation
        self.picture = np.full((n, len(self.localiser.pixels)), np.nan)
        self.whole: tuple[Array, NDArray[np.int_]] | None = None
        self._shoot(state, np.ones(n, np.int_), np.arange(n))
        self.readings = self._told(self._first_felt(state))

    def _begin(
        self,
        scenarios: Sequence[Scenario],
        table: SensingTable,
        route: NDArray[np.intp],
    ) -> tuple[Array, Array, Array]:
        """Where the robots take themselves to be, and the direction of the pipe there."""
        start = table.start
        distance = each(scenarios, "distance").astype(float)
        distance = distance + start.distance_std * normal(self.eyes.keys, "start", 0, 1)[:, 0]
        theta5 = np.radians(each(scenarios, "theta5_deg").astype(float))
        if not start.theta5_known:
            theta5 = theta5 + 2 * np.pi * uniform(self.eyes.keys, "theta5", 0, 1)[:, 0]
        position, rotation = self._routes.start_poses(route, distance, theta5)
        return position, rotation, rotation[:, :, 2]

    @property
    def takes_pictures(self) -> bool:
        """Whether any camera takes a picture at this control step."""
        return bool(np.count_nonzero(self._due))

    def learn(self, robots: Collection[int], location: Location) -> None:
        """Robots that took themselves to be at ``location`` may have changed their maps."""
        for robot in robots:
            self._maps.learn(robot, location, self.localiser)

    def shift(self, robot: int, location: Location, more: float) -> None:
        """Move the estimate of a robot at ``location`` by ``more`` m along its route."""
        self._maps.shift(robot, location, more, self.localiser)

    def restart(
        self,
        robots: NDArray[np.intp],
        scenarios: Sequence[Scenario],
        state: State,
        torque_limit: Array,
    ) -> None:
        """Have ``robots`` (k,), which do not explore, begin anew with ``scenarios`` (k).

        Args:
            robots: their numbers. scenarios: of theirs.
            state: of the physics of all as it is now. torque_limit: (k,) N m.
        """
        begun = state.rows(robots)
        fresh = Onboard(scenarios, begun, torque_limit, Legs(scenarios), self._period)
        n = len(self._tick)
        graft(self, fresh, robots, n)
        graft(self.eyes, fresh.eyes, robots, n)
        graft(self._senses, fresh._senses, robots, n)
        graft(self._search, fresh._search, robots, n)
        self.localiser.restart(robots, fresh.localiser)
        told = {name: values.copy() for name, values in self.readings.items()}
        for name, values in told.items():
            values[robots] = fresh.readings[name]
        self.readings = told
        self._found = [robot for robot in self._found if robot not in robots]

    def look(
        self, state: State, gear: NDArray[np.int_], location: Location, active: NDArray[np.bool_]
    ) -> None:
        """Read the sensors at this moment and bring the estimate up to it; ``location`` is the
        estimate of a moment ago. Robots that are not ``active`` (n,) any more take
        no pictures."""
        self._tick = self._tick + 1
        self._due = self._tick % self._every == 0
        self.whole = None
        felt = self._senses.read(state)
        self.localiser.feel(felt)
        bias = self.localiser.filter.bias
        self.turned = self.turned @ turned_by(felt.turned - bias * self._period)
        if self.takes_pictures:
            behind = (self._pictures % 2 == 1) & self._both_ends
            facing = np.where(behind, -gear, gear)
            self._shoot(state, facing, np.flatnonzero(active & self._due))
        if self.localiser.see(active):
            shot = self.localiser.shot
            assert shot is not None
            seeing = active & shot.taken
            if np.count_nonzero(self.localiser.puzzled & seeing):
                self._look_along_the_way(location, gear, seeing)
            self._check_turns(location, gear, seeing)
        self.readings = self._told(felt)

    def _check_turns(
        self, location: Location, gear: NDArray[np.int_], active: NDArray[np.bool_]
    ) -> None:
        """Have robots that stand before a fitting check that they are turned as they believe, when
        they come there and every second from then on: a wrong turn may fit its surroundings so well
        that small steps do not lead out of it."""
        before = self._before(location)
        time, shot = self.readings["time"], self.localiser.shot
        assert shot is not None
        due = active & before & (time > self._checked + CHECK_EVERY) & (shot.facing == gear)
        robots = np.flatnonzero(due & ~self.localiser.unknown)
        if len(robots):
            self._checked[robots] = time[robots]
            self.localiser.verify(robots)

    def _before(self, location: Location) -> NDArray[np.bool_]:
        """Robots (n,) that are about to enter a fitting."""
        room = self._routes.nose_room(location, self._robot.length)
        return (room <= self._robot.standing_room) & (room > -INSIDE)

    def _look_along_the_way(
        self, location: Location, gear: NDArray[np.int_], active: NDArray[np.bool_]
    ) -> None:
        """Have robots whose pictures are not those of the map compare all poses around."""
        localiser, routes = self.localiser, self._routes
        robots = np.flatnonzero(localiser.puzzled & active)
        shot = localiser.shot
        assert shot is not None
        steps = np.arange(-AROUND, AROUND + SPACING / 2, SPACING)
        distance = location.distance[robots, None] + steps  # (m, c)
        route = np.repeat(location.route[robots], len(steps))
        longest = routes.lengths[route].reshape(distance.shape)
        distance = np.clip(distance, 0.0, longest)
        places, frames = [], []
        for turn in np.arange(TURNS) * 2 * np.pi / TURNS:
            found, frame = routes.poses(route, distance.ravel(), np.full(len(route), turn))
            places.append(found.reshape(len(robots), -1, 3))
            frames.append(frame.reshape(len(robots), -1, 3, 3))
        frame = heading(np.concatenate(frames, axis=1), gear[robots][:, None])
        found = localiser.seek(robots, shot, np.concatenate(places, axis=1), frame)
        self._found = robots[found].tolist()

    def near(self, near: Array, route: NDArray[np.intp]) -> Array:
        """``near`` (n,) m, and for robots that have found themselves just now the arc length of
        that place of their way (n,) that they are nearest to."""
        if not self._found:
            return near
        near = near.copy()
        for robot in self._found:
            along = np.arange(0.0, float(self._routes.lengths[route[robot]]), SPACING)
            points = self._routes.poses(np.full(len(along), route[robot]), along, 0 * along)[0]
            aside = ((points - self.localiser.filter.position[robot]) ** 2).sum(axis=-1)
            near[robot] = along[aside.argmin()]
        self._found = []
        return near

    def lost(self, location: Location) -> NDArray[np.bool_]:
        """Robots (n,) that do not know where they are: their pictures are not those of the map, or
        they stand before a fitting and do not know well enough how they are turned."""
        before = self._before(location)
        assert location.sure is not None
        unsure = ~location.sure
        # Stepping back from the fitting does not make it know more.
        self._lost = self.localiser.puzzled | (unsure & (before | self._lost))
        return self._lost

    def guarded(self, command: Command, location: Location, roll: Array) -> Searching:
        """A command, less what robots that do not know where they are may not do; who gives up;
        and what there is to tell. ``roll`` (n, 3) rad, as controllers see it."""
        return self._search.step(command, self.lost(location), self.readings["time"], roll)

    def _shoot(self, state: State, facing: NDArray[np.int_], robots: NDArray[np.intp]) -> None:
        """Have robots (m,) take a picture of the pipes as they are; ``facing`` (n,): 1 from the
        nose, -1 from the tail."""
        compared = self.localiser.pixels
        pixels = np.arange(len(self.eyes.mount.rays)) if self._records else compared
        metered = np.searchsorted(pixels, compared)
        numbers = self._pictures[robots]
        number = int(numbers[0]) if np.ptp(self._pictures) == 0 else numbers
        position, rotation = state["position"][robots], state["rotation"][robots]
        taken = self.eyes.take(robots, position, rotation, facing[robots], number, pixels, metered)
        self.picture = self.picture.copy()
        self.picture[robots] = taken[:, metered]
        if self._records:
            whole = np.full((len(facing), len(pixels)), np.nan)
            whole[robots] = taken
            self.whole = (whole, facing)
        self.localiser.shoot(self.picture, facing, self._latency, self._due)
        self._pictures = self._pictures + self._due

    def _told(self, felt: Felt) -> Mapping[str, Array]:
        """What controllers see."""
        pose = self.localiser.filter
        return {
            "time": felt.time,
            "position": pose.position,
            "quaternion": quaternion_from_matrix(pose.rotation),
            "rotation": pose.rotation,
            "angular_velocity": felt.angular_velocity - pose.bias,
            "belt_speed": felt.belt_speed,
            "wall_speed": felt.belt_speed * belt_sign(felt.roll),
            "motor_torque": felt.motor_torque,
            "slide": felt.slide,
            "roll": felt.roll,
        }

    def _first_felt(self, state: State) -> Felt:
        """What the robots feel before they have moved."""
        nothing = np.zeros((len(self.eyes.keys), 3))
        return Felt(
            time=state["time"],
            travel=nothing,
            belt_speed=nothing,
            roll=state["roll"],
            slide=state["slide"],
            motor_torque=nothing,
            turned=nothing,
            angular_velocity=nothing,
            force=nothing,
        )

    def location(self, location: Location) -> Location:
        """A place on the route, found from the estimate, with its standard deviations."""
        pose = self.localiser.filter
        axis = location.frame[:, :, 2]
        about = pose.std_about(axis)
        across = np.sqrt(
            (
                pose.std_about(location.frame[:, :, 0]) ** 2
                + pose.std_about(location.frame[:, :, 1]) ** 2
            )
            / 2
        )
        theta5_std = np.where(self.localiser.unknown, np.pi, about)
        return replace(
            location,
            distance_std=pose.std_along(location.tangent),
            theta5_std=theta5_std,
            sure=(theta5_std <= self._sure) & ~self.localiser.puzzled,
            tilt_std=across,
        )

    def estimates(self, location: Location) -> Mapping[str, Array]:
        """Values of the channels ``ESTIMATES``, at a place that ``location`` has returned."""
        assert location.distance_std is not None
        assert location.theta5_std is not None
        assert location.tilt_std is not None
        return {
            "position_estimate": self.localiser.filter.position,
            "distance_estimate": location.distance,
            "distance_std": location.distance_std,
            "theta5_estimate": location.theta5,
            "theta5_std": location.theta5_std,
            "tilt_estimate": location.tilt,
            "tilt_std": location.tilt_std,
            "misfit": self.localiser.misfit,
        }


def _table(scenario: Scenario) -> SensingTable:
    """What robots know of themselves. The frame of a map that a robot makes begins where it stands:
    it knows its place by definition."""
    table = scenario.sensing
    if scenario.exploration is None:
        return table
    start = BeginTable(distance_std=0.0, theta5_known=True)
    return table.model_copy(update={"start": start})


def _true_walls(scenario: Scenario) -> RayWalls:
    """The pipes as they are."""
    parts, plates = scenario.route.network.parts, scenario.plates
    if scenario.exploration is not None:
        parts, plates = scenario.exploration.in_sight()
    return RayWalls([parts], [plates])


def _drawn_from(scenario: Scenario) -> str:
    """What a robot's random numbers are drawn from: its scenario, but for whether its pictures are
    recorded."""
    text = scenario.model_dump_json(exclude={"record": {"pictures"}})
    return hashlib.sha256(text.encode()).hexdigest()
