"""Servos too stiff for their inertia: when a run says so, and what it costs."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots.kinds import ROBOTS, robot_class
from omnitrack_sim.robots.scene import compiled
from omnitrack_sim.robots.servos import MAX_RATIO, servo_notes, stiff_servos
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.run import run_batch

CAR = """<mujoco><option integrator="implicitfast" cone="elliptic" impratio="10"/><worldbody>
<body name="hull"><freejoint/><geom type="capsule" size=".02" fromto="0 0 -.05 0 0 .05" mass=".5"/>
{wheels}</body></worldbody><actuator>{motors}</actuator></mujoco>"""
GAIN, STEP = 2.0, 0.002


def car(armature: float) -> str:
    """Two rings of three sprung wheels with velocity servos, driving along z."""
    wheels, motors = "", ""
    for k in range(6):
        a = 2 * np.pi * (k % 3) / 3
        x, y, z = np.cos(a), np.sin(a), 0.05 * (1 if k < 3 else -1)
        wheels += (
            f'<body pos="{0.05 * x} {0.05 * y} {z}"><joint type="slide" axis="{x} {y} 0" '
            f'springref=".015" stiffness="2000" damping="20"/><geom size=".006" mass=".02"/>'
            f'<body name="wheel_{k}"><joint name="spin_{k}" axis="{-y} {x} 0" '
            f'armature="{armature}"/><geom type="cylinder" size=".025" mass=".05" '
            f'fromto="{-0.008 * y} {0.008 * x} 0 {0.008 * y} {-0.008 * x} 0"/></body></body>'
        )
        motors += f'<velocity name="m_{k}" joint="spin_{k}" kv="{GAIN}"/>'
    return CAR.format(wheels=wheels, motors=motors)


def test_the_ratio_is_that_of_gain_and_step_to_inertia():
    """Of every joint with a servo or damping; the inertia that is named is where it is 10."""
    model = mujoco.MjModel.from_xml_string(car(1e-4))
    inertia = 1e-4 + 0.05 * 0.025**2 / 2
    found = list(stiff_servos(model, STEP))
    assert [name for name, _, _ in found] == [f"spin_{k}" for k in range(6)]
    for _, ratio, least in found:
        assert ratio == pytest.approx(GAIN * STEP / inertia, rel=1e-6)
        assert least == pytest.approx(GAIN * STEP / MAX_RATIO)
    enough = mujoco.MjModel.from_xml_string(car(GAIN * STEP / MAX_RATIO))
    assert not list(stiff_servos(enough, STEP))
    assert not list(servo_notes(enough, STEP))
    assert list(servo_notes(enough, 2 * STEP))


class Faster:
    """Ask the wheels for a speed that grows by 0.1 m/s each second."""

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.shape, self.period, self.time = (setup.n, setup.model.nu), setup.period, 0.0

    def step(self, observation: ot.Observation) -> ot.Actuation:
        self.time += self.period
        return ot.Actuation(np.full(self.shape, 0.1 * self.time / 0.025))


@pytest.mark.parametrize(("armature", "slips"), [(0.0, True), (5e-4, False)])
def test_wheels_of_such_a_servo_slip_while_a_robot_speeds_up(armature, slips, tmp_path):
    """Tens of mm/s where they should by hardly any; the run notes it, with the inertia it takes."""
    file = tmp_path / "car.xml"
    file.write_text(car(armature))
    pipes = [{"kind": "straight", "length": 0.8}]
    robot = {"kind": "mjcf", "file": str(file), "bore": 0.16}
    scenario = validate({"robot": robot, "pipes": pipes, "run": {"time_limit": 0.5}})
    (run,) = run_batch([scenario], controller=Faster)
    slip = float(run.trajectory["contact_speed"][-1].max())
    assert (slip > 0.03) is slips
    assert (slip > 5e-4) is slips
    notes = [str(event) for event in run.events if "stiffer than contacts can follow" in str(event)]
    assert len(notes) == slips
    if notes:
        assert "'spin_0', 'spin_1'" in notes[0]
        assert "0.0004 or more" in notes[0]


@pytest.mark.parametrize("kind", sorted(set(ROBOTS) - {"mjcf"}))
def test_robots_of_the_package_have_no_such_servo(kind):
    """At the step of plain scenarios."""
    assert not list(stiff_servos(compiled(robot_class(kind)()), STEP))
