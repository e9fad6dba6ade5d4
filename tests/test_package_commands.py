"""Commands about the package itself: its policies and its published models."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out
from omnitrack_sim.robots.omnitrack import published

POLICIES = {name: ot.load_policy(path) for name, path in ot.shipped_files("policies").items()}


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal on which no line is wrapped, whatever made the console before."""
    monkeypatch.setattr(out, "_width", 2000)


def invoked(*arguments: object):
    return CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "2000"})


def test_policies_are_listed_with_what_they_are():
    """Each that comes along, by name, with what it acts on, its network and its note."""
    run = invoked("policies")
    lines = run.stdout.splitlines()
    for name, policy in POLICIES.items():
        (line,) = [line for line in lines if line.split()[:1] == [name]]
        for text in (policy.acting.name, repr(policy.network), policy.note):
            assert " ".join(text.split()) in " ".join(line.split())
    listed = json.loads(invoked("policies", "--json").stdout)
    assert set(listed) == set(POLICIES)


@pytest.mark.parametrize("name", sorted(POLICIES))
def test_a_policy_is_described_by_its_contents(name):
    """The same words as in the list of all as JSON, a line a key."""
    (contents,) = [json.loads(invoked("policies", "--json").stdout)[name]]
    assert json.loads(invoked("policies", name, "--json").stdout) == contents
    told = invoked("policies", name).stdout.split()
    expected = (
        (key, [value] if isinstance(value, str) else value) for key, value in contents.items()
    )
    assert told == [word for key, value in expected for word in (key, *", ".join(value).split())]


def test_models_are_checked_or_written_and_not_both(tmp_path, monkeypatch):
    """What differs is named and gives status 1; the count is of the files that were written."""
    for options in ([], ["--check", "--write"]):
        with pytest.raises(ot.InputError, match="say one of --check and --write"):
            CliRunner().invoke(app, ["models", *options], catch_exceptions=False)
    places, different = [], []
    monkeypatch.setattr(published, "check_models", lambda *at: places.append(at) or different)
    monkeypatch.setattr(published, "write_models", lambda *folders: ["a", "b", "c"])
    run = invoked("models", "--check", "--root", tmp_path)
    assert run.exit_code == 0
    assert "models and assets are up to date" in run.stdout
    different += ["robot.xml", "tee.obj"]
    run = invoked("models", "--check", "--root", tmp_path)
    assert run.exit_code == 1
    for told in ("differs: robot.xml", "differs: tee.obj", "models --write"):
        assert told in run.stdout
    assert places == 2 * [(tmp_path / "models", tmp_path / "assets")]
    run = invoked("models", "--write", "--root", tmp_path)
    assert run.exit_code == 0
    assert " ".join(run.stdout.split()) == f"wrote 3 files below {tmp_path.resolve()}"
