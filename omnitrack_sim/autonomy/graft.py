"""Rows of arrays from one batch of robots into another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def graft(into: object, fresh: object, robots: NDArray[np.intp], n: int) -> None:
    """Put what ``fresh`` holds of k robots in the place of what ``into``, an object of the same
    class, holds of ``robots`` (k,), which ascend, of its ``n``.

    What belongs to robots are the arrays whose first axis counts them. An array that belongs to
    none has one length in both: it is left out, or, where all n begin anew, the same.
    """
    for name, new in vars(fresh).items():
        old = vars(into).get(name)
        if not (isinstance(old, np.ndarray) and isinstance(new, np.ndarray)):
            continue
        if len(old) == n and len(new) == len(robots):
            grafted = old.copy()
            grafted[robots] = new
            setattr(into, name, grafted)
