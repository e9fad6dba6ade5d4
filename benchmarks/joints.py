"""Draws joints as they are, cut along their axes, and the robot on its way up a step.

    python benchmarks/joints.py --out FOLDER

joints.png: a step, an offset, a gap and an old joint, as the exact distance has them; step.png:
four stills of the scenario `step`.
"""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from shape import Arguments

import omnitrack_sim as ot
from omnitrack_sim.pipes import Part, Pose

JOINTS = {
    "step: end_diameter = 0.15": ot.Coupling(end_diameter=0.15),
    "offset = 0.006": ot.Coupling(offset=0.006),
    "gap = 0.012, depth = 0.015": ot.Coupling(gap=0.012, depth=0.015),
    "offset, gap, angle_deg = 3": ot.Coupling(
        offset=0.004, angle=math.radians(3), gap=0.014, depth=0.012
    ),
}
WALL = 0.025
"""Of the wall that is drawn, m."""
PLACES = 0.37, 0.41, 0.45, 0.50
"""Arc lengths of the robot's centre in the stills, m."""


def draw_joints(path: Path) -> None:
    """Draw the bores white and the walls grey, in the plane of the axes."""
    figure, panels = plt.subplots(1, len(JOINTS), figsize=(11, 3.2))
    for panel, (title, joint) in zip(panels, JOINTS.items(), strict=True):
        low, high = joint.bounds
        z = np.linspace(low[2], high[2], 700)
        x = np.linspace(low[0] - WALL, high[0] + WALL, 700)
        points = np.zeros((len(x), len(z), 3))
        points[..., 0], points[..., 2] = x[:, None], z
        distance = joint.signed_distance(points)[0]
        distance[(joint.extent(points) < 0) | (distance < -WALL)] = np.nan
        panel.contourf(1e3 * z, 1e3 * x, distance, [-1, 0], colors=["0.6"])
        panel.contour(1e3 * z, 1e3 * x, distance, [0], colors=["0.2"], linewidths=1)
        panel.plot(*1e3 * np.array([axis_points(joint)[:, i] for i in (2, 0)]), "C0-.", lw=0.8)
        panel.set(title=title, aspect="equal", xlabel="mm")
        panel.title.set_fontsize(9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def axis_points(joint: ot.Coupling) -> np.ndarray:
    """Return points (n, 3) m of the centreline through a joint."""
    (line, _, _), *_ = Part("joint", joint, Pose()).axes
    return line.at(np.linspace(0, line.length, 50))[0]


def draw_step(path: Path) -> None:
    """Drive the scenario `step` and draw stills of it."""
    result = ot.run("step", no_load=False)
    run = result.trajectory
    times = [run.time[np.searchsorted(run["distance"], place)] for place in PLACES]
    ot.render_strip(result, path=path, times=times, camera="follow", width=480, height=400)


def main() -> None:
    """Draw both pictures."""
    parser = Arguments(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    folder = parser.read().out
    folder.mkdir(parents=True, exist_ok=True)
    draw_joints(folder / "joints.png")
    draw_step(folder / "step.png")


if __name__ == "__main__":
    main()
