"""Films of the same frames are the same bytes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from omnitrack_sim.show.film.encoding import FILM_FORMATS, film


def moving_frames(count: int = 10) -> list[np.ndarray]:
    """Stripes and waves that move, (180, 320, 3): something for every part of an encoder."""
    y, x = np.mgrid[:180, :320]
    waves = [(3 * x + 5 * k, 2 * y + 7 * k, (x + y) // 4 * 9 + 3 * k) for k in range(count)]
    return [np.stack(wave, axis=-1).astype(np.uint8) for wave in waves]


def encode(folder: str) -> None:
    """Write the frames as films of every format."""
    for ending in FILM_FORMATS:
        with film(f"{folder}/film.{ending}", 320, 180, 5) as append:
            for frame in moving_frames():
                append(frame)


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> list[Path]:
    """Folders of films that processes with other memory and processors have written."""
    made = []
    for fill, processors in ((0, 2), (170, 1)):
        made.append(tmp_path_factory.mktemp("films"))
        allowed = sorted(os.sched_getaffinity(0))[:processors]
        begin = f"import os; os.sched_setaffinity(0, {allowed})"
        work = f"from test_encoding import encode; encode({str(made[-1])!r})"
        subprocess.run(
            [sys.executable, "-c", f"{begin}\n{work}"],
            check=True,
            cwd=os.path.dirname(__file__),
            env=os.environ | {"MALLOC_PERTURB_": str(fill)},
        )
    return made


@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux fills memory so")
@pytest.mark.parametrize("ending", FILM_FORMATS)
def test_memory_and_processors_make_no_difference(folders, ending):
    """Whatever lies in the memory that the encoder is given, and however many processors there
    are."""
    one, other = (folder / f"film.{ending}" for folder in folders)
    assert one.read_bytes() == other.read_bytes()
