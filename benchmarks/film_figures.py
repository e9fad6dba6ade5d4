"""The pictures of films in the documents.

python benchmarks/film_figures.py [--docs FOLDER]

Runs the tee turn, `missions/fig14` and `missions/dead_end` with exact walls (extra `fast`) and
writes `tee.png` and `figures/film_*.png`, `figures/mission_frame.png` into the folder of documents.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import omnitrack_sim as ot

SIZE = 960, 540
EXACT = {"physics.collider": "exact"}


def still(path: Path, result: ot.Result, time: float, camera: str) -> None:
    """One frame as a file."""
    frame = ot.render_frame(result, time, camera, *SIZE)
    Image.fromarray(frame).save(path, optimize=True)
    print(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[1] / "docs")
    docs = parser.parse_args().docs
    figures = docs / "figures"
    tee, fig14, dead_end = (
        ot.run(ot.override(ot.load_scenario(name), EXACT))
        for name in ("tee_turn", "missions/fig14", "missions/dead_end")
    )
    first_tail = float(dead_end.trajectory.time[np.argmax(dead_end.trajectory["gear"] < 0)])
    still(docs / "tee.png", tee, 2.9, "side")
    still(figures / "film_side.png", tee, 3.4, "side")
    still(figures / "film_follow.png", fig14, 13.0, "follow")
    still(figures / "film_onboard.png", fig14, 2.0, "onboard")
    still(figures / "mission_frame.png", dead_end, first_tail, "follow")
    print(ot.render_strip(tee, figures / "film_strip.png", width=480, height=360))


if __name__ == "__main__":
    main()
