"""Encoding of films: frames become a file of H.264, VP9 or GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.writing import format_of, whole_file

Image = NDArray[np.uint8]
Append = Callable[[Image], None]
FILM_FORMATS = ("mp4", "webm", "gif")
"""H.264 that plays while it loads, VP9, and animated GIF, which repeats."""
_THREADS = 4


def film_format(path: str | Path) -> str:
    """Return the format of a film, one of ``FILM_FORMATS``, by the ending of its path."""
    return format_of(path, None, "film", FILM_FORMATS)


@contextmanager
def film(path: str | Path, width: int, height: int, fps: int) -> Iterator[Append]:
    """Return a function that appends frames (height, width, 3) to a film.

    The film is written whole or not at all.

    Args:
        path: of the film; its ending is one of ``FILM_FORMATS``.
        width: pixels, even.
        height: pixels, even.
        fps: frames a second.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    import imageio.v3

    imopen: Any = imageio.v3.imopen  # its types know no names of plugins
    format = film_format(path)
    # Without bitexact a WebM would be given a number of its own each time.
    options = {"mp4": {"movflags": "faststart"}, "webm": {"fflags": "+bitexact"}}.get(format, {})
    with (
        whole_file(path) as part,
        imopen(
            part, "w", plugin="pyav", extension=f".{format}", container=format, options=options
        ) as file,
    ):
        if format == "gif":
            _begin_gif(file, width, height, fps)
        else:
            _begin_stream(file, format, fps)
        yield file.write_frame


# imageio has no parameter for the encoder's options. Its own take three times as long; a plain
# search takes a third less than that of the preset. x264 must not look ahead: its macroblock tree,
# which needs that, reads memory that nobody has written, and the file would have other bytes now
# and then. Without the tree CRF 25 is as sharp as 20 with it, in 8 % more bytes.
_X264 = "subme=1:me=dia:weightp=0:bframes=1:b-adapt=0:no-mbtree=1:rc-lookahead=0:scenecut=0"
_ENCODERS = {
    "mp4": ("libx264", {"crf": "25", "preset": "veryfast", "x264-params": _X264}),
    "webm": (
        "libvpx-vp9",
        {"crf": "32", "deadline": "realtime", "cpu-used": "6", "row-mt": "1"},
    ),
}


def _begin_stream(file: Any, format: str, fps: int) -> None:
    codec, options = _ENCODERS[format]
    file.init_video_stream(codec, fps=fps, pixel_format="yuv420p")
    stream = file._video_stream
    stream.options = options
    if format == "webm":
        stream.bit_rate = 0  # constant quality, which "crf" says
    # The bytes of a film follow from the number of threads, which would else be that of the
    # processors. Whole frames side by side: slices of one frame would be a larger file.
    stream.codec_context.thread_count = _THREADS
    stream.codec_context.thread_type = "FRAME"


def _begin_gif(file: Any, width: int, height: int, fps: int) -> None:
    """Each frame gets the 256 colours that suit it; frames are not kept in memory."""
    file.init_video_stream("gif", fps=fps, pixel_format="rgb24")
    stream = file._video_stream  # what the filters take in; without a size they cannot begin
    stream.width, stream.height = width, height
    nodes = {"both": ("split", ""), "colours": ("palettegen", "stats_mode=single")}
    nodes["coloured"] = ("paletteuse", "new=1")
    edges = [
        ("video_in", "both", 0, 0),
        ("both", "coloured", 0, 0),
        ("both", "colours", 1, 0),
        ("colours", "coloured", 0, 1),
        ("coloured", "video_out", 0, 0),
    ]
    file.set_video_filter(filter_graph=(nodes, edges))
    stream.pix_fmt = "pal8"  # what they give
