"""Map of where the omnidirectional robot gets to in ky10, a town that wntr brings along.

    python benchmarks/reach_town.py --out DIR

Imports the town, maps the reach from six openings with a battery of 60 W h, as the commands of the
README do, and writes the picture. Prints what is reached and what stops the robot.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from textwrap import fill

from shape import Arguments

import omnitrack_sim as ot

OPENINGS = ("J-100", "J-553", "J-504", "J-454", "J-289", "J-639")
"""Of some 20 nodes with pipes of 6 inches those from which most is inspected."""
BATTERY = 60.0
"""W h."""


def main() -> None:
    """Write the picture and print what stands beside it."""
    parser = Arguments(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.read()
    network = ot.import_network("ky10").network
    passport = ot.load_passport("omnitrack")
    reach = ot.map_reach(network, passport, OPENINGS, supply=ot.Supply(BATTERY))
    arguments.out.mkdir(parents=True, exist_ok=True)
    ot.plot_reach(reach, arguments.out / "reach_ky10.png")
    stops: Counter[str] = Counter()
    for part in reach.parts:
        # "bore 102 mm: ...", "battery: ...", "wye, over the run (J-61): 0.97"
        why = part.stopped_by.partition(":")[0].partition(" (")[0]
        why = "other bores" if why.startswith("bore") else why
        stops[why] += part.length * (1 - part.probability)
    most = ", ".join(f"{why} ({length / 1000:.3g} km)" for why, length in stops.most_common(4))
    back = sum(part.length * part.back for part in reach.parts)
    text = (
        f"From {len(OPENINGS)} openings the robot is expected to get to "
        f"{reach.expected_length / 1000:.3g} of {reach.length / 1000:.3g} km, and to come back "
        f"from {back / 1000:.3g} km. "
        f"What keeps it from the rest: {most}."
    )
    print("## reach\n\n" + fill(text, 100))


if __name__ == "__main__":
    main()
