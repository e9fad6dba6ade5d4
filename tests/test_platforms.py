"""MuJoCo runs on macOS and Windows: nothing of the package asks for what only Linux has."""

import ast
import subprocess
import sys
from pathlib import Path

import omnitrack_sim

PACKAGE = Path(omnitrack_sim.__file__).parent
MODULES = ("fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")
"""Modules that Python on Windows lacks."""
NAMES = {
    "os": [
        *("fork", "forkpty", "geteuid", "getgid", "getuid", "killpg", "nice", "sched_getaffinity"),
        *("setsid", "statvfs", "sysconf", "wait4"),
    ],
    "signal": [
        *("SIGALRM", "SIGHUP", "SIGKILL", "SIGUSR1", "alarm", "pthread_sigmask", "setitimer"),
    ],
}
"""Names that ``os`` and ``signal`` lack there, or on macOS."""
HIDE = f"""
import os, signal, sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in {MODULES}:
            raise ModuleNotFoundError("No module named " + name, name=name)

for name in {MODULES}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hidden())
# The library's own, which took them as it was imported, keep theirs.
import asyncio, multiprocessing.pool, subprocess, concurrent.futures.process
for module, names in {NAMES}.items():
    for name in names:
        if hasattr(sys.modules[module], name):
            delattr(sys.modules[module], name)
"""


def without_linux(code: str, folder: Path) -> str:
    """What a program prints in a process without the modules and names of Linux."""
    done = subprocess.run(
        [sys.executable, "-c", HIDE + code], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_is_imported_without_those_of_linux(tmp_path):
    """But for the painter, which needs a context of OpenGL, the viewer's window, and what needs
    MuJoCo Warp."""
    code = """
import importlib, pkgutil
from importlib.util import find_spec
import omnitrack_sim
warp = "" if find_spec("mujoco_warp") else "omnitrack_sim.warp."
names = [one.name for one in pkgutil.walk_packages(omnitrack_sim.__path__, "omnitrack_sim.")]
for name in names:
    skipped = name.endswith((".painter", ".shaders", "__main__", ".window"))
    if not skipped and not (warp and name.startswith(warp)):
        importlib.import_module(name)
print(len(names))
"""
    assert int(without_linux(code, tmp_path)) > 150


def test_a_run_a_sweep_and_a_page_are_made_without_linux(tmp_path):
    """And read back; by the commands, as a user would."""
    (tmp_path / "two.toml").write_text(
        'base = "straight"\n'
        '[[axes]]\npath = "world.friction"\nkind = "list"\nvalues = [0.8, 0.9]\n',
        encoding="utf-8",
    )
    code = """
from omnitrack_sim import cli
import omnitrack_sim as ot
short = ("--set", "run.time_limit=0.1")
for command in (
    ("run", "straight", "--no-video", "--out", "a", *short),
    ("replay", "a", "--out", "b.html"),
    ("sweep", "two.toml", "--workers", "1", "--out", "s", *short),
):
    sys.argv = ["omnitrack", *command]
    try:
        cli.main()
    except SystemExit as ended:
        assert ended.code == 0, command
print(ot.load_result("a").outcome.value, ot.load_sweep_result("s").table.num_rows)
"""
    assert without_linux(code, tmp_path).splitlines()[-1] == "timed_out 2"
    assert (tmp_path / "b.html").stat().st_size > 100_000


def test_names_of_linux_are_asked_for_where_the_system_is():
    """Each in a function that looks at ``sys.platform``, or whether ``os`` has it."""
    for file in PACKAGE.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if not any(name in text for name in (*MODULES, *NAMES["os"], *NAMES["signal"])):
            continue
        tree = ast.parse(text)
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                if node.attr not in NAMES.get(node.value.id, ()):
                    continue
                inside = [f for f in functions if f.lineno <= node.lineno <= (f.end_lineno or 0)]
                source = "".join(ast.get_source_segment(text, f) or "" for f in inside)
                guarded = "sys.platform" in source or f'hasattr(os, "{node.attr}")' in source
                assert guarded, f"{file}:{node.lineno}: {node.value.id}.{node.attr}"
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [a.name for a in node.names] + [getattr(node, "module", None) or ""]
                assert not {name.partition(".")[0] for name in names} & {*MODULES}, file
