"""Parts that commands share: application, consoles, scenarios from arguments, progress."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text
from typer.core import TyperGroup

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError, gathered
from omnitrack_sim.base.text import printable, strict_json
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.word_table import WordTable


class _Commands(TyperGroup):
    """The commands, each of which says so when it is interrupted; Typer is silent."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            err.print("interrupted")
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Simulate in-pipe robots: run, compare, film and measure them.",
)
_Loaded = TypeVar("_Loaded")
WAIT = 5.0
"""Least time before the first line and between two lines, s: shorter work prints nothing."""
STEP, LONGEST = 0.1, 300.0
"""Part of the work, and time in s, after which the next line is due."""
LEAST_PART = 0.05
"""Part of the work after which its pace is known. Time before a first part that is smaller went
into compilation, and says nothing of the pace."""


class Screen(Console):
    """A console that escapes control characters, which names from users may contain.

    Only line feeds and colours of the messages reach the terminal.
    """

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text with its control characters escaped, as rich renders it."""
        return super().render_str("\n".join(map(printable, text.split("\n"))), **options)

    def say(self, text: str) -> None:
        """Print a text whose lines the terminal breaks, not this console."""
        self.print(text, soft_wrap=True)


out = Screen(highlight=False, emoji=False)
err = Screen(stderr=True, highlight=False, emoji=False)


def plain(text: str) -> str:
    """Escape control and markup characters, so that ``text`` is printed literally in one line."""
    return escape(printable(text))


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str | Text]]) -> None:
    """Print a table without lines; its texts as they are, but for those with a style."""
    table = WordTable(*heads)
    for row in rows:
        table.add_row(*(plain(cell) if isinstance(cell, str) else cell for cell in row))
    out.print(table)


def print_json(value: Any) -> None:
    """Print JSON for machines, and nothing in it that is none."""
    print(strict_json(value))


def print_saved(path: Path) -> None:
    """Print where something was saved."""
    out.say(f"saved {plain(str(path))}")


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A scenario file (TOML, or the scenario.json of a run), the name of a shipped one, or "
        "a robot's MJCF or URDF file: it is put into a straight pipe of its size.",
        autocompletion=complete.scenarios,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
NetworkArgument = typer.Argument(
    metavar="NETWORK",
    help="A network file, or the name of a shipped one.",
    autocompletion=complete.networks,
)
PlotOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write a figure: png, svg or pdf.")
]
CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Draw each trial's robot from the doubt of a calibration, which `omnitrack "
        "calibrate` wrote.",
    ),
]
FolderOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder of the results; one below out/ by default."),
]
TrustOption = Annotated[
    bool,
    typer.Option(
        "--trust",
        help="Import the code that the file names, and read its robot's own file, as a run does.",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a value, such as control.cruise_speed=0.12; @FILE overrides many.",
        autocompletion=complete.settings,
    ),
]


def load(source: str, assignments: Sequence[str] | None) -> ot.Scenario:
    """Load the scenario of a file or name, with the values of ``--set``.

    A model of a robot is taken in a straight pipe of its size.
    """
    return with_changes(lambda changes: _loaded(source, changes), assignments)


def _loaded(source: str, changes: Mapping[str, Any]) -> ot.Scenario:
    from omnitrack_sim.robots.kinds import is_model_file

    if is_model_file(source):
        from omnitrack_sim.sim.model_template import model_scenario

        return model_scenario(source, changes)
    return ot.load_scenario(source, changes)


def with_changes(
    load: Callable[[dict[str, Any]], _Loaded], assignments: Sequence[str] | None
) -> _Loaded:
    """Call ``load`` with the changes by path that ``--set`` asks for.

    Raises:
        InputError: every fault that ``load`` finds, and every text that is no assignment.
    """
    changes: dict[str, Any] = {}
    faults: list[Fault] = []
    for text in assignments or ():
        with gathered(faults):
            # Later ones win, as options of a command line do.
            changes |= settings_of(text)
    try:
        loaded = load(changes)
    except InputError as error:
        # Faults of the options and of the file are told together, by the error of the file's kind.
        raise type(error)([*faults, *error.faults]) from None
    if faults:
        raise InputError(faults)
    return loaded


def settings_of(text: str) -> dict[str, Any]:
    """Parse one ``--set`` into values by path: PATH=VALUE, or @FILE with many of them."""
    if text.startswith("@"):
        return _settings_in(Path(text[1:]), f"--set {text}")
    path, value = assignment(text)
    return {path: value}


def _settings_in(file: Path, where: str) -> dict[str, Any]:
    """The values in a file by path, such as a study's ``best.toml``: ``"a.b" = 1``, or tables."""
    from omnitrack_sim.base.reading import CALIBRATION, refuse_missing, table_of

    refuse_missing(file, where)
    try:
        table = table_of(file, "file of values", InputError)
        return dict(_leaves({k: v for k, v in table.items() if k != CALIBRATION}, ""))
    except InputError as error:
        raise InputError([fault.at(where) for fault in error.faults]) from None


def _leaves(table: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    """The values in a table and the tables in it, by dotted path."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def assignment(text: str) -> tuple[str, Any]:
    """Parse PATH=VALUE. The value is read as TOML, a bare word as a string."""
    from omnitrack_sim.base.reading import parsed

    path, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not path:
        raise InputError(
            Fault(f"--set {text}", "is not PATH=VALUE, such as control.cruise_speed=0.12")
        )
    try:
        table = parsed(f"value = {value}", "TOML")
    except ValueError as reason:
        if not isinstance(reason.__cause__, tomllib.TOMLDecodeError):
            raise InputError(Fault(f"--set {path}", str(reason))) from reason
        return path, value
    # Of a text of several lines, further ones could be read as further keys.
    return path, table["value"] if len(table) == 1 else value


@contextmanager
def progress(title: str, quiet: bool = False) -> Iterator[Any]:
    """Show progress on standard error: a bar, or occasional lines where that is no terminal.

    Yields the function to call with the fraction done and a text; None if ``quiet``. The text at
    fraction 0 states the amount of work.
    """
    if quiet:
        yield None
        return
    if not err.is_terminal:
        lines = _Lines(title)
        yield lines.report
        lines.end()
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    # On standard error, since standard output may be JSON for another program.
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(plain(title), total=1.0)
        yield lambda part, text="": bar.update(
            task, completed=part, description=plain(f"{title} {text}".strip())
        )


class _Lines:
    """Progress in occasional lines, each of which begins with a title."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._began = self._told_at = time.monotonic()
        self._told: float | None = None  # part of the work at the last line, none before the first
        self._told_any = False
        self._origin: tuple[float, float] | None = None  # s and part, when the work first moved on

    def report(self, part: float, text: str = "") -> None:
        """Tell part and text where a line is due, and the text at once as the work begins."""
        # The amount of work is worth a line of its own, and comes before there is any pace.
        if part == 0 and text and not self._told_any:
            self._say(text)
        if part and self._origin is None:
            small = part < LEAST_PART
            self._origin = (time.monotonic(), part) if small else (self._began, 0.0)
        since = time.monotonic() - self._told_at
        due = self._told is None or part - self._told >= STEP or since >= LONGEST
        # Logs of long runs stay short: a line a tenth of the work, or every five minutes.
        if part < 1 and since >= WAIT and due:
            self._told = part
            self._say(", ".join(filter(None, (f"{100 * part:.0f} %", text, self._left(part)))))

    def _left(self, part: float) -> str:
        """Time that is left, by the pace since the work first moved on; "" before it is known."""
        began, first = self._origin or (0.0, part)
        if part - first < LEAST_PART:
            return ""
        return f"{clock((time.monotonic() - began) / (part - first) * (1 - part))} left"

    def end(self) -> None:
        """Print how long the work took, if any line was printed."""
        if self._told_any:
            self._say(f"done in {clock(time.monotonic() - self._began)}")

    def _say(self, words: str) -> None:
        self._told_any, self._told_at = True, time.monotonic()
        err.print(printable(f"{self._title}: {words}"), markup=False, soft_wrap=True)


def clock(seconds: float) -> str:
    """Seconds as hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"
