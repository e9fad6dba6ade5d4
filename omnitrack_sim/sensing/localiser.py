"""From what n robots feel and see to their poses in pipes that are on their map."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.robot import MODULE_ANGLES, Robot
from omnitrack_sim.rotations import Array, Pose, cross
from omnitrack_sim.sensing.graft import graft
from omnitrack_sim.sensing.nearby import nearby
from omnitrack_sim.sensing.optics import RANGE, Camera, Walls, rays_of
from omnitrack_sim.sensing.pose_filter import (
    BIAS,
    PLACE,
    POSE,
    SIZE,
    SLIP,
    TURN,
    PoseFilter,
    orthonormal,
    outer,
    wall_slopes,
)
from omnitrack_sim.sensing.proprioception import Felt, skew, turned_by
from omnitrack_sim.sensing.table import SensingTable
from omnitrack_sim.theory.kinematics import angular_velocity, belt_sign

FEELING = 0.1
"""Time between two uses of arms and accelerometer, s."""
HUBER = 2.0
"""Errors beyond so many standard deviations count less."""
WORST = 3.0
"""Errors beyond so many count as so many where poses are compared: at an edge between near and far
wall a pixel is as wrong as it can be."""
AT_STOP = 0.0005
"""Distance from its outer stop, m, at which an arm may have no wall."""
MOVED, TURNED = 5e-4, 5e-4
"""Steps, m and rad, between the pictures that the slopes of a picture are taken from."""
ROLLS = 36
"""Turns about the pipe's axis that a robot that does not know its own compares."""
DISTINCT = 0.3
"""Turns that differ by more, rad, are two answers."""
CONVINCED = 4.0
"""By how much the cost of any other answer has to be higher."""
FOUND_TURN, FOUND_AT = 0.1, 0.02
"""Standard deviations of a turn, rad, and of a place along the pipe, m, that were found among
candidates that far apart."""
BLUR = 4.0
"""Between candidates that far apart a pixel differs by so many standard deviations."""
CHECKED = 0.01
"""How far along its axis a robot looks that checks its turn, m."""
FINALISTS = 8
"""Candidates that are improved and compared again."""
NEAR_BY, NEAR_TURN = 0.03, 0.2
"""By how much a candidate is moved at most at once, m and rad."""
GOOD = 2.0
"""Cost, for each pixel that counts, up to which a pose explains its picture."""
DOUBT = 1e-3
"""Probability of all other turns together below which a robot takes the best."""
VAGUE = 0.01
"""Standard deviation of its place, m, from which on a robot compares places."""
RESTING = 1
"""Pictures of one end that a robot lets pass after one that told it nothing."""
PAUSE = 0
"""Pictures of each end that a robot lets pass between two for which it compares all turns."""
VAGUE_TURN = 0.02
"""Likewise of its turn about its axis, rad."""
WITHIN, FARTHEST = 3.0, 0.2
"""How far it looks, in standard deviations and at most in m."""
PLACES, FEW_PLACES, FEW_TURNS = 13, 3, 9
"""At how many places, at how many for all turns, and at how many turns."""
TOLD = 0.85
"""Part to which the variance has to fall by that."""
APART = 0.06
"""Places that are farther apart, m, are two answers."""
LOOSE_PLACE, LOOSE_TURN = 0.015, 0.03
"""Standard deviations, m and rad, that are added where a bend of the map is measured anew."""
FEW = 0.1
"""Part of the pixels of a picture with which it tells whether the map is right."""
BACKWARD = np.array([1.0, -1.0, -1.0])


class Shot(NamedTuple):
    """What is known of a picture when it is taken: where the robots took themselves to be, and
    which end it was taken from, 1 for the nose, -1 for the tail; which robots took one (n,)."""

    picture: Array
    position: Array
    rotation: Array
    facing: NDArray[np.int_]
    taken: NDArray[np.bool_]


class Localiser:
    """Where n robots are, on maps that they know.

    Args:
        table: ``[sensing]``. robot: shared by all. camera: at both ends of each.
        walls: of the maps. which: (n,) map of each robot.
        gravity: (n, 3) m/s², world frame, as the maps say.
        position: (n, 3) m. rotation: (n, 3, 3). Where the robots take themselves to be.
        direction: (n, 3), of the pipe that each begins in.
        period: s between two control steps.

    Attributes:
        filter: the estimate.
        misfit: (n,) median error of the last picture's pixels, in their standard deviations.
        unknown: (n,) bool, robots that do not know how they are turned about their axis.
        shot: the last picture that has arrived.
        pixels: (k,) those of a picture that are compared with the map, counted row by row.
    """

    def __init__(
        self,
        table: SensingTable,
        robot: Robot,
        camera: Camera,
        walls: Walls,
        which: NDArray[np.intp],
        gravity: Array,
        position: Array,
        rotation: Array,
        direction: Array,
        period: float,
    ) -> None:
        self._table, self._robot, self._camera, self._walls = table, robot, camera, walls
        self._which, self._gravity, self._period = which, gravity, period
        shares = table.filter
        self._share = shares.pixel_share if camera.lamp is None else shares.lamp_share
        n = len(position)
        self.filter = PoseFilter(
            position,
            rotation,
            _begin(table, direction),
            table.filter,
            table.imu,
            robot.nominal_pipe_radius,
        )
        self.misfit = np.zeros(n)
        self.unknown = np.full(n, not table.start.theta5_known)
        self._lens = robot.length / 2 + camera.optics.ahead
        pixels = np.arange(camera.optics.pixels**2).reshape(2 * (camera.optics.pixels,))
        rays = rays_of(camera.optics)
        stride = table.filter.stride
        self.pixels = pixels[stride // 2 :: stride, stride // 2 :: stride].ravel()
        self._rays = rays[self.pixels]
        row, column = np.divmod(np.arange(len(self.pixels)), int(np.sqrt(len(self.pixels))))
        self._coarse = np.flatnonzero((row + column) % 2 == 0)
        self._few = np.flatnonzero((row % 2 == 0) & (column % 2 == 0))
        self._arms = np.stack([np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES), np.zeros(3)], axis=-1)
        self._force, self._held = np.zeros((n, 3)), -self._in_robot(gravity)
        self._felt, self._clock = np.zeros(n, int), 0
        # Pictures of each end, tail and nose, to come until poses are compared again.
        self._rest = np.zeros((n, 2), np.intp)
        self._against = np.zeros((n, ROLLS))  # what pictures have said against each turn
        self._puzzled = np.zeros(n)  # s, how long pictures have not been those of the map
        self._steps = max(1, round(FEELING / period))
        self._slide = np.zeros((n, 3))
        self._arriving: deque[tuple[int, Shot]] = deque()
        self.shot: Shot | None = None

    def feel(self, felt: Felt) -> None:
        """Take in what the robots feel, at every control step."""
        at_wall = felt.travel * belt_sign(felt.roll)
        radius = self._robot.nominal_pipe_radius
        by_belts = angular_velocity(at_wall, 0.0, radius)
        differ = (by_belts - felt.turned)[:, :2] * radius
        skid = np.sqrt((differ**2).sum(axis=-1))
        self.filter.advance(at_wall.mean(axis=1), felt.turned, skid, self._period)
        self._force = self._force + felt.force / self._steps
        self._slide = felt.slide
        self._felt, self._clock = self._felt + 1, self._clock + 1
        due = self._felt % self._steps == 0
        if np.count_nonzero(due):
            self.filter.settle(due)
            information, evidence = self._from_arms()
            more, further = self._from_gravity()
            each = due[:, None]
            information = np.where(each[..., None], information + more, 0.0)
            evidence = np.where(each, evidence + further, 0.0)
            self.filter.correct(information, evidence, self.filter.position.copy())
            self._held = np.where(each, self._force, self._held)
            self._force = np.where(each, 0.0, self._force)

    def _in_robot(self, vector: Array) -> Array:
        """Vectors (n, 3) of the world in the robots' frames."""
        return np.einsum("nji,nj->ni", self.filter.rotation, vector)

    @property
    def puzzled(self) -> NDArray[np.bool_]:
        """Robots (n,) whose pictures have not been those of their map for a while."""
        return self._puzzled > self._table.filter.misfit_time

    def move(self, robot: int, before: Pose, after: Pose) -> None:
        """What stood at a pose ``before`` in a robot's map stands at ``after`` now, and the robot
        with it."""
        moved = after @ before.inverse()

        def with_it(position: Array, rotation: Array) -> tuple[Array, Array]:
            position, rotation = position.copy(), rotation.copy()
            position[robot] = moved.apply(position[robot])
            rotation[robot] = moved.rotation @ rotation[robot]
            return position, rotation

        pose = self.filter
        pose.position, pose.rotation = with_it(pose.position, pose.rotation)
        for i, (due, shot) in enumerate(self._arriving):
            position, rotation = with_it(shot.position, shot.rotation)
            self._arriving[i] = due, shot._replace(position=position, rotation=rotation)

    def loosen(self, robot: int) -> None:
        """A robot's map has changed around it: it is less sure of its pose."""
        covariance = self.filter.covariance.copy()
        covariance[robot, PLACE, PLACE] += LOOSE_PLACE**2 * np.eye(3)
        covariance[robot, TURN, TURN] += LOOSE_TURN**2 * np.eye(3)
        self.filter.covariance = covariance

    def doubt(self, robot: int) -> None:
        """What a robot takes for its pose cannot be: it is to look for itself."""
        self._puzzled[robot] = 2 * self._table.filter.misfit_time

    def _from_arms(self) -> tuple[Array, Array]:
        """Where an arm's module is pressed to the wall, the wall is as far as the arm reaches.

        Where the wall is not along the robot's axis, one end of the track touches it, and the
        middle may be off it by half of the track times the slope.
        """
        outermost = self._robot.slide_range[1] - AT_STOP
        reach = self._robot.nominal_pipe_radius + self._slide  # (n, 3) m
        lever = np.einsum("nij,nkj->nki", self.filter.rotation, reach[..., None] * self._arms)
        distance, gradient, part = self._walls.nearest(
            self._which, self.filter.position[:, None] + lever
        )
        held = (self._slide < outermost) & (part >= 0)
        slope = np.abs((gradient * self.filter.rotation[:, None, :, 2]).sum(axis=-1))
        spread = self._table.filter.arm_std + self._robot.contact_length / 2 * slope
        weight = held * _huber(distance / spread) / spread**2
        return _normal(wall_slopes(gradient, lever), -distance, weight)

    def _from_gravity(self) -> tuple[Array, Array]:
        """At rest the accelerometer measures the direction of what holds the robot up."""
        held = -np.einsum("nij,nj->ni", self.filter.rotation, self._force)  # (n, 3) world
        error = self._gravity - held
        slopes = np.zeros((len(held), 3, POSE))
        slopes[:, :, 3:] = -skew(held)
        weight = np.where(self.unknown, 0.0, 1.0 / self._table.filter.force_std**2)
        return _normal(slopes, error, np.repeat(weight[:, None], 3, axis=1))

    def restart(self, robots: NDArray[np.intp], fresh: Localiser) -> None:
        """Have ``robots`` (k,) begin anew as those of ``fresh``, which has k."""
        n = len(self.unknown)
        graft(self.filter, fresh.filter, robots, n)
        graft(self, fresh, robots, n)
        gone = np.isin(np.arange(n), robots)
        if self.shot is not None:
            self.shot = self.shot._replace(taken=self.shot.taken & ~gone)
        waiting = [(due, shot._replace(taken=shot.taken & ~gone)) for due, shot in self._arriving]
        for after, first in fresh._arriving:
            due = self._clock + after
            if not waiting or waiting[-1][0] != due:
                waiting.append((due, self._no_shot()))
            waiting[-1] = due, _with_rows(waiting[-1][1], robots, first)
        self._arriving = deque(waiting)

    def _no_shot(self) -> Shot:
        """A picture that no robot has taken."""
        n, pose = len(self.unknown), self.filter
        picture = np.full((n, len(self.pixels)), np.nan)
        return Shot(picture, pose.position, pose.rotation, np.ones(n, np.int_), np.zeros(n, bool))

    # Pictures

    def lens(
        self, position: Array, rotation: Array, facing: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        """Place (n, 3) m and frame (n, 3, 3) of a camera of robots at a pose; see ``Shot``."""
        frame = np.where((facing < 0)[:, None, None], rotation * BACKWARD, rotation)
        return position + self._lens * frame[:, :, 2], frame

    def shoot(
        self, picture: Array, facing: NDArray[np.int_], latency: int, taken: NDArray[np.bool_]
    ) -> None:
        """Pictures (n, k) are taken now by the robots ``taken`` (n,) and arrive ``latency`` control
        steps later."""
        shot = Shot(picture, self.filter.position, self.filter.rotation, facing, taken)
        self._arriving.append((self._clock + latency, shot))

    def see(self, active: NDArray[np.bool_]) -> bool:
        """Have ``active`` robots (n,) take in the pictures that arrive now, where there are any."""
        if not self._arriving or self._arriving[0][0] > self._clock:
            return False
        _, shot = self._arriving.popleft()
        self.shot = shot
        self.filter.settle(shot.taken)
        active = active & shot.taken
        end = (np.arange(len(shot.facing)), (shot.facing > 0).astype(np.intp))
        self._rest[end] -= shot.taken
        self._rested = (self._rest[end] < 0) & active
        if np.count_nonzero(self.unknown):
            self._find_turn(shot)
        self._narrow_down(shot)
        self._compare(self.shot, np.flatnonzero(active))
        return True

    def _compare(self, shot: Shot, robots: NDArray[np.intp]) -> None:
        """Correct the poses of robots (m,) by what the picture has other than expected."""
        rays = self._rays
        position, frame = self.lens(
            shot.position[robots], shot.rotation[robots], shot.facing[robots]
        )
        expected, slopes = self._expected(self._which[robots], position, frame, rays)
        measured = shot.picture[robots]
        spread = self._camera.spread(expected)
        error = (measured - expected) / spread
        said = np.isfinite(error) & np.isfinite(slopes).all(axis=-1)
        error = np.where(said, error, 0.0)
        # What tells a turn about the lens's axis are edges and shadows, of which slopes know
        # nothing: that is left to the comparison of turns.
        slopes[..., POSE - 1] = 0.0
        self.misfit = self.misfit.copy()
        self.misfit[robots] = _median(np.abs(error), said)
        wrong = self.misfit > self._table.filter.misfit
        puzzled = (self._puzzled + 1 / self._camera.optics.rate) * wrong
        self._puzzled = np.where(shot.taken, puzzled, self._puzzled)
        weight = self._share * _huber(error)
        weight = np.where(self.unknown[robots, None], 0.0, weight)
        scaled = slopes / np.where(said, spread, 1.0)[..., None]
        world = self._in_world(scaled, said, frame, position - shot.position[robots])
        n = len(self.unknown)
        information, evidence = np.zeros((n, POSE, POSE)), np.zeros((n, POSE))
        information[robots], evidence[robots] = _normal(world, error, weight)
        change = self.filter.correct(information, evidence, shot.position)
        self._move_later_shots(change, shot.position)

    def _in_world(self, slopes: Array, said: NDArray[np.bool_], frame: Array, arm: Array) -> Array:
        """Slopes (n, k, 6) of a camera's picture as those of its robot's pose, 0 where nothing is
        ``said``; ``arm`` (n, 3) m, from the robot's centre to the lens, world frame."""
        slopes = np.where(said[..., None], slopes, 0.0)
        turns = np.einsum("nij,nkj->nki", frame, slopes[..., 3:])
        turns = turns + cross(arm[:, None], slopes[..., :3])
        return np.concatenate([slopes[..., :3], turns], axis=-1)

    def _move_later_shots(self, change: Array, pivot: Array) -> None:
        """Pictures that are on their way were taken where the robots now know better."""
        turn, moves = turned_by(change[:, TURN]), np.any(change != 0, axis=1)[:, None]
        moved: deque[tuple[int, Shot]] = deque()
        for due, shot in self._arriving:
            since = (turn @ (shot.position - pivot)[..., None])[..., 0]
            position = np.where(moves, pivot + change[:, PLACE] + since, shot.position)
            moved.append((due, shot._replace(position=position, rotation=turn @ shot.rotation)))
        self._arriving = moved

    def _expected(
        self, which: NDArray[np.intp], position: Array, frame: Array, rays: Array
    ) -> tuple[Array, Array]:
        """Expected pictures (n, k) and their slopes (n, k, 6), see ``Camera.slopes``."""
        camera, far = self._camera, self._camera.optics.far
        hits = self._walls.trace(which, position, frame, rays, far, camera.lamp)
        expected, slopes = camera.expected(hits, rays), camera.slopes(hits, rays, frame)
        if slopes is None:
            slopes = self._slopes(hits, position, frame, rays, expected)
        return expected, slopes

    def _slopes(
        self, hits: Array, position: Array, frame: Array, rays: Array, expected: Array
    ) -> Array:
        """Slopes from the pictures of neighbouring poses, which see the same pieces of wall."""
        slopes = np.empty((*expected.shape, POSE))
        for axis in range(POSE):
            place, turned, step = position, frame, MOVED if axis < 3 else TURNED
            change = np.zeros((len(position), 3))
            change[:, axis % 3] = step
            if axis < 3:
                place = position + change
            else:
                turned = frame @ turned_by(change)
            seen = nearby(hits, rays, position, frame, place, turned, self._camera.lamp)
            slopes[..., axis] = (self._camera.expected(seen, rays) - expected) / step
        return slopes

    # Finding a pose among many

    def _find_turn(self, shot: Shot) -> None:
        """Have robots that do not know how they are turned about their axis compare all turns, at
        some places along it, and take the best where no other turn is nearly as good."""
        robots = np.flatnonzero(self.unknown & self._rested)
        if len(robots) == 0:
            return
        end = (shot.facing[robots] > 0).astype(np.intp)
        self._rest[robots, end] = PAUSE
        axis = self.filter.rotation[robots, :, 2]
        std = self.filter.std_along(self.filter.rotation[:, :, 2])[robots]
        turns = np.arange(ROLLS) * 2 * np.pi / ROLLS
        steps = WITHIN * std[:, None] * np.linspace(-1.0, 1.0, FEW_PLACES)  # (m, p)
        prior = np.broadcast_to(
            0.5 * (steps / std[:, None])[:, None] ** 2, (len(robots), ROLLS, FEW_PLACES)
        )
        every = np.tile(turns, (len(robots), 1))
        cost = prior + self._around(robots, shot, axis, steps, every, self._few)
        weight = _chances(cost)  # (m, ROLLS, p)
        self._against[robots] -= np.log(np.maximum(weight.sum(axis=2), 1e-300))
        of_turn = _chances(self._against[robots])
        best = of_turn.argmax(axis=1)
        apart = (turns - turns[best, None] + np.pi) % (2 * np.pi) - np.pi  # (m, ROLLS)
        sure = (of_turn * (np.abs(apart) > DISTINCT)).sum(axis=1) < DOUBT
        if not np.count_nonzero(sure):
            return
        mean_turn, turn_variance = _moments(apart, of_turn)
        mean_step, step_variance = _moments(steps, weight.sum(axis=1))
        turn = np.zeros((len(robots), 3))
        turn[:, 2] = turns[best] + mean_turn
        self._put(
            robots[sure],
            shot,
            (shot.position[robots] + mean_step[:, None] * axis)[sure],
            (shot.rotation[robots] @ turned_by(turn))[sure],
            (turn_variance + (2 * np.pi / ROLLS) ** 2)[sure],
            (step_variance + (WITHIN * std / FEW_PLACES) ** 2)[sure],
        )

    def verify(self, robots: NDArray[np.intp]) -> None:
        """Have robots compare their turn about their axis with all others, by the last picture:
        one that finds a better one does not know its turn any more."""
        shot = self.shot
        assert shot is not None
        turns = np.arange(ROLLS) * 2 * np.pi / ROLLS
        every = np.tile(turns, (len(robots), 1))
        axis = self.filter.rotation[robots, :, 2]
        steps = np.tile(np.linspace(-CHECKED, CHECKED, FEW_PLACES), (len(robots), 1))
        cost = self._around(robots, shot, axis, steps, every).min(axis=2)
        apart = np.abs((turns + np.pi) % (2 * np.pi) - np.pi) > DISTINCT
        wrong = cost[:, apart].min(axis=1) < cost[:, ~apart].min(axis=1) - CONVINCED
        self.unknown[robots] |= wrong

    def _narrow_down(self, shot: Shot) -> None:
        """Have robots that are not sure of their place, or of their turn about their axis, compare
        poses around their own: places along the direction in which they know theirs least (mostly
        along their pipe), and turns.

        Close to the truth the slopes of the picture say more; farther off they lead astray, and
        where pixels begin or cease to see something, as at an open end, they say nothing.
        """
        axis, std = self.filter.vaguest()
        forward = self.filter.rotation[:, :, 2]
        turn_std = self.filter.std_about(forward)
        vague = ((std > VAGUE) | (turn_std > VAGUE_TURN)) & ~self.unknown
        robots = np.flatnonzero(vague & self._rested)
        if len(robots) == 0:
            return
        information = np.zeros((len(axis), POSE, POSE))
        evidence = np.zeros((len(axis), POSE))
        nowhere, as_is = np.zeros((len(robots), 1)), np.zeros((len(robots), 1))
        reach = np.minimum(WITHIN * std[robots], FARTHEST)
        steps = reach[:, None] * np.linspace(-1.0, 1.0, PLACES)  # (m, p)
        turns = WITHIN * turn_std[robots, None] * np.linspace(-1.0, 1.0, FEW_TURNS)  # (m, t)
        told = np.zeros(len(robots), bool)
        for values, spread, at, direction, cost in (
            (
                steps,
                std,
                PLACE,
                axis,
                self._around(robots, shot, axis[robots], steps, as_is, self._few),
            ),
            (
                turns,
                turn_std,
                TURN,
                forward,
                self._around(robots, shot, axis[robots], nowhere, turns),
            ),
        ):
            prior = 0.5 * (values / spread[robots, None]) ** 2
            mean, variance = _moments(values, _chances(prior + cost.reshape(prior.shape)))
            _, known = _moments(values, _chances(prior))
            variance = variance + (values[:, 1] - values[:, 0]) ** 2 / 4
            # Where all poses look alike, what seems to be gained is chance.
            more = variance < TOLD * known
            gained = np.where(more, 1 / variance - 1 / known, 0.0)
            along = direction[robots]
            information[robots, at, at] += gained[:, None, None] * outer(along, along)
            evidence[robots, at] += np.where(more, mean / variance, 0.0)[:, None] * along
            told |= more
        end = (shot.facing[robots] > 0).astype(np.intp)
        self._rest[robots, end] = np.where(told, 0, RESTING)
        change = self.filter.correct(information, evidence, shot.position)
        self._move_later_shots(change, shot.position)
        turn = turned_by(change[:, TURN])
        self.shot = shot._replace(
            position=shot.position + change[:, PLACE], rotation=turn @ shot.rotation
        )

    def _around(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        axis: Array,
        steps: Array,
        turns: Array,
        pixels: NDArray[np.intp] | None = None,
    ) -> Array:
        """``_cost`` (m, t, p) of poses around those of the picture: ``steps`` (m, p) m along
        ``axis`` (m, 3), ``turns`` (m, t) rad about the robots' own."""
        m, t, p = len(robots), turns.shape[1], steps.shape[1]
        about = np.zeros((m, t, 3))
        about[..., 2] = turns
        frames = shot.rotation[robots, None] @ turned_by(about.reshape(-1, 3)).reshape(m, t, 3, 3)
        places = shot.position[robots, None] + steps[..., None] * axis[:, None]
        cost = self._cost(
            robots,
            shot,
            np.tile(places, (1, t, 1)),
            np.repeat(frames, p, axis=1),
            pixels=pixels,
        )
        return cost.reshape(m, t, p)

    def seek(
        self, robots: NDArray[np.intp], shot: Shot, places: Array, frames: Array
    ) -> NDArray[np.bool_]:
        """Put robots to that of their candidates that their picture fits best, where no other one
        is nearly as good.

        Args:
            robots: (m,). shot: the picture, and where the robots took themselves to be.
            places: (m, c, 3) m. frames: (m, c, 3, 3), robot frames in the world.

        Returns:
            (m,) those that have found themselves.
        """
        rows = np.arange(len(robots))[:, None]
        cost = self._cost(robots, shot, places, frames, BLUR)
        best = np.argsort(cost, axis=1, kind="stable")[:, :FINALISTS]
        places, frames = places[rows, best], frames[rows, best]
        for blur in (BLUR, BLUR, BLUR, 2.0, 2.0, 1.0):
            places, frames = self._improved(robots, shot, places, frames, blur)
        cost = self._cost(robots, shot, places, frames)
        first = cost.argmin(axis=1)
        place, frame = places[rows[:, 0], first], frames[rows[:, 0], first]
        cosine = ((frame[:, None] * frames).sum(axis=(2, 3)) - 1) / 2
        aside = np.sqrt(((places - place[:, None]) ** 2).sum(axis=-1))
        apart = (cosine < np.cos(DISTINCT)) | (aside > APART)
        other = np.where(apart, cost, np.inf).min(axis=1)
        least = cost[rows[:, 0], first]
        pixels = self._share * len(self.pixels)
        sure = (other - least > CONVINCED) & (least < GOOD * pixels)
        if np.count_nonzero(sure):
            count = int(np.count_nonzero(sure))
            self._put(
                robots[sure],
                shot,
                place[sure],
                frame[sure],
                np.full(count, FOUND_TURN**2),
                np.full(count, FOUND_AT**2),
            )
        return sure

    def _improved(
        self, robots: NDArray[np.intp], shot: Shot, places: Array, frames: Array, blur: float
    ) -> tuple[Array, Array]:
        """Candidates (m, c, 3) and (m, c, 3, 3), each moved to where it fits the picture better: a
        step of Gauss and Newton."""
        m, c = places.shape[:2]
        facing, which = np.repeat(shot.facing[robots], c), np.repeat(self._which[robots], c)
        flat, turned = places.reshape(-1, 3), frames.reshape(-1, 3, 3)
        rays = self._rays[self._coarse]
        position, lens = self.lens(flat, turned, facing)
        expected, slopes = self._expected(which, position, lens, rays)
        spread = self._camera.spread(expected) * blur
        measured = np.repeat(shot.picture[robots][:, self._coarse], c, axis=0)
        error = (measured - expected) / spread
        said = np.isfinite(error) & np.isfinite(slopes).all(axis=-1)
        said &= np.abs(error) < 2 * WORST
        world = self._in_world(
            slopes / np.where(said, spread, 1.0)[..., None], said, lens, position - flat
        )
        information, evidence = _normal(world, np.where(said, error, 0.0), said.astype(float))
        stiff = np.diag(1 / np.array([NEAR_BY] * 3 + [NEAR_TURN] * 3) ** 2)
        change = np.linalg.solve(information + stiff, evidence[..., None])[..., 0]
        size = np.sqrt((change[:, :3] ** 2).sum(axis=-1)) / NEAR_BY
        turn = np.sqrt((change[:, 3:] ** 2).sum(axis=-1)) / NEAR_TURN
        change = change / np.maximum(1.0, np.maximum(size, turn))[:, None]
        moved = flat + change[:, :3]
        rotated = orthonormal(turned_by(change[:, 3:]) @ turned)
        return moved.reshape(m, c, 3), rotated.reshape(m, c, 3, 3)

    def _put(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        place: Array,
        frame: Array,
        turn_variance: Array,
        step_variance: Array,
    ) -> None:
        """Put robots (m,) to poses (m, 3), (m, 3, 3) that they had when the picture was taken; they
        have moved on. The variances (m,) rad² and m² are those about and along the axis."""
        pose = self.filter
        found = np.zeros(len(self.unknown), bool)
        found[robots] = True
        position, rotation = pose.position.copy(), pose.rotation.copy()
        turn = frame @ np.swapaxes(shot.rotation[robots], 1, 2)
        since = position[robots] - shot.position[robots]
        position[robots] = place + (turn @ since[..., None])[..., 0]
        rotation[robots] = orthonormal(turn @ rotation[robots])
        axis = rotation[:, :, 2]
        along = outer(axis, axis)
        covariance = np.zeros((len(found), POSE, POSE))
        covariance[:, :3, :3] = 0.003**2 * np.eye(3)
        covariance[:, 3:, 3:] = 0.03**2 * np.eye(3)
        covariance[robots, :3, :3] += step_variance[:, None, None] * along[robots]
        covariance[robots, 3:, 3:] += turn_variance[:, None, None] * along[robots]
        pose.put(found, position, rotation, covariance)
        self.unknown = self.unknown & ~found
        self._against[robots] = 0.0
        self._puzzled = np.where(found, 0.0, self._puzzled)

    def _cost(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        places: Array,
        frames: Array,
        blur: float = 1.0,
        pixels: NDArray[np.intp] | None = None,
    ) -> Array:
        """Half of the squared errors of each robot's candidates (m, c), of picture and gravity;
        those of pixels are less by ``blur``, where candidates are far apart."""
        pixels = self._coarse if pixels is None else pixels
        camera, rays = self._camera, self._rays[pixels]
        m, c = frames.shape[:2]
        facing = np.repeat(shot.facing[robots], c)
        position, lens = self.lens(places.reshape(-1, 3), frames.reshape(-1, 3, 3), facing)
        which = np.repeat(self._which[robots], c)
        hits = self._walls.trace(which, position, lens, rays, camera.optics.far, camera.lamp)
        expected = camera.expected(hits, rays).reshape(m, c, -1)
        measured = shot.picture[robots][:, None, pixels]
        error = (measured - expected) / camera.spread(expected) / blur
        # Where one of both sees something and the other nothing, they differ by much.
        nothing = np.isnan(measured) != np.isnan(expected)
        error = np.where(nothing, WORST, np.nan_to_num(error))
        size = np.abs(error)
        # Beyond what is on the map anything is as well as what is expected.
        beyond = np.isnan(hits[..., RANGE]).reshape(m, c, -1)
        loss = np.where(beyond, 0.5, np.minimum(size, WORST) ** 2 / 2)
        picture = self._share * len(self.pixels) / len(pixels)
        held = np.einsum("mcij,mi->mcj", frames, -self._gravity[robots])
        force = (held - self._held[robots, None]) / self._table.filter.force_std
        return picture * loss.sum(axis=-1) + 0.5 * (force**2).sum(axis=-1)


def _with_rows(shot: Shot, robots: NDArray[np.intp], rows: Shot) -> Shot:
    """A picture with that of ``robots`` (k,) from ``rows``, of k."""
    changed = {}
    for name, new in rows._asdict().items():
        changed[name] = getattr(shot, name).copy()
        changed[name][robots] = new
    return shot._replace(**changed)


def _begin(table: SensingTable, direction: Array) -> Array:
    """Covariance (n, 10, 10) of robots that begin in pipes of directions (n, 3)."""
    n = len(direction)
    covariance = np.zeros((n, SIZE, SIZE))
    along = outer(direction, direction)
    covariance[:, PLACE, PLACE] = 0.003**2 * np.eye(3) + table.start.distance_std**2 * along
    turn = 0.02 if table.start.theta5_known else np.pi / np.sqrt(3)
    covariance[:, TURN, TURN] = 0.03**2 * np.eye(3) + turn**2 * along
    bias = np.radians(table.imu.gyro_bias_deg)
    covariance[:, BIAS, BIAS] = bias**2 * np.eye(3)
    covariance[:, SLIP, SLIP] = table.filter.slip_std**2
    return covariance


def _normal(slopes: Array, error: Array, weight: Array) -> tuple[Array, Array]:
    """Information (n, 6, 6) and evidence (n, 6) of errors (n, k) with slopes (n, k, 6)."""
    weighted = slopes * weight[..., None]
    return np.swapaxes(weighted, 1, 2) @ slopes, np.einsum("nki,nk->ni", weighted, error)


def _chances(cost: Array) -> Array:
    """Probabilities (m, ...), in proportion to exp(-cost)."""
    axes = tuple(range(1, cost.ndim))
    weight = np.exp(cost.min(axis=axes, keepdims=True) - cost)
    return weight / weight.sum(axis=axes, keepdims=True)


def _moments(values: Array, chances: Array) -> tuple[Array, Array]:
    """Mean and variance (m,) of values (m, c)."""
    mean = (chances * values).sum(axis=1)
    return mean, (chances * (values - mean[:, None]) ** 2).sum(axis=1)


def _huber(error: Array) -> Array:
    """Weights of errors counted in standard deviations."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(error), 1e-12))


def _median(size: Array, said: NDArray[np.bool_]) -> Array:
    """Median (n,) of those ``size`` (n, k) that are ``said``; 0 where hardly any are."""
    ordered = np.sort(np.where(said, size, np.inf), axis=1)
    count = said.sum(axis=1)
    middle = np.take_along_axis(ordered, (count // 2 % size.shape[1])[:, None], axis=1)[:, 0]
    return np.where(count > FEW * size.shape[1], middle, 0.0)
