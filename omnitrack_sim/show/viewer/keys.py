"""Which key does what, in each of the three windows. Pure: no window is needed here.

MuJoCo's window takes letters, digits, ``[ ] , / ; ' ` \\``, Tab, Escape and F1 to F7 for itself,
and passes every key on besides; all others are free in its passive mode. It tells presses and
repeats and never that a key is let go. So no key acts for as long as it is held: each press
changes something by a step, and one key stops everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from typing import NamedTuple


class Do(Enum):
    """Actions that a key can ask for."""

    PAUSE = auto()
    STEP = auto()
    STEP_BACK = auto()
    LEAP = auto()
    LEAP_BACK = auto()
    TO_START = auto()
    TO_END = auto()
    RESET = auto()
    TIME_FASTER = auto()
    TIME_SLOWER = auto()
    FORWARD = auto()
    BACK = auto()
    LEFT = auto()
    RIGHT = auto()
    AWAY = auto()
    TOWARDS = auto()
    STRAIGHT = auto()
    ROLL_ON = auto()
    ROLL_BACK = auto()
    STOP = auto()
    HAND_OVER = auto()
    FINISH = auto()
    HELP = auto()


class Key(NamedTuple):
    """A key of the window.

    Attributes:
        name: as it is told to users.
        codes: GLFW's numbers of the keys that do it.
        do: what it asks for.
        meaning: the same in words.
    """

    name: str
    codes: tuple[int, ...]
    do: Do
    meaning: str


SPACE, PERIOD, MINUS, EQUAL = 32, 46, 45, 61
ENTER, BACKSPACE, INSERT, DELETE = 257, 259, 260, 261
RIGHT, LEFT, DOWN, UP, PAGE_UP, PAGE_DOWN, HOME, END = range(262, 270)
KEYPAD_MINUS, KEYPAD_PLUS, KEYPAD_ENTER = 333, 334, 335

_TIME = (
    Key("+  -", (EQUAL, KEYPAD_PLUS), Do.TIME_FASTER, "time runs faster, slower"),
    Key("", (MINUS, KEYPAD_MINUS), Do.TIME_SLOWER, ""),
)
_HELP = Key("Period", (PERIOD,), Do.HELP, "show or hide the keys")
VIEW = (
    Key("Space", (SPACE,), Do.PAUSE, "pause, go on"),
    Key("Right", (RIGHT,), Do.STEP, "one control step"),
    *_TIME,
    Key("Home", (HOME,), Do.RESET, "from the start again"),
    _HELP,
)
"""Of a scenario that runs under its controller."""
REPLAY = (
    Key("Space", (SPACE,), Do.PAUSE, "pause, go on"),
    Key("Right  Left", (RIGHT,), Do.STEP, "a sample on, back"),
    Key("", (LEFT,), Do.STEP_BACK, ""),
    Key("PgUp  PgDn", (PAGE_UP,), Do.LEAP, "a second on, back"),
    Key("", (PAGE_DOWN,), Do.LEAP_BACK, ""),
    Key("Home  End", (HOME,), Do.TO_START, "to the start, to the end"),
    Key("", (END,), Do.TO_END, ""),
    *_TIME,
    _HELP,
)
"""Of a saved run."""
DRIVE = (
    Key("Up  Down", (UP,), Do.FORWARD, "faster forward, backward"),
    Key("", (DOWN,), Do.BACK, ""),
    Key("Left  Right", (LEFT,), Do.LEFT, "turn the nose left, right in the picture"),
    Key("", (RIGHT,), Do.RIGHT, ""),
    Key("Home  End", (HOME,), Do.AWAY, "turn it away from you, towards you"),
    Key("", (END,), Do.TOWARDS, ""),
    Key("Backspace", (BACKSPACE,), Do.STRAIGHT, "steer no more"),
    Key("PgUp  PgDn", (PAGE_UP,), Do.ROLL_ON, "roll the modules on, back"),
    Key("", (PAGE_DOWN,), Do.ROLL_BACK, ""),
    Key("Space", (SPACE,), Do.STOP, "stop, and take over from the controller"),
    Key("Enter", (ENTER, KEYPAD_ENTER), Do.HAND_OVER, "hand over to the controller"),
    Key("Insert", (INSERT,), Do.PAUSE, "pause, go on"),
    *_TIME,
    Key("Delete", (DELETE,), Do.FINISH, "end the run, save, close"),
    _HELP,
)
"""Of a robot that is driven by keyboard."""


def action_of(keys: Sequence[Key], code: int) -> Do | None:
    """The action of the key with GLFW's number ``code``; None where it has none."""
    return next((key.do for key in keys if code in key.codes), None)


def help_lines(keys: Sequence[Key]) -> list[tuple[str, str]]:
    """Names of the keys and what they do, a line for each or for a pair that belongs together."""
    return [(key.name, key.meaning) for key in keys if key.name]
