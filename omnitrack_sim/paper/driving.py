"""Claims about kinematics, the motion singularity region, and driving.

Straight pipes, rolls, the no-motion line, preload, motors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion, wrap_angle
from omnitrack_sim.paper.claim import (
    Claim,
    ClaimVerdict,
    Measurement,
    Sample,
    claim,
    difference,
    speed_of,
)
from omnitrack_sim.paper.claim_figures import inner_module
from omnitrack_sim.paper.experiments import FRICTIONS, PRELOAD_FACTORS, Runs, min_preload
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import mean_interval
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import Omnitrack, as_omnitrack
from omnitrack_sim.robots.omnitrack.kinematics import (
    angular_velocity,
    cross_velocity,
    mean_velocity,
)
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.robots.size import GRAVITY

_WINDOW = 10
"""Samples over which rotation and speeds are averaged, because single lugs shake the robot."""
_TURNING = 0.15
"""Rotation rate above which a sample counts as turning, rad/s."""
_SECTOR, _MARGIN = 96.54, 11.78
"""Singular sector and safe margin on either side as the paper prints them, degrees."""
_FAILURE, _SUCCESS = 80.45, 19.55
"""Parts of the start orientations that fail and pass a tee as the paper prints them, %."""
_AS_PRINTED = 0.02
"""Tolerance of figures that the paper prints with two decimals, in their own unit."""


@claim(
    source="Section III, Eq. 9",
    paper="V_cz is the mean of the module speeds; no Coriolis effect with equal arms",
    statement="climbing speed within {percent:g} % of the mean wall speed; cross velocity of equal "
    "arms below {crosswise:g} m/s",
    limits={"percent": 1, "crosswise": 1e-12},
    how="vertical_climb; kinematics.mean_velocity",
)
def eq9_mean_speed(runs: Runs, percent: float, crosswise: float) -> Measurement:
    """Eq. 9: the robot's speed is the mean of the module speeds."""
    (result,) = runs["vertical_climb"]
    trajectory = result.trajectory
    steady = trajectory.time > 1.0
    mean = float(trajectory["wall_speed"][steady].mean())
    climbed = float(np.polyfit(trajectory.time[steady], trajectory["distance"][steady], 1)[0])
    # Unequal speeds and a turn about the axis: with equal arms nothing may be left across it.
    across = float(
        np.abs(
            mean_velocity([0.1, 0.12, 0.08], 0.6, np.full(3, Omnitrack().module_distance))[:2]
        ).max()
    )
    return Measurement(
        f"{1e3 * climbed:.2f} against {1e3 * mean:.2f} mm/s; cross velocity {across:.0e} m/s",
        abs(climbed / mean - 1) < percent / 100 and across < crosswise,
        uncertainty="fit over the climb after 1 s",
    )


@claim(
    source="Section III, after Eq. 9",
    paper="holonomic motion during horizontal traversal gives non-planar velocities and "
    "additional stresses",
    statement="while rolling, normal forces of the modules differ by over {more:g} N more in a "
    "flat than in an upright pipe",
    limits={"more": 2},
    how="paper/holonomic_alignment with gravity along and across the pipe; friction, preload, "
    "orientation and walls by lot",
    sample=Sample.AVERAGE,
)
def eq8_unequal_arms(runs: Runs, more: float) -> Measurement:
    """Eq. 8: rolling in a horizontal pipe, where the arms differ, stresses the robot."""
    flat, upright = (
        [_rolling_spread(result) for result in runs[name]]
        for name in ("rolling_flat", "rolling_upright")
    )
    spread = difference([force for force, _ in flat], [force for force, _ in upright])
    scrub = float(np.mean([speed for _, speed in flat]))
    return Measurement(
        f"spread, flat against upright: {spread.text('N', 1)}; Eq. 8 leaves {1e3 * scrub:.2f} mm/s "
        "across the axis",
        spread.over(more),
        uncertainty=f"Student's t, {len(flat)} draws, one roll of about 165 degrees each",
    )


def _rolling_spread(result: Result) -> tuple[float, float]:
    """Return what a roll does to a robot, by the mean over it.

    Returns:
        Largest less least normal force of the modules, N, and the speed, m/s, that Eq. 8 leaves
        across the axis.
    """
    trajectory, robot = result.trajectory, as_omnitrack(result.scenario.robot)
    # All modules are asked for the same roll, and it changes: they roll together.
    rolling = np.ptp(trajectory["roll_command"], axis=-1) < 1e-9
    rolling &= np.gradient(trajectory["roll_command"][:, 0]) != 0
    lengths = robot.module_distance + trajectory["slide"][rolling]
    # Modules that roll on the inside of the pipe turn the robot by r / R of their roll.
    rate = robot.roll_rate * robot.lug_radius / robot.nominal_pipe_radius
    across = np.linalg.norm(cross_velocity(np.full(len(lengths), rate), lengths), axis=-1)
    return float(np.ptp(trajectory["normal_force"][rolling], axis=-1).mean()), float(across.mean())


def lever_of(results: list[Result]) -> tuple[float, float]:
    """Lever, m, that fits the module speeds to the rotation of the robot in bends.

    Returns:
        The lever from the wall speeds, and the lever from the wall speeds less slip.
    """
    levers = []
    for slipping in (True, False):
        by_jacobian, turned = zip(*(_rotations(r, slipping) for r in results), strict=True)
        w, omega = np.concatenate(by_jacobian), np.concatenate(turned)
        # Least squares: the lever l for which w / l comes nearest to omega.
        levers.append(float((w * w).sum() / (w * omega).sum()))
    return levers[0], levers[1]


def _rotations(result: Result, slipping: bool) -> tuple[Array, Array]:
    """Rotation by the Jacobian at lever 1, and the rotation that happened, each (k, 2) rad/s."""
    trajectory = result.trajectory
    rotation, k = matrix_from_quaternion(trajectory["quaternion"]), _WINDOW
    relative = np.einsum("tji,tjk->tik", rotation[:-k], rotation[k:])
    span = (trajectory.time[k:] - trajectory.time[:-k])[:, None]
    # The antisymmetric part of a small rotation is its rotation vector.
    omega = (
        np.stack([relative[:, 2, 1] - relative[:, 1, 2], relative[:, 0, 2] - relative[:, 2, 0]], -1)
        / 2
        / span
    )
    speeds = trajectory["wall_speed"] - (0.0 if slipping else trajectory["slip_velocity"])
    # Differences of a running sum are means over the same windows as omega's.
    total = np.cumsum(speeds, axis=0)
    mean = (total[k:] - total[:-k]) / k
    by_jacobian = angular_velocity(mean, np.zeros(len(mean)), 1.0)[:, :2]
    # Where the robot hardly turns, the ratio of both rotations is noise.
    turning = np.linalg.norm(omega, axis=-1) > _TURNING
    return by_jacobian[turning], omega[turning]


@claim(
    source="Section III, Eq. 18",
    paper="module speeds and rotation belong together by l, the module centre "
    f"({1e3 * Omnitrack().module_distance:.1f} mm)",
    statement="the interval of the lever that fits module speeds less slip to the rotation in "
    "elbows lies about l, within half of the distance from l to the D/2 of Eq. 20",
    how="elbows of 240 and 90 mm, all orientations, default controller",
    expected=ClaimVerdict.CONTRADICTION,
    why="Eq. 18 takes l, Eq. 20 takes D/2, and what comes out is nearer to D/2: tracks touch "
    "at the wall, and the arms give way a little.",
    sample=Sample.AVERAGE,
)
def eq18_jacobian(runs: Runs) -> Measurement:
    """Eq. 18: which lever fits the rotation that happens."""
    results = [r for name in ("elbow_240_jacobian", "elbow_90_jacobian") for r in runs[name]]
    robot = results[0].scenario.robot
    centre, wall = robot.module_distance, robot.nominal_pipe_radius
    levers = np.array([lever_of([result]) for result in results])
    # Rotation for a speed is averaged: a robot that hangs for a while has a lever without bound.
    mean = 1 / np.mean(1 / levers, axis=0)
    high, low = (1 / end for end in mean_interval((1 / levers[:, 1]).tolist()))
    # At most half way between both levers, so that the verdict cannot be for both.
    near = abs(wall - centre) / 2
    return Measurement(
        f"{1e3 * mean[1]:.1f} mm less slip (95 % interval {1e3 * low:.1f} to {1e3 * high:.1f}), "
        f"{1e3 * mean[0]:.1f} mm with slip; l {1e3 * centre:.1f}, D/2 {1e3 * wall:.1f} mm",
        max(abs(low - centre), abs(high - centre)) < near,
        max(abs(low - wall), abs(high - wall)) < near,
        uncertainty=f"Student's t, {len(results)} elbows, each by least squares",
    )


@claim(
    source="Section III, Eq. 19",
    paper="the radius of curvature is the mean of |V| over three times the rotation: that of the "
    "bend",
    statement="in the middle half of elbows it is the bend's mean radius within {percent:g} %, "
    "with the rotation by Eq. 18 from module speeds less slip",
    limits={"percent": 20},
    how="elbows of 240 and 90 mm, all orientations, default controller",
    expected=ClaimVerdict.CONTRADICTION,
    why="The rotation is that of Eq. 18, whose lever l is too short: with the D/2 of Eq. 20 the "
    "radius is that of the bend.",
    note="It takes the sizes of the speeds, so it does not hold where a module runs backward.",
    sample=Sample.AVERAGE,
)
def eq19_radius(runs: Runs, percent: float) -> Measurement:
    """Eq. 19: the radius of curvature from module speeds."""
    texts, ends = [], {"centre": [], "wall": []}
    results = {name: runs[f"elbow_{name}_jacobian"] for name in ("240", "90")}
    for name, group in results.items():
        robot = as_omnitrack(group[0].scenario.robot)
        levers = {"centre": robot.module_distance, "wall": robot.nominal_pipe_radius}
        shares = [share for share in map(_curvature, group) if np.isfinite(share)]
        mean, (low, high) = np.mean(shares), mean_interval(shares)
        for key, lever in levers.items():
            ends[key] += [100 * lever * low, 100 * lever * high]
        bend = float(name)
        by_l, by_wall = (bend * lever * mean for lever in levers.values())
        texts.append(f"{by_l:.0f} mm with l and {by_wall:.0f} mm with D/2 for {bend:g}")
        low, high = (bend * levers["centre"] * end for end in (low, high))
        texts[-1] += f" (95 % interval with l {low:.0f} to {high:.0f})"

    def within(key: str) -> bool:
        return all(abs(end - 100) < percent for end in ends[key])

    return Measurement(
        "; ".join(texts),
        within("centre"),
        within("wall"),
        uncertainty=f"Student's t, {sum(map(len, results.values()))} elbows",
    )


def _curvature(result: Result) -> float:
    """Radius of curvature by Eqs. 18 and 19 at a lever of 1 m, over the bend's mean radius.

    The mean over the middle half of the bend; not a number where the robot did not get there.
    """
    trajectory, bend = result.trajectory, result.scenario.route.passages[1]
    part = (trajectory["distance"] - bend.s_enter) / (bend.s_leave - bend.s_enter)
    middle = (part > 0.25) & (part < 0.75)
    if not middle.any():
        return float("nan")
    speeds = (trajectory["wall_speed"] - trajectory["slip_velocity"])[middle].mean(axis=0)
    rotation = angular_velocity(speeds[None], np.zeros(1), 1.0)[0]
    return float(np.abs(speeds).mean() / np.linalg.norm(rotation) / bend.bend_radius)


def _as_printed(value: float, printed: float, unit: str, other: float = np.nan) -> Measurement:
    """Return whether a value computed with the calibrated reach equals the printed one."""
    real = np.degrees(TurnCase().real_sector)
    # The reach is what 96.54 degrees need: that they and what follows come out proves nothing.
    return Measurement(
        f"{value:.2f} {unit}; real geometry, L = 90 mm: sector {real:.1f} degrees",
        abs(value - printed) <= _AS_PRINTED,
        abs(value - other) <= _AS_PRINTED,
        uncertainty="exact for the reach, which is calibrated on 96.54 degrees",
        calibrated=True,
    )


_REGION: dict[str, Any] = {"how": "omnitrack singularity", "figures": ("fig9_sector",)}


@claim(
    source="Section IV",
    paper=f"{_SECTOR} degrees",
    statement=f"{_SECTOR} degrees within {_AS_PRINTED}",
    expected=ClaimVerdict.CALIBRATED,
    **_REGION,
)
def singularity_sector(_runs: Runs) -> Measurement:
    """Compare the singular sector, of which the reach was inferred."""
    return _as_printed(np.degrees(TurnCase().sector), _SECTOR, "degrees")


@claim(
    source="Section IV, Fig. 9",
    paper=f"{_MARGIN} degrees on either side",
    statement=f"{_MARGIN} degrees within {_AS_PRINTED}",
    expected=ClaimVerdict.CONTRADICTION,
    why=f"A sector of {_SECTOR} of 120 degrees leaves {(120 - _SECTOR) / 2:.2f} on either side.",
    **_REGION,
)
def singularity_margin(_runs: Runs) -> Measurement:
    """Compare the safe margin, and what the printed sector leaves."""
    margin = np.degrees(TurnCase().margin)
    return _as_printed(margin, _MARGIN, "degrees", other=(120 - _SECTOR) / 2)


@claim(
    source="Section VI",
    paper="80.45 % (96.54 / 120)",
    statement=f"{_FAILURE} % within {_AS_PRINTED}",
    expected=ClaimVerdict.CALIBRATED,
    **_REGION,
)
def singularity_failure_rate(_runs: Runs) -> Measurement:
    """Compare the part of the orientations that is singular."""
    return _as_printed(100 * np.degrees(TurnCase().sector) / 120, _FAILURE, "%")


@claim(
    source="Section VI",
    paper="19.55 %",
    statement=f"{_SUCCESS} % within {_AS_PRINTED}",
    expected=ClaimVerdict.CALIBRATED,
    **_REGION,
)
def singularity_success_rate(_runs: Runs) -> Measurement:
    """Compare the part of the orientations that is not."""
    return _as_printed(100 - 100 * np.degrees(TurnCase().sector) / 120, _SUCCESS, "%")


@claim(
    source="Section V",
    paper="100 mm/s in each module in straight sections; climbs vertically",
    statement="100 mm/s within {percent:g} % straight up, traction equal to the weight within "
    "{percent:g} %",
    limits={"percent": 1},
    how="vertical_climb",
)
def vertical_climb(runs: Runs, percent: float) -> Measurement:
    """100 mm/s up a vertical pipe."""
    (result,) = runs["vertical_climb"]
    trajectory = result.trajectory
    # The first second is the start-up, in which the belts come up to speed.
    steady = trajectory.time > 1.0
    # The slope of all samples: single lugs shake the robot too much for two of them.
    speed = float(np.polyfit(trajectory.time[steady], trajectory["distance"][steady], 1)[0])
    load = float(trajectory["traction"][steady].sum(axis=-1).mean())
    return Measurement(
        f"{1e3 * speed:.2f} mm/s, traction {load:.2f} N for "
        f"{GRAVITY * result.scenario.robot.mass:.2f} N",
        abs(speed / 0.1 - 1) < percent / 100
        and abs(load / (GRAVITY * result.scenario.robot.mass) - 1) < percent / 100,
        uncertainty="fit after 1 s",
    )


@claim(
    source="Sections V and VI, Fig. 18(a)",
    paper="the robot crawls in the opposite direction when modules have rolled by more than 180 "
    "degrees",
    statement="at 180 degrees of roll a belt of -100 mm/s drives at +100 mm/s, within "
    "{percent:g} %",
    limits={"percent": 1},
    how="paper/rolled_past_180",
    note="The sign changes at the no-motion line, 90 degrees, not at 180.",
)
def opposite_motion_past_180(runs: Runs, percent: float) -> Measurement:
    """Modules rolled by 180 degrees run the other way."""
    (result,) = runs["rolled_past_180"]
    steady = result.trajectory.time > 1.0
    belt = float(result.trajectory["belt_speed"][steady].mean())
    speed = float(np.gradient(result.trajectory["distance"], result.trajectory.time)[steady].mean())
    return Measurement(
        f"belt {1e3 * belt:.1f} mm/s, robot {1e3 * speed:.1f} mm/s",
        max(abs(belt / -0.1 - 1), abs(speed / 0.1 - 1)) < percent / 100,
        uncertainty="mean after 1 s",
    )


@claim(
    source="Section VI, Fig. 18(b)",
    paper="on the no-motion line the robot just wobbles in the spot without moving forward",
    statement="under {travel:g} mm of travel in 3 s; both tracks of every module touch for over "
    "{touching:g} % of the time",
    limits={"travel": 5, "touching": 90},
    how="paper/no_motion_line",
    note="The wobble is small: the model's tracks are alike and rigid.",
)
def no_motion_line(runs: Runs, travel: float, touching: float) -> Measurement:
    """On the no-motion line both tracks touch and oppose each other."""
    (result,) = runs["no_motion_line"]
    trajectory = result.trajectory
    moved = float(np.ptp(trajectory["distance"]))
    # Both tracks of all three modules at once.
    both = float((trajectory["contact_count"] > 0).all(axis=(1, 2)).mean())
    wobble = float(np.degrees(trajectory["tilt"].max()))
    return Measurement(
        f"{1e3 * moved:.2f} mm, both tracks touch {100 * both:.0f} % of the time, "
        f"tilt up to {wobble:.2f} degrees",
        1e3 * moved < travel and 100 * both > touching and result.outcome is Outcome.NO_MOTION_LINE,
    )


@claim(
    source="Section V, Figs. 11 and 12(a)",
    paper="holonomic motion orients a module in the turning direction",
    statement="from every start orientation theta5 ends within {margin:g} degrees of the best",
    # Safe on either side by Section IV: half of what a sector of 96.54 leaves of 120 degrees.
    limits={"margin": 11.73},
    how="paper/holonomic_alignment from -60 to 60 degrees",
    sample=Sample.EVERY,
)
def holonomic_alignment(runs: Runs, margin: float) -> Measurement:
    """Alignment from any orientation."""
    results = runs["holonomic"]
    # Modulo a third of a turn: the modules are alike.
    errors = np.array([abs(wrap_angle(r.trajectory["theta5"][-1], 2 * np.pi / 3)) for r in results])
    within = int((np.degrees(errors) <= margin).sum())
    return Measurement(
        f"{within} of {len(results)}; largest error {np.degrees(errors.max()):.1f} degrees",
        within == len(results),
        uncertainty=f"{len(results)} start orientations over 120 degrees",
    )


@claim(
    source="Section V, Fig. 13",
    paper="the input velocity changes sign after the holonomic motion",
    statement="mean belt speed changes sign from before to after a roll past the no-motion line",
    how="paper/tee_turn_misaligned",
    figures=("fig13_feedback",),
)
def sign_change_after_alignment(runs: Runs) -> Measurement:
    """The input velocity changes sign after the holonomic motion."""
    (result,) = runs["tee_turn_misaligned"]
    trajectory = result.trajectory
    spans = trajectory.phase_spans()
    rolls = [(start, end) for name, start, end in spans if name == "align"]
    # Alignment may take several rolls: before the first one, and after the last one.
    start, end = rolls[0][0], rolls[-1][1]
    before = float(
        trajectory["belt_speed"][(trajectory.time > 0.5) & (trajectory.time < start)].mean()
    )
    # Not at once: the belts need a moment to change their direction.
    after_end = (trajectory.time > end + 0.15) & (trajectory.time < end + 0.4)
    after = float(trajectory["belt_speed"][after_end].mean())
    roll = float(np.degrees(trajectory["roll"][after_end].mean()))
    return Measurement(
        f"{1e3 * before:.1f} to {1e3 * after:.1f} mm/s after a roll of {roll:.0f} degrees",
        before * after < 0 and np.cos(np.radians(roll)) < 0,
    )


@claim(
    source="Section VI (traction of the latex lugs is large enough to climb)",
    paper="sufficiently large traction to climb vertically",
    statement="climbs if and only if the preload is over m g / (3 mu), within {percent:g} %, at "
    "three frictions",
    limits={"percent": 10},
    how="vertical_climb with preload and friction set",
)
def climbing_preload(runs: Runs, percent: float) -> Measurement:
    """The smallest preload that climbs."""
    climbed = np.array([_climbs(r) for r in runs["preload"]]).reshape(
        len(FRICTIONS), len(PRELOAD_FACTORS)
    )
    # By the law exactly the preloads above the least one climb; those nearer to it do not count.
    factors = np.array(PRELOAD_FACTORS)
    clear = np.abs(factors - 1) > percent / 100 - 1e-9
    robot = as_omnitrack(runs["preload"][0].scenario.robot)
    least = ", ".join(f"{min_preload(robot, mu):.1f} N at {mu}" for mu in FRICTIONS)
    found = [f"{factors[int(np.argmax(row))]:.2f}" if row.any() else "none" for row in climbed]
    return Measurement(
        f"least factor that climbs: {', '.join(found)}; law: {least}",
        bool((climbed == (factors > 1))[:, clear].all()),
        uncertainty=f"preloads of {', '.join(str(f) for f in PRELOAD_FACTORS)} times the law's",
    )


def _climbs(result: Result) -> bool:
    """True if the robot gains at least 50 mm in the last second, half of its cruise speed."""
    late = result.trajectory.time > result.trajectory.time[-1] - 1.0
    # Sliding down is travel, too: the sign tells it from a climb.
    gained = np.ptp(result.trajectory["distance"][late]) * np.sign(
        result.trajectory["distance"][-1] - result.trajectory["distance"][late][0]
    )
    return bool(gained > 0.05)


@claim(
    source="Section VI",
    paper="the inner module sometimes slips or stalls due to excessive torque as the robot "
    "takes the turn",
    statement="with the published motor no module stalls in a straight or needs more torque than "
    "its maker recommends; in turns the inner one needs more on average, and stalls in some",
    how="elbow_short and tee_turn; straights upright and level",
    note="A module stalls while its motor stands still at its torque limit.",
    sample=Sample.AVERAGE,
)
def motor_stall(runs: Runs) -> Measurement:
    """Load and stall with the published motor."""
    groups = {
        "90 mm elbows by feedback": runs["elbow_90_jacobian"],
        "elbows as written": runs["elbow_90_paper"],
        "tee turns by feedback": runs["aligned_real"],
        "tee turns as written": runs["written_real"],
    }
    loads = {name: [_inner_load(result) for result in group] for name, group in groups.items()}
    texts = [
        f"{name} {np.mean([load for load, _ in own]):.2f}, stalls in "
        f"{sum(stalls for _, stalls in own)} of {len(own)}"
        for name, own in loads.items()
    ]
    straight = [_loads(result) for result in runs["straights"]]
    calm = all(load.max() < 1 and not stalls.any() for load, stalls in straight)
    inner = [load for own in loads.values() for load in own]
    over = mean_interval([load - 1 for load, _ in inner])[0] > 0
    return Measurement(
        "torque of the inner module (90 % quantile) over the recommended: straights "
        f"{max(load.max() for load, _ in straight):.2f} (largest); {'; '.join(texts)}",
        calm and over and any(stalls for _, stalls in inner),
        uncertainty=f"Student's t, {len(inner)} turns",
    )


def _loads(result: Result) -> tuple[Array, NDArray[np.bool_]]:
    """Torque of each module over what its maker recommends, and whether it stalls; each (3,)."""
    # A high quantile in place of the maximum: short peaks of single contacts are not its load.
    torque = np.quantile(np.abs(result.trajectory["motor_torque"]), 0.9, axis=0)
    recommended = as_omnitrack(result.scenario.robot).motor.recommended_torque or np.nan
    return torque / recommended, np.asarray(result.metrics["stall_time_s"], float) > 0


def _inner_load(result: Result) -> tuple[float, bool]:
    """Return load and stall of the inner module of a turn, as ``_loads`` has them."""
    load, stalls = _loads(result)
    # One that does not get to its turn has no inner module: it counts by module 1.
    inner = inner_module(result.trajectory) or 0
    return float(load[inner]), bool(stalls[inner])


@claim(
    source="Sections V and VI",
    paper="100 mm/s, with the smallest available motor, Pololu 1000:1 HPCB",
    statement="with the published motor the robot drives at 100 mm/s within {percent:g} %, level "
    "and straight up",
    limits={"percent": 1},
    how="vertical_climb with robot.motor = pololu_1000_hpcb, upright and level",
    expected=ClaimVerdict.FAILS,
    why="100 mm/s is the speed of this motor without load, and by its torque-speed line it gives "
    "way: a third of the weight at a lug takes about 8 % of its speed.",
)
def published_speed(runs: Runs, percent: float) -> Measurement:
    """100 mm/s with the published motor."""
    up, level = (1e3 * speed_of(result, 1.0) for result in runs["straights"])
    return Measurement(
        f"{up:.1f} mm/s up, {level:.1f} mm/s level",
        max(abs(up - 100), abs(level - 100)) < percent,
        uncertainty="fit after 1 s",
    )


@claim(
    source="Sections II.A and VI",
    paper="small modules allow for a higher range of pipe diameters; springs comply",
    statement="climbs in each bore that the arms reach in which springs press by over m g / (3 mu)",
    how="vertical_climb in bores, friction 0.9",
    note="The paper states no range.",
)
def bore_compliance(runs: Runs) -> Measurement:
    """The range of bores in which it climbs."""
    results = runs["bores"]
    first = results[0].scenario
    robot = as_omnitrack(first.robot)
    least = min_preload(robot, first.world.friction)
    bores = [2 * result.scenario.route.passages[0].radius for result in results]
    needed = [robot.spring_force(bore / 2) > least for bore in bores]
    climbed = [_climbs(result) for result in results]
    widest = 2 * (robot.nominal_pipe_radius + (robot.preload - least) / robot.module_stiffness)
    ways = ", ".join(
        f"{1e3 * bore:.0f} {'up' if up else 'no'}" for bore, up in zip(bores, climbed, strict=True)
    )
    low = 1e3 * robot.bores[0]
    return Measurement(
        f"{ways} (mm); law: {low:.0f} to {1e3 * widest:.0f} mm",
        climbed == needed and any(climbed) and not all(climbed),
        uncertainty="one run each",
    )


CLAIMS: tuple[Claim, ...] = (
    eq9_mean_speed,
    eq8_unequal_arms,
    eq18_jacobian,
    eq19_radius,
    singularity_sector,
    singularity_margin,
    singularity_failure_rate,
    singularity_success_rate,
    vertical_climb,
    holonomic_alignment,
    sign_change_after_alignment,
    opposite_motion_past_180,
    no_motion_line,
    climbing_preload,
    published_speed,
    bore_compliance,
    motor_stall,
)
"""In the order of the page."""
