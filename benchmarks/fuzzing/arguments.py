"""Odd arguments for every command: names, numbers, settings, places."""

from __future__ import annotations

import random
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fuzzing import bases, values
from fuzzing.desk import Desk
from fuzzing.values import Raw
from fuzzing.writing import toml

if TYPE_CHECKING:
    from omnitrack_sim import Simulation

SECONDS = 30.0
"""Processor time that a command may take."""
REAL = 15
"""Every which command is run as a process of its own."""
SMALL_FILES = 16 << 10
"""Largest file that may be written where the disk is to be full, bytes."""
ODD_NAMES = 0.4
"""Part of the cases whose files have odd names in them."""
FULL = 0.15
"""Part of the cases whose disk is full."""
PLACES = (
    *(
        "new",
        "new/sub/deep",
        "file",
        "file/below",
        "others",
        "nowhere",
        "loop",
        "loop/x",
        ".",
        "..",
        "",
    ),
    *("/proc/x", "/sys/x.png", "/proc/self/x/y", "n" * 250, "n" * 300, "名" * 90, "a\nb", "-", "~"),
    *(
        "x.png",
        "x.svg",
        "x.pdf",
        "x.PNG",
        "x.",
        ".png",
        "x.tiff",
        "x.mp4",
        "x.gif",
        "png",
        "folder.png",
    ),
    *(
        "\x1b[31mred.png",
        "$x$.png",
        "[bold]x.png",
        "\udcff.png",
        "a b.png",
        "x.png/",
        "n" * 251 + ".png",
    ),
    *("earlier", "earlier/result.json", "readonly/x", "device.png", "nowhere/x.png", "a/../x.png"),
)
PATHS = (
    *("robot.preload", "robot.scale", "world.friction", "physics.timestep", "pipes.0.length"),
    *("pipes.0.kind", "pipes.9.length", "pipes.-1.length", "pipes.0", "pipes", "robot", "name"),
    *(
        "control.kind",
        "control.parameters.gain",
        "control.parameters",
        "start.axis",
        "start.axis.0",
    ),
    *("world.gravity", "robot.motor", "robot.motor.gear_ratio", "mission.goals.0", "network", ""),
    *(
        ".",
        "..",
        "a..b",
        "a" * 300,
        ".".join(["a"] * 3000),
        "seed",
        "run.goal_distance",
        "run.expected_outcome",
    ),
    *(
        "record.sensors",
        "physics.collider",
        "run.time_limit",
        "naem",
        "robot.prelaod",
        "$",
        "\x1b[0m",
    ),
)


def prepare() -> None:
    """Load what the cases need, and make the folder of an earlier run."""
    from fuzzing import reading

    reading.prepare()
    bases.runs()


def command_of(seed: int, number: int) -> tuple[list[str], bool]:
    """The arguments of that number, and whether the disk is full."""
    rng = random.Random(f"arguments {seed} {number}")
    return rng.choice(_COMMANDS)(rng), rng.random() < FULL


def attempt(seed: int, number: int, desk: Desk) -> None:
    """Run the command of that number among odd files; what is refused must leave nothing behind."""
    arguments, full = command_of(seed, number)
    _furnish(desk.folder, random.Random(f"furniture {seed} {number}"))
    before = _files(desk.folder)
    desk.real = number % REAL == 0
    statuses = (0, 1, 2) if arguments[:1] == ["models"] else (0, 2)
    with _steps() as taken:
        status = desk.command(arguments, SECONDS, statuses, SMALL_FILES if full else None)
    if status == 2 and taken and not full:
        desk.add("refused after the run", f"omnitrack {arguments[0]}", desk.output[1][:300])
    now = _files(desk.folder)
    refused = status in (None, 2)
    lost = [p for p, size in before.items() if now.get(p, size if size < 0 else None) is None]
    changed = [p for p, size in before.items() if refused and now.get(p, size) != size]
    # A sweep keeps what it has, to go on from.
    whole = refused and arguments[:1] != ["sweep"]
    left = [path for path in now if path not in before and (whole or _is_leftover(path))]
    for what, paths in (("left behind", left), ("files lost", lost), ("files changed", changed)):
        if paths:
            desk.add(what, f"omnitrack {' '.join(arguments[:1])}", ", ".join(paths)[:300])


@contextmanager
def _steps() -> Iterator[list[float]]:
    """A list that the simulations of this process fill while they run."""
    from omnitrack_sim import Simulation

    step, taken = Simulation.step, list[float]()

    def counted(simulation: Simulation, *given: Any) -> None:
        taken[:] = [simulation.period]
        step(simulation, *given)

    Simulation.step = counted
    try:
        yield taken
    finally:
        Simulation.step = step


def keep(seed: int, number: int, folder: Path) -> None:
    """Keep the arguments of a case."""
    arguments, full = command_of(seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    text = shlex.join(["omnitrack", *arguments]) + ("  # full disk" if full else "")
    file = folder / f"arguments_{seed}_{number}.txt"
    file.write_text(f"{text}\n", encoding="utf-8", errors="backslashreplace")


def _furnish(folder: Path, rng: random.Random) -> None:
    """Things that stand in the way, and two files whose names are odd now and then."""
    (folder / "file").write_text("a file")
    (folder / "others").mkdir()
    (folder / "others" / "thing.txt").write_text("a thing")
    (folder / "folder.png").mkdir()
    (folder / "nowhere").symlink_to("nothing/there")
    (folder / "loop").symlink_to("loop")
    (folder / "readonly").mkdir(mode=0o555)
    bases.lay_out(bases.runs()["plain"], folder / "earlier")
    odd = rng.random() < ODD_NAMES
    name, part, label = (values.text(rng) if odd else word for word in ("pipe", "part", "slippery"))
    axis = {
        "path": "world.friction",
        "kind": "list",
        "values": [0.5, 0.9],
        "labels": [label, "b"],
    }
    sweep = {"base": "straight", "set": {"run.time_limit": 0.05}, "axes": [axis]}
    pipe = {"kind": "straight", "length": 0.5, "name": part}
    (folder / "small.toml").write_text(toml(sweep), encoding="utf-8")
    (folder / "pipe.toml").write_text(toml({"name": name, "pipes": [pipe]}), encoding="utf-8")


def _files(folder: Path) -> dict[str, int]:
    """Sizes of the files below a folder by path, and hidden folders with -1."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink() or path.is_file():
            found[name] = path.lstat().st_size
        elif path.name.startswith("."):
            found[name] = -1
    return found


def _is_leftover(path: str) -> bool:
    name = path.rpartition("/")[2]
    return name == "MUJOCO_LOG.TXT" or (name.startswith(".") and name != ".png")


def _number(rng: random.Random) -> str:
    value = values.number(rng, rng.choice((0.16, 3, 90, 60)))
    return value.text if isinstance(value, Raw) else str(value)


def _argument(rng: random.Random) -> str:
    """An odd text as an argument can be: without NUL, and of a length that a shell takes."""
    return values.text(rng).replace("\x00", "")[:50_000]


def _place(rng: random.Random) -> str:
    return rng.choice(PLACES)


def _setting(rng: random.Random) -> str:
    """An odd ``PATH=VALUE``."""
    if rng.random() < 0.1:
        return _argument(rng)
    value = rng.choice(
        (_number, _number, _argument, lambda rng: values.nested(rng).text, lambda _: "[1, 2, 3]")
    )(rng)
    return f"{rng.choice(PATHS)}={value}"


def _some(rng: random.Random, **options: Callable[[random.Random], str]) -> list[str]:
    """One or two of the options with odd values."""
    names = rng.sample(sorted(options), min(len(options), rng.choice((1, 1, 2))))
    return [part for name in names for part in (f"--{name.replace('_', '-')}", options[name](rng))]


def _run(rng: random.Random) -> list[str]:
    name = rng.choice(("straight", "pipe.toml", "pipe.toml", _argument(rng), _place(rng)))
    short = ["--set", "run.time_limit=0.02"]
    rest = _some(rng, set=_setting, out=_place, camera=_argument)
    video = [] if "--camera" in rest or rng.random() < 0.1 else ["--no-video"]
    as_json = ["--json"] if rng.random() < 0.3 else []
    return ["run", *video, *rest, *short, *as_json, "--", name]


def _render(rng: random.Random) -> list[str]:
    name = rng.choice(("earlier", "earlier", _place(rng), _argument(rng)))
    told = _some(rng, camera=_argument, out=_place, size=_argument, strip=_argument, at=_argument)
    return ["render", *told, "--", name]


def _sweep(rng: random.Random) -> list[str]:
    name = rng.choice(("small.toml", "small.toml", _argument(rng), _place(rng)))
    if rng.random() < 0.5:
        return ["sweep", "--list", *_some(rng, set=_setting, shard=_argument), "--", name]
    rest = _some(rng, out=_place, shard=_argument, set=_setting)
    more = ["--continue"] if rng.random() < 0.2 else []
    return ["sweep", *rest, *more, "--workers", "1", "--", name]


def _network(rng: random.Random) -> list[str]:
    if rng.random() < 0.3:
        made = _some(rng, random=_number, fittings=_number)
        return ["network", *made, *_some(rng, out=_place, plot=_place)]
    name = rng.choice(("fig14", "fig14", "tower", _argument(rng), _place(rng)))
    ends = {"from": lambda rng: rng.choice(("inlet", "low", _argument(rng)))}
    ends |= {"to": ends["from"], "avoid": _argument}
    way = ["--from", "inlet", "--to", "low"] if rng.random() < 0.3 else _some(rng, **ends)
    saved = _some(rng, plot=_place, out=_place, export=_place) if rng.random() < 0.6 else []
    return ["network", *way, *saved, "--", name]


def _singularity(rng: random.Random) -> list[str]:
    sizes = ("pipe_diameter", "reach", "sector_deg", "turn_angle_deg", "modules", "contact_length")
    angles = ("bend_radius", "theta5_deg", "roll_deg")
    options: dict[str, Callable[[random.Random], str]] = dict.fromkeys((*sizes, *angles), _number)
    more = _some(rng, plot=_place, figure=_figure, definition=_argument)
    return ["singularity", *_some(rng, **options), *(more if rng.random() < 0.5 else [])]


def _figure(rng: random.Random) -> str:
    known = ("all", "sections", "orientations", "sector", "definitions", "map")
    return rng.choice((*known, _argument(rng)))


def _others(rng: random.Random) -> list[str]:
    return rng.choice(
        (
            ["models", "--check", "--root", _place(rng)],
            ["models", "--write", "--root", rng.choice(("file", "/proc", "nowhere", "loop"))],
            ["models"],
            ["parameters", "--", rng.choice((_argument(rng), _place(rng), "pipe.toml"))],
            ["scenarios", "--json"],
            ["view", "--", rng.choice((_argument(rng), "straight"))],
            ["view", "--set", _setting(rng), "--", "straight"],
            ["view", "--speed", _number(rng), "--", _place(rng)],
            ["drive", "--speed", _number(rng), "--", rng.choice((_argument(rng), "straight"))],
            ["drive", "--out", _place(rng), "--set", _setting(rng), "--", "straight"],
            ["reproduce", "--format", _argument(rng)],
            ["reproduce", "--out", rng.choice(("file", "others", "file/below", "loop"))],
            [_argument(rng)],
            [rng.choice(("--version", "--help", "--", "-x"))],
            [],
        )
    )


_COMMANDS = (_run, _run, _render, _sweep, _network, _network, _singularity, _others)
