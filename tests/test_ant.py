"""A robot from elsewhere: Gymnasium's ant, as its file is, crawls in a pipe of its size."""

import re

import mujoco
import numpy as np
import pytest
from documents import page

pytest.importorskip("gymnasium")
BLOCKS = re.findall(r"```python\n(.*?)```", page("ant"), re.DOTALL)


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the page's programs leave."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("ant"))
        names = {}
        for block in BLOCKS:
            exec(compile(block, "ant.md", "exec"), names)
        yield names


def test_it_crawls_round_the_elbow(names):
    """Its trot takes it through, on the wall of the bore and off its own floor below."""
    assert names["part"] == "on"
    model, data, touched = names["model"], names["data"], set()
    for _ in range(20):  # a second: for a moment it may touch nothing
        data.ctrl[:] = names["torques"](data)
        mujoco.mj_step(model, data, 5)
        touched |= {model.geom(g).name for contact in data.contact for g in contact.geom}
    assert any(name.startswith("wall_") for name in touched)
    assert "floor" not in touched


def test_learners_see_what_they_saw_on_the_floor(names):
    """Spaces are those of Ant-v5 on its floor, the ant stays in the pipe, and a seed gives the same
    episode again."""
    import gymnasium

    plain, env = gymnasium.make("Ant-v5"), names["env"]
    assert env.observation_space == plain.observation_space
    assert env.action_space == plain.action_space
    assert not names["terminated"]
    episodes = []
    for _ in range(2):
        env.reset(seed=3)
        torques = (names["torques"](env.unwrapped.data) for _ in range(20))
        episodes.append([env.step(action)[0] for action in torques])
    np.testing.assert_array_equal(*episodes)
    assert np.isfinite(episodes[0]).all()
