"""The figure of a study: which panels it has, and what is in them."""

from dataclasses import replace

import numpy as np
import pytest

from omnitrack_sim.show.plots.study_chart import ObjectiveAxis, TriedCandidates, study_figure
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.trials.search import front_of


def _tried(objectives: int, count: int = 60) -> TriedCandidates:
    """Random candidates, some without a value and some beyond a limit."""
    draws = np.random.default_rng(0)
    values = draws.uniform(0, 1, (count, objectives)) ** 2
    values[5, 0] = values[9] = np.inf
    feasible = values[:, 0] < 0.8
    front = front_of(values, 1.0 - feasible).tolist()
    return TriedCandidates(values, feasible, front, front[0], values[front] * 1.05, front)


def _scales(objectives: int) -> list[ObjectiveAxis]:
    return [
        ObjectiveAxis(f"f{i}", "J", "minimise", 0.8 if i == 0 else None) for i in range(objectives)
    ]


@pytest.mark.parametrize(("objectives", "panels"), [(1, 1), (2, 1), (3, 3), (6, 15)])
def test_each_pair_of_objectives_has_a_panel(objectives, panels):
    """One panel for one or two objectives, else one a pair; no value that is infinite breaks it,
    and the same study gives the same bytes."""
    figure = study_figure(_scales(objectives), _tried(objectives))
    shown = [axis for axis in figure.axes if axis.get_visible()]
    assert len(shown) == panels
    if objectives < 6:
        again = study_figure(_scales(objectives), _tried(objectives))
        assert figure_bytes(figure) == figure_bytes(again)


def test_an_objective_that_nothing_changes_has_no_panel():
    """It is said instead; with one objective that changes all have panels."""
    tried, scales = _tried(3), _scales(3)
    known = np.isfinite(tried.values[:, 2])
    tried.values[known, 2] = tried.checked[:, 2] = 1.0
    figure = study_figure(scales, tried)
    assert len([axis for axis in figure.axes if axis.get_visible()]) == 1
    assert figure.get_suptitle() == "f2 [J] is 1 for 59 of 60 candidates"
    tried.values[:, 1] = tried.checked[:, 1] = 1.0
    assert len([axis for axis in study_figure(scales, tried).axes if axis.get_visible()]) == 3


def test_the_front_is_drawn_where_it_is():
    """The line of the front has its candidates in order, the start and the best are marked, and
    a panel shows all of them."""
    tried = _tried(2)
    (axis,) = study_figure(_scales(2), tried).axes
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    x, y = (np.asarray(values) for values in lines["front"].get_data())
    assert (np.diff(x) >= 0).all()
    assert (np.diff(y) <= 0).all()
    assert sorted(x) == sorted(tried.values[tried.front, 0])
    assert lines["start"].get_xydata().tolist() == [tried.values[0].tolist()]
    best = lines["best in the check"]
    assert best.get_xydata().tolist() == [tried.values[tried.best].tolist()]
    low, high = axis.get_xlim()
    assert low < min(x)
    assert max(x) < high
    assert axis.get_xlabel() == "f0 [J], less is better"


def test_checks_are_tied_to_their_candidates():
    """A line goes from each checked candidate to its check, the start's stands apart, and a best
    one that is not on the front says so."""
    tried = _tried(2)
    off = next(i for i in range(1, 60) if i not in (*tried.front, 5, 9))
    places = [0, off]
    tried = replace(tried, best=off, places=places, checked=tried.values[places] + 0.01)
    (axis,) = study_figure(_scales(2), tried).axes
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    assert "best in the check, not on the front" in lines
    for label, place in (("start, checked", 0), ("checked on other trials", off)):
        check = (tried.values[place] + 0.01).tolist()
        assert lines[label].get_xydata().tolist() == [check]
        tie = [tried.values[place].tolist(), check]
        assert tie in [line.get_xydata().tolist() for line in axis.get_lines()]


def test_a_panel_counts_what_it_does_not_show():
    """Candidates far outside and those without a value are counted above the panel; where all are
    shown it says nothing."""
    values = np.linspace([0.1, 0.9], [0.9, 0.1], 101)
    tried = TriedCandidates(values, np.ones(101, bool), [0], 0, np.empty((0, 2)), [])
    assert study_figure(_scales(2), tried).axes[0].get_title("right") == ""
    wild = values.copy()
    wild[50], wild[60] = [9.0, 9.0], [np.inf, 0.5]
    (axis,) = study_figure(_scales(2), replace(tried, values=wild)).axes
    told = "not shown of 101 candidates: 1 outside, 1 without a value"
    assert axis.get_title("right") == told


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("energy_j", "J", "energy [J]"),
        ("torque_change_nm_s", "N m/s", "torque change [N m/s]"),
        ("success_rate", "1", "success rate"),
        ("bores", "m", "bores [m]"),
    ],
)
def test_labels_are_words_with_units(name, unit, words):
    """The unit that a metric's name ends in stands once, in brackets."""
    assert ObjectiveAxis(name, unit, "maximise").label == f"{words}, more is better"


@pytest.mark.parametrize(("goal", "sign"), [("minimise", 1.0), ("maximise", -1.0)])
def test_the_course_of_one_objective_only_gets_better(goal, sign):
    """The line of the best so far never gets worse, ends at the best feasible value, and leaves out
    what is beyond the limit."""
    tried = _tried(1)
    tried = replace(tried, values=sign * tried.values, checked=sign * tried.checked)
    (axis,) = study_figure([ObjectiveAxis("f", "1", goal)], tried).axes
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    course = sign * np.asarray(lines["best so far"].get_ydata())
    assert (np.diff(course[np.isfinite(course)]) <= 0).all()
    kept = tried.feasible & np.isfinite(tried.values[:, 0])
    assert course[-1] == (sign * tried.values[kept]).min()


@pytest.mark.parametrize("objectives", [1, 2])
def test_a_study_without_any_value_has_a_figure(objectives):
    """Where no candidate has a value no point is drawn, neither start nor best is marked, and the
    panel still says what it is of."""
    values = np.full((5, objectives), np.inf)
    tried = TriedCandidates(values, np.zeros(5, bool), [], 0, np.empty((0, objectives)), [])
    figure = study_figure(_scales(objectives), tried)
    (axis,) = figure.axes
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    drawn = {name: line for name, line in lines.items() if not name.startswith("_")}  # no limits
    assert "candidates" in drawn
    assert not {"start", "best"} & drawn.keys()
    assert not any(np.isfinite(line.get_xydata()).all(axis=1).any() for line in drawn.values())
    assert axis.get_ylabel() == _scales(objectives)[-1].label
    assert figure_bytes(figure).startswith(b"\x89PNG")
