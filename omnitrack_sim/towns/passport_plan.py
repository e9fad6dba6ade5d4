"""Trials of a passport: a sweep over random trials of many fittings, with a model behind it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError, SweepError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.calibration.calibration import Calibration
from omnitrack_sim.pipes.condition import BEAD
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.towns.features import (
    FEATURES,
    TRIED,
    as_straights,
    kind_of,
    relief_of,
    shape_of,
    slopes_of,
)
from omnitrack_sim.towns.passage_model import MODEL, KindTrials
from omnitrack_sim.towns.passport import Passport
from omnitrack_sim.trials.axes import (
    AxisTable,
    CalibrationAxis,
    DirectionAxis,
    NormalAxis,
    UniformAxis,
)
from omnitrack_sim.trials.entries import robot_entry, robot_of
from omnitrack_sim.trials.mobility import BATCH, CourseFile
from omnitrack_sim.trials.plan import Conclusion, Plan, Round, Rounds
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import numbers_of, passed_of, refuse_all_invalid

if TYPE_CHECKING:
    import pyarrow as pa

SEED = 73_000
FULL, QUICK = 64, 8
"""Trials of a course."""
LEAD = 0.75
"""Length of the straights before and behind a fitting, bores, beside that of the robot."""
BORES = (1.0, 0.95, 1.05)
"""Bores of the courses that are tried in several, over the nominal one."""
NARROW = 0.9
"""Bore of a branch that is narrower than its run, over the run's."""


@dataclass(frozen=True)
class PassportPlan(Plan):
    """Plan of the random trials that a robot's passport is made of.

    Attributes:
        changes: that make the robot and its controller in a scenario, by dotted path.
        trials: of each course.
        courses: names; empty: all.
        name: of the plan.
        batch: trials that run together.
        calibration: of the robot's own parameters, which each trial draws; none: as they are.

    Raises:
        InputError: there is no such course.

    Example:
        >>> plan = ot.PassportPlan.of("presser", courses=["straight"], trials=2)
        >>> plan.passport(ot.run_trials(plan).table)
        Passport('presser': 2 trials of 1 ways)
    """

    noun: ClassVar[str] = "passport"
    names: ClassVar[tuple[str, ...]] = ("passport",)
    figure: ClassVar[str] = "success_map.png"
    changes: Mapping[str, Any]
    trials: int = FULL
    courses: tuple[str, ...] = ()
    name: str = "passport"
    batch: int = BATCH
    calibration: Calibration | None = None

    @classmethod
    def of(
        cls,
        robot: str,
        *,
        controller: str = "",
        changes: Mapping[str, Any] | None = None,
        trials: int = FULL,
        courses: Sequence[str] | None = None,
        batch: int = BATCH,
        calibration: Calibration | None = None,
    ) -> PassportPlan:
        """Return the plan for a robot by name.

        Args:
            robot: kind of a robot, an MJCF or URDF file, or ``module:Class``.
            controller: its kind, or ``module:Class``; the robot's own when not given.
            changes: of all scenarios, by dotted path.
            trials: of each course.
            courses: names; all when not given.
            batch: trials that run together.
            calibration: each trial draws the robot's own parameters from it.

        Raises:
            InputError: there is no such robot, controller or course; the calibration has no
                parameter of a robot.
        """
        made = {**robot_entry(robot, controller).changes, **(changes or {})}
        own = None if calibration is None else calibration.part("robot.")
        return cls(made, trials, tuple(courses or ()), batch=batch, calibration=own)

    def __post_init__(self) -> None:
        known = dict(_pipes())
        for name in self.courses:
            if name not in known:
                raise InputError(Fault("--course", f"is {name!r}", tuple(known), given=name))

    @property
    def sweep(self) -> Sweep:
        """The trials of all courses that the robot fits.

        Raises:
            InputError: the robot fits none.
        """
        return self._courses[0]

    @property
    def misfits(self) -> dict[str, str]:
        """Why the robot does not fit a course, by the course's name."""
        return self._courses[1]

    @property
    def hash(self) -> str:
        """SHA-256 of everything that the trials depend on."""
        return self.sweep.hash

    def data(self) -> dict[str, Any]:
        """Return the plan's sweep as plain data."""
        return self.sweep.data()

    def rounds(self) -> Rounds:
        """Ask for all trials at once, and make the passport.

        Raises:
            SweepError: all trials are invalid.
        """
        table = yield Round(self.sweep.batches(), self.sweep.trials(), units=self.sweep.units)
        refuse_all_invalid(table, "robot", "", SweepError)
        passport = self.passport(table)
        tables = {"passport": passport.table()}
        return Conclusion(passport.summary(), tables, draw=lambda: self.sweep.draw_map(table))

    def passport(self, table: pa.Table) -> Passport:
        """Return the passport that all trials make.

        Args:
            table: of the result of ``run_trials``.
        """
        kinds = _kinds(self.sweep, table, self.changes)
        return Passport(robot_of(self.changes), self.changes, kinds, self.misfits)

    @cached_property
    def _courses(self) -> tuple[Sweep, dict[str, str]]:
        bases: dict[str, Scenario] = {}
        misfits: dict[str, str] = {}
        for name, pipes in _pipes():
            if self.courses and name not in self.courses:
                continue
            course = CourseFile(name=name, words=name, pipes=tuple(pipes))
            try:
                bases[name] = course.scenario({**self.changes, "pull.force": 0.0})
            except ScenarioError as error:
                misfits[name] = "; ".join(str(error).splitlines())
        if not bases:
            raise InputError(Fault("robot", f"fits no course: {next(iter(misfits.values()))}"))
        axes = [] if self.calibration is None else [CalibrationAxis.of(self.calibration, "")]
        return _sweep_of(bases, self.changes, self.trials, self.batch, axes), misfits


def _sweep_of(
    bases: dict[str, Scenario],
    changes: Mapping[str, Any],
    trials: int,
    batch: int,
    axes: Sequence[AxisTable],
) -> Sweep:
    """Random trials of each base: walls, roll, slope and pull, and what ``axes`` vary."""
    weight = robot_of(changes).mass * GRAVITY
    low, high = TRIED.friction
    return Sweep(
        name="passport",
        seed=SEED,
        samples=trials,
        sampling="latin_hypercube",
        draws="independent",
        batch=batch,
        axes=(
            UniformAxis(path="world.friction", kind="uniform", low=low, high=high),
            UniformAxis(path="start.theta5_deg", kind="uniform", low=-180, high=180),
            DirectionAxis(path="world.gravity", kind="direction", magnitude=GRAVITY),
            NormalAxis(
                path="pull.force",
                kind="normal",
                mean=0,
                std=TRIED.spread * weight,
                low=0,
                high=TRIED.pull * weight,
                clipped=True,
            ),
            *axes,
        ),
        bases=bases,
        set=dict(changes),
    )


def _pipes() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Names and pipes of all courses, lengths in bores."""
    lead = {"kind": "straight", "length": LEAD}
    tee = (("run_start", "branch"), ("branch", "run_end"), ("run_start", "run_end"))
    for bore in BORES:
        name = "" if bore == 1 else f"_bore_{round(100 * bore)}"
        own = {"inner_diameter": bore}
        yield f"straight{name}", [{**lead, "length": 2 * LEAD, **own}]
        elbow = {"kind": "elbow", "mean_radius": 1.5}
        yield f"elbow_150{name}", [{**one, **own} for one in (lead, elbow, lead)]
        for enter, leave in tee:
            way = {"kind": "tee", "enter": enter, "leave": leave}
            pipes = [{**one, **own} for one in (lead, way, lead)]
            yield f"tee_{enter}_{leave}{name}", pipes
    for radius, angle in (
        (0.6, 90),
        (1.0, 90),
        (3.0, 90),
        (1.5, 45),
        (1.5, 6),
        (1.0, 30),
        (1.5, 150),
    ):
        elbow = {"kind": "elbow", "mean_radius": radius, "angle_deg": angle}
        yield f"elbow_{round(100 * radius)}_{angle}", [lead, elbow, lead]
    for angle in (3, 8, 22.5, 45, 90):
        mitre = {"kind": "mitre", "angle_deg": angle}
        yield f"mitre_{angle:g}".replace(".", "_"), [lead, mitre, lead]
    sharp = (("run_end", "branch"), ("branch", "run_start"))
    for angle, (enter, leave) in product((35, 70), (*tee, *sharp)):
        wye = {"kind": "wye", "angle_deg": angle, "enter": enter, "leave": leave}
        yield f"wye_{angle}_{enter}_{leave}", [lead, wye, lead]
    for enter, leave in tee[:2]:
        own = {"branch_diameter": NARROW, "angle_deg": 70, "enter": enter, "leave": leave}
        narrow = {**lead, "inner_diameter": NARROW}
        ends = (lead, narrow) if leave == "branch" else (narrow, lead)
        yield f"wye_narrow_{enter}_{leave}", [ends[0], {"kind": "wye", **own}, ends[1]]
    for enter, leave in (*tee, ("branch", "opposite")):
        cross = {"kind": "cross", "enter": enter, "leave": leave}
        yield f"cross_{enter}_{leave}", [lead, cross, lead]
    for enter, leave in (*tee[:2], *sharp):
        cross = {"kind": "cross", "angle_deg": 60, "enter": enter, "leave": leave}
        yield f"cross_60_{enter}_{leave}", [lead, cross, lead]
    for bore in (0.95, 1.05):
        reducer = {"kind": "reducer", "length": 0.6, "end_diameter": bore}
        last = {**lead, "inner_diameter": bore}
        yield f"reducer_{round(100 * bore)}", [lead, reducer, last]
    yield from _worn(lead)


def _worn(lead: dict[str, Any]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Names and pipes of the courses with relief and couplings, lengths in bores."""
    bead = {"kind": "weld", "at": 1.0}
    oval = {"kind": "ovality", "at": 1.5, "length": 2.8}
    bed = {"kind": "deposit", "at": 1.5, "length": 2.5, "angle_deg": 0.0}
    dent = {"kind": "dent", "at": 1.0, "angle_deg": 90.0, "length": 0.8, "width": 0.8}
    reliefs: dict[str, tuple[float, list[dict[str, Any]]]] = {
        **{f"weld_{1000 * h:g}": (2.0, [_bead(bead, h)]) for h in (0.015, 0.05)},
        **{f"ovality_{100 * r:g}": (3.0, [oval | {"ratio": r}]) for r in (0.05, 0.15)},
        **{f"deposit_{100 * d:g}": (3.0, [bed | {"depth": d}]) for d in (0.05, 0.2)},
        "dent_10": (2.0, [dent | {"depth": 0.1}]),
        "relief": (3.0, [_bead(bead, 0.03), oval | {"ratio": 0.1}, bed | {"depth": 0.1}]),
    }
    for name, (length, relief) in reliefs.items():
        yield name, [lead, {"kind": "straight", "length": length, "relief": relief}, lead]
    joints: dict[str, dict[str, float]] = {
        "step_up_10": {"end_diameter": 0.98},
        "step_up_50": {"end_diameter": 0.9},
        "step_down_50": {"inner_diameter": 0.9, "end_diameter": 1.0},
        "offset_30": {"offset": 0.03},
        "offset_100": {"offset": 0.1},
        "gap_10": {"gap": 0.1, "depth": 0.1},
        "gap_50": {"gap": 0.5, "depth": 0.1, "length": 1.5},
        "gap_25_offset_50": {"gap": 0.25, "depth": 0.1, "length": 1.5, "offset": 0.05},
    }
    for name, sizes in joints.items():
        ends = (
            {**lead, "inner_diameter": sizes.get(key, 1.0)}
            for key in ("inner_diameter", "end_diameter")
        )
        first, last = ends
        yield name, [first, {"kind": "coupling", **sizes}, last]


def _bead(bead: Mapping[str, Any], height: float) -> dict[str, Any]:
    """Table of a bead of a height, bores."""
    return {**bead, "height": height, "width": BEAD * height}


def _kinds(sweep: Sweep, table: Any, changes: Mapping[str, Any]) -> dict[str, KindTrials]:
    """Trials by the kind of passage, from the table of a sweep."""
    robot = robot_of(changes)
    weight = robot.mass * GRAVITY
    passed, names = passed_of(table), table["outcome"].to_pylist()
    bases = table["base"].to_pylist() if len(sweep.bases) > 1 else [*sweep.bases] * table.num_rows
    columns = {name: numbers_of(table, name) for name in ("duration_s", "energy_j", "distance_m")}
    slip = _slip(table)
    gravity = _vectors(table)
    friction, pull = (numbers_of(table, name) for name in ("world.friction", "pull.force"))
    points: dict[str, list[list[float]]] = {}
    rows: dict[str, list[int]] = {}
    ways: dict[int, tuple[float, float, float, float]] = {}
    for i, base in enumerate(bases):
        # Trials that could not begin say nothing of the robot.
        if np.isnan(passed[i]):
            continue
        scenario = sweep.bases[base]
        passages = scenario.route.passages
        passage = passages[len(passages) // 2]
        climb, lift, leaving = slopes_of(passage, gravity[i])
        shape = shape_of(passage, robot.nominal_bore)
        kind = kind_of(passage)
        relief = relief_of(passage, robot.nominal_bore)
        point = [friction[i], pull[i] / weight, climb, lift, *shape, *relief]
        points.setdefault(kind, []).append(point)
        rows.setdefault(kind, []).append(i)
        middle, half = (passage.s_enter + passage.s_leave) / 2, MODEL.way * robot.nominal_bore / 2
        before = middle - half - scenario.start.distance
        ways[i] = before, climb, scenario.goal_distance - middle - half, leaving
    raw = np.stack([columns["duration_s"], columns["energy_j"], slip], axis=-1)
    kinds: dict[str, KindTrials] = {}
    for kind in sorted(points, key=lambda name: name != "straight"):
        own = np.array(rows[kind])
        place, costs = np.array(points[kind]), raw[own]
        if kind == "straight":
            costs = costs / np.maximum(columns["distance_m"][own], 1e-3)[:, None]
        elif "straight" in kinds:
            costs = costs - _of_straights(kinds["straight"], place, [ways[i] for i in rows[kind]])
        costs = np.where(passed[own, None] == 1, costs, np.nan)
        kinds[kind] = KindTrials(place, passed[own], costs, [names[i] for i in rows[kind]])
    return kinds


def _of_straights(
    straight: KindTrials, points: Array, ways: Sequence[tuple[float, float, float, float]]
) -> Array:
    """Costs (n, 3) of straights as long as the ways before and behind the middle of a fitting."""
    total = np.zeros((len(points), 3))
    before, climb, behind, leaving = np.array(ways).T
    for length, slope in ((before, climb), (behind, leaving)):
        there = as_straights(points)
        there[:, FEATURES.index("climb")] = slope
        total += length[:, None] * straight.cost(there)[0].T
    return total


def _slip(table: Any) -> Array:
    """Mean slip distance (n,) m of the bodies or modules that touch."""
    names = [name for name in table.column_names if name.startswith("slip_distance")]
    return np.mean([numbers_of(table, name) for name in names], axis=0)


def _vectors(table: Any) -> Array:
    """Gravity (n, 3) of each trial."""
    return np.stack([numbers_of(table, f"world.gravity_{axis}") for axis in "xyz"], axis=-1)
