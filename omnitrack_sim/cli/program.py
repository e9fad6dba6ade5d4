"""The commands, and how errors of theirs end."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import platform
import sys
import warnings
from typing import Annotated, Any

import typer

import omnitrack_sim
from omnitrack_sim.base.errors import Fault, InputError, OmnitrackError
from omnitrack_sim.base.text import clipped
from omnitrack_sim.base.workers import name_glfw_library
from omnitrack_sim.cli import calibrate, networks, package, paper, runs, towns, trials, view
from omnitrack_sim.cli.common import app, err, plain

__all__ = ["app", "calibrate", "networks", "package", "paper", "runs", "towns", "trials", "view"]
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


def run_command() -> None:
    """Run the command of ``sys.argv``; what the user can mend ends with status 2, in words."""
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
        _refuse_surroundings()
        _refuse_empty(sys.argv[1:])
        status = app(standalone_mode=False)
        sys.stdout.flush()  # a full disk shows here
    except OmnitrackError as error:
        _tell(str(error))
        status = 2
    except (KeyboardInterrupt, typer.Abort):
        # 128 plus the number of SIGINT, as shells have it.
        status = 130
    except Exception as error:
        # Typer's errors have no public class in common.
        if _was_interrupted(error):
            status = 130
        elif hasattr(error, "format_message"):
            status = _tell_usage(error)
        elif isinstance(error, OSError) and error.errno in NO_OUTPUT and error.filename is None:
            status = _without_output(error)
        else:
            raise
    sys.exit(status if isinstance(status, int) else 0)


def _was_interrupted(error: BaseException) -> bool:
    """True if an error follows from an interrupt: compiled libraries fail in words of their own."""
    cause = error.__cause__ or error.__context__
    return isinstance(error, KeyboardInterrupt) or (cause is not None and _was_interrupted(cause))


def _refuse_surroundings() -> None:
    """Refuse a working folder that is gone, and a renderer that MuJoCo would not start with.

    Raises:
        InputError: it is so.
    """
    try:
        os.getcwd()
    except OSError as error:
        problem = f"cannot be used ({error.strerror}): change to another one"
        raise InputError(Fault("working folder", problem)) from error
    wanted, system = os.environ.get("MUJOCO_GL", "").lower().strip(), platform.system()
    if wanted not in (*OPENGL, *OPENGL_OF.get(system, ())):
        choices = ("glfw", *OPENGL_OF.get(system, ()), "disable")
        raise InputError(Fault("environment variable MUJOCO_GL", f"is {wanted!r}", choices))


NO_OUTPUT = (errno.ENOSPC, errno.EPIPE, errno.EIO, errno.EBADF)
"""Errors of printing: files are written by ``base.writing``, which has words of its own."""
OPENGL = (
    *("disable", "disabled", "off", "false", "0"),
    *("enable", "enabled", "on", "true", "1", "glfw", ""),
)
"""Values of ``MUJOCO_GL`` that MuJoCo takes on all systems; it fails to be imported with others."""
OPENGL_OF = {"Linux": ("egl", "osmesa", "glx"), "Windows": ("wgl",), "Darwin": ("cgl",)}
"""Further ones, by system."""


def _without_output(error: OSError) -> int:
    """Tell that nothing can be printed, and return the exit status; a closed pipe is no error."""
    # What is left in the buffer has to go somewhere when the process ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return 141  # 128 plus the number of SIGPIPE, as shells have it
    _tell(f"standard output: cannot be written: {error.strerror}")
    return 2


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
