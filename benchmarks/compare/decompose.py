"""CoACD in a process of its own: it can take minutes and, on some meshes, ends the process.

python decompose.py MESH.npz PIECES.npz '{"threshold": 0.05}'
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from omnitrack_sim.base.rotations import Array


class DecompositionError(RuntimeError):
    """CoACD gave no pieces: it failed, or it ran out of time."""


def convex_pieces(
    mesh: trimesh.Trimesh, settings: dict[str, Any], folder: Path, limit_s: float
) -> tuple[list[tuple[Array, np.ndarray]], float]:
    """Convex pieces (vertices, faces) of a solid, and the seconds that they took.

    They are kept in ``folder`` for the next time.

    Raises:
        DecompositionError: no pieces within ``limit_s`` seconds. This too is kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32)
    content = vertices.tobytes() + faces.tobytes() + json.dumps(settings, sort_keys=True).encode()
    stem = folder / hashlib.sha256(content).hexdigest()[:16]
    source, target, failure = (stem.with_suffix(s) for s in (".mesh.npz", ".npz", ".txt"))
    if failure.is_file():
        raise DecompositionError(failure.read_text(encoding="utf-8"))
    if not target.is_file():
        np.savez(source, vertices=vertices, faces=faces)
        reason = _run(source, target, settings, limit_s)
        source.unlink(missing_ok=True)
        if reason is not None:
            failure.write_text(reason, encoding="utf-8")
            raise DecompositionError(reason)
    with np.load(target) as kept:
        count, seconds = int(kept["count"]), float(kept["seconds"])
        return [(kept[f"vertices_{i}"], kept[f"faces_{i}"]) for i in range(count)], seconds


def _run(source: Path, target: Path, settings: dict[str, Any], limit_s: float) -> str | None:
    """Why there are no pieces; None when there are."""
    command = [sys.executable, __file__, str(source), str(target), json.dumps(settings)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return f"CoACD was not done within {limit_s:.0f} s"
    if done.returncode != 0 or not target.is_file():
        lines = done.stderr.strip().splitlines() or ["no message"]
        return f"CoACD ended with status {done.returncode}: {lines[-1]}"
    return None


def main() -> None:
    """Decompose the mesh of the command line."""
    import coacd

    source, target, settings = Path(sys.argv[1]), Path(sys.argv[2]), json.loads(sys.argv[3])
    coacd.set_log_level("error")
    with np.load(source) as mesh:
        solid = coacd.Mesh(mesh["vertices"], mesh["faces"])
    start = time.process_time()
    pieces = coacd.run_coacd(solid, **settings)
    seconds = time.process_time() - start
    arrays = {f"vertices_{i}": v for i, (v, _) in enumerate(pieces)} | {
        f"faces_{i}": np.asarray(f) for i, (_, f) in enumerate(pieces)
    }
    partial = target.with_suffix(".part.npz")
    np.savez(partial, count=len(pieces), seconds=seconds, **arrays)
    partial.rename(target)


if __name__ == "__main__":
    main()
