"""Typed errors. Each names the place of the fault and the valid choices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing wrong with the input: where it stands, what is wrong, what would be right."""

    where: str
    problem: str
    choices: tuple[str, ...] = ()

    def __str__(self) -> str:
        text = f"{self.where}: {self.problem}" if self.where else self.problem
        return f"{text} (choose from: {', '.join(self.choices)})" if self.choices else text


class OmnitrackError(Exception):
    """Base of all errors that the user can mend. The command line exits with status 2."""


class InputError(OmnitrackError):
    """Bad input. ``faults`` lists every fault found, not only the first."""

    def __init__(self, faults: Fault | Iterable[Fault]):
        self.faults: Sequence[Fault] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class ScenarioError(InputError):
    """A scenario file or an override of it cannot be used."""


class SweepError(InputError):
    """A sweep file cannot be used."""


class StudyError(InputError):
    """A study file cannot be used."""


class NetworkError(InputError):
    """A network file, or a route asked for in it, cannot be used."""


class GeometryError(InputError):
    """Pipes that cannot exist or do not fit together."""


class OutputError(OmnitrackError):
    """A result could not be written (existing folder that is no run, full disk, no permission)."""


class RenderError(OmnitrackError):
    """No OpenGL context could be made for offscreen rendering."""
