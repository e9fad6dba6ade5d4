"""Robots of other kinds, driven through pipes by their own controllers and ``mj_step``."""

import math
from types import SimpleNamespace

import mujoco
import numpy as np
import thrown_bodies

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, frame_along, matrix_from_quaternion, rotation_about
from omnitrack_sim.pipes import Cross, Elbow, Mitre, Step, Straight, Tee, Wye, route

CONTROL_PERIOD = 0.02  # s
MIDDLES = {
    "straight": (Straight(0.4), "start", "end"),
    "elbow": (Elbow(0.24), "start", "end"),
    "tee": (Tee(), "run_start", "run_end"),
    "branch": (Tee(), "run_start", "branch"),
    "merge": (Tee(), "branch", "run_end"),
    "cross": (Cross(), "run_start", "branch"),
    "mitre": (Mitre(), "start", "end"),
    "wye": (Wye(angle=math.radians(50)), "run_start", "run_end"),
}
UP, LEVEL, DOWN = (0, 0, 1), (1, 0, 0), (0, 0, -1)


def pipe(*kinds, axis=UP, turns=None, length=0.5, bore=0.16):
    """Route through a straight, some fittings by name or as steps have them, and a straight.

    ``turns`` are those at the fittings' joints, degrees.
    """
    steps = [Step("inlet", Straight(length, bore), "start", "end")]
    for i, kind in enumerate(kinds):
        turn = math.radians(turns[i]) if turns else 0.0
        steps.append(Step(f"part_{i}", *MIDDLES.get(kind, kind), turn))
    steps.append(Step("outlet", Straight(length, bore), "start", "end"))
    return route(steps, Pose(frame_along(axis, 0.0), np.zeros(3)))


class Drive:
    """A robot in pipes, placed on the axis at arc length ``s`` m and turned by ``roll`` degrees.

    Attributes:
        s: m, of its chassis along the route.
        samples: times, s, and arc lengths, m, at all control periods.
    """

    def __init__(self, robot, course, s=0.2, roll=0.0, edit=None, **walls):
        spec = robot.spec()
        if edit:
            edit(spec)
        self.pipes = ot.add_pipes(spec, course.network, **walls)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.course, self.s, self.samples = course, s, []
        line, at, pose = course.centreline, np.array([s]), self.data.qpos[:7]
        frame = line.frame(at)[0] @ rotation_about([0, 0, 1], math.radians(roll))
        pose[:3] = line.at(at)[0][0] + frame @ pose[:3]
        mujoco.mju_mat2Quat(pose[3:], (frame @ matrix_from_quaternion(pose[3:])).ravel())
        self.chassis = self.data.body(robot.chassis)
        self.gait = robot.gait
        mujoco.mj_forward(self.model, self.data)

    def run(self, seconds, until=math.inf):
        """Go on for some seconds, or until the chassis is at arc length ``until`` m."""
        data, end = self.data, self.data.time + seconds
        steps = round(CONTROL_PERIOD / self.model.opt.timestep)
        while data.time < end - 1e-9 and self.s < until:
            observation = SimpleNamespace(
                time=np.array([data.time]), qpos=data.qpos[None], qvel=data.qvel[None]
            )
            data.ctrl[:] = self.gait(observation)[0]
            mujoco.mj_step(self.model, data, steps)
            self.s = float(
                self.course.centreline.locate(self.chassis.xpos[None], np.array([self.s]))[0]
            )
            self.samples.append((data.time, self.s))
        return self

    @property
    def left(self):
        """Arc length that is left to the end of the route, m."""
        return self.course.length - self.s

    def speed(self, seconds):
        """Mean speed, m/s, over the last seconds."""
        times, s = np.transpose(self.samples)
        begin = times.searchsorted(times[-1] - seconds)
        return (s[-1] - s[begin]) / (times[-1] - times[begin])

    @property
    def weight(self):
        """Weight of the robot, N."""
        return 9.81 * self.model.body_mass.sum()


def swing_period(spec: mujoco.MjSpec, start, ball: float, pendulum: float, angle: float) -> tuple:
    """The period, s, of a ball without friction that swings along y, and that of a pendulum.

    Args:
        spec: of the pipes, with a step of 1 ms.
        start: (3,) m, where the ball is let go.
        ball: its radius, m.
        pendulum: length of that, m.
        angle: by which both swing out, rad.
    """
    body = spec.worldbody.add_body(pos=start)
    body.add_freejoint()
    body.add_geom(size=[ball, 0, 0], condim=1)
    model = spec.compile()
    data, across = mujoco.MjData(model), []
    for _ in range(4000):
        mujoco.mj_step(model, data)
        across.append(data.qpos[1])
    y = np.array(across)
    (down,) = np.nonzero((y[:-1] > 0) & (y[1:] <= 0))
    times = 0.001 * (down + y[down] / (y[down] - y[down + 1]))
    period = 2 * math.pi * math.sqrt(pendulum / 9.81) * (1 + angle**2 / 16)
    return np.diff(times).mean(), period


def check_that_thrown_bodies_stay(network: ot.Network) -> None:
    """Throw four bodies of each shape at 1 to 12 m/s: all are in the bore half a second later."""
    for shape in thrown_bodies.SHAPES:
        out, deepest = thrown_bodies.throw(network, shape, 0.002, None, 4, seed=3)
        assert out == 0
        assert deepest < 0.06


def gradient_error(fitting, points, gradient):
    """By how much gradients (n, 3) at points (n, 3) m differ from differences of the distance."""
    slopes = [
        fitting.signed_distance(points + e)[0] - fitting.signed_distance(points - e)[0]
        for e in 1e-6 * np.eye(3)
    ]
    return np.linalg.norm(np.stack(slopes, axis=-1) / 2e-6 - gradient, axis=1)
