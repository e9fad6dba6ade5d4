"""Two runs beside each other: differences, their table, their figure, and the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.lines import Line2D
from samples import sample_result, sample_trajectory
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError, OmnitrackError, OutputError
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.results.comparison import ComparedValue, figure_row, value_row
from omnitrack_sim.scenario import validate
from omnitrack_sim.show.plots.run_figures import OF_ROBOT

PIPES = [{"kind": "straight", "length": 1.0}, {"kind": "elbow"}]
BASE = validate({"name": "base", "pipes": PIPES})


def result(changes=None, **fields):
    """A run of the base with changes of its scenario; ``fields`` as of ``sample_result``."""
    return sample_result(scenario=ot.override(BASE, changes or {}), **fields)


def test_values_that_differ_are_told_by_their_path_with_their_unit():
    """Of the resolved scenarios: numbers, words, parts of lists; not the name, and not twice."""
    changed = {
        "world.friction": 0.5,
        "robot.preload": 30.0,
        "pipes.0.length": 1.5,
        "world.gravity": [0.0, 0.0, 0.0],
        "control.kind": "paper",
    }
    found = ot.compare(result(), result(changed))
    by_path = {one.name: one for one in found.values}
    assert set(changed) <= set(by_path)
    assert all(path.startswith((*changed, "control.parameters")) for path in by_path)
    friction, preload = by_path["world.friction"], by_path["robot.preload"]
    assert (friction.a, friction.b, friction.unit) == (BASE.world.friction, 0.5, "1")
    assert (preload.unit, preload.difference) == ("N", pytest.approx(30.0 - BASE.robot.preload))
    assert by_path["pipes.0.length"].unit == "m"
    assert by_path["control.kind"].difference is None
    assert by_path["world.gravity"].b == [0.0, 0.0, 0.0]
    assert ot.compare(result(), result()).values == ()


def test_pipes_of_another_number_are_one_difference():
    """Lists of different length are told as a whole: their items have no counterparts."""
    longer = validate({"name": "longer", "pipes": [*PIPES, {"kind": "straight", "length": 0.3}]})
    (pipes,) = ot.compare(result(), sample_result(scenario=longer)).values
    assert pipes.name == "pipes"
    assert (len(pipes.a), len(pipes.b)) == (2, 3)


def test_figures_are_all_numbers_of_both_with_units():
    """Duration, one number a module, one a phase, of the estimate; what only one run has is None in
    the other."""
    more = {"theta5_error_p95_deg": 2.0, "mine_n": 3.0}
    other = result(metrics=dict(result().metrics) | more, duration_s=5.0)
    found = ot.compare(result(), other)
    figures = {one.name: one for one in found.figures}
    assert len(figures) == len(found.figures)
    assert (figures["duration_s"].difference, figures["duration_s"].unit) == (1.0, "s")
    assert figures["traction_rms_n_2"].unit == "N"
    assert figures["phase_time_s.turn"].unit == "s"
    assert figures["slip_ratio_mean_3"].a == result().metrics["slip_ratio_mean"][2]
    assert figures["theta5_error_p95_deg"].unit == "deg"
    mine = figures["mine_n"]
    assert (mine.a, mine.b, mine.difference, mine.unit, mine.differs) == (None, 3.0, None, "", True)
    assert sorted(one.name for one in found.figures if one.differs) == ["duration_s", *sorted(more)]


def test_the_noise_of_floats_is_no_difference():
    """4e-13 of a number is none, 6e-6 of it is, and the table shows digits that tell it."""
    metrics = dict(result().metrics) | {"no_load_slip_m_s": 4.127e-06, "contact_fraction": 0.997454}
    other = metrics | {"no_load_slip_m_s": 4.127e-06 + 1.763e-18, "contact_fraction": 0.997447492}
    found = ot.compare(result(metrics=metrics), result(metrics=other))
    (changed,) = (one for one in found.figures if one.differs)
    row = ("contact_fraction", "1", "0.997454", "0.9974475", "-6.5e-06")
    assert figure_row(changed) == row


@pytest.mark.parametrize(
    ("a", "b", "texts"),
    [
        (3.4e-15, 8.7e-15, ("0", "0", "0")),
        (0.25, 0.25 + 5.3e-15, ("0.25", "0.25", "0")),
        (-5.5e-14, 2.0, ("0", "2", "2")),
        (2e-9, 4e-9, ("2e-09", "4e-09", "2e-09")),
    ],
)
def test_errors_of_rounding_are_printed_as_zero(a, b, texts):
    """Figures below 1e-9 of their unit, and differences of numbers that do not differ."""
    assert figure_row(ComparedValue("distance_m", "m", a, b))[2:] == texts


def test_numbers_that_are_none_are_the_same():
    """A slip that was not measured does not differ from itself."""
    metrics = dict(result().metrics) | {"no_load_slip_m_s": float("nan")}
    found = ot.compare(result(metrics=metrics), result(metrics=metrics))
    assert not any(one.differs for one in found.figures)


def test_the_figure_has_both_runs_in_every_panel():
    """The recorded values of both, in one scale a column of modules, to the longer of the two, with
    a cross at the end of the one that failed; both are named by what differs."""
    a = result()
    b = result(
        {"world.friction": 0.5}, trajectory=sample_trajectory(end=6.0), outcome=Outcome.STUCK
    )
    figure = ot.plot_compare(a, b)
    assert len(figure.axes) == len(OF_ROBOT) + 3 * len(a.scenario.robot.display.compared)
    for axis in figure.axes:
        first, second = axis.lines
        assert (len(first.get_xdata()), second.get_xdata()[-1]) == (201, 6.0)
        assert (first.get_marker(), second.get_marker()) == ("o", "X")
        assert first.get_linewidth() > second.get_linewidth()
        assert axis.get_xlim()[1] >= 6.0
    torque = [axis for axis in figure.axes if axis.get_ylabel() == "Motor torque, module 3 [N m]"]
    np.testing.assert_array_equal(
        torque[0].lines[1].get_ydata(), b.trajectory["motor_torque"][:, 2]
    )
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "A: world.friction = 0.9; reached goal after 4.00 s",
        "B: world.friction = 0.5; stuck after 6.00 s",
    ]
    assert {type(handle) for handle in legend.legend_handles} == {Line2D}
    assert [handle.get_marker() for handle in legend.legend_handles] == ["o", "X"]


def test_a_table_of_one_run_alone_is_told_by_its_size_or_kind():
    """In the rows for people; the kinds of two pipes by name, all values in the data."""
    found = {
        one.name: one for one in ot.compare(result(), result({"control.kind": "paper"})).values
    }
    tracking = found["control.parameters.tracking"]
    assert tracking.b is None
    assert value_row(tracking)[2:] == (f"{len(tracking.a)} values", "-")
    pipes = ot.compare(result(), sample_result(scenario=validate({"pipes": PIPES[:1]}))).values
    assert value_row(pipes[0])[2:] == ("straight, elbow", "straight")


def test_runs_of_other_controllers_are_named_by_them():
    """By the kind alone, however many of their parameters differ."""
    figure = ot.plot_compare(result(), result({"control.kind": "paper"}))
    names = [text.get_text().partition(";")[0] for text in figure.legends[0].get_texts()]
    assert names == ["A: jacobian", "B: paper"]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_name_is_broken_within_a_word(folders, tmp_path, monkeypatch, width):
    """Each line of a name ends at a dot, or with the name."""
    paper = str(result({"control.kind": "paper"}).save(tmp_path / "paper"))
    monkeypatch.setattr(out, "_width", width)  # the property sets it for good
    printed = command(folders[0], paper).output.splitlines()
    words = [line.split()[0] for line in printed if line.split()]
    for name in ("control.parameters.complete_deg", "control.parameters.elbow_delay"):
        assert name in words or {name.rpartition(".")[0] + ".", name.rpartition(".")[2]} <= {*words}


def test_labels_are_the_users():
    """Two texts; anything else is refused."""
    figure = ot.plot_compare(result(), result(), labels=("one", "$two$"))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [text.partition(";")[0] for text in texts] == ["A: one", "B: $two$"]
    with pytest.raises(InputError, match="labels: are 'ab'; give two"):
        ot.plot_compare(result(), result(), labels="ab")


def test_html_is_safe_and_tells_what_differs():
    """Names from users are text in it."""
    scenario = ot.override(BASE, {"robot.preload": 30.0})
    html = ot.compare(result(), sample_result(scenario=scenario, duration_s=5.0))._repr_html_()
    assert "robot.preload" in html
    assert "duration_s" in html
    assert "traction_rms_n_1" not in html  # the same in both
    own = result(metrics=dict(result().metrics) | {"<b>mine": 3.0})
    assert "&lt;b&gt;mine" in ot.compare(result(), own)._repr_html_()


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    place = tmp_path_factory.mktemp("runs")
    a, b = result(), result({"world.friction": 0.5}, duration_s=4.0)
    return str(a.save(place / "a")), str(b.save(place / "b"))


def command(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


def test_the_command_prints_tables(folders):
    """Outcomes, the value that differs, and that no figure does."""
    done = command(*folders)
    assert done.exit_code == 0, done.exception
    assert "world.friction" in done.output
    assert "all figures are the same" in done.output
    assert "the scenarios are the same" in command(folders[0], folders[0]).output


def test_the_command_prints_json_and_nothing_else(folders, tmp_path):
    """What ``Comparison.summary`` holds, also where a figure is written."""
    done = command(*folders, "--json", "--out", tmp_path / "a.svg")
    assert json.loads(done.stdout) == json.loads(json.dumps(ot.compare(*folders).summary()))
    assert [path.name for path in tmp_path.iterdir()] == ["a.svg"]


@pytest.mark.parametrize(
    ("out", "files"),
    [
        ("a.PDF", ["a.PDF"]),
        ("new/both", ["new", "new/both", "new/both/comparison.json", "new/both/comparison.png"]),
        ("there.v1", ["there.v1", "there.v1/comparison.json", "there.v1/comparison.png"]),
    ],
)
def test_the_command_writes_a_figure_or_a_folder(folders, tmp_path, out, files):
    """By the ending; the figure is that of Python. A folder that is there may have an ending."""
    if out == "there.v1":
        (tmp_path / out).mkdir()
    done = command(*folders, "--out", tmp_path / out)
    assert done.exit_code == 0, done.exception
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*")) == files
    figure = tmp_path / files[-1]
    ot.plot_compare(*folders, path=tmp_path / f"own{figure.suffix}")
    assert figure.read_bytes() == (tmp_path / f"own{figure.suffix}").read_bytes()


@pytest.mark.parametrize(
    ("missing", "told"),
    [("nothing", "no such folder"), ("", "is no run: result.json is missing")],
)
def test_a_folder_that_is_no_run_is_refused(folders, tmp_path, missing, told):
    """On either side, before anything is written."""
    for pair in ((folders[0], tmp_path / missing), (tmp_path / missing, folders[0])):
        done = command(*pair, "--out", tmp_path / "a.png")
        assert isinstance(done.exception, OutputError)
        assert told in str(done.exception)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("file", "is a file; choose a folder"),
        ("no/a.png", "the folder no does not exist"),
        ("a.jpg", "no figure ends in .jpg, and a new folder has no ending (choose from: .png"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused_first(tmp_path, out, told):
    """Before the runs are read: that they are missing is not told."""
    (tmp_path / "file").write_text("mine")
    done = command("nothing", "nothing", "--out", tmp_path / out)
    assert isinstance(done.exception, OmnitrackError)
    assert told in str(done.exception).replace(f"{tmp_path}/", "")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "mine"
