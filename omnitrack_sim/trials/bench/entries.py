"""The entries of the benchmark: what drives the robot through the trials."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.shipped import shipped_policies
from omnitrack_sim.robots.omnitrack.control.catalogue import CONTROLLERS, controller_of
from omnitrack_sim.robots.omnitrack.policy import load_policy

DEFAULT = "feedback"
"""The entry that all others are compared with."""


@dataclass(frozen=True)
class Entry:
    """One way to drive.

    Attributes:
        name: of its rows and of the folder of its trials. words: what it is.
        changes: of the scenarios of all tasks, by dotted path, in this order.
    """

    name: str
    words: str
    changes: Mapping[str, Any] = field(default_factory=dict)


# The values before commit aa5bc0e and sway, where they are parameters.
_BEFORE = {
    "robot.motor.speed_bandwidth": 50.0,
    "robot.motor.speed_droop": 0.0,
    "control.parameters.tracking.turn_speed": 1.0,
    "control.parameters.damping.tee_turn": 5.0,
    "control.parameters.damping.tee_straight": 2.5,
    "control.parameters.sway.lean_deg": 0.0,
    "control.parameters.alignment.aside_tee_turn": [0.0, 0.0, 0.0],
}
_SHIPPED = (
    Entry(DEFAULT, "the default controller: feedback on the heading, gentle drive, sway"),
    Entry("earlier", "the same before gentle drive, sway and rolling aside", _BEFORE),
    Entry("equal", "all modules at cruise speed", {"control.kind": "equal"}),
    Entry(
        "as_written",
        "the paper's speeds, open loop: Eq. 20 in elbows, inner module backward in tees",
        {"control.kind": "paper"},
    ),
    Entry(
        "eq20",
        "Eq. 20 in every turn, open loop; a tee is taken for an elbow",
        {"control.kind": "omnitrack_sim.paper.open_loop:BendController"},
    ),
    Entry("differential", "one motor and a differential", {"robot.drive": "differential"}),
)


def shipped_entries() -> dict[str, Entry]:
    """The shipped ways to drive, and the shipped policies, by name; the default one first."""
    found = {entry.name: entry for entry in _SHIPPED}
    return found | {name: _of_policy(name, name) for name in shipped_policies()}


def entry_of(source: str) -> Entry:
    """The entry that is meant: a shipped one by name, a kind of controller, ``module:Object``, or
    the path of a policy file; ``NAME=`` before it gives it another name.

    Raises:
        InputError: there is no such thing, or it cannot be used.
    """
    name, given, what = source.rpartition("=")
    shipped = shipped_entries()
    if what in shipped:
        found = shipped[what]
    elif what.endswith(".npz"):
        found = _of_policy(Path(what).stem, what)
    else:
        found = _of_controller(what, tuple(shipped))
    return Entry(_fit(name, source), found.words, found.changes) if given else found


def _of_policy(name: str, source: str) -> Entry:
    policy = load_policy(source)
    words = f"policy, {policy.acting.name}"
    path = str(Path(source).resolve()) if Path(source).is_file() else source
    changes = {"control.kind": "policy", "control.parameters.policy": path}
    return Entry(_fit(name, source), words, changes)


def _of_controller(kind: str, shipped: Sequence[str]) -> Entry:
    if kind not in CONTROLLERS and ":" not in kind:
        choices = (*dict.fromkeys((*shipped, *CONTROLLERS)), "module:Object", "FILE.npz")
        raise InputError(Fault("--entry", f"is {kind!r}", choices, given=kind))
    controller_of(kind)
    return Entry(_fit(kind.replace(":", "."), kind), f"controller {kind}", {"control.kind": kind})


def _fit(name: str, source: str) -> str:
    """A name that a folder may have."""
    if re.match(NAME_PATTERN, name.replace(".", "_")) and len(name) <= 100:
        return name
    raise InputError(Fault(f"--entry {source}", "has no name for a folder; write NAME= before it"))
