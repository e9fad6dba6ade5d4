"""The robot as MJCF: chassis, and three sprung arms with rolling modules of two tracks each.

A track is a row of sphere lugs on a slide joint along the module. The lugs of a running belt stand
still on the wall while the robot passes over them, as on the real chain; after each lug pitch the
plant moves the row back by one pitch, so it never runs out. The motor's reflected rotor inertia is
the armature of that joint, so belt, friction and robot are solved together in one implicit step. A
belt speed set from outside would need steps of microseconds against stiff friction, because three
belts in one pipe are coupled rigidly.

At the ends of a module the chain runs round its sprockets: spheres that turn with the belt about
the module's cross axis. On exact walls an end that a wall faces touches with its sprocket, which
drives along the wall and does not push the row back (``track``); in rows of spheres the
outermost lugs touch.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import quaternion_from_matrix, rotation_about
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES, Omnitrack
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.robots.omnitrack.drive import Drive, drive_of
from omnitrack_sim.robots.omnitrack.track import install_lines, line_record, sprocket_record
from omnitrack_sim.robots.quantity import similar

COLLISION_GROUP = 3
LUG_CONTYPE, LUG_CONAFFINITY = 1, 2
"""Lugs touch walls (2, 1) and nothing else."""
FRICTION = 0.9
"""Of a lug on the wall in a model as it is built; the plant sets each robot's own."""
LUG_IMPEDANCE = (0.95, 0.99)
"""Impedance of a lug's contact at its surface and from the robot's ``contact_depth`` on."""
LINE_IMPEDANCE = (0.993, 0.993)
"""Of a row of lugs seen as one line. It rests on two points instead of 15 lugs, which together
should be as stiff: (1 - d) / d is 2/15 of the lugs'."""
CHAIN_TIME = 0.004
"""Time constant of the ties by which the two runs of a chain and its sprockets move as one, s;
numerical."""
SPROCKET_MASS, SPROCKET_INERTIA = 0.01, 0.02
"""Mass of a sprocket as a part of a track's, which goes without it, and its part of the inertia at
its belt; numerical."""
MODULE_ENDS = {"front": 1.0, "rear": -1.0}
"""Ends of a module, with a sprocket and a spring each, and their sides along z."""
SPHERE = 1e-9
"""Half length of a capsule that is a sphere, m."""
STOP_TIME, STOP_IMPEDANCE = 0.005, (0.95, 0.99)
"""Time constant, s, and impedance of the stops of an arm's slide and pitch: 1 kN/mm, so that no
arm stands beyond its stop."""
TIE_DEPTH = 0.001
"""Travel over which ties and stops come to their full stiffness, m; MuJoCo's own default. At a
pitch stop it is an angle, rad, which does not scale."""
FREE_SPRING_LENGTH = 10.0
"""Upper end of the springs' dead band, m: springs push only. Beyond all travel of the robot, and
beyond the longest free length that its preload may ask for."""


def add_robot(
    spec: mujoco.MjSpec, robot: Omnitrack, *, line_tracks: bool = False
) -> mujoco.MjsBody:
    """Add the robot to the world at the origin, robot frame = world frame; returns the chassis.

    With ``line_tracks`` each row of lugs is one capsule from its first lug to its last, for the
    compiled collider.

    Bodies ``chassis``, ``arm_i``, ``module_i``, ``track_upper_i``, ``track_lower_i``,
    ``sprocket_front_i``, ``sprocket_rear_i`` for i = 1, 2, 3. Joints ``robot`` (free), ``slide_i``,
    ``pitch_i``, ``roll_i``, ``belt_upper_i``, ``belt_lower_i``, ``sprocket_front_i``,
    ``sprocket_rear_i`` (tied: one chain). Tendons ``spring_front_i``, ``spring_rear_i``. Actuators
    ``roll_i`` (position, rad) and ``belt_i`` (velocity servo, m/s; forces in N at the belt).
    Sensors ``contact_upper_i``, ``contact_lower_i`` (net force of a track), ``touch_upper_i``,
    ``touch_lower_i`` (sum of its normal forces), and with ``line_tracks`` the same of sprockets.
    """
    if line_tracks:
        install_lines()
    chassis = add_chassis(spec, robot)
    for number, angle in enumerate(MODULE_ANGLES, start=1):
        arm = add_arm(chassis, robot, number, angle)
        module = add_module(arm, robot, number)
        for track, side in zip(TRACKS, (1.0, -1.0), strict=True):
            _add_track(module, robot, f"{track}_{number}", side, line_tracks)
            _add_force_sensors(spec, robot, f"{track}_{number}", f"track_{track}_{number}")
        for end, side in MODULE_ENDS.items():
            _add_sprocket(module, robot, f"sprocket_{end}_{number}", side, line_tracks)
            if line_tracks:
                _add_force_sensors(spec, robot, f"{end}_{number}", f"sprocket_{end}_{number}")
        add_springs(spec, robot, number)
        add_roll_motor(spec, robot, number)
        # The lower run of a chain and the sprockets follow the upper one.
        belt = f"belt_upper_{number}"
        tie_joints(spec, robot, f"chain_{number}", f"belt_lower_{number}", belt)
        for end in MODULE_ENDS:
            name = f"sprocket_{end}_{number}"
            tie_joints(spec, robot, name, name, belt, 1 / robot.lug_radius)
    add_belt_motors(spec, robot)
    return chassis


def add_chassis(spec: mujoco.MjSpec, robot: Omnitrack) -> mujoco.MjsBody:
    """The chassis with the robot's free joint."""
    chassis = spec.worldbody.add_body(name="chassis")
    chassis.add_freejoint(name="robot")
    set_cylinder_inertia(chassis, robot.chassis_mass, robot.chassis_radius, robot.chassis_length)
    return chassis


def set_cylinder_inertia(body: mujoco.MjsBody, mass: float, radius: float, length: float) -> None:
    """Mass and inertia of a solid cylinder along z, kg and kg m²."""
    across = mass * (3 * radius**2 + length**2) / 12
    body.mass, body.ipos = mass, [0, 0, 0]
    body.inertia = [across, across, mass * radius**2 / 2]
    body.explicitinertial = True


def add_arm(chassis: mujoco.MjsBody, robot: Omnitrack, number: int, angle: float) -> mujoco.MjsBody:
    """The arm of a module at ``angle`` rad: it slides radially and pitches on its shafts."""
    turn = rotation_about([0, 0, 1], angle)
    arm = chassis.add_body(
        name=f"arm_{number}",
        pos=turn @ [robot.module_distance, 0, 0],
        quat=quaternion_from_matrix(turn),
    )
    set_cylinder_inertia(arm, robot.arm_mass, robot.arm_radius, robot.shaft_spacing)
    stop_time = [sized(robot, STOP_TIME, "s"), 1.0]
    arm.add_joint(
        name=f"slide_{number}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[1, 0, 0],
        limited=True,
        range=robot.slide_range,
        damping=[robot.slide_damping, 0, 0],
        solref_limit=stop_time,
        solimp_limit=impedance(*STOP_IMPEDANCE, sized(robot, TIE_DEPTH, "m")),
    )
    arm.add_joint(
        name=f"pitch_{number}",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],
        limited=True,
        range=[-robot.pitch_limit, robot.pitch_limit],
        damping=[robot.pitch_damping, 0, 0],
        solref_limit=stop_time,
        solimp_limit=impedance(*STOP_IMPEDANCE, TIE_DEPTH),
    )
    return arm


def add_module(arm: mujoco.MjsBody, robot: Omnitrack, number: int) -> mujoco.MjsBody:
    """A module without tracks: it rolls about its own axis, z."""
    module = arm.add_body(name=f"module_{number}")
    mass = robot.module_mass - len(TRACKS) * robot.track_mass
    set_cylinder_inertia(module, mass, robot.lug_radius, robot.length)
    module.add_joint(
        name=f"roll_{number}",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 0, 1],
        # Behind its gears the rotor is a hundred times as hard to turn as the module itself.
        armature=robot.rotary_motor.reflected_inertia,
    )
    return module


def _add_track(
    module: mujoco.MjsBody, robot: Omnitrack, name: str, side: float, line: bool
) -> None:
    """One run of the chain: a row of sphere lugs along z.

    ``side`` is 1 above the module axis, -1 below it. A positive belt speed moves the upper run
    backward, which drives forward where it is at the wall, and the lower run forward.
    """
    track = module.add_body(name=f"track_{name}")
    track.ipos = [0, 0, 0]
    track.mass, track.explicitinertial = (1 - SPROCKET_MASS) * robot.track_mass, True
    track.inertia = [track.mass * robot.lug_radius**2] * 3
    track.add_joint(
        name=f"belt_{name}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, -side],
        # The runs of a chain and its sprockets are tied, so that each carries its part.
        armature=(1 / len(TRACKS) - SPROCKET_INERTIA) * output_inertia(robot),
    )
    places, radius = lug_places(robot), robot.lug_radius - robot.track_offset
    if line:
        track.add_geom(
            name=f"line_{name}",
            pos=[side * robot.track_offset, 0, 0],
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            # MuJoCo measures a capsule without its caps: half of the way from first to last lug.
            size=[radius, places[-1], 0],
            solimp=impedance(*LINE_IMPEDANCE, robot.contact_depth),
            userdata=line_record(robot.lug_pitch, robot.scale, side),
            **contact_of_lugs(robot),
        )
        return
    for index, z in enumerate(places):
        track.add_geom(
            name=f"lug_{name}_{index}",
            pos=[side * robot.track_offset, 0, z],
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0, 0],
            solimp=impedance(*LUG_IMPEDANCE, robot.contact_depth),
            **contact_of_lugs(robot),
        )


def _add_sprocket(
    module: mujoco.MjsBody, robot: Omnitrack, name: str, end: float, line: bool
) -> None:
    """The sprocket at the front, ``end`` = 1, or rear, -1, of a module: at the last lug's place."""
    sprocket = module.add_body(name=name, pos=[0, 0, end * lug_places(robot)[-1]])
    inertia = SPROCKET_INERTIA * output_inertia(robot) * robot.lug_radius**2
    sprocket.mass, sprocket.explicitinertial = SPROCKET_MASS * robot.track_mass, True
    sprocket.inertia = [robot.track_mass * robot.lug_radius**2] * 3
    sprocket.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],
        armature=inertia,
    )
    if line:
        sprocket.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[robot.lug_radius, SPHERE, 0],
            solimp=impedance(*LINE_IMPEDANCE, robot.contact_depth),
            # The front's sphere comes before the rear's.
            userdata=sprocket_record(int(end)),
            **contact_of_lugs(robot),
        )


def contact_of_lugs(robot: Omnitrack) -> dict[str, Any]:
    """Fields of every geom that touches the wall: masks, friction, stiffness in time."""
    return {
        "contype": LUG_CONTYPE,
        "conaffinity": LUG_CONAFFINITY,
        "condim": 3,
        # With the higher priority the lug's friction and stiffness count, not a mixture with the
        # wall's.
        "priority": 1,
        "friction": [FRICTION, 0, 0],
        "solref": [robot.contact_time, 1.0],
        # The mass stands on the body: it must not change with the number of lugs.
        "mass": 0,
        "group": COLLISION_GROUP,
    }


def sized(robot: Omnitrack, value: float, unit: str) -> float:
    """A constant of this module, which is for a robot of scale 1, in a robot of its own scale."""
    return similar(value, unit, robot.scale)


def impedance(surface: float, deep: float, depth: float) -> list[float]:
    """MuJoCo's solimp: impedance from ``surface`` to ``deep`` over ``depth`` (m or rad).

    It follows a parabola on either side of the middle.
    """
    return [surface, deep, depth, 0.5, 2.0]


def lug_places(robot: Omnitrack) -> np.ndarray:
    """Positions (K,) m of the lugs along the module's z axis.

    The K lugs are at one pitch and centred, so that the row covers the contact length.
    """
    return (np.arange(robot.lugs_per_track) - (robot.lugs_per_track - 1) / 2) * robot.lug_pitch


def add_springs(spec: mujoco.MjSpec, robot: Omnitrack, number: int) -> None:
    """Add the front and rear springs of an arm (Fig. 2).

    Each pushes on the arm at its own shafts, and only pushes. Together they give the
    radial stiffness k and the pitch stiffness k (spacing / 2)^2.
    """
    for end, side in MODULE_ENDS.items():
        spring = spec.add_tendon(name=f"spring_{end}_{number}")
        # As long as the arm has moved at these shafts; linear in the pitch, which stays below 4
        # degrees.
        spring.wrap_joint(f"slide_{number}", 1.0)
        spring.wrap_joint(f"pitch_{number}", side * robot.shaft_spacing / 2)
        spring.stiffness = [robot.module_stiffness / 2, 0, 0]
        # MuJoCo leaves a tendon alone between both lengths: from the free length on the spring is
        # slack.
        free = spring_free_length(robot, robot.preload)
        spring.springlength = [free, sized(robot, FREE_SPRING_LENGTH, "m")]


def spring_free_length(robot: Omnitrack, preload: float) -> float:
    """Arm travel at which the springs are free, m.

    It is the preload over the stiffness of the module's springs.
    """
    return preload / robot.module_stiffness


def add_roll_motor(spec: mujoco.MjSpec, robot: Omnitrack, number: int) -> mujoco.MjsActuator:
    """The servo that rolls a module: a position, rad."""
    motor = spec.add_actuator(
        name=f"roll_{number}",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=f"roll_{number}",
        forcelimited=True,
        forcerange=[-robot.roll_torque, robot.roll_torque],
    )
    motor.set_to_position(kp=robot.roll_stiffness, kv=roll_damping(robot))
    return motor


def roll_damping(robot: Omnitrack) -> float:
    """Rate gain of a rotary servo, N m s/rad: critically damped for the rotor's inertia."""
    return 2 * math.sqrt(robot.roll_stiffness * robot.rotary_motor.reflected_inertia)


def tie_joints(
    spec: mujoco.MjSpec,
    robot: Omnitrack,
    name: str,
    follower: str,
    leader: str,
    ratio: float = 1.0,
) -> None:
    """An equality by which one joint moves as another does, times ``ratio``."""
    spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=follower,
        name2=leader,
        data=[0, ratio, *[0] * 10],
        solref=[sized(robot, CHAIN_TIME, "s"), 1.0],
        solimp=impedance(0.9, 0.95, ratio * sized(robot, TIE_DEPTH, "m")),
    )


def add_motion_sensors(spec: mujoco.MjSpec, number: int) -> None:
    """Velocity ``velocity_i`` and angular velocity ``spin_i`` of a module, world axes."""
    for name, kind in (
        ("velocity", mujoco.mjtSensor.mjSENS_FRAMELINVEL),
        ("spin", mujoco.mjtSensor.mjSENS_FRAMEANGVEL),
    ):
        spec.add_sensor(
            name=f"{name}_{number}",
            type=kind,
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
            objname=f"module_{number}",
        )


def add_contact_sensor(spec: mujoco.MjSpec, name: str, body: str) -> None:
    """Add a sensor of the net contact of all that hangs on a body.

    It reads (found, force (3,), position (3,)) in world axes; the force is that on the wall.
    """
    fields = mujoco.mjtConDataField
    wanted = sum(
        1 << int(f) for f in (fields.mjCONDATA_FOUND, fields.mjCONDATA_FORCE, fields.mjCONDATA_POS)
    )
    # MuJoCo's reduction 3 sums all contacts of the body into one, which takes one slot.
    net_force, slots = 3, 1
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname=body,
        intprm=[wanted, net_force, slots],
    )


def _add_force_sensors(spec: mujoco.MjSpec, robot: Omnitrack, name: str, body: str) -> None:
    """Sensors ``contact_`` and ``touch_`` of a body: net contact, and sum of the normal forces, N.

    The net force is not the sum: where contacts have different normals, as at a rim, or
    where the arm does not stand at right angles to the wall, friction has a share along the arm.
    """
    add_contact_sensor(spec, f"contact_{name}", body)
    zone = spec.body(body).add_site(
        name=f"touch_{name}",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        # A touch sensor counts the contacts inside its site: large enough for all of the body's.
        size=[robot.length, 0, 0],
        group=COLLISION_GROUP,
        rgba=[0, 0, 0, 0],
    )
    spec.add_sensor(
        name=f"touch_{name}",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=zone.name,
    )


OUTPUT_INERTIA = 0.02
"""Inertia of a belt with its sprockets behind gears that it shares with others, as a part of the
reflected inertia of a motor: 0.2 kg; numerical."""
SHAFT_MASS = 1e-9
"""Of a shaft's body, kg: its inertia is its joint's armature, the mass that of the modules."""
GEAR_TIME, GEAR_IMPEDANCE, FRICTION_IMPEDANCE = 0.004, (0.99, 0.99), (0.9995, 0.9995)
"""Time constant, s, impedance of the tie between a shaft and its belts, and that of friction
in gears and brakes; numerical."""


def belt_inertia(robot: Omnitrack) -> float:
    """Reflected inertia of the crawler gearmotor at the belt, kg: J / r²."""
    return robot.motor.reflected_inertia / robot.lug_radius**2


def belt_force(robot: Omnitrack) -> float:
    """Largest force of a crawler motor at the belt, N: its torque over the lug radius."""
    return robot.motor.max_torque / robot.lug_radius


def output_inertia(robot: Omnitrack) -> float:
    """Inertia at a belt that is the belt's own, kg.

    It is the rotor's where the motor drives this belt alone, else a small part of it.
    """
    own = 1.0 if drive_of(robot.drive).direct else OUTPUT_INERTIA
    return own * belt_inertia(robot)


def add_belt_motors(spec: mujoco.MjSpec, robot: Omnitrack) -> None:
    """Velocity servos ``belt_k`` of the robot's drive, m/s; their forces are in N at the belts.

    A motor that drives one belt alone acts on its upper run. Others act on the slide joint
    ``shaft_k`` of a body of its own, with the rotor's inertia, which is tied to the mean motion of
    its belts. (A tendon with armature would not do: MuJoCo leaves out the inertia that such a
    tendon puts between joints of different branches.) Where gears leave the belts free to move
    against each other, tendons ``gear_i`` can hold them by friction, see ``robot.gear_friction``.
    """
    drive = drive_of(robot.drive)
    if robot.brake_force > 0:
        for i in range(1, MODULES + 1):
            _hold_well(spec.joint(f"belt_upper_{i}"), robot)
    for number, row in enumerate(drive.matrix, start=1):
        joint = f"belt_upper_{number}" if drive.direct else _add_shaft(spec, robot, number, row)
        limit = drive.size * belt_force(robot)
        motor = spec.add_actuator(
            name=f"belt_{number}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=joint,
            forcelimited=True,
            forcerange=[-limit, limit],
        )
        motor.set_to_velocity(kv=drive.size * belt_inertia(robot) * robot.motor.speed_bandwidth)
    if robot.gear_friction > 0:
        for belt, name in friction_tendons(drive):
            _hold_well(_add_tendon(spec, name, drive.relative[belt]), robot)


def _hold_well(rubbing: mujoco.MjsJoint | mujoco.MjsTendon, robot: Omnitrack) -> None:
    """Friction that lets what stands still creep by under 1 mm/s."""
    rubbing.solref_friction = [similar(GEAR_TIME, "s", robot.scale), 1.0]
    rubbing.solimp_friction = [*FRICTION_IMPEDANCE, 1.0, 0.5, 2.0]


def _add_shaft(spec: mujoco.MjSpec, robot: Omnitrack, number: int, row: np.ndarray) -> str:
    """A motor's shaft, geared to belts with coefficients (3,); the name of its joint."""
    joint, inertia = f"shaft_{number}", drive_of(robot.drive).size * belt_inertia(robot)
    body = spec.worldbody.add_body(name=joint, mass=SHAFT_MASS, inertia=[SHAFT_MASS] * 3)
    # A shaft stands for gears inside the robot: gravity must not drive it.
    body.explicitinertial, body.gravcomp = True, 1.0
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    body.add_joint(name=joint, type=slide, axis=[0, 0, 1], armature=inertia)
    _add_tendon(spec, f"belts_{number}", row)
    spec.add_tendon(name=joint).wrap_joint(joint, 1.0)
    spec.add_equality(
        name=f"gears_{number}",
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
        name1=f"belts_{number}",
        name2=joint,
        data=[0, 1, *[0] * 10],
        solref=[similar(GEAR_TIME, "s", robot.scale), 1.0],
        solimp=[*GEAR_IMPEDANCE, 1.0, 0.5, 2.0],
    )
    return joint


def friction_tendons(drive: Drive) -> list[tuple[int, str]]:
    """Belts, from 0, that gears leave free to move against others, each with its tendon's name."""
    return [(i, f"gear_{i + 1}") for i, row in enumerate(drive.relative) if row.any()]


def _add_tendon(spec: mujoco.MjSpec, name: str, row: np.ndarray) -> mujoco.MjsTendon:
    """A tendon as long as the belts have moved, each times its coefficient in ``row`` (3,)."""
    tendon = spec.add_tendon(name=name)
    for belt, coefficient in enumerate(row, start=1):
        if coefficient:
            # The upper run stands for the whole belt: the lower one is tied to it.
            tendon.wrap_joint(f"belt_upper_{belt}", float(coefficient))
    return tendon
