"""One motor with a differential against three motors, in elbows and tees.

python benchmarks/differential.py [--quick] [--workers N] [--figures FOLDER]

Drawn is a cell for each place, way to drive and friction: start orientations over 120 degrees, 20
or in the tee turn 10 degrees apart, and gravity in three directions. Robot and pipes are
symmetrical, so that an orientation and its mirror image are one trial: no two of them are both
there. The ways to drive are three motors at equal speed, by Eq. 20 and with feedback; one motor and
a differential; the same with friction in its gears (limited slip); and with brakes on its outputs
that steer (scenarios/scripts/brake_steering.py). All run without retry; in elbows the robot is not
rolled first, in tees it is, if the row does not say otherwise. The motors are those that the paper
names, by their own line.

Printed are medians over the trials of a cell, with intervals of 95 % by a seeded bootstrap, and
success with Wilson's; then success by friction in elbows whose walls are slippery. --figures draws
success by friction, and what the belts do where a module has lost its wall.
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
from shape import Arguments, Row, Trials, endings, interval, modules_of, table

import omnitrack_sim as ot
from omnitrack_sim.paper.claim_figures import SERIES_COLOURS
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.show.plots.style import new_figure, save_figure, style

sys.path.insert(0, str(Path(__file__).parents[1] / "scenarios" / "scripts"))

from brake_steering import BRAKES

ELBOWS = {"240 mm elbow": "elbow", "90 mm elbow": "elbow_short"}
OVER, TURN = "straight over a tee", "tee turn"
TEES = {OVER: "tee_straight", f"{OVER}, not rolled": "tee_straight", TURN: "tee_turn"}
DIFFERENTIAL = {"robot.drive": "differential"}
WAYS: dict[str, dict[str, Any]] = {
    "three motors, equal speeds": {"control.kind": "equal"},
    "three motors, Eq. 20": {"control.kind": "paper"},
    "three motors, feedback": {},
    "one motor, differential": DIFFERENTIAL,
    "the same, gear friction 0.15": DIFFERENTIAL | {"robot.gear_friction": 0.15},
    "the same, gear friction 0.5": DIFFERENTIAL | {"robot.gear_friction": 0.5},
    "the same, brakes that steer": BRAKES | {"control.kind": "brake_steering:BrakeSteering"},
}
EQUAL, EQ20, FEEDBACK, ONE, LIMITED, STIFF, BRAKED = WAYS
TABLE_WAYS = {
    **dict.fromkeys(ELBOWS, (EQUAL, EQ20, FEEDBACK, ONE, LIMITED)),
    **dict.fromkeys(TEES, (FEEDBACK, ONE, STIFF, BRAKED)),
}
"""Which ways are tried where."""
SLIPPERY_WAYS = (EQUAL, FEEDBACK, ONE, LIMITED)
DRY, SLIPPERY = 0.9, (0.15, 0.2, 0.3, 0.4)
GRAVITIES = {
    "climbs in": (0.0, 0.0, -9.81),
    "drives down in": (0.0, 0.0, 9.81),
    "climbs out": (-9.81, 0.0, 0.0),
}
"""m/s²; the first pipe is along z, bends and branches lead towards +x."""
ORIENTATIONS, TURN_ORIENTATIONS = np.arange(-55.0, 60.0, 20.0), np.arange(-57.5, 60.0, 10.0)
"""Start orientations, degrees, and those of the tee turn; none is the negative of another."""
LOADED = 5.0
"""Normal force from which on a module counts as carrying load, N."""
RESAMPLES = 2000
"""Of the bootstrap."""


class Cell(NamedTuple):
    """A place, a way to drive there, and the friction."""

    place: str
    way: str
    friction: float = DRY


FIGURES = ("slip, mm", "traction, N", "needed friction", "largest tilt", "energy, J")
"""Slip is the sum of the modules, traction the root mean square of the largest."""


def figures(trial: Row) -> tuple[float, ...]:
    """Return the figures of a trial, in the order of ``FIGURES``."""
    slip, traction = (modules_of(trial, name) for name in ("slip_distance_m", "traction_rms_n"))
    rest = trial["needed_friction"], trial["tilt_max_deg"], trial["energy_j"]
    return (1000 * sum(slip), max(traction), *rest)


def orientations(cell: Cell, quick: bool) -> list[float]:
    """Start orientations of a cell, degrees; two of them in the quick form."""
    every = TURN_ORIENTATIONS if cell.place == TURN else ORIENTATIONS
    return every[:: len(every) // 2 if quick else 1].tolist()


def trials(cell: Cell, orientations: Sequence[float]) -> list[ot.Scenario]:
    """All trials of a cell: gravities one after the other, orientations within."""
    places = ELBOWS | TEES
    fixed = {
        "start.axis": [0.0, 0.0, 1.0],
        "control.align": cell.place in (OVER, TURN),
        "control.retry": False,
        "world.friction": cell.friction,
        "robot.motor": "pololu_1000_hpcb",
    }
    base = ot.override(ot.load_scenario(places[cell.place]), fixed | WAYS[cell.way])
    return [
        ot.override(base, {"world.gravity": list(gravity), "start.theta5_deg": float(theta5)})
        for gravity, theta5 in product(GRAVITIES.values(), orientations)
    ]


def measured(result: ot.Result) -> dict[str, float]:
    """Return what no metric says of a run."""
    return {"needed_friction": needed_friction(result)}


def needed_friction(result: ot.Result) -> float:
    """Return traction over normal force of the module that needs most, of those that carry load.

    Counted is the time while any of the robot is in the fitting, of which 95 % need no more. It is
    0 where it never got there.
    """
    trajectory, half = result.trajectory, result.scenario.robot.length / 2
    start, end = result.scenario.route.passages[1].span
    inside = (trajectory["distance"] > start - half) & (trajectory["distance"] < end + half)
    if not inside.any():
        return 0.0
    normal = trajectory["normal_force"][inside]
    ratio = np.abs(trajectory["traction"][inside]) / np.maximum(normal, LOADED)
    return float(np.percentile(np.where(normal >= LOADED, ratio, 0.0).max(axis=1), 95))


def median(values: Sequence[float]) -> tuple[float, float, float]:
    """The median and the ends of its 95 % interval, by a bootstrap over the trials."""
    sample = np.asarray(values)
    drawn = np.random.default_rng(0).choice(sample, (RESAMPLES, len(sample)))
    low, high = np.percentile(np.median(drawn, axis=1), (2.5, 97.5))
    return float(np.median(sample)), float(low), float(high)


def row(cell: Cell, found: Sequence[Row]) -> list[str]:
    """Return a row of the tables of places: medians of the trials that passed."""
    passed = [figures(trial) for trial in found if trial["success"]]
    cells = []
    for values in zip(*passed, strict=True) if passed else ():
        middle, low, high = median(values)
        digits = 0 if middle >= 20 else 2 if middle < 1 else 1
        cells.append(f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})")
    cells = cells or ["-"] * len(FIGURES)
    rate = f"{len(passed)} ({interval(trial['success'] for trial in found)})"
    failed = endings(trial["outcome"] for trial in found if not trial["success"])
    return [cell.way, rate, *cells, failed]


def slippery_rows(place: str, found: Mapping[Cell, Sequence[Row]]) -> list[list[str]]:
    """Return rows of slippery elbows, one a friction: successes and median slip by drive."""
    rows = []
    for friction in sorted({cell.friction for cell in found} - {DRY}):
        columns = [place, f"{friction:g}"]
        for way in SLIPPERY_WAYS:
            trials = found[Cell(place, way, friction)]
            slip, *_ = median([figures(trial)[0] for trial in trials])
            columns.append(f"{sum(trial['success'] for trial in trials)}; {slip:.0f}")
        rows.append(columns)
    return rows


@style()
def friction_figure(found: Mapping[Cell, Sequence[Row]]) -> Figure:
    """Success over friction in both elbows, with Wilson's intervals."""
    page = new_figure((8.0, 3.4), layout="constrained")
    panels = page.subplots(1, len(ELBOWS), sharey=True)
    for axes, place in zip(panels, ELBOWS, strict=True):
        for k, way in enumerate(SLIPPERY_WAYS):
            cells = [Cell(place, way, friction) for friction in (*SLIPPERY, DRY)]
            _rates(axes, k, way, {cell.friction: found[cell] for cell in cells})
        axes.set(title=place, xlabel="friction", ylim=(-3, 103))
    panels[0].set_ylabel("passed, %")
    page.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return page


def _rates(axes: Axes, k: int, way: str, by_friction: Mapping[float, Sequence[Row]]) -> None:
    """The line of one way, moved a little beside the others."""
    x = np.array(list(by_friction)) + 0.004 * (k - 1.5)
    counts = [(sum(t["success"] for t in part), len(part)) for part in by_friction.values()]
    rates = np.array([passed / total for passed, total in counts])
    bars = np.abs(np.array([wilson_interval(*count) for count in counts]).T - rates)
    style: dict[str, Any] = {"fmt": "o-", "ms": 4, "capsize": 2, "color": SERIES_COLOURS[k]}
    axes.errorbar(x, 100 * rates, 100 * bars, label=way, **style)


@style()
def racing_figure() -> Figure:
    """Draw belt speeds and normal forces where a module has lost its wall.

    That is straight over a tee with a module that faces the opening, and in the turn.
    """
    page = new_figure((8.0, 4.2), layout="constrained")
    panels = page.subplots(2, 2, sharey="row", sharex="col")
    for column, place in enumerate((f"{OVER}, not rolled", TURN)):
        scenario = ot.override(trials(Cell(place, ONE), [0.0])[0], {"run.time_limit": 6.5})
        record = ot.run(scenario).trajectory
        panels[0, column].set_title(f"{place}, climbing")
        panels[1, column].set_xlabel("time, s")
        for i, colour in enumerate(MODULE_COLOURS):
            kind: dict[str, Any] = {"color": colour, "ls": ("-", "-", "--")[i]}
            speeds = 1000 * record["wall_speed"][:, i]
            panels[0, column].plot(record.time, speeds, label=f"module {i + 1}", **kind)
            panels[1, column].plot(record.time, record["normal_force"][:, i], **kind)
    panels[0, 0].set_ylabel("belt speed, mm/s")
    panels[1, 0].set_ylabel("normal force, N")
    page.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return page


def cells(quick: bool) -> list[Cell]:
    """All cells; fewer frictions in the quick form."""
    dry = [Cell(place, way) for place, ways in TABLE_WAYS.items() for way in ways]
    frictions = SLIPPERY[1:2] if quick else SLIPPERY
    return dry + [Cell(*one) for one in product(ELBOWS, SLIPPERY_WAYS, frictions)]


def show(found: Mapping[Cell, Sequence[Row]]) -> None:
    """Print all tables."""
    for place in ELBOWS | TEES:
        own = [(c, f) for c, f in found.items() if (c.place, c.friction) == (place, DRY)]
        heads = ("drive", f"passed of {len(own[0][1])}", *FIGURES, "failures")
        table(place, heads, (row(*one) for one in own))
    count = len(next(trials for cell, trials in found.items() if cell.friction != DRY))
    rows = [row for place in ELBOWS for row in slippery_rows(place, found)]
    text = f"Passed of {count}; median slip of all trials, mm:"
    table("slippery elbows", ("elbow", "friction", *SLIPPERY_WAYS), rows, text)


def main() -> None:
    """Run all cells, and print and draw them."""
    parser = Arguments(__doc__, workers=True)
    parser.add_argument("--quick", action="store_true", help="two orientations, fewer frictions")
    parser.add_argument("--figures", type=Path, help="folder to draw into, such as docs/figures")
    given = parser.read()
    if given.quick and given.figures:
        parser.error("--figures needs all frictions, which --quick leaves out")
    drawn = {cell: trials(cell, orientations(cell, given.quick)) for cell in cells(given.quick)}
    found = Trials("differential", drawn, measure=measured).run(given.workers)
    show(found)
    if given.figures is not None:
        for name, draw in (
            ("differential_friction", lambda: friction_figure(found)),
            ("differential_tee", racing_figure),
        ):
            save_figure(draw(), given.figures / f"{name}.svg")
            print(f"saved {given.figures / name}.svg", file=sys.stderr)


if __name__ == "__main__":
    main()
