"""How soft the speed loop has to be, and may be: the linear model beside random tee turns.

python benchmarks/steering.py [--quick] [--workers N] [--trials N] [--figure FILE.svg]

For speed loops from 1.7 to 50 rad/s and three rate gains the model of ``steering_loop.py`` tells
crossover and phase margin of the rate loop, and a batch of random tee turns (friction 0.5 to 0.8,
preload 20 to 35 N, any gravity, no retry, the exact collider where it loads) tells how many pass
and how much the motor torque changes, recorded every 10 ms. The trials are the same for all.
--figure draws both.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from shape import Arguments, Row, Trials, modules_of, table
from steering_loop import SteeringLoop
from tee_turns import random_tee_turns

from omnitrack_sim import Scenario, load_scenario, override
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.show.plots.style import ALARM, GREY, new_figure, save_figure, style

BANDWIDTHS = (1.7, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)
RATE_GAINS = (2.0, 5.0, 8.0)


class Cell(NamedTuple):
    """One speed loop with one rate gain.

    Attributes:
        bandwidth: rad/s. rate_gain: 1.
        crossover, margin: of the rate loop, rad/s and degrees, by the model.
        passed, trials: tee turns.
        change: N m/s, mean of ``torque_change_nm_s`` over modules and trials.
    """

    bandwidth: float
    rate_gain: float
    crossover: float
    margin: float
    passed: int
    trials: int
    change: float


def changes_of(bandwidth: float, rate_gain: float) -> dict[str, Any]:
    """What a cell changes in the scenario."""
    return {
        "robot.motor.speed_bandwidth": bandwidth,
        "control.parameters.damping.tee_turn": rate_gain,
        "control.parameters.sway.lean_deg": 0.0,  # the study is about the loops alone
        "record.period": 0.01,
    }


def loop_of(scenario: Scenario) -> SteeringLoop:
    """The linear model of a scenario in the turn into a branch."""
    parameters, robot = scenario.control_parameters, scenario.robot
    tracking, damping = parameters.tracking, parameters.damping
    speed = scenario.control.cruise_speed * tracking.turn_speed
    return SteeringLoop.of(
        robot,
        rate_gain=damping.tee_turn,
        rate_filter=damping.rate_filter * robot.time_scale,
        period=scenario.physics.control_period,
        heading_gain=tracking.gain / robot.length_scale * speed,
    )


def cell(bandwidth: float, rate_gain: float, loop: SteeringLoop, turns: Sequence[Row]) -> Cell:
    """Return what the model says of a cell, and what came of its turns."""
    margin = loop.rate_margin()
    return Cell(
        bandwidth,
        rate_gain,
        margin.crossover,
        float(np.degrees(margin.phase)),
        sum(turn["success"] for turn in turns),
        len(turns),
        float(np.mean([modules_of(turn, "torque_change_nm_s") for turn in turns])),
    )


@style()
def drawn(cells: list[Cell]) -> Figure:
    """The rate loop of two designs, and torque change over crossover."""
    figure = new_figure((9.0, 3.6), layout="constrained")
    bode, grid = np.ravel(figure.subplots(1, 2))
    frequency = np.geomspace(3.0, 300.0, 600)
    base = load_scenario("tee_turn")
    first = {
        "robot.motor.speed_bandwidth": 50.0,
        "robot.motor.speed_droop": 0.0,
        "control.parameters.damping.tee_turn": 5.0,
    }
    for scenario, colour in ((override(base, first), ALARM), (base, MODULE_COLOURS[2])):
        loop, bandwidth = loop_of(scenario), scenario.robot.motor.speed_bandwidth
        margin, opened = loop.rate_margin(), loop.rate_loop(frequency)
        text = (
            f"{bandwidth:g} rad/s, rate gain {loop.rate_gain:g}: "
            f"margin {np.degrees(margin.phase):.0f}° at {margin.crossover:.0f} rad/s"
        )
        bode.plot(frequency, np.abs(opened), color=colour, label=text)
        bode.plot([margin.crossover], [1.0], "o", color=colour)
    bode.axhline(1.0, color=GREY, linewidth=0.7)
    bode.set(xscale="log", yscale="log", xlabel="frequency, rad/s", ylabel="gain of the rate loop")
    bode.set_xticks([3, 10, 30, 100, 300], labels=["3", "10", "30", "100", "300"])
    bode.set_yticks([0.1, 1.0, 10.0], labels=["0.1", "1", "10"])
    bode.minorticks_off()
    bode.set_title("Rate loop of the first design and of this one")
    bode.legend(fontsize=7.5, loc="lower left")
    for rate_gain, colour in zip(RATE_GAINS, MODULE_COLOURS, strict=True):
        row = [one for one in cells if one.rate_gain == rate_gain]
        crossovers, change = [one.crossover for one in row], [one.change for one in row]
        grid.plot(crossovers, change, "o-", color=colour, label=f"rate gain {rate_gain:g}")
    grid.set(xlabel="crossover of the rate loop, rad/s", ylabel="torque change, N m/s")
    grid.set_title("Random slippery tee turns")
    grid.legend(fontsize=8, loc="upper left")
    for axes, height in ((bode, 0.35), (grid, 1.0)):
        axes.axvline(loop_of(base).spring_frequency, color=GREY, linestyle=":")
        axes.annotate(
            "chassis on its springs",
            (loop_of(base).spring_frequency, height),
            rotation=90,
            ha="right",
            va="bottom",
            fontsize=7.5,
        )
    return figure


def row(bandwidth: float, cells: list[Cell]) -> list[str]:
    """Return the row of a speed loop, with a column for each rate gain."""
    return [
        f"{bandwidth:g}",
        *(
            f"{one.crossover:.0f}, {one.margin:.0f}, {one.passed} of {one.trials}, {one.change:.1f}"
            for one in cells
            if one.bandwidth == bandwidth
        ),
    ]


def main() -> None:
    """Measure the cells that the options ask for, print and draw them."""
    arguments = Arguments(__doc__, trials=48, quick=4, workers=True)
    arguments.add_argument("--figure", type=Path, metavar="FILE.svg")
    given = arguments.read()
    bandwidths = BANDWIDTHS[1::3] if given.quick else BANDWIDTHS
    groups = {
        (bandwidth, gain): random_tee_turns(
            given.trials,
            seed=31,
            friction=(0.5, 0.8),
            preload=(20.0, 35.0),
            changes=changes_of(bandwidth, gain),
        )
        for gain, bandwidth in product(RATE_GAINS, bandwidths)
    }
    runs = Trials("steering", groups).run(given.workers)
    cells = [cell(*key, loop_of(groups[key][0]), turns) for key, turns in runs.items()]
    heads = ["bandwidth, rad/s", *(f"k = {gain:g}" for gain in RATE_GAINS)]
    table("cells", heads, (row(bandwidth, cells) for bandwidth in bandwidths))
    if given.figure is not None:
        save_figure(drawn(cells), given.figure)


if __name__ == "__main__":
    main()
