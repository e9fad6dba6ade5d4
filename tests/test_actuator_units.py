"""Units of inputs, forces and speeds of actuators."""

import doctest

import mujoco
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots import actuator_units as module
from omnitrack_sim.robots.actuator_units import actuator_units

MODEL = """
<mujoco>
  <worldbody>
    <body name="hull">
      <freejoint name="root"/>
      <geom size=".05"/>
      <site name="nose"/>
      <body pos="0 0 .1">
        <joint name="hinge"/>
        <geom size=".01"/>
        <body><joint name="slide" type="slide"/><geom size=".01"/><site name="tip"/></body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="turned"><joint joint="hinge" coef="1"/></fixed>
    <fixed name="mixed"><joint joint="hinge" coef="1"/><joint joint="slide" coef="1"/></fixed>
    <spatial name="rope"><site site="nose"/><site site="tip"/></spatial>
  </tendon>
  <actuator>ACTUATORS</actuator>
</mujoco>
"""
HINGE, SLIDE = ("N m", "rad/s"), ("N", "m/s")


@pytest.mark.parametrize(
    ("actuators", "ctrl", "outputs"),
    [
        ('<velocity joint="hinge" kv="2"/>', "rad/s", HINGE),
        ('<velocity joint="slide" kv="2"/>', "m/s", SLIDE),
        ('<position joint="hinge" kp="2" kv=".1"/>', "rad", HINGE),
        ('<position joint="slide" kp="2"/>', "m", SLIDE),
        ('<intvelocity joint="hinge" kp="2" actrange="-1 1"/>', "rad/s", HINGE),
        ('<motor joint="hinge"/>', "1", HINGE),
        ('<motor joint="root" gear="0 0 0 1 0 0"/>', "1", HINGE),
        ('<motor joint="root" gear="1 0 0 0 0 0"/>', "1", SLIDE),
        ('<motor site="nose" gear="0 0 0 0 1 0"/>', "1", HINGE),
        ('<motor tendon="turned"/>', "1", HINGE),
        ('<motor tendon="mixed"/>', "1", SLIDE),
        ('<position tendon="rope" kp="1"/>', "m", SLIDE),
        ('<motor joint="hinge"/><motor joint="slide"/>', "1", ("N, N m", "m/s, rad/s")),
        ('<velocity joint="hinge"/><position joint="hinge"/>', "rad, rad/s", HINGE),
        ("", "1", SLIDE),
    ],
)
def test_units_are_those_of_the_model(actuators, ctrl, outputs):
    """One where all actuators are of one kind, by joint, tendon or gear; those of an input by what
    a servo is asked for."""
    units = actuator_units(mujoco.MjModel.from_xml_string(MODEL.replace("ACTUATORS", actuators)))
    assert units["ctrl"] == ctrl
    assert (units["actuator_force"], units["actuator_velocity"]) == outputs


def test_the_channels_of_a_robot_have_them():
    """Of a robot on wheels with servos of speed, and of its recorded run."""
    channels = ot.load_scenario("robots/presser_elbow").robot.channels
    names = "ctrl", "actuator_force", "actuator_velocity"
    assert [channels[name].unit for name in names] == ["rad/s", "N m", "rad/s"]
    assert channels["ctrl"].display.unit == "rad/s"


def test_examples_run():
    """Those of the docstrings."""
    tried = doctest.testmod(module)
    assert tried.attempted
    assert not tried.failed
