"""States in which episodes on a device begin: drawn and seated on the processor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pilots import FixedRoute
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.episodes import EpisodeSampler
from omnitrack_sim.gym.options import EnvOptions
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.feature import steps_of_decision
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.drive import FIGURES, drive_of
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.policy.features import FEATURES
from omnitrack_sim.robots.size import GRAVITY as GRAVITY_SIZE
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp.plant import FieldsBatch, differs, field_of

SIZES = {
    "position": 3,
    "rotation": 9,
    "angular_velocity": 3,
    "roll": 3,
    "slide": 3,
    "pitch": 3,
    "belt_speed": 3,
    "motor_torque": 3,
    "normal_force": 3,
    "traction": 3,
    "slip_velocity": 3,
    "module_speed": 3,
    "contact_count": 6,
    "contact_position": 9,
    "place": 17,
    "passage": 1,
    "roll_set_point": 3,
    "forward": 3,
    "action": 4,
    "correction": 3,
    "first": 1,
    "first_passage": 1,
    "waiting": 1,
    "farthest": 1,
    "steps": 1,
    "time": 1,
    "gravity": 3,
    "speed_limit": 1,
    "cruise_speed": 1,
    "motor": FIGURES,
    "weight": 1,
    "goal": 1,
    "patience": 1,
    "max_steps": 1,
}
"""Numbers of a world's state beside MuJoCo's, in order: readings, location (``route_map``'s place),
controls, and what belongs to the episode."""
(
    POSITION,
    ROTATION,
    SPIN,
    ROLL,
    SLIDE,
    PITCH,
    BELT_SPEED,
    TORQUE,
    NORMAL_FORCE,
    TRACTION,
    SLIP,
    MODULE_SPEED,
    CONTACT_COUNT,
    CONTACT_POSITION,
    PLACE,
    PASSAGE,
    ROLL_SET,
    FORWARD,
    ACTION,
    CORRECTION,
    FIRST,
    FIRST_PASSAGE,
    WAITING,
    FARTHEST,
    STEPS,
    TIME,
    GRAVITY,
    SPEED_LIMIT,
    CRUISE_SPEED,
    MOTOR,
    WEIGHT,
    GOAL,
    PATIENCE,
    MAX_STEPS,
    STATE_SIZE,
) = accumulate(SIZES.values(), initial=0)
"""Where each begins, and how many there are."""
SEATINGS = 1024
"""Robots that are seated at once."""


@dataclass(frozen=True)
class Starts:
    """K states in which episodes begin.

    Attributes:
        simulation: of the processor that seated the last of them; model, routes and robot are those
            of all.
        options: of the environment.
        hold: control steps of a decision.
        substeps: physics steps of a control step.
        arrays: (K, size) by name: ``state`` by ``SIZES``, ``qpos`` and ``ctrl`` of MuJoCo, and the
            fields of the model, in which robots differ.
    """

    simulation: Simulation
    options: EnvOptions
    hold: int
    substeps: int
    arrays: Mapping[str, Array]


def starts_of(options: EnvOptions, count: int, seed: int) -> Starts:
    """Draw and seat the robots of ``count`` episodes, as the environments of ``gym`` do.

    Raises:
        InputError: an option, or the scenario, needs what there is not on a device.
    """
    _check(options)
    sampler, rng = EpisodeSampler(options), np.random.default_rng(seed)
    robot = sampler.example.robot
    _check_robot(robot)
    physics = sampler.example.physics
    if physics.collider != "exact":
        raise InputError(Fault("physics.collider", "is 'primitives'", ("exact",)))
    batches: list[FieldsBatch] = []

    def make_batch(model: mujoco.MjModel, n: int, threads: int, persistent: bool) -> FieldsBatch:
        batches.append(FieldsBatch(model, n, threads, persistent))
        return batches[-1]

    parts, simulation, left = [], None, count
    while left:
        scenarios = [sampler.draw(rng) for _ in range(min(left, SEATINGS))]
        left -= len(scenarios)
        simulation = Simulation(
            scenarios,
            make_plant=lambda first, start, threads: first.robot.plant(
                first.to_spec().compile(),
                start,
                first.physics.control_period,
                threads,
                (),
                make_batch,
            ),
            threads=options.threads,
            recording=False,
        )
        parts.append(_arrays(simulation, batches[-1]))
    assert simulation is not None
    if simulation.legs.pilots[0].__class__ is not FixedRoute:
        raise InputError(Fault("scenario", "has a mission; on a device robots drive one route"))
    names = parts[0].keys() | {name for part in parts for name in part}
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in names}
    model = simulation.model
    fields = {name: values for name, values in arrays.items() if name not in ("state", *_OF_DATA)}
    for name, values in fields.items():
        shape = np.shape(field_of(model, name))
        if not differs(model, name, values.reshape(count, *shape)):
            del arrays[name]
    period = physics.control_period
    return Starts(
        simulation,
        options,
        steps_of_decision(period),
        round(period / physics.timestep),
        arrays,
    )


_OF_DATA = ("qpos", "ctrl")


def _check(options: EnvOptions) -> None:
    """Refuse options that mean nothing on a device."""
    faults = []
    if options.acting != "direct":
        faults.append(Fault("acting", f"is {options.acting!r}", ("direct",)))
    if options.picture or options.render_mode is not None:
        key = "picture" if options.picture else "render_mode"
        faults.append(Fault(key, "is there on the processor alone"))
    if options.sensing == "onboard":
        faults.append(Fault("sensing", "is 'onboard'", ("truth",)))
    if faults:
        raise InputError(faults)


def _check_robot(robot: object) -> None:
    """Refuse robots whose motors are not on the device."""
    if not isinstance(robot, Omnitrack):
        raise InputError(Fault("robot.kind", "is another robot", ("omnitrack",)))
    if not drive_of(robot.drive).direct:
        raise InputError(Fault("robot.drive", f"is {robot.drive!r}", ("three_motors",)))


def _arrays(simulation: Simulation, batch: FieldsBatch) -> dict[str, Array]:
    """Return the arrays (n, size) of the robots of a simulation at their start."""
    n = simulation.n
    arrays = {"state": _state(simulation), "qpos": batch.bind("qpos"), "ctrl": batch.bind("ctrl")}
    arrays |= batch.fields
    return {name: np.array(values, float).reshape(n, -1) for name, values in arrays.items()}


def _state(simulation: Simulation) -> Array:
    """Return the states (n, STATE_SIZE) of robots at their start."""
    readings, setup, n = simulation.readings, simulation.setup, simulation.n
    location, headway = simulation.location, simulation.monitor.headway
    own = {
        "place": place_of(location),
        "passage": location.passage,
        "roll_set_point": setup.command.roll,
        "forward": belt_sign(setup.command.roll),
        "action": np.zeros((n, 4)),
        "correction": np.zeros((n, 3)),
        "first": np.zeros(n),
        "first_passage": np.full(n, -1.0),
        "waiting": headway.waiting,
        "farthest": headway.farthest,
        "steps": np.zeros(n),
        "gravity": setup.gravity,
        "speed_limit": setup.settings.speed_limit,
        "cruise_speed": setup.settings.cruise_speed,
        "motor": simulation.plant.motors.figures,
        "weight": setup.own("mass") * GRAVITY_SIZE,
        "goal": simulation.legs.end,
        "patience": headway.patience,
        "max_steps": [math.ceil(limit / simulation.period) for limit in headway.time_limit],
    }
    columns = [own[name] if name in own else readings[name] for name in SIZES]
    return np.concatenate([np.asarray(each, float).reshape(n, -1) for each in columns], axis=1)


def place_of(location: Location) -> Array:
    """Return the places (n, 17) of robots, as ``route_map`` has them."""
    numbers = (location.distance, location.offset, location.curvature, location.tilt)
    vectors = (location.aside, location.tangent, location.normal, location.turning)
    whole = [*(each[:, None] for each in (*numbers, location.theta5)), *vectors]
    return np.concatenate(whole, axis=1)


def entry_numbers(options: EnvOptions, robot: Omnitrack) -> NDArray[np.intp]:
    """Return where the entries of an observation stand among those of all shipped features.

    Raises:
        InputError: a feature is a user's own.
    """
    names, first = list(FEATURES), np.cumsum([0, *(f.size for f in FEATURES.values())])
    numbers: list[int] = []
    for feature in options.features(robot):
        if FEATURES.get(feature.name) is not feature:
            problem = f"has {feature.name!r}; on a device there are the shipped features"
            raise InputError(Fault("observation", problem, tuple(names)))
        begin = int(first[names.index(feature.name)])
        numbers += range(begin, begin + feature.size)
    return np.array(numbers)
