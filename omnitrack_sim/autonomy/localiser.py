"""From what n robots feel and see to their poses in pipes that are on their map."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.candidates import (
    CANDIDATES,
    Candidates,
    Shot,
    chances,
    huber,
    median,
    moments,
    normal,
    of_arms,
    of_gravity,
)
from omnitrack_sim.autonomy.pose_filter import (
    PLACE,
    POSE,
    POSE_FILTER,
    TURN,
    PoseFilter,
    beginning,
    outer,
)
from omnitrack_sim.base.rotations import (
    Array,
    Pose,
    orthonormal,
    set_rows,
    turned_by,
    with_rows,
    wrap_angle,
)
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.kinematics import angular_velocity, belt_sign
from omnitrack_sim.senses.optics import Mount, Walls
from omnitrack_sim.senses.proprioception import Felt
from omnitrack_sim.senses.settings import SensingTable


@dataclass(frozen=True)
class LocaliserSettings:
    """When a localiser compares poses, how many, and what it takes to believe the best of them.

    Attributes:
        touch_period: s, time between two updates by arms and accelerometer: they change slowly.
        all_turns: number of rotations about the axis that a robot of unknown rotation compares, 10
            degrees apart.
        few_places: number of positions at which each of these is compared: the rotation is sought
            there, the position only has to be near.
        most_doubt: probability of all other rotations together below which it takes the best.
        margin: cost by which any other answer has to be worse for one to be taken.
        most_pixel_cost: cost of each independent pixel up to which a pose explains a picture.
        relocated_turn_std: rad, standard deviation of a rotation taken from such candidates.
        relocated_place_std: m, the same of a position along the pipe.
        verified_reach: m, to which positions on both sides are compared where a robot verifies its
            rotation.
        least_place_std: m, standard deviation of its position from which on a robot compares poses:
            farther from the truth the linear update leads astray, as gradients see no edges.
        least_turn_std: rad, the same of its rotation about its axis.
        reach: standard deviations to either side within which poses are compared.
        most_reach: m, bound of that reach for positions.
        places: number of positions compared along the direction of largest uncertainty.
        turns: number of rotations about the axis compared.
        variance_drop: part of its prior variance below which an update has to bring the posterior:
            where all candidates look alike, a smaller gain is chance.
        pause: pictures of one end that are not compared after one without information, as comparing
            takes time.
        remapped_place_std: m, standard deviation that is added where a bend of the map changes.
        remapped_turn_std: rad, the same of each rotation.
    """

    touch_period: float = 0.1
    all_turns: int = 36
    few_places: int = 3
    most_doubt: float = 1e-3
    margin: float = 4.0
    most_pixel_cost: float = 2.0
    relocated_turn_std: float = 0.1
    relocated_place_std: float = 0.02
    verified_reach: float = 0.01
    least_place_std: float = 0.01
    least_turn_std: float = 0.02
    reach: float = 3.0
    most_reach: float = 0.2
    places: int = 13
    turns: int = 9
    variance_drop: float = 0.85
    pause: int = 1
    remapped_place_std: float = 0.015
    remapped_turn_std: float = 0.03


LOCALISER = LocaliserSettings()


class Localiser:
    """Where n robots are, on maps that they know.

    Args:
        table: ``[sensing]``. robot: shared by all. mount: its cameras.
        walls: of the maps. which: (n,) map of each robot.
        period: s between two control steps.

    Attributes:
        filter: the estimate; set by ``reset``, as all that is kept for a robot.
        misfit: (n,) median error of the last picture's pixels, in their standard deviations.
        unknown: (n,) bool, robots that do not know how they are turned about their axis.
        shot: the last picture that has arrived.
        pixels: (k,) those of a picture that are compared with the map, counted row by row.
    """

    def __init__(
        self,
        table: SensingTable,
        robot: Robot,
        mount: Mount,
        walls: Walls,
        which: NDArray[np.intp],
        period: float,
    ) -> None:
        self._table, self._robot, self._walls, self._which = table, robot, walls, which
        self._period, self._rate = period, mount.camera.optics.rate
        n = len(which)
        self._gravity = np.zeros((n, 3))
        self.filter = PoseFilter(n, table.filter, table.imu, robot.nominal_pipe_radius)
        self._candidates = Candidates(table.filter, mount, walls, which, self._gravity)
        self.pixels = self._candidates.pixels
        self.misfit, self.unknown = np.zeros(n), np.zeros(n, bool)
        self._force = np.zeros((n, 3))
        self._felt, self._clock = np.zeros(n, int), 0
        # Pictures of each end, tail and nose, to come until poses are compared again.
        self._rest = np.zeros((n, 2), np.intp)
        self._against = np.zeros(
            (n, LOCALISER.all_turns)
        )  # what pictures have said against each turn
        self._puzzled = np.zeros(n)  # s, how long pictures have not been those of the map
        self._steps = max(1, round(LOCALISER.touch_period / period))
        self._slide = np.zeros((n, 3))
        self._arriving: deque[tuple[int, Shot]] = deque()
        self.shot: Shot | None = None

    def reset(
        self, rows: NDArray[np.intp], gravity: Array, position: Array, rotation: Array
    ) -> None:
        """Begin anew for robots ``rows`` (k,) that stand along their pipes.

        Args:
            rows: numbers of the robots.
            gravity: (k, 3) m/s², world frame, as the maps say.
            position: (k, 3) m, where they take themselves to be.
            rotation: (k, 3, 3), the same.
        """
        self.filter.reset(rows, position, rotation, beginning(self._table, rotation[:, :, 2]))
        self._gravity[rows] = gravity
        held = -np.einsum("nji,nj->ni", rotation, gravity)
        set_rows(self._candidates, rows, held=held)
        set_rows(self, rows, unknown=not self._table.start.theta5_known, misfit=0.0, _puzzled=0.0)
        set_rows(self, rows, _force=0.0, _felt=0, _slide=0.0, _rest=0, _against=0.0)
        if self.shot is not None:
            self.shot = _without(self.shot, rows)
        self._arriving = deque((due, _without(shot, rows)) for due, shot in self._arriving)

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
            self._correct_by_touch(due)
            held = self._candidates.held
            self._candidates.held = np.where(due[:, None], self._force, held)
            self._force = np.where(due[:, None], 0.0, self._force)

    def _correct_by_touch(self, due: NDArray[np.bool_]) -> None:
        """Correct the poses of robots that are ``due`` (n,) by the arms and by gravity."""
        pose, table = self.filter, self._table.filter
        information, evidence = of_arms(
            self._robot,
            self._walls,
            self._which,
            pose.position,
            pose.rotation,
            self._slide,
            table.arm_std,
        )
        more, further = of_gravity(
            self._gravity, self._force, pose.rotation, table.force_std, ~self.unknown
        )
        information = np.where(due[:, None, None], information + more, 0.0)
        evidence = np.where(due[:, None], evidence + further, 0.0)
        pose.correct(information, evidence, pose.position.copy())

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
        covariance[robot, PLACE, PLACE] += LOCALISER.remapped_place_std**2 * np.eye(3)
        covariance[robot, TURN, TURN] += LOCALISER.remapped_turn_std**2 * np.eye(3)
        self.filter.covariance = covariance

    def doubt(self, robot: int) -> None:
        """What a robot takes for its pose cannot be: it is to look for itself."""
        self._puzzled[robot] = 2 * self._table.filter.misfit_time

    # Pictures

    def shoot(
        self, picture: Array, facing: NDArray[np.int_], latency: int, taken: NDArray[np.bool_]
    ) -> None:
        """Pictures (n, k) are taken now by the robots ``taken`` (n,) and arrive ``latency`` control
        steps later."""
        due = self._clock + latency
        shot = Shot(picture, self.filter.position, self.filter.rotation, facing, taken)
        if self._arriving and self._arriving[-1][0] == due:
            # Robots that have just been reset take theirs beside those that others took just now.
            _, before = self._arriving.pop()
            both = zip(before, shot, strict=True)
            shot = Shot(*(with_rows(old, taken, new[taken]) for old, new in both))
        self._arriving.append((due, shot))

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
        rested = (self._rest[end] < 0) & active
        if np.count_nonzero(self.unknown):
            self._find_turn(shot, rested)
        self._narrow_down(shot, rested)
        self._compare(self.shot, np.flatnonzero(active))
        return True

    def _compare(self, shot: Shot, robots: NDArray[np.intp]) -> None:
        """Correct the poses of robots (m,) by what the picture has other than expected."""
        error, said, slopes = self._candidates.difference(robots, shot)
        self.misfit = self.misfit.copy()
        self.misfit[robots] = median(np.abs(error), said)
        wrong = self.misfit > self._table.filter.misfit
        puzzled = (self._puzzled + 1 / self._rate) * wrong
        self._puzzled = np.where(shot.taken, puzzled, self._puzzled)
        weight = self._candidates.share * huber(error)
        weight = np.where(self.unknown[robots, None], 0.0, weight)
        n = len(self.unknown)
        information, evidence = np.zeros((n, POSE, POSE)), np.zeros((n, POSE))
        information[robots], evidence[robots] = normal(slopes, error, weight)
        change = self.filter.correct(information, evidence, shot.position)
        self._move_later_shots(change, shot.position)

    def _move_later_shots(self, change: Array, pivot: Array) -> None:
        """Pictures that are on their way were taken where the robots now know better."""
        turn, moves = turned_by(change[:, TURN]), np.any(change != 0, axis=1)[:, None]
        moved: deque[tuple[int, Shot]] = deque()
        for due, shot in self._arriving:
            since = (turn @ (shot.position - pivot)[..., None])[..., 0]
            position = np.where(moves, pivot + change[:, PLACE] + since, shot.position)
            moved.append((due, shot._replace(position=position, rotation=turn @ shot.rotation)))
        self._arriving = moved

    # Finding a pose among many

    def _find_turn(self, shot: Shot, rested: NDArray[np.bool_]) -> None:
        """Have robots that do not know how they are turned about their axis compare all turns, at
        some places along it, and take the best where no other turn is nearly as good."""
        robots = np.flatnonzero(self.unknown & rested)
        if len(robots) == 0:
            return
        axis = self.filter.rotation[robots, :, 2]
        std = self.filter.std_along(self.filter.rotation[:, :, 2])[robots]
        turns = np.arange(LOCALISER.all_turns) * 2 * np.pi / LOCALISER.all_turns
        steps = (
            LOCALISER.reach * std[:, None] * np.linspace(-1.0, 1.0, LOCALISER.few_places)
        )  # (m, p)
        prior = np.broadcast_to(
            0.5 * (steps / std[:, None])[:, None] ** 2,
            (len(robots), LOCALISER.all_turns, LOCALISER.few_places),
        )
        every = np.tile(turns, (len(robots), 1))
        cost = prior + self._candidates.around(
            robots, shot, axis, steps, every, self._candidates.few
        )
        weight = chances(cost)  # (m, ROLLS, p)
        self._against[robots] -= np.log(np.maximum(weight.sum(axis=2), 1e-300))
        of_turn = chances(self._against[robots])
        best = of_turn.argmax(axis=1)
        apart = wrap_angle(turns - turns[best, None])  # (m, ROLLS)
        sure = (of_turn * (np.abs(apart) > CANDIDATES.distinct_turn)).sum(
            axis=1
        ) < LOCALISER.most_doubt
        if not np.count_nonzero(sure):
            return
        mean_turn, turn_variance = moments(apart, of_turn)
        mean_step, step_variance = moments(steps, weight.sum(axis=1))
        turn = np.zeros((len(robots), 3))
        turn[:, 2] = turns[best] + mean_turn
        self._put(
            robots[sure],
            shot,
            (shot.position[robots] + mean_step[:, None] * axis)[sure],
            (shot.rotation[robots] @ turned_by(turn))[sure],
            (turn_variance + (2 * np.pi / LOCALISER.all_turns) ** 2)[sure],
            (step_variance + (LOCALISER.reach * std / LOCALISER.few_places) ** 2)[sure],
        )

    def verify(self, robots: NDArray[np.intp]) -> None:
        """Have robots compare their turn about their axis with all others, by the last picture:
        one that finds a better one does not know its turn any more."""
        shot = self.shot
        assert shot is not None
        turns = np.arange(LOCALISER.all_turns) * 2 * np.pi / LOCALISER.all_turns
        every = np.tile(turns, (len(robots), 1))
        axis = self.filter.rotation[robots, :, 2]
        steps = np.tile(
            np.linspace(-LOCALISER.verified_reach, LOCALISER.verified_reach, LOCALISER.few_places),
            (len(robots), 1),
        )
        cost = self._candidates.around(robots, shot, axis, steps, every).min(axis=2)
        apart = np.abs(wrap_angle(turns)) > CANDIDATES.distinct_turn
        wrong = cost[:, apart].min(axis=1) < cost[:, ~apart].min(axis=1) - LOCALISER.margin
        self.unknown[robots] |= wrong

    def _narrow_down(self, shot: Shot, rested: NDArray[np.bool_]) -> None:
        """Have robots that are not sure of their place, or of their turn about their axis, compare
        poses around their own: places along the direction in which they know theirs least (mostly
        along their pipe), and turns.

        Close to the truth the slopes of the picture say more; farther off they lead astray, and
        where pixels begin or cease to see something, as at an open end, they say nothing.
        """
        axis, std = self.filter.vaguest()
        forward = self.filter.rotation[:, :, 2]
        turn_std = self.filter.std_about(forward)
        vague = (
            (std > LOCALISER.least_place_std) | (turn_std > LOCALISER.least_turn_std)
        ) & ~self.unknown
        robots = np.flatnonzero(vague & rested)
        if len(robots) == 0:
            return
        information = np.zeros((len(axis), POSE, POSE))
        evidence = np.zeros((len(axis), POSE))
        nowhere, as_is = np.zeros((len(robots), 1)), np.zeros((len(robots), 1))
        reach = np.minimum(LOCALISER.reach * std[robots], LOCALISER.most_reach)
        steps = reach[:, None] * np.linspace(-1.0, 1.0, LOCALISER.places)  # (m, p)
        turns = (
            LOCALISER.reach * turn_std[robots, None] * np.linspace(-1.0, 1.0, LOCALISER.turns)
        )  # (m, t)
        told = np.zeros(len(robots), bool)
        for values, spread, at, direction, cost in (
            (
                steps,
                std,
                PLACE,
                axis,
                self._candidates.around(
                    robots, shot, axis[robots], steps, as_is, self._candidates.few
                ),
            ),
            (
                turns,
                turn_std,
                TURN,
                forward,
                self._candidates.around(robots, shot, axis[robots], nowhere, turns),
            ),
        ):
            prior = 0.5 * (values / spread[robots, None]) ** 2
            mean, variance = moments(values, chances(prior + cost.reshape(prior.shape)))
            _, known = moments(values, chances(prior))
            variance = variance + (values[:, 1] - values[:, 0]) ** 2 / 4
            # Where all poses look alike, what seems to be gained is chance.
            more = variance < LOCALISER.variance_drop * known
            gained = np.where(more, 1 / variance - 1 / known, 0.0)
            along = direction[robots]
            information[robots, at, at] += gained[:, None, None] * outer(along, along)
            evidence[robots, at] += np.where(more, mean / variance, 0.0)[:, None] * along
            told |= more
        end = (shot.facing[robots] > 0).astype(np.intp)
        self._rest[robots, end] = np.where(told, 0, LOCALISER.pause)
        change = self.filter.correct(information, evidence, shot.position)
        self._move_later_shots(change, shot.position)
        turn = turned_by(change[:, TURN])
        self.shot = shot._replace(
            position=shot.position + change[:, PLACE], rotation=turn @ shot.rotation
        )

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
        found = self._candidates.best(robots, shot, places, frames)
        pixels = self._candidates.share * len(self.pixels)
        sure = (found.other - found.cost > LOCALISER.margin) & (
            found.cost < LOCALISER.most_pixel_cost * pixels
        )
        if np.count_nonzero(sure):
            count = int(np.count_nonzero(sure))
            self._put(
                robots[sure],
                shot,
                found.place[sure],
                found.frame[sure],
                np.full(count, LOCALISER.relocated_turn_std**2),
                np.full(count, LOCALISER.relocated_place_std**2),
            )
        return sure

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
        covariance[:, :3, :3] = POSE_FILTER.across_std**2 * np.eye(3)
        covariance[:, 3:, 3:] = POSE_FILTER.tilt_std**2 * np.eye(3)
        covariance[robots, :3, :3] += step_variance[:, None, None] * along[robots]
        covariance[robots, 3:, 3:] += turn_variance[:, None, None] * along[robots]
        pose.put(found, position, rotation, covariance)
        self.unknown = self.unknown & ~found
        self._against[robots] = 0.0
        self._puzzled = np.where(found, 0.0, self._puzzled)


def _without(shot: Shot, rows: NDArray[np.intp]) -> Shot:
    """A picture that robots ``rows`` (k,) have not taken."""
    return shot._replace(taken=with_rows(shot.taken, rows, False))
