"""Draws a pipe with relief of every kind: its wall unrolled, and cut along its axis.

    python benchmarks/relief.py --out FOLDER

relief.png: how far the exact wall stands above the bore, over length and angle; and the cut through
the floor and the crown.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from shape import Arguments

import omnitrack_sim as ot

PIPE = ot.Straight(
    1.6,
    relief=[
        {"kind": "ovality", "ratio": 0.04, "at": 0.3, "length": 0.5},
        {"kind": "weld", "at": 0.12, "height": 0.004, "width": 0.012},
        {"kind": "weld", "at": 0.6, "height": 0.004, "width": 0.012, "from_deg": 60, "to_deg": 200},
        {"kind": "dent", "at": 0.8, "angle_deg": 180, "depth": 0.01, "length": 0.12, "width": 0.1},
        {"kind": "deposit", "at": 1.2, "length": 0.5, "depth": 0.012, "angle_deg": 0},
    ],
)
ROUGH = ot.Straight(0.4, relief=[{"kind": "corrosion", "wavelength": 0.03, "seed": 3}])
HALVINGS = 24


def height_of(pipe: ot.Straight, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the height, m, of the wall above the bore, where rays across the axis leave it."""
    way = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    inside, outside = np.zeros(angle.shape), np.full(angle.shape, 0.1)
    for _ in range(HALVINGS):
        middle = (inside + outside) / 2
        place = middle[..., None] * way
        place[..., 2] = s
        free = pipe.signed_distance(place)[0] > 0
        inside, outside = np.where(free, middle, inside), np.where(free, outside, middle)
    return pipe.radius - inside


def main() -> None:
    """Draw the picture."""
    parser = Arguments(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    folder = parser.read().out
    folder.mkdir(parents=True, exist_ok=True)
    ratios = {"width_ratios": [PIPE.length, ROUGH.length]}
    figure, panels = plt.subplots(2, 2, figsize=(11, 4.6), gridspec_kw=ratios, layout="constrained")
    for column, (pipe, title) in enumerate(
        ((PIPE, "ovality, two welds, dent, deposit"), (ROUGH, "corrosion"))
    ):
        s, angle = np.meshgrid(np.linspace(0, pipe.length, 321), np.radians(np.arange(0, 361, 2)))
        height = 1e3 * height_of(pipe, s, angle)
        top, cut = panels[:, column]
        picture = top.pcolormesh(s, np.degrees(angle), height, cmap="RdBu_r", vmin=-10, vmax=10)
        top.set(
            title=title,
            xlim=(0, pipe.length),
            yticks=[0, 90, 180, 270, 360],
            ylabel="" if column else "angle, deg",
        )
        for number, sign in ((0, -1), (90, 1)):
            cut.fill_between(s[0], sign * (80 - height[number]), sign * 90, color="0.6", lw=0)
        cut.set(xlim=(0, pipe.length), xlabel="length, m", ylabel="" if column else "cut, mm")
    figure.colorbar(picture, ax=panels[:, 1], label="above the bore, mm")
    figure.savefig(folder / "relief.png", dpi=110)


if __name__ == "__main__":
    main()
