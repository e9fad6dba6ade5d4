"""From rows to the best settings of each peer, the ratios, the tables and the plot."""

from __future__ import annotations

import math
from pathlib import Path

from entries import OWN, TITLES
from measure import Row

ERROR_STEP_MM = 0.05
"""Wall errors that differ by less than this count as the same when the best settings are chosen."""
ZERO_ERROR_MM = 1e-3
"""Where the plot shows walls without error."""


def best(rows: list[Row]) -> Row:
    """The best setting of a peer on one job: it finishes, then wall error, then speed."""

    def rank(row: Row) -> tuple[bool, bool, float, float]:
        error = row.wall_error_max_mm
        steps = math.inf if math.isnan(error) else math.ceil(error / ERROR_STEP_MM - 1e-9)
        speed = 0.0 if math.isnan(row.step_speed) else row.step_speed
        return (row.error is not None, not row.finishes, steps, -speed)

    return min(rows, key=rank)


def rival(peer: Row, rows: list[Row]) -> Row | None:
    """This package's fastest entry that does the same job as well.

    It finishes at the peer's time step, with at most its wall error.
    """
    own = [
        row
        for row in rows
        if row.peer in OWN
        and row.job == peer.job
        and row.finishes
        and row.timestep == peer.timestep
        and row.wall_error_max_mm <= peer.wall_error_max_mm
    ]
    return max(own, key=lambda row: row.step_speed, default=None)


def ratio(peer: Row, rows: list[Row]) -> float:
    """How many times as fast the ``rival`` steps; not a number where there is none."""
    other = rival(peer, rows)
    return math.nan if other is None else other.step_speed / peer.step_speed


def settings_text(row: Row) -> str:
    """The settings in one line."""
    return ", ".join(
        f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in row.settings.items()
        if value is not None
    )


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def tables(rows: list[Row], tried: list[Row], notes: list[str]) -> str:
    """Markdown: a table a job, the settings tried, and notes."""
    lines = []
    head = (
        "entry",
        "settings",
        "step, ms",
        "wall error, largest / 99 %, mm",
        "simulated s per CPU s: stepping / with control",
        "build, s",
        "ratio",
    )
    for job in dict.fromkeys(row.job for row in rows):
        lines += [f"## {job}", "", "| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        lines += [_line(row, rows) for row in rows if row.job == job]
        lines.append("")
    lines += [
        "## Settings tried",
        "",
        "| entry | job | settings | outcome | wall error, mm | speed | elements |",
    ]
    lines += ["|---" * 7 + "|"]
    for row in tried:
        told = row.outcome if row.error is None else row.error
        errors = _number(row.wall_error_max_mm, 3)
        speed, elements = (
            _number(row.step_speed, 2),
            row.elements if row.elements is not None else "-",
        )
        lines.append(
            f"| {row.peer} | {row.job} | {settings_text(row)} | {told} | {errors} | {speed} | "
            f"{elements} |"
        )
    lines += ["", *(f"* {note}" for note in notes)]
    return "\n".join(lines).rstrip() + "\n"


def _line(row: Row, rows: list[Row]) -> str:
    result = row.error or ("" if row.finishes else f"{row.outcome} at {row.progress_m:.2f} m")
    settings = ", ".join(
        f"{key.removesuffix('_mm').replace('_', ' ')} {value:g}{' mm' * key.endswith('_mm')}"
        for key, value in row.settings.items()
        if isinstance(value, int | float) and not (isinstance(value, bool) or "step" in key)
    )
    cells = (
        f"{TITLES[row.peer]}: {result}" if result else TITLES[row.peer],
        settings or "-",
        f"{1e3 * row.timestep:g}",
        f"{_number(row.wall_error_max_mm, 3)} / {_number(row.wall_error_99_mm, 3)}",
        f"{_number(row.step_speed, 2)} / {_number(row.speed, 2)}",
        _number(row.build_s, 2),
        "-" if row.peer in OWN else _number(ratio(row, rows), 1),
    )
    return "| " + " | ".join(cells) + " |"


def plot(rows: list[Row], job: str, path: Path) -> None:
    """Speed against wall error on one job; filled markers finish it, crosses do not."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context({"svg.hashsalt": "compare", "svg.fonttype": "none", "font.size": 9}):
        figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
        for index, peer in enumerate(TITLES):
            chosen = [r for r in rows if r.peer == peer and r.job == job and r.error is None]
            label: str | None = TITLES[peer]
            for row in chosen:
                axes.plot(
                    max(row.wall_error_max_mm, ZERO_ERROR_MM),
                    row.step_speed,
                    "o" if row.finishes else "X",
                    color=f"C{index}",
                    label=label,
                )
                label = None
                axes.annotate(
                    f"{1000 * row.timestep:g} "
                    "ms", (max(row.wall_error_max_mm, ZERO_ERROR_MM), row.step_speed),
                    textcoords="offset points", xytext=(5, 3), fontsize=7,
                )  # fmt: skip
        axes.set(
            xscale="log",
            yscale="log",
            xlabel=f"largest wall error, mm ({ZERO_ERROR_MM:g} mm: none)",
        )
        axes.set_ylabel("simulated s a CPU s, stepping")
        axes.set_title(f"{job}: discs finish, crosses do not")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
