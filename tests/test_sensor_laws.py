"""Laws of sensors: each figure of their tables is measured back from what they read."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Array, Pose, rotation_about, turned_by
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes import Part, Straight
from omnitrack_sim.robots.odometry import Odometry
from omnitrack_sim.robots.omnitrack.sensors import SENSORS
from omnitrack_sim.senses.draws import keys, normal, uniform
from omnitrack_sim.senses.optics import Eyes, Mount, rays_of
from omnitrack_sim.senses.proprioception import AHEAD, Proprioception, ProprioceptiveReadings
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.sim.picture_taking import PictureTaking
from omnitrack_sim.walls.rays import (
    GRAIN,
    HIT_SIZE,
    JOINT,
    LIT,
    NORMALS,
    RANGE,
    RayWalls,
)

N, PERIOD, RADIUS = 1000, 0.01, 0.025
"""Robots whose sensors are compared; control period, s; radius of their wheels, m."""
SIGMAS = 5.0
"""Standard errors within which a figure is to be measured: one of two million such is outside by
chance. The draws are the same in each run of the tests."""
CAMERAS = ("depth", "headlight")
QUIET: dict[str, dict[str, Any]] = {
    "encoders": {"counts": 10**7, "radius_error": 0},
    "arms": {"noise": 0, "bias": 0, "resolution": 1e-9},
    "current": {"noise": 0, "bias": 0},
    "imu": {
        "gyro_noise_deg": 0,
        "gyro_bias_deg": 0,
        "gyro_walk_deg": 0,
        "gyro_scale": 0,
        "force_noise": 0,
        "force_bias": 0,
    },
    "depth": {"noise": 0, "noise_floor": 0, "scale_error": 0, "dropouts": 0, "resolution": 1e-9},
    "headlight": {"noise": 0, "vignetting": 0, "bits": 16, "dirt": 0, "ring": 0, "lamp_aside": 0},
    "start": {"distance_std": 0, "theta5_known": True},
}
"""Sensors without errors."""


def table_with(path: str, value: Any) -> SensingTable:
    """``[sensing]`` of a robot whose only error is the figure at a path."""
    group, name = path.split(".")
    camera = group if group in CAMERAS else "depth"
    changed = QUIET | {group: QUIET[group] | {name: value}, "camera": camera}
    return SensingTable.model_validate(changed)


class Body(Odometry):
    """Three surfaces, two joints, three arms and two motors, which are where they are put."""

    surface_radius = RADIUS

    def __init__(self, period: float = math.inf) -> None:
        self.surface_period = period

    def surfaces(self, state: Any) -> Array:
        """See ``Odometry``."""
        return state["surfaces"]

    def angles(self, state: Any) -> Array:
        """See ``Odometry``."""
        return state["angles"]

    def arms(self, state: Any) -> Array:
        """See ``Odometry``."""
        return state["arms"]

    def torques(self, state: Any) -> Array:
        """See ``Odometry``."""
        return state["torques"]

    def velocity(self, state: Any) -> Array:
        """See ``Odometry``."""
        return state["velocity"]

    def torque_limit(self, robot: Any) -> float:
        """See ``Odometry``: each robot is given as its limit."""
        return robot


class Robots:
    """Robots at rest, each with sensors of its own.

    Args:
        table: ``[sensing]``.
        seeds: of each.
        period: s, between two control steps.
        body: what is measured.
    """

    def __init__(
        self,
        table: SensingTable,
        seeds: list[str],
        period: float = PERIOD,
        body: Odometry | None = None,
    ) -> None:
        n = len(seeds)
        shapes = {"surfaces": 3, "angles": 2, "arms": 3, "torques": 2, "velocity": 3}
        self.state: Any = {name: np.zeros((n, size)) for name, size in shapes.items()}
        self.state |= {"time": np.zeros(n), "rotation": np.tile(np.eye(3), (n, 1, 1))}
        self.limits = np.where(np.arange(n) % 2, 0.2, 0.8)  # N m
        self.sensors = Proprioception(table, body or Body(), period, self.state)
        self.reset(np.arange(n), seeds)

    def reset(self, rows: Any, seeds: list[str]) -> None:
        """Begin anew for robots ``rows``."""
        limits, gravity = self.limits[rows].tolist(), np.tile([0.0, 0.0, -9.81], (len(rows), 1))
        self.sensors.reset(rows, keys(seeds), gravity, limits, self.state)

    def read(self, **moved: Array) -> ProprioceptiveReadings:
        """Readings after a control step in which something has moved."""
        self.state = self.state | moved
        return self.sensors.read(self.state)


def seeds(n: int = N, first: int = 0) -> list[str]:
    """Texts of robots that differ by a number."""
    return [str(i) for i in range(first, first + n)]


def robots_with(table: SensingTable, first: int = 0) -> Robots:
    """N robots, of seeds from a first one on."""
    return Robots(table, seeds(first=first))


# Errors of N robots (N, k), whose columns are independent, in the unit of the figure.


def wear(table: SensingTable, first: int) -> Array:
    """Parts by which three wheels read too much of 1 m, in steps of 1 m."""
    return robots_with(table, first).read(surfaces=np.ones((N, 3))).body.travel - 1.0


def steps_and_bias(values: list[Array]) -> tuple[Array, Array]:
    """What differs from reading to reading, of the size of one; and what stays."""
    one, two, *_ = values
    return (one - two) / math.sqrt(2.0), (one + two) / 2.0


def arms(table: SensingTable, first: int) -> tuple[Array, Array]:
    """Noise and bias of arms that stand at 3 mm."""
    robots, place = robots_with(table, first), np.full((N, 3), 0.003)
    return steps_and_bias([robots.read(arms=place).body.arm - place for _ in range(2)])


def currents(table: SensingTable, first: int) -> tuple[Array, Array]:
    """Noise and bias of motors that give 0.1 N m, in torque limits."""
    robots, torque = robots_with(table, first), np.full((N, 2), 0.1)
    readings = [robots.read(torques=torque).body.torque - torque for _ in range(2)]
    return steps_and_bias([one / robots.limits[:, None] for one in readings])


def gyros(table: SensingTable, first: int) -> tuple[Array, Array]:
    """Noise and bias of gyros at rest, deg, over a second."""
    robots = robots_with(table, first)
    rates = [np.degrees(robots.read().angular_velocity) for _ in range(2)]
    return steps_and_bias(rates)


def walk(table: SensingTable, first: int) -> Array:
    """Drift of the gyros' biases from step 1 to 1 + AHEAD, deg/s, over the root of the time."""
    robots = robots_with(table, first)
    rates = [np.degrees(robots.read().angular_velocity) for _ in range(1 + AHEAD)]
    return (rates[-1] - rates[0]) / math.sqrt(AHEAD * PERIOD)


def scale(table: SensingTable, first: int) -> Array:
    """Parts by which gyros read too much of a turn."""
    turn = np.tile([0.3, -0.5, 0.2], (N, 1))
    return robots_with(table, first).read(rotation=turned_by(turn)).rotation / turn - 1.0


def forces(table: SensingTable, first: int) -> tuple[Array, Array]:
    """Noise and bias of accelerometers at rest, m/s²."""
    robots = robots_with(table, first)
    return steps_and_bias([robots.read().force - [0.0, 0.0, 9.81] for _ in range(2)])


REACH = np.array([0.2, 0.4, 0.8, 1.2])
"""What four pixels see, m."""
GREY = np.array([0.3, 0.35, 0.3, 0.2])
"""Distances, m, at which four pixels of a headlight are grey: the last is the brightest."""
RAYS = np.stack([rotation_about([0.0, 1.0, 0.0], a)[:, 2] for a in (-0.6, -0.2, 0.2, 0.6)])


def hits(reach: Any, rays: Array = RAYS, **more: Any) -> Array:
    """What rays (k, 3) meet in a distance ``reach`` (k,): a wall that faces them."""
    met = np.zeros((1, len(rays), HIT_SIZE))
    met[..., RANGE], met[..., NORMALS] = reach, -rays
    met[..., LIT], met[..., JOINT], met[..., GRAIN] = (
        more.get(name, default) for name, default in (("lit", 1.0), ("joint", 1.0), ("grain", 0.0))
    )
    return met


def pictures(table: SensingTable, first: int, number: int, met: Array | None = None) -> Array:
    """Pictures (N, 4) of N robots."""
    camera, robots = camera_of(table), keys(seeds(first=first))
    seen = np.repeat(hits(REACH) if met is None else met, N, axis=0)
    return camera.picture(seen, RAYS, np.arange(4), robots, number)


def depths(table: SensingTable, first: int) -> Array:
    """Errors of four pixels in two pictures, in parts of the distance."""
    both = np.concatenate([pictures(table, first, number) for number in (0, 1)], axis=1)
    return both / np.tile(REACH, 2) - 1.0


def floors(table: SensingTable, first: int) -> Array:
    """The same in m."""
    return depths(table, first) * np.tile(REACH, 2)


def depth_scale(table: SensingTable, first: int) -> Array:
    """The error that all pixels of all pictures of a robot have in common."""
    errors = depths(table, first)
    assert np.ptp(errors, axis=1).max() < 1e-6
    return errors[:, :1]


def brightness(table: SensingTable, first: int) -> Array:
    """Errors of two grey pixels in two pictures, which the brightest one exposes."""
    met = hits(GREY)
    expected = camera_of(table).expected(met, RAYS)
    both = [pictures(table, first, number, met) - expected for number in (0, 1)]
    return np.concatenate([one[:, :2] for one in both], axis=1)


Errors = Callable[[SensingTable, int], Array]
DRAWN: Mapping[str, tuple[float, float, Errors]] = {
    "encoders.radius_error": (1.0, 0.01, wear),
    "arms.noise": (1.0, 0.001, lambda *a: arms(*a)[0]),
    "arms.bias": (1.0, 0.001, lambda *a: arms(*a)[1]),
    "current.noise": (1.0, 0.1, lambda *a: currents(*a)[0]),
    "current.bias": (1.0, 0.1, lambda *a: currents(*a)[1]),
    "imu.gyro_noise_deg": (PERIOD**-0.5, 0.02, lambda *a: gyros(*a)[0]),
    "imu.gyro_bias_deg": (1.0, 0.3, lambda *a: gyros(*a)[1]),
    "imu.gyro_walk_deg": (1.0, 0.01, walk),
    "imu.gyro_scale": (1.0, 0.01, scale),
    "imu.force_noise": (PERIOD**-0.5, 0.005, lambda *a: forces(*a)[0]),
    "imu.force_bias": (1.0, 0.2, lambda *a: forces(*a)[1]),
    "depth.noise": (1.0, 0.03, depths),
    "depth.noise_floor": (1.0, 0.004, floors),
    "depth.scale_error": (1.0, 0.02, depth_scale),
    "headlight.noise": (1.0, 0.03, brightness),
}
"""By figure: the standard deviation of its errors in units of it, another value, and the errors."""


# Figures that are no standard deviations, each measured back from readings.


def least_step(readings: Array) -> float:
    """The least difference between two readings."""
    return float(np.diff(np.unique(readings.round(12))).min())


def counts(table: SensingTable) -> float:
    """Counts of a turn, by the steps of surfaces and joints that have gone ever farther."""
    angle = np.linspace(0.0, 0.01, N)[:, None]
    read = robots_with(table).read(surfaces=np.tile(RADIUS * angle, 3), angles=np.tile(angle, 2))
    of_joint, of_surface = least_step(read.body.angle), least_step(read.body.travel) / RADIUS
    assert of_surface == pytest.approx(of_joint, rel=1e-6)
    return 2 * math.pi / of_joint


def arm_step(table: SensingTable) -> float:
    """Least step of arms that stand ever farther out, m."""
    place = np.tile(np.linspace(0.0, 0.002, N)[:, None], 3)
    return least_step(robots_with(table).read(arms=place).body.arm)


def depth_step(table: SensingTable) -> float:
    """Least step of distances, m."""
    far = np.linspace(0.5, 0.6, N)
    camera, rays = camera_of(table), np.tile([0.0, 0.0, 1.0], (N, 1))
    return least_step(camera.picture(hits(far, rays), rays, np.arange(N), keys(["a"]), 0))


def dropped(table: SensingTable) -> float:
    """Part of the pixels of many pictures that give no distance."""
    return float(np.mean([np.isnan(pictures(table, 0, number)) for number in range(8)]))


def grazing(table: SensingTable) -> float:
    """Angle, deg, of a wall along which a ray nearly runs, by the slope of its distance."""
    met = hits([0.5] * 4)
    met[..., NORMALS] = rotation_about([0.0, 1.0, 0.0], math.radians(89.99))[:, 2] * [1, 1, -1]
    rays = np.tile([0.0, 0.0, 1.0], (4, 1))
    camera: Any = camera_of(table)
    slopes = camera.slopes(met, rays, np.eye(3)[None])
    return math.degrees(math.asin(1.0 / np.linalg.norm(slopes[0, 0, :3])))


def light(table: SensingTable, met: Array, rays: Array = RAYS) -> Array:
    """Light (k,) of which a picture without noise is made, in parts of that of the first ray."""
    camera: Any = camera_of(table)
    picture = camera.picture(met, rays, np.arange(len(rays)), keys(["a"]), 0)[0]
    assert picture.max() < 1.0
    return (picture / picture[0]) ** table.headlight.gamma


def lamp_aside(table: SensingTable) -> float:
    """Distance of the lamp from the lens, m, by how much more light comes from its side."""
    rays = np.array([[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]])
    more, r = 1.0 / light(table, hits(0.1, rays), rays)[1], 0.1
    # (r² + 2 r u a + a²) / (r² - 2 r u a + a²) is the ratio of both by the rule of cosines.
    a, b = more - 1.0, -2 * r * 0.6 * (more + 1.0)
    return (-b - math.sqrt(b * b - 4 * a * a * r * r)) / (2 * a)


def vignetting(table: SensingTable) -> float:
    """Light that is lost at the corner, by that of a pixel about the middle."""
    rays = rays_of(table.headlight)
    middle = len(rays) // 2 + table.headlight.pixels // 2
    two = rays[[middle, 0]]
    left = light(table, hits(0.3, two), two)[1]
    near = (1 - two[0, 2]) / (1 - two[1, 2])
    return (1 - left) / (1 - left * near)


def gamma(table: SensingTable) -> float:
    """Exponent by which a quarter of the light is shown."""
    camera = camera_of(table)
    near, far = camera.expected(hits([0.2, 0.4] * 2), RAYS)[0, :2]
    return math.log(4.0) / math.log(near / far)


def bits(table: SensingTable) -> float:
    """Bits of a pixel, by the least step of brightness."""
    rays = np.tile([0.0, 0.0, 1.0], (20 * N, 1))
    met = hits(np.linspace(0.3, 1.2, 20 * N), rays)
    picture = camera_of(table).picture(met, rays, np.arange(20 * N), keys(["a"]), 0)
    return math.log2(1.0 + 1.0 / least_step(picture))


def dirt(table: SensingTable) -> float:
    """Part by which the darkest grain darkens, and the brightest brightens."""
    of_grain = light(table, hits(0.3, grain=[0.0, 1.0, -1.0, 0.0]))
    assert of_grain[1] - 1.0 == pytest.approx(1.0 - of_grain[2], abs=1e-3)
    return of_grain[1] - 1.0


def ring(table: SensingTable) -> float:
    """Part by which a joint is darker."""
    return 1.0 - light(table, hits(0.3, joint=[1.0, 0.0, 1.0, 1.0]))[1]


def ring_width(table: SensingTable) -> float:
    """Distance, m, at which the ring is darker by 1 / e of what it is at the joint."""
    dark = table.model_copy(update={"headlight": table.headlight.model_copy(update={"ring": 0.5})})
    joint = 0.004
    left = (1.0 - light(dark, hits(0.3, joint=[1.0, joint, 1.0, 1.0]))[1]) / 0.5
    return joint / math.sqrt(-math.log(left))


def pixels(table: SensingTable) -> float:
    """Rows of a picture."""
    return math.sqrt(len(Mount(camera_of(table), 0.1).rays))


def lens(table: SensingTable) -> tuple[Array, Array]:
    """Angles from the axis, rad, of the pixels from the middle to the edge; and their places."""
    optics = camera_of(table).optics
    rays = Mount(camera_of(table), 0.1).rays.reshape(optics.pixels, optics.pixels, 3)
    half = optics.pixels // 2
    across = (np.arange(half) + 0.5) / half
    return np.arccos(rays[half, half:, 2]), np.hypot(across, across[0])


def field_of_view(table: SensingTable) -> float:
    """Angle, deg, between both edges, by that of the outermost pixel of an equidistant lens."""
    angle, place = lens(table)
    return math.degrees(2 * angle[-1] / place[-1])


def distortion(table: SensingTable) -> float:
    """Of the lens, by two pixels: their places are as a (1 + distortion a²)."""
    (a, b), (at, bt) = (values[[4, -1]] for values in lens(table))
    return float((at * b - bt * a) / (bt * a**3 - at * b**3))


def ahead(table: SensingTable) -> float:
    """Distance of both lenses before nose and tail, m, of a robot that stands askew."""
    frame = rotation_about([1.0, 2.0, 3.0], 0.7)
    mount, place = Mount(camera_of(table), 0.1), np.array([[1.0, 2.0, 3.0]])
    nose, tail = (
        mount.lens(place, frame[None], np.array([facing]))[0] - place for facing in (1, -1)
    )
    assert nose == pytest.approx(-tail)
    return float((nose @ frame[:, 2])[0]) - 0.1


def taking(table: SensingTable) -> PictureTaking:
    """Picture taking of one robot."""
    eyes = Eyes(Mount(camera_of(table), 0.1), RayWalls([[PIPE]]), 1)
    return PictureTaking(eyes, PERIOD, table.both_ends, np.arange(4), False)


def rate(table: SensingTable) -> float:
    """Pictures that are due in a second."""
    shots, due = taking(table), 0
    for _ in range(round(10 / PERIOD)):
        shots.advance()
        due += int(shots.due[0])
    return due / 10


PIPE = Part("pipe", Straight(8.0, 0.16), Pose(np.eye(3), np.zeros(3)))


def far(table: SensingTable) -> float:
    """Distance, m, of the farthest wall that is seen in a pipe, at rays that meet it 2 mm apart."""
    reach = np.arange(0.5, 3.0, 0.002)
    camera = camera_of(table)
    mount = Mount(camera, 0.0)
    mount.rays = np.stack(
        [0.08 / reach, np.zeros(len(reach)), np.sqrt(1 - (0.08 / reach) ** 2)], axis=-1
    )
    eyes, one = Eyes(mount, RayWalls([[PIPE]]), 1), np.zeros(1, np.intp)
    place, frame = np.array([[0.0, 0.0, 1.0]]), np.eye(3)[None]
    picture = eyes.take(one, place, frame, np.ones(1, int), 0, np.arange(len(reach)))[0]
    return float(reach[np.nan_to_num(picture) > 0].max())


OPTICS: Mapping[str, tuple[Any, float, Callable[[SensingTable], float]]] = {
    "pixels": (32, 1e-9, pixels),
    "field_of_view_deg": (70.0, 1e-6, field_of_view),
    "distortion": (0.2, 1e-6, distortion),
    "ahead": (0.03, 1e-9, ahead),
    "rate": (5.0, 1e-9, rate),
    "latency": (0.1, 1e-9, lambda table: taking(table).latency * PERIOD),
    "far": (0.9, 0.002, far),
}
MEASURED: Mapping[str, tuple[Any, float, Callable[[SensingTable], float]]] = {
    "encoders.counts": (3000, 1e-3, counts),
    "arms.resolution": (0.0002, 1e-9, arm_step),
    "depth.resolution": (0.004, 1e-9, depth_step),
    "depth.dropouts": (0.3, SIGMAS * 0.5 / math.sqrt(32 * N), dropped),
    "depth.grazing_deg": (20.0, 1e-6, grazing),
    "headlight.lamp_aside": (0.04, 1e-5, lamp_aside),
    "headlight.vignetting": (0.6, 2e-4, vignetting),
    "headlight.gamma": (1.5, 1e-9, gamma),
    "headlight.bits": (5, 1e-6, bits),
    "headlight.dirt": (0.5, 2e-4, dirt),
    "headlight.ring": (0.7, 2e-4, ring),
    "headlight.ring_width": (0.002, 1e-5, ring_width),
    **{f"{one}.{name}": OPTICS[name] for one in CAMERAS for name in OPTICS},
}
"""By figure: another value, the tolerance, and how it is measured."""


def value_of(path: str) -> Any:
    """The figure at a path by default."""
    group, name = path.split(".")
    return getattr(getattr(SensingTable(), group), name)


@pytest.mark.parametrize("path", DRAWN)
def test_errors_have_the_standard_deviation_of_their_figure(path: str) -> None:
    """Their mean is 0 and their spread is the figure, to five standard errors, also where it is
    another one; where it is 0 there are none."""
    unit, other, errors = DRAWN[path]
    for value in (value_of(path), other):
        found = errors(table_with(path, value), 0) / (unit * value)
        few = SIGMAS / math.sqrt(found.size)
        assert found.mean() == pytest.approx(0.0, abs=few), (path, value)
        assert found.std() == pytest.approx(1.0, abs=few / math.sqrt(2.0)), (path, value)
    assert np.abs(errors(table_with(path, 0.0), 0)).max() < 2e-5, path


@pytest.mark.parametrize("path", MEASURED)
def test_figures_are_measured_back_from_readings(path: str) -> None:
    """Steps, ranges, times and shares, by default and where they are set to another value."""
    other, tolerance, measure = MEASURED[path]
    for value in (value_of(path), other):
        assert measure(table_with(path, value)) == pytest.approx(value, abs=tolerance), path


def sensor_tables() -> set[str]:
    """Paths of all figures of sensors: all of ``[sensing]`` but what the estimate makes of them."""
    tables = {
        name: table
        for name, table in dict(SensingTable()).items()
        if isinstance(table, Table) and name not in ("filter", "search", "start")
    }
    return {f"{name}.{figure}" for name, table in tables.items() for figure in dict(table)}


def test_every_figure_of_a_sensor_is_measured() -> None:
    """A figure of a sensor that no law measures is told, and one that there is no more."""
    assert sorted(sensor_tables() ^ {*DRAWN, *MEASURED}) == []


def all_errors(first: int) -> Array:
    """Errors (N, k) of all sensors of robots, each in its standard deviation."""
    columns = [
        errors(table_with(path, value_of(path)), first) / (unit * value_of(path))
        for path, (unit, _, errors) in DRAWN.items()
        if path != "depth.noise_floor"  # the part of one draw that does not grow with the distance
    ]
    camera = camera_of(table_with("depth.dropouts", 0.5))
    for number in (0, 1):
        seen = camera.picture(
            np.repeat(hits(REACH), N, axis=0), RAYS, np.arange(4), keys(seeds(first=first)), number
        )
        columns.append(np.where(np.isnan(seen), 1.0, -1.0))
    return np.concatenate(columns, axis=1)


def test_errors_of_sensors_robots_and_seeds_are_independent() -> None:
    """No two errors of a robot are correlated, be they of different sensors, modules, pixels, steps
    or pictures; nor are those of neighbours in a batch, nor those of other seeds; neither are their
    squares, which would show numbers that two draws have in common."""
    these, others = all_errors(0), all_errors(N)
    for one, other in ((these, these), (these[1:], these[:-1]), (these, others)):
        for power in (1, 2):
            a, b = (
                np.nan_to_num(values**power - (values**power).mean(0)) for values in (one, other)
            )
            spread = np.sqrt((a**2).mean(0))[:, None] * np.sqrt((b**2).mean(0))
            found = np.abs(a.T @ b / len(a)) / np.where(spread > 1e-12, spread, 1.0)
            if one is other:
                np.fill_diagonal(found, 0.0)
            # Of thousands of pairs one is beyond five standard errors in some hundred runs; squares
            # have longer tails.
            assert found.max() < (5.0 if power == 1 else 7.0) / math.sqrt(len(a))


def bytes_of(readings: ProprioceptiveReadings, row: int) -> bytes:
    """All that one robot reads in one step."""
    parts = (*readings.body, readings.rotation, readings.angular_velocity, readings.force)
    return b"".join(part[row].tobytes() for part in parts)


def test_a_seed_decides_what_a_robot_reads_and_nothing_else_does() -> None:
    """Alone, among others in any order, and after a reset of one of them in between, a robot of the
    same seed reads the same bytes step by step; no two steps and no two seeds are alike."""
    alone = Robots(SensingTable(), ["b"])
    expected = [bytes_of(alone.read(), 0) for _ in range(AHEAD + 4)]
    three = Robots(SensingTable(), ["a", "b", "c"])
    three.limits[:] = alone.limits[0]
    three.reset(np.arange(3), ["a", "b", "c"])
    seen = set(expected)
    for step, wanted in enumerate(expected):
        if step == 5:
            three.reset(np.array([2]), ["b"])
        readings = three.read()
        assert bytes_of(readings, 1) == wanted
        if step >= 5:
            assert bytes_of(readings, 2) == expected[step - 5]
        seen |= {bytes_of(readings, 0)}
    assert len(seen) == 2 * len(expected)
    picture = {
        pictures(table_with("depth.noise", 0.01), 0, number)[:2].tobytes() for number in (0, 1, 0)
    }
    assert len(picture) == 2


def test_noise_of_all_steps_is_white() -> None:
    """Errors of a gyro at rest are not correlated from step to step, whatever lies between, also
    where the next numbers are drawn; nor is what was drawn before repeated."""
    robots = robots_with(table_with("imu.gyro_noise_deg", 0.01))
    rates = np.stack([robots.read().angular_velocity for _ in range(2 * AHEAD + 3)])
    rates = rates.reshape(len(rates), -1) / rates.std()
    found = rates @ rates.T / rates.shape[1]
    np.fill_diagonal(found, 0.0)
    assert np.abs(found).max() < SIGMAS / math.sqrt(rates.shape[1])


@pytest.mark.parametrize("period", [0.01, 0.04])
def test_the_allan_deviation_of_a_gyro_is_that_of_noise_and_walk(period: float) -> None:
    """Over a time T it is sqrt(N^2 / T + K^2 T / 3), noise of density N and a bias that walks by K,
    whatever the control period: for 2 steps mostly the noise, for 40 mostly the walk."""
    noise, walks = 0.02, 0.3
    imu = QUIET["imu"] | {"gyro_noise_deg": noise, "gyro_walk_deg": walks}
    robots = Robots(SensingTable.model_validate(QUIET | {"imu": imu}), seeds(), period)
    rates = np.degrees([robots.read().angular_velocity for _ in range(40)])
    for count in (1, 20):
        first, second = rates[:count].mean(axis=0), rates[count : 2 * count].mean(axis=0)
        found, time = ((second - first) ** 2).mean() / 2, count * period
        # The bias is constant in a step: 1 + 1 / (2 count^2) of that of one that walks on and on.
        expected = noise**2 / time + walks**2 * time / 3 * (1 + 0.5 / count**2)
        assert found == pytest.approx(expected, rel=SIGMAS * math.sqrt(2.0 / (3 * N)))


def test_counts_of_encoders_do_not_add_up_to_an_error() -> None:
    """After a hundred steps forth and back, whatever jumps an endless surface makes by its period,
    the way read is within half a count of the way gone."""
    table = SensingTable.model_validate(QUIET | {"encoders": {"counts": 500, "radius_error": 0}})
    rng, count, period = np.random.default_rng(1), 2 * math.pi * RADIUS / 500, 0.02
    robots = Robots(table, seeds(50), body=Body(period))
    way, total = np.zeros((50, 3)), np.zeros((50, 3))
    for _ in range(100):
        way = way + rng.uniform(-0.002, 0.008, way.shape)
        total = total + robots.read(surfaces=way % period).body.travel
    error = total - way
    assert np.abs(error).max() == pytest.approx(count / 2, rel=0.05)
    assert error.std() == pytest.approx(count / math.sqrt(12.0), rel=0.3)


def test_an_accelerometer_feels_acceleration_less_gravity_in_its_own_frame() -> None:
    """A robot that falls freely feels nothing, one that stands its weight upward, and one that
    speeds up the rate of that, whichever way it is turned."""
    frame = rotation_about([1.0, -2.0, 0.5], 0.9)
    robots = Robots(SensingTable.model_validate(QUIET), ["a"])
    robots.read(rotation=frame[None])
    velocity, gravity = np.zeros(3), np.array([0.0, 0.0, -9.81])
    for change in (gravity, np.zeros(3), np.array([2.0, -1.0, 0.5])):
        velocity = velocity + change * PERIOD
        force = robots.read(velocity=velocity[None]).force[0]
        assert force == pytest.approx(frame.T @ (change - gravity))


def test_a_gyro_at_rest_turns_with_nothing_but_its_robot() -> None:
    """Turns are read in the robot's frame of the step before, one after the other."""
    robots = Robots(SensingTable.model_validate(QUIET), ["a"])
    steps = np.random.default_rng(2).normal(0.0, 0.2, (5, 1, 3))
    frame = np.eye(3)[None]
    for step in steps:
        frame = frame @ turned_by(step)
        readings = robots.read(rotation=frame)
        assert readings.rotation == pytest.approx(step)
        assert readings.angular_velocity == pytest.approx(step / PERIOD)


@pytest.mark.parametrize(
    "changes",
    [
        {"depth": {"scale_error": 0.02, "noise_floor": 0.004}},
        {"camera": "headlight", "headlight": {"bits": 16, "dirt": 0}},
        {"camera": "headlight", "headlight": {"bits": 16, "dirt": 0.03, "noise": 0}},
    ],
    ids=["depth", "noise", "dirt"],
)
def test_a_camera_states_the_spread_of_its_pictures(changes: dict[str, Any]) -> None:
    """About what a robot expects of grey pixels, those of a thousand robots scatter as ``spread``
    says, where the dirt of the walls has a standard deviation of a half."""
    camera = camera_of(SensingTable.model_validate(changes))
    met = np.repeat(hits(GREY), N, axis=0)
    met[:, :2, GRAIN] = np.random.default_rng(3).normal(0.0, 0.5, (N, 2))
    expected = camera.expected(hits(GREY), RAYS)
    picture = camera.picture(met, RAYS, np.arange(4), keys(seeds()), 0)
    found = np.nanstd((picture - expected)[:, :2], axis=0)
    few = SIGMAS / math.sqrt(2 * N)
    assert found / camera.spread(expected)[0, :2] == pytest.approx(1.0, abs=few)


def onboard(**changes: Any) -> list[ot.Scenario]:
    """Scenarios of robots by onboard sensors whose seeds are 0 to 199."""
    base = ot.load_scenario("straight", {"sensing.kind": "onboard"} | changes)
    return [base.model_copy(update={"seed": seed}) for seed in range(200)]


def test_what_robots_believe_as_they_begin_is_off_by_what_the_table_says() -> None:
    """Their place by its standard deviation, and their turn about the axis by any angle alike, or
    not at all where it is known."""
    for std, known in ((0.01, False), (0.03, True)):
        changes = {"sensing.start.distance_std": std, "sensing.start.theta5_known": known}
        simulation = ot.Simulation(onboard(**changes))
        location = simulation.senses.location
        error = location.distance - simulation.location.distance
        assert error.std() == pytest.approx(std, rel=SIGMAS / math.sqrt(400))
        assert error.mean() == pytest.approx(0.0, abs=SIGMAS * std / math.sqrt(200))
        turn = (location.theta5 - simulation.location.theta5) % (2 * math.pi) / (2 * math.pi)
        assert known == np.allclose(np.sin(math.pi * turn), 0.0)
        if not known:
            assert kstest(turn, "uniform").pvalue > 1e-4
            assert abs(np.corrcoef(turn, error)[0, 1]) < SIGMAS / math.sqrt(200)


@pytest.mark.parametrize(("latency", "both"), [(0.05, True), (0.12, False)])
def test_a_picture_arrives_after_its_latency_and_ends_take_turns(
    latency: float, both: bool
) -> None:
    """The first picture is taken at the start and reaches the robot by the latency later, others at
    the rate of the camera; they are of both ends in turn, or all of the one that leads."""
    changes = {"sensing.depth.latency": latency, "sensing.both_ends": both}
    simulation, arrivals = ot.Simulation(onboard(**changes)[:1]), []
    for _ in range(40):
        before = simulation.senses.localiser.shot
        simulation.step()
        shot = simulation.senses.localiser.shot
        if shot is not before:
            arrivals.append((simulation.time[0], int(shot.facing[0])))
    times, facing = zip(*arrivals, strict=True)
    assert times == pytest.approx([latency + 0.1 * i for i in range(len(times))])
    assert facing == tuple((-1) ** i if both else 1 for i in range(len(times)))
    assert len(times) == (4 if latency == 0.05 else 3)


@pytest.mark.parametrize("camera", CAMERAS)
def test_no_picture_is_due_of_a_robot_that_has_ended(camera: str) -> None:
    """Robots that are not reset at the same step take pictures in steps of their own; where all
    that are due have ended, none is taken, and the others go on."""
    base = onboard(**{"sensing.camera": camera})[0]
    short = ot.override(base, {"run.time_limit": 0.08})
    simulation = ot.Simulation([base, short], recording=False)
    for _ in range(3):
        simulation.step()
    simulation.reset([0], [base])
    shots = simulation.senses.taking
    for _ in range(7):
        simulation.step()
    assert (simulation.active.tolist(), shots.due.tolist()) == ([True, False], [False, True])
    before = shots.picture.copy()
    for _ in range(3):
        np.testing.assert_array_equal(shots.picture, before)
        simulation.step()
    assert np.nansum(shots.picture[0] != before[0]) > 0


def test_draws_are_uniform_and_normal() -> None:
    """In all their moments, for robots, pictures and pixels alike."""
    robots = keys(seeds())
    for draw in (0, 1, 1000):
        assert kstest(uniform(robots, "a", draw, 50).ravel(), "uniform").pvalue > 1e-4
        assert kstest(normal(robots, "a", draw, 50).ravel(), "norm").pvalue > 1e-4
    by_number = normal(robots, "a", np.arange(N), 3)
    assert by_number[7].tobytes() == normal(robots[7:8], "a", 7, 3)[0].tobytes()
    some = normal(robots, "a", 3, np.array([5, 2]))
    assert some.tobytes() == np.ascontiguousarray(normal(robots, "a", 3, 6)[:, [5, 2]]).tobytes()


def test_a_slip_ratio_is_the_slip_over_the_faster_speed_and_none_at_rest() -> None:
    """Between -1 and 1, also where belt and robot move against each other; what shakes a robot that
    stands by some tenths of a millimetre a second is no slip."""
    (sensor,) = (sensor for sensor in SENSORS if sensor.channel.name == "slip_ratio")
    belt = np.array([[0.1, 0.05, 0.1, -0.1, 5e-4, 0.002]])
    robot = np.array([[0.05, 0.1, -0.1, 0.1, -5e-4, 0.0]])
    state: Any = {"wall_speed": belt, "module_speed": robot, "slip_velocity": belt - robot}
    assert sensor.read(state)[0] == pytest.approx([0.5, -0.5, 1.0, -1.0, 0.0, 1.0])
