"""A screen of its own for tests of windows, and the keys that are pressed on it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import pytest

NEEDED = ("Xvfb", "xdotool")
MISSING = [name for name in NEEDED if shutil.which(name) is None] + [
    name for name in ("glfw",) if find_spec(name) is None
]
needs_screen = pytest.mark.skipif(
    bool(MISSING),
    reason=f"windows are tested with {', '.join(NEEDED)} and glfw; not here: {MISSING}",
)
PATIENCE = 120.0
"""Longest wait for one thing that a test waits for, s: a machine may be busy."""
TOOLS = f'''
import os, subprocess, sys, threading, time, traceback

def wait(holds, what):
    """Until a condition holds; a test that waits in vain ends here and says for what."""
    end = time.monotonic() + {PATIENCE}
    while not holds():
        if time.monotonic() > end:
            print(f"waited in vain: {{what}}", file=sys.stderr, flush=True)
            os._exit(3)
        time.sleep(0.02)

def press(*keys):
    """Send keys to the window as a keyboard does."""
    subprocess.run(["xdotool", "key", "--delay", "30", *keys], check=True)

def focus():
    """Give the window the keyboard, which no window manager does here."""
    find = ["xdotool", "search", "--onlyvisible", "--name", "omnitrack_sim"]
    found = lambda: subprocess.run(find, capture_output=True, text=True).stdout.split()
    wait(found, "the window")
    subprocess.run(["xdotool", "windowfocus", "--sync", found()[0]], check=True)

def user(kind):
    """Let ``act`` sit before the window of a class of the viewer, in a thread of its own."""
    from omnitrack_sim.show.viewer import driver, player
    player = driver if kind == "Driver" else player
    class Watched(getattr(player, kind)):
        def play(self):
            threading.Thread(target=self.sit, daemon=True).start()
            super().play()
        def sit(self):
            try:
                focus(), act(self)
            except Exception:  # a script with a mistake ends the test, and not its patience
                traceback.print_exc()
                os._exit(4)
    setattr(player, kind, Watched)
'''
"""What the script of a user in front of a window has at hand; see ``at_window``."""


@contextmanager
def screen(size: str = "480x360") -> Iterator[str]:
    """A virtual screen on a free display, small because it is drawn without a graphics card."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{size}x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()
        if not number:
            pytest.skip("Xvfb finds no free display here")
        yield f":{number}"
    finally:
        server.terminate()
        with suppress(subprocess.TimeoutExpired):
            server.wait(10)


def at_window(
    display: str, kind: str, script: str, *arguments: str, folder: Path
) -> subprocess.CompletedProcess[str]:
    """Run the command line on a screen with a user before its window.

    Args:
        display: of the screen.
        kind: the class of ``viewer.player`` that the command opens.
        script: body of ``act(it)``, with ``it`` of that class; it may use ``wait`` and ``press``.
        arguments: of ``omnitrack``.
        folder: where it runs.
    """
    act = "def act(it):\n" + textwrap.indent(textwrap.dedent(script), "    ")
    code = f"{TOOLS}\n{act}\nuser({kind!r})\nfrom omnitrack_sim.cli import main\nmain()\n"
    environment = {**os.environ, "DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1"}
    environment.pop("WAYLAND_DISPLAY", None)
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=folder, timeout=4 * PATIENCE
    )
