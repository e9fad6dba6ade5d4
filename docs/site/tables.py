"""Tables of pages that are made from the code, which says each row once.

    python docs/site/tables.py --write

makes the tables of all pages anew, and ``--check`` names the pages whose tables differ from the
code. On a page a table stands between two marks:

    <!-- table: scenarios -->
    <!-- end -->
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

import omnitrack_sim as ot
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.base.reading import KINDS
from omnitrack_sim.base.table import meanings_of, symbol_of
from omnitrack_sim.cli.complete import comment
from omnitrack_sim.gym.options import TERMS, EnvOptions
from omnitrack_sim.pipes.condition import Condition, load_condition
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings, table_of
from omnitrack_sim.pipes.network import Joint, Network, Origin
from omnitrack_sim.pipes.relief import relief_kinds
from omnitrack_sim.record import channels, metrics
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.kinds import default_robot
from omnitrack_sim.robots.omnitrack.channels import CHANNELS, MODULES
from omnitrack_sim.robots.omnitrack.control.driven import DrivenTable
from omnitrack_sim.robots.omnitrack.control.jacobian import FeedbackTable
from omnitrack_sim.robots.omnitrack.control.open_loop import PaperTable
from omnitrack_sim.robots.omnitrack.metrics import METRICS
from omnitrack_sim.robots.omnitrack.motors import Motor, Winding
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions, PolicyTable
from omnitrack_sim.robots.omnitrack.policy.features import FEATURE_SETS
from omnitrack_sim.robots.tail import Tether
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.tables import Pipe
from omnitrack_sim.senses.settings import SensingTable
from omnitrack_sim.show.viewer.keys import DRIVE, REPLAY, VIEW, Key
from omnitrack_sim.trials.search_plan import Objective, Variable
from omnitrack_sim.trials.study import Final
from omnitrack_sim.trials.study_file import StudyFile
from omnitrack_sim.trials.suite import Suite, load_suite
from omnitrack_sim.trials.sweep_file import SweepFile

ROOT = Path(__file__).parents[2]
MARK = re.compile(
    r"^<!-- table: (?P<name>.+) -->\n(?P<body>(?:\|.*\n)*)<!-- end -->$", re.MULTILINE
)
Row = tuple[str, ...]


def subtables(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the name and type of each table within a table, also of those that may be left out."""
    for key, info in model.model_fields.items():
        for kind in (info.annotation, *get_args(info.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield f"{prefix}{key}", kind


MODELS: dict[str, type[BaseModel]] = {
    # Keys of a robot stand on the page of its kind.
    **{name: model for name, model in subtables(Scenario) if name != "robot"},
    "robot.tether": Tether,
    "robot.motor": Motor,
    "robot.motor.winding": Winding,
    **dict(subtables(FeedbackTable, "control.parameters.")),
    "control.parameters.paper": PaperTable,
    "control.parameters.driven": DrivenTable,
    "control.parameters.policy": PolicyTable,
    **dict(subtables(SensingTable, "sensing.")),
    "sweep": SweepFile,
    "study": StudyFile,
    "study.variable": Variable,
    "study.objective": Objective,
    "study.final": Final,
    "network": Network,
    "network.place": Origin,
    "network.joint": Joint,
    "gym.options": EnvOptions,
}
"""Models by the names that pages have for their tables."""


def table(head: Row, rows: Iterable[Row]) -> str:
    """Return a table of Markdown."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows))


def rows_of_channels() -> Iterator[Row]:
    """Yield a row for each channel of the omnidirectional robot."""
    for one in CHANNELS.values():
        shape = " x ".join(map(str, one.shape)) or "-"
        seen, kept = ("yes" if it else "-" for it in (one.source == "plant", one.recorded))
        cells = (f"`{one.name}`", one.unit, shape, one.frame or "-")
        yield (*cells, one.tail_first, seen, kept, one.meaning)


def rows_of_names(those: Iterable[channels.Channel | metrics.Metric]) -> Iterator[Row]:
    """Yield a row for each channel or metric: name, unit, meaning."""
    return ((f"`{one.name}`", one.unit, one.meaning) for one in those)


def attributes_of(model: type[BaseModel]) -> dict[str, str]:
    """Return the meanings of keys that stand under ``Attributes`` in a model's docstrings."""
    texts = (inspect.cleandoc(one.__dict__.get("__doc__") or "") for one in model.__mro__)
    blocks = "\n".join(text.partition("Attributes:\n")[2].partition("\n\n")[0] for text in texts)
    named = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", blocks, re.MULTILINE)
    return {key: " ".join(text.split()) for key, text in named}


def rows_of(model: type[BaseModel]) -> Iterator[Row]:
    """Yield key, default, unit and meaning of each key of a model, but for its subtables."""
    meanings = attributes_of(model) | dict(meanings_of(model))
    for key, info in model.model_fields.items():
        default = info.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            continue
        absent = default in (None, (), {}) or default is PydanticUndefined
        value = "" if absent else json.dumps(to_jsonable_python(default))
        yield f"`{key}`", value, symbol_of(model, key), meanings[key]


def rows_of_pipes() -> Iterator[Row]:
    """Yield the keys of a pipe, each with the kinds of fitting that have it."""
    kinds: dict[Row, list[str]] = {}
    for kind in shipped_fittings():
        for row in rows_of(table_of(kind, Pipe)):
            kinds.setdefault(row, []).append(kind)
    for (key, *rest), have in kinds.items():
        yield key, "all" if len(have) == len(shipped_fittings()) else ", ".join(have), *rest


def rows_of_relief() -> Iterator[Row]:
    """Yield the keys of each kind of relief."""
    for name, kind in relief_kinds().items():
        for number, (key, *rest) in enumerate(rows_of(kind)):
            yield f"`{name}`" if number == 0 else "", key, *rest


def rows_of_files(noun: str) -> Iterator[Row]:
    """Yield the shipped files of a kind, each with the comment at its head."""
    (kind,) = (kind for kind in KINDS if kind.noun == noun)
    for name, path in kind.shipped().items():
        yield f"`{name}`", comment(path)


def rows_of_plots() -> Iterator[Row]:
    """Yield the public functions that draw figures."""
    for name in ot.__all__:
        if name.startswith("plot_"):
            function = getattr(ot, name)
            about = " ".join((inspect.getdoc(function) or "").partition("\n\n")[0].split())
            yield (
                f"`ot.{name}`",
                about,
                "yes" if "ax" in inspect.signature(function).parameters else "",
            )


def rows_of_courses(suite: Suite) -> Iterator[Row]:
    """Yield the courses of a benchmark."""
    return ((f"`{course.name}`", course.words) for course in suite.courses.values())


def rows_of_ladders(suite: Suite) -> Iterator[Row]:
    """Yield the courses of a benchmark, those that differ by their size alone in one row."""
    sizes: dict[str, list[str]] = {}
    words: dict[str, str] = {}
    for course in suite.courses.values():
        name, size = course.ladder or course.name, f"{course.size:g}" if course.ladder else ""
        sizes.setdefault(name, []).append(size)
        words.setdefault(name, course.words.removesuffix(f", {size}"))
    return ((f"`{name}`", words[name], ", ".join(own)) for name, own in sizes.items())


def conditions() -> dict[str, Condition]:
    """Return the shipped conditions by name, the best first."""
    own = {name: load_condition(name) for name in shipped_files("conditions")}
    return dict(sorted(own.items(), key=lambda one: sum(d.per_km for d in one[1].defects)))


def rows_of_conditions() -> Iterator[Row]:
    """Yield the kinds of defects, each with its rate and sizes in the shipped conditions."""
    tables = [{defect.kind: defect for defect in one.defects} for one in conditions().values()]
    for kind in dict.fromkeys(kind for one in tables for kind in one):
        drawn = [one.get(kind) for one in tables]
        texts = [f"{d.per_km:g} a km, {d.size[0]:g} to {d.size[1]:g}" if d else "-" for d in drawn]
        yield f"`{kind}`", *texts


def keys_of(keys: Sequence[Key]) -> str:
    """Return the keys of a window."""
    return table(("key", "what it does"), ((key.name, key.meaning) for key in keys))


def rows_of_features() -> Iterator[Row]:
    """Yield what learners observe of the omnidirectional robot, with the least set that has it."""
    for one in FEATURE_SETS["truth"]:
        least = next(name for name, features in FEATURE_SETS.items() if one in features)
        size, bounds = str(one.size), f"{one.low:.4g} to {one.high:.4g}"
        yield f"`{one.name}`", size, one.unit, bounds, least, one.meaning


KEYS = ("key", "default", "unit", "meaning")
NAMED = ("name", "unit", "meaning")
TABLES: dict[str, Callable[[], str]] = {
    "scenarios": lambda: table(
        ("scenario", "what it shows"),
        (row for row in rows_of_files("scenario") if not row[0].startswith("`missions/")),
    ),
    "missions": lambda: table(
        ("mission", "what it shows"),
        (row for row in rows_of_files("scenario") if row[0].startswith("`missions/")),
    ),
    "networks": lambda: table(("network", "what it holds"), rows_of_files("network")),
    "sweeps": lambda: table(("sweep", "what it answers"), rows_of_files("sweep")),
    "studies": lambda: table(("study", "what it answers"), rows_of_files("study")),
    "conditions": lambda: table(
        ("defect", *(f"`{name}`" for name in conditions())), rows_of_conditions()
    ),
    "pipes": lambda: table(("key", "of", *KEYS[1:]), rows_of_pipes()),
    "relief": lambda: table(("`kind`", *KEYS), rows_of_relief()),
    "bench.mobility": lambda: table(
        ("course", "what the robot does"), rows_of_courses(load_suite("mobility"))
    ),
    "bench.as_built": lambda: table(
        ("course", "what the robot does", "sizes, bores"), rows_of_ladders(load_suite("as_built"))
    ),
    "bench.control": lambda: table(
        ("course", "what the robot does"), rows_of_courses(load_suite("control"))
    ),
    "bench.controllers": lambda: table(
        ("entry", "what drives"),
        ((f"`{entry.name}`", entry.words) for entry in load_suite("control").entries.values()),
    ),
    "plots": lambda: table(("function", "draws", "takes `ax`"), rows_of_plots()),
    "outcomes": lambda: table(
        ("outcome", "what it says"),
        ((f"`{one.value}`", default_robot().advice(one)) for one in Outcome),
    ),
    "channels": lambda: table(
        ("channel", "unit", "shape", "frame", "tail first", "seen", "recorded", "meaning"),
        rows_of_channels(),
    ),
    "metrics.common": lambda: table(NAMED, rows_of_names(metrics.COMMON_METRICS)),
    "metrics": lambda: table(
        ("metric", "unit", "modules", "meaning"),
        (
            (f"`{one.name}`", one.unit, str(MODULES) if one.per_module else "", one.meaning)
            for one in METRICS
        ),
    ),
    "estimates": lambda: table(
        NAMED, rows_of_names((*metrics.ESTIMATES, *metrics.ESTIMATE_METRICS))
    ),
    "keys.view": lambda: keys_of(VIEW),
    "keys.replay": lambda: keys_of(REPLAY),
    "keys.drive": lambda: keys_of(DRIVE),
    "gym.observations": lambda: table(
        ("entry", "size", "unit", "range", "from", "meaning"), rows_of_features()
    ),
    "gym.reward": lambda: table(
        ("term", "unit", "weight", "meaning"),
        ((f"`{one.name}`", one.unit, f"{one.weight:g}", one.meaning) for one in TERMS.values()),
    ),
    "gym.trials": lambda: table(
        ("value", "range"),
        ((f"`{path}`", f"{low:g} to {high:g}") for path, (low, high) in Decisions.ranges.items()),
    ),
}
"""Further tables by name."""


def made(name: str) -> str:
    """Return the table of a name, as Markdown."""
    return TABLES[name]() if name in TABLES else table(KEYS, rows_of(MODELS[name]))


def with_tables(text: str) -> str:
    """Return a page with its tables made anew."""
    return MARK.sub(
        lambda mark: f"<!-- table: {mark['name']} -->\n{made(mark['name'])}\n<!-- end -->", text
    )


def pages_to_write() -> dict[Path, str]:
    """Return the pages whose tables differ from the code, with what they should be."""
    pages = {page: page.read_text(encoding="utf-8") for page in sorted(ROOT.glob("docs/**/*.md"))}
    new = {page: with_tables(text) for page, text in pages.items()}
    return {page: text for page, text in new.items() if text != pages[page]}


def main(arguments: Sequence[str]) -> int:
    """Write or check the tables of all pages; returns the exit status."""
    if list(arguments) not in (["--write"], ["--check"]):
        print("usage: python docs/site/tables.py --write | --check", file=sys.stderr)
        return 2
    differing = pages_to_write()
    for page, text in differing.items():
        print(f"differs: {page.relative_to(ROOT)}")
        if arguments[0] == "--write":
            page.write_text(text, encoding="utf-8")
    if differing and arguments[0] == "--check":
        print("run `python docs/site/tables.py --write`")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
