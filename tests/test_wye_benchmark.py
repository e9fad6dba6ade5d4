"""Pieces of the benchmark of the ways through a wye; the benchmark itself takes minutes."""

from __future__ import annotations

import numpy as np
import pytest
import wye


def ended(**changes: object) -> dict[str, object]:
    first = {"friction": 0.9, "downward": -0.5, "outcome": "reached_goal", "success": True}
    return first | {"attempts": 1, "duration_s": 9.0} | changes


@pytest.mark.parametrize("cell", [*wye.cells(), *wye.cells("cross")], ids=str)
def test_a_cell_turns_by_its_angle(cell):
    """Each cell's first trial is a scenario whose way turns by the angle that the table names."""
    passage = wye.trial(cell, 0).route.passages[1]
    assert np.degrees(passage.description.turn_angle) == pytest.approx(cell.turn_deg)
    assert cell.way == "across" or passage.corner_radius == wye.BORE / 2


def test_trials_of_a_number_differ_only_by_wye_and_way():
    """Start, friction, preload and gravity of a trial are the same in every cell; halves of the
    trials are on a dry and a wet wall, and either half goes over the run both ways."""
    for index in range(8):
        first, *others = (wye.trial(cell, index) for cell in wye.cells())
        for other in others:
            assert other.model_dump(exclude={"pipes"}) == first.model_dump(exclude={"pipes"})
        low, high = wye.WALLS[wye.wall_of(index)]
        assert low <= first.world.friction <= high
    over = [wye.trial(wye.Cell("over", 45.0), index).route.passages[1] for index in range(4)]
    ways = {(wye.wall_of(index), passage.enter) for index, passage in enumerate(over)}
    assert len(ways) == 4


def test_the_tables_count_what_passed():
    """Rates stand by wall and by gravity's component along the way; failures by their outcome."""
    trials = [
        ended(),
        ended(friction=0.7, attempts=3),
        ended(friction=0.7, outcome="stuck", success=False),
    ]
    cells = wye.row(wye.Cell("turn", 45.0), trials)
    assert cells[2:] == ["1", "1", "21 to 94 %", "1", "9.0", "1 stuck"]
    assert wye.gravity_row("turn", trials)[:2] == ["turn", "2 of 3 (21 to 94 %)"]
