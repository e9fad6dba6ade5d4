"""Films as files, written frame by frame with imageio."""

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
FORMATS = ("mp4", "webm", "gif")
"""H.264 that plays while it loads, VP9, and animated GIF, which repeats."""
_THREADS = 4


def film_format(path: str | Path) -> str:
    """The format of a film by the ending of its path.

    Raises:
        InputError: it is none of ``FORMATS``.
    """
    return format_of(path, None, "film", FORMATS)


@contextmanager
def film(path: str | Path, width: int, height: int, fps: int) -> Iterator[Append]:
    """A function that appends frames (height, width, 3) to a film, which is written whole or not
    at all.

    Args:
        path: of the film; its ending is one of ``FORMATS``.
        width, height: pixels, even.
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
        begin = {"mp4": _begin_mp4, "webm": _begin_webm, "gif": _begin_gif}[format]
        begin(file, width, height, fps)
        yield file.write_frame


def _begin_mp4(file: Any, width: int, height: int, fps: int) -> None:
    file.init_video_stream("libx264", fps=fps, pixel_format="yuv420p")
    # imageio has no parameter for the encoder's options. Its own take three times as long; a plain
    # search takes a third less than that of the preset. x264 must not look ahead: its macroblock
    # tree, which needs that, reads memory that nobody has written, and the file would have other
    # bytes now and then. Without the tree CRF 25 is as sharp as 20 with it, in 8 % more bytes.
    plain = "subme=1:me=dia:weightp=0:bframes=1:b-adapt=0"
    blind = "no-mbtree=1:rc-lookahead=0:scenecut=0"
    options = {"crf": "25", "preset": "veryfast", "x264-params": f"{plain}:{blind}"}
    file._video_stream.options = options
    _fix_threads(file)


def _begin_webm(file: Any, width: int, height: int, fps: int) -> None:
    file.init_video_stream("libvpx-vp9", fps=fps, pixel_format="yuv420p")
    stream = file._video_stream
    stream.bit_rate = 0  # constant quality, which "crf" says
    stream.options = {"crf": "32", "deadline": "realtime", "cpu-used": "6", "row-mt": "1"}
    _fix_threads(file)


def _fix_threads(file: Any) -> None:
    """Encode in so many threads on every machine, as the bytes of a film follow from their number,
    which would else be that of the processors."""
    context = file._video_stream.codec_context
    # Whole frames side by side: slices of one frame would be a larger file.
    context.thread_count, context.thread_type = _THREADS, "FRAME"


def _begin_gif(file: Any, width: int, height: int, fps: int) -> None:
    """Each frame gets the 256 colours that suit it; frames are not kept in memory."""
    file.init_video_stream("gif", fps=fps, pixel_format="rgb24")
    stream = file._video_stream  # what the filters take in; without a size they cannot begin
    stream.width, stream.height = width, height
    nodes = {
        "both": ("split", ""),
        "colours": ("palettegen", "stats_mode=single"),
        "coloured": ("paletteuse", "new=1"),
    }
    edges = [
        ("video_in", "both", 0, 0),
        ("both", "coloured", 0, 0),
        ("both", "colours", 1, 0),
        ("colours", "coloured", 0, 1),
        ("coloured", "video_out", 0, 0),
    ]
    file.set_video_filter(filter_graph=(nodes, edges))
    stream.pix_fmt = "pal8"  # what they give
