"""Error-state extended Kalman filter of n poses.

State: position p in the world, rotation R of the robot, gyro bias b, slip k of the belts in
standard deviations of the motion at hand, so that what they slip by in a turn ends with it. The
errors of p (m, world frame), of R (rad, a rotation about world axes on the left of R), of b (rad/s)
and of k are normal with one covariance (10, 10) a robot. Derivation:
docs/explanation/localisation.md.
"""

from __future__ import annotations

from ctypes import CFUNCTYPE
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import (
    Array,
    orthonormal,
    set_rows,
    turned_by,
    with_rows,
)
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import INTEGER, NUMBER, NUMBERS, WORD, c_function, pointers
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.odometry import Motion
from omnitrack_sim.senses.settings import FilterTable, ImuTable, SensingTable

PLACE, TURN, BIAS, SLIP = slice(0, 3), slice(3, 6), slice(6, 9), 9
SIZE, POSE = 10, 6


@dataclass(frozen=True)
class PoseFilterSettings:
    """Uncertainty of a robot that stands in a pipe, other than along and about the pipe's axis.

    Attributes:
        across_std: m, standard deviation of its position across the pipe.
        tilt_std: rad, of its rotation about every axis.
        known_turn_std: rad, in addition about the pipe's axis, where that rotation is known.
        min_travel: m, travel of a control step below which ratios to it are bounded.
        min_bend_share: part of a bend's radius from the bend's axis at which a robot's centre
            counts at least: at the axis, all points of the bend are equally near.
    """

    across_std: float = 0.003
    tilt_std: float = 0.03
    known_turn_std: float = 0.02
    min_travel: float = 1e-6
    min_bend_share: float = 0.25


POSE_FILTER = PoseFilterSettings()


class PoseFilter:
    """Poses of n robots with covariances.

    Args:
        n: number of robots.
        table: of the filter.
        imu: of the gyro.
        radius: m, of the pipe that the robot is made for.

    Attributes:
        position, rotation, bias, slip, covariance: the estimate, replaced at each change; set by
            ``reset``.
    """

    def __init__(self, n: int, table: FilterTable, imu: ImuTable, radius: float) -> None:
        self._table, self._imu, self._radius = table, imu, radius
        self.position, self.rotation = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self.bias, self.slip = np.zeros((n, 3)), np.zeros(n)
        self.covariance, self._transition, self._noise = np.zeros((3, n, SIZE, SIZE))

    def reset(
        self, rows: NDArray[np.intp], position: Array, rotation: Array, covariance: Array
    ) -> None:
        """Begin anew for robots ``rows`` (k,).

        Args:
            rows: numbers of the robots.
            position: (k, 3) m.
            rotation: (k, 3, 3).
            covariance: (k, 10, 10).
        """
        set_rows(self, rows, position=position, rotation=rotation, covariance=covariance)
        set_rows(self, rows, bias=0.0, slip=0.0, _transition=np.eye(SIZE), _noise=0.0)

    def advance(self, motion: Motion, turned: Array, skid: Array, period: float) -> None:
        """Predict the poses after one control step.

        Args:
            motion: by the drives.
            turned: (n, 3) rad, by the gyro.
            skid: (n,) m, at the wall, by which drives and gyro differ.
            period: s.
        """
        travel = motion.travel
        table, imu, least = self._table, self._imu, POSE_FILTER.min_travel
        turned = turned - self.bias * period
        way = np.abs(travel)
        across = np.sqrt(turned[:, 0] ** 2 + turned[:, 1] ** 2)
        sharp = np.minimum(1.0, across * self._radius / np.maximum(way, least))
        differ = np.minimum(1.0, skid / np.maximum(way, least))
        slip_std = table.slip_std + motion.slip_std
        slip_std = slip_std + table.slip_turning * sharp + table.slip_noticed * differ
        # The belts drive along the axis that the robot has in the middle of the step.
        middle = self.rotation @ turned_by(turned / 2)
        ahead = middle[:, :, 2]
        step = (travel * (1 - slip_std * self.slip))[:, None] * ahead
        by_slip = -(travel * slip_std)[:, None] * ahead
        kept = np.exp(-period / table.slip_time)
        noise = np.empty((len(way), SIZE))
        loose = np.maximum(sharp, differ)
        wander = (table.aside_std + table.aside_turning * loose) ** 2 * way
        noise[:, PLACE] = wander[:, None]
        gyro = (np.radians(imu.gyro_noise_deg) ** 2 + np.radians(table.turn_walk_deg) ** 2) * period
        scale = (imu.gyro_scale * np.sqrt((turned**2).sum(axis=-1))) ** 2
        noise[:, TURN] = (gyro + scale)[:, None]
        noise[:, BIAS] = np.radians(imu.gyro_walk_deg) ** 2 * period
        # Stationary: with this noise its standard deviation stays 1.
        noise[:, SLIP] = 1 - kept**2
        # In place: nobody else holds these two.
        c_function(_propagate, _PROPAGATE).ctypes(
            len(travel),
            *pointers(step, by_slip, np.ascontiguousarray(self.rotation)),
            period,
            kept,
            *pointers(noise, self._transition, self._noise),
        )
        self.position = self.position + step
        self.rotation = self.rotation @ turned_by(turned)
        self.slip = kept * self.slip

    def settle(self, robots: NDArray[np.bool_]) -> None:
        """Bring the covariance of ``robots`` (n,) up to the moment, after any number of steps."""
        f, each = self._transition, robots[:, None, None]
        settled = f @ self.covariance @ np.swapaxes(f, 1, 2) + self._noise
        self.covariance = np.where(each, settled, self.covariance)
        self._transition = np.where(each, np.eye(SIZE), f)
        self._noise = np.where(each, 0.0, self._noise)

    def correct(self, information: Array, evidence: Array, pivot: Array) -> Array:
        """Correct the pose by measurements.

        Args:
            information: (n, 6, 6), sum over measurements of H'H / variance, H the slopes to errors
                of place and rotation.
            evidence: (n, 6), sum of H' residual / variance.
            pivot: (n, 3) m, where the robots were at the measurement: a correction of rotation
                turns what has been driven since.

        Returns:
            The corrections (n, 10).
        """
        gain = self.covariance[:, :, :POSE]
        whole = np.zeros((len(gain), SIZE, SIZE))
        _diagonal(whole)[:] = 1.0
        whole[:, :, :POSE] += gain @ information
        right = np.concatenate([self.covariance, gain @ evidence[..., None]], axis=-1)
        solved = np.asarray(np.linalg.solve(whole, right), float)
        covariance, change = solved[..., :SIZE], solved[..., SIZE]
        # A robot that nothing was measured of stays as it is to the last bit: what it does must not
        # depend on its neighbours.
        touched: NDArray[np.bool_] = np.any(information != 0, axis=(1, 2))[:, None]
        change = np.where(touched, change, 0.0)
        # Rounding would make it asymmetric in the long run.
        covariance = (covariance + np.swapaxes(covariance, 1, 2)) / 2
        self.covariance = np.where(touched[..., None], covariance, self.covariance)
        turn, moves = turned_by(change[:, TURN]), np.any(change != 0, axis=1)[:, None]
        since = self.position - pivot
        position = pivot + change[:, PLACE] + (turn @ since[..., None])[..., 0]
        self.position = np.where(moves, position, self.position)
        rotation = orthonormal(turn @ self.rotation)
        self.rotation = np.where(moves[..., None], rotation, self.rotation)
        self.bias = self.bias + change[:, BIAS]
        self.slip = self.slip + change[:, SLIP]
        return change

    def put(
        self, rows: NDArray[np.intp], position: Array, rotation: Array, covariance: Array
    ) -> None:
        """Put robots ``rows`` (k,) that have relocalised to new poses.

        Args:
            rows: indices of the robots.
            position: (k, 3) m.
            rotation: (k, 3, 3).
            covariance: (k, 6, 6), of the poses.
        """
        # Old correlations of the pose with bias and slip belong to the pose that was wrong.
        whole = self.covariance.copy()
        whole[rows, :POSE] = 0.0
        whole[rows, :, :POSE] = 0.0
        whole[rows, :POSE, :POSE] = covariance
        self.position = with_rows(self.position, rows, position)
        self.rotation = with_rows(self.rotation, rows, rotation)
        self.covariance = whole

    def std(self, block: slice, axis: Array) -> Array:
        """Return the standard deviation (n,) of the position, m, or of the rotation, rad.

        Args:
            block: PLACE or TURN.
            axis: (n, 3) unit vectors, world frame, along or about which.
        """
        variance = (outer(axis, axis) * self.covariance[:, block, block]).sum(axis=(1, 2))
        return np.sqrt(np.maximum(variance, 0.0))

    def tilt_std(self, location: Location) -> Array:
        """Return standard deviations (n,) of tilts, rad, across the pipe where they are largest.

        In a bend, an error along the centreline turns the tangent as well.
        """
        tangent, normal = location.tangent, location.normal
        # Where a robot stands inside of a bend, the nearest point moves farther than it does.
        nearer = 1 - location.curvature * (location.aside * normal).sum(axis=-1)
        least = POSE_FILTER.min_bend_share
        turns = (location.curvature / np.maximum(nearer, least))[:, None] * tangent
        across = np.stack([normal, np.cross(tangent, normal)], axis=1)  # (n, 2, 3)
        slopes = np.zeros((len(tangent), 2, POSE))
        slopes[:, :, TURN] = across
        slopes[:, 1, PLACE] = -turns
        spread = slopes @ self.covariance[:, :POSE, :POSE] @ np.swapaxes(slopes, 1, 2)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0))

    def principal_axis(self) -> tuple[Array, Array]:
        """Return the direction (n, 3) of largest uncertainty of the position, world frame.

        The second value is the standard deviation (n,) m along it.
        """
        values, vectors = np.linalg.eigh(self.covariance[:, PLACE, PLACE])
        return vectors[:, :, 2], np.sqrt(np.maximum(values[:, 2], 0.0))


@compiled
def _advanced(values, first, stride, step, by_slip, rotation, robot, period, kept):
    """Multiply a vector by the transition matrix of a control step, in place.

    It is the SIZE numbers at ``first``, ``stride`` apart, of errors of place, turn, bias and slip.
    The turn's error moves the place by its cross product with the step, the bias turns, and the
    slip shortens the step.
    """
    v, r, place, turn, bias = 3 * robot, 9 * robot, first, first + 3 * stride, first + 6 * stride
    x, y, z = values[turn], values[turn + stride], values[turn + 2 * stride]
    slip = values[first + 9 * stride]
    values[place] += step[v + 2] * y - step[v + 1] * z + by_slip[v] * slip
    values[place + stride] += step[v] * z - step[v + 2] * x + by_slip[v + 1] * slip
    values[place + 2 * stride] += step[v + 1] * x - step[v] * y + by_slip[v + 2] * slip
    x, y, z = values[bias], values[bias + stride], values[bias + 2 * stride]
    for i in range(3):
        about = rotation[r + 3 * i] * x + rotation[r + 3 * i + 1] * y + rotation[r + 3 * i + 2] * z
        values[turn + i * stride] -= period * about
    values[first + 9 * stride] = kept * slip


def _propagate(robots, step, by_slip, rotation, period, kept, added, transition, noise):
    """Propagate transition matrices F and covariances of the noise by a control step, in place.

    Args:
        robots: n.
        step: (n, 3) m.
        by_slip: (n, 3) m, of the step for each unit of slip.
        rotation: (n, 3, 3).
        period: s.
        kept: part of the slip that is left after it.
        added: (n, 10) variances of the step's noise.
        transition: (n, 10, 10), of what went before.
        noise: (n, 10, 10), the same.
    """
    for robot in range(robots):
        first = SIZE * SIZE * robot
        for i in range(SIZE):
            _advanced(transition, first + i, SIZE, step, by_slip, rotation, robot, period, kept)
            _advanced(noise, first + i, SIZE, step, by_slip, rotation, robot, period, kept)
        # F N F' = F (F N)': now the rows.
        for i in range(SIZE):
            row = first + SIZE * i
            _advanced(noise, row, 1, step, by_slip, rotation, robot, period, kept)
            noise[row + i] += added[SIZE * robot + i]
    return 0


_PROPAGATE = CFUNCTYPE(INTEGER, WORD, *[NUMBERS] * 3, *[NUMBER] * 2, *[NUMBERS] * 3)
"""C types of the compiled function, in the order of its arguments."""


def _diagonal(matrices: Array) -> Array:
    """View (n, k) of the diagonals of contiguous matrices (n, k, k)."""
    n, k = matrices.shape[:2]
    return matrices.reshape(n, k * k)[:, :: k + 1]


def initial_covariance(table: SensingTable, direction: Array) -> Array:
    """Covariance (n, 10, 10) of robots that begin in pipes of directions (n, 3)."""
    # Of an unknown rotation, that of a uniform distribution over the full turn.
    turn = POSE_FILTER.known_turn_std if table.start.theta5_known else np.pi / np.sqrt(3)
    covariance = np.zeros((len(direction), SIZE, SIZE))
    pose = standing_covariance(direction, table.start.distance_std**2, turn**2)
    covariance[:, :POSE, :POSE] = pose
    bias = np.radians(table.imu.gyro_bias_deg)
    covariance[:, BIAS, BIAS] = bias**2 * np.eye(3)
    covariance[:, SLIP, SLIP] = 1.0
    return covariance


def standing_covariance(
    direction: Array, step_variance: Array | float, turn_variance: Array | float
) -> Array:
    """Covariance (n, 6, 6) of the poses of robots that stand along pipes.

    Args:
        direction: (n, 3) unit vectors along the pipes, world frame.
        step_variance: (n,) m², of the position along the pipe.
        turn_variance: (n,) rad², of the rotation about its axis.
    """
    along = outer(direction, direction)
    covariance = np.zeros((len(direction), POSE, POSE))
    for block, std, variance in (
        (PLACE, POSE_FILTER.across_std, step_variance),
        (TURN, POSE_FILTER.tilt_std, turn_variance),
    ):
        axial = np.reshape(variance, (-1, 1, 1)) * along
        covariance[:, block, block] = std**2 * np.eye(3) + axial
    return covariance


def outer(a: Array, b: Array) -> Array:
    """Products (n, 3, 3) of vectors (n, 3)."""
    return a[:, :, None] * b[:, None, :]
