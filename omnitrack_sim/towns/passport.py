"""Passport of a robot: what it passes, how surely, and at what cost, measured by random trials."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.bounds import MAX_TRIALS
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import NotTrustedError, shipped_files, trusting
from omnitrack_sim.base.reading import checked
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.results.files import read_table
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.recorded import Recorded, is_recorded, values_of
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario.loading import can_be_made, refuse_file
from omnitrack_sim.towns.features import FEATURES, as_straights
from omnitrack_sim.towns.passage_model import MODEL, Estimate, KindTrials
from omnitrack_sim.trials.batches import sha256_of
from omnitrack_sim.trials.entries import robot_of

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 3
"""Version of the file."""
PASSPORT_FILE = "passport.parquet"
COSTS = ("seconds", "joules", "slip")
"""Columns of what a passage takes: s, J, and m of slip."""
MATTERS = 1.0
"""Change of the logit over a feature's range from which on the feature is said to matter."""


@dataclass(frozen=True, eq=False)
class Passport:
    """Chances of a robot to pass fittings, measured by trials.

    Attributes:
        robot: of which it is.
        changes: that make the robot and its controller in a scenario, by dotted path.
        kinds: trials by the kind of passage; see ``towns.features.kind_of``.
        misfits: why the robot does not fit a course, by the course's name.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=2)
        >>> passport = plan.passport(ot.run_trials(plan).table)
        >>> point = [0.8, 0, 0, 0, 90, 0.7, 1, 0, 0, 0, 0]
        >>> list(passport.kinds), passport.estimate("elbow", [point]).is_known
        (['straight'], array([False]))
    """

    robot: Robot
    changes: Mapping[str, Any]
    kinds: Mapping[str, KindTrials]
    misfits: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        trials = sum(len(kind.passed) for kind in self.kinds.values())
        return f"Passport({self.robot.kind!r}: {trials} trials of {len(self.kinds)} ways)"

    @property
    def sha256(self) -> str:
        """SHA-256 of the trials and of what makes the robot, hexadecimal."""
        rows = {
            name: [kind.points.tolist(), kind.passed.tolist(), str(kind.costs.tolist())]
            for name, kind in self.kinds.items()
        }
        outcomes = {name: list(kind.outcomes) for name, kind in self.kinds.items()}
        return sha256_of([dict(self.changes), rows, outcomes, dict(self.misfits)])

    def estimate(self, kind: str, points: Any, lengths: Any = None) -> Estimate:
        """Return estimates at points (q, features) of a kind of passage; see ``FEATURES``.

        Args:
            kind: of the passages.
            points: (q, features).
            lengths: (q,) m, of the ways; when not given, ``ModelSettings.way``.
        """
        points = np.asarray(points, float).reshape(-1, len(FEATURES))
        if kind not in self.kinds:
            return Estimate(*[np.full(len(points), np.nan)] * len(Estimate._fields))
        made, straight = self.kinds[kind].estimate(points), self.kinds.get("straight")
        if lengths is None or straight is None or kind == "straight":
            return made
        way = MODEL.way * self.robot.nominal_bore
        more = (lengths - way) * straight.cost(as_straights(points))[0]
        seconds, joules, slip = np.stack([made.seconds, made.joules, made.slip]) + more
        return made._replace(seconds=seconds, joules=joules, slip=slip)

    def summary(self) -> dict[str, Any]:
        """Return what ``passport.json`` holds: rates and means by kind, and misfits."""
        rows = []
        for name, kind in self.kinds.items():
            passed, count = int(kind.passed.sum()), len(kind.passed)
            costs = kind.costs[kind.passed == 1]
            means = costs.mean(axis=0).tolist() if len(costs) else [None] * 3
            stopped = sorted({o for o, p in zip(kind.outcomes, kind.passed, strict=True) if not p})
            rows.append(
                {
                    "kind": name,
                    "trials": count,
                    "passed": passed,
                    "success_95": wilson_interval(passed, count),
                    **dict(zip(("seconds", "joules", "slip_m"), means, strict=True)),
                    "stopped_by": {o: kind.outcomes.count(o) for o in stopped},
                    "matters": [
                        name for k, name in enumerate(FEATURES) if kind.effect(k) > MATTERS
                    ],
                }
            )
        return {"robot": self.robot.kind, "ways": rows, "misfits": dict(self.misfits)}

    def table(self) -> pa.Table:
        """Return the passport as a table, whose Parquet file can be loaded: one row a trial."""
        import pyarrow as pa

        columns: dict[str, Any] = {
            "kind": [name for name, kind in self.kinds.items() for _ in kind.passed]
        }
        kinds = self.kinds.values()
        for k, name in enumerate(FEATURES):
            columns[name] = np.concatenate([kind.points[:, k] for kind in kinds])
        columns["passed"] = np.concatenate([kind.passed for kind in kinds]).astype(bool)
        for k, name in enumerate(COSTS):
            columns[name] = np.concatenate([kind.costs[:, k] for kind in kinds])
        columns["outcome"] = [outcome for kind in kinds for outcome in kind.outcomes]
        about = {
            "format": FORMAT,
            "changes": dict(self.changes),
            "misfits": dict(self.misfits),
            **environment(),
        }
        if is_recorded(self.robot):
            about["robot"] = values_of(self.robot)
        table = pa.table(columns)
        text = json.dumps(about, sort_keys=True)
        return table.replace_schema_metadata({"passport": text})


def _schema() -> pa.Schema:
    """Return the columns of a passport's table."""
    import pyarrow as pa

    numbers = [(name, pa.float64()) for name in (*FEATURES, *COSTS)]
    words = [("kind", pa.string()), ("outcome", pa.string())]
    return pa.schema([*words, ("passed", pa.bool_()), *numbers])


def _about(metadata: Mapping[bytes, bytes]) -> dict[str, Any]:
    """Return what a passport's file says beside its table.

    Raises:
        KeyError, ValueError: it is not that of a passport of this version.
    """
    about = json.loads(metadata[b"passport"])
    tables = [about["changes"], about["misfits"]] if isinstance(about, dict) else [about]
    if not all(isinstance(table, dict) for table in tables) or about["format"] != FORMAT:
        raise ValueError(f"its format is not {FORMAT}")
    return about


def _is_whole(column: pa.ChunkedArray, name: str) -> bool:
    """Return whether a column has a value in every row; costs may be NaN, where nothing passed."""
    if column.null_count or name not in (*FEATURES, *COSTS):
        return not column.null_count
    values = column.to_numpy()
    return not np.isinf(values).any() and (name in COSTS or not np.isnan(values).any())


def load_passport(path: str | Path, *, trust: bool = False) -> Passport:
    """Read a passport from its file or the folder that it is in, or a shipped one by name.

    Args:
        path: file, folder or name.
        trust: import the class of a robot from outside the package, or read its own file. Otherwise
            its sizes are those that the passport has recorded.

    Raises:
        InputError: there is none, or it is not a passport of this version.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=1)
        >>> result = ot.run_trials(plan, out="presser")
        >>> ot.load_passport("presser")
        Passport('presser': 1 trials of 1 ways)
    """
    with trusting(None if trust else ()), _reading(path) as file:
        return _passport(file)


@contextmanager
def _reading(path: str | Path) -> Iterator[Path]:
    """Yield the file of a passport; turn any exception while it is read into an ``InputError``.

    On damaged bytes decoders raise anything.
    """
    path = shipped_files("passports").get(str(path), Path(path))
    try:
        yield path / PASSPORT_FILE if path.is_dir() else path
    except NotTrustedError as error:
        raise InputError([fault.at(f"{path}: {fault.where}") for fault in error.faults]) from error
    except Exception as error:
        cause = "; ".join(str(error).splitlines()) or type(error).__name__
        problem = f"{path} is no passport of this version: `omnitrack passport` makes one ({cause})"
        raise InputError(Fault("passport", problem)) from error


def _passport(file: Path) -> Passport:
    """Return the passport in a file; any error where it is damaged."""
    table = read_table(file, MAX_TRIALS)
    about = _about(table.schema.metadata or {})
    table = table.select([field.name for field in _schema()]).cast(_schema())
    if odd := [name for name in table.column_names if not _is_whole(table[name], name)]:
        raise ValueError(f"{odd[0]} holds what is no number, or nothing")
    names = table["kind"].to_pylist()
    points = np.stack([table[name].to_numpy() for name in FEATURES], axis=-1)
    passed = table["passed"].to_numpy().astype(float)
    costs = np.stack([table[name].to_numpy() for name in COSTS], axis=-1)
    outcomes = table["outcome"].to_pylist()
    kinds = {}
    for name in dict.fromkeys(names):
        rows = np.array([own == name for own in names])
        own = [outcome for outcome, row in zip(outcomes, rows, strict=True) if row]
        kinds[name] = KindTrials(points[rows], passed[rows], costs[rows], own)
    return Passport(_robot_in(about), about["changes"], kinds, about["misfits"])


def _robot_in(about: Mapping[str, Any]) -> Robot:
    """Return the robot of a passport; by what is recorded of it where it is not to be trusted."""
    changes, kept = about["changes"], about.get("robot")
    own = {p.removeprefix("robot."): v for p, v in changes.items() if p.startswith("robot.")}
    if kept is None:
        refuse_file(own)
    elif not can_be_made(own):
        return checked(Recorded, {"table": json.dumps(own), "file": "", "values": kept}, InputError)
    return robot_of(changes)
