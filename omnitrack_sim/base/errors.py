"""Typed errors. Each names the place of the fault and the valid choices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

from omnitrack_sim.base.text import clipped, did_you_mean, listed, printable

MOST_TOLD = 30
"""How many faults a message tells; of further ones it tells the number."""
_LONGEST_PLACE, _LONGEST_PROBLEM = 200, 600


@dataclass(frozen=True)
class Fault:
    """One thing wrong with the input: where it stands, what is wrong, what would be right.

    Attributes:
        where: dotted path, option or file.
        problem: what is wrong there.
        choices: everything that would be right, where that can be listed.
        given: the word in whose place one of the choices belongs; the nearest of them is asked
            back.
    """

    where: str
    problem: str
    choices: tuple[str, ...] = ()
    given: str = ""

    def __str__(self) -> str:
        problem = clipped(self.problem, _LONGEST_PROBLEM)
        text = f"{clipped(self.where, _LONGEST_PLACE)}: {problem}" if self.where else problem
        text += did_you_mean(self.given, self.choices)
        return printable(f"{text} (choose from: {listed(self.choices)})" if self.choices else text)

    def at(self, where: str) -> Self:
        """The same fault, told with another place."""
        return replace(self, where=where)


class OmnitrackError(Exception):
    """Base of all errors that the user can mend. The command line exits with status 2."""


class InputError(OmnitrackError):
    """Bad input. ``faults`` lists every fault found; the message tells the first ``MOST_TOLD``."""

    def __init__(self, faults: Fault | Iterable[Fault]):
        self.faults: Sequence[Fault] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__(self.faults)

    def __str__(self) -> str:
        lines = [str(fault) for fault in self.faults[:MOST_TOLD]]
        rest = len(self.faults) - len(lines)
        return "\n".join([*lines, f"and {rest} more faults"] if rest else lines)


class ScenarioError(InputError):
    """A scenario file or an override of it cannot be used."""


class SweepError(InputError):
    """A sweep file cannot be used."""


class StudyError(InputError):
    """A study file cannot be used."""


class PolicyError(InputError):
    """A policy file cannot be used."""


class NetworkError(InputError):
    """A network file, or a route asked for in it, cannot be used."""


class GeometryError(InputError):
    """Pipes that cannot exist or do not fit together."""


class OutputError(OmnitrackError):
    """A result could not be written (existing folder that is no run, full disk, no permission)."""


class RenderError(OmnitrackError):
    """No OpenGL context could be made for offscreen rendering."""
