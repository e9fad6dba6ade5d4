"""The ledger: measurements of others' robots that could be read, and how each is simulated."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.paper.claim import Figure, alone, runs_of, speed_of
from omnitrack_sim.paper.experiments import AS_WRITTEN, REAL, random_tee_turns
from omnitrack_sim.paper.ledger import (
    Entry,
    Publication,
    Read,
    around,
    directions,
    drawn,
    of_draws,
    of_runs,
    published,
)
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.inchworm import Inchworm
from omnitrack_sim.robots.pirate import Pirate
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.scenario import load_scenario, override
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.walls.around import add_pipes

LEVEL = [1.0, 0.0, 0.0]
DRY, WET, ANY = (0.8, 1.0), (0.6, 0.8), (0.6, 1.0)
"""Friction of a dry and of a wet pipe, as the studies take them, and of either."""

MAKS = Publication(
    "Maks, Active guidance system for the PIRATE pipe inspection robot tethering cable, BSc "
    "report, University of Twente 2015",
    "https://5dok.net/document/zx5xn6po-active-guidance-pirate-pipe-inspection-robot-tethering-"
    "cable.html",
    Read.SUMMARY,
)
SURYAVANSHI = Publication(
    "Suryavanshi et al., Omnidirectional Tractable Three Module Robot, 2020",
    "https://robotics.iiit.ac.in/uploads/Main/Publications/kartik_etal_icra20.pdf",
    Read.WHOLE,
)
SELF_LOCKING = Publication(
    "Inchworm in-pipe robot with a self-locking mechanism, Advances in Mechanical Engineering, doi "
    "10.1177/1687814017749402",
    "https://sage.cnpereading.com/doi/10.1177/1687814017749402",
    Read.ABSTRACT,
)
MICRO = Publication(
    "Micro in-pipe robot with a self-locking mechanism, International Journal of Advanced Robotic "
    "Systems, doi 10.5772/59309",
    "https://sage.cnpereading.com/doi/10.5772/59309",
    Read.ABSTRACT,
)
SAAB = Publication(
    "Saab, Kumar and Ben-Tzvi, Design and analysis of a miniature modular inchworm robot, "
    "IDETC2016-59386",
    "https://fdocuments.in/document/idetc2016-design-and-analysis-of-mmir-final.html",
    Read.ABSTRACT,
)
YANG = Publication(
    "Yang et al., Design of an in-pipe robot with contact-angle-guided kinematic decoupling for "
    "crosstalk-suppressed locomotion, arXiv 2603.27245",
    "https://arxiv.org/html/2603.27245v1",
    Read.ABSTRACT,
)
MEGA_JOEY = Publication(
    "Autonomous, collaborative, and confined infrastructure assessment with purpose-built "
    "Mega-Joey robots, Robotics 14(6) 80, 2025",
    "https://www.mdpi.com/2218-6581/14/6/80",
    Read.ABSTRACT,
)


def _straight(length: float, bore: float = 0.16) -> dict[str, Any]:
    return {"kind": "straight", "length": length, "inner_diameter": bore}


def _pull(run: Result) -> float:
    """Pull, N, up to which a robot makes headway."""
    return float(run.metrics["pull_held_n"])  # type: ignore[arg-type]


@published(
    publication=MAKS,
    robot="PIRATE",
    ours="pirate",
    quote="The current tested prototype can pull with a force of 14N",
    stated=("14N",),
    value=14.0,
    unit="N",
    tuned="clamp_torque, at a bore of 100 mm and friction 0.8",
    statement="force at the tail at which it stops, on the level",
    how="friction 0.6 to 1.0 and bores of 51 to 120 mm by lot: the report's summary names neither",
    why="Friction and bore of the test are not in the summary.",
)
def pirate_pull(quick: bool) -> Figure:
    """Pull of the clamped chain."""
    draws = drawn(2 if quick else 24, friction=ANY, bore=(0.051, 0.12))
    changes = (
        {
            "pipes": [_straight(2.5, draw["bore"])],
            "robot.bore": draw["bore"],
            "world.friction": draw["friction"],
            "start.axis": LEVEL,
            "pull.force": 2.0,
            "pull.rate": 2.0,
        }
        for draw in draws
    )
    return of_draws([_pull(run) for run in alone("robots/pirate_elbow", changes)])


@published(
    publication=MAKS,
    robot="PIRATE",
    ours="pirate",
    quote="can travel at 80mm/s through pipe networks ranging from 51 to 120mm internal diameter",
    stated=("80mm/s",),
    value=80.0,
    unit="mm/s",
    tuned="the speed that is asked of the wheels",
    statement="speed in a straight of 100 mm, after the first second",
    how="friction 0.6 to 1.0 and the pipe's direction by lot",
    why="Motors give way to the weight.",
)
def pirate_speed(quick: bool) -> Figure:
    """Speed of the clamped chain, in any direction."""
    count = 6 if quick else 24
    course = {"pipes": [_straight(1.5, Pirate().bore)], "run.time_limit": 3.0}
    changes = (
        {**course, "world.friction": draw["friction"], "start.axis": axis}
        for draw, axis in zip(drawn(count, friction=ANY), directions(count), strict=True)
    )
    runs = runs_of("robots/pirate_elbow", changes)
    return of_draws([1e3 * speed_of(run, 1.0) for run in runs])


TEE: dict[str, Any] = {
    "publication": SURYAVANSHI,
    "robot": "Omnidirectional Tractable Three Module Robot",
    "ours": "omnitrack",
    "quote": "the robot was able to negotiate T-junction in a clean dry plastic pipe every single "
    "time",
    "stated": ("every single time",),
    "value": 100.0,
    "unit": "%",
    "statement": "part of the turns from a tee's run into its branch that pass, with alignment",
}
TEE_DRAWS = "motor that the paper names, exact walls; friction 0.8 to 1.0, start orientation and "
TEE_DRAWS += "gravity by lot"


def _tees(quick: bool, **changes: Any) -> Figure:
    """Part of random tee turns that pass."""
    base = override(load_scenario("tee_turn", REAL | {"run.expected_outcome": None}), changes)
    return of_runs(list(run_batch(random_tee_turns(base, 8 if quick else 48, DRY))))


@published(
    **TEE,
    tuned="the feedback controller, developed on this turn",
    how=f"feedback; {TEE_DRAWS}",
    why="The motor stalls in some turns.",
)
def tee_by_feedback(quick: bool) -> Figure:
    """Tee turns by feedback."""
    return _tees(quick)


@published(
    **TEE,
    how=f"the paper's speeds, open loop; {TEE_DRAWS}",
    why="Nothing corrects the heading, so that it leaves tilted or wedges; the authors "
    "coded the speeds of each turn by its orientation, and say neither how many turns they made "
    "nor with which preload.",
)
def tee_as_written(quick: bool) -> Figure:
    """Tee turns with the speeds of the paper."""
    return _tees(quick, **AS_WRITTEN)


INCHWORM = (
    "level; stride, time of a stretch and time of a clamp by lot, 0.7 to 1.4 times as assumed"
)


@cache  # entries share runs
def _inchworm_speeds(quick: bool) -> Figure:
    """Speed of our inchworm on the level, mm/s, over whole cycles."""
    robot = Inchworm()
    draws = drawn(
        6 if quick else 24,
        friction=ANY,
        stride=(0.7 * robot.stride, robot.stride),
        stretch_time=around(robot.stretch_time),
        switch_time=around(robot.switch_time),
    )
    changes = [
        {
            "pipes": [_straight(1.2)],
            "start.axis": LEVEL,
            "run.time_limit": 8.0,
            "world.friction": draw.pop("friction"),
            **{f"robot.{name}": value for name, value in draw.items()},
        }
        for draw in draws
    ]
    speeds = []
    for run in runs_of("robots/inchworm_elbow", changes):
        worm, record = run.scenario.robot, run.trajectory
        cycle = 2 * (worm.stretch_time + 2 * worm.switch_time)
        ends = cycle, cycle * np.floor(record.time[-1] / cycle)
        speeds.append(
            1e3 * np.diff(np.interp(ends, record.time, record["distance"])) / np.ptp(ends)
        )
    return of_draws(np.concatenate(speeds))


@published(
    publication=SELF_LOCKING,
    robot="self-locking hydraulic inchworm, 140 to 180 mm",
    ours="inchworm",
    quote="has 550 N traction ability with the average speed of 0.11 m/s",
    stated=("0.11 m/s",),
    value=110.0,
    unit="mm/s",
    statement="speed over whole cycles in a bore of 160 mm",
    how=INCHWORM,
    why="Stroke and cycle are not in the abstract; its hydraulic drive pushes all the time "
    '("continuous propulsion"), while ours stands still in 0.4 of 1.4 s.',
)
def inchworm_speed(quick: bool) -> Figure:
    """Speed of an inchworm."""
    return _inchworm_speeds(quick)


@published(
    publication=SAAB,
    robot="miniature modular inchworm, on surfaces",
    ours="inchworm",
    quote="the robot can achieves an average forward velocity of 11 mm/s on various surfaces",
    stated=("11 mm/s",),
    value=11.0,
    unit="mm/s",
    statement="speed over whole cycles in a bore of 160 mm",
    how=INCHWORM,
    why="Stride and rate of its modules are not in the abstract. It holds by a skin with two "
    "frictions, not by clamps, and was measured on surfaces, not in pipes.",
)
def small_inchworm_speed(quick: bool) -> Figure:
    """Speed of an inchworm, beside a small one's."""
    return _inchworm_speeds(quick)


@cache  # entries share runs
def _inchworm_pulls(quick: bool) -> list[Result]:
    """Return runs of our inchworm on the level against a pull that grows."""
    robot = Inchworm()
    names = "grip", "spindle_force"
    sizes = {name: around(getattr(robot, name)) for name in names}
    changes = (
        {
            "pipes": [_straight(1.6)],
            "start.axis": LEVEL,
            "pull.force": 20.0,
            "pull.rate": 8.0,
            "world.friction": draw["friction"],
            **{f"robot.{name}": draw[name] for name in names},
        }
        for draw in drawn(4 if quick else 24, friction=ANY, **sizes)
    )
    return runs_of("robots/inchworm_elbow", changes)


PULLS = "level, a pull that grows by 8 N/s; friction 0.6 to 1.0, grip and force of the spindle by "
PULLS += "lot, 0.7 to 1.4 times as assumed"


@published(
    publication=SELF_LOCKING,
    robot="self-locking hydraulic inchworm, 140 to 180 mm",
    ours="inchworm",
    quote="has 550 N traction ability with the average speed of 0.11 m/s",
    stated=("550 N",),
    value=550.0,
    unit="N",
    statement="force at the tail at which it stops",
    how=PULLS,
    why="Its clamps wedge: the pull itself presses them, so that hydraulics and not friction limit "
    "it. Ours are pressed by constant air, and the spindle's 80 N limit them.",
)
def inchworm_traction(quick: bool) -> Figure:
    """Traction of an inchworm."""
    return of_draws([_pull(run) for run in _inchworm_pulls(quick)])


@published(
    publication=MICRO,
    robot="micro inchworm with self-locking clamps, 17 to 20 mm",
    ours="inchworm",
    quote="has a blocking force up to 25N, and the maximum tractive force of the in-pipe robot "
    "based on such a locking mechanism is 12N",
    stated=("25N", "12N"),
    value=12 / 25,
    unit="N/N",
    statement="force at the tail at which it stops, over what a closed clamp carries (8 friction "
    "grip)",
    how=PULLS,
    why="Forces of its drive and of its clamp are not in the abstract.",
    note="Here as there the drive is weaker than the clamp; how much weaker ours is was assumed, "
    "so that the agreement is chance.",
)
def inchworm_traction_of_hold(quick: bool) -> Figure:
    """Traction of an inchworm by what its clamp holds."""
    runs = _inchworm_pulls(quick)
    holds = [8 * run.scenario.world.friction * run.scenario.robot.grip for run in runs]
    return of_draws([_pull(run) / hold for run, hold in zip(runs, holds, strict=True)])


@published(
    publication=YANG,
    robot="V-shaped robot with two motors",
    ours="pirate",
    quote="On a multi-material testbed including out-of-plane double elbows, the robot achieved a "
    "100% success rate in more than 10 independent round-trip trials",
    stated=("100% success rate",),
    value=100.0,
    unit="%",
    statement="part of the runs that pass two elbows of 1.5 D in planes at right angles",
    how="bore of 100 mm; straight between the elbows 0 to 6 bores, friction 0.6 to 1.0, roll and "
    "direction by lot",
    why="PIRATE, two V's long, turns into a bend's plane only where all of it lies in a straight. "
    "The V-shaped robot is one V, and rolls by a motor of its own, in elbows too.",
)
def double_elbows(quick: bool) -> Figure:
    """Two elbows out of one plane."""
    bore, count = Pirate().bore, 4 if quick else 24
    elbow = {"kind": "elbow", "mean_radius": 1.5 * bore, "inner_diameter": bore}
    draws = drawn(count, friction=ANY, gap=(0.001, 6 * bore), roll=(-180.0, 180.0))
    changes = (
        {
            "pipes": [
                _straight(0.6, bore),
                elbow,
                _straight(draw["gap"], bore),
                {**elbow, "turn_deg": 90.0},
                _straight(0.6, bore),
            ],
            "world.friction": draw["friction"],
            "start.theta5_deg": draw["roll"],
            "start.axis": axis,
        }
        for draw, axis in zip(draws, directions(count), strict=True)
    )
    return of_runs(alone("robots/pirate_elbow", changes))


def cart(friction: float, side: float) -> mujoco.MjModel:
    """Return the model of a cart with four locked wheels on the floor of a pipe along z.

    Args:
        friction: of wheels and wall.
        side: angle of the wheels from the pipe's lowest line, about its axis, degrees. Beyond 15 it
            may hold on longer than it slides: at rest, friction across the pipe can wedge it.
    """
    bore, wheel, angle = 0.15, 0.012, np.radians(side)
    reach = bore / 2 - wheel
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    body = spec.worldbody.add_body(name="cart", pos=[0.0, 0.0, 0.8])
    body.add_freejoint()
    for y in (-reach * np.sin(angle), reach * np.sin(angle)):
        for z in (-0.04, 0.04):
            place = [-reach * np.cos(angle), y, z]
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=place, size=[wheel, 0, 0])
    pipe = {"kind": "straight", "name": "pipe", "length": 1.0, "inner_diameter": bore}
    add_pipes(spec, Network(fittings=[pipe]), friction=friction)
    return spec.compile()


def slide_angle(friction: float, side: float) -> float:
    """Return the least slope of the pipe, degrees, at which the cart slides, to 0.2 degrees."""
    model, low, high = cart(friction, side), 0.0, 90.0
    while high - low > 0.2:
        slope = (low + high) / 2
        along, down = math.sin(math.radians(slope)), math.cos(math.radians(slope))
        model.opt.gravity[:] = -GRAVITY * down, 0.0, -GRAVITY * along
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 250)
        # Half a degree beyond the limit it would have 50 mm/s by now; contacts creep by 1 mm/s.
        low, high = (low, slope) if data.qvel[2] < -0.02 else (slope, high)
    return (low + high) / 2


SLOPE: dict[str, Any] = {
    "publication": MEGA_JOEY,
    "robot": "Mega-Joey, which rests on the pipe's floor",
    "ours": "a cart on four locked wheels",
    "quote": "The designed robot is able to operate in pipes with an inclination of up to 20 "
    "degrees in dry and up to 10 degrees in wet conditions",
    "unit": "degrees",
    "statement": "slope of the pipe at which it slides",
}
CART = "wheels 5 to 15 degrees beside the pipe's lowest line, by lot"


def _slopes(quick: bool, friction: tuple[float, float]) -> Figure:
    draws = drawn(4 if quick else 24, friction=friction, side=(5.0, 15.0))
    return of_draws([slide_angle(**draw) for draw in draws])


@published(
    **SLOPE,
    stated=("20 degrees",),
    value=20.0,
    how=f"friction 0.8 to 1.0 and {CART}",
    why="Not known. By statics 20 degrees are friction of 0.35, of bare plastic rather than of the "
    "rubber that is assumed; or its motors or its gait end sooner than friction.",
)
def slope_dry(quick: bool) -> Figure:
    """Slope of a dry pipe."""
    return _slopes(quick, DRY)


@published(
    **SLOPE,
    stated=("10 degrees",),
    value=10.0,
    how=f"friction 0.6 to 0.8 and {CART}",
    why="Not known, as dry. Water halves its slope and takes less from ours: wet pipes may be more "
    "slippery than 0.6 to 0.8.",
)
def slope_wet(quick: bool) -> Figure:
    """Slope of a wet pipe."""
    return _slopes(quick, WET)


ENTRIES: tuple[Entry, ...] = (
    tee_as_written,
    tee_by_feedback,
    pirate_pull,
    pirate_speed,
    double_elbows,
    inchworm_traction,
    inchworm_traction_of_hold,
    inchworm_speed,
    small_inchworm_speed,
    slope_dry,
    slope_wet,
)
"""In the order of the page."""
