"""Pieces of the comparison with other walls that need no package beyond those of omnitrack_sim."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest

import omnitrack_sim as ot
from omnitrack_sim.walls.geoms import add_walls

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "compare"))

import entries
import measure
import report
from peer_walls import MeshSettings, bore_surface, flex_walls, wall_solid


def flex_entry() -> entries.Entry:
    return entries.entries(entries.Work(Path("unused"), 1.0), ("flex",), quick=True)[0]


def row(
    peer: str, speed: float, error: float, outcome: str = "reached_goal", timestep: float = 0.002
) -> measure.Row:
    return measure.Row(peer, "tee_turn", {}, timestep, outcome, None, error, error, speed, speed)


def test_the_robot_drives_in_a_flex():
    """In walls of a rigid flex it drives 0.2 m along a straight, 15 lugs a track at the wall."""
    scenario = ot.override(ot.load_scenario("straight"), {"run.time_limit": 2.2})
    entry = flex_entry()
    simulation = ot.Simulation([scenario], make_plant=entry.prepare(scenario).make_plant)
    simulation.advance()
    (trajectory,) = simulation.recorder.trajectories(simulation.end_time)
    assert trajectory["distance"][-1] - trajectory["distance"][0] > 0.2
    assert trajectory["contact_count"][-1].sum() >= 3 * scenario.robot.lugs_per_track


@pytest.mark.parametrize("offset", [0.0, 3e-4, -3e-4])
def test_wall_error_of_a_known_offset(offset):
    """Walls that stand off by 0.3 mm read 0.3 mm, on top of what the facets are off."""
    scenario = ot.load_scenario("straight")

    def walls(spec, network):
        flex_walls(spec, network, MeshSettings(sections=192), radius=1e-3, offset=offset)
        return 0.0

    entry = entries.Entry("flex", {}, {}, walls)
    largest, most = entries.probe_walls(entry, scenario, scenario.route.network.parts[0], 100)
    assert largest == pytest.approx(1000 * abs(offset), abs=0.02)
    assert most == pytest.approx(1000 * abs(offset), abs=0.02)


def test_missing_walls_count_as_the_reach():
    """Where nothing is touched the error is the reach of the probe."""
    scenario = ot.load_scenario("straight")
    entry = entries.Entry("flex", {}, {}, lambda spec, network: 0.0)
    part = scenario.route.network.parts[0]
    assert entries.probe_walls(entry, scenario, part, 5)[0] == pytest.approx(
        1000 * entries.PROBE_REACH
    )


def test_wall_error_of_the_primitives():
    """The package's own walls of a straight read no more than their tolerance."""
    scenario = ot.load_scenario("straight")
    entry = entries.Entry(
        "primitives", {}, {}, lambda spec, network: 0.0 * add_walls(spec, network, tolerance=1e-4)
    )
    largest, _ = entries.probe_walls(entry, scenario, scenario.route.network.parts[0], 300)
    assert 0 < largest <= 0.1


def test_mesh_walls_are_solid_and_centred():
    """The tee's wall is watertight, and its bore's vertices stand out of the exact surface by half
    the sagitta."""
    tee = ot.load_scenario("tee_turn").route.network.parts[1].fitting
    settings = MeshSettings(sections=48)
    assert wall_solid(tee, settings).is_watertight
    surface = bore_surface(tee, settings)
    sagitta = tee.radius * (1 / math.cos(math.pi / 48) - 1)
    assert tee.signed_distance(surface.vertices)[0] == pytest.approx(-sagitta / 2, abs=1e-5)


def test_best_settings_finish_then_are_exact_then_fast():
    """Finishing counts before wall error, wall error in steps before speed."""
    failing, coarse = row("flex", 9.0, 0.0, "stuck"), row("flex", 5.0, 0.30)
    slow, fast = row("flex", 1.0, 0.011), row("flex", 2.0, 0.049)
    assert report.best([failing, coarse]) is coarse
    assert report.best([failing, coarse, slow, fast]) is fast


def test_ratio_is_taken_at_equal_or_better_wall_error():
    """Against the fastest own entry that finishes at the same time step and no greater wall
    error."""
    peer = row("flex", 2.0, 0.05)
    own = [
        row("primitives", 30.0, 0.1),
        row("exact", 40.0, 0.0, timestep=0.004),
        row("exact", 50.0, 0.0, "stuck"),
        row("exact", 20.0, 0.0),
        row("primitives", 10.0, 0.05),
    ]
    assert report.ratio(peer, [peer, *own]) == pytest.approx(10.0)
    assert math.isnan(report.ratio(row("flex", 2.0, -1.0), own))


def test_speeds_are_medians_of_the_repeats():
    """One bad repeat does not count."""
    settled = measure.settle([row("flex", speed, 0.1) for speed in (1.0, 3.0, 100.0)])
    assert settled.step_speed == 3.0
    assert settled.repeats == 3
    assert "| flex | tee_turn |" in report.tables([settled], [settled], ["a note"])
