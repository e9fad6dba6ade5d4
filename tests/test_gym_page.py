"""The page about environments of Gymnasium, held to the code."""

from __future__ import annotations

import re

from documents import page

from omnitrack_sim.gym import IDS
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURE_SETS

PAGE = page("gym")


def test_the_page_names_every_environment_set_and_action():
    """With the number of entries of each set."""
    for name, found in FEATURE_SETS.items():
        assert f"`{name}` ({sum(one.size for one in found)} entries)" in PAGE
    for name in (*ACTIONS, *IDS):
        assert f"`{name}`" in PAGE
    assert "| `progress` | D | 1 | way along the route; backward it is negative |" in PAGE
    assert "| `world.friction` | 0.6 to 1 |" in PAGE


def test_python_of_the_page_runs(tmp_path, monkeypatch):
    """Every example."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(blocks) >= 3
    for block in blocks:
        exec(compile(block, "gym.md", "exec"), {})
