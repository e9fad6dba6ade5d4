"""Damage to a folder: to the bytes of a file, to what it holds, to the file itself."""

from __future__ import annotations

import io
import json
import random
import re
import shutil
import struct
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fuzzing.files import changed
from fuzzing.values import Raw, number, thing
from fuzzing.values import text as odd_text


def damaged(rng: random.Random, folder: Path, others: Mapping[str, bytes], count: int) -> list[str]:
    """Damage so many files of a folder; what was done, in words.

    Args:
        rng: decides what is done.
        folder: holds what is read.
        others: files of another folder, by name.
        count: of files; all where there are fewer.
    """
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return [
        f"{path.relative_to(folder)}: {_one(rng, path, others)}"
        for path in rng.sample(files, min(count, len(files)))
    ]


def _one(rng: random.Random, path: Path, others: Mapping[str, bytes]) -> str:
    """Damage a file that is whole so far."""
    texts = dict.fromkeys((".xml", ".inp", ".pcf", ".csv"), _text)
    inner = {".json": _json, ".parquet": _parquet, ".npz": _npz, **texts}.get(path.suffix)
    ways: list[Callable[[random.Random, Path], str]] = [_bytes, _file]
    if inner is not None:
        ways += [inner, inner, inner]
    if path.name in others:
        ways.append(lambda _, path: _write(path, others[path.name], "of another run"))
    return rng.choice(ways)(rng, path)


def _write(path: Path, data: bytes, what: str) -> str:
    path.write_bytes(data)
    return what


def _bytes(rng: random.Random, path: Path) -> str:
    """Bytes changed without a look at what they mean."""
    data = path.read_bytes()
    at, length = rng.randrange(len(data) + 1), rng.choice((1, 4, 100, 1000))
    flipped = bytearray(data)
    for _ in range(rng.choice((1, 2, 20))):
        if flipped:
            flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    ends = bytearray(data)  # where the tables of contents of Parquet and zip files are
    for _ in range(3):
        if ends:
            ends[-rng.randrange(1, min(len(ends), 200) + 1)] = rng.randrange(256)
    files = (p for p in path.parent.iterdir() if p.is_file() and not p.is_symlink())
    siblings = sorted(files)
    choices = {
        "cut off": data[:at],
        "head cut off": data[at:],
        "empty": b"",
        "bits flipped": bytes(flipped),
        "end changed": bytes(ends),
        "zeros inside": data[:at] + bytes(length) + data[at + length :],
        "longer": data + rng.randbytes(length),
        "a piece lost": data[:at] + data[at + length :],
        "noise": rng.randbytes(length),
        "swapped": rng.choice(siblings).read_bytes(),
    }
    what = rng.choice(list(choices))
    return _write(path, choices[what], what)


def _file(rng: random.Random, path: Path) -> str:
    """Something else, or nothing, where the file was."""
    path.unlink()
    what = rng.choice(("deleted", "a folder", "leads to itself", "leads nowhere", "unreadable"))
    if what == "a folder":
        path.mkdir()
    elif what == "leads to itself":
        path.symlink_to(path)
    elif what == "leads nowhere":
        path.symlink_to(path.with_name("nothing"))
    elif what == "unreadable":
        path.symlink_to("/proc/self/mem")  # opens, and fails to be read, for every user
    return what


def _json(rng: random.Random, path: Path) -> str:
    """Values of JSON changed."""
    data = json.loads(path.read_text(encoding="utf-8"))
    if rng.random() < 0.1:
        whole = rng.choice((None, [], {}, 1, "text", [data], {"name": data}))
        return _write(path, json.dumps(whole).encode(), f"becomes {str(whole)[:30]}")
    contents, story = changed(rng, data, rng.choice((1, 1, 2)))
    return _write(path, contents, "; ".join(story))


def _text(rng: random.Random, path: Path) -> str:
    """Words and lines changed, of a file that people write and read."""
    text, times = path.read_text(encoding="utf-8"), rng.choice((1, 1, 2, 3))
    for _ in range(times):
        text = misprinted(rng, text)
    return _write(path, text.encode("utf-8", "replace"), f"{times} misprints")


def misprinted(rng: random.Random, text: str) -> str:
    """Return a text with a line lost, doubled or moved, the rest lost, or a word changed."""
    lines = text.splitlines() or [""]
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.choice(("lost", "twice", "swapped", "cut off", "word", "word", "word"))
    if way == "lost":
        del lines[at]
    elif way == "twice":
        lines.insert(other, lines[at])
    elif way == "swapped":
        lines[at], lines[other] = lines[other], lines[at]
    elif way == "cut off":
        del lines[at + 1 :]
    else:
        parts = re.split(r"([^\s\"'=<>/]+)", lines[at])  # every second one is a word
        if len(parts) > 1:
            word = rng.randrange(1, len(parts), 2)
            parts[word] = _another(rng, parts[word], text.split())
        lines[at] = "".join(parts)
    return "\n".join(lines)


def _another(rng: random.Random, word: str, words: Sequence[str]) -> str:
    """Return an odd word for one of a text."""
    try:
        near = float(word)
    except ValueError:
        near = None
    odd = number(rng, near)
    as_text = odd.text if isinstance(odd, Raw) else str(odd)
    return rng.choice((as_text, as_text, odd_text(rng), rng.choice(words), ""))


def _parquet(rng: random.Random, path: Path) -> str:
    """Columns, rows and notes of a table changed."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(path.read_bytes()))
    name = rng.choice(table.column_names)
    at, rows = table.column_names.index(name), table.num_rows
    few = rng.randrange(rows + 1)
    odd = rng.choice((np.nan, np.inf, -1.0, 1e18, 0.0, 1e9))
    columns: dict[str, Any] = {
        "text": pa.array([odd_text(rng)[:50].encode("utf-8", "replace").decode()] * rows),
        "nulls": pa.nulls(rows, pa.float64()),
        "one null": pa.array([None] * min(rows, 1) + [0.0] * (rows - 1), pa.float64()),
        "lists": pa.array([[1.0]] * rows),
        "truth": pa.array([True] * rows),
        f"all {odd}": pa.array(np.full(rows, odd)),
        "reversed": table.column(at).combine_chunks().take(pa.array(range(rows)[::-1])),
    }
    notes = dict(table.schema.metadata or {})
    changed_notes = {key: json.dumps(_plain(rng)).encode() for key in notes}
    whole: dict[str, Callable[[], pa.Table]] = {
        "column lost": lambda: table.drop_columns([name]),
        "column renamed": lambda: table.rename_columns({name: f"{name}_"}),
        "column twice": lambda: table.append_column(name, table.column(at)),
        "rows cut off": lambda: table.slice(0, few),
        "rows twice": lambda: pa.concat_tables([table, table]),
        "no rows": lambda: table.slice(0, 0),
        "no columns": lambda: table.select([]),
        "notes lost": lambda: table.replace_schema_metadata(None),
        "notes changed": lambda: table.replace_schema_metadata({**notes, **changed_notes}),
    }
    what = rng.choice(
        [*whole, *(f"{name}: {key}" for key in columns), *(f"{name}: {key}" for key in columns)]
    )
    if what in whole:
        new = whole[what]()
    else:
        new = table.set_column(at, name, columns[what.partition(": ")[2]])
    kept = io.BytesIO()
    pq.write_table(new, kept)
    return _write(path, kept.getvalue(), what)


def _plain(rng: random.Random) -> Any:
    """An odd value that JSON can hold."""
    value = thing(rng)
    try:
        json.dumps(value)
    except TypeError:
        return None
    return value


def _npz(rng: random.Random, path: Path) -> str:
    """Arrays of an archive changed, or its directory."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if rng.random() < 0.3:
        return _zip_fields(rng, path)
    name = rng.choice(list(arrays))
    array = np.atleast_1d(arrays[name])
    changes = _odd_texts(rng) if array.dtype.kind == "U" else _odd_numbers(rng, array)
    what = rng.choice([*changes, "claims"])
    if what == "claims":
        _claim(rng, path, arrays, name)
    else:
        kept = {**arrays, name: changes[what]}
        np.savez_compressed(path, **{k: v for k, v in kept.items() if v is not None})
    return f"{name}: {what}"


def _odd_texts(rng: random.Random) -> dict[str, Any]:
    """Return what may stand where an array of text was, by what it is."""
    texts = [odd_text(rng)[:1000] for _ in range(3)]
    return {
        "lost": None,
        "another text": np.array(texts[0]),
        "texts": np.array(texts),
        "a number": np.array(1.0),
        "bytes": np.array(b"tanh"),
    }


def _odd_numbers(rng: random.Random, array: Any) -> dict[str, Any]:
    """Return what may stand where an array of numbers was, by what it is."""
    return {
        "lost": None,
        "cut off": array[: rng.randrange(len(array) + 1)],
        "one value": array.ravel()[:1].reshape(()),
        "text": array.astype(str),
        "complex": array.astype(complex),
        "whole": array.astype(np.int8),
        "objects": array.astype(object),
        "records": np.zeros(len(array), [("a", "f8")]),
        "more dimensions": array[..., None],
        "flat": array.ravel(),
        "not numbers": np.full_like(array, np.nan),
        "huge": np.full_like(array, 1e300),
        "zeros": np.zeros_like(array),
        "no columns": array.reshape(len(array), -1)[:, :0],
        "big-endian": array.astype(">f8"),
        "dates": np.zeros(len(array), "M8[s]"),
    }


def _claim(rng: random.Random, path: Path, arrays: Mapping[str, Any], name: str) -> None:
    """An array whose header says other than what follows."""
    shape = rng.choice(((10**12,), (10**9, 100), (-1,), (2**62, 2**62), (10**11, 0), ("a",), 3))
    kind = rng.choice(("<f8", "|O", "<U1000000", "<f99", "not a kind", "|V2147483647"))
    head = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, array)
            if key == name:
                buffer = io.BytesIO(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head)
            archive.writestr(f"{key}.npy", buffer.getvalue())


def _zip_fields(rng: random.Random, path: Path) -> str:
    """A field of a zip archive's heads changed: method, flags, sizes, offsets, names."""
    data = bytearray(path.read_bytes())
    mark = rng.choice((b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"))
    start = data.find(mark)
    at = start + rng.choice((4, 6, 8, 10, 14, 18, 20, 22, 24, 26, 28, 30, 42, 46))
    width = rng.choice((1, 2, 4))
    new = rng.choice((bytes(width), b"\xff" * width, rng.randbytes(width)))
    data[at : at + width] = new
    return _write(path, bytes(data), f"zip, byte {at}: {new.hex()}")


def removed(rng: random.Random, folder: Path) -> str:
    """Damage to the folder as a whole."""
    what = rng.choice(("missing", "empty", "a file", "leads to itself"))
    shutil.rmtree(folder)
    if what == "empty":
        folder.mkdir()
    elif what == "a file":
        folder.write_text("file")
    elif what == "leads to itself":
        folder.symlink_to(folder)
    return what
