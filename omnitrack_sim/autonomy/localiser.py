"""Localisation of n robots in pipes that are on their maps."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.candidates import (
    CANDIDATES,
    Candidates,
    Shot,
    huber,
    median,
    moments,
    normal_equations,
    of_gravity,
    of_limbs,
    probabilities,
)
from omnitrack_sim.autonomy.pose_filter import (
    PLACE,
    POSE,
    TURN,
    PoseFilter,
    initial_covariance,
    outer,
    standing_covariance,
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
from omnitrack_sim.robots.odometry import Limbs, Odometry
from omnitrack_sim.senses.optics import Mount
from omnitrack_sim.senses.proprioception import ProprioceptiveReadings
from omnitrack_sim.senses.settings import SensingTable
from omnitrack_sim.walls.rays import RayWalls


@dataclass(frozen=True)
class LocaliserSettings:
    """Extent of the comparisons of a localiser, and thresholds for believing the best pose.

    Attributes:
        touch_period: s, time between two updates by arms and accelerometer.
        seek_turns: number of rotations about the axis that a robot of unknown rotation compares, 15
            degrees apart.
        seek_places: number of positions at which each of these is compared: the rotation is sought
            there, the position only has to be near.
        max_doubt: probability of all other rotations together below which it takes the best.
        margin: cost by which any other answer has to be worse for one to be taken.
        max_pixel_cost: cost of each independent pixel up to which a pose explains a picture.
        relocated_turn_std: rad, standard deviation of a rotation taken from such candidates.
        relocated_place_std: m, the same of a position along the pipe.
        min_place_std: m, standard deviation of its position from which on a robot compares poses:
            farther from the truth the linear update leads astray, as gradients see no edges.
        min_turn_std: rad, the same of its rotation about its axis.
        reach: standard deviations to either side within which poses are compared.
        max_reach: m, bound of that reach for positions.
        places: number of positions compared along the direction of largest uncertainty.
        turns: number of rotations about the axis compared.
        min_contrast: cost by which rotations about the axis have to differ in a picture that
            tells one from another.
        pause: pictures of one end that are not compared after one without information.
        remapped_place_std: m, standard deviation that is added where a bend of the map changes.
        remapped_turn_std: rad, the same of each rotation.
    """

    touch_period: float = 0.1
    seek_turns: int = 24
    seek_places: int = 3
    max_doubt: float = 1e-3
    margin: float = 4.0
    max_pixel_cost: float = 2.0
    relocated_turn_std: float = 0.1
    relocated_place_std: float = 0.02
    min_place_std: float = 0.01
    min_turn_std: float = 0.02
    reach: float = 3.0
    max_reach: float = 0.2
    places: int = 13
    turns: int = 9
    min_contrast: float = 1.0
    pause: int = 2
    remapped_place_std: float = 0.015
    remapped_turn_std: float = 0.03


LOCALISER = LocaliserSettings()


class Localiser:
    """Pose estimates of n robots on maps that they know.

    Args:
        table: ``[sensing]``.
        odometry: of the robots.
        mount: their cameras.
        walls: of the maps.
        which: (n,) map of each robot.
        period: s, between two control steps.

    Attributes:
        filter: the estimate; set by ``reset``, as all that is kept for a robot.
        travel: (n,) m, of the last control period, by odometry along the robots' axes.
        misfit: (n,) median residual of the last picture's pixels, in their standard deviations.
        unknown: (n,) bool, robots of unknown rotation about their axis.
        shot: the last picture that has arrived, with the pose before its gradients corrected it:
            in a wrong rotation they lead astray.
        pixels: (k,) those of a picture that are compared with the map, counted row by row.
        turns: (t,) rad, rotations about the axis that a robot of unknown rotation compares.
    """

    def __init__(
        self,
        table: SensingTable,
        odometry: Odometry,
        mount: Mount,
        walls: RayWalls,
        which: NDArray[np.intp],
        period: float,
    ) -> None:
        self._table, self._odometry, self._walls, self._which = table, odometry, walls, which
        self._period, self._rate = period, mount.camera.optics.rate
        n = len(which)
        self._gravity, self.travel = np.zeros((n, 3)), np.zeros(n)
        self._radius = odometry.robot.nominal_bore / 2
        self.filter = PoseFilter(n, table.filter, table.imu, self._radius)
        self._candidates = Candidates(table.filter, mount, walls, which, self._gravity)
        self.pixels = self._candidates.pixels
        self.misfit, self.unknown = np.zeros(n), np.zeros(n, bool)
        self._force = np.zeros((n, 3))
        self._control_steps, self._clock = np.zeros(n, int), 0
        # Pictures of each end, tail and nose, to come until poses are compared again.
        self._rest = np.zeros((n, 2), np.intp)
        self.turns = np.arange(LOCALISER.seek_turns) * 2 * np.pi / LOCALISER.seek_turns
        self._evidence = np.zeros((n, LOCALISER.seek_turns))  # of all pictures against each turn
        self._mismatch = np.zeros(n)  # s, for which pictures have not matched the map
        self._steps = max(1, round(LOCALISER.touch_period / period))
        self._arriving: deque[tuple[int, Shot]] = deque()
        self.shot: Shot | None = None
        self._corrected: Shot | None = None  # the same with its last pose

    def reset(
        self, rows: NDArray[np.intp], gravity: Array, position: Array, rotation: Array
    ) -> None:
        """Begin anew for robots ``rows`` (k,) that stand along their pipes.

        Args:
            rows: indices of the robots.
            gravity: (k, 3) m/s², world frame, by the maps.
            position: (k, 3) m, estimate.
            rotation: (k, 3, 3), estimate.
        """
        covariance = initial_covariance(self._table, rotation[:, :, 2])
        self.filter.reset(rows, position, rotation, covariance)
        self._gravity[rows] = gravity
        held = -np.einsum("nji,nj->ni", rotation, gravity)
        set_rows(self._candidates, rows, held=held)
        set_rows(self, rows, unknown=not self._table.start.theta5_known, misfit=0.0, _mismatch=0.0)
        set_rows(self, rows, _force=0.0, _control_steps=0, _rest=0, _evidence=0.0)
        # Pictures that a robot took before its reset must not reach it afterwards.
        if self.shot is not None:
            self.shot = _without(self.shot, rows)
        self._arriving = deque((due, _without(shot, rows)) for due, shot in self._arriving)

    def predict(self, readings: ProprioceptiveReadings) -> None:
        """Predict the poses by drives and gyro; correct them by limbs and gravity when due.

        Args:
            readings: of one control period.
        """
        motion = self._odometry.motion(readings.body)
        self.travel = motion.travel
        # Only what the drives' own doubt does not explain is slip.
        differ = np.abs(motion.rotation - readings.rotation) - motion.rotation_std
        skid = np.sqrt(((np.maximum(differ, 0.0) * self._radius) ** 2).sum(axis=-1))
        self.filter.advance(motion, readings.rotation, skid, self._period)
        # Mean of the accelerometer over the period until its next use.
        self._force = self._force + readings.force / self._steps
        self._control_steps, self._clock = self._control_steps + 1, self._clock + 1
        due = self._control_steps % self._steps == 0
        if np.count_nonzero(due):
            self.filter.settle(due)
            self._correct_by_touch(due, self._odometry.limbs(readings.body))
            held = self._candidates.held
            self._candidates.held = np.where(due[:, None], self._force, held)
            self._force = np.where(due[:, None], 0.0, self._force)

    def _correct_by_touch(self, due: NDArray[np.bool_], limbs: Limbs | None) -> None:
        """Correct the poses of robots that are ``due`` (n,) by limbs and gravity."""
        pose, table = self.filter, self._table.filter
        information, evidence = of_gravity(
            self._gravity, self._force, pose.rotation, table.force_std, ~self.unknown
        )
        if limbs is not None:
            more, further = of_limbs(
                limbs,
                self._walls,
                self._which,
                pose.position,
                pose.rotation,
                pose.covariance[:, :POSE, :POSE],
                table.arm_std,
            )
            information, evidence = more + information, further + evidence
        information = np.where(due[:, None, None], information, 0.0)
        evidence = np.where(due[:, None], evidence, 0.0)
        pose.correct(information, evidence, pose.position.copy())

    @property
    def inconsistent(self) -> NDArray[np.bool_]:
        """Robots (n,) whose pictures have not matched their map for ``misfit_time``."""
        return self._mismatch > self._table.filter.misfit_time

    def move(self, robot: int, before: Pose, after: Pose) -> None:
        """Move a robot with a part of its map, from pose ``before`` to pose ``after``."""
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

    def inflate(self, robot: int) -> None:
        """Inflate the covariance of a robot whose map has changed around it."""
        covariance = self.filter.covariance.copy()
        covariance[robot, PLACE, PLACE] += LOCALISER.remapped_place_std**2 * np.eye(3)
        covariance[robot, TURN, TURN] += LOCALISER.remapped_turn_std**2 * np.eye(3)
        self.filter.covariance = covariance

    def reject(self, robot: int) -> None:
        """Reject the estimate of a robot, which is impossible: the robot is to relocalise."""
        self._mismatch[robot] = 2 * self._table.filter.misfit_time

    # Pictures

    def shoot(
        self, picture: Array, facing: NDArray[np.int_], latency: int, taken: NDArray[np.bool_]
    ) -> None:
        """Expose pictures, which arrive later.

        Args:
            picture: (n, k).
            facing: (n,) 1 from the nose, -1 from the tail.
            latency: control steps until they arrive.
            taken: (n,) robots that take one.
        """
        due = self._clock + latency
        shot = Shot(picture, self.filter.position, self.filter.rotation, facing, taken)
        if self._arriving and self._arriving[-1][0] == due:
            # Robots that have just been reset take theirs beside those that others took just now.
            _, before = self._arriving.pop()
            both = zip(before, shot, strict=True)
            shot = Shot(*(with_rows(old, taken, new[taken]) for old, new in both))
        self._arriving.append((due, shot))

    def see(self, active: NDArray[np.bool_]) -> bool:
        """Correct ``active`` robots (n,) by the pictures that arrive now; return whether any do."""
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
            self._seek_turn(shot, rested)
        # Whole pictures first: gradients converge only from close to the truth.
        self._narrow_down(self.shot, rested)
        self._corrected = self._compare(self.shot, np.flatnonzero(active))
        return True

    def _compare(self, shot: Shot, robots: NDArray[np.intp]) -> Shot:
        """Correct the poses of robots (m,) by the gradients of their pictures' residuals.

        Returns:
            The picture with its pose corrected.
        """
        residual, valid, slopes = self._candidates.difference(robots, shot)
        self.misfit = self.misfit.copy()
        self.misfit[robots] = median(np.abs(residual), valid)
        wrong = self.misfit > self._table.filter.misfit
        mismatch = (self._mismatch + 1 / self._rate) * wrong
        self._mismatch = np.where(shot.taken, mismatch, self._mismatch)
        weight = self._candidates.share * huber(residual)
        weight = np.where(self.unknown[robots, None], 0.0, weight)
        n = len(self.unknown)
        information, evidence = np.zeros((n, POSE, POSE)), np.zeros((n, POSE))
        information[robots], evidence[robots] = normal_equations(slopes, residual, weight)
        return self._correct(information, evidence, shot)

    def _correct(self, information: Array, evidence: Array, shot: Shot) -> Shot:
        """Correct the poses by a picture, those of pictures on their way as well.

        Returns:
            The picture with its pose corrected.
        """
        pivot = shot.position
        change = self.filter.correct(information, evidence, pivot)
        turn, moves = turned_by(change[:, TURN]), np.any(change != 0, axis=1)[:, None]
        for i, (due, later) in enumerate(self._arriving):
            since = (turn @ (later.position - pivot)[..., None])[..., 0]
            position = np.where(moves, pivot + change[:, PLACE] + since, later.position)
            rotation = turn @ later.rotation
            self._arriving[i] = due, later._replace(position=position, rotation=rotation)
        return shot._replace(position=pivot + change[:, PLACE], rotation=turn @ shot.rotation)

    # Comparing many poses

    def _seek_turn(self, shot: Shot, rested: NDArray[np.bool_]) -> None:
        """Find the rotation of robots of unknown rotation about their axes.

        All are compared, at some positions along the axis, and the best is taken where all others
        together are improbable.
        """
        robots = np.flatnonzero(self.unknown & rested)
        if len(robots) == 0:
            return
        turns, few = self.turns, LOCALISER.seek_places
        axis = self.filter.rotation[robots, :, 2]
        std = self.filter.std(PLACE, self.filter.rotation[:, :, 2])[robots]
        steps = LOCALISER.reach * std[:, None] * np.linspace(-1.0, 1.0, few)  # (m, p)
        prior = 0.5 * (steps / std[:, None])[:, None] ** 2  # (m, 1, p), the same for all turns
        every = np.tile(turns, (len(robots), 1))
        cost = prior + self._candidates.around(
            robots, shot, axis, steps, every, self._candidates.few
        )
        # Where no fitting is in sight, as behind it mostly, all turns look alike.
        of_each = cost.min(axis=2)
        alike = np.ptp(of_each, axis=1) < LOCALISER.min_contrast
        self._pause(robots, shot, alike)
        weight = probabilities(cost)  # (m, t, p)
        # Pictures are taken as independent, so their evidence adds up; none rules a turn out.
        self._evidence[robots] -= np.log(np.maximum(weight.sum(axis=2), 1e-300))
        of_turn = probabilities(self._evidence[robots])
        best = of_turn.argmax(axis=1)
        apart = wrap_angle(turns - turns[best, None])  # (m, t)
        doubt = (of_turn * (np.abs(apart) > CANDIDATES.distinct_turn)).sum(axis=1)
        unique = doubt < LOCALISER.max_doubt
        if not np.count_nonzero(unique):
            return
        mean_turn, turn_variance = moments(apart, of_turn)
        mean_step, step_variance = moments(steps, weight.sum(axis=1))
        turn = np.zeros((len(robots), 3))
        turn[:, 2] = turns[best] + mean_turn
        self._put(
            robots[unique],
            shot,
            (shot.position[robots] + mean_step[:, None] * axis)[unique],
            (shot.rotation[robots] @ turned_by(turn))[unique],
            (turn_variance + (2 * np.pi / LOCALISER.seek_turns) ** 2)[unique],
            (step_variance + (LOCALISER.reach * std / few) ** 2)[unique],
        )

    def verify(self, robots: NDArray[np.intp]) -> None:
        """Compare the rotation of robots (m,) about their axis with all others by the last picture.

        Where another one fits better, their rotation becomes unknown.
        """
        shot = self.shot
        assert shot is not None
        every = np.tile(self.turns, (len(robots), 1))
        axis, still = self.filter.rotation[robots, :, 2], np.zeros((len(robots), 1))
        few = self._candidates.few
        cost = self._candidates.around(robots, shot, axis, still, every, few)[..., 0]
        apart = np.abs(wrap_angle(self.turns)) > CANDIDATES.distinct_turn
        wrong = cost[:, apart].min(axis=1) < cost[:, ~apart].min(axis=1) - LOCALISER.margin
        self.unknown[robots] |= wrong

    def _narrow_down(self, shot: Shot, rested: NDArray[np.bool_]) -> None:
        """Compare poses around those of robots of large covariance.

        Positions are compared along the direction of largest uncertainty (mostly along the pipe),
        and rotations about the robots' axes. Close to the truth the gradients of the picture tell
        more; farther off they lead astray, and where pixels begin or cease to see something, as at
        an open end, they tell nothing.
        """
        axis, place_std = self.filter.principal_axis()
        forward = self.filter.rotation[:, :, 2]
        turn_std = self.filter.std(TURN, forward)
        ready = ~self.unknown & rested
        apart = ready & (place_std > LOCALISER.min_place_std)
        turned = ready & (turn_std > LOCALISER.min_turn_std)
        information = np.zeros((len(axis), POSE, POSE))
        evidence, informative = np.zeros((len(axis), POSE)), np.zeros(len(axis), bool)
        most = np.minimum(LOCALISER.reach * place_std, LOCALISER.max_reach)
        for block, uncertain, direction, std, reach, count in (
            (PLACE, apart, axis, place_std, most, LOCALISER.places),
            (TURN, turned, forward, turn_std, LOCALISER.reach * turn_std, LOCALISER.turns),
        ):
            robots = np.flatnonzero(uncertain)
            if len(robots) == 0:
                continue
            values, still = (
                reach[robots, None] * np.linspace(-1, 1, count),
                np.zeros((len(robots), 1)),
            )
            steps, turns = (values, still) if block is PLACE else (still, values)
            cost = self._candidates.around(
                robots, shot, direction[robots], steps, turns, self._candidates.few
            ).reshape(len(robots), count)
            gain, pull = _gain(values, std[robots], cost)
            along = direction[robots]
            information[robots, block, block] += gain[:, None, None] * outer(along, along)
            evidence[robots, block] += pull[:, None] * along
            informative[robots] |= gain > 0
        robots = np.flatnonzero(apart | turned)
        if len(robots) == 0:
            return
        self._pause(robots, shot, ~informative[robots])
        self.shot = self._correct(information, evidence, shot)

    def _pause(
        self, robots: NDArray[np.intp], shot: Shot, uninformative: NDArray[np.bool_]
    ) -> None:
        """Have robots (m,) rest whose last picture of an end is ``uninformative`` (m,).

        They compare no poses by the next pictures of that end.
        """
        end = (shot.facing[robots] > 0).astype(np.intp)
        self._rest[robots, end] = np.where(uninformative, LOCALISER.pause, 0)

    def seek(self, robots: NDArray[np.intp], places: Array, frames: Array) -> NDArray[np.bool_]:
        """Put robots to the candidate that fits their last picture best, where it is unambiguous.

        Args:
            robots: (m,).
            places: (m, c, 3) m.
            frames: (m, c, 3, 3), robot frames in the world.

        Returns:
            (m,) robots that have relocalised.
        """
        shot = self._corrected
        assert shot is not None
        best = self._candidates.best(robots, shot, places, frames)
        pixels = self._candidates.share * len(self.pixels)
        unique = best.other - best.cost > LOCALISER.margin
        unique &= best.cost < LOCALISER.max_pixel_cost * pixels
        count = int(np.count_nonzero(unique))
        if count:
            self._put(
                robots[unique],
                shot,
                best.place[unique],
                best.frame[unique],
                np.full(count, LOCALISER.relocated_turn_std**2),
                np.full(count, LOCALISER.relocated_place_std**2),
            )
        return unique

    def _put(
        self,
        robots: NDArray[np.intp],
        shot: Shot,
        place: Array,
        frame: Array,
        turn_variance: Array,
        step_variance: Array,
    ) -> None:
        """Put robots to poses that they had when a picture was taken; they have moved on.

        Args:
            robots: (m,).
            shot: the picture.
            place: (m, 3) m.
            frame: (m, 3, 3).
            turn_variance: (m,) rad², about the axis.
            step_variance: (m,) m², along the axis.
        """
        pose = self.filter
        turn, before = frame @ np.swapaxes(shot.rotation[robots], 1, 2), shot.position[robots]

        def moved(position: Array, rotation: Array) -> tuple[Array, Array]:
            since = (turn @ (position[robots] - before)[..., None])[..., 0]
            return place + since, orthonormal(turn @ rotation[robots])

        position, rotation = moved(pose.position, pose.rotation)
        covariance = standing_covariance(rotation[:, :, 2], step_variance, turn_variance)
        pose.put(robots, position, rotation, covariance)
        # What this picture and those on their way tell from now on, they tell of the new pose.
        assert self.shot is not None
        self.shot = _moved(self.shot, robots, place, frame)
        for i, (due, later) in enumerate(self._arriving):
            new = _moved(later, robots, *moved(later.position, later.rotation))
            self._arriving[i] = due, new
        self.unknown = with_rows(self.unknown, robots, False)
        self._mismatch = with_rows(self._mismatch, robots, 0.0)
        self._evidence[robots] = 0.0


def _gain(values: Array, std: Array, cost: Array) -> tuple[Array, Array]:
    """Information (m,) that pictures add to the normal prior of a scalar, and evidence (m,).

    Args:
        values: (m, c) evenly spaced around 0.
        std: (m,) of the prior.
        cost: (m, c) of the picture at each value.
    """
    prior = 0.5 * (values / std[:, None]) ** 2
    mean, variance = moments(values, probabilities(prior + cost))
    _, before = moments(values, probabilities(prior))
    # Between two values the picture has not been compared: half of their spacing is unknown, so
    # nothing is gained where all look alike.
    variance = variance + (values[:, 1] - values[:, 0]) ** 2 / 4
    informative = variance < before
    gain = np.where(informative, 1 / variance - 1 / before, 0.0)
    return gain, np.where(informative, mean / variance, 0.0)


def _moved(shot: Shot, robots: NDArray[np.intp], position: Array, rotation: Array) -> Shot:
    """A picture with new poses (m, 3) m, (m, 3, 3) of ``robots`` (m,) at its exposure."""
    position = with_rows(shot.position, robots, position)
    return shot._replace(position=position, rotation=with_rows(shot.rotation, robots, rotation))


def _without(shot: Shot, rows: NDArray[np.intp]) -> Shot:
    """A picture that robots ``rows`` (k,) have not taken."""
    return shot._replace(taken=with_rows(shot.taken, rows, False))
