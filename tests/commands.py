"""Commands of ``omnitrack``, run in the process of the tests: without the second of a new one."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from subprocess import CompletedProcess
from unittest import mock

from omnitrack_sim import cli


def omnitrack(*arguments: str, cwd: Path | None = None) -> CompletedProcess[str]:
    """Run a command as the entry point does; whatever it does not tell as a fault is raised."""
    stdout, stderr = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd or Path.cwd()),
        mock.patch.object(sys, "argv", ["omnitrack", *arguments]),
        # Of what runs the tests; the command's name in messages would be made of it.
        mock.patch.object(sys.modules["__main__"], "__package__", None),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
    ):
        try:
            cli.main()
        except SystemExit as ended:
            status = ended.code
    assert isinstance(status, int)
    return CompletedProcess(arguments, status, stdout.getvalue(), stderr.getvalue())
