"""How far must the modules reach? Sector, safe margin and success rate over reach, by formula and
in the real geometry.

Run: python scenarios/scripts/reach_against_success.py
"""

import numpy as np

import omnitrack_sim as ot


def main() -> None:
    print("reach, mm  sector, deg  margin, deg  success rate  real sector, deg  real success rate")
    for reach in np.arange(0.086, 0.1121, 0.004):
        figures = ot.TurnCase(reach=float(reach)).summary()
        real = figures["real_geometry"]
        print(
            f"{1e3 * reach:9.1f}  {figures['sector_deg']:11.1f}  {figures['margin_deg']:11.2f}  "
            f"{figures['success_rate']:12.3f}  {real['sector_deg']:16.1f}  "
            f"{real['keeps_contact_rate']:17.3f}"
        )


if __name__ == "__main__":
    main()
