"""The page about environments of Gymnasium, held to the code."""

from __future__ import annotations

import re

from documents import page

from omnitrack_sim.base.table import meanings_of
from omnitrack_sim.gym import IDS, TERMS
from omnitrack_sim.gym.options import EnvOptions
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURE_SETS

PAGE = page("gym")


def _rows(heading):
    """Cells of the table below a heading of the page."""
    below = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in below.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def test_the_page_has_every_entry_with_unit_and_range():
    """The table of observations is that of the code, in its order."""
    told = [row[:5] for row in _rows("Observations")]
    assert told == [
        [
            f"`{feature.name}`",
            str(feature.size),
            feature.unit,
            f"{feature.low:.4g} to {feature.high:.4g}",
            next(name for name, found in FEATURE_SETS.items() if feature in found),
        ]
        for feature in FEATURE_SETS["truth"]
    ]
    sizes = {name: sum(one.size for one in found) for name, found in FEATURE_SETS.items()}
    for name, size in sizes.items():
        assert f"`{name}` ({size} entries)" in PAGE


def test_the_page_has_every_term_option_and_range():
    """With the weights, the meanings and the bounds of the code."""
    assert _rows("Reward") == [
        [f"`{t.name}`", t.unit, f"{t.weight:g}", t.meaning] for t in TERMS.values()
    ]
    meanings = meanings_of(EnvOptions)
    assert [row[0] for row in _rows("Options")] == [f"`{key}`" for key in EnvOptions.model_fields]
    assert [row[2] for row in _rows("Options")] == list(meanings.values())
    assert _rows("Trials") == [
        [f"`{path}`", f"{low:g} to {high:g}"] for path, (low, high) in Decisions.ranges.items()
    ]
    for name in (*ACTIONS, *IDS):
        assert f"`{name}`" in PAGE


def test_python_of_the_page_runs(tmp_path, monkeypatch):
    """Every example."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(blocks) >= 3
    for block in blocks:
        exec(compile(block, "gym.md", "exec"), {})
