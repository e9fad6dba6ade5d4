"""Which start orientations pass the tee when the robot does not align first? Seven trials in one
batch.

Run: python scenarios/scripts/tee_orientations.py
"""

import omnitrack_sim as ot

ORIENTATIONS_DEG = (-60, -40, -20, 0, 20, 40, 60)


def main() -> None:
    base = ot.load_scenario("tee_turn")
    trials = [
        ot.override(base, {"start.theta5_deg": float(a), "control.align": False})
        for a in ORIENTATIONS_DEG
    ]
    for angle, result in zip(ORIENTATIONS_DEG, ot.run_batch(trials), strict=True):
        print(f"theta5 {angle:4d} deg: {result.outcome.value:20s} {result.reason}")


if __name__ == "__main__":
    main()
