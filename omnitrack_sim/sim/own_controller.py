"""Errors of a user's own controller, told with the step and the user's own line."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from omnitrack_sim.base.errors import ControllerError, OmnitrackError

PACKAGE = __name__.partition(".")[0]


@contextmanager
def own_errors(controller: type, when: Callable[[], str]) -> Iterator[None]:
    """Raise what a user's own controller raises as a ``ControllerError``.

    Errors of the package's own controllers, and those that the user can mend as they are, pass.

    Args:
        controller: the class.
        when: tells the step at hand, for the message.

    Raises:
        ControllerError: what the controller raised is its cause.
    """
    try:
        yield
    except OmnitrackError:
        raise
    except Exception as error:
        module = controller.__module__
        if module.partition(".")[0] == PACKAGE:
            raise
        place = _own_line(error.__traceback__, module)
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        name = f"{module}:{controller.__qualname__}"
        raise ControllerError(f"{name}, {when()}: {problem}{place}") from error


def _own_line(trace: TracebackType | None, module: str) -> str:
    """Return the deepest line of a traceback in a module, in brackets; "" where there is none."""
    frames = zip(traceback.walk_tb(trace), traceback.extract_tb(trace), strict=True)
    places = [line for (frame, _), line in frames if frame.f_globals.get("__name__") == module]
    if not places:
        return ""
    last = places[-1]
    return f" ({Path(last.filename).name}:{last.lineno}, in {last.name}: {last.line})"
