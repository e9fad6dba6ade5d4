"""General rooms know no robot by name: neither imports nor strings of code name the package's."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "omnitrack_sim"
OWN = ("robots/omnitrack/", "warp/omnitrack/", "paper/")
"""The robot's own folders, and the room of its paper."""
EXCEPTIONS = {
    "__init__.pyi": "lists the public names, those of the robot among them",
    "robots/kinds.py": "lists the robots of the package, and says which is the default",
    "robots/climber/__init__.py": "is a robot that is made of the other's parts",
    "cli/package.py": "`omnitrack models` writes the robot's published models",
    "cli/paper.py": "commands about the paper of the robot",
}
"""Files that name the robot, with the reason."""
NAMES = re.compile(r"robots[./]omnitrack|\bOmnitrack\b|omnidirectional|^omnitrack$")
"""The robot's class, folder, kind and nature; not the package's name, nor that of its command."""


def named_in(source: str) -> list[str]:
    """Return the imports, names and strings of a module that name the robot, by line.

    Examples in docstrings, which may take any robot, do not count.
    """
    found = []
    for node in ast.walk(ast.parse(source)):
        words: list[str] = []
        if isinstance(node, ast.Import):
            words = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            words = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            lines = node.value.splitlines()
            words = [line for line in lines if not line.lstrip().startswith((">>>", "..."))]
        elif isinstance(node, ast.Name):
            words = [node.id] if node.id != "omnitrack" else []
        elif isinstance(node, ast.Attribute):
            words = [node.attr] if node.attr != "omnitrack" else []
        found += [f"{node.lineno}: {word.strip()}" for word in words if NAMES.search(word)]
    return found


def modules() -> list[str]:
    """Return the modules of the package outside the robot's own, by their paths in it."""
    files = [path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py*")]
    return sorted(file for file in files if file.endswith((".py", ".pyi")))


@pytest.mark.parametrize("room", sorted({file.partition("/")[0] for file in modules()}))
def test_no_module_names_the_robot(room):
    """Neither an import nor a string names it, but in the files of ``EXCEPTIONS``."""
    told = {}
    for file in modules():
        if file.partition("/")[0] == room and not file.startswith(OWN) and file not in EXCEPTIONS:
            told[file] = named_in((PACKAGE / file).read_text(encoding="utf-8"))
    assert {file: places for file, places in told.items() if places} == {}


@pytest.mark.parametrize("file", EXCEPTIONS)
def test_every_exception_is_needed(file):
    """A file that no longer names the robot leaves the list."""
    assert named_in((PACKAGE / file).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "source",
    [
        "import omnitrack_sim.robots.omnitrack",
        "from omnitrack_sim.robots.omnitrack.motors import Motor",
        "from omnitrack_sim import Omnitrack",
        'kind = "omnitrack"',
        'name = "omnitrack_sim.robots.omnitrack.control:Own"',
        "robot = ot.Omnitrack()",
        'words = f"the omnidirectional robot {name}"',
    ],
)
def test_every_way_to_name_it_is_found(source):
    """Imports, strings, attributes and words."""
    assert named_in(source)


@pytest.mark.parametrize(
    "source",
    [
        "import omnitrack_sim as ot",
        'command = "omnitrack run tee_turn"',
        'def f():\n    """Sum.\n\n    >>> ot.Omnitrack().mass\n    1.0\n    """',
        "raise ot.OmnitrackError",
    ],
)
def test_the_package_and_its_command_are_no_robot(source):
    """Names that only begin as the robot's do."""
    assert not named_in(source)
