"""How friction decides a vertical climb: speed and slip of the same robot on five walls.

Run: python scenarios/scripts/compare_friction.py
"""

import omnitrack_sim as ot

FRICTION = (0.08, 0.12, 0.2, 0.5, 0.9)


def main() -> None:
    base = ot.load_scenario("vertical_climb")
    results = ot.run_batch([ot.override(base, {"world.friction": mu}) for mu in FRICTION])
    needed = base.robot.mass * 9.81 / (3 * base.robot.preload)
    print(
        f"weight over the sum of the preloads: {needed:.3f}; below it three modules cannot hold "
        "the robot"
    )
    print("friction  outcome        mean speed, mm/s  mean slip ratio")
    for mu, result in zip(FRICTION, results, strict=True):
        slip = sum(result.metrics["slip_ratio_mean"]) / 3
        print(
            f"{mu:8.2f}  {result.outcome.value:13s}  "
            f"{1000 * result.metrics['mean_speed_m_s']:16.1f}  {slip:15.3f}"
        )


if __name__ == "__main__":
    main()
