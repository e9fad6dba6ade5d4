"""Files and folders that are written whole or not at all.

What is written is made in a *workshop*, a hidden folder beside the place where it is to stand, with
a lock that is held for as long as its process lives. When it is whole it is moved to its place. A
folder that stands there is moved into the workshop just before: of a process that is killed between
the two moves, ``tidy`` finishes the second one. Every check of a place, and everything that reads a
folder, tidies first; workshops without a lock are then taken away.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, OutputError

_PREFIX, _SUFFIX = ".omnitrack-", ".tmp"
_WORKSHOP = re.compile(r"\.omnitrack-[a-z0-9_]{8}\.tmp")
_NEW, _OLD, _LOCK = "new", "old", "lock"
"""Contents of a workshop: what is being made, a folder with the one that it replaces, under its own
name, and the file that is locked."""
_ROOM = "x" * 100
"""As long as what a path in a workshop has more than the path that it replaces."""


def format_of(path: object, format: str | None, what: str, formats: tuple[str, ...]) -> str:
    """Return the requested format of a file, or else that of its path's ending.

    Args:
        path: of the file that is to be written.
        format: the requested one; None for that of the ending.
        what: word for the kind of file.
        formats: valid formats.

    Raises:
        InputError: it is none of ``formats``.
    """
    ending = Path(str(path)).suffix[1:].lower()
    chosen = format or ending
    if chosen in formats:
        return chosen
    problem = f"has the {what} format {chosen!r}"
    if not chosen:
        is_folder = os.path.isdir(str(path))
        problem = "is a folder; name a file in it" if is_folder else "has no ending"
        problem += f"; the ending says the {what} format"
    raise InputError(Fault(str(path), problem, formats))


@contextmanager
def as_output_error(path: str | Path) -> Iterator[None]:
    """Turn an error of the system into an ``OutputError`` that names the place."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path whose file replaces ``path`` when the block ends without an error.

    The file is flushed to the disk first, so that it survives a machine that stops.

    Raises:
        OutputError: ``path`` is a folder or a device, or the disk is full or closed to us.
    """
    with as_output_error(path), _whole(_file_place(path)) as new:
        yield new


def write_file(path: str | Path, data: bytes) -> None:
    """Write a file of known contents as ``whole_file`` does."""
    with whole_file(path) as part:
        part.write_bytes(data)


def npz_of(arrays: Mapping[str, Any]) -> bytes:
    """Pack arrays as ``numpy.savez_compressed`` does; equal arrays give equal bytes."""
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)
    return data.getvalue()


def write_files(files: Mapping[Path, bytes]) -> list[Path]:
    """Write files by their paths and return the paths; create missing folders.

    No file takes its place before all are written.

    Raises:
        OutputError: a file cannot be written; it is named.
    """
    with ExitStack() as stack:
        for path, data in files.items():
            stack.enter_context(_made(path.parent))
            stack.enter_context(whole_file(path)).write_bytes(data)
    return [*files]


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create ``folder`` if it is missing; remove it again if it is empty in the end."""
    with as_output_error(folder):
        missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        # Innermost first; a folder that has contents by now cannot be removed, and stays.
        for parent in missing:
            with suppress(OSError):
                parent.rmdir()


@contextmanager
def whole_folder(directory: str | Path, mark: str) -> Iterator[Path]:
    """Yield a temporary folder that replaces ``directory`` when the block ends without an error.

    Its files are flushed to the disk first, so that they survive a machine that stops.

    ``mark`` is the file by which a folder that may be replaced is known.

    Raises:
        OutputError: ``directory`` holds other things, or the disk is full or closed to us.
    """
    with as_output_error(directory):
        target = _folder_place(directory, mark)
        target.parent.mkdir(parents=True, exist_ok=True)
        with _whole(target) as new:
            new.mkdir()
            yield new


@contextmanager
def _whole(target: Path) -> Iterator[Path]:
    """Yield a path in a workshop; what is there in the end is flushed and replaces ``target``."""
    with _workshop(target.parent) as shop:
        new = shop / _NEW
        yield new
        for path in (new, *new.rglob("*")):
            _flush(path)
        _put(shop, target)
        # A name is part of the folder above, which has to reach the disk, too.
        _flush(target.parent)


def check_file(path: str | Path) -> None:
    """Raise an ``OutputError``, before any work, for a place where no file can be written."""
    with as_output_error(path):
        _try_out(_file_place(path).parent)


def check_folder(directory: str | Path, mark: str | None = None, files: Iterable[str] = ()) -> None:
    """Refuse, before any work, a place where no folder can be written.

    Args:
        directory: may be missing, with the folders above it.
        mark: the file by which a folder that may be replaced is known; without one, files are only
            added to the folder.
        files: names of files that will be written into it.

    Raises:
        OutputError: it is a file, it holds other things, or it is closed to us.
    """
    with as_output_error(directory):
        target = _folder_place(directory, mark)
        there, names = target, [*files]
        # An earlier file of that name may be a folder, a device or protected.
        for name in files if target.is_dir() else ():
            _file_place(target / name)
        while not os.path.lexists(there):
            names.append(there.name)
            there = there.parent
        # The system looks at the length of a path before it looks for files.
        with suppress(FileNotFoundError, NotADirectoryError):
            os.lstat(target / _ROOM / max(files, key=len, default=""))
        _try_out(there, names)
        if mark is not None and there == target:
            _try_out(target.parent)


def tidy(folder: Path) -> None:
    """Finish or take away what killed processes left in a folder."""
    from filelock import FileLock  # only where something is left

    for shop in folder.iterdir():
        if is_workshop(shop.name):
            # A living process holds the lock: the attempt fails at once, and its workshop stays.
            with suppress(OSError):
                with FileLock(shop / _LOCK, blocking=False):
                    _finish(shop)
                shutil.rmtree(shop)


def whole(directory: str | Path) -> Path:
    """Return the path of a folder that may have been replaced by a process that was killed."""
    path = Path(directory)
    if not path.exists() and path.parent.is_dir():
        with suppress(OSError):
            tidy(path.parent)
    return path


def is_workshop(name: str) -> bool:
    """Return whether a file's name is that of a workshop."""
    return _WORKSHOP.fullmatch(name) is not None


def _place(path: str | Path) -> tuple[Path, int | None]:
    """Path with links resolved, and the mode of what is there; None where nothing is."""
    try:
        target = Path(os.path.realpath(path))
    except ValueError as error:  # a zero byte, or half a character
        raise OutputError(f"{os.fspath(path)!r}: is no name of a file: {error}") from error
    try:
        return target, os.lstat(target).st_mode
    except FileNotFoundError:
        return target, None


def _file_place(path: str | Path) -> Path:
    target, mode = _place(path)
    if mode is None and not target.parent.exists():
        folder = target.parent if os.path.islink(path) else Path(path).parent
        raise OutputError(f"{path}: the folder {folder} does not exist")
    if mode is not None and stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a folder; choose a file")
    if mode is not None and not stat.S_ISREG(mode):
        raise OutputError(f"{path}: is a device or the like; choose a file")
    if mode is not None and not os.access(target, os.W_OK):
        raise OutputError(f"{path}: cannot be written: it is protected")
    return target


def _folder_place(path: str | Path, mark: str | None) -> Path:
    target, mode = _place(path)
    if mode is not None and not stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a file; choose a folder")
    if mode is None or mark is None:
        return target
    if not (target / mark).is_file() and any(not is_workshop(p.name) for p in target.iterdir()):
        raise OutputError(
            f"{path}: holds files but no {mark}, so it is no run; choose another folder"
        )
    if os.path.ismount(target) or not os.access(target, os.W_OK):
        raise OutputError(f"{path}: cannot be replaced; choose a folder in it or beside it")
    return target


def _try_out(folder: Path, names: Iterable[str] = ()) -> None:
    """Make sure that workshops, and files of these names, can be made in a folder; tidy it."""
    # Only an attempt is certain: access rights say nothing of a full file system.
    with _workshop(folder) as shop:
        for name in names:
            (shop / name).touch()
        tidy(folder)


@contextmanager
def _workshop(folder: Path) -> Iterator[Path]:
    """Yield a locked workshop in a folder, and remove it in the end."""
    from filelock import FileLock  # what only reads does without it

    while True:
        shop = Path(tempfile.mkdtemp(_SUFFIX, _PREFIX, folder))
        lock = FileLock(shop / _LOCK)
        with suppress(FileNotFoundError):
            lock.acquire()
        if (shop / _LOCK).exists():  # nobody took it away before it was locked
            break
        lock.release()
    try:
        yield shop
    finally:
        with suppress(OSError):
            _finish(shop)
        lock.release()
        shutil.rmtree(shop, ignore_errors=True)


def _put(shop: Path, target: Path) -> None:
    """Move what a workshop has made to ``target``; an earlier folder goes into the workshop."""
    if target.is_dir():
        (shop / _OLD).mkdir()
        os.rename(target, shop / _OLD / target.name)
    os.replace(shop / _NEW, target)


def _finish(shop: Path) -> None:
    """Finish a replacement that ended between its two moves; undo it where that cannot be."""
    for old in (shop / _OLD).glob("*"):  # one at most
        target = shop.with_name(old.name)
        if not target.exists():
            try:
                os.rename(shop / _NEW, target)
            except OSError:
                os.rename(old, target)


def _flush(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    is_folder = path.is_dir()
    if is_folder and os.name == "nt":  # Windows keeps the names in folders itself
        return
    descriptor = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
