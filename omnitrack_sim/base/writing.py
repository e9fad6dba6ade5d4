"""Files and folders that are written whole or not at all.

What is written is made in a *workshop*: a hidden folder beside the place where it is to stand,
which is locked for as long as its process lives. When it is whole, it takes its place in one step.
A process that is killed leaves its workshop behind without a lock; ``tidy``, which every check of
a place calls, takes such workshops away.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import io
import os
import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, OutputError

_PREFIX, _SUFFIX = ".omnitrack-", ".tmp"
_WORKSHOP = re.compile(r"\.omnitrack-[a-z0-9_]{8}\.tmp")
_NEW, _OLD = "new", "old"
"""Contents of a workshop: what is being made and, where the system cannot exchange two folders, a
folder with the one that it replaces, under its own name."""
_ROOM = 100
"""Bytes by which a path in a workshop may be longer than the path that it replaces."""
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2  # linux/fcntl.h, linux/fs.h
_CANNOT_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP)


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


def npz_of(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Pack arrays as ``numpy.savez_compressed`` does, with equal bytes for equal arrays."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array))
            # The earliest date that a zip file can hold; the time of day would change the bytes.
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, buffer.getvalue())
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
            _keep(path)
        _put(shop, target)
        # A name is part of the folder above, which has to reach the disk, too.
        _keep(target.parent)


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
        _check_lengths(there, target, names)
        _try_out(there)
        if mark is not None and there == target:
            _try_out(target.parent)


def tidy(place: Path) -> None:
    """Remove the workshops that killed processes left in a folder, and finish a replacement that
    one was in the middle of."""
    for shop in place.iterdir():
        if not is_workshop(shop.name):
            continue
        with suppress(OSError):
            lock = os.open(shop, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                # A living process holds the lock: the attempt fails at once, and its workshop
                # stays.
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _clear(shop)
            finally:
                os.close(lock)


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


def _check_lengths(there: Path, target: Path, names: Iterable[str]) -> None:
    """Refuse names and paths that are too long for the file system of the folder ``there``."""
    longest = max((len(os.fsencode(name)) for name in names), default=0)
    if longest > os.pathconf(there, "PC_NAME_MAX"):
        raise OSError(errno.ENAMETOOLONG, f"{os.strerror(errno.ENAMETOOLONG)} in it")
    if len(os.fsencode(target)) + longest + _ROOM > os.pathconf(there, "PC_PATH_MAX"):
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))


def _try_out(folder: Path) -> None:
    """Make sure that workshops can be made in a folder, and tidy it."""
    # Only an attempt is certain: access rights say nothing of a full file system.
    with _workshop(folder):
        tidy(folder)


@contextmanager
def _workshop(folder: Path) -> Iterator[Path]:
    """Yield a locked workshop in a folder, and remove it in the end."""
    while True:
        shop = Path(tempfile.mkdtemp(_SUFFIX, _PREFIX, folder))
        lock = os.open(shop, os.O_RDONLY)
        with suppress(OSError):  # a file system without locks; nobody can take it away then
            fcntl.flock(lock, fcntl.LOCK_EX)
        if shop.exists():  # nobody took it away before it was locked
            break
        os.close(lock)
    try:
        yield shop
    finally:
        with suppress(OSError):
            _clear(shop)
        os.close(lock)


def _put(shop: Path, target: Path) -> None:
    """Move what a workshop has made to ``target``; an earlier folder goes into the workshop."""
    new, old = shop / _NEW, shop / _OLD / target.name
    if not target.is_dir():
        os.replace(new, target)
        return
    try:
        _exchange(new, target)
    except OSError as error:
        if error.errno not in _CANNOT_EXCHANGE:
            raise
        # Killed between the two renames, the first one of the next process to ``tidy`` finishes.
        old.parent.mkdir()
        os.rename(target, old)
        try:
            os.rename(new, target)
        except OSError:
            os.rename(old, target)
            raise


def _clear(shop: Path) -> None:
    """Finish the replacement that a killed process was in the middle of; remove its workshop."""
    # An earlier folder without a target means that the process died between its two renames.
    for old in (shop / _OLD).glob("*"):  # one at most
        target = shop.with_name(old.name)
        if (shop / _NEW).is_dir() and not target.exists():
            os.rename(shop / _NEW, target)
    shutil.rmtree(shop)


def _exchange(one: Path, other: Path) -> None:
    """Exchange two folders in one atomic step; an ``OSError`` of ``_CANNOT_EXCHANGE`` where the
    system or the file system does not know how."""
    library = ctypes.CDLL(None, use_errno=True)
    ends = _AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other)
    known = hasattr(library, "renameat2")
    if not known or library.renameat2(*ends, _RENAME_EXCHANGE) != 0:
        # An older C library lacks the call, which counts as a system that cannot do it.
        code = ctypes.get_errno() if known else errno.ENOSYS
        raise OSError(code, os.strerror(code), str(other))


def _keep(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
