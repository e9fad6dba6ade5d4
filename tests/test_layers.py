"""The package's layers, its light import, and the built wheel."""

import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_imports_go_one_way():
    """The import contracts of pyproject.toml hold."""
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports")], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout


def test_import_is_light():
    """Importing the package loads neither MuJoCo nor matplotlib nor pyarrow nor the mesh
    libraries."""
    heavy = (
        "mujoco",
        "matplotlib",
        "pyarrow",
        "trimesh",
        "manifold3d",
        "pydantic",
        "imageio",
        "av",
    )
    code = f"import sys, omnitrack_sim; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there():
    """Each name of __all__ can be had from the package."""
    import omnitrack_sim

    for name in omnitrack_sim.__all__:
        assert getattr(omnitrack_sim, name) is not None


def test_the_wheel_works_alone(tmp_path):
    """The built wheel, installed elsewhere, runs a scenario by name, and says that the published
    models are not with it."""
    build = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(tmp_path / "dist"),
        str(ROOT),
    ]
    subprocess.run(build, check=True, capture_output=True, text=True)
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    target = next((tmp_path / "env" / "lib").glob("python*")) / "site-packages"
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--target",
        str(target),
        str(wheel),
    ]
    subprocess.run(install, check=True, capture_output=True, text=True)
    # The dependencies come from the environment of the tests, behind the wheel and without the
    # checkout.
    dependencies = [p for p in sys.path if p.endswith("site-packages")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(target), *dependencies])}
    command = [
        python,
        "-m",
        "omnitrack_sim.cli",
        "run",
        "tee_turn",
        "--no-video",
        "--set",
        "physics.time_limit=0.1",
    ]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "tee_turn" / "result.json").is_file()
    check = [*command[:3], "models", "--check"]
    done = subprocess.run(check, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert "checkout of the project" in " ".join(done.stderr.split())
    where = subprocess.run(
        [python, "-c", "import omnitrack_sim; print(omnitrack_sim.__file__)"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert str(target) in where.stdout
