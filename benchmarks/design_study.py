"""How the assumed parameters and the numerics decide random tee turns, elbows and straights.

python benchmarks/design_study.py [STUDY ...] [--trials N] [--quick]

Each line is a variant: how many of the same random turns passed, their mean time, how the others
ended. Studies: lugs, length, shafts, preload, friction, numerics, traversal.
"""

from __future__ import annotations

import argparse

from tee_turns import random_tee_turns, summary_line

from omnitrack_sim import load_scenario, override, run_batch

PIECES = {"physics.collider": "primitives"}
"""Walls and lugs as pieces: what the studies of lugs and numerics are about."""
VARIANTS = {
    "lugs": [
        (f"{k} lugs a track", PIECES | {"robot.lugs_per_track": k}) for k in (5, 9, 12, 17, 24, 34)
    ],
    "length": [
        (f"contact length {1000 * x:.0f} mm", {"robot.contact_length": x})
        for x in (0.07, 0.08, 0.09, 0.1, 0.11)
    ],
    "shafts": [
        (f"shaft spacing {1000 * x:.0f} mm", {"robot.shaft_spacing": x})
        for x in (0.09, 0.11, 0.126, 0.15, 0.18)
    ],
    "numerics": [
        ("as shipped", PIECES),
        ("half the time step", PIECES | {"physics.timestep": 0.001}),
        ("twice the staves", PIECES | {"physics.staves": 96}),
        (
            "twice the lugs",
            PIECES | {"robot.lugs_per_track": 2 * load_scenario("tee_turn").robot.lugs_per_track},
        ),
    ],
}
"""Studies that change the robot or the numerics on the same trials."""
DRAWS = {
    "preload": [
        (f"preload {a:.0f}-{b:.0f} N", {"preload": (a, b)})
        for a, b in ((10, 15), (15, 20), (20, 25), (25, 30), (30, 35))
    ],
    "friction": [
        (f"friction {a}-{b}", {"friction": (a, b)})
        for a, b in ((0.5, 0.6), (0.6, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, 1.0))
    ],
}
"""Studies that change what is drawn."""
COLUMNS = ("passed", "mean time", "others")


def traversal(variants: list[tuple[str, dict]]) -> None:
    """Traversal times of straight, elbow and tee for each variant, compared with the first."""
    names = ("straight", "elbow", "tee_turn")
    first: list[float] = []
    for label, changes in variants:
        results = run_batch([override(load_scenario(name), changes) for name in names])
        times = [r.duration_s for r in results]
        first = first or times
        cells = [
            f"{t:.2f} s ({100 * (t / f - 1):+.1f} %)" for t, f in zip(times, first, strict=True)
        ]
        print(f"| {label} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    studies = [*VARIANTS, *DRAWS, "traversal"]
    parser.add_argument(
        "studies", nargs="*", metavar="STUDY", help=f"of {', '.join(studies)}; all when not given"
    )
    parser.add_argument("--trials", type=int, default=96)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="8 trials a variant")
    options = parser.parse_args()
    unknown = sorted(set(options.studies) - set(studies))
    if unknown:
        parser.error(f"unknown study {', '.join(unknown)}; choose from {', '.join(studies)}")
    trials = 8 if options.quick else options.trials
    for study in options.studies or studies:
        columns = ("straight", "elbow", "tee turn") if study == "traversal" else COLUMNS
        print(f"\n## {study}\n\n| variant | {' | '.join(columns)} |\n|---|---|---|---|")
        if study == "traversal":
            traversal(VARIANTS["numerics"])
            continue
        for label, changes in VARIANTS.get(study, []):
            results = run_batch(random_tee_turns(trials, seed=options.seed, changes=changes))
            print(f"| {label} | {summary_line(results)} |", flush=True)
        for label, draw in DRAWS.get(study, []):
            results = run_batch(random_tee_turns(trials, seed=options.seed, **draw))
            print(f"| {label} | {summary_line(results)} |", flush=True)


if __name__ == "__main__":
    main()
