"""Typed errors that name the place of each fault and the valid choices."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Self

from omnitrack_sim.base.text import clipped, did_you_mean, listed, printable

MAX_TOLD = 30
"""Number of faults that a message spells out; further ones are only counted."""
_MAX_PLACE, _MAX_PROBLEM = 200, 600


@dataclass(frozen=True)
class Fault:
    """One fault of the input, with its place and the valid choices.

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
        # A problem quotes what stands in the file, which may be a megabyte or hold terminal
        # escapes.
        problem = clipped(self.problem, _MAX_PROBLEM)
        text = f"{clipped(self.where, _MAX_PLACE)}: {problem}" if self.where else problem
        text += did_you_mean(self.given, self.choices)
        return printable(f"{text} (choose from: {listed(self.choices)})" if self.choices else text)

    def at(self, where: str) -> Self:
        """Return the same fault at another place."""
        return replace(self, where=where)


class OmnitrackError(Exception):
    """Base of all errors that the user can mend. The command line exits with status 2.

    Example:
        >>> try:
        ...     ot.load_scenario("tee_trun")
        ... except ot.OmnitrackError as error:
        ...     print(error)
        tee_trun: no such file, nor a shipped scenario of that name; did you mean 'tee_turn'? ...
    """


class InputError(OmnitrackError):
    """Bad input. ``faults`` lists every fault; the message spells out the first ``MAX_TOLD``.

    Example:
        >>> try:
        ...     ot.load_scenario("tee_turn", {"world.friction": -1, "seed": "x"})
        ... except ot.InputError as error:
        ...     print([fault.where for fault in error.faults])
        ['world.friction', 'seed']
    """

    def __init__(self, faults: Fault | Iterable[Fault]):
        self.faults: Sequence[Fault] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        # Exceptions are pickled by their args: with the faults there, an error crosses process
        # borders whole.
        super().__init__(self.faults)

    def __str__(self) -> str:
        lines = [str(fault) for fault in self.faults[:MAX_TOLD]]
        rest = len(self.faults) - len(lines)
        return "\n".join([*lines, f"and {rest} more faults"] if rest else lines)


@contextmanager
def gathered(
    faults: list[Fault], where: Callable[[Fault], str] = lambda fault: fault.where
) -> Iterator[None]:
    """Append the faults of an ``InputError`` to a list instead of raising it.

    ``where`` gives the place of each in the whole file.
    """
    try:
        yield
    except InputError as error:
        faults += [fault.at(where(fault)) for fault in error.faults]


class ScenarioError(InputError):
    """A scenario file or an override of it cannot be used.

    Example:
        >>> try:
        ...     ot.load_scenario("straight", {"control.cruise_sped": 0.1})
        ... except ot.ScenarioError as error:
        ...     print(error)
        control.cruise_sped: there is no 'cruise_sped' here; did you mean 'cruise_speed'? ...
    """


class SweepError(InputError):
    """A sweep file cannot be used.

    Example:
        >>> try:
        ...     ot.load_sweep("nothing")
        ... except ot.SweepError as error:
        ...     print(error)
        nothing: no such file, nor a shipped sweep of that name ...
    """


class StudyError(InputError):
    """A study file cannot be used.

    Example:
        >>> try:
        ...     ot.load_study("nothing")
        ... except ot.StudyError as error:
        ...     print(error)
        nothing: no such file, nor a shipped study of that name ...
    """


class PolicyError(InputError):
    """A policy file cannot be used.

    Example:
        >>> try:
        ...     ot.load_policy("nothing")
        ... except ot.PolicyError as error:
        ...     print(error)
        nothing: ...
    """


class NetworkError(InputError):
    """A network file, or a route asked for in it, cannot be used.

    Example:
        >>> try:
        ...     ot.load_network("nothing")
        ... except ot.NetworkError as error:
        ...     print(error)
        nothing: no such file, nor a shipped network of that name ...
    """


class GeometryError(InputError):
    """Pipes that cannot exist or do not fit together.

    Example:
        >>> try:
        ...     ot.Elbow(mean_radius=0.05)
        ... except ot.GeometryError as error:
        ...     print(error)
        elbow.mean_radius: is 0.05 m; must be at least the pipe radius of 0.08 m
    """


class OutputError(OmnitrackError):
    """A result could not be written (existing folder that is no run, full disk, no permission).

    Example:
        >>> try:
        ...     ot.load_result("no_run")
        ... except ot.OutputError as error:
        ...     print(error)
        no_run: no such folder
    """


class ControllerError(OmnitrackError):
    """A user's own controller raised an error, or returned no command; that error is its cause.

    Example:
        >>> class Broken:
        ...     def __init__(self, setup): pass
        ...     def step(self, observation): return None
        >>> try:
        ...     ot.run(ot.load_scenario("straight"), controller=Broken, no_load=False)
        ... except ot.ControllerError as error:
        ...     print(str(error).partition(": ")[2])
        TypeError: what Broken.step returns: is None...
    """


class RenderError(OmnitrackError):
    """No OpenGL context could be made for offscreen rendering.

    Example:
        >>> issubclass(ot.RenderError, ot.OmnitrackError)
        True
    """
