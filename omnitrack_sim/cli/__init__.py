"""The command line.

Exit status: 0 it ran, whatever the robot did; 2 bad input or output; 1 where a check differs:
`models --check`, or a verdict of `reproduce`; 130 where it is interrupted.
"""

from __future__ import annotations

import os
import signal

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"program": ["app"]})


def main() -> None:
    """Entry point, which ends quietly when it is interrupted before anything has begun."""
    own = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if own:  # importing the commands takes a tenth of a second
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    from omnitrack_sim.cli.program import run_command

    try:
        if own:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run_command()
    except KeyboardInterrupt:
        os._exit(130)
