"""Measures a robot's claims, as `omnitrack reproduce` does, and prints them as a table.

python benchmarks/claims.py [ROBOT] --out DIR [--quick]
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

from shape import Arguments, table

from omnitrack_sim.paper.claim import Finding, tally
from omnitrack_sim.paper.ledger import Comparison
from omnitrack_sim.paper.reproduce import CLAIMS_FILE, LEDGER, reproduce
from omnitrack_sim.robots.kinds import DEFAULT


def cell(text: str) -> str:
    """Return a text for a cell of a table of Markdown."""
    return text.replace("|", "\\|")


def row(finding: Finding) -> list[str]:
    """Return a row: verdict, source, what the paper says, what is measured, and driven by what."""
    claim, measured = finding.claim, finding.measurement.measured
    texts = (finding.label, claim.source, claim.paper, measured, finding.driven or "-")
    return [cell(text) for text in texts]


def ledger(findings: Sequence[Finding]) -> None:
    """Print published and simulated figures, what the intervals are over, and the sources."""
    pairs = [finding for finding in findings if isinstance(finding, Comparison)]
    numbered = list(enumerate(pairs, 1))
    heads = "", "robot", "our robot", "figure", "published", "tuned on it", "ours", "ratio"
    table("figures", heads, (ledger_row(number, pair) for number, pair in numbered))
    missed = (f"{number}. {pair.reason}" for number, pair in numbered if pair.reason)
    print("\n## misses\n", *(fill(line, 100, subsequent_indent="   ") for line in missed), sep="\n")
    heads = "", "source", "read", "its words", "simulated"
    table("sources", heads, (source_row(number, pair) for number, pair in numbered))


def ledger_row(number: int, pair: Comparison) -> list[str]:
    """Return the row of an entry: both robots, both figures and their ratio."""
    entry = pair.claim
    ours = entry.ours if " " in entry.ours else f"`{entry.ours}`"
    figures = f"{entry.value:.3g} {entry.unit}", pair.figure.text(entry.unit), pair.ratio.text()
    texts = entry.robot, ours, entry.statement, figures[0], entry.tuned or "nothing", *figures[1:]
    return [str(number), *map(cell, texts)]


def source_row(number: int, pair: Comparison) -> list[str]:
    """Return the row of an entry: where it stands, in which words, and how ours came about."""
    entry, source = pair.claim, pair.claim.publication
    note = f". {entry.note}" if entry.note else ""
    texts = f"[{source.title}]({source.address})", source.read, f"“{entry.quote}”", entry.how + note
    return [str(number), *map(cell, texts)]


def main() -> None:
    """Measure the claims and print the tables."""
    parser = Arguments(__doc__)
    parser.add_argument("robot", nargs="?", default=DEFAULT, help="kind of the robot, or measured")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--quick", action="store_true", help="fewer orientations and trials")
    given = parser.read()
    findings = reproduce(given.out, robot=given.robot, quick=given.quick)
    if given.robot == LEDGER:
        ledger(findings)
        return
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
