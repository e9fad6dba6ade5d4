"""view: a scenario in MuJoCo's viewer."""

from __future__ import annotations

from omnitrack_sim.cli.common import ScenarioArgument, SetOption, app, load
from omnitrack_sim.errors import RenderError


@app.command()
def view(scenario: ScenarioArgument, assignments: SetOption = None) -> None:
    """Open a scenario's model in MuJoCo's viewer (needs a screen)."""
    import os

    loaded = load(scenario, assignments)
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RenderError("the viewer needs a screen; `omnitrack run` renders a video without one")
    import mujoco.viewer

    from omnitrack_sim.sim.builder import scene_of, start_qpos

    model = scene_of(loaded, looks=True).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = start_qpos(loaded, model)
    mujoco.viewer.launch(model, data)
