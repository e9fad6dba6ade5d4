"""Claims about driving, rolling and motors: straight pipes, the no-motion line, preload, stall."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.paper.claim import Claim, Sample, verdict_of
from omnitrack_sim.paper.experiments import FRICTIONS, PRELOAD_FACTORS, Runs, least_preload
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import GRAVITY, as_omnitrack


def climb(runs: Runs) -> Claim:
    """100 mm/s up a vertical pipe."""
    (result,) = runs["vertical_climb"]
    trajectory = result.trajectory
    # The first second is the start-up, in which the belts come up to speed.
    steady = trajectory.time > 1.0
    # The slope of all samples: single lugs shake the robot too much for two of them.
    speed = float(np.polyfit(trajectory.time[steady], trajectory["distance"][steady], 1)[0])
    load = float(trajectory["traction"][steady].sum(axis=-1).mean())
    return Claim(
        id="vertical_climb",
        source="Section V",
        paper="100 mm/s in each module in straight sections; climbs vertically",
        statement="100 mm/s within 1 % straight up, traction equal to the weight within 1 %",
        measured=(
            f"{1e3 * speed:.2f} mm/s, traction {load:.2f} N for "
            f"{GRAVITY * result.scenario.robot.mass:.2f} N"
        ),
        uncertainty="fit after 1 s",
        verdict=verdict_of(
            abs(speed - 0.1) < 0.001
            and abs(load / (GRAVITY * result.scenario.robot.mass) - 1) < 0.01
        ),
        how="vertical_climb",
    )


def past_180(runs: Runs) -> Claim:
    """Modules rolled by 180 degrees run the other way."""
    (result,) = runs["rolled_past_180"]
    steady = result.trajectory.time > 1.0
    belt = float(result.trajectory["belt_speed"][steady].mean())
    speed = float(np.gradient(result.trajectory["distance"], result.trajectory.time)[steady].mean())
    return Claim(
        id="opposite_motion_past_180",
        source="Sections V and VI, Fig. 18(a)",
        paper=(
            "the robot crawls in the opposite direction when modules have rolled by more than 180 "
            "degrees"
        ),
        statement="at 180 degrees of roll a belt of -100 mm/s drives at +100 mm/s, within 1 %",
        measured=f"belt {1e3 * belt:.1f} mm/s, robot {1e3 * speed:.1f} mm/s",
        uncertainty="mean after 1 s",
        verdict=verdict_of(abs(belt + 0.1) < 0.001 and abs(speed - 0.1) < 0.001),
        how="paper/rolled_past_180",
        note="The sign changes at the no-motion line, 90 degrees, not at 180.",
    )


def no_motion_line(runs: Runs) -> Claim:
    """On the no-motion line both tracks touch and oppose each other."""
    (result,) = runs["no_motion_line"]
    trajectory = result.trajectory
    moved = float(np.ptp(trajectory["distance"]))
    # Both tracks of all three modules at once.
    both = float((trajectory["contact_count"] > 0).all(axis=(1, 2)).mean())
    wobble = float(np.degrees(trajectory["tilt"].max()))
    return Claim(
        id="no_motion_line",
        source="Section VI, Fig. 18(b)",
        paper="on the no-motion line the robot just wobbles in the spot without moving forward",
        statement=(
            "under 5 mm of travel in 3 s; both tracks of every module touch for over 90 % of the "
            "time"
        ),
        measured=f"{1e3 * moved:.2f} mm, both tracks touch {100 * both:.0f} % of the time, "
        f"tilt up to {wobble:.2f} degrees",
        verdict=verdict_of(
            moved < 0.005 and both > 0.9 and result.outcome is Outcome.NO_MOTION_LINE
        ),
        how="paper/no_motion_line",
        note="The wobble is small: the model's tracks are alike and rigid.",
    )


def holonomic(runs: Runs) -> Claim:
    """Alignment from any orientation."""
    results = runs["holonomic"]
    # Modulo a third of a turn: the modules are alike.
    errors = np.array([abs(wrap_angle(r.trajectory["theta5"][-1], 2 * np.pi / 3)) for r in results])
    # Safe on either side by Section IV, degrees: half of what a sector of 96.54 leaves of 120.
    margin = 11.73
    within = int((np.degrees(errors) <= margin).sum())
    return Claim(
        id="holonomic_alignment",
        source="Section V, Figs. 11 and 12(a)",
        paper="holonomic motion orients a module in the turning direction",
        statement=f"from every start orientation theta5 ends within {margin} degrees of the best",
        measured=f"{within} of {len(results)}; largest error {np.degrees(errors.max()):.1f} "
        "degrees",
        uncertainty=f"{len(results)} start orientations over 120 degrees",
        verdict=verdict_of(within == len(results)),
        how="paper/holonomic_alignment from -60 to 60 degrees",
        sample=Sample.EVERY,
    )


def sign_change(runs: Runs) -> Claim:
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
    return Claim(
        id="sign_change_after_alignment",
        source="Section V, Fig. 13",
        paper="the input velocity changes sign after the holonomic motion",
        statement="mean belt speed changes sign from before to after a roll past the no-motion "
        "line",
        measured=f"{1e3 * before:.1f} to {1e3 * after:.1f} mm/s after a roll of {roll:.0f} degrees",
        verdict=verdict_of(before * after < 0 and np.cos(np.radians(roll)) < 0),
        how="paper/tee_turn_misaligned",
        figures=("fig13_feedback",),
    )


def preload(runs: Runs) -> Claim:
    """The least preload that climbs."""
    climbed = np.array([_climbs(r) for r in runs["preload"]]).reshape(
        len(FRICTIONS), len(PRELOAD_FACTORS)
    )
    # By the law exactly the preloads above the least one climb.
    needed = np.array([f > 1 for f in PRELOAD_FACTORS])
    robot = as_omnitrack(runs["preload"][0].scenario.robot)
    least = ", ".join(f"{least_preload(robot, mu):.1f} N at {mu}" for mu in FRICTIONS)
    factors = [
        f"{PRELOAD_FACTORS[int(np.argmax(row))]:.2f}" if row.any() else "none" for row in climbed
    ]
    return Claim(
        id="least_preload",
        source="Section VI (traction of the latex lugs is large enough to climb)",
        paper="sufficiently large traction to climb vertically",
        statement=(
            "climbs if and only if the preload is over m g / (3 mu), within 5 %, at three frictions"
        ),
        measured=f"least factor that climbs: {', '.join(factors)}; law: {least}",
        uncertainty=f"preloads of {', '.join(str(f) for f in PRELOAD_FACTORS)} times the law's",
        verdict=verdict_of((climbed == needed).all()),
        how="vertical_climb with preload and friction set",
    )


def _climbs(result: Result) -> bool:
    """True if the robot gains at least 50 mm in the last second, half of its cruise speed."""
    late = result.trajectory.time > result.trajectory.time[-1] - 1.0
    # Sliding down is travel, too: the sign tells it from a climb.
    gained = np.ptp(result.trajectory["distance"][late]) * np.sign(
        result.trajectory["distance"][-1] - result.trajectory["distance"][late][0]
    )
    return bool(gained > 0.05)


def motors(runs: Runs) -> Claim:
    """Load and stall with the published motor."""
    loads, stalled = [], []
    for result in runs["pololu"]:
        limit = result.scenario.robot.motor.torque_limit
        # A high quantile in place of the maximum: short peaks of single contacts are not its load.
        steady = np.quantile(np.abs(result.trajectory["motor_torque"]), 0.9, axis=0).max()
        stall = max(result.metrics["stall_time_s"])  # type: ignore[arg-type]
        loads.append(
            f"{result.scenario.name} {steady / limit:.2f} ({stall:.1f} s stalled, "
            f"{result.outcome.value})"
        )
        stalled.append(stall)
    return Claim(
        id="motor_stall",
        source="Section VI",
        paper=(
            "the inner module sometimes slips or stalls due to excessive torque as the robot "
            "takes the turn"
        ),
        statement=(
            "with the published motor no module stalls in the climb, and one does in at least one "
            "elbow or tee"
        ),
        measured="torque (90 % quantile of the largest module) over the limit: " + "; ".join(loads),
        uncertainty="one run each",
        # The first run is the climb.
        verdict=verdict_of(stalled[0] == 0 and max(stalled[1:]) > 0),
        how=(
            "vertical_climb, elbow, elbow_short, tee_turn, tee_straight with robot.motor = "
            "pololu_1000_hpcb"
        ),
        note="The limit is the maker's recommended 0.245 N m, a fifth of the stall torque.",
    )
