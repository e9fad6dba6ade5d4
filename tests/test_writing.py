"""Files and folders are written whole or not at all, whenever the process is killed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from omnitrack_sim.base import writing
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.writing import (
    check_file,
    check_folder,
    whole_file,
    whole_folder,
    write_files,
)

MARK = "mark"
KILLED = """
import itertools, os, signal, sys
from pathlib import Path
from omnitrack_sim.base import writing

def killed_at(step, work):
    '''Do some work in a child process that is killed at its step-th call of the system; returns
    whether it came so far.'''
    child = os.fork()
    if child:
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])
    calls = itertools.count()
    sys.addaudithook(
        lambda event, _: event.startswith(("os.", "open", "shutil."))
        and next(calls) == step
        and os.kill(os.getpid(), signal.SIGKILL)
    )
    work()
    os._exit(0)

def replace(target):
    with writing.whole_folder(target, "mark") as folder:
        for name in ("mark", "other"):
            (folder / name).write_text("new")

def told(target):
    return {path.read_text() for path in target.iterdir()}, len(list(target.iterdir()))

place = Path(sys.argv[1])
for step in itertools.count():
    target = place / f"{step}" / "run"
    target.mkdir(parents=True)
    for name in ("mark", "other"):
        (target / name).write_text("old")
    alive = not killed_at(step, lambda: replace(target))
    assert writing.whole(target).is_dir(), step
    assert told(target) in (({"old"}, 2), ({"new"}, 2)), step
    writing.check_folder(target, "mark")
    assert told(target) in (({"old"}, 2), ({"new"}, 2)), step
    assert [path.name for path in target.parent.iterdir()] == ["run"], step
    if alive:
        assert told(target) == ({"new"}, 2)
        break
print(step)
"""
"""Replaces a folder in processes that are killed one call of the system later each time."""


def test_no_kill_loses_a_folder_or_leaves_anything(tmp_path):
    """Whenever the process is killed, a reader finds the earlier folder or the new one, whole, and
    the next check takes away what is left."""
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 15  # so many places to be killed at


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def replace(target: Path, text: str) -> None:
    with whole_folder(target, MARK) as folder:
        (folder / MARK).write_text(text)


def test_a_replacement_that_fails_restores_the_earlier_folder(tmp_path, monkeypatch):
    """The second move fails, and the first one is undone."""

    def fails(move):
        def second(source, target):
            if Path(source).name == "new" and Path(target).name == "run":
                raise PermissionError(errno.EACCES, "Permission denied")
            move(source, target)

        return second

    replace(tmp_path / "run", "old")
    for name in ("rename", "replace"):
        monkeypatch.setattr(writing.os, name, fails(getattr(os, name)))
    with pytest.raises(OutputError, match="Permission denied"):
        replace(tmp_path / "run", "new")
    assert contents(tmp_path / "run") == {MARK: "old"}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    """An error in the block leaves the earlier file and nothing beside it."""
    (tmp_path / "a").write_text("old")

    def half():
        with whole_file(tmp_path / "a") as part:
            part.write_text("ha")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert contents(tmp_path) == {"a": "old"}
    with whole_file(tmp_path / "a") as part:
        part.write_text("new")
    assert contents(tmp_path) == {"a": "new"}
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_no_file_of_several_takes_its_place_before_all_are_written(tmp_path):
    """The second one fails: the first is not there either."""
    (tmp_path / "out" / "b").mkdir(parents=True)
    with pytest.raises(OutputError, match="is a folder"):
        write_files({tmp_path / "out" / "a": b"1", tmp_path / "out" / "b": b"2"})
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["b"]


def test_links_are_followed(tmp_path):
    """A file or folder behind a link is replaced, not the link."""
    (tmp_path / "a").write_text("old")
    (tmp_path / "link").symlink_to("a")
    with whole_file(tmp_path / "link") as part:
        part.write_text("new")
    assert (tmp_path / "a").read_text() == "new"
    assert (tmp_path / "link").is_symlink()
    replace(tmp_path / "run", "old")
    (tmp_path / "same").symlink_to("run")
    replace(tmp_path / "same", "new")
    assert contents(tmp_path / "run") == {MARK: "new"}


def test_names_as_long_as_the_system_takes(tmp_path):
    """255 bytes can be written; more is refused by the check, before any work."""
    replace(tmp_path / ("a" * 255), "1")
    with whole_file(tmp_path / ("b" * 255)) as part:
        part.write_text("2")
    long = "c" * 256
    deep = tmp_path.joinpath(*["d" * 200] * 20)
    for place in (tmp_path / long, tmp_path / "missing" / long / "run", deep):
        with pytest.raises(OutputError, match="name too long"):
            check_folder(place, MARK)
    with pytest.raises(OutputError, match="name too long"):
        check_file(tmp_path / long)
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(OutputError, match="name too long"):
            check_folder(folder, files=[long])


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("folder", "is a folder; choose a file"),
        ("missing/a.txt", "missing does not exist"),
        ("file/a.txt", "Not a directory"),
        ("/dev/full", "is a device"),
        ("/proc/a.txt", "cannot be written"),
        ("pipe", "is a device or the like"),
        ("loop", "is a device or the like"),
        ("a\0b", "is no name of a file"),
    ],
)
def test_odd_places_for_files_are_refused(tmp_path, place, told):
    """By the check and by the writing; nothing is written or replaced."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.rglob("*"))

    def write():
        with whole_file(tmp_path / place) as part:
            part.write_text("1")

    for attempt in (lambda: check_file(tmp_path / place), write):
        with pytest.raises(OutputError, match=told):
            attempt()
    assert sorted(tmp_path.rglob("*")) == before
    assert Path("/dev/full").is_char_device()


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("file", "is a file; choose a folder"),
        ("file/run", "Not a directory"),
        ("others", f"holds files but no {MARK}"),
        ("/proc/run", "cannot be written"),
        ("/proc", "holds files but no"),
    ],
)
def test_odd_places_for_folders_are_refused(tmp_path, place, told):
    """By the check and by the writing; nothing is written or replaced."""
    (tmp_path / "file").touch()
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "thesis.txt").touch()
    before = sorted(tmp_path.rglob("*"))
    for attempt in (check_folder, replace):
        with pytest.raises(OutputError, match=told):
            attempt(tmp_path / place, MARK)
    assert sorted(tmp_path.rglob("*")) == before


def test_only_the_workshops_of_the_dead_are_taken_away(tmp_path):
    """A locked one, and a hidden folder of the user's, stay."""
    dead, alive, own = (
        tmp_path / f".omnitrack-{name}.tmp" for name in ("dead0000", "live0000", "x")
    )
    for folder in (dead, alive, own):
        folder.mkdir()
        (folder / "new").touch()
    with FileLock(alive / "lock"):
        check_file(tmp_path / "a")
        assert sorted(tmp_path.iterdir()) == sorted([alive, own])
    check_folder(tmp_path, None)
    assert list(tmp_path.iterdir()) == [own]


def test_a_full_disk_is_told(tmp_path, monkeypatch):
    """ENOSPC while writing is an OutputError that names the place, and leaves nothing."""

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writing.os, "fsync", full)
    with pytest.raises(OutputError, match=r"a\.txt: cannot be written: No space left"):
        writing.write_file(tmp_path / "a.txt", b"1")
    with pytest.raises(OutputError, match="run: cannot be written: No space left"):
        replace(tmp_path / "run", "1")
    assert list(tmp_path.iterdir()) == []


def everything(folder: Path) -> dict[str, bytes | None]:
    """Contents of all files below a folder by their paths; folders have none."""
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None
        for p in folder.rglob("*")
    }


def test_files_and_their_folders_are_made(tmp_path):
    """Files are written with what they should hold, new ones and old ones, and nothing else is."""
    (tmp_path / "old").write_bytes(b"before")
    files = {tmp_path / "old": b"now", tmp_path / "a" / "b" / "new": b"n"}
    assert write_files(files) == list(files)
    assert everything(tmp_path) == {"old": b"now", "a": None, "a/b": None, "a/b/new": b"n"}


def test_a_full_disk_changes_nothing(tmp_path, monkeypatch):
    """Where the disk fills up in the middle of a file, all is as it was and the file is named."""
    (tmp_path / "one").write_bytes(b"before")
    whole = Path.write_bytes

    def until_full(path: Path, content: bytes) -> int:
        if content == b"three":
            whole(path, content[:2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return whole(path, content)

    monkeypatch.setattr(Path, "write_bytes", until_full)
    folder = tmp_path / "new"
    files = {tmp_path / "one": b"one", folder / "two": b"two", folder / "three": b"three"}
    with pytest.raises(OutputError, match=r"new/three: cannot be written: No space left"):
        write_files(files)
    assert everything(tmp_path) == {"one": b"before"}


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("file/x", "Not a directory|File exists"),
        ("file/x/y", "Not a directory"),
        ("folder", "is a folder"),
        ("n" * 300, "File name too long"),
        ("n" * 300 + "/x", "File name too long"),
    ],
)
def test_odd_places_change_nothing(tmp_path, target, reason):
    """A file where a folder has to be, or the reverse, is refused before anything is replaced."""
    (tmp_path / "file").write_bytes(b"before")
    (tmp_path / "folder").mkdir()
    before = everything(tmp_path)
    with pytest.raises(OutputError, match=reason):
        write_files({tmp_path / "file": b"now", tmp_path / "b" / "c": b"", tmp_path / target: b""})
    assert everything(tmp_path) == before
