"""Light and smoothing of pictures, as programs for OpenGL 4.0 from the files in ``glsl/``.

Vectors are in the world frame, lengths in m. A software OpenGL skips no branches, but loops that
are over before they begin, and pixels that are discarded: so a branch that costs much is written as
one of these. What is linear over a triangle is worked out at its corners, of which there are far
fewer than pixels.
"""

from __future__ import annotations

from pathlib import Path

REACH = 16
"""Distance at which the smoothing still looks for the end of an edge, pixels."""
BLOCK = 4
"""Width of the blocks in which edges are looked for, pixels."""
LEAST_CONTRAST = 0.06
"""Of green, from 0 to 1, from which on there is an edge."""


def _program(name: str, *words: str) -> str:
    """Return a program with ``words`` defined, each maybe with a value."""
    file = Path(__file__).parent / "glsl" / name
    version, rest = file.read_text(encoding="utf-8").split("\n", 1)
    return "\n".join([version, *(f"#define {word}" for word in words), rest])


def sun(bodies: int, still: bool, glossy: bool) -> tuple[str, str]:
    """Programs of vertices and pixels in the light of a sun; ``still``: pipes throw shadows."""
    words = [word for word, wanted in (("STILL", still), ("GLOSSY", glossy)) if wanted]
    vertex = _program("body.vert", f"BODIES {bodies}", "PICTURE", "SUN")
    return vertex, _program("sun.frag", *words)


def lamp(bodies: int) -> tuple[str, str]:
    """Programs of vertices and pixels in the light of a lamp at the eye."""
    vertex = _program("body.vert", f"BODIES {bodies}", "PICTURE", "LAMP")
    return vertex, _program("lamp.frag")


def depth(bodies: int) -> tuple[str, str]:
    """Programs that leave depths only."""
    return _program("body.vert", f"BODIES {bodies}"), _program("nothing.frag")


_BLOCK = f"BLOCK {BLOCK}.0"
EDGES = (_program("screen.vert"), _program("edges.frag", _BLOCK))
"""Programs that find the contrast within each block of pixels and those around it."""
SMOOTH = (
    _program("blocks.vert", _BLOCK),
    _program("smooth.frag", f"LEAST_CONTRAST {LEAST_CONTRAST}"),
)
"""Programs that smooth the stairs of edges in blocks of pixels."""
REDUCE = (_program("screen.vert"), _program("reduce.frag"))
"""Programs that take the mean of each two by two pixels."""
