"""The summary figure shows every panel, phase and module of a run."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from samples import sample_result, sample_trajectory

from omnitrack_sim.plots import MODULE_COLOURS, PANELS, plot_summary, summary_figure
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.record.trajectory import Trajectory


def test_panels_carry_units():
    """Every panel has a title of its own and a unit in brackets."""
    axes = summary_figure(sample_result()).axes
    assert len({axis.get_title(loc="left") for axis in axes}) == len(PANELS) == len(axes)
    assert all(axis.get_ylabel().startswith("[") for axis in axes)


def test_module_lines_hold_the_channels():
    """The lines of a module panel are the recorded values in the modules' colours."""
    result = sample_result()
    axis = next(a for a in summary_figure(result).axes if a.get_title(loc="left") == "Normal force")
    for i in range(3):
        line = next(line for line in axis.lines if line.get_label() == f"module {i + 1}")
        assert to_rgb(line.get_color()) == MODULE_COLOURS[i]
        np.testing.assert_array_equal(line.get_ydata(), result.trajectory["normal_force"][:, i])


def test_phases_and_modules_are_named_once():
    """The legends name each module and each phase that occurred exactly once."""
    figure = summary_figure(sample_result())
    names = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert sorted(names) == sorted(
        ["module 1", "module 2", "module 3", "commanded", "straight", "turn", "leave"]
    )


def test_outcome_is_written():
    """The head says how the run ended."""
    figure = summary_figure(sample_result(outcome=Outcome.NO_MOTION_LINE))
    assert any("no motion line after 4.00 s" in text.get_text() for text in figure.texts)


def test_png_is_large_and_repeats(tmp_path):
    """The bitmap is 1680 x 1260, and the same run gives the same bytes."""
    for name in ("a.png", "b.png"):
        plot_summary(sample_result(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (1680, 1260)


@pytest.mark.parametrize("samples", [1, 2])
def test_shortest_runs_can_be_drawn(tmp_path, samples):
    """A run that ended at once, and one whose record is not a number, still give a figure."""
    full = sample_trajectory()
    channels = {name: values[:samples] for name, values in full.channels.items()}
    channels["traction"] = np.full((samples, 3), np.nan)
    short = Trajectory(full.time[:samples], channels, full.phases, full.qpos[:samples])
    plot_summary(sample_result(short), tmp_path / "short.png")
    assert (tmp_path / "short.png").stat().st_size > 10_000
