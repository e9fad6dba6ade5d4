"""Every public name says by an example in its docstring how it is used, and every example runs."""

import doctest
from pathlib import Path

import pytest

import omnitrack_sim as ot

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def examples(name: str) -> list[doctest.DocTest]:
    """The examples in the docstrings of a public name and of its own methods."""
    thing = getattr(ot, name)
    if not isinstance(thing, type) and not callable(thing):
        return []
    found = doctest.DocTestFinder(recurse=isinstance(thing, type), exclude_empty=True).find(
        thing, name, globs={"ot": ot}
    )
    return [test for test in found if test.examples]


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(ot.__all__))
def test_the_examples_of_a_public_name_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has one in its own docstring, which prints what it says there; constants have none."""
    monkeypatch.chdir(tmp_path)
    tests = examples(name)
    for test in tests:
        report: list[str] = []
        failed = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=report.append).failed
        assert not failed, "".join(report)
    own = any(test.name == name for test in tests)
    constant = not isinstance(getattr(ot, name), type) and not callable(getattr(ot, name))
    assert own or constant, f"{name} has no example"
