"""Senses of robots that drive by onboard sensors: measurements and estimates."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.camera_sight import CameraSight, behind_lens
from omnitrack_sim.autonomy.localiser import Localiser
from omnitrack_sim.autonomy.pose_filter import PLACE, POSE, TURN
from omnitrack_sim.autonomy.relocalisation import Search
from omnitrack_sim.autonomy.sight import Look, Sighting, is_right
from omnitrack_sim.base.rotations import (
    Array,
    Pose,
    heading,
    quaternion_from_matrix,
    set_rows,
    with_rows,
)
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.metrics import ESTIMATES
from omnitrack_sim.results.pictures import Album, Pictures, coding_of
from omnitrack_sim.robots.odometry import odometry_of
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.senses.draws import Keys, keys, normal, uniform
from omnitrack_sim.senses.optics import Eyes, Mount
from omnitrack_sim.senses.proprioception import Proprioception, ProprioceptiveReadings
from omnitrack_sim.senses.settings import BeginTable, SensingTable, camera_of
from omnitrack_sim.sim.builder import each
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.sensing import frame_ahead
from omnitrack_sim.walls.rays import RayWalls


@dataclass(frozen=True)
class RelocalisationSettings:
    """Extent of relocalisation by pictures: a robot that has slipped in a tee is found again, and
    no value is sharp.

    Attributes:
        reach: m, length of route before and behind a robot that is searched: it slips no farther.
        spacing: m, between the positions compared: about what a pose is corrected by from there.
        turns: turns about the axis compared at each position.
        check_period: s, between two checks of a robot's turn about its axis before a fitting.
        committed: m, depth of a robot's nose in a fitting from which on it goes on with it.
        map_shift: m, by which a part of a map has to move: lengths are rounded to it.
    """

    reach: float = 1.0
    spacing: float = 0.02
    turns: int = 24
    check_period: float = 1.0
    committed: float = 0.03
    map_shift: float = 1e-6


RELOCALISATION = RelocalisationSettings()

LEAST_NEARER = 0.25
"""Least part of a bend's radius at which a robot's centre counts as away from the bend's axis: at
the axis, all points of the bend are equally near."""


class Onboard:
    """Senses of n robots that drive by their own sensors; see ``Senses``.

    Args:
        scenarios: of the robots; they share ``[sensing]``.
        legs: of theirs.
        state: of the physics as they begin.

    Attributes:
        camera: at their ends.
        eyes: these cameras in the pipes as they are.
        localiser: where the robots take themselves to be.
        turned: (n, 3, 3) the robots' rotations by the gyro alone, without regard to any map: they
            drift, slowly.
        picture: (n, k) the last one that each has taken, of the pixels that robots compare with
            their map.
    """

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs, state: State) -> None:
        first, n = scenarios[0], len(scenarios)
        table, period = _table(first), first.physics.control_period
        self._robot, self._odometry = first.robot, odometry_of(first.robot)
        self._period, self._legs, self._table = period, legs, table
        self._search = Search(table.search, self._odometry, n)
        mount = Mount(camera_of(table), self._odometry.lens)
        self.camera, optics = mount.camera, mount.camera.optics
        self._every = round(1 / (optics.rate * period))
        self._latency = round(optics.latency / period)
        self._records = first.record.pictures
        self._album = Album(coding_of(self.camera), n) if self._records else None
        exploration, pipes = first.exploration, (first.route.network.parts, first.plates)
        parts, plates = pipes if exploration is None else exploration.in_sight()
        self.eyes = Eyes(mount, RayWalls([parts], [plates], dirty=True), n)
        self._proprioception = Proprioception(table, self._odometry, period, state)
        beliefs = [pilot.belief for pilot in legs.pilots]
        self._networks = [None if belief is None else belief.network for belief in beliefs]
        # Robots that make no map share the true one, with its caps and less its plates.
        which: NDArray[np.intp] = np.zeros(n, np.intp)
        maps = [(first.route.network.parts, first.route.network.closed_ends, ())]
        if any(self._networks):
            maps = [maps[0] if belief is None else belief.reliable_parts() for belief in beliefs]
            which = np.arange(n)
        self._walls = RayWalls(*zip(*maps, strict=True))
        self.localiser = Localiser(table, self._odometry, mount, self._walls, which, period)
        self._sight = CameraSight(self.eyes, table)
        self._true_sights = [scenario.sight for scenario in scenarios]
        self._comparable, self._right = np.zeros((2, n))  # looks that can be judged, and the right
        self._relocated: list[int] = []
        self._lost, self._checked = np.zeros(n, bool), np.zeros(n)
        self._tick, self._pictures = np.zeros((2, n), int)
        self._due = np.zeros(n, bool)
        self.picture = np.zeros((n, len(self.localiser.pixels)))
        self.readings: Mapping[str, Array] = {}
        self.recorded: Sequence[Channel] = ESTIMATES
        self.reset(np.arange(n), scenarios, state)
        self.channels: Sequence[Channel] = [
            first.robot.channels[name] for name in (*self.readings, "quaternion")
        ]

    def reset(self, rows: NDArray[np.intp], scenarios: Sequence[Scenario], state: State) -> None:
        """See ``Senses``."""
        key = keys([_drawn_from(scenario) for scenario in scenarios])
        gravity = each(scenarios, "gravity").astype(float)
        position, rotation = self._first_pose(rows, scenarios, key)
        self.eyes.reset(rows, key)
        self._proprioception.reset(rows, key, gravity, [s.robot for s in scenarios], state)
        self._search.reset(rows, each(scenarios, "cruise_speed"))
        for row in rows.tolist():
            self._renew(row)
        self.localiser.reset(rows, gravity, position, rotation)
        self._sight.reset(rows)
        for row, scenario in zip(rows.tolist(), scenarios, strict=True):
            self._true_sights[row] = scenario.sight
        set_rows(self, rows, _lost=False, _checked=-np.inf, _comparable=0.0, _right=0.0)
        set_rows(self, rows, _tick=0, _pictures=0, _due=True, picture=np.nan)
        self._relocated = [robot for robot in self._relocated if robot not in rows]
        self._state, n = state, len(self._tick)
        first = with_rows(np.zeros(n, bool), rows, True)
        self._shoot(np.ones(n, np.int_), first, first)
        begun = self._observed(self._proprioception.at_rest(state))
        self.readings = _Readings(
            (name, with_rows(self.readings.get(name, values), rows, values[rows]))
            for name, values in begun.items()
        )

    def _first_pose(
        self, rows: NDArray[np.intp], scenarios: Sequence[Scenario], key: Keys
    ) -> tuple[Array, Array]:
        """Positions (k, 3) m and rotations (k, 3, 3) at which robots take themselves to begin."""
        start = self._table.start
        distance = each(scenarios, "distance").astype(float)
        # The robot stands where the scenario says; its belief about that is off by a draw.
        distance = distance + start.distance_std * normal(key, "start", 0, 1)[:, 0]
        theta5 = np.radians(each(scenarios, "theta5_deg").astype(float))
        if not start.theta5_known:
            theta5 = theta5 + 2 * np.pi * uniform(key, "theta5", 0, 1)[:, 0]
        return self._legs.routes.start_poses(self._legs.route[rows], distance, theta5)

    @property
    def can_look(self) -> bool:
        """See ``Senses``: any camera takes a picture at this control step."""
        return bool(np.count_nonzero(self._due))

    @property
    def distance_std(self) -> Array:
        """See ``Senses``."""
        return self.localiser.filter.std(PLACE, self.location.tangent)

    def read(self, state: State, active: NDArray[np.bool_]) -> None:
        """See ``Senses``: read the sensors at this moment and bring the estimate up to it. Robots
        that are not ``active`` (n,) any more take no pictures."""
        gear, self._state = self._legs.gear, state
        self._tick = self._tick + 1
        self._due = self._tick % self._every == 0
        measured = self._proprioception.read(state)
        pose = self.localiser.filter
        before = pose.position, pose.rotation
        self.localiser.predict(measured)
        # The estimate of a robot whose run is over stays as it was, however long the others run.
        pose.position = np.where(active[:, None], pose.position, before[0])
        pose.rotation = np.where(active[:, None, None], pose.rotation, before[1])
        if self.can_look:
            # The ends take turns, the leading one first.
            behind = (self._pictures % 2 == 1) & self._table.both_ends
            self._shoot(np.where(behind, -gear, gear), self._due, active)
        if self.localiser.see(active):
            shot = self.localiser.shot
            assert shot is not None
            seeing = active & shot.taken
            if np.count_nonzero(self.localiser.inconsistent & seeing):
                self._look_along_the_way(self.location, gear, seeing)
            self._check_turns(self.location, gear, seeing)
        self.readings = self._observed(measured)

    def _check_turns(
        self, location: Location, gear: NDArray[np.int_], active: NDArray[np.bool_]
    ) -> None:
        """Verify the estimated orientation of robots in front of a fitting, on arrival and then
        every second: a wrong one may be a local minimum that small corrections do not leave."""
        before = self._before(location)
        time, shot = self.readings["time"], self.localiser.shot
        assert shot is not None
        due = (
            active
            & before
            & (time > self._checked + RELOCALISATION.check_period)
            & (shot.facing == gear)
        )
        robots = np.flatnonzero(due & ~self.localiser.unknown)
        if len(robots):
            self._checked[robots] = time[robots]
            self.localiser.verify(robots)

    def _before(self, location: Location) -> NDArray[np.bool_]:
        """Robots (n,) that are about to enter a fitting."""
        room = self._legs.routes.nose_room(location, self._robot.length)
        return (room <= self._robot.standing_room) & (room > -RELOCALISATION.committed)

    def _look_along_the_way(
        self, location: Location, gear: NDArray[np.int_], active: NDArray[np.bool_]
    ) -> None:
        """Compare the pictures of inconsistent robots with the map at all poses along the route."""
        localiser, routes = self.localiser, self._legs.routes
        robots = np.flatnonzero(localiser.inconsistent & active)
        shot = localiser.shot
        assert shot is not None
        reach, spacing = RELOCALISATION.reach, RELOCALISATION.spacing
        steps = np.arange(-reach, reach + spacing / 2, spacing)
        distance = location.distance[robots, None] + steps  # (m, c)
        route = np.repeat(location.route[robots], len(steps))
        longest = routes.lengths[route].reshape(distance.shape)
        distance = np.clip(distance, 0.0, longest)
        places, frames = [], []
        for turn in np.arange(RELOCALISATION.turns) * 2 * np.pi / RELOCALISATION.turns:
            points, frame = routes.poses(route, distance.ravel(), np.full(len(route), turn))
            places.append(points.reshape(len(robots), -1, 3))
            frames.append(frame.reshape(len(robots), -1, 3, 3))
        frame = heading(np.concatenate(frames, axis=1), gear[robots][:, None])
        relocated = localiser.seek(robots, shot, np.concatenate(places, axis=1), frame)
        self._relocated = robots[relocated].tolist()

    def locate(self, truth: Location) -> None:
        """See ``Senses``: the location on the route of the estimate, with its standard
        deviations."""
        legs, pose = self._legs, self.localiser.filter
        # As controllers receive the pose at this step, also where a new map has just moved it.
        frames = heading(self.readings["rotation"], legs.gear)
        location = legs.routes.locate(self.readings["position"], frames, legs.route, self._near())
        axis = location.frame[:, :, 2]
        about = pose.std(TURN, axis)
        self._true_passage = truth.passage
        # Nothing is known of the turn about the axis: half a turn either way.
        theta5_std = np.where(self.localiser.unknown, np.pi, about)
        sure = theta5_std <= np.radians(self._table.filter.sure_deg)
        self.location = replace(
            location,
            distance_std=pose.std(PLACE, location.tangent),
            theta5_std=theta5_std,
            sure=sure & ~self.localiser.inconsistent,
        )

    def _tilt_std(self, location: Location) -> Array:
        """Standard deviations (n,) of tilts, rad, in the direction across the pipe in which they
        are largest: in a bend, an error along the centreline turns the tangent as well."""
        tangent, normal = location.tangent, location.normal
        # Where a robot stands inside of a bend, the nearest point moves farther than it does.
        nearer = 1 - location.curvature * (location.aside * normal).sum(axis=-1)
        turns = (location.curvature / np.maximum(nearer, LEAST_NEARER))[:, None] * tangent
        across = np.stack([normal, np.cross(tangent, normal)], axis=1)  # (n, 2, 3)
        slopes = np.zeros((len(tangent), 2, POSE))
        slopes[:, :, TURN] = across
        slopes[:, 1, PLACE] = -turns
        covariance = self.localiser.filter.covariance[:, :POSE, :POSE]
        spread = slopes @ covariance @ np.swapaxes(slopes, 1, 2)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0))

    def _near(self) -> Array:
        """Arc lengths (n,) m from which locations are searched for: those of a moment ago; for
        robots that have just been relocalised, that of the route's point nearest to them."""
        near, routes = self._legs.near, self._legs.routes
        if self._relocated:
            near = near.copy()
        for robot in self._relocated:
            route = self._legs.route[robot]
            along = np.arange(0.0, float(routes.lengths[route]), RELOCALISATION.spacing)
            points = routes.poses(np.full(len(along), route), along, 0 * along)[0]
            aside = ((points - self.localiser.filter.position[robot]) ** 2).sum(axis=-1)
            near[robot] = along[aside.argmin()]
        self._relocated = []
        return near

    def guard(self, command: Any) -> tuple[Any, NDArray[np.bool_]]:
        """See ``Senses``."""
        gear = self._legs.gear
        readings = self._odometry.seen(self.readings, gear, self.channels)
        return self._search.step(command, self.lost(), readings, gear)

    def lost(self) -> NDArray[np.bool_]:
        """Robots (n,) that do not know where they are: their pictures are not those of the map, or
        they stand before a fitting and do not know well enough how they are turned."""
        before = self._before(self.location)
        assert self.location.sure is not None
        unsure = ~self.location.sure
        # Stepping back from the fitting does not make it know more.
        self._lost = self.localiser.inconsistent | (unsure & (before | self._lost))
        return self._lost

    def look(self, robot: int, back: bool) -> Look:
        """See ``Senses``: by a picture of each end."""
        gear = int(self._legs.gear[robot])
        rotation, position = (self.readings[name][robot] for name in ("rotation", "position"))
        at = Pose(frame_ahead(rotation, gear), position)
        return Look(
            float(self.readings["time"][robot]),
            float(self.location.distance[robot]),
            self._judged(robot, gear, at),
            self._judged(robot, -gear) if back else None,
            at.rotation,
            float(self._odometry.bore(self._body)[robot]),
            float(self.distance_std[robot]),
        )

    def _judged(self, robot: int, gear: int, estimate: Pose | None = None) -> Sighting | None:
        """Return a robot's view ahead; the recognition rate compares it with the truth."""
        position = self._state["position"][robot]
        frame = frame_ahead(self._state["rotation"][robot], gear)
        route = self._legs.routes.routes[self._legs.route[robot]]
        lens = float(self.location.distance[robot]) + self.eyes.mount.ahead
        ahead = self._sight.look(robot, Pose(frame, position), behind_lens(route, lens), estimate)
        truth = self._true_sights[robot].look(robot, position, frame)
        if ahead is not None and truth is not None:
            self._comparable[robot] += 1
            self._right[robot] += is_right(ahead, truth)
        return ahead

    def metrics(self, robot: int) -> Mapping[str, float]:
        """See ``Senses``: recognition rate of a robot that explores; NaN without any look."""
        if self._legs.pilots[robot].belief is None:
            return {}
        count = self._comparable[robot]
        return {"fitting_recognition_rate": float(self._right[robot] / count) if count else np.nan}

    def _renew(self, robot: int) -> bool:
        """Compare pictures with a robot's map as it is now; return True if it has changed."""
        belief = self._legs.pilots[robot].belief
        if belief is None or belief.network is self._networks[robot]:
            return False
        self._networks[robot] = belief.network
        self._walls.replace(robot, *belief.reliable_parts())
        return True

    def update_maps(self, robots: Collection[int]) -> None:
        """See ``Senses``. The estimate moves along with the part of the map that the robot is in,
        since its pose is known relative to its surroundings."""
        for robot in robots:
            before = self._networks[robot]
            if not self._renew(robot):
                continue
            after = self._networks[robot]
            assert before is not None
            assert after is not None
            self._move_along(robot, before, after)

    def _move_along(self, robot: int, before: Network, after: Network) -> None:
        """Move the estimate of a robot with the part of its map that it is in."""
        both = list(zip(before.pipes.parts, after.pipes.parts, strict=False))
        # Where a loop has closed the robot goes another way, and lies in its pipe as it did.
        closes = _loops(after) > _loops(before)
        if not closes and any(a.fitting != b.fitting and not a.fitting.is_plain for a, b in both):
            # A fitting behind the robot bends otherwise than was known: the robot is as far along
            # its route as it was, and less sure of its position. How it is turned it knows as
            # before: the gyro has measured both that and the bend.
            start, end = self._on_routes(robot, int(self._legs.route[robot]), 0.0)
            self.localiser.move(robot, start, Pose(start.rotation, end.position))
            self.localiser.inflate(robot)
            return
        here = self.localiser.filter.position[robot, None]
        # Pipe that was taken back may have given its number to another part.
        same = [pair for pair in both if pair[0].fitting.kind == pair[1].fitting.kind]
        part, moved = next((pair for pair in same if pair[0].holds(here, 0.0)), (None, None))
        if part is not None and moved is not None:
            port = part.fitting.port_names[0]
            start, end = part.port(port), moved.port(port)
            if np.linalg.norm(end.position - start.position) > RELOCALISATION.map_shift:
                self.localiser.move(robot, start, end)

    def shift(self, robot: int, more: float) -> None:
        """See ``Senses``."""
        route = int(self.location.route[robot])
        self.localiser.move(robot, *self._on_routes(robot, route, more))

    def _on_routes(self, robot: int, route: int, more: float) -> tuple[Pose, Pose]:
        """The poses of the centreline at a robot's location, and ``more`` m farther on
        ``route``."""
        both = np.array([self.location.route[robot], route])
        along = self.location.distance[robot] + np.array([0.0, more])
        points, frames = self._legs.routes.poses(both, along, np.zeros(2))
        return Pose(frames[0], points[0]), Pose(frames[1], points[1])

    def doubt(self, robot: int) -> bool:
        """See ``Senses``: it looks for itself."""
        self.localiser.reject(robot)
        return True

    def pictures(self) -> Sequence[Pictures | None]:
        """See ``Senses``."""
        return [None] * len(self._tick) if self._album is None else self._album.pictures()

    def _shoot(
        self, facing: NDArray[np.int_], due: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> None:
        """Take pictures of the true pipes for robots that are ``due`` (n,) and ``active`` (n,);
        ``facing`` (n,): 1 from the nose, -1 from the tail."""
        state, compared = self._state, self.localiser.pixels
        # A recorded picture has all pixels. Noise belongs to a pixel, so the compared ones are the
        # same.
        pixels = np.arange(len(self.eyes.mount.rays)) if self._records else compared
        metered = np.searchsorted(pixels, compared)
        robots = np.flatnonzero(due & active)
        numbers = self._pictures[robots]
        # One number for all robots is drawn faster, with the same result.
        number = int(numbers[0]) if np.ptp(self._pictures) == 0 else numbers
        position, rotation = state["position"][robots], state["rotation"][robots]
        taken = self.eyes.take(robots, position, rotation, facing[robots], number, pixels, metered)
        self.picture = with_rows(self.picture, robots, taken[:, metered])
        if self._album is not None:
            whole = np.full((len(facing), len(pixels)), np.nan)
            whole[robots] = taken
            self._album.add(state["time"], facing, whole, active)
        self.localiser.shoot(self.picture, facing, self._latency, due)
        self._pictures = self._pictures + due

    def _observed(self, measured: ProprioceptiveReadings) -> Mapping[str, Array]:
        """Return the readings that controllers receive."""
        pose, self._body = self.localiser.filter, measured.body
        return _Readings(
            time=measured.time,
            position=pose.position,
            rotation=pose.rotation,
            angular_velocity=measured.angular_velocity - pose.bias,
            **self._odometry.observed(measured.body, self._period),
        )

    def estimates(self) -> Mapping[str, NDArray]:
        """See ``Senses``."""
        location = self.location
        assert location.distance_std is not None
        assert location.theta5_std is not None
        return {
            "position_estimate": self.localiser.filter.position,
            "distance_estimate": location.distance,
            "distance_std": location.distance_std,
            # Where the robot takes itself to be past a fitting and is not, or the other way round,
            # two thetas before different fittings would differ by any angle.
            "theta5_estimate": self._legs.routes.theta5(location, self._true_passage),
            "theta5_std": location.theta5_std,
            "tilt_estimate": location.tilt,
            "tilt_std": self._tilt_std(location),
            "misfit": self.localiser.misfit,
        }


class _Readings(dict[str, Array]):
    """Readings (n, ...) of a moment; the quaternion is worked out when somebody asks for it."""

    def __missing__(self, name: str) -> Array:
        if name != "quaternion":
            raise KeyError(name)
        value = self[name] = quaternion_from_matrix(self["rotation"])
        return value


def _table(scenario: Scenario) -> SensingTable:
    """Return ``[sensing]``."""
    table = scenario.sensing
    if scenario.exploration is None:
        return table
    start = BeginTable(distance_std=0.0, theta5_known=True)
    return table.model_copy(update={"start": start})


def _drawn_from(scenario: Scenario) -> str:
    """Key of a robot's random numbers: seed and world, so that controllers and designs which are
    compared in one world have the same noise."""
    world = dict.fromkeys(("seed", "pipes", "network", "start", "world"), True)
    text = scenario.model_dump_json(include={**world, "mission": {"start": True}})
    return hashlib.sha256(text.encode()).hexdigest()


def _loops(network: Network) -> int:
    """Number of loops of a network: of joints beyond those that hold its parts together."""
    return len(network.joints) - len(network.fittings) + 1
