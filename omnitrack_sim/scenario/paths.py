"""Values of a scenario as plain data, set by dotted path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_origin

from pydantic import BaseModel

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.paths import below, default_of, index_of, inside, keys_of
from omnitrack_sim.base.table import files_of
from omnitrack_sim.robots.omnitrack.control.catalogue import controller_of, parameters_model
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.tables import ControlTable

OPEN_TABLE = ("control", "parameters")
"""Below this path the controller decides which keys there are."""


def set_value(data: Any, path: str, value: Any) -> Fault | None:
    """Set one dotted path in a scenario's plain data, which need not be complete or right; the
    fault where there is no such place, and then nothing has changed.

    Tables on the way that the data leaves out begin as the scenario would have them.
    """
    if path == "control.kind":
        _other_controller(data, value)
    *before, last = path.split(".")
    place, begun = data, None
    for depth, key in enumerate([*before, last]):
        fault = _fault_at(data, before[:depth], place, key)
        if fault is not None:
            if begun is not None:
                begun[0].clear()
                begun[0].update(begun[1])
            return fault.at(path)
        at: Any = int(key) if isinstance(place, list) else key
        if depth == len(before):
            place[at] = value
            _forget_digest(data, path, place)
        else:
            if isinstance(place, dict) and place.get(key) is None:
                begun = begun or (place, dict(place))
                place[key] = default_of(_kind_at(data, before[:depth]), place, key)
            place = place[at]
    return None


def _fault_at(data: Any, before: Sequence[str], place: Any, key: str) -> Fault | None:
    """Why ``key`` cannot stand in ``place``, which the path ``before`` leads to; None if it can."""
    if isinstance(place, list):
        choices = tuple(str(i) for i in range(len(place)))
        return None if index_of(place, key) is not None else _nowhere(key, choices)
    if not isinstance(place, dict):
        return Fault("", f"{key!r} is below a plain value")
    if key in place:
        return None
    kind = _kind_at(data, before)
    # A controller's parameters are checked by its own model, which may take more than it lists.
    is_open = get_origin(kind) is dict or tuple(before[:2]) == OPEN_TABLE
    known = keys_of(kind, place)
    return None if is_open or key in known else _nowhere(key, known)


def _nowhere(key: str, choices: tuple[str, ...]) -> Fault:
    return Fault("", f"there is no {key!r} here", choices, given=key)


def spread(data: Any, path: str) -> list[str]:
    """The places that a path with ``*`` in it stands for: one for each item of the list that may
    have the key. Without ``*``, or where there is no list, the path itself."""
    head, star, tail = path.partition(".*")
    place = data
    for key in head.split("."):
        place = inside(place, key)
    if not star or not isinstance(place, list):
        return [path]
    every = [one for i in range(len(place)) for one in spread(data, f"{head}.{i}{tail}")]
    return [one for one in every if _may_stand(data, one)] or [path]


def _may_stand(data: Any, path: str) -> bool:
    *before, key = path.split(".")
    place = data
    for each in before:
        place = inside(place, each)
    return inside(place, key) is not None or key in keys_of(_kind_at(data, before), place)


def _kind_at(data: Any, places: Sequence[str]) -> Any:
    """Type of what stands at a path of a scenario; None where it is not known."""
    kind: Any = Scenario
    for depth, key in enumerate(places, start=1):
        is_open = tuple(places[:depth]) == OPEN_TABLE
        kind = _parameters_of(inside(data, "kind")) if is_open else below(kind, data, key)
        data = inside(data, key)
    return kind


def _parameters_of(kind: Any) -> Any:
    """The model of ``control.parameters`` of a kind of controller."""
    try:
        return parameters_model(controller_of(str(ControlTable().kind if kind is None else kind)))
    except InputError:
        return None  # the fault is told elsewhere


def _other_controller(data: Any, kind: Any) -> None:
    """Leave out the parameters where another controller is chosen, which has others."""
    control = data.get("control") if isinstance(data, dict) else None
    if isinstance(control, dict) and control.get("kind", ControlTable().kind) != kind:
        data["control"] = {**control, "parameters": {}}


def _forget_digest(data: Any, path: str, place: Any) -> None:
    """Leave out the digest of a file beside the key that names another one now."""
    *before, key = path.split(".")
    if tuple(before) != OPEN_TABLE:
        return
    model = _parameters_of(inside(inside(data, "control"), "kind"))
    file = {} if model is None else files_of(model)
    if key in file:
        place.pop(file[key].digest, None)


def choices_at(places: Sequence[str], data: Mapping[str, Any]) -> tuple[str, ...]:
    """Valid keys of the table at a path into a scenario's plain data."""
    place: Any = data
    for key in places:
        place = inside(place, key)
    kind: type[BaseModel] | Any = _kind_at(data, places)
    return keys_of(kind, place)
