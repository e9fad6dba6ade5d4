"""Generated files: all of them whole, or none."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from omnitrack_sim.errors import OutputError
from omnitrack_sim.model.writing import write_files


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
        ("file/x", "its folder is a file"),
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
    with pytest.raises(OutputError, match=f"{target}: cannot be written: {reason}"):
        write_files({tmp_path / "file": b"now", tmp_path / "b" / "c": b"", tmp_path / target: b""})
    assert everything(tmp_path) == before
