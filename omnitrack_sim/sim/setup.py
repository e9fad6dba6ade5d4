"""From scenarios to what a batch needs: model, guide, start values, control settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import mujoco
import numpy as np

from omnitrack_sim.control import Settings
from omnitrack_sim.control.guide import Guide
from omnitrack_sim.model.collider import why_not
from omnitrack_sim.model.robot import spring_free_length
from omnitrack_sim.model.scene import build_scene, let_walls_sleep
from omnitrack_sim.pipes import Route
from omnitrack_sim.robot import MODULES, Robot
from omnitrack_sim.robot.drive import MOTORS, Motor
from omnitrack_sim.rotations import Array, cross, quaternion_from_matrix
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.plant import Trials

SLEEP_FROM = 1000
"""Number of geoms from which it pays to have MuJoCo pass over the walls, which needs an MjData a
trial."""


def uses_exact_collider(scenario: Scenario) -> bool:
    """Whether a run of the scenario has exact walls: it asks for them and the compiled collider
    loads here."""
    return scenario.physics.collider == "exact" and why_not() is None


def scene_of(scenario: Scenario, *, looks: bool = False) -> mujoco.MjSpec:
    """The scenario's pipes and robot as one MjSpec; ``looks`` adds what pictures need."""
    physics = scenario.physics
    exact = uses_exact_collider(scenario) and not looks
    spec = build_scene(
        scenario.route().network,
        scenario.robot,
        plates=scenario.plates,
        timestep=physics.timestep,
        wall_tolerance=physics.wall_tolerance,
        staves=physics.staves,
        exact=exact,
        looks=looks,
    )
    if len(spec.geoms) >= SLEEP_FROM:
        let_walls_sleep(spec)
    return spec


def start_poses(guide: Guide, distance: Array, theta5: Array) -> tuple[Array, Array]:
    """Positions (n, 3) m and rotations (n, 3, 3) of robots on the centreline, along its tangent,
    turned to ``theta5``.

    Args:
        guide: of the route.
        distance: (n,) m along the centreline.
        theta5: (n,) rad, module 1 from the turning direction of the next fitting.
    """
    position, tangent, _, _ = guide.at(distance)
    turning = guide.turning_direction(distance)
    side = cross(tangent, turning)
    x = np.cos(theta5)[:, None] * turning + np.sin(theta5)[:, None] * side
    return position, np.stack([x, cross(tangent, x), tangent], axis=-1)


def trials_of(scenarios: Sequence[Scenario], guide: Guide) -> Trials:
    """Start values and physical constants of each trial."""
    robots = [s.robot for s in scenarios]
    distance = np.array([s.start.distance for s in scenarios])
    theta5 = np.radians([s.start.theta5_deg for s in scenarios])
    position, rotation = start_poses(guide, distance, theta5)
    pipe_radius = np.array([guide.routes[way].fittings[0].radius for way in guide.way])
    return Trials(
        position=position,
        quaternion=quaternion_from_matrix(rotation),
        slide=np.repeat(
            (pipe_radius - [r.nominal_pipe_radius for r in robots])[:, None], 3, axis=1
        ),
        roll=np.repeat(np.radians([[s.start.roll_deg] for s in scenarios]), 3, axis=1),
        friction=np.array([s.contact.friction for s in scenarios]),
        gravity=np.array([s.world.gravity for s in scenarios], float),
        spring_free=np.array([spring_free_length(r, r.preload) for r in robots]),
        roll_torque=np.array([r.roll_torque for r in robots]),
    )


def motor_of(robot: Robot) -> Motor:
    """The robot's crawler motor with its torque limit."""
    motor = MOTORS[robot.motor]
    return (
        motor
        if robot.torque_limit is None
        else dataclasses.replace(motor, torque_limit=robot.torque_limit)
    )


def feasible_belt_speed(robot: Robot) -> float:
    """Belt speed that the motor holds against a third of the robot's weight, m/s: the worst steady
    climb."""
    motor = motor_of(robot)
    load = robot.mass * 9.81 / 3 * robot.lug_radius
    return motor.no_load_speed * max(0.0, 1 - load / motor.stall_torque) * robot.lug_radius


def settings_of(scenarios: Sequence[Scenario], guide: Guide) -> tuple[Settings, list[str | None]]:
    """Control settings of each trial, and a note for each whose cruise speed had to be scaled to
    its motor.

    The outer module of a bend of radius rho runs at (1 + R / rho) times the robot's speed, so the
    motor's speed limits the cruise speed. Belts are capped at what the motor holds.
    """
    cruise, limit, notes = [], [], []
    radii = []
    for s, way in zip(scenarios, guide.way, strict=True):
        route = guide.routes[way]
        factor = 1 + _sharpest_bend(s, route)
        radii.append(route.fittings[0].radius)
        highest = feasible_belt_speed(s.robot)
        speed = min(s.control.cruise_speed, highest / factor)
        scaled = speed < s.control.cruise_speed
        notes.append(
            f"cruise speed scaled from {s.control.cruise_speed:.4f} to {speed:.4f} m/s: motor "
            f"{s.robot.motor} holds "
            f"{highest:.4f} m/s and the outer module needs {factor:.2f} times the robot's speed"
            if scaled
            else None
        )
        cruise.append(speed)
        limit.append(min(s.control.speed_limit, highest))
    control = [s.control for s in scenarios]
    settings = Settings(
        cruise_speed=np.array(cruise),
        align=np.array([c.align for c in control]),
        retry=np.array([c.retry for c in control]),
        gain=np.array([c.gain for c in control]),
        lookahead=np.array([c.lookahead for c in control]),
        rotation_limit=np.array([c.rotation_limit for c in control]),
        speed_limit=np.array(limit),
        safe_margin=np.radians(
            [np.nan if c.safe_margin_deg is None else c.safe_margin_deg for c in control]
        ),
        reach=np.array([s.robot.reach for s in scenarios]),
        elbow_delay=np.array([c.elbow_delay for c in control]),
        tee_trigger=np.array(
            [
                r / 2 if c.tee_trigger is None else c.tee_trigger
                for c, r in zip(control, radii, strict=True)
            ]
        ),
    )
    return settings, notes


def _sharpest_bend(scenario: Scenario, route: Route) -> float:
    """Largest pipe radius over bend radius that a robot may meet: on its route, or in the network
    of a mission."""
    if scenario.mission is None:
        return max((p.radius / p.bend_radius for p in route.fittings if p.is_turn), default=0.0)
    fittings = [part.fitting for part in route.network.parts]
    return max((f.sharpest_bend(scenario.control.arcs) for f in fittings), default=0.0)


def start_qpos(scenario: Scenario, model: mujoco.MjModel) -> Array:
    """Joint positions (nq,) of a scenario's start."""
    guide = Guide.along(scenario.route(), np.array([scenario.start.distance]))
    data = mujoco.MjData(model)
    trials = trials_of([scenario], guide)
    data.joint("robot").qpos = np.concatenate([trials.position[0], trials.quaternion[0]])
    for i in range(MODULES):
        data.joint(f"slide_{i + 1}").qpos = trials.slide[0, i]
        data.joint(f"roll_{i + 1}").qpos = trials.roll[0, i]
    return data.qpos.copy()
