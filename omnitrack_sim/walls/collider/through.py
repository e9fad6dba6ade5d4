"""What compiled code does with pointers, as plain Python on sequences. ``native`` has an intrinsic
for each of these functions, which takes its place when the collider is compiled."""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from typing import Any, NoReturn

from omnitrack_sim.pipes.compiled import stands_for
from omnitrack_sim.walls.collider.record import WALLS

SCRATCH = 8


@stands_for("scratch")
def scratch() -> list[float]:
    """Room for SCRATCH numbers, on the stack of the calling function in compiled code."""
    return [0.0] * SCRATCH


@stands_for("at")
def at(array: Any, index: int) -> Any:
    """``array`` from ``index`` on."""
    return array[index:]


@stands_for("call_surface")
def call_surface(
    kind: int,
    sizes: Sequence[float],
    x: float,
    y: float,
    z: float,
    out: MutableSequence[float],
) -> float:
    """The ``surface`` of the kind with that number."""
    return WALLS[kind].surface(sizes, x, y, z, out)


@stands_for("call_span")
def call_span(kind: int, *arguments: Any) -> float:
    """The ``span`` of the kind with that number."""
    return WALLS[kind].span(*arguments)


@stands_for("call_clear")
def call_clear(kind: int, *arguments: Any) -> float:
    """The ``clear`` of the kind with that number."""
    return WALLS[kind].clear(*arguments)


def _on_memory(*_: Any) -> NoReturn:
    raise NotImplementedError("reads MuJoCo's structures: compiled only")


@stands_for("word")
def word(index: int) -> int:
    """A word of the block of ``native``."""
    _on_memory(index)


@stands_for("number_at")
def number_at(structure: Any, index: int) -> int:
    """The word of a structure at an index."""
    _on_memory(structure, index)


@stands_for("doubles_of")
def doubles_of(structure: Any, index: int) -> Any:
    """The array of numbers that the word of a structure at an index points to."""
    _on_memory(structure, index)


@stands_for("as_doubles")
def as_doubles(pointer: Any) -> Any:
    """A pointer as one to numbers."""
    _on_memory(pointer)


@stands_for("call_original")
def call_original(model: Any, data: Any, contacts: Any, wall: int, line: int, margin: float) -> int:
    """MuJoCo's own function for this pair of geoms."""
    _on_memory(model, data, contacts, wall, line, margin)
