"""How often a robot gets through a wye or a cross: into a branch, out of it, straight over.

python benchmarks/wye.py [--cross] [--quick] [--workers N] [--trials N] [--figure FILE.svg]

A wye's branch leans by an angle towards one end of its run. So there are two turns into the branch:
the turn by that angle, and the sharp one, by 180 degrees less it, for a robot that comes from the
other end; and the same two out of it, the merge and the sharp merge. Every cell of the table is a
batch of random trials: any start orientation,
any direction of gravity, a preload of 20 to 35 N, friction of a dry wall (0.8 to 1.0) in one half
and of a wet one (0.6 to 0.8) in the other. The controller rolls the robot first, and backs off to
try again where it gets stuck. Straight over, trials go both ways in turn.

A cross has the same ways, and the one across its run from branch to branch.

Prints how many passed with Wilson's 95 % interval, and how the others ended; then the same by the
direction of gravity. Trial i has the same draw in every cell, so cells differ only by wye and way.
--figure draws the wye with its ways, and the sharp turns over
gravity, friction and angle.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from shape import Arguments, Row, Trials, endings, interval, random_gravity, table

from omnitrack_sim import Scenario, override
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes.assembly import Part
from omnitrack_sim.pipes.fittings.wye import Wye
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.plots.style import new_figure, save_figure, style

WAYS = {
    "turn": (("run_start", "branch"),),
    "merge": (("branch", "run_start"),),
    "over": (("run_start", "run_end"), ("run_end", "run_start")),
    "sharp turn": (("run_end", "branch"),),
    "sharp merge": (("branch", "run_end"),),
    "across": (("branch", "opposite"), ("opposite", "branch")),
}
"""Ports that a fitting is entered and left at; of two ways trials take both in turn."""
ANGLES_DEG = (45.0, 60.0, 75.0, 90.0)
BORE = 0.16
REDUCING = (0.15, 0.14)
"""Bores of smaller branches, m, tried at ``REDUCING_DEG``."""
REDUCING_DEG = 60.0
CROSS_DEG = (60.0, 90.0)
"""Angles of crosses; at 90 degrees two have smaller branches."""
WALLS = {"dry": (0.8, 1.0), "wet": (0.6, 0.8)}
"""Friction coefficients."""
PRELOAD = (20.0, 35.0)
"""N a module."""
DOWNWARD = {"up": (-1.0, -1 / 3), "across": (-1 / 3, 1 / 3), "down": (1 / 3, 1.0)}
"""Gravity's component along the way into the wye, in g: a third of all directions each."""
PIPE = 0.4
"""Length of the straight before and after the wye, m."""
SPREAD_DEG = 22.0
"""Height of a row of the figure for each unit of friction."""
LABEL_MM = 30.0
"""From a port to its name in the figure."""


class Cell(NamedTuple):
    """A way through a wye.

    Attributes:
        way: one of ``WAYS``. angle_deg: between branch and run. branch: its bore, m.
        fitting: kind, "wye" or "cross".
    """

    way: str
    angle_deg: float
    branch: float = BORE
    fitting: str = "wye"

    @property
    def turn_deg(self) -> float:
        """By how much the robot turns, deg."""
        if self.way in ("over", "across"):
            return 0.0
        return 180.0 - self.angle_deg if self.way.startswith("sharp") else self.angle_deg


def cells(fitting: str = "wye") -> list[Cell]:
    """Return all cells of a kind of fitting.

    At 90 degrees the sharp ways are the others mirrored, and are left out; across a cross of equal
    bores is over its run.
    """
    angles = [
        Cell(way, angle, BORE, fitting)
        for way, angle in product(WAYS, CROSS_DEG if fitting == "cross" else ANGLES_DEG)
        if not (way == "across" or (way.startswith("sharp") and angle == 90))
    ]
    if fitting == "cross":
        ways, angle = ("turn", "merge", "across"), 90.0
    else:
        ways, angle = ("turn", "merge"), REDUCING_DEG
    return angles + [Cell(way, angle, bore, fitting) for way, bore in product(ways, REDUCING)]


def wall_of(index: int) -> str:
    """The wall that trial ``index`` runs on."""
    return tuple(WALLS)[index % len(WALLS)]


def trial(cell: Cell, index: int, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Trial ``index`` of a cell; ``changes`` as ``override`` takes them."""
    rng = np.random.default_rng(index)
    gravity = random_gravity(rng)
    ways = WAYS[cell.way]
    enter, leave = ways[index // len(WALLS) % len(ways)]
    straights = [
        {"kind": "straight", "length": PIPE, "inner_diameter": bore}
        for bore in (BORE if port.startswith("run") else cell.branch for port in (enter, leave))
    ]
    wye = {
        "kind": cell.fitting,
        "angle_deg": cell.angle_deg,
        "branch_diameter": cell.branch,
        "enter": enter,
        "leave": leave,
    }
    scenario = validate(
        {
            "pipes": [straights[0], wye, straights[1]],
            "start": {"theta5_deg": float(rng.uniform(-180, 180)), "distance": 0.12},
            "world": {
                "friction": float(rng.uniform(*WALLS[wall_of(index)])),
                "gravity": gravity,
            },
            "robot": {"preload": float(rng.uniform(*PRELOAD))},
        }
    )
    return override(scenario, dict(changes)) if changes else scenario


DRAWN = {
    "friction": lambda scenario: scenario.world.friction,
    # The first pipe leads along z.
    "downward": lambda scenario: scenario.world.gravity[2] / GRAVITY,
}
"""What of a trial the tables need beside what came of it."""


def row(cell: Cell, trials: Sequence[Row]) -> list[str]:
    """Return a row of the table of ways."""
    passed = [one for one in trials if one["success"]]
    return [
        cell.way,
        f"{cell.angle_deg:.0f}" + ("" if cell.branch == BORE else f", {1000 * cell.branch:.0f} mm"),
        *(str(sum(low <= t["friction"] < high for t in passed)) for low, high in WALLS.values()),
        interval(one["success"] for one in trials),
        str(sum(one["attempts"] > 1 for one in passed)),
        f"{np.mean([one['duration_s'] for one in passed]):.1f}" if passed else "-",
        endings(one["outcome"] for one in trials if not one["success"]),
    ]


def gravity_row(way: str, trials: Sequence[Row]) -> list[str]:
    """Return a row of the table over the direction of gravity."""
    cells = [way]
    for low, high in DOWNWARD.values():
        passed = [one["success"] for one in trials if low <= one["downward"] < high]
        cells.append(f"{sum(passed)} of {len(passed)} ({interval(passed)})")
    return cells


@style()
def figure(found: Mapping[Cell, Sequence[Row]]) -> Figure:
    """The wye with its ways, and the sharp turns over gravity, in a row for each angle."""
    page = new_figure((8.0, 3.6), layout="constrained")
    left, right = page.subplots(1, 2, width_ratios=(1, 1.2))
    _draw_wye(left)
    for passed, colour, marker in ((True, "tab:blue", "o"), (False, "tab:red", "x")):
        dots = [
            (one["downward"], cell.turn_deg + SPREAD_DEG * (one["friction"] - 0.8))
            for cell, trials in found.items()
            for one in trials
            if cell.way == "sharp turn" and one["success"] == passed
        ]
        label = f"{'passed' if passed else 'failed'} ({len(dots)})"
        right.scatter(
            *np.reshape(dots, (-1, 2)).T,
            c=colour,
            marker=marker,
            s=18,
            label=label,
        )
    right.set(
        title="Sharp turns",
        xlabel="gravity along the way in (-1: climbs, 1: drives down)",
        ylabel="turn, deg (in a row: friction 0.6 to 1)",
        xlim=(-1.05, 1.05),
        yticks=sorted({cell.turn_deg for cell in found if cell.way == "sharp turn"}),
    )
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    return page


def _draw_wye(axes: Axes) -> None:
    """Section of a wye at 45 degrees in the plane of its axes, with the ways through it, mm."""
    wye, mm = Wye(), 1000.0
    part = Part("wye", wye, Pose())
    low, high = wye.bounds
    x, z = np.meshgrid(*(np.linspace(low[i] - 0.01, high[i] + 0.01, 400) for i in (0, 2)))
    points = np.stack([x, np.zeros_like(x), z], axis=-1)
    bore = (wye.signed_distance(points)[0] > 0) & (wye.extent(points) > 0)
    axes.contourf(mm * x, mm * z, bore, levels=(0.5, 1.5), colors=["0.88"])
    axes.contour(mm * x, mm * z, bore, levels=(0.5,), colors=["0.3"], linewidths=1.0)
    colours = {"turn": "tab:blue", "over": "tab:green", "sharp turn": "tab:red"}
    for way, colour in colours.items():
        enter, leave = WAYS[way][0]
        centreline = part.axis(enter, leave)
        line = centreline.at(np.linspace(0, centreline.length, 200))[0]
        axes.plot(mm * line[:, 0], mm * line[:, 2], colour, label=way)
    for port in wye.port_names:
        pose = wye.ports[port]
        place = mm * pose.position + LABEL_MM * pose.rotation[:, 2]
        axes.annotate(port, place[[0, 2]], ha="center", va="center", fontsize="small")
    axes.set(
        aspect="equal",
        title="A wye at 45 degrees",
        xlabel="x, mm",
        ylabel="z, mm",
        xlim=(-100, 260),
        ylim=(-260, 260),
    )
    axes.grid(visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, handlelength=1.0)


HEADS = ("both, 95 %", "after backing off", "time, s", "failures")


def main() -> None:
    """Run all cells, and print and draw them."""
    arguments = Arguments(__doc__, trials=60, quick=12, workers=True)
    arguments.add_argument("--cross", action="store_true", help="crosses instead of wyes")
    arguments.add_argument("--figure", type=Path, help="file to draw, such as docs/figures/wye.svg")
    given = arguments.read()
    asked = cells("cross" if given.cross else "wye")
    drawn = {cell: [trial(cell, i) for i in range(given.trials)] for cell in asked}
    found = Trials("wye", drawn, DRAWN).run(given.workers)
    walls = (f"{wall}, of {given.trials // len(WALLS)}" for wall in WALLS)
    table("ways", ["way", "branch, deg", *walls, *HEADS], (row(*one) for one in found.items()))
    equal: dict[str, list[Row]] = {}
    for cell, trials in found.items():
        if cell.branch == BORE:
            equal.setdefault(cell.way, []).extend(trials)
    heads = ["way, all angles", *DOWNWARD]
    table("gravity", heads, (gravity_row(*one) for one in equal.items()))
    if given.figure is not None:
        save_figure(figure(found), given.figure)
        print(f"saved {given.figure}", file=sys.stderr)


if __name__ == "__main__":
    main()
