"""States in which episodes on a device begin: drawn and seated on the processor."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.autonomy.pilots import FixedRoute
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.episodes import EpisodeSampler
from omnitrack_sim.gym.options import EnvOptions
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.feature import Feature, entry_slices, steps_of_decision
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp.episodes import SIZES
from omnitrack_sim.warp.plant import FieldsBatch, differs, field_of

OwnState = Callable[[Simulation], Mapping[str, ArrayLike]]
"""What one kind of robot adds to the states at its start: arrays (n, ...) by name, in order."""
SEATINGS = 1024
"""Robots that are seated at once."""


@dataclass(frozen=True)
class Starts:
    """K states in which episodes begin.

    Attributes:
        simulation: of the processor that seated the last of them; model, routes and robot are those
            of all.
        hold: control steps of a decision.
        substeps: physics steps of a control step.
        arrays: (K, size) by name: ``state`` by ``episodes.SIZES`` and what the
            robot adds, ``qpos`` and ``ctrl`` of MuJoCo, and the
            fields of the model, in which robots differ.
    """

    simulation: Simulation
    hold: int
    substeps: int
    arrays: Mapping[str, Array]


def sampler_of(options: EnvOptions) -> EpisodeSampler:
    """Return what draws episodes on a device.

    Raises:
        InputError: an option, or the scenario, needs what there is not on a device.
    """
    _check(options)
    sampler = EpisodeSampler(options)
    if sampler.example.physics.collider != "exact":
        raise InputError(Fault("physics.collider", "is 'primitives'", ("exact",)))
    return sampler


def starts_of(
    sampler: EpisodeSampler, count: int, seed: int, threads: int, own: OwnState
) -> Starts:
    """Draw and seat the robots of ``count`` episodes, as the environments of ``gym`` do.

    Raises:
        InputError: the scenario is no single route.
    """
    rng, physics = np.random.default_rng(seed), sampler.example.physics
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
            threads=threads,
            recording=False,
        )
        parts.append(_arrays(simulation, batches[-1], own(simulation)))
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


def _arrays(
    simulation: Simulation, batch: FieldsBatch, own: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """Return the arrays (n, size) of the robots of a simulation at their start."""
    n = simulation.n
    columns = [*_state(simulation).values(), *own.values()]
    state = np.concatenate([np.asarray(each, float).reshape(n, -1) for each in columns], axis=1)
    arrays = {"state": state, "qpos": batch.bind("qpos"), "ctrl": batch.bind("ctrl")}
    arrays |= batch.fields
    return {name: np.array(values, float).reshape(n, -1) for name, values in arrays.items()}


def _state(simulation: Simulation) -> dict[str, ArrayLike]:
    """Return the numbers (n, ...) of any robot at its start, in the order of ``SIZES``."""
    readings, n, headway = simulation.readings, simulation.n, simulation.monitor.headway
    own: dict[str, ArrayLike] = {
        "place": place_of(simulation.location),
        "passage": simulation.location.passage,
        "slip": np.zeros(n),
        "effort_change": np.zeros(n),
        "waiting": headway.waiting,
        "farthest": headway.farthest,
        "steps": np.zeros(n),
        "gravity": simulation.setup.gravity,
        "goal": simulation.legs.end,
        "patience": headway.patience,
        "max_steps": [math.ceil(limit / simulation.period) for limit in headway.time_limit],
    }
    return {name: own[name] if name in own else readings[name] for name in SIZES}


def place_of(location: Location) -> Array:
    """Return the places (n, 17) of robots, as ``route_map`` has them."""
    numbers = (location.distance, location.offset, location.curvature, location.tilt)
    vectors = (location.aside, location.tangent, location.normal, location.turning)
    whole = [*(each[:, None] for each in (*numbers, location.theta5)), *vectors]
    return np.concatenate(whole, axis=1)


def entry_numbers(features: Sequence[Feature], shipped: Mapping[str, Feature]) -> NDArray[np.intp]:
    """Return where the entries of features stand among those of all shipped ones.

    Raises:
        InputError: a feature is a user's own.
    """
    slices, numbers = entry_slices(tuple(shipped.values())), []
    for feature in features:
        if shipped.get(feature.name) is not feature:
            problem = f"has {feature.name!r}; on a device there are the shipped features"
            raise InputError(Fault("observation", problem, tuple(shipped)))
        numbers += range(slices[feature.name].start, slices[feature.name].stop)
    return np.array(numbers)
