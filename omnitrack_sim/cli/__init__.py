"""The command line.

Exit status: 0 it ran, whatever the robot did; 2 bad input or output; 1 where a check differs:
`models --check`, or a verdict of `reproduce`.
"""

from __future__ import annotations

import atexit
import gc
import sys
import warnings
from typing import Annotated, Any

import typer

import omnitrack_sim
from omnitrack_sim.base.errors import Fault, InputError, OmnitrackError
from omnitrack_sim.base.text import clipped
from omnitrack_sim.base.workers import name_glfw_library
from omnitrack_sim.cli import networks, package, paper, runs, towns, trials, view
from omnitrack_sim.cli.common import app, err, plain

__all__ = ["app", "main", "networks", "package", "paper", "runs", "towns", "trials", "view"]
_LONGEST = 4000
"""Characters of a line of a message; a list of faults bounds its lines itself."""


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"omnitrack_sim {omnitrack_sim.__version__}")
        raise typer.Exit()


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_tell_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Options of the command line as a whole."""


def _show(message: Warning | str, *_: object) -> None:
    """Print a warning as the commands print everything, without the line of code it came from."""
    for line in str(message).splitlines():
        err.say(f"[yellow]warning:[/yellow] {plain(line)}")


def main() -> None:
    """Entry point: every error that the user can mend ends with status 2 and says what to mend."""
    # Importing makes a quarter of a million objects that stay: by default garbage is looked for
    # among them 400 times, and once more when the process ends. Both take a sixth of a short run;
    # below this limit a run of a tee with its pictures looks for none.
    gc.set_threshold(400_000, 10, 10)
    atexit.register(gc.freeze)
    # Before anything is loaded that may warn.
    warnings.showwarning = _show
    name_glfw_library()
    for stream in (sys.stdout, sys.stderr):
        # A terminal that lacks a character gets its code, not a traceback.
        getattr(stream, "reconfigure", lambda **_: None)(errors="backslashreplace")
    try:
        _refuse_empty(sys.argv[1:])
        status = app(standalone_mode=False)
    except OmnitrackError as error:
        _tell(str(error))
        status = 2
    except (KeyboardInterrupt, typer.Abort):
        # 128 plus the number of SIGINT, as shells have it.
        status = 130
    except Exception as error:
        # Typer's errors have no public class in common.
        if not hasattr(error, "format_message"):
            raise
        status = _tell_usage(error)
    sys.exit(status if isinstance(status, int) else 0)


def _refuse_empty(arguments: list[str]) -> None:
    """Refuse arguments that are empty texts, as of a variable that is not set.

    A path would be the working folder.
    """
    for before, text in zip(["", *arguments], arguments, strict=False):
        if text == "" or (text.startswith("--") and text.endswith("=")):
            where = text.rstrip("=") or (before if before.startswith("-") else "an argument")
            raise InputError(Fault(where, "is empty"))


def _tell(message: str) -> None:
    for line in message.splitlines():
        err.say(f"[red]error:[/red] {plain(clipped(line, _LONGEST))}")


def _tell_usage(error: Any) -> int:
    """Print what is wrong with the options, clipped, and return the exit status.

    Typer would not clip it.
    """
    if type(error).__name__ != "NoArgsIsHelpError":  # which has printed the help already
        _tell(error.format_message())
        if error.ctx is not None:
            err.say(f"`{error.ctx.command_path} --help` lists the options")
    return error.exit_code
