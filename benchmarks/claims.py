"""Measures a robot's claims, as `omnitrack reproduce` does, and prints them as a table.

python benchmarks/claims.py [ROBOT] --out DIR [--quick]
"""

from __future__ import annotations

import json
from pathlib import Path
from textwrap import fill

from shape import Arguments, table

from omnitrack_sim.paper.claim import Finding, tally
from omnitrack_sim.paper.reproduce import CLAIMS_FILE, reproduce
from omnitrack_sim.robots.kinds import DEFAULT


def cell(text: str) -> str:
    """Return a text for a cell of a table of Markdown."""
    return text.replace("|", "\\|")


def row(finding: Finding) -> list[str]:
    """Return a row: verdict, source, what the paper says, what is measured, and driven by what."""
    claim, measured = finding.claim, finding.measurement.measured
    texts = (finding.label, claim.source, claim.paper, measured, finding.driven or "-")
    return [cell(text) for text in texts]


def main() -> None:
    """Measure the claims and print the tables."""
    parser = Arguments(__doc__)
    parser.add_argument("robot", nargs="?", default=DEFAULT, help="kind of the robot")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--quick", action="store_true", help="fewer orientations and trials")
    given = parser.read()
    findings = reproduce(given.out, robot=given.robot, quick=given.quick)
    made = json.loads((given.out / CLAIMS_FILE).read_text(encoding="utf-8"))["provenance"]
    counts = "; ".join(f"{verdict}: {count}" for verdict, count in tally(findings).items())
    extent = f"The {made['form']} form"
    standard = given.robot == DEFAULT
    if standard:
        extent += f", seed {made['seed']}: {made['runs']} runs, "
        extent += f"{made['simulated_s']:.0f} simulated seconds"
    print(f"## extent\n\n{fill(f'{extent}. {counts}.', 100)}\n")
    changed = "\n".join(f"* {finding.difference}" for finding in findings if finding.difference)
    if changed:
        print(f"## changed\n\n{changed}\n")
    # Robots with one controller and one motor of their own need no column that says so.
    heads = ("verdict", "source", "paper", "measured", "driven by")[: 5 if standard else 4]
    table("claims", heads, (row(finding)[: len(heads)] for finding in findings))


if __name__ == "__main__":
    main()
