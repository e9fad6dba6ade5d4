"""Random approaches of a camera to a fitting, and the pictures that it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.autonomy.recognition import Detection
from omnitrack_sim.autonomy.recognition.forms import STILL, cameras
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.pipes import (
    Assembly,
    Elbow,
    Fitting,
    Part,
    Port,
    Reducer,
    Straight,
    Tee,
    attached,
)
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.senses.draws import keys
from omnitrack_sim.senses.optics import Camera, rays_of
from omnitrack_sim.walls.rays import RayWalls

Joint = tuple[Port, Port]
BORE = 0.16
PICTURES, WAY = 5, 0.1
"""Pictures of an approach, and the way, m, on which they are taken."""
NEAR, FAR = 0.08, 0.35
"""Distance of the last one from the port plane, m."""
ASIDE, TILT, SWAY = 0.004, math.radians(3), (0.0005, math.radians(0.3), math.radians(1))
"""Most that the robot stands beside the axis, m, and leans, rad; how much that and its roll change
between two pictures, standard deviations."""
ODOMETRY = 0.005, 0.002
"""Errors of the known motion: part of the way, and rad."""
CASES = {
    "straight": ("straight", ""),
    "elbow": ("elbow", "start"),
    "tee by its run": ("tee", "run_start"),
    "tee by its branch": ("tee", "branch"),
    "wye by its start": ("wye", "run_start"),
    "wye by its end": ("wye", "run_end"),
    "wye by its branch": ("wye", "branch"),
    "reducer": ("reducer", "start"),
    "open end": ("open end", ""),
    "closed end": ("closed end", ""),
}
"""What lies ahead, in equal parts: kind and port."""
TURNED = tuple(name for name, (kind, _) in CASES.items() if kind in ("elbow", "tee", "wye"))
"""Cases that have a direction."""


@dataclass(frozen=True)
class Approach:
    """An approach.

    Attributes:
        case: of ``CASES``. number: of the approach. fitting: that lies ahead.
        parts, closed: of the world. distance: m, and turn: rad, at the last picture.
        place, rotation: (v, 3) m and (v, 3, 3) of the cameras. motions: what is known of them.
    """

    case: str
    number: str
    fitting: Fitting | None
    parts: list[Part]
    closed: list[Port]
    distance: float
    turn: float
    place: Array
    rotation: Array
    motions: list[Pose]

    def pictures(self, camera: Camera) -> Array:
        """What the camera takes (v, pixels²)."""
        rays = rays_of(camera.optics)
        walls = RayWalls([self.parts], [self.closed], dirty=True)
        which = np.zeros(len(self.place), int)
        hits = walls.trace(which, self.place, self.rotation, rays, camera.optics.far, camera.lamp)
        key, pixels = keys([self.number]), np.arange(len(rays))
        return np.concatenate(
            [camera.picture(hits[i : i + 1], rays, pixels, key, i) for i in range(len(self.place))]
        )

    def is_right(self, detection: Detection) -> bool:
        """Whether kind and port are right."""
        return (detection.kind, detection.enter) == CASES[self.case]

    def turn_error(self, detection: Detection) -> float:
        """Error of the direction, rad; from the branch of a tee two are the same."""
        period = math.pi if self.case == "tee by its branch" else 2 * math.pi
        return abs((detection.turn - self.turn + period / 2) % period - period / 2)


def approach(seed: int, index: int, close: float = 0.0) -> Approach:
    """Draw approach ``index`` of a seed.

    Args:
        seed: of all approaches.
        index: of this one.
        close: share of the ports beyond the fitting on which another one follows directly.
    """
    rng = np.random.default_rng([seed, index])
    case = tuple(CASES)[index % len(CASES)]
    distance, turn = rng.uniform(NEAR, FAR), rng.uniform(-math.pi, math.pi)
    fitting, parts, closed = _world(rng, case, close)
    numbers = np.zeros((PICTURES, 6))
    numbers[:, :2] = _within(rng, ASIDE) + rng.normal(0, SWAY[0], (PICTURES, 2))
    numbers[:, 2:4] = _within(rng, TILT) + rng.normal(0, SWAY[1], (PICTURES, 2))
    numbers[:, 4] = distance + np.linspace(WAY, 0, PICTURES)
    numbers[:, 5] = turn + rng.normal(0, SWAY[2], PICTURES)
    place, rotation = (pose[:, 0] for pose in cameras(numbers, [STILL]))
    motions = [
        _known(rng, place[i], rotation[i], place[-1], rotation[-1]) for i in range(PICTURES - 1)
    ] + [STILL]
    number = f"{seed} {index}"
    return Approach(
        case, number, fitting, parts, closed, distance, numbers[-1, 5], place, rotation, motions
    )


def _known(
    rng: np.random.Generator, place: Array, rotation: Array, last: Array, turned: Array
) -> Pose:
    """What odometry tells of a camera, seen from the last one."""
    slip = rng.normal(0, ODOMETRY[1])
    error = rotation_about(rng.normal(size=3), slip)
    way = turned.T @ (place - last) * (1 + rng.normal(0, ODOMETRY[0]))
    return Pose(turned.T @ rotation @ error, way)


def _within(rng: np.random.Generator, most: float) -> Array:
    """A vector (2,), spread evenly over a disc."""
    around = rng.uniform(-math.pi, math.pi)
    return most * math.sqrt(rng.random()) * np.array([math.cos(around), math.sin(around)])


def _world(
    rng: np.random.Generator, case: str, close: float
) -> tuple[Fitting | None, list[Part], list[Port]]:
    """The fitting of a case, the parts of its world, and the ports that plates close."""
    while True:
        fitting, parts, closed, joints = _drawn_world(rng, case, close)
        if not close or _has_room(parts, joints):
            return fitting, parts, closed


def _has_room(parts: list[Part], joints: list[Joint]) -> bool:
    """Whether no two parts share space."""
    try:
        Assembly(tuple(parts), tuple(joints))
    except GeometryError:
        return False
    return True


def _drawn_world(
    rng: np.random.Generator, case: str, close: float
) -> tuple[Fitting | None, list[Part], list[Port], list[Joint]]:
    """The same, and the joints; parts may share space."""
    length = rng.uniform(0.3, 0.8)
    lead = Part("lead", Straight(length), Pose(np.eye(3), np.array([0.0, 0.0, -length])))
    behind = _joined(lead, "start", Straight(1.0), "end")
    parts, closed, joints = [lead, behind], [], [((0, "start"), (1, "end"))]
    if case in ("open end", "closed end"):
        return None, parts, [(0, "end")] if case == "closed end" else [], joints
    if case == "straight":
        fitting: Fitting = Straight(rng.uniform(1.0, 2.0))
    else:
        fitting = _fitting(rng, CASES[case][0])
    enter = CASES[case][1] or "start"
    part = _joined(lead, "end", fitting, enter)
    parts.append(part)
    joints.append(((0, "end"), (2, enter)))
    for port in fitting.port_names:
        if port != enter:
            _continue(rng, 2, port, parts, closed, joints, close)
    return (None if case == "straight" else fitting), parts, closed, joints


def _continue(
    rng: np.random.Generator,
    before: int,
    port: str,
    parts: list[Part],
    closed: list[Port],
    joints: list[Joint],
    close: float,
) -> None:
    """Go on beyond a port of part ``before``.

    There follows a straight, with an elbow, a plate, a tee or nothing at its end, or another
    fitting directly.
    """
    part = parts[before]
    bore = 2 * part.fitting.port_radius(port)
    if close and bore == BORE and rng.random() < close:
        fitting = _fitting(rng, str(rng.choice(["elbow", "tee", "wye", "reducer"])))
        enter = str(rng.choice([name for name in fitting.port_names if name != "end"]))
        parts.append(_joined(part, port, fitting, enter, rng.uniform(0, 2 * math.pi)))
        joints.append(((before, port), (len(parts) - 1, enter)))
        number = len(parts) - 1
        for beyond in fitting.port_names:
            if beyond != enter:
                _continue(rng, number, beyond, parts, closed, joints, 0.0)
        return
    straight = _joined(part, port, Straight(rng.uniform(0.3, 0.8), bore), "start")
    parts.append(straight)
    joints.append(((before, port), (len(parts) - 1, "start")))
    which, turn = rng.random(), rng.uniform(0, 2 * math.pi)
    if which < 0.4:
        elbow = Elbow(0.5625 * bore, inner_diameter=bore)
        parts.append(_joined(straight, "end", elbow, "start", turn))
        joints.append(((len(parts) - 2, "end"), (len(parts) - 1, "start")))
    elif which < 0.6:
        closed.append((len(parts) - 1, "end"))
    elif which < 0.8:
        parts.append(_joined(straight, "end", Tee(inner_diameter=bore), "run_start", turn))
        joints.append(((len(parts) - 2, "end"), (len(parts) - 1, "run_start")))


def _fitting(rng: np.random.Generator, kind: str) -> Fitting:
    """A fitting of sizes as in the shipped networks and in random ones."""
    if kind == "elbow":
        usual = rng.random() < 0.5
        radius = float(rng.choice([0.09, 0.24])) if usual else rng.uniform(0.09, 0.32)
        return Elbow(radius, math.radians(float(rng.choice([45, 90]))))
    if kind == "wye":
        return Wye(angle=math.radians(float(rng.choice([45, 60]))))
    if kind == "tee":
        return Tee()
    end = float(rng.choice([0.1, 0.12, 0.13, 0.14, 0.15, 0.17, 0.18, 0.2]))
    steep = abs(end - BORE) / 2 / math.tan(math.radians(10))
    return Reducer(max(0.1, math.ceil(100 * steep) / 100), end, BORE)


def _joined(part: Part, port: str, fitting: Fitting, enter: str, turn: float = 0.0) -> Part:
    return Part(fitting.kind, fitting, attached(part.port(port), fitting, enter, turn))
