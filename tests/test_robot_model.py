"""Laws of the compiled robot: inertias, springs, rows of lugs, servos; and how robots start."""

from __future__ import annotations

import functools

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.published import add_turning_robot
from omnitrack_sim.scenario import validate
from omnitrack_sim.walls.geoms import new_spec

ROBOT = Omnitrack()


@functools.cache
def model() -> mujoco.MjModel:
    """The robot alone, in free space."""
    spec = new_spec("robot")
    add_robot(spec, ROBOT)
    spec.option.gravity = [0.0, 0.0, 0.0]
    return spec.compile()


@pytest.mark.parametrize(
    ("body", "mass", "radius", "length"),
    [
        ("chassis", ROBOT.chassis_mass, ROBOT.chassis_radius, ROBOT.chassis_length),
        ("arm_1", ROBOT.arm_mass, ROBOT.arm_radius, ROBOT.shaft_spacing),
        ("module_2", ROBOT.module_mass - 2 * ROBOT.track_mass, ROBOT.lug_radius, ROBOT.length),
    ],
)
def test_bodies_have_the_inertia_of_a_cylinder(
    body: str, mass: float, radius: float, length: float
) -> None:
    """As MuJoCo itself gives it to a cylinder of that mass and size along z."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="b").add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, length / 2, 0], mass=mass
    )
    expected, found = spec.compile().body("b"), model().body(body)
    assert found.mass == pytest.approx(expected.mass)
    assert found.inertia == pytest.approx(expected.inertia)


@pytest.mark.parametrize("drive", ["three_motors", "differential"])
@pytest.mark.parametrize("add", [add_robot, add_turning_robot])
def test_the_model_weighs_what_its_parameters_say(drive, add):
    """Tracks are part of their module, and gears have inertia but no mass."""
    spec = mujoco.MjSpec()
    add(spec, Omnitrack(drive=drive))
    assert spec.compile().body_mass.sum() == pytest.approx(ROBOT.mass, rel=1e-6)


def passive(**joints: float) -> dict[str, float]:
    """Forces of springs, N and N m, on slide and pitch of arm 1 with its joints as given."""
    data = mujoco.MjData(model())
    for name, value in joints.items():
        data.joint(name).qpos = value
    mujoco.mj_forward(model(), data)
    return {name: float(data.joint(f"{name}_1").qfrc_passive[0]) for name in ("slide", "pitch")}


def test_springs_push_outward_and_upright() -> None:
    """Preload in the nominal pipe, stiffness about it, and about the pitch axis; neither feels the
    other, for a spring stands at either end of an arm."""
    free = ROBOT.preload / ROBOT.module_stiffness
    stiffness = ROBOT.module_stiffness * (ROBOT.shaft_spacing / 2) ** 2  # N m/rad, of the pitch
    for travel in (-0.01, 0.0, 0.005):
        pushed = passive(slide_1=travel)
        assert pushed["slide"] == pytest.approx(ROBOT.module_stiffness * (free - travel))
        assert pushed["pitch"] == pytest.approx(0.0, abs=1e-9)
    for pitch in (-0.03, 0.05):
        tipped = passive(pitch_1=pitch)
        assert tipped["pitch"] == pytest.approx(-stiffness * pitch)
        assert tipped["slide"] == pytest.approx(ROBOT.preload)
    assert passive(slide_1=2 * free)["slide"] == 0.0  # springs do not pull


def test_rows_of_lugs_are_the_same_from_either_end() -> None:
    """Lugs stand at one pitch, as far ahead of the module's middle as behind it."""
    for track in ("upper_1", "lower_3"):
        names = [f"lug_{track}_{i}" for i in range(ROBOT.lugs_per_track)]
        z = np.array([model().geom(name).pos[2] for name in names])
        assert np.diff(z) == pytest.approx(ROBOT.lug_pitch)
        assert z == pytest.approx(-z[::-1], abs=1e-12)


def test_the_rotary_servo_does_not_overshoot() -> None:
    """A module that is asked for a roll of 0.02 rad, within its torque, comes to it from below, and
    as fast as it can without passing it: critically damped for the rotor's inertia."""
    assert 0.02 * ROBOT.roll_stiffness < ROBOT.roll_torque
    roll = model().actuator("roll_1")
    inertia = ROBOT.rotary_motor.reflected_inertia
    stiffness, damping = roll.gainprm[0], -roll.biasprm[2]
    assert stiffness == -roll.biasprm[1] == ROBOT.roll_stiffness
    roots = np.roots([inertia, damping, stiffness])
    assert roots == pytest.approx([-damping / (2 * inertia)] * 2, rel=1e-5)
    data = mujoco.MjData(model())
    data.ctrl[model().actuator("roll_1").id] = 0.02
    reached = []
    for _ in range(500):
        mujoco.mj_step(model(), data)
        reached.append(float(data.joint("roll_1").qpos[0]))
    assert max(reached) < 0.02 * 1.01  # the module's own inertia comes to that of the rotor
    assert reached[-1] == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize("bore", [0.150, 0.160, 0.170])
def test_robots_start_with_their_arms_at_the_wall(bore: float) -> None:
    """In a bore wider or narrower than the nominal one the arms stand where the wall is, and do
    not jump from there."""
    pipe = {"kind": "straight", "length": 0.6, "inner_diameter": bore}
    scenario = validate({"pipes": [pipe], "run": {"time_limit": 0.1}})
    simulation = ot.Simulation([scenario])
    simulation.advance()
    (result,) = simulation.results()
    slide = result.trajectory["slide"]
    assert slide[0] == pytest.approx([(bore - ROBOT.nominal_bore) / 2] * 3, abs=3e-4)
    assert np.abs(slide - slide[0]).max() < 5e-4
    assert result.trajectory["contact_count"][1:].sum(axis=-1).min() > 0


def test_the_tracks_that_face_the_wall_touch_it() -> None:
    """The upper one, the lower one, and both near the no-motion line."""
    expected = {0: [True, False], 45: [True, False], 90: [True, True], 180: [False, True]}
    base = validate({"pipes": [{"kind": "straight", "length": 0.6}], "start": {"distance": 0.2}})
    brief = {"world.gravity": [0.0, 0.0, 0.0], "run.time_limit": 0.1}
    scenarios = [ot.override(base, brief | {"start.roll_deg": float(roll)}) for roll in expected]
    results = ot.run_batch(scenarios, no_load=False)
    for result, tracks in zip(results, expected.values(), strict=True):
        touched = (result.trajectory["contact_count"] > 0).any(axis=0)
        assert touched.tolist() == [tracks] * 3


def test_sprockets_turn_with_their_chains() -> None:
    """The surface of a sprocket moves as the upper run does where it faces the upper side, as the
    lower one on the other, and across the module's axis at its end."""
    spec, robot = new_spec("test"), Omnitrack()
    add_robot(spec, robot, line_tracks=True)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("belt_upper_2").qvel[0] = speed = 0.2
    for name in ("chain_2", "sprocket_front_2", "sprocket_rear_2"):
        tie = model.equality(name)
        data.qvel[model.jnt_dofadr[tie.obj1id[0]]] = tie.data[1] * speed
    mujoco.mj_forward(model, data)

    def velocity(body: str, out: np.ndarray) -> np.ndarray:
        """Velocity of the surface of a body in direction ``out``, both in the module's frame."""
        frame, jacobian = data.body("module_2").xmat.reshape(3, 3), np.zeros((3, model.nv))
        point = data.body(body).xpos + robot.lug_radius * frame @ out
        mujoco.mj_jac(model, data, jacobian, None, point, model.body(body).id)
        return frame.T @ jacobian @ data.qvel

    up, ahead = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    for end, sign in (("front", 1.0), ("rear", -1.0)):
        sprocket = f"sprocket_{end}_2"
        assert velocity(sprocket, up) == pytest.approx(velocity("track_upper_2", up))
        assert velocity(sprocket, -up) == pytest.approx(velocity("track_lower_2", -up))
        assert velocity(sprocket, sign * ahead) == pytest.approx(sign * speed * up)
