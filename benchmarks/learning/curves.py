"""How a training went, as a table and a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from omnitrack_sim.base.writing import write_file

COLUMNS = (
    "minutes",
    "decisions",
    "episodes",
    "return_mean",
    "success",
    "duration_s",
    "std",
    "kl",
    "validation_return",
    "validation_success",
    "validation_duration_s",
)
"""Of the table; validation columns are empty in rows without one."""


def write(folder: Path, rows: Sequence[dict[str, Any]], title: str) -> None:
    """Write curves.csv and curves.png."""
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_file(folder / "curves.csv", text.getvalue().encode())
    write_file(folder / "curves.png", _picture(rows, title))


def _picture(rows: Sequence[dict[str, Any]], title: str) -> bytes:
    kinds = (("success", "episodes passed, %", 100.0), ("return", "return", 1.0))
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
    for axis, (kind, label, factor) in zip(axes, kinds, strict=True):
        trained = [(row["decisions"] / 1e6, row.get(_trained(kind))) for row in rows]
        tried = [(row["decisions"] / 1e6, row.get(f"validation_{kind}")) for row in rows]
        for points, style in (
            (trained, {"lw": 1, "alpha": 0.6}),
            (tried, {"marker": "o", "ms": 3}),
        ):
            known = [(x, factor * y) for x, y in points if y is not None]
            axis.plot([x for x, _ in known], [y for _, y in known], **style)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_ylim(-3, 103)
    axes[0].set_title(title)
    axes[0].legend(["training, actions tried", "validation, best actions"], loc="lower right")
    axes[1].set_xlabel("decisions of all robots, millions")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    plt.close(figure)
    return buffer.getvalue()


def _trained(kind: str) -> str:
    return "return_mean" if kind == "return" else kind
