"""policies: trained controllers, and what their files say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, out, plain, print_json

if TYPE_CHECKING:
    from omnitrack_sim.robots.omnitrack.policy import Policy


@app.command()
def policies(
    policy: Annotated[
        str | None,
        typer.Argument(
            help="Check this policy, a file or a shipped one, and tell all that it says.",
            autocompletion=complete.policies,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
) -> None:
    """List the policies of the package, or tell what one is; `control.parameters.policy` names
    them."""
    from omnitrack_sim.base.naming import shipped_policies
    from omnitrack_sim.robots.omnitrack.policy import load_policy

    if policy is not None:
        _print_one(load_policy(policy), as_json)
        return
    found = {name: _told(load_policy(path)) for name, path in shipped_policies().items()}
    if as_json:
        print_json(found)
        return
    if not found:
        out.print("the package comes with none; docs/how-to/policies.md says what a policy file is")
        return
    table = Table("policy", "acts", "network", "what it is", box=None, padding=(0, 2))
    for name, told in found.items():
        note = told["record"]["note"]
        table.add_row(name, plain(told["acting"]["name"]), _layers(told), plain(note))
    out.print(table)


def _print_one(policy: Policy, as_json: bool) -> None:
    told = _told(policy)
    if as_json:
        print_json(told)
        return
    table = Table(box=None, padding=(0, 2), show_header=False)
    acting, record = told["acting"], told["record"]
    base = f", added to {acting['base']}" if acting["base"] else ""
    rows = {
        "acts": f"{acting['name']}{base}",
        "network": f"{_layers(told)}, {told['activation']}, output by {told['output']}",
        "features": ", ".join(policy.features),
        "sha256": policy.sha256,
        **{key: str(value) for key, value in record.items() if value not in (None, "")},
    }
    for key, value in rows.items():
        table.add_row(key.replace("_", " "), plain(value))
    out.print(table)


def _told(policy: Policy) -> dict[str, Any]:
    """What a policy's file says, its size and its hash."""
    return policy.header().model_dump(mode="json") | {
        "widths": list(policy.network.widths),
        "sha256": policy.sha256,
    }


def _layers(told: dict[str, Any]) -> str:
    return "-".join(map(str, told["widths"]))
