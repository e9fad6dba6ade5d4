"""The list of one-line changes fits the program, and the tool that tries them tells what it saw."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import mutants

ROOT = mutants.ROOT
EVERY = mutants.load()


def test_changes_cover_all_fields() -> None:
    """Each has a name of its own and says what it breaks; the quick form's are among them."""
    assert len(EVERY) == 78
    assert len({mutant.name for mutant in EVERY}) == len(EVERY)
    assert all(len(mutant.breaks.split()) > 5 for mutant in EVERY)
    assert set(mutants.QUICK) < {mutant.name for mutant in EVERY}
    rooms = Counter(Path(mutant.file).parts[1] for mutant in EVERY)
    assert {"walls", "senses", "record", "robots", "pipes", "autonomy", "sim", "trials"} <= set(
        rooms
    )


@pytest.mark.parametrize("mutant", EVERY, ids=lambda mutant: mutant.name)
def test_a_change_fits_the_program(mutant: mutants.Mutant) -> None:
    """The line stands in its file exactly once, the changed file is Python and another program, and
    the tests that shall notice are there."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    changed = mutant.apply(text)
    assert compile(changed, mutant.file, "exec") != compile(text, mutant.file, "exec")
    before, after = text.splitlines(), changed.splitlines()
    assert len(before) == len(after)
    assert sum(a != b for a, b in zip(before, after, strict=True)) == 1
    assert mutant.tests
    assert set(mutant.tests) <= set(mutants.every_test_file())


def test_a_line_that_has_gone_or_stands_twice_is_refused() -> None:
    """A list that has gone stale is an error, not a change that nobody notices."""
    mutant = EVERY[0]
    for text in ("pass\n", f"{mutant.old}\n  {mutant.old}\n"):
        with pytest.raises(ValueError, match="times in"):
            mutant.apply(text)


def verdicts(chosen: list[mutants.Mutant], missed: int) -> dict[str, mutants.Verdict]:
    return {
        mutant.name: mutants.Verdict("" if i < missed else "test_x.py::test_y", 1.0)
        for i, mutant in enumerate(chosen)
    }


@pytest.mark.parametrize(
    ("missed", "explained", "status"), [(0, 0, 0), (3, 3, 0), (3, 2, 1), (4, 4, 1)]
)
def test_the_exit_status_tells_how_many_went_unnoticed(
    missed: int, explained: int, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """0 up to three that are explained, otherwise 1."""
    told = [mutants.Mutant(**vars(m) | {"unnoticed": ""}) for m in EVERY]
    told[:explained] = [mutants.Mutant(**vars(m) | {"unnoticed": "why"}) for m in EVERY[:explained]]
    assert mutants.report(told, verdicts(told, missed)) == status
    out = capsys.readouterr().out
    assert f"{len(EVERY) - missed} of {len(EVERY)} caught" in out
    assert out.count("UNEXPLAINED") == max(0, missed - explained)


def test_verdicts_hold_for_one_program(tmp_path: Path) -> None:
    """They are read back under the same key, and under no other."""
    file, found = tmp_path / "out" / "mutants.json", verdicts(EVERY[:3], 1)
    assert mutants.read_results(file, "a") == {}
    mutants.write_results(file, "a", found)
    assert mutants.read_results(file, "a") == found
    assert mutants.read_results(file, "b") == {}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="copies are of what git knows")
def test_the_changed_copy_is_tested_and_the_checkout_is_left_alone(tmp_path: Path) -> None:
    """A change is made in a copy, noticed there by the test that it breaks, and nowhere else."""
    mutant = next(m for m in EVERY if m.name == "half_a_margin_too_much")
    before = (ROOT / mutant.file).read_bytes()
    # Compiled walls are those of the checkout, which the change leaves as they are.
    (tmp_path / "numba").mkdir()
    for code in (ROOT / "omnitrack_sim").rglob("__pycache__/*.o"):
        shutil.copy(code, tmp_path / "numba")
    verdict = mutants.Trial(tmp_path, 1, named_only=True).of(mutant)
    assert verdict.by == "test_singularity.py::test_the_papers_numbers"
    assert (ROOT / mutant.file).read_bytes() == before
    assert mutant.new in (tmp_path / "copy_0" / mutant.file).read_text(encoding="utf-8")
