"""The command line. Exit status: 0 it ran, whatever the robot did; 2 bad input or output."""

from __future__ import annotations

import sys

from omnitrack_sim.cli import catalogue, network, optimise, reproduce, runs, singularity, sweep
from omnitrack_sim.cli.common import app, err, plain
from omnitrack_sim.errors import OmnitrackError

__all__ = [
    "app",
    "catalogue",
    "main",
    "network",
    "optimise",
    "reproduce",
    "runs",
    "singularity",
    "sweep",
]


def main() -> None:
    """Entry point: every error that the user can mend ends with status 2 and says what to mend."""
    try:
        app()
    except OmnitrackError as error:
        for line in str(error).splitlines():
            err.print(f"[red]error:[/red] {plain(line)}", soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
