"""The robot of the published models: its lugs turn in place, so that MuJoCo alone drives it.

In the package's own simulations the lugs of a chain travel, and the plant moves each row back by a
pitch now and then (``body``). In plain MuJoCo nobody does that, and the robot would leave its rows
behind. Here each lug is a ball of the same radius, at the same place and with the same contact,
that stays on its module and turns about the module's cross axis.
All lugs of a module turn as one and have the rotor's inertia between them.

At rolls of 0 and 180 degrees both robots drive alike. Between them the wall passes this one at the
belt speed times cos(roll), and the other at the whole belt speed up to the no-motion line.
"""

from __future__ import annotations

import math

import mujoco

from omnitrack_sim.record.channels import TRACKS
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import (
    LUG_IMPEDANCE,
    add_arm,
    add_chassis,
    add_contact_sensor,
    add_module,
    add_motion_sensors,
    add_roll_motor,
    add_springs,
    belt_force,
    belt_inertia,
    contact_of_lugs,
    impedance,
    lug_places,
    roll_damping,
    set_cylinder_inertia,
    sized,
    tie_joints,
)

SERVO_BANDWIDTH = 500.0
"""Bandwidth of a belt's servo, rad/s. The package's speed loop is softer and has an integral part;
a velocity servo of MuJoCo has none, and would climb slower than it is asked."""


def add_turning_robot(spec: mujoco.MjSpec, robot: Omnitrack) -> mujoco.MjsBody:
    """Add the robot to the world at the origin, robot frame = world frame; returns the chassis.

    Bodies ``chassis``, ``arm_i``, ``module_i`` for i = 1, 2, 3 and ``lug_i_k``. Joints ``robot``
    (free), ``slide_i``, ``pitch_i``, ``roll_i``, ``lug_i_k``. Tendons ``spring_front_i``,
    ``spring_rear_i``, and ``belt_i``, whose length is the travel of the belt, m. Actuators
    ``roll_i`` (position servo, rad) and ``belt_i`` (velocity servo, m/s; forces in N at the belt).
    Sensors ``contact_i`` (net force of a module on the wall), ``velocity_i`` and ``spin_i``.
    """
    chassis = add_chassis(spec, robot)
    for number, angle in enumerate(MODULE_ANGLES, start=1):
        arm = add_arm(chassis, robot, number, angle)
        module = add_module(arm, robot, number)
        _add_lugs(spec, module, robot, number)
        add_springs(spec, robot, number)
        motor = add_roll_motor(spec, robot, number)
        # Half a turn either way, at no more than the motor's speed.
        motor.ctrllimited, motor.ctrlrange = True, [-math.pi, math.pi]
        motor.set_to_pid(
            kp=robot.roll_stiffness,
            kv=roll_damping(robot),
            slewmax=robot.roll_rate,
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
        )
        _add_belt_motor(spec, robot, number)
        add_contact_sensor(spec, f"contact_{number}", f"module_{number}")
        add_motion_sensors(spec, number)
    return chassis


def _add_lugs(spec: mujoco.MjSpec, module: mujoco.MjsBody, robot: Omnitrack, number: int) -> None:
    """Balls along the module that turn as one. A positive belt speed drives forward on the side
    that faces the wall at roll 0, and backward on the other."""
    places = lug_places(robot)
    belt = spec.add_tendon(name=f"belt_{number}")
    mass = len(TRACKS) * robot.track_mass / len(places)
    # The belt's inertia about a lug's axis, in equal shares.
    inertia = belt_inertia(robot) * robot.lug_radius**2 / len(places)
    for index, z in enumerate(places):
        name = f"lug_{number}_{index}"
        lug = module.add_body(name=name, pos=[0, 0, z])
        set_cylinder_inertia(lug, mass, robot.lug_radius, robot.lug_radius)
        lug.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0], armature=inertia)
        lug.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[robot.lug_radius, 0, 0],
            solimp=impedance(*LUG_IMPEDANCE, robot.contact_depth),
            **contact_of_lugs(robot),
        )
        # The tendon is the mean of the lugs' angles times their radius: the travel of the belt.
        belt.wrap_joint(name, robot.lug_radius / len(places))
        if index:
            # All lugs follow the first one, so that errors of the ties do not add up along the row.
            tie_joints(spec, robot, f"chain_{name}", name, f"lug_{number}_0")


def _add_belt_motor(spec: mujoco.MjSpec, robot: Omnitrack, number: int) -> None:
    """Velocity servo on a belt, up to the speed at which the motor has its full torque left."""
    force, speed = belt_force(robot), robot.motor.full_torque_speed * robot.lug_radius
    motor = spec.add_actuator(
        name=f"belt_{number}",
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        target=f"belt_{number}",
        forcelimited=True,
        forcerange=[-force, force],
        ctrllimited=True,
        ctrlrange=[-speed, speed],
    )
    motor.set_to_velocity(kv=belt_inertia(robot) * sized(robot, SERVO_BANDWIDTH, "rad/s"))
