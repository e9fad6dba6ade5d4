"""Generated files on disk: all of them whole, or none."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from omnitrack_sim.errors import OutputError


def write_files(files: Mapping[Path, bytes]) -> list[Path]:
    """Write files by their paths; returns the paths. Missing folders are made.

    Every file is first written beside its place under another name. Only when all are there do they
    take their places, so that a full disk or a folder without permission leaves all as it was.

    Raises:
        OutputError: a file cannot be written; it is named.
    """
    ready: dict[Path, Path] = {}
    with contextlib.ExitStack() as undo:
        for index, (path, content) in enumerate(files.items()):
            with _told(path):
                undo.enter_context(_made(path.parent))
                ready[path] = path.parent / f".omnitrack_{os.getpid()}_{index}.tmp"
                undo.callback(ready[path].unlink, missing_ok=True)
                ready[path].write_bytes(content)
                if path.is_dir():
                    raise IsADirectoryError(0, "is a folder")
        for path, temporary in ready.items():
            with _told(path):
                os.replace(temporary, path)
    return list(files)


@contextlib.contextmanager
def _made(folder: Path) -> Iterator[None]:
    """``folder`` exists from here on. If it was made here and is empty in the end it goes again."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(0, "its folder is a file")
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for parent in missing:
            with contextlib.suppress(OSError):
                parent.rmdir()


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn an error of the system into an ``OutputError`` that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
