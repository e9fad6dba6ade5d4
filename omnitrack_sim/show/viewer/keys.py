"""Keys of each of the three windows. Pure: no window is needed here.

MuJoCo's window takes letters, digits, brackets, comma, slash, semicolon, quotes, backslash, Tab,
Escape and F1 to F7 for itself, and passes every key on besides; all others are free in its passive
mode. It tells presses and repeats and never that a key is let go. So no key acts for as long as it
is held: each press changes something by a step, and one key stops everything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    """A key of the window, or two that belong together.

    Attributes:
        name: for users; of two keys both names.
        meaning: what it does, or they do, in words.
        actions: what is asked for, by GLFW's numbers of the keys.
    """

    name: str
    meaning: str
    actions: Mapping[int, Do]


SPACE, PERIOD, MINUS, EQUAL = 32, 46, 45, 61
ENTER, BACKSPACE, INSERT, DELETE = 257, 259, 260, 261
RIGHT, LEFT, DOWN, UP, PAGE_UP, PAGE_DOWN, HOME, END = range(262, 270)
KEYPAD_MINUS, KEYPAD_PLUS, KEYPAD_ENTER = 333, 334, 335

_FASTER: dict[int, Do] = dict.fromkeys((EQUAL, KEYPAD_PLUS), Do.TIME_FASTER)
_SLOWER: dict[int, Do] = dict.fromkeys((MINUS, KEYPAD_MINUS), Do.TIME_SLOWER)
_TIME = Key("+  -", "time runs faster, slower", _FASTER | _SLOWER)
_HELP = Key("Period", "show or hide the keys", {PERIOD: Do.HELP})
VIEW = (
    Key("Space", "pause, go on", {SPACE: Do.PAUSE}),
    Key("Right", "one control step", {RIGHT: Do.STEP}),
    _TIME,
    Key("Home", "from the start again", {HOME: Do.RESET}),
    _HELP,
)
"""Keys of a scenario that runs under its controller."""
REPLAY = (
    Key("Space", "pause, go on", {SPACE: Do.PAUSE}),
    Key("Right  Left", "a sample on, back", {RIGHT: Do.STEP, LEFT: Do.STEP_BACK}),
    Key("PgUp  PgDn", "a second on, back", {PAGE_UP: Do.LEAP, PAGE_DOWN: Do.LEAP_BACK}),
    Key("Home  End", "to the start, to the end", {HOME: Do.TO_START, END: Do.TO_END}),
    _TIME,
    _HELP,
)
"""Keys of a saved run."""
DRIVE = (
    Key("Up  Down", "faster forward, backward", {UP: Do.FORWARD, DOWN: Do.BACK}),
    Key(
        "Left  Right", "turn the nose left, right in the picture", {LEFT: Do.LEFT, RIGHT: Do.RIGHT}
    ),
    Key("Home  End", "turn it away from you, towards you", {HOME: Do.AWAY, END: Do.TOWARDS}),
    Key("Backspace", "steer no more", {BACKSPACE: Do.STRAIGHT}),
    Key("PgUp  PgDn", "roll the modules on, back", {PAGE_UP: Do.ROLL_ON, PAGE_DOWN: Do.ROLL_BACK}),
    Key("Space", "stop, and take over from the controller", {SPACE: Do.STOP}),
    Key("Enter", "hand over to the controller", dict.fromkeys((ENTER, KEYPAD_ENTER), Do.HAND_OVER)),
    Key("Insert", "pause, go on", {INSERT: Do.PAUSE}),
    _TIME,
    Key("Delete", "end the run, save, close", {DELETE: Do.FINISH}),
    _HELP,
)
"""Keys of a robot that is driven by keyboard."""


def action_of(keys: Sequence[Key], code: int) -> Do | None:
    """Return the action of the key with GLFW's number ``code``; None where it has none."""
    return next((key.actions[code] for key in keys if code in key.actions), None)


def help_lines(keys: Sequence[Key]) -> list[tuple[str, str]]:
    """Return the names of the keys and what they do, a line for each."""
    return [(key.name, key.meaning) for key in keys]
