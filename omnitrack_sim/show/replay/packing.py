"""Pack tables of numbers into one short text, which the page unpacks (page/unpack.js)."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

STEPS = 65534
"""Steps between the lowest and the highest number of a column that is rounded to its own range."""


class Pack:
    """Tables are added one by one; where each lies is told by a value that JSON can hold.

    A table is a list of columns of whole numbers. Of each column the differences from row to row
    are kept, as whole numbers without a sign (0, -1, 1, -2 ... as 0, 1, 2, 3 ...), first the low
    bytes of all rows, then the next ones. Neighbouring rows differ little, so most bytes are small
    and alike, and deflate makes little of them.
    """

    def __init__(self) -> None:
        self._data = bytearray()

    def whole(self, values: ArrayLike) -> dict[str, Any]:
        """Add whole numbers (n,) or (n, k) of at most 47 bits."""
        table = np.asarray(values, np.int64)
        table = table.reshape(len(table), -1)
        change = np.diff(table, axis=0, prepend=0)
        coded = np.where(change < 0, -2 * change - 1, 2 * change).T  # (k, n)
        width = max(1, (int(coded.max(initial=0)).bit_length() + 7) // 8)
        place = {"at": len(self._data), "rows": len(table), "columns": table.shape[1]}
        for column in coded:
            octets = np.ascontiguousarray(column, "<i8").view(np.uint8).reshape(-1, 8)
            self._data += octets[:, :width].T.tobytes()
        return place | {"bytes": width}

    def steps(self, values: ArrayLike, step: float) -> dict[str, Any]:
        """Add finite numbers (n,) or (n, k), each rounded to whole ``step``s."""
        return self.whole(np.rint(np.asarray(values, float) / step)) | {"step": step}

    def ranged(self, values: ArrayLike) -> dict[str, Any]:
        """Add numbers (n, ...), each column rounded to 1 / ``STEPS`` of its range. What is not
        finite stays a gap."""
        table = np.asarray(values, float).reshape(len(np.asarray(values)), -1)
        there = np.isfinite(table)
        least = np.where(there, table, np.inf).min(axis=0, initial=np.inf)
        most = np.where(there, table, -np.inf).max(axis=0, initial=-np.inf)
        low, high = (np.where(np.isfinite(bound), bound, 0.0) for bound in (least, most))
        step = np.where(high > low, (high - low) / STEPS, 1.0)
        rounded = np.rint(np.where(there, table - low, 0.0) / step)
        place = self.whole(np.where(there, rounded, STEPS + 1))
        return place | {"low": low.tolist(), "steps": step.tolist(), "gap": STEPS + 1}

    def text(self) -> str:
        """All tables, deflated, in base64."""
        return base64.b64encode(zlib.compress(bytes(self._data), 9)).decode("ascii")


def rounded(values: ArrayLike, digits: int) -> Any:
    """Numbers as lists for JSON, with so many digits after the point."""
    return (np.round(np.asarray(values, float), digits) + 0.0).tolist()  # 0.0, not -0.0
