"""Published copies of the models: MJCF in ``models/``, meshes in ``assets/``. Byte-reproducible.

The robot of these models has lugs that turn in place, so that MuJoCo alone drives it. In the
package's own simulations the lugs of a chain travel, and the plant moves each row back by a pitch
now and then (``body``). In plain MuJoCo nobody does that, and the robot would leave its rows
behind. Here each lug is a ball of the same radius, at the same place and with the same contact,
that stays on its module and turns about the module's cross axis. All lugs of a module turn as one
and have the rotor's inertia between them.

At rolls of 0 and 180 degrees both robots drive alike. Between them the wall passes this one at the
belt speed times cos(roll), and the other at the whole belt speed up to the no-motion line.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.base.writing import write_files
from omnitrack_sim.pipes import (
    Assembly,
    Elbow,
    Fitting,
    Part,
    Route,
    Step,
    Straight,
    Tee,
    route,
)
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES, Omnitrack
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
    spring_free_length,
    tie_joints,
)
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.robots.omnitrack.looks import add_robot_looks
from omnitrack_sim.walls.geoms import add_walls, new_spec
from omnitrack_sim.walls.meshes import fitting_mesh, stl_bytes
from omnitrack_sim.walls.pipe_looks import add_cameras, add_pipe_looks

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
    """Add balls along the module that turn as one.

    A positive belt speed drives forward on the side that faces the wall at roll 0, and backward on
    the other.
    """
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


FITTINGS: Mapping[str, Fitting] = {
    "straight": Straight(0.5),
    "elbow_1.5d": Elbow(0.24),
    "elbow_90mm": Elbow(0.09),
    "tee": Tee(),
}
"""The published fittings, by the name of their files."""
SCENES: Mapping[str, str] = {"straight": "straight", "elbow": "elbow_1.5d", "tee": "tee"}
"""Scene name and the fitting that its robot stands before."""
START_DISTANCE = 0.10
"""Robot's centre from the start of the route in a scene's keyframe ``start``, m."""

SETTLING_TIME = 0.3
"""For which the robot of a scene stands before its keyframe is taken, s."""


def write_models(models_dir: Path, assets_dir: Path) -> list[Path]:
    """Write every published file; returns their paths. The folders are made when missing.

    Simulations build their models in memory; these files are for other programs, in which nobody
    moves travelling lugs back. So their robot is that of ``model.turning``.

    Raises:
        OutputError: a file cannot be written; then none is.
    """
    return write_files(_files(Path(models_dir), Path(assets_dir)))


def check_models(models_dir: Path, assets_dir: Path) -> list[str]:
    """Names of files that ``write_models`` would add, change or leave out.

    Raises:
        InputError: there are no published models, as beside a package that was installed from a
            wheel, or a file cannot be read.
    """
    try:
        if not (Path(models_dir).is_dir() or Path(assets_dir).is_dir()):
            raise InputError(
                Fault(
                    f"{models_dir}, {assets_dir}",
                    "no such folders; the published models live in a checkout of the project, not "
                    "in the installed package: name the checkout with --root, or write them with "
                    "--write",
                )
            )
        return _different(Path(models_dir), Path(assets_dir))
    except OSError as error:
        place = error.filename or models_dir
        raise InputError(Fault(str(place), f"cannot be read: {error.strerror or error}")) from error


def _different(models_dir: Path, assets_dir: Path) -> list[str]:
    files = _files(models_dir, assets_dir)
    wrong = [
        path.name
        for path, content in files.items()
        if not path.is_file() or path.read_bytes() != content
    ]
    strays = {
        p
        for folder, ends in ((models_dir, ("xml",)), (assets_dir, ("obj", "stl")))
        for e in ends
        for p in folder.glob(f"*.{e}")
    }
    return sorted([*wrong, *(p.name for p in strays - set(files))])


def _files(models_dir: Path, assets_dir: Path) -> dict[Path, bytes]:
    files: dict[Path, bytes] = {}
    assets: dict[bytes, str] = {}
    for name, spec in _specs().items():
        text, meshes = _published(spec, name, assets)
        files[models_dir / f"{name}.xml"] = text
        files |= {assets_dir / file: content for file, content in meshes.items()}
        # Equal meshes are written once, by the first model that has them.
        assets |= {content: file for file, content in meshes.items()}
    for name, fitting in FITTINGS.items():
        mesh = fitting_mesh(fitting)
        files[assets_dir / f"{name}.stl"] = stl_bytes(mesh)
        files[assets_dir / f"{name}.obj"] = _obj(mesh.vertices, mesh.faces)
    return files


def _specs() -> dict[str, mujoco.MjSpec]:
    specs = {"robot": _robot_spec()}
    specs |= {f"pipe_{name}": _pipe_spec(name, fitting) for name, fitting in FITTINGS.items()}
    specs |= {
        f"scene_{name}": _scene_spec(name, FITTINGS[fitting]) for name, fitting in SCENES.items()
    }
    return specs


def _robot_spec() -> mujoco.MjSpec:
    """The robot alone where nothing pulls on it: keyframe ``start`` with its springs free."""
    spec = new_spec("omnitrack_robot")
    robot = Omnitrack()
    spec.option.gravity = [0, 0, 0]
    chassis = add_turning_robot(spec, robot)
    add_robot_looks(spec, robot)
    light = spec.worldbody.add_light(name="sun", pos=[0.5, -1, 1], dir=[-0.5, 1, -1])
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    chassis.add_camera(
        name="front",
        pos=[0, 0, 0.5],
        xyaxes=[0, -1, 0, 1, 0, 0],
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
    )
    chassis.add_camera(
        name="side",
        pos=[0, -0.5, 0],
        xyaxes=[1, 0, 0, 0, 0, 1],
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
    )
    # With a high preload the arm meets its stop before the springs are free.
    free = min(spring_free_length(robot, robot.preload), robot.slide_range[1])
    _add_start(spec, Pose(), free)
    return spec


def _pipe_spec(name: str, fitting: Fitting) -> mujoco.MjSpec:
    """One fitting in its own frame: collision walls and the look of its far half."""
    spec = new_spec(f"omnitrack_pipe_{name}")
    network = Assembly((Part(name, fitting, Pose()),))
    add_walls(spec, network)
    add_pipe_looks(spec, network)
    add_cameras(spec, network)
    return spec


def _scene_route(fitting: Fitting) -> Route:
    """The fitting behind a straight, and another one behind it where it is no straight itself."""
    steps = [
        Step("entry", Straight(0.4), "start", "end"),
        Step(fitting.kind, fitting, *fitting.default_way),
    ]
    if not fitting.is_plain:
        steps.append(Step("exit", Straight(0.4), "start", "end"))
    return route(steps)


def _scene_spec(name: str, fitting: Fitting) -> mujoco.MjSpec:
    """A pipe run that begins upward, with the robot in its entry: keyframe ``start``."""
    way, robot = _scene_route(fitting), Omnitrack()
    spec = new_spec(f"omnitrack_scene_{name}")
    add_walls(spec, way.network)
    chassis = add_turning_robot(spec, robot)
    add_robot_looks(spec, robot)
    add_pipe_looks(spec, way.network)
    add_cameras(spec, way.network, chassis)
    distance = np.array([START_DISTANCE])
    start = Pose(way.centreline.frame(distance)[0], way.centreline.at(distance)[0][0])
    chassis.pos, chassis.quat = start.position, start.quaternion
    _add_start(spec, start, _settled_slide(spec))
    return spec


def _settled_slide(spec: mujoco.MjSpec) -> float:
    """Travel of the arms, m, at which springs and lug contacts balance, to a micrometre."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    while data.time < SETTLING_TIME:
        mujoco.mj_step(model, data)
    travel = [data.joint(f"slide_{number}").qpos[0] for number in range(1, MODULES + 1)]
    # Further digits would be noise in files that are compared byte by byte.
    return round(float(np.mean(travel)), 6)


def _add_start(spec: mujoco.MjSpec, pose: Pose, slide: float) -> None:
    """Keyframe ``start``: the robot at ``pose``, its arms out by ``slide`` m, at rest."""
    data = mujoco.MjData(spec.copy().compile())
    data.joint("robot").qpos[:] = [*pose.position, *pose.quaternion]
    for number in range(1, MODULES + 1):
        data.joint(f"slide_{number}").qpos[:] = slide
    spec.add_key(name="start", qpos=data.qpos)


def _published(
    spec: mujoco.MjSpec, model: str, known: Mapping[bytes, str]
) -> tuple[bytes, dict[str, bytes]]:
    """XML that reads its meshes from ``../assets``, and those meshes by file name."""
    for body in spec.bodies:
        if body.explicitinertial:
            body.ipos = np.nan_to_num(body.ipos)  # without a place the inertia is not written
    spec.compile()
    root = ET.fromstring(spec.to_xml())
    compiler = root.find("compiler")
    if compiler is None:
        raise RuntimeError(f"{model} has no compiler section")
    # Relative to the file, so that a copy of both folders works anywhere.
    compiler.set("meshdir", "../assets")
    meshes: dict[str, bytes] = {}
    by_name = {mesh.name: mesh for mesh in spec.meshes}
    for element in root.findall("asset/mesh"):
        mesh = by_name[element.attrib["name"]]
        content = _obj(np.reshape(mesh.uservert, (-1, 3)), np.reshape(mesh.userface, (-1, 3)))
        file = known.get(
            content, f"{model}_{mesh.name}.obj" if mesh.name not in model else f"{mesh.name}.obj"
        )
        meshes[file] = content
        for attribute in ("vertex", "face", "normal", "texcoord"):
            element.attrib.pop(attribute, None)
        element.set("file", file)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8") + b"\n", meshes


def _obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Wavefront OBJ: m, seven digits, faces counted from 1."""
    # Adding 0.0 makes negative zeros positive: they would differ in the file alone.
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in np.asarray(vertices, float) + 0.0]
    lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + 1]
    return ("\n".join(lines) + "\n").encode()
