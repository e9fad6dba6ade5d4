"""The command line. Exit status: 0 it ran, whatever the robot did; 2 bad input or output."""

from __future__ import annotations

import sys
import warnings

from omnitrack_sim.cli import catalogue, network, reproduce, runs, singularity, sweep
from omnitrack_sim.cli.common import app, err, plain
from omnitrack_sim.errors import OmnitrackError

__all__ = ["app", "catalogue", "main", "network", "reproduce", "runs", "singularity", "sweep"]


def _show(message: Warning | str, *_: object) -> None:
    """Print a warning as the commands print everything, without the line of code it came from."""
    for line in str(message).splitlines():
        err.print(f"[yellow]warning:[/yellow] {plain(line)}", soft_wrap=True)


def main() -> None:
    """Entry point: every error that the user can mend ends with status 2 and says what to mend."""
    warnings.showwarning = _show
    try:
        app()
    except OmnitrackError as error:
        for line in str(error).splitlines():
            err.print(f"[red]error:[/red] {plain(line)}", soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
