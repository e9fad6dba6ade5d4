"""Progress in lines, where standard error is no terminal but a file, a pipe or the log of a job."""

from __future__ import annotations

import time

from rich.console import Console

from omnitrack_sim.base.text import printable

WAIT = 10.0
"""Between two lines at least, and before the first one, s: what is over sooner tells nothing."""
STEP, LONGEST = 0.1, 300.0
"""A line is due when so much of the work is done since the last one, or so many seconds ago."""


class Lines:
    """Tells how far something is, in a line now and then.

    Args:
        title: stands before every line.
        console: that prints them.
    """

    def __init__(self, title: str, console: Console) -> None:
        self.title, self.console = title, console
        self.began = self._told_at = time.monotonic()
        self._told = 0.0
        self._first = True
        self.told_any = False

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.began

    def tell(self, part: float, words: str) -> None:
        """Tell ``words`` if a line is due when this part of the work, 0 to 1, is done. The end is
        told by ``end``."""
        since = time.monotonic() - self._told_at
        far = abs(part - self._told) >= STEP  # the check of a study begins anew at 0
        if part < 1 and since >= WAIT and (self._first or far or since >= LONGEST):
            self._told, self._first = part, False
            self.say(words)

    def end(self) -> None:
        """Tell how long the work took, if anything was told of it."""
        if self.told_any:
            self.say(f"done in {clock(self.elapsed)}")

    def say(self, words: str) -> None:
        """Tell ``words`` at once."""
        self.told_any = True
        self._told_at = time.monotonic()
        self.console.print(printable(f"{self.title}: {words}"), markup=False, soft_wrap=True)


def clock(seconds: float) -> str:
    """Seconds as hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def time_left(part: float, elapsed: float) -> str:
    """The time that the rest takes at the pace so far; empty before there is a pace."""
    return f"{clock(elapsed * (1 - part) / part)} left" if part > 0 else ""
