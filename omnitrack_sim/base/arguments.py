"""Type checks of the arguments of public functions.

An error names the argument, the value that was passed and the type that is needed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, TypeVar

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import shown

_Thing = TypeVar("_Thing")
_MAKERS = {
    "Scenario": ("load_scenario",),
    "Network": ("load_network",),
    "Plan": ("load_sweep", "load_study"),
    "Result": ("load_result",),
    "TrialsResult": ("load_sweep_result", "run_trials"),
    "Pipes": ("add_pipes",),
}
"""Functions of the package that make a thing from a file, a folder or a name, by its class."""


def check_is(kind: type[_Thing], where: str, value: object) -> _Thing:
    """Return the argument ``where`` if it is of the class ``kind``, or raise a ``TypeError``."""
    if isinstance(value, kind):
        return value
    problem = f"{where}: is {_described(value)}; it must be an ot.{kind.__name__}"
    # The commonest mistake is a path where the loaded object belongs: the message then shows the
    # very call that loads it.
    given = f"({shown(os.fspath(value))})" if isinstance(value, str | os.PathLike) else ""
    if calls := [f"ot.{maker}{given}" for maker in _MAKERS.get(kind.__name__, ())]:
        problem += f", such as {' or '.join(calls)} makes"
    raise TypeError(problem)


def check_all(kind: type[_Thing], where: str, values: Iterable[object]) -> list[_Thing]:
    """Return ``values`` as a list; a ``TypeError`` if they are no list, or one is no ``kind``."""
    # A single scenario can be iterated as a pydantic model, so it must be refused before the loop.
    if isinstance(values, kind):
        raise TypeError(f"{where}: is one ot.{kind.__name__}, not a list; write [...] around it")
    # Texts and mappings are iterable too, but item by item they would give misleading messages.
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        raise TypeError(
            f"{where}: is {_described(values)}; it must be a list of ot.{kind.__name__}"
        )
    return [check_is(kind, f"{where}[{i}]", value) for i, value in enumerate(values)]


def check_changes(changes: object) -> None:
    """Raise a ``TypeError`` for changes that are no mapping of values by dotted path."""
    like = "such as {'world.friction': 0.3}"
    if not isinstance(changes, Mapping):
        raise TypeError(f"changes: is {_described(changes)}; it must be a mapping, {like}")
    for path in changes:
        if not isinstance(path, str):
            raise TypeError(f"changes: has the path {_described(path)}; paths are texts, {like}")


def check_controller(controller: Any) -> None:
    """Raise a ``TypeError`` for a controller that is no class with a method ``step``."""
    if isinstance(controller, str):
        raise TypeError(
            f"controller: is {_described(controller)}; it must be a class. One by its name is "
            f"chosen by ot.override(scenario, {{'control.kind': {shown(controller)}}})"
        )
    if not isinstance(controller, type):
        raise TypeError(
            f"controller: is {_described(controller)}; it must be a class, not its instance"
        )
    if not callable(getattr(controller, "step", None)):
        raise TypeError(f"controller: {controller.__name__} has no method step; see ot.Controller")


def check_time(where: str, time: object) -> None:
    """Raise an error for a time in a run, s, that is no number, or NaN."""
    if not isinstance(time, Real):
        raise TypeError(f"{where}: is {_described(time)}; it must be a number, s")
    if math.isnan(time):
        raise InputError(Fault(where, "is nan; it must be a number, s"))


def check_times(times: object) -> None:
    """Check a list of times in a run, s; errors as of ``check_time``, and TypeError for no list."""
    if not isinstance(times, Sequence | np.ndarray) or isinstance(times, str):
        raise TypeError(f"times: is {_described(times)}; it must be a list of numbers, s")
    for i, time in enumerate(times):
        check_time(f"times[{i}]", time)


def _described(value: object) -> str:
    """Short text of a value and its type."""
    return "None" if value is None else f"{shown(value)}, of type {type(value).__name__}"


def refuse_taken(where: str, names: list[str], shipped: Collection[str]) -> None:
    """Refuse names that are among those ``shipped``, or that come twice."""
    for i, name in enumerate(names):
        if name in shipped or name in names[:i]:
            raise InputError(Fault(f"{where}.{i}", f"{name!r} is taken; give it another name"))
