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
from omnitrack_sim.gym.episodes import NETWORKS, EpisodeSampler, with_values
from omnitrack_sim.gym.options import EnvOptions
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.feature import Feature, entry_slices, steps_of_decision
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.warp.episodes import SIZES
from omnitrack_sim.warp.plant import FieldsBatch, differs, field_of, near_origins

OwnState = Callable[[Simulation], Mapping[str, ArrayLike]]
"""What one kind of robot adds to the states at its start: arrays (n, ...) by name, in order."""
SEATINGS = 1024
"""Robots that are seated at once, at most."""
ROOM = 0.5
"""Distance between networks that stand side by side, m: none touches what is another's."""


@dataclass(frozen=True)
class Starts:
    """K states in which episodes begin.

    Attributes:
        simulation: of the processor that seated the last of them; model, routes and robot are those
            of all.
        hold: control steps of a decision.
        substeps: physics steps of a control step.
        origins: (K, 3) m, from which positions in ``qpos`` count.
        arrays: (K, size) by name: ``state`` by ``episodes.SIZES`` and what the
            robot adds, ``qpos`` and ``ctrl`` of MuJoCo, and the
            fields of the model, in which robots differ.
    """

    simulation: Simulation
    hold: int
    substeps: int
    origins: Array
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
    sampler: EpisodeSampler, count: int, seed: int, networks: int, threads: int, own: OwnState
) -> Starts:
    """Draw and seat the robots of ``count`` episodes, as the environments of ``gym`` do.

    Args:
        sampler: draws them.
        count: K.
        seed: of the draws.
        networks: see ``SideBySide``.
        threads: with which robots are seated.
        own: what the robot adds to the states.

    Raises:
        InputError: the scenario is no single route, or there are fewer starts than networks.
    """
    rng = np.random.default_rng(seed)
    if not sampler.alike and count < networks:
        raise InputError(Fault("starts", f"is {count}; {networks} networks need one each"))
    drawn = sampler if sampler.alike else SideBySide(sampler, networks, rng)
    batches: list[FieldsBatch] = []

    def make_batch(model: mujoco.MjModel, n: int, threads: int, persistent: bool) -> FieldsBatch:
        batches.append(FieldsBatch(model, n, threads, persistent))
        return batches[-1]

    parts, first, left = [], None, count
    while left:
        scenarios = [drawn.draw(rng) for _ in range(min(left, SEATINGS))]
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
        first = first or simulation
        if sampler.alike and not isinstance(simulation.legs.pilots[0], FixedRoute):
            raise InputError(Fault("scenario", "has a mission; on a device robots drive one route"))
        parts.append(_arrays(simulation, batches[-1], own(simulation)))
    assert first is not None
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    fields = {name: values for name, values in arrays.items() if name not in ("state", *_OF_DATA)}
    for name, values in fields.items():
        shape = np.shape(field_of(first.model, name))
        if not differs(first.model, name, values.reshape(count, *shape)):
            del arrays[name]
    origins = near_origins(arrays["qpos"][:, :3])
    arrays["qpos"][:, :3] -= origins
    physics = sampler.example.physics
    period, timestep = physics.control_period, physics.timestep
    hold, substeps = steps_of_decision(period), round(period / timestep)
    return Starts(first, hold, substeps, origins, arrays)


class SideBySide:
    """Random missions through random networks that stand side by side, as pipes of one model.

    Args:
        sampler: of the scenario "random_network".
        count: number of networks.
        rng: draws them.
    """

    def __init__(self, sampler: EpisodeSampler, count: int, rng: np.random.Generator) -> None:
        self._sampler, self._next = sampler, 0
        missions = [sampler.mission(int(rng.integers(NETWORKS))) for _ in range(count)]
        fittings, joints, places, x = [], [], [], 0.0
        for k, mission in enumerate(missions):
            assert mission.network is not None
            own = mission.network.pipes.parts
            samples = np.concatenate([part.bore_samples() for part in own])
            data = mission.network.model_dump(mode="json")
            x += ROOM - float(samples[:, 0].min())
            at = data["place"]["position"]
            data["place"]["position"] = [at[0] + x, *at[1:]]
            x += float(samples[:, 0].max())
            places.append(data["place"] | {"fitting": _named(k, data["fittings"][0]["name"])})
            for row in data["fittings"]:
                fittings.append(row | {"name": _named(k, row["name"])})
            for row in data["joints"]:
                joints.append(row | {"ports": [_named(k, port) for port in row["ports"]]})
        place = {key: value for key, value in places[0].items() if key != "fitting"}
        network = {"place": place, "fittings": fittings, "joints": joints, "places": places[1:]}
        self._bases = []
        for k, mission in enumerate(missions):
            assert mission.mission is not None
            way = {"start": _named(k, mission.mission.start)}
            way["goals"] = [_named(k, goal) for goal in mission.mission.goals]
            own = {"name": mission.name, "network": network, "mission": way}
            self._bases.append(validate(mission.model_dump(mode="json") | own))

    def draw(self, rng: np.random.Generator) -> Scenario:
        """Return the scenario of the next episode; networks take turns."""
        base = self._bases[self._next]
        self._next = (self._next + 1) % len(self._bases)
        values = self._sampler.values(rng)
        scenario = with_values(base, values)
        if "start.distance" not in values:
            # Planned once: of what is drawn, the way depends on nothing else.
            scenario.__dict__["planner"] = base.planner
        return scenario


def _named(number: int, name: str) -> str:
    """Return the name of a part, or of a port, of a network among others."""
    return f"{number}_{name}"


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
        "route": simulation.location.route,
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
