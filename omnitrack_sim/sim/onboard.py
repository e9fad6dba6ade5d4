"""Senses of robots that drive by onboard sensors: measurements and estimates."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.camera_sight import CameraSight, behind_lens
from omnitrack_sim.autonomy.localiser import Localiser
from omnitrack_sim.autonomy.own_maps import OwnMaps, bends_otherwise, shift_of_part
from omnitrack_sim.autonomy.pose_filter import PLACE, TURN
from omnitrack_sim.autonomy.relocalisation import PoseSearch, Relocaliser
from omnitrack_sim.autonomy.sight import Look, Sighting, is_right
from omnitrack_sim.base.rotations import (
    Array,
    Pose,
    heading,
    quaternion_from_matrix,
    set_rows,
    with_rows,
)
from omnitrack_sim.pipes import Passage
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.events import Event
from omnitrack_sim.record.metrics import ESTIMATES
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.robots.odometry import BodyReadings, check_shapes, odometry_of
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.senses.draws import Keys, keys, normal, uniform
from omnitrack_sim.senses.optics import Camera, Eyes, Mount
from omnitrack_sim.senses.proprioception import Proprioception, ProprioceptiveReadings
from omnitrack_sim.senses.settings import BeginTable, SensingTable, camera_of
from omnitrack_sim.sim.builder import each
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.odometry_check import OdometryCheck
from omnitrack_sim.sim.picture_taking import PictureTaking
from omnitrack_sim.sim.sensing import frame_ahead
from omnitrack_sim.walls.rays import RayWalls


class Onboard:
    """Senses of n robots that drive by their own sensors; see ``Senses``.

    Args:
        scenarios: of the robots; they share ``[sensing]``.
        legs: of theirs.
        state: of the physics as they begin.

    Attributes:
        taking: of their pictures.
        localiser: where the robots take themselves to be.
        body: readings of their bodies' sensors at this moment.
    """

    body: BodyReadings

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs, state: State) -> None:
        first, n = scenarios[0], len(scenarios)
        table, network = _table(first), first.route.network
        period = first.physics.control_period
        self._odometry, self._legs, self._table = odometry_of(first.robot), legs, table
        check_shapes(self._odometry, state)
        self._period = period
        mount = Mount(camera_of(table), self._odometry.lens)
        self._maps = OwnMaps(legs.pilots, network.parts, network.closed_ends)
        self.localiser = Localiser(
            table, self._odometry, mount, self._maps.walls, self._maps.which, period
        )
        self._relocaliser = Relocaliser(legs.routes, first.robot, self.localiser)
        self._search = PoseSearch(table.search, self._odometry, n)
        self._proprioception = Proprioception(table, self._odometry, period, state)
        self._check = OdometryCheck(type(self._odometry).__name__, first.robot.length / 4, state)
        self._remarks: list[Event] = []
        exploration, pipes = first.exploration, (network.parts, first.plates)
        parts, plates = pipes if exploration is None else exploration.in_sight()
        eyes = Eyes(mount, RayWalls([parts], [plates], dirty=True), n)
        compared = self.localiser.pixels
        self.taking = PictureTaking(eyes, period, table.both_ends, compared, first.record.pictures)
        self._sight = ScoredSight(eyes, table, scenarios)
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
        self._proprioception.reset(rows, key, gravity, [s.robot for s in scenarios], state)
        self._check.reset(rows, state)
        self._search.reset(rows, each(scenarios, "cruise_speed"))
        self._relocaliser.reset(rows)
        for row in rows.tolist():
            self._maps.renew(row)
        self.localiser.reset(rows, gravity, position, rotation)
        self._sight.reset(rows, scenarios)
        self.taking.reset(rows, key)
        self._state, n = state, len(state["time"])
        first = with_rows(np.zeros(n, bool), rows, True)
        self._take_pictures(np.ones(n, np.int_), first, first)
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
    def camera(self) -> Camera:
        """The camera at their ends."""
        return self.taking.eyes.mount.camera

    @property
    def picture(self) -> Array:
        """Last picture (n, k) of each robot, of the pixels that are compared with its map."""
        return self.taking.picture

    @property
    def can_look(self) -> bool:
        """See ``Senses``: any camera takes a picture at this control step."""
        return bool(np.count_nonzero(self.taking.due))

    @property
    def distance_std(self) -> Array:
        """See ``Senses``."""
        return self.localiser.filter.std(PLACE, self.location.tangent)

    def read(self, state: State, active: NDArray[np.bool_]) -> None:
        """See ``Senses``: read the sensors at this moment and bring the estimate up to it.

        Robots that are not ``active`` (n,) any more take no pictures.
        """
        gear, self._state = self._legs.gear, state
        self.taking.advance()
        measured = self._proprioception.read(state)
        pose = self.localiser.filter
        before = pose.position, pose.rotation
        self.localiser.predict(measured)
        self._remarks = self._check.compare(self.localiser.travel, state, active)
        # The estimate of a robot whose run is over stays as it was, however long the others run.
        pose.position = np.where(active[:, None], pose.position, before[0])
        pose.rotation = np.where(active[:, None, None], pose.rotation, before[1])
        if self.can_look:
            self._take_pictures(self.taking.facing(gear), self.taking.due, active)
        if self.localiser.see(active):
            shot = self.localiser.shot
            assert shot is not None
            time = self.readings["time"]
            self._relocaliser.check(self.location, gear, time, active & shot.taken)
        self.readings = self._observed(measured)

    def _take_pictures(
        self, facing: NDArray[np.int_], due: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> None:
        """Take pictures and send them to the localiser; arguments as of ``PictureTaking.take``."""
        self.taking.take(self._state, facing, due, active)
        self.localiser.shoot(self.taking.picture, facing, self.taking.latency, due)

    def locate(self, truth: Location) -> None:
        """See ``Senses``: the location of the estimate, with its standard deviations."""
        legs, pose = self._legs, self.localiser.filter
        # As controllers receive the pose at this step, also where a new map has just moved it.
        frames, position = heading(self.readings["rotation"], legs.gear), self.readings["position"]
        near = self._relocaliser.take_nearest(legs.route, legs.near)
        location = legs.routes.locate(position, frames, legs.route, near)
        about = pose.std(TURN, location.frame[:, :, 2])
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

    def guard(self, command: Any) -> tuple[Any, NDArray[np.bool_]]:
        """See ``Senses``."""
        gear = self._legs.gear
        readings = self._odometry.to_controller(self.readings, gear, self.channels)
        self._relocaliser.update_lost(self.location)
        command, lost = self._search.step(command, self._relocaliser.lost, readings, gear)
        if self._remarks:
            command = command._replace(events=[*command.events, *self._remarks])
        return command, lost

    def look(self, robot: int, back: bool) -> Look:
        """See ``Senses``: by a picture of each end."""
        gear = int(self._legs.gear[robot])
        rotation, position = (self.readings[name][robot] for name in ("rotation", "position"))
        at = Pose(frame_ahead(rotation, gear), position)
        return Look(
            float(self.readings["time"][robot]),
            float(self.location.distance[robot]),
            self._look_towards(robot, gear, at),
            self._look_towards(robot, -gear) if back else None,
            at.rotation,
            float(self._odometry.bore(self.body)[robot]),
            float(self.distance_std[robot]),
        )

    def _look_towards(self, robot: int, gear: int, estimate: Pose | None = None) -> Sighting | None:
        """Return a robot's view ahead in a gear; ``estimate``: see ``CameraSight.look``."""
        frame = frame_ahead(self._state["rotation"][robot], gear)
        truth = Pose(frame, self._state["position"][robot])
        route = self._legs.routes.routes[self._legs.route[robot]]
        lens = float(self.location.distance[robot]) + self.taking.eyes.mount.ahead
        return self._sight.look(robot, truth, behind_lens(route, lens), estimate)

    def metrics(self, robot: int) -> Mapping[str, float]:
        """See ``Senses``: recognition rate of a robot that explores; NaN without any look."""
        if self._legs.pilots[robot].belief is None:
            return {}
        return {"fitting_recognition_rate": self._sight.rate(robot)}

    def update_maps(self, robots: Collection[int]) -> None:
        """See ``Senses``: the estimate moves along with the part of the map that the robot is in.

        Its pose is known relative to its surroundings.
        """
        for robot in robots:
            change = self._maps.renew(robot)
            if change is None:
                continue
            if bends_otherwise(*change):
                # A fitting behind the robot: the robot is as far along its route as it was, and
                # less sure of its position. How it is turned it knows as before: the gyro has
                # measured both that and the bend.
                start, end = self._on_routes(robot, int(self._legs.route[robot]), 0.0)
                self.localiser.move(robot, start, Pose(start.rotation, end.position))
                self.localiser.inflate(robot)
                continue
            shift = shift_of_part(*change, self.localiser.filter.position[robot])
            if shift is not None:
                self.localiser.move(robot, *shift)

    def shift(self, robot: int, more: float) -> None:
        """See ``Senses``."""
        route = int(self.location.route[robot])
        self.localiser.move(robot, *self._on_routes(robot, route, more))

    def _on_routes(self, robot: int, route: int, more: float) -> tuple[Pose, Pose]:
        """Return poses of the centreline at a robot's location, and ``more`` m on, on ``route``."""
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
        return self.taking.pictures()

    def _observed(self, measured: ProprioceptiveReadings) -> Mapping[str, Array]:
        """Return the readings that controllers receive."""
        pose, self.body = self.localiser.filter, measured.body
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
            "tilt_std": self.localiser.filter.tilt_std(location),
            "misfit": self.localiser.misfit,
        }


class ScoredSight:
    """Sight of n robots by their cameras, whose recognition is judged by the truth.

    Args:
        eyes: cameras of the robots.
        table: ``[sensing]``.
        scenarios: of the robots.
    """

    def __init__(self, eyes: Eyes, table: SensingTable, scenarios: Sequence[Scenario]) -> None:
        self._sight = CameraSight(eyes, table)
        self._true_sights = [scenario.sight for scenario in scenarios]
        self._comparable, self._right = np.zeros((2, len(scenarios)))

    def reset(self, rows: NDArray[np.intp], scenarios: Sequence[Scenario]) -> None:
        """Begin anew for robots ``rows`` (k,) with ``scenarios`` (k)."""
        self._sight.reset(rows)
        for row, scenario in zip(rows.tolist(), scenarios, strict=True):
            self._true_sights[row] = scenario.sight
        set_rows(self, rows, _comparable=0.0, _right=0.0)

    def look(
        self, robot: int, truth: Pose, passage: Passage, estimate: Pose | None
    ) -> Sighting | None:
        """Return the sighting of one robot; arguments as of ``CameraSight.look``."""
        ahead = self._sight.look(robot, truth, passage, estimate)
        true = self._true_sights[robot].look(robot, truth.position, truth.rotation)
        if ahead is not None and true is not None:
            self._comparable[robot] += 1
            self._right[robot] += is_right(ahead, true)
        return ahead

    def rate(self, robot: int) -> float:
        """Return the part of a robot's sightings that are right; not a number without any."""
        count = self._comparable[robot]
        return float(self._right[robot] / count) if count else np.nan


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
    """Return the key of a robot's random numbers, of its seed and world.

    So controllers and designs that are compared in one world have the same noise.
    """
    world = dict.fromkeys(("seed", "pipes", "network", "start", "world"), True)
    text = scenario.model_dump_json(include={**world, "mission": {"start": True}})
    return hashlib.sha256(text.encode()).hexdigest()
