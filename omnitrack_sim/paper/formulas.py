"""Claims of Sections III and IV: kinematics and the motion singularity region."""

from __future__ import annotations

from functools import partial

import numpy as np

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.paper.claim import Claim, ClaimVerdict, Sample, verdict_of
from omnitrack_sim.paper.experiments import Runs
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.kinematics import (
    angular_velocity,
    cross_velocity,
    mean_velocity,
)
from omnitrack_sim.robots.omnitrack.singularity import TurnCase

_WINDOW = 10
"""Samples over which rotation and speeds are averaged, because single lugs shake the robot."""
_TURNING = 0.15
"""Rotation rate above which a sample counts as turning, rad/s."""
_SECTOR, _MARGIN = 96.54, 11.78
"""Singular sector, and what is safe on either side, as the paper prints them, degrees."""
_AS_PRINTED = 0.02
"""Tolerance of figures that the paper prints with two decimals, in their own unit."""


def mean_speed(runs: Runs) -> Claim:
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
    return Claim(
        id="eq9_mean_speed",
        source="Section III, Eq. 9",
        paper="V_cz is the mean of the module speeds; no Coriolis effect with equal arms",
        statement="climbing speed within 1 % of the mean wall speed; cross velocity of equal "
        "arms below 1e-12 m/s",
        measured=f"{1e3 * climbed:.2f} against {1e3 * mean:.2f} mm/s; cross velocity "
        f"{across:.0e} m/s",
        uncertainty="fit over the climb after 1 s",
        verdict=verdict_of(abs(climbed / mean - 1) < 0.01 and across < 1e-12),
        how="vertical_climb; kinematics.mean_velocity",
    )


def unequal_arms(runs: Runs) -> Claim:
    """Eq. 8: rolling in a horizontal pipe, where the arms differ, stresses the robot."""
    spreads, arms = {}, {}
    for name in ("rolling_upright", "rolling_flat"):
        trajectory = runs[name][0].trajectory
        # All modules are asked for the same roll, and it changes: they roll together.
        rolling = np.ptp(trajectory["roll_command"], axis=-1) < 1e-9
        rolling &= np.gradient(trajectory["roll_command"][:, 0]) != 0
        spreads[name] = float(np.ptp(trajectory["normal_force"][rolling], axis=-1).mean())
        arms[name] = trajectory["slide"][rolling]
    robot = runs["rolling_flat"][0].scenario.robot
    lengths = robot.module_distance + arms["rolling_flat"]
    # Modules that roll on the inside of the pipe turn the robot by r / R of their roll.
    rate = robot.roll_rate * robot.lug_radius / robot.nominal_pipe_radius
    scrub = float(
        np.linalg.norm(cross_velocity(np.full(len(lengths), rate), lengths), axis=-1).mean()
    )
    return Claim(
        id="eq8_unequal_arms",
        source="Section III, after Eq. 9",
        paper="holonomic motion during horizontal traversal gives non-planar velocities and "
        "additional stresses",
        statement="while rolling, normal forces of the modules differ by over 2 N more in a flat "
        "than in an upright pipe",
        measured=f"spread {spreads['rolling_flat']:.1f} N flat, {spreads['rolling_upright']:.1f} N "
        f"upright; Eq. 8 leaves {1e3 * scrub:.2f} mm/s across the axis",
        uncertainty="mean over one roll of 165 degrees, one run each",
        verdict=verdict_of(spreads["rolling_flat"] > spreads["rolling_upright"] + 2.0),
        how="paper/holonomic_alignment with gravity along and across the pipe",
    )


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


def jacobian(runs: Runs) -> Claim:
    """Eq. 18: which lever fits the rotation that happens."""
    results = [r for name in ("elbow_240_jacobian", "elbow_90_jacobian") for r in runs[name]]
    robot = results[0].scenario.robot
    centre, wall = robot.module_distance, robot.nominal_pipe_radius
    lever, less_slip = lever_of(results)
    # At most half way between both levers, so that the verdict cannot be for both.
    near = abs(wall - centre) / 2
    return Claim(
        id="eq18_jacobian",
        source="Section III, Eq. 18",
        paper="module speeds and rotation belong together by l, the module centre "
        f"({1e3 * centre:.1f} mm)",
        statement="the lever that fits module speeds less slip to the rotation in elbows is l, "
        "within half of the distance from l to the D/2 of Eq. 20",
        measured=f"{1e3 * less_slip:.1f} mm less slip, {1e3 * lever:.1f} mm with slip; l "
        f"{1e3 * centre:.1f}, D/2 {1e3 * wall:.1f} mm",
        uncertainty=f"least squares over {len(results)} elbows",
        verdict=verdict_of(abs(less_slip - centre) < near, abs(less_slip - wall) < near),
        expected=ClaimVerdict.CONTRADICTION,
        how="elbows of 240 and 90 mm, all orientations, default controller",
        why="Eq. 18 takes l, Eq. 20 takes D/2, and what comes out is nearer to D/2: tracks touch "
        "at the wall, and the arms give way a little.",
        sample=Sample.AVERAGE,
    )


def region(runs: Runs) -> list[Claim]:
    """The numbers of Sections IV and VI: of one reach, which was inferred from the first of
    them."""
    case = TurnCase()
    sector, margin, real = np.degrees([case.sector, case.margin, case.real_sector])
    beside = f"; real geometry, L = 90 mm: sector {real:.1f} degrees"
    failure, rest = 100 * sector / 120, (120 - _SECTOR) / 2
    printed = partial(_printed, beside)
    return [
        printed("sector", "Section IV", f"{_SECTOR} degrees", sector, _SECTOR, "degrees"),
        printed(
            "margin",
            "Section IV, Fig. 9",
            f"{_MARGIN} degrees on either side",
            margin,
            _MARGIN,
            "degrees",
            other=rest,
            expected=ClaimVerdict.CONTRADICTION,
            why=f"A sector of {_SECTOR} of 120 degrees leaves {rest:.2f} on either side.",
        ),
        printed("failure_rate", "Section VI", "80.45 % (96.54 / 120)", failure, 80.45, "%"),
        printed("success_rate", "Section VI", "19.55 %", 100 - failure, 19.55, "%"),
    ]


def _printed(
    beside: str,
    name: str,
    source: str,
    paper: str,
    value: float,
    printed: float,
    unit: str,
    other: float = np.nan,
    expected: ClaimVerdict = ClaimVerdict.CALIBRATED,
    why: str = "",
) -> Claim:
    """The claim that a value of the calibrated reach is what the paper prints."""
    verdict = verdict_of(abs(value - printed) <= _AS_PRINTED, abs(value - other) <= _AS_PRINTED)
    return Claim(
        id=f"singularity_{name}",
        source=source,
        paper=paper,
        statement=f"{printed} {unit} within {_AS_PRINTED}",
        measured=f"{value:.2f} {unit}{beside}",
        uncertainty="exact for the reach, which is calibrated on 96.54 degrees",
        # The reach is what 96.54 degrees need: that they and what follows come out proves nothing.
        verdict=ClaimVerdict.CALIBRATED if verdict is ClaimVerdict.HOLDS else verdict,
        expected=expected,
        how="omnitrack singularity",
        why=why,
        figures=("fig9_sector",),
    )
