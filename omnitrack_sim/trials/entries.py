"""Entries of a bench: robots with their controllers, by what a user writes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import installed, trusting
from omnitrack_sim.base.reading import NAME_PATTERN, checked
from omnitrack_sim.robots.control import controller_of
from omnitrack_sim.robots.kinds import DEFAULT, is_model_file, robot_class
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.scene import is_similar
from omnitrack_sim.scenario import kinds_first, set_value

Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Entry:
    """A robot and its controller.

    Attributes:
        name: of its rows and of the folder of its trials.
        words: what it is.
        changes: of the scenarios of all courses, by dotted path, in this order.
    """

    name: str
    words: str
    changes: Changes = field(default_factory=dict)

    def renamed(self, name: str, source: str) -> Entry:
        """Return the same entry under another name.

        Args:
            name: the new one.
            source: what the user wrote, for the fault.

        Raises:
            InputError: the name cannot be that of a folder.
        """
        if re.match(NAME_PATTERN, name.replace(".", "_")) and len(name) <= 100:
            return replace(self, name=name)
        problem = "has no name for a folder; write NAME= before it"
        raise InputError(Fault(f"entry {source}", problem))


def robot_of(changes: Changes) -> Robot:
    """Return the robot of an entry.

    Raises:
        InputError: there is no such robot, or one of its values does not fit.
    """
    data: dict[str, Any] = {"robot": {}}
    for path, value in kinds_first(changes).items():
        # To set what is a controller's would look up its class, for nothing.
        if path.startswith("robot."):
            set_value(data, path, value)
    kind = data["robot"].pop("kind", DEFAULT)
    return checked(robot_class(str(kind)), data["robot"], InputError)


@trusting()
def robot_entry(
    source: str, controller: str = "", shipped: Mapping[str, Entry] | None = None
) -> Entry:
    """Return the entry for a robot.

    Args:
        source: kind of a robot (``Robot.built``), an MJCF or URDF file, ``module:Class``, or name
            of a shipped entry; ``NAME=`` before it gives it another name, ``@BORE`` after it makes
            a similar robot for a bore of so many metres. Empty: the default robot.
        controller: kind of controller of that robot, or ``module:Class``; none: the robot's own.
        shipped: entries by name, before kinds of robots.

    Raises:
        InputError: there is no such robot or controller, or it cannot be used.
    """
    name, is_renamed, what = (source or DEFAULT).rpartition("=")
    what, bore = _without_bore(what)
    if what in (shipped or {}):
        entry = (shipped or {})[what]
    elif is_model_file(what):
        # Workers may run in another folder.
        changes = {"robot.kind": "mjcf", "robot.file": str(Path(what).resolve())}
        entry = Entry(Path(what).stem, f"robot of {what}", changes)
    else:
        built = {f"robot.{key}": value for key, value in robot_class(what).built.items()}
        changes = {"robot.kind": what, **built}
        entry = Entry(what.replace(":", "."), f"robot {what}", changes)
    if bore is not None:
        entry = _resized(entry, bore)
    robot = robot_of(entry.changes)
    if controller:
        controller_of(controller, robot.controllers())
        changes = {**entry.changes, "control.kind": controller}
        entry = Entry(f"{entry.name}.{controller}".replace(":", "."), entry.words, changes)
    return entry.renamed(name if is_renamed else entry.name, source)


@trusting()
def controller_entry(source: str, shipped: Mapping[str, Entry]) -> Entry:
    """Return the entry for a controller of the default robot.

    Args:
        source: name of a shipped entry, a kind of controller, ``module:Object``, or the path of a
            policy file; ``NAME=`` before it gives it another name.
        shipped: entries by name.

    Raises:
        InputError: there is no such thing, or it cannot be used.
    """
    name, is_renamed, what = source.rpartition("=")
    if what in shipped:
        entry = shipped[what]
    elif what.endswith(".npz"):
        # Workers may run in another folder.
        path = str(Path(what).resolve()) if Path(what).is_file() else what
        changes = {"control.kind": "policy", "control.parameters.policy": path}
        entry = Entry(Path(what).stem, f"policy {what}", changes)
    else:
        own = robot_of({}).controllers()
        kinds = {**own, **installed("controllers")}
        if what not in kinds and ":" not in what:
            choices = (*dict.fromkeys((*shipped, *kinds)), "module:Object", "FILE.npz")
            raise InputError(Fault("--controller", f"is {what!r}", choices, given=what))
        # Refuse a class that cannot be imported before any trial of another entry is run.
        controller_of(what, own)
        entry = Entry(what.replace(":", "."), f"controller {what}", {"control.kind": what})
    return entry.renamed(name if is_renamed else entry.name, source)


def _without_bore(source: str) -> tuple[str, float | None]:
    """Split ``ROBOT@BORE``; a file may have an ``@`` in its name."""
    what, _, bore = source.rpartition("@")
    try:
        return (what, float(bore)) if what else (source, None)
    except ValueError:
        return source, None


def _resized(entry: Entry, bore: float) -> Entry:
    """Return the entry of a similar robot for a bore of ``bore`` m.

    Raises:
        InputError: the model has sizes that are no parameters, or there is no such bore.
    """
    robot = robot_of(entry.changes)
    if not 0 < bore < math.inf:
        raise InputError(Fault(f"entry {entry.name}", f"@{bore:g} is no bore in metres"))
    new = {f"robot.{name}": value for name, value in robot.similar_to(bore).items()}
    changes = {**entry.changes, **new}
    made = robot_of(changes)
    if not (math.isclose(made.nominal_bore, bore) and is_similar(robot, made)):
        problem = "cannot be made for another bore: it has sizes that are no parameters with units"
        raise InputError(Fault(f"entry {entry.name}", problem))
    size = f"{1000 * bore:g} mm"
    return Entry(f"{entry.name}_{size.replace(' ', '')}", f"{entry.words}, for {size}", changes)
