"""What the benchmark of mobility teaches about designs, with the figures of its trials."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from omnitrack_sim.record.statistics import mean_interval, wilson_interval
from omnitrack_sim.trials.batches import INVALID

TEXT = """
* **A branch is entered by steering.** The omnidirectional robot, which rolls its modules aside and
drives them at different speeds, enters the branches of tee and wye in {branch_steered} trials,
with onboard sensors or the true pose; PIRATE, which turns into their plane and folds round the
corner, in {branch_pirate}; all others in {branch_others}.
* **A differential does not steer.** With it and one motor the same robot enters
{branch_differential}. Elbows it passes in {elbows_differential}, for {energy_differential} J/m
where three motors take {energy_motors}.
* **Where a wall is missing, orientation counts.** Over a tee, tracks that roll aside pass
{over_aside}, arms and tracks that stay as they start {over_fixed}, clamps and chains {over_chains};
the screw, whose rotor loses its grip, {over_screw}.
* **Long stiff parts stop in tight elbows.** At 0.6 bores tracks pass {tight_tracks}, inchworm and
snake, of 2 and 3.3 bores, {tight_long}; the helix of sixteen hinges {tight_helix}.
* **A little compliance is enough for bores.** 3 % less or more, or 10 % behind a reducer: all
together pass {bores}.
* **Clamping pulls most and costs most**: all that the inchworm's spindle gives, for many times
what wheels take.
* **Joints in place of springs press hard, and harder where walls grip.** The largest wall force is
in the median {grip_helix} N with the helix, {grip_snake} with the snake, {grip_tracks} with tracks
at the lowest and the highest friction: joints whose modules do not slide work against each other.
* **A planar chain needs straights.** PIRATE turns into the plane of a bend
[by its roll joint](../robots/pirate.md): from any start roll it passes {elbow_pirate} elbows, but
two of them without a straight between, in two planes, in {twice_pirate}.

For a main with branches the table leaves the omnidirectional robot, with {network_steered} random
networks against {network_others}; for pulls without branches, wheels or clamps.
"""
STEERED, ROLLING = ("omnitrack", "onboard"), ("omnitrack", "onboard", "differential")
BRANCHES, NETWORK = ("tee_into", "wye_into"), ("network",)
ELBOWS = ("elbow_30", "elbow_15", "elbow_10", "elbow_06")
BENDS, TIGHT, OVER = (*ELBOWS, "two_elbows"), ("elbow_06",), ("tee_over",)
BORES = ("reducer", "bore_small", "bore_large")


def plus_minus(mean: float, half: float, sign: str = "") -> str:
    """Return a mean with half the width of its interval, to two digits of that."""
    digits = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 3
    return f"{mean:{sign}.{digits}f} ± {half:.{digits}f}"


def lessons(trials: Sequence[dict[str, Any]]) -> str:
    """The text with the figures of all trials, a dictionary each."""
    trials = [trial for trial in trials if trial["outcome"] != INVALID]  # robots that do not fit
    entries = dict.fromkeys(trial["entry"] for trial in trials)
    others = [entry for entry in entries if entry not in STEERED]
    rigid = [entry for entry in others if entry != "pirate"]

    def rate(courses: Sequence[str], *of: str) -> str:
        own = [t["success"] for t in trials if t["course"] in courses and t["entry"] in of]
        low, high = wilson_interval(sum(own), len(own))
        return f"{sum(own)} of {len(own)} ({100 * low:.0f} to {100 * high:.0f} %)"

    def mean(values: Sequence[float]) -> str:
        low, high = mean_interval(values)
        return plus_minus((low + high) / 2, (high - low) / 2)

    def passed(entry: str, courses: Sequence[str] = ()) -> list[dict[str, Any]]:
        own = [t for t in trials if t["entry"] == entry and t["success"]]
        return [t for t in own if not courses or t["course"] in courses]

    def energy(entry: str, courses: Sequence[str] = ()) -> str:
        return mean([t["energy_j"] / t["distance_m"] for t in passed(entry, courses)])

    def grip(entry: str) -> str:
        own = [t for t in passed(entry) if t["world.friction"] is not None]
        ends = [find(t["world.friction"] for t in own) for find in (min, max)]
        forces = [[t["contact_force_max_n"] for t in own if t["world.friction"] == e] for e in ends]
        return " and ".join(f"{np.median(force):.0f}" for force in forces)

    text = TEXT.format(
        branch_steered=rate(BRANCHES, *STEERED),
        branch_pirate=rate(BRANCHES, "pirate"),
        branch_others=rate(BRANCHES, *rigid),
        branch_differential=rate(BRANCHES, "differential"),
        elbows_differential=rate(BENDS, "differential"),
        energy_differential=energy("differential", ELBOWS),
        energy_motors=energy("omnitrack", ELBOWS),
        over_aside=rate(OVER, *ROLLING),
        over_fixed=rate(OVER, "climber", "presser"),
        over_chains=rate(OVER, "inchworm", "snake", "pirate", "helix"),
        over_screw=rate(OVER, "screw"),
        tight_tracks=rate(TIGHT, *ROLLING, "climber"),
        tight_long=rate(TIGHT, "inchworm", "snake"),
        tight_helix=rate(TIGHT, "helix"),
        bores=rate(BORES, *entries),
        grip_helix=grip("helix"),
        grip_snake=grip("snake"),
        grip_tracks=grip("omnitrack"),
        elbow_pirate=rate(ELBOWS, "pirate"),
        twice_pirate=rate(("two_elbows",), "pirate"),
        network_steered=rate(NETWORK, *STEERED),
        network_others=rate(NETWORK, *others),
    )
    items = text.strip().replace("\n* ", "\n\n* ").split("\n\n")
    lines = [
        textwrap.fill(item, 100, subsequent_indent="  " if item.startswith("*") else "")
        for item in items
    ]
    return "\n".join(lines[:-1]) + "\n\n" + lines[-1]
