"""The package's layers, its light import, and the built wheel."""

import ast
import os
import shutil
import subprocess
import sys
import venv
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_imports_go_one_way():
    """The import contracts of pyproject.toml hold."""
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports")], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout


def test_import_is_light():
    """Importing the package loads neither MuJoCo nor matplotlib nor pyarrow nor Gymnasium nor the
    mesh libraries."""
    heavy = (
        "mujoco",
        "matplotlib",
        "pyarrow",
        "trimesh",
        "manifold3d",
        "pydantic",
        "imageio",
        "av",
        "gymnasium",
    )
    code = f"import sys, omnitrack_sim; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_reading_a_scenario_loads_no_physics():
    """A scenario file and the parameters of its robot are read without MuJoCo, plots and meshes."""
    heavy = ("mujoco", "matplotlib", "pyarrow", "trimesh", "manifold3d", "imageio")
    code = f"""
import sys, omnitrack_sim as ot
scenario = ot.load_scenario("tee_turn")
scenario.route, scenario.robot.mass, scenario.robot.parameters(), scenario.controller_class
print([m for m in {heavy} if m in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_imported_name_is_there():
    """Each name that a module of the package takes from another one, also within a function, is
    there. Pyright does not look: MuJoCo's bindings are only partly typed."""
    for file in sorted((ROOT / "omnitrack_sim").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            if module is None or not module.startswith("omnitrack_sim"):
                continue
            if ROOT / "omnitrack_sim/warp" in file.parents and find_spec("mujoco_warp") is None:
                continue  # an extra that is not here
            for name in (alias.name for alias in node.names):
                found = hasattr(import_module(module), name)
                assert found or find_spec(f"{module}.{name}"), f"{file.name}: {module}.{name}"


def test_every_public_name_is_there():
    """Each name of __all__ can be had from the package."""
    import omnitrack_sim

    for name in omnitrack_sim.__all__:
        assert getattr(omnitrack_sim, name) is not None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Python, the folder of the built and installed wheel, and an environment that finds it."""
    place = tmp_path_factory.mktemp("wheel")
    build = ["build", "--wheel", "--no-isolation", "--outdir", place / "dist", ROOT]
    _succeeds(sys.executable, "-m", *build)
    venv.create(place / "env", with_pip=False)
    target = next((place / "env" / "lib").glob("python*")) / "site-packages"
    (built,) = (place / "dist").glob("*.whl")
    install = ["pip", "install", "-q", "--no-deps", "--no-index", "--target", target, built]
    _succeeds(sys.executable, "-m", *install)
    # Compiled walls are those of the checkout: to compile them again takes some 10 s.
    for code in (ROOT / "omnitrack_sim").rglob("__pycache__/*.o"):
        folder = target / code.relative_to(ROOT).parent
        folder.mkdir(exist_ok=True)
        shutil.copy(code, folder)
    # The dependencies come from the environment of the tests, behind the wheel and without the
    # checkout.
    dependencies = [p for p in sys.path if p.endswith("site-packages")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(target), *dependencies])}
    return place / "env" / "bin" / "python", target, environment


def _succeeds(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def _with(wheel, folder, *arguments):
    """What Python ends with in a folder, where it finds the wheel and not the checkout."""
    python, _, environment = wheel
    command = [python, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.mark.long
def test_the_wheel_is_what_runs(wheel, tmp_path):
    """What the other tests of the wheel run is the installed package, not the checkout."""
    done = _with(wheel, tmp_path, "-c", "import omnitrack_sim; print(omnitrack_sim.__file__)")
    assert done.returncode == 0, done.stderr
    assert str(wheel[1]) in done.stdout


@pytest.mark.long
def test_the_wheel_runs_a_scenario_by_name(wheel, tmp_path):
    """The scenarios and the scripts of replay pages are with it."""
    short = ("--no-video", "--set", "run.time_limit=0.1")
    done = _with(wheel, tmp_path, "-m", "omnitrack_sim.cli", "run", "tee_turn", *short)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "tee_turn" / "result.json").is_file()
    assert (tmp_path / "out" / "tee_turn" / "replay.html").is_file()


@pytest.mark.long
def test_the_wheel_says_that_the_models_are_not_with_it(wheel, tmp_path):
    """The published models live in a checkout."""
    done = _with(wheel, tmp_path, "-m", "omnitrack_sim.cli", "models", "--check")
    assert done.returncode == 2
    assert "checkout of the project" in " ".join(done.stderr.split())
